"""What fixes and [start] say of where the IMU is and how fast it goes, at a time, from nothing that comes later."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_engine import StartState
from schuler.aiding.aided_settings import AidedSettings
from schuler.ground.earth import WGS84
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, quat_from_dcm
from schuler.ground.tables import Table, Tables

Array = NDArray[np.float64]
SLOW = np.array([1.0, 1.0, 1.5])  # a fix's slow error: down is worse
TOLD_STD = 0.3  # m/s, of a receiver's velocity
UNKNOWN_MPS = 15.0  # 1 sigma of a velocity that nobody tells
SEA_STD = 30.0  # m: the sea's surface against the ellipsoid
CHANGE = 2.5  # m/s^2: what a vehicle may do between two fixes, 1 sigma


class Places:
    """Position and velocity of the IMU at a time, from the last fix that is not stamped later, and [start]."""

    def __init__(self, tables: Tables, s: AidedSettings) -> None:
        self.s, self.tables = s, tables
        first = tables["imu"].time[:1]
        self.typed_at = s.start.time if s.start.time is not None else float(first[0]) if len(first) else -math.inf
        self.time = np.zeros(0)  # stamps
        gnss = tables.get("gnss")
        if gnss is None:
            return
        good = np.isfinite(gnss["lat"]) & np.isfinite(gnss["lon"])
        g = gnss.where(good)
        self.gnss = g
        self.time = g.time
        self.known_up = np.isfinite(g["height"]) if "height" in g else np.zeros(len(g), dtype=bool)
        self.height = np.where(self.known_up, g["height"] if "height" in g else 0.0, s.start.height or 0.0)
        self.v = self._velocities(g)

    def _velocities(self, g: Table) -> Array:
        """(n, 3) NED: as told, else from this fix and the one before."""
        n = len(g)
        v, self.step = np.full((n, 3), np.nan), np.full(n, np.nan)
        if n > 1:
            d = WGS84.displacement_n(
                g["lat"][1:], g["lon"][1:], self.height[1:], g["lat"][:-1], g["lon"][:-1], self.height[:-1]
            )
            self.step[1:] = np.diff(g.time)
            dt = self.step[1:, None]
            v[1:] = np.where(dt < 5.0, d / dt, np.nan)
        self.told = np.zeros(n, dtype=bool)
        if "v_north" in g and "v_east" in g:
            self.told = np.isfinite(g["v_north"]) & np.isfinite(g["v_east"])
            down = g["v_down"].astype(float) if "v_down" in g else np.where(np.isfinite(v[:, 2]), v[:, 2], 0.0)
            down = np.where(np.isfinite(down), down, 0.0)
            v = np.where(self.told[:, None], np.column_stack([g["v_north"], g["v_east"], down]), v)
        elif "course" in g and "speed" in g:
            c, u = g["course"], g["speed"]
            self.told = np.isfinite(c) & np.isfinite(u)
            v[self.told, 0], v[self.told, 1] = (u * np.cos(c))[self.told], (u * np.sin(c))[self.told]
            v[self.told, 2] = np.where(np.isfinite(v[self.told, 2]), v[self.told, 2], 0.0)
        return v

    def fix(self, time: float) -> int | None:
        """The last fix stamped not later than a time."""
        i = int(np.searchsorted(self.time, time + 1e-9)) - 1
        return i if i >= 0 else None

    def ready(self, time: float) -> float:
        """The first moment not before a time at which the place is known."""
        if self.s.start.lat is not None and self.s.start.lon is not None:
            return time
        return max(time, float(self.time[0])) if len(self.time) else time

    def acceleration(self, time: float) -> Array | None:
        """NED m/s^2 over the second before a time, from velocities that a receiver told; None where none did."""
        i = self.fix(time)
        if i is None or i < 1 or time - self.time[i] > 1.0:
            return None
        j = min(int(np.searchsorted(self.time, self.time[i] - 1.05)), i - 1)
        dt = self.time[i] - self.time[j]
        d = self.v[i] - self.v[j]
        if not np.isfinite(d).all() or not 0.0 < dt < 1.6 or not (self.told[i] and self.told[j]):
            return None
        return d / dt

    def state_at(
        self, time: float, C_nb: Array, cov_phi: Array, *, standing: bool = False, moved: bool = False,
        from_course: bool = False, bias: Array | None = None, bias_std: Array | None = None, from_force: bool = True,
        notes: list[str] | None = None,
    ) -> StartState:  # fmt: skip
        """The start with an attitude C_nb and its covariance cov_phi (3, 3). moved: what is typed of the velocity
        belongs to an earlier moment. from_course: the heading is that of the velocity, and errs with it."""
        s, start = self.s, self.s.start
        notes = [] if notes is None else notes
        C = np.asarray(C_nb)
        i = self.fix(time)
        place: list[float | None] = [start.lat, start.lon, start.height]
        v: list[float | None] = [None] * 3 if moved else list(start.v_n)
        std = np.array([math.nan if x is None else x for x in start.std_pos])
        if i is not None and not standing and time > self.typed_at + 1.0 and self.time[i] > self.typed_at:
            # what is typed belongs to another moment: the fix knows better
            place[:2], std[:2] = [None, None], math.nan
            if self.known_up[i]:
                place[2], std[2] = None, math.nan
        vstd = np.array([math.nan if x is None or moved else x for x in start.std_vel])
        cov = np.zeros((9, 9))
        cov[:3, :3] = cov_phi
        slow = np.zeros(3)
        fixed, fixed_std = np.zeros(3), np.full(3, 0.1 if standing else UNKNOWN_MPS)
        if i is not None:
            age = max(0.0, time - float(self.time[i]) + s.gnss_delay)
            if np.isfinite(self.v[i]).all() and not standing:
                fixed, fixed_std = self.v[i], self._velocity_std(i) + 2.0 * age
            arm = C @ np.asarray(s.antenna)
            lat, lon, up = WGS84.displace(
                float(self.gnss["lat"][i]), float(self.gnss["lon"][i]), float(self.height[i]), -arm + fixed * age
            )
            aged = (0.0 if standing else 2.0 * age) + s.gnss_delay_std * float(np.linalg.norm(fixed))
            sigma = np.hypot(self._position_std(i), aged)
            for k, value in enumerate((lat, lon, up)):
                if place[k] is None and (k < 2 or self.known_up[i]):
                    place[k] = float(value)
                    slow[k] = s.gnss_correlated_std * SLOW[k]
                    std[k] = sigma[k] if math.isnan(std[k]) else std[k]
        if place[0] is None or place[1] is None:
            raise InputError(
                "the position at the start is not known: type [start] lat_deg, lon_deg and height_m, or name a gnss "
                "table"
            )
        typed = [x is not None for x in v]
        if not any(typed) and not standing and (i is None or not np.isfinite(self.v[i]).all()):
            through = self._through(time, C, cov_phi)
            if through is not None:
                fixed, cov[3:6, 3:6], cov[3:6, :3] = through
                cov[:3, 3:6] = cov[3:6, :3].T
                fixed_std = np.zeros(3)
            else:
                notes.append(
                    f"no velocity is known at the start: 0 +- {UNKNOWN_MPS:g} m/s; type [start] v_north_mps and others"
                )
        for k in range(3):
            given = math.isfinite(vstd[k])
            sd = vstd[k] if given else 0.1 if typed[k] else float(fixed_std[k])
            cov[3 + k, 3 + k] += sd**2
        v_n = np.array([fixed[k] if v[k] is None else v[k] for k in range(3)], dtype=float)
        if from_course and i is not None:
            # phi_D = -(course error) = (v_E dv_N - v_N dv_E) / v^2
            g = np.array([v_n[1], -v_n[0], 0.0]) / max(float(v_n[0] ** 2 + v_n[1] ** 2), 1e-6)
            N = self._velocity_noise(i) ** 2
            cov[2, 2] += float(g @ (N * g))
            cov[2, 3:6] = cov[3:6, 2] = N * g
        std = np.where(np.isfinite(std), std, np.array([1.0, 1.0, 2.0]))
        under = None
        if place[2] is None and "depth" in self.tables:
            under = self._depth(time)
            if under is not None:
                place[2] = -under
                std[2] = math.hypot(SEA_STD, s.depth_std)
        cov[np.arange(6, 9), np.arange(6, 9)] = std**2
        q = np.asarray(quat_from_dcm(C), dtype=float)
        return StartState(
            float(time), q, v_n, float(place[0]), float(place[1]), float(place[2] or 0.0), cov, bias, bias_std,
            from_force, notes, slow, SEA_STD if under is not None else None,
        )  # fmt: skip

    def _position_std(self, i: int) -> Array:
        """(3,) of a fix: told whole by the receiver, or the settings' two parts."""
        s = self.s
        slow = s.gnss_correlated_std * SLOW
        default = np.hypot(s.gnss_std, slow)
        told = [_told(self.gnss, f"std_{a}", i, d) for a, d in zip(("north", "east", "down"), default, strict=True)]
        return np.maximum(told, slow)

    def _velocity_std(self, i: int) -> Array:
        if self.told[i]:
            told = [
                _told(self.gnss, f"std_v_{a}", i, d)
                for a, d in zip(("north", "east", "down"), self.s.gnss_velocity_std, strict=True)
            ]
            return np.maximum(TOLD_STD, np.minimum(told, 3.0))
        return np.hypot(self._velocity_noise(i), 0.5 * CHANGE * float(self.step[i]))

    def _velocity_noise(self, i: int) -> Array:
        """(3,) the part of it that the fixes' noise makes."""
        return self._velocity_std(i) if self.told[i] else 1.5 * self._noise(i) / float(self.step[i])

    def _noise(self, i: int) -> Array:
        """(3,) m: the fast part of a fix's error."""
        whole, slow = self._position_std(i), self.s.gnss_correlated_std * SLOW
        return np.sqrt(np.maximum(whole**2 - slow**2, 0.01 * whole**2))

    def course(self, i: int) -> tuple[float, float]:
        """Course over ground of a fix and the sigma that its velocity leaves, rad."""
        v = self.v[i]
        speed = max(math.hypot(float(v[0]), float(v[1])), 1e-3)
        sigma = float(np.max(self._velocity_noise(i)[:2]))
        return math.atan2(float(v[1]), float(v[0])), sigma / speed

    def _depth(self, time: float) -> float | None:
        d = self.tables["depth"]
        at = int(np.searchsorted(d.time, time + 1e-9)) - 1
        return float(d["depth"][at]) if at >= 0 and time - d.time[at] < 10.0 else None

    def _through(self, time: float, C: Array, cov_phi: Array) -> tuple[Array, Array, Array] | None:
        """v_n, its covariance and that with phi, from a DVL or a speed in the five seconds before: v_n = C v_b."""
        s = self.s
        for name in ("dvl", "speed"):
            table = self.tables.get(name)
            if table is None or (name == "speed" and ("speed" not in table or s.speed_is != "ground")):
                continue
            at = int(np.searchsorted(table.time, time + 1e-9)) - 1
            if at < 0 or time - table.time[at] > 5.0:
                continue
            age = time - float(table.time[at])
            if name == "dvl":
                u = np.array([table["v_x"][at], table["v_y"][at], table["v_z"][at]], dtype=float)
                sd = np.full(3, s.dvl_std) + s.dvl_misalignment_std * float(np.linalg.norm(u))
            else:
                u = np.array([table["speed"][at], 0.0, 0.0], dtype=float)
                sd = np.array([s.speed_std, 0.5, 0.5]) + s.mounting_std * abs(u[0])
            if not np.isfinite(u).all():
                continue
            v = C @ u
            R = C @ np.diag((sd + 0.5 * age) ** 2) @ C.T
            X = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])  # dv = v x phi
            return v, R + X @ cov_phi @ X.T, X @ cov_phi
        return None

    def first_reading(self, time: float) -> float:
        """Without fixes: the first moment from which a DVL or speed tells the velocity and a depth the height.

        What does not come within 10 s is not waited for.
        """
        s, soon = self.s.start, time + 10.0
        if len(self.time):
            return time

        def first(*names: str) -> float:
            found = [t[t >= time - 1e-9][:1] for t in (self.tables[n].time for n in names if n in self.tables)]
            return min((float(t[0]) for t in found if len(t)), default=time)

        waits = [time]
        if all(x is None for x in s.v_n):
            waits.append(first("dvl", "speed"))
        if s.height is None:
            waits.append(first("depth"))
        return max(t for t in waits if t < soon)


