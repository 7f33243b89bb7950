"""Kind "ahrs" as a study: what it reads, says, judges and writes."""

import json
from math import radians

import numpy as np
import pytest

from ahrs_motion import FIELD, LAT, motion, record, wandering
from schuler.ground.errors import InputError, StudyError
from schuler.ground.frames import dcm_from_rotvec, euler_from_quat, quat_from_rotvec, quat_multiply
from schuler.ground.tables import Table
from schuler.io.writing import write_table
from schuler.judging.attitude import attitude_errors
from schuler.studies.model import load_study
from schuler.studies.run import run_study
from schuler.studies.told import figures

DEG = np.pi / 180.0
STUDY = """
[study]
name = "hand"
kind = "ahrs"
[input]
imu = "imu.csv"
reference = "reference.csv"
declination_deg = 0.0
[imu]
gyro_arw_deg_per_sqrt_h = 0.6
gyro_bias_deg_per_h = 900.0
gyro_scale_ppm = 1.0
accel_vrw_mps_per_sqrt_h = 0.1
accel_bias_ug = 3000.0
"""


def reference_of(rec):
    roll, pitch, heading = euler_from_quat(rec.q_nb)
    return Table("reference", {"time": rec.time, "roll": roll, "pitch": pitch, "heading": np.mod(heading, 2 * np.pi)})


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("hand")
    rec = record(40.0, 50.0, made=wandering(40.0, 2))
    write_table(out / "imu.csv", rec.imu)
    write_table(out / "reference.csv", reference_of(rec))
    return out


def study_in(folder, text=STUDY, name="study.toml"):
    (folder / name).write_text(text, encoding="utf-8")
    return load_study(folder / name)


def changed(folder, tmp_path, change, text=STUDY):
    """The study on an imu table that `change` has changed."""
    from schuler.io.tables import read_table

    imu = read_table(folder / "imu.csv", "imu")
    columns = {k: v.copy() for k, v in imu.columns.items()}
    change(columns)
    write_table(tmp_path / "imu.csv", Table("imu", columns, "rates"))
    (tmp_path / "reference.csv").write_bytes((folder / "reference.csv").read_bytes())
    return run_study(study_in(tmp_path, text))


def test_a_recording_is_judged_and_written(folder, tmp_path):
    result = run_study(study_in(folder))
    s = result.summary
    assert s["attitude"]["total_deg"]["rms"] < 3.0 and s["attitude"]["tilt_deg"]["end"] < 0.3
    assert s["attitude_smoother"]["tilt_deg"]["rms"] < s["attitude"]["tilt_deg"]["rms"]
    assert s["errors"]["filter"]["horizontal_m"] is None and s["errors"]["filter"]["roll_deg"]["rms"] < 2.0
    assert 0.1 < s["consistency"]["nees_attitude"] < 4.0 and s["consistency"]["inside_3_sigma"] > 0.98
    assert set(s["consistency"]["nis"]) == {"levelling", "magnetometer"}
    assert s["heading"] == "absolute" and s["magnetometer"]["distrusted_share"] < 0.2
    assert abs(s["magnetometer"]["dip_deg"] - np.degrees(np.arctan2(FIELD[2], FIELD[0]))) < 2.0
    out = result.write(tmp_path / "out")
    head = (out / "solution.csv").read_text().splitlines()[0]
    assert head == "time[s],roll[deg],pitch[deg],heading[deg],std_roll[deg],std_pitch[deg],std_heading[deg]"
    assert json.loads((out / "summary.json").read_text())["attitude"]["tilt_deg"]["rms"] > 0.0
    assert "<coordinates>" not in (out / "track.kml").read_text()
    page = (out / "report.html").read_text()
    for title in ("Attitude error", "Gyro biases", "Magnetometer", "Is the filter honest?"):
        assert title in page
    told = figures(result)
    assert "attitude only" in told[0] and any("filter against the reference" in line for line in told)
    assert any("gyro bias x, y, z" in line for line in told)


def test_without_magnetometer_the_heading_counts_from_the_start(folder):
    outage = '[[outage]]\nsensor = "magnetometer"\nstart_s = 0.0\nend_s = 1e6\n'
    result = run_study(study_in(folder, STUDY + outage))
    s = result.summary
    assert s["heading"] == "relative" and s["magnetometer"] is None
    assert s["attitude"]["heading_deg"]["rms"] < 15.0
    assert abs(s["heading_offset_removed_deg"]) > 1.0
    assert any("counted from the start" in n for n in result.notes)
    assert result.navigation.filter.cov_rpy[-1, 2, 2] > 10.0 * result.navigation.filter.cov_rpy[20, 2, 2]
    given = run_study(study_in(folder, STUDY + outage + "[start]\nheading_deg = 20.0\n"))
    assert given.summary["heading"] == "absolute" and any("starts at 20 deg" in n for n in given.notes)


