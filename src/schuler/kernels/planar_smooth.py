"""Fixed-interval (RTS) smoother of the planar filter: total states, additive errors.

x_s = x+ + G (x_s(next) - x-(next)), G = P+ Phi' P-(next)^-1. Source: Rauch, Tung, Striebel (1965), AIAA Journal 3(8).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TINY = 1e-11


@njit(cache=True, error_model="numpy")
def _gain(P, Phi, Pnext, G, X, L, scale, active):
    """G = P Phi' Pnext^-1 on the states with variance, Pnext scaled to unit diagonal and factored by Cholesky.

    A state that others determine (pivot below TINY) adds nothing to them and is passed over.
    """
    n = P.shape[0]
    count = 0
    for i in range(n):
        if Pnext[i, i] > 0.0:
            active[count] = i
            scale[count] = 1.0 / math.sqrt(Pnext[i, i])
            count += 1
    for a in range(count):
        for b in range(a + 1):
            v = Pnext[active[a], active[b]] * scale[a] * scale[b]
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                L[a, a] = math.sqrt(v) if v > TINY else math.inf
            else:
                L[a, b] = v / L[b, b]
    for i in range(n):
        for j in range(n):
            v = 0.0
            for k in range(n):
                if Phi[j, k] != 0.0:
                    v += P[i, k] * Phi[j, k]
            X[i, j] = v
    y = np.empty(count)
    for i in range(n):
        for j in range(n):
            G[i, j] = 0.0
        for a in range(count):
            v = X[i, active[a]] * scale[a]
            for k in range(a):
                v -= L[a, k] * y[k]
            y[a] = v / L[a, a]
        for a in range(count - 1, -1, -1):
            v = y[a]
            for k in range(a + 1, count):
                v -= L[k, a] * y[k]
            y[a] = v / L[a, a]
        for a in range(count):
            G[i, active[a]] = y[a] * scale[a]


@njit(cache=True, error_model="numpy")
def smooth(nx, nP, ux, uP, nPhi):
    """Backwards over the nodes; ux (k, n) and uP (k, n, n) become the smoothed states and covariances, in place."""
    count, n = ux.shape
    G, X, L = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    scale, active = np.zeros(n), np.zeros(n, np.int64)
    D, M = np.zeros((n, n)), np.zeros((n, n))
    d = np.zeros(n)
    for i in range(count - 2, -1, -1):
        _gain(uP[i], nPhi[i + 1], nP[i + 1], G, X, L, scale, active)
        for a in range(n):
            d[a] = ux[i + 1, a] - nx[i + 1, a]
            for b in range(n):
                D[a, b] = uP[i + 1, a, b] - nP[i + 1, a, b]
        for a in range(n):
            v = 0.0
            for b in range(n):
                v += G[a, b] * d[b]
            ux[i, a] += v
            for b in range(n):
                w = 0.0
                for k in range(n):
                    w += G[a, k] * D[k, b]
                M[a, b] = w
        for a in range(n):
            for b in range(a + 1):
                v = 0.0
                for k in range(n):
                    v += M[a, k] * G[b, k]
                v += 0.5 * (uP[i, a, b] + uP[i, b, a])
                uP[i, a, b] = v
                uP[i, b, a] = v
            if uP[i, a, a] < 0.0:
                uP[i, a, a] = 0.0
