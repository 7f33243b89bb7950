"""From the keys of [platform] to a `PlatformCase`, and what a study may not ask for, as sentences."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from schuler.ground.errors import InputError, StudyError
from schuler.inertial.platform import RADIUS, PlatformCase
from schuler.inertial.platform_alignment import Loop, azimuth_loop, levelling_loop

if TYPE_CHECKING:
    from schuler.studies.model import PlatformSection, Study

DEG = math.pi / 180.0
DEG_H = DEG / 3600.0
UG = 9.80665e-6
_LARGE_DRIFT = 10.0  # deg/h; a platform gyro has 0.001 to 1
_SMALL_DRIFT = 3e-5  # deg/h; below the best gyros built, and what 0.1 deg/h and less look like in deg/s or rad/s
_LARGE_BIAS = 1e5  # ug, 0.1 g; a platform's accelerometers have 1 to 1000 ug
_SMALL_BIAS = 1e-3  # ug; what a bias typed in g looks like
_LARGE_SCALE = 1e5  # ppm, a tenth
_LOWEST, _HIGHEST = -12e3, 1e6  # m; the deepest sea to a low orbit
_MOST_CASES = 250_000  # of a map for all algorithms: some minutes
_MOST_LOOP_TIMES = 1e6  # alignment's duration in times of its fastest pole
_LINEAR_S = 3.0 * 3600.0
_LINEAR_TURN = 0.02  # rad by which a drift may turn the platform before second order shows


def section_of(study: Study) -> PlatformSection:
    """The [platform] section, with its defaults where it is absent."""
    from schuler.studies.model import PlatformSection

    return study.platform if study.platform is not None else PlatformSection()


def check(p: PlatformSection) -> None:
    """StudyError with every fault of the section."""
    faults = [*_drift_faults(p), *_accel_faults(p), *_motion_faults(p), *_loop_faults(p), *_map_faults(p)]
    if not p.algorithms:
        faults.append('[platform] algorithms: is empty; type algorithms = ["position-independent", "free-azimuth"]')
    elif not algorithms_of(p):
        faults.append('[platform] earth: the error model "as-published" is of the sphere; type earth = "sphere"')
    if "at_s" in p.model_fields_set:
        late = [t for t in p.at_s if not 0.0 <= t <= p.duration_s]
        if late:
            faults.append(f"[platform] at_s: {late[0]:g} s is outside the run of {p.duration_s:g} s")
    if faults:
        raise StudyError(faults)


def _drift_faults(p: PlatformSection) -> list[str]:
    faults = [
        f"[platform] drift_walk_deg_per_h_per_sqrt_h: {value:g} is negative; it is a size: type {-value:g}"
        for value in p.drift_walk_deg_per_h_per_sqrt_h
        if value < 0.0
    ]
    if p.trust_units:
        return faults
    for name, unit in (("drift_ramp_deg_per_h2", "deg/h^2"), ("drift_walk_deg_per_h_per_sqrt_h", "deg/h/sqrt(h)")):
        faults += [
            f"[platform] {name}: {value:g} {unit} makes more than {_LARGE_DRIFT:g} deg/h of drift in an hour, and "
            "platform gyros drift by 0.001 to 1 deg/h. Type it per hour, or trust_units = true if it is right"
            for value in getattr(p, name)
            if abs(value) > _LARGE_DRIFT
        ]
    for value in p.drift_deg_per_h:
        if abs(value) > _LARGE_DRIFT:
            faults.append(
                f"[platform] drift_deg_per_h: {value:g} deg/h is {value / 3600.0:.3g} deg/s, and platform gyros drift "
                "by 0.001 to 1 deg/h: was it converted from deg/s? Type the drift in deg/h, or trust_units = true if "
                "it is right"
            )
        elif 0.0 < abs(value) < _SMALL_DRIFT:
            faults.append(
                f"[platform] drift_deg_per_h: {value:g} deg/h is less than any gyro drifts; in deg/s it would be "
                f"{value * 3600.0:.3g} deg/h, in rad/s {value / DEG_H:.3g} deg/h. Type the drift in deg/h; if it is "
                "right add trust_units = true"
            )
    return faults


def _accel_faults(p: PlatformSection) -> list[str]:
    faults = []
    for bias in () if p.trust_units else p.accel_bias_ug:
        if abs(bias) > _LARGE_BIAS:
            faults.append(
                f"[platform] accel_bias_ug: {bias:g} ug is {bias * 1e-6:.3g} g; a platform's accelerometers have 1 to "
                "1000 ug. Type the bias in millionths of g"
            )
        elif 0.0 < abs(bias) < _SMALL_BIAS:
            faults.append(
                f"[platform] accel_bias_ug: {bias:g} ug is less than any accelerometer errs by; in g it would be "
                f"{bias * 1e6:.3g} ug. Type the bias in millionths of g; if it is right add trust_units = true"
            )
    for name in ("accel_scale_ppm", "torquer_scale_ppm"):
        faults += [
            f"[platform] {name}: {value:g} ppm is {value * 1e-4:.3g} %; scale errors are below 10 %. Type the error "
            "of the scale in millionths, 0 for a right one"
            for value in getattr(p, name)
            if abs(value) > _LARGE_SCALE
        ]
    return faults


def _motion_faults(p: PlatformSection) -> list[str]:
    faults = []
    moves = p.lat_change_deg != 0.0 or p.lon_change_deg != 0.0
    if p.motion == "rest" and moves:
        faults.append(
            '[platform] motion: "rest" came with lat_change_deg or lon_change_deg; type motion = "constant-rates"'
        )
    if p.start_ramp_s >= p.duration_s:
        faults.append(
            f"[platform] start_ramp_s: {p.start_ramp_s:g} s does not end before the run of {p.duration_s:g} s does"
        )
        return faults
    if RADIUS + min(p.height_m, p.height_m + p.height_change_m) <= 0.0:
        faults.append(
            f"[platform] height_m: {p.height_m:g} m puts z, the distance from the Earth's centre, to "
            f"{RADIUS + min(p.height_m, p.height_m + p.height_change_m):g} m; type a height above ground, in metres"
        )
        return faults
    for key, height in (("height_m", p.height_m), ("height_change_m", p.height_m + p.height_change_m)):
        if not _LOWEST <= height <= _HIGHEST:
            faults.append(
                f"[platform] {key}: it puts the vehicle {height:g} m high; a height above ground in metres lies "
                f"between {_LOWEST:g} and {_HIGHEST:g}"
            )
            return faults
    end = p.lat_deg + p.lat_change_deg
    if abs(end) >= 90.0:
        faults.append(
            f"[platform] lat_change_deg: from {p.lat_deg:g} deg it leads over a pole ({end:g} deg), where north and "
            f"east lose their meaning; type at most {math.copysign(90.0, end) - p.lat_deg:+.4g}"
        )
    elif (rate := _moving(p).command_rate() / DEG_H) > p.torquer_limit_deg_per_h:
        limit = p.torquer_limit_deg_per_h
        if p.motion == "constant-rates" and moves:
            faults.append(
                f"[platform] lat_change_deg, lon_change_deg: the motion of {_moving(p).speed():.0f} m/s, with the "
                f"Earth's, asks the torquers for {rate:.0f} deg/h and they give {limit:g}; type a longer duration_s, "
                "or torquer_limit_deg_per_h of a faster platform"
            )
        else:
            faults.append(
                f"[platform] torquer_limit_deg_per_h: the Earth's turn alone asks the torquers for {rate:.3g} deg/h "
                f"at rest and they give {limit:g}; type the limit of a faster platform"
            )
    return faults


def _moving(p: PlatformSection) -> PlatformCase:
    moves = p.motion == "constant-rates"
    return PlatformCase(
        lat=p.lat_deg * DEG,
        lat_change=p.lat_change_deg * DEG * moves,
        lon_change=p.lon_change_deg * DEG * moves,
        duration=p.duration_s,
        start_ramp=p.start_ramp_s,
        height=p.height_m,
    )


def _loop_faults(p: PlatformSection) -> list[str]:
    try:
        loops = loops_of(p)
    except InputError as error:
        return [f"[platform.alignment]: {error}"]
    for key, loop in zip(("level_rad_per_s", "azimuth_rad_per_s"), loops, strict=True):
        fastest = float(abs(loop.poles).max())
        if p.alignment.duration_s * fastest > _MOST_LOOP_TIMES:
            return [
                f"[platform.alignment] {key}, duration_s: {p.alignment.duration_s:g} s is more than "
                f"{_MOST_LOOP_TIMES:g} times the time of the pole at {fastest:.3g} 1/s, too much to compute; type a "
                "slower loop or a shorter duration_s"
            ]
    return []


def _map_faults(p: PlatformSection) -> list[str]:
    if p.map is None:
        return []
    faults = []
    if max(abs(x) for x in p.map.lat_deg[:2]) > 90.0:
        faults.append(
            f"[platform.map] lat_deg: {p.map.lat_deg[0]:g} to {p.map.lat_deg[1]:g} leaves -90 to 90 deg; type "
            "lat_deg = [-85.0, 85.0, 60]"
        )
    count = round(p.map.lat_deg[2]) * round(p.map.heading_deg[2])
    total = count * len(algorithms_of(p)) * p.duration_s / 7200.0
    if total > _MOST_CASES:
        faults.append(
            f"[platform.map] lat_deg, heading_deg: {count} places and headings for {len(algorithms_of(p))} algorithms "
            f"over {p.duration_s:g} s are {total / _MOST_CASES:.2g} times what runs in minutes; type coarser grids, "
            "such as 60 x 72"
        )
    return faults


def loops_of(p: PlatformSection) -> tuple[Loop, Loop]:
    """Levelling and azimuth loop. InputError with the pole where one is not stable."""
    a = p.alignment
    return (
        levelling_loop(a.level_rad_per_s, a.damping, a.lag_s),
        azimuth_loop(a.azimuth_rad_per_s, a.damping, a.lag_s),
    )


def algorithms_of(p: PlatformSection) -> tuple[str, ...]:
    """What is run, each once. The published error model knows the sphere only and is left out on the ellipsoid."""
    named = dict.fromkeys(p.algorithms)
    return tuple(a for a in named if not (a == "as-published" and p.earth == "ellipsoid"))


def case_of(p: PlatformSection) -> PlatformCase:
    """The case in SI."""
    moves = p.motion == "constant-rates"
    b1, b2, b3 = (x * DEG_H for x in p.drift_deg_per_h)
    r1, r2, r3 = (x * DEG_H / 3600.0 for x in p.drift_ramp_deg_per_h2)
    t1, t2, t3 = (x * 1e-6 for x in p.torquer_scale_ppm)
    return PlatformCase(
        lat=p.lat_deg * DEG,
        lon=p.lon_deg * DEG,
        heading=p.heading_deg * DEG,
        lat_change=p.lat_change_deg * DEG * moves,
        lon_change=p.lon_change_deg * DEG * moves,
        duration=p.duration_s,
        start_ramp=p.start_ramp_s,
        height=p.height_m,
        height_change=p.height_change_m,
        earth=p.earth,
        drift=(b1, b2, b3),
        drift_ramp=(r1, r2, r3),
        accel_bias=(p.accel_bias_ug[0] * UG, p.accel_bias_ug[1] * UG),
        accel_scale=(p.accel_scale_ppm[0] * 1e-6, p.accel_scale_ppm[1] * 1e-6),
        torquer_scale=(t1, t2, t3),
        gimbal_bias=p.gimbal_bias_deg * DEG,
        drift_carried=p.drift_at_switch == "carried",
    )


def walk_of(p: PlatformSection) -> tuple[float, float, float]:
    """Random walk of the drifts, rad/s/sqrt(s)."""
    a, b, c = (x * DEG_H / 60.0 for x in p.drift_walk_deg_per_h_per_sqrt_h)
    return a, b, c


def notes_of(study: Study, p: PlatformSection, case: PlatformCase) -> list[str]:
    """What a user should know about the study before reading its figures."""
    notes = [
        f"heading_deg = {p.heading_deg:g} counts from north to west; on a compass the platform's axis 1 points to "
        f"{(-p.heading_deg) % 360.0:g} deg"
    ]
    if case.speed() > 0.0 and case.start_ramp == 0.0:
        notes.append(
            f"the motion begins with a velocity step of {_first_speed(case):.0f} m/s at 0 s, felt by accelerometers "
            "and commands; start_ramp_s makes it gentle"
        )
    turn = max(
        *(
            abs(b) * case.duration + 0.5 * abs(r) * case.duration**2
            for b, r in zip(case.drift, case.drift_ramp, strict=True)
        ),
        abs(case.gimbal_bias),
        *(abs(b) * 1e-6 / UG for b in case.accel_bias),
    )
    if case.duration > _LINEAR_S or turn > _LINEAR_TURN:
        notes.append(
            f"beyond the linear range: in {case.duration:g} s the errors turn the platform by {turn:.2g} rad, and "
            f"closed forms and first-order theory leave out about half of that as a share of the error "
            f"({50.0 * turn:.2g} %); they also take the Earth's turn for small beyond 3 h. The simulations stay exact"
        )
    if "as-published" in algorithms_of(p) and case.drift[2] != 0.0:
        notes.append(
            "as-published is the source's error model, not a platform: for channel 3 its heading is not turned by the "
            "drift, which no real platform can do"
        )
    if p.earth == "ellipsoid":
        notes.append(
            "ellipsoid: lat_deg is the latitude of minus the mass attraction (GM, J2); solution.csv holds geodetic "
            f"latitude, {math.degrees(_geodetic(case)):.6f} deg at the start. The algorithms go on with a sphere of "
            "constant z; first-order theory and closed forms are those of the sphere, and as-published, which knows "
            "nothing else, is left out"
        )
    if p.map is not None and any(walk_of(p)):
        notes.append("map: each case has the constant drifts and their ramps; the random walk of the drift is left out")
    if p.map is not None and any(abs(x + p.lat_change_deg) >= 90.0 for x in p.map.lat_deg[:2]) and case.speed() > 0.0:
        notes.append("map: where lat_change_deg leads over a pole the flight goes straight on, down the other side")
    if any(x != 0.0 for x in p.drift_deg_per_h) and p.drift_at_switch == "carried":
        notes.append(
            "drift carried: alignment has put the opposite of the drift into the commands; the platform does not move, "
            "but the algorithm, which takes the command for the rate, errs as if the drift stepped on"
        )
    sections = (
        "input",
        "start",
        "imu",
        "camera",
        "sweep",
        "align",
        "mission",
        "trajectory",
        "outage",
        "errors",
        "filter",
    )
    unread = [name for name in sections if name in study.model_fields_set]
    notes += [f'[{name}]: not read by kind "platform"; left out' for name in unread]
    return notes


def _first_speed(case: PlatformCase) -> float:
    east = case.lon_change * math.cos(case.lat)
    return (RADIUS + case.height) * math.hypot(case.lat_change, east) / case.duration


def _geodetic(case: PlatformCase) -> float:
    from schuler.truth.platform import geodetic_from_mass

    return float(geodetic_from_mass(case.lat, case.height))
