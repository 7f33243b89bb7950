"""`schuler align`: the initial attitude of a study's recording (or of its simulated trajectory), with its
covariance."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.ground.errors import InputError, StudyError
from schuler.ground.tables import Table, Tables
from schuler.studies.inputs import to_body
from schuler.studies.run import DEFAULT_SEED, Progress, made_by, silent

if TYPE_CHECKING:
    from schuler.inertial.alignment import Alignment
    from schuler.studies.model import Study
    from schuler.studies.sections import AlignSection

D = math.pi / 180.0
DEG_PER_H = D / 3600.0


def align_study(
    study: Study, *, seed: int | None = None, progress: Progress = silent
) -> tuple[Alignment, dict[str, Any]]:
    """The alignment and the content of alignment.json. InputError and StudyError say what to type."""
    from schuler.inertial.alignment_filter import align
    from schuler.studies.kind_strapdown import imu_model, sensor_errors, trajectory_of

    s, window = study.start, study.align
    method = window.method if window is not None else "auto"
    notes: list[str] = []
    tables: dict[str, Table] = {}
    if "imu" in study.input.tables:
        from schuler.studies.inputs import check_gravity, read_tables

        inputs = read_tables(study, progress)
        to_body(study, inputs.tables)
        check_gravity(study, inputs.tables)
        imu, drawn, tables = inputs.tables["imu"], None, inputs.tables
        notes += inputs.notes
        lat = s.lat_deg * D if s.lat_deg is not None else None
        if lat is None and "gnss" in inputs.tables:
            lat = float(inputs.tables["gnss"]["lat"][0])
            notes.append("the latitude is that of the first fix")
    elif study.trajectory is not None and study.study.kind == "aided" and method != "still":
        from schuler.studies.kind_aided import simulate

        drawn = DEFAULT_SEED if seed is None else seed
        inputs, _ = simulate(study, drawn, progress)
        to_body(study, inputs.tables)
        tables = inputs.tables
        imu, lat = tables["imu"], (float(tables["gnss"]["lat"][0]) if "gnss" in tables else None)
    elif study.trajectory is not None:
        from schuler.truth.imu_errors import measure

        progress("simulating")
        drawn = DEFAULT_SEED if seed is None else seed
        made = trajectory_of(study)
        ideal = made.ideal(study.trajectory.rate_hz, every=1)
        within = (ideal.time > (window.from_s or 0.0 if window else 0.0)) & (
            ideal.time <= (window.to_s or math.inf if window else math.inf)
        )
        speed = float(np.max(np.linalg.norm(ideal.truth.v_n[within], axis=1), initial=0.0))
        if speed > 0.05:
            raise StudyError(
                f"[trajectory] moves at up to {speed:.3g} m/s in the time of the alignment, which is for a still base: "
                'type preset = "rest"'
            )
        imu, lat = measure(ideal, imu_model(study), seed=drawn).table(), made.lat
    else:
        raise StudyError("[input] imu is absent: alignment needs an imu table (or a [trajectory] to simulate one)")
    if method == "moving" or (method == "auto" and _must_move(tables, window)):
        from schuler.studies.align_moving import align_moving
        from schuler.studies.magnetic import recorded_declination

        declination, said = recorded_declination(study, tables) if drawn is None else (inputs.declination, [])
        found = align_moving(study, tables, declination, progress)
        return found, _told(study, found, drawn, [*notes, *said])
    progress("aligning")
    known = s.heading_deg if "imu" in study.input.tables else None  # a simulation's own heading is what is looked for
    found = align(
        imu, sensor_errors(study), lat=lat, lon=(s.lon_deg or 0.0) * D, height=s.height_m or 0.0,
        start=None if window is None else window.from_s, to=None if window is None else window.to_s,
        heading=None if known is None else known * D,
        heading_std=None if s.std_heading_deg is None else s.std_heading_deg * D,
    )  # fmt: skip
    if "gnss" in tables and not found.std[2] < 1.0:
        found.notes.append(
            'the heading was not found on the still stretch; where the fixes move later, [align] method = "moving" '
            "finds it"
        )
    if study.imu is None:
        found.notes.append("there is no [imu] section, so the sigma leaves out the sensors' biases: give their figures")
    return found, _told(study, found, drawn, notes)


def _must_move(tables: Tables, window: AlignSection | None) -> bool:
    """Whether nothing stands still that could be aligned on, but fixes move."""
    from schuler.inertial.alignment import find_still
    from schuler.inertial.imu_input import prepare
    from schuler.studies.align_moving import moves

    start, to = (None, None) if window is None else (window.from_s, window.to_s)
    if not moves(tables.get("gnss"), start, to):
        return False
    if start is not None and to is not None:
        return True
    ready = prepare(tables["imu"])
    try:
        first, last = find_still(ready.time, ready.dtheta, ready.dv, ready.dt)
    except InputError:
        return True
    # a quiet stretch while the fixes move is a smooth road
    return moves(tables["gnss"], first, last)


def _told(study: Study, found: Alignment, drawn: int | None, notes: list[str]) -> dict[str, Any]:
    """The content of alignment.json."""
    std = np.degrees(found.std)
    roll, pitch, heading = np.degrees(found.rpy)
    return {
        "study": {"name": study.study.name, "kind": study.study.kind},
        "made_by": made_by(study, drawn),
        "method": found.method,
        "from_s": found.start,
        "to_s": found.to,
        "roll_deg": float(roll),
        "pitch_deg": float(pitch),
        "heading_deg": float(heading % 360.0),
        "std_roll_deg": float(std[0]),
        "std_pitch_deg": float(std[1]),
        "std_heading_deg": float(std[2]),
        "covariance_deg2": (found.cov / D**2).tolist(),
        "gyro_bias_deg_per_h": None if found.gyro_bias is None else (found.gyro_bias / DEG_PER_H).tolist(),
        "heading_floor_deg": float(np.degrees(found.floor)) if math.isfinite(found.floor) else None,
        "took_s": found.to - found.start,
        "useful_s": found.useful,
        "notes": [*notes, *found.notes],
    }


def lines(told: dict[str, Any]) -> list[str]:
    """What the terminal says."""
    out = [f"aligned from {told['from_s']:.2f} to {told['to_s']:.2f} s ({told['took_s']:.1f} s), base {told['method']}"]
    for name in ("roll", "pitch", "heading"):
        value, std = told[f"{name}_deg"], told[f"std_{name}_deg"]
        if name == "heading" and std > 60.0:
            out.append("  heading   not known")
            continue
        digits = max(2, min(6, 1 - math.floor(math.log10(std)))) if std > 0.0 else 4
        out.append(f"  {name:8s} {value:10.{digits}f} deg   1 sigma {std:.{digits}f} deg")
    bias = told["gyro_bias_deg_per_h"]
    if bias is not None:
        out.append("  gyro bias " + ", ".join(f"{b:.4g}" for b in bias) + " deg/h (x, y, z)")
    useful = told["useful_s"]
    if told["method"] == "moving":
        pass
    elif useful is None:
        out.append("  more time would still help")
    elif useful <= told["took_s"]:
        out.append(f"  more than {max(useful, 1.0):.0f} s does not help: the sensors' biases set the rest")
    else:
        out.append(f"  more time helps up to about {useful:.0f} s; then the sensors' biases set the rest")
    return out + [f"note: {n}" for n in told["notes"]]


def write(told: dict[str, Any], folder: Path) -> Path:
    """alignment.json in the folder, whole or not at all."""
    path = folder / "alignment.json"
    partial = folder / ".alignment.json.partial"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n", encoding="utf-8", newline="\n")
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}; type another --out") from None
    return path
