"""Errors of position, attitude and velocity inside their 3 sigma; without a reference, estimates and their sigma."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.report import figures
from schuler.report.figures import BOUND, TRUTH, Panel
from schuler.report.parts import Section
from schuler.report.view import Track, View, roots

Array = NDArray[np.float64]
_AXES = ("north", "east", "down")
_BAND = "Error = estimate − truth. The bands are ± 3 sigma as the filter (or the smoother) states it."


def _known(view: View, which: str) -> bool:
    """Any of these errors is known."""
    series = [t.errors for _, _, t in view.tracks if t.errors is not None]
    return any(bool(np.isfinite(getattr(e, which)).any()) for e in series)


def _error_panel(view: View, which: str, cov: str, i: int, label: str, scale: float, fmt: str) -> Panel:
    """Errors of filter and smoother with their bands. which : "position", "velocity" or "rpy" of an `ErrorSeries`."""
    panel = Panel(label, zero=True)
    for order, (name, color, track) in enumerate(view.tracks):
        if track.errors is None:
            continue
        error = getattr(track.errors, which)[:, i]
        if np.isfinite(error).any():
            std = roots(getattr(track.errors, cov))[:, i]
            panel.traces += figures.estimate(
                view.pool, view.axis, track.errors.time, error * scale, std * scale, name, color, fmt=fmt, order=order
            )
    return panel


def _estimate_panel(view: View, which: str, attribute: str, i: int, label: str, scale: float, fmt: str) -> Panel:
    panel = Panel(label)
    for order, (name, color, track) in enumerate(view.tracks):
        value = getattr(track.solution, attribute)[:, i]
        if np.isfinite(value).any():
            std = track.std(which)[:, i] * scale
            panel.traces += figures.estimate(
                view.pool,
                view.axis,
                track.time,
                value * scale,
                std,
                name,
                color,
                around="estimate",
                fmt=fmt,
                order=order,
            )
    return panel


def position(view: View) -> Section | None:
    if _known(view, "position"):
        panels = [
            _error_panel(view, "position", "cov_pos", i, f"{name} error, m", 1.0, ".2f") for i, name in enumerate(_AXES)
        ]
        figure = figures.stack("fig-position", "Position error", panels, view.axis, _BAND)
        return Section("position", "Position error", figures=[figure]) if figure else None
    panel = Panel("horizontal sigma, m", height=190, log=True)
    for name, color, track in view.tracks:
        std = track.std("pos")[:, :2]
        if np.isfinite(std).any():
            panel.traces.append(
                figures.line(view.pool, view.axis, track.time, np.hypot(std[:, 0], std[:, 1]), name, color, ".1f")
            )
    caption = (
        "1 sigma of the horizontal position as filter and smoother state it. There is no reference to judge it against."
    )
    figure = figures.stack("fig-position", "Position uncertainty", [panel], view.axis, caption)
    return Section("position", "Position uncertainty", figures=[figure]) if figure else None


def _broken(angle: Array) -> Array:
    """Degrees 0..360 with a gap where the heading passes north, so that no line crosses the panel."""
    deg = np.mod(np.rad2deg(angle), 360.0)
    with np.errstate(invalid="ignore"):
        jump = np.abs(np.diff(deg)) > 180.0
    deg[1:][jump] = np.nan
    return deg


def attitude(view: View) -> Section | None:
    reference, pool, axis = view.reference, view.pool, view.axis
    heading = Panel("heading, deg")
    if reference is not None and "heading" in reference and np.isfinite(reference["heading"]).any():
        heading.traces.append(
            figures.line(pool, axis, reference["time"], _broken(reference["heading"]), "truth", TRUTH, ".1f", width=2.0)
        )
    for name, color, track in view.tracks:
        if np.isfinite(track.solution.rpy[:, 2]).any():
            heading.traces.append(
                figures.line(pool, axis, track.time, _broken(track.solution.rpy[:, 2]), name, color, ".1f")
            )
    names = ("roll", "pitch", "heading")
    judged = _known(view, "rpy")
    deg = 180.0 / np.pi
    if judged:
        panels = [_error_panel(view, "rpy", "cov_rpy", i, f"{names[i]} error, deg", deg, ".2f") for i in (2, 0, 1)]
        caption = _BAND
    else:
        panels = [_sigma_panel(view, "rpy", 2, "heading sigma, deg", deg)]
        panels += [_estimate_panel(view, "rpy", "rpy", i, f"{names[i]}, deg", deg, ".2f") for i in (0, 1)]
        caption = "1 sigma of the heading as filter and smoother state it; roll and pitch with ± 3 sigma."
    figure = figures.stack("fig-attitude", "Heading and attitude", [heading, *panels], axis, caption)
    return Section("attitude", "Heading and attitude", figures=[figure]) if figure else None


def _sigma_panel(view: View, which: str, i: int, label: str, scale: float) -> Panel:
    panel = Panel(label)
    for name, color, track in view.tracks:
        std = track.std(which)[:, i] * scale
        if np.isfinite(std).any():
            panel.traces.append(figures.line(view.pool, view.axis, track.time, std, name, color, ".2f"))
    return panel


def velocity(view: View) -> Section | None:
    if _known(view, "velocity"):
        panels = [
            _error_panel(view, "velocity", "cov_vel", i, f"v {name} error, m/s", 1.0, ".3f")
            for i, name in enumerate(_AXES)
        ]
        title, caption = "Velocity error", _BAND
    else:
        panels = [
            _estimate_panel(view, "vel", "v_n", i, f"v {name}, m/s", 1.0, ".3f") for i, name in enumerate(_AXES[:2])
        ]
        title, caption = "Velocity", "Over ground, with ± 3 sigma."
    figure = figures.stack("fig-velocity", title, panels, view.axis, caption)
    return Section("velocity", title, figures=[figure]) if figure else None


def depth(view: View) -> Section | None:
    """Depth (height below the ellipsoid's zero) of truth, sensor, filter and smoother."""
    panel = Panel("depth, m", reverse=True, height=190)
    reference, pool, axis = view.reference, view.pool, view.axis
    sensor = view.result.tables.get("depth")

    def add(time: Array, value: Array, name: str, color: str, **style: Any) -> None:
        if np.isfinite(value).any():
            panel.traces.append(figures.line(pool, axis, time, value, name, color, ".2f", **style))

    if sensor is not None and len(sensor):
        add(sensor.time, np.asarray(sensor["depth"], float), "depth sensor", BOUND, width=3.0)
    if reference is not None and "height" in reference:
        add(reference["time"], -reference["height"], "truth", TRUTH, width=2.0)
    for name, color, track in view.tracks:
        add(track.time, -track.solution.height, name, color)
    moved = [_range(t) for _, _, t in view.tracks]
    if view.kind != "auv" or not panel.traces or (sensor is None and not any(m > 0.5 for m in moved)):
        return None
    figure = figures.stack("fig-depth", "Depth", [panel], axis)
    return Section("depth", "Depth", figures=[figure]) if figure else None


def _range(track: Track) -> float:
    height = track.solution.height[np.isfinite(track.solution.height)]
    return float(np.ptp(height)) if len(height) else 0.0
