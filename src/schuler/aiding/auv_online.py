"""The AUV filter, fed measurement by measurement: what a vehicle's own computer runs.

    nav = AuvFilter(settings)
    nav.predict(imu)                      # time, gyro xyz, force xyz [, field xyz]: s, rad/s, m/s^2, uT
    nav.update(Measurement.position(t, lat, lon, height, std=(1, 1, 2)))
    nav.lat, nav.rpy, nav.sigmas()["heading"]
    blob = nav.save();  nav = AuvFilter.load(blob)

`navigate` (aiding.auv) runs the same steps over a recording: the same bits. Measurements may come before the input
row that covers their time (they wait for it) or up to `settings.late` seconds late (the filter goes back and replays).
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.auv_settings import AuvSettings, Start, configuration, initial_variances
from schuler.ground.errors import InputError

Array = NDArray[np.float64]
KINDS = ("position", "velocity", "speed", "dvl", "depth")  # codes of kernels.auv_run
MAGIC = b"SCHULER-AUV-1\n"


@dataclass(frozen=True)
class Measurement:
    """One measurement: kind (see KINDS), time s, and the kernel's seven numbers."""

    kind: str
    time: float
    z: tuple[float, float, float, float, float, float, float]

    @staticmethod
    def position(
        time: float, lat: float, lon: float, height: float = math.nan, *, std: tuple[float, float, float]
    ) -> Measurement:
        """A fix of the antenna: rad, m; std north, east, down in m."""
        return Measurement("position", time, (lat, lon, height, *std, 0.0))

    @staticmethod
    def velocity(time: float, v_n: tuple[float, float, float], *, std: tuple[float, float, float]) -> Measurement:
        """GNSS velocity NED over ground, m/s."""
        return Measurement("velocity", time, (*v_n, *std, 0.0))

    @staticmethod
    def speed(time: float, speed: float, *, std: float) -> Measurement:
        """Axial speed through water, m/s."""
        return Measurement("speed", time, (speed, 0.0, 0.0, std, 0.0, 0.0, 0.0))

    @staticmethod
    def dvl(time: float, v_b: tuple[float, float, float], *, std: float) -> Measurement:
        """Bottom track in body FRD, m/s."""
        return Measurement("dvl", time, (*v_b, std, 0.0, 0.0, 0.0))

    @staticmethod
    def depth(time: float, depth: float, *, std: float) -> Measurement:
        """Depth, m down."""
        return Measurement("depth", time, (depth, 0.0, 0.0, std, 0.0, 0.0, 0.0))


@dataclass
class _Waiting:
    """What is collected until the filter can start."""

    force: Array  # sum of specific force, and its weight, fading over two seconds
    weight: float = 0.0
    mag: Array | None = None
    time: float = math.nan
    row: Array | None = None
    first: tuple[float, float, float] | None = None  # first fix: time, lat, lon
    fix: tuple[float, ...] | None = None  # last fix: time, z
    depth: float = math.nan
    speed: float = math.nan
    dvl: bool = False


