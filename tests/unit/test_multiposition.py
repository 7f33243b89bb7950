"""Bias, scale, misalignment from gravity and turns: simulated with known errors, and the real recordings."""

import gzip
import json

import numpy as np
import pytest

from schuler.calibration.gyros import Turn, fit_gyros, gyro_bias, smooth_bias, turns_between
from schuler.calibration.multiposition import accel_matrix, fit_accelerometers, rms
from schuler.calibration.rests import find_rests
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler

G = 9.81
RATE = 100.0
K_A = np.array([[1.004, 0.003, -0.006], [0.0, 0.996, 0.002], [0.0, 0.0, 1.007]])
B_A = np.array([0.1, -0.2, 0.3])
K_G = np.array([[1.01, 0.004, -0.003], [0.005, 0.99, 0.006], [-0.007, 0.002, 1.005]])
B_G = np.array([0.02, -0.01, 0.005])


def turn_about(axis, angle):
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def recording(count=16, noise=1.0, seed=3, rest_s=4.0, turn_s=1.0, aligned=False):
    """(time, force, gyro, axes and angles of the turns): rests joined by turns about fixed axes."""
    rng = np.random.default_rng(seed)
    C = dcm_from_euler(0.2, 0.1, 0.0).T if not aligned else np.eye(3)  # body from navigation
    f, w, turns = [], [], []
    for k in range(count):
        n = int(rest_s * RATE)
        f += [C @ [0.0, 0.0, G]] * n
        w += [np.zeros(3)] * n
        if k == count - 1:
            break
        axis = np.eye(3)[(0, 0, 0, 2, 1, 1, 2)[k]] if aligned else rng.standard_normal(3)
        axis = axis / np.linalg.norm(axis)
        angle = np.pi / 2 if aligned else rng.uniform(0.6, 1.8)
        n = int(turn_s * RATE)
        turns.append((axis, angle))
        for _ in range(n):
            half = turn_about(axis, -angle / n / 2)
            f.append(half @ C @ [0.0, 0.0, G])
            C = turn_about(axis, -angle / n) @ C
            w.append(axis * angle / n * RATE)
    f, w = np.array(f), np.array(w)
    f = f @ K_A.T + B_A + noise * 0.02 * rng.standard_normal(f.shape)
    w = w @ K_G.T + B_G + noise * 0.002 * rng.standard_normal(w.shape)
    return np.arange(1, len(f) + 1) / RATE, f, w, turns


def test_rests_are_found():
    time, f, w, _ = recording()
    rests = find_rests(time, f, w)
    assert len(rests) == 16
    assert all(abs(r.length - 4.0) < 0.5 for r in rests)


def test_rests_upside_down_to_each_other_are_two():
    rng = np.random.default_rng(0)
    f = np.repeat([[0.0, 0.0, G], [0.0, 0.0, -G], [0.0, G, 0.0]], 400, axis=0) + 0.02 * rng.standard_normal((1200, 3))
    w = 0.002 * rng.standard_normal(f.shape)
    assert len(find_rests(np.arange(1200) / RATE, f, w)) == 3


def test_known_errors_come_back_without_noise():
    time, f, w, _ = recording(noise=0.0)
    rests = find_rests(time, f, w)
    accel = fit_accelerometers(rests, G)
    K, b = accel_matrix(accel)
    assert K == pytest.approx(K_A, abs=1e-5)
    assert b == pytest.approx(B_A, abs=1e-4)
    gyro, _ = fit_gyros(time, w, f, rests, turns_between(rests), accel, holdout=False)
    assert accel_matrix(gyro)[0] == pytest.approx(K_G, abs=2e-4)
    assert np.rad2deg(rms(gyro.residuals)) < 0.02
    assert gyro_bias(rests)[0] == pytest.approx(B_G, abs=1e-6)


