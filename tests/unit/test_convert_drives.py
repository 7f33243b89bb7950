"""Readers of drives and flights on tiny made recordings: values, signs, clocks, and what damaged files get."""

import gzip
import struct

import numpy as np
import pytest

from schuler.ground.earth import ecef_from_geodetic
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, euler_from_dcm
from schuler.ground.tables import Table, validate
from schuler.ground.units import DEG, G0
from schuler.io.convert import convert
from schuler.io.formats import phone, quaddot, rtklib, umnuav

# 2025-07-08 19:34:18 GPST, in GPS seconds, and as week and second of week
START, WEEK, TOW = 1436038458.0, 2374, 243258.0


def csv(path, header, rows):
    text = "\n".join([header, *(",".join(f"{x:.9g}" for x in r) for r in rows)]) + "\n"
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())


# ----------------------------------------------------------------------------------------------------------- RTKLIB

TAIL = "1 9 0.01 0.02 0.03 0 0 0 0.2 40.5"


def pos(path, label, rows, time="GPST"):
    path.write_text(f"% program   : RTKLIB\n%  {time}  {label}\n" + "\n".join(rows) + "\n")
    return path


LLH = "latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio"


def test_calendar_week_and_utc_are_the_same_moment(tmp_path):
    rows = {
        "a": ("GPST", ["2025/07/08 19:34:18.500 40.1 -105.2 1601.5 " + TAIL]),
        "b": ("GPST", [f"{WEEK} {TOW + 0.5:.3f} 40.1 -105.2 1601.5 " + TAIL]),
        "c": ("UTC", ["2025/07/08 19:34:00.500 40.1 -105.2 1601.5 " + TAIL]),
    }
    for name, (time, lines) in rows.items():
        table = rtklib.solution(pos(tmp_path / f"{name}.pos", LLH, lines, time))
        assert table.time[0] == pytest.approx(START + 0.5, abs=1e-6)
        assert table["lat"][0] / DEG == pytest.approx(40.1) and table["lon"][0] / DEG == pytest.approx(-105.2)
        assert [table[f"std_{n}"][0] for n in ("north", "east", "down")] == [0.01, 0.02, 0.03]


def test_down_and_up_velocities_get_one_sign(tmp_path):
    ends = {"vu": 0.5, "vd": -0.5}
    for label, given in ends.items():
        names = f"{LLH} vn(m/s) ve(m/s) {label}(m/s) sdvn sdve sd{label} sdvne sdveu sdvun"
        row = f"2025/07/08 19:34:18.5 40.1 -105.2 1601.5 {TAIL} 1.5 -2.5 {given} 0.1 0.2 0.3 0 0 0"
        table = rtklib.solution(pos(tmp_path / f"{label}.pos", names, [row]))
        assert (table["v_north"][0], table["v_east"][0], table["v_down"][0]) == (1.5, -2.5, -0.5)  # it climbs
        assert table["std_v_down"][0] == 0.3


def test_degrees_minutes_and_ecef_are_the_same_place(tmp_path):
    lat, lon, height = -40.1, -105.2, 1601.5
    x, y, z = ecef_from_geodetic(lat * DEG, lon * DEG, height)
    day = "2025/07/08 19:34:18.5"
    minutes = LLH.replace("latitude(deg)", "latitude(d'\")").replace("longitude(deg)", "longitude(d'\")")
    ecef = "x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio"
    for name, label, place in (
        ("a", minutes, "-40 06 00.0 -105 12 00.0 1601.5"),
        ("b", ecef, f"{x:.6f} {y:.6f} {z:.6f}"),
    ):
        table = rtklib.solution(pos(tmp_path / f"{name}.pos", label, [f"{day} {place} {TAIL}"]))
        np.testing.assert_allclose([table["lat"][0], table["lon"][0]], [lat * DEG, lon * DEG], atol=1e-12)
        assert table["height"][0] == pytest.approx(height, abs=1e-5)


def test_south_of_the_equator_by_minutes_only(tmp_path):
    label = LLH.replace("latitude(deg)", "latitude(d'\")").replace("longitude(deg)", "longitude(d'\")")
    table = rtklib.solution(pos(tmp_path / "a.pos", label, [f"2025/07/08 19:34:18.5 -0 30 0 0 30 0 5 {TAIL}"]))
    assert table["lat"][0] / DEG == pytest.approx(-0.5) and table["lon"][0] / DEG == pytest.approx(0.5)


