"""A reference on another clock, latitude and longitude the wrong way round, sigmas ten times too small: as typed."""

import json
import re

import pytest

from schuler.ground.tables import Table
from schuler.io.tables import read_table, write_table


def exchange(path):
    text = path.read_text()
    head, rest = text.split("\n", 1)
    swap = {"lat[deg]": "lon[deg]", "lon[deg]": "lat[deg]"}
    path.write_text(",".join(swap.get(h, h) for h in head.split(",")) + "\n" + rest)


def late(path, delay):
    table = read_table(path, "reference")
    write_table(path, Table("reference", {**table.columns, "time": table.time + delay}))


def notes(done):
    return [line for line in done.out.splitlines() if line.startswith("note:")]


def test_a_reference_on_gps_time_is_told_and_what_is_typed_mends_it(trial, program):
    late(trial / "truth.csv", 18.0)
    done = program("run", "study.toml", cwd=trial)
    (note,) = [n for n in notes(done) if "reference_delay_s" in n]
    assert "truth.csv" in note and "late" in note and "between GPS time and UTC" in note
    assert not any("NEES" in n for n in notes(done))  # the reference is what is wrong
    wrong = json.loads((trial / "trial-result" / "summary.json").read_text())
    typed = re.search(r"reference_delay_s = \S+", note)[0]
    with open(trial / "study.toml", "a") as file:
        file.write(typed + "\n")  # [input] is the last section
    done = program("run", "study.toml", cwd=trial)
    right = json.loads((trial / "trial-result" / "summary.json").read_text())
    assert done.status == 0 and not any("late" in n for n in notes(done))
    assert any("as [input] reference_delay_s says" in n for n in notes(done))
    rms = [s["errors"]["smoother"]["horizontal_m"]["rms"] for s in (wrong, right)]
    assert rms[1] < 0.1 * rms[0]


def test_the_sign_of_the_delay(trial, program):
    """A row stamped t belongs to t - delay: with the delay that was added, errors are as before."""
    program("run", "study.toml", "--out", "as-it-was", cwd=trial)
    late(trial / "truth.csv", 2.5)
    with open(trial / "study.toml", "a") as file:
        file.write("reference_delay_s = 2.5\n")
    program("run", "study.toml", "--out", "mended", cwd=trial)
    a, b = (json.loads((trial / f / "summary.json").read_text())["errors"]["filter"] for f in ("as-it-was", "mended"))
    assert b["horizontal_m"]["rms"] == pytest.approx(a["horizontal_m"]["rms"], rel=1e-6)


def test_a_reference_that_shares_no_time_is_found_by_its_track(trial, program):
    late(trial / "truth.csv", 315964782.0)
    done = program("run", "study.toml", cwd=trial)
    assert done.status == 0
    said = "\n".join(notes(done))
    assert "nothing is judged against it" in said and "reference_delay_s = 315964782" in said


def test_fixes_with_lat_and_lon_exchanged_are_refused(trial, program):
    exchange(trial / "gnss.csv")
    done = program("run", "study.toml", cwd=trial)
    assert done.status == 1 and "lat and lon look exchanged" in done.err and "v_north" in done.err
    assert len(done.err.strip().splitlines()) == 1
    gnss = read_table(trial / "gnss.csv", "gnss")
    keep = [k for k in gnss.columns if "v_" not in k]  # without velocities the start tells
    write_table(trial / "gnss.csv", Table("gnss", {k: gnss[k] for k in keep}))
    with open(trial / "study.toml", "a") as file:
        file.write("[start]\nlat_deg = 36.73\nlon_deg = 52.65\n")
    done = program("run", "study.toml", cwd=trial)
    assert done.status == 1 and "from [start] lat_deg, lon_deg" in done.err


def test_a_reference_with_lat_and_lon_exchanged_gets_a_note(trial, program):
    exchange(trial / "truth.csv")
    done = program("run", "study.toml", cwd=trial)
    assert done.status == 0
    assert any("truth.csv: lat and lon look exchanged" in n for n in notes(done))
    assert not any("NEES" in n for n in notes(done))


def test_sigmas_ten_times_too_small_are_said_so(trial, program):
    gnss = read_table(trial / "gnss.csv", "gnss")
    columns = {k: v / 10.0 if k.startswith("std_") else v for k, v in gnss.columns.items()}
    write_table(trial / "gnss.csv", Table("gnss", columns))
    done = program("run", "study.toml", cwd=trial)
    (note,) = [n for n in notes(done) if "sigmas of gnss_position" in n]
    factor = float(re.search(r"about (\d+) times too small", note)[1])
    assert 6 <= factor <= 14 and "multiply the std_ columns of the gnss table" in note
