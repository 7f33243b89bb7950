"""Compiled kernels: whether they are in numba's cache, and compiling all of them once."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from schuler.studies.cache import drop_stale

KERNELS = Path(__file__).resolve().parents[1] / "kernels"


# what a program does when kernels that are needed now are not compiled yet; None: numba compiles them when called
on_cold: Callable[[Sequence[str]], None] | None = None
_told: set[str] = set()  # modules that on_cold has been called with


def need(*modules: str) -> None:
    """Says that these kernel modules are about to run; where they are not compiled, `on_cold` is called with them."""
    new = [m for m in modules if m not in _told]
    if on_cold is not None and new and cold(new):
        _told.update(new)
        on_cold(new)


def cold(modules: Sequence[str]) -> bool:
    """Whether a kernel module has nothing in numba's cache that is as new as its source. False where one cannot say.

    What is there from older sources is thrown away first.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return False
    drop_stale()
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(chosen) if chosen else KERNELS / "__pycache__"
    if not chosen and not os.access(KERNELS, os.W_OK):
        return False  # numba keeps its cache elsewhere then
    tag = f"py{sys.version_info.major}{sys.version_info.minor}"
    for module in modules:
        source = KERNELS / f"{module}.py"
        if not source.exists():
            continue
        found = folder.rglob(f"{module}.*{tag}*.nbi") if chosen else folder.glob(f"{module}.*{tag}*.nbi")
        newest = max((p.stat().st_mtime for p in found), default=0.0)
        if newest < source.stat().st_mtime:
            return True
    return False


def warm_auv() -> None:
    """Kind "auv": simulation, filter with every sensor, smoother, the compass's mode, the online filter."""
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    mission = {"surface_s": 30.0, "dive_s": 240.0, "depth_m": 0.0, "final_surface_s": 20.0}
    for extra in ({}, {"magnetometer": True, "dvl": True}):
        study = parse_study({"study": {"name": "warmup", "kind": "auv"}, "mission": {**mission, **extra}})
        run_study(study)


def warm_compass() -> None:
    """Kind "auv" without an IMU: attitude, depth and fixes."""
    from dataclasses import replace

    from schuler.aiding.auv import AuvSettings, navigate
    from schuler.truth.instruments import AttitudeSensor
    from schuler.truth.missions import PRESETS
    from schuler.truth.recording import simulate
    from schuler.truth.sensors import SUITES

    mission = replace(PRESETS["demo"], surface=30.0)
    suite = SUITES["demo"].with_changes(attitude=AttitudeSensor())
    tables = dict(simulate(mission, suite).tables)
    navigate({name: tables[name] for name in ("attitude", "gnss", "depth")}, AuvSettings())


def warm_paper() -> None:
    """The paper's filter."""
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    for method in ("paper", "paper-literal"):
        raw = {
            "study": {"name": "warmup", "kind": "auv"},
            "mission": {"surface_s": 30.0, "dive_s": 240.0, "depth_m": 0.0},
            "filter": {"method": method},
        }
        run_study(parse_study(raw))


def warm_platform() -> None:
    """Kind "platform": every algorithm in every form, alignment, a small map."""
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    for form in ("exact", "corrected"):
        keys = {"duration_s": 60.0, "form": form, "map": {"lat_deg": [0.0, 80.0, 2.0], "heading_deg": [0.0, 90.0, 2.0]}}
        run_study(parse_study({"study": {"name": "warmup", "kind": "platform"}, "platform": keys}))


def warm_strapdown() -> None:
    """Kind "strapdown": truth, mechanization, error model, alignment, attitude study."""
    from schuler.inertial.attitude_study import integrate
    from schuler.studies.align import align_study
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    for preset in ("legs", "great-circle", "rest"):
        raw = {
            "study": {"name": "warmup", "kind": "strapdown"},
            "start": {"lat_deg": 50.0},
            "trajectory": {"preset": preset, "duration_s": 60.0, "rate_hz": 50},
            "imu": {"gyro_bias_deg_per_h": 0.01, "accel_bias_ug": 50, "gyro_arw_deg_per_sqrt_h": 0.001},
        }
        run_study(parse_study(raw))
    align_study(parse_study({**raw, "align": {"from_s": 0.0, "to_s": 60.0}}))
    integrate("quaternion", 4, 0.1, 1.0)


