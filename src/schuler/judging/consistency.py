"""Was the claimed uncertainty true: NEES of errors, NIS of innovations, chi-square bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Innovations
from schuler.judging.errors import ErrorSeries

Array = NDArray[np.float64]
CONFIDENCE = 0.99


def chi2_bounds(dof: int, n: int = 1, p: float = CONFIDENCE) -> tuple[float, float]:
    """Two-sided bounds of the mean, per degree of freedom, of n independent chi-square values of dof each; ideal 1.

    The sum has n dof degrees of freedom; the tails hold (1 - p) / 2 each.
    """
    from scipy.special import gammaincinv

    k = dof * n
    if k <= 0:
        return np.nan, np.nan
    low, high = 2.0 * gammaincinv(0.5 * k, 0.5 * (1.0 - p)), 2.0 * gammaincinv(0.5 * k, 0.5 * (1.0 + p))
    return float(low / k), float(high / k)


def chi2_quantile(dof: int, p: float) -> float:
    """The value that a chi-square variable stays below with probability p."""
    from scipy.special import gammaincinv

    return float(2.0 * gammaincinv(0.5 * dof, p))


def nees(error: Array, cov: Array) -> Array:
    """e' P^-1 e per degree of freedom, (n,), of errors (n, d) and covariances (n, d, d).

    NaN where either is unknown or the covariance is not positive definite.
    """
    n, d = error.shape
    out = np.full(n, np.nan)
    if n == 0:
        return out
    good = np.asarray(np.isfinite(error).all(axis=1) & np.isfinite(cov).all(axis=(1, 2)), dtype=bool)
    scale = np.sqrt(np.where(good[:, None], np.diagonal(cov, axis1=1, axis2=2), 1.0).clip(0.0))
    good = np.asarray(good & (scale > 0.0).all(axis=1), dtype=bool)
    if not good.any():
        return out
    # scaled to a unit diagonal, so that metres beside millimetres do not spoil the inverse
    R = cov[good] / (scale[good][:, :, None] * scale[good][:, None, :])
    e = error[good] / scale[good]
    definite = np.linalg.eigvalsh(R)[:, 0] > 1e-12
    value = np.full(len(R), np.nan)
    if definite.any():
        value[definite] = np.einsum(
            "ni,ni->n", e[definite], np.linalg.solve(R[definite], e[definite][..., None])[..., 0]
        )
    out[good] = value / d
    return out


def position_nees(series: ErrorSeries) -> Array:
    """Of the position, per degree of freedom: three where a height is estimated and known, else two."""
    down = series.cov_pos[:, 2, 2]
    vertical = np.isfinite(series.position[:, 2]) & np.isfinite(down) & (down > 0.0)
    flat = nees(series.position[:, :2], series.cov_pos[:, :2, :2])
    return np.where(vertical, nees(series.position, series.cov_pos), flat)


def _known_nees(error: Array, cov: Array) -> Array:
    """NEES over the components that the reference gives at all (a reference may know heading only)."""
    claimed = np.diagonal(cov, axis1=1, axis2=2) > 0.0
    known = np.flatnonzero((np.isfinite(error) & claimed).any(axis=0))
    if len(known) == 0:
        return np.full(len(error), np.nan)
    return nees(error[:, known], cov[:, known][:, :, known])


def _mean(values: Array) -> float | None:
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else None


def inside_3_sigma(series: ErrorSeries) -> float | None:
    """Share of all scalar errors (position, velocity, attitude) that lie inside their own 3 sigma."""
    inside = []
    triples = (
        (series.position, series.cov_pos),
        (series.velocity, series.cov_vel),
        (series.rpy, series.cov_rpy),
    )
    for error, cov in triples:
        variance = np.diagonal(cov, axis1=1, axis2=2)
        good = np.isfinite(error) & np.isfinite(variance) & (variance > 0.0)
        inside.append(np.abs(error[good]) <= 3.0 * np.sqrt(variance[good]))
    every = np.concatenate(inside)
    return float(every.mean()) if len(every) else None


def typical(nis: Array, dof: NDArray[np.int64]) -> float | None:
    """Median of NIS values (n,) of `dof` (n,) components each, over the median that chi-square has: ideal 1.

    Fewer than half of them being outliers move it little, and so does a gate that refuses some.
    """
    good = np.isfinite(nis) & (dof > 0)
    if not good.any():
        return None
    expected = {int(d): chi2_quantile(int(d), 0.5) for d in np.unique(dof[good])}
    return float(np.median(nis[good] / np.array([expected[int(d)] for d in dof[good]])))


def nis_table(innovations: Mapping[str, Innovations]) -> dict[str, dict[str, Any]]:
    """Mean NIS per degree of freedom of each kind of measurement, with the 99 % bounds for n of them, ideal 1.

    Only innovations that were used; "left_out" counts those that the gate refused. The bounds are for a mean over
    independent innovations. "median" (`typical`) is of all, used or not; its root, "sigma_factor", says how many
    times larger innovations are than their sigma.
    """
    table = {}
    for kind, i in innovations.items():
        used = np.asarray(i.used, dtype=bool) & np.isfinite(i.nis)
        d = i.value.shape[1] if i.value.ndim == 2 else 1
        seen = np.isfinite(i.value).sum(axis=1) if i.value.ndim == 2 else np.ones(len(i.time), dtype=int)
        dof = int(seen[used].sum())
        n = int(used.sum())
        mean = float(i.nis[used].sum() / dof) if dof else None
        low, high = chi2_bounds(1, dof) if dof else (None, None)
        median = typical(i.nis, seen)
        table[kind] = {
            "mean": mean,
            "low": low,
            "high": high,
            "n": n,
            "dof": d,
            "left_out": int(len(i.time) - np.asarray(i.used, dtype=bool).sum()),
            "median": median,
            "sigma_factor": None if median is None else float(np.sqrt(median)),
        }
    return table


def consistency(series: ErrorSeries | None, innovations: Mapping[str, Innovations]) -> dict[str, Any]:
    """C of summary.json; NEES are means per degree of freedom over the track, None without a reference."""
    if series is None or len(series) == 0:
        means: dict[str, Any] = dict.fromkeys(("nees_position", "nees_velocity", "nees_attitude"))
        share = None
    else:
        means = {
            "nees_position": _mean(position_nees(series)),
            "nees_velocity": _mean(_known_nees(series.velocity, series.cov_vel)),
            "nees_attitude": _mean(_known_nees(series.rpy, series.cov_rpy)),
        }
        share = inside_3_sigma(series)
    return {**means, "nis": nis_table(innovations), "inside_3_sigma": share}
