"""Kind "platform": the contract's figures, the page, the examples, and what bad input gets."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from schuler.ground.errors import StudyError
from schuler.published.platform_figures import RECOMPUTED, TIMES
from schuler.studies.model import load_study, parse_study
from schuler.studies.run import run_study

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FLIGHT = {"motion": "constant-rates", "lat_change_deg": -65.0, "lon_change_deg": 55.0}


def study(**platform):
    return parse_study({"study": {"name": "p", "kind": "platform"}, "platform": platform})


@pytest.fixture(scope="module")
def flight():
    return run_study(study(**FLIGHT, at_s=list(TIMES)))


def test_summary_has_the_contract_s_list(flight):
    rows = {row["algorithm"]: row for row in flight.summary["platform"]}
    assert list(rows) == [
        "position-independent",
        "free-azimuth",
        "strapdown",
        "strapdown-open-loop",
        "as-published",
    ]
    for name, model in (
        ("position-independent", "pinav_exact"),
        ("free-azimuth", "free"),
        ("as-published", "as_published"),
    ):
        assert rows[name]["at_s"] == list(TIMES)
        np.testing.assert_allclose(rows[name]["error_m"], RECOMPUTED["latlon", "both", model], atol=0.01)
        size = np.hypot(rows[name]["north_m"], rows[name]["east_m"])
        np.testing.assert_allclose(size, rows[name]["error_m"], rtol=2e-3)
    json.dumps(flight.summary["platform"], allow_nan=False)


def test_the_page_s_sets_hold_each_channel_alone(flight):
    sets = {s["drift"]: s["algorithms"] for s in flight.summary["platform_drift_sets"]}
    assert list(sets) == ["none", "channel-1", "channel-3", "all"]
    np.testing.assert_allclose(sets["channel-3"][1]["error_m"], RECOMPUTED["latlon", "ch3", "free"], atol=0.01)
    assert max(sets["none"][0]["error_m"]) < 1e-4


def test_solution_and_reference_agree_with_the_error(flight):
    track, truth = flight.navigation.filter, flight.reference
    R = 6.371e6
    north = R * (track.lat - truth["lat"])
    east = (
        R * np.cos(truth["lat"]) * np.mod(track.lon - truth["lon"] + np.pi, 2 * np.pi)
        - R * np.cos(truth["lat"]) * np.pi
    )
    run = flight.details.main.runs["position-independent"]
    np.testing.assert_allclose(north, run.north, atol=1e-5)
    np.testing.assert_allclose(east, run.east, atol=1e-5)
    # the drift of channel 3 turns what the algorithm believes of the vehicle's heading: 0.1 deg/h over 2 h
    assert flight.summary["errors"]["filter"]["heading_deg"]["end"] == pytest.approx(0.14, abs=0.03)
    assert flight.summary["errors"]["filter"]["horizontal_m"]["end"] == pytest.approx(13945.554, abs=0.01)
    assert np.isnan(track.cov_pos).all()


def test_words_say_what_is_equal_and_why(flight):
    said = " ".join(flight.summary["said"])
    assert "are the same platform" in said
    assert "without latitude and longitude" in said
    assert "not turn it" in said
    assert "missing feedback" in said
    assert "first order, about its own axes, is at most" in said
    kinds = {(row["drift"], row["kind"]) for row in flight.summary["theory"]}
    assert ("all", "first order") in kinds


def test_folder_and_page(flight, tmp_path):
    out = flight.write(tmp_path / "out")
    page = (out / "report.html").read_text(encoding="utf-8")
    for id in (
        "fig-journey",
        "fig-hodograph",
        "fig-error-all",
        "fig-tilt",
        "fig-gimbals",
        "fig-alignment",
        "sensitivity",
    ):
        assert id in page, id
    assert "https://" not in page
    header = (out / "solution.csv").read_text().splitlines()[0]
    assert header.startswith("time[s],lat[deg],lon[deg],height[m],v_north[m/s]")
    assert "std_" not in header
    assert json.loads((out / "summary.json").read_text())["platform"][0]["algorithm"] == "position-independent"


def test_output_rate():
    r = run_study(
        parse_study(
            {
                "study": {"name": "p", "kind": "platform"},
                "platform": {"duration_s": 60.0, "at_s": [60]},
                "output": {"rate_hz": 2.0},
            }
        )
    )
    assert len(r.navigation.filter.time) == 121
    slow = run_study(
        parse_study(
            {"study": {"name": "p", "kind": "platform"}, "platform": {"duration_s": 600.0}, "output": {"rate_hz": 0.05}}
        )
    )
    assert np.allclose(np.diff(slow.navigation.filter.time), 20.0)


def test_map_and_ellipsoid_and_walk_and_seed():
    keys = {
        "earth": "ellipsoid",
        "duration_s": 1200.0,
        "drift_walk_deg_per_h_per_sqrt_h": [0.01, 0.0, 0.1],
        "drift_deg_per_h": [0.0, 0.0, 0.0],
        "algorithms": ["free-azimuth", "position-independent"],
        "map": {"lat_deg": [-80.0, 80.0, 3.0], "heading_deg": [0.0, 90.0, 2.0]},
    }
    a, b = run_study(study(**keys), seed=3), run_study(study(**keys), seed=3)
    c = run_study(study(**keys), seed=4)
    assert a.summary["platform"] == b.summary["platform"]
    assert a.summary["platform"] != c.summary["platform"]
    assert a.made_by["seed"] == 3
    assert np.array(a.summary["map"][0]["error_m"]).shape == (3, 2)
    assert a.summary["platform"][0]["algorithm"] == "free-azimuth"
    # the track is told on the map's latitude, 0.1 deg from the mass latitude
    assert math.degrees(a.navigation.filter.lat[0]) == pytest.approx(35.794, abs=1e-3)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("platform-*/study.toml")), ids=lambda p: p.parent.name)
def test_examples_are_studies(path):
    loaded = load_study(path)
    assert loaded.study.kind == "platform"
    assert loaded.study.name == path.parent.name


def test_there_are_four_scenarios_by_three_drifts():
    names = {p.parent.name for p in EXAMPLES.glob("platform-*/study.toml")}
    assert {
        f"platform-{s}-{d}"
        for s in ("rest", "latitude", "longitude", "both-ways")
        for d in ("channel-1", "channel-3", "channels-1-and-3")
    } < names


BAD = {
    "drift of another unit": ({"drift_deg_per_h": [36.0, 0.0, 0.0]}, "0.01 deg/s"),
    "drift in rad/s": ({"drift_deg_per_h": [4.8e-8, 0.0, 0.0]}, "in rad/s 0.0099 deg/h"),
    "drift in deg/s": ({"drift_deg_per_h": [0.0, 0.0, 2.8e-6]}, "in deg/s it would be 0.0101 deg/h"),
    "a ramp per second": ({"drift_ramp_deg_per_h2": [500.0, 0.0, 0.0]}, "of drift in an hour"),
    "a negative size": ({"drift_walk_deg_per_h_per_sqrt_h": [0.0, -0.01, 0.0]}, "it is a size: type 0.01"),
    "faster than the torquers": ({**FLIGHT, "torquer_limit_deg_per_h": 40.0}, "asks the torquers for"),
    "torquers slower than the Earth": ({"torquer_limit_deg_per_h": 5.0}, "12.2 deg/h at rest and they give 5"),
    "a height of no vehicle": ({"height_m": 1e8}, "lies between -12000 and 1e+06"),
    "a depth of no vehicle": ({"height_change_m": -2e4}, "height_change_m: it puts the vehicle -20000 m high"),
    "over a pole": ({"motion": "constant-rates", "lat_change_deg": 60.0}, "over a pole"),
    "z not positive": ({"height_m": -7e6}, "type a height above ground"),
    "rest that moves": ({"lat_change_deg": 5.0}, 'type motion = "constant-rates"'),
    "ramp too long": ({**FLIGHT, "start_ramp_s": 9000.0}, "does not end before"),
    "unstable loop": ({"alignment": {"damping": -0.1}}, "unstable: its pole at"),
    "too much lag": ({"alignment": {"lag_s": 60.0}}, "must stay below"),
    "time after the end": ({"at_s": [600, 9000]}, "outside the run"),
    "a bias of two g": ({"accel_bias_ug": [2e6, 0.0]}, "millionths of g"),
    "a bias in g": ({"accel_bias_ug": [1e-4, 0.0]}, "in g it would be 100 ug"),
    "no accelerometer left": ({"accel_scale_ppm": [-1e6, 0.0]}, "scale errors are below 10 %"),
    "no torquer left": ({"torquer_scale_ppm": [0.0, -1e6, 0.0]}, "scale errors are below 10 %"),
    "a loop too fast to compute": ({"alignment": {"level_rad_per_s": 1e6}}, "level_rad_per_s, duration_s"),
    "an alignment too long to compute": ({"alignment": {"duration_s": 1e8}}, "shorter duration_s"),
    "a map beyond the poles": ({"map": {"lat_deg": [-180.0, 180.0, 5.0]}}, "leaves -90 to 90 deg"),
    "a map for days": ({"map": {"lat_deg": [-85.0, 85.0, 5000.0]}}, "type coarser grids"),
    "a model of the sphere": ({"earth": "ellipsoid", "algorithms": ["as-published"]}, "is of the sphere"),
    "nothing to run": ({"algorithms": []}, "is empty"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gets_one_clear_sentence(name):
    keys, words = BAD[name]
    with pytest.raises(StudyError) as caught:
        run_study(study(**keys))
    assert len(caught.value.faults) == 1
    assert words in caught.value.faults[0]
    assert caught.value.faults[0].startswith("[platform")


def test_faults_are_told_together():
    with pytest.raises(StudyError) as caught:
        run_study(study(drift_deg_per_h=[36.0, 0.0, 0.0], height_m=-7e6, at_s=[1e5]))
    assert len(caught.value.faults) == 3


def test_trusted_units_run():
    keys = {"drift_deg_per_h": [36.0, 0.0, 0.0], "trust_units": True, "duration_s": 60.0, "at_s": [60]}
    assert run_study(study(**keys)).summary["platform"][0]["error_m"][0] > 1.0


def test_what_is_warned_of():
    round_less = run_study(study(earth="ellipsoid", duration_s=600.0, at_s=[600]))
    assert any("is left out" in n for n in round_less.notes)
    assert "as-published" not in {row["algorithm"] for row in round_less.summary["platform"]}
    long = run_study(study(duration_s=14400.0, at_s=[14400]))
    assert any("beyond the linear range" in n for n in long.notes)
    polar = run_study(study(lat_deg=86.0, duration_s=600.0, at_s=[600]))
    assert any("direction cosines" in n for n in polar.notes)
    steep = run_study(study(body_pitch_deg=85.0, duration_s=600.0, at_s=[600]))
    assert any("middle gimbal reaches 85 deg" in n for n in steep.notes)
    assert any("compass" in n for n in steep.notes)
    assert any("not a platform" in n for n in steep.notes)
    carried = run_study(study(drift_at_switch="carried", duration_s=600.0, at_s=[600]))
    assert any("drift carried" in n for n in carried.notes)
    turned = run_study(study(gimbal_bias_deg=5.0, duration_s=600.0, at_s=[600]))
    assert any("the errors turn the platform by 0.087 rad" in n for n in turned.notes)
    mapped = run_study(
        study(
            duration_s=600.0,
            at_s=[600],
            algorithms=["free-azimuth"],
            drift_walk_deg_per_h_per_sqrt_h=[0.01, 0.0, 0.0],
            map={"lat_deg": [0.0, 10.0, 2.0], "heading_deg": [0.0, 0.0, 1.0]},
        )
    )
    assert any("random walk of the drift is left out" in n for n in mapped.notes)


def test_flying_against_the_earth_asks_less_of_the_torquers():
    """Westward at the equator the motion takes from the Earth's turn: 100 deg in two hours less 15 deg/h."""
    west = {"lat_deg": 0.0, "motion": "constant-rates", "lon_change_deg": -100.0, "algorithms": ["free-azimuth"]}
    run_study(study(**west, torquer_limit_deg_per_h=40.0))
    with pytest.raises(StudyError, match="asks the torquers for 65 deg/h"):
        run_study(study(**{**west, "lon_change_deg": 100.0}, torquer_limit_deg_per_h=40.0))


