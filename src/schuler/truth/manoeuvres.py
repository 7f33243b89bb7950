"""Lively trajectories: a car with stops, turns and slopes, and an aircraft with turns, climbs and speed changes.

A constant speed leaves heading and the scale errors unseen; these do not. Exact like the others of `trajectories`.
"""

from __future__ import annotations

import math

from schuler.ground.earth import WGS84, Ellipsoid
from schuler.ground.errors import InputError
from schuler.truth.trajectories import CLIMB, COURSE, SPEED, Trajectory, _build, _profiles

PEAK = 2.1875  # peak slope of the smooth step, times change over length
GOLDEN = 0.6180339887498949
LEAN = -80.0  # m/s^2: a car leans outwards by atan(a / 80 m/s^2), 2 deg in a turn of 0.3 g


class _Dice:
    """Numbers that look irregular and are always the same: a golden-ratio sequence from `variety`."""

    def __init__(self, variety: int) -> None:
        self.k = 17 * variety

    def between(self, low: float, high: float) -> float:
        self.k += 1
        return low + (high - low) * math.modf(0.37 + self.k * GOLDEN)[0]

    def sign(self) -> float:
        return 1.0 if self.between(0.0, 1.0) < 0.5 else -1.0


def car(
    lat: float, lon: float, height: float = 0.0, *, speed: float = 15.0, heading: float = 0.0, stand: float = 30.0,
    duration: float = 1800.0, variety: int = 0, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """A drive through a town: stands `stand` s, then blocks of accelerating, a slope or a bend, braking, a turn of up
    to 110 deg, and after every third block a stop of 5 to 15 s.

    speed : of the straights, m/s, changed by up to 30 %. Accelerations stay below 2.5 m/s^2 along and 3.5 across. The
    nose follows the path, so that a point at the IMU never slips sideways. variety : another drive of the same kind.
    """
    from schuler.kernels import motion

    if not speed > 0.0:
        raise InputError(f"a drive of speed_mps = {speed:g} goes nowhere: type speed_mps = 15.0")
    p, dice = _profiles(0.0, heading), _Dice(variety)
    t, v, block = stand, 0.0, 0

    def change(to: float, most: float) -> None:
        nonlocal t, v
        length = max(PEAK * abs(to - v) / most, 2.0)
        p[SPEED].step(t, length, to - v)
        t, v = t + length, to

    def turn(angle: float, across: float) -> None:
        nonlocal t
        length = max(PEAK * abs(angle) * v / across, 3.0)
        p[COURSE].step(t, length, angle)
        t += length

    while t < duration:
        block += 1
        change(speed * dice.between(0.7, 1.3), 2.0)
        t += dice.between(2.0, 6.0)
        if block % 2:
            length = dice.between(10.0, 20.0)
            p[CLIMB].bump(t, length, dice.sign() * dice.between(0.005, 0.03) * v * length)
            t += length
        else:
            turn(dice.sign() * dice.between(0.15, 0.6), 2.5)
        t += dice.between(2.0, 8.0)
        if block % 3 == 0:
            change(0.0, 2.5)
            t += dice.between(5.0, 15.0)
            change(0.4 * speed, 2.0)
        else:
            change(speed * dice.between(0.35, 0.5), 2.5)
        turn(dice.sign() * dice.between(0.7, 1.9), 3.5)
    made = _build("car", duration, lat, lon, height, earth, p, follow=True)
    made.par[motion.BANK_G] = LEAN
    return made


def flight(
    lat: float, lon: float, height: float = 0.0, *, speed: float = 60.0, heading: float = 0.0, stand: float = 0.0,
    duration: float = 1800.0, variety: int = 0, earth: Ellipsoid = WGS84,
) -> Trajectory:  # fmt: skip
    """An aircraft: coordinated turns of 40 to 200 deg, climbs and descents, speed changes of up to 20 %.

    stand : 0: begins in the air at `speed`; else it stands so long, takes off and climbs 300 m first. Bank stays below
    35 deg, climbs below 6 % of the speed. variety : another flight of the same kind.
    """
    if not speed > 5.0:
        raise InputError(f"a flight of speed_mps = {speed:g} would fall: type speed_mps = 60.0")
    p, dice = _profiles(0.0 if stand > 0.0 else speed, heading), _Dice(variety)
    t, v, up = stand, 0.0 if stand > 0.0 else speed, 0.0

    def change(to: float, most: float) -> None:
        nonlocal t, v
        length = max(PEAK * abs(to - v) / most, 5.0)
        p[SPEED].step(t, length, to - v)
        t, v = t + length, to

    def climb(by: float) -> None:
        nonlocal t, up
        length = max(PEAK * abs(by) / (0.06 * v), 5.0)
        p[CLIMB].bump(t, length, by)
        t, up = t + length, up + by

    if stand > 0.0:
        change(speed, 2.5)
        t += 5.0
        climb(300.0)
    while t < duration:
        t += dice.between(5.0, 25.0)
        bank = dice.between(0.3, 0.6)
        angle = dice.sign() * dice.between(0.7, 3.5)
        length = max(PEAK * abs(angle) * v / (9.8 * math.tan(bank)), 5.0)
        p[COURSE].step(t, length, angle)
        t += length + dice.between(3.0, 10.0)
        if dice.between(0.0, 1.0) < 0.6:
            climb(-up if abs(up) > 500.0 else dice.sign() * dice.between(30.0, 200.0))
        t += dice.between(2.0, 8.0)
        if dice.between(0.0, 1.0) < 0.6:
            change(speed * dice.between(0.8, 1.2), 1.0)
    return _build("flight", duration, lat, lon, height, earth, p, follow=True)
