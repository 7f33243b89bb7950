"""check: what is found in a recording without configuration, and the fault codes of the contract."""

import json

import numpy as np
import pytest

from schuler.ground.errors import InputError
from schuler.ground.units import DEG, G0
from schuler.io.check import CODES, check, render
from schuler.io.still import allan_at, noise_of, still_stretches

FULL = "time[s],gyro_x[rad/s],gyro_y[rad/s],gyro_z[rad/s],accel_x[m/s^2],accel_y[m/s^2],accel_z[m/s^2]"
NAMED = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
RATE = 100.0


def recording(seconds=60.0, still=30.0, up=(0.0, 0.0, -1.0)):
    """At rest, then rolling to and fro: (time, rates rad/s, specific force m/s^2). ARW 1.2 deg/sqrt(h), VRW 0.12."""
    rng = np.random.default_rng(3)
    n = int(seconds * RATE)
    t = np.arange(1, n + 1) / RATE
    swing = np.where(t > still, 0.5 * (1 - np.cos(1.3 * (t - still))), 0.0)
    rate = np.where(t > still, 0.5 * 1.3 * np.sin(1.3 * (t - still)), 0.0)
    gyro = np.column_stack([rate, 0 * t, 0 * t]) + rng.normal(0, 1.2 * DEG / 60 * np.sqrt(RATE), (n, 3)) + 0.01
    z = -np.cos(swing)
    accel = G0 * np.column_stack([0 * t, -np.sin(swing), z]) + rng.normal(0, 0.12 / 60 * np.sqrt(RATE), (n, 3))
    if up != (0.0, 0.0, -1.0):
        accel = accel * 0 + G0 * np.array(up) + rng.normal(0, 0.02, (n, 3))
    return t, gyro, accel


