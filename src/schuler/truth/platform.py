"""The Earth of a stable platform: three kinds of latitude kept apart, and the field of GM and the zonal terms.

mass latitude      of minus the mass attraction (the paper's phi_i); geocentric on a sphere
plumb latitude     of minus gravity, attraction and centrifugal part together; what a level shows
geodetic latitude  of the normal to the ellipsoid; what a map and a GNSS receiver use
All radians, north positive. Source of the field: Heiskanen and Moritz (1967), equations 2-90 to 2-92.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import GM, WGS84

Array = NDArray[np.float64]

J2 = 1.0826298213133e-3  # of the level ellipsoid WGS-84


def zonal(degree: int) -> float:
    """J_n of the level ellipsoid WGS-84 for even n: what its own field has beyond GM/r."""
    n = degree // 2
    if degree < 2 or degree % 2:
        return 0.0
    e2 = WGS84.e2
    return (-1.0) ** (n + 1) * 3.0 * e2**n / ((2 * n + 1) * (2 * n + 3)) * (1.0 - n + 5.0 * n * J2 / e2)


@dataclass(frozen=True)
class Verticals:
    """The latitudes of one place, rad, each of its own vertical."""

    mass: Array
    plumb: Array
    geodetic: Array
    geocentric: Array


def verticals(lat_geodetic: ArrayLike, height: ArrayLike = 0.0, degree: int = 2) -> Verticals:
    """Latitudes of all verticals at a geodetic latitude (rad) and ellipsoidal height (m) of a point that rests.

    degree : the highest zonal term of the field (2: GM and J2, what the platform's plant uses; 8: the level
    ellipsoid's own field to 1e-11 rad).
    """
    lat, h = np.broadcast_arrays(np.asarray(lat_geodetic, dtype=np.float64), np.asarray(height, dtype=np.float64))
    _, R_E = WGS84.radii(lat)
    a = (R_E + h) * np.cos(lat)
    z = (R_E * (1.0 - WGS84.e2) + h) * np.sin(lat)
    r = np.hypot(a, z)
    s, c = z / r, a / r
    radial, north = np.ones_like(r), np.zeros_like(r)
    for n in range(2, degree + 1, 2):
        legendre = np.polynomial.Legendre.basis(n)
        k = zonal(n) * (WGS84.a / r) ** n
        radial -= (n + 1) * k * legendre(s)
        north -= k * c * legendre.deriv()(s)
    g = GM / r**2
    out = -g * (radial * c + north * s)  # along the equator's plane, outward
    up = -g * (radial * s - north * c)  # along the axis
    mass = np.arctan2(-up, -out)
    plumb = np.arctan2(-up, -(out + WGS84.omega**2 * a))
    return Verticals(mass, plumb, lat.copy(), np.arctan2(z, a))


def geodetic_from_mass(lat_mass: ArrayLike, height: ArrayLike = 0.0) -> Array:
    """Geodetic latitude (rad) of the point whose minus mass attraction (GM, J2) stands at lat_mass (rad)."""
    target = np.asarray(lat_mass, dtype=np.float64)
    lat = target.copy()
    for _ in range(12):  # contracts by about f each time
        lat = lat + (target - verticals(lat, height).mass)
    return lat
