"""Navigation in the plane: state, motion and measurements of kind "planar", and its run over a recording.

State x (n): north, east (m), heading (rad, clockwise from north, never wrapped), speed (m/s), turn rate (rad/s), its
bias (rad/s), logarithms of turn scale, odometer scale and range scale, slow error of fixes north and east (in units of
its own sigma), then a bias a beacon (m). Errors are additive: estimate - truth. P (n, n) is their covariance.

A piece is a stretch of constant inputs: u speed and turn rate as measured, NaN where they are not known; then the
states of speed and turn rate carry on. measured speed = exp(ks) v, measured rate = exp(kg) w + bg.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

NORTH, EAST, PSI, V, W, BG, KG, KS, KR, EN, EE, B0 = range(12)
MOVING = 5  # states that a piece changes: north, east, heading, speed, turn rate
ACTING = 8  # states that they depend on: these and the bias and scales of turn and speed
# configuration
(
    Q_BG,
    Q_TURN,
    SLIP,
    Q_POS,
    Q_V,
    Q_W,
    TAU_W,
    TAU_E,
    ARM_X,
    ARM_Y,
    SOFT,
    HARD,
    PATIENCE,
    Q_KS,
    TAU_B,
    SIG_B,
    NC,
) = range(17)
# what the gates remember
FIX_T, FIX_BAD, RANGE_T, RANGE_BAD, RANGE_SHARE, NS = range(6)
FIX, RANGE, REST, VELOCITY = range(4)
MZ = 7  # of a measurement: fix: north, east, white sigmas, slow sigmas; range: metres, variance, beacon, its place, dz
INNOVATION = 6  # value (2), sigma (2), nis, share of its weight that was used (0: left out)
LEAK, MOST_REFUSED = 0.05, 0.6  # a gate that refused most of the last twenty is as good as shut
RESET_HEADING = 0.2  # rad, put on the heading where a gate that stayed shut is opened


@njit(cache=True, error_model="numpy")
def advance(x, P, Phi, T, c, dt, us, qs, sv2, uw, qw, sw2):
    """State and covariance over one piece of dt s; Phi (n, n) gathers the transition (no rows: not kept).

    us m/s, qs m^2/s variance of the path it gives, sv2 variance of the speed at the end; uw rad/s, qw rad^2/s, sw2
    likewise for the turn. T (MOVING, n) is work space.
    """
    n = x.shape[0]
    knows_speed, knows_turn = us == us, uw == uw
    A = np.zeros((MOVING, ACTING))
    v1, w1, w2 = x[V], x[W], x[W]
    v_v, v_k = 1.0, 0.0
    w_w, w_b, w_g, end_w = 1.0, 0.0, 0.0, 1.0
    if knows_speed:
        v1 = us * math.exp(-x[KS])
        v_v, v_k = 0.0, -v1
    if knows_turn:
        g = math.exp(-x[KG])
        w1 = (uw - x[BG]) * g
        w2 = w1
        w_w, w_b, w_g, end_w = 0.0, -g, -w1, 0.0
    elif dt > 0.0:
        end_w = math.exp(-dt / c[TAU_W])
        w_w = (1.0 - end_w) * c[TAU_W] / dt
        w1, w2 = x[W] * w_w, x[W] * end_w
    h = 0.5 * w1 * dt
    co, si = math.cos(x[PSI] + h), math.sin(x[PSI] + h)
    if abs(h) < 1e-3:
        chord, dchord = 1.0 - h * h / 6.0, -h / 3.0
    else:
        chord = math.sin(h) / h
        dchord = (math.cos(h) - chord) / h
    s = v1 * dt
    n_v, e_v = dt * chord * co, dt * chord * si
    n_w = 0.5 * dt * s * (dchord * co - chord * si)
    e_w = 0.5 * dt * s * (dchord * si + chord * co)
    A[NORTH, NORTH] = 1.0
    A[NORTH, PSI] = -s * chord * si
    A[NORTH, V], A[NORTH, KS] = n_v * v_v, n_v * v_k
    A[NORTH, W], A[NORTH, BG], A[NORTH, KG] = n_w * w_w, n_w * w_b, n_w * w_g
    A[EAST, EAST] = 1.0
    A[EAST, PSI] = s * chord * co
    A[EAST, V], A[EAST, KS] = e_v * v_v, e_v * v_k
    A[EAST, W], A[EAST, BG], A[EAST, KG] = e_w * w_w, e_w * w_b, e_w * w_g
    A[PSI, PSI] = 1.0
    A[PSI, W], A[PSI, BG], A[PSI, KG] = dt * w_w, dt * w_b, dt * w_g
    A[V, V], A[V, KS] = v_v, v_k
    A[W, W], A[W, BG], A[W, KG] = end_w, w_b, w_g
    x[NORTH] += s * chord * co
    x[EAST] += s * chord * si
    x[PSI] += w1 * dt
    x[V], x[W] = v1, w2

    for r in range(MOVING):
        T[r, :] = 0.0
        for k in range(ACTING):
            a = A[r, k]
            if a != 0.0:
                for j in range(n):
                    T[r, j] += a * P[k, j]
    for r in range(MOVING):
        for j in range(MOVING, n):
            P[r, j] = T[r, j]
            P[j, r] = T[r, j]
        for q in range(r + 1):
            v = 0.0
            for k in range(ACTING):
                v += T[r, k] * A[q, k]
            P[r, q] = v
            P[q, r] = v
    if Phi.shape[0] > 0:
        for r in range(MOVING):
            T[r, :] = 0.0
            for k in range(ACTING):
                a = A[r, k]
                if a != 0.0:
                    for j in range(n):
                        T[r, j] += a * Phi[k, j]
        for r in range(MOVING):
            for j in range(n):
                Phi[r, j] = T[r, j]

    # the path's noise along and across, heading's, and what carries on without inputs
    slip = c[SLIP] * c[SLIP] * abs(s)
    along, across = slip, slip + c[Q_POS] * c[Q_POS] * dt
    along += c[Q_POS] * c[Q_POS] * dt
    if knows_speed:
        along += qs * dt
        P[V, V] += sv2
    else:
        q = c[Q_V] * c[Q_V]
        along += q * dt * dt * dt / 3.0
        P[V, V] += q * dt
        P[NORTH, V] += 0.5 * q * dt * dt * co
        P[EAST, V] += 0.5 * q * dt * dt * si
        P[V, NORTH], P[V, EAST] = P[NORTH, V], P[EAST, V]
    P[NORTH, NORTH] += along * co * co + across * si * si
    P[EAST, EAST] += along * si * si + across * co * co
    P[NORTH, EAST] += (along - across) * co * si
    P[EAST, NORTH] = P[NORTH, EAST]
    # heading's noise bends the path within the piece as well: aside by the integral of speed times heading
    q = c[Q_TURN] * c[Q_TURN] * abs(w1)
    if knows_turn:
        q += qw
        P[W, W] += sw2
    bent = q * dt
    side = v1 * q * dt * dt / 2.0
    aside = v1 * v1 * q * dt * dt * dt / 3.0
    if not knows_turn:
        q = c[Q_W] * c[Q_W]
        P[W, W] += q * dt
        P[PSI, W] += 0.5 * q * dt * dt
        P[W, PSI] = P[PSI, W]
        bent += q * dt**3 / 3.0
        side += v1 * q * dt**4 / 8.0
        aside += v1 * v1 * q * dt**5 / 20.0
        P[NORTH, W] -= v1 * q * dt**3 / 6.0 * si
        P[EAST, W] += v1 * q * dt**3 / 6.0 * co
        P[W, NORTH], P[W, EAST] = P[NORTH, W], P[EAST, W]
    P[PSI, PSI] += bent
    P[NORTH, PSI] -= side * si
    P[EAST, PSI] += side * co
    P[PSI, NORTH], P[PSI, EAST] = P[NORTH, PSI], P[EAST, PSI]
    P[NORTH, NORTH] += aside * si * si
    P[EAST, EAST] += aside * co * co
    P[NORTH, EAST] -= aside * co * si
    P[EAST, NORTH] = P[NORTH, EAST]
    if P[BG, BG] > 0.0:
        P[BG, BG] += c[Q_BG] * c[Q_BG] * dt
    if P[KS, KS] > 0.0:
        P[KS, KS] += c[Q_KS] * c[Q_KS] * dt
    if P[EN, EN] > 0.0:
        _fade(P, Phi, x, EN, EE + 1, math.exp(-dt / c[TAU_E]), 1.0)
    if n > B0 and c[SIG_B] > 0.0 and c[TAU_B] < 1e12:
        _fade(P, Phi, x, B0, n, math.exp(-dt / c[TAU_B]), c[SIG_B] * c[SIG_B])


@njit(cache=True, error_model="numpy")
def _fade(P, Phi, x, first, end, a, variance):
    """Gauss-Markov states first .. end - 1: fade by a and are fed so that each keeps its variance."""
    n = x.shape[0]
    for i in range(first, end):
        x[i] *= a
        for j in range(n):
            P[i, j] *= a
        for j in range(n):
            P[j, i] *= a
        P[i, i] += (1.0 - a * a) * variance
        if Phi.shape[0] > 0:
            for j in range(n):
                Phi[i, j] *= a


@njit(cache=True, error_model="numpy")
def update(x, P, H, y, S, K, weight):
    """One scalar innovation y with variance S; K (n) is work space. weight below 1: as if S were S / weight."""
    n = x.shape[0]
    for i in range(n):
        v = 0.0
        for j in range(n):
            if H[j] != 0.0:
                v += P[i, j] * H[j]
        K[i] = v
    g = weight / S
    for i in range(n):
        x[i] += g * K[i] * y
        for j in range(i + 1):
            # Joseph's (I - GH) P (I - GH)' + G R G' with G = g K: its terms are multiples of K K' and sum to this
            v = P[i, j] - g * K[i] * K[j]
            P[i, j] = v
            P[j, i] = v


@njit(cache=True, error_model="numpy")
def share(c, nis, d):
    """How much of a measurement is used: 1 inside the soft limit, less outside, 0 outside the hard one."""
    r = nis / d
    if r <= c[SOFT]:
        return 1.0
    if r <= c[HARD]:
        return c[SOFT] / r
    return 0.0


@njit(cache=True, error_model="numpy")
def open_gate(x, P, s, t, y2, n_bad, grown):
    """Opens a gate that stayed shut: position and heading become as uncertain as the contradiction is large."""
    grown[0] = 0.5 * y2
    grown[1] = RESET_HEADING * RESET_HEADING
    P[NORTH, NORTH] += grown[0]
    P[EAST, EAST] += grown[0]
    P[PSI, PSI] += grown[1]
    s[n_bad] = 0.0


@njit(cache=True, error_model="numpy")
def fix_rows(x, c, z, Hn, He):
    """Rows (n) of a fix, and its prediction north and east: antenna's place and the slow error."""
    co, si = math.cos(x[PSI]), math.sin(x[PSI])
    an, ae = c[ARM_X] * co - c[ARM_Y] * si, c[ARM_X] * si + c[ARM_Y] * co
    Hn[:] = 0.0
    He[:] = 0.0
    Hn[NORTH], Hn[PSI], Hn[EN] = 1.0, -ae, z[4]
    He[EAST], He[PSI], He[EE] = 1.0, an, z[5]
    return x[NORTH] + an + z[4] * x[EN], x[EAST] + ae + z[5] * x[EE]


