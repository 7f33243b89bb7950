"""Chapters 4.4 and 5.2, 5.3 of the thesis: footprint, three beams, symmetry, angles, camera and mechanization in e."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schuler.aiding import optics, three_beams
from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84
from schuler.ground.frames import dcm_from_euler, dcm_from_rotvec, quat_from_dcm, quat_multiply, quat_rotate
from schuler.ground.lidar import SCANNERS, footprint
from schuler.inertial import ecef
from schuler.inertial.attitude_study import dcm_zxy
from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, REPRODUCED, Row, judge

Array = NDArray[np.float64]
SOURCE = "sins"
AGAIN = "recomputation of "
D = math.pi / 180.0
LAT = 50.21 * D
BEAMS = np.array([3.0, 4.0, 2.0, 0.3, 0.1, -0.2])
SECOND = ("2.991227", "3.974344", "1.704502", "-0.01392", "0.155669", "0.129306")
NAMES = (("x0", "m"), ("y0", "m"), ("z0", "m"), ("psi", "rad"), ("theta", "rad"), ("gamma", "rad"))
# The stored case: NED from the IMU to the landmark, roll, pitch, heading, camera straight down, lever arm
CAMERA = Camera.of(8889.0, position_frd_m=(0.3, -0.1, 0.2))
LANDMARK = np.array([150.0, 110.0, 1000.0])
C_NB = np.asarray(dcm_from_euler(0.05, -0.03, 0.6))
STORED = (("1930.79088003", "-500.43753618"), ("-7.383754", "-5.169335", "1.673891", "-5353.462924", "7634.837277",
                                               "-36.812662"))  # fmt: skip
FIELDS = {
    "3 landmarks": (
        [[200.0, 0.0], [-100.0, 170.0], [-100.0, -170.0]],
        ("3.34", "3.40", "0.33", "3.34", "3.28", "0.33"),
    ),
    "4 at the corners": (
        [[x, y] for x in (200.0, -200.0) for y in (150.0, -150.0)],
        ("1.95", "1.92", "0.225", "1.87", "1.87", "0.225"),
    ),
    "9 in a grid": ([[x, y] for x in (200.0, 0.0, -200.0) for y in (150.0, 0.0, -150.0)], ("1.40", "1.68", "0.18")),
}


def rows() -> list[Row]:
    """Every figure of the sections."""
    return [*_footprint(), *_beams(), *_symmetry(), *_angles(), *_camera(), *_mechanization()]


def _fixed(where: str, what: str, unit: str, was: float | None, ours: float | None, reason: str) -> Row:
    return Row(SOURCE, where, what, unit, was, ours, CORRECTED, reason)


def _footprint() -> list[Row]:
    made = []
    for h, angle, slope, printed in (
        (150.0, 0.0, 0.0, "0.405000"), (150.0, 30.0, 0.0, "0.540001"), (150.0, 30.0, 10.0, "0.610695"),
        (260.0, 0.0, 0.0, "0.702"),
    ):  # fmt: skip
        ours = float(footprint(h, 2.7e-3, angle * D, slope * D))
        what = f"footprint of 2.7 mrad at {h:g} m, {angle:g} deg off nadir, slope {slope:g} deg"
        made.append(judge(SOURCE, f"{AGAIN}(4.27)", what, "m", printed, ours, "beam and ground intersected exactly"))
    nadir = float(footprint(150.0, 2.7e-3))
    made.append(
        _fixed("(4.25), (4.26)", "footprint of 2.7 mrad at 150 m, nadir", "m", 1.0 / nadir, nadir,
               "D + 2 h tan(gamma/2): printed as its reciprocal, in 1/m")
    )  # fmt: skip
    far = max(s.farthest for s in SCANNERS.values())
    made.append(
        Row(SOURCE, "section 3.2", "farthest reach of the three scanners", "m", None, far, NOT_REPRODUCIBLE,
            "150, 260 and 1000 m: none of them sees the ground from a cruising height above 1 km")
    )  # fmt: skip
    return made


def _beams() -> list[Row]:
    alpha, beta = three_beams.bearings(BEAMS)
    found = three_beams.solutions(alpha, beta)
    made = [
        _fixed("(4.28) row 1", "left less right at the true pose (3, 4, 2; 0.3, 0.1, -0.2), marks at 1 m", "m",
               float(three_beams.printed(BEAMS, alpha, beta)[0]),
               float(three_beams.equations(BEAMS, alpha, beta)[0]), "cos(psi) cos(theta), printed cos(gamma)"),
        _fixed("(4.28) row 6", "the same of row 6", "m", float(three_beams.printed(BEAMS, alpha, beta)[5]),
               float(three_beams.equations(BEAMS, alpha, beta)[5]), "z0, printed x0"),
        judge(SOURCE, f"{AGAIN}(4.28)", "poses that satisfy the six equations of that example", "1", "4",
              float(len(found)), "three points known on the body: the pose from three points, up to four solutions"),
    ]  # fmt: skip
    second = min(found, key=lambda s: abs(s[3] + 0.01392))
    for (name, unit), printed, ours in zip(NAMES, SECOND, second, strict=True):
        made.append(judge(SOURCE, f"{AGAIN}(4.28)", f"{name} of another of the four", unit, printed, float(ours),
                          "as good as the true pose: no measurement of the three beams tells them apart"))  # fmt: skip
    six = np.linalg.matrix_rank(three_beams.jacobian(lambda s: three_beams.equations(s, alpha, beta), BEAMS))
    three = np.linalg.matrix_rank(three_beams.jacobian(lambda s: three_beams.summed(s, alpha, beta), BEAMS))
    made.append(_fixed("(4.28)", "rank of its Jacobian", "1", None, float(six), "six equations for six unknowns"))
    made.append(
        Row(SOURCE, "(4.29)", "rank of the three summed equations", "1", None, float(three), NOT_REPRODUCIBLE,
            "three equations cannot give six unknowns; printed with c32 in all three rows besides")
    )  # fmt: skip
    for distance in (10.0, 100.0, 1000.0):
        x = np.concatenate([distance * BEAMS[:3] / np.linalg.norm(BEAMS[:3]), BEAMS[3:]])
        s = three_beams.sigmas(x, 1e-4)
        made.append(
            Row(SOURCE, "(4.28)", f"sigma of the position at {distance:g} m, marks at 1 m, bearings to 0.1 mrad", "m",
                None, float(np.linalg.norm(s[:3])), NOT_REPRODUCIBLE,
                f"attitude {math.degrees(float(np.linalg.norm(s[3:]))):.1f} deg: a base of 1 m is too short for the "
                "flights meant")
        )  # fmt: skip
    return made


def symmetry(signs: float, known: bool = False, seed: int = 3) -> float:
    """How much the image of ten landmarks changes along (4.31)'s direction, px per unit of a focal length of 1; signs:
    +1 put right, -1 as printed; known: landmarks that stay."""
    rng = np.random.default_rng(seed)
    d = rng.uniform(-1.0, 1.0, (10, 3)) + [0.0, 0.0, 4.0]
    r, q = np.array([0.2, -0.1, 0.3]), np.array([0.96, 0.1, -0.15, 0.2])
    q = q / np.linalg.norm(q)

    def image(x: Array) -> Array:
        r, q, d = x[:3], x[3:7], x[7:].reshape(-1, 3)
        F = quat_rotate(q * [1.0, -1.0, -1.0, -1.0] / np.linalg.norm(q), d - r)
        return np.asarray((F[:, :2] / F[:, 2:]).ravel())

    x = np.concatenate([r, q, d.ravel()])
    turn = np.array([-1.0, 1.0, 0.0])
    move = np.concatenate(
        [
            turn * r[[1, 0, 2]],
            0.5 * np.array([-q[3], -signs * q[2], signs * q[1], q[0]]),
            0.0 * d.ravel() if known else (turn * d[:, [1, 0, 2]]).ravel(),
        ]
    )
    return float(np.linalg.norm(image(x + 1e-6 * move) - image(x - 1e-6 * move)) / 2e-6)


def _symmetry() -> list[Row]:
    right, wrong, known = symmetry(1.0), symmetry(-1.0), symmetry(1.0, known=True)
    return [
        _fixed("(4.31)", "change of the image of unknown landmarks along its direction", "1/rad", wrong, right,
               "- q_y, + q_x for q body to navigation; then it is the turn about the vertical of everything at once, "
               "which no image of unknown landmarks shows: no equation for the pose, but the proof that yaw and "
               "position stay unknown"),
        _fixed("(4.31)", "the same where the landmarks are known", "1/rad", None, known,
               "the symmetry is broken: known landmarks make yaw observable"),
    ]  # fmt: skip


def _angles() -> list[Row]:
    psi, theta, gamma = 0.5, 0.2, -0.3
    C = dcm_zxy(psi, theta, gamma)
    t, x, y, z = (float(v) for v in quat_from_dcm(C))
    printed = (
        math.atan(2.0 * (t * z + x * y) / (1.0 - 2.0 * (y * y + z * z))),
        math.atan(2.0 * (t * y - z * x)),
        math.atan(2.0 * (t * x + y * z) / (1.0 - 2.0 * (y * y + x * x))),
    )
    ours = (math.atan2(-C[0, 1], C[1, 1]), math.asin(C[2, 1]), math.atan2(-C[2, 0], C[2, 2]))
    made = [
        _fixed("(4.32)", f"{name} of an attitude (0.5, 0.2, -0.3)", "rad", p, float(o),
               "the angles of the order Z-Y-X, and arctan for arcsin; the thesis's own matrix is Z-X-Y")
        for name, p, o in zip(("psi", "theta", "gamma"), printed, ours, strict=True)
    ]  # fmt: skip
    for name, text, value in zip(("psi", "theta", "gamma"), ("0.4386", "-0.2819", "0.2091"), printed, strict=True):
        made.append(judge(SOURCE, f"{AGAIN}(4.32)", f"{name} by the formula as printed", "rad", text, value,
                          "same attitude"))  # fmt: skip
    v, a, dt = 200.0, 1.0, 10.0
    made.append(
        Row(SOURCE, "(4.33)", "way in 10 s from 200 m/s at 1 m/s^2", "m", v * dt + 0.5 * a * dt**2 - 0.5 * a * dt**2,
            v * dt + 0.5 * a * dt**2, NOT_REPRODUCIBLE,
            "the object's acceleration stands in it twice with opposite signs, gravity is missing, and a position in "
            "fixed axes is turned by a body's matrix from the right: dead reckoning is (5.11)")
    )  # fmt: skip
    return made


def slope(points: Array, r: Array, C: Array, camera: Camera) -> Array:
    """(2, 6) d(u, v)/d(dr, phi) of one point by central differences of fourth order."""
    columns = []
    for k, s in enumerate([1.0] * 3 + [1e-3] * 3):
        e = s * np.eye(6)[k]
        f = [camera.project(points, r + m * e[:3], dcm_from_rotvec(-m * e[3:]) @ C)[0][0] for m in (-2, -1, 1, 2)]
        columns.append((f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * s))
    return np.column_stack(columns)


def _camera() -> list[Row]:
    uv, _, H = optics.rows(LANDMARK[None], np.zeros(3), C_NB, CAMERA)
    where = f"{AGAIN}(5.14), (5.20)"
    why = "camera straight down, f = 8889 px, lever arm (0.3, -0.1, 0.2) m, roll 0.05, pitch -0.03, heading 0.6 rad"
    made = [
        judge(SOURCE, where, f"{name} of the stored case", "px", text, float(uv[0, i]), why)
        for i, (name, text) in enumerate(zip("uv", STORED[0], strict=True))
    ]
    for i, text in enumerate(STORED[1]):
        made.append(judge(SOURCE, where, f"row of u, column {i + 1}", "px/m" if i < 3 else "px/rad", text,
                          float(H[0, 0, i]), "residual = predicted - measured, errors estimate - truth"))  # fmt: skip
    numbers = slope(LANDMARK[None], np.zeros(3), C_NB, CAMERA)
    ours = float(np.abs(H[0] - numbers).max(axis=1)[0] / np.abs(numbers).max())
    r_c = CAMERA.vectors(LANDMARK[None], np.zeros(3), C_NB)[0]
    H1 = CAMERA.focal * np.array(
        [[-1.0 / r_c[2], 0.0, r_c[0] / r_c[2] ** 2], [0.0, -1.0 / r_c[2], r_c[1] / r_c[2] ** 2]]
    )
    # as printed: both rotations the wrong way round, and the landmark in camera axes in the cross product
    cross = np.array([[0.0, -r_c[2], r_c[1]], [r_c[2], 0.0, -r_c[0]], [-r_c[1], r_c[0], 0.0]])
    printed = H1 @ np.hstack([-CAMERA.C_cb @ C_NB, CAMERA.C_cb @ C_NB @ cross])
    made.append(
        _fixed("(5.20)", "largest difference from differences, of the largest element", "1",
               float(np.abs(printed - numbers).max() / np.abs(numbers).max()), ours,
               "-C_e^c and -C_e^c [(r_p - r_b) x]: as printed b and n are exchanged and the point is in camera axes")
    )  # fmt: skip
    lever = CAMERA.C_cb @ (C_NB.T @ (LANDMARK - CAMERA.l_b) - CAMERA.l_b)
    made.append(
        _fixed("(5.16)-(5.18)", "error of the landmark's place in camera axes", "m",
               float(np.linalg.norm(lever - r_c)), 0.0,
               "r_c = C_b^c [C_e^b (r_p - r_b) - l]: printed with the lever arm in the place of the vehicle, which "
               "leaves the vehicle's whole position out (here only the arm is counted)")
    )  # fmt: skip
    plain = Camera.of(8889.0)
    for name, (field, texts) in FIELDS.items():
        points = np.column_stack([np.array(field), np.full(len(field), 1000.0)])
        s = np.sqrt(np.diag(optics.covariance(points, np.zeros(3), np.eye(3), plain)))
        for i, text in enumerate(texts):
            axis = ("north", "east", "down")[i % 3]
            unit, value = ("m", s[i]) if i < 3 else ("mrad", 1e3 * s[i])
            made.append(judge(SOURCE, f"{AGAIN}(5.19)-(5.21)",
                              f"sigma {'about ' if i > 2 else ''}{axis}, {name} at 1000 m, 1 px", unit, text,
                              float(value), "sigma^2 (H^T H)^-1, one picture", within=0.006))  # fmt: skip
    two = optics.unseen(np.array([[200.0, 150.0, 1000.0], [-200.0, 150.0, 1000.0]]), np.zeros(3), np.eye(3), plain)
    made.append(judge(SOURCE, f"{AGAIN}(5.21)", "rank of the six unknowns that two landmarks fix", "1", "4",
                      float(6 - len(two)), "no pose from two; a filter with an INS uses them still"))  # fmt: skip
    return [
        *made,
        Row(SOURCE, "(5.12)-(5.14)", "the camera's equations", "1", None, None, REPRODUCED,
            "right as printed; z < 0 in front"),
        Row(SOURCE, "(5.21) text", "(5.10) into (5.9)", "1", None, None, CORRECTED, "(5.20) into (5.19)"),
    ]  # fmt: skip


def coriolis(speed: float = 200.0) -> float:
    """East acceleration, m/s^2, of (5.11)'s Coriolis term at this speed north at 50.21 deg, put right."""
    r, v, C = ecef.to_e(LAT, 0.0, 0.0, (speed, 0.0, 0.0), np.eye(3))
    still = ecef.nonlinear_rate(r, 0.0 * v, C, np.zeros(3), np.zeros(3))[1]
    moving = ecef.nonlinear_rate(r, v, C, np.zeros(3), np.zeros(3))[1]
    return float((C.T @ (moving - still))[1])


