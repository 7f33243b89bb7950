"""More that bad input gets: numbers beyond any vehicle, clocks that jump in gaps, units that contradict each other."""

import json
import re

import pytest

from schuler.ground.errors import InputError
from schuler.io.tables import read_table


def change(file, column, function):
    """Rewrites one column of a CSV: function(row, value) -> value."""
    lines = file.read_text().splitlines()
    names = [n.split("[")[0] for n in lines[0].split(",")]
    k = names.index(column)
    rows = [line.split(",") for line in lines[1:]]
    for i, cells in enumerate(rows):
        cells[k] = repr(function(i, float(cells[k])))
    file.write_text("\n".join([lines[0], *(",".join(c) for c in rows)]) + "\n")


def shown(program, trial, status, *said):
    done = program("run", trial / "study.toml")
    text = done.out if status == 0 else done.err
    assert done.status == status, done.out + done.err
    assert "Traceback" not in done.err and (status == 0) == (trial / "trial-result").exists()
    for word in said:
        assert re.search(word, text), text
    return done


# ---- stray rows ----


@pytest.mark.parametrize(
    ("table", "column"),
    [("imu", "gyro_x"), ("imu", "accel_x"), ("imu", "time"), ("speed", "speed"), ("depth", "depth"), ("gnss", "lat")],
)
def test_a_row_beyond_any_vehicle_is_left_out(program, trial, table, column):
    change(trial / f"{table}.csv", column, lambda i, v: 1e300 if i == 20 else v)
    shown(program, trial, 0, rf"{table}\.csv: 1 of \d+ rows left out.*line 22")


@pytest.mark.parametrize("column", ["height", "v_north", "std_north"])
def test_an_optional_number_beyond_any_vehicle_is_not_known(program, trial, column):
    change(trial / "gnss.csv", column, lambda i, v: 1e300 if i == 20 else v)
    shown(program, trial, 0, rf"gnss\.csv: {column} .*line 22.*unknown")


def test_a_whole_column_beyond_any_vehicle(program, trial):
    change(trial / "depth.csv", "depth", lambda i, v: v + 9e9)
    shown(program, trial, 1, r"depth\.csv: depth reaches 9e\+09 m in 210 of 210 rows")


def test_places_before_the_first_fix(program, trial):
    for column in ("lat", "lon"):
        change(trial / "gnss.csv", column, lambda i, v: 0.0 if i < 3 else v)
    shown(program, trial, 0, "3 of 90 rows left out at exactly 0 N 0 E")


def test_a_track_through_0_n_0_e_is_kept(tmp_path):
    file = tmp_path / "gnss.csv"
    file.write_text("time[s],lat[deg],lon[deg]\n" + "".join(f"{i},{(i - 5) * 1e-5},{0.0}\n" for i in range(11)))
    assert len(read_table(file, "gnss")) == 11


def test_a_clock_that_was_not_set_in_one_row(program, trial):
    change(trial / "imu.csv", "time", lambda i, v: 1e9 if i == 10499 else v)
    shown(program, trial, 0, r"imu\.csv: 1 of 10500 rows left out, stamped more than a year away")


def test_a_gap_of_months_is_refused_in_one_sentence(program, trial):
    change(trial / "imu.csv", "time", lambda i, v: v + 1e7 if i > 10000 else v)
    done = shown(program, trial, 1, r"imu\.csv has a gap of 116 days after 200\.0 s")
    assert len(done.err.strip().splitlines()) == 1 or "overlap" in done.err


def test_one_time_for_all_rows_is_said_to_be_that(program, trial):
    change(trial / "imu.csv", "time", lambda i, v: 5.0)
    shown(program, trial, 1, "one row", "10499 rows left out that repeat the time")


# ---- clocks that roll over while nothing is recorded ----


@pytest.mark.parametrize("size", [604800.0, 86400.0])
def test_week_and_midnight_roll_over_in_a_dive(program, trial, size):
    for file in ("imu", "gnss", "speed", "depth", "truth"):
        change(trial / f"{file}.csv", "time", lambda i, v: (v + size - 100.0) % size)
    done = shown(program, trial, 0, "week rolled over|passes midnight")
    assert "without fixes" in done.out and "do not overlap" not in done.out


