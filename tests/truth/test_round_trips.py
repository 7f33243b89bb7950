"""Trajectory -> perfect IMU increments -> strapdown: what comes back is the trajectory."""

import math

import numpy as np
import pytest

from schuler.inertial import strapdown
from schuler.inertial.strapdown import Start, Strapdown
from schuler.truth import trajectories as shapes

D = math.pi / 180.0


def returned(path: shapes.Trajectory, rate: float, every: int, **options):
    """Errors after the round trip."""
    ideal = path.ideal(rate, every=1 if options.get("vertical") == "held" else every)
    aids = {}
    if options.get("vertical") == "held":
        aids = {"height": ideal.truth.height.copy(), "v_down": ideal.truth.v_n[:, 2].copy()}
    ins = Strapdown(Start.of(ideal.start), earth=path.earth, **options)
    track = ins.feed(ideal.dtheta, ideal.dv, ideal.dt, every=every, **aids)
    truth = path.at(track.time - track.time[0] + every / rate)
    track = strapdown.Track(truth.time, track.lat, track.lon, track.height, track.v_n, track.q_nb)
    return track.minus(truth, path.earth)


def test_an_hour_of_flight_with_turns_returns_to_a_millimetre_with_height_held() -> None:
    flight = shapes.legs(
        50.0 * D, 30.0 * D, 3000.0, speed=200.0, heading=40.0 * D, duration=3600.0,
        turns=[x * D for x in (90, -60, 180, -120, 45)], climbs=[1000.0, -500.0, 0.0, 300.0, 0.0, -800.0],
    )  # fmt: skip
    e = returned(flight, 200.0, 2000, vertical="held")
    assert e.horizontal.max() < 1e-4  # asked: 1e-3
    assert np.abs(e.phi).max() < 1e-11  # asked: 1e-9
    assert e.horizontal.max() > 0.0


def test_the_free_vertical_channel_returns_in_ten_minutes() -> None:
    flight = shapes.legs(
        50.0 * D, 30.0 * D, 3000.0, speed=200.0, heading=1.0, turns=[1.5, -1.0], climbs=[800.0, 0.0, -300.0],
        duration=600.0,
    )  # fmt: skip
    e = returned(flight, 200.0, 200)
    assert np.abs(e.position).max() < 1e-4


def three_g() -> shapes.Trajectory:
    """Turns with up to 3 g, roll rate to 60 deg/s, nothing above 0.2 Hz."""
    flight = shapes.legs(50.0 * D, 30.0 * D, 3000.0, speed=180.0, heading=40.0 * D, duration=600.0)
    return flight.with_waves(
        ("course", 0.62, 0.04, 0.3), ("climb", 12.0, 0.08, 1.0), ("speed", 8.0, 0.1, 0.0), ("pitch", 0.1, 0.2, 0.5),
        ("roll", 0.55, 0.17, 0.5),
    )  # fmt: skip


def test_three_g_manoeuvres_return_to_a_millimetre_at_100_hz() -> None:
    path = three_g()
    at = path.at(np.linspace(0.0, 600.0, 6001))
    load = np.linalg.norm(at.f_b, axis=1) / 9.81
    rate = np.degrees(np.abs(at.w_ib_b[:, 0]))
    assert 2.8 < load.max() < 3.6
    assert 50.0 < rate.max() < 75.0
    e = returned(path, 100.0, 100)
    assert np.linalg.norm(e.position, axis=1).max() < 1e-3


