"""Where the aided filter begins: as typed, else still alignment, compass, course, or competing headings in motion.

A start at a time has seen nothing that is stamped later. Its covariance is meant to be true: tests/statistics draws it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_bank import BLIND_STD, MOVING_STD, in_motion
from schuler.aiding.aided_engine import Engine, StartState
from schuler.aiding.aided_places import Places, attitude_of, mean_force, turned
from schuler.aiding.aided_rows import MAG, Events
from schuler.aiding.aided_settings import AidedSettings, Layout
from schuler.ground.earth import WGS84, wrap_pi
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, euler_from_dcm
from schuler.ground.tables import Tables

Array = NDArray[np.float64]
COURSE_START = 3.0  # m/s: from here on a vehicle that follows its nose tells its heading
COURSE_STD = 0.15  # rad, the mounting's share of it
COURSE_MOST = (0.18, 0.35)  # rad: a course that its fixes leave less sure is waited with; the second if none is better
LEVEL_STD = 0.02  # rad: of a level read off a still base, beside the bias
STILL_HEADING = math.radians(10.0)  # gyros that find north to this do
CARRY_S = 60.0  # so long a level is carried by the gyros


def find_start(
    rows: Array, still: NDArray[np.bool_], events: Events, tables: Tables, s: AidedSettings, layout: Layout, *,
    live: bool = False,
) -> tuple[StartState, Engine]:  # fmt: skip
    """The start, and an engine that has begun there (in motion: the one that won, with all it has learnt).

    live: the tables end now and go on; what is not sure yet is worth waiting for.
    """
    interval = float(np.median(np.diff(rows[:, 0])))
    engine = Engine(s, layout, interval)
    given = s.start
    place = Places(tables, s)
    _check(rows, s, place, interval)
    if given.heading is not None:
        start = _typed(rows, s, place)
        engine.begin(start)
        return start, engine
    stretch = _still_stretch(rows, tables, s, place, live=live)
    if stretch is not None and stretch.rpy_std[2] < STILL_HEADING:
        start = _from_still(rows, stretch, s, place)
    else:
        heading = _compass(rows, tables, s, stretch, place)
        if heading is not None:
            start = _at_compass(rows, s, place, stretch, heading)
        elif not len(place.time):
            raise InputError(
                "no start was found: there is neither a fix nor [start] position and heading; type [start] lat_deg, "
                "lon_deg, heading_deg, or name a gnss table"
            )
        elif _follows_its_nose(tables, s):
            start = _at_course(rows, s, place, stretch)
        else:
            return in_motion(rows, still, events, s, layout, place, stretch, interval, live=live)
    engine.begin(start)
    return start, engine


def _check(rows: Array, s: AidedSettings, place: Places, interval: float) -> None:
    given, first, last = s.start, float(rows[0, 0]), float(rows[-1, 0])
    if given.time is not None and not first - 1.5 * interval <= given.time <= last:
        raise InputError(f"[start] time_s = {given.time:g} s lies outside the imu's time, {first:.2f} to {last:.2f} s")
    placed = given.lat is not None and given.lon is not None
    gnss = place.tables.get("gnss")
    if placed or gnss is None:
        return
    if not len(place.time):
        raise InputError(
            "no row of the gnss table holds a position: nothing says where to begin; type [start] lat_deg, lon_deg"
        )
    if place.time[0] > last or place.time[-1] < first - 60.0:
        raise InputError(
            f"the fixes run from {place.time[0]:.1f} to {place.time[-1]:.1f} s and the imu from {first:.1f} to "
            f"{last:.1f} s: no fix says where to begin; put both on one clock, or type [start] lat_deg, lon_deg"
        )


class Stretch:
    """A still stretch: its end, attitude there (heading may be unknown), sigmas, gyro bias at rest."""

    def __init__(
        self, start: float, to: float, rpy: Array, cov: Array, bias: Array | None, std: Array, walk: float
    ) -> None:
        self.start, self.to, self.rpy, self.cov, self.bias, self.bias_std = start, to, rpy, cov, bias, std
        self.rpy_std = np.sqrt(np.diag(cov))
        self.walk = walk

    def level_std(self, time: float) -> float:
        """Of a level carried from here to a time, rad, beside what the accelerometers' bias adds."""
        waited = max(time - self.to, 0.0)
        drift = float(np.max(self.bias_std)) if np.isfinite(self.bias_std).all() else 0.0
        return LEVEL_STD + self.walk * math.sqrt(waited) + min(drift, 0.02) * waited


