"""The simulated mission is one consistent motion: its rates and forces are the derivatives of what it shows."""

import tracemalloc

import numpy as np
import pytest

from schuler.ground import earth, frames
from schuler.ground.errors import InputError, StudyError
from schuler.truth.instruments import AttitudeSensor, Dvl, Magnetometer
from schuler.truth.keys import mission_from_keys
from schuler.truth.missions import PRESETS, AuvMission, Change, Waves
from schuler.truth.recording import SUITES, SensorSuite, join, simulate, stream

DEG = np.pi / 180.0
TEST_1 = PRESETS["paper-test-1"]
BUSY = AuvMission(
    surface=40.0, dive=200.0, dives=2, between=30.0, final_surface=20.0, l_shape=True,
    turns=(Change(80.0, 15.0, 1.2),), speed_steps=(Change(100.0, 5.0, -0.5),), current=(0.2, -0.1), current_std=0.1,
    current_walk=0.01, current_shear=0.004, height=0.0,
)  # fmt: skip


def test_body_rate_is_the_derivative_of_attitude_plus_earth_and_transport_rate():
    e = 1e-3
    t = np.linspace(3.0, 500.0, 60)
    s = BUSY.state(np.sort(np.concatenate([t - e, t, t + e])), seed=4)
    C = frames.dcm_from_euler(s.roll, s.pitch, s.heading)
    skew = np.einsum("kji,kjl->kil", C[1::3], (C[2::3] - C[0::3]) / (2.0 * e))
    w_nb = np.column_stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]])
    lat, h, v = s.lat[1::3], s.height[1::3], s.v_n[1::3]
    w_in = earth.earth_rate_n(lat) + earth.transport_rate_n(lat, h, v)
    expected = w_nb + np.einsum("kji,kj->ki", C[1::3], w_in)
    np.testing.assert_allclose(s.w_ib_b[1::3], expected, atol=2e-7)
    assert np.abs(w_nb).max() > 0.05  # the sea does move the vehicle: 2e-7 is not the size of the signal


def test_specific_force_is_acceleration_with_coriolis_less_gravity():
    e = 1e-3
    t = np.linspace(3.0, 500.0, 60)
    s = BUSY.state(np.sort(np.concatenate([t - e, t, t + e])), seed=4)
    a_n = (s.v_n[2::3] - s.v_n[0::3]) / (2.0 * e)
    lat, h, v = s.lat[1::3], s.height[1::3], s.v_n[1::3]
    w = 2.0 * earth.earth_rate_n(lat) + earth.transport_rate_n(lat, h, v)
    g_n = np.column_stack([np.zeros_like(lat), np.zeros_like(lat), earth.gravity(lat, h)])
    C = frames.dcm_from_euler(s.roll, s.pitch, s.heading)[1::3]
    expected = np.einsum("kji,kj->ki", C, a_n + np.cross(w, v) - g_n)
    np.testing.assert_allclose(s.f_b[1::3], expected, atol=1e-6)


def test_velocity_is_the_derivative_of_position():
    e = 0.01
    t = np.linspace(3.0, 500.0, 60)
    s = BUSY.state(np.sort(np.concatenate([t - e, t + e])), seed=4)
    lat, h = 0.5 * (s.lat[0::2] + s.lat[1::2]), 0.5 * (s.height[0::2] + s.height[1::2])
    R_N, R_E = earth.radii(lat)
    v = np.column_stack([
        (R_N + h) * np.diff(s.lat)[0::2], (R_E + h) * np.cos(lat) * np.diff(s.lon)[0::2], -np.diff(s.height)[0::2]
    ]) / (2.0 * e)  # fmt: skip
    np.testing.assert_allclose(v, BUSY.state(t, seed=4).v_n, atol=3e-5)  # e^2 v'' / 6


def test_position_does_not_depend_on_the_rate_of_its_quadrature():
    t = np.array([100.0, 300.0, 555.5])
    coarse, fine = (TEST_1.state(t, rate_hz=rate) for rate in (100.0, 400.0))
    np.testing.assert_allclose(coarse.lat, fine.lat, atol=1e-15)
    np.testing.assert_allclose(coarse.lon, fine.lon, atol=1e-15)
    np.testing.assert_allclose(coarse.height, fine.height, atol=1e-9)


