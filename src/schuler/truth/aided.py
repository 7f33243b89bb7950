"""Simulated recordings of a vehicle on any trajectory: IMU, GNSS, speed, DVL, depth, height, compass, beacons.

Every sensor is evaluated on the trajectory's own formula at the moment it belongs to, so that rates need not divide
each other and a delay is exact: a row stamped t belongs to t - delay. measured = (I + M) true + bias + noise. Each
quantity draws from a stream of its own: another sensor changes nobody's numbers. SI and radians, NED, body FRD.

Body b is the IMU's axes turned by imu_to_body, as a study types it: the arms are along its axes, the reference is its
attitude, f_b = C(imu_to_body) f_imu with C(rpy) = Rz(yaw) Ry(pitch) Rx(roll). The vehicle's own axes, which follow the
path and along which its log feels the speed, differ by the mounting angles, the small rest that a filter may find:
v_vehicle = C(mounting) v_b.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from schuler.ground.camera import Camera
from schuler.ground.earth import Ellipsoid
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, dcm_from_quat, euler_from_dcm, quat_from_dcm
from schuler.ground.lidar import Lidar
from schuler.ground.tables import Table
from schuler.ground.terrain import HeightModel
from schuler.ground.units import DEG
from schuler.truth.aided_optics import lidar_ranges, sightings
from schuler.truth.imu_errors import Measured, measure
from schuler.truth.instruments import Arm, ImuModel, Magnetometer
from schuler.truth.optics import OESON
from schuler.truth.sensors import Walk
from schuler.truth.streams import stream
from schuler.truth.trajectories import Trajectory, Truth

Array = NDArray[np.float64]
States = dict[str, tuple[Array, Array]]
NED = ("north", "east", "down")
RPY = ("roll", "pitch", "yaw")
YEAR = 2026.0  # of the magnetic field where nothing else is said
FIELD_STEP = 100.0  # m between two evaluations of the magnetic field, linear between them: good to 0.02 nT


@dataclass(frozen=True)
class AidedSuite:
    """What the vehicle carries; a rate of 0 is a sensor that it does not have.

    gnss_delay : s, of position and velocity, known. gnss_velocity_delay_std: None: the velocity is as late as the
    position.
    *_std of a noise: 1 sigma of one row. *_std of a scale, delay (s), arm (m) or angle (rad): 1 sigma of the value
    that is drawn once a run and that a filter may estimate; a delay is never negative. Arms run from the IMU, body
    FRD, m.
    gnss_correlated : north east down, m, stationary sigma of a first-order Gauss-Markov process. current: N(0,
    current_std) per axis and a walk (m/s/sqrt(s)); for speed_is = "air" it is the wind. height_walk: of the barometer's
    offset, m/sqrt(s).
    start_std : position NED (m), velocity NED (m/s), roll pitch heading (rad) of the start that the filter is told.
    landmarks : beacons at known places; None: `beacons` of them on a circle around the track.
    sightings_each : fresh landmarks a picture, spread over +-picture (px); sightings_wrong: share with a wrong name.
    lidar_swing : rad, of two beams to the left and right of one straight down, taken in turn. ground_height, _relief,
    _std : m, of the ground, its hills and the map's own error; without relief the ground is flat.
    """

    gnss_hz: float = 1.0
    gnss_velocity: bool = True
    gnss_height: bool = True
    gnss_std: Arm = (1.0, 1.0, 2.0)
    gnss_velocity_std: Arm = (0.05, 0.05, 0.1)
    gnss_correlated: Arm = (0.0, 0.0, 0.0)
    gnss_correlated_tau: float = 100.0
    gnss_delay: float = 0.0
    gnss_delay_std: float = 0.0
    gnss_velocity_delay_std: float | None = None
    antenna: Arm = (0.0, 0.0, 0.0)
    antenna_std: float = 0.0
    speed_hz: float = 0.0
    speed_std: float = 0.05
    speed_scale_std: float = 0.0
    speed_arm: Arm = (0.0, 0.0, 0.0)
    speed_arm_std: float = 0.0
    speed_delay_std: float = 0.0
    speed_is: Literal["ground", "water", "air"] = "ground"
    current_std: float = 0.3
    current_walk: float = 0.0
    dvl_hz: float = 0.0
    dvl_std: float = 0.02
    dvl_scale_std: float = 0.0
    dvl_misalignment_std: float = 0.0
    dvl_arm: Arm = (0.0, 0.0, 0.0)
    dvl_arm_std: float = 0.0
    dvl_delay_std: float = 0.0
    depth_hz: float = 0.0
    depth_std: float = 0.1
    depth_bias_std: float = 0.0
    height_hz: float = 0.0
    height_std: float = 1.0
    height_bias_std: float = 0.0
    height_walk: float = 0.0
    magnetometer: Magnetometer | None = None
    year: float = YEAR
    ranges_hz: float = 0.0
    range_std: float = 0.5
    range_scale_std: float = 0.0
    range_bias_std: float = 0.0
    beacons: int = 4
    beacon_radius: float | None = None
    landmarks: Table | None = None
    camera: Camera | None = None
    sightings_hz: float = 0.0
    sightings_each: int = 6
    sightings_wrong: float = 0.0
    picture: tuple[float, float] = OESON
    lidar: Lidar | None = None
    lidar_hz: float = 0.0
    lidar_swing: float = 20.0 * DEG
    ground_height: float = 0.0
    ground_relief: float = 0.0
    ground_std: float = 0.0
    imu_to_body: Arm = (0.0, 0.0, 0.0)
    mounting_std: float = 0.0
    imu_kind: Literal["increments", "rates"] = "increments"
    start_std: tuple[float, ...] = (0.0,) * 9
    reference_hz: float = 10.0
    reference_arm: Arm = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class AidedStart:
    """The start as the filter is told it: the truth at time 0 plus errors of `AidedSuite.start_std`.

    time s; lat, lon rad; height m; v_n (3,) m/s; rpy (3,) rad; std (9,) of position, velocity (NED), rpy."""

    time: float
    lat: float
    lon: float
    height: float
    v_n: Array
    rpy: Array
    std: Array


@dataclass
class AidedRecording:
    """A simulated recording: what a filter reads, and the truth it never sees.

    tables: by name, as the contract's, in SI and radians. reference: body attitude, at time 0 and reference_hz.
    truth_states: name of a state -> (time, value). field_n (3,) T and declination (rad) at the start, with a compass.
    measured: the IMU's errors as drawn, in IMU axes.
    """

    tables: dict[str, Table]
    reference: Table
    truth_states: States
    start: AidedStart
    measured: Measured
    declination: float | None = None
    field_n: Array | None = None
    notes: list[str] = field(default_factory=list)


def simulate(
    trajectory: Trajectory, imu: ImuModel, suite: AidedSuite, rate_hz: float = 100.0, *, seed: int = 0, run: int = 0
) -> AidedRecording:
    """One recording of `suite` on `trajectory`, the IMU at rate_hz; the same (seed, run) gives the same numbers."""
    vehicle = _Vehicle(trajectory, suite, seed, run)
    for add in (_reference, _gnss, _speed, _dvl, _depth, _height, _ranges, sightings, lidar_ranges):
        add(vehicle)
    vehicle.evaluate()
    measured, tables = _imu(vehicle, imu, rate_hz)
    tables |= {name: Table(name, made(), source="simulated") for name, made in vehicle.tables.items()}
    reference = tables.pop("reference")
    if vehicle.landmarks is not None:
        tables["landmarks"] = vehicle.landmarks
    if "lidar" in tables and isinstance(vehicle.ground, HeightModel):
        tables["height_model"] = vehicle.ground.table()
    states = vehicle.states | _imu_states(vehicle, imu, measured, reference.time)
    return AidedRecording(
        tables, reference, states, _start(vehicle), measured, vehicle.declination, vehicle.field_n,
        [*trajectory.notes, *vehicle.notes],
    )  # fmt: skip


class _Vehicle:
    """The trajectory with the moments at which the sensors ask for it, evaluated in one sweep."""

    def __init__(self, trajectory: Trajectory, suite: AidedSuite, seed: int, run: int) -> None:
        self.path, self.suite, self.seed, self.run = trajectory, suite, seed, run
        self.asked: list[Array] = []
        self.seen: Truth | None = None
        self.tables: dict[str, Callable[[], dict[str, NDArray]]] = {}  # each made once the truth is evaluated
        self.states: States = {}
        self.landmarks: Table | None = None
        turn = self.drawn("imu.mounting", suite.mounting_std, tuple(f"mounting_{a}" for a in RPY))
        self.C_vb = np.asarray(dcm_from_euler(*turn))
        self.declination: float | None = None
        self.field_n: Array | None = None
        self.notes: list[str] = []
        self.ground: HeightModel | float = suite.ground_height

    def random(self, quantity: str) -> np.random.Generator:
        return stream(self.seed, self.run, quantity)

    def normal(self, quantity: str, count: int) -> Array:
        return self.random(quantity).standard_normal(count)

    def drawn(self, quantity: str, std: float, names: tuple[str, ...], offset: Array | None = None) -> Array:
        """Values drawn once a run, kept as true states where there is anything to find."""
        value = std * self.normal(quantity, len(names)) + (0.0 if offset is None else offset)
        if std > 0.0:
            ends = np.array([0.0, self.path.duration]) + self.path.start_time
            self.states |= {name: (ends, np.full(2, x)) for name, x in zip(names, value, strict=True)}
        return value

    def late(self, quantity: str, std: float, name: str, known: float = 0.0) -> float:
        """A delay beside a known one: the size of a normal number, for nothing is stamped before it happened."""
        value = float(abs(std * self.normal(quantity, 1)[0])) + known
        if std > 0.0:
            ends = np.array([0.0, self.path.duration]) + self.path.start_time
            self.states[name] = (ends, np.full(2, value))
        return value

    def moments(self, rate_hz: float, delay: float = 0.0, *others: float, first: int = 1) -> _Moments:
        """Stamps k / rate_hz whose moments, `delay` before them (and those of `others`), lie on the trajectory."""
        k = np.arange(first, int(np.floor(self.path.duration * rate_hz * (1.0 + 1e-12))) + 1)
        stamps = k / rate_hz
        late, early = max(delay, *others, delay), min(delay, *others, delay)
        kept = (stamps - late >= 0.0) & (stamps - early <= self.path.duration)
        made = _Moments(self, stamps[kept], kept, sum(len(x) for x in self.asked))
        self.asked.append(stamps[kept] - delay)
        return made

    def evaluate(self) -> None:
        self.seen = self.path.at(np.concatenate(self.asked))


class _Moments:
    """The truth at the moments of one sensor. kept: which of all its epochs are rows."""

    def __init__(self, vehicle: _Vehicle, stamps: Array, kept: NDArray[np.bool_], begin: int) -> None:
        self.vehicle, self.kept = vehicle, kept
        self.time = stamps + vehicle.path.start_time
        self.rows = slice(begin, begin + len(stamps))

    def of(self, name: str) -> Array:
        seen = self.vehicle.seen
        assert seen is not None
        return np.asarray(getattr(seen, name)[self.rows])

    def place(self, arm: Array) -> tuple[Array, Array, Array, Array, Array]:
        """lat, lon, height, v_n of a point of the body, and its velocity in b; `arm` (3,) from the IMU."""
        earth = self.vehicle.path.earth
        lat, lon, height, v_n = (self.of(x) for x in ("lat", "lon", "height", "v_n"))
        C = self.C_nb
        if not np.any(arm):
            return lat, lon, height, v_n, np.einsum("nji,nj->ni", C, v_n)
        v_b = np.einsum("nji,nj->ni", C, v_n) + np.cross(self.rate, arm)
        lat, lon, height = moved(earth, lat, lon, height, C @ arm)
        return lat, lon, height, np.einsum("nij,nj->ni", C, v_b), v_b

    @property
    def C_nb(self) -> Array:
        """(n, 3, 3): the vehicle's attitude, and the mounting."""
        return np.asarray(dcm_from_quat(self.of("q_nb")) @ self.vehicle.C_vb)

    def truth(self) -> Truth:
        """Place and attitude of the body, with the stamps as times; rates and forces left out."""
        none = np.empty((len(self.time), 0))
        lat, lon, height, v_n = (self.of(k) for k in ("lat", "lon", "height", "v_n"))
        return Truth(self.time, lat, lon, height, v_n, quat_from_dcm(self.C_nb), none, none)

    @property
    def rate(self) -> Array:
        """w_eb_b (n, 3): the body against the Earth."""
        w_ie_n = self.vehicle.path.earth.earth_rate_n(self.of("lat"))
        return self.of("w_ib_b") @ self.vehicle.C_vb - np.einsum("nji,nj->ni", self.C_nb, w_ie_n)


