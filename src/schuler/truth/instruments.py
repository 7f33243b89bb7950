"""Instruments as their datasheets describe them: the datasheet's unit is in the field's name, properties are SI.

measured = (I + M) true + bias + noise, with M the scale on its diagonal and the misalignment off it. Every bias, scale
and misalignment is one standard deviation of a draw per run, per axis; a field may be one number or one per axis.
`published` names the fields whose figure its maker (or the AUV paper) prints; all others are assumed, and `describe()`
says which is which.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from schuler.ground import units
from schuler.ground.errors import StudyError

Array = NDArray[np.float64]
PerAxis = float | tuple[float, float, float]
Arm = tuple[float, float, float]


def axes(value: PerAxis) -> Array:
    """(3,) from one number or three."""
    return np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)).copy()


class Instrument:
    """What all instruments share: a name, the published fields, `describe()`."""

    name: str
    published: frozenset[str]

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        """(field, SI value, what one sample sees); each instrument has its own."""
        return []

    def describe(self, rate_hz: float | None = None) -> str:
        """The datasheet's figures, in SI and per sample at rate_hz; each marked published or assumed."""
        rate = float(rate_hz if rate_hz is not None else getattr(self, "rate_hz", 100.0))
        lines = [f"{self.name} at {rate:g} Hz"]
        for name, si, sample in self._lines(rate):
            value = getattr(self, name)
            if not np.any(np.asarray(value, dtype=float)):
                continue
            text = f"{value:g}" if isinstance(value, int | float) else "[" + ", ".join(f"{x:g}" for x in value) + "]"
            mark = "published" if name in self.published else "assumed"
            lines.append(f"  {name} = {text} -> {si}{'; ' + sample if sample else ''} ({mark})")
        return "\n".join(lines)


def _si(value: Array, unit: str) -> str:
    same = bool(np.all(value == value[0]))
    text = f"{value[0]:.4g}" if same else "[" + ", ".join(f"{x:.4g}" for x in value) + "]"
    return f"{text} {unit}"