def _still_stretch(rows: Array, tables: Tables, s: AidedSettings, place: Places, *, live: bool) -> Stretch | None:
    """The first still stretch, if the recording begins with one (or [start] time says where to look)."""
    from schuler.inertial.alignment import SensorErrors
    from schuler.inertial.alignment_filter import align

    prior = np.hypot(s.gyro_bias_std, s.gyro_instability)
    sensor = SensorErrors.of(accel_bias=s.accel_bias_std, gyro_bias=prior, vrw=s.accel_vrw, arw=s.gyro_arw)
    lat = s.start.lat
    if lat is None and len(place.time):
        lat = float(place.gnss["lat"][0])
    try:
        found = align(tables["imu"], sensor, lat=lat)
    except InputError:
        return None
    if s.start.time is not None and found.to > s.start.time + 1e-6:
        try:
            found = align(tables["imu"], sensor, lat=lat, start=found.start, to=s.start.time)
        except InputError:
            return None
    if found.start > rows[0, 0] + 60.0 or found.to - found.start < 2.0:
        return None
    if found.to < rows[-1, 0] - 1.0 and found.to - found.start > 6.0 and s.start.time is None:
        # it ended because the vehicle moved off, which is felt a little later than it began
        early = found.to - min(2.0, 0.2 * (found.to - found.start))
        found = align(tables["imu"], sensor, lat=lat, start=found.start, to=early)
    # fixes that move say that this quiet was a smooth road
    inside = (place.time >= found.start) & (place.time <= found.to)
    if inside.any() and np.isfinite(place.v[inside, 0]).any():
        speed = np.hypot(place.v[inside, 0], place.v[inside, 1])
        if float(np.nanmedian(speed)) > _moving(place, inside):
            return None
    last = float(rows[-1, 0])
    if s.start.time is None and found.to > last - 1.0 and not live:
        # Still to its end: align on its first half, at most five minutes, and navigate the rest.
        found = align(
            tables["imu"], sensor, lat=lat, start=found.start, to=found.start + min(0.5 * (last - found.start), 300.0)
        )
    bias, std = None, np.full(3, math.inf)
    if found.gyro_bias is not None:
        bias = np.asarray(found.gyro_bias, dtype=float)
        span = max(found.to - found.start, 1.0)
        if found.accel_bias is None:  # levelled only: the Earth's rate is still in it
            std = np.asarray(s.gyro_arw) / math.sqrt(span) + WGS84.omega
            std = np.hypot(std, s.gyro_walk * math.sqrt(span))
        else:  # north was found with it: its part about east is the heading's own error
            std = prior
    return Stretch(found.start, found.to, found.rpy, found.cov, bias, std, max(2e-3, float(np.max(s.gyro_arw))))


def _moving(place: Places, inside: NDArray[np.bool_]) -> float:
    """m/s over which a median speed of fixes is motion: velocities from two fixes have their noise."""
    if place.told[inside].any():
        return 0.7
    i = np.flatnonzero(inside)[-1]
    step = place.step[i] if np.isfinite(place.step[i]) else 1.0
    return max(0.7, 3.0 * float(np.max(place._noise(int(i))[:2])) / float(step))


def _follows_its_nose(tables: Tables, s: AidedSettings) -> bool:
    return "nhc" in s.constraints or ("speed" in tables and s.speed_is == "ground")


def _typed(rows: Array, s: AidedSettings, place: Places) -> StartState:
    g = s.start
    interval = float(np.median(np.diff(rows[:, 0])))
    typed_at = float(rows[0, 0]) - interval if g.time is None else g.time
    assert g.heading is not None
    time = place.first_reading(place.ready(typed_at))
    C = attitude_of(mean_force(rows, max(typed_at, float(rows[0, 0]) + 0.2), 0.5), np.zeros(3), g.heading)
    roll, pitch, _ = (float(a) for a in euler_from_dcm(C))
    typed_level = g.roll is not None and g.pitch is not None
    roll, pitch = g.roll if g.roll is not None else roll, g.pitch if g.pitch is not None else pitch
    C = np.asarray(dcm_from_euler(roll, pitch, g.heading))
    levels = [
        x if x is not None else (math.radians(0.5) if typed_level else MOVING_STD) for x in (g.std_roll, g.std_pitch)
    ]
    heading = g.std_heading if g.std_heading is not None else math.radians(2.0)
    notes = []
    moved = time > typed_at + 1.5 * interval
    if moved:
        C = turned(rows, C, typed_at, time, None, g.lat or 0.0)
        drift = float(np.max(s.gyro_bias_std)) * (time - typed_at)
        levels, heading = [math.hypot(x, drift) for x in levels], math.hypot(heading, drift)
        notes.append(
            f"the place is known from {time:.2f} s on: the gyros carried the attitude of [start] there from "
            f"{typed_at:.2f} s"
        )
    if not typed_level:
        notes.append("[start] gives no roll or pitch: levelled with the accelerometers")
    cov = np.diag([max(levels) ** 2, max(levels) ** 2, heading**2])
    return place.state_at(time, C, cov, moved=moved, from_force=not typed_level, notes=notes)


