"""How wrong was the track: estimate minus reference, at the same moment and at the same point of the vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.aiding.solution import Solution
from schuler.ground.earth import WGS84, wrap_pi
from schuler.ground.frames import dcm_from_euler
from schuler.ground.tables import Table

Array = NDArray[np.float64]
DEG = np.pi / 180.0
LONGEST_GAP_S = 1.05  # a reference is never bridged over more, whatever its rate (1 Hz with jitter still counts)


@dataclass
class ErrorSeries:
    """Errors (estimate minus reference) at the moments where both are known.

    time (n,) s; position (n, 3) NED m; velocity (n, 3) NED m/s; rpy (n, 3) rad, wrapped to [-pi, pi);
    cov_pos, cov_vel (n, 3, 3), cov_rpy (n, 3, 3): what the solution claims at these moments. NaN where one of the two
    does not say. Horizontal, vertical ... of `summary` are sizes.
    """

    time: Array
    position: Array
    velocity: Array
    rpy: Array
    cov_pos: Array
    cov_vel: Array
    cov_rpy: Array

    def __len__(self) -> int:
        return len(self.time)

    @property
    def horizontal(self) -> Array:
        """(n,) m."""
        return np.hypot(self.position[:, 0], self.position[:, 1])

    def between(self, start: float, end: float) -> ErrorSeries:
        """The moments with start <= time <= end."""
        keep = (self.time >= start) & (self.time <= end)
        return ErrorSeries(*(getattr(self, f)[keep] for f in self.__dataclass_fields__))


def interpolated(time: Array, values: Array, at: Array, *, angle: bool = False) -> Array:
    """Values (n,) at moments (m,), linear between neighbours, NaN outside and in gaps (`bridgeable`).

    angle : values are angles in rad that may jump by whole turns.
    """
    out = np.full(len(at), np.nan)
    known = np.isfinite(values)
    t, v = time[known], values[known]
    if len(t) == 0:
        return out
    if angle:
        v = np.unwrap(v)
    before = np.searchsorted(t, at, side="right") - 1
    on = (before >= 0) & (np.abs(at - t[np.maximum(before, 0)]) < 1e-6)
    after = np.minimum(np.maximum(before, 0) + 1, len(t) - 1)
    near = np.abs(at - t[after]) < 1e-6
    inside = (before >= 0) & (before < len(t) - 1) & ~on & ~near
    i = before[inside]
    if len(i):
        gap = t[i + 1] - t[i]
        fine = gap <= bridgeable(time)
        w = (at[inside] - t[i]) / gap
        out[inside] = np.where(fine, v[i] + w * (v[i + 1] - v[i]), np.nan)
    out[on] = v[before[on]]
    out[near & ~on] = v[after[near & ~on]]
    return out


def bridgeable(time: Array) -> float:
    """The longest gap that may be interpolated over: two intervals, and never more than about a second."""
    if len(time) < 2:
        return 0.0
    return float(min(LONGEST_GAP_S, 2.02 * np.median(np.diff(time))))


def error_series(solution: Solution, reference: Table, lever_frd: ArrayLike = (0.0, 0.0, 0.0)) -> ErrorSeries:
    """Errors of a track against a reference.

    lever_frd : (3,) m, from the IMU (whose track the solution is) to the point that the reference describes, body FRD.
    A reference slower than about 1 Hz is not interpolated: then the solution is, at the reference's own moments.
    """
    moved = at_point(solution, lever_frd)
    interval = np.median(np.diff(reference.time)) if len(reference) > 1 else np.inf
    if interval > LONGEST_GAP_S:
        inside = (reference.time >= moved.time[0]) & (reference.time <= moved.time[-1])
        moved = resampled(moved, reference.time[inside])
    t = moved.time

    def ref(column: str, angle: bool = False) -> Array:
        if column not in reference:
            return np.full(len(t), np.nan)
        return interpolated(reference.time, reference[column], t, angle=angle)

    lat, lon, height = ref("lat"), ref("lon", angle=True), ref("height")
    flat = np.where(np.isfinite(height), height, 0.0)
    own_flat = np.where(np.isfinite(moved.height), moved.height, flat)
    position = WGS84.displacement_n(moved.lat, moved.lon, own_flat, lat, lon, flat)
    position[~(np.isfinite(moved.height) & np.isfinite(height)), 2] = np.nan
    velocity = moved.v_n - np.column_stack([ref("v_north"), ref("v_east"), ref("v_down")])
    rpy = moved.rpy - np.column_stack([ref("roll", True), ref("pitch", True), ref("heading", True)])
    rpy = np.where(np.isfinite(rpy), wrap_pi(np.where(np.isfinite(rpy), rpy, 0.0)), np.nan)
    series = ErrorSeries(t, position, velocity, rpy, moved.cov_pos, moved.cov_vel, moved.cov_rpy)
    said = np.isfinite(position).any(axis=1) | np.isfinite(velocity).any(axis=1) | np.isfinite(rpy).any(axis=1)
    return ErrorSeries(*(getattr(series, f)[said] for f in series.__dataclass_fields__))


def at_point(solution: Solution, lever_frd: ArrayLike) -> Solution:
    """The track of another point of the vehicle: position C_nb l further on, velocity with its rate of change."""
    lever = np.asarray(lever_frd, dtype=np.float64)
    if not lever.any() or len(solution) < 2:
        return solution
    rpy = np.where(np.isfinite(solution.rpy), solution.rpy, 0.0)
    arm = dcm_from_euler(rpy[:, 0], rpy[:, 1], rpy[:, 2]) @ lever
    height = np.where(np.isfinite(solution.height), solution.height, 0.0)
    lat, lon, up = WGS84.displace(solution.lat, solution.lon, height, arm)
    up = np.where(np.isfinite(solution.height), up, np.nan)
    swing = np.gradient(arm, solution.time, axis=0)
    return Solution(
        solution.time,
        lat,
        lon,
        up,
        solution.v_n + swing,
        solution.rpy,
        solution.cov_pos,
        solution.cov_vel,
        solution.cov_rpy,
    )


def resampled(solution: Solution, at: Array) -> Solution:
    """The track at other moments, linear between rows; the covariance is that of the row before."""
    t = solution.time
    before = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 1)

    def line(values: Array, angle: bool = False) -> Array:
        return np.interp(at, t, np.unwrap(values) if angle else values)

    return Solution(
        at,
        line(solution.lat),
        line(solution.lon, angle=True),
        line(solution.height),
        np.column_stack([line(solution.v_n[:, k]) for k in range(3)]),
        np.column_stack([line(solution.rpy[:, k], angle=True) for k in range(3)]),
        solution.cov_pos[before],
        solution.cov_vel[before],
        solution.cov_rpy[before],
    )


def state_at(solution: Solution, time: float) -> tuple[int, Array]:
    """Row and NED metres to add to it for a moment: the last row not after it, carried on with its velocity.

    A later row may have seen a measurement that this moment has not. Row -1 where the track begins later.
    """
    row = int(np.searchsorted(solution.time, time + 1e-9, side="right")) - 1
    if row < 0:
        return -1, np.full(3, np.nan)
    v_n = np.where(np.isfinite(solution.v_n[row]), solution.v_n[row], 0.0)
    return row, v_n * max(time - solution.time[row], 0.0)


def offset_from(
    solution: Solution, time: float, lat: float, lon: float, height: float | None = None
) -> tuple[int, Array]:
    """Row and NED metres of the track at a moment minus a place in rad (and m); down is NaN without a height."""
    row, ahead = state_at(solution, time)
    if row < 0:
        return -1, np.full(3, np.nan)
    own = float(solution.height[row])
    own = own if np.isfinite(own) else 0.0
    d = WGS84.displacement_n(
        solution.lat[row],
        solution.lon[row],
        own,
        lat,
        lon,
        own if height is None or not np.isfinite(height) else height,
    )
    d = d + ahead
    if height is None or not np.isfinite(height) or not np.isfinite(solution.height[row]):
        d[2] = np.nan
    return row, d


def spread(values: Array) -> dict[str, float] | None:
    """S of summary.json: {"rms", "p95", "max", "end"} of sizes (n,); None where nothing is known."""
    size = np.abs(values[np.isfinite(values)])
    if len(size) == 0:
        return None
    return {
        "rms": float(np.sqrt(np.mean(size**2))),
        "p95": float(np.percentile(size, 95)),
        "max": float(size.max()),
        "end": float(size[-1]),
    }


def summary(series: ErrorSeries | None) -> dict[str, Any]:
    """E of summary.json. Every figure is a size (no sign); None where the reference does not say."""
    names = ("horizontal_m", "vertical_m", "velocity_mps", "roll_deg", "pitch_deg", "heading_deg")
    if series is None:
        return dict.fromkeys(names)
    known = np.isfinite(series.velocity)
    velocity = np.sqrt(np.sum(np.where(known, series.velocity, 0.0) ** 2, axis=1))
    velocity[~known[:, :2].all(axis=1)] = np.nan  # a speed error without north or east says nothing
    values = (series.horizontal, series.position[:, 2], velocity, *(series.rpy.T / DEG))
    return {name: spread(value) for name, value in zip(names, values, strict=True)}


def circular(horizontal: Array) -> dict[str, float] | None:
    """CEP and R95 from the sample itself (no circle assumed): {"cep_m", "r95_m"} of horizontal errors (n,) m."""
    size = horizontal[np.isfinite(horizontal)]
    if len(size) == 0:
        return None
    return {"cep_m": float(np.median(size)), "r95_m": float(np.percentile(size, 95))}


def distance(lat: Array, lon: Array) -> float:
    """Length of a track over ground, m, from positions in rad; steps that are NaN are left out."""
    if len(lat) < 2:
        return 0.0
    zero = np.zeros(len(lat) - 1)
    step = WGS84.displacement_n(lat[1:], lon[1:], zero, lat[:-1], lon[:-1], zero)
    return float(np.nansum(np.hypot(step[:, 0], step[:, 1])))
