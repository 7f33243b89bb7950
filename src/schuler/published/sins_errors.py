"""Chapter 2.3 of the thesis: error growth, the two worked examples, the nine-state model and the four-hour run."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import sphere
from schuler.ground.frames import dcm_from_euler
from schuler.inertial import error_dynamics as model
from schuler.inertial.strapdown import Start, Strapdown
from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, REPRODUCED, Row, judge
from schuler.truth import trajectories
from schuler.truth.trajectories import TEXTBOOK

Array = NDArray[np.float64]
SOURCE = "sins"
D = math.pi / 180.0
DEG_PER_H = D / 3600.0
G = 9.81
THESIS = sphere(6.4e6, 9.8 * 6.4e6**2)  # of the worked examples
LAT = 50.27 * D
# 4 h: end N, E m; largest horizontal m; largest dv N, E m/s; largest tilt, end yaw arcmin (independent recomputation)
FOUR_HOURS = {
    0: ("-6121.6", "2250.5", "6634.6", "1.136", "1.414", "0.808", "-6.289"),
    90: ("-2165.4", "-5879.3", "6660.5", "1.278", "0.967", "0.793", "2.360"),
    45: ("-4712.5", "-3737.8", "6411.8", "1.256", "1.126", "0.937", "3.835"),
}
ELEMENTS = {  # row, column from 0: F of the reference case
    (0, 1): "-8.268048461e-5",
    (2, 6): "-1.007208200e-4",
    (3, 1): "9.704326567",
    (4, 6): "2.099783669e-2",
    (4, 8): "-5.810943201e-10",
    (5, 8): "-3.075155941e-6",
    (7, 6): "4.161546472e-5",
}


def free_run(
    heading: float, duration: float, accel: Array, gyro: Array, *, rate: float = 10.0, held: bool = True
) -> tuple[trajectories.Truth, Array, Array, Array]:
    """A nonlinear run at 200 m/s on the sphere with constant errors in b: truth, (n, 3) error m (R dlat, R cos dlon,
    -dh),
    (n, 3) velocity error, (n, 3) phi."""
    line = trajectories.rhumb_line(LAT, 30.3 * D, speed=200.0, heading=heading, duration=duration, earth=TEXTBOOK)
    ideal = line.ideal(rate)
    ins = Strapdown(Start.of(ideal.start), earth=TEXTBOOK, vertical="held" if held else "free")
    track = ins.feed(ideal.dtheta + gyro * ideal.dt, ideal.dv + accel * ideal.dt, ideal.dt)
    truth = ideal.truth
    R = TEXTBOOK.a
    error = np.column_stack(
        [R * (track.lat - truth.lat), R * np.cos(truth.lat) * (track.lon - truth.lon), truth.height - track.height]
    )
    found = track.minus(
        trajectories.Truth(
            track.time, truth.lat, truth.lon, truth.height, truth.v_n, truth.q_nb, truth.w_ib_b, truth.f_b
        ),
        TEXTBOOK,
    )
    return truth, error, found.velocity, found.phi


def printed_matrix(lat: float, v: Array, f: Array) -> Array:
    """F as the thesis prints it (V_h read as v_D, a = specific force): five elements wrong."""
    F = model.phi_matrix(lat, 0.0, v, f, TEXTBOOK)
    R, om, t = TEXTBOOK.a, TEXTBOOK.omega, math.tan(lat)
    F[1, 8] = -v[0] / R**2
    F[2, 6] = -om * math.sin(lat) - v[1] / (R * math.cos(lat) ** 2)
    F[2, 8] = -v[1] * t / R**2
    F[4, 8] = -(v[1] * v[0] * t - v[1] * v[2]) / R**2
    F[5, 8] = (v[0] ** 2 + v[1] ** 2) / R**2
    return F


def linear_run(
    truth: trajectories.Truth, u: Array, *, printed: bool = False, held: bool = True, every: int = 50
) -> Array:
    """(m, 9) of the linear model along every `every`-th row, corrected or as printed, by RK4 on constant-speed
    flight."""
    rows = slice(None, None, every)
    time, lat, v = truth.time[rows], truth.lat[rows], truth.v_n[rows]
    x = np.zeros((len(time), 9))
    heading = math.atan2(v[0, 1], v[0, 0])
    C = np.asarray(dcm_from_euler(0.0, 0.0, heading))
    b = model.input_matrix(C) @ u
    if held:
        b[5] = 0.0

    def matrix(p: float, velocity: Array) -> Array:
        w = 2.0 * TEXTBOOK.earth_rate_n(p) + TEXTBOOK.transport_rate_n(p, 0.0, velocity)
        f = np.cross(w, velocity) - TEXTBOOK.gravity_n(p)
        F = printed_matrix(p, velocity, f) if printed else model.phi_matrix(p, 0.0, velocity, f, TEXTBOOK)
        if held:
            F[[5, 8]] = 0.0
            F[:, [5, 8]] = 0.0
        return F

    Fs = [matrix(p, q) for p, q in zip(lat, v, strict=True)]
    for k in range(len(time) - 1):
        h = time[k + 1] - time[k]
        A, B = Fs[k], Fs[k + 1]
        M = 0.5 * (A + B)
        k1 = A @ x[k] + b
        k2 = M @ (x[k] + 0.5 * h * k1) + b
        k3 = M @ (x[k] + 0.5 * h * k2) + b
        x[k + 1] = x[k] + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + B @ (x[k] + h * k3) + b)
    return x


def bias() -> tuple[Array, Array]:
    """1e-4 g and 0.01 deg/h on all axes."""
    return np.full(3, 1e-4 * G), np.full(3, 0.01 * DEG_PER_H)


@cache
def four_hours(heading: int) -> dict[str, float]:
    """The figures of the table, and the largest deviation of both linear models in shares of the largest error."""
    accel, gyro = bias()
    truth, error, dv, phi = free_run(heading * D, 14400.0, accel, gyro)
    found = {
        "north": float(error[-1, 0]),
        "east": float(error[-1, 1]),
        "largest": float(np.hypot(error[:, 0], error[:, 1]).max()),
        "dv_n": float(np.abs(dv[:, 0]).max()),
        "dv_e": float(np.abs(dv[:, 1]).max()),
        "tilt": float(np.degrees(np.abs(phi[:, :2]).max()) * 60.0),
        "yaw": float(np.degrees(phi[-1, 2]) * 60.0),
    }
    every = 50
    R, lat = TEXTBOOK.a, truth.lat[::every]
    whole = np.hstack([phi, dv, error])[::every]
    for name, printed in (("linear", False), ("printed", True)):
        x = linear_run(truth, np.concatenate([accel, gyro]), printed=printed, every=every)
        # the linear run starts at the first row, one step late; its start value is the nonlinear one there (tiny)
        y = np.hstack([x[:, :6], np.column_stack([R * x[:, 6], R * np.cos(lat) * x[:, 7], -x[:, 8]])])
        share = np.abs(y - whole).max(axis=0) / np.maximum(np.abs(whole).max(axis=0), 1e-30)
        found[name] = float(np.max(share[[0, 1, 2, 3, 4, 6, 7]]))
        found[f"{name}_yaw"] = float(share[2])
    return found


def rows() -> list[Row]:
    """Every figure of the section."""
    return [*_examples(), *_matrix(), *_runs(), *_vertical()]


def _examples() -> list[Row]:
    t = 10800.0
    b, w = 1e-4 * 9.8, 0.005 * DEG_PER_H
    rate = model.schuler_rate(THESIS)
    R = THESIS.a
    open_a = float(model.open_loop(t, accel=b))
    open_g = float(model.open_loop(t, gyro=w))
    times = np.linspace(0.0, t, 4001)
    by_a = b / rate**2 * (1.0 - np.cos(rate * times))
    by_g = R * w * (times - np.sin(rate * times) / rate)
    hold_a, hold_g = (model.open_loop_holds(c, 0.1, THESIS) / 60.0 for c in ("accel", "gyro"))
    accel, gyro = np.array([1e-4 * G, 0.0, 0.0]), np.array([0.0, 0.005 * DEG_PER_H, 0.0])
    zero = np.zeros(3)
    _, error_a, *_ = free_run(0.0, t, accel, zero)
    _, error_g, *_ = free_run(0.0, t, zero, gyro)
    made = [
        judge(
            SOURCE, "(2.47) example", "200 m/s for 3 h over R = 6.4e6 m", "rad", "0.3375", 200.0 * t / R, "arithmetic"
        ),
        judge(
            SOURCE,
            "(2.47) example",
            "1e-4 g after 3 h, without feedback",
            "rad",
            "0.01786",
            open_a / R,
            "the factor 1/2 of (2.47) was left out; printed beside it: 10^4 g for 10^-4 g",
        ),
        judge(
            SOURCE,
            "(2.47) example",
            "the same",
            "deg",
            "1.023",
            math.degrees(open_a / R),
            "0.512 deg, and 0.0017 deg with Schuler's feedback",
        ),
        judge(
            SOURCE, "recomputation of (2.47)", "1e-4 g after 3 h, without feedback", "m", "57153.6", open_a, "b t^2/2"
        ),
        judge(
            SOURCE,
            "(2.49) example",
            "0.005 deg/h after 3 h, without feedback",
            "rad",
            "0.007793",
            open_g / R,
            "with the printed 2.42e-8 rad/s it is 0.00779",
            within=2e-6,
        ),
        judge(SOURCE, "(2.49) example", "the same", "deg", "0.45", math.degrees(open_g / R), "arithmetic right"),
        judge(
            SOURCE,
            "recomputation of (2.49)",
            "0.005 deg/h after 3 h, without feedback",
            "m",
            "49875.9",
            open_g,
            "g w t^3/6",
        ),
        judge(
            SOURCE,
            "recomputation of (2.47)",
            "Schuler period, R 6.4e6 m, g 9.8",
            "s",
            "5077.58",
            2.0 * math.pi / rate,
            "2 pi sqrt(R/g)",
        ),
        judge(
            SOURCE,
            "recomputation of (2.47)",
            "1e-4 g after 3 h with Schuler's feedback",
            "m",
            "193.17",
            float(by_a[-1]),
            "(b R/g)(1 - cos w t), not 57 km",
        ),
        judge(
            SOURCE,
            "recomputation of (2.47)",
            "its largest value",
            "m",
            "1280.0",
            float(by_a.max()),
            "2 b R/g",
            within=0.1,
        ),
        judge(
            SOURCE,
            "recomputation of (2.49)",
            "0.005 deg/h after 3 h with Schuler's feedback",
            "m",
            "1585.76",
            float(by_g[-1]),
            "R w (t - sin(w t)/w), not 50 km",
        ),
        judge(
            SOURCE,
            "recomputation of (2.49)",
            "the same",
            "deg",
            "0.014196",
            math.degrees(float(by_g[-1]) / R),
            "the ramp alone is R w t = 1675.5 m",
        ),
        Row(
            SOURCE,
            "(2.47)",
            "time to which b t^2/2 is at most a tenth too large",
            "min",
            None,
            hold_a,
            CORRECTED,
            "Schuler's feedback bends it over",
        ),
        Row(
            SOURCE,
            "(2.49)",
            "time to which g w t^3/6 is at most a tenth too large",
            "min",
            None,
            hold_g,
            CORRECTED,
            "the same",
        ),
    ]
    for name, error, printed in (
        ("1e-4 g north", error_a, ("293.7", "-251.9", "1273")),
        ("0.005 deg/h east", error_g, ("-1428.6", "-528.8", "1523")),
    ):
        peak = float(np.hypot(error[:, 0], error[:, 1]).max())
        for what, p, o in zip(("north", "east", "largest"), printed, (error[-1, 0], error[-1, 1], peak), strict=True):
            made.append(
                judge(
                    SOURCE,
                    "recomputation of (2.47), (2.49)",
                    f"{name} alone, flight of 3 h, closed loop: {what}",
                    "m",
                    p,
                    float(o),
                    "nonlinear run, sphere of 6378137 m, g 9.81",
                )
            )
    return made


def _matrix() -> list[Row]:
    v = np.array([141.0, 141.0, -2.0])
    f = np.asarray(dcm_from_euler(0.1, 0.05, 0.7)) @ np.array([0.3, -0.5, -9.7])
    F, P = model.phi_matrix(LAT, 0.0, v, f, TEXTBOOK), printed_matrix(LAT, v, f)
    made = [
        judge(
            SOURCE,
            "recomputation of (2.51)",
            f"F({i + 1},{j + 1}) of the reference case",
            "SI",
            printed,
            float(F[i, j]),
            "v (141, 141, -2) m/s, roll, pitch, yaw 0.1, 0.05, 0.7 rad, f_b (0.3, -0.5, -9.7)",
            within=1e-9 * abs(float(printed)),
        )
        for (i, j), printed in ELEMENTS.items()
    ]
    why = {
        (1, 8): "+V_N/R^2",
        (2, 6): "-Om cos(lat) - V_E/(R cos^2), printed sin",
        (2, 8): "+V_E tan(lat)/R^2",
        (4, 8): "-V_E (V_N tan(lat) + V_D)/R^2",
        (5, 8): "-2 g/R added: without it the vertical channel is stable",
    }
    made += [
        Row(
            SOURCE,
            f"F({i + 1},{j + 1})",
            "the element in the reference case",
            "SI",
            float(P[i, j]),
            float(F[i, j]),
            CORRECTED,
            reason,
        )
        for (i, j), reason in why.items()
    ]
    same = int(np.count_nonzero(np.isclose(F, P, rtol=1e-12, atol=0.0)))
    made += [
        Row(
            SOURCE,
            "(2.51)",
            "elements of F that are right as printed",
            "1",
            81.0,
            float(same),
            CORRECTED,
            "all 81 compared with differences of the nonlinear equations in the tests",
        ),
        Row(
            SOURCE,
            "x of (2.51)",
            "meaning of d alpha, d beta, d gamma",
            "1",
            None,
            None,
            CORRECTED,
            "rotations about north, east, down, as F11 has them, not errors of pitch, roll, yaw",
        ),
        Row(
            SOURCE,
            "F21",
            "order of a_x, a_y, a_z",
            "1",
            None,
            None,
            CORRECTED,
            "right only with a_x = f_E, a_y = f_N, a_z = f_D; V_h must be the velocity down",
        ),
    ]
    return made


def _runs() -> list[Row]:
    made = []
    names = (
        "error north at the end, m",
        "error east at the end, m",
        "largest horizontal error, m",
        "largest velocity error north, m/s",
        "largest velocity error east, m/s",
        "largest tilt, arcmin",
        "phi_D (minus the heading error) at the end, arcmin",
    )
    keys = ("north", "east", "largest", "dv_n", "dv_e", "tilt", "yaw")
    limits = {0: ("0.3", "12.6"), 90: ("0.2", "4.5"), 45: ("0.2", "18.1")}
    for heading, printed in FOUR_HOURS.items():
        found = four_hours(heading)
        for name, key, p in zip(names, keys, printed, strict=True):
            what, unit = name.rsplit(", ", 1)
            made.append(
                judge(
                    SOURCE,
                    "recomputation of figure 2.18",
                    f"{what}, heading {heading} deg",
                    unit,
                    p,
                    found[key],
                    "4 h at 200 m/s, 1e-4 g and 0.01 deg/h on all axes, ideal height",
                    within=max(1.5e-3 * abs(float(p)), 0.06 if unit == "m" else 1e-3),
                )
            )
        good, bad = limits[heading]
        made += [
            judge(
                SOURCE,
                "recomputation of figure 2.18",
                f"worst deviation of the corrected F, heading {heading} deg",
                "%",
                good,
                100.0 * found["linear"],
                "in shares of the largest error",
                within=0.1,
            ),
            judge(
                SOURCE,
                "recomputation of figure 2.18",
                f"yaw deviation of the printed F, heading {heading} deg",
                "%",
                bad,
                100.0 * found["printed_yaw"],
                "the five wrong elements",
                within=0.5,
            ),
        ]
    made.append(
        Row(
            SOURCE,
            "figure 2.18",
            "the curves",
            "1",
            None,
            None,
            NOT_REPRODUCIBLE,
            "neither a heading nor a number is given; three headings are run here",
        )
    )
    return made


def _vertical() -> list[Row]:
    accel, gyro = bias()
    truth, error, *_ = free_run(0.0, 1800.0, accel, gyro, held=False)
    x = linear_run(truth, np.concatenate([accel, gyro]), printed=True, held=False, every=10)
    at = {600: -error[5999, 2], 1800: -error[-1, 2]}
    made = [
        judge(
            SOURCE,
            "recomputation of figure 2.18",
            f"height error of the free vertical channel at {t} s",
            "m",
            p,
            float(at[t]),
            "unstable, e-fold in 570 s",
            within=0.01 if t == 600 else 0.06,
        )
        for t, p in ((600, "-187.67"), (1800, "-3222.8"))
    ]
    made += [
        judge(
            SOURCE,
            "recomputation of figure 2.18",
            f"the same by the printed F at {t} s",
            "m",
            p,
            float(x[k, 8]),
            "no gravity gradient in F(6,9)",
            within=2e-3 * abs(float(p)),
        )
        for t, k, p in ((600, 600, "-171.1"), (1800, len(x) - 1, "-1466.8"))
    ]
    made.append(
        judge(
            SOURCE,
            "recomputation of figure 2.18",
            "e-folding time of the vertical channel",
            "s",
            "570",
            math.sqrt(TEXTBOOK.a / (2.0 * G)),
            "sqrt(R/2g): a 4 h run without height aiding says nothing",
        )
    )
    made.append(
        Row(
            SOURCE,
            "(2.52), figure 2.18",
            "height in the 4 h run",
            "1",
            None,
            None,
            REPRODUCED,
            "only with an ideal height, which the thesis does not mention",
        )
    )
    return made
