"""convert on tiny made recordings of each format: values, signs, notes, and an OUT that is whole or absent."""

import gzip
import json

import numpy as np
import pytest

from schuler.ground.earth import C_en, ecef_from_geodetic
from schuler.ground.errors import InputError, StudyError
from schuler.ground.frames import dcm_from_euler, quat_from_dcm
from schuler.ground.units import DEG, KNOT
from schuler.io.convert import convert
from schuler.io.tables import read_table


def lines(path, header, rows):
    text = "\n".join([header, *(",".join(map(str, r)) for r in rows)]) + "\n"
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())


def fewer(path):
    """What stands beside a result: nothing may be left over."""
    return sorted(p.name for p in path.iterdir())


# -------------------------------------------------------------------------------------------------------- seaglider


def seaglider_set(folder, number, start, fixes, variation=-1.5, hpe=-1.0):
    lines(
        folder / f"dive{number}_eng.csv.gz",
        "t_unix,depth_m,heading_mag_deg,pitch_deg,roll_deg,mag_x,mag_y,mag_z,vbd_cc",
        [(start + 10 * k, k, 1.0 + k, -20.0, 2.0, 0, 0, 0, 0) for k in range(5)],
    )
    lines(
        folder / f"dive{number}_flightmodel.csv.gz",
        "t_unix,depth_m,speed_mps,horz_speed_mps,vert_speed_mps,lat_dr_deg,lon_dr_deg",
        [(start, 0, "", "", "", 12, 85), *((start + 10 * k, k, 0.25, 0.2, 0.15, 12, 85) for k in range(1, 5))],
    )
    lines(
        folder / f"dive{number}_gps.csv",
        "t_unix,lat_deg,lon_deg,hdop,hpe_m,drift_speed_kn,drift_heading_deg",
        [(t, 12 + 0.001 * k, 85, 1.2, hpe, -1, -1) for k, t in enumerate(fixes)],
    )
    lines(
        folder / f"dive{number}_meta.csv", "dive,start_time_unix,magnetic_variation_deg", [(number, start, variation)]
    )


def test_seaglider_dives_become_one_mission(tmp_path):
    """Any order, any numbers, shared fixes; heading true; gaps stay gaps; no reference."""
    raw = tmp_path / "raw"
    raw.mkdir()
    seaglider_set(raw, 9, 5000.0, [4100.0, 4900.0, 5100.0])
    seaglider_set(raw, 312, 4000.0, [3800.0, 3900.0, 4100.0], hpe=3.0)
    report = convert(raw, tmp_path / "out")
    assert report.format == "seaglider"
    assert fewer(tmp_path / "out") == ["attitude.csv", "conversion.json", "depth.csv", "gnss.csv", "speed.csv"]
    gnss = read_table(tmp_path / "out" / "gnss.csv", "gnss")
    np.testing.assert_array_equal(gnss.time, [3800.0, 3900.0, 4100.0, 4900.0, 5100.0])
    np.testing.assert_allclose(gnss["std_north"], [3.0, 3.0, 3.0, 6.0, 6.0])  # hpe; 5 m times HDOP 1.2
    attitude = read_table(tmp_path / "out" / "attitude.csv", "attitude")
    np.testing.assert_allclose(attitude["heading"][:2] / DEG, [359.5, 0.5])  # 1 - 1.5, 2 - 1.5
    np.testing.assert_allclose(attitude["pitch"] / DEG, -20.0)
    assert attitude.time[4] == 4040.0 and attitude.time[5] == 5000.0
    speed = read_table(tmp_path / "out" / "speed.csv", "speed")
    assert len(speed) == 8
    np.testing.assert_array_equal(speed["speed"], 0.25)
    for word in ("2 dives (9, 312)", "variation of -1.5 deg", "flight model"):
        assert any(word in n for n in report.notes), word
    assert json.loads((tmp_path / "out" / "conversion.json").read_text())["notes"] == report.notes


def test_seaglider_without_variation_or_fix(tmp_path):
    seaglider_set(tmp_path, 1, 0.0, [0.0, 1.0, 2.0])
    (tmp_path / "dive1_meta.csv").unlink()
    assert any("heading is magnetic" in n for n in convert(tmp_path, tmp_path / "out").notes)
    lines(tmp_path / "dive1_gps.csv", "t_unix,lat_deg,lon_deg,hdop,hpe_m", [(0, "nan", "nan", 99, -1)] * 3)
    with pytest.raises(InputError, match="valid GPS fix"):
        convert(tmp_path, tmp_path / "out2")
    assert not (tmp_path / "out2").exists()


