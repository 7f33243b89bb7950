"""schuler compare: result folders read back, side by side on the terminal and on one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from schuler import __version__
from schuler.ground.errors import InputError
from schuler.judging.side_by_side import Row, Stored, rows
from schuler.studies.run import Progress, silent

PAGE = "compare.html"
WIDTH = 100  # of the terminal's table; results that do not fit go into a further one
_MARK = '<meta name="generator" content="schuler '  # in the head of every page that we write
_TERMINAL = (  # rows for the terminal; the page has all
    "duration", "distance", "horizontal, rms", "horizontal, 95 %", "horizontal, largest", "heading, rms", "roll, rms",
    "pitch, rms", "error at the end", "smoothed: largest error", "miss, median", "NEES", "inside 3 sigma",
    "NIS of gnss",
)  # fmt: skip


@dataclass
class Comparison:
    """Results side by side. results: as read, in the order given; rows: every figure (`judging.side_by_side.Row`)."""

    results: list[Stored]
    rows: list[Row]

    def page(self) -> str:
        """The text of compare.html."""
        from schuler.report.compare import compare_page

        return compare_page(self.results, {"version": __version__, "seed": None, "study_sha256": ""})

    def lines(self, width: int = WIDTH) -> list[str]:
        """Text for a terminal: the main figures, "*" at the best of a row, "-" where a result does not say."""
        return lines(self, width)

    def write(self, out: str | Path | None = None, progress: Progress = silent) -> Path:
        """Writes the page and returns its place: a file, or compare.html in a folder; by default beside the first
        result folder."""
        from schuler.io.writing import atomically

        place = target(out, self.results[0].folder)
        progress("drawing the page")
        text = self.page()
        return atomically(place, lambda stream: stream.write(text.encode()))


def compare_results(folders: Sequence[str | Path] | str | Path, progress: Progress = silent) -> Comparison:
    """Reads result folders, of any kind and version. InputError holds one sentence a folder that is none."""
    from schuler.io.read_results import read_results

    progress("reading results")
    found = read_results([folders] if isinstance(folders, str | Path) else folders)
    return Comparison(found, rows(found))


def target(out: str | Path | None, first: Path) -> Path:
    """Where the page goes; InputError where something else is there already."""
    beside = first.parent if first.name not in ("", "..") else first.resolve().parent
    place = beside / PAGE if out is None else Path(out)
    if out is not None and (place.is_dir() or place.suffix.lower() not in (".html", ".htm")):
        place = place / PAGE
    if place.is_dir() or (place.exists() and not place.is_file()):
        raise InputError(f"{place} exists and is not a file; type another --out")
    if place.is_file():
        try:
            with place.open("rb") as stream:
                ours = _MARK.encode() in stream.read(4096)
        except OSError as error:
            raise InputError(f"{place} cannot be read: {error.strerror}; type another --out") from None
        if not ours:
            raise InputError(f"{place} exists and is not a page of schuler; it is left as it is; type another --out")
    if any(p.exists() and not p.is_dir() for p in place.parents):
        raise InputError(f"{place} cannot be written: a file is in the way; type another --out")
    return place


def lines(comparison: Comparison, width: int = WIDTH) -> list[str]:
    """See `Comparison.lines`."""
    shown = [r for r in comparison.rows if any(word in r.label for word in _TERMINAL)]
    names = [r.label for r in comparison.results]
    first = max((len(f"{r.label}, {r.unit}") for r in shown), default=10)
    wide = [max(10, min(len(name), 28)) for name in names]
    told: list[str] = []
    start = 0
    while start < len(names):
        stop, used = start + 1, first + 2 + wide[start]
        while stop < len(names) and used + 2 + wide[stop] <= width:
            used += 2 + wide[stop]
            stop += 1
        part = range(start, stop)
        if told:
            told.append("")
        told.append(" " * first + "".join(f"  {_short(names[i], wide[i]):>{wide[i]}}" for i in part))
        group = ""
        for row in shown:
            if row.group != group:
                told.append(row.group)
                group = row.group
            name = f"{row.label}, {row.unit}" if row.unit else row.label
            cells = (f"{_cell(row, i):>{wide[i]}}" for i in part)
            told.append((f"{name:<{first}}  " + "  ".join(cells)).rstrip())
        start = stop
    return told


def _short(name: str, width: int) -> str:
    return name if len(name) <= width else "…" + name[-width + 1 :]


def _cell(row: Row, i: int) -> str:
    value = row.values[i]
    if value is None:
        return "- "
    text = f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
    return text + ("*" if i in row.best else " ")