def _from_still(rows: Array, stretch: Stretch, s: AidedSettings, place: Places) -> StartState:
    """On a base that stood and found north itself."""
    time = place.ready(stretch.to)
    C = np.asarray(dcm_from_euler(stretch.rpy[0], stretch.rpy[1], stretch.rpy[2]))
    # the accelerometers' bias comes on top, with what ties the level to it; misalignments count where they are told
    unknown = AidedSettings().accel_misalignment_std
    skew = s.accel_misalignment_std if s.accel_misalignment_std < unknown else 0.0
    span = max(stretch.to - stretch.start, 1.0)
    level = math.hypot(skew, float(np.max(s.accel_vrw)) / (9.8 * math.sqrt(span)) + s.accel_instability / 9.8)
    std = float(stretch.rpy_std[2])
    notes = [
        f"aligned from {stretch.start:.1f} to {stretch.to:.1f} s: roll {math.degrees(stretch.rpy[0]):.2f}, pitch "
        f"{math.degrees(stretch.rpy[1]):.2f}, heading {math.degrees(stretch.rpy[2]) % 360.0:.2f} deg (1 sigma "
        f"{math.degrees(std):.2f} deg)"
    ]
    standing = True
    if time > stretch.to:
        lat = s.start.lat if s.start.lat is not None else float(place.gnss["lat"][0])
        C = turned(rows, C, stretch.to, time, stretch.bias, lat)
        level += float(np.max(s.gyro_arw)) * math.sqrt(time - stretch.to)
        standing = False
        notes.append(f"the first fix comes at {time:.2f} s: the gyros carried the attitude there")
    cov = np.diag([level**2, level**2, std**2])
    return place.state_at(
        time, C, cov, standing=standing, bias=stretch.bias, bias_std=stretch.bias_std, from_force=True, notes=notes
    )


Compass = tuple[float, float, float, Array | None]


def _compass(rows: Array, tables: Tables, s: AidedSettings, stretch: Stretch | None, place: Places) -> Compass | None:
    """(time, heading, sigma, roll and pitch or None) of the vehicle's own compass, at the first moment that has one."""
    from_t = stretch.to if stretch is not None else float(rows[0, 0])
    if s.start.time is not None:
        from_t = s.start.time
    from_t = place.first_reading(place.ready(from_t))
    if "attitude" in tables:
        a = tables["attitude"]
        heading = a["heading"] if "heading" in a else a["heading_mag"] + s.declination
        good = np.isfinite(heading) & np.isfinite(a["roll"]) & np.isfinite(a["pitch"]) & (a.time <= rows[-1, 0])
        later = np.flatnonzero(good & (a.time >= from_t))
        if len(later):
            i = int(later[0])
            std = math.hypot(s.attitude_std[2], s.heading_offset_std)
            return float(a.time[i]), float(heading[i]), std, np.array([a["roll"][i], a["pitch"][i]])
    imu = tables["imu"]
    if all(c in imu for c in MAG):
        b = imu.stack(*MAG)
        good = np.isfinite(b).all(axis=1) & (np.linalg.norm(b, axis=1) > 0)
        at = np.flatnonzero(good & (imu.time >= from_t + 0.3))
        if len(at):
            i = int(at[0])
            time = float(imu.time[i])
            C, sd = _level(rows, time, stretch, place)
            near = good[max(0, i - 5) : i + 1]
            b_n = C @ b[max(0, i - 5) : i + 1][near].mean(axis=0)
            north = float(wrap_pi(s.declination - math.atan2(b_n[1], b_n[0])))
            # a level in error by a degree turns the field's azimuth by the tangent of its dip
            dip = abs(b_n[2]) / max(math.hypot(b_n[0], b_n[1]), 1e-12)
            hard = s.mag_bias_std / max(math.hypot(b_n[0], b_n[1]), 1e-12) if "mag_bias" in (s.estimate or ()) else 0.0
            std = math.hypot(math.hypot(s.mag_std, s.heading_offset_std), math.hypot(sd * min(dip, 5.0), hard))
            if std < 0.6:
                return time, north, std, None
    return None


