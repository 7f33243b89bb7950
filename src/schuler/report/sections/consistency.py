"""Is the filter honest? Innovations inside their bounds, NIS and NEES against what chi-square expects."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Innovations
from schuler.ground.units import DEG
from schuler.judging.consistency import nees
from schuler.judging.distrust import distrusted
from schuler.judging.errors import ErrorSeries
from schuler.report import decimate, figures
from schuler.report.figures import FILTER, REJECTED, SERIES, Panel
from schuler.report.parts import Grid, Section, number, plural, seconds
from schuler.report.view import View

Array = NDArray[np.float64]
# Two-sided 99 % of chi-square per degree of freedom, for the dashed lines of one moment.
_ONE_MOMENT = {1: (3.9e-5, 7.88), 2: (0.0050, 5.30), 3: (0.0239, 4.28)}
_NIS = (
    "NIS: squared innovation in units of its stated sigma, per degree of freedom. The bounds are those of the mean of "
    "so many independent innovations."
)
_DOUBT = figures.shade(REJECTED, 0.16)
_TOLD, _SHADED = 30, 200  # stretches in the table, in the figure
_REACH = 5.0  # sigmas shown of an innovation
_NAMES = {"gnss_position": "GNSS position", "gnss_velocity": "GNSS velocity", "dvl": "DVL", "speed": "speed log"}


def title_of(kind: str) -> str:
    return _NAMES.get(kind, kind.replace("_", " ").replace("gnss", "GNSS").replace("dvl", "DVL"))


def doubts(view: View) -> list[dict[str, Any]]:
    """Stretches in which a sensor was distrusted, of summary.json or found anew."""
    told = view.summary.get("distrusted")
    return list(told) if told is not None else distrusted(view.innovations)


def distrust(view: View) -> Section | None:
    """When which sensor was distrusted, in words."""
    found = doubts(view)
    if not found:
        return None
    told: dict[str, list[dict[str, Any]]] = {}
    for entry in found:
        told.setdefault(str(entry["sensor"]), []).append(entry)
    sentences = []
    for sensor, entries in told.items():
        long = sum(float(e["end_s"]) - float(e["start_s"]) for e in entries)
        count = sum(int(e["rows"]) for e in entries)
        when = f"{plural(len(entries), 'stretch', 'stretches')}, {seconds(long)} in all"
        if len(entries) == 1:
            when = f"from {_clock(entries[0]['start_s'])} to {_clock(entries[0]['end_s'])} s"
        sentences.append(f"{title_of(sensor)}: {when}; {plural(count, 'measurement')} left out or counted little.")
    cells = [
        [
            title_of(str(e["sensor"])),
            f"{_clock(e['start_s'])} … {_clock(e['end_s'])} s",
            seconds(float(e["end_s"]) - float(e["start_s"])),
            f"{_whole(e['rows'])} of {_whole(e['of'])}" if e.get("of") is not None else _whole(e["rows"]),
        ]
        for e in found[:_TOLD]
    ]
    more = f" The first {_TOLD} of {len(found)}." if len(found) > _TOLD else ""
    grid = Grid(["sensor", "when", "for", "distrusted"], cells, f"Shaded red among the innovations.{more}", left=2)
    lead = (
        "Measurements that contradicted everything else, several in a row, so that the filter did without them. The "
        "track there rests on the other sensors."
    )
    return Section("distrust", "When a sensor was distrusted", lead, grids=[grid], sentences=sentences)


def _clock(time: Any) -> str:
    return f"{float(time):.1f}".removesuffix(".0").replace("-", "−")


def innovations(view: View) -> Section | None:
    """All kinds in units of their own sigma, so that a surfacing and a routine fix are read on one scale."""
    found = doubts(view)
    panels = [_panel(view, kind, i) for kind in view.innovations for i in range(len(kind.components))]
    for panel, kind in zip(panels, (k for k in view.innovations for _ in k.components), strict=True):
        panel.shaded = [
            (float(e["start_s"]), float(e["end_s"]), _DOUBT) for e in found[:_SHADED] if e["sensor"] == kind.kind
        ]
    figure = figures.stack(
        "fig-innovations",
        "Innovations",
        panels,
        view.axis,
        "Measured minus predicted, before the measurement is used, in units of the sigma of both together. Band: ± 3. "
        f"Crosses: left out by the gate. What reaches beyond ± {_REACH:g} is drawn at the edge."
        + (" Red: the sensor was distrusted." if found else ""),
    )
    return Section("innovations", "Innovations", figures=[figure]) if figure else None


def _panel(view: View, kind: Innovations, i: int) -> Panel:
    scale, unit = _shown(kind.unit)
    name = title_of(kind.kind) + (f"\n{kind.components[i]}" if len(kind.components) > 1 else "")
    panel = Panel(f"{name}, σ", zero=True, height=92, span=(-_REACH - 0.4, _REACH + 0.4))
    with np.errstate(all="ignore"):
        ratio = kind.value[:, i] / kind.std[:, i]
    known = np.isfinite(ratio)
    if not known.any():
        return panel
    used = np.asarray(kind.used, bool)
    first, last = view.axis.span
    panel.traces.append(
        {
            "band": {"x": [round(first, 4), round(last, 4)], "mid": None, "std": [1.0, 1.0], "k": 3.0},
            "name": "± 3 σ",
            "line": {"width": 0},
            "fillcolor": figures.shade(FILTER, 0.10),
        }
    )
    for mask, word, color, symbol, size in (
        (used, "used", FILTER, "circle", 2.8),
        (~used, "left out", REJECTED, "x", 6.0),
    ):
        rows = np.flatnonzero(mask & known)
        if not len(rows):
            continue
        panel.traces.append(
            figures.marks(
                view.pool,
                view.axis,
                kind.time[rows],
                np.clip(ratio[rows], -_REACH, _REACH),
                word,
                color,
                symbol,
                size,
                fmt=f"%{{customdata:.3~g}} {figures.label(unit)}, %{{y:.1f}} σ",
                points=800,
                told=kind.value[rows, i] * scale,
            )
        )
    return panel


def honesty(view: View) -> Section | None:
    grid = _nis_grid(view)
    panels = [p for p in (_nees_panel(view), _heading_panel(view), _nis_panel(view)) if p.traces]
    figure = figures.stack(
        "fig-consistency",
        "NEES and NIS",
        panels,
        view.axis,
        "Squared errors in units of the stated sigma, per degree of freedom: 1 is expected. Dashed: 99 % of an honest "
        "filter in one moment. NIS: running mean of each kind of measurement.",
    )
    if figure is None and grid is None:
        return None
    lead = ""
    c = view.summary.get("consistency") or {}
    parts = [
        f"{name} {number(c[key], 3)}"
        for key, name in (("nees_position", "position"), ("nees_velocity", "velocity"), ("nees_attitude", "attitude"))
        if c.get(key) is not None
    ]
    if parts:
        lead = "Mean NEES per degree of freedom: " + ", ".join(parts) + " (1 expected)."
    if c.get("inside_3_sigma") is not None:
        lead += f" {number(100 * c['inside_3_sigma'], 4)} % of the errors lie inside 3 sigma (99.7 % expected)."
    return Section(
        "consistency", "Is the filter honest?", lead.strip(), [figure] if figure else [], [grid] if grid else []
    )


def _ratio_panel(label: str, dof: int) -> Panel:
    low, high = _ONE_MOMENT[dof]
    return Panel(label, log=True, height=140, lines=((high, "99 %"), (low, "")), span=(-3.0, 2.0))


def _nees_panel(view: View) -> Panel:
    panel = _ratio_panel("position\nNEES", 2)
    for name, color, track in view.tracks:
        if track.errors is not None:
            e = _some(track.errors)
            _add(view, panel, e.time, nees(e.position[:, :2], e.cov_pos[:, :2, :2]), name, color)
    return panel


def _heading_panel(view: View) -> Panel:
    panel = _ratio_panel("heading\nNEES", 1)
    for name, color, track in view.tracks:
        if track.errors is not None:
            e = _some(track.errors)
            _add(view, panel, e.time, nees(e.rpy[:, 2:], e.cov_rpy[:, 2:, 2:]), name, color)
    return panel


def _some(series: ErrorSeries) -> ErrorSeries:
    """Each k-th moment of a long run: a matrix is solved for each."""
    step = max(len(series) // 30000, 1)
    return ErrorSeries(*(getattr(series, f)[::step] for f in series.__dataclass_fields__))


def _add(view: View, panel: Panel, time: Array, value: Array, name: str, color: str) -> None:
    if np.isfinite(value).any():
        time, value = figures.gapped(time, value)
        panel.traces.append(_positive(view, time, value, name, color))


def _positive(view: View, time: Array, value: Array, name: str, color: str) -> dict[str, Any]:
    """A line for a logarithmic axis: decimated and stored as it looks there."""
    with np.errstate(all="ignore"):
        log = np.log10(np.maximum(value, 1e-6))
    rows = decimate.keep([log])
    return {
        "type": "scatter",
        "mode": "lines",
        "x": view.pool.add(view.axis.of(time[rows])),
        "y": view.pool.add(10.0 ** log[rows], exact=True),
        "name": name,
        "line": {"color": color, "width": 1.2},
        "hovertemplate": "%{y:.2f}",
    }


def _nis_panel(view: View) -> Panel:
    panel = Panel("NIS,\nrunning mean", log=True, height=140, lines=((1.0, ""),), span=(-1.2, 1.2))
    for i, kind in enumerate(k for k in view.innovations if len(k.time) >= 20):
        used = np.asarray(kind.used, bool) & np.isfinite(kind.nis)
        count = int(used.sum())
        if count < 20:
            continue
        window = max(10, count // 40)
        mean = np.convolve(kind.nis[used] / kind.value.shape[1], np.full(window, 1.0 / window), "valid")
        middle = kind.time[used][window // 2 : window // 2 + len(mean)]
        time, value = figures.gapped(middle, mean)
        panel.traces.append(_positive(view, time, value, title_of(kind.kind), SERIES[(i + 2) % len(SERIES)]))
    return panel


def _nis_grid(view: View) -> Grid | None:
    nis = (view.summary.get("consistency") or {}).get("nis") or {}
    kinds = {k.kind: k for k in view.innovations}
    rows, tones = [], []
    for name in [*nis, *(k for k in kinds if k not in nis)]:
        s, kind = nis.get(name) or {}, kinds.get(name)
        mean, low, high = s.get("mean"), s.get("low"), s.get("high")
        out = s.get("left_out", int((~np.asarray(kind.used, bool)).sum()) if kind is not None else None)
        word, tone = "", ""
        if mean is not None and low is not None and high is not None:
            word = "inside" if low <= mean <= high else ("sigma too small" if mean > high else "sigma too large")
            tone = "" if word == "inside" else "warn"
        count = s.get("n", len(kind.time) if kind is not None else None)
        bounds = f"{number(low)} … {number(high)}" if low is not None and high is not None else number(None)
        rows.append([title_of(name), _whole(count), _whole(out), _sizes(kind), number(mean), bounds, word])
        tones.append(tone)
    if not rows:
        return None
    head = ["measurement", "used", "left out", "rms (typical sigma)", "mean NIS", "99 % bounds", "verdict"]
    return Grid(head, rows, _NIS, tones=tones)


def _shown(unit: str) -> tuple[float, str]:
    """(factor from SI, unit as printed)."""
    return (1.0 / DEG, "deg") if unit == "rad" else (1.0, unit.replace("^2", "²"))


def _sizes(kind: Innovations | None) -> str:
    """Rms of the innovations used and their median sigma, over all components."""
    if kind is None or not np.asarray(kind.used, bool).any():
        return number(None)
    used = np.asarray(kind.used, bool)
    scale, unit = _shown(kind.unit)
    value, std = kind.value[used] * scale, kind.std[used] * scale
    if not (np.isfinite(value).any() and np.isfinite(std).any()):
        return number(None)
    return f"{number(np.sqrt(np.nanmean(value**2)), 2)} ({number(np.nanmedian(std), 2)}) {unit}".rstrip()


def _whole(value: Any) -> str:
    return f"{int(value):,}".replace(",", " ") if value is not None else number(None)
