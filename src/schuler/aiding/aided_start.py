"""Where the aided filter begins: as typed, else still alignment, compass, course, or competing headings in motion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_engine import Engine, StartState, room
from schuler.aiding.aided_rows import MAG, Events
from schuler.aiding.aided_settings import AidedSettings, Layout
from schuler.ground.earth import WGS84, wrap_pi
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, euler_from_dcm, quat_from_dcm
from schuler.ground.tables import Table, Tables

Array = NDArray[np.float64]
COURSE_START = 3.0  # m/s: from here on a vehicle that follows its nose tells its heading
COURSE_STD = 0.15  # rad, the mounting's share of it
LEVEL_STD = 0.02  # rad: of a level read off a still base, beside the bias
MOVING_STD = 0.08  # rad: of a level read off in motion
STILL_HEADING = math.radians(10.0)  # gyros that find north to this do
BANK = 12  # competing headings
BANK_S = (8.0, 15.0, 30.0, 60.0, 120.0)
SURE = 0.2  # rad
BETTER = 18.0  # 2 log-likelihood by which the best heading must beat the others
D = math.pi / 180.0


def find_start(
    rows: Array, still: NDArray[np.bool_], events: Events, tables: Tables, s: AidedSettings, layout: Layout, *,
    live: bool = False,
) -> tuple[StartState, Engine]:  # fmt: skip
    """The start, and an engine that has begun there (in motion: the one that won, with all it has learnt).

    live: the tables end now and go on; what is not sure yet is worth waiting for.
    """
    interval = float(np.median(np.diff(rows[:, 0])))
    gnss = tables.get("gnss")
    engine = Engine(s, layout, interval)
    given = s.start
    place = _Places(gnss, s)
    if given.time is not None and not rows[0, 0] - 1.5 * interval <= given.time <= rows[-1, 0]:
        raise InputError(
            f"[start] time_s = {given.time:g} s lies outside the imu's time, {rows[0, 0]:.2f} to {rows[-1, 0]:.2f} s"
        )
    if given.heading is not None:
        start = _typed(rows, s, place)
        engine.begin(start)
        return start, engine
    stretch = _still_stretch(rows, tables, s, place)
    heading = _compass(rows, tables, s, stretch)
    if stretch is not None and stretch.rpy_std[2] < STILL_HEADING:
        start = _from_still(stretch, stretch.rpy[2], stretch.rpy_std[2], s, place)
    elif heading is not None:
        start = _at_compass(rows, s, place, stretch, *heading)
    elif _follows_its_nose(tables, s) and gnss is not None:
        found = _at_course(rows, s, place, stretch)
        if found is None:
            raise InputError(
                f"the heading cannot be found: the fixes never move faster than {COURSE_START:g} m/s, there is no "
                "compass, and these gyros cannot find north; type [start] heading_deg"
            )
        start = found
    elif gnss is not None:
        return _in_motion(rows, still, events, s, layout, place, stretch, interval)
    else:
        raise InputError(
            "no start was found: there is neither a fix nor [start] position and heading; type [start] lat_deg, "
            "lon_deg, heading_deg, or name a gnss table"
        )
    engine.begin(start)
    return start, engine


class _Places:
    """Position and velocity of the IMU at a time, from the last fix that is not later, and [start]."""

    def __init__(self, gnss: Table | None, s: AidedSettings) -> None:
        self.s = s
        self.time = np.zeros(0)
        if gnss is None:
            return
        good = np.isfinite(gnss["lat"]) & np.isfinite(gnss["lon"])
        g = gnss.where(good)
        self.gnss = g
        self.time = g.time - s.gnss_delay
        self.height = g["height"].astype(float) if "height" in g else np.zeros(len(g))
        self.height = np.where(np.isfinite(self.height), self.height, s.start.height or 0.0)
        self.v = self._velocities(g)

    def _velocities(self, g: Table) -> Array:
        """(n, 3) NED: as told, else from this fix and the one before."""
        n = len(g)
        v = np.full((n, 3), np.nan)
        if n > 1:
            d = WGS84.displacement_n(
                g["lat"][1:], g["lon"][1:], self.height[1:], g["lat"][:-1], g["lon"][:-1], self.height[:-1]
            )
            dt = np.diff(g.time)[:, None]
            v[1:] = np.where(dt < 5.0, d / dt, np.nan)
        self.told = np.zeros(n, dtype=bool)
        if "v_north" in g and "v_east" in g:
            self.told = np.isfinite(g["v_north"]) & np.isfinite(g["v_east"])
            down = g["v_down"].astype(float) if "v_down" in g else np.where(np.isfinite(v[:, 2]), v[:, 2], 0.0)
            down = np.where(np.isfinite(down), down, 0.0)
            v = np.where(self.told[:, None], np.column_stack([g["v_north"], g["v_east"], down]), v)
        elif "course" in g and "speed" in g:
            c, u = g["course"], g["speed"]
            good = np.isfinite(c) & np.isfinite(u)
            self.told = good
            v[good, 0], v[good, 1] = (u * np.cos(c))[good], (u * np.sin(c))[good]
            v[good, 2] = np.where(np.isfinite(v[good, 2]), v[good, 2], 0.0)
        return v

    def fix(self, time: float, *, or_next: bool = False) -> int | None:
        """The last fix not later than a time."""
        i = int(np.searchsorted(self.time, time + 1e-9)) - 1
        if i < 0:
            return 0 if or_next and len(self.time) else None
        return i

    def state(self, time: float, C_nb: Array, *, standing: bool = False) -> tuple[list[float], Array, Array, Array]:
        """lat, lon, height; v_n (3,); standard deviations of position (3,) and velocity (3,), all of the IMU."""
        s, start = self.s, self.s.start
        i = self.fix(time, or_next=True)
        place: list[float | None] = [start.lat, start.lon, start.height]
        v: list[float | None] = list(start.v_n)
        std = np.array([x if x is not None else math.nan for x in start.std_pos])
        vstd = np.array([x if x is not None else math.nan for x in start.std_vel])
        fixed_v = np.zeros(3)
        age = 0.0
        if i is not None:
            age = max(0.0, time - float(self.time[i]))
            if np.isfinite(self.v[i]).all():
                fixed_v = np.zeros(3) if standing else self.v[i]
            arm = np.asarray(C_nb) @ np.asarray(s.antenna)
            lat, lon, height = WGS84.displace(
                float(self.gnss["lat"][i]), float(self.gnss["lon"][i]), float(self.height[i]), -arm + fixed_v * age
            )
            for k, value in enumerate((lat, lon, height)):
                place[k] = float(value) if place[k] is None else place[k]
            sigma = np.array(
                [_told(self.gnss, f"std_{a}", i, d) for a, d in zip(("north", "east", "down"), s.gnss_std, strict=True)]
            )
            sigma = np.hypot(sigma, s.gnss_correlated_std * np.array([1.0, 1.0, 1.5]))
            sigma = np.hypot(sigma, 2.0 * age + (abs(s.gnss_delay_std) * float(np.linalg.norm(fixed_v))))
            std = np.where(np.isfinite(std), std, sigma)
            for k in range(3):
                v[k] = float(fixed_v[k]) if v[k] is None else v[k]
            vsig = (
                np.full(3, 0.3) if self.told[i] or standing else np.full(3, 1.0 + 0.2 * float(np.linalg.norm(fixed_v)))
            )
            vstd = np.where(np.isfinite(vstd), vstd, vsig + 2.0 * age)
        if place[0] is None or place[1] is None:
            raise InputError(
                "the position at the start is not known: type [start] lat_deg, lon_deg and height_m, or name a gnss "
                "table"
            )
        typed_v = any(x is not None for x in start.v_n)
        std = np.where(np.isfinite(std), std, np.array([1.0, 1.0, 2.0]))
        vstd = np.where(np.isfinite(vstd), vstd, 0.1 if typed_v or standing else 1.0)
        out = [float(place[0]), float(place[1]), float(place[2] or 0.0)]
        return out, np.array([x or 0.0 for x in v], dtype=float), std, vstd


def _told(table: Table, column: str, row: int, default: float) -> float:
    value = float(table[column][row]) if column in table else math.nan
    return value if math.isfinite(value) and value > 0.0 else default


class _Stretch:
    """A still stretch: its end, attitude there (heading may be unknown), sigmas, gyro bias at rest."""

    def __init__(self, start: float, to: float, rpy: Array, cov: Array, bias: Array | None, std: Array) -> None:
        self.start, self.to, self.rpy, self.cov, self.bias, self.bias_std = start, to, rpy, cov, bias, std
        self.rpy_std = np.sqrt(np.diag(cov))


def _still_stretch(rows: Array, tables: Tables, s: AidedSettings, place: _Places) -> _Stretch | None:
    """The first still stretch, if the recording begins with one (or [start] time says where to look)."""
    from schuler.inertial.alignment import SensorErrors
    from schuler.inertial.alignment_filter import align

    sensor = SensorErrors.of(
        accel_bias=s.accel_bias_std, gyro_bias=np.hypot(s.gyro_bias_std, s.gyro_instability), vrw=s.accel_vrw,
        arw=s.gyro_arw,
    )  # fmt: skip
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
    # fixes that move say that this quiet was a smooth road
    inside = (place.time >= found.start) & (place.time <= found.to)
    if inside.any() and np.isfinite(place.v[inside, 0]).any():
        speed = np.hypot(place.v[inside, 0], place.v[inside, 1])
        if float(np.nanmedian(speed)) > 0.7:
            return None
    last = float(rows[-1, 0])
    if s.start.time is None and found.to > last - 1.0:
        # Still to its end: align on its first half, at most five minutes, and navigate the rest.
        found = align(
            tables["imu"], sensor, lat=lat, start=found.start, to=found.start + min(0.5 * (last - found.start), 300.0)
        )
    bias, std = None, np.full(3, math.inf)
    if found.gyro_bias is not None:
        bias = np.asarray(found.gyro_bias, dtype=float)
        earth = WGS84.omega if found.accel_bias is None else 0.0  # levelled only: the Earth's rate is still in it
        std = np.asarray(s.gyro_arw) / math.sqrt(max(found.to - found.start, 1.0)) + earth
        std = np.hypot(std, s.gyro_walk * math.sqrt(max(found.to - found.start, 1.0)))
    return _Stretch(found.start, found.to, found.rpy, found.cov, bias, std)


def _follows_its_nose(tables: Tables, s: AidedSettings) -> bool:
    return "nhc" in s.constraints or ("speed" in tables and s.speed_is == "ground")


def _mean_force(rows: Array, time: float, span: float) -> Array:
    inside = (rows[:, 0] > time - span) & (rows[:, 0] <= time + 1e-9)
    if inside.sum() < 3:
        inside = np.zeros(len(rows), dtype=bool)
        inside[max(0, int(np.searchsorted(rows[:, 0], time)) - 3) :][:3] = True
    return rows[inside, 4:7].mean(axis=0)


def _attitude_of(force: Array, accel_n: Array, heading: float) -> Array:
    """C_nb that turns a mean specific force (3,) b into accel - g (3,) n, with a heading."""
    up = np.array([0.0, 0.0, -9.80665])
    want = accel_n + up
    roll, pitch = math.atan2(-force[1], -force[2]), math.atan2(force[0], math.hypot(force[1], force[2]))
    C = np.asarray(dcm_from_euler(roll, pitch, heading))
    a, b = C @ force / np.linalg.norm(force), want / np.linalg.norm(want)
    axis = np.cross(a, b)
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    R = np.eye(3) + skew + skew @ skew / (1.0 + float(a @ b))
    return R @ C


def _state(
    time: float, C: Array, place: _Places, std_phi: Array, bias: Array | None, bias_std: Array | None, *,
    standing: bool = False, from_force: bool = True, notes: list[str] | None = None, cov_phi: Array | None = None,
) -> StartState:  # fmt: skip
    (lat, lon, height), v, std, vstd = place.state(time, C, standing=standing)
    cov = np.zeros((9, 9))
    cov[:3, :3] = np.diag(std_phi**2) if cov_phi is None else cov_phi
    cov[np.arange(3, 6), np.arange(3, 6)] = vstd**2
    cov[np.arange(6, 9), np.arange(6, 9)] = std**2
    q = np.asarray(quat_from_dcm(C), dtype=float)
    return StartState(time, q, v, lat, lon, height, cov, bias, bias_std, from_force, notes or [])


def _typed(rows: Array, s: AidedSettings, place: _Places) -> StartState:
    g = s.start
    interval = float(np.median(np.diff(rows[:, 0])))
    time = g.time
    if time is None:
        time = float(rows[0, 0]) - interval
        if g.lat is None and len(place.time):
            time = max(time, float(place.time[0]))
    assert g.heading is not None
    accel = np.zeros(3)
    C = _attitude_of(_mean_force(rows, max(time, float(rows[0, 0]) + 0.2), 0.5), accel, g.heading)
    roll, pitch, _ = (float(a) for a in euler_from_dcm(C))
    typed_level = g.roll is not None and g.pitch is not None
    C = np.asarray(
        dcm_from_euler(g.roll if g.roll is not None else roll, g.pitch if g.pitch is not None else pitch, g.heading)
    )
    levels = [
        x if x is not None else (math.radians(0.5) if typed_level else MOVING_STD) for x in (g.std_roll, g.std_pitch)
    ]
    std = np.array([max(levels), max(levels), g.std_heading if g.std_heading is not None else math.radians(2.0)])
    notes = []
    if not typed_level:
        notes.append("[start] gives no roll or pitch: levelled with the accelerometers")
    return _state(float(time), C, place, std, None, None, from_force=not typed_level, notes=notes)


def _from_still(stretch: _Stretch, heading: float, std: float, s: AidedSettings, place: _Places) -> StartState:
    """On a base that stood and found north itself."""
    C = np.asarray(dcm_from_euler(stretch.rpy[0], stretch.rpy[1], heading))
    std_phi = np.array([LEVEL_STD * 0.0 + max(stretch.rpy_std[:2])] * 2 + [std])
    note = (
        f"aligned from {stretch.start:.1f} to {stretch.to:.1f} s: roll {math.degrees(stretch.rpy[0]):.2f}, pitch "
        f"{math.degrees(stretch.rpy[1]):.2f}, heading {math.degrees(heading) % 360.0:.2f} deg (1 sigma "
        f"{math.degrees(std):.2f} deg)"
    )
    return _state(
        stretch.to, C, place, std_phi, stretch.bias, stretch.bias_std, standing=True, from_force=False, notes=[note]
    )


def _compass(
    rows: Array, tables: Tables, s: AidedSettings, stretch: _Stretch | None
) -> tuple[float, float, float, Array | None] | None:
    """(time, heading, sigma, roll and pitch or None) of the vehicle's own compass, at the first moment that has one."""
    from_t = stretch.to if stretch is not None else float(rows[0, 0])
    if s.start.time is not None:
        from_t = s.start.time
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
            C = _attitude_of(_mean_force(rows, float(imu.time[i]), 0.5), np.zeros(3), 0.0)
            b_n = C @ b[max(0, i - 5) : i + 1][good[max(0, i - 5) : i + 1]].mean(axis=0)
            north = float(wrap_pi(s.declination - math.atan2(b_n[1], b_n[0])))
            # a level in error by a degree turns the field's azimuth by the tangent of its dip
            dip = abs(b_n[2]) / max(math.hypot(b_n[0], b_n[1]), 1e-12)
            std = math.hypot(math.hypot(s.mag_std, s.heading_offset_std), MOVING_STD * min(dip, 5.0))
            if std < 0.6:
                return float(imu.time[i]), north, std, None
    return None


