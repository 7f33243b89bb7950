"""The aided filter left to itself is a strapdown INS: against `inertial.strapdown` and the truth, and its order."""

import math

import numpy as np
import pytest

from schuler.aiding.aided_engine import Engine, StartState, room
from schuler.aiding.aided_rows import Events
from schuler.aiding.aided_settings import AidedSettings, layout_of
from schuler.ground.frames import quat_conjugate, quat_multiply, rotvec_from_quat
from schuler.inertial.strapdown import Start, Strapdown, Track
from schuler.kernels import aided_measure as m
from schuler.kernels import aided_state as k
from schuler.truth import trajectories as shapes

D = math.pi / 180.0
NOTHING = Events(np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 12)))


def lively(duration=120.0):
    """Turns, climbs, rolls and pitches all at once, nothing above 1 Hz."""
    flight = shapes.legs(50.0 * D, 30.0 * D, 3000.0, speed=80.0, heading=40.0 * D, duration=duration)
    return flight.with_waves(
        ("course", 0.6, 0.05, 0.3), ("climb", 6.0, 0.08, 1.0), ("speed", 4.0, 0.1, 0.0), ("pitch", 0.05, 0.7, 0.5),
        ("roll", 0.2, 0.5, 0.5),
    )  # fmt: skip


def rows_of(ideal):
    t = ideal.start.time[0] + ideal.dt * np.arange(1, len(ideal.dtheta) + 1)
    return np.column_stack([t, ideal.dtheta / ideal.dt, ideal.dv / ideal.dt])


def begun(start, names=(), settings=None, dt=0.01):
    s = settings or AidedSettings()
    e = Engine(s, layout_of(s, names), dt)
    e.begin(
        StartState(
            start.time, start.q_nb, start.v_n, start.lat, start.lon, start.height, np.zeros((9, 9)),
            level_from_force=False,
        )
    )  # fmt: skip
    return e


def free(start, rows, events=NOTHING, names=(), settings=None, out_dt=0.0):
    """The filter's track over rows (n, 7), from a start without doubt."""
    e = begun(start, names, settings, float(rows[1, 0] - rows[0, 0]))
    e.x[k.NEXT] = start.time + out_dt
    e.kept = room(e.layout.n, rows=len(rows) + 2, events=len(events), inner=8, stds=1)
    e.run(rows, np.zeros(len(rows), dtype=bool), events, out_dt)
    ox = e.kept.ox[: int(e.kept.counts[2])]
    track = Track(
        ox[:, k.NOMINAL], ox[:, k.LAT], ox[:, k.LON], ox[:, k.HGT], ox[:, k.VEL : k.VEL + 3],
        ox[:, k.QUAT : k.QUAT + 4],
    )  # fmt: skip
    return track, e


def ends(track, truth):
    """Last row's position error m, velocity error m/s, attitude error rad."""
    at = truth.at(track.time[-1:])
    error = Track(*(getattr(track, n)[-1:] for n in ("time", "lat", "lon", "height", "v_n", "q_nb"))).minus(at)
    turn = rotvec_from_quat(quat_multiply(track.q_nb[-1:], quat_conjugate(at.q_nb)))
    return np.array([np.linalg.norm(error.position), np.linalg.norm(error.velocity), np.linalg.norm(turn)])


@pytest.mark.slow
def test_an_hour_left_to_itself_is_the_strapdowns_hour() -> None:
    """1 h at 50 Hz with turns: both carry the same increments to the same place, to metres (the free vertical
    channel apart, which multiplies any difference by 500)."""
    path = shapes.legs(
        50.0 * D, 30.0 * D, 3000.0, speed=80.0, heading=40.0 * D, duration=3600.0,
        turns=[x * D for x in (90, -60, 180, -120, 45)], climbs=[500.0, -300.0, 0.0, 200.0, 0.0, -300.0],
    )  # fmt: skip
    ideal = path.ideal(50.0, every=500)
    start = Start.of(ideal.start)
    track, _ = free(start, rows_of(ideal), out_dt=10.0)
    other = Strapdown(start).feed(ideal.dtheta, ideal.dv, ideal.dt, every=500)
    assert len(track) >= 359
    apart = Track(*(getattr(track, n)[:359] for n in ("time", "lat", "lon", "height", "v_n", "q_nb"))).minus(
        Track(*(getattr(other, n)[:359] for n in ("time", "lat", "lon", "height", "v_n", "q_nb")))
    )
    assert 0.0 < apart.horizontal.max() < 3.0
    assert np.abs(apart.phi).max() < 1e-6
    assert np.abs(apart.position[:60, 2]).max() < 0.5  # ten minutes of the free vertical channel