class AuvFilter:
    """Error-state filter of an AUV: attitude, gyro bias, position, speed, current and the sensors' own errors.

    settings : AuvSettings. compass : the input rows are (time, roll, pitch, heading) of the vehicle's own AHRS instead
    of (time, gyro xyz, specific force xyz[, field xyz]). log, depth, dvl, mag : which sensors will speak.
    """

    def __init__(
        self,
        settings: AuvSettings | None = None,
        *,
        compass: bool = False,
        log: bool = True,
        depth: bool = True,
        dvl: bool = False,
        mag: bool = False,
    ) -> None:
        from schuler.kernels import auv_state as k

        self.settings = settings or AuvSettings()
        self.compass = compass
        self.sensors = {"log": log, "depth": depth, "dvl": dvl, "mag": mag}
        self.started = False
        self.c = configuration(self.settings, compass=compass, has_log=log, has_depth=depth, has_mag=mag)
        self.x = np.zeros(k.NX)
        self.P = np.zeros((k.N, k.N))
        self.X = np.zeros((k.N, k.N))
        self._wait = _Waiting(np.zeros(3))
        self._pending: list[Measurement] = []
        self._rows: deque[Array] = deque()
        self._done: deque[Measurement] = deque()
        self._marks: deque[tuple[Array, Array, Array]] = deque()
        self._buffers = _buffers()
        self.last: dict[str, Array] = {}
        self.width = 4 if compass else (10 if mag else 7)

    # --- feeding ------------------------------------------------------------------------------------------------

    def predict(self, row: Array) -> None:
        """One input row; see the class. A row that is not later than the last one is left out."""
        row = np.array(row, dtype=np.float64)  # a copy: it is needed again when a measurement comes late
        inertial = row[:7]  # a field may be NaN
        if row.shape != (self.width,) or not math.isfinite(inertial @ inertial):
            raise InputError(f"predict: expected {self.width} finite numbers (time first), got {row!r}")
        if not self.started:
            self._wait_row(row)
            return
        if row[0] <= self.x[_TROW]:
            return
        if row[0] < self.x[_T]:  # with a compass fixes do not wait for rows: this row came after one that is newer
            self._replay(row)
            return
        self._keep(row)
        if self._pending:
            ready = [m for m in self._pending if m.time <= row[0]]
            self._pending = [m for m in self._pending if m.time > row[0]]
            self._run(row, 0, ready)
        else:
            self._run(row, 0, ())

    def update(self, m: Measurement) -> bool:
        """One measurement, early, in time or late; False where it came too late to be used."""
        numbers = all(math.isfinite(v) or (i == 2 and m.kind == "position") for i, v in enumerate(m.z))
        if not numbers or not math.isfinite(m.time):
            raise InputError(f"update: a {m.kind} measurement at {m.time:g} s holds {m.z}; expected finite numbers")
        if not self.started:
            return self._wait_measurement(m)
        now = float(self.x[_T])
        if m.time > now and not self.compass:
            self._pending.append(m)
            self._pending.sort(key=_order)
            return True
        late = m.time < now or bool(self._done and _order(m) < _order(self._done[-1]))
        if late:
            return self._replay(m)
        self._done.append(m)
        self._run(self._rows[-1] if self._rows else self._tail_row(), 1, (m,))
        return True

    # --- reading ------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        return float(self.x[_T])

    @property
    def lat(self) -> float:
        return float(self.x[_k().LAT])

    @property
    def lon(self) -> float:
        return float(self.x[_k().LON])

    @property
    def height(self) -> float:
        return float(self.x[_k().HGT])

    @property
    def rpy(self) -> tuple[float, float, float]:
        """Roll, pitch, heading in rad."""
        from schuler.kernels.rotation import euler_from_quat

        return euler_from_quat(*self.x[:4])

    @property
    def state(self) -> Array:
        """(28,) nominal state in the order of `kernels.auv_state`."""
        return self.x[: _k().NOMINAL].copy()

    @property
    def covariance(self) -> Array:
        """(27, 27) covariance of the error state at the last covariance step."""
        return self.P.copy()

    def sigmas(self) -> dict[str, float]:
        """1 sigma of north, east, down (m), velocity (m/s), roll, pitch, heading (rad) at the present."""
        from schuler.kernels.auv_run import covariances

        pos, vel, att = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
        x, P, X = self.x.copy(), self.P.copy(), self.X.copy()
        if self.started:
            _k().flush(x, P, X, self.c)  # on copies: reading changes nothing
        covariances(x, P, self.c, pos, vel, att)
        names = ("north", "east", "down", "v_north", "v_east", "v_down", "roll", "pitch", "heading")
        diagonal = np.concatenate([np.diag(pos), np.diag(vel), np.diag(att)])
        return dict(zip(names, np.sqrt(np.maximum(diagonal, 0.0)).tolist(), strict=True))

    # --- saving -------------------------------------------------------------------------------------------------

    def save(self) -> bytes:
        """Everything the filter knows, as bytes: the same whenever the history was the same."""
        w = self._wait
        head: dict[str, Any] = {
            "settings": asdict(self.settings),
            "compass": self.compass,
            "sensors": self.sensors,
            "started": self.started,
            "wait": {
                "weight": w.weight,
                "time": w.time,
                "first": w.first,
                "fix": w.fix,
                "depth": w.depth,
                "speed": w.speed,
                "dvl": w.dvl,
                "mag": w.mag is not None,
                "row": w.row is not None,
            },
            "pending": [[m.kind, m.time, *m.z] for m in self._pending],
            "done": [[m.kind, m.time, *m.z] for m in self._done],
            "rows": len(self._rows),
            "marks": len(self._marks),
        }
        arrays = [self.x, self.P, self.X, w.force]
        arrays += [a for a in (w.mag, w.row) if a is not None]
        arrays += [*self._rows]
        for mark in self._marks:
            arrays += mark
        text = json.dumps(head, sort_keys=True).encode()
        body = struct.pack("<q", len(text)) + text + b"".join(a.astype("<f8").tobytes() for a in arrays)
        return MAGIC + struct.pack("<I", zlib.crc32(body)) + body

    @classmethod
    def load(cls, blob: bytes) -> AuvFilter:
        """The filter that `save` wrote; anything else raises InputError."""
        try:
            if not blob.startswith(MAGIC):
                raise ValueError("no filter")
            check, size = struct.unpack_from("<Iq", blob, len(MAGIC))
            start = len(MAGIC) + 12
            if check != zlib.crc32(blob[start - 8 :]):
                raise ValueError("changed")
            head = json.loads(blob[start : start + size])
            numbers = np.frombuffer(blob, "<f8", offset=start + size)
            given = dict(head["settings"])
            start_of: dict[str, Any] = {a: tuple(b) if isinstance(b, list) else b for a, b in given["start"].items()}
            given["start"] = Start(**start_of)
            settings_of: dict[str, Any] = {a: tuple(b) if isinstance(b, list) else b for a, b in given.items()}
            settings = AuvSettings(**settings_of)
            new = cls(settings, compass=head["compass"], **head["sensors"])
            place = 0

            def take(*shape: int) -> Array:
                nonlocal place
                n = math.prod(shape)
                place += n
                return numbers[place - n : place].reshape(shape).copy()

            nx, n = new.x.size, new.P.shape[0]
            new.x, new.P, new.X = take(nx), take(n, n), take(n, n)
            new.started = head["started"]
            w = head["wait"]
            new._wait = _Waiting(take(3), w["weight"])
            new._wait.mag = take(3) if w["mag"] else None
            new._wait.row = take(new.width) if w["row"] else None
            new._wait.time, new._wait.depth, new._wait.speed = w["time"], w["depth"], w["speed"]
            new._wait.first = tuple(w["first"]) if w["first"] else None
            new._wait.fix = tuple(w["fix"]) if w["fix"] else None
            new._wait.dvl = w["dvl"]
            new._pending = [Measurement(m[0], m[1], tuple(m[2:])) for m in head["pending"]]
            new._done = deque(Measurement(m[0], m[1], tuple(m[2:])) for m in head["done"])
            new._rows = deque(take(new.width) for _ in range(head["rows"]))
            new._marks = deque((take(nx), take(n, n), take(n, n)) for _ in range(head["marks"]))
            if place != numbers.size:
                raise ValueError("length")
        except (ValueError, KeyError, TypeError, IndexError, AttributeError, struct.error) as error:
            raise InputError("these bytes are not a saved AUV filter of this version; save one with .save()") from error
        return new

    # --- inside -------------------------------------------------------------------------------------------------

    def _tail_row(self) -> Array:
        k = _k()
        row = np.zeros(self.width)
        row[0] = self.x[k.TROW]
        return row

    def _keep(self, row: Array) -> None:
        self._rows.append(row)
        oldest = row[0] - self.settings.late
        if self._rows[0][0] < oldest:
            while len(self._marks) > 1 and self._marks[1][0][_T] < oldest:
                self._marks.popleft()
            held = self._marks[0][0][_T] if self._marks else oldest
            while self._rows[0][0] <= held and len(self._rows) > 1:
                self._rows.popleft()
            while self._done and self._done[0].time < held:
                self._done.popleft()

    def _run(self, row: Array, first: int, measurements: tuple[Measurement, ...] | list[Measurement]) -> None:
        """first 0: the row and the measurements inside it; first 1: measurements at or after the last row."""
        from schuler.kernels.auv_run import run

        b = self._buffers
        if measurements:
            mt, mk, mz, innov = _arrays(list(measurements))
            if first == 0:
                self._done.extend(measurements)
        else:
            mt, mk, mz, innov = b.mt, b.mk, b.mz, b.innov
        b.counts[:] = 0
        run(
            self.x, self.P, self.X, self.c, np.asarray(row, dtype=np.float64).reshape(1, -1), mt, mk, mz, 1.0,
            b.ox, b.o3, b.o3, b.o3, innov, b.inner_t, b.inner, b.nodes, b.ustd, first, b.counts,
        )  # fmt: skip
        _, k0, k1, nodes, _ = b.counts
        for kind, count, j in (("levelling", k0, 0), ("magnetometer", k1, 1)):
            if count:
                self.last[kind] = b.inner[j, count - 1].copy()
        for i, m in enumerate(measurements):
            self.last[m.kind] = innov[i]
        if nodes:
            self._marks.append((self.x.copy(), self.P.copy(), self.X.copy()))

    def _replay(self, late: Measurement | Array) -> bool:
        """Back to the last mark before what came late (a measurement, a row), and forward again in the right order."""
        time = late.time if isinstance(late, Measurement) else float(late[0])
        if not self._marks or self._marks[0][0][_T] >= time:
            return False
        while self._marks[-1][0][_T] >= time:
            self._marks.pop()
        x, P, X = self._marks[-1]
        since = x[_T]
        rows = [r for r in self._rows if r[0] > since]
        again = [m for m in self._done if m.time > since]
        if isinstance(late, Measurement):
            again = sorted([*again, late], key=_order)
        else:
            rows = sorted([*rows, late], key=lambda r: float(r[0]))
        self._done = deque(m for m in self._done if m.time <= since)
        self._rows = deque(r for r in self._rows if r[0] <= since)
        self.x, self.P, self.X = x.copy(), P.copy(), X.copy()
        for row in rows:
            self._rows.append(row)
            inside = [m for m in again if m.time <= row[0]]
            again = again[len(inside) :]
            self._run(row, 0, inside)
        for m in again:
            self._done.append(m)
            self._run(self._rows[-1] if self._rows else self._tail_row(), 1, (m,))
        return True

    # --- before the start ---------------------------------------------------------------------------------------

    def _wait_row(self, row: Array) -> None:
        w = self._wait
        if math.isfinite(w.time):
            dt = row[0] - w.time
            if dt <= 0.0:
                return
            w.weight *= math.exp(-dt / 2.0)
            w.force = w.force * math.exp(-dt / 2.0)
        w.time = float(row[0])
        w.row = row
        if not self.compass:
            w.force = w.force + row[4:7]
            w.weight += 1.0
            w.mag = row[7:10] if self.width == 10 and np.isfinite(row[7:10]).all() else None
        start = self.settings.start
        if start.time is not None and row[0] < start.time:
            return
        if start.lat is not None and start.lon is not None:
            self._try_start(w.time, None, math.nan, math.nan)
        elif self.compass and w.fix is not None:
            # The fix came before the first compass row: start there, with this attitude, and move on to the row.
            self._try_start(w.fix[0], Measurement("position", w.fix[0], w.fix[1:]), math.nan, math.nan)  # type: ignore[arg-type]
            if self.started:
                self.predict(row)

    def _wait_measurement(self, m: Measurement) -> bool:
        w = self._wait
        start = self.settings.start
        if start.time is not None and m.time < start.time:
            return False
        if m.kind == "position":
            w.fix = (m.time, *m.z)
            if w.first is None:
                w.first = (m.time, m.z[0], m.z[1])
            course, std = math.nan, math.nan
            north = (m.z[0] - w.first[1]) * 6.37e6
            east = (m.z[1] - w.first[2]) * 6.37e6 * math.cos(m.z[0])
            way = math.hypot(north, east)
            if way > max(30.0, 20.0 * m.z[3]):
                # The vehicle may have turned on the way: a rough course, so far as heading goes.
                course, std = math.atan2(east, north), math.radians(45.0)
            self._try_start(m.time, m, course, std)
        elif m.kind == "velocity":
            way = math.hypot(m.z[0], m.z[1])
            noise = math.hypot(m.z[3], self.settings.wave_std)
            known = math.isfinite(w.speed) or not self.sensors["log"] or self._waited(m.time)
            if known and w.fix is not None and m.time - w.fix[0] < 2.0 and way > max(0.4, 5.0 * noise):
                fix = Measurement("position", w.fix[0], tuple(w.fix[1:]))  # type: ignore[arg-type]
                self._try_start(m.time, fix, math.atan2(m.z[1], m.z[0]), math.radians(60.0), way)
                if self.started:
                    return self.update(m)
        elif m.kind == "depth":
            w.depth = m.z[0]
        elif m.kind == "speed":
            w.speed = m.z[0]
        return True

    def _waited(self, time: float) -> bool:
        """Has the log been silent for some seconds since the first fix?"""
        return self._wait.first is not None and time - self._wait.first[0] > 5.0

    def _try_start(
        self, time: float, fix: Measurement | None, course: float, course_std: float, speed: float = math.nan
    ) -> None:
        """Starts where position, level and heading are known well enough to be linear."""
        from schuler.kernels import auv_state as k
        from schuler.kernels.rotation import quat_from_euler

        w, s, st = self._wait, self.settings, self.settings.start
        if w.row is None:
            return
        if self.compass:
            roll, pitch, heading = (float(v) for v in w.row[1:4])
            std_level, std_heading = s.attitude_std[0], 0.0
        else:
            f = w.force / max(w.weight, 1e-9)
            roll = math.atan2(-f[1], -f[2])
            pitch = math.atan2(f[0], math.hypot(f[1], f[2]))
            std_level = math.radians(6.0)  # a vehicle under way may have been accelerating
            if st.roll is not None:
                roll = st.roll
            if st.pitch is not None:
                pitch = st.pitch
            if st.heading is not None:
                heading, std_heading = st.heading, st.std_heading or math.radians(5.0)
            elif w.mag is not None:
                # One reading starts it; the readings to come then tell how much of it was the compass offset.
                heading, std_heading = self._compass_heading(roll, pitch, w.mag), math.radians(20.0)
            elif math.isfinite(course):
                heading, std_heading = course, course_std
            else:
                return
        x = np.zeros(k.NX)
        v = initial_variances(s, compass=self.compass, **{f"has_{name}": on for name, on in self.sensors.items()})
        x[k.QUAT : k.QUAT + 4] = quat_from_euler(roll, pitch, heading)
        x[k.ROLL], x[k.PITCH], x[k.HEAD] = roll, pitch, heading
        if not self.compass:
            v[0] = v[1] = (st.std_roll or std_level) ** 2
            v[2] = std_heading**2
        P = np.diag(v)
        from_fix = st.lat is None or st.lon is None
        if from_fix:
            if fix is None:
                return
            x[k.LAT], x[k.LON] = fix.z[0], fix.z[1]
            for e, b, sig in ((k.E_N, k.E_EN, fix.z[3]), (k.E_E, k.E_EE, fix.z[4])):
                P[e, e] = sig**2 + s.gnss_correlated_std**2
                P[e, b] = P[b, e] = -(s.gnss_correlated_std**2)  # the fix's slow error is now the position's
        else:
            x[k.LAT], x[k.LON] = st.lat, st.lon
            for e, std in zip((k.E_N, k.E_E), st.std_pos, strict=False):
                P[e, e] = (1.0 if std is None else std) ** 2
        height = st.height if st.height is not None else (fix.z[2] if fix is not None else math.nan)
        if st.std_pos[2] is not None:
            std_down = st.std_pos[2]
        elif st.height is not None:
            std_down = 1.0
        else:
            std_down = fix.z[5] if fix is not None else 0.0
        if not math.isfinite(height):
            height, std_down = 0.0, 0.0
        depth = w.depth if math.isfinite(w.depth) else 0.0
        x[k.HGT] = height
        P[k.E_D, k.E_D] = s.depth_std**2 + 0.5**2
        if self.sensors["depth"]:
            x[k.HREF] = height + (0.0 if from_fix or st.height is not None else depth)
            x[k.HGT] = x[k.HREF] - depth
            x[k.VHREF] = std_down**2 if st.height is None else 0.0
            if st.height is not None:
                x[k.HREF] = st.height + depth
                x[k.HGT] = st.height
        else:
            P[k.E_D, k.E_D] = std_down**2
        x[k.U] = x[k.STEADY] = next((v for v in (w.speed, speed) if math.isfinite(v)), 0.0)
        if math.isfinite(w.speed):
            P[k.E_U, k.E_U] = (4.0 * s.speed_std) ** 2 + (s.speed_scale_std * w.speed) ** 2
        x[k.T] = x[k.TC] = x[k.TNODE] = x[k.TROW] = x[k.TINFO] = x[k.TFIX] = time
        x[k.ZDT] = -math.inf
        x[k.SNIS] = x[k.WILD] = 1.0
        self.x, self.P, self.X = x, P, P.copy()
        k.refresh_earth(self.x)
        k.refresh_telling(self.x, self.c)
        k.reset_levelling(self.x)
        self.started = True
        self._marks.append((self.x.copy(), self.P.copy(), self.X.copy()))

    def _compass_heading(self, roll: float, pitch: float, mag: Array) -> float:
        """Tilt-compensated true heading of a field (3,) in b."""
        from schuler.kernels.rotation import dcm_from_quat, quat_from_euler

        c = np.array(dcm_from_quat(*quat_from_euler(roll, pitch, 0.0))).reshape(3, 3)
        level = c @ mag
        return math.atan2(-level[1], level[0]) + self.settings.declination


