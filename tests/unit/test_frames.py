"""Rotations and axes: hand-made cases, small angles, angles near pi, gimbal lock, and the house signs."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from schuler.ground import frames as fr
from schuler.ground.errors import InputError

DEG = math.pi / 180
G = 9.8


def same_rotation(q, p, atol=2e-15):
    assert_allclose(fr.quat_canonical(q), fr.quat_canonical(p), atol=atol)


def test_heading_east_points_the_nose_east():
    assert_allclose(fr.dcm_from_euler(0, 0, 90 * DEG) @ [1, 0, 0], [0, 1, 0], atol=1e-16)


def test_pitch_up_raises_the_nose_and_roll_right_lowers_the_right_side():
    assert_allclose(fr.dcm_from_euler(0, 30 * DEG, 0) @ [1, 0, 0], [math.cos(30 * DEG), 0, -0.5], atol=1e-15)
    assert_allclose(fr.dcm_from_euler(30 * DEG, 0, 0) @ [0, 1, 0], [0, math.cos(30 * DEG), 0.5], atol=1e-15)


def test_specific_force_at_rest():
    f_n = np.array([0, 0, -G])
    assert_allclose(fr.dcm_from_euler(0, 0, 1.0).T @ f_n, [0, 0, -G], atol=1e-15)
    # nose up by 10 deg: forward feels +g sin; right side down by 10 deg: right feels -g sin
    assert (fr.dcm_from_euler(0, 10 * DEG, 0).T @ f_n)[0] == pytest.approx(G * math.sin(10 * DEG))
    assert (fr.dcm_from_euler(10 * DEG, 0, 0).T @ f_n)[1] == pytest.approx(-G * math.sin(10 * DEG))


def test_dcm_is_the_transpose_of_the_papers():
    r, p, h = 0.3, -0.4, 2.1
    c, s = math.cos, math.sin
    C_bn = [
        [c(p) * c(h), c(p) * s(h), -s(p)],
        [-c(r) * s(h) + s(r) * s(p) * c(h), c(r) * c(h) + s(r) * s(p) * s(h), s(r) * c(p)],
        [s(r) * s(h) + c(r) * s(p) * c(h), -s(r) * c(h) + c(r) * s(p) * s(h), c(r) * c(p)],
    ]
    assert_allclose(fr.dcm_from_euler(r, p, h), np.transpose(C_bn), atol=1e-16)


def test_euler_ranges_and_round_trip():
    for angles in [(0.1, -0.2, 3.0), (-3.0, 1.5, 6.0), (math.pi, 0.0, 0.0), (0, 0, 0), (1e-12, -1e-12, 1e-12)]:
        assert_allclose(fr.euler_from_dcm(fr.dcm_from_euler(*angles)), angles, atol=1e-14, rtol=1e-12)
        assert_allclose(fr.euler_from_quat(fr.quat_from_euler(*angles)), angles, atol=1e-14, rtol=1e-12)
    assert fr.euler_from_dcm(fr.dcm_from_euler(0, 0, -0.1))[2] == pytest.approx(2 * math.pi - 0.1)


@pytest.mark.parametrize("pitch", [90 * DEG, -90 * DEG, 90 * DEG - 1e-9, -90 * DEG + 1e-13])
def test_gimbal_lock_gives_back_the_matrix(pitch):
    for roll, heading in [(0.0, 0.0), (0.7, 2.0), (-2.5, 5.5)]:
        C = fr.dcm_from_euler(roll, pitch, heading)
        found = fr.euler_from_dcm(C)
        assert_allclose(fr.dcm_from_euler(*found), C, atol=1e-15)
        assert found[1] == pytest.approx(pitch, abs=1e-15)


def test_quaternion_rotates_as_its_matrix():
    rng = np.random.default_rng(0)
    q = fr.quat_normalise(rng.normal(size=(20, 4)))
    v = rng.normal(size=(20, 3))
    assert_allclose(fr.quat_rotate(q, v), np.einsum("nij,nj->ni", fr.dcm_from_quat(q), v), atol=3e-15)
    assert_allclose(fr.quat_rotate(q, v), fr.quat_rotate(-q, v), atol=1e-16)
    assert_allclose(fr.quat_rotate(q[0], v).shape, (20, 3))


def test_quaternion_product_is_the_matrix_product():
    rng = np.random.default_rng(1)
    a, b = fr.quat_normalise(rng.normal(size=(2, 30, 4)))
    assert_allclose(fr.dcm_from_quat(fr.quat_multiply(a, b)), fr.dcm_from_quat(a) @ fr.dcm_from_quat(b), atol=2e-15)
    same_rotation(fr.quat_multiply(a, fr.quat_conjugate(a)), np.broadcast_to([1.0, 0, 0, 0], (30, 4)))
    # Hamilton's i j = k
    assert_array_equal(fr.quat_multiply([0, 1, 0, 0], [0, 0, 1, 0]), [0, 0, 0, 1])


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-170, 1e-150, 1e-20, 1e-9, 1e-8, 1e-4, 0.1, 1.0, 3.0])
def test_rotation_vectors_keep_their_relative_accuracy(size):
    v = size * np.array([0.48, -0.6, 0.64])
    assert_allclose(fr.rotvec_from_quat(fr.quat_from_rotvec(v)), v, rtol=1e-15 if size < 1 else 1e-14, atol=0)
    assert_allclose(fr.rotvec_from_dcm(fr.dcm_from_rotvec(v)), v, rtol=1e-14, atol=1e-323)


@pytest.mark.parametrize("short", [1e-1, 1e-4, 1e-7, 1e-10, 1e-14, 0.0])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (-0.48, 0.6, 0.64), (1e-5, -1, 0)])
def test_angles_near_pi(short, axis):
    u = np.array(axis, dtype=float) / np.linalg.norm(axis)
    angle = math.pi - short
    found = fr.rotvec_from_dcm(fr.dcm_from_rotvec(angle * u))
    assert np.linalg.norm(found) == pytest.approx(angle, abs=1e-14)
    # At pi itself u and -u are one rotation.
    assert min(np.linalg.norm(found - angle * u), np.linalg.norm(found + angle * u) + short) < 1e-13


def test_angles_beyond_pi_come_back_the_short_way():
    assert_allclose(fr.rotvec_from_quat(fr.quat_from_rotvec([0, 0, 1.5 * math.pi])), [0, 0, -0.5 * math.pi], atol=1e-15)


def test_rotation_vector_is_the_exponential():
    v = np.array([0.3, -0.2, 0.5])
    K, term, series = fr.skew(v), np.eye(3), np.eye(3)
    for k in range(1, 25):
        term = term @ K / k
        series = series + term
    assert_allclose(fr.dcm_from_rotvec(v), series, atol=1e-15)


def test_house_sign_of_the_attitude_error():
    """C_hat = (I - [phi x]) C: a computed heading too large by d is phi_down = -d."""
    d = 1e-6
    C, C_hat = fr.dcm_from_euler(0.2, 0.1, 1.0), fr.dcm_from_euler(0.2, 0.1, 1.0 + d)
    P = np.eye(3) - C_hat @ C.T
    assert_allclose([P[2, 1], P[0, 2], P[1, 0]], [0, 0, -d], atol=2e-12)


def test_skew():
    a, b = np.array([[1.0, 2, 3], [-4, 5, 0.5]]), np.array([[0.3, -1, 2], [7, 8, 9]])
    assert_allclose(np.einsum("nij,nj->ni", fr.skew(a), b), np.cross(a, b), atol=1e-14)


def test_orthonormalise_finds_the_nearest_rotation():
    rng = np.random.default_rng(4)
    C = fr.dcm_from_rotvec(rng.normal(size=(10, 3)))
    E = 1e-6 * rng.normal(size=(10, 3, 3))
    fixed = fr.orthonormalise(C + E)
    assert_allclose(fixed @ np.swapaxes(fixed, -1, -2), np.broadcast_to(np.eye(3), fixed.shape), atol=3e-15)
    # First order: only the antisymmetric part of C' E stays.
    skew_part = C @ (np.swapaxes(C, -1, -2) @ E - np.swapaxes(E, -1, -2) @ C) / 2
    assert_allclose(fixed, C + skew_part, atol=2e-11)
    assert np.linalg.det(fr.orthonormalise(np.diag([1.0, 1.0, -0.1]))) == pytest.approx(1.0)


def test_normalise_refuses_what_is_no_rotation():
    with pytest.raises(InputError, match="is no rotation"):
        fr.quat_normalise([[1.0, 0, 0, 0], [0.0, 0, 0, 0]])
    with pytest.raises(InputError, match="is no rotation"):
        fr.quat_normalise([np.nan, 0, 0, 1])


@pytest.mark.parametrize(
    ("call", "value"),
    [
        (fr.quat_rotate, ([1, 0, 0, 0], [1, 2])),
        (fr.quat_multiply, ([1, 0, 0], [1, 0, 0, 0])),
        (fr.skew, (3.0,)),
        (fr.quat_from_dcm, (np.eye(4),)),
    ],
)
def test_wrong_shapes_are_named(call, value):
    with pytest.raises(InputError, match="shape"):
        call(*value)


# --- axes -------------------------------------------------------------------------------------------------------------


def test_named_adapters():
    assert_array_equal(fr.ned_from_enu([1, 2, 3]), [2, 1, -3])  # east 1, north 2, up 3
    assert_array_equal(fr.enu_from_ned([2, 1, -3]), [1, 2, 3])
    assert_array_equal(fr.ned_from_nwu([1, 2, 3]), [1, -2, -3])
    assert_array_equal(fr.nwu_from_ned([1, -2, -3]), [1, 2, 3])
    assert_array_equal(fr.frd_from_flu([1, 2, 3]), [1, -2, -3])
    assert_array_equal(fr.flu_from_frd([1, -2, -3]), [1, 2, 3])
    assert_array_equal(fr.frd_from_rfu([1, 2, 3]), [2, 1, -3])
    assert_array_equal(fr.rfu_from_frd([2, 1, -3]), [1, 2, 3])


@pytest.mark.parametrize(
    ("call", "to", "start"),
    [
        (fr.ned_from_enu, "NED", "ENU"), (fr.enu_from_ned, "ENU", "NED"), (fr.ned_from_nwu, "NED", "NWU"),
        (fr.nwu_from_ned, "NWU", "NED"), (fr.frd_from_flu, "FRD", "FLU"), (fr.flu_from_frd, "FLU", "FRD"),
        (fr.frd_from_rfu, "FRD", "RFU"), (fr.rfu_from_frd, "RFU", "FRD"),
    ],
)  # fmt: skip
def test_adapters_are_the_axes_matrices(call, to, start):
    v = np.array([[1.0, 2.0, 3.0], [-4.0, 5.0, 6.0]])
    C = fr.axes_matrix(to, start)
    assert_array_equal(call(v), v @ C.T)
    assert np.linalg.det(C) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("to", "start", "message"),
    [
        ("NED", "XYZ", "are not known"),
        ("NE", "ENU", "are not known"),
        ("NED", "NEU", "not a right-handed"),
        ("NNE", "NED", "not a right-handed"),
        ("NED", "FRD", "different things"),
    ],
)
def test_axes_that_make_no_sense(to, start, message):
    with pytest.raises(InputError, match=message):
        fr.axes_matrix(to, start)


def test_ros_attitude():
    """REP 103: zero yaw looks east, positive yaw turns counter-clockwise; the same vehicle in both conventions."""
    yaw = 30 * DEG
    q_ros = [math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]
    roll, pitch, heading = fr.euler_from_quat(fr.quat_ned_frd_from_enu_flu(q_ros))
    assert_allclose([roll, pitch, heading], [0, 0, 60 * DEG], atol=1e-15)
    assert fr.heading_from_yaw_enu(yaw) == pytest.approx(60 * DEG)
    assert fr.yaw_enu_from_heading(60 * DEG) == pytest.approx(yaw)
    # a nose pitched up is a negative rotation about left in ROS
    C = fr.dcm_from_euler(0.1, 0.2, 0.3)
    back = fr.dcm_ned_frd_from_enu_flu(fr.enu_flu_from_ned_frd(C))
    assert_allclose(back, C, atol=1e-16)
    nose_enu = fr.enu_flu_from_ned_frd(C) @ [1, 0, 0]
    assert_allclose(fr.ned_from_enu(nose_enu), C @ [1, 0, 0], atol=1e-16)


def test_scalar_last():
    assert_array_equal(fr.quat_from_scalar_last([1, 2, 3, 4]), [4, 1, 2, 3])
    assert_array_equal(fr.quat_to_scalar_last([4, 1, 2, 3]), [1, 2, 3, 4])


def test_angles_wrap():
    assert_allclose(fr.heading_0_360([0.0, 2 * math.pi, -0.5, 7.0]), [0, 0, 2 * math.pi - 0.5, 7 - 2 * math.pi])
    assert fr.heading_0_360(-1e-20) == 0.0  # not 360
    assert fr.wrap_pi(-math.pi) == math.pi