def _at_compass(
    rows: Array, s: AidedSettings, place: _Places, stretch: _Stretch | None, time: float, heading: float, std: float,
    level: Array | None,
) -> StartState:  # fmt: skip
    if s.start.lat is None and len(place.time):
        time = max(time, float(place.time[0]))
    standing = stretch is not None and abs(time - stretch.to) < 2.0
    if level is None:
        if standing and stretch is not None:
            C = np.asarray(dcm_from_euler(stretch.rpy[0], stretch.rpy[1], heading))
        else:
            C = _attitude_of(_mean_force(rows, time, 0.5), _acceleration(place, time), heading)
        sd = LEVEL_STD if standing else MOVING_STD
    else:
        C, sd = np.asarray(dcm_from_euler(level[0], level[1], heading)), max(s.attitude_std[:2])
    bias, bias_std = (stretch.bias, stretch.bias_std) if stretch is not None else (None, None)
    note = f"heading at the start, {math.degrees(heading) % 360.0:.1f} deg, from the compass at {time:.2f} s"
    return _state(
        time, C, place, np.array([sd, sd, std]), bias, bias_std, standing=standing, from_force=level is None,
        notes=[note],
    )  # fmt: skip


def _acceleration(place: _Places, time: float) -> Array:
    """NED m/s^2 over the second before a time, from the fixes' velocities; 0 where they do not tell."""
    i = place.fix(time)
    if i is None or i < 1:
        return np.zeros(3)
    j = int(np.searchsorted(place.time, place.time[i] - 1.05))
    j = min(j, i - 1)
    dt = place.time[i] - place.time[j]
    d = place.v[i] - place.v[j]
    if not np.isfinite(d).all() or not 0.0 < dt < 3.0 or not (place.told[i] and place.told[j]):
        return np.zeros(3)
    return d / dt


