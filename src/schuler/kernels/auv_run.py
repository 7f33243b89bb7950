"""The AUV filter over a recording: epochs, nodes and rows of the solution; the online filter calls the same steps.

A node is an instant with measurements (or a second without): the smoother works from node to node. Kinds of external
measurements: 0 position, 1 GNSS velocity, 2 speed log, 3 DVL, 4 depth; internal: 5 levelling, 6 magnetometer.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .auv_measure import (
    measure_depth,
    measure_dvl,
    measure_heading,
    measure_level,
    measure_position,
    measure_speed,
    measure_velocity,
    velocity_rows,
)
from .auv_state import (
    COV_DT,
    DRIFT,
    E_D,
    E_E,
    E_M,
    E_N,
    LEVEL_S,
    LT,
    MODE,
    MT,
    NOMINAL,
    QUAT,
    ROWS,
    SIG_HEAD,
    SIG_TILT,
    SUBMERGED,
    TC,
    TELLS,
    TFIX,
    TNODE,
    VHREF,
    WAVE,
    N,
    T,
    advance_compass,
    advance_imu,
    flush,
)
from .rotation import euler_from_quat

SIG_FREE_DOWN = 0.3  # m/s, of the vertical velocity where nothing tells it
POSITION, VELOCITY, SPEED, BOTTOM_TRACK, DEPTH, LEVELLING, MAGNETOMETER = range(7)
INNOVATION = 9  # value (3), sigma (3), nis, degrees of freedom, used
OUT_T, OUT_DRIFT, OUT_VHREF, OUT_TELLS, OUT = NOMINAL, NOMINAL + 1, NOMINAL + 2, NOMINAL + 3, NOMINAL + 4  # of a row


@njit(cache=True, error_model="numpy")
def advance(x, P, X, c, t1, row, is_row):
    """Nominal state to t1 within an input row: rates and force (mode 0) or a compass row (mode 1)."""
    if c[MODE] < 0.5:
        mx, my, mz = 0.0, 0.0, 0.0
        has_mag = row.shape[0] >= 10
        if has_mag:
            mx, my, mz = row[7], row[8], row[9]
            has_mag = mx * mx + my * my + mz * mz > 0.0  # false for NaN
        advance_imu(x, P, X, c, t1, row[1], row[2], row[3], row[4], row[5], row[6], has_mag, mx, my, mz)
    else:
        advance_compass(x, P, X, c, t1, row[1], row[2], row[3], is_row)


@njit(cache=True, error_model="numpy")
def measure(x, P, X, c, kind, z, out):
    """One external measurement at x[T] (covariance flushed before). z (7): values and sigmas by kind."""
    if kind == POSITION:
        return measure_position(x, P, X, c, z[0], z[1], z[2], z[3], z[4], z[5], out)
    if kind == VELOCITY:
        measure_velocity(x, P, X, c, z[0], z[1], z[2], z[3], z[4], z[5], out)
    elif kind == SPEED:
        measure_speed(x, P, X, c, z[0], z[3], out)
    elif kind == BOTTOM_TRACK:
        measure_dvl(x, P, X, c, z[0], z[1], z[3], out)
    elif kind == DEPTH:
        measure_depth(x, P, X, c, z[0], z[3], out)
    return 0.0


@njit(cache=True, error_model="numpy")
def due(x, c):
    """Is an internal node due: a levelling or magnetometer block is full, or the last node is long ago?"""
    if c[MODE] > 0.5:
        return x[T] - x[TNODE] >= 60.0
    return x[LT] > c[LEVEL_S] - 0.01 or x[MT] > 0.95 or x[T] - x[TNODE] >= 2.0 - 1e-6


@njit(cache=True, error_model="numpy")
def inner_blocks(x, P, X, c, inner, used):
    """Levelling and magnetometer blocks that are full. inner (2, INNOVATION), used (2)."""
    used[0] = 0.0
    used[1] = 0.0
    if c[MODE] < 0.5:
        if x[MT] > 0.95:
            measure_heading(x, P, X, c, inner[1])
            used[1] = 1.0
        if x[LT] > c[LEVEL_S] - 0.01:
            measure_level(x, P, X, c, inner[0])
            used[0] = 1.0


@njit(cache=True, error_model="numpy")
def covariances(x, P, c, pos, vel, att):
    """Covariance of position NED (m^2), velocity over ground, and roll, pitch, heading (rad^2) into (3, 3) arrays."""
    for i in range(3):
        for j in range(3):
            pos[i, j] = P[E_N + i, E_N + j]
    pos[2, 2] = P[E_D, E_D] + x[VHREF]
    H = np.zeros((3, N))
    vn, ve, vd = velocity_rows(x, c, H)
    if x[TELLS] < 0.5:
        H[2, :] = 0.0
    for a in range(3):
        for b in range(3):
            v = 0.0
            for i in range(N):
                if H[a, i] != 0.0:
                    for j in range(N):
                        if H[b, j] != 0.0:
                            v += H[a, i] * P[i, j] * H[b, j]
            vel[a, b] = v
    vel[2, 2] += c[WAVE] * c[WAVE] * (2.0 if x[T] - x[TFIX] < 5.0 else SUBMERGED)
    if x[TELLS] < 0.5:
        vel[2, 2] = SIG_FREE_DOWN * SIG_FREE_DOWN
    att[:, :] = 0.0
    if c[MODE] > 0.5:
        s2 = c[SIG_HEAD] * c[SIG_HEAD]
        att[0, 0] = c[SIG_TILT] * c[SIG_TILT]
        att[1, 1] = att[0, 0]
        att[2, 2] = P[E_M, E_M] + s2
        vel[0, 0] += ve * ve * s2
        vel[1, 1] += vn * vn * s2
        vel[0, 1] -= vn * ve * s2
        vel[1, 0] -= vn * ve * s2
        return
    roll, pitch, head = euler_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    ch, sh = np.cos(head), np.sin(head)
    cp = max(np.cos(pitch), 1e-6)
    tp = np.sin(pitch) / cp
    # d(roll, pitch, heading) = J phi with C_hat = (I - [phi x]) C.
    J = np.zeros((3, 3))
    J[0, 0], J[0, 1] = -ch / cp, -sh / cp
    J[1, 0], J[1, 1] = sh, -ch
    J[2, 0], J[2, 1], J[2, 2] = -ch * tp, -sh * tp, -1.0
    for a in range(3):
        for b in range(3):
            v = 0.0
            for i in range(3):
                for j in range(3):
                    v += J[a, i] * P[i, j] * J[b, j]
            att[a, b] = v


@njit(cache=True, error_model="numpy")
def emit(x, P, X, c, ox, opos, ovel, oatt, i):
    """Row i of the solution: nominal state, time, drift flag, variance of the height's zero; and the covariances.

    The covariance is brought to the present on a copy, so that what is written never changes what is computed.
    """
    for j in range(NOMINAL):
        ox[i, j] = x[j]
    ox[i, OUT_T] = x[T]
    ox[i, OUT_DRIFT] = x[DRIFT]
    ox[i, OUT_VHREF] = x[VHREF]
    ox[i, OUT_TELLS] = x[TELLS]
    if x[TC] < x[T]:
        y, Q, Y = x.copy(), P.copy(), X.copy()
        flush(y, Q, Y, c)
        covariances(y, Q, c, opos[i], ovel[i], oatt[i])
    else:
        covariances(x, P, c, opos[i], ovel[i], oatt[i])


# Counters of a run live in an array: rows out, levelling and magnetometer blocks, nodes, measurements done.
ROWS_OUT, LEVELLED, HEADED, NODES, DONE = range(5)


@njit(cache=True, error_model="numpy")
def _open(x, P, X, c, nodes, n):
    """Begins a node: covariance up to the present, kept as predicted."""
    flush(x, P, X, c)
    i = n[NODES]
    if i < nodes[1].shape[0]:
        nodes[0][i] = x
        nodes[1][i] = P
        nodes[4][i] = X


@njit(cache=True, error_model="numpy")
def _all_at(x, P, X, c, t, mt, mkind, mz, innov, nodes, n):
    """Every measurement stamped t, in the order given."""
    i = n[NODES]
    while n[DONE] < mt.shape[0] and mt[n[DONE]] == t:
        k = n[DONE]
        grown = measure(x, P, X, c, mkind[k], mz[k], innov[k])
        if grown > 0.0 and i < nodes[1].shape[0]:
            nodes[1][i, E_N, E_N] += grown
            nodes[1][i, E_E, E_E] += grown
        n[DONE] += 1


@njit(cache=True, error_model="numpy")
def _close(x, P, X, nodes, ustd, n):
    """Ends a node: what is known now is where the next one starts from."""
    X[:, :] = P
    x[TNODE] = x[T]
    i = n[NODES]
    if i < nodes[2].shape[0]:
        nodes[2][i] = x
    if i < nodes[3].shape[0]:
        nodes[3][i] = P
    if i < ustd.shape[0]:
        for j in range(N):
            ustd[i, j] = np.sqrt(P[j, j])
    n[NODES] += 1


@njit(cache=True, error_model="numpy")
def run(x, P, X, c, rows, mt, mkind, mz, out_dt, ox, opos, ovel, oatt, innov, inner_t, inner, nodes, ustd, first, n):
    """Filters a recording; n (5,) int64 counts on (ROWS_OUT ... DONE); first: row to begin with.

    rows (r, 7|10) imu or (r, 4) compass, first column time; measurements sorted by time and kind: mt, mkind, mz (m, 7).
    Outputs: ox.. rows at least out_dt apart (0: every epoch; below 0 also every measurement); innov (m, INNOVATION);
    inner_t (2, k), inner (2, k, INNOVATION); nodes = (x-, P-, x+, P+, X) and ustd (sigmas) per node, as far as their
    lengths reach (length 0: not kept).
    """
    last = rows.shape[0]
    m = mt.shape[0]
    one = np.zeros((2, INNOVATION))
    used = np.zeros(2)
    next_out = x[T] - 1e-6
    compass = c[MODE] > 0.5
    while n[DONE] < m and mt[n[DONE]] < x[T]:
        n[DONE] += 1  # before the start
    for i in range(first, last + 1):
        # Past the last row a compass vehicle drifts on to its remaining fixes; an IMU's knows only its last instant.
        tail = i == last
        row = rows[min(i, last - 1)]
        t = row[0]
        if tail:
            t = np.inf if compass else x[T]
        between = n[DONE] < m and mt[n[DONE]] < t
        while between or not tail:
            # First what lies before the row, then the row itself, then (below) what bears its time.
            target = mt[n[DONE]] if between else t
            advance(x, P, X, c, target, row, not between)
            inside = due(x, c)
            if between or inside:
                _open(x, P, X, c, nodes, n)
                if between:
                    _all_at(x, P, X, c, target, mt, mkind, mz, innov, nodes, n)
                else:
                    inner_blocks(x, P, X, c, one, used)
                    for b in range(2):
                        k = n[LEVELLED + b]
                        if used[b] > 0.5 and k < inner_t.shape[1]:
                            inner_t[b, k] = x[T]
                            inner[b, k] = one[b]
                            n[LEVELLED + b] += 1
                _close(x, P, X, nodes, ustd, n)
            if between:
                if out_dt < 0.0 and n[ROWS_OUT] < ox.shape[0]:
                    emit(x, P, X, c, ox, opos, ovel, oatt, n[ROWS_OUT])
                    n[ROWS_OUT] += 1
            else:
                x[ROWS] += 1.0
                if x[T] - x[TC] >= c[COV_DT] - 1e-6:
                    flush(x, P, X, c)
                break
            between = n[DONE] < m and mt[n[DONE]] < t
        if n[DONE] < m and mt[n[DONE]] == t:
            _open(x, P, X, c, nodes, n)
            _all_at(x, P, X, c, t, mt, mkind, mz, innov, nodes, n)
            _close(x, P, X, nodes, ustd, n)
        if not tail and x[T] >= next_out and n[ROWS_OUT] < ox.shape[0]:
            emit(x, P, X, c, ox, opos, ovel, oatt, n[ROWS_OUT])
            n[ROWS_OUT] += 1
            if out_dt > 0.0:
                while next_out <= x[T] + 1e-9:
                    next_out += out_dt
