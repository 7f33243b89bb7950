"""Stable-platform navigation: a case, the algorithms run on it, and what the platform does meanwhile.

Frames: mN north, west, up along minus the mass attraction; psi counts from north to WEST (compass heading = -psi);
S the platform, C_mNS = C3(psi) C2(phi_y) C1(phi_x); error = estimate - truth. Signs of the errors put in:
rate of the real platform = (1 + scale) command + drift; measured force = (1 + scale) f - bias (the paper's sign);
a strapdown gyro measures true rate + drift, so that its position error has the opposite sign of a platform's.
Sources: Ghesmati et al. (equations (9)-(28), corrected, see docs/platform.md); Pitman (1962) for free azimuth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import GM, OMEGA, WGS84
from schuler.ground.errors import InputError
from schuler.ground.frames import quat_conjugate, quat_multiply, quat_rotate
from schuler.truth.platform import J2, geodetic_from_mass

Array = NDArray[np.float64]

RADIUS = 6.371e6  # m, R_G of the commands
GRAVITY = GM / RADIUS**2  # g_i, mass attraction
SCHULER = math.sqrt(GM / RADIUS**3)  # w_s, rad/s
ALGORITHMS = ("position-independent", "free-azimuth", "strapdown", "strapdown-open-loop", "as-published")
FORMS = ("exact", "corrected", "literal")
ANGLE_LIMIT = math.radians(80.0)  # beyond, latitude and longitude give way to direction cosines
RAMP_STEPS = 400.0  # RK4 misses a quintic ramp to the speed v by v/4 over the fourth power of this
MOST_NODES = 40000
STEP = 5.0  # s; the drift-free exact form stays below 1e-5 m in 2 h of fast flight


@dataclass(frozen=True)
class PlatformCase:
    """What happens and what is wrong. SI and radians; pairs and triples are along the platform axes 1, 2, 3.

    lat : mass latitude at the start (geocentric on the sphere). heading : psi_0, from north to west.
    lat_change, lon_change : over the whole duration, at constant rates after start_ramp (0: impulsive).
    height, height_change : above the figure of the Earth; z of the commands follows.
    drift, drift_ramp : rad/s, rad/s^2. accel_bias : measured = f - bias. gimbal_bias : of the azimuth gimbal.
    drift_carried : the drift was there during alignment, so that the integrators hold its opposite at the start.
    known_rates : the position-independent algorithm's p, q start from the known Earth rate instead of the command.
    z_scale : z of the commands, R_GMM = 1/(k_I k_G k_F), over the true one; the algorithm takes the command as it is.
    tilt : rotation of the platform at the start (phi_x, phi_y, psi) beyond what alignment leaves.
    velocity_error : at the start, along axes 1 and 2 of the platform.
    """

    lat: float
    lon: float = 0.0
    heading: float = 0.0
    lat_change: float = 0.0
    lon_change: float = 0.0
    duration: float = 7200.0
    start_ramp: float = 0.0
    height: float = 0.0
    height_change: float = 0.0
    earth: str = "sphere"
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_ramp: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float] = (0.0, 0.0)
    accel_scale: tuple[float, float] = (0.0, 0.0)
    torquer_scale: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gimbal_bias: float = 0.0
    drift_carried: bool = False
    known_rates: bool = False
    z_scale: float = 1.0
    tilt: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity_error: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        lowest = RADIUS + min(self.height, self.height + self.height_change)
        if lowest <= 0.0 or self.z_scale <= 0.0:
            z = lowest * self.z_scale
            raise InputError(
                f"z, the distance from the Earth's centre that the commands divide by, is {z:.6g} m; it must be "
                f"positive: a height lies above {-RADIUS:.6g} m, in metres."
            )
        if not self.duration > 0.0:
            raise InputError(f"The duration is {self.duration:g} s; it must be positive.")
        if not 0.0 <= self.start_ramp <= self.duration:
            raise InputError(f"The start ramp of {self.start_ramp:g} s does not fit into {self.duration:g} s.")
        if self.earth not in ("sphere", "ellipsoid"):
            raise InputError(f'The figure of the Earth is "{self.earth}"; it is "sphere" or "ellipsoid".')

    def without_errors(self) -> PlatformCase:
        """The same motion and start with perfect instruments."""
        clean = PlatformCase(lat=self.lat)
        names = ("drift", "drift_ramp", "accel_bias", "accel_scale", "torquer_scale", "gimbal_bias", "z_scale", "tilt")
        return replace(self, velocity_error=(0.0, 0.0), **{n: getattr(clean, n) for n in names})

    @cached_property
    def vector(self) -> Array:
        """The case as the kernels read it."""
        from schuler.kernels import platform_truth as k

        v = np.zeros(k.N_PAR)
        v[[k.GM, k.RADIUS, k.RATE]] = GM, RADIUS, OMEGA
        v[[k.AXIS, k.FLATTENING, k.J2]] = WGS84.a, WGS84.f, J2
        v[k.ELLIPSOID] = float(self.earth == "ellipsoid")
        v[k.LAT] = float(geodetic_from_mass(self.lat, self.height)) if self.earth == "ellipsoid" else self.lat
        v[[k.LON, k.DLAT, k.DLON, k.DURATION]] = self.lon, self.lat_change, self.lon_change, self.duration
        v[[k.RAMP, k.HEIGHT, k.DHEIGHT]] = self.start_ramp, self.height, self.height_change
        v[[k.PSI, k.PSI_BIAS]] = self.heading, self.gimbal_bias
        v[[k.BA1, k.BA2]], v[[k.KA1, k.KA2]] = self.accel_bias, self.accel_scale
        v[[k.KT1, k.KT2, k.KT3]] = self.torquer_scale
        v[[k.Z_SCALE, k.CARRIED, k.KNOWN]] = self.z_scale, float(self.drift_carried), float(self.known_rates)
        v[[k.DRIFT1, k.DRIFT2, k.DRIFT3]], v[[k.RAMP1, k.RAMP2, k.RAMP3]] = self.drift, self.drift_ramp
        v[[k.TILT1, k.TILT2, k.TILT3]], v[[k.DV1, k.DV2]] = self.tilt, self.velocity_error
        return v

    def speed(self) -> float:
        """Largest speed over ground, m/s, on the sphere of the commands."""
        t = self.duration - 0.5 * self.start_ramp
        lats = self.lat + self.lat_change * np.linspace(0.0, 1.0, 181)
        east = self.lon_change / t * np.cos(lats)
        return float((RADIUS + self.height) * np.hypot(self.lat_change / t, np.abs(east).max()))

    def command_rate(self) -> float:
        """Largest rate that the torquers of the level axes are asked for, rad/s: the level part of the inertial rate.

        The platform stands anyhow about its vertical, so that either axis may get all of it.
        """
        t = self.duration - 0.5 * self.start_ramp
        lats = self.lat + self.lat_change * np.linspace(0.0, 1.0, 181)
        still = OMEGA * math.cos(self.lat)  # alignment, before the motion begins
        return max(still, float(np.hypot(self.lat_change / t, (OMEGA + self.lon_change / t) * np.cos(lats)).max()))

    def near_pole(self) -> bool:
        """Whether the path comes so near a pole that latitude and longitude fail as states of an algorithm."""
        return max(abs(self.lat), abs(self.lat + self.lat_change)) > ANGLE_LIMIT


@dataclass
class PlatformRun:
    """One algorithm on one case; everything (n,) or (n, k) at the nodes `time`, s.

    error : great-circle position error, m; north, east : its signed parts (estimate - truth), m.
    lat, lon : computed mass latitude and longitude, rad; velocity (n, 2) north, east over ground, m/s.
    states : the kernel's states. notes : what a user should know.
    """

    case: PlatformCase
    algorithm: str
    form: str
    code: int
    time: Array
    states: Array
    error: Array
    north: Array
    east: Array
    notes: list[str] = field(default_factory=list)

    def at(self, times: ArrayLike) -> Array:
        """(k, 3) great-circle, north and east error, m, at the given times (nodes; linear between them)."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return np.column_stack([np.interp(t, self.time, x) for x in (self.error, self.north, self.east)])

    @cached_property
    def _track(self) -> Array:
        from schuler.kernels import platform as k

        out = np.empty((len(self.time), 8))
        k.track(self.code, self.case.vector, self.time, self.states, out)
        return out

    @property
    def lat(self) -> Array:
        return self._track[:, 0]

    @property
    def lon(self) -> Array:
        return self._track[:, 1]

    @property
    def velocity(self) -> Array:
        return self._track[:, 2:4]

    @property
    def has_platform(self) -> bool:
        """False for strapdown and for error models: no platform of their own moves."""
        from schuler.kernels import platform as k

        return self.code <= k.FREE_COSINES

    @property
    def q_iS(self) -> Array:
        """(n, 4) attitude of the real platform (strapdown: of the computed body)."""
        return self.states[:, :4]

    @property
    def q_iS_believed(self) -> Array:
        """(n, 4) attitude of the platform as the algorithm believes it to be."""
        return self._track[:, 4:]

    @cached_property
    def angles(self) -> Array:
        """(n, 3) phi_x, phi_y, psi of the real platform against mN at the vehicle, rad; psi unwrapped."""
        truth = truth_of(self.case, self.time)
        return platform_angles(quat_multiply(quat_conjugate(truth.q_imN), self.q_iS))