def test_seaglider_file_of_the_older_netcdf(tmp_path):
    from scipy.io import netcdf_file

    with netcdf_file(str(tmp_path / "p0420007.nc"), "w") as f:
        for dimension, size in (("data", 4), ("fix", 3), ("one", 1)):
            f.createDimension(dimension, size)
        for name, dimension, values in (
            ("time", "data", np.arange(4.0)),
            ("depth", "data", np.arange(4.0)),
            ("eng_head", "data", np.full(4, 90.0)),
            ("eng_pitchAng", "data", np.full(4, -20.0)),
            ("eng_rollAng", "data", np.zeros(4)),
            ("ctd_time", "data", np.arange(4.0)),
            ("speed", "data", np.full(4, 25.0)),  # cm/s
            ("log_gps_time", "fix", np.arange(3.0)),
            ("log_gps_lat", "fix", np.full(3, 10.0)),
            ("log_gps_lon", "fix", np.full(3, 20.0)),
            ("magnetic_variation", "one", np.array([10.0])),
        ):
            f.createVariable(name, "d", (dimension,))[:] = values
    report = convert(tmp_path / "p0420007.nc", tmp_path / "out")
    assert any("1 dive (7)" in n for n in report.notes)
    assert read_table(tmp_path / "out/attitude.csv", "attitude")["heading"][0] == pytest.approx(100.0 * DEG)
    assert read_table(tmp_path / "out/speed.csv", "speed")["speed"][0] == pytest.approx(0.25)


# ------------------------------------------------------------------------------------------------------ seaexplorer

GLI = "Timestamp;NavState;SecurityLevel;Heading;Declination;Pitch;Roll;Depth;Temperature;Pa;Lat;Lon;Altitude;"


def gli(folder, number, rows):
    text = GLI + "\n" + "".join(f"{t};{s};0;{h};17;-20;1;{z};10;1;{lat};{lon};-1;\n" for t, s, h, z, lat, lon in rows)
    (folder / f"sea035.10.gli.sub.{number}.gz").write_bytes(gzip.compress(text.encode()))


def test_seaexplorer_fixes_only_where_the_surface_position_is_new(tmp_path):
    raw = tmp_path / "raw"
    raw.mkdir()
    gli(
        raw,
        2,
        [
            ("13/06/2019 17:00:00", 115, 350, 1, 5139.272, -12807.587),  # still the old fix
            ("13/06/2019 17:00:20", 116, 350, 0, 5139.272, -12807.587),  # at the surface, still the old one
            ("13/06/2019 17:00:40", 116, 350, 0, 5140.000, -12806.000),
        ],
    )
    gli(
        raw,
        1,
        [
            ("13/06/2019 16:33:13", 116, 10, 0, 5139.270, -12807.590),  # may be old: nothing before it
            ("13/06/2019 16:33:33", 116, 10, 0, 5139.272, -12807.587),
            ("13/06/2019 16:40:00", 117, 10, 50, 5139.272, -12807.587),
            ("01/01/1998 00:00:00", 117, 10, 50, 0, 0),  # clock not set
        ],
    )
    report = convert(raw, tmp_path / "out")
    assert report.format == "seaexplorer" and report.rows == {"attitude": 6, "depth": 6, "gnss": 2}
    gnss = read_table(tmp_path / "out/gnss.csv", "gnss")
    np.testing.assert_allclose(gnss["lat"] / DEG, [51 + 39.272 / 60, 51 + 40 / 60])
    np.testing.assert_allclose(gnss["lon"] / DEG, [-(128 + 7.587 / 60), -(128 + 6 / 60)])
    assert gnss.time[0] == 1560443613.0
    heading = read_table(tmp_path / "out/attitude.csv", "attitude")["heading"]
    np.testing.assert_allclose(heading[[0, -1]] / DEG, [27.0, 7.0])  # with the declination of 17 deg
    assert any("Declination of 17 deg" in n for n in report.notes)
    assert any("clock that was not set" in n for n in report.notes)
    as_is = convert(raw, tmp_path / "out2", heading_includes_declination=True)
    assert read_table(tmp_path / "out2/attitude.csv", "attitude")["heading"][0] == pytest.approx(10.0 * DEG)
    assert any("as it stands" in n for n in as_is.notes)


# -------------------------------------------------------------------------------------------------------- comma2k19


