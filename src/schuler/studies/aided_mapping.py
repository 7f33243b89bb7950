"""Kind "aided": from the study's sections (units as typed) to the filter's settings (SI, radians)."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.studies.auv_mapping import PER_SQRT_H, given, imu_model, output_rate

if TYPE_CHECKING:
    from schuler.aiding.aided_settings import AidedSettings, Start
    from schuler.ground.camera import Camera
    from schuler.studies.model import Study
    from schuler.truth.instruments import ImuModel

# No instrument is without noise, and a filter that believes so ends with sigmas of rounding.
LEAST_ARW, LEAST_VRW = 1e-7, 1e-5  # rad/sqrt(s), m/s/sqrt(s)
UNTOLD_MPS = (0.2, 0.2, 0.3)
WIND_MPS, WIND_WALK = 8.0, 0.1  # m/s, m/s/sqrt(s): what air does where the study does not say


def aided_settings(study: Study, *, declination: float | None = None) -> AidedSettings:
    """Settings of kind "aided". declination: rad, where the study does not give it."""
    from schuler.aiding.aided_settings import AidedSettings
    from schuler.studies.sections import LidarSection

    n, m, f = study.noise, study.mounting, study.filter
    lidar = study.lidar or LidarSection()
    typed = study.input.declination_deg
    simulated = not [name for name in study.input.tables if name != "reference"]
    current, walk = n.current_mps, n.current_walk_mps_per_sqrt_h * PER_SQRT_H
    if f.speed_is == "air":
        current = current if "current_mps" in n.model_fields_set else WIND_MPS
        walk = walk if "current_walk_mps_per_sqrt_h" in n.model_fields_set else WIND_WALK
    settings = AidedSettings(
        start=start_of(study),
        gnss_std=n.gnss_m,
        # a receiver whose velocity is good to 0.05 m/s says so
        gnss_velocity_std=n.gnss_mps if simulated or "gnss_mps" in n.model_fields_set else UNTOLD_MPS,
        gnss_correlated_std=n.gnss_correlated_m,
        gnss_correlated_tau=n.gnss_correlated_tau_s,
        gnss_delay=study.input.gnss_delay_s,
        gnss_delay_std=n.delay_s,
        delay_walk=n.delay_walk_s_per_sqrt_s,
        antenna_std=n.lever_m,
        speed_std=n.speed_mps,
        speed_scale_std=0.01 * n.speed_scale_percent,
        speed_is=f.speed_is,
        current_std=current,
        current_walk=walk,
        dvl_std=n.dvl_mps,
        dvl_scale_std=0.01 * n.dvl_scale_percent,
        dvl_misalignment_std=radians(n.dvl_misalignment_deg),
        depth_std=n.depth_m,
        depth_bias_std=n.depth_bias_m,
        height_std=n.height_m,
        height_bias_std=n.height_bias_m,
        height_walk=n.height_walk_m_per_sqrt_h * PER_SQRT_H,
        attitude_std=(radians(n.attitude_deg[0]), radians(n.attitude_deg[1]), radians(n.attitude_deg[2])),
        attitude_tau=n.attitude_tau_s,
        mag_std=radians(n.mag_deg),
        mag_bias_std=n.mag_bias_ut * 1e-6,
        heading_offset_std=radians(2.0 if n.heading_offset_deg is None else n.heading_offset_deg),
        declination=radians(typed) if typed is not None else declination or 0.0,
        range_std=n.range_m,
        range_scale_std=0.01 * n.range_scale_percent,
        range_bias_std=n.range_bias_m,
        camera=camera_of(study),
        lidar_std=n.lidar_m,
        lidar_arm=lidar.position_frd_m,
        lidar_reach=lidar.reach_m,
        lidar_divergence=1e-3 * lidar.divergence_mrad,
        ground_std=lidar.ground_m,
        antenna=m.antenna_frd_m,
        dvl_arm=m.dvl_frd_m,
        speed_arm=m.speed_frd_m,
        mounting_std=radians(n.mounting_deg),
        constraints=f.constraints,
        nhc_point=f.nhc_frd_m,
        nhc_std=n.nhc_mps,
        zupt_std=n.zupt_mps,
        estimate=None if f.estimate is None else estimates(study),
        gate=f.robust,
        open_loop=f.loop == "open",
        vertical=f.vertical,
        bias_model=f.bias_model,
        distrust=f.distrust_s,
        smoother=f.smoother,
        output_rate=output_rate(study),
    )
    believed = study.simulate is not None and study.simulate.imu is not None  # then [errors] are not the filter's
    imu = imu_model(study.model_copy(update={"errors": None}) if believed else study)
    return settings if imu is None else replace(settings, **imu_figures(imu, least=f.robust))


def camera_of(study: Study) -> Camera | None:
    """The camera of [camera]."""
    from schuler.ground.camera import Camera

    k = study.camera
    if k is None:
        return None
    return Camera.of(
        k.focal_px, u0_px=k.u0_px, v0_px=k.v0_px, sigma_px=k.sigma_px, body_to_camera_rpy_deg=k.body_to_camera_rpy_deg,
        position_frd_m=k.position_frd_m,
    )  # fmt: skip


def estimates(study: Study) -> tuple[str, ...]:
    """[filter] estimate in the filter's own names."""
    return tuple("current" if name == "wind" else name for name in study.filter.estimate or ())


