"""Kind "aided" on real recordings: what was found, what the marks ask, and rows that do not move by themselves."""

import numpy as np
import pytest
from replay import AIDED, golden_of, moved, read, replay, variant, without
from targets_aided import arm_of, car_rtk, delay_of, place_errors, thinned

pytestmark = pytest.mark.data


@pytest.fixture(scope="module", params=AIDED)
def replayed(request, data_folder, tmp_path_factory):
    out = tmp_path_factory.mktemp(request.param) / "tables"
    return request.param, out, replay(request.param, data_folder / AIDED[request.param][0], out)


def test_nothing_moved(replayed):
    """Beyond 2 % of a sigma: then  python tests/golden/replay.py --update  and commit with the reason."""
    name, _, result = replayed
    changes = moved(read(name), golden_of(result.navigation))
    assert len(changes) > 50
    assert {key: c for key, c in changes.items() if abs(c[0]) > 0.02 or abs(c[1] - 1.0) > 0.02} == {}


def state(result, name):
    history = result.navigation.states[name]
    return float(history.value[-1]), float(history.std[-1])


def test_what_the_recording_is_known_for_is_found(replayed):
    """Mounting, delays, scales and wind: against figures that were found without a filter, or by somebody else."""
    name, _, result = replayed
    value = {n: state(result, n)[0] for n in result.navigation.states}
    if name == "car-rtk-mems":  # pitch 6.8 deg, yaw -5.4 deg in the source's own settings, other way around
        assert np.degrees(value["mounting_pitch"]) == pytest.approx(-6.7, abs=0.5)
        assert np.degrees(value["mounting_yaw"]) == pytest.approx(5.5, abs=0.6)
        # differenced positions against reported velocity, no filter: 0.13 s
        assert value["gnss_velocity_delay"] - value["gnss_delay"] == pytest.approx(0.13, abs=0.04)
    if name == "comma2k19-aided":
        assert value["speed_scale"] == pytest.approx(-0.009, abs=0.002)
        assert value["gnss_velocity_delay"] == pytest.approx(0.16, abs=0.03)
        errors = result.summary["errors"]
        assert errors["filter"]["horizontal_m"]["rms"] < 0.45 and errors["smoother"]["velocity_mps"]["rms"] < 0.1
    if name == "thor-uav":  # a north wind blows to the south: the wind was about 6 m/s to the east
        assert value["current_east"] == pytest.approx(6.0, abs=2.5) and abs(value["current_north"]) < 2.5
        assert all(
            abs(value[f"gyro_bias_{a}"]) < 0.004 for a in "xyz"
        )  # the autopilot has taken them out on the ground
    if name == "quad-4imu":
        assert abs(value["gnss_delay"]) < 0.02
        assert result.summary["errors"]["smoother"]["pitch_deg"]["rms"] < 2.0
    if name == "car-phone":
        assert np.degrees(value["mounting_yaw"]) == pytest.approx(8.5, abs=2.5)
        assert value["gnss_velocity_delay"] - value["gnss_delay"] == pytest.approx(0.2, abs=0.1)


def test_the_filter_knows_how_good_it_is(replayed):
    """NIS per degree of freedom, and hardly a fix refused."""
    name, _, result = replayed
    innovations = result.navigation.innovations
    nis = float(np.nanmean(innovations["gnss_position"].nis)) / 2.0
    assert 0.05 < nis < 1.5
    assert innovations["gnss_position"].used.mean() > 0.99
    assert np.isfinite(result.navigation.smoother.cov_pos).all()


def test_smoother_between_thinned_fixes(data_folder, tmp_path):
    """One RTK fix in 10 s: the smoother is under 0.4 m at the others, a straight line between fixes is at 8 m."""
    name = "car-rtk-mems"
    replay(name, data_folder / AIDED[name][0], tmp_path / "t")
    file, left = thinned(tmp_path / "t", 10.0)

    def change(raw):
        without("sweep")(raw)
        raw["input"]["gnss"] = file

    result = variant(tmp_path / "t", change)
    left = left.where(left.time > left.time[0] + 60.0)
    delay = delay_of(result.navigation, 0.0, left.time, True)
    errors = place_errors(result.navigation.smoother, left, delay, arm_of(result))
    errors = errors[np.isfinite(errors)]
    assert len(errors) > 1500 and np.sqrt(np.mean(errors**2)) < 0.4


@pytest.mark.slow
def test_outages_of_the_car_pass_every_mark(data_folder, tmp_path):
    from recordings import prepare_example

    prepare_example("car-rtk-mems", data_folder / "car_rtk_mems", tmp_path / "t")
    rows = list(car_rtk(tmp_path / "t"))
    assert len(rows) == 12
    assert [r for r in rows if r.verdict == "MISSED"] == []
    assert sum(r.verdict == "good" for r in rows) >= 5


def test_marks_are_kept_and_missed():
    """A figure that is not there is missed; too modest a NEES is missed as well."""
    from targets_aided import Row, text

    good, must, above = (Row("car", "x", v, "m", 4.0, 2.0) for v in (1.9, 2.1, 4.1))
    assert [r.verdict for r in (good, must, above)] == ["good", "must", "MISSED"]
    assert Row("car", "x", float("nan"), "m", 4.0).verdict == "MISSED"
    assert Row("car", "nees", 0.4, "", 3.0, low=0.5).verdict == "MISSED"
    assert text(must) == "| car | x | 2.1 m | 4 | 2 | must |  |"
