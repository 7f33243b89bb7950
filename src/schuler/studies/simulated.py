"""Kind "aided" without [input]: from a study to a trajectory, an IMU and a suite of sensors (SI, radians)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.ground.errors import InputError, StudyError
from schuler.ground.tables import Table
from schuler.ground.units import DEG

if TYPE_CHECKING:
    from schuler.aiding.aided_settings import AidedSettings
    from schuler.studies.model import Study
    from schuler.studies.sections import SimulateSection
    from schuler.truth.aided import AidedRecording, AidedSuite
    from schuler.truth.instruments import ImuModel
    from schuler.truth.trajectories import Trajectory

DOWN = 1.5  # the slow error of a fix is so much larger down than north and east
SENSORS = ("gnss", "speed", "dvl", "depth", "height", "ranges")
COMPASS_TAU_S = 0.02  # s: five rows a second, which is what the filter takes, are independent


@dataclass(frozen=True)
class Simulation:
    """What is simulated: where it goes, with which IMU at which rate, with what else aboard."""

    trajectory: Trajectory
    imu: ImuModel
    suite: AidedSuite
    rate_hz: float

    def record(self, seed: int, run: int = 0) -> AidedRecording:
        """One recording; the same (seed, run) gives the same numbers."""
        from schuler.truth.aided import simulate

        return simulate(self.trajectory, self.imu, self.suite, self.rate_hz, seed=seed, run=run)


def as_it_is(study: Study) -> Study:
    """The study whose [imu], [noise] and [start] are what is true, with those of [simulate] in their place."""
    s = study.simulate
    if s is None:
        return study
    changes: dict[str, Any] = {}
    if s.imu is not None:
        changes["imu"] = s.imu
    for name in ("noise", "start"):
        real = getattr(s, name)
        if real is not None:
            typed = {key: getattr(real, key) for key in real.model_fields_set}
            changes[name] = getattr(study, name).model_copy(update=typed)
    return study.model_copy(update=changes) if changes else study


def simulation(study: Study, reference: Table | None = None) -> Simulation:
    """The simulation of [trajectory], [start], [imu], [errors], [simulate], [noise] and [mounting].

    reference : what preset = "track" follows. StudyError with every fault that these sections have together.
    """
    from schuler.studies.auv_mapping import DEFAULT_IMU, imu_model
    from schuler.studies.model import TrajectorySection
    from schuler.truth.keys import imu_from_keys

    faults = _faults(study)
    study = as_it_is(study)
    t = study.trajectory or TrajectorySection()
    trajectory = imu = suite = None
    try:
        trajectory = _trajectory(study, reference)
    except StudyError as error:
        faults += error.faults
    except InputError as error:
        faults.append(f"[trajectory] {error}")
    try:
        imu = imu_model(study) or imu_from_keys({"preset": DEFAULT_IMU})
    except StudyError as error:
        faults += error.faults
    try:
        suite = suite_of(study)
    except StudyError as error:
        faults += error.faults
    if faults or trajectory is None or imu is None or suite is None:
        raise StudyError(faults)
    return Simulation(trajectory, imu, suite, t.rate_hz)


def _faults(study: Study) -> list[str]:
    from schuler.studies.model import TrajectorySection
    from schuler.studies.sections import SimulateSection

    t, s = study.trajectory or TrajectorySection(), study.simulate or SimulateSection()
    faults = []
    given = [name for name in study.input.tables if name != "reference"]
    if given:
        faults.append(
            f"[simulate]: came beside [input] {', '.join(given)}; a recording is not simulated; "
            "delete [simulate] and [trajectory], or [input]"
        )
    if t.earth != "wgs84":
        faults.append('[trajectory] earth: kind "aided" navigates on WGS 84; type earth = "wgs84"')
    if t.duration_s * t.rate_hz < 10.0:
        faults.append(
            f"[trajectory] duration_s = {t.duration_s:g} at rate_hz = {t.rate_hz:g} holds fewer than ten IMU rows; "
            "lengthen duration_s or raise rate_hz"
        )
    for name in ("gnss", "speed", "dvl", "depth", "height", "ranges"):
        rate = getattr(s, f"{name}_hz")
        if 0.0 < rate and rate * t.duration_s < 1.0:
            faults.append(
                f"[simulate] {name}_hz = {rate:g}: no row falls into duration_s = {t.duration_s:g}; raise it, or type "
                f"{name}_hz = 0"
            )
    pictures = s.sightings_hz or (1.0 if s.sightings_per_s > 0.0 else 0.0)
    if pictures > 0.0 and study.camera is None:
        faults.append(
            "[simulate] sightings_per_s: a camera sees them, and [camera] is absent; type [camera] with focal_px = 8889"
        )
    if pictures > 0.0 and 0.0 < s.sightings_per_s < 0.5 * pictures:
        faults.append(
            f"[simulate] sightings_per_s = {s.sightings_per_s:g} is less than one a picture at sightings_hz = "
            f"{pictures:g}; lower sightings_hz"
        )
    return faults


def _trajectory(study: Study, reference: Table | None) -> Trajectory:
    from schuler.studies.kind_strapdown import track_of, trajectory_of

    if study.trajectory is not None and study.trajectory.preset == "track" and reference is not None:
        return track_of(study, reference)
    return trajectory_of(study)


def suite_of(study: Study) -> AidedSuite:
    """The sensors of [simulate] with the noise of [noise] in the places of [mounting].

    What [simulate] gives no sigma is drawn with the filter's own prior where the filter estimates it, and is zero where
    it does not.
    """
    from schuler.studies.aided_mapping import aided_settings
    from schuler.studies.sections import SimulateSection
    from schuler.truth.aided import AidedSuite
    from schuler.truth.instruments import Magnetometer

    s, n, m, k = study.simulate or SimulateSection(), study.noise, study.mounting, study.start
    f = aided_settings(study)
    found = _estimated(f, s)

    def drawn(typed: float | None, name: str, prior: float, unit: float = 1.0) -> float:
        """The sigma typed, in SI, or the filter's prior."""
        return typed * unit if typed is not None else prior if name in found else 0.0

    told = s.noise is not None and "gnss_correlated_m" in s.noise.model_fields_set
    slow = drawn(n.gnss_correlated_m if told else None, "gnss_bias", f.gnss_correlated_std)
    compass = None
    if s.magnetometer:
        offset = drawn(s.heading_offset_deg, "heading_offset", f.heading_offset_std, DEG)
        iron = drawn(s.mag_bias_ut, "mag_bias", f.mag_bias_std, 1e-6)
        compass = Magnetometer(bias_deg=offset / DEG, noise_deg=n.mag_deg, tau_s=COMPASS_TAU_S, hard_iron_ut=iron * 1e6)
    later = s.gnss_velocity_delay_s
    if later is None and ("gnss_velocity_delay" in found) != ("gnss_delay" in found):
        later = f.gnss_delay_std if "gnss_velocity_delay" in found else 0.0
    start = [k.std_north_m, k.std_east_m, k.std_down_m, k.std_v_north_mps, k.std_v_east_mps, k.std_v_down_mps]
    start += [None if x is None else x * DEG for x in (k.std_roll_deg, k.std_pitch_deg, k.std_heading_deg)]
    rates: dict[str, Any] = {f"{name}_hz": getattr(s, f"{name}_hz") for name in SENSORS}
    roll, pitch, yaw = m.imu_to_body_rpy_deg
    return AidedSuite(
        **rates,
        gnss_velocity=s.gnss_velocity,
        gnss_height=s.gnss_height,
        gnss_std=f.gnss_std,
        gnss_velocity_std=f.gnss_velocity_std,
        gnss_correlated=(slow, slow, DOWN * slow),
        gnss_correlated_tau=f.gnss_correlated_tau,
        gnss_delay=f.gnss_delay,
        gnss_delay_std=drawn(s.gnss_delay_s, "gnss_delay", f.gnss_delay_std),
        gnss_velocity_delay_std=later,
        antenna=f.antenna,
        antenna_std=drawn(s.antenna_lever_m, "antenna_lever", f.antenna_std),
        speed_std=f.speed_std,
        speed_scale_std=drawn(None, "speed_scale", f.speed_scale_std),
        speed_arm=f.speed_arm,
        speed_arm_std=drawn(s.speed_lever_m, "speed_lever", f.antenna_std),
        speed_delay_std=drawn(s.speed_delay_s, "speed_delay", f.gnss_delay_std),
        speed_is=s.speed_is or study.filter.speed_is,
        current_std=f.current_std,
        current_walk=f.current_walk,
        dvl_std=f.dvl_std,
        dvl_scale_std=drawn(None, "dvl_scale", f.dvl_scale_std),
        dvl_misalignment_std=drawn(s.dvl_misalignment_deg, "dvl_misalignment", f.dvl_misalignment_std, DEG),
        dvl_arm=f.dvl_arm,
        dvl_arm_std=drawn(s.dvl_lever_m, "dvl_lever", f.antenna_std),
        dvl_delay_std=drawn(s.dvl_delay_s, "dvl_delay", f.gnss_delay_std),
        depth_std=f.depth_std,
        depth_bias_std=drawn(s.depth_bias_m, "depth_bias", f.depth_bias_std),
        height_std=f.height_std,
        height_bias_std=drawn(s.height_bias_m, "height_bias", f.height_bias_std),
        height_walk=drawn(s.height_walk_m_per_sqrt_h, "height_bias", f.height_walk, 1.0 / 60.0),
        magnetometer=compass,
        year=s.year,
        range_std=f.range_std,
        range_scale_std=drawn(s.range_scale_percent, "range_scale", f.range_scale_std, 0.01),
        range_bias_std=drawn(s.range_bias_m, "range_bias", f.range_bias_std),
        beacons=s.beacons,
        beacon_radius=s.beacon_radius_m,
        imu_to_body=(roll * DEG, pitch * DEG, yaw * DEG),
        mounting_std=drawn(s.mounting_deg, "mounting", f.mounting_std, DEG),
        imu_kind=s.imu_rows,
        start_std=tuple(0.0 if x is None else float(x) for x in start),
        reference_arm=m.reference_frd_m,
        **_optics(study),
    )


