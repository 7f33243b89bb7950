"""The commands as a user types them: what is printed, what is written, exit statuses."""

import csv
import json
import re

import numpy as np
import pytest

CONTRACT_FILES = ["report.html", "smoothed.csv", "solution.csv", "summary.json", "track.kml"]


def rows(path):
    with open(path) as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def demo(tmp_path_factory, program):
    folder = tmp_path_factory.mktemp("demo")
    return folder, program("demo", cwd=folder)


def test_demo_needs_nothing_and_says_what_a_navigator_asks(demo):
    folder, done = demo
    assert done.status == 0, done.err
    assert sorted(p.name for p in (folder / "demo-result").iterdir()) == CONTRACT_FILES
    for word in ("error at the end", "% of", "sigma", "heading", "NEES", "smoothed", "report.html"):
        assert word in done.out, done.out
    assert 8 <= len(done.out.splitlines()) <= 16


def test_demo_s_figures_are_those_of_its_summary(demo):
    folder, done = demo
    summary = json.loads((folder / "demo-result" / "summary.json").read_text())
    dive = summary["dives"][0]
    assert f"{dive['horizontal_end_m']:.1f} m" in done.out
    assert dive["horizontal_end_m"] < 5 * dive["sigma_end_m"]
    assert 500 < dive["end_s"] - dive["start_s"] < 540
    assert summary["made_by"]["seed"] == 1 and len(summary["made_by"]["study_sha256"]) == 64
    assert set(summary["errors"]["filter"]) == {
        "horizontal_m", "vertical_m", "velocity_mps", "roll_deg", "pitch_deg", "heading_deg",
    }  # fmt: skip
    assert set(summary["errors"]["filter"]["horizontal_m"]) == {"rms", "p95", "max", "end"}
    assert {"mean", "low", "high", "n"} <= set(summary["consistency"]["nis"]["gnss_position"])


def test_the_smoother_is_better_than_the_filter_over_the_dive(demo):
    folder, _ = demo
    dive = json.loads((folder / "demo-result" / "summary.json").read_text())["dives"][0]
    assert dive["smoother_max_m"] < 0.5 * dive["horizontal_max_m"]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not(demo, program, tmp_path):
    folder, _ = demo
    program("demo", "--out", tmp_path / "again")
    program("demo", "--out", tmp_path / "other", "--seed", 2)
    for name in CONTRACT_FILES:
        first = (folder / "demo-result" / name).read_bytes()
        assert first == (tmp_path / "again" / name).read_bytes(), name
    assert (tmp_path / "other" / "solution.csv").read_bytes() != (tmp_path / "again" / "solution.csv").read_bytes()


def test_run_reads_a_recording_and_writes_beside_the_study(trial, program):
    done = program("run", trial / "study.toml")
    assert done.status == 0, done.err
    out = trial / "trial-result"
    assert sorted(p.name for p in out.iterdir()) == CONTRACT_FILES
    summary = json.loads((out / "summary.json").read_text())
    assert summary["made_by"]["seed"] is None  # nothing was drawn
    assert summary["errors"]["filter"]["horizontal_m"]["rms"] < 20
    assert summary["surfacings"][0]["inside_95"] is True
    track = rows(out / "solution.csv")
    steps = np.diff([float(r["time[s]"]) for r in track])
    assert np.median(steps) == pytest.approx(0.1)


def test_an_older_result_is_replaced_and_a_folder_of_the_user_s_is_not(trial, program):
    assert program("run", trial / "study.toml").status == 0
    (trial / "trial-result" / "leftover").write_text("old")
    assert program("run", trial / "study.toml").status == 0
    assert not (trial / "trial-result" / "leftover").exists()
    mine = trial / "mine"
    mine.mkdir()
    (mine / "thesis.txt").write_text("years of work")
    done = program("run", trial / "study.toml", "--out", mine)
    assert done.status == 1 and "not a result folder" in done.err and "Traceback" not in done.err
    assert [p.name for p in mine.iterdir()] == ["thesis.txt"]


