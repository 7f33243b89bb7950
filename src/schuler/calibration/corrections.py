"""A calibration as numbers with names, and its use: an imu table corrected.

    measured = (I + M) (true + size effect) + bias + G force          so, in this order:
    force = (I + M_a)^-1 (measured - bias_a);  rate = (I + M_g)^-1 (measured - bias_g - G force);  force - size effect

Parameters carry their unit in the name, as in calibration.json; what is not observable is null there and counts as
zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.calibration.size_effect import Accelerometers, compensate
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.units import DEG, G0, MRAD, PPM

Array = NDArray[np.float64]
AXES = "xyz"

# Stem of a name -> (unit as written, SI value of that unit). A name is stem with the axes in it: accel_bias_x_mps2.
UNITS: dict[str, tuple[str, float]] = {
    "mm": ("mm", 1e-3),
    "mps2": ("m/s^2", 1.0),
    "ppm": ("ppm", PPM),
    "mrad": ("mrad", MRAD),
    "deg_per_s": ("deg/s", DEG),
    "deg_per_s_per_g": ("deg/s/g", DEG / G0),
    "mps2_per_degc": ("m/s^2/degC", 1.0),
}


@dataclass(frozen=True)
class Parameter:
    """value and std in SI; NaN where not observable."""

    name: str
    value: float
    std: float
    observable: bool

    @property
    def unit(self) -> str:
        return UNITS[unit_key(self.name)][0]

    @property
    def factor(self) -> float:
        """SI value of the unit that the name says."""
        return UNITS[unit_key(self.name)][1]


def unit_key(name: str) -> str:
    """The part of a parameter's name that says its unit. InputError for a name that is not known."""
    found = [key for key in UNITS if name.endswith("_" + key)]
    if not found:
        raise InputError(f'the calibration holds a parameter "{name}" whose unit is not known')
    return max(found, key=len)


