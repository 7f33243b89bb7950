"""The platform's integrator converges as RK4 should."""

import math

import numpy as np
import pytest

from schuler.inertial import platform as inertial
from schuler.inertial.platform import PlatformCase

DEG = math.pi / 180.0


@pytest.mark.parametrize("algorithm", ["position-independent", "free-azimuth", "strapdown", "first-order-tilted"])
def test_fourth_order(algorithm):
    case = PlatformCase(
        lat=35.7 * DEG,
        heading=math.pi,
        lat_change=-65 * DEG,
        lon_change=55 * DEG,
        drift=(4.8e-8, 0.0, 4.8e-7),
        accel_bias=(1e-3, 2e-3),
    )
    steps = np.array([200.0, 100.0, 50.0])
    ends = []
    for step in (*steps, 5.0):
        run = inertial.navigate(case, algorithm, time=inertial.nodes(case, float(step)))
        ends.append((run.north[-1], run.east[-1]))
    off = np.hypot(*(np.array(ends[:-1]) - ends[-1]).T)
    slope = np.polyfit(np.log(steps), np.log(off), 1)[0]
    assert slope == pytest.approx(4.0, abs=0.5)


def test_a_start_ramp_is_resolved():
    """Error of a short ramp falls with the fourth power of the steps on it."""
    case = PlatformCase(lat=0.0, lat_change=304.8 / inertial.RADIUS * 7195.0, start_ramp=10.0)

    def error(parts):
        ramp = np.linspace(0.0, 10.0, parts + 1)
        time = np.concatenate([ramp, np.linspace(10.0, 7200.0, 1439)[1:]])
        return float(inertial.navigate(case, "free-azimuth", time=time).error.max())

    assert error(20) / error(40) == pytest.approx(16.0, rel=0.1)
    assert float(inertial.navigate(case, "free-azimuth").error.max()) < 1e-4
