"""The tables of a study: read, checked against each other, turned to body axes, outages taken out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.units import KNOT
from schuler.studies.run import Progress, silent

if TYPE_CHECKING:
    from schuler.studies.model import OutageSection, Study

Array = NDArray[np.float64]
G = 9.80665
DAY = 86400.0
GAP_DAYS = {"imu": 2.0, "attitude": 60.0, "speed": 2.0}  # memory and time go with the span, not with the rows
MAG = ("mag_x", "mag_y", "mag_z")


@dataclass
class Inputs:
    """What a kind is given. tables: in body axes, outages not yet taken out; truth_states: of a simulation.

    elsewhen: a reference that shares no time with the tables, so that nothing is judged against it.
    """

    tables: dict[str, Table]
    reference: Table | None = None
    truth_states: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    declination: float | None = None
    elsewhen: Table | None = None


def read_tables(study: Study, progress: Progress = silent) -> Inputs:
    """Reads every table that [input] names. InputError holds one sentence a table that cannot be used."""
    from schuler.io.tables import read_table

    given = study.input
    tables: dict[str, Table] = {}
    notes: list[str] = []
    faults: list[str] = []
    for name in given.tables:
        path = study.file_of(name)
        assert path is not None
        progress(f"reading {path.name}")
        try:
            if name == "imu":
                table = read_table(
                    path,
                    name,
                    gyro_unit=given.gyro_unit,
                    accel_unit=given.accel_unit,
                    trust_units=given.trust_units,
                    rate_hz=given.rate_hz,
                    scale_gyro_deg_per_s=given.scale_gyro_deg_per_s,
                    scale_accel_g=given.scale_accel_g,
                    start_s=study.start.time_s or 0.0,
                )
            else:
                table = read_table(path, name)
        except InputError as error:
            faults.append(f"[input] {name}: {error}")
            continue
        if name == "imu" and study.imu is not None and study.imu.calibration is not None:
            from schuler.studies.corrected import corrected

            table = corrected(study, table)
        notes += table.notes
        if name == "reference" and study.study.kind != "ahrs" and not {"lat", "north"} & table.columns.keys():
            faults.append(
                f"[input] reference: {path.name} holds an attitude and no position (lat[deg], lon[deg] or north[m], "
                f'east[m]); only kind "ahrs" is judged by attitude alone'
            )
            continue
        try:
            table = on_earth(study, table)
        except InputError as error:
            faults.append(f"[input] {name}: {error}")
            continue
        if table.notes and table.notes[-1] not in notes:
            notes.append(table.notes[-1])
        tables[name] = table
    if faults:
        raise InputError("\n".join(faults))
    reference = tables.pop("reference", None)
    if reference is not None and given.reference_delay_s:
        columns = {**reference.columns, "time": reference.time - given.reference_delay_s}
        reference = Table(reference.name, columns, reference.kind, reference.source, reference.notes)
        notes.append(
            f"{_file(study, 'reference')}: its times less {given.reference_delay_s:.12g} s, as [input] "
            "reference_delay_s says"
        )
    return Inputs(tables, reference, notes=notes)


def on_earth(study: Study, table: Table) -> Table:
    """lat and lon in place of north and east, counted from [start]; kind "planar" takes them as they are."""
    if study.study.kind == "planar" or "lat" in table or "north" not in table or "east" not in table:
        return table
    lat, lon = study.start.lat_deg, study.start.lon_deg
    file = _file(study, table.name)
    if lat is None or lon is None:
        raise InputError(
            f"{file} holds north and east, and nothing says where they are counted from; type lat_deg and lon_deg of "
            "that point under [start], or give lat[deg] and lon[deg]"
        )
    from schuler.ground.earth import LocalFrame

    frame = LocalFrame(float(np.radians(lat)), float(np.radians(lon)))
    height = table["height"] if "height" in table else np.zeros(len(table))
    known = np.where(np.isfinite(height), height, 0.0)
    down = -known
    for _ in range(3):  # north and east lie in the plane of [start]; the height is the ellipsoid's
        place = frame.geodetic(table["north"], table["east"], down)
        down = down + place[2] - known
    columns = {k: v for k, v in table.columns.items() if k not in ("north", "east")}
    columns |= {"lat": place[0], "lon": place[1]}
    note = f"{file}: north and east are counted from [start] lat_deg, lon_deg"
    return Table(table.name, columns, table.kind, table.source, [*table.notes, note])


def span(table: Table) -> tuple[float, float]:
    """First and last time, s."""
    return float(table.time[0]), float(table.time[-1])


def _file(study: Study, name: str) -> str:
    path = study.file_of(name)
    return path.name if path is not None else name


def check_overlap(study: Study, inputs: Inputs, main: str) -> None:
    """Every table must share time with the main one (InputError says both spans); parts outside are told.

    A reference that shares no time is left out with a note: nothing but the judging needs it.
    """
    if len(inputs.tables[main]) < 2:
        why = "".join(f" ({note})" for note in inputs.tables[main].notes if "left out" in note)
        raise InputError(f"[input] {main}: {_file(study, main)} has one row{why}; nothing can be navigated with it")
    first, last = span(inputs.tables[main])
    faults = _far_apart(study, inputs, main)
    start = study.start.time_s
    if start is not None and start > last:
        faults.append(
            f"[start] time_s = {start:g} s lies after the end of {_file(study, main)}, which runs from {first:.1f} to "
            f"{last:.1f} s; put it inside, or leave it out"
        )
    for name, table in inputs.tables.items():
        if name == main or "time" not in table:
            continue
        a, b = span(table)
        if b < first or a > last:
            faults.append(
                f"[input] {name}: {_file(study, name)} runs from {a:.1f} to {b:.1f} s and {_file(study, main)} from "
                f"{first:.1f} to {last:.1f} s: they do not overlap; put both on one clock"
            )
        else:
            outside = int(np.count_nonzero((table.time < first) | (table.time > last)))
            if outside > 0.02 * len(table) and outside > 1:
                inputs.notes.append(
                    f"{_file(study, name)}: {outside} of {len(table)} rows lie before or after {_file(study, main)} "
                    f"({first:.1f} to {last:.1f} s)"
                )
            if b > last + DAY:
                inputs.tables[name] = table.where(table.time <= last + DAY)
    if faults:
        raise InputError("\n".join(faults))
    if inputs.reference is not None:
        a, b = span(inputs.reference)
        if b < first or a > last:
            inputs.notes.append(
                f"{_file(study, 'reference')} runs from {a:.1f} to {b:.1f} s and {_file(study, main)} from {first:.1f} "
                f"to {last:.1f} s: they do not overlap, so nothing is judged against it"
            )
            inputs.reference, inputs.elsewhen = None, inputs.reference


def _far_apart(study: Study, inputs: Inputs, main: str) -> list[str]:
    """A gap in the main table that no filter runs over."""
    time = inputs.tables[main].time
    step = np.diff(time)
    k = int(np.argmax(step))
    longest = GAP_DAYS[main] * DAY
    if step[k] <= longest:
        return []
    return [
        f"[input] {main}: {_file(study, main)} has a gap of {step[k] / DAY:.3g} days after {time[k]:.1f} s; split the "
        "file there, or put its times in order"
    ]


def speed_notes(study: Study, tables: dict[str, Table]) -> list[str]:
    """Sentences where the speed table reads far from the ground speed of the fixes, as with a wrong unit."""
    speed, gnss = tables.get("speed"), tables.get("gnss")
    if speed is None or gnss is None or "speed" not in speed or not {"v_north", "v_east"} <= gnss.columns.keys():
        return []
    ground = np.hypot(gnss["v_north"], gnss["v_east"])
    read = np.interp(gnss.time, speed.time, speed["speed"], left=np.nan, right=np.nan)
    good = np.isfinite(ground) & np.isfinite(read) & (ground > 1.0) & (np.abs(read) > 1e-6)
    if good.sum() < 10:
        return []
    ratio = float(np.median(np.abs(read[good]) / ground[good]))
    if 0.6 < ratio < 1.6:
        return []
    units = {"kn": KNOT, "km/h": 1.0 / 3.6, "ft/s": 0.3048}
    near = next((u for u, v in units.items() if abs(ratio * v - 1.0) < 0.12), None)
    back = next((u for u, v in units.items() if abs(ratio / v - 1.0) < 0.12), None)
    hint = "is its unit right?"
    if near:
        hint = f"its numbers look like {near}: write speed[{near}] in the heading"
    elif back:
        hint = f"its numbers look like m/s: write speed[m/s] in the heading, not {back}"
    return [f"{_file(study, 'speed')} reads {ratio:.2f} times the speed over ground of {_file(study, 'gnss')}; {hint}"]


def place_notes(study: Study, inputs: Inputs) -> list[str]:
    """Sentences on a reference that lies elsewhere than the fixes, and on a depth that is a height.

    InputError where the fixes have their lat and lon exchanged.
    """
    from schuler.studies.places import FAR_M, apart, check_exchanged, middle

    gnss, reference, depth = inputs.tables.get("gnss"), inputs.reference, inputs.tables.get("depth")
    notes = check_exchanged(study, inputs, _file(study, "gnss"), _file(study, "reference"))
    if not notes and gnss is not None and reference is not None and "lat" in gnss and "lat" in reference:
        away = apart(middle(gnss), middle(reference))
        if away > FAR_M:
            notes.append(
                f"{_file(study, 'reference')} lies {away / 1e3:.0f} km from {_file(study, 'gnss')}: are they of one "
                "vehicle, and in one unit?"
            )
    if depth is not None and len(depth) and float(np.median(depth["depth"])) < 0.0:
        deepest = float(np.min(depth["depth"]))
        if deepest < -3.0:
            notes.append(
                f"{_file(study, 'depth')}: most depths are negative, down to {deepest:.3g} m; depth counts downwards, "
                "so this would be above the water: change its sign?"
            )
    return notes


def to_body(study: Study, tables: dict[str, Table]) -> None:
    """Turns the imu's columns (and its magnetometer's) by [mounting] imu_to_body_rpy_deg, in place."""
    angles = study.mounting.imu_to_body_rpy_deg
    if "imu" not in tables or not any(angles):
        return
    from schuler.ground.frames import dcm_from_euler

    C_body_imu = dcm_from_euler(*np.radians(angles))
    imu = tables["imu"]
    columns = dict(imu.columns)
    for stem in ("gyro", "accel", "dtheta", "dv", "mag"):
        names = [f"{stem}_{axis}" for axis in "xyz"]
        if all(n in imu for n in names):
            turned = imu.stack(*names) @ C_body_imu.T
            columns.update({n: np.ascontiguousarray(turned[:, k]) for k, n in enumerate(names)})
    tables["imu"] = Table(imu.name, columns, imu.kind, imu.source, imu.notes)


def check_gravity(study: Study, tables: dict[str, Table], *, upright: bool = True) -> None:
    """Specific force must be about g, and up: f_z = -g for an upright vehicle in forward-right-down axes.

    upright : False for what is moved by hand through any attitude; then only the size is looked at.
    """
    imu = tables.get("imu")
    if imu is None:
        return
    file = _file(study, "imu")
    if imu.kind == "increments":
        dt = np.diff(imu.time, prepend=imu.time[0] - float(np.median(np.diff(imu.time))))
        f = imu.stack("dv_x", "dv_y", "dv_z") / dt[:, None]
    else:
        f = imu.stack("accel_x", "accel_y", "accel_z")
    f = f[np.isfinite(f).all(axis=1)]
    size = float(np.median(np.linalg.norm(f, axis=1)))
    if not 0.8 * G < size < 1.25 * G:
        hint = "is it raw counts, or with gravity taken out?"
        for unit, factor in (("g", 1.0), ("mg", 1e3), ("ft/s^2", G / 0.3048)):
            if 0.8 * factor < size < 1.25 * factor:
                hint = f"that is {unit}; type  schuler convert {file} imu-si.csv --accel-unit {unit}"
        raise InputError(
            f"{file}: specific force has a median size of {size:.4g} m/s^2 where g = 9.81 is expected; {hint}"
        )
    mean = np.median(f, axis=0)
    if upright and mean[2] > -0.5 * G:
        axis = int(np.argmax(np.abs(mean)))
        sign = "+" if mean[axis] > 0 else "-"
        turn = {
            (2, "+"): "[180, 0, 0] for forward-left-up axes",
            (1, "+"): "[90, 0, 0]",
            (1, "-"): "[-90, 0, 0]",
            (0, "+"): "[0, 90, 0]",
            (0, "-"): "[0, -90, 0]",
        }
        want = turn.get((axis, sign), "the angles of the mounting")
        raise InputError(
            f"{file}: gravity is felt as {sign}9.8 on {'xyz'[axis]}; forward-right-down axes feel -9.8 on z; "
            f"type [mounting] imu_to_body_rpy_deg = {want}"
        )


def withhold(
    study: Study, inputs: Inputs
) -> tuple[dict[str, Table], dict[str, Table], list[tuple[OutageSection, Table]]]:
    """Takes the rows of every [[outage]] out, start_s <= time <= end_s.

    Returns the tables that are left, the rows withheld by sensor, and each outage with its own rows. A magnetometer
    lies in the imu table: its columns are NaN there.
    """
    tables = dict(inputs.tables)
    withheld: dict[str, Table] = {}
    each = []
    faults = []
    gone: dict[str, NDArray[np.bool_]] = {}
    for number, outage in enumerate(study.outage, 1):
        name = "imu" if outage.sensor == "magnetometer" else outage.sensor
        table = inputs.tables.get(name)
        if table is None or (outage.sensor == "magnetometer" and not all(c in table for c in MAG)):
            have = ", ".join(inputs.tables)
            faults.append(f"[[outage]] {number} sensor: there is no {outage.sensor} to withhold; the study has {have}")
            continue
        rows = (table.time >= outage.start_s) & (table.time <= outage.end_s)
        if not rows.any():
            a, b = span(table)
            faults.append(
                f"[[outage]] {number}: no {outage.sensor} row lies from {outage.start_s:g} to {outage.end_s:g} s; "
                f"they run from {a:.1f} to {b:.1f} s"
            )
            continue
        each.append((outage, table.where(rows)))
        gone[outage.sensor] = gone.get(outage.sensor, np.zeros(len(table), dtype=bool)) | rows
    if faults:
        raise InputError("\n".join(faults))
    for sensor, rows in gone.items():
        if sensor == "magnetometer":
            imu = inputs.tables["imu"]
            columns = {k: np.where(rows, np.nan, v) if k in MAG else v for k, v in imu.columns.items()}
            tables["imu"] = Table(imu.name, columns, imu.kind, imu.source, imu.notes)
            withheld[sensor] = imu.where(rows)
        else:
            table = inputs.tables[sensor]
            withheld[sensor] = table.where(rows)
            if rows.all():
                del tables[sensor]
            else:
                tables[sensor] = table.where(~rows)
    return tables, withheld, each
