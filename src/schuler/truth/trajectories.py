"""Trajectories as analytic functions of time, and the ideal IMU that they give.

Position, velocity, attitude, body rate and specific force come from one formula on the rotating ellipsoid or sphere;
IMU increments are integrals of the exact rate and force, by Gauss-Legendre quadrature good to rounding. NED, body FRD,
SI and radians; heading clockwise from north.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import WGS84, Ellipsoid, Sphere, sphere
from schuler.ground.errors import InputError
from schuler.ground.frames import euler_from_quat, quat_from_euler, quat_multiply
from schuler.ground.tables import Table

Array = NDArray[np.float64]
SPEED, CLIMB, COURSE, ROLL, PITCH, HEADING = range(6)
NAMES = {"speed": SPEED, "climb": CLIMB, "course": COURSE, "roll": ROLL, "pitch": PITCH, "heading": HEADING}
_STEP = np.array([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])  # smooth step 0 -> 1, third derivative continuous
_BUMP = np.array([0.0, 0.0, 0.0, 140.0, -420.0, 420.0, -140.0, 0.0])  # its derivative: area 1
_SPIN = np.array([0.0, 0.0, 0.0, 0.0, 2.5, -3.0, 1.0, 0.0])  # integral of a rate that steps smoothly 0 -> 1
G_BANK = 9.80665
SHORTEST = 2.0  # s, of a turn or a climb: less is a jolt that no IMU rate resolves
# The sphere of the studies: the equatorial radius and g = 9.81 m/s^2, for which the thesis's runs were recomputed.
TEXTBOOK = sphere(6378137.0, 9.81 * 6378137.0**2)


def earth_vector(earth: Ellipsoid) -> Array:
    """The Earth as the kernels take it: a, e^2, rate, equator gravity, Somigliana k, f, m, 1 if sphere."""
    ball = 1.0 if isinstance(earth, Sphere) else 0.0
    return np.array([earth.a, earth.e2, earth.omega, earth.gamma_e, earth.somigliana_k, earth.f, earth.m, ball])


@dataclass(frozen=True)
class Truth:
    """Truth at n instants: time (n,) s; lat, lon (n,) rad; height (n,) m; v_n (n, 3) m/s; q_nb (n, 4), scalar first;
    w_ib_b (n, 3) rad/s and f_b (n, 3) m/s^2 at that instant, from `Trajectory.at` only (else (n, 0))."""

    time: Array
    lat: Array
    lon: Array
    height: Array
    v_n: Array
    q_nb: Array
    w_ib_b: Array
    f_b: Array

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rpy(self) -> Array:
        """(n, 3) roll, pitch, heading, rad."""
        return np.column_stack(euler_from_quat(self.q_nb))

    def table(self) -> Table:
        """As the contract's reference table."""
        rpy = self.rpy
        return Table(
            "reference",
            {
                "time": self.time,
                "lat": self.lat,
                "lon": self.lon,
                "height": self.height,
                "v_north": self.v_n[:, 0],
                "v_east": self.v_n[:, 1],
                "v_down": self.v_n[:, 2],
                "roll": rpy[:, 0],
                "pitch": rpy[:, 1],
                "heading": np.mod(rpy[:, 2], 2.0 * math.pi),
            },
            source="trajectory",
        )


@dataclass(frozen=True)
class Ideal:
    """What perfect sensors give: integrals over (t[k-1], t[k]] and the truth at every `every`-th epoch.

    time (n,) s, the ends of the intervals; dtheta (n, 3) rad; dv (n, 3) m/s; dt s; start and truth: see `Truth`.
    """

    time: Array
    dtheta: Array
    dv: Array
    dt: float
    start: Truth
    truth: Truth

    def table(self, kind: Literal["increments", "rates"] = "increments") -> Table:
        """The imu table: increments, or their means over the interval as rates."""
        return imu_table(self.time, self.dtheta, self.dv, self.dt, kind)


