"""How sensor and start errors grow in a strapdown INS: the linear model in two forms, and closed forms at rest.

Error = estimate - truth, NED, SI and radians; C_hat = (I - [phi x]) C. phi form: x = (phi, dv, dlat, dlon, dh); psi
form:
y = (psi, dv_c, dr) with dr = (dN, dE, dD) m, theta = (dE/r, -dN/r, -tan(lat) dE/r), psi = phi - theta, dv_c = dv +
theta x v.
Sources: Britting (1971), Inertial Navigation Systems Analysis; Benson (1975), A comparison of two approaches to
pure-inertial and Doppler-inertial error analysis; Pitman (1962), Inertial Guidance, for the table of single causes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import WGS84, Ellipsoid
from schuler.ground.frames import dcm_from_quat, skew
from schuler.inertial.strapdown import Track
from schuler.truth.trajectories import Truth, earth_vector

Array = NDArray[np.float64]
VERTICAL = (5, 8)  # dv_D, dh: what an ideal height takes out


def phi_matrix(lat: float, height: float, v_n: ArrayLike, f_n: ArrayLike, earth: Ellipsoid = WGS84) -> Array:
    """F (9, 9) of the phi form at latitude, height, velocity (3,) and specific force (3,), NED.

    All elements are exact derivatives, also of radii and gravity. On a sphere this is the thesis's (2.51) with its five
    wrong elements put right: F(2,9), F(3,7), F(3,9), F(5,9), F(6,9).
    """
    from schuler.kernels import error_model as kernel

    F = np.zeros((9, 9))
    v, f = (np.array(x, dtype=np.float64) for x in (v_n, f_n))
    kernel.fill_f(earth_vector(earth), float(lat), float(height), v, f, np.zeros(8), F)
    return F


def input_matrix(C_nb: ArrayLike) -> Array:
    """B (9, 6): accelerometer errors (m/s^2), then gyro errors (rad/s), in b."""
    C = np.asarray(C_nb, dtype=np.float64)
    B = np.zeros((9, 6))
    B[0:3, 3:6] = -C
    B[3:6, 0:3] = C
    return B


def psi_matrix(lat: float, height: float, v_n: ArrayLike, f_n: ArrayLike, earth: Ellipsoid) -> Array:
    """(9, 9) of the psi form on a sphere: y = (psi, dv_c, dr)."""
    r = earth.a + height
    g = float(earth.gravity(lat, height))
    v, f = np.asarray(v_n, dtype=np.float64), np.asarray(f_n, dtype=np.float64)
    w_ie, w_en = earth.earth_rate_n(lat), earth.transport_rate_n(lat, height, v)
    M = np.zeros((9, 9))
    M[0:3, 0:3] = -skew(w_ie + w_en)
    M[3:6, 0:3] = skew(f)
    M[3:6, 3:6] = -skew(2.0 * w_ie + w_en)
    M[3:6, 6:9] = np.diag([-g / r, -g / r, 2.0 * g / r])
    M[6:9, 3:6] = np.eye(3)
    M[6:9, 6:9] = -skew(w_en)
    return M


def psi_from_phi(lat: float, height: float, v_n: ArrayLike, earth: Ellipsoid) -> Array:
    """T (9, 9) with y = T x on a sphere."""
    r = earth.a + height
    v = np.asarray(v_n, dtype=np.float64)
    to_m = np.diag([r, r * math.cos(lat), -1.0])
    theta = np.array([[0.0, 1.0 / r, 0.0], [-1.0 / r, 0.0, 0.0], [0.0, -math.tan(lat) / r, 0.0]])
    T = np.eye(9)
    T[6:9, 6:9] = to_m
    T[0:3, 6:9] = -theta @ to_m
    T[3:6, 6:9] = -skew(v) @ theta @ to_m
    return T


@dataclass(frozen=True)
class LinearErrors:
    """The linear model along a track: time (n,), x (n, 9); position (n, 3) m NED, velocity (n, 3) m/s, phi (n, 3)
    rad."""

    time: Array
    x: Array
    position: Array

    @property
    def phi(self) -> Array:
        return self.x[:, 0:3]

    @property
    def velocity(self) -> Array:
        return self.x[:, 3:6]


def propagate(
    truth: Truth | Track, *, accel_error: ArrayLike = (0.0, 0.0, 0.0), gyro_error: ArrayLike = (0.0, 0.0, 0.0),
    phi: ArrayLike = (0.0, 0.0, 0.0), dv: ArrayLike = (0.0, 0.0, 0.0), position: ArrayLike = (0.0, 0.0, 0.0),
    earth: Ellipsoid = WGS84, held: bool = False,
) -> LinearErrors:  # fmt: skip
    """Errors along the rows of a track (at least every second or so) by the phi form.

    accel_error (m/s^2), gyro_error (rad/s): constant (3,), or (n - 1, 3) means over the steps, in b. Start errors:
    phi (3,) rad, dv (3,) m/s, position (3,) m NED. held: the vertical channel taken out (ideal height).
    """
    from schuler.kernels import error_model as kernel

    r_n, r_e = earth.radii(truth.lat)
    scale = np.column_stack([r_n + truth.height, (r_e + truth.height) * np.cos(truth.lat), -np.ones(len(truth))])
    p = np.asarray(position, dtype=np.float64) / scale[0]
    x0 = np.concatenate([np.asarray(phi, dtype=np.float64), np.asarray(dv, dtype=np.float64), p])
    if held:
        x0[list(VERTICAL)] = 0.0
    u = np.hstack([np.atleast_2d(np.asarray(a, dtype=np.float64)) for a in (accel_error, gyro_error)])
    out = np.empty((len(truth), 9))
    kernel.propagate(
        earth_vector(earth), truth.time, truth.lat, truth.height, np.ascontiguousarray(truth.v_n),
        np.ascontiguousarray(truth.q_nb), x0, u, held, out,
    )  # fmt: skip
    return LinearErrors(truth.time, out, out[:, 6:9] * scale)


@dataclass(frozen=True)
class SensorNoise:
    """What drives the covariance: white noise arw (rad/sqrt(s)), vrw (m/s/sqrt(s)); biases' sigma at the start (m/s^2,
    rad/s, 3 each), Gauss-Markov time (s, inf: constant) and steady sigma; random walk of the biases (per sqrt(s))."""

    vrw: Array
    arw: Array
    accel_bias: Array
    gyro_bias: Array
    accel_gm: Array
    gyro_gm: Array
    accel_tau: float = math.inf
    gyro_tau: float = math.inf
    accel_walk: float = 0.0
    gyro_walk: float = 0.0


def covariance(
    truth: Truth | Track, noise: SensorNoise, start_std: ArrayLike, *, earth: Ellipsoid = WGS84, held: bool = False
) -> Array:
    """(n, 9, 9) covariance of phi, dv, position in NED metres along the rows of a track (n of them, 1 to 10 s apart).

    start_std (9,): phi rad, dv m/s, position m NED. Turn-on bias and Gauss-Markov part share one bias state each where
    tau
    is finite (their variances add; both then decay with tau).
    """
    from schuler.kernels import error_model as kernel

    r_n, r_e = earth.radii(truth.lat)
    scale = np.column_stack([r_n + truth.height, (r_e + truth.height) * np.cos(truth.lat), -np.ones(len(truth))])
    P0 = np.zeros((15, 15))
    std = np.array(start_std, dtype=np.float64)
    std[6:9] /= np.abs(scale[0])
    if held:
        std[list(VERTICAL)] = 0.0
    variance = np.concatenate([noise.accel_bias**2 + noise.accel_gm**2, noise.gyro_bias**2 + noise.gyro_gm**2])
    np.fill_diagonal(P0, np.concatenate([std**2, variance]))
    # A constant turn-on bias beside a decaying one would need six states more; the slower of the two is kept.
    tau = np.array([noise.accel_tau] * 3 + [noise.gyro_tau] * 3)
    gm = np.concatenate([noise.accel_gm, noise.gyro_gm])
    turn_on = np.concatenate([noise.accel_bias, noise.gyro_bias])
    tau = np.where(turn_on > gm, math.inf, tau)
    walk = np.array([noise.accel_walk**2] * 3 + [noise.gyro_walk**2] * 3)
    walk = walk + np.where(np.isfinite(tau), 2.0 * gm**2 / tau, 0.0)
    psd = np.concatenate([noise.vrw**2, noise.arw**2])
    out = np.empty((len(truth), 15, 15))
    kernel.covariance(
        earth_vector(earth), truth.time, truth.lat, truth.height, np.ascontiguousarray(truth.v_n),
        np.ascontiguousarray(truth.q_nb), P0, psd, tau, walk, held, out,
    )  # fmt: skip
    S = np.tile(np.eye(9), (len(truth), 1, 1))
    for i in range(3):
        S[:, 6 + i, 6 + i] = scale[:, i]
    return S @ out[:, :9, :9] @ S.transpose(0, 2, 1)


@dataclass(frozen=True)
class MatrixErrors:
    """What grows with the motion, constant, 1 sigma: scale (ratio, 3 each), misalignment (rad, each element) and the
    gyros' g-sensitivity (rad/s per m/s^2, each element)."""

    accel_scale: Array
    gyro_scale: Array
    accel_misalignment: float = 0.0
    gyro_misalignment: float = 0.0
    gyro_g_sensitivity: float = 0.0


