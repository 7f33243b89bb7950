"""A start that cannot be found: one clear sentence each, and what to type."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from schuler.aiding.aided import AidedSettings, Start, navigate
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.truth import manoeuvres
from schuler.truth.aided import AidedSuite, simulate
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0
FREE = AidedSettings(gnss_correlated_std=0.0)
NHC = replace(FREE, constraints=("nhc",))


@cache
def tables(stand: float = 0.0, velocity: bool = True) -> dict[str, Table]:
    path = manoeuvres.car(50.0 * D, 30.0 * D, stand=stand, duration=30.0)
    imu = ImuModel(gyro_arw_deg_per_sqrt_h=0.5, accel_vrw_mps_per_sqrt_h=0.2, gyro_bias_deg_per_h=100.0)
    return dict(simulate(path, imu, AidedSuite(gnss_velocity=velocity), 50.0, seed=2).tables)


def gnss(rows: object = None, shift: float = 0.0, stand: float = 0.0, **columns: float) -> dict[str, Table]:
    found = tables(stand)
    g = found["gnss"]
    g = g if rows is None else g.where(np.isin(np.arange(len(g)), rows))
    new = {c: np.full(len(g), columns[c]) if c in columns else v for c, v in g.columns.items()}
    new["time"] = new["time"] + shift
    return {"imu": found["imu"], "gnss": replace(g, columns=new)}


@pytest.mark.parametrize(
    ("given", "settings", "words"),
    [
        (lambda: gnss(shift=1000.0), FREE, r"the fixes run from 1001\.0 to 103\d\.0 s and the imu from .* one clock"),
        (lambda: gnss(shift=-1000.0), FREE, r"no fix says where to begin; put both on one clock"),
        (lambda: gnss(lat=math.nan), FREE, r"no row of the gnss table holds a position"),
        (lambda: {"imu": tables()["imu"]}, FREE, r"neither a fix nor \[start\] position and heading"),
        (lambda: gnss([5]), replace(NHC, start=Start()), r"heading cannot be found.*type \[start\] heading_deg"),
        (lambda: gnss(stand=30.0), NHC, r"the fixes never move faster than .* m/s long enough to tell a course"),
        (lambda: gnss(stand=30.0), FREE, r"heading could not be found from the motion within .*heading_deg"),
        (lambda: gnss(range(0, 30, 10)), FREE, r"fixes gave \d+ numbers, it takes 40"),
        (lambda: gnss(), replace(FREE, start=Start(time=99.0)), r"time_s = 99 s lies outside the imu's time, 0\.02 to"),
    ],
)
def test_one_sentence(given, settings: AidedSettings, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=words) as caught:
        navigate(given(), settings)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_fixes_before_the_imu_are_no_start() -> None:
    """The last of them is 0.5 s older than the first row: the vehicle has moved since, and the start says so."""
    found = gnss(shift=-5.5)
    result = navigate(found, replace(NHC, start=Start(heading=0.0)))
    assert result.filter.time[0] >= found["imu"].time[0] - 0.03
    assert np.isfinite(result.filter.lat).all()


def test_a_single_fix_with_a_typed_heading() -> None:
    result = navigate(gnss([3]), replace(FREE, start=Start(heading=0.0)))
    fix = tables()["gnss"].time[3]
    assert result.filter.time[0] >= fix, "nothing is told before its place is known"
    assert any("the gyros carried the attitude of [start] there" in n for n in result.notes)
    assert result.filter.cov_pos[-1, 0, 0] > result.filter.cov_pos[0, 0, 0]


def test_nan_fixes_among_good_ones() -> None:
    found = gnss()
    g = found["gnss"]
    columns = {c: v.copy() for c, v in g.columns.items()}
    columns["lat"][:4] = np.nan
    columns["v_north"][6:9] = np.nan
    result = navigate({"imu": found["imu"], "gnss": replace(g, columns=columns)}, NHC)
    assert np.isfinite(result.filter.lat).all() and np.isfinite(result.filter.cov_pos).all()


def test_no_velocity_is_told() -> None:
    """A typed start in motion whose velocity nobody knows: it says so, and does not pretend to stand."""
    result = navigate(gnss([8]), replace(FREE, start=Start(heading=0.0, std_heading=0.1), gnss_delay=0.0))
    assert result.filter.cov_vel[0, 0, 0] < 1.0  # this receiver tells its velocity
    one = gnss([8])
    bare = {c: v for c, v in one["gnss"].columns.items() if "v_" not in c}
    result = navigate(
        {"imu": one["imu"], "gnss": replace(one["gnss"], columns=bare)}, replace(FREE, start=Start(heading=0.0))
    )
    assert any("no velocity is known at the start" in n for n in result.notes)
    assert math.sqrt(result.filter.cov_vel[0, 0, 0]) > 10.0
