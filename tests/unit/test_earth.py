"""The Earth: published constants and gravity, closed forms on the sphere, kernels against the numpy original."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from schuler.ground import earth
from schuler.ground.earth import SPHERE, WGS84, C_en, LocalFrame, sphere, wrap_pi
from schuler.kernels import earth as kernel

DEG = math.pi / 180
LATS = np.array([-90.0, -89.9999, -45.0, -1e-9, 0.0, 36.73, 60.0, 89.0, 90.0]) * DEG


def test_published_constants():
    # NGA.STND.0036: derived constants of the ellipsoid
    assert pytest.approx(6356752.3142, abs=5e-5) == WGS84.b
    assert pytest.approx(6.694379990141e-3, abs=1e-15) == WGS84.e2
    assert pytest.approx(0.001931852652458, abs=1e-11) == WGS84.somigliana_k
    assert pytest.approx(0.00344978650684, abs=1e-14) == WGS84.m
    assert SPHERE.gravity(0.3) == pytest.approx(9.820250487, abs=5e-10)


def test_radii_at_the_papers_latitude():
    R_N, R_E = earth.radii(36.73 * DEG)
    assert R_N == pytest.approx(6358260.995, abs=5e-4)
    assert R_E == pytest.approx(6385786.314, abs=5e-4)
    assert R_N * DEG == pytest.approx(110972.589, abs=5e-4)
    assert R_E * math.cos(36.73 * DEG) * DEG == pytest.approx(89325.410, abs=5e-4)


def test_radii_meet_at_the_poles_and_match_the_axes_at_the_equator():
    R_N, R_E = earth.radii([math.pi / 2, 0.0])
    assert R_N[0] == pytest.approx(R_E[0], rel=1e-15)
    assert R_N[0] == pytest.approx(WGS84.a**2 / WGS84.b, rel=1e-15)
    assert R_E[1] == WGS84.a
    assert R_N[1] == pytest.approx(WGS84.b**2 / WGS84.a, rel=1e-15)


def test_gravity_on_the_ellipsoid():
    assert earth.gravity(0.0) == pytest.approx(9.7803253359, abs=1e-12)
    assert earth.gravity(math.pi / 2) == pytest.approx(9.8321849379, abs=1e-10)
    assert earth.gravity(45 * DEG) == pytest.approx(
        9.806197769, abs=2e-9
    )  # GRS 80 gives 9.80619920, WGS 84 1.4e-6 less


def exact_normal_gravity(lat, h):
    """Gradient of the normal potential, m/s^2; the potential in its closed form (Heiskanen and Moritz, 2-62)."""
    E = WGS84.a * math.sqrt(WGS84.e2)

    def potential(x, z):
        r2 = x * x + z * z
        u2 = 0.5 * (r2 - E * E) * (1 + math.sqrt(1 + 4 * E * E * z * z / (r2 - E * E) ** 2))
        u = math.sqrt(u2)
        sin_beta = z / u
        q = 0.5 * ((1 + 3 * u2 / E**2) * math.atan2(E, u) - 3 * u / E)
        q0 = 0.5 * ((1 + 3 * WGS84.b**2 / E**2) * math.atan2(E, WGS84.b) - 3 * WGS84.b / E)
        w2 = WGS84.omega**2
        return (
            WGS84.gm / E * math.atan2(E, u) + 0.5 * w2 * WGS84.a**2 * q / q0 * (sin_beta**2 - 1 / 3) + 0.5 * w2 * x * x
        )

    x, _, z = WGS84.ecef_from_geodetic(lat, 0.0, h)
    d = 2000.0  # the fourth-order difference errs by (d/R)^4: 1e-14 relative; rounding of the potential is 1e-11

    def slope(ux, uz):
        p = [potential(x + k * d * ux, z + k * d * uz) for k in (-2, -1, 1, 2)]
        return (p[0] - 8 * p[1] + 8 * p[2] - p[3]) / (12 * d)

    return math.hypot(slope(1, 0), slope(0, 1))


@pytest.mark.parametrize("lat_deg", [0.0, 30.0, 50.0, 90.0])
@pytest.mark.parametrize(("h", "tolerance"), [(0.0, 5e-9), (-1000.0, 1.5e-7), (10000.0, 1e-6), (30000.0, 6e-6)])
def test_gravity_with_height_against_the_gradient_of_the_normal_potential(lat_deg, h, tolerance):
    # The height factor leaves out flattening times rotation at first order (1e-10 m/s^2 a metre) and (h/a)^3.
    exact = exact_normal_gravity(lat_deg * DEG, h)
    assert earth.gravity(lat_deg * DEG, h) == pytest.approx(exact, abs=tolerance)


def test_gravity_formula_of_the_contract():
    lat, h = 52.65 * DEG, 1234.5
    f, m, s2 = WGS84.f, WGS84.m, math.sin(lat) ** 2
    factor = 1 - 2 * (1 + f + m - 2 * f * s2) * h / WGS84.a + 3 * h**2 / WGS84.a**2
    assert earth.gravity(lat, h) / earth.gravity(lat) == pytest.approx(factor, rel=1e-15)
    assert_array_equal(earth.gravity_n(lat, h), [0.0, 0.0, earth.gravity(lat, h)])


def test_sphere():
    assert isinstance(SPHERE, earth.Ellipsoid)
    assert_array_equal(np.stack(SPHERE.radii(LATS)), np.full((2, len(LATS)), 6.371e6))
    assert SPHERE.gravity(0.7, 6.371e6) == pytest.approx(SPHERE.gravity(0.0) / 4, rel=1e-15)
    assert SPHERE.gravity(LATS, 0.0).shape == LATS.shape
    assert earth.SCHULER_PERIOD == pytest.approx(5060.8, abs=0.05)
    own = sphere(6378137.0)
    lat, lon, h = own.geodetic_from_ecef(own.ecef_from_geodetic(0.6, -2.0, 77.0))
    assert_allclose([lat, lon, h - 77.0], [0.6, -2.0, 0.0], atol=3e-9)


def test_an_earth_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        WGS84.a = 1.0


def test_earth_rate_points_at_the_pole():
    for lat in LATS:
        w_e = C_en(lat, 0.7) @ earth.earth_rate_n(lat)
        assert_allclose(w_e, [0.0, 0.0, WGS84.omega], atol=1e-19)
    assert earth.earth_rate_n(36.73 * DEG)[2] / DEG == pytest.approx(-0.00249868, abs=5e-9)


def test_transport_rate_is_the_turn_of_the_local_frame():
    """C_en' dC_en/dt = [w_en x] along a moving point, by central differences."""
    lat, lon, h = 0.8, -1.9, 500.0
    v = np.array([37.0, -120.0, 3.0])
    R_N, R_E = earth.radii(lat)
    lat_dot, lon_dot = v[0] / (R_N + h), v[1] / ((R_E + h) * math.cos(lat))
    dt = 2.0
    dC = (C_en(lat + lat_dot * dt, lon + lon_dot * dt) - C_en(lat - lat_dot * dt, lon - lon_dot * dt)) / (2 * dt)
    W = C_en(lat, lon).T @ dC
    assert_allclose([W[2, 1], W[0, 2], W[1, 0]], earth.transport_rate_n(lat, h, v), rtol=0, atol=1e-13)