@dataclass(frozen=True)
class PlatformTruth:
    """What happens, at the nodes `time`: mass and map latitude, longitude (rad), height, velocity over ground, frames.

    lat : mass latitude. lat_geodetic : of the ellipsoid's normal (equal to `lat` on the sphere). v_ne (n, 2) north,
    east, m/s. q_imN (n, 4). force_mN (n, 3) specific force north, west, up, m/s^2.
    """

    time: Array
    lat: Array
    lat_geodetic: Array
    lon: Array
    height: Array
    v_ne: Array
    v_up: Array
    q_imN: Array
    force_mN: Array


def truth_of(case: PlatformCase, time: ArrayLike) -> PlatformTruth:
    """The motion of a case at the times, s."""
    from schuler.kernels import platform_truth as k

    t = np.atleast_1d(np.asarray(time, dtype=np.float64))
    v = case.vector
    rows = np.array([k.truth(x, v) for x in t])
    a, z, a1, z1, lat, _, lam, lam1, fa, fe, fz, dist, _ = rows.T
    mass = np.array([k.mass_latitude(x, y, v) for x, y in zip(a, z, strict=True)])
    q = np.array([k.quat_local(x, y) for x, y in zip(mass, lam, strict=True)])
    s, c = np.sin(lat), np.cos(lat)
    sm, cm = np.sin(mass), np.cos(mass)
    return PlatformTruth(
        time=t,
        lat=mass,
        lat_geodetic=lat,
        lon=lam - OMEGA * t,
        height=dist - RADIUS,
        v_ne=np.column_stack([-a1 * s + z1 * c, a * (lam1 - OMEGA)]),
        v_up=a1 * c + z1 * s,
        q_imN=q,
        force_mN=np.column_stack([-fa * sm + fz * cm, -fe, fa * cm + fz * sm]),
    )


