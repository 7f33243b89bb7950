"""How the aided INS filter takes a measurement in: gates that cannot lock out, robust weights, scalar Joseph updates.

Large innovations are not all alike. A little too large (up to HARD_RATIO times the 99.9 % bound): taken with its
variance grown until it lies on the bound, so that its pull is bounded. Wildly large: refused, but only for a time; a
fix that contradicts the filter for longer is believed, with the filter's own position made uncertain first.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .aided_measure import POSITION, VELOCITY
from .aided_state import DISTRUST_S, DR, DV, EARLY_S, GATE, HARD, HELD, OPEN_LOOP, T0, TSEEN, T, correct

LIMIT1, LIMIT2, LIMIT3 = 10.83, 13.82, 16.27  # chi-square 99.9 % of 1, 2, 3 degrees of freedom
HARD_RATIO = 25.0  # five times the bound of an innovation
AGAIN_RATIO = 4.0  # a fix that was wild stays so until it is within twice the bound: doubt that grows is no evidence
WILD_MOST = 5.0  # wild rows in a row of a sensor that is no fix, after which it is taken with bounded pull again
ALONE_S = 5.0  # after so long without fixes the filter's sigma is doubted before a fix is
YOUNG_S = 60.0  # a filter younger than this knows less than it says
INNOVATION = 10  # value (3), sigma (3), nis, degrees of freedom, weight (0 refused, 1 full), how it was taken
TAKEN, WEAKENED, REFUSED, FORCED = 1.0, 2.0, 0.0, 3.0


@njit(cache=True, error_model="numpy")
def innovation_covariance(P, H, R, first, m, S):
    """S (m, m) = H P H' + diag(R) of rows first .. first + m."""
    n = P.shape[0]
    ph = np.zeros(n)
    for a in range(m):
        for i in range(n):
            ph[i] = 0.0
        for j in range(n):
            h = H[first + a, j]
            if h != 0.0:
                for i in range(n):
                    ph[i] += h * P[j, i]
        for b in range(a, m):
            v = 0.0
            for i in range(n):
                v += ph[i] * H[first + b, i]
            S[a, b] = v
            S[b, a] = v
        S[a, a] += R[first + a]


@njit(cache=True, error_model="numpy")
def nis_of(S, y, m):
    """y' S^-1 y for m of 1, 2 or 3."""
    if m == 1:
        return y[0] * y[0] / S[0, 0]
    if m == 2:
        det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
        return (S[1, 1] * y[0] * y[0] - 2.0 * S[0, 1] * y[0] * y[1] + S[0, 0] * y[1] * y[1]) / det
    a, b, c = S[0, 0], S[0, 1], S[0, 2]
    e, f, i = S[1, 1], S[1, 2], S[2, 2]
    k1, k2, k3 = e * i - f * f, c * f - b * i, b * f - c * e
    det = a * k1 + b * k2 + c * k3
    q = k1 * y[0] * y[0] + (a * i - c * c) * y[1] * y[1] + (a * e - b * b) * y[2] * y[2]
    q += 2.0 * (k2 * y[0] * y[1] + k3 * y[0] * y[2] + (b * c - a * f) * y[1] * y[2])
    return q / det


@njit(cache=True, error_model="numpy")
def scalar_update(P, d, h, r, R):
    """One scalar r = h error + noise: adds to the error estimate d and updates P (Joseph form of the optimal gain)."""
    n = P.shape[0]
    ph = np.zeros(n)
    for j in range(n):
        hj = h[j]
        if hj != 0.0:
            r -= hj * d[j]
            for i in range(n):
                ph[i] += P[j, i] * hj
    s = R
    for j in range(n):
        s += h[j] * ph[j]
    if s <= 0.0:
        return
    k = 1.0 / s
    for i in range(n):
        g = ph[i] * k
        d[i] += g * r
        for j in range(n):
            P[i, j] -= g * ph[j]


