"""Instruments at work: from stretches of truth to the rows of the contract's tables.

Each quantity draws from its own stream, also while its sensor is under water, so that nothing a sensor does changes
another's numbers. A table's first row comes one of its intervals after time 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from math import exp, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84, radii
from schuler.ground.errors import InputError
from schuler.ground.units import DEG, PERCENT
from schuler.truth import instruments as inst
from schuler.truth.missions import AuvMotion, Stretch
from schuler.truth.streams import stream

Array = NDArray[np.float64]
Columns = dict[str, Array]
Arm = tuple[float, float, float]


@dataclass(frozen=True)
class SensorSuite:
    """Which instruments there are (None: not fitted) and where. Arms run from the IMU to the sensor, body FRD, m.

    imu_rate_hz : also the epochs of the truth; the other rates must divide it. imu_kind : "rates" or "increments".
    imu_to_body_rpy : rad, f_body = Rz(yaw) Ry(pitch) Rx(roll) f_imu.
    """

    imu: inst.ImuModel | None = inst.IMUS["3dm-gx3-25"]
    imu_rate_hz: float = 100.0
    imu_kind: str = "rates"
    gnss: inst.GnssModel | None = inst.GARMIN_16_HVS
    speed: inst.SpeedLog | None = inst.CS4500
    depth: inst.DepthSensor | None = field(default_factory=inst.DepthSensor)
    dvl: inst.Dvl | None = None
    magnetometer: inst.Magnetometer | None = None
    attitude: inst.AttitudeSensor | None = None
    imu_to_body_rpy: Arm = (0.0, 0.0, 0.0)
    antenna_frd: Arm = (0.0, 0.0, 0.0)
    dvl_frd: Arm = (0.0, 0.0, 0.0)
    speed_frd: Arm = (0.0, 0.0, 0.0)
    reference_frd: Arm = (0.0, 0.0, 0.0)

    def describe(self) -> str:
        """Every instrument's figures: datasheet, SI, per sample, published or assumed."""
        parts = [self.imu, self.gnss, self.speed, self.depth, self.dvl, self.magnetometer, self.attitude]
        imu_side = (inst.ImuModel, inst.Magnetometer)
        return "\n".join(p.describe(self.imu_rate_hz if isinstance(p, imu_side) else None) for p in parts if p)

    def with_changes(self, **changes: object) -> SensorSuite:
        """A new suite; this one is unchanged."""
        return replace(self, **changes)  # type: ignore[arg-type]


SUITES = {
    "demo": SensorSuite(),
    "paper-test-1": SensorSuite(imu=inst.PAPER_IMU),
    "paper-test-2": SensorSuite(imu=inst.PAPER_IMU),
}


class Sensor(ABC):
    """One instrument at work: `feed` turns the next stretch of truth into the rows of its table."""

    kind = ""

    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        self.motion = motion
        self.suite = suite
        self.seed = seed
        self.run = run

    def random(self, quantity: str) -> np.random.Generator:
        return stream(self.seed, self.run, quantity)

    def stride(self, rate_hz: float) -> int:
        """Epochs between two rows."""
        step = self.motion.rate_hz / rate_hz if rate_hz > 0.0 else 0.0
        if step < 1.0 or abs(step - round(step)) > 1e-9:
            raise InputError(
                f"{type(self).__name__}: {rate_hz:g} Hz does not divide the IMU's {self.motion.rate_hz:g} Hz: "
                "choose a rate that fits a whole number of times"
            )
        return round(step)

    @abstractmethod
    def feed(self, s: Stretch) -> Columns:
        """The rows of this stretch."""

    def states(self, s: Stretch, time: Array) -> dict[str, tuple[Array, Array]]:
        """True values of what a filter may estimate."""
        return {}


