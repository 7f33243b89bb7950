"""The thesis's optics of three beams, section 4.4, put right: what (4.28) says, what it can and cannot do.

Its frame: x forward, y up, z to the right; r0 = (x0, y0, z0) is the body's origin seen from the sensor at the origin,
and the marks P_i = r0 + B_i C(:, i) sit on the body's axes at distances B_i. Mark i is seen under azimuth alpha_i (from
x toward z) and elevation beta_i: P_i lies along (cos a cos b, sin b, sin a cos b). Angles psi, theta, gamma as in the
thesis's columns of the axes. As six equations it is the pose from three points of `kernels.p3p`, with up to four
solutions, and the base that it rests on is as short as the body.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def axes(psi: float, theta: float, gamma: float) -> Array:
    """C (3, 3): columns are the body's axes in (forward, up, right)."""
    sp, cp, st, ct, sg, cg = (
        math.sin(psi), math.cos(psi), math.sin(theta), math.cos(theta), math.sin(gamma), math.cos(gamma),
    )  # fmt: skip
    return np.array(
        [
            [cp * ct, sg * sp - cg * cp * st, cg * sp + sg * cp * st],
            [st, ct * cg, -ct * sg],
            [-sp * ct, sg * cp + cg * sp * st, cg * cp - sg * sp * st],
        ]
    )


def angles(C: ArrayLike) -> Array:
    """(psi, theta, gamma) of such a matrix, rad."""
    m = np.asarray(C, dtype=np.float64)
    return np.array(
        [math.atan2(-m[2, 0], m[0, 0]), math.asin(min(1.0, max(-1.0, m[1, 0]))), math.atan2(-m[1, 2], m[1, 1])]
    )


def marks(x: ArrayLike, B: ArrayLike = (1.0, 1.0, 1.0)) -> Array:
    """(3, 3) the marks P_i, rows, of x = (x0, y0, z0, psi, theta, gamma)."""
    s = np.asarray(x, dtype=np.float64)
    return s[:3] + (axes(*s[3:]) * np.asarray(B, dtype=np.float64)).T


def bearings(x: ArrayLike, B: ArrayLike = (1.0, 1.0, 1.0)) -> tuple[Array, Array]:
    """alpha (3,), beta (3,), rad."""
    P = marks(x, B)
    return np.arctan2(P[:, 2], P[:, 0]), np.arctan2(P[:, 1], np.hypot(P[:, 0], P[:, 2]))


def equations(x: ArrayLike, alpha: ArrayLike, beta: ArrayLike, B: ArrayLike = (1.0, 1.0, 1.0)) -> Array:
    """(6,) left less right of (4.28), corrected: row 1 has cos(psi) cos(theta), row 6 has z0."""
    P = marks(x, B)
    a, b = np.asarray(alpha, dtype=np.float64), np.asarray(beta, dtype=np.float64)
    first = P[:, 0] * np.sin(b) - P[:, 1] * np.cos(a) * np.cos(b)
    second = P[:, 2] * np.sin(b) - P[:, 1] * np.sin(a) * np.cos(b)
    return np.column_stack([first, second]).ravel()


def printed(x: ArrayLike, alpha: ArrayLike, beta: ArrayLike, B: ArrayLike = (1.0, 1.0, 1.0)) -> Array:
    """(6,) (4.28) as printed: cos(gamma) in row 1, x0 in row 6."""
    s, k = np.asarray(x, dtype=np.float64), np.asarray(B, dtype=np.float64)
    b = np.asarray(beta, dtype=np.float64)
    C = axes(*s[3:])
    rows = equations(x, alpha, beta, B)
    rows[0] += k[0] * math.cos(s[4]) * (math.cos(s[5]) - math.cos(s[3])) * math.sin(b[0])
    rows[5] += (s[0] - s[2]) * math.sin(b[2]) + 0.0 * C[0, 0]
    return rows


def summed(x: ArrayLike, alpha: ArrayLike, beta: ArrayLike, B: ArrayLike = (1.0, 1.0, 1.0)) -> Array:
    """(3,) what (4.29) means: the two equations of each mark added."""
    return equations(x, alpha, beta, B).reshape(3, 2).sum(axis=1)


def jacobian(f: object, x: ArrayLike, step: float = 1e-5) -> Array:
    """d f/d x by central differences."""
    s = np.asarray(x, dtype=np.float64)
    columns = [(f(s + step * e) - f(s - step * e)) / (2.0 * step) for e in np.eye(len(s))]  # type: ignore[operator]
    return np.column_stack(columns)


def solutions(alpha: ArrayLike, beta: ArrayLike, B: ArrayLike = (1.0, 1.0, 1.0)) -> list[Array]:
    """Every x (6,) with all marks in front of the sensor (range above 0) that is seen so: none to four."""
    from schuler.kernels.p3p import p3p

    a, b = np.asarray(alpha, dtype=np.float64), np.asarray(beta, dtype=np.float64)
    y = np.column_stack([np.cos(a) * np.cos(b), np.sin(b), np.sin(a) * np.cos(b)])
    ways = np.empty((4, 12))
    count = p3p(np.ascontiguousarray(y), np.diag(np.asarray(B, dtype=np.float64)), ways)
    found = []
    for way in ways[:count]:
        C = way[:9].reshape(3, 3)
        found.append(np.concatenate([-C @ way[9:12], angles(C)]))
    return found


def sigmas(x: ArrayLike, bearing: float, B: ArrayLike = (1.0, 1.0, 1.0)) -> Array:
    """(6,) sigma, m and rad, of the solution for a sigma `bearing` (rad) of each direction of sight, across it."""

    def sight(s: Array) -> Array:
        alpha, beta = bearings(s, B)
        return np.concatenate([alpha * np.cos(at_beta), beta])

    at_beta = bearings(x, B)[1]
    J = jacobian(sight, x)
    return bearing * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
