"""NMEA 0183 logs to a gnss table: GGA, GNS, RMC, GLL for the place, RMC and VTG for velocity, GST for sigmas.

Sentences with a bad checksum are left out and counted, other bytes in between (UBX, text) are passed over. Time is Unix
time where a sentence tells the date (RMC, ZDA), else seconds of the day, run on over midnight. Height is the
ellipsoid's: altitude above mean sea level plus the separation that the receiver tells.
"""

from __future__ import annotations

import gzip
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.units import DEG, KNOT
from schuler.io.sheets import counted, read_bytes

_SENTENCE = re.compile(rb"\$[A-Z]{2}(GGA|GNS|RMC|GLL|VTG|GST|ZDA),[\x20-\x7e]*?\*[0-9A-Fa-f]{2}")
_ANY = re.compile(rb"[$!][A-Z]{4,6},[\x20-\x7e]*?\*[0-9A-Fa-f]{2}")
_NAN = float("nan")


@dataclass
class Epoch:
    """What the sentences of one time of day said; SI and radians, NaN where nothing did."""

    second: float  # of the day
    date: float = _NAN  # Unix seconds of that day's midnight
    lat: float = _NAN
    lon: float = _NAN
    height: float = _NAN
    v_north: float = _NAN
    v_east: float = _NAN
    std_north: float = _NAN
    std_east: float = _NAN
    std_down: float = _NAN
    rank: int = 0  # of the sentence that gave the place: GGA before GNS before RMC before GLL
    valid: bool = False


_RANK = {"GGA": 4, "GNS": 3, "RMC": 2, "GLL": 1}


def recognise(path: Path) -> bool:
    """A file with NMEA sentences in its first 64 kB."""
    if not path.is_file() or path.name.lower().endswith((".npz", ".parquet", ".nc", ".mat", ".ulg")):
        return False
    try:
        with path.open("rb") as f:
            packed = f.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if packed else path.open("rb") as f:
            head = f.read(65536)
    except (OSError, EOFError, zlib.error):
        return False
    return bool(_ANY.search(head))


def convert(path: Path) -> dict[str, Table]:
    """Table gnss of a log. Raises InputError where it holds no valid fix."""
    try:
        from pynmeagps import NMEAReader
        from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEATypeError
    except ImportError:
        raise InputError(f'{path.name}: reading NMEA needs pynmeagps; type: pip install "schuler[io]"') from None
    data = read_bytes(path)
    epochs: list[Epoch] = []
    bad = used = 0
    for found in _SENTENCE.finditer(data):
        try:
            message = NMEAReader.parse(found[0] + b"\r\n")
        except (NMEAParseError, NMEAMessageError, NMEATypeError, ValueError, TypeError):
            bad += 1
            continue
        used += 1
        _take(epochs, found[1].decode(), message)
    others = len(_ANY.findall(data)) - used - bad
    if not used:
        why = (
            f"{counted(bad, 'position sentence')} with a bad checksum"
            if bad
            else f"{counted(others, 'sentence')}, none of them GGA, RMC or like"
        )
        raise InputError(f"{path.name}: no fix in this NMEA log ({why})")
    notes = [
        f"{path.name}: {counted(used, 'sentence')} read" + (f", {bad} with a bad checksum left out" if bad else "")
    ]
    time, dated = _times(epochs)
    notes.append(
        "time is Unix time (UTC)"
        if dated
        else "no sentence tells the date: time is seconds of the day (UTC), run on over midnight"
    )
    keep, last = [], -np.inf
    for i, e in enumerate(epochs):
        if e.valid and np.isfinite(e.lat) and np.isfinite(e.lon) and time[i] > last:
            keep.append(i)
            last = time[i]
    stale = sum(e.valid and np.isfinite(e.lat) for e in epochs) - len(keep)
    if stale:
        notes.append(f"{stale} of the fixes left out, not later than the one before them")
    lost = sum(not e.valid for e in epochs)
    if lost:
        notes.append(f"{lost} epochs without a valid fix")
    if not keep:
        raise InputError(f"{path.name}: no valid fix in this NMEA log ({len(epochs)} epochs)")
    columns = {"time": time[keep]}
    for name in ("lat", "lon", "height", "std_north", "std_east", "std_down", "v_north", "v_east"):
        values = np.array([getattr(epochs[i], name) for i in keep], dtype=np.float64)
        if np.isfinite(values).any():
            columns[name] = values
    if "height" not in columns:
        notes.append("no sentence tells the height")
    if "std_north" not in columns:
        notes.append("no GST sentence tells sigmas: [noise] gnss_m of the study counts")
    return {"gnss": Table("gnss", columns, source=str(path), notes=notes)}


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return _NAN


