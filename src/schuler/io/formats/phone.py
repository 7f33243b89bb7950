"""A drive recorded with a telephone: a folder with acc, gyro and gnss tables (.csv or .csv.gz) on stamps of their own.

Columns: acc `t_s, ax_mps2, ay_mps2, az_mps2`; gyro `t_s, gx_radps, gy_radps, gz_radps`; gnss `t_s, lat_deg, lon_deg`
and what there is of `h_m, speed_mps, heading_deg, hacc_m, vacc_m, utc_unix_s`. `t_s` is the telephone's own clock in
all three, and the clock of the tables that come out.

One imu table: rows at the accelerometer's stamps; the angle that the gyro has gathered by then, interpolated between
its own stamps, so that no turn is lost or counted twice. Axes stay those of the telephone (x right, y up along the
screen, z out of it): `mounting_of` tells [mounting] imu_to_body_rpy_deg.

Accuracy columns that hold one value throughout say nothing and are left out. `hacc_m` is the radius of 68 %, 1.51 sigma
of one axis. Receivers give it in whole metres or with a floor, so it is never taken below 1 m.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.frames import euler_from_dcm
from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.io.formats.common import joined, need, numbered, sheet_in, whole_rows

Array = NDArray[np.float64]
RADIUS_68 = 1.51
LOST = 5.0  # m: rows with a worse hacc before the first better one are from before the receiver had settled
GAP_S = 0.5  # a gyro gap over which no angle is interpolated


def recognise(path: Path) -> bool:
    """A folder with acc, gyro and gnss tables whose gnss names an accuracy or a course."""
    if not path.is_dir():
        return False
    names = {p.name.partition(".")[0] for p in path.iterdir()}
    if not {"acc", "gyro", "gnss"} <= names:
        return False
    try:
        sheet = sheet_in(path, "gnss")
    except InputError:
        return False
    return sheet is not None and {"t_s", "lat_deg", "speed_mps", "heading_deg"} <= set(sheet.headings)


def convert(path: Path) -> dict[str, Table]:
    """Tables imu and gnss. Raises InputError."""
    notes: list[str] = []
    raw = {}
    for stem, names in (
        ("acc", "t_s ax_mps2 ay_mps2 az_mps2"),
        ("gyro", "t_s gx_radps gy_radps gz_radps"),
        ("gnss", "t_s lat_deg lon_deg"),
    ):
        sheet = sheet_in(path, stem)
        if sheet is None:
            raise InputError(f"{path}: no {stem}.csv in it")
        raw[stem] = numbered(sheet)
        need(raw[stem], names, sheet.path)
        rows = {"time" if n == "t_s" else n: raw[stem][n] for n in names.split()}
        if stem != "gnss":
            raw[stem] = joined([whole_rows(rows, stem, notes)], stem, notes)
    tables = {
        "imu": Table("imu", _one_clock(raw["acc"], raw["gyro"], notes), "rates", str(path), notes),
        "gnss": Table("gnss", _fixes(raw["gnss"], notes), source=str(path), notes=notes),
    }
    return tables


def _one_clock(acc: dict[str, Array], gyro: dict[str, Array], notes: list[str]) -> dict[str, Array]:
    """Rates at the accelerometer's stamps; a gyro row is the mean over the interval that its stamp ends."""
    t, s = acc["time"], gyro["time"]
    if len(t) < 3 or len(s) < 3 or t[0] > s[-1] or s[0] > t[-1]:
        raise InputError("acc and gyro share no time: are they of one recording?")
    edges = t[(t >= s[0]) & (t <= s[-1])]  # of the intervals; their ends are the rows
    if len(edges) < 3:
        raise InputError("acc and gyro share less than three rows: are they of one recording?")
    step = np.diff(edges)
    columns = {"time": edges[1:]}
    longest = float(np.diff(s).max())
    for a in "xyz":
        angle = np.concatenate([[0.0], np.cumsum(gyro[f"g{a}_radps"][1:] * np.diff(s))])
        columns[f"gyro_{a}"] = np.diff(np.interp(edges, s, angle)) / step
    for a in "xyz":
        columns[f"accel_{a}"] = np.interp(edges[1:], t, acc[f"a{a}_mps2"])
    notes.append(
        "imu: rows at the accelerometer's stamps; the angle gathered by the gyro is interpolated to them "
        "(they have stamps of their own)"
    )
    if longest > GAP_S:
        notes.append(f"imu: the gyro has a gap of {longest:.2f} s; its rate is spread evenly over it")
    notes.append("imu: the telephone's axes, x right, y up along the screen, z out of it")
    return columns


