"""From the sections of a study file to a mission and its instruments, all faults reported together."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import pi, radians, sin
from typing import Any

import numpy as np

from schuler.ground.errors import InputError, StudyError
from schuler.ground.units import DEG, KNOT
from schuler.truth import instruments as inst
from schuler.truth.catalogue import ACCELEROMETERS, GRADES, GYROS, imu_of
from schuler.truth.instruments import IMUS, ImuModel
from schuler.truth.missions import (
    FADE_S,
    PRESETS,
    RETURN_S,
    SPEED_STEPS,
    TURNS,
    AuvMission,
    Change,
    Waves,
    net_depth,
    profiles,
)
from schuler.truth.sensors import SUITES, SensorSuite


def mission_from_keys(keys: Mapping[str, Any]) -> AuvMission:
    """The `[mission]` section of a study: a preset, or numbers in the section's own units (deg, percent, per sqrt(h)).

    Keys beside the contract's: between_surface_s, lat_deg, lon_deg, surface_speed_mps, current_std_mps (drawn per
    run), speed_scale_std_percent (drawn). A preset may be changed by current, scale, wave, l_shape and surface keys;
    dive_s, depth_m, pitch_deg, turns_deg and speed_mps shape a mission of their own. Raises StudyError.
    """
    keys = dict(keys)
    name = keys.pop("preset", None)
    faults = []
    if name is not None and name not in PRESETS:
        faults.append(f"[mission] preset = {name!r} is not known: type one of {', '.join(map(repr, PRESETS))}")
    known = _PLAIN.keys() | _SHAPE | {"turns_deg", "l_shape", "dives"}
    known |= {"wave_roll_deg", "wave_pitch_deg", "wave_mps", "current_north_mps", "current_east_mps"}
    for key in keys:
        if key not in known:
            faults.append(f"[mission] {key} is not known: known keys are {', '.join(sorted(known))}")
        elif key == "l_shape":
            if not isinstance(keys[key], bool):
                faults.append(f"[mission] l_shape = {keys[key]!r} must be true or false")
        elif key != "turns_deg" and not _finite(keys[key]):
            faults.append(f"[mission] {key} = {keys[key]!r} must be a finite number")
        elif key in _NOT_NEGATIVE and keys[key] < 0:
            faults.append(f"[mission] {key} = {keys[key]!r} must not be negative")
        elif key == "dives" and keys[key] != int(keys[key]):
            faults.append(f"[mission] dives = {keys[key]!r} must be a whole number")
    turns = keys.get("turns_deg", ())
    if not isinstance(turns, Sequence) or isinstance(turns, str) or not all(_finite(x) for x in turns):
        faults.append(f"[mission] turns_deg = {turns!r} must be a list of angles, such as [-30, 45, -20]")
    if faults:
        raise StudyError(faults)
    m = PRESETS[name] if name is not None else AuvMission(name="mission")
    fields: dict[str, Any] = {target: keys[key] * factor for key, (target, factor) in _PLAIN.items() if key in keys}
    if "dives" in keys:
        fields["dives"] = int(keys["dives"])
    fields["l_shape"] = bool(keys.get("l_shape", m.l_shape))
    north, east = m.current
    fields["current"] = (float(keys.get("current_north_mps", north)), float(keys.get("current_east_mps", east)))
    if keys.keys() & {"wave_roll_deg", "wave_pitch_deg", "wave_mps"}:
        w = m.waves
        roll = radians(keys["wave_roll_deg"]) if "wave_roll_deg" in keys else w.roll
        pitch = radians(keys["wave_pitch_deg"]) if "wave_pitch_deg" in keys else w.pitch
        fields["waves"] = Waves.of(roll, pitch, float(keys.get("wave_mps", w.orbital)))
    try:
        m = replace(m, **fields)
        if keys.keys() & (_SHAPE | {"turns_deg"}):
            m = _shaped(m, keys)
        profiles(m, np.zeros((0, 2)))
    except InputError as error:
        raise StudyError(f"[mission] cannot be flown: {error}") from error
    return m


_PLAIN: dict[str, tuple[str, float]] = {
    "surface_s": ("surface", 1.0),
    "between_surface_s": ("between", 1.0),
    "final_surface_s": ("final_surface", 1.0),
    "surface_speed_mps": ("surface_speed", 1.0),
    "heading_deg": ("heading", pi / 180.0),
    "lat_deg": ("lat", pi / 180.0),
    "lon_deg": ("lon", pi / 180.0),
    "current_std_mps": ("current_std", 1.0),
    "current_walk_mps_per_sqrt_h": ("current_walk", 1.0 / 60.0),
    "current_shear_per_s": ("current_shear", 1.0),
    "speed_scale_percent": ("speed_scale", 0.01),
    "speed_scale_std_percent": ("speed_scale_std", 0.01),
}
_SHAPE = {"dive_s", "depth_m", "pitch_deg", "speed_mps"}
_NOT_NEGATIVE = {
    "surface_s", "between_surface_s", "final_surface_s", "dive_s", "depth_m", "pitch_deg", "speed_mps", "dives",
    "surface_speed_mps", "current_std_mps", "current_walk_mps_per_sqrt_h", "speed_scale_std_percent",
    "wave_roll_deg", "wave_pitch_deg", "wave_mps",
}  # fmt: skip


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _shaped(m: AuvMission, keys: Mapping[str, Any]) -> AuvMission:
    """A dive of any length and depth with the ingredients of the paper's: they keep their place in its level part."""
    dive = float(keys.get("dive_s", m.dive))
    pitch = radians(keys["pitch_deg"]) if "pitch_deg" in keys else m.pitch
    speed = float(keys.get("speed_mps", m.dive_speed))
    depth = float(keys.get("depth_m", m.dive_speed * sin(m.pitch) * m.descent if m.pitch else 0.0))
    surface_speed = m.surface_speed if "speed_mps" not in keys or "surface_speed_mps" in keys else 0.8 * speed
    if depth == 0.0 or m.dives == 0:
        pitch = 0.0
    elif not 0.0 < pitch < radians(80.0) or speed <= 0.0:
        raise StudyError(
            f"[mission] depth_m = {depth:g} needs pitch_deg between 0 and 80 and speed_mps above 0: "
            "type depth_m = 0 for a level dive"
        )
    hold = depth / (speed * sin(pitch)) if pitch else 0.0
    ramp = min(m.pitch_ramp, hold)
    m = replace(
        m, dive=dive, pitch=pitch, dive_speed=speed, surface_speed=surface_speed, descent=hold, ascent=hold,
        pitch_ramp=ramp, speed_steps=(), turns=(),
    )  # fmt: skip
    if m.dives and 2.0 * (hold + ramp) + RETURN_S + FADE_S > dive:
        raise StudyError(
            f"[mission] dive_s = {dive:g} is too short to reach depth_m = {depth:g} and come up again at "
            f"{speed:g} m/s and {np.degrees(pitch):.3g} deg: it takes {2.0 * (hold + ramp) + RETURN_S + FADE_S:.0f} s"
        )
    if pitch:
        # The speed's own ramp falls into the descent; depth is linear in the two holds, so this ends in a few rounds.
        # A shallow dive is held shorter than its ramp: then the heave of the surfacing takes up the centimetres.
        for _ in range(4):
            descent = max(ramp, m.descent + (depth - net_depth(m, m.descent + ramp)) / (speed * sin(pitch)))
            m = replace(m, descent=descent)
        m = replace(m, ascent=max(ramp, m.ascent + net_depth(m, dive) / (speed * sin(pitch))))
    a, b = m.descent + ramp, dive - m.ascent - ramp
    level = b - a
    if level >= 60.0:
        steps = tuple(Change(a + (c.start - 65.0) / 390.0 * level, 5.0, 0.2 * c.by / 0.5 * speed) for c in SPEED_STEPS)
        m = replace(m, speed_steps=steps)
    angles = [radians(x) for x in keys["turns_deg"]] if "turns_deg" in keys else [c.by for c in TURNS]
    if angles and level > 0.0:
        length = min(20.0, 0.8 * level / len(angles))
        places = [a + (i + 0.5) / len(angles) * level - 0.5 * length for i in range(len(angles))]
        if len(angles) == len(TURNS):
            places = [a + (c.start - 65.0) / 390.0 * (level - max(0.0, length - 20.0)) for c in TURNS]
        m = replace(m, turns=tuple(Change(t, length, x) for t, x in zip(places, angles, strict=True)))
    return m