def nodes(case: PlatformCase, step: float = STEP, at: Sequence[float] = ()) -> Array:
    """Times of the integration, s: at most `step` apart (more where there would be too many), finer in a start ramp.

    Every time of `at` within the run is among them.
    """
    step = max(step, case.duration / MOST_NODES)
    marks = {0.0, case.duration, *(float(t) for t in at if 0.0 < t < case.duration)}
    if case.start_ramp > 0.0:
        marks.add(case.start_ramp)
    edges = sorted(marks)
    parts = []
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        largest = min(step, case.start_ramp / RAMP_STEPS) if end <= case.start_ramp else step
        n = max(1, math.ceil((end - start) / largest - 1e-9))
        parts.append(start + (end - start) / n * np.arange(n))
    return np.concatenate([*parts, [case.duration]])


def drift_walk(time: Array, sigma: ArrayLike, rng: np.random.Generator) -> Array:
    """(n, 3) rad/s random walk of the drifts at the nodes; sigma (3,) rad/s/sqrt(s)."""
    steps = rng.standard_normal((len(time) - 1, 3)) * np.sqrt(np.diff(time))[:, None] * np.asarray(sigma, dtype=float)
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def code_of(algorithm: str, form: str, near_pole: bool) -> int:
    """The kernel's number of an algorithm. InputError for a name that is not known."""
    from schuler.kernels import platform as k

    codes = {
        "position-independent": {
            "exact": k.EXACT,
            "corrected": k.CORRECTED_COSINES if near_pole else k.CORRECTED,
            "literal": k.LITERAL_COSINES if near_pole else k.LITERAL,
        }.get(form),
        "free-azimuth": k.FREE_COSINES if near_pole else k.FREE,
        "strapdown": k.STRAPDOWN,
        "strapdown-open-loop": k.STRAPDOWN_OPEN,
        "as-published": k.PUBLISHED,
        "first-order": k.FIRST_ORDER,
        "first-order-tilted": k.FIRST_ORDER_TILTED,
    }
    if algorithm not in codes:
        raise InputError(f'There is no algorithm "{algorithm}"; type one of: {", ".join(codes)}.')
    code = codes[algorithm]
    if code is None:
        raise InputError(f'There is no form "{form}" of the position-independent algorithm; type {", ".join(FORMS)}.')
    return code


