"""Bias, scale and misalignment without a table: gravity is the reference of the accelerometers, and the turning of its
direction between rests, or turns of known angle, that of the gyros.

    measured = (I + M) true + bias        M upper triangular for accelerometers, full for gyros

so the z accelerometer defines the z axis, the y accelerometer the y-z plane; the gyros are referred to that frame. Where
the direction of up is known at each rest, M of the accelerometers may be full. Broad priors (what a sensor on sale may
have) keep a poor set of positions solvable; a parameter that the data do not tighten to half its prior is called not
observable and left at zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
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
ACROSS = 0.1  # weight of a known turn across its axis
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


@dataclass(frozen=True)
class Turn:
    """Rows first <= i < last between two rests, or a turn of a known angle (rad) about axis (3,), instrument axes."""

    first: int
    last: int
    before: int
    after: int
    axis: Array | None = None
    angle: float = 0.0


@dataclass(frozen=True)
class MultipositionResult:
    rests: list[Rest]
    accel: SensorFit
    gyro: SensorFit | None
    gyro_bias: Array
    gyro_bias_std: Array
    turns: list[Turn]
    known: list[tuple[Turn, Array]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


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


def _basis(form: Form) -> list[Array]:
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
    """(parameters, covariance, sigma): soft-L1 weights beyond SOFT sigma; sigma from the residuals, never below floor."""
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


def _observable_fit(
    model: Model, prior: Array, sigma: float, floor: float, start: Array | None = None
) -> tuple[Array, Array, NDArray[np.bool_], float, float]:  # fmt: skip
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
    basis = _basis(form)
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
    basis = _basis("full")
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
    rests: Sequence[Rest], gravity: float, *, form: Form = "upper", temperature: bool = False, up: Array | None = None,
    holdout: bool = True,
) -> SensorFit:  # fmt: skip
    """Nine parameters (or twelve with form "full" and up (n, 3) known) from the size of gravity at rests.

    temperature: a linear change of the biases about the mean temperature too. Raises InputError for fewer than four
    different rests.
    """
    f = np.array([r.force for r in rests])
    if _different(f) < 4:
        raise InputError(
            f"{_different(f)} different positions are too few for a calibration; rest the instrument for a few seconds in at "
            "least six, better twelve or more, with each axis up, down and oblique"
        )
    if form == "full" and up is None:
        raise InputError('form = "full" needs the direction of up at each rest: give gamma[deg] and beta[deg] in the positions table')
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
        p, cov, seen, _, condition = _observable_fit(model, prior, 0.02, floor)
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


# ---- gyros ----


def turns_between(rests: Sequence[Rest], longest: float = 10.0) -> list[Turn]:
    """A turn from near the end of each rest to near the start of the next, where they lie within `longest` s of each other.

    The points are half a second inside the rests, where the instrument has certainly stopped.
    """
    out = []
    for i, (a, b) in enumerate(zip(rests[:-1], rests[1:], strict=True)):
        if b.start - a.end <= longest:
            inside = [int(min(0.5, 0.5 * r.length) / r.length * (r.last - r.first)) for r in (a, b)]
            out.append(Turn(a.last - inside[0], b.first + inside[1], i, i + 1))
    return out


def fit_gyros(
    time: Array, gyro: Array, force: Array, rests: Sequence[Rest], turns: Sequence[Turn], accel: SensorFit, *,
    form: Form = "upper", known: Sequence[Turn] = (), g_sensitivity: bool = False, holdout: bool = True,
) -> tuple[SensorFit, list[tuple[Turn, Array]]]:  # fmt: skip
    """Scale and full misalignment (9) from the transfer of gravity between rests and from turns of known angle.

    The bias of a turn goes linearly from the rest before to the rest after. g_sensitivity: nine more parameters, from
    the biases of the rests. Returns the fit and, for each known turn, its integral after correction, (3,) rad.
    """
    from schuler.kernels.transfer import transfer

    K, bias = accel_matrix(accel)
    dt = np.diff(time, prepend=time[0] - float(np.median(np.diff(time))))
    basis = _basis("full")
    names: tuple[str, ...] = ("scale_x", "scale_y", "scale_z") + tuple(f"misalignment_{p}" for p in PAIRS["full"])
    prior = np.array([PRIOR_SCALE] * 3 + [PRIOR_MISALIGNMENT] * 6)
    G, cov_g, spread = np.zeros((3, 3)), np.zeros((9, 9)), 0.0
    rates = np.array([r.rate for r in rests])
    true_force = np.array([np.linalg.solve(K, r.force - bias) for r in rests])
    if g_sensitivity:
        G, cov_g, spread = _g_sensitivity(true_force, rates)
    sense = np.linalg.solve(K.T, G.T).T  # acts on raw forces
    rest_bias = smooth_bias(rests, rates - true_force @ G.T)
    corrected_force = force - bias
    def up(row: int, number: int) -> Array:
        f = np.linalg.solve(K, _force_at(row, corrected_force, gyro, dt, rests[number], rest_bias[number]))
        return np.asarray(f / np.linalg.norm(f))

    gyro = np.ascontiguousarray(gyro)
    first, last = (np.array([getattr(t, k) for t in turns], dtype=np.int64) for k in ("first", "last"))
    b0 = np.array([rest_bias[t.before] for t in turns]).reshape(-1, 3)
    b1 = np.array([rest_bias[t.after] for t in turns]).reshape(-1, 3)
    start = np.array([up(t.first, t.before) for t in turns]).reshape(-1, 3)
    goal = np.array([up(t.last, t.after) for t in turns]).reshape(-1, 3)
    axes = np.array([t.axis for t in known], dtype=float).reshape(-1, 3)
    integrals, ideal = _integrals(time, dt, gyro, corrected_force, rests, rest_bias, sense, known)

    def moved(p: Array, at: NDArray[np.int64]) -> Array:
        inverse = np.linalg.inv(np.eye(3) + sum(v * B for v, B in zip(p, basis, strict=True)))
        out = np.empty((at.size, 3))
        transfer(
            gyro, dt, first[at], last[at], b0[at], b1[at], np.ascontiguousarray(inverse), sense, corrected_force,
            start[at], out,
        )  # fmt: skip
        return out

    def model_of(at: NDArray[np.int64], which: NDArray[np.int64]) -> Model:
        def residual(p: Array) -> Array:
            parts = [(moved(p, at) - goal[at]).ravel()]
            if which.size:
                inverse = np.linalg.inv(np.eye(3) + sum(v * B for v, B in zip(p, basis, strict=True)))
                off = integrals[which] @ inverse.T - ideal[which]
                along = np.sum(off * axes[which], axis=1)
                # The angle is known well; the axis only as well as the instrument was set down.
                parts += [along, (ACROSS * (off - along[:, None] * axes[which])).ravel()]
            return np.concatenate(parts)

        def model(p: Array) -> tuple[Array, Array]:
            r = residual(p)
            step = 1e-6
            J = np.column_stack([(residual(p + step * d) - residual(p - step * d)) / (2 * step) for d in np.eye(p.size)])
            return r, J

        return model

    every, all_known = np.arange(len(turns)), np.arange(len(known))
    floor = 1e-7
    p, cov, seen, _, condition = _observable_fit(model_of(every, all_known), prior, 2e-3, floor)

    def angles(q: Array, at: NDArray[np.int64]) -> Array:
        if at.size == 0:
            return np.empty(0)
        v = moved(q, at)
        return np.asarray(np.arctan2(np.linalg.norm(np.cross(v, goal[at]), axis=1), np.sum(v * goal[at], axis=1)))

    left = np.full(len(turns), np.nan)
    if holdout and len(turns) > 4:
        for i in every:
            keep = every[every != i]
            q, *_ = _observable_fit(model_of(keep, all_known), prior, 2e-3, floor, p)
            left[i] = angles(q, np.array([i]))[0]
    after = angles(p, every)
    before = angles(np.zeros(9), every)
    values, covariance, observable = p, cov, seen
    if g_sensitivity:
        names += tuple(f"g_sensitivity_{a}{b}" for a in "xyz" for b in "xyz")
        values = np.concatenate([p, G.ravel()])
        covariance = np.block([[cov, np.zeros((9, 9))], [np.zeros((9, 9)), cov_g]])
        observable = np.concatenate([seen, np.sqrt(np.diag(cov_g)) < SEEN * PRIOR_G])
    inverse = np.linalg.inv(np.eye(3) + sum(v * B for v, B in zip(p, basis, strict=True)))
    told = [(t, integrals[i] @ inverse.T) for i, t in enumerate(known)]
    return SensorFit(names, values, covariance, observable, after, before, left, condition), told


def _force_at(row: int, force: Array, gyro: Array, dt: Array, rest: Rest, bias: Array) -> Array:
    """(3,) mean force of a rest as it points at the start of a row: the tremor that the gyros saw is taken out."""
    rows, at = slice(rest.first, rest.last), row - rest.first
    step = (gyro[rows] - bias) * dt[rows, None]
    angle = np.cumsum(step, axis=0)  # at the end of a row; its force belongs to its middle
    angle = angle - 0.5 * step - (angle[at - 1] if at > 0 else 0.0)
    return np.asarray(np.mean(force[rows] + np.cross(angle, force[rows]), axis=0))


def _integrals(
    time: Array, dt: Array, gyro: Array, force: Array, rests: Sequence[Rest], rest_bias: Array, sense: Array,
    known: Sequence[Turn],
) -> tuple[Array, Array]:  # fmt: skip
    """(k, 3) integrals of the rates less bias over turns of known angle, (k, 3) what they should be, rad."""
    if not known:
        return np.empty((0, 3)), np.empty((0, 3))
    middles = np.array([0.5 * (r.start + r.end) for r in rests])
    out, ideal = [], []
    for t in known:
        rows = slice(t.first, t.last)
        bias = np.column_stack([np.interp(time[rows], middles, rest_bias[:, i]) for i in range(3)])
        rate = gyro[rows] - bias - force[rows] @ sense.T
        out.append(rate.T @ dt[rows])
        ideal.append(t.angle * np.asarray(t.axis))
    return np.array(out), np.array(ideal)


def _g_sensitivity(force: Array, rates: Array) -> tuple[Array, Array, float]:
    """G (3, 3) rad/s per m/s^2, covariance (9, 9) row by row, scatter: rates at rest = bias + G force."""
    X = np.column_stack([np.ones(len(force)), force])
    if len(force) < 6:
        return np.zeros((3, 3)), np.diag([PRIOR_G**2] * 9), 0.0
    x, *_ = np.linalg.lstsq(X, rates, rcond=None)
    left = rates - X @ x
    C = np.linalg.inv(X.T @ X)
    variance = np.sum(left**2, axis=0) / max(len(force) - 4, 1)
    cov = np.zeros((9, 9))
    for i in range(3):
        cov[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = C[1:, 1:] * variance[i]
    return np.ascontiguousarray(x[1:].T), cov, float(np.sqrt(variance.mean()))


def accel_matrix(fit: SensorFit) -> tuple[Array, Array]:
    """(I + M, bias) of a fitted triad; temperature terms are left out."""
    mis = [n for n in fit.names if n.startswith("misalignment_")]
    pairs = tuple(n.removeprefix("misalignment_") for n in mis)
    K = np.eye(3) + np.diag([fit.value(f"scale_{a}") for a in "xyz"])
    for pair, n in zip(pairs, mis, strict=True):
        K["xyz".index(pair[0]), "xyz".index(pair[1])] = fit.value(n)
    bias = np.array([fit.value(f"bias_{a}") if f"bias_{a}" in fit.names else 0.0 for a in "xyz"])
    return K, bias


def rest_like(rest: Rest, rate: Array) -> Rest:
    """The same rest with other gyro means."""
    return replace(rest, rate=rate)


def transfer_angles(
    time: Array, gyro: Array, force: Array, rests: Sequence[Rest], turns: Sequence[Turn], accel: SensorFit
) -> Array:
    """(t,) rad between gravity carried by the uncorrected gyros, less their biases, and as seen after each turn."""
    from schuler.kernels.transfer import transfer

    K, bias = accel_matrix(accel)
    dt = np.diff(time, prepend=time[0] - float(np.median(np.diff(time))))
    up = np.linalg.solve(K, np.array([r.force - bias for r in rests]).T).T
    up /= np.linalg.norm(up, axis=1)[:, None]
    rate = np.broadcast_to(np.mean([r.rate for r in rests], axis=0), (len(turns), 3)).copy()
    ends = [np.array([getattr(t, k) for t in turns], dtype=np.int64) for k in ("first", "last", "before", "after")]
    out = np.empty((len(turns), 3))
    zero = np.zeros((3, 3))
    transfer(np.ascontiguousarray(gyro), dt, ends[0], ends[1], rate, rate, np.eye(3), zero, force, up[ends[2]], out)
    goal = up[ends[3]]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(out, goal), axis=1), np.sum(out * goal, axis=1)))


def smooth_bias(rests: Sequence[Rest], rates: Array) -> Array:
    """(n, 3) gyro biases at the rests: a constant and a random walk, seen through white errors.

    A mean rate at rest errs by the tremor's angle over the rest's length; the walk's strength is the likeliest of a grid
    for each axis, none included.
    """
    n = len(rests)
    if n < 3:
        return np.broadcast_to(rates.mean(axis=0), rates.shape).copy()
    t = np.array([0.5 * (r.start + r.end) for r in rests])
    white = 1.0 / np.maximum(np.array([r.length for r in rests]), 0.5) ** 2
    walk = np.minimum(t[:, None], t[None, :]) - t[0]
    ones = np.ones(n)
    out = np.empty_like(rates)
    for i in range(3):
        y = rates[:, i]
        best = (np.inf, np.full(n, y.mean()))
        for q in (0.0, *np.geomspace(1e-5, 1.0, 11)):  # walk variance a second over the white variance of a 1 s rest
            K = np.diag(white) + q * walk
            inverse = np.linalg.inv(K)
            mean = float(ones @ inverse @ y / (ones @ inverse @ ones))
            r = y - mean
            variance = max(float(r @ inverse @ r) / (n - 1), 1e-30)
            cost = (n - 1) * np.log(variance) + np.linalg.slogdet(K)[1] + np.log(ones @ inverse @ ones)
            if cost < best[0] - (2.0 if q > 0.0 and best[0] < np.inf and q == 1e-5 else 0.0):
                best = (cost, mean + q * walk @ inverse @ r)
        out[:, i] = best[1]
    return out


def gyro_bias(rests: Sequence[Rest]) -> tuple[Array, Array]:
    """Mean rate at rest and its standard deviation over the rests (3,), rad/s, weighted by their length."""
    rates, weights = np.array([r.rate for r in rests]), np.array([r.length for r in rests])
    mean = np.average(rates, axis=0, weights=weights)
    scatter = np.sqrt(np.average((rates - mean) ** 2, axis=0, weights=weights) / max(len(rests) - 1, 1))
    return np.asarray(mean), np.asarray(scatter)
