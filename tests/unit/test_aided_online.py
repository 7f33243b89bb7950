"""The aided filter fed row by row: the batch filter's bits, late and early measurements, restarts, the fixed lag."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from schuler.aiding.aided import Start, navigate, settled
from schuler.aiding.aided_aids import CODES, OWN, Aid, aids_of
from schuler.aiding.aided_online import _INNER_NAMES, AidedFilter
from schuler.aiding.aided_rows import imu_rows, sensors_present
from schuler.aiding.aided_sensors import Sensor
from schuler.aiding.aided_settings import AidedSettings
from schuler.aiding.aided_window import lag_bytes
from schuler.ground.earth import WGS84
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler
from schuler.kernels.aided_state import NOMINAL
from schuler.truth import manoeuvres
from schuler.truth.aided import AidedRecording, AidedSuite, simulate
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0
STD = (1.0, 1.0, 2.0, 0.1, 0.1, 0.1, 0.5 * D, 0.5 * D, 2.0 * D)
IMU = ImuModel(
    gyro_arw_deg_per_sqrt_h=0.2, accel_vrw_mps_per_sqrt_h=0.1, gyro_bias_deg_per_h=20.0, accel_bias_ug=1000.0
)  # fmt: skip


@cache
def drive(seconds: float = 40.0, run: int = 0) -> AidedRecording:
    path = manoeuvres.car(50.0 * D, 30.0 * D, -20.0, stand=5.0, duration=seconds)
    suite = AidedSuite(
        start_std=STD, gnss_hz=2.0, speed_hz=10.0, speed_scale_std=0.01, dvl_hz=1.0, height_hz=2.0, ranges_hz=1.0,
        gnss_delay=0.083,
    )  # fmt: skip
    return simulate(path, IMU, suite, 100.0, seed=5, run=run)


def settings_of(recording: AidedRecording, **more: object) -> AidedSettings:
    a = recording.start
    start = Start(
        time=a.time, lat=a.lat, lon=a.lon, height=a.height, v_n=tuple(map(float, a.v_n)), roll=float(a.rpy[0]),
        pitch=float(a.rpy[1]), heading=float(a.rpy[2]), std_pos=STD[:3], std_vel=STD[3:6], std_roll=STD[6],
        std_pitch=STD[7], std_heading=STD[8],
    )  # fmt: skip
    s = AidedSettings(
        start=start, gyro_arw=(0.2 * D / 60.0,) * 3, accel_vrw=(0.1 / 60.0,) * 3,
        gyro_bias_std=(20.0 * D / 3600.0,) * 3, accel_bias_std=(0.01,) * 3, gyro_walk=1e-7, accel_walk=1e-6,
        gnss_correlated_std=0.0, gnss_delay=0.083, constraints=("nhc",), output_rate=math.inf,
    )  # fmt: skip
    return settled(recording.tables, replace(s, **more))[0]  # type: ignore[arg-type]


def made(recording: AidedRecording, s: AidedSettings, **more: object) -> AidedFilter:
    return AidedFilter(s, sensors=sensors_present(recording.tables) - {"landmarks"}, **more)  # type: ignore[arg-type]


def feed(nav: AidedFilter, rows: np.ndarray, queue: list[tuple[float, Aid]]) -> AidedFilter:
    """Rows, and each measurement at its arrival."""
    k = 0
    for row in rows:
        nav.predict(row)
        while k < len(queue) and queue[k][0] <= row[0]:
            assert nav.update(queue[k][1])
            k += 1
    return nav


def in_order(recording: AidedRecording, s: AidedSettings) -> list[tuple[float, Aid]]:
    return [(a.time, a) for a in aids_of(recording.tables, s)]


def same(a: AidedFilter, b: AidedFilter) -> bool:
    n = slice(0, NOMINAL)
    return bool(np.array_equal(a.engine.x[n], b.engine.x[n]) and np.array_equal(a.covariance, b.covariance))


def test_places_are_the_kernels() -> None:
    from schuler.kernels import aided_measure as m
    from schuler.kernels import aided_run as r

    names = {"position": "POSITION", "dvl": "BOTTOM_TRACK"}
    for kind, (code, _) in CODES.items():
        assert code == getattr(m, names.get(kind, kind.upper())), kind
    assert r.USER == OWN and r.ZW == 12
    assert set(_INNER_NAMES) == {m.NONHOLONOMIC, m.STANDING_V, m.STANDING_W}


def test_the_batch_filters_bits_and_innovations() -> None:
    recording = drive()
    s = settings_of(recording)
    batch = navigate(recording.tables, s)
    nav = feed(made(recording, s), imu_rows(recording.tables["imu"]), in_order(recording, s))
    assert nav.started and nav.time == batch.filter.time[-1]
    assert (nav.lat, nav.lon, nav.height) == (batch.filter.lat[-1], batch.filter.lon[-1], batch.filter.height[-1])
    assert np.array_equal(nav.v_n, batch.filter.v_n[-1])
    assert np.allclose(nav.rpy, batch.filter.rpy[-1], atol=1e-12)
    sigma = nav.sigmas()
    assert [sigma[n] for n in ("north", "east", "down")] == np.sqrt(np.diag(batch.filter.cov_pos[-1])).tolist()
    assert sigma["heading"] == math.sqrt(batch.filter.cov_rpy[-1, 2, 2])
    for name, kept in batch.innovations.items():
        last = nav.innovations[name]
        assert last.time == kept.time[-1] and np.array_equal(last.value, kept.value[-1]), name
        assert last.nis == kept.nis[-1], name


def test_measurements_as_they_come_are_the_tables_rows() -> None:
    """Sigmas filled in, the slow part taken out, and what comes too often thinned: as the batch filter does."""
    recording = drive()
    s = replace(settings_of(recording), gnss_correlated_std=0.5, estimate=("gyro_bias", "accel_bias", "gnss_bias"))
    t = recording.tables
    g, v, h = t["gnss"], t["speed"], t["height"]
    raw: list[Aid] = []
    for i, time in enumerate(g.time):
        std = tuple(float(g[f"std_{a}"][i]) for a in ("north", "east", "down")) if "std_north" in g else None
        place = (float(g[name][i]) for name in ("lat", "lon", "height"))
        raw.append(Aid.position(float(time), *place, std=std))  # type: ignore[arg-type]
        vstd = tuple(float(g[f"std_v_{a}"][i]) for a in ("north", "east", "down")) if "std_v_north" in g else None
        v_n = [float(g[f"v_{a}"][i]) for a in ("north", "east", "down")]
        raw.append(Aid.velocity(float(time), v_n, std=vstd))  # type: ignore[arg-type]
    raw += [Aid.speed(float(a), float(b)) for a, b in zip(v.time, v["speed"], strict=True)]
    raw += [Aid.height(float(a), float(b)) for a, b in zip(h.time, h["height"], strict=True)]
    tables = {k: t[k] for k in ("imu", "gnss", "speed", "height")}
    rows = imu_rows(t["imu"])[:2000]
    sensors = ("gnss", "speed", "height")
    one = feed(AidedFilter(s, sensors=sensors), rows, [(a.time, a) for a in aids_of(tables, s)])
    two = feed(AidedFilter(s, sensors=sensors), rows, sorted(((a.time, a) for a in raw), key=lambda q: q[0]))
    assert same(one, two)


@pytest.mark.parametrize("late_s", [0.35, 3.7])
def test_late_and_out_of_order_is_as_good_as_in_order(late_s: float) -> None:
    recording = drive()
    s = settings_of(recording)
    rows = imu_rows(recording.tables["imu"])
    straight = feed(made(recording, s, lag_s=2.0), rows, in_order(recording, s))
    queue = in_order(recording, s)
    dice = np.random.default_rng(3)
    delay = {(a.time, a.kind): dice.uniform(-0.2, late_s) for _, a in queue}  # ranges of one moment come together
    shuffled = [(min(t + delay[t, a.kind], float(rows[-1, 0])), a) for t, a in queue]
    shuffled.sort(key=lambda q: q[0])
    assert [a for _, a in shuffled] != [a for _, a in queue]
    tardy = feed(made(recording, s, lag_s=2.0), rows, shuffled)
    assert same(straight, tardy)
    assert np.allclose(straight.smoothed().cov_pos, tardy.smoothed().cov_pos, rtol=1e-9)


def test_too_late_is_refused_and_changes_nothing() -> None:
    recording = drive()
    s = settings_of(recording)
    rows = imu_rows(recording.tables["imu"])
    nav = feed(made(recording, s, late_s=2.0), rows[:1500], in_order(recording, s))
    before = nav.save()
    fix = Aid.position(nav.time - 2.5, nav.lat, nav.lon, nav.height)
    assert nav.update(fix) is False
    assert nav.update(replace(fix, time=-1.0)) is False
    assert nav.save() == before
    assert nav.update(replace(fix, time=nav.time - 1.5)) is True
    assert len(nav._rows) < 350 and len(nav._marks) <= 4


def test_saved_and_loaded_it_goes_on_as_if_nothing_had_been() -> None:
    recording = drive()
    s = settings_of(recording)
    rows, queue = imu_rows(recording.tables["imu"]), in_order(recording, s)
    nav = feed(made(recording, s, lag_s=1.0), rows[:1234], queue)
    blob = nav.save()
    again = AidedFilter.load(blob)
    assert again.save() == blob
    rest = [q for q in queue if q[0] > rows[1233, 0]]
    feed(nav, rows[1234:], rest)
    feed(again, rows[1234:], rest)
    assert nav.save() == again.save()
    assert np.array_equal(nav.smoothed().lat, again.smoothed().lat)
    waiting = made(recording, replace(s, start=Start()))
    waiting.update(queue[0][1])
    assert AidedFilter.load(waiting.save()).save() == waiting.save()
    for spoilt in (blob[:-8], blob[:200] + b"x" + blob[201:], b"", b"SCHULER-AUV-1\n" + blob[16:]):
        with pytest.raises(InputError, match=r"not a saved aided filter"):
            AidedFilter.load(spoilt)


def test_a_sensor_of_ones_own() -> None:
    recording = drive()
    s = settings_of(recording)

    def measure(state, z):  # type: ignore[no-untyped-def]
        H = np.zeros((1, state.n))
        H[0, state.at("position")][2] = -1.0
        return [state.height], H

    time = np.arange(1.0, 30.0, 1.0)
    radar = Sensor("radar", ("up",), "m", time, np.full(len(time), 3.0), 0.5, measure)
    batch = navigate(recording.tables, s, sensors=[radar])
    rows = imu_rows(recording.tables["imu"])
    own = [replace(radar, time=np.zeros(0), z=np.zeros(0))]
    queue = sorted([*in_order(recording, s), *((t, Aid.own("radar", t, [3.0])) for t in time)], key=lambda q: q[0])
    nav = feed(made(recording, s, own=own), rows, queue)
    assert nav.lat == batch.filter.lat[-1] and nav.height == batch.filter.height[-1]
    assert nav.innovations["radar"].nis == batch.innovations["radar"].nis[-1]
    with pytest.raises(InputError, match=r"sensor radar; give it in own"):
        AidedFilter.load(nav.save())
    assert AidedFilter.load(nav.save(), own=own).lat == nav.lat


def test_fixed_lag_over_the_whole_recording_is_the_smoother() -> None:
    recording = drive()
    s = settings_of(recording)
    batch = navigate(recording.tables, s).smoother
    assert batch is not None
    nav = feed(made(recording, s, lag_s=1000.0), imu_rows(recording.tables["imu"]), in_order(recording, s))
    track = nav.smoothed_track()
    at = np.searchsorted(batch.time, track.time - 1e-9)
    on = np.abs(batch.time[at.clip(0, len(batch.time) - 1)] - track.time) < 1e-9
    assert on.sum() > 300
    at = at[on]
    assert np.allclose(track.lat[on], batch.lat[at], rtol=0.0, atol=1e-13)
    assert np.allclose(track.v_n[on], batch.v_n[at], rtol=0.0, atol=1e-8)
    assert np.allclose(track.cov_pos[on], batch.cov_pos[at], rtol=1e-6, atol=1e-12)
    first = nav.smoothed()
    assert len(first) == 1 and first.time[0] == track.time[0]


def test_fixed_lag_is_kept_in_bounded_memory() -> None:
    recording = drive()
    s = settings_of(recording)
    nav = made(recording, s, lag_s=2.0)
    rows, queue = imu_rows(recording.tables["imu"]), in_order(recording, s)
    most, k = 0, 0
    for row in rows:
        nav.predict(row)
        while k < len(queue) and queue[k][0] <= row[0]:
            nav.update(queue[k][1])
            k += 1
        kept = nav.engine.kept
        most = max(most, sum(a.nbytes for a in (*kept.nodes, kept.node_time, kept.node_std)))
    epochs = len({a.time for _, a in queue}) / (rows[-1, 0] - rows[0, 0])
    assert most < lag_bytes(nav.engine.layout.n, 2.0, epochs, s)
    got = nav.smoothed()
    assert 1.7 < nav.time - got.time[0] < 2.3


def test_reading_the_smoother_changes_nothing() -> None:
    recording = drive()
    s = settings_of(recording)
    nav = feed(made(recording, s, lag_s=3.0), imu_rows(recording.tables["imu"])[:1000], in_order(recording, s))
    before = nav.save()
    nav.smoothed()
    nav.smoothed_track()
    nav.sigmas()
    assert nav.save() == before


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda nav: nav.predict(np.array([1.0, 2.0])), "expected 7 finite numbers"),
        (lambda nav: nav.predict(np.array([1.0, 0, 0, math.nan, 0, 0, 0])), "expected 7 finite numbers"),
        (lambda nav: nav.update(Aid.position(math.nan, 0.0, 0.0)), "expected finite numbers"),
        (lambda nav: nav.update(Aid.position(1.0, math.nan, 0.0)), "expected finite numbers"),
        (lambda nav: nav.update(Aid.depth(1.0, 3.0, std=-1.0)), "sigmas above 0"),
        (lambda nav: nav.update(Aid.depth(1.0, 3.0)), 'name "depth" in sensors'),
        (lambda nav: nav.update(Aid.own("sonar", 1.0, [3.0])), "there is no sensor sonar"),
        (lambda nav: nav.smoothed(), "make it with lag_s"),
    ],
)
def test_bad_input(call, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=words):
        call(AidedFilter(sensors=("gnss",)))


def test_an_unknown_sensor_is_named() -> None:
    with pytest.raises(InputError, match=r"no sensor gps"):
        AidedFilter(sensors=("gps",))


def errors(nav: AidedFilter, recording: AidedRecording) -> np.ndarray:
    """(9,) phi, velocity, position: estimate - truth, at the reference's row of now."""
    ref = recording.reference
    i = int(np.argmin(np.abs(ref.time - nav.time)))
    assert abs(ref.time[i] - nav.time) < 1e-6
    d = WGS84.displacement_n(nav.lat, nav.lon, nav.height, ref["lat"][i], ref["lon"][i], ref["height"][i])
    M = dcm_from_euler(*nav.rpy) @ dcm_from_euler(ref["roll"][i], ref["pitch"][i], ref["heading"][i]).T
    phi = 0.5 * np.array([M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]])
    return np.concatenate([phi, nav.v_n - ref.stack("v_north", "v_east", "v_down")[i], d])


@pytest.mark.slow
@pytest.mark.parametrize("gap", [2.0, 8.0, 40.0])
def test_a_gap_leaves_it_finite_and_honest(gap: float) -> None:
    """Over 10 s the attitude is lost and found again; the parameters learnt are kept."""
    found = []
    for run in range(6):
        recording = drive(120.0, run)
        s = settings_of(recording)
        rows, t0 = imu_rows(recording.tables["imu"]), 30.0
        rows = rows[(rows[:, 0] <= t0) | (rows[:, 0] > t0 + gap)]
        nav = made(recording, s)
        for k, (_, part) in enumerate(
            (("before", rows[:, 0] <= t0 + gap + 20.0), ("after", rows[:, 0] > t0 + gap + 20.0))
        ):
            a, b = rows[part][0, 0], rows[part][-1, 0]
            feed(nav, rows[part], [q for q in in_order(recording, s) if (k == 0 or a <= q[0]) and q[0] <= b])
            assert nav.started and nav.lost == (gap > 10.0)
            e = errors(nav, recording)
            found.append(e @ np.linalg.solve(nav.covariance[:9, :9], e))
            assert math.hypot(*e[6:8]) < 4.0
    assert np.mean(found) < chi2.ppf(0.999, 9 * 6) / 6