def comma(folder):
    t = np.arange(20) * 0.05
    lat, lon, height, rpy = 0.66, -2.14, 30.0, (0.02, -0.03, 1.1)
    v_n = np.array([3.0, 6.0, -0.5])
    C_e = C_en(lat, lon)
    q = quat_from_dcm(C_e @ dcm_from_euler(*rpy))
    pose = np.concatenate([ecef_from_geodetic(lat, lon, height), q, C_e @ v_n])
    names = "x_ecef_m,y_ecef_m,z_ecef_m,qw,qx,qy,qz,vx_ecef_mps,vy_ecef_mps,vz_ecef_mps"
    lines(folder / "reference.csv", f"t_s,gps_week,gps_tow_s,{names}", [(x, 2012, 404106.0, *pose) for x in t])
    lines(folder / "speed.csv.gz", "t_s,speed_mps", [(x, 6.7) for x in t])
    lines(
        folder / "gnss_ublox.csv",
        "t_s,lat_deg,lon_deg,speed_mps,utc_unix_ms,alt_m,bearing_deg",
        [(x, 37.7, -122.4, 5.0, 1.5e12 + 1e3 * x, 31, 36.87) for x in t],
    )
    lines(
        folder / "imu.csv",
        "t_s,ax_mps2,ay_mps2,az_mps2,gx_raw_radps,gy_raw_radps,gz_raw_radps,gx_cal_radps,gy_cal_radps,gz_cal_radps",
        [(x, 0, 0, -9.8, 0.11, 0.12, 0.13, 0.01, 0.02, 0.03) for x in t],
    )
    return lat, lon, height, rpy, v_n


def test_comma_pose_becomes_position_velocity_and_attitude(tmp_path):
    raw = tmp_path / "raw"
    raw.mkdir()
    lat, lon, height, rpy, v_n = comma(raw)
    report = convert(raw, tmp_path / "out")
    assert report.format == "comma2k19" and set(report.rows) == {"imu", "gnss", "speed", "reference"}
    r = read_table(tmp_path / "out/reference.csv", "reference")
    np.testing.assert_allclose([r["lat"][0], r["lon"][0]], [lat, lon], atol=1e-12)
    np.testing.assert_allclose(r["height"], height, atol=1e-6)
    np.testing.assert_allclose(r.stack("v_north", "v_east", "v_down")[0], v_n, atol=1e-9)
    np.testing.assert_allclose(r.stack("roll", "pitch", "heading")[0], rpy, atol=1e-9)
    g = read_table(tmp_path / "out/gnss.csv", "gnss")
    np.testing.assert_allclose([g["v_north"][0], g["v_east"][0]], [4.0, 3.0], atol=1e-4)
    assert g.time[1] == 0.05  # the device's clock, not UTC
    assert "utc_unix_ms" in (tmp_path / "out/gnss.csv").read_text().splitlines()[0]
    assert read_table(tmp_path / "out/imu.csv", "imu")["gyro_z"][0] == 0.03
    convert(raw, tmp_path / "raw2", gyro="raw")
    assert read_table(tmp_path / "raw2/imu.csv", "imu")["gyro_z"][0] == 0.13


# ------------------------------------------------------------------------------------------------------------- nmea


def sentence(body):
    total = 0
    for character in body:
        total ^= ord(character)
    return f"${body}*{total:02X}\r\n"


def test_nmea_over_midnight_with_noise_between(tmp_path):
    text = (
        b"\xb5b\x01\x07junk"
        + "".join(
            [
                sentence("GNRMC,235958.00,A,5330.00000,N,00215.00000,W,10.0,90.0,310524,,,A"),
                sentence("GNGGA,235958.00,5330.00000,N,00215.00000,W,1,08,1.1,40.0,M,48.0,M,,"),
                sentence("GNGST,235958.00,1.5,,,,2.0,3.0,4.0"),
                sentence("GNGGA,235959.00,5330.60000,N,00215.00000,W,1,08,1.1,40.0,M,48.0,M,,"),
                "$GNGGA,235959.50,5330.60000,N,00215.00000,W,1,08,1.1,40.0,M,48.0,M,,*00\r\n",  # bad checksum
                sentence("GNGGA,000000.00,5331.20000,N,00215.00000,W,1,08,1.1,40.0,M,48.0,M,,"),
                sentence("GNGGA,000001.00,,,,,0,00,99.9,,M,,M,,"),  # no fix
            ]
        ).encode()
    )
    (tmp_path / "a.nmea").write_bytes(text)
    report = convert(tmp_path / "a.nmea", tmp_path / "gnss.csv")
    g = read_table(tmp_path / "gnss.csv", "gnss")
    midnight = 1717200000.0  # 2024-06-01
    np.testing.assert_array_equal(g.time, midnight + np.array([-2.0, -1.0, 0.0]))
    np.testing.assert_allclose(g["lat"] / DEG, [53.5, 53.51, 53.52])
    np.testing.assert_allclose(g["height"], 88.0)
    np.testing.assert_allclose([g["v_north"][0], g["v_east"][0]], [0.0, 10.0 * KNOT], atol=1e-12)
    assert np.isnan(g["v_east"][1]) and g["std_east"][0] == 3.0
    assert any("1 with a bad checksum" in n for n in report.notes)


