"""The planar filter once more, as plain numpy with full matrices: to read, to compare with, to be faster than."""

from __future__ import annotations

from math import atan2, cos, exp, hypot, sin, sqrt
from typing import Any

import numpy as np

from schuler.kernels.planar import (
    ARM_X,
    ARM_Y,
    B0,
    BG,
    EAST,
    EE,
    EN,
    FIX,
    KG,
    KR,
    KS,
    NORTH,
    PSI,
    Q_BG,
    Q_KS,
    Q_POS,
    Q_TURN,
    Q_V,
    Q_W,
    RANGE,
    REST,
    SIG_B,
    SLIP,
    SOFT,
    TAU_B,
    TAU_E,
    TAU_W,
    VELOCITY,
    V,
    W,
)


def moved(x: Any, c: Any, dt: float, us: float, uw: float) -> Any:
    """The state after a piece; its Jacobian is not here: differences tell it."""
    y = x.copy()
    fade = exp(-dt / c[TAU_W])
    speed = us * exp(-x[KS]) if us == us else x[V]
    rate = (uw - x[BG]) * exp(-x[KG]) if uw == uw else x[W] * (1.0 - fade) * c[TAU_W] / dt
    middle = x[PSI] + 0.5 * rate * dt
    chord = speed * dt * np.sinc(0.5 * rate * dt / np.pi)
    y[NORTH] += chord * cos(middle)
    y[EAST] += chord * sin(middle)
    y[PSI] += rate * dt
    y[V], y[W] = speed, rate if uw == uw else x[W] * fade
    for i in (EN, EE):
        y[i] *= exp(-dt / c[TAU_E])
    if c[TAU_B] < 1e12:
        y[B0:] *= exp(-dt / c[TAU_B])
    return y


def transition(x: Any, c: Any, dt: float, us: float, uw: float) -> Any:
    """By central differences."""
    n = len(x)
    F = np.zeros((n, n))
    for j in range(n):
        h = np.zeros(n)
        h[j] = 1e-5
        F[:, j] = (moved(x + h, c, dt, us, uw) - moved(x - h, c, dt, us, uw)) / 2e-5
    return F


def noise(x: Any, y: Any, P: Any, c: Any, piece: Any) -> Any:
    """What a piece from x to y adds; P before it says which states are estimated."""
    dt, us, qs, sv2, uw, qw, sw2 = piece
    n = len(x)
    Q = np.zeros((n, n))
    way = y[V] * dt
    rate = (uw - x[BG]) * exp(-x[KG]) if uw == uw else (y[PSI] - x[PSI]) / dt
    middle = x[PSI] + 0.5 * rate * dt
    ahead, aside = np.array([cos(middle), sin(middle)]), np.array([-sin(middle), cos(middle)])
    both = c[SLIP] ** 2 * abs(way) + c[Q_POS] ** 2 * dt
    along = both
    if us == us:
        along += qs * dt
        Q[V, V] += sv2
    else:
        q = c[Q_V] ** 2
        along += q * dt**3 / 3.0
        Q[V, V] += q * dt
        Q[:2, V] += 0.5 * q * dt**2 * ahead
        Q[V, :2] = Q[:2, V]
    Q[:2, :2] += along * np.outer(ahead, ahead) + both * np.outer(aside, aside)
    # errors of heading ... and of the turn rate, where nothing tells it, integrated into heading and place
    order = [NORTH, EAST, PSI, W]
    q = c[Q_TURN] ** 2 * abs(rate) + (qw if uw == uw else 0.0)
    g = np.array([*aside, 1.0, 0.0])
    for (a, pa), (b, pb) in ((u, v) for u in _powers(y[V], 0) for v in _powers(y[V], 0)):
        block = q * dt ** (pa + pb + 1) / (pa + pb + 1) * np.outer(g * a, g * b)
        Q[np.ix_(order, order)] += block
    if uw == uw:
        Q[W, W] += sw2
    else:
        q = c[Q_W] ** 2
        for (a, pa), (b, pb) in ((u, v) for u in _powers(y[V], 1) for v in _powers(y[V], 1)):
            g = np.array([*aside, 1.0, 1.0])
            Q[np.ix_(order, order)] += q * dt ** (pa + pb + 1) / (pa + pb + 1) * np.outer(g * a, g * b)
    for i, q in ((BG, c[Q_BG]), (KS, c[Q_KS])):
        if P[i, i] > 0.0:
            Q[i, i] += q**2 * dt
    for i in (EN, EE):
        if P[i, i] > 0.0:
            Q[i, i] += 1.0 - exp(-2.0 * dt / c[TAU_E])
    if c[TAU_B] < 1e12:
        for i in range(B0, n):
            Q[i, i] += c[SIG_B] ** 2 * (1.0 - exp(-2.0 * dt / c[TAU_B]))
    return Q


