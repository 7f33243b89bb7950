"""The compiled platform against a readable one: rotation matrices, scipy's DOP853, truth by numerical derivatives."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from schuler.inertial import platform as inertial
from schuler.inertial.platform import GM, OMEGA, RADIUS, PlatformCase

DEG = math.pi / 180.0
CASE = PlatformCase(
    lat=35.7 * DEG,
    lon=51.4 * DEG,
    heading=2.0,
    lat_change=-10 * DEG,
    lon_change=12 * DEG,
    duration=1200.0,
    drift=(4.8e-8, -2e-8, 4.8e-7),
    accel_bias=(1e-4, -2e-4),
    accel_scale=(1e-4, 0.0),
    torquer_scale=(2e-5, -1e-5, 0.0),
)


def cross(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def axis(k, angle):
    c, s = math.cos(angle), math.sin(angle)
    i, j = (k + 1) % 3, (k + 2) % 3
    C = np.eye(3)
    C[i, i] = C[j, j] = c
    C[i, j], C[j, i] = -s, s
    return C


def position(t):
    lat = CASE.lat + CASE.lat_change * t / CASE.duration
    lon = CASE.lon + CASE.lon_change * t / CASE.duration + OMEGA * t
    return RADIUS * np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])


def acceleration(t):
    """Of circular components in closed form: lat and lon + w t turn at constant rates."""
    a, b = CASE.lat_change / CASE.duration, CASE.lon_change / CASE.duration + OMEGA
    lat, lon = CASE.lat + a * t, CASE.lon + b * t
    c, s, C, S = math.cos(lat), math.sin(lat), math.cos(lon), math.sin(lon)
    return RADIUS * np.array(
        [
            -(a * a + b * b) * c * C + 2 * a * b * s * S,
            -(a * a + b * b) * c * S - 2 * a * b * s * C,
            -a * a * s,
        ]
    )


def C_i_local(lat, lon):
    c, s, C, S = math.cos(lat), math.sin(lat), math.cos(lon), math.sin(lon)
    return np.column_stack([[-s * C, -s * S, c], [S, -C, 0.0], [c * C, c * S, s]])  # north, west, up


def test_force_of_the_truth():
    truth = inertial.truth_of(CASE, [0.0, 700.0])
    for k, t in enumerate((0.0, 700.0)):
        r = position(t)
        f_i = acceleration(t) + GM * r / np.linalg.norm(r) ** 3
        C = C_i_local(float(truth.lat[k]), float(truth.lon[k]) + OMEGA * t)
        np.testing.assert_allclose(truth.force_mN[k], C.T @ f_i, atol=1e-12)
    h = 1e-2
    numeric = (position(700.0 + h) - 2 * position(700.0) + position(700.0 - h)) / h**2
    np.testing.assert_allclose(acceleration(700.0), numeric, atol=1e-4)


def test_position_independent_exact_form():
    """(9), (11), (12) with matrices: plant and algorithm written as the paper writes them."""
    b, ba = np.array(CASE.drift), np.array([*CASE.accel_bias, 0.0])
    scale, torque = np.array([*CASE.accel_scale, 0.0]), np.array(CASE.torquer_scale)
    from schuler.inertial.platform_alignment import end_values

    end = end_values(CASE)
    clean = end_values(CASE.without_errors())
    local = C_i_local(CASE.lat, CASE.lon)

    def tilted(e):
        return local @ axis(2, e.psi) @ axis(1, e.phi_y) @ axis(0, e.phi_x)

    C0, hat0 = tilted(end), tilted(clean)
    a, c = CASE.lat_change / CASE.duration, CASE.lon_change / CASE.duration
    dv = RADIUS * (a * local[:, 0] - c * math.cos(CASE.lat) * local[:, 1])
    d = (1.0 + scale) * (C0.T @ dv)
    cmd0 = np.array([end.commands[0] - d[1] / RADIUS, end.commands[1] + d[0] / RADIUS])
    r0 = position(0.0)
    x0 = hat0.T @ r0
    u0 = hat0.T @ np.cross([0.0, 0.0, OMEGA], r0) + d

    def rate(t, y):
        C, hat = y[:9].reshape(3, 3), y[9:18].reshape(3, 3)
        p, q, x1, x2, u, v = y[18:]
        r = position(t)
        f = (1.0 + scale) * (C.T @ (acceleration(t) + GM * r / RADIUS**3)) - ba
        dp, dq = -f[1] / RADIUS, f[0] / RADIUS
        x3 = math.sqrt(RADIUS**2 - x1**2 - x2**2)
        dx1, dx2 = -q * x3 + u, p * x3 + v
        w = -(x1 * dx1 + x2 * dx2) / x3 - q * x1 + p * x2
        du, dv = -q * w + f[0] - GM / RADIUS**3 * x1, p * w + f[1] - GM / RADIUS**3 * x2
        turn = (1.0 + torque) * np.array([p, q, 0.0]) + b
        return np.concatenate(
            [(C @ cross(turn)).ravel(), (hat @ cross([p, q, 0.0])).ravel(), [dp, dq, dx1, dx2, du, dv]]
        )

    y0 = np.concatenate([C0.ravel(), hat0.ravel(), cmd0, x0[:2], u0[:2]])
    y = solve_ivp(rate, (0.0, CASE.duration), y0, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    x1, x2 = y[20], y[21]
    estimate = y[9:18].reshape(3, 3) @ np.array([x1, x2, math.sqrt(RADIUS**2 - x1**2 - x2**2)])
    run = inertial.navigate(CASE)
    apart = estimate - position(CASE.duration)
    assert run.error[-1] == pytest.approx(np.linalg.norm(apart), abs=1e-3)
    truth = inertial.truth_of(CASE, [CASE.duration])
    local = C_i_local(float(truth.lat[0]), float(truth.lon[0]) + OMEGA * CASE.duration)
    assert run.north[-1] == pytest.approx(float(local[:, 0] @ apart), abs=0.01)
    assert run.east[-1] == pytest.approx(-float(local[:, 1] @ apart), abs=0.01)


def test_many_cases_at_once_are_the_cases_one_by_one():
    from dataclasses import replace

    cases = [replace(CASE, heading=x, lat=y) for x in (0.1, 3.0) for y in (-0.5, 0.9)]
    for algorithm in ("position-independent", "free-azimuth", "as-published", "strapdown"):
        together = inertial.errors_of(cases, algorithm, "exact", (1200.0, 600.0))
        for case, errors in zip(cases, together, strict=True):
            run = inertial.navigate(case, algorithm, time=inertial.nodes(case, 10.0, (600.0,)), cosines=True)
            np.testing.assert_allclose(errors, run.at((1200.0, 600.0)), atol=1e-9)


def test_velocity_of_the_track_is_the_motion_of_its_position():
    run = inertial.navigate(CASE, "free-azimuth", time=inertial.nodes(CASE, 1.0))
    lat = np.gradient(run.lat, run.time)[5:-5] * RADIUS
    np.testing.assert_allclose(run.velocity[5:-5, 0], lat, atol=1e-4)
