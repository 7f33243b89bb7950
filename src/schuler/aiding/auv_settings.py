"""What the AUV filter is told about vehicle and sensors (SI, radians), and how that becomes the kernel's vector."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, radians, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Start:
    """What is known at the start; None is found by the filter (levelling, first fixes, compass). rad, m, s, 1 sigma."""

    time: float | None = None
    lat: float | None = None
    lon: float | None = None
    height: float | None = None
    roll: float | None = None
    pitch: float | None = None
    heading: float | None = None
    std_pos: tuple[float | None, float | None, float | None] = (None, None, None)
    std_roll: float | None = None
    std_pitch: float | None = None
    std_heading: float | None = None


@dataclass(frozen=True)
class AuvSettings:
    """Sensors and vehicle of kind "auv", method "schuler". Sigmas are 1 sigma; `None` is chosen by `mode`.

    gyro_arw rad/sqrt(s); gyro_bias_std rad/s at turn-on; gyro_instability rad/s over gyro_tau s in run; accelerometer
    likewise in m/s^2. Positions in m, speeds in m/s, angles in rad; arms from the IMU in body FRD.
    """

    start: Start = Start()
    # inertial sensors
    gyro_arw: float = radians(0.03)
    gyro_bias_std: float = radians(0.2)
    gyro_instability: float = radians(0.005)
    gyro_tau: float = 1000.0
    accel_bias_std: float = 0.003 * 9.80665
    accel_instability: float = 2e-3
    accel_tau: float = 1000.0
    # other sensors
    gnss_std: Vector = (1.0, 1.0, 2.0)
    gnss_velocity_std: Vector = (0.05, 0.05, 0.1)
    gnss_correlated_std: float = 2.0
    gnss_correlated_tau: float = 100.0
    gnss_delay: float = 0.0
    speed_std: float = 0.05
    speed_scale_std: float = 0.01
    dvl_std: float = 0.02
    dvl_scale_std: float = 0.003
    depth_std: float = 0.1
    attitude_std: Vector = (radians(1.0), radians(1.0), radians(2.0))
    attitude_tau: float = 30.0  # how long a compass error lasts, beside its constant offset
    mag_std: float = radians(1.5)
    declination: float = 0.0
    heading_offset_std: float | None = None  # compass or magnetometer: 2 deg (mode "imu"), 5 deg ("compass")
    # water and vehicle
    current_std: float = 0.3
    current_walk: float = 0.001  # m/s/sqrt(s): 0.06 m/s/sqrt(h)
    current_shear: float = 2e-4  # 1/s: how the current's change with depth adds to its walk
    wave_std: float = 0.06  # horizontal orbital velocity at the surface, rms
    wave_period: float = 5.0
    drift_std: float = 0.3
    drift_tau: float = 600.0
    speed_walk: float | None = None  # m/s/sqrt(s): 0.03 with a log, 0.01 from depth rate
    path_scale_std: float = 0.1
    position_walk: float = 0.02  # m/sqrt(s): what no state explains
    down_walk: float = 0.06
    surface_depth: float = 3.0
    # how the filter works
    antenna: Vector = (0.0, 0.0, 0.0)
    dvl_arm: Vector = (0.0, 0.0, 0.0)
    speed_arm: Vector = (0.0, 0.0, 0.0)
    level_block: float | None = None  # s; None: two periods of the waves, at least 3
    level_floor: float = 1e-3  # m/s^2
    consider_after: float = inf  # s without a fix, then levelling leaves heading and its gyro bias alone (Schmidt)
    gate: bool = True
    gap: float = 60.0
    imu_gap: float = 0.5
    late: float = 10.0  # s: how late a measurement may come to the online filter
    smoother: bool = True
    output_rate: float | None = None  # Hz; None: 10 or the finest input if slower; inf: every epoch

    @property
    def every_epoch(self) -> bool:
        return self.output_rate == inf


def configuration(s: AuvSettings, *, compass: bool, has_log: bool, has_depth: bool, has_mag: bool = False) -> Array:
    """The kernel's configuration vector (`kernels.auv_state`)."""
    from schuler.kernels import auv_state as k

    c = np.zeros(k.NC)
    c[k.MODE] = 1.0 if compass else 0.0
    c[k.ARW] = s.gyro_arw
    c[k.Q_BG] = s.gyro_instability * sqrt(2.0 / s.gyro_tau)
    c[k.Q_BA] = s.accel_instability * sqrt(2.0 / s.accel_tau)
    c[k.Q_POS] = s.position_walk
    c[k.Q_DOWN] = s.down_walk
    c[k.Q_U] = s.speed_walk if s.speed_walk is not None else (0.03 if has_log else 0.01)
    # Scales and offsets are constants; a walk of 5 % of the prior an hour keeps them from freezing over days.
    per_hour = 0.05 / 60.0
    c[k.Q_K] = s.speed_scale_std * per_hour if has_log else 0.0
    c[k.Q_M] = heading_offset_std(s, compass) * per_hour if compass or has_mag else 0.0
    c[k.Q_KP] = path_scale_std(s, has_log, has_depth) * per_hour
    c[k.SIG_C] = s.current_std
    # The walk is one of a Gauss-Markov process that stays inside the prior.
    c[k.TAU_C] = 2.0 * (s.current_std / s.current_walk) ** 2 if s.current_walk > 0.0 and s.current_std > 0.0 else 1e12
    c[k.TAU_E], c[k.SIG_E] = s.gnss_correlated_tau, s.gnss_correlated_std
    c[k.SIG_DRIFT], c[k.TAU_DRIFT] = s.drift_std, s.drift_tau
    c[k.SHEAR] = s.current_shear if s.current_std > 0.0 else 0.0
    c[k.SIG_TILT], c[k.SIG_HEAD], c[k.HEAD_TAU] = s.attitude_std[0], s.attitude_std[2], s.attitude_tau
    c[k.WAVE], c[k.WAVE_W] = s.wave_std, 2.0 * pi / s.wave_period
    block = max(3.0, 2.0 * s.wave_period) if s.wave_std > 0.0 else 3.0
    c[k.LEVEL_S] = s.level_block if s.level_block is not None else block
    c[k.LEVEL_FLOOR] = s.level_floor
    c[k.MAG_STD], c[k.DECLINATION] = s.mag_std, s.declination
    c[k.ANT : k.ANT + 3] = s.antenna
    c[k.DVL : k.DVL + 3] = s.dvl_arm
    c[k.LOG : k.LOG + 3] = s.speed_arm
    c[k.DELAY] = s.gnss_delay
    c[k.HAS_LOG] = float(has_log)
    c[k.HAS_DEPTH] = float(has_depth)
    c[k.GAP_S], c[k.IMU_GAP_S] = s.gap, s.imu_gap
    c[k.COV_DT] = 0.1
    c[k.CONSIDER_S] = s.consider_after
    c[k.SURFACE_M] = s.surface_depth
    c[k.GATE] = float(s.gate)
    return c


