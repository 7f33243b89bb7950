"""The aided INS filter between measurements: mechanization, transition, covariance at every epoch.

Mechanization: NED on WGS-84, quaternion; rotation and velocity increments with the coning and sculling terms of the
slope between this row and the one before; error model of Groves (2013), section 14.2.4, in metres, second order in dt.
Process noise enters half before and half after the transition, so that it spreads to second order too.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .aided_state import (
    ACC,
    ARW2,
    BA,
    BG,
    CLAT,
    DISP,
    DTRAW,
    DVI,
    FRAW,
    FSLOPE,
    GAP_A,
    GAP_S,
    GAP_W,
    GRAV,
    HEAD,
    HELD,
    HGT,
    ISO,
    LAT,
    LON,
    MA,
    MG,
    NAV,
    PAR,
    QUAT,
    RE,
    RING,
    RN,
    ROWS,
    SA,
    SG,
    SLOTS,
    TQ,
    TROW,
    VEL,
    VRW2,
    WIN,
    WMEAN,
    WRAW,
    WSLOPE,
    F,
    T,
    W,
    inverse3,
)
from .earth import E2, GAMMA_E, OMEGA, A
from .earth import F as FLAT
from .earth import K as SOMIGLIANA
from .earth import M as RATIO
from .rotation import dcm_from_quat, quat_from_rotvec, quat_product, wrap_pi

ACC_TAU = 0.1  # s: memory of the mean acceleration


@njit(cache=True, error_model="numpy")
def refresh_earth(x):
    """Radii, gravity and w_in of the present place and velocity."""
    s, c = math.sin(x[LAT]), math.cos(x[LAT])
    s2 = s * s
    w2 = 1.0 - E2 * s2
    w = math.sqrt(w2)
    x[RE] = A / w + x[HGT]
    x[RN] = A * (1.0 - E2) / (w2 * w) + x[HGT]
    x[CLAT] = max(c, 1e-9)
    h = x[HGT] / A
    g = GAMMA_E * (1.0 + SOMIGLIANA * s2) / w
    x[GRAV] = g * (1.0 - 2.0 * (1.0 + FLAT + RATIO - 2.0 * FLAT * s2) * h + 3.0 * h * h)
    x[WIN] = OMEGA * c + x[VEL + 1] / x[RE]
    x[WIN + 1] = -x[VEL] / x[RN]
    x[WIN + 2] = -OMEGA * s - x[VEL + 1] * s / (x[CLAT] * x[RE])


@njit(cache=True, error_model="numpy")
def gyro_inverse(x):
    """(I + M)^-1 of the gyros, row by row."""
    p = PAR
    return inverse3(
        1.0 + x[p + SG], x[p + MG], x[p + MG + 1],
        x[p + MG + 2], 1.0 + x[p + SG + 1], x[p + MG + 3],
        x[p + MG + 4], x[p + MG + 5], 1.0 + x[p + SG + 2],
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def accel_inverse(x):
    """(I + M)^-1 of the accelerometers, row by row."""
    p = PAR
    return inverse3(
        1.0 + x[p + SA], x[p + MA], x[p + MA + 1],
        x[p + MA + 2], 1.0 + x[p + SA + 1], x[p + MA + 3],
        x[p + MA + 4], x[p + MA + 5], 1.0 + x[p + SA + 2],
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def begin_row(x, c, t1, wx, wy, wz, fx, fy, fz):
    """A new row that covers (last row, t1]: its slopes from the row before, as measured. Tells a gap."""
    dt = t1 - x[TROW]
    gap = dt > c[GAP_S]
    fresh = x[ROWS] < 0.5 or gap or x[DTRAW] <= 0.0
    k = 0.0 if fresh else 2.0 / (dt + x[DTRAW])
    x[WSLOPE] = k * (wx - x[WRAW])
    x[WSLOPE + 1] = k * (wy - x[WRAW + 1])
    x[WSLOPE + 2] = k * (wz - x[WRAW + 2])
    x[FSLOPE] = k * (fx - x[FRAW])
    x[FSLOPE + 1] = k * (fy - x[FRAW + 1])
    x[FSLOPE + 2] = k * (fz - x[FRAW + 2])
    x[WRAW], x[WRAW + 1], x[WRAW + 2] = wx, wy, wz
    x[FRAW], x[FRAW + 1], x[FRAW + 2] = fx, fy, fz
    a = 1.0 if fresh else min(1.0, dt / ACC_TAU)
    x[WMEAN] += a * (wx - x[WMEAN])
    x[WMEAN + 1] += a * (wy - x[WMEAN + 1])
    x[WMEAN + 2] += a * (wz - x[WMEAN + 2])
    x[DTRAW] = -dt if gap else dt  # below zero: the length of a gap
    return gap


@njit(cache=True, error_model="numpy")
def end_row(x, t1, ring):
    """Ends a row: the past is kept for measurements that come late."""
    x[TROW] = t1
    x[ROWS] += 1.0
    i = int(x[HEAD]) % RING
    ring[i, 0] = x[T]
    for j in range(3):
        ring[i, 1 + j] = x[DISP + j]
        ring[i, 4 + j] = x[DVI + j]
        ring[i, 11 + j] = x[W + j]
    for j in range(4):
        ring[i, 7 + j] = x[QUAT + j]
    x[HEAD] += 1.0


@njit(cache=True, error_model="numpy")
def advance(x, P, S, dec, qd, beta, q, ie, c, dx, t1, gap, work, keep):
    """Nominal state, covariance P and (keep) the transition S since the last node, from x[T] to t1 inside a row.

    S (n, n): transition from the last node to the present. dec, qd (n): decay and noise of the parameters over dt;
    beta, q (n): their rates. work (2, NAV, n) scratch: transition's first rows, and their product. dx (n): open-loop
    error, carried along.
    """
    dt = t1 - x[T]
    if dt <= 0.0:
        return
    n = P.shape[0]
    if abs(dt - x[TQ]) > 1e-9 * dt:
        for i in range(NAV, n):
            b = beta[i]
            dec[i] = math.exp(-b * dt)
            qd[i] = q[i] * dt if b * dt < 1e-6 else 0.5 * q[i] / b * (1.0 - math.exp(-2.0 * b * dt))
            # half of it comes before the decay and half after it; together they are the whole
            qd[i] *= 2.0 / (1.0 + dec[i] * dec[i])
        x[TQ] = dt
    p = PAR
    q0, q1, q2, q3 = x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3]
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(q0, q1, q2, q3)
    v0, v1, v2 = x[VEL], x[VEL + 1], x[VEL + 2]
    i0, i1, i2, i3, i4, i5, i6, i7, i8 = gyro_inverse(x)
    j0, j1, j2, j3, j4, j5, j6, j7, j8 = accel_inverse(x)
    e0, e1, e2 = x[WRAW] - x[p + BG], x[WRAW + 1] - x[p + BG + 1], x[WRAW + 2] - x[p + BG + 2]
    w0, w1, w2 = i0 * e0 + i1 * e1 + i2 * e2, i3 * e0 + i4 * e1 + i5 * e2, i6 * e0 + i7 * e1 + i8 * e2
    e0, e1, e2 = x[FRAW] - x[p + BA], x[FRAW + 1] - x[p + BA + 1], x[FRAW + 2] - x[p + BA + 2]
    f0, f1, f2 = j0 * e0 + j1 * e1 + j2 * e2, j3 * e0 + j4 * e1 + j5 * e2, j6 * e0 + j7 * e1 + j8 * e2
    grav = x[GRAV]
    wn, we, wd = x[WIN], x[WIN + 1], x[WIN + 2]
    if gap:
        # Rate against n and acceleration are unknown in a gap: attitude and velocity are held.
        w0 = c00 * wn + c10 * we + c20 * wd
        w1 = c01 * wn + c11 * we + c21 * wd
        w2 = c02 * wn + c12 * we + c22 * wd
    x[W], x[W + 1], x[W + 2] = w0, w1, w2
    # rotation and velocity increments of b against i, resolved at the start of the interval
    k = dt * dt * dt / 12.0
    s0, s1, s2 = x[WSLOPE], x[WSLOPE + 1], x[WSLOPE + 2]
    g0, g1, g2 = x[FSLOPE], x[FSLOPE + 1], x[FSLOPE + 2]
    o0 = w0 * dt + k * (w1 * s2 - w2 * s1)
    o1 = w1 * dt + k * (w2 * s0 - w0 * s2)
    o2 = w2 * dt + k * (w0 * s1 - w1 * s0)
    if gap:
        a0 = a1 = a2 = 0.0
    else:
        h2 = 0.5 * dt * dt
        a0 = f0 * dt + h2 * (w1 * f2 - w2 * f1) + k * (w1 * g2 - w2 * g1 + f1 * s2 - f2 * s1)
        a1 = f1 * dt + h2 * (w2 * f0 - w0 * f2) + k * (w2 * g0 - w0 * g2 + f2 * s0 - f0 * s2)
        a2 = f2 * dt + h2 * (w0 * f1 - w1 * f0) + k * (w0 * g1 - w1 * g0 + f0 * s1 - f1 * s0)
        # the third order of a constant twist
        h2 = dt * dt * dt / 6.0
        r0, r1, r2 = w1 * f2 - w2 * f1, w2 * f0 - w0 * f2, w0 * f1 - w1 * f0
        a0 += h2 * (w1 * r2 - w2 * r1)
        a1 += h2 * (w2 * r0 - w0 * r2)
        a2 += h2 * (w0 * r1 - w1 * r0)
    x[F], x[F + 1], x[F + 2] = f0, f1, f2
    u0 = c00 * a0 + c01 * a1 + c02 * a2
    u1 = c10 * a0 + c11 * a1 + c12 * a2
    u2 = c20 * a0 + c21 * a1 + c22 * a2
    # n turns meanwhile by z = w_in dt: half of it acts on the increment
    z0, z1, z2 = wn * dt, we * dt, wd * dt
    t0 = u0 - 0.5 * (z1 * u2 - z2 * u1)
    t1_ = u1 - 0.5 * (z2 * u0 - z0 * u2)
    t2 = u2 - 0.5 * (z0 * u1 - z1 * u0)
    if gap:
        d0 = d1 = d2 = 0.0
    else:
        # Coriolis with the velocity at the middle: w_ie + w_in is 2 w_ie + w_en
        sl = math.sin(x[LAT])
        r0, r2 = wn + OMEGA * x[CLAT], wd - OMEGA * sl
        m0, m1, m2 = v0 + 0.5 * t0, v1 + 0.5 * t1_, v2 + 0.5 * (t2 + grav * dt)
        # and the transport rate of that velocity: that of the start would tilt n by dt dv/(2 R) in every turn
        y1 = (m1 - v1) / x[RE]
        y0, y2 = -(m0 - v0) / x[RN], -y1 * sl / x[CLAT]
        we += y0
        r0, r2 = r0 + y1, r2 + y2
        z0, z1, z2 = z0 + y1 * dt, z1 + y0 * dt, z2 + y2 * dt
        d0 = t0 - dt * (we * m2 - r2 * m1)
        d1 = t1_ - dt * (r2 * m0 - r0 * m2)
        d2 = t2 + grav * dt - dt * (r0 * m1 - we * m0)
    b0, b1, b2 = v0 + 0.5 * d0, v1 + 0.5 * d1, v2 + 0.5 * d2
    if c[HELD] > 0.5:
        v2 = b2 = d2 = 0.0
    x[VEL], x[VEL + 1], x[VEL + 2] = v0 + d0, v1 + d1, v2 + d2
    x[LAT] += b0 * dt / x[RN]
    x[LON] = wrap_pi(x[LON] + b1 * dt / (x[RE] * x[CLAT]))
    x[HGT] -= b2 * dt
    x[DISP] += b0 * dt
    x[DISP + 1] += b1 * dt
    x[DISP + 2] += b2 * dt
    x[DVI] += d0
    x[DVI + 1] += d1
    x[DVI + 2] += d2
    k = min(1.0, dt / ACC_TAU)
    x[ACC] += k * (d0 / dt - x[ACC])
    x[ACC + 1] += k * (d1 / dt - x[ACC + 1])
    x[ACC + 2] += k * (d2 / dt - x[ACC + 2])
    h0, h1, h2, h3 = quat_from_rotvec(o0, o1, o2)
    q0, q1, q2, q3 = quat_product(q0, q1, q2, q3, h0, h1, h2, h3)
    k = 1.0 - (z0 * z0 + z1 * z1 + z2 * z2) / 8.0
    q0, q1, q2, q3 = quat_product(k, -0.5 * z0, -0.5 * z1, -0.5 * z2, q0, q1, q2, q3)
    k = 1.5 - 0.5 * (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3] = k * q0, k * q1, k * q2, k * q3
    for s in range(SLOTS):
        if ie[s] >= 0 and beta[ie[s]] > 0.0:
            x[p + s] *= dec[ie[s]]

    # --- transition ----------------------------------------------------------------------------------------------
    Phi = work[0]
    M = work[1]
    inv_n, inv_e = 1.0 / x[RN], 1.0 / x[RE]
    sl = math.sin(x[LAT])
    tl = sl / x[CLAT]
    # C at the middle of the interval: its second order with the rate against n
    h = 0.5 * dt
    y0, y1, y2 = w0 * h, w1 * h, w2 * h
    a00, a01, a02 = c00 + c01 * y2 - c02 * y1, c01 + c02 * y0 - c00 * y2, c02 + c00 * y1 - c01 * y0
    a10, a11, a12 = c10 + c11 * y2 - c12 * y1, c11 + c12 * y0 - c10 * y2, c12 + c10 * y1 - c11 * y0
    a20, a21, a22 = c20 + c21 * y2 - c22 * y1, c21 + c22 * y0 - c20 * y2, c22 + c20 * y1 - c21 * y0
    oc, os_ = OMEGA * x[CLAT], OMEGA * sl
    # attitude: phi' = -w_in x phi + dw_in + C (db + dM w)
    Phi[0, 0], Phi[0, 1], Phi[0, 2] = 1.0, z2, -z1
    Phi[1, 0], Phi[1, 1], Phi[1, 2] = -z2, 1.0, z0
    Phi[2, 0], Phi[2, 1], Phi[2, 2] = z1, -z0, 1.0
    Phi[0, 4] = dt * inv_e
    Phi[1, 3] = -dt * inv_n
    Phi[2, 4] = -dt * tl * inv_e
    Phi[0, 6], Phi[0, 8] = -dt * os_ * inv_n, dt * b1 * inv_e * inv_e
    Phi[1, 8] = -dt * b0 * inv_n * inv_n
    Phi[2, 6] = -dt * (oc + b1 * inv_e / (x[CLAT] * x[CLAT])) * inv_n
    Phi[2, 8] = -dt * b1 * tl * inv_e * inv_e
    # velocity: dv' = f x phi - C (db + dM f) - (2 w_ie + w_en) x dv + ..., u is the force's increment
    Phi[3, 0], Phi[3, 1], Phi[3, 2] = 0.0, -u2, u1
    Phi[4, 0], Phi[4, 1], Phi[4, 2] = u2, 0.0, -u0
    Phi[5, 0], Phi[5, 1], Phi[5, 2] = -u1, u0, 0.0
    Phi[3, 3], Phi[3, 4], Phi[3, 5] = 1.0 + dt * b2 * inv_n, -dt * 2.0 * (os_ + b1 * tl * inv_e), dt * b0 * inv_n
    Phi[4, 3], Phi[4, 4] = dt * (2.0 * os_ + b1 * tl * inv_e), 1.0 + dt * (b0 * tl + b2) * inv_e
    Phi[4, 5] = dt * (2.0 * oc + b1 * inv_e)
    Phi[5, 3], Phi[5, 4], Phi[5, 5] = -dt * 2.0 * b0 * inv_n, -dt * 2.0 * (oc + b1 * inv_e), 1.0
    Phi[3, 6] = -dt * b1 * (2.0 * oc + b1 * inv_e / (x[CLAT] * x[CLAT])) * inv_n
    Phi[4, 6] = dt * (2.0 * OMEGA * (b0 * x[CLAT] - b2 * sl) + b1 * b0 * inv_e / (x[CLAT] * x[CLAT])) * inv_n
    Phi[5, 6] = dt * 2.0 * b1 * os_ * inv_n
    Phi[3, 8] = -dt * (b1 * b1 * tl - b0 * b2) * inv_n * inv_n
    Phi[4, 8] = dt * b1 * (b0 * tl + b2) * inv_e * inv_e
    Phi[5, 8] = dt * (2.0 * grav * inv_n - (b0 * b0 + b1 * b1) * inv_n * inv_n)
    # position in metres, second order in dt through the velocity
    for i in range(3):
        Phi[6 + i, 0], Phi[6 + i, 1], Phi[6 + i, 2] = h * Phi[3 + i, 0], h * Phi[3 + i, 1], h * Phi[3 + i, 2]
        Phi[6 + i, 3] = Phi[6 + i, 4] = Phi[6 + i, 5] = 0.0
        Phi[6 + i, 3 + i] = dt
        Phi[6 + i, 6] = Phi[6 + i, 7] = Phi[6 + i, 8] = 0.0
    Phi[6, 6], Phi[6, 8] = 1.0 - dt * b2 * inv_n, dt * b0 * inv_n
    Phi[7, 6], Phi[7, 7], Phi[7, 8] = dt * b1 * tl * inv_e, 1.0 - dt * (b2 + b0 * tl) * inv_e, dt * b1 * inv_e
    Phi[8, 8] = 1.0
    m = NAV  # columns of Phi in use
    b = ie[BG]
    if b >= 0:
        for i in range(3):
            if i == 0:
                x0, x1, x2 = a00, a01, a02
            elif i == 1:
                x0, x1, x2 = a10, a11, a12
            else:
                x0, x1, x2 = a20, a21, a22
            Phi[i, b] = dt * (x0 * i0 + x1 * i3 + x2 * i6)
            Phi[i, b + 1] = dt * (x0 * i1 + x1 * i4 + x2 * i7)
            Phi[i, b + 2] = dt * (x0 * i2 + x1 * i5 + x2 * i8)
        for j in range(b, b + 3):
            Phi[3, j] = 0.5 * (u1 * Phi[2, j] - u2 * Phi[1, j])
            Phi[4, j] = 0.5 * (u2 * Phi[0, j] - u0 * Phi[2, j])
            Phi[5, j] = 0.5 * (u0 * Phi[1, j] - u1 * Phi[0, j])
        m = max(m, b + 3)
    b = ie[BA]
    if b >= 0:
        for i in range(3):
            if i == 0:
                x0, x1, x2 = a00, a01, a02
            elif i == 1:
                x0, x1, x2 = a10, a11, a12
            else:
                x0, x1, x2 = a20, a21, a22
            Phi[3 + i, b] = -dt * (x0 * j0 + x1 * j3 + x2 * j6)
            Phi[3 + i, b + 1] = -dt * (x0 * j1 + x1 * j4 + x2 * j7)
            Phi[3 + i, b + 2] = -dt * (x0 * j2 + x1 * j5 + x2 * j8)
            for j in range(b, b + 3):
                Phi[6 + i, j] = h * Phi[3 + i, j]
        m = max(m, b + 3)
    m = _scale_columns(
        Phi, ie, m, dt, w0, w1, w2, f0, f1, f2, a00, a01, a02, a10, a11, a12, a20, a21, a22,
        i0, i1, i2, i3, i4, i5, i6, i7, i8, j0, j1, j2, j3, j4, j5, j6, j7, j8, u0, u1, u2,
    )  # fmt: skip
    if gap:
        for i in range(6):
            for j in range(m):
                Phi[i, j] = 0.0
            Phi[i, i] = 1.0
        for i in range(6, NAV):
            for j in range(NAV, m):
                Phi[i, j] = 0.0
            Phi[i, 0] = Phi[i, 1] = Phi[i, 2] = 0.0
    if c[HELD] > 0.5 and c[HELD] < 1.5:
        for j in range(n):
            P[5, j] = P[j, 5] = P[8, j] = P[j, 8] = 0.0
    # --- covariance ----------------------------------------------------------------------------------------------
    _noise(P, c, qd, x, dt, gap, c00, c01, c02, c10, c11, c12, c20, c21, c22)
    for i in range(NAV):
        for j in range(n):
            M[i, j] = 0.0
        for k_ in range(m):
            ph = Phi[i, k_]
            if ph != 0.0:
                for j in range(n):
                    M[i, j] += ph * P[k_, j]
    for i in range(NAV):
        for j in range(i, NAV):
            v = 0.0
            for k_ in range(m):
                v += M[i, k_] * Phi[j, k_]
            P[i, j] = v
            P[j, i] = v
        for j in range(NAV, n):
            v = M[i, j] * dec[j]
            P[i, j] = v
            P[j, i] = v
    for i in range(NAV, n):
        if beta[i] > 0.0:
            for j in range(NAV, n):
                P[i, j] *= dec[i]
                P[j, i] *= dec[i]
    _noise(P, c, qd, x, dt, gap, c00, c01, c02, c10, c11, c12, c20, c21, c22)
    if c[HELD] > 0.5 and c[HELD] < 1.5:
        for j in range(n):
            P[5, j] = P[j, 5] = P[8, j] = P[j, 8] = 0.0
    if keep:
        for i in range(NAV):
            for j in range(n):
                M[i, j] = 0.0
            for k_ in range(m):
                ph = Phi[i, k_]
                if ph != 0.0:
                    for j in range(n):
                        M[i, j] += ph * S[k_, j]
        for i in range(NAV):
            for j in range(n):
                S[i, j] = M[i, j]
        for i in range(NAV, n):
            if beta[i] > 0.0:
                S[i, i] *= dec[i]
    for i in range(NAV):
        v = 0.0
        for j in range(m):
            v += Phi[i, j] * dx[j]
        M[i, 0] = v
    for i in range(NAV):
        dx[i] = M[i, 0]
    for i in range(NAV, n):
        dx[i] *= dec[i]
    x[T] = t1
    refresh_earth(x)


@njit(cache=True, error_model="numpy")
def _scale_columns(
    Phi, ie, m, dt, w0, w1, w2, f0, f1, f2, a00, a01, a02, a10, a11, a12, a20, a21, a22,
    i0, i1, i2, i3, i4, i5, i6, i7, i8, j0, j1, j2, j3, j4, j5, j6, j7, j8, u0, u1, u2,
):  # fmt: skip
    """Columns of the IMU's scales and misalignments: each is the bias column of its row times the rate or force."""
    if ie[SG] < 0 and ie[MG] < 0 and ie[SA] < 0 and ie[MA] < 0:
        return m
    B = np.empty((3, 3))
    B[0, 0], B[0, 1], B[0, 2] = a00, a01, a02
    B[1, 0], B[1, 1], B[1, 2] = a10, a11, a12
    B[2, 0], B[2, 1], B[2, 2] = a20, a21, a22
    G = np.empty((3, 3))
    D = np.empty((3, 3))
    for i in range(3):
        G[i, 0] = dt * (B[i, 0] * i0 + B[i, 1] * i3 + B[i, 2] * i6)
        G[i, 1] = dt * (B[i, 0] * i1 + B[i, 1] * i4 + B[i, 2] * i7)
        G[i, 2] = dt * (B[i, 0] * i2 + B[i, 1] * i5 + B[i, 2] * i8)
        D[i, 0] = -dt * (B[i, 0] * j0 + B[i, 1] * j3 + B[i, 2] * j6)
        D[i, 1] = -dt * (B[i, 0] * j1 + B[i, 1] * j4 + B[i, 2] * j7)
        D[i, 2] = -dt * (B[i, 0] * j2 + B[i, 1] * j5 + B[i, 2] * j8)
    for kind in range(4):
        b = ie[SG] if kind == 0 else ie[MG] if kind == 1 else ie[SA] if kind == 2 else ie[MA]
        if b < 0:
            continue
        count = 6 if kind == 1 or kind == 3 else 3
        for a in range(count):
            if count == 3:
                row, column = a, a
            else:
                row = a // 2
                column = (
                    (1 if a == 0 else 2) if row == 0 else (0 if a == 2 else 2) if row == 1 else (0 if a == 4 else 1)
                )
            j = b + a
            if kind < 2:
                k = w0 if column == 0 else w1 if column == 1 else w2
                for i in range(3):
                    Phi[i, j] = G[i, row] * k
                Phi[3, j] = 0.5 * (u1 * Phi[2, j] - u2 * Phi[1, j])
                Phi[4, j] = 0.5 * (u2 * Phi[0, j] - u0 * Phi[2, j])
                Phi[5, j] = 0.5 * (u0 * Phi[1, j] - u1 * Phi[0, j])
            else:
                k = f0 if column == 0 else f1 if column == 1 else f2
                for i in range(3):
                    Phi[3 + i, j] = D[i, row] * k
                    Phi[6 + i, j] = 0.5 * dt * Phi[3 + i, j]
        m = max(m, b + count)
    return m


