"""Kind "auv": from the study's sections (units as typed) to settings, mission and instruments (SI, radians)."""

from __future__ import annotations

from dataclasses import replace
from math import inf, radians
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.ground.errors import StudyError

if TYPE_CHECKING:
    from schuler.aiding.auv_settings import AuvSettings, Start
    from schuler.aiding.paper import PaperSettings
    from schuler.studies.model import Study
    from schuler.truth.instruments import ImuModel
    from schuler.truth.missions import AuvMission
    from schuler.truth.sensors import SensorSuite

DEFAULT_IMU = "3dm-gx3-25"
PER_SQRT_H = 1.0 / 60.0  # of a quantity per sqrt(h) in per sqrt(s)
# what [filter] estimate may leave out, and the priors that are then zero
_PRIORS: dict[str, tuple[str, ...]] = {
    "gyro_bias": ("gyro_bias_std", "gyro_instability"),
    "accel_bias": ("accel_bias_std", "accel_instability"),
    "current": ("current_std",),
    "speed_scale": ("speed_scale_std", "path_scale_std"),
    "heading_offset": ("heading_offset_std",),
    "dvl_scale": ("dvl_scale_std",),
    "gnss_bias": ("gnss_correlated_std",),
}


def given(section: Any) -> dict[str, Any]:
    """The keys of a section that the study file itself names, with their values."""
    return {} if section is None else {k: getattr(section, k) for k in section.model_fields_set}


def _rad3(degrees: tuple[float, float, float]) -> tuple[float, float, float]:
    return radians(degrees[0]), radians(degrees[1]), radians(degrees[2])


def imu_model(study: Study) -> ImuModel | None:
    """The IMU of [imu] with [errors] put on it; None where the study has neither."""
    from schuler.truth.keys import imu_from_keys

    keys = {k: v for k, v in given(study.imu).items() if v is not None}
    errors = {k: v for k, v in given(study.errors).items() if v is not None}
    if not keys and not errors:
        return None
    return imu_from_keys(keys or {"preset": DEFAULT_IMU}, errors)


def start_of(study: Study) -> Start:
    """[start] in SI; what is absent stays None and is found by the filter."""
    from schuler.aiding.auv_settings import Start

    s = study.start

    def angle(value: float | None) -> float | None:
        return None if value is None else radians(value)

    return Start(
        time=s.time_s,
        lat=angle(s.lat_deg),
        lon=angle(s.lon_deg),
        height=s.height_m,
        roll=angle(s.roll_deg),
        pitch=angle(s.pitch_deg),
        heading=angle(s.heading_deg),
        std_pos=(s.std_north_m, s.std_east_m, s.std_down_m),
        std_roll=angle(s.std_roll_deg),
        std_pitch=angle(s.std_pitch_deg),
        std_heading=angle(s.std_heading_deg),
    )


def output_rate(study: Study) -> float | None:
    """Rows a second; None: the default (10, or the finest input); inf: every epoch."""
    rate = study.output.rate_hz
    return inf if rate == "imu" else None if rate is None else float(rate)


def auv_settings(study: Study, *, declination: float | None = None) -> AuvSettings:
    """Settings of method "schuler". declination: rad, where the study does not give it (a simulated field)."""
    from schuler.aiding.auv_settings import AuvSettings

    n, m = study.noise, study.mounting
    typed = study.input.declination_deg
    settings = AuvSettings(
        start=start_of(study),
        gnss_std=n.gnss_m,
        gnss_velocity_std=n.gnss_mps,
        gnss_correlated_std=n.gnss_correlated_m,
        gnss_correlated_tau=n.gnss_correlated_tau_s,
        gnss_delay=study.input.gnss_delay_s,
        speed_std=n.speed_mps,
        speed_scale_std=0.01 * n.speed_scale_percent,
        dvl_std=n.dvl_mps,
        dvl_scale_std=0.01 * n.dvl_scale_percent,
        depth_std=n.depth_m,
        attitude_std=_rad3(n.attitude_deg),
        attitude_tau=n.attitude_tau_s,
        mag_std=radians(n.mag_deg),
        declination=radians(typed) if typed is not None else declination or 0.0,
        heading_offset_std=None if n.heading_offset_deg is None else radians(n.heading_offset_deg),
        current_std=n.current_mps,
        current_walk=n.current_walk_mps_per_sqrt_h * PER_SQRT_H,
        wave_std=_waves(study),
        wave_period=n.wave_period_s,
        drift_std=n.drift_mps,
        drift_tau=n.drift_tau_s,
        speed_walk=n.speed_walk_mps_per_sqrt_s,
        path_scale_std=0.01 * n.path_scale_percent,
        antenna=m.antenna_frd_m,
        dvl_arm=m.dvl_frd_m,
        speed_arm=m.speed_frd_m,
        consider_after=20.0 if study.filter.outage_policy == "consider" else inf,
        smoother=study.filter.smoother,
        output_rate=output_rate(study),
    )
    imu = imu_model(study)
    if imu is not None:
        settings = replace(settings, **_imu_figures(imu))
    if study.filter.estimate is not None:
        off = [name for name in _PRIORS if name not in study.filter.estimate]
        zero: dict[str, Any] = {prior: 0.0 for name in off for prior in _PRIORS[name]}
        settings = replace(settings, **zero)
    return settings