@dataclass(frozen=True)
class ImuModel(Instrument):
    """Three gyros and three accelerometers. Fields are the keys of a study's `[imu]` section.

    bias : turn-on, drawn once; offset : fixed, added to it (a study's `[errors]`).
    instability : stationary sigma of a first-order Gauss-Markov process with time constant tau, started from its
        stationary distribution (the Allan floor divided by 0.664 is near it). rrw : rate random walk, from zero.
    arw, vrw : after t the integrated noise has sigma arw sqrt(t); deg/sqrt(h) is deg/s/sqrt(Hz) times 60.
    quantisation : of the angle or velocity increment, its remainder carried on. range : clips. bandwidth_hz : first
        order. accel_*_lever_mm : place of each accelerometer in IMU axes (size effect).
    """

    name: str = "imu"
    gyro_arw_deg_per_sqrt_h: PerAxis = 0.0
    gyro_bias_deg_per_h: PerAxis = 0.0
    gyro_offset_deg_per_h: PerAxis = 0.0
    gyro_instability_deg_per_h: PerAxis = 0.0
    gyro_tau_s: float = 1000.0
    gyro_rrw_deg_per_h_per_sqrt_h: PerAxis = 0.0
    gyro_scale_ppm: PerAxis = 0.0
    gyro_misalignment_mrad: float = 0.0
    gyro_g_sensitivity_deg_per_h_per_g: float = 0.0
    gyro_quantisation_arcsec: float = 0.0
    gyro_range_deg_per_s: float = 0.0
    accel_vrw_mps_per_sqrt_h: PerAxis = 0.0
    accel_bias_ug: PerAxis = 0.0
    accel_offset_ug: PerAxis = 0.0
    accel_instability_ug: PerAxis = 0.0
    accel_tau_s: float = 1000.0
    accel_rrw_ug_per_sqrt_h: PerAxis = 0.0
    accel_scale_ppm: PerAxis = 0.0
    accel_misalignment_mrad: float = 0.0
    accel_quantisation_mps: float = 0.0
    accel_range_g: float = 0.0
    bandwidth_hz: float = 0.0
    accel_x_lever_mm: Arm = (0.0, 0.0, 0.0)
    accel_y_lever_mm: Arm = (0.0, 0.0, 0.0)
    accel_z_lever_mm: Arm = (0.0, 0.0, 0.0)
    published: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        faults = []
        for f in fields(self):
            if f.name in ("name", "published"):
                continue
            value = getattr(self, f.name)
            try:
                numbers = np.asarray(value, dtype=np.float64)
            except (TypeError, ValueError):
                numbers = np.array(np.nan)
            one_or_three = numbers.shape == (3,) or (numbers.shape == () and "lever" not in f.name)
            if not one_or_three or not np.all(np.isfinite(numbers)):
                faults.append(f"[imu] {f.name} = {value!r} must be a finite number or a list of three")
            elif np.any(numbers < 0.0) and "offset" not in f.name and "lever" not in f.name:
                faults.append(f"[imu] {f.name} = {value!r} must not be negative: it is one standard deviation")
            elif f.name.endswith("tau_s") and float(numbers) == 0.0:
                faults.append(f"[imu] {f.name} must be above 0")
            if isinstance(value, list):
                object.__setattr__(self, f.name, tuple(value))
        if faults:
            raise StudyError(faults)

    @property
    def arw(self) -> Array:
        """(3,) rad/sqrt(s)."""
        return axes(self.gyro_arw_deg_per_sqrt_h) * units.DEG_PER_SQRT_H

    @property
    def vrw(self) -> Array:
        """(3,) m/s/sqrt(s)."""
        return axes(self.accel_vrw_mps_per_sqrt_h) * units.MPS_PER_SQRT_H

    @property
    def gyro_bias(self) -> Array:
        """(3,) rad/s, 1 sigma at turn-on."""
        return axes(self.gyro_bias_deg_per_h) * units.DEG_PER_H

    @property
    def accel_bias(self) -> Array:
        """(3,) m/s^2, 1 sigma at turn-on."""
        return axes(self.accel_bias_ug) * units.UG

    @property
    def gyro_offset(self) -> Array:
        """(3,) rad/s, fixed."""
        return axes(self.gyro_offset_deg_per_h) * units.DEG_PER_H

    @property
    def accel_offset(self) -> Array:
        """(3,) m/s^2, fixed."""
        return axes(self.accel_offset_ug) * units.UG

    @property
    def gyro_instability(self) -> Array:
        """(3,) rad/s, stationary sigma."""
        return axes(self.gyro_instability_deg_per_h) * units.DEG_PER_H

    @property
    def accel_instability(self) -> Array:
        """(3,) m/s^2, stationary sigma."""
        return axes(self.accel_instability_ug) * units.UG

    @property
    def gyro_rrw(self) -> Array:
        """(3,) rad/s/sqrt(s)."""
        return axes(self.gyro_rrw_deg_per_h_per_sqrt_h) * units.DEG_PER_H_PER_SQRT_H

    @property
    def accel_rrw(self) -> Array:
        """(3,) m/s^2/sqrt(s)."""
        return axes(self.accel_rrw_ug_per_sqrt_h) * units.UG_PER_SQRT_H

    @property
    def gyro_scale(self) -> Array:
        """(3,) 1 sigma."""
        return axes(self.gyro_scale_ppm) * units.PPM

    @property
    def accel_scale(self) -> Array:
        """(3,) 1 sigma."""
        return axes(self.accel_scale_ppm) * units.PPM

    @property
    def gyro_misalignment(self) -> float:
        """rad, 1 sigma of each of the six off-diagonal elements."""
        return self.gyro_misalignment_mrad * units.MRAD

    @property
    def accel_misalignment(self) -> float:
        """rad, 1 sigma of each of the six off-diagonal elements."""
        return self.accel_misalignment_mrad * units.MRAD

    @property
    def gyro_g_sensitivity(self) -> float:
        """rad/s per m/s^2, 1 sigma of each of the nine elements."""
        return self.gyro_g_sensitivity_deg_per_h_per_g * units.DEG_PER_H / units.G0

    @property
    def quantum(self) -> Array:
        """(6,) rad and m/s; 0: none."""
        return np.repeat([self.gyro_quantisation_arcsec * units.ARCSEC, self.accel_quantisation_mps], 3)

    @property
    def limit(self) -> Array:
        """(6,) rad/s and m/s^2; infinite where no range is given."""
        ranges = np.repeat([self.gyro_range_deg_per_s * units.DEG, self.accel_range_g * units.G0], 3)
        return np.where(ranges > 0.0, ranges, np.inf)

    @property
    def levers(self) -> Array:
        """(3, 3) m, row i the place of accelerometer i in IMU axes."""
        return np.array([self.accel_x_lever_mm, self.accel_y_lever_mm, self.accel_z_lever_mm], dtype=float) * 1e-3

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        root = np.sqrt(rate_hz)
        gyro = f"{_si(self.arw * root, 'rad/s')} of a rate, {_si(self.arw / root, 'rad')} of an increment"
        accel = f"{_si(self.vrw * root, 'm/s^2')} of a rate, {_si(self.vrw / root, 'm/s')} of an increment"
        return [
            ("gyro_arw_deg_per_sqrt_h", _si(self.arw, "rad/sqrt(s)"), gyro),
            ("gyro_bias_deg_per_h", _si(self.gyro_bias, "rad/s"), "drawn once"),
            ("gyro_offset_deg_per_h", _si(self.gyro_offset, "rad/s"), "fixed"),
            ("gyro_instability_deg_per_h", _si(self.gyro_instability, "rad/s"), f"tau {self.gyro_tau_s:g} s"),
            ("gyro_rrw_deg_per_h_per_sqrt_h", _si(self.gyro_rrw, "rad/s/sqrt(s)"), ""),
            ("gyro_scale_ppm", _si(self.gyro_scale, "(ratio)"), "drawn once"),
            ("gyro_misalignment_mrad", f"{self.gyro_misalignment:.4g} rad", "drawn once"),
            ("gyro_g_sensitivity_deg_per_h_per_g", f"{self.gyro_g_sensitivity:.4g} rad/s per m/s^2", "drawn once"),
            ("gyro_quantisation_arcsec", f"{self.quantum[0]:.4g} rad", ""),
            ("gyro_range_deg_per_s", f"{self.limit[0]:.4g} rad/s", ""),
            ("accel_vrw_mps_per_sqrt_h", _si(self.vrw, "m/s/sqrt(s)"), accel),
            ("accel_bias_ug", _si(self.accel_bias, "m/s^2"), "drawn once"),
            ("accel_offset_ug", _si(self.accel_offset, "m/s^2"), "fixed"),
            ("accel_instability_ug", _si(self.accel_instability, "m/s^2"), f"tau {self.accel_tau_s:g} s"),
            ("accel_rrw_ug_per_sqrt_h", _si(self.accel_rrw, "m/s^2/sqrt(s)"), ""),
            ("accel_scale_ppm", _si(self.accel_scale, "(ratio)"), "drawn once"),
            ("accel_misalignment_mrad", f"{self.accel_misalignment:.4g} rad", "drawn once"),
            ("accel_quantisation_mps", f"{self.quantum[3]:.4g} m/s", ""),
            ("accel_range_g", f"{self.limit[3]:.4g} m/s^2", ""),
            ("bandwidth_hz", "first order", ""),
            ("accel_x_lever_mm", _si(self.levers[0], "m"), ""),
            ("accel_y_lever_mm", _si(self.levers[1], "m"), ""),
            ("accel_z_lever_mm", _si(self.levers[2], "m"), ""),
        ]


