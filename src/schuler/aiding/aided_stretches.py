"""A recording whose IMU fell silent for long: navigated in stretches, each with a start of its own.

Over a gap in which the attitude turns by it does not know how much a linear filter cannot be carried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from schuler.aiding.aided_settings import AidedSettings, Start
from schuler.aiding.solution import Innovations, Navigation, Solution, StateHistory
from schuler.ground.errors import InputError
from schuler.ground.tables import Table, Tables

SHORTEST_S = 5.0  # nothing is started for less


def parts(tables: Tables, longest: float) -> list[dict[str, Table]]:
    """The tables between gaps of the IMU that are longer than `longest` (s); one where there is none."""
    imu = tables["imu"]
    cuts = np.flatnonzero(np.diff(imu.time) > longest)
    if not len(cuts):
        return [dict(tables)]
    edges = [-np.inf, *imu.time[cuts], np.inf]
    found = []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        part = {name: t.where((t.time > a) & (t.time <= b)) if "time" in t else t for name, t in tables.items()}
        part = {name: t for name, t in part.items() if len(t)}
        if "imu" in part and len(part["imu"]) > 1 and np.ptp(part["imu"].time) > SHORTEST_S:
            found.append(part)
    return found or [dict(tables)]


def joined(
    stretches: Sequence[dict[str, Table]], settings: AidedSettings,
    run: Callable[[dict[str, Table], AidedSettings], Navigation],
) -> Navigation:  # fmt: skip
    """Each stretch navigated, one behind the other. The first begins as typed, the others find their start; one that
    finds none is left out with a note. InputError where none does."""
    done: list[Navigation] = []
    notes: list[str] = []
    fault: InputError | None = None
    for number, tables in enumerate(stretches):
        begin = float(tables["imu"].time[0])
        try:
            one = run(tables, settings if number == 0 else replace(settings, start=Start()))
        except InputError as error:
            fault = fault or error
            notes.append(f"from {begin:.1f} s on nothing is navigated: {error}")
            continue
        if number:
            notes.append(
                f"the imu was silent for {begin - float(stretches[number - 1]['imu'].time[-1]):.0f} s until "
                f"{begin:.1f} s: navigation starts anew there"
            )
        notes += one.notes
        done.append(one)
    if not done:
        raise fault or InputError("no stretch of the imu table is long enough to navigate")
    result = Navigation(_row(d.filter for d in done), notes=list(dict.fromkeys(notes)))
    smooth = [d.smoother for d in done if d.smoother is not None]
    if len(smooth) == len(done):
        result.smoother = _row(smooth)
    for name in dict.fromkeys(n for d in done for n in d.states):
        result.states[name] = _states([d.states[name] for d in done if name in d.states])
    for name in dict.fromkeys(n for d in done for n in d.innovations):
        result.innovations[name] = _innovations([d.innovations[name] for d in done if name in d.innovations])
    return result


def _row(solutions: Iterable[Solution]) -> Solution:
    several = list(solutions)
    return Solution(*(np.concatenate([getattr(s, f) for s in several]) for f in Solution.__dataclass_fields__))


def _states(several: list[StateHistory]) -> StateHistory:
    first = several[0]
    time, value, std = (np.concatenate([getattr(s, f) for s in several]) for f in ("time", "value", "std"))
    made = StateHistory(first.name, first.unit, time, value, std)
    kept = [(s.smoothed, s.smoothed_std) for s in several if s.smoothed is not None and s.smoothed_std is not None]
    if len(kept) == len(several):
        made.smoothed, made.smoothed_std = (np.concatenate(pair) for pair in zip(*kept, strict=True))
    return made


def _innovations(several: list[Innovations]) -> Innovations:
    first = several[0]
    time, value, std, nis, used = (
        np.concatenate([getattr(i, f) for i in several]) for f in ("time", "value", "std", "nis", "used")
    )
    weights = [i.weight for i in several if i.weight is not None]
    weight = np.concatenate(weights) if len(weights) == len(several) else None
    return Innovations(first.kind, first.components, first.unit, time, value, std, nis, used, weight)
