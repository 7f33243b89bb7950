"""The ledger: every published figure of a source, ours beside it, a verdict and its reason.

A source is a module with `TITLE: str` and `rows(progress=None) -> list[Row]`; a line in `SOURCES` makes it known.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from schuler.ground.errors import StudyError

if TYPE_CHECKING:
    from rich.table import Table

Verdict = Literal["reproduced", "corrected", "not reproducible"]
Progress = Callable[[str], None]

REPRODUCED: Verdict = "reproduced"
CORRECTED: Verdict = "corrected"
NOT_REPRODUCIBLE: Verdict = "not reproducible"

SOURCES: dict[str, str] = {
    "auv": "schuler.published.auv",
    "platform": "schuler.published.platform",
    "sins": "schuler.published.sins",
}


@dataclass(frozen=True)
class Row:
    """One figure. published and ours are in `unit`; None where there is no number. `where` is the place in the source.

    `where` beginning with "recomputation" marks a figure that the source does not print: it comes from an independent
    recomputation of the source, kept here as a second opinion.
    """

    source: str
    where: str
    quantity: str
    unit: str
    published: float | None
    ours: float | None
    verdict: Verdict
    reason: str

    @property
    def relative_difference(self) -> float | None:
        """(ours - published) / |published|; None where one of them is missing or the published one is zero."""
        if self.published is None or self.ours is None or self.published == 0.0:
            return None
        return (self.ours - self.published) / abs(self.published)

    def as_dict(self) -> dict[str, Any]:
        """The row as the command's JSON has it."""
        return {
            "source": self.source,
            "where": self.where,
            "quantity": self.quantity,
            "unit": self.unit,
            "published": self.published,
            "ours": self.ours,
            "relative_difference": self.relative_difference,
            "verdict": self.verdict,
            "reason": self.reason,
        }


def rounding(printed: str) -> tuple[float, float]:
    """Value and half a unit of the last printed digit of a decimal number, such as "0.0061" or "1.11544220e-5"."""
    digits, _, exponent = printed.lower().partition("e")
    places = len(digits.partition(".")[2])
    return float(printed), 0.5 * 10.0 ** (int(exponent or 0) - places)


def judge(
    source: str,
    where: str,
    quantity: str,
    unit: str,
    printed: str,
    ours: float,
    reason: str,
    *,
    within: float | None = None,
    otherwise: Verdict = CORRECTED,
    because: str = "",
) -> Row:
    """A row whose verdict follows from the numbers: reproduced where ours differs by at most `within`.

    printed : the figure as the source prints it; its last digit gives `within` where that is None.
    otherwise, because : verdict and reason if the difference is larger (`because` replaces `reason`).
    """
    published, half = rounding(printed)
    limit = half if within is None else within
    if abs(ours - published) <= limit * (1.0 + 1e-9):
        return Row(source, where, quantity, unit, published, ours, REPRODUCED, reason)
    return Row(source, where, quantity, unit, published, ours, otherwise, because or reason)


def ledger(source: str | None = None, progress: Progress | None = None) -> list[Row]:
    """All rows of one source, or of every source in turn. Everything of ours is computed here and now.

    progress : called with a short sentence before each longer part. Raises StudyError for a source that is not known.
    """
    if source is not None and source not in SOURCES:
        raise StudyError(f'There is no source "{source}"; type one of: {", ".join(SOURCES)}.')
    names = list(SOURCES) if source is None else [source]
    return [row for name in names for row in import_module(SOURCES[name]).rows(progress=progress)]


def title(source: str) -> str:
    """What a source is, in a line."""
    return str(import_module(SOURCES[source]).TITLE)


def to_json(rows: Iterable[Row]) -> str:
    """The list of rows as JSON text, names as in the contract."""
    return json.dumps([row.as_dict() for row in rows], indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def render(rows: Iterable[Row]) -> Table:
    """The rows as a table for a terminal, grouped by place; a reason stands under its figure, repeated ones once."""
    from rich.table import Table
    from rich.text import Text

    rows = list(rows)
    colours = {REPRODUCED: "green", CORRECTED: "yellow", NOT_REPRODUCIBLE: "red"}
    counts = ", ".join(f"{sum(r.verdict == v for r in rows)} {v}" for v in colours)
    table = Table(title=f"{len(rows)} figures: {counts}", title_justify="left", pad_edge=False)
    table.add_column("quantity", ratio=1, overflow="fold")
    for name in ("published", "ours", "diff %"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    place, reason = ("", ""), ""
    for row in rows:
        if (row.source, row.where) != place:
            table.add_section()
            place, reason = (row.source, row.where), ""
            table.add_row(Text(f"{row.source}: {row.where}", style="bold"))
        text = Text(f"{row.quantity}, {row.unit}" if row.unit not in ("", "1") else row.quantity)
        if row.reason != reason:
            text.append(f"\n  {row.reason}", style="dim")
            reason = row.reason
        verdict = Text(row.verdict, style=colours[row.verdict])
        table.add_row(text, _number(row.published), _number(row.ours), _percent(row.relative_difference), verdict)
    return table


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    size = abs(value)
    return f"{value:.7g}" if size >= 1000.0 else f"{value:.6g}" if size >= 10.0 else f"{value:.4g}"


def _percent(difference: float | None) -> str:
    if difference is None or abs(difference) >= 10.0:
        return ""
    return "0" if abs(difference) < 5e-5 else f"{100.0 * difference:+.2g}"
