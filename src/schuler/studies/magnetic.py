"""The declination of a recording whose study does not type one: World Magnetic Model, first fix, recording's date."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from schuler.ground.errors import StudyError
from schuler.ground.tables import Table
from schuler.ground.units import DEG

if TYPE_CHECKING:
    from schuler.studies.model import Study

UNIX = (1e9, 4e9)  # s: times between these are taken for Unix time (2001 to 2096)
SPREAD = 0.5 * DEG  # rad: a declination that changes more than this over the fixes is told


def uses_magnetic_north(tables: dict[str, Table]) -> str | None:
    """What of the tables in body axes is counted from magnetic north and read by method "schuler"; None: nothing."""
    imu, attitude = tables.get("imu"), tables.get("attitude")
    if imu is not None:
        return "the imu's magnetometer" if all(c in imu for c in ("mag_x", "mag_y", "mag_z")) else None
    if attitude is not None and "heading" not in attitude and "heading_mag" in attitude:
        return "attitude's heading_mag"
    return None


def recorded_declination(study: Study, tables: dict[str, Table]) -> tuple[float | None, list[str]]:
    """Declination (rad, east positive) for a recording, and notes; None where none is wanted.

    None is wanted where [input] declination_deg is typed, where nothing is counted from magnetic north, and where
    neither [start] nor a fix says where the vehicle is. StudyError where the clock does not say the date.
    """
    what = uses_magnetic_north(tables) if study.filter.method == "schuler" else None
    if what is None or study.input.declination_deg is not None:
        return None, []
    from schuler.ground import fields

    place = _place(study, tables)
    if place is None:
        return None, []
    time, lat, lon, height, where = place
    if not UNIX[0] < time < UNIX[1]:
        near = math.degrees(fields.declination(lat, lon, height, fields.SPAN[0]))
        raise StudyError(
            f"[input] declination_deg: {what} counts from magnetic north, and times near {time:.10g} s are no Unix "
            f"time that would give the date; type the magnetic variation there, east positive ({fields.NAME} has "
            f"{near:.1f} deg at {where} in {fields.SPAN[0]:.0f}), or 0 if it is in the headings already"
        )
    year = float(fields.decimal_year(time))
    B_n = fields.magnetic_field(lat, lon, height, year, nearest=True)
    value = math.atan2(B_n[1], B_n[0])
    notes = [
        f"declination {value / DEG:.1f} deg for {what}, from {fields.NAME} at {where} ({lat / DEG:.2f}, "
        f"{lon / DEG:.2f} deg) on {fields.date_text(year)}, times taken as Unix; type [input] "
        "declination_deg to replace it"
    ]
    moved = fields.span_note(lat, lon, height, year)
    if moved is not None:
        notes.append(f"declination: {moved}")
    if math.hypot(B_n[0], B_n[1]) < fields.WEAK:
        notes.append(
            f"the horizontal magnetic field is only {math.hypot(B_n[0], B_n[1]) * 1e6:.1f} uT at {where}: a compass is "
            "not to be relied on there"
        )
    gnss = tables.get("gnss")
    if gnss is not None:
        good = np.isfinite(gnss["lat"]) & np.isfinite(gnss["lon"])
        turn = fields.declination(gnss["lat"][good], gnss["lon"][good], height, year, nearest=True) - value
        turn = np.mod(turn + np.pi, 2.0 * np.pi) - np.pi
        if turn.size and float(np.max(np.abs(turn))) > SPREAD:
            far = float(turn[np.argmax(np.abs(turn))])
            notes.append(
                f"the declination changes by {far / DEG:+.1f} deg over the fixes and is kept constant; the rest is "
                "left to the heading offset"
            )
    return value, notes


def _place(study: Study, tables: dict[str, Table]) -> tuple[float, float, float, float, str] | None:
    """Time (s), latitude, longitude (rad), height (m) and what they are: [start], else the first fix."""
    start, gnss = study.start, tables.get("gnss")
    main = tables["imu"] if "imu" in tables else tables["attitude"]
    if start.lat_deg is not None and start.lon_deg is not None:
        time = start.time_s if start.time_s is not None else float(main.time[0])
        return time, math.radians(start.lat_deg), math.radians(start.lon_deg), start.height_m or 0.0, "[start]"
    if gnss is None:
        return None
    good = np.isfinite(gnss["lat"]) & np.isfinite(gnss["lon"])
    if start.time_s is not None:
        good &= gnss.time >= start.time_s
    if not good.any():
        return None
    k = int(np.argmax(good))
    height = float(gnss["height"][k]) if "height" in gnss else 0.0
    height = height if math.isfinite(height) else 0.0
    return float(gnss.time[k]), float(gnss["lat"][k]), float(gnss["lon"][k]), height, "the first fix"