def _told(table: Table, column: str, row: int, default: float) -> float:
    value = float(table[column][row]) if column in table else math.nan
    return value if math.isfinite(value) and value > 0.0 else default


def mean_force(rows: Array, time: float, span: float) -> Array:
    """(3,) m/s^2 in b, of the rows in the `span` seconds before a time."""
    inside = (rows[:, 0] > time - span) & (rows[:, 0] <= time + 1e-9)
    if inside.sum() < 3:
        inside = np.zeros(len(rows), dtype=bool)
        inside[max(0, int(np.searchsorted(rows[:, 0], time)) - 3) :][:3] = True
    return np.asarray(rows[inside, 4:7].mean(axis=0))


def attitude_of(force: Array, accel_n: Array, heading: float) -> Array:
    """C_nb that turns a mean specific force (3,) b into accel - g (3,) n, with a heading."""
    up = np.array([0.0, 0.0, -9.80665])
    want = accel_n + up
    roll, pitch = math.atan2(-force[1], -force[2]), math.atan2(force[0], math.hypot(force[1], force[2]))
    C = np.asarray(dcm_from_euler(roll, pitch, heading))
    a, b = C @ force / np.linalg.norm(force), want / np.linalg.norm(want)
    axis = np.cross(a, b)
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    R = np.eye(3) + skew + skew @ skew / (1.0 + float(a @ b))
    return np.asarray(R @ C)


def turned(rows: Array, C_nb: Array, since: float, to: float, bias: Array | None, lat: float) -> Array:
    """C_nb carried from one time to another by the gyros alone."""
    from schuler.inertial.alignment import carried

    between = (rows[:, 0] > since + 1e-9) & (rows[:, 0] <= to + 1e-9)
    if not between.any():
        return np.asarray(C_nb)
    dt = np.diff(rows[:, 0], prepend=rows[0, 0] - 1e-3)[between]
    w = rows[between, 1:4] - (bias if bias is not None else 0.0)
    return np.asarray(carried(np.asarray(C_nb), w * dt[:, None], lat, float(dt.sum())))
