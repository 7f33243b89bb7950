"""Chapter 2.1 of the thesis: initial alignment, its sensitivities, and the catalogue of sensors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schuler.inertial import alignment
from schuler.inertial.attitude_study import dcm_zxy
from schuler.published.ledger import CORRECTED, Row, judge
from schuler.truth import catalogue

Array = NDArray[np.float64]
SOURCE = "sins"
D = math.pi / 180.0
DEG_PER_H = D / 3600.0
OMEGA = 7.292115e-5
LAT = 50.27 * D
CASE = (30.0 * D, 5.0 * D, -3.0 * D)  # psi, theta, gamma


def observed(psi: float, theta: float, gamma: float, lat: float = LAT, g: float = 9.81) -> tuple[Array, Array]:
    """Gravity and Earth rate in the thesis's body axes, (2.1) and (2.4) put right."""
    C = dcm_zxy(psi, theta, gamma)
    return C.T @ np.array([0.0, 0.0, -g]), C.T @ (OMEGA * np.array([0.0, math.cos(lat), math.sin(lat)]))


def printed_heading(g_b: Array, w_b: Array, lat: float = LAT) -> float:
    """(2.9) as printed, two quadrants, rad; its w_z, without the index of body axes, is read as w_zeta."""
    g = float(np.linalg.norm(g_b))
    w_zeta = OMEGA * math.sin(lat)
    return math.atan((w_b[2] * g_b[0] - w_b[0] * g_b[2]) / (w_b[1] * g - w_zeta * g_b[1]))


def worst_return(seed: int = 1, count: int = 2000) -> tuple[float, float]:
    """Largest error, rad, of (2.2)/(2.9) put right and of TRIAD over random attitudes."""
    rng = np.random.default_rng(seed)
    psi, gamma = rng.uniform(-math.pi, math.pi, (2, count))
    theta = np.arcsin(rng.uniform(-0.99, 0.99, count))
    C = np.array([dcm_zxy(*a) for a in zip(psi, theta, gamma, strict=True)])
    g_b = C.transpose(0, 2, 1) @ np.array([0.0, 0.0, -9.81])
    w_b = C.transpose(0, 2, 1) @ (OMEGA * np.array([0.0, math.cos(LAT), math.sin(LAT)]))
    angles = alignment.angles_from_gravity_and_rate(g_b, w_b, LAT)
    wrong = np.column_stack([psi, theta, gamma]) - angles
    wrong = np.abs((wrong + math.pi) % (2.0 * math.pi) - math.pi)
    # the thesis's axes as north-east-down and forward-right-down: swap the first two, negate the third
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    C_ned = alignment.triad(-g_b @ swap.T, w_b @ swap.T)
    return float(wrong.max()), float(np.abs(C_ned - swap @ C @ swap.T).max())


def rows() -> list[Row]:
    """Every figure of the chapter."""
    return [*_formulas(), *_sensitivities(), *_floors(), *_errata()]


def _formulas() -> list[Row]:
    g_b, w_b = observed(*CASE)
    back = alignment.angles_from_gravity_and_rate(g_b, w_b, LAT)
    put_right, by_triad = worst_return()
    made = [
        judge(
            SOURCE,
            "recomputation of (2.1)",
            f"gravity on body {axis}, psi 30, theta 5, gamma -3 deg",
            "m/s^2",
            printed,
            float(g_b[i]),
            "row 3 takes cos(gamma), not sin(gamma)",
        )
        for i, (axis, printed) in enumerate((("x", "-0.51146203"), ("y", "-0.85499784"), ("z", "-9.75927688")))
    ]
    made += [
        judge(
            SOURCE,
            "recomputation of (2.4)",
            f"Earth rate on body {axis}, same attitude, latitude 50.27",
            "1e-5 rad/s",
            printed,
            float(w_b[i]) * 1e5,
            "row 3 ends in + w_zeta cos cos",
        )
        for i, (axis, printed) in enumerate((("x", "2.60123601"), ("y", "4.50988157"), ("z", "5.10582811")))
    ]
    made += [
        judge(
            SOURCE,
            "recomputation of (2.9)",
            "heading by the formula as printed, same attitude",
            "deg",
            "24.912104",
            math.degrees(printed_heading(g_b, w_b)),
            "30 deg is right",
        ),
        Row(
            SOURCE,
            "(2.9)",
            "heading of an object at 30 deg by the formula as printed",
            "deg",
            math.degrees(printed_heading(g_b, w_b)),
            math.degrees(float(back[0])),
            CORRECTED,
            "numerator is -c12, the denominator w_y g + w_zeta g_y, and four quadrants are needed; `published` is what "
            "the printed formula gives",
        ),
        Row(
            SOURCE,
            "(2.2), (2.9)",
            "worst angle of 2000 random attitudes, put right",
            "rad",
            None,
            put_right,
            CORRECTED,
            "returned to rounding",
        ),
        Row(
            SOURCE,
            "(2.2), (2.9)",
            "worst element of 2000 random attitudes by TRIAD",
            "1",
            None,
            by_triad,
            CORRECTED,
            "TRIAD needs neither |g| nor the latitude",
        ),
    ]
    return made