@njit(cache=True, error_model="numpy")
def velocity_rows(x, Hn, He):
    """Rows (n) of a velocity over ground, and its prediction north and east."""
    co, si = math.cos(x[PSI]), math.sin(x[PSI])
    Hn[:] = 0.0
    He[:] = 0.0
    Hn[V], Hn[PSI] = co, -x[V] * si
    He[V], He[PSI] = si, x[V] * co
    return x[V] * co, x[V] * si


@njit(cache=True, error_model="numpy")
def product(P, Ha, Hb):
    """Ha P Hb'."""
    n = Ha.shape[0]
    v = 0.0
    for i in range(n):
        if Ha[i] != 0.0:
            for j in range(n):
                if Hb[j] != 0.0:
                    v += Ha[i] * P[i, j] * Hb[j]
    return v


@njit(cache=True, error_model="numpy")
def measure_pair(x, P, c, s, t, z, kind, out, grown, H, K):
    """A fix or a velocity over ground: two components judged together, used one after the other. H (2, n)."""
    Hn, He = H[0], H[1]
    if kind == FIX:
        pn, pe = fix_rows(x, c, z, Hn, He)
    else:
        pn, pe = velocity_rows(x, Hn, He)
    yn, ye = z[0] - pn, z[1] - pe
    rn, re = z[2] * z[2], z[3] * z[3]
    for attempt in range(2):
        a = product(P, Hn, Hn) + rn
        b = product(P, Hn, He)
        d = product(P, He, He) + re
        det = a * d - b * b
        nis = (d * yn * yn - 2.0 * b * yn * ye + a * ye * ye) / det
        w = share(c, nis, 2.0)
        if attempt == 0:
            out[0], out[1], out[2], out[3], out[4], out[5] = yn, ye, math.sqrt(a), math.sqrt(d), nis, w
        if kind != FIX or w > 0.0:
            break
        s[FIX_BAD] += 1.0
        if s[FIX_BAD] < 3.0 or t - s[FIX_T] < c[PATIENCE]:
            break
        open_gate(x, P, s, t, yn * yn + ye * ye, FIX_BAD, grown)
    if w <= 0.0:
        return
    if kind == FIX:
        s[FIX_T], s[FIX_BAD] = t, 0.0
    update(x, P, Hn, yn, a, K, w)
    # the second component as the first one left it, both linearised at the same state
    update(x, P, He, ye - w * b / a * yn, product(P, He, He) + re, K, w)


