"""calibrate and allan as a user types them: files, page, sentences."""

import json

import numpy as np
import pytest

from conftest import schuler
from schuler.ground.tables import Table
from schuler.io.tables import read_table, write_table
from schuler.truth.turntable import THESIS_PLAN, Turntable, positions_table

LEVERS = np.array([[28.08, -14.2, 9.3], [5.0, 31.0, -22.0], [-11.0, 8.0, -66.51]]) * 1e-3
PLAN = """
[plan]
name = "bench"
kind = "turntable"
lat_deg = 50.0
{more}
[input]
imu = "imu.csv"
positions = "positions.csv"
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with a turntable plan and its recording."""
    folder = tmp_path_factory.mktemp("bench")
    positions = positions_table(THESIS_PLAN, still_s=8.0, spin_s=37.0, move_s=2.0)
    table = Turntable(LEVERS, bias=0.02, noise=2e-3, gyro_noise=1e-3, latitude=np.deg2rad(50.0))
    write_table(folder / "imu.csv", table.record(positions, 20.0))
    write_table(folder / "positions.csv", positions)
    (folder / "plan.toml").write_text(PLAN.format(more=""))
    return folder


def test_turntable_from_files_to_correction_file(bench, tmp_path):
    done = schuler("calibrate", bench / "plan.toml", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    told = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert {"plan", "made_by", "parameters", "covariance", "residual_rms_mps2", "holdout_rms_mps2", "condition"} <= set(
        told
    )
    names = [p["name"] for p in told["parameters"]]
    assert names[:3] == ["accel_x_lever_x_mm", "accel_x_lever_y_mm", "accel_x_lever_z_mm"]
    for p, true in zip(told["parameters"], 1e3 * LEVERS.ravel(), strict=True):
        assert p["observable"] and p["unit"] == "mm"
        assert abs(p["value"] - true) < 4.5 * p["std"]
    assert np.sqrt(np.diag(told["covariance"])) == pytest.approx([p["std"] for p in told["parameters"]])
    assert told["condition"] == pytest.approx(5.79, abs=0.01)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "accel_x_lever_x_mm" in page and "https://" not in page
    again = schuler("calibrate", bench / "plan.toml", "--out", tmp_path / "out")
    assert again.status == 0


def test_design_gives_a_positions_table_that_calibrate_reads(bench, tmp_path):
    done = schuler("calibrate", bench / "plan.toml", "--design", 4, "--out", tmp_path / "d")
    assert done.status == 0, done.err
    assert "one more" in done.out and "thesis" in done.out
    table = read_table(tmp_path / "d" / "design.csv", "positions")
    assert len(set(table["position"])) == 4
    assert set(table["kind"]) == {"still", "spin"}
    assert (tmp_path / "d" / "report.html").exists()


def test_what_cannot_be_seen_is_null_and_named(bench, tmp_path):
    table = read_table(bench / "positions.csv", "positions")
    few = table.where(np.isin(table["position"], ["1", "2"]))
    for name in ("imu.csv",):
        (tmp_path / name).write_bytes((bench / name).read_bytes())
    write_table(tmp_path / "positions.csv", few)
    (tmp_path / "plan.toml").write_text(PLAN.format(more=""))
    done = schuler("calibrate", tmp_path / "plan.toml", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    told = json.loads((tmp_path / "out" / "calibration.json").read_text())
    hidden = [p for p in told["parameters"] if not p["observable"]]
    assert "accel_x_lever_z_mm" in [p["name"] for p in hidden]
    assert all(p["value"] is None and p["std"] is None for p in hidden)
    assert told["condition"] is None
    assert "accel_x_lever_z: not observable with these positions; add gamma" in done.out


@pytest.mark.parametrize(
    ("text", "status", "words"),
    [
        ("", 2, ["[plan] is absent"]),
        ('[plan]\nname = "a"\nkind = "turntabel"', 2, ["turntable", "multiposition"]),
        ('[plan]\nname = "a"\nkind = "turntable"\ngravity = 9.8', 2, ["gravity_mps2"]),
        ('[plan]\nname = "a"\nkind = "turntable"', 2, ["positions is absent"]),
        ('[plan]\nname = "a"\nkind = "multiposition"', 2, ["imu is absent"]),
        ('[plan]\nname = "a"\nkind = "multiposition"\n[input]\nimu = "no.csv"', 2, ["no.csv", "does not exist"]),
    ],
)
def test_faults_of_the_plan(tmp_path, text, status, words):
    (tmp_path / "plan.toml").write_text(text)
    done = schuler("calibrate", tmp_path / "plan.toml", "--out", tmp_path / "out")
    assert done.status == status
    assert all(w in done.err for w in words), done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "out").exists()


def test_design_needs_a_table(tmp_path):
    (tmp_path / "plan.toml").write_text('[plan]\nname = "a"\nkind = "multiposition"')
    done = schuler("calibrate", tmp_path / "plan.toml", "--design", 3)
    assert done.status == 2 and "turntable" in done.err


def still(n=20_000, rate=50.0):
    rng = np.random.default_rng(1)
    columns = {"time": np.arange(1, n + 1) / rate}
    for a in "xyz":
        columns[f"gyro_{a}"] = 1e-3 * np.sqrt(rate) * rng.standard_normal(n)
        columns[f"accel_{a}"] = 2e-3 * np.sqrt(rate) * rng.standard_normal(n) - 9.81 * (a == "z")
    return Table("imu", columns, "rates")


def test_allan_of_a_still_recording(tmp_path):
    write_table(tmp_path / "still.csv", still())
    done = schuler("allan", tmp_path / "still.csv", "--tau", "0.1,1,10", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    told = json.loads((tmp_path / "out" / "allan.json").read_text())
    assert told["rate_hz"] == 50.0
    gyro, accel = told["sensors"]["gyro_x"], told["sensors"]["accel_z"]
    assert gyro["unit"] == "deg/h" and accel["unit"] == "ug"
    assert gyro["tau_s"] == [0.1, 1.0, 10.0]
    assert gyro["adev"][1] == pytest.approx(np.rad2deg(1e-3) * 3600.0, rel=0.05)
    assert gyro["low"][1] < gyro["adev"][1] < gyro["high"][1]
    assert gyro["fit"]["arw_deg_per_sqrt_h"] == pytest.approx(np.rad2deg(1e-3) * 60.0, rel=0.03)
    assert accel["fit"]["vrw_mps_per_sqrt_h"] == pytest.approx(2e-3 * 60.0, rel=0.03)
    assert gyro["fit"]["rrw_deg_per_h_per_sqrt_h"] is None
    assert gyro["fit"]["bias_instability_deg_per_h"] is None
    assert {"quantisation", "ramp", "correlated", "arw_deg_per_sqrt_h_low"} <= set(gyro["fit"])


def test_the_imu_section_is_a_study_s(tmp_path):
    from schuler.studies.model import parse_study

    write_table(tmp_path / "still.csv", still())
    assert schuler("allan", tmp_path / "still.csv", "--out", tmp_path / "out").status == 0
    import tomllib

    section = tomllib.loads((tmp_path / "out" / "imu.toml").read_text())
    study = parse_study({"study": {"name": "a", "kind": "strapdown"}, **section})
    assert study.imu.gyro_arw_deg_per_sqrt_h[0] == pytest.approx(np.rad2deg(1e-3) * 60.0, rel=0.03)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--tau", "1,x"], ["x", "--tau 0.1,1,10"]),
        (["--tau", "1000"], ["needs more than 2000 s"]),
        (["--tau", "0.001"], ["shorter than a sample"]),
        (["--kind", "adev"], ["oadev, mdev, hdev"]),
    ],
)
def test_faults_of_allan(tmp_path, arguments, words):
    write_table(tmp_path / "still.csv", still(4000))
    done = schuler("allan", tmp_path / "still.csv", *arguments, "--out", tmp_path / "out")
    assert done.status in (1, 2)
    assert all(w in done.err for w in words), done.err
    assert not (tmp_path / "out").exists()


