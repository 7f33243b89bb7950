"""The Earth for compiled loops: scalar twins of `schuler.ground.earth` on WGS-84, with its constants.

lat rad, h m, v m/s NED; results m, m/s^2, rad/s. Sources: see `schuler.ground.earth`.
"""

import math

from numba import njit

from schuler.ground.earth import WGS84

A = WGS84.a
F = WGS84.f
E2 = WGS84.e2
OMEGA = WGS84.omega
GAMMA_E = WGS84.gamma_e
K = WGS84.somigliana_k
M = WGS84.m


@njit(cache=True, error_model="numpy")
def radii(lat):
    """Radii of curvature (R_N meridian, R_E prime vertical), m."""
    s = math.sin(lat)
    w2 = 1.0 - E2 * s * s
    R_E = A / math.sqrt(w2)
    return R_E * (1.0 - E2) / w2, R_E


@njit(cache=True, error_model="numpy")
def gravity(lat, h):
    """Normal gravity, m/s^2 > 0, straight down: Somigliana times its height factor."""
    s = math.sin(lat)
    s2 = s * s
    x = h / A
    g = GAMMA_E * (1.0 + K * s2) / math.sqrt(1.0 - E2 * s2)
    return g * (1.0 - 2.0 * (1.0 + F + M - 2.0 * F * s2) * x + 3.0 * x * x)


@njit(cache=True, error_model="numpy")
def earth_rate(lat):
    """North and down components of w_ie, rad/s (the east one is zero)."""
    return OMEGA * math.cos(lat), -OMEGA * math.sin(lat)


@njit(cache=True, error_model="numpy")
def transport_rate(lat, h, v_north, v_east):
    """w_en in NED, rad/s, as three numbers."""
    R_N, R_E = radii(lat)
    east = v_east / (R_E + h)
    return east, -v_north / (R_N + h), -east * math.tan(lat)
