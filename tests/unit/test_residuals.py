"""The antenna's arm out of position innovations: found with its sigma, also through a filter that takes it in."""

import numpy as np
import pytest
from test_judging import track

from schuler.aiding.solution import Innovations, Navigation
from schuler.ground.frames import dcm_from_euler
from schuler.ground.tables import Table
from schuler.judging.residuals import lever_correction, lever_words, velocity_arm
from schuler.studies.inputs import Inputs
from schuler.studies.model import load_study
from schuler.studies.remarks import lever_notes

WRONG = np.array([1.2, -0.5, 0.0])


def attitudes(n, rng, turns=1.0):
    """Headings that wander by `turns`, with some roll and pitch."""
    heading = turns * np.cumsum(rng.normal(size=n)) * 0.1
    return dcm_from_euler(0.1 * np.sin(0.3 * np.arange(n)), 0.05 * np.cos(0.2 * np.arange(n)), heading)


def filtered(C, dl, fix, walk, rng, slow=0.0):
    """Innovations of a Kalman filter of position (a random walk) that does not know of dl; with their sigma."""
    x, P = np.zeros(3), fix**2
    y, s = np.zeros((len(C), 3)), np.zeros(len(C))
    true, drift = np.zeros(3), np.zeros(3)
    for i in range(len(C)):
        true = true + walk * rng.normal(size=3)
        drift = 0.98 * drift + slow * rng.normal(size=3)
        P = P + walk**2
        S = P + fix**2
        y[i] = true + C[i] @ dl + drift + fix * rng.normal(size=3) - x
        x, P = x + P / S * y[i], P - P**2 / S
        s[i] = np.sqrt(S)
    return y, np.repeat(s[:, None], 3, axis=1)


def test_without_a_filter_it_is_plain_least_squares():
    rng = np.random.default_rng(1)
    C = attitudes(400, rng)
    y = C @ WRONG + 0.05 * rng.normal(size=(400, 3))
    found = lever_correction(y, C)
    np.testing.assert_allclose(found.correction, WRONG, atol=0.02)
    assert found.sure[:2].all() and found.rms_after < 0.1 < found.rms_before


@pytest.mark.parametrize("slow", [0.0, 0.01])
def test_what_the_filter_took_in_is_put_back_and_the_sigma_is_true(slow):
    """Sixty runs: the errors over their sigmas are of size one (a chi-square of 120 with room for ten blocks)."""
    squares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        C = attitudes(300, rng)
        y, std = filtered(C, WRONG, 0.05, 0.02, rng, slow)
        found = lever_correction(y, C, std, np.full(3, 0.05))
        squares.append(np.sum(((found.correction - WRONG) / found.sigma)[:2] ** 2))
    assert 0.4 < np.mean(squares) / 2.0 < 1.6
    bare = lever_correction(y, C, std)
    assert np.linalg.norm(bare.correction[:2]) < 0.8 * np.linalg.norm(
        WRONG[:2]
    )  # without the filter's weight: too small


def test_a_right_arm_gets_no_words_and_a_wrong_one_says_what_to_type():
    said = 0
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        C = attitudes(300, rng)
        y, std = filtered(C, np.zeros(3), 0.05, 0.02, rng, slow=0.01)
        said += lever_words(lever_correction(y, C, std, np.full(3, 0.05)), (0.0, 0.0, 0.0), 0.05) is not None
    assert said == 0
    y, std = filtered(C, WRONG, 0.05, 0.02, rng)
    words = lever_words(lever_correction(y, C, std, np.full(3, 0.05)), (0.3, 0.0, -0.65), 0.05)
    assert "antenna_frd_m looks wrong by about [1." in words and 'estimate = ["antenna_lever"]' in words
    typed = [float(x) for x in words.split("type antenna_frd_m = [")[1].split("]")[0].split(",")]
    np.testing.assert_allclose(typed[:2], [1.5, -0.5], atol=0.1)


