"""Chapter 2.2 and (2.50): attitude equations, Runge-Kutta methods and their drift."""

from __future__ import annotations

import math

import numpy as np

from schuler.inertial import attitude_study as study
from schuler.published.ledger import CORRECTED, Row, judge

SOURCE = "sins"
STEPS = (63, 126, 628)  # in a period: h = 0.0997, 0.0499, 0.0100 s
# Mean psi drift of the motion (2.23), rad/s: an independent recomputation.
DRIFT = {
    ("euler", 1): ("1.700211e-5", "4.249035e-6", "1.710258e-7"),
    ("euler", 2): ("-3.296637e-5", "-8.246048e-6", "-3.320036e-7"),
    ("euler", 3): ("-4.488028e-8", "-2.806413e-9", "-4.55e-12"),
    ("euler", 4): ("-4.307220e-9", "-2.693947e-10", "-4.37e-13"),
    ("poisson", 1): ("1.942676e-5", "4.862180e-6", "1.958863e-7"),
    ("poisson", 2): ("-3.394798e-5", "-8.492882e-6", "-3.419575e-7"),
    ("poisson", 3): ("-5.351348e-8", "-3.347280e-9"),
    ("poisson", 4): ("-3.062661e-9", "-1.914014e-10"),
    ("quaternion", 1): ("1.699213e-5", "4.247566e-6", "1.709806e-7"),
    ("quaternion", 2): ("-3.296558e-5", "-8.245896e-6", "-3.319980e-7"),
    ("quaternion", 3): ("-4.528414e-8", "-2.831662e-9"),
    ("quaternion", 4): ("-3.895660e-9", "-2.436397e-10"),
}
LISTING = study.Law((0.0, 0.1, 0.2), (1.0, 1.0, 1.0), (0.0, 0.5 * math.pi, 0.0))


def constant(order: int, steps: int = 400, amplitude: float = 1e-2) -> float:
    """k_N as found: drift over h^N theta gamma w^(N+1) where the phase makes the sine 1."""
    law = study.Law((0.0, amplitude, amplitude), phase=(0.0, 0.0, (order + 1) * 0.5 * math.pi))
    h = 2.0 * math.pi / steps
    return study.psi_drift("euler", order, steps, law=law, periods=2) / (h**order * amplitude**2)


def slope(order: int) -> float:
    """Power of h in the drift at the thesis's phase of 90 deg, between 63 and 126 steps a period."""
    a, b = (study.psi_drift("euler", order, s, periods=3) for s in STEPS[:2])
    return math.log(a / b) / math.log(STEPS[1] / STEPS[0])


def rows() -> list[Row]:
    """Every figure of the chapter."""
    made = []
    for (form, order), values in DRIFT.items():
        for steps, printed in zip(STEPS, values, strict=False):
            ours = study.psi_drift(form, order, steps, periods=20)  # type: ignore[arg-type]
            made.append(
                judge(
                    SOURCE,
                    "recomputation of figures 2.10, 2.11",
                    f"psi drift, {form}, RK{order}, {steps} steps a period",
                    "rad/s",
                    printed,
                    ours,
                    "motion (2.23): psi 0, theta 0.2 sin t, gamma 0.2 cos t",
                    within=2e-3 * abs(float(printed)),
                )
            )
    for order, (printed, within) in enumerate(
        (("-0.24999", 2e-5), ("0.08331", 1e-4), ("-0.0208", 1e-4), ("-0.00104", 1e-5)), 1
    ):
        made.append(
            judge(
                SOURCE,
                "recomputation of (2.50)",
                f"constant k_{order} of the drift law",
                "1",
                printed,
                constant(order),
                f"k = {('-1/4', '1/12', '-1/48', '-1/960')[order - 1]}; (2.50) has no constant and a factor psi_m "
                f"that is 0 "
                "in its own motion",
                within=within,
            )
        )
    for order, printed in ((1, "2"), (2, "2"), (3, "4"), (4, "4")):
        made.append(
            judge(
                SOURCE,
                "recomputation of figure 2.15",
                f"power of h, RK{order}, phase 90 deg",
                "1",
                printed,
                slope(order),
                "odd methods have no h^N term at that phase",
                within=0.02,
            )
        )
    law = study.Law(phase=(0.0, 0.0, 0.5 * math.pi))
    drift = study.psi_drift("euler", 2, 126, law=law)
    made.append(
        Row(
            SOURCE,
            "(2.50)",
            "psi drift by the law as printed for its own motion (psi_m = 0), RK2, 126 steps",
            "rad/s",
            0.0,
            drift,
            CORRECTED,
            "the factor psi_m must go: the motion has none and drifts all the same",
        )
    )
    return [*made, *_orthogonality(), *_errata()]


