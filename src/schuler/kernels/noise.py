"""Sensor errors that remember: Gauss-Markov and walk sequences, and the front end of an inertial sensor."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def gauss_markov(drive, phi, sigma, state, out):
    """out[i] = state <- phi state + sigma drive[i], per column; state (k,) is carried. phi = 1: a random walk."""
    n, k = drive.shape
    for j in range(k):
        x = state[j]
        for i in range(n):
            x = phi[j] * x + sigma[j] * drive[i, j]
            out[i, j] = x
        state[j] = x


@njit(cache=True, error_model="numpy")
def imu_front_end(mean, w_ib, rate, C_ib, levers, g_sens, M_g, M_a, bias, white, pole, low, step, carry, limit, out):
    """What the six sensors of an IMU put out, as rates over each interval.

    mean (n, 6) : true mean w_ib_b and f_b; w_ib (n+1, 3) : w_ib_b at the interval ends, for the size effect.
    C_ib (3, 3) : body to IMU axes; levers (3, 3) : row i the place of accelerometer i, m, IMU axes.
    measured = M true + G f + bias + white, M = I + scale and misalignment, G (3, 3) the gyros' g-sensitivity.
    pole : first-order low pass before all that (0: none), low (7,) its state and whether it has begun.
    step (6,) : quantum of angle and velocity, the remainder `carry` (6,) goes into the next sample; limit (6,) clips.
    """
    n = mean.shape[0]
    size = False
    for i in range(3):
        for j in range(3):
            if levers[i, j] != 0.0:
                size = True
    x = np.empty(6)
    w = np.empty(3)
    acc = np.empty(3)
    for k in range(n):
        for i in range(3):
            x[i] = C_ib[i, 0] * mean[k, 0] + C_ib[i, 1] * mean[k, 1] + C_ib[i, 2] * mean[k, 2]
            x[3 + i] = C_ib[i, 0] * mean[k, 3] + C_ib[i, 1] * mean[k, 4] + C_ib[i, 2] * mean[k, 5]
        if size:
            # dw/dt x r over the interval exactly; w x (w x r) by Simpson's rule, its middle from mean and ends.
            acc[:] = 0.0
            for node in range(3):
                for i in range(3):
                    w[i] = 0.0
                    for j in range(3):
                        if node == 0:
                            wj = w_ib[k, j]
                        elif node == 2:
                            wj = w_ib[k + 1, j]
                        else:
                            wj = 0.25 * (6.0 * mean[k, j] - w_ib[k, j] - w_ib[k + 1, j])
                        w[i] += C_ib[i, j] * wj
                weight = 4.0 / 6.0 if node == 1 else 1.0 / 6.0
                for i in range(3):
                    wr = w[0] * levers[i, 0] + w[1] * levers[i, 1] + w[2] * levers[i, 2]
                    ww = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
                    acc[i] += weight * (w[i] * wr - ww * levers[i, i])
            for i in range(3):
                w[i] = 0.0
                for j in range(3):
                    w[i] += C_ib[i, j] * (w_ib[k + 1, j] - w_ib[k, j]) * rate
            x[3] += acc[0] + w[1] * levers[0, 2] - w[2] * levers[0, 1]
            x[4] += acc[1] + w[2] * levers[1, 0] - w[0] * levers[1, 2]
            x[5] += acc[2] + w[0] * levers[2, 1] - w[1] * levers[2, 0]
        if pole > 0.0:
            for i in range(6):
                if low[6] == 0.0:
                    low[i] = x[i]
                low[i] += (1.0 - pole) * (x[i] - low[i])
                x[i] = low[i]
            low[6] = 1.0
        for i in range(3):
            g = M_g[i, 0] * x[0] + M_g[i, 1] * x[1] + M_g[i, 2] * x[2]
            g += g_sens[i, 0] * x[3] + g_sens[i, 1] * x[4] + g_sens[i, 2] * x[5]
            a = M_a[i, 0] * x[3] + M_a[i, 1] * x[4] + M_a[i, 2] * x[5]
            out[k, i] = g + bias[k, i] + white[k, i]
            out[k, 3 + i] = a + bias[k, 3 + i] + white[k, 3 + i]
        for i in range(6):
            y = out[k, i]
            if y > limit[i]:
                y = limit[i]
            elif y < -limit[i]:
                y = -limit[i]
            if step[i] > 0.0:
                total = y / rate + carry[i]
                counts = np.floor(total / step[i] + 0.5)
                carry[i] = total - counts * step[i]
                y = counts * step[i] * rate
            out[k, i] = y
