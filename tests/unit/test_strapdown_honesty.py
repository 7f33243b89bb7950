"""What an alignment and a free inertial run claim about themselves, against many draws; starts of recordings."""

import math
from pathlib import Path

import numpy as np
import pytest

from schuler.inertial.alignment import SensorErrors
from schuler.inertial.alignment_filter import align
from schuler.inertial.strapdown import Start, run
from schuler.studies.model import load_study
from schuler.studies.run import run_study
from schuler.truth import trajectories
from schuler.truth.imu_errors import measure
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0


def test_sigma_of_the_alignment_is_that_of_its_errors() -> None:
    """Large accelerometer biases beside good gyros: F taken at the estimate made this 3.4 sigma on average."""
    imu = ImuModel(
        gyro_bias_deg_per_h=0.01, gyro_arw_deg_per_sqrt_h=0.002, accel_bias_ug=2000.0, accel_vrw_mps_per_sqrt_h=0.012
    )
    sensor = SensorErrors.of(accel_bias=imu.accel_bias, gyro_bias=imu.gyro_bias, vrw=imu.vrw, arw=imu.arw)
    rng = np.random.default_rng(5)
    nees, size = [], []
    for seed in range(30):
        rpy = rng.uniform([-40 * D, -40 * D, -math.pi], [40 * D, 40 * D, math.pi])
        lat = rng.uniform(-65, 65) * D
        still = trajectories.rest(lat, 0.3, 50.0, roll=rpy[0], pitch=rpy[1], heading=rpy[2], duration=200.0)
        ideal = still.ideal(10.0)
        found = align(measure(ideal, imu, seed=seed).table(), sensor, lat=lat, height=50.0, start=0.0, to=200.0)
        miss = (found.rpy - ideal.truth.rpy[-1] + math.pi) % (2 * math.pi) - math.pi
        nees.append(miss @ np.linalg.solve(found.cov, miss) / 3.0)
        size.append(miss / found.std)
    assert 0.6 < np.mean(nees) < 1.55  # 90 degrees of freedom: 1 +- 3.5 sqrt(2/90)
    assert np.all(np.sqrt(np.mean(np.square(size), axis=0)) < 1.5)


def test_scale_and_misalignment_of_the_accelerometers_are_in_the_levelling_sigma() -> None:
    flat = SensorErrors.of(accel_bias=1e-3)
    with_matrix = SensorErrors.of(accel_bias=1e-3, accel_scale=1e-3, accel_misalignment=2e-3, gyro_g_sensitivity=1e-6)
    turned = with_matrix.at_rest([0.0, 0.0, -10.0])
    assert turned.accel_bias == pytest.approx([math.hypot(1e-3, 2e-2), math.hypot(1e-3, 2e-2), math.hypot(1e-3, 1e-2)])
    assert turned.gyro_bias == pytest.approx([1e-5] * 3)
    assert flat.at_rest([0.0, 0.0, -10.0]).accel_bias == pytest.approx(flat.accel_bias)


FLIGHT = """[study]
name = "flight"
kind = "strapdown"
[start]
lat_deg = 50.0
lon_deg = 30.0
[trajectory]
preset = "legs"
duration_s = 300
rate_hz = 20
speed_mps = 60
turns_deg = [90, -120]
turn_rate_deg_per_s = 5
[output]
rate_hz = 1
"""


def study(folder: Path, text: str):
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return load_study(path)


@pytest.mark.parametrize(
    "imu",
    ["accel_misalignment_mrad = 0.5", "accel_scale_ppm = 2000", "gyro_misalignment_mrad = 1.0", "gyro_scale_ppm = 500",
     "gyro_g_sensitivity_deg_per_h_per_g = 5.0", 'preset = "navigation"'],
)  # fmt: skip
def test_sigma_of_a_flight_holds_what_grows_with_the_motion(tmp_path: Path, imu: str) -> None:
    flown = study(tmp_path, FLIGHT + '[filter]\nvertical = "held"\n[imu]\n' + imu)
    nees = []
    for seed in range(12):
        result = run_study(flown, seed=seed)
        miss = np.array([result.truth_states[f"error_{p}"][1][-1] for p in ("north", "east")])
        P = result.navigation.filter.cov_pos[-1][:2, :2]
        nees.append(miss @ np.linalg.solve(P, miss) / 2.0)
    assert 0.3 < np.mean(nees) < 2.1  # 24 degrees of freedom


