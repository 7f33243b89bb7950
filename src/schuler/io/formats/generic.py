"""Tables in CSV, .csv.gz, npz or parquet with whatever headings: one file, or a folder of files named after tables.

A single file may hold several tables (an IMU and the fixes beside it); each is taken out by its columns. A folder is
read file by file: `imu.csv`, `gnss.csv`, ... by their names; separate gyro and accelerometer files, as phones record
them, are put on one clock.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler.ground.errors import InputError
from schuler.ground.tables import SCHEMAS, Table
from schuler.io.headings import match
from schuler.io.sheets import Sheet, counted, read_sheet
from schuler.io.tables import ReadOptions, table_of

SUFFIXES = (".csv", ".csv.gz", ".npz", ".parquet", ".txt", ".txt.gz", ".tsv", ".log.gz", ".dat")

# Which tables are looked for in a file that holds several, in this order.
MIXED = ("imu", "gnss", "dvl", "speed", "depth", "attitude", "height", "ranges", "sightings", "lidar")
_GYRO = ("gyro", "gyr", "gyroscope", "gyroscopeuncalibrated")
_ACCEL = ("acc", "accel", "accelerometer", "totalacceleration")


def recognise(path: Path) -> bool:
    """Whatever else was not recognised."""
    if path.is_dir():
        return any(_is_table_file(p) for p in path.iterdir())
    return path.is_file()


def _is_table_file(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith(SUFFIXES)


def stem(path: Path) -> str:
    """imu of imu.csv.gz, in lower case."""
    return path.name.partition(".")[0].lower()


def convert(
    path: Path, gyro_unit: str | None = None, accel_unit: str | None = None, table: str | None = None, **options: Any
) -> dict[str, Table]:
    """The tables of a file or folder; `table` says which one a file holds. Raises InputError."""
    settings = ReadOptions(gyro_unit=gyro_unit, accel_unit=accel_unit, **options)
    if path.is_dir():
        return _folder(path, settings)
    sheet = read_sheet(path)
    if table:
        return {table: table_of(sheet, table, settings)}
    name = stem(path)
    if name in SCHEMAS:
        return {name: table_of(sheet, name, settings)}
    names = tables_in(sheet)
    if not names:
        close = next((t for t in SCHEMAS if name.startswith(t)), "imu" if not sheet.has_headings else "")
        if close:
            return {close: table_of(sheet, close, settings)}
        headings = ", ".join(h for h in sheet.headings if h)[:200]
        raise InputError(
            f"{path.name}: its columns ({headings or 'without names'}) make none of the tables {', '.join(SCHEMAS)}; "
            "name "
            "its columns as the tables do, or give OUT the name of the table it holds, e.g. imu.csv"
        )
    out: dict[str, Table] = {}
    faults = []
    for t in names:
        try:
            out[t] = table_of(sheet, t, settings)
        except InputError as error:
            faults.append(str(error))
    if not out:
        raise InputError(faults[0])
    next(iter(out.values())).notes += [f"left out: {fault}" for fault in faults]
    return out


def tables_in(sheet: Sheet) -> list[str]:
    """Which tables a sheet's headings can make, so that no table only repeats columns of one before it."""
    if not sheet.has_headings:
        return []
    words = {i for i, c in enumerate(sheet.columns) if c.dtype.kind == "U"}
    used: set[int] = set()
    names: list[str] = []
    for t in MIXED:
        found, _ = match(sheet.headings, t, words, [])
        rate = {"time"} if t == "imu" and {"rate_hz", "sampling_rate"} & sheet.scalars.keys() else set()
        schema = SCHEMAS[t]
        if schema.missing({*found, *rate}):
            continue
        needed = {found[n].index for n in schema.needed(found) if n in found and n not in ("time", "id")}
        if needed & used:
            continue
        used |= {m.index for n, m in found.items() if n not in ("time", "id")}
        names.append(t)
    return names


def _folder(path: Path, settings: ReadOptions) -> dict[str, Table]:
    files = {stem(p): p for p in sorted(path.iterdir()) if _is_table_file(p)}
    out: dict[str, Table] = {}
    left = []
    for name, file in files.items():
        if name in SCHEMAS:
            out[name] = table_of(read_sheet(file), name, settings)
        else:
            left.append(file.name)
    if "imu" not in out:
        gyro = next((files[n] for n in _GYRO if n in files), None)
        accel = next((files[n] for n in _ACCEL if n in files), None)
        if gyro and accel:
            out["imu"] = table_of(merged(read_sheet(gyro), read_sheet(accel)), "imu", settings)
            left = [f for f in left if f not in (gyro.name, accel.name)]
    if not out:
        raise InputError(
            f"{path}: no file in it is named after a table ({', '.join(list(SCHEMAS)[:5])}, ...) and it is no "
            "recording "
            "whose format is known; convert its files one by one"
        )
    if left:
        next(iter(out.values())).notes.append(f"not used: {', '.join(left)}")
    return out


def merged(gyro: Sheet, accel: Sheet) -> Sheet:
    """A gyro sheet with the accelerometer's columns interpolated to its stamps, where both overlap."""
    a, b = _clock(gyro), _clock(accel)
    t, s = gyro.columns[a], accel.columns[b]
    inside = (t >= s.min()) & (t <= s.max())
    if inside.sum() < 2:
        raise InputError(
            f"{gyro.path.name} and {accel.path.name} do not overlap in time: {t.min():.3f} to {t.max():.3f} against "
            f"{s.min():.3f} to {s.max():.3f}"
        )
    order = np.argsort(s, kind="stable")
    headings = list(gyro.headings)
    columns = [c[inside] for c in gyro.columns]
    for i, heading in enumerate(accel.headings):
        if i != b and heading not in headings and accel.columns[i].dtype.kind == "f":
            headings.append(heading)
            columns.append(np.interp(t[inside], s[order], accel.columns[i][order]))
    note = f"{accel.path.name} interpolated to the stamps of {gyro.path.name}"
    if not inside.all():
        note += f"; {counted(int((~inside).sum()), 'row')} outside left out"
    return Sheet(gyro.path, headings, columns, gyro.lines[inside], {}, [*gyro.notes, *accel.notes, note])


def _clock(sheet: Sheet) -> int:
    found, _ = match(sheet.headings, "depth", {i for i, c in enumerate(sheet.columns) if c.dtype.kind == "U"})
    if "time" not in found or sheet.columns[found["time"].index].dtype.kind != "f":
        raise InputError(f"{sheet.path.name}: no time column")
    return found["time"].index
