"""What the aided filter remembers of its past, for rows that come late: against a motion known in closed form."""

import numpy as np
import pytest

from schuler.ground.frames import quat_conjugate, quat_from_rotvec, quat_multiply, rotvec_from_quat
from schuler.kernels import aided_state as k
from schuler.kernels.aided_measure import LOOK, look_back

RATE = np.array([0.1, -0.2, 0.5])  # rad/s, of b against n
ACCEL = np.array([1.0, -2.0, 0.3])  # m/s^2
V0 = np.array([10.0, 3.0, -1.0])
DT = 0.02
LAST, NOW = 1.0, 1.013  # s: the last row of the IMU, and a measurement after it
Q0 = np.array([0.8, 0.2, -0.4, 0.4])


def attitude(t: float) -> np.ndarray:
    return np.asarray(quat_multiply(Q0, quat_from_rotvec(RATE * t)))


def way(t: float) -> np.ndarray:
    return V0 * t + 0.5 * ACCEL * t * t


@pytest.fixture
def past() -> tuple[np.ndarray, np.ndarray]:
    """State and ring at NOW, with a row each DT until LAST."""
    x, ring = np.zeros(k.NX), np.zeros((k.RING, k.RING_W))
    for i, t in enumerate(np.arange(0.0, LAST + 1e-9, DT)):
        ring[i, 0] = t
        ring[i, 1:4], ring[i, 4:7], ring[i, 7:11], ring[i, 11:14] = way(t), ACCEL * t, attitude(t), RATE
        x[k.HEAD] = i + 1
    x[k.T] = NOW
    x[k.QUAT : k.QUAT + 4] = attitude(NOW)
    x[k.VEL : k.VEL + 3] = V0 + ACCEL * NOW
    x[k.ACC : k.ACC + 3], x[k.W : k.W + 3] = ACCEL, RATE
    x[k.DISP : k.DISP + 3], x[k.DVI : k.DVI + 3] = way(NOW), ACCEL * NOW
    return x, ring


@pytest.mark.parametrize("tau", [-0.1, -0.004, 0.0, 0.004, 0.012, 0.013, 0.02, 0.1234, 0.9])
def test_the_past_is_what_it_was(past, tau: float) -> None:
    """Delays shorter than an IMU interval, longer, and below zero."""
    x, ring = past
    out = np.zeros(LOOK)
    look_back(x, ring, tau, out)
    then = NOW - tau
    np.testing.assert_allclose(out[:3], way(NOW) - way(then), atol=2e-4)  # linear between rows: a dt^2/8
    np.testing.assert_allclose(out[3:6], ACCEL * tau, atol=1e-12)
    turned = rotvec_from_quat(quat_multiply(quat_conjugate(attitude(then)), out[6:10]))
    np.testing.assert_allclose(turned, 0.0, atol=1e-6)
    np.testing.assert_allclose(out[10:13], RATE)