def matrix_covariance(
    truth: Truth | Track, errors: MatrixErrors, f_b: Array, w_b: Array, *, earth: Ellipsoid = WGS84, held: bool = False
) -> Array:
    """(n, 9, 9) covariance, as of `covariance`, that these errors give alone: the linear model run once for each.

    f_b, w_b (n - 1, 3): mean specific force and rate between the rows, in b.
    """
    off = 1.0 - np.eye(3)
    parts = (
        (f_b, 0, np.diag(errors.accel_scale) + errors.accel_misalignment * off),
        (w_b, 3, np.diag(errors.gyro_scale) + errors.gyro_misalignment * off),
        (f_b, 3, np.full((3, 3), errors.gyro_g_sensitivity)),
    )
    total = np.zeros((len(truth), 9, 9))
    for cause, column, sigma in parts:
        for i, j in np.argwhere(sigma > 0.0):
            u = np.zeros((len(truth) - 1, 6))
            u[:, column + i] = sigma[i, j] * cause[:, j]
            grown = propagate(truth, accel_error=u[:, :3], gyro_error=u[:, 3:], earth=earth, held=held)
            x = np.hstack([grown.x[:, :6], grown.position])
            total += x[:, :, None] * x[:, None, :]
    return total


# Closed forms


def schuler_rate(earth: Ellipsoid, lat: float = 0.0, height: float = 0.0) -> float:
    """sqrt(g/r), rad/s."""
    return math.sqrt(float(earth.gravity(lat, height)) / (earth.a + height))


