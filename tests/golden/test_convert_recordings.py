"""Real recordings through convert, check and the readers: row counts, places, times and units that must not move."""

import numpy as np
import pytest

from schuler.ground.earth import displacement_n
from schuler.ground.tables import validate
from schuler.ground.units import DEG
from schuler.io.check import check, render
from schuler.io.convert import convert
from schuler.io.tables import read_table

pytestmark = pytest.mark.data


def tables_of(folder, report):
    return {name: read_table(folder / f"{name}.csv", name) for name in report.rows}


def miss(table, i, j):
    return displacement_n(
        *(table[k][j] for k in ("lat", "lon", "height")), *(table[k][i] for k in ("lat", "lon", "height"))
    )


def test_seaglider_mission_of_five_dives(data_folder, tmp_path):
    source = data_folder / "glider_seaglider_sg171"
    report = convert(source, tmp_path / "out")
    assert report.rows == {"attitude": 3701, "depth": 3701, "speed": 3772, "gnss": 11}
    t = tables_of(tmp_path / "out", report)
    assert all(validate(x) == [] for x in t.values())
    assert t["gnss"].time[0] == 1716800716.0 and t["gnss"].time[-1] == 1716831851.0
    # the displacement over dive 100 as the basestation has it, on a sphere (0.6 % of it lies between the two)
    d = np.ravel(miss(t["gnss"], 1, 2))
    np.testing.assert_allclose(d[:2], [604.838, 979.583], rtol=8e-3)
    assert t["depth"]["depth"].max() == pytest.approx(505, abs=3)
    assert t["attitude"]["heading"][0] / DEG == pytest.approx(142.5 - 1.2)
    assert np.diff(t["attitude"].time).max() > 400  # the surface legs stay gaps
    assert "reference" not in t


def test_seaglider_netcdf_agrees_with_its_tables(data_folder, tmp_path):
    source = data_folder / "glider_seaglider_sg171"
    report = convert(source / "p1710100.nc", tmp_path / "nc")
    assert report.rows == {"attitude": 721, "depth": 721, "speed": 646, "gnss": 3}
    convert(source, tmp_path / "csv")
    for name, column, tolerance in (
        ("attitude", "heading", 1e-12),
        ("attitude", "pitch", 1e-12),
        ("depth", "depth", 0.3),  # the netCDF depth is corrected for latitude
        ("speed", "speed", 1e-6),
        ("gnss", "lat", 1e-8),
    ):
        a = read_table(tmp_path / "nc" / f"{name}.csv", name)
        b = read_table(tmp_path / "csv" / f"{name}.csv", name)
        n = len(a)
        np.testing.assert_allclose(a.time, b.time[:n], atol=1e-6)
        np.testing.assert_allclose(a[column], b[column][:n], atol=tolerance)


def test_seaexplorer(data_folder, tmp_path):
    report = convert(data_folder / "glider_seaexplorer_m010", tmp_path / "out")
    assert report.rows == {"attitude": 14027, "depth": 14027, "gnss": 1875}
    t = tables_of(tmp_path / "out", report)
    np.testing.assert_allclose(
        [t["gnss"]["lat"][0] / DEG, t["gnss"]["lon"][0] / DEG], [51.65455, -128.1261833], atol=1e-6
    )
    assert t["attitude"]["heading"][0] / DEG == pytest.approx(149.16 + 17)
    assert t["depth"]["depth"].max() == pytest.approx(204, abs=1)


def test_raw_seaexplorer_files_give_the_same(data_folder, tmp_path):
    """The glider's own files (semicolons, dates, ddmm.mmm), made here from the table, and the table agree."""
    import gzip

    source = data_folder / "glider_seaexplorer_m010" / "nav.csv.gz"
    rows = [r.split(",") for r in gzip.decompress(source.read_bytes()).decode().splitlines()]
    names, rows = rows[0], rows[1:3000]
    raw = tmp_path / "raw"
    raw.mkdir()
    keep = range(1, names.index("yo"))
    for yo in sorted({r[names.index("yo")] for r in rows}):
        text = ["".join(f"{names[k]};" for k in keep)]
        text += ["".join(f"{r[k]};" for k in keep) for r in rows if r[names.index("yo")] == yo]
        (raw / f"sea035.10.gli.sub.{yo}.gz").write_bytes(gzip.compress("\n".join(text).encode()))
    report = convert(raw, tmp_path / "a")
    convert(source, tmp_path / "b")
    for name in report.rows:
        a, b = (read_table(tmp_path / f / f"{name}.csv", name) for f in "ab")
        n = len(a)
        assert n == report.rows[name] > 100
        for column in a.columns:
            np.testing.assert_allclose(a[column], b[column][:n], atol=1e-11)


def test_comma2k19(data_folder, tmp_path):
    report = convert(data_folder / "car_comma2k19_wheel", tmp_path / "out")
    assert report.rows == {"imu": 6256, "gnss": 579, "speed": 4974, "reference": 1200}
    t = tables_of(tmp_path / "out", report)
    r, g = t["reference"], t["gnss"]
    # the fixes fit the reference once their 0.08 s are taken off, in place and in velocity
    late = g.time - 0.08
    inside = (late > r.time[0]) & (late < r.time[-1])
    at = {k: np.interp(late[inside], r.time, r[k]) for k in ("lat", "lon", "height", "v_north", "v_east")}
    d = displacement_n(g["lat"][inside], g["lon"][inside], 0.0, at["lat"], at["lon"], 0.0)
    assert np.sqrt(np.mean(np.sum(np.asarray(d)[..., :2] ** 2, axis=-1))) == pytest.approx(0.46, abs=0.03)
    assert np.std(g["v_north"][inside] - at["v_north"]) < 0.1
    # velocity in the device's axes is forward, and the accelerometer hangs on -z
    course = np.arctan2(r["v_east"], r["v_north"])
    assert abs(np.mean(np.angle(np.exp(1j * (r["heading"] - course))))) < 2 * DEG
    assert t["imu"]["accel_z"].mean() == pytest.approx(-9.66, abs=0.01)
    assert abs(t["imu"]["gyro_z"].mean()) < 0.01


