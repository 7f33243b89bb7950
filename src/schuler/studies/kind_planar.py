"""Kind "planar": a vehicle in the plane with odometry, turn rate, position fixes and ranges to known beacons."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.aiding.planar_settings import SCALES, Metres, PlanarSettings, Plane
from schuler.aiding.solution import Navigation
from schuler.ground.errors import InputError, StudyError
from schuler.ground.tables import Table
from schuler.judging import consistency, outages
from schuler.judging.distrust import distrusted
from schuler.judging.errors import circular, distance, error_series, summary
from schuler.judging.result import Result
from schuler.studies.auv_mapping import imu_model, output_rate, start_of
from schuler.studies.inputs import Inputs, check_gravity, check_overlap, place_notes, read_tables, to_body, withhold
from schuler.studies.judged import swept
from schuler.studies.remarks import judging_notes
from schuler.studies.run import Progress, made_by, register
from schuler.studies.warm import need

if TYPE_CHECKING:
    from schuler.studies.model import OutageSection, Study

FAR_M = 20e3  # metres of a map grid: counted from a nearer place inside
FLAT_M = 100e3  # beyond it the plane bends away from the Earth
KNOWN = {"imu", "gnss", "speed", "ranges", "landmarks", "reference"}


@register("planar")
def run(study: Study, *, seed: int | None, progress: Progress) -> Result:
    """Reads, navigates, judges. See `Result`."""
    if "speed" not in study.input.tables:
        raise StudyError(
            '[input] speed: missing; kind "planar" needs odometry: speed = "speed.csv" with speed[m/s] or ddist[m] '
            "(and dheading[rad], or an imu table)"
        )
    inputs = read_tables(study, progress)
    notes = [*_unread(study)]
    metres = in_metres(study, inputs)
    check_overlap(study, inputs, "speed")
    notes += place_notes(study, inputs) if metres is None else []
    to_body(study, inputs.tables)
    _check_up(study, inputs)
    tables, withheld, each = withhold(study, inputs)
    settings = settings_of(study, metres)
    need("planar", "planar_smooth")
    progress("navigating")
    navigation = navigate(tables, settings, metres)
    progress("judging")
    over, more = swept(
        study,
        inputs,
        lambda others: navigate(others, settings, metres),
        progress,
        lambda *o: _outage(study, inputs.reference, *o),
    )
    notes = [*inputs.notes, *notes, *navigation.notes, *more]
    told = _judged(study, navigation, inputs, tables, each, notes)
    told["distrusted"] = distrusted(navigation.innovations)
    notes += judging_notes(study, inputs, navigation, told)
    if study.sweep is not None:
        told["sweep"] = over
    return Result(
        study=study,
        made_by=made_by(study, None),
        navigation=navigation,
        reference=inputs.reference,
        truth_states={},
        tables=tables,
        withheld=withheld,
        summary=told,
        notes=notes,
    )


def navigate(tables: dict[str, Table], settings: PlanarSettings, metres: Metres | None) -> Navigation:
    """Runs filter and smoother."""
    from schuler.aiding.planar import navigate as run_filter

    navigation = run_filter(tables, settings, None if metres is None else metres.plane)
    if metres is not None:
        navigation.extras["metres"] = metres
    return navigation


def settings_of(study: Study, metres: Metres | None) -> PlanarSettings:
    """The study's sections in SI."""
    n, m = study.noise, study.mounting
    start = start_of(study)
    if metres is not None:
        north, east = study.start.north_m, study.start.east_m
        if metres.placed and north is None and east is None:
            north = east = 0.0  # [start] lat_deg, lon_deg is where the metres are counted from, and where it starts
        lat = lon = None
        if north is not None and east is not None:
            lat, lon = (float(v) for v in metres.geodetic(north, east))
        start = replace(start, lat=lat, lon=lon)
    settings = PlanarSettings(
        start=start,
        speed_std=n.speed_mps,
        speed_scale_std=0.01 * n.speed_scale_percent,
        slip=n.slip_m_per_sqrt_m,
        gnss_std=n.gnss_m,
        gnss_velocity_std=n.gnss_mps,
        gnss_correlated_std=n.gnss_correlated_m,
        gnss_correlated_tau=n.gnss_correlated_tau_s,
        gnss_delay=study.input.gnss_delay_s,
        range_std=n.range_m,
        antenna=m.antenna_frd_m,
        smoother=study.filter.smoother,
        output_rate=output_rate(study),
    )
    if "range_scale_percent" in n.model_fields_set:
        settings = replace(settings, range_scale_std=0.01 * n.range_scale_percent)
    if "range_bias_m" in n.model_fields_set:
        settings = replace(settings, range_bias_std=n.range_bias_m)
    if n.speed_walk_mps_per_sqrt_s is not None:
        settings = replace(settings, free_speed_walk=n.speed_walk_mps_per_sqrt_s)
    imu = imu_model(study)
    if imu is not None:  # the turn is about z
        figures = {
            "gyro_arw": imu.arw[2],
            "gyro_bias_std": np.hypot(imu.gyro_bias[2], imu.gyro_offset[2]),
            "gyro_instability": imu.gyro_instability[2],
            "gyro_scale_std": imu.gyro_scale[2],
        }
        known: dict[str, Any] = {k: float(v) for k, v in figures.items() if v > 0.0}
        settings = replace(settings, **known, gyro_tau=imu.gyro_tau_s)
    if study.filter.estimate is not None:
        off: dict[str, Any] = {prior: 0.0 for name, prior in SCALES.items() if name not in study.filter.estimate}
        settings = replace(settings, **off)
    return settings


