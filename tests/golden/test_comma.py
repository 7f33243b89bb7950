"""The example study on the car that stands in for a surfaced vehicle: claims, golden rows, its own learnt figures."""

import numpy as np
import pytest
from replay import EXAMPLES, golden_of, moved, read, run_example

pytestmark = pytest.mark.data
NAME = "comma2k19-car"


@pytest.fixture(scope="module")
def result(data_folder, tmp_path_factory):
    return run_example(NAME, data_folder / EXAMPLES[NAME][0], tmp_path_factory.mktemp(NAME) / "tables")


def test_as_good_as_claimed(result):
    found = EXAMPLES[NAME][1](result.summary)
    assert len(found) == 2 and [f for f in found if not f.holds] == []


def test_nothing_moved(result):
    """Beyond 2 % of a sigma: then  python tests/golden/replay.py --update  and commit with the reason."""
    changes = moved(read(NAME), golden_of(result.navigation))
    assert len(changes) > 50
    assert {key: c for key, c in changes.items() if abs(c[0]) > 0.02 or abs(c[1] - 1.0) > 0.02} == {}


def test_with_all_fixes_the_track_is_the_receivers(result):
    """0.42 m is the receiver against the reference."""
    errors = result.summary["errors"]
    assert errors["filter"]["horizontal_m"]["rms"] < 0.6
    assert errors["smoother"]["horizontal_m"]["rms"] < 0.55
    assert np.isfinite(result.navigation.smoother.cov_pos).all()


def test_the_wheel_speed_is_about_one_percent_off(result):
    scale = result.navigation.states["speed_scale"]
    assert -0.02 < scale.value[-1] < 0.02 and scale.std[-1] < 0.015
