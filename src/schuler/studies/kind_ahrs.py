"""Kind "ahrs": attitude from an IMU, with or without a magnetometer, judged by the rotation that is left."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.judging import consistency
from schuler.judging.attitude import AttitudeErrors, attitude_errors
from schuler.judging.errors import ErrorSeries, error_series, summary
from schuler.judging.result import Result
from schuler.studies.ahrs_mapping import ahrs_settings, unread
from schuler.studies.inputs import Inputs, check_gravity, check_overlap, read_tables, to_body, withhold
from schuler.studies.magnetic import recorded_declination
from schuler.studies.run import Progress, made_by, register
from schuler.studies.warm import need

if TYPE_CHECKING:
    from schuler.aiding.ahrs import AhrsRun, Attitude
    from schuler.studies.model import OutageSection, Study

Array = NDArray[np.float64]
STEEP = 75.0 * DEG  # beyond this pitch roll and heading are not judged one by one
DISTRUST = 4.0  # a field is distrusted where its disturbance turns the heading by so many of mag_deg
SWING_SIZE, SWING_DIP = 0.15, 8.0 * DEG  # rms of a field that nobody should call steady
UPWARD = -15.0 * DEG  # dip of a field that points up
GRAVITY_UP = 5.0  # m/s^2


@dataclass
class AhrsDetails:
    """For the page and the terminal: errors of filter and smoother, the run, where the field was distrusted."""

    run: AhrsRun
    filter: AttitudeErrors | None
    smoother: AttitudeErrors | None
    distrusted: list[tuple[float, float]]
    lines: list[str] = field(default_factory=list)

    def told(self, name: str) -> list[str]:
        """Lines for the terminal."""
        return self.lines


@register("ahrs")
def run(study: Study, *, seed: int | None, progress: Progress) -> Result:
    """Reads, finds the attitude, judges. See `Result`; position and velocity are NaN throughout."""
    inputs = read_tables(study, progress)
    if "imu" not in inputs.tables:
        raise InputError('[input] imu: missing; kind "ahrs" reads gyros and accelerometers; type imu = "imu.csv"')
    check_overlap(study, inputs, "imu")
    to_body(study, inputs.tables)
    check_gravity(study, inputs.tables, upright=False)
    tables, withheld, each = withhold(study, inputs)
    notes = [*inputs.notes, *unread(study)]
    declination, said = recorded_declination(study, tables)
    settings = ahrs_settings(study, tables, declination)
    need("ahrs", "ahrs_smooth")
    progress("finding the attitude")
    from schuler.aiding.ahrs import navigate

    navigation, found = navigate(tables, settings)
    has_mag = "magnetometer" in navigation.innovations
    notes += heading_notes(study, tables, said, declination, has_mag)
    notes += [*field_notes(study, found, has_mag, settings.lat), *upside_down(study, found)]
    progress("judging")
    errors, smooth = (judge(a, inputs, found.relative) for a in (found.filter, found.smoother))
    if inputs.reference is not None and errors is None:
        notes.append("the reference says no roll, pitch and heading at any row of the track: nothing is judged")
    details = AhrsDetails(found, errors, smooth, distrusted(found, settings.mag_std))
    told = judged(study, navigation, inputs, details, each, has_mag)
    told["notes"] = [*notes, *navigation.notes]
    details.lines = lines(told, tables)
    return Result(
        study=study,
        made_by=told["made_by"],
        navigation=navigation,
        reference=inputs.reference,
        truth_states={},
        tables=tables,
        withheld=withheld,
        summary=told,
        notes=told["notes"],
        details=details,
    )


# ---- what has to be said ----


def heading_notes(
    study: Study, tables: dict[str, Table], said: list[str], declination: float | None, has_mag: bool
) -> list[str]:
    """From where the heading is counted."""
    given = study.start.heading_deg
    if not has_mag:
        if given is None:
            return [
                "no magnetometer: the heading is counted from the start, where it is called 0; its sigma is that of "
                "the turn since then and grows with time; [start] heading_deg gives the true one"
            ]
        return [f"no magnetometer: the heading starts at {given:g} deg, as [start] says, and its sigma grows with time"]
    if said or study.input.declination_deg is not None or declination is not None:
        return said
    return [
        "nothing says where this was: the heading is counted from magnetic north; type [input] declination_deg, or "
        "[start] lat_deg and lon_deg for the magnetic model"
    ]


def field_notes(study: Study, found: AhrsRun, has_mag: bool, lat: float | None) -> list[str]:
    """A field that swings as the body turns, or that points up where it should not."""
    if not has_mag:
        return []
    from schuler.kernels import ahrs_state as k

    iron = found.nodes[:, k.K_IRON]
    notes = []
    if iron[-1] > 0.0:
        x, y, z = (f"{v * 1e6:.1f}" for v in found.hard_iron)
        since = float(found.nodes[np.argmax(iron > 0.0), k.K_T] - found.nodes[0, k.K_T])
        notes.append(
            f"the magnetometer carries a hard iron of {x}, {y}, {z} uT (x, y, z in body axes), found {since:.0f} s "
            "after the start and taken off from there on; the heading before that is the smoother's, not the filter's"
        )
    seen = (found.nodes[:, k.K_NORM] > 0.0) & ((iron > 0.0) | (iron[-1] == 0.0))
    size, dip = found.nodes[seen, k.K_NORM], found.nodes[seen, k.K_DIP]
    if len(size) < 20:
        return notes
    middle, typical = float(np.median(dip)), float(np.median(size))
    swing = float(np.median(np.abs(size / typical - 1.0)) * 1.48)
    dips = float(np.median(np.abs(dip - middle)) * 1.48)
    if swing < SWING_SIZE and dips > SWING_DIP:
        return [
            *notes,
            f"the magnetic field keeps its size ({typical * 1e6:.0f} uT) but its dip swings by {dips / DEG:.0f} deg as "
            "the body turns: the magnetometer's axes are probably not those of the gyros; turn or change the sign of "
            "mag_x, mag_y, mag_z until it is steady",
        ]
    if swing > SWING_SIZE:
        return [
            *notes,
            f"the size of the magnetic field swings by {100.0 * swing:.0f} % around {typical * 1e6:.0f} uT: it is "
            "disturbed, or the magnetometer is not calibrated (hard iron); the heading is only as good as that",
        ]
    if middle < UPWARD and (lat is None or lat > 10.0 * DEG):
        where = "that is so south of the magnetic equator only" if lat is None else "so far north it points down"
        return [
            *notes,
            f"the magnetic field points up, by {-middle / DEG:.0f} deg: {where}; elsewhere the magnetometer's z axis "
            "is the wrong way round (or all three are)",
        ]
    return notes


def upside_down(study: Study, found: AhrsRun) -> list[str]:
    """A body that starts on its back is perhaps a sensor with z up."""
    down = found.filter.C[0, 2, 2]
    if down > -0.5 or any(study.mounting.imu_to_body_rpy_deg):
        return []
    return [
        "the body starts upside down in forward-right-down axes; if the sensor's z axis points up, type [mounting] "
        "imu_to_body_rpy_deg = [180, 0, 0]"
    ]


# ---- judging ----


def judge(a: Attitude | None, inputs: Inputs, relative: bool) -> AttitudeErrors | None:
    if a is None or inputs.reference is None:
        return None
    return attitude_errors(a.time, a.q, a.cov_phi, inputs.reference, relative=relative)


def distrusted(found: AhrsRun, mag_std: float) -> list[tuple[float, float]]:
    """Stretches (from, to, s) in which the field was believed less than usual; gaps under 1 s are closed."""
    from schuler.kernels import ahrs_state as k

    n = found.nodes
    bad = np.isfinite(n[:, k.K_S]) & ((n[:, k.K_BENT] > DISTRUST * mag_std) | (n[:, k.K_USED] < 0.5))
    out: list[tuple[float, float]] = []
    for t in n[bad, k.K_T].tolist():
        if out and t - out[-1][1] <= 1.0:
            out[-1] = (out[-1][0], t)
        else:
            out.append((t, t))
    return [(a, b) for a, b in out if b - a > 0.3]


def euler_series(solution: Any, reference: Table | None, offset: float) -> ErrorSeries | None:
    """Errors of roll, pitch, heading; NaN where the nose is too steep for roll and heading."""
    if reference is None:
        return None
    series = error_series(solution, reference)
    pitch = np.interp(series.time, solution.time, solution.rpy[:, 1])
    series.rpy[:, 2] = np.mod(series.rpy[:, 2] - offset + np.pi, 2.0 * np.pi) - np.pi
    series.rpy[np.ix_(np.abs(pitch) > STEEP, [0, 2])] = np.nan
    return series


def judged(
    study: Study,
    navigation: Navigation,
    inputs: Inputs,
    details: AhrsDetails,
    each: list[tuple[OutageSection, Table]],
    has_mag: bool,
) -> dict[str, Any]:
    """The content of summary.json."""
    f, s, found = details.filter, details.smoother, details.run
    time = navigation.filter.time
    series = euler_series(navigation.filter, inputs.reference, f.offset if f is not None else 0.0)
    later = None
    if navigation.smoother is not None:
        later = euler_series(navigation.smoother, inputs.reference, s.offset if s is not None else 0.0)
    same = consistency.consistency(None, navigation.innovations)
    if f is not None:
        good = np.isfinite(f.nees)
        same["nees_attitude"] = float(f.nees[good].mean()) if good.any() else None
        same["inside_3_sigma"] = f.inside_3_sigma
    std = np.sqrt(np.einsum("nii->ni", found.filter.cov_phi))
    return {
        "study": {"name": study.study.name, "kind": study.study.kind},
        "made_by": made_by(study, None),
        "method": study.filter.method,
        "duration_s": float(time[-1] - time[0]),
        "errors": {
            "filter": summary(series),
            "smoother": summary(later) if navigation.smoother is not None else None,
        },
        "attitude": None if f is None else f.summary(),
        "attitude_smoother": None if s is None else s.summary(),
        "heading": "relative" if found.relative else "absolute",
        "heading_offset_removed_deg": None if f is None or not found.relative else f.offset / DEG,
        "sigma_end_deg": {"tilt": float(np.hypot(std[-1, 0], std[-1, 1]) / DEG), "heading": float(std[-1, 2] / DEG)},
        "consistency": same,
        "outages": [_outage(o, details, found) for o, _ in each],
        "dives": [],
        "surfacings": [],
        "magnetometer": _field(details, has_mag),
        "rest_share": float(np.mean(found.nodes[:, _column("K_REST")])),
        "states": {
            name: {"unit": h.unit, "value": float(h.value[-1]), "std": float(h.std[-1]), "truth": None}
            for name, h in navigation.states.items()
        },
    }


def _column(name: str) -> int:
    from schuler.kernels import ahrs_state as k

    return int(getattr(k, name))


def _outage(outage: OutageSection, details: AhrsDetails, found: AhrsRun) -> dict[str, Any]:
    """One entry of "outages": the heading at the end, and what the filter said of it."""
    end = min(outage.end_s, float(found.filter.time[-1]))
    row = int(np.searchsorted(found.filter.time, end + 1e-9, side="right")) - 1
    error = None
    if details.filter is not None:
        near = np.flatnonzero(details.filter.time <= end + 1e-6)
        if len(near) and end - details.filter.time[near[-1]] < 1.0:
            error = float(abs(details.filter.heading[near[-1]]) / DEG)
    sigma = float(np.sqrt(found.filter.cov_phi[row, 2, 2]) / DEG) if row >= 0 else None
    none = dict.fromkeys(("horizontal_end_m", "horizontal_max_m", "nees_half_end", "smoother_horizontal_max_m"))
    span = {"sensor": outage.sensor, "start_s": outage.start_s, "end_s": end}
    return {**span, **none, "heading_end_deg": error, "heading_sigma_deg": sigma}


def _field(details: AhrsDetails, has_mag: bool) -> dict[str, Any] | None:
    """The field as seen, and where it was distrusted."""
    if not has_mag:
        return None
    n = details.run.nodes
    seen = n[n[:, _column("K_NORM")] > 0.0]
    lost = sum(b - a for a, b in details.distrusted)
    span = float(n[-1, 0] - n[0, 0]) or 1.0
    return {
        "size_uT": float(np.median(seen[:, _column("K_NORM")]) * 1e6) if len(seen) else None,
        "dip_deg": float(np.median(seen[:, _column("K_DIP")]) / DEG) if len(seen) else None,
        "hard_iron_uT": [float(v * 1e6) for v in details.run.hard_iron] if details.run.hard_iron.any() else None,
        "distrusted_share": min(lost / span, 1.0),
        "distrusted": [{"start_s": a, "end_s": b} for a, b in details.distrusted],
    }


# ---- terminal ----


def lines(told: dict[str, Any], tables: dict[str, Table]) -> list[str]:
    """About eight lines of figures."""
    imu = tables["imu"]
    rate = 1.0 / float(np.median(np.diff(imu.time)))
    field_ = told["magnetometer"]
    sensors = "gyros, accelerometers" + (", magnetometer" if field_ is not None else "")
    out = [f"{told['study']['name']}: {told['duration_s']:.0f} s; imu {rate:.3g} Hz ({sensors}); attitude only"]
    for key, who in (("attitude", "filter"), ("attitude_smoother", "smoothed")):
        e = told[key]
        if e is not None:
            total, tilt, heading = (e[f"{k}_deg"] for k in ("total", "tilt", "heading"))
            out.append(
                f"{who} against the reference: {total['rms']:.2f} deg rms ({total['p95']:.2f} for 95 %, at most "
                f"{total['max']:.2f}); tilt {tilt['rms']:.2f}, heading {heading['rms']:.2f} deg rms"
            )
    if told["heading_offset_removed_deg"] is not None:
        out.append(f"  heading counted from the start: {told['heading_offset_removed_deg']:.1f} deg taken out once")
    end = told["sigma_end_deg"]
    word = " (of the turn since the start)" if told["heading"] == "relative" else ""
    out.append(f"sigma at the end: tilt {end['tilt']:.2f} deg, heading {end['heading']:.2f} deg{word}")
    c = told["consistency"]
    if c["inside_3_sigma"] is not None:
        out.append(
            f"inside their own 3 sigma: {100.0 * c['inside_3_sigma']:.1f} % of all errors; attitude NEES "
            f"{c['nees_attitude']:.2f} (1 is ideal)"
        )
    for o in told["outages"]:
        error = "-" if o["heading_end_deg"] is None else f"{o['heading_end_deg']:.2f} deg"
        out.append(
            f"{o['sensor']} withheld {o['start_s']:g} to {o['end_s']:g} s: heading error at the end {error}, sigma "
            f"{o['heading_sigma_deg']:.2f} deg"
        )
    if field_ is not None and field_["size_uT"] is not None:
        text = f"magnetic field {field_['size_uT']:.1f} uT, dip {field_['dip_deg']:.1f} deg; "
        spans = field_["distrusted"]
        if spans:
            longest = max(spans, key=lambda s: s["end_s"] - s["start_s"])
            text += (
                f"distrusted {100.0 * field_['distrusted_share']:.0f} % of the time, longest "
                f"{longest['start_s']:.1f} to {longest['end_s']:.1f} s"
            )
        else:
            text += "never distrusted"
        out.append(text)
    bias = [told["states"].get(f"gyro_bias_{a}") for a in "xyz"]
    if all(bias):
        known = ", ".join(f"{b['value'] / DEG:.3f} +- {b['std'] / DEG:.3f}" for b in bias if b)
        out.append(
            f"gyro bias x, y, z at the end: {known} deg/s; at rest {100.0 * told['rest_share']:.0f} % of the time"
        )
    return out
