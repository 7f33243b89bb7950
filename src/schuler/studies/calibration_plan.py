"""The plan file of `schuler calibrate`: every key with its unit and meaning; all faults of a file reported together."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, PrivateAttr, ValidationError
from pydantic_core import PydanticCustomError

from schuler.ground.errors import StudyError
from schuler.studies.faults import sentences
from schuler.studies.sections import Section, Three, key


def _numbers(value: Any) -> Any:
    ok = isinstance(value, list | tuple) and value and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in value
    )  # fmt: skip
    if not ok:
        raise PydanticCustomError("numbers", "expects a list of numbers")
    return tuple(float(v) for v in value)


Angles = Annotated[tuple[float, ...], BeforeValidator(_numbers)]


class PlanSection(Section):
    name: str = key("calibration", "what the result is called")
    kind: Literal["turntable", "multiposition"] = key(..., 'how it was recorded: "turntable" or "multiposition"')
    gravity_mps2: float | None = key(None, "local gravity; standard gravity where absent", "m/s^2", gt=9.7, lt=9.9)
    lat_deg: float | None = key(
        None, "latitude of the laboratory, for gravity and the Earth's rate", "deg", ge=-90, le=90
    )
    height_m: float = key(0.0, "height of the laboratory, with lat_deg", "m")
    form: Literal["upper", "symmetric", "full"] = key(
        "upper", "of the accelerometers' matrix; full needs gamma and beta"
    )
    temperature: bool = key(False, "fit a change of the accelerometer biases with temperature")
    g_sensitivity: bool = key(False, "fit the gyros' sensitivity to specific force, from the biases at the rests")
    origin_mm: Three = key(
        (0.0, 0.0, 0.0), "from where levers are counted to the table's centre, instrument axes", "mm"
    )
    accel_x_direction: Three = key((1.0, 0.0, 0.0), "sensitive direction of accelerometer x, instrument axes")
    accel_y_direction: Three = key((0.0, 1.0, 0.0), "sensitive direction of accelerometer y, instrument axes")
    accel_z_direction: Three = key((0.0, 0.0, 1.0), "sensitive direction of accelerometer z, instrument axes")
    check: bool = key(True, "compare gyros and gravity with the positions table")
    gyros: bool = key(True, "calibrate the gyros too (multiposition)")


class PlanInput(Section):
    imu: str | None = key(None, "the recording", "file")
    positions: str | None = key(None, "which part of it is what", "file")
    rate_hz: float | None = key(None, "for a recording without a time column", "Hz", gt=0)
    gyro_unit: str | None = key(None, "unit of the gyro columns, whatever the headings say")
    accel_unit: str | None = key(None, "unit of the accelerometer columns, whatever the headings say")
    trust_units: bool = key(False, "keep the units of the headings although the numbers speak against them")
    scale_gyro_deg_per_s: float | None = key(None, "value of one count of a raw recording", "deg/s")
    scale_accel_g: float | None = key(None, "value of one count of a raw recording", "g")


class TableSection(Section):
    """The turntable and the procedure, for --design and the error budget."""

    rate_deg_per_s: float = key(20.0, "of the spins", "deg/s", gt=0)
    gammas_deg: Angles | None = key(
        None, "settings that the inner axis gamma can take; every 15 deg where absent", "deg"
    )
    betas_deg: Angles | None = key(None, "settings that the axis beta can take; every 15 deg from -90 to 90", "deg")
    still_s: float = key(60.0, "length of a stop", "s", gt=0)
    stops: int = key(8, "stops round the table at each position", gt=0)
    spin_s: float = key(300.0, "length of a spin", "s", gt=0)
    both_ways: bool = key(True, "spin each way")
    move_s: float = key(5.0, "from one stop or spin to the next", "s", ge=0)
    accel_vrw_mps_per_sqrt_h: float = key(0.06, "velocity random walk of the accelerometers", "m/s/sqrt(h)", gt=0)
    angle_error_arcmin: float = key(1.0, "rms of the inner settings", "arcmin", ge=0)
    stop_error_arcmin: float = key(1.0, "rms of the azimuth of a stop", "arcmin", ge=0)
    tilt_arcmin: float = key(2.0, "tilt of the outer axis", "arcmin", ge=0)
    rate_error_ppm: float = key(10.0, "of the rate", "ppm", ge=0)


class Plan(Section):
    plan: PlanSection
    input: PlanInput = PlanInput()
    table: TableSection = TableSection()
    _folder: Path = PrivateAttr(default=Path("."))
    _sha256: str = PrivateAttr(default="")

    @property
    def folder(self) -> Path:
        return self._folder

    @property
    def sha256(self) -> str:
        return self._sha256

    @property
    def gravity(self) -> float:
        """m/s^2"""
        from schuler.ground.earth import gravity
        from schuler.ground.units import DEG, G0

        if self.plan.gravity_mps2 is not None:
            return self.plan.gravity_mps2
        if self.plan.lat_deg is not None:
            return float(gravity(self.plan.lat_deg * DEG, self.plan.height_m))
        return G0


def load_plan(path: str | Path) -> Plan:
    """Reads a plan file. StudyError names every fault with its place, one sentence each."""
    path = Path(path)
    if path.is_dir():
        raise StudyError(f"{path} is a folder; type the plan file in it, e.g. {path / 'plan.toml'}")
    try:
        data = path.read_bytes()
        raw = tomllib.loads(data.decode("utf-8-sig"))
    except FileNotFoundError:
        raise StudyError(f"{path} does not exist; type the path of a plan file (TOML)") from None
    except OSError as error:
        raise StudyError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise StudyError(f"{path} is not text in UTF-8; a plan file is TOML text") from None
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{path} is not valid TOML: {error}") from None
    if "plan" not in raw:
        raise StudyError(f'{path}: [plan] is absent; it needs name = "..." and kind = "turntable" or "multiposition"')
    try:
        plan = Plan.model_validate(raw)
    except ValidationError as error:
        raise StudyError([f"{path}: {fault}" for fault in sentences(error, Plan, raw)]) from None
    plan._folder = path.parent
    plan._sha256 = hashlib.sha256(data).hexdigest()
    return plan
