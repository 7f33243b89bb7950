"""The sections of the study file: every key, its unit, default, range, meaning; docs/study-file.md is made from here.

Values keep the unit that their name says; the kinds turn them into SI.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError


def key(default: Any, meaning: str, unit: str = "", **limits: Any) -> Any:
    """A key of the study file. unit: as a person types it; "" for a pure number, word or file."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **limits)


def unit_of(field: Any) -> str:
    """Unit of a key as a person types it, "" for words and pure numbers."""
    return (field.json_schema_extra or {}).get("unit", "")


def _three(value: Any) -> Any:
    if isinstance(value, list):
        value = tuple(value)
    if (
        not isinstance(value, tuple)
        or len(value) != 3
        or not all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    ):
        raise PydanticCustomError("three_numbers", "expects three numbers [x, y, z]")
    return tuple(float(v) for v in value)


def _one_or_three(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (float(value),) * 3
    if isinstance(value, list | tuple) and len(value) == 3:
        return _three(value)
    raise PydanticCustomError("one_or_three_numbers", "expects one number, or three [x, y, z]")


def _sigma(value: Any) -> Any:
    value = _one_or_three(value)
    if min(value) < 0:
        raise PydanticCustomError("negative_sigma", "a sigma must be at least 0")
    return value


def _one_or_two(value: Any) -> Any:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (float(value),) * 2
    if (
        isinstance(value, list | tuple)
        and len(value) == 2
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    ):
        return tuple(float(v) for v in value)
    raise PydanticCustomError("two_numbers", "expects two numbers [x, y]")


def as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _grid(value: Any) -> Any:
    value = _three(value)
    if value[2] != int(value[2]) or value[2] < 1:
        raise PydanticCustomError("grid", "expects [from, to, how many], how many a whole number from 1")
    return value


def _rate(value: Any) -> Any:
    if value == "imu" or (isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1e5):
        return value
    raise PydanticCustomError("rate", 'expects a number of rows a second more than 0, or "imu"')


Three = Annotated[tuple[float, float, float], BeforeValidator(_three)]
OneOrThree = Annotated[tuple[float, float, float], BeforeValidator(_one_or_three)]
Sigma = Annotated[tuple[float, float, float], BeforeValidator(_sigma)]
Two = Annotated[tuple[float, float], BeforeValidator(_one_or_two)]
Grid = Annotated[tuple[float, float, float], BeforeValidator(_grid)]
Numbers = Annotated[tuple[float, ...], BeforeValidator(as_tuple)]
NumberOrNumbers = Annotated[
    tuple[float, ...],
    BeforeValidator(
        lambda v: (
            (float(v),) if isinstance(v, int | float) and not isinstance(v, bool) else as_tuple(v)
        )  # a single length
    ),
]

Estimate = Literal[
    "gyro_bias",
    "accel_bias",
    "current",
    "gyro_scale",
    "accel_scale",
    "speed_scale",
    "heading_offset",
    "mounting",
    "antenna_lever",
    "dvl_scale",
    "dvl_misalignment",
    "dvl_lever",
    "gnss_delay",
    "gnss_velocity_delay",
    "dvl_delay",
    "gnss_bias",
    "mag_bias",
    "gyro_misalignment",
    "accel_misalignment",
    "speed_lever",
    "speed_delay",
    "height_bias",
    "depth_bias",
    "wind",
    "range_scale",
    "range_bias",
]
Sensor = Literal[
    "gnss",
    "speed",
    "dvl",
    "depth",
    "attitude",
    "magnetometer",
    "height",
    "sightings",
    "ranges",
    "lidar",
]
Kind = Literal["auv", "aided", "ahrs", "planar", "strapdown", "platform"]


class Section(BaseModel):
    """Frozen, no unknown keys, no silent conversion of text to numbers, no infinities."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class StudySection(Section):
    name: str = key(
        ..., "what the study is called; the result folder is NAME-result", pattern=r"^[^/\\\x00.][^/\\\x00]*$"
    )
    kind: Kind = key(..., "what is run")


class InputSection(Section):
    imu: str | None = key(None, "gyros and accelerometers, optional magnetometer", "file")
    gnss: str | None = key(None, "fixes, and velocity where known", "file")
    speed: str | None = key(None, "axial speed log or odometer", "file")
    dvl: str | None = key(None, "velocity over ground in body axes", "file")
    depth: str | None = key(None, "depth, down", "file")
    attitude: str | None = key(None, "a vehicle's own compass / AHRS", "file")
    landmarks: str | None = key(None, "known points", "file")
    sightings: str | None = key(None, "where a camera saw them", "file")
    ranges: str | None = key(None, "distances to known points", "file")
    lidar: str | None = key(None, "ranges and angles", "file")
    height_model: str | None = key(None, "terrain heights on a regular grid", "file")
    height: str | None = key(None, "barometric height", "file")
    reference: str | None = key(None, "the truth, only for judging: never read by the filter", "file")
    rate_hz: float | None = key(None, "for an imu table without a time column", "Hz", gt=0)
    scale_gyro_deg_per_s: float | None = key(None, "the value of one count of a raw gyro", "deg/s", gt=0)
    scale_accel_g: float | None = key(None, "the value of one count of a raw accelerometer", "g", gt=0)
    gyro_unit: str | None = key(None, 'unit of the imu table\'s gyros whatever its heading says, e.g. "deg/s"')
    accel_unit: str | None = key(None, 'unit of its accelerometers whatever the heading says, e.g. "g"')
    trust_units: bool = key(False, "keep the units of the headings although the numbers speak against them")
    declination_deg: float | None = key(
        None,
        "magnetic variation, east positive, for heading_mag and magnetometers; else from WMM2025 at the first fix",
        "deg",
        ge=-180,
        le=180,
    )
    gnss_delay_s: float = key(0.0, "a gnss row stamped t belongs to t - delay", "s", ge=-5, le=5)
    reference_delay_s: float = key(0.0, "a reference row stamped t belongs to t - delay", "s")

    @property
    def tables(self) -> dict[str, str]:
        """Name of a table -> its file as typed, for the tables that are given."""
        names = [n for n, f in InputSection.model_fields.items() if unit_of(f) == "file"]
        return {n: getattr(self, n) for n in names if getattr(self, n) is not None}


class StartSection(Section):
    time_s: float | None = key(None, "when; absent: the first row", "s")
    lat_deg: float | None = key(None, "latitude; absent: from the first fixes", "deg", ge=-90, le=90)
    lon_deg: float | None = key(None, "longitude; absent: from the first fixes", "deg", ge=-180, le=360)
    north_m: float | None = key(None, 'kind "planar", tables in metres: where; absent: found', "m")
    east_m: float | None = key(None, 'kind "planar", tables in metres: where; absent: found', "m")
    height_m: float | None = key(None, "ellipsoidal height, up", "m")
    v_north_mps: float | None = key(None, "velocity north", "m/s")
    v_east_mps: float | None = key(None, "velocity east", "m/s")
    v_down_mps: float | None = key(None, "velocity down", "m/s")
    roll_deg: float | None = key(None, "roll; absent: by levelling", "deg", ge=-180, le=180)
    pitch_deg: float | None = key(None, "pitch; absent: by levelling", "deg", ge=-90, le=90)
    heading_deg: float | None = key(None, "true heading; absent: from compass or fixes", "deg", ge=-180, le=360)
    std_north_m: float | None = key(None, "1 sigma of the position north", "m", ge=0)
    std_east_m: float | None = key(None, "1 sigma of the position east", "m", ge=0)
    std_down_m: float | None = key(None, "1 sigma of the height", "m", ge=0)
    std_v_north_mps: float | None = key(None, "1 sigma of the velocity north", "m/s", ge=0)
    std_v_east_mps: float | None = key(None, "1 sigma of the velocity east", "m/s", ge=0)
    std_v_down_mps: float | None = key(None, "1 sigma of the velocity down", "m/s", ge=0)
    std_roll_deg: float | None = key(None, "1 sigma of the roll", "deg", ge=0)
    std_pitch_deg: float | None = key(None, "1 sigma of the pitch", "deg", ge=0)
    std_heading_deg: float | None = key(None, "1 sigma of the heading", "deg", ge=0)


class ImuSection(Section):
    preset: str | None = key(None, 'a named instrument, e.g. "3dm-gx3-25"; or the numbers below, never both')
    gyro_arw_deg_per_sqrt_h: Sigma | None = key(None, "angle random walk", "deg/sqrt(h)")
    accel_vrw_mps_per_sqrt_h: Sigma | None = key(None, "velocity random walk", "m/s/sqrt(h)")
    gyro_bias_deg_per_h: Sigma | None = key(None, "turn-on bias, 1 sigma", "deg/h")
    accel_bias_ug: Sigma | None = key(None, "turn-on bias, 1 sigma", "ug")
    gyro_instability_deg_per_h: Sigma | None = key(None, "in-run bias, 1 sigma of a Gauss-Markov process", "deg/h")
    accel_instability_ug: Sigma | None = key(None, "in-run bias, 1 sigma of a Gauss-Markov process", "ug")
    gyro_tau_s: float | None = key(None, "correlation time of the in-run gyro bias", "s", gt=0)
    accel_tau_s: float | None = key(None, "correlation time of the in-run accelerometer bias", "s", gt=0)
    gyro_scale_ppm: Sigma | None = key(None, "scale, 1 sigma", "ppm")
    accel_scale_ppm: Sigma | None = key(None, "scale, 1 sigma", "ppm")
    gyro_rrw_deg_per_h_per_sqrt_h: Sigma | None = key(None, "rate random walk", "deg/h/sqrt(h)")
    accel_rrw_ug_per_sqrt_h: Sigma | None = key(None, "acceleration random walk", "ug/sqrt(h)")
    gyro_misalignment_mrad: float | None = key(None, "misalignment, 1 sigma", "mrad", ge=0)
    accel_misalignment_mrad: float | None = key(None, "misalignment, 1 sigma", "mrad", ge=0)
    gyro_g_sensitivity_deg_per_h_per_g: float | None = key(None, "1 sigma", "deg/h/g", ge=0)
    gyro_quantisation_arcsec: float | None = key(None, "least count of an angle increment", "arcsec", ge=0)
    accel_quantisation_mps: float | None = key(None, "least count of a velocity increment", "m/s", ge=0)
    gyro_range_deg_per_s: float | None = key(None, "the gyro saturates here", "deg/s", gt=0)
    accel_range_g: float | None = key(None, "the accelerometer saturates here", "g", gt=0)
    bandwidth_hz: float | None = key(None, "3 dB bandwidth of gyros and accelerometers", "Hz", gt=0)
    accel_x_lever_mm: Three | None = key(None, "where the x accelerometer sits, in the IMU's axes", "mm")
    accel_y_lever_mm: Three | None = key(None, "where the y accelerometer sits, in the IMU's axes", "mm")
    accel_z_lever_mm: Three | None = key(None, "where the z accelerometer sits, in the IMU's axes", "mm")
    calibration: str | None = key(None, "a calibration.json, applied before anything else", "file")


class NoiseSection(Section):
    gnss_m: Three = key((1.0, 1.0, 2.0), "white error of a fix, north east down, where std_ is absent", "m")
    gnss_mps: Three = key((0.05, 0.05, 0.1), "error of a GNSS velocity, north east down, where std_ is absent", "m/s")
    gnss_correlated_m: float = key(2.0, "slow error of a fix beside gnss_m, north and east", "m", ge=0)
    gnss_correlated_tau_s: float = key(100.0, "its correlation time", "s", gt=0)
    speed_mps: float = key(0.05, "speed log or odometer", "m/s", gt=0)
    speed_scale_percent: float = key(1.0, "scale of the speed log, prior", "%", ge=0)
    speed_walk_mps_per_sqrt_s: float | None = key(
        None, "how fast the speed through water changes; absent: 0.03 with a log, 0.01 without", "m/s/sqrt(s)", gt=0
    )
    path_scale_percent: float = key(10.0, "scale of the speed from depth rate over tan(pitch), prior", "%", ge=0)
    dvl_mps: float = key(0.02, "DVL, each axis", "m/s", gt=0)
    dvl_scale_percent: float = key(0.3, "scale of the DVL, prior", "%", ge=0)
    depth_m: float = key(0.1, "depth sensor", "m", gt=0)
    height_m: float = key(1.0, "barometric height", "m", gt=0)
    attitude_deg: Three = key((1.0, 1.0, 2.0), "roll, pitch, heading of an attitude table", "deg")
    attitude_tau_s: float = key(30.0, "how long an error of an attitude table's heading lasts", "s", gt=0)
    heading_offset_deg: float | None = key(
        None, "constant offset of the heading, prior; absent: 5 of an attitude table, 2 of a magnetometer", "deg", ge=0
    )
    mag_deg: float = key(1.5, "heading from the magnetometer", "deg", gt=0)
    range_m: float = key(0.5, "range to a known point", "m", gt=0)
    slip_m_per_sqrt_m: float = key(0.05, 'path error of wheels, along and across; kind "planar"', "m/sqrt(m)", ge=0)
    lidar_m: float = key(0.1, "range of a lidar", "m", gt=0)
    wave_mps: float = key(0.06, "orbital velocity of waves at the surface, rms of one axis", "m/s", ge=0)
    wave_period_s: float = key(5.0, "their period", "s", gt=0)
    current_mps: float = key(0.3, "water current, each axis, prior", "m/s", ge=0)
    current_walk_mps_per_sqrt_h: float = key(0.06, "how fast the current changes", "m/s/sqrt(h)", ge=0)
    delay_s: float = key(0.1, "delay of a sensor's stamps that is estimated, prior", "s", gt=0, le=5)
    delay_walk_s_per_sqrt_s: float = key(1e-3, "how fast a delay changes: clocks that drift", "s/sqrt(s)", ge=0)
    lever_m: float = key(0.3, "an arm that is estimated, each axis, prior", "m", gt=0)
    mounting_deg: float = key(6.0, "angles between the IMU's axes and the vehicle's, prior", "deg", gt=0, le=45)
    height_bias_m: float = key(50.0, "offset of a barometric height, prior", "m", ge=0)
    height_walk_m_per_sqrt_h: float = key(3.0, "how fast that offset drifts", "m/sqrt(h)", ge=0)
    depth_bias_m: float = key(50.0, "ellipsoidal height of the depth sensor's zero, prior", "m", ge=0)
    dvl_misalignment_deg: float = key(1.0, "DVL against the IMU, prior", "deg", ge=0)
    mag_bias_ut: float = key(5.0, "hard iron that is estimated, prior", "uT", gt=0)
    range_scale_percent: float = key(2.0, 'scale of ranges, prior; kind "planar": absent 10', "%", ge=0)
    range_bias_m: float = key(0.5, 'offset of ranges, prior; kind "planar", a beacon: absent 0.3', "m", ge=0)
    nhc_mps: Two = key((0.06, 0.1), "slip of a vehicle that does not slip, sideways and down", "m/s")
    zupt_mps: float = key(0.05, "velocity of a vehicle that stands", "m/s", gt=0)
    drift_mps: float = key(0.3, "drift at the surface while no speed is known, each axis, prior", "m/s", ge=0)
    drift_tau_s: float = key(600.0, "how long one drift lasts", "s", gt=0)


class MountingSection(Section):
    imu_to_body_rpy_deg: Three = key((0.0, 0.0, 0.0), "f_body = Rz(yaw) Ry(pitch) Rx(roll) f_imu", "deg")
    antenna_frd_m: Three = key((0.0, 0.0, 0.0), "from the IMU to the GNSS antenna", "m")
    dvl_frd_m: Three = key((0.0, 0.0, 0.0), "from the IMU to the DVL", "m")
    speed_frd_m: Three = key((0.0, 0.0, 0.0), "from the IMU to the speed sensor", "m")
    reference_frd_m: Three = key((0.0, 0.0, 0.0), "from the IMU to the point that the reference describes", "m")


class CameraSection(Section):
    focal_px: float = key(..., "focal length", "px", gt=0)
    u0_px: float = key(0.0, "principal point, u", "px")
    v0_px: float = key(0.0, "principal point, v", "px")
    sigma_px: float = key(1.0, "error of a sighting", "px", gt=0)
    body_to_camera_rpy_deg: Three = key((180.0, 0.0, 0.0), "f_camera = Rz(yaw) Ry(pitch) Rx(roll) f_body", "deg")
    position_frd_m: Three = key((0.0, 0.0, 0.0), "from the IMU to the camera", "m")


class LidarSection(Section):
    reach_m: float = key(1000.0, "how far it sees", "m", gt=0)
    divergence_mrad: float = key(0.0, "full angle of its beam", "mrad", ge=0)
    ground_m: float = key(0.5, "height model, 1 sigma", "m", ge=0)
    position_frd_m: Three = key((0.0, 0.0, 0.0), "from the IMU to the lidar", "m")


class FilterSection(Section):
    method: Literal["schuler", "paper", "paper-literal"] = key(
        "schuler", '"paper" and "paper-literal": kind "auv" only'
    )
    smoother: bool = key(True, "also smooths the track")
    estimate: Annotated[tuple[Estimate, ...], BeforeValidator(as_tuple)] | None = key(
        None, "what is learnt beside the track; absent: what the kind and its sensors allow"
    )
    constraints: Annotated[tuple[Literal["nhc", "zupt", "zaru"], ...], BeforeValidator(as_tuple)] = key(
        (), "vehicle constraints"
    )
    nhc_frd_m: Three = key((0.0, 0.0, 0.0), "the point that cannot slip sideways, from the IMU", "m")
    outage_policy: Literal["paper", "drop", "consider"] = key(
        "paper", 'method "paper": what it does without fixes; "consider" also holds for "schuler"'
    )
    speed_is: Literal["ground", "water", "air"] = key(
        "ground", 'what a speed table feels; "water" and "air" estimate the current or wind as two states'
    )
    robust: bool = key(
        True, "false: as in a textbook: a measurement is taken however far off, an IMU may be told to have no noise"
    )
    loop: Literal["closed", "open"] = key("closed", '"open": errors are kept beside an INS that runs free, for study')
    distrust_s: float = key(60.0, "so long fixes may contradict the filter wildly before it believes them", "s", ge=0)
    vertical: Literal["free", "held", "zeroed"] = key(
        "free",
        '"held" keeps height and v_down and takes them out of the error growth (kinds "strapdown", "aided"); "zeroed": '
        "held, but left in the covariance, as the thesis's listing A.2 does",
    )
    bias_model: Literal["auto", "walk", "gauss-markov"] = key(
        "auto", 'of the in-run biases; "auto": Gauss-Markov where [imu] gives no turn-on bias, else a random walk'
    )
    frame: Literal["ned", "ecef"] = key("ned", 'kind "strapdown": axes that it is computed in; the track is the same')


class OutputSection(Section):
    rate_hz: Annotated[float | str, BeforeValidator(_rate)] | None = key(
        None, 'rows of solution.csv; absent: 10, or the finest input if slower; "imu": every epoch', "Hz"
    )


class OutageSection(Section):
    sensor: Sensor = key(..., "what is withheld")
    start_s: float = key(..., "from here, the row at this moment too", "s")
    end_s: float = key(..., "to here, the row at this moment too", "s")


class SweepSection(Section):
    sensor: Sensor = key("gnss", "what is withheld")
    length_s: NumberOrNumbers = key(..., "lengths of the outages that slide over the recording", "s", min_length=1)
    settle_s: float = key(60.0, "before the first outage", "s", ge=0)


class AlignSection(Section):
    method: Literal["auto", "still", "moving"] = key(
        "auto", '"moving": by the fixes, with the filter of kind "aided"; "auto": where there is no still stretch'
    )
    from_s: float | None = key(None, "absent: the first still stretch", "s")
    to_s: float | None = key(None, "absent: the first still stretch", "s")


class MissionSection(Section):
    preset: Literal["demo", "paper-test-1", "paper-test-2"] | None = key(
        None, "a ready mission; numbers given beside it replace the preset's own"
    )
    surface_s: float | None = key(None, "each surface leg before a dive", "s", gt=0)
    dive_s: float | None = key(None, "each dive", "s", gt=0)
    dives: int | None = key(None, "how many dives", ge=1, le=1000)
    final_surface_s: float | None = key(None, "the last surface leg", "s", ge=0)
    between_surface_s: float | None = key(None, "the surface leg between two dives; absent: surface_s", "s", gt=0)
    speed_mps: float | None = key(None, "through water, submerged", "m/s", gt=0, le=20)
    surface_speed_mps: float | None = key(None, "through water, at the surface", "m/s", gt=0, le=20)
    lat_deg: float | None = key(None, "latitude of the start", "deg", gt=-89, lt=89)
    lon_deg: float | None = key(None, "longitude of the start", "deg", ge=-180, le=360)
    heading_deg: float | None = key(None, "heading at the start", "deg", ge=-180, le=360)
    depth_m: float | None = key(None, "deepest point of a dive; absent: as the pitch gives it", "m", ge=0)
    pitch_deg: float | None = key(None, "nose down at the start of a dive, up at its end", "deg", ge=0, le=80)
    turns_deg: Numbers | None = key(None, "turns of each dive, one after the other, clockwise", "deg")
    l_shape: bool | None = key(None, "a turn of 90 deg in the middle of the surface leg")
    current_north_mps: float | None = key(None, "water current", "m/s", ge=-5, le=5)
    current_east_mps: float | None = key(None, "water current", "m/s", ge=-5, le=5)
    current_std_mps: float | None = key(None, "a constant current drawn once a run, each axis, 1 sigma", "m/s", ge=0)
    current_walk_mps_per_sqrt_h: float | None = key(None, "the current's random walk", "m/s/sqrt(h)", ge=0)
    current_shear_per_s: float | None = key(None, "change of the current with depth", "1/s")
    speed_scale_percent: float | None = key(None, "scale error of the speed log", "%", ge=-50, le=50)
    speed_scale_std_percent: float | None = key(None, "scale error drawn once a run, 1 sigma", "%", ge=0)
    wave_roll_deg: float | None = key(None, "roll of the waves at the surface", "deg", ge=0)
    wave_pitch_deg: float | None = key(None, "pitch of the waves at the surface", "deg", ge=0)
    wave_mps: float | None = key(None, "orbital velocity of the waves", "m/s", ge=0)
    magnetometer: bool | None = key(None, "carries one")
    dvl: bool | None = key(None, "carries one, with bottom track")


class TrajectorySection(Section):
    preset: Literal[
        "rest",
        "legs",
        "car",
        "flight",
        "great-circle",
        "rhumb-line",
        "oscillation",
        "coning",
        "dive",
        "turntable",
        "track",
    ] = key("legs", "shape of the trajectory; it begins at [start]")
    duration_s: float = key(14400.0, "how long", "s", gt=0)
    rate_hz: float = key(100.0, "IMU rate", "Hz", gt=0)
    speed_mps: float = key(200.0, 'speed over ground; absent: 15 for "car", 60 for "flight"', "m/s", ge=0)
    stand_s: float | None = key(
        None, 'standing at first; absent: 30 for "car", 0 for "flight", which then begins in the air', "s", ge=0
    )
    variety: int = key(0, '"car" and "flight": another number is another drive or flight', ge=0, le=10000)
    turns_deg: Numbers = key((), "turns, one after the other, clockwise", "deg")
    turns_at_s: Numbers = key((), "middle of each turn; absent: spread evenly", "s")
    turn_rate_deg_per_s: float = key(1.5, "fastest rate of a turn", "deg/s", gt=0)
    climbs_m: Numbers = key((), "change of height in the middle of each leg", "m")
    climb_rate_mps: float = key(10.0, "fastest rate of a climb", "m/s", gt=0)
    depth_m: float = key(100.0, "of a dive", "m", gt=0)
    swing_deg: Three = key((11.459155902616466, 11.459155902616466, 0.0), "oscillation of roll, pitch, heading", "deg")
    swing_hz: float = key(0.15915494309189535, "frequency of the oscillation", "Hz", gt=0)
    swing_phase_deg: float = key(90.0, "roll ahead of pitch", "deg")
    cone_deg: float = key(1.0, "half angle of the cone", "deg", gt=0, lt=180)
    cone_hz: float = key(5.0, "turns of the cone", "Hz", gt=0)
    table_deg_per_s: float = key(20.0, "turntable rate, clockwise from above", "deg/s")
    earth: Literal["wgs84", "sphere"] = key("wgs84", "figure of the Earth; the sphere: 6378137 m, g = 9.81 m/s^2")


class SimulateSection(Section):
    gnss_hz: float = key(1.0, "fixes; 0: no receiver", "Hz", ge=0, le=1000)
    gnss_velocity: bool = key(True, "the receiver gives velocity too")
    speed_hz: float = key(0.0, "axial speed log or odometer", "Hz", ge=0, le=1000)
    dvl_hz: float = key(0.0, "velocity over ground in body axes", "Hz", ge=0, le=1000)
    depth_hz: float = key(0.0, "depth sensor", "Hz", ge=0, le=1000)
    height_hz: float = key(0.0, "barometer with a slow drift", "Hz", ge=0, le=1000)
    magnetometer: bool = key(False, "three axes in the imu table, the field of WMM2025")
    ranges_hz: float = key(0.0, "distances to every beacon", "Hz", ge=0, le=1000)
    beacons: int = key(4, "how many, on a circle around the track", ge=1, le=1000)
    beacon_radius_m: float | None = key(None, "of the circle; absent: 0.8 of the track's extent", "m", gt=0)
    sightings_per_s: float = key(0.0, "landmarks seen by the camera, of all pictures together", "1/s", ge=0)
    sightings_hz: float = key(0.0, "pictures", "Hz", ge=0, le=1000)
    picture_px: Two = key((2500.0, 1900.0), "half width and height over which the landmarks of a picture spread", "px")
    wrong_names_percent: float = key(0.0, "sightings that carry another landmark's name", "%", ge=0, le=100)
    lidar_hz: float = key(0.0, "ranges of a lidar over hills: straight down, right, left in turn", "Hz", ge=0, le=1e4)
    ground_height_m: float = key(0.0, "height of the ground", "m")
    ground_relief_m: float = key(0.0, "its hills, 1 sigma", "m", ge=0, le=3000)
    gnss_height: bool = key(True, "a fix holds a height; false: two numbers only")
    speed_is: Literal["ground", "water", "air"] | None = key(
        None, "what the speed log feels; absent: as the filter takes it"
    )
    gnss_delay_s: float | None = key(None, "delay of the fixes beside [input] gnss_delay_s, 1 sigma", "s", ge=0, le=2)
    gnss_velocity_delay_s: float | None = key(
        None, "delay of the receiver's velocity, 1 sigma; absent: that of the fixes", "s", ge=0, le=2
    )
    speed_delay_s: float | None = key(None, "delay of the speed log, 1 sigma", "s", ge=0, le=2)
    dvl_delay_s: float | None = key(None, "delay of the DVL, 1 sigma", "s", ge=0, le=2)
    mounting_deg: float | None = key(None, "angles of the IMU beside [mounting], 1 sigma", "deg", ge=0, le=45)
    antenna_lever_m: float | None = key(None, "error of antenna_frd_m, each axis, 1 sigma", "m", ge=0)
    speed_lever_m: float | None = key(None, "error of speed_frd_m, each axis, 1 sigma", "m", ge=0)
    dvl_lever_m: float | None = key(None, "error of dvl_frd_m, each axis, 1 sigma", "m", ge=0)
    dvl_misalignment_deg: float | None = key(None, "angles of the DVL, 1 sigma", "deg", ge=0, le=45)
    height_bias_m: float | None = key(None, "offset of the barometer, 1 sigma", "m", ge=0)
    height_walk_m_per_sqrt_h: float | None = key(None, "how fast that offset drifts", "m/sqrt(h)", ge=0)
    depth_bias_m: float | None = key(None, "ellipsoidal height of the depth sensor's zero, 1 sigma", "m", ge=0)
    range_scale_percent: float | None = key(None, "scale of all ranges, 1 sigma", "%", ge=0)
    range_bias_m: float | None = key(None, "offset of all ranges, 1 sigma", "m", ge=0)
    heading_offset_deg: float | None = key(None, "the compass reads heading plus this, 1 sigma", "deg", ge=0)
    mag_bias_ut: float | None = key(None, "hard iron of the magnetometer, each axis, 1 sigma", "uT", ge=0)
    year: float = key(2026.0, "date of the magnetic field", ge=2025, le=2030)
    imu_rows: Literal["increments", "rates"] = key("increments", "what a row of the imu table holds")
    imu: ImuSection | None = key(None, "the IMU as it is, where [imu] tells the filter something else")
    noise: NoiseSection | None = key(None, "keys of [noise] as they are, where the filter is told something else")
    start: StartSection | None = key(None, "std_ keys of [start] as they are, where the filter is told something else")


class ErrorsSection(Section):
    gyro_bias_deg_per_h: OneOrThree | None = key(None, "fixed bias on the simulated gyros", "deg/h")
    accel_bias_ug: OneOrThree | None = key(None, "fixed bias on the simulated accelerometers", "ug")


class AlignmentSection(Section):
    level_rad_per_s: float = key(0.03, "natural frequency of the levelling loops", "rad/s", gt=0)
    azimuth_rad_per_s: float = key(0.05, "natural frequency of the azimuth loop", "rad/s", gt=0)
    damping: float = key(0.8, "damping ratio")
    lag_s: float = key(0.0, "first-order lag of the loops' signals", "s", ge=0)
    duration_s: float = key(1500.0, "how long", "s", gt=0)
    settling_s: float | None = key(None, "requirement to judge against", "s", gt=0)
    overshoot_percent: float | None = key(None, "requirement to judge against", "%", ge=0)
    steady_percent: float | None = key(None, "requirement to judge against", "%", ge=0)
    phase_margin_deg: float | None = key(None, "requirement to judge against", "deg")
    gain_margin_db: float | None = key(None, "requirement to judge against", "dB")


class MapSection(Section):
    lat_deg: Grid = key((-85.0, 85.0, 60.0), "from, to, how many", "deg")
    heading_deg: Grid = key((0.0, 355.0, 72.0), "from, to, how many", "deg")


class PlatformSection(Section):
    lat_deg: float = key(35.7, "latitude along the mass attraction", "deg", gt=-90, lt=90)
    lon_deg: float = key(51.4, "longitude", "deg", ge=-180, le=360)
    heading_deg: float = key(180.0, "psi_0, counter-clockwise from north (east = 270)", "deg", ge=-360, le=360)
    motion: Literal["rest", "constant-rates"] = key("rest", "what the vehicle does")
    lat_change_deg: float = key(0.0, "over the whole duration, + north", "deg")
    lon_change_deg: float = key(0.0, "over the whole duration, + east", "deg")
    duration_s: float = key(7200.0, "how long", "s", gt=0)
    drift_deg_per_h: Three = key((0.01, 0.0, 0.1), "gyro drift", "deg/h")
    algorithms: Annotated[
        tuple[Literal["position-independent", "free-azimuth", "strapdown", "strapdown-open-loop", "as-published"], ...],
        BeforeValidator(as_tuple),
    ] = key(
        ("position-independent", "free-azimuth", "strapdown", "strapdown-open-loop", "as-published"), "which are run"
    )
    form: Literal["exact", "corrected", "literal"] = key("exact", "of the position-independent algorithm")
    at_s: Numbers = key((600.0, 1800.0, 3600.0, 5400.0, 7200.0), "when the error is told", "s")
    drift_at_switch: Literal["steps-on", "carried"] = key("steps-on", "what the drift does after alignment")
    drift_ramp_deg_per_h2: Three = key((0.0, 0.0, 0.0), "ramp of the drift", "deg/h^2")
    drift_walk_deg_per_h_per_sqrt_h: Three = key((0.0, 0.0, 0.0), "random walk of the drift", "deg/h/sqrt(h)")
    accel_bias_ug: Two = key((0.0, 0.0), "accelerometer bias, x y", "ug")
    accel_scale_ppm: Two = key((0.0, 0.0), "accelerometer scale, x y", "ppm")
    torquer_scale_ppm: Three = key((0.0, 0.0, 0.0), "torquer scale", "ppm")
    torquer_limit_deg_per_h: float = key(360.0, "fastest turn that the torquers can command", "deg/h", gt=0)
    trust_units: bool = key(False, "true: a drift that looks like another unit is meant as typed")
    body_heading_deg: float | None = key(
        None, "heading of the vehicle's body, counter-clockwise; absent: heading_deg", "deg", ge=-360, le=360
    )
    body_roll_deg: float = key(0.0, "roll of the body; with a period its amplitude", "deg", ge=-180, le=180)
    body_pitch_deg: float = key(0.0, "pitch of the body; with a period its amplitude", "deg", ge=-90, le=90)
    body_period_s: float = key(0.0, "period of rolling and pitching; 0: steady", "s", ge=0)
    gimbal_bias_deg: float = key(0.0, "bias of the azimuth gimbal", "deg")
    height_m: float = key(0.0, "height", "m")
    height_change_m: float = key(0.0, "climb over the whole duration, smooth", "m")
    start_ramp_s: float = key(0.0, "0: impulsive", "s", ge=0)
    earth: Literal["sphere", "ellipsoid"] = key("sphere", "figure of the Earth")
    alignment: AlignmentSection = key(AlignmentSection(), "loops before navigation")
    map: MapSection | None = key(None, "error over latitude and heading")
