"""A trial of the BROAD benchmark (Laidig et al. 2021, Data 6(7)): hand-moved 9-axis IMU, optical attitude, as .npz.

Names in the file: imu_gyr rad/s, imu_acc m/s^2, imu_mag uT (n, 3); opt_quat (n, 4), scalar first, turns sensor vectors
into magnetic ENU; sampling_rate Hz; movement (n,), the rows that are scored.

The sensor's z axis points up where it lies flat. The tables are in forward-right-down axes: y and z change sign. The
reference holds the scored rows whose markers were seen; it has no position. Its heading counts from magnetic north.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_quat, euler_from_dcm
from schuler.ground.tables import Table
from schuler.io.formats.common import wrapped

NEEDED = ("imu_gyr", "imu_acc", "opt_quat", "sampling_rate")
NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FLIP = np.diag([1.0, -1.0, -1.0])  # forward-left-up to forward-right-down
_BROKEN = (OSError, ValueError, EOFError, BadZipFile, zlib.error, AttributeError)


def recognise(path: Path) -> bool:
    """An .npz with the names above."""
    if not path.is_file() or path.suffix.lower() != ".npz":
        return False
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            return set(NEEDED) <= set(file.files)
    except _BROKEN:
        return False


def convert(path: Path) -> dict[str, Table]:
    """Tables imu (with the magnetometer) and reference (attitude only). Raises InputError."""
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            held = {name: np.asarray(file[name]) for name in file.files}
            held = {name: v.astype(np.float64) for name, v in held.items() if v.dtype.kind in "fbiu"}
    except _BROKEN as error:
        raise InputError(f"{path.name} cannot be read as .npz: {error}") from None
    absent = [n for n in NEEDED if n not in held]
    if absent:
        raise InputError(f"{path.name}: {', '.join(absent)} missing; a BROAD trial has them")
    rate, n = float(held["sampling_rate"].reshape(-1)[0]), len(held["imu_gyr"])
    held = {name: v.reshape(-1) if name == "movement" else v for name, v in held.items()}
    shapes = {"imu_gyr": (n, 3), "imu_acc": (n, 3), "opt_quat": (n, 4), "imu_mag": (n, 3), "movement": (n,)}
    for name, shape in shapes.items():
        if name in held and held[name].shape != shape:
            raise InputError(f"{path.name}: {name} has shape {held[name].shape} where {shape} belongs")
    if not rate > 0.0:
        raise InputError(f"{path.name}: sampling_rate is {rate:g}; a rate in Hz belongs there")
    notes = [f"time made of the rate, {rate:.6g} Hz; axes turned to forward-right-down (y and z change sign)"]
    time = np.arange(1, n + 1) / rate
    columns = {"time": time}
    for stem, name, scale in (("gyro", "imu_gyr", 1.0), ("accel", "imu_acc", 1.0), ("mag", "imu_mag", 1e-6)):
        if name in held:
            turned = held[name] @ FLIP * scale
            columns |= {f"{stem}_{a}": np.ascontiguousarray(turned[:, i]) for i, a in enumerate("xyz")}
    needed = np.column_stack([v for k, v in columns.items() if not k.startswith("mag")])
    whole = np.isfinite(needed).all(axis=1)
    if not whole.any():
        raise InputError(f"{path.name}: no row has numbers in all gyro and accelerometer columns")
    if not whole.all():
        notes.append(f"imu: {int((~whole).sum())} of {n} rows without a value left out")
    scored = np.isfinite(held["opt_quat"]).all(axis=1) & (np.linalg.norm(held["opt_quat"], axis=1) > 0.5)
    if "movement" in held:
        scored &= held["movement"] > 0.5
        notes.append(f"reference: the {int(scored.sum())} scored rows (movement) whose markers were seen")
    imu = Table("imu", {k: v[whole] for k, v in columns.items()}, "rates", str(path), notes)
    if not scored.any():
        return {"imu": imu}
    q = held["opt_quat"][scored]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    roll, pitch, heading = euler_from_dcm(NED_ENU @ dcm_from_quat(q) @ FLIP)
    attitude = {"time": time[scored], "roll": roll, "pitch": pitch, "heading": wrapped(heading)}
    return {"imu": imu, "reference": Table("reference", attitude, source=str(path), notes=notes)}
