"""Kind "platform": a stable platform aligned at rest, then navigating by several algorithms with the same errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation, Solution
from schuler.ground.earth import wrap_pi
from schuler.ground.tables import Table
from schuler.judging.errors import spread
from schuler.judging.result import Result
from schuler.studies.platform_mapping import (
    DEG,
    algorithms_of,
    case_of,
    check,
    loops_of,
    notes_of,
    section_of,
    walk_of,
)
from schuler.studies.run import DEFAULT_SEED, Progress, made_by, register

if TYPE_CHECKING:
    from schuler.inertial.platform import PlatformCase, PlatformRun, PlatformTruth
    from schuler.judging.platform import AlignmentReport, DriftSet, PlatformDetails
    from schuler.studies.model import PlatformSection, Study

Array = NDArray[np.float64]


@register("platform")
def run(study: Study, *, seed: int | None, progress: Progress) -> Result:
    """Aligns, navigates with every algorithm, each channel's drift alone and all together, judges. See `Result`."""
    from schuler.inertial import platform as inertial
    from schuler.judging.platform import ErrorMap, PlatformDetails, drift_sets

    p = section_of(study)
    check(p)
    case = case_of(p)
    algorithms = algorithms_of(p)
    at = tuple(t for t in p.at_s if t <= p.duration_s) or (p.duration_s,)
    time = inertial.nodes(case, at=at)
    sigma = walk_of(p)
    drawn = any(s != 0.0 for s in sigma)
    seed = (DEFAULT_SEED if seed is None else seed) if drawn else None
    walk = inertial.drift_walk(time, sigma, np.random.default_rng(seed)) if drawn else None
    progress("aligning")
    alignment = aligned(p, case)
    progress("navigating")
    sets = drift_sets(case, algorithms, p.form, time, walk)
    progress("sensitivities")
    sensitivity_at = tuple(t for t in (3600.0, 7200.0) if t <= case.duration) or (case.duration,)
    compared = tuple(a for a in algorithms if a != "as-published")
    sensitivities: dict[str, list[tuple[str, str, Array]]] = {
        a: inertial.sensitivity(case, a, p.form, sensitivity_at) for a in compared
    }
    maps = []
    if p.map is not None:
        lat = _grid(p.map.lat_deg)
        heading = _grid(p.map.heading_deg)
        for algorithm in algorithms:
            progress(f"map of {len(lat)} x {len(heading)} cases, {algorithm}")
            error = inertial.error_map(case, lat, heading, algorithm, p.form, (case.duration,))
            maps.append(ErrorMap(algorithm, case.duration, lat, heading, error[:, :, 0]))
    progress("judging")
    truth = inertial.truth_of(case, time)
    main = sets[-1].runs[algorithms[0]]
    track = _fine(study, main, walk)
    track_truth = truth if track is main else inertial.truth_of(case, track.time)
    q_ib = body(p, track_truth)
    q_ib_coarse = q_ib if track is main else body(p, truth)
    shown = next((r for r in sets[-1].runs.values() if r.has_platform), None)
    gimbals = inertial.gimbal_angles(shown.q_iS, q_ib_coarse) if shown is not None else np.full((len(time), 3), np.nan)
    notes = notes_of(study, p, case)
    notes += list(dict.fromkeys(n for s in sets for r in s.runs.values() for n in r.notes))
    if shown is not None and (lock := inertial.gimbal_warning(time, gimbals)) is not None:
        notes.append(lock)
    details = PlatformDetails(
        case=case,
        form=p.form,
        algorithms=algorithms,
        at=at,
        sets=sets,
        truth=truth,
        gimbals=gimbals,
        alignment=alignment,
        sensitivity_at=sensitivity_at,
        sensitivity=sensitivities,
        maps=maps,
    )
    solution = solution_of(track, track_truth, q_ib)
    reference = reference_of(track_truth, q_ib)
    made = made_by(study, seed)
    return Result(
        study=study,
        made_by=made,
        navigation=Navigation(filter=solution),
        reference=reference,
        truth_states={},
        tables={},
        withheld={},
        summary=told(study, made, details, track, solution, reference, notes),
        notes=notes,
        details=details,
    )


def _grid(spec: tuple[float, ...]) -> Array:
    low, high, count = spec
    return np.linspace(low, high, round(count)) * DEG


