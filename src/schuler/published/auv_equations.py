"""Ledger rows of the AUV paper's equations: what is printed, what is right, and the values of one epoch."""

from __future__ import annotations

from functools import partial
from math import cos, degrees, radians, sin

import numpy as np
from numpy.typing import NDArray

from schuler.aiding import paper
from schuler.ground import frames
from schuler.ground.earth import OMEGA, WGS84
from schuler.published.auv_figures import REFERENCE_LAT_DEG, euler_drift, metres_per_degree
from schuler.published.ledger import CORRECTED, Row, judge

Array = NDArray[np.float64]
SOURCE = "auv"

# The epoch at which the equations are tried: deg, deg/s; rates rad/s. Assumed; any other would do.
EPOCH_X = np.radians([5.0, -8.0, 60.0, 0.2, -0.1, -0.053])
EPOCH_U = np.array([0.02, -0.01, 0.03])
EPOCH_P = np.diag(np.radians([2.0, 2.0, 3.0, 0.1, 0.1, 0.05]) ** 2)
EPOCH_R_DEG = (20.0, 20.0, 3.0)
EPOCH_INNOVATION_DEG = (0.5, -0.3, 2.0)
DT = 0.01
GRAVITY = 9.80


def corrected(where: str, quantity: str, unit: str, published: float | None, ours: float, reason: str) -> Row:
    """An erratum: published is what the equation gives as printed (None: no number), ours what it gives corrected."""
    printed = None if published is None else float(published)
    return Row(SOURCE, where, quantity, unit, printed, float(ours), CORRECTED, reason)


def predicted(literal: bool = False) -> tuple[Array, Array]:
    """State and covariance one 10 ms interval after the epoch, by the kernel."""
    from schuler.kernels.paper import predict

    x, P = EPOCH_X.copy(), EPOCH_P.copy()
    predict(x, P, EPOCH_U, DT, radians(0.03), radians(2e-4), literal, np.zeros((3, 6)), np.zeros((6, 6)))
    return x, P


def filtered() -> tuple[Array, Array]:
    """The same after the three rows of the measurement, one by one as the kernel takes them."""
    from schuler.kernels.paper import update_row

    x, P = predicted()
    target = x[:3] + np.radians(EPOCH_INNOVATION_DEG)
    for row, sigma in enumerate(EPOCH_R_DEG):
        update_row(
            x, P, row, target[row] - x[row], radians(sigma) ** 2, False, False, False, np.zeros(6), np.zeros(6)
        )  # fmt: skip
    return x, P


def jacobian_twin_difference() -> float:
    """Largest difference, 1/s, between A and five-point central differences of f at the epoch."""
    h = 1e-3
    numerical = np.zeros((6, 6))
    for k in range(6):
        step = np.zeros(6)
        step[k] = h
        f = [paper.state_rates(EPOCH_X + m * step, EPOCH_U) for m in (-2, -1, 1, 2)]
        numerical[:, k] = (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * h)
    return float(np.max(np.abs(numerical - paper.jacobian(EPOCH_X, EPOCH_U))))


