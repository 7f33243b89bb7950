"""Studies of kind "aided" from the study file to the summary, and what bad input gets."""

import json

import numpy as np
import pytest

from schuler.ground.errors import InputError, SchulerError
from schuler.ground.tables import Table
from schuler.io.writing import write_table
from schuler.studies.model import parse_study
from schuler.studies.run import run_study
from schuler.studies.simulated import simulation

START = {
    "lat_deg": 50.0, "lon_deg": 30.0, "height_m": 200.0, "heading_deg": 40.0, "std_north_m": 1.0, "std_east_m": 1.0,
    "std_down_m": 2.0, "std_v_north_mps": 0.1, "std_v_east_mps": 0.1, "std_v_down_mps": 0.1, "std_roll_deg": 0.3,
    "std_pitch_deg": 0.3, "std_heading_deg": 1.0,
}  # fmt: skip
IMU = {"gyro_arw_deg_per_sqrt_h": 0.2, "accel_vrw_mps_per_sqrt_h": 0.05, "gyro_bias_deg_per_h": 20.0}


def raw(preset="flight", seconds=60.0, **sections):
    found = {
        "study": {"name": "x", "kind": "aided"},
        "start": START,
        "trajectory": {"preset": preset, "duration_s": seconds, "rate_hz": 50.0},
        "imu": IMU,
    }
    for name, keys in sections.items():
        found[name] = keys if isinstance(keys, list) else {**found.get(name, {}), **keys}
    return found


def ran(**sections):
    return run_study(parse_study(raw(**sections)), seed=3)


SENSORS = {
    "speed": {"simulate": {"speed_hz": 5.0}},
    "dvl": {"simulate": {"dvl_hz": 2.0}},
    "depth": {"simulate": {"depth_hz": 1.0}},
    "height": {"simulate": {"height_hz": 1.0}},
    "ranges": {"simulate": {"ranges_hz": 1.0, "height_hz": 1.0}},
    "gnss": {"simulate": {}},
}


@pytest.mark.parametrize("sensor", SENSORS)
def test_an_outage_of_any_sensor_is_withheld_and_told(sensor):
    result = ran(outage=[{"sensor": sensor, "start_s": 30.0, "end_s": 40.0}], **SENSORS[sensor])
    (told,) = result.summary["outages"]
    assert told["sensor"] == sensor and told["start_s"] == 30.0
    t = result.tables[sensor].time
    assert not ((t >= 30.0) & (t < 40.0)).any() and (t > 41.0).any()
    assert np.isfinite(result.navigation.filter.lat).all() and result.navigation.smoother is not None


def test_the_wind_is_found_and_the_speed_through_air_carries_an_outage():
    result = ran(
        seconds=120.0, simulate={"speed_hz": 5.0}, filter={"speed_is": "air"}, noise={"current_mps": 5.0},
        outage=[{"sensor": "gnss", "start_s": 90.0, "end_s": 110.0}],
    )  # fmt: skip
    for axis in ("north", "east"):
        wind = result.navigation.states[f"current_{axis}"]
        truth = result.truth_states[f"current_{axis}"]
        value = np.interp(wind.time[-1], truth.time, truth.value) if hasattr(truth, "time") else truth[1][-1]
        assert abs(wind.value[-1] - value) < 4.5 * wind.std[-1] < 4.5