def navigate(
    case: PlatformCase,
    algorithm: str = "position-independent",
    form: str = "exact",
    *,
    time: Array | None = None,
    walk: Array | None = None,
    cosines: bool | None = None,
) -> PlatformRun:
    """Run one algorithm on a case.

    algorithm : one of `ALGORITHMS`, or "first-order" (the linear theory of a platform with r = 0 about the vertical) or
    "first-order-tilted" (the same about the axes of the position-independent platform). form : of the
    position-independent algorithm, one of `FORMS`. time : nodes, default `nodes(case)`. walk : see `drift_walk`.
    cosines : direction cosines instead of latitude and longitude; default: where the path comes near a pole.
    """
    from schuler.kernels import platform as k

    polar = case.near_pole() if cosines is None else cosines
    code = code_of(algorithm, form, polar)
    t = nodes(case) if time is None else np.ascontiguousarray(time, dtype=np.float64)
    added = np.zeros((len(t), 3)) if walk is None else np.ascontiguousarray(walk, dtype=np.float64)
    states = np.empty((len(t), k.N_STATE))
    k.run(code, case.vector, t, added, states)
    e = np.empty((len(t), 3))
    k.errors(code, case.vector, t, states, e)
    run = PlatformRun(case, algorithm, form, code, t, states, e[:, 0], e[:, 1], e[:, 2])
    if cosines is None and code in (k.CORRECTED_COSINES, k.LITERAL_COSINES, k.FREE_COSINES):
        run.notes.append(
            f"{algorithm}: the path comes within {math.degrees(math.pi / 2 - ANGLE_LIMIT):.0f} deg of a pole, where "
            "longitude and psi turn too fast to be states; direction cosines were used instead."
        )
    lost = ~np.isfinite(e).all(axis=1)
    if lost.any():
        raise InputError(f"{algorithm} has lost its position {t[int(np.argmax(lost))]:.0f} s on: {_TOO_LARGE}")
    return run


