"""Where the vehicle stands, seen by its IMU: flags for each row that have seen nothing later."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WINDOW_S = 0.6
# Standing with the engine on hums more than a table and less than the calmest road.
GYRO_QUIET = 0.02  # rad/s, 1 sigma of a sample over the window
ACCEL_QUIET = 0.35  # m/s^2
TURN = 0.02  # rad/s off the bias
PUSH = 0.2  # m/s^2: moving off
APART = 1.5  # how much louder motion must be than rest, else only fixes and wheels tell standing
SLOW = 0.3  # m/s, of a fix's velocity
RESTING = 0.15  # m/s, where the ear is no witness


def _running(values: Array, n: int) -> tuple[Array, Array]:
    """Mean and standard deviation (k, 3) over the last n rows."""
    total = np.cumsum(np.vstack([np.zeros(3), values]), axis=0)
    square = np.cumsum(np.vstack([np.zeros(3), values**2]), axis=0)
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - n, 0)
    count = (last - first)[:, None]
    mean = (total[last] - total[first]) / count
    return mean, np.sqrt(np.maximum((square[last] - square[first]) / count - mean**2, 0.0))


def standing(rows: Array, fix_time: Array | None = None, fix_speed: Array | None = None) -> NDArray[np.bool_]:
    """(k,) whether the IMU rows (k, 7) look like standing: quiet over the last 0.6 s, not turning.

    fix_time, fix_speed: speeds over ground where fixes or wheels tell them. They set how quiet standing is for this
    vehicle and forbid it while they move; where rest and motion sound alike (a simulation, a smooth rail) it stands
    only while they say so.
    """
    n = len(rows)
    if n < 20:
        return np.zeros(n, dtype=bool)
    interval = float(np.median(np.diff(rows[:, 0])))
    width = max(4, round(WINDOW_S / interval))
    centred = rows[:, 1:4] - np.median(rows[:, 1:4], axis=0), rows[:, 4:7] - np.median(rows[:, 4:7], axis=0)
    mean_w, std_w = _running(centred[0], width)
    mean_f, std_f = _running(centred[1], width)
    hum = np.column_stack([np.linalg.norm(std_w, axis=1), np.linalg.norm(std_f, axis=1)])
    limits = np.array([GYRO_QUIET, ACCEL_QUIET])
    slow = np.ones(n, dtype=bool)
    heard = True  # whether standing can be told from rolling by ear
    if fix_time is not None and fix_speed is not None:
        good = np.isfinite(fix_speed)
        if good.sum() > 10:
            t, v = fix_time[good], fix_speed[good]
            after = np.searchsorted(t, rows[:, 0], side="right") - 1
            known = (after >= 0) & (rows[:, 0] - t[np.maximum(after, 0)] < 2.0)
            speed = np.where(known, v[np.maximum(after, 0)], np.nan)
            at_rest, moving = hum[speed < SLOW], hum[speed > 2.0]
            if len(at_rest) > 5 * width and len(moving) > 5 * width:
                high = np.quantile(at_rest, 0.8, axis=0)
                low = np.quantile(moving, 0.02, axis=0)
                apart = low > APART * high
                limits = np.where(
                    apart, np.minimum(np.maximum(limits, 1.2 * high), low), np.maximum(limits, 1.2 * high)
                )
                heard = bool(apart.any())
            with np.errstate(invalid="ignore"):
                if heard:
                    slow = ~(speed > SLOW)
                else:  # two slow fixes or wheel rows in a row
                    resting = (v <= RESTING) & (np.concatenate([[np.inf], v[:-1]]) <= RESTING)
                    slow = known & resting[np.maximum(after, 0)]
    quiet = (hum < limits).all(axis=1) & slow
    if quiet.any():
        bias = np.median(mean_w[quiet], axis=0)
        quiet &= np.linalg.norm(mean_w - bias, axis=1) < TURN
    quiet[:width] = False
    return _until_pushed(quiet, mean_f)


def _until_pushed(quiet: NDArray[np.bool_], force: Array) -> NDArray[np.bool_]:
    """Standing ends with the first push: mean force off that of the stretch's begin by more than PUSH."""
    begin = np.flatnonzero(quiet & ~np.concatenate([[False], quiet[:-1]]))
    if not len(begin):
        return quiet
    run = np.clip(np.searchsorted(begin, np.arange(len(quiet)), side="right") - 1, 0, None)
    pushed = quiet & (np.linalg.norm(force - force[begin[run]], axis=1) > PUSH)
    count = np.cumsum(pushed)
    return np.asarray(quiet & (count - count[begin[run]] == 0))
