"""Reading: other names and units are understood and said; what cannot be used gets one clear sentence."""

import gzip
import io
import os

import numpy as np
import pytest

from schuler.ground.errors import InputError
from schuler.io.tables import read_table, write_table

G = 9.81
NAMED = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
FULL = "time[s],gyro_x[rad/s],gyro_y[rad/s],gyro_z[rad/s],accel_x[m/s^2],accel_y[m/s^2],accel_z[m/s^2]"


def swinging(n=2000, dt=0.01):
    """A sensor rolling to and fro under gravity: (time, rates rad/s, specific force m/s^2), consumer noise on top."""
    rng = np.random.default_rng(7)
    t = dt * np.arange(1, n + 1)
    roll = 0.5 * np.sin(1.3 * t)
    gyro = np.column_stack([0.65 * np.cos(1.3 * t), 0 * t, 0 * t]) + rng.normal(0, 2e-3, (n, 3))
    accel = np.column_stack([0 * t, -G * np.sin(roll), -G * np.cos(roll)]) + rng.normal(0, 0.03, (n, 3))
    return t, gyro, accel


def resting(n=2000, dt=0.01, gyro_noise=2e-3, accel_noise=0.03):
    rng = np.random.default_rng(8)
    return (
        dt * np.arange(1, n + 1),
        rng.normal(0, gyro_noise, (n, 3)),
        rng.normal(0, accel_noise, (n, 3)) - [0, 0, G],
    )


def save(path, header, *columns, delimiter=","):
    text = io.StringIO()
    np.savetxt(text, np.column_stack(columns), delimiter=delimiter, header=header, comments="", fmt="%.15g")
    body = text.getvalue().encode()
    path.write_bytes(gzip.compress(body) if path.suffix == ".gz" else body)
    return path


def refused(path, table="imu", **options):
    """The one sentence that a file gets."""
    with pytest.raises(InputError) as caught:
        read_table(path, table, **options)
    sentence = str(caught.value)
    assert "\n" not in sentence and "Traceback" not in sentence and len(sentence) < 500
    return sentence


# ------------------------------------------------------------------------------------------------ what is understood


@pytest.mark.parametrize(
    "header,gyro_factor,accel_factor",
    [
        (FULL, 1.0, 1.0),
        (FULL.replace("rad/s", "deg/s").replace("m/s^2", "g"), 180 / np.pi, 1 / 9.80665),
        ("t_s,gx_radps,gy_radps,gz_radps,ax_mps2,ay_mps2,az_mps2", 1.0, 1.0),
        (
            "Timestamp (s),GyroX (deg/s),GyroY (deg/s),GyroZ (deg/s),AccX (G),AccY (G),AccZ (G)",
            180 / np.pi,
            1 / 9.80665,
        ),
        (
            "#timestamp [s],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
            "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
            1.0,
            1.0,
        ),
    ],
)
def test_names_and_units_in_the_heading(tmp_path, header, gyro_factor, accel_factor):
    t, gyro, accel = swinging()
    path = save(tmp_path / "a.csv", header, t, gyro * gyro_factor, accel * accel_factor)
    table = read_table(path, "imu")
    assert table.kind == "rates" and table.notes == []
    np.testing.assert_allclose(table.stack("gyro_x", "gyro_y", "gyro_z"), gyro, atol=1e-12)
    np.testing.assert_allclose(table.stack("accel_x", "accel_y", "accel_z"), accel, atol=1e-12)


@pytest.mark.parametrize("gyro_unit,gyro_factor", [("rad/s", 1.0), ("deg/s", 180 / np.pi)])
@pytest.mark.parametrize("accel_unit,accel_factor", [("m/s^2", 1.0), ("g", 1 / 9.80665), ("mg", 1e3 / 9.80665)])
def test_units_without_a_heading_are_guessed_by_gravity_and_said(
    tmp_path, gyro_unit, gyro_factor, accel_unit, accel_factor
):
    t, gyro, accel = swinging()
    table = read_table(save(tmp_path / "a.csv", NAMED, t, gyro * gyro_factor, accel * accel_factor), "imu")
    np.testing.assert_allclose(table["gyro_x"], gyro[:, 0], atol=1e-12)
    np.testing.assert_allclose(table["accel_z"], accel[:, 2], atol=1e-9)
    assert any(f"rates in {gyro_unit}, because gravity turns" in n for n in table.notes)
    assert any(f"rates in {accel_unit}, because the median length" in n for n in table.notes)


