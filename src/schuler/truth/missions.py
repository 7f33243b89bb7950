"""What an AUV really does: surface legs, dives, turns, waves and a current, as functions of time.

Velocity through the water, attitude, current and waves are closed formulas (`kernels.mission`); so are body rate and
specific force, with Earth rate, transport rate, Coriolis and Somigliana gravity. Only position is integrated, by
Simpson's rule on the IMU's epochs. The vehicle moves along its own x axis: v_n = C_nb (v, 0, 0) + current + waves.
Depth is minus the height: the mean sea surface is the ellipsoid.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import pi, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.truth.streams import stream

Array = NDArray[np.float64]

FADE_S = 15.0  # the sea dies away over the first seconds of a dive ...
RETURN_S = 10.0  # ... comes half back in the last ones, and wholly in as many on the surface
CLOSE_S = 10.0  # after a dive a small heave takes the vehicle to the surface exactly
WALK_KNOT_S = 60.0  # the current's walk is drawn at this spacing and joined smoothly
SPEED_RAMP_S = 10.0


@dataclass(frozen=True)
class Waves:
    """The sea at the surface: amplitudes (rad, m/s) and periods (s). Phases are drawn, uniform, per run.

    roll, roll_2, pitch, heading and the orbital velocity (north, east; down in quadrature with north) fade to
    `submerged` in a dive; roll_slow and heading_slow (the vehicle's own weaving) never do.
    """

    roll: float = radians(3.0)
    roll_period: float = 4.3
    roll_2: float = radians(1.5)
    roll_2_period: float = 3.1
    roll_slow: float = radians(0.2)
    roll_slow_period: float = 25.0
    pitch: float = radians(2.0)
    pitch_period: float = 4.7
    heading: float = radians(1.5)
    heading_period: float = 5.3
    heading_slow: float = radians(0.7)
    heading_slow_period: float = 33.0
    orbital: float = 0.1
    north_period: float = 4.5
    east_period: float = 4.9
    submerged: float = 0.06

    @classmethod
    def of(cls, roll: float, pitch: float, orbital: float) -> Waves:
        """The default sea scaled to a roll and pitch (rad) and an orbital velocity (m/s); the weaving stays."""
        d = cls()
        return cls(
            roll=roll, roll_2=0.5 * roll, pitch=pitch, heading=pitch * d.heading / d.pitch, orbital=orbital
        )  # fmt: skip

    @classmethod
    def none(cls) -> Waves:
        """Neither waves nor weaving."""
        return cls(roll=0.0, roll_2=0.0, roll_slow=0.0, pitch=0.0, heading=0.0, heading_slow=0.0, orbital=0.0)

    def table(self, phases: Array) -> Array:
        """(8, 3): amplitude, angular frequency rad/s and phase rad in the order of `kernels.mission`."""
        rows = [
            (self.roll, self.roll_period),
            (self.roll_2, self.roll_2_period),
            (self.pitch, self.pitch_period),
            (self.heading, self.heading_period),
            (self.orbital, self.north_period),
            (self.orbital, self.east_period),
            (self.roll_slow, self.roll_slow_period),
            (self.heading_slow, self.heading_slow_period),
        ]
        return np.array([(a, 2.0 * pi / period, p) for (a, period), p in zip(rows, phases, strict=True)])


@dataclass(frozen=True)
class Change:
    """A smooth step `start` seconds into each dive, `length` seconds long, by `by` (rad or m/s)."""

    start: float
    length: float
    by: float


# The set-up of the paper's tests (assumed, the paper does not say): seconds into the dive.
TURNS = (Change(120.0, 20.0, radians(-30.0)), Change(270.0, 20.0, radians(45.0)), Change(400.0, 20.0, radians(-20.0)))
SPEED_STEPS = tuple(Change(t, 5.0, by) for t, by in ((100.0, -0.5), (180.0, 0.5), (300.0, -0.5), (380.0, 0.5)))


@dataclass(frozen=True)
class AuvMission:
    """A mission in SI and radians; `realise(seed, run)` draws what is random and gives the motion.

    lat, lon : rad; height : m above the ellipsoid at the start (0: the sea surface).
    surface, dive, between, final_surface : s; `between` is the surface leg between dives (None: as `surface`).
    pitch : rad, nose-down angle of the descent (and nose-up of the ascent), reached in `pitch_ramp` s; the descent
        ramps down in [0, pitch_ramp] and up in [descent, descent + pitch_ramp], the ascent is its mirror image.
    l_shape : each surface leg before a dive turns 90 deg to the right half-way and back at its end.
    current : m/s (north, east) at the surface; drawn besides: current_std per axis; current_walk, m/s/sqrt(s), a
        random walk of each axis; current_shear, 1/s, is added times depth along the current (north if there is none).
    speed_scale : k of the speed log, v_s = (1 + k) v; speed_scale_std is drawn besides.
    magnetic_field : tesla, north, east, down.
    Turns accumulate: a second dive starts on the heading on which the first one ended.
    """

    name: str = "auv"
    lat: float = radians(36.73)
    lon: float = radians(52.65)
    height: float = 0.0
    surface: float = 100.0
    dive: float = 520.0
    dives: int = 1
    between: float | None = None
    final_surface: float = 0.0
    surface_speed: float = 2.0
    dive_speed: float = 2.5
    speed_steps: tuple[Change, ...] = SPEED_STEPS
    heading: float = radians(90.0)
    turns: tuple[Change, ...] = TURNS
    pitch: float = radians(8.0)
    descent: float = 55.0
    ascent: float = 55.0
    pitch_ramp: float = 10.0
    l_shape: bool = False
    current: tuple[float, float] = (0.0, 0.0)
    current_std: float = 0.0
    current_walk: float = 0.0
    current_shear: float = 0.0
    waves: Waves = field(default_factory=Waves)
    speed_scale: float = 0.0
    speed_scale_std: float = 0.0
    magnetic_field: tuple[float, float, float] = (27.59e-6, 2.51e-6, 39.57e-6)

    def __post_init__(self) -> None:
        times = (self.surface, self.dive, self.between or 0.0, self.final_surface)
        if self.dives < 0 or not all(np.isfinite(times)) or min(times) < 0.0 or self.duration <= 0.0:
            raise InputError(
                f"mission {self.name!r} has {self.dives} dives and legs of {times} s (surface, dive, between, final): "
                "they must not be negative, and the whole must last"
            )

    @property
    def duration(self) -> float:
        """s"""
        between = self.surface if self.between is None else self.between
        return self.surface + self.dives * self.dive + max(0, self.dives - 1) * between + self.final_surface

    @property
    def dive_intervals(self) -> Array:
        """(dives, 2): start and end of each dive, s."""
        between = self.surface if self.between is None else self.between
        start = self.surface + np.arange(self.dives) * (self.dive + between)
        return np.column_stack([start, start + self.dive])

    @property
    def declination(self) -> float:
        """rad, positive east."""
        return float(np.arctan2(self.magnetic_field[1], self.magnetic_field[0]))

    def surfaced(self, t: Array) -> NDArray[np.bool_]:
        """Whether the antenna is out of the water at times t: not in start < t <= end of any dive."""
        if not self.dives:
            return np.ones(np.shape(t), bool)
        dives = self.dive_intervals
        i = np.searchsorted(dives[:, 0], t, side="left") - 1
        return np.asarray((i < 0) | (t > dives[np.maximum(i, 0), 1]))

    def realise(self, seed: int = 0, run: int = 0, rate_hz: float = 100.0) -> AuvMotion:
        """The motion of one run: phases, current, its walk and the log's scale drawn from (seed, run)."""
        return AuvMotion(self, seed, run, rate_hz)

    def state(self, t: Array, seed: int = 0, run: int = 0, rate_hz: float = 100.0) -> State:
        """Truth at times t (s, sorted, not negative) of one run."""
        return self.realise(seed, run, rate_hz).state(t)

    def with_changes(self, **changes: Any) -> AuvMission:
        """A new mission; this one is unchanged."""
        return replace(self, **changes)


@dataclass(frozen=True)
class State:
    """Truth at times: row i belongs to time[i]. NED, FRD, rad, m/s; heading runs on, it is not wrapped."""

    time: Array
    grid: Array

    @property
    def lat(self) -> Array:
        return self.grid[:, 0]

    @property
    def lon(self) -> Array:
        return self.grid[:, 1]

    @property
    def height(self) -> Array:
        return self.grid[:, 2]

    @property
    def v_n(self) -> Array:
        """(n, 3) over ground."""
        return self.grid[:, 3:6]

    @property
    def roll(self) -> Array:
        return self.grid[:, 6]

    @property
    def pitch(self) -> Array:
        return self.grid[:, 7]

    @property
    def heading(self) -> Array:
        return self.grid[:, 8]

    @property
    def w_ib_b(self) -> Array:
        """(n, 3) rad/s, Earth and transport rate included."""
        return self.grid[:, 9:12]

    @property
    def f_b(self) -> Array:
        """(n, 3) m/s^2, (0, 0, -g) at rest and level."""
        return self.grid[:, 12:15]

    @property
    def speed(self) -> Array:
        """Along body x, through the water, m/s."""
        return self.grid[:, 15]

    @property
    def current(self) -> Array:
        """(n, 2) north, east at the vehicle's depth, m/s, waves not included."""
        return self.grid[:, 16:18]


@dataclass(frozen=True)
class Stretch(State):
    """Consecutive epochs: row 0 is the epoch before, `mean` (n-1, 6) the mean w_ib_b and f_b between the rows."""

    mean: Array
    epoch: int
    rate_hz: float


class AuvMotion:
    """One run of a mission: `state(t)` anywhere, `cursor()` to walk through it with flat memory."""

    def __init__(self, mission: AuvMission, seed: int, run: int, rate_hz: float) -> None:
        self.mission = mission
        self.rate_hz = float(rate_hz)
        self.epochs = round(mission.duration * rate_hz)
        phases = stream(seed, run, "waves").uniform(0.0, 2.0 * pi, 8)
        self.waves = mission.waves.table(phases)
        current = np.asarray(mission.current) + mission.current_std * stream(seed, run, "current").standard_normal(2)
        size = float(np.hypot(*current))
        along = current / size if size > 0.0 else np.array([1.0, 0.0])
        self.current = np.concatenate([current, mission.current_shear * along])
        scale = stream(seed, run, "speed.scale").standard_normal()
        self.speed_scale = mission.speed_scale + mission.speed_scale_std * float(scale)
        knots = int(mission.duration // WALK_KNOT_S) + 1 if mission.current_walk > 0.0 else 0
        walk = stream(seed, run, "current.walk").standard_normal((knots, 2))
        self.profiles = profiles(mission, walk * mission.current_walk * np.sqrt(WALK_KNOT_S))

    def start(self) -> Array:
        """Position at t = 0: lat, lon, height."""
        m = self.mission
        return np.array([m.lat, m.lon, m.height])

    def cursor(self) -> Cursor:
        return Cursor(self)

    def state(self, t: Array) -> State:
        """Truth at times t (s, sorted, not negative)."""
        from schuler.kernels import mission as kernel

        t = np.atleast_1d(np.asarray(t, float))
        if t.size and (t[0] < 0.0 or np.any(np.diff(t) < 0.0) or not np.all(np.isfinite(t))):
            raise InputError("state(t) wants finite times in rising order from 0 on")
        walker = Cursor(self)
        grid = np.empty((t.size, kernel.GRID))
        kernel.sample(t, self.rate_hz, walker.pos, walker.m, walker.q, *walker.parameters, grid)
        return State(t, grid)


class Cursor:
    """Walks through a motion epoch by epoch; any split into `advance` calls gives the same bits."""

    def __init__(self, motion: AuvMotion) -> None:
        from schuler.kernels import mission as kernel

        self.motion = motion
        self.epoch = 0
        self.pos = motion.start()
        self.m = np.empty(15)
        self.q = np.empty(9)
        offsets, start, length, before, delta = motion.profiles
        self.parameters = (offsets, offsets[:-1].copy(), start, length, before, delta, motion.waves, motion.current)
        self.last = np.empty(kernel.GRID)
        kernel.begin(self.pos, *self.parameters, self.m, self.q, self.last)

    @property
    def left(self) -> int:
        """Epochs to the end of the mission."""
        return self.motion.epochs - self.epoch

    def advance(self, n: int) -> Stretch:
        """The next n epochs (fewer at the end of the mission)."""
        from schuler.kernels import mission as kernel

        n = min(n, self.left)
        rate = self.motion.rate_hz
        grid = np.empty((n + 1, kernel.GRID))
        mean = np.empty((n, 6))
        grid[0] = self.last
        kernel.advance(self.epoch, n, rate, self.pos, self.m, self.q, *self.parameters, grid[1:], mean)
        self.last = grid[n].copy()
        time = np.arange(self.epoch, self.epoch + n + 1) / rate
        epoch = self.epoch
        self.epoch += n
        return Stretch(time, grid, mean, epoch, rate)


Steps = list[tuple[float, float, float]]  # start, length, change


def profiles(m: AuvMission, walk: Array) -> tuple[NDArray[np.int64], Array, Array, Array, Array]:
    """All smooth steps of a mission: offsets of the seven profiles, then start, length, value before, change."""
    heading: Steps = []
    speed: Steps = []
    pitch: Steps = []
    fade: Steps = []
    heave: Steps = []
    dives = m.dive_intervals
    legs = np.concatenate([[0.0], dives[:-1, 1]]) if m.dives else np.zeros(0)
    excess = net_depth(m, m.dive) if m.dives and m.pitch else 0.0
    for (start, end), leg in zip(dives, legs, strict=True):
        if m.l_shape and start > leg:
            turn = min(20.0, 0.2 * (start - leg))
            heading += [((leg + start) / 2.0 - turn, turn, pi / 2.0), (start - turn, turn, -pi / 2.0)]
        heading += [(start + c.start, c.length, c.by) for c in m.turns]
        speed.append((start, SPEED_RAMP_S, m.dive_speed - m.surface_speed))
        speed += [(start + c.start, c.length, c.by) for c in m.speed_steps]
        speed.append((end, SPEED_RAMP_S, m.surface_speed - m.dive_speed - sum(c.by for c in m.speed_steps)))
        if m.pitch != 0.0:
            pitch += [(start + a, length, by) for a, length, by in _pitch_steps(m)]
            heave.append((end, CLOSE_S, -excess))
        low = m.waves.submerged
        fade += [(start, FADE_S, low - 1.0), (end - RETURN_S, RETURN_S, 0.5 - low), (end, RETURN_S, 0.5)]
    north, east = ([(i * WALK_KNOT_S, WALK_KNOT_S, float(w)) for i, w in enumerate(axis)] for axis in walk.T)
    first = (m.heading, m.surface_speed, 0.0, 1.0, 0.0, 0.0, 0.0)
    names = ("turns", "speed steps", "pitch ramps", "waves", "current", "current", "surfacing")
    rows: list[tuple[float, float, float, float]] = []
    offsets = [0]
    for steps, value, name in zip((heading, speed, pitch, fade, north, east, heave), first, names, strict=True):
        steps = sorted(steps) or [(0.0, 1.0, 0.0)]
        for (a, length, _), (b, _, _) in zip(steps[:-1], steps[1:], strict=True):
            if a + length > b + 1e-9:
                raise InputError(
                    f"mission {m.name!r}: {name} overlap, one lasts from {a:g} to {a + length:g} s and the next begins "
                    f"at {b:g} s: give the surface legs or the dive more seconds"
                )
        for a, length, by in steps:
            rows.append((a, length, value, by))
            value += by
        offsets.append(len(rows))
    start_s, length_s, before, delta = np.array(rows).T
    return (
        np.array(offsets, dtype=np.int64),
        np.ascontiguousarray(start_s), np.ascontiguousarray(length_s),
        np.ascontiguousarray(before), np.ascontiguousarray(delta),
    )  # fmt: skip


def _pitch_steps(m: AuvMission) -> Steps:
    """The pitch of one dive: nose down, level, nose up, level; seconds into the dive."""
    r = m.pitch_ramp
    return [
        (0.0, r, -m.pitch),
        (m.descent, r, m.pitch),
        (m.dive - m.ascent - r, r, m.pitch),
        (m.dive - r, r, -m.pitch),
    ]


def _smooth(t: Array, start: float, length: float) -> Array:
    u = np.clip((t - start) / length, 0.0, 1.0)
    return np.asarray(u**3 * (10.0 - u * (15.0 - 6.0 * u)))


def net_depth(m: AuvMission, until: float) -> float:
    """Depth gained `until` seconds into a dive, waves left out (m, by Simpson's rule)."""
    n = 2 * max(100, round(until / 0.1))
    t = np.linspace(0.0, until, n + 1)
    speed = m.surface_speed + (m.dive_speed - m.surface_speed) * _smooth(t, 0.0, SPEED_RAMP_S)
    for c in m.speed_steps:
        speed += c.by * _smooth(t, c.start, c.length)
    pitch = np.zeros_like(t)
    for start, length, by in _pitch_steps(m):
        pitch += by * _smooth(t, start, length)
    down = -speed * np.sin(pitch)
    return float((down[0] + down[-1] + 4.0 * down[1:-1:2].sum() + 2.0 * down[2:-1:2].sum()) * until / n / 3.0)


PRESETS: Mapping[str, AuvMission] = {
    "demo": AuvMission(
        name="demo", final_surface=60.0, current=(0.12, 0.18), current_walk=0.06 / 60.0, speed_scale=0.007
    ),
    "paper-test-1": AuvMission(name="paper-test-1"),
    "paper-test-2": AuvMission(name="paper-test-2", surface=62.0, dive=523.0),
}
