"""The Earth: WGS-84 and a sphere with the same methods, and module-level calls for WGS-84.

Symbols: lat, lon geodetic radians; h ellipsoidal height, m, up; n = NED at the point (north, east, down); e = ECEF
(x through lat 0 lon 0, z through the north pole). C_en rotates n components into e. All functions take numbers or
arrays that broadcast together; vectors are in the last axis.

Sources: NGA.STND.0036 (WGS 84, version 1.0.0, 2014), tables 3.1-3.6 and eq. 4-1 for the constants and Somigliana's
formula; Heiskanen and Moritz (1967), eq. 2-123 for gravity with height; Bowring (1976, 1985) for the inverse of ECEF;
Groves (2013), sections 2.4 and 5.4 for radii and rates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

OMEGA = 7.292115e-5  # rad/s, WGS-84 rotation rate
GM = 3.986004418e14  # m^3/s^2, WGS-84, atmosphere included


def wrap_pi(angle: ArrayLike) -> Array:
    """Angles of any shape, rad, brought into (-pi, pi]."""
    a = np.asarray(angle, dtype=np.float64)
    turned = np.pi - np.mod(np.pi - a, 2.0 * np.pi)
    turned = np.where(turned <= -np.pi, np.pi, turned)
    return np.where(np.abs(a) < np.pi, a, turned)[()]  # small angles keep every bit


@dataclass(frozen=True)
class Ellipsoid:
    """A rotating ellipsoid of revolution with its normal gravity.

    a : semi-major axis, m. f : flattening. gm : gravitational constant, m^3/s^2. omega : rate, rad/s.
    gamma_e, gamma_p : normal gravity at the equator and at the poles, m/s^2.
    """

    name: str
    a: float
    f: float
    gm: float
    omega: float
    gamma_e: float
    gamma_p: float

    @cached_property
    def b(self) -> float:
        """Semi-minor axis, m."""
        return self.a * (1.0 - self.f)

    @cached_property
    def e2(self) -> float:
        """First eccentricity squared."""
        return self.f * (2.0 - self.f)

    @cached_property
    def somigliana_k(self) -> float:
        """k of Somigliana's formula."""
        return self.b * self.gamma_p / (self.a * self.gamma_e) - 1.0

    @cached_property
    def m(self) -> float:
        """Ratio of centrifugal to gravitational acceleration at the equator: omega^2 a^2 b / GM."""
        return self.omega**2 * self.a**2 * self.b / self.gm

    def radii(self, lat: ArrayLike) -> tuple[Array, Array]:
        """Radii of curvature R_N (meridian) and R_E (prime vertical), m, at latitude lat, rad."""
        s = np.sin(np.asarray(lat, dtype=np.float64))
        w2 = 1.0 - self.e2 * s * s
        R_E = self.a / np.sqrt(w2)
        return R_E * (1.0 - self.e2) / w2, R_E

    def gravity(self, lat: ArrayLike, h: ArrayLike = 0.0) -> Array:
        """Normal gravity, m/s^2 > 0, straight down; attraction and centrifugal part together.

        Somigliana on the ellipsoid times 1 - 2 (1 + f + m - 2 f sin^2 lat) h/a + 3 h^2/a^2.
        """
        s2 = np.sin(np.asarray(lat, dtype=np.float64)) ** 2
        x = np.asarray(h, dtype=np.float64) / self.a
        g = self.gamma_e * (1.0 + self.somigliana_k * s2) / np.sqrt(1.0 - self.e2 * s2)
        return g * (1.0 - 2.0 * (1.0 + self.f + self.m - 2.0 * self.f * s2) * x + 3.0 * x * x)

    def gravity_n(self, lat: ArrayLike, h: ArrayLike = 0.0) -> Array:
        """Gravity vector (..., 3), m/s^2, NED: (0, 0, +g)."""
        g = self.gravity(lat, h)
        return np.stack([np.zeros_like(g), np.zeros_like(g), g], axis=-1)

    def earth_rate_n(self, lat: ArrayLike) -> Array:
        """w_ie (..., 3), rad/s, NED: omega (cos lat, 0, -sin lat)."""
        p = np.asarray(lat, dtype=np.float64)
        return np.stack([self.omega * np.cos(p), np.zeros_like(p), -self.omega * np.sin(p)], axis=-1)

    def transport_rate_n(self, lat: ArrayLike, h: ArrayLike, v_n: ArrayLike) -> Array:
        """w_en (..., 3), rad/s, NED: the turn of the n frame against the Earth at velocity v_n (..., 3), m/s, NED.

        (v_E/(R_E+h), -v_N/(R_N+h), -v_E tan(lat)/(R_E+h)). The third part grows without bound at a pole, where north
        itself has no direction.
        """
        p, height, v = (np.asarray(x, dtype=np.float64) for x in (lat, h, v_n))
        R_N, R_E = self.radii(p)
        east = v[..., 1] / (R_E + height)
        return np.stack(np.broadcast_arrays(east, -v[..., 0] / (R_N + height), -east * np.tan(p)), axis=-1)

    def ecef_from_geodetic(self, lat: ArrayLike, lon: ArrayLike, h: ArrayLike = 0.0) -> Array:
        """ECEF position (..., 3), m."""
        p, l, height = (np.asarray(x, dtype=np.float64) for x in (lat, lon, h))
        _, R_E = self.radii(p)
        across = (R_E + height) * np.cos(p)
        z = (R_E * (1.0 - self.e2) + height) * np.sin(p)
        return np.stack(np.broadcast_arrays(across * np.cos(l), across * np.sin(l), z), axis=-1)

    def geodetic_from_ecef(self, r_e: ArrayLike) -> tuple[Array, Array, Array]:
        """Latitude in [-pi/2, pi/2], longitude in (-pi, pi] (rad) and height (m) of ECEF positions r_e (..., 3), m.

        Good to a few nanometres from 5000 km below the surface to beyond any satellite; the longitude on the axis is 0.
        Within about 50 km of the Earth's centre, where the vertical is not unique, the result is finite but of no use.
        """
        r = np.asarray(r_e, dtype=np.float64) + 0.0  # -0.0 becomes 0.0, so that atan2 has one answer on the date line
        x, y, z = r[..., 0], r[..., 1], r[..., 2]
        p = np.hypot(x, y)
        distance = np.maximum(np.hypot(p, z), 1.0)
        ep2_b = self.e2 / (1.0 - self.e2) * self.b
        # Bowring's iteration on the reduced latitude, in sines and cosines so that poles and equator are alike. Five
        # rounds are far more than the surface needs; a fixed number keeps a batch equal to its elements.
        sin_b, cos_b = _unit((1.0 - self.f) * z * (1.0 + ep2_b / distance), p)
        for _ in range(5):
            sin_p, cos_p = _unit(z + ep2_b * sin_b**3, np.maximum(p - self.e2 * self.a * cos_b**3, 0.0))
            sin_b, cos_b = _unit((1.0 - self.f) * sin_p, cos_p)
        R_E = self.a / np.sqrt(1.0 - self.e2 * sin_p * sin_p)
        # Differences first: each is small, so the height keeps the digits that p and z have.
        h = (p - R_E * cos_p) * cos_p + (z - R_E * (1.0 - self.e2) * sin_p) * sin_p
        lon = np.arctan2(y, x)
        return np.arctan2(sin_p, cos_p), np.where(lon <= -np.pi, np.pi, lon)[()], h

    def local(self, lat0: float, lon0: float, h0: float = 0.0) -> LocalFrame:
        """The tangent NED frame at a point."""
        return LocalFrame(lat0, lon0, h0, self)

    def displacement_n(
        self, lat: ArrayLike, lon: ArrayLike, h: ArrayLike, lat0: ArrayLike, lon0: ArrayLike, h0: ArrayLike
    ) -> Array:
        """Small difference of two positions, (lat, lon, h) minus (lat0, lon0, h0), as NED metres (..., 3).

        (R_N + h) dlat, (R_E + h) cos(lat) dlon, -dh with radii, latitude and height half way, so that swapping the
        points changes the sign only. dlon takes the short way round the antimeridian. Lengths err as the third power
        of the distance (8 mm at 10 km, latitude 60 deg); north is that half way, which differs from north at either
        end by half the convergence of the meridians (there 15 m in 10 km). Not for use within kilometres of a pole.
        """
        p, l, z, p0, l0, z0 = (np.asarray(x, dtype=np.float64) for x in (lat, lon, h, lat0, lon0, h0))
        middle, height = 0.5 * (p + p0), 0.5 * (z + z0)
        R_N, R_E = self.radii(middle)
        north = (R_N + height) * (p - p0)
        east = (R_E + height) * np.cos(middle) * wrap_pi(l - l0)
        return np.stack(np.broadcast_arrays(north, east, z0 - z), axis=-1)

    def displace(self, lat: ArrayLike, lon: ArrayLike, h: ArrayLike, d_n: ArrayLike) -> tuple[Array, Array, Array]:
        """The position reached from (lat, lon, h) by NED metres d_n (..., 3); undoes `displacement_n`.

        The new longitude lies in (-pi, pi].
        """
        p, l, z, d = (np.asarray(x, dtype=np.float64) for x in (lat, lon, h, d_n))
        height = z - 0.5 * d[..., 2]
        new = p
        for _ in range(4):  # each round gains four digits or more
            R_N, R_E = self.radii(0.5 * (p + new))
            new = p + d[..., 0] / (R_N + height)
        R_N, R_E = self.radii(0.5 * (p + new))
        lon_new = l + d[..., 1] / ((R_E + height) * np.cos(0.5 * (p + new)))
        return new, wrap_pi(lon_new), z - d[..., 2]


