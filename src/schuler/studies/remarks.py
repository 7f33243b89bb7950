"""What judging found that a person should hear: a reference on another clock, a wrong arm, sigmas that are not true."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation
from schuler.judging.words import consistency_words
from schuler.studies.places import FAR_M

Array = NDArray[np.float64]

if TYPE_CHECKING:
    from schuler.studies.inputs import Inputs
    from schuler.studies.model import Study


def judging_notes(study: Study, inputs: Inputs, navigation: Navigation, summary: Mapping[str, Any]) -> list[str]:
    """Sentences on the clock of the reference, the antenna's arm and the consistency, for any kind with a filter."""
    columns = {name: list(table.columns) for name, table in inputs.tables.items()}
    consistency = dict(summary.get("consistency") or {})
    clock = reference_notes(study, inputs, navigation)
    arm = lever_notes(study, inputs, navigation) if study.study.kind == "aided" else []
    error = (((summary.get("errors") or {}).get("filter") or {}).get("horizontal_m") or {}).get("rms")
    if clock or (error is not None and error > FAR_M):  # the reference is wrong, so NEES says nothing of the sigmas
        consistency = {k: v for k, v in consistency.items() if not k.startswith("nees")}
    words = consistency_words(consistency, dict(study.noise), columns)
    if arm:  # what a wrong arm does to the innovations is no matter of sigmas
        words = [w for w in words if "sigmas of gnss" not in w]
    return [*clock, *arm, *words]


def reference_notes(study: Study, inputs: Inputs, navigation: Navigation) -> list[str]:
    """A sentence where the reference of a recording lies on another clock than the track; nothing is corrected."""
    from schuler.judging.errors import at_point
    from schuler.judging.lag import lag_words, reference_lag

    reference = inputs.reference if inputs.reference is not None else inputs.elsewhen
    if reference is None or inputs.truth_states or study.file_of("reference") is None:
        return []
    track = at_point(navigation.smoother or navigation.filter, study.mounting.reference_frd_m)
    path = study.file_of("reference")
    said = lag_words(
        reference_lag(track, reference),
        path.name if path is not None else "the reference",
        "gnss" in inputs.tables,
        study.input.reference_delay_s,
    )
    return [said] if said else []


def lever_notes(study: Study, inputs: Inputs, navigation: Navigation) -> list[str]:
    """A sentence where the innovations of the fixes say that the antenna's arm is wrong, and it was not estimated.

    Positions and velocities are asked apart; the one that explains more of its innovations speaks.
    """
    gnss, track = inputs.tables.get("gnss"), navigation.filter
    known = len(track) > 30 and bool(np.isfinite(track.rpy).all())
    if gnss is None or not known or "antenna_lever_x" in navigation.states:
        return []
    from schuler.ground.frames import dcm_from_euler
    from schuler.judging.residuals import LeverCorrection, lever_correction, lever_words, velocity_arm

    C_nb = dcm_from_euler(*track.rpy.T)
    turned = np.swapaxes(C_nb[:-1], 1, 2) @ C_nb[1:]
    w = np.stack(
        [turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0], turned[:, 1, 0] - turned[:, 0, 1]]
    )
    rate = 0.5 * w.T / np.maximum(np.diff(track.time), 1e-3)[:, None]
    found: list[tuple[float, LeverCorrection, float]] = []
    for kind, stem, default in (("position", "std_", study.noise.gnss_m), ("velocity", "std_v_", study.noise.gnss_mps)):
        taken = _three(navigation, f"gnss_{kind}", "gnss_height" if kind == "position" else "gnss_velocity_down")
        if taken is None:
            continue
        time, value, std = taken
        row = np.clip(np.searchsorted(track.time, time - 1e-6) - 1, 0, len(track) - 2)
        near = np.clip(np.searchsorted(gnss.time, time - 0.5 * float(np.median(np.diff(gnss.time)))), 0, len(gnss) - 1)
        fix = np.tile(np.asarray(default, dtype=float), (len(time), 1))
        for k, axis in enumerate(("north", "east", "down")):
            if stem + axis in gnss:
                own = gnss[stem + axis][near]
                fix[:, k] = np.where(np.isfinite(own) & (own > 0.0), own, fix[:, k])
        if kind == "position":
            arm, least = C_nb[row], float(np.hypot(np.median(fix[:, 0]), study.noise.gnss_correlated_m))
        else:
            arm = velocity_arm(C_nb[row], rate[row])
            quick = float(np.percentile(np.linalg.norm(rate[row], axis=1), 95))
            least = float(np.median(fix[:, 0])) / max(3.0 * quick, 1e-3)
        # what a turn makes of velocities changes too fast for the filter to take much of it in
        correction = lever_correction(value, arm, std, fix if kind == "position" else None)
        if correction is not None:
            found.append((correction.rms_after / max(correction.rms_before, 1e-12), correction, least))
    for _, correction, least in sorted(found, key=lambda f: f[0]):
        words = lever_words(correction, study.mounting.antenna_frd_m, least)
        if words:
            return [words]
    return []


def _three(navigation: Navigation, flat: str, down: str) -> tuple[Array, Array, Array] | None:
    """(time, value (n, 3), std (n, 3)) of innovations whose down component may be of a kind of its own, NaN if none."""
    kind, third = navigation.innovations.get(flat), navigation.innovations.get(down)
    if kind is None or len(kind.time) < 30:
        return None
    value, std = (np.full((len(kind.time), 3), np.nan) for _ in range(2))
    d = min(kind.value.shape[1], 3)
    value[:, :d], std[:, :d] = kind.value[:, :d], kind.std[:, :d]
    if d == 2 and third is not None and len(third.time):
        at = np.minimum(np.searchsorted(kind.time, third.time - 1e-6), len(kind.time) - 1)
        same = np.abs(kind.time[at] - third.time) < 1e-6
        value[at[same], 2], std[at[same], 2] = third.value[same, 0], third.std[same, 0]
    return kind.time, value, std
