"""Figures as plain plotly JSON: the colours, the pool of arrays, stacked time panels and equal-axes maps.

No plotly object is built: its validation costs more than all our arithmetic. Arrays travel once each, as base64, in a
pool; a figure refers to them as {"$": number}; page.js puts them back.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schuler.report import decimate
from schuler.report.parts import Figure

Array = NDArray[np.float64]

_DECADES = [1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5]

# One colour a role, on every figure; told apart by colour-blind readers too (Okabe and Ito's set).
TRUTH = "#2b2f36"
FILTER = "#0072b2"
SMOOTHED = "#d55e00"
FIX = "#009e73"
REJECTED = "#c0266b"
BOUND = "#8a94a3"
TITLE = "#5b6573"
ROLE = {"truth": TRUTH, "filter": FILTER, "smoothed": SMOOTHED}
DIVE = "rgba(70, 110, 160, 0.10)"
DIVE_TRACK = "rgba(70, 110, 160, 0.22)"
SERIES = (FILTER, SMOOTHED, FIX, "#7b5ea7", "#b38600", "#56b4e9", REJECTED, TRUTH)

_PANEL_PX, _GAP_PX, _TOP_PX, _BOTTOM_PX, _LEFT_PX, _RIGHT_PX = 150, 18, 34, 46, 84, 14
_TITLE_PX = -46  # from the axis to its title


def shade(color: str, opacity: float) -> str:
    """'#rrggbb' as an rgba() of that opacity."""
    r, g, b = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({r}, {g}, {b}, {opacity})"


def label(text: object) -> str:
    """Text for inside a figure. Plotly reads some HTML in its labels, so names from files are escaped."""
    return html.escape(str(text), quote=False)


@dataclass
class Pool:
    """Every array of the page, once. `add` gives the reference that a figure carries."""

    entries: list[dict[str, Any]] = field(default_factory=list)
    _seen: dict[tuple[str, bytes], int] = field(default_factory=dict)

    def add(self, values: Any, exact: bool = False) -> dict[str, int]:
        """Put an array in the pool. NaN and infinities become gaps.

        exact : float32; else 16-bit steps of 1/65000 of the array's range, finer than any screen and half the size.
        """
        array = np.asarray(values, dtype=float)
        finite = np.isfinite(array)
        if exact or not finite.any():
            raw = np.where(finite, array, np.nan).astype("<f4").tobytes()
            return self._put("f4", raw, {})
        low, high = float(array[finite].min()), float(array[finite].max())
        step = (high - low) / 65000.0 or 1.0
        middle = low if high == low else 0.5 * (low + high)
        counts = np.full(array.shape, -32768, dtype="<i2")
        counts[finite] = np.round((array[finite] - middle) / step).astype("<i2")
        return self._put("i2", counts.tobytes(), {"s": float(f"{step:.9g}"), "o": float(f"{middle:.12g}")})

    def _put(self, kind: str, raw: bytes, more: dict[str, float]) -> dict[str, int]:
        key = (f"{kind}{more}", raw)
        if key not in self._seen:
            self._seen[key] = len(self.entries)
            self.entries.append({"k": kind, **more, "d": base64.b64encode(raw).decode("ascii")})
        return {"$": self._seen[key]}


@dataclass(frozen=True)
class TimeAxis:
    """The page's time axis: how seconds of the study's clock become what is printed under the figures."""

    origin_s: float
    unit_s: float
    title: str
    span: tuple[float, float]  # shown, in the axis' unit
    shaded: Sequence[tuple[float, float, str]] = ()  # from, to (study's clock, s), colour

    def of(self, time_s: Any) -> Array:
        return (np.asarray(time_s, dtype=float) - self.origin_s) / self.unit_s


@dataclass
class Panel:
    """One panel of a stack: the y axis' title (with its unit) and plotly traces."""

    label: str
    traces: list[dict[str, Any]] = field(default_factory=list)
    zero: bool = False
    log: bool = False
    reverse: bool = False
    span: tuple[float, float] | None = None
    height: int = _PANEL_PX
    lines: Sequence[tuple[float, str]] = ()  # level marks: value, what it is
    shaded: Sequence[tuple[float, float, str]] = ()  # of this panel alone: from, to (study's clock, s), colour


def gapped(time: Array, *values: Array) -> tuple[Array, ...]:
    """(time, *values) with NaN in the gaps of the series, so that lines and bands stop where the rows stop."""
    if len(time) < 3:
        return time, *values
    step = np.diff(time)
    far = np.flatnonzero(step > max(8.0 * float(np.median(step)), 1e-6))
    middle = 0.5 * (time[far] + time[far + 1])
    return np.insert(time, far + 1, middle), *(np.insert(v, far + 1, np.nan) for v in values)


