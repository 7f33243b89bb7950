"""The planar filter over simulated runs: errors and innovations as large as it says, filter and smoother, 99 %."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from schuler.aiding.planar import navigate

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from planar_runs import PLANE, errors, simulate  # noqa: E402

RUNS = 150


def bounds(dof):
    return chi2.ppf(0.005, dof) / dof, chi2.ppf(0.995, dof) / dof


@pytest.fixture(scope="module", params=["ranges", "fixes"])
def runs(request):
    with_ranges = request.param == "ranges"
    found = []
    for seed in range(RUNS):
        run = simulate(1000 + seed, fixes=not with_ranges, ranges=with_ranges)
        found.append((run, navigate(run.tables, run.settings, PLANE)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "who,where", [("filter", 0.1), ("filter", 0.6), ("filter", 1.0), ("smoother", 0.1), ("smoother", 0.6)]
)
def test_errors_are_as_large_as_their_sigmas(runs, who, where):
    """One moment a run: position (two degrees of freedom) and heading."""
    place, turned = 0.0, 0.0
    for run, nav in runs:
        solution = getattr(nav, who)
        i = min(int(where * len(solution)), len(solution) - 1)
        e, heading, _ = errors(run, solution)
        place += e[i] @ np.linalg.solve(solution.cov_pos[i, :2, :2], e[i])
        turned += heading[i] ** 2 / solution.cov_rpy[i, 2, 2]
    for value, dof in ((place, 2 * RUNS), (turned, RUNS)):
        low, high = bounds(dof)
        assert low < value / dof < high


@pytest.mark.slow
def test_innovations_are_as_large_as_theirs(runs):
    for kind in {k for _, nav in runs for k in nav.innovations}:
        nis = np.concatenate([nav.innovations[kind].nis for _, nav in runs])
        dof = runs[0][1].innovations[kind].value.shape[1]
        low, high = bounds(dof * len(nis))
        assert low < nis.mean() / dof < high, kind


@pytest.mark.slow
def test_what_is_learnt_is_within_its_sigma(runs):
    for name in ("gyro_bias_z", "speed_scale", "range_scale"):
        ratio = [
            (nav.states[name].value[-1] - run.truth[name]) / nav.states[name].std[-1]
            for run, nav in runs
            if name in nav.states
        ]
        if ratio:
            low, high = bounds(len(ratio))
            assert low < float(np.mean(np.square(ratio))) < high, name


@pytest.mark.slow
def test_the_smoother_is_better(runs):
    rms = {
        who: np.sqrt(np.mean([np.mean(np.sum(errors(run, getattr(nav, who))[0] ** 2, axis=1)) for run, nav in runs]))
        for who in ("filter", "smoother")
    }
    assert rms["smoother"] < 0.9 * rms["filter"]


@pytest.mark.slow
def test_a_start_that_is_found_is_honest_too():
    """Nothing about the start is told: errors a minute later, position alone, 99 %."""
    total, n = 0.0, 0
    for seed in range(30):
        run = simulate(100 + seed, fixes=seed % 2 == 0, ranges=seed % 2 == 1, start=False)
        nav = navigate(run.tables, run.settings, PLANE)
        e, _, _ = errors(run, nav.filter)
        i = min(int(np.searchsorted(nav.filter.time, nav.filter.time[0] + 60.0)), len(e) - 1)
        total += e[i] @ np.linalg.solve(nav.filter.cov_pos[i, :2, :2], e[i])
        n += 2
    low, high = bounds(n)
    assert low < total / n < high