@dataclass
class _Buffers:
    mt: Array
    mk: NDArray[np.int64]
    mz: Array
    innov: Array
    ox: Array
    o3: Array
    inner_t: Array
    inner: Array
    nodes: tuple[Array, ...]
    ustd: Array
    counts: NDArray[np.int64]


def _buffers() -> _Buffers:
    from schuler.kernels.auv_run import INNOVATION, OUT
    from schuler.kernels.auv_state import NX, N

    empty = (np.zeros((0, NX)), np.zeros((0, N, N)), np.zeros((0, NX)), np.zeros((0, N, N)), np.zeros((0, N, N)))
    return _Buffers(
        np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 7)), np.zeros((0, INNOVATION)), np.zeros((0, OUT)),
        np.zeros((0, 3, 3)), np.zeros((2, 4)), np.zeros((2, 4, INNOVATION)), empty, np.zeros((0, N)),
        np.zeros(5, np.int64),
    )  # fmt: skip


def _arrays(measurements: list[Measurement]) -> tuple[Array, NDArray[np.int64], Array, Array]:
    from schuler.kernels.auv_run import INNOVATION

    n = len(measurements)
    mt = np.array([m.time for m in measurements], dtype=np.float64)
    mk = np.array([KINDS.index(m.kind) for m in measurements], dtype=np.int64)
    mz = np.array([m.z for m in measurements], dtype=np.float64).reshape(n, 7)
    return mt, mk, mz, np.zeros((n, INNOVATION))


def _order(m: Measurement) -> tuple[float, int]:
    return m.time, KINDS.index(m.kind)


def _k() -> Any:
    from schuler.kernels import auv_state

    return auv_state


_T, _TROW = 28, 76  # of kernels.auv_state, needed on every call