def test_damaged_solutions(tmp_path):
    good = "2025/07/08 19:34:{:06.3f} 40.1 -105.2 1601.5 " + TAIL
    rows = [good.format(18 + k) for k in range(5)]
    rows[2] = rows[2][:40]  # cut off
    rows[3] = rows[3].replace("1601.5", "what")
    table = rtklib.solution(pos(tmp_path / "cut.pos", LLH, rows))
    assert len(table) == 3 and any("2 rows cut off" in n for n in table.notes)
    for name, text, says in (
        ("empty", "", "empty"),
        ("head", f"%  GPST  {LLH}\n", "no solution in this file"),
        ("nohead", rows[0] + "\n", "no line of the heading"),
        ("base", f"%  GPST e-baseline(m) n-baseline(m) u-baseline(m)\n{rows[0]}\n", "neither latitude"),
        ("short", f"%  GPST  {LLH} vn(m/s) ve(m/s)\n{rows[0]}\n", "no row has the"),
    ):
        (tmp_path / f"{name}.pos").write_text(text)
        with pytest.raises(InputError, match=says):
            rtklib.solution(tmp_path / f"{name}.pos")


def imu_log(folder, rows=2000, ppm=200.0, crlf=True, name="imu.csv"):
    """A log whose clock runs ppm fast of the computer's, written in chunks of five rows, with its tag."""
    ms = 261906 + 10 * np.arange(rows)
    lines = [f"0.1,0.02,0.99,{57.29577951308232:.9f},0,-1.5,{m}" for m in ms]
    folder.mkdir(exist_ok=True)
    text = ("\r\n" if crlf else "\n").join(lines) + ("\r\n" if crlf else "\n")
    size = np.cumsum([len(x) + (2 if crlf else 1) for x in lines])
    true = (ms - ms[0]) * 1e-3 * (1.0 - ppm * 1e-6)  # after the start
    rng = np.random.default_rng(3)
    pairs = [(int(1e3 * true[k] + 40 + 8 * rng.random()), int(size[k])) for k in range(4, rows, 5)]
    head = struct.pack("<60sIId", b"TIMETAG RTKLIB demo5", 1, int(315964800 + START), 0.25)
    (folder / f"{name}.tag").write_bytes(head + b"".join(struct.pack("<II", *p) for p in pairs))
    (folder / name).write_bytes(text.encode())
    return START + 0.25 + true


def test_times_of_a_tagged_log(tmp_path):
    """To a millisecond of a straight line; the mean of the transfer and of the chunks stays in it, a constant."""
    for crlf in (True, False):
        folder = tmp_path / str(crlf)
        true = imu_log(folder, crlf=crlf)
        table = rtklib.imu_log(folder / "imu.csv")
        late = table.time - true
        assert np.ptp(late) < 2e-3 and 0.04 < late.mean() < 0.08
        assert table["gyro_x"][0] == pytest.approx(1.0) and table["accel_z"][0] == pytest.approx(0.99 * G0)
        assert validate(table) == []


def test_a_log_whose_line_ends_were_changed(tmp_path):
    true = imu_log(tmp_path, crlf=True)
    (tmp_path / "imu.csv").write_bytes((tmp_path / "imu.csv").read_bytes().replace(b"\r\n", b"\n"))
    table = rtklib.imu_log(tmp_path / "imu.csv")
    assert np.ptp(table.time - true) < 2e-3
    assert any("CR LF" in n for n in table.notes)


def test_damaged_tags(tmp_path):
    imu_log(tmp_path)
    tag = (tmp_path / "imu.csv.tag").read_bytes()
    pairs = np.frombuffer(tag[76:], "<u4").reshape(-1, 2).copy()
    slow = pairs.copy()
    slow[:, 0] *= 2
    for content, says in (
        (b"TIMETAG", "not an RTKLIB time tag"),
        (tag[:68] + b"\xff" * 8 + tag[76:], "damaged"),
        (tag[:76] + pairs[::-1].tobytes(), "go back"),
        (tag[:76] + slow.tobytes(), "does not belong"),
    ):
        (tmp_path / "imu.csv.tag").write_bytes(content)
        with pytest.raises(InputError, match=says):
            rtklib.imu_log(tmp_path / "imu.csv")


