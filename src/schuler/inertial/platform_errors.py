"""Closed forms of a stable platform's position error: drifts at rest, Pitman's table, first order along any path.

Sphere, height zero unless said. b in rad/s, angles in rad, t in s, results in metres; "north, west" pairs are positions
computed minus true. psi counts from north to west. Equation numbers: Ghesmati et al., corrected; rows: Pitman (1962).
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import OMEGA
from schuler.ground.errors import InputError
from schuler.inertial.platform import GRAVITY, RADIUS, SCHULER, PlatformCase, PlatformRun, navigate

Array = NDArray[np.float64]


def deflection(lat: float, exact: bool = False) -> float:
    """Angle from minus the mass attraction to the plumb line at rest, rad: alpha of (21); exact: with G for g_i."""
    f = RADIUS * OMEGA**2 * math.sin(lat) * math.cos(lat)
    return f / (GRAVITY - RADIUS * OMEGA**2 * math.cos(lat) ** 2) if exact else f / GRAVITY


def level_rate(lat: float) -> float:
    """sqrt(k_sh) at rest, rad/s: the Schuler rate about the axis along the inertial rate, less the Earth's turn."""
    return math.sqrt(SCHULER**2 - (OMEGA * math.cos(lat)) ** 2)


def tilt_stiffness(p: float, q: float) -> Array:
    """(2, 2) of phi'' = -K phi in (28), corrected, rad/s^2 per rad: g/R along, less the rate squared across.

    p, q : inertial rates of the m frame about axes 1 and 2, rad/s. The printed (28) has the smaller stiffness in all
    directions; it belongs to the direction of the rate alone.
    """
    return SCHULER**2 * np.eye(2) - np.outer([p, q], [p, q])


def level_drift(t: ArrayLike, b: float, lat: float) -> Array:
    """(32): size of the error of a drift b of channel 1 or 2 at rest, m. Bounded swing on a line through b t."""
    w, time = level_rate(lat), np.asarray(t, dtype=float)
    return RADIUS * b * (time - np.sin(w * time) / w)


def azimuth_tilt(
    t: ArrayLike, b: float, lat: float, psi: float, alpha: Literal["none", "corrected", "printed"] = "none"
) -> tuple[Array, Array]:
    """(36): (north, west), m, of what a drift b of channel 3 does at rest through the TILT of the platform alone.

    alpha : the terms with the start tilt as the source prints them, with the sign corrected, or none, which is what a
    full plant with the heading supplied shows (erratum 15). This is bounded, and it is not the position error: see
    `azimuth_heading` for the rest.
    """
    time = np.asarray(t, dtype=float)
    k, o = SCHULER**2 - (OMEGA * math.cos(lat)) ** 2, OMEGA * math.sin(lat)
    w = math.sqrt(k)
    a = b * OMEGA * math.cos(lat) / (k - o * o)
    s, c = math.sin(psi), math.cos(psi)
    p = a * (np.sin(psi - o * time) - s * np.cos(w * time) + o / w * c * np.sin(w * time))
    q = a * (np.cos(psi - o * time) - c * np.cos(w * time) - o / w * s * np.sin(w * time))
    if alpha != "none":
        swing = deflection(lat) * b / w * np.sin(w * time)
        p = p + c * swing
        q = q + (s if alpha == "printed" else -s) * swing
    # the integrals are angles in the slowly turning m frame; psi is that of the end
    turned = psi - o * time
    return (
        RADIUS * (p * np.sin(turned) + q * np.cos(turned)),
        -RADIUS * (p * np.cos(turned) - q * np.sin(turned)),
    )


def azimuth_heading(t: ArrayLike, b: float, lat: float) -> tuple[Array, Array]:
    """(north, west), m: what a drift b of channel 3 does at rest through the HEADING, which the source leaves out.

    Grows as b V t^2 / 2 with V = R w_e cos(lat) at first.
    """
    x = OMEGA * np.asarray(t, dtype=float)
    size = b * RADIUS / OMEGA * math.cos(lat)
    return -size * (1.0 - np.cos(x)), size * math.sin(lat) * (x - np.sin(x))


def azimuth_total(t: ArrayLike, b: float, lat: float, psi: float) -> tuple[Array, Array]:
    """(north, west), m, of a drift b of channel 3 at rest: heading part and tilt part together."""
    n, w = azimuth_heading(t, b, lat)
    tn, tw = azimuth_tilt(t, b, lat, psi)
    return n + tn, w + tw


def strapdown_open_drift(t: ArrayLike, b: float) -> Array:
    """g b t^3 / 6, m: a level drift without gravity feedback, the cubic that the source compares with."""
    return GRAVITY * b * np.asarray(t, dtype=float) ** 3 / 6.0


def flat_crossover() -> float:
    """Time, s, at which the published (36) and Pitman's row 5 cross on a flat Earth: w_s t = 2 y, y = sqrt(2) sin y."""
    y = 1.4
    for _ in range(60):
        y -= (y - math.sqrt(2.0) * math.sin(y)) / (1.0 - math.sqrt(2.0) * math.cos(y))
    return 2.0 * y / SCHULER


PITMAN: dict[int, str] = {
    1: "accelerometer bias, m/s^2",
    2: "initial tilt, rad",
    3: "accelerometer scale times velocity step, m/s",
    4: "level drift, rad/s",
    5: "azimuth drift, rad/s",
    6: "initial velocity error, m/s",
    7: "initial azimuth error, rad",
}


def pitman(row: int, t: ArrayLike, value: float, speed: float = 0.0) -> Array:
    """Pitman's table: error, m, of one row of `PITMAN` at times t, s.

    speed : inertial speed across, m/s (rows 5 and 7; at rest R w_e cos(lat)). Row 5 has eps_z/2: the source prints
    eps'_z without saying what it is, and with eps_z itself the error would be twice the simulated one.
    """
    time, w = np.asarray(t, dtype=float), SCHULER
    if row == 1:
        return value / w**2 * (1.0 - np.cos(w * time))
    if row == 2:
        return -RADIUS * value * (1.0 - np.cos(w * time))
    if row in (3, 6):
        return value / w * np.sin(w * time)
    if row == 4:
        return -RADIUS * value * (time - np.sin(w * time) / w)
    if row == 5:
        return value / 2.0 * speed * (time**2 - 2.0 / w**2 * (1.0 - np.cos(w * time)))
    if row == 7:
        return value * speed * (time - np.sin(w * time) / w)
    raise InputError(f"Pitman's table has rows 1 to 7, not {row}.")


def first_order(case: PlatformCase, *, tilted: bool = False, time: Array | None = None) -> PlatformRun:
    """Linear theory of any platform with r = 0, integrated along the path of the case.

    E' = C_im (phi_x'-dot - b_1, phi_y'-dot - b_2, -b_3 - (phi_x' q - phi_y' p)), dr = E x r, with phi' from the
    corrected (28). tilted : the gyro axes stand where those of the position-independent platform stand, off the
    vertical by the plumb line's deflection and swinging about it, instead of exactly on the vertical and the horizon.
    That is the whole difference between the two algorithms at first order: a share of about alpha of channel 3's drift
    works on the level axes, swinging at the Schuler rate, and the loop answers in resonance, by about R alpha b t / 2.
    """
    return navigate(case, "first-order-tilted" if tilted else "first-order", time=time)
