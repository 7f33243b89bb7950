"""Until the online filter knows enough to begin: what was heard so far, and the batch filter's own start from it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_aids import Aid, filled
from schuler.aiding.aided_settings import Start
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

if TYPE_CHECKING:
    from schuler.aiding.aided_engine import Engine, StartState
    from schuler.aiding.aided_online import AidedFilter

Array = NDArray[np.float64]
HOLD_S = 600.0  # of the past that is kept while waiting
FIRST_S, GROWTH = 1.0, 1.15  # s after the first row of the first attempt, and how much later each next one


class Waiting:
    """Rows and measurements before the start."""

    def __init__(self) -> None:
        self.rows: list[Array] = []
        self.aids: list[Aid] = []
        self.next = math.nan
        self.reason = "nothing was heard yet"

    def clear(self) -> None:
        self.rows, self.aids = [], []

    def row(self, row: Array) -> None:
        if self.rows and row[0] <= self.rows[-1][0]:
            return
        self.rows.append(row)
        if row[0] - self.rows[0][0] > 1.1 * HOLD_S:
            old = row[0] - HOLD_S
            self.rows = [r for r in self.rows if r[0] > old]
            self.aids = [a for a in self.aids if a.time > old]

    def aid(self, aid: Aid) -> None:
        self.aids.append(aid)

    def since(self, time: float) -> tuple[list[Array], list[Aid]]:
        """What came after a time, in order."""
        return [r for r in self.rows if r[0] > time], [a for a in self.aids if a.time > time]

    def start(self, nav: AidedFilter) -> tuple[StartState, Engine | None] | None:
        """The start, where what was heard allows one."""
        if len(self.rows) < 10:
            return None
        now, first = float(self.rows[-1][0]), float(self.rows[0][0])
        if math.isnan(self.next):
            self.next = first + FIRST_S
        if now < self.next:
            return None
        self.next = max(now + 0.5, first + GROWTH * (now - first))
        from schuler.aiding.aided_rows import events_of
        from schuler.aiding.aided_start import find_start
        from schuler.kernels import aided_state as k

        tables = self.tables(nav)
        rows = np.array(self.rows)
        events = events_of(tables, nav.settings)
        settings = replace(nav.settings, start=Start()) if nav.lost else nav.settings
        if settings.start.time is not None and settings.start.time > now:
            return None
        try:
            start, engine = find_start(
                rows, np.zeros(len(rows), dtype=bool), events, tables, settings, nav.engine.layout, live=True
            )
            engine.settings = nav.settings
            return start, (engine if engine.x[k.ROWS] > 0.0 else None)
        except InputError as error:
            self.reason = str(error)
            return None

    def tables(self, nav: AidedFilter) -> dict[str, Table]:
        """What was heard, as the batch filter's tables; later than the last row waits."""
        s, now = nav.settings, float(self.rows[-1][0])
        rows = np.array(self.rows)
        columns = {"time": rows[:, 0].copy()}
        for i, name in enumerate(("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")):
            columns[name] = np.ascontiguousarray(rows[:, 1 + i])
        by: dict[str, list[Aid]] = {}
        for a in sorted(self.aids, key=lambda a: a.time):
            if a.time <= now:
                by.setdefault(a.kind, []).append(a)
        tables: dict[str, Table] = {}
        if "magnetometer" in by:
            mag = np.full((len(rows), 3), np.nan)
            for a in by["magnetometer"]:
                mag[int(np.searchsorted(rows[:, 0], a.time - 1e-9).clip(0, len(rows) - 1))] = a.z[:3]
            columns |= {f"mag_{axis}": np.ascontiguousarray(mag[:, i]) for i, axis in enumerate("xyz")}
        tables["imu"] = Table("imu", columns, "rates")
        if "position" in by:
            tables["gnss"] = _gnss(by, s.gnss_correlated_std)
        if "attitude" in by:
            z = np.array([a.z[:3] for a in by["attitude"]])
            tables["attitude"] = Table(
                "attitude",
                {
                    "time": np.array([a.time for a in by["attitude"]]),
                    "roll": z[:, 0],
                    "pitch": z[:, 1],
                    "heading": z[:, 2],
                },
            )
        for kind, column in (("speed", "speed"), ("depth", "depth"), ("height", "height")):
            if kind in by:
                z1 = np.array([filled(a, s)[0] for a in by[kind]])
                tables[kind] = Table(kind, {"time": _times(by[kind]), column: z1})
        return tables


def carried_on(engine: Engine, start: StartState) -> None:
    """Begins again at a start with what the engine had learnt of its sensors, a little older."""
    from schuler.kernels import aided_state as k

    x, n = engine.x, engine.layout.n
    known, cov = x[k.PAR : k.PAR + k.SLOTS].copy(), engine.P[k.NAV :, k.NAV :].copy()
    waited = max(start.time - float(x[k.T]), 0.0)
    engine.begin(start)
    x[k.PAR : k.PAR + k.SLOTS] = known
    diagonal = np.arange(n - k.NAV)
    cov[diagonal, diagonal] += engine.layout.noise[k.NAV :] * waited
    engine.P[:, :] = 0.0
    engine.P[: k.NAV, : k.NAV] = start.cov
    engine.P[k.NAV :, k.NAV :] = cov
    a = int(engine.layout.ie[k.BA])
    if start.level_from_force and a >= 0:
        engine._level_holds_bias(a)


def _times(aids: list[Aid]) -> Array:
    return np.array([a.time for a in aids], dtype=np.float64)


def _gnss(by: dict[str, list[Aid]], slow: float) -> Table:
    """Fixes with the velocity (or course) of the same time."""
    fixes = by["position"]
    time = _times(fixes)
    z = np.array([a.z[:6] for a in fixes])
    if fixes[0].ready:  # its sigmas had their slow part taken out
        z[:, 3:6] = np.hypot(z[:, 3:6], slow * np.array([1.0, 1.0, 1.5]))
    columns = {"time": time, "lat": z[:, 0], "lon": z[:, 1], "height": z[:, 2]}
    columns |= {f"std_{axis}": z[:, 3 + i] for i, axis in enumerate(("north", "east", "down"))}
    if "velocity" in by:
        v = {a.time: a.z for a in by["velocity"]}
        rows = np.array([v.get(t, (math.nan,) * 3)[:3] for t in time.tolist()])
        columns |= {f"v_{axis}": rows[:, i] for i, axis in enumerate(("north", "east", "down"))}
    elif "course" in by:
        c = {a.time: (a.z[0], a.z[4] if len(a.z) > 4 else math.nan) for a in by["course"]}
        pair = np.array([c.get(t, (math.nan, math.nan)) for t in time.tolist()])
        columns |= {"course": pair[:, 0], "speed": pair[:, 1]}
    return Table("gnss", columns)
