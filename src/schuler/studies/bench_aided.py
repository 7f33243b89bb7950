"""Speed of the aided INS: the filter alone, its covariance propagated at every epoch, and the smoother after it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from schuler.studies.bench import Work, task

RATE, SPAN = 200.0, 600.0
EPOCHS = RATE * SPAN
STATES_24 = ("gyro_bias", "accel_bias", "gyro_scale", "accel_scale", "antenna_lever")


@cache
def _ready(estimate: tuple[str, ...]) -> tuple[Any, ...]:
    """A vehicle that stands, with fixes and velocities at 1 Hz: what is computed does not depend on the motion."""
    from schuler.aiding.aided_engine import StartState
    from schuler.aiding.aided_rows import events_of, imu_rows
    from schuler.aiding.aided_settings import AidedSettings, chosen, layout_of
    from schuler.ground.tables import Table

    n = int(EPOCHS)
    t = np.arange(1, n + 1) / RATE
    noise = np.random.default_rng(1).standard_normal((6, n))
    imu = {f"gyro_{a}": 1e-3 * noise[i] for i, a in enumerate("xyz")}
    imu |= {f"accel_{a}": 0.05 * noise[3 + i] - (9.81 if a == "z" else 0.0) for i, a in enumerate("xyz")}
    fixes = np.arange(1.0, SPAN)
    flat = np.zeros(len(fixes))
    gnss = {"time": fixes, "lat": flat + 0.8, "lon": flat + 0.1, "height": flat}
    gnss |= {f"v_{a}": flat for a in ("north", "east", "down")}
    tables = {"imu": Table("imu", {"time": t, **imu}, "rates"), "gnss": Table("gnss", gnss)}
    s = AidedSettings(estimate=estimate, gnss_correlated_std=0.0)
    cov = np.diag([1e-4] * 3 + [1e-2] * 3 + [1.0] * 3)
    start = StartState(0.0, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0.8, 0.1, 0.0, cov)
    return s, layout_of(s, chosen(s, ())), imu_rows(tables["imu"]), events_of(tables, s), start


def _run(estimate: tuple[str, ...], smoothed: bool) -> None:
    from schuler.aiding.aided_engine import Engine, max_nodes, room, rows_out
    from schuler.kernels.aided_smooth import smooth

    s, layout, rows, events, start = _ready(estimate)
    engine = Engine(s, layout, 1.0 / RATE)
    engine.begin(start)
    nodes = max_nodes(s, events, SPAN)
    engine.kept = room(
        layout.n, rows=rows_out(rows, 0.0, 0.1), events=len(events), inner=1, nodes=nodes if smoothed else 0, stds=nodes
    )
    engine.run(rows, np.zeros(len(rows), dtype=bool), events, 0.1)
    if smoothed:
        count = int(engine.kept.counts[4])
        kept = tuple(a[:count] for a in engine.kept.nodes)
        smooth(0, count, layout.ie, kept, np.zeros((count, layout.n)), np.zeros((count, layout.n)))


@task("aided filter, 15 states, fixes at 1 Hz, 200 Hz", "IMU epochs/s", EPOCHS)
def _filter_15() -> Work:
    return lambda: _run(("gyro_bias", "accel_bias"), False)


@task("aided filter, 24 states, fixes at 1 Hz, 200 Hz", "IMU epochs/s", EPOCHS)
def _filter_24() -> Work:
    return lambda: _run(STATES_24, False)


@task("aided filter and smoother, 15 states", "IMU epochs/s", EPOCHS)
def _smoother_15() -> Work:
    return lambda: _run(("gyro_bias", "accel_bias"), True)


@task("aided filter and smoother, 24 states", "IMU epochs/s", EPOCHS)
def _smoother_24() -> Work:
    return lambda: _run(STATES_24, True)
