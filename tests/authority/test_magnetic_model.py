"""The World Magnetic Model against NOAA's published test values and against pygeomag (skipped where it is absent)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.ground.earth import wrap_pi
from schuler.ground.fields import declination, magnetic_field

DEG = np.pi / 180
NT = 1e-9

# NOAA/NCEI, test values of WMM2025 as published with the model: year, height km, lat, lon, X, Y, Z nT, D deg
ROUND = [
    (2025.0, 0, 80, 0, 6521.6, 145.9, 54791.5, 1.28),
    (2025.0, 0, 0, 120, 39677.8, -109.6, -10580.2, -0.16),
    (2025.0, 0, -80, 240, 6117.5, 15751.9, -52022.5, 68.78),
    (2025.0, 100, 80, 0, 6216.0, 92.4, 52598.8, 0.85),
    (2025.0, 100, 0, 120, 37688.6, -96.2, -10152.1, -0.15),
    (2025.0, 100, -80, 240, 5907.6, 14780.3, -49540.7, 68.21),
    (2027.5, 0, 80, 0, 6500.8, 294.5, 54869.4, 2.59),
    (2027.5, 0, 0, 120, 39701.6, -167.4, -10381.8, -0.24),
    (2027.5, 0, -80, 240, 6200.7, 15730.3, -51783.7, 68.49),
    (2027.5, 100, 80, 0, 6196.7, 233.8, 52670.5, 2.16),
    (2027.5, 100, 0, 120, 37711.5, -148.7, -9969.8, -0.23),
    (2027.5, 100, -80, 240, 5984.0, 14760.1, -49317.7, 67.93),
]
# The same with six decimals. Y and Z agree to 2e-6 nT; the published X is up to 4.5e-4 nT off ours and pygeomag's.
FINE = [
    (2025.0, 28, 89, -121, -255.388723, -1482.460628, 56194.288771, -99.77),
    (2025.0, 65, 43, 93, 24299.852822, 210.517066, 50037.923998, 0.50),
    (2025.0, 51, -33, 109, 21737.778822, -2090.274098, -52710.00392, -5.49),
    (2025.5, 6, -36, -137, 23781.930678, 8786.698927, -32577.518648, 20.28),
    (2025.5, 8, -66, 17, 15201.438652, -9925.501123, -30881.123197, -33.14),
    (2026.0, 74, -57, 3, 13268.119649, -5498.179626, -23576.062921, -22.51),
    (2026.0, 62, -14, 99, 33437.82863, -835.919473, -33100.922253, -1.43),
    (2026.5, 14, 0, 80, 39431.415992, -2133.456168, -12188.838466, -3.10),
    (2027.0, 37, -66, -5, 16390.771268, -5079.626554, -28608.243575, -17.22),
    (2027.5, 73, -72, 95, -2912.418045, -12984.118939, -55399.217725, -102.64),
]


@pytest.mark.parametrize(("rows", "field_nt"), [(ROUND, 0.0501), (FINE, 1e-3)], ids=["report", "six decimals"])
def test_published_values(rows, field_nt):
    year, km, lat, lon, X, Y, Z, D = np.array(rows).T
    B_n = magnetic_field(lat * DEG, lon * DEG, km * 1e3, year)
    assert_allclose(B_n / NT, np.column_stack([X, Y, Z]), rtol=0, atol=field_nt)
    assert_allclose(declination(lat * DEG, lon * DEG, km * 1e3, year) / DEG, D, rtol=0, atol=0.00501)


def test_the_value_to_four_decimals():
    B_n = magnetic_field(80 * DEG, 0.0, 0.0, 2025.0)
    assert_allclose(B_n / NT, [6521.5994, 145.8870, 54791.508], rtol=0, atol=5e-4)


def points(n=400):
    """Random ones, then every corner: poles, equator, antimeridian from both sides; -10 to 100 km, all five years."""
    rng = np.random.default_rng(25)
    lat, lon = rng.uniform(-90, 90, n), rng.uniform(-180, 180, n)
    h, year = rng.uniform(-10e3, 100e3, n), rng.uniform(2025.0, 2030.0, n)
    corners = [(a, b) for a in (-90, 90, 0, 89.9999, -89.9999, 1e-9) for b in (-180, 180, 0, 359.0, -77.3)]
    lat, lon = (np.concatenate([x, c]) for x, c in zip((lat, lon), np.array(corners, dtype=float).T, strict=True))
    k = len(corners)
    ends = np.resize([[0.0, 2025.0], [100e3, 2030.0], [100e3, 2025.0]], (k, 2))
    return lat, lon, np.concatenate([h, ends[:, 0]]), np.concatenate([year, ends[:, 1]])


def test_against_pygeomag():
    model = pytest.importorskip("pygeomag").GeoMag(coefficients_file="wmm/WMM_2025.COF")
    lat, lon, h, year = points()
    found = [model.calculate(glat=a, glon=b, alt=c / 1e3, time=t) for a, b, c, t in zip(lat, lon, h, year, strict=True)]
    B_n = magnetic_field(lat * DEG, lon * DEG, h, year)
    assert_allclose(B_n / NT, [[r.x, r.y, r.z] for r in found], rtol=0, atol=1e-5)
    ours = declination(lat * DEG, lon * DEG, h, year)
    assert_allclose(wrap_pi(ours - np.array([r.d for r in found]) * DEG), 0.0, atol=1e-9)


def test_poles_and_antimeridian_are_no_seams():
    """The field is one vector at a pole whatever longitude names its north, and the same at 180 E and 180 W."""
    lon = np.linspace(-np.pi, np.pi, 13)
    for lat, sign in ((np.pi / 2, 1.0), (-np.pi / 2, -1.0)):
        N, E, D = magnetic_field(lat, lon, 0.0, 2026.3).T
        # towards 0 E and 90 E; at the north pole north at longitude l points to l + 180 deg, at the south pole to l
        x = -sign * N * np.cos(lon) - E * np.sin(lon)
        y = -sign * N * np.sin(lon) + E * np.cos(lon)
        for value in (x, y, D):
            assert_allclose(value / NT, value[0] / NT, rtol=0, atol=1e-7)
        close = magnetic_field(lat - sign * 1e-9, lon, 0.0, 2026.3)
        assert_allclose(close / NT, np.column_stack([N, E, D]) / NT, rtol=0, atol=1e-3)
    west, east = magnetic_field(0.3, -np.pi, 0.0, 2026.3), magnetic_field(0.3, np.pi, 0.0, 2026.3)
    assert_allclose(west / NT, east / NT, rtol=0, atol=1e-9)


def test_the_field_has_no_sources_and_no_curl_outside_the_core():
    """Differences in ECEF: divergence and curl vanish, which no error in a rotation or a Legendre function survives."""
    from schuler.ground.earth import C_en, ecef_from_geodetic, geodetic_from_ecef

    step = 2e3

    def B_e(r_e):
        lat, lon, h = geodetic_from_ecef(r_e)
        return np.einsum("...ij,...j->...i", C_en(lat, lon), magnetic_field(lat, lon, h, 2028.0))

    for lat, lon in ((0.7, 0.2), (-1.2, 2.9), (1.5, -2.0)):
        r_e = ecef_from_geodetic(lat, lon, 5e3)
        J = np.array([(B_e(r_e + d) - B_e(r_e - d)) / (2 * step) for d in step * np.eye(3)]).T
        size = np.abs(J).max()
        assert abs(np.trace(J)) < 1e-6 * size
        assert np.abs(J - J.T).max() < 1e-6 * size
