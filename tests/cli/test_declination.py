"""Where the declination of a recording comes from: typed, or the magnetic model; and when it is asked for."""

import math

import numpy as np
import pytest

from schuler.ground.errors import StudyError
from schuler.ground.fields import decimal_year, declination
from schuler.ground.tables import Table
from schuler.io.tables import write_table
from schuler.studies.magnetic import recorded_declination
from schuler.studies.model import load_study
from schuler.studies.run import run_study
from schuler.truth.instruments import AttitudeSensor, Magnetometer
from schuler.truth.keys import mission_from_keys
from schuler.truth.recording import SUITES, simulate

DEG = math.pi / 180
NOW = 1.79e9  # 2026-09-21
OLD = 1.4e9  # 2014-05-13
FAIR = 3.0  # deg rms: what this compass gives with its true heading, 2.3, most of it the waves between its rows
# South of Greenland: the declination is large enough to be missed where it is not applied.
PLACE = {"lat_deg": 62.0, "lon_deg": -40.0}
MISSION = {"surface_s": 60.0, "dive_s": 120.0, "final_surface_s": 30.0, "depth_m": 8.0, **PLACE}


@pytest.fixture(scope="module")
def compass():
    """A dive recorded by a compass without offset, 1 Hz; times from 0."""
    sensor = AttitudeSensor(heading_noise_deg=0.5, tilt_noise_deg=0.2)
    suite = SUITES["demo"].with_changes(imu=None, imu_rate_hz=10.0, attitude=sensor)
    return simulate(mission_from_keys(MISSION), suite, seed=3)


def later(table, base, **columns):
    return Table(table.name, {**table.columns, **columns, "time": table.time + base}, table.kind)


def written(folder, recording, base, study="", magnetic=True, names=("gnss", "speed", "depth", "attitude")):
    """A study of the recording, its clock moved by base; heading_mag is what a compass there and then would say."""
    tables = {n: later(recording.tables[n], base) for n in names}
    if magnetic and "attitude" in tables:
        rows = tables["attitude"]
        place = (PLACE["lat_deg"] * DEG, PLACE["lon_deg"] * DEG, 0.0)
        heading = rows["heading"] - declination(*place, decimal_year(base or NOW), nearest=True)
        columns = {k: v for k, v in rows.columns.items() if k not in ("heading", "std_heading")}
        tables["attitude"] = Table("attitude", {**columns, "heading_mag": np.mod(heading, 2 * np.pi)}, rows.kind)
    for name, table in tables.items():
        write_table(folder / f"{name}.csv", table)
    write_table(folder / "truth.csv", later(recording.truth, base))
    inputs = "\n".join(f'{n} = "{n}.csv"' for n in tables)
    path = folder / "study.toml"
    path.write_text(f'[study]\nname = "t"\nkind = "auv"\n[input]\nreference = "truth.csv"\n{inputs}\n{study}\n')
    return path


def ran(path):
    result = run_study(load_study(path))
    return result, result.summary["errors"]["filter"]["heading_deg"]["rms"], " ".join(result.notes)


def test_the_model_gives_what_the_study_does_not_type(tmp_path, compass):
    result, error, said = ran(written(tmp_path, compass, NOW))
    value = float(declination(PLACE["lat_deg"] * DEG, PLACE["lon_deg"] * DEG, 0.0, decimal_year(NOW))) / DEG
    assert value < -15.0
    assert f"declination {value:.1f} deg for attitude's heading_mag, from WMM2025 at the first fix" in said
    assert "on 2026-09-21" in said and "type [input] declination_deg to replace it" in said
    assert "deg off" not in said
    assert result.summary["notes"] == result.notes
    assert error < FAIR

    typed, error_typed, quiet = ran(written(tmp_path, compass, NOW, f"declination_deg = {value!r}"))
    assert "WMM2025" not in quiet
    np.testing.assert_allclose(result.navigation.filter.lat, typed.navigation.filter.lat, rtol=0, atol=1e-9)

    _, error_none, _ = ran(written(tmp_path, compass, NOW, "declination_deg = 0"))
    assert error_none > 5 * error  # what a silent zero would have cost