def test_convert_takes_a_folder_of_rtklib(tmp_path):
    folder = tmp_path / "drive"
    imu_log(folder, name="drive.csv")
    rows = [f"2025/07/08 19:34:{18 + k:02d}.0 40.1 -105.2 1601.5 {TAIL}" for k in range(9)]
    pos(folder / "drive.pos", LLH, rows)
    report = convert(folder, tmp_path / "out")
    assert report.format == "rtklib" and report.rows == {"gnss": 9, "imu": 2000}
    pos(folder / "second.pos", LLH, rows)
    with pytest.raises(InputError, match="2 solution files .drive.pos, second.pos."):
        convert(folder, tmp_path / "again")


# ------------------------------------------------------------------------------------------------------------ phone


def drive(folder, C_body_imu, seconds=120.0):
    """A telephone in a car that speeds up and brakes on a straight road to the east, gyro and accelerometer apart."""
    folder.mkdir(exist_ok=True)
    t = np.arange(0.0, seconds, 0.02)
    speed = 15.0 + 8.0 * np.sin(2 * np.pi * t / 40.0)
    force = np.column_stack([np.gradient(speed, t), 0 * t, -G0 + 0 * t])
    turn = np.column_stack([0.02 * np.sin(t), 0.1 * np.cos(3 * t), 0.2 * np.sin(2 * t)])
    f, w = force @ C_body_imu, turn @ C_body_imu
    csv(folder / "acc.csv.gz", "t_s,ax_mps2,ay_mps2,az_mps2", np.column_stack([t, f]))
    late = t + 0.007  # stamps of its own
    mean = np.column_stack([np.interp(late, t, w[:, k]) for k in range(3)])
    csv(folder / "gyro.csv.gz", "t_s,gx_radps,gy_radps,gz_radps", np.column_stack([late, mean]))
    k = slice(0, None, 50)
    n = len(t[k])
    lon = 9.0 + np.cumsum(speed)[k] * 0.02 / (111320.0 * np.cos(np.radians(48.0)))
    hacc = np.full(n, 1.2)
    hacc[:3] = 12.0
    columns = [t[k], np.full(n, 48.0), lon, np.full(n, 300.0), speed[k], np.full(n, 90.0), hacc, np.full(n, 100.0)]
    names = "t_s,lat_deg,lon_deg,h_m,speed_mps,heading_deg,hacc_m,vacc_m,sacc_mps,headacc_deg"
    csv(folder / "gnss.csv", names, np.column_stack([*columns, np.full(n, 20.0), np.full(n, 10.0)]))
    return t, w


UPRIGHT = np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])  # forward = -z, right = x, down = -y of the telephone
ACROSS = np.array([[0.0, 0, -1], [0, -1, 0], [-1, 0, 0]])  # its long side level, right side up
FLAT = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # on its back, top to the front


@pytest.mark.parametrize("C", [UPRIGHT, ACROSS, FLAT], ids=["upright", "across", "flat"])
def test_how_a_telephone_stands_is_found(tmp_path, C):
    drive(tmp_path / "d", C)
    tables = phone.convert(tmp_path / "d")
    angles, fit = phone.mounting_of(tables["imu"], tables["gnss"])
    np.testing.assert_allclose(dcm_from_euler(*np.radians(angles)), C, atol=1e-12)
    assert fit > 0.9


def test_no_turn_is_lost_between_two_clocks(tmp_path):
    """The angle gathered over any stretch is the gyro's own, whichever stamps the rows carry."""
    drive(tmp_path / "d", UPRIGHT)
    gyro = np.loadtxt(tmp_path / "d" / "gyro.csv.gz", delimiter=",", skiprows=1)
    imu = phone.convert(tmp_path / "d")["imu"]
    step = np.diff(imu.time, prepend=imu.time[0] - 0.02)
    for k, axis in enumerate("xyz"):
        ours = np.cumsum(imu[f"gyro_{axis}"] * step)
        theirs = np.cumsum(gyro[1:, 1 + k] * np.diff(gyro[:, 0]))
        at = np.interp(imu.time, gyro[1:, 0], theirs)
        np.testing.assert_allclose((ours - ours[1])[1:], (at - at[1])[1:], atol=2e-5)


def test_what_a_telephone_says_and_does_not_say(tmp_path):
    drive(tmp_path / "d", UPRIGHT)
    gnss = phone.convert(tmp_path / "d")["gnss"]
    assert gnss.time[0] == pytest.approx(3.0)  # three rows from before it had settled
    np.testing.assert_allclose(gnss["v_north"], 0.0, atol=1e-9)
    assert gnss["v_east"].min() > 5.0 and "v_down" not in gnss and "std_down" not in gnss
    np.testing.assert_allclose(gnss["std_north"], 1.2 / 1.51)
    assert any("vacc, sacc_mps, headacc_deg: one value throughout" in n for n in gnss.notes)