@pytest.mark.parametrize(("coning", "order"), [("one", 3), ("two", 4), ("pair", 4), ("three", 4)])
def test_the_error_of_manoeuvres_falls_with_the_order_of_the_scheme(coning: str, order: int) -> None:
    """Previous increments kept: one leaves dt^3 in large turns, two dt^4, three better still; pairs dt^4."""
    path = three_g()
    rates = np.array([12.5, 25.0, 50.0])
    miss = []
    for rate in rates:
        ideal = path.ideal(rate, 120.0, every=2)
        ins = Strapdown(Start.of(ideal.start), coning=coning)
        track = ins.feed(ideal.dtheta, ideal.dv, ideal.dt, every=1 if coning == "pair" else 2)
        track = strapdown.Track(ideal.truth.time, track.lat, track.lon, track.height, track.v_n, track.q_nb)
        miss.append(np.abs(track.minus(ideal.truth).phi).max())
    slope = -np.polyfit(np.log(rates), np.log(miss), 1)[0]
    assert slope > order - 0.25
    assert coning == "three" or slope < order + 0.4


@pytest.mark.parametrize(
    "path",
    [
        shapes.great_circle(89.5 * D, 20.0 * D, 1000.0, speed=250.0, heading=0.0, duration=600.0),
        shapes.great_circle(89.5 * D, 20.0 * D, 1000.0, speed=250.0, heading=0.02, duration=600.0),
        shapes.great_circle(-89.5 * D, 20.0 * D, 1000.0, speed=250.0, heading=math.pi, duration=600.0),
        shapes.great_circle(-10.5 * D, 179.8 * D, 1000.0, speed=250.0, heading=70.0 * D, duration=600.0),
        shapes.rhumb_line(40.0 * D, -179.8 * D, 1000.0, speed=250.0, heading=-80.0 * D, duration=600.0),
    ],
    ids=["over the pole", "past the pole", "south pole", "date line", "date line, rhumb"],
)
def test_poles_and_the_date_line_are_places_like_any_other(path: shapes.Trajectory) -> None:
    e = returned(path, 100.0, 100)
    assert np.linalg.norm(e.position, axis=1).max() < 1e-4
    assert np.abs(e.velocity).max() < 1e-6
    assert np.abs(e.phi).max() < 1e-10


@pytest.mark.parametrize(
    "path",
    [
        shapes.dive(36.0 * D, 52.0 * D, speed=1.5, heading=1.2, depth=200.0, duration=600.0),
        shapes.turntable(36.0 * D, 52.0 * D, rate=20.0 * D, mount=(0.5, 0.5, 0.5, 0.5), duration=60.0),
        shapes.oscillation(36.0 * D, 52.0 * D, duration=120.0),
        shapes.rest(36.0 * D, 52.0 * D, roll=0.1, pitch=0.2, heading=0.3, duration=600.0),
        shapes.legs(
            36.0 * D,
            52.0 * D,
            speed=30.0,
            heading=1.0,
            turns=[1.0],
            turn_rate=0.1,
            duration=120.0,
            earth=shapes.TEXTBOOK,
        ),
    ],
    ids=lambda p: p.name,
)
def test_other_motions_return_too(path: shapes.Trajectory) -> None:
    e = returned(path, 100.0, 10)
    assert np.linalg.norm(e.position, axis=1).max() < 1e-4
    assert np.abs(e.phi).max() < 1e-8


def test_a_loop_through_ninety_degrees_of_pitch_loses_nothing() -> None:
    """The state is a quaternion: the aircraft pulls through the vertical and the attitude comes back."""
    path = shapes.rest(0.6, 0.9, 100.0, duration=40.0).with_waves(("pitch", 1.9, 0.05, 0.0), ("roll", 0.2, 0.03, 0.0))
    assert np.abs(path.at(np.linspace(0, 40, 400)).rpy[:, 1]).max() > 89.0 * D
    e = returned(path, 100.0, 1)
    assert np.abs(e.phi).max() < 1e-8
    assert np.linalg.norm(e.position, axis=1).max() < 1e-4