def test_increments_are_told_from_rates(tmp_path):
    t, gyro, accel = swinging()
    table = read_table(save(tmp_path / "a.csv", NAMED, t, gyro * 0.01, accel * 0.01), "imu")
    assert table.kind == "increments"
    assert set(table.columns) == {"time", *(f"{s}_{a}" for s in ("dtheta", "dv") for a in "xyz")}
    np.testing.assert_allclose(table["dtheta_x"], gyro[:, 0] * 0.01, atol=1e-14)
    named = "time[s],dtheta_x[rad],dtheta_y[rad],dtheta_z[rad],dv_x[m/s],dv_y[m/s],dv_z[m/s]"
    table = read_table(save(tmp_path / "b.csv", named, t, gyro * 0.01, accel * 0.01), "imu")
    assert table.kind == "increments" and table.notes == []


def test_no_heading_at_all(tmp_path):
    t, gyro, accel = swinging()
    first = read_table(save(tmp_path / "a.csv", "", t, gyro, accel), "imu")
    last = read_table(save(tmp_path / "b.txt", "", accel / 9.80665, np.rad2deg(gyro), 1000 * t, delimiter=" "), "imu")
    for table in (first, last):
        np.testing.assert_allclose(table["gyro_x"], gyro[:, 0], atol=1e-12)
        np.testing.assert_allclose(table["accel_y"], accel[:, 1], atol=1e-9)
        np.testing.assert_allclose(table.time, t, atol=1e-9)
        assert any("no header line" in n for n in table.notes)


