"""The thesis's turntable procedure as printed: Table 4.1, equations (4.14)-(4.22), Table 4.2; what is wrong and why.

The corrected set is the default of `turntable`; this module keeps the printed one as a variant for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.calibration.turntable import design_row
from schuler.truth.turntable import THESIS_PLAN, spin_axis

Array = NDArray[np.float64]

PRINTED_PLAN = ((0.0, 0.0), (45.0, 0.0), (45.0, 45.0), (-45.0, 0.0), (-45.0, -45.0))  # Table 4.1, gamma, beta, deg
# Positions that the thesis's systems use for accelerometers 1, 2, 3 (from 0).
USED = ((0, 1, 2), (1, 2, 3), (0, 2, 4))
WRONG = (
    "Table 4.1 has the columns of rows 2 and 4 exchanged: with beta = 0 positions 1, 2 and 4 are one position",
    "(4.11): the third component lacks the factor sin(beta), so that the axis is no unit vector",
    "(4.20): the unknown is rho33, not rho31",
    "(4.21): the sign of sqrt(2) rho32 is plus",
)

# Table 4.2: turns, A1 m/s^2, rho11 mm, A3 m/s^2, rho33 mm (printed as rho13).
TABLE_4_2 = (
    (1, -0.0249, 28.271, 0.062, 66.457),
    (2, -0.0248, 28.177, 0.062, 66.508),
    (3, -0.0248, 28.096, 0.062, 66.532),
    (4, -0.0248, 27.996, 0.062, 66.537),
    (5, -0.0248, 27.984, 0.062, 66.522),
    (6, -0.0248, 27.953, 0.062, 66.524),
)


def printed_axis(gamma: ArrayLike, beta: ArrayLike) -> Array:
    """(..., 3) of (4.11) as printed, no unit vector; angles in rad."""
    g, b = np.asarray(gamma, dtype=np.float64), np.asarray(beta, dtype=np.float64)
    return np.stack([np.cos(g) * np.sin(b), np.cos(b) + 0.0 * g, np.sin(g) + 0.0 * b], axis=-1)


def rows(accelerometer: int, plan: ArrayLike = THESIS_PLAN) -> Array:
    """(k, 3) design rows W/w^2 of accelerometer 0, 1 or 2 at a plan in degrees."""
    angles = np.deg2rad(np.asarray(plan, dtype=np.float64))
    return design_row(spin_axis(angles[:, 0], angles[:, 1]), np.eye(3)[accelerometer])


def gains(accelerometer: int, positions: tuple[int, ...] | None = None) -> tuple[Array, float]:
    """((3,) sigma of rho per unit sigma of (A - A0)/w^2, condition number) with some of the five positions, or all."""
    W = rows(accelerometer)
    W = W if positions is None else W[list(positions)]
    return np.sqrt(np.diag(np.linalg.inv(W.T @ W))), float(np.linalg.cond(W))


def printed_third(rho: ArrayLike) -> Array:
    """(3,) what the printed (4.20)-(4.22) give for accelerometer 3 whose true lever is rho (3,), same unit."""
    y = rows(2)[list(USED[2])] @ np.asarray(rho, dtype=np.float64)  # (A - A0)/w^2 at positions 1, 3, 5
    s = np.sqrt(2.0)
    W = np.array([[-1.0, 0.0, 0.0], [0.25, -0.25 * s, -0.75], [-0.25, 0.25 * s, -0.75]])
    return np.asarray(np.linalg.solve(W, y))


@dataclass(frozen=True)
class Statistics:
    """Of a column of Table 4.2, mm. The rows are running means; `single`: scatter of the turns themselves, undone."""

    mean: float
    std_n: float
    std_n1: float
    single: float


def statistics(column: int) -> Statistics:
    """column 2: rho11; 4: rho33."""
    x = np.array([r[column] for r in TABLE_4_2])
    n = np.arange(1, len(x) + 1)
    turns = np.diff(np.concatenate([[0.0], n * x]))
    return Statistics(float(x.mean()), float(x.std()), float(x.std(ddof=1)), float(turns.std(ddof=1)))


@dataclass(frozen=True)
class RateVerdict:
    """Does 20 deg/s fit Table 4.2? implied (deg/s): from A = -w^2 rho with A0 = 0, lowest and highest of the rows.

    step: change of A, m/s^2, that the whole change of rho needs at 20 deg/s and at the implied rate; the printed A
    changes by at most one last digit, 1e-4. offset: A0 in m/s^2 that makes 20 deg/s right.
    """

    implied: tuple[float, float]
    step: tuple[float, float]
    offset: float


def rate_verdict(accelerometer: int, rate_deg_per_s: float = 20.0) -> RateVerdict:
    """accelerometer 0 or 2. For 2 the printed sign of A does not even fit a centripetal acceleration."""
    a, r = (1, 2) if accelerometer == 0 else (3, 4)
    A, rho = np.array([x[a] for x in TABLE_4_2]), 1e-3 * np.array([x[r] for x in TABLE_4_2])
    implied = np.rad2deg(np.sqrt(np.abs(A) / rho))
    span = float(rho.max() - rho.min())
    w = np.deg2rad(rate_deg_per_s)
    offset = float(np.mean(A + w * w * rho))
    return RateVerdict(
        (float(implied.min()), float(implied.max())),
        (w * w * span, float(np.deg2rad(implied.mean()) ** 2 * span)),
        offset,
    )