def _level(rows: Array, time: float, stretch: Stretch | None, place: Places) -> tuple[Array, float]:
    """C_nb with a heading of 0 and the sigma of its level: carried from where it stood, or from force and fixes."""
    if stretch is not None and time - stretch.to < CARRY_S:
        i = place.fix(time)
        lat = place.s.start.lat if i is None else float(place.gnss["lat"][i])
        C = np.asarray(dcm_from_euler(stretch.rpy[0], stretch.rpy[1], 0.0))
        C = turned(rows, C, stretch.to, time, stretch.bias, lat or 0.0)
        roll, pitch, _ = (float(a) for a in euler_from_dcm(C))
        return np.asarray(dcm_from_euler(roll, pitch, 0.0)), stretch.level_std(time)
    accel = place.acceleration(time)
    known = accel is not None or not len(place.time)  # what has no fixes swims slowly
    C = attitude_of(mean_force(rows, time, 1.0), np.zeros(3) if accel is None else accel, 0.0)
    return C, MOVING_STD if known else 0.5 * (MOVING_STD + BLIND_STD)


def _at_compass(rows: Array, s: AidedSettings, place: Places, stretch: Stretch | None, found: Compass) -> StartState:
    time, heading, std, level = found
    if level is None:
        C, sd = _level(rows, time, stretch, place)
        roll, pitch, turn = (float(a) for a in euler_from_dcm(C))
        accel = place.acceleration(time)
        if accel is not None and not (stretch is not None and time - stretch.to < CARRY_S):
            # the acceleration is told in n: the level of this heading
            C = attitude_of(mean_force(rows, time, 1.0), accel, heading)
        else:
            C = np.asarray(dcm_from_euler(roll, pitch, heading))
    else:
        C, sd = np.asarray(dcm_from_euler(float(level[0]), float(level[1]), heading)), max(s.attitude_std[:2])
    bias, bias_std = (stretch.bias, stretch.bias_std) if stretch is not None else (None, None)
    note = f"heading at the start, {math.degrees(heading) % 360.0:.1f} deg, from the compass at {time:.2f} s"
    return place.state_at(
        time, C, np.diag([sd**2, sd**2, std**2]), standing=stretch is not None and time <= stretch.to, bias=bias,
        bias_std=bias_std, from_force=level is None, notes=[note],
    )  # fmt: skip


def _at_course(rows: Array, s: AidedSettings, place: Places, stretch: Stretch | None) -> StartState:
    """A vehicle that follows its nose, when it first moves: level carried from the still stretch by the gyros."""
    first = max(float(rows[0, 0]) + 0.5, s.start.time if s.start.time is not None else -math.inf)
    if stretch is not None:
        first = max(first, stretch.to)
    speed = np.hypot(place.v[:, 0], place.v[:, 1])
    fastest = float(np.nanmax(speed, initial=0.0))
    wanted = COURSE_START if fastest >= COURSE_START else 0.7 * fastest
    with np.errstate(invalid="ignore"):
        ready = np.flatnonzero((place.time >= first) & (speed >= max(wanted, 0.7)) & (place.time <= rows[-1, 0]))
    for most, i in ((most, i) for most in COURSE_MOST for i in ready.tolist() if i > 0):
        if place.course(i)[1] > most:
            continue
        # two fixes in a row that agree, so that one jump does not start the filter
        dt = place.time[i] - place.time[i - 1]
        change = place.v[i, :2] - place.v[i - 1, :2]
        if np.isfinite(change).all() and np.hypot(*change) < 1.0 + 4.0 * dt:
            break
    else:
        raise InputError(
            f"the heading cannot be found: the fixes never move faster than {max(fastest, 0.0):.1f} m/s long enough to "
            "tell a course, there is no compass, and these gyros cannot find north; type [start] heading_deg"
        )
    time = float(place.time[i])
    course, _ = place.course(i)
    C, sd = _level(rows, time, stretch, place)
    std = COURSE_STD
    if not place.told[i]:
        # the way between two fixes tells the course half an interval ago: the gyros turn it on
        was = turned(rows, C, time - float(place.step[i]), time, None if stretch is None else stretch.bias, 0.0)
        turn = float(wrap_pi(euler_from_dcm(was)[2] - euler_from_dcm(C)[2]))
        course += 0.5 * turn
        std = math.hypot(std, 0.25 * abs(turn) + 0.01 * float(place.step[i]))
    accel = place.acceleration(time)
    if accel is not None and not (stretch is not None and time - stretch.to < CARRY_S):
        C = attitude_of(mean_force(rows, time, 1.0), accel, course)
    else:
        roll, pitch, _ = (float(a) for a in euler_from_dcm(C))
        C = np.asarray(dcm_from_euler(roll, pitch, course))
    bias, bias_std = (stretch.bias, stretch.bias_std) if stretch is not None else (None, None)
    note = f"navigation begins at {time:.2f} s, heading {math.degrees(course) % 360.0:.1f} deg from the course"
    return place.state_at(
        time, C, np.diag([sd**2, sd**2, std**2]), from_course=True, bias=bias, bias_std=bias_std, notes=[note]
    )