def test_the_week_number_is_put_right_in_a_gap(tmp_path):
    times = [1.0, 2.0, 3.0, 1024 * 604800.0 + 500.0, 1024 * 604800.0 + 501.0]
    file = tmp_path / "depth.csv"
    file.write_text("time[s],depth[m]\n" + "".join(f"{t},1.0\n" for t in times))
    assert read_table(file, "depth").time.tolist() == [1.0, 2.0, 3.0, 500.0, 501.0]


def test_rounding_does_not_make_time_go_back(tmp_path):
    file = tmp_path / "depth.csv"
    file.write_text("time[s],depth[m]\n32.02,1\n32.040000000000006,2\n32.04,3\n32.06,4\n")
    assert len(read_table(file, "depth")) == 3
    file.write_text("time[s],depth[m]\n32.02,1\n32.05,2\n32.04,3\n32.06,4\n")
    with pytest.raises(InputError, match="goes back at line 4"):
        read_table(file, "depth")


# ---- units that contradict another table ----


@pytest.mark.parametrize(("factor", "hint"), [(1 / 0.514444, r"speed\[kn\]"), (3.6, r"speed\[km/h\]")])
def test_a_speed_in_another_unit_is_asked_about(program, trial, factor, hint):
    change(trial / "speed.csv", "speed", lambda i, v: v * factor)
    shown(program, trial, 0, r"speed\.csv reads .* times the speed over ground.*" + hint)


# ---- the study file ----


def test_an_unknown_preset_is_told_with_the_other_faults(program, trial):
    with open(trial / "study.toml", "a") as file:
        file.write('[noise]\nspeed_mps = -1\n[imu]\npreset = "xsens"\n')
    done = shown(program, trial, 2, r"\[noise\] speed_mps", r"\[imu\] preset = 'xsens' is not known")
    assert len(done.err.strip().splitlines()) == 2
    assert all("study.toml: " in line for line in done.err.strip().splitlines())


def test_a_mission_that_cannot_be_is_told_with_the_other_faults(program, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('[study]\nname="x"\nkind="auv"\n[mission]\ndive_s=60\ndepth_m=500\n[noise]\nspeed_mps=-1\n')
    done = program("run", path)
    assert done.status == 2 and "too short" in done.err and "[noise] speed_mps" in done.err


@pytest.mark.parametrize("line", ["[start]\nheight_m = 1e308", "[noise]\ncurrent_mps = 1e200"])
def test_numbers_that_nothing_has(program, trial, line):
    with open(trial / "study.toml", "a") as file:
        file.write(line + "\n")
    shown(program, trial, 2, "far outside anything real")


def test_a_start_after_the_end(program, trial):
    with open(trial / "study.toml", "a") as file:
        file.write("[start]\ntime_s = 9999\n")
    shown(program, trial, 1, r"\[start\] time_s = 9999 s lies after the end of imu\.csv")


# ---- files ----


def test_a_cut_netcdf_of_any_name(program, tmp_path):
    file = tmp_path / "mission.nc"
    file.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(500))
    done = program("convert", file, tmp_path / "out")
    assert done.status == 1 and "damaged or cut off" in done.err and not (tmp_path / "out").exists()


# ---- the summary agrees with itself ----


def test_no_end_is_worse_than_the_worst(program, trial):
    with open(trial / "study.toml", "a") as file:
        file.write('[[outage]]\nsensor = "gnss"\nstart_s = 20\nend_s = 40\n')
        file.write('[[outage]]\nsensor = "speed"\nstart_s = 22.5\nend_s = 33.5\n')
    shown(program, trial, 0)
    told = json.loads((trial / "trial-result" / "summary.json").read_text())
    for entry in [*told["outages"], *told["dives"]]:
        assert entry["horizontal_end_m"] <= entry["horizontal_max_m"]


# ---- places counted in metres ----


def in_metres(file):
    """lat, lon of a table as north, east in metres from 36.73 N 52.65 E (radii of auv.md)."""
    lines = [line.split(",") for line in file.read_text().splitlines()]
    k, m = lines[0].index("lat[deg]"), lines[0].index("lon[deg]")
    lines[0][k], lines[0][m] = "north[m]", "east[m]"
    for cells in lines[1:]:
        cells[k] = repr((float(cells[k]) - 36.73) * 110972.589)
        cells[m] = repr((float(cells[m]) - 52.65) * 89325.410)
    file.write_text("\n".join(",".join(c) for c in lines) + "\n")


