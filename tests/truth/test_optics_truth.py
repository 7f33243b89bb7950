"""Simulated camera and lidar: where things appear, what is left out, and that the draws are what is claimed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from schuler.aiding.optics import fix
from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84, C_en
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_quat
from schuler.ground.lidar import Lidar
from schuler.ground.tables import validate
from schuler.ground.terrain import HeightModel
from schuler.truth import optics
from schuler.truth.trajectories import legs

D = math.pi / 180.0
CAMERA = Camera.of(8889.0, position_frd_m=(1.0, 0.2, 0.5), half_width_px=2720, half_height_px=2040)


@pytest.fixture(scope="module")
def flight():
    path = legs(50.21 * D, 30.3 * D, 1000.0, speed=200.0, heading=0.4, turns=[0.5], duration=120.0)
    return path.at(np.arange(1.0, 120.0))


def projected(truth, k, camera, lat, lon, height):
    """One picture by the slow and plain way."""
    C = C_en(truth.lat[k], truth.lon[k])
    p = WGS84.ecef_from_geodetic(lat, lon, height) - WGS84.ecef_from_geodetic(
        truth.lat[k], truth.lon[k], truth.height[k]
    )
    return camera.project(p @ C, np.zeros(3), dcm_from_quat(truth.q_nb[k]))


def test_scattered_landmarks_lie_on_the_ground_where_they_are_seen(flight):
    seen = optics.scattered(flight, CAMERA, 6, ground=120.0, seed=3)
    assert validate(seen.landmarks) == [] and validate(seen.sightings) == []
    assert len(seen.landmarks) == len(seen.sightings) == 6 * len(flight)
    np.testing.assert_allclose(seen.landmarks["height"], 120.0, atol=1e-6)
    assert len(set(seen.landmarks["id"])) == len(seen.landmarks)
    errors = []
    for k in (0, 50, 70, 118):  # straight, in the turn with its bank, and after
        rows = seen.sightings.time == flight.time[k]
        part = seen.landmarks.where(np.isin(seen.landmarks["id"], seen.sightings["id"][rows]))
        uv, front = projected(flight, k, CAMERA, part["lat"], part["lon"], part["height"])
        assert front.all()
        errors.append(seen.sightings.stack("u", "v")[rows] - uv)
    e = np.concatenate(errors)
    assert np.std(e) == pytest.approx(1.0, abs=0.2) and np.abs(e).max() < 4.5
    flat = seen.sightings.stack("u", "v")
    assert np.abs(flat).max(axis=0) == pytest.approx([2500, 1900], abs=25)
    assert np.std(flat, axis=0) == pytest.approx(np.array([2500, 1900]) / math.sqrt(3.0), rel=0.05)


def test_the_noise_of_all_sightings_is_white_with_sigma():
    path = legs(50.21 * D, 30.3 * D, 1000.0, speed=200.0, heading=0.4, duration=400.0)
    truth = path.at(np.arange(1.0, 400.0))
    a = optics.scattered(truth, Camera.of(8889.0, sigma_px=2.0), 10, seed=1)
    b = optics.scattered(truth, Camera.of(8889.0, sigma_px=1e-9), 10, seed=1)
    e = a.sightings.stack("u", "v") - b.sightings.stack("u", "v")
    assert np.std(e) == pytest.approx(2.0, rel=0.03) and abs(np.mean(e)) < 0.06
    assert np.array_equal(a.landmarks["lat"], b.landmarks["lat"])  # noise disturbs nothing else


def test_a_field_along_the_track(flight):
    field = optics.along_track(flight, 5.0, 600.0, ground=80.0, seed=2)
    assert validate(field) == []
    seen = optics.sightings(flight, CAMERA, field, seed=2)
    assert validate(seen.sightings) == []
    # every landmark of the picture is there, and none beside it
    for k in (0, 55, 117):
        uv, front = projected(flight, k, CAMERA, field["lat"], field["lon"], field["height"])
        inside = front & CAMERA.inside(uv)
        rows = seen.sightings.time == flight.time[k]
        assert sorted(seen.sightings["id"][rows]) == sorted(field["id"][inside])
        order = [int(np.flatnonzero(field["id"] == i)[0]) for i in seen.sightings["id"][rows]]
        assert np.abs(seen.sightings.stack("u", "v")[rows] - uv[order]).max(initial=0.0) < 5.0
    picture = 4 * 2720 * 2040 * ((1000.0 - 80.0) / 8889.0) ** 2 * 1e-6
    assert len(seen.sightings) / len(flight) == pytest.approx(5.0 * picture, rel=0.25)
    few = optics.sightings(flight, CAMERA, field, most=1, seed=2)
    assert np.max(np.unique(few.sightings.time, return_counts=True)[1]) == 1


def test_a_camera_above_the_horizon_sees_nothing(flight):
    up = Camera.of(8889.0, body_to_camera_rpy_deg=(0.0, 0.0, 0.0))
    seen = optics.scattered(flight, up, 6)
    assert len(seen.sightings) == 0


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_the_share_of_wrong_names(flight, share):
    seen = optics.scattered(flight, CAMERA, 30, wrong_share=share, seed=5)
    n = len(seen.sightings)
    assert seen.wrong.mean() == pytest.approx(share, abs=4 * math.sqrt(share / n))
    true = seen.landmarks["id"]  # one row each, in the order of the sightings
    assert np.array_equal(seen.sightings["id"] != true, seen.wrong)
    times = dict(zip(true, seen.sightings.time, strict=True))
    assert all(times[i] == t for i, t in zip(seen.sightings["id"], seen.sightings.time, strict=True))


def test_a_picture_gives_the_pose_back(flight):
    """The whole way round: simulated sightings, pose from them, truth."""
    seen = optics.scattered(flight, CAMERA, 40, seed=7)
    rows = seen.sightings.time == flight.time[60]
    part = seen.landmarks.where(rows)
    got = fix(part["lat"], part["lon"], part["height"], seen.sightings.stack("u", "v")[rows], CAMERA)
    off = WGS84.displacement_n(got.lat, got.lon, got.height, flight.lat[60], flight.lon[60], flight.height[60])
    assert np.abs(off / got.std[:3]).max() < 4.0 and np.abs(off).max() < 6.0


def test_the_same_seed_gives_the_same_tables(flight):
    a, b, c = (optics.scattered(flight, CAMERA, 5, seed=s, run=r) for s, r in ((1, 0), (1, 0), (1, 1)))
    assert np.array_equal(a.sightings["u"], b.sightings["u"]) and not np.array_equal(a.sightings["u"], c.sightings["u"])


def test_lidar_over_hills(flight):
    lat, lon = (
        (flight.lat.min() - 0.001, flight.lat.max() + 0.001),
        (flight.lon.min() - 0.001, flight.lon.max() + 0.001),
    )
    ground = optics.hills(lat, lon, seed=1)
    lidar = Lidar(0.1, 1200.0, 2.7e-3)
    beams = [[0.0, -90 * D], [90 * D, -70 * D], [-90 * D, -70 * D]]
    table, notes = optics.lidar_over_ground(flight, lidar, ground, beams, seed=1)
    assert validate(table) == []
    exact, _ = optics.lidar_over_ground(flight, Lidar(1e-9, 1200.0), ground, beams, seed=1)
    assert len(table) == len(exact)
    # level flight, first beam: the height over the ground under it
    first = np.flatnonzero(exact["elevation"] < -89 * D)[0]
    assert exact["range"][first] == pytest.approx(1000.0 - float(ground.at(flight.lat[0], flight.lon[0])), abs=1.0)
    e = table["range"] - exact["range"]
    assert 0.08 < np.std(e) < 0.35 and abs(np.mean(e)) < 0.05
    short, notes = optics.lidar_over_ground(flight, Lidar(0.1, 200.0), ground, beams, seed=1)
    assert len(short) == 0 and "reach no ground" in notes[0]
    small = HeightModel(ground.lat0, ground.lon0, ground.dlat, ground.dlon, ground.heights[:60])
    cut, notes = optics.lidar_over_ground(flight, lidar, small, beams, seed=1)
    assert len(cut) < len(table) and any("leave the height model" in n for n in notes)


def test_lidar_to_points(flight):
    field = optics.along_track(flight, 3.0, 800.0, ground=200.0, seed=4)
    table = optics.lidar_to_points(flight, Lidar(0.05, 1000.0), field, seed=4)
    assert validate(table) == [] and len(table) > 50 and table["range"].max() < 1000.5
    k = int(np.argmin(table["range"]))
    i = int(np.flatnonzero(field["id"] == table["id"][k])[0])
    j = int(np.flatnonzero(flight.time == table.time[k])[0])
    d = WGS84.ecef_from_geodetic(field["lat"][i], field["lon"][i], field["height"][i]) - WGS84.ecef_from_geodetic(
        flight.lat[j], flight.lon[j], flight.height[j]
    )
    assert table["range"][k] == pytest.approx(np.linalg.norm(d), abs=0.4)
    az, el = table["azimuth"][k], table["elevation"][k]
    beam = np.array([math.cos(el) * math.cos(az), math.cos(el) * math.sin(az), -math.sin(el)])
    np.testing.assert_allclose(
        C_en(flight.lat[j], flight.lon[j]) @ dcm_from_quat(flight.q_nb[j]) @ beam, d / np.linalg.norm(d), atol=1e-9
    )


def test_a_height_model_from_its_table():
    ground = optics.hills((0.8, 0.8005), (3.1414, 3.1419), seed=2)  # across 180 deg
    rows, columns = ground.heights.shape
    lat = np.repeat(ground.lat0 + np.arange(rows) * ground.dlat, columns)
    lon = np.tile(ground.lon0 + np.arange(columns) * ground.dlon, rows)
    from schuler.ground.tables import Table

    order = np.random.default_rng(1).permutation(len(lat))
    table = Table(
        "height_model",
        {"lat": lat[order], "lon": np.asarray([math.remainder(x, 2 * math.pi) for x in lon[order]]),
         "height": ground.heights.ravel()[order]},
    )  # fmt: skip
    back = HeightModel.from_table(table)
    np.testing.assert_allclose(back.heights, ground.heights)
    assert float(back.at(0.80021, 3.1416)) == pytest.approx(float(ground.at(0.80021, 3.1416)), abs=1e-6)
    assert math.isnan(float(back.at(0.81, 3.1416)))
    holed = HeightModel.from_table(table.where(np.arange(len(lat)) > 3))
    assert np.isnan(holed.heights).sum() == 4
    table.columns["lat"] = table["lat"] + 500.0 * (table["lat"] - 0.8) ** 2
    with pytest.raises(InputError, match="regular"):
        HeightModel.from_table(table)
    table.columns["lat"] = np.full(len(lat), 0.8)
    with pytest.raises(InputError, match="one lat"):
        HeightModel.from_table(table)


def test_impossible_fields_are_refused(flight):
    with pytest.raises(InputError, match="landmarks a picture"):
        optics.scattered(flight, CAMERA, 0)
    with pytest.raises(InputError, match="another density"):
        optics.along_track(flight, 1e-9, 100.0)
    with pytest.raises(InputError, match="no picture"):
        optics.sightings(flight, Camera.of(1000.0), optics.along_track(flight, 1.0, 500.0))


# ---- aboard a simulated vehicle ----


def recording(**suite):
    from schuler.truth.aided import AidedSuite, simulate
    from schuler.truth.instruments import IMUS

    path = legs(50.21 * D, 30.3 * D, 600.0, speed=80.0, heading=0.4, turns=[0.5], duration=100.0, turns_at=[40.0])
    return simulate(path, IMUS["3dm-gx3-25"], AidedSuite(**suite), 50.0, seed=2)


def test_a_vehicle_with_camera_and_lidar():
    lidar = Lidar(0.05, 900.0)
    made = recording(camera=CAMERA, sightings_hz=2.0, sightings_each=5, lidar=lidar, lidar_hz=3.0, ground_height=100.0,
                     ground_relief=20.0)  # fmt: skip
    tables = made.tables
    assert {"sightings", "landmarks", "lidar", "height_model", "imu", "gnss"} <= set(tables)
    for name in ("sightings", "landmarks", "lidar", "height_model"):
        assert validate(tables[name]) == []
    assert len(tables["sightings"]) == 2 * 100 * 5
    model = HeightModel.from_table(tables["height_model"])
    on_map = model.at(tables["landmarks"]["lat"], tables["landmarks"]["lon"])
    np.testing.assert_allclose(tables["landmarks"]["height"], on_map, atol=1e-3)
    assert np.std(tables["landmarks"]["height"]) > 5.0
    # the plain way from the reference (10 Hz, on the same formula)
    from schuler.aiding import optics_checks as checks

    class Track:
        time, lat, lon, height = (made.reference[c] for c in ("time", "lat", "lon", "height"))
        rpy = made.reference.stack("roll", "pitch", "heading")

    assert checks.camera(tables["sightings"], tables["landmarks"], CAMERA, Track) == []
    assert checks.lidar(tables["lidar"], lidar, Track, model=model) == []


def test_a_camera_disturbs_no_other_sensor():
    with_it, without = recording(camera=CAMERA, sightings_hz=1.0), recording()
    for name, column in (("imu", "dtheta_x"), ("gnss", "lat")):
        assert np.array_equal(with_it.tables[name][column], without.tables[name][column])
    with pytest.raises(InputError, match="need a camera"):
        recording(sightings_hz=1.0)


def test_turns_stand_where_they_are_put():
    path = legs(0.8, 0.3, speed=200.0, heading=0.0, turns=[0.534, -0.534], turns_at=[130.0, 430.0],
                turn_rate=2.1875 * 0.534 / 60.0, duration=600.0)  # fmt: skip
    heading = path.at(np.array([99.0, 130.0, 161.0, 399.0, 430.0, 461.0])).rpy[:, 2]
    np.testing.assert_allclose(np.mod(heading + 1.0, 2 * math.pi) - 1.0, [0, 0.267, 0.534, 0.534, 0.267, 0], atol=1e-9)
    for at, match in (([130.0], "one time for each"), ([130.0, 150.0], "overlaps"), ([10.0, 300.0], "overlaps")):
        with pytest.raises(InputError, match=match):
            legs(0.8, 0.3, speed=200.0, heading=0.0, turns=[0.5, -0.5], turns_at=at, turn_rate=0.0182, duration=600.0)