def line(
    pool: Pool, axis: TimeAxis, time: Array, value: Array, name: str, color: str, fmt: str = ".3~g", **style: Any
) -> dict[str, Any]:
    """A decimated line over time; it stops where the rows stop."""
    time, value = gapped(time, value)
    rows = decimate.keep([value])
    return {
        "type": "scatter",
        "mode": "lines",
        "x": pool.add(axis.of(time[rows])),
        "y": pool.add(value[rows]),
        "name": name,
        "line": {"color": color, "width": 1.4, **style},
        "hovertemplate": "%{y:" + fmt + "}",
    }


def estimate(
    pool: Pool,
    axis: TimeAxis,
    time: Array,
    value: Array,
    std: Array | None,
    name: str,
    color: str,
    around: Literal["zero", "estimate"] = "zero",
    fmt: str = ".3~g",
    k: float = 3.0,
    order: int = 0,
) -> list[dict[str, Any]]:
    """A line with its k-sigma band: around zero (an error) or around the estimate itself (a state)."""
    usable = std is not None and bool(np.isfinite(std).any())
    if usable and std is not None:
        time, value, std = gapped(time, value, std)
    else:
        time, value = gapped(time, value)
    rows = decimate.keep([value, std] if usable and std is not None else [value])
    x = pool.add(axis.of(time[rows]))
    y = pool.add(value[rows])
    traces: list[dict[str, Any]] = []
    if usable and std is not None:
        traces.append(
            {
                "band": {"x": x, "mid": y if around == "estimate" else None, "std": pool.add(std[rows]), "k": k},
                "name": f"{name} ± {k:g} σ",
                "line": {"color": shade(color, 0.35), "width": 0.8},
                "fillcolor": shade(color, 0.13),
                "legendrank": 1000 + 2 * order + 1,
            }
        )
    if np.isfinite(value).any():
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": x,
                "y": y,
                "name": name,
                "line": {"color": color, "width": 1.5},
                "hovertemplate": "%{y:" + fmt + "}",
                "legendrank": 1000 + 2 * order,
            }
        )
    return traces