def test_an_outage_of_the_magnetometer_is_judged_by_its_end(folder):
    outage = '[[outage]]\nsensor = "magnetometer"\nstart_s = 15.0\nend_s = 30.0\n'
    o = run_study(study_in(folder, STUDY + outage)).summary["outages"][0]
    assert o["sensor"] == "magnetometer" and o["end_s"] == 30.0
    assert o["heading_end_deg"] < 4.0 * o["heading_sigma_deg"] and o["horizontal_end_m"] is None


def test_declination_is_added_or_its_absence_is_said(folder):
    plain = run_study(study_in(folder))
    turned = run_study(study_in(folder, STUDY.replace("declination_deg = 0.0", "declination_deg = 10.0")))
    difference = turned.navigation.filter.rpy[50:, 2] - plain.navigation.filter.rpy[50:, 2]
    assert np.abs(np.mod(difference - 10.0 * DEG + np.pi, 2 * np.pi) - np.pi).max() < 0.02 * DEG
    silent = run_study(study_in(folder, STUDY.replace("declination_deg = 0.0", "")))
    assert any("counted from magnetic north" in n for n in silent.notes)
    with pytest.raises(StudyError, match="no Unix"):
        text = STUDY.replace("declination_deg = 0.0", "") + "[start]\nlat_deg = 50.0\nlon_deg = 0.0\n"
        run_study(study_in(folder, text))


def test_the_imu_section_is_heard(folder):
    text = STUDY.replace("gyro_bias_deg_per_h = 900.0", "gyro_bias_deg_per_h = 90.0")
    one, other = (run_study(study_in(folder, t)).navigation.states["gyro_bias_z"].std[0] for t in (STUDY, text))
    assert 2.0 < one / other < 11.0


def test_sensor_axes_are_turned(folder, tmp_path):
    def flip(c):
        for s in ("gyro", "accel", "mag"):
            c[f"{s}_y"], c[f"{s}_z"] = -c[f"{s}_y"], -c[f"{s}_z"]

    turned = STUDY + "[mounting]\nimu_to_body_rpy_deg = [180, 0, 0]\n"
    result = changed(folder, tmp_path, flip, turned)
    assert result.summary["attitude"]["tilt_deg"]["end"] < 0.3
    forgotten = changed(folder, tmp_path, flip)
    assert any("starts upside down" in n for n in forgotten.notes)
    assert forgotten.summary["attitude"]["tilt_deg"]["rms"] > 90.0


def test_no_gravity_is_refused(folder, tmp_path):
    def linear(c):
        for i, a in enumerate("xyz"):
            c[f"accel_{a}"] = 0.01 * np.sin((i + 1) * c["time"])

    with pytest.raises(InputError, match="gravity"):
        changed(folder, tmp_path, linear)


def test_a_field_in_other_axes_is_told(folder, tmp_path):
    def exchanged(c):
        c["mag_x"], c["mag_z"] = c["mag_z"], -c["mag_x"]

    assert any("not those of the gyros" in n for n in changed(folder, tmp_path, exchanged).notes)


def test_a_field_that_points_up_is_told(folder, tmp_path):
    from schuler.io.tables import read_table

    rec = record(40.0, 50.0, made=wandering(40.0, 2))
    up = np.einsum("nji,j->ni", rec.C, FIELD * np.array([1.0, 1.0, -1.0]))
    assert len(read_table(folder / "imu.csv", "imu")) == len(up)

    def upward(c):
        for i, a in enumerate("xyz"):
            c[f"mag_{a}"] = up[:, i]

    assert any("points up" in n for n in changed(folder, tmp_path, upward).notes)
    north = STUDY + f"[start]\nlat_deg = {np.degrees(LAT)}\n"
    assert any("so far north it points down" in n for n in changed(folder, tmp_path, upward, north).notes)


def test_a_field_of_any_size_is_told(folder, tmp_path):
    def soft_iron(c):
        c["mag_x"] = 3.0 * c["mag_x"]

    assert any("not calibrated" in n for n in changed(folder, tmp_path, soft_iron).notes)


def test_a_hard_iron_is_found_and_told(tmp_path):
    rec = record(60.0, 50.0, made=motion(60.0, swing=0.9))
    write_table(tmp_path / "imu.csv", rec.imu)
    write_table(tmp_path / "reference.csv", reference_of(rec))
    plain = run_study(study_in(tmp_path))
    assert plain.summary["magnetometer"]["hard_iron_uT"] is None

    def hard_iron(c):
        c["mag_x"], c["mag_z"] = c["mag_x"] + 15e-6, c["mag_z"] - 8e-6

    (tmp_path / "worn").mkdir()
    result = changed(tmp_path, tmp_path / "worn", hard_iron)
    np.testing.assert_allclose(result.summary["magnetometer"]["hard_iron_uT"], [15.0, 0.0, -8.0], atol=1.5)
    assert any("hard iron of" in n and "taken off" in n for n in result.notes)
    assert result.summary["attitude"]["heading_deg"]["end"] < 6.0
    assert result.summary["attitude_smoother"]["heading_deg"]["rms"] < 6.0
    assert result.summary["attitude"]["heading_deg"]["max"] > 15.0  # before it was known