def _at_course(rows: Array, s: AidedSettings, place: _Places, stretch: _Stretch | None) -> StartState | None:
    """A vehicle that follows its nose, when it first moves: level carried from the still stretch by the gyros."""
    first = max(float(rows[0, 0]) + 0.5, s.start.time if s.start.time is not None else -math.inf)
    if stretch is not None:
        first = max(first, stretch.to)
    speed = np.hypot(place.v[:, 0], place.v[:, 1])
    if not len(speed) or not np.isfinite(speed).any():
        return None
    wanted = COURSE_START
    if float(np.nanmax(speed)) < COURSE_START:
        wanted = 0.7 * float(np.nanmax(speed))
        if wanted < 0.7:
            return None
    with np.errstate(invalid="ignore"):
        ready = np.flatnonzero((place.time >= first) & (speed >= wanted) & (place.time <= rows[-1, 0]))
    # two fixes in a row that agree, so that one jump does not start the filter
    for i in ready:
        if i == 0:
            continue
        dt = place.time[i] - place.time[i - 1]
        change = place.v[i, :2] - place.v[i - 1, :2]
        if np.isfinite(change).all() and np.hypot(*change) < 1.0 + 4.0 * dt:
            break
    else:
        return None
    time = float(place.time[i])
    course = math.atan2(place.v[i, 1], place.v[i, 0])
    std = math.hypot(COURSE_STD, 0.3 / float(speed[i]))
    bias, bias_std, sd = None, None, MOVING_STD
    C = _attitude_of(_mean_force(rows, time, 1.0), _acceleration(place, time), course)
    from_force = True
    if stretch is not None:
        bias, bias_std = stretch.bias, stretch.bias_std
        between = (rows[:, 0] > stretch.to) & (rows[:, 0] <= time)
        waited = time - stretch.to
        if waited < 60.0 and between.any():
            from schuler.inertial.alignment import carried

            C0 = np.asarray(dcm_from_euler(stretch.rpy[0], stretch.rpy[1], 0.0))
            dt = np.diff(rows[:, 0], prepend=rows[0, 0] - 1e-3)[between]
            w = rows[between, 1:4] - (bias if bias is not None else 0.0)
            lat = float(place.gnss["lat"][i])
            C1 = np.asarray(carried(C0, w * dt[:, None], lat, float(dt.sum())))
            roll, pitch, _ = (float(a) for a in euler_from_dcm(C1))
            C = np.asarray(dcm_from_euler(roll, pitch, course))
            sd = LEVEL_STD + 2e-3 * math.sqrt(waited)
            from_force = True
    # The level's own heading axis: pitch and roll errors stand in n
    note = f"navigation begins at {time:.2f} s, heading {math.degrees(course) % 360.0:.1f} deg from the course"
    return _state(time, C, place, np.array([sd, sd, std]), bias, bias_std, from_force=from_force, notes=[note])


