"""The table of figures, what was assumed, how the page was made, and how to cite it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from schuler.report.parts import Grid, Section, metres, number, seconds
from schuler.report.view import View

_ROWS = (
    ("horizontal_m", "horizontal position", "m"),
    ("vertical_m", "vertical position", "m"),
    ("velocity_mps", "velocity", "m/s"),
    ("roll_deg", "roll", "deg"),
    ("pitch_deg", "pitch", "deg"),
    ("heading_deg", "heading", "deg"),
)
_STATISTICS = (("rms", "rms"), ("p95", "95 %"), ("max", "max"), ("end", "end"))


def figures_table(view: View) -> Section | None:
    grids = [g for g in (_errors(view), _outages(view)) if g is not None]
    return Section("figures", "Table of figures", grids=grids) if grids else None


def _errors(view: View) -> Grid | None:
    errors = view.summary.get("errors") or {}
    who = [(key, word) for key, word in (("filter", "filter"), ("smoother", "smoothed")) if errors.get(key)]
    head = ["error", "unit", *(s for _ in who for _, s in _STATISTICS)]
    groups = [("", 2), *((word, len(_STATISTICS)) for _, word in who)]
    rows = []
    for key, name, unit in _ROWS:
        cells = [((errors[w].get(key)) or {}).get(s) for w, _ in who for s, _ in _STATISTICS]
        if any(c is not None for c in cells):
            rows.append([name, unit, *(number(c) for c in cells)])
    return Grid(head, rows, "Against the reference, at all moments that it covers.", 2, groups=groups) if rows else None


def _outages(view: View) -> Grid | None:
    rows = []
    for o in view.summary.get("outages") or []:
        rows.append(
            [
                str(o.get("sensor", "")),
                f"{number(o.get('start_s'), 5)} … {number(o.get('end_s'), 5)} s",
                metres(_float(o.get("horizontal_end_m"))),
                metres(_float(o.get("horizontal_max_m"))),
                number(o.get("percent_of_distance"), 2),
                metres(_float(o.get("sigma_end_m"))),
                f"{number(o.get('heading_end_deg'), 2)} deg" if o.get("heading_end_deg") is not None else number(None),
                number(o.get("nees_half_end"), 2),
                metres(_float(o.get("smoother_horizontal_max_m"))),
            ]
        )
    head = [
        "withheld",
        "when",
        "error at the end",
        "largest",
        "% of distance",
        "1 sigma at the end",
        "heading at the end",
        "NEES/2 at the end",
        "smoothed, largest",
    ]
    return Grid(head, rows, "Outages of the study.") if rows else None


def _float(value: Any) -> float | None:
    return None if value is None else float(value)


def assumed(view: View) -> Section | None:
    sentences = list(dict.fromkeys([*view.result.notes, *view.result.navigation.notes]))
    settings = _settings(view.result.study)
    if not sentences and not settings:
        return None
    shown = [
        _titled(grid, "[noise]: 1 sigma of the sensors, where a table does not say.")
        for n, grid in settings
        if n == "noise"
    ]
    folded = [(f"Settings of [{name}]", grid) for name, grid in settings if name != "noise"]
    lead = "What was taken for granted, converted, left out or found on the way." if sentences else ""
    return Section("assumed", "What was assumed", lead, grids=shown, sentences=sentences, folded=folded)


def _titled(grid: Grid, caption: str) -> Grid:
    return Grid(grid.head, grid.rows, caption, grid.left)


def _settings(study: Any) -> list[tuple[str, Grid]]:
    """Every section of the study as run: key, value, unit, whether it was typed or is a default, and its meaning."""
    fields = getattr(type(study), "model_fields", None)
    names = (
        list(fields)
        if fields
        else [k for k in vars(study) if not k.startswith("_")]
        if hasattr(study, "__dict__")
        else []
    )
    grids = []
    for name in names:
        part = getattr(study, name, None)
        if part is None or name == "study":
            continue
        for i, one in enumerate(part if isinstance(part, list | tuple) else [part], 1):
            rows = list(_keys(one))
            if rows:
                title = name if one is part else f"{name}, {i}"
                grids.append((title, Grid(["key", "value", "unit", "", "meaning"], rows, left=5)))
    return grids


def _keys(part: Any) -> list[list[str]]:
    fields = getattr(type(part), "model_fields", None)
    typed = getattr(part, "model_fields_set", None)
    if fields is None and not hasattr(part, "__dict__"):
        return []
    rows = []
    for name in fields or vars(part):
        value = getattr(part, name, None)
        if value is None or hasattr(type(value), "model_fields"):
            continue
        about = fields[name] if fields else None
        more = about.json_schema_extra if about is not None and isinstance(about.json_schema_extra, Mapping) else {}
        rows.append(
            [
                name,
                _value(value),
                str(more.get("unit", "")),
                "" if typed is None else ("given" if name in typed else "default"),
                (about.description or "") if about is not None else "",
            ]
        )
    return rows


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return str(value)


def _clock(time: float) -> str:
    return f"{time:.2f}".rstrip("0").rstrip(".").replace("-", "−")


def made(view: View) -> Section | None:
    by = view.result.made_by
    rows = [
        ["schuler", str(by.get("version", ""))],
        ["seed", str(by.get("seed")) if by.get("seed") is not None else "none: nothing random"],
        ["study file, SHA-256", str(by.get("study_sha256") or "")],
        ["start", view.started],
        ["duration", seconds(view.span[1] - view.span[0])],
        ["rows of the track", f"{len(view.filter.time)}"],
    ]
    inputs = []
    for name, table in view.result.tables.items():
        if not len(table):
            continue
        rate, covers = math.nan, ""
        if "time" in table and len(table) > 1:
            step = float(np.median(np.diff(table.time)))
            rate = 1.0 / step if step > 0 else math.nan
            covers = f"{_clock(table.time[0])} … {_clock(table.time[-1])} s"
        inputs.append(
            [
                name,
                f"{len(table)}",
                f"{rate:.4g} Hz" if rate >= 0.1 else f"every {seconds(1 / rate)}",
                covers,
                str(table.source),
            ]
        )
    grids = [Grid(["made by", ""], rows, left=2)]
    if inputs:
        grids.append(Grid(["input", "rows", "rate", "time", "from"], inputs, "What the filter was given."))
    return Section("made", "How it was made", grids=grids)


# Methods by name: what a paper that uses this page's figures should name.
_SOURCES = {
    "schuler": (
        "Consider update: S. F. Schmidt, Application of state-space methods to navigation problems, "
        "Advances in Control Systems 3, 1966.",
    ),
    "paper": (
        "Filter: E. Alizadeh, H. Nourmohammadi, M. T. Sabet, M. Zarrini Larimi, Design and implementation of "
        "AHRS/GPS/DR navigation algorithm applied to long-range AUVs with high underwater durability, 2017.",
    ),
}
_SMOOTHER = (
    "Smoother: H. E. Rauch, F. Tung, C. T. Striebel, Maximum likelihood estimates of linear dynamic systems, "
    "AIAA Journal 3, 1965."
)
_CONSISTENCY = (
    "NEES and NIS: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and "
    "Navigation, 2001."
)


def cite(view: View) -> Section | None:
    by = view.result.made_by
    version = str(by.get("version", ""))
    sha = str(by.get("study_sha256") or "")[:12]
    note = ", ".join(
        p for p in (f"study {sha}" if sha else "", f"seed {by['seed']}" if by.get("seed") is not None else "") if p
    )
    entry = (
        "@software{schuler,\n"
        "  title   = {Schuler: design, run and judge inertial navigation},\n"
        "  author  = {{The Schuler authors}},\n"
        f"  version = {{{version}}},\n"
        f"  note    = {{{note}}},\n"
        "}"
    )
    method = "paper" if view.method.startswith("paper") else view.method
    sentences = [*_SOURCES.get(method, ())]
    if view.smoother is not None:
        sentences.append(_SMOOTHER)
    sentences.append(_CONSISTENCY)
    lead = "Version, study and seed give the same figures again."
    return Section("cite", "How to cite", lead, sentences=sentences, code=entry)
