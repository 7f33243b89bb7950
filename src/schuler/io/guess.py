"""What unit a column without one is in: gravity, Earth rate and plain plausibility are the yardsticks.

Every guess comes with its reason, and says so when two units fit ("unsure"); readers then stop instead of choosing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schuler.ground.units import G0, to_si

Array = NDArray[np.float64]

EARTH_RATE = 7.292115e-5  # rad/s
GYRO_UNITS = ("rad/s", "deg/s", "deg/h")
ACCEL_UNITS = ("m/s^2", "g", "mg", "ft/s^2")


@dataclass(frozen=True)
class Guess:
    """unit : "" where unsure. kind : "rates" or "increments" (accelerometer only). reason : a clause, no full stop."""

    unit: str
    reason: str
    kind: str = "rates"

    @property
    def sure(self) -> bool:
        return bool(self.unit)


def norm(vectors: Array) -> Array:
    """Length of each row of an (n, 3) array."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def blocks(values: Array, size: int) -> Array:
    """(n, k) samples as (n // size, size, k), the rest left out."""
    count = len(values) // size
    return values[: count * size].reshape(count, size, *values.shape[1:])


def guess_accel(accel: Array, dt: float | None) -> Guess:
    """Unit and kind of an accelerometer triple from the length it has most of the time: near g, or g*dt.

    accel (n, 3) as in the file; dt median step in s, None where there is no time.
    """
    size = float(np.median(norm(accel)))
    fits = [(u, "rates") for u in ACCEL_UNITS if 0.8 < to_si(size, u) / G0 < 1.25]
    if dt:
        fits += [(u, "increments") for u in ("m/s", "ft/s") if 0.85 < to_si(size, u) / (G0 * dt) < 1.18]
    if len(fits) == 1:
        unit, kind = fits[0]
        what = "gravity" if kind == "rates" else f"gravity times the step of {dt:.4g} s"
        return Guess(unit, f"the median length {size:.4g} is {what}", kind)
    if fits:
        both = " and ".join(f"{kind} in {unit}" for unit, kind in fits)
        return Guess("", f"the median length {size:.4g} fits {both}")
    if size < 2.0:
        return Guess(
            "", f"the median length {size:.4g} is far from gravity in any unit (gravity may have been removed)"
        )
    return Guess("", f"the median length {size:.4g} is not gravity in m/s^2, g or mg (raw counts, perhaps)")


def turning_of_gravity(gyro: Array, accel: Array, dt: float) -> list[tuple[float, float, float]]:
    """How the change of the accelerometer triple follows the gyro's turning: (factor, correlation, chance).

    In a body that turns, gravity's share of f changes by -w x f dt. Means over 0.1 to 3 s are regressed; the factor is
    1 for rad/s, pi/180 for deg/s; chance is 1 sigma of the correlation of unrelated noise. Accelerations that keep step
    with the turning (an aircraft in a coordinated turn) hide it, so a small correlation says nothing.
    """
    found = []
    for tau in (0.1, 0.3, 1.0, 3.0):
        size = max(1, round(tau / dt))
        f, w = blocks(accel, size).mean(axis=1), blocks(gyro, size).mean(axis=1)
        if len(f) < 12:
            continue
        w = w - np.median(w, axis=0)
        change = np.diff(f, axis=0)
        turn = -np.cross(0.5 * (w[1:] + w[:-1]), 0.5 * (f[1:] + f[:-1])) * size * dt
        xx, xy, yy = (float(np.sum(p)) for p in (turn * turn, turn * change, change * change))
        if xx > 0 and yy > 0:
            found.append((xy / xx, xy / np.sqrt(xx * yy), 1.0 / np.sqrt(turn.size)))
    return found


def quietest(values: Array, dt: float, seconds: float = 1.0) -> tuple[float, float]:
    """(noise, mean length) of the quietest tenth of one-second stretches; noise is 1 sigma of a sample, per axis."""
    size = min(max(8, round(seconds / dt)), max(len(values), 1))
    parts = blocks(values, size)
    if not len(parts):
        return np.inf, np.inf
    noise = np.sqrt((np.diff(parts, axis=1) ** 2).mean(axis=(1, 2)) / 2.0)
    quiet = noise <= np.quantile(noise, 0.1)
    return float(np.median(noise[quiet])), float(np.median(norm(parts[quiet].mean(axis=1))))


