"""What the innovations of GNSS positions and velocities say of the antenna's lever arm.

An antenna that sits dl (body) from where it was said to be makes innovations (measured - predicted, NED)

    y_i = A_i dl - s_i + noise,        s_(i+1) = s_i + K_i (A_i dl - s_i),        s_0 = 0

with A = C_nb for positions and C_nb [w x] for velocities, w the rate of the body. s is what the filter has taken into
its state by then: after some fixes on one heading a wrong arm is gone from the position's innovations, and a turn
brings it back. K = 1 - R/S is the filter's own weight of a fix, from the fix's variance R and the innovation's S. Both
lines are linear in dl: y_i = H_i dl, H_i = A_i - B_i, B_(i+1) = B_i + K_i H_i, B_0 = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
BLOCKS = 10
SURE = 4.0  # sigmas
OVER_FIX = 3.0  # sigmas of a fix: a smaller arm is lost in its noise
EXPLAINS = 0.9  # of the squared innovations may be left at most
GATE = 5.0  # innovations beyond so many times their typical size are left out
UNKNOWN_M = 30.0  # an arm whose sigma is larger is not seen at all


@dataclass(frozen=True)
class LeverCorrection:
    """correction, sigma (3,) m in body FRD: to be added to the arm that was used, inf sigma where it is not seen.
    rms_before, rms_after: of the innovations, m; n: fixes used."""

    correction: Array
    sigma: Array
    rms_before: float
    rms_after: float
    n: int

    @property
    def sure(self) -> NDArray[np.bool_]:
        """(3,) components far outside their sigma."""
        return np.asarray(np.abs(self.correction) > SURE * self.sigma)


def lever_correction(
    innovation: ArrayLike, arm: ArrayLike, std: ArrayLike | None = None, fix_std: ArrayLike | None = None
) -> LeverCorrection | None:
    """Least-squares correction of a lever arm from GNSS innovations, None where fewer than 30 can be used.

    innovation : (n, 3) NED, m or m/s, measured - predicted, in order of time; NaN where a component is not known.
    arm : (n, 3, 3) at these times, C_nb for positions, `velocity_arm` for velocities.
    std : (n, 3), root of the diagonal of the innovation's covariance S. fix_std : (n, 3) of the fix itself; with std it
    tells the filter's weight of a fix. Without it nothing is taken to be absorbed (K = 0), as for residuals of a track
    that has not used these fixes.

    The sigma is the larger of the formal one and that of ten blocks' scatter, so that slow errors of fixes count.
    """
    y, A = np.asarray(innovation, dtype=float), np.asarray(arm, dtype=float)
    n = len(y)
    S = np.ones((n, 3)) if std is None else np.asarray(std, dtype=float)
    H = _absorbed(A, S, fix_std)
    good = np.isfinite(y) & np.isfinite(S) & (S > 0.0) & np.isfinite(H).all(axis=2)
    size = np.where(good, np.abs(y) / np.where(good, S, 1.0), np.nan)
    for k in range(3):
        if good[:, k].any():
            typical = max(float(np.nanmedian(size[:, k])) / 0.6745, 1e-12)
            good[:, k] &= size[:, k] <= GATE * typical
    used = good[:, :2].all(axis=1)
    if used.sum() < 30:
        return None
    weight = np.where(good, 1.0 / np.where(good, S, 1.0), 0.0)
    W, b = H * weight[:, :, None], np.where(good, y, 0.0) * weight
    W[~good] = 0.0
    N, r = np.einsum("nij,nik->njk", W, W), np.einsum("nij,ni->nj", W, b)
    total = N.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
    seen = values > 1e-9
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T / np.outer(scale, scale)
    dl = inverse @ r.sum(axis=0)
    left = b - np.einsum("nij,j->ni", W, dl)
    dof = max(int(good.sum()) - 3, 1)
    formal = inverse * max(float((left**2).sum()) / dof, 1e-12)
    edges = np.linspace(0, n, BLOCKS + 1).astype(int)
    pulls = np.array([r[a:c].sum(axis=0) - N[a:c].sum(axis=0) @ dl for a, c in zip(edges, edges[1:], strict=False)])
    scatter = inverse @ (pulls.T @ pulls) @ inverse * BLOCKS / (BLOCKS - 1)
    sigma = np.sqrt(np.maximum(np.diag(formal), np.diag(scatter)))
    # a direction that no fix tells of has no say in dl, and no sigma
    hidden = np.sqrt(np.sum(vectors[:, ~seen] ** 2, axis=1)) > 0.1
    sigma = np.where(hidden | (sigma > UNKNOWN_M), np.inf, sigma)
    dl = np.where(np.isinf(sigma), 0.0, dl)
    before, after = (np.where(good, v, 0.0) for v in (y, y - np.einsum("nij,j->ni", H, dl)))
    rms = [float(np.sqrt((v**2).sum() / max(good.any(axis=1).sum(), 1))) for v in (before, after)]
    return LeverCorrection(dl, sigma, rms[0], rms[1], int(used.sum()))


def velocity_arm(C_nb: ArrayLike, w_nb_b: ArrayLike) -> Array:
    """C_nb [w x], (n, 3, 3): the velocity of a point at an arm of the body, NED, from the body's rate (n, 3) rad/s."""
    w = np.asarray(w_nb_b, dtype=float)
    cross = np.zeros((len(w), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    return np.asarray(np.asarray(C_nb, dtype=float) @ cross)


def _absorbed(A: Array, std: Array, fix_std: ArrayLike | None) -> Array:
    """H (n, 3, 3) of the module's first lines."""
    if fix_std is None:
        return A.copy()
    fix = np.broadcast_to(np.asarray(fix_std, dtype=float), std.shape)
    with np.errstate(all="ignore"):
        K = np.nan_to_num(np.clip(1.0 - (fix / std) ** 2, 0.0, 1.0))
    H = np.empty_like(A)
    taken = np.zeros((3, 3))
    for i in range(len(A)):
        H[i] = A[i] - taken
        if np.isfinite(H[i]).all():
            taken = taken + K[i][:, None] * H[i]
    return H


def lever_words(
    found: LeverCorrection | None, antenna_frd: Sequence[float], fix_sigma: float, name: str = "antenna"
) -> str | None:
    """One sentence where the arm is surely wrong; else None.

    Surely: more than 4 sigma and more than 3 sigmas of a fix, and a tenth of the squared innovations goes with it.
    antenna_frd : (3,) m, the arm that was used. fix_sigma : m, of a fix, one axis; from velocities
    what they would see of an arm.
    """
    if found is None:
        return None
    change = np.where(found.sure, found.correction, 0.0)
    if float(np.linalg.norm(change)) <= OVER_FIX * fix_sigma or found.rms_after**2 > EXPLAINS * found.rms_before**2:
        return None
    digits = 2 if fix_sigma < 0.3 else 1
    sigma = ["unseen" if np.isinf(s) else f"{s:.{digits}f}" for s in found.sigma]
    better = np.asarray(antenna_frd, dtype=float) + change
    return (
        f"{name}_frd_m looks wrong by about {_list(change, digits)} m (1 sigma [{', '.join(sigma)}]); type "
        f'{name}_frd_m = {_list(better, digits)} under [mounting], or estimate = ["{name}_lever"] under [filter]'
    )


def _list(values: Array, digits: int) -> str:
    return "[" + ", ".join(f"{v + 0.0:.{digits}f}" for v in np.round(values, digits)) + "]"
