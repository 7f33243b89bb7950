"""Pose from known points: three points in closed form, least squares, covariance, wrong identities, weak geometry."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from schuler.aiding import optics
from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84, C_en
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, dcm_from_rotvec

CAMERA = Camera.of(8889.0, position_frd_m=(0.3, -0.1, 0.2))
PLAIN = Camera.of(8889.0)
LEVEL = np.eye(3)
C0 = np.asarray(dcm_from_euler(0.05, -0.03, 0.6))
CORNERS = np.array([[x, y, 1000.0] for x in (200.0, -200.0) for y in (150.0, -150.0)])
MILLI = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])


def field(n, seed=1):
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-250, 250, n), rng.uniform(-200, 200, n), 1000 + rng.uniform(-20, 20, n)])
    uv, seen = CAMERA.project(points, np.zeros(3), C0)
    assert seen.all()
    return points, uv + rng.normal(size=uv.shape), rng


def test_three_points_return_the_truth_among_all_solutions():
    """1500 random scenes: the true pose is always there, to rounding, and every pose given fits its pixels."""
    camera = Camera.of(1000.0)
    rng = np.random.default_rng(1)
    counts = np.zeros(5, dtype=int)
    for _ in range(1500):
        points = rng.uniform(-1, 1, (3, 3)) + [0.0, 0.0, rng.uniform(1.5, 6.0)]
        C, r = dcm_from_rotvec(0.3 * rng.normal(size=3)), rng.uniform(-0.3, 0.3, 3)
        uv, seen = camera.project(points, r, C)
        if not seen.all():
            continue
        ways = optics.p3p(points, uv, camera)
        counts[len(ways)] += 1
        assert min(np.linalg.norm(a - r) + np.linalg.norm(b - C) for a, b in ways) < 1e-6
        for a, b in ways:
            np.testing.assert_allclose(b @ b.T, LEVEL, atol=1e-12)
            np.testing.assert_allclose(camera.project(points, a, b)[0], uv, rtol=1e-7, atol=1e-6)
    assert counts[0] == 0 and counts[4] > 0 and counts[2] > counts[1]


def test_four_poses_of_a_symmetric_scene():
    """An equilateral triangle seen from its axis: the upright pose and three tilted ones (Fischler and Bolles 1981)."""
    points = np.array([[math.cos(t), math.sin(t), 1.6] for t in (0.0, 2 * math.pi / 3, 4 * math.pi / 3)])
    uv, _ = PLAIN.project(points, np.zeros(3), LEVEL)
    ways = optics.p3p(points, uv, PLAIN)
    assert len(ways) == 4
    apart = [np.linalg.norm(a[0] - b[0]) for i, a in enumerate(ways) for b in ways[:i]]
    assert min(apart) > 0.1
    with pytest.raises(InputError, match="three points leave 4 poses"):
        optics.pose(points, uv, PLAIN)
    chosen = optics.pose(points, uv, PLAIN, start=(np.array([0.02, 0.0, 0.03]), LEVEL))
    np.testing.assert_allclose(chosen.r_n, 0.0, atol=1e-6)
    assert math.isnan(chosen.rms)


# Sigmas at 1000 m, f = 8889 px, 1 px: m north, east, down; mrad about north, east, down
TRIANGLE = np.array([[200.0, 0.0, 1000.0], [-100.0, 170.0, 1000.0], [-100.0, -170.0, 1000.0]])
NINE = np.array([[x, y, 1000.0] for x in (200.0, 0.0, -200.0) for y in (150.0, 0.0, -150.0)])


@pytest.mark.parametrize(
    ("points", "known"),
    [
        (TRIANGLE, (3.34, 3.40, 0.33, 3.34, 3.28, 0.33)),
        (CORNERS, (1.95, 1.92, 0.225, 1.87, 1.87, 0.225)),
        (NINE, (1.40, 1.68, 0.18, 1.66, 1.36, 0.18)),
    ],
)
def test_sigmas_at_a_thousand_metres(points, known):
    got = np.sqrt(np.diag(optics.covariance(points, np.zeros(3), LEVEL, PLAIN))) * MILLI
    np.testing.assert_allclose(got, known, atol=0.006)
    P = optics.covariance(points, np.zeros(3), LEVEL, PLAIN)
    assert P[0, 4] / math.sqrt(P[0, 0] * P[4, 4]) > 0.97  # north and pitch cannot be told apart


def test_covariance_is_that_of_a_sample():
    """400 noisy pictures of nine points: the spread of the poses is the covariance claimed."""
    rng = np.random.default_rng(5)
    uv, _ = CAMERA.project(NINE, np.zeros(3), C0)
    errors, claimed, rms = [], None, []
    for _ in range(400):
        p = optics.pose(NINE, uv + rng.normal(size=uv.shape), CAMERA, robust=False, start=(np.zeros(3), C0))
        phi = 0.5 * (LEVEL - p.C_nb @ C0.T)
        errors.append([*p.r_n, *(phi - phi.T)[[2, 0, 1], [1, 2, 0]]])
        claimed, rms = p.covariance, [*rms, p.rms**2]
    ratio = np.linalg.inv(claimed) @ np.cov(np.array(errors).T)
    # eigenvalues of a sample covariance of 400 in 6 dimensions: 1 +- 0.25
    assert np.abs(np.linalg.eigvals(ratio) - 1.0).max() < 0.4
    assert np.mean(rms) == pytest.approx(1.0, abs=0.05)
    assert np.abs(np.mean(errors, axis=0) / np.sqrt(np.diag(claimed))).max() < 0.2


@pytest.mark.parametrize("share", [0.05, 0.4])
def test_wrong_identities_are_found_and_left_out(share):
    points, uv, rng = field(100)
    wrong = rng.choice(100, int(100 * share), replace=False)
    mixed = uv.copy()
    mixed[wrong] = uv[np.roll(wrong, 1)]
    for start in (None, (np.array([30.0, -40.0, 20.0]), dcm_from_rotvec([0.02, 0.02, 0.1]) @ C0)):
        p = optics.pose(points, mixed, CAMERA, start=start)
        assert not p.used[wrong].any()
        assert p.used.sum() >= 97 - len(wrong)
        assert np.abs(p.r_n / p.std[:3]).max() < 4.0
        assert any("left out" in note for note in p.notes)
    # the same by plain least squares is off by far more than its sigma
    plain = optics.pose(points, mixed, CAMERA, start=(np.zeros(3), C0), robust=False)
    assert np.abs(plain.r_n / plain.std[:3]).max() > 6.0


def test_the_same_picture_gives_the_same_pose():
    points, uv, _ = field(30)
    a, b = (optics.pose(points, uv, CAMERA) for _ in range(2))
    assert np.array_equal(a.r_n, b.r_n) and np.array_equal(a.C_nb, b.C_nb)


def test_too_few_points_are_refused():
    points, uv, _ = field(5)
    for n, match in ((0, "0 sightings cannot"), (1, "1 sighting cannot"), (2, "2 sightings cannot give a pose")):
        with pytest.raises(InputError, match=match):
            optics.pose(points[:n].reshape(n, 3), uv[:n].reshape(n, 2), CAMERA)


def test_two_points_leave_two_directions_unseen():
    """Rank 4 of 6: no pose."""
    seen = optics.unseen(CORNERS[:2], np.zeros(3), LEVEL, PLAIN)
    assert seen.shape == (2, 6)
    assert optics.unseen(CORNERS[:3], np.zeros(3), LEVEL, PLAIN).shape == (0, 6)
    assert not np.isfinite(optics.covariance(CORNERS[:2], np.zeros(3), LEVEL, PLAIN)).any()


def test_points_on_a_line_are_refused():
    points = np.array([[x, 0.5 * x, 1000.0] for x in (-200.0, -50.0, 10.0, 180.0)])
    uv, _ = PLAIN.project(points, np.zeros(3), LEVEL)
    with pytest.raises(InputError, match="lie on a line"):
        optics.pose(points, uv, PLAIN)
    assert optics.unseen(points, np.zeros(3), LEVEL, PLAIN).shape == (1, 6)


def test_coplanar_points_are_no_special_case():
    uv, _ = CAMERA.project(CORNERS, np.zeros(3), C0)
    p = optics.pose(CORNERS, uv, CAMERA)
    np.testing.assert_allclose(p.r_n, 0.0, atol=1e-5)
    assert p.critical == ""


def relief(heights):
    return CORNERS + np.column_stack([np.zeros(4), np.zeros(4), heights])


def test_a_saddle_is_near_critical_and_a_slope_is_not():
    """Corners at +-30 m of relief: the saddle loses 20 m and more and says so, the tilted plane has 1.5 m."""
    saddle = relief([30.0, -30.0, -30.0, 30.0])
    slope = relief([30.0, -30.0, 30.0, -30.0])
    for points, critical in ((saddle, True), (slope, False)):
        uv, _ = PLAIN.project(points, np.zeros(3), LEVEL)
        p = optics.pose(points, uv, PLAIN, start=(np.zeros(3), LEVEL))
        assert bool(p.critical) == critical, p.condition
        assert p.std[0] > 20.0 if critical else p.std[0] == pytest.approx(1.5, abs=0.1)
    assert "one point more helps" in optics.pose(saddle, uv * 0 + PLAIN.project(saddle, np.zeros(3), LEVEL)[0], PLAIN,
                                                 start=(np.zeros(3), LEVEL)).critical  # fmt: skip


def test_the_dangerous_cylinder_is_recognised():
    """A camera right above a corner stands on the cylinder through the three corners; in the middle it does not."""
    three = np.array([[250.0, 0.0, 1000.0], [0.0, 250.0, 1000.0], [-250.0, 0.0, 1000.0]])
    assert optics.cylinder(three, [0.0, -250.0, 0.0]) == pytest.approx(0.0, abs=1e-12)
    assert optics.cylinder(three, [0.0, 0.0, 0.0]) == pytest.approx(1.0)
    assert optics.cylinder(three, [0.0, -500.0, 77.0]) == pytest.approx(1.0)
    r = np.array([0.0, -249.0, 0.0])
    uv, _ = PLAIN.project(three, r, LEVEL)
    p = optics.pose(three, uv, PLAIN, start=(r, LEVEL))
    assert "cylinder" in p.critical
    assert p.condition > 3.0 * optics.pose(three, PLAIN.project(three, r * 0, LEVEL)[0], PLAIN,
                                           start=(r * 0, LEVEL)).condition  # fmt: skip


def test_four_points_cannot_name_the_wrong_one():
    uv, _ = CAMERA.project(CORNERS, np.zeros(3), C0)
    assert any("not which one" in note for note in optics.pose(CORNERS, uv, CAMERA).notes)


def test_a_picture_of_something_else_is_refused():
    """Three points of a triangle in one pixel, and twenty identities at random."""
    points, uv, rng = field(20)
    with pytest.raises(InputError, match="no pose"):
        optics.pose(points[:3], uv[[0, 0, 0]], CAMERA)
    apart = points * [1.0, 1.0, 0.0] + [0.0, 0.0, 1000.0]
    shuffled = uv[rng.permutation(20)]
    found = optics.pose(apart, shuffled, CAMERA)
    assert found.used.sum() < 8  # what a search always finds: a few that agree by chance, and it says how few
    assert "do not fit the others" in found.notes[0]


def test_a_fix_on_the_ellipsoid():
    """Landmarks by latitude, longitude and height: place and attitude come back, at high latitude too."""
    rng = np.random.default_rng(3)
    lat, lon, h = 1.2, 3.1415, 1100.0
    C = dcm_from_euler(0.05, -0.03, 4.0)
    la = lat + rng.uniform(-250, 250, 20) / 6.38e6
    lo = lon + rng.uniform(-200, 200, 20) / (6.38e6 * math.cos(lat))
    he = rng.uniform(50, 150, 20)
    points = (WGS84.ecef_from_geodetic(la, lo, he) - WGS84.ecef_from_geodetic(lat, lon, h)) @ C_en(lat, lon)
    uv, seen = CAMERA.project(points, np.zeros(3), C)
    assert seen.all()
    got = optics.fix(la, lo, he, uv, CAMERA)
    assert np.abs(WGS84.displacement_n(got.lat, got.lon, got.height, lat, lon, h)).max() < 1e-5
    np.testing.assert_allclose(got.rpy, [0.05, -0.03, 4.0], atol=1e-8)
    begun = optics.fix(la, lo, he, uv, CAMERA, start=(lat + 1e-6, lon, h + 10.0, 0.04, -0.02, 4.05))
    assert begun.height == pytest.approx(h, abs=1e-5)
    assert got.std[0] == pytest.approx(begun.std[0], rel=1e-6)


def test_a_camera_that_is_none_is_refused():
    with pytest.raises(InputError, match="focal length"):
        Camera.of(-5.0)
    with pytest.raises(InputError, match="not a rotation"):
        Camera(1000.0, C_cb=np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(InputError, match="above 0 px"):
        optics.pose(CORNERS, np.zeros((4, 2)), PLAIN, sigma=0.0)


def test_a_pose_of_a_hundred_points_takes_less_than_a_hundred_microseconds():
    """Compiled, search and least squares together (33 us on the machine this was written on)."""
    from schuler.kernels import pose as kernel

    points, uv, _ = field(100)
    X = points - points.mean(axis=0)
    state, mask, N, sigma = np.zeros(kernel.POSE), np.ones(100, dtype=np.uint8), np.empty((6, 6)), np.ones((100, 2))

    def once(seed):
        kernel.solve(
            X, uv, sigma, *optics._parts(CAMERA), optics.GATE, optics.SEARCH, 1000, seed, False, state, mask, N
        )

    once(1)
    best = math.inf
    for k in range(7):
        start = time.process_time()
        for i in range(50):
            once(50 * k + i)
        best = min(best, (time.process_time() - start) / 50)
    assert best < 100e-6
