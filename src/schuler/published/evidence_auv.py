"""Monte Carlo evidence on the AUV paper's filter: its two sea trials simulated, its outage policies side by side.

A run is simulated once and navigated by every variant, so differences between variants are not sampling errors.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import degrees, pi, radians, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.paper import PaperSettings, navigate_paper
from schuler.ground.earth import OMEGA, WGS84, wrap_pi
from schuler.ground.errors import InputError
from schuler.truth.missions import PRESETS, AuvMission
from schuler.truth.recording import SUITES, SensorSuite, simulate

Array = NDArray[np.float64]

_PAPER = PaperSettings(rate=1.0)
_TIGHT = replace(_PAPER, level_std=radians(2.0))
VARIANTS: dict[str, PaperSettings] = {
    "paper": _PAPER,
    "zero-free": replace(_PAPER, outage_policy="zero-free"),
    "drop": replace(_PAPER, outage_policy="drop"),
    "consider": replace(_PAPER, outage_policy="consider"),
    "held-course": replace(_PAPER, outage_policy="held-course"),
    "no-bias": replace(_PAPER, outage_policy="drop", estimate_bias=False),
    "literal": replace(_PAPER, literal=True),
    "earth-rate": replace(_PAPER, earth_rate=True),
    "tight": _TIGHT,
    "tight-free": replace(_TIGHT, outage_policy="zero-free"),
    "tight-drop": replace(_TIGHT, outage_policy="drop"),
    "tight-consider": replace(_TIGHT, outage_policy="consider"),
}
"""Outage policies, and what else the ledger asks about. "tight": 2 instead of 20 deg per levelling sample."""


def paper_monte_carlo(test: int, policy: str = "paper", runs: int = 100, seed: int = 0) -> dict[str, Any]:
    """Statistics of the paper's filter at the end of test 1 (100 + 520 s) or 2 (62 + 523 s), no current.

    policy : a key of VARIANTS. Returns "heading_end_deg" (mean_abs, rms, p95, mean, se_mean_abs: the standard error of
    mean_abs by the runs' own spread), "heading_rms_dive_deg", "sigma_end_deg" (root mean square of the filter's own),
    "bias_rms_deg_per_s" (error of B_z when the dive begins), "bias_mean_deg_per_s" (its estimate then),
    "heading_abs_deg" (one number a run), "position_end_m" (north and east: mean, std).
    """
    return ensemble(trial(test), [policy], runs, seed)[policy]


def trial(test: int, **changes: Any) -> tuple[AuvMission, SensorSuite]:
    """Mission and instruments of the paper's test 1 or 2; changes go to the mission."""
    name = f"paper-test-{test}"
    if name not in PRESETS:
        raise InputError(f"The paper has tests 1 and 2, not {test}.")
    return replace(PRESETS[name], **changes), SUITES[name]


def ensemble(
    setup: tuple[AuvMission, SensorSuite], variants: Iterable[str], runs: int, seed: int = 0
) -> dict[str, dict[str, Any]]:
    """`paper_monte_carlo` of several variants on the same simulated runs: name of the variant -> statistics."""
    mission, suite = setup
    names = list(variants)

    def one_run(run: int) -> dict[str, dict[str, float]]:
        recording = simulate(mission, suite, seed=seed, run=run)
        return {name: _one(recording, mission, VARIANTS[name]) for name in names}

    # Each run draws from its own streams and the answers keep the order of the runs: the threads change no bit.
    with ThreadPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        samples = list(pool.map(one_run, range(runs)))
    return {name: _statistics([s[name] for s in samples], name, mission.name, runs, seed) for name in names}


def _one(recording: Any, mission: AuvMission, settings: PaperSettings) -> dict[str, float]:
    """Errors (estimate minus truth) of one run at the end of the first dive, and over it; rad, rad/s, m."""
    start, end = mission.dive_intervals[0]
    navigation = navigate_paper(recording.tables, settings)
    track, truth = navigation.filter, recording.truth
    dive = (track.time > start) & (track.time <= end + 1e-6)
    last = int(np.flatnonzero(dive)[-1])
    heading = wrap_pi(track.rpy[:, 2] - np.interp(track.time, truth.time, np.unwrap(truth["heading"])))
    lat, lon = (float(np.interp(track.time[last], truth.time, truth[name])) for name in ("lat", "lon"))
    R_N, R_E = WGS84.radii(lat)
    bias = navigation.states["gyro_bias_z"]
    true_time, true_bias = recording.truth_states["gyro_bias_z"]
    learnt = max(int(np.flatnonzero(dive)[0]) - 1, 0)  # the last row on the surface
    # Earth rate that is not subtracted ends in the bias: what the z gyro of a level vehicle reads at rest.
    absorbed = 0.0 if settings.earth_rate or not settings.estimate_bias else -OMEGA * float(np.sin(lat))
    return {
        "heading": float(heading[last]),
        "heading_dive": float(np.mean(np.square(heading[dive]))),
        "variance": float(track.cov_rpy[last, 2, 2]),
        "bias": float(bias.value[learnt]),
        "bias_error": float(bias.value[learnt] - np.interp(track.time[learnt], true_time, true_bias) - absorbed),
        "north": float(R_N * (track.lat[last] - lat)),
        "east": float(R_E * np.cos(lat) * wrap_pi(track.lon[last] - lon)),
    }


def _statistics(samples: list[dict[str, float]], policy: str, mission: str, runs: int, seed: int) -> dict[str, Any]:
    column: Mapping[str, Array] = {key: np.array([s[key] for s in samples]) for key in samples[0]}
    size = np.abs(np.degrees(column["heading"]))
    return {
        "mission": mission,
        "policy": policy,
        "runs": runs,
        "seed": seed,
        "heading_end_deg": {
            "mean_abs": float(np.mean(size)),
            "rms": float(np.sqrt(np.mean(size**2))),
            "p95": float(np.percentile(size, 95.0)),
            "mean": degrees(float(np.mean(column["heading"]))),
            "se_mean_abs": float(np.std(size, ddof=1) / sqrt(runs)) if runs > 1 else float("inf"),
        },
        "heading_abs_deg": size.tolist(),
        "heading_rms_dive_deg": degrees(float(np.sqrt(np.mean(column["heading_dive"])))),
        "sigma_end_deg": degrees(float(np.sqrt(np.mean(column["variance"])))),
        "bias_rms_deg_per_s": degrees(float(np.sqrt(np.mean(column["bias_error"] ** 2)))),
        "bias_mean_deg_per_s": degrees(float(np.mean(column["bias"]))),
        "position_end_m": {
            axis: {"mean": float(np.mean(column[axis])), "std": float(np.std(column[axis], ddof=1 if runs > 1 else 0))}
            for axis in ("north", "east")
        },
    }


def mean_abs_error(runs: int) -> float:
    """Relative standard error of the mean of |x| over `runs` draws of a centred normal x: sqrt(pi/2 - 1)/sqrt(runs)."""
    return sqrt((pi / 2.0 - 1.0) / runs)


def p95_error(runs: int) -> float:
    """Relative standard error of the 95th percentile of |x|: sqrt(0.05 0.95/runs) over density times percentile."""
    x = 1.959963984540054
    density = 2.0 * np.exp(-0.5 * x * x) / sqrt(2.0 * pi)
    return float(sqrt(0.05 * 0.95 / runs) / (density * x))


def rms_error(runs: int) -> float:
    """Relative standard error of the rms of `runs` normal draws: 1/sqrt(2 runs)."""
    return 1.0 / sqrt(2.0 * runs)
