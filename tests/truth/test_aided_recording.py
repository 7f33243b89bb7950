"""Simulated aiding sensors: without noise they are the trajectory seen from their place and moment, with it the noise
has the size and memory that was asked for, and no sensor disturbs another."""

import math
from dataclasses import replace

import numpy as np
import pytest

from schuler.ground.earth import WGS84, C_en
from schuler.ground.errors import InputError
from schuler.ground.fields import magnetic_field
from schuler.ground.frames import dcm_from_euler, dcm_from_quat
from schuler.ground.tables import validate
from schuler.truth import manoeuvres
from schuler.truth import trajectories as shapes
from schuler.truth.aided import AidedSuite, simulate
from schuler.truth.instruments import ImuModel, Magnetometer

D = math.pi / 180.0
FLIGHT = manoeuvres.flight(50.0 * D, 30.0 * D, 1000.0, speed=60.0, heading=1.0, duration=120.0)
STILL = shapes.rest(0.8, 0.3, 10.0, duration=4000.0)
ARM = (1.5, -0.4, -0.8)
CLEAN = AidedSuite(
    gnss_std=(0.0,) * 3, gnss_velocity_std=(0.0,) * 3, speed_std=0.0, dvl_std=0.0, depth_std=0.0, height_std=0.0,
    range_std=0.0, gnss_hz=2.0, speed_hz=3.0, dvl_hz=7.0, depth_hz=1.0, height_hz=1.0, ranges_hz=1.0,
    antenna=ARM, speed_arm=(-1.0, 0.0, 0.5), dvl_arm=(0.3, 0.2, 1.0), magnetometer=Magnetometer("m", 0.0, 0.0),
)  # fmt: skip


def ecef(path, t, arm):
    """Position of a point of the body on the turning Earth (n, 3), m: nothing here is shared with the simulation."""
    s = path.at(t)
    r = WGS84.ecef_from_geodetic(s.lat, s.lon, s.height)
    C = C_en(s.lat, s.lon) @ dcm_from_quat(s.q_nb)
    return r + C @ np.asarray(arm), s, C


def velocity(path, t, arm, h=0.01):
    """Its velocity against the Earth in e, by differences of the fourth order."""
    r = [ecef(path, t + k * h, arm)[0] for k in (-2, -1, 1, 2)]
    return (r[0] - 8 * r[1] + 8 * r[2] - r[3]) / (12 * h)


def inside(table):
    return (table.time > 1.0) & (table.time < 119.0)


def test_without_noise_fixes_are_the_antenna_at_its_moment() -> None:
    suite = replace(CLEAN, gnss_delay=0.3, gnss_delay_std=0.1, antenna_std=0.3)
    r = simulate(FLIGHT, ImuModel(), suite, 50.0, seed=3)
    delay = r.truth_states["gnss_delay"][1][0]
    arm = np.array([r.truth_states[f"antenna_lever_{a}"][1][0] for a in "xyz"])
    assert 0.01 < abs(delay - 0.3) < 0.4
    assert 0.05 < np.linalg.norm(arm - ARM) < 1.5
    g = r.tables["gnss"]
    t = g.time[inside(g)] - delay  # a delay > 0: the row stamped t belongs to t - delay
    place, s, _ = ecef(FLIGHT, t, arm)
    seen = WGS84.ecef_from_geodetic(*(g[c][inside(g)] for c in ("lat", "lon", "height")))
    np.testing.assert_allclose(seen, place, atol=3e-6)
    v = np.einsum("nji,nj->ni", C_en(s.lat, s.lon), velocity(FLIGHT, t, arm))
    np.testing.assert_allclose(g.stack("v_north", "v_east", "v_down")[inside(g)], v, atol=2e-6)


def test_the_velocity_can_be_later_than_the_position() -> None:
    suite = replace(CLEAN, gnss_velocity_delay_std=0.3, antenna=(0.0,) * 3)
    r = simulate(FLIGHT, ImuModel(), suite, 50.0, seed=3)
    g, delay = r.tables["gnss"], r.truth_states["gnss_velocity_delay"][1][0]
    assert abs(delay) > 0.02
    np.testing.assert_allclose(g["lat"], FLIGHT.at(g.time).lat, rtol=0, atol=0)
    np.testing.assert_allclose(g["v_north"], FLIGHT.at(g.time - delay).v_n[:, 0], atol=1e-12)