@njit(cache=True, error_model="numpy")
def range_row(x, z, H):
    """Row (n) of a range and its prediction, exp(kr) distance + bias. z[2] beacon, z[3:5] its place, z[5] height."""
    i = B0 + int(z[2])
    dn, de, dz = x[NORTH] - z[3], x[EAST] - z[4], z[5]
    d = max(math.sqrt(dn * dn + de * de + dz * dz), 1e-6)
    k = math.exp(x[KR])
    H[:] = 0.0
    H[NORTH], H[EAST], H[KR], H[i] = k * dn / d, k * de / d, k * d, 1.0
    return k * d + x[i]


@njit(cache=True, error_model="numpy")
def measure_range(x, P, c, s, t, z, out, grown, H, K):
    """A range to a known point."""
    h = H[0]
    y = z[0] - range_row(x, z, h)
    dn, de = x[NORTH] - z[3], x[EAST] - z[4]
    flat = max(dn * dn + de * de, 1e-6)
    w = 0.0
    S = 1.0
    for attempt in range(2):
        # what the bend of the circle makes of an uncertain position beside the line of sight
        side = (de * de * P[NORTH, NORTH] - 2.0 * dn * de * P[NORTH, EAST] + dn * dn * P[EAST, EAST]) / flat
        bend = side * side / flat
        S = product(P, h, h) + z[1] + 0.75 * bend
        nis = y * y / S
        w = share(c, nis, 1.0)
        if attempt == 0:
            out[0], out[2], out[4], out[5] = y, math.sqrt(S), nis, w
        if attempt == 0:
            s[RANGE_SHARE] += LEAK * ((0.0 if w > 0.0 else 1.0) - s[RANGE_SHARE])
        if w > 0.0:
            break
        s[RANGE_BAD] += 1.0
        shut = s[RANGE_BAD] >= 5.0 and t - s[RANGE_T] >= c[PATIENCE]
        if not shut and s[RANGE_SHARE] < MOST_REFUSED:
            break
        s[RANGE_SHARE] = 0.0
        open_gate(x, P, s, t, y * y, RANGE_BAD, grown)
    if w <= 0.0:
        return
    s[RANGE_T], s[RANGE_BAD] = t, 0.0
    update(x, P, h, y, S, K, w)


