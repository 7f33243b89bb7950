"""Times made to run forward, and rows left out: the part of reading that every table shares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Schema
from schuler.ground.times import WEEK, unix_from_iso
from schuler.ground.units import to_si
from schuler.io.guess import guess_time
from schuler.io.headings import Match, unit_text

Array = NDArray[np.float64]
DAY = 86400.0
MIDNIGHT_GAP = 6 * 3600.0
DUST = 1e-7  # s: what rounding leaves between two prints of one time


def times_of(values: NDArray, found: Match, table: str, who: str) -> tuple[Array, list[str]]:
    """A time column in seconds, and what was assumed. Text is read as ISO dates (UTC)."""
    heading = found.heading or "the time column"
    if values.dtype.kind == "U":
        out = np.full(len(values), np.nan)
        for i, text in enumerate(values):
            try:
                out[i] = unix_from_iso(str(text))
            except InputError as error:
                if i == 0:
                    raise InputError(
                        f"{who}: column {heading} holds {str(text)[:40]!r}, neither a number of seconds nor an ISO date"
                    ) from error
        return out, [f"{who}: {heading} holds dates: taken as UTC, in Unix seconds"]
    unit = found.unit
    if unit:
        factor, text = unit_text(unit)
        step = np.diff(values[np.isfinite(values)])
        if table == "imu" and len(step) and to_si(float(np.median(step)) * factor, text) > 2.0:
            other = guess_time(values, table)
            if other.sure and other.unit != text:
                raise InputError(
                    f"{who}: {heading} is said to be in {unit}, but {other.reason}; write time[{other.unit}] in the "
                    "heading"
                )
        return to_si(values * factor, text), []
    if not np.isfinite(values).any():
        raise InputError(f"{who}: column {heading} holds no number")
    guess = guess_time(values, table)
    if not guess.sure:
        raise InputError(
            f"{who}: {heading} without a unit, and {guess.reason}; write time[s] or time[ms] in the heading"
        )
    note = f"{who}: {heading} without a unit: taken as {guess.unit}, because {guess.reason}"
    # Seconds are what the contract says: no need to tell unless the number is something else.
    return to_si(values, guess.unit), [note] if guess.unit != "s" or found.column != found.heading else []


def drop_incomplete(
    columns: dict[str, NDArray], lines: NDArray[np.int64], schema: Schema, who: str
) -> tuple[dict[str, NDArray], NDArray[np.int64], list[str]]:
    """Rows where every needed column is a number; optional columns without any number left out."""
    notes = []
    for name, values in list(columns.items()):
        if values.dtype.kind != "f":
            continue
        values = np.where(np.isfinite(values), values, np.nan)
        needed = name in schema.needed(columns)
        if name.startswith("std_") and (values <= 0.0).any():
            unknown = int((values <= 0.0).sum())
            values = np.where(values > 0.0, values, np.nan)
            if not np.isnan(values).all():
                notes.append(f"{who}: {name} is zero or negative in {unknown} rows: taken as unknown there")
        if np.isnan(values).all():
            if needed:
                raise InputError(f"{who}: column {name} holds no number in any of its {len(values)} rows")
            notes.append(f"{who}: {name} holds nothing that is known; left out")
            del columns[name]
            continue
        columns[name] = values
    whole = np.ones(len(lines), dtype=bool)
    guilty = []
    for name in schema.needed(columns):
        needed_values = columns.get(name)
        if needed_values is None or needed_values.dtype.kind != "f":
            continue
        bad = np.isnan(needed_values)
        if bad.any():
            guilty.append(name)
            whole &= ~bad
    if not whole.any():
        raise InputError(f"{who}: no row has all of {', '.join(guilty)}; they are never known at the same time")
    if not whole.all():
        lost = int((~whole).sum())
        first = int(lines[int(np.argmin(whole))])
        notes.append(
            f"{who}: {lost} of {len(whole)} rows left out, where {_list(guilty)} {'is' if len(guilty) == 1 else 'are'} "
            f"not a number (first in line {first})"
        )
        columns = {k: v[whole] for k, v in columns.items()}
        lines = lines[whole]
    for name, values in columns.items():
        if values.dtype.kind == "f" and (unknown := int(np.isnan(values).sum())):
            notes.append(f"{who}: {name} is not known in {unknown} of {len(values)} rows")
    return columns, lines, notes


def drop_held(
    columns: dict[str, NDArray], lines: NDArray[np.int64], who: str
) -> tuple[dict[str, NDArray], NDArray[np.int64], list[str]]:
    """Fixes without the rows in between that only hold the last one, as logs at the rate of an IMU have them."""
    names = [n for n in columns if n != "time" and not n.startswith("std_")]
    step = np.diff(columns["time"])
    if len(step) < 50 or not 0.0 < np.median(step) < 0.2:
        return columns, lines, []
    held = np.concatenate([[False], np.all([np.diff(columns[n]) == 0.0 for n in names], axis=0)])
    if held.mean() < 0.6:
        return columns, lines, []
    note = f"{who}: {int(held.sum())} of {len(held)} rows left out that only repeat the fix before them"
    return {k: v[~held] for k, v in columns.items()}, lines[~held], [note]


def _list(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def clean_time(
    columns: dict[str, NDArray], lines: NDArray[np.int64], who: str, many: bool, table: str
) -> tuple[dict[str, NDArray], list[str]]:
    """Rows in order of time: jumps of the week or day count taken out, repeated times left out (the first row stays).

    many : rows may share a time; such tables are put in order. Elsewhere a time that goes back is an InputError.
    """
    notes: list[str] = []
    time, sentence = without_jumps(columns["time"], lines)
    if sentence:
        notes.append(f"{who}: {sentence}")
    dust = (np.diff(time) < 0.0) & (np.diff(time) > -DUST)
    if dust.any():
        time = time.copy()
        for k in np.flatnonzero(dust) + 1:
            time[k] = max(time[k], time[k - 1])
    columns = {**columns, "time": time}
    step = np.diff(time)
    if (step < 0).any():
        back = int(np.argmax(step < 0)) + 1
        if not many:
            raise InputError(
                f"{who}: time goes back at line {lines[back]}, from {time[back - 1]:.6f} to {time[back]:.6f} s "
                f"({int((step < 0).sum())} such rows); rows must be in order of time: split the file where the clock "
                "was set, or sort it"
            )
        order = np.argsort(time, kind="stable")
        columns = {k: v[order] for k, v in columns.items()}
        count = int((step < 0).sum())
        notes.append(
            f"{who}: {count} row{'s' * (count > 1)} out of order (first in line {lines[back]}); sorted by time"
        )
    elif not many and (step == 0).any():
        again = np.concatenate([[False], step == 0])
        count = int(again.sum())
        notes.append(
            f"{who}: {count} row{'s' * (count > 1)} left out that repeat{'s' * (count == 1)} the time of the row "
            f"before (first in line {lines[int(np.argmax(again))]}); the first row of each time was kept"
        )
        columns = {k: v[~again] for k, v in columns.items()}
    if table == "imu":
        notes += [f"{who}: {text}" for text in gap_notes(columns["time"])]
    return columns, notes


def without_jumps(time: Array, lines: NDArray[np.int64]) -> tuple[Array, str]:
    """Times with jumps of whole GPS weeks (1, or 1024) or of midnight taken out, and a sentence about them.

    A jump back of a week less up to a day is a week that rolled over in a gap of that length; midnight may lie in a
    gap of up to six hours.
    """
    step = np.diff(time)
    forward = step[step > 0]
    if not len(forward):
        return time, ""
    usual = float(np.median(forward))
    slack = max(60.0, 5.0 * usual)
    fix = np.zeros(len(step))
    said = ""
    for size, what in ((WEEK, "the GPS week rolled over"), (1024 * WEEK, "the GPS week number rolled over")):
        if slack > 0.2 * size:
            continue
        back = np.abs(step + size) < slack
        # The roll-over may lie in a gap of up to a day. Rows that are merely out of order also jump ahead as far.
        if not np.any(np.abs(step - size) < DAY):
            back |= (step + size > 0.0) & (step + size < DAY)
        ahead = np.abs(step - size) < min(slack, 2.0 * usual + 1.0)
        if size > WEEK and not back.any():  # the right number after a wrong one, perhaps in a gap as well
            ahead |= (step - size >= 0.0) & (step - size < DAY)
        if size == WEEK and np.nanmin(time) >= 0.0 and np.nanmax(time) <= WEEK + 1.0:
            ahead[:] = False
        fix += size * back - size * ahead
        if (back | ahead).any():
            line = int(lines[int(np.argmax(back | ahead)) + 1])
            said = (
                f"{what} at line {line} (time jumps by {'-' if back.any() else ''}{size:.0f} s); times run on over it"
            )
            passed = np.where(back, step + size, 0.0)
            k = int(np.argmax(passed))
            if passed[k] >= slack:
                said += f", with a gap of {passed[k]:.6g} s at line {lines[k + 1]} taken for the time that passed"
    if not said and np.nanmin(time) >= 0.0 and np.nanmax(time) <= DAY + 1.0 and slack <= 0.2 * DAY:
        back = np.abs(step + DAY) < slack
        if not np.any(step > DAY - MIDNIGHT_GAP):
            back |= (step + DAY > 0.0) & (step + DAY < MIDNIGHT_GAP)
        fix += DAY * back
        if back.any():
            said = f"time of day passes midnight at line {int(lines[int(np.argmax(back)) + 1])}; times run on over it"
    return (time + np.concatenate([[0.0], np.cumsum(fix)]), said) if said else (time, "")


def gap_notes(time: Array) -> list[str]:
    """Sentences on gaps in an evenly sampled recording."""
    step = np.diff(time)
    if len(step) < 10:
        return []
    usual = float(np.median(step))
    gaps = np.flatnonzero(step > max(5.0 * usual, 0.1))
    if not len(gaps):
        return []
    longest = gaps[np.argmax(step[gaps])]
    if len(gaps) == 1:
        return [f"a gap of {step[longest]:.3g} s after {time[longest]:.3f} s (the usual step is {usual:.4g} s)"]
    where = f"{step[longest]:.3g} s after {time[longest]:.3f} s"
    return [f"{len(gaps)} gaps, the longest {where} (the usual step is {usual:.4g} s)"]