def _optics(study: Study) -> dict[str, Any]:
    """Camera and lidar of [simulate], [camera] and [lidar]."""
    from schuler.ground.lidar import Lidar
    from schuler.studies.aided_mapping import camera_of
    from schuler.studies.sections import LidarSection, SimulateSection

    s = study.simulate or SimulateSection()
    pictures = s.sightings_hz or (1.0 if s.sightings_per_s > 0.0 else 0.0)
    beam = study.lidar or LidarSection()
    return {
        "camera": camera_of(study),
        "sightings_hz": pictures,
        "sightings_each": max(1, round(s.sightings_per_s / pictures)) if s.sightings_per_s > 0.0 and pictures else 6,
        "sightings_wrong": 0.01 * s.wrong_names_percent,
        "picture": s.picture_px,
        "lidar_hz": s.lidar_hz,
        "lidar": Lidar(study.noise.lidar_m, beam.reach_m, 1e-3 * beam.divergence_mrad, np.array(beam.position_frd_m)),
        "ground_height": s.ground_height_m,
        "ground_relief": s.ground_relief_m,
        "ground_std": beam.ground_m if s.lidar_hz > 0.0 else 0.0,
    }


def _estimated(settings: AidedSettings, s: SimulateSection) -> set[str]:
    """What the filter estimates with these sensors: as typed, or what it chooses itself."""
    from schuler.aiding.aided_settings import chosen

    present = {name for name in SENSORS if getattr(s, f"{name}_hz") > 0.0}
    return set(chosen(settings, present | ({"magnetometer"} if s.magnetometer else set())))