def test_a_recording_that_moved_and_one_with_gaps_are_told(tmp_path):
    table = still()
    table.columns["gyro_x"][9000:9500] += 0.5
    keep = np.ones(len(table), dtype=bool)
    keep[15000:15500] = False
    keep[100] = False
    write_table(tmp_path / "a.csv", table.where(keep))
    done = schuler("allan", tmp_path / "a.csv", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    assert "not at rest all the time" in done.out
    assert "1 gaps" in done.out or "1 gap" in done.out
    assert "bridged" in done.out


@pytest.mark.slow
def test_a_study_applies_its_calibration(tmp_path):
    parameters = [
        {
            "name": f"accel_{a}_lever_{b}_mm",
            "unit": "mm",
            "value": 10.0 * (i + 2 * j - 3),
            "std": 0.1,
            "observable": True,
        }
        for i, a in enumerate("xyz")
        for j, b in enumerate("xyz")
    ]
    (tmp_path / "calibration.json").write_text(json.dumps({"plan": "known", "parameters": parameters}))
    levers = "\n".join(
        f"accel_{a}_lever_mm = [{', '.join(str(10.0 * (i + 2 * j - 3)) for j in range(3))}]"
        for i, a in enumerate("xyz")
    )
    study = """
[study]
name = "{name}"
kind = "strapdown"
[start]
lat_deg = 50.0
[trajectory]
preset = "oscillation"
duration_s = 5.0
rate_hz = 2000
speed_mps = 0.0
swing_deg = [0.1, 0.1, 0.1]
swing_hz = 30.0
[imu]
{levers}
{more}
[filter]
vertical = "held"
"""
    errors = {}
    for name, more in (("without", ""), ("with", 'calibration = "calibration.json"')):
        (tmp_path / f"{name}.toml").write_text(study.format(name=name, levers=levers, more=more))
        done = schuler("run", tmp_path / f"{name}.toml", "--out", tmp_path / name)
        assert done.status == 0, done.err
        summary = json.loads((tmp_path / name / "summary.json").read_text())
        errors[name] = summary["errors"]["filter"]["horizontal_m"]["end"]
    assert errors["with"] < 0.02 * errors["without"]
    (tmp_path / "calibration.json").write_text("{}")
    done = schuler("run", tmp_path / "with.toml", "--out", tmp_path / "x")
    assert done.status == 1 and "not a calibration" in done.err


@pytest.mark.slow
@pytest.mark.data
def test_gyros_with_swapped_axes_are_refused(data_folder, tmp_path):
    import gzip

    with gzip.open(data_folder / "calib_mpu9150_rotations" / "imu1.log.gz") as file:
        rows = np.loadtxt(file)
    columns = {"time": np.arange(1, len(rows) + 1) / 100.0}
    columns |= {f"accel_{a}": rows[:, i] for i, a in enumerate("xyz")}
    columns |= {"gyro_x": rows[:, 4], "gyro_y": -rows[:, 3], "gyro_z": rows[:, 5]}
    write_table(tmp_path / "imu.csv", Table("imu", columns, "rates"))
    (tmp_path / "plan.toml").write_text('[plan]\nname = "a"\nkind = "multiposition"\n[input]\nimu = "imu.csv"\n')
    done = schuler("calibrate", tmp_path / "plan.toml", "--out", tmp_path / "out")
    assert done.status == 1
    assert "axes swapped or flipped; with the gyros taken as (-y, x, z)" in done.err
    assert not (tmp_path / "out").exists()
