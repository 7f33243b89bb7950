"""Results side by side: the same figures in rows, the best of each, and how far tracks lie from each other.

Works on what a result folder holds, so that results of other versions, with more or fewer keys, can be compared too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84, wrap_pi
from schuler.judging.errors import LONGEST_GAP_S, spread

Array = NDArray[np.float64]
Best = Literal["", "low", "one", "share"]
HONEST_SHARE = 0.9973  # of a normal error inside 3 sigma
FAR_M = 100e3  # tracks that never come nearer than this are of different places
OUTAGES_TOLD = 12  # single outages in rows of their own; all are in the medians
WHO = (("filter", "filter"), ("smoother", "smoothed"))


@dataclass
class Track:
    """A stored track, SI and radians; NaN where the file does not say.

    time (n,) s; lat, lon (n,) rad; height (n,) m; v_n, rpy (n, 3); std_pos, std_rpy (n, 3) 1 sigma. local: positions
    are metres of a plane without a place on Earth, laid at 0 N 0 E.
    """

    time: Array
    lat: Array
    lon: Array
    height: Array
    v_n: Array
    rpy: Array
    std_pos: Array
    std_rpy: Array
    local: bool = False

    def __len__(self) -> int:
        return len(self.time)

    def rows(self, keep: NDArray[Any]) -> Track:
        """The rows that a mask or a list of them keeps."""
        return replace(self, **{f: getattr(self, f)[keep] for f in self.__dataclass_fields__ if f != "local"})

    @property
    def placed(self) -> bool:
        """Any position is known."""
        return bool((np.isfinite(self.lat) & np.isfinite(self.lon)).any())


@dataclass
class Stored:
    """A result folder as read. label: its name among the others; tracks: "filter" and "smoother", as far as there."""

    folder: Path
    summary: dict[str, Any]
    tracks: dict[str, Track] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    label: str = ""

    def text(self, *path: str) -> str:
        """A word of the summary, "" where it has none."""
        value = dig(self.summary, *path)
        return value if isinstance(value, str) else "" if value is None else str(value)

    def number(self, *path: str) -> float | None:
        return number_of(dig(self.summary, *path))

    def entries(self, key: str) -> list[dict[str, Any]]:
        """A list of the summary, of which only what are objects counts."""
        value = self.summary.get(key)
        return [e for e in value if isinstance(e, dict)] if isinstance(value, list) else []


@dataclass(frozen=True)
class Row:
    """One figure of every result. better: "low" the smallest, "one" the nearest to 1, "share" to 99.73 %, "" none."""

    group: str
    label: str
    unit: str
    values: tuple[float | None, ...]
    better: Best = ""

    @property
    def best(self) -> set[int]:
        """Which results have the best figure; empty where fewer than two know it, or all have the same."""
        known = {i: _badness(v, self.better) for i, v in enumerate(self.values) if v is not None}
        if len(known) < 2 or not self.better:
            return set()
        least, most = min(known.values()), max(known.values())
        close = least + 1e-9 * max(abs(least), 1e-12)
        return set() if most <= close else {i for i, v in known.items() if v <= close}


def _badness(value: float, better: Best) -> float:
    if better == "one":
        return abs(math.log(value)) if value > 0.0 else math.inf
    return abs(value - 100.0 * HONEST_SHARE) if better == "share" else value


def number_of(value: Any) -> float | None:
    """A finite number, or None for anything else that a file may hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        value = float(value)
    except OverflowError:
        return None
    return value if math.isfinite(value) else None


def dig(thing: Any, *path: str) -> Any:
    """thing[path[0]][path[1]]..., None where any step is missing or of another type."""
    for key in path:
        thing = thing.get(key) if isinstance(thing, Mapping) else None
    return thing


# ---- names ----


