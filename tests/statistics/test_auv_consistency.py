"""The AUV filter over simulated dives: as good as promised, and its sigmas, innovations and smoother tell the truth.

`make evidence` does the same with more runs. Bounds here have a false-alarm rate of 1e-4.
"""

from math import sqrt

import numpy as np
import pytest
from scipy.stats import chi2

from schuler.aiding.auv import navigate
from schuler.judging.auv_evidence import EXPERIMENTS, ensemble, judged, one_run
from schuler.truth.missions import Waves
from schuler.truth.recording import simulate

RUNS = 24
SEED = 11
ALARM = 1e-4
Z = 3.89
LIMITS = {"dive": 42.0, "second dive": 24.0, "magnetometer and DVL": 7.5}


@pytest.fixture(scope="module", params=list(EXPERIMENTS))
def found(request):
    return request.param, ensemble(EXPERIMENTS[request.param], RUNS, SEED)


def bounds(dof, n):
    return chi2.ppf(ALARM / 2.0, dof * n) / (dof * n), chi2.ppf(1.0 - ALARM / 2.0, dof * n) / (dof * n)


@pytest.mark.slow
def test_as_good_as_promised(found):
    name, s = found
    if name in LIMITS:
        assert s["end_m"]["mean"] < LIMITS[name] + Z * s["end_m"]["se"]
        assert s["end_m"]["mean"] < 1.25 * LIMITS[name]
    else:
        assert s["smoother_rms_m"]["mean"] < 4.5 + Z * s["smoother_rms_m"]["se"]
        assert s["smoother_rms_m"]["mean"] < 0.3 * s["end_m"]["mean"]


@pytest.mark.slow
@pytest.mark.parametrize("what,dof", [("nees_half", 2), ("heading_ratio", 1), ("smoother_nees_half", 2)])
def test_errors_are_as_large_as_their_sigmas(found, what, dof):
    low, high = bounds(dof, RUNS)
    assert low < found[1][what]["mean"] < high


@pytest.mark.slow
def test_innovations_are_as_large_as_theirs(found):
    """Within 30 % at least: of thousands of innovations the mean is known to 1 %, and the models are not that good."""
    name, s = found
    assert set(s["nis"]) >= {"gnss_position", "gnss_velocity", "speed", "depth", "levelling"}
    assert ("dvl" in s["nis"]) == ("magnetometer" in s["nis"]) == (name == "magnetometer and DVL")
    for kind, nis in s["nis"].items():
        assert 0.7 < nis["mean"] < 1.3, kind
        assert nis["left_out"] < 0.01 * nis["n"] + 3, kind


@pytest.mark.slow
def test_nothing_is_learnt_of_what_cannot_be_seen():
    """One heading, no waves, no compass: nothing tells heading and cross current apart, so the prior stays."""
    dive = EXPERIMENTS["dive"]
    mission = dive.mission.with_changes(waves=Waves.none(), dives=0, surface=100.0)
    sigma = []
    for run in range(8):
        recording = simulate(mission, dive.suite, seed=SEED, run=run)
        sigma.append(navigate(recording.tables, dive.settings).states["current_north"].std[-1])  # it heads east
    assert 0.225 < np.mean(sigma) < 0.26


def test_a_run_is_repeatable_and_runs_differ():
    dive = EXPERIMENTS["dive"]
    again = [one_run(dive, 5, run) for run in (1, 1, 2)]
    assert again[0] == again[1] != again[2]
    assert again[0].end_m > 0.0 and again[0].heading_sigma > 0.0
    few = ensemble(dive, 2, 5)
    assert few["end_m"]["max"] >= again[0].end_m and few["runs"] == 2


def test_means_are_judged_by_chi_square():
    rng = np.random.default_rng(3)
    inside = [judged(rng.chisquare(2, 50) / 2.0, 2)["inside"] for _ in range(400)]
    assert np.mean(inside) == pytest.approx(0.99, abs=Z * sqrt(0.01 / 400))
    assert not judged(1.5 * rng.chisquare(2, 200) / 2.0, 2)["inside"]
    assert not judged(0.6 * rng.chisquare(2, 200) / 2.0, 2)["inside"]
