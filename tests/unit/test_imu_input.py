"""What bad IMU recordings get: one clear sentence, or a note of what was repaired."""

import math

import numpy as np
import pytest

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.inertial import strapdown
from schuler.inertial.imu_input import prepare
from schuler.inertial.strapdown import Start
from schuler.truth import trajectories as shapes
from schuler.truth.imu_errors import measure
from schuler.truth.instruments import ImuModel

PATH = shapes.legs(0.8, 0.3, 100.0, speed=30.0, heading=0.5, turns=[0.4], turn_rate=0.1, duration=60.0)
IDEAL = PATH.ideal(100.0, 20.0)
START = Start.of(IDEAL.start)


def changed(kind: str = "rates", **columns: np.ndarray) -> Table:
    table = IDEAL.table(kind)
    return Table("imu", {**table.columns, **columns}, kind)


def test_rates_and_increments_are_the_same_recording() -> None:
    a, b = (strapdown.run(IDEAL.table(kind), START) for kind in ("rates", "increments"))
    assert np.abs(a.v_n - b.v_n).max() < 1e-9
    assert np.abs(a.minus(IDEAL.truth).position).max() < 1e-4


def test_increments_given_as_rates_and_the_other_way_round_are_named() -> None:
    inc, rates = IDEAL.table("increments"), IDEAL.table("rates")
    wrong = {f"{n}_{a}": inc[f"{m}_{a}"] for n, m in (("gyro", "dtheta"), ("accel", "dv")) for a in "xyz"}
    with pytest.raises(InputError, match=r"increments given as rates.*dv_x\[m/s\]"):
        prepare(Table("imu", {"time": inc.time, **wrong}, "rates"))
    wrong = {f"{m}_{a}": rates[f"{n}_{a}"] for n, m in (("gyro", "dtheta"), ("accel", "dv")) for a in "xyz"}
    with pytest.raises(InputError, match=r"rates given as increments.*accel_x"):
        prepare(Table("imu", {"time": inc.time, **wrong}, "increments"))


def test_an_imu_turned_over_is_told_where_gravity_sits() -> None:
    t = IDEAL.table("rates")
    over = changed(**{f"{n}_{a}": -t[f"{n}_{a}"] for n in ("gyro", "accel") for a in "yz"})
    with pytest.raises(InputError, match=r"gravity sits on \+z.*puts it on -z.*imu_to_body"):
        strapdown.run(over, START)
    swapped = changed(accel_x=t["accel_z"], accel_z=t["accel_x"], gyro_x=t["gyro_z"], gyro_z=t["gyro_x"])
    with pytest.raises(InputError, match="gravity sits on -x"):
        strapdown.run(swapped, START)


def test_missing_rows_are_bridged_and_told() -> None:
    keep = np.ones(len(IDEAL.time), dtype=bool)
    keep[700:710] = False
    table = IDEAL.table("rates").where(keep)
    ready = prepare(table, START)
    assert any("0.110 s" in n and "bridged" in n for n in ready.notes)
    end = strapdown.run(table, START)
    truth = PATH.at(20.0)
    assert abs(end.v_n[-1] - truth.v_n[0]).max() < 0.05
    increments = strapdown.run(IDEAL.table("increments").where(keep), START)
    assert abs(increments.v_n[-1] - truth.v_n[0]).max() < 0.05


def test_repeated_rows_are_dropped_and_told() -> None:
    rows = np.sort(np.concatenate([np.arange(len(IDEAL.time)), [5, 6, 7]]))
    t = IDEAL.table("rates")
    ready = prepare(Table("imu", {k: v[rows] for k, v in t.columns.items()}, "rates"))
    assert len(ready.time) == len(IDEAL.time)
    assert any("3 IMU rows repeat" in n for n in ready.notes)


def test_a_change_of_rate_within_the_file_is_told_and_integrated() -> None:
    half = PATH.ideal(50.0, 20.0)
    a, b = IDEAL.table("rates"), half.table("rates")
    late, early = b.time > 10.0, a.time <= 10.0
    columns = {k: np.concatenate([a[k][early], b[k][late]]) for k in a.columns}
    track = strapdown.run(Table("imu", columns, "rates"), START)
    assert any("rate changes at 10.020 s, from 100 to 50 Hz" in n for n in track.notes)
    assert np.abs(track.v_n[-1] - PATH.at(20.0).v_n[0]).max() < 1e-4


def test_saturation_is_told() -> None:
    fast = shapes.rest(0.8, 0.3, duration=20.0).with_waves(("roll", 1.0, 0.5, 0.0))
    imu = measure(fast.ideal(100.0), ImuModel(gyro_range_deg_per_s=100.0), seed=0)
    assert imu.clipped.any()
    ready = prepare(imu.table())
    assert any("gyro_x stays at its largest value, 1.745 rad/s" in n and "saturated" in n for n in ready.notes)


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (
            {"gyro_y": np.where(np.arange(len(IDEAL.time)) == 40, np.nan, 0.0)},
            "row 41 holds a value that is not a number",
        ),
        ({"time": np.concatenate([IDEAL.time[:50], IDEAL.time[:50][::-1], IDEAL.time[100:]])}, "runs backwards at row"),
    ],
)
def test_unusable_rows_are_refused_with_their_place(columns: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        prepare(changed(**columns))


def test_a_start_after_the_recording_is_refused() -> None:
    late = Start(1e4, START.lat, START.lon, START.height, START.v_n, START.q_nb)
    with pytest.raises(InputError, match="after the last IMU row"):
        prepare(IDEAL.table(), late)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_start_that_is_no_number_is_refused(bad: float) -> None:
    with pytest.raises(InputError, match="not a number"):
        strapdown.Strapdown(Start(0.0, bad, 0.0, 0.0, np.zeros(3), np.array([1.0, 0, 0, 0])))
    with pytest.raises(InputError, match="unit quaternion"):
        strapdown.Strapdown(Start(0.0, 0.0, 0.0, 0.0, np.zeros(3), np.array([2.0, 0, 0, 0])))


def test_odd_pairs_and_wrong_options_are_refused() -> None:
    with pytest.raises(InputError, match="even number"):
        strapdown.Strapdown(START, coning="pair").feed(IDEAL.dtheta[:3], IDEAL.dv[:3], 0.01)
    with pytest.raises(InputError, match="coning is one of"):
        strapdown.Strapdown(START, coning="four")  # type: ignore[arg-type]