@pytest.mark.parametrize("what", ["position", "velocity", "attitude"])
def test_the_error_is_of_second_order_or_better(what: str) -> None:
    path = lively(60.0)
    rates, miss = np.array([10.0, 20.0, 40.0]), []
    for rate in rates:
        ideal = path.ideal(rate)
        track, _ = free(Start.of(ideal.start), rows_of(ideal))
        miss.append(ends(track, path)[("position", "velocity", "attitude").index(what)])
    assert -np.polyfit(np.log(rates), np.log(miss), 1)[0] > 1.9, miss


def test_coning_is_corrected_as_by_one_earlier_increment() -> None:
    """1 deg at 5 Hz and 200 Hz drifts 4.05 deg/h uncorrected, 0.020 with one earlier increment."""
    path = shapes.coning(0.0, 0.0, cone=1.0 * D, frequency=5.0, duration=10.0)
    ideal = path.ideal(200.0)
    track, _ = free(Start.of(ideal.start), rows_of(ideal))
    turn = rotvec_from_quat(quat_multiply(track.q_nb[1:], quat_conjugate(ideal.truth.q_nb[1:])))
    rate = abs(float((turn[-1, 0] - turn[1, 0]) / (track.time[-1] - track.time[2]))) / (D / 3600.0)
    assert rate == pytest.approx(0.020, abs=0.004)


def test_sculling_is_corrected() -> None:
    """Roll and sway in step: the spurious acceleration falls with dt^4, an uncorrected scheme's with dt^2."""
    rates, miss = np.array([20.0, 40.0, 80.0]), []
    for rate in rates:
        ideal = (
            shapes.rest(0.0, 0.0, heading=math.pi / 2, duration=5.0)
            .with_waves(("roll", 0.05, 2.0, 0.0), ("pitch", 0.05, 2.0, 0.0), ("speed", 0.1, 2.0, math.pi / 2))
            .ideal(rate)
        )
        track, _ = free(Start.of(ideal.start), rows_of(ideal))
        miss.append(np.linalg.norm(track.v_n[-1] - ideal.truth.v_n[-1]))
    assert -np.polyfit(np.log(rates), np.log(miss), 1)[0] > 2.7, miss


def split_events(rows, step):
    """Depth measurements with no weight at all, between the rows and on them."""
    t = np.arange(rows[0, 0] + step, rows[-1, 0], step)
    z = np.full((len(t), 12), np.nan)
    z[:, 0], z[:, 3] = 0.0, 1e12
    return Events(t, np.full(len(t), m.DEPTH, dtype=np.int64), z)


def test_a_row_that_measurements_cut_is_still_the_same_row() -> None:
    """Cut intervals move the end by the second order: the difference to the uncut run falls with dt^2."""
    path = lively(30.0)
    rates, apart = np.array([20.0, 40.0, 80.0]), []
    for rate in rates:
        ideal = path.ideal(rate)
        start, rows = Start.of(ideal.start), rows_of(ideal)
        whole, _ = free(start, rows)
        cut, e = free(start, rows, split_events(rows, 0.37 / rate))
        assert e.kept.counts[1] == len(split_events(rows, 0.37 / rate))
        assert cut.time[-1] == whole.time[-1] and len(cut) == len(whole)
        apart.append(np.linalg.norm(cut.v_n[-1] - whole.v_n[-1]) + np.linalg.norm(cut.q_nb[-1] - whole.q_nb[-1]))
    assert -np.polyfit(np.log(rates), np.log(apart), 1)[0] > 1.7, apart
    assert apart[-1] < 0.02


def test_a_measurement_inside_a_row_sees_the_state_of_its_own_instant() -> None:
    """Velocity innovations of exact velocities, between and on the rows, are what a tenth of a row never explains."""
    path = lively(20.0)
    ideal = path.ideal(50.0)
    rows = rows_of(ideal)
    t = np.arange(1.0, 19.0, 0.0333)
    z = np.full((len(t), 12), np.nan)
    z[:, :3], z[:, 3:6] = path.at(t).v_n, 1e6
    events = Events(t, np.full(len(t), m.VELOCITY, dtype=np.int64), z)
    _, e = free(Start.of(ideal.start), rows, events)
    innovations = e.kept.innov[: len(t), 0, :2]
    assert np.abs(innovations).max() < 0.03  # 0.2 m/s were they taken at the row's end
    assert e.kept.counts[1] == len(t)


def test_the_covariance_at_an_end_is_the_same_with_and_without_cuts() -> None:
    path = lively(10.0)
    ideal = path.ideal(50.0)
    start, rows = Start.of(ideal.start), rows_of(ideal)
    names = ("gyro_bias", "accel_bias")
    _, whole = free(start, rows, names=names)
    _, cut = free(start, rows, split_events(rows, 0.0123), names=names)
    sd = np.sqrt(np.diag(whole.P))
    np.testing.assert_allclose(np.sqrt(np.diag(cut.P)), sd, rtol=2e-3)
    np.testing.assert_allclose(cut.P / np.outer(sd, sd), whole.P / np.outer(sd, sd), atol=5e-3)
