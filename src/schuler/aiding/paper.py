"""The AHRS/GPS/DR paper's filter, corrected and as printed: methods "paper" and "paper-literal" of kind "auv".

Six states, roll, pitch, heading and three gyro biases; gravity levelling; the receiver's course as heading; dead
reckoning on an axial speed log while there is no fix. Source, by equation number: Alizadeh, Nourmohammadi, Sabet and
Zarrini (2017), "Design and implementation of AHRS/GPS/DR navigation algorithm applied to long-range AUVs". The loop is
`schuler.kernels.paper`; the functions here are the same equations for one epoch, to read, test and teach.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.aiding.solution import Innovations, Navigation, Solution, StateHistory
from schuler.ground.earth import wrap_pi
from schuler.ground.errors import InputError, SchulerError
from schuler.ground.tables import Table, Tables

if TYPE_CHECKING:
    from schuler.kernels.paper import Tuning

Array = NDArray[np.float64]
Policy = Literal["paper", "drop", "consider", "zero-free", "held-course"]

POLICIES: dict[str, str] = {
    "paper": "innovation of the heading row zero, row kept, B_z frozen (the paper's two steps)",
    "zero-free": "innovation of the heading row zero, row kept, B_z not frozen",
    "drop": "heading row left out, nothing frozen",
    "consider": "heading row left out, heading and B_z considered (Schmidt), covariance by the Joseph form",
    "held-course": "the last course measured again every second",
}

LITERAL_DEFECTS: tuple[str, ...] = (
    "(5): Earth and transport rate are left out of the gyro rates",
    "(25): the transition is (I + A) dt, which shrinks every sigma by dt in one step",
    "(27): roll by arctan, wrong above 90 deg; pitch by asin(a_x/g), undefined and skipped where |a_x| > g",
    "(28), (34): the heading innovation is not wrapped at +-180 deg",
    "(34): P = (I - K H) P, right for the optimal gain only, while B_z is corrected with another one",
    "(35): in an outage the heading row stays in H with innovation zero, so P believes in a measurement",
    "(37), (38): the depth is missing from the radii",
)
"""What `literal=True` keeps as printed. (30), a 6x6 H with zero rows, adds nothing to K. (32), the state by the printed
transition, is not used because the paper itself prefers (33); P^-1 in (34) is taken for P^-, a slip of the scan."""


@dataclass(frozen=True)
class PaperSettings:
    """Settings of the filter, SI and radians. The paper gives no tuning: these are assumed, and say for what they hold.

    level_std : one levelling sample of 10 ms; a longer one says more in proportion, as waves last for seconds.
    course_std : one course fix a second or more after the one before; closer ones say less in proportion.
    bias_std : start value of each gyro bias, rad/s. q_angle rad/sqrt(s), q_bias rad/s/sqrt(s): walks.
    rate : rows of the solution a second; None gives every imu epoch.
    start_* : known at the start; what is None comes from the first fix with a course, and from levelling.
    """

    outage_policy: Policy = "paper"
    literal: bool = False
    level_std: float = radians(20.0)
    course_std: float = radians(3.0)
    bias_std: float = radians(0.2)
    q_angle: float = radians(0.03)
    q_bias: float = radians(2e-4)
    start_level_std: float = radians(2.0)
    start_heading_std: float = radians(3.0)
    estimate_bias: bool = True
    earth_rate: bool = False  # the paper neglects it; True subtracts it from the gyros
    gravity: float = 9.80  # m/s^2, used by the printed asin(a_x/g) alone
    course_min_speed: float = 0.5  # m/s: below it a course says nothing about heading
    fix_hold: float = 1.5  # s that the velocity of a fix is used; later it is an outage
    course_interval: float = 1.0  # s between the heading rows of an outage
    gnss_std: tuple[float, float, float] = (1.0, 1.0, 2.0)  # m, where the table has no std_ columns
    gnss_velocity_std: float = 0.05  # m/s, likewise
    speed_std: float = 0.05  # m/s, white, one sample of the log
    speed_scale_std: float = 0.01
    depth_std: float = 0.1  # m
    rate: float | None = None
    start_time: float | None = None
    start_lat: float | None = None
    start_lon: float | None = None
    start_height: float | None = None
    start_roll: float | None = None
    start_pitch: float | None = None
    start_heading: float | None = None


# ---- the equations, one epoch ---------------------------------------------------------------------------------------


def state_rates(x: ArrayLike, u: ArrayLike) -> Array:
    """f(x, u) of (15): d/dt of (roll, pitch, heading, B_x, B_y, B_z), shape (6,), rad/s; x (6,), u (3,) gyro rad/s."""
    roll, pitch, _, *bias = np.asarray(x, dtype=float)
    p_x, p_y, p_z = np.asarray(u, dtype=float) - bias
    g_1 = p_y * np.sin(roll) + p_z * np.cos(roll)
    g_2 = p_y * np.cos(roll) - p_z * np.sin(roll)
    return np.array([p_x + g_1 * np.tan(pitch), g_2, g_1 / np.cos(pitch), 0.0, 0.0, 0.0])


def jacobian(x: ArrayLike, u: ArrayLike) -> Array:
    """A = df/dx of (17), shape (6, 6), 1/s (the paper prints the first row, (18)-(23))."""
    roll, pitch, _, *bias = np.asarray(x, dtype=float)
    _, p_y, p_z = np.asarray(u, dtype=float) - bias
    s, c, t, sec = np.sin(roll), np.cos(roll), np.tan(pitch), 1.0 / np.cos(pitch)
    g_1, g_2 = p_y * s + p_z * c, p_y * c - p_z * s
    A = np.zeros((6, 6))
    A[0] = g_2 * t, g_1 * sec**2, 0.0, -1.0, -s * t, -c * t
    A[1] = -g_1, 0.0, 0.0, 0.0, -c, s
    A[2] = g_2 * sec, g_1 * t * sec, 0.0, 0.0, -s * sec, -c * sec
    return A


def transition(A: ArrayLike, dt: float, literal: bool = False) -> Array:
    """Phi of one interval dt, s: I + A dt; literal: the printed (25), (I + A) dt."""
    A = np.asarray(A, dtype=float)
    identity = np.eye(len(A))
    return (identity + A) * dt if literal else identity + A * dt


def levelling(accel: ArrayLike, literal: bool = False, gravity: float = 9.80) -> tuple[float, float]:
    """Roll and pitch, rad, from specific force (3,), m/s^2, FRD, (0, 0, -g) at level rest; assumes no acceleration.

    literal: the printed (27), arctan and asin(a_x/gravity); the pitch is NaN where the asin is not defined.
    """
    a_x, a_y, a_z = (float(a) for a in np.asarray(accel, dtype=float))
    if literal:
        ratio = a_x / gravity
        return float(np.arctan(a_y / a_z)), float(np.arcsin(ratio)) if abs(ratio) <= 1.0 else float("nan")
    return float(np.arctan2(-a_y, -a_z)), float(np.arctan2(a_x, np.hypot(a_y, a_z)))


def course(v_n: ArrayLike) -> float:
    """Course over ground, rad clockwise from north, of a velocity whose first two components are north, east, m/s."""
    v_north, v_east, *_ = np.asarray(v_n, dtype=float)
    return float(np.arctan2(v_east, v_north))


def predict(x: Array, P: Array, u: Array, dt: float, Q: Array, literal: bool = False) -> tuple[Array, Array]:
    """Time update (31), (33): state and covariance dt seconds on. Q (6, 6) for this interval."""
    Phi = transition(jacobian(x, u), dt, literal)
    return x + state_rates(x, u) * dt, Phi @ P @ Phi.T + Q


def update(
    x: Array,
    P: Array,
    innovation: Array,
    H: Array,
    R: Array,
    frozen: tuple[int, ...] = (),
    considered: tuple[int, ...] = (),
) -> tuple[Array, Array]:
    """Measurement update (34) in matrix form, with P by the Joseph form, which is right for any gain.

    innovation (m,) rad, H (m, 6), R (m, m). frozen: states whose correction is thrown away after the gain is computed
    (the paper's freezing of B_z: P does not know). considered: states whose gain is zero (Schmidt: P knows).
    """
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    K[list(considered)] = 0.0
    dx = K @ innovation
    dx[list(frozen)] = 0.0
    I_KH = np.eye(len(x)) - K @ H
    return x + dx, I_KH @ P @ I_KH.T + K @ R @ K.T


# ---- a whole recording ----------------------------------------------------------------------------------------------


def navigate_paper(tables: Tables, settings: PaperSettings | None = None) -> Navigation:
    """Run the filter over the tables "imu", "gnss" (with velocity), "speed" and, if present, "depth".

    Starts at the first fix that gives a course (or at start_lat, start_lon, start_heading where all three are given).
    While fixes come, position is the fix's and velocity the receiver's; later than `fix_hold` after the last one, both
    come from the speed log along the body's x axis, (36)-(38). A fix is used at the first imu epoch that is not earlier
    than its stamp. Position sigma: of the last fix, grown by the filter's own heading sigma (taken as one sign for the
    whole outage), the log's scale and its noise; it knows nothing of a current, of leeway or of a wrong R.
    Raises InputError where a table or column that the method needs is missing or not finite.
    """
    from schuler.kernels import paper as kernel

    settings = settings or PaperSettings()
    if settings.outage_policy not in POLICIES:
        raise InputError(f'outage_policy is "{settings.outage_policy}"; give one of: {", ".join(POLICIES)}.')
    method = "paper-literal" if settings.literal else "paper"
    notes: list[str] = []
    time, gyro, accel = _rates(_need(tables, "imu", method), method, notes)
    fixes = _fixes(_need(tables, "gnss", method), settings, method, kernel.FIX_COLUMNS, notes)

    first, start = _start(time, accel, fixes, settings, method)
    time, gyro, accel = time[first:], gyro[first:], accel[first:]
    fix_row = np.searchsorted(time, fixes[:, kernel.FIX_TIME] - 1e-9)
    heard = (fixes[:, kernel.FIX_TIME] > start["time"] - 1e-9) & (fix_row < len(time))
    fixes, fix_row = np.ascontiguousarray(fixes[heard]), fix_row[heard].astype(np.int64)

    log = _need(tables, "speed", method)
    speed = _held(log, "speed", time, 0.0)
    intervals = np.diff(log.time, prepend=log.time[0] - 1.0)
    speed_interval = _held(Table("speed", {"time": log.time, "interval": intervals}), "interval", time, 1.0)
    depth_height = -_held(tables["depth"], "depth", time, np.nan) if "depth" in tables else np.full(len(time), np.nan)
    out_row = _output_rows(time, settings.rate)
    out = np.zeros((len(out_row), kernel.OUT_COLUMNS))
    at_fix = np.zeros((len(fixes), kernel.AT_COLUMNS))
    x = np.array([start["roll"], start["pitch"], start["heading"], 0.0, 0.0, 0.0])
    bias_std = settings.bias_std if settings.estimate_bias else 0.0
    P = np.diag(np.square([settings.start_level_std] * 2 + [settings.start_heading_std] + [bias_std] * 3))
    tuning = _tuning(settings)
    stopped = kernel.run(
        time, gyro, accel, speed, speed_interval, depth_height, fix_row, fixes, x, P,
        start["lat"], start["lon"], start["height"], tuning, out_row, out, at_fix,
    )  # fmt: skip
    if stopped:
        raise SchulerError(
            f'method "{method}" diverged {time[stopped] - time[0]:.1f} s after its start: a state is no longer finite'
            + (' (its printed equations do that; use method = "paper").' if settings.literal else ".")
        )
    notes += _what_to_know(settings, start, "depth" in tables)
    return Navigation(
        filter=_solution(time[out_row], out),
        states=_states(time[out_row], out),
        innovations=_innovations(fixes, at_fix),
        notes=notes,
    )


def _need(tables: Tables, name: str, method: str) -> Table:
    if name not in tables:
        why = {
            "imu": "its filter integrates gyro rates",
            "gnss": "its heading comes from the receiver's course",
            "speed": "its dead reckoning rests on the axial speed log",
        }[name]
        raise InputError(f'method = "{method}" needs a table "{name}": {why}; give it, or use method = "schuler".')
    table = tables[name]
    if not len(table):
        raise InputError(f'The table "{name}" has no rows; method = "{method}" needs it.')
    return table


def _rates(imu: Table, method: str, notes: list[str]) -> tuple[Array, Array, Array]:
    """Time, gyro rad/s and specific force m/s^2, each the mean over the interval that ends at its stamp."""
    time = np.ascontiguousarray(imu.time, dtype=float)
    if len(time) < 2:
        raise InputError(f'The table "imu" has {len(time)} row; method = "{method}" needs at least two.')
    interval = np.diff(time, prepend=time[0] - np.median(np.diff(time)))
    if imu.kind == "increments" or "dtheta_x" in imu:
        gyro = imu.stack("dtheta_x", "dtheta_y", "dtheta_z") / interval[:, None]
        accel = imu.stack("dv_x", "dv_y", "dv_z") / interval[:, None]
    else:
        gyro, accel = imu.stack("gyro_x", "gyro_y", "gyro_z"), imu.stack("accel_x", "accel_y", "accel_z")
    good = np.isfinite(gyro).all(axis=1) & np.isfinite(accel).all(axis=1) & np.isfinite(time)
    if not good.all():
        raise InputError(f'The table "imu" has {np.count_nonzero(~good)} rows that are not finite; remove these rows.')
    if not (interval > 0).all():
        raise InputError('The time of the table "imu" does not increase everywhere; sort it and remove double stamps.')
    longest = float(interval.max())
    if longest > max(0.5, 10 * float(np.median(interval))):
        notes.append(f"The imu has a gap of {longest:.2f} s: attitude is integrated across it with the rates after it.")
    return time, np.ascontiguousarray(gyro), np.ascontiguousarray(accel)


def _fixes(gnss: Table, settings: PaperSettings, method: str, width: int, notes: list[str]) -> Array:
    """Fixes with a position, in the kernel's columns; velocity where it is finite, course where it is fast enough."""
    if "v_north" not in gnss or "v_east" not in gnss:
        raise InputError(
            f'method = "{method}" takes its heading from the receiver\'s velocity: the table "gnss" needs the columns '
            'v_north[m/s] and v_east[m/s]; without them use method = "schuler".'
        )
    rows = np.zeros((len(gnss), width))

    def column(name: str, default: float) -> Array:
        values = np.asarray(gnss[name], dtype=float) if name in gnss else np.full(len(gnss), default)
        return np.where(np.isfinite(values), values, default)

    rows[:, 0], rows[:, 1], rows[:, 2] = gnss.time, gnss["lat"], gnss["lon"]
    rows[:, 3] = column("height", 0.0)
    velocity = np.column_stack([gnss["v_north"], gnss["v_east"], column("v_down", 0.0)])
    moving = np.isfinite(velocity).all(axis=1)
    rows[:, 4:7] = np.where(moving[:, None], velocity, 0.0)
    rows[:, 7] = moving
    rows[:, 8] = moving & (np.hypot(rows[:, 4], rows[:, 5]) >= settings.course_min_speed)
    for k, axis in enumerate(("north", "east", "down")):
        rows[:, 9 + k] = column(f"std_{axis}", settings.gnss_std[k])
    rows[:, 12] = column("std_v_north", settings.gnss_velocity_std)
    good = np.isfinite(rows[:, :3]).all(axis=1)
    slow = int(np.count_nonzero(good & (rows[:, 8] == 0)))
    if slow:
        notes.append(
            f"{slow} of {np.count_nonzero(good)} fixes gave no course (no velocity, or below "
            f"{settings.course_min_speed:g} m/s)."
        )
    return rows[good]


