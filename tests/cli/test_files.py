"""schuler check and schuler convert, as typed."""

import json

import numpy as np
import pytest

CODES = {
    "gyro_unit", "accel_unit", "time_unit", "increments", "axes", "not_increasing", "gap", "nan", "quantised",
}  # fmt: skip


def test_check_says_rate_gravity_and_what_to_type_next(trial, program):
    done = program("check", trial / "imu.csv", trial / "gnss.csv", "--json", trial / "c.json")
    assert done.status == 0, done.err
    for word in ("50 Hz", "gravity", "rates", "schuler run"):
        assert word in done.out, done.out
    imu, gnss = json.loads((trial / "c.json").read_text())
    assert {"file", "rate_hz", "gaps", "kind", "gravity_axis", "faults"} <= set(imu)
    assert imu["rate_hz"] == pytest.approx(50) and imu["kind"] == "rates" and imu["gravity_axis"] == "-z"
    assert gnss["rate_hz"] == pytest.approx(1)


def test_check_finds_faults_and_is_still_done(trial, program):
    lines = (trial / "imu.csv").read_text().splitlines()
    (trial / "imu.csv").write_text("\n".join([*lines[:2000], *lines[2200:]]) + "\n")
    done = program("check", trial / "imu.csv", "--json", "-")
    assert done.status == 0
    (told,) = json.loads(done.out)
    codes = {f["code"] for f in told["faults"]}
    assert "gap" in codes and codes <= CODES
    assert all({"code", "says", "type_next"} <= set(f) for f in told["faults"])


def test_check_looks_at_the_others_where_one_cannot_be_read(trial, program):
    (trial / "empty.csv").write_text("")
    done = program("check", trial / "empty.csv", trial / "imu.csv", trial / "nope.csv")
    assert done.status == 1 and "50 Hz" in done.out
    assert "empty.csv" in done.err and "nope.csv" in done.err and "Traceback" not in done.err


def test_convert_a_table_to_another_format_and_back(trial, program):
    assert program("convert", trial / "imu.csv", trial / "imu.npz").status == 0
    done = program("convert", trial / "imu.npz", trial / "again.csv")
    assert done.status == 0 and "rows" in done.out, done.err
    a, b = (np.loadtxt(trial / f, delimiter=",", skiprows=1) for f in ("imu.csv", "again.csv"))
    np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)


def test_convert_with_units_that_are_said(trial, program):
    lines = (trial / "imu.csv").read_text().splitlines()
    bare = ",".join(n.split("[")[0] for n in lines[0].split(","))
    (trial / "bare.csv").write_text("\n".join([bare, *lines[1:]]) + "\n")
    done = program("convert", trial / "bare.csv", trial / "si.csv", "--gyro-unit", "deg/s", "--accel-unit", "m/s^2")
    assert done.status == 0, done.err
    a, b = (np.loadtxt(trial / f, delimiter=",", skiprows=1) for f in ("imu.csv", "si.csv"))
    np.testing.assert_allclose(np.radians(a[:, 1:4]), b[:, 1:4], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["nope.csv", "out.csv"], 1),
        (["imu.csv", "imu.csv"], 1),
        (["imu.csv", "out.csv", "--gyro-unit", "furlong"], 2),
        (["imu.csv"], 2),
    ],
)
def test_convert_that_cannot_be(trial, program, arguments, status):
    before = sorted(p.name for p in trial.iterdir())
    done = program("convert", *arguments, cwd=trial)
    assert done.status == status and done.err.strip() and "Traceback" not in done.err
    assert sorted(p.name for p in trial.iterdir()) == before
