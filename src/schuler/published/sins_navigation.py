"""Chapter 2.2.3 of the thesis: navigation equations and the ideal navigator's two experiments; listing A.1."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84, Ellipsoid, sphere
from schuler.published.ledger import CORRECTED, REPRODUCED, Row, judge
from schuler.truth import trajectories

Array = NDArray[np.float64]
SOURCE = "sins"
D = math.pi / 180.0
OMEGA = 7.292115e-5
PRINTED_RADIUS = 6478137.0
START = (50.21 * D, 30.3 * D)
SPEED, DURATION = 200.0, 600.0
# latitude, longitude after 600 s, deg: an independent recomputation, exact rhumb lines
ENDS = {
    (0, "R = 6378137 m"): ("51.28797834", "30.3"),
    (0, "R = 6478137 m, as printed"): ("51.27133809", "30.3"),
    (0, "WGS-84"): ("51.28871503", "30.3"),
    (30, "R = 6378137 m"): ("51.14355663", "31.15058801"),
    (30, "R = 6478137 m, as printed"): ("51.12914575", "31.13732819"),
    (30, "WGS-84"): ("51.14420625", "31.14888859"),
}
EARTHS: dict[str, Ellipsoid] = {
    "R = 6378137 m": sphere(6378137.0),
    "R = 6478137 m, as printed": sphere(PRINTED_RADIUS),
    "WGS-84": WGS84,
}


def end_of(heading_deg: float, earth: Ellipsoid) -> tuple[float, float]:
    """Latitude and longitude, deg, after 600 s of the exact rhumb line."""
    line = trajectories.rhumb_line(*START, speed=SPEED, heading=heading_deg * D, duration=DURATION, earth=earth)
    at = line.at(DURATION)
    return math.degrees(float(at.lat[0])), math.degrees(float(at.lon[0]))


def rate_terms(v_e: float, v_n: float, v_u: float, lat: float, radius: float) -> Array:
    """What (2.43) adds to the derivative of the velocity (E, N, U): W = dV + these, put right (2 u cos in row 1)."""
    s, c, t = math.sin(lat), math.cos(lat), math.tan(lat)
    return np.array(
        [
            -v_n * (2.0 * OMEGA * s + v_e * t / radius) + (2.0 * OMEGA * c + v_e / radius) * v_u,
            v_e * (2.0 * OMEGA * s + v_e * t / radius) + radius * OMEGA**2 * s * c + v_n * v_u / radius,
            -(v_n**2 + v_e**2) / radius - 2.0 * OMEGA * c * v_e - radius * OMEGA**2 * c * c,
        ]
    )


def navigator(heading_deg: float, *, h: float = 0.005, remove_rates: bool = True, freeze: bool = False) -> Array:
    """(2.46) by Runge-Kutta 1 as the thesis runs it: latitude, longitude (rad) after 600 s from the accelerations W.

    remove_rates: subtract the rate terms first, as one must. freeze: cos(lat) of the start throughout, as listing A.1.
    """
    radius = 6378137.0
    lat, lon = START
    v_e, v_n = SPEED * math.sin(heading_deg * D), SPEED * math.cos(heading_deg * D)
    true_e, true_n, true_lat = v_e, v_n, lat
    c0 = math.cos(lat)
    for _ in range(round(DURATION / h)):
        W = rate_terms(true_e, true_n, 0.0, true_lat, radius)  # what an ideal navigator is fed: dV = 0
        if remove_rates:
            W = W - rate_terms(v_e, v_n, 0.0, lat, radius)
        v_e, v_n = v_e + h * W[0], v_n + h * W[1]
        lon += h * v_e / (radius * (c0 if freeze else math.cos(lat)))
        lat += h * v_n / radius
        true_lat += h * true_n / radius
    return np.array([lat, lon])


def equations_residual() -> tuple[float, float]:
    """Largest difference, m/s^2, of W by (2.43) from the second difference of an inertial position: put right,
    printed."""
    radius, h = 6378137.0, 0.5
    v_e, v_n, v_u = 120.0, 90.0, 50.0
    v1 = np.array([0.3, -0.2, 0.4])  # their derivatives
    lat0 = 50.21 * D

    def place(t: float) -> Array:
        # latitude, longitude, radius by a series in t whose velocities are those above at t = 0
        r = radius + v_u * t + 0.5 * v1[2] * t * t
        lat_rate = v_n / radius
        lat_acc = v1[1] / radius - v_n * v_u / radius**2
        lat = lat0 + lat_rate * t + 0.5 * lat_acc * t * t
        c = math.cos(lat0)
        lon_rate = v_e / (radius * c)
        lon_acc = v1[0] / (radius * c) - v_e * v_u / (radius**2 * c) + v_e * math.tan(lat0) / (radius * c) * lat_rate
        lon = lon_rate * t + 0.5 * lon_acc * t * t + OMEGA * t
        return r * np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])

    # inertial acceleration by a fourth-order second difference, in east, north, up of t = 0
    p = [place(k * h) for k in (-2, -1, 0, 1, 2)]
    a = (-p[0] + 16.0 * p[1] - 30.0 * p[2] + 16.0 * p[3] - p[4]) / (12.0 * h * h)
    s, c = math.sin(lat0), math.cos(lat0)
    found = np.array([a[1], -s * a[0] + c * a[2], c * a[0] + s * a[2]])
    right = v1 + rate_terms(v_e, v_n, v_u, lat0, radius)
    printed = right - np.array([OMEGA * c * v_u, 0.0, 0.0])
    return float(np.abs(found - right).max()), float(np.abs(found - printed).max())


def rows() -> list[Row]:
    """Every figure of the section."""
    made: list[Row] = []
    for (heading, name), printed in ENDS.items():
        ours = end_of(heading, EARTHS[name])
        for what, p, o in zip(("latitude", "longitude"), printed, ours, strict=True):
            made.append(
                judge(
                    SOURCE,
                    "recomputation of figures 2.12, 2.13",
                    f"{what} after 600 s, heading {heading} deg, {name}",
                    "deg",
                    p,
                    o,
                    "exact rhumb line at 200 m/s",
                )
            )
    exact = np.radians(end_of(0, EARTHS["R = 6378137 m"]))
    far = np.radians(end_of(0, EARTHS["R = 6478137 m, as printed"]))
    made.append(
        Row(
            SOURCE,
            "(2.41)",
            "Earth's radius",
            "km",
            6478.137,
            6378.137,
            CORRECTED,
            f"100 km too large: {abs(float(exact[0] - far[0])) * 6378.137:.2f} km in 600 s; u is 7.292115e-5, not "
            f"7.27e-5",
        )
    )
    made += _runs()
    first = rate_terms(0.0, SPEED, 0.0, START[0], 6378137.0)
    for axis, p, o in zip("ENU", ("-0.0224129056", "0.0166781908", "-0.0201622377"), first, strict=True):
        made.append(
            judge(
                SOURCE,
                "recomputation of (2.43)",
                f"W_{axis} needed at the start of experiment 1",
                "m/s^2",
                p,
                float(o),
                "inertial acceleration of a constant velocity over ground",
            )
        )
    right, printed_residual = equations_residual()
    made.append(
        Row(
            SOURCE,
            "(2.43) row 1",
            "difference from an inertial second difference at 50 m/s of climb",
            "m/s^2",
            printed_residual,
            right,
            CORRECTED,
            "(2 u cos + V_E/R) V_zeta: the printed row has a single u cos",
        )
    )
    lat = 50.27 * D
    gravity = 1.0 + 0.0053024 * math.sin(lat) ** 2 - 5.8e-6 * math.sin(2.0 * lat) ** 2
    made += [
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "gravity at 50.27 deg with gamma_e = 9.78",
            "m/s^2",
            "9.810616844",
            9.78 * gravity,
            "the listing rounds the equator's 9.780327",
        ),
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "the same with gamma_e = 9.780327",
            "m/s^2",
            "9.810944868",
            9.780327 * gravity,
            "the coefficients of 1967 with the equator's gravity of 1980",
        ),
        Row(
            SOURCE,
            "(2.45)",
            "signs of c22, c31, c32",
            "1",
            None,
            None,
            CORRECTED,
            "+ cos(theta) cos(psi), - sin(gamma) cos(theta), + sin(theta): the direction cosines of the same chapter",
        ),
        Row(
            SOURCE,
            "(2.42), (2.43) rows 2-3",
            "residual against the inertial second difference",
            "m/s^2",
            None,
            right,
            REPRODUCED,
            "correct as printed",
        ),
    ]
    return made


def _runs() -> list[Row]:
    radius = 6378137.0
    made: list[Row] = []
    for heading, (east, north) in ((0, ("-4034", "3002")), (30, ("-4081", "5358"))):
        lat, lon = np.radians(end_of(heading, EARTHS["R = 6378137 m"]))
        good = navigator(heading)
        miss = math.hypot((good[0] - lat) * radius, (good[1] - lon) * radius * math.cos(lat))
        made.append(
            Row(
                SOURCE,
                "ideal navigator, RK1, h = 0.005",
                f"distance from the exact end, heading {heading} deg",
                "m",
                None,
                miss,
                REPRODUCED,
                "a few millimetres: Runge-Kutta 1 is good enough here",
            )
        )
        v_e, v_n = SPEED * math.sin(heading * D), SPEED * math.cos(heading * D)
        raw = rate_terms(v_e, v_n, 0.0, START[0], radius) * 0.5 * DURATION**2
        for what, p, o in (("east", east, raw[0]), ("north", north, raw[1])):
            made.append(
                judge(
                    SOURCE,
                    "recomputation of (2.46)",
                    f"error {what} after 600 s when W of the start is integrated as it is, heading {heading} deg",
                    "m",
                    p,
                    float(o),
                    "(2.46) must take the rate terms of (2.43) off first",
                )
            )
    frozen, lon = navigator(30, freeze=True), math.radians(end_of(30, EARTHS["R = 6378137 m"])[1])
    lat = frozen[0]
    made.append(
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "longitude error of experiment 2 with cos(lat) frozen",
            "m",
            "-585.6",
            float((frozen[1] - lon) * radius * math.cos(lat)),
            "the listing divides by the cosine of the start",
            within=2.0,
        )
    )
    return made


# Listing A.1, literally


def listing(*, real: bool, h: float = 0.05, seed: int = 1, noise: bool = True, literal: bool = True) -> dict[str, Any]:
    """Listing A.1's run: its Poisson equation by RK1 and its position with frozen cosine, ideal or real.

    real: accelerometer bias 0.1 % of a 10 g span on each axis, resolved by the running C, white noise added to latitude
    and longitude in every step. literal=False keeps C and the cosine right, to tell the defects apart.
    """
    from schuler.inertial.attitude_study import dcm_zxy

    rng = np.random.default_rng(seed)
    radius, g = 6378137.0, 9.810616844
    psi0 = 30.0 * D
    bias = 0.001 * 10.0 * g if real else 0.0
    lat, lon = 50.27 * D, 30.30 * D
    c0 = math.cos(lat)
    v_n, v_e = SPEED * math.cos(psi0), SPEED * math.sin(psi0)

    def motion(t: float) -> tuple[Array, Array]:
        angles = np.array([0.0, 0.1 * math.sin(t + 0.5 * math.pi), 0.2 * math.sin(t)])
        a1, b1 = 0.1 * math.cos(t + 0.5 * math.pi), 0.2 * math.cos(t)
        cg, sg = math.cos(angles[2]), math.sin(angles[2])
        return angles, np.array([a1 * cg, b1, a1 * sg])

    C = dcm_zxy(*motion(0.0)[0])
    steps = round(600.0 / h)
    draw = rng.standard_normal((steps, 2))
    for k in range(steps):
        t = k * h
        angles, w = motion(t)
        used = C if literal else dcm_zxy(*angles)
        W = used @ np.full(3, bias)
        v_e, v_n = v_e + h * W[0], v_n + h * W[1]
        lat += h * v_n / radius
        lon += h * v_e / (radius * (c0 if literal else math.cos(lat)))
        if real and noise:
            lat += 1e-4 * draw[k, 0]
            lon += 1e-5 * draw[k, 1]
        S = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
        C = C + h * (C @ S)
    return {"lat": lat, "lon": lon, "C": C, "v_n": v_n, "v_e": v_e}


def listing_rows() -> list[Row]:
    """Listing A.1 run as it stands, and its defects one by one."""
    radius, g = 6378137.0, 9.810616844
    ideal = listing(real=False, literal=True)
    clean = listing(real=False, literal=False)
    quiet = listing(real=True, noise=False)
    steps = 12000
    walk = 1e-4 * math.sqrt(steps) * radius
    gyro = 0.005 * 3600.0
    open_loop = 0.5 * 0.01 * g * 600.0**2
    true_lat = 50.27 * D + SPEED * math.cos(30.0 * D) * 600.0 / radius

    def defect(what: str, unit: str, was: float | None, ours: float, reason: str) -> Row:
        return Row(SOURCE, "listing A.1", what, unit, was, ours, CORRECTED, reason)

    return [
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "latitude noise after 600 s, 1 sigma",
            "km",
            "69.9",
            walk / 1e3,
            "1e-4 rad of noise is added to the latitude in each of 12000 steps: it is integrated",
        ),
        judge(
            SOURCE,
            "recomputation of listing A.1",
            "0.01 g without feedback after 600 s",
            "km",
            "17.66",
            open_loop / 1e3,
            "0.1 % of a 10 g span is 0.01 g, a hundred times the text's 1e-4 g",
        ),
        defect("gyro drift of 0.005 deg/s in the text's unit", "deg/h", 0.005, gyro, "the listing's 0.005 is deg/s"),
        defect(
            "ideal run: north error after 600 s",
            "m",
            None,
            float((ideal["lat"] - true_lat) * radius),
            "the ideal run has no acceleration at all and no rate terms: a straight line in latitude",
        ),
        defect(
            "ideal run: east error after 600 s from the frozen cosine",
            "m",
            None,
            float((ideal["lon"] - clean["lon"]) * radius * math.cos(clean["lat"])),
            "cos(lat) of the start divides the longitude rate to the end",
        ),
        defect(
            "ideal run: det C after 600 s",
            "1",
            None,
            float(np.linalg.det(ideal["C"])),
            "Poisson's equation by RK1 without renormalisation",
        ),
        defect(
            "real run without its noise: distance from the ideal end",
            "km",
            None,
            math.hypot(quiet["lat"] - ideal["lat"], (quiet["lon"] - ideal["lon"]) * math.cos(ideal["lat"]))
            * radius
            / 1e3,
            "the bias is carried by a C that no longer is a rotation, and no gravity reacts to the tilt",
        ),
        Row(
            SOURCE,
            "listing A.1",
            "gravity on the body axes",
            "m/s^2",
            0.0,
            g,
            CORRECTED,
            "commented out: W has no gravity, so the accelerometers of the listing feel none and nothing can be "
            "levelled",
        ),
        Row(
            SOURCE,
            "listing A.1",
            "acceleration into body axes",
            "1",
            None,
            None,
            CORRECTED,
            "rows and columns of C are mixed: both directions use C and not once its transpose",
        ),
        Row(
            SOURCE,
            "listing A.1",
            "noise of the position",
            "1",
            None,
            None,
            CORRECTED,
            "randn(1, length(tI)) is one number, since tI is one number; the start is moved by up to 1e-4 rad (638 m)",
        ),
    ]