def test_integrating_the_imu_means_gives_attitude_and_velocity_back():
    s = TEST_1.realise(seed=2).cursor().advance(6000)
    dt = 0.01
    dtheta = s.mean[:, :3] * dt
    coning = dtheta.copy()
    coning[1:] += np.cross(dtheta[:-1], dtheta[1:]) / 12.0
    C = frames.dcm_from_euler(s.roll[0], s.pitch[0], s.heading[0])
    v = s.v_n[0].copy()
    w_in = earth.earth_rate_n(s.lat) + earth.transport_rate_n(s.lat, s.height, s.v_n)
    w_co = earth.earth_rate_n(s.lat) + w_in
    g = earth.gravity(s.lat, s.height)
    for k in range(6000):
        turn = frames.dcm_from_rotvec(coning[k])
        half = 0.5 * (np.eye(3) + turn)
        dv = C @ (half @ s.mean[k, 3:]) * dt  # rotates within the interval to first order: enough for the tolerance
        v += dv + dt * (np.array([0.0, 0.0, g[k]]) - np.cross(w_co[k], s.v_n[k]))
        C = frames.dcm_from_rotvec(-w_in[k] * dt) @ C @ turn
    expected = frames.dcm_from_euler(s.roll[-1], s.pitch[-1], s.heading[-1])
    assert np.abs(C - expected).max() < 1e-7
    assert np.abs(v - s.v_n[-1]).max() < 2e-4


@pytest.mark.parametrize("at", [100.0, 110.0, 115.0, 155.0, 165.0, 200.0, 205.0, 220.0, 240.0, 555.0, 610.0, 620.0])
def test_jerk_and_angular_acceleration_do_not_jump_where_steps_begin_and_end(at):
    e = 1e-3
    m = TEST_1.with_changes(final_surface=60.0)
    s = m.state(at + np.array([-e, 0.0, e]), seed=1)
    jump_f = np.abs(s.f_b[2] - 2.0 * s.f_b[1] + s.f_b[0]) / e
    jump_w = np.abs(s.w_ib_b[2] - 2.0 * s.w_ib_b[1] + s.w_ib_b[0]) / e
    # A cubic step would jump by 0.12 m/s^3 (speed) and 0.012 rad/s^2 (turn).
    assert jump_f.max() < 5e-3
    assert jump_w.max() < 1e-3


def test_pieces_are_the_whole_bit_for_bit():
    m = BUSY.with_changes(dives=1, final_surface=10.0)
    suite = SensorSuite(
        dvl=Dvl(), magnetometer=Magnetometer(), attitude=AttitudeSensor(), antenna_frd=(0.2, 0.0, -0.6),
        dvl_frd=(-0.3, 0.1, 0.2),
    )  # fmt: skip
    whole = simulate(m, suite, seed=3, run=2)
    for chunk_s in (0.37, 60.0):
        pieces = join(list(stream(m, suite, seed=3, run=2, chunk_s=chunk_s)))
        assert pieces.tables.keys() == whole.tables.keys()
        for name, table in [*whole.tables.items(), ("reference", whole.truth)]:
            other = pieces.truth if name == "reference" else pieces.tables[name]
            for column in table.columns:
                assert np.array_equal(table[column], other[column]), (name, column)
        for name, (time, value) in whole.truth_states.items():
            assert np.array_equal(time, pieces.truth_states[name][0]), name
            assert np.array_equal(value, pieces.truth_states[name][1]), name


def test_state_anywhere_is_the_walk_through_the_mission():
    s = BUSY.realise(5, 1).cursor().advance(5000)
    np.testing.assert_array_equal(BUSY.state(s.time, 5, 1).grid, s.grid)
    assert s.mean.shape == (5000, 6)


@pytest.mark.slow
def test_a_day_streams_with_flat_memory():
    m = AuvMission(surface=60.0, dives=149, between=60.0, current_walk=0.001)
    assert m.duration > 86_000.0
    suite = SensorSuite(imu_rate_hz=20.0)
    tracemalloc.start()
    peaks = []
    height = []
    for piece in stream(m, suite, chunk_s=60.0):
        height.append(piece.truth["height"][-1])
        if len(height) % 500 == 0:
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.reset_peak()
    tracemalloc.stop()
    assert max(peaks) < 1.2 * peaks[0]
    assert -20.0 < min(height) and max(height) < 0.4


