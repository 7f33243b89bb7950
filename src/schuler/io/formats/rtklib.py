"""RTKLIB: a solution file (.pos), and the log of an IMU that was recorded through its stream server with a time tag.

Solution: `%` lines are the heading, the last of them names the columns. Time is a calendar or week and seconds of week,
in GPST or UTC; places are degrees, degrees-minutes-seconds or ECEF. `vd` counts down, `vu` up; both become `v_down`.

IMU log: rows `ax, ay, az [g], gx, gy, gz [deg/s], ms since power-up`, and beside NAME the time tag NAME.tag: 64 bytes
of text with the tick of the start in the last four, the start (uint32 s, float64 s, GPST counted like Unix time), then
pairs (uint32 ms after the start, uint32 bytes of the log written by then). The tag tells when rows arrived; a straight
line through arrival against the sensor's own milliseconds gives their times, so jitter of the arrival is not in them.

The clock of all tables is GPS seconds since 1980-01-06.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import geodetic_from_ecef
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.times import gps_from_unix, gps_from_week
from schuler.ground.units import DEG, G0
from schuler.io.formats.common import joined
from schuler.io.sheets import counted, decode, read_bytes

Array = NDArray[np.float64]
GPS_EPOCH = 315964800.0  # 1980-01-06 counted like Unix time
QUALITY = {1: "fixed", 2: "float", 3: "SBAS", 4: "DGPS", 5: "single", 6: "PPP"}
_DAY = re.compile(r"(\d{4})/(\d{1,2})/(\d{1,2})$")
_TAG = struct.Struct("<60sIId")
_FEW = 10  # rows of an IMU log


def recognise(path: Path) -> bool:
    """A .pos file, or a folder with one and no tables by name. An IMU log alone looks like any other table."""
    if path.is_dir():
        names = {p.name.partition(".")[0].lower() for p in path.iterdir()}
        return not {"imu", "gnss"} & names and bool(_solutions(path))
    return _is_solution(path)


def _is_solution(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith((".pos", ".pos.gz"))


def _solutions(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if _is_solution(p))


def tag_of(path: Path) -> Path | None:
    """The time tag beside a log; the log itself may be compressed."""
    for name in (path.name, path.name.removesuffix(".gz")):
        if not name.endswith(".tag") and (path.parent / f"{name}.tag").is_file():
            return path.parent / f"{name}.tag"
    return None


def convert(path: Path) -> dict[str, Table]:
    """Table gnss of a solution, imu of a tagged log, both of a folder. Raises InputError."""
    if path.is_file():
        return {"imu": imu_log(path)} if tag_of(path) is not None else {"gnss": solution(path)}
    found = _solutions(path)
    logs = sorted(p for p in path.iterdir() if p.name.endswith((".csv", ".csv.gz")) and tag_of(p) is not None)
    for what, files in (("solution files", found), ("IMU logs", logs)):
        if len(files) > 1:
            names = ", ".join(p.name for p in files)
            raise InputError(f"{path}: {len(files)} {what} ({names}); convert the one that is meant by its own name")
    if not found:
        raise InputError(f"{path}: no RTKLIB solution (.pos) in it")
    tables = {"gnss": solution(found[0])}
    if logs:
        tables["imu"] = imu_log(logs[0])
    return tables


# ------------------------------------------------------------------------------------------------------------ solution


def solution(path: Path) -> Table:
    """Table gnss of a .pos file."""
    head, rows, bad = _split(decode(read_bytes(path), path))
    labels = _labels(head)
    if not labels:
        raise InputError(f"{path.name}: no line of the heading (%) names the columns; is it an RTKLIB solution?")
    if not rows:
        raise InputError(f"{path.name}: no solution in this file, only its heading")
    words = [_DAY.match(r[0]) is not None for r in rows]
    calendar = sum(words) > len(rows) / 2
    names = ["day", "clock", *labels[1:]] if calendar else ["week", "tow", *labels[1:]]
    if "latitude(d'\")" in labels:
        names = _degrees_minutes(names)
    width = len(names)
    good = [r for r, w in zip(rows, words, strict=True) if len(r) >= width and w == calendar]
    notes: list[str] = []
    bad += len(rows) - len(good)
    columns, more = _numbers(good, names, calendar)
    bad += more
    if not len(columns["time"]):
        raise InputError(f"{path.name}: no row has the {width} columns that its heading names ({' '.join(labels)})")
    if bad:
        notes.append(f"{path.name}: {counted(bad, 'row')} cut off or without numbers left out")
    if labels[0] == "UTC":
        columns["time"] = gps_from_unix(columns["time"] + GPS_EPOCH)
    elif labels[0] != "GPST":
        notes.append(f"{path.name}: time is {labels[0]}, taken as if it were GPST")
    out = {"time": columns["time"], **_place(columns, path), **_velocity(columns), **_sigma(columns)}
    if any("geodetic" in line for line in head):
        notes.append(f"{path.name}: heights are above the geoid, not the ellipsoid, as the heading says")
    notes.append(f"{path.name}: time is GPS seconds since 1980-01-06")
    if "Q" in columns:
        kinds, number = np.unique(columns["Q"].astype(int), return_counts=True)
        each = ", ".join(f"{n} {QUALITY.get(int(k), f'Q={k}')}" for k, n in zip(kinds, number, strict=True))
        notes.append(f"{path.name}: {each}")
    return Table("gnss", joined([out], path.name, notes), source=str(path), notes=notes)


def _split(text: str) -> tuple[list[str], list[list[str]], int]:
    """Heading lines, rows as words, and rows of fewer than five words."""
    head, rows, bad = [], [], 0
    for line in text.splitlines():
        if line.startswith("%"):
            head.append(line)
        elif line.strip():
            words = re.split(r"[\s,;]+", line.strip())
            if len(words) > 4:
                rows.append(words)
            else:
                bad += 1
    return head, rows, bad


def _labels(head: list[str]) -> list[str]:
    """Names of the columns, the time system first; [] where no line names them."""
    for line in reversed(head):
        words = re.split(r"[\s,;]+", line.lstrip("%").strip())
        if words and words[0] in ("GPST", "UTC", "JST"):
            return [words[0], *(re.sub(r"\((?!d').*", "", w) for w in words[1:])]
    return []


def _degrees_minutes(names: list[str]) -> list[str]:
    """latitude(d'") stands for three columns."""
    out = []
    for n in names:
        stem = n.partition("(")[0]
        out += [f"{stem}:{k}" for k in "dms"] if n.endswith("(d'\")") else [n]
    return out


def _numbers(rows: list[list[str]], names: list[str], calendar: bool) -> tuple[dict[str, Array], int]:
    """Columns as numbers with "time" in GPS seconds of the file's own time system; how many rows had other words."""
    values = np.full((len(rows), len(names)), np.nan)
    for i, row in enumerate(rows):
        try:
            start = _second(row[0], row[1]) if calendar else None
            values[i, 2:] = [float(w) for w in row[2 : len(names)]]
            values[i, :2] = (0.0, start) if start is not None else (float(row[0]), float(row[1]))
        except ValueError:
            continue
    known = np.isfinite(values).all(axis=1)
    values = values[known]
    columns = {n: values[:, k].copy() for k, n in enumerate(names)}
    columns["time"] = columns["clock"] if calendar else gps_from_week(columns["week"].astype(int), columns["tow"])
    return columns, int((~known).sum())


def _second(day: str, clock: str) -> float:
    """Seconds since 1980-01-06 of a calendar day and a time of day. ValueError where it is none."""
    d = _DAY.match(day)
    hour, minute, second = clock.split(":")
    if d is None:
        raise ValueError(day)
    midnight = np.datetime64(f"{d[1]}-{int(d[2]):02d}-{int(d[3]):02d}", "s").astype(np.int64)
    return float(midnight) - GPS_EPOCH + 3600.0 * int(hour) + 60.0 * int(minute) + float(second)


def _place(c: dict[str, Array], path: Path) -> dict[str, Array]:
    if "latitude" in c:
        return {"lat": c["latitude"] * DEG, "lon": c["longitude"] * DEG, "height": c["height"]}
    if "latitude:d" in c:
        lat, lon = (
            np.copysign(np.abs(c[f"{n}:d"]) + c[f"{n}:m"] / 60.0 + c[f"{n}:s"] / 3600.0, c[f"{n}:d"])
            for n in ("latitude", "longitude")
        )
        return {"lat": lat * DEG, "lon": lon * DEG, "height": c["height"]}
    if "x-ecef" in c:
        lat, lon, height = geodetic_from_ecef(np.column_stack([c["x-ecef"], c["y-ecef"], c["z-ecef"]]))
        return {"lat": lat, "lon": lon, "height": height}
    raise InputError(
        f"{path.name}: its places are neither latitude and longitude nor ECEF (a baseline?); "
        "set the solution format of RTKLIB to Lat/Lon/Height"
    )


def _velocity(c: dict[str, Array]) -> dict[str, Array]:
    if not {"vn", "ve"} <= c.keys():
        return {}
    down = c["vd"] if "vd" in c else -c["vu"] if "vu" in c else None
    return {"v_north": c["vn"], "v_east": c["ve"]} | ({} if down is None else {"v_down": down})


def _sigma(c: dict[str, Array]) -> dict[str, Array]:
    """Sigmas as reported; those of 0 (the receiver says nothing) are left open."""
    names = {"sdn": "std_north", "sde": "std_east", "sdu": "std_down"}
    names |= {"sdvn": "std_v_north", "sdve": "std_v_east", "sdvd": "std_v_down", "sdvu": "std_v_down"}
    out = {new: np.where(c[old] > 0.0, c[old], np.nan) for old, new in names.items() if old in c}
    return {n: v for n, v in out.items() if np.isfinite(v).any()}


# ------------------------------------------------------------------------------------------------------------- IMU log


def imu_log(path: Path) -> Table:
    """Table imu of a log of g, deg/s and milliseconds with its time tag, in the sensor's axes."""
    tag = tag_of(path)
    if tag is None:
        raise InputError(f"{path.name}: no time tag ({path.name.removesuffix('.gz')}.tag) beside it")
    data = read_bytes(path)
    start, tick, written = _read_tag(tag)
    lines = data.split(b"\n")
    ends = np.cumsum([len(line) + 1 for line in lines])
    notes: list[str] = []
    if b"\r" not in data and abs(written[-1] - len(data) - len(lines)) < abs(written[-1] - len(data)):
        ends += np.arange(1, len(lines) + 1)  # two bytes ended a line when the tag was written
        notes.append(f"{path.name}: its lines ended in CR LF when they were recorded; positions in the tag count them")
    rows = np.full((len(lines), 7), np.nan)
    for i, line in enumerate(lines):
        words = line.split(b",")
        if len(words) == 7:
            try:
                rows[i] = [float(w) for w in words]
            except ValueError:
                continue
    good = np.isfinite(rows).all(axis=1)
    bad = int((~good).sum()) - (not lines[-1])
    rows, ends = rows[good], ends[good]
    if len(rows) < _FEW:
        raise InputError(f"{path.name}: no rows of seven numbers (ax, ay, az in g, gx, gy, gz in deg/s, ms) in it")
    if bad > 0:
        notes.append(f"{path.name}: {counted(bad, 'line')} that is no row left out")
    ms = rows[:, 6]
    turn = np.cumsum(np.concatenate([[0.0], np.where(np.diff(ms) < -(2.0**31), 2.0**32, 0.0)]))
    ms = ms + turn
    # a row has arrived with the first write that reaches its end
    write = np.searchsorted(written, ends)
    known = write < len(written)
    if known.sum() < _FEW:
        raise InputError(f"{tag.name}: the time tag does not belong to {path.name}: it ends before its first rows")
    own, arrived = ms[known] * 1e-3, tick[write[known]] * 1e-3
    slope, offset = _line(own, arrived)
    late = arrived - (slope * own + offset)
    if abs(slope - 1.0) > 0.02:
        raise InputError(
            f"{tag.name}: arrival runs {slope:.3f} times as fast as the milliseconds of {path.name}; "
            "the time tag does not belong to it"
        )
    time = start + slope * ms * 1e-3 + offset
    notes.append(
        f"{path.name}: time from {tag.name}: a straight line through the arrival of rows, "
        f"{(slope - 1.0) * 1e6:+.0f} ppm of the sensor's clock, jitter {np.std(late) * 1e3:.0f} ms rms taken out; "
        "what the transfer takes on average is still in it (gnss_delay in [filter] estimate)"
    )
    notes.append(f"{path.name}: g and deg/s, the sensor's own axes; time is GPS seconds since 1980-01-06")
    columns = {"time": time}
    columns |= {f"accel_{a}": rows[:, k] * G0 for k, a in enumerate("xyz")}
    columns |= {f"gyro_{a}": rows[:, 3 + k] * DEG for k, a in enumerate("xyz")}
    columns = joined([columns], path.name, notes)
    return Table("imu", columns, "rates", str(path), notes)


def _read_tag(path: Path) -> tuple[float, Array, NDArray[np.int64]]:
    """GPS seconds of the start; ms after it of each write; bytes of the log written by then."""
    data = path.read_bytes()
    if len(data) < _TAG.size + 16 or not data.startswith(b"TIMETAG"):
        raise InputError(f"{path.name}: not an RTKLIB time tag (it begins with TIMETAG and holds a start and pairs)")
    _, _, whole, part = _TAG.unpack_from(data)
    if not (0.0 <= part < 1.0 and whole > GPS_EPOCH):
        raise InputError(f"{path.name}: the start in this time tag is no date; it is damaged, or of a 64-bit build")
    pairs = np.frombuffer(data[_TAG.size :][: (len(data) - _TAG.size) // 8 * 8], dtype="<u4").reshape(-1, 2)
    tick, written = pairs[:, 0].astype(float), pairs[:, 1].astype(np.int64)
    if (np.diff(written) < 0).any() or (np.diff(tick) < 0).any():
        raise InputError(f"{path.name}: its ticks or file positions go back; the time tag is damaged")
    return float(whole) - GPS_EPOCH + float(part), tick, written


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and offset of a straight line; rows off by more than three sigma (a blocked transfer) are left out."""
    keep = np.ones(len(x), dtype=bool)
    middle = float(x.mean())
    slope = offset = 0.0
    for _ in range(5):
        slope, offset = (float(v) for v in np.polyfit(x[keep] - middle, y[keep], 1))
        off = y - (slope * (x - middle) + offset)
        keep = np.abs(off) <= 3.0 * max(float(np.std(off[keep])), 1e-4)
    return slope, offset - slope * middle
