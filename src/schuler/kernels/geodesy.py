"""Positions between geodetic and Earth-fixed axes as compiled scalar code, for any ellipsoid or sphere.

lat, lon rad, h m; e = Earth-fixed (x through 0 N 0 E, z through the north pole), m. a, e2: semi-major axis, m, and
eccentricity squared. Source: Bowring (1976), Survey Review 23, for the reduced latitude's iteration.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def ecef_from_geodetic(lat, lon, h, a, e2):
    """x, y, z in e, m."""
    s = math.sin(lat)
    r = a / math.sqrt(1.0 - e2 * s * s)
    across = (r + h) * math.cos(lat)
    return across * math.cos(lon), across * math.sin(lon), (r * (1.0 - e2) + h) * s


@njit(cache=True, error_model="numpy")
def normal_from_ecef(x, y, z, a, e2):
    """sin(lat), cos(lat), sin(lon), cos(lon), h (m). At the axis the longitude is 0.

    Three rounds: nanometres from the surface to 50 km up, a tenth of a millimetre and better anywhere above.
    """
    p = math.sqrt(x * x + y * y)
    if p > 0.0:
        so, co = y / p, x / p
    else:
        so, co = 0.0, 1.0
    b = a * math.sqrt(1.0 - e2)
    flat = b / a
    ep2 = e2 / (1.0 - e2)
    sb, cb = flat * z * (1.0 + ep2 * b / math.sqrt(p * p + z * z)), p
    k = 1.0 / math.sqrt(sb * sb + cb * cb)
    sb *= k
    cb *= k
    s, c = 0.0, 1.0
    for _ in range(3):
        s = z + ep2 * b * sb * sb * sb
        c = max(p - e2 * a * cb * cb * cb, 0.0)
        k = 1.0 / math.sqrt(s * s + c * c)
        s *= k
        c *= k
        sb, cb = flat * s, c
        k = 1.0 / math.sqrt(sb * sb + cb * cb)
        sb *= k
        cb *= k
    r = a / math.sqrt(1.0 - e2 * s * s)
    return s, c, so, co, (p - r * c) * c + (z - r * (1.0 - e2) * s) * s


@njit(cache=True, error_model="numpy")
def ned_from_e(sl, cl, so, co, x, y, z):
    """North, east, down components of (x, y, z) in e, at the point of these sines and cosines."""
    across = co * x + so * y
    return cl * z - sl * across, co * y - so * x, -cl * across - sl * z


@njit(cache=True, error_model="numpy")
def e_from_ned(sl, cl, so, co, north, east, down):
    """Components in e of (north, east, down)."""
    across = -sl * north - cl * down
    return co * across - so * east, so * across + co * east, cl * north - sl * down


@njit(cache=True, error_model="numpy")
def offset_n(lat, lon, h, px, py, pz, a, e2):
    """North, east, down, m, from the point (lat, lon, h) to the point (px, py, pz) in e: exact at any distance."""
    sl, cl, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    r = a / math.sqrt(1.0 - e2 * sl * sl)
    across = (r + h) * cl
    return ned_from_e(sl, cl, so, co, px - across * co, py - across * so, pz - (r * (1.0 - e2) + h) * sl)
