"""Rows of a positions table: which part of a recording is what, checked and in SI."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.truth.turntable import spin_axis

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stretch:
    """One row. kind "still" | "spin" | "turn"; start, end s; u (3,) axis of the table in instrument axes, up, or None.

    azimuth rad; rate rad/s; axis (3,) and angle rad of a "turn" in instrument axes.
    """

    position: str
    kind: str
    start: float
    end: float
    u: Array
    azimuth: float = 0.0
    rate: float = 0.0
    axis: Array | None = None
    angle: float = 0.0
    row: int = 0

    @property
    def name(self) -> str:
        return f"{self.kind} of position {self.position} ({self.start:.1f} to {self.end:.1f} s)"


_NAMED = {f"{sign}{a}": (1.0 if sign != "-" else -1.0) * np.eye(3)[i] for i, a in enumerate("xyz") for sign in "+-"}
_NAMED |= {a: np.eye(3)[i] for i, a in enumerate("xyz")}


def stretches_of(table: Table, plan: str) -> list[Stretch]:
    """All rows of a positions table, or InputError with a sentence for every faulty one.

    plan "turntable" needs gamma, beta and rate; "multiposition" takes still rows, with gamma and beta where the
    direction of "up" is known, and turn rows with axis ("x", "-y" ...) and angle.
    """
    faults: list[str] = []
    out: list[Stretch] = []
    who = table.source.rsplit("/", 1)[-1] or "positions"
    needed = ["kind", "start", "end"] + (["gamma", "beta"] if plan == "turntable" else [])
    missing = [c for c in needed if c not in table]
    if missing:
        units = {"start": "[s]", "end": "[s]", "gamma": "[deg]", "beta": "[deg]"}
        names = ", ".join(c + units.get(c, "") for c in missing)
        raise InputError(f"{who}: column {names} is missing; a {plan} plan needs it")

    def number(column: str, row: int, default: float = np.nan) -> float:
        return float(table[column][row]) if column in table else default

    for row in range(len(table)):
        kind = str(table["kind"][row]).strip().lower()
        position = str(table["position"][row]).strip() if "position" in table else str(row + 1)
        start, end = number("start", row), number("end", row)
        place = f"{who} row {row + 1} (position {position})"
        allowed = ("still", "spin") if plan == "turntable" else ("still", "turn")
        if kind not in allowed:
            faults.append(f'{place}: kind "{kind}" is not one of {", ".join(allowed)}')
            continue
        if not (np.isfinite(start) and np.isfinite(end) and end > start):
            faults.append(f"{place}: end[s] {end:g} must be later than start[s] {start:g}")
            continue
        gamma, beta = number("gamma", row), number("beta", row)
        known = bool(np.isfinite(gamma) and np.isfinite(beta))
        if plan == "turntable" and not known:
            faults.append(f"{place}: gamma[deg] and beta[deg] must be numbers")
            continue
        u = spin_axis(gamma, beta) if known else np.full(3, np.nan)
        azimuth, rate = number("azimuth", row, 0.0), number("rate", row, 0.0)
        azimuth = azimuth if np.isfinite(azimuth) else 0.0
        if kind == "spin" and not (np.isfinite(rate) and rate != 0.0):
            faults.append(f"{place}: a spin needs rate[deg/s], not zero; negative is the other way round")
            continue
        axis, angle = None, number("angle", row, 0.0)
        if kind == "turn":
            word = str(table["axis"][row]).strip().lower() if "axis" in table else ""
            axis = _NAMED.get(word)
            if axis is None or not np.isfinite(angle) or angle == 0.0:
                faults.append(
                    f'{place}: a turn needs axis ("x", "y" or "z", with "-" before it for the other sense) and '
                    f"angle[deg]"
                )
                continue
        out.append(Stretch(position, kind, start, end, u, azimuth, rate if kind == "spin" else 0.0, axis, angle, row))
    by_time = sorted(out, key=lambda s: s.start)
    for a, b in zip(by_time[:-1], by_time[1:], strict=True):
        if b.start < a.end - 1e-9:
            faults.append(f"{who}: the {a.name} and the {b.name} overlap")
    settings: dict[str, Array] = {}
    if plan == "turntable":
        for s in out:
            if np.max(np.abs(settings.setdefault(s.position, s.u) - s.u)) > 1e-6:
                faults.append(f"{who} row {s.row + 1}: position {s.position} has another gamma or beta than before")
    if faults:
        raise InputError("\n".join(faults))
    return out


def usual_step(time: Array) -> float:
    """s between rows: the median over the first hundred thousand."""
    return float(np.median(np.diff(time[:100_000])))


def rows_inside(middle: Array, stretch: Stretch, dt: float) -> tuple[int, int]:
    """First and one past the last row whose whole interval lies in the stretch; middle (n,): middles of intervals."""
    first = np.searchsorted(middle, stretch.start + 0.499 * dt)
    last = np.searchsorted(middle, stretch.end - 0.499 * dt, side="right")
    return int(first), int(max(last, first))
