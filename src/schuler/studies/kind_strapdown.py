"""Kind "strapdown": free inertial navigation, simulated from a trajectory or from a recording, and how its error grows.

Simulated: exact truth, the errors of [imu] (drawn) and [errors] (fixed), the mechanization, and beside its error the
linear model, the closed form at rest and the numerical floor of the same run without errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation, Solution
from schuler.ground.earth import WGS84, Ellipsoid
from schuler.ground.errors import StudyError
from schuler.ground.tables import Table
from schuler.judging import consistency
from schuler.judging.errors import circular, distance, error_series, spread, summary
from schuler.judging.result import Result
from schuler.studies.corrected import corrected
from schuler.studies.inputs import check_gravity, check_overlap, place_notes, read_tables, to_body
from schuler.studies.run import DEFAULT_SEED, Progress, made_by, register
from schuler.studies.strapdown_start import Found, start_of

if TYPE_CHECKING:
    from schuler.inertial.error_dynamics import SensorNoise
    from schuler.inertial.strapdown import Start, Track
    from schuler.studies.model import Study
    from schuler.truth.instruments import ImuModel
    from schuler.truth.trajectories import Trajectory

Array = NDArray[np.float64]
D = math.pi / 180.0
PAIRS = ("north", "east")
POLAR = 89.0 * D


@dataclass
class Run:
    """What either way of running gives: the track at the output rate and what it is judged against."""

    track: Track
    earth: Ellipsoid
    tables: dict[str, Table]
    reference: Table | None = None
    truth_states: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    told: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    found: Found | None = None  # how a recording's start was found
    begin: Track | None = None  # one row: the start itself, before the first row of the track


@register("strapdown")
def run(study: Study, *, seed: int | None, progress: Progress) -> Result:
    """Simulates [trajectory] or reads [input] imu, navigates by inertia alone, judges. See `Result`."""
    simulated = not study.input.tables
    seed = (DEFAULT_SEED if seed is None else seed) if simulated else None
    model = imu_model(study)
    done = simulate(study, model, int(seed or 0), progress) if simulated else recorded(study, progress)
    progress("covariance")
    held = study.filter.vertical != "free"
    cov = covariances(study, model, done, held)
    track = done.track
    navigation = Navigation(Solution(track.time, track.lat, track.lon, track.height, track.v_n, track.rpy, *cov))
    progress("judging")
    notes = [*done.notes, *track.notes, *unread(study)]
    if done.earth is not WGS84 and simulated:
        notes.append(
            "the figures of position error are drawn in metres of WGS-84, the numbers are of the sphere: 0.3 %"
        )
    made = made_by(study, seed)
    return Result(
        study=study,
        made_by=made,
        navigation=navigation,
        reference=done.reference,
        truth_states=done.truth_states,
        tables=done.tables,
        withheld={},
        summary=judged(study, made, navigation, done, notes),
        notes=notes,
    )


def imu_model(study: Study) -> ImuModel:
    """The instrument of [imu] with the fixed biases of [errors]."""
    from schuler.truth.keys import imu_from_keys

    given = study.imu.model_dump(exclude_none=True) if study.imu is not None else {}
    fixed = study.errors.model_dump(exclude_none=True) if study.errors is not None else {}
    return imu_from_keys(given, fixed)


def trajectory_of(study: Study) -> Trajectory:
    """The trajectory of [trajectory], beginning at [start]."""
    from schuler.studies.model import TrajectorySection
    from schuler.truth import trajectories as shapes

    t, s = study.trajectory or TrajectorySection(), study.start
    if s.lat_deg is None:
        raise StudyError("[start] lat_deg is absent: a simulated trajectory begins there; type lat_deg = 50.0")
    earth = WGS84 if t.earth == "wgs84" else shapes.TEXTBOOK
    place = (s.lat_deg * D, (s.lon_deg or 0.0) * D, s.height_m or 0.0)
    heading = (s.heading_deg or 0.0) * D
    angles: dict[str, Any] = {"roll": (s.roll_deg or 0.0) * D, "pitch": (s.pitch_deg or 0.0) * D}
    common: dict[str, Any] = {"duration": t.duration_s, "earth": earth}
    moving = {"speed": t.speed_mps, "heading": heading, **common}
    if t.preset == "rest":
        made = shapes.rest(*place, heading=heading, roll=angles["roll"], pitch=angles["pitch"], **common)
    elif t.preset == "legs":
        made = shapes.legs(
            *place, turns=[x * D for x in t.turns_deg], climbs=t.climbs_m, turn_rate=t.turn_rate_deg_per_s * D,
            climb_rate=t.climb_rate_mps, turns_at=t.turns_at_s, **moving,
        )  # fmt: skip
    elif t.preset in ("car", "flight"):
        made = lively(study, place, heading, earth)
    elif t.preset == "great-circle":
        made = shapes.great_circle(*place, **moving)
    elif t.preset == "rhumb-line":
        made = shapes.rhumb_line(*place, **moving)
    elif t.preset == "dive":
        made = shapes.dive(*place, depth=t.depth_m, **moving)
    elif t.preset == "oscillation":
        roll, pitch, yaw = (x * D for x in t.swing_deg)
        speed = t.speed_mps if "speed_mps" in t.model_fields_set else 0.0
        made = shapes.oscillation(
            *place, roll=roll, pitch=pitch, heading=yaw, rate=2.0 * math.pi * t.swing_hz, phase=t.swing_phase_deg * D,
            mean_heading=heading, speed=speed, **common,
        )  # fmt: skip
    elif t.preset == "coning":
        made = shapes.coning(*place, cone=t.cone_deg * D, frequency=t.cone_hz, heading=heading, **common)
    elif t.preset == "turntable":
        made = shapes.turntable(*place, rate=t.table_deg_per_s * D, heading=heading, **common)
    else:
        raise StudyError(
            '[trajectory] preset = "track" follows the reference of [input]: name it there, as reference = "truth.csv"'
        )
    return made


def lively(study: Study, place: tuple[float, float, float], heading: float, earth: Ellipsoid) -> Trajectory:
    """ "car" or "flight", each with its own speed and standing time where none is typed."""
    from schuler.truth import manoeuvres

    t = study.trajectory
    assert t is not None
    chosen: dict[str, Any] = {"duration": t.duration_s, "heading": heading, "variety": t.variety, "earth": earth}
    if "speed_mps" in t.model_fields_set:
        chosen["speed"] = t.speed_mps
    if t.stand_s is not None:
        chosen["stand"] = t.stand_s
    return (manoeuvres.car if t.preset == "car" else manoeuvres.flight)(*place, **chosen)


def track_of(study: Study, reference: Table) -> Trajectory:
    """A smooth curve through the rows of a reference table."""
    from schuler.truth.trajectories import TEXTBOOK, track

    rpy = None
    if all(c in reference for c in ("roll", "pitch", "heading")):
        rpy = reference.stack("roll", "pitch", "heading")
    earth = TEXTBOOK if study.trajectory is not None and study.trajectory.earth == "sphere" else WGS84
    return track(reference.time, reference["lat"], reference["lon"], reference["height"], rpy, earth=earth)


def stride_of(study: Study, rate: float) -> int:
    """Every how many IMU rows one is written."""
    wanted = study.output.rate_hz
    if wanted == "imu":
        return 1
    return max(1, round(rate / min(float(wanted or 10.0), rate)))


def simulate(study: Study, model: ImuModel, seed: int, progress: Progress, made: Trajectory | None = None) -> Run:
    """Truth, measured IMU, navigation, and the same by the linear model, the closed form and without any error."""
    from schuler.inertial import error_dynamics
    from schuler.inertial.ecef import StrapdownEcef
    from schuler.inertial.strapdown import Start, Strapdown
    from schuler.studies.model import TrajectorySection
    from schuler.truth.imu_errors import measure

    made = made or trajectory_of(study)
    rate = (study.trajectory or TrajectorySection()).rate_hz
    every = stride_of(study, rate)
    held = study.filter.vertical != "free"
    progress("exact truth and ideal IMU")
    level = bool(np.all(made.coefs[:, 1, :8] == 0.0)) and not np.any(made.waves[:, :1] == 1.0) and made.name != "track"
    need_all = held and not level
    ideal = made.ideal(rate, every=1 if need_all else every)
    truth = ideal.truth
    aids: dict[str, Any] = {}
    if need_all:
        aids = {"height": truth.height.copy(), "v_down": truth.v_n[:, 2].copy()}
        rows = slice(every - 1, None, every)
        truth = type(truth)(*(getattr(truth, k)[rows] for k in truth.__dataclass_fields__))
    progress("instrument errors")
    measured = measure(ideal, model, seed=seed)
    fixed = corrected(study, measured.table())
    if study.imu is not None and study.imu.calibration is not None:
        measured = replace(
            measured, dtheta=fixed.stack("dtheta_x", "dtheta_y", "dtheta_z"), dv=fixed.stack("dv_x", "dv_y", "dv_z")
        )  # fmt: skip
    start = Start.of(ideal.start)
    progress("navigating")
    vertical: Literal["free", "held"] = "held" if held else "free"

    def navigate(dtheta: Array, dv: Array) -> Track:
        form = StrapdownEcef if study.filter.frame == "ecef" else Strapdown
        ins = form(start, earth=made.earth, vertical=vertical)
        return ins.feed(dtheta, dv, ideal.dt, every=every, **aids)

    track = navigate(measured.dtheta, measured.dv)
    clean = navigate(ideal.dtheta, ideal.dv)
    track = _at(track, truth.time)
    progress("linear model")
    u = np.hstack([measured.dv - ideal.dv, measured.dtheta - ideal.dtheta])
    n = len(truth) * every
    u = u[:n].reshape(len(truth), every, 6).sum(axis=1) / (every * ideal.dt)
    whole = _with_start(ideal.start, truth)
    polar = bool(np.max(np.abs(whole.lat)) > POLAR)
    linear = None
    if not polar:
        linear = error_dynamics.propagate(whole, accel_error=u[:, :3], gyro_error=u[:, 3:], earth=made.earth, held=held)
    run_errors = track.minus(truth, made.earth)
    floor = _at(clean, truth.time).minus(truth, made.earth)
    states = {f"error_{p}": (truth.time, run_errors.position[:, i]) for i, p in enumerate((*PAIRS, "down"))}
    angles = ("tilt_north", "tilt_east", "azimuth")
    states |= {f"error_{axis}": (truth.time, run_errors.phi[:, i]) for i, axis in enumerate(angles)}
    if linear is not None:
        states |= {f"linear_{p}": (whole.time, linear.position[:, i]) for i, p in enumerate((*PAIRS, "down"))}
        states |= {f"linear_{axis}": (whole.time, linear.phi[:, i]) for i, axis in enumerate(angles)}
    states["floor_horizontal"] = (truth.time, floor.horizontal)
    told = _growth(made, run_errors, linear, floor, held)
    if not polar:
        elapsed = whole.time - whole.time[0]
        told |= _closed(made, ideal.start, measured.bias_accel, measured.bias_gyro, elapsed, states, told)
    notes = [*made.notes, *fixed.notes]
    if polar:
        notes.append(
            "within a degree of a pole NED turns too fast for the linear error model, the closed form and the sigma: "
            "they are left out; the run itself does not mind"
        )
    if np.any(measured.clipped):
        k = int(np.count_nonzero(measured.clipped.any(axis=1)))
        notes.append(f"{k} of {n} simulated IMU rows reach the range of the instrument and are clipped there")
    if abs(float(np.max(np.abs(truth.rpy[:, 1])))) > 85.0 * D:
        notes.append(
            "pitch comes within 5 deg of the vertical: roll and heading mean little there, the track is unhurt"
        )
    begin = _row(start, start.time)
    return Run(track, made.earth, {"imu": measured.table()}, truth.table(), states, told, notes, begin=begin)


def _at(track: Track, time: Array) -> Track:
    """The same rows with the truth's stamps (they differ by rounding only)."""
    from schuler.inertial.strapdown import Track

    return Track(time, track.lat, track.lon, track.height, track.v_n, track.q_nb, track.notes)