def test_stream_and_batch_give_the_same_bits() -> None:
    ideal = three_g().ideal(100.0, 10.0)
    start = Start.of(ideal.start)
    for coning in ("none", "one", "two", "three"):
        batch = Strapdown(start, coning=coning).feed(ideal.dtheta, ideal.dv, ideal.dt)
        ins = Strapdown(start, coning=coning)
        rows = [ins.step(w, f, ideal.dt) for w, f in zip(ideal.dtheta[:400], ideal.dv[:400], strict=True)]
        for name in ("lat", "lon", "height", "v_n", "q_nb"):
            assert np.array_equal(np.concatenate([getattr(r, name) for r in rows]), getattr(batch, name)[:400])
        pieces = Strapdown(start, coning=coning)
        parts = [pieces.feed(ideal.dtheta[a:b], ideal.dv[a:b], ideal.dt) for a, b in ((0, 123), (123, 1000))]
        assert np.array_equal(np.concatenate([p.q_nb for p in parts]), batch.q_nb)


def test_uneven_intervals_cost_little() -> None:
    """Jittered but known interval ends: the slopes are taken over the intervals as they are."""
    path = three_g()
    fine = path.ideal(1000.0, 20.0)
    rng = np.random.default_rng(4)
    cuts = np.cumsum(rng.integers(8, 13, 1900))
    cuts = cuts[cuts < len(fine.time)]
    edges = np.concatenate([[0], cuts])
    dtheta, dv = (np.add.reduceat(x[: cuts[-1]], edges[:-1]) for x in (fine.dtheta, fine.dv))
    # sums of body-frame integrals are body-frame integrals
    track = Strapdown(Start.of(fine.start)).feed(dtheta, dv, np.diff(edges) * 1e-3)
    truth = path.at(cuts[-1] * 1e-3)
    end = strapdown.Track(truth.time, *(getattr(track, k)[-1:] for k in ("lat", "lon", "height", "v_n", "q_nb")))
    assert np.abs(end.minus(truth).phi).max() < 3e-8


def test_height_aiding_tames_the_vertical_channel() -> None:
    path = shapes.rhumb_line(0.8, 0.1, 500.0, speed=60.0, heading=0.5, duration=1800.0)
    ideal = path.ideal(20.0, every=20)
    dv = ideal.dv - np.array([0.0, 0.0, 1e-3]) * ideal.dt
    free = Strapdown(Start.of(ideal.start)).feed(ideal.dtheta, dv, ideal.dt, every=20)
    aided = Strapdown(Start.of(ideal.start), vertical="aided", tau=20.0).feed(
        ideal.dtheta, dv, ideal.dt, height=np.full(len(dv), 500.0), every=20
    )
    assert abs(free.height[-1] - 500.0) > 1000.0
    assert abs(aided.height[-1] - 500.0) < 0.01  # the loop's integral takes a constant bias
    assert abs(aided.v_n[-1, 2]) < 1e-3


@pytest.mark.slow
def test_the_numerical_floor_of_every_scheme_against_rate() -> None:
    """The figure of docs/strapdown.md: the free-running error of each scheme falls with the rate down to rounding."""
    path = three_g()
    floor = {}
    for coning in ("none", "one", "two", "three", "pair"):
        for rate in (25.0, 100.0, 400.0):
            every = int(rate) * 2
            ideal = path.ideal(rate, every=every)
            n = len(ideal.dtheta) // every * every
            track = Strapdown(Start.of(ideal.start), coning=coning).feed(
                ideal.dtheta[:n], ideal.dv[:n], ideal.dt, every=every // 2 if coning == "pair" else every
            )
            track = strapdown.Track(ideal.truth.time, track.lat, track.lon, track.height, track.v_n, track.q_nb)
            floor[coning, rate] = np.linalg.norm(track.minus(ideal.truth).position, axis=1).max()
    for coning in ("none", "one", "two", "three", "pair"):
        assert floor[coning, 25.0] > floor[coning, 100.0] > floor[coning, 400.0]
    assert floor["three", 100.0] < floor["two", 100.0] < floor["one", 100.0] < floor["none", 100.0]
    assert floor["three", 100.0] < 1e-4
    assert floor["three", 400.0] < 2e-6
