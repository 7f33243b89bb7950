"""What the sections of a page look at: the result in local metres, its errors, its dives, on the page's time axis.

Computed once a page, so that a section is a few lines.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Innovations, Solution
from schuler.ground.earth import displacement_n
from schuler.judging.errors import ErrorSeries, distance, error_series
from schuler.judging.outages import dives, surfacings
from schuler.judging.result import Result
from schuler.report import figures
from schuler.report.figures import Pool, TimeAxis

Array = NDArray[np.float64]
_SURFACE_M = 2.0  # shallower than this is the surface


@dataclass(frozen=True)
class Track:
    """A solution, its rows in metres from the page's origin (n, 3) NED, and its errors where a reference tells them."""

    solution: Solution
    ned: Array
    errors: ErrorSeries | None

    @property
    def time(self) -> Array:
        return self.solution.time

    def std(self, which: str) -> Array:
        """(n, 3) 1-sigma of "pos", "vel" or "rpy" at the solution's rows."""
        return roots(getattr(self.solution, f"cov_{which}"))


@dataclass(frozen=True)
class Dive:
    """A stretch without fixes: from the last fix before it to the first one after it, or to the end of the track.

    told : an entry of "dives" of summary.json, or what is known of it. surfacing : of "surfacings", where a fix came.
    """

    start: float
    end: float
    row: int  # the filter's last row that has not seen the fix
    told: Mapping[str, Any]
    surfacing: Mapping[str, Any] | None

    @property
    def seconds(self) -> float:
        return self.end - self.start

    def of(self, key: str) -> float:
        """A figure of `told`; NaN where it is not known."""
        value = self.told.get(key)
        return math.nan if value is None else float(value)