def test_north_and_east_need_to_be_counted_from_somewhere(program, trial):
    for name in ("gnss", "truth"):
        in_metres(trial / f"{name}.csv")
    done = shown(program, trial, 1, "gnss.csv holds north and east", "truth.csv holds north and east", "lat_deg")
    assert len(done.err.strip().splitlines()) == 2


def test_north_and_east_counted_from_the_start(program, trial):
    with open(trial / "study.toml", "a") as file:
        file.write("[start]\nlat_deg = 36.73\nlon_deg = 52.65\n")
    shown(program, trial, 0)
    told = json.loads((trial / "trial-result" / "summary.json").read_text())["errors"]["filter"]["horizontal_m"]
    for name in ("gnss", "truth"):
        in_metres(trial / f"{name}.csv")
    shown(program, trial, 0, r"counted from \[start\] lat_deg, lon_deg")
    again = json.loads((trial / "trial-result" / "summary.json").read_text())["errors"]["filter"]["horizontal_m"]
    assert again["rms"] == pytest.approx(told["rms"], abs=0.02) and again["end"] == pytest.approx(told["end"], abs=0.05)


def test_a_policy_that_is_not_read_is_told(program, trial):
    with open(trial / "study.toml", "a") as file:
        file.write('[filter]\nmethod = "paper-literal"\noutage_policy = "drop"\n')
    shown(program, trial, 0, 'outage_policy "drop".*left out')


def test_the_filter_expects_the_sea_that_the_mission_has():
    from math import isclose

    from schuler.studies.auv_mapping import auv_settings
    from schuler.studies.model import parse_study

    raw = {"study": {"name": "x", "kind": "auv"}, "mission": {"preset": "demo"}}
    usual = auv_settings(parse_study(raw)).wave_std
    assert isclose(auv_settings(parse_study(raw | {"mission": {"wave_mps": 0.1}})).wave_std, usual)
    assert isclose(auv_settings(parse_study(raw | {"mission": {"wave_mps": 0.5}})).wave_std, 5 * usual)
    typed = raw | {"mission": {"wave_mps": 0.5}, "noise": {"wave_mps": 0.06}}
    assert isclose(auv_settings(parse_study(typed)).wave_std, 0.06)


# ---- what the study says about its files ----


def set_input(trial, lines):
    text = (trial / "study.toml").read_text().replace('imu = "imu.csv"', f'imu = "imu.csv"\n{lines}')
    (trial / "study.toml").write_text(text)


def test_units_typed_in_the_study_are_used(program, trial):
    heading, rest = (trial / "imu.csv").read_text().split("\n", 1)
    (trial / "imu.csv").write_text(heading.replace("rad/s", "deg/s") + "\n" + rest)
    set_input(trial, 'gyro_unit = "rad/s"')
    shown(program, trial, 0)


def test_units_typed_in_the_study_that_are_none(program, trial):
    set_input(trial, 'gyro_unit = "furlong"\naccel_unit = "rad"')
    done = shown(program, trial, 2, r"gyro_unit.*furlong.*not known", r"accel_unit rad is a unit of angle")
    assert len(done.err.strip().splitlines()) == 2


def test_a_longitude_that_is_none(program, trial):
    change(trial / "gnss.csv", "lon", lambda i, v: v + 360.0)
    shown(program, trial, 1, r"gnss\.csv: lon reaches 412")


def test_a_reference_on_another_continent_is_asked_about(program, trial):
    change(trial / "truth.csv", "lat", lambda i, v: v / 57.29578)
    shown(program, trial, 0, r"truth\.csv lies 39\d\d km from gnss\.csv")


def test_depths_above_the_water_are_asked_about(program, trial):
    change(trial / "depth.csv", "depth", lambda i, v: -v)
    shown(program, trial, 0, r"depth\.csv: most depths are negative")


def test_one_row_is_no_fault_of_the_clock(program, tmp_path):
    (tmp_path / "gnss.csv").write_text("time[s],lat[deg],lon[deg]\n1.0,36.7,52.6\n")
    done = program("check", tmp_path / "gnss.csv")
    assert done.status == 0 and "1 row" in done.out and "none found" in done.out