def _sensitivities() -> list[Row]:
    drift = 5e-4 * DEG_PER_H
    made = [
        judge(
            SOURCE,
            "page of (2.13)",
            "gyro error of figures 2.6 and 2.7",
            "rad/s",
            "2.4241e-9",
            drift,
            "5e-4 deg/h; printed as 5e4 deg/h beside the right value in rad/s",
        )
    ]
    printed = {
        50.27: ("5.200853e-5", "1.203223e-6", "5.321175e-5"),
        57.27: ("6.148234e-5", "1.555868e-6", "6.303820e-5"),
    }
    for lat_deg, (gyro, accel, both) in printed.items():
        lat = lat_deg * D
        w = abs(alignment.thesis_sensitivity(0.0, lat, (drift,) * 3, (0.0,) * 3))
        a = abs(alignment.thesis_sensitivity(0.0, lat, (0.0,) * 3, (1e-6,) * 3))
        why = "figures 2.4 to 2.7 at psi = 0"
        why += "; the text means 50.27 deg, its 57.27 is a slip" if lat_deg > 55 else ""
        for name, p, ours in (("5e-4 deg/h", gyro, w), ("1e-6 g", accel, a), ("both, added", both, w + a)):
            where = f"recomputation of (2.11)-(2.13), latitude {lat_deg}"
            made.append(judge(SOURCE, where, f"heading error for {name}", "rad", p, ours, why))
    tilt = math.degrees(float(np.linalg.norm(alignment.coarse_sensitivity(np.eye(3), LAT)[:2, 0]) * 1e-2 * 9.80665))
    made.append(
        judge(
            SOURCE,
            "recomputation of figures 2.2, 2.3",
            "tilt for 1e-2 g",
            "deg",
            "0.572958",
            tilt,
            "the right end of both straight lines",
        )
    )
    th = 30.0 * D
    made.append(
        Row(
            SOURCE,
            "(2.10) row 1",
            "d theta / (d g_y / g) at 30 deg of pitch",
            "1",
            -1.0 / (1.0 + math.sin(th) ** 2),
            -1.0 / math.sqrt(1.0 - math.sin(th) ** 2),
            CORRECTED,
            "the derivative of arcsin was taken for that of arctan",
        )
    )
    return made


def _floors() -> list[Row]:
    printed = {
        0.003: "0.0179",
        0.01: "0.0596",
        0.017: "0.1013",
        0.03: "0.1788",
        0.08: "0.4768",
        0.3: "1.788",
        5.0: "29.8",
    }
    made = []
    for drift, value in printed.items():
        names = ", ".join(g.name for g in catalogue.GYROS if g.random_deg_per_h == drift)
        ours = math.degrees(float(alignment.heading_floor(drift * DEG_PER_H, LAT)))
        made.append(
            judge(
                SOURCE,
                "recomputation of tables 2.2-2.4",
                f"heading floor of {drift:g} deg/h at 50.27 deg",
                "deg",
                value,
                ours,
                names,
            )
        )
    for number, kind in ((2, "fibre-optic"), (3, "dynamically tuned"), (4, "laser")):
        count = sum(g.table == f"2.{number}" for g in catalogue.GYROS)
        made.append(
            Row(
                SOURCE,
                f"table 2.{number}",
                f"{kind} gyros captioned as accelerometers",
                "1",
                None,
                float(count),
                CORRECTED,
                "units are deg/h and deg/s: they are gyros",
            )
        )
    return made


def _errata() -> list[Row]:
    def fixed(where: str, what: str, reason: str, printed: float | None = None, ours: float | None = None) -> Row:
        return Row(SOURCE, where, what, "1", printed, ours, CORRECTED, reason)

    psi, th, ga = CASE
    g_b, w_b = observed(*CASE)
    C = dcm_zxy(*CASE)
    wz, wn = OMEGA * math.sin(LAT), OMEGA * math.cos(LAT)
    return [
        fixed(
            "(2.1) row 3",
            "g_z/g at the reference attitude",
            "-cos(theta) cos(gamma), printed sin(gamma)",
            -math.cos(th) * math.sin(ga),
            float(g_b[2]) / 9.81,
        ),
        fixed(
            "(2.4) row 3",
            "w_z/Om at the reference attitude",
            "+ w_zeta cos(theta) cos(gamma), printed minus",
            float(w_b[2] - 2.0 * wz * math.cos(th) * math.cos(ga)) / OMEGA,
            float(w_b[2]) / OMEGA,
        ),
        fixed(
            "(2.6) row 1",
            "c31 at the reference attitude",
            "c31 = -cos(theta) sin(gamma)",
            math.cos(th) * math.sin(ga),
            float(C[2, 0]),
        ),
        fixed(
            "(2.7)",
            "c22 at the reference attitude",
            "no leading minus on the quotients",
            -(float(w_b[1]) - wz * float(C[2, 1])) / wn,
            float(C[1, 1]),
        ),
        fixed(
            "(2.11)",
            "d psi / (d w_x / (Om cos lat)) at psi 30 deg",
            "+cos(psi) for the psi of (2.4): the printed signs are those of a clockwise heading",
            -math.cos(psi),
            math.cos(psi),
        ),
        fixed(
            "(2.12)",
            "factor of the accelerometer errors",
            "tan(lat), printed tan(psi); errors in units of g",
            math.tan(psi),
            math.tan(LAT),
        ),
    ]
