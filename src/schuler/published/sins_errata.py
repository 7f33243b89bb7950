"""Errata of the thesis's chapter 4 that a few lines show; what needs more stands with its own subject."""

from __future__ import annotations

import math

import numpy as np

from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, Row, judge

SOURCE = "sins"
RHO_11 = (28.271, 28.177, 28.096, 27.996, 27.984, 27.953)  # table 4.2, mm
RHO_33 = (66.457, 66.508, 66.532, 66.537, 66.522, 66.524)
A_11 = (-0.0249, -0.0248, -0.0248, -0.0248, -0.0248, -0.0248)  # m/s^2


def _fixed(
    where: str, what: str, reason: str, unit: str = "1", was: float | None = None, ours: float | None = None
) -> Row:
    return Row(SOURCE, where, what, unit, was, ours, CORRECTED, reason)


def rows() -> list[Row]:
    """Rows of sections 4.1 to 4.3."""
    ga, be = 0.7, 0.5
    third = {"printed": math.sin(ga), "right": math.sin(ga) * math.sin(be)}
    norm = {k: math.hypot(math.cos(ga) * math.sin(be), math.cos(be), v) for k, v in third.items()}
    accel = abs(float(np.mean(A_11)))
    rate = math.degrees(math.sqrt(accel / (float(np.mean(RHO_11)) * 1e-3)))
    return [
        judge(SOURCE, "table 4.2", "mean of rho11", "mm", "28.08", float(np.mean(RHO_11)), "as printed"),
        judge(
            SOURCE,
            "table 4.2",
            "standard deviation of rho11",
            "mm",
            "0.11",
            float(np.std(RHO_11)),
            "rows are running means: the spread of single turns is 0.2 mm",
        ),
        judge(
            SOURCE,
            "table 4.2",
            "mean of rho33 (printed rho31, rho13)",
            "mm",
            "66.51",
            float(np.mean(RHO_33)),
            "the index is 33",
        ),
        judge(SOURCE, "table 4.2", "standard deviation of rho33", "mm", "0.03", float(np.std(RHO_33)), "as printed"),
        Row(
            SOURCE,
            "table 4.2",
            "table rate that its accelerations imply",
            "deg/s",
            20.0,
            rate,
            NOT_REPRODUCIBLE,
            "fits 20 deg/s only if an unlisted A0 was subtracted",
        ),
        _fixed(
            "(4.11)",
            "length of the axis at gamma 0.7, beta 0.5 rad",
            "third component sin(gamma) sin(beta)",
            "1",
            norm["printed"],
            norm["right"],
        ),
        _fixed("(4.3)", "sign of the rectified velocity", "minus along rho, and only between unequal lever arms"),
        _fixed("(4.4)", "angular acceleration", "- (dw/dt x rho) e is missing unless rho is parallel to e"),
        _fixed("(4.6)", "(w, rho)", "(w, e)(w, rho), as in (4.8)"),
        _fixed("(4.9)", "axis of Lambda_alpha", "the vertical axis i_2, as (4.10) has it"),
        _fixed("table 4.1 rows 2, 4", "(gamma, beta)", "(0, pi/4) and (0, -pi/4): as printed the positions coincide"),
        _fixed("(4.20), (4.21)", "unknown and sign", "rho33, and + sqrt2 rho32"),
    ]