@dataclass(frozen=True)
class Sphere(Ellipsoid):
    """A sphere with radial gravity GM/(R + h)^2 that does not depend on latitude: the Earth of textbook closed forms.

    The gravity is the attraction alone, taken as straight down (no centrifugal part): Schuler's period at the surface
    is 2 pi sqrt(R^3/GM). `a` is its radius.
    """

    def gravity(self, lat: ArrayLike, h: ArrayLike = 0.0) -> Array:
        """GM/(R + h)^2, m/s^2."""
        r = self.a + np.asarray(h, dtype=np.float64) + np.zeros_like(np.asarray(lat, dtype=np.float64))
        return self.gm / (r * r)


def sphere(radius: float = 6.371e6, gm: float = GM, omega: float = OMEGA) -> Sphere:
    """A spherical Earth of the given radius (m), constant (m^3/s^2) and rate (rad/s)."""
    g = gm / radius**2
    return Sphere("sphere", radius, 0.0, gm, omega, g, g)


WGS84 = Ellipsoid(
    "WGS-84", a=6378137.0, f=1.0 / 298.257223563, gm=GM, omega=OMEGA, gamma_e=9.7803253359, gamma_p=9.8321849379
)
SPHERE = sphere()
Earth = Ellipsoid  # the type to annotate with: a Sphere is one too


