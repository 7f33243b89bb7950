"""Errata of the position-independent platform's paper, each with the number that shows it, computed here and now."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from schuler.ground.earth import OMEGA
from schuler.inertial import platform as inertial
from schuler.inertial import platform_alignment as alignment
from schuler.inertial import platform_errors as theory
from schuler.inertial.platform import GRAVITY, RADIUS, SCHULER, PlatformCase
from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, REPRODUCED, Row
from schuler.published.platform_figures import HEADING_DEG, LAT_DEG, SCENARIOS

SOURCE = "platform"
DEG = math.pi / 180.0
DEG_H = DEG / 3600.0
LAT = LAT_DEG * DEG
B1, B3 = 0.01 * DEG_H, 0.1 * DEG_H


Triple = tuple[float, float, float]


def case_of(scenario: str, drift: Triple = (0.0, 0.0, 0.0), psi_deg: float = HEADING_DEG) -> PlatformCase:
    """A scenario of the paper as recomputed: drift in deg/h."""
    dlat, dlon = SCENARIOS[scenario]
    b1, b2, b3 = (x * DEG_H for x in drift)
    return PlatformCase(
        lat=LAT,
        lon=51.4 * DEG,
        heading=psi_deg * DEG,
        lat_change=dlat * DEG,
        lon_change=dlon * DEG,
        drift=(b1, b2, b3),
    )


def aligned_case(carried: bool = True) -> PlatformCase:
    """The alignment example: body heading 40 deg, biases, drifts."""
    return PlatformCase(
        lat=LAT,
        heading=40.0 * DEG,
        accel_bias=(1e-4 * GRAVITY, -2e-4 * GRAVITY),
        drift=(B1, -2.0 * B1, B3),
        gimbal_bias=1e-3,
        drift_carried=carried,
    )


def _row(where: str, quantity: str, unit: str, printed: float | None, ours: float | None, reason: str) -> Row:
    return Row(SOURCE, where, quantity, unit, printed, ours, CORRECTED, reason)


def errata() -> list[Row]:
    """All twenty-four. `published` is what the equation as read gives, `ours` what the corrected one gives."""
    return [*_equations(), *_alignment(), *_drift(), *_readings()]


def identity_residual(dotted: bool) -> float:
    """Largest |(15) - truth of it| over random states, rad/s^2; dotted: with z' in (w + p) z'/z, else z as read."""
    rng = np.random.default_rng(15)
    worst = 0.0
    for _ in range(20):
        z = RADIUS * (1.0 + 1e-3 * rng.standard_normal())
        phi_x, phi_y = 1e-2 * rng.standard_normal(2)
        p, q, r = 1e-4 * rng.standard_normal(3)
        y, x = RADIUS * phi_x, -RADIUS * phi_y
        u, v, w = 500.0 * rng.standard_normal(3)
        f1, f2 = rng.standard_normal(2)
        size = math.sqrt(x * x + y * y + z * z) ** 3
        gm = SCHULER**2 * RADIUS**3
        dz = q * x - p * y + w
        du = r * v - q * w + f1 - gm * x / size
        true = du / z - u * dz / z**2  # w_y' from (9) and (11)
        k = RADIUS / z
        d = phi_x**2 + phi_y**2 + 1.0 / k**2
        term = (dz if dotted else z) / z
        said = -(u / z + q) * term + r * v / z - k * q * (q * phi_y + p * phi_x) + f1 / z
        said += SCHULER**2 * k * phi_y / d**1.5
        worst = max(worst, abs(said - true))
    return worst


def _equations() -> list[Row]:
    rows = [
        _row(
            "eq. (15)", "largest residual of (15) against (9) and (11), random states", "rad/s^2",
            identity_residual(False), identity_residual(True),
            "Erratum 1: the dots over z in (w + p) z'/z are lost in the scan.",
        )
    ]  # fmt: skip
    psi = 30.0 * DEG
    wrong = OMEGA * math.cos(LAT) * (math.cos(psi) * math.sin(psi) - math.sin(psi) * math.cos(psi))
    printed_q = OMEGA * math.cos(psi) * math.cos(LAT) - OMEGA * math.sin(psi) * math.cos(LAT)
    rows.append(
        _row(
            "eq. (16)", "latitude rate at rest, psi = 30 deg", "rad/s", printed_q * math.cos(psi), wrong,
            "Erratum 2: the second Earth-rate entry is w_e sin(psi) cos(phi), not w_e cos(psi) cos(phi); as printed a "
            "vehicle at rest runs off at 120 m/s.",
        )
    )  # fmt: skip
    exact = float(inertial.navigate(case_of("latlon")).error.max())
    rows.append(
        _row(
            "eq. (16)", "drift-free error of the exact form over two hours, latlon, largest", "m", None, exact,
            "Erratum 3: brackets lost in one reading; C acts on w_im - w_ie only, then (0, 0, psi') is taken off.",
        )
    )  # fmt: skip
    for name in SCENARIOS:
        literal = float(inertial.navigate(case_of(name), form="literal").error.max())
        corrected = float(inertial.navigate(case_of(name), form="corrected").error.max())
        rows.append(
            _row(
                "eq. (16), r_m", f"drift-free error over two hours, {name}, largest", "m", literal, corrected,
                "Erratum 4: r_m = 0 is an approximation; r_m = phi_x q - phi_y p is right to first order of the tilt.",
            )
        )  # fmt: skip
    at, found = 1800.0, case_of("latlon")
    truth = inertial.truth_of(found, [at])
    rate = found.lon_change / found.duration + OMEGA
    lat1 = found.lat_change / found.duration
    middle = 2.0 * RADIUS * math.sin(float(truth.lat[0])) * lat1
    rows.append(
        _row(
            "eq. (17)", "west force, latlon, 1800 s", "m/s^2", middle * rate**2, float(truth.force_mN[0, 1]),
            "Erratum 6: 2 R sin(phi) L^2 phi' has the wrong dimension; L phi' is meant. Ours is the simulated force.",
        )
    )  # fmt: skip
    return rows


def _alignment() -> list[Row]:
    case = aligned_case()
    end, linear = alignment.end_values(case), alignment.end_values_first_order(case)
    s, c = math.sin(end.psi), math.cos(end.psi)
    f = RADIUS * OMEGA**2 * math.sin(LAT) * math.cos(LAT)
    g = GRAVITY - RADIUS * OMEGA**2 * math.cos(LAT) ** 2
    b1, b2 = case.accel_bias
    alpha, t1, t2 = f / GRAVITY, b1 / GRAVITY, b2 / GRAVITY
    w = OMEGA * math.cos(LAT)
    r_printed = OMEGA * math.sin(LAT) + w * (s * t2 - c * t1)
    r0 = float(linear.rates[2])
    b_3 = case.drift[2]
    jumps = {j.name: j for j in alignment.switch(case)}
    stepping = {j.name: j for j in alignment.switch(aligned_case(False))}
    # (31) as printed, its terms in turn
    terms_x = -alpha * r0 * c + alpha * c * b_3 + r0 * t1 - b_3 * t1
    printed_x = terms_x + w * c * (t1**2 - t2**2)
    p_31y = alpha * r0 * s + alpha * s * b_3 + r0 * t2 + b_3 * t2
    loop = alignment.levelling_loop(0.03, 0.8)
    ratio = alignment.integral_gain_ratio(loop)
    return [
        _row("eq. (20)", "phi_y at the end of alignment, psi_0 = 40.06 deg", "rad", (f * s - b1) / g, end.phi_y,
             "Erratum 7: sin and cos of psi are swapped; (21) has them right."),
        _row("eq. (20)", "phi_x at the end of alignment, psi_0 = 40.06 deg", "rad", (f * c + b2) / g, end.phi_x,
             "Erratum 7: sin and cos of psi are swapped; (21) has them right."),
        _row("eq. (21)", "phi_y with g_i in place of G", "rad", alpha * c - t1, end.phi_y,
             "Erratum 8: an approximation, 2.3e-3 of the tilt; as a position 24 m of 10.4 km."),
        _row("eq. (24)", "r at the end of alignment", "rad/s", r_printed, float(end.rates[2]),
             "Erratum 9: w_e sin(phi_L), of the plumb latitude, is meant; (31) has it."),
        _row("eq. (27)", "phi_x' after the switch, drift carried", "rad/s", (b_3 - r0) * end.phi_y + case.drift[0],
             jumps["phi_x'"].after,
             "Erratum 11: + b_g1 contradicts (26) and Table 1 row 6; it is there only for a drift that steps on."),
        Row(SOURCE, "eq. (27)", "phi_y' after the switch, drift steps on", "rad/s",
            (r0 - b_3) * end.phi_x + case.drift[1], stepping["phi_y'"].after, REPRODUCED,
             "Erratum 11, the other case: with a drift that steps on at the switch the printed term is right."),
        _row("eq. (31)", "phi_x' after the switch, drift carried", "rad/s", printed_x, jumps["phi_x'"].after,
             "Erratum 12: the square of theta_F1 is meant where theta_F2 is printed."),
        _row("eq. (31)", "phi_y' after the switch, drift carried", "rad/s", p_31y, jumps["phi_y'"].after,
             "Erratum 13: both terms with b_g3 are negative."),
        _row("Table 1, row 4", "psi' after the switch", "rad/s", None, jumps["psi'"].after,
             "Erratum 20: psi' jumps, by -w_e sin(phi_L) and the drift, and not psi, which row 1 says does not."),
        _row("section 4.1", "k_I k_G k_F of alignment over that of navigation, 0.03 rad/s", "1", None, ratio,
             "Erratum 22: k_I must DEcrease at the switch for any alignment loop faster than Schuler; printed is "
             "increase."),
    ]  # fmt: skip


def _drift() -> list[Row]:
    t, psi = 300.0, 45.0 * DEG
    swing = theory.deflection(LAT) * B3 * math.sin(psi)
    printed = float(np.hypot(*theory.azimuth_tilt(t, B3, LAT, psi, "printed")))
    plain = float(np.hypot(*theory.azimuth_tilt(t, B3, LAT, psi)))
    along = case_of("lon", (0.01, 0.0, 0.0), 90.0)
    isotropic = float(inertial.navigate(along, "as-published").error[-1])
    right = float(inertial.navigate(along, "free-azimuth").error[-1])
    rest = case_of("rest", (0.0, 0.0, 0.1))
    published = float(inertial.navigate(rest, "as-published").error[-1])
    physical = float(inertial.navigate(rest).error[-1])
    free = float(inertial.navigate(replace(rest, heading=0.0), "free-azimuth").error[-1])
    row5 = float(theory.pitman(5, 7200.0, 2.0 * B3, RADIUS * OMEGA * math.cos(LAT)))
    return [
        _row("eq. (34)", "alpha part of phi_y' at the start, psi_0 = 45 deg", "rad/s", swing, -swing,
             "Erratum 14: the sign, as in (31)."),
        _row("eq. (36)", "tilt part at 300 s, psi_0 = 45 deg", "m", printed, plain,
             "Erratum 15: the terms with alpha cancel what p_merror and q_merror leave out ((15) with r = b_g3)."),
        _row("eq. (28)", "error of channel 1 at 2 h, lon, psi_0 = 90 deg", "m", isotropic, right,
             "Erratum 16: the stiffness is (g/R) I - w w', smaller along the rate only; ours is the simulation."),
        Row(SOURCE, "eq. (35)", "error of channel 3 at 2 h at rest", "m", published, physical, NOT_REPRODUCIBLE,
            "Erratum 19, the decisive one: psi = psi_0 - w_e sin(phi) t lacks b_g3 t. The drift turns the platform and "
            "the algorithm does not know; with it the error is that of free azimuth."),
        _row("Table 2, row 5", "azimuth drift, free azimuth, 2 h at rest", "m", row5, free,
             "Erratum 21: eps'_z is not said; eps_z/2 fits the simulation within 1.8 %, eps_z is twice as much."),
    ]  # fmt: skip


def _readings() -> list[Row]:
    said = (
        ("eq. (4)-(11)", "Erratum 5: indices and crosses lost in (4), (6), (9), (10); (11) is the last system."),
        ("eq. (26)", "Erratum 10: k_c is k_G, as (28) has it."),
        ("eq. (28)", "Erratum 17: phi' without index is phi_i'; R_GMM = 1/(k_I k_G k_F)."),
        ("eq. (33), (35)", "Erratum 18: second dots missing; A and a stand for two things each; a is read for alpha."),
        ("section 6", 'Erratum 23: "proposed less than proposed" means free azimuth less than proposed.'),
        ("eq. (36)", "Erratum 24: the number is missing in one reading; reference numbers repeat."),
    )
    return [Row(SOURCE, where, "reading", "", None, None, CORRECTED, reason) for where, reason in said]
