"""A camera's and a lidar's tables as they come wrong: the run says in one sentence what it is and what to type."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

from schuler.ground.tables import Table
from schuler.io.tables import write_table
from schuler.studies.model import parse_study
from schuler.studies.simulated import simulation

FLIGHT = {
    "study": {"name": "flight", "kind": "aided"},
    "start": {"lat_deg": 50.21, "lon_deg": 30.3, "height_m": 600.0, "heading_deg": 0.0},
    "trajectory": {"preset": "legs", "speed_mps": 100.0, "duration_s": 60.0, "rate_hz": 10, "turns_deg": [10.0]},
    "imu": {"gyro_bias_deg_per_h": 0.05, "accel_bias_ug": 100, "gyro_arw_deg_per_sqrt_h": 0.001},
    "camera": {"focal_px": 8889.0},
    "lidar": {"reach_m": 2000.0},
    "simulate": {"gnss_hz": 1, "sightings_per_s": 6, "lidar_hz": 2, "ground_height_m": 100.0, "ground_relief_m": 10.0},
}
STUDY = """
[study]
name = "trial"
kind = "aided"
[input]
imu = "imu.csv"
gnss = "gnss.csv"
landmarks = "landmarks.csv"
sightings = "sightings.csv"
lidar = "lidar.csv"
height_model = "height_model.csv"
[start]
time_s = 0.0
lat_deg = 50.21
lon_deg = 30.3
height_m = 600.0
heading_deg = 0.0
roll_deg = 0.0
pitch_deg = 0.0
v_north_mps = 100.0
v_east_mps = 0.0
v_down_mps = 0.0
std_roll_deg = 0.02
std_pitch_deg = 0.02
std_heading_deg = 0.05
[imu]
gyro_bias_deg_per_h = 0.05
accel_bias_ug = 100
gyro_arw_deg_per_sqrt_h = 0.001
[noise]
gnss_correlated_m = 0.0
[camera]
focal_px = 8889
[lidar]
reach_m = 2000
[output]
rate_hz = 1
"""


@pytest.fixture(scope="module")
def tables():
    return simulation(parse_study(FLIGHT)).record(3).tables


@pytest.fixture(scope="module")
def written(tables, tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    for name, table in tables.items():
        write_table(folder / f"{name}.csv", table)
    return folder


@pytest.fixture
def flight(written, tmp_path):
    for file in written.iterdir():
        shutil.copy(file, tmp_path)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def said(program, flight, study=STUDY, status=0):
    (flight / "study.toml").write_text(study)
    done = program("run", flight / "study.toml", "--out", flight / "out")
    assert done.status == status, done.out + done.err
    return re.sub(r"\s+", " ", done.out + done.err)


def replaced(table, **columns):
    return Table(table.name, {**table.columns, **columns}, kind=table.kind, source=table.source)


def test_nothing_is_said_of_what_is_right(program, flight):
    text = said(program, flight)
    assert not re.search("mounted|focal|names|cover|beyond|fewer than three|one line", text), text


@pytest.mark.parametrize(
    ("typed", "match"),
    [
        ("body_to_camera_rpy_deg = [180, 0, 180]", r"upside down .* body_to_camera_rpy_deg = \[180.0, 0.0, 0.0\]"),
        ("body_to_camera_rpy_deg = [0, 0, 0]", r"100 % of the landmarks seen lie behind the camera"),
        ("focal_px = 8000", r"wrong focal length is likelier .* focal_px = 8[89]"),
    ],
)
def test_a_camera_that_is_another(program, flight, typed, match):
    study = STUDY.replace("focal_px = 8889", typed if "focal" in typed else f"focal_px = 8889\n{typed}")
    assert re.search(match, said(program, flight, study))


def test_names_exchanged_within_pictures(program, flight, tables):
    seen = tables["sightings"]
    names = seen["id"].copy()
    for k in range(0, len(names) - 1, 6):
        names[k], names[k + 1] = names[k + 1], names[k]
    write_table(flight / "sightings.csv", replaced(seen, id=names))
    assert re.search(r"wrong names or a wrong place in the map, \d+ of them exchanged", said(program, flight))


def test_two_landmarks_a_picture_give_no_pose(program, flight, tables):
    seen = tables["sightings"]
    rows = np.arange(len(seen)) % 6 < 2
    write_table(flight / "sightings.csv", seen.where(rows))
    assert "pictures have fewer than three known points" in said(program, flight)


def test_points_on_one_line(program, flight):
    road = {**FLIGHT, "simulate": {**FLIGHT["simulate"], "picture_px": [2500.0, 10.0]}}
    tables = simulation(parse_study(road)).record(3).tables
    for name in ("sightings", "landmarks"):
        write_table(flight / f"{name}.csv", tables[name])
    assert re.search(r"the points of \d+ of \d+ pictures lie on one line", said(program, flight))


def test_a_height_model_that_ends_early(program, flight, tables):
    model = tables["height_model"]
    north = model["lat"] > np.median(model["lat"])
    write_table(flight / "height_model.csv", model.where(north))
    assert re.search(r"height model does not cover \d+ of \d+ places of the flight, first 50\.2", said(program, flight))


def test_ranges_beyond_the_sensor(program, flight):
    text = said(program, flight, STUDY.replace("reach_m = 2000", "reach_m = 505"))
    assert re.search(r"lidar: \d+ ranges beyond the sensor's 505 m, left out", text)


@pytest.mark.parametrize(
    ("study", "match"),
    [
        (STUDY.replace("[camera]\nfocal_px = 8889\n", ""), r"\[camera\] focal_px"),
        (STUDY.replace('landmarks = "landmarks.csv"\n', ""), r"landmarks"),
    ],
)
def test_what_lacks_is_named(program, flight, study, match):
    (flight / "study.toml").write_text(study)
    done = program("run", flight / "study.toml", "--out", flight / "out")
    assert done.status in (1, 2) and re.search(match, done.out + done.err) and "Traceback" not in done.err