def moved(earth: Ellipsoid, lat: Array, lon: Array, height: Array, ned: Array) -> tuple[Array, Array, Array]:
    """The place (rad, m) at offsets ned (n, 3), m; longitude in (-pi, pi]."""
    R_N, R_E = earth.radii(lat)
    east = lon + ned[:, 1] / ((R_E + height) * np.cos(lat))
    return lat + ned[:, 0] / (R_N + height), _wrap(east), height - ned[:, 2]


def _wrap(lon: Array) -> Array:
    return np.asarray(lon - 2.0 * pi * np.ceil((lon - pi) / (2.0 * pi)))


def _reference(v: _Vehicle) -> None:
    m = v.moments(v.suite.reference_hz, first=0)

    def rows() -> dict[str, Array]:
        lat, lon, height, v_n, _ = m.place(np.array(v.suite.reference_arm))
        roll, pitch, heading = euler_from_dcm(m.C_nb)
        columns = {"time": m.time, "lat": lat, "lon": lon, "height": height}
        columns |= {f"v_{a}": v_n[:, i].copy() for i, a in enumerate(NED)}
        return columns | {"roll": roll, "pitch": pitch, "heading": np.mod(heading, 2.0 * pi)}

    v.tables["reference"] = rows


def _gnss(v: _Vehicle) -> None:
    s = v.suite
    if s.gnss_hz <= 0.0:
        return
    delay = v.late("gnss.delay", s.gnss_delay_std, "gnss_delay", s.gnss_delay)
    arm = v.drawn("gnss.lever", s.antenna_std, tuple(f"antenna_lever_{a}" for a in "xyz"), np.array(s.antenna))
    later = delay
    if s.gnss_velocity_delay_std is None and s.gnss_delay_std > 0.0:
        v.states["gnss_velocity_delay"] = v.states["gnss_delay"]
    if s.gnss_velocity_delay_std is not None:
        later = v.late("gnss.velocity_delay", s.gnss_velocity_delay_std, "gnss_velocity_delay", s.gnss_delay)
    m, moving = v.moments(s.gnss_hz, delay, later), v.moments(s.gnss_hz, later, delay)
    n = len(m.kept)
    slow = Walk(v.random("gnss.correlated"), np.array(s.gnss_correlated), s.gnss_correlated_tau, 1.0 / s.gnss_hz)
    bias = slow.advance(n)[m.kept]
    error = (v.random("gnss.white").standard_normal((n, 3)) * s.gnss_std)[m.kept] + bias
    v_error = (v.random("gnss.velocity").standard_normal((n, 3)) * s.gnss_velocity_std)[m.kept]
    if slow.active:
        v.states |= {f"gnss_bias_{a}": (m.time, bias[:, i].copy()) for i, a in enumerate(NED)}

    def rows() -> dict[str, Array]:
        lat, lon, height = moved(v.path.earth, *m.place(arm)[:3], error)
        columns = {"time": m.time, "lat": lat, "lon": lon}
        if s.gnss_height:
            columns["height"] = height
        if s.gnss_velocity:
            v_n = moving.place(arm)[3]
            columns |= {f"v_{a}": v_n[:, i] + v_error[:, i] for i, a in enumerate(NED)}
        return columns

    v.tables["gnss"] = rows