def guess_gyro(gyro: Array, accel: Array | None, dt: float | None) -> Guess:
    """Unit of a gyro triple. gyro (n, 3) rates as in the file, accel (n, 3) m/s^2 or None, dt s (None: no time).

    In turn: a rate that no gyro reaches; gravity turning in the accelerometer; Earth rate or noise while still; a
    vehicle that accelerates hard and can hardly be turning at a few degrees a second.
    """
    rate = norm(gyro)
    fast = float(np.quantile(rate, 0.999))
    if fast == 0.0:
        return Guess("rad/s", "all gyro values are zero")
    if fast > 50.0:
        if fast < 5000.0:
            return Guess("deg/s", f"the largest, {fast:.4g}, would be {np.rad2deg(fast):.0f} deg/s as rad/s")
        return Guess("", f"the largest is {fast:.4g} (raw counts, or deg/h)")
    if dt and accel is not None:
        votes = []
        for factor, correlation, chance in turning_of_gravity(gyro, accel, dt):
            for unit in GYRO_UNITS[:2]:
                ratio = factor / to_si(1.0, unit)
                if 0.4 < ratio < 2.5 and correlation > max(0.15, 2.0 * chance):
                    votes.append((correlation, unit, ratio))
        if votes and len({unit for _, unit, _ in votes}) == 1:
            correlation, unit, ratio = max(votes)
            return Guess(
                unit,
                f"gravity turns in the accelerometer {ratio:.2f} times as the gyro says (correlation "
                f"{correlation:.2f})",
            )
    gyro_noise, gyro_rest = quietest(gyro, dt or 0.01)
    accel_noise = quietest(accel, dt or 0.01)[0] if accel is not None else np.inf
    if gyro_noise >= 0.02 and accel_noise < 0.3:
        as_deg = np.rad2deg(gyro_noise)
        return Guess("deg/s", f"the noise at rest, {gyro_noise:.3g}, would be {as_deg:.2g} deg/s as rad/s")
    if gyro_noise < 0.012 and 0.01 < accel_noise < 0.3:
        return Guess(
            "rad/s",
            f"the noise at rest, {gyro_noise:.2g}, suits the accelerometer's {accel_noise:.2g} m/s^2 only as rad/s",
        )
    if accel_noise <= 0.01:
        earth = [u for u in GYRO_UNITS if 0.7 < to_si(gyro_rest, u) / EARTH_RATE < 1.3]
        if len(earth) == 1:
            return Guess(earth[0], f"the mean at rest, {gyro_rest:.3g}, is Earth rate")
    swing = 0.0
    if accel is not None and len(means := blocks(accel, max(1, round(0.5 / (dt or 0.01)))).mean(axis=1)):
        swing = float(np.quantile(np.abs(norm(means) - np.median(norm(means))), 0.99))
    if swing > 2.0 and fast < 4.0:
        return Guess(
            "rad/s",
            f"|f| swings by {swing:.2g} m/s^2, and as deg/s nothing would ever turn faster than {fast:.2g} deg/s",
        )
    median = float(np.median(rate))
    return Guess(
        "",
        f"the median size {median:.3g} and the largest {fast:.3g} could be rad/s ({np.rad2deg(median):.3g} and "
        f"{np.rad2deg(fast):.3g} deg/s) as well as deg/s",
    )


def gyro_contradiction(gyro: Array, accel: Array, dt: float | None, unit: str = "rad/s") -> Guess | None:
    """Strong evidence that rates are in another unit than they are said to be; None where there is none.

    gyro (n, 3) rad/s, made from the file's numbers with `unit`; accel (n, 3) m/s^2; dt s.
    """
    fast = float(np.quantile(norm(gyro), 0.999))
    if fast > 50.0 and unit != "deg/s":
        return Guess("deg/s", f"the largest is {fast:.4g} rad/s = {np.rad2deg(fast):.0f} deg/s")
    if not dt:
        return None
    for factor, correlation, chance in turning_of_gravity(gyro, accel, dt):
        for other in GYRO_UNITS:
            ratio = factor * to_si(1.0, unit) / to_si(1.0, other)
            if other != unit and 0.5 < ratio < 2.0 and correlation > max(0.3, 4.0 * chance):
                return Guess(
                    other,
                    f"gravity turns in the accelerometer {ratio:.2f} times as the gyro says in {other} "
                    f"(correlation {correlation:.2f})",
                )
    return None