def imu_from_keys(keys: Mapping[str, Any], errors: Mapping[str, Any] | None = None) -> ImuModel:
    """The IMU of a study's `[imu]` section (a preset or numbers, never both) and its fixed `[errors]`.

    Raises StudyError with all faults.
    """
    keys = {k: v for k, v in keys.items() if k != "calibration"}
    faults = []
    preset = keys.pop("preset", None)
    if preset is not None and keys:
        faults.append(f"[imu] has preset = {preset!r} and numbers ({', '.join(keys)}): keep one or the other")
    presets = {**IMUS, **GRADES}
    if preset is not None and "/" in preset:  # a gyro and an accelerometer of the thesis's catalogue
        try:
            presets[preset] = imu_of(*preset.split("/", 1))
        except KeyError as error:
            faults.append(
                f"[imu] preset = {preset!r}: the catalogue has no {error}; gyros: {', '.join(g.name for g in GYROS)}; "
                f"accelerometers: {', '.join(a.name for a in ACCELEROMETERS)}"
            )
            presets[preset] = ImuModel()
    if preset is not None and preset not in presets:
        faults.append(f"[imu] preset = {preset!r} is not known: type one of {', '.join(map(repr, presets))}")
    known = {f.name for f in fields(ImuModel)} - {"name", "published"}
    for key in keys:
        if key not in known:
            near = [k for k in sorted(known) if k.startswith(key)] or difflib.get_close_matches(key, known, 1)
            faults.append(f"[imu] {key} is not known" + (f": did you mean {near[0]}?" if near else ""))
    changes = _offsets(errors or {}, faults)
    if faults:
        raise StudyError(faults)
    model = presets[preset] if preset is not None else ImuModel(**keys)
    return replace(model, **changes)