def due(s: Stretch, stride: int, first: bool = False) -> NDArray[np.int64]:
    """Rows of a stretch on epochs that a sensor's stride divides; row 0 belongs to the stretch before."""
    begin = s.epoch if first and s.epoch == 0 else s.epoch + 1
    start = -(-begin // stride) * stride
    return np.arange(start, s.epoch + len(s.time), stride) - s.epoch


def dcm(s: Stretch, rows: NDArray[np.int64]) -> Array:
    """(n, 3, 3) C_nb at the rows."""
    sr, cr = np.sin(s.roll[rows]), np.cos(s.roll[rows])
    sp, cp = np.sin(s.pitch[rows]), np.cos(s.pitch[rows])
    sh, ch = np.sin(s.heading[rows]), np.cos(s.heading[rows])
    C = np.empty((len(rows), 3, 3))
    C[:, 0, 0], C[:, 0, 1], C[:, 0, 2] = cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh
    C[:, 1, 0], C[:, 1, 1], C[:, 1, 2] = cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch
    C[:, 2, 0], C[:, 2, 1], C[:, 2, 2] = -sp, sr * cp, cr * cp
    return C


def arm_motion(s: Stretch, rows: NDArray[np.int64], C: Array, arm: Arm) -> tuple[Array, Array]:
    """Offset in n (m) and velocity against the Earth, in b (m/s), that a point on the body adds to the IMU's."""
    lat = s.lat[rows]
    down = -WGS84.omega * np.sin(lat)
    north = WGS84.omega * np.cos(lat)
    w = s.w_ib_b[rows] - (C[:, 0, :] * north[:, None] + C[:, 2, :] * down[:, None])
    x, y, z = arm
    v_b = np.column_stack([w[:, 1] * z - w[:, 2] * y, w[:, 2] * x - w[:, 0] * z, w[:, 0] * y - w[:, 1] * x])
    offset = C[:, :, 0] * x + C[:, :, 1] * y + C[:, :, 2] * z
    return offset, v_b


def to_n(C: Array, b: Array) -> Array:
    """(n, 3) C_nb b, summed in a fixed order."""
    return np.asarray(C[:, :, 0] * b[:, :1] + C[:, :, 1] * b[:, 1:2] + C[:, :, 2] * b[:, 2:3])


def to_b(C: Array, n: Array) -> Array:
    """(n, 3) C_bn n, summed in a fixed order."""
    return np.asarray(C[:, 0, :] * n[:, :1] + C[:, 1, :] * n[:, 1:2] + C[:, 2, :] * n[:, 2:3])


def wrap_2pi(angle: Array) -> Array:
    """The same angle in [0, 2 pi)."""
    return np.asarray(np.mod(angle, 2.0 * pi))


class Walk:
    """A Gauss-Markov sequence (tau in s) or random walk (tau None) of k columns, continued from call to call."""

    def __init__(self, rng: np.random.Generator, sigma: Array, tau: float | None, dt: float) -> None:
        self.rng = rng
        sigma = np.asarray(sigma, float)
        k = len(sigma)
        if tau is None:
            self.phi, self.drive = np.ones(k), sigma * sqrt(dt)
            self.state = np.zeros(k)
        else:
            phi = exp(-dt / tau)
            self.phi, self.drive = np.full(k, phi), sigma * sqrt(1.0 - phi * phi)
            self.state = sigma * rng.standard_normal(k)
        self.active = bool(np.any(sigma > 0.0))

    def advance(self, n: int) -> Array:
        from schuler.kernels.noise import gauss_markov

        out = np.zeros((n, len(self.state)))
        if self.active:
            gauss_markov(self.rng.standard_normal(out.shape), self.phi, self.drive, self.state, out)
        return out


class ImuSensor(Sensor):
    """Gyros, accelerometers and, if fitted, the magnetometer, at every epoch."""

    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        super().__init__(motion, suite, seed, run)
        m = suite.imu
        assert m is not None
        self.kind = suite.imu_kind
        dt = 1.0 / motion.rate_hz
        gyro = m.gyro_offset + m.gyro_bias * self.random("imu.gyro.bias").standard_normal(3)
        accel = m.accel_offset + m.accel_bias * self.random("imu.accel.bias").standard_normal(3)
        self.turn_on = np.concatenate([gyro, accel])
        self.walks = [
            (0, Walk(self.random("imu.gyro.instability"), m.gyro_instability, m.gyro_tau_s, dt)),
            (3, Walk(self.random("imu.accel.instability"), m.accel_instability, m.accel_tau_s, dt)),
            (0, Walk(self.random("imu.gyro.rrw"), m.gyro_rrw, None, dt)),
            (3, Walk(self.random("imu.accel.rrw"), m.accel_rrw, None, dt)),
        ]
        self.noise = self.random("imu.noise")
        self.white = np.concatenate([m.arw, m.vrw]) / sqrt(dt)
        M_g = self._matrix("imu.gyro.matrix", m.gyro_scale, m.gyro_misalignment)
        M_a = self._matrix("imu.accel.matrix", m.accel_scale, m.accel_misalignment)
        g_sens = m.gyro_g_sensitivity * self.random("imu.gyro.g_sensitivity").standard_normal((3, 3))
        pole = exp(-2.0 * pi * m.bandwidth_hz * dt) if m.bandwidth_hz > 0.0 else 0.0
        self.C_ib = _rpy(suite.imu_to_body_rpy).T.copy()
        self.errors = (self.C_ib, m.levers, g_sens, M_g, M_a)
        self.output = (pole, np.zeros(7), m.quantum, np.zeros(6), m.limit)
        self.scale = {"gyro_scale": (m.gyro_scale, M_g), "accel_scale": (m.accel_scale, M_a)}
        self.last = self.turn_on.copy()
        for column, walk in self.walks:
            self.last[column : column + 3] += walk.state
        self.bias = self.last[None, :]
        self.mag = Compass(motion, suite, seed, run) if suite.magnetometer is not None else None

    def _matrix(self, name: str, scale: Array, misalignment: float) -> Array:
        draw = self.random(name).standard_normal((3, 3))
        M = np.eye(3) + misalignment * draw * (1.0 - np.eye(3))
        M[np.diag_indices(3)] += scale * draw.diagonal()
        return M

    def feed(self, s: Stretch) -> Columns:
        from schuler.kernels.noise import imu_front_end

        n = len(s.mean)
        bias = np.empty((n + 1, 6))
        bias[0] = self.last
        bias[1:] = self.turn_on
        for column, walk in self.walks:
            if walk.active:
                bias[1:, column : column + 3] += walk.advance(n)
        self.last = bias[-1].copy()
        self.bias = bias
        white = self.noise.standard_normal((n, 6)) * self.white
        out = np.empty((n, 6))
        w_ib = np.ascontiguousarray(s.w_ib_b)
        imu_front_end(s.mean, w_ib, s.rate_hz, *self.errors, bias[1:], white, *self.output, out)
        if self.kind == "increments":
            out = out / s.rate_hz
            names = [f"{q}_{axis}" for q in ("dtheta", "dv") for axis in "xyz"]
        else:
            names = [f"{q}_{axis}" for q in ("gyro", "accel") for axis in "xyz"]
        columns = {"time": s.time[1:].copy()}
        columns |= {name: np.ascontiguousarray(out[:, i]) for i, name in enumerate(names)}
        if self.mag is not None:
            columns |= self.mag.feed(s, self.C_ib)
        return columns

    def states(self, s: Stretch, time: Array) -> dict[str, tuple[Array, Array]]:
        rows = np.round(time * s.rate_hz).astype(np.int64) - s.epoch
        names = [f"{q}_{axis}" for q in ("gyro_bias", "accel_bias") for axis in "xyz"]
        states = {name: (time, self.bias[rows, i].copy()) for i, name in enumerate(names)}
        for name, (sigma, M) in self.scale.items():
            if np.any(sigma > 0.0):
                states |= {f"{name}_{a}": (time, np.full(len(time), M[i, i] - 1.0)) for i, a in enumerate("xyz")}
        if self.mag is not None:
            states["mag_bias"] = (time, np.full(len(time), self.mag.bias))
        return states


def _rpy(rpy: Arm) -> Array:
    """(3, 3) Rz(yaw) Ry(pitch) Rx(roll)."""
    r, p, y = rpy
    Rx = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(r), -np.sin(r)], [0.0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0.0, np.sin(p)], [0.0, 1.0, 0.0], [-np.sin(p), 0.0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0.0], [np.sin(y), np.cos(y), 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(Rz @ Ry @ Rx)


class Compass(Sensor):
    """The magnetometer of the IMU table."""

    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        super().__init__(motion, suite, seed, run)
        m = suite.magnetometer
        assert m is not None
        self.field = np.asarray(motion.mission.magnetic_field)
        self.bias = m.bias_deg * DEG * float(self.random("mag.bias").standard_normal())
        self.iron = m.hard_iron_ut * 1e-6 * self.random("mag.hard_iron").standard_normal(3)
        horizontal = float(np.hypot(self.field[0], self.field[1]))
        sigma = np.full(3, m.noise_deg * DEG * horizontal)
        self.noise = Walk(self.random("mag.noise"), sigma, m.tau_s, 1.0 / motion.rate_hz)

    def feed(self, s: Stretch, C_ib: Array) -> Columns:  # type: ignore[override]
        rows = np.arange(1, len(s.time))
        field_b = to_b(dcm(s, rows), np.broadcast_to(self.field, (len(rows), 3)))
        # Seen by a sensor turned clockwise by the bias, the field lies further to the left: heading + bias is read.
        c, b = np.cos(self.bias), np.sin(self.bias)
        x = c * field_b[:, 0] + b * field_b[:, 1]
        y = -b * field_b[:, 0] + c * field_b[:, 1]
        turned = np.column_stack([x, y, field_b[:, 2]])
        noise = self.noise.advance(len(rows))
        i = C_ib
        return {
            f"mag_{axis}": i[k, 0] * turned[:, 0] + i[k, 1] * turned[:, 1] + i[k, 2] * turned[:, 2]
            + self.iron[k] + noise[:, k]
            for k, axis in enumerate("xyz")
        }  # fmt: skip


class GnssSensor(Sensor):
    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        super().__init__(motion, suite, seed, run)
        m = suite.gnss
        assert m is not None
        self.model = m
        self.step = self.stride(m.rate_hz)
        self.white = self.random("gnss.white")
        self.velocity = self.random("gnss.velocity")
        self.slow = Walk(self.random("gnss.correlated"), np.asarray(m.correlated_m), m.tau_s, 1.0 / m.rate_hz)
        self.error: tuple[Array, Array] = (np.empty(0), np.empty((0, 3)))

    def feed(self, s: Stretch) -> Columns:
        m = self.model
        rows = due(s, self.step)
        n = len(rows)
        slow = self.slow.advance(n)
        self.error = (s.time[rows], slow)
        error = self.white.standard_normal((n, 3)) * np.asarray(m.white_m) + slow
        v_error = self.velocity.standard_normal((n, 3)) * inst.axes(m.velocity_mps)
        dry = self.motion.mission.surfaced(s.time[rows])
        rows, error, v_error = rows[dry], error[dry], v_error[dry]
        n = len(rows)
        C = dcm(s, rows)
        offset, v_b = arm_motion(s, rows, C, self.suite.antenna_frd)
        ned = offset + error
        v = s.v_n[rows] + to_n(C, v_b) + v_error
        lat, h = s.lat[rows], s.height[rows]
        R_N, R_E = radii(lat)
        std = m.std
        std_v = inst.axes(m.velocity_mps)
        columns = {
            "time": s.time[rows],
            "lat": lat + ned[:, 0] / (R_N + h),
            "lon": s.lon[rows] + ned[:, 1] / ((R_E + h) * np.cos(lat)),
            "height": h - ned[:, 2],
        }
        columns |= {f"std_{a}": np.full(n, std[i]) for i, a in enumerate(("north", "east", "down"))}
        columns |= {f"v_{a}": v[:, i].copy() for i, a in enumerate(("north", "east", "down"))}
        columns |= {f"std_v_{a}": np.full(n, std_v[i]) for i, a in enumerate(("north", "east", "down"))}
        return columns

    def states(self, s: Stretch, time: Array) -> dict[str, tuple[Array, Array]]:
        t, slow = self.error
        return {f"gnss_bias_{a}": (t, slow[:, i].copy()) for i, a in enumerate(("north", "east", "down"))}


class SpeedSensor(Sensor):
    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        super().__init__(motion, suite, seed, run)
        assert suite.speed is not None
        self.model = suite.speed
        self.step = self.stride(self.model.rate_hz)
        self.noise = self.random("speed.noise")

    def feed(self, s: Stretch) -> Columns:
        rows = due(s, self.step)
        speed = s.speed[rows]
        if any(self.suite.speed_frd):
            speed = speed + arm_motion(s, rows, dcm(s, rows), self.suite.speed_frd)[1][:, 0]
        noise = self.model.noise * self.noise.standard_normal(len(rows))
        return {"time": s.time[rows], "speed": speed * (1.0 + self.motion.speed_scale) + noise}

    def states(self, s: Stretch, time: Array) -> dict[str, tuple[Array, Array]]:
        return {"speed_scale": (time, np.full(len(time), self.motion.speed_scale))}


class DepthGauge(Sensor):
    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        super().__init__(motion, suite, seed, run)
        assert suite.depth is not None
        self.model = suite.depth
        self.step = self.stride(self.model.rate_hz)
        self.noise = self.random("depth.noise")
        self.bias = self.model.bias_m * float(self.random("depth.bias").standard_normal())

    def feed(self, s: Stretch) -> Columns:
        rows = due(s, self.step)
        noise = self.model.noise_m * self.noise.standard_normal(len(rows))
        return {"time": s.time[rows], "depth": -s.height[rows] + self.bias + noise}

    def states(self, s: Stretch, time: Array) -> dict[str, tuple[Array, Array]]:
        return {"depth_bias": (time, np.full(len(time), self.bias))}


class DvlSensor(Sensor):
    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        super().__init__(motion, suite, seed, run)
        assert suite.dvl is not None
        self.model = suite.dvl
        self.step = self.stride(self.model.rate_hz)
        self.noise = self.random("dvl.noise")
        self.scale = self.model.scale_percent * PERCENT * float(self.random("dvl.scale").standard_normal())

    def feed(self, s: Stretch) -> Columns:
        rows = due(s, self.step)
        C = dcm(s, rows)
        v = to_b(C, s.v_n[rows]) + arm_motion(s, rows, C, self.suite.dvl_frd)[1]
        v = v * (1.0 + self.scale) + self.model.noise_mps * self.noise.standard_normal((len(rows), 3))
        return {"time": s.time[rows]} | {f"v_{a}": v[:, i].copy() for i, a in enumerate("xyz")}

    def states(self, s: Stretch, time: Array) -> dict[str, tuple[Array, Array]]:
        return {"dvl_scale": (time, np.full(len(time), self.scale))}


class AttitudeGauge(Sensor):
    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int) -> None:
        super().__init__(motion, suite, seed, run)
        assert suite.attitude is not None
        self.model = suite.attitude
        self.step = self.stride(self.model.rate_hz)
        self.noise = self.random("attitude.noise")
        bias = float(self.random("attitude.bias").standard_normal())
        self.offset = self.model.heading_bias_deg * DEG * bias

    def feed(self, s: Stretch) -> Columns:
        m = self.model
        rows = due(s, self.step)
        sigma = np.array([m.tilt_noise_deg, m.tilt_noise_deg, m.heading_noise_deg]) * DEG
        noise = self.noise.standard_normal((len(rows), 3)) * sigma
        return {
            "time": s.time[rows],
            "roll": s.roll[rows] + noise[:, 0],
            "pitch": s.pitch[rows] + noise[:, 1],
            "heading": wrap_2pi(s.heading[rows] + self.offset + noise[:, 2]),
        }

    def states(self, s: Stretch, time: Array) -> dict[str, tuple[Array, Array]]:
        return {"heading_offset": (time, np.full(len(time), self.offset))}