def test_a_telephone_without_overlap_or_columns(tmp_path):
    drive(tmp_path / "d", UPRIGHT)
    gyro = np.loadtxt(tmp_path / "d" / "gyro.csv.gz", delimiter=",", skiprows=1)
    gyro[:, 0] += 1e4
    csv(tmp_path / "d" / "gyro.csv.gz", "t_s,gx_radps,gy_radps,gz_radps", gyro)
    with pytest.raises(InputError, match="share no time"):
        phone.convert(tmp_path / "d")
    csv(tmp_path / "d" / "acc.csv.gz", "t_s,ax_mps2,ay_mps2", gyro[:, :3])
    with pytest.raises(InputError, match="acc.csv.gz: column az_mps2 missing"):
        convert(tmp_path / "d", tmp_path / "out")


# --------------------------------------------------------------------------------------------------------- aeroplane

NAMES = "time,p,q,r,ax,ay,az,lat,lon,alt,vn,ve,vd,GPS_TOW,h,ias,navlat,navlon,navalt,navvn,navve,navvd,phi,theta,psi"


def flight(path, tow=True):
    t = np.arange(0.0, 60.0, 0.02)
    n = len(t)
    fix = np.floor(t)
    known = t >= 5.0
    speed = np.where((fix > 20) & (fix < 50), 15.0, 0.0)
    zero = 0 * t
    second = np.where(known, 4e5 + fix, 0.0) if tow else zero
    columns = [t, zero, zero, zero + 0.1, zero + 1.0, zero, np.where(t < 0.01, 0.0, -9.7) + zero]
    columns[4] = np.where(t < 0.01, 0.0, 1.0)
    columns += [np.where(known, 45.3, 45.0), np.where(known, -93.2, -93.0), np.where(known, 250.0, 0.0)]
    columns += [speed, zero, zero, second, zero + 3.0, speed + 1.0]
    columns += [np.where(known, 0.79, 0.0), np.where(known, -1.6, 0.0), zero + 250.0, speed, zero, zero]
    columns += [zero, zero + 0.05, zero - 1.0]
    csv(path, NAMES, np.column_stack(columns))
    return n


def test_an_aeroplanes_table(tmp_path):
    n = flight(tmp_path / "flight.csv.gz")
    report = convert(tmp_path / "flight.csv.gz", tmp_path / "out")
    assert report.format == "umnuav"
    assert report.rows == {"imu": n - 1, "gnss": 55, "height": n, "speed": n}
    tables = umnuav.convert(tmp_path)  # the folder does as well
    gnss = tables["gnss"]
    np.testing.assert_allclose(gnss.time, np.arange(5.0, 60.0), atol=1e-6)
    assert gnss["lat"].min() / DEG == pytest.approx(45.3)  # no placeholder among them
    assert umnuav.airborne(gnss) == pytest.approx((21.0, 49.0))
    onboard = umnuav.onboard(tmp_path)
    assert onboard.time[0] == pytest.approx(5.0) and onboard["heading"][0] == pytest.approx(2 * np.pi - 1.0)
    assert "attitude" not in tables and "reference" not in tables


def test_an_aeroplane_that_never_saw_a_satellite(tmp_path):
    flight(tmp_path / "flight.csv", tow=False)
    with pytest.raises(InputError, match="GPS_TOW never changes"):
        convert(tmp_path / "flight.csv", tmp_path / "out")
    still = Table("gnss", {n: np.zeros(5) for n in ("v_north", "v_east")} | {"time": np.arange(5.0)})
    assert umnuav.airborne(still) is None


# ---------------------------------------------------------------------------------------------------------- quadrotor


