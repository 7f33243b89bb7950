"""Names that other tools and loggers give to the contract's columns.

Names are compared in one plain form (`plain`): lower case, anything but letters and digits becomes one underscore.
The order of the spellings is the order of preference when a file holds several of them.
"""

from __future__ import annotations

import re

from schuler.ground.tables import SCHEMAS


def plain(name: str) -> str:
    """`Acc X` -> `acc_x`; `angular_velocity.x` -> `angular_velocity_x`."""
    return re.sub(r"[^0-9a-z]+", "_", name.strip().lower()).strip("_")


def _axes(contract: str, stems: str, extra: dict[str, str] | None = None) -> dict[str, tuple[str, ...]]:
    """Spellings of three columns `contract_x`, `_y`, `_z` from stems, where `*` stands for the axis (or 0, 1, 2)."""
    out = {}
    for number, axis in enumerate("xyz"):
        names = [stem.replace("*", axis) for stem in stems.split()]
        numbered = [stem.replace("_*", f"_{number}") for stem in stems.split() if "_*" in stem]
        out[f"{contract}_{axis}"] = (*names, *(extra or {}).get(axis, "").split(), *numbered)
    return out


# t_gps and the like are one clock as good as any; a calendar or Unix column stands last, because a device clock that is
# recorded beside it is the one that the other tables of the same folder share.
_TIME = (
    "time t timestamp timestamps ts tsec sec secs seconds timestamp_sample timeus tow gps_tow gpstow sow gps_sow"
    " gps_time gpstime gps_seconds seconds_of_week second_of_week seconds_of_day sod elapsed elapsed_time t_unix"
    " unix_time unix time_unix epoch t_epoch header_stamp rosbagtimestamp utc_unix utc utc_time datetime"
).split()

# A name with its unit inside, where no suffix can be cut off.
UNIT_IN_NAME = {
    **dict.fromkeys("tsec sec secs seconds gps_seconds seconds_of_week second_of_week seconds_of_day sow".split(), "s"),
    **dict.fromkeys("t_unix unix_time unix time_unix utc_unix".split(), ""),
    "timeus": "us",
    "rosbagtimestamp": "ns",
}

_POSITION = {
    "lat": "lat latitude gps_lat lat_dd latitude_dd gnss_lat phi_lat y_lat".split(),
    "lon": "lon lng long longitude gps_lon gps_lng lon_dd longitude_dd gnss_lon".split(),
    "height": "height alt altitude h hgt ellipsoidal_height ellipsoid_height height_ellipsoid height_ell gps_alt"
    " gps_altitude alt_ellipsoid elevation hmsl alt_msl altitude_msl z_up".split(),
    "north": "north n pos_n pos_north p_n x_n x_north northing".split(),
    "east": "east e pos_e pos_east p_e y_e y_east easting".split(),
}
_VELOCITY = {
    "v_north": "v_north vn vel_n v_n vel_north velocity_north vnorth velocity_n north_velocity vel_0".split(),
    "v_east": "v_east ve vel_e v_e vel_east velocity_east veast velocity_e east_velocity vel_1".split(),
    "v_down": "v_down vd vel_d v_d vel_down velocity_down vdown velocity_d down_velocity vel_2".split(),
}
_STD = {
    "std_north": "std_north sd_n sdn std_n sigma_n sigma_north std_lat sd_lat stdm_0 north_std lat_std".split(),
    "std_east": "std_east sd_e sde std_e sigma_e sigma_east std_lon sd_lon stdm_1 east_std lon_std".split(),
    "std_down": "std_down sd_d sd_u sdu std_d std_u std_up sigma_d sigma_u std_h std_height std_alt sd_h stdm_2"
    " down_std height_std".split(),
    "std_v_north": "std_v_north sdvn sd_vn std_vn sigma_vn stdv_0".split(),
    "std_v_east": "std_v_east sdve sd_ve std_ve sigma_ve stdv_1".split(),
    "std_v_down": "std_v_down sdvd sdvu sd_vd sd_vu std_vd std_vu sigma_vd stdv_2".split(),
}
_ANGLES = {
    "roll": "roll phi roll_angle bank rollang eng_rollang".split(),
    "pitch": "pitch theta pitch_angle elevation_angle pitchang eng_pitchang".split(),
    "heading": "heading yaw psi hdg azimuth true_heading heading_true head yaw_angle compass_heading".split(),
    "heading_mag": "heading_mag mag_heading magnetic_heading heading_magnetic hdg_mag compass eng_head".split(),
}
_IMU = {
    **_axes(
        "gyro",
        "gyro_* gyr_* gyro* gyr* g* w* gyroscope_* omega_* w_* wb_* w_rs_s_* angular_velocity_* angularvelocity_*"
        " angular_rate_* ang_vel_* rate_* rot_* imu_gyr_* imu_gyro_* gyros_* gyro_rad_* gyro_counts_* gyr_counts_* g_*"
        " g*_cal gyro_*_cal g*_raw gyro_*_raw",
        {"x": "p", "y": "q", "z": "r"},
    ),
    **_axes(
        "accel",
        "accel_* acc_* accel* acc* a* accelerometer_* acceleration_* specific_force_* sf_* f_* f* fb_* a_rs_s_*"
        " linear_acceleration_* linearacceleration_* imu_acc_* imu_accel_* accels_* accelerometer_m_s2_* accel_counts_*"
        " acc_counts_* a_* a*_cal accel_*_cal a*_raw accel_*_raw",
    ),
    **_axes("dtheta", "dtheta_* dtheta* theta_* delta_angle_* dangle_* delang_* dang_* d_theta_* gyro_increment_*"),
    **_axes("dv", "dv_* dv* dvel_* delta_velocity_* delta_v_* deltav_* delvel_* d_v_* accel_increment_*"),
    **_axes("mag", "mag_* mag* magnetometer_* magn_* m* imu_mag_* magnetic_field_* b_* h* magnetometer_ga_* mb_*"),
    "temperature": tuple("temperature temp imu_temp temp_c imu_temperature".split()),
}

