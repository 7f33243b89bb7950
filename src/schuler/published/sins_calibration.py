"""Chapters 4.2, 4.3: size effect, turntable positions and equations, figure 4.4's stops, what Table 4.2 says of the
rate.

Table 4.2's means and deviations stand in `sins_errata`.
"""

from __future__ import annotations

import numpy as np

from schuler.calibration import plan_design, thesis, turntable
from schuler.calibration.size_effect import Accelerometers, compensate, sensed, vibration_velocity
from schuler.ground.units import ARCMIN, DEG
from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, REPRODUCED, Row, judge
from schuler.truth.turntable import THESIS_PLAN, Turntable, positions_table
from schuler.truth.vibration import Vibration

SOURCE = "sins"
AGAIN = "recomputation of "
GAINS = (  # accelerometer: three positions, all five; condition of the three, of the five
    (("1.0", "2.236", "5.149"), ("0.617", "1.414", "3.464"), "7.39", "5.78"),
    (("1.414", "1.414", "3.742"), ("1.155", "1.414", "2.828"), "3.73", "3.23"),
    (("2.828", "2.915", "1.0"), ("2.828", "2.345", "0.577"), "4.53", "5.79"),
)
PRINTED_THIRD = ("-66.51", "-39.25", "-70.28")
TRUE_THIRD = (-11.0, 8.0, -66.51)  # mm


def rows() -> list[Row]:
    """Every figure of the two sections."""
    return [*_vibration(), *_positions(), *_equations(), *_errors(), *_table_4_2()]


