"""Allan, modified Allan and Hadamard deviation of a sensor at rest, with confidence.

All estimators use every overlapping difference. The confidence comes from the equivalent degrees of freedom for the
noise that dominates at each averaging time (Greenhall and Riley 2003, "Uncertainty of stability variances based on
finite differences"). The fit of noise terms is in `allan_fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError

Array = NDArray[np.float64]
Kind = Literal["oadev", "mdev", "hdev"]
KINDS: tuple[Kind, ...] = ("oadev", "mdev", "hdev")
_REACH = {"oadev": 2, "mdev": 3, "hdev": 3}  # averaging times that one difference spans
PER_DECADE = 10
_STRIDES = 64  # finer overlap than this many steps an averaging time adds no information worth counting
WHITE_PHASE, WHITE, FLICKER, WALK, RAMP = 2, 0, -1, -2, -3  # powers alpha of the rate's spectrum f^alpha


@dataclass(frozen=True)
class Deviation:
    """dev (k,) of the rate at averaging times tau (k,), s; low, high (k,): 68 % interval; edf (k,) degrees of freedom.

    m (k,) samples; rate_hz; n samples in all. The unit is that of the rate.
    """

    kind: Kind
    rate_hz: float
    n: int
    m: NDArray[np.int64]
    tau: Array
    dev: Array
    edf: Array
    low: Array
    high: Array

    def with_noise(self, alpha: ArrayLike) -> Deviation:
        """The same deviation with the confidence of other noise types: alpha (k,), powers of the rate's spectrum."""
        return _confident(self.kind, self.rate_hz, self.n, self.m, self.dev, np.asarray(alpha))


def default_samples(n: int, kind: Kind = "oadev") -> NDArray[np.int64]:
    """About ten averaging times a decade, from two samples to a tenth of the recording, in samples."""
    last = max(n // 10, 2)
    if n <= _REACH[kind] * 2:
        raise InputError(f"{n} samples are too few for an Allan deviation; record at least {_REACH[kind] * 10}")
    count = int(np.ceil(PER_DECADE * np.log10(last / 2.0))) + 1
    return np.unique(np.round(np.geomspace(2.0, last, max(count, 2))).astype(np.int64))


def samples_of(tau: Sequence[float], rate_hz: float, n: int, kind: Kind = "oadev") -> NDArray[np.int64]:
    """Averaging times in s as whole numbers of samples; InputError for one that the recording cannot give."""
    out = []
    for t in tau:
        m = round(t * rate_hz) if np.isfinite(t) else 0
        if m < 1:
            raise InputError(f"the averaging time {t:g} s is shorter than a sample ({1.0 / rate_hz:g} s)")
        if _REACH[kind] * m >= n:
            raise InputError(
                f"the averaging time {t:g} s needs more than {_REACH[kind] * t:g} s of recording for {kind}; "
                f"this one has "
                f"{n / rate_hz:g} s"
            )
        out.append(m)
    return np.array(out, dtype=np.int64)


def deviation(
    values: ArrayLike,
    rate_hz: float,
    tau: Sequence[float] | None = None,
    kind: Kind = "oadev",
) -> Deviation:
    """Deviation of rates (n,) sampled at rate_hz, each the mean over its interval.

    tau : averaging times in s, rounded to whole samples; None: about ten a decade. The confidence first takes the noise
    for white; `allan_fit.fit` refines it. Raises InputError for values that are not numbers and impossible times.
    """
    from schuler.kernels.allan import second_differences, third_differences

    if kind not in KINDS:
        raise InputError(f"{kind!r} is no deviation; type one of {', '.join(KINDS)}")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"a sampling rate of {rate_hz} Hz is not possible")
    y = np.asarray(values, dtype=np.float64)
    if y.ndim != 1 or not np.all(np.isfinite(y)):
        raise InputError("the Allan deviation needs a plain series of numbers without gaps")
    m = default_samples(y.size, kind) if tau is None else samples_of(tau, rate_hz, y.size, kind)
    x = np.empty(y.size + 1)
    x[0] = 0.0
    np.cumsum(y - np.mean(y), out=x[1:])  # phase in sample units; no deviation sees the mean
    sums = np.empty(m.size)
    if kind == "oadev":
        second_differences(x, m, sums)
        var = sums / (2.0 * m.astype(float) ** 2 * (x.size - 2 * m))
    elif kind == "hdev":
        third_differences(x, m, sums)
        var = sums / (6.0 * m.astype(float) ** 2 * (x.size - 3 * m))
    else:
        third_differences(np.concatenate([[0.0], np.cumsum(x - np.mean(x))]), m, sums)
        var = sums / (2.0 * m.astype(float) ** 4 * (x.size + 1 - 3 * m))
    return _confident(kind, rate_hz, y.size, m, np.sqrt(var), np.zeros(m.size, dtype=int))