class Truth(Sensor):
    """The reference table and the true current, at the nearest rate to rate_hz that fits the epochs."""

    def __init__(self, motion: AuvMotion, suite: SensorSuite, seed: int, run: int, rate_hz: float) -> None:
        super().__init__(motion, suite, seed, run)
        self.step = max(1, round(motion.rate_hz / rate_hz))

    def feed(self, s: Stretch) -> Columns:
        rows = due(s, self.step, first=True)
        lat, lon, h, v = s.lat[rows], s.lon[rows], s.height[rows], s.v_n[rows]
        if any(self.suite.reference_frd):
            C = dcm(s, rows)
            offset, v_b = arm_motion(s, rows, C, self.suite.reference_frd)
            v = v + to_n(C, v_b)
            R_N, R_E = radii(lat)
            lon = lon + offset[:, 1] / ((R_E + h) * np.cos(lat))
            lat, h = lat + offset[:, 0] / (R_N + h), h - offset[:, 2]
        columns = {"time": s.time[rows], "lat": lat, "lon": lon, "height": h}
        columns |= {f"v_{a}": v[:, i].copy() for i, a in enumerate(("north", "east", "down"))}
        return columns | {"roll": s.roll[rows], "pitch": s.pitch[rows], "heading": wrap_2pi(s.heading[rows])}

    def states(self, s: Stretch, time: Array | None = None) -> dict[str, tuple[Array, Array]]:
        rows = due(s, self.step, first=True)
        t = s.time[rows]
        return {f"current_{a}": (t, s.current[rows, i]) for i, a in enumerate(("north", "east"))}
