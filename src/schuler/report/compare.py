"""The page compare.html: any number of results side by side, on figures of the same make as a report's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import displacement_n
from schuler.judging.errors import spread
from schuler.judging.side_by_side import (
    FAR_M,
    WHO,
    Row,
    Stored,
    Track,
    difference,
    dig,
    number_of,
    printable,
    rows,
    same_clock,
)
from schuler.report import decimate, figures
from schuler.report.figures import SERIES, Panel, Pool, TimeAxis
from schuler.report.parts import Grid, Opening, Section, metres, number, seconds
from schuler.report.sheet import sheet

Array = NDArray[np.float64]
ACROSS = 6  # results beside each other in one table; more go into further tables
PAIRS = 45  # pairs of tracks in the table; with more results, only those with the first
_DASHES = ("solid", "dash", "dot", "dashdot")


def compare_page(results: Sequence[Stored], made_by: Mapping[str, Any]) -> str:
    """The text of compare.html. The same results give the same text; everything from files is escaped."""
    pool = Pool()
    together = same_clock(results)
    axis = _axis(results, together)
    chapters = [
        _figures(results),
        _map(results, pool),
        _differences(results, pool, axis, together),
        _uncertainty(results, pool, axis, together),
        _learnt(results),
        _made(results),
    ]
    return sheet(_opening(results), [c for c in chapters if c is not None], made_by, pool)


def _opening(results: Sequence[Stored]) -> Opening:
    names = ", ".join(r.label for r in results[:8]) + (f" and {len(results) - 8} more" if len(results) > 8 else "")
    title = f"{len(results)} results side by side" if len(results) > 1 else f"{results[0].label}, alone"
    return Opening(title, names, verdict(results))


def verdict(results: Sequence[Stored]) -> str:
    """One or two sentences: which is nearest to its reference, and how far apart the tracks are."""
    tracks = [(r.label, t) for r in results if (t := _best_track(r)[1]) is not None and t.placed]
    gaps = []
    for label, track in tracks[1:]:
        found = difference(track, tracks[0][1])
        if found is not None and np.isfinite(found.horizontal).any():
            gaps.append((float(np.sqrt(np.nanmean(found.horizontal**2))), label))
    if len(tracks) > 1 and not gaps:
        return f"No other track shares time and place with that of {tracks[0][0]}; the figures stand side by side."
    said = []
    for who, word in reversed(WHO):
        known = [(v, r.label) for r in results if (v := r.number("errors", who, "horizontal_m", "rms")) is not None]
        if len(known) > 1:
            (least, near), (most, far) = min(known), max(known)
            said.append(
                f"Nearest to its reference, {word}: {near}, {metres(least)} (rms); farthest {far}, {metres(most)}."
            )
            break
    if gaps:
        most, far = max(gaps)
        said.append(f"The tracks lie up to {metres(most)} (rms) from that of {tracks[0][0]}: {far}.")
    if not said:
        alone = len(results) == 1
        said.append("There is nothing to compare with." if alone else "No result knows its error against a reference.")
    return " ".join(said)


def _best_track(result: Stored) -> tuple[str, Track | None]:
    for who, word in reversed(WHO):
        if who in result.tracks:
            return word, result.tracks[who]
    return "", None


def _style(i: int) -> dict[str, Any]:
    return {"color": SERIES[i % len(SERIES)], "dash": _DASHES[(i // len(SERIES)) % len(_DASHES)]}


# ---- figures ----


def _figures(results: Sequence[Stored]) -> Section | None:
    found = rows(results)
    if not found:
        return None
    lead = (
        "A dash: the result does not say. Bold: the best of its row, which means something where results are of one "
        "recording."
    )
    grids = []
    for start in range(0, len(results), ACROSS):
        part = range(start, min(start + ACROSS, len(results)))
        grids.append(_grid([results[i].label for i in part], found, list(part)))
    return Section("figures", "Figures side by side", lead, grids=grids, sentences=_remarks(results))


def _grid(labels: Sequence[str], found: Sequence[Row], part: Sequence[int]) -> Grid:
    cells: list[list[str]] = []
    marked: list[tuple[int, int]] = []
    group = ""
    for row in found:
        best = row.best
        marked += [(len(cells), 3 + k) for k, i in enumerate(part) if i in best]
        cells.append([row.group if row.group != group else "", row.label, row.unit, *(_cell(row, i) for i in part)])
        group = row.group
    return Grid(["", "figure", "unit", *labels], cells, left=3, marked=tuple(marked))


def _cell(row: Row, i: int) -> str:
    value = row.values[i]
    return f"{value:.0f}" if value is not None and not row.unit and value == round(value) else number(value)


def _remarks(results: Sequence[Stored]) -> list[str]:
    """Same study, other seed or version: what the differences can come from."""
    said = [note for r in results for note in r.notes]
    groups: dict[str, list[Stored]] = {}
    for r in results:
        if sha := r.text("made_by", "study_sha256"):
            groups.setdefault(sha, []).append(r)
    for alike in groups.values():
        if len(alike) < 2:
            continue
        names = ", ".join(r.label for r in alike)
        other = [
            word
            for key, word in (("seed", "the seed"), ("version", "the version of schuler"))
            if len({r.text("made_by", key) for r in alike}) > 1
        ]
        said.append(
            f"{names}: the same study file, "
            + (f"other in {' and '.join(other)}" if other else "with the same seed and version")
        )
    return said


def _learnt(results: Sequence[Stored]) -> Section | None:
    names = list(dict.fromkeys(str(k) for r in results for k in (dig(r.summary, "states") or {})))[:200]
    grids = []
    for start in range(0, len(results), ACROSS):
        part = results[start : start + ACROSS]
        cells = []
        for name in names:
            entries = [dig(r.summary, "states", name) for r in part]
            unit = next((str(e.get("unit")) for e in entries if isinstance(e, Mapping) and e.get("unit")), "")
            cells.append([printable(name.replace("_", " ")), unit if unit != "1" else "", *map(_learnt_cell, entries)])
        if cells:
            grids.append(Grid(["state", "unit", *(r.label for r in part)], cells, left=2))
    if not grids:
        return None
    lead = "At the end of each run, with 1 sigma; in brackets the truth of a simulation."
    return Section("learnt", "What was learnt", lead, grids=grids)


def _learnt_cell(entry: Any) -> str:
    value, std, truth = (number_of(dig(entry, key)) for key in ("value", "std", "truth"))
    if value is None:
        return number(None)
    return f"{number(value, 3)} ± {number(std, 2)}" + (f" ({number(truth, 3)})" if truth is not None else "")


# ---- tracks ----


def _map(results: Sequence[Stored], pool: Pool) -> Section | None:
    """Every track in metres from where the first one begins; of many results only the better track of each."""
    placed = [(i, r) for i, r in enumerate(results) if any(t.placed for t in r.tracks.values())]
    if not placed:
        return None
    first = next(t for t in placed[0][1].tracks.values() if t.placed)
    row = int(np.argmax(np.isfinite(first.lat) & np.isfinite(first.lon)))
    origin = float(first.lat[row]), float(first.lon[row]), 0.0
    data: list[dict[str, Any]] = []
    away: list[str] = []
    box: list[Array] = []
    for i, result in placed:
        for who, word in WHO if len(placed) <= 4 else [w for w in WHO if w[1] == _best_track(result)[0]]:
            track = result.tracks.get(who)
            if track is None or not track.placed:
                continue
            ned = displacement_n(track.lat, track.lon, np.zeros(len(track)), *origin)
            if track.local != first.local or float(np.nanmin(np.hypot(ned[:, 0], ned[:, 1]))) > FAR_M:
                away.append(result.label)
                break
            box.append(ned[np.isfinite(ned[:, :2]).all(axis=1), :2])
            keep = decimate.keep([ned[:, 0], ned[:, 1]])
            style = _style(i)
            if who == "filter" and "smoother" in result.tracks:
                style = {"color": figures.shade(style["color"], 0.55), "dash": "dot"}
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": pool.add(ned[keep, 1]),
                    "y": pool.add(ned[keep, 0]),
                    "name": figures.label(f"{result.label}, {word}"),
                    "line": {"width": 1.6, **style},
                    "hovertemplate": "%{y:.1f} m north, %{x:.1f} m east",
                }
            )
    if not data:
        return None
    every = np.vstack(box)
    (south, west), (north, east) = every.min(axis=0), every.max(axis=0)
    margin = 0.04 * max(north - south, east - west, 1.0)
    lead = f"Metres north and east of where {placed[0][1].label} begins."
    said = [f"{name} lies elsewhere: not on this map" for name in dict.fromkeys(away)]
    dotted = any(line["line"]["dash"] == "dot" for line in data) and len(placed) <= 4
    caption = "Dotted: the filter's track, where there is a smoothed one too." if dotted else ""
    figure = figures.plan(
        "fig-map", "Tracks", data, (west - margin, east + margin, south - margin, north + margin), caption
    )
    return Section("tracks", "Tracks", lead, [figure], sentences=said)


def _axis(results: Sequence[Stored], together: bool) -> TimeAxis:
    spans = [(t.time[0], t.time[-1]) for r in results for t in r.tracks.values()]
    if not together:
        spans = [(0.0, b - a) for a, b in spans]
    first, last = (min(a for a, _ in spans), max(b for _, b in spans)) if spans else (0.0, 1.0)
    length = max(last - first, 1e-3)
    scales = ((3600.0, 1.0, "s"), (4 * 3600.0, 60.0, "min"), (5 * 86400.0, 3600.0, "h"))
    size, unit = next(((s, u) for limit, s, u in scales if length <= limit), (86400.0, "days"))
    origin = 0.0 if unit == "s" and abs(last) < 1e5 else first
    title = f"time, {unit}" if origin == 0.0 and together else f"time since the start, {unit}"
    return TimeAxis(origin, size, title, ((first - origin) / size, (last - origin) / size))


def _differences(results: Sequence[Stored], pool: Pool, axis: TimeAxis, together: bool) -> Section | None:
    if len(results) < 2:
        return None
    base = results[0]
    panels: list[Panel] = []
    for who, word in WHO:
        flat, turned = Panel(f"{word},\nhorizontal, m"), Panel(f"{word},\nheading, deg", zero=True)
        for i, result in enumerate(results[1:], 1):
            found = _between(result, base, who)
            if found is None:
                continue
            style = _style(i)
            for panel, value in ((flat, found.horizontal), (turned, np.degrees(found.heading))):
                if np.isfinite(value).any():
                    panel.traces.append(figures.line(pool, axis, found.time, value, result.label, fmt=".3~g", **style))
        panels += [flat, turned]
    pairs = [(a, b) for i, a in enumerate(results) for b in results[i + 1 :]]
    if len(pairs) > PAIRS:
        pairs = [(base, b) for b in results[1:]]
    cells = [row for a, b in pairs for row in _pair(a, b)]
    figure = figures.stack(
        "fig-differences",
        "Differences",
        panels,
        axis,
        "Against the first result, at the moments that both cover. It is no error: both may be wrong alike.",
    )
    said = []
    if not cells:
        said.append(
            "No two tracks share time and place, so nothing can be subtracted."
            if together
            else "The recordings are of different times, so no track can be subtracted from another."
        )
    head = [
        "result",
        "less",
        "track",
        "horizontal rms, m",
        "95 %",
        "largest",
        "end",
        "vertical rms, m",
        "heading rms, deg",
    ]
    grids = [Grid(head, cells, "Two tracks at a time.", left=3)] if cells else []
    lead = f"How far the others lie from {base.label}." if figure else ""
    return Section("differences", "Differences between the tracks", lead, [figure] if figure else [], grids, said)


def _between(result: Stored, base: Stored, who: str) -> Any:
    mine, its = result.tracks.get(who), base.tracks.get(who)
    return None if mine is None or its is None else difference(mine, its)


def _pair(first: Stored, second: Stored) -> list[list[str]]:
    found = []
    for who, word in WHO:
        d = _between(second, first, who)
        if d is None:
            continue
        told = d.told()
        flat = told["horizontal_m"] or {}
        cells = [number(flat.get(s)) for s in ("rms", "p95", "max", "end")]
        cells += [number((told[key] or {}).get("rms")) for key in ("vertical_m", "heading_deg")]
        found.append([second.label, first.label, word, *cells])
    return found


def _uncertainty(results: Sequence[Stored], pool: Pool, axis: TimeAxis, together: bool) -> Section | None:
    panels: list[Panel] = []
    cells = []
    for who, word in WHO:
        flat, turned = Panel(f"{word},\nhorizontal σ, m", log=True), Panel(f"{word},\nheading σ, deg")
        for i, result in enumerate(results):
            track = result.tracks.get(who)
            if track is None:
                continue
            time = track.time if together else track.time - track.time[0]
            size, heading = np.hypot(track.std_pos[:, 0], track.std_pos[:, 1]), np.degrees(track.std_rpy[:, 2])
            for panel, value in ((flat, size), (turned, heading)):
                if np.isfinite(value).any():
                    panel.traces.append(figures.line(pool, axis, time, value, result.label, fmt=".3~g", **_style(i)))
            told = [spread(size), spread(heading)]
            if any(told):
                cells.append(
                    [result.label, word, *(number((t or {}).get(s)) for t in told for s in ("rms", "max", "end"))]
                )
        panels += [flat, turned]
    figure = figures.stack(
        "fig-sigma",
        "Uncertainty",
        panels,
        axis,
        "1 sigma of north and east together (root of the sum of squares), and of the heading.",
    )
    if figure is None:
        return None
    head = ["result", "track", "rms", "largest", "end", "rms", "largest", "end"]
    grid = Grid(
        head, cells, "1 sigma over the track.", left=2, groups=(("", 2), ("horizontal, m", 3), ("heading, deg", 3))
    )
    return Section("sigma", "What each claims", "The uncertainty that each result states of itself.", [figure], [grid])


def _made(results: Sequence[Stored]) -> Section:
    cells = []
    for r in results:
        seed = dig(r.summary, "made_by", "seed")
        cells.append(
            [
                r.label,
                printable(str(r.folder), 200),
                printable(r.text("study", "kind")),
                printable(r.text("method")),
                printable(r.text("made_by", "version")),
                "none" if seed is None else printable(str(seed)),
                printable(r.text("made_by", "study_sha256"), 80),
                seconds(r.number("duration_s")),
                ", ".join(f"{word} {len(r.tracks[who])} rows" for who, word in WHO if who in r.tracks) or "none",
            ]
        )
    head = ["result", "folder", "kind", "method", "schuler", "seed", "study file, SHA-256", "duration", "tracks read"]
    folded = []
    for r in results:
        notes = r.summary.get("notes")
        notes = [printable(str(n), 500) for n in notes if isinstance(n, str)] if isinstance(notes, list) else []
        if notes:
            folded.append(
                (f"Notes of {r.label}", Grid(["what was assumed, left out or found"], [[n] for n in notes[:100]]))
            )
    return Section("made", "How they were made", grids=[Grid(head, cells, left=7)], folded=folded)