def _fixes(raw: dict[str, NDArray], notes: list[str]) -> dict[str, Array]:
    rows = {"time": raw["t_s"], "lat": raw["lat_deg"] * DEG, "lon": raw["lon_deg"] * DEG}
    if "h_m" in raw:
        rows["height"] = raw["h_m"]
    if "speed_mps" in raw and "heading_deg" in raw:
        course = raw["heading_deg"] * DEG
        rows |= {"v_north": raw["speed_mps"] * np.cos(course), "v_east": raw["speed_mps"] * np.sin(course)}
        notes.append("gnss: velocity north and east from the receiver's speed and course")
    rows |= {n: raw[f"{n}_m"] for n in ("hacc", "vacc") if f"{n}_m" in raw}
    rows = joined([whole_rows(rows, "gnss", notes)], "gnss", notes)
    constant: list[str] = [n for n in ("hacc", "vacc") if n in rows and np.ptp(rows[n]) == 0.0]
    constant += [n for n in ("sacc_mps", "headacc_deg") if n in raw and np.ptp(raw[n]) == 0.0]
    if constant:
        notes.append(f"gnss: {', '.join(constant)}: one value throughout, which says nothing; left out")
    hacc = rows.pop("hacc", None)
    vacc = rows.pop("vacc", None)
    keep = np.ones(len(rows["time"]), dtype=bool)
    if hacc is not None and "hacc" not in constant:
        if (hacc <= LOST).any():
            keep[: int(np.argmax(hacc <= LOST))] = False
        rows["std_north"] = rows["std_east"] = np.maximum(hacc, 1.0) / RADIUS_68
    if vacc is not None and "vacc" not in constant and (vacc > 0).all():
        rows["std_down"] = vacc
    if not keep.all():
        notes.append(f"gnss: the first {int((~keep).sum())} rows are from before the receiver had settled; left out")
    notes.append("gnss: stamps are those of arrival, later than the fix (gnss_delay in [filter] estimate)")
    return {n: v[keep] for n, v in rows.items()}


# ---------------------------------------------------------------------------------------------------------- mounting


def mounting_of(imu: Table, gnss: Table) -> tuple[tuple[float, float, float], float]:
    """[mounting] imu_to_body_rpy_deg to the nearest right angle, and how well it fits (correlation, 0 to 1).

    Down is the axis that carries gravity; forward, of the four that are left, the one whose accelerometer follows the
    change of the fixes' speed best. Needs v_north and v_east; without movement the correlation is 0.
    """
    f = imu.stack("accel_x", "accel_y", "accel_z")
    mean = np.median(f, axis=0)
    k = int(np.argmax(np.abs(mean)))
    down = np.zeros(3)
    down[k] = -np.sign(mean[k])
    speed = np.hypot(gnss["v_north"], gnss["v_east"])
    t = gnss.time
    change = np.diff(speed) / np.diff(t)
    ok = (np.diff(t) < 3.0) & (np.minimum(speed[1:], speed[:-1]) > 2.0)
    best, fit = np.zeros(3), -1.0
    gathered = np.concatenate([np.zeros((1, 3)), np.cumsum(f[1:] * np.diff(imu.time)[:, None], axis=0)])

    def mean_force(axis: Array) -> Array:
        v = gathered @ axis
        return (np.interp(t[1:], imu.time, v) - np.interp(t[:-1], imu.time, v)) / np.diff(t)

    for i in range(3):
        for sign in (1.0, -1.0):
            axis = np.zeros(3)
            axis[i] = sign
            if i == k:
                continue
            c = 0.0
            if ok.sum() > 20:
                felt = mean_force(axis)[ok]
                if felt.std() > 0.0 and change[ok].std() > 0.0:
                    c = float(np.corrcoef(felt, change[ok])[0, 1])
            if c > fit:
                best, fit = axis, c
    C_body_imu = np.array([best, np.cross(down, best), down])
    rpy = np.round(np.degrees(np.array(euler_from_dcm(C_body_imu)))).astype(float) + 0.0
    return (float(rpy[0]), float(rpy[1]), float(rpy[2])), max(fit, 0.0)
