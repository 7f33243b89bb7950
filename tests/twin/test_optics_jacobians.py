"""Every Jacobian of camera and lidar against central differences, and the compiled geometry against readable numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from schuler.aiding import optics
from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84, C_en
from schuler.ground.frames import dcm_from_euler, dcm_from_rotvec
from schuler.ground.terrain import HeightModel
from schuler.kernels import geodesy
from schuler.kernels import optics as kernel

D = math.pi / 180.0
STORED = Camera.of(8889.0, position_frd_m=(0.3, -0.1, 0.2))
C0 = np.asarray(dcm_from_euler(0.05, -0.03, 0.6))
POINT = np.array([150.0, 110.0, 1000.0])


def slope(f, steps):
    """Central differences of fourth order of f(x), x (6,), at 0: (outputs, 6)."""
    columns = []
    for s, e in zip(steps, np.eye(6), strict=True):
        columns.append((8 * (f(s * e) - f(-s * e)) - f(2 * s * e) + f(-2 * s * e)) / (12 * s))
    return np.stack(columns, axis=-1)


def scaled(got, want):
    """Largest difference over the largest element of its block (position, attitude)."""
    blocks = (slice(0, 3), slice(3, 6))
    return max(np.abs(got[..., b] - want[..., b]).max() / max(np.abs(want[..., b]).max(), 1e-12) for b in blocks)


def test_the_stored_case_to_its_printed_digits():
    uv, seen, H = optics.rows(POINT[None], np.zeros(3), C0, STORED)
    assert seen.all()
    np.testing.assert_allclose(uv[0], [1930.79088003, -500.43753618], atol=5e-9)
    known = [-7.383754, -5.169335, 1.673891, -5353.462924, 7634.837277, -36.812662]
    np.testing.assert_allclose(H[0, 0], known, atol=5.1e-7)


@pytest.mark.parametrize("rpy", [(180.0, 0.0, 0.0), (175.0, 20.0, -40.0), (100.0, -10.0, 90.0)])
def test_sighting(rpy):
    """Nadir, tilted and sideways cameras with a lever arm."""
    camera = Camera.of(3000.0, u0_px=12.0, v0_px=-7.0, body_to_camera_rpy_deg=rpy, position_frd_m=(1.5, -0.4, 0.7))
    rng = np.random.default_rng(4)
    tried = 0
    for _ in range(60):
        C = dcm_from_euler(*rng.uniform(-0.4, 0.4, 2), rng.uniform(-3.0, 3.0))
        point = rng.uniform(-600.0, 600.0, 3) + [0.0, 0.0, 800.0]

        def predicted(x, C=C, point=point):
            uv, _ = camera.project(point[None], x[:3], dcm_from_rotvec(-x[3:]) @ C)
            return uv[0]

        depth = -camera.vectors(point[None], np.zeros(3), C)[0, 2]
        if depth < 0.4 * np.linalg.norm(point):
            continue  # near the edge of a half space all derivatives grow without bound
        tried += 1
        uv, seen, H = optics.rows(point[None], np.zeros(3), C, camera)
        assert seen[0]
        np.testing.assert_allclose(uv[0], predicted(np.zeros(6)), rtol=1e-12, atol=1e-9)
        want = slope(predicted, [1e-3 * depth] * 3 + [1e-3] * 3)
        assert scaled(H[0], want) < 1e-8
    assert tried > 10


def navigator(lat, lon, h, C):
    """The true state with errors x = (dr, phi) put on as a navigator has them: phi is against its own n."""
    r_n, r_e = (float(r) + h for r in WGS84.radii(lat))

    def off(x):
        return (lat + x[0] / r_n, lon + x[1] / (r_e * math.cos(lat)), h - x[2], dcm_from_rotvec(-x[3:]) @ C)

    return off


def test_a_navigators_own_frame():
    """`carry_frame`: the rows hold for errors of lat, lon, height and of C_nb against the n of the wrong position."""
    lat, lon, h = 68.0 * D, -140.0 * D, 1200.0
    p = WGS84.ecef_from_geodetic(lat + 2e-4, lon + 3e-4, 150.0)
    r_n, r_e = (float(r) + h for r in WGS84.radii(lat))
    off = navigator(lat, lon, h, C0)
    parts = (STORED.C_cb.ravel(), STORED.l_b, STORED.focal, 0.0, 0.0)

    def predicted(x):
        la, lo, he, C = off(x)
        r = geodesy.offset_n(la, lo, he, *p, WGS84.a, WGS84.e2)
        u, v, seen = kernel.project(np.ascontiguousarray(C).ravel(), *r, *parts)
        assert seen
        return np.array([u, v])

    H = np.empty((2, 6))
    kernel.sighting_rows(C0.ravel(), *geodesy.offset_n(lat, lon, h, *p, WGS84.a, WGS84.e2), *parts, H)
    want = slope(predicted, [1.0] * 3 + [1e-3] * 3)
    assert scaled(H, want) > 1e-5  # held in space: wrong by distance over the Earth's radius
    kernel.carry_frame(lat, r_n, r_e, H, 2)
    assert scaled(H, want) < 3e-7  # what is left: n turns with metres on the ellipsoid only to first order


def test_offset_is_the_difference_of_positions():
    p = WGS84.ecef_from_geodetic(0.9, 0.5, 300.0)
    got = geodesy.offset_n(0.9001, 0.4999, 1500.0, *p, WGS84.a, WGS84.e2)
    want = C_en(0.9001, 0.4999).T @ (p - WGS84.ecef_from_geodetic(0.9001, 0.4999, 1500.0))
    np.testing.assert_allclose(got, want, atol=1e-8)


@pytest.mark.parametrize("lat", [-89.9, -45.0, 0.0, 30.0, 89.99, 90.0])
@pytest.mark.parametrize("h", [-5000.0, 0.0, 1000.0, 50000.0, 1e6])
def test_normal_from_ecef_is_the_inverse(lat, h):
    x = geodesy.ecef_from_geodetic(lat * D, 2.2, h, WGS84.a, WGS84.e2)
    np.testing.assert_allclose(x, WGS84.ecef_from_geodetic(lat * D, 2.2, h), atol=2e-9)
    s, c, so, co, back = geodesy.normal_from_ecef(*x, WGS84.a, WGS84.e2)
    assert math.atan2(s, c) == pytest.approx(lat * D, abs=1e-14)
    assert back == pytest.approx(h, abs=1e-8)
    if lat < 90.0:
        assert math.atan2(so, co) == pytest.approx(2.2, abs=1e-9)


def test_lidar_to_a_known_point():
    arm = np.array([2.0, -0.5, 1.0])
    for point in (POINT, np.array([-40.0, 25.0, 30.0])):

        def predicted(x, point=point):
            return np.array([np.linalg.norm(point - x[:3] - dcm_from_rotvec(-x[3:]) @ C0 @ arm)])

        H = np.empty(6)
        rho = kernel.lidar_point_rows(C0.ravel(), *point, arm, H)
        assert rho == pytest.approx(predicted(np.zeros(6))[0], rel=1e-14)
        # the range is 5e4 times as large as what a turn about the lever arm changes: steps as large as that allows
        want = slope(predicted, [1e-2 * rho] * 3 + [3e-2] * 3)[0]
        np.testing.assert_allclose(H[:3], want[:3], atol=1e-8)
        np.testing.assert_allclose(H[3:], want[3:], atol=1e-8 * np.linalg.norm(arm) * 10)


def hills(lat, lon, step=40.0, n=120, amplitude=1.0):
    """A smooth bilinear landscape around a place; cells of `step` m."""
    i = np.arange(n)[:, None] - n / 2
    j = np.arange(n)[None, :] - n / 2
    h = 120.0 + amplitude * (30.0 * np.sin(0.07 * i) + 25.0 * np.cos(0.05 * j + 0.3) + 0.8 * i - 0.5 * j)
    dlat, dlon = step / 6.37e6, step / (6.37e6 * math.cos(lat))
    return HeightModel(lat - n / 2 * dlat, lon - n / 2 * dlon, dlat, dlon, h)


@pytest.mark.parametrize("beam", [(0.0, -90.0), (40.0, -60.0), (200.0, -45.0), (300.0, -70.0)])
def test_lidar_to_a_height_model(beam):
    lat, lon, h = 50.2 * D, 30.3 * D, 700.0
    model = hills(lat, lon, 700.0, amplitude=4.0)  # large cells: their corners are no place for differences
    off = navigator(lat, lon, h, C0)
    arm = np.array([0.5, 0.2, 0.4])
    az, el = beam[0] * D, beam[1] * D

    def run(la, lo, he, C, H):
        return kernel.lidar_height_rows(
            la, lo, he, np.ascontiguousarray(C).ravel(), arm, az, el, model.grid, model.heights, 3000.0, WGS84.a,
            WGS84.e2, H,
        )  # fmt: skip

    H, spare = np.empty(6), np.empty(6)
    rho, status, incidence, spot_lat, spot_lon = run(lat, lon, h, C0, H)
    assert status == kernel.HIT
    # the spot is on the ground, at that range, in that direction
    spot = WGS84.ecef_from_geodetic(spot_lat, spot_lon, float(model.at(spot_lat, spot_lon)))
    e_n = C0 @ np.array(kernel.beam(az, el))
    r = C_en(lat, lon).T @ (spot - WGS84.ecef_from_geodetic(lat, lon, h)) - C0 @ arm
    np.testing.assert_allclose(r, rho * e_n, atol=2e-8)
    assert 0.0 <= incidence < 1.5
    r_n, r_e = (float(x) + h for x in WGS84.radii(lat))
    kernel.carry_frame(lat, r_n, r_e, H[None], 1)
    want = slope(lambda x: np.array([run(*off(x), spare)[0]]), [6.0] * 3 + [3e-3] * 3)[0]
    assert scaled(H, want) < 1e-7
    # exact at fixed n: the same, moved in space
    C_e = C_en(lat, lon)

    def moved(x):
        la, lo, he = WGS84.geodetic_from_ecef(WGS84.ecef_from_geodetic(lat, lon, h) + C_e @ x[:3])
        C = C_en(la, lo).T @ C_e @ dcm_from_rotvec(-x[3:]) @ C0
        return np.array([run(float(la), float(lo), float(he), C, spare)[0]])

    run(lat, lon, h, C0, H)
    assert scaled(H, slope(moved, [6.0] * 3 + [3e-3] * 3)[0]) < 1e-8


def test_terrain_and_its_gradient():
    model = hills(0.8, 3.1415)  # across 180 deg
    rng = np.random.default_rng(2)
    for _ in range(50):
        lat = model.lat0 + rng.uniform(0.5, 100.0) * model.dlat
        lon = model.lon0 + rng.uniform(0.5, 100.0) * model.dlon
        h, north, east, covered = kernel.terrain(model.grid, model.heights, lat, lon)
        assert covered
        wrapped = math.remainder(lon, 2.0 * math.pi)
        assert h == pytest.approx(float(model.at(lat, wrapped)), abs=1e-6)
        # within a cell bilinear: central differences are exact but for rounding
        s = 1e-3
        up = kernel.terrain(model.grid, model.heights, lat + s * model.dlat, lon)[0]
        down = kernel.terrain(model.grid, model.heights, lat - s * model.dlat, lon)[0]
        if (lat - model.lat0) / model.dlat % 1.0 > 2 * s:
            assert (up - down) / (2 * s * model.dlat) == pytest.approx(north, rel=1e-6)
        assert math.isfinite(east)
    assert not kernel.terrain(model.grid, model.heights, model.lat0 - model.dlat, model.lon0)[3]


def test_beams_that_meet_nothing():
    lat, lon, h = 50.2 * D, 30.3 * D, 700.0
    model = hills(lat, lon)
    H, none = np.empty(6), np.zeros(3)

    def status(height, el, farthest, m=model):
        return kernel.lidar_height_rows(
            lat, lon, height, np.eye(3).ravel(), none, 0.0, el * D, m.grid, m.heights, farthest, WGS84.a, WGS84.e2, H
        )[1]

    assert status(h, -90.0, 1000.0) == kernel.HIT
    assert status(h, -90.0, 150.0) == kernel.BEYOND
    assert status(h, 10.0, 300.0) == kernel.NEVER
    assert status(h, -5.0, 20000.0) == kernel.UNCOVERED
    assert status(-500.0, -90.0, 1000.0) == kernel.NEVER  # the lidar under the ground
    cut = np.where(np.arange(120)[:, None] > 40, np.nan, model.heights)
    holes = HeightModel(model.lat0, model.lon0, model.dlat, model.dlon, cut)
    assert status(h, -90.0, 1000.0, holes) == kernel.UNCOVERED