def imu_figures(imu: ImuModel, least: bool = True) -> dict[str, Any]:
    """The IMU's errors as the filter is told them; what the instrument does not say of walks is none. least: with the
    least noise that an instrument can have."""
    arw, vrw = (LEAST_ARW, LEAST_VRW) if least else (0.0, 0.0)

    def triple(values: Any) -> tuple[float, float, float]:
        a, b, c = (float(v) for v in values)
        return a, b, c

    figures: dict[str, Any] = {
        "gyro_arw": triple(np.maximum(imu.arw, arw)),
        "accel_vrw": triple(np.maximum(imu.vrw, vrw)),
        "gyro_bias_std": triple(np.hypot(imu.gyro_bias, np.abs(imu.gyro_offset))),
        "accel_bias_std": triple(np.hypot(imu.accel_bias, np.abs(imu.accel_offset))),
        "gyro_instability": float(np.max(imu.gyro_instability)),
        "accel_instability": float(np.max(imu.accel_instability)),
        "gyro_tau": imu.gyro_tau_s,
        "accel_tau": imu.accel_tau_s,
        "gyro_walk": float(np.max(imu.gyro_rrw)),
        "accel_walk": float(np.max(imu.accel_rrw)),
    }
    figures |= {
        "gyro_scale_std": float(np.max(imu.gyro_scale)),
        "accel_scale_std": float(np.max(imu.accel_scale)),
        "gyro_misalignment_std": imu.gyro_misalignment,
        "accel_misalignment_std": imu.accel_misalignment,
    }
    return figures


def start_of(study: Study) -> Start:
    """[start] in SI; what is absent stays None and is found by the filter."""
    from schuler.aiding.aided_settings import Start
    from schuler.studies.auv_mapping import start_of as place_of

    s, place = study.start, place_of(study)
    return Start(
        **vars(place),
        v_n=(s.v_north_mps, s.v_east_mps, s.v_down_mps),
        std_vel=(s.std_v_north_mps, s.std_v_east_mps, s.std_v_down_mps),
    )


def unread(study: Study) -> list[str]:
    """Sections, tables and keys that the study names and this kind does not read, as sentences."""
    notes = []
    names = [name for name in ("mission", "platform") if name in study.model_fields_set]
    if names:
        notes.append(f'{", ".join(f"[{n}]" for n in names)}: not read by kind "aided"; left out')
    if "path_scale_percent" in given(study.noise):
        notes.append('[noise] path_scale_percent: belongs to kind "auv"; left out')
    return notes
