"""An imu table made ready for integration: increments over known intervals, faults named or refused.

What is refused gets one sentence with what to type; what is repaired is said in `notes`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_quat
from schuler.ground.tables import Table

if TYPE_CHECKING:
    from schuler.inertial.strapdown import Start

Array = NDArray[np.float64]
G = 9.80665
_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Ready:
    """time (n,) s, ends of the intervals dt (n,) s; dtheta (n, 3) rad; dv (n, 3) m/s; notes."""

    time: Array
    dt: Array
    dtheta: Array
    dv: Array
    notes: list[str] = field(default_factory=list)

    def head(self, n: int) -> Ready:
        return Ready(self.time[:n], self.dt[:n], self.dtheta[:n], self.dv[:n], self.notes)


def prepare(imu: Table, start: Start | None = None, *, check_axes: bool = True) -> Ready:
    """Checks an imu table and brings it to increments.

    Refused: values that are not numbers, time running backwards, increments where rates are expected and the other way
    round, gravity on another axis than the start's attitude says. Repaired and noted: repeated rows (dropped), missing
    rows (bridged by the mean of the neighbours), changes of rate. Noted: saturation.
    """
    kind = imu.kind or ("increments" if "dtheta_x" in imu else "rates")
    names = ("dtheta", "dv") if kind == "increments" else ("gyro", "accel")
    missing = [f"{n}_{a}" for n in names for a in _AXES if f"{n}_{a}" not in imu]
    if missing:
        raise InputError(f"the imu table lacks {', '.join(missing)}; it was read as {kind}")
    time = np.asarray(imu.time, dtype=np.float64)
    w, f = (imu.stack(*(f"{n}_{a}" for a in _AXES)) for n in names)
    notes: list[str] = []
    if start is not None:
        after = time > start.time + 1e-9  # a row at the start's own time covers what lies before it
        if not after.any():
            raise InputError(f"the start at {start.time:g} s lies after the last IMU row at {time[-1]:g} s")
        time, w, f = time[after], w[after], f[after]
    if time.size < 2:
        raise InputError("the imu table holds fewer than two rows after the start")
    bad = ~(np.isfinite(time) & np.isfinite(w).all(axis=1) & np.isfinite(f).all(axis=1))
    if bad.any():
        raise InputError(
            f"imu row {int(np.argmax(bad)) + 1} holds a value that is not a number ({int(bad.sum())} rows in all): "
            "remove these rows, the gaps are then bridged"
        )
    time, w, f = _without_repeats(time, w, f, notes)
    gaps = np.diff(time)
    usual = float(np.median(gaps))
    first = usual
    if start is not None and 1e-9 < time[0] - start.time < 1.5 * usual:
        first = time[0] - start.time
    dt = np.concatenate([[first], gaps])
    if kind == "rates":
        dtheta, dv = w * dt[:, None], f * dt[:, None]
    else:
        dtheta, dv = w.copy(), f.copy()
    _units(kind, f, usual)
    long = dt > 1.5 * usual
    changed = _rate_change(dt, usual)
    if changed is not None:
        notes.append(
            f"the IMU rate changes at {time[changed]:.3f} s, from {1 / np.median(dt[1:changed]):.4g} to "
            f"{1 / np.median(dt[changed:]):.4g} Hz; each row is taken over its own interval"
        )
    elif long.any():
        _bridge(kind, long, dt, usual, dtheta, dv)
        k = int(np.argmax(dt))
        notes.append(
            f"{int(long.sum())} gaps in the IMU rows, {dt[long].sum():.3f} s together, the longest {dt[k]:.3f} s "
            f"before {time[k]:.3f} s: bridged with the mean of the rows on both sides"
        )
    _saturation(w, f, kind, usual, notes)
    if start is not None and check_axes:
        _axes(start, dtheta, dv, dt)
    return Ready(time, dt, dtheta, dv, notes)


def _without_repeats(time: Array, w: Array, f: Array, notes: list[str]) -> tuple[Array, Array, Array]:
    step = np.diff(time)
    if np.any(step < 0.0):
        row = int(np.argmax(step < 0.0)) + 2
        raise InputError(f"the IMU time runs backwards at row {row}: sort the file, or split it there")
    same = np.concatenate([[False], step == 0.0])
    if same.any():
        notes.append(f"{int(same.sum())} IMU rows repeat the time of the row before and were dropped")
        time, w, f = time[~same], w[~same], f[~same]
    return time, w, f


def _units(kind: str, f: Array, dt: float) -> None:
    size = float(np.median(np.linalg.norm(f, axis=1)))
    if kind == "rates" and 0.3 * G * dt < size < 3.0 * G * dt and dt < 0.1:
        raise InputError(
            f"the accelerometer columns have a size of {size:.4g}, which is gravity times the interval of {dt:.4g} s: "
            "these are increments given as rates; name the columns dv_x[m/s] and dtheta_x[rad]"
        )
    if kind == "increments" and dt < 0.1 and 0.3 * G < size < 3.0 * G:
        raise InputError(
            f"the dv columns have a size of {size:.4g}, which is gravity itself and not gravity times {dt:.4g} s: "
            "these are rates given as increments; name the columns accel_x[m/s^2] and gyro_x[rad/s]"
        )


def _rate_change(dt: Array, usual: float) -> int | None:
    """Row from which the rate is another one for good, if the file has two rates."""
    if dt.size < 40:
        return None
    other = np.abs(dt[1:] - usual) > 0.2 * usual
    if other.mean() < 0.02:
        return None
    k = int(np.argmax(other != other[0])) + 1
    rest = dt[k:]
    if (
        rest.size > 10
        and k > 10
        and np.ptp(rest) < 0.2 * np.median(rest)
        and np.ptp(dt[1:k]) < 0.2 * np.median(dt[1:k])
    ):
        return k
    return None


def _bridge(kind: str, long: NDArray[np.bool_], dt: Array, usual: float, dtheta: Array, dv: Array) -> None:
    """A row after a gap stands for the whole gap: its rate is the mean of the rows on both sides."""
    for k in np.flatnonzero(long):
        for x in (dtheta, dv):
            here = x[k] / (dt[k] if kind == "rates" else usual)
            before = x[k - 1] / dt[k - 1] if k else here
            x[k] = 0.5 * (here + before) * (dt[k] - usual) + here * usual


def _saturation(w: Array, f: Array, kind: str, dt: float, notes: list[str]) -> None:
    for name, x in (("gyro", w), ("accel", f)):
        for i, axis in enumerate(_AXES):
            top = np.max(np.abs(x[:, i]))
            if top < (0.5 if name == "gyro" else 5.0) * (1.0 if kind == "rates" else dt):
                continue
            at = np.abs(x[:, i]) == top
            run = int(np.max(np.convolve(at, np.ones(3), mode="valid"))) if at.size >= 3 else 0
            if run == 3 and np.ptp(x[:, i]) > 0.0:
                limit, unit = top / (1.0 if kind == "rates" else dt), "rad/s" if name == "gyro" else "m/s^2"
                notes.append(
                    f"{name}_{axis} stays at its largest value, {limit:.4g} {unit}, for {int(at.sum())} rows: "
                    "saturated there, the track after it is not to be trusted"
                )


def _axes(start: Start, dtheta: Array, dv: Array, dt: Array) -> None:
    """Refuses a recording whose gravity sits on another axis than the attitude of the start says, at a quiet start."""
    n = max(2, int(min(1.0, dt.sum()) / np.median(dt)))
    f = dv[:n].sum(axis=0) / dt[:n].sum()
    w = np.linalg.norm(dtheta[:n].sum(axis=0)) / dt[:n].sum()
    size = float(np.linalg.norm(f))
    if not (0.8 * G < size < 1.2 * G) or w > 0.2:
        return
    expected = dcm_from_quat(start.q_nb)[2] * -1.0  # specific force at rest, in b: minus down
    if float(f @ expected) / size > 0.5:
        return
    k = int(np.argmax(np.abs(f)))
    axis = f"{'+' if f[k] > 0 else '-'}{_AXES[k]}"
    e = int(np.argmax(np.abs(expected)))
    wanted = f"{'+' if expected[e] > 0 else '-'}{_AXES[e]}"
    hint = "flip y and z (forward-left-up to forward-right-down)" if axis == "+z" else "turn the axes"
    raise InputError(
        f"gravity sits on {axis} of the IMU but the start's attitude puts it on {wanted} (body is forward-right-down, "
        f"a level IMU reads -g on z): {hint}, e.g. [mounting] imu_to_body_rpy_deg = [180, 0, 0]"
    )