def _take(epochs: list[Epoch], kind: str, m: Any) -> None:
    """One sentence into the epoch that it belongs to; a new time of day opens one."""
    when = getattr(m, "time", None)
    if when is not None and hasattr(when, "hour"):
        second = when.hour * 3600.0 + when.minute * 60.0 + when.second + when.microsecond * 1e-6
        if not epochs or epochs[-1].second != second:
            epochs.append(Epoch(second))
    elif kind != "VTG":
        return
    if not epochs:
        return
    e = epochs[-1]
    if kind == "ZDA":
        day, month, year = (int(_number(getattr(m, n, 0)) or 0) for n in ("day", "month", "year"))
        if year > 1979 and 1 <= month <= 12 and 1 <= day <= 31:
            e.date = _midnight(year, month, day)
        return
    if kind == "RMC" and hasattr(getattr(m, "date", None), "year"):
        e.date = _midnight(m.date.year, m.date.month, m.date.day)
    if kind == "GST":
        e.std_north, e.std_east, e.std_down = (_positive(getattr(m, n, "")) for n in ("stdLat", "stdLong", "stdAlt"))
        return
    if kind in ("RMC", "VTG"):
        speed = _number(m.spd if kind == "RMC" else m.sogn) * KNOT
        course = _number(m.cog if kind == "RMC" else m.cogt) * DEG
        if np.isfinite(speed) and np.isfinite(course):
            e.v_north, e.v_east = float(speed * np.cos(course)), float(speed * np.sin(course))
        if kind == "VTG":
            return
    ok = {
        "GGA": lambda: int(_number(m.quality) or 0) > 0,
        "GNS": lambda: any(c in "ADPRFE" for c in str(m.posMode)),
        "RMC": lambda: m.status == "A",
        "GLL": lambda: m.status == "A",
    }[kind]()
    lat, lon = _number(m.lat), _number(m.lon)
    if not ok or not (np.isfinite(lat) and np.isfinite(lon)) or abs(lat) > 90.0 or abs(lon) > 180.0:
        return
    e.valid = True
    if _RANK[kind] > e.rank:
        e.rank, e.lat, e.lon = _RANK[kind], lat * DEG, lon * DEG
        if kind in ("GGA", "GNS"):
            height = _number(m.alt) + _number(m.sep)
            e.height = height if np.isfinite(height) else _number(m.alt)


def _positive(value: Any) -> float:
    number = _number(value)
    return number if number > 0.0 else _NAN


def _midnight(year: int, month: int, day: int) -> float:
    return float(np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "s").astype(np.int64))


def _times(epochs: list[Epoch]) -> tuple[np.ndarray, bool]:
    """Time of each epoch and whether a date is in it. A dated epoch sets the day for those around it."""
    midnight = np.full(len(epochs), _NAN)
    for order in (range(len(epochs)), range(len(epochs) - 1, -1, -1)):
        before = None
        for i in order:
            e = epochs[i]
            if np.isfinite(e.date):
                midnight[i] = e.date
            elif before is not None and np.isnan(midnight[i]) and np.isfinite(midnight[before]):
                turn = e.second - epochs[before].second
                midnight[i] = midnight[before] - (86400.0 * np.sign(turn) if abs(turn) > 43200.0 else 0.0)
            before = i
    seconds = np.array([e.second for e in epochs])
    if np.isfinite(midnight).any():
        return np.where(np.isfinite(midnight), midnight, np.nanmax(midnight)) + seconds, True
    wraps = np.cumsum(np.concatenate([[0.0], (np.diff(seconds) < -43200.0).astype(float)]))
    return seconds + 86400.0 * wraps, False