@pytest.mark.parametrize("factor,unit", [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_time_units(tmp_path, factor, unit, start):
    t, gyro, accel = swinging(500)
    whole = np.round((t + start) * factor, 3) if factor == 1.0 else np.round((t + start) * factor)
    header = "clock_reading," + NAMED.partition(",")[2]
    path = save(tmp_path / "a.csv", header.replace("clock_reading", "timestamp"), whole, gyro, accel)
    table = read_table(path, "imu")
    np.testing.assert_allclose(table.time, t + start, atol=1e-6 if start else 1e-9)
    if unit != "s":
        assert any(f"taken as {unit}" in n for n in table.notes)


def test_dates_as_text(tmp_path):
    (tmp_path / "d.csv").write_text("time,depth[m]\n2024-05-27T09:14:45Z,1\n2024-05-27T09:14:46.5Z,2\n")
    table = read_table(tmp_path / "d.csv", "depth")
    np.testing.assert_allclose(table.time, [1716801285.0, 1716801286.5])


def test_a_rate_may_stand_for_the_time_column(tmp_path):
    _, gyro, accel = swinging(100)
    path = save(tmp_path / "a.csv", FULL.partition(",")[2], gyro, accel)
    assert "rate_hz" in refused(path)
    np.testing.assert_allclose(read_table(path, "imu", rate_hz=50).time[:2], [0.02, 0.04])
    np.testing.assert_allclose(read_table(path, "imu", rate_hz=50, start_s=10).time[0], 10.02)


def test_counts_need_their_value(tmp_path):
    t, gyro, accel = swinging()
    path = save(tmp_path / "a.csv", NAMED, t, np.round(np.rad2deg(gyro) * 16.4), np.round(accel / 9.80665 * 2048))
    assert "raw counts" in refused(path)
    table = read_table(path, "imu", scale_gyro_deg_per_s=1 / 16.4, scale_accel_g=1 / 2048)
    np.testing.assert_allclose(table["accel_z"], accel[:, 2], atol=0.01)
    np.testing.assert_allclose(table["gyro_x"], gyro[:, 0], atol=0.002)


def test_a_person_may_say_the_unit(tmp_path):
    t, gyro, accel = resting(gyro_noise=2e-4, accel_noise=5e-4)
    path = save(tmp_path / "a.csv", NAMED, t, gyro, accel)
    assert "as well as deg/s" in refused(path)
    np.testing.assert_allclose(read_table(path, "imu", gyro_unit="deg/s")["gyro_x"], np.deg2rad(gyro[:, 0]), atol=1e-15)
    assert "wanted" in refused(path, gyro_unit="m") or "expected" in refused(path, gyro_unit="m")


def test_earth_rate_tells_the_unit_of_a_good_gyro(tmp_path):
    t, gyro, accel = resting(gyro_noise=1e-7, accel_noise=1e-4)
    gyro = gyro + [5e-5, 0.0, -5.3e-5]
    table = read_table(save(tmp_path / "a.csv", NAMED, t, np.rad2deg(gyro) * 3600, accel), "imu")
    np.testing.assert_allclose(table["gyro_x"], gyro[:, 0], rtol=1e-9)
    assert any("Earth rate" in n for n in table.notes)


@pytest.mark.parametrize(
    "header,factor",
    [
        ("time[s],lat[deg],lon[deg],height[m]", 1.0),
        ("t,Latitude,Lng,Alt", 1.0),
        ("time[s],lat[rad],lon[rad],alt[m]", np.pi / 180),
        ("time[s],lat[1e-7 deg],lon[1e-7 deg],h", 1e7),
        ("time,lat,lon,height", 1e7),
    ],
)
def test_places(tmp_path, header, factor):
    t = np.arange(10.0)
    lat, lon = 45.0 + 1e-5 * t, -122.0 + 1e-5 * t
    path = save(tmp_path / "g.csv", header, t, lat * factor, lon * factor, 100 + t)
    table = read_table(path, "gnss")
    np.testing.assert_allclose(table["lat"], np.deg2rad(lat), atol=1e-10)
    np.testing.assert_allclose(table["lon"], np.deg2rad(lon), atol=1e-10)


def test_local_metres_do_for_the_plane(tmp_path):
    t = np.arange(5.0)
    table = read_table(save(tmp_path / "g.csv", "time[s],north[m],east[m]", t, 2 * t, 3 * t), "gnss")
    np.testing.assert_array_equal(table["east"], 3 * t)


def test_magnetic_heading_stays_apart(tmp_path):
    t = np.arange(5.0)
    path = save(tmp_path / "a.csv", "time[s],roll[deg],pitch[deg],heading_mag[deg]", t, t, t, 100 + t)
    table = read_table(path, "attitude")
    assert "heading" not in table
    np.testing.assert_allclose(table["heading_mag"], np.deg2rad(100 + t))


def test_a_fix_held_at_the_rate_of_the_imu_is_one_fix(tmp_path):
    t = 0.02 * np.arange(1000)
    lat = 45.0 + 1e-5 * np.floor(t)
    table = read_table(save(tmp_path / "g.csv", "time[s],lat[deg],lon[deg]", t, lat, lat), "gnss")
    assert len(table) == 20
    assert any("repeat the fix" in n for n in table.notes)


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".npz", ".parquet"])
def test_every_kind_of_file(tmp_path, suffix):
    t, gyro, accel = swinging(200)
    source = read_table(save(tmp_path / "a.csv", FULL, t, gyro, accel), "imu")
    back = read_table(write_table(tmp_path / f"b{suffix}", source), "imu")
    for name, values in source.columns.items():
        np.testing.assert_array_equal(back[name], values)


def test_semicolons_with_decimal_commas(tmp_path):
    (tmp_path / "g.csv").write_text("time[s];lat[deg];lon[deg]\n0,5;51,25;3,5\n1,5;51,25;3,5\n")
    table = read_table(tmp_path / "g.csv", "gnss")
    np.testing.assert_allclose(np.rad2deg(table["lat"]), 51.25)


