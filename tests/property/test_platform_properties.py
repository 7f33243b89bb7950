"""Over random studies: the two platforms are one, and both are what first-order theory says, to second order."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schuler.inertial import platform as inertial
from schuler.inertial.platform import RADIUS, SCHULER, PlatformCase
from schuler.inertial.platform_errors import deflection, first_order

DEG = math.pi / 180.0
DEG_H = DEG / 3600.0


@st.composite
def cases(draw):
    """|lat| <= 60 deg all the way, any heading and direction up to 1.3 km/s, drift to 0.5 deg/h, 10 min to 3 h."""
    duration = draw(st.floats(600.0, 10800.0))
    lat = draw(st.floats(-60.0, 60.0))
    to = min(60.0, max(-60.0, lat + draw(st.floats(-65.0, 65.0)) * duration / 7200.0))
    east = draw(st.floats(-65.0, 65.0)) * duration / 7200.0
    channel = draw(st.integers(0, 2))
    drift = [0.0, 0.0, 0.0]
    drift[channel] = draw(st.floats(0.001, 0.5)) * draw(st.sampled_from([-1.0, 1.0])) * DEG_H
    return channel, PlatformCase(
        lat=lat * DEG,
        heading=draw(st.floats(0.0, 360.0)) * DEG,
        lat_change=(to - lat) * DEG,
        lon_change=east * DEG,
        duration=duration,
        drift=tuple(drift),
    )


@settings(max_examples=60, deadline=None, derandomize=True)
@given(cases())
def test_position_independent_is_free_azimuth_is_theory(chosen):
    channel, case = chosen
    time = inertial.nodes(case, 10.0)
    exact = inertial.navigate(case, time=time)
    free = inertial.navigate(case, "free-azimuth", time=time)
    apart = np.hypot(exact.north - free.north, exact.east - free.east)
    largest = max(exact.error.max(), free.error.max())
    size = abs(case.drift[channel])
    if channel < 2:
        assert apart.max() < 0.002 * largest + 0.5
    else:
        # a share alpha of the drift works on the level axes and swings at the Schuler rate itself: resonance
        resonance = RADIUS * abs(deflection(case.lat)) * size * (time + 1.0 / SCHULER) / 2.0
        assert (apart < resonance + 0.5).all()
        if case.duration > 7000.0 and largest > 1000.0:
            assert apart.max() < 0.01 * largest + 0.5
    second = 0.5 * RADIUS * (size * time) ** 2
    for run, linear in ((free, first_order(case, time=time)), (exact, first_order(case, tilted=True, time=time))):
        assert (np.hypot(run.north - linear.north, run.east - linear.east) < second + 0.01).all()


def test_one_percent_is_too_narrow_for_short_runs_of_channel_3():
    """The case: at rest, 10 min, they are 17 % of the error apart (26 cm of 1.5 m); the resonance says how much."""
    case = PlatformCase(lat=35.7 * DEG, heading=math.pi, duration=600.0, drift=(0.0, 0.0, 0.5 * DEG_H))
    exact, free = inertial.navigate(case), inertial.navigate(case, "free-azimuth")
    apart = float(np.hypot(exact.north - free.north, exact.east - free.east).max())
    assert apart > 0.01 * free.error.max() + 0.5
    assert apart < RADIUS * deflection(case.lat) * case.drift[2] * (600.0 + 1.0 / SCHULER) / 2.0


@settings(max_examples=25, deadline=None, derandomize=True)
@given(cases())
def test_without_drift_nothing_errs(chosen):
    _, case = chosen
    clean = case.without_errors()
    time = inertial.nodes(clean)
    for algorithm in ("position-independent", "free-azimuth", "strapdown"):
        assert inertial.navigate(clean, algorithm, time=time).error.max() < 5e-4


@settings(max_examples=20, deadline=None, derandomize=True)
@given(cases(), st.floats(-180.0, 180.0))
def test_longitude_does_not_matter(chosen, lon_deg):
    _, case = chosen
    time = inertial.nodes(case, 20.0)
    here = inertial.navigate(case, time=time)
    there = inertial.navigate(replace(case, lon=lon_deg * DEG), time=time)
    np.testing.assert_allclose(there.error, here.error, atol=1e-5 * max(1.0, here.error.max()))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(cases())
def test_the_southern_mirror(chosen):
    """Everything mirrored at the equator (a rate is an axial vector) gives the same sizes."""
    _, case = chosen
    b1, b2, b3 = case.drift
    mirror = replace(
        case,
        lat=-case.lat,
        lat_change=-case.lat_change,
        heading=math.pi - case.heading,
        drift=(-b1, b2, -b3),
    )
    time = inertial.nodes(case, 20.0)
    a, b = inertial.navigate(case, time=time), inertial.navigate(mirror, time=time)
    assert b.error[-1] == pytest.approx(a.error[-1], rel=1e-6, abs=1e-4)