def _fine(study: Study, main: PlatformRun, walk: Array | None) -> PlatformRun:
    """The first algorithm at the rows that [output] rate_hz asks for; the nodes themselves where it does not."""
    from schuler.inertial import platform as inertial

    rate = study.output.rate_hz
    if not isinstance(rate, float | int):
        return main
    count = max(1, round(main.case.duration * rate))
    every = max(1, math.ceil(main.case.duration / count / inertial.STEP - 1e-9))
    time = np.linspace(0.0, main.case.duration, count * every + 1)
    added = None if walk is None else np.column_stack([np.interp(time, main.time, walk[:, k]) for k in range(3)])
    run = inertial.navigate(main.case, main.algorithm, main.form, time=time, walk=added)
    if every > 1:
        run = type(run)(
            run.case, run.algorithm, run.form, run.code, time[::every], run.states[::every], run.error[::every],
            run.north[::every], run.east[::every], run.notes,
        )  # fmt: skip
    return run


def aligned(p: PlatformSection, case: PlatformCase) -> AlignmentReport:
    """Loops, their transient from a rough start, requirements, end values and the switch."""
    from schuler.inertial import platform_alignment as alignment
    from schuler.judging.platform import AlignmentReport

    a = p.alignment
    levelling, azimuth = loops_of(p)
    asked = {
        "settling_s": a.settling_s,
        "overshoot_percent": a.overshoot_percent,
        "steady_percent": a.steady_percent,
        "phase_margin_deg": a.phase_margin_deg,
        "gain_margin_db": a.gain_margin_db,
    }
    verdicts = [
        (loop, v) for loop in (levelling, azimuth) for v in alignment.judge(loop, duration=a.duration_s, **asked)
    ]
    return AlignmentReport(
        levelling=levelling,
        azimuth=azimuth,
        run=alignment.align(case, levelling, azimuth, a.duration_s, start=(0.5 * DEG, -0.5 * DEG, 2.0 * DEG)),
        end=alignment.end_values(case),
        first_order=alignment.end_values_first_order(case),
        verdicts=verdicts,
        jumps=alignment.switch(case),
        gain_ratio=alignment.integral_gain_ratio(levelling),
    )


def body(p: PlatformSection, truth: PlatformTruth) -> Array:
    """(n, 4) attitude of the body, forward left up."""
    from schuler.inertial.platform import body_attitude

    psi = (p.heading_deg if p.body_heading_deg is None else p.body_heading_deg) * DEG
    swing = np.sin(2.0 * np.pi * truth.time / p.body_period_s) if p.body_period_s > 0.0 else np.ones_like(truth.time)
    return body_attitude(truth, psi, roll=p.body_roll_deg * DEG * swing, pitch=p.body_pitch_deg * DEG * swing)


def _map_latitude(case: PlatformCase, lat: Array, height: Array) -> Array:
    """Geodetic latitude on the ellipsoid; on the sphere the mass latitude itself."""
    from schuler.truth.platform import geodetic_from_mass

    return geodetic_from_mass(lat, height) if case.earth == "ellipsoid" else lat


def _rpy(q_ib: Array, lat: Array, lon: Array, time: Array) -> Array:
    """(n, 3) roll, pitch, heading (rad) of a body forward-left-up at map latitude and longitude."""
    from schuler.ground.earth import OMEGA
    from schuler.ground.frames import euler_from_quat, quat_conjugate, quat_multiply
    from schuler.kernels.platform_truth import quat_local

    q_in = np.array([quat_local(a, b) for a, b in zip(lat, lon + OMEGA * time, strict=True)])
    q = quat_multiply(quat_conjugate(q_in), q_ib) * np.array([1.0, 1.0, -1.0, -1.0])  # NED and FRD
    return np.column_stack(euler_from_quat(q))


def solution_of(run: PlatformRun, truth: PlatformTruth, q_ib: Array) -> Solution:
    """The track of one algorithm; attitude through platform and gimbals, NaN where the algorithm has none."""
    from schuler.ground.frames import quat_conjugate, quat_multiply

    n = len(run.time)
    lat = _map_latitude(run.case, run.lat, truth.height)
    rpy = np.full((n, 3), np.nan)
    if run.algorithm != "as-published":
        attitude = run.q_iS_believed
        if run.has_platform:
            # the azimuth gimbal is read with its bias: C_bS as measured = C_bS C3(-bias)
            half = 0.5 * run.case.gimbal_bias
            bias = np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
            read = quat_multiply(np.broadcast_to(bias, (n, 4)), quat_multiply(quat_conjugate(run.q_iS), q_ib))
            attitude = quat_multiply(attitude, read)
        rpy = _rpy(attitude, lat, run.lon, run.time)
    unknown = np.full((n, 3, 3), np.nan)
    return Solution(
        time=run.time,
        lat=lat,
        lon=run.lon,
        height=truth.height,
        v_n=np.column_stack([run.velocity, -truth.v_up]),
        rpy=rpy,
        cov_pos=unknown,
        cov_vel=unknown,
        cov_rpy=unknown,
    )


