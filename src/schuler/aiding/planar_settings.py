"""What the planar filter is told about vehicle and sensors (SI, radians), and the plane that it works in."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, radians, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.aiding.auv_settings import Start
from schuler.ground.earth import LocalFrame, wrap_pi

Array = NDArray[np.float64]
STATES = (  # name, unit, index
    ("gyro_bias_z", "rad/s", 5),
    ("gyro_scale_z", "1", 6),
    ("speed_scale", "1", 7),
    ("range_scale", "1", 8),
)
LOGARITHMS = ("gyro_scale_z", "speed_scale", "range_scale")
SCALES = {  # of [filter] estimate: the prior that is zero where a name is left out
    "gyro_bias": "gyro_bias_std",
    "gyro_scale": "gyro_scale_std",
    "speed_scale": "speed_scale_std",
    "gnss_bias": "gnss_correlated_std",
    "range_scale": "range_scale_std",
    "range_bias": "range_bias_std",
}


@dataclass(frozen=True)
class PlanarSettings:
    """Sensors and vehicle of kind "planar". Sigmas are 1 sigma; positions in m, angles in rad, arms in body FRD.

    gyro_* are of the turn rate, whatever measured it: a gyro or an odometer's heading increments.
    """

    start: Start = Start()
    gyro_arw: float = radians(0.05)  # rad/sqrt(s)
    gyro_bias_std: float = radians(0.3)  # rad/s at turn-on
    gyro_instability: float = radians(0.01)  # rad/s in run
    gyro_tau: float = 300.0
    gyro_scale_std: float = 0.005
    turn_walk: float = 0.005  # rad/sqrt(rad): error of a turn beside scale and noise
    speed_std: float = 0.05  # m/s, of a row of speed
    speed_scale_std: float = 0.01
    slip: float = 0.05  # m/sqrt(m), along and across: wheels slip and scrub
    position_walk: float = 0.002  # m/sqrt(s)
    free_speed_walk: float = 1.0  # m/s/sqrt(s): how the speed changes where no row tells it
    free_turn_walk: float = 0.1  # rad/s/sqrt(s)
    free_turn_tau: float = 5.0  # s: how long an unknown turn lasts
    gnss_std: tuple[float, float, float] = (1.0, 1.0, 2.0)
    gnss_velocity_std: tuple[float, float, float] = (0.05, 0.05, 0.1)
    gnss_correlated_std: float = 2.0
    gnss_correlated_tau: float = 100.0
    gnss_delay: float = 0.0
    range_std: float = 0.5
    range_scale_std: float = 0.1
    range_bias_std: float = 0.3
    range_bias_tau: float = inf
    antenna: tuple[float, float, float] = (0.0, 0.0, 0.0)
    soft: float = 5.0  # squared innovation per degree of freedom from which a measurement counts less ...
    hard: float = 30.0  # ... and from which it is left out
    patience: float = 15.0  # s: what contradicts for longer is believed
    smoother: bool = True
    output_rate: float | None = None  # Hz; None: 10 with an IMU, else every row; inf: every row


@dataclass(frozen=True)
class Plane:
    """The plane of the track: north and east of an origin, tangent to the Earth at its height. rad, rad, m."""

    lat: float
    lon: float
    height: float = 0.0
    frame: LocalFrame = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", LocalFrame(self.lat, self.lon, self.height))

    def north_east(self, lat: ArrayLike, lon: ArrayLike) -> tuple[Array, Array]:
        """Metres in the plane of places in rad."""
        north, east, _ = self.frame.ned(lat, lon, self.height)
        return np.asarray(north, dtype=np.float64), np.asarray(east, dtype=np.float64)

    def geodetic(self, north: ArrayLike, east: ArrayLike) -> tuple[Array, Array]:
        """Places in rad of metres in the plane; undoes `north_east`."""
        down = np.zeros(np.shape(north))
        for _ in range(4):  # the plane lies above the ellipsoid's surface away from the origin
            lat, lon, height = self.frame.geodetic(north, east, down)
            down = down + height - self.height
        return np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64)

    def convergence(self, lat: ArrayLike, lon: ArrayLike) -> Array:
        """True north against the plane's, rad: heading = heading in the plane + this."""
        middle = 0.5 * (np.asarray(lat, dtype=np.float64) + self.lat)
        return np.asarray(wrap_pi(np.asarray(lon, dtype=np.float64) - self.lon) * np.sin(middle), dtype=np.float64)


@dataclass(frozen=True)
class Metres:
    """Tables in metres: their plane, what was taken off before it, and whether its place on the Earth is known."""

    plane: Plane
    north: float = 0.0
    east: float = 0.0
    placed: bool = False

    def geodetic(self, north: ArrayLike, east: ArrayLike) -> tuple[Array, Array]:
        """Places (rad) that stand for metres of the tables."""
        return self.plane.geodetic(np.asarray(north) - self.north, np.asarray(east) - self.east)

    def north_east(self, lat: ArrayLike, lon: ArrayLike) -> tuple[Array, Array]:
        """Metres as the tables count them."""
        north, east = self.plane.north_east(lat, lon)
        return north + self.north, east + self.east


def configuration(s: PlanarSettings) -> Array:
    """The kernel's configuration vector (`kernels.planar`)."""
    from schuler.kernels import planar as k

    c = np.zeros(k.NC)
    c[k.Q_BG] = s.gyro_instability * sqrt(2.0 / s.gyro_tau)
    c[k.Q_TURN], c[k.SLIP], c[k.Q_POS] = s.turn_walk, s.slip, s.position_walk
    c[k.Q_V], c[k.Q_W], c[k.TAU_W] = s.free_speed_walk, s.free_turn_walk, s.free_turn_tau
    c[k.TAU_E] = s.gnss_correlated_tau
    c[k.ARM_X], c[k.ARM_Y] = s.antenna[0], s.antenna[1]
    c[k.SOFT], c[k.HARD], c[k.PATIENCE] = s.soft, s.hard, s.patience
    c[k.Q_KS] = s.speed_scale_std * 0.05 / 60.0  # 5 % of its prior an hour keeps a scale from freezing
    c[k.TAU_B], c[k.SIG_B] = min(s.range_bias_tau, 1e15), s.range_bias_std
    return c


def prior(s: PlanarSettings, beacons: int, has_fixes: bool) -> Array:
    """Variances of the states that no start tells (n,); position and heading stay zero."""
    from schuler.kernels import planar as k

    v = np.zeros(k.B0 + beacons)
    v[k.V], v[k.W] = 25.0, 0.04
    v[k.BG], v[k.KG], v[k.KS] = s.gyro_bias_std**2, s.gyro_scale_std**2, s.speed_scale_std**2
    if has_fixes and s.gnss_correlated_std > 0.0:
        v[k.EN] = v[k.EE] = 1.0
    if beacons:
        v[k.KR] = s.range_scale_std**2
        v[k.B0 :] = s.range_bias_std**2
    return v