def _speed(v: _Vehicle) -> None:
    s = v.suite
    if s.speed_hz <= 0.0:
        return
    scale = float(v.drawn("speed.scale", s.speed_scale_std, ("speed_scale",))[0])
    delay = v.late("speed.delay", s.speed_delay_std, "speed_delay")
    arm = v.drawn("speed.lever", s.speed_arm_std, tuple(f"speed_lever_{a}" for a in "xyz"), np.array(s.speed_arm))
    m = v.moments(s.speed_hz, delay)
    n = len(m.kept)
    current = np.zeros((n, 2))
    if s.speed_is != "ground":
        walk = Walk(v.random("current.walk"), np.full(2, s.current_walk), None, 1.0 / s.speed_hz)
        current = s.current_std * v.normal("current", 2) + walk.advance(n)
        v.states |= {f"current_{a}": (m.time, current[m.kept, i]) for i, a in enumerate(NED[:2])}
    noise = (s.speed_std * v.normal("speed.noise", n))[m.kept]

    def rows() -> dict[str, Array]:
        *_, v_b = m.place(arm)
        C = dcm_from_quat(m.of("q_nb"))  # of the vehicle's own axes
        axial = v_b @ v.C_vb[0] - C[:, 0, 0] * current[m.kept, 0] - C[:, 1, 0] * current[m.kept, 1]
        return {"time": m.time, "speed": (1.0 + scale) * axial + noise}

    v.tables["speed"] = rows


