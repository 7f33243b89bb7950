"""What the readers of recorders share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.io.sheets import Sheet, read_sheet

Array = NDArray[np.float64]

HDOP_SIGMA = 5.0  # m, 1 sigma of one axis at HDOP 1, a single-frequency receiver at sea: cautious
SEA_SURFACE_SIGMA = 100.0  # m: the sea surface lies within about this of the ellipsoid (geoid heights -107 to +86 m)


def numbered(sheet: Sheet) -> dict[str, NDArray]:
    """Columns of a sheet by their headings as they stand."""
    return dict(zip(sheet.headings, sheet.columns, strict=True))


def need(columns: dict[str, NDArray], names: str, path: Path) -> None:
    """InputError where one of the named columns is absent or holds words."""
    absent = [n for n in names.split() if n not in columns]
    if absent:
        raise InputError(f"{path.name}: column{'s' * (len(absent) > 1)} {', '.join(absent)} missing")
    words = [n for n in names.split() if columns[n].dtype.kind != "f"]
    if words:
        raise InputError(f"{path.name}: column {words[0]} holds text where numbers were expected")


def sheet_in(folder: Path, stem: str) -> Sheet | None:
    """The sheet `stem`.csv, .csv.gz, .npz or .parquet of a folder, None where there is none."""
    for suffix in (".csv", ".csv.gz", ".npz", ".parquet"):
        if (folder / f"{stem}{suffix}").is_file():
            return read_sheet(folder / f"{stem}{suffix}")
    return None


def joined(parts: list[dict[str, NDArray]], what: str, notes: list[str]) -> dict[str, NDArray]:
    """Rows of several parts in order of time; of rows that share a time the first part's is kept."""
    names = parts[0].keys()
    columns = {n: np.concatenate([p[n] for p in parts]) for n in names}
    order = np.argsort(columns["time"], kind="stable")
    columns = {n: v[order] for n, v in columns.items()}
    again = np.concatenate([[False], np.diff(columns["time"]) == 0.0])
    if again.any():
        notes.append(f"{what}: {int(again.sum())} rows with a time that is there already were left out")
        columns = {n: v[~again] for n, v in columns.items()}
    return columns


def whole_rows(columns: dict[str, NDArray], what: str, notes: list[str]) -> dict[str, NDArray]:
    """Rows in which every column is a number; a note on the others."""
    good = np.all([np.isfinite(v) for v in columns.values()], axis=0)
    if not good.all():
        notes.append(f"{what}: {int((~good).sum())} of {len(good)} rows without a value left out")
    return {n: v[good] for n, v in columns.items()}


def wrapped(angle: Array) -> Array:
    """Angles in [0, 2 pi), as headings are written."""
    return np.mod(angle, 2.0 * np.pi)
