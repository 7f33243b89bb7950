"""The Earth's magnetic field: the World Magnetic Model 2025, and the declination that it gives.

lat, lon geodetic radians; height above the ellipsoid, m; year decimal (2026.5), see `decimal_year`; all may be arrays
that broadcast together. The field is in tesla, NED.

Source of the method: Chulliat et al. (2025), The US/UK World Magnetic Model for 2025-2030: Technical Report, NOAA
National Centers for Environmental Information. The coefficients in `WMM2025.COF` (13 November 2024, degree 12) are
NOAA/NCEI's and the British Geological Survey's; they are not under copyright: material of the U.S. Government in the
public domain, kept here byte for byte.

The model knows the core's field only. Rock and the Sun's weather leave about sqrt(0.26^2 + (5417 nT / H)^2) deg of the
declination (1 sigma, H the horizontal field; the report's error model): 0.3 to 0.4 deg at low and middle latitudes.
"""

from __future__ import annotations

import math
import pkgutil
from datetime import UTC, datetime
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import WGS84, wrap_pi
from schuler.ground.errors import InputError
from schuler.ground.units import DEG

Array = NDArray[np.float64]

NAME = "WMM2025"
EPOCH = 2025.0
SPAN = (2025.0, 2030.0)  # decimal years, both ends included
RADIUS = 6371200.0  # m, of the sphere that the coefficients refer to
DEGREE = 12
DRIFT = 0.2 * DEG  # rad a year: how fast declination typically changes, assumed where no model reaches
WEAK = 6000e-9  # T: below this horizontal field the model's authors call a compass unreliable
HEIGHTS = (-1.0e6, 1.0e6)  # m: the downward limit is the core's, 2900 km, with room; above, currents in space add


def decimal_year(unix: ArrayLike) -> Array:
    """Decimal years (UTC) of Unix times of any shape: 2026.5 is halfway between two New Year's days."""
    t = np.asarray(unix, dtype=np.float64)
    if not np.all(np.isfinite(t)):
        raise InputError("a time is not a number, so it has no year; leave such rows out.")
    if np.any(np.abs(t) > 2.5e11):
        raise InputError(f"Unix time {float(t.flat[np.argmax(np.abs(t))]):.10g} s is no date; are these milliseconds?")
    first = np.floor(t).astype("datetime64[s]").astype("datetime64[Y]")
    start, end = (y.astype("datetime64[s]").astype(np.float64) for y in (first, first + 1))
    return (first.astype(np.float64) + 1970.0 + (t - start) / (end - start))[()]


def date_text(year: float) -> str:
    """ "2014-06-21" of a decimal year."""
    whole = math.floor(year)
    start, end = (datetime(y, 1, 1, tzinfo=UTC) for y in (whole, whole + 1))
    return (start + (year - whole) * (end - start)).strftime("%Y-%m-%d")


def magnetic_field(
    lat: ArrayLike, lon: ArrayLike, height: ArrayLike, year: ArrayLike, *, nearest: bool = False
) -> Array:
    """B_n (..., 3), T, NED.

    Raises InputError for a year outside `SPAN`; with `nearest` the year is moved to the nearer end of it instead, and
    `span_note` says what that may cost. At a pole north is the direction that the longitude names.
    """
    p, l, h, y = (np.asarray(x, dtype=np.float64) for x in (lat, lon, height, year))
    if not all(np.all(np.isfinite(x)) for x in (p, l, h, y)):
        raise InputError("the magnetic field was asked for a place or date that is not a number.")
    if np.any(np.abs(p) > 0.5 * np.pi + 1e-9):
        raise InputError(
            f"the magnetic field was asked for latitude {np.max(np.abs(p)):.6g} rad, beyond a pole; latitudes are "
            "radians here."
        )
    if np.any((h < HEIGHTS[0]) | (h > HEIGHTS[1])):
        raise InputError(
            f"the magnetic field was asked for height {h.flat[np.argmax(np.abs(h))]:.6g} m; heights are m."
        )
    outside = (y < SPAN[0]) | (y > SPAN[1])
    if np.any(outside) and not nearest:
        raise InputError(
            f"{_when(float(y.flat[np.argmax(outside)]))} is outside the span of {NAME}, {SPAN[0]:.1f} to "
            f"{SPAN[1]:.1f}; type [input] declination_deg, the magnetic variation there and then (east positive)."
        )
    p, l, h, years = np.broadcast_arrays(p, l, h, np.clip(y, *SPAN) - EPOCH)

    # Geocentric latitude (its sine and cosine) and distance; r cos is never negative, so both poles are regular.
    _, R_E = WGS84.radii(p)
    across, z = (R_E + h) * np.maximum(np.cos(p), 0.0), (R_E * (1.0 - WGS84.e2) + h) * np.sin(p)
    r = np.hypot(across, z)
    s, c = z / r, across / r

    north, east, down = np.zeros(p.shape), np.zeros(p.shape), np.zeros(p.shape)
    g, h_, g_rate, h_rate = _coefficients()
    for m in range(DEGREE + 1):
        cos_l, sin_l = np.cos(m * l), np.sin(m * l)
        for n, P, P_c, dP in _legendre(s, c, m):
            g_t, h_t = g[n, m] + g_rate[n, m] * years, h_[n, m] + h_rate[n, m] * years
            along, across_l = g_t * cos_l + h_t * sin_l, g_t * sin_l - h_t * cos_l
            fall = (RADIUS / r) ** (n + 2)
            north -= fall * along * dP
            east += fall * m * across_l * P_c
            down -= fall * (n + 1) * along * P

    # From the geocentric to the geodetic vertical: a turn about east by their difference.
    sin_d = s * np.cos(p) - c * np.sin(p)
    cos_d = c * np.cos(p) + s * np.sin(p)
    return np.stack([north * cos_d - down * sin_d, east, north * sin_d + down * cos_d], axis=-1)


