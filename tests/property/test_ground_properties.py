"""Laws of the ground layer that hold for any input."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from schuler.ground import earth, times, units
from schuler.ground import frames as fr

laws = settings(max_examples=80, deadline=None, derandomize=True)

PI = math.pi
latitude = st.floats(-PI / 2, PI / 2)
longitude = st.floats(-PI, PI)
height = st.floats(-1e4, 1e7)
angle = st.floats(-7.0, 7.0)
component = st.floats(-1.0, 1.0)
vector = st.tuples(component, component, component).map(np.array)
rotvec = st.tuples(vector, st.floats(0.0, 3.0)).map(lambda p: p[0] * p[1])
quaternion = (
    st.tuples(component, component, component, component)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 1e-3)
    .map(fr.quat_normalise)
)
unit = st.sampled_from(sorted(units.UNITS))


def assert_same_rotation(q, p, atol=1e-14):
    assert min(np.max(np.abs(q - p)), np.max(np.abs(q + p))) < atol


# --- Earth ------------------------------------------------------------------------------------------------------------


@laws
@given(latitude, longitude, height)
def test_ecef_round_trip_in_nanometres(lat, lon, h):
    r = earth.ecef_from_geodetic(lat, lon, h)
    again = earth.ecef_from_geodetic(*earth.geodetic_from_ecef(r))
    assert np.linalg.norm(again - r) < 9e-9


@laws
@given(st.tuples(*[st.floats(-2e7, 2e7)] * 3))
def test_any_ecef_point_has_finite_coordinates_in_range(xyz):
    lat, lon, h = earth.geodetic_from_ecef(xyz)
    assert abs(lat) <= PI / 2
    assert -PI < lon <= PI
    assert math.isfinite(h)
    if np.linalg.norm(xyz) > 1e5:
        assert_allclose(earth.ecef_from_geodetic(lat, lon, h), xyz, atol=2e-8)


@laws
@given(latitude, longitude, height)
def test_height_is_the_distance_along_the_vertical(lat, lon, h):
    on_ground = earth.ecef_from_geodetic(lat, lon, 0.0)
    up = -earth.C_en(lat, lon)[:, 2]
    assert_allclose(earth.ecef_from_geodetic(lat, lon, h), on_ground + h * up, atol=1e-8)


@laws
@given(latitude, st.floats(-1e4, 1e5))
def test_gravity_is_even_in_latitude_and_falls_with_height(lat, h):
    assert earth.gravity(lat, h) == earth.gravity(-lat, h)
    assert earth.gravity(lat, h + 100.0) < earth.gravity(lat, h)
    assert 9.78 <= earth.gravity(lat, 0.0) <= 9.8322


@laws
@given(st.floats(-1.4, 1.4), longitude, st.floats(-1e3, 1e4), vector)
def test_displace_and_displacement(lat, lon, h, d):
    there = earth.displace(lat, lon, h, 1e4 * d)
    assert_allclose(earth.displacement_n(*there, lat, lon, h), 1e4 * d, atol=1e-8)


@laws
@given(latitude, longitude, vector)
def test_local_frame_round_trip(lat, lon, d):
    frame = earth.LocalFrame(lat, lon, 50.0)
    assert_allclose(np.stack(frame.ned(*frame.geodetic(*(1e5 * d)))), 1e5 * d, atol=1e-8)


@laws
@given(st.floats(-1e6, 1e6))
def test_wrapping_changes_whole_turns_only(a):
    assert -PI < fr.wrap_pi(a) <= PI
    assert 0.0 <= fr.heading_0_360(a) < 2 * PI
    for wrapped in (float(fr.wrap_pi(a)), float(fr.heading_0_360(a))):
        turns = (a - wrapped) / (2 * PI)
        assert abs(turns - round(turns)) < 1e-9


# --- rotations --------------------------------------------------------------------------------------------------------


@laws
@given(quaternion)
def test_matrix_of_a_quaternion_is_a_rotation_and_comes_back(q):
    C = fr.dcm_from_quat(q)
    assert_allclose(C @ C.T, np.eye(3), atol=3e-15)
    assert abs(np.linalg.det(C) - 1.0) < 3e-15
    assert_allclose(fr.dcm_from_quat(-q), C, atol=0)
    back = fr.quat_from_dcm(C)
    assert back[0] >= 0.0
    assert_same_rotation(back, q)


@laws
@given(quaternion, quaternion, quaternion, vector)
def test_group_laws(p, q, r, v):
    assert_allclose(
        fr.quat_multiply(fr.quat_multiply(p, q), r), fr.quat_multiply(p, fr.quat_multiply(q, r)), atol=2e-15
    )
    assert_allclose(fr.quat_multiply(q, fr.quat_conjugate(q)), [1, 0, 0, 0], atol=1e-15)
    assert_allclose(fr.quat_rotate(fr.quat_multiply(p, q), v), fr.quat_rotate(p, fr.quat_rotate(q, v)), atol=5e-15)
    assert abs(np.linalg.norm(fr.quat_rotate(q, v)) - np.linalg.norm(v)) < 3e-15


@laws
@given(rotvec)
def test_rotation_vector_round_trips(v):
    size = np.linalg.norm(v)
    for back in (fr.rotvec_from_quat(fr.quat_from_rotvec(v)), fr.rotvec_from_dcm(fr.dcm_from_rotvec(v))):
        assert np.linalg.norm(back) <= PI + 1e-15
        if size < PI - 1e-9:
            assert np.linalg.norm(back - v) <= 2e-14 * size + 1e-300
    assert_allclose(fr.dcm_from_rotvec(v) @ v, v, atol=2e-15 * max(size, 1.0))


@laws
@given(angle, st.floats(-PI / 2, PI / 2), angle)
def test_euler_angles_give_back_their_matrix(roll, pitch, heading):
    C = fr.dcm_from_euler(roll, pitch, heading)
    r, p, h = fr.euler_from_dcm(C)
    assert -PI <= r <= PI and abs(p) <= PI / 2 and 0.0 <= h < 2 * PI
    assert_allclose(fr.dcm_from_euler(r, p, h), C, atol=2e-15)
    assert_allclose(fr.dcm_from_quat(fr.quat_from_euler(roll, pitch, heading)), C, atol=2e-15)
    if abs(pitch) < 1.5:
        assert abs(p - pitch) < 1e-14 * 20
        assert abs(fr.wrap_pi(r - roll)) < 1e-13
        assert abs(fr.wrap_pi(h - heading)) < 1e-13


@laws
@given(vector)
def test_axes_adapters_are_involutions_and_keep_lengths(v):
    for there, back in (
        (fr.ned_from_enu, fr.enu_from_ned),
        (fr.ned_from_nwu, fr.nwu_from_ned),
        (fr.frd_from_flu, fr.flu_from_frd),
        (fr.frd_from_rfu, fr.rfu_from_frd),
    ):
        assert_array_equal(back(there(v)), v)
        assert_array_equal(there(there(v)), v)


@laws
@given(st.lists(quaternion, min_size=1, max_size=6), vector)
def test_batch_is_the_loop(qs, v):
    q = np.stack(qs)
    for call in (
        fr.dcm_from_quat,
        fr.rotvec_from_quat,
        fr.quat_canonical,
        lambda x: fr.quat_from_dcm(fr.dcm_from_quat(x)),
    ):
        assert_array_equal(call(q), np.stack([call(one) for one in qs]))
    assert_array_equal(fr.quat_rotate(q, v), np.stack([fr.quat_rotate(one, v) for one in qs]))


# --- units and times --------------------------------------------------------------------------------------------------


@laws
@given(st.floats(-1e9, 1e9), unit)
def test_units_round_trip(value, name):
    assert_allclose(units.from_si(units.to_si(value, name), name), value, rtol=1e-14, atol=1e-12)


@laws
@given(st.integers(int(times.GPS_EPOCH_UNIX), int(times.LEAP_EXPIRY)), st.integers(-500, 500))
def test_unix_gps_week_round_trip_with_rollover(unix, weeks_off):
    assert times.unix_from_gps(times.gps_from_unix(unix)) == unix
    week, tow = times.week_from_unix(unix)
    near = max(unix + weeks_off * times.WEEK, times.GPS_EPOCH_UNIX)
    assert times.unix_from_week(int(week) % 1024, tow, near_unix=near) == unix


@laws
@given(st.integers(0, 4_000_000_000), st.integers(0, 999))
def test_iso_round_trip(seconds, milliseconds):
    t = seconds + milliseconds / 1000
    assert abs(times.unix_from_iso(times.iso_from_unix(t)) - t) < 1e-6


@laws
@given(st.integers(3, 200), st.floats(0.1, 1000.0), st.integers(1, 50), st.data())
def test_a_clock_with_one_gap(n, rate, missing, data):
    at = data.draw(st.integers(1, n - 1))
    t = np.arange(n) / rate
    t[at:] += missing / rate
    report = times.describe_clock(t)
    if n > 3:
        assert abs(report.rate_hz / rate - 1) < 1e-9
        assert len(report.gaps) == 1 and report.missing == missing
        assert report.gaps[0][0] == t[at - 1]
    assert report.increasing