def test_sigmas_are_honest():
    pulls = []
    for seed in range(8):
        time, f, w, _ = recording(seed=seed)
        accel = fit_accelerometers(find_rests(time, f, w), G, holdout=False)
        K, b = accel_matrix(accel)
        error = np.concatenate([b - B_A, np.diag(K - K_A), (K - K_A)[np.triu_indices(3, 1)]])
        pulls.append(error / accel.std)
    assert 0.7 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_holdout_says_more_than_the_residual():
    time, f, w, _ = recording()
    accel = fit_accelerometers(find_rests(time, f, w), G)
    assert rms(accel.residuals) < rms(accel.holdout) < 0.01
    assert rms(accel.before) > 0.1


def test_six_aligned_positions_see_no_misalignment():
    rests = []
    rng = np.random.default_rng(0)
    from schuler.calibration.rests import Rest

    for k in range(12):
        up = np.zeros(3)
        up[k % 3] = G * (1 if k % 6 < 3 else -1)
        f = K_A @ up + B_A + 0.002 * rng.standard_normal(3)
        rests.append(Rest(k * 100, k * 100 + 90, float(k), k + 0.9, f, B_G, np.full(3, 0.02)))
    accel = fit_accelerometers(rests, G)
    seen = dict(zip(accel.names, accel.observable, strict=True))
    assert all(seen[n] for n in ("bias_x", "scale_x", "bias_z", "scale_z"))
    assert not any(seen[n] for n in ("misalignment_xy", "misalignment_xz", "misalignment_yz"))
    assert np.isnan(accel.std[-1]) and np.isinf(accel.condition)
    assert accel.value("scale_z") == pytest.approx(0.007, abs=5e-4)