# --- the set-up of the paper's tests, as the design describes it ---------------------------------------------------


def test_legs_and_dives_of_the_two_tests():
    assert TEST_1.duration == 620.0
    assert PRESETS["paper-test-2"].duration == 585.0
    np.testing.assert_array_equal(PRESETS["paper-test-2"].dive_intervals, [[62.0, 585.0]])
    for name, fixes in (("paper-test-1", 100), ("paper-test-2", 62)):
        r = simulate(PRESETS[name], SUITES[name])
        np.testing.assert_array_equal(r.tables["gnss"].time, np.arange(1.0, fixes + 1.0))
        assert len(r.tables["imu"]) == round(PRESETS[name].duration * 100.0)
        assert r.tables["imu"].time[0] == 0.01
        assert r.truth.time[0] == 0.0 and r.truth.time[-1] == PRESETS[name].duration


def test_turns_pitch_and_speed_of_the_dive():
    s = TEST_1.with_changes(waves=Waves.none(), final_surface=60.0)
    at = lambda *t: s.state(100.0 + np.array(t))  # noqa: E731  seconds into the dive
    np.testing.assert_allclose(at(0, 119, 140, 269, 290, 399, 420).heading / DEG, [90, 90, 60, 60, 105, 105, 85])
    np.testing.assert_allclose(at(130).heading / DEG, 75.0)  # half-way through the first turn
    np.testing.assert_allclose(at(0, 10, 55, 65, 455, 465, 510, 520).pitch / DEG, [0, -8, -8, 0, 0, 8, 8, 0], atol=1e-9)
    speeds = at(0, 10, 100, 105, 180, 185, 300, 305, 380, 385, 520, 530).speed
    np.testing.assert_allclose(speeds, [2.0, 2.5, 2.5, 2.0, 2.0, 2.5, 2.5, 2.0, 2.0, 2.5, 2.5, 2.0])
    assert -at(200.0).height[0] == pytest.approx(19.0, abs=0.3)
    np.testing.assert_allclose(at(530.0, 570.0).height, 0.0, atol=1e-9)  # up again exactly


def test_waves_have_their_sizes_and_fade_in_the_dive():
    m = TEST_1.with_changes(final_surface=60.0, turns=(), pitch=0.0, surface=600.0, dive=600.0)
    s = m.realise().cursor().advance(10**9)

    def spread(x: np.ndarray, a: float, b: float) -> float:
        return float(np.std(x[(s.time >= a) & (s.time < b)]))

    roll = np.sqrt((3.0**2 + 1.5**2 + 0.2**2) / 2.0) * DEG
    assert spread(s.roll, 0, 600) == pytest.approx(roll, rel=0.01)
    assert spread(s.pitch, 0, 600) == pytest.approx(2.0 * DEG / np.sqrt(2.0), rel=0.01)
    assert spread(s.heading, 0, 600) == pytest.approx(np.hypot(1.5, 0.7) * DEG / np.sqrt(2.0), rel=0.02)
    dived = np.sqrt((0.06 * 3.0) ** 2 + (0.06 * 1.5) ** 2 + 0.2**2) / np.sqrt(2.0) * DEG
    assert spread(s.roll, 625, 1175) == pytest.approx(dived, rel=0.02)
    still = m.with_changes(waves=Waves.of(0.0, 0.0, 0.1))
    v = still.realise().cursor().advance(60_000).v_n - still.with_changes(waves=Waves.of(0, 0, 0)).state(
        np.arange(60_001) / 100.0
    ).v_n  # fmt: skip
    np.testing.assert_allclose(v.std(axis=0), 0.1 / np.sqrt(2.0), rtol=0.01)
    assert abs(np.mean(v[:, 0] * v[:, 2])) < 1e-4  # down is in quadrature with north


def test_phases_differ_between_runs_and_not_between_calls():
    a, b = (TEST_1.state(np.array([10.0]), seed=0, run=run).roll[0] for run in (0, 1))
    assert a != b
    assert TEST_1.state(np.array([10.0]), seed=0, run=1).roll[0] == b


