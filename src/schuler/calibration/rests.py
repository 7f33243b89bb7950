"""The still stretches of a recording, found without a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WINDOW = 0.5  # s over which something is still or not
SHORTEST = 1.0  # s
QUIET = 4.0  # times the scatter of the quietest tenth
TREMOR = 3e-3  # rad/s: a held hand; scatter below it is always quiet
SAME = np.deg2rad(0.5)  # neighbouring rests closer than this are one that was disturbed


@dataclass(frozen=True)
class Rest:
    """Rows first <= i < last. force (3,) m/s^2 and rate (3,) rad/s: means; scatter (3,): rms of an accelerometer
    row."""

    first: int
    last: int
    start: float
    end: float
    force: Array
    rate: Array
    scatter: Array
    temperature: float = float("nan")

    @property
    def length(self) -> float:
        return self.end - self.start


def moving_scatter(values: Array, window: int) -> Array:
    """(n - window + 1,) rms scatter of all columns together within each window."""
    x = values - values.mean(axis=0)
    zero = np.zeros((1, x.shape[1]))
    one, two = np.cumsum(np.vstack([zero, x]), axis=0), np.cumsum(np.vstack([zero, x * x]), axis=0)
    mean = (one[window:] - one[:-window]) / window
    variance = (two[window:] - two[:-window]) / window - mean * mean
    return np.asarray(np.sqrt(np.maximum(variance, 0.0).sum(axis=1)))


def find_rests(time: Array, force: Array, gyro: Array, temperature: Array | None = None) -> list[Rest]:
    """Where both gyros and accelerometers scatter little more than in the quietest tenth of the recording."""
    n = len(time)
    dt = float(np.median(np.diff(time)))
    window = max(int(round(WINDOW / dt)), 5)
    if n < 2 * window:
        return []
    quiet = np.ones(n - window + 1, dtype=bool)
    for values, least in ((gyro, TREMOR), (force, 1e-3)):
        scatter = moving_scatter(values, window)
        quiet &= scatter <= QUIET * max(float(np.percentile(scatter, 10)), least)
    # The mean rate of a window must agree with the usual rest: a slow even turn does not scatter.
    smooth = np.cumsum(np.vstack([np.zeros((1, 3)), gyro]), axis=0)
    mean = (smooth[window:] - smooth[:-window]) / window
    if quiet.any():
        usual = np.median(mean[quiet], axis=0)
        spread = 1.4826 * np.median(np.abs(mean[quiet] - usual), axis=0)
        quiet &= np.all(np.abs(mean - usual) < np.maximum(10.0 * spread, 0.01), axis=1)
    # A run of quiet windows is one rest: where two recordings were joined, none lies across the joint.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], quiet, [False]]).astype(int)))
    parts: list[tuple[int, int]] = []
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        parts.append((max(int(a), parts[-1][1] if parts else 0), int(b) - 1 + window))
    merged: list[tuple[int, int]] = []
    for a, b in parts:
        if merged and (a - merged[-1][1]) * dt < 1.5:
            f0, f1 = force[slice(*merged[-1])].mean(axis=0), force[a:b].mean(axis=0)
            if np.arctan2(np.linalg.norm(np.cross(f0, f1)), f0 @ f1) < SAME:
                if b - a > merged[-1][1] - merged[-1][0]:
                    merged[-1] = (a, b)
                continue
        merged.append((a, b))
    return [rest_of(time, force, gyro, a, b, temperature) for a, b in merged if (b - a) * dt >= SHORTEST]


def rest_of(time: Array, force: Array, gyro: Array, first: int, last: int, temperature: Array | None = None) -> Rest:
    """A rest from rows that are known to be still."""
    warm = float(np.nanmean(temperature[first:last])) if temperature is not None else float("nan")
    return Rest(
        first,
        last,
        float(time[first]),
        float(time[last - 1]),
        force[first:last].mean(axis=0),
        gyro[first:last].mean(axis=0),
        force[first:last].std(axis=0),
        warm,
    )