def test_px4_logs(data_folder, tmp_path):
    folder = data_folder / "logs_px4_ulog"
    report = convert(folder / "sample.ulg", tmp_path / "a")
    assert report.rows == {"imu": 17070, "attitude": 6461}
    imu = read_table(tmp_path / "a/imu.csv", "imu")
    force = np.linalg.norm(imu.stack("accel_x", "accel_y", "accel_z"), axis=1)
    assert np.median(force) == pytest.approx(9.703, abs=0.002)
    assert np.median(np.linalg.norm(imu.stack("mag_x", "mag_y", "mag_z"), axis=1)) == pytest.approx(47e-6, rel=0.05)
    assert any("4 dropouts" in n for n in report.notes)
    report = convert(folder / "sample_log_small.ulg", tmp_path / "b")
    assert report.rows == {"imu": 1298, "gnss": 32, "height": 120, "attitude": 1298}
    g = read_table(tmp_path / "b/gnss.csv", "gnss")
    np.testing.assert_allclose([g["lat"][16] / DEG, g["lon"][16] / DEG], [63.4170503, 10.4082203], atol=1e-6)
    assert g["height"][16] == pytest.approx(103.841, abs=0.5)  # above the ellipsoid, not the sea


def test_nmea_logs(data_folder, tmp_path):
    folder = data_folder / "logs_nmea"
    report = convert(folder / "pygpsdata-nmeabadck.log", tmp_path / "a")
    assert report.rows == {"gnss": 1} and any("2 with a bad checksum" in n for n in report.notes)
    assert convert(folder / "pygpsdata-mixed.log", tmp_path / "b").rows == {"gnss": 2}
    g = read_table(tmp_path / "b/gnss.csv", "gnss")
    assert g["lat"][0] / DEG == pytest.approx(53 + 27.03557 / 60)
    assert g["height"][0] == pytest.approx(65.4 + 48.5)


def test_car_tables_and_the_raw_log_behind_them(data_folder):
    """The raw log without headings (g, deg/s, ms, time last) is understood and equals the clean table."""
    folder = data_folder / "car_rtk_mems"
    clean = read_table(folder / "imu.csv.gz", "imu")
    raw = read_table(folder / "orig_imu_1934.csv.gz", "imu")
    assert (len(clean), len(raw)) == (54858, 54860)
    names = [f"{s}_{a}" for s in ("gyro", "accel") for a in "xyz"]
    shift = np.abs(raw["accel_x"][:20, None] - clean["accel_x"][:1]).argmin()
    n = len(clean) - 50
    np.testing.assert_allclose(raw.stack(*names)[shift : shift + n], clean.stack(*names)[:n], atol=1e-5)


@pytest.mark.parametrize(
    "file,rate,axis,codes",
    [
        ("car_comma2k19_wheel/imu.csv.gz", 104.35, "-z", set()),
        ("car_rtk_mems/imu.csv.gz", 99.97, "+z", {"axes"}),
        ("car_rtk_mems/orig_imu_1934.csv.gz", 100.0, "+z", {"axes", "time_unit", "gyro_unit", "accel_unit"}),
        ("car_phone_a/acc.csv.gz", 50.0, "+y", {"axes", "gap"}),
        ("car_phone_a", 50.0, "+y", {"axes", "gap"}),
        ("quad_4imu_rtk/horizontal03_imu1.csv.gz", 120.0, "+z", {"axes", "gyro_unit"}),
        ("uav_thor75/flight.csv.gz", 50.0, "-z", set()),
        ("static_adis16405/adis16405_imu1.npz", 100.0, "-z", set()),
        ("ahrs_broad/30_disturbed_stationary_magnet_C.npz", 285.71, "-z", set()),  # the reader turns them
        ("calib_mpu9150_rotations/imu0.log.gz", None, None, {"time_unit"}),
        ("calib_ferraris_shimmer/example_ferraris_session.csv.gz", None, None, {"time_unit", "gyro_unit"}),
        ("calib_ferraris_shimmer/annotated_session.csv.gz", None, None, {"time_unit", "gyro_unit", "accel_unit"}),
        ("logs_px4_ulog/sample.ulg", 250.0, "-z", {"gap"}),
    ],
)
def test_check_on_every_kind_of_imu_file(data_folder, file, rate, axis, codes):
    report = next(r for r in check(data_folder / file) if r.table == "imu")
    assert {f.code for f in report.faults} == codes
    assert report.gravity_axis == axis
    assert report.rate_hz == (None if rate is None else pytest.approx(rate, rel=1e-3))
    assert "\n" in render(report)


def test_noise_of_the_static_unit(data_folder):
    """Angle random walk against the published 2.44 2.56 2.33 deg/sqrt(h), which use averaging times of 0.1 to 3 s."""
    (report,) = check(data_folder / "static_adis16405" / "adis16405_imu1.npz")
    assert report.still[0].length > 9990
    np.testing.assert_allclose(np.array(report.noise.gyro_arw) * 60 / DEG, [2.44, 2.56, 2.33], rtol=0.03)
