"""Simulated hand-held motion for the tests of kind "ahrs": exact truth, IMU errors, a field with a lasting error."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, radians, sqrt

import numpy as np

from schuler.aiding.ahrs import AhrsSettings
from schuler.ground.frames import dcm_from_quat
from schuler.ground.tables import Table
from schuler.truth import trajectories
from schuler.truth.imu_errors import measure
from schuler.truth.instruments import ImuModel
from schuler.truth.streams import stream

LAT = radians(50.0)
FIELD = np.array([19e-6, 0.0, 45e-6])  # T, magnetic north, east, down
MODEL = ImuModel(
    gyro_arw_deg_per_sqrt_h=0.6,
    gyro_bias_deg_per_h=900.0,
    gyro_instability_deg_per_h=30.0,
    gyro_tau_s=300.0,
    accel_vrw_mps_per_sqrt_h=0.1,
    accel_bias_ug=3000.0,
)
PERFECT = ImuModel()
SETTINGS = AhrsSettings(
    gyro_arw=float(MODEL.arw[0]),
    gyro_bias_std=float(MODEL.gyro_bias[0]),
    gyro_walk=float(MODEL.gyro_instability[0]) * sqrt(2.0 / MODEL.gyro_tau_s),
    gyro_scale=0.0,
    accel_vrw=float(MODEL.vrw[0]),
    accel_bias_std=float(MODEL.accel_bias[0]),
    accel_walk=0.0,
    lat=LAT,
)


@dataclass
class Recording:
    """imu table with magnetometer, and the true attitude at its rows."""

    imu: Table
    time: np.ndarray
    q_nb: np.ndarray

    @property
    def C(self):
        return dcm_from_quat(self.q_nb)

    def arrays(self, mag=True):
        w, f, m = (self.imu.stack(*(f"{s}_{a}" for a in "xyz")) for s in ("gyro", "accel", "mag"))
        return (self.time, w, f, m) if mag else (self.time, w, f)

    def changed(self, **columns):
        """The same with other columns."""
        return Recording(Table("imu", {**self.imu.columns, **columns}, "rates"), self.time, self.q_nb)

    def six(self):
        """Without the magnetometer."""
        columns = {k: v for k, v in self.imu.columns.items() if not k.startswith("mag")}
        return Recording(Table("imu", columns, "rates"), self.time, self.q_nb)


def motion(duration, heading=0.7, speed=0.0, swing=0.4):
    """Rolls, pitches and turns at periods that do not repeat, and goes back and forth."""
    made = trajectories.oscillation(
        LAT, 0.0, 0.0, roll=swing, pitch=0.7 * swing, heading=2.0 * swing, rate=0.9, phase=1.0, mean_heading=heading,
        speed=speed, duration=duration,
    )  # fmt: skip
    return made.with_waves(
        ("roll", 0.5 * swing, 0.083, 0.3), ("pitch", 0.5 * swing, 0.117, 1.1), ("heading", 2.0 * swing, 0.023, 0.5),
    )  # fmt: skip


def wandering(duration, run, speed_std=0.15, tau=0.5):
    """`motion` whose velocity is a sum of 14 sines with the spectrum of a Gauss-Markov process and random phases."""
    rng = stream(7, run, "test.motion")
    edges = np.geomspace(0.02, 2.5, 15)
    f = np.sqrt(edges[1:] * edges[:-1])
    share = np.diff(np.arctan(2.0 * np.pi * edges * tau))
    amplitude = speed_std * np.sqrt(2.0 * share / share.sum())
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, 14))
    mean = 2.0  # m/s, so that a change of course moves it sideways
    waves = [("speed", a, x, p) for a, x, p in zip(amplitude, f, phases[0], strict=True)]
    waves += [("course", a / mean, x, p) for a, x, p in zip(amplitude, f, phases[1], strict=True)]
    made = motion(duration, heading=float(rng.uniform(-np.pi, np.pi)), speed=mean)
    return made.with_waves(*waves)


def record(duration=120.0, rate=100.0, *, model=MODEL, seed=1, run=0, mag_std=0.026, mag_tau=20.0, made=None):
    """A recording of `motion` or of `made`. mag_std, mag_tau: the compass error that lasts (Gauss-Markov), rad, s."""
    ideal = (made or motion(duration)).ideal(rate, every=1)
    imu = measure(ideal, model, seed=seed, run=run).table("rates")
    time, q = ideal.truth.time, ideal.truth.q_nb
    rng = stream(seed, run, "test.field")
    n, keep = len(time), exp(-1.0 / (rate * mag_tau))
    error = np.empty(n)
    value = mag_std * rng.standard_normal()
    for i, draw in enumerate(rng.standard_normal(n)):
        value = keep * value + mag_std * sqrt(1.0 - keep * keep) * draw
        error[i] = value
    turned = np.column_stack([FIELD[0] * np.cos(error), FIELD[0] * np.sin(error), np.full(n, FIELD[2])])
    m = np.einsum("nji,nj->ni", dcm_from_quat(q), turned) + 2e-7 * (mag_std > 0.0) * rng.standard_normal((n, 3))
    columns = {**imu.columns, **{f"mag_{a}": np.ascontiguousarray(m[:, i]) for i, a in enumerate("xyz")}}
    return Recording(Table("imu", columns, "rates"), time, q)


def error_of(recording, a, relative=False):
    """phi (n, 3) of an `Attitude` at its rows. relative : without the heading error of the first row."""
    from schuler.ground.frames import euler_from_quat
    from schuler.judging.attitude import attitude_errors

    i = np.searchsorted(recording.time, a.time - 1e-9)
    roll, pitch, heading = euler_from_quat(recording.q_nb[i])
    columns = {"time": a.time, "roll": roll, "pitch": pitch, "heading": heading}
    return attitude_errors(a.time, a.q, a.cov_phi, Table("reference", columns), relative=relative).phi
