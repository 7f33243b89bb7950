"""Runs of the cases of `oeson`: errors of the filter's track, and how large they are against its sigmas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.judging.errors import error_series
from schuler.studies.oeson import CASES, Case, Path

if TYPE_CHECKING:
    from schuler.aiding.aided_settings import AidedSettings
    from schuler.studies.simulated import Simulation

Array = NDArray[np.float64]
ARCMIN = np.deg2rad(1.0 / 60.0)
STATES = ("north", "east", "v north", "v east", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Errors:
    """Mean squares of one run: position, velocity (horizontal), tilt, yaw in m, m/s, arcmin; squares of error / sigma
    of STATES; horizontal position and velocity at the end (of the gap, where there is one), and error / sigma there."""

    square: Array
    ratio: Array
    end: float
    end_v: float
    end_ratio: float


class Runner:
    """One case on one path: the study read once, then run by seed."""

    def __init__(self, case: Case, path: Path) -> None:
        from schuler.studies.model import parse_study
        from schuler.studies.simulated import simulation

        self.case = case
        self.study = parse_study(case.raw(path))
        made: Simulation = simulation(self.study)
        self.simulation = replace(made, suite=replace(made.suite, reference_hz=1.0))

    def run(self, seed: int) -> Errors:
        """One draw of everything."""
        from schuler.aiding.aided import navigate
        from schuler.studies.kind_aided import started

        recording = self.simulation.record(seed)
        settings: AidedSettings = replace(started(self.study, recording), smoother=False)
        tables = dict(recording.tables)
        gap = self.case.gap
        if gap is not None:
            seen = tables["sightings"]
            tables["sightings"] = seen.where((seen.time < gap[0]) | (seen.time > gap[1]))
        made = navigate(tables, settings).filter
        return judged(error_series(made, recording.reference), self.case)


def judged(series: Any, case: Case) -> Errors:
    """The figures of one track."""
    s = series.between(case.since, float(series.time[-1]) + 1e-6)
    position, velocity, rpy = s.position[:, :2], s.velocity[:, :2], s.rpy
    squares = [
        np.sum(position**2, axis=1),
        np.sum(velocity**2, axis=1),
        np.sum(rpy[:, :2] ** 2, axis=1),
        rpy[:, 2] ** 2,
    ]
    unit = np.array([1.0, 1.0, ARCMIN, ARCMIN])
    error = np.column_stack([position, velocity, rpy])
    variance = np.column_stack(
        [np.diagonal(c, axis1=1, axis2=2)[:, :k] for c, k in ((s.cov_pos, 2), (s.cov_vel, 2), (s.cov_rpy, 3))]
    )
    last = s if case.gap is None else s.between(case.since, case.gap[1])
    end = last.position[-1, :2]
    return Errors(
        np.array([float(np.mean(x)) for x in squares]) / unit**2,
        np.mean(error**2 / np.maximum(variance, 1e-30), axis=0),
        float(np.hypot(*end)),
        float(np.hypot(*last.velocity[-1, :2])),
        float(np.sqrt(end @ np.linalg.solve(last.cov_pos[-1, :2, :2], end) / 2.0)),
    )


def ensemble(
    name: str | Case, path: Path, runs: int, seed: int, progress: Callable[[int], None] | None = None
) -> dict[str, Any]:
    """RMS of `runs` runs with seeds `seed`, `seed` + 1, ...: "pos_m", "vel_mps", "tilt_arcmin", "yaw_arcmin", "end_m",
    "end_mps" (all rms over the runs), "ratio" (error / sigma, rms, of each of STATES), "ratio_low", "ratio_high" of
    them, "end_ratio"; "spread": the standard error of "pos_m" over its value;
    "six": that of position, velocity, tilt and yaw, were there six runs."""
    runner = Runner(CASES[name] if isinstance(name, str) else name, path)
    found = []
    for k in range(runs):
        found.append(runner.run(seed + k))
        if progress is not None:
            progress(k + 1)
    square = np.array([f.square for f in found])
    ratio = np.sqrt(np.mean([f.ratio for f in found], axis=0))
    pos, vel, tilt, yaw = (float(x) for x in np.sqrt(square.mean(axis=0)))
    scatter = square.std(axis=0) / square.mean(axis=0) / 2.0
    return {
        "title": runner.case.title, "path": path, "runs": runs, "seed": seed,
        "pos_m": pos, "vel_mps": vel, "tilt_arcmin": tilt, "yaw_arcmin": yaw,
        "end_m": float(np.sqrt(np.mean([f.end**2 for f in found]))),
        "end_mps": float(np.sqrt(np.mean([f.end_v**2 for f in found]))),
        "ratio": {s: float(r) for s, r in zip(STATES, ratio, strict=True)},
        "ratio_low": float(ratio.min()), "ratio_high": float(ratio.max()),
        "end_ratio": float(np.sqrt(np.mean([f.end_ratio**2 for f in found]))),
        "spread": float(scatter[0] / np.sqrt(runs)),
        "six": [float(x) for x in scatter / np.sqrt(6.0)],
    }  # fmt: skip