def _dvl(v: _Vehicle) -> None:
    s = v.suite
    if s.dvl_hz <= 0.0:
        return
    scale = float(v.drawn("dvl.scale", s.dvl_scale_std, ("dvl_scale",))[0])
    delay = v.late("dvl.delay", s.dvl_delay_std, "dvl_delay")
    arm = v.drawn("dvl.lever", s.dvl_arm_std, tuple(f"dvl_lever_{a}" for a in "xyz"), np.array(s.dvl_arm))
    turn = v.drawn("dvl.misalignment", s.dvl_misalignment_std, tuple(f"dvl_misalignment_{a}" for a in "xyz"))
    m = v.moments(s.dvl_hz, delay)
    noise = (s.dvl_std * v.random("dvl.noise").standard_normal((len(m.kept), 3)))[m.kept]

    def rows() -> dict[str, Array]:
        *_, v_b = m.place(arm)
        seen = (1.0 + scale) * (v_b @ dcm_from_euler(*turn)) + noise  # f_b = C f_dvl
        return {"time": m.time} | {f"v_{a}": seen[:, i].copy() for i, a in enumerate("xyz")}

    v.tables["dvl"] = rows


def _depth(v: _Vehicle) -> None:
    s = v.suite
    if s.depth_hz <= 0.0:
        return
    m = v.moments(s.depth_hz)
    noise = (s.depth_std * v.normal("depth.noise", len(m.kept)))[m.kept]
    bias = float(v.drawn("depth.bias", s.depth_bias_std, ("depth_bias",))[0])  # ellipsoidal height of its zero
    v.tables["depth"] = lambda: {"time": m.time, "depth": bias - m.of("height") + noise}


