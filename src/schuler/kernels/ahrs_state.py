"""The attitude filter's state as flat arrays: layout, covariance, scalar updates.

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

from numba import njit

from .hard_iron import NS
from .rotation import quat_from_euler, rotate_state_quat

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
RAW, IRON = 58, 61  # field of the last row as measured (3); what is taken off it (3)
HARD = 64  # `hard_iron.look`'s own
NX = HARD + NS

# --- configuration (c) -------------------------------------------------------------------------------------------
NODE_S, ARW, Q_BG, VRW, Q_BA, SCALE = range(6)
TAU_U, SIG_U, TAU_UC, TAU_VAR = range(6, 10)
HAS_MAG, MAG_WHITE, MAG_STD, MAG_TAU, BEND, BEND_TAU, DECLINATION, FIELD_TAU, FIELD_NOISE, FIX_FIELD = range(10, 20)
REST_RATE, REST_FORCE, REST_S, REST_STD, REST_TURN = range(20, 25)
GAP_S, GAP_RATE, LEVEL_S, STD_TILT, STD_HEAD, ROLL0, PITCH0, HEAD0 = range(25, 33)
EARTH_N, EARTH_D, FIND_IRON = 33, 34, 35
NC = 36

# --- what a node tells (one row) ---------------------------------------------------------------------------------
# time; innovation of u (2), its sigma (2); of the heading, its sigma (NaN: no field), 1 where taken at full weight;
# sigma of the heading by disturbance; size and dip of the field; 1 at rest; size of the hard iron taken off
K_T, K_U, K_SU, K_Y, K_S, K_USED, K_BENT, K_NORM, K_DIP, K_REST, K_IRON = 0, 1, 3, 5, 6, 7, 8, 9, 10, 11, 12
NK = 13


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
