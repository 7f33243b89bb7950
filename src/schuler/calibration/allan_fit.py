"""Noise terms of an inertial sensor from its Allan deviation, with intervals.

The Allan variance is linear in the squared coefficients, so they come from non-negative weighted least squares. The
estimates at different averaging times share their data: the intervals take their correlation from the spectrum of the
fitted model. Some model error is allowed at each averaging time, more in the first ten samples: sensors filter and
quantise there, and those points, known to a thousandth, would else decide everything.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.calibration.allan import FLICKER, WALK, WHITE, WHITE_PHASE, Deviation, deviation

Array = NDArray[np.float64]

FLOOR = float(np.sqrt(2.0 * np.log(2.0) / np.pi))  # 0.664: floor of the Allan deviation over the flicker coefficient
MODEL_ERROR = 0.03  # of the deviation, and more at short times:
SHORT = 20.0  # samples, where it has doubled; not so where the first samples prove to fit
FITS = 0.025  # of the deviation
SEEN = 1.5  # a term counts where its square is so many sigma above zero
_BUMP = 16.0  # drop of chi-square that two more parameters (correlated noise) must bring
TERMS = ("quantisation", "random_walk", "flicker", "rate_walk", "ramp")


@dataclass(frozen=True)
class Term:
    """A coefficient with its 68 % interval, SI."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class NoiseFit:
    """Terms of one sensor; None: not seen in this recording. SI with the rate's unit u (rad/s or m/s^2):

    quantisation u s; random_walk u sqrt(s) (angle or velocity random walk); flicker u (coefficient B, whose floor is
    0.664 B); rate_walk u/sqrt(s); ramp u/s; correlated: sigma u of a first-order Gauss-Markov process with time
    constant
    correlated_tau, s. floor: lowest deviation and floor_tau where it is, None where the deviation still falls at the
    longest time. alpha (k,): the dominating noise at each averaging time. model (k,): the fitted deviation.
    """

    terms: dict[str, Term]
    correlated: Term | None
    correlated_tau: Term | None
    floor: Term | None
    floor_tau: float | None
    alpha: NDArray[np.int64]
    model: Array

    @property
    def bias_instability(self) -> Term | None:
        """Floor over 0.664, the coefficient that datasheets call bias instability; None where no floor is reached."""
        if self.floor is None:
            return None
        return Term(self.floor.value / FLOOR, self.floor.low / FLOOR, self.floor.high / FLOOR)


def columns(tau: ArrayLike) -> Array:
    """(k, 5) Allan variance of the unit terms, in the order of TERMS."""
    t = np.asarray(tau, dtype=np.float64)
    return np.column_stack([3.0 / t**2, 1.0 / t, np.full_like(t, FLOOR**2), t / 3.0, t**2 / 2.0])


def gauss_markov_column(tau: ArrayLike, time_constant: float) -> Array:
    """(k,) Allan variance of a stationary Gauss-Markov process of unit sigma."""
    x = np.asarray(tau, dtype=np.float64) / time_constant
    small = x < 1e-3
    y = np.where(small, 1.0, x)
    full = 2.0 / y - (3.0 - 4.0 * np.exp(-y) + np.exp(-2.0 * y)) / y**2
    return np.where(small, 2.0 * x / 3.0, full)


def _spectra(f: Array, rate_hz: float, time_constant: float | None) -> Array:
    """(terms, nf) two-sided spectra of the rate for the unit terms, in the order of `columns`."""
    w = 2.0 * np.pi * f
    rows = [w**2 / rate_hz, np.ones_like(f), 1.0 / w, 1.0 / w**2, 1.0 / w**3]
    if time_constant is not None:
        rows.append(2.0 * time_constant / (1.0 + (w * time_constant) ** 2))
    return np.array(rows)


