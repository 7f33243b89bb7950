"""Kind "ahrs": from the study's sections (units as typed) to the filter's settings (SI, radians)."""

from __future__ import annotations

from dataclasses import replace
from math import inf, radians, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.studies.auv_mapping import given, imu_model

if TYPE_CHECKING:
    from schuler.aiding.ahrs import AhrsSettings
    from schuler.ground.tables import Table
    from schuler.studies.model import Study


def ahrs_settings(study: Study, tables: dict[str, Table], declination: float | None) -> AhrsSettings:
    """Settings; declination: rad, where the study does not type it."""
    from schuler.aiding.ahrs import AhrsSettings

    s, rate = study.start, study.output.rate_hz

    def angle(value: float | None) -> float | None:
        return None if value is None else radians(value)

    typed = study.input.declination_deg
    settings = AhrsSettings(
        mag_std=radians(study.noise.mag_deg),
        declination=radians(typed) if typed is not None else declination or 0.0,
        lat=latitude(study, tables),
        start_time=s.time_s,
        start_roll=angle(s.roll_deg),
        start_pitch=angle(s.pitch_deg),
        start_heading=angle(s.heading_deg),
        smoother=study.filter.smoother,
        output_rate=inf if rate == "imu" else None if rate is None else float(rate),
    )
    tilt = [v for v in (s.std_roll_deg, s.std_pitch_deg) if v is not None]
    if tilt:
        settings = replace(settings, std_tilt=radians(max(tilt)))
    if s.std_heading_deg is not None:
        settings = replace(settings, std_heading=radians(s.std_heading_deg))
    return replace(settings, **imu_figures(study, settings))


def latitude(study: Study, tables: dict[str, Table]) -> float | None:
    """Where the Earth's rate is known: [start], else the first fix, rad."""
    if study.start.lat_deg is not None:
        return radians(study.start.lat_deg)
    gnss = tables.get("gnss")
    if gnss is None or "lat" not in gnss or not np.isfinite(gnss["lat"]).any():
        return None
    return float(gnss["lat"][np.isfinite(gnss["lat"])][0])


def imu_figures(study: Study, settings: AhrsSettings) -> dict[str, Any]:
    """What [imu] says, one figure for all axes (the worst); the settings' own where it does not say.

    A scale that is not typed follows the gyro's noise: a gyro ten times better has a scale ten times better.
    """
    model = imu_model(study)
    if model is None:
        return {}
    largest = {
        "gyro_arw": model.arw,
        "gyro_bias_std": np.hypot(np.hypot(model.gyro_bias, np.abs(model.gyro_offset)), model.gyro_instability),
        "gyro_walk": np.hypot(model.gyro_instability * sqrt(2.0 / model.gyro_tau_s), model.gyro_rrw),
        "gyro_scale": np.hypot(model.gyro_scale, model.gyro_misalignment),
        "accel_vrw": model.vrw,
        "accel_bias_std": np.hypot(np.hypot(model.accel_bias, np.abs(model.accel_offset)), model.accel_instability),
        "accel_walk": np.hypot(model.accel_instability * sqrt(2.0 / model.accel_tau_s), model.accel_rrw),
    }
    found = {name: float(np.max(value)) for name, value in largest.items() if np.max(value) > 0.0}
    if "gyro_scale" not in found and "gyro_arw" in found:
        found["gyro_scale"] = settings.gyro_scale * min(1.0, found["gyro_arw"] / settings.gyro_arw)
    return found


def unread(study: Study) -> list[str]:
    """Sections, tables and keys that the study names and this kind does not read, as sentences."""
    sections = ("camera", "align", "trajectory", "platform", "mission", "sweep")
    notes = [f'[{name}]: not read by kind "ahrs"; left out' for name in sections if name in study.model_fields_set]
    others = [name for name in study.input.tables if name not in ("imu", "gnss", "reference")]
    if others:
        notes.append(f'[input] {", ".join(others)}: not used by kind "ahrs"; left out')
    if study.filter.constraints:
        notes.append(
            f'[filter] constraints {", ".join(study.filter.constraints)}: kind "ahrs" finds rest by itself; left out'
        )
    if study.filter.estimate is not None:
        notes.append('[filter] estimate: kind "ahrs" always learns the biases of gyros and accelerometers; left out')
    place = {"height_m", "std_north_m", "std_east_m", "std_down_m"}
    idle = [k for k in given(study.start) if k in place or "v_" in k]
    if idle:
        notes.append(f'[start] {", ".join(sorted(idle))}: kind "ahrs" knows attitude only; left out')
    return notes
