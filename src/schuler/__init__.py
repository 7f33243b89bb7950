"""Schuler: design, run and judge inertial navigation.

A recording or a simulated mission goes in; track, attitude, uncertainty and a verdict come out.

    import schuler

    study = schuler.load_study("study.toml")       # all faults of the file together, each with its place
    result = schuler.run_study(study)              # nothing is written ...
    result.write("result")                         # ... until you say so
    track = result.navigation.filter               # time, lat, lon, height, v_n, rpy and their covariances

The conventions, everywhere in the package:

Units    SI and radians inside. Any other unit is in the name (`speed_mps`, `lat_deg`) or in a file's heading
         (`lat[deg]`). Sigmas are 1 sigma; other percentages are named.
Frames   n: north-east-down at the vehicle. b: forward-right-down. e: Earth-fixed. i: inertial.
         `v_n` is a vector in n; `w_ib_b` is the rate of b against i, in b. `C_nb` takes components in b to n: v_n =
         C_nb v_b, so that neighbouring letters cancel. Quaternions `q_nb` are scalar first and do the same.
Angles   Heading clockwise from north, pitch nose up, roll right side down, in the order z, y, x. Never a state.
Position Geodetic latitude, longitude (rad) and ellipsoidal height (m, up) on WGS 84. Height counts up, the third
         component of a velocity and the depth count down. North and east in metres are (R_N + h) dlat and so on.
Sensors  measured = (I + M) true + bias + noise. An accelerometer measures specific force: (0, 0, -g) at rest, level.
         A row of rates is the mean since the row before; a row of increments, what was gathered since then.
Errors   error = estimate - truth. Attitude error phi in n: C_hat = (I - [phi x]) C_nb. An innovation is measured -
         predicted.
Time     Seconds in float64 on one clock that only goes forward. A solution's row at t has seen every measurement
         stamped t or earlier and none later.

The names below are loaded when they are first used: `import schuler` costs little more than numpy. Everything else has
its place in a subpackage: ground (units, Earth, frames, time, tables), truth (missions, instruments), inertial
(strapdown, platform, alignment), calibration, aiding (filters), judging, published (ledgers), studies, io, report.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from schuler.aiding.aided import navigate as navigate_aided
    from schuler.aiding.aided_aids import Aid
    from schuler.aiding.aided_online import AidedFilter
    from schuler.aiding.aided_settings import AidedSettings
    from schuler.aiding.auv import AuvFilter, AuvSettings, Measurement
    from schuler.aiding.auv import navigate as navigate_auv
    from schuler.aiding.paper import PaperSettings, navigate_paper
    from schuler.aiding.solution import Navigation, Solution
    from schuler.ground.earth import WGS84
    from schuler.ground.errors import InputError, SchulerError, StudyError
    from schuler.ground.tables import Table
    from schuler.io.check import check_file
    from schuler.io.convert import convert
    from schuler.io.tables import read_table, write_table
    from schuler.judging.errors import error_series
    from schuler.judging.result import Result
    from schuler.studies.compare import compare_results
    from schuler.studies.model import Study, load_study
    from schuler.studies.run import run_study
    from schuler.truth.missions import AuvMission
    from schuler.truth.recording import SensorSuite, simulate

_HOME = {  # public name -> the module that it lives in
    "Aid": "schuler.aiding.aided_aids",
    "AidedFilter": "schuler.aiding.aided_online",
    "AidedSettings": "schuler.aiding.aided_settings",
    "AuvFilter": "schuler.aiding.auv",
    "AuvMission": "schuler.truth.missions",
    "AuvSettings": "schuler.aiding.auv",
    "InputError": "schuler.ground.errors",
    "Measurement": "schuler.aiding.auv",
    "Navigation": "schuler.aiding.solution",
    "PaperSettings": "schuler.aiding.paper",
    "Result": "schuler.judging.result",
    "SchulerError": "schuler.ground.errors",
    "SensorSuite": "schuler.truth.recording",
    "Solution": "schuler.aiding.solution",
    "Study": "schuler.studies.model",
    "StudyError": "schuler.ground.errors",
    "Table": "schuler.ground.tables",
    "WGS84": "schuler.ground.earth",
    "check_file": "schuler.io.check",
    "compare_results": "schuler.studies.compare",
    "convert": "schuler.io.convert",
    "error_series": "schuler.judging.errors",
    "load_study": "schuler.studies.model",
    "navigate_aided": "schuler.aiding.aided",
    "navigate_auv": "schuler.aiding.auv",
    "navigate_paper": "schuler.aiding.paper",
    "read_table": "schuler.io.tables",
    "run_study": "schuler.studies.run",
    "simulate": "schuler.truth.recording",
    "write_table": "schuler.io.tables",
}
_THERE = {"navigate_aided": "navigate", "navigate_auv": "navigate"}  # called otherwise at home

__all__ = [
    "WGS84",
    "Aid",
    "AidedFilter",
    "AidedSettings",
    "AuvFilter",
    "AuvMission",
    "AuvSettings",
    "InputError",
    "Measurement",
    "Navigation",
    "PaperSettings",
    "Result",
    "SchulerError",
    "SensorSuite",
    "Solution",
    "Study",
    "StudyError",
    "Table",
    "__version__",
    "check_file",
    "compare_results",
    "convert",
    "error_series",
    "load_study",
    "navigate_aided",
    "navigate_auv",
    "navigate_paper",
    "read_table",
    "run_study",
    "simulate",
    "write_table",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'schuler' has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(_HOME[name]), _THERE.get(name, name))
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
