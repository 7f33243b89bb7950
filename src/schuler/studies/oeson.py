"""The thesis's flights with OESON and its two filter listings as studies of kind "aided": as printed, put right, and
with one fault of a listing at a time.

The set-up: 200 m/s from 50.21 N 30.3 E, 1000 m above flat ground, level, north; straight on or with a coordinated turn
in every 300 s, alternately right and left. IMU at 10 Hz. The dictionaries are those of a study file; examples/oeson,
listing-a2 and listing-a3 are the same as files.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Literal

from schuler.ground.units import DEG, DEG_PER_H, UG

Raw = dict[str, dict[str, Any]]
Path = Literal["straight", "turns"]
PATHS: tuple[Path, ...] = ("straight", "turns")

# --- the flight -------------------------------------------------------------------------------------------------------
TURN_DEG = 30.6  # 0.0178 sin^2 rad/s over 60 s is 0.534 rad
START = {"lat_deg": 50.21, "lon_deg": 30.3, "height_m": 1000.0, "heading_deg": 0.0}
CAMERA = {"focal_px": 8889.0}


def flight(path: Path, duration: float) -> dict[str, Any]:
    """[trajectory]: straight, or with a turn from 100 to 160 s of every 300 s."""
    made: dict[str, Any] = {"preset": "legs", "speed_mps": 200.0, "duration_s": duration, "rate_hz": 10.0}
    if path == "turns":
        number = int((duration + 170.0) // 300.0)
        made |= {
            "turns_deg": [TURN_DEG * (-1) ** k for k in range(number)],
            "turns_at_s": [130.0 + 300.0 * k for k in range(number)],
            "turn_rate_deg_per_s": 1.1156,
        }
    return made


def _typed(x: float) -> float:
    """As a person would type it: six digits."""
    return float(f"{x:.6g}")


def start(pos: float, vel: float, tilt_mrad: float, yaw_mrad: float, down: bool = True) -> dict[str, float]:
    """std_ keys of [start]. down: whether height and v_down have a sigma at all."""
    mrad = 1e-3 / DEG
    return {
        "std_north_m": pos, "std_east_m": pos, "std_down_m": pos if down else 0.0,
        "std_v_north_mps": vel, "std_v_east_mps": vel, "std_v_down_mps": vel if down else 0.0,
        "std_roll_deg": _typed(tilt_mrad * mrad), "std_pitch_deg": _typed(tilt_mrad * mrad),
        "std_heading_deg": _typed(yaw_mrad * mrad),
    }  # fmt: skip


def _merged(base: Raw, *more: Raw) -> Raw:
    """Sections with those of `more` laid over them, key by key; a nested section too."""
    made = deepcopy(base)
    for layer in more:
        for name, keys in layer.items():
            for key, value in keys.items():
                old = made.setdefault(name, {}).get(key)
                made[name][key] = {**old, **value} if isinstance(old, dict) and isinstance(value, dict) else value
    return made


# True errors: fixed biases on all axes, no noise; what is drawn once a run for the start.
TOLD_NOISE = {"gyro_arw_deg_per_sqrt_h": 0.001, "accel_vrw_mps_per_sqrt_h": 0.0006}  # 1e-5 m/s/sqrt(s)
NO_NOISE = {"gyro_arw_deg_per_sqrt_h": 0.0, "accel_vrw_mps_per_sqrt_h": 0.0}
CONSISTENT_IMU = {
    **TOLD_NOISE, "gyro_bias_deg_per_h": 0.05, "accel_bias_ug": 100.0, "gyro_instability_deg_per_h": 0.005,
    "accel_instability_ug": 10.0, "gyro_tau_s": 1e4, "accel_tau_s": 1e4,
}  # fmt: skip
OESON: Raw = {
    "start": {**START, **start(3.0, 0.1, 0.1, 1.0)},
    "imu": CONSISTENT_IMU,
    "errors": {"gyro_bias_deg_per_h": 0.05, "accel_bias_ug": 100.0},
    "simulate": {"gnss_hz": 0.0, "imu": NO_NOISE},
    "output": {"rate_hz": 1.0},
}
HELD: Raw = {
    "start": start(3.0, 0.1, 0.1, 1.0, down=False),
    "simulate": {"start": start(3.0, 0.1, 0.1, 1.0, down=False)},
    "filter": {"vertical": "held"},
}


def landmarks(each_s: int, px: float, **simulate: float) -> Raw:
    """All sightings of a second at once."""
    return {
        "simulate": {"sightings_hz": 1.0, "sightings_per_s": float(each_s), **simulate},
        "camera": {**CAMERA, "sigma_px": px},
    }


# --- listing A.2: open loop, 15 states, 2-D fixes of 3 m a second -----------------------------------------------------
G = 9.81
A2: Raw = _merged(
    OESON,
    HELD,
    {
        "simulate": {"gnss_hz": 1.0, "gnss_height": False, "gnss_velocity": False},
        "noise": {"gnss_m": [3.0, 3.0, 3.0], "gnss_correlated_m": 0.0},
        "filter": {
            "loop": "open", "robust": False, "bias_model": "gauss-markov", "estimate": ["gyro_bias", "accel_bias"],
        },
    },
)  # fmt: skip
ZEROED: Raw = {"filter": {"vertical": "zeroed"}}
A2_P0: Raw = {"start": start(3.0, 2.0, 1.0, 1.0, down=False)}
A2_GYRO_P0: Raw = {"imu": {"gyro_bias_deg_per_h": _typed(0.05 / DEG_PER_H)}}  # (0.05)^2 is rad/s
A2_GYRO_Q: Raw = {"imu": {"gyro_instability_deg_per_h": _typed(1e-6 * (1e4 / 2.0) ** 0.5 / DEG_PER_H)}}
A2_ACCEL_Q: Raw = {
    "imu": {"accel_tau_s": 100.0, "accel_instability_ug": _typed(0.3e-6 * G * (100.0 / 2.0) ** 0.5 / UG)}
}
NO_WALK: Raw = {"imu": NO_NOISE}
A2_PRINTED = _merged(A2, ZEROED, A2_P0, A2_GYRO_P0, A2_GYRO_Q, A2_ACCEL_Q, NO_WALK)

# --- listing A.3: closed loop, 18 states of which 15 live, 3-D fixes of 1.5 m at 10 Hz --------------------------------
A3_TRUE = {"gyro_arw_deg_per_sqrt_h": [0.09, 0.05, 0.04]}
A3_IMU = {
    **A3_TRUE, "accel_vrw_mps_per_sqrt_h": 0.0006, "gyro_bias_deg_per_h": 2.0, "accel_bias_ug": 200.0,
    "gyro_instability_deg_per_h": 0.05,
    "accel_instability_ug": 10.0, "gyro_tau_s": 1e4, "accel_tau_s": 1e4,
}  # fmt: skip
A3: Raw = {
    "start": {**START, **start(1.5, 0.1, 0.2, 1.0)},
    "imu": A3_IMU,
    "errors": {"gyro_bias_deg_per_h": [1.0, 1.5, -2.0], "accel_bias_ug": [200.0, 150.0, -100.0]},
    "noise": {"gnss_m": [1.5, 1.5, 1.5], "gnss_correlated_m": 0.0},
    "simulate": {
        "gnss_hz": 10.0, "gnss_velocity": False, "imu": A3_TRUE, "start": start(1.5, 0.1, 0.2, 1.0),
    },
    "filter": {"robust": False, "bias_model": "gauss-markov", "estimate": ["gyro_bias", "accel_bias"]},
    "output": {"rate_hz": 1.0},
}  # fmt: skip
A3_P0: Raw = {"start": start(1.5, 2.0, 0.1, 0.1)}
A3_GYRO_P0: Raw = {"imu": {"gyro_bias_deg_per_h": 0.05}}
A3_ACCEL_P0: Raw = {"imu": {"accel_bias_ug": 100.0}}
A3_Q: Raw = {
    "imu": {
        "gyro_instability_deg_per_h": _typed(1e-9 * (1e5 / 2.0) ** 0.5 / DEG_PER_H), "gyro_tau_s": 1e5,
        "accel_instability_ug": _typed(0.3e-6 * G * (1e5 / 2.0) ** 0.5 / UG), "accel_tau_s": 1e5,
    },
}  # fmt: skip
A3_PRINTED = _merged(A3, A3_P0, A3_GYRO_P0, A3_ACCEL_P0, A3_Q, NO_WALK)
CORRELATED: Raw = {"simulate": {"noise": {"gnss_correlated_m": 2.0, "gnss_correlated_tau_s": 60.0}}}
WIRED: Raw = {
    "noise": {"gnss_correlated_m": 2.0, "gnss_correlated_tau_s": 60.0},
    "filter": {"estimate": ["gyro_bias", "accel_bias", "gnss_bias"]},
}


@dataclass(frozen=True)
class Case:
    """A flight with a filter. gap: seconds without sensor, judged at its end. After `since` s errors are judged."""

    title: str
    sections: Raw
    duration: float = 1800.0
    gap: tuple[float, float] | None = None
    since: float = 600.0

    def raw(self, path: Path) -> dict[str, Any]:
        """As the dictionary of a study file."""
        made: dict[str, Any] = {
            "study": {"name": f"{self.title}, {path}", "kind": "aided"},
            "trajectory": flight(path, self.duration),
            **deepcopy(self.sections),
        }
        if self.gap is not None:
            made["outage"] = [{"sensor": "sightings", "start_s": self.gap[0], "end_s": self.gap[1]}]
        return made


GAP = (900.0, 1199.5)
SEEN = {
    (6, 1.0): "6 landmarks a second, 1 px",
    (6, 5.0): "6 landmarks a second, 5 px",
    (1, 5.0): "1 landmark a second, 5 px",
}
CASES: dict[str, Case] = {
    "unaided": Case("OESON flight, unaided", _merged(OESON, HELD)),
    **{f"landmarks-{int(px)}px-{n}": Case(f"OESON flight, {title}", _merged(OESON, landmarks(n, px)))
       for (n, px), title in SEEN.items()},
    # with the noise that the filter is told, so that its sigma can be judged
    "gap-300": Case(
        "OESON flight, 300 s without landmarks",
        _merged(OESON, {"simulate": {"imu": TOLD_NOISE}}, landmarks(6, 1.0)), gap=GAP,
    ),
    "false-5-percent": Case(
        "OESON flight, 5 % of the names wrong", _merged(OESON, landmarks(6, 1.0, wrong_names_percent=5.0))
    ),
    "a2-consistent": Case("listing A.2, consistent tuning", A2),
    "a2-zeroed": Case("listing A.2, consistent but vertical zeroed in x only", _merged(A2, ZEROED)),
    "a2-printed": Case("listing A.2 as printed", A2_PRINTED),
    "a3-unaided": Case("listing A.3's flight, unaided", _merged(A3, {"simulate": {"gnss_hz": 0.0}}), 1200.0),
    "a3-consistent": Case("listing A.3, consistent tuning", A3, 1200.0),
    "a3-printed": Case("listing A.3 as printed", A3_PRINTED, 1200.0),
    "a3-correlated-15": Case("listing A.3, correlated fixes, 15 states", _merged(A3, CORRELATED), 1200.0),
    "a3-correlated-18": Case("listing A.3, correlated fixes, 18 states wired", _merged(A3, CORRELATED, WIRED), 1200.0),
}  # fmt: skip

# One fault of a listing laid over its consistent tuning.
FAULTS: dict[str, Case] = {
    "a2 vertical zeroed in x only": CASES["a2-zeroed"],
    "a2 gyro P0 0.05 rad/s": Case("listing A.2, gyro P0 0.05 rad a second", _merged(A2, A2_GYRO_P0)),
    "a2 sigma_gyr 1e-6": Case("listing A.2, sigma_gyr 1e-6", _merged(A2, A2_GYRO_Q)),
    "a2 tau_accel 100 s": Case("listing A.2, tau_accel 100 s", _merged(A2, A2_ACCEL_Q)),
    "a2 P0 2 m/s, 1 mrad": Case("listing A.2, P0 2 m a second and 1 mrad", _merged(A2, A2_P0)),
    "a3 no angle random walk in Q": Case("listing A.3, no angle random walk in Q", _merged(A3, NO_WALK), 1200.0),
    "a3 gyro P0 0.05 deg/h": Case("listing A.3, gyro P0 0.05 deg an hour", _merged(A3, A3_GYRO_P0), 1200.0),
    "a3 accelerometer P0 100 ug": Case("listing A.3, accelerometer P0 100 ug", _merged(A3, A3_ACCEL_P0), 1200.0),
    "a3 P0 2 m/s, 0.1 mrad": Case("listing A.3, P0 2 m a second and 0.1 mrad", _merged(A3, A3_P0), 1200.0),
    "a3 states 16-18 not wired": CASES["a3-correlated-15"],
}  # fmt: skip
