"""Kind "auv": an underwater vehicle with fixes at the surface, recorded or simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.judging.result import Result
from schuler.studies.corrected import corrected
from schuler.studies.inputs import (
    Inputs,
    check_gravity,
    check_overlap,
    place_notes,
    read_tables,
    speed_notes,
    to_body,
    withhold,
)
from schuler.studies.judged import judged, swept
from schuler.studies.magnetic import recorded_declination
from schuler.studies.run import DEFAULT_SEED, Progress, made_by, register
from schuler.studies.warm import need

if TYPE_CHECKING:
    from schuler.studies.model import Study

Array = NDArray[np.float64]


@register("auv")
def run(study: Study, *, seed: int | None, progress: Progress) -> Result:
    """Reads or simulates, navigates with [filter] method, judges. See `Result`."""
    from schuler.studies.auv_mapping import check_presets, not_estimated

    check_presets(study)
    simulated = study.mission is not None
    kernels = ("auv_run", "auv_smooth") if study.filter.method == "schuler" else ("paper",)
    if simulated:
        need("mission", "noise", *kernels)
    seed = (DEFAULT_SEED if seed is None else seed) if simulated else None
    inputs = simulate(study, int(seed or 0), progress) if simulated else read_tables(study, progress)
    if not simulated:
        check_overlap(study, inputs, "imu" if "imu" in inputs.tables else "attitude")
        inputs.notes += [*speed_notes(study, inputs.tables), *place_notes(study, inputs)]
    to_body(study, inputs.tables)
    check_gravity(study, inputs.tables)
    tables, withheld, each = withhold(study, inputs)
    if not simulated:
        inputs.declination, said = recorded_declination(study, tables)
        inputs.notes += said
    need(*kernels)  # only now: nobody shall wait for a compiler before hearing that a table cannot be used
    progress("navigating")
    navigation = navigate(study, tables, inputs.declination)
    if len(navigation.filter) == 0:
        raise InputError(
            "the filter gave no row: no fix or start lies inside the recording; schuler check FILE says more"
        )
    progress("judging")
    over, more = swept(study, inputs, lambda others: navigate(study, others, inputs.declination), progress)
    notes = [*inputs.notes, *not_estimated(study), *unread(study), *navigation.notes, *more]
    told = judged(study, made_by(study, seed), navigation, inputs, tables, each, notes)
    if study.sweep is not None:
        told["sweep"] = over
    return Result(
        study=study,
        made_by=made_by(study, seed),
        navigation=navigation,
        reference=inputs.reference,
        truth_states=inputs.truth_states,
        tables=tables,
        withheld=withheld,
        summary=told,
        notes=notes,
    )


def simulate(study: Study, seed: int, progress: Progress) -> Inputs:
    """The tables, reference and true states of [mission]."""
    from schuler.studies.auv_mapping import mission_of, suite_of
    from schuler.truth.recording import simulate as record

    progress("simulating the mission")
    suite = suite_of(study)
    recording = record(mission_of(study), suite, seed=seed)
    declination = recording.declination if suite.magnetometer is not None else None
    tables = dict(recording.tables)
    if "imu" in tables:
        tables["imu"] = corrected(study, tables["imu"])
    return Inputs(tables, recording.truth, dict(recording.truth_states), declination=declination)


def navigate(study: Study, tables: dict[str, Table], declination: float | None = None) -> Navigation:
    """Runs [filter] method over tables in body axes."""
    from schuler.studies.auv_mapping import auv_settings, paper_settings

    if study.filter.method == "schuler":
        from schuler.aiding.auv import navigate as run_schuler

        return run_schuler(tables, auv_settings(study, declination=declination))
    from schuler.aiding.paper import navigate_paper

    return navigate_paper(tables, paper_settings(study))


def unread(study: Study) -> list[str]:
    """Sections and tables that the study names and this kind does not read, as sentences."""
    sections = ("camera", "align", "trajectory", "platform")
    notes = [f'[{name}]: not read by kind "auv"; left out' for name in sections if name in study.model_fields_set]
    known = {"imu", "gnss", "speed", "dvl", "depth", "attitude", "reference"}
    others = [name for name in study.input.tables if name not in known]
    if others:
        notes.append(f'[input] {", ".join(others)}: not used by kind "auv"; left out')
    if study.filter.constraints:
        notes.append(f'[filter] constraints {", ".join(study.filter.constraints)}: not used by kind "auv"; left out')
    if study.filter.method == "paper-literal" and "outage_policy" in study.filter.model_fields_set:
        if study.filter.outage_policy != "paper":
            notes.append(
                f'[filter] outage_policy "{study.filter.outage_policy}": method "paper-literal" has the printed one '
                'only; left out (method "paper" reads it)'
            )
    velocity = [k for k in study.start.model_fields_set if k.startswith(("v_", "std_v_"))]
    if velocity:
        notes.append(f'[start] {", ".join(sorted(velocity))}: kind "auv" finds the velocity itself; left out')
    return notes
