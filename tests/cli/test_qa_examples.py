"""The example studies on recordings that are not quite the ones they were made on."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path

import pytest

from schuler.io.convert import convert

pytestmark = pytest.mark.data
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def prepare(name, data, out):
    """Runs examples/NAME/prepare.py DATA OUT in this process."""
    spec = importlib.util.spec_from_file_location("prepare", EXAMPLES / name / "prepare.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    before, sys.argv = sys.argv, ["prepare.py", str(data), str(out)]
    try:
        return module.main()
    finally:
        sys.argv = before


def dives(data_folder, to, numbers, kinds=("eng", "flightmodel", "gps", "meta")):
    to.mkdir()
    for file in (data_folder / "glider_seaglider_sg171").glob("dive*"):
        if int(file.name[4:7]) in numbers and file.name[8:].split(".")[0] in kinds:
            shutil.copy(file, to)
    return to


def run(program, out):
    done = program("run", out / "study.toml")
    assert done.status == 0, done.err
    return done.out, json.loads((out / "seaglider-result" / "summary.json").read_text())


def test_three_dives_alone(program, data_folder, tmp_path):
    source = dives(data_folder, tmp_path / "data", {102, 103, 104})
    assert prepare("seaglider", source, tmp_path / "out") == 0
    _, told = run(program, tmp_path / "out")
    seen = told["surfacings"]
    assert len(seen) == 3 and all(s["inside_95"] for s in seen)
    assert all(s["sigma_major_m"] < 300.0 and s["miss_m"] < 220.0 for s in seen[1:])


def test_one_netcdf_file_of_any_name(program, data_folder, tmp_path):
    shutil.copy(data_folder / "glider_seaglider_sg171" / "p1710100.nc", tmp_path / "mission.nc")
    assert prepare("seaglider", tmp_path / "mission.nc", tmp_path / "out") == 0
    _, told = run(program, tmp_path / "out")
    assert [s["inside_95"] for s in told["surfacings"]] == [True]


def test_dives_without_flight_model_or_variation(program, data_folder, tmp_path, capsys):
    source = dives(data_folder, tmp_path / "data", {103, 104}, ("eng", "gps"))
    assert prepare("seaglider", source, tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "has no speed: taken out of study.toml" in said and "written as heading_mag" in said
    out, told = run(program, tmp_path / "out")
    assert "declination -1.1 deg" in out
    assert all(s["inside_95"] for s in told["surfacings"])


def test_a_dive_without_variation_takes_that_of_the_others(data_folder, tmp_path):
    source = dives(data_folder, tmp_path / "data", {103, 104})
    (source / "dive104_meta.csv").unlink()
    report = convert(source, tmp_path / "out")
    assert any("1 of 2 dives do not say theirs" in n for n in report.notes)
    assert "heading[deg]" in (tmp_path / "out" / "attitude.csv").read_text().splitlines()[0]


@pytest.mark.parametrize("name", ["seaglider", "seaexplorer", "comma2k19-car"])
def test_a_recording_of_something_else(name, tmp_path, capsys):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "imu.csv").write_text("time[s],a[m]\n0,1\n1,2\n")
    assert prepare(name, tmp_path / "data", tmp_path / "out") == 1
    said = capsys.readouterr().err
    assert said.startswith("prepare: ") and len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