_EXTRA: dict[str, dict[str, list[str]]] = {
    "speed": {
        "speed": "speed v vel velocity odo odometer wheel_speed speed_log axial_speed log_speed v_x vx u ias".split(),
        "ddist": "ddist d_dist delta_distance distance_increment ds".split(),
        "dheading": "dheading d_heading delta_heading heading_increment dyaw".split(),
        "std_speed": "std_speed sd_speed sigma_speed".split(),
    },
    "dvl": {
        "v_x": "v_x vx vel_x velocity_x dvl_x u v_forward v_fwd".split(),
        "v_y": "v_y vy vel_y velocity_y dvl_y v v_right v_starboard".split(),
        "v_z": "v_z vz vel_z velocity_z dvl_z w v_down".split(),
    },
    "depth": {"depth": "depth water_depth pressure_depth eng_depth z".split()},
    "height": {"height": "height baro_alt h_baro alt_baro baro_height altitude alt h baro_altitude z_up".split()},
    "ranges": {
        "id": "id beacon_id beacon anchor_id anchor landmark_id landmark tag".split(),
        "range": "range distance dist r range_slant slant_range".split(),
    },
    "lidar": {
        "range": "range distance dist r".split(),
        "azimuth": "azimuth az bearing".split(),
        "elevation": "elevation el".split(),
        "id": "id target".split(),
    },
    "landmarks": {"id": "id beacon_index beacon_id beacon landmark_id landmark anchor_id anchor name".split()},
    "sightings": {
        "id": "id landmark_id landmark name point".split(),
        "u": "u x pixel_x".split(),
        "v": "v y pixel_y".split(),
    },
}


def _table(name: str) -> dict[str, tuple[str, ...]]:
    """All spellings of the columns of one table; the contract's own name is always the first."""
    pool: dict[str, list[str] | tuple[str, ...]] = {"time": _TIME}
    if name == "imu":
        pool |= _IMU
    else:
        pool |= {**_POSITION, **_VELOCITY, **_STD, **_ANGLES, **_EXTRA.get(name, {})}
    out = {}
    for column in SCHEMAS[name].columns:
        names = dict.fromkeys((column.name, *pool.get(column.name, ())))
        out[column.name] = tuple(names)
    return out


ALIASES: dict[str, dict[str, tuple[str, ...]]] = {name: _table(name) for name in SCHEMAS}


def spellings(table: str) -> dict[str, tuple[str, int]]:
    """Plain spelling -> (contract column, preference; 0 is best) for one table."""
    out: dict[str, tuple[str, int]] = {}
    for column, names in ALIASES[table].items():
        for preference, name in enumerate(names):
            out.setdefault(plain(name), (column, preference))
    return out