def _start(
    time: Array, accel: Array, fixes: Array, settings: PaperSettings, method: str
) -> tuple[int, dict[str, float]]:
    """First imu epoch used and the state there."""
    interval = time[1] - time[0]  # the first row covers as much before its stamp
    earliest = time[0] - interval if settings.start_time is None else settings.start_time
    given = (settings.start_lat, settings.start_lon, settings.start_heading)
    if None not in given:
        at = max(earliest, time[0])
        lat, lon, heading = cast("tuple[float, float, float]", given)
        height = settings.start_height or 0.0
    else:
        inside = (fixes[:, 0] >= earliest - 1e-9) & (fixes[:, 0] <= time[-1]) & (fixes[:, 8] > 0)
        if not inside.any():
            raise InputError(
                f'method = "{method}" starts at a fix with a course, and the table "gnss" has none between '
                f"{max(earliest, time[0]):g} s and {time[-1]:g} s that moves at {settings.course_min_speed:g} m/s or "
                "more; give lat_deg, lon_deg and heading_deg in [start]."
            )
        fix = fixes[np.argmax(inside)]
        at, lat, lon, height = fix[0], fix[1], fix[2], fix[3]
        if settings.start_lat is not None and settings.start_lon is not None:
            lat, lon = settings.start_lat, settings.start_lon
        heading = course(fix[4:6]) if settings.start_heading is None else settings.start_heading
        height = settings.start_height if settings.start_height is not None else height
    first = int(min(np.searchsorted(time, at - 1e-9), len(time) - 1))
    still = accel[(time > time[first] - 1.0) & (time <= time[first])].mean(axis=0)
    roll, pitch = levelling(still)
    return first, {
        "time": float(at),
        "lat": float(lat),
        "lon": float(lon),
        "height": float(height),
        "roll": roll if settings.start_roll is None else settings.start_roll,
        "pitch": pitch if settings.start_pitch is None else settings.start_pitch,
        "heading": float(wrap_pi(heading)),
    }


