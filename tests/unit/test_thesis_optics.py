"""The thesis's optics put right: footprint, three beams, symmetry of unknown landmarks; its rows in the ledger."""

from __future__ import annotations

import math

import numpy as np
import pytest

from schuler.aiding import three_beams
from schuler.ground.errors import InputError
from schuler.ground.lidar import Lidar, footprint
from schuler.published import sins_optics
from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, REPRODUCED

X = np.array([3.0, 4.0, 2.0, 0.3, 0.1, -0.2])


@pytest.fixture(scope="module")
def rows():
    return sins_optics.rows()


@pytest.mark.parametrize(("angle", "slope"), [(0.0, 0.0), (0.5, 0.0), (0.5, 0.17), (-0.3, 0.2), (1.0, -0.4)])
def test_the_footprint_is_that_of_two_rays_on_a_slope(angle, slope):
    """The edges of the beam are met with the falling ground; h is the height over the spot of the first edge."""
    g = 0.05
    ends = []
    for a in (angle - 0.5 * g, angle + 0.5 * g):
        d = np.array([math.sin(a), -math.cos(a)])
        normal = np.array([math.sin(slope), math.cos(slope)])  # of ground that falls away to the right
        t = (normal @ np.array([0.0, -100.0])) / (normal @ d)
        ends.append(t * d)
    height = -ends[0][1]
    assert float(footprint(height, g, angle, slope)) == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=1e-12)


def test_a_beam_that_misses_the_ground_is_refused():
    with pytest.raises(InputError, match="does not meet the ground"):
        footprint(100.0, 0.01, 1.4, 0.3)
    with pytest.raises(InputError, match="must be above 0"):
        Lidar(sigma=0.0)


def test_four_poses_satisfy_the_corrected_equations():
    """The example: the true pose, the published second one and two more, all with positive ranges."""
    alpha, beta = three_beams.bearings(X)
    found = three_beams.solutions(alpha, beta)
    assert len(found) == 4
    for s in found:
        assert np.abs(three_beams.equations(s, alpha, beta)).max() < 1e-12
        a, b = three_beams.bearings(s)
        np.testing.assert_allclose([a, b], [alpha, beta], atol=1e-12)  # in front: the same sight, not the opposite one
    assert min(np.abs(s - X).max() for s in found) < 1e-12
    second = [2.991227, 3.974344, 1.704502, -0.01392, 0.155669, 0.129306]
    assert min(np.abs(s - second).max() for s in found) < 1e-6
    assert np.abs(three_beams.printed(X, alpha, beta)).max() > 0.5


def test_unequal_beams():
    B = (0.5, 1.3, 2.0)
    alpha, beta = three_beams.bearings(X, B)
    assert min(np.abs(s - X).max() for s in three_beams.solutions(alpha, beta, B)) < 1e-10


def test_axes_and_angles_are_inverse():
    rng = np.random.default_rng(1)
    for psi, theta, gamma in rng.uniform(-1.5, 1.5, (50, 3)):
        C = three_beams.axes(psi, theta, gamma)
        np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(C) == pytest.approx(1.0)
        np.testing.assert_allclose(three_beams.angles(C), [psi, theta, gamma], atol=1e-12)


def test_six_equations_determine_six_unknowns_three_do_not():
    alpha, beta = three_beams.bearings(X)
    six = three_beams.jacobian(lambda s: three_beams.equations(s, alpha, beta), X)
    three = three_beams.jacobian(lambda s: three_beams.summed(s, alpha, beta), X)
    assert np.linalg.matrix_rank(six) == 6 and np.linalg.matrix_rank(three) == 3


def test_sigma_is_that_of_a_sample():
    """Noisy bearings of 0.01 mrad, 300 draws; the base of 1 m loses a hundredfold from ten to a hundred metres."""
    rng = np.random.default_rng(2)
    alpha, beta = three_beams.bearings(X)
    claimed = three_beams.sigmas(X, 1e-5)
    ends = []
    for _ in range(300):
        a = alpha + 1e-5 * rng.standard_normal(3) / np.cos(beta)
        b = beta + 1e-5 * rng.standard_normal(3)
        ends.append(min(three_beams.solutions(a, b), key=lambda s: np.abs(s - X).max()))
    np.testing.assert_allclose(np.std(ends, axis=0) / claimed, 1.0, atol=0.17)
    near, far = (three_beams.sigmas([d, 0, 0, 0.3, 0.1, -0.2], 1e-4)[0] for d in (10.0, 100.0))
    assert far / near == pytest.approx(100.0, rel=0.02)


def test_turning_everything_about_the_vertical_leaves_the_image():
    """(4.31)'s corrected direction is a symmetry, the printed one is not, and known landmarks break it."""
    assert sins_optics.yaw_is_a_symmetry() < 1e-14
    assert sins_optics.symmetry(1.0) < 1e-8
    assert sins_optics.symmetry(-1.0) > 1.0
    assert sins_optics.symmetry(1.0, known=True) > 0.5


def test_every_recomputed_figure_is_ours(rows):
    wrong = [r for r in rows if r.where.startswith("recomputation") and r.verdict != REPRODUCED]
    assert not wrong, [(r.where, r.quantity, r.published, r.ours) for r in wrong]
    text = " ".join(r.where for r in rows)
    for place in "(4.25) (4.27) (4.28) (4.29) (4.31) (4.32) (4.33) (5.11) (5.15) (5.18) (5.20)".split():
        assert place in text, place
    assert {r.verdict for r in rows if r.where in ("(4.29)", "(4.33)")} == {NOT_REPRODUCIBLE}
    for r in rows:
        assert r.reason
        if r.verdict == CORRECTED and r.published is not None and r.ours is not None:
            assert abs(r.published - r.ours) > 1e-3 * abs(r.ours), r.quantity


def test_the_gradient_is_what_bounds_the_error():
    """1e-4 g for an hour: b t^2/2 without G dr, Schuler's loop with it."""
    b, t = 9.80665e-4, 3600.0
    assert sins_optics.growth(False) == pytest.approx(0.5 * b * t * t, rel=0.02)
    w2 = 9.81 / 6.38e6
    assert sins_optics.growth(True) == pytest.approx(b / w2 * (1.0 - math.cos(math.sqrt(w2) * t)), rel=0.02)