def test_without_noise_body_speeds_are_those_of_their_places() -> None:
    suite = replace(CLEAN, speed_is="air", current_std=3.0, dvl_misalignment_std=0.02, dvl_scale_std=0.01)
    suite = replace(suite, speed_delay_std=0.1, dvl_delay_std=0.1, speed_scale_std=0.01)
    r = simulate(FLIGHT, ImuModel(), suite, 50.0, seed=5)

    def true(name):
        return r.truth_states[name][1][0]

    speed = r.tables["speed"]
    t = speed.time[inside(speed)] - true("speed_delay")
    _, s, C = ecef(FLIGHT, t, (0.0,) * 3)
    wind = np.array([true("current_north"), true("current_east"), 0.0])
    air = velocity(FLIGHT, t, suite.speed_arm) - C_en(s.lat, s.lon) @ wind
    axial = (1.0 + true("speed_scale")) * np.einsum("nj,nj->n", C[:, :, 0], air)
    np.testing.assert_allclose(speed["speed"][inside(speed)], axial, atol=2e-6)
    dvl = r.tables["dvl"]
    t = dvl.time[inside(dvl)] - true("dvl_delay")
    C = ecef(FLIGHT, t, (0.0,) * 3)[2]
    v_b = np.einsum("nji,nj->ni", C, velocity(FLIGHT, t, suite.dvl_arm))
    turn = dcm_from_euler(*(true(f"dvl_misalignment_{a}") for a in "xyz"))
    want = (1.0 + true("dvl_scale")) * v_b @ turn
    np.testing.assert_allclose(dvl.stack("v_x", "v_y", "v_z")[inside(dvl)], want, atol=2e-6)


def test_without_noise_depth_height_and_ranges_are_exact() -> None:
    r = simulate(FLIGHT, ImuModel(), replace(CLEAN, beacons=5), 50.0, seed=1)
    t = r.tables["depth"].time
    assert np.array_equal(r.tables["depth"]["depth"], -FLIGHT.at(t).height)
    assert np.array_equal(r.tables["height"]["height"], FLIGHT.at(t).height)
    marks, ranges = r.tables["landmarks"], r.tables["ranges"]
    at = {
        n: WGS84.ecef_from_geodetic(*p)
        for n, *p in zip(*(marks[c] for c in ("id", "lat", "lon", "height")), strict=True)
    }
    here = ecef(FLIGHT, ranges.time, (0.0,) * 3)[0]
    want = [np.linalg.norm(x - at[name]) for x, name in zip(here, ranges["id"], strict=True)]
    np.testing.assert_allclose(ranges["range"], want, atol=2e-9)
    assert len(marks) == 5 and len(ranges) == 5 * 120


def test_without_noise_the_compass_sees_the_field_of_the_place() -> None:
    r = simulate(FLIGHT, ImuModel(), replace(CLEAN, mounting_std=0.05, imu_to_body=(0.0, 0.0, 1.0)), 50.0, seed=1)
    t = r.tables["imu"].time
    s = FLIGHT.at(t)
    turn = [r.truth_states[f"mounting_{a}"][1][0] for a in ("roll", "pitch", "yaw")]
    C = dcm_from_quat(s.q_nb) @ dcm_from_euler(*turn) @ dcm_from_euler(0.0, 0.0, 1.0)
    want = np.einsum("nji,nj->ni", C, magnetic_field(s.lat, s.lon, s.height, 2026.0))
    np.testing.assert_allclose(r.tables["imu"].stack("mag_x", "mag_y", "mag_z"), want, atol=2e-11)
    assert r.declination == pytest.approx(math.atan2(r.field_n[1], r.field_n[0]))