def in_metres(study: Study, inputs: Inputs) -> Metres | None:
    """Gives tables in north and east a lat and lon, in place; None where all have them already.

    Where [start] gives lat_deg and lon_deg the metres are counted from there, as in every kind; else the plane stands
    nowhere on the Earth, and the result is in metres too.
    """
    named = [*inputs.tables.values(), *([] if inputs.reference is None else [inputs.reference])]
    with_place = [t for t in named if t.name in ("gnss", "landmarks", "reference")]
    flat = [t for t in with_place if "lat" not in t]
    typed = [k for k in ("north_m", "east_m") if getattr(study.start, k) is not None]
    if len(typed) == 1:
        raise StudyError(f"[start] {typed[0]}: came alone; type both north_m and east_m")
    if not flat:
        if typed and with_place:
            raise StudyError("[start] north_m, east_m: the tables hold lat and lon; type lat_deg and lon_deg instead")
        if not (typed and not with_place):
            return None
    lat, lon = study.start.lat_deg, study.start.lon_deg
    placed = lat is not None and lon is not None
    if len(flat) < len(with_place) and not placed:
        have = ", ".join(t.name for t in flat)
        raise InputError(
            f"{have} in north and east, {', '.join(t.name for t in with_place if t not in flat)} in lat and lon: type "
            "lat_deg and lon_deg under [start], from where north and east are counted"
        )
    north = east = 0.0
    if not placed and flat:
        first = flat[0]
        middle = float(np.median(first["north"])), float(np.median(first["east"]))
        if max(abs(middle[0]), abs(middle[1])) > FAR_M:
            north, east = (float(np.round(v, -3)) for v in middle)
    plane = Plane(radians(lat), radians(lon), study.start.height_m or 0.0) if placed else Plane(0.0, 0.0)  # type: ignore[arg-type]
    metres = Metres(plane, north, east, placed)
    for table in flat:
        reach = float(np.max(np.hypot(table["north"] - north, table["east"] - east)))
        if reach > FLAT_M:
            inputs.notes.append(
                f"{table.name} reaches {reach / 1e3:.0f} km: a plane is no map of that; use lat and lon"
            )
        a, b = metres.geodetic(table["north"], table["east"])
        columns = {**table.columns, "lat": a, "lon": b}
        moved = Table(table.name, columns, table.kind, table.source, table.notes)
        if table is inputs.reference:
            inputs.reference = moved
        else:
            inputs.tables[table.name] = moved
    if placed:
        inputs.notes.append("north and east are counted from [start] lat_deg, lon_deg")
    return metres


