"""The aided INS, fed row by row: what a vehicle's own computer runs.

    nav = AidedFilter(settings, sensors=("gnss", "speed"), lag_s=5.0)
    nav.predict(imu)                                       # time, gyro xyz, force xyz: s, rad/s, m/s^2
    nav.update(Aid.position(t, lat, lon, height, std=(1, 1, 2)))
    nav.lat, nav.rpy, nav.sigmas()["heading"]              # now
    nav.smoothed()                                         # 5 s ago, with all that was heard since
    blob = nav.save();  nav = AidedFilter.load(blob)

`aiding.aided.navigate` runs the same kernels over a recording: the same bits. A measurement may come before the row
that covers its time (it waits), or late (the filter goes back and replays, up to late_s seconds).
"""

from __future__ import annotations

import math
from bisect import insort
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_aids import CODES, KIND_OF, OWN, Aid, check, filled, usual_rate
from schuler.aiding.aided_ear import Ear
from schuler.aiding.aided_engine import Engine, StartState, room
from schuler.aiding.aided_rows import Events
from schuler.aiding.aided_sensors import Sensor, update
from schuler.aiding.aided_settings import AidedSettings, chosen, layout_of
from schuler.aiding.aided_waiting import Waiting, carried_on
from schuler.aiding.aided_window import INNER_ROOM, first_node, make_room, nodes_of, window
from schuler.aiding.solution import Solution
from schuler.ground.errors import InputError

Array = NDArray[np.float64]
Event = tuple[float, int, tuple[float, ...]]
MARK_S = 1.0  # s between two states to go back to
STATE = ("x", "P", "S", "dec", "qd", "dx")


@dataclass(frozen=True)
class Innovation:
    """The last of a kind: time s, value (measured - predicted) and sigma (d,), NIS, weight (0 refused, 1 in full)."""

    time: float
    value: Array
    std: Array
    nis: float
    weight: float


@dataclass
class Mark:
    """A state to go back to: the engine's arrays in the order of `STATE`, its past, and how many nodes there were."""

    time: float
    state: tuple[Array, ...]
    ring: Array
    nodes: int


