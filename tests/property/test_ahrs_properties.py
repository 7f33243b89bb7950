"""Laws of the attitude filter: north is where one says it is, and the box may be mounted any way round."""

from dataclasses import replace
from math import pi, radians

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ahrs_motion import SETTINGS, motion, record
from schuler.aiding.ahrs import AhrsSettings, attitude
from schuler.ground.frames import dcm_from_quat, dcm_from_rotvec

REC = record(12.0, 50.0, made=motion(12.0))
PLAIN = replace(SETTINGS, lat=None)
angles = st.floats(-pi, pi)


def turn(angle):
    """C of a turn about down: heading goes up by `angle`."""
    return dcm_from_rotvec(np.array([0.0, 0.0, angle]))


def apart(A, B):
    """Largest angle between two sets of attitudes, rad."""
    return float(np.max(np.linalg.norm(A - B, axis=(1, 2)))) / np.sqrt(2.0)


@settings(max_examples=15, deadline=None)
@given(angles)
def test_declination_turns_the_heading_and_nothing_else(angle):
    a = attitude(*REC.arrays(), settings=PLAIN)
    b = attitude(*REC.arrays(), settings=replace(PLAIN, declination=angle))
    assert apart(turn(angle) @ a.C, b.C) < 1e-9
    np.testing.assert_allclose(b.cov_phi, turn(angle) @ a.cov_phi @ turn(angle).T, atol=1e-9)


@settings(max_examples=15, deadline=None)
@given(angles)
def test_without_magnetometer_the_heading_is_free(angle):
    a = attitude(*REC.arrays(False), settings=replace(PLAIN, start_heading=0.0))
    b = attitude(*REC.arrays(False), settings=replace(PLAIN, start_heading=angle))
    assert apart(turn(angle) @ a.C, b.C) < 1e-9


@settings(max_examples=10, deadline=None)
@given(st.tuples(angles, angles, angles))
def test_the_box_may_sit_any_way_round(v):
    """Sensor axes turned by R: the attitude is turned by R too, the errors stay what they were."""
    R = dcm_from_rotvec(np.array(v) / max(1.0, np.linalg.norm(v) / pi))
    t, w, f, m = REC.arrays()
    s = AhrsSettings(std_tilt=0.1)
    a = attitude(t, w, f, m, s)
    b = attitude(t, w @ R.T, f @ R.T, m @ R.T, s)
    assert apart(a.C @ R.T, b.C) < 1e-7
    np.testing.assert_allclose(a.cov_phi, b.cov_phi, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(st.floats(1e-3, 1e3))
def test_the_size_of_the_field_does_not_matter(scale):
    t, w, f, m = REC.arrays()
    a, b = attitude(t, w, f, m, PLAIN), attitude(t, w, f, scale * m, PLAIN)
    assert apart(a.C, b.C) < 1e-9


@settings(max_examples=20, deadline=None)
@given(st.floats(-1.4, 1.4), st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_a_body_at_rest_is_found_as_it_lies(pitch, roll, heading):
    from schuler.ground.frames import dcm_from_euler

    C = dcm_from_euler(roll, pitch, heading)
    n = 300
    t = np.arange(1, n + 1) / 100.0
    f = np.tile(C.T @ np.array([0.0, 0.0, -9.81]), (n, 1))
    m = np.tile(C.T @ np.array([19e-6, 0.0, 45e-6]), (n, 1))
    a = attitude(t, np.zeros((n, 3)), f, m)
    assert apart(np.tile(C, (len(a.time), 1, 1)), dcm_from_quat(a.q)) < radians(0.01)
