"""The part of `check` that every table shares: its clock, its missing numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.tables import SCHEMAS
from schuler.ground.times import describe_clock
from schuler.ground.units import to_si
from schuler.io.check_report import CheckReport
from schuler.io.clean import times_of, without_jumps
from schuler.io.guess import guess_time
from schuler.io.headings import Match, unit_text
from schuler.io.sheets import Sheet, counted

Array = NDArray[np.float64]


def clock(sheet: Sheet, found: dict[str, Match], report: CheckReport) -> Array | None:
    """Time in seconds where it can be told; rate, jitter, gaps and faults of the clock into the report."""
    file = report.file
    if not SCHEMAS[report.table].has_time:
        return None
    if "time" not in found:
        report.add(
            "time_unit",
            "there is no time column, so rate and gaps are not known",
            "set rate_hz in [input] of the study, or add a column time[s]",
        )
        return None
    raw = sheet.columns[found["time"].index]
    heading = found["time"].heading or f"column {found['time'].index + 1}"
    if raw.dtype.kind == "U":
        time, sentences = times_of(raw, found["time"], report.table, sheet.path.name)
        report.units += [s.partition(": ")[2] for s in sentences]
    else:
        unit = found["time"].unit
        guess = guess_time(raw, report.table)
        if not unit:
            if not guess.sure:
                report.add(
                    "time_unit", f"{heading} has no unit, and {guess.reason}", "write time[s] or time[ms] as heading"
                )
                return None
            unit = guess.unit
            report.units.append(f"{heading}: taken as {unit}, because {guess.reason}")
            if unit != "s":
                report.add(
                    "time_unit",
                    f"{heading} has no unit and is probably in {unit}: {guess.reason}",
                    f"write time[{unit}] as heading, or: schuler convert {file} {beside(file)}",
                )
        elif report.table == "imu" and unit == "s" and guess.sure and guess.unit != "s":
            report.add(
                "time_unit",
                f"{heading} is said to be in s but is probably in {guess.unit}: {guess.reason}",
                f"write time[{guess.unit}] as heading",
            )
            unit = guess.unit
        factor, text = unit_text(unit)
        time = to_si(raw * factor, text)
    good = np.isfinite(time)
    if len(time) == 1:
        return None  # one row has no rate, and nothing to run on
    if good.sum() < 2 or not (np.diff(time[good]) > 0).any():
        report.add("not_increasing", "the time column does not run", "give each row its own time, in order")
        return None
    time, sentence = without_jumps(time, sheet.lines)
    if sentence:
        report.notes.append(sentence)
    ticks = describe_clock(time)
    report.start_s, report.duration_s = ticks.start, ticks.duration
    report.rate_hz, report.jitter_s = ticks.rate_hz, ticks.jitter
    report.gaps = [(float(a), float(b)) for a, b in ticks.gaps]
    many = SCHEMAS[report.table].many_per_time
    faults = []
    if len(ticks.backwards):
        line = int(sheet.lines[int(ticks.backwards[0])])
        faults.append(f"time goes back in {counted(len(ticks.backwards), 'row')}, first in line {line}")
    if len(ticks.duplicates) and not many:
        line = int(sheet.lines[int(ticks.duplicates[0])])
        faults.append(
            f"{counted(len(ticks.duplicates), 'row')} repeat the time of the row before, first in line {line}"
        )
    if faults:
        advice = "repeated times are left out by the readers (the first row stays)"
        if len(ticks.backwards):
            advice = "split the file where the clock was set, or sort its rows by time"
        report.add("not_increasing", "; ".join(faults), advice)
    if report.gaps and report.table == "imu":
        at, longest = max(report.gaps, key=lambda g: g[1])
        report.add(
            "gap",
            f"{counted(len(report.gaps), 'gap')}, the longest {longest:.3g} s after {at:.3f} s; {ticks.missing} rows "
            "are "
            f"missing at {ticks.rate_hz:.4g} Hz",
            "nothing has to be done: the filter widens its uncertainty over a gap; for alignment and Allan use a part "
            "without",
        )
    return time


def missing_numbers(numbers: dict[str, Array], report: CheckReport) -> None:
    """A fault for rows that lack a needed number; a note for those that lack an optional one."""
    needed = SCHEMAS[report.table].needed(numbers)
    loose = {n: int((~np.isfinite(v)).sum()) for n, v in numbers.items() if n not in needed}
    report.notes += [f"{n} is not known in {counted(c, 'row')}" for n, c in loose.items() if c]
    numbers = {n: v for n, v in numbers.items() if n in needed}
    bad = {n: int((~np.isfinite(v)).sum()) for n, v in numbers.items()}
    bad = {n: c for n, c in bad.items() if c}
    if bad:
        rows = int(np.any([~np.isfinite(numbers[n]) for n in bad], axis=0).sum())
        some = ", ".join(f"{n} ({c})" for n, c in list(bad.items())[:4])
        report.add(
            "nan", f"{counted(rows, 'row')} without a number: {some}", "nothing has to be done: they are left out"
        )


def beside(file: str) -> str:
    """A name for the converted file: imu.csv.gz -> imu-si.csv."""
    name = Path(file).name.partition(".")[0]
    return f"{name}-si.csv" if name.lower().startswith("imu") else "imu-si.csv"


def study_line(table: str, path: Path) -> str:
    return f'in a study: [input] {table} = "{path.name}"'