def _held(table: Table, column: str, time: Array, before: float) -> Array:
    """The last finite value at or before each time; `before` where there is none yet."""
    good = np.isfinite(table[column])
    stamps, values = table.time[good], np.asarray(table[column], dtype=float)[good]
    last = np.searchsorted(stamps, time + 1e-9, side="right") - 1
    return np.where(last >= 0, values[np.maximum(last, 0)], before) if len(values) else np.full(len(time), before)


def _output_rows(time: Array, rate: float | None) -> NDArray[np.int64]:
    """Epochs of the answer: all, or the first one at or after each multiple of 1/rate from the start, and the last."""
    if rate is None:
        return np.arange(len(time), dtype=np.int64)
    wanted = time[0] + np.arange(int((time[-1] - time[0]) * rate) + 1) / rate
    return np.unique(np.append(np.searchsorted(time, wanted - 1e-6), len(time) - 1)).astype(np.int64)


def _tuning(settings: PaperSettings) -> Tuning:
    from schuler.kernels import paper as kernel

    policies = {
        "paper": kernel.ZERO_FROZEN,
        "zero-free": kernel.ZERO_FREE,
        "drop": kernel.DROP,
        "consider": kernel.CONSIDER,
        "held-course": kernel.HELD,
    }
    return kernel.Tuning(
        level_var=settings.level_std**2,
        course_var=settings.course_std**2,
        q_angle=settings.q_angle,
        q_bias=settings.q_bias,
        policy=policies[settings.outage_policy],
        literal=settings.literal,
        estimate_bias=settings.estimate_bias,
        earth_rate=settings.earth_rate and not settings.literal,
        gravity=settings.gravity,
        fix_hold=settings.fix_hold,
        course_interval=settings.course_interval,
        speed_std=settings.speed_std,
        speed_scale=settings.speed_scale_std,
        depth_std=settings.depth_std,
    )