def warm_calibration() -> None:
    """Commands calibrate and allan."""
    import numpy as np

    from schuler.calibration.allan import KINDS, deviation
    from schuler.calibration.gyros import fit_gyros, turns_between
    from schuler.calibration.multiposition import fit_accelerometers
    from schuler.calibration.rests import Rest
    from schuler.calibration.turntable import calibrate
    from schuler.truth.turntable import THESIS_PLAN, Turntable, positions_table

    rng = np.random.default_rng(1)
    for kind in KINDS:
        deviation(rng.standard_normal(200), 10.0, kind=kind)
    plan = positions_table(THESIS_PLAN, still_s=5.0, spin_s=20.0)
    calibrate(Turntable(np.zeros((3, 3))).record(plan, 10.0), plan)
    n = 60
    time = np.asarray(0.1 * np.arange(n), dtype=np.float64)
    force = rng.standard_normal((n, 3))
    gyro = np.zeros((n, 3))
    corners = ([1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1])
    rests = [
        Rest(10 * k, 10 * k + 8, float(k), k + 0.8, 9.8 * np.array(c, dtype=float), np.zeros(3), np.full(3, 0.01))
        for k, c in enumerate(corners)
    ]
    accel = fit_accelerometers(rests, 9.8, holdout=False)
    fit_gyros(time, gyro, force, rests, turns_between(rests), accel, holdout=False)


def warm_planar() -> None:
    """Kind "planar": every kind of measurement, a start that is found, the smoother."""
    import numpy as np

    from schuler.aiding.planar import PlanarSettings, Plane, navigate
    from schuler.ground.tables import Table

    t = np.arange(1.0, 61.0)
    plane = Plane(0.9, 0.2)
    lat, lon = plane.geodetic(2.0 * t, 0.0 * t)
    speed = np.where(t > 50.0, 0.0, 2.0)
    place = {"lat": lat[:3], "lon": lon[:3]}
    tables = {
        "speed": Table("speed", {"time": t, "speed": speed, "dheading": 0.0 * t}),
        "gnss": Table("gnss", {"time": t, "lat": lat, "lon": lon, "v_north": speed, "v_east": 0.0 * t}),
        "ranges": Table("ranges", {"time": t[:40], "id": np.array(["1"] * 40), "range": 2.0 * t[:40] + 1.0}),
        "landmarks": Table("landmarks", {"id": np.array(["1", "2", "3"]), **place}),
    }
    navigate(tables, PlanarSettings(), plane)


def warm_ahrs() -> None:
    """Kind "ahrs": filter with and without magnetometer, smoother, the online filter."""
    import numpy as np

    from schuler.aiding.ahrs import AhrsFilter, AhrsSettings, navigate
    from schuler.ground.tables import Table

    t = np.asarray(0.01 * np.arange(1, 200), dtype=np.float64)
    columns = {"time": t, **{f"{s}_{a}": np.zeros_like(t) for s in ("gyro", "accel", "mag") for a in "xyz"}}
    columns["accel_z"] = columns["accel_z"] - 9.81
    columns["mag_x"], columns["mag_z"] = columns["mag_x"] + 2e-5, columns["mag_z"] + 4e-5
    navigate({"imu": Table("imu", columns, "rates")}, AhrsSettings())
    AhrsFilter(interval=0.01).update(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (2e-5, 0.0, 4e-5))