def test_an_old_recording_runs_and_says_how_far_off_it_may_be(tmp_path, compass):
    _, error, said = ran(written(tmp_path, compass, OLD))
    assert "on 2014-05-13" in said
    assert "2014-05-13 is outside the span of WMM2025" in said and "of 2025.0 was taken" in said and "deg off" in said
    assert error < FAIR


def test_a_clock_without_a_date_asks_for_the_declination(tmp_path, compass, program):
    path = written(tmp_path, compass, 0.0)
    done = program("run", path)
    assert done.status == 2 and "Traceback" not in done.err
    assert "[input] declination_deg: attitude's heading_mag counts from magnetic north" in done.err
    assert "no Unix time" in done.err and "WMM2025 has -19.1 deg at the first fix" in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not (tmp_path / "t-result").exists()
    path.write_text(path.read_text() + "declination_deg = -19.1\n")
    assert program("run", path).status == 0


def test_a_true_heading_asks_for_nothing(tmp_path, compass):
    _, error, said = ran(written(tmp_path, compass, 0.0, magnetic=False))
    assert "declination" not in said and error < FAIR


def test_magnetometer_of_an_imu(tmp_path):
    suite = SUITES["demo"].with_changes(imu_rate_hz=50.0, magnetometer=Magnetometer(bias_deg=0.5))
    made = simulate(mission_from_keys(MISSION), suite, seed=4)
    names = ("imu", "gnss", "speed", "depth")
    study = load_study(written(tmp_path, made, 0.0, names=names))
    with pytest.raises(StudyError, match=r"declination_deg: the imu's magnetometer counts from magnetic north"):
        run_study(study)
    tables = {n: later(made.tables[n], NOW) for n in names}
    value, notes = recorded_declination(study, tables)
    assert value / DEG == pytest.approx(-18.5, abs=0.1) and "the imu's magnetometer" in notes[0]
    # An imu beside: the attitude table is not read, so its magnetic heading asks for nothing.
    bare = {**tables, "imu": Table("imu", {k: v for k, v in tables["imu"].columns.items() if "mag" not in k}, "rates")}
    bare["attitude"] = Table("attitude", {"time": tables["gnss"].time, "heading_mag": tables["gnss"]["lat"]}, "")
    assert recorded_declination(study, bare) == (None, [])
    # The paper's filter reads no magnetometer.
    paper = study.model_copy(update={"filter": study.filter.model_copy(update={"method": "paper"})})
    assert recorded_declination(paper, tables) == (None, [])


def test_the_start_says_where_before_the_first_fix_does(tmp_path, compass):
    start = "[start]\nlat_deg = 10.0\nlon_deg = 20.0"
    study = load_study(written(tmp_path, compass, NOW, start))
    from schuler.io.tables import read_table

    tables = {n: read_table(tmp_path / f"{n}.csv", n) for n in ("gnss", "attitude")}
    value, notes = recorded_declination(study, tables)
    assert value == pytest.approx(declination(10 * DEG, 20 * DEG, 0.0, decimal_year(tables["attitude"].time[0])))
    assert "at [start] (10.00, 20.00 deg)" in notes[0]
    # ... and the fixes lie far from there
    assert "changes by" in notes[-1] and "over the fixes" in notes[-1]


def test_near_a_magnetic_pole_the_compass_is_not_relied_on(tmp_path, compass):
    study = load_study(written(tmp_path, compass, NOW, "[start]\nlat_deg = 85.0\nlon_deg = 140.0"))
    tables = {"attitude": Table("attitude", {"time": NOW + np.arange(3.0), "heading_mag": np.zeros(3)}, "")}
    _, notes = recorded_declination(study, tables)
    assert any("a compass is not to be relied on" in n for n in notes)
    assert recorded_declination(load_study(written(tmp_path, compass, NOW)), tables) == (None, [])  # nowhere
