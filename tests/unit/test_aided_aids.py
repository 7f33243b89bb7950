"""Sensors beside GNSS, each in a simulated study of kind "aided": what they find, and whether they know how well."""

import numpy as np
import pytest

from schuler.studies.model import parse_study
from schuler.studies.run import run_study

FLIGHT = {"preset": "flight", "duration_s": 240.0, "rate_hz": 50.0}
START = {
    "lat_deg": 50.0, "lon_deg": 10.0, "height_m": 500.0, "heading_deg": 0.0, "std_north_m": 1.0, "std_east_m": 1.0,
    "std_down_m": 1.0, "std_v_north_mps": 0.1, "std_v_east_mps": 0.1, "std_v_down_mps": 0.1, "std_roll_deg": 0.3,
    "std_pitch_deg": 0.3, "std_heading_deg": 1.0,
}  # fmt: skip


def run(simulate, *, trajectory=FLIGHT, filter=None, noise=None, outage=None, seed=4, imu="tactical"):
    raw = {
        "study": {"name": "aids", "kind": "aided"},
        "start": START,
        "imu": {"preset": imu},
        "trajectory": trajectory,
        "simulate": simulate,
        "noise": {"gnss_correlated_m": 0.0, **(noise or {})},
        "filter": filter or {},
    }
    if outage:
        raw["outage"] = [{"sensor": "gnss", "start_s": outage[0], "end_s": outage[1]}]
    return run_study(parse_study(raw), seed=seed)


def found(result, name):
    s = result.summary["states"][name]
    return (s["value"] - s["truth"]) / s["std"], s["std"]


def nis(result, kind):
    return result.summary["consistency"]["nis"][kind]["mean"]


def test_wind_is_found_by_airspeed_and_carries_an_outage():
    noise = {"speed_mps": 0.5, "current_mps": 5.0, "current_walk_mps_per_sqrt_h": 1.0}
    aided = run({"speed_hz": 1.0}, filter={"speed_is": "air"}, noise=noise, outage=(150, 230), imu="consumer")
    alone = run({}, outage=(150, 230), imu="consumer")
    for axis in ("north", "east"):
        error, sigma = found(aided, f"current_{axis}")
        assert abs(error) < 3.5 and sigma < 1.0  # m/s, from a prior of 5
    assert nis(aided, "speed") == pytest.approx(1.0, abs=0.35)
    ends = [r.summary["outages"][0]["horizontal_end_m"] for r in (aided, alone)]
    assert ends[0] < 0.5 * ends[1]


def test_current_is_told_from_the_water_by_fixes_on_two_headings():
    noise = {"speed_mps": 0.05, "current_mps": 0.5, "current_walk_mps_per_sqrt_h": 0.02}
    sea = {"preset": "car", "duration_s": 240.0, "rate_hz": 25.0, "speed_mps": 3.0}
    result = run({"speed_hz": 1.0}, trajectory=sea, filter={"speed_is": "water"}, noise=noise)
    for axis in ("north", "east"):
        error, sigma = found(result, f"current_{axis}")
        assert abs(error) < 3.5 and sigma < 0.1


def test_a_compass_holds_the_heading_of_a_vehicle_that_does_not_turn():
    still = {"preset": "great-circle", "duration_s": 240.0, "rate_hz": 50.0, "speed_mps": 20.0}
    with_, without = (run({"magnetometer": on}, trajectory=still, imu="consumer") for on in (True, False))
    sigma = [float(np.degrees(np.sqrt(r.navigation.filter.cov_rpy[-1, 2, 2]))) for r in (with_, without)]
    assert sigma[0] < 0.8 * sigma[1]
    error = with_.summary["errors"]["filter"]["heading_deg"]["end"]
    assert error < 3.5 * sigma[0]
    assert nis(with_, "magnetometer") == pytest.approx(1.0, abs=0.4)


