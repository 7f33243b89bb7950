"""Tables to what the aided filter's kernel reads: rows of the IMU, and measurements sorted by time.

A measurement is a time, a kind (kernels.aided_measure) and ZW numbers: what was measured, then its sigmas from place 3
(a range: range, lat, lon, height, in the plane?, sigma).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_settings import AidedSettings
from schuler.ground.errors import InputError
from schuler.ground.tables import Table, Tables

Array = NDArray[np.float64]
MAG_HZ = 5.0  # a disturbed field lasts: more rows a second would tell nothing new
ATTITUDE_HZ = 1.0
SPEED_HZ = {"ground": 10.0, "water": 2.0, "air": 2.0}  # waves and gusts last
HEIGHT_HZ = 2.0
COURSE_MPS = 1.0  # slower, a course says nothing
MAG = ("mag_x", "mag_y", "mag_z")
_STD_PLACE = ("std_north", "std_east", "std_down")
Add = Callable[..., None]


@dataclass
class Events:
    """Measurements in the order they are taken. time (m,), kind (m,) int, z (m, ZW)."""

    time: Array
    kind: NDArray[np.int64]
    z: Array
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.time)

    def since(self, time: float) -> Events:
        """Those later than a time."""
        keep = self.time > time
        return Events(self.time[keep], self.kind[keep], np.ascontiguousarray(self.z[keep]), self.notes)


def imu_rows(imu: Table) -> Array:
    """(n, 7) time, rate rad/s, specific force m/s^2 in b: means over the interval that ends at the time."""
    t = imu.time
    if imu.kind == "increments":
        dt = np.diff(t, prepend=t[0] - float(np.median(np.diff(t))))[:, None]
        rate = imu.stack("dtheta_x", "dtheta_y", "dtheta_z") / dt
        force = imu.stack("dv_x", "dv_y", "dv_z") / dt
    else:
        rate, force = imu.stack("gyro_x", "gyro_y", "gyro_z"), imu.stack("accel_x", "accel_y", "accel_z")
    return np.ascontiguousarray(np.column_stack([t, rate, force]))


def sensors_present(tables: Tables) -> set[str]:
    """Names of the tables that speak, "magnetometer" where the imu carries one."""
    have = {name for name in tables if name != "imu"}
    if "imu" in tables and all(c in tables["imu"] for c in MAG):
        have.add("magnetometer")
    return have


def slow_sigma(gnss: Table | None, s: AidedSettings) -> float:
    """Sigma of the fixes' slow error: no larger than the receiver's own sigma allows.

    The first sigma alone: a row of the solution must not know what comes later.
    """
    if gnss is None:
        return s.gnss_correlated_std
    told = gnss["std_north"] if "std_north" in gnss else np.array([])
    told = told[np.isfinite(told) & (told > 0.0)]
    return min(s.gnss_correlated_std, 0.9 * float(told[0])) if len(told) else s.gnss_correlated_std


def _sigma(table: Table, column: str, default: float, slow: float = 0.0) -> Array:
    """The sigma of each row: told by the table (less its slow part), or the default."""
    told = table[column].astype(float) if column in table else np.full(len(table), np.nan)
    good = np.isfinite(told) & (told > 0.0)
    part = np.minimum(slow, 0.9 * np.where(good, told, inf))
    return np.where(good, np.sqrt(np.maximum(np.where(good, told, 1.0) ** 2 - part**2, 0.0)), default)


def _thinned(time: Array, rate: float) -> NDArray[np.bool_]:
    """Rows about 1/rate apart."""
    if len(time) < 2:
        return np.ones(len(time), dtype=bool)
    slot = np.floor((time - time[0]) * rate + 1e-6)
    return np.concatenate([[True], np.diff(slot) > 0])


def events_of(tables: Tables, s: AidedSettings) -> Events:
    """Every usable row of every table as a measurement."""
    from schuler.kernels import aided_measure as k
    from schuler.kernels.aided_run import ZW

    parts: list[tuple[Array, int, Array]] = []
    notes: list[str] = []

    late, v_late = s.ahead
    shift = {k.POSITION: late, k.VELOCITY: v_late, k.COURSE: v_late}

    def add(kind: int, table: Table, values: list[Array | float], keep: NDArray[np.bool_] | None = None) -> None:
        good = np.ones(len(table), dtype=bool) if keep is None else keep
        z = np.full((int(good.sum()), ZW), np.nan)
        for i, v in enumerate(values):
            z[:, i] = v[good] if isinstance(v, np.ndarray) else v
        parts.append((table.time[good] + shift.get(kind, 0.0), kind, z))

    nan = float("nan")
    if "gnss" in tables:
        g = tables["gnss"]
        slow = s.gnss_correlated_std
        std = [
            _sigma(g, f"std_{a}", d, w)
            for a, d, w in zip(("north", "east", "down"), s.gnss_std, (slow, slow, 1.5 * slow), strict=True)
        ]
        up = g["height"].astype(float) if "height" in g else np.full(len(g), nan)
        add(k.POSITION, g, [g["lat"], g["lon"], up, *std], np.isfinite(g["lat"]) & np.isfinite(g["lon"]))
        vstd = [_sigma(g, f"std_v_{a}", d) for a, d in zip(("north", "east", "down"), s.gnss_velocity_std, strict=True)]
        if "v_north" in g and "v_east" in g:
            down = g["v_down"].astype(float) if "v_down" in g else np.full(len(g), nan)
            good = np.isfinite(g["v_north"]) & np.isfinite(g["v_east"])
            add(k.VELOCITY, g, [g["v_north"], g["v_east"], down, *vstd], good)
        elif "course" in g and "speed" in g:
            good = np.isfinite(g["course"]) & (g["speed"] > COURSE_MPS)
            add(k.COURSE, g, [g["course"], nan, nan, vstd[0] / np.maximum(g["speed"], COURSE_MPS)], good)
    if "speed" in tables:
        v = tables["speed"]
        speed = speed_of(v)
        keep = np.isfinite(speed)
        keep[np.flatnonzero(keep)] = _thinned(v.time[keep], SPEED_HZ[s.speed_is])
        add(k.SPEED, v, [speed, nan, nan, _sigma(v, "std_speed", s.speed_std)], keep)
    if "dvl" in tables:
        d = tables["dvl"]
        std_d = [_sigma(d, f"std_v_{a}", s.dvl_std) for a in "xyz"]
        v_d = [d["v_x"], d["v_y"], d["v_z"]]
        add(k.BOTTOM_TRACK, d, [*v_d, *std_d], np.isfinite(np.column_stack(v_d)).all(axis=1))
    if "depth" in tables:
        d = tables["depth"]
        add(k.DEPTH, d, [d["depth"], nan, nan, _sigma(d, "std_depth", s.depth_std)], np.isfinite(d["depth"]))
    if "height" in tables:
        h = tables["height"]
        keep = np.isfinite(h["height"])
        keep[np.flatnonzero(keep)] = _thinned(h.time[keep], HEIGHT_HZ)
        add(k.HEIGHT, h, [h["height"], nan, nan, _sigma(h, "std_height", s.height_std)], keep)
    if "attitude" in tables:
        a = tables["attitude"]
        heading = a["heading"] if "heading" in a else a["heading_mag"] + s.declination
        keep = _thinned(a.time, ATTITUDE_HZ) & np.isfinite(a["roll"] + a["pitch"] + heading)
        std_a = [_sigma(a, f"std_{n}", d) for n, d in zip(("roll", "pitch", "heading"), s.attitude_std, strict=True)]
        # An AHRS errs for seconds on end: each row a second counts as the share of an independent one that it is.
        wide = np.sqrt(max(1.0, s.attitude_tau * ATTITUDE_HZ / 3.0))
        add(k.ATTITUDE, a, [a["roll"], a["pitch"], heading, *(x * wide for x in std_a)], keep)
    imu = tables.get("imu")
    if imu is not None and all(c in imu for c in MAG):
        field_b = imu.stack(*MAG)
        keep = np.isfinite(field_b).all(axis=1) & (np.abs(field_b).sum(axis=1) > 0.0)
        keep[np.flatnonzero(keep)] = _thinned(imu.time[keep], MAG_HZ)
        add(k.MAGNETOMETER, imu, [field_b[:, 0], field_b[:, 1], field_b[:, 2], s.mag_std], keep)
    if "ranges" in tables:
        _add_ranges(tables, s, add, notes)
    if "sightings" in tables:
        _add_sightings(tables, s, add, notes)
    if "lidar" in tables:
        _add_lidar(tables, s, add, notes)
    if not parts:
        return Events(np.zeros(0), np.zeros(0, np.int64), np.zeros((0, ZW)), notes)
    time = np.concatenate([p[0] for p in parts])
    kind = np.concatenate([np.full(len(p[0]), p[1], dtype=np.int64) for p in parts])
    z = np.vstack([p[2] for p in parts])
    order = np.lexsort((kind, time))
    return Events(time[order], kind[order], np.ascontiguousarray(z[order]), notes)


def speed_of(table: Table) -> Array:
    """(n,) m/s of a speed table; of increments of way the mean over the interval."""
    if "speed" in table:
        return table["speed"].astype(float)
    dt = np.diff(table.time, prepend=np.nan)
    return np.where(dt > 0, table["ddist"] / dt, np.nan)


def _identified(tables: Tables, name: str, notes: list[str]) -> tuple[Table, NDArray[np.int64]]:
    """The landmarks, and which of them each row of a table means (-1: none of them)."""
    rows, points = tables[name], tables.get("landmarks")
    if points is None:
        raise InputError(f"{name} need the places of what they saw: name a landmarks table in [input]")
    where = {str(key): i for i, key in enumerate(points["id"])}
    told = rows["id"].astype(str)
    names, inverse = np.unique(told, return_inverse=True)
    index = np.array([where.get(str(key), -1) for key in names], dtype=np.int64)[inverse]
    unknown = sorted(set(told[index < 0]) - {""})
    if len(index) and (index < 0).all():
        raise InputError(
            f"{name}: none of their ids ({', '.join(unknown[:5]) or 'empty'}) is in the landmarks "
            f"({', '.join(list(where)[:5])}); the ids must be the same words"
        )
    if unknown:
        more = f" and {len(unknown) - 5} more" if len(unknown) > 5 else ""
        notes.append(
            f"{name}: {int((index < 0).sum())} rows of {', '.join(unknown[:5])}{more}: not in the landmarks, left out"
        )
    return points, index


def _heights(points: Table) -> Array:
    return points["height"].astype(float) if "height" in points else np.full(len(points), np.nan)


def _add_sightings(tables: Tables, s: AidedSettings, add: Add, notes: list[str]) -> None:
    from schuler.kernels import aided_measure as k

    seen = tables["sightings"]
    if s.camera is None:
        raise InputError("sightings need the camera that saw them: type [camera] focal_px and the others")
    points, index = _identified(tables, "sightings", notes)
    at = np.maximum(index, 0)
    height = _heights(points)[at]
    blind = (index >= 0) & ~np.isfinite(height)
    if blind.any():
        notes.append(f"sightings: {int(blind.sum())} of landmarks without a height, left out")
    keep = (index >= 0) & ~blind & np.isfinite(seen["u"]) & np.isfinite(seen["v"])
    nan = np.zeros(len(points))
    std = [np.nan_to_num(points[c].astype(float) if c in points else nan)[at] for c in _STD_PLACE]
    add(
        k.SIGHTING, seen,
        [seen["u"], seen["v"], points["lat"][at], points["lon"][at], height,
         _sigma(seen, "std_u", s.camera.sigma), _sigma(seen, "std_v", s.camera.sigma), *std], keep,
    )  # fmt: skip


def _add_lidar(tables: Tables, s: AidedSettings, add: Add, notes: list[str]) -> None:
    """Rows with an id range a landmark; those without one range the ground of a height model."""
    from schuler.kernels import aided_measure as k

    beams = tables["lidar"]
    sigma = _sigma(beams, "std_range", s.lidar_std)
    good = np.isfinite(beams["range"])
    far = good & (beams["range"] > s.lidar_reach)
    if far.any():
        notes.append(f"lidar: {int(far.sum())} ranges beyond the sensor's {s.lidar_reach:g} m, left out")
        good &= ~far
    named = np.zeros(len(beams), dtype=bool)
    if "id" in beams:
        named = np.char.strip(beams["id"].astype(str)) != ""
        if named.any():
            points, index = _identified({**tables, "lidar": beams.where(named)}, "lidar", notes)
            at = np.zeros(len(beams), np.int64)
            at[named] = np.maximum(index, 0)
            known = named.copy()
            known[named] = index >= 0
            up = _heights(points)[at]
            add(
                k.LIDAR, beams, [beams["range"], points["lat"][at], points["lon"][at], up, 0.0, sigma],
                good & known & np.isfinite(up),
            )  # fmt: skip
    ground = good & ~named
    if ground.any() and s.height_model is None:
        notes.append(f"lidar: {int(ground.sum())} beams without an id, and no height_model to range: left out")
    elif ground.any():
        add(k.TERRAIN, beams, [beams["range"], beams["azimuth"], beams["elevation"], np.nan, np.nan, sigma], ground)


def _add_ranges(tables: Tables, s: AidedSettings, add: Add, notes: list[str]) -> None:
    from schuler.kernels import aided_measure as k

    ranges = tables["ranges"]
    points, index = _identified(tables, "ranges", notes)
    keep = (index >= 0) & np.isfinite(ranges["range"])
    at = np.maximum(index, 0)
    height = _heights(points)
    flat = ~np.isfinite(height[at])
    up = np.where(flat, 0.0, height[at])
    add(
        k.RANGE, ranges,
        [ranges["range"], points["lat"][at], points["lon"][at], up, flat.astype(float),
         _sigma(ranges, "std_range", s.range_std)], keep,
    )  # fmt: skip


def wrapped(angle: Array) -> Array:
    """To (-pi, pi]."""
    return (angle + pi) % (2.0 * pi) - pi
