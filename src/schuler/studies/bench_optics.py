"""Speed of the tasks of camera, lidar and Earth-fixed axes; see `studies.bench`."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.studies.bench import Work, task

POINTS, POSES, BEAMS, SAMPLES, FLOWN = 100, 200, 2000, 180_000, 1800.0


def _scene() -> tuple[Any, Any, Any]:
    from schuler.ground.camera import Camera

    rng = np.random.default_rng(1)
    camera = Camera.of(8889.0)
    points = np.column_stack([rng.uniform(-250, 250, POINTS), rng.uniform(-200, 200, POINTS), np.full(POINTS, 1000.0)])
    uv, _ = camera.project(points, np.zeros(3), np.eye(3))
    return camera, points, uv + rng.normal(size=uv.shape)


@task("pose from 100 sightings, compiled: search and least squares", "poses/s", POSES)
def _pose() -> Work:
    from schuler.kernels import pose as kernel

    camera, points, uv = _scene()
    X, sigma = points - points.mean(axis=0), np.ones((POINTS, 2))
    state, mask, N = np.zeros(kernel.POSE), np.ones(POINTS, dtype=np.uint8), np.empty((6, 6))
    parts = (camera.C_cb.ravel(), camera.l_b, camera.focal, 0.0, 0.0)

    def work() -> object:
        for k in range(POSES):
            kernel.solve(X, uv, sigma, *parts, 13.8, 60.0, 1000, k + 1, False, state, mask, N)
        return state

    return work


@task("pose from 100 sightings, from Python", "poses/s", POSES)
def _pose_python() -> Work:
    from schuler.aiding.optics import pose

    camera, points, uv = _scene()
    return lambda: [pose(points, uv, camera) for _ in range(POSES)]


@task("sightings predicted with their Jacobians", "sightings/s", POINTS * POSES)
def _rows() -> Work:
    from schuler.kernels.optics import sighting_batch

    camera, points, uv = _scene()
    seen, H = np.zeros(POINTS, dtype=bool), np.empty((POINTS, 2, 6))
    C, r = np.eye(3).ravel(), np.zeros(3)
    parts = (camera.C_cb.ravel(), camera.l_b, camera.focal, 0.0, 0.0)

    def work() -> object:
        for _ in range(POSES):
            sighting_batch(C, points, r, *parts, uv, seen, H)
        return H

    return work


@task("lidar beams over a height model, with Jacobians", "beams/s", BEAMS)
def _beams() -> Work:
    from schuler.kernels.optics import lidar_height_rows

    i, j = np.meshgrid(np.arange(100), np.arange(100), indexing="ij")
    heights = 100.0 + 20.0 * np.sin(0.1 * i) + 10.0 * np.cos(0.07 * j)
    step = 30.0 / 6.37e6
    grid = np.array([0.8 - 50 * step, 0.3 - 50 * step, step, step])
    C, arm, H = np.eye(3).ravel(), np.zeros(3), np.empty(6)

    def work() -> object:
        for k in range(BEAMS):
            lidar_height_rows(0.8, 0.3, 600.0, C, arm, 0.01 * k, -1.2, grid, heights, 2000.0, 6378137.0, 0.00669438, H)
        return H

    return work


@task("strapdown in Earth-fixed axes, 1800 s at 100 Hz", "IMU samples/s", SAMPLES)
def _ecef() -> Work:
    from schuler.inertial.ecef import StrapdownEcef
    from schuler.inertial.strapdown import Start
    from schuler.truth.trajectories import legs

    flight = legs(0.8, 0.3, 3000.0, speed=200.0, heading=0.7, turns=[1.5, -1.0], duration=1800.0)
    ideal = flight.ideal(100.0, every=100)
    start = Start.of(ideal.start)
    return lambda: StrapdownEcef(start).feed(ideal.dtheta, ideal.dv, ideal.dt, every=10)


@task("INS with 100 landmarks a second, 100 Hz, no smoother", "s of flight/s", FLOWN, repeats=5)
def _landmarks() -> Work:
    from dataclasses import replace

    from schuler.aiding.aided import navigate
    from schuler.studies.kind_aided import started
    from schuler.studies.model import parse_study
    from schuler.studies.oeson import CASES, Case
    from schuler.studies.simulated import simulation

    case = Case("bench", CASES["landmarks-1px-6"].sections, FLOWN)
    raw = case.raw("turns")
    raw["trajectory"] |= {"rate_hz": 100.0}
    raw["simulate"] |= {"sightings_hz": 10.0, "sightings_per_s": 100.0}
    study = parse_study(raw)
    recording = simulation(study).record(1)
    settings = replace(started(study, recording), smoother=False)
    return lambda: navigate(recording.tables, settings)