def test_an_arm_within_the_noise_of_the_fixes_is_not_worth_a_word():
    rng = np.random.default_rng(3)
    C = attitudes(2000, rng)
    y = C @ [0.5, 0.0, 0.0] + rng.normal(size=(2000, 3))
    found = lever_correction(y, C)
    assert found.sure[0] and lever_words(found, (0.0, 0.0, 0.0), 1.0) is None


def test_on_one_heading_a_filter_leaves_nothing_to_see():
    rng = np.random.default_rng(4)
    C = attitudes(300, rng, turns=0.0)
    C[:] = C[0]
    y, std = filtered(C, WRONG, 0.05, 0.05, rng)
    found = lever_correction(y[50:], C[50:], std[50:], np.full(3, 0.05))
    assert lever_words(found, (0.0, 0.0, 0.0), 0.05) is None


def test_gaps_outliers_and_too_few_fixes():
    rng = np.random.default_rng(5)
    C = attitudes(400, rng)
    y = C @ WRONG + 0.05 * rng.normal(size=(400, 3))
    y[::7] = np.nan
    y[5::50] += 80.0
    y[:, 2] = np.nan  # heights are not given at all
    np.testing.assert_allclose(lever_correction(y, C).correction[:2], WRONG[:2], atol=0.03)
    assert lever_correction(y[:20], C[:20]) is None
    assert lever_words(None, (0.0, 0.0, 0.0), 1.0) is None


def test_velocities_see_an_arm_while_the_body_turns():
    rng = np.random.default_rng(6)
    C = attitudes(500, rng)
    w = 0.3 * rng.normal(size=(500, 3))
    A = velocity_arm(C, w)
    np.testing.assert_allclose(A[7] @ WRONG, C[7] @ np.cross(w[7], WRONG), atol=1e-12)
    y = A @ WRONG + 0.05 * rng.normal(size=(500, 3))
    found = lever_correction(y, A)
    np.testing.assert_allclose(found.correction, WRONG, atol=0.05)
    assert "looks wrong" in lever_words(found, (0.0, 0.0, 0.0), 0.05)


def test_the_notes_of_a_study_say_it_from_positions_or_velocities(tmp_path):
    """Innovations of a filter whose arm is wrong; the same with a right arm, or with the arm estimated: no note."""
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "s"\nkind = "aided"\n[input]\nimu = "imu.csv"\ngnss = "gnss.csv"\n'
        "[noise]\ngnss_correlated_m = 0.0\n"
    )
    (tmp_path / "imu.csv").write_text("")
    (tmp_path / "gnss.csv").write_text("")
    study = load_study(tmp_path / "s.toml")
    rng = np.random.default_rng(7)
    t = np.arange(0.0, 400.0, 1.0)
    heading = 0.6 * np.cumsum(np.sin(2 * np.pi * t / 60.0))
    s = track(t, np.zeros((len(t), 3)), rpy=np.column_stack([0 * t, 0 * t, heading]))
    C = dcm_from_euler(0 * t, 0 * t, heading)
    turn = np.column_stack([0 * t, 0 * t, np.gradient(heading, t)])
    sigma = {f"std_{c}": np.full(len(t), 0.05) for c in ("north", "east", "down", "v_north", "v_east")}
    gnss = Table("gnss", {"time": t, "lat": s.lat, "lon": s.lon, **sigma})
    for kind, A in (("gnss_position", C), ("gnss_velocity", velocity_arm(C, turn))):
        for dl, said in ((WRONG, True), (0 * WRONG, False)):
            y = (A @ dl + 0.05 * rng.normal(size=(len(t), 3)))[:, :2]
            i = Innovations(kind, ("north", "east"), "m", t + 0.5, y, np.full(y.shape, 0.051), 0 * t, t >= 0)
            nav = Navigation(s, innovations={kind: i})
            assert len(lever_notes(study, Inputs({"gnss": gnss}), nav)) == said
            nav.states["antenna_lever_x"] = None
            assert lever_notes(study, Inputs({"gnss": gnss}), nav) == []
