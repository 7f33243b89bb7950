"""What bad input gets: a clear sentence, exit status 1 or 2, no traceback, nothing written."""

import gzip
import re

import pytest


def edit(file, change, header=None):
    """Rewrites a CSV: header(names) and change(i, cells) -> cells or None to leave the row out."""
    lines = file.read_text().splitlines()
    names = lines[0].split(",")
    out = [",".join(header(names) if header else names)]
    for i, line in enumerate(lines[1:]):
        cells = change(i, line.split(","))
        if cells is not None:
            out.append(",".join(cells))
    file.write_text("\n".join(out) + "\n")


def scaled(stem, factor, names):
    at = [i for i, n in enumerate(names) if n.startswith(stem)]

    def change(i, cells):
        for k in at:
            cells[k] = repr(float(cells[k]) * factor)
        return cells

    return change


def names_of(file):
    return file.read_text().splitlines()[0].split(",")


def refused(program, trial, *said, status=1, sentences=1):
    """The run fails as it should, and says all of that."""
    before = sorted(p.name for p in trial.iterdir())
    done = program("run", trial / "study.toml")
    assert done.status == status, done.out + done.err
    assert "Traceback" not in done.err + done.out
    assert len(done.err.strip().splitlines()) == sentences, done.err
    for word in said:
        assert re.search(word, done.err), done.err
    assert sorted(p.name for p in trial.iterdir()) == before  # no folder, no leftovers
    return done.err


def used(program, trial, *said):
    """The run does what it can and says what was left out."""
    done = program("run", trial / "study.toml")
    assert done.status == 0, done.err
    for word in said:
        assert re.search(word, done.out), done.out
    return done.out


# ---- columns and units ----


def test_missing_column(program, trial):
    edit(trial / "imu.csv", lambda i, c: [*c[:3], *c[4:]], lambda n: [*n[:3], *n[4:]])
    refused(program, trial, r"imu\.csv", "gyro_z", "missing")


def test_missing_unit_that_can_be_known_is_said(program, trial):
    edit(trial / "gnss.csv", lambda i, c: c, lambda n: [x.split("[")[0] for x in n])
    used(program, trial, r"gnss\.csv.*taken as deg")


def test_wrong_unit_in_the_header(program, trial):
    edit(trial / "imu.csv", lambda i, c: c, lambda n: [x.replace("accel_x[m/s^2]", "accel_x[kg]") for x in n])
    refused(program, trial, r"imu\.csv", "kg")


def test_force_in_g_under_a_heading_of_metres(program, trial):
    file = trial / "imu.csv"
    edit(file, scaled("accel", 1 / 9.80665, names_of(file)))
    refused(program, trial, r"imu\.csv", "accel", r"\bg\b", "accel-unit g|accel_unit")


def test_degrees_where_radians_were_meant(program, trial):
    file = trial / "imu.csv"
    edit(file, scaled("gyro", 57.29578, names_of(file)))
    done = program("run", trial / "study.toml")
    assert done.status == 1 and re.search(r"imu\.csv.*deg/s", done.err), done.out + done.err
    assert not (trial / "trial-result").exists()


def test_force_far_from_g(program, trial):
    file = trial / "imu.csv"
    edit(file, scaled("accel", 0.3, names_of(file)))
    refused(program, trial, r"imu\.csv", "9\\.8|gravity|counts")


def test_gravity_on_the_wrong_axis(program, trial):
    swap = {"accel_x": "accel_z", "accel_z": "accel_x"}

    def header(names):
        return [swap.get(n.split("[")[0], n.split("[")[0]) + n[n.index("[") :] for n in names]

    edit(trial / "imu.csv", lambda i, c: c, header)
    refused(program, trial, "imu_to_body_rpy_deg")


def test_latitude_that_is_none(program, trial):
    file = trial / "gnss.csv"
    edit(file, scaled("lat", 10.0, names_of(file)))
    refused(program, trial, r"gnss\.csv", "lat")


# ---- numbers and times ----


def test_nan_rows_are_left_out_and_counted(program, trial):
    edit(trial / "speed.csv", lambda i, c: [c[0], "nan"] if i in (5, 6) else c)
    used(program, trial, r"speed\.csv: 2 of 210 rows left out")


def test_a_column_that_is_all_nan(program, trial):
    edit(trial / "imu.csv", lambda i, c: [*c[:2], "nan", *c[3:]])
    refused(program, trial, r"imu\.csv")


def test_text_where_numbers_were_expected(program, trial):
    edit(trial / "depth.csv", lambda i, c: [c[0], "deep"] if i == 7 else c)
    done = program("run", trial / "study.toml")
    assert "depth.csv" in done.err + done.out and "Traceback" not in done.err


def test_time_that_runs_backwards(program, trial):
    lines = (trial / "imu.csv").read_text().splitlines()
    half = len(lines) // 2
    (trial / "imu.csv").write_text("\n".join([lines[0], *lines[half:], *lines[1:half]]) + "\n")
    refused(program, trial, r"imu\.csv", "time|clock|back")


def test_repeated_rows_are_left_out_and_counted(program, trial):
    lines = (trial / "imu.csv").read_text().splitlines()
    lines.insert(200, lines[199])
    (trial / "imu.csv").write_text("\n".join(lines) + "\n")
    used(program, trial, r"imu\.csv.*(repeat|same time|duplicate)")


