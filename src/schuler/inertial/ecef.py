"""Strapdown INS in Earth-fixed axes, and its error model: the thesis's (5.11) and (5.15) put right.

The same increments in and the same rows out as `inertial.strapdown.Strapdown`: one navigator in two sets of axes.
Errors = estimate - truth; in e: x = (Phi, dv, dr), C_hat_eb = (I - [Phi x]) C_eb, rad, m/s, m. Source: Groves (2013),
sections 5.3 and 14.2.3; the gravity gradient is that of the gravity used, to all digits.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import WGS84, C_en, Ellipsoid, Sphere
from schuler.ground.errors import InputError
from schuler.ground.frames import skew
from schuler.ground.tables import Table
from schuler.inertial.strapdown import Coning, Start, Track, _track
from schuler.truth.trajectories import earth_vector

Array = NDArray[np.float64]
_SCHEMES = {"none": 0, "one": 1, "two": 2, "three": 3}
_VERTICAL = {"free": 0, "held": 1}
_BLOCK = 4096


class StrapdownEcef:
    """A strapdown INS in Earth-fixed axes that runs as samples come; use it as `Strapdown`.

    coning : as there, but for "pair". vertical : "free", or "held" (height and down velocity are given, or kept).
    """

    def __init__(
        self, start: Start, *, earth: Ellipsoid = WGS84, coning: Coning = "three",
        vertical: Literal["free", "held", "aided"] = "free",
    ) -> None:  # fmt: skip
        from schuler.kernels import mechanization_ecef as kernel

        if coning not in _SCHEMES or vertical not in _VERTICAL:
            raise InputError(
                f"in Earth-fixed axes coning is one of {', '.join(_SCHEMES)} and vertical one of "
                f'{", ".join(_VERTICAL)}; got {coning!r} and {vertical!r}: type frame = "ned" for the others'
            )
        q = np.asarray(start.q_nb, dtype=np.float64)
        size = float(np.linalg.norm(q))
        numbers = [start.lat, start.lon, start.height, *start.v_n, *q]
        if not np.all(np.isfinite(numbers)) or abs(size - 1.0) > 1e-6:
            raise InputError("the start holds a value that is not a number, or q_nb is not a unit quaternion")
        self.earth, self._scheme, self._mode = earth, _SCHEMES[coning], _VERTICAL[vertical]
        self.time = start.time
        self._height, self._down = np.array([start.height]), np.array([start.v_n[2]])
        self._earth = earth_vector(earth)
        self._state = np.zeros(kernel.STATE)
        kernel.begin(self._state, self._earth, start.lat, start.lon, start.height, *start.v_n, *(q / size))

    def feed(
        self, dtheta: Array, dv: Array, dt: float | Array, *, height: Array | None = None, v_down: Array | None = None,
        every: int = 1,
    ) -> Track:  # fmt: skip
        """n samples on: increments (n, 3) rad and (n, 3) m/s over dt (s, one number or (n,)); the rows after every
        `every`-th of them. height (n,) m and v_down (n,) m/s at the ends, for "held"."""
        from schuler.kernels import mechanization_ecef as kernel

        dtheta, dv = np.ascontiguousarray(dtheta, dtype=np.float64), np.ascontiguousarray(dv, dtype=np.float64)
        steps = np.atleast_1d(np.asarray(dt, dtype=np.float64))
        n = len(dtheta)
        if dtheta.shape != (n, 3) or dv.shape != (n, 3) or steps.size not in (1, n):
            raise InputError(f"increments must be (n, 3) and dt one number or (n,); got {dtheta.shape}, {dv.shape}")
        if not np.all(steps > 0.0):
            raise InputError("the intervals dt must be above 0 s; remove repeated rows, sort the others")
        if every < 1 or any(x is not None and len(x) not in (1, n) for x in (height, v_down)):
            raise InputError(f"every must be 1 or more, and height and v_down as long as the {n} samples")
        if height is not None and v_down is None and self._mode == _VERTICAL["held"]:
            raise InputError('vertical = "held" with given heights needs v_down beside them')
        rows = n // every
        h = self._height if height is None else np.ascontiguousarray(height, dtype=np.float64)
        d = self._down if v_down is None else np.ascontiguousarray(v_down, dtype=np.float64)
        out = np.empty((rows, 10))
        size = max(1, _BLOCK // every)
        raw = np.empty((min(size, rows), kernel.RAW))
        for first in range(0, max(rows, 1), size):
            last = min(first + size, rows)
            part = slice(first * every, last * every if last < rows else n)
            kernel.run(
                self._state, self._earth, dtheta[part], dv[part], steps if steps.size == 1 else steps[part],
                self._scheme, self._mode, h if h.size == 1 else h[part], d if d.size == 1 else d[part], every,
                raw[: last - first],
            )  # fmt: skip
            kernel.to_ned(raw[: last - first], self._earth, out[first:last])
        ends = self.time + (steps[0] * np.arange(1, n + 1) if steps.size == 1 else np.cumsum(steps))
        self.time = float(ends[-1]) if n else self.time
        return _track(ends[every - 1 :: every], out)

    def restart(self, start: Start) -> None:
        """Takes another position, velocity and attitude; what was learnt of the motion inside the intervals is kept."""
        from schuler.kernels import mechanization_ecef as kernel

        memory = self._state[kernel.MEMORY :].copy()
        kernel.begin(self._state, self._earth, start.lat, start.lon, start.height, *start.v_n, *start.q_nb)
        self._state[kernel.MEMORY :] = memory
        self.time = start.time

    def step(self, dtheta: ArrayLike, dv: ArrayLike, dt: float) -> Track:
        """One sample."""
        return self.feed(np.asarray(dtheta, dtype=np.float64)[None], np.asarray(dv, dtype=np.float64)[None], dt)


def run(
    imu: Table, start: Start, *, earth: Ellipsoid = WGS84, coning: Coning = "three",
    vertical: Literal["free", "held", "aided"] = "free", every: int = 1,
) -> Track:  # fmt: skip
    """A whole imu table (rates or increments), as `strapdown.run`."""
    from schuler.inertial.imu_input import prepare

    ready = prepare(imu, start)
    ins = StrapdownEcef(start, earth=earth, coning=coning, vertical=vertical)
    dt = ready.dt if np.ptp(ready.dt) > 1e-9 * ready.dt[0] else float(np.mean(ready.dt))
    track = ins.feed(ready.dtheta, ready.dv, dt, every=every)
    return Track(ready.time[every - 1 :: every], track.lat, track.lon, track.height, track.v_n, track.q_nb, ready.notes)


# Gravity in e, and the linear error model


def gravity_e(r_e: ArrayLike, earth: Ellipsoid = WGS84) -> Array:
    """Plumb-bob gravity (3,), m/s^2, in e at r_e (3,), m: the same down-pointing normal gravity as in NED."""
    lat, lon, h = (float(x) for x in earth.geodetic_from_ecef(r_e))
    return np.asarray(C_en(lat, lon) @ earth.gravity_n(lat, h))


def gravity_gradient(r_e: ArrayLike, earth: Ellipsoid = WGS84) -> Array:
    """G (3, 3) = d g_e/d r_e, 1/s^2, exact for `gravity_e`.

    With north, east and up at the place, g the size of gravity and R its radii plus height:
    G = -[g_h u u' + (g_lat/R_N) u n' + (g/R_N) n n' + (g/R_E) e e']. Without its first part nothing is unstable in the
    vertical, without the others there is no Schuler loop.
    """
    lat, lon, h = (float(x) for x in earth.geodetic_from_ecef(r_e))
    C = C_en(lat, lon)
    north, east, up = C[:, 0], C[:, 1], -C[:, 2]
    g, g_lat, g_h = _gravity_slopes(lat, h, earth)
    r_n, r_e_ = (float(x) + h for x in earth.radii(lat))
    return -(
        g_h * np.outer(up, up)
        + g_lat / r_n * np.outer(up, north)
        + g / r_n * np.outer(north, north)
        + g / r_e_ * np.outer(east, east)
    )


def _gravity_slopes(lat: float, h: float, earth: Ellipsoid) -> tuple[float, float, float]:
    """g, dg/dlat, dg/dh."""
    if isinstance(earth, Sphere):
        r = earth.a + h
        return earth.gm / r**2, 0.0, -2.0 * earth.gm / r**3
    s, c = math.sin(lat), math.cos(lat)
    s2, x, k = s * s, h / earth.a, earth.somigliana_k
    w2 = 1.0 - earth.e2 * s2
    g0 = earth.gamma_e * (1.0 + k * s2) / math.sqrt(w2)
    q = 1.0 + earth.f + earth.m - 2.0 * earth.f * s2
    fall = 1.0 - 2.0 * q * x + 3.0 * x * x
    g0_s2 = g0 * (k / (1.0 + k * s2) + 0.5 * earth.e2 / w2)
    lat_slope = (g0_s2 * fall + g0 * 4.0 * earth.f * x) * 2.0 * s * c
    return g0 * fall, lat_slope, g0 * (6.0 * x - 2.0 * q) / earth.a


def point_mass_gradient(r_e: ArrayLike, earth: Ellipsoid = WGS84) -> Array:
    """G of a point mass and the centrifugal field, -(GM/r^3)(I - 3 u u') + w^2 diag(1, 1, 0): good to 0.5 %."""
    r = np.asarray(r_e, dtype=np.float64)
    size = float(np.linalg.norm(r))
    u = r / size
    return np.asarray(
        -earth.gm / size**3 * (np.eye(3) - 3.0 * np.outer(u, u)) + earth.omega**2 * np.diag([1.0, 1.0, 0.0])
    )


def error_matrix(r_e: ArrayLike, f_e: ArrayLike, earth: Ellipsoid = WGS84) -> Array:
    """F (9, 9) of x = (Phi, dv, dr) in e at position r_e (3,) m and specific force f_e (3,) m/s^2 in e.

    Phi' = -w_ie x Phi - C b_g;  dv' = f x Phi - 2 w_ie x dv + G dr + C b_a;  dr' = dv.  (5.15) corrected.
    """
    W = skew(np.array([0.0, 0.0, earth.omega]))
    F = np.zeros((9, 9))
    F[0:3, 0:3] = -W
    F[3:6, 0:3] = skew(f_e)
    F[3:6, 3:6] = -2.0 * W
    F[3:6, 6:9] = gravity_gradient(r_e, earth)
    F[6:9, 3:6] = np.eye(3)
    return F


def input_matrix(C_eb: ArrayLike) -> Array:
    """B (9, 6): accelerometer errors (m/s^2), then gyro errors (rad/s), in b."""
    C = np.asarray(C_eb, dtype=np.float64)
    B = np.zeros((9, 6))
    B[0:3, 3:6] = -C
    B[3:6, 0:3] = C
    return B


def nonlinear_rate(
    r_e: Array, v_e: Array, C_eb: Array, w_ib_b: Array, f_b: Array, earth: Ellipsoid = WGS84
) -> tuple[Array, Array, Array]:
    """(5.11) put right, as it stands: dC/dt (3, 3), dv/dt (3,), dr/dt (3,). For tests and teaching."""
    W = skew(np.array([0.0, 0.0, earth.omega]))
    v_dot = C_eb @ f_b - 2.0 * W @ v_e + gravity_e(r_e, earth)
    return C_eb @ skew(w_ib_b) - W @ C_eb, np.asarray(v_dot), v_e


def to_e(lat: float, lon: float, height: float, v_n: ArrayLike, C_nb: ArrayLike, earth: Ellipsoid = WGS84) -> tuple[
    Array, Array, Array
]:  # fmt: skip
    """r_e, v_e, C_eb of a place (rad, m), velocity (m/s NED) and attitude."""
    C = C_en(lat, lon)
    return (
        earth.ecef_from_geodetic(lat, lon, height),
        np.asarray(C @ np.asarray(v_n, dtype=np.float64)),
        np.asarray(C @ np.asarray(C_nb, dtype=np.float64)),
    )


def phi_from_e(lat: float, lon: float, height: float, v_n: ArrayLike, earth: Ellipsoid = WGS84) -> Array:
    """T (9, 9): (phi, dv in n, dr in NED metres) = T x of the e form, errors of lat, lon, h as metres.

    phi = C_ne Phi + theta with theta = (dE/R_E, -dN/R_N, -tan(lat) dE/R_E), and dv_n = C_ne dv - theta x v.
    """
    r_n, r_e = (float(x) + height for x in earth.radii(lat))
    C = C_en(lat, lon).T
    theta = np.array([[0.0, 1.0 / r_e, 0.0], [-1.0 / r_n, 0.0, 0.0], [0.0, -math.tan(lat) / r_e, 0.0]]) @ C
    T = np.zeros((9, 9))
    T[0:3, 0:3] = T[3:6, 3:6] = T[6:9, 6:9] = C
    T[0:3, 6:9] = theta
    T[3:6, 6:9] = skew(v_n) @ theta
    return T
