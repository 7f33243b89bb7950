"""What a page is made of: sections of words, tiles, tables and figures. Plain data; the templates turn it into HTML.

Nothing here is HTML: every string is escaped by the template that prints it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

NONE = "–"  # what a figure that is not known looks like


@dataclass(frozen=True)
class Tile:
    """One headline figure: what it is, the number with its unit, and a line that puts it in its place."""

    label: str
    value: str
    unit: str = ""
    note: str = ""
    tone: str = ""  # "" | "good" | "warn"


@dataclass(frozen=True)
class Grid:
    """A table of text: the first column is the row's name, the others are figures set to the right."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    left: int = 1  # columns set to the left
    tones: Sequence[str] = ()  # one a row: "" | "warn"
    groups: Sequence[tuple[str, int]] = ()  # titles above the head: words, columns they span
    marked: Sequence[tuple[int, int]] = ()  # cells set off: row, column


@dataclass(frozen=True)
class Figure:
    """A plotly figure as plain JSON: `spec` has "data" and "layout"; arrays are references into the page's pool.

    follows_time : its x axis is the page's time axis, and zooms with the others.
    """

    id: str
    title: str
    spec: dict[str, Any]
    height: int
    caption: str = ""
    follows_time: bool = False
    half: bool = False  # may stand beside another one


@dataclass(frozen=True)
class Section:
    """A chapter of the page. `folded` tables and lists are shown closed, for the curious."""

    id: str
    title: str
    lead: str = ""
    figures: Sequence[Figure] = ()
    grids: Sequence[Grid] = ()
    sentences: Sequence[str] = ()
    folded: Sequence[tuple[str, Grid]] = ()
    code: str = ""


@dataclass(frozen=True)
class Opening:
    """The head of the page."""

    title: str
    subtitle: str
    verdict: str
    tone: str = ""  # "" | "good" | "warn"
    tiles: Sequence[Tile] = field(default_factory=tuple)


def number(value: Any, digits: int = 3) -> str:
    """A figure with about `digits` significant digits, no exponent between 1e-3 and 1e6; an en dash where not known."""
    if value is None or isinstance(value, str) or not math.isfinite(float(value)):
        return NONE
    value = float(value)
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -3 or size >= 6:
        return f"{value:.{digits - 1}e}".replace("-", "−")
    decimals = max(digits - 1 - size, 0)
    text = f"{value:.{decimals}f}"
    return text.replace("-", "−")


def metres(value: float | None) -> str:
    """A distance in words: '23 m', '1.24 km'."""
    if value is None or not math.isfinite(value):
        return NONE
    if abs(value) >= 9999.5:
        return f"{value / 1000:.1f} km".replace("-", "−")
    if abs(value) >= 999.5:
        return f"{value / 1000:.2f} km".replace("-", "−")
    return f"{number(value, 2 if abs(value) < 100 else 3)} m"


def seconds(value: float | None) -> str:
    """A duration in words: '520 s', '48 min', '1.6 h', '3.3 days'."""
    if value is None or not math.isfinite(value):
        return NONE
    for limit, size, unit in ((1200.0, 1.0, "s"), (7200.0, 60.0, "min"), (172800.0, 3600.0, "h")):
        if value < limit:
            return f"{number(value / size, 3 if unit == 's' else 2)} {unit}"
    return f"{number(value / 86400.0, 2)} days"


def plural(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"
