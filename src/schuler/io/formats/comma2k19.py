"""A segment of the comma2k19 driving recordings as csv files: imu, gnss, speed and reference.

The folder holds imu, gnss_ublox, speed and reference (.csv or .csv.gz). `t_s`, the device's clock, is the clock of all
tables; the receiver's UTC stays beside the fixes as `utc_unix_ms`. Device axes are forward-right-down already.

gyro : the columns `g*_cal`, or with gyro="raw" the columns `g*_raw`. They differ by a constant (4 deg/s about z) that
the device had estimated; against the turning of the reference pose the bias of `cal` is (-0.03, -0.03, -0.03) deg/s,
that of `raw` (-0.6, -2.0, +3.9) deg/s, and the noise is the same. So `cal` is taken.

reference : the quaternion turns device vectors into ECEF; attitude is C_nb = C_en' C_eb, velocity C_en' v_e. It
describes the device, where the IMU is.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.ground.earth import C_en, geodetic_from_ecef
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_quat, euler_from_dcm
from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.io.formats.common import joined, need, numbered, sheet_in, whole_rows, wrapped


def recognise(path: Path) -> bool:
    """A folder with imu and gnss_ublox tables."""
    if not path.is_dir():
        return False
    names = {p.name.partition(".")[0] for p in path.iterdir()}
    return {"imu", "gnss_ublox"} <= names and bool({"speed", "reference"} & names)


def convert(path: Path, gyro: str = "cal") -> dict[str, Table]:
    """Tables imu, gnss, and speed and reference where they are there. Raises InputError."""
    if gyro not in ("cal", "raw"):
        raise InputError(f'gyro="{gyro}": the columns of a comma2k19 IMU are "cal" or "raw"')
    notes: list[str] = []
    source = str(path)
    tables: dict[str, Table] = {}

    sheet = sheet_in(path, "imu")
    assert sheet is not None
    raw = numbered(sheet)
    need(raw, f"t_s ax_mps2 ay_mps2 az_mps2 gx_{gyro}_radps gy_{gyro}_radps gz_{gyro}_radps", sheet.path)
    imu = {"time": raw["t_s"]}
    imu |= {f"gyro_{a}": raw[f"g{a}_{gyro}_radps"] for a in "xyz"}
    imu |= {f"accel_{a}": raw[f"a{a}_mps2"] for a in "xyz"}
    tables["imu"] = Table("imu", joined([whole_rows(imu, "imu", notes)], "imu", notes), "rates", source)
    notes.append(
        f"gyro: the {gyro} columns ({'bias removed by the device' if gyro == 'cal' else 'as measured'}); device axes "
        "are "
        "forward-right-down"
    )

    sheet = sheet_in(path, "gnss_ublox")
    if sheet is None:
        raise InputError(f"{path}: no gnss_ublox.csv in it")
    raw = numbered(sheet)
    need(raw, "t_s lat_deg lon_deg alt_m speed_mps bearing_deg", sheet.path)
    course = raw["bearing_deg"] * DEG
    gnss = {
        "time": raw["t_s"],
        "lat": raw["lat_deg"] * DEG,
        "lon": raw["lon_deg"] * DEG,
        "height": raw["alt_m"],
        "v_north": raw["speed_mps"] * np.cos(course),
        "v_east": raw["speed_mps"] * np.sin(course),
    }
    if "utc_unix_ms" in raw and raw["utc_unix_ms"].dtype.kind == "f":
        gnss["utc_unix_ms"] = raw["utc_unix_ms"]
    tables["gnss"] = Table("gnss", joined([whole_rows(gnss, "gnss", notes)], "gnss", notes), source=source)
    notes.append(
        "gnss: velocity north and east from the receiver's speed and bearing; stamps are those of arrival, later than "
        "the "
        "fix by about 0.08 s (gnss_delay_s in [input], or gnss_delay in [filter] estimate)"
    )

    sheet = sheet_in(path, "speed")
    if sheet is not None:
        raw = numbered(sheet)
        need(raw, "t_s speed_mps", sheet.path)
        speed = joined([whole_rows({"time": raw["t_s"], "speed": raw["speed_mps"]}, "speed", notes)], "speed", notes)
        tables["speed"] = Table("speed", speed, source=source)

    sheet = sheet_in(path, "reference")
    if sheet is not None:
        tables["reference"] = Table("reference", _reference(numbered(sheet), sheet.path, notes), source=source)
        notes.append("reference: ECEF pose turned into latitude, longitude, height, velocity in NED and attitude")
    others = sorted(
        p.name
        for p in path.iterdir()
        if p.name.endswith((".csv", ".csv.gz")) and p.name.partition(".")[0] not in _USED and p.is_file()
    )
    if others:
        notes.append(f"not used: {', '.join(others)}")
    for table in tables.values():
        table.notes = notes
    return tables


_USED = ("imu", "gnss_ublox", "speed", "reference")


def _reference(raw: dict[str, np.ndarray], path: Path, notes: list[str]) -> dict[str, np.ndarray]:
    names = "t_s x_ecef_m y_ecef_m z_ecef_m qw qx qy qz vx_ecef_mps vy_ecef_mps vz_ecef_mps"
    need(raw, names, path)
    rows = joined(
        [whole_rows({"time": raw["t_s"], **{n: raw[n] for n in names.split()[1:]}}, "reference", notes)],
        "reference",
        notes,
    )
    q = np.column_stack([rows[n] for n in ("qw", "qx", "qy", "qz")])
    if not len(q) or np.abs(np.linalg.norm(q, axis=1) - 1.0).max() > 1e-3:
        raise InputError(f"{path.name}: the quaternions are not of length one")
    lat, lon, height = geodetic_from_ecef(np.column_stack([rows[n] for n in ("x_ecef_m", "y_ecef_m", "z_ecef_m")]))
    C_ne = np.swapaxes(C_en(lat, lon), -1, -2)
    v_e = np.column_stack([rows[n] for n in ("vx_ecef_mps", "vy_ecef_mps", "vz_ecef_mps")])
    v_n = np.einsum("...ij,...j->...i", C_ne, v_e)
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    roll, pitch, heading = euler_from_dcm(C_ne @ dcm_from_quat(q))
    return {
        "time": rows["time"],
        "lat": lat,
        "lon": lon,
        "height": height,
        "v_north": v_n[:, 0],
        "v_east": v_n[:, 1],
        "v_down": v_n[:, 2],
        "roll": roll,
        "pitch": pitch,
        "heading": wrapped(heading),
    }
