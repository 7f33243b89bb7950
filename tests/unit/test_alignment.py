"""Coarse alignment, its covariance, and what the aligner says."""

import math

import numpy as np
import pytest

from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, euler_from_dcm
from schuler.inertial import alignment
from schuler.inertial.alignment import SensorErrors
from schuler.inertial.alignment_filter import align
from schuler.published.sins_alignment import observed, worst_return
from schuler.truth import trajectories as shapes
from schuler.truth.imu_errors import measure
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0
DEG_PER_H = D / 3600.0
LAT = 50.27 * D
GOOD = ImuModel(
    gyro_arw_deg_per_sqrt_h=0.001, gyro_bias_deg_per_h=0.01, accel_bias_ug=50.0, accel_vrw_mps_per_sqrt_h=0.003
)


def known(m: ImuModel) -> SensorErrors:
    return SensorErrors.of(accel_bias=m.accel_bias, gyro_bias=m.gyro_bias, vrw=m.vrw, arw=m.arw)


def test_two_thousand_random_attitudes_come_back() -> None:
    put_right, by_triad = worst_return(seed=5)
    assert put_right < 1e-14
    assert by_triad < 1e-14


def test_corrected_formula_needs_all_four_quadrants() -> None:
    for psi in np.radians([-170.0, -100.0, -30.0, 0.0, 60.0, 130.0, 179.0]):
        angles = alignment.angles_from_gravity_and_rate(*observed(float(psi), 0.1, -0.2), LAT)
        np.testing.assert_allclose(angles, [psi, 0.1, -0.2], atol=1e-13)


def test_sensitivity_is_the_derivative_of_triad() -> None:
    rpy = np.array([-0.3, 0.4, 2.0])
    C = np.asarray(dcm_from_euler(*rpy))
    g = 9.81
    f, w = C.T @ [0, 0, -g], C.T @ (7.292115e-5 * np.array([math.cos(LAT), 0.0, -math.sin(LAT)]))
    J = alignment.rpy_from_phi(rpy) @ alignment.coarse_sensitivity(C, LAT, g)
    for k in range(6):
        e = np.zeros(6)
        e[k] = 1e-4 if k < 3 else 1e-10
        plus = euler_from_dcm(alignment.triad(f + e[:3], w + e[3:]))
        minus = euler_from_dcm(alignment.triad(f - e[:3], w - e[3:]))
        np.testing.assert_allclose((np.array(plus) - np.array(minus)) / (2 * e[k]), J[:, k], rtol=1e-6, atol=1e-5)


def test_thesis_sensitivity_is_the_derivative_of_its_corrected_formula() -> None:
    psi = 0.7
    g_b, w_b = observed(psi, 0.0, 0.0)
    g = 9.81
    for k in range(6):
        e = np.zeros(6)
        e[k] = 1e-6
        dg, dw = e[:3], e[3:] * 1e-6
        got = alignment.angles_from_gravity_and_rate(g_b + dg * g, w_b + dw, LAT)[0]
        # (2.9) takes |g| from the sensors here; the formula with a known |g| has the dg_z term of (2.13)
        want = alignment.thesis_sensitivity(psi, LAT, dw, dg)
        if k != 2:
            assert got - psi == pytest.approx(want, rel=1e-3, abs=1e-11)


def test_heading_floor_of_the_catalogue() -> None:
    from schuler.truth.catalogue import GYROS

    floor = {g.name: math.degrees(float(alignment.heading_floor(g.random_deg_per_h * DEG_PER_H, LAT)))
             for g in GYROS if g.random_deg_per_h}  # fmt: skip
    assert floor["VG951"] == pytest.approx(0.1013, abs=1e-4)
    assert floor["LG-8028"] == pytest.approx(0.0179, abs=1e-4)
    assert floor["RVG-1M"] > 29.0