def test_a_biased_compass_reads_heading_plus_bias() -> None:
    """As kind "auv" has it: the levelled compass."""
    level = shapes.rest(0.8, 0.3, heading=0.7, duration=10.0)
    r = simulate(level, ImuModel(), replace(CLEAN, magnetometer=Magnetometer("m", 5.0, 0.0)), 10.0, seed=1)
    imu = r.tables["imu"]
    heading = np.arctan2(-imu["mag_y"], imu["mag_x"]) + r.declination
    assert abs(r.truth_states["heading_offset"][1][0]) > 0.01
    np.testing.assert_allclose(heading - 0.7, r.truth_states["heading_offset"][1][0], atol=1e-9)


def test_the_imu_is_turned_by_its_mounting() -> None:
    """f_vehicle = C(mounting) C(imu_to_body) f_imu, and the errors sit in the IMU's own axes."""
    rpy = (0.02, -0.5, 2.0)
    imu = ImuModel(gyro_bias_deg_per_h=100.0, accel_bias_ug=500.0, gyro_scale_ppm=1000.0)
    r = simulate(FLIGHT, imu, replace(CLEAN, magnetometer=None, mounting_std=0.03, imu_to_body=rpy), 50.0, seed=2)
    ideal = FLIGHT.ideal(50.0)
    turn = [r.truth_states[f"mounting_{a}"][1][0] for a in ("roll", "pitch", "yaw")]
    nominal = dcm_from_euler(*rpy)
    table, states = r.tables["imu"], r.truth_states
    in_body = table.stack("dv_x", "dv_y", "dv_z") @ nominal.T  # what a filter makes of it
    bias = np.array([states[f"accel_bias_{a}"][1][0] for a in "xyz"])
    np.testing.assert_allclose((in_body - bias / 50.0) @ dcm_from_euler(*turn).T, ideal.dv, atol=1e-13)
    w = table.stack("dtheta_x", "dtheta_y", "dtheta_z") @ nominal.T
    scale = np.array([states[f"gyro_scale_{a}"][1][0] for a in "xyz"])
    E = nominal @ (r.measured.M_gyro - np.eye(3)) @ nominal.T
    np.testing.assert_allclose(scale, np.diag(E))
    bias = np.array([states[f"gyro_bias_{a}"][1][0] for a in "xyz"])
    true = ideal.dtheta @ dcm_from_euler(*turn)
    np.testing.assert_allclose(w, true @ (np.eye(3) + E).T + bias / 50.0, atol=1e-14)


def test_the_reference_is_the_trajectory_at_its_point() -> None:
    r = simulate(FLIGHT, ImuModel(), replace(CLEAN, reference_arm=ARM), 50.0, seed=2)
    ref = r.reference
    place, s, _ = ecef(FLIGHT, ref.time, ARM)
    np.testing.assert_allclose(WGS84.ecef_from_geodetic(ref["lat"], ref["lon"], ref["height"]), place, atol=3e-6)
    np.testing.assert_allclose(np.unwrap(ref["heading"]), np.unwrap(s.rpy[:, 2] % (2 * math.pi)), atol=1e-12)
    assert ref.time[0] == 0.0 and len(ref) == 1201


def test_arms_and_reference_are_of_the_body_and_the_log_is_of_the_vehicle() -> None:
    """The body is the IMU as the study turns it; the vehicle's own axes are turned against it by the mounting."""
    r = simulate(FLIGHT, ImuModel(), replace(CLEAN, mounting_std=0.1), 50.0, seed=2)
    C_vb = dcm_from_euler(*(r.truth_states[f"mounting_{a}"][1][0] for a in ("roll", "pitch", "yaw")))
    ref, g, speed = r.reference, r.tables["gnss"], r.tables["speed"]
    s = FLIGHT.at(ref.time)
    seen = dcm_from_euler(ref["roll"], ref["pitch"], ref["heading"])
    np.testing.assert_allclose(seen, dcm_from_quat(s.q_nb) @ C_vb, atol=1e-12)
    place = ecef(FLIGHT, g.time, C_vb @ ARM)[0]
    np.testing.assert_allclose(WGS84.ecef_from_geodetic(g["lat"], g["lon"], g["height"]), place, atol=3e-6)
    t = speed.time[inside(speed)]
    nose = ecef(FLIGHT, t, (0.0,) * 3)[2][:, :, 0]
    want = np.einsum("nj,nj->n", nose, velocity(FLIGHT, t, C_vb @ CLEAN.speed_arm))
    np.testing.assert_allclose(speed["speed"][inside(speed)], want, atol=2e-6)


