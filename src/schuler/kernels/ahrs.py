"""Attitude from gyros, accelerometers and, where there is one, a magnetometer: one compiled pass over the rows.

States and their errors: `ahrs_state`. Between nodes a row costs a quaternion product and a few sums; covariance and
measurements wait for the node.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .ahrs_state import (
    AI,
    AVAR,
    BA,
    BEND,
    BEND_TAU,
    BENT,
    BG,
    DECLINATION,
    DIP,
    E_BG,
    E_M,
    E_PHI,
    E_U,
    EARTH_D,
    EARTH_N,
    FIELD_NOISE,
    FIELD_TAU,
    FIND_IRON,
    FIX_FIELD,
    GAP_RATE,
    GAP_S,
    HARD,
    HAS_MAG,
    IRON,
    K_BENT,
    K_DIP,
    K_IRON,
    K_NORM,
    K_REST,
    K_S,
    K_SU,
    K_T,
    K_U,
    K_USED,
    K_Y,
    LAPSE,
    LEVEL_S,
    LF,
    LW,
    MAG_WHITE,
    NK,
    NM,
    NODE_S,
    NOMINAL,
    NORM,
    NX,
    PREV,
    QUAT,
    RAW,
    REST,
    REST_FORCE,
    REST_RATE,
    REST_S,
    REST_STD,
    REST_TURN,
    SETTLED,
    SF,
    SFB,
    SIG_U,
    SM,
    STATUS,
    TAU_U,
    TAU_UC,
    TAU_VAR,
    TMAG,
    TN,
    TURN,
    TVAR,
    UVAR,
    WVAR,
    M,
    N,
    T,
    U,
    clear,
    correct,
    level_at_start,
    predict,
    update,
)
from .hard_iron import LEAST, UNIT, B, look
from .rotation import dcm_from_quat, quat_from_rotvec, quat_product, rotate_state_quat, wrap_pi

WORK = 8  # rows of the work array


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
def take_off_iron(x, A):
    """Looks at the field in b for a hard iron; where one is found that is new, the heading is found anew without it."""
    found = x[HARD:NX]
    if not look(found, A, x[RAW], x[RAW + 1], x[RAW + 2]):
        return
    change2 = 0.0
    for i in range(3):
        change = found[B + i] - x[IRON + i]
        change2 += change * change
        x[IRON + i] = found[B + i]
    x[NM] = 0.0  # what has been gathered still holds the old one
    if change2 > LEAST * LEAST * found[UNIT] * found[UNIT]:
        x[TMAG] = 0.0
        x[BENT] = 0.0
        x[STATUS] = 2.0


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
    if c[FIND_IRON] > 0.5 and x[NM] > 0.5:
        take_off_iron(x, work[4:8])
    if c[HAS_MAG] > 0.5 and x[NM] > 0.5:
        for i in range(N):
            d[i] = 0.0
        measure_field(x, P, c, d, h, told, work)
        correct(x, d)
    told[K_IRON] = math.sqrt(x[IRON] * x[IRON] + x[IRON + 1] * x[IRON + 1] + x[IRON + 2] * x[IRON + 2])
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
        x[RAW], x[RAW + 1], x[RAW + 2] = mx, my, mz
        mx, my, mz = mx - x[IRON], my - x[IRON + 1], mz - x[IRON + 2]
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
    work = np.zeros((WORK, N))
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
