"""Kind "auv": an underwater vehicle with fixes at the surface, recorded or simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.judging import consistency, outages
from schuler.judging.distrust import distrusted
from schuler.judging.errors import circular, distance, error_series, summary
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
from schuler.studies.magnetic import recorded_declination
from schuler.studies.remarks import judging_notes
from schuler.studies.run import DEFAULT_SEED, Progress, made_by, register
from schuler.studies.warm import need

if TYPE_CHECKING:
    from schuler.studies.model import OutageSection, Study

Array = NDArray[np.float64]
SURFACE_M = 3.0  # a gap without fixes in which the vehicle stayed above this was no dive


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
    over, more = swept(study, inputs, progress)
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


def judged(
    study: Study,
    made: dict[str, Any],
    navigation: Navigation,
    inputs: Inputs,
    tables: dict[str, Table],
    each: list[tuple[OutageSection, Table]],
    notes: list[str],
) -> dict[str, Any]:
    """The content of summary.json. What judging found that should be said is added to notes."""
    arm = study.mounting.reference_frd_m  # a simulation follows it too
    reference = inputs.reference
    series = smooth = None
    if reference is not None:
        series = error_series(navigation.filter, reference, arm)
        if navigation.smoother is not None:
            smooth = error_series(navigation.smoother, reference, arm)
    gnss = tables.get("gnss")
    fix = _fix(study)
    track = navigation.smoother or navigation.filter
    length = distance(reference["lat"], reference["lon"]) if reference is not None else distance(track.lat, track.lon)
    found = outages.surfacings(navigation, gnss, depth=inputs.tables.get("depth"), **fix)
    told: dict[str, Any] = {
        "study": {"name": study.study.name, "kind": study.study.kind},
        "made_by": made,
        "method": study.filter.method,
        "duration_s": float(navigation.filter.time[-1] - navigation.filter.time[0]),
        "distance_m": length,
        "errors": {"filter": summary(series), "smoother": summary(smooth) if navigation.smoother is not None else None},
        "circular": {
            "filter": None if series is None else circular(series.horizontal),
            "smoother": None if smooth is None else circular(smooth.horizontal),
        },
        "consistency": consistency.consistency(series, navigation.innovations),
        "outages": [outage_of(study, reference, navigation, o.sensor, rows, o.start_s, o.end_s) for o, rows in each],
        "dives": outages.dives(navigation, gnss, reference, reference_frd=arm),
        "surfacings": [f for f in found if f["max_depth_m"] is None or f["max_depth_m"] > SURFACE_M],
        "surface_gaps": [f for f in found if f["max_depth_m"] is not None and f["max_depth_m"] <= SURFACE_M],
        "states": states(navigation, inputs.truth_states),
        "distrusted": distrusted(navigation.innovations),
        "notes": notes,
    }
    notes += judging_notes(study, inputs, navigation, told)
    return told


def _fix(study: Study) -> dict[str, Any]:
    """What a fix is like: its sigma where std_ is absent, its slow error, where the antenna is."""
    correlated = study.noise.gnss_correlated_m if study.filter.method == "schuler" else 0.0
    return {"gnss_m": study.noise.gnss_m, "correlated_m": correlated, "antenna_frd": study.mounting.antenna_frd_m}


def outage_of(
    study: Study, reference: Table | None, navigation: Navigation, sensor: str, rows: Table, start: float, end: float
) -> dict[str, Any]:
    """One entry of "outages" of summary.json."""
    return outages.outage(
        navigation,
        rows,
        sensor,
        start,
        end,
        reference,
        reference_frd=study.mounting.reference_frd_m,
        delay=study.input.gnss_delay_s,
        **_fix(study),
    )


def swept(study: Study, inputs: Inputs, progress: Progress) -> tuple[list[dict[str, Any]], list[str]]:
    """ "sweep" of summary.json; [[outage]] has no part in it."""
    from schuler.studies.sweep import sweep

    if study.sweep is None:
        return [], []
    sensor = study.sweep.sensor
    if sensor not in inputs.tables:
        return [], [f"[sweep] sensor: there is no {sensor} table to withhold rows from; left out"]
    return sweep(
        inputs.tables,
        sensor,
        study.sweep.length_s,
        study.sweep.settle_s,
        lambda tables: navigate(study, tables, inputs.declination),
        lambda navigation, rows, a, b: outage_of(study, inputs.reference, navigation, sensor, rows, a, b),
        progress,
    )


def states(navigation: Navigation, truth: dict[str, tuple[Array, Array]]) -> dict[str, Any]:
    """What was learnt, at the end: {"unit", "value", "std", "truth"} of each state, SI."""
    told = {}
    for name, history in navigation.states.items():
        if len(history.time) == 0:
            continue
        true = None
        if name in truth:
            true = float(np.interp(history.time[-1], *truth[name]))
        told[name] = {
            "unit": history.unit,
            "value": float(history.value[-1]),
            "std": float(history.std[-1]),
            "truth": true,
        }
    return told
