"""The world of a stable platform for compiled loops: case vector, trajectory, mass attraction, level platform.

Everything is scalars and float64 arrays, SI and radians. Frames: i inertial (equal to e at t = 0); mN north, WEST, up
along minus the mass attraction; m is mN turned by psi (positive from north to west); S the platform. Quaternions are
scalar first and take the second frame's components to the first (q_iS: S to i).

A case is one float64 vector `par`; the names below are its places. Signs: rate of the real platform = (1 + scale)
command + drift; measured force = (1 + scale) f - b_a. Source: Ghesmati et al., equations (2), (17), (20), corrected.
"""

from __future__ import annotations

import math

from numba import njit

from schuler.kernels.rotation import quat_product

_jit = njit(cache=True, error_model="numpy")

# --- the case vector --------------------------------------------------------------------------------------------------
(
    GM,
    RADIUS,  # R_G, m
    RATE,  # w_e, rad/s
    LAT,  # start: geocentric on the sphere, geodetic on the ellipsoid, rad
    LON,
    DLAT,  # change over the duration, rad
    DLON,
    DURATION,
    RAMP,  # rates grow by a quintic smoothstep over this time, s; 0 is an impulsive start
    HEIGHT,
    DHEIGHT,  # change over the duration by a quintic smoothstep, m
    ELLIPSOID,  # 0 sphere, 1 ellipsoid with GM, J2
    AXIS,  # a, m
    FLATTENING,
    J2,
    PSI,  # heading of the platform that the azimuth loop asks for, rad
    PSI_BIAS,  # bias of the gimbal angle, rad
    BA1,
    BA2,
    KA1,
    KA2,
    KT1,
    KT2,
    KT3,
    Z_SCALE,  # z of the commands (12), R_GMM = 1/(k_I k_G k_F), over the true one
    CARRIED,  # 0 the drift steps on at the switch, 1 it was there during alignment
    KNOWN,  # 1: the algorithm's p, q start from the known Earth rate, not from the command of alignment
    DRIFT1,
    DRIFT2,
    DRIFT3,
    RAMP1,  # rad/s^2
    RAMP2,
    RAMP3,
    TILT1,  # initial rotation of the real platform about its axes beyond what alignment leaves, rad
    TILT2,
    TILT3,
    DV1,  # initial velocity error along the platform axes, m/s
    DV2,
    N_PAR,
) = range(39)


# --- rotations --------------------------------------------------------------------------------------------------------
@_jit
def turn(q0, q1, q2, q3, x, y, z):
    """C(q) applied to (x, y, z)."""
    tx = 2.0 * (q2 * z - q3 * y)
    ty = 2.0 * (q3 * x - q1 * z)
    tz = 2.0 * (q1 * y - q2 * x)
    return x + q0 * tx + q2 * tz - q3 * ty, y + q0 * ty + q3 * tx - q1 * tz, z + q0 * tz + q1 * ty - q2 * tx


@_jit
def quat_of_axes(psi, phi_y, phi_x):
    """Quaternion of C3(psi) C2(phi_y) C1(phi_x)."""
    c, s = math.cos(0.5 * psi), math.sin(0.5 * psi)
    d, e = math.cos(0.5 * phi_y), math.sin(0.5 * phi_y)
    w0, w1, w2, w3 = quat_product(c, 0.0, 0.0, s, d, 0.0, e, 0.0)
    return quat_product(w0, w1, w2, w3, math.cos(0.5 * phi_x), math.sin(0.5 * phi_x), 0.0, 0.0)


@_jit
def quat_local(lat, lon):
    """Quaternion of C_imN: north, west, up at (lat, lon) in equatorial axes."""
    # up = C3(lon) C2(-lat) x, then z' = up, x' = north: C3(lon) C2(pi/2 - lat) C3(pi)
    a = quat_of_axes(lon, 0.5 * math.pi - lat, 0.0)
    return quat_product(a[0], a[1], a[2], a[3], 0.0, 0.0, 0.0, 1.0)


@_jit
def spin(y, k, p, q, r, dy):
    """dy[k:k+4] = derivative of the quaternion y[k:k+4] whose body turns at (p, q, r)."""
    dy[k] = -0.5 * (y[k + 1] * p + y[k + 2] * q + y[k + 3] * r)
    dy[k + 1] = 0.5 * (y[k] * p + y[k + 2] * r - y[k + 3] * q)
    dy[k + 2] = 0.5 * (y[k] * q + y[k + 3] * p - y[k + 1] * r)
    dy[k + 3] = 0.5 * (y[k] * r + y[k + 1] * q - y[k + 2] * p)