def test_an_outage_withholds_its_rows_and_is_judged(trial, program):
    text = (trial / "study.toml").read_text()
    (trial / "study.toml").write_text(text + '[[outage]]\nsensor = "gnss"\nstart_s = 30.0\nend_s = 50.0\n')
    assert program("run", trial / "study.toml").status == 0
    summary = json.loads((trial / "trial-result" / "summary.json").read_text())
    (outage,) = summary["outages"]
    assert outage["rows"] == 21
    assert outage["horizontal_end_m"] < 30 and outage["nees_half_end"] > 0
    assert outage["smoother_horizontal_max_m"] < 10
    kept = summary["consistency"]["nis"]["gnss_position"]["n"]
    text_without = program("run", trial / "study.toml", "--out", trial / "o").out
    assert "withheld 30 to 50 s" in text_without and kept < 90


def test_withheld_fixes_judge_themselves_without_a_reference(trial, program):
    text = (trial / "study.toml").read_text().replace('reference = "truth.csv"\n', "")
    (trial / "study.toml").write_text(text + '[[outage]]\nsensor = "gnss"\nstart_s = 30.0\nend_s = 50.0\n')
    assert program("run", trial / "study.toml").status == 0
    summary = json.loads((trial / "trial-result" / "summary.json").read_text())
    assert summary["errors"]["filter"]["horizontal_m"] is None
    assert summary["outages"][0]["horizontal_end_m"] is not None
    assert summary["outages"][0]["nees_half_end"] < 8


def test_what_was_withheld_was_not_seen(trial, program):
    """A wild fix inside an outage changes nothing at all."""
    text = (trial / "study.toml").read_text()
    (trial / "study.toml").write_text(text + '[[outage]]\nsensor = "gnss"\nstart_s = 30.0\nend_s = 50.0\n')
    program("run", trial / "study.toml", "--out", trial / "a")
    lines = (trial / "gnss.csv").read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("40"))
    cells = lines[at].split(",")
    cells[1] = str(float(cells[1]) + 0.01)
    lines[at] = ",".join(cells)
    (trial / "gnss.csv").write_text("\n".join(lines) + "\n")
    program("run", trial / "study.toml", "--out", trial / "b")
    assert (trial / "a" / "solution.csv").read_bytes() == (trial / "b" / "solution.csv").read_bytes()


@pytest.mark.parametrize("method", ["paper", "paper-literal"])
def test_the_paper_s_methods_run_too(trial, program, method):
    text = (trial / "study.toml").read_text()
    (trial / "study.toml").write_text(text + f'[filter]\nmethod = "{method}"\n')
    done = program("run", trial / "study.toml")
    assert done.status == 0, done.err
    files = sorted(p.name for p in (trial / "trial-result").iterdir())
    assert files == [f for f in CONTRACT_FILES if f != "smoothed.csv"]


def test_every_epoch_where_asked(trial, program):
    text = (trial / "study.toml").read_text()
    (trial / "study.toml").write_text(text + '[output]\nrate_hz = "imu"\n')
    assert program("run", trial / "study.toml").status == 0
    time = [float(r["time[s]"]) for r in rows(trial / "trial-result" / "solution.csv")]
    assert np.median(np.diff(time)) == pytest.approx(0.02)


def test_a_turned_imu_gives_the_same_track(trial, program):
    """A forward-left-up IMU with its mounting given is the same IMU."""
    program("run", trial / "study.toml", "--out", trial / "a")
    lines = (trial / "imu.csv").read_text().splitlines()
    names = lines[0].split(",")
    flip = [i for i, n in enumerate(names) if re.match(r"(gyro|accel)_[yz]", n)]
    turned = [lines[0]]
    for line in lines[1:]:
        cells = line.split(",")
        for i in flip:
            cells[i] = cells[i][1:] if cells[i].startswith("-") else "-" + cells[i]
        turned.append(",".join(cells))
    (trial / "imu.csv").write_text("\n".join(turned) + "\n")
    done = program("run", trial / "study.toml", "--out", trial / "b")
    assert done.status == 1 and "imu_to_body_rpy_deg = [180, 0, 0]" in done.err
    text = (trial / "study.toml").read_text()
    (trial / "study.toml").write_text(text + "[mounting]\nimu_to_body_rpy_deg = [180, 0, 0]\n")
    assert program("run", trial / "study.toml", "--out", trial / "b").status == 0
    a, b = (np.loadtxt(trial / f / "solution.csv", delimiter=",", skiprows=1) for f in "ab")
    np.testing.assert_allclose(a, b, atol=1e-5)