def test_monte_carlo_covariance_is_the_analytic_one() -> None:
    """2000 draws: each variance within the bounds of its chi-square (0.1 %)."""
    rpy = np.array([0.05, -0.1, 1.2])
    C = np.asarray(dcm_from_euler(*rpy))
    g, a, w = 9.81, 5e-4, 0.01 * DEG_PER_H
    rng = np.random.default_rng(11)
    n = 2000
    f = C.T @ [0, 0, -g] + a * rng.standard_normal((n, 3))
    rate = C.T @ (7.292115e-5 * np.array([math.cos(LAT), 0, -math.sin(LAT)])) + w * rng.standard_normal((n, 3))
    error = np.column_stack(euler_from_dcm(alignment.triad(f, rate))) - rpy
    claimed = alignment.coarse_covariance(C, rpy, LAT, a, w, g)
    sample = error.T @ error / n
    np.testing.assert_allclose(np.diag(sample) / np.diag(claimed), 1.0, atol=3.3 * math.sqrt(2.0 / n))
    corr = [m[0, 2] / math.sqrt(m[0, 0] * m[2, 2]) for m in (sample, claimed)]
    assert corr[0] == pytest.approx(corr[1], abs=0.08)


@pytest.mark.parametrize("sways", [False, True])
def test_gyrocompassing_reaches_the_floor_of_a_hundredth_degree_gyro(sways: bool) -> None:
    base = shapes.rest(LAT, 0.5, 100.0, roll=-3 * D, pitch=5 * D, heading=30 * D, duration=600.0)
    if sways:
        base = base.with_waves(
            ("roll", 3 * D, 0.12, 0.3), ("pitch", 2 * D, 0.17, 1.0), ("heading", D, 0.09, 2.0), ("speed", 0.02, 0.11, 0)
        )
    ideal = base.ideal(25.0, every=25)
    misses = []
    for run in range(4):
        imu = measure(ideal, GOOD, seed=3, run=run).table()
        found = align(
            imu, known(GOOD), lat=LAT, lon=0.5, height=100.0, start=0.0, to=600.0, sway_m=0.05 if sways else 0.003
        )
        floor = float(alignment.heading_floor(0.01 * DEG_PER_H, LAT))
        assert found.floor == pytest.approx(floor)
        assert found.std[2] < 1.25 * floor
        assert found.useful is not None
        assert found.useful < 600.0
        misses.append((found.rpy - ideal.truth.rpy[-1]) / found.std)
    assert np.abs(misses).max() < 4.0
    assert np.abs(misses).max() > 0.05  # the sigma is not a mere upper bound


def test_a_poor_gyro_is_called_poor_and_the_level_is_still_found() -> None:
    poor = ImuModel(gyro_bias_deg_per_h=300.0, accel_bias_ug=1000.0, gyro_arw_deg_per_sqrt_h=0.3)
    base = shapes.rest(LAT, 0.5, roll=0.1, pitch=-0.2, heading=1.0, duration=60.0)
    imu = measure(base.ideal(50.0), poor, seed=1).table()
    found = align(imu, known(poor), lat=LAT, start=0.0, to=60.0)
    assert any("too poor to find north" in n for n in found.notes)
    assert found.std[2] > 90 * D
    assert np.abs(found.rpy[:2] - [0.1, -0.2]).max() < 4.0 * 1e-3
    given = align(imu, known(poor), lat=LAT, start=0.0, to=60.0, heading=1.0, heading_std=0.02)
    assert given.rpy[2] == 1.0
    assert given.std[2] == pytest.approx(0.02)


def test_the_first_still_stretch_is_found() -> None:
    """Moving, then still for 40 s, then moving."""
    path = shapes.legs(0.7, 0.1, speed=0.0, heading=0.0, duration=100.0)
    ideal = path.ideal(50.0)
    t = ideal.time
    shake = np.where((t > 20.0) & (t <= 60.0), 0.0, 1.0)[:, None]
    rng = np.random.default_rng(2)
    dtheta = ideal.dtheta + (shake * 0.2 + 1e-4) * rng.standard_normal((len(t), 3)) * ideal.dt
    dv = ideal.dv + (shake * 1.0 + 5e-3) * rng.standard_normal((len(t), 3)) * ideal.dt
    start, to = alignment.find_still(t, dtheta, dv, np.full(len(t), ideal.dt))
    assert start == pytest.approx(20.0, abs=0.6)
    assert to == pytest.approx(60.0, abs=0.6)
    with pytest.raises(InputError, match="no still stretch"):
        rocking = 0.3 * np.sin(2.0 * t[:900, None]) * np.ones(3) * ideal.dt
        alignment.find_still(t[:900], dtheta[:900] + rocking, dv[:900], np.full(900, ideal.dt))


def test_alignment_at_a_pole_is_refused() -> None:
    with pytest.raises(InputError, match="pole"):
        alignment.triad([0.0, 0.0, -9.8], [0.0, 0.0, -7.29e-5])