def _orthogonality() -> list[Row]:
    coarse = study.integrate("poisson", 1, 0.05, 600.0, law=LISTING, every=12000)
    fine = study.integrate("poisson", 1, 0.005, 600.0, law=LISTING, every=120000)
    fourth = study.integrate("poisson", 4, 0.05, 600.0, law=LISTING, every=12000)
    dense = study.integrate("poisson", 1, 0.05, 600.0, law=LISTING)
    why = "RK1 on the direction cosines destroys orthogonality: renormalise, or use a quaternion"
    made = [
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "det C after 600 s, RK1, h = 0.05",
            "1",
            "2.1169",
            float(np.linalg.det(coarse.C[-1])),
            why,
        ),
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "det C after 600 s, RK1, h = 0.005",
            "1",
            "1.0779",
            float(np.linalg.det(fine.C[-1])),
            why,
        ),
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "det C - 1 after 600 s, RK4, h = 0.05",
            "1",
            "6e-9",
            float(np.linalg.det(fourth.C[-1])) - 1.0,
            "the fourth order keeps it",
        ),
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "largest roll error, RK1, h = 0.05",
            "deg",
            "0.55",
            math.degrees(float(np.abs(dense.error[:, 2]).max())),
            why,
            within=0.03,
        ),
    ]
    for i, printed in enumerate(("1.350", "1.080", "1.452")):
        made.append(
            judge(
                SOURCE,
                "recomputation of listing A.1",
                f"length of row {i + 1} of C after 600 s, RK1",
                "1",
                printed,
                float(np.linalg.norm(coarse.C[-1, i])),
                why,
            )
        )
    return made


def _errata() -> list[Row]:
    rng = np.random.default_rng(3)
    a, a1 = rng.uniform(-0.5, 0.5, 3), rng.uniform(-0.5, 0.5, 3)
    step = 1e-5
    C = study.dcm_zxy(*a)
    dC = (study.dcm_zxy(*(a + step * a1)) - study.dcm_zxy(*(a - step * a1))) / (2.0 * step)
    W = C.T @ dC  # [w x] in body axes
    w = np.array([W[2, 1], W[0, 2], W[1, 0]])
    th, ga = a[1], a[2]
    by_224 = w[0] * math.cos(ga) + w[2] * math.sin(ga)
    printed = w[0] * math.cos(ga) + w[2] * math.cos(ga)
    symmetric = float(np.abs(W + W.T).max())
    other = C @ dC
    heading = (w[2] * math.cos(ga) - w[0] * math.sin(ga)) / math.cos(th)

    def fixed(where: str, what: str, reason: str, was: float | None, ours: float) -> Row:
        return Row(SOURCE, where, what, "1", was, ours, CORRECTED, reason)

    return [
        judge(
            SOURCE,
            "(2.22)",
            "theta rate at a random attitude, rad/s",
            "rad/s",
            f"{a1[1]:.9f}",
            by_224,
            "correct as printed: equals the finite difference",
            within=1e-8,
        ),
        judge(
            SOURCE,
            "(2.22)",
            "psi rate at a random attitude, rad/s",
            "rad/s",
            f"{a1[0]:.9f}",
            heading,
            "correct as printed",
            within=1e-8,
        ),
        fixed("(2.19) row 2", "theta rate there", "w_x cos(gamma) + w_z sin(gamma)", float(printed), float(a1[1])),
        fixed(
            "(2.27)",
            "largest symmetric part of the product",
            "C^T dC/dt is antisymmetric, the printed C dC/dt is not",
            float(np.abs(other + other.T).max()),
            symmetric,
        ),
        fixed(
            "(2.28), (2.32)",
            "largest residual of dC/dt = C [w x]",
            "no transpose on C",
            float(np.abs(dC - C.T @ W).max()),
            float(np.abs(dC - C @ W).max()),
        ),
        fixed(
            "matrix after (2.32)",
            "sum of elements (2,3) and (3,2)",
            "element (2,3) is -w_x, printed -w_y",
            float(w[0] - w[1]),
            0.0,
        ),
    ]
