"""Files of columns as they stand: CSV and its relatives (also .gz), npz and parquet, before any meaning is given.

`read_sheet` returns a `Sheet`: headings, columns, the line of each row. What is wrong with a file as a file (missing,
empty, binary, cut off, ragged) is said here in one sentence.
"""

from __future__ import annotations

import csv
import gzip
import re
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.units import split_header

MAX_BYTES = 2 << 30  # of one file, decompressed: 12 h at 200 Hz is 0.7 GB as text
MAX_COLUMNS = 2000

_MAGIC = (
    (b"ULog", "a PX4 ULog"),
    (b"\x89HDF", "an HDF5 or netCDF-4 file"),
    (b"CDF", "a netCDF-3 file"),
    (b"MATLAB", "a MATLAB file"),
    (b"\xb5b", "u-blox binary data"),
    (b"\x1f\x8b", "a gzip file inside a gzip file"),
    (b"SQLite", "an SQLite data base"),
    (b"#ROSBAG", "a ROS bag"),
    (b"%PDF", "a PDF"),
)


@dataclass
class Sheet:
    """Columns as they stand in a file.

    headings : one a column, "" throughout where the file has none. columns : float64 or str arrays of one length.
    lines : number in the file of each row, counted from 1 (rows of a file that has no lines are counted instead).
    scalars : single numbers stored beside the columns (npz, MAT). notes : what was left out, as sentences.
    """

    path: Path
    headings: list[str]
    columns: list[NDArray]
    lines: NDArray[np.int64]
    scalars: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def has_headings(self) -> bool:
        return any(self.headings)


def read_sheet(path: str | Path) -> Sheet:
    """Read a CSV, .csv.gz, npz or parquet file. Raises InputError with one sentence for whatever is wrong with it."""
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    if path.is_dir():
        raise InputError(
            f"{path} is a folder, where a file was expected; to convert a folder: schuler convert {path} OUT"
        )
    try:
        size = path.stat().st_size
        with path.open("rb") as f:
            head = f.read(8)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    if size == 0:
        raise InputError(f"{path.name}: the file is empty (0 bytes)")
    if head[:4] == b"PK\x03\x04":
        return _read_npz(path)
    if head[:4] == b"PAR1":
        return _read_parquet(path)
    if path.suffix.lower() in (".npz", ".parquet"):
        raise InputError(f"{path.name} does not hold what its name says: it is not a {path.suffix[1:].lower()} file")
    return parse_text(read_bytes(path), path)


def read_bytes(path: Path) -> bytes:
    """The file's bytes, decompressed where they are gzip, at most MAX_BYTES."""
    try:
        with path.open("rb") as f:
            packed = f.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if packed else path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        cut = "ends early" if isinstance(error, EOFError) else "is damaged"
        raise InputError(f"{path.name}: the compressed file {cut}; fetch or copy it again") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    if len(data) > MAX_BYTES:
        raise InputError(f"{path.name}: larger than {MAX_BYTES >> 30} GiB of text; split it, or store it as npz")
    if not data:
        raise InputError(f"{path.name}: the file is empty (0 bytes)")
    return data


# ---------------------------------------------------------------------------------------------------------------- text


def decode(data: bytes, path: Path) -> str:
    """Text of a file; InputError where it is binary."""
    for magic, what in _MAGIC:
        if data.startswith(magic):
            raise InputError(f"{path.name} is {what}, not a table; to make tables of it: schuler convert {path} OUT")
    start = data[:65536]
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return data.decode("utf-16")
        except UnicodeDecodeError:
            pass
    control = sum(start.count(bytes([c])) for c in range(32) if c not in (9, 10, 12, 13))
    if b"\x00" in start or control > 0.01 * len(start):
        raise InputError(
            f"{path.name} is binary, and of no format that can be read; readable are Seaglider and SeaExplorer files, "
            "comma2k19 folders, ULog, NMEA, MATLAB, CSV, npz and parquet"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def parse_text(data: bytes, path: Path) -> Sheet:
    """A delimited text: comma, semicolon, tab or blanks; lines that start with # or % are remarks."""
    lines = decode(data, path).splitlines()
    numbers = [i for i, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] not in "#%"]
    if not numbers:
        raise InputError(f"{path.name}: no table in it, only {'remarks' if ''.join(lines).strip() else 'blank lines'}")
    rows = [lines[i - 1] for i in numbers]
    if sum(bool(re.match(r"^[$!][A-Z]{5},", r.lstrip())) for r in rows[:20]) >= min(len(rows[:20]), 3):
        raise InputError(f"{path.name} is an NMEA log, not a table; to make tables of it: schuler convert {path} OUT")
    if max(len(r) for r in rows[:100]) > 1_000_000:
        raise InputError(f"{path.name}: a line is longer than a million characters; this is not a table")
    mark = _delimiter(rows[0], rows[-1 if len(rows) < 3 else 2])
    headings, skip = _headings(lines, numbers, rows, mark)
    rows, numbers = rows[skip:], numbers[skip:]
    if not rows:
        raise InputError(f"{path.name}: only a header line ({', '.join(h for h in headings if h)[:80]}), no rows")
    width = len(headings) or len(_fields(rows[0], mark))
    if width > MAX_COLUMNS:
        raise InputError(f"{path.name}: {width} columns; a table has at most {MAX_COLUMNS}")
    columns, kept, notes = _columns(rows, numbers, mark, width, path)
    while headings and not headings[-1] and len(columns) >= len(headings):
        if columns[-1].dtype.kind == "f" and np.isfinite(columns[-1]).any():
            break
        headings, columns = headings[:-1], columns[:-1]  # a delimiter at the end of each line
    return Sheet(path, headings or [""] * len(columns), columns, np.asarray(kept, dtype=np.int64), {}, notes)


