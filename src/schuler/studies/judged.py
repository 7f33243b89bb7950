"""summary.json of the kinds with a filter: errors, outages, sweeps, what was learnt."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation
from schuler.ground.tables import Table
from schuler.judging import consistency, outages
from schuler.judging.distrust import distrusted
from schuler.judging.errors import circular, distance, error_series, summary
from schuler.studies.inputs import Inputs
from schuler.studies.remarks import judging_notes
from schuler.studies.run import Progress

if TYPE_CHECKING:
    from schuler.studies.model import OutageSection, Study

Array = NDArray[np.float64]
Judge = Callable[[Navigation, str, Table, float, float], dict[str, Any]]
SURFACE_M = 3.0  # a gap without fixes in which the vehicle stayed above this was no dive


def judged(
    study: Study,
    made: dict[str, Any],
    navigation: Navigation,
    inputs: Inputs,
    tables: dict[str, Table],
    each: list[tuple[OutageSection, Table]],
    notes: list[str],
    judge: Judge | None = None,
) -> dict[str, Any]:
    """The content of summary.json. What judging found that should be said is added to notes.

    judge: what makes an entry of "outages" of navigation, sensor, withheld rows, start and end; None: `outage_of`.
    """
    judge = judge or (lambda *outage: outage_of(study, inputs.reference, *outage))
    arm = study.mounting.reference_frd_m  # a simulation follows it too
    reference = inputs.reference
    series = smooth = None
    if reference is not None:
        series = error_series(navigation.filter, reference, arm)
        if navigation.smoother is not None:
            smooth = error_series(navigation.smoother, reference, arm)
    gnss = tables.get("gnss")
    fix = fix_of(study)
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
        "outages": [judge(navigation, o.sensor, rows, o.start_s, o.end_s) for o, rows in each],
        "dives": outages.dives(navigation, gnss, reference, reference_frd=arm),
        "surfacings": [f for f in found if f["max_depth_m"] is None or f["max_depth_m"] > SURFACE_M],
        "surface_gaps": [f for f in found if f["max_depth_m"] is not None and f["max_depth_m"] <= SURFACE_M],
        "states": states(navigation, inputs.truth_states),
        "distrusted": distrusted(navigation.innovations),
        "notes": notes,
    }
    notes += judging_notes(study, inputs, navigation, told)
    return told


def fix_of(study: Study) -> dict[str, Any]:
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
        **fix_of(study),
    )


def swept(
    study: Study,
    inputs: Inputs,
    navigate: Callable[[dict[str, Table]], Navigation],
    progress: Progress,
    judge: Judge | None = None,
) -> tuple[list[dict[str, Any]], list[str]]:
    """ "sweep" of summary.json, and notes; [[outage]] has no part in it. judge: as of `judged`."""
    from schuler.studies.sweep import sweep

    judge = judge or (lambda *outage: outage_of(study, inputs.reference, *outage))
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
        navigate,
        lambda navigation, rows, a, b: judge(navigation, sensor, rows, a, b),
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
