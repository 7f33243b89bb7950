"""The study file as a whole, and reading it: all faults together, each with its place and what to type."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, PrivateAttr, ValidationError

from schuler.ground.errors import StudyError
from schuler.studies.faults import cross_faults, sentences
from schuler.studies.sections import (
    AlignSection,
    CameraSection,
    ErrorsSection,
    FilterSection,
    ImuSection,
    InputSection,
    LidarSection,
    MissionSection,
    MountingSection,
    NoiseSection,
    OutageSection,
    OutputSection,
    PlatformSection,
    Section,
    SimulateSection,
    StartSection,
    StudySection,
    SweepSection,
    TrajectorySection,
    as_tuple,
    key,
)


class Study(Section):
    """A whole study file. Values in the units that the names say."""

    study: StudySection = key(..., "what this is")
    input: InputSection = key(InputSection(), "tables, paths relative to the study file; any of them may be absent")
    start: StartSection = key(StartSection(), "what is known at the start; what is absent is found")
    imu: ImuSection | None = key(None, "the IMU's errors: a preset or numbers, never both")
    noise: NoiseSection = key(NoiseSection(), "1 sigma of the other sensors; std_ columns in a table win")
    mounting: MountingSection = key(MountingSection(), "where the sensors sit, from the IMU, in body FRD")
    camera: CameraSection | None = key(None, "with landmarks and sightings")
    lidar: LidarSection | None = key(None, "with lidar, and landmarks or height_model")
    filter: FilterSection = key(FilterSection(), "what navigates")
    output: OutputSection = key(OutputSection(), "what is written")
    outage: Annotated[tuple[OutageSection, ...], BeforeValidator(as_tuple)] = key((), "withholds a sensor: [[outage]]")
    sweep: SweepSection | None = key(None, "slides an outage over the whole recording")
    align: AlignSection | None = key(None, "schuler align")
    mission: MissionSection | None = key(None, "a study without [input] is simulated; its truth is the reference")
    trajectory: TrajectorySection | None = key(None, 'kinds "strapdown" and "aided" without [input]')
    simulate: SimulateSection | None = key(None, 'what the vehicle of kind "aided" carries, without [input]')
    errors: ErrorsSection | None = key(None, "fixed errors put on the simulated IMU, beside the draws of [imu]")
    platform: PlatformSection | None = key(None, 'kind "platform"')

    _path: Path | None = PrivateAttr(default=None)
    _sha256: str = PrivateAttr(default="")

    @property
    def path(self) -> Path | None:
        """The file that this study was read from."""
        return self._path

    @property
    def folder(self) -> Path:
        """What the paths of [input] are relative to."""
        return self._path.parent if self._path else Path(".")

    @property
    def sha256(self) -> str:
        """Of the file's bytes, hexadecimal; of the values where there is no file."""
        return self._sha256 or hashlib.sha256(self.model_dump_json().encode()).hexdigest()

    def file_of(self, table: str) -> Path | None:
        """Path of an input table, or None where the study does not name it."""
        name = getattr(self.input, table)
        return None if name is None else self.folder / name


def parse_study(raw: dict[str, Any], folder: Path | None = None) -> Study:
    """A study from the dictionary of its TOML; StudyError with all faults. folder: where named files must exist."""
    faults: list[str] = []
    study: Study | None = None
    try:
        study = Study.model_validate(raw)
    except ValidationError as error:
        faults += sentences(error, Study, raw)
    faults += cross_faults(raw, folder)
    faults += [fault for fault in _made_faults(raw) if fault not in faults]
    if faults or study is None:
        raise StudyError(faults)
    return study


def _made_faults(raw: dict[str, Any]) -> list[str]:
    """Faults that only the instruments and missions themselves find, also in a file with other faults."""
    from schuler.truth.keys import imu_from_keys, mission_from_keys

    faults: list[str] = []

    def attempt(section: type[Section], name: str, make: Callable[[dict[str, Any]], Any], own: tuple[str, ...]) -> None:
        try:
            read = section.model_validate(raw[name])
        except (KeyError, ValidationError):
            return  # absent, or told already
        given = {k: getattr(read, k) for k in read.model_fields_set if k not in own}
        try:
            make({k: v for k, v in given.items() if v is not None})
        except StudyError as error:
            faults.extend(error.faults)

    imu = raw.get("imu")
    if not (isinstance(imu, dict) and "preset" in imu and set(imu) - {"preset", "calibration"}):  # told already
        attempt(ImuSection, "imu", imu_from_keys, ("calibration",))
    if isinstance(raw.get("study"), dict) and raw["study"].get("kind") == "auv":
        attempt(MissionSection, "mission", mission_from_keys, ("magnetometer", "dvl"))
    return faults


def load_study(path: str | Path) -> Study:
    """Reads a study file. StudyError names every fault with its place, one sentence each."""
    path = Path(path)
    if path.is_dir():
        raise StudyError(f"{path} is a folder; type the study file in it, e.g. {path / 'study.toml'}")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise StudyError(f"{path} does not exist; type the path of a study file (TOML)") from None
    except OSError as error:
        raise StudyError(f"{path} cannot be read: {error.strerror}") from None
    try:
        raw = tomllib.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise StudyError(f"{path} is not text in UTF-8; a study file is TOML text") from None
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{path} is not valid TOML: {error}") from None
    if not raw:
        raise StudyError(f'{path} is empty; it needs at least [study] with name = "..." and kind = "auv"')
    try:
        study = parse_study(raw, path.parent)
    except StudyError as error:
        raise StudyError([f"{path}: {fault}" for fault in error.faults]) from None
    study._path = path
    study._sha256 = hashlib.sha256(data).hexdigest()
    return study