def save(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.12g")
    return path


def only(path):
    (report,) = check(path)
    return report


def codes(path):
    report = only(path)
    assert {f.code for f in report.faults} <= set(CODES)
    assert all(f.says and f.type_next for f in report.faults)
    json.dumps(report.as_dict())  # plain numbers and text
    assert render(report)
    return {f.code for f in report.faults}


def test_a_sound_recording(tmp_path):
    path = save(tmp_path / "imu.csv", FULL, *recording())
    assert codes(path) == set()
    r = only(path)
    assert r.rate_hz == pytest.approx(100.0)
    assert (r.kind, r.gravity_axis, r.gaps) == ("rates", "-z", [])
    assert r.specific_force == pytest.approx(G0, rel=1e-3)
    text = render(r)
    for word in ("100 Hz", "gaps            none", "along -z", "none found", 'imu = "imu.csv"', "1 stretch"):
        assert word in text


def test_rest_and_noise_are_found(tmp_path):
    r = only(save(tmp_path / "imu.csv", FULL, *recording()))
    assert len(r.still) == 1
    assert r.still[0].start == pytest.approx(0.01, abs=1.0) and r.still[0].end == pytest.approx(30.0, abs=1.0)
    assert r.noise.still
    # 30 s give about 30 averages of one second: 18 % (1 sigma) for each axis; three axes together better
    assert np.mean(r.noise.gyro_arw) == pytest.approx(1.2 * DEG / 60, rel=0.3)
    assert np.mean(r.noise.accel_vrw) == pytest.approx(0.12 / 60, rel=0.3)
    np.testing.assert_allclose(r.noise.gyro_bias, 0.01, atol=2e-4)


def test_allan_deviation_of_white_noise():
    rng = np.random.default_rng(5)
    white = rng.normal(0.0, 2.0, (100_000, 3))
    np.testing.assert_allclose(allan_at(white, 100), 2.0 / 10.0, rtol=0.05)


def test_motion_all_the_way_is_said():
    t, gyro, accel = recording(still=0.0)
    assert still_stretches(t, gyro, accel) == []
    assert not noise_of(t, gyro, accel, []).still


@pytest.mark.parametrize(
    "up,axis", [((0, 0, 1), "+z"), ((0, 1, 0), "+y"), ((0, -1, 0), "-y"), ((1, 0, 0), "+x"), ((-1, 0, 0), "-x")]
)
def test_axes_and_the_mounting_that_levels_them(tmp_path, up, axis):
    path = save(tmp_path / "imu.csv", FULL, *recording(up=tuple(map(float, up))))
    r = only(path)
    assert r.gravity_axis == axis
    (fault,) = r.faults
    assert fault.code == "axes"
    roll, pitch, yaw = (
        float(v) * DEG for v in fault.type_next.partition("[mounting]")[2].split("[")[1].split("]")[0].split(",")
    )
    from schuler.ground.frames import dcm_from_euler

    np.testing.assert_allclose(dcm_from_euler(roll, pitch, yaw) @ np.array(up, dtype=float), [0, 0, -1], atol=1e-12)


@pytest.mark.parametrize(
    "header,gyro,accel,expected,kind",
    [
        (NAMED, 1 / DEG, 1.0, {"gyro_unit"}, "rates"),
        (NAMED, 1.0, 1 / G0, {"accel_unit"}, "rates"),
        (NAMED, 0.01, 0.01, {"increments"}, "increments"),
        (NAMED, 1.0, 1.0, set(), "rates"),
        (FULL, 1 / DEG, 1.0, {"gyro_unit"}, "rates"),
        (FULL, 1.0, 1 / G0, {"accel_unit"}, "rates"),
        (FULL, 0.01, 0.01, {"increments"}, "increments"),
        (FULL, 1.0, 400.0, {"accel_unit"}, "rates"),
        (FULL.replace("gyro_x[rad/s]", "gyro_x[rads/s]"), 1.0, 1.0, {"gyro_unit"}, "rates"),
    ],
)
def test_units_and_increments(tmp_path, header, gyro, accel, expected, kind):
    t, w, f = recording()
    path = save(tmp_path / "imu.csv", header, t, w * gyro, f * accel)
    assert codes(path) == expected
    assert only(path).kind == kind


def test_what_is_typed_next_works(tmp_path):
    """The advice for wrong units is a command; its options make a table that check finds sound."""
    from schuler.io.convert import convert

    t, w, f = recording()
    path = save(tmp_path / "log.csv", FULL, t, w / DEG, f / G0)
    r = only(path)
    assert {x.code for x in r.faults} == {"gyro_unit", "accel_unit"}
    (command,) = r.next
    words = command.split()
    assert words[:3] == ["schuler", "convert", str(path)]
    options = dict(zip(words[4::2], words[5::2], strict=True))
    convert(path, tmp_path / words[3], gyro_unit=options["--gyro-unit"], accel_unit=options["--accel-unit"])
    assert codes(tmp_path / words[3]) == set()


def test_time_units(tmp_path):
    t, w, f = recording()
    assert codes(save(tmp_path / "a.csv", NAMED, t * 1e3, w, f)) == {"time_unit"}
    assert codes(save(tmp_path / "b.csv", FULL, t * 1e3, w, f)) == {"time_unit"}
    assert only(tmp_path / "b.csv").rate_hz == pytest.approx(100.0)
    assert codes(save(tmp_path / "c.csv", FULL.partition(",")[2], w, f)) == {"time_unit"}
    assert only(tmp_path / "c.csv").rate_hz is None


def test_clock_faults(tmp_path):
    t, w, f = recording()
    assert codes(save(tmp_path / "gap.csv", FULL, np.where(t > 20, t + 5, t), w, f)) == {"gap"}
    (gap,) = only(tmp_path / "gap.csv").gaps
    assert gap == (pytest.approx(20.0), pytest.approx(5.01))
    twice = np.sort(np.append(np.arange(len(t)), 499))
    assert codes(save(tmp_path / "dup.csv", FULL, t[twice], w[twice], f[twice])) == {"not_increasing"}
    back = t.copy()
    back[3000:] -= 10.0
    assert codes(save(tmp_path / "back.csv", FULL, back, w, f)) == {"not_increasing"}
    assert "line 3002" in only(tmp_path / "back.csv").faults[0].says


def test_holes_and_coarse_numbers(tmp_path):
    t, w, f = recording()
    w[7, 1] = np.nan
    assert codes(save(tmp_path / "nan.csv", FULL, t, w, f)) == {"nan"}
    t, w, f = recording()
    assert codes(save(tmp_path / "coarse.csv", FULL, t, np.round(w, 2), np.round(f, 2))) == {"quantised"}


def test_one_sensor_alone_and_other_tables(tmp_path):
    t, w, f = recording()
    accel = only(save(tmp_path / "acc.csv", "t,ax,ay,az", t, f))
    assert accel.gravity_axis == "-z" and any("no gyro" in n for n in accel.notes)
    gyro = only(save(tmp_path / "gyro.csv", "t_s,gx_radps,gy_radps,gz_radps", t, w))
    assert gyro.kind is None and gyro.rate_hz == pytest.approx(100.0)
    n = np.arange(50.0)
    fixes = only(save(tmp_path / "g.csv", "time[s],lat[deg],lon[deg],height[m]", n, 45 + 1e-6 * n, 7 + n * 1e-6, n))
    assert (fixes.table, fixes.kind, fixes.rate_hz) == ("gnss", None, pytest.approx(1.0))
    bad = only(save(tmp_path / "h.csv", "time[s],lat[deg],lon[deg],height[m]", n, 95 + 1e-6 * n, 7 + n * 1e-6, n))
    assert "more than is possible" in bad.refused and "refused" in render(bad) and "none found" not in render(bad)


def test_raw_text_without_any_heading(tmp_path):
    t, w, f = recording()
    path = tmp_path / "raw.txt"
    np.savetxt(path, np.column_stack([f / G0, w / DEG, 1e3 * t]), fmt="%.8g")
    assert codes(path) == {"time_unit", "gyro_unit", "accel_unit"}
    assert only(path).rate_hz == pytest.approx(100.0)


def test_files_that_cannot_be_read_at_all(tmp_path):
    (tmp_path / "x.csv").write_bytes(bytes(range(256)) * 9)
    (tmp_path / "y.csv").write_text("name,colour\nred,blue\n")
    for path, word in (
        (tmp_path / "x.csv", "binary"),
        (tmp_path / "y.csv", "neither"),
        (tmp_path / "no.csv", "no such"),
    ):
        with pytest.raises(InputError, match=word):
            check(path)


def test_several_files_in_one_call(tmp_path):
    a = save(tmp_path / "a.csv", FULL, *recording(20.0))
    b = save(tmp_path / "b.csv", FULL, *recording(20.0))
    assert [r.file for r in check([a, b])] == [str(a), str(b)]
