"""PX4 ULog files to tables: imu, gnss, height, attitude (the vehicle's own estimate), speed, reference.

Time is the autopilot's clock, seconds since its boot, of all tables. Axes are forward-right-down and NED already, the
quaternion turns body vectors into NED. Of topics with several instances the first is taken.

attitude is the on-board estimate; it goes into reference too where the on-board position is there (not independent of
the same sensors, but the only judge in the file).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.frames import euler_from_quat
from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.io.formats.common import joined, whole_rows, wrapped
from schuler.io.sheets import counted

Columns = dict[str, NDArray]
GAUSS = 1e-4  # T

_TOPICS = [
    "sensor_combined",
    "vehicle_magnetometer",
    "vehicle_gps_position",
    "sensor_gps",
    "vehicle_air_data",
    "vehicle_attitude",
    "vehicle_global_position",
]


def recognise(path: Path) -> bool:
    """A file that begins with the ULog magic."""
    if not path.is_file():
        return False
    with path.open("rb") as f:
        return f.read(7) == b"ULog\x01\x12\x35"


def convert(path: Path) -> dict[str, Table]:
    """The tables that the log's topics can make. Raises InputError."""
    try:
        from pyulog import ULog
    except ImportError:
        raise InputError(f'{path.name}: reading ULog needs pyulog; type: pip install "schuler[io]"') from None
    if not recognise(path):
        raise InputError(f"{path.name} is not a ULog file")
    try:
        with path.open("rb") as stream:
            log = ULog(stream, _TOPICS)
    except Exception:  # pyulog raises whatever the parser of a damaged file runs into
        raise InputError(f"{path.name}: the ULog file is damaged or cut off") from None
    topics: dict[str, Columns] = {}
    notes: list[str] = []
    for d in log.data_list:
        if d.multi_id == 0 and len(d.data["timestamp"]):
            topics[d.name] = d.data
        elif d.multi_id:
            notes.append(f"{d.name}: instance {d.multi_id} not used")
    if log.dropouts:
        lost = sum(d.duration for d in log.dropouts) * 1e-3
        notes.append(f"{counted(len(log.dropouts), 'dropout')} of the logger, {lost:.3g} s in all")
    made: dict[str, Columns] = {}
    for build in (_imu, _gnss, _height, _attitude, _reference):
        build(topics, made, notes)
    if not made:
        raise InputError(f"{path.name}: none of the topics {', '.join(_TOPICS)} is in this log")
    notes.append("time is seconds since the autopilot's boot; axes are forward-right-down")
    return {
        n: Table(n, joined([c], n, notes), "rates" if n == "imu" else "", str(path), notes) for n, c in made.items()
    }


def _time(topic: Columns, relative: str = "") -> NDArray:
    stamp = topic["timestamp"].astype(np.float64)
    if relative and relative in topic:
        stamp = stamp + topic[relative].astype(np.float64)
    return stamp * 1e-6


def _vector(topic: Columns, name: str) -> list[NDArray] | None:
    names = [f"{name}[{k}]" for k in range(3)]
    return [topic[n].astype(np.float64) for n in names] if all(n in topic for n in names) else None


def _imu(topics: dict[str, Columns], made: dict[str, Columns], notes: list[str]) -> None:
    topic = topics.get("sensor_combined")
    if topic is None:
        return
    gyro, accel = _vector(topic, "gyro_rad"), _vector(topic, "accelerometer_m_s2")
    if gyro is None or accel is None:
        return
    rows: Columns = {"time": _time(topic)}
    for name, vector in (("gyro", gyro), ("accel", accel)):
        rows |= {f"{name}_{a}": v for a, v in zip("xyz", vector, strict=True)}
    rows = whole_rows(rows, "imu", notes)
    field = _vector(topic, "magnetometer_ga")
    if field is not None and len(field[0]) == len(rows["time"]):
        rows |= {f"mag_{a}": v * GAUSS for a, v in zip("xyz", field, strict=True)}
    elif "vehicle_magnetometer" in topics:
        other = topics["vehicle_magnetometer"]
        field = _vector(other, "magnetometer_ga")
        if field is not None and len(field[0]) > 1:
            t = _time(other)
            near = (rows["time"] >= t[0]) & (rows["time"] <= t[-1])
            rows |= {
                f"mag_{a}": np.where(near, np.interp(rows["time"], t, v * GAUSS), np.nan)
                for a, v in zip("xyz", field, strict=True)
            }
            notes.append("imu: magnetometer interpolated to the stamps of the gyro")
    made["imu"] = rows
    if "gyro_integral_dt" in topic and len(rows["time"]) > 1:
        covers = float(np.median(topic["gyro_integral_dt"].astype(np.float64)))
        covers *= 1e-6 if covers > 1.0 else 1.0  # microseconds in newer logs
        step = float(rows["time"][-1] - rows["time"][0]) / (len(rows["time"]) - 1)
        if step > 2.0 * covers:
            notes.append(
                f"imu: logged every {step * 1e3:.0f} ms on average while each row covers {covers * 1e3:.1f} ms, so "
                "most of the motion "
                "is missing: not fit for inertial navigation"
            )