def test_the_command_line_writes_a_sweep_and_the_contracts_keys(tmp_path, monkeypatch, capsys):
    from schuler.cli import main

    lines = [
        '[study]\nname = "x"\nkind = "aided"\n[start]', *(f"{k} = {v}" for k, v in START.items()),
        '[trajectory]\npreset = "flight"\nduration_s = 60.0\nrate_hz = 50.0\n[imu]',
        *(f"{k} = {v}" for k, v in IMU.items()),
        '[sweep]\nsensor = "gnss"\nlength_s = [5]\nsettle_s = 20.0\n[output]\nrate_hz = 5.0\n',
    ]  # fmt: skip
    (tmp_path / "study.toml").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["schuler", "run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as left:
        main()
    assert not left.value.code, capsys.readouterr()
    told = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert {"outages", "sweep", "distrusted"} <= set(told) and len(told["sweep"]) >= 1
    assert (tmp_path / "out" / "solution.csv").stat().st_size > 10_000


def test_the_same_seed_gives_the_same_bytes():
    a, b = ran(), ran()
    assert a.navigation.filter.lat.tobytes() == b.navigation.filter.lat.tobytes()
    assert a.navigation.smoother.cov_pos.tobytes() == b.navigation.smoother.cov_pos.tobytes()


def test_every_row_of_the_imu_comes_out_where_it_is_asked_for():
    result = ran(seconds=20.0, output={"rate_hz": "imu"})
    assert len(result.navigation.filter) >= 999


# ---- recordings --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recording():
    return simulation(parse_study(raw(seconds=60.0, simulate={"height_hz": 1.0}))).record(seed=4)


def of_files(folder, tables, **sections):
    """A study of files with these tables."""
    text = raw(**sections)
    text.pop("trajectory")
    text["start"] = {k: v for k, v in text["start"].items() if "deg" in k and "lat" not in k and "lon" not in k}
    text["start"] |= {"roll_deg": 0.0, "pitch_deg": 0.0, "std_heading_deg": 3.0}
    for name, table in tables.items():
        write_table(folder / f"{name}.csv", table)
    text["input"] = {name: str(folder / f"{name}.csv") for name in tables} | sections.get("input", {})
    return run_study(parse_study(text), seed=0)


def changed(table, **columns):
    return Table(table.name, {**table.columns, **columns}, table.kind)


def test_rows_that_are_no_numbers_are_left_out(recording, tmp_path):
    gnss, height = recording.tables["gnss"], recording.tables["height"]
    lat, up = gnss["lat"].copy(), height["height"].copy()
    lat[10:13], up[20] = np.nan, np.nan
    tables = {"imu": recording.tables["imu"], "gnss": changed(gnss, lat=lat), "height": changed(height, height=up)}
    result = of_files(tmp_path, tables)
    assert np.isfinite(result.navigation.filter.lat).all()
    assert len(result.navigation.innovations["height"].time) <= len(height) - 1


@pytest.mark.parametrize("gap", [0.5, 2.0])
def test_a_gap_of_the_imu_makes_the_sigma_grow_and_heals(recording, tmp_path, gap):
    imu = recording.tables["imu"]
    keep = (imu.time < 30.25) | (imu.time >= 30.25 + gap)
    result = of_files(tmp_path, {"imu": imu.where(keep), "gnss": recording.tables["gnss"]})
    s = result.navigation.filter
    sigma = np.sqrt(s.cov_vel[:, 0, 0])
    before, after, later = (float(sigma[np.searchsorted(s.time, t)]) for t in (29.5, 30.27 + gap, 50.0))
    assert after > 3.0 * before and later < 0.5 * after
    truth = recording.reference
    miss = np.abs(np.interp(s.time, truth.time, truth["lat"]) - s.lat) * 6.37e6
    assert miss[s.time > 40.0].max() < 6.0


def test_no_imu_no_overlap_and_gravity_on_the_wrong_axis_get_a_sentence(recording, tmp_path):
    imu, gnss = recording.tables["imu"], recording.tables["gnss"]
    with pytest.raises(SchulerError, match="imu"):
        of_files(tmp_path, {"gnss": gnss})
    with pytest.raises(InputError, match="overlap|time"):
        of_files(tmp_path, {"imu": imu, "gnss": changed(gnss, time=gnss.time + 1e5)})
    with pytest.raises(InputError, match="gravity is felt"):
        of_files(tmp_path, {"imu": imu, "gnss": gnss}, mounting={"imu_to_body_rpy_deg": [90.0, 0.0, 0.0]})


def test_places_that_are_exchanged_are_named(recording, tmp_path):
    imu, gnss = recording.tables["imu"], recording.tables["gnss"]
    reference = recording.reference
    tables = {"imu": imu, "gnss": gnss, "reference": changed(reference, lat=reference["lon"], lon=reference["lat"])}
    try:
        said = " ".join(of_files(tmp_path, tables).notes)
    except SchulerError as error:
        said = str(error)
    assert "exchanged" in said or "swapped" in said


def test_sigmas_ten_times_too_small_are_told_in_words(recording, tmp_path):
    imu, gnss = recording.tables["imu"], recording.tables["gnss"]
    noise = {"gnss_m": [0.1, 0.1, 0.2], "gnss_correlated_m": 0.0}
    sure = of_files(tmp_path, {"imu": imu, "gnss": gnss}, noise=noise)
    said = " ".join(sure.notes) + json.dumps(sure.summary, default=str)
    assert "too small" in said or "too sure" in said or "sigmas are wrong" in said
    nis = sure.navigation.innovations["gnss_position"].nis / 2.0
    assert nis.mean() > 10.0


@pytest.mark.parametrize(("preset", "seconds"), [("flight", 60.0), ("flight", 300.0), ("legs", 60.0)])
def test_noise_is_no_lag(preset, seconds):
    """Gentle turns leave the losses of all lags alike: none of them is a lag of the fixes."""
    from schuler.aiding.aided_lag import stamp_lag
    from schuler.aiding.aided_rows import imu_rows

    tables = simulation(parse_study(raw(preset, seconds=seconds))).record(seed=4).tables
    lag = stamp_lag(imu_rows(tables["imu"]), tables["gnss"])
    assert lag is None or abs(lag[0]) < max(0.02, 4.0 * lag[1])


def test_a_heading_that_nothing_tells_is_refused_or_honest(tmp_path):
    """Straight on at constant speed, no compass, no nose to follow: no heading can be found."""
    steady = parse_study(raw("rest", seconds=60.0))
    tables = simulation(steady).record(seed=1).tables
    text = {"study": {"name": "x", "kind": "aided"}, "imu": IMU, "input": {}}
    for name in ("imu", "gnss"):
        write_table(tmp_path / f"{name}.csv", tables[name])
        text["input"][name] = str(tmp_path / f"{name}.csv")
    try:
        result = run_study(parse_study(text), seed=0)
    except InputError as error:
        assert "heading" in str(error)
    else:
        assert np.sqrt(result.navigation.filter.cov_rpy[-1, 2, 2]) > 0.1


def test_a_reference_on_another_clock_is_told_with_its_lag(tmp_path):
    made = simulation(parse_study(raw("car", seconds=200.0))).record(seed=4)
    reference = made.reference
    late = changed(reference, time=reference.time + 1.0)
    tables = {"imu": made.tables["imu"], "gnss": made.tables["gnss"], "reference": late}
    result = of_files(tmp_path, tables, filter={"constraints": ["nhc"]})
    said = " ".join(result.notes) + json.dumps(result.summary, default=str)
    assert "type reference_delay_s = 1" in said or "type reference_delay_s = 0.9" in said
