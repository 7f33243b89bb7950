"""Turning a direction through a stretch of corrected gyro rates."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def transfer(gyro, dt, first, last, bias0, bias1, inverse, g_sense, force, start, out):
    """out (t, 3): each start (t, 3) of body axes at row first[t], seen from body axes at row last[t].

    Rates (inverse)(gyro - bias - g_sense force), with the bias going linearly from bias0[t] to bias1[t], are means over
    their interval dt[i] (s), with the coning term of this and the row before. Rows first[t] <= i < last[t] belong to
    turn t.
    """
    v = np.empty(3)
    w = np.empty(3)
    x = np.empty(3)
    old = np.empty(3)
    for t in range(first.size):
        for i in range(3):
            v[i] = start[t, i]
            old[i] = 0.0
        n = last[t] - first[t]
        for k in range(n):
            row = first[t] + k
            share = (k + 0.5) / n
            for i in range(3):
                x[i] = gyro[row, i] - bias0[t, i] - share * (bias1[t, i] - bias0[t, i])
                for j in range(3):
                    x[i] -= g_sense[i, j] * force[row, j]
            for i in range(3):
                w[i] = (inverse[i, 0] * x[0] + inverse[i, 1] * x[1] + inverse[i, 2] * x[2]) * dt[row]
            c0 = (old[1] * w[2] - old[2] * w[1]) / 12.0
            c1 = (old[2] * w[0] - old[0] * w[2]) / 12.0
            c2 = (old[0] * w[1] - old[1] * w[0]) / 12.0
            for i in range(3):
                old[i] = w[i]
            w[0] += c0
            w[1] += c1
            w[2] += c2
            # A fixed direction turns by -w in the body.
            a2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
            if a2 < 1e-12:
                s = 1.0 - a2 / 6.0
                c = 0.5 - a2 / 24.0
            else:
                a = math.sqrt(a2)
                s = math.sin(a) / a
                c = (1.0 - math.cos(a)) / a2
            x[0] = w[1] * v[2] - w[2] * v[1]
            x[1] = w[2] * v[0] - w[0] * v[2]
            x[2] = w[0] * v[1] - w[1] * v[0]
            y0 = w[1] * x[2] - w[2] * x[1]
            y1 = w[2] * x[0] - w[0] * x[2]
            y2 = w[0] * x[1] - w[1] * x[0]
            v[0] += -s * x[0] + c * y0
            v[1] += -s * x[1] + c * y1
            v[2] += -s * x[2] + c * y2
        for i in range(3):
            out[t, i] = v[i]