def errata() -> list[Row]:
    """Misprints of the equations, each with a number that shows what it does."""
    lat, lon, v_east = radians(REFERENCE_LAT_DEG), radians(52.65), 2.5
    _, P_right = predicted()
    x_right, _ = predicted()
    _, P_printed = predicted(literal=True)
    Phi_printed = paper.transition(paper.jacobian(EPOCH_X, EPOCH_U), DT, literal=True)
    upside_down = frames.dcm_from_euler(radians(170.0), 0.0, 0.0).T @ np.array([0.0, 0.0, -GRAVITY])
    tall = 1.01 * (frames.dcm_from_euler(0.0, radians(30.0), 0.0).T @ np.array([0.0, 0.0, -GRAVITY]))
    p, r = radians(3.0) ** 2, radians(3.0) ** 2
    drift = degrees(abs(euler_drift(radians(3.0), radians(2.0), 4.5, DT, 520.0)))
    return [
        corrected(
            "(8)", "north component of w_en at 36.73 N, 52.65 E, 2.5 m/s east", "rad/s",
            lon * cos(lat), v_east / float(WGS84.radii(lat)[1]),
            "the dots over L and l are missing: as printed it is an angle, not a rate; (9) gives ldot",
        ),
        corrected(
            "(25)", "heading sigma after one step of 10 ms, from 3 deg", "deg",
            degrees(np.sqrt(P_printed[2, 2])), degrees(np.sqrt(P_right[2, 2])),
            "printed (I + A) dt; right I + A dt. As printed each sigma shrinks by dt in a step and nothing is learnt",
        ),
        corrected(
            "(27)", "roll levelled at a true roll of 170 deg", "deg",
            degrees(paper.levelling(upside_down, literal=True)[0]), degrees(paper.levelling(upside_down)[0]),
            "arctan(a_y/a_z) knows no quadrant; atan2(-a_y, -a_z) does",
        ),
        corrected(
            "(27)", "pitch levelled at 30 deg with accelerometers that read 1 % high", "deg",
            degrees(paper.levelling(tall, literal=True, gravity=GRAVITY)[1]), degrees(paper.levelling(tall)[1]),
            "asin(a_x/g) depends on scale and g and is undefined for |a_x| > g; atan2(a_x, hypot(a_y, a_z)) is not",
        ),
        corrected(
            "(30)", "rows of H for a measurement of three angles", "1", 6, 3,
            "printed as a 6 x 6 block with z 3 x 1; H = [I_3 0_3]",
        ),
        corrected(
            "(32)", "predicted heading one step of 10 ms after 60 deg", "deg",
            degrees((Phi_printed @ EPOCH_X)[2]), degrees(x_right[2]),
            "with the printed transition the state itself shrinks by dt; (33) is used, as the paper also advises",
        ),
        corrected(
            "(33)", "largest heading drift of Euler's rule in 520 s of 3 deg roll and 2 deg pitch at 4.5 s", "deg",
            None, drift,
            "the left side is the prediction x^- (its minus is lost); Euler's rule can drift by h phi theta w^2/4",
        ),
        corrected(
            "(34)", "gain of the heading row, sigma and noise 3 deg each", "1", p / (1.0 / p + r), p / (p + r),
            "P^-1 and P^T stand where P^- is meant, a slip of printing or scanning: units do not match",
        ),
    ]  # fmt: skip


def constants() -> list[Row]:
    """Radii, metres a degree and Earth rate where the tests were."""
    figure = partial(judge, SOURCE, "recomputation, Earth")
    lat = radians(REFERENCE_LAT_DEG)
    R_N, R_E = WGS84.radii(lat)
    per_lat, per_lon = metres_per_degree()
    down, north = degrees(-OMEGA * sin(lat)), degrees(OMEGA * cos(lat))
    why = "WGS-84 at 36.73 N"
    rate = "left out by the paper; constant for a level vehicle, so B_z takes it up"
    return [
        figure("meridian radius R_N", "m", "6358260.995", float(R_N), why),
        figure("prime-vertical radius R_E", "m", "6385786.314", float(R_E), why),
        figure("one degree of latitude", "m", "110972.589", per_lat, why),
        figure("one degree of longitude", "m", "89325.410", per_lon, why),
        figure("Earth rate, down", "deg/s", "-0.00249868", down, rate),
        figure("Earth rate, down", "deg/h", "-8.995", 3600.0 * down, rate),
        figure("Earth rate in the recorded bias of -0.053 deg/s", "%", "4.7", 100.0 * down / -0.053, rate),
        figure("Earth rate, north", "deg/s", "0.00335", north, "turns with heading: not a constant B_x, B_y"),
    ]