def test_known_directions_give_the_full_matrix():
    rng = np.random.default_rng(1)
    up = rng.standard_normal((14, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    full = K_A + np.array([[0, 0, 0], [0.004, 0, 0], [-0.003, 0.002, 0]])
    from schuler.calibration.rests import Rest

    rests = [
        Rest(k * 100, k * 100 + 90, float(k), k + 0.9, full @ (G * u) + B_A, B_G, np.full(3, 0.02))
        for k, u in enumerate(up)
    ]
    accel = fit_accelerometers(rests, G, form="full", up=up)
    assert accel_matrix(accel)[0] == pytest.approx(full, abs=1e-6)
    with pytest.raises(InputError, match="needs the direction of up"):
        fit_accelerometers(rests, G, form="full")


def test_biases_that_follow_the_temperature():
    from schuler.calibration.rests import Rest

    rng = np.random.default_rng(4)
    rests = []
    for k in range(24):
        u = rng.standard_normal(3)
        warm = 20.0 + 0.5 * k
        f = K_A @ (G * u / np.linalg.norm(u)) + B_A + np.array([2e-3, -1e-3, 3e-3]) * warm
        f += 1e-4 * rng.standard_normal(3)
        rests.append(Rest(k * 100, k * 100 + 90, float(k), k + 0.9, f, B_G, np.full(3, 0.02), warm))
    accel = fit_accelerometers(rests, G, temperature=True, holdout=False)
    drift = [accel.value(f"bias_{a}_per_degC") for a in "xyz"]
    assert drift == pytest.approx([2e-3, -1e-3, 3e-3], abs=1e-4)


def test_turns_of_known_angle_give_the_scale():
    time, f, w, turns = recording(count=8, aligned=True)
    rests = find_rests(time, f, w)
    accel = fit_accelerometers(rests, G, holdout=False)
    n = int(4 * RATE), int(RATE)
    starts = [n[0] + k * (n[0] + n[1]) - 20 for k in range(7)]
    known = [Turn(s, s + n[1] + 40, 0, 0, axis, angle) for s, (axis, angle) in zip(starts, turns, strict=True)]
    gyro, told = fit_gyros(time, w, f, rests, [], accel, known=known, holdout=False)
    assert np.diag(accel_matrix(gyro)[0]) == pytest.approx(np.diag(K_G), abs=5e-4)
    assert [np.linalg.norm(x) for _, x in told] == pytest.approx([np.pi / 2] * 7, abs=2e-3)


def test_g_sensitivity_from_the_rests():
    time, f, w, _ = recording(count=20, noise=0.2)
    S = 1e-4 * np.array([[1.0, -2.0, 0.5], [0.0, 1.5, -1.0], [2.0, 0.0, -0.5]])
    true = np.linalg.solve(K_A, (f - B_A).T).T
    w = w + true @ S.T
    rests = find_rests(time, f, w)
    accel = fit_accelerometers(rests, G, holdout=False)
    gyro, _ = fit_gyros(time, w, f, rests, turns_between(rests), accel, g_sensitivity=True, holdout=False)
    found = gyro.values[9:].reshape(3, 3)
    assert found == pytest.approx(S, abs=1e-5)


def test_bias_is_smoothed_as_much_as_it_is_noisy():
    time, f, w, _ = recording()
    rests = find_rests(time, f, w)
    rates = np.array([r.rate for r in rests])
    assert smooth_bias(rests, rates).std(axis=0).max() <= rates.std(axis=0).max()
    drifting = rates + 0.001 * np.arange(len(rests))[:, None]
    assert smooth_bias(rests, drifting)[:, 0] == pytest.approx(drifting[:, 0], abs=2e-4)


def test_too_few_positions():
    time, f, w, _ = recording(count=3)
    with pytest.raises(InputError, match="different positions are too few"):
        fit_accelerometers(find_rests(time, f, w), G)


# ---- real recordings ----


@pytest.mark.data
@pytest.mark.parametrize("unit", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_mpu9150(data_folder, unit):
    with gzip.open(data_folder / "calib_mpu9150_rotations" / f"imu{unit}.log.gz") as file:
        data = np.loadtxt(file)
    f, w = data[:, :3], np.ascontiguousarray(data[:, 3:])
    time = np.arange(1, len(f) + 1) / 100.0
    rests = find_rests(time, f, w)
    accel = fit_accelerometers(rests, 9.82)
    assert len(rests) >= 15
    assert rms(accel.before) > 0.05
    assert np.isfinite(accel.holdout).sum() >= 15
    assert rms(accel.holdout) < 0.005
    gyro, _ = fit_gyros(time, w, f, rests, turns_between(rests), accel, holdout=unit == 1)
    assert np.rad2deg(rms(gyro.residuals)) < 0.10
    assert rms(gyro.residuals) < 0.5 * rms(gyro.before)
    assert accel.observable.all() and gyro.observable.all()
    if unit == 1:
        assert np.rad2deg(rms(gyro.holdout)) < 0.15


@pytest.mark.slow
@pytest.mark.data
def test_shimmer_ferraris(data_folder):
    folder = data_folder / "calib_ferraris_shimmer"
    with gzip.open(folder / "example_ferraris_session.csv.gz") as file:
        data = np.loadtxt(file, delimiter=",", skiprows=1)
    parts = json.loads((folder / "example_ferraris_session_list.json").read_text())
    w, f = np.deg2rad(data[:, 1:4]), data[:, 4:7]
    time = np.arange(1, len(f) + 1) / 102.4
    rests = find_rests(time, f, w)
    accel = fit_accelerometers(rests, 9.80665)
    assert rms(accel.before) > 0.5
    assert np.abs(accel.residuals).max() < 0.012
    known = [
        Turn(parts[f"{a}_rot"]["start"], parts[f"{a}_rot"]["end"], 0, 0, np.eye(3)[i], -2 * np.pi)
        for i, a in enumerate("xyz")
    ]
    _, told = fit_gyros(time, w, f, rests, turns_between(rests), accel, known=known, holdout=False)
    raw = [np.rad2deg(np.sum((w - gyro_bias(rests)[0])[t.first : t.last, i]) / 102.4) for i, t in enumerate(known)]
    assert raw == pytest.approx([-370.0, -354.0, -359.0], abs=1.0)
    after = [np.rad2deg(x[i]) for i, (_, x) in enumerate(told)]
    assert after == pytest.approx([-360.0] * 3, abs=0.5)