def reference_of(truth: PlatformTruth, q_ib: Array) -> Table:
    """The motion itself, as a reference table."""
    rpy = _rpy(q_ib, truth.lat_geodetic, truth.lon, truth.time)
    columns = {
        "time": truth.time,
        "lat": truth.lat_geodetic,
        "lon": np.asarray(wrap_pi(truth.lon)),
        "height": truth.height,
        "v_north": truth.v_ne[:, 0],
        "v_east": truth.v_ne[:, 1],
        "v_down": -truth.v_up,
        "roll": rpy[:, 0],
        "pitch": rpy[:, 1],
        "heading": np.mod(rpy[:, 2], 2.0 * np.pi),
    }
    return Table("reference", columns, source="the simulated motion")


def rows(found: DriftSet, at: tuple[float, ...]) -> list[dict[str, Any]]:
    """The contract's list for one choice of drifts."""
    told = []
    for algorithm, run in found.runs.items():
        e = run.at(at)
        row = {
            "algorithm": algorithm,
            "at_s": list(at),
            "error_m": e[:, 0].tolist(),
            "north_m": e[:, 1].tolist(),
            "east_m": e[:, 2].tolist(),
            "largest_m": found.largest(algorithm),
        }
        if algorithm == "position-independent":
            row["form"] = run.form
        told.append(row)
    return told


def told(
    study: Study,
    made: dict[str, Any],
    details: PlatformDetails,
    track: PlatformRun,
    solution: Solution,
    reference: Table,
    notes: list[str],
) -> dict[str, Any]:
    """The content of summary.json."""
    from schuler.judging.platform import equalities

    attitude = np.abs(wrap_pi(solution.rpy - reference.stack("roll", "pitch", "heading"))) / DEG
    velocity = np.linalg.norm(solution.v_n - reference.stack("v_north", "v_east", "v_down"), axis=1)
    errors = {
        "horizontal_m": spread(track.error),
        "vertical_m": None,
        "velocity_mps": spread(velocity),
        "roll_deg": spread(attitude[:, 0]),
        "pitch_deg": spread(attitude[:, 1]),
        "heading_deg": spread(attitude[:, 2]),
    }
    a = details.alignment
    return {
        "study": {"name": study.study.name, "kind": study.study.kind},
        "made_by": made,
        "duration_s": details.case.duration,
        "method": f"{track.algorithm}, {track.form}" if track.algorithm == "position-independent" else track.algorithm,
        "errors": {"filter": errors, "smoother": None},
        "consistency": None,  # nothing here states its own uncertainty
        "platform": rows(details.main, details.at),
        "platform_drift_sets": [{"drift": s.name, "algorithms": rows(s, details.at)} for s in details.sets],
        "theory": [
            {
                "drift": s.name,
                "formula": c.label,
                "kind": c.kind,
                "at_s": list(details.at),
                "error_m": np.interp(details.at, c.time, c.error).tolist(),
            }
            for s in details.sets
            for c in s.curves
        ],
        "alignment": {
            "phi_x_rad": a.end.phi_x,
            "phi_y_rad": a.end.phi_y,
            "psi_deg": a.end.psi / DEG,
            "rates_rad_per_s": a.end.rates.tolist(),
            "commands_rad_per_s": a.end.commands.tolist(),
            "integral_gain_over_navigation": a.gain_ratio,
            "loops": [
                {
                    "loop": loop.name,
                    "k_p": loop.kp,
                    "k_i": loop.ki,
                    "poles_per_s": [[float(x.real), float(x.imag)] for x in loop.poles],
                    "overshoot_percent": loop.response().overshoot_percent,
                    "settling_s": loop.response().settling_s,
                    "phase_margin_deg": loop.response().phase_margin_deg,
                    "gain_margin_db": loop.response().gain_margin_db,
                }
                for loop in (a.levelling, a.azimuth)
            ],
            "requirements": [
                {
                    "loop": loop.name,
                    "what": v.what,
                    "unit": v.unit,
                    "required": v.required,
                    "reached": v.reached,
                    "met": v.met,
                    "in_hand": v.in_hand,
                }
                for loop, v in a.verdicts
            ],
        },
        "sensitivity": [
            {"algorithm": name, "error": error, "per": unit, "at_s": list(details.sensitivity_at), "m": m.tolist()}
            for name, table in details.sensitivity.items()
            for error, unit, m in table
        ],
        "map": [
            {
                "algorithm": m.algorithm,
                "at_s": m.at,
                "lat_deg": np.round(m.lat / DEG, 9).tolist(),
                "heading_deg": np.round(m.heading / DEG, 9).tolist(),
                "error_m": m.error.tolist(),
            }
            for m in details.maps
        ],
        "said": equalities(details),
        "notes": notes,
    }