def relative_covariance(dev: Deviation, theta: Array, time_constant: float | None = None) -> Array:
    """(k, k) covariance of the Allan variances at dev.tau over their product, for squared coefficients theta.

    Correlations from the spectrum of the model: cov = 2/T * integral |H1|^2 |H2|^2 S^2 df; the diagonal is 2/edf.
    """
    tau = dev.tau
    f = np.geomspace(0.02 / tau[-1], 0.5 * dev.rate_hz, 1500)
    spectrum = theta @ _spectra(f, dev.rate_hz, time_constant)
    x = np.pi * f * tau[:, None]
    gain = np.where(x < 8.0, np.sin(np.minimum(x, 8.0)) ** 4, 0.375) / x**2
    weighted = gain * spectrum * np.sqrt(np.gradient(f))
    cov = weighted @ weighted.T
    scale = np.sqrt(np.diag(cov))
    sigma = np.sqrt(2.0 / dev.edf)
    return np.asarray(cov / np.outer(scale, scale) * np.outer(sigma, sigma))


def fit(values: ArrayLike, rate_hz: float, dev: Deviation | None = None) -> tuple[Deviation, NoiseFit]:
    """Noise terms of rates (n,) at rest, sampled at rate_hz; and `dev` with the confidence that the fit implies.

    The terms always come from the overlapping Allan deviation at the default averaging times, also where dev holds
    other
    times or another kind of deviation (None: the default itself).
    """
    base = deviation(values, rate_hz)
    out = base if dev is None else dev
    if not np.any(base.dev > 0.0):  # a sensor that never moves
        none = NoiseFit({}, None, None, None, None, np.zeros(base.m.size, dtype=np.int64), base.dev)
        return out, none
    result = fit_deviation(base)
    alpha = np.round(np.interp(np.log(out.tau), np.log(base.tau), result.alpha)).astype(np.int64)
    return out.with_noise(alpha), replace(result)


def fit_deviation(base: Deviation) -> NoiseFit:
    """The fit itself, from an overlapping Allan deviation."""
    keep = base.dev > 0.0
    seen = Deviation(
        base.kind, base.rate_hz, base.n, *(getattr(base, k)[keep] for k in ("m", "tau", "dev", "edf", "low", "high"))
    )
    y = seen.dev**2
    H = columns(seen.tau)
    theta, weights = _squares(seen, y, H)
    chi2 = _misfit(y, H, theta, weights)
    constant: float | None = None
    spread = (0.0, 0.0)
    trials = _trials(seen)
    found: list[tuple[float, float, Array, Array, Array]] = []
    for T in trials:
        wider = np.column_stack([H, gauss_markov_column(seen.tau, float(T))])
        got, w = _squares(seen, y, wider)
        if got[-1] > 0.0:
            found.append((_misfit(y, wider, got, w), float(T), wider, got, w))
    if found:
        best = min(found, key=lambda x: x[0])
        spare = max(1.0, best[0] / max(float(seen.tau.size - np.count_nonzero(best[3]) - 1), 1.0))
        if best[0] < chi2 - _BUMP * spare and trials[0] < best[1] < trials[-1]:
            near = [x[1] for x in found if x[0] < best[0] + spare]
            step = float(np.sqrt(float(trials[1]) / float(trials[0])))
            constant, spread = best[1], (float(min(near)) / step, float(max(near)) * step)
            chi2, H, theta, weights = best[0], best[2], best[3], best[4]
    first = seen.m <= SHORT
    off = np.sqrt(H[first] @ theta / y[first]) - 1.0
    short = 0.0 if first.any() and float(np.sqrt(np.mean(off**2))) < FITS else SHORT
    theta, cov = _prune(seen, y, H, constant, short)
    terms = {name: _root(theta[j], cov[j, j]) for j, name in enumerate(TERMS) if theta[j] > 0.0}
    correlated = tau = None
    if constant is not None and theta[-1] > 0.0:
        correlated, tau = _root(theta[-1], cov[-1, -1]), Term(constant, *spread)
    alpha = np.zeros(base.m.size, dtype=np.int64)
    alpha[keep] = dominating(H, theta, seen.tau)
    model = np.full(base.m.size, np.nan)
    model[keep] = np.sqrt(H @ theta)
    floor, floor_tau = _floor(seen.with_noise(alpha[keep]))
    return NoiseFit(terms, correlated, tau, floor, floor_tau, alpha, model)


def _trials(dev: Deviation) -> Array:
    """Time constants that the recording can tell from the other terms."""
    first, last = 3.0 * dev.tau[0], min(dev.tau[-1], dev.n / dev.rate_hz / 30.0)
    return np.geomspace(first, last, 25) if dev.tau.size > 10 and last > 3.0 * first else np.empty(0)