def test_depth_dvl_and_no_fix_hold_a_ship():
    noise = {"dvl_mps": 0.02, "dvl_scale_percent": 0.3}
    result = run({"gnss_hz": 1.0, "dvl_hz": 1.0, "depth_hz": 1.0}, noise=noise, outage=(60, 230))
    out = result.summary["outages"][0]
    assert out["horizontal_end_m"] < 0.01 * out["distance_m"] and out["nees_half_end"] < 6.0
    assert nis(result, "dvl") == pytest.approx(1.0, abs=0.3)
    assert result.summary["errors"]["filter"]["vertical_m"]["rms"] < 2.0


def test_a_barometer_learns_its_offset_and_keeps_the_height():
    noise = {"height_m": 0.5, "height_bias_m": 20.0}
    result = run({"height_hz": 1.0}, noise=noise, outage=(120, 230), imu="consumer")
    error, sigma = found(result, "height_bias")
    assert abs(error) < 4.0 and sigma < 3.0
    assert result.summary["errors"]["filter"]["vertical_m"]["max"] < 12.0


def test_a_vehicles_own_attitude_table_gives_the_heading(tmp_path):
    """The heading offset of its compass is learnt from the motion, within its own sigma."""
    from schuler.aiding.aided import AidedSettings, navigate
    from schuler.ground.tables import Table
    from schuler.studies.simulated import simulation

    raw = {
        "study": {"name": "a", "kind": "aided"}, "start": START, "imu": {"preset": "consumer"}, "trajectory": FLIGHT,
        "noise": {"gnss_correlated_m": 0.0},
    }  # fmt: skip
    made = simulation(parse_study(raw)).record(7)
    ref = made.reference
    rng = np.random.default_rng(1)
    offset = np.radians(2.5)
    heading = np.mod(ref["heading"] + offset + rng.normal(0.0, np.radians(1.0), len(ref)), 2.0 * np.pi)
    tables = dict(made.tables)
    columns = {"time": ref.time, "roll": ref["roll"], "pitch": ref["pitch"], "heading": heading}
    tables["attitude"] = Table("attitude", columns)
    s = AidedSettings(gnss_correlated_std=0.0, gnss_velocity_std=(0.05, 0.05, 0.1))
    nav = navigate(tables, s)
    state = nav.states["heading_offset"]
    assert abs(state.value[-1] - offset) < 3.5 * state.std[-1] and state.std[-1] < np.radians(1.5)
    assert any("from the compass" in note for note in nav.notes)


def test_an_imu_that_was_silent_for_a_minute_starts_anew():
    """Two stretches, each with a start of its own; the second knows its place and its heading again, honestly."""
    from schuler.aiding.aided import AidedSettings, navigate
    from schuler.judging.consistency import nees
    from schuler.judging.errors import error_series
    from schuler.studies.simulated import simulation

    raw = {
        "study": {"name": "a", "kind": "aided"}, "start": START, "imu": {"preset": "consumer"},
        "trajectory": {"preset": "car", "duration_s": 400.0, "rate_hz": 50.0}, "noise": {"gnss_correlated_m": 0.0},
    }  # fmt: skip
    made = simulation(parse_study(raw)).record(5)
    imu = made.tables["imu"]
    tables = {**made.tables, "imu": imu.where((imu.time < 150.0) | (imu.time > 210.0))}
    nav = navigate(tables, AidedSettings(gnss_correlated_std=0.0, constraints=("nhc",)))
    assert any("silent for 60 s until 210.0 s: navigation starts anew" in note for note in nav.notes)
    time = nav.filter.time
    assert (np.diff(time) > 0).all() and time[0] < 60.0 and time[-1] > 399.0
    assert not ((time > 150.1) & (time < 210.0)).any()
    late = error_series(nav.filter, made.reference).between(300.0, 400.0)
    assert late.horizontal.max() < 4.0 and np.nanmean(nees(late.position[:, :2], late.cov_pos[:, :2, :2])) < 3.0
    assert len(nav.smoother) == len(nav.filter) and len(nav.states["gyro_bias_z"].time) > 100
