"""Closed-loop alignment of a stable platform at rest, compiled: two levelling loops and one on the azimuth gimbal.

Frames and signs: `schuler.kernels.platform_truth`. Source: Ghesmati et al., figures 3 and 4 and equations (17)-(19),
rebuilt; the gain of the integral stands before the integrator, so that changing it does not move the command.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from schuler.kernels.platform_truth import spin, turn
from schuler.kernels.rotation import wrap_pi

_jit = njit(cache=True, error_model="numpy")

(
    F_NORTH,  # specific force at rest along north of mN, m/s^2
    F_UP,
    W_NORTH,  # Earth rate along north and up of mN, rad/s
    W_UP,
    KP_LEVEL,  # rad/s per m/s^2
    KI_LEVEL,
    KP_AZIMUTH,  # rad/s per rad
    KI_AZIMUTH,
    LAG,  # first-order lag of the loops' signals, s; 0: none
    PSI_BODY,  # the heading that the gimbal angle is counted from, rad
    BIAS_PSI,
    BIAS_1,  # measured force = (1 + scale) f - bias
    BIAS_2,
    SCALE_1,
    SCALE_2,
    TORQUER_1,  # rate = (1 + scale) command + drift
    TORQUER_2,
    TORQUER_3,
    DRIFT_1,
    DRIFT_2,
    DRIFT_3,
    N_PLANT,
) = range(22)
N_LOOP = 10  # q_mN_S, integrals of channels 1, 2, 3, lagged signals 1, 2, 3
N_SHOWN = 9  # psi, phi_x, phi_y, commands p, q, r, measured forces f1, f2, gimbal angle less its bias


@_jit
def _signals(y, c):
    """(a1, a2, e, psi, phi_y, phi_x) of the state."""
    f1, f2, f3 = turn(y[0], -y[1], -y[2], -y[3], c[F_NORTH], 0.0, c[F_UP])
    m00 = y[0] ** 2 + y[1] ** 2 - y[2] ** 2 - y[3] ** 2
    m10 = 2.0 * (y[1] * y[2] + y[0] * y[3])
    m20 = 2.0 * (y[1] * y[3] - y[0] * y[2])
    m21 = 2.0 * (y[2] * y[3] + y[0] * y[1])
    m22 = y[0] ** 2 - y[1] ** 2 - y[2] ** 2 + y[3] ** 2
    psi = math.atan2(m10, m00)
    e = wrap_pi(psi - c[PSI_BODY]) - c[BIAS_PSI]
    return (
        (1.0 + c[SCALE_1]) * f1 - c[BIAS_1],
        (1.0 + c[SCALE_2]) * f2 - c[BIAS_2],
        e,
        psi,
        math.asin(-m20),
        math.atan2(m21, m22),
    )


@_jit
def _commands(y, c):
    a1, a2, e, psi, phi_y, phi_x = _signals(y, c)
    if c[LAG] > 0.0:
        a1, a2, e = y[7], y[8], y[9]
    p = -c[KP_LEVEL] * a2 - y[5]
    q = c[KP_LEVEL] * a1 + y[4]
    r = -c[KP_AZIMUTH] * e - y[6]
    return p, q, r


@_jit
def _loop_rates(y, c, dy):
    a1, a2, e, psi, phi_y, phi_x = _signals(y, c)
    p, q, r = _commands(y, c)
    if c[LAG] > 0.0:
        dy[7], dy[8], dy[9] = (a1 - y[7]) / c[LAG], (a2 - y[8]) / c[LAG], (e - y[9]) / c[LAG]
        a1, a2, e = y[7], y[8], y[9]
    dy[4], dy[5], dy[6] = c[KI_LEVEL] * a1, c[KI_LEVEL] * a2, c[KI_AZIMUTH] * e
    e1, e2, e3 = turn(y[0], -y[1], -y[2], -y[3], c[W_NORTH], 0.0, c[W_UP])
    w1 = (1.0 + c[TORQUER_1]) * p + c[DRIFT_1] - e1
    w2 = (1.0 + c[TORQUER_2]) * q + c[DRIFT_2] - e2
    spin(y, 0, w1, w2, (1.0 + c[TORQUER_3]) * r + c[DRIFT_3] - e3, dy)


@_jit
def align(c, q0, step, shown):
    """Fill shown (n, N_SHOWN), one row a step of `step` seconds, from the attitude q0 (4,) at rest commands zero.

    Returns the last state (N_LOOP,). RK4.
    """
    y, w = np.zeros(N_LOOP), np.zeros(N_LOOP)
    k1, k2, k3, k4 = np.zeros(N_LOOP), np.zeros(N_LOOP), np.zeros(N_LOOP), np.zeros(N_LOOP)
    y[:4] = q0
    for j in range(len(shown)):
        a1, a2, e, psi, phi_y, phi_x = _signals(y, c)
        p, q, r = _commands(y, c)
        shown[j, 0], shown[j, 1], shown[j, 2] = psi, phi_x, phi_y
        shown[j, 3], shown[j, 4], shown[j, 5] = p, q, r
        shown[j, 6], shown[j, 7], shown[j, 8] = a1, a2, e
        if j + 1 == len(shown):
            break
        _loop_rates(y, c, k1)
        for i in range(N_LOOP):
            w[i] = y[i] + 0.5 * step * k1[i]
        _loop_rates(w, c, k2)
        for i in range(N_LOOP):
            w[i] = y[i] + 0.5 * step * k2[i]
        _loop_rates(w, c, k3)
        for i in range(N_LOOP):
            w[i] = y[i] + step * k3[i]
        _loop_rates(w, c, k4)
        n = 0.0
        for i in range(N_LOOP):
            y[i] += step / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
            if i < 4:
                n += y[i] * y[i]
        n = math.sqrt(n)
        for i in range(4):
            y[i] /= n
    return y
