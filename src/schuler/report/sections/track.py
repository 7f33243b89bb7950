"""The track in local metres, the end of the last dive seen closely, and every surfacing with its miss."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import wrap_pi
from schuler.report import decimate, figures
from schuler.report.figures import FILTER, FIX, REJECTED, SMOOTHED, TRUTH
from schuler.report.parts import Figure, Grid, Section, metres, number, plural, seconds
from schuler.report.view import Dive, Track, View

Array = NDArray[np.float64]
_HOVER = "%{customdata:.1f}<br>east %{x:.1f} m, north %{y:.1f} m"
_HALF_PX = 430
_ROWS = 60  # of the table of surfacings


def track(view: View) -> Section | None:
    if not np.isfinite(view.filter.ned[:, :2]).any():
        return None
    whole = _map(view)
    close = _close(view)
    return Section(
        "track",
        "Track",
        _lead(view),
        figures=[whole, *(f for f in (close, _target(view) or _growth(view)) if f is not None)],
    )


def _lead(view: View) -> str:
    words = f"{seconds(view.span[1] - view.span[0])}, {metres(view.length)} over ground"
    if view.dives:
        words += f", {plural(len(view.dives), 'stretch', 'stretches')} without GNSS (shaded on every figure)"
    lat, lon = np.rad2deg(view.origin[0]), np.rad2deg(wrap_pi(view.origin[1]))
    place = f"{abs(lat):.5f}° {'N' if lat >= 0 else 'S'}, {abs(lon):.5f}° {'E' if lon >= 0 else 'W'}"
    return f"{words}. Local metres north and east of {place}."


def _line(
    view: View, time: Array, ned: Array, name: str, color: str, points: int = 2000, **style: Any
) -> dict[str, Any]:
    rows = decimate.keep([ned[:, 0], ned[:, 1]], points)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": view.pool.add(ned[rows, 1], exact=True),
        "y": view.pool.add(ned[rows, 0], exact=True),
        "customdata": view.pool.add(view.axis.of(time[rows])),
        "name": name,
        "line": {"color": color, "width": 1.6, **style},
        "hovertemplate": _HOVER,
    }


def _dots(view: View, time: Array, ned: Array, name: str, color: str, **marker: Any) -> dict[str, Any]:
    rows = decimate.thin(len(time), 2000)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": view.pool.add(ned[rows, 1], exact=True),
        "y": view.pool.add(ned[rows, 0], exact=True),
        "customdata": view.pool.add(view.axis.of(time[rows])),
        "name": name,
        "marker": {"color": color, "size": 4, **marker},
        "hovertemplate": _HOVER,
    }


def _joined(pieces: list[Array]) -> Array:
    """(n, 2) pieces one after the other, a gap (NaN) between them."""
    gap = np.full((1, 2), np.nan)
    return np.vstack([part for piece in pieces for part in (piece, gap)][:-1])


def _shape(view: View, pieces: list[Array], name: str, color: str, width: float, fill: float = 0.0) -> dict[str, Any]:
    points = _joined(pieces)
    trace: dict[str, Any] = {
        "type": "scatter",
        "mode": "lines",
        "x": view.pool.add(points[:, 1], exact=True),
        "y": view.pool.add(points[:, 0], exact=True),
        "name": name,
        "line": {"color": color, "width": width},
        "hoverinfo": "skip",
    }
    if fill:
        trace |= {"fill": "toself", "fillcolor": figures.shade(color, fill)}
    return trace


def _ellipses(track: Track, rows: list[int]) -> list[Array]:
    """95 % outlines (n, 2) north, east at the given rows of a track."""
    found = []
    for row in rows:
        cov, centre = track.solution.cov_pos[row, :2, :2], track.ned[row, :2]
        if np.isfinite(cov).all() and np.isfinite(centre).all():
            found.append(np.column_stack(figures.ellipse(cov)) + centre)
    return found


def _map(view: View, more: Sequence[dict[str, Any]] = (), points: Sequence[Array] = ()) -> Figure:
    """The map. more: traces on top; points: (n, 2) north, east that shall be seen too."""
    f = view.filter
    data: list[dict[str, Any]] = []
    under = [f.ned[(f.time >= d.start) & (f.time <= d.end), :2] for d in view.dives]
    under = [u[decimate.keep([u[:, 0], u[:, 1]], max(1500 // len(under), 8))] for u in under if len(u)]
    if under:
        data.append(_shape(view, under, "without GNSS", figures.DIVE_TRACK, 9.0))
    if view.fixes is not None:
        data.append(_dots(view, view.fixes[0], view.fixes[1], "fixes", FIX))
    if view.withheld_fixes is not None:
        data.append(
            _dots(view, view.withheld_fixes[0], view.withheld_fixes[1], "fixes withheld", FIX, symbol="circle-open")
        )
    if view.reference is not None:
        data.append(_line(view, view.reference["time"], view.reference["ned"], "truth", TRUTH, width=2.0))
    data.append(_line(view, f.time, f.ned, "filter", FILTER))
    if view.smoother is not None:
        data.append(_line(view, view.smoother.time, view.smoother.ned, "smoothed", SMOOTHED))
    rows = [d.row for d in view.dives]
    if len(view.dives) <= 3:
        for d in view.dives:
            rows += [int(np.searchsorted(f.time, d.start + q * d.seconds)) for q in (0.25, 0.5, 0.75)]
    outlines = _ellipses(f, sorted(set(rows))[:80])
    if outlines:
        data.append(_shape(view, outlines, "95 % ellipse", FILTER, 0.9, fill=0.07))
    missed = [np.vstack([f.ned[d.row, :2], f.ned[d.row, :2] - _miss(d)]) for d in view.dives if d.surfacing is not None]
    if missed:
        data.append(_shape(view, missed, "miss at surfacing", REJECTED, 1.4))
    good = np.isfinite(f.ned[:, :2]).all(axis=1)
    ends = f.ned[good][[0, -1], :2]
    annotations = []
    for i, (name, symbol) in enumerate((("start", "circle"), ("end", "square"))):
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [round(float(ends[i, 1]), 3)],
                "y": [round(float(ends[i, 0]), 3)],
                "name": name,
                "showlegend": False,
                "marker": {"color": "#ffffff", "size": 9, "symbol": symbol, "line": {"color": TRUTH, "width": 2}},
                "hovertemplate": name + "<br>east %{x:.1f} m, north %{y:.1f} m<extra></extra>",
            }
        )
        annotations.append(
            {
                "x": round(float(ends[i, 1]), 3),
                "y": round(float(ends[i, 0]), 3),
                "text": name,
                "showarrow": False,
                "yshift": 15,
                "font": {"size": 12, "color": TRUTH},
            }
        )
    data += more
    shown = [f.ned[good, :2], *points]
    if view.reference is not None:
        shown.append(view.reference["ned"][:, :2])
    box = _reached(_box(shown, 0.06), outlines, 0.2)
    caption = "Equal axes. The ellipses hold the filter's 95 % at the end of each stretch without GNSS"
    caption += " and at its quarters." if len(view.dives) <= 3 else "."
    return figures.plan("fig-track", "Track", data, box, caption if outlines else "Equal axes.", annotations)


def _box(pieces: list[Array], margin: float, least: float = 2.0) -> tuple[float, float, float, float]:
    """(west, east, south, north) around all finite points."""
    points = np.vstack(pieces)
    points = points[np.isfinite(points).all(axis=1)]
    south, west = points.min(axis=0)
    north, east = points.max(axis=0)
    pad = margin * max(east - west, north - south, least)
    return float(west - pad), float(east + pad), float(south - pad), float(north + pad)


def _reached(
    box: tuple[float, float, float, float], outlines: list[Array], most: float
) -> tuple[float, float, float, float]:
    """The box widened towards the ellipses by `most` of its size at most: one wild ellipse must not rule the map."""
    if not outlines:
        return box
    wide = _box(outlines, 0.02)
    room = most * max(box[1] - box[0], box[3] - box[2])
    return (
        max(min(box[0], wide[0]), box[0] - room),
        min(max(box[1], wide[1]), box[1] + room),
        max(min(box[2], wide[2]), box[2] - room),
        min(max(box[3], wide[3]), box[3] + room),
    )


def _close(view: View) -> Figure | None:
    """The end of the last dive: where the filter thought it was, where it was, and the fixes that followed."""
    dives = [d for d in view.dives if d.surfacing is not None]
    if not dives:
        return None
    d, f = dives[-1], view.filter
    predicted = f.ned[d.row, :2]
    outline = _ellipses(f, [d.row])
    if not np.isfinite(predicted).all():
        return None
    data: list[dict[str, Any]] = []
    pieces = [predicted[None, :], *outline]
    if outline:
        data.append(_shape(view, outline, "filter's 95 % before the fix", FILTER, 1.0, fill=0.08))
    if view.smoother is not None:
        row = min(int(np.searchsorted(view.smoother.time, f.time[d.row])), len(view.smoother.time) - 1)
        small = _ellipses(view.smoother, [row])
        if small:
            data.append(_shape(view, small, "smoothed 95 %", SMOOTHED, 1.0, fill=0.08))
            pieces += small
    pieces.append((predicted - _miss(d))[None, :])
    data.append(_shape(view, [np.vstack([predicted, predicted - _miss(d)])], "miss", REJECTED, 1.6))
    if view.reference is not None:
        at = [np.interp(f.time[d.row], view.reference["time"], view.reference["ned"][:, i]) for i in (0, 1)]
        pieces.append(np.array([at]))
    west, east, south, north = _box(pieces, 0.15)
    # Square, so that it stands beside its neighbour, and wide enough for some seconds of track.
    half, x, y = 0.5 * max(east - west, north - south, 12.0), 0.5 * (west + east), 0.5 * (south + north)

    def window(time: Array, ned: Array) -> tuple[Array, Array]:
        near = (np.abs(ned[:, 1] - x) < 2 * half) & (np.abs(ned[:, 0] - y) < 2 * half)
        near &= (time > d.end - 0.3 * d.seconds) & (time < d.end + max(0.3 * d.seconds, 60.0))
        return time[near], ned[near]

    if view.fixes is not None:
        data.append(_dots(view, *window(*view.fixes), "fixes", FIX, size=5))
    if view.reference is not None:
        data.append(_line(view, *window(view.reference["time"], view.reference["ned"]), "truth", TRUTH, 500, width=2.0))
    for name, color, t in view.tracks:
        data.append(_line(view, *window(t.time, t.ned), name, color, 500))
    for trace in data:  # the colours are those of the track above
        trace["showlegend"] = False
    return figures.plan(
        "fig-surfacing",
        "The last surfacing" if len(dives) > 1 else "Surfacing",
        data,
        (x - half, x + half, y - half, y + half),
        "The moment of the first fix: where the filter expected it, with its 95 %, and the miss. Colours as above.",
        height_px=(_HALF_PX, _HALF_PX),
        half=True,
    )


def _miss(d: Dive) -> Array:
    """(2,) m north, east: predicted minus fix."""
    assert d.surfacing is not None
    return np.array([d.surfacing["north_m"], d.surfacing["east_m"]], dtype=float)


def _target(view: View) -> Figure | None:
    """All misses in one target."""
    ends = [(i, d, d.surfacing) for i, d in enumerate(view.dives, 1) if d.surfacing is not None]
    if len(ends) < 2:
        return None
    miss = np.array([_miss(d) for _, d, _ in ends])
    good = np.array([bool(s["inside_95"]) for _, _, s in ends])
    few = len(ends) <= 12
    data: list[dict[str, Any]] = []
    outlines = [np.column_stack(figures.ellipse(view.filter.solution.cov_pos[d.row, :2, :2])) for _, d, _ in ends if few
                and np.isfinite(view.filter.solution.cov_pos[d.row, :2, :2]).all()]  # fmt: skip
    if outlines:
        data.append(_shape(view, outlines, "filter's 95 %", FILTER, 0.8, fill=0.03))
    for mask, name, color in ((good, "inside its 95 % ellipse", FILTER), (~good, "outside", REJECTED)):
        if mask.any():
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers+text" if few else "markers",
                    "x": [round(float(v), 2) for v in miss[mask, 1]],
                    "y": [round(float(v), 2) for v in miss[mask, 0]],
                    "text": [str(i) for (i, _, _), m in zip(ends, mask, strict=True) if m],
                    "textposition": "top right",
                    "name": name,
                    "marker": {"color": color, "size": 7},
                    "hovertemplate": "surfacing %{text}: east %{x:.0f} m, north %{y:.0f} m<extra></extra>",
                }
            )
    data.append(
        {
            "type": "scatter",
            "mode": "markers",
            "x": [0],
            "y": [0],
            "showlegend": False,
            "name": "the fix",
            "marker": {"size": 13, "symbol": "cross-thin", "line": {"color": TRUTH, "width": 2}},
            "hoverinfo": "skip",
        }
    )
    farthest = float(np.abs(miss).max())
    half = 1.12 * min(max([farthest, *(float(np.abs(o).max()) for o in outlines)]), 3.0 * max(farthest, 1e-3))
    return figures.plan(
        "fig-misses", "Every surfacing", data, (-half, half, -half, half),
        "Where the filter expected each first fix, against the fix (cross)."
        + (" Ellipses: the filter's 95 %, around zero." if outlines else ""),
        labels=("miss east, m", "miss north, m"), height_px=(_HALF_PX, _HALF_PX), half=True,
    )  # fmt: skip


def _growth(view: View) -> Figure | None:
    """How the horizontal error and its sigma grow while there is no fix."""
    if not view.dives:
        return None
    data: list[dict[str, Any]] = []
    longest = max(d.seconds for d in view.dives)
    size, unit = (1.0, "s") if longest <= 3600.0 else (60.0, "min")
    top = 0.0
    for name, color, track in view.tracks:
        for kind, dash, word in (("error", "solid", "error"), ("sigma", "dot", "1 sigma")):
            lines = []
            for d in view.dives:
                if kind == "error" and track.errors is None:
                    continue
                series = track.errors if kind == "error" else None
                time = series.time if series is not None else track.time
                inside = (time >= d.start) & (time <= track.time[min(d.row, len(track.time) - 1)])
                if series is not None:
                    value = series.horizontal[inside]
                else:
                    value = _largest_sigma(track.solution.cov_pos[inside, :2, :2])
                lines.append(np.column_stack([value, (time[inside] - d.start) / size]))
            lines = [
                l[decimate.keep([l[:, 0]], max(1000 // len(lines), 20))] for l in lines if np.isfinite(l[:, 0]).any()
            ]
            if not lines:
                continue
            joined = _joined(lines)
            top = max(top, float(np.nanmax(joined[:, 0])))
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": view.pool.add(joined[:, 1]),
                    "y": view.pool.add(joined[:, 0]),
                    "name": f"{name}, {word}",
                    "line": {"color": color, "width": 1.6, "dash": dash},
                    "hovertemplate": "%{y:.1f} m",
                }
            )
    if not data:
        return None
    layout = {
        "height": _HALF_PX,
        "margin": {"l": 66, "r": 14, "t": 52, "b": 46},
        "hovermode": "x unified",
        "xaxis": {
            "title": {"text": f"time without GNSS, {unit}", "standoff": 8},
            "range": [0, longest / size],
            "hoverformat": ".0f",
        },
        "yaxis": {
            "title": {"text": "horizontal, m", "standoff": 6},
            "range": [0, 1.08 * max(top, 1e-3)],
            "zeroline": False,
        },
    }
    spec = {"data": data, "layout": layout}
    return Figure("fig-growth", "Growth without fixes", spec, _HALF_PX, "Sigma: of the largest axis.", half=True)


def _largest_sigma(cov: Array) -> Array:
    """(n,) m: root of the larger eigenvalue of (n, 2, 2)."""
    a, b, c = cov[:, 0, 0], cov[:, 1, 1], cov[:, 0, 1]
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.maximum(0.5 * (a + b) + np.hypot(0.5 * (a - b), c), 0.0))


def surfacings(view: View) -> Section | None:
    if not view.dives:
        return None
    truth = any(math.isfinite(d.of("horizontal_end_m")) for d in view.dives)
    head = [
        "",
        f"from, {view.axis.title.rpartition(', ')[2]}",
        "without GNSS",
        "distance",
        "miss at the fix",
        "predicted sigma",
        "in 95 %",
    ]
    if truth:
        head += ["error against the truth", "its 1 sigma", "heading error", "its 1 sigma"]
    rows, tones = [], []
    for i, d in list(enumerate(view.dives, 1))[:_ROWS]:
        cells = [str(i), _moment(view, d.start), seconds(d.seconds), metres(d.of("distance_m"))]
        cells += _miss_cells(d)
        if truth:
            cells += [metres(d.of("horizontal_end_m")), metres(d.of("sigma_end_m"))]
            cells += [_degrees(d.of("heading_end_deg")), _degrees(d.of("heading_sigma_deg"))]
        rows.append(cells)
        tones.append("warn" if d.surfacing is not None and not d.surfacing["inside_95"] else "")
    caption = (
        "Miss: distance from the position predicted just before the first fix to that fix. Predicted sigma: largest "
        "axis of the ellipse of prediction and fix together."
    )
    if len(view.dives) > _ROWS:
        caption += f" The first {_ROWS} of {len(view.dives)} are shown."
    return Section("surfacings", "Surfacings", grids=[Grid(head, rows, caption, tones=tones)])


def _moment(view: View, time: float) -> str:
    decimals = {1.0: 0, 60.0: 1, 3600.0: 2}.get(view.axis.unit_s, 3)
    return f"{float(view.axis.of(time)) + 0.0:.{decimals}f}".replace("-", "−")


def _degrees(value: float) -> str:
    return f"{number(value, 2)} deg" if math.isfinite(value) else number(None)


def _miss_cells(d: Dive) -> list[str]:
    s = d.surfacing
    if s is None:
        return ["no fix after it", "", ""]
    return [metres(float(s["miss_m"])), metres(float(s["sigma_major_m"])), "yes" if s["inside_95"] else "no"]