def _symmetric(a: Array, b: Array, c: Array, d: Array, e: Array, f: Array) -> Array:
    """(n, 3, 3) from the columns 11, 12, 13, 22, 23, 33."""
    return np.stack([a, b, c, b, d, e, c, e, f], axis=1).reshape(-1, 3, 3)


def _solution(time: Array, out: Array) -> Solution:
    from schuler.kernels import paper as kernel

    zero = np.zeros(len(time))
    position = [out[:, kernel.OUT_P_NN + k] for k in range(4)]
    velocity = [out[:, kernel.OUT_V_NN + k] for k in range(4)]
    return Solution(
        time=time,
        lat=out[:, kernel.OUT_LAT].copy(),
        lon=out[:, kernel.OUT_LON].copy(),
        height=out[:, kernel.OUT_HEIGHT].copy(),
        v_n=out[:, kernel.OUT_VN : kernel.OUT_VD + 1].copy(),
        rpy=out[:, kernel.OUT_ROLL : kernel.OUT_HEADING + 1].copy(),
        cov_pos=_symmetric(position[0], position[1], zero, position[2], zero, position[3]),
        cov_vel=_symmetric(velocity[0], velocity[1], zero, velocity[2], zero, velocity[3]),
        cov_rpy=_symmetric(*(out[:, kernel.OUT_P_RR + k] for k in range(6))),
    )