def _height(v: _Vehicle) -> None:
    s = v.suite
    if s.height_hz <= 0.0:
        return
    m = v.moments(s.height_hz)
    walk = Walk(v.random("height.walk"), np.array([s.height_walk]), None, 1.0 / s.height_hz)
    bias = (s.height_bias_std * v.normal("height.bias", 1) + walk.advance(len(m.kept))[:, 0])[m.kept]
    noise = (s.height_std * v.normal("height.noise", len(m.kept)))[m.kept]
    if s.height_bias_std > 0.0 or walk.active:
        v.states["height_bias"] = (m.time, bias)
    v.tables["height"] = lambda: {"time": m.time, "height": m.of("height") + bias + noise}


def _ranges(v: _Vehicle) -> None:
    s = v.suite
    if s.ranges_hz <= 0.0:
        return
    v.landmarks = s.landmarks or _beacons(v)
    scale = float(v.drawn("range.scale", s.range_scale_std, ("range_scale",))[0])
    bias = float(v.drawn("range.bias", s.range_bias_std, ("range_bias",))[0])
    m = v.moments(s.ranges_hz)
    count = len(v.landmarks)
    noise = (s.range_std * v.random("range.noise").standard_normal((len(m.kept), count)))[m.kept]
    points = v.path.earth.ecef_from_geodetic(v.landmarks["lat"], v.landmarks["lon"], v.landmarks["height"])

    def rows() -> dict[str, NDArray]:
        assert v.landmarks is not None
        here = v.path.earth.ecef_from_geodetic(m.of("lat"), m.of("lon"), m.of("height"))
        true = np.linalg.norm(here[:, None, :] - points[None], axis=2)
        seen = (1.0 + scale) * true + bias + noise
        n = len(m.time)
        return {
            "time": np.repeat(m.time, count),
            "id": np.tile(v.landmarks["id"], n),
            "range": np.maximum(seen, 1e-3).ravel(),  # an error never makes a distance negative
        }

    v.tables["ranges"] = rows


