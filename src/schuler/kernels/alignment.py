"""Loops of the alignment: specific force summed in the body axes of the start, attitude by increments alone."""

from __future__ import annotations

import numpy as np
from numba import njit

from schuler.kernels.rotation import dcm_from_quat, quat_from_rotvec, quat_product


@njit(cache=True, error_model="numpy")
def turn(dtheta, q):
    """q (4) <- q exp(increments), with the coning correction from the previous increment."""
    p = np.zeros(3)
    q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
    for k in range(dtheta.shape[0]):
        x, y, z = dtheta[k, 0], dtheta[k, 1], dtheta[k, 2]
        a = x + (p[1] * z - p[2] * y) / 12.0
        b = y + (p[2] * x - p[0] * z) / 12.0
        c = z + (p[0] * y - p[1] * x) / 12.0
        d0, d1, d2, d3 = quat_from_rotvec(a, b, c)
        q0, q1, q2, q3 = quat_product(q0, q1, q2, q3, d0, d1, d2, d3)
        s = 1.5 - 0.5 * (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
        q0, q1, q2, q3 = s * q0, s * q1, s * q2, s * q3
        p[0], p[1], p[2] = x, y, z
    q[0], q[1], q[2], q[3] = q0, q1, q2, q3


@njit(cache=True, error_model="numpy")
def force_in_start_axes(dtheta, dv, out):
    """out (n, 3): running sum of dv carried into the body axes of the first instant."""
    q = np.array([1.0, 0.0, 0.0, 0.0])
    x = y = z = 0.0
    for k in range(dtheta.shape[0]):
        half = dtheta[k : k + 1] * 0.5
        turn(half, q)
        c11, c12, c13, c21, c22, c23, c31, c32, c33 = dcm_from_quat(q[0], q[1], q[2], q[3])
        x += c11 * dv[k, 0] + c12 * dv[k, 1] + c13 * dv[k, 2]
        y += c21 * dv[k, 0] + c22 * dv[k, 1] + c23 * dv[k, 2]
        z += c31 * dv[k, 0] + c32 * dv[k, 1] + c33 * dv[k, 2]
        turn(half, q)
        out[k, 0], out[k, 1], out[k, 2] = x, y, z