def _confident(kind: Kind, rate_hz: float, n: int, m: NDArray[np.int64], dev: Array, alpha: NDArray) -> Deviation:
    from scipy.stats import chi2

    edf = np.array([degrees_of_freedom(n + 1, int(k), int(a), kind) for k, a in zip(m, alpha, strict=True)])
    half = 0.5 * 0.6826894921370859
    low = dev * np.sqrt(edf / chi2.ppf(0.5 + half, edf))
    high = dev * np.sqrt(edf / chi2.ppf(0.5 - half, edf))
    return Deviation(kind, float(rate_hz), int(n), m, m / rate_hz, dev, edf, low, high)


def degrees_of_freedom(points: int, m: int, alpha: int, kind: Kind = "oadev") -> float:
    """Equivalent degrees of freedom of a fully overlapping estimate; at least 0.5.

    points : of phase (samples + 1); m : samples averaged; alpha : power of the rate's spectrum (2 white phase ... -2
    random walk, -3 and -4 only for hdev). Greenhall and Riley (2003), their sum carried out at no more than 64 steps
    an averaging time.
    """
    d = 3 if kind == "hdev" else 2
    alpha = int(np.clip(alpha, -4 if d == 3 else -2, 2))
    if alpha > 0 and kind != "mdev":  # white phase noise: differences overlap only where they share points
        return max((points + 1) * (points - d * m) / (2.0 * (points - m)), 0.5)
    strides = min(m, _STRIDES)
    filt = 1.0 if kind == "mdev" else (float(m) if m <= _STRIDES else np.inf)
    reach = (m if kind == "mdev" else 1) + m * d
    count = 1 + strides * (points - reach) // m
    if count < 1:
        return 0.5
    j = np.arange(1, min(count, (d + 1) * strides))
    lags = np.concatenate([[0.0], j / strides])
    s = _structure(lags, filt, alpha, d)
    weights = np.concatenate([[1.0], 2.0 * (1.0 - j / count)])
    return max(float(count * s[0] ** 2 / np.sum(weights * s**2)), 0.5)


def _kernel(t: Array, alpha: int) -> Array:
    """Generalised autocovariance of phase whose rate has the spectrum f^alpha."""
    a = np.abs(t)
    with np.errstate(divide="ignore", invalid="ignore"):
        log = np.where(a > 0.0, np.log(np.where(a > 0.0, a, 1.0)), 0.0)
    return {
        4: np.zeros_like(a),
        2: -a,
        1: a**2 * log,
        0: a**3,
        -1: -(a**4) * log,
        -2: -(a**5),
        -3: a**6 * log,
        -4: a**7,
    }[alpha]


def _structure(t: Array, filt: float, alpha: int, d: int) -> Array:
    def smoothed(u: Array) -> Array:
        if np.isinf(filt):
            return _kernel(u, alpha + 2)
        step = 1.0 / filt
        return filt**2 * (2.0 * _kernel(u, alpha) - _kernel(u - step, alpha) - _kernel(u + step, alpha))

    if d == 2:
        return 6.0 * smoothed(t) - 4.0 * (smoothed(t - 1) + smoothed(t + 1)) + smoothed(t - 2) + smoothed(t + 2)
    return (
        20.0 * smoothed(t)
        - 15.0 * (smoothed(t - 1) + smoothed(t + 1))
        + 6.0 * (smoothed(t - 2) + smoothed(t + 2))
        - smoothed(t - 3)
        - smoothed(t + 3)
    )
