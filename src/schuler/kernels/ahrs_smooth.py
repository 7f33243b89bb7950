"""Fixed-interval (RTS) smoother of the attitude filter: total states, closed-loop bookkeeping.

x_s = x+ [+] G (x_s(next) [-] x-(next)), G = P+ Phi' P-^-1. Differences are errors (estimate - truth), the attitude's a
rotation vector in n. Source: Rauch, Tung, Striebel (1965), AIAA Journal 3(8); closed loop as in Groves (2013), 3.4.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .ahrs_state import E_BG, N, correct
from .rotation import quat_from_rotvec, quat_product, rotvec_from_quat

TINY = 1e-10


@njit(cache=True, error_model="numpy")
def difference(a, b, d):
    """d (N) = a [-] b: the error of a if b were the truth; undoes `correct`."""
    e0, e1, e2, e3 = quat_product(b[0], b[1], b[2], b[3], a[0], -a[1], -a[2], -a[3])
    d[0], d[1], d[2] = rotvec_from_quat(e0, e1, e2, e3)
    for i in range(E_BG, N):
        d[i] = a[i + 1] - b[i + 1]


@njit(cache=True, error_model="numpy")
def factor(P, L, scale):
    """Cholesky factor L of P scaled to unit diagonal; a state without variance of its own is passed over."""
    for a in range(N):
        scale[a] = 1.0 / math.sqrt(P[a, a]) if P[a, a] > 0.0 else 0.0
    for a in range(N):
        for b in range(a + 1):
            v = P[a, b] * scale[a] * scale[b]
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                L[a, a] = math.sqrt(v) if v > TINY else math.inf
            else:
                L[a, b] = v / L[b, b]


@njit(cache=True, error_model="numpy")
def smooth(nn, nx, nP, ux, uP, nX):
    """Backwards over nn nodes; ux and uP become the smoothed states and covariances, in place.

    Returns dpre and dpost (nn, N): smoothed minus predicted and minus updated, as errors of those.
    """
    dpre = np.zeros((nn, N))
    dpost = np.zeros((nn, N))
    G, L, D, W, X = np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N))
    scale, y = np.zeros(N), np.zeros(N)
    for i in range(nn - 1, -1, -1):
        if i < nn - 1:
            factor(nP[i + 1], L, scale)
            for a in range(N):  # X = P+ Phi'
                for b in range(N):
                    v = 0.0
                    for k in range(N):
                        v += uP[i, a, k] * nX[i + 1, b, k]
                    X[a, b] = v
            for r in range(N):  # G = X P-^-1, row by row
                for a in range(N):
                    v = X[r, a] * scale[a]
                    for k in range(a):
                        v -= L[a, k] * y[k]
                    y[a] = v / L[a, a]
                for a in range(N - 1, -1, -1):
                    v = y[a]
                    for k in range(a + 1, N):
                        v -= L[k, a] * y[k]
                    y[a] = v / L[a, a]
                for a in range(N):
                    G[r, a] = y[a] * scale[a]
            for a in range(N):
                v = 0.0
                for b in range(N):
                    v += G[a, b] * dpre[i + 1, b]
                dpost[i, a] = v
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
                uP[i, a, a] = max(uP[i, a, a], 0.0)
            correct(ux[i], dpost[i])
        difference(nx[i], ux[i], dpre[i])
    return dpre, dpost


@njit(cache=True, error_model="numpy")
def rows_between(time, q, nt, uP, dpre, dpost, sq, sP):
    """Smoothed attitude at the filter's rows: corrections and covariances linear between the nodes at nt (nn,)."""
    nn = nt.shape[0]
    i = 0
    for r in range(time.shape[0]):
        t = time[r]
        while i < nn - 2 and nt[i + 1] <= t:
            i += 1
        w = min(1.0, max(0.0, (t - nt[i]) / (nt[i + 1] - nt[i])))
        d0 = (1.0 - w) * dpost[i, 0] + w * dpre[i + 1, 0]
        d1 = (1.0 - w) * dpost[i, 1] + w * dpre[i + 1, 1]
        d2 = (1.0 - w) * dpost[i, 2] + w * dpre[i + 1, 2]
        if t < nt[0]:
            d0, d1, d2 = dpre[0, 0], dpre[0, 1], dpre[0, 2]
        elif t >= nt[nn - 1]:
            d0, d1, d2 = dpost[nn - 1, 0], dpost[nn - 1, 1], dpost[nn - 1, 2]
        a0, a1, a2, a3 = quat_from_rotvec(d0, d1, d2)
        sq[r, 0], sq[r, 1], sq[r, 2], sq[r, 3] = quat_product(a0, a1, a2, a3, q[r, 0], q[r, 1], q[r, 2], q[r, 3])
        for a in range(3):
            for b in range(3):
                sP[r, a, b] = (1.0 - w) * uP[i, a, b] + w * uP[i + 1, a, b]
