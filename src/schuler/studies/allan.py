"""`schuler allan`: Allan deviation of every axis of a recording at rest, fitted noise, and an `[imu]` section of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler import __version__
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.units import (
    ARCSEC,
    DEG_PER_H,
    DEG_PER_H_PER_SQRT_H,
    DEG_PER_SQRT_H,
    MPS_PER_SQRT_H,
    UG,
    UG_PER_SQRT_H,
)
from schuler.studies.run import Progress, silent

if TYPE_CHECKING:
    from schuler.calibration.allan import Deviation, Kind
    from schuler.calibration.allan_fit import NoiseFit, Term

Array = NDArray[np.float64]
AXES = "xyz"
_GAP = 1.5  # median intervals
_FILL = 5  # missing rows that are bridged

# Key of allan.json, term of the fit, SI value of the key's unit; for gyros and for accelerometers.
_GYRO = (
    ("arw_deg_per_sqrt_h", "random_walk", DEG_PER_SQRT_H),
    ("rrw_deg_per_h_per_sqrt_h", "rate_walk", DEG_PER_H_PER_SQRT_H),
    ("flicker_deg_per_h", "flicker", DEG_PER_H),
    ("quantisation_arcsec", "quantisation", ARCSEC),
    ("ramp_deg_per_h2", "ramp", DEG_PER_H / 3600.0),
)
_ACCEL = (
    ("vrw_mps_per_sqrt_h", "random_walk", MPS_PER_SQRT_H),
    ("rrw_ug_per_sqrt_h", "rate_walk", UG_PER_SQRT_H),
    ("flicker_ug", "flicker", UG),
    ("quantisation_mps", "quantisation", 1.0),
    ("ramp_ug_per_h", "ramp", UG / 3600.0),
)


@dataclass
class AllanResult:
    """One recording: deviation and fit of each sensor, in SI; told: the content of allan.json."""

    name: str
    rate_hz: float
    seconds: float
    sensors: dict[str, tuple[Deviation, NoiseFit]]
    told: dict[str, Any]
    imu: str
    notes: list[str] = field(default_factory=list)

    def write(self, out: Path, progress: Progress = silent) -> Path:
        """allan.json, imu.toml (an [imu] section) and report.html."""
        from schuler.io.results import json_text, result_folder
        from schuler.report.allan import allan_page

        progress("drawing the page")
        page = allan_page(self)
        with result_folder(out) as folder:
            (folder / "allan.json").write_text(json_text(self.told), encoding="utf-8", newline="\n")
            (folder / "imu.toml").write_text(self.imu, encoding="utf-8", newline="\n")
            (folder / "report.html").write_text(page, encoding="utf-8", newline="\n")
        return out


def steady(table: Table) -> tuple[float, dict[str, Array], list[str]]:
    """(rate Hz, columns, notes) of the longest stretch at one rate; rates, with few missing rows bridged."""
    time = np.asarray(table.time, dtype=np.float64)
    if len(time) < 100:
        raise InputError(f"the recording has {len(time)} rows; an Allan deviation needs hundreds, better hours")
    increments = table.kind == "increments" or "dtheta_x" in table
    step = np.diff(time)
    dt = float(np.median(step))
    names = [
        f"{s}_{a}" for s in (("dtheta", "dv") if increments else ("gyro", "accel")) for a in AXES if f"{s}_{a}" in table
    ]
    values = table.stack(*names)
    notes: list[str] = []
    if increments:
        values = values / np.diff(time, prepend=time[0] - dt)[:, None]
        names = [n.replace("dtheta", "gyro").replace("dv", "accel") for n in names]
    gaps = np.flatnonzero(step > _GAP * dt)
    if gaps.size:
        missing = np.round(step[gaps] / dt).astype(int) - 1
        wide = gaps[missing > _FILL]
        edges = np.concatenate([[0], wide + 1, [len(time)]])
        k = int(np.argmax(np.diff(edges)))
        a, b = int(edges[k]), int(edges[k + 1])
        if wide.size:
            notes.append(
                f"{wide.size} gaps of more than {_FILL} rows; the longest stretch without one is used, "
                f"{time[a]:.1f} to "
                f"{time[b - 1]:.1f} s"
            )
        time, values = time[a:b], values[a:b]
        small = int(missing[(gaps >= a) & (gaps < b - 1) & (missing <= _FILL)].sum())
        if small:
            grid = np.arange(round((time[-1] - time[0]) / dt) + 1) * dt + time[0]
            values = np.column_stack([np.interp(grid, time, v) for v in values.T])
            notes.append(f"{small} missing rows bridged by straight lines")
    rate = (len(time) - 1) / (time[-1] - time[0]) if not gaps.size else 1.0 / dt
    rate = round(rate) if abs(rate / max(round(rate), 1) - 1.0) < 1e-3 else rate
    return float(rate), {n: np.ascontiguousarray(values[:, i]) for i, n in enumerate(names)}, notes


def _moving(columns: dict[str, Array], rate: float) -> list[str]:
    """A note where the recording was not at rest."""
    block = max(int(rate), 1)
    moved = []
    for name, y in columns.items():
        n = len(y) // block
        if n < 20:
            continue
        means = y[: n * block].reshape(n, block).mean(axis=1)
        jumps = np.abs(np.diff(means))
        usual = 1.4826 * float(np.median(jumps))
        least = 0.01 if name.startswith("gyro") else 0.2
        if jumps.max() > 20.0 * usual + least:
            moved.append(f"{name} at {(int(np.argmax(jumps)) + 1):d} s after the start")
    if not moved:
        return []
    return [
        f"the recording was not at rest all the time ({', '.join(moved[:3])}): the figures show that motion "
        f"too; cut it out"
    ]


def analyse(
    table: Table,
    name: str,
    tau: Sequence[float] | None = None,
    kind: Kind = "oadev",
    progress: Progress = silent,
) -> AllanResult:
    """Deviation and fit of all columns of an imu table."""
    from schuler.calibration.allan import deviation
    from schuler.calibration.allan_fit import fit

    rate, columns, notes = steady(table)
    notes = [*table.notes, *notes, *_moving(columns, rate)]
    seconds = len(next(iter(columns.values()))) / rate
    sensors = {}
    for sensor, values in columns.items():
        progress(f"Allan deviation of {sensor}")
        sensors[sensor] = fit(values, rate, deviation(values, rate, tau, kind))
        if float(np.ptp(values)) == 0.0:
            notes.append(f"{sensor} never changes: it was not recorded, or its steps are coarser than its noise")
    told = {
        "rate_hz": rate,
        "kind": kind,
        "made_by": {"version": __version__, "seed": None, "study_sha256": None},
        "seconds": seconds,
        "sensors": {s: sensor_told(s, d, f) for s, (d, f) in sensors.items()},
        "notes": notes,
    }
    return AllanResult(name, rate, seconds, sensors, told, imu_section(sensors, name, rate, seconds), notes)


def sensor_told(sensor: str, dev: Deviation, fit: NoiseFit) -> dict[str, Any]:
    """One sensor of allan.json."""
    gyro = sensor.startswith("gyro")
    unit, factor = ("deg/h", DEG_PER_H) if gyro else ("ug", UG)
    instability = f"bias_instability_{'deg_per_h' if gyro else 'ug'}"
    terms: dict[str, Any] = {}

    def put(key: str, term: Term | None, size: float) -> None:
        for suffix, value in (("", "value"), ("_low", "low"), ("_high", "high")):
            terms[key + suffix] = None if term is None else getattr(term, value) / size

    for key, name, size in _GYRO if gyro else _ACCEL:
        put(key, fit.terms.get(name), size)
        if name == "random_walk":
            put(instability, fit.bias_instability, factor)
    terms["quantisation"] = terms["quantisation_arcsec" if gyro else "quantisation_mps"]
    terms["ramp"] = terms["ramp_deg_per_h2" if gyro else "ramp_ug_per_h"]
    correlated = None
    if fit.correlated is not None and fit.correlated_tau is not None:
        correlated = {
            "sigma": fit.correlated.value / factor,
            "sigma_low": fit.correlated.low / factor,
            "sigma_high": fit.correlated.high / factor,
            "tau_s": fit.correlated_tau.value,
            "tau_s_low": fit.correlated_tau.low,
            "tau_s_high": fit.correlated_tau.high,
        }
    terms["correlated"] = correlated
    return {
        "unit": unit,
        "tau_s": dev.tau.tolist(),
        "adev": (dev.dev / factor).tolist(),
        "low": (dev.low / factor).tolist(),
        "high": (dev.high / factor).tolist(),
        "fit": terms,
        "floor_tau_s": fit.floor_tau,
    }


def imu_section(sensors: dict[str, tuple[Deviation, NoiseFit]], name: str, rate: float, seconds: float) -> str:
    """An [imu] section as text: what a filter and a simulation take of it. Terms that were not seen are left out."""
    lines = [f"# noise of {name}: {seconds / 3600:.2f} h at {rate:g} Hz", "[imu]"]

    def one(key: str, kind: str, get: Any, size: float) -> None:
        values = [get(f) for s, (_, f) in sensors.items() if s.startswith(kind)]
        if len(values) != 3 or all(v is None for v in values):
            return
        lines.append(f"{key} = [{', '.join(f'{(v or 0.0) / size:.4g}' for v in values)}]")

    def term(which: str) -> Any:
        return lambda f: f.terms[which].value if which in f.terms else None

    for kind, walk, walk_unit, unit, size, rrw, rrw_unit in (
        (
            "gyro",
            "gyro_arw_deg_per_sqrt_h",
            DEG_PER_SQRT_H,
            "deg_per_h",
            DEG_PER_H,
            "gyro_rrw_deg_per_h_per_sqrt_h",
            DEG_PER_H_PER_SQRT_H,
        ),
        ("accel", "accel_vrw_mps_per_sqrt_h", MPS_PER_SQRT_H, "ug", UG, "accel_rrw_ug_per_sqrt_h", UG_PER_SQRT_H),
    ):
        one(walk, kind, term("random_walk"), walk_unit)

        def in_run(f: Any) -> float | None:
            if f.correlated is not None:
                return float(f.correlated.value)
            if f.bias_instability is not None:
                return float(f.bias_instability.value)
            return float(f.terms["flicker"].value) if "flicker" in f.terms else None

        one(f"{kind}_instability_{unit}", kind, in_run, size)
        fits = [f for s, (_, f) in sensors.items() if s.startswith(kind)]
        # A Gauss-Markov process has the top of its deviation at 1.89 time constants.
        times = [
            f.correlated_tau.value if f.correlated_tau is not None else f.floor_tau / 1.89 if f.floor_tau else None
            for f in fits
        ]
        known = [t for t in times if t is not None]
        if known and any(in_run(f) for f in fits):
            lines.append(f"{kind}_tau_s = {float(np.median(known)):.4g}")
        one(rrw, kind, term("rate_walk"), rrw_unit)
    return "\n".join(lines) + "\n"


def lines(result: AllanResult) -> list[str]:
    """What the terminal says."""
    out = [f"{result.name}: {result.seconds / 3600:.2f} h at {result.rate_hz:g} Hz"]
    for sensor, told in result.told["sensors"].items():
        f, gyro = told["fit"], sensor.startswith("gyro")
        walk = f["arw_deg_per_sqrt_h" if gyro else "vrw_mps_per_sqrt_h"]
        low = f["arw_deg_per_sqrt_h_low" if gyro else "vrw_mps_per_sqrt_h_low"]
        bias = f["bias_instability_deg_per_h" if gyro else "bias_instability_ug"]
        word = (
            "random walk not seen"
            if walk is None
            else (f"{walk:.4g} +- {walk - low:.2g} {'deg/sqrt(h)' if gyro else 'm/s/sqrt(h)'}")
        )
        more = (
            "no floor reached"
            if bias is None
            else (f"floor/0.664 {bias:.3g} {'deg/h' if gyro else 'ug'} at {told['floor_tau_s']:.3g} s")
        )
        out.append(f"  {sensor:8s} {word}, {more}")
    return out
