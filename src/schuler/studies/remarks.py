"""What judging found that a person should hear: a reference on another clock, sigmas that are not true."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from schuler.aiding.solution import Navigation
from schuler.judging.words import consistency_words
from schuler.studies.places import FAR_M

if TYPE_CHECKING:
    from schuler.studies.inputs import Inputs
    from schuler.studies.model import Study


def judging_notes(study: Study, inputs: Inputs, navigation: Navigation, summary: Mapping[str, Any]) -> list[str]:
    """Sentences on the clock of the reference and on the consistency, for any kind with a track."""
    columns = {name: list(table.columns) for name, table in inputs.tables.items()}
    consistency = dict(summary.get("consistency") or {})
    said = reference_notes(study, inputs, navigation)
    error = (((summary.get("errors") or {}).get("filter") or {}).get("horizontal_m") or {}).get("rms")
    if said or (error is not None and error > FAR_M):  # the reference is wrong, so NEES says nothing of the sigmas
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
