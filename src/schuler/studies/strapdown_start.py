"""Where a recording of kind "strapdown" begins: from [start], the first fix, and alignment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

if TYPE_CHECKING:
    from schuler.inertial.alignment import Alignment, SensorErrors
    from schuler.inertial.strapdown import Start
    from schuler.studies.model import Study

Array = NDArray[np.float64]
D = math.pi / 180.0


@dataclass(frozen=True)
class Found:
    """A start and how it was found: std (3,) rad of roll, pitch, heading where alignment gave them; gyro_bias_std (3,)
    rad/s where the mean rate at rest was taken off."""

    start: Start
    notes: list[str]
    std: Array | None = None
    gyro_bias_std: Array | None = None


def start_of(study: Study, tables: dict[str, Table], sensor: SensorErrors) -> Found:
    """Where a recording begins: each key of [start] that is given is kept, the others are found."""
    from schuler.ground.frames import dcm_from_euler
    from schuler.inertial.strapdown import Start

    s, notes = study.start, []
    imu, gnss = tables["imu"], tables.get("gnss")
    # Absent: the first row covers one median interval.
    time = s.time_s if s.time_s is not None else float(imu.time[0] - np.median(np.diff(imu.time)))
    place: list[float | None] = [
        s.lat_deg * D if s.lat_deg is not None else None, s.lon_deg * D if s.lon_deg is not None else None, s.height_m,
    ]  # fmt: skip
    v: list[float | None] = [s.v_north_mps, s.v_east_mps, s.v_down_mps]
    if gnss is None and (place[0] is None or place[1] is None):
        raise InputError(
            "the start position is not known: type [start] lat_deg, lon_deg and height_m, or name a gnss table in "
            "[input]"
        )
    rpy = [None if x is None else x * D for x in (s.roll_deg, s.pitch_deg, s.heading_deg)]
    std: Array | None = None
    bias_std: Array | None = None
    if any(x is None for x in rpy):
        lat = place[0] if place[0] is not None else float(gnss["lat"][0])  # type: ignore[index]
        found = _aligned(study, imu, sensor, lat, place[2] or 0.0, rpy[2])
        notes += found.notes
        std = found.std
        if rpy[2] is None and found.std[2] > 30.0 * D:
            raise InputError(
                "the heading at the start is not known and these gyros cannot find north: type [start] heading_deg"
            )
        if s.time_s is None:
            time = found.to
            v = [0.0 if x is None else x for x in v]  # it stood still until then
        rpy = [float(found.rpy[i]) if x is None else x for i, x in enumerate(rpy)]
        notes.append(
            f"aligned from {found.start:.1f} to {found.to:.1f} s: roll {math.degrees(rpy[0] or 0):.3f}, pitch "
            f"{math.degrees(rpy[1] or 0):.3f}, heading {math.degrees(rpy[2] or 0):.3f} deg"
        )
        if found.gyro_bias is not None and found.accel_bias is None:  # levelled only: the mean rate, Earth rate in it
            C_nb = dcm_from_euler(*(float(x or 0.0) for x in rpy))
            _take_bias(tables, found.gyro_bias - np.asarray(C_nb).T @ WGS84.earth_rate_n(lat))
            bias_std = sensor.arw / math.sqrt(max(found.to - found.start, 1.0))
            notes.append("the gyros' mean at rest, less the Earth's rate, was taken off as their bias")
    if gnss is not None and len(gnss) and any(x is None for x in (*place, *v)):
        # The last fix that is not later than the start, so that no row has seen a later one; else the first there is.
        row = max(int(np.searchsorted(gnss.time, time + 1e-9)) - 1, 0)
        if gnss.time[row] > time and s.time_s is None and not any(x is None for x in (s.roll_deg, s.pitch_deg)):
            time = float(gnss.time[row])
        for i, c in enumerate(("lat", "lon", "height")):
            if place[i] is None:
                place[i] = float(gnss[c][row])
        for i, c in enumerate(("v_north", "v_east", "v_down")):
            if v[i] is None and c in gnss and math.isfinite(gnss[c][row]):
                v[i] = float(gnss[c][row])
        notes.append(f"what [start] does not give of position and velocity is the fix at {gnss.time[row]:.2f} s")
    assert place[0] is not None and place[1] is not None
    numbers = [0.0 if x is None else float(x) for x in (*rpy, *v)]
    start = Start.level(
        place[0], place[1], place[2] or 0.0, roll=numbers[0], pitch=numbers[1], heading=numbers[2], v_n=numbers[3:],
        time=float(time),
    )  # fmt: skip
    return Found(start, notes, std, bias_std)


def _aligned(
    study: Study, imu: Table, sensor: SensorErrors, lat: float, height: float, heading: float | None
) -> Alignment:
    """The alignment of [align], or of the first still stretch; of a recording still to its end its first half, at most
    five minutes, so that something is left to navigate."""
    from schuler.inertial.alignment_filter import align

    window, given = study.align, study.start.std_heading_deg
    common: dict[str, Any] = {
        "lat": lat, "height": height, "heading": heading, "heading_std": None if given is None else given * D
    }  # fmt: skip
    if window is not None:
        return align(imu, sensor, start=window.from_s, to=window.to_s, **common)
    found = align(imu, sensor, **common)
    if study.start.time_s is None and found.to > imu.time[-1] - 1.0:
        to = found.start + min(0.5 * (found.to - found.start), 300.0)
        found = align(imu, sensor, start=found.start, to=to, **common)
        found.notes.append(
            f"the recording is still to its end: aligned until {to:.1f} s, navigated from there; [align] from_s and "
            "to_s choose otherwise"
        )
    return found


def _take_bias(tables: dict[str, Table], bias: Array) -> None:
    imu = tables["imu"]
    columns = dict(imu.columns)
    stem, scale = ("gyro", 1.0) if imu.kind != "increments" else ("dtheta", float(np.median(np.diff(imu.time))))
    for i, axis in enumerate("xyz"):
        columns[f"{stem}_{axis}"] = columns[f"{stem}_{axis}"] - bias[i] * scale
    tables["imu"] = Table(imu.name, columns, imu.kind, imu.source, imu.notes)