@dataclass(frozen=True)
class AtRest:
    """Errors of a vehicle at rest: dr (n, 2) m north, east; dv (n, 2) m/s; psi, phi (n, 3) rad."""

    dr: Array
    dv: Array
    psi: Array
    phi: Array


def at_rest(
    t: ArrayLike, lat: float, *, accel_error: ArrayLike = (0.0, 0.0), gyro_error: ArrayLike = (0.0, 0.0, 0.0),
    phi: ArrayLike = (0.0, 0.0, 0.0), dv: ArrayLike = (0.0, 0.0), dr: ArrayLike = (0.0, 0.0), earth: Ellipsoid,
) -> AtRest:  # fmt: skip
    """The exact solution of the linear model at rest on a sphere with ideal height: Schuler, Foucault and 24 h motions.

    t (n,) s; accel_error (2,) m/s^2 north, east and gyro_error (3,) rad/s, constant in NED; start errors phi (3,) rad,
    dv (2,) m/s, dr (2,) m. With z = dN + i dE:  z'' - 2 i Om sin(lat) z' + w^2 z = b - i g (psi_N + i psi_E), and psi
    turns
    about the Earth's axis, so the right side holds a constant, t, and exp(+-i Om t); the free motion has the two rates
    Om sin(lat) +- sqrt(w^2 + Om^2 sin(lat)^2).
    """
    time = np.atleast_1d(np.asarray(t, dtype=np.float64))
    om, R, g = earth.omega, earth.a, float(earth.gravity(lat, 0.0))
    s, c = math.sin(lat), math.cos(lat)
    w2 = g / R
    axis = np.array([c, 0.0, -s])
    eps = np.asarray(gyro_error, dtype=np.float64)
    n0, e0 = np.asarray(dr, dtype=np.float64)
    theta0 = np.array([e0 / R, -n0 / R, -math.tan(lat) * e0 / R])
    psi0 = np.asarray(phi, dtype=np.float64) - theta0
    # psi' = -Om axis x psi - eps:  psi = k0 + k1 t + kc cos(Om t) + ks sin(Om t)
    k1 = -(eps @ axis) * axis
    across = np.cross(axis, eps) / om  # the steady turn that drift across the axis gives
    k0 = (psi0 @ axis) * axis + across
    kc = psi0 - (psi0 @ axis) * axis - across
    ks = -np.cross(axis, kc)
    ct, st = np.cos(om * time), np.sin(om * time)
    psi = k0 + np.outer(time, k1) + np.outer(ct, kc) + np.outer(st, ks)
    b = complex(*np.asarray(accel_error, dtype=np.float64))
    plane = [complex(k[0], k[1]) for k in (k0, k1, kc, ks)]
    q0, q1 = b - 1j * g * plane[0], -1j * g * plane[1]
    up, down = -0.5j * g * (plane[2] - 1j * plane[3]), -0.5j * g * (plane[2] + 1j * plane[3])
    foucault = om * s
    up /= w2 - om * om + 2.0 * foucault * om
    down /= w2 - om * om - 2.0 * foucault * om
    constant = q0 / w2 + 2j * foucault * q1 / w2**2
    slope = q1 / w2
    root = math.sqrt(w2 + foucault**2)
    fast, slow = foucault + root, foucault - root
    z0 = complex(n0, e0) - (constant + up + down)
    v0 = complex(*np.asarray(dv, dtype=np.float64)) - (slope + 1j * om * (up - down))
    # dv of the psi form equals dv at rest
    a = (v0 - 1j * slow * z0) / (1j * (fast - slow))
    d = z0 - a
    ef, es, eu, ed = (np.exp(1j * x * time) for x in (fast, slow, om, -om))
    z = constant + slope * time + up * eu + down * ed + a * ef + d * es
    v = slope + 1j * om * (up * eu - down * ed) + 1j * (fast * a * ef + slow * d * es)
    theta = np.column_stack([z.imag, -z.real, -math.tan(lat) * z.imag]) / R
    return AtRest(np.column_stack([z.real, z.imag]), np.column_stack([v.real, v.imag]), psi, psi + theta)