def in_plane(
    second: tuple[float, float], variant: str | None, frequency: float = 10.0
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity of 60 s, m/s, in body axes and in fixed axes: x at (0.05, 0) m, y at `second`, 1 mrad about z."""
    dt, n = 5e-4, 120_000
    time = (np.arange(n) + 0.5) * dt
    C, w, wd = Vibration.tone(frequency, (0.0, 0.0, 1e-3)).motion(time)
    where = Accelerometers.triad([[0.05, 0.0, 0.0], [*second, 0.0], [0.0, 0.0, 0.0]])
    A = sensed(np.zeros_like(w), w, wd, where)
    if variant is not None:
        A = compensate(A, w, dt, where, variant=variant)  # type: ignore[arg-type]
    return A.sum(axis=0) * dt, np.einsum("nij,nj->i", C, A) * dt


def _vibration() -> list[Row]:
    made = []
    for nu, printed in ((10.0, "5.921763e-3"), (20.0, "2.368705e-2"), (40.0, "9.474820e-2")):
        closed = -float(vibration_velocity(1e-3, nu, 60.0, 0.05))
        found = -float(in_plane((0.0, 0.0), None, nu)[0][0])
        made.append(
            judge(
                SOURCE,
                f"{AGAIN}(4.3)",
                f"velocity of 60 s at {nu:g} Hz, 1 mrad, 0.05 m",
                "m/s",
                printed,
                closed,
                f"closed form; simulated {found:.7g}; the direction is against rho",
            )
        )
    same = in_plane((0.05, 0.0), None)[1]
    made.append(
        Row(
            SOURCE,
            "(4.3)",
            "fixed-axis velocity with both accelerometers at one point, 10 Hz",
            "m/s",
            None,
            float(np.linalg.norm(same)),
            CORRECTED,
            "only relative places matter: the other axis' tangential part undoes it",
        )
    )
    for variant, axis, printed, reason in (
        (None, 1, "-2.37e-3", "uncompensated; x gives zero"),
        ("rate-only", 0, "5.92e-3", "(4.4) without angular acceleration makes x worse than no compensation"),
    ):
        value = float(in_plane((0.05, 0.02), variant)[1][axis])
        made.append(
            judge(
                SOURCE,
                f"{AGAIN}(4.4)",
                f"velocity in {'xy'[axis]}, arms (0.05, 0), (0.05, 0.02) m, {variant or 'none'}",
                "m/s",
                printed,
                value,
                reason,
            )
        )
    left = float(np.linalg.norm(in_plane((0.05, 0.02), "full")[1]))
    made.append(
        Row(
            SOURCE,
            "(4.4)",
            "what full compensation leaves there",
            "m/s",
            None,
            left,
            CORRECTED,
            "angular acceleration by differences",
        )
    )
    return made


def _positions() -> list[Row]:
    made = []
    for i, used in enumerate(thesis.USED):
        right = float(np.linalg.matrix_rank(thesis.rows(i)[list(used)]))
        printed = float(np.linalg.matrix_rank(thesis.rows(i, thesis.PRINTED_PLAN)[list(used)]))
        if printed < 3.0:
            made.append(
                Row(
                    SOURCE,
                    "table 4.1",
                    f"rank of the system of accelerometer {i + 1}",
                    "1",
                    printed,
                    right,
                    CORRECTED,
                    thesis.WRONG[0],
                )
            )
        for word, positions, printed_gains, condition in (
            ("three positions", used, GAINS[i][0], GAINS[i][2]),
            ("all five", None, GAINS[i][1], GAINS[i][3]),
        ):
            gains, cond = thesis.gains(i, positions)
            where = f"{AGAIN}table 4.1 corrected"
            for j, text in enumerate(printed_gains):
                made.append(
                    judge(
                        SOURCE,
                        where,
                        f"noise gain of rho{i + 1}{j + 1}, {word}",
                        "1",
                        text,
                        float(gains[j]),
                        "sigma of rho per sigma of (A - A0)/w^2",
                        within=6e-4,
                    )
                )
            made.append(
                judge(
                    SOURCE,
                    where,
                    f"condition, accelerometer {i + 1}, {word}",
                    "1",
                    condition,
                    cond,
                    "of the rows W/w^2",
                )
            )
    table = plan_design.TableModel()
    five = plan_design.judge(np.array(THESIS_PLAN) * DEG, table)
    best = plan_design.design(5, table)
    made.append(
        Row(
            SOURCE,
            "table 4.1",
            "rms sigma of the best five positions over that of these five, same table time",
            "1",
            None,
            best.score / five.score,
            CORRECTED,
            "exchange over a 15 deg grid of settings",
        )
    )
    return made


def _equations() -> list[Row]:
    made = []
    found = thesis.printed_third(TRUE_THIRD)
    for j, text in enumerate(PRINTED_THIRD):
        made.append(
            Row(
                SOURCE,
                "(4.20)-(4.22)",
                f"rho3{j + 1} for true {TRUE_THIRD[j]:g} mm",
                "mm",
                float(found[j]),
                TRUE_THIRD[j],
                CORRECTED,
                f"printed equations give {text}; {thesis.WRONG[2]}; {thesis.WRONG[3]}",
            )
        )
    levers = 1e-3 * np.array([[28.08, -14.2, 9.3], [5.0, 31.0, -22.0], TRUE_THIRD])
    plan = positions_table(THESIS_PLAN, still_s=20.0, spin_s=36.0)
    table = Turntable(levers, bias=0.02, tilt=2.0 * ARCMIN)
    result = turntable.calibrate(table.record(plan, 20.0), plan)
    worst = max(float(np.max(np.abs(lever.rho - levers[i]))) for i, lever in enumerate(result.levers))
    made.append(
        Row(
            SOURCE,
            "section 4.3",
            "largest error of the corrected procedure without noise",
            "m",
            0.0,
            worst,
            REPRODUCED,
            "axis tilted by 2 arcmin, bias 0.02 m/s^2: the mean of eight stops takes both out",
        )
    )
    amplitude = float(np.linalg.norm(next(c for c in result.constants if c.rate == 0.0).harmonics[0]))
    made.append(
        Row(
            SOURCE,
            "figure 4.4",
            "amplitude over the eight stops for a tilt of 2 arcmin",
            "m/s^2",
            None,
            amplitude,
            REPRODUCED,
            "g times the tilt; its middle line is A0, as the figure has it",
        )
    )
    return made


def _errors() -> list[Row]:
    made = []
    levers = 1e-3 * np.array([[28.08, 0.0, 0.0], [0.0, 0.0, 0.0], TRUE_THIRD])
    for j, text in enumerate(("36.9", "26.5", "0.0")):
        used = np.array(THESIS_PLAN)[list(thesis.USED[2])] * DEG
        effect = plan_design.angle_effect(used, (0.0, 0.0, 1.0), levers[2])
        value = 1e6 * ARCMIN * float(np.sqrt(np.sum(effect[j] ** 2)))
        made.append(
            judge(
                SOURCE,
                f"{AGAIN}(4.23), (4.24)",
                f"rho3{j + 1} for 1 arcmin rms of the settings",
                "um",
                text,
                value,
                "linear; the recomputation drew random angles",
                within=0.6,
            )
        )
    return made


def _table_4_2() -> list[Row]:
    made = []
    for accelerometer, column in ((0, 2), (2, 4)):
        verdict, single = thesis.rate_verdict(accelerometer), thesis.statistics(column).single
        name = f"rho{accelerometer + 1}{accelerometer + 1}"
        made.append(
            Row(
                SOURCE,
                "table 4.2",
                f"table rate implied by accelerometer {accelerometer + 1} if A0 = 0",
                "deg/s",
                20.0,
                float(np.mean(verdict.implied)),
                NOT_REPRODUCIBLE,
                f"with A0 = {verdict.offset:.5f} m/s^2 unlisted but subtracted 20 deg/s fits; the step from "
                f"row to row needs "
                f"{verdict.step[0]:.1e} m/s^2 at 20 deg/s and {verdict.step[1]:.1e} at the implied rate, the "
                f"table has at most 1e-4",
            )
        )
        made.append(
            Row(
                SOURCE,
                "table 4.2",
                f"scatter of single turns, {name}",
                "mm",
                0.11 if accelerometer == 0 else 0.03,
                single,
                CORRECTED,
                "the rows are running means; undone, a turn scatters more",
            )
        )
    return made