def _in_motion(
    rows: Array, still: NDArray[np.bool_], events: Events, s: AidedSettings, layout: Layout, place: _Places,
    stretch: _Stretch | None, interval: float,
) -> tuple[StartState, Engine]:  # fmt: skip
    """Filters with headings all round run side by side until the fixes leave one of them: alignment in motion.

    The winner is the start: nothing is told of the track before it was sure.
    """
    first = max(float(rows[0, 0]) + 0.3, float(place.time[0]) if len(place.time) else -math.inf)
    if s.start.time is not None:
        first = max(first, s.start.time)
    speed = np.linalg.norm(place.v, axis=1)
    if stretch is not None:
        with np.errstate(invalid="ignore"):
            moving = np.flatnonzero((place.time > stretch.to) & (speed > 0.7))
        first = max(first, float(place.time[moving[0]]) - 1.0 if len(moving) else stretch.to)
    if len(place.time):
        after = np.flatnonzero(place.time >= first - 1e-9)
        first = float(place.time[after[0]]) if len(after) else first
    force = _mean_force(rows, first, 1.0)
    accel = _acceleration(place, first)
    quiet = replace(s, gate=False)
    spread = 2.0 * math.pi / BANK
    bias, bias_std = (stretch.bias, stretch.bias_std) if stretch is not None else (None, None)
    bank: list[Engine] = []
    for i in range(BANK):
        C = _attitude_of(force, accel, i * spread)
        sd = MOVING_STD
        start = _state(first, C, place, np.array([sd, sd, 0.6 * spread]), bias, bias_std)
        engine = Engine(quiet, layout, interval)
        engine.begin(start)
        bank.append(engine)
    begun = int(np.searchsorted(rows[:, 0], first + 1e-9))
    part_rows, part_still, part_events = rows[begun:], still[begun:], events.since(first)
    from schuler.kernels.aided_run import USER

    known = part_events.kind < USER  # the caller's own sensors wait
    part_events = type(part_events)(part_events.time[known], part_events.kind[known], part_events.z[known])
    for engine in bank:
        engine.kept = room(layout.n, events=len(part_events), inner=1)
    until = first
    for window in BANK_S:
        until = min(first + window, float(part_rows[-1, 0]))
        upto = int(np.searchsorted(part_rows[:, 0], until + 1e-9))
        costs, headings, sigmas = [], [], []
        for engine in bank:
            engine.run(part_rows[:upto], part_still[:upto], part_events, 1.0)
            cost, heading, sigma = _cost(engine)
            costs.append(cost)
            headings.append(heading)
            sigmas.append(sigma)
        cost_, heading_ = np.array(costs), np.array(headings)
        best = int(np.nanargmin(np.where(np.isfinite(cost_), cost_, np.inf)))
        others = np.abs(wrap_pi(heading_ - heading_[best])) > max(0.35, 3.0 * sigmas[best])
        lead = float(np.nanmin(np.where(others & np.isfinite(cost_), cost_, np.inf))) - cost_[best]
        if sigmas[best] < SURE and lead > BETTER:
            break
        if until >= part_rows[-1, 0]:
            break
    winner = bank[best]
    if sigmas[best] > 1.0 or not np.isfinite(cost_[best]):
        raise InputError(
            f"the heading could not be found from the motion within {until - first:.0f} s (1 sigma "
            f"{math.degrees(sigmas[best]):.0f} deg): it takes accelerations that the fixes see; type [start] "
            "heading_deg, "
            'or constraints = ["nhc"] for a vehicle that follows its nose'
        )
    from schuler.kernels import aided_state as k

    engine = winner.clone()
    engine.settings = s
    engine.c[k.GATE] = float(s.gate)
    engine.x[k.NEXT] = engine.x[k.T]
    engine.x[k.BADH] = engine.x[k.BADV] = engine.x[k.BADS] = -1e300
    engine.x[k.HARD : k.HARD + 20] = 0.0
    engine.c[k.T0] = engine.x[k.T]
    engine.S[:, :] = np.eye(layout.n)
    engine.x[k.TNODE] = engine.x[k.T] - engine.c[k.NODE_DT]
    note = (
        f"heading found in motion: {BANK} headings compared from {first:.1f} to {until:.1f} s, "
        f"{math.degrees(headings[best]) % 360.0:.1f} deg (1 sigma {math.degrees(sigmas[best]):.1f} deg) at the end; "
        "navigation begins there"
    )
    if lead < BETTER:
        note += "; another heading fits nearly as well: type [start] heading_deg if it is known"
    x = engine.x
    found = StartState(
        float(x[k.T]), x[k.QUAT : k.QUAT + 4].copy(), x[k.VEL : k.VEL + 3].copy(), float(x[k.LAT]), float(x[k.LON]),
        float(x[k.HGT]), engine.P[:9, :9].copy(), notes=[note],
    )  # fmt: skip
    return found, engine


def _cost(engine: Engine) -> tuple[float, float, float]:
    """-2 log-likelihood of what a filter measured so far; its heading and sigma."""
    from schuler.kernels import aided_state as k
    from schuler.kernels.rotation import euler_from_quat

    done = int(engine.kept.counts[1])
    rows = engine.kept.innov[:done].reshape(-1, engine.kept.innov.shape[2])
    told = np.isfinite(rows[:, 6])
    rows = rows[told]
    std = rows[:, 3:6]
    cost = float(rows[:, 6].sum() + 2.0 * np.log(std[np.isfinite(std) & (std > 0)]).sum())
    q = engine.x[k.QUAT : k.QUAT + 4]
    heading = euler_from_quat(q[0], q[1], q[2], q[3])[2]
    return cost, float(heading), math.sqrt(max(float(engine.P[2, 2]), 0.0))