@dataclass(frozen=True)
class GnssModel(Instrument):
    """Position: white plus a Gauss-Markov part (north, east, down, m); velocity: white per axis.

    The std_ columns hold the whole sigma of a fix. The receiver sees the antenna: waves are in its velocity.
    """

    name: str = "gnss"
    rate_hz: float = 1.0
    white_m: Arm = (1.0, 1.0, 2.0)
    correlated_m: Arm = (0.0, 0.0, 0.0)
    tau_s: float = 100.0
    velocity_mps: PerAxis = 0.05
    published: frozenset[str] = frozenset()

    @property
    def std(self) -> Array:
        """(3,) m, white and correlated together."""
        return np.hypot(self.white_m, self.correlated_m)

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        return [
            ("rate_hz", f"{self.rate_hz:g} Hz", ""),
            ("white_m", _si(axes(self.white_m), "m"), "north, east, down"),
            ("correlated_m", _si(axes(self.correlated_m), "m"), f"tau {self.tau_s:g} s"),
            ("velocity_mps", _si(axes(self.velocity_mps), "m/s"), "per axis"),
        ]


@dataclass(frozen=True)
class SpeedLog(Instrument):
    """Axial speed through the water: v_s = (1 + k) v + white noise; k belongs to the mission (`speed_scale`)."""

    name: str = "speed"
    rate_hz: float = 1.0
    noise_kn: float = 0.1
    published: frozenset[str] = frozenset()

    @property
    def noise(self) -> float:
        """m/s"""
        return self.noise_kn * units.KNOT

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        return [("rate_hz", f"{self.rate_hz:g} Hz", ""), ("noise_kn", f"{self.noise:.4g} m/s", "a sample")]


@dataclass(frozen=True)
class DepthSensor(Instrument):
    """Pressure depth, down from the mean surface: white noise and a bias drawn once."""

    name: str = "depth"
    rate_hz: float = 1.0
    noise_m: float = 0.1
    bias_m: float = 0.0
    published: frozenset[str] = frozenset()

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        return [
            ("rate_hz", f"{self.rate_hz:g} Hz", ""),
            ("noise_m", f"{self.noise_m:g} m", "a sample"),
            ("bias_m", f"{self.bias_m:g} m", "drawn once"),
        ]