@dataclass(frozen=True)
class Cause:
    """One row of the single-cause table: position (m), velocity (m/s) and tilt (rad) of one channel after t."""

    name: str
    position: Array
    velocity: Array
    tilt: Array


def single_causes(
    t: ArrayLike, lat: float, earth: Ellipsoid, *, position: float = 1.0, velocity: float = 1.0, tilt: float = 1.0,
    azimuth: float = 1.0, accel: float = 1.0, gyro: float = 1.0, azimuth_gyro: float = 1.0,
) -> list[Cause]:  # fmt: skip
    """Pitman's table: what each cause does to the north channel of a vehicle at rest, Foucault and 24 h motion
    neglected.

    position m, velocity m/s, tilt (phi_E) rad, azimuth rad, accel m/s^2, gyro (east) rad/s, azimuth_gyro rad/s. With
    w = Schuler's rate: v cos wt, v sin(wt)/w, -R tilt (1 - cos wt), ... ; the azimuth acts through the Earth rate that
    it
    throws into the east gyro, Om cos(lat) azimuth. Good for hours: error of order (Om t).
    """
    time = np.atleast_1d(np.asarray(t, dtype=np.float64))
    R, g = earth.a, float(earth.gravity(lat, 0.0))
    w = math.sqrt(g / R)
    s, c = np.sin(w * time), np.cos(w * time)
    h = earth.omega * math.cos(lat)
    one = np.ones_like(time)
    ramp, ramp_v = time - s / w, one - c
    second, second_v = 0.5 * time**2 - (1.0 - c) / w**2, ramp
    east = -gyro  # phi_E' = -drift
    from_azimuth = h * azimuth  # phi_E' gains Om cos(lat) phi_D
    return [
        Cause("initial position", position * one, 0.0 * one, 0.0 * one),
        Cause("initial velocity", velocity * s / w, velocity * c, -velocity * s / (w * R)),
        Cause("initial tilt", R * tilt * (1.0 - c), R * tilt * w * s, tilt * c),
        Cause("initial azimuth", R * from_azimuth * ramp, R * from_azimuth * ramp_v, from_azimuth * s / w),
        Cause("accelerometer bias", accel * (1.0 - c) / w**2, accel * s / w, -accel * (1.0 - c) / g),
        Cause("level gyro drift", R * east * ramp, R * east * ramp_v, east * s / w),
        Cause(
            "azimuth gyro drift", -R * h * azimuth_gyro * second, -R * h * azimuth_gyro * second_v,
            -h * azimuth_gyro * (1.0 - c) / w**2,
        ),
    ]  # fmt: skip


