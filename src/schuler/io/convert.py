"""`convert`: a recording in any format that can be read, to the contract's tables.

OUT is a folder (all tables, with `conversion.json` saying what was assumed) or, by its suffix, a file (one table). It
appears complete or not at all.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from schuler import __version__
from schuler.ground.errors import InputError, StudyError
from schuler.ground.tables import SCHEMAS, Table, validate
from schuler.io.formats import FORMATS, Format
from schuler.io.headings import check_unit
from schuler.io.writing import write_table

RECORD = "conversion.json"
_FILE = (".csv", ".csv.gz", ".npz", ".parquet", ".txt")
_NOT_WRITTEN = {".mat", ".nc", ".h5", ".hdf5", ".json", ".xls", ".xlsx", ".gz", ".zip", ".ulg", ".nmea", ".log", ".tsv"}


@dataclass
class ConvertReport:
    """files : written, in the order of the tables. rows : of each table by name. format : what IN was taken for.
    notes : what was assumed, converted or left out, as sentences."""

    files: list[Path]
    rows: dict[str, int]
    format: str
    notes: list[str] = field(default_factory=list)


def convert(
    path_in: str | Path,
    path_out: str | Path,
    *,
    gyro_unit: str | None = None,
    accel_unit: str | None = None,
    format: str | None = None,
    table: str | None = None,
    **options: Any,
) -> ConvertReport:
    """Write the tables of a recording. Raises InputError (IN cannot be used) or StudyError (wrong options).

    path_in : file or folder. path_out : a folder, or a file whose suffix is .csv, .csv.gz, .npz or .parquet. gyro_unit,
    accel_unit : units of an IMU's numbers, whatever its headings say. format : a name of `FORMATS`, else found out.
    table : which table a single file holds, or which of several to write to a file. options : those of the format's own
    `convert`, e.g. gyro="raw" for comma2k19.
    """
    source, target = Path(path_in), Path(path_out)
    faults = _faults(gyro_unit, accel_unit, format, table)
    if faults:
        raise StudyError(faults)
    if not source.exists():
        raise InputError(f"{source}: there is no such file or folder")
    to_file = target.name.lower().endswith(_FILE) and not target.is_dir()
    if source.resolve() == target.resolve():
        raise InputError(f"{target}: the result would replace the recording itself; give another OUT")
    if not to_file and not target.is_dir() and target.suffix.lower() in _NOT_WRITTEN:
        raise InputError(f"{target.name}: tables are written as .csv, .csv.gz, .npz or .parquet, or into a folder")
    kind = _format(source, format)
    if to_file and not table and kind.name == "generic" and source.is_file():
        table = _named(target) or _named(source)
    tables = read_recording(source, kind, gyro_unit=gyro_unit, accel_unit=accel_unit, table=table, **options)
    notes = unique(note for t in tables.values() for note in t.notes)
    bad = [fault for t in tables.values() for fault in validate(t)]
    if bad:
        raise InputError(bad[0])
    if to_file:
        name = _choose(tables, table, target)
        rest = [t for t in tables if t != name]
        if rest:
            notes.append(f"not written: {', '.join(rest)} (a folder as OUT takes all tables)")
        written = [write_table(target, tables[name])]
        return ConvertReport(written, {name: len(tables[name])}, kind.name, notes)
    if table:
        tables = {table: tables[_choose(tables, table, target)]}
    record = _record(source, kind, tables, notes)
    return ConvertReport(_fill(target, tables, record), {n: len(t) for n, t in tables.items()}, kind.name, notes)


def read_recording(
    path: Path,
    kind: Format | None = None,
    *,
    gyro_unit: str | None = None,
    accel_unit: str | None = None,
    table: str | None = None,
    **options: Any,
) -> dict[str, Table]:
    """The tables of a recording, not written anywhere. Raises InputError."""
    path = Path(path)
    kind = kind or _format(path, None)
    if kind.name in ("generic", "matlab"):
        options |= {"gyro_unit": gyro_unit, "accel_unit": accel_unit, "table": table}
    elif gyro_unit or accel_unit:
        raise StudyError(f"--gyro-unit and --accel-unit are for plain tables; the units of {kind.what} are known")
    try:
        return kind.module.convert(path, **options)
    except TypeError as error:
        if options and "unexpected keyword" in str(error):
            raise StudyError(f"format {kind.name} has no option {str(error).rpartition(' ')[2]}") from None
        raise


def unique(notes: Iterable[str]) -> list[str]:
    """Sentences without repetition, in their order."""
    return list(dict.fromkeys(notes))


def _faults(gyro_unit: str | None, accel_unit: str | None, format: str | None, table: str | None) -> list[str]:
    faults = []
    for unit, want, option in (
        (gyro_unit, "angular rate", "--gyro-unit"),
        (accel_unit, "acceleration", "--accel-unit"),
    ):
        if unit:
            try:
                check_unit(unit, want, option)
            except InputError as error:
                faults.append(str(error))
    if format and format not in {f.name for f in FORMATS}:
        faults.append(f"format {format} is not known; formats are {', '.join(f.name for f in FORMATS)}")
    if table and table not in SCHEMAS:
        faults.append(f"there is no table {table}; tables are {', '.join(SCHEMAS)}")
    return faults


def _format(path: Path, name: str | None) -> Format:
    if name:
        return next(f for f in FORMATS if f.name == name)
    for candidate in FORMATS:
        if candidate.module.recognise(path):
            return candidate
    what = "\n".join(f"  {f.name}: {f.what}" for f in FORMATS)
    raise InputError(f"{path}: nothing in it that can be read; readable are\n{what}")


def _choose(tables: dict[str, Table], table: str | None, target: Path) -> str:
    """Which of several tables goes into a file."""
    if table:
        if table not in tables:
            raise InputError(f"the recording has no table {table}; it has {', '.join(tables)}")
        return table
    if len(tables) == 1:
        return next(iter(tables))
    named = _named(target)
    if named not in tables:
        raise InputError(
            f"the recording holds {', '.join(tables)}; give a folder as OUT for all of them, or a file named after "
            "one, "
            f"e.g. {next(iter(tables))}{''.join(target.suffixes)}"
        )
    return named


def _named(path: Path) -> str | None:
    """The table that a file is named after: imu.csv, gnss-clean.npz."""
    stem = path.name.partition(".")[0].lower()
    return stem if stem in SCHEMAS else next((t for t in SCHEMAS if re.match(rf"{t}[-_ ]", stem)), None)


def _record(source: Path, kind: Format, tables: dict[str, Table], notes: list[str]) -> dict[str, Any]:
    return {
        "source": source.name,
        "format": kind.name,
        "made_by": {"version": __version__},
        "tables": {n: {"file": f"{n}.csv", "rows": len(t)} for n, t in tables.items()},
        "notes": notes,
    }


def _fill(folder: Path, tables: dict[str, Table], record: dict[str, Any]) -> list[Path]:
    """All tables into a folder: made beside it and moved into place when complete.

    A folder that is there already is added to; files of an earlier conversion are replaced, any other of the same name
    is refused.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; give a folder, or a name ending in .csv, .npz or .parquet for one table")
    names = [f"{n}.csv" for n in tables] + [RECORD]
    ours = _earlier(folder)
    strange = [n for n in names if (folder / n).exists() and n not in ours]
    if strange:
        raise InputError(
            f"{folder} holds {', '.join(strange)} that no conversion has written; give another folder, or remove "
            f"{'it' if len(strange) == 1 else 'them'}"
        )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror or error}") from None
    try:
        for name, table in tables.items():
            write_table(work / f"{name}.csv", table)
        (work / RECORD).write_text(json.dumps(record, indent=2) + "\n")
        if folder.exists():
            for name in ours - set(names):
                (folder / name).unlink(missing_ok=True)
            for name in names:
                os.replace(work / name, folder / name)
        else:
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(work, 0o777 & ~mask)
            os.replace(work, folder)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return [folder / n for n in names if n != RECORD]


def _earlier(folder: Path) -> set[str]:
    """Files that an earlier conversion wrote into a folder."""
    try:
        record = json.loads((folder / RECORD).read_text())
        return {RECORD, *(str(t["file"]) for t in record["tables"].values() if "/" not in str(t["file"]))}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return set()
