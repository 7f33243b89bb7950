"""The drift of outages that were slid over the recording: how the errors are distributed, and where they were large."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.judging.side_by_side import number_of
from schuler.report.figures import BOUND, SERIES, Panel, Pool, label, shade, stack
from schuler.report.parts import Figure, Grid, Section, metres, number, plural, seconds
from schuler.report.view import View

Array = NDArray[np.float64]
_TRACKS = (
    ("horizontal_end_m", "filter, at the end", "solid"),
    ("smoother_horizontal_max_m", "smoothed, largest", "dash"),
)


def sweep(view: View) -> Section | None:
    """Distribution, place in time, and table; the figures need the windows one by one ("entries")."""
    told = [s for s in view.summary.get("sweep") or [] if s.get("windows")]
    if not told:
        return None
    grid = _grid(told)
    shown = [f for f in (_distribution(view.pool, told), _over_time(view, told)) if f is not None]
    count = sum(int(s["windows"]) for s in told)
    sensor = str(getattr(getattr(view.result.study, "sweep", None), "sensor", "") or "a sensor")
    lead = (
        f"{plural(count, 'outage')} of {sensor}, slid over the recording: what the rest can do without it. The "
        "filter's error is that of the last row withheld. The smoothed track knows the rows after the outage and is "
        "worst in its middle."
    )
    return Section("sweep", "Outages slid over the recording", lead, shown, [grid])


def _length(told: dict[str, Any]) -> str:
    """'15 s', '1.5 h'."""
    length = number_of(told.get("length_s"))
    return f"{length:g} s" if length is not None and length < 1000.0 else seconds(length)


def _values(entries: list[dict[str, Any]], key: str) -> Array:
    known = (number_of(e.get(key)) for e in entries)
    return np.array([v for v in known if v is not None])


def _distribution(pool: Pool, told: list[dict[str, Any]]) -> Figure | None:
    """Share of the windows with an error up to x."""
    from schuler.report.sheet import chart  # which knows the chapters

    traces = []
    for i, s in enumerate(told):
        for key, word, dash in _TRACKS:
            error = np.sort(np.maximum(_values(s.get("entries") or [], key), 1e-3))
            if not len(error):
                continue
            share = 100.0 * np.arange(1, len(error) + 1) / len(error)
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": pool.add(np.append(error[0], error), exact=True),
                    "y": pool.add(np.append(0.0, share), exact=True),
                    "name": label(f"{_length(s)}: {word}"),
                    "line": {"shape": "hv", "width": 1.6, "color": SERIES[i % len(SERIES)], "dash": dash},
                    "hovertemplate": "%{y:.0f} % within %{x:.3~g} m",
                }
            )
    if not traces:
        return None
    ticks = [v * 10.0**k for k in range(-3, 6) for v in (1, 2, 5)]
    x = {"title": "horizontal error, m", "type": "log", "tickvals": ticks, "ticktext": [f"{t:g}" for t in ticks]}
    y = {"title": "share of the outages, %", "range": [0, 101]}
    thin = {"width": 1, "dash": "dot", "color": BOUND}
    shapes = [{"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": v, "y1": v, "line": thin} for v in (50, 95)]
    caption = "The share of outages within an error; a long tail to the right is what surprises. Dotted: 50 and 95 %."
    return chart("fig-sweep", "Distribution of the drift", traces, x, y, caption=caption, shapes=shapes)


def _over_time(view: View, told: list[dict[str, Any]]) -> Figure | None:
    panels = []
    for i, s in enumerate(told):
        entries = [e for e in s.get("entries") or [] if number_of(e.get("start_s")) is not None]
        every = np.concatenate([_values(entries, key) for key, _, _ in _TRACKS])
        wide = len(every) > 0 and float(every.max()) > 30.0 * max(float(every.min()), 1e-3)
        panel = Panel(f"{_length(s)},\nerror, m", log=wide, height=120)
        for key, word, _ in _TRACKS:
            rows = [(e["end_s"], number_of(e.get(key))) for e in entries]
            rows = [(float(t), v) for t, v in rows if v is not None]
            if rows:
                color = SERIES[i % len(SERIES)]
                time, value = (np.array(c, dtype=float) for c in zip(*rows, strict=True))
                panel.traces.append(
                    {
                        "type": "scatter",
                        "mode": "markers",
                        "x": view.pool.add(view.axis.of(time)),
                        "y": view.pool.add(np.maximum(value, 1e-3), exact=True),
                        "name": word,
                        "marker": {
                            "color": color if key == "horizontal_end_m" else shade(color, 0.45),
                            "size": 6,
                            "symbol": "circle" if key == "horizontal_end_m" else "diamond",
                        },
                        "hovertemplate": "%{y:.3~g} m",
                    }
                )
        panels.append(panel)
    caption = "Each outage at its end: where in the recording it goes well and where it does not."
    return stack("fig-sweep-time", "Along the recording", panels, view.axis, caption)


def _grid(told: list[dict[str, Any]]) -> Grid:
    rows = []
    for s in told:
        end, smooth, part, sigma = (
            s.get(k) or {} for k in ("filter_end_m", "smoother_max_m", "filter_end_percent", "sigma_end_m")
        )
        rows.append(
            [
                _length(s),
                f"{int(s['windows'])}",
                *(metres(number_of(end.get(p))) for p in ("p50", "p95")),
                *(number(number_of(part.get(p)), 2) for p in ("p50", "p95")),
                metres(number_of(sigma.get("p50"))),
                number(number_of(s.get("nees_half")), 2),
                *(metres(number_of(smooth.get(p))) for p in ("p50", "p95")),
            ]
        )
    head = ["outage", "windows", "error at the end, median", "95 %", "% of distance, median", "95 %", "1 sigma, median",
            "NEES/2", "largest error, median", "95 %"]  # fmt: skip
    groups = (("", 2), ("filter", 6), ("smoothed", 2))
    return Grid(head, rows, "NEES/2: squared error over the sigma claimed, 1 is expected.", groups=groups)