def _states(time: Array, out: Array) -> dict[str, StateHistory]:
    from schuler.kernels import paper as kernel

    return {
        f"gyro_bias_{axis}": StateHistory(
            f"gyro_bias_{axis}", "rad/s", time, out[:, kernel.OUT_BX + k].copy(), out[:, kernel.OUT_STD_BX + k].copy()
        )
        for k, axis in enumerate("xyz")
    }


def _innovations(fixes: Array, at_fix: Array) -> dict[str, Innovations]:
    """What each fix said: its course against the heading, its position against the dead reckoning that it replaces."""
    from schuler.kernels import paper as kernel

    answer: dict[str, Innovations] = {}
    rows = at_fix[:, kernel.AT_COURSE_USED] > 0
    if rows.any():
        y, s2 = at_fix[rows, kernel.AT_COURSE], at_fix[rows, kernel.AT_COURSE_VAR]
        answer["gnss_course"] = Innovations(
            "gnss_course", ("course",), "rad", fixes[rows, 0], y[:, None], np.sqrt(s2)[:, None], y**2 / s2,
            np.ones(len(y), dtype=bool),
        )  # fmt: skip
    rows = at_fix[:, kernel.AT_SEEN] > 0
    if rows.any():
        north, east, nn, ne, ee = (at_fix[rows, kernel.AT_NORTH + k] for k in range(5))
        nis = (ee * north**2 - 2.0 * ne * north * east + nn * east**2) / (nn * ee - ne**2)
        answer["gnss_position"] = Innovations(
            "gnss_position", ("north", "east"), "m", fixes[rows, 0], np.column_stack([north, east]),
            np.sqrt(np.column_stack([nn, ee])), nis, np.ones(len(north), dtype=bool),
        )  # fmt: skip
    return answer


def _what_to_know(settings: PaperSettings, start: dict[str, float], has_depth: bool) -> list[str]:
    notes = [
        f"Started at {start['time']:g} s with heading {np.degrees(start['heading']) % 360:.1f} deg"
        + (", the course of the first fix." if settings.start_heading is None else ", as given."),
        "Course over ground is taken for heading, as the paper does: a current or leeway adds the crab angle.",
        "The position sigma comes from heading, log scale and log noise; it does not know of any current.",
    ]
    if not settings.literal and settings.outage_policy in ("paper", "zero-free", "held-course"):
        notes.append(
            "Without fixes this policy keeps the heading row, so the heading sigma (and with it the position sigma) is "
            'far too small; outage_policy = "consider" gives the same track with an honest one.'
        )
    if not has_depth:
        notes.append("No depth table: height is integrated from the speed log and pitch, (36).")
    if settings.literal:
        notes += [f"As printed, {defect}." for defect in LITERAL_DEFECTS]
    elif not settings.earth_rate:
        notes.append("Earth rate is left in the gyro biases, as in the paper; it turns with heading for B_x and B_y.")
    return notes
