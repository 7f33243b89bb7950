"""The aided INS filter over a recording: rows, measurements, nodes, rows of the solution; the online filter calls the
same steps.

A node is an instant with measurements, or NODE_DT without: the smoother works from node to node. Nothing is kept of
what lies between two nodes but the transition.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .aided_measure import (
    ATTITUDE,
    BOTTOM_TRACK,
    COURSE,
    DEPTH,
    DOWN_VELOCITY,
    HEIGHT,
    HEIGHT_FIX,
    LIDAR,
    LOOK,
    MAGNETOMETER,
    NONHOLONOMIC,
    POSITION,
    RANGE,
    SIGHTING,
    SPEED,
    STANDING_V,
    STANDING_W,
    TERRAIN,
    VELOCITY,
    attitude,
    bottom_track,
    course,
    curvature,
    depth,
    distance,
    euler_slopes,
    height,
    look_back,
    magnetometer,
    nonholonomic,
    position,
    speed,
    standing_rate,
    standing_velocity,
    velocity,
)
from .aided_optics import lidar_point, lidar_terrain, sighting
from .aided_propagate import advance, begin_row, end_row
from .aided_state import (
    AHEAD,
    BADH,
    BADS,
    BADV,
    DR,
    DTRAW,
    KEPT,
    NEXT,
    NHC_DT,
    NHC_Y,
    NHC_Z,
    NODE_DT,
    NOMINAL,
    PAR,
    SLIP,
    STILL_DT,
    STILL_S,
    SWAY_Y,
    SWAY_Z,
    TD,
    TG,
    TNHC,
    TNODE,
    TOLD,
    TROW,
    TS,
    TSEEN,
    TSTILL,
    TV,
    V_AHEAD,
    VEL,
    WMEAN,
    ZARU,
    ZUPT,
    T,
    W,
    correct,
)
from .aided_update import INNOVATION, take

OUT = NOMINAL + 1  # a row of the solution: nominal state, time
USER = 100  # kinds from here on are measured by the caller
ZW = 12  # numbers of a measurement
STILL_MIN = 0.5  # s: it has stood for this long
# counts of a run: row, measurement, rows out, inner innovations, nodes, next row of output due (in x's time) apart
ROW, MEAS, ROWS_OUT, INNER, NODES, STATUS = range(6)


@njit(cache=True, error_model="numpy")
def measure(x, P, ie, c, dx, ring, world, kind, z, H, r, R, out):
    """One measurement of any built-in kind; out (2, INNOVATION): its blocks (the second NaN where there is one only).

    world: the height model's grid (4) and heights. z: what was measured first, then sigmas, as `aiding.aided_rows` lays
    them. Returns the variance put on the position
    N, E, D by a fix that was forced in (3 numbers).
    """
    n = P.shape[0]
    for a in range(3):
        r[a] = 0.0
        for j in range(n):
            H[a, j] = 0.0
    for j in range(INNOVATION):
        out[1, j] = np.nan
    look = np.empty(LOOK)
    g0 = g1 = 0.0
    if kind == POSITION:
        look_back(x, ring, x[PAR + TG] + c[AHEAD], look)
        rows = 2 if math.isnan(z[2]) else 3
        if rows == 2 or not (math.isnan(z[0])):
            m = position(x, ie, c, look, z, rows, H, r)
            R[0], R[1], R[2] = z[3] * z[3], z[4] * z[4], z[5] * z[5]
            g0 = take(x, P, ie, c, dx, H, r, R, 0, 2, POSITION, BADH, out[0])
            if out[0, 8] > 0.0:
                x[TOLD] = x[T]
            if m == 3:
                if out[0, 8] > 0.0:
                    # The state has moved: the down row again, at the new state.
                    for a in range(3):
                        r[a] = 0.0
                        for j in range(n):
                            H[a, j] = 0.0
                    position(x, ie, c, look, z, 3, H, r)
                g1 = take(x, P, ie, c, dx, H, r, R, 2, 1, HEIGHT_FIX, BADV, out[1])
        else:
            position(x, ie, c, look, z, 1, H, r)
            R[0] = z[5] * z[5]
            g1 = take(x, P, ie, c, dx, H, r, R, 0, 1, HEIGHT_FIX, BADV, out[1])
        x[TSEEN] = x[T]
    elif kind == VELOCITY:
        look_back(x, ring, x[PAR + TV] + c[V_AHEAD], look)
        velocity(x, ie, look, z, H, r)
        R[0], R[1], R[2] = z[3] * z[3], z[4] * z[4], z[5] * z[5]
        take(x, P, ie, c, dx, H, r, R, 0, 2, VELOCITY, BADS, out[0])
        if not math.isnan(z[2]):
            if out[0, 8] > 0.0:
                for a in range(3):
                    r[a] = 0.0
                    for j in range(n):
                        H[a, j] = 0.0
                velocity(x, ie, look, z, H, r)
            take(x, P, ie, c, dx, H, r, R, 2, 1, DOWN_VELOCITY, -1, out[1])
    elif kind == COURSE:
        look_back(x, ring, x[PAR + TV] + c[V_AHEAD], look)
        course(x, ie, look, z, H, r)
        R[0] = z[3] * z[3]
        take(x, P, ie, c, dx, H, r, R, 0, 1, COURSE, -1, out[0])
    elif kind == SPEED:
        look_back(x, ring, x[PAR + TS], look)
        speed(x, ie, c, look, z, H, r)
        R[0] = z[3] * z[3]
        take(x, P, ie, c, dx, H, r, R, 0, 1, SPEED, -1, out[0])
    elif kind == BOTTOM_TRACK:
        look_back(x, ring, x[PAR + TD], look)
        bottom_track(x, ie, look, z, H, r)
        R[0], R[1], R[2] = z[3] * z[3], z[4] * z[4], z[5] * z[5]
        take(x, P, ie, c, dx, H, r, R, 0, 3, BOTTOM_TRACK, -1, out[0])
    elif kind == DEPTH:
        depth(x, ie, z, H, r)
        R[0] = z[3] * z[3]
        take(x, P, ie, c, dx, H, r, R, 0, 1, DEPTH, -1, out[0])
    elif kind == HEIGHT:
        height(x, ie, z, H, r)
        R[0] = z[3] * z[3]
        take(x, P, ie, c, dx, H, r, R, 0, 1, HEIGHT, -1, out[0])
    elif kind == ATTITUDE:
        attitude(x, ie, z, H, r)
        R[0], R[1], R[2] = z[3] * z[3], z[4] * z[4], z[5] * z[5]
        take(x, P, ie, c, dx, H, r, R, 0, 3, ATTITUDE, -1, out[0])
    elif kind == MAGNETOMETER:
        magnetometer(x, ie, c, z, H, r)
        R[0] = z[3] * z[3]
        take(x, P, ie, c, dx, H, r, R, 0, 1, MAGNETOMETER, -1, out[0])
    elif kind == RANGE:
        distance(x, ie, z, H, r)
        R[0] = z[5] * z[5] + curvature(P, H[0, DR], H[0, DR + 1], H[0, DR + 2], max(z[0], 0.1))
        take(x, P, ie, c, dx, H, r, R, 0, 1, RANGE, -1, out[0])
    elif kind == SIGHTING:
        if sighting(x, P, c, z, H, r, R) == 2:
            take(x, P, ie, c, dx, H, r, R, 0, 2, SIGHTING, -1, out[0])
    elif kind == LIDAR:
        lidar_point(x, c, z, H, r, R)
        take(x, P, ie, c, dx, H, r, R, 0, 1, LIDAR, -1, out[0])
    elif kind == TERRAIN:
        if lidar_terrain(x, c, world[0], world[1], z, H, r, R) == 1:
            take(x, P, ie, c, dx, H, r, R, 0, 1, TERRAIN, -1, out[0])
    return g0, g0, g1


@njit(cache=True, error_model="numpy")
def vehicle_constraints(x, P, ie, c, dx, ring, still, H, r, R, inner_t, inner_k, inner, n):
    """What a vehicle's own nature tells, when due: it does not slip (NHC), it stands (zero velocity, zero rate)."""
    size = P.shape[0]
    standing = still and x[STILL_S] >= STILL_MIN
    look = np.empty(LOOK)
    one = np.empty(INNOVATION)
    todo = np.zeros(3, np.int64)
    if standing and c[STILL_DT] > 0.0 and x[T] - x[TSTILL] >= c[STILL_DT] - 1e-6:
        if c[ZUPT] > 0.0:
            todo[0] = 1
        if c[ZARU] > 0.0:
            todo[1] = 1
        x[TSTILL] = x[T]
    if c[NHC_DT] > 0.0 and x[T] - x[TNHC] >= c[NHC_DT] - 1e-6 and not standing:
        todo[2] = 1
        x[TNHC] = x[T]
    for k in range(3):
        if todo[k] == 0:
            continue
        for a in range(3):
            r[a] = 0.0
            for j in range(size):
                H[a, j] = 0.0
        if k == 0:
            standing_velocity(x, H, r)
            R[0] = R[1] = R[2] = c[ZUPT] * c[ZUPT]
            kind, m = STANDING_V, 3
        elif k == 1:
            standing_rate(x, ie, x[WMEAN], x[WMEAN + 1], x[WMEAN + 2], H, r)
            R[0] = R[1] = R[2] = c[ZARU] * c[ZARU]
            kind, m = STANDING_W, 3
        else:
            look_back(x, ring, 0.0, look)
            nonholonomic(x, ie, c, look, H, r)
            v2 = x[VEL] * x[VEL] + x[VEL + 1] * x[VEL + 1]
            slip = c[SLIP] * v2 * math.sqrt(x[W] * x[W] + x[W + 1] * x[W + 1] + x[W + 2] * x[W + 2])
            R[0] = c[NHC_Y] * c[NHC_Y] + slip * slip + c[SWAY_Y] * c[SWAY_Y] * v2
            R[1] = c[NHC_Z] * c[NHC_Z] + c[SWAY_Z] * c[SWAY_Z] * v2
            kind, m = NONHOLONOMIC, 2
        take(x, P, ie, c, dx, H, r, R, 0, m, kind, -1, one)
        i = n[INNER]
        if i < inner_t.shape[0]:
            inner_t[i] = x[T]
            inner_k[i] = kind
            inner[i] = one
            n[INNER] += 1


