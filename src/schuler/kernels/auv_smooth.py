"""Fixed-interval (RTS) smoother of the AUV filter: total states, closed-loop bookkeeping.

x_s = x+ [+] G (x_s(next) [-] x-(next)), G = X' P-^-1, X = covariance of the next node's prediction with this node.
Differences are errors (estimate - truth): attitude as a rotation vector in n, position in metres.
Source: Rauch, Tung, Striebel (1965), AIAA Journal 3(8); closed loop as in Groves (2013), section 3.4.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .auv_run import OUT, OUT_DRIFT, OUT_T, OUT_TELLS, OUT_VHREF, covariances
from .auv_state import (
    CLAT,
    DRIFT,
    E_BG,
    E_CE,
    E_CN,
    E_D,
    E_E,
    E_N,
    E_U,
    HGT,
    LAT,
    LON,
    NOMINAL,
    NX,
    QUAT,
    RE,
    RN,
    SIG_C,
    TELLS,
    VHREF,
    VREF,
    N,
    correct,
    refresh_earth,
    turn_error,
)
from .rotation import quat_product, rotvec_from_quat, wrap_pi

TINY = 1e-10


@njit(cache=True, error_model="numpy")
def difference(c, a, b, d):
    """d (N) = a [-] b: the error of a if b were the truth; undoes `correct`."""
    e0, e1, e2, e3 = quat_product(
        b[QUAT], b[QUAT + 1], b[QUAT + 2], b[QUAT + 3], a[QUAT], -a[QUAT + 1], -a[QUAT + 2], -a[QUAT + 3]
    )
    d[0], d[1], d[2] = rotvec_from_quat(e0, e1, e2, e3)
    for i in range(E_BG, E_N):
        d[i] = a[i + 1] - b[i + 1]
    d[E_N] = (a[LAT] - b[LAT]) * a[RN]
    d[E_E] = wrap_pi(a[LON] - b[LON]) * a[RE] * a[CLAT]
    d[E_D] = b[HGT] - a[HGT]
    for i in range(E_U, N):
        d[i] = a[i + 1] - b[i + 1]
    if c[SIG_C] <= 0.0:
        return
    f0, f1, f2 = turn_error(c, d)
    vn, ve = a[VREF], a[VREF + 1]
    co, si = math.cos(f2), math.sin(f2)
    d[E_CN] += vn - ve * f2 - (co * vn - si * ve)
    d[E_CE] += ve + vn * f2 - (co * ve + si * vn)


@njit(cache=True, error_model="numpy")
def _gain(X, P, G, work, scale, active):
    """G = X' P^-1 on the states with variance, P scaled to unit diagonal and factored by Cholesky.

    A state that others determine (pivot below TINY) adds nothing to them and is passed over.
    """
    n = 0
    for i in range(N):
        if P[i, i] > 0.0:
            active[n] = i
            scale[n] = 1.0 / math.sqrt(P[i, i])
            n += 1
    for a in range(n):
        for b in range(a + 1):
            v = P[active[a], active[b]] * scale[a] * scale[b]
            for k in range(b):
                v -= work[a, k] * work[b, k]
            if a == b:
                work[a, a] = math.sqrt(v) if v > TINY else math.inf
            else:
                work[a, b] = v / work[b, b]
    G[:, :] = 0.0
    y = np.empty(n)
    for i in range(N):
        for a in range(n):
            v = X[active[a], i] * scale[a]
            for k in range(a):
                v -= work[a, k] * y[k]
            y[a] = v / work[a, a]
        for a in range(n - 1, -1, -1):
            v = y[a]
            for k in range(a + 1, n):
                v -= work[k, a] * y[k]
            y[a] = v / work[a, a]
        for a in range(n):
            G[i, active[a]] = y[a] * scale[a]


@njit(cache=True, error_model="numpy")
def smooth(nn, c, nx, nP, ux, uP, nX):
    """Backwards over nn nodes; ux and uP become the smoothed states and covariances, in place.

    Returns dpre (nn, N) and dpost (nn, N): smoothed minus predicted and minus updated, as errors of those.
    """
    dpre = np.zeros((nn, N))
    dpost = np.zeros((nn, N))
    G = np.zeros((N, N))
    work = np.zeros((N, N))
    scale = np.zeros(N)
    active = np.zeros(N, np.int64)
    D = np.zeros((N, N))
    W = np.zeros((N, N))
    for i in range(nn - 1, -1, -1):
        if i < nn - 1:
            _gain(nX[i + 1], nP[i + 1], G, work, scale, active)
            for a in range(N):
                v = 0.0
                for b in range(N):
                    v += G[a, b] * dpre[i + 1, b]
                dpost[i, a] = v
            for a in range(N):
                for b in range(N):
                    D[a, b] = uP[i + 1, a, b] - nP[i + 1, a, b]
            for a in range(N):
                for b in range(N):
                    v = 0.0
                    for k in range(N):
                        v += G[a, k] * D[k, b]
                    W[a, b] = v
            for a in range(N):
                for b in range(a + 1):
                    v = 0.0
                    for k in range(N):
                        v += W[a, k] * G[b, k]
                    v += 0.5 * (uP[i, a, b] + uP[i, b, a])
                    uP[i, a, b] = v
                    uP[i, b, a] = v
                if uP[i, a, a] < 0.0:
                    uP[i, a, a] = 0.0
            correct(ux[i], c, dpost[i])
        difference(c, nx[i], ux[i], dpre[i])
    return dpre, dpost


@njit(cache=True, error_model="numpy")
def emit_smoothed(no, nn, c, ox, nt, ux, uP, dpre, dpost, sx, spos, svel, satt):
    """Rows of the smoothed solution at the filter's rows: corrections and covariances linear between nodes."""
    d = np.zeros(N)
    P = np.zeros((N, N))
    y = np.zeros(NX)
    i = 0
    for r in range(no):
        t = ox[r, OUT_T]
        while i < nn - 2 and nt[i + 1] <= t:
            i += 1
        for j in range(OUT):
            sx[r, j] = ox[r, j]
        for j in range(NOMINAL):
            y[j] = ox[r, j]
        y[DRIFT] = ox[r, OUT_DRIFT]
        y[VHREF] = ox[r, OUT_VHREF]
        y[TELLS] = ox[r, OUT_TELLS]
        refresh_earth(y)
        if nn < 2 or t <= nt[0]:
            j0, j1, w = 0, 0, 0.0
            for a in range(N):
                d[a] = dpre[0, a] if t < nt[0] else dpost[0, a]
        elif t >= nt[nn - 1]:
            j0, j1, w = nn - 1, nn - 1, 0.0
            for a in range(N):
                d[a] = dpost[nn - 1, a]
        else:
            j0, j1 = i, i + 1
            w = (t - nt[i]) / (nt[i + 1] - nt[i])
            for a in range(N):
                d[a] = (1.0 - w) * dpost[i, a] + w * dpre[i + 1, a]
        for a in range(N):
            for b in range(N):
                P[a, b] = (1.0 - w) * uP[j0, a, b] + w * uP[j1, a, b]
        correct(y, c, d)
        for j in range(NOMINAL):
            sx[r, j] = y[j]
        covariances(y, P, c, spos[r], svel[r], satt[r])
