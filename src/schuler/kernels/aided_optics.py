"""Camera and lidar as measurements of the aided INS: sightings of known points, ranges to points and to a height model.

Residual r = predicted - measured and H as in `aided_measure`; the geometry is `kernels.optics`. (5.12)-(5.21) of the
thesis with its (5.16)-(5.18), (5.20) put right.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .aided_measure import offset_ned
from .aided_state import C_CB, CAM, DIVERGENCE, DR, FOCAL, GROUND, HGT, LAT, LID, LON, PHI, QUAT, RE, REACH, RN, U0, V0
from .earth import E2, A
from .optics import HIT, carry_frame, lidar_height_rows, lidar_point_rows, lidar_sigma, sighting_rows
from .rotation import dcm_from_quat


@njit(cache=True, error_model="numpy")
def _spread(H, G, rows):
    """(rows, 6) derivatives by position and attitude into the columns of H."""
    for i in range(rows):
        for j in range(3):
            H[i, DR + j] += G[i, j]
            H[i, PHI + j] += G[i, 3 + j]


@njit(cache=True, error_model="numpy")
def bend(P, f, du, dv, r1, r2, r3):
    """Variance, px^2, that the second order of a sighting adds: a turn moves a point on an arc, two turns mix.

    With a = sigma^2 of phi and b = that of the position over the distance squared, (du, dv) from the principal point:
    f^2 (pairs of different turns) + (du^2 + dv^2) (a + b)^2. Some pixels while heading is known to degrees, nothing
    once it is known to a milliradian.
    """
    d2 = r1 * r1 + r2 * r2 + r3 * r3
    p0, p1, p2 = P[PHI, PHI], P[PHI + 1, PHI + 1], P[PHI + 2, PHI + 2]
    a, b = p0 + p1 + p2, (P[DR, DR] + P[DR + 1, DR + 1] + P[DR + 2, DR + 2]) / d2
    pairs = p0 * p1 + p1 * p2 + p2 * p0 + a * b
    return f * f * pairs + (du * du + dv * dv) * (a + b) * (a + b)


@njit(cache=True, error_model="numpy")
def sighting(x, P, c, z, H, r, R):
    """A known point in the picture: z = (u, v px, lat, lon rad, height m, sigma u, sigma v px, sigma N, E, D m of the
    point). Two rows; 0 where the point would be behind the camera. R (2) gets the point's own uncertainty and what the
    second order adds (`bend`)."""
    C = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    r1, r2, r3 = offset_ned(x, z[2], z[3], z[4])
    G = np.zeros((2, 6))
    u, v, seen = sighting_rows(C, r1, r2, r3, c[C_CB : C_CB + 9], c[CAM : CAM + 3], c[FOCAL], c[U0], c[V0], G)
    if not seen:
        return 0
    more = bend(P, c[FOCAL], u - c[U0], v - c[V0], r1, r2, r3)
    for i in range(2):
        R[i] = z[5 + i] * z[5 + i] + more
        for j in range(3):
            if z[7 + j] > 0.0:
                R[i] += (G[i, j] * z[7 + j]) ** 2
    carry_frame(x[LAT], x[RN], x[RE], G, 2)
    r[0], r[1] = u - z[0], v - z[1]
    _spread(H, G, 2)
    return 2


@njit(cache=True, error_model="numpy")
def lidar_point(x, c, z, H, r, R):
    """Range of the lidar to a known point: z = (range m, lat, lon rad, height m, -, sigma m). One row."""
    C = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    r1, r2, r3 = offset_ned(x, z[1], z[2], z[3])
    G = np.zeros((1, 6))
    rho = lidar_point_rows(C, r1, r2, r3, c[LID : LID + 3], G[0])
    carry_frame(x[LAT], x[RN], x[RE], G, 1)
    r[0] = rho - z[0]
    R[0] = z[5] * z[5]
    _spread(H, G, 1)
    return 1


@njit(cache=True, error_model="numpy")
def lidar_terrain(x, c, grid, heights, z, H, r, R):
    """Range of a beam to the ground of a height model: z = (range m, azimuth, elevation rad, -, -, sigma m). One row;
    0 where the beam leaves the model or does not meet the ground within reach."""
    C = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    G = np.zeros((1, 6))
    rho, status, incidence, _, _ = lidar_height_rows(
        x[LAT], x[LON], x[HGT], C, c[LID : LID + 3], z[1], z[2], grid, heights, c[REACH], A, E2, G[0]
    )
    if status != HIT:
        return 0
    sigma = lidar_sigma(z[5], rho, incidence, c[DIVERGENCE], c[GROUND])
    carry_frame(x[LAT], x[RN], x[RE], G, 1)
    r[0] = rho - z[0]
    R[0] = sigma * sigma
    _spread(H, G, 1)
    return 1 if math.isfinite(r[0]) else 0
