"""Bias, scale and misalignment without a table: gravity is the reference of the accelerometers, and the turning of its
direction between rests, or turns of known angle, that of the gyros.

    measured = (I + M) true + bias        M upper triangular for accelerometers, full for gyros

so the z accelerometer defines the z axis, the y accelerometer the y-z plane; the gyros are referred to that frame.
Where
the direction of up is known at each rest, M of the accelerometers may be full. Broad priors (what a sensor on sale may
have) keep a poor set of positions solvable; a parameter that the data do not tighten to half its prior is called not
observable and left at zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from schuler.calibration.rests import Rest
from schuler.ground.errors import InputError

Array = NDArray[np.float64]
Form = Literal["upper", "symmetric", "full"]

PRIOR_ACCEL_BIAS = 2.0  # m/s^2
PRIOR_SCALE = 0.15
PRIOR_MISALIGNMENT = 0.1  # rad
PRIOR_G = 2e-3  # rad/s per m/s^2
PRIOR_WARM = 0.02  # m/s^2 per degC
SEEN = 0.5  # of the prior
SOFT = 3.0  # residuals beyond so many sigma count less
NAMES_9 = ("bias_x", "bias_y", "bias_z", "scale_x", "scale_y", "scale_z")
PAIRS = {"upper": ("xy", "xz", "yz"), "symmetric": ("xy", "xz", "yz"), "full": ("xy", "xz", "yx", "yz", "zx", "zy")}


@dataclass(frozen=True)
class SensorFit:
    """One triad. names and values (p,) SI, std (p,) NaN where not observable; covariance (p, p) of all, priors included
    for what is not observable (zero there).

    residuals (n,): |f| - g in m/s^2 at the rests, or gravity-transfer angles in rad; before: the same uncorrected;
    holdout (n,): with that rest or turn left out of the fit (NaN: not possible).
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    observable: NDArray[np.bool_]
    residuals: Array
    before: Array
    holdout: Array
    condition: float

    @property
    def std(self) -> Array:
        return np.asarray(np.where(self.observable, np.sqrt(np.diag(self.covariance)), np.nan))

    def value(self, name: str) -> float:
        return float(self.values[self.names.index(name)])


def rms(x: Array) -> float:
    x = np.asarray(x, dtype=np.float64)
    ok = np.isfinite(x)
    return float(np.sqrt(np.mean(x[ok] ** 2))) if ok.any() else float("nan")


# ---- the matrices ----


def matrix(pairs: Sequence[str], form: Form, scale: Array, mis: Array) -> Array:
    """I + M from scales (3,) and misalignments in the order of pairs."""
    K = np.eye(3) + np.diag(scale)
    for pair, value in zip(pairs, mis, strict=True):
        i, j = "xyz".index(pair[0]), "xyz".index(pair[1])
        K[i, j] = value
        if form == "symmetric":
            K[j, i] = value
    return K


def matrices(form: Form) -> list[Array]:
    """dK of each scale and misalignment parameter, in order."""
    out = [np.diag(np.eye(3)[i]) for i in range(3)]
    for pair in PAIRS[form]:
        B = np.zeros((3, 3))
        i, j = "xyz".index(pair[0]), "xyz".index(pair[1])
        B[i, j] = 1.0
        if form == "symmetric":
            B[j, i] = 1.0
        out.append(B)
    return out


# ---- a small robust Gauss-Newton with priors ----

Model = Callable[[Array], tuple[Array, Array]]  # parameters -> residuals (n,), Jacobian (n, p)


