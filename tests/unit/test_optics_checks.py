"""Each fault of a camera's and a lidar's tables is put in and named; a good recording hears nothing."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

from schuler.aiding import optics_checks as checks
from schuler.ground.camera import Camera
from schuler.ground.frames import dcm_from_euler
from schuler.ground.lidar import Lidar
from schuler.ground.tables import Table
from schuler.ground.terrain import HeightModel
from schuler.truth import optics
from schuler.truth.trajectories import legs

D = math.pi / 180.0
TYPED = Camera.of(3000.0, sigma_px=1.0, position_frd_m=(0.5, 0.1, 0.2))
HALF = (900.0, 700.0)


@dataclass
class Track:
    time: np.ndarray
    lat: np.ndarray
    lon: np.ndarray
    height: np.ndarray
    rpy: np.ndarray


@pytest.fixture(scope="module")
def flight():
    path = legs(50.21 * D, 179.99 * D, 1000.0, speed=150.0, heading=1.5, turns=[0.5], duration=100.0)
    return path.at(np.arange(1.0, 100.0))


@pytest.fixture(scope="module")
def track(flight):
    """What a user has at hand: 15 m and 1.5 deg off, with rows at half the rate."""
    k = slice(None, None, 2)
    rpy = np.unwrap(flight.rpy[k], axis=0) + np.array([0.4, -0.5, 1.5]) * D
    return Track(
        flight.time[k], flight.lat[k] + 15.0 / 6.37e6, flight.lon[k] - 10.0 / 4.1e6, flight.height[k] + 8.0, rpy
    )


def tables(flight, camera, count=12, **more):
    seen = optics.scattered(flight, camera, count, half=HALF, ground=100.0, seed=4, **more)
    return seen.sightings, seen.landmarks


def codes(found):
    return [f.code for f in found]


def said(found, code):
    (fault,) = [f for f in found if f.code == code]
    assert fault.says and fault.type_next
    return fault


def test_a_good_recording_hears_nothing(flight, track):
    sightings, landmarks = tables(flight, TYPED)
    assert checks.camera(sightings, landmarks, TYPED, track) == []


@pytest.mark.parametrize(
    ("rpy", "code", "match", "typed"),
    [
        ((180.0, 0.0, 180.0), "turned", "mounted upside down", (180, 0, 180)),
        ((180.0, 0.0, 90.0), "turned", "turned by about (88|89|90) deg", (180, 0, 90)),
        ((180.0, 0.0, 30.0), "turned", "turned by about (27|28|29|30) deg", None),
    ],
)
def test_a_camera_mounted_otherwise_is_told_how(flight, track, rpy, code, match, typed):
    """True mounting rpy, typed straight down; the mounting it names then fits."""
    true = Camera.of(3000.0, body_to_camera_rpy_deg=rpy, position_frd_m=(0.5, 0.1, 0.2))
    sightings, landmarks = tables(flight, true)
    assert len(sightings) > 100
    found = checks.camera(sightings, landmarks, TYPED, track)
    fault = said(found, code)
    assert re.search(match, fault.says), fault.says
    assert "focal" not in codes(found)
    advice = [float(x) for x in fault.type_next.split("[")[1].rstrip("]").split(",")]
    if typed is not None:
        C = Camera.of(1.0, body_to_camera_rpy_deg=advice).C_cb
        assert np.abs(C - Camera.of(1.0, body_to_camera_rpy_deg=typed).C_cb).max() < 0.03
    if typed is not None:
        better = Camera.of(3000.0, body_to_camera_rpy_deg=advice, position_frd_m=(0.5, 0.1, 0.2))
        assert checks.camera(sightings, landmarks, better, track) == []


@pytest.mark.parametrize(("yaw", "looks"), [(0.0, "ahead"), (90.0, "left"), (-90.0, "right"), (180.0, "back")])
def test_a_camera_that_looks_aside(flight, track, yaw, looks):
    """40 deg below the horizon, typed straight down: the direction is named, and nothing beside it is made up."""
    forward = dcm_from_euler(0.0, -40.0 * D, -yaw * D) @ [1.0, 0.0, 0.0]
    x = np.cross([0.0, 0.0, -1.0], -forward)
    C = np.stack([x / np.linalg.norm(x), np.cross(-forward, x / np.linalg.norm(x)), -forward])
    sightings, landmarks = tables(flight, replace(TYPED, C_cb=C))
    assert len(sightings) > 1000
    fault = said(checks.camera(sightings, landmarks, TYPED, track), "mounting")
    assert f"looks {looks} and" in fault.says and "deg down" in fault.says
    C_said = Camera.of(1.0, body_to_camera_rpy_deg=[float(x) for x in fault.type_next[26:-1].split(",")]).C_cb
    assert math.degrees(math.acos(float(C_said[2] @ C[2]))) < 2.5


def test_a_camera_typed_looking_up(flight, track):
    sightings, landmarks = tables(flight, TYPED)
    up = Camera.of(3000.0, body_to_camera_rpy_deg=(0.0, 0.0, 0.0))
    fault = said(checks.camera(sightings, landmarks, up, track), "mounting")
    assert "100 %" in fault.says and "looks down" in fault.says
    assert fault.type_next == "body_to_camera_rpy_deg = [180.0, 0.0, 0.0]"


@pytest.mark.parametrize(("axis", "match"), [("v", "v counts the other way"), ("u", "u counts the other way")])
def test_a_mirrored_axis(flight, track, axis, match):
    """Image rows counted downwards, as most detectors have them."""
    sightings, landmarks = tables(flight, TYPED)
    columns = dict(sightings.columns)
    columns[axis] = -columns[axis]
    fault = said(checks.camera(Table("sightings", columns), landmarks, TYPED, track), "mirrored")
    assert match in fault.says and fault.type_next == f"replace {axis} by 2 {axis}0 - {axis}"


@pytest.mark.parametrize("focal", [2000.0, 2880.0, 4500.0])
def test_a_wrong_focal_length_is_told_from_a_wrong_mounting(flight, track, focal):
    true = Camera.of(focal, position_frd_m=(0.5, 0.1, 0.2))
    sightings, landmarks = tables(flight, true)
    found = checks.camera(sightings, landmarks, TYPED, track)
    assert codes(found) == ["focal"]
    fault = said(found, "focal")
    assert "likelier than a wrong mounting" in fault.says
    assert float(fault.type_next.split("=")[1]) == pytest.approx(focal, rel=0.012)  # the track's height is 8 m off
    assert ("geoid" in fault.says) == (focal == 2880.0)


def test_both_at_once(flight, track):
    true = Camera.of(4500.0, body_to_camera_rpy_deg=(180.0, 0.0, 180.0))
    sightings, landmarks = tables(flight, true)
    assert codes(checks.camera(sightings, landmarks, TYPED, track)) == ["turned", "focal"]


def test_two_landmarks_exchanged_in_the_map(flight, track):
    field = optics.along_track(flight, 40.0, 500.0, ground=100.0, seed=2)
    camera = replace(TYPED, half_width=1500.0, half_height=1200.0)
    seen = optics.sightings(flight, camera, field, seed=2)
    counts = {i: int((seen.sightings["id"] == i).sum()) for i in field["id"]}
    often = sorted(counts, key=lambda i: -counts[i])
    here = {i: set(seen.sightings.time[seen.sightings["id"] == i]) for i in often[:30]}
    a, b = next((i, j) for i in often[:30] for j in often[:30] if i < j and len(here[i] & here[j]) >= 4)
    swapped = dict(field.columns)
    swapped["id"] = np.where(field["id"] == a, b, np.where(field["id"] == b, a, field["id"]))
    found = checks.camera(seen.sightings, Table("landmarks", swapped), camera, track)
    fault = said(found, "exchanged")
    assert a in fault.says and b in fault.says and "exchange their names" in fault.type_next
    assert "names" not in codes(found)
    clean = checks.camera(seen.sightings, field, camera, track)
    assert not [f for f in clean if f.serious]


@pytest.mark.parametrize(("share", "serious"), [(0.05, False), (0.3, True)])
def test_wrong_names_are_counted(flight, track, share, serious):
    sightings, landmarks = tables(flight, TYPED, wrong_share=share)
    found = checks.camera(sightings, landmarks, TYPED, track)
    fault = said(found, "names")
    assert fault.rows / len(sightings) == pytest.approx(share, abs=0.25 * share)
    assert fault.serious == serious


def test_names_of_another_map(flight, track):
    sightings, landmarks = tables(flight, TYPED)
    other = dict(landmarks.columns)
    other["id"] = np.array([f"X{i}" for i in range(len(landmarks))])
    fault = said(checks.camera(sightings, Table("landmarks", other), TYPED, track), "unknown")
    assert fault.serious and "none of its names" in fault.says
    some = landmarks.where(np.arange(len(landmarks)) > 9)
    fault = said(checks.camera(sightings, some, TYPED, track), "unknown")
    assert not fault.serious and fault.rows == 10
    double = Table("landmarks", {k: np.concatenate([v, v[:2]]) for k, v in landmarks.columns.items()})
    assert "2 names are there more than once" in said(checks.named(sightings, double), "twice").says
    flat = Table("landmarks", {k: v for k, v in landmarks.columns.items() if k != "height"})
    assert "have no height" in said(checks.named(sightings, flat), "no-height").says


def test_shuffled_names_are_no_picture_of_the_map(flight, track):
    sightings, landmarks = tables(flight, TYPED)
    columns = dict(sightings.columns)
    columns["id"] = np.random.default_rng(1).permutation(columns["id"])
    found = checks.camera(Table("sightings", columns), landmarks, TYPED, track)
    assert codes(found)[-1] in ("alien", "behind") and found[-1].serious


def test_another_clock(flight, track):
    sightings, landmarks = tables(flight, TYPED)
    columns = dict(sightings.columns)
    columns["time"] = columns["time"] + 1000.0
    fault = said(checks.camera(Table("sightings", columns), landmarks, TYPED, track), "time")
    assert fault.serious and "outside the track" in fault.says


def test_few_points_and_points_on_a_line(flight, track):
    sightings, landmarks = tables(flight, TYPED, count=2)
    fault = said(checks.camera(sightings, landmarks, TYPED, track), "few")
    assert not fault.serious and "99 of 99 pictures" in fault.says
    columns = {"time": np.repeat(np.arange(3.0), 4), "id": np.tile(list("abcd"), 3)}
    columns |= {"u": np.tile([0.0, 100.0, 200.0, 330.0], 3), "v": np.tile([5.0, 55.0, 105.0, 170.0], 3)}
    line = Table("sightings", columns)
    points = Table("landmarks", {"id": np.array(list("abcd"))})
    assert "3 of 3 pictures" in said(checks.geometry(line, points), "line").says


# ---- lidar ----


@pytest.fixture(scope="module")
def ground(flight):
    lon = np.unwrap(flight.lon)
    return optics.hills(
        (float(flight.lat.min()) - 3e-4, float(flight.lat.max()) + 3e-4),
        (float(lon.min()) - 4e-4, float(lon.max()) + 4e-4), seed=1,
    )  # fmt: skip


BEAMS = [[0.0, -90 * D], [90 * D, -75 * D], [-90 * D, -75 * D]]
SENSOR = Lidar(0.1, 1200.0)


def test_a_good_lidar_hears_nothing(flight, track, ground):
    table, _ = optics.lidar_over_ground(flight, SENSOR, ground, BEAMS, seed=1)
    close = replace(track, height=track.height - 8.0)
    assert checks.lidar(table, SENSOR, close, model=ground) == []


def test_ranges_beyond_the_sensor(flight, track, ground):
    table, _ = optics.lidar_over_ground(flight, SENSOR, ground, BEAMS, seed=1)
    fault = said(checks.lidar(table, Lidar(0.1, 850.0), track, model=ground), "reach")
    assert "beyond the sensor's 850 m" in fault.says


def test_a_model_that_does_not_cover_the_flight(flight, track, ground):
    table, _ = optics.lidar_over_ground(flight, SENSOR, ground, BEAMS, seed=1)
    columns = ground.heights.shape[1] // 3
    west = HeightModel(ground.lat0, ground.lon0, ground.dlat, ground.dlon, ground.heights[:, :columns])
    fault = said(checks.lidar(table, SENSOR, track, model=west), "cover")
    assert fault.serious and "does not cover" in fault.says
    assert said(checks.lidar(table, SENSOR, track), "no-model")


def test_an_elevation_of_the_other_sign_and_another_datum(flight, track, ground):
    table, _ = optics.lidar_over_ground(flight, SENSOR, ground, BEAMS, seed=1)
    turned = Table("lidar", dict(table.columns) | {"elevation": -table["elevation"]})
    assert "change the sign" in said(checks.lidar(turned, SENSOR, track, model=ground), "up").type_next
    geoid = HeightModel(ground.lat0, ground.lon0, ground.dlat, ground.dlon, ground.heights - 32.0)
    close = replace(track, height=track.height - 8.0)
    fault = said(checks.lidar(table, SENSOR, close, model=geoid), "datum")
    assert "32 m shorter" in fault.says or "31 m shorter" in fault.says or "33 m shorter" in fault.says


def test_named_points_of_a_lidar(flight, track):
    field = optics.along_track(flight, 3.0, 800.0, ground=200.0, seed=4)
    table = optics.lidar_to_points(flight, SENSOR, field, seed=4)
    assert checks.lidar(table, SENSOR, track, landmarks=field) == []
    assert said(checks.lidar(table, SENSOR, track), "unknown")
    other = Table("landmarks", dict(field.columns) | {"id": np.array([f"Q{i}" for i in range(len(field))])})
    assert "none of its names" in said(checks.lidar(table, SENSOR, track, landmarks=other), "unknown").says
