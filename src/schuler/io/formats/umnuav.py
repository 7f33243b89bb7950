"""Flight data of the University of Minnesota UAV laboratory, as AuraUAS keeps it: one table with a row a frame (50 Hz).

Columns: time s; p q r rad/s; ax ay az m/s^2; lat lon deg, alt m, vn ve vd m/s, GPS_TOW s (held between fixes); h m
(barometer), ias m/s; navlat navlon rad, navalt m, navvn navve navvd, phi theta psi rad (the on-board filter). Body axes
are forward-right-down.

A fix is new where GPS_TOW changes; rows before the first are placeholders. The frame's time is the clock of all tables.
The magnetometer (hx hy hz) is not calibrated and left out. The on-board filter has seen the same sensors and is no
reference: `onboard` gives its track for a look.
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.io.formats.common import joined, need, numbered, whole_rows, wrapped
from schuler.io.sheets import read_sheet

Array = NDArray[np.float64]
MARKS = ("GPS_TOW", "p", "q", "r", "ax", "ay", "az", "lat", "lon", "alt", "vn", "ve", "vd")
FLYING = 5.0  # m/s over ground: faster than anybody carries it


def recognise(path: Path) -> bool:
    """A csv whose first line names these columns, or a folder with exactly one."""
    return _file(path) is not None


def _file(path: Path) -> Path | None:
    if path.is_dir():
        found = [p for p in sorted(path.iterdir()) if _is_flight(p)]
        return found[0] if len(found) == 1 else None
    return path if _is_flight(path) else None


def _is_flight(path: Path) -> bool:
    if not path.is_file() or not path.name.lower().endswith((".csv", ".csv.gz")):
        return False
    try:
        with path.open("rb") as f:
            packed = f.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if packed else path.open("rb") as stream:
            first = stream.readline(4096).decode("utf-8", "replace")
    except (OSError, EOFError, zlib.error):
        return False
    return {"time", *MARKS} <= {w.strip() for w in first.split(",")}


def convert(path: Path) -> dict[str, Table]:
    """Tables imu, gnss, and height and speed where their columns are there. Raises InputError."""
    raw, source = _read(path)
    notes: list[str] = []
    tables = {"imu": Table("imu", _imu(raw, notes), "rates", source)}
    tables["gnss"] = Table("gnss", _fixes(raw, source, notes), source=source)
    for column, name, what in (("h", "height", "barometer"), ("ias", "speed", "airspeed, not over ground")):
        if column in raw and raw[column].dtype.kind == "f":
            rows = joined([whole_rows({"time": raw["time"], name: raw[column]}, name, notes)], name, notes)
            tables[name] = Table(name, rows, source=source)
            notes.append(f"{name}: {column}, {what}")
    notes.append(
        "not used: the magnetometer, which is not calibrated, and the on-board filter, which saw the same data"
    )
    for table in tables.values():
        table.notes = notes
    return tables


def onboard(path: Path) -> Table:
    """Table reference of the on-board filter, where it was running: not independent of the sensors."""
    raw, source = _read(path)
    need(raw, "navlat navlon navalt navvn navve navvd phi theta psi", Path(source))
    rows = {
        "time": raw["time"],
        "lat": raw["navlat"],
        "lon": raw["navlon"],
        "height": raw["navalt"],
        "v_north": raw["navvn"],
        "v_east": raw["navve"],
        "v_down": raw["navvd"],
        "roll": raw["phi"],
        "pitch": raw["theta"],
        "heading": wrapped(raw["psi"]),
    }
    running = (raw["navlat"] != 0.0) | (raw["navlon"] != 0.0)
    notes = ["reference: the on-board filter's own track; it saw the same sensors"]
    rows = joined([whole_rows({n: v[running] for n, v in rows.items()}, "reference", notes)], "reference", notes)
    return Table("reference", rows, source=source, notes=notes)


def airborne(gnss: Table) -> tuple[float, float] | None:
    """First and last time, s, of the longest stretch over FLYING m/s, slower moments of up to 10 s within; or None."""
    fast = gnss.time[np.hypot(gnss["v_north"], gnss["v_east"]) > FLYING]
    if len(fast) < 2:
        return None
    cuts = np.flatnonzero(np.diff(fast) > 10.0)
    starts, ends = np.concatenate([[0], cuts + 1]), np.concatenate([cuts, [len(fast) - 1]])
    k = int(np.argmax(fast[ends] - fast[starts]))
    return float(fast[starts[k]]), float(fast[ends[k]])


def _read(path: Path) -> tuple[dict[str, NDArray], str]:
    file = _file(path)
    if file is None:
        raise InputError(f"{path}: no single table with the columns {', '.join(MARKS)}")
    raw = numbered(read_sheet(file))
    need(raw, "time " + " ".join(MARKS), file)
    return raw, str(file)


def _imu(raw: dict[str, NDArray], notes: list[str]) -> dict[str, Array]:
    rows = {"time": raw["time"]}
    rows |= {f"gyro_{a}": raw[n] for a, n in zip("xyz", "pqr", strict=True)}
    rows |= {f"accel_{a}": raw[f"a{a}"] for a in "xyz"}
    silent = np.all([rows[f"accel_{a}"] == 0.0 for a in "xyz"], axis=0)
    if silent.any():
        notes.append(f"imu: {int(silent.sum())} rows in which the accelerometers say exactly nothing left out")
        rows = {n: v[~silent] for n, v in rows.items()}
    notes.append("imu: forward-right-down")
    return joined([whole_rows(rows, "imu", notes)], "imu", notes)


def _fixes(raw: dict[str, NDArray], source: str, notes: list[str]) -> dict[str, Array]:
    tow = raw["GPS_TOW"]
    new = np.concatenate([[tow[0] > 0.0], np.diff(tow) != 0.0]) & (tow > 0.0)
    if not new.any():
        raise InputError(f"{Path(source).name}: GPS_TOW never changes, so there is no fix in it")
    rows = {"time": raw["time"], "lat": raw["lat"] * DEG, "lon": raw["lon"] * DEG, "height": raw["alt"]}
    rows |= {"v_north": raw["vn"], "v_east": raw["ve"], "v_down": raw["vd"]}
    notes.append(f"gnss: {int(new.sum())} rows in which GPS_TOW is new; stamps are the frame's, later than the fix")
    return joined([whole_rows({n: v[new] for n, v in rows.items()}, "gnss", notes)], "gnss", notes)