def test_published_as_json(program, tmp_path, monkeypatch):
    import schuler.published.ledger as ledger

    row = ledger.Row("auv", "Table 3", "error", "m", 340.0, 360.7, ledger.CORRECTED, "its own coordinates")
    monkeypatch.setattr(ledger, "ledger", lambda source=None, progress=None: [row])
    done = program("published", "auv", "--json", tmp_path / "p.json")
    assert done.status == 0 and "Table 3" in done.out
    (told,) = json.loads((tmp_path / "p.json").read_text())
    assert set(told) == {
        "source", "where", "quantity", "unit", "published", "ours", "relative_difference", "verdict", "reason",
    }  # fmt: skip


def test_help_and_version(program):
    done = program("--help")
    assert done.status == 0
    for command in ("demo", "run", "check", "convert", "published", "bench", "warmup"):
        assert f"\n  {command} " in done.out
    assert re.fullmatch(r"schuler \d+\.\d+\.\d+\n", program("--version").out)


@pytest.mark.parametrize(
    "arguments",
    [["rn", "x.toml"], ["run"], ["run", "x.toml", "--sed", "3"], ["demo", "--seed", "three"], ["published", "nothing"]],
)
def test_wrong_usage_is_status_2_with_a_sentence(program, arguments, tmp_path):
    done = program(*arguments, cwd=tmp_path)
    assert done.status == 2 and done.err.strip() and "Traceback" not in done.err
    assert list(tmp_path.iterdir()) == []


def test_every_kind_of_the_contract_is_built_and_another_is_refused():
    from schuler.ground.errors import StudyError
    from schuler.studies.run import built_kinds, runner_of

    assert set(built_kinds()) == {"auv", "aided", "ahrs", "planar", "strapdown", "platform"}
    with pytest.raises(StudyError, match="not built yet"):
        runner_of("submarine")


def test_an_error_inside_the_program_is_a_sentence_and_debug_shows_it(program, trial, monkeypatch):
    import schuler.aiding.auv as auv

    def broken(tables, settings):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(auv, "navigate", broken)
    done = program("run", trial / "study.toml")
    assert done.status == 1 and "ZeroDivisionError" in done.err and "Traceback" not in done.err
    with pytest.raises(ZeroDivisionError):
        program("--debug", "run", trial / "study.toml")
    assert not (trial / "trial-result").exists()


def test_a_stop_by_the_user_leaves_nothing(program, trial, monkeypatch):
    import schuler.io.results as results

    def stopped(*_, **__):
        raise KeyboardInterrupt

    before = sorted(p.name for p in trial.iterdir())
    monkeypatch.setattr(results, "kml_text", stopped)  # half the files are written by then
    done = program("run", trial / "study.toml")
    assert done.status == 130 and "nothing was written" in done.err
    assert sorted(p.name for p in trial.iterdir()) == before


def test_a_pipe_sees_no_progress(program, tmp_path):
    done = program("run", tmp_path / "nope.toml", inside=False)
    assert done.status == 2 and "\x1b" not in done.err + done.out and len(done.err.splitlines()) == 1


@pytest.mark.slow
def test_help_is_quick():
    import statistics
    import subprocess
    import sys
    import time

    def seconds(code):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
        return time.perf_counter() - start

    for _ in range(4):  # a busy machine gets another chance
        code = "import sys; sys.argv = ['schuler', '--help']; from schuler.cli import main; main()"
        if statistics.median(seconds(code) for _ in range(3)) < 0.6:
            return
    pytest.fail("schuler --help takes more than 0.6 s")


def test_a_sweep_judges_many_outages(trial, program):
    with open(trial / "study.toml", "a") as file:
        file.write("[sweep]\nlength_s = [10, 500]\nsettle_s = 10\n")
    done = program("run", trial / "study.toml")
    assert done.status == 0, done.err
    short, long = json.loads((trial / "trial-result" / "summary.json").read_text())["sweep"]
    assert {"length_s", "windows", "filter_end_m", "smoother_max_m", "nees_half"} <= set(short)
    assert len(short["entries"]) == short["windows"]
    assert short["windows"] >= 3 and 0 < short["filter_end_m"]["p50"] <= short["filter_end_m"]["p95"] < 30
    assert long["windows"] == 0 and long["filter_end_m"]["p50"] is None
    assert "no outage fits" in done.out and "outages of 10 s" in done.out
