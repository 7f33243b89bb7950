"""The gyros of a multi-position calibration: gravity carried from rest to rest, known turns, biases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from schuler.calibration.multiposition import (
    PAIRS,
    PRIOR_G,
    PRIOR_MISALIGNMENT,
    PRIOR_SCALE,
    SEEN,
    Model,
    SensorFit,
    accel_matrix,
    matrices,
    observable_fit,
)
from schuler.calibration.rests import Rest

Array = NDArray[np.float64]
ACROSS = 0.1  # weight of a known turn across its axis: instruments are set down to half a degree


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


def turns_between(rests: Sequence[Rest], longest: float = 10.0) -> list[Turn]:
    """A turn from near the end of each rest to near the start of the next, where they lie within `longest` s of each
    other.

    The points are half a second inside the rests, where the instrument has certainly stopped.
    """
    out = []
    for i, (a, b) in enumerate(zip(rests[:-1], rests[1:], strict=True)):
        if b.start - a.end <= longest:
            inside = [int(min(0.5, 0.5 * r.length) / r.length * (r.last - r.first)) for r in (a, b)]
            out.append(Turn(a.last - inside[0], b.first + inside[1], i, i + 1))
    return out


def fit_gyros(
    time: Array,
    gyro: Array,
    force: Array,
    rests: Sequence[Rest],
    turns: Sequence[Turn],
    accel: SensorFit,
    *,
    known: Sequence[Turn] = (),
    g_sensitivity: bool = False,
    holdout: bool = True,
) -> tuple[SensorFit, list[tuple[Turn, Array]]]:
    """Scale and full misalignment (9) from the transfer of gravity between rests and from turns of known angle.

    The bias of a turn goes linearly from the rest before to the rest after. g_sensitivity: nine more parameters, from
    the biases of the rests. Returns the fit and, for each known turn, its integral after correction, (3,) rad.
    """
    from schuler.kernels.transfer import transfer

    K, bias = accel_matrix(accel)
    dt = np.diff(time, prepend=time[0] - float(np.median(np.diff(time))))
    basis = matrices("full")
    names: tuple[str, ...] = ("scale_x", "scale_y", "scale_z") + tuple(f"misalignment_{p}" for p in PAIRS["full"])
    prior = np.array([PRIOR_SCALE] * 3 + [PRIOR_MISALIGNMENT] * 6)
    G, cov_g, spread = np.zeros((3, 3)), np.zeros((9, 9)), 0.0
    rates = np.array([r.rate for r in rests])
    true_force = np.array([np.linalg.solve(K, r.force - bias) for r in rests])
    if g_sensitivity:
        G, cov_g, spread = _g_sensitivity(true_force, rates)
    sense: Array = np.asarray(np.linalg.solve(K.T, G.T).T, dtype=np.float64)  # acts on raw forces
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
    # Where the accelerometers' own misalignment stayed hidden, gravity is no better a direction than the turn's axis.
    skew = [ok for n, ok in zip(accel.names, accel.observable, strict=True) if n.startswith("misalignment")]
    across = ACROSS if all(skew) else 1.0
    axes = np.array([t.axis for t in known], dtype=float).reshape(-1, 3)
    integrals, ideal = _integrals(time, dt, gyro, corrected_force, rests, rest_bias, sense, known)

    def moved(p: Array, at: NDArray[np.int64]) -> Array:
        inverse = np.linalg.inv(np.eye(3) + sum(v * B for v, B in zip(p, basis, strict=True)))
        out = np.empty((at.size, 3))
        transfer(
            gyro,
            dt,
            first[at],
            last[at],
            b0[at],
            b1[at],
            np.ascontiguousarray(inverse),
            sense,
            corrected_force,
            start[at],
            out,
        )
        return out

    def model_of(at: NDArray[np.int64], which: NDArray[np.int64]) -> Model:
        def residual(p: Array) -> Array:
            parts = [(moved(p, at) - goal[at]).ravel()]
            if which.size:
                inverse = np.linalg.inv(np.eye(3) + sum(v * B for v, B in zip(p, basis, strict=True)))
                off = integrals[which] @ inverse.T - ideal[which]
                along = np.sum(off * axes[which], axis=1)
                # The angle is known well; the axis only as well as the instrument was set down.
                parts += [along, (across * (off - along[:, None] * axes[which])).ravel()]
            return np.concatenate(parts)

        def model(p: Array) -> tuple[Array, Array]:
            r = residual(p)
            step = 1e-6
            J = np.column_stack(
                [(residual(p + step * d) - residual(p - step * d)) / (2 * step) for d in np.eye(p.size)]
            )
            return r, J

        return model

    every, all_known = np.arange(len(turns)), np.arange(len(known))
    floor = 1e-7
    p, cov, seen, _, condition = observable_fit(model_of(every, all_known), prior, 2e-3, floor)

    def angles(q: Array, at: NDArray[np.int64]) -> Array:
        if at.size == 0:
            return np.empty(0)
        v = moved(q, at)
        return np.asarray(np.arctan2(np.linalg.norm(np.cross(v, goal[at]), axis=1), np.sum(v * goal[at], axis=1)))

    left = np.full(len(turns), np.nan)
    if holdout and len(turns) > 4:
        for i in every:
            keep = every[every != i]
            q, *_ = observable_fit(model_of(keep, all_known), prior, 2e-3, floor, p)
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
    time: Array,
    dt: Array,
    gyro: Array,
    force: Array,
    rests: Sequence[Rest],
    rest_bias: Array,
    sense: Array,
    known: Sequence[Turn],
) -> tuple[Array, Array]:
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

    A mean rate at rest errs by the tremor's angle over the rest's length; the walk's strength is the likeliest of a
    grid
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
