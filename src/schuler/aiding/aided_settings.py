"""What the aided INS is told about vehicle and sensors (SI, radians), and what it estimates beside the track."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf, isfinite, radians

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.auv_settings import Start as PlaceStart
from schuler.ground.camera import Camera
from schuler.ground.errors import InputError
from schuler.ground.terrain import HeightModel

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

ALWAYS = ("gyro_bias", "accel_bias")
SHAPES = ("gyro_scale", "accel_scale", "gyro_misalignment", "accel_misalignment")  # where the IMU is said to have them
UNTOLD = {"gyro_scale": 0.01, "accel_scale": 0.01, "gyro_misalignment": 0.005, "accel_misalignment": 0.005}
ESTIMATES = (  # in the order of their places in the error state
    "gyro_bias", "accel_bias", "gyro_scale", "accel_scale", "gyro_misalignment", "accel_misalignment", "mounting",
    "antenna_lever", "dvl_lever", "speed_lever", "gnss_delay", "gnss_velocity_delay", "dvl_delay", "speed_delay",
    "speed_scale", "current", "gnss_bias", "height_bias", "depth_bias", "dvl_scale", "dvl_misalignment",
    "heading_offset", "mag_bias", "range_scale", "range_bias", "user",
)  # fmt: skip


@dataclass(frozen=True)
class Start(PlaceStart):
    """As `auv_settings.Start`, with velocity NED m/s; None is found."""

    v_n: tuple[float | None, float | None, float | None] = (None, None, None)
    std_vel: tuple[float | None, float | None, float | None] = (None, None, None)


@dataclass(frozen=True)
class AidedSettings:
    """Sensors and vehicle of kind "aided". Sigmas are 1 sigma.

    IMU: arw rad/sqrt(s), vrw m/s/sqrt(s), biases at turn-on rad/s and m/s^2, instability over tau in run, walks
    rad/s/sqrt(s) and m/s^2/sqrt(s), scales 1, misalignments rad. Positions m, speeds m/s, angles rad, delays s; arms
    from the IMU in body FRD. estimate: names of `ESTIMATES`; None: what the sensors present need (`chosen`).
    """

    start: Start = Start()
    # inertial sensors: those of a consumer unit in a vehicle that shakes it
    gyro_arw: Vector = (1e-3, 1e-3, 1e-3)
    gyro_bias_std: Vector = (0.01, 0.01, 0.01)
    gyro_instability: float = 0.0
    gyro_tau: float = 1000.0
    gyro_walk: float = 5e-5
    gyro_scale_std: float = 0.01
    gyro_misalignment_std: float = 0.0
    accel_vrw: Vector = (0.05, 0.05, 0.05)
    accel_bias_std: Vector = (0.3, 0.3, 0.3)
    accel_instability: float = 0.0
    accel_tau: float = 1000.0
    accel_walk: float = 5e-4
    accel_scale_std: float = 0.01
    accel_misalignment_std: float = 0.0
    # other sensors
    gnss_std: Vector = (1.0, 1.0, 2.0)
    gnss_velocity_std: Vector = (0.05, 0.05, 0.1)
    gnss_correlated_std: float = 2.0
    gnss_correlated_tau: float = 100.0
    gnss_delay: float = 0.0
    gnss_velocity_delay: float | None = None  # None: that of the fixes
    gnss_delay_std: float = 0.1
    delay_walk: float = 1e-3  # s/sqrt(s)
    antenna_std: float = 0.3
    speed_std: float = 0.05
    speed_scale_std: float = 0.01
    speed_is: str = "ground"  # "ground", "water", "air"
    current_std: float = 0.3
    current_walk: float = 0.001
    dvl_std: float = 0.02
    dvl_scale_std: float = 0.003
    dvl_misalignment_std: float = radians(1.0)
    depth_std: float = 0.1
    depth_bias_std: float = 50.0
    height_std: float = 1.0
    height_bias_std: float = 50.0
    height_walk: float = 0.05  # m/sqrt(s)
    attitude_std: Vector = (radians(1.0), radians(1.0), radians(2.0))
    attitude_tau: float = 30.0
    mag_std: float = radians(1.5)
    mag_bias_std: float = 5e-6
    heading_offset_std: float = radians(2.0)
    declination: float = 0.0
    range_std: float = 0.5
    range_scale_std: float = 0.02
    range_bias_std: float = 0.5
    camera: Camera | None = None
    lidar_std: float = 0.1
    lidar_arm: Vector = (0.0, 0.0, 0.0)
    lidar_reach: float = 1000.0
    lidar_divergence: float = 0.0  # rad, full angle
    ground_std: float = 0.5  # m, of the height model
    height_model: HeightModel | None = None
    user_std: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    user_walk: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    # vehicle
    antenna: Vector = (0.0, 0.0, 0.0)
    dvl_arm: Vector = (0.0, 0.0, 0.0)
    speed_arm: Vector = (0.0, 0.0, 0.0)
    mounting_std: float = radians(6.0)
    constraints: tuple[str, ...] = ()
    nhc_point: Vector = (0.0, 0.0, 0.0)
    nhc_std: tuple[float, float] = (0.06, 0.10)
    nhc_sway: tuple[float, float] = (0.01, 0.03)  # rad: a body on springs and tyres yaws and pitches
    nhc_slip: float = 0.002  # s^2/m: side slip of a tyre, per lateral acceleration
    nhc_interval: float = 0.1
    zupt_std: float = 0.05
    zaru_std: float = 0.01
    still_interval: float = 0.2
    # how the filter works
    estimate: tuple[str, ...] | None = None
    open_loop: bool = False
    vertical: str = "free"  # "held": height and v_down; "zeroed": held, but left in the covariance (listing A.2)
    bias_model: str = "auto"  # "walk", "gauss-markov"; auto: the latter where there is no turn-on bias
    gate: bool = True
    distrust: float = 60.0  # s: so long fixes may contradict the filter before they are believed
    distrust_early: float = 5.0  # the same in the filter's first minute
    imu_gap: float | None = None  # s; None: 0.2, or eight intervals of a slow IMU
    gap_rate: float = 0.1  # rad/s and m/s^2: what a vehicle may do in a gap
    gap_accel: float = 1.0
    node_interval: float = 0.2
    smoother: bool = True
    output_rate: float | None = 10.0  # Hz; inf: every row

    @property
    def velocity_delay(self) -> float:
        return self.gnss_delay if self.gnss_velocity_delay is None else self.gnss_velocity_delay

    @property
    def ahead(self) -> tuple[float, float]:
        """How much later than their stamps fixes and GNSS velocities are taken: they belong to later moments."""
        return max(0.0, -self.gnss_delay), max(0.0, -self.velocity_delay)

    @property
    def out_dt(self) -> float:
        rate = self.output_rate or 10.0
        return 0.0 if rate == inf else 1.0 / rate


@dataclass
class Layout:
    """Which parameters the error state holds: `ie` (SLOTS,) places, n its length, and what is known of each before.

    std (n,), noise (n,) density of the driving noise, beta (n,) 1/s: first-order Gauss-Markov, 0 a random walk.
    """

    ie: NDArray[np.int64]
    n: int
    std: Array
    noise: Array
    beta: Array
    names: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list)


def chosen(s: AidedSettings, present: Iterable[str], *, delayed: bool = False) -> tuple[str, ...]:
    """What is estimated: as typed, or what the sensors present need. delayed: the fixes were seen to lag."""
    have = set(present)
    if s.estimate is not None:
        unknown = [name for name in s.estimate if name not in ESTIMATES]
        if unknown:
            raise InputError(f"estimate: there is no {', '.join(unknown)}; there are {', '.join(ESTIMATES)}")
        names = set(s.estimate)
    else:
        names = set(ALWAYS)
        names |= {name for name in SHAPES if getattr(s, f"{name}_std") > 0.0}
        if "speed" in have:
            names |= {"speed_scale"} | ({"current"} if s.speed_is != "ground" else set())
        if ("speed" in have and s.speed_is == "ground") or "nhc" in s.constraints:
            names |= {"mounting"}
        if "gnss" in have and s.gnss_correlated_std > 0.0:
            names |= {"gnss_bias"}
        if "gnss" in have and delayed:
            names |= {"gnss_delay", "gnss_velocity_delay"}
        if "dvl" in have:
            names |= {"dvl_scale", "dvl_misalignment"}
        if "height" in have:
            names |= {"height_bias"}
        if "depth" in have:
            names |= {"depth_bias"}
        if "attitude" in have or "magnetometer" in have:
            names |= {"heading_offset"}
        if "ranges" in have:
            names |= {"range_scale", "range_bias"}
    if any(s.user_std):
        names |= {"user"}
    return tuple(name for name in ESTIMATES if name in names)


def layout_of(s: AidedSettings, names: tuple[str, ...]) -> Layout:
    """Places and priors of the parameters that are estimated."""
    from schuler.kernels import aided_state as k

    def bias(std: Vector, instability: float, tau: float, walk: float) -> tuple[Array, float, float]:
        first = np.asarray(std, dtype=float)
        alone = float(first.max()) <= instability and walk == 0.0
        if instability > 0.0 and (s.bias_model == "gauss-markov" or (s.bias_model == "auto" and alone)):
            # in-run alone: a stationary Gauss-Markov process
            return np.full(3, instability) if alone else first, 2.0 * instability**2 / tau, 1.0 / tau
        # a turn-on constant that the in-run part moves: its short-time behaviour is a random walk
        return np.hypot(first, instability), 2.0 * instability**2 / tau + walk**2, 0.0

    def shape(name: str, count: int) -> Array:
        return np.full(count, getattr(s, f"{name}_std") or UNTOLD[name])

    current_beta = 0.0
    if s.current_std > 0.0 and s.current_walk > 0.0:
        current_beta = 0.5 * (s.current_walk / s.current_std) ** 2
    slow = s.gnss_correlated_std
    hour = 1.0 / 3600.0
    table: dict[str, tuple[int, Array, Array | float, float]] = {
        "gyro_bias": (k.BG, *bias(s.gyro_bias_std, s.gyro_instability, s.gyro_tau, s.gyro_walk)),
        "accel_bias": (k.BA, *bias(s.accel_bias_std, s.accel_instability, s.accel_tau, s.accel_walk)),
        "gyro_scale": (k.SG, shape("gyro_scale", 3), 0.0, 0.0),
        "accel_scale": (k.SA, shape("accel_scale", 3), 0.0, 0.0),
        "gyro_misalignment": (k.MG, shape("gyro_misalignment", 6), 0.0, 0.0),
        "accel_misalignment": (k.MA, shape("accel_misalignment", 6), 0.0, 0.0),
        "mounting": (k.MNT, np.full(3, s.mounting_std), 0.0, 0.0),
        "antenna_lever": (k.ANT, np.full(3, s.antenna_std), 0.0, 0.0),
        "dvl_lever": (k.DVL, np.full(3, s.antenna_std), 0.0, 0.0),
        "speed_lever": (k.SPD, np.full(3, s.antenna_std), 0.0, 0.0),
        "gnss_delay": (k.TG, np.array([s.gnss_delay_std]), s.delay_walk**2, 0.0),
        "gnss_velocity_delay": (k.TV, np.array([s.gnss_delay_std]), s.delay_walk**2, 0.0),
        "dvl_delay": (k.TD, np.array([0.1]), s.delay_walk**2, 0.0),
        "speed_delay": (k.TS, np.array([0.1]), s.delay_walk**2, 0.0),
        "speed_scale": (k.KS, np.array([s.speed_scale_std]), 0.0025 * hour * s.speed_scale_std**2, 0.0),
        "current": (k.CUR, np.full(2, s.current_std), s.current_walk**2, current_beta),
        "gnss_bias": (k.GB, slow * np.array([1.0, 1.0, 1.5]),
                      2.0 / s.gnss_correlated_tau * (slow * np.array([1.0, 1.0, 1.5])) ** 2,
                      1.0 / s.gnss_correlated_tau),
        "height_bias": (k.HB, np.array([s.height_bias_std]), s.height_walk**2, 0.0),
        "depth_bias": (k.DB, np.array([s.depth_bias_std]), 0.0, 0.0),
        "dvl_scale": (k.KD, np.array([s.dvl_scale_std]), 0.0, 0.0),
        "dvl_misalignment": (k.DM, np.full(3, s.dvl_misalignment_std), 0.0, 0.0),
        "heading_offset": (k.HO, np.array([s.heading_offset_std]), 0.0025 * hour * s.heading_offset_std**2, 0.0),
        "mag_bias": (k.MB, np.full(3, s.mag_bias_std), 0.0, 0.0),
        "range_scale": (k.KR, np.array([s.range_scale_std]), 0.0, 0.0),
        "range_bias": (k.RB, np.array([s.range_bias_std]), 0.0, 0.0),
        "user": (k.USER, np.asarray(s.user_std), np.asarray(s.user_walk) ** 2, 0.0),
    }  # fmt: skip
    ie = np.full(k.SLOTS, -1, dtype=np.int64)
    std, noise, beta = ([0.0] * k.NAV for _ in range(3))
    for name in names:
        slot, sigma, density, rate = table[name]
        size = len(sigma)
        ie[slot : slot + size] = np.arange(len(std), len(std) + size)
        std += [float(v) for v in sigma]
        noise += [float(v) for v in np.broadcast_to(density, size)]
        beta += [rate] * size
    return Layout(ie, len(std), np.array(std), np.array(noise), np.array(beta), names)


def configuration(s: AidedSettings, interval: float) -> Array:
    """The kernel's configuration vector (`kernels.aided_state`). interval: median of the IMU, s."""
    from schuler.kernels import aided_state as k

    c = np.zeros(k.NC)
    c[k.ARW2 : k.ARW2 + 3] = np.asarray(s.gyro_arw) ** 2
    c[k.VRW2 : k.VRW2 + 3] = np.asarray(s.accel_vrw) ** 2
    c[k.ISO] = float(len(set(s.gyro_arw)) == 1 and len(set(s.accel_vrw)) == 1)
    c[k.GAP_S] = s.imu_gap if s.imu_gap is not None else max(0.2, 8.0 * interval)
    c[k.GAP_W], c[k.GAP_A] = s.gap_rate, s.gap_accel
    c[k.NHC_DT] = s.nhc_interval if "nhc" in s.constraints else 0.0
    c[k.NHC_Y], c[k.NHC_Z] = s.nhc_std
    c[k.NHC : k.NHC + 3] = s.nhc_point
    c[k.SLIP] = s.nhc_slip
    c[k.SWAY_Y], c[k.SWAY_Z] = s.nhc_sway
    standing = "zupt" in s.constraints or "zaru" in s.constraints
    c[k.STILL_DT] = s.still_interval if standing else 0.0
    c[k.ZUPT] = s.zupt_std if "zupt" in s.constraints else 0.0
    c[k.ZARU] = s.zaru_std if standing else 0.0
    c[k.DISTRUST_S], c[k.EARLY_S] = s.distrust, s.distrust_early
    c[k.GATE], c[k.OPEN_LOOP] = float(s.gate), float(s.open_loop)
    c[k.HELD] = {"free": 0.0, "held": 1.0, "zeroed": 2.0}[s.vertical]
    c[k.RELATIVE] = float(s.speed_is != "ground")
    c[k.DECL], c[k.MAG_STD] = s.declination, s.mag_std
    c[k.NODE_DT] = s.node_interval
    c[k.AHEAD], c[k.V_AHEAD] = s.ahead
    c[k.C_CB : k.C_CB + 9] = np.eye(3).ravel()
    if s.camera is not None:
        c[k.FOCAL], c[k.U0], c[k.V0] = s.camera.focal, s.camera.u0, s.camera.v0
        c[k.CAM : k.CAM + 3] = s.camera.l_b
        c[k.C_CB : k.C_CB + 9] = s.camera.C_cb.ravel()
    c[k.LID : k.LID + 3] = s.lidar_arm
    c[k.REACH], c[k.DIVERGENCE], c[k.GROUND] = s.lidar_reach, s.lidar_divergence, s.ground_std
    if not isfinite(float(c.sum())):
        raise InputError("a setting of the aided filter is not a number")
    return c
