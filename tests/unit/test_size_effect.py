"""The size effect: (4.1)-(4.4), what rectifies and what compensation leaves."""

import numpy as np
import pytest

from schuler.calibration.size_effect import (
    Accelerometers,
    angular_acceleration,
    compensate,
    next_correlation,
    noise_residual,
    rectified,
    sensed,
    tangential,
    vibration_velocity,
    warning,
)
from schuler.ground.errors import InputError
from schuler.truth.vibration import Vibration

TRIAD = Accelerometers.triad([[0.04, 0.02, -0.03], [-0.02, 0.05, 0.02], [0.03, -0.025, 0.035]])
DT = 5e-4


def in_fixed_axes(C, A):
    return np.einsum("nij,nj->i", C, A) * DT


def planar(second, variant=None, nu=10.0):
    time = (np.arange(120_000) + 0.5) * DT
    C, w, wd = Vibration.tone(nu, (0.0, 0.0, 1e-3)).motion(time)
    where = Accelerometers.triad([[0.05, 0.0, 0.0], [*second, 0.0], [0.0, 0.0, 0.0]])
    A = sensed(np.zeros_like(w), w, wd, where)
    if variant:
        A = compensate(A, w, DT, where, variant=variant)
    return A.sum(axis=0) * DT, in_fixed_axes(C, A)


def test_sensed_is_the_second_derivative_of_the_place():
    v = Vibration.band(1.0, 5.0, 0.05, tones=5, seed=3)
    h, t = 1e-4, np.array([0.7])
    places = [v.motion(t + k * h)[0][0] @ TRIAD.positions.T for k in (-1, 0, 1)]
    C, w, wd = v.motion(t)
    acceleration = C[0].T @ ((places[0] - 2 * places[1] + places[2]) / h**2)  # (3, n) in b
    expected = np.einsum("in,ni->n", acceleration, TRIAD.directions)
    assert sensed(np.zeros((1, 3)), w, wd, TRIAD)[0] == pytest.approx(expected, abs=2e-6)


def test_any_number_of_accelerometers_with_their_own_directions():
    e = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [1.0, 1.0, 1.0]])
    where = Accelerometers(np.arange(12.0).reshape(4, 3) * 0.01, e)
    assert np.linalg.norm(where.directions[3]) == pytest.approx(1.0)
    f = np.array([[0.3, -0.2, 9.8]])
    still = sensed(f, np.zeros((1, 3)), np.zeros((1, 3)), where)
    assert where.to_force @ still[0] == pytest.approx(f[0], abs=1e-12)


@pytest.mark.parametrize(("nu", "value"), [(10.0, 5.921763e-3), (20.0, 2.368705e-2), (40.0, 9.474820e-2)])
def test_rectified_velocity_to_seven_digits(nu, value):
    assert float(-vibration_velocity(1e-3, nu, 60.0, 0.05)) == pytest.approx(value, rel=1e-7, abs=5e-10)
    body, _ = planar((0.0, 0.0), nu=nu)
    assert -body[0] == pytest.approx(value, rel=1.5e-7)  # seven digits; the sum over whole periods is exact


def test_equal_places_rectify_nothing():
    assert np.linalg.norm(planar((0.05, 0.0))[1]) < 1e-14


def test_rate_only_makes_it_worse_and_full_does_not():
    assert planar((0.05, 0.02))[1][:2] == pytest.approx([0.0, -2.3687e-3], abs=1e-6)
    assert planar((0.05, 0.02), "rate-only")[1][:2] == pytest.approx([5.9218e-3, 0.0], abs=1e-6)
    assert np.abs(planar((0.05, 0.02), "full")[1]).max() < 4e-8
    S = np.diag([0.0, 0.0, 0.5 * (2 * np.pi * 10.0 * 1e-3) ** 2])
    where = Accelerometers.triad([[0.05, 0, 0], [0.05, 0.02, 0], [0, 0, 0]])
    assert "makes x worse" in warning(S, where)
    own_axis = Accelerometers.triad([[0.05, 0, 0], [0, 0.02, 0], [0, 0, 0.01]])
    assert warning(S, own_axis) is None