def _row(start: Start, time: float) -> Track:
    from schuler.inertial.strapdown import Track

    t, lat, lon, height = (np.array([x]) for x in (time, start.lat, start.lon, start.height))
    return Track(t, lat, lon, height, start.v_n[None], start.q_nb[None])


def _with_start(start: Any, truth: Any) -> Any:
    fields = ("time", "lat", "lon", "height", "v_n", "q_nb")
    joined = {k: np.concatenate([getattr(start, k), getattr(truth, k)]) for k in fields}
    none = np.zeros((len(joined["time"]), 0))
    return type(truth)(**joined, w_ib_b=none, f_b=none)


def _growth(made: Trajectory, errors: Any, linear: Any, floor: Any, held: bool) -> dict[str, Any]:
    size = float(np.max(errors.horizontal, initial=0.0))
    told: dict[str, Any] = {
        "trajectory": made.name,
        "end_north_m": float(errors.position[-1, 0]),
        "end_east_m": float(errors.position[-1, 1]),
        "end_down_m": float(errors.position[-1, 2]),
        "max_horizontal_m": size,
        "floor_horizontal_m": float(np.max(floor.horizontal, initial=0.0)),
        "floor_vertical_m": float(np.max(np.abs(floor.position[:, 2]), initial=0.0)),
        "vertical": "held" if held else "free",
    }
    if linear is not None:
        gap = np.hypot(*(linear.position[1:, :2] - errors.position[:, :2]).T)
        told["linear_end_north_m"], told["linear_end_east_m"] = (float(x) for x in linear.position[-1, :2])
        told["linear_difference_share"] = float(np.max(gap, initial=0.0) / size) if size > 1e-3 else None
    return told