def recording(folder: Path, still_s: float = 60.0, moving_s: float = 40.0, kind: str = "rates") -> str:
    """A still stretch and then a flight, as tables of a recording with fixes."""
    from schuler.ground.tables import Table
    from schuler.io.tables import write_table

    n = int((still_s + moving_s) * 50.0)
    ideal = trajectories.rest(50 * D, 30 * D, 100.0, roll=2 * D, pitch=3 * D, heading=40 * D, duration=n / 50.0).ideal(
        50.0
    )
    table = measure(ideal, ImuModel(accel_vrw_mps_per_sqrt_h=0.05, gyro_arw_deg_per_sqrt_h=0.5), seed=3).table(kind)
    shake = ideal.time > still_s
    name = "accel_x" if kind == "rates" else "dv_x"
    scale = 1.0 if kind == "rates" else ideal.dt
    columns = dict(table.columns)
    columns[name] = columns[name] + shake * 3.0 * np.sin(2 * math.pi * ideal.time) * scale
    write_table(folder / "imu.csv", Table("imu", columns, kind=table.kind))
    t = np.arange(0.5, n / 50.0, 1.0)
    fixes = {"time": t, "lat": 50 * D + 1e-9 * t, "lon": np.full(t.size, 30 * D), "height": np.full(t.size, 100.0)}
    fixes |= {f"v_{a}": np.full(t.size, 0.3) for a in ("north", "east", "down")}
    write_table(folder / "gnss.csv", Table("gnss", fixes))
    return """[study]
name = "own"
kind = "strapdown"
[input]
imu = "imu.csv"
gnss = "gnss.csv"
[start]
heading_deg = 40.0
[imu]
gyro_bias_deg_per_h = 100
accel_bias_ug = 500
accel_vrw_mps_per_sqrt_h = 0.05
gyro_arw_deg_per_sqrt_h = 0.5
"""


@pytest.mark.parametrize("kind", ["rates", "increments"])
def test_a_found_start_takes_the_last_fix_before_it_and_no_speed(tmp_path: Path, kind: str) -> None:
    result = run_study(study(tmp_path, recording(tmp_path, kind=kind)))
    track = result.navigation.filter
    aligned = next(n for n in result.notes if n.startswith("aligned from"))
    end = float(aligned.split(" to ")[1].split(" s")[0])
    fix = float(next(n for n in result.notes if "is the fix at" in n).split(" fix at ")[1].split(" s")[0])
    assert end - 1.0 <= fix <= end  # not the first of all, not a later one
    assert np.linalg.norm(track.v_n[0]) < 0.2  # it stood: not the receiver's 0.3 m/s
    assert track.time[0] > end


def test_the_bias_taken_off_is_known_as_well_as_the_rest_shows_it(tmp_path: Path) -> None:
    result = run_study(study(tmp_path, recording(tmp_path)))
    std = np.degrees(np.sqrt(result.navigation.filter.cov_rpy[:, 2, 2]))
    assert std[-1] < 5.3  # 100 deg/h over 40 s would add a degree and more to the 5 of the start
    assert std[0] > 4.9


def test_a_recording_still_to_its_end_is_navigated_all_the_same(tmp_path: Path) -> None:
    result = run_study(study(tmp_path, recording(tmp_path, still_s=60.0, moving_s=0.0)))
    assert any("still to its end" in n for n in result.notes)
    assert result.navigation.filter.time[-1] == pytest.approx(60.0, abs=0.2)


