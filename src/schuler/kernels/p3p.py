"""Three known points seen from one place: every pose that they leave, in closed form, compiled.

With distances l_i along unit directions y_i, |l_i y_i - l_j y_j|^2 = |X_i - X_j|^2 are three quadrics in
(l_1, l_2, l_3); two homogeneous combinations are conics in the projective plane of l, a degenerate member of their
pencil splits into two lines, and each line meets a conic in two points: up to four poses. Sources: Haralick, Lee,
Ottenberg and Nolle (1994), Int. J. Computer Vision 13, for the problem and its history; Richter-Gebert (2011),
Perspectives on Projective Geometry, section 11, for splitting a conic; Persson and Nordberg (2018), ECCV, for the idea
of doing so here.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def real_roots_cubic(c3, c2, c1, c0, out):
    """Real roots of c3 x^3 + c2 x^2 + c1 x + c0 (c3 not 0) into out (3,); their number, 1 or 3. Polished by Newton."""
    a, b, c = c2 / c3, c1 / c3, c0 / c3
    shift = a / 3.0
    p = b - a * shift
    q = c - b * shift + 2.0 * shift * shift * shift
    d = 0.25 * q * q + p * p * p / 27.0
    if d > 0.0:
        w = -0.5 * q - math.copysign(math.sqrt(d), q)
        s = math.copysign(abs(w) ** (1.0 / 3.0), w)
        out[0] = (s - p / (3.0 * s) if s != 0.0 else 0.0) - shift
        count = 1
    else:
        m = math.sqrt(max(-p / 3.0, 0.0))
        x = -0.5 * q / (m * m * m) if m > 0.0 else 0.0
        angle = math.acos(min(1.0, max(-1.0, x))) / 3.0
        for k in range(3):
            out[k] = 2.0 * m * math.cos(angle - 2.0 * math.pi * k / 3.0) - shift
        count = 3
    for k in range(count):
        x = out[k]
        for _ in range(3):
            value = ((x + a) * x + b) * x + c
            slope = (3.0 * x + 2.0 * a) * x + b
            if slope == 0.0:
                break
            x -= value / slope
        if math.isfinite(x):
            out[k] = x
    return count


@njit(cache=True, error_model="numpy")
def _det(m):
    return (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


@njit(cache=True, error_model="numpy")
def _adjugate(m, out):
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            out[j, i] = m[i1, j1] * m[i2, j2] - m[i1, j2] * m[i2, j1]


@njit(cache=True, error_model="numpy")
def _mixed(m, n, A):
    """trace(adj(m) n): the coefficient of g in det(m + g n). A (3, 3) is room to work in."""
    _adjugate(m, A)
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += A[i, j] * n[j, i]
    return total


@njit(cache=True, error_model="numpy")
def _newton(lam, b12, b13, b23, a12, a13, a23):
    """Polishes the distances on the three quadrics; largest relative residual."""
    size = max(a12, a13, a23)
    worst = 0.0
    for _ in range(8):
        l1, l2, l3 = lam[0], lam[1], lam[2]
        e1 = l1 * l1 + l2 * l2 - 2.0 * b12 * l1 * l2 - a12
        e2 = l1 * l1 + l3 * l3 - 2.0 * b13 * l1 * l3 - a13
        e3 = l2 * l2 + l3 * l3 - 2.0 * b23 * l2 * l3 - a23
        worst = max(abs(e1), abs(e2), abs(e3)) / size
        if worst < 1e-16:
            break
        p1, p2 = l1 - b12 * l2, l2 - b12 * l1
        q1, q3 = l1 - b13 * l3, l3 - b13 * l1
        r2, r3 = l2 - b23 * l3, l3 - b23 * l2
        # [p1 p2 0; q1 0 q3; 0 r2 r3] d = e/2
        det = -p1 * q3 * r2 - p2 * q1 * r3
        if abs(det) < 1e-14 * size * math.sqrt(size):
            break
        e1 *= 0.5
        e2 *= 0.5
        e3 *= 0.5
        lam[0] -= (-q3 * r2 * e1 - p2 * r3 * e2 + p2 * q3 * e3) / det
        lam[1] -= (-q1 * r3 * e1 + p1 * r3 * e2 - p1 * q3 * e3) / det
        lam[2] -= (q1 * r2 * e1 - p1 * r2 * e2 - p2 * q1 * e3) / det
    return worst


@njit(cache=True, error_model="numpy")
def _triad(p1, p2, p3, out):
    """Orthonormal columns of a triangle: along p2 - p1, in its plane, and its normal; False where it has no area."""
    ax, ay, az = p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]
    bx, by, bz = p3[0] - p1[0], p3[1] - p1[1], p3[2] - p1[2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    sa, sb = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
    sn = math.sqrt(nx * nx + ny * ny + nz * nz)
    if not sn > 1e-9 * sa * sb:
        return False
    ax, ay, az = ax / sa, ay / sa, az / sa
    nx, ny, nz = nx / sn, ny / sn, nz / sn
    out[0, 0], out[1, 0], out[2, 0] = ax, ay, az
    out[0, 1], out[1, 1], out[2, 1] = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    out[0, 2], out[1, 2], out[2, 2] = nx, ny, nz
    return True


@njit(cache=True, error_model="numpy")
def p3p(y, X, out):
    """Poses of a camera that sees X (3, 3; rows, m) under the unit directions y (3, 3; rows, camera axes).

    out (4, 12): C_cn row by row, then the camera's place in n, m. Returns how many there are, 0 to 4 (0 also where the
    points lie on a line).
    """
    world, seen = np.empty((3, 3)), np.empty((3, 3))
    if not _triad(X[0], X[1], X[2], world):
        return 0
    a12 = a13 = a23 = b12 = b13 = b23 = 0.0
    for k in range(3):
        a12 += (X[0, k] - X[1, k]) ** 2
        a13 += (X[0, k] - X[2, k]) ** 2
        a23 += (X[1, k] - X[2, k]) ** 2
        b12 += y[0, k] * y[1, k]
        b13 += y[0, k] * y[2, k]
        b23 += y[1, k] * y[2, k]
    size = max(a12, a13, a23)
    s12, s13, s23 = a12 / size, a13 / size, a23 / size
    D1, D2, D0, A, C = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    D1[0, 0], D1[1, 1], D1[2, 2] = s23, s23 - s12, -s12
    D1[0, 1] = D1[1, 0] = -b12 * s23
    D1[1, 2] = D1[2, 1] = b23 * s12
    D2[0, 0], D2[1, 1], D2[2, 2] = s23, -s13, s23 - s13
    D2[0, 2] = D2[2, 0] = -b13 * s23
    D2[1, 2] = D2[2, 1] = b23 * s13
    # det(D1 + g D2); where both conics split already (a symmetric scene) others of the pencil are taken for them
    c0 = c1 = c2 = c3 = 0.0
    for turn in range(2):
        if turn == 1:
            for i in range(3):
                for j in range(3):
                    p, q = D1[i, j], D2[i, j]
                    D1[i, j], D2[i, j] = 0.8 * p + 0.6 * q, 0.8 * q - 0.6 * p
        c0, c3 = _det(D1), _det(D2)
        c1, c2 = _mixed(D1, D2, A), _mixed(D2, D1, A)
        if max(abs(c0), abs(c3)) > 1e-3 * max(abs(c1), abs(c2)):
            break
    roots = np.empty(3)
    swapped = abs(c3) < abs(c0)
    lead = c0 if swapped else c3
    if lead == 0.0 or not math.isfinite(lead):
        return 0
    many = real_roots_cubic(c0, c1, c2, c3, roots) if swapped else real_roots_cubic(c3, c2, c1, c0, roots)
    # the member of the pencil that splits best into two real lines
    best, chosen, top = 0.0, -1, 0
    for k in range(many):
        g = roots[k]
        scale = 0.0
        for i in range(3):
            for j in range(3):
                D0[i, j] = g * D1[i, j] + D2[i, j] if swapped else D1[i, j] + g * D2[i, j]
                scale += D0[i, j] * D0[i, j]
        _adjugate(D0, A)
        for i in range(3):
            if scale > 0.0 and -A[i, i] / scale > best:
                best, chosen, top = -A[i, i] / scale, k, i
    if chosen < 0:
        return 0
    g = roots[chosen]
    for i in range(3):
        for j in range(3):
            D0[i, j] = g * D1[i, j] + D2[i, j] if swapped else D1[i, j] + g * D2[i, j]
    _adjugate(D0, A)
    beta = math.sqrt(-A[top, top])
    p1, p2, p3 = -A[0, top] / beta, -A[1, top] / beta, -A[2, top] / beta
    for i in range(3):
        for j in range(3):
            C[i, j] = D0[i, j]
    C[0, 1] -= p3
    C[0, 2] += p2
    C[1, 0] += p3
    C[1, 2] -= p1
    C[2, 0] -= p2
    C[2, 1] += p1
    row = column = 0
    for i in range(3):
        for j in range(3):
            if abs(C[i, j]) > abs(C[row, column]):
                row, column = i, j
    other = D1 if swapped == (abs(g) < 1.0) else D2
    line, lam = np.empty(3), np.empty(3)
    found = 0
    for which in range(2):
        for i in range(3):
            line[i] = C[row, i] if which == 0 else C[i, column]
        k = 0
        for i in range(3):
            if abs(line[i]) > abs(line[k]):
                k = i
        i, j = (k + 1) % 3, (k + 2) % 3
        mi, mj = -line[i] / line[k], -line[j] / line[k]  # lam_k = mi lam_i + mj lam_j
        qa = other[i, i] + 2.0 * other[i, k] * mi + other[k, k] * mi * mi
        qb = other[i, j] + other[i, k] * mj + other[k, j] * mi + other[k, k] * mi * mj
        qc = other[j, j] + 2.0 * other[j, k] * mj + other[k, k] * mj * mj
        disc = qb * qb - qa * qc
        if disc < 0.0:
            if disc < -1e-9 * (qb * qb + abs(qa * qc)):
                continue
            disc = 0.0
        w = -(qb + math.copysign(math.sqrt(disc), qb))
        for sign in range(2):  # lam_i : lam_j = w : qa and qc : w
            if sign == 0:
                lam[i], lam[j] = w, qa
            else:
                lam[i], lam[j] = qc, w
            lam[k] = mi * lam[i] + mj * lam[j]
            if lam[0] + lam[1] + lam[2] < 0.0:
                lam[0], lam[1], lam[2] = -lam[0], -lam[1], -lam[2]
            if not (lam[0] > 0.0 and lam[1] > 0.0 and lam[2] > 0.0):
                continue
            form = (
                2.0 * (lam[0] ** 2 + lam[1] ** 2 + lam[2] ** 2)
                - 2.0 * (b12 * lam[0] * lam[1] + b13 * lam[0] * lam[2] + b23 * lam[1] * lam[2])
            )  # fmt: skip
            if not form > 0.0:
                continue
            scale = math.sqrt((s12 + s13 + s23) / form)
            for n in range(3):
                lam[n] *= scale
            if _newton(lam, b12, b13, b23, s12, s13, s23) > 1e-6:
                continue
            if not (lam[0] > 0.0 and lam[1] > 0.0 and lam[2] > 0.0):
                continue
            length = math.sqrt(size)
            q1, q2, q3 = length * lam[0] * y[0], length * lam[1] * y[1], length * lam[2] * y[2]
            if not _triad(q1, q2, q3, seen):
                continue
            for m in range(3):
                for n in range(3):
                    out[found, 3 * m + n] = (
                        seen[m, 0] * world[n, 0] + seen[m, 1] * world[n, 1] + seen[m, 2] * world[n, 2]
                    )
            for n in range(3):
                back = 0.0
                for m in range(3):
                    back += out[found, 3 * m + n] * (q1[m] + q2[m] + q3[m])
                out[found, 9 + n] = (X[0, n] + X[1, n] + X[2, n] - back) / 3.0
            fresh = True
            for s in range(found):
                away = 0.0
                for n in range(3):
                    away += (out[found, 9 + n] - out[s, 9 + n]) ** 2
                if away < 1e-14 * size:
                    fresh = False
            if fresh and found < 4:
                found += 1
    return found
