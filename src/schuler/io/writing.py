"""Tables to files: the contract's headings and units, complete or not at all."""

from __future__ import annotations

import gzip
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import SCHEMAS, Table
from schuler.ground.units import from_si

ANGLE_DIGITS = 12  # after the point; 1e-12 deg is a tenth of a micrometre on the ground


def file_columns(table: Table) -> dict[str, NDArray]:
    """Heading -> numbers in the unit of that heading, in the contract's order; columns it does not know come last."""
    schema = SCHEMAS[table.name]
    known = [c for c in schema.columns if c.name in table]
    out = {}
    for column in known:
        values = table[column.name]
        out[column.header] = values if column.si == column.unit or column.text else from_si(values, column.unit)
    for name, values in table.columns.items():
        if name not in schema:
            out[name] = values
    return out


def write_table(path: str | Path, table: Table) -> Path:
    """Write a table as CSV, .csv.gz, .npz or .parquet by the name of the file; headings carry the units.

    Angles in degrees; latitude and longitude with 12 digits after the point, other numbers with as many as it takes to
    read the same number again. The file appears when it is complete. Raises InputError where it cannot be written.
    """
    path = Path(path)
    columns = file_columns(table)
    if path.name.lower().endswith((".csv", ".csv.gz", ".txt")):
        text = csv_text(columns)
        if path.suffix.lower() == ".gz":
            # no name and no date inside, so that equal tables make equal files
            return atomically(path, lambda f: f.write(gzip.compress(text.encode(), 4, mtime=0)))
        return atomically(path, lambda f: f.write(text.encode()))
    if path.suffix.lower() == ".npz":
        return atomically(path, lambda f: np.savez_compressed(f, allow_pickle=False, **columns))
    if path.suffix.lower() == ".parquet":
        try:
            import pyarrow
            import pyarrow.parquet as pq
        except ImportError:
            raise InputError(f'{path.name}: writing parquet needs pyarrow; type: pip install "schuler[io]"') from None
        whole = pyarrow.table({k: pyarrow.array(v) for k, v in columns.items()})
        return atomically(path, lambda f: pq.write_table(whole, f))
    raise InputError(f"{path.name}: a table is written as .csv, .csv.gz, .npz or .parquet")


def csv_text(columns: dict[str, NDArray]) -> str:
    """The CSV of named columns, header line first."""
    cells = [_cells(heading, values) for heading, values in columns.items()]
    rows = map(",".join, zip(*cells, strict=True))
    return "\n".join([",".join(columns), *rows]) + "\n"


def _cells(heading: str, values: NDArray) -> list[str]:
    if values.dtype.kind not in "fiu":
        return [f'"{v}"' if "," in v else v for v in map(str, values)]
    if heading in ("lat[deg]", "lon[deg]"):
        return [f"{v:.{ANGLE_DIGITS}f}" for v in values.tolist()]
    if heading.endswith(("[deg]", "[deg/s]", "[uT]")):
        values = np.round(values, ANGLE_DIGITS) + 0.0
    return ["" if v != v else repr(v) for v in values.tolist()]


def atomically(path: Path, write: Callable[[IO[bytes]], object]) -> Path:
    """Call write(stream) on a temporary file beside `path`, then give it that name."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from None
    try:
        with os.fdopen(handle, "wb") as stream:
            write(stream)
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from None
    finally:
        Path(temporary).unlink(missing_ok=True)
    return path