def test_a_row_at_the_start_covers_what_lies_before_it() -> None:
    flight = trajectories.rhumb_line(0.8, 0.2, 100.0, speed=50.0, heading=1.0, duration=20.0)
    ideal = flight.ideal(50.0)
    start = Start.of(ideal.truth, 99)
    table = ideal.table("rates")
    cut = type(table)("imu", {k: v[99:] for k, v in table.columns.items()}, kind="rates")
    assert cut.time[0] == start.time
    track = run(cut, start)
    assert track.time[0] > start.time
    d = flight.earth.displacement_n(
        track.lat[-1], track.lon[-1], track.height[-1], ideal.truth.lat[-1], ideal.truth.lon[-1], ideal.truth.height[-1]
    )
    assert np.linalg.norm(d) < 1e-4


def test_sigma_begins_at_the_start_not_at_the_first_row(tmp_path: Path) -> None:
    flown = study(tmp_path, FLIGHT + "[imu]\naccel_vrw_mps_per_sqrt_h = 0.1\n")
    first = run_study(flown, seed=1).navigation.filter
    assert first.time[0] == pytest.approx(1.0)
    assert first.cov_vel[0, 0, 0] == pytest.approx((0.1 / 60.0) ** 2, rel=0.05)  # one second of white noise


def test_held_height_is_not_judged(tmp_path: Path) -> None:
    flown = study(tmp_path, FLIGHT + '[filter]\nvertical = "held"\n[imu]\npreset = "tactical"\n')
    consistency = run_study(flown, seed=2).summary["consistency"]
    assert consistency["nees_position"] is not None and consistency["nees_position"] < 10.0


def test_distance_is_that_of_the_run(tmp_path: Path) -> None:
    from schuler.io.tables import write_table

    flight = trajectories.rhumb_line(0.8, 0.2, 100.0, speed=50.0, heading=1.0, duration=60.0)
    ideal = flight.ideal(50.0)
    write_table(tmp_path / "truth.csv", ideal.truth.table())
    table = ideal.table("increments")
    write_table(tmp_path / "imu.csv", type(table)("imu", {k: v[:500] for k, v in table.columns.items()}, "increments"))
    text = '[study]\nname = "own"\nkind = "strapdown"\n[input]\nimu = "imu.csv"\nreference = "truth.csv"\n[start]\n'
    text += f"time_s = 0.0\nlat_deg = {0.8 / D!r}\nlon_deg = {0.2 / D!r}\nheight_m = 100.0\nheading_deg = {1.0 / D!r}\n"
    text += (
        f"roll_deg = 0.0\npitch_deg = 0.0\nv_north_mps = {50 * math.cos(1.0)!r}\nv_east_mps = {50 * math.sin(1.0)!r}\n"
    )
    result = run_study(study(tmp_path, text))
    assert result.summary["distance_m"] == pytest.approx(500.0, abs=20.0)
    assert result.summary["errors"]["filter"]["horizontal_m"]["max"] < 0.01


def test_a_window_that_moves_or_ends_late_is_not_called_still(tmp_path: Path) -> None:
    from schuler.ground.errors import InputError, StudyError
    from schuler.studies.align import align_study

    text = recording(tmp_path, still_s=30.0, moving_s=10.0).replace(
        "gyro_bias_deg_per_h = 100", "gyro_bias_deg_per_h = 500"
    )
    late = align_study(study(tmp_path, text + "[align]\nfrom_s = 5.0\nto_s = 900.0\n"))[1]
    assert late["to_s"] == pytest.approx(40.0) and any("the recording ends" in n for n in late["notes"])
    tilting = trajectories.oscillation(0.8, 0.2, roll=0.3, pitch=0.3, rate=0.3, duration=60.0).ideal(50.0).table()
    with pytest.raises(InputError, match="not still"):
        align(tilting, SensorErrors.of(gyro_bias=1e-3), lat=0.8, start=0.0, to=60.0)
    with pytest.raises(StudyError, match="still base"):
        align_study(study(tmp_path, FLIGHT))