# ------------------------------------------------------------------------------------------------- what is left out


def test_rows_with_holes_are_left_out_and_counted(tmp_path):
    (tmp_path / "d.csv").write_text("time[s],depth[m],std_depth[m]\n1,5,0.1\n2,,0.1\n3,nan,0.1\n4,6,\n")
    table = read_table(tmp_path / "d.csv", "depth")
    np.testing.assert_array_equal(table.time, [1.0, 4.0])
    assert any("2 of 4 rows left out" in n and "line 3" in n for n in table.notes)
    assert any("std_depth is not known in 1 of 2" in n for n in table.notes)


def test_a_sigma_of_minus_one_is_unknown(tmp_path):
    (tmp_path / "d.csv").write_text("time[s],depth[m],std_depth[m]\n1,5,-1\n2,5,0.2\n")
    table = read_table(tmp_path / "d.csv", "depth")
    assert np.isnan(table["std_depth"][0]) and table["std_depth"][1] == 0.2
    (tmp_path / "e.csv").write_text("time[s],depth[m],std_depth[m]\n1,5,-1\n2,5,-1\n")
    assert "std_depth" not in read_table(tmp_path / "e.csv", "depth")


def test_repeated_times_keep_the_first_row(tmp_path):
    (tmp_path / "d.csv").write_text("time[s],depth[m]\n1,5\n2,6\n2,7\n3,8\n")
    table = read_table(tmp_path / "d.csv", "depth")
    np.testing.assert_array_equal(table["depth"], [5.0, 6.0, 8.0])
    assert any("1 row left out" in n and "line 4" in n for n in table.notes)


def test_the_end_of_the_gps_week(tmp_path):
    tow = np.array([604798.0, 604799.0, 0.0, 1.0])
    table = read_table(save(tmp_path / "d.csv", "tow,depth[m]", tow, 0 * tow), "depth")
    np.testing.assert_array_equal(np.diff(table.time), 1.0)
    assert any("week rolled over at line 4" in n for n in table.notes)
    unix = np.array([1.2e9, 1.2e9 + 1, 1.2e9 + 2 - 1024 * 604800, 1.2e9 + 3 - 1024 * 604800])
    table = read_table(save(tmp_path / "e.csv", "time[s],depth[m]", unix, 0 * tow), "depth")
    np.testing.assert_array_equal(np.diff(table.time), 1.0)


@pytest.mark.parametrize("gap", [59.0, 61.0, 3600.0, 86000.0])
def test_the_end_of_the_gps_week_in_a_gap(tmp_path, gap):
    """Up to a day: the time that passed is what the clock shows when the week is counted on."""
    tow = np.array([604797.0, 604798.0, 604799.0, gap - 1.0, gap, gap + 1.0])
    table = read_table(save(tmp_path / "d.csv", "tow,depth[m]", tow, 0 * tow), "depth")
    np.testing.assert_array_equal(np.diff(table.time), [1.0, 1.0, gap, 1.0, 1.0])
    (said,) = [n for n in table.notes if "week rolled over at line 5" in n]
    assert (f"with a gap of {gap:g} s at line 5" in said) == (gap > 60.0)
    # a clock that does not count from the week's start
    table = read_table(save(tmp_path / "e.csv", "time[s],depth[m]", tow + 100.5, 0 * tow), "depth")
    assert np.diff(table.time)[2] == gap
    # two weeks' ends, each in a gap
    true = 5e5 + np.arange(0.0, 8e5, 100.0)
    true = true[(true % 604800.0 > gap) & (true % 604800.0 < 604700.0)]
    table = read_table(save(tmp_path / "f.csv", "time[s],depth[m]", true % 604800.0, 0 * true), "depth")
    np.testing.assert_array_equal(table.time, true)


