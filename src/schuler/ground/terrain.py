"""A height model: heights on a regular grid of latitude and longitude, bilinear between the points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import wrap_pi
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HeightModel:
    """heights (rows, columns) m over the ellipsoid, NaN where there is none; row 0, column 0 at (lat0, lon0), rad;
    dlat, dlon rad, both above 0. sigma: m, of its heights."""

    lat0: float
    lon0: float
    dlat: float
    dlon: float
    heights: Array
    sigma: float = 0.0

    def __post_init__(self) -> None:
        h = np.ascontiguousarray(self.heights, dtype=np.float64)
        if h.ndim != 2 or min(h.shape, default=0) < 2:
            raise InputError(f"a height model needs at least 2 x 2 heights; got {h.shape}")
        if not (self.dlat > 0.0 and self.dlon > 0.0):
            raise InputError("the grid steps of a height model must be above 0")
        if not np.isfinite(h).any():
            raise InputError("the height model holds no height at all")
        object.__setattr__(self, "heights", h)

    @classmethod
    def from_table(cls, table: Table, sigma: float = 0.0) -> HeightModel:
        """From the contract's table (lat, lon, height; regular grid, rows in any order; missing points are holes)."""
        who = table.source or "height_model"
        lats, rows = _axis(table["lat"], "lat", who)
        turned = wrap_pi(table["lon"] - float(table["lon"][0]))
        lons, columns = _axis(turned, "lon", who)
        heights = np.full((len(lats), len(lons)), np.nan)
        heights[rows, columns] = table["height"]
        if len(np.unique(rows * len(lons) + columns)) < len(table):
            raise InputError(f"{who}: some places of the grid are there twice; keep one row for each")
        step = [float(a[-1] - a[0]) / (len(a) - 1) for a in (lats, lons)]
        return cls(float(lats[0]), float(wrap_pi(lons[0] + table["lon"][0])), step[0], step[1], heights, sigma)

    def table(self) -> Table:
        """As the contract's table, holes left out."""
        rows, columns = self.heights.shape
        lat = np.repeat(self.lat0 + self.dlat * np.arange(rows), columns)
        lon = np.asarray(wrap_pi(np.tile(self.lon0 + self.dlon * np.arange(columns), rows)))
        h = self.heights.ravel()
        there = np.isfinite(h)
        return Table("height_model", {"lat": lat[there], "lon": lon[there], "height": h[there]}, source="height model")

    @property
    def grid(self) -> Array:
        """(4,) lat0, lon0, dlat, dlon, as the kernels take it."""
        return np.array([self.lat0, self.lon0, self.dlat, self.dlon])

    def at(self, lat: ArrayLike, lon: ArrayLike) -> Array:
        """Heights, m, at places in rad (arrays that broadcast together); NaN where the model does not cover them."""
        p, l = np.broadcast_arrays(np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64))
        x = (p - self.lat0) / self.dlat
        turn = np.asarray(wrap_pi(l - self.lon0))
        y = np.where(turn < 0.0, np.where(self._wide, turn + 2.0 * np.pi, turn), turn) / self.dlon
        rows, columns = self.heights.shape
        tiny = 1e-9
        inside = (x >= -tiny) & (x <= rows - 1 + tiny) & (y >= -tiny) & (y <= columns - 1 + tiny)
        i = np.clip(np.floor(np.where(inside, x, 0.0)).astype(int), 0, rows - 2)
        j = np.clip(np.floor(np.where(inside, y, 0.0)).astype(int), 0, columns - 2)
        a, b = x - i, y - j
        H = self.heights
        h = (1 - a) * ((1 - b) * H[i, j] + b * H[i, j + 1]) + a * ((1 - b) * H[i + 1, j] + b * H[i + 1, j + 1])
        return np.where(inside, h, np.nan)

    @property
    def _wide(self) -> bool:
        return (self.heights.shape[1] - 1) * self.dlon > np.pi


def _axis(values: Array, name: str, who: str) -> tuple[Array, NDArray[np.int64]]:
    """The distinct values of a grid's axis, rising, and the place of each row among them; InputError if uneven."""
    order = np.sort(values)
    gap = np.diff(order)
    typical = float(np.max(gap, initial=0.0))
    if not typical > 0.0:
        raise InputError(f"{who}: all rows have one {name}; a height model is a grid of lat and lon")
    axis = order[np.concatenate([[True], gap > 0.2 * typical])]
    step = np.diff(axis)
    if np.max(np.abs(step - np.median(step))) > 0.02 * np.median(step):
        raise InputError(
            f"{who}: the steps of {name} run from {np.degrees(step.min()):.3g} to {np.degrees(step.max()):.3g} deg: "
            "the grid must be regular in lat and lon; resample it"
        )
    place = np.rint((values - axis[0]) / ((axis[-1] - axis[0]) / (len(axis) - 1))).astype(np.int64)
    return axis, place