def _check_up(study: Study, inputs: Inputs) -> None:
    """The turn is about the axis of gravity: checked where the imu table has felt gravity at all."""
    imu = inputs.tables.get("imu")
    if imu is None or "dheading" in inputs.tables.get("speed", ()) or imu.kind == "increments":
        return
    size = float(np.nanmedian(np.linalg.norm(imu.stack("accel_x", "accel_y", "accel_z"), axis=1)))
    if size > 5.0:
        check_gravity(study, inputs.tables)
    else:
        inputs.notes.append("imu: no gravity is felt, so nothing says which way z points; taken as down")


def _unread(study: Study) -> list[str]:
    """Sections, tables and names that the study types and this kind does not read, as sentences."""
    sections = ("camera", "align", "trajectory", "platform", "mission", "simulate")
    notes = [f'[{name}]: not read by kind "planar"; left out' for name in sections if name in study.model_fields_set]
    others = [name for name in study.input.tables if name not in KNOWN]
    if others:
        notes.append(f'[input] {", ".join(others)}: not used by kind "planar"; left out')
    names = [name for name in study.filter.estimate or () if name not in SCALES]
    if names:
        notes.append(f'[filter] estimate: kind "planar" does not learn {", ".join(names)}; left out')
    kept = [c for c in study.filter.constraints if c == "nhc"]
    if kept:
        notes.append(
            "[filter] constraints nhc: a planar vehicle never slips sideways but by slip_m_per_sqrt_m; left out"
        )
    return notes


def _judged(
    study: Study,
    navigation: Navigation,
    inputs: Inputs,
    tables: dict[str, Table],
    each: list[tuple[OutageSection, Table]],
    notes: list[str],
) -> dict[str, Any]:
    """The content of summary.json."""
    arm = study.mounting.reference_frd_m
    reference = inputs.reference
    series = smooth = None
    if reference is not None:
        series = error_series(navigation.filter, reference, arm)
        if navigation.smoother is not None:
            smooth = error_series(navigation.smoother, reference, arm)
    gnss = tables.get("gnss")
    track = navigation.smoother or navigation.filter
    length = distance(reference["lat"], reference["lon"]) if reference is not None else distance(track.lat, track.lon)
    fix: dict[str, Any] = {"gnss_m": study.noise.gnss_m, "antenna_frd": study.mounting.antenna_frd_m}
    states = {
        name: {"unit": h.unit, "value": float(h.value[-1]), "std": float(h.std[-1]), "truth": None}
        for name, h in navigation.states.items()
        if len(h.time)
    }
    beacons = [{k: v for k, v in b.items() if k not in ("lat", "lon")} for b in navigation.extras.get("beacons", [])]
    return {
        "study": {"name": study.study.name, "kind": study.study.kind},
        "made_by": made_by(study, None),
        "method": study.filter.method,
        "duration_s": float(navigation.filter.time[-1] - navigation.filter.time[0]),
        "distance_m": length,
        "errors": {"filter": summary(series), "smoother": summary(smooth) if navigation.smoother is not None else None},
        "circular": {
            "filter": None if series is None else circular(series.horizontal),
            "smoother": None if smooth is None else circular(smooth.horizontal),
        },
        "consistency": consistency.consistency(series, navigation.innovations),
        "outages": [_outage(study, reference, navigation, o.sensor, rows, o.start_s, o.end_s) for o, rows in each],
        "dives": outages.dives(navigation, gnss, reference, reference_frd=arm),
        "surfacings": outages.surfacings(navigation, gnss, **fix),
        "states": states,
        "beacons": beacons,
        "notes": notes,
    }


def _outage(
    study: Study, reference: Table | None, navigation: Navigation, sensor: str, rows: Table, start: float, end: float
) -> dict[str, Any]:
    return outages.outage(
        navigation,
        rows,
        sensor,
        start,
        end,
        reference,
        reference_frd=study.mounting.reference_frd_m,
        delay=study.input.gnss_delay_s,
        gnss_m=study.noise.gnss_m,
        antenna_frd=study.mounting.antenna_frd_m,
    )
