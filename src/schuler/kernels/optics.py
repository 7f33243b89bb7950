"""What a camera and a lidar say of position and attitude: predictions and Jacobians, compiled, one ray at a time.

n = NED at the IMU, b = body FRD, c = camera (x right, y up, z toward the viewer: the scene has z < 0). C: nine
numbers row by row (tuple or array). Signs: dr (m, NED) and phi (rad) = estimate - truth, C_hat = (I - [phi x]) C,
residual = predicted - measured = H (dr, phi). H here holds n fixed in space; `carry_frame` adds that the n of a
navigator turns with its own position. Source: Trucco and Verri (1998), chapter 2, for the camera; the derivatives are
worked out in docs/optics.md.
"""

from __future__ import annotations

import math

from numba import njit

from .geodesy import e_from_ned, ecef_from_geodetic, ned_from_e, normal_from_ecef

# What came of a beam (lidar_height_rows).
HIT = 0
UNCOVERED = 1  # it leaves the height model before it meets the ground
BEYOND = 2  # the ground is farther than the sensor sees
NEVER = 3  # it does not come down to the ground
# Height model: [lat0, lon0 (rad, of row 0, column 0), dlat, dlon (rad)] and heights (rows, columns), m
NEAREST = 1e-3  # m in front of the camera, least depth of what it sees


@njit(cache=True, error_model="numpy")
def camera_vector(C, r1, r2, r3, C_cb, l_b):
    """r_c = C_cb (C_bn r - l_b), m: where the point at r (m, NED from the IMU) lies in camera axes."""
    b1 = C[0] * r1 + C[3] * r2 + C[6] * r3 - l_b[0]
    b2 = C[1] * r1 + C[4] * r2 + C[7] * r3 - l_b[1]
    b3 = C[2] * r1 + C[5] * r2 + C[8] * r3 - l_b[2]
    return (
        C_cb[0] * b1 + C_cb[1] * b2 + C_cb[2] * b3,
        C_cb[3] * b1 + C_cb[4] * b2 + C_cb[5] * b3,
        C_cb[6] * b1 + C_cb[7] * b2 + C_cb[8] * b3,
    )


@njit(cache=True, error_model="numpy")
def project(C, r1, r2, r3, C_cb, l_b, f, u0, v0):
    """u, v (px) and whether the point lies in front of the camera. f, u0, v0 px; l_b (3,) m from the IMU, in b."""
    x, y, z = camera_vector(C, r1, r2, r3, C_cb, l_b)
    if z > -NEAREST:
        return u0, v0, False
    return u0 - f * x / z, v0 - f * y / z, True


@njit(cache=True, error_model="numpy")
def sighting_rows(C, r1, r2, r3, C_cb, l_b, f, u0, v0, H):
    """u, v (px) and visible, as `project`; H (2, 6): d(u, v)/d(dr, phi), px/m and px/rad. (5.14), (5.19), (5.20).

    H is left alone where the point is not visible.
    """
    x, y, z = camera_vector(C, r1, r2, r3, C_cb, l_b)
    if z > -NEAREST:
        return u0, v0, False
    k = f / z
    for i in range(2):
        # a = -(C_cn^T h): the row of H1 = [-f/z, 0, f x/z^2; 0, -f/z, f y/z^2], carried into n
        if i == 0:
            hx, hy, hz = k, 0.0, -k * x / z
        else:
            hx, hy, hz = 0.0, k, -k * y / z
        b1 = C_cb[0] * hx + C_cb[3] * hy + C_cb[6] * hz
        b2 = C_cb[1] * hx + C_cb[4] * hy + C_cb[7] * hz
        b3 = C_cb[2] * hx + C_cb[5] * hy + C_cb[8] * hz
        a1 = C[0] * b1 + C[1] * b2 + C[2] * b3
        a2 = C[3] * b1 + C[4] * b2 + C[5] * b3
        a3 = C[6] * b1 + C[7] * b2 + C[8] * b3
        H[i, 0], H[i, 1], H[i, 2] = a1, a2, a3
        H[i, 3] = a2 * r3 - a3 * r2
        H[i, 4] = a3 * r1 - a1 * r3
        H[i, 5] = a1 * r2 - a2 * r1
    return u0 - f * x / z, v0 - f * y / z, True


@njit(cache=True, error_model="numpy")
def carry_frame(lat, r_n, r_e, H, rows):
    """Turns H (rows, 6) for fixed n into H for a navigator's own n: phi is then against the n of its own position.

    r_n, r_e: radii of curvature plus height, m. theta = (dE/r_e, -dN/r_n, -tan(lat) dE/r_e) is the turn of n with dr,
    and what the ray sees is phi - theta: one part in R/distance of the position columns.
    """
    t = math.tan(lat)
    for i in range(rows):
        H[i, 0] += H[i, 4] / r_n
        H[i, 1] -= (H[i, 3] - t * H[i, 5]) / r_e