def declination(lat: ArrayLike, lon: ArrayLike, height: ArrayLike, year: ArrayLike, *, nearest: bool = False) -> Array:
    """Magnetic north seen from true north, rad, east positive: true heading = magnetic heading + declination.

    Same arguments, errors and `nearest` as `magnetic_field`.
    """
    B_n = magnetic_field(lat, lon, height, year, nearest=nearest)
    return np.arctan2(B_n[..., 1], B_n[..., 0])[()]


def span_note(lat: float, lon: float, height: float, year: float) -> str | None:
    """A sentence for the user where `nearest` has moved the date, else None.

    It says how much the declination may be off: `DRIFT`, or the model's own change at that end where that is faster.
    """
    if SPAN[0] <= year <= SPAN[1]:
        return None
    end = SPAN[0] if year < SPAN[0] else SPAN[1]
    inside = end + (1.0 if year < SPAN[0] else -1.0)
    change = abs(float(wrap_pi(declination(lat, lon, height, inside) - declination(lat, lon, height, end))))
    rate, years = max(DRIFT, change), abs(year - end)
    return (
        f"{_when(year)} is outside the span of {NAME}, {SPAN[0]:.1f} to {SPAN[1]:.1f}: its declination of {end:.1f} "
        f"was taken; with a drift of {rate / DEG:.1f} deg a year assumed it may be {rate * years / DEG:.1f} deg off"
    )


def _when(year: float) -> str:
    return date_text(year) if 1.0 <= year < 9999.0 else f"year {year:.6g}"


@lru_cache(maxsize=1)
def _coefficients() -> tuple[Array, Array, Array, Array]:
    """g, h (T) and their change (T a year), each (13, 13) by degree and order; zero where there is none."""
    data = pkgutil.get_data("schuler.ground", f"{NAME}.COF")
    if data is None:
        raise InputError(f"the coefficients of {NAME} are missing from this installation; install schuler again.")
    found = np.zeros((4, DEGREE + 1, DEGREE + 1))
    for line in data.decode("ascii").splitlines()[1:]:
        words = line.split()
        if len(words) == 6:
            found[:, int(words[0]), int(words[1])] = [float(w) * 1e-9 for w in words[2:]]
    found.setflags(write=False)
    return found[0], found[1], found[2], found[3]


def _legendre(s: Array, c: Array, m: int) -> list[tuple[int, Array, Array, Array]]:
    """(n, P, P / c, dP / dlat) for n = max(1, m) .. 12: Schmidt semi-normalised P_n^m of s = sin lat, c = cos lat.

    P / c is carried through the recursion by itself (orders 1 and up have the factor c), so nothing is divided by zero
    at a pole; for order 0, where it is not wanted, it is 0.
    """
    # The first of an order: P_mm = k c^m, with P_mm / c = k c^(m-1) and d(c^m)/dlat = -m s c^(m-1).
    k = math.prod(math.sqrt((2.0 * i - 1.0) / (2.0 * i)) for i in range(2, m + 1))
    P = k * c**m
    P_c = k * c ** (m - 1) if m else np.zeros_like(c)
    dP = -m * s * P_c
    found = [(m, P, P_c, dP)] if m else []
    P0, P_c0, dP0 = (np.zeros_like(c),) * 3
    for n in range(m + 1, DEGREE + 1):
        a, b = 2.0 * n - 1.0, math.sqrt((n - 1.0) ** 2 - m * m)
        w = 1.0 / math.sqrt(n * n - m * m)
        P, P0, dP, dP0 = w * (a * s * P - b * P0), P, w * (a * (s * dP + c * P) - b * dP0), dP
        P_c, P_c0 = w * (a * s * P_c - b * P_c0), P_c
        found.append((n, P, P_c, dP))
    return found
