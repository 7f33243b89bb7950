"""Latitude and longitude the wrong way round, told by velocities, a compass, or a place that is known."""

import numpy as np
import pytest
from test_judging import LAT, LON, track
from test_lag import drive

from schuler.ground.tables import Table
from schuler.studies.places import against_heading, against_velocity, apart, exchanged


@pytest.fixture(scope="module")
def recorded():
    """(gnss as it is, with lat and lon exchanged, attitude) of a car with fixes of 1 m and a compass 3 deg off."""
    rng = np.random.default_rng(1)
    t, _, heading, velocity = drive(duration=900.0)
    heading = heading + np.pi * t / 400.0  # so that it points everywhere
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    velocity = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), 0.0 * t])
    s = track(t, np.cumsum(velocity, axis=0) * 0.1 + rng.normal(size=(len(t), 3)))
    columns = {"time": t, "lat": s.lat, "lon": s.lon, "v_north": velocity[:, 0], "v_east": velocity[:, 1]}
    columns = {k: v[::10] for k, v in columns.items()}
    turned = {**columns, "lat": columns["lon"], "lon": columns["lat"]}
    attitude = {"time": t, "roll": 0 * t, "pitch": 0 * t, "heading": np.mod(heading + 0.05, 2 * np.pi)}
    return Table("gnss", columns), Table("gnss", turned), Table("attitude", attitude)


def test_the_receivers_own_velocities_tell(recorded):
    right, wrong, _ = recorded
    assert against_velocity(right, False) < 0.3 and against_velocity(right, True) > 0.8
    assert against_velocity(wrong, True) < 0.3 and against_velocity(wrong, False) > 0.8
    still = Table("gnss", {**right.columns, "v_north": 0 * right.time, "v_east": 0 * right.time})
    assert against_velocity(still, False) is None


def test_a_compass_tells(recorded):
    right, wrong, attitude = recorded
    assert against_heading(right, attitude, False) > 0.95 and against_heading(right, attitude, True) < 0.5
    assert against_heading(wrong, attitude, True) > 0.95 and against_heading(wrong, attitude, False) < 0.5
    straight = Table("attitude", {**attitude.columns, "heading": np.full(len(attitude), 0.3)})
    assert against_heading(right, straight, False) is None


def test_a_place_that_is_known_tells():
    assert exchanged((LON, LAT), (LAT, LON)) == (pytest.approx(apart((LAT, LON), (LON, LAT))), pytest.approx(0.0))
    assert exchanged((LAT, LON), (LAT, LON)) is None
    assert exchanged((0.1, 0.2), (LAT, LON)) is None  # elsewhere either way
    assert exchanged((0.7, 0.7001), (0.7001, 0.7)) is None  # too near to each other to tell
    assert exchanged((2.1, 0.6), (0.6, 2.1)) is not None  # no latitude at all as it stands