def marks(
    pool: Pool,
    axis: TimeAxis,
    time: Array,
    value: Array,
    name: str,
    color: str,
    symbol: str = "circle",
    size: float = 3.5,
    fmt: str = ".3~g",
    points: int = decimate.POINTS,
    told: Array | None = None,
) -> dict[str, Any]:
    """Separate marks over time; where there are too many, the farthest quarter stays, and an even choice of the rest.

    told : what hovering tells instead of the value, as %{customdata} of `fmt`, a whole hover template then.
    """
    rows = decimate.thin(len(value), points - points // 4)
    if len(rows) < len(value):
        rows = np.union1d(rows, np.argsort(-np.abs(np.nan_to_num(value)), kind="stable")[: points // 4])
    hover: dict[str, Any] = {"hovertemplate": "%{y:" + fmt + "}"}
    if told is not None:
        hover = {"customdata": pool.add(told[rows]), "hovertemplate": fmt}
    return {
        **hover,
        "type": "scatter",
        "mode": "markers",
        "x": pool.add(axis.of(time[rows])),
        "y": pool.add(value[rows]),
        "name": name,
        "marker": {"color": color, "size": size, "symbol": symbol},
    }


def stack(id: str, title: str, panels: Sequence[Panel], axis: TimeAxis, caption: str = "") -> Figure | None:
    """Panels above each other on one time axis; None where no panel has anything to show.

    A name appears once in the legend and switches its lines in all panels.
    """
    panels = [p for p in panels if p.traces]
    if not panels:
        return None
    inner = sum(p.height for p in panels) + _GAP_PX * (len(panels) - 1)
    height = inner + _TOP_PX + _BOTTOM_PX
    layout: dict[str, Any] = {
        "height": height,
        "margin": {"l": _LEFT_PX, "r": _RIGHT_PX, "t": _TOP_PX, "b": _BOTTOM_PX},
        "hovermode": "x unified",
        "shapes": [
            {
                "type": "rect",
                "layer": "below",
                "xref": "x",
                "yref": "paper",
                "x0": round(float(axis.of(a)), 4),
                "x1": round(float(axis.of(b)), 4),
                "y0": 0,
                "y1": 1,
                "fillcolor": color,
                "line": {"width": 0},
            }
            for a, b, color in axis.shaded
        ],
        "annotations": [],
    }
    data: list[dict[str, Any]] = []
    named: set[str] = set()
    top = 1.0
    for i, panel in enumerate(panels):
        suffix = "" if i == 0 else str(i + 1)
        bottom = max(top - panel.height / inner, 0.0)
        y_axis: dict[str, Any] = {
            "domain": [round(bottom, 5), round(top, 5)],
            "anchor": "x",
            "zeroline": panel.zero,
        }
        if panel.log:
            y_axis |= {"type": "log", "tickvals": _DECADES, "ticktext": [f"{v:g}" for v in _DECADES]}
        if panel.reverse:
            y_axis["autorange"] = "reversed"
        if panel.span is not None:
            y_axis["range"] = list(panel.span)
        layout[f"yaxis{suffix}"] = y_axis
        # Titles in one column, wherever the widest tick label ends.
        layout["annotations"].append(
            {
                "text": label(panel.label).replace("\n", "<br>"),
                "textangle": -90,
                "xref": "paper",
                "yref": "paper",
                "x": 0,
                "xanchor": "right",
                "xshift": _TITLE_PX,
                "y": round(0.5 * (bottom + top), 5),
                "yanchor": "middle",
                "showarrow": False,
                "font": {"size": 12, "color": TITLE},
            }
        )
        for start, end, color in panel.shaded:
            layout["shapes"].append(
                {
                    "type": "rect",
                    "layer": "below",
                    "xref": "x",
                    "yref": f"y{suffix} domain",
                    "x0": round(float(axis.of(start)), 4),
                    "x1": round(float(axis.of(end)), 4),
                    "y0": 0,
                    "y1": 1,
                    "fillcolor": color,
                    "line": {"width": 1, "color": color},
                }
            )
        for level, _ in panel.lines:
            layout["shapes"].append(
                {
                    "type": "line",
                    "xref": "paper",
                    "yref": f"y{suffix}",
                    "x0": 0,
                    "x1": 1,
                    "y0": level,
                    "y1": level,
                    "line": {"color": BOUND, "width": 1, "dash": "dash"},
                }
            )
        for trace in panel.traces:
            name = label(trace["name"])
            data.append(
                {
                    **trace,
                    "name": name,
                    "xaxis": "x",
                    "yaxis": f"y{suffix}",
                    "legendgroup": name,
                    "showlegend": name not in named,
                }
            )
            named.add(name)
        top = bottom - _GAP_PX / inner
    last = "" if len(panels) == 1 else str(len(panels))
    layout["xaxis"] = {
        "title": {"text": label(axis.title), "standoff": 8},
        "anchor": f"y{last}",
        "range": list(axis.span),
        "hoverformat": ".1f",
        "zeroline": False,
    }
    return Figure(id, title, {"data": data, "layout": layout}, height, caption, follows_time=True)


def plan(
    id: str,
    title: str,
    data: list[dict[str, Any]],
    box: tuple[float, float, float, float],
    caption: str = "",
    annotations: Sequence[dict[str, Any]] = (),
    width_px: int = 1000,
    labels: tuple[str, str] = ("east, m", "north, m"),
    height_px: tuple[int, int] = (340, 640),
    half: bool = False,
) -> Figure:
    """A map with equal axes. box = (west, east, south, north) in metres; the height follows the box's own shape."""
    west, east, south, north = box
    wide, high = max(east - west, 1e-3), max(north - south, 1e-3)
    height = int(np.clip((width_px - 90) * high / wide + _TOP_PX + _BOTTOM_PX, *height_px))
    metric = {"zeroline": False, "exponentformat": "none", "separatethousands": True}
    layout = {
        "height": height,
        "margin": {"l": _LEFT_PX, "r": _RIGHT_PX, "t": _TOP_PX, "b": _BOTTOM_PX},
        "hovermode": "closest",
        "separators": ". ",
        "xaxis": {"title": {"text": labels[0], "standoff": 8}, "range": [west, east], **metric},
        "yaxis": {
            "title": {"text": labels[1], "standoff": 6},
            "range": [south, north],
            **metric,
            "scaleanchor": "x",
            "scaleratio": 1,
        },
        "annotations": list(annotations),
    }
    return Figure(id, title, {"data": data, "layout": layout}, height, caption, half=half)


def ellipse(cov: Array, probability: float = 0.95, points: int = 49) -> tuple[Array, Array]:
    """Outline (north, east) in metres of a horizontal error ellipse around zero.

    cov : (2, 2) m^2, north and east. The radius is the root of the chi-square quantile of two degrees of freedom,
    -2 ln(1 - probability): 2.4477 sigma at 95 %.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    values, vectors = np.linalg.eigh(0.5 * (cov + cov.T))
    radius = np.sqrt(np.maximum(values, 0.0) * -2.0 * np.log1p(-probability))
    outline = vectors @ (radius[:, None] * np.vstack([np.cos(angle), np.sin(angle)]))
    return outline[0], outline[1]
