"""Where the vehicle stands, row by row: the online counterpart of `aided_still`, which may look at a whole recording.

Quiet for 0.6 s and not turning; where speeds over ground are told, slow too. While they are not told any more, standing
must be quieter than the calmest motion that was heard.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_still import ACCEL_QUIET, APART, GYRO_QUIET, SLOW, TURN, WINDOW_S

Array = NDArray[np.float64]
TOLD_S = 2.0  # how long a speed counts
MOVING = 2.0  # m/s: this is motion
NUMBERS = 6


class Ear:
    """Running judgement; `numbers` (NUMBERS,) and `window` are all it knows, so that it can be saved."""

    def __init__(self) -> None:
        # last speed and its time; calmest motion heard (gyro, force); told at all; interval
        self.numbers = np.array([0.0, -math.inf, math.inf, math.inf, 0.0, math.nan])
        self.window = np.zeros((0, 7))
        self._full = 0

    def told(self, time: float, speed: float) -> None:
        """A speed over ground, m/s."""
        if time >= self.numbers[1]:
            self.numbers[0], self.numbers[1], self.numbers[4] = speed, time, 1.0

    def hear(self, row: Array, bias: Array) -> bool:
        """Whether the vehicle stands at this row (7,), with the gyro bias (3,) that is known."""
        n = self.numbers
        if len(self.window):
            step = float(row[0] - self.window[-1, 0])
            if step > WINDOW_S:
                self.window = self.window[:0]
            elif step > 0.0:
                n[5] = step if math.isnan(n[5]) else n[5] + 0.02 * (step - n[5])
        width = 4 if math.isnan(n[5]) else max(4, round(WINDOW_S / float(n[5])))
        self.window = np.vstack([self.window, row])[-width:]
        if len(self.window) < width:
            return False
        std = self.window[:, 1:].std(axis=0)
        gyro, force = math.sqrt(float(std[:3] @ std[:3])), math.sqrt(float(std[3:] @ std[3:]))
        fresh = row[0] - n[1] < TOLD_S
        if fresh and n[0] > MOVING:
            n[2], n[3] = min(n[2], gyro), min(n[3], force)
        if gyro > GYRO_QUIET or force > ACCEL_QUIET:
            return False
        mean = self.window[:, 1:4].mean(axis=0) - bias
        if float(mean @ mean) > TURN**2:
            return False
        if n[4] < 0.5:  # nobody tells speeds: the ear alone
            return True
        if fresh:
            return bool(n[0] <= SLOW)
        return bool(math.isfinite(n[2]) and (APART * gyro < n[2] or APART * force < n[3]))
