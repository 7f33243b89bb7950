"""`check`: what a recording is like, without any configuration; faults with what to type next.

An IMU in any table, with or without headings, is looked at in full: rate, gaps, jitter, units, rates or increments, the
axis of gravity, parts where it stood still, a first noise figure. Other tables get rate, gaps and faults.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from schuler.ground.errors import InputError
from schuler.ground.tables import SCHEMAS
from schuler.io.check_clock import clock, missing_numbers, study_line
from schuler.io.check_imu import check_imu
from schuler.io.check_report import CODES as CODES
from schuler.io.check_report import CheckReport as CheckReport
from schuler.io.check_report import Fault as Fault
from schuler.io.check_text import render as render
from schuler.io.formats.generic import tables_in
from schuler.io.headings import match
from schuler.io.sheets import Sheet, read_sheet


def check(paths: str | Path | Iterable[str | Path]) -> list[CheckReport]:
    """One report a table found in the files. Raises InputError for a file that cannot be read at all."""
    several = [paths] if isinstance(paths, (str, Path)) else paths
    return [report for path in several for report in check_file(Path(path))]


def check_file(path: Path) -> list[CheckReport]:
    """Reports of one file: one, or one a table where the format holds several."""
    reports = _recorded(path)
    if reports is not None:
        return reports
    sheet = read_sheet(path)
    table = _which(sheet)
    if table == "imu":
        return [check_imu(sheet, path)]
    return [_check_other(sheet, path, table)]


def _recorded(path: Path) -> list[CheckReport] | None:
    """Reports of a recording whose own format is known (ULog, NMEA, netCDF, MAT, a folder), None for others."""
    from schuler.io.convert import read_recording
    from schuler.io.formats import FORMATS
    from schuler.io.writing import file_columns

    kind = next(
        (f for f in FORMATS if path.exists() and (f.name != "generic" or path.is_dir()) and f.module.recognise(path)),
        None,
    )
    if kind is None:
        return None
    reports: list[CheckReport] = []
    for name, table in read_recording(path, kind).items():
        columns = file_columns(table)
        sheet = Sheet(path, list(columns), list(columns.values()), np.arange(1, len(table) + 1))
        report = check_imu(sheet, path) if name == "imu" else _check_other(sheet, path, name)
        report.notes = list(table.notes) if not reports else []
        report.next = [f"schuler convert {path} OUT   # writes the tables"] if not reports else []
        reports.append(report)
    return reports


def _which(sheet: Sheet) -> str:
    if not sheet.has_headings:
        return "imu"
    words = {i for i, c in enumerate(sheet.columns) if c.dtype.kind == "U"}
    found, _ = match(sheet.headings, "imu", words, [])
    for stem in ("gyro", "accel", "dtheta", "dv"):
        if all(f"{stem}_{a}" in found for a in "xyz"):
            return "imu"
    name = sheet.path.name.partition(".")[0].lower()
    names = [name] if name in SCHEMAS else tables_in(sheet)
    if not names:
        headings = ", ".join(h for h in sheet.headings if h)[:200]
        raise InputError(
            f"{sheet.path.name}: its columns ({headings}) are neither an IMU's nor those of another table; name them "
            "as in "
            "time[s], gyro_x[rad/s], ..., accel_x[m/s^2], ..."
        )
    return names[0]


def _check_other(sheet: Sheet, path: Path, table: str) -> CheckReport:
    """Clock and missing numbers of a table that is no IMU; the reader's own words where it would refuse."""
    from schuler.io.tables import table_of

    report = CheckReport(str(path), table, len(sheet))
    words = {i for i, c in enumerate(sheet.columns) if c.dtype.kind == "U"}
    found, _ = match(sheet.headings, table, words, [])
    time = clock(sheet, found, report)
    numbers = {n: sheet.columns[m.index] for n, m in found.items() if sheet.columns[m.index].dtype.kind == "f"}
    missing_numbers(numbers, report)
    try:
        made = table_of(sheet, table)
        report.notes = made.notes
        report.units = [", ".join(c.header for c in SCHEMAS[table].columns if c.name in made)]
    except InputError as error:
        report.refused = str(error)
    if time is not None and not report.faults and not report.refused:
        report.next = [study_line(table, path)]
    return report