def _offsets(errors: Mapping[str, Any], faults: list[str]) -> dict[str, Any]:
    """The fixed errors of a study's `[errors]` as fields of an ImuModel."""
    fixed = {"gyro_bias_deg_per_h": "gyro_offset_deg_per_h", "accel_bias_ug": "accel_offset_ug"}
    changes: dict[str, Any] = {}
    for key, value in errors.items():
        if key not in fixed:
            faults.append(f"[errors] {key} is not known: known keys are {', '.join(sorted(fixed))}")
        else:
            changes[fixed[key]] = tuple(value) if isinstance(value, list | tuple) else value
    return changes


def suite_from_keys(
    *,
    preset: str | None = None,
    imu: Mapping[str, Any] | None = None,
    errors: Mapping[str, Any] | None = None,
    noise: Mapping[str, Any] | None = None,
    mounting: Mapping[str, Any] | None = None,
) -> SensorSuite:
    """The instruments of a simulated study: the mission preset's own, changed by what the study says.

    `[noise]` sets how noisy the simulated sensors are. IMU, GNSS, speed log and depth are always fitted; a DVL, a
    magnetometer or an attitude sensor where its noise is given (dvl_mps, mag_deg, attitude_deg). A GNSS whose gnss_m
    is given is white. speed_scale_percent and current_mps are the filter's priors; the truth's are in `[mission]`.
    """
    suite = SUITES.get(preset or "", SensorSuite())
    faults: list[str] = []
    changes: dict[str, Any] = {}
    # The paper's tests keep their recorded bias when the study names the IMU that they used.
    if imu and not (suite.imu and dict(imu) == {"preset": suite.imu.name} and not errors):
        changes["imu"] = imu_from_keys(imu, errors)
    elif errors and suite.imu:
        changes["imu"] = replace(suite.imu, **_offsets(errors, faults))

    def numbers(section: str, values: Mapping[str, Any], key: str, count: tuple[int, ...]) -> Any:
        value = values[key]
        listed = list(value) if isinstance(value, list | tuple) else [value]
        if not all(_finite(x) for x in listed) or len(listed) not in count:
            faults.append(f"[{section}] {key} = {value!r} must be {' or '.join(map(str, count))} finite number(s)")
        elif section == "noise" and min(listed) < 0.0:
            faults.append(f"[{section}] {key} = {value!r} must not be negative: it is one standard deviation")
        else:
            return listed[0] if len(listed) == 1 else tuple(float(x) for x in listed)
        return None

    n = noise or {}
    gnss = suite.gnss or inst.GnssModel()
    if "gnss_m" in n and (std := numbers("noise", n, "gnss_m", (1, 3))) is not None:
        north, east, down = (float(x) for x in inst.axes(std))
        gnss = replace(gnss, white_m=(north, east, down), correlated_m=(0.0, 0.0, 0.0), published=frozenset())
    if "gnss_mps" in n and (std := numbers("noise", n, "gnss_mps", (1, 3))) is not None:
        gnss = replace(gnss, velocity_mps=std)
    changes["gnss"] = gnss
    if "speed_mps" in n and (std := numbers("noise", n, "speed_mps", (1,))) is not None:
        changes["speed"] = inst.SpeedLog(noise_kn=std / KNOT)
    if "depth_m" in n and (std := numbers("noise", n, "depth_m", (1,))) is not None:
        changes["depth"] = inst.DepthSensor(noise_m=std)
    if "dvl_mps" in n and (std := numbers("noise", n, "dvl_mps", (1,))) is not None:
        changes["dvl"] = inst.Dvl(noise_mps=std)
    if "mag_deg" in n and (std := numbers("noise", n, "mag_deg", (1,))) is not None:
        changes["magnetometer"] = inst.Magnetometer(noise_deg=std)
    if "attitude_deg" in n and (std := numbers("noise", n, "attitude_deg", (1, 3))) is not None:
        tilt, _, heading = inst.axes(std)
        changes["attitude"] = inst.AttitudeSensor(tilt_noise_deg=float(tilt), heading_noise_deg=float(heading))
    arms = {f"{name}_frd_m": f"{name}_frd" for name in ("antenna", "dvl", "speed", "reference")}
    for key in mounting or {}:
        if key in arms and (arm := numbers("mounting", mounting or {}, key, (3,))) is not None:
            changes[arms[key]] = arm
        elif key == "imu_to_body_rpy_deg" and (rpy := numbers("mounting", mounting or {}, key, (3,))) is not None:
            changes["imu_to_body_rpy"] = tuple(x * DEG for x in rpy)
    if faults:
        raise StudyError(faults)
    return replace(suite, **changes)