@njit(cache=True, error_model="numpy")
def measure_rest(x, P, c, z, out, H, K):
    """At rest the measured turn rate z[0] is the bias; z[1] its variance. What turns on the spot is not at rest."""
    h = H[0]
    h[:] = 0.0
    h[BG] = 1.0
    y = z[0] - x[BG]
    S = P[BG, BG] + z[1]
    nis = y * y / S
    out[0], out[2], out[4], out[5] = y, math.sqrt(S), nis, 0.0
    if nis <= c[SOFT]:
        out[5] = 1.0
        update(x, P, h, y, S, K, 1.0)


@njit(cache=True, error_model="numpy")
def measure(x, P, c, s, t, kind, z, out, grown, H, K):
    """One measurement at t, whatever it is. grown (2): variance put on position and heading where a gate was opened."""
    grown[0], grown[1] = 0.0, 0.0
    if kind == FIX or kind == VELOCITY:
        measure_pair(x, P, c, s, t, z, kind, out, grown, H, K)
    elif kind == RANGE:
        measure_range(x, P, c, s, t, z, out, grown, H, K)
    else:
        measure_rest(x, P, c, z, out, H, K)


@njit(cache=True, error_model="numpy")
def emit(x, P, ox, oP, k):
    """Row k of the solution: the moving states and their covariance."""
    for i in range(MOVING):
        ox[k, i] = x[i]
        for j in range(MOVING):
            oP[k, i, j] = P[i, j]


