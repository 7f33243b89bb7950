"""Latitude and longitude the wrong way round: what else a study holds says so.

A table of places cannot tell by itself. A start, landmarks, the receiver's own velocities and a compass can.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84, LocalFrame, wrap_pi
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

if TYPE_CHECKING:
    from schuler.studies.inputs import Inputs
    from schuler.studies.model import Study

Array = NDArray[np.float64]
FAR_M = 100e3  # places that lie so far apart are not of one vehicle, or not in these units
AGREES = 0.5  # residual over size, below which displacements follow velocities
_TYPE = "write lon[deg] over the column that is now lat[deg], and lat[deg] over the other"
ALIGNED = 0.8  # mean length of unit vectors course - heading, above which a course follows a compass


def apart(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Metres between two places in rad, through the Earth; infinity where one is none."""
    if not (np.isfinite(a).all() and np.isfinite(b).all()) or max(abs(a[0]), abs(b[0])) > np.pi / 2 * (1 + 1e-9):
        return np.inf
    north, east, down = LocalFrame(*a).ned(*b)
    return float(np.sqrt(north**2 + east**2 + down**2))


def middle(table: Table) -> tuple[float, float]:
    """Median latitude and longitude, rad."""
    return float(np.nanmedian(table["lat"])), float(np.nanmedian(table["lon"]))


def exchanged(place: tuple[float, float], known: tuple[float, float]) -> tuple[float, float] | None:
    """(metres apart as given, with lat and lon exchanged) where only the exchange brings a place to a known one."""
    as_given, other = apart(known, place), apart(known, (place[1], place[0]))
    return (as_given, other) if as_given > FAR_M and other < FAR_M else None


def steps(table: Table, turned: bool) -> tuple[Array, Array, Array]:
    """(dt (n-1,), north, east) m from row to row, with lat and lon as given or exchanged."""
    lat, lon = (table["lon"], table["lat"]) if turned else (table["lat"], table["lon"])
    zero = np.zeros(len(lat) - 1)
    step = WGS84.displacement_n(lat[1:], lon[1:], zero, lat[:-1], lon[:-1], zero)
    return np.diff(table.time), step[:, 0], step[:, 1]


def against_velocity(gnss: Table, turned: bool) -> float | None:
    """How far displacements are from the receiver's own velocities: residual over size; None where nothing moves.

    Displacements are smoothed over some rows, so that noise of fixes counts little.
    """
    if not {"v_north", "v_east"} <= gnss.columns.keys() or len(gnss) < 20:
        return None
    dt, north, east = steps(gnss, turned)
    velocity = [0.5 * (gnss[c][1:] + gnss[c][:-1]) for c in ("v_north", "v_east")]
    good = np.isfinite(north) & np.isfinite(velocity[0]) & np.isfinite(velocity[1]) & (dt < 5.0 * np.median(dt))
    if good.sum() < 20:
        return None
    window = np.ones(min(20, int(good.sum()) // 2))
    moved = [np.convolve(x[good], window, "valid") for x in (north, east)]
    told = [np.convolve(v[good] * dt[good], window, "valid") for v in velocity]
    size = float(np.sqrt(np.mean(told[0] ** 2 + told[1] ** 2)))
    if size < 20.0:
        return None
    return float(np.sqrt(np.mean((moved[0] - told[0]) ** 2 + (moved[1] - told[1]) ** 2)) / size)


def against_heading(gnss: Table, attitude: Table, turned: bool) -> float | None:
    """Mean length of the unit vectors of course - heading, 1 where a course keeps one angle to the compass; None where
    the vehicle does not turn or hardly moves."""
    name = "heading" if "heading" in attitude else "heading_mag" if "heading_mag" in attitude else None
    if name is None or len(gnss) < 20 or len(attitude) < 2:
        return None
    dt, north, east = steps(gnss, turned)
    at = 0.5 * (gnss.time[1:] + gnss.time[:-1])
    known = np.isfinite(attitude[name])
    if known.sum() < 2:
        return None
    heading = np.interp(at, attitude.time[known], np.unwrap(attitude[name][known]), left=np.nan, right=np.nan)
    good = np.isfinite(north) & np.isfinite(heading) & (np.hypot(north, east) > 5.0) & (dt < 5.0 * np.median(dt))
    if good.sum() < 20 or abs(np.mean(np.exp(1j * heading[good]))) > 0.9:
        return None
    return float(abs(np.mean(np.exp(1j * wrap_pi(np.arctan2(east[good], north[good]) - heading[good])))))


def check_exchanged(study: Study, inputs: Inputs, file: str, reference_file: str) -> list[str]:
    """InputError where the lat and lon of the fixes are exchanged; sentences on those of a reference."""
    gnss, reference = inputs.tables.get("gnss"), inputs.reference
    placed = gnss is not None and "lat" in gnss and len(gnss) > 0
    if gnss is not None and placed:
        said = _why(study, inputs, gnss)
        if said:
            raise InputError(f"{file}: lat and lon look exchanged: {said}; {_TYPE}")
    if gnss is None or reference is None or not placed or "lat" not in reference or not len(reference):
        return []
    found = exchanged(middle(reference), middle(gnss))
    if found is None:
        return []
    apart_km, near = f"{found[0] / 1e3:.0f} km", _near(found[1])
    moves = against_velocity(gnss, False)
    start = study.start
    begun = start.lat_deg is not None and start.lon_deg is not None
    if begun or (moves is not None and moves < AGREES):  # then the fixes are as they should be
        return [
            f"{reference_file}: lat and lon look exchanged: it lies {apart_km} from {file}, and exchanged {near} from "
            f"it; {_TYPE}"
        ]
    return [
        f"{reference_file} lies {apart_km} from {file}, and {near} with lat and lon exchanged in one of them; {_TYPE} "
        "in that one"
    ]


def _near(distance: float) -> str:
    return f"{distance:.0f} m" if distance < 1000.0 else f"{distance / 1e3:.1f} km"


def _why(study: Study, inputs: Inputs, gnss: Table) -> str:
    """What speaks for an exchange in the fixes, "" where nothing does."""
    here = middle(gnss)
    start, marks = study.start, inputs.tables.get("landmarks")
    known: list[tuple[str, tuple[float, float]]] = []
    if start.lat_deg is not None and start.lon_deg is not None:
        known.append(("[start] lat_deg, lon_deg", (float(np.radians(start.lat_deg)), float(np.radians(start.lon_deg)))))
    if marks is not None and "lat" in marks and len(marks):
        known.append(("the landmarks", middle(marks)))
    for name, place in known:
        found = exchanged(here, place)
        if found is not None:
            return f"they lie {found[0] / 1e3:.0f} km from {name}, and exchanged {_near(found[1])}"
    if not (np.abs(gnss["lon"][np.isfinite(gnss["lon"])]) <= np.pi / 2).all():
        return ""  # no latitude
    given, turned = (against_velocity(gnss, t) for t in (False, True))
    if given is not None and turned is not None and turned < AGREES < given and turned < 0.5 * given:
        return "with that undone the fixes move as v_north and v_east say, and as they stand they do not"
    attitude = inputs.tables.get("attitude")
    if given is None and attitude is not None:
        one, other = (against_heading(gnss, attitude, t) for t in (False, True))
        if one is not None and other is not None and other > ALIGNED and one < 0.5 * other:
            return "with that undone the fixes move where the compass points, and as they stand they do not"
    return ""
