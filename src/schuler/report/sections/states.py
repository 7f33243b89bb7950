"""What the filter learnt beside the track: gyro biases, current, scales and offsets, against the truth where known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import StateHistory
from schuler.ground.units import DEG, DEG_PER_H, MG
from schuler.report import figures
from schuler.report.figures import FILTER, SMOOTHED, TRUTH, Panel
from schuler.report.parts import Grid, Section, number
from schuler.report.view import View

Array = NDArray[np.float64]
_TITLES = {
    "accel_bias": "accelerometer bias",
    "mag_bias": "magnetometer bias",
    "gnss_bias": "GNSS bias",
    "dvl_scale": "DVL scale",
    "speed_scale": "speed-log scale",
    "path_scale": "depth-rate speed scale",
}


def gyro_biases(view: View) -> Section | None:
    return _section(view, "gyro-bias", "Gyro biases", [s for s in _states(view) if s.name.startswith("gyro_bias")])


def learnt(view: View) -> Section | None:
    states = [s for s in _states(view) if not s.name.startswith("gyro_bias")]
    states.sort(key=lambda s: s.name.startswith("accel_bias"))
    return _section(view, "learnt", "What the filter learnt", states)


def _states(view: View) -> list[StateHistory]:
    return [s for s in view.result.navigation.states.values() if len(s.time) and np.isfinite(s.value).any()]


def _section(view: View, id: str, title: str, states: list[StateHistory]) -> Section | None:
    if not states:
        return None
    known = any(s.name in view.result.truth_states for s in states)
    caption = "Estimate with ± 3 sigma" + (", and the truth." if known else ".")
    panels = [_panel(view, s) for s in states]
    if any(p.span is not None for p in panels):
        caption += " The axes leave out the widest first moments of the bands; double-click shows all."
    figure = figures.stack(f"fig-{id}", title, panels, view.axis, caption)
    if figure is None:
        return None
    return Section(id, title, figures=[figure], grids=[_last(view, states, known)])


def _panel(view: View, s: StateHistory) -> Panel:
    scale, unit, _ = shown_unit(s)
    panel = Panel(f"{_short(s.name)}, {unit}", height=120)
    truth = view.result.truth_states.get(s.name)
    reach = [scale * (s.value + k * s.std) for k in (-3.0, 3.0)]
    extent = np.concatenate(reach)
    extent = extent[np.isfinite(extent)]
    panel.traces += figures.estimate(
        view.pool, view.axis, s.time, s.value * scale, s.std * scale, "filter", FILTER, around="estimate", fmt=".4~g"
    )
    if s.smoothed is not None and np.isfinite(s.smoothed).any():
        std = s.smoothed_std * scale if s.smoothed_std is not None else None
        panel.traces += figures.estimate(
            view.pool,
            view.axis,
            s.time,
            s.smoothed * scale,
            std,
            "smoothed",
            SMOOTHED,
            around="estimate",
            fmt=".4~g",
            order=1,
        )
    if truth is not None and len(truth[0]):
        time, value = np.asarray(truth[0], float), np.asarray(truth[1], float) * scale
        panel.traces.append(figures.line(view.pool, view.axis, time, value, "truth", TRUTH, ".4~g", width=2.0))
    if len(extent) > 20:
        # The first seconds of a band can be a hundred times as wide as the rest: show what most of the run needs.
        low, high = np.percentile(extent, [4.0, 96.0])
        inner = [low, high]
        if truth is not None and np.isfinite(truth[1]).any():
            inner += [float(np.nanmin(truth[1])) * scale, float(np.nanmax(truth[1])) * scale]
        low, high = min(inner), max(inner)
        pad = 0.12 * max(high - low, 1e-12)
        if extent.max() - extent.min() > 2.0 * (high - low + 2 * pad):
            panel.span = (float(f"{low - pad:.4g}"), float(f"{high + pad:.4g}"))
    return panel


def _last(view: View, states: list[StateHistory], known: bool) -> Grid:
    """The last values as a table."""
    head = ["state", "unit", "at the end", "1 sigma"] + (["truth", "error / sigma"] if known else [])
    rows = []
    for s in states:
        scale, unit, digits = shown_unit(s)
        good = np.flatnonzero(np.isfinite(s.value))
        i = int(good[-1])
        std = float(s.std[i])
        cells = [name_of(s.name), unit, _fixed(s.value[i] * scale, digits), _fixed(std * scale, digits)]
        if known:
            truth = view.result.truth_states.get(s.name)
            if truth is None or not len(truth[0]):
                cells += [number(None), number(None)]
            else:
                true = float(np.interp(s.time[i], truth[0], truth[1]))
                cells += [_fixed(true * scale, digits), number((s.value[i] - true) / std if std > 0 else None, 2)]
        rows.append(cells)
    return Grid(head, rows, left=2)


def _fixed(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace("-", "−") if np.isfinite(value) else number(None)


def shown_unit(s: StateHistory) -> tuple[float, str, int]:
    """(factor from SI, unit as printed, decimals) of a state, so that its sigma is a readable number."""
    std = s.std[np.isfinite(s.std)]
    size = float(np.median(std)) if len(std) else 0.0
    if s.unit == "rad/s":
        return (1.0 / DEG_PER_H, "deg/h", 3) if 0.0 < size < 1e-3 * DEG else (1.0 / DEG, "deg/s", 4)
    if s.unit == "rad":
        return 1.0 / DEG, "deg", 2
    if s.unit == "m/s^2":
        return 1.0 / MG, "mg", 3
    if s.unit == "1":
        return 100.0, "%", 3
    return 1.0, s.unit, 3


def name_of(name: str) -> str:
    """'gyro_bias_z' -> 'gyro bias z', as a person would say it."""
    for key, title in _TITLES.items():
        if name.startswith(key):
            return (title + name[len(key) :]).replace("_", " ")
    return name.replace("_", " ")


def _short(name: str) -> str:
    return name_of(name).replace("accelerometer", "accel.").replace("depth-rate speed", "path")
