"""Pages of kind "strapdown": error growth beside the linear model, the closed form and the numerical floor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.report import figures
from schuler.report.figures import BOUND, FILTER, FIX, SMOOTHED, Panel
from schuler.report.parts import Grid, Opening, Section, Tile, metres, number, seconds
from schuler.report.view import View

Array = NDArray[np.float64]
_DEG = 180.0 / math.pi
_LINES: tuple[tuple[str, str, str, dict[str, Any]], ...] = (
    ("error", "the run", FILTER, {"width": 2.0}),
    ("linear", "linear model", SMOOTHED, {"dash": "dash"}),
    ("closed", "closed form at rest", FIX, {"dash": "dot"}),
    ("open", "open loop: t², t³", BOUND, {}),
)


def _told(view: View) -> dict[str, Any]:
    return view.summary.get("strapdown") or {}


def opening(view: View) -> Opening:
    """Head of the page."""
    told = _told(view)
    what = "simulated" if view.simulated else "recorded"
    if (seed := view.result.made_by.get("seed")) is not None and view.simulated:
        what += f", seed {seed}"
    parts = ["free inertial navigation", what, f"vertical channel {told.get('vertical', 'as given')}"]
    errors = ((view.summary.get("errors") or {}).get("filter") or {}).get("horizontal_m") or {}
    duration, end = view.summary.get("duration_s"), errors.get("end")
    tiles = []
    if end is None:
        verdict = "There is no reference: the track and its sigma are shown, its error is not known."
        tone = "warn"
    else:
        verdict = f"After {seconds(duration)} without any aid the horizontal error is {metres(end)}"
        verdict += f", {metres(errors.get('max'))} at most."
        share = told.get("linear_difference_share")
        if share is not None:
            verdict += f" The linear error model explains it to {number(100.0 * share, 2)} % of the largest error."
        tone = ""
        tiles = [
            Tile("horizontal error at the end", metres(end), note=f"after {seconds(duration)}"),
            Tile("at most", metres(errors.get("max"))),
        ]
        if share is not None:
            tiles.append(Tile("linear model, worst difference", number(100.0 * share, 2), "% of the largest error"))
        if told.get("floor_horizontal_m") is not None:
            tiles.append(Tile("numerical floor", number(told["floor_horizontal_m"], 2), "m", "same run without errors"))
    return Opening(view.name, " · ".join(parts), verdict, tone, tuple(tiles))


def _series(view: View, name: str) -> tuple[Array, Array] | None:
    found = view.result.truth_states.get(name)
    return found if found is not None and len(found[0]) else None


def growth(view: View) -> Section | None:
    """Position error against the linear model, the closed form and the open-loop formulas, one figure."""
    if _series(view, "error_north") is None:
        return None
    panels = []
    for axis in ("north", "east"):
        panel = Panel(f"{axis} error, m", zero=True, height=190)
        run = _series(view, f"error_{axis}")
        limit = 1.5 * float(np.nanmax(np.abs(run[1]))) if run is not None else math.inf
        for kind, name, color, style in _LINES:
            found = _series(view, f"{kind}_{axis}")
            if found is None:
                continue
            time, value = found
            if kind == "open":  # it leaves the picture within the hour: cut where it does
                value = np.where(np.abs(value) <= limit, value, np.nan)
            panel.traces.append(figures.line(view.pool, view.axis, time, value, name, color, ".2f", **style))
        panels.append(panel)
    for axis, label in (("tilt_north", "tilt about north"), ("tilt_east", "tilt about east"), ("azimuth", "azimuth")):
        panel = Panel(f"{label}, arcmin", zero=True)
        for kind, name, color, style in _LINES[:2]:
            found = _series(view, f"{kind}_{axis}")
            if found is not None:
                panel.traces.append(
                    figures.line(view.pool, view.axis, found[0], found[1] * _DEG * 60.0, name, color, ".4f", **style)
                )
        panels.append(panel)
    told = _told(view)
    caption = (
        "Error = estimate − truth. The closed form (Schuler, Foucault and 24 h motion together) is that of a vehicle "
        "at rest at the start with the first biases: it shares the periods, not the motion. The t² and t³ formulas "
        f"are at most a tenth too large up to {seconds(told.get('open_loop_accel_holds_s'))} (accelerometer) and "
        f"{seconds(told.get('open_loop_gyro_holds_s'))} (gyro)."
    )
    figure = figures.stack("fig-growth", "Error growth", panels, view.axis, caption)
    return Section("growth", "Error growth", figures=[figure]) if figure else None


def floor(view: View) -> Section | None:
    """What is left of the same run without any sensor error."""
    found = _series(view, "floor_horizontal")
    if found is None:
        return None
    panel = Panel("horizontal, m", log=True, height=170)
    panel.traces.append(
        figures.line(view.pool, view.axis, found[0], np.maximum(found[1], 1e-12), "numerical floor", FILTER, ".2e")
    )
    caption = "The same increments without sensor errors through the same mechanization: the error of the arithmetic."
    figure = figures.stack("fig-floor", "Numerical floor", [panel], view.axis, caption)
    return Section("floor", "Numerical floor", figures=[figure]) if figure else None


def table(view: View) -> Section | None:
    """Ends by each way of computing them."""
    told = _told(view)
    if told.get("end_north_m") is None:
        return None
    rows = []
    for key, name in (("", "the run"), ("linear_", "linear model"), ("closed_", "closed form at rest")):
        north, east = told.get(f"{key}end_north_m"), told.get(f"{key}end_east_m")
        if north is not None and east is not None:
            rows.append([name, number(north, 5), number(east, 5), number(math.hypot(north, east), 5)])
    if told.get("open_loop_end_m") is not None:
        rows.append(["open loop: t², t³", "", "", number(told["open_loop_end_m"], 5)])
    grid = Grid(["at the end", "north, m", "east, m", "together, m"], rows)
    return Section("ends", "At the end", grids=[grid])