@njit(cache=True, error_model="numpy")
def settle(x, ie, c, dx, d):
    """Takes the estimated error out of the nominal state (closed loop), or keeps it beside it (open loop)."""
    n = d.shape[0]
    if c[HELD] > 0.5:
        d[5] = 0.0
        d[8] = 0.0
    if c[OPEN_LOOP] > 0.5:
        for i in range(n):
            dx[i] = d[i]
        return
    correct(x, ie, d)
    for i in range(n):
        dx[i] = 0.0


@njit(cache=True, error_model="numpy")
def record(out, S, y, m, nis, weight, how):
    """One row of innovations (INNOVATION); the innovation is measured - predicted."""
    for a in range(3):
        out[a] = -y[a] if a < m else np.nan
        out[3 + a] = math.sqrt(S[a, a]) if a < m else np.nan
    out[6] = nis
    out[7] = m
    out[8] = weight
    out[9] = how


@njit(cache=True, error_model="numpy")
def take(x, P, ie, c, dx, H, r, R, first, m, kind, since, out):
    """Rows first .. first + m of a measurement: gate, weigh, update. Returns the variance that was added to P before.

    since: the slot of x that holds since when this sensor is refused (a fix or a GNSS velocity), or -1 for a sensor
    that is only ever weakened. H, r, R (rows): of the whole measurement.
    """
    n = P.shape[0]
    S = np.empty((3, 3))
    y = np.empty(3)
    innovation_covariance(P, H, R, first, m, S)
    for a in range(m):
        v = r[first + a]
        for j in range(n):
            v -= H[first + a, j] * dx[j]
        y[a] = v
    nis = nis_of(S, y, m)
    limit = LIMIT1 if m == 1 else LIMIT2 if m == 2 else LIMIT3
    ratio = nis / limit
    grown = 0.0
    weight, how = 1.0, TAKEN
    # A receiver whose place is wild and whose velocity was wrong with it: many bounded pulls would be one long one,
    # and growing doubt would let it in. Its velocity waits until the place is believed again.
    lies = kind == VELOCITY and x[HARD + POSITION] > 0.5 and (ratio > 1.0 or x[HARD + VELOCITY] > 0.5)
    if (ratio > 1.0 or lies) and c[GATE] > 0.5:
        if since >= 0:
            if x[since] < 0.0:
                x[since] = x[T]
            allowed = c[EARLY_S] if x[T] - c[T0] < YOUNG_S else c[DISTRUST_S]
            alone = x[T] - x[TSEEN] > ALONE_S and ratio <= HARD_RATIO
            if x[T] - x[since] > allowed or alone:
                # It was contradicted long enough, or none had come for long: the filter is the one that is wrong.
                top = 0.0
                for a in range(m):
                    top = max(top, S[a, a])
                grown = max(ratio - 1.0, 0.0) * top * 1.1
                base = DV if kind == VELOCITY else DR
                lo = base if m >= 2 else base + 2
                for i in range(lo, base + (2 if m == 2 else 3)):
                    P[i, i] += grown
                innovation_covariance(P, H, R, first, m, S)
                x[since] = -1.0
                how = FORCED
            elif lies or ratio > (AGAIN_RATIO if x[HARD + kind] > 0.5 else HARD_RATIO):
                weight, how = 0.0, REFUSED
            else:
                weight, how = 1.0 / ratio, WEAKENED
            x[HARD + kind] = 1.0 if how == REFUSED else 0.0
        elif ratio > HARD_RATIO and x[HARD + kind] < WILD_MOST:
            x[HARD + kind] += 1.0
            weight, how = 0.0, REFUSED
        else:
            weight, how = 1.0 / ratio, WEAKENED
    else:
        if since >= 0:
            x[since] = -1.0
        x[HARD + kind] = 0.0
    record(out, S, y, m, nis, weight, how)
    if weight > 0.0:
        d = dx.copy()
        for a in range(m):
            more = (1.0 / weight - 1.0) * S[a, a]
            scalar_update(P, d, H[first + a], r[first + a], R[first + a] + more)
        settle(x, ie, c, dx, d)
    return grown
