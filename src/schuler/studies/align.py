"""`schuler align`: the initial attitude of a study's recording (or of its simulated trajectory), with its
covariance."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.ground.errors import InputError, StudyError
from schuler.studies.run import DEFAULT_SEED, Progress, made_by, silent

if TYPE_CHECKING:
    from schuler.inertial.alignment import Alignment
    from schuler.studies.model import Study

D = math.pi / 180.0
DEG_PER_H = D / 3600.0


def align_study(
    study: Study, *, seed: int | None = None, progress: Progress = silent
) -> tuple[Alignment, dict[str, Any]]:
    """The alignment and the content of alignment.json. InputError and StudyError say what to type."""
    from schuler.inertial.alignment_filter import align
    from schuler.studies.kind_strapdown import imu_model, sensor_errors, trajectory_of

    s, window = study.start, study.align
    notes: list[str] = []
    if "imu" in study.input.tables:
        from schuler.studies.inputs import check_gravity, read_tables, to_body

        inputs = read_tables(study, progress)
        to_body(study, inputs.tables)
        check_gravity(study, inputs.tables)
        imu, drawn = inputs.tables["imu"], None
        notes += inputs.notes
        lat = s.lat_deg * D if s.lat_deg is not None else None
        if lat is None and "gnss" in inputs.tables:
            lat = float(inputs.tables["gnss"]["lat"][0])
            notes.append("the latitude is that of the first fix")
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
    progress("aligning")
    known = s.heading_deg if "imu" in study.input.tables else None  # a simulation's own heading is what is looked for
    found = align(
        imu, sensor_errors(study), lat=lat, lon=(s.lon_deg or 0.0) * D, height=s.height_m or 0.0,
        start=None if window is None else window.from_s, to=None if window is None else window.to_s,
        heading=None if known is None else known * D,
        heading_std=None if s.std_heading_deg is None else s.std_heading_deg * D,
    )  # fmt: skip
    if study.imu is None:
        found.notes.append("there is no [imu] section, so the sigma leaves out the sensors' biases: give their figures")
    std = np.degrees(found.std)
    roll, pitch, heading = np.degrees(found.rpy)
    told = {
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
        "heading_floor_deg": float(np.degrees(found.floor)),
        "took_s": found.to - found.start,
        "useful_s": found.useful,
        "notes": [*notes, *found.notes],
    }
    return found, told


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
    if useful is None:
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