@njit(cache=True, error_model="numpy")
def constraints_due(x, c, still):
    """Whether `vehicle_constraints` would have something to say now."""
    if still and x[STILL_S] >= STILL_MIN:
        return c[STILL_DT] > 0.0 and x[T] - x[TSTILL] >= c[STILL_DT] - 1e-6
    return c[NHC_DT] > 0.0 and x[T] - x[TNHC] >= c[NHC_DT] - 1e-6


@njit(cache=True, error_model="numpy")
def open_node(x, P, dx, S, nodes, n):
    """Begins a node: what was predicted, and the transition since the last one."""
    i = n[NODES]
    nx, nP, ux, uP, nS, ndx, udx = nodes
    if i < nP.shape[0]:
        nx[i] = x[:KEPT]
        nx[i, KEPT - 1] = x[KEPT - 1]
        nP[i] = P
        size = P.shape[0]
        for a in range(9):
            for b in range(size):
                nS[i, a, b] = S[a, b]
        for a in range(9, size):
            nS[i, 9, a] = S[a, a]
        ndx[i] = dx


@njit(cache=True, error_model="numpy")
def close_node(x, P, dx, S, nodes, nt, ustd, n):
    """Ends a node: what is known now is where the next one starts from."""
    size = P.shape[0]
    for a in range(size):
        for b in range(size):
            S[a, b] = 0.0
        S[a, a] = 1.0
    x[TNODE] = x[T]
    i = n[NODES]
    nx, nP, ux, uP, nS, ndx, udx = nodes
    if i < nt.shape[0]:
        nt[i] = x[T]
        ux[i] = x[:KEPT]
        udx[i] = dx
        for a in range(size):
            ustd[i, a] = math.sqrt(max(P[a, a], 0.0))
    if i < uP.shape[0]:
        uP[i] = P
    n[NODES] += 1