def errors_of(
    cases: Sequence[PlatformCase], algorithm: str, form: str, at: Sequence[float], step: float = 10.0
) -> Array:
    """(m, k, 3) great-circle, north, east error, m, of many cases at the times `at`, s, in parallel.

    The cases share duration and start ramp. Direction cosines throughout.
    """
    from schuler.kernels import platform as k

    if not cases:
        return np.empty((0, len(at), 3))
    t = nodes(cases[0], step, at)
    keep = np.zeros(len(t), dtype=np.bool_)
    wanted = [int(np.argmin(np.abs(t - x))) for x in at]
    keep[wanted] = True
    out = np.empty((len(cases), int(keep.sum()), 3))
    k.ensemble(code_of(algorithm, form, True), np.array([c.vector for c in cases]), t, keep, out)
    if not np.isfinite(out).all():
        raise InputError(f"{algorithm} has lost its position in a case of the map: {_TOO_LARGE}")
    order = {j: i for i, j in enumerate(sorted(set(wanted)))}
    return out[:, [order[j] for j in wanted], :]


def error_map(
    case: PlatformCase, lat: Array, heading: Array, algorithm: str, form: str = "exact", at: Sequence[float] = (7200.0,)
) -> Array:
    """(len(lat), len(heading), len(at)) great-circle error, m, over start latitude and platform heading, rad."""
    cases = [replace(case, lat=float(a), heading=float(h)) for a in lat for h in heading]
    return errors_of(cases, algorithm, form, at)[:, :, 0].reshape(len(lat), len(heading), len(at))


_TOO_LARGE = "the errors put in are too large for it; are they in the units that their names say?"


# --- what the gimbals see ---------------------------------------------------------------------------------------------
def platform_angles(q_mNS: ArrayLike) -> Array:
    """(n, 3) phi_x, phi_y, psi, rad, of C3(psi) C2(phi_y) C1(phi_x); psi unwrapped over the rows."""
    q0, q1, q2, q3 = np.moveaxis(np.asarray(q_mNS, dtype=np.float64), -1, 0)
    psi = np.arctan2(2.0 * (q1 * q2 + q0 * q3), q0**2 + q1**2 - q2**2 - q3**2)
    phi_y = -np.arcsin(np.clip(2.0 * (q1 * q3 - q0 * q2), -1.0, 1.0))
    phi_x = np.arctan2(2.0 * (q2 * q3 + q0 * q1), q0**2 - q1**2 - q2**2 + q3**2)
    return np.stack([phi_x, phi_y, np.unwrap(psi)], axis=-1)


def body_attitude(truth: PlatformTruth, psi: ArrayLike, roll: ArrayLike = 0.0, pitch: ArrayLike = 0.0) -> Array:
    """(n, 4) q_ib of a body (forward, left, up) at psi (from north to west), roll right, pitch up, rad."""
    p, r, n = (0.5 * np.broadcast_to(np.asarray(x, dtype=float), truth.time.shape) for x in (psi, roll, pitch))
    zero = np.zeros_like(p)
    yaw = np.stack([np.cos(p), zero, zero, np.sin(p)], axis=-1)
    nose = np.stack([np.cos(n), zero, -np.sin(n), zero], axis=-1)
    wing = np.stack([np.cos(r), np.sin(r), zero, zero], axis=-1)
    return quat_multiply(quat_multiply(quat_multiply(truth.q_imN, yaw), nose), wing)


def gimbal_angles(q_iS: ArrayLike, q_ib: ArrayLike) -> Array:
    """(n, 3) outer (roll), middle (pitch) and inner (azimuth) gimbal, rad: C_bS = C1(outer) C2(middle) C3(inner).

    For a level platform and body the inner angle is psi - psi_body. At a middle angle of +-90 deg the outer and the
    inner axis lie on one line (gimbal lock); see `gimbal_warning`.
    """
    q = quat_multiply(quat_conjugate(np.asarray(q_ib, dtype=float)), np.asarray(q_iS, dtype=float))
    x = quat_rotate(q, np.broadcast_to([1.0, 0.0, 0.0], (*q.shape[:-1], 3)))  # columns of C_bS
    y = quat_rotate(q, np.broadcast_to([0.0, 1.0, 0.0], (*q.shape[:-1], 3)))
    z = quat_rotate(q, np.broadcast_to([0.0, 0.0, 1.0], (*q.shape[:-1], 3)))
    middle = np.arcsin(np.clip(z[..., 0], -1.0, 1.0))
    return np.stack([np.arctan2(-z[..., 1], z[..., 2]), middle, np.arctan2(-y[..., 0], x[..., 0])], axis=-1)