def _gnss(topics: dict[str, Columns], made: dict[str, Columns], notes: list[str]) -> None:
    topic = topics.get("vehicle_gps_position", topics.get("sensor_gps"))
    if topic is None:
        return
    place = _place(topic)
    if place is None:
        return
    fix = topic["fix_type"].astype(int) >= 3 if "fix_type" in topic else np.ones(len(place["lat"]), dtype=bool)
    fix &= ~((place["lat"] == 0.0) & (place["lon"] == 0.0))
    if not fix.all():
        notes.append(f"gnss: {int((~fix).sum())} of {len(fix)} rows without a three-dimensional fix left out")
    if not fix.any():
        return
    rows: Columns = {"time": _time(topic), **place}
    if "eph" in topic and "epv" in topic:  # 1 sigma, of the radius and of the height
        side = _known(topic["eph"]) / np.sqrt(2.0)
        rows |= {"std_north": side, "std_east": side.copy(), "std_down": _known(topic["epv"])}
    velocity = [f"vel_{a}_m_s" for a in "ned"]
    if all(v in topic for v in velocity):
        good = topic["vel_ned_valid"].astype(bool) if "vel_ned_valid" in topic else np.ones(len(fix), dtype=bool)
        for name, v in zip(("v_north", "v_east", "v_down"), velocity, strict=True):
            rows[name] = np.where(good, topic[v].astype(np.float64), np.nan)
        if "s_variance_m_s" in topic:
            rows |= {f"std_v_{a}": _known(topic["s_variance_m_s"]) for a in ("north", "east", "down")}
    made["gnss"] = {k: v[fix] for k, v in rows.items()}


def _known(values: NDArray) -> NDArray:
    v = values.astype(np.float64)
    return np.where(np.isfinite(v) & (v > 0.0), v, np.nan)


def _place(topic: Columns) -> Columns | None:
    """lat, lon (rad), height (m, ellipsoid where it is told) of the older integer fields or the newer float ones."""
    if "latitude_deg" in topic:
        lat, lon = topic["latitude_deg"].astype(np.float64), topic["longitude_deg"].astype(np.float64)
        high = topic.get("altitude_ellipsoid_m", topic.get("altitude_msl_m"))
        scale = 1.0
    elif "lat" in topic:
        scaled = topic["lat"].dtype.kind in "iu"
        lat = topic["lat"].astype(np.float64) * (1e-7 if scaled else 1.0)
        lon = topic["lon"].astype(np.float64) * (1e-7 if scaled else 1.0)
        high = topic.get("alt_ellipsoid", topic.get("alt"))
        scale = 1e-3 if scaled else 1.0
    else:
        return None
    out = {"lat": lat * DEG, "lon": lon * DEG}
    if high is not None:
        out["height"] = high.astype(np.float64) * scale
    return out


def _height(topics: dict[str, Columns], made: dict[str, Columns], notes: list[str]) -> None:
    topic = topics.get("vehicle_air_data")
    if topic is not None and "baro_alt_meter" in topic:
        rows = {"time": _time(topic), "height": topic["baro_alt_meter"].astype(np.float64)}
    else:
        topic = topics.get("sensor_combined")
        if topic is None or "baro_alt_meter" not in topic or not np.any(topic["baro_alt_meter"]):
            return
        relative = topic["baro_timestamp_relative"]
        fresh = relative != np.iinfo(np.int32).max  # what PX4 writes where the row has no new value
        rows = {
            "time": _time(topic, "baro_timestamp_relative")[fresh],
            "height": topic["baro_alt_meter"].astype(np.float64)[fresh],
        }
    if len(rows["time"]):
        made["height"] = whole_rows(rows, "height", notes)
        notes.append("height is barometric, in the standard atmosphere")


def _attitude(topics: dict[str, Columns], made: dict[str, Columns], notes: list[str]) -> None:
    topic = topics.get("vehicle_attitude")
    if topic is None or "q[0]" not in topic:
        return
    q = np.column_stack([topic[f"q[{k}]"].astype(np.float64) for k in range(4)])
    length = np.linalg.norm(q, axis=1)
    good = np.abs(length - 1.0) < 0.01
    if not good.any():
        return
    roll, pitch, heading = euler_from_quat(q[good] / length[good, None])
    made["attitude"] = {"time": _time(topic)[good], "roll": roll, "pitch": pitch, "heading": wrapped(heading)}


def _reference(topics: dict[str, Columns], made: dict[str, Columns], notes: list[str]) -> None:
    topic: Any = topics.get("vehicle_global_position")
    if topic is None or "lat" not in topic:
        return
    rows: Columns = {
        "time": _time(topic),
        "lat": topic["lat"].astype(np.float64) * DEG,
        "lon": topic["lon"].astype(np.float64) * DEG,
    }
    high = topic.get("alt_ellipsoid", topic.get("alt"))
    if high is not None:
        rows["height"] = high.astype(np.float64)
    for name, key in (("v_north", "vel_n"), ("v_east", "vel_e"), ("v_down", "vel_d")):
        if key in topic:
            rows[name] = topic[key].astype(np.float64)
    if "attitude" in made:
        a = made["attitude"]
        for name in ("roll", "pitch"):
            rows[name] = np.interp(rows["time"], a["time"], a[name])
        rows["heading"] = wrapped(np.interp(rows["time"], a["time"], np.unwrap(a["heading"])))
    made["reference"] = rows
    notes.append("reference is the vehicle's own estimate from the same sensors, not independent of them")