NOISY = AidedSuite(
    gnss_correlated=(2.0, 2.0, 3.0), gnss_correlated_tau=20.0, gnss_hz=2.0, speed_hz=1.0, speed_scale_std=0.01,
    speed_is="water", current_walk=0.001, dvl_hz=1.0, dvl_scale_std=0.003, depth_hz=1.0, height_hz=1.0,
    height_bias_std=3.0, height_walk=0.02, range_bias_std=0.3, ranges_hz=1.0, magnetometer=Magnetometer(),
    mounting_std=0.02, gnss_delay_std=0.05, antenna_std=0.1, start_std=(1.0,) * 9,
)  # fmt: skip
IMU = ImuModel(gyro_arw_deg_per_sqrt_h=0.1, gyro_bias_deg_per_h=1.0, accel_bias_ug=100.0)


def test_every_table_is_valid_and_repeats_for_its_seed_and_run() -> None:
    a, b, c = (simulate(FLIGHT, IMU, NOISY, 50.0, seed=4, run=k) for k in (1, 1, 2))
    assert set(a.tables) == {"imu", "gnss", "speed", "dvl", "depth", "height", "ranges", "landmarks"}
    for name, table in {**a.tables, "reference": a.reference}.items():
        assert validate(table) == [], name
        for column, values in table.columns.items():
            assert np.array_equal(values, b.tables.get(name, b.reference)[column])
    assert not np.array_equal(a.tables["gnss"]["lat"], c.tables["gnss"]["lat"])
    assert np.array_equal(a.start.rpy, b.start.rpy) and not np.array_equal(a.start.rpy, c.start.rpy)


@pytest.mark.parametrize("sensor", ["gnss", "speed", "dvl", "depth", "height", "ranges", "magnetometer"])
def test_taking_a_sensor_away_changes_no_other(sensor: str) -> None:
    """Nor does doubling its noise."""
    whole = simulate(FLIGHT, IMU, NOISY, 50.0, seed=4)
    gone = replace(NOISY, **({"magnetometer": None} if sensor == "magnetometer" else {f"{sensor}_hz": 0.0}))
    less = simulate(FLIGHT, IMU, gone, 50.0, seed=4)
    for name, table in less.tables.items():
        for column, values in table.columns.items():
            assert np.array_equal(values, whole.tables[name][column]), (name, column)
    louder = simulate(FLIGHT, IMU, replace(NOISY, gnss_std=(9.0,) * 3, speed_std=9.0), 50.0, seed=4)
    assert np.array_equal(louder.tables["dvl"]["v_x"], whole.tables["dvl"]["v_x"])
    assert np.array_equal(louder.truth_states["speed_scale"][1], whole.truth_states["speed_scale"][1])


def markov(x, sigma, tau, dt):
    """Checks variance and the correlation at lags of a third of tau and of tau, within five standard errors."""
    n_eff = len(x) * dt / (2.0 * tau)
    assert np.var(x) == pytest.approx(sigma**2, rel=5.0 * math.sqrt(2.0 / n_eff))
    for lag in (tau / 3.0, tau):
        k = round(lag / dt)
        got = np.mean(x[k:] * x[:-k]) / sigma**2
        assert got == pytest.approx(math.exp(-lag / tau), abs=5.0 * math.sqrt(2.0 / n_eff))