def open_loop(t: ArrayLike, *, accel: float = 0.0, gyro: float = 0.0, g: float = 9.8) -> Array:
    """(2.47) and (2.49): accel t^2/2 + g gyro t^3/6, m. Without Schuler's feedback; see `open_loop_holds`."""
    time = np.asarray(t, dtype=np.float64)
    return 0.5 * accel * time**2 + g * gyro * time**3 / 6.0


def open_loop_holds(cause: str, share: float, earth: Ellipsoid) -> float:
    """Time, s, up to which the open-loop formula of "accel" or "gyro" is at most `share` too large (0.1: a tenth)."""
    from scipy.optimize import brentq

    w = schuler_rate(earth)
    if cause == "accel":
        return float(brentq(lambda x: 0.5 * x * x / (1.0 - math.cos(x)) - 1.0 - share, 1e-3, 6.0)) / w
    return float(brentq(lambda x: x**3 / 6.0 / (x - math.sin(x)) - 1.0 - share, 1e-3, 12.0)) / w


def nonlinear_rate(
    lat: float, height: float, v_n: Array, C_nb: Array, w_ib_b: Array, f_b: Array, earth: Ellipsoid
) -> tuple[Array, Array, Array]:
    """The navigation equations as they stand: dC/dt (3, 3), dv/dt (3,), d(lat, lon, h)/dt (3,). For tests and
    teaching."""
    w_ie, w_en = earth.earth_rate_n(lat), earth.transport_rate_n(lat, height, v_n)
    r_n, r_e = (float(r) + height for r in earth.radii(lat))
    C_dot = C_nb @ skew(w_ib_b) - skew(w_ie + w_en) @ C_nb
    v_dot = C_nb @ f_b - np.cross(2.0 * w_ie + w_en, v_n) + earth.gravity_n(lat, height)
    return C_dot, v_dot, np.array([v_n[0] / r_n, v_n[1] / (r_e * math.cos(lat)), -v_n[2]])


def attitude_of(truth: Truth | Track) -> Array:
    """(n, 3, 3) C_nb."""
    return dcm_from_quat(truth.q_nb)