def test_a_clock_that_goes_back_by_days_is_no_rollover(tmp_path):
    """More than a day short of a week may be anything; and rows out of order go forth as far as they go back."""
    tow = np.array([604798.0, 604799.0, 2 * 86400.0, 2 * 86400.0 + 1.0])
    with pytest.raises(InputError, match="time goes back at line 4"):
        read_table(save(tmp_path / "d.csv", "tow,depth[m]", tow, 0 * tow), "depth")
    mixed = np.array([1.0, 2.0, 600001.0, 3.0, 600002.0, 4.0])
    with pytest.raises(InputError, match="time goes back at line 5"):
        read_table(save(tmp_path / "e.csv", "time[s],depth[m]", mixed, 0 * mixed), "depth")
    ids = np.full(6, 7.0)
    table = read_table(save(tmp_path / "r.csv", "time[s],id,range[m]", mixed, ids, ids), "ranges")
    np.testing.assert_array_equal(table.time, np.sort(mixed))


def test_a_cut_last_line_is_left_out(tmp_path):
    (tmp_path / "d.csv").write_text("time[s],depth[m],std_depth[m]\n1,5,1\n2,6,1\n3,")
    table = read_table(tmp_path / "d.csv", "depth")
    assert len(table) == 2 and any("cut off" in n for n in table.notes)


def test_gaps_of_an_imu_are_said(tmp_path):
    t, gyro, accel = swinging()
    t = np.where(t > 10, t + 3.0, t)
    table = read_table(save(tmp_path / "a.csv", FULL, t, gyro, accel), "imu")
    assert any("a gap of 3.01 s after 10.000 s" in n for n in table.notes)


def test_ranges_out_of_order_are_sorted(tmp_path):
    (tmp_path / "r.csv").write_text("time[s],beacon_id,range_m\n1,5,10\n3,5,11\n2,6,12\n3,6,13\n")
    table = read_table(tmp_path / "r.csv", "ranges")
    np.testing.assert_array_equal(table.time, [1.0, 2.0, 3.0, 3.0])
    assert list(table["id"]) == ["5", "6", "5", "6"]
    assert any("out of order" in n for n in table.notes)


# --------------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    "content,word",
    [
        (b"", "empty"),
        (b"\n\n \n", "blank"),
        (b"# only\n# remarks\n", "remarks"),
        (FULL.encode() + b"\n", "only a header"),
        (bytes(range(256)) * 20, "binary"),
        (b"ULog\x01\x12\x35" + bytes(50), "PX4 ULog"),
        (b"$GPGGA,1,2*00\n" * 5, "NMEA"),
        (b"PK\x03\x04 not really", "damaged"),
        (b"PAR1 not really", "damaged"),
        (FULL.encode() + b"\n1,2,3\n" * 9, "line 2 has 3 columns where 7"),
        (b"name,colour\nred,blue\n", "missing"),
        (gzip.compress(FULL.encode() + os.urandom(2000))[:200], "ends early"),
    ],
)
def test_broken_files_get_one_sentence(tmp_path, content, word):
    (tmp_path / "x.csv").write_bytes(content)
    assert word in refused(tmp_path / "x.csv")


def test_wrong_kinds_of_path(tmp_path):
    assert "no such file" in refused(tmp_path / "none.csv")
    assert "folder" in refused(tmp_path)
    (tmp_path / "x.npz").write_text("words")
    assert "not" in refused(tmp_path / "x.npz")
    assert "no table named" in refused(save(tmp_path / "y.csv", "a", np.zeros(2)), "sonar")


def test_pickled_arrays_are_never_loaded(tmp_path):
    np.savez(tmp_path / "x.npz", **{"time[s]": np.arange(3.0), "depth[m]": np.array([{}, {}, {}], dtype=object)})
    assert "missing" in refused(tmp_path / "x.npz", "depth")


