"""Measurements of the aided filter, one at a time: what a driver hands to `AidedFilter.update`.

A sigma that is not given is that of the settings. All lever arms, delays and mountings are the settings' matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_rows import ATTITUDE_HZ, HEIGHT_HZ, MAG_HZ, SPEED_HZ, Events
from schuler.ground.errors import InputError

if TYPE_CHECKING:
    from schuler.aiding.aided_settings import AidedSettings
    from schuler.ground.tables import Tables

Array = NDArray[np.float64]
NAN = math.nan
Three = tuple[float, float, float]
# kind -> code of kernels.aided_measure, name of the sensor in `sensors`
CODES = {
    "position": (0, "gnss"), "velocity": (2, "gnss"), "course": (3, "gnss"), "speed": (4, "speed"), "dvl": (5, "dvl"),
    "depth": (6, "depth"), "height": (7, "height"), "attitude": (8, "attitude"), "magnetometer": (9, "magnetometer"),
    "range": (10, "ranges"),
}  # fmt: skip
KIND_OF = {code: kind for kind, (code, _) in CODES.items()}
OWN = 100  # kinds from here on are the caller's own sensors (kernels.aided_run.USER)
SLOW_POSITION = np.array([1.0, 1.0, 1.5])  # the fix's slow error: down is worse


@dataclass(frozen=True)
class Aid:
    """One measurement: kind (see `CODES`, or the name of a sensor of the caller's own), time s, the kernel's numbers.

    ready: the numbers are final, as `aids_of` makes them; otherwise the filter fills in absent sigmas, thins what comes
    too often to be independent, and takes the slow part out of a fix's sigma.
    """

    kind: str
    time: float
    z: tuple[float, ...]
    ready: bool = False

    @staticmethod
    def position(time: float, lat: float, lon: float, height: float = NAN, *, std: Three | None = None) -> Aid:
        """A fix of the antenna: rad, m (height may be left out); std north, east, down m."""
        return Aid("position", time, (lat, lon, height, *_three(std)))

    @staticmethod
    def velocity(time: float, v_n: Sequence[float], *, std: Three | None = None) -> Aid:
        """GNSS velocity over ground, NED m/s; v_n (2) or (3)."""
        down = float(v_n[2]) if len(v_n) > 2 else NAN
        return Aid("velocity", time, (float(v_n[0]), float(v_n[1]), down, *_three(std)))

    @staticmethod
    def course(time: float, course: float, speed: float, *, std_mps: float | None = None) -> Aid:
        """Direction of motion over ground, rad, at a speed m/s, where the receiver gives no velocity."""
        std = NAN if std_mps is None else std_mps / max(speed, 1.0)
        return Aid("course", time, (course, NAN, NAN, std, speed))

    @staticmethod
    def speed(time: float, speed: float, *, std: float | None = None) -> Aid:
        """Speed along the vehicle's axis, m/s, over ground, through water or air as the settings say."""
        return Aid("speed", time, (speed, NAN, NAN, _one(std)))

    @staticmethod
    def dvl(time: float, v_b: Three, *, std: float | None = None) -> Aid:
        """Bottom track in forward, right, down, m/s."""
        return Aid("dvl", time, (*v_b, _one(std), _one(std), _one(std)))

    @staticmethod
    def depth(time: float, depth: float, *, std: float | None = None) -> Aid:
        """Depth, m down."""
        return Aid("depth", time, (depth, NAN, NAN, _one(std)))

    @staticmethod
    def height(time: float, height: float, *, std: float | None = None) -> Aid:
        """Height of a barometer, m up; its zero drifts and is learnt."""
        return Aid("height", time, (height, NAN, NAN, _one(std)))

    @staticmethod
    def attitude(time: float, roll: float, pitch: float, heading: float, *, std: Three | None = None) -> Aid:
        """A vehicle's own compass or AHRS, rad from true north. std: of an independent reading a second."""
        return Aid("attitude", time, (roll, pitch, heading, *_three(std)))

    @staticmethod
    def magnetometer(time: float, field_b: Three, *, std: float | None = None) -> Aid:
        """The field in b, in any unit while no mag_bias is estimated (T then); std of its azimuth, rad."""
        return Aid("magnetometer", time, (*field_b, _one(std)))

    @staticmethod
    def range(
        time: float, range_m: float, lat: float, lon: float, height: float = NAN, *, std: float | None = None
    ) -> Aid:
        """Distance of the antenna from a known point (rad, m); without a height it is meant in the plane."""
        flat = math.isnan(height)
        return Aid("range", time, (range_m, lat, lon, 0.0 if flat else height, float(flat), _one(std)))

    @staticmethod
    def own(sensor: str, time: float, z: Sequence[float], *, std: Sequence[float] | None = None) -> Aid:
        """A reading (1 to 3 numbers) of one of the filter's `sensors`, by its name."""
        d = len(z)
        if not 1 <= d <= 3:
            raise InputError(f"sensor {sensor}: a reading has 1 to 3 numbers, not {d}")
        sigma = [NAN] * d if std is None else [float(v) for v in std]
        rest = [NAN] * (3 - d)
        return Aid(sensor, time, (*(float(v) for v in z), *rest, *sigma, *rest, float(d)))


def _one(std: float | None) -> float:
    return NAN if std is None else std


def _three(std: Three | None) -> Three:
    return (NAN, NAN, NAN) if std is None else std


# what must be finite of z, and where its sigmas stand
_VALUES = {
    "position": (2, (3, 4, 5)), "velocity": (2, (3, 4, 5)), "course": (1, (3,)), "speed": (1, (3,)),
    "dvl": (3, (3, 4, 5)), "depth": (1, (3,)), "height": (1, (3,)), "attitude": (3, (3, 4, 5)),
    "magnetometer": (3, (3,)), "range": (5, (5,)),
}  # fmt: skip


def check(aid: Aid) -> None:
    """InputError for numbers that no sensor gives."""
    many, sigmas = _VALUES.get(aid.kind, (1, ()))
    bad = not math.isfinite(aid.time) or any(not math.isfinite(v) for v in aid.z[:many])
    bad = bad or any(not (math.isnan(aid.z[i]) or 0.0 < aid.z[i] < math.inf) for i in sigmas if i < len(aid.z))
    if bad:
        raise InputError(
            f"update: a {aid.kind} measurement at {aid.time:g} s holds {aid.z}; expected finite numbers and sigmas "
            "above 0"
        )


def filled(aid: Aid, s: AidedSettings) -> tuple[float, ...]:
    """The kernel's numbers of a measurement as it came: absent sigmas from the settings, as `events_of` has them."""
    if aid.ready:
        return aid.z
    z = list(aid.z)
    wide = math.sqrt(max(1.0, s.attitude_tau * ATTITUDE_HZ / 3.0))
    usual: dict[str, tuple[float, ...]] = {
        "position": s.gnss_std, "velocity": s.gnss_velocity_std, "speed": (s.speed_std,), "dvl": (s.dvl_std,) * 3,
        "depth": (s.depth_std,), "height": (s.height_std,), "attitude": tuple(v * wide for v in s.attitude_std),
        "magnetometer": (s.mag_std,), "range": (s.range_std,),
    }  # fmt: skip
    if aid.kind == "course":
        return (z[0], NAN, NAN, s.gnss_velocity_std[0] / max(z[4], 1.0) if math.isnan(z[3]) else z[3])
    slow = s.gnss_correlated_std * SLOW_POSITION
    for k, (i, default) in enumerate(zip(_VALUES[aid.kind][1], usual[aid.kind], strict=True)):
        if math.isnan(z[i]):
            z[i] = default
        elif aid.kind == "position":
            part = min(float(slow[k]), 0.9 * z[i])
            z[i] = math.sqrt(max(z[i] ** 2 - part**2, 0.0))
    return tuple(z)


def usual_rate(kind: str, s: AidedSettings) -> float | None:
    """Rows a second beyond which a sensor tells nothing new; None: every row counts."""
    rates = {"speed": SPEED_HZ[s.speed_is], "height": HEIGHT_HZ, "attitude": ATTITUDE_HZ, "magnetometer": MAG_HZ}
    return rates.get(kind)


def aids_of(tables: Tables, settings: AidedSettings) -> list[Aid]:
    """The tables' rows as measurements in the order in which the batch filter takes them (no sightings, no lidar)."""
    from schuler.aiding.aided_rows import events_of

    return [
        Aid(KIND_OF[kind], time, tuple(z), ready=True)
        for time, kind, z in zip(*_lists(events_of(tables, settings)), strict=True)
        if kind in KIND_OF
    ]


def _lists(events: Events) -> tuple[list[float], list[int], list[list[float]]]:
    return events.time.tolist(), events.kind.tolist(), events.z.tolist()