def _root(square: float, variance: float) -> Term:
    s = float(np.sqrt(max(variance, 0.0)))
    return Term(float(np.sqrt(square)), float(np.sqrt(max(square - s, 0.0))), float(np.sqrt(square + s)))


def _floor(dev: Deviation) -> tuple[Term | None, float | None]:
    k = int(np.argmin(dev.dev))
    if k >= dev.tau.size - 1 or dev.dev[k] <= 0.0:
        return None, None
    return Term(float(dev.dev[k]), float(dev.low[k]), float(dev.high[k])), float(dev.tau[k])


def dominating(H: Array, theta: Array, tau: Array) -> NDArray[np.int64]:
    """(k,) power of the rate's spectrum that dominates at each averaging time, from the slope of the fitted
    variance."""
    y = np.log(H @ theta)
    slope = np.gradient(y, np.log(tau)) if tau.size > 1 else np.full(1, -1.0)
    alpha = np.select([slope < -1.5, slope < -0.5, slope < 0.5], [WHITE_PHASE, WHITE, FLICKER], WALK)
    return np.asarray(alpha, dtype=np.int64)


def _model_error(dev: Deviation, short: float) -> Array:
    """(k,) of the Allan variance."""
    return np.asarray(2.0 * MODEL_ERROR * (1.0 + short / dev.m))


def _weights(dev: Deviation, model: Array, short: float) -> Array:
    """One over the standard deviation of each Allan variance: its statistics and what the model cannot say."""
    model_error = _model_error(dev, short)
    return np.asarray(1.0 / (np.sqrt(2.0 / dev.edf + model_error**2) * model))


def _squares(dev: Deviation, y: Array, H: Array, short: float = SHORT) -> tuple[Array, Array]:
    """Non-negative weighted least squares, weights from the model itself; points far off lose weight (Huber)."""
    from scipy.optimize import nnls

    robust = np.ones(y.size)
    weights = _weights(dev, y, short)
    theta = np.zeros(H.shape[1])
    for _ in range(8):
        scaled = H * (weights * robust)[:, None]
        size = np.linalg.norm(scaled, axis=0)
        new, _ = nnls(scaled / size, y * weights * robust)
        new /= size
        settled = np.allclose(new, theta, rtol=1e-4, atol=0.0)
        theta = new
        if settled or not np.any(theta > 0.0):
            break
        model = np.maximum(H @ theta, 1e-6 * y)
        weights = _weights(dev, model, short)
        off = np.abs(y - model) * weights
        robust = np.sqrt(np.minimum(1.0, 1.5 / np.maximum(off, 1e-12)))
    return theta, weights * robust


def _misfit(y: Array, H: Array, theta: Array, weights: Array) -> float:
    return float(np.sum(((y - H @ theta) * weights) ** 2))


def _prune(dev: Deviation, y: Array, H: Array, constant: float | None, short: float) -> tuple[Array, Array]:
    """Coefficients and their covariance; terms that are not seen go one by one.

    The estimator weighs each point by itself, which a wrong model harms less than full weighting; its covariance
    accounts for the correlation of the points and grows with the misfit.
    """
    p = H.shape[1]
    active = np.ones(p, dtype=bool)
    theta, cov = np.zeros(p), np.zeros((p, p))
    for _ in range(p):
        theta, cov = np.zeros(p), np.zeros((p, p))
        theta[active], weights = _squares(dev, y, H[:, active], short)
        active = theta > 0.0
        if not active.any():
            break
        model = H @ theta
        dev = dev.with_noise(dominating(H, theta, dev.tau))
        R = relative_covariance(dev, theta, constant)
        R += np.diag(_model_error(dev, short) ** 2)
        A = H[:, active] * weights[:, None]
        size = np.linalg.norm(A, axis=0)
        gain = np.linalg.pinv(A / size) / size[:, None]
        inner = R * np.outer(weights * model, weights * model)
        spare = max(1.0, _misfit(y, H, theta, weights) / max(y.size - int(active.sum()), 1))
        C = gain @ inner @ gain.T * spare
        cov[np.ix_(active, active)] = C
        strength = theta[active] / np.sqrt(np.diag(C))
        if active.sum() == 1 or strength.min() >= SEEN:
            break
        active[np.flatnonzero(active)[int(np.argmin(strength))]] = False
    return theta, cov