def test_nmea_without_fix_or_date(tmp_path):
    (tmp_path / "a.log").write_text(sentence("GNGGA,000001.00,,,,,0,00,99.9,,M,,M,,"))
    with pytest.raises(InputError, match="no valid fix"):
        convert(tmp_path / "a.log", tmp_path / "gnss.csv")
    (tmp_path / "b.log").write_text(sentence("GPGLL,4916.45,N,12311.12,W,225444.00,A,A"))
    report = convert(tmp_path / "b.log", tmp_path / "gnss.csv")
    assert any("seconds of the day" in n for n in report.notes)


# ----------------------------------------------------------------------------------------------------------- matlab


def test_navego_structures_and_plain_variables(tmp_path):
    from scipy.io import savemat

    rng = np.random.default_rng(2)
    n = 500
    t = 0.01 * np.arange(n)
    roll = 0.5 * np.sin(1.3 * t)
    wb = np.column_stack([0.65 * np.cos(1.3 * t), 0 * t, 0 * t]) + rng.normal(0, 1e-3, (n, 3))
    fb = np.column_stack([0 * t, -9.8 * np.sin(roll), -9.8 * np.cos(roll)]) + rng.normal(0, 0.02, (n, 3))
    fixes = {
        "t": np.arange(5.0)[:, None],
        "lat": np.full((5, 1), 0.7),
        "lon": np.full((5, 1), 0.2),
        "h": np.full((5, 1), 50.0),
        "vel": np.tile([1.0, 2.0, 3.0], (5, 1)),
        "stdm": np.array([1.0, 1.0, 2.0]),
    }
    imu = {"t": t[:, None], "wb": wb, "fb": fb, "freq": 100.0, "ini_align": np.zeros(3)}
    savemat(tmp_path / "navego.mat", {"imu1": imu, "gnss": fixes})
    report = convert(tmp_path / "navego.mat", tmp_path / "out")
    assert report.rows == {"imu": n, "gnss": 5}
    np.testing.assert_allclose(read_table(tmp_path / "out/imu.csv", "imu")["gyro_x"], wb[:, 0])
    g = read_table(tmp_path / "out/gnss.csv", "gnss")
    np.testing.assert_allclose([g["lat"][0], g["v_east"][0]], [0.7, 2.0])
    savemat(tmp_path / "plain.mat", {"time": t, "gyro": wb, "accel": fb})
    convert(tmp_path / "plain.mat", tmp_path / "imu.csv")
    np.testing.assert_allclose(read_table(tmp_path / "imu.csv", "imu")["accel_z"], fb[:, 2])


