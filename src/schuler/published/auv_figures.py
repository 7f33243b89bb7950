"""Arithmetic behind the ledger of the AUV paper: its Table 3, the currents that would close it, the information bound.

Symbols: N, E metres; psi heading, rad; T seconds of outage; c current (north, east), m/s; k relative error of the log.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot, radians, sqrt

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FieldTest:
    """One of the paper's two sea trials, as printed. Positions (lat, lon) in degrees, times s, errors m and deg."""

    number: int
    surface_s: float
    dive_s: float  # in the text
    table_outage_s: float  # in Table 3
    estimated_deg: tuple[float, float]
    true_deg: tuple[float, float]
    published_error_m: float
    heading_error_deg: float
    bias_deg_per_s: float


TESTS = {
    1: FieldTest(1, 100.0, 520.0, 1040.0, (36.7301, 52.6513), (36.729, 52.6551), 340.0, 5.0, -0.053),
    2: FieldTest(2, 62.0, 523.0, 1045.0, (36.7330, 52.7037), (36.7335, 52.7077), 360.0, 3.0, 0.52),
}
REFERENCE_LAT_DEG = 36.73


def metres_per_degree(lat_deg: float = REFERENCE_LAT_DEG) -> tuple[float, float]:
    """North and east metres of one degree of latitude and of longitude, on the ellipsoid."""
    lat = radians(lat_deg)
    R_N, R_E = WGS84.radii(lat)
    return float(R_N) * radians(1.0), float(R_E) * float(np.cos(lat)) * radians(1.0)


def table_error(test: FieldTest, true_lat_deg: float | None = None) -> tuple[float, float, float]:
    """Estimate minus truth north and east, and the horizontal error, m, from the coordinates of Table 3."""
    lat = test.true_deg[0] if true_lat_deg is None else true_lat_deg
    per_lat, per_lon = metres_per_degree(0.5 * (test.estimated_deg[0] + lat))
    north = (test.estimated_deg[0] - lat) * per_lat
    east = (test.estimated_deg[1] - test.true_deg[1]) * per_lon
    return north, east, hypot(north, east)


def rounding_range(test: FieldTest, half_true_lat_deg: float = 0.5e-4) -> tuple[float, float]:
    """Smallest and largest horizontal error, m, that rounds to the coordinates of Table 3.

    Every coordinate may be off by half a unit of its fourth decimal; half_true_lat_deg is that of the true latitude,
    of which test 1 prints three decimals only.
    """
    per_lat, per_lon = metres_per_degree(test.true_deg[0])
    north, east, _ = table_error(test)
    d_north = (0.5e-4 + half_true_lat_deg) * per_lat
    d_east = 1e-4 * per_lon
    least = hypot(max(abs(north) - d_north, 0.0), max(abs(east) - d_east, 0.0))
    return least, hypot(abs(north) + d_north, abs(east) + d_east)


def latitude_for(test: FieldTest, error: float) -> float:
    """True latitude, deg, south of the estimate, with which Table 3 would give this horizontal error, m."""
    per_lat, _ = metres_per_degree(test.true_deg[0])
    east = table_error(test)[1]
    return test.estimated_deg[0] - sqrt(error**2 - east**2) / per_lat


def dive_error(current: Array, duration: float, ramp: float, scale: float, speed: float, surface_speed: float) -> Array:
    """Error (north, east), m, of dead reckoning over a straight dive heading east in a constant current.

    current (2,) m/s. The heading starts at the course of the surface leg (so it holds the crab angle) and its error
    grows by `ramp`, rad, in a straight line; the log reads (1 + scale) times the speed through the water. Closed form.
    """
    chi = atan2(surface_speed + current[1], current[0])
    if abs(ramp) > 1e-12:
        mean = np.array([np.sin(chi + ramp) - np.sin(chi), np.cos(chi) - np.cos(chi + ramp)]) / ramp
    else:
        mean = np.array([np.cos(chi), np.sin(chi)])
    estimated = speed * (1.0 + scale) * duration * mean
    return estimated - duration * np.array([current[0], speed + current[1]])


def closing_current(
    test: FieldTest, duration: float, ramp: float, scale: float = 0.0, speed: float = 2.5, surface_speed: float = 2.5
) -> Array:
    """The constant current (north, east), m/s, with which `dive_error` equals the test's error of Table 3."""
    wanted = np.array(table_error(test)[:2])
    c = np.array([0.0, 0.3])
    for _ in range(50):
        error = dive_error(c, duration, ramp, scale, speed, surface_speed) - wanted
        J = np.empty((2, 2))
        for k in range(2):
            step = np.zeros(2)
            step[k] = 1e-5
            ahead = dive_error(c + step, duration, ramp, scale, speed, surface_speed)
            J[:, k] = (ahead - dive_error(c - step, duration, ramp, scale, speed, surface_speed)) / 2e-5
        change = np.linalg.solve(J, error)
        c = c - change
        if np.max(np.abs(change)) < 1e-13:
            break
    return c


def bias_bound(fixes: int, sigma_course: float) -> float:
    """1 sigma of a gyro bias, rad/s, of a straight line through `fixes` courses, one a second, sigma_course rad."""
    return sigma_course * sqrt(12.0 / (fixes * (fixes**2 - 1.0)))


def heading_bound(fixes: int, outage: float, sigma_course: float, drift: float = 0.0, tau: float = 1000.0) -> float:
    """1 sigma of heading, rad, `outage` seconds after the last of `fixes` courses, on a bias that is held.

    Straight-line fit: the best that any filter can do. drift, rad/s, tau, s: the gyro's in-run instability (outage much
    shorter than tau).
    """
    n = float(fixes)
    line = sigma_course**2 * (1.0 / n + 12.0 * (outage + n / 2.0) ** 2 / (n * (n**2 - 1.0)))
    return sqrt(line + 2.0 * drift**2 * outage**3 / (3.0 * tau))


def euler_drift(roll: float, pitch: float, period: float, dt: float, duration: float) -> float:
    """Heading, rad, that Euler's rule (33) invents under roll and pitch oscillations in phase (the worst case).

    roll, pitch : amplitudes, rad. The true heading does not move and the gyros are exact.
    """
    from schuler.kernels.paper import linearise

    w = 2.0 * np.pi / period
    t = np.arange(round(duration / dt)) * dt
    phi, theta = roll * np.sin(w * t), pitch * np.sin(w * t)
    d_phi, d_theta = roll * w * np.cos(w * t), pitch * w * np.cos(w * t)
    rates = np.column_stack([d_phi, d_theta * np.cos(phi), -d_theta * np.sin(phi)])
    x, A = np.zeros(6), np.zeros((3, 6))
    x[:2] = phi[0], theta[0]
    for u in rates:
        x[:3] += np.array(linearise(x, u, A)) * dt
    return float(x[2])
