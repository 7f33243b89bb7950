"""MATLAB files (version 5 to 7.2) to tables: variables named like columns, or structures named like tables.

NaveGo's structures are known: `imu` (t, fb, wb), `gnss` or `gps` (t, lat, lon, h, vel, stdm, stdv) and `ref` (t, lat,
lon, h, vel, roll, pitch, yaw); their angles are radians.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler.ground.errors import InputError
from schuler.ground.tables import SCHEMAS, Table
from schuler.io.formats import generic
from schuler.io.sheets import MAX_BYTES, spread
from schuler.io.tables import ReadOptions, table_of

_RADIANS = ("lat", "lon", "roll", "pitch", "yaw")


def recognise(path: Path) -> bool:
    """A file named .mat."""
    return path.is_file() and path.suffix.lower() == ".mat"


def convert(
    path: Path, gyro_unit: str | None = None, accel_unit: str | None = None, table: str | None = None, **options: Any
) -> dict[str, Table]:
    """The tables of a MAT file. Raises InputError."""
    settings = ReadOptions(gyro_unit=gyro_unit, accel_unit=accel_unit, **options)
    variables = load(path)
    structures = {k: v for k, v in variables.items() if isinstance(v, dict)}
    out: dict[str, Table] = {}
    for name, fields in structures.items():
        kind = _kind(name)
        if kind is None or kind in out or (table and table != kind):
            continue
        notes: list[str] = []
        arrays = {k: v for k, v in _arrays(fields).items() if v.ndim <= 2}
        navego = kind == "imu" and {"fb", "wb"} <= fields.keys() or kind != "imu" and {"lat", "vel"} <= fields.keys()
        if navego:
            arrays = {f"{k}[rad]" if k in _RADIANS else k: v for k, v in arrays.items()}
        rows = max((len(v) for v in arrays.values() if v.ndim), default=0)
        arrays = {k: v for k, v in arrays.items() if v.ndim == 0 or len(v) == rows or v.size == 1}
        if navego:
            notes.append(f"{path.name}: {name} is a NaveGo structure; its angles are radians")
        out[kind] = table_of(spread(arrays, path, notes), kind, settings)
    arrays = _arrays({k: v for k, v in variables.items() if not isinstance(v, dict)})
    if not out and arrays:
        sheet = spread(arrays, path, [])
        names = [table] if table else generic.tables_in(sheet)
        for name in names:
            out[name] = table_of(sheet, name, settings)
    if not out:
        have = ", ".join(variables) or "nothing"
        raise InputError(
            f"{path.name}: its variables ({have[:200]}) make no table; name them like columns (time, gyro_x, ...) or "
            "put "
            f"them into structures named {', '.join(list(SCHEMAS)[:4])}, ..."
        )
    return out


def _kind(name: str) -> str | None:
    """The table that a structure is named after: imu1, gnss_data, gps, ref, truth."""
    plain = name.lower()
    if plain.startswith(("gnss", "gps")):
        return "gnss"
    if plain.startswith(("ref", "truth")):
        return "reference"
    return next((t for t in SCHEMAS if plain.startswith(t)), None)


def _arrays(fields: dict[str, Any]) -> dict[str, np.ndarray]:
    """Numeric fields; column and row vectors made one-dimensional."""
    out = {}
    for name, value in fields.items():
        a = np.asarray(value)
        if a.dtype.kind not in "fiub" or a.size == 0:
            continue
        if a.ndim == 2 and 1 in a.shape:
            a = a.reshape(-1)
        if a.ndim == 2 and a.shape[0] == 3 and a.shape[1] > 3:
            a = a.T
        out[name] = a
    return out


def load(path: Path) -> dict[str, Any]:
    """Variables by name; structures as dictionaries. InputError for a damaged file or version 7.3."""
    from scipy.io import loadmat

    try:
        head = path.read_bytes()[:128]
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    if not head:
        raise InputError(f"{path.name}: the file is empty (0 bytes)")
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path.name}: larger than {MAX_BYTES >> 30} GiB")
    if head.startswith(b"\x89HDF") or b"MATLAB 7.3" in head:
        raise InputError(f"{path.name} is a MATLAB 7.3 file; save it with  save -v7  (version 5 to 7.2 can be read)")
    try:
        found = loadmat(str(path), simplify_cells=True)
    except Exception:  # scipy raises many kinds for damaged files
        raise InputError(f"{path.name}: the MATLAB file is damaged or cut off") from None
    return {k: v for k, v in found.items() if not k.startswith("__")}
