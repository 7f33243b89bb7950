"""What judging found that a person should hear: a reference on another clock, a wrong arm, sigmas that are not true."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.aiding.solution import Navigation
from schuler.judging.words import consistency_words
from schuler.studies.places import FAR_M

if TYPE_CHECKING:
    from schuler.studies.inputs import Inputs
    from schuler.studies.model import Study


def judging_notes(study: Study, inputs: Inputs, navigation: Navigation, summary: Mapping[str, Any]) -> list[str]:
    """Sentences on the clock of the reference, the antenna's arm and the consistency, for any kind with a filter."""
    columns = {name: list(table.columns) for name, table in inputs.tables.items()}
    consistency = dict(summary.get("consistency") or {})
    said = reference_notes(study, inputs, navigation)
    elsewhere = bool(said)
    if study.study.kind == "aided":
        said += lever_notes(study, inputs, navigation)
    error = (((summary.get("errors") or {}).get("filter") or {}).get("horizontal_m") or {}).get("rms")
    if elsewhere or (error is not None and error > FAR_M):  # the reference is wrong, so NEES says nothing of the sigmas
        consistency = {k: v for k, v in consistency.items() if not k.startswith("nees")}
    return [*said, *consistency_words(consistency, dict(study.noise), columns)]


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
    """A sentence where the innovations of the fixes say that the antenna's arm is wrong, and it was not estimated."""
    found, gnss = navigation.innovations.get("gnss_position"), inputs.tables.get("gnss")
    track = navigation.filter
    if found is None or gnss is None or "antenna_lever_x" in navigation.states or len(found.time) < 30:
        return []
    if not len(track) or not np.isfinite(track.rpy).all():
        return []
    from schuler.ground.frames import dcm_from_euler
    from schuler.judging.outages import fix_sigma
    from schuler.judging.residuals import lever_correction, lever_words

    rows = np.clip(np.searchsorted(track.time, found.time - 1e-6) - 1, 0, len(track) - 1)
    near = np.clip(
        np.searchsorted(gnss.time, found.time - 0.5 * float(np.median(np.diff(gnss.time)))), 0, len(gnss) - 1
    )
    value, std = (np.full((len(found.time), 3), np.nan) for _ in range(2))
    d = min(found.value.shape[1], 3)
    value[:, :d], std[:, :d] = found.value[:, :d], found.std[:, :d]
    height = navigation.innovations.get("gnss_height")
    if d == 2 and height is not None:
        at = np.searchsorted(found.time, height.time)
        same = (at < len(found.time)) & (np.abs(found.time[np.minimum(at, len(found.time) - 1)] - height.time) < 1e-6)
        value[at[same], 2], std[at[same], 2] = height.value[same, 0], height.std[same, 0]
    fix = np.array([fix_sigma(gnss, int(i), study.noise.gnss_m) for i in near])
    words = lever_words(
        lever_correction(value, dcm_from_euler(*track.rpy[rows].T), std, fix),
        study.mounting.antenna_frd_m,
        float(np.median(np.hypot(fix[:, 0], study.noise.gnss_correlated_m))),
    )
    return [words] if words else []