def growth(gradient: bool, hours: float = 1.0, bias: float = 9.80665e-4) -> float:
    """North error, m, after `hours` of a constant north accelerometer error at rest, by (5.15) with or without G dr."""
    from scipy.linalg import expm

    r, _, C = ecef.to_e(LAT, 0.0, 0.0, (0.0, 0.0, 0.0), np.eye(3))
    F = ecef.error_matrix(r, C @ np.array([0.0, 0.0, -float(WGS84.gravity(LAT))]))
    if not gradient:
        F[3:6, 6:9] = 0.0
    whole = np.zeros((10, 10))
    whole[:9, :9] = F
    whole[:9, 9] = ecef.input_matrix(C) @ np.array([bias, 0.0, 0.0, 0.0, 0.0, 0.0])
    end = expm(whole * hours * 3600.0)[:9, 9]
    return float((C.T @ end[6:9])[0])


def _mechanization() -> list[Row]:
    right = coriolis()
    drift = 0.05 * D / 3600.0
    return [
        _fixed("(5.11) row 1", "turn of the attitude at rest in an hour", "deg", WGS84.omega * 3600.0 / D, 0.0,
               "printed w x v for C [w_eb x], and w_eb taken from the gyros, which show w_ib: the Earth's own rate has "
               "to come off"),
        _fixed("(5.11), (5.15)", "Coriolis acceleration at 200 m/s north, 50.21 deg, to the east", "m/s^2", -right,
               right,
               "-2 w_ie x v; printed with w_ei = -w_ie"),
        _fixed("(5.15) rows 2, 3", "north error after 1 h of 1e-4 g at rest", "m", growth(False), growth(True),
               "delta g is not free but G dr: without it there is no Schuler loop, and the label of the frame is e, "
               "not b"),
        judge(SOURCE, "section 5.3", "0.05 deg/h in units of 1e-7 rad/s", "1e-7 rad/s", "2.4241", drift * 1e7,
              "printed as 2.4241 rad/s: the exponent -7 is missing"),
    ]  # fmt: skip


def yaw_is_a_symmetry(angle: float = 0.3) -> float:
    """Largest change of the image when vehicle and unknown landmarks turn about the vertical by a finite angle."""
    rng = np.random.default_rng(1)
    d, r = rng.uniform(-1.0, 1.0, (6, 3)) + [0.0, 0.0, 5.0], np.array([0.2, -0.3, 0.1])
    q = np.array([0.9, 0.1, 0.2, -0.3]) / np.linalg.norm([0.9, 0.1, 0.2, -0.3])
    z = np.array([math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)])

    def image(r: Array, q: Array, d: Array) -> Array:
        F = quat_rotate(q * [1.0, -1.0, -1.0, -1.0], d - r)
        return np.asarray(F[:, :2] / F[:, 2:])

    turned = image(quat_rotate(z, r), quat_multiply(z, q), quat_rotate(z, d))
    return float(np.abs(turned - image(r, q, d)).max())
