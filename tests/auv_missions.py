"""Short missions for the tests of the AUV filter, and the filter run over them as a batch and row by row."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import radians
from typing import Any
from unittest.mock import patch

import numpy as np

from schuler.aiding import auv
from schuler.aiding.auv import (
    AuvFilter,
    AuvSettings,
    Measurement,
    input_rows,
    make_filter,
    measurements_of,
    navigate,
    with_receiver,
)
from schuler.ground.frames import wrap_pi
from schuler.ground.tables import Table
from schuler.truth.instruments import AttitudeSensor, Dvl, Magnetometer
from schuler.truth.missions import PRESETS, AuvMission, Change
from schuler.truth.recording import Recording, simulate
from schuler.truth.sensors import SUITES

SHORT = PRESETS["demo"].with_changes(
    surface=50.0, dive=80.0, final_surface=20.0, speed_steps=(Change(40.0, 5.0, -0.5),), descent=15.0, ascent=15.0,
    turns=(Change(30.0, 10.0, radians(-30.0)),), pitch_ramp=5.0,
)  # fmt: skip
SUITE = SUITES["demo"].with_changes(imu_rate_hz=25.0)


@dataclass
class Case:
    """tables and settings of a mission; truth for judging."""

    tables: dict[str, Table]
    settings: AuvSettings
    recording: Recording


def case(mission: AuvMission = SHORT, suite: Any = SUITE, seed: int = 4, run: int = 0, **settings: Any) -> Case:
    recording = simulate(mission, suite, seed=seed, run=run)
    mag = suite.magnetometer is not None
    chosen = AuvSettings(declination=mission.declination if mag else 0.0)
    return Case(dict(recording.tables), replace(chosen, **settings), recording)


@cache
def demo() -> Case:
    """A surface leg, a dive with a turn and a change of speed, a surfacing."""
    return case()


@cache
def full() -> Case:
    """An L-shaped surface leg, with magnetometer and DVL as well, all away from the IMU."""
    suite = SUITE.with_changes(
        magnetometer=Magnetometer(), dvl=Dvl(), antenna_frd=(0.5, 0.0, -0.8), dvl_frd=(-0.4, 0.0, 0.2)
    )
    return case(
        SHORT.with_changes(l_shape=True, surface=60.0), suite, antenna=(0.5, 0.0, -0.8), dvl_arm=(-0.4, 0.0, 0.2)
    )


@cache
def glider() -> Case:
    """A vehicle with its own compass, depth and fixes at the surface; no IMU, no log; drifts between two dives."""
    mission = SHORT.with_changes(
        surface=70.0, dives=2, between=200.0, dive=300.0, final_surface=100.0, pitch=radians(20.0), turns=(),
        speed_steps=(), descent=140.0, ascent=140.0, dive_speed=0.5, surface_speed=0.3,
    )  # fmt: skip
    suite = SUITE.with_changes(attitude=AttitudeSensor(rate_hz=0.2), imu_rate_hz=5.0)
    made = case(mission, suite)
    attitude, gnss, depth = (made.tables[name] for name in ("attitude", "gnss", "depth"))
    below = np.interp(attitude.time, depth.time, depth["depth"]) > 2.0
    made.tables = {
        "attitude": attitude.where(below | (attitude.time < 60.0)),
        "depth": depth.where(np.arange(len(depth)) % 5 == 0),
        "gnss": fixes_only(gnss.where(np.arange(len(gnss)) % 37 == 0)),
    }
    return made


def fixes_only(gnss: Table) -> Table:
    """Fixes without velocities."""
    return Table(gnss.name, {c: v for c, v in gnss.columns.items() if "v_" not in c}, gnss.kind, gnss.source)


CASES = {"demo": demo, "full": full, "glider": glider}


def streams(made: Case) -> tuple[AuvFilter, np.ndarray, list[Measurement]]:
    """A filter that has seen nothing, input rows, measurements in time order."""
    settings = with_receiver(made.settings, made.tables)
    rows, compass, _ = input_rows(made.tables, settings)
    return make_filter(made.tables, settings, rows, compass), rows, measurements_of(made.tables, settings)


def batch(made: Case) -> AuvFilter:
    """The filter as `navigate` leaves it after the whole recording."""
    kept: list[AuvFilter] = []

    def make(*given: Any) -> AuvFilter:
        kept.append(make_filter(*given))
        return kept[-1]

    with patch.object(auv, "make_filter", make):
        navigate(made.tables, replace(made.settings, smoother=False))
    return kept[0]


Event = tuple[float, int, Any]


def events(rows: np.ndarray, measurements: list[Measurement]) -> list[Event]:
    """(time of arrival, order, row or measurement): each row and then what bears its time."""
    found: list[Event] = [(float(r[0]), 0, r) for r in rows]
    return sorted(found + [(m.time, 1, m) for m in measurements], key=lambda e: e[:2])


def feed(nav: AuvFilter, arriving: list[Event]) -> list[bool]:
    """Every event in its order of arrival; what `update` answered."""
    answers = []
    for _, _, what in arriving:
        if isinstance(what, Measurement):
            answers.append(nav.update(what))
        else:
            nav.predict(what)
    return answers


def miss(made: Case, track: Any, time: float) -> float:
    """Horizontal error at a time, m."""
    truth = made.recording.truth
    i = int(np.searchsorted(track.time, time)) - 1
    t = track.time[i]
    lat = np.interp(t, truth.time, truth["lat"])
    lon = np.interp(t, truth.time, np.unwrap(truth["lon"]))
    north, east = (track.lat[i] - lat) * 6.37e6, wrap_pi(track.lon[i] - lon) * 6.37e6 * np.cos(lat)
    return float(np.hypot(north, east))


def heading_miss(made: Case, track: Any, time: float) -> float:
    """Heading error (estimate minus truth) at a time, rad."""
    truth = made.recording.truth
    i = int(np.searchsorted(track.time, time)) - 1
    true = np.interp(track.time[i], truth.time, np.unwrap(truth["heading"]))
    return float(wrap_pi(track.rpy[i, 2] - true))