def name_results(results: Sequence[Stored]) -> None:
    """Gives every result a label of its own: its study's name, with the folder where two share one."""
    names = [printable(r.text("study", "name")) or printable(r.folder.name) or "result" for r in results]
    for depth in range(1, 4):
        labels = list(names)
        for i, name in enumerate(names):
            if names.count(name) > 1:
                labels[i] = f"{name} ({printable('/'.join(_parts(results[i].folder)[-depth:]))})"
        if len(set(labels)) == len(labels):
            break
    for i, result in enumerate(results):
        result.label = labels[i] if labels.count(labels[i]) == 1 else f"{labels[i]} #{labels[: i + 1].count(labels[i])}"


def _parts(folder: Path) -> tuple[str, ...]:
    return tuple(p for p in folder.resolve().parts if p not in ("/", ""))


def printable(text: str, longest: int = 60) -> str:
    """Text from a file as one line that does a terminal no harm."""
    text = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return text if len(text) <= longest else text[: longest - 1] + "…"


# ---- figures ----

_ERRORS = (
    ("horizontal_m", "horizontal", "m", ("rms", "p95", "max", "end")),
    ("vertical_m", "vertical", "m", ("rms", "p95")),
    ("velocity_mps", "velocity", "m/s", ("rms", "p95")),
    ("roll_deg", "roll", "deg", ("rms", "p95")),
    ("pitch_deg", "pitch", "deg", ("rms", "p95")),
    ("heading_deg", "heading", "deg", ("rms", "p95")),
)
_WORDS = {"rms": "rms", "p95": "95 %", "max": "largest", "end": "end"}
_TOLD_ELSEWHERE = {
    "study", "made_by", "method", "duration_s", "distance_m", "errors", "circular", "consistency", "outages", "dives",
    "surfacings", "surface_gaps", "states", "notes", "sweep", "platform", "distrusted",
}  # fmt: skip


def rows(results: Sequence[Stored]) -> list[Row]:
    """Every figure that at least one result knows, in groups."""
    found: list[Row] = []

    def add(group: str, label: str, unit: str, values: Sequence[Any], better: Best = "") -> None:
        known = tuple(number_of(v) for v in values)
        if any(v is not None for v in known):
            found.append(Row(group, label, unit, known, better))

    add("Recording", "duration", "s", [r.number("duration_s") for r in results])
    add("Recording", "distance", "m", [r.number("distance_m") for r in results])
    _errors(results, add)
    _without_fixes(results, add)
    _outages(results, add)
    _sweep(results, add)
    _consistency(results, add)
    _platform(results, add)
    _others(results, add)
    return found


def _errors(results: Sequence[Stored], add: Any) -> None:
    for who, word in WHO:
        for key, name, unit, statistics in _ERRORS:
            for s in statistics:
                values = [r.number("errors", who, key, s) for r in results]
                add("Errors against the reference", f"{word}: {name}, {_WORDS[s]}", unit, values, "low")
        for key, name in (("cep_m", "CEP"), ("r95_m", "R95")):
            values = [r.number("circular", who, key) for r in results]
            add("Errors against the reference", f"{word}: {name}", "m", values, "low")


def _without_fixes(results: Sequence[Stored], add: Any) -> None:
    group = "Stretches without fixes"
    add(group, "how many", "", [len(r.entries("dives")) or None for r in results])
    for key, name, unit, better in (
        ("horizontal_end_m", "filter: error at the end, median", "m", "low"),
        ("percent_of_distance", "filter: of the distance, median", "%", "low"),
        ("smoother_max_m", "smoothed: largest error, median", "m", "low"),
        ("nees_half_end", "NEES/2 at the end, mean", "", "one"),
    ):
        statistic = np.mean if key == "nees_half_end" else np.median
        add(group, name, unit, [_over(r.entries("dives"), key, statistic) for r in results], better)
    add(
        group,
        "first fix: miss, median",
        "m",
        [_over(r.entries("surfacings"), "miss_m", np.median) for r in results],
        "low",
    )
    share = [
        100.0 * float(np.mean([e.get("inside_95") is True for e in r.entries("surfacings")]))
        if r.entries("surfacings")
        else None
        for r in results
    ]
    add(group, "first fix: inside the 95 % ellipse", "%", share)