def gimbal_warning(time: Array, angles: Array, limit: float = math.radians(75.0)) -> str | None:
    """A sentence if the middle gimbal comes within 15 deg of the lock, else None."""
    i = int(np.argmax(np.abs(angles[:, 1])))
    largest = abs(float(angles[i, 1]))
    if largest < limit:
        return None
    return (
        f"The middle gimbal reaches {math.degrees(largest):.0f} deg at {time[i]:.0f} s; at 90 deg the outer and the "
        "inner axis lie on one line and three gimbals lose the reference; they need a fourth, or less pitch."
    )


# --- metres per unit of each error ------------------------------------------------------------------------------------
_DEG_H = math.radians(1.0) / 3600.0
SENSITIVITIES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("gyro drift, axis 1", "0.01 deg/h", {"drift": (0.01 * _DEG_H, 0.0, 0.0)}),
    ("gyro drift, axis 2", "0.01 deg/h", {"drift": (0.0, 0.01 * _DEG_H, 0.0)}),
    ("gyro drift, axis 3 (azimuth)", "0.01 deg/h", {"drift": (0.0, 0.0, 0.01 * _DEG_H)}),
    ("drift ramp, axis 1", "0.01 deg/h per h", {"drift_ramp": (0.01 * _DEG_H / 3600.0, 0.0, 0.0)}),
    ("drift ramp, axis 3", "0.01 deg/h per h", {"drift_ramp": (0.0, 0.0, 0.01 * _DEG_H / 3600.0)}),
    ("accelerometer bias 1, levelled by it", "100 ug", {"accel_bias": (100e-6 * 9.80665, 0.0)}),
    ("accelerometer bias 2, levelled by it", "100 ug", {"accel_bias": (0.0, 100e-6 * 9.80665)}),
    ("accelerometer scale 1", "100 ppm", {"accel_scale": (100e-6, 0.0)}),
    ("accelerometer scale 2", "100 ppm", {"accel_scale": (0.0, 100e-6)}),
    ("torquer scale 1", "10 ppm", {"torquer_scale": (10e-6, 0.0, 0.0)}),
    ("torquer scale 2", "10 ppm", {"torquer_scale": (0.0, 10e-6, 0.0)}),
    ("azimuth at the start (gimbal bias)", "1 mrad", {"gimbal_bias": 1e-3}),
    ("tilt at the start about axis 1", "0.1 mrad", {"tilt": (1e-4, 0.0, 0.0)}),
    ("tilt at the start about axis 2", "0.1 mrad", {"tilt": (0.0, 1e-4, 0.0)}),
    ("velocity at the start along axis 1", "0.1 m/s", {"velocity_error": (0.1, 0.0)}),
    ("velocity at the start along axis 2", "0.1 m/s", {"velocity_error": (0.0, 0.1)}),
    ("z of the commands, R_GMM/z - 1", "100 ppm", {"z_scale": 1e-4}),
)


def sensitivity(
    case: PlatformCase, algorithm: str, form: str = "exact", at: Sequence[float] = (3600.0, 7200.0)
) -> list[tuple[str, str, Array]]:
    """Metres per unit of each error: (error, unit, (len(at),) m), central differences about the perfect case."""
    clean = case.without_errors()
    cases = []
    for _, _, change in SENSITIVITIES:
        for sign in (1.0, -1.0):
            values: dict[str, Any] = {
                n: tuple(sign * x for x in v) if isinstance(v, tuple) else sign * v + (n == "z_scale")
                for n, v in change.items()
            }
            cases.append(replace(clean, **values))
    e = errors_of(cases, algorithm, form, at)
    metres = 0.5 * np.hypot(e[0::2, :, 1] - e[1::2, :, 1], e[0::2, :, 2] - e[1::2, :, 2])
    return [(name, unit, m) for (name, unit, _), m in zip(SENSITIVITIES, metres, strict=True)]
