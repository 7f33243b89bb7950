"""Attitude from gyros, accelerometers and, where there is one, a magnetometer: one compiled pass over the rows.

Error state (N = 12), error = estimate - truth, C_hat = (I - [phi x]) C:

    phi (3, n) | gyro bias (3) | accelerometer bias (3) | u north, east (2) | compass error m

u is the horizontal specific force gone through a leaking integrator in n: u' = C f - u / tau, a low-passed specific
force times tau. Of a body whose velocity is bounded it is a bounded velocity too, whatever the accelerations were; a
tilt lets it grow without end. "u is zero, with the sigma that u has lately shown" is all that levels the attitude, and
nothing has to be gated. The magnetometer turns the heading, never the tilt (Schmidt gain); m is the part of its error
that lasts. Between nodes (c[NODE_S]) a row costs a quaternion product and a few sums; covariance and measurements
wait for the node.

Sources: error model of Groves (2013), section 14.2; Joseph form, Bucy and Joseph (1968); consider update, Schmidt
(1966).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .rotation import dcm_from_quat, quat_from_euler, quat_from_rotvec, quat_product, rotate_state_quat, wrap_pi

# --- error state (P) ---------------------------------------------------------------------------------------------
E_PHI, E_BG, E_BA, E_U, E_M = 0, 3, 6, 9, 11
N = 12
SETTLED = 0.03  # rad, sigma of a tilt component with which the heading is kept

# --- nominal state and bookkeeping (x) ---------------------------------------------------------------------------
QUAT, BG, BA, U, M = 0, 4, 7, 10, 12
NOMINAL = 13
T, TN = 13, 14  # time of the last row, of the last node
AI, SF, SM, NM = 15, 24, 27, 30  # since the node: integral of C dt (9), of C f dt (3), sum of C m (3), rows with m
TURN = 31  # since the node: integral of w dt (3)
PREV = 34  # rotation vector of the last row (3)
UVAR, TVAR = 37, 38  # variance of u as shown lately, and for how long it has been watched
NORM, DIP, TMAG = 39, 40, 41  # the field as learnt: size, dip angle, for how long
LW, LF, REST = 42, 45, 48  # low-passed rate (3) and specific force (3) in b; how long at rest
STATUS = 49  # 0: nothing yet, 1: level, 2: heading found too, 3: the tilt known well enough to keep it
BENT = 50  # variance of the heading that the field's disturbance gives, low-passed
SFB = 51  # since the start: integral of f dt (3) and time, until level
LAPSE, WVAR, AVAR = 55, 56, 57  # rows missing since the node; mean square rate, and acceleration, of the last seconds
NX = 58

# --- configuration (c) -------------------------------------------------------------------------------------------
NODE_S, ARW, Q_BG, VRW, Q_BA, SCALE = range(6)
TAU_U, SIG_U, TAU_UC, TAU_VAR = range(6, 10)
HAS_MAG, MAG_WHITE, MAG_STD, MAG_TAU, BEND, BEND_TAU, DECLINATION, FIELD_TAU, FIELD_NOISE, FIX_FIELD = range(10, 20)
REST_RATE, REST_FORCE, REST_S, REST_STD, REST_TURN = range(20, 25)
GAP_S, GAP_RATE, LEVEL_S, STD_TILT, STD_HEAD, ROLL0, PITCH0, HEAD0 = range(25, 33)
EARTH_N, EARTH_D = 33, 34
NC = 35

# --- what a node tells (one row) ---------------------------------------------------------------------------------
# time; innovation of u (2), its sigma (2); of the heading, its sigma (NaN: no field), 1 where taken at full weight;
# sigma of the heading by disturbance; size and dip of the field; 1 at rest
K_T, K_U, K_SU, K_Y, K_S, K_USED, K_BENT, K_NORM, K_DIP, K_REST = 0, 1, 3, 5, 6, 7, 8, 9, 10, 11
NK = 12


@njit(cache=True, error_model="numpy")
def predict(x, P, Phi, c, dt):
    """Covariance, and the compass error itself, over dt since the last node; Phi (N, N) is what it went through."""
    lost = math.exp(-dt / c[TAU_U])
    kept = math.exp(-dt / c[MAG_TAU])
    x[M] *= kept
    for i in range(N):
        for j in range(N):
            Phi[i, j] = 0.0
        Phi[i, i] = 1.0
    sx, sy, sz = x[SF], x[SF + 1], x[SF + 2]
    for j in range(3):
        a0, a1, a2 = x[AI + j], x[AI + 3 + j], x[AI + 6 + j]
        Phi[0, E_BG + j] = a0
        Phi[1, E_BG + j] = a1
        Phi[2, E_BG + j] = a2
        Phi[E_U, E_BG + j] = 0.5 * (sy * a2 - sz * a1)
        Phi[E_U + 1, E_BG + j] = 0.5 * (sz * a0 - sx * a2)
        Phi[E_U, E_BA + j] = -a0
        Phi[E_U + 1, E_BA + j] = -a1
    Phi[E_U, 1], Phi[E_U, 2] = -sz, sy
    Phi[E_U + 1, 0], Phi[E_U + 1, 2] = sz, -sx
    Phi[E_U, E_U] = lost
    Phi[E_U + 1, E_U + 1] = lost
    Phi[E_M, E_M] = kept
    if x[LAPSE] > 0.5:  # u began anew
        for i in range(N):
            Phi[i, E_U] = 0.0
            Phi[i, E_U + 1] = 0.0
    # rows of Phi P, top down: each row reads only rows below it or itself
    for j in range(N):
        p0, p1, p2 = P[0, j], P[1, j], P[2, j]
        u0 = lost * P[E_U, j] + Phi[E_U, 1] * p1 + Phi[E_U, 2] * p2
        u1 = lost * P[E_U + 1, j] + Phi[E_U + 1, 0] * p0 + Phi[E_U + 1, 2] * p2
        for k in range(3):
            g, a = P[E_BG + k, j], P[E_BA + k, j]
            p0 += Phi[0, E_BG + k] * g
            p1 += Phi[1, E_BG + k] * g
            p2 += Phi[2, E_BG + k] * g
            u0 += Phi[E_U, E_BG + k] * g + Phi[E_U, E_BA + k] * a
            u1 += Phi[E_U + 1, E_BG + k] * g + Phi[E_U + 1, E_BA + k] * a
        P[0, j], P[1, j], P[2, j] = p0, p1, p2
        P[E_U, j], P[E_U + 1, j] = u0, u1
        P[E_M, j] *= kept
    for i in range(N):
        p0, p1, p2 = P[i, 0], P[i, 1], P[i, 2]
        u0 = lost * P[i, E_U] + Phi[E_U, 1] * p1 + Phi[E_U, 2] * p2
        u1 = lost * P[i, E_U + 1] + Phi[E_U + 1, 0] * p0 + Phi[E_U + 1, 2] * p2
        for k in range(3):
            g, a = P[i, E_BG + k], P[i, E_BA + k]
            p0 += Phi[0, E_BG + k] * g
            p1 += Phi[1, E_BG + k] * g
            p2 += Phi[2, E_BG + k] * g
            u0 += Phi[E_U, E_BG + k] * g + Phi[E_U, E_BA + k] * a
            u1 += Phi[E_U + 1, E_BG + k] * g + Phi[E_U + 1, E_BA + k] * a
        P[i, 0], P[i, 1], P[i, 2] = p0, p1, p2
        P[i, E_U], P[i, E_U + 1] = u0, u1
        P[i, E_M] *= kept
    turned = x[TURN] * x[TURN] + x[TURN + 1] * x[TURN + 1] + x[TURN + 2] * x[TURN + 2]
    q = c[ARW] * c[ARW] * dt + c[SCALE] * c[SCALE] * turned
    for i in range(3):
        P[i, i] += q
        P[E_BG + i, E_BG + i] += c[Q_BG] * c[Q_BG] * dt
        P[E_BA + i, E_BA + i] += c[Q_BA] * c[Q_BA] * dt
    P[E_U, E_U] += c[VRW] * c[VRW] * dt
    P[E_U + 1, E_U + 1] += c[VRW] * c[VRW] * dt
    P[E_M, E_M] += c[MAG_STD] * c[MAG_STD] * (1.0 - kept * kept)


@njit(cache=True, error_model="numpy")
def update(P, d, h, y, R, heading_only, work):
    """One scalar measurement y = h e + noise of variance R; d (N) gathers the errors found.

    heading_only : the gain on tilt, accelerometer bias and u is zero (Joseph form: valid for any gain). work (2, N).
    """
    ch, K = work[0], work[1]
    S = R
    for i in range(N):
        v = 0.0
        for j in range(N):
            v += P[i, j] * h[j]
        ch[i] = v
    left = y
    for i in range(N):
        S += h[i] * ch[i]
        left -= h[i] * d[i]
    for i in range(N):
        K[i] = ch[i] / S
    if heading_only:
        K[0] = 0.0
        K[1] = 0.0
        for i in range(E_BA, E_M):
            K[i] = 0.0
    for i in range(N):
        d[i] += K[i] * left
        for j in range(i + 1):
            v = 0.5 * (P[i, j] + P[j, i]) - K[i] * ch[j] - ch[i] * K[j] + K[i] * K[j] * S
            P[i, j] = v
            P[j, i] = v


@njit(cache=True, error_model="numpy")
def correct(x, d):
    """Takes the errors d (N) out of the nominal state."""
    rotate_state_quat(x, QUAT, d[0], d[1], d[2])
    for i in range(E_BG, N):
        x[i + 1] -= d[i]


@njit(cache=True, error_model="numpy")
def level_at_start(x, P, c):
    """Roll and pitch from the mean specific force so far, heading as given or zero."""
    fx, fy, fz = x[SFB], x[SFB + 1], x[SFB + 2]
    size = math.sqrt(fx * fx + fy * fy + fz * fz)
    if not size > 0.0:
        return
    roll = math.atan2(-fy, -fz)
    pitch = math.atan2(fx, math.sqrt(fy * fy + fz * fz))
    if c[ROLL0] == c[ROLL0]:
        roll = c[ROLL0]
    if c[PITCH0] == c[PITCH0]:
        pitch = c[PITCH0]
    head = c[HEAD0] if c[HEAD0] == c[HEAD0] else 0.0
    x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3] = quat_from_euler(roll, pitch, head)
    P[0, 0] = P[1, 1] = c[STD_TILT] * c[STD_TILT]
    P[2, 2] = c[STD_HEAD] * c[STD_HEAD]
    P[E_U, E_U] = P[E_U + 1, E_U + 1] = x[UVAR]  # u is moving already
    x[STATUS] = 3.0 if c[HEAD0] == c[HEAD0] else 1.0


@njit(cache=True, error_model="numpy")
def clear(x):
    """Starts the sums of a new node."""
    for i in range(AI, PREV):
        x[i] = 0.0


@njit(cache=True, error_model="numpy")
def heading_row(mx, my, mz, h):
    """h (N): how the azimuth of the field (mx, my, mz), turned by C_hat, minus the compass error follows the errors."""
    for i in range(N):
        h[i] = 0.0
    flat2 = mx * mx + my * my
    h[0] = mz * mx / flat2
    h[1] = mz * my / flat2
    h[2] = -1.0
    h[E_M] = -1.0


@njit(cache=True, error_model="numpy")
def turn_horizon(x, P, angle):
    """The heading lowered by `angle`: attitude, u and all that is written in n north and east turn with it."""
    rotate_state_quat(x, QUAT, 0.0, 0.0, -angle)
    co, si = math.cos(angle), math.sin(angle)
    x[U], x[U + 1] = co * x[U] + si * x[U + 1], co * x[U + 1] - si * x[U]
    for a in (E_PHI, E_U):
        for i in range(N):
            P[a, i], P[a + 1, i] = co * P[a, i] + si * P[a + 1, i], co * P[a + 1, i] - si * P[a, i]
        for i in range(N):
            P[i, a], P[i, a + 1] = co * P[i, a] + si * P[i, a + 1], co * P[i, a + 1] - si * P[i, a]


@njit(cache=True, error_model="numpy")
def measure_field(x, P, c, d, h, told, work):
    """Heading from the mean field since the node; its sigma follows how far size and dip are from what was learnt."""
    mx, my, mz = x[SM] / x[NM], x[SM + 1] / x[NM], x[SM + 2] / x[NM]
    flat = math.sqrt(mx * mx + my * my)
    size = math.sqrt(flat * flat + mz * mz)
    if not flat > 0.02 * size:
        return
    dip = math.atan2(mz, flat)
    angle = math.atan2(my, mx)
    dt = x[T] - x[TN]
    if x[TMAG] <= 0.0:
        if c[FIX_FIELD] < 0.5:
            x[NORM] = size
            x[DIP] = dip
    settled = x[STATUS] > 2.5
    off_size = size / x[NORM] - 1.0
    off_dip = dip - x[DIP]
    # Of a disturbance, size and dip show two components of three; the third one turns the heading by as much. Noise and
    # the filter's own tilt error show as well.
    bends2 = (size / flat) * (size / flat)
    bent2 = c[BEND] * c[BEND] * 0.5 * (off_size * off_size + off_dip * off_dip) * bends2
    x[BENT] += (bent2 - x[BENT]) * min(1.0, dt / 0.5)
    own2 = (c[FIELD_NOISE] * c[FIELD_NOISE] + 0.25 * (P[0, 0] + P[1, 1])) * bends2
    bent2 = max(max(bent2, x[BENT]) - own2, 0.0)
    if c[FIX_FIELD] < 0.5 and settled:
        x[TMAG] = min(x[TMAG] + dt, c[FIELD_TAU])
        g = dt / x[TMAG]
        x[NORM] += g * (size - x[NORM])
        x[DIP] += g * off_dip
    heading_row(mx, my, mz, h)
    y = wrap_pi(angle - c[DECLINATION] - x[M])
    white2 = c[MAG_WHITE] * c[MAG_WHITE] / x[NM]
    R = white2 + bent2 * max(1.0, 2.0 * c[BEND_TAU] / dt)
    if not settled:
        # A tilt error turns the heading by its own size times tan(dip), too much for a linear filter: until the tilt is
        # known the heading is found anew at every node, and nothing is learnt from how it changes.
        turn_horizon(x, P, y)
        for i in range(N):
            P[2, i] = 0.0
            P[i, 2] = 0.0
        P[2, 2] = 10.0
        heading_row(mx * math.cos(y) + my * math.sin(y), my * math.cos(y) - mx * math.sin(y), mz, h)
        x[STATUS] = 2.0 if P[0, 0] + P[1, 1] > 2.0 * SETTLED * SETTLED else 3.0
        y = 0.0
    S = R
    for i in range(N):
        for j in range(N):
            S += h[i] * P[i, j] * h[j]
    told[K_Y] = y
    told[K_S] = math.sqrt(S - R + white2 + bent2)
    told[K_BENT] = math.sqrt(bent2)
    told[K_NORM] = size
    told[K_DIP] = dip
    if y * y > 9.0 * S:
        R += y * y / 9.0 - S  # a robust weight: what lies far out is believed less, never shut out for good
        told[K_USED] = 0.0
    else:
        told[K_USED] = 1.0
    update(P, d, h, y, R, True, work)


@njit(cache=True, error_model="numpy")
def resting(x, P, c):
    """Still for long enough, and turning no faster than the bias may explain."""
    if x[REST] < c[REST_S]:
        return False
    for i in range(3):
        off = x[LW + i] - x[BG + i]
        if off * off > 9.0 * P[E_BG + i, E_BG + i] + c[REST_TURN] * c[REST_TURN]:
            return False
    return True


@njit(cache=True, error_model="numpy")
def node(x, P, c, told, Phi, xm, Pm, work):
    """Covariance to now, then the measurements gathered since the last node. xm (NOMINAL), Pm (N, N): before them."""
    dt = x[T] - x[TN]
    predict(x, P, Phi, c, dt)
    for i in range(NOMINAL):
        xm[i] = x[i]
    for i in range(N):
        for j in range(N):
            Pm[i, j] = P[i, j]
    d, h = work[2], work[3]
    for i in range(N):
        d[i] = 0.0
        h[i] = 0.0
    for i in range(NK):
        told[i] = 0.0
    told[K_T] = x[T]
    told[K_S] = np.nan
    # The sigma of u: as shown lately, more where u is beyond three of them now. How long a value lasts: as long as it
    # takes the acceleration to change it, at least TAU_UC; the nodes within that time share what it tells.
    shown = 0.5 * (x[U] * x[U] + x[U + 1] * x[U + 1] - P[E_U, E_U] - P[E_U + 1, E_U + 1])
    push = 0.5 * (x[SF] * x[SF] + x[SF + 1] * x[SF + 1]) / (dt * dt)
    x[TVAR] = min(x[TVAR] + dt, c[TAU_VAR])
    x[AVAR] += (push - x[AVAR]) * dt / x[TVAR]
    swing2 = c[SIG_U] * c[SIG_U] + max(x[UVAR], shown / 9.0)
    lasts = min(max(c[TAU_UC], math.sqrt(swing2 / max(x[AVAR], 1e-6))), c[TAU_U])
    R = swing2 * max(1.0, 2.0 * lasts / dt)
    x[UVAR] += (max(shown, 0.0) - x[UVAR]) * dt / x[TVAR]
    for i in range(2):
        told[K_U + i] = -x[U + i]
        told[K_SU + i] = math.sqrt(P[E_U + i, E_U + i] + swing2)
        h[E_U + i] = -1.0
        update(P, d, h, -x[U + i], R, False, work)
        h[E_U + i] = 0.0
    if resting(x, P, c):
        told[K_REST] = 1.0
        R = c[REST_STD] * c[REST_STD] * max(1.0, 0.1 / dt)
        for i in range(3):
            h[E_BG + i] = -1.0
            update(P, d, h, x[TURN + i] / dt - x[BG + i], R, False, work)
            h[E_BG + i] = 0.0
    correct(x, d)
    if c[HAS_MAG] > 0.5 and x[NM] > 0.5:
        for i in range(N):
            d[i] = 0.0
        measure_field(x, P, c, d, h, told, work)
        correct(x, d)
    x[TN] = x[T]
    x[LAPSE] = 0.0
    clear(x)


@njit(cache=True, error_model="numpy")
def step(x, P, c, t, wx, wy, wz, fx, fy, fz, mx, my, mz, told, Phi, xm, Pm, work):
    """One row: means over (x[T], t] of rate and specific force, field at t (NaN: none). True where it made a node."""
    dt = t - x[T]
    x[T] = t
    if dt > c[GAP_S]:
        # how the body turned meanwhile is not known: by as much as it does otherwise
        rate2 = max(c[GAP_RATE] * c[GAP_RATE], x[WVAR])
        for i in range(3):
            P[i, i] += rate2 * dt * dt
        x[U] = x[U + 1] = 0.0
        for i in range(N):
            P[E_U, i] = P[i, E_U] = P[E_U + 1, i] = P[i, E_U + 1] = 0.0
        P[E_U, E_U] = P[E_U + 1, E_U + 1] = x[UVAR] + c[SIG_U] * c[SIG_U]
        x[TN] = t
        x[LAPSE] = 1.0
        x[REST] = 0.0
        clear(x)
        x[PREV] = x[PREV + 1] = x[PREV + 2] = 0.0
        return False
    if x[STATUS] < 0.5:
        x[SFB] += fx * dt
        x[SFB + 1] += fy * dt
        x[SFB + 2] += fz * dt
        x[SFB + 3] += dt
        if x[SFB + 3] < c[LEVEL_S]:
            return False
        x[LW], x[LW + 1], x[LW + 2] = wx, wy, wz
        x[LF], x[LF + 1], x[LF + 2] = fx, fy, fz
        level_at_start(x, P, c)
        x[TN] = t
        clear(x)
        return False
    # rest: rate and specific force stay at their own low-passed values
    a = min(1.0, dt / 0.5)
    ex, ey, ez = wx - x[LW], wy - x[LW + 1], wz - x[LW + 2]
    x[LW] += a * ex
    x[LW + 1] += a * ey
    x[LW + 2] += a * ez
    still = ex * ex + ey * ey + ez * ez < c[REST_RATE] * c[REST_RATE]
    ex, ey, ez = fx - x[LF], fy - x[LF + 1], fz - x[LF + 2]
    x[LF] += a * ex
    x[LF + 1] += a * ey
    x[LF + 2] += a * ez
    still = still and ex * ex + ey * ey + ez * ez < c[REST_FORCE] * c[REST_FORCE]
    x[WVAR] += min(1.0, dt / 5.0) * (wx * wx + wy * wy + wz * wz - x[WVAR])
    x[REST] = x[REST] + dt if still else 0.0
    # attitude; the rate that changes within the row is taken as linear (two-row coning)
    px, py, pz = (wx - x[BG]) * dt, (wy - x[BG + 1]) * dt, (wz - x[BG + 2]) * dt
    qx, qy, qz = x[PREV], x[PREV + 1], x[PREV + 2]
    k = 1.0 / 12.0
    d0, d1, d2, d3 = quat_from_rotvec(
        px + k * (qy * pz - qz * py), py + k * (qz * px - qx * pz), pz + k * (qx * py - qy * px)
    )
    x[PREV], x[PREV + 1], x[PREV + 2] = px, py, pz
    x[TURN] += wx * dt
    x[TURN + 1] += wy * dt
    x[TURN + 2] += wz * dt
    # specific force turns with the body: C at the middle of the row
    b0, b1, b2, b3 = x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3]
    q0, q1, q2, q3 = quat_product(b0, b1, b2, b3, d0, d1, d2, d3)
    n = 1.5 - 0.5 * (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    q0, q1, q2, q3 = n * q0, n * q1, n * q2, n * q3
    if c[EARTH_N] != 0.0 or c[EARTH_D] != 0.0:
        e0, e1, e2, e3 = quat_from_rotvec(-c[EARTH_N] * dt, 0.0, -c[EARTH_D] * dt)
        q0, q1, q2, q3 = quat_product(e0, e1, e2, e3, q0, q1, q2, q3)
    x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3] = q0, q1, q2, q3
    m0, m1, m2, m3 = b0 + q0, b1 + q1, b2 + q2, b3 + q3
    n = 1.0 / math.sqrt(m0 * m0 + m1 * m1 + m2 * m2 + m3 * m3)
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(n * m0, n * m1, n * m2, n * m3)
    fx, fy, fz = fx - x[BA], fy - x[BA + 1], fz - x[BA + 2]
    fn = c00 * fx + c01 * fy + c02 * fz
    fe = c10 * fx + c11 * fy + c12 * fz
    fd = c20 * fx + c21 * fy + c22 * fz
    x[AI] += c00 * dt
    x[AI + 1] += c01 * dt
    x[AI + 2] += c02 * dt
    x[AI + 3] += c10 * dt
    x[AI + 4] += c11 * dt
    x[AI + 5] += c12 * dt
    x[AI + 6] += c20 * dt
    x[AI + 7] += c21 * dt
    x[AI + 8] += c22 * dt
    x[SF] += fn * dt
    x[SF + 1] += fe * dt
    x[SF + 2] += fd * dt
    leak = 1.0 - dt / c[TAU_U]
    x[U] = x[U] * leak + fn * dt
    x[U + 1] = x[U + 1] * leak + fe * dt
    if c[HAS_MAG] > 0.5 and mx * mx + my * my + mz * mz > 0.0:  # false for NaN
        # the field is of the row's end: half a row further than C above
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(q0, q1, q2, q3)
        x[SM] += c00 * mx + c01 * my + c02 * mz
        x[SM + 1] += c10 * mx + c11 * my + c12 * mz
        x[SM + 2] += c20 * mx + c21 * my + c22 * mz
        x[NM] += 1.0
    if t - x[TN] < c[NODE_S] - 0.5 * dt:
        return False
    node(x, P, c, told, Phi, xm, Pm, work)
    return True


@njit(cache=True, error_model="numpy")
def run(time, w, f, m, x, P, c, out_dt, ot, oq, op, told, hx, hs, nodes, counts):
    """All rows: time (n,), w, f (n, 3), m (n, 3) or (0, 3).

    Rows of the solution, one each out_dt seconds (0: every row) from where attitude and heading are known: ot (k,),
    oq (k, 4), op (k, 3, 3) of phi. A row a node: told (j, NK), nominal state hx (j, NOMINAL), sigmas hs (j, N); for the
    smoother nodes = predicted state and covariance, updated covariance, transition (j or 0 rows). counts (2): rows and
    nodes.
    """
    nx, nP, uP, nX = nodes
    Phi = np.zeros((N, N))
    Pm = np.zeros((N, N))
    xm = np.zeros(NOMINAL)
    work = np.zeros((4, N))
    has = m.shape[0] > 0
    keep = nx.shape[0] > 0
    enough = 1.5 if c[HAS_MAG] > 0.5 else 0.5
    no, nn = 0, 0
    due = -math.inf
    mx, my, mz = np.nan, np.nan, np.nan
    for i in range(time.shape[0]):
        if has:
            mx, my, mz = m[i, 0], m[i, 1], m[i, 2]
        made = step(
            x, P, c, time[i], w[i, 0], w[i, 1], w[i, 2], f[i, 0], f[i, 1], f[i, 2], mx, my, mz, told[nn],
            Phi, xm, Pm, work,
        )  # fmt: skip
        if x[STATUS] < enough:
            continue
        if made:
            for k in range(NOMINAL):
                hx[nn, k] = x[k]
            for k in range(N):
                hs[nn, k] = math.sqrt(max(P[k, k], 0.0))
            if keep:
                nx[nn, :] = xm
                nP[nn, :, :] = Pm
                uP[nn, :, :] = P
                nX[nn, :, :] = Phi
            nn += 1
        if time[i] >= due:
            if due == -math.inf:
                due = time[i] - 1e-6
            if out_dt > 0.0:
                due += out_dt * (1.0 + math.floor((time[i] - due) / out_dt))
            ot[no] = time[i]
            for k in range(4):
                oq[no, k] = x[QUAT + k]
            for k in range(3):
                for j in range(3):
                    op[no, k, j] = P[k, j]
            no += 1
    counts[0] = no
    counts[1] = nn
