"""The example studies' prepare.py on the five real recordings: units, signs, frames and clocks of what comes out."""

import importlib.util
import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from schuler.ground.frames import dcm_from_euler
from schuler.ground.tables import validate
from schuler.ground.units import DEG
from schuler.io.tables import read_table
from schuler.studies.model import load_study

pytestmark = pytest.mark.data
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
RECORDINGS = {
    "car-rtk-mems": "car_rtk_mems",
    "comma2k19-aided": "car_comma2k19_wheel",
    "car-phone": "car_phone_a",
    "thor-uav": "uav_thor75",
    "quad-4imu": "quad_4imu_rtk",
}


def prepare(name, *arguments):
    """Runs examples/NAME/prepare.py in this process."""
    spec = importlib.util.spec_from_file_location("prepare", EXAMPLES / name / "prepare.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    before, sys.argv = sys.argv, ["prepare.py", *map(str, arguments)]
    try:
        return module.main()
    finally:
        sys.argv = before


@pytest.fixture(scope="module", params=RECORDINGS)
def prepared(request, data_folder, tmp_path_factory):
    out = tmp_path_factory.mktemp(request.param) / "out"
    assert prepare(request.param, data_folder / RECORDINGS[request.param], out) == 0
    study = tomllib.loads((out / "study.toml").read_text())
    files = {n: f for n, f in study["input"].items() if isinstance(f, str)}
    tables = {n: read_table(out / f, n) for n, f in files.items()}
    C = dcm_from_euler(*np.radians(study.get("mounting", {}).get("imu_to_body_rpy_deg", [0.0, 0.0, 0.0])))
    turned = {s: tables["imu"].stack(*(f"{s}_{a}" for a in "xyz")) @ C.T for s in ("gyro", "accel")}
    return request.param, study, tables, turned["gyro"], turned["accel"]


def test_tables_are_whole_and_hang_from_g(prepared):
    name, _, tables, _, f = prepared
    assert all(validate(t) == [] for t in tables.values())
    mean = np.median(f, axis=0)
    assert -10.9 < mean[2] < -9.2 and np.hypot(mean[0], mean[1]) < 2.2
    first, last = tables["imu"].time[[0, -1]]
    for other in tables.values():
        inside = (other.time >= first) & (other.time <= last)
        assert inside.mean() > 0.98, (name, other.name)


def test_gyro_about_down_turns_as_the_course_does(prepared):
    """With the right sign and in rad/s: the gain of a line through the two is near one."""
    name, _, tables, w, _ = prepared
    track = tables.get("reference", tables["gnss"])
    t = track.time
    if "heading" in track:
        course, moving = np.unwrap(track["heading"]), np.ones(len(t), dtype=bool)
    else:
        course = np.unwrap(np.arctan2(track["v_east"], track["v_north"]))
        moving = np.hypot(track["v_north"], track["v_east"]) > 3.0
    gathered = np.cumsum(w[1:, 2] * np.diff(tables["imu"].time))
    every = max(1, round(1.0 / np.median(np.diff(t))))
    at = slice(None, None, every)
    turn = np.diff(np.interp(t[at], tables["imu"].time[1:], gathered))
    seen = np.diff(course[at])
    ok = moving[at][1:] & moving[at][:-1] & (np.diff(t[at]) < 1.5)
    ok &= (t[at][1:] < tables["imu"].time[-1]) & (t[at][:-1] > tables["imu"].time[0])
    gain, _ = np.polyfit(turn[ok], seen[ok], 1)
    least = {"quad-4imu": 0.3}.get(name, 0.85)  # a drone hardly turns
    assert np.corrcoef(turn[ok], seen[ok])[0, 1] > least
    assert abs(gain - 1.0) < (0.6 if name == "quad-4imu" else 0.2)


def test_the_original_log_of_the_car_beats_its_table(data_folder, tmp_path):
    """The times of the imu table drift 0.13 s against a line through all arrivals; prepare.py takes the log."""
    source = data_folder / "car_rtk_mems"
    assert prepare("car-rtk-mems", source, tmp_path / "log") == 0
    plain = tmp_path / "plain"
    plain.mkdir()
    for stem in ("imu", "gnss"):
        shutil.copy(source / f"{stem}.csv.gz", plain)
    assert prepare("car-rtk-mems", plain, tmp_path / "table") == 0
    log, table = (read_table(tmp_path / f / "imu.csv", "imu") for f in ("log", "table"))
    a = log.time[1 : len(table) + 1] + 0.25 - table.time - 0.18  # the table has left the first row out
    np.testing.assert_allclose(log["accel_x"][1 : len(table) + 1], table["accel_x"], atol=1e-5)
    assert a[0] == pytest.approx(0.148, abs=0.01) and a[-1] == pytest.approx(0.0, abs=0.02)
    fixes = [read_table(tmp_path / f / "gnss.csv", "gnss") for f in ("log", "table")]
    np.testing.assert_allclose(fixes[0].time, fixes[1].time, atol=2e-3)
    for column in ("lat", "v_north", "v_down", "std_v_down"):
        np.testing.assert_allclose(fixes[0][column], fixes[1][column], atol=1e-9)


def test_a_folder_that_holds_half_of_a_drive(data_folder, tmp_path, capsys):
    half = tmp_path / "half"
    half.mkdir()
    shutil.copy(data_folder / "car_rtk_mems" / "gnss_1934.pos", half)
    assert prepare("car-rtk-mems", half, tmp_path / "out") == 1
    assert "neither an IMU log" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_every_flight_and_sensor_of_the_quadrotor(data_folder, tmp_path):
    """Roll and pitch of each sensor's own filter are those of the drone once the clocks are together."""
    source = data_folder / "quad_4imu_rtk"
    assert prepare("quad-4imu", source, tmp_path, "all") == 0
    studies = sorted(tmp_path.glob("*/study.toml"))
    assert len(studies) == 20
    study = load_study(tmp_path / "horizontal09-imu3" / "study.toml")
    assert study.study.name == "quad horizontal09 imu3"
    assert study.start.heading_deg == pytest.approx(242.5, abs=3.0) and study.start.std_heading_deg == 11.46
    assert study.input.gnss_delay_s == 0.0  # the fixes lie where they belong


def test_the_aeroplane_is_in_the_air(data_folder, tmp_path):
    assert prepare("thor-uav", data_folder / "uav_thor75", tmp_path) == 0
    gnss = read_table(tmp_path / "gnss.csv", "gnss")
    speed = np.hypot(gnss["v_north"], gnss["v_east"])
    assert speed[gnss.time < gnss.time[0] + 25].max() < 5.0 < speed[gnss.time > gnss.time[0] + 40].min()
    onboard = read_table(tmp_path / "reference-onboard.csv", "reference")
    at = np.interp(gnss.time, onboard.time, onboard["lat"])
    assert np.abs(at - gnss["lat"])[40:].max() * 6.37e6 < 10.0
    assert np.abs(onboard["roll"]).max() < 80 * DEG