def _beacons(v: _Vehicle) -> Table:
    """`beacons` points around the middle of the track, at a drawn bearing, near the lowest height of the track."""
    s, path = v.suite, v.path
    if s.beacons < 1:
        raise InputError(f"{s.beacons} beacons: ranges need at least one")
    seen = path.at(np.linspace(0.0, path.duration, 200))
    R_N, R_E = (float(r) for r in path.earth.radii(path.lat))
    north = (seen.lat - path.lat) * R_N
    east = np.asarray(-_wrap(path.lon - seen.lon) * R_E * np.cos(path.lat))
    middle = 0.5 * (north.min() + north.max()), 0.5 * (east.min() + east.max())
    extent = float(np.max(np.hypot(north - middle[0], east - middle[1])))
    radius = s.beacon_radius if s.beacon_radius is not None else max(0.8 * extent, 20.0)
    rng = v.random("beacons")
    bearing = 2.0 * pi * (rng.random() + np.arange(s.beacons) / s.beacons)
    up = float(seen.height.min()) + rng.uniform(2.0, 6.0, s.beacons)
    k = s.beacons
    ned = np.column_stack([middle[0] + radius * np.cos(bearing), middle[1] + radius * np.sin(bearing), np.zeros(k)])
    lat, lon, _ = moved(path.earth, np.full(k, path.lat), np.full(k, path.lon), np.zeros(k), ned)
    names = np.array([f"beacon-{i + 1}" for i in range(k)])
    return Table("landmarks", {"id": names, "lat": lat, "lon": lon, "height": up}, source="simulated")


def _start(v: _Vehicle) -> AidedStart:
    std = np.asarray(v.suite.start_std, dtype=np.float64)
    error = std * v.normal("start", 9)
    true = v.path.at(0.0)
    rpy = np.array([float(x[0]) for x in euler_from_dcm(dcm_from_quat(true.q_nb) @ v.C_vb)]) + error[6:]
    lat, lon, height = moved(v.path.earth, true.lat, true.lon, true.height, error[None, :3])
    rpy[2] = np.mod(rpy[2], 2.0 * pi)
    v_n = true.v_n[0] + error[3:6]
    return AidedStart(float(true.time[0]), float(lat[0]), float(lon[0]), float(height[0]), v_n, rpy, std)


def _imu(v: _Vehicle, imu: ImuModel, rate_hz: float) -> tuple[Measured, dict[str, Table]]:
    """The imu table in IMU axes, with the magnetometer where there is one."""
    s = v.suite
    ideal = v.path.ideal(rate_hz, every=1 if s.magnetometer is not None else max(1, round(rate_hz)))
    C = v.C_vb @ dcm_from_euler(*s.imu_to_body)
    if not np.array_equal(C, np.eye(3)):
        ideal = replace(ideal, dtheta=ideal.dtheta @ C, dv=ideal.dv @ C)  # f_vehicle = C f_imu
    measured = measure(ideal, imu, seed=v.seed, run=v.run)
    table = measured.table(s.imu_kind)
    if s.magnetometer is None:
        return measured, {"imu": table}
    columns = dict(table.columns) | _compass(v, s.magnetometer, ideal.truth, C, 1.0 / rate_hz)
    return measured, {"imu": Table("imu", columns, kind=table.kind, source=table.source)}