class AidedFilter:
    """INS with whatever else speaks. See the module.

    settings : AidedSettings; its `estimate`, or else what `sensors` need ("gnss", "speed", "dvl", "depth", "height",
    "attitude", "magnetometer", "ranges"). own : sensors of the caller's own (their time and z stay empty). start :
    where it begins; else it finds a start itself as soon as rows and measurements allow one, and again after a gap of
    the rows in which the attitude is lost (1 rad / settings.gap_rate). late_s : how old a measurement may be when it
    comes. lag_s : of `smoothed`, 0 for none. interval : of the IMU, s, where it is slower than 40 Hz.
    """

    def __init__(
        self, settings: AidedSettings | None = None, *, sensors: Iterable[str] = ("gnss",), own: Sequence[Sensor] = (),
        start: StartState | None = None, late_s: float = 10.0, lag_s: float = 0.0, interval: float = 0.01,
    ) -> None:  # fmt: skip
        s = settings or AidedSettings()
        self.sensors = tuple(sorted(set(sensors)))
        known = {name for _, name in CODES.values()}
        unknown = [name for name in self.sensors if name not in known]
        if unknown:
            raise InputError(f"there is no sensor {', '.join(unknown)}; there are {', '.join(sorted(known))}")
        if not (late_s >= 0.0 and lag_s >= 0.0 and interval > 0.0):
            raise InputError(f"late_s = {late_s:g}, lag_s = {lag_s:g} and interval = {interval:g} must not be negative")
        estimate = chosen(s, self.sensors)
        if "gnss_bias" not in estimate:
            s = replace(s, gnss_correlated_std=0.0)
        self.settings = replace(s, estimate=estimate)
        self.own = {sensor.name: (OWN + i, sensor) for i, sensor in enumerate(own)}
        self.late_s, self.lag_s, self.interval = float(late_s), float(lag_s), float(interval)
        self.engine = Engine(self.settings, layout_of(self.settings, estimate), self.interval)
        self.started = False
        self.lost = False  # after a long gap: it looks for a start again
        self.start_time = math.nan
        self.notes: list[str] = []
        self.innovations: dict[str, Innovation] = {}
        self._held: list[str] = []
        self._pending: list[Event] = []
        self._done: list[Event] = []
        self._rows: deque[Array] = deque()  # time, rate, force, standing
        self._marks: deque[Mark] = deque()
        self._undo: Mark | None = None
        self._slots: dict[str, list[float]] = {}
        self._ear = Ear()
        self._listens = bool({"zupt", "zaru"} & set(self.settings.constraints))
        self._wait = Waiting()
        self._one = np.zeros((1, 7))
        self._flag = np.zeros(1, dtype=bool)
        self._none = Events(np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 12)))
        from schuler.kernels import aided_run as r
        from schuler.kernels import aided_state as k

        self._T, self._TROW, self._HEAD, self._BG = k.T, k.TROW, k.HEAD, k.PAR + k.BG
        self._MEAS, self._INNER, self._NODES = r.MEAS, r.INNER, r.NODES
        self.engine.kept = room(self.engine.layout.n, inner=INNER_ROOM, nodes=64 if self.lag_s > 0.0 else 0)
        if start is not None:
            self.begin(start)

    # --- feeding ----------------------------------------------------------------------------------------------------

    def begin(self, start: StartState, engine: Engine | None = None) -> None:
        """Starts here (engine: one that has already run to it)."""
        if engine is None:
            if self.lost:
                carried_on(self.engine, start)
            else:
                self.engine.begin(start)
        else:
            engine.kept = self.engine.kept
            self.engine = engine
        self.engine.kept.counts[:] = 0
        self.started, self.start_time = True, start.time
        self.notes += start.notes
        self._mark()

    def predict(self, row: Array, *, standing: bool | None = None) -> None:
        """One row: time s, rate rad/s, specific force m/s^2 in b, means since the row before. standing: whether the
        vehicle stands, where the caller knows; else it is heard. A row not later than the last one is left out."""
        row = np.array(row, dtype=np.float64)
        if row.shape != (7,) or not math.isfinite(float(row @ row)):
            raise InputError(f"predict: expected 7 finite numbers (time first), got {row!r}")
        if not self.started:
            self._wait.row(row)
            self._try_start()
            return
        x = self.engine.x
        if row[0] <= x[self._TROW] or row[0] <= self.start_time + 1e-9:
            return
        if row[0] - x[self._TROW] > 1.0 / self.settings.gap_rate:
            self._lose(row)
            return
        if standing is None:
            standing = self._listens and self._ear.hear(row, x[self._BG : self._BG + 3])
        events: list[Event] = []
        if self._pending:
            k = 0
            while k < len(self._pending) and self._pending[k][0] <= row[0]:
                k += 1
            events, self._pending = self._pending[:k], self._pending[k:]
            self._done += events
        self._rows.append(np.append(row, float(standing)))
        before = float(x[self._T])
        self._remember()
        self._one[0] = row
        self._flag[0] = standing
        self._run(self._one, self._flag, events)
        if x[self._T] - self._marks[-1].time >= MARK_S:
            self._mark()
            self._forget(before - self.late_s)

    def update(self, aid: Aid) -> bool:
        """One measurement, early, in time or late. False where it came too late to be used."""
        check(aid)
        code = self._code(aid)
        if not self.started:
            self._wait.aid(aid)
            self._try_start()
            return True
        if aid.time <= self.start_time:
            return False
        now = float(self.engine.x[self._TROW])
        inside = self._undo is not None and aid.time > self._undo.time
        if aid.time < now - self.late_s and not inside:
            return False
        self._tell_ear(aid)
        if not aid.ready and not self._new(aid):
            return True  # the same again: it would tell nothing
        event = (aid.time, code, filled(aid, self.settings) if code < OWN else aid.z)
        if aid.time > now:
            insort(self._pending, event, key=_order)
            return True
        return self._replay(event)

    # --- reading ----------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        return float(self.engine.x[self._T]) if self.started else math.nan

    @property
    def lat(self) -> float:
        return float(self._state()[7])

    @property
    def lon(self) -> float:
        return float(self._state()[8])

    @property
    def height(self) -> float:
        return float(self._state()[9])

    @property
    def v_n(self) -> Array:
        """(3,) m/s NED over ground."""
        return self._state()[4:7].copy()

    @property
    def rpy(self) -> tuple[float, float, float]:
        """Roll, pitch, heading, rad."""
        from schuler.kernels.rotation import euler_from_quat

        return euler_from_quat(*self._state()[:4])

    @property
    def covariance(self) -> Array:
        """(n, n) of the errors: phi rad, velocity, position NED, then `settings.estimate` in the order of ESTIMATES."""
        return self.engine.P.copy()

    def value(self, name: str) -> Array:
        """A parameter's present value (SI): "gyro_bias", "antenna_lever", ..., estimated or not."""
        from schuler.aiding.aided_sensors import State

        return State(self.engine).value(name)

    def sigmas(self) -> dict[str, float]:
        """1 sigma of north, east, down (m), velocity (m/s), roll, pitch, heading (rad)."""
        from schuler.kernels.aided_run import covariances

        cov = np.zeros((3, 3, 3))
        covariances(self.engine.x, self.engine.P, cov[0], cov[1], cov[2])
        names = ("north", "east", "down", "v_north", "v_east", "v_down", "roll", "pitch", "heading")
        return dict(zip(names, np.sqrt(np.maximum(np.einsum("kii->ki", cov).ravel(), 0.0)).tolist(), strict=True))

    def smoothed(self) -> Solution:
        """One row: the state lag_s ago (the last node not later than that), which has seen everything until now."""
        track = self.smoothed_track()
        return Solution(*(np.ascontiguousarray(getattr(track, name)[:1]) for name in _FIELDS))

    def smoothed_track(self) -> Solution:
        """The whole lag, from lag_s ago until now: a row for every node."""
        if self.lag_s <= 0.0:
            raise InputError("this filter keeps nothing to smooth: make it with lag_s, the seconds to look back")
        if not self.started:
            raise InputError("the filter has not started yet")
        kept = self.engine.kept
        n = int(kept.counts[self._NODES])
        return window(self.engine, first_node(self, n), n)

    # --- saving -----------------------------------------------------------------------------------------------------

    def save(self) -> bytes:
        """Everything the filter knows, as bytes: the same whenever the history was the same."""
        from schuler.aiding.aided_saved import save

        return save(self)

    @classmethod
    def load(cls, blob: bytes, *, own: Sequence[Sensor] = ()) -> AidedFilter:
        """The filter that `save` wrote (own: the caller's sensors, as before); anything else raises InputError."""
        from schuler.aiding.aided_saved import load

        return load(cls, blob, own)

    # --- inside -----------------------------------------------------------------------------------------------------

    def _state(self) -> Array:
        """The nominal state less the open-loop error; NaN before the start."""
        if not self.started:
            return np.full(10, np.nan)
        if not self.settings.open_loop:
            return self.engine.x
        from schuler.kernels.aided_state import correct

        y = self.engine.x.copy()
        correct(y, self.engine.layout.ie, self.engine.dx)
        return y

    def _code(self, aid: Aid) -> int:
        if aid.kind in CODES:
            code, sensor = CODES[aid.kind]
            if sensor not in self.sensors:
                raise InputError(
                    f"update: a {aid.kind} measurement, but the filter was made for "
                    f'{", ".join(self.sensors) or "none"}; name "{sensor}" in sensors'
                )
            return code
        if aid.kind not in self.own:
            raise InputError(f"update: there is no sensor {aid.kind}; give it in own")
        return self.own[aid.kind][0]

    def _new(self, aid: Aid) -> bool:
        """Whether a sensor that repeats itself says something new."""
        rate = usual_rate(aid.kind, self.settings)
        if rate is None:
            return True
        slots = self._slots.setdefault(aid.kind, [aid.time])
        slot = math.floor((aid.time - slots[0]) * rate + 1e-6)
        if slot in slots[1:]:
            return False
        slots.append(slot)
        if len(slots) > 2 + rate * (self.late_s + 2.0):
            del slots[1]
        return True

    def _tell_ear(self, aid: Aid) -> None:
        if not self._listens:
            return
        if aid.kind == "velocity":
            self._ear.told(aid.time - self.settings.gnss_delay, math.hypot(aid.z[0], aid.z[1]))
        elif aid.kind == "speed" and self.settings.speed_is == "ground":
            self._ear.told(aid.time, abs(aid.z[0]))

    def _run(self, rows: Array, still: NDArray[np.bool_], events: list[Event]) -> None:
        """Rows, and the measurements that lie in them."""
        kept = self.engine.kept
        if self.lag_s > 0.0:
            make_room(self, len(events) + nodes_of(self, rows))
            kept = self.engine.kept
        kept.counts[: self._NODES] = 0
        if not events:
            self.engine.run(rows, still, self._none, 1.0)
        else:
            from schuler.kernels.aided_update import INNOVATION

            taken = _events(events)
            kept.innov = np.full((len(events), 2, INNOVATION), np.nan)
            inside = False
            while self.engine.run(rows, still, taken, 1.0, inside) == 1:
                self._own(taken)
                inside = True
            self._tell(taken, kept.innov)
        for i in range(int(kept.counts[self._INNER])):
            name, d = _INNER_NAMES[int(kept.inner[1][i])]
            self._keep(name, float(kept.inner[0][i]), kept.inner[2][i], d)

    def _own(self, taken: Events) -> None:
        kept = self.engine.kept
        i = int(kept.counts[self._MEAS])
        sensor = next(s for code, s in self.own.values() if code == taken.kind[i])
        z = taken.z[i]
        d = int(z[6])
        usual = np.broadcast_to(np.asarray(sensor.sigma, dtype=np.float64), (d,))
        sigma = np.where(np.isfinite(z[3 : 3 + d]), z[3 : 3 + d], usual)
        kept.innov[i, 0] = update(self.engine, sensor, z[:d].copy(), sigma)
        kept.counts[self._MEAS] += 1

    def _tell(self, taken: Events, innov: Array) -> None:
        for i, kind in enumerate(taken.kind.tolist()):
            if kind >= OWN:
                names: tuple[str, ...] = tuple(n for n, (code, _) in self.own.items() if code == kind)
            else:
                names = _NAMES[kind]
            for k, name in enumerate(names):
                row = innov[i, k]
                if math.isfinite(row[6]):
                    self._keep(name, float(taken.time[i]), row, int(row[7]))

    def _keep(self, name: str, time: float, row: Array, d: int) -> None:
        self.innovations[name] = Innovation(time, row[:d].copy(), row[3 : 3 + d].copy(), float(row[6]), float(row[8]))

    def _remember(self) -> None:
        """The state before a row, to take the row back when a measurement comes for its interval."""
        e = self.engine
        i = int(e.x[self._HEAD]) % len(e.ring)
        mark = self._undo
        if mark is None:
            state = tuple(getattr(e, name).copy() for name in STATE)
            self._undo = Mark(float(e.x[self._T]), state, e.ring[i].copy(), int(e.kept.counts[self._NODES]))
            return
        for name, kept in zip(STATE, mark.state, strict=True):
            np.copyto(kept, getattr(e, name))
        mark.time, mark.ring, mark.nodes = float(e.x[self._T]), e.ring[i].copy(), int(e.kept.counts[self._NODES])

    def _mark(self) -> None:
        e = self.engine
        state = tuple(getattr(e, name).copy() for name in STATE)
        self._marks.append(Mark(float(e.x[self._T]), state, e.ring.copy(), int(e.kept.counts[self._NODES])))

    def _forget(self, oldest: float) -> None:
        while len(self._marks) > 1 and self._marks[1].time <= oldest:
            self._marks.popleft()
        held = self._marks[0].time
        while self._rows and self._rows[0][0] <= held:
            self._rows.popleft()
        k = 0
        while k < len(self._done) and self._done[k][0] <= held:
            k += 1
        if k:
            del self._done[:k]

    def _back_to(self, mark: Mark) -> None:
        e = self.engine
        for name, kept in zip(STATE, mark.state, strict=True):
            np.copyto(getattr(e, name), kept)
        if mark.ring.ndim == 2:
            np.copyto(e.ring, mark.ring)
        else:
            e.ring[int(e.x[self._HEAD]) % len(e.ring)] = mark.ring
        e.kept.counts[self._NODES] = max(mark.nodes, 0)

    def _replay(self, late: Event) -> bool:
        """Back to before a measurement, and forward again in the right order."""
        time = late[0]
        if self._undo is not None and self._undo.time < time:
            mark = self._undo
        else:
            if not self._marks or self._marks[0].time >= time:
                return False
            while self._marks[-1].time >= time:
                self._marks.pop()
            mark = self._marks[-1]
        insort(self._done, late, key=_order)
        while self._marks[-1].time > mark.time:
            self._marks.pop()
        since = mark.time
        self._back_to(mark)
        rows = [r for r in self._rows if r[0] > since]
        again = [m for m in self._done if m[0] > since]
        while rows:
            k = 1
            while k < len(rows) - 1 and rows[k - 1][0] - self._marks[-1].time < MARK_S:
                k += 1
            part, rows = np.array(rows[:k]), rows[k:]
            if not rows:
                self._remember()
            j = 0
            while j < len(again) and again[j][0] <= part[-1, 0]:
                j += 1
            self._run(np.ascontiguousarray(part[:, :7]), part[:, 7] > 0.5, again[:j])
            again = again[j:]
            if self.engine.x[self._T] - self._marks[-1].time >= MARK_S:
                self._mark()
        return True

    # --- before the start -------------------------------------------------------------------------------------------

    def _lose(self, row: Array) -> None:
        """A gap so long that nobody knows the attitude any more: what was learnt of the sensors is kept."""
        self.notes.append(
            f"no rows from {self.engine.x[self._TROW]:.2f} to {row[0]:.2f} s: the attitude was lost, and a start is "
            "looked for again"
        )
        self.started, self.lost = False, True
        self._wait = Waiting()
        for t, code, z in self._pending:
            if code < OWN and t > row[0] - 1.0:
                self._wait.aid(Aid(KIND_OF[code], t, z, ready=True))
        for kept in (self._marks, self._rows, self._done, self._pending):
            kept.clear()
        self._undo = None
        self._wait.row(row)

    def _try_start(self) -> None:
        found = self._wait.start(self)
        if found is None:
            return
        start, engine = found
        self.begin(start, engine)
        rows, aids = self._wait.since(start.time)
        self._wait.clear()
        for aid in aids:
            self.update(aid)
        for row in rows:
            self.predict(row)


def _events(events: list[Event]) -> Events:
    z = np.full((len(events), 12), np.nan)
    for i, (_, _, values) in enumerate(events):
        z[i, : len(values)] = values
    time = np.array([m[0] for m in events], dtype=np.float64)
    return Events(time, np.array([m[1] for m in events], dtype=np.int64), z)


def _order(event: Event) -> tuple[float, int]:
    return event[0], event[1]


_FIELDS = ("time", "lat", "lon", "height", "v_n", "rpy", "cov_pos", "cov_vel", "cov_rpy")
_NAMES: dict[int, tuple[str, ...]] = {
    0: ("gnss_position", "gnss_height"), 2: ("gnss_velocity", "gnss_velocity_down"), 3: ("gnss_course",), 4: ("speed",),
    5: ("dvl",), 6: ("depth",), 7: ("height",), 8: ("attitude",), 9: ("magnetometer",), 10: ("ranges",),
}  # fmt: skip
_INNER_NAMES = {14: ("nhc", 2), 15: ("zupt", 3), 16: ("zaru", 3)}