@njit(cache=True, error_model="numpy")
def lidar_point_rows(C, r1, r2, r3, l_b, H):
    """Range, m, to a known point at r (m, NED from the IMU) from a lidar at l_b (b); H (6,): d range/d(dr, phi).

    Where the lidar sits in the point itself the range is 0 and H is 0.
    """
    l1 = C[0] * l_b[0] + C[1] * l_b[1] + C[2] * l_b[2]
    l2 = C[3] * l_b[0] + C[4] * l_b[1] + C[5] * l_b[2]
    l3 = C[6] * l_b[0] + C[7] * l_b[1] + C[8] * l_b[2]
    d1, d2, d3 = r1 - l1, r2 - l2, r3 - l3
    rho = math.sqrt(d1 * d1 + d2 * d2 + d3 * d3)
    for i in range(6):
        H[i] = 0.0
    if rho > 0.0:
        e1, e2, e3 = d1 / rho, d2 / rho, d3 / rho
        H[0], H[1], H[2] = -e1, -e2, -e3
        H[3] = l2 * e3 - l3 * e2
        H[4] = l3 * e1 - l1 * e3
        H[5] = l1 * e2 - l2 * e1
    return rho


@njit(cache=True, error_model="numpy")
def beam(azimuth, elevation):
    """Unit vector in b of a beam: azimuth clockwise from forward seen from above, elevation up, rad."""
    c = math.cos(elevation)
    return c * math.cos(azimuth), c * math.sin(azimuth), -math.sin(elevation)


@njit(cache=True, error_model="numpy")
def terrain(model, heights, lat, lon):
    """Height (m), d/dlat, d/dlon (m/rad) of a bilinear height model, and whether it covers the place."""
    x = (lat - model[0]) / model[2]
    turn = lon - model[1]
    turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
    y = turn / model[3]
    if y < 0.0 and turn < 0.0:  # a model that spans more than half the globe counts on from 180 deg
        y = (turn + 2.0 * math.pi) / model[3]
    rows, columns = heights.shape
    tiny = 1e-9
    if not (-tiny <= x <= rows - 1 + tiny and -tiny <= y <= columns - 1 + tiny):
        return 0.0, 0.0, 0.0, False
    i = min(max(int(math.floor(x)), 0), rows - 2)
    j = min(max(int(math.floor(y)), 0), columns - 2)
    p, q = x - i, y - j
    a, b = heights[i, j], heights[i, j + 1]
    c, d = heights[i + 1, j], heights[i + 1, j + 1]
    low, high = a + q * (b - a), c + q * (d - c)
    h = low + p * (high - low)
    return h, (high - low) / model[2], ((b - a) + p * ((d - c) - (b - a))) / model[3], math.isfinite(h)


@njit(cache=True, error_model="numpy")
def _above(model, heights, x, y, z, a, e2):
    """Height of a point over the model, m, and whether the model covers it."""
    s, c, so, co, h = normal_from_ecef(x, y, z, a, e2)
    t, _, _, covered = terrain(model, heights, math.atan2(s, c), math.atan2(so, co))
    return h - t, covered