def test_errors_beside_the_drift_are_not_called_lossless():
    said = run_study(study(accel_bias_ug=[100.0, 0.0], algorithms=["position-independent"])).summary["said"][0]
    assert "accelerometers" in said
    assert "loses nothing" not in said
    said = run_study(study(algorithms=["position-independent"])).summary["said"][0]
    assert "loses nothing" in said


def test_columns_on_the_terminal_stay_apart():
    keys = {"drift_deg_per_h": [36.0, 0.0, 0.0], "trust_units": True, "algorithms": ["strapdown-open-loop"]}
    result = run_study(study(**keys))
    line = next(x for x in result.details.told("p") if x.startswith("  strapdown-open-loop"))
    assert len(line.split()) == 1 + len(result.details.at)


def test_every_logarithmic_axis_has_numbers(flight):
    from schuler.report.sections import platform as sections
    from schuler.report.view import View

    figures = sections.errors(View(flight)).figures
    assert [f.id for f in figures] == [f"fig-error-{n}" for n in ("none", "channel-1", "channel-3", "all")]
    for figure, low in zip(figures, (1e-9, 1e-3, 1e-3, 1e-3), strict=True):
        axes = [a for a in figure.spec["layout"].values() if isinstance(a, dict) and a.get("type") == "log"]
        assert len(axes) == (1 if low < 1e-6 else 2)
        for axis in axes:
            assert axis["tickvals"][0] == pytest.approx(low)
            assert 3 <= len(axis["tickvals"]) <= 7