def guess_time(time: Array, table: str) -> Guess:
    """Unit of a time column from an epoch it can be read as (Unix in s, ms, us, ns), else from an IMU's usual rates."""
    finite = time[np.isfinite(time)]
    steps = np.diff(finite)
    steps = steps[steps > 0]
    if not len(steps):
        return Guess("s", "one row only")
    last, step = float(np.max(np.abs(finite))), float(np.median(steps))
    for unit, low in (("s", 1e9), ("ms", 1e12), ("us", 1e15), ("ns", 1e18)):
        if 0.6 * low < last < 3.0 * low and step / (low / 1e9) < 1e5:
            return Guess(unit, f"{last:.0f} is a Unix time in {unit}")
    if table == "imu":
        for unit, low, high in (("s", 2e-4, 0.21), ("ms", 0.21, 210.0), ("us", 210.0, 2.1e5), ("ns", 2.1e5, 2.1e8)):
            if low <= step < high:
                rate = 1.0 / to_si(step, unit)
                return Guess(unit, f"a step of {step:.4g} {unit} is {rate:.4g} Hz")
        return Guess("", f"a step of {step:.4g} is no usual IMU rate in s, ms, us or ns")
    steady = float(np.quantile(np.abs(steps - step), 0.8)) < 0.1 * step
    if step >= 1e4 and steady:
        unit = "ns" if step >= 5e6 else "us" if step >= 5e3 * 2 else "ms"
        return Guess(unit, f"a steady step of {step:.4g}")
    if 40.0 <= step <= 1000.0 and steady and len(finite) >= 50 and bool(np.all(finite == np.round(finite))):
        return Guess("", f"a steady step of {step:.4g} can be seconds as well as milliseconds")
    return Guess("s", f"a median step of {step:.4g} s")


def guess_place(lat: Array, lon: Array) -> Guess:
    """Degrees or radians for a latitude and longitude."""
    with np.errstate(invalid="ignore"):
        a, o = float(np.nanmax(np.abs(lat))), float(np.nanmax(np.abs(lon)))
    if a > 1e6 or o > 1e6:
        if a <= 9e8 and o <= 3.6e9:
            return Guess("1e-7 deg", "they are integers of ten millionths of a degree")
        return Guess("", f"lat reaches {a:.6g} and lon {o:.6g}")
    if a > 90.0 or o > 360.0:
        return Guess("", f"lat reaches {a:.6g} and lon {o:.6g}; ddmm.mmmm, perhaps")
    if a > np.pi / 2 or o > np.pi:
        return Guess("deg", f"lat reaches {a:.6g} and lon {o:.6g}")
    return Guess("", f"lat reaches {a:.6g} and lon {o:.6g}, which can be degrees as well as radians")


def guess_angles(angles: dict[str, Array]) -> Guess:
    """Degrees or radians for roll, pitch and heading together."""
    most = {k: float(np.nanmax(np.abs(v))) for k, v in angles.items() if np.isfinite(v).any()}
    if not most:
        return Guess("deg", "no values")
    name, size = max(most.items(), key=lambda item: item[1])
    if size > 2 * np.pi + 0.01:
        return Guess("deg", f"{name} reaches {size:.4g}")
    span = max(float(np.nanmax(v) - np.nanmin(v)) for v in angles.values() if np.isfinite(v).any())
    if span > 3.0:
        return Guess("rad", f"{name} goes around and never passes {size:.4g}")
    return Guess("", f"no angle is larger than {size:.4g}, which can be degrees as well as radians")


def guess_field(mag: Array) -> Guess:
    """Unit of a magnetometer triple from the Earth's field, 22 to 67 uT."""
    size = float(np.nanmedian(norm(mag)))
    for unit in ("uT", "gauss", "mgauss", "nT"):
        if 20e-6 < to_si(size, unit) < 80e-6:
            return Guess(unit, f"the median length {size:.4g} is the Earth's field")
    return Guess("", f"the median length {size:.4g} is not the Earth's field in uT, gauss or nT")