@njit(cache=True, error_model="numpy")
def lidar_height_rows(lat, lon, h, C, l_b, azimuth, elevation, model, heights, farthest, a, e2, H):
    """Where a beam first meets a height model: range (m), status (HIT, UNCOVERED, BEYOND, NEVER), incidence (rad from
    the ground's normal), lat, lon of the spot; H (6,): d range/d(dr, phi), 0 unless HIT.

    lat, lon (rad), h (m): the IMU. l_b (3,): the lidar in b, m. farthest: what the sensor reaches, m. a, e2: the Earth.
    The beam is followed in steps of half a cell, so a ridge that is narrower than a cell can be cut through.
    """
    sl, cl, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    for i in range(6):
        H[i] = 0.0
    b1, b2, b3 = beam(azimuth, elevation)
    d1 = C[0] * b1 + C[1] * b2 + C[2] * b3
    d2 = C[3] * b1 + C[4] * b2 + C[5] * b3
    d3 = C[6] * b1 + C[7] * b2 + C[8] * b3
    l1 = C[0] * l_b[0] + C[1] * l_b[1] + C[2] * l_b[2]
    l2 = C[3] * l_b[0] + C[4] * l_b[1] + C[5] * l_b[2]
    l3 = C[6] * l_b[0] + C[7] * l_b[1] + C[8] * l_b[2]
    x0, y0, z0 = ecef_from_geodetic(lat, lon, h, a, e2)
    ox, oy, oz = e_from_ned(sl, cl, so, co, l1, l2, l3)
    x0 += ox
    y0 += oy
    z0 += oz
    ex, ey, ez = e_from_ned(sl, cl, so, co, d1, d2, d3)
    above, covered = _above(model, heights, x0, y0, z0, a, e2)
    if not covered:
        return 0.0, UNCOVERED, 0.0, lat, lon
    cell = 0.5 * min(model[2] * a, model[3] * a * cl)
    level = math.sqrt(d1 * d1 + d2 * d2)
    step = cell / max(level, 0.05)
    limit = 4.0 * farthest
    near, far, gap_near = 0.0, 0.0, above
    found = above <= 0.0
    while not found and near < limit:
        far = min(near + max(step, 1e-3), limit)
        above, covered = _above(model, heights, x0 + far * ex, y0 + far * ey, z0 + far * ez, a, e2)
        if not covered:
            if near >= farthest:
                return near, BEYOND, 0.0, lat, lon
            return near, UNCOVERED, 0.0, lat, lon
        if above <= 0.0:
            found = True
        else:
            near, gap_near = far, above
    if not found:
        status = BEYOND if d3 > 0.0 else NEVER
        return near, status, 0.0, lat, lon
    if far == 0.0:
        return 0.0, NEVER, 0.0, lat, lon  # the lidar is under the ground of the model
    gap_far = above
    t = far
    for i in range(60):  # secant kept inside the bracket
        t = (near * gap_far - far * gap_near) / (gap_far - gap_near)
        if i % 4 == 3:
            t = 0.5 * (near + far)
        gap, covered = _above(model, heights, x0 + t * ex, y0 + t * ey, z0 + t * ez, a, e2)
        if gap > 0.0:
            near, gap_near = t, gap
        else:
            far, gap_far = t, gap
        if abs(gap) < 1e-9 or far - near < 1e-10:
            break
    px, py, pz = x0 + t * ex, y0 + t * ey, z0 + t * ez
    s, c, sp, cp, hp = normal_from_ecef(px, py, pz, a, e2)
    spot_lat, spot_lon = math.atan2(s, c), math.atan2(sp, cp)
    _, slope_lat, slope_lon, covered = terrain(model, heights, spot_lat, spot_lon)
    r_e = a / math.sqrt(1.0 - e2 * s * s)
    r_n = r_e * (1.0 - e2) / (1.0 - e2 * s * s) + hp
    # normal of the ground, up, at the spot: (-dh/dN, -dh/dE, -1) in its NED, carried into n of the IMU
    gx, gy, gz = e_from_ned(s, c, sp, cp, -slope_lat / r_n, -slope_lon / ((r_e + hp) * c), -1.0)
    m1, m2, m3 = ned_from_e(sl, cl, so, co, gx, gy, gz)
    along = m1 * d1 + m2 * d2 + m3 * d3
    incidence = math.acos(min(1.0, -along / math.sqrt(m1 * m1 + m2 * m2 + m3 * m3)))
    if t > farthest:
        return t, BEYOND, incidence, spot_lat, spot_lon
    s1, s2, s3 = l1 + t * d1, l2 + t * d2, l3 + t * d3
    H[0], H[1], H[2] = -m1 / along, -m2 / along, -m3 / along
    H[3] = (s2 * m3 - s3 * m2) / along
    H[4] = (s3 * m1 - s1 * m3) / along
    H[5] = (s1 * m2 - s2 * m1) / along
    return t, HIT, incidence, spot_lat, spot_lon


@njit(cache=True, error_model="numpy")
def lidar_sigma(sigma, rho, incidence, divergence, sigma_ground):
    """Sigma of a range, m: the sensor's own; the spread of heights within the footprint, rho divergence tan(i)/4 (full
    1/e^2 divergence, rad); the ground's own sigma, m, seen along the beam."""
    ci = max(math.cos(incidence), 0.02)
    spread = 0.25 * rho * divergence * math.sqrt(1.0 - ci * ci) / ci
    ground = sigma_ground / ci
    return math.sqrt(sigma * sigma + spread * spread + ground * ground)


@njit(cache=True, error_model="numpy")
def sighting_batch(C, points, r, C_cb, l_b, f, u0, v0, uv, seen, H):
    """`sighting_rows` of points (n, 3) from an IMU at r (3,), m: uv (n, 2), seen (n,), H (n, 2, 6); uv and H are left
    alone where a point is not visible."""
    for k in range(points.shape[0]):
        u, v, visible = sighting_rows(
            C, points[k, 0] - r[0], points[k, 1] - r[1], points[k, 2] - r[2], C_cb, l_b, f, u0, v0, H[k]
        )
        seen[k] = visible
        if visible:
            uv[k, 0], uv[k, 1] = u, v