def warm_optics() -> None:
    """Camera, lidar, pose from known points, strapdown in Earth-fixed axes."""
    import numpy as np

    from schuler.aiding.optics import pose
    from schuler.ground.camera import Camera
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    start = {"lat_deg": 50.0, "height_m": 600.0, "std_north_m": 3.0, "std_east_m": 3.0, "std_down_m": 3.0}
    raw = {
        "study": {"name": "warmup", "kind": "aided"},
        "start": start,
        "trajectory": {"preset": "legs", "speed_mps": 50.0, "duration_s": 30.0, "rate_hz": 20},
        "camera": {"focal_px": 5000.0},
        "simulate": {"sightings_per_s": 4, "lidar_hz": 2, "ground_relief_m": 10},
    }
    run_study(parse_study(raw))
    points = np.array([[200.0, 150, 1000], [200, -150, 1000], [-200, 150, 1000], [-200, -150, 1000], [0, 20, 990]])
    camera = Camera.of(5000.0)
    pose(points, camera.project(points, np.zeros(3), np.eye(3))[0], camera)
    pose(points, camera.project(points, np.zeros(3), np.eye(3))[0], camera, start=(np.zeros(3), np.eye(3)))
    raw = {
        "study": {"name": "warmup", "kind": "strapdown"},
        "start": {"lat_deg": 50.0},
        "trajectory": {"preset": "legs", "duration_s": 60.0, "rate_hz": 50},
        "filter": {"frame": "ecef"},
    }
    run_study(parse_study(raw))


def warm_aided() -> None:
    """Kind "aided": every sensor at once, a start in motion, standing, a start of row by row use, the smoother."""
    import numpy as np

    from schuler.aiding.aided import AidedSettings, Sensor, navigate
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study
    from schuler.studies.simulated import simulation

    study = {
        "study": {"name": "warmup", "kind": "aided"},
        "start": {"lat_deg": 50.0, "lon_deg": 10.0, "height_m": 200.0},
        "trajectory": {"preset": "car", "duration_s": 60.0, "rate_hz": 50.0},
        "imu": {"preset": "consumer"},
        "camera": {"focal_px": 2000.0},
        "simulate": {
            "speed_hz": 1.0, "dvl_hz": 1.0, "depth_hz": 1.0, "height_hz": 1.0, "magnetometer": True, "ranges_hz": 1.0,
            "sightings_per_s": 4.0, "sightings_hz": 1.0, "lidar_hz": 1.0,
        },
        "filter": {"constraints": ["nhc", "zupt"]},
    }  # fmt: skip
    run_study(parse_study(study))
    study["simulate"] = {}
    tables = dict(simulation(parse_study(study)).record(1).tables)

    def measure(state: Any, z: Any) -> Any:
        H = np.zeros((1, state.n))
        H[0, state.at("position")][2] = -1.0
        return [state.height], H

    settings = AidedSettings(constraints=("nhc",))
    navigate(tables, settings, [Sensor("height", ("up",), "m", np.array([30.0]), np.array([0.0]), 1.0, measure)])


# what `schuler warmup` runs, in order; a part that brings kernels of its own adds a line
STEPS: list[tuple[str, Callable[[], None]]] = [
    ("auv: simulation, filter, smoother", warm_auv),
    ("auv: a vehicle's own compass", warm_compass),
    ("auv: the paper's filter", warm_paper),
    ("aided: truth, every sensor, smoother", warm_aided),
    ("planar: filter and smoother", warm_planar),
    ("ahrs: filter, smoother", warm_ahrs),
    ("platform: alignment, algorithms, maps", warm_platform),
    ("strapdown: truth, mechanization, error model, alignment", warm_strapdown),
    ("optics: camera, lidar, poses, Earth-fixed axes", warm_optics),
    ("calibration: turntable, rests and turns, Allan deviation", warm_calibration),
]


def warm_all(progress: Callable[[str], None]) -> None:
    """Compiles everything that is not in the cache yet."""
    for name, step in STEPS:
        progress(f"compiling {name}")
        step()