def test_closed_form_of_rectification_is_what_a_simulation_gives():
    v = Vibration.band(10.0, 80.0, (2e-3, 1e-3, 3e-3), seed=5)
    time = (np.arange(60_000) + 0.5) * DT
    C, w, wd = v.motion(time)
    A = sensed(np.zeros_like(w), w, wd, TRIAD)
    body, fixed = rectified(w.T @ w / len(w), TRIAD)
    ends = tangential(wd.mean(axis=0), TRIAD)[0]  # of a rate that does not end where it began
    assert A.mean(axis=0) - ends == pytest.approx(body, rel=1e-9)
    assert in_fixed_axes(C, A) / (len(w) * DT) - ends == pytest.approx(fixed, abs=0.03 * np.linalg.norm(fixed))
    assert rectified(v.rate_covariance, TRIAD)[1] == pytest.approx(fixed, abs=0.03 * np.linalg.norm(fixed))


def test_a_minute_of_broad_vibration_is_compensated_to_a_percent():
    v = Vibration.band(10.0, 80.0, 2e-3, seed=4)
    time = (np.arange(120_000) + 0.5) * DT
    C, w, wd = v.motion(time)
    A = sensed(np.zeros_like(w), w, wd, TRIAD)
    raw = np.linalg.norm(in_fixed_axes(C, A))
    left = np.linalg.norm(in_fixed_axes(C, compensate(A, w, DT, TRIAD)))
    assert raw > 2.0
    assert left < 0.01 * raw
    assert np.linalg.norm(in_fixed_axes(C, compensate(A, w, DT, TRIAD, variant="rate-only"))) > 0.05 * raw


@pytest.mark.parametrize("bandwidth", [300.0, *(pytest.param(x, marks=pytest.mark.slow) for x in (None, 100.0))])
def test_residual_of_gyro_noise_is_the_predicted_one(bandwidth):
    from scipy.signal import lfilter

    sigma = np.array([0.10, 0.06, 0.14])
    rate, n, runs = 2000.0, 60_000, 12
    r = 0.0 if bandwidth is None else next_correlation(bandwidth, rate)
    rng = np.random.default_rng(11)
    still = np.zeros((n, 3))
    found = np.zeros(3)
    for _ in range(runs):
        noise = rng.standard_normal((n, 3))
        noise = sigma * lfilter([np.sqrt(1 - r * r)], [1.0, -r], noise, axis=0)[: len(noise)]
        A = compensate(still, noise, DT, TRIAD)
        turn = np.cumsum(noise, axis=0) * DT - 0.5 * DT * noise  # the attitude that these gyros give
        found += (A + np.cross(turn, A)).mean(axis=0) / runs
    expected = noise_residual(sigma, TRIAD, next_correlation=r)
    assert np.linalg.norm(found - expected) < 0.2 * np.linalg.norm(expected)


def test_a_noisy_axis_leaves_sigma_squared_rho():
    where = Accelerometers.triad([[0.05, 0, 0], [0, 0, 0], [0, 0, 0]])
    left = 60.0 * noise_residual((0.0, 0.0, 1e-2), where, attitude_from_gyros=False)
    assert left == pytest.approx([3.0e-4, 0.0, 0.0])


@pytest.mark.parametrize(("method", "order"), [("five-point", 4), ("central", 2), ("backward", 1)])
def test_differences_have_their_order(method, order):
    def worst(dt):
        t = np.arange(0.0, 1.0, dt)[:, None] * np.ones(3)
        return np.abs(angular_acceleration(np.sin(9 * t), dt, method=method)[5:-5] - 9 * np.cos(9 * t)[5:-5]).max()

    assert np.log2(worst(2e-3) / worst(1e-3)) == pytest.approx(order, abs=0.1)


def test_a_late_gyro_is_moved_back():
    t = np.arange(0.0, 2.0, 1e-3)
    late = np.column_stack([np.sin(30 * (t - 0.004))] * 3)
    wd = angular_acceleration(late, 1e-3, gyro_delay=0.004)
    assert wd[50:-50, 0] == pytest.approx(30 * np.cos(30 * t[50:-50]), abs=2e-3)
    assert np.abs(angular_acceleration(late, 1e-3)[50:-50, 0] - 30 * np.cos(30 * t[50:-50])).max() > 3.0


def test_directions_in_a_plane_are_told():
    flat = Accelerometers(np.zeros((3, 3)), [[1.0, 0, 0], [0, 1.0, 0], [1.0, 1.0, 0]])
    with pytest.raises(InputError, match="one plane"):
        flat.to_force  # noqa: B018