@dataclass(frozen=True)
class Calibration:
    """parameters, and the covariance (m, m) in SI of the observable ones, in their order; residual figures in m/s^2.

    temperature: of the biases, degC, where they are linear in it (else None). more: what else the file tells.
    """

    plan: str
    parameters: list[Parameter]
    covariance: Array
    residual_rms: float
    holdout_rms: float
    condition: float
    temperature: float | None = None
    more: Mapping[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def value(self, name: str) -> float:
        """SI value, zero where the calibration does not hold it or could not see it."""
        for p in self.parameters:
            if p.name == name:
                return p.value if p.observable and np.isfinite(p.value) else 0.0
        return 0.0

    def as_dict(self, made_by: Mapping[str, Any]) -> dict[str, Any]:
        """The content of calibration.json; numbers in the units that the names say."""
        seen = [p for p in self.parameters if p.observable]
        factors = np.array([p.factor for p in seen])
        return {
            "plan": self.plan,
            "made_by": dict(made_by),
            "parameters": [
                {
                    "name": p.name,
                    "unit": p.unit,
                    "value": p.value / p.factor if p.observable else None,
                    "std": p.std / p.factor if p.observable else None,
                    "observable": p.observable,
                }
                for p in self.parameters
            ],
            "covariance": self.covariance / np.outer(factors, factors) if seen else [],
            "residual_rms_mps2": self.residual_rms,
            "holdout_rms_mps2": self.holdout_rms,
            "condition": self.condition,
            **({"temperature_degC": self.temperature} if self.temperature is not None else {}),
            **self.more,
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, content: Any, source: str = "calibration.json") -> Calibration:
        """From the content of calibration.json. InputError where it is not one."""
        if not isinstance(content, Mapping) or not isinstance(content.get("parameters"), list):
            raise InputError(
                f'{source} is not a calibration: it has no list "parameters"; make one with  schuler calibrate'
            )
        parameters = []
        for entry in content["parameters"]:
            name = entry.get("name") if isinstance(entry, Mapping) else None
            if not isinstance(name, str):
                raise InputError(f"{source}: a parameter has no name")
            factor = UNITS[unit_key(name)][1]
            value, std = entry.get("value"), entry.get("std")
            numbers = [v for v in (value, std) if v is not None]
            if any(isinstance(v, bool) or not isinstance(v, int | float) or not np.isfinite(v) for v in numbers):
                raise InputError(f"{source}: value and std of {name} must be numbers, or null where not observable")
            seen = bool(entry.get("observable", value is not None)) and value is not None
            parameters.append(
                Parameter(
                    name,
                    float(value) * factor if seen else np.nan,
                    float(std) * factor if seen and std is not None else np.nan,
                    seen,
                )
            )
        warm = content.get("temperature_degC")
        m = sum(p.observable for p in parameters)
        return cls(
            str(content.get("plan", "")),
            parameters,
            np.full((m, m), np.nan),
            _number(content.get("residual_rms_mps2")),
            _number(content.get("holdout_rms_mps2")),
            _number(content.get("condition")),
            float(warm) if isinstance(warm, int | float) else None,
        )

    # ---- what it says ----

    @property
    def levers(self) -> Array:
        """(3, 3) m, row i the place of accelerometer i."""
        return np.array([[self.value(f"accel_{i}_lever_{j}_mm") for j in AXES] for i in AXES])

    def triad(self, sensor: str) -> tuple[Array, Array]:
        """(I + M, bias in SI) of "accel" or "gyro"."""
        K = np.eye(3)
        for i, a in enumerate(AXES):
            K[i, i] += self.value(f"{sensor}_scale_{a}_ppm")
            for j, b in enumerate(AXES):
                if i != j:
                    K[i, j] = self.value(f"{sensor}_misalignment_{a}{b}_mrad")
        unit = "mps2" if sensor == "accel" else "deg_per_s"
        return K, np.array([self.value(f"{sensor}_bias_{a}_{unit}") for a in AXES])

    @property
    def g_sensitivity(self) -> Array:
        """(3, 3) rad/s per m/s^2."""
        return np.array([[self.value(f"gyro_g_sensitivity_{a}{b}_deg_per_s_per_g") for b in AXES] for a in AXES])

    @property
    def drift(self) -> Array:
        """(3,) m/s^2 per degC of the accelerometer biases."""
        return np.array([self.value(f"accel_bias_drift_{a}_mps2_per_degc") for a in AXES])

    def describe(self) -> str:
        """A sentence for the notes of a run."""
        kinds = []
        for word, stem in (
            ("biases", "_bias_"),
            ("scales", "_scale_"),
            ("misalignments", "_misalignment_"),
            ("lever arms", "_lever_"),
            ("g-sensitivity", "g_sensitivity"),
        ):
            if any(stem in p.name and p.observable for p in self.parameters):
                kinds.append(word)
        blind = [p.name for p in self.parameters if not p.observable]
        more = f"; not seen and taken as zero: {', '.join(blind)}" if blind else ""
        return f'calibration "{self.plan}" applied: {", ".join(kinds) or "nothing"}{more}'


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else float("nan")


def of_triad(sensor: str, names: Sequence[str], values: Array, std: Array, seen: NDArray[np.bool_]) -> list[Parameter]:
    """Parameters of a fitted triad; names as in `multiposition.SensorFit`."""
    out = []
    for name, v, s, ok in zip(names, values, std, seen, strict=True):
        if name.endswith("_per_degC"):
            full = f"{sensor}_bias_drift_{name[5]}_mps2_per_degc"
        else:
            unit = "mrad"
            if name.startswith("bias"):
                unit = "mps2" if sensor == "accel" else "deg_per_s"
            elif name.startswith("scale"):
                unit = "ppm"
            elif name.startswith("g_sensitivity"):
                unit = "deg_per_s_per_g"
            full = f"{sensor}_{name}_{unit}"
        out.append(Parameter(full, float(v) if ok else np.nan, float(s) if ok else np.nan, bool(ok)))
    return out


def apply(imu: Table, calibration: Calibration, *, variant: str = "full") -> Table:
    """The imu table as a perfect instrument at the calibration's origin would have given it; same columns, same kind.

    variant: of the size-effect compensation ("full", or the thesis's "rate-only"). A gap in time ends the differences.
    """
    increments = imu.kind == "increments" or "dv_x" in imu
    time = np.asarray(imu.time, dtype=np.float64)
    if len(time) < 2:
        raise InputError("the imu table has fewer than two rows; nothing can be corrected")
    usual = float(np.median(np.diff(time)))
    dt = np.diff(time, prepend=time[0] - usual)
    names = [f"{n}_{a}" for n in (("dtheta", "dv") if increments else ("gyro", "accel")) for a in AXES]
    values = imu.stack(*names)
    if increments:
        values = values / dt[:, None]
    K_a, bias_a = calibration.triad("accel")
    K_g, bias_g = calibration.triad("gyro")
    bias = np.broadcast_to(bias_a, (len(time), 3))
    notes = [calibration.describe()]
    if np.any(calibration.drift):
        if "temperature" in imu and calibration.temperature is not None:
            warm = np.where(np.isfinite(imu["temperature"]), imu["temperature"], calibration.temperature)
            bias = bias + (warm - calibration.temperature)[:, None] * calibration.drift
        else:
            notes.append("the table has no temperature: the calibration's temperature terms are left out")
    force = (values[:, 3:] - bias) @ np.linalg.inv(K_a).T
    rate = (values[:, :3] - bias_g - force @ calibration.g_sensitivity.T) @ np.linalg.inv(K_g).T
    where = Accelerometers.triad(calibration.levers)
    if np.any(where.positions):
        cuts = np.flatnonzero(dt[1:] > 1.5 * usual) + 1
        for part in np.split(np.arange(len(time)), cuts):
            if len(part) > 1:
                step = float(np.median(dt[part[1:]]))
                force[part] = compensate(force[part], rate[part], step, where, variant=variant, means=True)  # type: ignore[arg-type]
    corrected = np.hstack([rate, force])
    if increments:
        corrected = corrected * dt[:, None]
    columns = dict(imu.columns)
    columns.update({n: np.ascontiguousarray(corrected[:, i]) for i, n in enumerate(names)})
    return Table(imu.name, columns, imu.kind, imu.source, [*imu.notes, *notes])