# --- generic missions -----------------------------------------------------------------------------------------------


def test_current_is_constant_plus_shear_plus_walk():
    m = TEST_1.with_changes(current=(0.3, -0.4), current_shear=0.01, waves=Waves.none())
    s = m.state(np.array([50.0, 300.0]))
    np.testing.assert_allclose(s.current[0], [0.3, -0.4], atol=1e-9)
    depth = -s.height[1]
    np.testing.assert_allclose(s.current[1], [0.3 + 0.006 * depth, -0.4 - 0.008 * depth], atol=1e-9)
    walker = AuvMission(dives=0, surface=600.0, current_walk=0.01, waves=Waves.none())
    ends = np.array([walker.state(np.array([600.0]), 1, run, 1.0).current[0] for run in range(300)])
    assert ends.std() == pytest.approx(0.01 * np.sqrt(600.0), rel=0.1)


def test_drawn_current_and_speed_scale_have_their_sigma():
    m = AuvMission(dives=0, surface=1.0, current_std=0.25, speed_scale=0.02, speed_scale_std=0.01)
    runs = [m.realise(7, run) for run in range(400)]
    current = np.array([r.current[:2] for r in runs])
    scale = np.array([r.speed_scale for r in runs])
    assert current.std() == pytest.approx(0.25, rel=0.1)
    assert scale.std() == pytest.approx(0.01, rel=0.12)
    assert scale.mean() == pytest.approx(0.02, abs=0.002)


def test_l_shape_turns_right_and_back_before_each_dive():
    m = mission_from_keys({"l_shape": True, "dives": 2, "surface_s": 100.0, "turns_deg": [], "final_surface_s": 5.0})
    m = m.with_changes(waves=Waves.none())
    second = 100.0 + 520.0
    heading = m.state(np.array([29.0, 51.0, 79.0, 100.0, second + 29.0, second + 65.0, second + 100.0])).heading / DEG
    np.testing.assert_allclose(heading, [90.0, 180.0, 180.0, 90.0, 90.0, 180.0, 90.0])


def test_generic_dives_reach_their_depth_and_come_up():
    keys = {"dive_s": 900, "depth_m": 60, "pitch_deg": 15, "turns_deg": [10, 20], "dives": 3, "surface_s": 60}
    m = mission_from_keys(keys | {"final_surface_s": 30, "speed_mps": 1.5}).with_changes(waves=Waves.none())
    s = m.realise().cursor().advance(10**9)
    assert s.height.min() == pytest.approx(-60.0, abs=1e-3)
    assert abs(s.height[-1]) < 1e-6
    assert s.heading[-1] / DEG == pytest.approx(90.0 + 3 * 30.0)
    assert s.speed.max() == pytest.approx(1.5)
    assert np.count_nonzero(np.diff(m.surfaced(s.time).astype(int)) == -1) == 3


def test_keys_of_the_presets_are_the_presets():
    for name, m in PRESETS.items():
        assert mission_from_keys({"preset": name}) == m
    assert mission_from_keys({"preset": "demo", "current_east_mps": 0.5}).current == (0.12, 0.5)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"preset": "demmo"}, ["preset", "'demo'"]),
        ({"depht_m": 3}, ["depht_m", "known keys"]),
        ({"dive_s": -1, "current_north_mps": float("nan")}, ["dive_s", "current_north_mps"]),
        ({"dive_s": 60}, ["too short", "155 s"]),
        ({"dives": 1.5}, ["whole number"]),
        ({"depth_m": 10, "pitch_deg": 0}, ["pitch_deg"]),
        ({"turns_deg": 30}, ["turns_deg", "list"]),
        ({"dives": 2, "between_surface_s": 4}, ["overlap", "more seconds"]),
        ({"surface_s": 0, "dives": 0}, ["must last"]),
        ({"l_shape": "yes"}, ["true or false"]),
    ],
)
def test_faults_of_the_mission_section(keys, said):
    with pytest.raises(StudyError) as error:
        mission_from_keys(keys)
    for word in said:
        assert word in str(error.value)


def test_times_out_of_order_are_refused():
    with pytest.raises(InputError, match="rising order"):
        TEST_1.state(np.array([2.0, 1.0]))