def _unit(s: Array, c: Array) -> tuple[Array, Array]:
    """(s, c) scaled to sine and cosine of atan2(s, c); (0, 1) where both vanish."""
    n = np.hypot(s, c)
    safe = np.where(n > 0.0, n, 1.0)
    return s / safe, np.where(n > 0.0, c / safe, 1.0)


def C_en(lat: ArrayLike, lon: ArrayLike) -> Array:
    """Rotation (..., 3, 3) of NED components at (lat, lon) into ECEF; its columns are north, east and down in ECEF."""
    p, l = np.broadcast_arrays(np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64))
    sp, cp, sl, cl = np.sin(p), np.cos(p), np.sin(l), np.cos(l)
    rows = [[-sp * cl, -sl, -cp * cl], [-sp * sl, cl, -cp * sl], [cp, np.zeros_like(p), -sp]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@dataclass(frozen=True)
class LocalFrame:
    """The NED frame tangent to the Earth at (lat0, lon0) rad, h0 m: exact at any distance, straight axes in ECEF."""

    lat0: float
    lon0: float
    h0: float = 0.0
    earth: Ellipsoid = WGS84

    @cached_property
    def _origin(self) -> Array:
        return self.earth.ecef_from_geodetic(self.lat0, self.lon0, self.h0)

    @cached_property
    def _C_en(self) -> Array:
        return C_en(self.lat0, self.lon0)

    def ned(self, lat: ArrayLike, lon: ArrayLike, h: ArrayLike = 0.0) -> tuple[Array, Array, Array]:
        """North, east, down in metres of geodetic positions (rad, rad, m)."""
        d = (self.earth.ecef_from_geodetic(lat, lon, h) - self._origin) @ self._C_en
        return d[..., 0], d[..., 1], d[..., 2]

    def geodetic(self, n: ArrayLike, e: ArrayLike, d: ArrayLike = 0.0) -> tuple[Array, Array, Array]:
        """Latitude, longitude (rad) and height (m) of points at north, east, down metres."""
        r_n = np.stack(np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (n, e, d))), axis=-1)
        return self.earth.geodetic_from_ecef(r_n @ self._C_en.T + self._origin)


radii = WGS84.radii
gravity = WGS84.gravity
gravity_n = WGS84.gravity_n
earth_rate_n = WGS84.earth_rate_n
transport_rate_n = WGS84.transport_rate_n
ecef_from_geodetic = WGS84.ecef_from_geodetic
geodetic_from_ecef = WGS84.geodetic_from_ecef
displacement_n = WGS84.displacement_n
displace = WGS84.displace

SCHULER_PERIOD = 2.0 * math.pi * math.sqrt(SPHERE.a**3 / SPHERE.gm)  # s, 84.3 min on the sphere
