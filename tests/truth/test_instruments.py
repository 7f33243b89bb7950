"""Each simulated sensor errs as its datasheet says: size, colour, draw, and independence of all others."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.ground import earth, frames, units
from schuler.ground.errors import InputError, StudyError
from schuler.truth.instruments import (
    CS4500,
    GARMIN_16_HVS,
    IMUS,
    PAPER_IMU,
    AttitudeSensor,
    DepthSensor,
    Dvl,
    GnssModel,
    ImuModel,
    Magnetometer,
    SpeedLog,
)
from schuler.truth.keys import imu_from_keys, suite_from_keys
from schuler.truth.missions import PRESETS, AuvMission, Waves
from schuler.truth.recording import SUITES, Recording, SensorSuite, simulate
from schuler.truth.sensors import Walk
from schuler.truth.streams import stream

DEG = np.pi / 180.0
GYROS = ("gyro_x", "gyro_y", "gyro_z")
ACCELS = ("accel_x", "accel_y", "accel_z")
BARE = SensorSuite(imu=ImuModel(), gnss=None, speed=None, depth=None)
STILL = AuvMission(dives=0, surface=300.0, surface_speed=0.0, waves=Waves.none())
ROUGH = AuvMission(dives=0, surface=60.0)


def imu(r: Recording) -> np.ndarray:
    return r.tables["imu"].stack(*GYROS, *ACCELS)


def imu_errors(model: ImuModel, mission: AuvMission = STILL, **how: int) -> np.ndarray:
    """(n, 6) what an IMU adds to the truth of the same run."""
    return imu(simulate(mission, BARE.with_changes(imu=model), **how)) - imu(simulate(mission, BARE, **how))


# --- random streams ---------------------------------------------------------------------------------------------------


def test_streams_repeat_and_differ_by_seed_run_and_name():
    draw = lambda *key: stream(*key).standard_normal(4)  # noqa: E731
    np.testing.assert_array_equal(draw(1, 2, "a"), draw(1, 2, "a"))
    others = [draw(1, 2, "b"), draw(1, 3, "a"), draw(2, 2, "a"), draw(2, 1, "a")]
    assert all(not np.array_equal(draw(1, 2, "a"), other) for other in others)


def test_streams_are_independent():
    n = 4000
    x = np.array([stream(0, run, name).standard_normal(n) for run in range(4) for name in ("a", "b", "c")])
    correlation = np.corrcoef(x)[np.triu_indices(12, 1)]
    assert np.abs(correlation).max() < 5.0 / np.sqrt(n)


def test_negative_seed_is_refused():
    with pytest.raises(InputError, match="must not be negative"):
        stream(-1, 0, "a")


def test_another_sensor_changes_no_numbers():
    m = ROUGH.with_changes(surface=20.0)
    few = simulate(m, SensorSuite(depth=None), seed=1)
    many = simulate(m, SensorSuite(dvl=Dvl(), magnetometer=Magnetometer(), attitude=AttitudeSensor()), seed=1)
    for name, table in few.tables.items():
        for column in table.columns:
            assert np.array_equal(table[column], many.tables[name][column]), (name, column)


def test_being_under_water_changes_no_numbers_of_the_next_surface_leg():
    m = AuvMission(surface=10.0, dive=140.0, dives=1, final_surface=20.0, turns=(), speed_steps=())
    dry = m.with_changes(dives=0, surface=170.0)
    wet_fix, dry_fix = (simulate(x, SensorSuite(imu=None, speed=None), seed=1) for x in (m, dry))
    shared = np.isin(dry_fix.tables["gnss"].time, wet_fix.tables["gnss"].time)
    down = [r.tables["gnss"]["height"] - r.truth["height"][10 * r.tables["gnss"].time.astype(int)]
            for r in (wet_fix, dry_fix)]  # fmt: skip
    np.testing.assert_allclose(down[0], down[1][shared], atol=1e-9)
    assert len(down[0]) == 30


# --- the IMU ----------------------------------------------------------------------------------------------------------


def test_a_perfect_imu_is_the_truth():
    r = simulate(ROUGH, BARE)
    s = ROUGH.realise().cursor().advance(6000)
    np.testing.assert_array_equal(imu(r), s.mean)
    still = simulate(STILL.with_changes(heading=0.0), BARE)
    g = earth.gravity(STILL.lat, 0.0)
    np.testing.assert_allclose(imu(still)[:, 3:], np.tile([0.0, 0.0, -g], (30000, 1)), atol=1e-9)
    np.testing.assert_allclose(imu(still)[:, :3], np.tile(earth.earth_rate_n(STILL.lat), (30000, 1)), atol=1e-12)


def allan_deviation(rate: np.ndarray, m: int) -> float:
    """Non-overlapping, of groups of m samples."""
    means = rate[: len(rate) // m * m].reshape(-1, m).mean(axis=1)
    return float(np.sqrt(0.5 * np.mean(np.diff(means) ** 2)))


def test_white_noise_has_its_density_at_every_averaging_time():
    model = ImuModel(gyro_arw_deg_per_sqrt_h=1.8, accel_vrw_mps_per_sqrt_h=(0.02, 0.04, 0.08))
    e = imu_errors(model, STILL.with_changes(surface=600.0))
    assert units.to_si(0.03, "deg/s/sqrt(Hz)") == pytest.approx(model.arw[0])
    np.testing.assert_allclose(e[:, :3].std(axis=0), model.arw * 10.0, rtol=0.02)  # a sample: ARW / sqrt(dt)
    np.testing.assert_allclose(e[:, 3:].std(axis=0), model.vrw * 10.0, rtol=0.02)
    for tau, tolerance in ((0.1, 0.04), (1.0, 0.1), (5.0, 0.25)):
        for i in range(3):
            assert allan_deviation(e[:, i], round(100 * tau)) == pytest.approx(
                model.arw[i] / np.sqrt(tau), rel=tolerance
            )
    assert np.abs(np.corrcoef(e.T)[np.triu_indices(6, 1)]).max() < 5.0 / np.sqrt(len(e))


def test_turn_on_bias_is_drawn_once_a_run_with_its_sigma():
    model = ImuModel(gyro_bias_deg_per_h=720.0, accel_bias_ug=3000.0)
    m = STILL.with_changes(surface=0.02)
    e = np.array([imu_errors(model, m, run=run) for run in range(300)])
    np.testing.assert_allclose(e[:, 0], e[:, 1], atol=1e-12)
    assert e[:, 0, :3].std() == pytest.approx(0.2 * DEG, rel=0.1)
    assert e[:, 0, 3:].std() == pytest.approx(0.003 * 9.80665, rel=0.1)
    assert abs(e[:, 0, :3].mean()) < 4.0 * 0.2 * DEG / 30.0


def test_the_papers_imu_has_its_recorded_bias_in_every_run():
    quiet = replace(PAPER_IMU, gyro_instability_deg_per_h=0.0, gyro_arw_deg_per_sqrt_h=0.0)
    for run in range(3):
        e = imu_errors(quiet, STILL.with_changes(surface=0.02), run=run)
        assert e[0, 2] == pytest.approx(-0.053 * DEG, rel=1e-9)
        assert abs(e[0, 0]) > 1e-6


def test_gauss_markov_bias_is_stationary_from_the_start_and_forgets_with_tau():
    walks = np.array([Walk(stream(0, run, "x"), np.array([2.0]), 10.0, 0.1).advance(400)[:, 0] for run in range(800)])
    spread = walks.std(axis=0)
    assert np.abs(spread / 2.0 - 1.0).max() < 0.13  # 5 sigma of 800 runs
    for lag in (50, 100, 200):
        correlation = np.mean(walks[:, :-lag] * walks[:, lag:]) / 4.0
        assert correlation == pytest.approx(np.exp(-lag / 100.0), abs=0.08)


def test_in_run_bias_is_in_the_output_and_in_the_truth_states():
    model = ImuModel(gyro_instability_deg_per_h=18.0, gyro_tau_s=20.0, accel_rrw_ug_per_sqrt_h=6000.0)
    suite = BARE.with_changes(imu=model)
    r = simulate(STILL, suite, reference_hz=None)
    e = imu(r) - imu(simulate(STILL, BARE))
    for i, name in enumerate([f"{q}_bias_{a}" for q in ("gyro", "accel") for a in "xyz"]):
        time, value = r.truth_states[name]
        np.testing.assert_array_equal(time[1:], r.tables["imu"].time)
        np.testing.assert_allclose(value[1:], e[:, i], atol=1e-12)
    assert r.truth_states["gyro_bias_x"][1].std() > 0.3 * model.gyro_instability[0]


def test_random_walk_grows_with_the_root_of_time():
    sigma = np.array([3.0])
    ends = np.array([Walk(stream(1, run, "w"), sigma, None, 0.01).advance(900)[[99, 899], 0] for run in range(500)])
    np.testing.assert_allclose(ends.std(axis=0), [3.0, 9.0], rtol=0.12)


def test_scale_misalignment_and_g_sensitivity_multiply_the_truth():
    rms = []
    for run in range(60):
        r = simulate(ROUGH.with_changes(surface=1.0), BARE, run=run)
        model = ImuModel(accel_scale_ppm=1000.0, gyro_g_sensitivity_deg_per_h_per_g=100.0)
        e = imu_errors(model, ROUGH.with_changes(surface=1.0), run=run)
        f = imu(r)[:, 3:]
        k = e[:, 5] / f[:, 2]
        assert np.ptp(k) < 1e-9  # one scale
        rms.append((k[0], e[0, 0] / 9.8 / units.DEG_PER_H))
    rms = np.sqrt(np.mean(np.square(rms), axis=0))
    np.testing.assert_allclose(rms, [1e-3, 100.0 / 9.80665], rtol=0.35)
    e = np.array([imu_errors(ImuModel(accel_misalignment_mrad=2.0), STILL.with_changes(surface=0.01), run=run)[0]
                  for run in range(100)])  # fmt: skip
    np.testing.assert_allclose(e[:, 3:5].std(axis=0), 2e-3 * 9.8, rtol=0.3)  # x and y see gravity
    assert np.abs(e[:, 5]).max() < 1e-9 and np.abs(e[:, :3]).max() == 0.0


def test_quantisation_loses_nothing_over_time_and_range_clips():
    model = ImuModel(gyro_quantisation_arcsec=20.0, accel_quantisation_mps=0.01)
    suite = BARE.with_changes(imu=model, imu_kind="increments")
    table = simulate(ROUGH, suite).tables["imu"]
    assert table.kind == "increments"
    truth = imu(simulate(ROUGH, BARE)) / 100.0
    for i, name in enumerate(("dtheta_x", "dtheta_y", "dtheta_z", "dv_x", "dv_y", "dv_z")):
        counts = table[name] / model.quantum[i]
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
        assert np.abs(np.cumsum(table[name] - truth[:, i])).max() <= 0.5 * model.quantum[i] * (1 + 1e-6)
    clipped = imu(simulate(ROUGH, BARE.with_changes(imu=ImuModel(gyro_range_deg_per_s=1.0, accel_range_g=0.5))))
    assert np.abs(clipped[:, :3]).max() == pytest.approx(DEG)
    np.testing.assert_allclose(clipped[:, 5], -0.5 * 9.80665)


def test_bandwidth_damps_the_fast_wave():
    slow = AuvMission(dives=0, surface=100.0, waves=replace(Waves.none(), roll=0.05, roll_period=4.0))
    full, damped = (imu(simulate(slow, BARE.with_changes(imu=ImuModel(bandwidth_hz=b))))[2000:, 0] for b in (0.0, 0.25))
    assert damped.std() / full.std() == pytest.approx(1.0 / np.sqrt(2.0), rel=0.02)


def test_accelerometer_levers_feel_rotation():
    model = ImuModel(accel_x_lever_mm=(50.0, 0.0, 0.0), accel_y_lever_mm=(0.0, 0.0, 30.0))
    m = AuvMission(dives=0, surface=40.0, waves=replace(Waves.none(), roll=0.3, roll_period=2.0, heading=0.3))
    e = imu_errors(model, m)
    s = m.realise(rate_hz=1000.0).cursor().advance(40_000)
    w = s.w_ib_b
    w1 = np.gradient(w, 1e-3, axis=0)
    x = -0.05 * (w[:, 1] ** 2 + w[:, 2] ** 2)
    y = 0.03 * (w[:, 1] * w[:, 2] - w1[:, 0])
    over = lambda a: (0.5 * a[:-1] + 0.5 * a[1:]).reshape(-1, 10).mean(axis=1)  # noqa: E731  mean over 10 ms
    np.testing.assert_allclose(e[1:-1, 3], over(x)[1:-1], atol=2e-6)
    np.testing.assert_allclose(e[1:-1, 4], over(y)[1:-1], atol=2e-6)
    assert np.abs(e[:, 4]).max() > 0.05


def test_mounted_imu_sees_the_body_turned():
    rpy = (0.1, -0.2, 2.0)
    turned = imu(simulate(ROUGH, BARE.with_changes(imu_to_body_rpy=rpy)))
    C_bi = frames.dcm_from_euler(*rpy)
    straight = imu(simulate(ROUGH, BARE))
    np.testing.assert_allclose(turned[:, :3] @ C_bi.T, straight[:, :3], atol=1e-12)
    np.testing.assert_allclose(turned[:, 3:] @ C_bi.T, straight[:, 3:], atol=1e-12)


# --- aids -------------------------------------------------------------------------------------------------------------


def test_gnss_error_is_white_plus_correlated_and_velocity_white():
    m = STILL.with_changes(surface=4000.0)
    suite = SensorSuite(imu=None, speed=None, depth=None, imu_rate_hz=1.0)
    r = simulate(m, suite, reference_hz=1.0)
    fix = r.tables["gnss"]
    north, east, down = earth.WGS84.displacement_n(
        fix["lat"], fix["lon"], fix["height"], r.truth["lat"][1:], r.truth["lon"][1:], r.truth["height"][1:]
    ).T  # fmt: skip
    for error, white, sigma, name in ((north, 1, 2, "north"), (east, 1, 2, "east"), (down, 2, 3, "down")):
        slow = r.truth_states[f"gnss_bias_{name}"][1]
        assert (error - slow).std() == pytest.approx(white, rel=0.06)
        assert slow.std() == pytest.approx(sigma, rel=0.35)  # 4000 s are 40 correlation times
        lag = np.mean(slow[:-100] * slow[100:]) / np.mean(slow**2)
        assert 0.0 < lag < 0.7
        np.testing.assert_allclose(fix[f"std_{name}"], np.hypot(white, sigma))
        assert fix[f"v_{name}"].std() == pytest.approx(0.05, rel=0.06)
        assert fix[f"std_v_{name}"][0] == 0.05


def test_gnss_velocity_sees_the_waves_and_the_antenna_swings():
    quiet = GnssModel(white_m=(0.0, 0.0, 0.0), velocity_mps=0.0)
    suite = SensorSuite(imu=None, speed=None, depth=None, gnss=quiet, antenna_frd=(0.0, 0.0, -0.65))
    r = simulate(ROUGH, suite)
    s = ROUGH.state(r.tables["gnss"].time)
    C = frames.dcm_from_euler(s.roll, s.pitch, s.heading)
    arm = np.array([0.0, 0.0, -0.65])
    fix = r.tables["gnss"]
    moved = earth.WGS84.displacement_n(fix["lat"], fix["lon"], fix["height"], s.lat, s.lon, s.height)
    np.testing.assert_allclose(moved, C @ arm, atol=1e-5)
    w_eb = s.w_ib_b - np.einsum("kji,kj->ki", C, earth.earth_rate_n(s.lat))
    v = s.v_n + np.einsum("kij,kj->ki", C, np.cross(w_eb, arm))
    np.testing.assert_allclose(fix.stack("v_north", "v_east", "v_down"), v, atol=1e-9)
    assert fix["v_north"].std() > 0.05
    reference = simulate(ROUGH, suite.with_changes(reference_frd=(0.0, 0.0, -0.65)), reference_hz=1.0).truth
    for column in ("lat", "lon", "height", "v_north", "v_east", "v_down"):
        np.testing.assert_allclose(reference[column][1:], fix[column], atol=1e-9)


def test_speed_log_reads_scaled_water_speed_with_a_tenth_of_a_knot():
    m = ROUGH.with_changes(surface=3000.0, current=(0.5, 0.5), speed_scale=0.02)
    r = simulate(m, SensorSuite(imu=None, gnss=None, depth=None, imu_rate_hz=1.0))
    error = r.tables["speed"]["speed"] - 2.0 * 1.02  # the current does not show
    assert CS4500.noise == pytest.approx(0.1 * 1852.0 / 3600.0)
    assert error.std() == pytest.approx(CS4500.noise, rel=0.06)
    assert abs(error.mean()) < 4.0 * CS4500.noise / np.sqrt(3000.0)
    assert r.truth_states["speed_scale"][1][0] == 0.02


def test_depth_and_its_bias():
    m = PRESETS["paper-test-1"]
    suite = SensorSuite(imu=None, gnss=None, speed=None, depth=DepthSensor(rate_hz=4.0, noise_m=0.2, bias_m=0.5))
    r = simulate(m, suite, reference_hz=4.0, run=1)
    error = r.tables["depth"]["depth"] + r.truth["height"][1:]
    assert error.std() == pytest.approx(0.2, rel=0.06)
    assert error.mean() == pytest.approx(r.truth_states["depth_bias"][1][0], abs=0.02)
    assert r.truth_states["depth_bias"][1][0] != 0.0


def test_dvl_measures_ground_velocity_in_body_axes():
    m = PRESETS["paper-test-1"].with_changes(current=(0.3, -0.2))
    r = simulate(m, SensorSuite(imu=None, gnss=None, speed=None, dvl=Dvl()), reference_hz=1.0)
    s = m.state(r.tables["dvl"].time)
    C = frames.dcm_from_euler(s.roll, s.pitch, s.heading)
    scale = r.truth_states["dvl_scale"][1][0]
    error = r.tables["dvl"].stack("v_x", "v_y", "v_z") - (1.0 + scale) * np.einsum("kji,kj->ki", C, s.v_n)
    np.testing.assert_allclose(error.std(axis=0), 0.02, rtol=0.12)
    one = AuvMission(dives=0, surface=1.0)
    suite = SensorSuite(imu=None, gnss=None, speed=None, depth=None, dvl=Dvl(), imu_rate_hz=1.0)
    scales = [simulate(one, suite, reference_hz=1.0, run=run).truth_states["dvl_scale"][1][0] for run in range(300)]
    assert np.std(scales) == pytest.approx(0.003, rel=0.12)


def compass(r: Recording) -> np.ndarray:
    """Heading error of a compass levelled with the true attitude and corrected for declination, a row each."""
    t = r.tables["imu"]
    s = r.mission.state(t.time, r.seed, r.run)
    C_level = frames.dcm_from_euler(s.roll, s.pitch, np.zeros_like(s.roll))
    x, y, _ = np.einsum("kij,kj->ki", C_level, t.stack("mag_x", "mag_y", "mag_z")).T
    return earth.wrap_pi(np.arctan2(-y, x) + r.declination - s.heading)


def test_magnetometer_gives_heading_with_its_bias_and_noise():
    suite = BARE.with_changes(magnetometer=Magnetometer(noise_deg=0.0))
    r = simulate(ROUGH, suite, run=3)
    bias = r.truth_states["mag_bias"][1][0]
    error = compass(r)
    assert error.mean() == pytest.approx(bias, abs=0.1 * abs(bias))
    assert abs(bias) > 1e-3
    noisy = simulate(STILL.with_changes(surface=600.0), BARE.with_changes(magnetometer=Magnetometer(bias_deg=0.0)))
    error = compass(noisy)
    assert error.std() == pytest.approx(1.5 * DEG, rel=0.06)
    second = error[99::100]
    assert abs(np.corrcoef(second[:-1], second[1:])[0, 1]) < 0.2  # a row a second is white
    field = np.linalg.norm(noisy.tables["imu"].stack("mag_x", "mag_y", "mag_z"), axis=1).mean()
    assert field == pytest.approx(48.3e-6, rel=0.01)


def test_own_compass_table():
    r = simulate(
        ROUGH.with_changes(surface=2000.0), SensorSuite(imu=None, attitude=AttitudeSensor(heading_bias_deg=3.0)),
        reference_hz=1.0,
    )  # fmt: skip
    t = r.tables["attitude"]
    offset = r.truth_states["heading_offset"][1][0]
    error = earth.wrap_pi(t["heading"] - r.truth["heading"][1:] - offset)
    assert error.std() == pytest.approx(2.0 * DEG, rel=0.08)
    assert (t["roll"] - r.truth["roll"][1:]).std() == pytest.approx(DEG, rel=0.08)
    assert offset != 0.0


# --- datasheets -------------------------------------------------------------------------------------------------------


def test_describe_shows_datasheet_si_sample_and_origin():
    text = SUITES["paper-test-1"].describe()
    arw, bias, *_ = (line for line in text.splitlines() if "gyro_arw" in line or "gyro_bias" in line)
    assert "= 1.8 ->" in arw and "0.0005236 rad/sqrt(s)" in arw and "0.005236 rad/s of a rate" in arw
    assert "(assumed)" in arw and "(published)" in bias
    assert "noise_kn = 0.1 -> 0.05144 m/s" in text and "garmin-16-hvs at 1 Hz" in text
    accel = IMUS["3dm-gx3-25"]
    assert accel.vrw[0] == pytest.approx(80e-6 * 9.80665)
    assert GARMIN_16_HVS.std[0] == pytest.approx(np.sqrt(5.0))


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"preset": "3dm"}, ["'3dm' is not known", "'3dm-gx3-25'"]),
        ({"preset": "3dm-gx3-25", "gyro_tau_s": 3}, ["keep one or the other"]),
        ({"gyro_arw": 1.0}, ["did you mean gyro_arw_deg_per_sqrt_h"]),
        ({"gyro_bias_deg_per_h": [1, 2]}, ["list of three"]),
        ({"accel_bias_ug": "big", "gyro_tau_s": 0}, ["accel_bias_ug", "gyro_tau_s"]),
        ({"gyro_arw_deg_per_sqrt_h": -1.0}, ["must not be negative"]),
    ],
)
def test_faults_of_the_imu_section(keys, said):
    with pytest.raises(StudyError) as error:
        imu_from_keys(keys)
    for word in said:
        assert word in str(error.value)


def test_suite_from_the_sections_of_a_study():
    assert suite_from_keys(preset="paper-test-2", imu={"preset": "3dm-gx3-25"}) == SUITES["paper-test-2"]
    suite = suite_from_keys(
        imu={"gyro_arw_deg_per_sqrt_h": 0.1}, errors={"gyro_bias_deg_per_h": [0, 0, 5]},
        noise={"gnss_m": [1, 2, 3], "speed_mps": 0.2, "mag_deg": 1.0, "dvl_mps": 0.01},
        mounting={"antenna_frd_m": [0, 0, -0.65], "imu_to_body_rpy_deg": [0, 0, 90]},
    )  # fmt: skip
    assert suite.imu is not None and suite.gnss is not None and suite.speed is not None
    np.testing.assert_allclose(suite.imu.gyro_offset, np.array([0, 0, 5]) * units.DEG_PER_H)
    np.testing.assert_array_equal(suite.gnss.std, [1, 2, 3])
    assert suite.speed.noise == pytest.approx(0.2)
    assert suite.magnetometer == Magnetometer(noise_deg=1.0) and suite.dvl == Dvl(noise_mps=0.01)
    assert suite.antenna_frd == (0.0, 0.0, -0.65) and suite.imu_to_body_rpy[2] == pytest.approx(np.pi / 2)
    with pytest.raises(StudyError, match=r"(?s)gnss_m.*speed_mps"):
        suite_from_keys(noise={"gnss_m": [1, 2], "speed_mps": -1})


def test_rates_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="does not divide"):
        simulate(ROUGH, SensorSuite(speed=SpeedLog(rate_hz=3.0)))
    with pytest.raises(InputError, match="imu_kind"):
        simulate(ROUGH, SensorSuite(imu_kind="counts"))
