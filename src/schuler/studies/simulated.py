"""Kind "aided" without [input]: from a study to a trajectory, an IMU and a suite of sensors (SI, radians)."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians
from typing import TYPE_CHECKING, Any

from schuler.ground.errors import InputError, StudyError
from schuler.ground.tables import Table

if TYPE_CHECKING:
    from schuler.studies.model import Study
    from schuler.truth.aided import AidedRecording, AidedSuite
    from schuler.truth.instruments import ImuModel
    from schuler.truth.trajectories import Trajectory

DOWN = 1.5  # the slow error of a fix is so much larger down than north and east
# sensors of [simulate] that need the camera or the lidar
_OPTICS = ("sightings_per_s", "sightings_hz", "lidar_hz")


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


def simulation(study: Study, reference: Table | None = None) -> Simulation:
    """The simulation of [trajectory], [start], [imu], [errors], [simulate], [noise] and [mounting].

    reference : what preset = "track" follows. StudyError with every fault that these sections have together.
    """
    from schuler.studies.auv_mapping import DEFAULT_IMU, imu_model
    from schuler.studies.model import TrajectorySection
    from schuler.truth.keys import imu_from_keys

    faults = _faults(study)
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
    faults += [
        f"[simulate] {name}: a camera and a lidar are not simulated yet; type {name} = 0" for name in _OPTICS
        if getattr(s, name) > 0.0
    ]  # fmt: skip
    return faults


def _trajectory(study: Study, reference: Table | None) -> Trajectory:
    from schuler.studies.kind_strapdown import track_of, trajectory_of

    if study.trajectory is not None and study.trajectory.preset == "track" and reference is not None:
        return track_of(study, reference)
    return trajectory_of(study)


def suite_of(study: Study) -> AidedSuite:
    """The sensors of [simulate] with the noise of [noise] in the places of [mounting].

    A slow error of the fixes is put on where [noise] types gnss_correlated_m or [filter] estimate names gnss_bias.
    """
    from schuler.studies.sections import SimulateSection
    from schuler.truth.aided import AidedSuite
    from schuler.truth.instruments import Magnetometer

    s, n, m, k = study.simulate or SimulateSection(), study.noise, study.mounting, study.start
    slow = 0.0
    if "gnss_correlated_m" in n.model_fields_set or "gnss_bias" in (study.filter.estimate or ()):
        slow = n.gnss_correlated_m
    compass = None
    if s.magnetometer:
        compass = Magnetometer(bias_deg=s.mag_bias_deg, noise_deg=n.mag_deg, hard_iron_ut=s.hard_iron_ut)
    later = s.gnss_velocity_delay_s
    roll, pitch, yaw = m.imu_to_body_rpy_deg
    start = [k.std_north_m, k.std_east_m, k.std_down_m, k.std_v_north_mps, k.std_v_east_mps, k.std_v_down_mps]
    start += [None if x is None else radians(x) for x in (k.std_roll_deg, k.std_pitch_deg, k.std_heading_deg)]
    chosen: dict[str, Any] = {f"{name}_hz": getattr(s, f"{name}_hz") for name in _SENSORS}
    return AidedSuite(
        **chosen,
        gnss_velocity=s.gnss_velocity,
        gnss_std=n.gnss_m,
        gnss_velocity_std=n.gnss_mps,
        gnss_correlated=(slow, slow, DOWN * slow),
        gnss_correlated_tau=n.gnss_correlated_tau_s,
        gnss_delay=study.input.gnss_delay_s,
        gnss_delay_std=s.gnss_delay_s,
        gnss_velocity_delay_std=later,
        antenna=m.antenna_frd_m,
        antenna_std=s.antenna_lever_m,
        speed_std=n.speed_mps,
        speed_scale_std=0.01 * n.speed_scale_percent,
        speed_arm=m.speed_frd_m,
        speed_arm_std=s.speed_lever_m,
        speed_delay_std=s.speed_delay_s,
        speed_is=s.speed_is,
        current_std=n.current_mps,
        current_walk=n.current_walk_mps_per_sqrt_h / 60.0,
        dvl_std=n.dvl_mps,
        dvl_scale_std=0.01 * n.dvl_scale_percent,
        dvl_misalignment_std=radians(s.dvl_misalignment_deg),
        dvl_arm=m.dvl_frd_m,
        dvl_arm_std=s.dvl_lever_m,
        dvl_delay_std=s.dvl_delay_s,
        depth_std=n.depth_m,
        height_std=n.height_m,
        height_bias_std=s.height_bias_m,
        height_bias_tau=s.height_tau_s,
        magnetometer=compass,
        year=s.year,
        range_std=n.range_m,
        range_scale_std=0.01 * s.range_scale_percent,
        beacons=s.beacons,
        beacon_radius=s.beacon_radius_m,
        imu_to_body=(radians(roll), radians(pitch), radians(yaw)),
        mounting_std=radians(s.mounting_deg),
        imu_kind=s.imu_rows,
        start_std=tuple(0.0 if x is None else float(x) for x in start),
        reference_arm=m.reference_frd_m,
    )


_SENSORS = ("gnss", "speed", "dvl", "depth", "height", "ranges")
