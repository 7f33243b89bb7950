"""Simulated planar vehicles whose errors are those that the filter is told: tables and truth of a run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schuler.aiding.auv_settings import Start
from schuler.aiding.planar_settings import PlanarSettings, Plane
from schuler.ground.tables import Table

PLANE = Plane(0.9, 0.2)
BEACONS = np.array([[120.0, -80.0], [-90.0, -100.0], [-60.0, 140.0], [150.0, 110.0]])


@dataclass
class Run:
    tables: dict[str, Table]
    time: Any  # of the truth, each odometry row
    place: Any  # (n, 2) north, east m
    heading: Any
    truth: dict[str, float]
    settings: PlanarSettings


def simulate(
    seed: int,
    *,
    seconds: float = 240.0,
    fixes: bool = False,
    ranges: bool = True,
    start: bool = True,
    settings: PlanarSettings | None = None,
    stand: float = 0.0,
) -> Run:
    """Odometry with heading increments at 5 Hz over a wandering path; ranges at 2 Hz, fixes at 1 Hz."""
    s = settings or PlanarSettings()
    rng = np.random.default_rng([seed, 20])
    dt = 0.2
    n = round(seconds / dt)
    t = dt * np.arange(1, n + 1)
    phase = rng.uniform(0.0, 2 * np.pi, 3)
    speed = 1.5 + 0.4 * np.sin(0.11 * t + phase[0])
    rate = 0.10 * np.sin(0.05 * t + phase[1]) + 0.12 * np.sin(0.021 * t + phase[2])
    speed[t <= stand] = rate[t <= stand] = 0.0
    bias, turn_scale, log_scale = (
        s.gyro_bias_std * rng.standard_normal(),
        s.gyro_scale_std * rng.standard_normal(),
        s.speed_scale_std * rng.standard_normal(),
    )
    heading0 = rng.uniform(-np.pi, np.pi)
    turn = rate * dt
    heading = heading0 + np.cumsum(turn)
    middle = heading - 0.5 * turn
    way = speed * dt
    # the wheels slip: the path is not quite what they roll
    slipped = s.slip * np.sqrt(np.abs(way))[:, None] * rng.standard_normal((n, 2))
    slipped += s.position_walk * np.sqrt(dt) * rng.standard_normal((n, 2))
    ahead = np.column_stack([np.cos(middle), np.sin(middle)])
    aside = np.column_stack([-np.sin(middle), np.cos(middle)])
    place0 = rng.uniform(-40.0, 40.0, 2)
    place = place0 + np.cumsum((way + slipped[:, 0])[:, None] * ahead + slipped[:, 1:] * aside, axis=0)
    walk = s.gyro_instability * np.sqrt(2.0 / s.gyro_tau)
    drift = bias + np.cumsum(walk * np.sqrt(dt) * rng.standard_normal(n))
    noise = s.gyro_arw * np.sqrt(dt) * rng.standard_normal(n)
    noise += s.turn_walk * np.sqrt(np.abs(turn)) * rng.standard_normal(n)
    told = speed * np.exp(log_scale) + s.speed_std * rng.standard_normal(n)
    told[t <= stand] = 0.0
    dheading = np.exp(turn_scale) * turn + drift * dt + noise
    tables = {"speed": Table("speed", {"time": t, "speed": told, "dheading": dheading})}
    range_scale = s.range_scale_std * rng.standard_normal()
    biases = s.range_bias_std * rng.standard_normal(len(BEACONS))
    if ranges:
        at = np.arange(2, n - 1, 2)  # rows
        which = rng.integers(0, len(BEACONS), len(at))
        d = np.linalg.norm(place[at] - BEACONS[which], axis=1)
        told_range = np.exp(range_scale) * d + biases[which] + s.range_std * rng.standard_normal(len(at))
        lat, lon = PLANE.geodetic(BEACONS[:, 0], BEACONS[:, 1])
        tables["ranges"] = Table("ranges", {"time": t[at], "id": which.astype(str), "range": told_range})
        tables["landmarks"] = Table("landmarks", {"id": np.array(["0", "1", "2", "3"]), "lat": lat, "lon": lon})
    if fixes:
        at = np.arange(4, n, 5)
        fade = np.exp(-1.0 / s.gnss_correlated_tau)
        slow = np.zeros((len(at), 2))
        slow[0] = rng.standard_normal(2)
        for k in range(1, len(at)):
            slow[k] = fade * slow[k - 1] + np.sqrt(1.0 - fade**2) * rng.standard_normal(2)
        error = s.gnss_correlated_std * slow + np.array(s.gnss_std[:2]) * rng.standard_normal((len(at), 2))
        lat, lon = PLANE.geodetic(*(place[at] + error).T)
        tables["gnss"] = Table("gnss", {"time": t[at], "lat": lat, "lon": lon})
    if start:
        std = (0.5, 0.5, None), np.radians(3.0)
        lat, lon = PLANE.geodetic(*(place0 + 0.5 * rng.standard_normal(2)))
        begin = Start(
            time=0.0,
            lat=float(lat),
            lon=float(lon),
            heading=float(heading0 + std[1] * rng.standard_normal() + PLANE.convergence(lat, lon)),
            std_pos=std[0],
            std_heading=float(std[1]),
        )
        s = replace(s, start=begin)
    truth = {
        "gyro_bias_z": float(drift[-1]),
        "speed_scale": float(np.expm1(log_scale)),
        "range_scale": float(np.expm1(range_scale)),
    }
    return Run(tables, t, place, heading, truth, s)


def errors(run: Run, solution: Any) -> tuple[Any, Any, Any]:
    """(rows, 2) north and east errors, heading errors and the rows' indices in the truth."""
    row = np.searchsorted(run.time, solution.time - 1e-6)
    north, east = PLANE.north_east(solution.lat, solution.lon)
    heading = solution.rpy[:, 2] - PLANE.convergence(solution.lat, solution.lon) - run.heading[row]
    return np.column_stack([north, east]) - run.place[row], (heading + np.pi) % (2 * np.pi) - np.pi, row