@pytest.mark.parametrize(
    "gyro_factor,accel_factor,word",
    [
        (1.0, 1 / 9.80665, "--accel-unit g"),
        (180 / np.pi, 1.0, "--gyro-unit deg/s"),
        (0.01, 0.01, "increments"),
        (1.0, 1e-3, "gravity may have been removed"),
        (1.0, 209.0, "far from gravity"),
    ],
)
def test_numbers_that_speak_against_their_heading(tmp_path, gyro_factor, accel_factor, word):
    t, gyro, accel = swinging()
    path = save(tmp_path / "a.csv", FULL, t, gyro * gyro_factor, accel * accel_factor)
    assert word in refused(path)
    assert read_table(path, "imu", trust_units=True)["accel_z"][0] == pytest.approx(accel[0, 2] * accel_factor)


def test_radians_under_a_heading_of_degrees(tmp_path):
    t, gyro, accel = swinging()
    path = save(tmp_path / "a.csv", FULL.replace("rad/s", "deg/s"), t, gyro, accel)
    assert "--gyro-unit rad/s" in refused(path)
    np.testing.assert_allclose(read_table(path, "imu", gyro_unit="rad/s")["gyro_x"], gyro[:, 0])  # a person is believed


@pytest.mark.parametrize(
    "header,word",
    [
        (FULL.replace("gyro_x[rad/s]", "gyro_x[rads/s]"), "did you mean rad/s"),
        (FULL.replace("gyro_x[rad/s]", "gyro_x[m]"), "is a unit of length"),
        (FULL.replace("gyro_x[rad/s]", "gyro_x[deg/s]"), "different units"),
        (FULL.replace("accel_z[m/s^2]", "spare"), "accel_z[m/s^2]"),
        (FULL.replace("time[s]", "time[min]"), "time"),
    ],
)
def test_wrong_headings(tmp_path, header, word):
    t, gyro, accel = swinging()
    assert word in refused(save(tmp_path / "a.csv", header, t, gyro, accel))


@pytest.mark.parametrize(
    "table,header,values,word",
    [
        ("gnss", "time[s],lat[rad],lon[rad]", (51.0, 3.0), "these are probably degrees"),
        ("gnss", "time[s],lat,lon", (0.9, 0.1), "degrees as well as radians"),
        ("gnss", "time[s],lat[deg],lon[deg]", (95.0, 3.0), "more than is possible"),
        ("gnss", "time[s],lat,lon", (5139.27, 12807.5), "ddmm"),
        ("attitude", "time[s],roll[rad],pitch[rad],heading[rad]", (3.0, 4.0, 270.0), "these are probably degrees"),
        ("attitude", "time[s],roll,pitch,heading", (0.1, 0.2, 0.3), "degrees as well as radians"),
        ("depth", "time[s],depth[m]", (np.nan,), "holds no number"),
        ("depth", "time,depth[m]", (5.0,), "milliseconds"),
    ],
)
def test_doubtful_values(tmp_path, table, header, values, word):
    t = np.arange(60.0) * (100.0 if word == "milliseconds" else 1.0)
    path = save(tmp_path / "x.csv", header, t, *(np.full(60, v) for v in values))
    assert word in refused(path, table)


def test_time_going_back_names_the_line(tmp_path):
    (tmp_path / "d.csv").write_text("time[s],depth[m]\n1,5\n2,6\n1.5,7\n3,8\n")
    assert "line 4, from 2.000000 to 1.500000" in refused(tmp_path / "d.csv", "depth")


def test_rates_and_increments_do_not_mix(tmp_path):
    t, gyro, accel = swinging()
    header = FULL.replace("accel_x[m/s^2],accel_y[m/s^2],accel_z[m/s^2]", "dv_x[m/s],dv_y[m/s],dv_z[m/s]")
    assert "dtheta_x[rad]" in refused(save(tmp_path / "a.csv", header, t, gyro, accel * 0.01))


def test_missing_parquet_reader_is_said(tmp_path, monkeypatch):
    import sys

    (tmp_path / "x.parquet").write_bytes(b"PAR1" + bytes(20))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert 'pip install "schuler[io]"' in refused(tmp_path / "x.parquet")