def heading_offset_std(s: AuvSettings, compass: bool) -> float:
    """Prior of the compass or magnetometer offset, rad."""
    if s.heading_offset_std is not None:
        return s.heading_offset_std
    return radians(5.0) if compass else radians(2.0)


def path_scale_std(s: AuvSettings, has_log: bool, has_depth: bool) -> float:
    """Prior of the path scale: where a trusted log tells the speed along the axis, depth rate is not asked for it."""
    return s.path_scale_std if has_depth and not (has_log and s.speed_scale_std < 0.05) else 0.0


def initial_variances(
    s: AuvSettings, *, compass: bool, has_log: bool, has_depth: bool, has_mag: bool, has_dvl: bool
) -> Array:
    """Prior variances of the error state without attitude and position (those come from the start)."""
    from schuler.kernels import auv_state as k

    v = np.zeros(k.N)
    if not compass:
        v[k.E_BG : k.E_BG + 3] = s.gyro_bias_std**2 + s.gyro_instability**2
        v[k.E_BA : k.E_BA + 3] = s.accel_bias_std**2 + s.accel_instability**2
    v[k.E_U] = 1.0
    v[k.E_K] = s.speed_scale_std**2 if has_log else 0.0
    v[k.E_CN] = v[k.E_CE] = s.current_std**2
    v[k.E_M] = heading_offset_std(s, compass) ** 2 if compass or has_mag else 0.0
    v[k.E_EN] = v[k.E_EE] = s.gnss_correlated_std**2
    v[k.E_W] = v[k.E_W + 2] = s.wave_std**2
    v[k.E_W + 1] = v[k.E_W + 3] = (s.wave_std * 2.0 * pi / s.wave_period) ** 2
    v[k.E_KP] = path_scale_std(s, has_log, has_depth) ** 2
    v[k.E_KD] = s.dvl_scale_std**2 if has_dvl else 0.0
    return v