def _delimiter(*samples: str) -> str:
    """The mark that divides the most fields in the samples; " " stands for any blanks."""
    for mark in (";", "\t", ","):
        if all(mark in s for s in samples):
            return mark
    for mark in (",", ";", "\t"):
        if mark in samples[-1]:
            return mark
    return " "


def _fields(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    if '"' in line:
        return [f.strip() for f in next(csv.reader([line], delimiter=mark))]
    return [f.strip() for f in line.split(mark)]


def _is_number(text: str) -> bool:
    if text == "":
        return True
    try:
        float(text.replace(",", "."))
    except ValueError:
        return text.lower() in MISSING
    return True


MISSING = {"na", "n/a", "null", "none", "-", "--", "nan", "nat", "?"}
_DATE = re.compile(r"^\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}([ T]|$)|^\d{1,2}:\d{2}(:\d{2})?")


def _headings(lines: list[str], numbers: list[int], rows: list[str], mark: str) -> tuple[list[str], int]:
    """(headings, how many rows they take). A remark just above the numbers may hold them; a line of units too."""
    first = _fields(rows[0], mark)
    words = [f for f in first if not _is_number(f)]
    if not words or all(_DATE.match(w) for w in words):
        above = lines[: numbers[0] - 1]
        remark = re.sub(r"^\s*[#%]+\s*", "", above[-1]) if above else ""
        names = _fields(remark, mark)
        if mark == "," and len(names) == 1 and "," not in remark:
            names = remark.split()
        if len(names) == len(first) and sum(not _is_number(n) for n in names) == len(names):
            return names, 0
        return [], 0
    if len(words) < len(first) / 2 and len(rows) > 1:
        again = [f for f in _fields(rows[1], mark) if not _is_number(f)]
        if len(again) == len(words):  # every row has words, as many as the first one
            return [], 0
    if mark == " " and len(rows) > 1 and len(first) != len(_fields(rows[1], mark)):
        joined = [f.strip() for f in re.split(r"\s{2,}|\t", rows[0].strip())]
        if len(joined) == len(_fields(rows[1], mark)):
            first = joined
    taken = 1
    if len(rows) > 2:
        second = _fields(rows[1], mark)
        units = [f.strip("[]() ") for f in second]
        if len(second) == len(first) and all(not _is_number(u) or not u for u in units) and any(units):
            if not any(_DATE.match(u) for u in units) and all(_is_number(f) for f in _fields(rows[2], mark)):
                first = [n if "[" in n or not u else f"{n}[{u}]" for n, u in zip(first, units, strict=True)]
                taken = 2
    return first, taken


def _columns(
    rows: list[str], numbers: list[int], mark: str, width: int, path: Path
) -> tuple[list[NDArray], list[int], list[str]]:
    """Columns of the rows that have `width` fields, their line numbers, and notes about the others."""
    try:
        block = np.loadtxt(rows, delimiter=None if mark == " " else mark, comments=None, ndmin=2, dtype=np.float64)
        if block.shape[1] == width:
            return list(np.ascontiguousarray(block.T)), numbers, []
    except ValueError:
        pass  # empty fields, words or ragged rows: the slower way below says which
    split = [_fields(r, mark) for r in rows]
    if all(len(s) == width + 1 and s[-1] == "" for s in split):
        split = [s[:-1] for s in split]
    notes: list[str] = []
    wrong = [i for i, s in enumerate(split) if len(s) != width]
    if wrong:
        if wrong == [len(split) - 1] and len(split) > 1 and len(split[-1]) < width:
            notes.append(
                f"{path.name}: the last line ({numbers[-1]}) is cut off, {len(split[-1])} of {width} columns; left out"
            )
        elif len(wrong) <= max(2, 0.01 * len(split)) and len(wrong) < len(split):
            some = ", ".join(str(numbers[i]) for i in wrong[:3])
            notes.append(f"{path.name}: {counted(len(wrong), 'row')} without {width} columns left out (line {some})")
        else:
            i = wrong[0]
            others = f" ({counted(len(wrong) - 1, 'more line')} like it)" if len(wrong) > 1 else ""
            raise InputError(
                f"{path.name}: line {numbers[i]} has {counted(len(split[i]), 'column')} where {width} were "
                f"expected{others}; "
                "every row needs the same columns"
            )
        gone = set(wrong)
        split = [s for i, s in enumerate(split) if i not in gone]
        numbers = [n for i, n in enumerate(numbers) if i not in gone]
    comma = mark == ";"
    return [column_of(cells, decimal_comma=comma) for cells in zip(*split, strict=True)], numbers, notes


def counted(count: int, noun: str) -> str:
    """1 row, 2 rows."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def column_of(cells: Sequence[str], decimal_comma: bool = False) -> NDArray:
    """float64 where most cells are numbers (others become NaN), else str."""
    try:
        return np.array([c or "nan" for c in cells], dtype=np.float64)
    except ValueError:
        pass
    values = np.full(len(cells), np.nan)
    words = 0
    for i, cell in enumerate(cells):
        text = cell.replace(",", ".") if decimal_comma else cell
        try:
            values[i] = float(text)
        except ValueError:
            words += text.lower() not in MISSING and text != ""
    return values if words <= 0.1 * len(cells) else np.array(cells, dtype=np.str_)


# -------------------------------------------------------------------------------------------------------------- binary


def spread(arrays: dict[str, Any], path: Path, notes: list[str]) -> Sheet:
    """A sheet from named arrays: (n,) columns, (n, k) as k columns `name_0` ..., single numbers as scalars."""
    scalars: dict[str, float] = {}
    lengths: dict[int, int] = {}
    single = {k for k, a in arrays.items() if a.ndim == 0 or a.size == 1}
    if len(single) == len(arrays):
        single = {k for k in single if arrays[k].ndim == 0}  # a table of one row
    for name, a in arrays.items():
        if name in single:
            if a.dtype.kind in "fiub":
                scalars[name] = float(a.reshape(-1)[0])
        elif a.dtype.kind in "fiubUSM":
            lengths[a.shape[0]] = lengths.get(a.shape[0], 0) + (a.shape[1] if a.ndim > 1 else 1)
    if not lengths:
        raise InputError(f"{path.name}: no columns in it (arrays of one length, one a column)")
    rows = max(lengths, key=lambda n: (lengths[n], n))
    if rows == 0:
        raise InputError(f"{path.name}: its columns are empty, no rows")
    headings: list[str] = []
    columns: list[NDArray] = []
    for name, a in arrays.items():
        if name in single or a.dtype.kind not in "fiubUSM":
            continue
        if a.shape[0] != rows or a.ndim > 2:
            notes.append(f"{path.name}: {name} has shape {a.shape}, not {rows} rows; left out")
            continue
        if a.dtype.kind == "M":
            a = a.astype("datetime64[ns]").astype(np.int64) / 1e9
        a = a.astype(np.str_) if a.dtype.kind in "US" else a.astype(np.float64)
        if a.ndim == 1:
            headings.append(name)
            columns.append(a)
        else:
            base, unit = split_header(name)
            tail = f"[{unit}]" if unit else ""
            headings += [f"{base}_{k}{tail}" for k in range(a.shape[1])]
            columns += list(np.ascontiguousarray(a.T))
    return Sheet(path, headings, columns, np.arange(1, rows + 1), scalars, notes)


def _read_npz(path: Path) -> Sheet:
    try:
        with zipfile.ZipFile(path) as z:
            if not any(n.endswith(".npy") for n in z.namelist()):
                raise InputError(f"{path.name} is a zip archive, not an npz; unpack it first")
            if sum(i.file_size for i in z.infolist()) > MAX_BYTES:
                raise InputError(f"{path.name}: its arrays are larger than {MAX_BYTES >> 30} GiB")
        with np.load(path, allow_pickle=False) as z:
            arrays = {}
            notes = []
            for name in z.files:
                try:
                    arrays[name] = z[name]
                except ValueError:
                    notes.append(f"{path.name}: {name} holds Python objects, which are never read; left out")
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, OSError, KeyError):
        raise InputError(f"{path.name}: the npz file is damaged or cut off; fetch or write it again") from None
    return spread(arrays, path, notes)


def _read_parquet(path: Path) -> Sheet:
    try:
        import pyarrow
        import pyarrow.parquet as pq
    except ImportError:
        raise InputError(f'{path.name}: reading parquet needs pyarrow; type: pip install "schuler[io]"') from None
    try:
        meta = pq.read_metadata(path)
        if sum(meta.row_group(i).total_byte_size for i in range(meta.num_row_groups)) > MAX_BYTES:
            raise InputError(f"{path.name}: its columns are larger than {MAX_BYTES >> 30} GiB")
        table = pq.read_table(path)
    except (pyarrow.ArrowException, OSError):
        raise InputError(f"{path.name}: the parquet file is damaged or cut off; fetch or write it again") from None
    arrays = {}
    for name in table.column_names:
        kind = table.schema.field(name).type
        column = table[name]
        if pyarrow.types.is_timestamp(kind):
            arrays[name] = column.cast(pyarrow.timestamp("ns")).to_numpy()
        elif pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind) or pyarrow.types.is_boolean(kind):
            arrays[name] = column.cast(pyarrow.float64()).to_numpy().reshape(-1)
        else:
            arrays[name] = np.array([str(v) for v in column.to_pylist()], dtype=np.str_)
    return spread(arrays, path, [])