def test_errors_have_the_size_and_memory_that_was_asked_for() -> None:
    suite = replace(NOISY, gnss_delay_std=0.0, antenna_std=0.0, magnetometer=None, ranges_hz=0.0)
    long = replace(STILL, duration=20000.0)
    r = simulate(long, ImuModel(), suite, 1.0, seed=9)
    R_N, R_E = (float(x) for x in WGS84.radii(0.8))
    g, states = r.tables["gnss"], r.truth_states
    ned = np.column_stack(
        [(g["lat"] - 0.8) * (R_N + 10.0), (g["lon"] - 0.3) * (R_E + 10.0) * math.cos(0.8), 10.0 - g["height"]]
    )
    for i, (axis, white, slow) in enumerate((("north", 1.0, 2.0), ("east", 1.0, 2.0), ("down", 2.0, 3.0))):
        bias = states[f"gnss_bias_{axis}"][1]
        markov(bias, slow, 20.0, 0.5)
        rest = ned[:, i] - bias
        assert rest.std() == pytest.approx(white, rel=5.0 / math.sqrt(2 * len(rest)))
        assert abs(np.mean(rest[1:] * rest[:-1])) < 5.0 * white**2 / math.sqrt(len(rest))
    v = g.stack("v_north", "v_east", "v_down")
    np.testing.assert_allclose(v.std(axis=0), suite.gnss_velocity_std, rtol=5.0 / math.sqrt(2 * len(v)))
    height = r.tables["height"]["height"] - 10.0
    assert np.diff(states["height_bias"][1]).std() == pytest.approx(0.02, rel=0.03)
    assert (height - states["height_bias"][1]).std() == pytest.approx(1.0, rel=0.03)
    assert (r.tables["depth"]["depth"] + 10.0).std() == pytest.approx(0.1, rel=0.03)
    assert r.tables["dvl"]["v_y"].std() == pytest.approx(0.02, rel=0.03)
    step = np.diff(states["current_east"][1])
    assert step.std() == pytest.approx(0.001, rel=0.03)
    through = r.tables["speed"]["speed"] + states["current_north"][1] * (1.0 + states["speed_scale"][1][0])
    assert through.std() == pytest.approx(0.05, rel=0.03)


def test_what_is_drawn_once_has_its_sigma_over_the_runs() -> None:
    path = replace(STILL, duration=3.0)
    suite = replace(
        NOISY,
        magnetometer=Magnetometer(hard_iron_ut=2.0),
        dvl_misalignment_std=0.01,
        speed_arm_std=0.2,
        depth_bias_std=20.0,
    )
    imu = ImuModel(gyro_bias_deg_per_h=10.0, accel_scale_ppm=500.0)
    runs = [simulate(path, imu, suite, 10.0, seed=1, run=k) for k in range(150)]
    sigmas = {
        "gnss_delay": 0.05, "antenna_lever_y": 0.1, "mounting_pitch": 0.02, "speed_scale": 0.01, "dvl_scale": 0.003,
        "dvl_misalignment_z": 0.01, "speed_lever_x": 0.2, "current_east": 0.3, "gnss_bias_north": 2.0,
        "height_bias": 3.0, "range_bias": 0.3, "depth_bias": 20.0,
        "heading_offset": 2.0 * D, "mag_bias_x": 2e-6, "gyro_bias_z": 10.0 * D / 3600.0,
        "accel_scale_y": 5e-4,
    }  # fmt: skip
    for name, sigma in sigmas.items():
        values = np.array([r.truth_states[name][1][0] for r in runs])
        assert np.sqrt(np.mean(values**2)) == pytest.approx(sigma, rel=4.0 / math.sqrt(2 * len(runs))), name
    start = np.array([[*(r.start.v_n), *(r.start.rpy[:2])] for r in runs])
    np.testing.assert_allclose(np.sqrt(np.mean(start**2, axis=0)), 1.0, rtol=4.0 / math.sqrt(2 * len(runs)))


def test_nothing_drawn_is_no_state_to_find() -> None:
    r = simulate(FLIGHT, ImuModel(), AidedSuite(speed_hz=1.0), 50.0)
    assert not [n for n in r.truth_states if not n.startswith(("gyro_bias", "accel_bias"))]
    assert np.array_equal(r.start.v_n, FLIGHT.at(0.0).v_n[0])


def test_ranges_without_beacons_are_refused() -> None:
    with pytest.raises(InputError, match="at least one"):
        simulate(FLIGHT, ImuModel(), AidedSuite(ranges_hz=1.0, beacons=0), 50.0)