def _waves(study: Study) -> float:
    """Orbital velocity that the filter expects, rms of one axis: as typed, or for the sea that [mission] types."""
    sea = given(study.mission).get("wave_mps")
    if sea is None or "wave_mps" in study.noise.model_fields_set:
        return study.noise.wave_mps
    return max(0.6 * sea, 0.02)


def _imu_figures(imu: ImuModel) -> dict[str, Any]:
    """One figure for all three axes (the worst), and none where the instrument does not say."""
    figures = {
        "gyro_arw": imu.arw,
        "gyro_bias_std": np.hypot(imu.gyro_bias, np.abs(imu.gyro_offset)),
        "gyro_instability": imu.gyro_instability,
        "accel_bias_std": np.hypot(imu.accel_bias, np.abs(imu.accel_offset)),
        "accel_instability": imu.accel_instability,
    }
    known = {name: float(np.max(value)) for name, value in figures.items() if np.max(value) > 0.0}
    return {**known, "gyro_tau": imu.gyro_tau_s, "accel_tau": imu.accel_tau_s}


def not_estimated(study: Study) -> list[str]:
    """What [filter] estimate names and this kind does not learn, as sentences."""
    names = [name for name in study.filter.estimate or () if name not in _PRIORS]
    return [f'[filter] estimate: kind "auv" does not learn {", ".join(names)}; left out'] if names else []


def paper_settings(study: Study) -> PaperSettings:
    """Settings of methods "paper" and "paper-literal"."""
    from schuler.aiding.paper import PaperSettings

    n, start = study.noise, start_of(study)
    rate = output_rate(study)
    settings = PaperSettings(
        outage_policy=study.filter.outage_policy,
        literal=study.filter.method == "paper-literal",
        gnss_std=n.gnss_m,
        gnss_velocity_std=n.gnss_mps[0],
        speed_std=n.speed_mps,
        speed_scale_std=0.01 * n.speed_scale_percent,
        depth_std=n.depth_m,
        rate=10.0 if rate is None else None if rate == inf else rate,
        start_time=start.time,
        start_lat=start.lat,
        start_lon=start.lon,
        start_height=start.height,
        start_roll=start.roll,
        start_pitch=start.pitch,
        start_heading=start.heading,
    )
    imu = imu_model(study)
    if imu is not None and study.filter.estimate is None:
        bias = _imu_figures(imu).get("gyro_bias_std")
        settings = settings if bias is None else replace(settings, bias_std=bias)
    if study.filter.estimate is not None:
        settings = replace(settings, estimate_bias="gyro_bias" in study.filter.estimate)
    return settings


def mission_of(study: Study) -> AuvMission:
    """The mission of [mission]: a preset, numbers, or a preset whose numbers are replaced."""
    from schuler.truth.keys import mission_from_keys

    own = ("magnetometer", "dvl")
    keys = {k: v for k, v in given(study.mission).items() if v is not None and k not in own}
    start = given(study.start)
    for key in ("lat_deg", "lon_deg"):
        if start.get(key) is not None:
            keys.setdefault(key, start[key])
    return mission_from_keys(keys)


def suite_of(study: Study) -> SensorSuite:
    """The instruments of a simulated study: the preset's, changed by what [imu], [errors], [mounting], [noise] type.

    [mission] magnetometer and dvl say whether they are fitted; their noise alone fits them too.
    """
    from schuler.truth import instruments as inst
    from schuler.truth.keys import suite_from_keys
    from schuler.truth.sensors import SUITES

    mission, typed = study.mission, given(study.noise)
    preset = mission.preset if mission else None
    before = SUITES.get(preset or "demo")
    suite = suite_from_keys(
        preset=preset,
        imu={k: v for k, v in given(study.imu).items() if v is not None},
        errors={k: v for k, v in given(study.errors).items() if v is not None},
        noise={k: v for k, v in typed.items() if v is not None},
        mounting=given(study.mounting),
    )
    changes: dict[str, Any] = {}
    if suite.gnss is not None:
        # the filter keeps its slow error of fixes, so the simulated receiver keeps it too
        slow = before.gnss.correlated_m if before is not None and before.gnss is not None else (0.0, 0.0, 0.0)
        if "gnss_correlated_m" in typed:
            slow = (study.noise.gnss_correlated_m,) * 2 + (1.5 * study.noise.gnss_correlated_m,)
        changes["gnss"] = replace(suite.gnss, correlated_m=slow, tau_s=study.noise.gnss_correlated_tau_s)
    compass, dvl = suite.magnetometer, suite.dvl
    if mission is not None and mission.magnetometer is not None:
        compass = (compass or inst.Magnetometer()) if mission.magnetometer else None
    if compass is not None and study.noise.heading_offset_deg is not None:
        compass = replace(compass, bias_deg=study.noise.heading_offset_deg)
    if mission is not None and mission.dvl is not None:
        dvl = (dvl or inst.Dvl()) if mission.dvl else None
    if dvl is not None and "dvl_scale_percent" in typed:
        dvl = replace(dvl, scale_percent=study.noise.dvl_scale_percent)
    return suite.with_changes(magnetometer=compass, dvl=dvl, **changes)


def check_presets(study: Study) -> None:
    """StudyError with every fault that only the instruments and missions themselves can find."""
    faults: list[str] = []
    for make in (imu_model, mission_of) if study.mission is not None else (imu_model,):
        try:
            make(study)
        except StudyError as error:
            faults += error.faults
    if faults:
        raise StudyError(faults)