def _compass(v: _Vehicle, m: Magnetometer, truth: Truth, C: Array, dt: float) -> dict[str, Array]:
    """mag_x.. (T) in IMU axes: the field of WMM along the track, offset, hard iron and noise of the instrument.

    The hard iron is a true state in body axes.
    """
    start, field_n = along(v.path, truth, v.suite.year)
    v.field_n = start
    v.declination = float(np.arctan2(start[1], start[0]))
    # A field turned counter-clockwise about the vertical, as rock or a wrong declination turns it: heading + offset is
    # read at any bank.
    offset = float(v.drawn("mag.bias", m.bias_deg * DEG, ("heading_offset",))[0])
    turned_n = field_n @ np.asarray(dcm_from_euler(0.0, 0.0, offset))
    seen_v = np.einsum("nji,nj->ni", dcm_from_quat(truth.q_nb), turned_n)
    iron = v.drawn("mag.hard_iron", m.hard_iron_ut * 1e-6, tuple(f"mag_bias_{a}" for a in "xyz"))
    iron = iron @ dcm_from_euler(*v.suite.imu_to_body)
    horizontal = float(np.hypot(start[0], start[1]))
    noise = Walk(v.random("mag.noise"), np.full(3, m.noise_deg * DEG * horizontal), m.tau_s, dt).advance(len(truth))
    seen = seen_v @ C + iron + noise
    return {f"mag_{a}": np.ascontiguousarray(seen[:, i]) for i, a in enumerate("xyz")}


def along(path: Trajectory, truth: Truth, year: float) -> tuple[Array, Array]:
    """The magnetic field (T, NED) at the start (3,) and along the truth (n, 3)."""
    from schuler.ground.fields import magnetic_field

    speed = float(np.max(np.linalg.norm(truth.v_n, axis=1)))
    count = int(np.ceil(path.duration * speed / FIELD_STEP)) + 1
    at = np.unique(np.linspace(0, len(truth) - 1, min(count + 1, len(truth))).round().astype(int))
    known = magnetic_field(truth.lat[at], truth.lon[at], truth.height[at], year)
    field_n = np.column_stack([np.interp(truth.time, truth.time[at], known[:, i]) for i in range(3)])
    return magnetic_field(path.lat, path.lon, path.height, year), field_n


def _imu_states(v: _Vehicle, imu: ImuModel, measured: Measured, time: Array) -> States:
    """Biases, scales and misalignments as drawn, turned into the axes that imu_to_body gives."""
    C = np.asarray(dcm_from_euler(*v.suite.imu_to_body))
    rows = np.clip(np.searchsorted(measured.time, time - 1e-9), 0, len(measured.time) - 1)
    ends = np.array([0.0, v.path.duration]) + v.path.start_time
    states: States = {}
    models = (
        ("gyro", measured.bias_gyro, measured.M_gyro, imu.gyro_scale, imu.gyro_misalignment),
        ("accel", measured.bias_accel, measured.M_accel, imu.accel_scale, imu.accel_misalignment),
    )
    for name, bias, M, scale, misalignment in models:
        turned = bias[rows] @ C.T
        states |= {f"{name}_bias_{a}": (time, turned[:, i].copy()) for i, a in enumerate("xyz")}
        E = C @ (M - np.eye(3)) @ C.T
        for i, a in enumerate("xyz"):
            for j, b in enumerate("xyz"):
                if i == j and np.any(scale > 0.0):
                    states[f"{name}_scale_{a}"] = (ends, np.full(2, E[i, i]))
                elif i != j and misalignment > 0.0:
                    states[f"{name}_misalignment_{a}{b}"] = (ends, np.full(2, E[i, j]))
    return states