def one_epoch() -> list[Row]:
    """Every equation at one epoch, to the digits of the recomputation."""
    figure = partial(judge, SOURCE, "recomputation, one epoch")
    f = paper.state_rates(EPOCH_X, EPOCH_U)
    A = paper.jacobian(EPOCH_X, EPOCH_U)
    roll, pitch, heading = EPOCH_X[:3]
    C_nb = frames.dcm_from_euler(roll, pitch, heading)
    rest = C_nb.T @ np.array([0.0, 0.0, -GRAVITY])
    levelled = np.degrees(paper.levelling(rest))
    v_n = C_nb @ np.array([2.5, 0.0, 0.0])
    per_lat, per_lon = metres_per_degree()
    x, P = filtered()
    _, P_printed = predicted(literal=True)
    rows = [
        figure(f"{name} by (10)", "rad/s", printed, value, "state_rates")
        for name, printed, value in zip(
            ("roll rate", "pitch rate", "heading rate"), ("0.01228076", "-0.01091855", "0.03038359"), f, strict=False
        )
    ]
    elements = {
        0: ("0.001534503", "0.030682192", "0", "-1", "0.012248941", "0.140006034"),
        1: ("-0.030087903", "0", "0", "0", "-0.996194698", "0.087155743"),
        2: ("-0.011025856", "-0.004270136", "0", "0", "-0.088012272", "-1.005984874"),
    }
    for i, printed_row in elements.items():
        where = "(18)-(23), first row as printed" if i == 0 else "row left out by the paper"
        rows += [
            figure(f"A[{i + 1},{j + 1}]", "1/s" if j < 3 else "1", printed, A[i, j], where, within=5e-10)
            for j, printed in enumerate(printed_row)
            if printed not in ("0", "-1")
        ]
    difference = jacobian_twin_difference()
    rows.append(
        figure(
            "A against central differences, largest",
            "1/s",
            "1.9e-12",
            difference,
            "a bound: ours may be smaller",
            within=1.9e-12,
        )
    )
    for axis, printed, value in zip("xyz", ("-1.36389639", "-0.84581398", "-9.66769804"), rest, strict=True):
        rows.append(figure(f"accelerometer {axis} at rest, g = 9.80", "m/s^2", printed, value, "(26)"))
    for name, printed, value in zip(("roll", "pitch"), ("5", "-8"), levelled, strict=True):
        rows.append(figure(f"{name} levelled from it", "deg", printed, value, "(27) by atan2", within=1e-9))
    for axis, printed, value in zip(
        ("north", "east", "down"), ("1.23783509", "2.14399326", "0.34793275"), v_n, strict=True
    ):
        rows.append(figure(f"velocity {axis} of 2.5 m/s axial", "m/s", printed, value, "(36)"))
    rows += [
        figure("latitude rate", "deg/s", "1.11544220e-5", v_n[0] / per_lat, "(37)"),
        figure("longitude rate", "deg/s", "2.40020533e-5", v_n[1] / per_lon, "(37)"),
    ]
    states = ("roll", "pitch", "heading", "B_x", "B_y", "B_z")
    after = ("8.74748282e-2", "-1.39787694e-1", "1.06495469", "3.49065634e-3", "-1.74534500e-3", "-9.25073228e-4")
    for k, (name, printed) in enumerate(zip(states, after, strict=True)):
        unit = "rad" if k < 3 else "rad/s"
        rows.append(figure(f"{name} after one filter step", unit, printed, x[k], "(31), (33), (34)"))
    sigmas = np.degrees(np.sqrt(np.diag(P)))
    for k, printed in enumerate(("1.99010717", "1.99007693", "2.12132089")):
        rows.append(figure(f"sigma of {states[k]} after it", "deg", printed, sigmas[k], "Joseph form"))
    sigmas = np.degrees(np.sqrt(np.diag(P_printed)))
    for k, printed in enumerate(("0.02028818", "0.02025726", "0.03015488")):
        rows.append(
            figure(f"sigma of {states[k]} after the printed (25)", "deg", printed, sigmas[k], "the 100-fold collapse")
        )
    return rows
