"""Fixed-interval (RTS) smoother of the aided INS: total states, closed-loop bookkeeping.

x_s = x+ [+] G (x_s(next) [-] x-(next)), G = P+ S' P-^-1 with the transition S between two nodes. Differences are errors
(estimate - truth): attitude as a rotation vector in n, position in metres. In open loop the error dx beside the nominal
state takes part. Source: Rauch, Tung, Striebel (1965), AIAA Journal 3(8); closed loop as in Groves (2013), section 3.4.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .aided_propagate import refresh_earth
from .aided_run import covariances
from .aided_state import NAV, NOMINAL, NX, correct, difference

TINY = 1e-10


@njit(cache=True, error_model="numpy")
def gain(X, P, G, L, Y, scale, active):
    """G = X' P^-1 on the states with variance, P scaled to unit diagonal and factored by Cholesky.

    A state that others determine (pivot below TINY) adds nothing to them and is passed over. L, Y (n, n) scratch.
    """
    size = P.shape[0]
    n = 0
    for i in range(size):
        if P[i, i] > 0.0:
            active[n] = i
            scale[n] = 1.0 / math.sqrt(P[i, i])
            n += 1
    for a in range(n):
        for b in range(a + 1):
            v = P[active[a], active[b]] * scale[a] * scale[b]
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                L[a, a] = math.sqrt(v) if v > TINY else math.inf
            else:
                L[a, b] = v / L[b, b]
    # L Y = X scaled, then L' Z = Y: all columns at once
    for a in range(n):
        s = scale[a]
        for i in range(size):
            Y[a, i] = X[active[a], i] * s
        for k in range(a):
            f = L[a, k]
            for i in range(size):
                Y[a, i] -= f * Y[k, i]
        s = 1.0 / L[a, a]
        for i in range(size):
            Y[a, i] *= s
    for a in range(n - 1, -1, -1):
        for k in range(a + 1, n):
            f = L[k, a]
            for i in range(size):
                Y[a, i] -= f * Y[k, i]
        s = 1.0 / L[a, a]
        for i in range(size):
            Y[a, i] *= s
    for i in range(size):
        for j in range(size):
            G[i, j] = 0.0
    for a in range(n):
        s = scale[a]
        for i in range(size):
            G[i, active[a]] = Y[a, i] * s


@njit(cache=True, error_model="numpy")
def smooth(first, nn, ie, nodes, dpre, dpost):
    """Backwards over nodes first .. nn: x+ and P+ become the smoothed states and covariances, in place.

    dpre, dpost (nn, n): smoothed minus predicted and minus updated, as errors of those.
    """
    nx, nP, ux, uP, nS, ndx, udx = nodes
    size = nP.shape[1]
    G, L, Y = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    X, D, M = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    scale = np.zeros(size)
    active = np.zeros(size, np.int64)
    d = np.zeros(size)
    for i in range(nn - 1, first - 1, -1):
        for a in range(size):
            dpost[i, a] = 0.0
        if i < nn - 1:
            # X = S P+: covariance of the next prediction with this node
            for a in range(NAV):
                for b in range(size):
                    X[a, b] = 0.0
                for k in range(size):
                    f = nS[i + 1, a, k]
                    if f != 0.0:
                        for b in range(size):
                            X[a, b] += f * uP[i, k, b]
            for a in range(NAV, size):
                f = nS[i + 1, NAV, a]
                for b in range(size):
                    X[a, b] = f * uP[i, a, b]
            gain(X, nP[i + 1], G, L, Y, scale, active)
            for a in range(size):
                v = 0.0
                for b in range(size):
                    v += G[a, b] * dpre[i + 1, b]
                dpost[i, a] = v
            for a in range(size):
                for b in range(size):
                    D[a, b] = uP[i + 1, a, b] - nP[i + 1, a, b]
            for a in range(size):
                for b in range(size):
                    M[a, b] = 0.0
                for k in range(size):
                    f = G[a, k]
                    for b in range(size):
                        M[a, b] += f * D[k, b]
            for a in range(size):
                for b in range(size):
                    Y[a, b] = 0.0
                for k in range(size):
                    f = M[a, k]
                    for b in range(size):
                        Y[a, b] += f * G[b, k]
            for a in range(size):
                for b in range(a + 1):
                    v = 0.5 * (Y[a, b] + Y[b, a] + uP[i, a, b] + uP[i, b, a])
                    uP[i, a, b] = v
                    uP[i, b, a] = v
                if uP[i, a, a] < 0.0:
                    uP[i, a, a] = 0.0
        for a in range(size):
            d[a] = dpost[i, a] + udx[i, a]
        correct(ux[i], ie, d)
        difference(nx[i], ux[i], ie, dpre[i])
        for a in range(size):
            dpre[i, a] -= ndx[i, a]


@njit(cache=True, error_model="numpy")
def emit_smoothed(no, first, nn, ie, ox, nt, nodes, dpre, dpost, sx, spos, svel, satt):
    """Rows of the smoothed solution at the filter's rows: corrections and covariances linear between nodes.

    ox: the filter's rows, closed loop (in open loop already less the error). Between two nodes the filter's row differs
    from the smoothed one by what the node before lacked after its update and the node after before its own.
    """
    uP = nodes[3]
    size = uP.shape[1]
    d = np.zeros(size)
    P = np.zeros((size, size))
    y = np.zeros(NX)
    i = first
    for k in range(no):
        t = ox[k, NOMINAL]
        while i < nn - 2 and nt[i + 1] <= t:
            i += 1
        for j in range(NOMINAL + 1):
            sx[k, j] = ox[k, j]
        for j in range(NOMINAL):
            y[j] = ox[k, j]
        refresh_earth(y)
        if nn - first < 2 or t <= nt[first]:
            j0, j1, w = first, first, 0.0
            for a in range(size):
                d[a] = dpre[first, a] if t < nt[first] - 1e-9 else dpost[first, a]
        elif t >= nt[nn - 1]:
            j0, j1, w = nn - 1, nn - 1, 0.0
            for a in range(size):
                d[a] = dpost[nn - 1, a]
        else:
            j0, j1 = i, i + 1
            w = (t - nt[i]) / (nt[i + 1] - nt[i])
            for a in range(size):
                d[a] = (1.0 - w) * dpost[i, a] + w * dpre[i + 1, a]
        for a in range(size):
            for b in range(size):
                P[a, b] = (1.0 - w) * uP[j0, a, b] + w * uP[j1, a, b]
        correct(y, ie, d)
        for j in range(NOMINAL):
            sx[k, j] = y[j]
        covariances(y, P, spos[k], svel[k], satt[k])