@njit(cache=True, error_model="numpy")
def run(
    x, P, c, s, pt, pieces, m_to, is_node, mkind, mz, innov, o_base, o_to, o_speed, o_turn, ox, oP, nodes, ux, ustd, n
):
    """Filters a recording; x (n), P (n, n), s (NS) are the start and become the end.

    pt (p,) ends of the pieces and pieces (p, 7) dt, us, qs, sv2, uw, qw, sw2; m_to (p,): measurements below this index
    are done at the end of the piece; is_node (p,) where the smoother has a node. mkind, mz (m, MZ), innov (m,
    INNOVATION). Rows of the solution: o_base (k,) the last piece of which every input is known at the row's time, o_to
    the piece that ends there, o_speed and o_turn the last pieces whose speed and turn rate are known then; ox (k,
    MOVING), oP (k, MOVING, MOVING). nodes = (x-, P-, x+, P+, Phi) as far as they reach (length 0: not kept), ux and
    ustd (nodes, n), states and sigmas there. n (3,) counts on: measurements, rows, nodes.
    """
    size = x.shape[0]
    T = np.zeros((MOVING, size))
    H = np.zeros((2, size))
    K = np.zeros(size)
    grown = np.zeros(2)
    none = np.zeros((0, 0))
    keep = nodes[1].shape[0] > 0
    Phi = np.eye(size) if keep else none
    scratch = np.zeros(INNOVATION)
    y, Q, r = x.copy(), P.copy(), s.copy()
    for j in range(pt.shape[0]):
        u = pieces[j]
        advance(x, P, Phi, T, c, u[0], u[1], u[2], u[3], u[4], u[5], u[6])
        i = n[2]
        if is_node[j] and keep:
            nodes[0][i] = x
            nodes[1][i] = P
            nodes[4][i] = Phi
        while n[0] < m_to[j]:
            k = n[0]
            measure(x, P, c, s, pt[j], mkind[k], mz[k], innov[k], grown, H, K)
            if grown[0] > 0.0 and keep:
                nodes[1][i, NORTH, NORTH] += grown[0]
                nodes[1][i, EAST, EAST] += grown[0]
                nodes[1][i, PSI, PSI] += grown[1]
            n[0] += 1
        if is_node[j]:
            if keep:
                nodes[2][i] = x
                nodes[3][i] = P
                for a in range(size):
                    for b in range(size):
                        Phi[a, b] = 1.0 if a == b else 0.0
            ux[i] = x
            for a in range(size):
                ustd[i, a] = math.sqrt(max(P[a, a], 0.0))
            n[2] += 1
        # rows that are due now: those that ask for no input beyond this piece, on a copy where they lie after it
        while n[1] < o_to.shape[0] and o_base[n[1]] <= j:
            k = n[1]
            if o_to[k] <= j:
                emit(x, P, ox, oP, k)
            else:
                y[:] = x
                Q[:, :] = P
                r[:] = s
                m = n[0]
                for q in range(j + 1, o_to[k] + 1):
                    p = pieces[q]
                    us = p[1] if q <= o_speed[k] else np.nan
                    uw = p[4] if q <= o_turn[k] else np.nan
                    advance(y, Q, none, T, c, p[0], us, p[2], p[3], uw, p[5], p[6])
                    while m < m_to[q]:
                        measure(y, Q, c, r, pt[q], mkind[m], mz[m], scratch, grown, H, K)
                        m += 1
                emit(y, Q, ox, oP, k)
            n[1] += 1