def test_velocity_is_the_derivative_of_the_ecef_position():
    lat, lon, h, v = -0.4, 3.1, 900.0, np.array([12.0, 31.0, -4.0])
    R_N, R_E = earth.radii(lat)
    rates = np.array([v[0] / (R_N + h), v[1] / ((R_E + h) * math.cos(lat)), -v[2]])
    dt = 5.0
    a, b = (earth.ecef_from_geodetic(*(np.array([lat, lon, h]) + s * dt * rates)) for s in (-1, 1))
    assert_allclose(C_en(lat, lon).T @ (b - a) / (2 * dt), v, atol=2e-8)


def test_C_en_is_a_rotation_with_north_east_down_columns():
    C = C_en(0.0, 0.0)
    assert_array_equal(C, [[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    C = C_en(LATS[:, None], np.array([0.3, -3.0]))
    assert C.shape == (len(LATS), 2, 3, 3)
    assert_allclose(C @ np.swapaxes(C, -1, -2), np.broadcast_to(np.eye(3), C.shape), atol=4e-16)
    assert_allclose(np.linalg.det(C), 1.0, atol=1e-15)


@pytest.mark.parametrize(
    ("xyz", "expected"),
    [
        ((6378137.0, 0, 0), (0, 0, 0)),
        ((0, 6378137.0, 0), (0, math.pi / 2, 0)),
        ((-6378137.0, 0.0, 0), (0, math.pi, 0)),
        ((-6378137.0, -0.0, 0), (0, math.pi, 0)),  # one answer on the date line, whatever the sign of zero
        ((-6378137.0, -1e-300, 0), (0, math.pi, 0)),
        ((-0.0, -0.0, 6356752.314245179), (math.pi / 2, 0, 0)),
        ((0, 0, -6356752.314245179 - 1e7), (-math.pi / 2, 0, 1e7)),
        ((0, 0, 6356752.314245179 - 1e4), (math.pi / 2, 0, -1e4)),
    ],
)
def test_axes_poles_and_date_line(xyz, expected):
    lat, lon, h = earth.geodetic_from_ecef(xyz)
    assert (lat, lon) == (expected[0], expected[1])
    assert h == pytest.approx(expected[2], abs=4e-9)


def test_inverse_is_finite_everywhere_even_at_the_centre():
    points = np.array(
        [[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, -4e4], [2e4, 1e4, 3e4], [1e-300, 0, 6.4e6], [1e12, 0, 1e12]]
    )
    lat, lon, h = earth.geodetic_from_ecef(points)
    assert np.all(np.isfinite([lat, lon, h]))
    assert np.all(np.abs(lat) <= math.pi / 2)


@pytest.mark.parametrize("h", [-5e6, -1e4, -100.0, 0.0, 8848.0, 4e5, 1e7])
def test_round_trip_to_nanometres(h):
    rng = np.random.default_rng(1)
    lat = np.concatenate([LATS, rng.uniform(-math.pi / 2, math.pi / 2, 4000), math.pi / 2 - 10.0 ** -np.arange(1, 16)])
    lon = rng.uniform(-math.pi, math.pi, len(lat))
    lon[:3] = math.pi, -math.pi, 0.0
    r = earth.ecef_from_geodetic(lat, lon, h)
    again = earth.ecef_from_geodetic(*earth.geodetic_from_ecef(r))
    # One unit in the last place of 6.4e6 m is 0.93 nm, of 1.6e7 m 3.7 nm; a longitude near pi holds 2.8 nm.
    assert np.max(np.linalg.norm(again - r, axis=-1)) < (4e-9 if h < 1e6 else 9e-9)
    assert np.max(np.abs(earth.geodetic_from_ecef(r)[2] - h)) < (4e-9 if h < 1e6 else 9e-9)


def test_batch_equals_loop_to_the_bit():
    rng = np.random.default_rng(2)
    r = rng.normal(0, 6e6, (50, 3))
    batch = np.stack(earth.geodetic_from_ecef(r), axis=-1)
    assert_array_equal(batch, [np.stack(earth.geodetic_from_ecef(one)) for one in r])
    assert earth.geodetic_from_ecef(r.reshape(5, 10, 3))[0].shape == (5, 10)


def test_local_frame():
    frame = LocalFrame(50 * DEG, 179.999 * DEG, 120.0)
    assert_allclose(np.stack(frame.ned(50 * DEG, 179.999 * DEG, 120.0)), 0.0, atol=2e-9)
    north, east, down = frame.ned(50 * DEG, -179.999 * DEG, 120.0)  # 0.002 deg east, over the antimeridian
    assert east == pytest.approx((earth.radii(50 * DEG)[1] + 120) * math.cos(50 * DEG) * 0.002 * DEG, rel=1e-9)
    lat, lon, h = frame.geodetic([0.0, 3e5], [-2e3, 4e5], [5.0, -1e4])
    assert_allclose(np.stack(frame.ned(lat, lon, h), -1), [[0.0, -2e3, 5.0], [3e5, 4e5, -1e4]], atol=5e-9)
    assert_allclose(np.stack(WGS84.local(0.1, 0.2).ned(0.1, 0.2, -30.0)), [0, 0, 30.0], atol=2e-9)


def test_local_frame_at_the_pole():
    frame = LocalFrame(math.pi / 2, 0.0)
    lat, lon, h = frame.geodetic(0.0, 1000.0, 0.0)  # "east" at longitude 0 of the pole is along longitude 90 deg
    assert lon == pytest.approx(math.pi / 2, abs=1e-12)  # the cosine of pi/2 in floats is not quite zero
    assert lat == pytest.approx(math.atan2(earth.radii(math.pi / 2)[0], 1000.0), abs=1e-13)


def test_displacement_is_the_small_difference_in_metres():
    R_N, R_E = earth.radii(0.9)
    d = earth.displacement_n(0.9 + 1e-6, 0.2 - 2e-6, 13.0, 0.9, 0.2, 10.0)
    assert_allclose(d, [(R_N + 11.5) * 1e-6, -(R_E + 11.5) * math.cos(0.9) * 2e-6, -3.0], rtol=2e-6)


def test_displacement_over_the_antimeridian_and_antisymmetric():
    a, b = (0.5, math.pi - 1e-5, 3.0), (0.5001, -math.pi + 1e-5, -4.0)
    d = earth.displacement_n(*b, *a)
    assert d[1] == pytest.approx(2e-5 * earth.radii(0.5)[1] * math.cos(0.5), rel=1e-4)
    assert_allclose(earth.displacement_n(*a, *b), -d, atol=1e-8)


@pytest.mark.parametrize("lat_deg", [0.0, 45.0, -60.0])
def test_displacement_length_against_the_tangent_frame(lat_deg):
    azimuth = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    errors = []
    for distance in (1e3, 1e4):
        frame = LocalFrame(lat_deg * DEG, 0.3)
        there = frame.geodetic(distance * np.cos(azimuth), distance * np.sin(azimuth), distance**2 / 2 / 6.37e6)
        d = earth.displacement_n(*there, lat_deg * DEG, 0.3, 0.0)
        errors.append(np.max(np.abs(np.hypot(d[:, 0], d[:, 1]) - distance)))
    assert errors[1] < 0.01
    assert math.log10(errors[1] / errors[0]) == pytest.approx(3.0, abs=0.1)  # third power of the distance


def test_displace_undoes_displacement():
    rng = np.random.default_rng(3)
    lat, lon, h = rng.uniform(-1.4, 1.4, 200), rng.uniform(-math.pi, math.pi, 200), rng.uniform(-1e3, 1e4, 200)
    d = rng.normal(0, 3e3, (200, 3))
    there = earth.displace(lat, lon, h, d)
    assert_allclose(earth.displacement_n(*there, lat, lon, h), d, atol=1e-8)
    assert np.all((there[1] > -math.pi) & (there[1] <= math.pi))


def test_wrap_pi():
    pi = math.pi
    angles = [0.0, pi, -pi, 3 * pi, 7.0, -7.0]
    assert_allclose(wrap_pi(angles), [0, pi, pi, pi, 7 - 2 * pi, 2 * pi - 7])
    assert wrap_pi(1e-300) == 1e-300  # small angles keep every bit


def test_kernels_are_the_numpy_earth():
    for lat in LATS:
        for h in (-1e4, 0.0, 123.0, 1e5):
            assert_allclose(kernel.radii(lat), np.stack(earth.radii(lat)), rtol=4e-16)
            assert kernel.gravity(lat, h) == pytest.approx(float(earth.gravity(lat, h)), rel=4e-16)
            north, down = kernel.earth_rate(lat)
            assert_allclose([north, 0.0, down], earth.earth_rate_n(lat), rtol=4e-16, atol=1e-30)
            assert_allclose(
                kernel.transport_rate(lat, h, 3.0, -8.0), earth.transport_rate_n(lat, h, [3.0, -8.0, 1.0]), rtol=4e-15
            )
