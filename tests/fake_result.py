"""Made-up results for the tests of the page: random tracks with honest covariances, no filter behind them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from schuler.aiding.solution import Innovations, Navigation, Solution, StateHistory
from schuler.ground.tables import Table
from schuler.judging.result import Result

LAT0, LON0, RADIUS = np.radians(36.73), np.radians(52.65), 6.37e6
DEG = np.pi / 180.0


def _solution(time: Any, north: Any, east: Any, depth: Any, v_n: Any, rpy: Any, sd_pos: Any, sd_vel: Any, sd_rpy: Any):
    def diagonal(sd: Any) -> Any:
        cov = np.zeros((len(time), 3, 3))
        cov[:, [0, 1, 2], [0, 1, 2]] = sd**2
        return cov

    cov_pos = diagonal(sd_pos)
    cov_pos[:, 0, 1] = cov_pos[:, 1, 0] = 0.4 * sd_pos[:, 0] * sd_pos[:, 1]
    return Solution(
        time=time,
        lat=LAT0 + north / RADIUS,
        lon=LON0 + east / (RADIUS * np.cos(LAT0)),
        height=-depth,
        v_n=v_n,
        rpy=rpy,
        cov_pos=cov_pos,
        cov_vel=diagonal(sd_vel),
        cov_rpy=diagonal(sd_rpy),
    )


def fake(
    *,
    name: str = "demo",
    kind: str = "auv",
    dives: int = 1,
    dive_s: float = 520.0,
    surface_s: float = 100.0,
    final_s: float = 60.0,
    rate_hz: float = 10.0,
    reference: bool = True,
    smoother: bool = True,
    imu: bool = True,
    gnss_every_s: float = 1.0,
    nan: bool = False,
    seed: int = 3,
    notes: tuple[str, ...] = ("gnss.csv: no std_ columns, [noise] gnss_m = [1, 1, 2] used.",),
) -> Result:
    rng = np.random.default_rng(seed)
    total = dives * (surface_s + dive_s) + final_s
    time = np.arange(0.0, total + 0.5 / rate_hz, 1.0 / rate_hz)
    n = len(time)
    phase = np.mod(time, surface_s + dive_s)
    whole = np.floor(time / (surface_s + dive_s))
    under = (phase > surface_s) & (whole < dives)
    since = np.where(under, phase - surface_s, 0.0)
    depth = np.where(under, 12.0 * np.sin(np.pi * since / dive_s) ** 0.4, 0.0)
    heading = (90.0 + 40.0 * whole + 25.0 * np.tanh((since - 0.3 * dive_s) / 10) * under) * DEG
    roll = np.where(under, 0.2, 3.0) * DEG * np.sin(1.4 * time)
    pitch = np.where(under, -8.0 * np.cos(np.pi * since / dive_s), 2.0 * np.sin(1.3 * time)) * DEG
    speed = np.where(under, 2.5, 2.0)
    current = np.array([0.12, -0.2])
    v_true = np.column_stack([speed * np.cos(heading) + current[0], speed * np.sin(heading) + current[1], 0.0 * time])
    dt = 1.0 / rate_hz
    north, east = np.cumsum(v_true[:, 0]) * dt, np.cumsum(v_true[:, 1]) * dt
    rpy_true = np.column_stack([roll, pitch, np.mod(heading, 2 * np.pi)])

    sd_h = 1.0 + 0.05 * since
    sd_pos = np.column_stack([sd_h, 1.3 * sd_h, 0.4 + 0.0 * sd_h])
    shape = np.outer(since / dive_s, rng.normal(size=3)) * sd_pos + 0.6 * rng.normal(size=(n, 3)) * 0.3
    sd_vel = np.tile([0.06, 0.06, 0.04], (n, 1))
    sd_rpy = np.column_stack([0.4 + 0 * time, 0.4 + 0 * time, 1.0 + 3.0 * since / dive_s]) * DEG
    rpy_error = rng.normal(size=3) * sd_rpy * 0.7
    vel_error = rng.normal(size=(n, 3)) * 0.02 + rng.normal(size=3) * 0.04

    def track(scale: float, shrink: float) -> Solution:
        e = scale * shape
        return _solution(
            time, north + e[:, 0], east + e[:, 1], depth + 0.1 * e[:, 2], v_true + scale * vel_error,
            rpy_true + scale * rpy_error, shrink * sd_pos, shrink * sd_vel, shrink * sd_rpy,
        )  # fmt: skip

    fine = track(1.0, 1.0)
    smooth = track(0.15, 0.2) if smoother else None
    if nan:
        fine.lat[50:80] = np.nan
        fine.cov_pos[200:220] = np.nan
        fine.rpy[:] = np.nan
        fine.cov_rpy[:] = np.nan

    states: dict[str, StateHistory] = {}
    truth_states = {}

    def state(name: str, unit: str, true: float, sd0: float, sd1: float) -> None:
        sd = sd1 + (sd0 - sd1) * np.exp(-time / 60.0)
        value = true + rng.normal() * sd * 0.8 + 0.1 * sd * np.sin(time / 40)
        states[name] = StateHistory(
            name, unit, time, value, sd, true + 0.2 * (value[-1] - true) + 0 * time if smoother else None,
            0.9 * sd1 + 0 * time if smoother else None,
        )  # fmt: skip
        truth_states[name] = (time[[0, -1]], np.array([true, true]))

    if imu:
        for axis, value in zip("xyz", (0.15, -0.21, -0.053), strict=True):
            state(f"gyro_bias_{axis}", "rad/s", value * DEG, 0.2 * DEG, 0.006 * DEG)
        for axis in "xyz":
            state(f"accel_bias_{axis}", "m/s^2", 0.02, 0.03, 0.01)
    state("current_north", "m/s", 0.12, 0.3, 0.04)
    state("current_east", "m/s", -0.2, 0.3, 0.05)
    state("speed_scale", "1", 0.012, 0.01, 0.006)
    state("heading_offset", "rad", 0.5 * DEG, 2 * DEG, 0.8 * DEG)

    fixes = np.arange(0.0, total + 1e-9, gnss_every_s)
    at = np.minimum(np.round(fixes * rate_hz).astype(int), n - 1)
    fixes, at = fixes[~under[at]], at[~under[at]]
    m = len(fixes)
    gnss = Table(
        "gnss",
        {
            "time": fixes,
            "lat": LAT0 + (north[at] + rng.normal(size=m)) / RADIUS,
            "lon": LON0 + (east[at] + rng.normal(size=m)) / (RADIUS * np.cos(LAT0)),
            "height": np.zeros(m),
        },
    )
    before = np.maximum(at - 1, 0)
    std = np.sqrt(sd_pos[before] ** 2 + 1.0)
    value = -shape[before] + rng.normal(size=(m, 3))
    used = rng.random(m) > 0.02
    value[~used] *= 8.0
    innovations = {
        "gnss_position": Innovations(
            "gnss_position", ("north", "east", "down"), "m", fixes, value, std, np.sum((value / std) ** 2, axis=1), used
        )
    }
    for kind_, names, unit, sd in (
        ("gnss_velocity", ("north", "east"), "m/s", 0.12),
        ("speed", ("along",), "m/s", 0.06),
        ("magnetometer", ("heading",), "rad", 1.6 * DEG),
        ("depth", ("down",), "m", 0.12),
    ):
        t = fixes if kind_ == "gnss_velocity" else np.arange(0.0, total, 1.0)
        d = len(names)
        y = rng.normal(size=(len(t), d)) * sd
        s = np.full((len(t), d), sd)
        innovations[kind_] = Innovations(
            kind_, names, unit, t, y, s, np.sum((y / s) ** 2, axis=1), rng.random(len(t)) > 0.01
        )

    truth = Table(
        "reference",
        {
            "time": time, "lat": LAT0 + north / RADIUS, "lon": LON0 + east / (RADIUS * np.cos(LAT0)), "height": -depth,
            "v_north": v_true[:, 0], "v_east": v_true[:, 1], "v_down": v_true[:, 2],
            "roll": roll, "pitch": pitch, "heading": rpy_true[:, 2],
        },
    )  # fmt: skip
    tables = {"gnss": gnss, "depth": Table("depth", {"time": time[::10], "depth": depth[::10]})}
    if imu:
        tables["imu"] = Table("imu", {"time": time})

    def stats(values: Any) -> dict[str, float]:
        a = np.abs(values)
        return {
            "rms": float(np.sqrt(np.mean(a**2))),
            "p95": float(np.percentile(a, 95)),
            "max": float(a.max()),
            "end": float(a[-1]),
        }

    def table_of(scale: float) -> dict[str, Any]:
        return {
            "horizontal_m": stats(scale * np.hypot(shape[:, 0], shape[:, 1])),
            "vertical_m": stats(0.1 * scale * shape[:, 2]),
            "velocity_mps": stats(scale * np.linalg.norm(vel_error, axis=1)),
            "roll_deg": stats(scale * rpy_error[:, 0] / DEG),
            "pitch_deg": stats(scale * rpy_error[:, 1] / DEG),
            "heading_deg": stats(scale * rpy_error[:, 2] / DEG),
        }

    errors = {
        "filter": table_of(1.0) if reference else None,
        "smoother": table_of(0.15) if reference and smoother else None,
    }
    nis = {
        k: {"mean": float(np.mean(i.nis) / i.value.shape[1]), "low": 0.8, "high": 1.2, "n": len(i.time)}
        for k, i in innovations.items()
    }
    consistency = {
        "nees_position": 0.9 if reference else None,
        "nees_velocity": 1.1 if reference else None,
        "nees_attitude": None,
        "nis": nis,
        "inside_3_sigma": 0.998 if reference else None,
    }
    study = SimpleNamespace(
        study=SimpleNamespace(name=name, kind=kind),
        filter=SimpleNamespace(method="schuler", smoother=smoother, estimate=["gyro_bias", "current"]),
        noise=SimpleNamespace(gnss_m=[1.0, 1.0, 2.0], speed_mps=0.05, speed_scale_percent=1.0),
    )
    return Result(
        study=study,
        made_by={"version": "0.1.0", "seed": seed, "study_sha256": "5d41402abc4b2a76b9719d911017c592" * 2},
        navigation=Navigation(fine, smooth, states, innovations, ["Gravity levelling weight 20 deg a sample."]),
        reference=truth if reference else None,
        truth_states=truth_states if reference else {},
        tables=tables,
        withheld={},
        summary={
            "study": {"name": name, "kind": kind},
            "made_by": {"version": "0.1.0", "seed": seed},
            "errors": errors,
            "consistency": consistency,
            "outages": [],
        },
        notes=list(notes),
    )