def test_a_gap_is_told_and_survived(program, trial):
    edit(trial / "imu.csv", lambda i, c: None if 5000 <= i < 5150 else c)
    used(program, trial, r"imu\.csv.*gap")


def test_a_clock_that_falls_back_by_a_gps_week(program, trial):
    edit(trial / "gnss.csv", lambda i, c: [repr(float(c[0]) - 604800.0), *c[1:]] if i >= 30 else c)
    used(program, trial, r"gnss\.csv.*week")


def test_times_that_do_not_overlap(program, trial):
    edit(trial / "gnss.csv", lambda i, c: [repr(float(c[0]) + 5000.0), *c[1:]])
    refused(program, trial, r"gnss\.csv runs from 500\d\.\d to", r"imu\.csv from 0\.0 to 210", "do not overlap")


def test_a_reference_that_does_not_overlap_is_left_out(program, trial):
    edit(trial / "truth.csv", lambda i, c: [repr(float(c[0]) + 5000.0), *c[1:]])
    used(program, trial, r"truth\.csv runs from .* nothing is judged")


def test_two_tables_off_the_clock_are_told_together(program, trial):
    for name in ("gnss", "speed"):
        edit(trial / f"{name}.csv", lambda i, c: [repr(float(c[0]) + 5000.0), *c[1:]])
    refused(program, trial, "gnss", "speed", sentences=2)


def test_an_outage_where_nothing_is(program, trial):
    with open(trial / "study.toml", "a") as file:
        file.write('[[outage]]\nsensor = "gnss"\nstart_s = 900\nend_s = 950\n')
        file.write('[[outage]]\nsensor = "dvl"\nstart_s = 1\nend_s = 2\n')
    refused(program, trial, "no gnss row lies from 900 to 950 s", "there is no dvl to withhold", sentences=2)


# ---- files ----


@pytest.mark.parametrize("name", ["imu", "gnss", "speed"])
def test_an_empty_file(program, trial, name):
    (trial / f"{name}.csv").write_text("")
    refused(program, trial, rf"{name}\.csv", "empty|no rows|nothing")


def test_a_header_and_nothing_else(program, trial):
    (trial / "imu.csv").write_text((trial / "imu.csv").read_text().splitlines()[0] + "\n")
    refused(program, trial, r"imu\.csv")


def test_a_truncated_archive(program, trial):
    data = gzip.compress((trial / "imu.csv").read_bytes())
    (trial / "imu.csv.gz").write_bytes(data[: len(data) // 2])
    text = (trial / "study.toml").read_text().replace("imu.csv", "imu.csv.gz")
    (trial / "study.toml").write_text(text)
    refused(program, trial, r"imu\.csv\.gz")


def test_a_last_line_that_was_cut(program, trial):
    text = (trial / "imu.csv").read_text()
    (trial / "imu.csv").write_text(text[:-30])
    done = program("run", trial / "study.toml")
    assert done.status in (0, 1) and "imu.csv" in done.out + done.err and "Traceback" not in done.err


def test_a_picture_for_a_table(program, trial):
    (trial / "gnss.csv").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 40)
    refused(program, trial, r"gnss\.csv")


def test_two_bad_tables_are_told_together(program, trial):
    (trial / "gnss.csv").write_text("")
    (trial / "speed.csv").write_text("")
    refused(program, trial, "gnss", "speed", sentences=2)


def test_one_row_of_imu(program, trial):
    lines = (trial / "imu.csv").read_text().splitlines()
    (trial / "imu.csv").write_text("\n".join(lines[:2]) + "\n")
    refused(program, trial, r"imu\.csv.*one row")


def test_nothing_to_start_from(program, trial):
    """One fix without velocity, long before anything moves: no heading can be known."""
    edit(trial / "gnss.csv", lambda i, c: c[:3] if i == 3 else None, lambda n: n[:3])
    done = program("run", trial / "study.toml")
    assert done.status == 1 and "start" in done.err and "Traceback" not in done.err
    assert not (trial / "trial-result").exists()


# ---- the study file and the place of the result ----


def test_a_study_with_several_faults(program, trial):
    (trial / "study.toml").write_text(
        '[study]\nname = "x"\nkind = "auv"\n[input]\nimu = "imu.csv"\ngnss = "gnss.csv"\ndepht = "depth.csv"\n'
        '[noise]\nspeed_mps = "0.05 kn"\n[filter]\nmethod = "best"\n'
    )
    said = (r"\[input\] depht.*did you mean depth", r"\[noise\] speed_mps.*m/s", r"\[filter\] method")
    refused(program, trial, *said, status=2, sentences=3)


def test_a_study_that_is_no_toml(program, trial):
    (trial / "study.toml").write_text("[study\nname = x")
    refused(program, trial, "line 1", status=2)


def test_an_imu_that_is_not_known(program, trial):
    with open(trial / "study.toml", "a") as file:
        file.write('[imu]\npreset = "3dm"\n')
    refused(program, trial, "3dm-gx3-25", status=2)


def test_a_mission_that_cannot_be(program, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('[study]\nname = "x"\nkind = "auv"\n[mission]\ndive_s = 60\ndepth_m = 500\n')
    refused(program, tmp_path, "too short", "500", status=2)


def test_a_place_that_cannot_be_written(program, trial):
    (trial / "file").write_text("x")
    done = program("run", trial / "study.toml", "--out", trial / "file" / "deeper")
    assert done.status == 1 and "cannot be written" in done.err and "Traceback" not in done.err
