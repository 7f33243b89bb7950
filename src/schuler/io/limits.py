"""Rows that cannot be: numbers beyond any vehicle, places that stand for "no fix", clocks that were not set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Schema

Array = NDArray[np.float64]
FEW = 0.1  # a larger share is no stray row: the column is not what its heading says
YEAR = 366 * 86400.0
ROLLOVER = 1024 * 604800.0  # of the GPS week number: such a jump is taken out later, not the rows
# SI and radians inside; far beyond what is built, so that only what cannot be is caught
_LIMITS = {
    "time": (1e11, "s"),
    "gyro": (1e3, "rad/s"),
    "dtheta": (1e2, "rad"),
    "accel": (1e6, "m/s^2"),
    "dv": (1e5, "m/s"),
    "speed": (2e4, "m/s"),
    "v": (2e4, "m/s"),
    "depth": (1e6, "m"),
    "height": (1e7, "m"),
    "range": (1e8, "m"),
    "mag": (1.0, "T"),
    "std": (1e6, ""),
}


def drop_absurd(
    columns: dict[str, NDArray], lines: NDArray[np.int64], schema: Schema, who: str
) -> tuple[dict[str, NDArray], NDArray[np.int64], list[str]]:
    """Rows with impossible numbers left out, and counted; InputError where a needed column is full of them.

    An optional column loses only the numbers: they are not known there.
    """
    notes: list[str] = []
    whole = np.ones(len(lines), dtype=bool)
    for name, values in list(columns.items()):
        limit, unit = _LIMITS.get(name if name in _LIMITS else name.partition("_")[0], (0.0, ""))
        if not limit or values.dtype.kind != "f":
            continue
        with np.errstate(invalid="ignore"):
            bad = np.isfinite(values) & (np.abs(values) > limit)
        if not bad.any():
            continue
        line, reach, count = int(lines[int(np.argmax(bad))]), float(np.max(np.abs(values[bad]))), int(bad.sum())
        where = f"{reach:.3g} {unit}".strip()
        if name not in schema.needed(columns):
            columns[name] = np.where(bad, np.nan, values)
            said = f"{name} of up to {where} in {count} row{'s' * (count > 1)} (first in line {line})"
            notes.append(f"{who}: {said}: taken as unknown there")
            continue
        if count > FEW * len(bad) and count > 1:
            raise InputError(
                f"{who}: {name} reaches {where} in {count} of {len(bad)} rows (first in line {line}), more than is "
                "possible; correct the values, or the unit in the heading"
            )
        notes.append(
            f"{who}: {count} of {len(bad)} rows left out, where {name} cannot be ({where}; first in line {line})"
        )
        whole &= ~bad
    whole &= _places(columns, lines, who, notes)
    whole &= _clock(columns, whole, lines, who, notes)
    return {k: v[whole] for k, v in columns.items()}, lines[whole], notes


def _places(columns: dict[str, NDArray], lines: NDArray[np.int64], who: str, notes: list[str]) -> NDArray[np.bool_]:
    """Rows of a position that is none: 0 N 0 E, which receivers write before they have a fix; beyond a pole."""
    good = np.ones(len(lines), dtype=bool)
    if "lat" not in columns or "lon" not in columns:
        return good
    lat, lon = columns["lat"], columns["lon"]
    with np.errstate(invalid="ignore"):
        beyond = (np.abs(lat) > np.pi / 2 * (1 + 1e-9)) | (np.abs(lon) > 2 * np.pi * (1 + 1e-9))
    if beyond.sum() > FEW * len(good):
        beyond[:] = False  # no stray rows: the whole column is refused later, with its unit
    if beyond.any():
        k = int(np.argmax(beyond))
        place = f"{np.rad2deg(lat[k]):.6g} N {np.rad2deg(lon[k]):.6g} E"
        notes.append(
            f"{who}: {int(beyond.sum())} of {len(good)} rows left out, whose place is not on Earth ({place} in line "
            f"{lines[k]})"
        )
    none = (lat == 0.0) & (lon == 0.0)
    if none.any() and not none.all():
        others = ~none & ~beyond & np.isfinite(lat) & np.isfinite(lon)
        if others.any() and max(abs(np.median(lat[others])), abs(np.median(lon[others]))) > 1e-3:
            notes.append(
                f"{who}: {int(none.sum())} of {len(good)} rows left out at exactly 0 N 0 E (first in line "
                f"{lines[int(np.argmax(none))]}): no fix"
            )
            good &= ~none
    return good & ~beyond


def _clock(
    columns: dict[str, NDArray], whole: NDArray[np.bool_], lines: NDArray[np.int64], who: str, notes: list[str]
) -> NDArray[np.bool_]:
    """Rows stamped more than a year away from the others; a jump of 1024 weeks is none."""
    good = np.ones(len(lines), dtype=bool)
    time = columns.get("time")
    if time is None or time.dtype.kind != "f" or not np.isfinite(time[whole]).any():
        return good
    away = time - np.nanmedian(time[whole])
    rolled = np.abs(away - ROLLOVER * np.round(away / ROLLOVER))
    with np.errstate(invalid="ignore"):
        far = whole & (np.abs(away) > YEAR) & (rolled > YEAR)
    count = int(far.sum())
    if count == 0 or count > FEW * whole.sum():
        return good
    k = int(np.argmax(far))
    notes.append(
        f"{who}: {count} of {len(good)} rows left out, stamped more than a year away from the others ({time[k]:.6g} s "
        f"in line {lines[k]}): a clock that was not set"
    )
    return ~far