def _fit(
    model: Model, prior: Array, sigma: float, free: NDArray[np.bool_], floor: float, start: Array | None = None
) -> tuple[Array, Array, float]:
    """(parameters, covariance, sigma): soft-L1 weights beyond SOFT sigma; sigma from the residuals, never below
    floor."""
    p = np.zeros(prior.size) if start is None else np.where(free, start, 0.0)
    cov = np.diag(prior**2)
    index = np.flatnonzero(free)
    for outer in range(4):
        for _ in range(30):
            r, J = model(p)
            J = J[:, index]
            u = (r / (SOFT * sigma)) ** 2
            w = 1.0 / np.sqrt(1.0 + u)  # derivative of 2 (sqrt(1 + u) - 1)
            A = J.T @ (J * w[:, None]) / sigma**2 + np.diag(1.0 / prior[index] ** 2)
            b = J.T @ (w * r) / sigma**2 + p[index] / prior[index] ** 2
            scale = 1.0 / np.sqrt(np.diag(A))
            step = scale * np.linalg.solve(A * np.outer(scale, scale), scale * b)
            p[index] -= step
            if np.max(np.abs(step) / prior[index]) < 1e-10:
                break
        r, J = model(p)
        J = J[:, index]
        w = 1.0 / np.sqrt(1.0 + (r / (SOFT * sigma)) ** 2)
        information = J.T @ (J * w[:, None]) / sigma**2
        A = information + np.diag(1.0 / prior[index] ** 2)
        C = np.linalg.inv(A)
        cov = np.zeros((prior.size, prior.size))
        cov[np.ix_(index, index)] = C
        used = float(np.trace(C @ information))  # parameters that the data, not the prior, decide
        spare = r.size - used
        new = np.sqrt(np.sum(w * r * r) / spare) if spare > 0.5 else sigma
        new = max(float(new), floor)
        if abs(new / sigma - 1.0) < 0.01 or outer == 3:
            cov *= (new / sigma) ** 2
            sigma = new
            break
        sigma = new
    return p, cov, sigma


def observable_fit(
    model: Model, prior: Array, sigma: float, floor: float, start: Array | None = None
) -> tuple[Array, Array, NDArray[np.bool_], float, float]:
    """Fit, drop what the data do not tighten to half its prior, fit again."""
    free = np.ones(prior.size, dtype=bool)
    p, cov, s = _fit(model, prior, sigma, free, floor, start)
    for _ in range(prior.size):
        tight = np.sqrt(np.diag(cov)) / prior
        if not np.any(free & (tight > SEEN)):
            break
        free[int(np.argmax(np.where(free, tight, -1.0)))] = False
        if not free.any():
            break
        p, cov, s = _fit(model, prior, sigma, free, floor, p)
    _, J = model(p)
    J = J[:, free] * prior[free]
    size = np.linalg.norm(J, axis=0)
    singular = np.linalg.svd(J / np.where(size > 0, size, 1.0), compute_uv=False)
    condition = float(singular[0] / singular[-1]) if free.all() and singular[-1] > 0 else float("inf")
    return p, cov, free, s, condition


# ---- accelerometers ----


def _accel_model(f: Array, g: float, form: Form, warm: Array | None) -> tuple[tuple[str, ...], Array, Model]:
    names: tuple[str, ...] = NAMES_9 + tuple(f"misalignment_{p}" for p in PAIRS[form])
    prior = np.array([PRIOR_ACCEL_BIAS] * 3 + [PRIOR_SCALE] * 3 + [PRIOR_MISALIGNMENT] * len(PAIRS[form]))
    if warm is not None:
        names += tuple(f"bias_{a}_per_degC" for a in "xyz")
        prior = np.concatenate([prior, [PRIOR_WARM] * 3])
    basis = matrices(form)
    m = len(basis)

    def model(p: Array) -> tuple[Array, Array]:
        K = np.eye(3) + sum(v * B for v, B in zip(p[3 : 3 + m], basis, strict=True))
        inverse = np.linalg.inv(K)
        bias = p[:3] if warm is None else p[:3] + warm[:, None] * p[3 + m :]
        x = (f - bias) @ inverse.T
        size = np.linalg.norm(x, axis=1)
        n = (x / size[:, None]) @ inverse  # row vectors n^T K^-1
        columns = [-n]
        columns += [-np.einsum("ni,ij,nj->n", n, B, x)[:, None] for B in basis]
        if warm is not None:
            columns.append(-n * warm[:, None])
        return size - g, np.hstack(columns)

    return names, prior, model


def _full_accel_model(f: Array, g: float, up: Array, warm: Array | None) -> tuple[tuple[str, ...], Array, Model]:
    """Up is known at each rest: three equations each, linear in all twelve parameters."""
    names: tuple[str, ...] = NAMES_9 + tuple(f"misalignment_{p}" for p in PAIRS["full"])
    prior = np.array([PRIOR_ACCEL_BIAS] * 3 + [PRIOR_SCALE] * 3 + [PRIOR_MISALIGNMENT] * 6)
    basis = matrices("full")
    truth = g * up
    J = np.zeros((f.size, len(names) + (3 if warm is not None else 0)))
    for i in range(3):
        J[i::3, i] = 1.0
    for k, B in enumerate(basis):
        J[:, 3 + k] = (truth @ B.T).ravel()
    if warm is not None:
        names += tuple(f"bias_{a}_per_degC" for a in "xyz")
        prior = np.concatenate([prior, [PRIOR_WARM] * 3])
        for i in range(3):
            J[i::3, len(names) - 3 + i] = warm
    return names, prior, lambda p: ((truth - f).ravel() + J @ p, J)


