"""How late the fixes are stamped: against the IMU, from turns; and the receiver's velocity against its position."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84, wrap_pi
from schuler.ground.tables import Table

Array = NDArray[np.float64]
STEP = 0.02  # s, of the lags tried


def stamp_lag(rows: Array, gnss: Table | None, nose: bool = False) -> tuple[float, float] | None:
    """(lag, 1 sigma) s of the fixes' stamps behind the IMU's, from turns: heading by gyros against the course.

    nose: the vehicle goes where its x axis points; then its speeding up and braking tell too.

    Positive: a fix stamped t belongs to t - lag. None where there is too little turning at speed to tell.
    """
    if gnss is None or "v_north" not in gnss or len(gnss) < 20:
        return None
    v = np.column_stack([gnss["v_north"], gnss["v_east"]])
    speed = np.hypot(v[:, 0], v[:, 1])
    with np.errstate(invalid="ignore"):
        fast = np.isfinite(speed) & (speed > 4.0)
    if fast.sum() < 20:
        return None
    t, dt = rows[:, 0], np.diff(rows[:, 0], prepend=rows[0, 0])
    width = max(1, round(2.0 / float(np.median(dt[1:]))))
    total = np.cumsum(np.vstack([np.zeros(3), rows[:, 4:7]]), axis=0)
    last = np.arange(1, len(rows) + 1)
    first = np.maximum(last - width, 0)
    mean = (total[last] - total[first]) / (last - first)[:, None]
    down = -mean / np.linalg.norm(mean, axis=1, keepdims=True)
    yaw = np.cumsum((rows[:, 1:4] * down).sum(axis=1) * dt)
    turns = _lag(t, yaw, gnss.time[fast], np.arctan2(v[fast, 1], v[fast, 0]), 0.3)
    if not nose:
        return turns
    moving = np.isfinite(speed) & (speed > 1.0)
    push = _lag(t, np.cumsum(rows[:, 4] * dt), gnss.time[moving], speed[moving], 1.5)
    if turns is None or (push is not None and push[1] < turns[1]):
        return push
    return turns


def _lag(t: Array, yaw: Array, when: Array, course: Array, most: float) -> tuple[float, float] | None:
    """Least squares of the changes of course (or speed) between fixes against those of the IMU's integral, by lag.

    most: residuals count at most so much.
    """
    i = np.arange(len(when) - 1)
    step = np.diff(when)
    good = (step > 0.05) & (step < 1.6) & (when[:-1] > t[0] + 1.5) & (when[1:] < t[-1] - 1.5)
    i = i[good]
    if len(i) < 20:
        return None
    dc = wrap_pi(course[i + 1] - course[i]) / step[i]  # a speed changes by less than pi too
    lags = np.arange(-0.6, 1.2001, STEP)
    loss = np.empty(len(lags))
    for k, lag in enumerate(lags):
        dy = (np.interp(when[i + 1] - lag, t, yaw) - np.interp(when[i] - lag, t, yaw)) / step[i]
        e = dc - dy
        e = e - _slow(e, when[i])
        loss[k] = float(np.mean(np.minimum(np.abs(e), most) ** 2))
    rate = 1.0 / float(np.median(step[i]))
    # neighbouring courses err together
    found = _best(lags, loss, len(i) / max(1.0, rate))
    # where no lag explains the changes much better than another, the least of noise is no lag
    return found if loss.max() > 1.5 * loss.min() else None


def _slow(e: Array, when: Array) -> Array:
    """The slow part of residuals: bias, and gravity's share of a slope; means over eight seconds."""
    width = max(3, round(8.0 / max(float(np.median(np.diff(when))), 1e-3)))
    if len(e) < 2 * width:
        return np.full(len(e), np.median(e))
    total = np.concatenate([[0.0], np.cumsum(e)])
    at = np.arange(len(e))
    lo, hi = np.maximum(at - width // 2, 0), np.minimum(at + width // 2 + 1, len(e))
    return np.asarray((total[hi] - total[lo]) / (hi - lo))


def _best(lags: Array, loss: Array, count: float) -> tuple[float, float] | None:
    """Where a loss (mean square of `count` independent residuals) is least, with its sigma; None at an end."""
    best = int(np.argmin(loss))
    if best in (0, len(lags) - 1):
        return None
    a, b, c = loss[best - 1], loss[best], loss[best + 1]
    curve = (a - 2.0 * b + c) / STEP**2
    if curve <= 0.0 or count < 10.0:
        return None
    return float(lags[best] + 0.5 * (a - c) / (curve * STEP)), float(math.sqrt(2.0 * b / (count * curve)))


def velocity_lag(gnss: Table) -> tuple[float, float] | None:
    """(lag, 1 sigma) s of the receiver's velocity behind its position: its velocity against the way between fixes."""
    if "v_north" not in gnss or len(gnss) < 40:
        return None
    good = np.isfinite(gnss["lat"]) & np.isfinite(gnss["v_north"]) & np.isfinite(gnss["v_east"])
    g = gnss.where(good)
    t = g.time
    zero = np.zeros(max(len(t) - 1, 0))
    way = WGS84.displacement_n(g["lat"][1:], g["lon"][1:], zero, g["lat"][:-1], g["lon"][:-1], zero)[:, :2]
    dt = np.diff(t)
    usual = float(np.median(dt))
    keep = (dt < 1.5 * usual) & (usual < 1.5)
    if keep.sum() < 40:
        return None
    mean = (way / dt[:, None])[keep]
    v = np.column_stack([g["v_north"], g["v_east"]])
    # the mean velocity of an interval from its trapezoid, at every lag
    lags = np.arange(-0.6, 0.6001, STEP)
    loss = np.empty(len(lags))
    area = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (v[1:] + v[:-1]) * dt[:, None], axis=0)])
    for k, lag in enumerate(lags):
        a = np.column_stack([np.interp(t[:-1][keep] + lag, t, area[:, i]) for i in range(2)])
        b = np.column_stack([np.interp(t[1:][keep] + lag, t, area[:, i]) for i in range(2)])
        e = np.linalg.norm((b - a) / dt[keep][:, None] - mean, axis=1)
        loss[k] = float(np.mean(np.minimum(e, 1.0) ** 2))
    found = _best(lags, loss, keep.sum() * usual)
    return found if found is not None and loss.max() > 2.0 * loss.min() else None