def _closed(
    made: Trajectory, start: Any, bias_a: Array, bias_g: Array, t: Array, states: dict[str, tuple[Array, Array]],
    told: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """The closed form for a vehicle at rest at the start with the first biases, and the open-loop formulas."""
    from schuler.ground.frames import dcm_from_quat
    from schuler.inertial import error_dynamics
    from schuler.truth.trajectories import sphere

    lat = float(start.lat[0])
    if abs(lat) > 89.0 * D or not len(bias_a):
        return {}
    C = dcm_from_quat(start.q_nb[0])
    b_a, b_g = C @ bias_a[0], C @ bias_g[0]
    r_n, r_e = made.earth.radii(lat)
    radius = math.sqrt(float(r_n) * float(r_e))
    ball = sphere(radius, float(made.earth.gravity(lat, start.height[0])) * radius**2)
    rest = error_dynamics.at_rest(t, lat, accel_error=b_a[:2], gyro_error=b_g, earth=ball)
    open_a = error_dynamics.open_loop(t, accel=1.0)
    g = float(ball.gravity(lat))
    open_g = error_dynamics.open_loop(t, gyro=1.0, g=g)
    opened = np.outer(open_a, b_a[:2]) + np.outer(open_g, np.array([-b_g[1], b_g[0]]))
    shift = start.time[0]
    for i, p in enumerate(PAIRS):
        states[f"closed_{p}"] = (t + shift, rest.dr[:, i])
        states[f"open_{p}"] = (t + shift, opened[:, i])
    return {
        "closed_end_north_m": float(rest.dr[-1, 0]),
        "closed_end_east_m": float(rest.dr[-1, 1]),
        "open_loop_end_m": float(np.hypot(*opened[-1])),
        "open_loop_accel_holds_s": error_dynamics.open_loop_holds("accel", 0.1, ball),
        "open_loop_gyro_holds_s": error_dynamics.open_loop_holds("gyro", 0.1, ball),
        "schuler_period_s": 2.0 * math.pi / error_dynamics.schuler_rate(ball),
    }


# Recordings


def recorded(study: Study, progress: Progress) -> Run:
    """Free inertial navigation of a recording from [start], or from what alignment and the first fix give."""
    from schuler.inertial import ecef, strapdown

    if "imu" not in study.input.tables:
        if study.trajectory is not None and study.trajectory.preset == "track" and "reference" in study.input.tables:
            inputs = read_tables(study, progress)
            assert inputs.reference is not None
            return simulate(study, imu_model(study), DEFAULT_SEED, progress, track_of(study, inputs.reference))
        raise StudyError('[input] imu is absent: kind "strapdown" navigates an imu table, or simulates [trajectory]')
    inputs = read_tables(study, progress)
    check_overlap(study, inputs, "imu")
    to_body(study, inputs.tables)
    check_gravity(study, inputs.tables)
    found = start_of(study, inputs.tables, sensor_errors(study))
    progress("navigating")
    imu = inputs.tables["imu"]
    rate = 1.0 / float(np.median(np.diff(imu.time)))
    navigate = ecef.run if study.filter.frame == "ecef" else strapdown.run
    track = navigate(
        imu, found.start, vertical="free" if study.filter.vertical == "free" else "held", every=stride_of(study, rate)
    )
    begin = _row(found.start, max(found.start.time, float(imu.time[0]) - 1.0 / rate))
    told = {"trajectory": "recording"}
    notes = [*inputs.notes, *place_notes(study, inputs), *found.notes]
    return Run(track, WGS84, dict(inputs.tables), inputs.reference, {}, told, notes, found, begin)


def sensor_errors(study: Study) -> Any:
    """What alignment needs to know of [imu]."""
    from schuler.inertial.alignment import SensorErrors

    m = imu_model(study)
    return SensorErrors.of(
        accel_bias=np.hypot(m.accel_bias, m.accel_instability), gyro_bias=np.hypot(m.gyro_bias, m.gyro_instability),
        vrw=m.vrw, arw=m.arw, gyro_walk=m.gyro_rrw, accel_scale=m.accel_scale,
        accel_misalignment=m.accel_misalignment, gyro_g_sensitivity=m.gyro_g_sensitivity,
    )  # fmt: skip


# Uncertainty and figures


def sensor_noise(study: Study, model: ImuModel) -> SensorNoise:
    from schuler.inertial.error_dynamics import SensorNoise

    return SensorNoise(
        vrw=model.vrw, arw=model.arw, accel_bias=model.accel_bias, gyro_bias=model.gyro_bias,
        accel_gm=model.accel_instability, gyro_gm=model.gyro_instability, accel_tau=model.accel_tau_s,
        gyro_tau=model.gyro_tau_s, accel_walk=float(np.max(model.accel_rrw)), gyro_walk=float(np.max(model.gyro_rrw)),
    )  # fmt: skip


def covariances(study: Study, model: ImuModel, done: Run, held: bool) -> tuple[Array, Array, Array]:
    """cov of position, velocity, rpy at the track's rows, from [imu] and the std_ keys of [start]; NaN where neither is
    given (fixed errors have no sigma)."""
    from schuler.inertial import error_dynamics
    from schuler.inertial.strapdown import Track

    t = done.track
    n = len(t)
    s = study.start
    keys = ("std_roll_deg", "std_pitch_deg", "std_heading_deg")
    tilt = [(getattr(s, k) or 0.0) * D for k in keys]
    if done.found is not None and done.found.std is not None:
        tilt = [x or float(y) for x, y in zip(tilt, done.found.std, strict=True)]
    rest = [getattr(s, f"std_v_{a}_mps") or 0.0 for a in ("north", "east", "down")]
    rest += [getattr(s, f"std_{a}_m") or 0.0 for a in ("north", "east", "down")]
    noise = sensor_noise(study, model)
    if done.found is not None and done.found.gyro_bias_std is not None:
        noise = replace(noise, gyro_bias=done.found.gyro_bias_std)
    matrix = error_dynamics.MatrixErrors(
        model.accel_scale, model.gyro_scale, model.accel_misalignment, model.gyro_misalignment, model.gyro_g_sensitivity
    )
    drawn = any(np.any(x) for x in (*vars(noise).values(), *vars(matrix).values()) if np.all(np.isfinite(x)))
    none = np.full((n, 3, 3), np.nan)
    if n < 2 or not (drawn or any(tilt) or any(rest)) or np.max(np.abs(t.lat)) > 89.0 * D:
        return none, none.copy(), none.copy()
    every = max(1, n // 3000)
    rows = np.unique(np.append(np.arange(0, n, every), n - 1))
    names = ("time", "lat", "lon", "height", "v_n", "q_nb")
    pieces = [(t, rows)] if done.begin is None else [(done.begin, slice(None)), (t, rows)]
    columns: list[Any] = [np.concatenate([getattr(x, k)[i] for x, i in pieces]) for k in names]
    thin = Track(*columns)
    start_std = np.array([max(tilt[0], tilt[1]), max(tilt[0], tilt[1]), tilt[2], *rest])
    P = error_dynamics.covariance(thin, noise, start_std, earth=done.earth, held=held)
    f_b, w_b = _means(done.tables["imu"], thin.time)
    P = P + error_dynamics.matrix_covariance(thin, matrix, f_b, w_b, earth=done.earth, held=held)
    if float(np.max(P[:, range(3), range(3)])) > (20.0 * D) ** 2:
        done.notes.append(
            "the attitude's sigma grows beyond 20 deg: from there on the linear sigma is a rough guide only"
        )
    rpy = thin.rpy
    E = np.array([_euler_errors(*row) for row in rpy])
    parts = (P[:, 6:9, 6:9], P[:, 3:6, 3:6], E @ P[:, 0:3, 0:3] @ E.transpose(0, 2, 1))
    return tuple(_between(thin.time, p, t.time) for p in parts)  # type: ignore[return-value]


def _means(imu: Table, time: Array) -> tuple[Array, Array]:
    """Mean specific force and rate (n - 1, 3) of an imu table between the times (n,)."""
    edges = np.concatenate([[imu.time[0] - np.median(np.diff(imu.time))], imu.time])
    step = np.diff(edges)[:, None]
    kind = imu.kind == "increments"
    out = []
    for name in ("dv", "dtheta") if kind else ("accel", "gyro"):
        values = imu.stack(*(f"{name}_{a}" for a in "xyz"))
        total = np.vstack([np.zeros(3), np.cumsum(values if kind else values * step, axis=0)])
        at = np.stack([np.interp(time, edges, total[:, i]) for i in range(3)], axis=1)
        out.append(np.diff(at, axis=0) / np.diff(time)[:, None])
    return out[0], out[1]


def _euler_errors(roll: float, pitch: float, heading: float) -> Array:
    from schuler.inertial.alignment import rpy_from_phi

    return rpy_from_phi((roll, float(np.clip(pitch, -89.0 * D, 89.0 * D)), heading))


def _between(time: Array, P: Array, at: Array) -> Array:
    """Linear interpolation of covariances: a mixture of the two, positive definite."""
    flat = P.reshape(len(time), 9)
    return np.stack([np.interp(at, time, flat[:, i]) for i in range(9)], axis=1).reshape(-1, 3, 3)


def unread(study: Study) -> list[str]:
    """Sections and keys that this kind does not read."""
    sections = ("camera", "sweep", "mission", "platform")
    notes = [f'[{name}]: not read by kind "strapdown"; left out' for name in sections if name in study.model_fields_set]
    known = {"imu", "gnss", "reference"}
    others = [name for name in study.input.tables if name not in known]
    if others:
        notes.append(f'[input] {", ".join(others)}: kind "strapdown" navigates by inertia alone; left out')
    if study.outage:
        notes.append('[[outage]]: kind "strapdown" uses no aid after the start, so there is nothing to withhold')
    if study.filter.constraints:
        notes.append('[filter] constraints: not used by kind "strapdown"; left out')
    return notes


def judged(study: Study, made: dict[str, Any], navigation: Navigation, done: Run, notes: list[str]) -> dict[str, Any]:
    """The content of summary.json."""
    reference = done.reference
    arm = study.mounting.reference_frd_m
    series = error_series(navigation.filter, reference, arm) if reference is not None else None
    errors = summary(series)
    grown = [done.truth_states.get(f"error_{p}") for p in PAIRS]
    if errors and grown[0] is not None and grown[1] is not None:  # in metres of the study's own Earth, sphere or not
        errors["horizontal_m"] = spread(np.hypot(grown[0][1], grown[1][1]))
    track = navigation.filter
    lat, lon = track.lat, track.lon
    if reference is not None:
        during = (reference.time >= track.time[0]) & (reference.time <= track.time[-1])
        lat, lon = reference["lat"][during], reference["lon"][during]
    if series is not None and study.filter.vertical != "free":  # no part of the error growth: nothing to judge
        cov_pos, cov_vel = series.cov_pos.copy(), series.cov_vel.copy()
        for cov in (cov_pos, cov_vel):
            cov[:, 2, :] = cov[:, :, 2] = np.nan
        series = replace(series, cov_pos=cov_pos, cov_vel=cov_vel)
    return {
        "study": {"name": study.study.name, "kind": study.study.kind},
        "made_by": made,
        "method": "strapdown",
        "duration_s": float(track.time[-1] - track.time[0]),
        "distance_m": distance(lat, lon),
        "errors": {"filter": errors, "smoother": None},
        "circular": {"filter": None if series is None else circular(series.horizontal), "smoother": None},
        "consistency": consistency.consistency(series, navigation.innovations),
        "outages": [],
        "strapdown": done.told,
        "notes": notes,
    }
