"""Stretches without a sensor: withheld outages, dives, surfacings. What the rest could do, and whether it knew.

A moment's prediction is the last row of the filter before it, carried on with its velocity.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.aiding.solution import Innovations, Navigation, Solution
from schuler.ground.tables import Table
from schuler.judging.consistency import chi2_quantile, nees
from schuler.judging.errors import (
    DEG,
    ErrorSeries,
    at_point,
    distance,
    error_series,
    interpolated,
    offset_from,
    resampled,
    state_at,
    wrap_pi,
)

Array = NDArray[np.float64]
LONG_GAP_S = 60.0  # without fixes for longer than this, a surfacing is told


def fix_sigma(gnss: Table, row: int, gnss_m: Sequence[float], correlated_m: float = 0.0) -> Array:
    """1 sigma of a fix, NED m (3,): its std_ columns, or gnss_m where they are absent, with the slow error added."""
    columns = ("std_north", "std_east", "std_down")
    own = [
        float(gnss[c][row]) if c in gnss and np.isfinite(gnss[c][row]) else float(gnss_m[k])
        for k, c in enumerate(columns)
    ]
    return np.hypot(np.array(own), correlated_m)


def gaps(time: Array, longest_s: float = LONG_GAP_S) -> list[tuple[float, float]]:
    """(last fix before, first fix after) of each stretch without fixes that is longer than longest_s."""
    long = np.flatnonzero(np.diff(time) > longest_s)
    return [(float(time[i]), float(time[i + 1])) for i in long]


def _end(track: Solution, reference: Table | None, time: float) -> dict[str, Any]:
    """Error of the prediction for a moment against the reference: horizontal, heading, and what was claimed."""
    out: dict[str, Any] = dict.fromkeys(
        ("horizontal_end_m", "heading_end_deg", "heading_sigma_deg", "sigma_end_m", "nees_half_end")
    )
    row, _ = state_at(track, time)
    if row < 0:
        return out
    cov = track.cov_pos[row, :2, :2]
    if np.isfinite(cov).all():
        out["sigma_end_m"] = float(np.sqrt(max(np.linalg.eigvalsh(cov)[-1], 0.0)))
    if np.isfinite(track.cov_rpy[row, 2, 2]):
        out["heading_sigma_deg"] = float(np.sqrt(max(track.cov_rpy[row, 2, 2], 0.0)) / DEG)
    if reference is None:
        return out
    at = np.array([time])

    def ref(column: str, angle: bool = False) -> float:
        return (
            float(interpolated(reference.time, reference[column], at, angle=angle)[0])
            if column in reference
            else np.nan
        )

    _, d = offset_from(track, time, ref("lat"), ref("lon", True))
    if np.isfinite(d[:2]).all():
        out["horizontal_end_m"] = float(np.hypot(d[0], d[1]))
        value = float(nees(d[None, :2], cov[None])[0])
        out["nees_half_end"] = value if np.isfinite(value) else None
    if "heading" in reference:  # attitude is not carried on, so it is compared at its row's own moment
        heading = interpolated(reference.time, reference["heading"], track.time[row : row + 1], angle=True)[0]
        if np.isfinite(heading) and np.isfinite(track.rpy[row, 2]):
            out["heading_end_deg"] = float(abs(wrap_pi(track.rpy[row, 2] - heading)) / DEG)
    return out


def _largest(series: ErrorSeries | None, end: float | None = None) -> float | None:
    """Largest horizontal error of the rows, and of the prediction for the end, which lies between two rows."""
    size = series.horizontal[np.isfinite(series.horizontal)] if series is not None else np.array([])
    found = [*size.tolist(), *([end] if end is not None else [])]
    return float(max(found)) if found else None


def _against_rows(track: Solution, rows: Table, delay: float) -> Array:
    """(n, 2) m, prediction minus each withheld fix, north east; the row stamped t belongs to t - delay."""
    out = np.full((len(rows), 2), np.nan)
    for k, t in enumerate(rows.time - delay):
        out[k] = offset_from(track, float(t), float(rows["lat"][k]), float(rows["lon"][k]))[1][:2]
    return out


def outage(
    navigation: Navigation,
    withheld: Table,
    sensor: str,
    start_s: float,
    end_s: float,
    reference: Table | None = None,
    *,
    reference_frd: ArrayLike = (0.0, 0.0, 0.0),
    antenna_frd: ArrayLike = (0.0, 0.0, 0.0),
    gnss_m: Sequence[float] = (1.0, 1.0, 2.0),
    correlated_m: float = 0.0,
    delay: float = 0.0,
) -> dict[str, Any]:
    """One entry of "outages" of summary.json. `withheld` holds the rows taken away; "end" is the last of them.

    Without a reference a withheld GNSS is judged by its own rows (their sigma is then part of the NEES).
    """
    last = float(withheld.time[-1])
    entry: dict[str, Any] = {"sensor": sensor, "start_s": start_s, "end_s": end_s, "rows": len(withheld)}
    lever = reference_frd if reference is not None else antenna_frd
    filtered = at_point(navigation.filter, lever)
    smoothed = None if navigation.smoother is None else at_point(navigation.smoother, lever)
    end = _end(filtered, reference, last - (delay if sensor == "gnss" and reference is None else 0.0))
    largest = smooth_largest = None
    if reference is not None:
        largest = _largest(error_series(filtered, reference).between(start_s, last), end["horizontal_end_m"])
        if smoothed is not None:
            smooth_largest = _largest(error_series(smoothed, reference).between(start_s, last))
    elif sensor == "gnss":
        missed = _against_rows(filtered, withheld, delay)
        size = np.hypot(missed[:, 0], missed[:, 1])
        if np.isfinite(size[-1]):
            end["horizontal_end_m"] = float(size[-1])
            row, _ = state_at(filtered, last - delay)
            sigma = fix_sigma(withheld, len(withheld) - 1, gnss_m, correlated_m)
            value = float(nees(missed[-1:], filtered.cov_pos[row : row + 1, :2, :2] + np.diag(sigma[:2] ** 2))[0])
            end["nees_half_end"] = value if np.isfinite(value) else None
        largest = float(np.nanmax(size)) if np.isfinite(size).any() else None
        if smoothed is not None:
            there = _smoothed_against_rows(smoothed, withheld, delay)
            smooth_largest = float(np.nanmax(there)) if np.isfinite(there).any() else None
    entry["horizontal_end_m"] = end["horizontal_end_m"]
    entry["horizontal_max_m"] = largest
    entry["heading_end_deg"] = end["heading_end_deg"]
    entry["nees_half_end"] = end["nees_half_end"]
    entry["smoother_horizontal_max_m"] = smooth_largest
    entry["heading_sigma_deg"] = end["heading_sigma_deg"]
    entry["sigma_end_m"] = end["sigma_end_m"]
    length = travelled(smoothed or filtered, withheld, sensor, reference, start_s, last)
    entry["distance_m"] = length
    entry["percent_of_distance"] = (
        100.0 * end["horizontal_end_m"] / length if end["horizontal_end_m"] is not None and length > 0.0 else None
    )
    return entry


def travelled(
    track: Solution, withheld: Table, sensor: str, reference: Table | None, start: float, end: float
) -> float:
    """Metres over ground from start to end: of the reference where it covers them, else of the fixes withheld where
    they are dense, else as estimated."""
    if reference is not None and "lat" in reference:
        inside = (reference.time >= start) & (reference.time <= end)
        covered = inside.any() and reference.time[inside][-1] - reference.time[inside][0] > 0.9 * (end - start)
        if covered:
            return distance(reference["lat"][inside], reference["lon"][inside])
    if sensor == "gnss" and "lat" in withheld and len(withheld) > 2:
        step = np.diff(withheld.time)
        if step.max() <= 2.0 and withheld.time[-1] - withheld.time[0] > 0.9 * (end - start):
            each = max(int(round(1.0 / max(float(np.median(step)), 1e-3))), 1)  # about 1 Hz: noise is no distance
            rows = np.unique(np.append(np.arange(0, len(withheld), each), len(withheld) - 1))
            return distance(withheld["lat"][rows], withheld["lon"][rows])
    inside = (track.time >= start) & (track.time <= end)
    return distance(track.lat[inside], track.lon[inside])


def _smoothed_against_rows(track: Solution, rows: Table, delay: float) -> Array:
    """(n,) m. A smoothed row has seen everything, so it is interpolated, not carried on."""
    at = rows.time - delay
    asked = Table("reference", {"time": at, "lat": rows["lat"], "lon": rows["lon"]})
    inside = (at >= track.time[0]) & (at <= track.time[-1])
    out = np.full(len(rows), np.nan)
    if inside.any():
        moved = resampled(track, at[inside])
        out[inside] = error_series(moved, asked.where(inside)).horizontal[: inside.sum()]
    return out


def dives(
    navigation: Navigation,
    gnss: Table | None,
    reference: Table | None,
    *,
    reference_frd: ArrayLike = (0.0, 0.0, 0.0),
    longest_s: float = LONG_GAP_S,
) -> list[dict[str, Any]]:
    """Each stretch without fixes longer than longest_s: what the filter had at its end, just before the next fix.

    {"start_s", "end_s", "distance_m", "horizontal_end_m", "horizontal_max_m", "percent_of_distance",
    "heading_end_deg", "heading_sigma_deg", "sigma_end_m", "nees_half_end", "smoother_rms_m", "smoother_max_m"}.
    """
    if gnss is None or len(gnss) == 0 or len(navigation.filter) == 0:
        return []
    track_end = float(navigation.filter.time[-1])
    spans = gaps(gnss.time, longest_s)
    spans = [(a, b) for a, b in spans if a < track_end]
    if track_end - gnss.time[-1] > longest_s:
        spans.append((float(gnss.time[-1]), np.inf))
    filtered = at_point(navigation.filter, reference_frd)
    smoothed = None if navigation.smoother is None else at_point(navigation.smoother, reference_frd)
    all_filter = None if reference is None else error_series(filtered, reference)
    all_smooth = None if reference is None or smoothed is None else error_series(smoothed, reference)
    told = []
    for start, fix in spans:
        row = int(np.searchsorted(filtered.time, fix - 1e-6, side="left")) - 1  # a row at the fix has seen it
        if row < 0:
            continue
        before = float(filtered.time[row])
        end = _end(filtered, reference, before)
        track = reference if reference is not None else None
        time, lat, lon = (
            (track.time, track["lat"], track["lon"])
            if track is not None
            else (filtered.time, filtered.lat, filtered.lon)
        )
        inside = (time >= start) & (time <= before)
        length = distance(lat[inside], lon[inside])
        during = None if all_filter is None else all_filter.between(start, before)
        smooth = None if all_smooth is None else all_smooth.between(start, before)
        size = smooth.horizontal[np.isfinite(smooth.horizontal)] if smooth is not None else np.array([])
        percent = (
            100.0 * end["horizontal_end_m"] / length if end["horizontal_end_m"] is not None and length > 0 else None
        )
        told.append(
            {
                "start_s": start,
                "end_s": before,
                "distance_m": length,
                "horizontal_end_m": end["horizontal_end_m"],
                "horizontal_max_m": _largest(during, end["horizontal_end_m"]),
                "percent_of_distance": percent,
                "sigma_end_m": end["sigma_end_m"],
                "nees_half_end": end["nees_half_end"],
                "heading_end_deg": end["heading_end_deg"],
                "heading_sigma_deg": end["heading_sigma_deg"],
                "smoother_rms_m": float(np.sqrt(np.mean(size**2))) if len(size) else None,
                "smoother_max_m": float(size.max()) if len(size) else None,
            }
        )
    return told


def surfacings(
    navigation: Navigation,
    gnss: Table | None,
    *,
    gnss_m: Sequence[float] = (1.0, 1.0, 2.0),
    correlated_m: float = 0.0,
    antenna_frd: ArrayLike = (0.0, 0.0, 0.0),
    depth: Table | None = None,
    longest_s: float = LONG_GAP_S,
) -> list[dict[str, Any]]:
    """At each first fix after a gap longer than longest_s: the position predicted before it against the fix.

    The miss (predicted minus fix, north, east) and its sigma, the fix's own included. The filter's innovation is used
    where it recorded one (its S is exact), else the last row before the fix, carried on with its velocity.
    "max_depth_m" is the deepest row of a depth table in the gap (0 where it has no row there), None without a table.
    """
    if gnss is None or len(gnss) < 2:
        return []
    recorded = navigation.innovations.get("gnss_position")
    track = at_point(navigation.filter, antenna_frd)
    told = []
    for last, fix in gaps(gnss.time, longest_s):
        row = int(np.searchsorted(track.time, fix - 1e-6, side="left")) - 1
        if row < 0:
            continue
        index = int(np.searchsorted(gnss.time, fix))
        found = None if recorded is None else _innovation(recorded, fix, track.cov_pos[row])
        if found is None:
            lat, lon = float(gnss["lat"][index]), float(gnss["lon"][index])
            only_before = Solution(*(getattr(track, f)[: row + 1] for f in track.__dataclass_fields__))
            _, d = offset_from(only_before, fix, lat, lon)
            sigma = fix_sigma(gnss, index, gnss_m, correlated_m)
            found = d[:2], track.cov_pos[row, :2, :2] + np.diag(sigma[:2] ** 2)
        miss, S = found
        if not (np.isfinite(miss).all() and np.isfinite(S).all()):
            continue
        minor, major = np.sqrt(np.linalg.eigvalsh(S).clip(0.0))
        squared = 2.0 * float(nees(miss[None], S[None])[0])
        told.append(
            {
                "time_s": fix,
                "gap_s": fix - last,
                "max_depth_m": _deepest(depth, last, fix),
                "miss_m": float(np.hypot(*miss)),
                "north_m": float(miss[0]),
                "east_m": float(miss[1]),
                "sigma_major_m": float(major),
                "sigma_minor_m": float(minor),
                "mahalanobis2": squared if np.isfinite(squared) else None,
                "inside_95": bool(squared <= chi2_quantile(2, 0.95)),
            }
        )
    return told


def _deepest(depth: Table | None, start: float, end: float) -> float | None:
    if depth is None:
        return None
    inside = depth["depth"][(depth.time >= start) & (depth.time <= end)]
    inside = inside[np.isfinite(inside)]
    return float(inside.max()) if len(inside) else 0.0


def _innovation(recorded: Innovations, time: float, cov_pos: Array) -> tuple[Array, Array] | None:
    """(miss (2,), S (2, 2)) of the first innovation at a moment; the cross term is the prediction's own."""
    at = np.flatnonzero(np.abs(recorded.time - time) < 1e-3)
    if len(at) == 0 or recorded.value.shape[1] < 2:
        return None
    value, std = recorded.value[at[0], :2], recorded.std[at[0], :2]
    if not (np.isfinite(value).all() and np.isfinite(std).all() and (std > 0).all()):
        return None
    S = np.diag(std**2)
    cross = cov_pos[0, 1]
    if np.isfinite(cross) and abs(cross) < std[0] * std[1]:
        S[0, 1] = S[1, 0] = cross
    return -value, S  # an innovation is measured minus predicted


def mean_of(entries: Sequence[Mapping[str, Any]], key: str) -> float | None:
    """Mean of one figure over entries that know it."""
    known = [e[key] for e in entries if e.get(key) is not None]
    return float(np.mean(known)) if known else None
