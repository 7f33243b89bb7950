"""Normal equations of 1, cos, sin and second harmonics of the table angle, turn by turn."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

BASIS = 5  # 1, cos a, sin a, cos 2a, sin 2a


@njit(cache=True, error_model="numpy")
def harmonic_sums(time, outputs, first, last, start, azimuth, rate, turns, normal, right, square):
    """Sums over the rows first <= i < last of a spin; row i belongs to turn floor(|rate| (time[i] - start)/2 pi).

    outputs (n, k); normal (turns, 5, 5), right (turns, 5, k), square (k,): filled here. Rows beyond the last turn are
    left out.
    """
    k = outputs.shape[1]
    b = np.empty(BASIS)
    normal[:] = 0.0
    right[:] = 0.0
    square[:] = 0.0
    for i in range(first, last):
        t = time[i] - start
        turn = int(abs(rate) * t / (2.0 * math.pi))
        if turn < 0 or turn >= turns:
            continue
        a = azimuth + rate * t
        c = math.cos(a)
        s = math.sin(a)
        b[0] = 1.0
        b[1] = c
        b[2] = s
        b[3] = c * c - s * s
        b[4] = 2.0 * s * c
        for p in range(BASIS):
            for q in range(p + 1):
                normal[turn, p, q] += b[p] * b[q]
            for j in range(k):
                right[turn, p, j] += b[p] * outputs[i, j]
        for j in range(k):
            square[j] += outputs[i, j] * outputs[i, j]
    for turn in range(turns):
        for p in range(BASIS):
            for q in range(p):
                normal[turn, q, p] = normal[turn, p, q]
