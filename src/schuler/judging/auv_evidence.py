"""Monte Carlo on the AUV filter: how good it is on simulated dives, and whether its own sigmas say so.

Every run is simulated, filtered and smoothed with truth at hand; what is drawn per run is the mission's and the
instruments' own: current, log scale, wave phases, biases, noise. Bounds are those of chi-square means, 99 %.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.auv import AuvSettings, navigate
from schuler.judging.consistency import chi2_bounds, nees
from schuler.judging.errors import DEG, error_series
from schuler.judging.outages import dives
from schuler.truth.instruments import Dvl, Magnetometer
from schuler.truth.missions import PRESETS, AuvMission
from schuler.truth.recording import SUITES, SensorSuite, simulate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Experiment:
    """A mission, who sees it and what the filter is told; the last dive is judged."""

    title: str
    mission: AuvMission
    suite: SensorSuite
    settings: AuvSettings


# The paper's first test with an unknown constant current (0.25 m/s a component) and log scale (1 %) in each run. The
# filter knows these two sigmas and that the current hardly changes (0.04 m/s/sqrt(h)); the rest are its defaults.
_MISSION = PRESETS["paper-test-1"].with_changes(current_std=0.25, speed_scale_std=0.01)
_SUITE = SUITES["paper-test-1"]
_SETTINGS = AuvSettings(current_std=0.25, current_walk=0.04 / 60.0, declination=_MISSION.declination)

EXPERIMENTS: dict[str, Experiment] = {
    "dive": Experiment("520 s dive after 100 s on the surface", _MISSION, _SUITE, _SETTINGS),
    "second dive": Experiment(
        "second 520 s dive, after 60 s of GPS", _MISSION.with_changes(dives=2, between=60.0), _SUITE, _SETTINGS
    ),
    "resurfaced": Experiment(
        "520 s dive and 30 s of fixes after it", _MISSION.with_changes(final_surface=30.0), _SUITE, _SETTINGS
    ),
    "magnetometer and DVL": Experiment(
        "520 s dive after an L-shaped surface leg, with magnetometer and DVL",
        _MISSION.with_changes(l_shape=True),
        _SUITE.with_changes(magnetometer=Magnetometer(bias_deg=2.0, noise_deg=1.5), dvl=Dvl()),
        _SETTINGS,
    ),
}


@dataclass(frozen=True)
class Run:
    """Errors at the end of the judged dive, just before the next fix.

    nis: kind -> sum, all its degrees of freedom, those of one innovation, how many were left out.
    """

    end_m: float
    nees_half: float
    heading: float  # rad, absolute
    heading_sigma: float
    smoother_rms_m: float
    smoother_nees_half: float  # in the middle of the dive
    nis: dict[str, tuple[float, int, int, int]]


def one_run(experiment: Experiment, seed: int, run: int) -> Run:
    """One draw of everything."""
    recording = simulate(experiment.mission, experiment.suite, seed=seed, run=run)
    navigation = navigate(recording.tables, experiment.settings)
    assert navigation.smoother is not None
    last = dives(navigation, recording.tables["gnss"], recording.truth)[-1]
    middle = 0.5 * (last["start_s"] + last["end_s"])
    smooth = error_series(navigation.smoother, recording.truth).between(middle, middle + 1.0)
    nis = {}
    for kind, i in navigation.innovations.items():
        dof = int(np.isfinite(i.value[i.used]).sum())
        nis[kind] = float(i.nis[i.used].sum()), dof, i.value.shape[1], int((~i.used).sum())
    return Run(
        last["horizontal_end_m"],
        last["nees_half_end"],
        last["heading_end_deg"] * DEG,
        last["heading_sigma_deg"] * DEG,
        last["smoother_rms_m"],
        float(nees(smooth.position[:1, :2], smooth.cov_pos[:1, :2, :2])[0]),
        nis,
    )


def ensemble(
    experiment: Experiment, runs: int, seed: int, progress: Callable[[int], None] | None = None
) -> dict[str, Any]:
    """Statistics of `runs` runs; the same seed and number give the same figures.

    "end_m", "smoother_rms_m": {mean, se (standard error of the mean), rms, p95, max}; "heading_deg" likewise.
    "nees_half" (position at the end of the dive), "heading_ratio" (error^2/sigma^2 there), "smoother_nees_half"
    (position in the middle of the dive, all data): {mean, low, high, inside}, ideal 1. "nis": kind -> {mean (of the
    runs' means), se (by the runs' own spread), low, high, inside (bounds for one innovation a run), low_all, high_all
    (as if all innovations of all runs were independent), n, left_out}.
    """
    found = []
    for run in range(runs):
        found.append(one_run(experiment, seed, run))
        if progress is not None:
            progress(run + 1)
    column: Mapping[str, Array] = {
        name: np.array([getattr(r, name) for r in found], dtype=np.float64)
        for name in Run.__dataclass_fields__
        if name != "nis"
    }
    return {
        "title": experiment.title,
        "runs": runs,
        "seed": seed,
        "end_m": spread(column["end_m"]),
        "heading_deg": spread(column["heading"] / DEG),
        "smoother_rms_m": spread(column["smoother_rms_m"]),
        "nees_half": judged(column["nees_half"], 2),
        "heading_ratio": judged(np.square(column["heading"] / column["heading_sigma"]), 1),
        "smoother_nees_half": judged(column["smoother_nees_half"], 2),
        "nis": {kind: _nis([r.nis[kind] for r in found if kind in r.nis]) for kind in found[0].nis},
    }


def spread(values: Array) -> dict[str, float]:
    """Mean with its standard error, rms, 95 % and largest."""
    return {
        "mean": float(values.mean()),
        "se": float(values.std(ddof=1) / sqrt(values.size)) if values.size > 1 else float("inf"),
        "rms": float(np.sqrt(np.mean(values**2))),
        "p95": float(np.percentile(values, 95.0)),
        "max": float(values.max()),
    }


def judged(values: Array, dof: int) -> dict[str, Any]:
    """Mean per degree of freedom of independent chi-square values beside its 99 % bounds."""
    low, high = chi2_bounds(dof, values.size)
    mean = float(values.mean())
    return {"mean": mean, "low": low, "high": high, "inside": bool(low <= mean <= high)}


def _nis(runs: list[tuple[float, int, int, int]]) -> dict[str, Any]:
    means = np.array([total / dof for total, dof, _, _ in runs])
    every = sum(dof for _, dof, _, _ in runs)
    low_all, high_all = chi2_bounds(1, every)
    return {
        **judged(means, runs[0][2]),
        "se": float(means.std(ddof=1) / sqrt(means.size)) if means.size > 1 else float("inf"),
        "low_all": low_all,
        "high_all": high_all,
        "n": every,
        "left_out": sum(left_out for _, _, _, left_out in runs),
    }