def roots(cov: Array) -> Array:
    """(n, 3) square roots of the diagonals of (n, 3, 3)."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.diagonal(cov, axis1=1, axis2=2))


@dataclass
class View:
    """A result as a page sees it. `pool` collects the arrays of all figures."""

    result: Result
    pool: Pool = field(default_factory=Pool)

    # what and how

    @property
    def name(self) -> str:
        return str(_get(self.result.study, "study.name") or "study")

    @property
    def kind(self) -> str:
        return str(_get(self.result.study, "study.kind") or "")

    @property
    def method(self) -> str:
        return str(_get(self.result.study, "filter.method") or "")

    @property
    def simulated(self) -> bool:
        """The truth is the simulation's own."""
        return bool(self.result.truth_states) or _get(self.result.study, "mission") is not None

    @property
    def summary(self) -> dict[str, Any]:
        return self.result.summary or {}

    # tracks

    @cached_property
    def origin(self) -> tuple[float, float, float]:
        metres = self.result.navigation.extras.get("metres")
        if metres is not None:
            return metres.plane.lat, metres.plane.lon, 0.0
        f = self.result.navigation.filter
        good = np.isfinite(f.lat) & np.isfinite(f.lon)
        if not good.any():
            return 0.0, 0.0, 0.0
        i = int(np.argmax(good))
        return float(f.lat[i]), float(f.lon[i]), 0.0

    def ned(self, lat: Array, lon: Array, height: Array | None = None) -> Array:
        """(n, 3) metres north, east, down of the page's origin."""
        up = np.zeros_like(np.asarray(lat, dtype=float)) if height is None else height
        return displacement_n(lat, lon, up, *self.origin)

    @cached_property
    def filter(self) -> Track:
        return self._track(self.result.navigation.filter)

    @cached_property
    def smoother(self) -> Track | None:
        s = self.result.navigation.smoother
        return None if s is None or not len(s) else self._track(s)

    @property
    def tracks(self) -> list[tuple[str, str, Track]]:
        """(name, colour, track) of what was estimated."""
        pairs = [("filter", figures.FILTER, self.filter)]
        if self.smoother is not None:
            pairs.append(("smoothed", figures.SMOOTHED, self.smoother))
        return pairs

    @cached_property
    def reference(self) -> dict[str, Array] | None:
        """Columns of the reference and "ned" (n, 3), where there is one with positions."""
        table = self.result.reference
        if table is None or not len(table) or "lat" not in table or "lon" not in table:
            return None
        columns = {k: np.asarray(v, dtype=float) for k, v in table.columns.items() if v.dtype.kind in "fiu"}
        columns["ned"] = self.ned(columns["lat"], columns["lon"], columns.get("height"))
        return columns

    def _track(self, solution: Solution) -> Track:
        ned = self.ned(solution.lat, solution.lon, np.nan_to_num(solution.height))
        ned[~np.isfinite(solution.height), 2] = np.nan
        series = None
        if self.reference is not None and self.result.reference is not None and len(solution):
            lever = _get(self.result.study, "mounting.reference_frd_m")
            series = error_series(solution, self.result.reference, (0.0, 0.0, 0.0) if lever is None else lever)
        return Track(solution, ned, series if series is not None and len(series) else None)

    @property
    def judged(self) -> bool:
        """Something is known to judge the tracks against."""
        return any(t.errors is not None for _, _, t in self.tracks)

    @cached_property
    def fixes(self) -> tuple[Array, Array] | None:
        """(time (m,), ned (m, 3)) of the GNSS fixes that the filter was given."""
        return self._points(self.result.tables.get("gnss"))

    @cached_property
    def withheld_fixes(self) -> tuple[Array, Array] | None:
        return self._points(self.result.withheld.get("gnss"))

    def _points(self, table: Any) -> tuple[Array, Array] | None:
        if table is None or not len(table) or "lat" not in table:
            return None
        return table.time, self.ned(table["lat"], table["lon"])

    # time

    @cached_property
    def span(self) -> tuple[float, float]:
        t = self.result.navigation.filter.time
        return (float(t[0]), float(t[-1])) if len(t) else (0.0, 1.0)

    @cached_property
    def axis(self) -> TimeAxis:
        first, last = self.span
        length = max(last - first, 1e-3)
        scales = ((3600.0, 1.0, "s"), (4 * 3600.0, 60.0, "min"), (5 * 86400.0, 3600.0, "h"))
        size, unit = next(((s, u) for limit, s, u in scales if length <= limit), (86400.0, "days"))
        # Seconds of the study's own clock where they are short enough to read; else since the start.
        origin = 0.0 if unit == "s" and abs(last) < 1e5 else first
        title = f"time, {unit}" if origin == 0.0 else f"time since the start, {unit}"
        shaded = [(d.start, d.end, figures.DIVE) for d in self.dives]
        return TimeAxis(origin, size, title, ((first - origin) / size, (last - origin) / size), shaded)

    @cached_property
    def started(self) -> str:
        """The start on the study's clock, as a date where it looks like Unix time."""
        first = self.span[0]
        if 9.0e8 < first < 2.5e9:
            moment = datetime.datetime.fromtimestamp(round(first), tz=datetime.UTC)
            return f"{moment:%Y-%m-%d %H:%M:%S} UTC, taking the clock for Unix time"
        return f"{first:.3f} s".replace("-", "−")

    # dives

    @cached_property
    def dives(self) -> list[Dive]:
        """Dives without fixes, in order, as summary.json tells them."""
        time = self.filter.time
        if not len(time):
            return []
        navigation, gnss = self.result.navigation, self.result.tables.get("gnss")
        told = self.summary.get("dives")
        if told is None:
            told = dives(navigation, gnss, self.result.reference if self.reference is not None else None)
        ends = self.summary.get("surfacings")
        if ends is None:
            ends = surfacings(navigation, gnss)
        found = []
        for entry in told:
            start = float(entry["start_s"])
            near = [s for s in ends if abs(float(s["time_s"]) - float(s["gap_s"]) - start) < 1e-3]
            end = float(near[0]["time_s"]) if near else float(entry["end_s"])
            last = end - 1e-6 if near else end + 1e-6
            row = int(np.searchsorted(time, last, side="left")) - 1
            if row >= 0 and self._went_under(start, end):
                found.append(Dive(start, end, row, entry, near[0] if near else None))
        return found

    def _went_under(self, start: float, end: float) -> bool:
        """Where a depth table tells: a wait between two fixes at the surface is no dive."""
        table = self.result.tables.get("depth")
        if table is None or not len(table):
            return True
        depth = table["depth"][(table.time > start) & (table.time < end)]
        return bool((depth > _SURFACE_M).any())

    @property
    def innovations(self) -> Sequence[Innovations]:
        return [i for i in self.result.navigation.innovations.values() if len(i.time)]

    @cached_property
    def length(self) -> float:
        """Metres over ground, whole track: of the reference where it covers it, else as estimated."""
        ref, (first, last) = self.reference, self.span
        if ref is not None and ref["time"][0] <= first + 1.0 and ref["time"][-1] >= last - 1.0:
            inside = (ref["time"] >= first) & (ref["time"] <= last)
            return distance(ref["lat"][inside], ref["lon"][inside])
        track = (self.smoother or self.filter).solution
        return distance(track.lat, track.lon)


def _get(thing: Any, path: str) -> Any:
    """study.name of an object or of nested dicts; None where it is absent."""
    for part in path.split("."):
        thing = thing.get(part) if isinstance(thing, dict) else getattr(thing, part, None)
        if thing is None:
            return None
    return thing