def _powers(speed: float, order: int) -> list[tuple[Any, int]]:
    """What a kick a time t before the end has become there: (weights of place aside, heading, turn rate) t^power."""
    aside, heading, rate = np.array([1, 1, 0, 0.0]), np.array([0, 0, 1.0, 0]), np.array([0, 0, 0, 1.0])
    if order == 0:  # a kick of the heading
        return [(heading, 0), (speed * aside, 1)]
    return [(rate, 0), (heading, 1), (0.5 * speed * aside, 2)]


def expected(x: Any, c: Any, kind: int, z: Any) -> Any:
    """What a measurement would be."""
    co, si = cos(x[PSI]), sin(x[PSI])
    if kind == FIX:
        return np.array(
            [
                x[NORTH] + c[ARM_X] * co - c[ARM_Y] * si + z[4] * x[EN],
                x[EAST] + c[ARM_X] * si + c[ARM_Y] * co + z[5] * x[EE],
            ]
        )
    if kind == VELOCITY:
        return x[V] * np.array([co, si])
    if kind == RANGE:
        flat = hypot(x[NORTH] - z[3], x[EAST] - z[4])
        return np.array([exp(x[KR]) * hypot(flat, z[5]) + x[B0 + int(z[2])]])
    assert kind == REST
    return np.array([x[BG]])


def rows(x: Any, c: Any, kind: int, z: Any) -> Any:
    """Jacobian of `expected` by central differences."""
    n = len(x)
    columns = []
    for j in range(n):
        h = np.zeros(n)
        h[j] = 1e-5
        columns.append((expected(x + h, c, kind, z) - expected(x - h, c, kind, z)) / 2e-5)
    return np.array(columns).T


def variance(x: Any, P: Any, kind: int, z: Any) -> Any:
    """R of a measurement."""
    if kind in (FIX, VELOCITY):
        return np.diag([z[2] ** 2, z[3] ** 2])
    if kind == REST:
        return np.array([[z[1]]])
    north, east = x[NORTH] - z[3], x[EAST] - z[4]
    bearing = atan2(east, north)
    aside = np.array([-sin(bearing), cos(bearing)])
    side = aside @ P[:2, :2] @ aside
    return np.array([[z[1] + 0.75 * (side / hypot(north, east)) ** 2]])


def run(x: Any, P: Any, c: Any, pt: Any, pieces: Any, m_to: Any, kinds: Any, mz: Any) -> tuple[Any, Any, Any]:
    """The kernel's run without its gates, smoother and rows: state and covariance at the end, NIS of each measurement.

    Measurements outside the soft limit are weighed as in the kernel.
    """
    k = 0
    nis = np.zeros(len(kinds))
    n = len(x)
    for j in range(len(pt)):
        if pieces[j, 0] > 0.0:
            F = transition(x, c, pieces[j, 0], pieces[j, 1], pieces[j, 4])
            y = moved(x, c, pieces[j, 0], pieces[j, 1], pieces[j, 4])
            P = F @ P @ F.T + noise(x, y, P, c, pieces[j])
            x = y
        while k < m_to[j]:
            z = mz[k]
            H, R = rows(x, c, kinds[k], z), variance(x, P, kinds[k], z)
            innovation = z[: len(H)] - expected(x, c, kinds[k], z)
            S = H @ P @ H.T + R
            nis[k] = innovation @ np.linalg.solve(S, innovation)
            per = nis[k] / len(H)
            K = P @ H.T @ np.linalg.inv(S)
            if per > c[SOFT]:
                raise ValueError(f"measurement {k}: outside the soft limit, {sqrt(per):.1f} sigma")
            x = x + K @ innovation
            P = (np.eye(n) - K @ H) @ P @ (np.eye(n) - K @ H).T + K @ R @ K.T
            k += 1
    return x, P, nis
