"""Rotations as compiled scalar code: quaternions scalar first, q_nb takes b to n; C stored row by row.

Source: Groves (2013), Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, sections 2.2, 5.5.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def quat_from_rotvec(x, y, z):
    """Unit quaternion (4 scalars) of the rotation vector (x, y, z), rad; exact to rounding at any size."""
    a2 = x * x + y * y + z * z
    if a2 < 1e-6:
        s = 0.5 - a2 * (1.0 / 48.0 - a2 / 3840.0)
        c = 1.0 - a2 * (0.125 - a2 / 384.0)
    else:
        a = math.sqrt(a2)
        s = math.sin(0.5 * a) / a
        c = math.cos(0.5 * a)
    return c, s * x, s * y, s * z


@njit(cache=True, error_model="numpy")
def quat_product(a0, a1, a2, a3, b0, b1, b2, b3):
    """Hamilton product a b: first b, then a, for q_nb that take b to n."""
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


@njit(cache=True, error_model="numpy")
def dcm_from_quat(q0, q1, q2, q3):
    """The nine elements of C_nb, row by row."""
    return (
        q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3,
        2.0 * (q1 * q2 - q0 * q3),
        2.0 * (q1 * q3 + q0 * q2),
        2.0 * (q1 * q2 + q0 * q3),
        q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3,
        2.0 * (q2 * q3 - q0 * q1),
        2.0 * (q1 * q3 - q0 * q2),
        2.0 * (q2 * q3 + q0 * q1),
        q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3,
    )


@njit(cache=True, error_model="numpy")
def rotvec_from_quat(q0, q1, q2, q3):
    """Rotation vector (x, y, z), rad, norm at most pi."""
    if q0 < 0.0:
        q0, q1, q2, q3 = -q0, -q1, -q2, -q3
    s2 = q1 * q1 + q2 * q2 + q3 * q3
    if s2 < 1e-12:
        k = 2.0 / q0
    else:
        s = math.sqrt(s2)
        k = 2.0 * math.atan2(s, q0) / s
    return k * q1, k * q2, k * q3


@njit(cache=True, error_model="numpy")
def quat_from_euler(roll, pitch, heading):
    """q_nb of roll, pitch, heading (rad), order Z Y X from n to b."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    ch, sh = math.cos(0.5 * heading), math.sin(0.5 * heading)
    return (
        cr * cp * ch + sr * sp * sh,
        sr * cp * ch - cr * sp * sh,
        cr * sp * ch + sr * cp * sh,
        cr * cp * sh - sr * sp * ch,
    )


@njit(cache=True, error_model="numpy")
def euler_from_quat(q0, q1, q2, q3):
    """roll, pitch, heading in rad; heading in (-pi, pi]."""
    roll = math.atan2(2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    s = 2.0 * (q0 * q2 - q1 * q3)
    pitch = math.asin(min(1.0, max(-1.0, s)))
    heading = math.atan2(2.0 * (q1 * q2 + q0 * q3), q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)
    return roll, pitch, heading


@njit(cache=True, error_model="numpy")
def wrap_pi(angle):
    """The same angle in (-pi, pi]; an angle already there keeps its bits."""
    if -math.pi < angle <= math.pi:
        return angle
    a = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return a if a > -math.pi else math.pi


@njit(cache=True, error_model="numpy")
def rotate_state_quat(x, i, fx, fy, fz):
    """x[i:i+4] <- exp([f x]) q, normalised: the attitude correction of an error-state filter, f in n, rad."""
    d0, d1, d2, d3 = quat_from_rotvec(fx, fy, fz)
    q0, q1, q2, q3 = quat_product(d0, d1, d2, d3, x[i], x[i + 1], x[i + 2], x[i + 3])
    k = 1.0 / np.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    x[i], x[i + 1], x[i + 2], x[i + 3] = k * q0, k * q1, k * q2, k * q3
