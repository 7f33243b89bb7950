"""A simulated recording: a mission, seen by a suite of instruments, in the tables of the contract.

Time 0 is the mission's start. The same (seed, run) gives the same numbers however long the pieces are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.truth import instruments as inst
from schuler.truth.missions import AuvMission
from schuler.truth.sensors import (
    SUITES,
    AttitudeGauge,
    DepthGauge,
    DvlSensor,
    GnssSensor,
    ImuSensor,
    Sensor,
    SensorSuite,
    SpeedSensor,
    Truth,
)

__all__ = ["SUITES", "Recording", "SensorSuite", "join", "simulate", "stream"]

Array = NDArray[np.float64]


@dataclass
class Recording:
    """Tables of a run, with the truth: `truth` is the reference table, `truth_states` name -> (time, value)."""

    tables: dict[str, Table]
    truth: Table
    truth_states: dict[str, tuple[Array, Array]]
    mission: AuvMission
    suite: SensorSuite
    seed: int
    run: int

    @property
    def declination(self) -> float:
        """rad, positive east, of the field that the magnetometer sees."""
        return self.mission.declination


def simulate(
    mission: AuvMission, suite: SensorSuite, *, seed: int = 0, run: int = 0, reference_hz: float | None = 10.0
) -> Recording:
    """One run of a mission, whole. The reference has rows at reference_hz (None: every IMU epoch), and one at 0.

    A rate that the IMU's is no multiple of becomes the nearest one that fits.
    """
    return next(stream(mission, suite, seed=seed, run=run, reference_hz=reference_hz, chunk_s=mission.duration))


def stream(
    mission: AuvMission,
    suite: SensorSuite,
    *,
    seed: int = 0,
    run: int = 0,
    reference_hz: float | None = 10.0,
    chunk_s: float = 60.0,
) -> Iterator[Recording]:
    """The same recording in pieces of chunk_s, bit for bit the numbers of `simulate`, with flat memory."""
    motion = mission.realise(seed, run, suite.imu_rate_hz)
    rate = motion.rate_hz
    n = round(chunk_s * rate)
    if reference_hz is not None and not reference_hz > 0.0:
        raise InputError(f"reference_hz = {reference_hz:g} must be above 0")
    if n < 1:
        raise InputError(f"chunk_s = {chunk_s:g} is shorter than one IMU interval: type at least {1.0 / rate:g}")
    if suite.imu_kind not in ("rates", "increments"):
        raise InputError(f"imu_kind = {suite.imu_kind!r} is not known: type 'rates' or 'increments'")
    makers: list[tuple[str, type[Sensor], inst.Instrument | None]] = [
        ("imu", ImuSensor, suite.imu),
        ("gnss", GnssSensor, suite.gnss),
        ("speed", SpeedSensor, suite.speed),
        ("depth", DepthGauge, suite.depth),
        ("dvl", DvlSensor, suite.dvl),
        ("attitude", AttitudeGauge, suite.attitude),
    ]
    sensors = {name: make(motion, suite, seed, run) for name, make, model in makers if model is not None}
    reference = Truth(motion, suite, seed, run, rate if reference_hz is None else reference_hz)
    cursor = motion.cursor()
    while cursor.left > 0:
        stretch = cursor.advance(n)
        tables = {name: Table(name, s.feed(stretch), s.kind, "simulated") for name, s in sensors.items()}
        truth = Table("reference", reference.feed(stretch), source="simulated")
        states = reference.states(stretch)
        for s in sensors.values():
            states |= s.states(stretch, truth["time"])
        yield Recording(tables, truth, states, mission, suite, seed, run)


def join(pieces: list[Recording]) -> Recording:
    """One recording of consecutive pieces."""

    def glue(tables: list[Table]) -> Table:
        columns = {c: np.concatenate([t[c] for t in tables]) for c in tables[0].columns}
        return Table(tables[0].name, columns, tables[0].kind, tables[0].source)

    first = pieces[0]
    states = {
        name: (
            np.concatenate([p.truth_states[name][0] for p in pieces]),
            np.concatenate([p.truth_states[name][1] for p in pieces]),
        )
        for name in first.truth_states
    }
    tables = {name: glue([p.tables[name] for p in pieces]) for name in first.tables}
    return replace(first, tables=tables, truth=glue([p.truth for p in pieces]), truth_states=states)
