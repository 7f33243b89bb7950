"""Initial attitude: levelling and gyrocompassing from a base that stands still or sways in place.

NED, body FRD, SI and radians. phi: C_hat = (I - [phi x]) C, so that roll, pitch and heading errors come from -phi.
Coarse: the thesis's (2.2), (2.9) put right, and TRIAD (Black 1964), from mean specific force and rate; or, on a swaying
base, Wahba's problem for gravity seen in inertially fixed axes. Fine: a Kalman filter in `alignment_filter`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import OMEGA, WGS84, Ellipsoid
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_rotvec

Array = NDArray[np.float64]
# Above this 1 sigma of the gyrocompass heading (rad) a gyro is called too poor to find north.
POOR = math.radians(10.0)


def angles_from_gravity_and_rate(g_b: ArrayLike, w_b: ArrayLike, lat: float, omega: float = OMEGA) -> Array:
    """(2.2) and (2.9) put right, in the thesis's frames: (..., 3) psi (counter-clockwise), theta, gamma.

    g_b (..., 3): gravity vector in body axes (right, forward, up), w_b (..., 3): Earth rate there. |g| is taken from
    g_b.
    """
    g_, w = np.asarray(g_b, dtype=np.float64), np.asarray(w_b, dtype=np.float64)
    g = np.linalg.norm(g_, axis=-1)
    theta = np.arctan2(-g_[..., 1], np.hypot(g_[..., 0], g_[..., 2]))  # asin(-g_y/g), good near 90 deg too
    gamma = np.arctan2(g_[..., 0], -g_[..., 2])
    psi = np.arctan2(
        w[..., 2] * g_[..., 0] - w[..., 0] * g_[..., 2], w[..., 1] * g + omega * math.sin(lat) * g_[..., 1]
    )
    return np.stack([psi, theta, gamma], axis=-1)


def triad(f_b: ArrayLike, w_b: ArrayLike) -> Array:
    """C_nb (..., 3, 3) from mean specific force and mean rate of a still base; needs neither |g| nor latitude."""
    f, w = np.asarray(f_b, dtype=np.float64), np.asarray(w_b, dtype=np.float64)
    up = f / np.linalg.norm(f, axis=-1, keepdims=True)
    east = np.cross(w, up)
    size = np.linalg.norm(east, axis=-1, keepdims=True)
    if np.any(size < 1e-12):
        raise InputError("the rate is along gravity: at a pole, or without any rate, heading cannot be found")
    east = east / size
    north = np.cross(up, east)
    return np.stack([north, east, -up], axis=-2)


def coarse_sensitivity(C_nb: ArrayLike, lat: float, g: float = 9.80665, omega: float = OMEGA) -> Array:
    """J (3, 6) with phi = J (accelerometer errors in b, gyro errors in b) for `triad`: (2.10)-(2.13) at any attitude.

    phi_N = df_E/g, phi_E = -df_N/g, phi_D = dw_E/(Om cos lat) - tan(lat) phi_N.
    """
    C = np.asarray(C_nb, dtype=np.float64)
    J = np.zeros((3, 6))
    J[0, :3] = C[1] / g
    J[1, :3] = -C[0] / g
    J[2, 3:] = C[1] / (omega * math.cos(lat))
    J[2, :3] = -math.tan(lat) * J[0, :3]
    return J


def rpy_from_phi(rpy: ArrayLike) -> Array:
    """E (3, 3): errors of roll, pitch, heading = E phi at that attitude (not at pitch 90 deg)."""
    _, pitch, heading = np.asarray(rpy, dtype=np.float64)
    c, s = math.cos(heading), math.sin(heading)
    return -np.array(
        [[c / math.cos(pitch), s / math.cos(pitch), 0.0], [-s, c, 0.0], [c * math.tan(pitch), s * math.tan(pitch), 1.0]]
    )


def coarse_covariance(
    C_nb: ArrayLike, rpy: ArrayLike, lat: float, accel_std: ArrayLike, gyro_std: ArrayLike, g: float = 9.80665
) -> Array:
    """(3, 3) covariance of roll, pitch, heading by `triad` for independent sensor errors (1 sigma, m/s^2 and rad/s)."""
    J = rpy_from_phi(rpy) @ coarse_sensitivity(C_nb, lat, g)
    std = np.concatenate([np.broadcast_to(accel_std, 3), np.broadcast_to(gyro_std, 3)])
    return J @ np.diag(std**2) @ J.T


def thesis_sensitivity(psi: float, lat: float, dw: ArrayLike, dg: ArrayLike, omega: float = OMEGA) -> float:
    """(2.11)-(2.13) put right: error of psi (counter-clockwise) by (2.9) on a level body, rad.

    dw (3,) rad/s; dg (3,) in units of g, errors of the gravity components. The dg_z term is there only because (2.9)
    uses |g|; TRIAD has none.
    """
    w, a = np.asarray(dw, dtype=np.float64), np.asarray(dg, dtype=np.float64)
    c, s = math.cos(psi), math.sin(psi)
    return float((c * w[0] - s * w[1]) / (omega * math.cos(lat)) + math.tan(lat) * (c * a[0] - s * a[1]) - s * c * a[2])


def heading_floor(drift: ArrayLike, lat: float, omega: float = OMEGA) -> Array:
    """1 sigma heading, rad, that an east gyro drift (rad/s) leaves at latitude lat."""
    return np.asarray(drift, dtype=np.float64) / (omega * math.cos(lat))


@dataclass(frozen=True)
class SensorErrors:
    """What is known of the IMU, 1 sigma per axis: constant biases (m/s^2, rad/s), white noise (m/s/sqrt(s),
    rad/sqrt(s)), wander of the gyro bias (rad/s/sqrt(s)); scale (ratio) and misalignment (rad) of the accelerometers,
    g-sensitivity of the gyros (rad/s per m/s^2)."""

    accel_bias: Array
    gyro_bias: Array
    vrw: Array
    arw: Array
    gyro_walk: Array = field(default_factory=lambda: np.zeros(3))
    accel_scale: Array = field(default_factory=lambda: np.zeros(3))
    accel_misalignment: Array = field(default_factory=lambda: np.zeros(3))
    gyro_g_sensitivity: Array = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def of(
        cls, *, accel_bias: ArrayLike = 0.0, gyro_bias: ArrayLike = 0.0, vrw: ArrayLike = 0.0, arw: ArrayLike = 0.0,
        gyro_walk: ArrayLike = 0.0, accel_scale: ArrayLike = 0.0, accel_misalignment: ArrayLike = 0.0,
        gyro_g_sensitivity: ArrayLike = 0.0,
    ) -> SensorErrors:  # fmt: skip
        """One number or three for each."""
        return cls(
            *(np.broadcast_to(np.asarray(x, dtype=np.float64), 3).copy()
              for x in (accel_bias, gyro_bias, vrw, arw, gyro_walk, accel_scale, accel_misalignment,
                        gyro_g_sensitivity))
        )  # fmt: skip

    def at_rest(self, f_b: ArrayLike) -> SensorErrors:
        """The same under a steady specific force f_b (3,) m/s^2, in which whatever grows with it is a constant bias of
        each axis too. What the Earth's rate makes of the gyros' own scale is far below their bias and left out."""
        f2 = np.asarray(f_b, dtype=np.float64) ** 2
        accel = self.accel_bias**2 + self.accel_scale**2 * f2 + self.accel_misalignment**2 * (f2.sum() - f2)
        gyro = self.gyro_bias**2 + self.gyro_g_sensitivity**2 * f2.sum()
        return SensorErrors(np.sqrt(accel), np.sqrt(gyro), self.vrw, self.arw, self.gyro_walk)


@dataclass(frozen=True)
class Alignment:
    """An attitude found. rpy (3,) rad at `to`; cov (3, 3) rad^2 of roll, pitch, heading; gyro_bias (3,) rad/s or None.

    history : time (n,) s and std (n, 3) rad of roll, pitch, heading while it was found.
    floor : 1 sigma of the heading that the constant gyro bias leaves, rad. useful : s after which more time stops
    helping
    (heading sigma within a tenth of the best it can become), None where that was not reached.
    """

    method: str
    start: float
    to: float
    rpy: Array
    C_nb: Array
    cov: Array
    gyro_bias: Array | None
    accel_bias: Array | None
    floor: float
    useful: float | None
    history_time: Array
    history_std: Array
    notes: list[str]

    @property
    def std(self) -> Array:
        """(3,) rad."""
        return np.sqrt(np.diag(self.cov))


def inertial_coarse(
    dtheta: Array, dv: Array, dt: Array, lat: float, *, earth: Ellipsoid = WGS84, height: float = 0.0, windows: int = 60
) -> Array:
    """C_nb (3, 3) at the first instant, from a base that may rock: gravity in inertially fixed axes turns with the
    Earth.

    The gyros carry the body into its own axes at the start; the specific force there, summed over windows, is matched
    with the gravity that the Earth carries round (Wahba's problem by singular values).
    """
    from schuler.kernels import alignment as kernel

    V = np.empty((len(dtheta), 3))
    kernel.force_in_start_axes(np.ascontiguousarray(dtheta), np.ascontiguousarray(dv), V)
    t = np.cumsum(dt)
    edges = np.unique(np.linspace(0, len(t), windows + 1).round().astype(int))[1:] - 1
    seen = np.diff(np.vstack([np.zeros(3), V[edges]]), axis=0)
    ends = np.concatenate([[0.0], t[edges]])
    # minus gravity in n-axes of the start, turned by the Earth: mean over each window
    axis = np.array([math.cos(lat), 0.0, -math.sin(lat)])
    up = np.array([0.0, 0.0, -1.0])
    om = earth.omega
    first, second = np.diff(ends), np.diff(np.sin(om * ends)) / om
    third = -np.diff(np.cos(om * ends)) / om
    along = (up @ axis) * axis
    expected = np.outer(first, along) + np.outer(second, up - along) + np.outer(third, np.cross(axis, up))
    # Wahba with the direction of gravity known far better than its turn: level first, then heading about it
    level = _least_rotation(seen, expected)
    return level


def _least_rotation(seen: Array, expected: Array) -> Array:
    """C (3, 3) with expected = C seen, least squares over unit vectors."""
    a = seen / np.linalg.norm(seen, axis=1)[:, None]
    b = expected / np.linalg.norm(expected, axis=1)[:, None]
    U, _, Vt = np.linalg.svd(b.T @ a)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt)


def level_only(
    dtheta: Array, dv: Array, dt: Array, sensor: SensorErrors, heading: float, heading_std: float, g: float
) -> tuple[Array, Array, Array]:
    """rpy (3,), covariance (3, 3) and gyro bias (3,) = mean rate (Earth rate, unknown in direction, left in), still
    base."""
    T = float(dt.sum())
    f, w = dv.sum(axis=0) / T, dtheta.sum(axis=0) / T
    roll, pitch = math.atan2(-f[1], -f[2]), math.atan2(f[0], math.hypot(f[1], f[2]))
    std = np.sqrt(sensor.accel_bias**2 + sensor.vrw**2 / T)
    J = np.zeros((3, 3))
    c = math.hypot(f[1], f[2])
    J[0] = [0.0, -f[2] / c**2, f[1] / c**2]
    J[1] = np.array([c, -f[0] * f[1] / c, -f[0] * f[2] / c]) / float(f @ f)
    cov = J @ np.diag(std**2) @ J.T
    cov[2, 2] = heading_std**2
    return np.array([roll, pitch, heading]), cov, w


def find_still(time: Array, dtheta: Array, dv: Array, dt: Array, *, shortest: float = 5.0) -> tuple[float, float]:
    """(from, to) s of the first stretch in which nothing but noise moves; InputError where there is none."""
    width = max(1, int(0.5 / float(np.median(dt))))
    n = len(time) // width
    if n < 2:
        raise InputError("the recording is shorter than a second: no still stretch to align on")
    rate = (dtheta / dt[:, None])[: n * width].reshape(n, width, 3)
    force = (dv / dt[:, None])[: n * width].reshape(n, width, 3)
    w_noise, f_noise = np.linalg.norm(rate.std(axis=1), axis=1), np.linalg.norm(force.std(axis=1), axis=1)
    # How quiet this sensor can be, from its quietest tenth; a turn or an acceleration shows against it.
    quiet_w, quiet_f = np.quantile(w_noise, 0.1), np.quantile(f_noise, 0.1)
    mean = rate.mean(axis=1)
    centre = np.median(mean[w_noise <= np.quantile(w_noise, 0.2)], axis=0)
    still = (w_noise < min(3.0 * quiet_w + 2e-3, 0.1)) & (f_noise < min(3.0 * quiet_f + 0.02, 2.0))
    still &= np.linalg.norm(mean - centre, axis=1) < min(3.0 * quiet_w + 5e-3, 0.03)  # rocking is not still
    need = max(1, math.ceil(shortest / (width * float(np.median(dt)))))
    run = 0
    for i in range(n + 1):
        if i < n and still[i]:
            run += 1
            continue
        if run >= need:
            return float(time[(i - run) * width] - dt[0]), float(time[i * width - 1])
        run = 0
    raise InputError(
        f"no still stretch of {shortest:g} s or more in this recording: give [align] from_s and to_s, or align in "
        f"motion"
    )


def carried(C_nb: Array, dtheta: Array, lat: float, T: float, earth: Ellipsoid = WGS84) -> Array:
    """C_nb (3, 3) after the increments dtheta (n, 3) over T s in place."""
    from schuler.kernels import alignment as kernel

    q = np.array([1.0, 0.0, 0.0, 0.0])
    kernel.turn(np.ascontiguousarray(dtheta), q)
    from schuler.ground.frames import dcm_from_quat

    back = dcm_from_rotvec(-np.array([math.cos(lat), 0.0, -math.sin(lat)]) * earth.omega * T)
    return np.asarray(back @ C_nb @ dcm_from_quat(q))
