"""[imu] calibration: the file read, and an imu table corrected by it before anything else is done with it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from schuler.ground.errors import InputError
from schuler.ground.tables import Table

if TYPE_CHECKING:
    from schuler.calibration.corrections import Calibration
    from schuler.studies.model import Study


def calibration_of(study: Study) -> Calibration | None:
    """The calibration that the study names; None where it names none. InputError for a file that is not one."""
    from schuler.calibration.corrections import Calibration

    name = study.imu.calibration if study.imu is not None else None
    if name is None:
        return None
    path = study.folder / name
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f'[imu] calibration: "{name}" cannot be read: {error.strerror} (looked in {study.folder})'
        ) from None
    except ValueError:
        raise InputError(
            f'[imu] calibration: "{name}" is not JSON; make one with  schuler calibrate PLAN.toml'
        ) from None
    return Calibration.from_dict(content, name)


def corrected(study: Study, imu: Table) -> Table:
    """The imu table as the study's calibration corrects it, in the instrument's own axes; unchanged without one."""
    from schuler.calibration.corrections import apply

    calibration = calibration_of(study)
    return imu if calibration is None else apply(imu, calibration)
