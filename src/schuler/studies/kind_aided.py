"""Kind "aided": an INS with GNSS, speed, DVL, depth, height, compass, ranges; recorded or simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation
from schuler.ground.errors import InputError, StudyError
from schuler.ground.tables import Table
from schuler.judging import outages
from schuler.judging.result import Result
from schuler.studies.arm_notes import second_look
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
from schuler.studies.optics_notes import optics_notes
from schuler.studies.run import DEFAULT_SEED, Progress, made_by, register
from schuler.studies.warm import need

if TYPE_CHECKING:
    from schuler.aiding.aided_settings import AidedSettings
    from schuler.studies.model import Study
    from schuler.truth.aided import AidedRecording

Array = NDArray[np.float64]
KERNELS = ("aided_run", "aided_smooth")


@register("aided")
def run(study: Study, *, seed: int | None, progress: Progress) -> Result:
    """Reads or simulates, navigates, judges. See `Result`."""
    from schuler.aiding.aided import settled
    from schuler.studies.aided_mapping import aided_settings, unread
    from schuler.studies.auv_mapping import check_presets

    check_presets(study)
    simulated = not [name for name in study.input.tables if name != "reference"]
    seed = (DEFAULT_SEED if seed is None else seed) if simulated else None
    inputs, settings = recorded(study, progress) if not simulated else simulate(study, int(seed or 0), progress)
    to_body(study, inputs.tables)
    check_gravity(study, inputs.tables)
    tables, withheld, each = withhold(study, inputs)
    if settings is None:
        inputs.declination, said = recorded_declination(study, tables)
        inputs.notes += said
        settings = aided_settings(study, declination=inputs.declination)
    settings, said = settled(inputs.tables, settings)
    inputs.notes += said
    need(*KERNELS)
    progress("navigating")
    navigation = navigate(tables, settings)
    progress("judging")

    def judge(navigation: Navigation, *outage: Any) -> dict[str, Any]:
        return outage_of(study, inputs.reference, navigation, *outage)

    over, more = swept(study, inputs, lambda others: navigate(others, settings), progress, judge)
    more += optics_notes(study, tables, navigation, lambda others: navigate(others, settings))
    notes = [*inputs.notes, *unread(study), *navigation.notes, *more]
    made = made_by(study, seed)
    told = judged(study, made, navigation, inputs, tables, each, notes, judge)
    if "gnss" in tables and not any("antenna_frd_m" in note for note in notes):
        notes += second_look(navigation, settings, lambda other: navigate(tables, other))
    if study.sweep is not None:
        told["sweep"] = over
    return Result(
        study=study,
        made_by=made,
        navigation=navigation,
        reference=inputs.reference,
        truth_states=inputs.truth_states,
        tables=tables,
        withheld=withheld,
        summary=told,
        notes=notes,
    )


def recorded(study: Study, progress: Progress) -> tuple[Inputs, AidedSettings | None]:
    """The tables of [input]."""
    inputs = read_tables(study, progress)
    if "imu" not in inputs.tables:
        raise StudyError('[input] imu is absent: kind "aided" needs an IMU; type imu = "imu.csv"')
    check_overlap(study, inputs, "imu")
    inputs.notes += [*speed_notes(study, inputs.tables), *place_notes(study, inputs)]
    return inputs, None


def simulate(study: Study, seed: int, progress: Progress) -> tuple[Inputs, AidedSettings]:
    """Tables, reference and true states of [trajectory] and [simulate]; settings that begin at its start."""
    from schuler.studies.simulated import simulation

    need("motion", "noise")
    reference = None
    if "reference" in study.input.tables:
        reference = read_tables(study, progress).reference
    progress("simulating")
    recording = simulation(study, reference).record(seed)
    settings = started(study, recording)
    tables = dict(recording.tables)
    tables["imu"] = corrected(study, tables["imu"])
    inputs = Inputs(tables, recording.reference, dict(recording.truth_states), notes=list(recording.notes))
    return inputs, settings


def started(study: Study, recording: AidedRecording) -> AidedSettings:
    """The filter's settings, beginning where the simulated recording says."""
    from schuler.studies.aided_mapping import aided_settings

    settings = aided_settings(study, declination=recording.declination)
    given, found = settings.start, recording.start
    std = [float(x) for x in found.std]
    if study.simulate is not None and study.simulate.start is not None:  # what the filter believes is not what is so
        typed = (*given.std_pos, *given.std_vel, given.std_roll, given.std_pitch, given.std_heading)
        std = [float(x or 0.0) for x in typed]
    return replace(
        settings,
        start=replace(
            given, time=found.time, lat=found.lat, lon=found.lon, height=found.height,
            v_n=(float(found.v_n[0]), float(found.v_n[1]), float(found.v_n[2])), roll=float(found.rpy[0]),
            pitch=float(found.rpy[1]), heading=float(found.rpy[2]), std_pos=(std[0], std[1], std[2]),
            std_vel=(std[3], std[4], std[5]), std_roll=std[6], std_pitch=std[7], std_heading=std[8],
        ),
    )  # fmt: skip


def navigate(tables: dict[str, Table], settings: AidedSettings) -> Navigation:
    """The filter and its smoother over tables in body axes; InputError where it gave no row."""
    from schuler.aiding.aided import navigate as run_aided

    navigation = run_aided(tables, settings)
    if len(navigation.filter) == 0:
        raise InputError(
            "the filter gave no row: no fix or start lies inside the recording; schuler check FILE says more"
        )
    return navigation


def outage_of(
    study: Study, reference: Table | None, navigation: Navigation, sensor: str, rows: Table, start: float, end: float
) -> dict[str, Any]:
    """One entry of "outages": withheld fixes are judged with the delay and the arm that the filter knew then."""
    delay = study.input.gnss_delay_s
    history = navigation.states.get("gnss_delay")
    if history is not None and len(history.time):
        delay = float(np.interp(end, history.time, history.value))
    arm = list(study.mounting.antenna_frd_m)
    for i, axis in enumerate("xyz"):
        state = navigation.states.get(f"antenna_lever_{axis}")
        if state is not None and len(state.time):
            arm[i] = float(np.interp(end, state.time, state.value))
    correlated = study.noise.gnss_correlated_m
    return outages.outage(
        navigation, rows, sensor, start, end, reference, reference_frd=study.mounting.reference_frd_m, delay=delay,
        gnss_m=study.noise.gnss_m, correlated_m=correlated, antenna_frd=arm,
    )  # fmt: skip
