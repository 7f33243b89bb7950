"""The example studies on real gliders: as good as claimed, honest, and not moved without somebody saying so."""

import numpy as np
import pytest
from replay import EXAMPLES, golden_of, moved, read, run_example

pytestmark = pytest.mark.data


@pytest.fixture(scope="module", params=["seaglider", "seaexplorer"])
def replayed(request, data_folder, tmp_path_factory):
    folder, figures = EXAMPLES[request.param]
    out = tmp_path_factory.mktemp(request.param) / "tables"
    return request.param, figures, run_example(request.param, data_folder / folder, out)


def test_as_good_as_claimed(replayed):
    _, figures, result = replayed
    missed = [f for f in figures(result.summary) if not f.holds]
    assert missed == []


def test_nothing_moved(replayed):
    """Beyond 2 % of a sigma: then  python tests/golden/replay.py --update  and commit with the reason."""
    name, _, result = replayed
    changes = moved(read(name), golden_of(result.navigation))
    assert len(changes) > 50
    assert {key: c for key, c in changes.items() if abs(c[0]) > 0.02 or abs(c[1] - 1.0) > 0.02} == {}


def test_what_a_dive_taught_is_used_in_the_next(replayed):
    """Scale and current are known better at the end than at the start, and the scale is what it is known to be."""
    name, _, result = replayed
    states = result.navigation.states
    for state in ("path_scale", "current_north"):
        assert states[state].std[-1] < states[state].std[0]
    if name == "seaglider":
        # the flight model's horizontal speed is about 40 % low in these files; depth rate and pitch say so
        scale = states["speed_scale"]
        assert scale.value[-1] < -0.1 and abs(scale.value[-1]) > 4.0 * scale.std[-1]


def test_the_smoothed_track_meets_the_fixes(replayed):
    """Between the fixes the smoother knows more than the filter, and nowhere less."""
    _, _, result = replayed
    filtered, smoothed = result.navigation.filter, result.navigation.smoother
    a, b = (np.sqrt(s.cov_pos[:, 0, 0] + s.cov_pos[:, 1, 1]) for s in (filtered, smoothed))
    assert (b <= a * (1.0 + 1e-6)).mean() > 0.99
    assert np.median(b) < 0.7 * np.median(a[a > 20.0])
    gnss = result.tables["gnss"]
    lat = np.interp(gnss.time, smoothed.time, smoothed.lat)
    lon = np.interp(gnss.time, smoothed.time, smoothed.lon)
    miss = np.hypot((lat - gnss["lat"]) * 6.37e6, (lon - gnss["lon"]) * 6.37e6 * np.cos(lat))
    inside = (gnss.time > smoothed.time[0]) & (gnss.time < smoothed.time[-1])
    assert np.median(miss[inside]) < 30.0


def test_no_numbers_are_lost(replayed):
    for track in (replayed[2].navigation.filter, replayed[2].navigation.smoother):
        for values in (track.lat, track.lon, track.height, track.v_n, track.rpy, track.cov_pos, track.cov_vel):
            assert np.isfinite(values).all()
        assert (np.linalg.eigvalsh(track.cov_pos) > -1e-9).all()
