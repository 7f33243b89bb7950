"""Kind "ahrs": attitude from an IMU, with or without a magnetometer; whole recordings, and row by row.

`attitude` and `navigate` run over whole tables, `AhrsFilter` is fed row by row; all call the same compiled steps
(`kernels.ahrs`, where the states are explained). SI and radians; n = NED, b = forward-right-down.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, isfinite, nan, pi, radians, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.aiding.solution import Innovations, Navigation, Solution, StateHistory
from schuler.ground.errors import InputError
from schuler.ground.tables import Table, Tables

Array = NDArray[np.float64]
SMOOTHER_BYTES = 3e9
OMEGA = 7.292115e-5
STATES = (  # name, unit, index in the nominal state, index in the error state
    ("gyro_bias_x", "rad/s", 4, 3),
    ("gyro_bias_y", "rad/s", 5, 4),
    ("gyro_bias_z", "rad/s", 6, 5),
    ("accel_bias_x", "m/s^2", 7, 6),
    ("accel_bias_y", "m/s^2", 8, 7),
    ("accel_bias_z", "m/s^2", 9, 8),
    ("heading_offset", "rad", 12, 11),
)


@dataclass(frozen=True)
class AhrsSettings:
    """What the filter is told. Sigmas are 1 sigma; the defaults are those of a consumer MEMS unit moved by hand.

    gyro_arw rad/sqrt(s); gyro_bias_std rad/s at turn-on, gyro_walk rad/s/sqrt(s); gyro_scale: share of every turn that
    scale and misalignment may falsify; accel_vrw m/s/sqrt(s); accel_bias_std m/s^2, accel_walk m/s^2/sqrt(s).
    mag_std rad: error of the compass heading that lasts mag_tau s; mag_white rad: of one row; declination rad;
    field: (size in T or the tables' unit, dip in rad, down positive) where known, else learnt; lat rad: for Earth rate.
    start_roll ... rad, None: found; std_heading of a given start_heading. Without magnetometer and start_heading the
    heading is relative to the start.
    """

    gyro_arw: float = 3e-4
    gyro_bias_std: float = radians(0.5)
    gyro_walk: float = 2e-5
    gyro_scale: float = 0.01
    accel_vrw: float = 3e-3
    accel_bias_std: float = 0.05
    accel_walk: float = 1e-4
    mag_std: float = radians(1.5)
    mag_tau: float = 20.0
    mag_white: float = 0.03
    declination: float = 0.0
    field: tuple[float, float] | None = None
    lat: float | None = None
    start_time: float | None = None
    start_roll: float | None = None
    start_pitch: float | None = None
    start_heading: float | None = None
    std_tilt: float = 0.1
    std_heading: float = radians(2.0)
    # how the filter works
    node: float = 0.1  # s between updates
    leak: float = 5.0  # s, of the leaking integrator u
    swing_std: float = 0.02  # m/s, least sigma of u
    swing_tau: float = 0.5  # s, how long a value of u lasts
    swing_memory: float = 5.0  # s over which the sigma of u is learnt
    swing_start: float = 0.15  # m/s, what it is taken for at the start
    bend: float = 1.0  # heading sigma over what size and dip of the field tell of its disturbance
    bend_tau: float = 2.0  # s, how long a disturbance lasts
    field_noise: float = 0.004  # relative, of size and dip
    field_memory: float = 1000.0  # s over which size and dip are learnt
    find_iron: bool = True  # a hard iron is found by itself, where the body turns enough to tell it
    rest_rate: float = 0.03  # rad/s: still is what keeps that near its own mean
    rest_force: float = 0.3  # m/s^2
    rest_time: float = 0.5  # s
    rest_std: float = 0.005  # rad/s: rate at rest, each 0.1 s
    rest_turn: float = 0.003  # rad/s: how fast a thing at rest may turn
    smoother: bool = True
    output_rate: float | None = None  # Hz; None: 10 or that of the rows if slower; inf: every row


@dataclass
class Attitude:
    """Attitude over time: time (n,) s, q (n, 4) q_nb scalar first, cov_phi (n, 3, 3) rad^2 of the error phi in n."""

    time: Array
    q: Array
    cov_phi: Array

    @property
    def C(self) -> Array:
        """(n, 3, 3) C_nb."""
        from schuler.ground.frames import dcm_from_quat

        return dcm_from_quat(self.q)

    @property
    def rpy(self) -> Array:
        """(n, 3) roll, pitch, heading, rad."""
        from schuler.ground.frames import euler_from_quat

        return np.column_stack(euler_from_quat(self.q))


@dataclass
class AhrsRun:
    """What a run gives beside the `Navigation`: attitudes with their covariance in n, and what each node told.

    relative : heading is counted from the start. nodes: columns of `kernels.ahrs_state` K_T ... hard_iron (3,): what
    was taken off the field at the end, in its unit and in b.
    """

    filter: Attitude
    smoother: Attitude | None
    nodes: Array
    relative: bool
    hard_iron: Array


def configuration(s: AhrsSettings, interval: float, mag: bool) -> Array:
    """The kernel's configuration vector for rows `interval` s apart."""
    from schuler.kernels import ahrs_state as k

    c = np.zeros(k.NC)
    absolute = mag or s.start_heading is not None
    root = sqrt(max(interval, 1e-6))
    values = {
        k.NODE_S: s.node, k.ARW: s.gyro_arw, k.Q_BG: s.gyro_walk, k.SCALE: s.gyro_scale, k.VRW: s.accel_vrw,
        k.Q_BA: s.accel_walk, k.TAU_U: s.leak, k.SIG_U: s.swing_std, k.TAU_UC: s.swing_tau, k.TAU_VAR: s.swing_memory,
        k.HAS_MAG: float(mag), k.MAG_WHITE: s.mag_white, k.MAG_STD: s.mag_std if mag else 0.0,
        k.MAG_TAU: s.mag_tau, k.BEND: s.bend,
        k.BEND_TAU: s.bend_tau, k.DECLINATION: s.declination, k.FIELD_TAU: s.field_memory,
        k.FIELD_NOISE: s.field_noise, k.FIX_FIELD: float(s.field is not None),
        # a still sensor moves within its own noise at least
        k.REST_RATE: max(s.rest_rate, 5.0 * s.gyro_arw / root),
        k.REST_FORCE: max(s.rest_force, 5.0 * s.accel_vrw / root),
        k.REST_S: s.rest_time, k.REST_STD: s.rest_std, k.REST_TURN: s.rest_turn,
        k.GAP_S: max(5.5 * interval, 0.05), k.GAP_RATE: 0.1, k.LEVEL_S: 0.1, k.STD_TILT: s.std_tilt,
        k.STD_HEAD: s.std_heading if s.start_heading is not None else 0.0,
        k.ROLL0: nan if s.start_roll is None else s.start_roll,
        k.PITCH0: nan if s.start_pitch is None else s.start_pitch,
        k.HEAD0: nan if s.start_heading is None else s.start_heading,
        k.EARTH_N: OMEGA * cos(s.lat) if s.lat is not None and absolute else 0.0,
        k.FIND_IRON: float(mag and s.find_iron),
        k.EARTH_D: -OMEGA * sin(s.lat) if s.lat is not None else 0.0,
    }  # fmt: skip
    for i, v in values.items():
        c[i] = v
    return c


def initial(s: AhrsSettings, time: float, mag: bool) -> tuple[Array, Array]:
    """Nominal state and covariance before the first row, whose interval begins at `time`."""
    from schuler.kernels import ahrs_state as k

    x, P = np.zeros(k.NX), np.zeros((k.N, k.N))
    x[k.T] = x[k.TN] = time
    if s.field is not None:
        x[k.NORM], x[k.DIP] = s.field
    x[k.UVAR], x[k.TVAR] = s.swing_start**2, 0.5 * s.swing_memory
    for i in range(3):
        P[k.E_BG + i, k.E_BG + i] = s.gyro_bias_std**2
        P[k.E_BA + i, k.E_BA + i] = s.accel_bias_std**2
    P[k.E_M, k.E_M] = s.mag_std**2 if mag else 0.0
    return x, P


class AhrsFilter:
    """The filter fed row by row; the same compiled step as `navigate`, so the same numbers.

    interval : s, usual time between rows; the first row covers it too. mag : a magnetometer will come.
    """

    def __init__(self, settings: AhrsSettings | None = None, *, interval: float, mag: bool = True) -> None:
        from schuler.kernels import ahrs_state as k
        from schuler.kernels.ahrs import WORK

        if not (isfinite(interval) and interval > 0.0):
            raise InputError(f"the interval between rows is {interval!r} s; give a time above 0, such as 0.01")
        self.settings = settings or AhrsSettings()
        self.mag = mag
        self.interval = interval
        self.c = configuration(self.settings, interval, mag)
        self.x, self.P = initial(self.settings, nan, mag)
        self.told = np.zeros(k.NK)
        self._scratch = (np.zeros((k.N, k.N)), np.zeros(k.NOMINAL), np.zeros((k.N, k.N)), np.zeros((WORK, k.N)))

    def update(self, time: float, gyro: ArrayLike, accel: ArrayLike, mag: ArrayLike | None = None) -> bool:
        """One row: means of rate (rad/s) and specific force (m/s^2) in b since the row before, the field at `time`.

        A row with a value that is not a number is passed over, and the attitude's sigma grows as over any gap. Returns
        True where the measurements were used (each settings.node seconds). Raises InputError where time goes back.
        """
        from schuler.kernels import ahrs_state as k
        from schuler.kernels.ahrs import step

        w, f = np.asarray(gyro, dtype=np.float64), np.asarray(accel, dtype=np.float64)
        m = np.full(3, nan) if mag is None else np.asarray(mag, dtype=np.float64)
        if w.shape != (3,) or f.shape != (3,) or m.shape != (3,):
            raise InputError("gyro, accel and mag are three numbers each: x, y, z")
        if not (isfinite(time) and np.isfinite(w).all() and np.isfinite(f).all()):
            return False
        if isfinite(self.x[k.T]) and time <= self.x[k.T]:
            raise InputError(
                f"the row of {time:.6f} s comes after that of {self.x[k.T]:.6f} s; rows go forward in time"
            )
        if not isfinite(self.x[k.T]):
            self.x[k.T] = self.x[k.TN] = time - self.interval
        row = (float(time), *w, *f, *m)
        return bool(step(self.x, self.P, self.c, *row, self.told, *self._scratch))  # type: ignore[call-arg]

    @property
    def ready(self) -> bool:
        """Level, and heading found where a magnetometer is expected."""
        from schuler.kernels import ahrs_state as k

        return bool(self.x[k.STATUS] > (1.5 if self.mag else 0.5))

    @property
    def time(self) -> float:
        from schuler.kernels import ahrs_state as k

        return float(self.x[k.T])

    @property
    def q_nb(self) -> Array:
        """(4,) attitude, scalar first."""
        return self.x[:4].copy()

    @property
    def rpy(self) -> Array:
        """(3,) roll, pitch, heading, rad."""
        from schuler.ground.frames import euler_from_quat

        return np.array(euler_from_quat(self.x[:4]))

    @property
    def cov_phi(self) -> Array:
        """(3, 3) rad^2 of the attitude error in n."""
        return self.P[:3, :3].copy()

    @property
    def gyro_bias(self) -> Array:
        """(3,) rad/s."""
        return self.x[4:7].copy()


def rows_of(imu: Table) -> tuple[Array, Array, Array, Array]:
    """time (n,), rates, specific force (n, 3) and field (n, 3), or (0, 3) where there is none, of an imu table."""
    t = np.ascontiguousarray(imu.time, dtype=np.float64)
    if imu.kind == "increments":
        dt = np.diff(t, prepend=t[0] - float(np.median(np.diff(t))))[:, None]
        w, f = imu.stack("dtheta_x", "dtheta_y", "dtheta_z") / dt, imu.stack("dv_x", "dv_y", "dv_z") / dt
    else:
        w, f = imu.stack("gyro_x", "gyro_y", "gyro_z"), imu.stack("accel_x", "accel_y", "accel_z")
    names = ("mag_x", "mag_y", "mag_z")
    m = imu.stack(*names) if all(n in imu for n in names) else np.zeros((0, 3))
    return t, np.ascontiguousarray(w), np.ascontiguousarray(f), np.ascontiguousarray(m)


def attitude(
    time: ArrayLike,
    gyro: ArrayLike,
    accel: ArrayLike,
    mag: ArrayLike | None = None,
    settings: AhrsSettings | None = None,
) -> Attitude:
    """Filtered attitude at every row from plain arrays: time (n,), gyro and accel and mag (n, 3), in b."""
    s = settings or AhrsSettings()
    t, w, f = (np.ascontiguousarray(a, dtype=np.float64) for a in (time, gyro, accel))
    m = np.zeros((0, 3)) if mag is None else np.ascontiguousarray(mag, dtype=np.float64)
    if t.ndim != 1 or w.shape != (len(t), 3) or f.shape != w.shape or (len(m) and m.shape != w.shape):
        raise InputError(f"time has shape {t.shape}; gyro, accel and mag need one row of three for each time")
    return _run(t, w, f, m, s, 0.0, False)[0]


def _run(
    t: Array, w: Array, f: Array, m: Array, s: AhrsSettings, out_dt: float, keep: bool
) -> tuple[Attitude, Array, Array, Array, tuple[Array, ...], Array]:
    """Filter over all rows: attitude, nodes, nominal states and sigmas at nodes, what the smoother needs, end state."""
    from schuler.kernels import ahrs_state as k
    from schuler.kernels.ahrs import run

    if len(t) < 2:
        raise InputError("the imu table holds fewer than two rows; nothing can be navigated")
    interval = float(np.median(np.diff(t)))
    mag = len(m) > 0
    x, P = initial(s, float(t[0]) - interval, mag)
    c = configuration(s, interval, mag)
    n = len(t) if out_dt <= 0.0 else min(len(t), int((t[-1] - t[0]) / out_dt * 1.001) + 4)
    j = min(len(t), int((t[-1] - t[0]) / max(s.node, interval) * 1.6) + 8) + 1
    ot, oq, op = np.zeros(n), np.zeros((n, 4)), np.zeros((n, 3, 3))
    told, hx, hs = np.zeros((j, k.NK)), np.zeros((j, k.NOMINAL)), np.zeros((j, k.N))
    r = j if keep else 0
    nodes = (np.zeros((r, k.NOMINAL)), np.zeros((r, k.N, k.N)), np.zeros((r, k.N, k.N)), np.zeros((r, k.N, k.N)))
    counts = np.zeros(2, np.int64)
    run(t, w, f, m, x, P, c, out_dt, ot, oq, op, told, hx, hs, nodes, counts)
    no, nn = int(counts[0]), int(counts[1])
    if not np.isfinite(x[: k.NOMINAL]).all():
        raise InputError("the filter lost its numbers; the input holds values far outside any vehicle (schuler check)")
    parts = tuple(a[: nn if keep else 0] for a in nodes)
    return Attitude(ot[:no], oq[:no], op[:no]), told[:nn], hx[:nn], hs[:nn], parts, x


def navigate(tables: Tables, settings: AhrsSettings) -> tuple[Navigation, AhrsRun]:
    """Filters and (settings.smoother) smooths the imu table; position and velocity of the solution are NaN.

    Raises InputError where no attitude can be found.
    """
    from schuler.kernels import ahrs_state as k

    notes: list[str] = []
    t, w, f, m = rows_of(tables["imu"])
    good = np.isfinite(t) & np.isfinite(w).all(axis=1) & np.isfinite(f).all(axis=1)
    if settings.start_time is not None:
        good &= t >= settings.start_time
    if not good.all():
        t, w, f, m = t[good], w[good], f[good], m[good] if len(m) else m
    m = _usable_field(w, m, notes)
    mag = len(m) > 0
    if len(t) < 2:
        raise InputError("the imu table holds fewer than two usable rows; nothing can be navigated")
    interval = float(np.median(np.diff(t)))
    rate = settings.output_rate or 10.0
    out_dt = 0.0 if rate == inf or rate * interval >= 0.999 else 1.0 / rate
    smoother = settings.smoother
    size = (t[-1] - t[0]) / max(settings.node, interval) * (3 * k.N * k.N + 2 * k.NOMINAL) * 8
    if smoother and size > SMOOTHER_BYTES:
        smoother = False
        notes.append(f"no smoother: it would need more than {SMOOTHER_BYTES / 1e9:.0f} GB of memory")
    found, told, hx, hs, parts, end = _run(t, w, f, m, settings, out_dt, smoother)
    if len(found.time) == 0 or len(told) == 0:
        raise InputError(
            f"the recording of {t[-1] - t[0]:.2g} s is too short for an attitude; it takes 0.3 s at the least"
        )
    if found.time[0] - t[0] > 2.0:
        notes.append(f"attitude begins {found.time[0] - t[0]:.1f} s after the first row: with the first magnetic field")
    later = None
    smoothed: tuple[Array, Array] | None = None
    if smoother and len(told) > 1:
        from schuler.kernels.ahrs_smooth import rows_between, smooth

        nx, nP, uP, nX = parts
        ux = hx.copy()
        dpre, dpost = smooth(len(told), nx, nP, ux, uP, nX)
        later = Attitude(found.time, np.zeros_like(found.q), np.zeros_like(found.cov_phi))
        rows_between(found.time, found.q, told[:, k.K_T].copy(), uP, dpre, dpost, later.q, later.cov_phi)
        smoothed = ux, np.sqrt(np.maximum(np.einsum("nii->ni", uP), 0.0))
    navigation = Navigation(_solution(found), None if later is None else _solution(later), notes=notes)
    navigation.states = _histories(told[:, k.K_T].copy(), hx, hs, smoothed)
    navigation.innovations = _innovations(told)
    relative = not mag and settings.start_heading is None
    return navigation, AhrsRun(found, later, told, relative, end[k.IRON : k.IRON + 3].copy())


def _usable_field(w: Array, m: Array, notes: list[str]) -> Array:
    """The field, or (0, 3) and a note where the magnetometer tells nothing."""
    none = np.zeros((0, 3))
    if not len(m):
        return none
    known = np.isfinite(m).all(axis=1)
    if not known.any() or not np.any(m[known] != 0.0):
        notes.append("the magnetometer reads nothing or zero throughout: left out")
        return none
    turned = float(np.sqrt(np.mean(np.sum(w**2, axis=1))))
    if known.sum() > 20 and np.ptp(m[known], axis=0).max() == 0.0 and turned > radians(1.0):
        notes.append("the magnetometer reads one and the same value while the body turns: it is stuck, and left out")
        return none
    return m


def euler_errors(rpy: Array) -> Array:
    """(n, 3, 3) E with errors of roll, pitch, heading = E phi; the pitch is kept 1 deg from the vertical."""
    limit = 89.0 * pi / 180.0
    pitch = np.clip(rpy[:, 1], -limit, limit)
    co, si = np.cos(rpy[:, 2]), np.sin(rpy[:, 2])
    E = np.zeros((len(rpy), 3, 3))
    E[:, 0, 0], E[:, 0, 1] = co / np.cos(pitch), si / np.cos(pitch)
    E[:, 1, 0], E[:, 1, 1] = -si, co
    E[:, 2, 0], E[:, 2, 1], E[:, 2, 2] = co * np.tan(pitch), si * np.tan(pitch), 1.0
    return -E


def _solution(a: Attitude) -> Solution:
    n = len(a.time)
    rpy = a.rpy
    E = euler_errors(rpy)
    none, block = np.full(n, nan), np.full((n, 3, 3), nan)
    cov = E @ a.cov_phi @ E.transpose(0, 2, 1)
    return Solution(a.time, none, none, none, np.full((n, 3), nan), rpy, block, block, cov)


def _histories(time: Array, hx: Array, hs: Array, smoothed: tuple[Array, Array] | None) -> dict[str, StateHistory]:
    states = {}
    for name, unit, ix, ie in STATES:
        if hs[:, ie].max(initial=0.0) <= 0.0:
            continue
        state = StateHistory(name, unit, time, hx[:, ix].copy(), hs[:, ie].copy())
        if smoothed is not None:
            state.smoothed, state.smoothed_std = smoothed[0][:, ix].copy(), smoothed[1][:, ie].copy()
        states[name] = state
    return states


def _innovations(told: Array) -> dict[str, Innovations]:
    from schuler.kernels import ahrs_state as k

    t = told[:, k.K_T]
    u, su = told[:, k.K_U : k.K_U + 2], told[:, k.K_SU : k.K_SU + 2]
    nis = np.sum((u / su) ** 2, axis=1)
    found = {
        "levelling": Innovations(
            "levelling", ("north", "east"), "m/s", t.copy(), u.copy(), su.copy(), nis, np.ones(len(t), dtype=bool)
        )
    }
    seen = np.isfinite(told[:, k.K_S])
    if seen.any():
        y, sd = told[seen, k.K_Y : k.K_Y + 1], told[seen, k.K_S : k.K_S + 1]
        found["magnetometer"] = Innovations(
            "magnetometer", ("heading",), "rad", t[seen].copy(), y.copy(), sd.copy(), ((y / sd) ** 2)[:, 0],
            told[seen, k.K_USED] > 0.5,
        )  # fmt: skip
    return found
