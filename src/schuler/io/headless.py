"""Columns of a file without headings, placed by what they hold: a time that runs, a triple as long as gravity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.units import to_si
from schuler.io.guess import guess_accel, guess_time, norm
from schuler.io.headings import Match
from schuler.io.sheets import Sheet

Array = NDArray[np.float64]


def time_column(columns: list[NDArray]) -> int | None:
    """The first or last numeric column that (almost) always grows by steps much alike; None if there is none."""
    numeric = [i for i, c in enumerate(columns) if c.dtype.kind == "f"]
    for i in dict.fromkeys([*numeric[:1], *numeric[-1:]]):
        step = np.diff(columns[i])
        if len(step) < 2 or not np.isfinite(step).all():
            continue
        usual = np.median(step)
        if usual > 0 and np.mean(step >= 0) > 0.999 and np.mean(step < 10 * usual) > 0.95:
            return i
    return None


def place_columns(sheet: Sheet, table: str) -> tuple[dict[str, Match], str]:
    """Contract columns of a file without headings, and a sentence on what was taken for what.

    An imu: an optional time first or last, then two triples, of which the one as long as gravity is the accelerometer.
    A gnss file of GPS second, latitude, longitude, height and three sigmas (the text that KF-GINS reads). Raises
    InputError for anything else.
    """
    columns = sheet.columns
    if table == "gnss" and len(columns) >= 4 and time_column(columns) == 0:
        names = ["time", "lat", "lon", "height", "std_north", "std_east", "std_down"]
        if len(columns) >= 10:
            names += ["v_north", "v_east", "v_down"]
        units = {"lat": "deg", "lon": "deg"}
        lat, lon = columns[1], columns[2]
        if np.nanmax(np.abs(lat)) <= 90.0 and np.nanmax(np.abs(lon)) <= 360.0 and np.nanmax(np.abs(lat)) > np.pi / 2:
            found = {n: Match(n, i, units.get(n, ""), "") for i, n in enumerate(names[: len(columns)])}
            return found, f"no header line; the columns are taken as {', '.join(found)}"
    if table != "imu":
        raise InputError(
            f"{sheet.path.name}: no header line names its {len(columns)} columns; write one, e.g. {_example(table)}"
        )
    clock = time_column(columns)
    rest = [i for i, c in enumerate(columns) if c.dtype.kind == "f" and i != clock][:6]
    if len(rest) < 6:
        raise InputError(
            f"{sheet.path.name}: no header line, and {len(rest)} columns of numbers beside the time are no IMU; write "
            f"a header line, e.g. {_example(table)}"
        )
    dt = None
    if clock is not None:
        unit = guess_time(columns[clock], "imu")
        step = np.diff(columns[clock])
        dt = to_si(float(np.median(step[step > 0])), unit.unit) if unit.sure else None
    sizes = []
    for part in (rest[:3], rest[3:]):
        values = np.column_stack([columns[i] for i in part])
        values = values[np.isfinite(values).all(axis=1)]
        length = norm(values)
        steady = float(np.std(length) / np.mean(length)) if len(length) and np.mean(length) > 0 else np.inf
        sizes.append((guess_accel(values, dt) if len(values) else None, steady))
    fits = [k for k, (guess, _) in enumerate(sizes) if guess and guess.sure]
    if len(fits) == 2:
        fits = [0 if sizes[0][1] < sizes[1][1] else 1]
    if not fits:
        raise InputError(
            f"{sheet.path.name}: no header line, and neither columns {rest[0] + 1}-{rest[2] + 1} nor {rest[3] + 1}-"
            f"{rest[5] + 1} are as long as gravity; write a header line, e.g. {_example(table)}"
        )
    accel = rest[:3] if fits[0] == 0 else rest[3:]
    gyro = rest[3:] if fits[0] == 0 else rest[:3]
    kind = sizes[fits[0]][0].kind  # type: ignore[union-attr]
    stems = ("accel", "gyro") if kind == "rates" else ("dv", "dtheta")
    found = {f"{stems[0]}_{a}": Match(f"{stems[0]}_{a}", i, "", "") for a, i in zip("xyz", accel, strict=True)}
    found |= {f"{stems[1]}_{a}": Match(f"{stems[1]}_{a}", i, "", "") for a, i in zip("xyz", gyro, strict=True)}
    when = "no time"
    if clock is not None:
        found["time"] = Match("time", clock, "", "")
        when = f"column {clock + 1} as time"
    return found, (
        f"no header line; {when}, columns {accel[0] + 1}-{accel[2] + 1} as accelerometer x, y, z (they are as long as "
        f"gravity), columns {gyro[0] + 1}-{gyro[2] + 1} as gyro x, y, z"
    )


def _example(table: str) -> str:
    from schuler.ground.tables import SCHEMAS

    schema = SCHEMAS[table]
    first = schema.choices[0][0] if schema.choices else ()
    names = [c.header for c in schema.columns if c.required or c.name in first]
    return ",".join(names)
