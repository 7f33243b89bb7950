"""The size effect: what accelerometers feel because they do not sit where the navigation is done.

    A_i = e_i . [ f_P + wd x rho_i + w x (w x rho_i) ]                                          thesis (4.1)
    e . (w x (w x rho)) = (w.e)(w.rho) - (e.rho) w^2

for any number of single-axis accelerometers with own place rho_i (m) and own direction e_i, in instrument axes; w
(rad/s)
is the rate against inertial space. Compensation subtracts the two terms; the thesis's own form (4.4) leaves out wd and
is kept as the variant "rate-only". Under vibration the terms rectify; `rectified` gives the mean in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError

Array = NDArray[np.float64]
Variant = Literal["full", "rate-only"]
Differences = Literal["five-point", "central", "backward"]


@dataclass(frozen=True)
class Accelerometers:
    """positions (n, 3) m and directions (n, 3), unit vectors (scaled to length 1), both in instrument axes."""

    positions: Array
    directions: Array

    def __post_init__(self) -> None:
        rho = np.atleast_2d(np.asarray(self.positions, dtype=np.float64))
        e = np.atleast_2d(np.asarray(self.directions, dtype=np.float64))
        if rho.ndim != 2 or rho.shape != e.shape or rho.shape[1] != 3:
            raise InputError(f"positions have shape {rho.shape} and directions {e.shape}; both must be (n, 3)")
        length = np.linalg.norm(e, axis=1)
        if not (np.all(np.isfinite(rho)) and np.all(np.isfinite(e))) or np.any(length == 0.0):
            raise InputError("positions and directions must be finite, and no direction may be zero")
        object.__setattr__(self, "positions", rho)
        object.__setattr__(self, "directions", e / length[:, None])

    @classmethod
    def triad(cls, positions: ArrayLike) -> Accelerometers:
        """Accelerometers x, y, z at positions (3, 3) m, row i the place of accelerometer i."""
        return cls(np.asarray(positions, dtype=np.float64), np.eye(3))

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def to_force(self) -> Array:
        """(3, n) specific force from the outputs, least squares. InputError where the directions leave an axis
        unseen."""
        if np.linalg.matrix_rank(self.directions, tol=1e-6) < 3:
            raise InputError(
                "the accelerometers' directions lie in one plane: they do not give a specific force vector"
            )
        return np.asarray(np.linalg.pinv(self.directions), dtype=np.float64)


def centripetal(w: ArrayLike, where: Accelerometers) -> Array:
    """(m, n) m/s^2: e . (w x (w x rho)) for rates w (m, 3) rad/s."""
    w = np.atleast_2d(np.asarray(w, dtype=np.float64))
    e, rho = where.directions, where.positions
    return np.asarray((w @ e.T) * (w @ rho.T) - np.sum(w * w, axis=1)[:, None] * np.sum(e * rho, axis=1))


def tangential(wd: ArrayLike, where: Accelerometers) -> Array:
    """(m, n) m/s^2: e . (wd x rho) = wd . (rho x e) for angular accelerations wd (m, 3) rad/s^2."""
    wd = np.atleast_2d(np.asarray(wd, dtype=np.float64))
    return np.asarray(wd @ np.cross(where.positions, where.directions).T)


def sensed(f: ArrayLike, w: ArrayLike, wd: ArrayLike, where: Accelerometers) -> Array:
    """(m, n) outputs of the accelerometers, m/s^2, of thesis (4.1) without its bias and noise.

    f (m, 3) specific force at the origin of the positions, m/s^2; w (m, 3) rad/s; wd (m, 3) rad/s^2; instrument axes.
    """
    f = np.atleast_2d(np.asarray(f, dtype=np.float64))
    return np.asarray(f @ where.directions.T + tangential(wd, where) + centripetal(w, where))


_STENCILS: dict[str, tuple[tuple[int, ...], tuple[float, ...]]] = {
    "five-point": ((-2, -1, 1, 2), (1 / 12, -8 / 12, 8 / 12, -1 / 12)),
    "central": ((-1, 1), (-0.5, 0.5)),
    "backward": ((-1, 0), (-1.0, 1.0)),
}


def angular_acceleration(
    w: ArrayLike,
    dt: float,
    *,
    method: Differences = "five-point",
    bandwidth_hz: float | None = None,
    gyro_delay: float = 0.0,
) -> Array:
    """(m, 3) rad/s^2 by differencing gyro rates w (m, 3) rad/s at the spacing dt, s.

    The stencils hold for samples and for means over the intervals alike, because differencing and averaging commute.
    "five-point" (relative error (w dt)^4/30 at angular frequency w) and "central" ((w dt)^2/6) need the rows after;
    "backward" needs none but is half a sample late, which `compensate` does not repair. bandwidth_hz: a zero-phase
    low-pass (second order each way) first. gyro_delay: the gyros' rows are this much late, s; they are moved back
    first.
    Rows at the ends use shorter stencils.
    """
    w = _moved(np.asarray(w, dtype=np.float64), dt, gyro_delay)
    if bandwidth_hz is not None:
        w = _low_pass(w, dt, bandwidth_hz)
    m = len(w)
    if m < 2:
        return np.zeros_like(w)
    out = np.gradient(w, dt, axis=0) if m >= 2 else np.zeros_like(w)
    offsets, weights = _STENCILS[method]
    if method == "backward":
        out[1:] = np.diff(w, axis=0) / dt
        out[0] = out[1]
    elif m > 2 * offsets[-1]:
        reach = offsets[-1]
        inner = sum(c * w[reach + k : m - reach + k] for k, c in zip(offsets, weights, strict=True))
        out[reach : m - reach] = inner / dt
    return np.asarray(out)


def _low_pass(w: Array, dt: float, bandwidth_hz: float) -> Array:
    from scipy.signal import butter, sosfiltfilt

    if not 0.0 < bandwidth_hz < 0.5 / dt:
        raise InputError(f"a bandwidth of {bandwidth_hz:g} Hz is not below half the rate ({0.5 / dt:g} Hz)")
    sos = butter(2, bandwidth_hz, fs=1.0 / dt, output="sos")
    return np.asarray(sosfiltfilt(sos, w, axis=0, padlen=min(len(w) - 1, int(3.0 / (bandwidth_hz * dt)))))


def _moved(w: Array, dt: float, delay: float) -> Array:
    """Rows that describe a moment `delay` earlier, brought to their own time by a cubic spline."""
    if delay == 0.0 or len(w) < 4:
        return w
    from scipy.interpolate import CubicSpline

    t = np.arange(len(w)) * dt
    return np.asarray(CubicSpline(t - delay, w)(np.clip(t, -delay, t[-1] - delay)))


def compensate(
    outputs: ArrayLike,
    w: ArrayLike,
    dt: float,
    where: Accelerometers,
    *,
    variant: Variant = "full",
    method: Differences = "five-point",
    bandwidth_hz: float | None = None,
    gyro_delay: float = 0.0,
    means: bool = False,
) -> Array:
    """Outputs (m, n) m/s^2 with the size effect removed: as if every accelerometer sat at the origin.

    w (m, 3) gyro rates, rad/s, at spacing dt, s. variant: "full", or "rate-only", the thesis's (4.4) without angular
    acceleration (see `warning`). method, bandwidth_hz, gyro_delay: of `angular_acceleration`. means: the rows are means
    over their intervals, so that the mean of a product of rates is theirs plus (wd dt)^2/12.
    """
    if variant not in ("full", "rate-only"):
        raise InputError(f'{variant!r} is no compensation; type "full" or "rate-only"')
    w = _moved(np.atleast_2d(np.asarray(w, dtype=np.float64)), dt, gyro_delay)
    A = np.atleast_2d(np.asarray(outputs, dtype=np.float64)) - centripetal(w, where)
    if variant == "full":
        wd = angular_acceleration(w, dt, method=method, bandwidth_hz=bandwidth_hz)
        A = A - tangential(wd, where)
        if means:
            A = A - centripetal(wd * (dt / np.sqrt(12.0)), where)
    return np.asarray(A)


# ---- what is left as velocity ----


def rectified(rate_covariance: ArrayLike, where: Accelerometers) -> tuple[Array, Array]:
    """Mean false acceleration under small angular vibration, in closed form: (body-axis mean, inertial mean), (3,)
    each.

    rate_covariance S (3, 3) rad^2/s^2: mean of w w^T; of harmonic vibration theta0 sin(2 pi nu t) about an axis it is
    (2 pi nu theta0)^2/2 there. The first is the mean of the outputs, e.(S rho) - tr(S) (e.rho) for each accelerometer:
    thesis (4.3). The second is what integrates into velocity in fixed axes: it also has the mean of
    theta x (wd x rho), which undoes the first wherever all rho are the same. Only relative places matter.
    """
    S = np.asarray(rate_covariance, dtype=np.float64)
    e, rho = where.directions, where.positions
    to_force = where.to_force
    body = to_force @ (np.sum(e * (rho @ S), axis=1) - np.trace(S) * np.sum(e * rho, axis=1))
    # f_t = T wd with T = to_force (rho x e)^T; the mean of theta (wd)^T is -S, so <theta x T wd>_j = -eps_jkl (T S)_lk.
    TS = to_force @ np.cross(rho, e) @ S
    turn = -np.array([TS[2, 1] - TS[1, 2], TS[0, 2] - TS[2, 0], TS[1, 0] - TS[0, 1]])
    return np.asarray(body), np.asarray(body + turn)


def vibration_velocity(theta0: float, frequency_hz: float, time: float, rho: ArrayLike) -> Array:
    """Thesis (4.3) with its sign: velocity (m/s) along rho that an accelerometer pair in the plane collects in body
    axes.

    theta0 rad amplitude; time s; rho the place, m. Centripetal, so against rho.
    """
    return np.asarray(-2.0 * np.pi**2 * theta0**2 * frequency_hz**2 * time * np.asarray(rho, dtype=np.float64))


def noise_residual(
    rate_noise: ArrayLike,
    where: Accelerometers,
    *,
    next_correlation: float = 0.0,
    attitude_from_gyros: bool = True,
    variant: Variant = "full",
) -> Array:
    """Mean acceleration (3,) m/s^2 in fixed axes that gyro noise leaves after compensation.

    rate_noise N (3,) or (3, 3): rms of a sample per axis, rad/s, or its covariance. The square of the noise is
    subtracted as if it were motion: e.g. +sigma^2 rho a noisy axis. With attitude_from_gyros the same noise also turns
    the attitude; the differenced rates then rectify with it by (1 + r)/2, r = next_correlation between a sample and the
    next (0: white; near 1: noise well inside the gyros' bandwidth). What is left vanishes for equal places and r = 1.
    """
    N = np.asarray(rate_noise, dtype=np.float64)
    N = np.diag(np.broadcast_to(N, (3,)) ** 2) if N.ndim < 2 else N
    body, fixed = rectified(N, where)
    turn = 0.5 * (1.0 + next_correlation) * (fixed - body) if attitude_from_gyros and variant == "full" else 0.0
    return np.asarray(-(body + turn))


def next_correlation(bandwidth_hz: float, rate_hz: float) -> float:
    """Correlation of neighbouring samples of white noise after a first-order low-pass of that bandwidth."""
    return float(np.exp(-2.0 * np.pi * bandwidth_hz / rate_hz))


def warning(rate_covariance: ArrayLike, where: Accelerometers) -> str | None:
    """A sentence where "rate-only" compensation would be worse than none, else None.

    rate_covariance (3, 3) rad^2/s^2 of the vibration. After (4.4) only the tangential part is left.
    """
    body, fixed = rectified(rate_covariance, where)
    left = fixed - body
    worse = np.abs(left) > np.abs(fixed) + 1e-12 * max(float(np.max(np.abs(body))), 1e-30)
    if not worse.any():
        return None
    axes = ", ".join("xyz"[i] for i in np.flatnonzero(worse))
    k = int(np.argmax(np.abs(left) - np.abs(fixed)))
    return (
        f'"rate-only" compensation makes {axes} worse: in {"xyz"[k]} it leaves {60.0 * left[k]:.3g} m/s a '
        f"minute of such "
        f'vibration, without compensation it is {60.0 * fixed[k]:.3g} m/s; use "full", which takes the angular '
        f"acceleration"
    )