@njit(cache=True, error_model="numpy")
def emit(x, P, ie, dx, ox, opos, ovel, oatt, i):
    """Row i of the solution: nominal state less the open-loop error, time; and the three covariances."""
    y = x.copy()
    correct(y, ie, dx)
    for j in range(NOMINAL):
        ox[i, j] = y[j]
    ox[i, NOMINAL] = x[T]
    covariances(y, P, opos[i], ovel[i], oatt[i])


@njit(cache=True, error_model="numpy")
def covariances(x, P, pos, vel, att):
    """Covariances (3, 3) of position NED m, velocity NED m/s, and roll, pitch, heading rad."""
    for a in range(3):
        for b in range(3):
            pos[a, b] = P[6 + a, 6 + b]
            vel[a, b] = P[3 + a, 3 + b]
    J = np.empty((3, 3))
    euler_slopes(x, J)
    for a in range(3):
        for b in range(3):
            v = 0.0
            for i in range(3):
                for j in range(3):
                    v += J[a, i] * P[i, j] * J[b, j]
            att[a, b] = v


@njit(cache=True, error_model="numpy")
def measure_all_at(x, P, ie, c, dx, ring, world, t, mt, mk, mz, innov, nodes, H, r, R, n):
    """Every measurement stamped t, in the order given. False where the next one is the caller's to make."""
    i = n[NODES]
    while n[MEAS] < mt.shape[0] and mt[n[MEAS]] <= t:
        k = n[MEAS]
        if mk[k] >= USER:
            return False
        g0, g1, g2 = measure(x, P, ie, c, dx, ring, world, mk[k], mz[k], H, r, R, innov[k])
        if g0 + g1 + g2 > 0.0 and i < nodes[1].shape[0] and mk[k] == POSITION:
            nodes[1][i, 6, 6] += g0
            nodes[1][i, 7, 7] += g1
            nodes[1][i, 8, 8] += g2
        n[MEAS] += 1
    return True


