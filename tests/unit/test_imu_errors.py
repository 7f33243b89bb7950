"""An ImuModel on exact increments: each error as its datasheet says, the same numbers for the same run."""

import math

import numpy as np
import pytest

from schuler.truth import trajectories as shapes
from schuler.truth.catalogue import ACCELEROMETERS, GRADES, GYROS, imu_of
from schuler.truth.imu_errors import measure
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0
STILL = shapes.rest(0.8, 0.3, duration=400.0).ideal(50.0)
MOVING = (
    shapes.rest(0.8, 0.3, duration=60.0).with_waves(("roll", 0.3, 0.4, 0.0), ("heading", 0.5, 0.3, 1.0)).ideal(200.0)
)


def test_no_error_changes_nothing() -> None:
    m = measure(STILL, ImuModel())
    assert np.array_equal(m.dtheta, STILL.dtheta)
    assert np.array_equal(m.dv, STILL.dv)


def test_same_seed_and_run_same_bytes_and_new_errors_disturb_nothing() -> None:
    model = ImuModel(gyro_arw_deg_per_sqrt_h=0.1, accel_vrw_mps_per_sqrt_h=0.1, gyro_bias_deg_per_h=1.0)
    a, b = measure(STILL, model, seed=4, run=2), measure(STILL, model, seed=4, run=2)
    assert np.array_equal(a.dtheta, b.dtheta)
    assert not np.array_equal(a.dtheta, measure(STILL, model, seed=4, run=3).dtheta)
    more = ImuModel(
        gyro_arw_deg_per_sqrt_h=0.1, accel_vrw_mps_per_sqrt_h=0.1, gyro_bias_deg_per_h=1.0, accel_bias_ug=100.0
    )
    assert np.array_equal(measure(STILL, more, seed=4, run=2).dtheta, a.dtheta)


def test_white_noise_has_the_size_of_its_random_walk() -> None:
    model = ImuModel(gyro_arw_deg_per_sqrt_h=0.3, accel_vrw_mps_per_sqrt_h=0.06)
    m = measure(STILL, model, seed=1)
    n = len(STILL.time)
    for got, ideal, walk in ((m.dtheta, STILL.dtheta, 0.3 * D / 60), (m.dv, STILL.dv, 0.06 / 60)):
        std = (got - ideal).std(axis=0) / math.sqrt(STILL.dt)
        np.testing.assert_allclose(std, walk, rtol=4.0 / math.sqrt(2 * n))


def test_bias_scale_and_misalignment_follow_the_measured_model() -> None:
    model = ImuModel(
        gyro_scale_ppm=1000.0, accel_scale_ppm=500.0, gyro_misalignment_mrad=2.0, gyro_offset_deg_per_h=(1.0, 2.0, 3.0)
    )
    m = measure(MOVING, model, seed=1)
    want = MOVING.dtheta @ m.M_gyro.T + m.bias_gyro * MOVING.dt
    np.testing.assert_allclose(m.dtheta, want, atol=1e-16)
    np.testing.assert_allclose(m.bias_gyro[0], np.array([1.0, 2.0, 3.0]) * D / 3600.0)
    assert np.abs(np.diag(m.M_gyro) - 1).max() > 1e-4


def test_size_effect_is_the_acceleration_of_each_place() -> None:
    """(4.1): an accelerometer at rho feels w x (w x rho) + dw/dt x rho along its axis."""
    rho = np.array([[50.0, 20.0, -10.0], [-30.0, 40.0, 5.0], [10.0, -20.0, 60.0]])
    model = ImuModel(accel_x_lever_mm=tuple(rho[0]), accel_y_lever_mm=tuple(rho[1]), accel_z_lever_mm=tuple(rho[2]))
    path = shapes.rest(0.8, 0.3, duration=60.0).with_waves(("roll", 0.3, 0.4, 0.0), ("heading", 0.5, 0.3, 1.0))
    ideal = path.ideal(200.0, 10.0)
    got = (measure(ideal, model).dv - ideal.dv) / ideal.dt
    k, dt = 1000, ideal.dt
    nodes = k * dt + dt * (0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0])
    weights = 0.5 * np.polynomial.legendre.leggauss(5)[1]
    for i in range(3):
        total = 0.0
        for t, w in zip(nodes, weights, strict=True):
            a, b, c = (path.at(t + e).w_ib_b[0] for e in (-1e-4, 0.0, 1e-4))
            r = rho[i] * 1e-3
            total += w * (np.cross(b, np.cross(b, r)) + np.cross((c - a) / 2e-4, r))[i]
        assert got[k, i] == pytest.approx(total, abs=2e-7)


def test_quantised_increments_keep_their_sum() -> None:
    model = ImuModel(gyro_quantisation_arcsec=1.0, accel_quantisation_mps=1e-3)
    m = measure(MOVING, model)
    step = D / 3600.0
    assert np.abs(m.dtheta / step - np.round(m.dtheta / step)).max() < 1e-6
    assert np.abs((m.dtheta - MOVING.dtheta).sum(axis=0)).max() < step
    assert np.abs((m.dv - MOVING.dv).sum(axis=0)).max() < 1.0001e-3


def test_jittered_stamps_stay_in_order_and_leave_the_increments_alone() -> None:
    m = measure(MOVING, ImuModel(), jitter_s=1e-3, seed=2)
    assert np.all(np.diff(m.time) > 0.0)
    assert 5e-4 < (m.time - MOVING.time).std() < 1.2e-3
    assert np.array_equal(m.dtheta, MOVING.dtheta)


def test_bandwidth_delays_the_motion() -> None:
    m = measure(MOVING, ImuModel(bandwidth_hz=5.0))
    a, b = MOVING.dtheta[2000:, 0], m.dtheta[2000:, 0]
    lag = np.argmax([np.dot(a[: len(a) - k], b[k:]) for k in range(20)])
    assert lag * MOVING.dt == pytest.approx(1.0 / (2 * math.pi * 5.0), abs=0.008)


def test_catalogue_and_grades_describe_themselves() -> None:
    assert len(GYROS) == 19
    assert len(ACCELEROMETERS) == 6
    text = imu_of("VG951", "AK-6").describe(100.0)
    assert "gyro_bias_deg_per_h = 3" in text
    assert "rad/s" in text
    for grade in GRADES.values():
        assert any(word in grade.describe(100.0) for word in ("published", "assumed"))
    assert GRADES["navigation"].gyro_bias_deg_per_h < GRADES["tactical"].gyro_bias_deg_per_h


def test_grades_and_the_catalogue_are_presets_of_a_study() -> None:
    from schuler.ground.errors import StudyError
    from schuler.truth.keys import imu_from_keys

    assert imu_from_keys({"preset": "tactical"}).gyro_bias_deg_per_h == 1.0
    assert imu_from_keys({"preset": "VG951/AK-6"}).gyro_bias_deg_per_h == 3.0
    with pytest.raises(StudyError, match="the catalogue has no 'VG999'.*VG951"):
        imu_from_keys({"preset": "VG999/AK-6"})
