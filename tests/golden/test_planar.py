"""A robot with ranges to beacons and a car between houses: claims, golden rows, what was learnt."""

import numpy as np
import pytest
from replay import EXAMPLES, golden_of, moved, read, run_example

from schuler.ground.earth import WGS84
from schuler.judging.errors import interpolated

pytestmark = pytest.mark.data


@pytest.fixture(scope="module", params=["plaza1", "smartloc"])
def replayed(request, data_folder, tmp_path_factory):
    folder, figures = EXAMPLES[request.param]
    out = tmp_path_factory.mktemp(request.param) / "tables"
    return request.param, figures, run_example(request.param, data_folder / folder, out)


def test_as_good_as_claimed(replayed):
    _, figures, result = replayed
    assert [f for f in figures(result.summary) if not f.holds] == []


def test_nothing_moved(replayed):
    """Beyond 2 % of a sigma: then  python tests/golden/replay.py --update  and commit with the reason."""
    name, _, result = replayed
    changes = moved(read(name), golden_of(result.navigation))
    assert len(changes) > 50
    assert {key: c for key, c in changes.items() if abs(c[0]) > 0.02 or abs(c[1] - 1.0) > 0.02} == {}


def test_good_is_reached(replayed):
    """The plaza robot's better limits; the car's far under its fixes and under dead reckoning."""
    name, _, result = replayed
    errors = result.summary["errors"]
    filtered, smoothed = (errors[who]["horizontal_m"]["rms"] for who in ("filter", "smoother"))
    if name == "plaza1":
        assert filtered < 0.5 and smoothed < 0.4
        return
    gnss, ref = result.tables["gnss"], result.reference
    lat, lon = (interpolated(ref.time, ref[c], gnss.time) for c in ("lat", "lon"))
    d = WGS84.displacement_n(gnss["lat"], gnss["lon"], 0.0 * lat, lat, lon, 0.0 * lat)[:, :2]
    d = np.hypot(d[:, 0], d[:, 1])
    d = d[np.isfinite(d)]
    assert np.median(d) < 12.0  # plain least squares: 37.6
    assert smoothed < 0.4 * np.sqrt(np.mean(d**2)) and filtered < 0.7 * np.sqrt(np.mean(d**2))


def test_the_car_turns_as_its_reference_does(replayed):
    """Over the drive the turn rate is 0.0010 rad/s off (heading summed against the reference's course)."""
    name, _, result = replayed
    if name == "smartloc":
        bias = result.navigation.states["gyro_bias_z"]
        assert abs(bias.value[-1] + 0.0010) < 3.0 * bias.std[-1] and bias.std[-1] < 0.001