def test_rows_without_numbers_and_gaps(folder, tmp_path):
    def torn(c):
        c["gyro_x"][500:540] = np.nan
        c["mag_y"][100:120] = np.nan

    result = changed(folder, tmp_path, torn)
    assert any("40 of 2000 rows left out" in n for n in result.notes)
    assert result.summary["attitude"]["total_deg"]["rms"] < 6.0
    assert np.isfinite(result.navigation.filter.rpy).all()


def test_faults_of_the_study(folder):
    with pytest.raises(StudyError, match=r"\[input\] imu: missing"):
        study_in(folder, '[study]\nname = "a"\nkind = "ahrs"\n', "none.toml")
    extra = '[camera]\nfocal_px = 1.0\n[filter]\nconstraints = ["zaru"]\nestimate = ["gyro_bias"]\n'
    notes = run_study(study_in(folder, STUDY + extra)).notes
    assert any("[camera]: not read" in n for n in notes) and any("finds rest by itself" in n for n in notes)
    assert any("always learns" in n for n in notes)


def test_an_attitude_reference_is_for_this_kind_only(folder):
    text = '[study]\nname = "b"\nkind = "strapdown"\n[input]\nimu = "imu.csv"\nreference = "reference.csv"\n'
    with pytest.raises(InputError, match="no position"):
        run_study(study_in(folder, text, "other.toml"))


# ---- judging ----


def test_errors_of_an_attitude():
    """Known rotations put on a reference that points straight up at times."""
    rng = np.random.default_rng(3)
    n = 400
    t = 0.01 * np.arange(n)
    q_true = quat_from_rotvec(np.column_stack([0.1 * t, 1.5 + 0.1 * np.sin(t), 0.3 * t]))
    phi = 0.02 * rng.standard_normal((n, 3))
    q = quat_multiply(quat_from_rotvec(-phi), q_true)
    roll, pitch, heading = euler_from_quat(q_true)
    reference = Table("reference", {"time": t, "roll": roll, "pitch": pitch, "heading": heading})
    cov = np.tile(np.eye(3) * 0.02**2, (n, 1, 1))
    e = attitude_errors(t, q, cov, reference)
    np.testing.assert_allclose(e.phi, phi, atol=1e-9)
    np.testing.assert_allclose(e.total, np.linalg.norm(phi, axis=1), atol=1e-9)
    np.testing.assert_allclose(e.tilt, np.hypot(phi[:, 0], phi[:, 1]), atol=1e-4)
    np.testing.assert_allclose(e.heading, -phi[:, 2], atol=1e-3)
    assert abs(e.nees.mean() - 1.0) < 0.1
    assert e.inside_3_sigma > 0.99


def test_a_relative_heading_loses_its_first_error():
    t = 0.01 * np.arange(50)
    q_true = quat_from_rotvec(np.column_stack([0.2 * t, 0.1 * t, t]))
    q = quat_multiply(quat_from_rotvec(np.array([0.0, 0.0, 2.0])), q_true)
    roll, pitch, heading = euler_from_quat(q_true)
    reference = Table("reference", {"time": t, "roll": roll, "pitch": pitch, "heading": heading})
    cov = np.tile(np.eye(3), (50, 1, 1))
    e = attitude_errors(t, q, cov, reference, relative=True)
    assert abs(e.offset - 2.0) < 1e-9 and e.total.max() < 1e-9
    assert attitude_errors(t, q, cov, reference).total.min() > 1.9


def test_a_reference_of_another_rate_and_with_holes():
    t = 0.01 * np.arange(1001)
    q = quat_from_rotvec(np.column_stack([0.0 * t, 0.0 * t, radians(20.0) * t]))
    for stamps in (t[::10] + 0.004, np.arange(-1.0, 11.0, 0.002)):
        C = dcm_from_rotvec(np.column_stack([0.0 * stamps, 0.0 * stamps, radians(20.0) * stamps]))
        heading = np.arctan2(C[:, 1, 0], C[:, 0, 0])
        keep = (stamps < 4.0) | (stamps > 5.0)
        columns = {"time": stamps, "roll": 0.0 * stamps, "pitch": 0.0 * stamps, "heading": heading}
        reference = Table("reference", {k: v[keep] for k, v in columns.items()})
        e = attitude_errors(t, q, np.tile(np.eye(3), (len(t), 1, 1)), reference)
        assert e.total.max() < 1e-9
        assert not ((e.time > 4.03) & (e.time < 4.97)).any()
        assert e.time[0] >= 0.0 and e.time[-1] <= 10.0
