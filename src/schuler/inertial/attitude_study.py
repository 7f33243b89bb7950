"""Attitude by Euler angles, Poisson's equation or quaternion with Runge-Kutta 1 to 4, and how each drifts.

The thesis's frames: body x right, y forward, z up; navigation east, north, up; C = Rz(psi) Rx(theta) Ry(gamma) with psi
counter-clockwise. For production use `strapdown`; these forms are here to be compared with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError

Array = NDArray[np.float64]
Form = Literal["euler", "poisson", "quaternion"]
_FORMS = {"euler": 0, "poisson": 1, "quaternion": 2}
# k_N of the drift law, Euler angles and Poisson alike: mean psi rate = k_N h^N theta_m gamma_m w^(N+1) sin(eps - N
# pi/2).
DRIFT_CONSTANTS = {1: -1.0 / 4.0, 2: 1.0 / 12.0, 3: -1.0 / 48.0, 4: -1.0 / 960.0}


@dataclass(frozen=True)
class Law:
    """(2.23): psi, theta, gamma = amplitude sin(rate t + phase); rad, rad/s, rad, in that order."""

    amplitude: tuple[float, float, float] = (0.0, 0.2, 0.2)
    rate: tuple[float, float, float] = (1.0, 1.0, 1.0)
    phase: tuple[float, float, float] = (0.0, 0.0, 0.5 * math.pi)

    def array(self) -> Array:
        """(3, 3): a row for each angle."""
        return np.column_stack([self.amplitude, self.rate, self.phase])

    def angles(self, t: ArrayLike) -> Array:
        """(n, 3) psi, theta, gamma at times t."""
        time = np.atleast_1d(np.asarray(t, dtype=np.float64))
        return np.asarray(self.amplitude) * np.sin(np.outer(time, self.rate) + np.asarray(self.phase))


def dcm_zxy(psi: float, theta: float, gamma: float) -> Array:
    """The thesis's C (3, 3), body to east-north-up."""
    cp, sp, ct, st, cg, sg = (f(x) for x in (psi, theta, gamma) for f in (math.cos, math.sin))
    return np.array(
        [
            [cg * cp - sg * st * sp, -ct * sp, sg * cp + cg * st * sp],
            [cg * sp + sg * st * cp, ct * cp, sg * sp - cg * st * cp],
            [-sg * ct, st, ct * cg],
        ]
    )


def angles_zxy(C: ArrayLike) -> Array:
    """(..., 3) psi, theta, gamma of the thesis's C (..., 3, 3): (4.32) put right."""
    c = np.asarray(C, dtype=np.float64)
    theta = np.arcsin(np.clip(c[..., 2, 1], -1.0, 1.0))
    psi, gamma = np.arctan2(-c[..., 0, 1], c[..., 1, 1]), np.arctan2(-c[..., 2, 0], c[..., 2, 2])
    return np.stack([psi, theta, gamma], axis=-1)


@dataclass(frozen=True)
class StudyRun:
    """time (n,) s; angles (n, 3) psi, theta, gamma, rad; C (n, 3, 3) as integrated; error (n, 3): angles less truth."""

    time: Array
    angles: Array
    C: Array
    error: Array

    @property
    def psi_drift(self) -> float:
        """Mean rate of psi's error from first to last row, rad/s."""
        return float((self.error[-1, 0] - self.error[0, 0]) / (self.time[-1] - self.time[0]))


def integrate(
    form: Form, order: int, h: float, duration: float, *, law: Law | None = None, renormalise: bool = False,
    every: int = 1,
) -> StudyRun:  # fmt: skip
    """Integrates the motion from its true angles at 0 with steps of h s; a row every `every` steps."""
    from schuler.kernels import attitude_study as kernel

    if form not in _FORMS or order not in DRIFT_CONSTANTS:
        raise InputError(f"form is one of {', '.join(_FORMS)} and order 1 to 4; got {form!r} and {order!r}")
    law = law or Law()
    psi, theta, gamma = (float(x) for x in law.angles(0.0)[0])
    C0 = dcm_zxy(psi, theta, gamma)
    if form == "euler":
        x = np.array([psi, theta, gamma])
    elif form == "poisson":
        x = C0.ravel().copy()
    else:
        x = _quat_zxy(psi, theta, gamma)
    n = round(duration / h)
    start = x.copy()
    out = np.empty((n // every, x.size))
    kernel.integrate(_FORMS[form], order, renormalise, law.array(), h, n, x, every, out)
    out = np.vstack([start, out])
    time = np.arange(len(out), dtype=np.float64) * (every * h)
    if form == "euler":
        angles = out
        C = np.array([dcm_zxy(*row) for row in out])
    else:
        C = out.reshape(-1, 3, 3) if form == "poisson" else _dcm_from_quat(out)
        angles = angles_zxy(C)
        if form == "quaternion":  # a length other than 1 cancels in the angles
            angles = angles_zxy(C / np.linalg.norm(C[:, 0], axis=1)[:, None, None])
    return StudyRun(time, angles, C, angles - law.angles(time))


def _quat_zxy(psi: float, theta: float, gamma: float) -> Array:
    z, x, y = 0.5 * psi, 0.5 * theta, 0.5 * gamma
    cz, sz, cx, sx, cy, sy = (f(a) for a in (z, x, y) for f in (math.cos, math.sin))
    # (cz + sz k)(cx + sx i)(cy + sy j)
    return np.array(
        [
            cz * cx * cy - sz * sx * sy,
            cz * sx * cy - sz * cx * sy,
            cz * cx * sy + sz * sx * cy,
            cz * sx * sy + sz * cx * cy,
        ]
    )


def _dcm_from_quat(q: Array) -> Array:
    a, b, c, d = q.T
    rows = [
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def drift_law(order: int, h: float, theta_m: float, gamma_m: float, rate: float, phase: float) -> float:
    """(2.50) with its constant: mean psi rate, rad/s, of Euler angles or Poisson at small amplitude."""
    k = DRIFT_CONSTANTS[order]
    return k * h**order * theta_m * gamma_m * rate ** (order + 1) * math.sin(phase - order * 0.5 * math.pi)


def psi_drift(
    form: Form, order: int, steps_per_period: int, *, law: Law | None = None, periods: int = 20,
    renormalise: bool = False,
) -> float:  # fmt: skip
    """Mean psi rate over whole periods (all rates of the law equal), rad/s; h = period / steps_per_period."""
    law = law or Law()
    h = 2.0 * math.pi / law.rate[1] / steps_per_period
    run = integrate(
        form, order, h, h * steps_per_period * periods, law=law, renormalise=renormalise, every=steps_per_period
    )
    return run.psi_drift