def imu_table(
    time: Array, dtheta: Array, dv: Array, dt: float | Array, kind: Literal["increments", "rates"] = "increments"
) -> Table:
    """An imu table of increments (n, 3) rad, m/s over intervals dt, or of their mean rates."""
    columns: dict[str, NDArray] = {"time": time}
    names = ("dtheta", "dv") if kind == "increments" else ("gyro", "accel")
    scale = np.ones(1) if kind == "increments" else 1.0 / np.broadcast_to(dt, time.shape)
    for name, values in zip(names, (dtheta, dv), strict=True):
        for i, axis in enumerate("xyz"):
            columns[f"{name}_{axis}"] = values[:, i] * scale
    return Table("imu", columns, kind=kind, source="trajectory")


@dataclass(frozen=True)
class Trajectory:
    """A motion from time 0 to `duration` (s); made by the functions of this module.

    lat, lon (rad), height (m) at the start; earth; the polynomial pieces and waves that `kernels.motion` evaluates.
    fastest : rad/s, the highest frequency in the motion, from which the quadrature's order is chosen.
    """

    name: str
    duration: float
    lat: float
    lon: float
    height: float
    earth: Ellipsoid
    par: Array
    breaks: Array
    coefs: Array
    waves: Array
    fastest: float
    start_time: float = 0.0
    notes: list[str] = field(default_factory=list)

    @cached_property
    def earth_array(self) -> Array:
        return earth_vector(self.earth)

    def with_waves(self, *waves: tuple[str, float, float, float]) -> Trajectory:
        """The same with amplitude sin(2 pi f t + phase) added: (channel, amplitude SI, f in Hz, phase in rad) each.

        Channels: speed, climb (m/s), course, roll, pitch, heading (rad).
        """
        rows = np.array([[NAMES[c], a, 2.0 * math.pi * f, p] for c, a, f, p in waves], dtype=np.float64)
        fastest = max(self.fastest, float(np.max(np.abs(rows[:, 2]))))
        return replace(self, waves=np.vstack([self.waves, rows]), fastest=fastest)

    def nodes_for(self, dt: float) -> int:
        """Gauss-Legendre nodes whose error over dt is below rounding (three times the highest frequency assumed)."""
        x = 3.0 * self.fastest * dt
        for m in range(3, 12):
            error = math.factorial(m) ** 4 / ((2 * m + 1) * math.factorial(2 * m) ** 3) * x ** (2 * m)
            if error < 1e-16:
                return m
        return 12

    def ideal(
        self, rate_hz: float, duration: float | None = None, *, every: int = 1, nodes: int | None = None
    ) -> Ideal:
        """Perfect IMU increments at rate_hz; truth at every `every`-th epoch. See `Ideal`."""
        from schuler.kernels import motion

        if not rate_hz > 0.0:
            raise InputError(f"rate_hz is {rate_hz}: give the IMU rate in Hz, more than 0")
        total = self.duration if duration is None else duration
        n = int(math.floor(total * rate_hz * (1.0 + 1e-12) + 1e-9))
        if n < 1:
            raise InputError(f"{total} s at {rate_hz} Hz holds no sample; lengthen duration_s or raise rate_hz")
        c, b, a = gauss(nodes or self.nodes_for(1.0 / rate_hz))
        dtheta, dv = np.empty((n, 3)), np.empty((n, 3))
        rows = np.empty((n // every, motion.SHORT))
        pos = np.array([self.lat, self.lon, self.height, 0.0, 0.0, 0.0])
        motion.generate(
            0, n, float(rate_hz), pos, self.par, self.earth_array, self.breaks, self.coefs, self.waves, c, b, a,
            every, dtheta, dv, rows,
        )  # fmt: skip
        time = self.start_time + np.arange(1, n + 1) / rate_hz
        truth = _truth(time[every - 1 :: every], rows)
        return Ideal(time, dtheta, dv, 1.0 / rate_hz, self.at(0.0), truth)

    def at(self, t: ArrayLike) -> Truth:
        """The truth at times t (s from the start, any order)."""
        from schuler.kernels import motion

        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        if times.size and not (np.min(times) >= 0.0 and np.max(times) <= self.duration * (1 + 1e-12)):
            raise InputError(
                f"the trajectory runs from 0 to {self.duration} s; asked for {times.min()} to {times.max()}"
            )
        order = np.argsort(times, kind="stable")
        grid = 0.05
        c, b, a = gauss(max(self.nodes_for(grid), 4))
        rows = np.empty((times.size, motion.ROW))
        pos = np.array([self.lat, self.lon, self.height, 0.0, 0.0, 0.0])
        motion.sample(
            times[order], grid, pos, self.par, self.earth_array, self.breaks, self.coefs, self.waves, c, b, a, rows
        )
        out = np.empty_like(rows)
        out[order] = rows
        return _truth(self.start_time + times, out)


def _truth(time: Array, rows: Array) -> Truth:
    return Truth(time, *rows[:, :3].T.copy(), *np.split(rows[:, 3:], [3, 7, 10], axis=1))


def gauss(m: int) -> tuple[Array, Array, Array]:
    """Gauss-Legendre nodes c (m,), weights b (m,) and collocation matrix a (m, m) on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(m)
    c, b = 0.5 * (x + 1.0), 0.5 * w
    powers = np.vander(x, m, increasing=True)
    integrals = (np.vander(x, m + 1, increasing=True)[:, 1:] - (-1.0) ** np.arange(1, m + 1)) / np.arange(1, m + 1)
    return c, b, np.asarray(0.5 * np.linalg.solve(powers.T, integrals.T).T, dtype=np.float64)


# Building blocks


class _Profile:
    """One channel: a value at the start and smooth pieces added one after the other."""

    def __init__(self, start: float) -> None:
        self.start = start
        # start, length, coefficients of u = (t - start)/length, and value and slope in u after it
        self.pieces: list[tuple[float, float, Array, float, float]] = []

    def step(self, start: float, length: float, change: float) -> None:
        if change != 0.0:
            self.pieces.append((start, length, change * _STEP, change, 0.0))

    def bump(self, start: float, length: float, area: float) -> None:
        if area != 0.0:
            self.pieces.append((start, length, area / length * _BUMP, 0.0, 0.0))

    def spin(self, start: float, length: float, rate: float) -> None:
        """A rate that rises smoothly from 0 to `rate` and stays."""
        self.pieces.append((start, length, rate * length * _SPIN, 0.5 * rate * length, rate * length))

    def at(self, t0: float) -> Array:
        """(9,): coefficients in (t - t0) just after t0, and the highest power in use."""
        total = np.zeros(9)
        total[0] = self.start
        for start, length, c, end, slope in self.pieces:
            u = (t0 - start) / length
            if u < -1e-12:
                continue
            if u >= 1.0 - 1e-12:
                total[0] += end + slope * (u - 1.0)
                total[1] += slope / length
                continue
            p = np.polynomial.Polynomial(c)
            for k in range(8):
                total[k] += p(u) / (math.factorial(k) * length**k)
                p = p.deriv()
        if abs(total[0]) < 1e-12 * sum(abs(piece[3]) for piece in self.pieces):
            total[0] = 0.0  # steps that cancel leave nothing: a vehicle that has stopped stands still
        total[8] = max(np.flatnonzero(total[:8]), default=0)
        return total


def _build(
    name: str, duration: float, lat: float, lon: float, height: float, earth: Ellipsoid, profiles: list[_Profile],
    *, follow: bool, extra: tuple[float, ...] = (0.0,),
) -> Trajectory:  # fmt: skip
    from schuler.kernels import motion

    if not duration > 0.0:
        raise InputError(f"duration_s is {duration}: give how long the trajectory lasts, more than 0 s")
    if abs(lat) > math.radians(89.9) and profiles[SPEED].start != 0.0:
        raise InputError(
            f"a trajectory of headings cannot begin at latitude {math.degrees(lat):.3f} deg, where north turns too "
            'fast; use preset = "great-circle"'
        )
    cuts = {0.0}
    for p in profiles:
        for start, length, *_ in p.pieces:
            cuts |= {start, start + length}
    breaks = np.array(sorted(cuts))
    breaks = breaks[np.concatenate([[True], np.diff(breaks) > 1e-9])]
    coefs = np.array([[p.at(t) for p in profiles] for t in breaks])
    par = np.zeros(motion.PARAMETERS)
    par[motion.KIND], par[motion.FOLLOW], par[motion.BANK_G] = motion.SURFACE, float(follow), G_BANK
    par[motion.EXTRA : motion.EXTRA + len(extra)] = extra
    lengths = [piece[1] for p in profiles for piece in p.pieces]
    fastest = 4.0 * math.pi / min(lengths) if lengths else 1e-3
    if par[motion.EXTRA] == 2.0:
        fastest = max(fastest, abs(extra[2]))
    return Trajectory(
        name,
        float(duration),
        float(lat),
        float(lon),
        float(height),
        earth,
        par,
        breaks,
        coefs,
        np.empty((0, 4)),
        fastest,
    )


def _profiles(speed: float = 0.0, course: float = 0.0, roll: float = 0.0, pitch: float = 0.0) -> list[_Profile]:
    return [_Profile(x) for x in (speed, 0.0, course, roll, pitch, 0.0)]


# The trajectories


def rest(
    lat: float, lon: float, height: float = 0.0, *, roll: float = 0.0, pitch: float = 0.0, heading: float = 0.0,
    duration: float = 3600.0, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """Standing still on the Earth. `with_waves` makes it sway."""
    return _build("rest", duration, lat, lon, height, earth, _profiles(0.0, heading, roll, pitch), follow=False)


def rhumb_line(
    lat: float, lon: float, height: float = 0.0, *, speed: float, heading: float, duration: float = 3600.0,
    earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """Constant heading, ground speed and height."""
    return _build("rhumb-line", duration, lat, lon, height, earth, _profiles(speed, heading), follow=True)


def legs(
    lat: float, lon: float, height: float = 0.0, *, speed: float, heading: float, turns: Sequence[float] = (),
    climbs: Sequence[float] = (), turn_rate: float = math.radians(1.5), climb_rate: float = 10.0,
    duration: float = 3600.0, turns_at: Sequence[float] = (), earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """Straight legs with coordinated turns between them, and climbs in the middle of the legs.

    turns (rad, clockwise) are spread evenly over the duration, or have their middles at turns_at (s), at a peak rate of
    turn_rate (rad/s); climbs[i] (m) lies in mid-leg i, at a peak rate of climb_rate (m/s); none is shorter than 2 s.
    Bank is atan(speed rate/g).
    """
    p = _profiles(speed, heading)
    count = max(len(turns), len(climbs) - 1)
    leg = duration / (count + 1)
    if turns_at and len(turns_at) != len(turns):
        raise InputError(f"{len(turns)} turns and {len(turns_at)} times in turns_at: give one time for each turn")
    middles = list(turns_at) or [leg * (i + 1) for i in range(len(turns))]
    for i, turn in enumerate(turns):
        length = max(2.1875 * abs(turn) / turn_rate, SHORTEST)  # peak of the step's slope
        if turns_at:
            low = middles[i - 1] + 0.5 * max(2.1875 * abs(turns[i - 1]) / turn_rate, SHORTEST) if i else 0.0
            if middles[i] - 0.5 * length < low or middles[i] + 0.5 * length > duration:
                raise InputError(
                    f"turn {i + 1} of {math.degrees(turn):g} deg takes {length:.0f} s about {middles[i]:g} s: it "
                    "overlaps the one before or the ends; space the times wider or raise turn_rate_deg_per_s"
                )
        elif length > 0.95 * leg:
            raise InputError(
                f"turn {i + 1} of {math.degrees(turn):g} deg takes {length:.0f} s, longer than its leg of {leg:.0f} s: "
                "lengthen duration_s or raise turn_rate_deg_per_s"
            )
        p[COURSE].step(middles[i] - 0.5 * length, length, turn)
    for i, climb in enumerate(climbs):
        length = max(2.1875 * abs(climb) / climb_rate, SHORTEST)
        if length > 0.95 * leg:
            raise InputError(f"climb {i + 1} of {climb:g} m takes {length:.0f} s, longer than its leg of {leg:.0f} s")
        p[CLIMB].bump(leg * (i + 0.5) - 0.5 * length, length, climb)
    return _build("legs", duration, lat, lon, height, earth, p, follow=True)


def dive(
    lat: float, lon: float, height: float = 0.0, *, speed: float, heading: float, depth: float, bottom: float = 0.5,
    duration: float = 1800.0, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """Down by `depth` m, level for the share `bottom` of the duration, and up again; ground speed constant."""
    p = _profiles(speed, heading)
    leg = 0.5 * duration * (1.0 - bottom)
    p[CLIMB].bump(0.02 * duration, 0.96 * leg, -depth)
    p[CLIMB].bump(duration - 0.02 * duration - 0.96 * leg, 0.96 * leg, depth)
    return _build("dive", duration, lat, lon, height, earth, p, follow=True)


def oscillation(
    lat: float, lon: float, height: float = 0.0, *, roll: float = 0.2, pitch: float = 0.2, heading: float = 0.0,
    rate: float = 1.0, phase: float = 0.5 * math.pi, mean_heading: float = 0.0, speed: float = 0.0,
    duration: float = 600.0, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """The thesis's motion (2.23): angles amplitude sin(rate t), roll ahead by `phase`; amplitudes rad, rate rad/s."""
    f = rate / (2.0 * math.pi)
    still = _build("oscillation", duration, lat, lon, height, earth, _profiles(speed, mean_heading), follow=False)
    return still.with_waves(("roll", roll, f, phase), ("pitch", pitch, f, 0.0), ("heading", heading, f, 0.0))


def coning(
    lat: float, lon: float, height: float = 0.0, *, cone: float = math.radians(1.0), frequency: float = 5.0,
    heading: float = 0.0, duration: float = 60.0, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """Pure coning in place: the rotation vector from level has the constant size `cone` (rad) and turns at `frequency`
    (Hz) in the body's y-z plane, so that the x axis draws a cone."""
    extra = (2.0, cone, 2.0 * math.pi * frequency)
    return _build("coning", duration, lat, lon, height, earth, _profiles(0.0, heading), follow=False, extra=extra)


def turntable(
    lat: float, lon: float, height: float = 0.0, *, rate: float, spin_up: float = 2.0, wait: float = 5.0,
    mount: ArrayLike = (1.0, 0.0, 0.0, 0.0), heading: float = 0.0, duration: float = 120.0, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """A table spinning about the vertical at `rate` (rad/s, clockwise from above) after `wait` s and a smooth spin-up.

    mount : q of the table from the body, (4,), how the IMU sits on the table.
    """
    p = _profiles(0.0, heading)
    p[HEADING].spin(wait, spin_up, rate)
    q = np.asarray(mount, dtype=np.float64)
    return _build("turntable", duration, lat, lon, height, earth, p, follow=False, extra=(1.0, *q))


def great_circle(
    lat: float, lon: float, height: float = 0.0, *, speed: float, heading: float, duration: float = 3600.0,
    earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """A great circle of the ellipsoid's normal, at constant rate: on a sphere the great circle at constant speed.

    Regular everywhere, the poles included. The body stays level with x along the circle of normals. On the ellipsoid
    the ground speed, `speed` at the start, then follows the radius of curvature (0.5 % over a whole quarter).
    """
    from schuler.kernels import motion

    sl, cl, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    north, east = np.array([-sl * co, -sl * so, cl]), np.array([-so, co, 0.0])
    r_n, r_e = (float(r) + height for r in earth.radii(lat))
    # The normal turns along `heading` when the velocity is (r_n cos, r_e sin) of it.
    size = math.hypot(r_n * math.cos(heading), r_e * math.sin(heading))
    par = np.zeros(motion.PARAMETERS)
    par[motion.KIND] = motion.CIRCLE
    par[motion.N0 : motion.N0 + 3] = cl * co, cl * so, sl
    par[motion.T0 : motion.T0 + 3] = math.cos(heading) * north + math.sin(heading) * east
    par[motion.RATE], par[motion.HEIGHT] = speed / size, height
    return Trajectory(
        "great-circle", float(duration), lat, lon, height, earth, par, np.zeros(1), np.zeros((1, 6, 9)),
        np.empty((0, 4)), max(abs(speed / size), 1e-4),
    )  # fmt: skip


def track(
    time: ArrayLike, lat: ArrayLike, lon: ArrayLike, height: ArrayLike, rpy: ArrayLike | None = None,
    *, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """A smooth curve (quintic spline, snap continuous) through a recorded or given track.

    time (n,) s, increasing; lat, lon (n,) rad; height (n,) m; rpy (n, 3) rad or None: then heading and pitch follow the
    path and bank is that of a coordinated turn, as found at the points. At least six points, none near a pole.
    """
    from scipy.interpolate import PPoly, make_interp_spline

    from schuler.kernels import motion

    t = np.asarray(time, dtype=np.float64)
    columns = [np.asarray(x, dtype=np.float64) for x in (lat, lon, height)]
    if t.ndim != 1 or t.size < 6 or any(c.shape != t.shape for c in columns):
        raise InputError("a track needs at least six points with time, lat, lon and height each")
    if not (np.all(np.isfinite(t)) and all(np.all(np.isfinite(c)) for c in columns)):
        raise InputError("the track holds values that are not numbers; remove those rows")
    if np.any(np.diff(t) <= 0.0):
        row = int(np.argmax(np.diff(t) <= 0.0)) + 2
        raise InputError(f"the track's time does not increase at row {row}; sort it and remove repeated rows")
    if np.max(np.abs(columns[0])) > math.radians(89.5):
        raise InputError("the track comes within half a degree of a pole, where longitude is no coordinate; "
                         'use preset = "great-circle" there')  # fmt: skip
    u = t - t[0]
    columns[1] = np.unwrap(columns[1])
    splines = [make_interp_spline(u, c, k=5) for c in columns]
    if rpy is None:
        angles = _follow(u, splines, earth)
    else:
        given = np.asarray(rpy, dtype=np.float64)
        if given.shape != (t.size, 3):
            raise InputError(f"rpy has shape {given.shape}, expected {(t.size, 3)}: roll, pitch, heading in rad")
        angles = np.unwrap(given, axis=0)
    splines += [make_interp_spline(u, angles[:, i], k=5) for i in range(3)]
    pieces = [PPoly.from_spline(s) for s in splines]  # type: ignore[arg-type]
    x = pieces[0].x
    keep = np.flatnonzero(np.diff(x) > 0.0)
    coefs = np.zeros((keep.size, 6, 9))
    for c, p in enumerate(pieces):
        coefs[:, c, :6] = p.c[::-1, keep].T
    coefs[:, :, 8] = 5.0
    par = np.zeros(motion.PARAMETERS)
    par[motion.KIND], par[motion.BANK_G] = motion.TRACK, G_BANK
    return Trajectory(
        "track", float(u[-1]), float(columns[0][0]), float(columns[1][0]), float(columns[2][0]), earth, par,
        x[keep].copy(), coefs, np.empty((0, 4)), math.pi / float(np.min(np.diff(u))), float(t[0]),
    )  # fmt: skip


def _follow(u: Array, splines: list, earth: Ellipsoid) -> Array:
    """(n, 3) roll, pitch, heading of a coordinated vehicle on the track at its points."""
    lat, height = splines[0](u), splines[2](u)
    r_n, r_e = earth.radii(lat)
    v_n = (r_n + height) * splines[0](u, 1)
    v_e = (r_e + height) * np.cos(lat) * splines[1](u, 1)
    speed = np.hypot(v_n, v_e)
    heading = np.unwrap(np.arctan2(v_e, v_n))
    moving = speed > 0.05
    if moving.any() and not moving.all():  # at a stop the heading is held
        heading = np.interp(u, u[moving], np.unwrap(np.arctan2(v_e, v_n)[moving]))
    turn = np.gradient(heading, u)
    pitch = np.where(moving, np.arctan2(splines[2](u, 1), np.maximum(speed, 0.05)), 0.0)
    return np.column_stack([np.arctan(speed * turn / G_BANK), pitch, heading])


def compose(heading: float, roll: float, pitch: float, mount: ArrayLike) -> Array:
    """q_nb of an IMU mounted by q (body from instrument) in a body at roll, pitch, heading (rad)."""
    return quat_multiply(quat_from_euler(roll, pitch, heading), np.asarray(mount, dtype=np.float64))
