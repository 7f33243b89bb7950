"""Where an IMU stood still, and how much it hums: the quick figures of `check`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.units import DEG
from schuler.io.guess import blocks, norm

Array = NDArray[np.float64]

# At rest, over one second: 1 sigma of a sample and mean rate off the resting bias. An idling engine stays below, a
# rolling car does not.
GYRO_STILL = 0.015  # rad/s
ACCEL_STILL = 0.25  # m/s^2
TURN_STILL = 0.006  # rad/s
SHORTEST = 3.0  # s


@dataclass(frozen=True)
class Stretch:
    """From start to end, s."""

    start: float
    end: float

    @property
    def length(self) -> float:
        return self.end - self.start


@dataclass(frozen=True)
class Noise:
    """Random walks of x, y, z as the Allan deviation at one second tells them, and the gyro's mean at rest.

    gyro_arw rad/sqrt(s), accel_vrw m/s/sqrt(s), gyro_bias rad/s (None where the sensor is absent or never at rest).
    still : measured at rest; else it holds the vehicle's motion and vibration too and is an upper bound. seconds : of
    recording that went into it.
    """

    gyro_arw: tuple[float, float, float] | None
    accel_vrw: tuple[float, float, float] | None
    gyro_bias: tuple[float, float, float] | None
    still: bool
    seconds: float

    def as_dict(self) -> dict[str, Any]:
        def scaled(values: tuple[float, ...] | None, factor: float) -> list[float] | None:
            return None if values is None else [v * factor for v in values]

        return {
            "gyro_arw_deg_per_sqrt_h": scaled(self.gyro_arw, 60.0 / DEG),
            "accel_vrw_mps_per_sqrt_h": scaled(self.accel_vrw, 60.0),
            "gyro_bias_deg_per_s": scaled(self.gyro_bias, 1.0 / DEG),
            "at_rest": self.still,
            "seconds": self.seconds,
        }


def still_stretches(time: Array, rates: Array | None, force: Array | None) -> list[Stretch]:
    """Stretches of three seconds or more without motion. time (n,) s; rates (n, 3) rad/s or None; force m/s^2."""
    dt = float(np.median(np.diff(time)))
    size = max(4, round(1.0 / dt))
    count = len(time) // size
    if count < 2:
        return []
    calm = np.ones(count, dtype=bool)
    if rates is not None:
        parts = blocks(rates, size)
        spread = parts.std(axis=1).max(axis=1)
        calm &= spread < GYRO_STILL
        if calm.any():
            mean = parts.mean(axis=1)
            quiet = calm & (spread <= np.quantile(spread[calm], 0.3))
            calm &= norm(mean - np.median(mean[quiet], axis=0)) < TURN_STILL
    if force is not None:
        calm &= blocks(force, size).std(axis=1).max(axis=1) < ACCEL_STILL
    first, last = time[: count * size : size], time[size - 1 : count * size : size]
    calm &= last - first < 1.5 * size * dt
    out = []
    i = 0
    while i < count:
        if calm[i]:
            j = i
            while j + 1 < count and calm[j + 1] and first[j + 1] - last[j] < 1.0:
                j += 1
            if last[j] - first[i] >= SHORTEST - 1.5 * dt:
                out.append(Stretch(float(first[i]), float(last[j])))
            i = j
        i += 1
    return out


def noise_of(time: Array, rates: Array | None, force: Array | None, still: list[Stretch]) -> Noise | None:
    """Noise over the longest still stretch; over everything where there is none. None for less than 10 s."""
    dt = float(np.median(np.diff(time)))
    longest = max(still, key=lambda s: s.length, default=None)
    at_rest = longest is not None and longest.length >= 9.0
    inside = slice(None)
    if at_rest and longest is not None:
        inside = slice(int(np.searchsorted(time, longest.start)), int(np.searchsorted(time, longest.end, "right")))
    seconds = float(time[inside][-1] - time[inside][0])
    size = round(1.0 / dt)
    if seconds < 9.0 or size < 2:
        return None
    figures = [
        None if v is None else tuple(float(x) for x in allan_at(v[inside], size) * np.sqrt(size * dt))
        for v in (rates, force)
    ]
    bias = tuple(float(x) for x in rates[inside].mean(axis=0)) if rates is not None and at_rest else None
    return Noise(figures[0], figures[1], bias, at_rest, seconds)  # type: ignore[arg-type]


def allan_at(values: Array, size: int) -> Array:
    """Overlapping Allan deviation of each column at an averaging time of `size` samples. IEEE Std 952-2020, annex C."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    second = total[2 * size :] - 2.0 * total[size:-size] + total[: -2 * size]
    return np.sqrt((second**2).mean(axis=0) / 2.0) / size