def quad(folder, offset=0.4, lag=-0.05, name="a"):
    """A drone that tilts to and fro and goes where its thrust pushes it; the DOT's clock is `offset` ahead, the
    positions `lag` late."""
    folder.mkdir(exist_ok=True)
    dt = 1.0 / 120.0
    t = np.arange(0.0, 40.0, dt)  # the DOT's clock
    heading = 4.3
    roll = 0.3 * np.sin(0.9 * t + 0.2 * np.sin(0.31 * t))
    pitch = 0.2 * np.sin(0.7 * t + 1.0)
    C = dcm_from_euler(roll, pitch, np.full_like(t, heading))
    f_b = np.column_stack([0 * t, 0 * t, -G0 / (np.cos(roll) * np.cos(pitch))])
    a_n = np.einsum("nij,nj->ni", C, f_b) + np.array([0.0, 0.0, G0])
    place = np.cumsum(np.cumsum((a_n - a_n.mean(axis=0)) * dt, axis=0) * dt, axis=0)
    w = np.column_stack([np.gradient(roll, t), np.gradient(pitch, t), 0 * t])
    flu = np.array([1.0, -1.0, -1.0])
    dot = np.column_stack(
        [t, roll / DEG, -pitch / DEG, 30.0 + 0 * t, f_b * flu + np.array([0.1, -0.2, 0.3]), w / DEG * flu]
    )
    csv(folder / f"{name}_imu1.csv.gz", "time,Euler_X,Euler_Y,Euler_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z", dot)
    s = np.arange(0.0, 38.0, 0.1)  # the drone's clock
    at = s + offset
    where = [np.interp(at - lag, t, place[:, k]) for k in range(3)]
    angles = [np.interp(at, t, x) / DEG for x in (pitch, roll)]
    names = "time,distance(meters),speed(m/s),compass_heading(degrees),pitch(degrees),roll(degrees)"
    names += ",height_above_takeoff(meters),North,East,Down"
    truth = np.column_stack([s, 0 * s, 0 * s, heading / DEG + 0 * s, *angles, 3.0 - where[2], *where])
    csv(folder / f"{name}_truth.csv.gz", names, truth)
    return t, place, (roll, pitch, heading)


@pytest.mark.parametrize(("offset", "lag"), [(0.4, -0.05), (-0.33, 0.08)])
def test_a_quadrotors_two_clocks_are_put_together(tmp_path, offset, lag):
    t, place, (roll, pitch, heading) = quad(tmp_path, offset, lag)
    flight = quaddot.read_flight(tmp_path)
    assert flight.offset == pytest.approx(offset, abs=0.005)
    assert flight.position_lag == pytest.approx(lag, abs=0.015)
    reference = flight.tables["reference"]
    assert all(validate(x) == [] for x in flight.tables.values())
    np.testing.assert_allclose(reference["roll"], np.interp(reference.time, t, roll), atol=0.3 * DEG)
    np.testing.assert_allclose(reference["heading"], heading)
    true = np.interp(reference.time, t, place[:, 0])
    speed = np.abs(np.gradient(place[:, 0], t)).max()
    assert np.abs(reference["north"] - true).max() < 0.02 * speed + 0.02
    assert np.median(np.diff(flight.tables["gnss"].time)) == pytest.approx(1.0)
    assert flight.start["roll"] == pytest.approx(np.interp(flight.start["time"], t, roll), abs=0.5 * DEG)
    # specific force of the sensor, turned to forward-right-down, holds it up
    f = flight.tables["imu"].stack("accel_x", "accel_y", "accel_z") @ dcm_from_euler(np.pi, 0.0, 0.0).T
    assert f[:, 2].mean() == pytest.approx(-G0, abs=1.0)


def test_flights_of_a_folder_by_name(tmp_path):
    quad(tmp_path, name="first")
    quad(tmp_path, name="second")
    assert quaddot.flights(tmp_path) == {"first": ["imu1"], "second": ["imu1"]}
    report = convert(tmp_path, tmp_path / "out", format="quaddot", flight="second")
    assert report.rows["gnss"] >= 37 and any("flight second" in n for n in report.notes)
    for keys, says in (({"flight": "third"}, "no flight third"), ({"sensor": "imu7"}, "has no imu7")):
        with pytest.raises(InputError, match=says):
            convert(tmp_path, tmp_path / "more", format="quaddot", **keys)
    (tmp_path / "first_imu1.csv.gz").write_bytes((tmp_path / "first_imu1.csv.gz").read_bytes()[:2000])
    with pytest.raises(InputError, match="ends early"):
        quaddot.read_flight(tmp_path, "first")


def test_right_angles_come_out_of_the_mounting():
    """[-90, 0, 90] is what the study of the telephone types."""
    np.testing.assert_allclose(np.degrees(euler_from_dcm(UPRIGHT)), [-90.0, 0.0, 90.0], atol=1e-9)
