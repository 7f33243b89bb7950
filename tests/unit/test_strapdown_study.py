"""Kind "strapdown" and `schuler align` as a user meets them."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from schuler.ground.errors import InputError, StudyError
from schuler.studies.align import align_study, lines, write
from schuler.studies.model import load_study, parse_study
from schuler.studies.run import run_study

EXAMPLES = Path(__file__).parents[2] / "examples"


def study(**sections):
    raw = {
        "study": {"name": "test", "kind": "strapdown"},
        "start": {"lat_deg": 50.0, "lon_deg": 30.0, "heading_deg": 40.0},
        "trajectory": {"preset": "legs", "duration_s": 600.0, "rate_hz": 50, "speed_mps": 100.0, "turns_deg": [60]},
        "errors": {"gyro_bias_deg_per_h": 0.05, "accel_bias_ug": [100, -50, 80]},
        "filter": {"vertical": "held"},
    }  # fmt: skip
    return parse_study({**raw, **sections})


def test_error_growth_beside_linear_model_closed_form_and_floor() -> None:
    result = run_study(study())
    told = result.summary["strapdown"]
    assert told["linear_difference_share"] < 5e-3
    assert told["floor_horizontal_m"] < 1e-4
    assert told["max_horizontal_m"] > 50.0
    assert 800.0 < told["open_loop_accel_holds_s"] < 900.0
    assert result.summary["errors"]["filter"]["horizontal_m"]["end"] == pytest.approx(
        math.hypot(told["end_north_m"], told["end_east_m"]), rel=1e-3
    )
    for name in ("error_north", "linear_north", "closed_north", "open_north", "floor_horizontal"):
        time, value = result.truth_states[name]
        assert len(time) == len(value)
        assert np.all(np.isfinite(value))
    assert json.dumps(result.summary)


def test_without_errors_nothing_but_the_floor_is_left() -> None:
    result = run_study(study(errors={}))
    assert result.summary["errors"]["filter"]["horizontal_m"]["max"] < 1e-4
    assert result.summary["consistency"]["nees_position"] is None


@pytest.mark.parametrize(
    ("preset", "keys"),
    [("rest", {}), ("great-circle", {}), ("rhumb-line", {}), ("oscillation", {"swing_deg": [5, 5, 0]}), ("coning", {}),
     ("dive", {"depth_m": 50.0, "speed_mps": 3.0}), ("turntable", {}), ("legs", {"climbs_m": [100.0, -50.0]})],
)  # fmt: skip
def test_every_shape_runs_and_holds_its_height(preset: str, keys: dict) -> None:
    shape = {"preset": preset, "duration_s": 120.0, "rate_hz": 100, **keys}
    result = run_study(study(trajectory=shape))
    assert result.summary["strapdown"]["floor_horizontal_m"] < (2.0 if preset == "coning" else 0.01)
    assert result.summary["errors"]["filter"]["vertical_m"]["max"] < 1e-6


def test_drawn_errors_have_a_sigma_and_it_is_honest() -> None:
    imu = {"gyro_bias_deg_per_h": 0.5, "accel_bias_ug": 300, "gyro_arw_deg_per_sqrt_h": 0.02,
           "accel_vrw_mps_per_sqrt_h": 0.02}  # fmt: skip
    values = []
    for seed in range(8):
        result = run_study(study(errors={}, imu=imu), seed=seed)
        values.append(result.summary["consistency"]["nees_position"])
        assert np.all(result.navigation.filter.cov_pos[-1, 0, 0] > 0.0)
    assert 0.2 < np.mean(values) < 2.6  # eight runs of two degrees of freedom, correlated along a run


def test_same_seed_same_bytes() -> None:
    imu = {"gyro_bias_deg_per_h": 0.5, "gyro_arw_deg_per_sqrt_h": 0.02}
    a, b = (run_study(study(imu=imu), seed=3) for _ in range(2))
    assert np.array_equal(a.navigation.filter.lat, b.navigation.filter.lat)
    assert a.summary == b.summary


def test_a_track_study_follows_a_reference(tmp_path: Path) -> None:
    t = np.arange(0.0, 60.0, 1.0)
    rows = "\n".join(f"{x},{50 + 1e-4 * x},{30 + 2e-5 * x * x / 10},{100 + x}" for x in t)
    (tmp_path / "truth.csv").write_text("time[s],lat[deg],lon[deg],height[m]\n" + rows + "\n")
    (tmp_path / "study.toml").write_text(
        '[study]\nname = "t"\nkind = "strapdown"\n[input]\nreference = "truth.csv"\n[trajectory]\npreset = "track"\n'
        "rate_hz = 50\n[errors]\naccel_bias_ug = 100\n"
    )
    result = run_study(load_study(tmp_path / "study.toml"))
    assert result.summary["strapdown"]["trajectory"] == "track"
    assert result.summary["strapdown"]["floor_horizontal_m"] < 1e-4


def recording(tmp_path: Path, text: str) -> Path:
    from schuler.studies.kind_strapdown import imu_model, trajectory_of
    from schuler.truth.imu_errors import measure

    made = study(errors={"accel_bias_ug": 50}, trajectory={"preset": "rest", "duration_s": 60.0, "rate_hz": 50})
    ideal = trajectory_of(made).ideal(50.0)
    t = measure(ideal, imu_model(made)).table("rates")
    names = ["time[s]"] + [f"{n}_{a}[{u}]" for n, u in (("gyro", "rad/s"), ("accel", "m/s^2")) for a in "xyz"]
    rows = np.column_stack([t.columns[n.split("[")[0]] for n in names])
    np.savetxt(tmp_path / "imu.csv", rows, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    path = tmp_path / "study.toml"
    path.write_text('[study]\nname = "r"\nkind = "strapdown"\n[input]\nimu = "imu.csv"\n' + text)
    return path


def test_a_recording_runs_from_its_start_section(tmp_path: Path) -> None:
    path = recording(
        tmp_path, "[start]\nlat_deg = 50\nlon_deg = 30\nheight_m = 0\nroll_deg = 0\npitch_deg = 0\nheading_deg = 40\n"
    )  # fmt: skip
    result = run_study(load_study(path))
    track = result.navigation.filter
    assert len(track) > 100
    east, north = (track.lon[-1] - track.lon[0]) * 4.1e6, (track.lat[-1] - track.lat[0]) * 6.37e6
    assert math.hypot(east, north) == pytest.approx(0.5 * 50e-6 * 9.8 * math.sqrt(2) * 60**2, rel=0.1)


def test_a_recording_without_place_or_heading_says_what_to_type(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\[start\] lat_deg"):
        run_study(load_study(recording(tmp_path, "")))
    with pytest.raises(InputError, match=r"\[start\] heading_deg"):
        run_study(
            load_study(
                recording(
                    tmp_path, "[start]\nlat_deg = 50.0\nlon_deg = 30.0\n[imu]\ngyro_bias_deg_per_h = 100\n"
                )  # fmt: skip
            )
        )


def test_faults_of_the_study() -> None:
    with pytest.raises(StudyError, match=r"\[start\] lat_deg"):
        run_study(study(start={}))
    with pytest.raises(StudyError, match="reference"):
        run_study(study(trajectory={"preset": "track"}))


def test_align_finds_north_and_writes_its_json(tmp_path: Path) -> None:
    found, told = align_study(load_study(EXAMPLES / "strapdown-align" / "study.toml"))
    assert told["heading_deg"] == pytest.approx(330.0, abs=4 * told["std_heading_deg"])
    assert told["std_heading_deg"] == pytest.approx(0.0597, rel=0.1)
    assert told["useful_s"] < 400.0
    assert np.array(told["covariance_deg2"]).shape == (3, 3)
    assert np.sqrt(told["covariance_deg2"][2][2]) == pytest.approx(told["std_heading_deg"])
    saved = json.loads(write(told, tmp_path / "out").read_text())
    for key in ("study", "made_by", "method", "from_s", "to_s", "roll_deg", "pitch_deg", "heading_deg", "std_roll_deg",
                "std_pitch_deg", "std_heading_deg", "covariance_deg2", "gyro_bias_deg_per_h"):  # fmt: skip
        assert key in saved
    text = "\n".join(lines(told))
    assert "heading" in text and "does not help" in text
    assert found.method == "still"


def test_align_warns_of_a_gyro_too_poor() -> None:
    _, told = align_study(study(imu={"gyro_bias_deg_per_h": 100.0, "accel_bias_ug": 500}, errors={},
                                trajectory={"preset": "rest", "duration_s": 60.0, "rate_hz": 50}))  # fmt: skip
    text = "\n".join(lines(told))
    assert "too poor to find north" in text
    assert "heading   not known" in text


def test_over_the_pole_the_run_goes_on_and_the_linear_model_is_left_out() -> None:
    result = run_study(
        study(
            start={"lat_deg": 89.9, "lon_deg": 20.0, "heading_deg": 0.0},
            trajectory={"preset": "great-circle", "duration_s": 120.0, "rate_hz": 100},
            imu={"preset": "navigation"},
            errors={},
        )
    )
    told = result.summary["strapdown"]
    assert "linear_end_north_m" not in told
    assert 0.0 < told["max_horizontal_m"] < 100.0
    assert any("pole" in n for n in result.notes)
    json.dumps(result.summary, allow_nan=False)


def test_a_recording_with_poor_gyros_is_levelled_and_its_sigma_knows_it(tmp_path: Path) -> None:
    path = recording(
        tmp_path,
        "[start]\nlat_deg = 50\nlon_deg = 30\nheading_deg = 40\nstd_heading_deg = 2\n"
        "[imu]\ngyro_bias_deg_per_h = 100\naccel_bias_ug = 500\n[align]\nfrom_s = 0\nto_s = 30\n",
    )
    result = run_study(load_study(path))
    track = result.navigation.filter
    assert any("taken off as their bias" in n for n in result.notes)
    assert track.time[0] > 30.0
    assert math.sqrt(track.cov_rpy[0, 0, 0]) == pytest.approx(500e-6, rel=0.05)
    assert math.sqrt(track.cov_rpy[0, 2, 2]) == pytest.approx(math.radians(2.0), rel=0.05)
    east, north = (track.lon[-1] - math.radians(30)) * 4.1e6, (track.lat[-1] - math.radians(50)) * 6.37e6
    assert math.hypot(east, north) < 3.0 * math.sqrt(track.cov_pos[-1, 0, 0] + track.cov_pos[-1, 1, 1])