@njit(cache=True, error_model="numpy")
def _noise(P, c, qd, x, dt, gap, c00, c01, c02, c10, c11, c12, c20, c21, c22):
    """Half of the process noise of an interval."""
    n = P.shape[0]
    h = 0.5 * dt
    if gap:
        # Spread over the gap so that its whole adds (w gap)^2 and (a gap)^2.
        g = h * abs(x[DTRAW])
        for i in range(3):
            P[i, i] += c[GAP_W] * c[GAP_W] * g
            P[3 + i, 3 + i] += c[GAP_A] * c[GAP_A] * g
    elif c[ISO] > 0.5:
        for i in range(3):
            P[i, i] += c[ARW2] * h
            P[3 + i, 3 + i] += c[VRW2] * h
    else:
        for k in range(2):
            o = 3 * k
            a, b, d = (c[ARW2] * h, c[ARW2 + 1] * h, c[ARW2 + 2] * h) if k == 0 else (
                c[VRW2] * h, c[VRW2 + 1] * h, c[VRW2 + 2] * h
            )  # fmt: skip
            P[o, o] += c00 * c00 * a + c01 * c01 * b + c02 * c02 * d
            P[o + 1, o + 1] += c10 * c10 * a + c11 * c11 * b + c12 * c12 * d
            P[o + 2, o + 2] += c20 * c20 * a + c21 * c21 * b + c22 * c22 * d
            v = c00 * c10 * a + c01 * c11 * b + c02 * c12 * d
            P[o, o + 1] += v
            P[o + 1, o] += v
            v = c00 * c20 * a + c01 * c21 * b + c02 * c22 * d
            P[o, o + 2] += v
            P[o + 2, o] += v
            v = c10 * c20 * a + c11 * c21 * b + c12 * c22 * d
            P[o + 1, o + 2] += v
            P[o + 2, o + 1] += v
    for i in range(NAV, n):
        P[i, i] += 0.5 * qd[i]