def test_damaged_matlab_file(tmp_path):
    (tmp_path / "x.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    with pytest.raises(InputError, match="damaged"):
        convert(tmp_path / "x.mat", tmp_path / "out")
    assert fewer(tmp_path) == ["x.mat"]


# ---------------------------------------------------------------------------------------------------- plain tables


def imu_csv(path, gyro_factor=1.0):
    n = 600
    t = 0.01 * np.arange(n)
    roll = 0.5 * np.sin(1.3 * t)
    columns = np.column_stack(
        [t, 0.65 * np.cos(1.3 * t) * gyro_factor, 0 * t, 0 * t, 0 * t, -9.8 * np.sin(roll), -9.8 * np.cos(roll)]
    )
    header = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
    np.savetxt(path, columns, delimiter=",", header=header, comments="", fmt="%.9g")


def test_units_by_option_and_by_guess(tmp_path):
    imu_csv(tmp_path / "raw.csv", 1 / DEG)
    convert(tmp_path / "raw.csv", tmp_path / "a" / "imu.csv", gyro_unit="deg/s", accel_unit="m/s^2")
    convert(tmp_path / "raw.csv", tmp_path / "b")
    a, b = (read_table(p, "imu") for p in (tmp_path / "a/imu.csv", tmp_path / "b/imu.csv"))
    assert a["gyro_x"][0] == pytest.approx(0.65) == b["gyro_x"][0]
    assert (tmp_path / "b/imu.csv").read_text().startswith("time[s],gyro_x[rad/s],")


def test_one_file_with_several_tables(tmp_path):
    t = 0.02 * np.arange(500)
    columns = np.column_stack(
        [t, 0 * t + 0.01, 0 * t, 0 * t, 0 * t, 0 * t, 0 * t - 9.8, 45 + 1e-6 * t, 7 + 1e-6 * t, t, t]
    )
    header = (
        "time[s],gyro_x[rad/s],gyro_y[rad/s],gyro_z[rad/s],accel_x[m/s^2],accel_y[m/s^2],accel_z[m/s^2],lat_deg,lon_deg,"
        "alt_m,depth_m"
    )
    np.savetxt(tmp_path / "all.csv", columns, delimiter=",", header=header, comments="")
    assert set(convert(tmp_path / "all.csv", tmp_path / "out").rows) == {"imu", "gnss", "depth"}
    one = convert(tmp_path / "all.csv", tmp_path / "gnss.npz")
    assert one.rows == {"gnss": 500} and one.files == [tmp_path / "gnss.npz"]


def test_phone_sensors_get_one_clock(tmp_path):
    raw = tmp_path / "phone"
    raw.mkdir()
    t = 0.02 * np.arange(200)
    lines(raw / "gyro.csv", "t_s,gx_radps,gy_radps,gz_radps", [(x, x, 0, 0) for x in t])
    lines(raw / "acc.csv", "t_s,ax_mps2,ay_mps2,az_mps2", [(x + 0.01, x + 0.01, 0, -9.8) for x in t])
    report = convert(raw, tmp_path / "out")
    imu = read_table(tmp_path / "out/imu.csv", "imu")
    assert len(imu) == 199
    np.testing.assert_allclose(imu["accel_x"], imu.time, atol=1e-12)
    np.testing.assert_allclose(imu["gyro_x"], imu.time, atol=1e-12)
    assert any("interpolated" in n for n in report.notes)


# ---------------------------------------------------------------------------------------------------------- the OUT


def test_a_result_is_replaced_and_foreign_files_are_not(tmp_path):
    seaglider_set(tmp_path, 1, 0.0, [0.0, 1.0, 2.0])
    out = tmp_path / "out"
    convert(tmp_path, out)
    (out / "study.toml").write_text("[study]\n")
    (tmp_path / "dive1_flightmodel.csv.gz").unlink()
    convert(tmp_path, out)
    assert fewer(out) == ["attitude.csv", "conversion.json", "depth.csv", "gnss.csv", "study.toml"]
    other = tmp_path / "other"
    other.mkdir()
    (other / "depth.csv").write_text("mine")
    with pytest.raises(InputError, match="no conversion has written"):
        convert(tmp_path, other)
    assert fewer(other) == ["depth.csv"] and (other / "depth.csv").read_text() == "mine"


def test_nothing_is_left_when_writing_fails(tmp_path, monkeypatch):
    from schuler.io import convert as module

    seaglider_set(tmp_path, 1, 0.0, [0.0, 1.0, 2.0])
    before = fewer(tmp_path)
    real, calls = module.write_table, []

    def third_fails(path, table):
        calls.append(path)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        return real(path, table)

    monkeypatch.setattr(module, "write_table", third_fails)
    with pytest.raises(InputError, match="No space left"):
        convert(tmp_path, tmp_path / "out")
    assert fewer(tmp_path) == before


def test_faults_of_the_call_are_reported_together(tmp_path):
    with pytest.raises(StudyError) as caught:
        convert(tmp_path, tmp_path / "out", gyro_unit="furlong", accel_unit="deg/s", format="fax", table="sonar")
    assert len(caught.value.faults) == 4
    with pytest.raises(InputError, match="no such file"):
        convert(tmp_path / "none", tmp_path / "out")
    imu_csv(tmp_path / "imu.csv")
    with pytest.raises(InputError, match="replace the recording itself"):
        convert(tmp_path / "imu.csv", tmp_path / "imu.csv")
    with pytest.raises(StudyError, match="no option"):
        seaglider_set(tmp_path, 1, 0.0, [0.0, 1.0, 2.0])
        convert(tmp_path, tmp_path / "out", colour="red")


def test_many_tables_do_not_fit_into_one_file(tmp_path):
    seaglider_set(tmp_path, 1, 0.0, [0.0, 1.0, 2.0])
    with pytest.raises(InputError, match="give a folder as OUT"):
        convert(tmp_path, tmp_path / "all.csv")
    assert not (tmp_path / "all.csv").exists()
    with pytest.raises(InputError, match="written as .csv"):
        convert(tmp_path, tmp_path / "all.mat")
    report = convert(tmp_path, tmp_path / "depth.csv")
    assert any("not written: attitude, speed, gnss" in n for n in report.notes)
