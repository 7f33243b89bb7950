"""Kind "ahrs" as typed: a run, its folder, and one sentence for what cannot be."""

import json

import numpy as np
import pytest

from ahrs_motion import motion, record
from schuler.ground.tables import Table
from schuler.io.writing import write_table

STUDY = '[study]\nname = "hand"\nkind = "ahrs"\n[input]\nimu = "imu.csv"\n'


@pytest.fixture
def folder(tmp_path):
    write_table(tmp_path / "imu.csv", record(10.0, 50.0, made=motion(10.0)).imu)
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path


def test_run(program, folder):
    done = program("run", folder / "study.toml")
    assert done.status == 0, done.err
    assert "attitude only" in done.out and "counted from magnetic north" in done.out
    out = folder / "hand-result"
    told = json.loads((out / "summary.json").read_text())
    assert told["study"]["kind"] == "ahrs" and told["attitude"] is None
    assert (out / "smoothed.csv").exists() and (out / "report.html").stat().st_size > 1e5
    head = (out / "solution.csv").read_text().splitlines()[0]
    assert "lat" not in head and "std_heading[deg]" in head


def test_no_imu(program, folder):
    (folder / "study.toml").write_text('[study]\nname = "hand"\nkind = "ahrs"\n', encoding="utf-8")
    done = program("run", folder / "study.toml")
    assert done.status == 2 and "[input] imu: missing" in done.err and len(done.err.splitlines()) == 1


def test_gravity_taken_out(program, folder):
    imu = record(10.0, 50.0, made=motion(10.0)).imu
    columns = {k: v - np.mean(v) if k.startswith("accel") else v for k, v in imu.columns.items()}
    write_table(folder / "imu.csv", Table("imu", columns, "rates"))
    done = program("run", folder / "study.toml")
    assert done.status == 1 and "gravity" in done.err and "Traceback" not in done.err
    assert not (folder / "hand-result").exists()