# --- truth ------------------------------------------------------------------------------------------------------------
@_jit
def _profile(t, duration, ramp):
    """(s, s', s'') of the share of the path done: constant rate after a quintic smoothstep of the rate."""
    k = 1.0 / (duration - 0.5 * ramp)
    if t >= ramp or ramp == 0.0:
        return k * (t - 0.5 * ramp), k, 0.0
    x = t / ramp
    return (
        k * ramp * x**4 * (x * x - 3.0 * x + 2.5),
        k * x**3 * (6.0 * x * x - 15.0 * x + 10.0),
        k / ramp * 30.0 * x * x * (x - 1.0) ** 2,
    )


@_jit
def gravitation(a, z, par):
    """Mass attraction at distance a from the axis and z above the equator: (outward, north of the equator), m/s^2."""
    d2 = a * a + z * z
    g = -par[GM] / (d2 * math.sqrt(d2))
    if par[ELLIPSOID] == 0.0:
        return g * a, g * z
    k = 1.5 * par[J2] * par[AXIS] ** 2 / d2
    u = 5.0 * z * z / d2
    return g * a * (1.0 + k * (1.0 - u)), g * z * (1.0 + k * (3.0 - u))


@_jit
def truth(t, par):
    """What happens: (a, z, a', z', lat, lat', longitude in i, its rate, f outward, f along the circle, f along z,
    distance z of the commands, its rate).

    a, z: distance from the axis and from the equator, m; f: specific force in the axes (outward, east, along the
    Earth's axis), m/s^2. Latitude is geocentric on the sphere, geodetic on the ellipsoid.
    """
    s, s1, s2 = _profile(t, par[DURATION], par[RAMP])
    lat, lat1, lat2 = par[LAT] + par[DLAT] * s, par[DLAT] * s1, par[DLAT] * s2
    lam, lam1, lam2 = par[LON] + par[DLON] * s + par[RATE] * t, par[DLON] * s1 + par[RATE], par[DLON] * s2
    x = t / par[DURATION]
    h = par[HEIGHT] + par[DHEIGHT] * x**3 * (6.0 * x * x - 15.0 * x + 10.0)
    h1 = par[DHEIGHT] * 30.0 * x * x * (x - 1.0) ** 2 / par[DURATION]
    h2 = par[DHEIGHT] * 60.0 * x * (x - 1.0) * (2.0 * x - 1.0) / par[DURATION] ** 2
    sl, cl = math.sin(lat), math.cos(lat)
    if par[ELLIPSOID] == 0.0:
        m = par[RADIUS] + h
        m1 = h1
        a, z = m * cl, m * sl
    else:
        e2 = par[FLATTENING] * (2.0 - par[FLATTENING])
        w2 = 1.0 - e2 * sl * sl
        n = par[AXIS] / math.sqrt(w2)
        m = n * (1.0 - e2) / w2
        m1 = 3.0 * m * e2 * sl * cl / w2 * lat1 + h1
        m += h
        a, z = (n + h) * cl, (n * (1.0 - e2) + h) * sl
    a1 = -m * sl * lat1 + h1 * cl
    z1 = m * cl * lat1 + h1 * sl
    a2 = -m1 * sl * lat1 - m * cl * lat1 * lat1 - m * sl * lat2 + h2 * cl - h1 * sl * lat1
    z2 = m1 * cl * lat1 - m * sl * lat1 * lat1 + m * cl * lat2 + h2 * sl + h1 * cl * lat1
    ga, gz = gravitation(a, z, par)
    return (
        a,
        z,
        a1,
        z1,
        lat,
        lat1,
        lam,
        lam1,
        a2 - a * lam1 * lam1 - ga,
        a * lam2 + 2.0 * a1 * lam1,
        z2 - gz,
        par[RADIUS] + h,
        h1,
    )


@_jit
def mass_latitude(a, z, par):
    """Latitude of minus the mass attraction, rad: the paper's phi_i. Geocentric on the sphere."""
    ga, gz = gravitation(a, z, par)
    return math.atan2(-gz, -ga)


# --- what alignment leaves --------------------------------------------------------------------------------------------
@_jit
def level_tilts(f_north, f_up, psi, f1, f2):
    """(phi_x, phi_y), rad, of a platform with heading psi that measures f1 and f2 of the force (f_north, 0, f_up).

    The exact solution of which (20) is the first order; m/s^2.
    """
    x, y = f_north * math.cos(psi), -f_north * math.sin(psi)
    n = math.sqrt(x * x + f_up * f_up)
    # x cos(phi_y) - f_up sin(phi_y) = f1
    phi_y = math.atan2(x, f_up) - math.asin(f1 / n)
    up = x * math.sin(phi_y) + f_up * math.cos(phi_y)
    # y cos(phi_x) + up sin(phi_x) = f2
    phi_x = math.asin(f2 / math.sqrt(y * y + up * up)) - math.atan2(y, up)
    return phi_x, phi_y
