"""Stable-platform navigation: plant, commands and algorithms as right-hand sides of one fixed-step RK4.

Frames, signs and the case vector: `schuler.kernels.platform_truth`. A state is one float64 vector of N_STATE places,
laid out by algorithm as `start` fills it. Equation numbers are those of Ghesmati et al.; where the printed equation is
wrong the corrected one is used (docs/platform.md lists the errata). Free azimuth and Table 2: Pitman (1962).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from schuler.kernels.platform_truth import (
    BA1,
    BA2,
    CARRIED,
    DRIFT1,
    DRIFT2,
    DRIFT3,
    DV1,
    DV2,
    GM,
    KA1,
    KA2,
    KNOWN,
    KT1,
    KT2,
    LON,
    PSI,
    PSI_BIAS,
    RADIUS,
    RAMP1,
    RAMP2,
    RAMP3,
    RATE,
    TILT1,
    TILT2,
    TILT3,
    Z_SCALE,
    gravitation,
    level_tilts,
    mass_latitude,
    quat_local,
    quat_of_axes,
    spin,
    truth,
    turn,
)
from schuler.kernels.rotation import quat_product

_jit = njit(cache=True, error_model="numpy")

EXACT = 0  # (9), (11) and the attitude of (p, q, 0)
CORRECTED = 1  # (15), (16) with r_m = phi_x q - phi_y p
LITERAL = 2  # (15), (16) with r_m = 0
CORRECTED_COSINES = 3  # the same with direction cosines instead of latitude, longitude, psi
LITERAL_COSINES = 4
FREE = 5
FREE_COSINES = 6
STRAPDOWN = 7  # gravity of the computed position
STRAPDOWN_OPEN = 8  # gravity of the true position
PUBLISHED = 9  # the paper's error model (28), (36) on the trajectory; its heading is not turned by the drift
FIRST_ORDER = 10  # first-order error of a platform with r = 0 about the vertical (free azimuth)
FIRST_ORDER_TILTED = 11  # the same about the axes of the position-independent platform, which stand off the vertical
N_STATE = 16


# --- state at the start -----------------------------------------------------------------------------------------------
@_jit
def start(code, par, y):
    """Fill y with the state at 0+: what alignment leaves, and the velocity step felt by commands and algorithm."""
    a, z, a1, z1, lat, lat1, lam, lam1, fa, fe, fz, dist, dist1 = truth(0.0, par)
    w_e = par[RATE]
    # at rest, before the start: force along local north and up of minus the mass attraction
    ga, gz = gravitation(a, z, par)
    phi = math.atan2(-gz, -ga)
    sp, cp = math.sin(phi), math.cos(phi)
    ra = -a * w_e * w_e - ga
    f_north, f_up = -ra * sp - gz * cp, ra * cp - gz * sp
    # velocity over ground at 0+, m/s
    cl, sl = math.cos(lam), math.sin(lam)
    ve = a * (lam1 - w_e)
    vx, vy, vz = a1 * cl - ve * sl, a1 * sl + ve * cl, z1
    n0, n1, n2, n3 = quat_local(phi, lam)
    psi = par[PSI] + par[PSI_BIAS]
    f1, f2 = par[BA1] / (1.0 + par[KA1]), par[BA2] / (1.0 + par[KA2])
    if FREE <= code <= FREE_COSINES or code == FIRST_ORDER:  # levelled to the mass attraction
        hat_x, hat_y = 0.0, 0.0
        phi_x, phi_y = f2 / f_up, -f1 / f_up
    else:  # levelled to the plumb line
        hat_x, hat_y = level_tilts(f_north, f_up, par[PSI], 0.0, 0.0)
        phi_x, phi_y = level_tilts(f_north, f_up, psi, f1, f2)
    phi_x += par[TILT1]
    phi_y += par[TILT2]
    psi += par[TILT3]
    # the real platform, and the platform that the algorithm believes in
    q0, q1, q2, q3 = quat_of_axes(psi, phi_y, phi_x)
    h0, h1, h2, h3 = quat_of_axes(par[PSI], hat_y, hat_x)
    # h = mu q: the error of the believed attitude, in local axes
    m0, m1, m2, m3 = quat_product(h0, h1, h2, h3, q0, -q1, -q2, -q3)
    q0, q1, q2, q3 = quat_product(n0, n1, n2, n3, q0, q1, q2, q3)
    h0, h1, h2, h3 = quat_product(n0, n1, n2, n3, h0, h1, h2, h3)
    # the velocity step, as the accelerometers feel it
    d1, d2, d3 = turn(q0, -q1, -q2, -q3, vx, vy, vz)
    d1 = d1 * (1.0 + par[KA1]) + par[DV1]
    d2 = d2 * (1.0 + par[KA2]) + par[DV2]
    y[:] = 0.0
    y[0], y[1], y[2], y[3] = q0, q1, q2, q3
    # inertial velocity in local axes of the ground point at distance z
    ux, uy = dist * cp * cl, dist * cp * sl
    c, s = math.cos(par[PSI]), math.sin(par[PSI])
    if code <= LITERAL_COSINES or code == FIRST_ORDER_TILTED:
        # commands at 0-: the platform stands on the Earth
        p, q, r = turn(q0, -q1, -q2, -q3, 0.0, 0.0, w_e)
        if par[CARRIED] == 1.0:
            p -= par[DRIFT1]
            q -= par[DRIFT2]
        zc = dist * par[Z_SCALE]
        p, q = p / (1.0 + par[KT1]), q / (1.0 + par[KT2])
        y[4], y[5] = p - d2 / zc, q + d1 / zc
        if par[KNOWN] == 1.0:
            p, q, r = turn(h0, -h1, -h2, -h3, 0.0, 0.0, w_e)
        y[14], y[15] = p - d2 / zc, q + d1 / zc
    if code == EXACT:
        y[6], y[7], y[8], y[9] = h0, h1, h2, h3
        x1, x2, x3 = turn(h0, -h1, -h2, -h3, ux, uy, dist * sp)
        u1, u2, u3 = turn(h0, -h1, -h2, -h3, -w_e * uy, w_e * ux, 0.0)
        y[10], y[11], y[12], y[13] = x1, x2, u1 + d1, u2 + d2
    elif code <= LITERAL_COSINES:
        # rates of the m frame and the angles themselves, to the order of (15)
        g1, g2, g3 = turn(n0, -n1, -n2, -n3, vx - w_e * uy, vy + w_e * ux, vz)
        y[6], y[7] = -(c * g2 - s * g1) / dist, (c * g1 + s * g2) / dist
        y[6] -= par[DV2] / dist
        y[7] += par[DV1] / dist
        y[8], y[9] = hat_x, hat_y
        _start_position(code, par, phi, 10, y)
    elif code <= FREE_COSINES:
        y[4], y[5] = d1, d2
        _start_position(code, par, phi, 6, y)
    elif code <= STRAPDOWN_OPEN:
        # the body stands level at heading psi; the computed attitude has the error of the aligned platform
        b0, b1, b2, b3 = quat_local(lat, lam)
        b0, b1, b2, b3 = quat_product(b0, b1, b2, b3, math.cos(0.5 * par[PSI]), 0.0, 0.0, math.sin(0.5 * par[PSI]))
        e0, e1, e2, e3 = quat_product(n0, n1, n2, n3, m0, m1, m2, m3)
        e0, e1, e2, e3 = quat_product(e0, e1, e2, e3, n0, -n1, -n2, -n3)
        y[0], y[1], y[2], y[3] = quat_product(e0, e1, e2, e3, b0, b1, b2, b3)
        y[4], y[5], y[6] = a * cl, a * sl, z
        k1, k2, k3 = vx, vy, vz
        g1, g2, g3 = turn(b0, b1, b2, b3, par[DV1], par[DV2], 0.0)
        y[7], y[8], y[9] = k1 - w_e * y[5] + g1, k2 + w_e * y[4] + g2, k3 + g3
    elif code == PUBLISHED:
        # (21), (24), (27) for the drifting platform and for the one without errors
        alpha, t1, t2 = (
            f_north * dist * dist / par[GM],
            par[BA1] * dist * dist / par[GM],
            par[BA2] * dist * dist / par[GM],
        )
        y[0], y[1], y[2], y[3] = quat_product(n0, n1, n2, n3, math.cos(0.5 * psi), 0.0, 0.0, math.sin(0.5 * psi))
        r0 = w_e * (sp + alpha * cp)
        y[8], y[9] = alpha * s, alpha * c
        y[10], y[11] = -r0 * y[9], r0 * y[8]
        c, s = math.cos(psi), math.sin(psi)
        r0 += w_e * cp * (s * t2 - c * t1)
        y[4], y[5] = alpha * s + t2 + par[TILT1], alpha * c - t1 + par[TILT2]
        y[6], y[7] = (par[DRIFT3] - r0) * y[5] - par[DV2] / dist, (r0 - par[DRIFT3]) * y[4] + par[DV1] / dist
        y[6] += w_e * cp * (math.cos(par[PSI]) - c)
        y[7] -= w_e * cp * (math.sin(par[PSI]) - s)
        a0, e1, e2, e3 = quat_local(phi, par[LON])
        y[12], y[13], y[14], y[15] = quat_product(
            a0, e1, e2, e3, math.cos(0.5 * par[PSI]), 0.0, 0.0, math.sin(0.5 * par[PSI])
        )
    elif code == FIRST_ORDER:
        y[0], y[1], y[2], y[3] = quat_product(
            n0, n1, n2, n3, math.cos(0.5 * par[PSI]), 0.0, 0.0, math.sin(0.5 * par[PSI])
        )
        y[4], y[5] = phi_x, phi_y
        y[6] = -(d2 - d2 / (1.0 + par[KA2]) + par[DV2] / (1.0 + par[KA2])) / dist
        y[7] = (d1 - d1 / (1.0 + par[KA1]) + par[DV1] / (1.0 + par[KA1])) / dist
        # with a wrong heading the Earth's rate is commanded about the wrong axes
        y[6] += w_e * cp * s * (psi - par[PSI])
        y[7] += w_e * cp * c * (psi - par[PSI])
        y[8], y[9], y[10] = turn(n0, n1, n2, n3, 0.0, 0.0, par[PSI] - psi)
    elif code == FIRST_ORDER_TILTED:
        y[0], y[1], y[2], y[3] = h0, h1, h2, h3
        p, q, r = turn(h0, -h1, -h2, -h3, 0.0, 0.0, w_e)
        g1, g2, g3 = turn(h0, -h1, -h2, -h3, vx, vy, vz)
        y[4], y[5] = p - g2 / dist, q + g1 / dist
        y[6], y[7], y[8] = turn(n0, n1, n2, n3, 2.0 * m1, 2.0 * m2, 2.0 * m3)
        y[12], y[13], y[14] = turn(h0, h1, h2, h3, d1 - g1, d2 - g2, 0.0)


@_jit
def _start_position(code, par, phi, k, y):
    if code == CORRECTED_COSINES or code == LITERAL_COSINES or code == FREE_COSINES:
        a0, a1, a2, a3 = quat_local(phi, par[LON])
        y[k], y[k + 1], y[k + 2], y[k + 3] = quat_product(
            a0, a1, a2, a3, math.cos(0.5 * par[PSI]), 0.0, 0.0, math.sin(0.5 * par[PSI])
        )
    else:
        y[k], y[k + 1], y[k + 2] = phi, par[LON], par[PSI]


# --- right-hand sides -------------------------------------------------------------------------------------------------
@_jit
def _advance_angles(k, pm, qm, rm, w_e, y, dy):
    """(16): the m frame turns at (pm, qm, rm) against i; latitude, longitude and psi follow. Fails at a pole."""
    sp, cp = math.sin(y[k + 2]), math.cos(y[k + 2])
    dy[k] = pm * sp + qm * cp
    dy[k + 1] = (pm * cp - qm * sp) / math.cos(y[k]) - w_e
    dy[k + 2] = rm - (w_e + dy[k + 1]) * math.sin(y[k])


@_jit
def _advance_cosines(k, pm, qm, rm, w_e, y, dy):
    """(16) for the quaternion q_em at y[k:k+4]: no angle, no pole."""
    e1, e2, e3 = turn(y[k], -y[k + 1], -y[k + 2], -y[k + 3], 0.0, 0.0, w_e)
    spin(y, k, pm - e1, qm - e2, rm - e3, dy)


@_jit
def rates(code, t, y, par, b1, b2, b3, dy):
    """dy = time derivative of the state y of algorithm `code` with drifts b1, b2, b3 (rad/s) at time t."""
    a, z, a1, z1, lat, lat1, lam, lam1, fa, fe, fz, dist, dist1 = truth(t, par)
    cl, sl = math.cos(lam), math.sin(lam)
    fx, fy = fa * cl - fe * sl, fa * sl + fe * cl
    w_e = par[RATE]
    if code <= LITERAL_COSINES:
        f1, f2, f3 = turn(y[0], -y[1], -y[2], -y[3], fx, fy, fz)
        f1, f2 = (1.0 + par[KA1]) * f1 - par[BA1], (1.0 + par[KA2]) * f2 - par[BA2]
        zc = dist * par[Z_SCALE]
        dy[4], dy[5] = -f2 / zc, f1 / zc  # (12)
        spin(y, 0, (1.0 + par[KT1]) * y[4] + b1, (1.0 + par[KT2]) * y[5] + b2, b3, dy)
        p, q = y[14], y[15]  # the command as the algorithm knows it
        dy[14], dy[15] = dy[4], dy[5]
        if code == EXACT:
            spin(y, 6, p, q, 0.0, dy)
            x1, x2 = y[10], y[11]
            x3 = math.sqrt(dist * dist - x1 * x1 - x2 * x2)
            dy[10], dy[11] = y[12] - q * x3, y[13] + p * x3  # (9)
            w = (dist * dist1 - x1 * dy[10] - x2 * dy[11]) / x3 - q * x1 + p * x2
            g = par[GM] / (dist * dist * dist)
            dy[12], dy[13] = -q * w + f1 - g * x1, p * w + f2 - g * x2  # (11)
        else:
            wx, wy, ix, iy = y[6], y[7], y[8], y[9]
            k = par[RADIUS] / dist
            d = ix * ix + iy * iy + 1.0 / (k * k)
            g = par[GM] / par[RADIUS] ** 3 * k / (d * math.sqrt(d))
            both = q * iy + p * ix
            dy[6] = -(wx + p) * dist1 / dist - k * p * both + dy[14] + g * ix  # (15)
            dy[7] = -(wy + q) * dist1 / dist - k * q * both + dy[15] + g * iy
            dy[8], dy[9] = (p - wx) / k, (q - wy) / k
            rm = 0.0
            if code == CORRECTED or code == CORRECTED_COSINES:
                rm = ix * q - iy * p
            if code <= LITERAL:
                _advance_angles(10, wx, wy, rm, w_e, y, dy)
            else:
                _advance_cosines(10, wx, wy, rm, w_e, y, dy)
    elif code <= FREE_COSINES:
        f1, f2, f3 = turn(y[0], -y[1], -y[2], -y[3], fx, fy, fz)
        f1, f2 = (1.0 + par[KA1]) * f1 - par[BA1], (1.0 + par[KA2]) * f2 - par[BA2]
        if code == FREE:
            cf = math.cos(y[6])
            e1, e2, e3 = w_e * cf * math.cos(y[8]), -w_e * cf * math.sin(y[8]), w_e * math.sin(y[6])
        else:
            e1, e2, e3 = turn(y[6], -y[7], -y[8], -y[9], 0.0, 0.0, w_e)
        p, q = -y[5] / dist + e1, y[4] / dist + e2
        spin(y, 0, (1.0 + par[KT1]) * p + b1, (1.0 + par[KT2]) * q + b2, b3, dy)
        dy[4] = f1 + e3 * y[5] - dist * e1 * e3 - (e2 + q) * dist1
        dy[5] = f2 - e3 * y[4] - dist * e2 * e3 + (e1 + p) * dist1
        if code == FREE:
            _advance_angles(6, p, q, 0.0, w_e, y, dy)
        else:
            _advance_cosines(6, p, q, 0.0, w_e, y, dy)
    elif code <= STRAPDOWN_OPEN:
        c, s = math.cos(par[PSI]), math.sin(par[PSI])
        sf, cf = math.sin(lat), math.cos(lat)
        wn, ww, wu = lam1 * cf, lat1, lam1 * sf
        gn, gw, gu = -fa * sf + fz * cf, -fe, fa * cf + fz * sf
        f1 = (1.0 + par[KA1]) * (c * gn + s * gw) - par[BA1]
        f2 = (1.0 + par[KA2]) * (-s * gn + c * gw) - par[BA2]
        spin(y, 0, c * wn + s * ww + b1, -s * wn + c * ww + b2, wu + b3, dy)
        gx, gy, gz = turn(y[0], y[1], y[2], y[3], f1, f2, gu)
        dy[4], dy[5], dy[6] = y[7], y[8], y[9]
        if code == STRAPDOWN_OPEN:
            ga, gq = gravitation(a, z, par)
            dy[7], dy[8], dy[9] = gx + ga * cl, gy + ga * sl, gz + gq
        else:
            # the field at the computed direction and the known distance, growing with the computed radius: the
            # vertical channel then swings and cannot run away
            ax = math.sqrt(y[4] * y[4] + y[5] * y[5])
            ratio = math.sqrt((ax * ax + y[6] * y[6]) / (a * a + z * z))
            ga, gq = gravitation(ax / ratio, y[6] / ratio, par)
            ga *= ratio / ax
            dy[7], dy[8], dy[9] = gx + ga * y[4], gy + ga * y[5], gz + gq * ratio
    else:
        _error_rates(code, y, par, b1, b2, b3, a, z, a1, z1, cl, sl, lam1, fx, fy, fz, dist, dist1, dy)


@_jit
def _error_rates(code, y, par, b1, b2, b3, a, z, a1, z1, cl, sl, lam1, fx, fy, fz, dist, dist1, dy):
    """The error models: PUBLISHED, FIRST_ORDER, FIRST_ORDER_TILTED."""
    vx, vy = a1 * cl - a * lam1 * sl, a1 * sl + a * lam1 * cl
    g = par[GM] / (dist * dist * dist)
    f1, f2, f3 = turn(y[0], -y[1], -y[2], -y[3], fx, fy, fz)
    if code == FIRST_ORDER_TILTED:
        p, q = y[4], y[5]
        dy[4], dy[5] = -f2 / dist, f1 / dist
        spin(y, 0, p, q, 0.0, dy)
        e1, e2, e3 = turn(y[0], y[1], y[2], y[3], b1 + par[KT1] * p, b2 + par[KT2] * q, b3)
        dy[6], dy[7], dy[8] = -e1, -e2, -e3
        k1, k2, k3 = turn(y[0], y[1], y[2], y[3], par[KA1] * f1 - par[BA1], par[KA2] * f2 - par[BA2], 0.0)
        k1 += y[7] * fz - y[8] * fy - g * y[9]
        k2 += y[8] * fx - y[6] * fz - g * y[10]
        k3 += y[6] * fy - y[7] * fx - g * y[11]
        # the height is known: what the third channel would have measured follows from r . dr = 0
        s1, s2, s3 = turn(y[0], y[1], y[2], y[3], 0.0, 0.0, 1.0)
        x, yy = a * cl, a * sl
        ax, ay, az = fx - g * x, fy - g * yy, fz - g * z
        n = x * k1 + yy * k2 + z * k3 + ax * y[9] + ay * y[10] + az * y[11]
        n += 2.0 * (vx * y[12] + vy * y[13] + z1 * y[14])
        n /= x * s1 + yy * s2 + z * s3
        dy[9], dy[10], dy[11] = y[12], y[13], y[14]
        dy[12], dy[13], dy[14] = k1 - n * s1, k2 - n * s2, k3 - n * s3
        return
    v1, v2, v3 = turn(y[0], -y[1], -y[2], -y[3], vx, vy, z1)
    p, q = -v2 / dist, v1 / dist
    spin(y, 0, p, q, 0.0, dy)
    b1 += par[KT1] * p
    b2 += par[KT2] * q
    ix, iy = y[4], y[5]
    dy[4], dy[5] = y[6] + b1, y[7] + b2  # y[6:8] is the tilt rate less the drift
    if code == FIRST_ORDER:
        both = p * ix + q * iy
        dy[6] = -g * ix + p * both - b3 * q - (par[KA2] * f2 - par[BA2]) / dist
        dy[7] = -g * iy + q * both + b3 * p + (par[KA1] * f1 - par[BA1]) / dist
        dy[8], dy[9], dy[10] = turn(y[0], y[1], y[2], y[3], y[6], y[7], -b3 - (ix * q - iy * p))
        return
    k = g - p * p - q * q
    dy[6] = -k * ix - b3 * q + b3 * dy[5] + par[BA2] / dist  # (28) as printed
    dy[7] = -k * iy + b3 * p - b3 * dy[4] - par[BA1] / dist
    dy[8], dy[9] = y[10], y[11]
    dy[10], dy[11] = -k * y[8], -k * y[9]
    _advance_cosines(12, p + y[6] - y[10], q + y[7] - y[11], 0.0, par[RATE], y, dy)


# --- stepping ---------------------------------------------------------------------------------------------------------
@_jit
def _step(code, par, t, h, walk, j, y, k1, k2, k3, k4, w):
    """One RK4 step of the state y from t to t + h; the random walk of the drifts is linear between nodes j, j + 1."""
    tm, te = t + 0.5 * h, t + h
    u1, u2, u3 = walk[j, 0], walk[j, 1], walk[j, 2]
    w1, w2, w3 = walk[j + 1, 0], walk[j + 1, 1], walk[j + 1, 2]
    d1, d2, d3, r1, r2, r3 = par[DRIFT1], par[DRIFT2], par[DRIFT3], par[RAMP1], par[RAMP2], par[RAMP3]
    rates(code, t, y, par, d1 + r1 * t + u1, d2 + r2 * t + u2, d3 + r3 * t + u3, k1)
    for i in range(N_STATE):
        w[i] = y[i] + 0.5 * h * k1[i]
    b1, b2, b3 = d1 + r1 * tm + 0.5 * (u1 + w1), d2 + r2 * tm + 0.5 * (u2 + w2), d3 + r3 * tm + 0.5 * (u3 + w3)
    rates(code, tm, w, par, b1, b2, b3, k2)
    for i in range(N_STATE):
        w[i] = y[i] + 0.5 * h * k2[i]
    rates(code, tm, w, par, b1, b2, b3, k3)
    for i in range(N_STATE):
        w[i] = y[i] + h * k3[i]
    rates(code, te, w, par, d1 + r1 * te + w1, d2 + r2 * te + w2, d3 + r3 * te + w3, k4)
    for i in range(N_STATE):
        y[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


@_jit
def run(code, par, time, walk, out):
    """States out (n, N_STATE) at the nodes time (n,) s. walk (n, 3) rad/s is added to the drifts at the nodes."""
    y, w = np.zeros(N_STATE), np.zeros(N_STATE)
    k1, k2, k3, k4 = np.zeros(N_STATE), np.zeros(N_STATE), np.zeros(N_STATE), np.zeros(N_STATE)
    start(code, par, y)
    out[0] = y
    for j in range(len(time) - 1):
        _step(code, par, time[j], time[j + 1] - time[j], walk, j, y, k1, k2, k3, k4, w)
        out[j + 1] = y


@njit(cache=True, error_model="numpy", parallel=True)
def ensemble(code, pars, time, keep, out):
    """Errors out (m, k, 3) of m cases pars (m, N_PAR) at the k nodes where keep (n,) is True; see `position_error`."""
    walk = np.zeros((len(time), 3))
    for i in prange(len(pars)):
        par = pars[i]
        y, w = np.zeros(N_STATE), np.zeros(N_STATE)
        k1, k2, k3, k4 = np.zeros(N_STATE), np.zeros(N_STATE), np.zeros(N_STATE), np.zeros(N_STATE)
        start(code, par, y)
        k = 0
        for j in range(len(time)):
            if keep[j]:
                out[i, k, 0], out[i, k, 1], out[i, k, 2] = position_error(code, time[j], y, par)
                k += 1
            if j + 1 < len(time):
                _step(code, par, time[j], time[j + 1] - time[j], walk, j, y, k1, k2, k3, k4, w)


# --- what a state says ------------------------------------------------------------------------------------------------
@_jit
def direction(code, t, y, par):
    """Where the algorithm believes to be: unit vector along minus the mass attraction, Earth-fixed axes."""
    if code == EXACT:
        dist = truth(t, par)[11]
        x, yy, zz = turn(y[6], y[7], y[8], y[9], y[10], y[11], math.sqrt(dist * dist - y[10] ** 2 - y[11] ** 2))
    elif code == STRAPDOWN or code == STRAPDOWN_OPEN:
        ax = math.sqrt(y[4] * y[4] + y[5] * y[5])
        ga, gz = gravitation(ax, y[6], par)
        x, yy, zz = -ga * y[4] / ax, -ga * y[5] / ax, -gz
    elif code == CORRECTED_COSINES or code == LITERAL_COSINES:
        return turn(y[10], y[11], y[12], y[13], 0.0, 0.0, 1.0)
    elif code == FREE_COSINES:
        return turn(y[6], y[7], y[8], y[9], 0.0, 0.0, 1.0)
    elif code == PUBLISHED:
        return turn(y[12], y[13], y[14], y[15], 0.0, 0.0, 1.0)
    elif code >= FIRST_ORDER:
        a, z, a1, z1, lat, lat1, lam, lam1, fa, fe, fz, dist, dist1 = truth(t, par)
        phi = mass_latitude(a, z, par)
        x, yy, zz = math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)
        if code == FIRST_ORDER:
            x, yy, zz = x + y[9] * zz - y[10] * yy, yy + y[10] * x - y[8] * zz, zz + y[8] * yy - y[9] * x
        else:
            x, yy, zz = x + y[9] / dist, yy + y[10] / dist, zz + y[11] / dist
    else:
        k = 6 if code == FREE else 10
        c = math.cos(y[k])
        return c * math.cos(y[k + 1]), c * math.sin(y[k + 1]), math.sin(y[k])
    n = math.sqrt(x * x + yy * yy + zz * zz)
    c, s = math.cos(par[RATE] * t), math.sin(par[RATE] * t)
    return (c * x + s * yy) / n, (-s * x + c * yy) / n, zz / n


@_jit
def true_angles(t, par):
    """(mass latitude, longitude), rad, where the vehicle is."""
    a, z, a1, z1, lat, lat1, lam, lam1, fa, fe, fz, dist, dist1 = truth(t, par)
    return mass_latitude(a, z, par), lam - par[RATE] * t


@_jit
def position_error(code, t, y, par):
    """(great circle, north, east) error in metres of the algorithm at time t: estimate minus truth.

    The angle between the computed and the true direction of minus the mass attraction times the distance z;
    north = z (lat - true), east = z cos(true lat) (lon - true).
    """
    x, yy, zz = direction(code, t, y, par)
    phi, lon = true_angles(t, par)
    dist = truth(t, par)[11]
    c, s, cf, sf = math.cos(lon), math.sin(lon), math.cos(phi), math.sin(phi)
    # the estimate with the true meridian as the first: differences of angles without loss of digits
    xe, ye = c * x + s * yy, -s * x + c * yy
    ae = math.hypot(xe, ye)
    far = math.sqrt((xe - cf) ** 2 + ye * ye + (zz - sf) ** 2)
    north = math.atan2(zz * cf - ae * sf, zz * sf + ae * cf)
    return 2.0 * dist * math.asin(min(1.0, 0.5 * far)), dist * north, dist * cf * math.atan2(ye, xe)


@_jit
def errors(code, par, time, states, out):
    """out (n, 3): great circle, north, east error, m, at every node."""
    for j in range(len(time)):
        out[j, 0], out[j, 1], out[j, 2] = position_error(code, time[j], states[j], par)


@_jit
def believed(code, t, y, par):
    """Quaternion q_iS of the platform's (strapdown: the body's) attitude as the algorithm believes it to be."""
    if code == EXACT:
        return y[6], y[7], y[8], y[9]
    if code == CORRECTED or code == LITERAL or code == FREE:
        k = 6 if code == FREE else 10
        m0, m1, m2, m3 = quat_local(y[k], y[k + 1])
        m0, m1, m2, m3 = quat_product(m0, m1, m2, m3, math.cos(0.5 * y[k + 2]), 0.0, 0.0, math.sin(0.5 * y[k + 2]))
    elif code == CORRECTED_COSINES or code == LITERAL_COSINES:
        m0, m1, m2, m3 = y[10], y[11], y[12], y[13]
    elif code == FREE_COSINES:
        m0, m1, m2, m3 = y[6], y[7], y[8], y[9]
    else:
        return y[0], y[1], y[2], y[3]
    half = 0.5 * par[RATE] * t
    m0, m1, m2, m3 = quat_product(math.cos(half), 0.0, 0.0, math.sin(half), m0, m1, m2, m3)
    if code <= LITERAL_COSINES:
        t0, t1, t2, t3 = quat_of_axes(0.0, y[9], y[8])
        m0, m1, m2, m3 = quat_product(m0, m1, m2, m3, t0, t1, t2, t3)
    return m0, m1, m2, m3


@_jit
def track(code, par, time, states, out):
    """out (n, 8): mass latitude, longitude (rad), velocity north, east (m/s) and believed quaternion q_iS."""
    dy, w = np.zeros(N_STATE), np.zeros(N_STATE)
    half = 0.25  # s: the velocity is the motion of the computed position about the node
    for j in range(len(time)):
        t, y = time[j], states[j]
        x, yy, zz = direction(code, t, y, par)
        ax = math.hypot(x, yy)
        out[j, 0], out[j, 1] = math.atan2(zz, ax), math.atan2(yy, x)
        b1, b2, b3 = par[DRIFT1] + par[RAMP1] * t, par[DRIFT2] + par[RAMP2] * t, par[DRIFT3] + par[RAMP3] * t
        rates(code, t, y, par, b1, b2, b3, dy)
        for i in range(N_STATE):
            w[i] = y[i] + half * dy[i]
        x1, y1, z1 = direction(code, t + half, w, par)
        for i in range(N_STATE):
            w[i] = y[i] - half * dy[i]
        x0, y0, z0 = direction(code, t - half, w, par)
        k = truth(t, par)[11] / (2.0 * half)
        out[j, 2] = k * (-zz * (x * (x1 - x0) + yy * (y1 - y0)) / ax + ax * (z1 - z0))
        out[j, 3] = k * (-yy * (x1 - x0) + x * (y1 - y0)) / ax
        out[j, 4], out[j, 5], out[j, 6], out[j, 7] = believed(code, t, y, par)
