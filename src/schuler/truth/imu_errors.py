"""An IMU's errors put on exact increments: what an `ImuModel` makes of a trajectory.

measured = (I + M) true + G f + bias + noise, then range and quantum. Each quantity draws from a stream of its own, set
by (seed, run, name): the same numbers however runs are spread, and a new error does not disturb the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.truth.instruments import ImuModel
from schuler.truth.sensors import Walk
from schuler.truth.streams import stream
from schuler.truth.trajectories import Ideal, imu_table

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """What the IMU put out and what was wrong with it.

    time (n,) s; dt s; dtheta (n, 3) rad; dv (n, 3) m/s. bias_gyro, bias_accel (n, 3) rad/s, m/s^2 over each interval;
    M_gyro, M_accel (3, 3), I + scale and misalignment as drawn; clipped (n, 6): where a range was reached.
    """

    time: Array
    dt: float
    dtheta: Array
    dv: Array
    bias_gyro: Array
    bias_accel: Array
    M_gyro: Array
    M_accel: Array
    clipped: NDArray[np.bool_]

    def table(self, kind: str = "increments") -> Table:
        """The imu table."""
        return imu_table(self.time, self.dtheta, self.dv, self.dt, "rates" if kind == "rates" else "increments")


def measure(
    ideal: Ideal,
    model: ImuModel,
    *,
    seed: int = 0,
    run: int = 0,
    jitter_s: float = 0.0,
    gyro_scale: Array | None = None,
    accel_scale: Array | None = None,
) -> Measured:
    """The ideal increments as `model` measures them.

    jitter_s : 1 sigma of a white error of the stamps (the intervals themselves stay exact). gyro_scale, accel_scale
    (3,):
    fixed scale errors added to the drawn ones. The size effect takes the angular rate at the ends of the intervals from
    the increments themselves (cubic), good for motion well below the sample rate.
    """
    from schuler.kernels.noise import imu_front_end

    n, dt = len(ideal.time), ideal.dt
    if n < 4 and np.any(model.levers):
        raise InputError("the size effect needs at least four IMU samples")

    def random(name: str) -> np.random.Generator:
        return stream(seed, run, name)

    bias = np.empty((n, 6))
    bias[:, :3] = model.gyro_offset + model.gyro_bias * random("imu.gyro.bias").standard_normal(3)
    bias[:, 3:] = model.accel_offset + model.accel_bias * random("imu.accel.bias").standard_normal(3)
    for column, walk in (
        (0, Walk(random("imu.gyro.instability"), model.gyro_instability, model.gyro_tau_s, dt)),
        (3, Walk(random("imu.accel.instability"), model.accel_instability, model.accel_tau_s, dt)),
        (0, Walk(random("imu.gyro.rrw"), model.gyro_rrw, None, dt)),
        (3, Walk(random("imu.accel.rrw"), model.accel_rrw, None, dt)),
    ):
        if walk.active:
            bias[:, column : column + 3] += walk.advance(n)

    def matrix(name: str, scale: Array, misalignment: float, fixed: Array | None) -> Array:
        draw = random(name).standard_normal((3, 3))
        M = np.eye(3) + misalignment * draw * (1.0 - np.eye(3))
        M[np.diag_indices(3)] += scale * draw.diagonal() + (0.0 if fixed is None else fixed)
        return M

    M_g = matrix("imu.gyro.matrix", model.gyro_scale, model.gyro_misalignment, gyro_scale)
    M_a = matrix("imu.accel.matrix", model.accel_scale, model.accel_misalignment, accel_scale)
    g_sens = model.gyro_g_sensitivity * random("imu.gyro.g_sensitivity").standard_normal((3, 3))
    white = np.concatenate([model.arw, model.vrw]) / sqrt(dt)
    noise = random("imu.noise").standard_normal((n, 6)) * white if np.any(white) else np.zeros((n, 6))
    limit = model.limit
    plain = not (
        np.any(model.levers) or np.any(g_sens) or model.bandwidth_hz > 0.0
        or np.any(model.quantum) or np.any(np.isfinite(limit))
    )  # fmt: skip
    if plain:  # the short way, the same sums
        dtheta = ideal.dtheta if np.array_equal(M_g, np.eye(3)) else ideal.dtheta @ M_g.T
        dv = ideal.dv if np.array_equal(M_a, np.eye(3)) else ideal.dv @ M_a.T
        dtheta, dv = dtheta + (bias[:, :3] + noise[:, :3]) * dt, dv + (bias[:, 3:] + noise[:, 3:]) * dt
        clipped = np.zeros((0, 6), dtype=bool)
    else:
        mean = np.hstack([ideal.dtheta, ideal.dv]) / dt
        ends = _ends(mean[:, :3]) if np.any(model.levers) else np.zeros((n + 1, 3))
        pole = exp(-2.0 * pi * model.bandwidth_hz * dt) if model.bandwidth_hz > 0.0 else 0.0
        out = np.empty((n, 6))
        imu_front_end(
            mean, ends, 1.0 / dt, np.eye(3), model.levers, g_sens, M_g, M_a, bias, noise, pole, np.zeros(7),
            model.quantum, np.zeros(6), limit, out,
        )  # fmt: skip
        clipped = np.abs(out) >= limit * (1.0 - 1e-12)
        dtheta, dv = out[:, :3] * dt, out[:, 3:] * dt
    time = ideal.time
    if jitter_s > 0.0:
        shift = jitter_s * random("imu.jitter").standard_normal(n)
        time = time + np.clip(shift, -0.4 * dt, 0.4 * dt)  # stamps never cross
    return Measured(time, dt, dtheta, dv, bias[:, :3], bias[:, 3:], M_g, M_a, clipped)


def _ends(mean: Array) -> Array:
    """Rates at the ends (n + 1, 3) of intervals with these means (n, 3): the cubic through four of them."""
    inner = (7.0 * (mean[1:-2] + mean[2:-1]) - (mean[:-3] + mean[3:])) / 12.0
    first = (25.0 * mean[0] - 23.0 * mean[1] + 13.0 * mean[2] - 3.0 * mean[3]) / 12.0
    second = (3.0 * mean[0] + 13.0 * mean[1] - 5.0 * mean[2] + mean[3]) / 12.0
    last = (25.0 * mean[-1] - 23.0 * mean[-2] + 13.0 * mean[-3] - 3.0 * mean[-4]) / 12.0
    before = (3.0 * mean[-1] + 13.0 * mean[-2] - 5.0 * mean[-3] + mean[-4]) / 12.0
    return np.vstack([first, second, inner, before, last])
