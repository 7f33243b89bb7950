"""Attitude integrated as in textbooks, to study its drift: Euler angles, Poisson, quaternion by Runge-Kutta 1 to 4.

Thesis frames: body x right, y forward, z up; C = Rz(psi) Rx(theta) Ry(gamma), psi counter-clockwise. Rates are those of
the motion law (2.23), angle = amplitude sin(rate t + phase), evaluated where each method asks for them.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

EULER, POISSON, QUATERNION = 0, 1, 2


@njit(cache=True, error_model="numpy")
def _rates(t, law, w):
    """w (3), rad/s, by (2.15); law (3, 3): amplitude, rate, phase of psi, theta, gamma."""
    a = law[1, 0] * math.sin(law[1, 1] * t + law[1, 2])
    b = law[2, 0] * math.sin(law[2, 1] * t + law[2, 2])
    p1 = law[0, 0] * law[0, 1] * math.cos(law[0, 1] * t + law[0, 2])
    a1 = law[1, 0] * law[1, 1] * math.cos(law[1, 1] * t + law[1, 2])
    b1 = law[2, 0] * law[2, 1] * math.cos(law[2, 1] * t + law[2, 2])
    ca, cb, sb = math.cos(a), math.cos(b), math.sin(b)
    w[0] = a1 * cb - p1 * ca * sb
    w[1] = b1 + p1 * math.sin(a)
    w[2] = p1 * ca * cb + a1 * sb


@njit(cache=True, error_model="numpy")
def _slope(form, t, law, x, w, out):
    _rates(t, law, w)
    if form == EULER:  # psi, theta, gamma: (2.22)
        c, s = math.cos(x[2]), math.sin(x[2])
        y = w[2] * c - w[0] * s
        out[0] = y / math.cos(x[1])
        out[1] = w[0] * c + w[2] * s
        out[2] = w[1] - y * math.tan(x[1])
    elif form == POISSON:  # C' = C [w x]
        for i in range(3):
            a, b, c = x[3 * i], x[3 * i + 1], x[3 * i + 2]
            out[3 * i] = b * w[2] - c * w[1]
            out[3 * i + 1] = c * w[0] - a * w[2]
            out[3 * i + 2] = a * w[1] - b * w[0]
    else:
        a, b, c, d = x[0], x[1], x[2], x[3]
        out[0] = 0.5 * (-b * w[0] - c * w[1] - d * w[2])
        out[1] = 0.5 * (a * w[0] + c * w[2] - d * w[1])
        out[2] = 0.5 * (a * w[1] + d * w[0] - b * w[2])
        out[3] = 0.5 * (a * w[2] + b * w[1] - c * w[0])


@njit(cache=True, error_model="numpy")
def integrate(form, order, renormalise, law, h, n, x, every, out):
    """n steps of h s from t = 0; x (m) the state, carried; out (n // every, m). Methods: Euler, midpoint, Kutta's
    third order, the classical fourth. renormalise: the quaternion to unit length, C by Gram-Schmidt, after each
    step."""
    m = x.size
    w = np.empty(3)
    k1, k2, k3, k4, y = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    row = 0
    for k in range(n):
        t = k * h
        _slope(form, t, law, x, w, k1)
        if order == 1:
            for i in range(m):
                x[i] += h * k1[i]
        else:
            for i in range(m):
                y[i] = x[i] + 0.5 * h * k1[i]
            _slope(form, t + 0.5 * h, law, y, w, k2)
            if order == 2:
                for i in range(m):
                    x[i] += h * k2[i]
            elif order == 3:
                for i in range(m):
                    y[i] = x[i] + h * (2.0 * k2[i] - k1[i])
                _slope(form, t + h, law, y, w, k3)
                for i in range(m):
                    x[i] += h * (k1[i] + 4.0 * k2[i] + k3[i]) / 6.0
            else:
                for i in range(m):
                    y[i] = x[i] + 0.5 * h * k2[i]
                _slope(form, t + 0.5 * h, law, y, w, k3)
                for i in range(m):
                    y[i] = x[i] + h * k3[i]
                _slope(form, t + h, law, y, w, k4)
                for i in range(m):
                    x[i] += h * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0
        if renormalise and form == QUATERNION:
            s = 1.0 / math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[3] * x[3])
            for i in range(4):
                x[i] *= s
        elif renormalise and form == POISSON:
            s = 1.0 / math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
            for i in range(3):
                x[i] *= s
            s = x[0] * x[3] + x[1] * x[4] + x[2] * x[5]
            for i in range(3):
                x[3 + i] -= s * x[i]
            s = 1.0 / math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
            for i in range(3):
                x[3 + i] *= s
            x[6] = x[1] * x[5] - x[2] * x[4]
            x[7] = x[2] * x[3] - x[0] * x[5]
            x[8] = x[0] * x[4] - x[1] * x[3]
        if (k + 1) % every == 0 and row < out.shape[0]:
            for i in range(m):
                out[row, i] = x[i]
            row += 1