def _outages(results: Sequence[Stored], add: Any) -> None:
    group = "Outages of the study"
    figures: tuple[tuple[str, str, str, Best], ...] = (
        ("horizontal_end_m", "filter: error at the end", "m", "low"),
        ("horizontal_max_m", "filter: largest error", "m", "low"),
        ("percent_of_distance", "filter: of the distance", "%", "low"),
        ("smoother_horizontal_max_m", "smoothed: largest error", "m", "low"),
        ("nees_half_end", "NEES/2 at the end", "", "one"),
    )
    each = [{_outage_name(e): e for e in r.entries("outages")} for r in results]
    names = list(dict.fromkeys(name for entries in each for name in entries if name))
    if len(names) > 1:
        for key, name, unit, better in figures:
            statistic, word = (np.mean, "mean") if key == "nees_half_end" else (np.median, "median")
            add(group, f"{name}, {word}", unit, [_over(list(e.values()), key, statistic) for e in each], better)
    for outage in names[:OUTAGES_TOLD]:
        for key, name, unit, better in figures:
            add(group, f"{outage}: {name}", unit, [dig(e, outage, key) for e in each], better)


def _outage_name(entry: Mapping[str, Any]) -> str:
    start, end = number_of(entry.get("start_s")), number_of(entry.get("end_s"))
    if start is None or end is None:
        return ""
    return f"{printable(str(entry.get('sensor') or 'sensor'), 20)} {start:g} … {end:g} s"


def _sweep(results: Sequence[Stored], add: Any) -> None:
    each = [{number_of(e.get("length_s")): e for e in r.entries("sweep")} for r in results]
    for length in sorted({k for entries in each for k in entries if k is not None}):
        group = "Outages slid over the recording"
        add(group, f"{length:g} s: windows", "", [dig(e.get(length), "windows") for e in each])
        for key, name, unit in (
            ("filter_end_m", "filter: error at the end", "m"),
            ("filter_end_percent", "filter: of the distance", "%"),
            ("smoother_max_m", "smoothed: largest error", "m"),
        ):
            for s, word in (("p50", "median"), ("p95", "95 %")):
                values = [dig(e.get(length), key, s) for e in each]
                add(group, f"{length:g} s: {name}, {word}", unit, values, "low")
        add(group, f"{length:g} s: NEES/2 at the end", "", [dig(e.get(length), "nees_half") for e in each], "one")


def _consistency(results: Sequence[Stored], add: Any) -> None:
    group = "Consistency"
    for key in ("position", "velocity", "attitude"):
        add(group, f"NEES of the {key}", "", [r.number("consistency", f"nees_{key}") for r in results], "one")
    share = [r.number("consistency", "inside_3_sigma") for r in results]
    add(group, "errors inside 3 sigma", "%", [None if s is None else 100.0 * s for s in share], "share")
    tables = [dig(r.summary, "consistency", "nis") for r in results]
    kinds = dict.fromkeys(str(k) for t in tables if isinstance(t, Mapping) for k in t)
    for kind in kinds:
        name = printable(kind.replace("_", " "), 40)
        add(group, f"NIS of {name}", "", [dig(t, kind, "mean") for t in tables], "one")
        add(group, f"left out of {name}", "", [dig(t, kind, "left_out") or None for t in tables])


def _platform(results: Sequence[Stored], add: Any) -> None:
    """The error of each algorithm at its last moment."""
    each = [{str(e.get("algorithm")): e for e in r.entries("platform")} for r in results]
    for name in dict.fromkeys(k for entries in each for k in entries):
        values = [_last(dig(e, name, "error_m")) for e in each]
        add("Platform", f"{printable(name, 40)}: error at the end", "m", values, "low")


def _last(values: Any) -> float | None:
    return number_of(values[-1]) if isinstance(values, list) and values else None