def fit_accelerometers(
    rests: Sequence[Rest],
    gravity: float,
    *,
    form: Form = "upper",
    temperature: bool = False,
    up: Array | None = None,
    holdout: bool = True,
) -> SensorFit:
    """Nine parameters (or twelve with form "full" and up (n, 3) known) from the size of gravity at rests.

    temperature: a linear change of the biases about the mean temperature too. Raises InputError for fewer than four
    different rests.
    """
    f = np.array([r.force for r in rests])
    if _different(f) < 4:
        raise InputError(
            f"{_different(f)} different positions are too few for a calibration; rest the instrument for a few "
            f"seconds in at "
            "least six, better twelve or more, with each axis up, down and oblique"
        )
    if form == "full" and up is None:
        raise InputError(
            'form = "full" needs the direction of up at each rest: give gamma[deg] and beta[deg] in the positions table'
        )
    warm = None
    if temperature:
        t = np.array([r.temperature for r in rests])
        if not np.all(np.isfinite(t)) or np.ptp(t) < 0.5:
            raise InputError("temperature = true needs a temperature column that changes by half a degree or more")
        warm = t - t.mean()
    # Rest means are finer than anything a sensor's model can say.
    noise = float(np.median([np.linalg.norm(r.scatter) / np.sqrt(max(r.last - r.first, 1)) for r in rests]))
    floor = max(0.3 * noise, 1e-9)

    def run(keep: NDArray[np.bool_]) -> tuple[tuple[str, ...], Array, Array, NDArray[np.bool_], float]:
        """The fit to some of the rests."""
        w = None if warm is None else warm[keep]
        if form == "full" and up is not None:
            names, prior, model = _full_accel_model(f[keep], gravity, up[keep], w)
        else:
            names, prior, model = _accel_model(f[keep], gravity, form, w)
        p, cov, seen, _, condition = observable_fit(model, prior, 0.02, floor)
        return names, p, cov, seen, condition

    whole = np.ones(len(rests), dtype=bool)
    names, p, cov, seen, condition = run(whole)

    def size(q: Array, at: NDArray[np.bool_]) -> tuple[Array, Array]:
        w = None if warm is None else warm[at]
        return _accel_model(f[at], gravity, form, w)[2](q)

    fitted = size(p, whole)[0]

    left = np.full(len(rests), np.nan)
    if holdout and len(rests) > 4:
        for i in range(len(rests)):
            keep = whole.copy()
            keep[i] = False
            if _different(f[keep]) < 4:
                continue
            _, q, q_cov, known, _ = run(keep)
            error, J = size(q, ~keep)
            spread = float(np.sqrt(J[0] @ q_cov @ J[0]))
            if np.array_equal(known, seen) and spread < 20.0 * max(rms(fitted), floor):
                left[i] = float(error[0])  # else the others cannot predict it
    before = np.linalg.norm(f, axis=1) - gravity
    return SensorFit(names, p, cov, seen, fitted, before, left, condition)


def _different(f: Array) -> int:
    """How many directions differ by more than ten degrees."""
    seen: list[Array] = []
    for v in f / np.linalg.norm(f, axis=1)[:, None]:
        if all(float(v @ u) < np.cos(np.deg2rad(10.0)) for u in seen):
            seen.append(v)
    return len(seen)


def accel_matrix(fit: SensorFit) -> tuple[Array, Array]:
    """(I + M, bias) of a fitted triad; temperature terms are left out."""
    mis = [n for n in fit.names if n.startswith("misalignment_")]
    pairs = tuple(n.removeprefix("misalignment_") for n in mis)
    K = np.eye(3) + np.diag([fit.value(f"scale_{a}") for a in "xyz"])
    for pair, n in zip(pairs, mis, strict=True):
        K["xyz".index(pair[0]), "xyz".index(pair[1])] = fit.value(n)
    bias = np.array([fit.value(f"bias_{a}") if f"bias_{a}" in fit.names else 0.0 for a in "xyz"])
    return K, bias
