"""Hard iron found on the way: a sphere through the field in body axes, by least squares with a fading memory.

|m - b|^2 = r^2 is linear in b and k = r^2 - |b|^2: |m|^2 = 2 m b + k. A row is taken where the field's direction in b
has turned since the last one, so that rest does not outweigh motion. The centre b counts only where the sphere through
it explains the swing of the size and its own sigma is small: a field that is bent from outside has no such centre.
"""

from __future__ import annotations

import math

from numba import njit

# layout of the vector s: size that all is divided by, last direction (3), rows; sums of h h' (10), h y (4), y^2; the
# centre found (3), and whether one was
UNIT, LAST, ROWS, HH, HY, YY, B, FOUND = 0, 1, 4, 5, 15, 19, 20, 23
NS = 24
TURN = 0.96  # cosine of the angle between two rows, 16 deg
MEMORY = 300.0  # rows
FEWEST = 25.0
EXPLAINS = 0.3  # share of the variance of |m|^2 that may be left
LEAST = 0.05  # of the field: a smaller centre is left to the compass error
SURE = 0.2  # sigma of the centre over its size
FINE = 0.03  # sigma of the centre, of the field
NOISE = 0.03  # of |m|^2, relative


@njit(cache=True, error_model="numpy")
def look(s, A, mx, my, mz):
    """One field in b. True where a centre was found (again): s[B:B+3] holds it in the field's unit. A (4, 5): work."""
    size = math.sqrt(mx * mx + my * my + mz * mz)
    if not size > 0.0:
        return False
    if s[UNIT] <= 0.0:
        s[UNIT] = size
    elif (s[LAST] * mx + s[LAST + 1] * my + s[LAST + 2] * mz) > TURN * size:
        return False
    s[LAST], s[LAST + 1], s[LAST + 2] = mx / size, my / size, mz / size
    k = 1.0 / s[UNIT]
    h = (2.0 * mx * k, 2.0 * my * k, 2.0 * mz * k, 1.0)
    y = size * size * k * k
    fade = 1.0 - 1.0 / MEMORY
    s[ROWS] = fade * s[ROWS] + 1.0
    n = 0
    for i in range(4):
        for j in range(i + 1):
            s[HH + n] = fade * s[HH + n] + h[i] * h[j]
            A[i, j] = s[HH + n]
            A[j, i] = s[HH + n]
            n += 1
        s[HY + i] = fade * s[HY + i] + h[i] * y
    s[YY] = fade * s[YY] + y * y
    if s[ROWS] < FEWEST:
        return False
    # Cholesky of the 4 x 4, in place below the diagonal
    for a in range(4):
        for b in range(a + 1):
            v = A[a, b]
            for c in range(b):
                v -= A[a, c] * A[b, c]
            if a == b:
                if v <= 1e-6 * s[ROWS]:
                    return False
                A[a, a] = math.sqrt(v)
            else:
                A[a, b] = v / A[b, b]
    rows = s[ROWS]
    mean = s[HY + 3] / rows
    swing2 = s[YY] / rows - mean * mean
    left2 = s[YY]
    for a in range(4):
        v = s[HY + a]
        for c in range(a):
            v -= A[a, c] * A[c, 4]
        A[a, 4] = v / A[a, a]
        left2 -= A[a, 4] * A[a, 4]
    left2 = max(left2 / rows, NOISE * NOISE)
    for a in range(3, -1, -1):
        v = A[a, 4]
        for c in range(a + 1, 4):
            v -= A[c, a] * A[c, 4]
        A[a, 4] = v / A[a, a]
    size2 = A[0, 4] * A[0, 4] + A[1, 4] * A[1, 4] + A[2, 4] * A[2, 4]
    # sigma of the centre: trace of the inverse over its three rows
    trace = 0.0
    for i in range(3):
        z0 = 1.0 / A[0, 0] if i == 0 else 0.0
        z1 = ((1.0 if i == 1 else 0.0) - A[1, 0] * z0) / A[1, 1]
        z2 = ((1.0 if i == 2 else 0.0) - A[2, 0] * z0 - A[2, 1] * z1) / A[2, 2]
        z3 = -(A[3, 0] * z0 + A[3, 1] * z1 + A[3, 2] * z2) / A[3, 3]
        trace += z0 * z0 + z1 * z1 + z2 * z2 + z3 * z3
    sure = left2 * trace < min(SURE * SURE * size2, FINE * FINE)
    if not (sure and left2 < EXPLAINS * swing2 and size2 > LEAST * LEAST):
        return False
    for i in range(3):
        s[B + i] = A[i, 4] * s[UNIT]
    s[FOUND] = 1.0
    return True
