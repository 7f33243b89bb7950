"""The aided filter over simulated vehicles: errors, innovations and learnt states are as large as it says, filter and
smoother, with and without fixes.

`make evidence` does the same with more runs. Bounds here have a false-alarm rate of 1e-4.
"""

import pytest
from scipy.stats import chi2

from schuler.studies.aided_evidence import DOF, EXPERIMENTS, ensemble, one_run

RUNS = 12
SEED = 300
ALARM = 1e-4
# The simulated car neither slips sideways nor shakes: what its constraints allow for is not there.
EXACT = {"nhc", "zupt", "zaru"}
KINDS = {
    "flight": set(),
    "flight, 26 states": set(),
    "slow receiver": set(),
    "car": {"speed", *EXACT},
    "airspeed": {"speed", "height"},
    "ship": {"dvl", "depth"},
    "beacons": {"ranges", "height"},
}


@pytest.fixture(scope="module", params=list(EXPERIMENTS))
def found(request):
    return request.param, ensemble(EXPERIMENTS[request.param], RUNS, SEED)


def bounds(dof, n):
    return chi2.ppf(ALARM / 2.0, dof * n) / (dof * n), chi2.ppf(1.0 - ALARM / 2.0, dof * n) / (dof * n)


@pytest.mark.slow
def test_errors_are_as_large_as_their_sigmas(found):
    """Means over the track, and at one moment inside the outage; a mean over a track knows more than the bounds say."""
    name, s = found
    for when in ("nees", "end"):
        assert {who.split()[0] for who in s[when]} == {"filter", "smoother"}
        for what, nees in s[when].items():
            low, high = bounds(DOF[what.split()[-1]], RUNS)
            assert nees["mean"] < high, (when, what)
            assert low < nees["mean"] or name == "car", (when, what)  # it slips less than its constraint allows for
    assert 0.99 < s["inside_3_sigma"] <= 1.0
    assert 0.5 < s["end"]["filter horizontal"]["mean"] < 3.0


@pytest.mark.slow
def test_innovations_are_as_large_as_theirs(found):
    """To 8 %: of thousands of innovations the mean is known better than that."""
    name, s = found
    expected = {"gnss_position", "gnss_height"} | KINDS[name]
    if name != "slow receiver":
        expected |= {"gnss_velocity", "gnss_velocity_down"}
    assert set(s["nis"]) == expected
    for kind, nis in s["nis"].items():
        if kind in EXACT:
            assert nis["mean"] < 1.1, kind
        else:
            assert 0.92 < nis["mean"] < 1.08, kind
        assert nis["left_out"] < 1e-4 * nis["n"] + 1, kind


@pytest.mark.slow
def test_what_is_learnt_is_as_near_as_it_says(found):
    name, s = found
    for stem in EXPERIMENTS[name].estimate:
        assert any(state.startswith(stem) for state in s["states"]), stem
    low, high = bounds(1, RUNS)
    for state, ratio in s["states"].items():
        assert ratio["mean"] < high, state
        assert low < ratio["mean"] or name == "car", state


@pytest.mark.slow
def test_the_smoother_halves_an_outage(found):
    name, s = found
    most = 0.8 if name in ("ship", "beacons") else 0.5  # there the other sensors bound the filter already
    assert s["smoother_ratio"] < most


@pytest.mark.slow
def test_aids_are_worth_what_they_cost(found):
    """Order of an outage's end, m rms: a minute by IMU alone is tens of metres, odometer or beacons make it small."""
    name, s = found
    most = {"flight": 60.0, "flight, 26 states": 60.0, "slow receiver": 110.0, "airspeed": 170.0}
    assert s["end_m"]["rms"] < {**most, "car": 5.0, "ship": 3.0, "beacons": 1.0}[name]


def test_a_run_is_repeatable_and_runs_differ():
    short = EXPERIMENTS["beacons"]
    a, b, c = (one_run(short, seed) for seed in (1, 1, 2))
    assert a == b and a != c
    assert a.end_m > 0.0 and a.smoother_rms_m > 0.0