@dataclass(frozen=True)
class Dvl(Instrument):
    """Bottom-track velocity in body FRD: one scale error drawn per run, white noise per axis."""

    name: str = "dvl"
    rate_hz: float = 1.0
    noise_mps: float = 0.02
    scale_percent: float = 0.3
    published: frozenset[str] = frozenset()

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        return [
            ("rate_hz", f"{self.rate_hz:g} Hz", ""),
            ("noise_mps", f"{self.noise_mps:g} m/s", "a sample, per axis"),
            ("scale_percent", f"{self.scale_percent * units.PERCENT:g}", "drawn once"),
        ]


@dataclass(frozen=True)
class Magnetometer(Instrument):
    """Three-axis field in the IMU table (mag_x, mag_y, mag_z; tesla inside, uT in files).

    bias_deg : the levelled compass reads heading + bias (the sensor is turned about body z), drawn once.
    noise_deg : of a heading taken from one row, correlated over tau_s so that one row a second is white; on each axis
        it is noise_deg times the horizontal field. hard_iron_ut : per axis, drawn once, IMU axes.
    """

    name: str = "magnetometer"
    bias_deg: float = 2.0
    noise_deg: float = 1.5
    tau_s: float = 0.2
    hard_iron_ut: float = 0.0
    published: frozenset[str] = frozenset()

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        return [
            ("bias_deg", f"{self.bias_deg * units.DEG:.4g} rad", "drawn once"),
            ("noise_deg", f"{self.noise_deg * units.DEG:.4g} rad", f"a row, correlated over {self.tau_s:g} s"),
            ("hard_iron_ut", f"{self.hard_iron_ut * 1e-6:.4g} T", "drawn once"),
        ]


@dataclass(frozen=True)
class AttitudeSensor(Instrument):
    """The vehicle's own compass or AHRS (attitude table): true heading with an offset drawn once, white noise."""

    name: str = "attitude"
    rate_hz: float = 1.0
    tilt_noise_deg: float = 1.0
    heading_noise_deg: float = 2.0
    heading_bias_deg: float = 0.0
    published: frozenset[str] = frozenset()

    def _lines(self, rate_hz: float) -> list[tuple[str, str, str]]:
        return [
            ("rate_hz", f"{self.rate_hz:g} Hz", ""),
            ("tilt_noise_deg", f"{self.tilt_noise_deg * units.DEG:.4g} rad", "a sample"),
            ("heading_noise_deg", f"{self.heading_noise_deg * units.DEG:.4g} rad", "a sample"),
            ("heading_bias_deg", f"{self.heading_bias_deg * units.DEG:.4g} rad", "drawn once"),
        ]


# Bias, range of the 3DM-GX3-25 and accuracy, rate of the CS4500: tables 1 and 2 of the AUV paper. 0.2 deg/s and
# 0.003 g are read as turn-on (1 sigma): an in-run drift of that size cannot give a 5 deg heading after 520 s.
IMUS: Mapping[str, ImuModel] = {
    "3dm-gx3-25": ImuModel(
        name="3dm-gx3-25",
        gyro_arw_deg_per_sqrt_h=0.03 * 60.0,
        gyro_bias_deg_per_h=0.2 * 3600.0,
        gyro_instability_deg_per_h=0.005 * 3600.0,
        gyro_tau_s=1000.0,
        gyro_range_deg_per_s=300.0,
        accel_vrw_mps_per_sqrt_h=80.0 * units.UG * 60.0,
        accel_bias_ug=3000.0,
        accel_range_g=5.0,
        published=frozenset({"gyro_bias_deg_per_h", "gyro_range_deg_per_s", "accel_bias_ug", "accel_range_g"}),
    ),
}
CS4500 = SpeedLog(name="cs4500", rate_hz=1.0, noise_kn=0.1, published=frozenset({"rate_hz", "noise_kn"}))
GARMIN_16_HVS = GnssModel(
    name="garmin-16-hvs", rate_hz=1.0, white_m=(1.0, 1.0, 2.0), correlated_m=(2.0, 2.0, 3.0), tau_s=100.0,
    velocity_mps=0.05, published=frozenset({"rate_hz"}),
)  # fmt: skip
# The recorded z bias of the paper's tests: -0.053 deg/s, fixed in both (test 2's printed 0.52 is taken for -0.052).
PAPER_IMU = replace(
    IMUS["3dm-gx3-25"],
    gyro_bias_deg_per_h=(720.0, 720.0, 0.0),
    gyro_offset_deg_per_h=(0.0, 0.0, -0.053 * 3600.0),
    published=IMUS["3dm-gx3-25"].published | {"gyro_offset_deg_per_h"},
)