@njit(cache=True, error_model="numpy")
def run(
    x, P, S, dec, qd, beta, q, ie, c, dx, ring, world, work, rows, still, mt, mk, mz, out_dt, ox, opos, ovel, oatt,
    innov, inner_t, inner_k, inner, nodes, nt, ustd, n, inside,
):  # fmt: skip
    """Filters a recording from row n[ROW] and measurement n[MEAS] on; returns 0 at the end.

    Returns 1 where the measurement n[MEAS] is the caller's to make (kind >= USER): the node is open then, the caller
    updates, adds one to n[MEAS] and calls again with inside = True.
    rows (k, 7): time, rate, force; still (k,) bool; measurements sorted by time: mt, mk, mz (m, ZW). out_dt: rows of
    the solution at least so far apart (0: every row). Outputs: ox.. rows; innov (m, 2, INNOVATION); inner_t, inner_k,
    inner: constraints; nodes = (x-, P-, x+, P+, transition, dx-, dx+), nt, ustd per node as far as their lengths reach.
    """
    last = rows.shape[0]
    m = mt.shape[0]
    size = P.shape[0]
    H = np.zeros((3, size))
    r = np.zeros(3)
    R = np.zeros(3)
    keep = nodes[1].shape[0] > 0
    i = n[ROW]
    while i < last:
        t = rows[i, 0]
        if t <= x[TROW]:
            i += 1
            continue
        if not inside and x[T] <= x[TROW] + 1e-12:
            gap = begin_row(x, c, t, rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4], rows[i, 5], rows[i, 6])
            x[STILL_S] = x[STILL_S] + t - x[TROW] if still[i] and not gap else 0.0
        gap = x[DTRAW] < 0.0
        while True:
            if not inside:
                target = mt[n[MEAS]] if n[MEAS] < m and mt[n[MEAS]] < t else t
                if target > x[T]:
                    advance(x, P, S, dec, qd, beta, q, ie, c, dx, target, gap, work, keep)
                whole = x[T] >= t
                here = n[MEAS] < m and mt[n[MEAS]] <= x[T]
                due = whole and (constraints_due(x, c, still[i]) or x[T] - x[TNODE] >= c[NODE_DT] - 1e-6)
                if not (here or due):
                    if whole:
                        break
                    continue
                open_node(x, P, dx, S, nodes, n)
            inside = False
            if not measure_all_at(x, P, ie, c, dx, ring, world, x[T], mt, mk, mz, innov, nodes, H, r, R, n):
                n[ROW] = i
                return 1
            whole = x[T] >= t
            if whole and constraints_due(x, c, still[i]):
                vehicle_constraints(x, P, ie, c, dx, ring, still[i], H, r, R, inner_t, inner_k, inner, n)
            close_node(x, P, dx, S, nodes, nt, ustd, n)
            if whole:
                break
        end_row(x, t, ring)
        if x[T] >= x[NEXT] - 1e-9 and n[ROWS_OUT] < ox.shape[0]:
            emit(x, P, ie, dx, ox, opos, ovel, oatt, n[ROWS_OUT])
            n[ROWS_OUT] += 1
            if out_dt > 0.0:
                while x[NEXT] <= x[T] + 1e-9:
                    x[NEXT] += out_dt
        i += 1
    n[ROW] = i
    return 0
