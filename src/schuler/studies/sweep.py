"""[sweep]: outages laid over a whole recording, many short ones at a time, to judge an outage by more than one draw."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from schuler.aiding.solution import Navigation
from schuler.ground.tables import Table

BETWEEN_S = 30.0  # fixes between one outage and the next
KEPT = (  # of each window, in "entries"
    "start_s", "end_s", "horizontal_end_m", "percent_of_distance", "sigma_end_m", "nees_half_end",
    "smoother_horizontal_max_m",
)  # fmt: skip
PHASES = 2  # the windows of a length are laid again, shifted by half their period


def windows(first: float, last: float, length: float, settle: float, phase: int) -> list[tuple[float, float]]:
    """(start, end) of the outages of one phase: every length + 30 s from first + settle on, whole ones only."""
    period = length + BETWEEN_S
    start = first + settle + phase * period / PHASES
    found = []
    while start + length <= last + 1e-9:
        found.append((start, start + length))
        start += period
    return found


def sweep(
    tables: dict[str, Table],
    sensor: str,
    lengths: tuple[float, ...],
    settle: float,
    navigate: Callable[[dict[str, Table]], Navigation],
    judge: Callable[[Navigation, Table, float, float], dict[str, Any]],
    progress: Callable[[str], None],
) -> tuple[list[dict[str, Any]], list[str]]:
    """ "sweep" of summary.json, and sentences on what did not fit.

    judge(navigation, withheld rows, start, end) gives an entry of "outages". All windows of one phase are withheld in
    one run; a run of its own for each phase and length.
    """
    table = tables[sensor]
    first, last = float(table.time[0]), float(table.time[-1])
    told, notes = [], []
    for length in lengths:
        entries = []
        for phase in range(PHASES):
            spans = windows(first, last, length, settle, phase)
            spans = [(a, b) for a, b in spans if ((table.time >= a) & (table.time <= b)).any()]
            if not spans:
                continue
            progress(f"outages of {length:g} s")
            gone = np.zeros(len(table), dtype=bool)
            for a, b in spans:
                gone |= (table.time >= a) & (table.time <= b)
            navigation = navigate({**tables, sensor: table.where(~gone)})
            for a, b in spans:
                rows = table.where((table.time >= a) & (table.time <= b))
                entries.append(judge(navigation, rows, a, b))
        if not entries:
            notes.append(f"[sweep] length_s {length:g}: no outage fits after {settle:g} s of settling")
        told.append(
            {
                "length_s": length,
                "windows": len(entries),
                "filter_end_m": quantiles(entries, "horizontal_end_m"),
                "smoother_max_m": quantiles(entries, "smoother_horizontal_max_m"),
                "nees_half": mean(entries, "nees_half_end"),
                "filter_end_percent": quantiles(entries, "percent_of_distance"),
                "sigma_end_m": quantiles(entries, "sigma_end_m"),
                "entries": [{key: entry.get(key) for key in KEPT} for entry in sorted(entries, key=_start)],
            }
        )
    return told, notes


def quantiles(entries: list[dict[str, Any]], key: str) -> dict[str, float | None]:
    """{"p50", "p95"} over the windows that know a figure."""
    known = [e[key] for e in entries if e.get(key) is not None]
    if not known:
        return {"p50": None, "p95": None}
    return {"p50": float(np.percentile(known, 50)), "p95": float(np.percentile(known, 95))}


def _start(entry: dict[str, Any]) -> float:
    return float(entry["start_s"])


def mean(entries: list[dict[str, Any]], key: str) -> float | None:
    """Mean over the windows that know a figure."""
    known = [e[key] for e in entries if e.get(key) is not None]
    return float(np.mean(known)) if known else None