def _others(results: Sequence[Stored], add: Any) -> None:
    """Numbers under keys that this version has no row for, those of a kind or of a later version."""
    keys: dict[tuple[str, ...], None] = {}
    for r in results:
        for key, value in r.summary.items():
            if key in _TOLD_ELSEWHERE:
                continue
            if number_of(value) is not None:
                keys[(key,)] = None
            elif isinstance(value, Mapping):
                keys |= {(key, str(k)): None for k, v in value.items() if number_of(v) is not None}
    for path in list(keys)[:100]:
        label = printable(": ".join(p.replace("_", " ") for p in path))
        add("Other figures", label, "", [r.number(*path) for r in results])


def _over(entries: Sequence[Mapping[str, Any]], key: str, statistic: Any) -> float | None:
    known = [v for v in (number_of(e.get(key)) for e in entries) if v is not None]
    return float(statistic(known)) if known else None


# ---- tracks ----


@dataclass
class Difference:
    """One track minus another at the moments of the first that the second covers: ned (n, 3) m, heading (n,) rad."""

    time: Array
    ned: Array
    heading: Array

    @property
    def horizontal(self) -> Array:
        return np.hypot(self.ned[:, 0], self.ned[:, 1])

    def told(self) -> dict[str, dict[str, float] | None]:
        """{"horizontal_m", "vertical_m", "heading_deg"}, each with rms, p95, max, end, or None."""
        return {
            "horizontal_m": spread(self.horizontal),
            "vertical_m": spread(self.ned[:, 2]),
            "heading_deg": spread(np.degrees(self.heading)),
        }


def difference(track: Track, other: Track) -> Difference | None:
    """track - other, linear between the other's rows; None where they share no time or no place.

    Gaps of the other track are not bridged over more than two of its intervals (and about a second).
    """
    if not len(track) or len(other) < 2 or track.local != other.local:
        return None
    inside = (track.time >= other.time[0] - 1e-6) & (track.time <= other.time[-1] + 1e-6)
    t = track.time[inside]
    if not len(t):
        return None
    longest = max(LONGEST_GAP_S, 2.02 * float(np.median(np.diff(other.time))))
    lat, lon = _line(other.time, other.lat, t, longest), _line(other.time, other.lon, t, longest, True)
    height = _line(other.time, other.height, t, longest)
    own = track.height[inside]
    level = np.where(np.isfinite(own), own, 0.0)
    ned = WGS84.displacement_n(
        track.lat[inside], track.lon[inside], level, lat, lon, np.where(np.isfinite(height), height, level)
    )
    ned[~(np.isfinite(own) & np.isfinite(height)), 2] = np.nan
    turn = track.rpy[inside, 2] - _line(other.time, other.rpy[:, 2], t, longest, True)
    heading = np.where(np.isfinite(turn), wrap_pi(np.where(np.isfinite(turn), turn, 0.0)), np.nan)
    placed = np.isfinite(ned[:, :2]).all(axis=1)
    known = placed | np.isfinite(heading)
    if not known.any() or (placed.any() and np.hypot(ned[placed, 0], ned[placed, 1]).min() > FAR_M):
        return None
    return Difference(t[known], ned[known], heading[known])


def _line(time: Array, values: Array, at: Array, longest: float, angle: bool = False) -> Array:
    known = np.isfinite(values)
    t, v = time[known], values[known]
    if len(t) < 2:
        return np.full(len(at), np.nan)
    out = np.interp(at, t, np.unwrap(v) if angle else v, left=np.nan, right=np.nan)
    edge = (np.abs(at - t[0]) < 1e-6, np.abs(at - t[-1]) < 1e-6)
    out[edge[0]], out[edge[1]] = v[0], v[-1]
    after = np.clip(np.searchsorted(t, at, side="left"), 1, len(t) - 1)
    beside = np.minimum(np.abs(at - t[after]), np.abs(at - t[after - 1])) < 1e-6
    out[(t[after] - t[after - 1] > longest) & ~beside] = np.nan
    return out


def same_clock(results: Sequence[Stored]) -> bool:
    """Whether all tracks that there are share some time with their neighbour in the list."""
    spans = [(t.time[0], t.time[-1]) for r in results for t in list(r.tracks.values())[:1] if len(t)]
    return all(a[0] <= b[1] and b[0] <= a[1] for a, b in pairwise(spans))
