"""Monte Carlo on kind "aided": simulated studies, and whether errors, innovations and states are as large as claimed.

Each run draws everything that [simulate], [imu], [noise] and [start] give a sigma: errors of the start too. Bounds are
those of chi-square means, 99 %.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.judging.auv_evidence import judged, spread
from schuler.judging.consistency import nees
from schuler.judging.errors import ErrorSeries, error_series
from schuler.judging.result import Result

Array = NDArray[np.float64]
Sections = dict[str, dict[str, Any]]

# A tactical IMU whose biases are Gauss-Markov, as the filter models them.
TACTICAL = {
    "gyro_arw_deg_per_sqrt_h": 0.2,
    "accel_vrw_mps_per_sqrt_h": 0.1,
    "gyro_instability_deg_per_h": 20.0,
    "gyro_tau_s": 300.0,
    "accel_instability_ug": 1000.0,
    "accel_tau_s": 300.0,
}
GOOD = {
    "gyro_arw_deg_per_sqrt_h": 0.003,
    "accel_vrw_mps_per_sqrt_h": 0.005,
    "gyro_instability_deg_per_h": 0.02,
    "gyro_tau_s": 3600.0,
    "accel_instability_ug": 50.0,
    "accel_tau_s": 3600.0,
}
START = {
    "lat_deg": 50.0, "lon_deg": 30.0, "height_m": 500.0, "heading_deg": 40.0,
    "std_north_m": 1.0, "std_east_m": 1.0, "std_down_m": 2.0,
    "std_v_north_mps": 0.1, "std_v_east_mps": 0.1, "std_v_down_mps": 0.1,
    "std_roll_deg": 0.5, "std_pitch_deg": 0.5, "std_heading_deg": 2.0,
}  # fmt: skip
BIASES = ("gyro_bias", "accel_bias")


@dataclass(frozen=True)
class Experiment:
    """A simulated study and the stretch (s) without fixes that is judged. The true start is [start] without std_."""

    title: str
    sections: Sections
    outage: tuple[float, float]
    estimate: tuple[str, ...] | None = BIASES
    constraints: tuple[str, ...] = ()

    def raw(self) -> dict[str, Any]:
        """As the dictionary of a study file."""
        raw: dict[str, Any] = {
            "study": {"name": self.title, "kind": "aided"},
            "start": START,
            "imu": TACTICAL,
            "filter": {"constraints": list(self.constraints)},
            "output": {"rate_hz": 1.0},
            "outage": [{"sensor": "gnss", "start_s": self.outage[0], "end_s": self.outage[1]}],
        }
        if self.estimate is not None:
            raw["filter"]["estimate"] = list(self.estimate)
        for name, keys in self.sections.items():
            raw[name] = keys if name == "imu" else {**raw.get(name, {}), **keys}
        return raw


FLIGHT = {"preset": "flight", "duration_s": 600.0, "rate_hz": 100.0}
STEADY = {"delay_walk_s_per_sqrt_s": 0.0}  # the simulated clocks do not drift
EXPERIMENTS: dict[str, Experiment] = {
    "flight": Experiment("flight with GNSS, 15 states", {"trajectory": FLIGHT}, (300.0, 360.0)),
    "flight, 26 states": Experiment(
        "flight with GNSS: biases, scales, antenna lever, delays",
        {
            "trajectory": FLIGHT,
            "imu": {**TACTICAL, "gyro_scale_ppm": 2000.0, "accel_scale_ppm": 2000.0},
            "noise": {"gnss_m": [0.1, 0.1, 0.2], **STEADY},
            "mounting": {"antenna_frd_m": [1.0, 0.0, -0.5]},
        },
        (300.0, 360.0),
        (*BIASES, "gyro_scale", "accel_scale", "antenna_lever", "gnss_delay", "gnss_velocity_delay"),
    ),
    "slow receiver": Experiment(
        "flight with fixes whose error is correlated over 50 s",
        {
            "trajectory": FLIGHT,
            "simulate": {"gnss_velocity": False},
            "noise": {"gnss_correlated_m": 2.0, "gnss_correlated_tau_s": 50.0},
        },
        (300.0, 360.0),
        (*BIASES, "gnss_bias"),
    ),
    "car": Experiment(
        "car with odometer, sideways constraint and stops",
        {
            "trajectory": {"preset": "car", "duration_s": 600.0, "rate_hz": 100.0},
            "simulate": {"speed_hz": 10.0},
            "noise": {"mounting_deg": 2.0},
        },
        (300.0, 360.0),
        (*BIASES, "speed_scale", "mounting"),
        ("nhc", "zupt"),
    ),
    "airspeed": Experiment(
        "flight with airspeed, wind and barometer",
        {
            "trajectory": FLIGHT,
            "simulate": {"speed_hz": 5.0, "height_hz": 1.0},
            "noise": {"speed_mps": 0.3, "current_mps": 5.0, "current_walk_mps_per_sqrt_h": 3.0},
            "filter": {"speed_is": "air"},
        },
        (300.0, 420.0),
        (*BIASES, "speed_scale", "current", "height_bias"),
    ),
    "ship": Experiment(
        "survey vessel with a good IMU, DVL and depth",
        {
            "trajectory": {
                "preset": "legs", "duration_s": 1800.0, "rate_hz": 50.0, "speed_mps": 2.5,
                "turns_deg": [90.0, 90.0, -90.0, -90.0, 90.0],
            },
            "start": {"height_m": -50.0, "std_roll_deg": 0.02, "std_pitch_deg": 0.02, "std_heading_deg": 0.2},
            "imu": GOOD,
            "simulate": {"dvl_hz": 1.0, "depth_hz": 1.0},
            "noise": {"dvl_misalignment_deg": 0.3},
        },
        (600.0, 1500.0),
        (*BIASES, "dvl_scale", "dvl_misalignment"),
    ),
    "beacons": Experiment(
        "car with ranges to four beacons and a barometer",
        {
            "trajectory": {"preset": "car", "duration_s": 400.0, "rate_hz": 100.0},
            "simulate": {"ranges_hz": 1.0, "height_hz": 1.0},
            "noise": {"height_m": 0.5},
        },
        (100.0, 300.0),
        (*BIASES, "range_scale", "range_bias"),
    ),
}  # fmt: skip


@dataclass
class Run:
    """Of one run: mean NEES per degree of freedom of filter and smoother over the track; NEES/2, NEES of each part and
    errors at the outage's end; nis of each kind: sum, degrees of freedom, those of one, left out; error^2/sigma^2 of
    each learnt state at the end, filter and smoother."""

    nees: dict[str, float] = field(default_factory=dict)
    end: dict[str, float] = field(default_factory=dict)
    end_m: float = np.nan
    filter_rms_m: float = np.nan
    smoother_rms_m: float = np.nan
    inside: float = np.nan
    nis: dict[str, tuple[float, int, int, int]] = field(default_factory=dict)
    states: dict[str, float] = field(default_factory=dict)


PARTS = (("position", "position", "cov_pos"), ("velocity", "velocity", "cov_vel"), ("attitude", "rpy", "cov_rpy"))


def _nees(series: ErrorSeries) -> dict[str, Array]:
    return {name: nees(getattr(series, e), getattr(series, c)) for name, e, c in PARTS}


def one_run(experiment: Experiment, seed: int) -> Run:
    """One draw of everything."""
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    return measured(run_study(parse_study(experiment.raw()), seed=seed), experiment.outage)


def measured(result: Result, outage: tuple[float, float]) -> Run:
    """The figures of one result."""
    start, end = outage
    assert result.reference is not None and result.navigation.smoother is not None
    run = Run(inside=float(result.summary["consistency"]["inside_3_sigma"]))
    series = error_series(result.navigation.filter, result.reference)
    smooth = error_series(result.navigation.smoother, result.reference)
    for who, s in (("filter", series), ("smoother", smooth)):
        each = _nees(s)
        run.nees |= {f"{who} {name}": float(np.nanmean(v)) for name, v in each.items()}
    last = series.between(end - 1.5, end - 1e-6)
    middle = smooth.between(0.5 * (start + end), end)
    run.end = {f"filter {name}": float(v[-1]) for name, v in _nees(last).items()}
    run.end |= {f"smoother {name}": float(v[0]) for name, v in _nees(middle).items()}
    run.end["filter horizontal"] = float(nees(last.position[-1:, :2], last.cov_pos[-1:, :2, :2])[0])
    run.end_m = float(last.horizontal[-1])
    inside, inside_smooth = series.between(start, end), smooth.between(start, end)
    run.filter_rms_m = float(np.sqrt(np.mean(inside.horizontal**2)))
    run.smoother_rms_m = float(np.sqrt(np.mean(inside_smooth.horizontal**2)))
    for kind, i in result.navigation.innovations.items():
        used = np.asarray(i.used, dtype=bool)
        dof = int(np.isfinite(i.value[used]).sum())
        run.nis[kind] = float(np.nansum(i.nis[used])), dof, i.value.shape[1], int((~used).sum())
    for name, history in result.navigation.states.items():
        if name in result.truth_states and len(history.time):
            true = float(np.interp(history.time[-1], *result.truth_states[name]))
            run.states[name] = float(((history.value[-1] - true) / history.std[-1]) ** 2)
    return run


DOF = {"position": 3, "velocity": 3, "attitude": 3, "horizontal": 2}


def ensemble(
    experiment: Experiment, runs: int, seed: int, progress: Callable[[int], None] | None = None
) -> dict[str, Any]:
    """Statistics of `runs` runs with seeds `seed`, `seed` + 1, ...

    "nees": of filter and smoother, position, velocity and attitude, means over the track with bounds as if each run
    gave one value; "end": the same at one moment (the outage's end, for the smoother its middle); "nis", "states"
    likewise; "end_m", "filter_rms_m", "smoother_rms_m", "smoother_ratio" (of the rms of all runs in the outage);
    "inside_3_sigma".
    """
    found = []
    for k in range(runs):
        found.append(one_run(experiment, seed + k))
        if progress is not None:
            progress(k + 1)

    def gathered(which: str, dof: Callable[[str], int]) -> dict[str, Any]:
        names = list(getattr(found[0], which))
        columns = {n: np.array([getattr(r, which)[n] for r in found if n in getattr(r, which)]) for n in names}
        return {n: judged(v, dof(n)) | {"median": float(np.median(v))} for n, v in columns.items()}

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean([getattr(r, name) ** 2 for r in found])))

    nis = {}
    for kind in found[0].nis:
        rows = [r.nis[kind] for r in found if r.nis.get(kind, (0.0, 0, 0, 0))[1] > 0]
        if rows:
            means = np.array([total / dof for total, dof, _, _ in rows])
            nis[kind] = judged(means, rows[0][2]) | {
                "n": sum(r[1] for r in rows), "left_out": sum(r[3] for r in rows),
            }  # fmt: skip
    return {
        "title": experiment.title,
        "runs": runs,
        "seed": seed,
        "nees": gathered("nees", lambda n: DOF[n.split()[-1]]),
        "end": gathered("end", lambda n: DOF[n.split()[-1]]),
        "states": gathered("states", lambda n: 1),
        "nis": nis,
        "end_m": spread(np.array([r.end_m for r in found])),
        "filter_rms_m": rms("filter_rms_m"),
        "smoother_rms_m": rms("smoother_rms_m"),
        "smoother_ratio": rms("smoother_rms_m") / rms("filter_rms_m"),
        "inside_3_sigma": float(np.mean([r.inside for r in found])),
    }
