"""Studies with a camera and a lidar: simulated, read from files, a wrong camera named, the page's chapters."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from schuler.ground.errors import StudyError
from schuler.io.tables import write_table
from schuler.report.sections import optics
from schuler.report.view import View
from schuler.studies.model import load_study, parse_study
from schuler.studies.run import run_study
from schuler.studies.simulated import simulation

ROOT = Path(__file__).resolve().parents[2]
START = {"lat_deg": 50.21, "lon_deg": 30.3, "height_m": 1000.0, "heading_deg": 20.0} | {
    f"std_{k}_m": 3.0 for k in ("north", "east", "down")
} | {f"std_v_{k}_mps": 0.1 for k in ("north", "east", "down")} | {
    "std_roll_deg": 0.006, "std_pitch_deg": 0.006, "std_heading_deg": 0.06,
}  # fmt: skip
IMU = {
    "gyro_bias_deg_per_h": 0.05, "accel_bias_ug": 100, "gyro_arw_deg_per_sqrt_h": 0.001,
    "accel_vrw_mps_per_sqrt_h": 0.0006,
}  # fmt: skip


def raw(duration=100.0, **sections):
    made = {
        "study": {"name": "optics", "kind": "aided"},
        "start": dict(START),
        "trajectory": {"preset": "legs", "speed_mps": 200.0, "duration_s": duration, "rate_hz": 10,
                       "turns_deg": [15.0], "turns_at_s": [50.0]},
        "imu": dict(IMU),
        "camera": {"focal_px": 8889.0, "sigma_px": 1.0},
        "simulate": {"gnss_hz": 0, "sightings_per_s": 8},
        "output": {"rate_hz": 1},
    }  # fmt: skip
    for name, keys in sections.items():
        made[name] = {**made.get(name, {}), **keys}
    return made


@pytest.fixture(scope="module")
def flown():
    return run_study(parse_study(raw()), seed=4)


def test_landmarks_hold_the_ins_at_decimetres(flown):
    errors = flown.summary["errors"]["filter"]["horizontal_m"]
    assert errors["end"] < 0.5 and len(flown.tables["sightings"]) == 800
    nis = flown.summary["consistency"]["nis"]["sightings"]
    assert nis["low"] <= nis["mean"] <= nis["high"]
    assert not [n for n in flown.notes if "camera" in n or "focal" in n]


def test_the_page_shows_the_picture_the_map_and_what_each_landmark_adds(flown):
    section = optics.sightings(View(flown))
    assert section is not None and [f.id for f in section.figures] == ["fig-picture", "fig-landmarks", "fig-residuals"]
    (grid,) = section.grids
    assert len(grid.rows) == 8
    gains = [float(row[-1]) for row in grid.rows]
    assert gains == sorted(gains, reverse=True) and gains[-1] > 0.0
    residuals = np.array([[float(x.replace("\u2212", "-")) for x in row[3:5]] for row in grid.rows])
    assert 0.2 < np.sqrt(np.mean(residuals**2)) < 2.0  # a pixel


def test_what_a_landmark_adds_is_what_is_lost_without_it():
    """Equal landmarks on a ring add alike; one twice as sharp as the others adds more."""
    from schuler.aiding.optics import rows
    from schuler.ground.camera import Camera

    camera = Camera.of(8889.0)
    ring = np.array([[200 * np.cos(t), 200 * np.sin(t), 1000.0] for t in np.linspace(0, 2 * np.pi, 7)[:-1]])
    uv, _, H = rows(ring, np.zeros(3), np.eye(3), camera)
    picture = optics.Picture(0.0, np.array(list("abcdef")), uv, uv, H, 1e-15 * np.eye(3), 0, np.arange(6))
    gains = optics.what_each_adds(picture, camera)
    np.testing.assert_allclose(gains, gains[0], rtol=1e-6)
    assert gains[0] == pytest.approx(np.sqrt(6 / 5) - 1, abs=0.015)  # one of six, the attitude known
    unsure = optics.Picture(0.0, picture.id, uv, uv, H, 1e-8 * np.eye(3), 0, picture.which)
    assert 0.0 < optics.what_each_adds(unsure, camera)[0] < 0.5 * gains[0]  # then tilt is most of the sigma
    sharper = optics.Picture(0.0, picture.id, uv, uv, H * np.array([2, 1, 1, 1, 1, 1])[:, None, None],
                             picture.cov_phi, 0, picture.which)  # fmt: skip
    assert np.argmax(optics.what_each_adds(sharper, camera)) == 0
    unknown = optics.Picture(0.0, picture.id, uv, uv, H, np.full((3, 3), np.nan), 0, picture.which)
    assert optics.what_each_adds(unknown, camera) is None


@pytest.fixture(scope="module")
def files(flown, tmp_path_factory):
    folder = tmp_path_factory.mktemp("optics")
    for name in ("imu", "sightings", "landmarks"):
        write_table(folder / f"{name}.csv", flown.tables[name])
    write_table(folder / "truth.csv", flown.reference)
    return folder


def recorded(files, **camera):
    study = raw(camera=camera)
    del study["trajectory"], study["simulate"]
    north, east = 200.0 * np.cos(np.radians(20.0)), 200.0 * np.sin(np.radians(20.0))
    study["start"] |= {"time_s": 0.0, "v_north_mps": float(north), "v_east_mps": float(east), "v_down_mps": 0.0,
                       "roll_deg": 0.0, "pitch_deg": 0.0}  # fmt: skip
    study["input"] = {n: str(files / f"{n}.csv") for n in ("imu", "sightings", "landmarks")}
    study["input"]["reference"] = str(files / "truth.csv")
    return run_study(parse_study(study))


def test_a_users_own_files_give_the_same_track(files):
    """Landmark file and pixel file in, track out: no simulation knows of it."""
    made = recorded(files)
    assert made.summary["errors"]["filter"]["horizontal_m"]["end"] < 0.5
    assert not [n for n in made.notes if "focal" in n or "mounted" in n]


@pytest.mark.parametrize(
    ("camera", "match"),
    [
        ({"body_to_camera_rpy_deg": [180, 0, 180]}, r"upside down .* = \[180.0, 0.0, 0.0\]"),
        ({"body_to_camera_rpy_deg": [0, 0, 0]}, r"100 % of the landmarks seen lie behind .* looks down"),
        ({"focal_px": 8000.0}, r"1\.11\d times as large .* focal_px = 8[89]\d\d"),
    ],
)
def test_a_wrong_camera_is_named_although_it_spoils_the_track(files, camera, match):
    notes = recorded(files, **camera).notes
    assert [n for n in notes if re.search(match, n)], notes


def test_lidar_over_hills():
    keys = {"sightings_per_s": 0, "gnss_hz": 0.2, "lidar_hz": 3, "ground_height_m": 100, "ground_relief_m": 30}
    study = raw(simulate=keys, lidar={"ground_m": 0.5, "reach_m": 1500})
    del study["camera"]
    made = run_study(parse_study(study), seed=2)
    assert len(made.tables["lidar"]) > 250
    assert made.summary["errors"]["filter"]["vertical_m"]["end"] < 2.0
    assert not [n for n in made.notes if "height model" in n and "cover" in n]
    section = optics.ground(View(made))
    assert section is not None and "lidar" in section.figures[0].caption


def test_keys_that_do_not_fit_are_named():
    without = raw()
    del without["camera"]
    with pytest.raises(StudyError, match=r"\[camera\] is absent"):
        simulation(parse_study(without))
    with pytest.raises(StudyError, match="less than one a picture"):
        simulation(parse_study(raw(simulate={"sightings_per_s": 1, "sightings_hz": 10})))
    made = simulation(
        parse_study(raw(simulate={"wrong_names_percent": 5, "sightings_hz": 2, "picture_px": [900, 700]}))
    )
    s = made.suite
    assert (s.sightings_hz, s.sightings_each, s.sightings_wrong, s.picture) == (2.0, 4, 0.05, (900.0, 700.0))


@pytest.mark.parametrize("name", ["straight", "turns"])
def test_the_examples_are_studies(name):
    study = load_study(ROOT / "examples" / "oeson" / f"{name}.toml")
    made = simulation(study)
    assert made.suite.sightings_each == 6 and made.trajectory.duration == 1800.0


def test_a_turn_does_not_tilt_the_filter():
    """60 deg at 200 m/s and 10 Hz without aid or noise: the transport rate is that of mid-interval; that of
    its beginning leaves dt dv/(2 R), 1e-6 rad of tilt and 0.2 m after 300 s."""
    study = raw(300.0, trajectory={"turns_deg": [60.0], "turns_at_s": [100.0]},
                imu={"gyro_arw_deg_per_sqrt_h": 1e-7, "accel_vrw_mps_per_sqrt_h": 1e-7},
                simulate={"sightings_per_s": 0, "height_hz": 0.01})  # fmt: skip
    for key in ("gyro_bias_deg_per_h", "accel_bias_ug"):
        del study["imu"][key]
    del study["camera"]
    study["start"] = {"lat_deg": 50.21, "lon_deg": 30.3, "height_m": 1000.0, "heading_deg": 20.0}
    tiny = dict.fromkeys((f"std_{k}_m" for k in ("north", "east", "down")), 1e-3)
    tiny |= dict.fromkeys((f"std_v_{k}_mps" for k in ("north", "east", "down")), 1e-5)
    study["start"] |= tiny | dict.fromkeys(("std_roll_deg", "std_pitch_deg", "std_heading_deg"), 1e-5)
    errors = run_study(parse_study(study), seed=1).summary["errors"]["filter"]
    assert errors["roll_deg"]["rms"] < 1.5e-5
    assert errors["horizontal_m"]["end"] < 0.1


@pytest.mark.parametrize("seed", [1, 4])
def test_a_rough_start_stays_honest(seed):
    """Heading to 5 deg, level to 1 deg: the arcs on which points move are noise until the first pictures are in."""
    rough = {"std_roll_deg": 1.0, "std_pitch_deg": 1.0, "std_heading_deg": 5.0}
    study = raw(60.0, start=rough, trajectory={"turns_deg": [], "turns_at_s": []})
    made = run_study(parse_study(study), seed=seed)
    nis = made.summary["consistency"]["nis"]["sightings"]
    assert nis["low"] <= nis["mean"] <= nis["high"]
    assert made.summary["consistency"]["nees_position"] < 2.5
    assert made.summary["errors"]["filter"]["horizontal_m"]["end"] < 2.0
    assert not [n for n in made.notes if "sighting" in n]


def test_refused_sightings_are_told_from_those_let_in():
    made = run_study(parse_study(raw(simulate={"wrong_names_percent": 20})), seed=3)
    view = View(made)
    seen, points = made.tables["sightings"], made.tables["landmarks"]
    told = optics.taken(view, seen, optics._which(seen, points))
    assert told is not None and len(told.row) > 700
    innovations = made.navigation.innovations["sightings"]
    assert int((~told.used).sum()) == int((~innovations.used).sum()) > 50
    sizes = np.hypot(*told.innovation.T)
    assert np.median(sizes[~told.used]) > 20.0 * np.median(sizes[told.used])
    section = optics.sightings(view)
    assert section is not None and section.figures[-1].id == "fig-residuals"
    assert any(t["name"] == "refused" for f in section.figures for t in f.spec["data"])


def test_the_page_shows_what_is_known_of_yaw(flown):
    section = optics.yaw(View(flown))
    assert section is not None and section.figures[0].id == "fig-yaw"
    assert "Heading is known to" in section.lead
    without = run_study(parse_study(raw(simulate={"sightings_per_s": 0, "gnss_hz": 1})), seed=3)
    assert optics.yaw(View(without)) is None
