"""What a camera and a lidar see on a flight: landmarks, sightings, wrong identities, ranges over a height model.

From a truth (`Truth`: place, attitude) to the contract's tables, exact on the ellipsoid. Each quantity draws from a
stream of its own (`truth.streams`). A landmark is seen where its ray leaves the camera within the picture; a vehicle
that banks or climbs simply looks elsewhere, and above the horizon it sees nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84, C_en, Ellipsoid
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_quat
from schuler.ground.lidar import Lidar
from schuler.ground.tables import Table
from schuler.ground.terrain import HeightModel
from schuler.truth.streams import stream
from schuler.truth.trajectories import Truth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
OESON = (2500.0, 1900.0)  # px from the centre within which the thesis's landmarks lie (5440 x 4080 pixels of 9 um)
LOWEST = 0.05  # least share of down in a direction that is followed to the ground


@dataclass(frozen=True)
class Seen:
    """landmarks and sightings as the contract's tables; wrong (n,): which sightings carry another landmark's name."""

    landmarks: Table
    sightings: Table
    wrong: Mask
    notes: list[str] = field(default_factory=list)


def ground_height(ground: HeightModel | float, lat: ArrayLike, lon: ArrayLike) -> Array:
    """Height of the ground, m, at places in rad; NaN where a model does not cover them."""
    if isinstance(ground, HeightModel):
        return ground.at(lat, lon)
    return np.full(np.broadcast(np.asarray(lat), np.asarray(lon)).shape, float(ground))


def on_ground(
    r_e: Array, d_e: Array, ground: HeightModel | float, earth: Ellipsoid = WGS84
) -> tuple[Array, Array, Array, Array]:
    """Where rays from r_e (n, 3), m, along unit d_e (n, 3), both in e, meet the ground: lat, lon (rad), height (m) and
    the way (n,) m; NaN where they do not come down to it or leave the model. For ground less steep than the ray."""
    lat, lon, h = earth.geodetic_from_ecef(r_e)
    down = np.einsum("ni,ni->n", C_en(lat, lon)[:, :, 2], d_e)
    t = np.where(down > LOWEST, 0.0, np.nan)
    with np.errstate(invalid="ignore"):
        for _ in range(60):
            lat, lon, h = earth.geodetic_from_ecef(r_e + np.where(np.isfinite(t), t, 0.0)[:, None] * d_e)
            gap = h - ground_height(ground, lat, lon)
            t = t + gap / down
            if not np.any(np.abs(gap[np.isfinite(t)]) > 1e-7):
                break
        t = np.where((t > 0.0) & (np.abs(gap) < 1e-4), t, np.nan)
    lat, lon, h = (np.where(np.isfinite(t), x, np.nan) for x in (lat, lon, h))
    return lat, lon, h, t


def _camera_rays(truth: Truth, camera: Camera, earth: Ellipsoid) -> tuple[Array, Array]:
    """The camera's place (n, 3) m and C_ec (n, 3, 3), both in e."""
    C_eb = C_en(truth.lat, truth.lon) @ dcm_from_quat(truth.q_nb)
    r = earth.ecef_from_geodetic(truth.lat, truth.lon, truth.height) + C_eb @ camera.l_b
    return r, C_eb @ camera.C_cb.T


def _names(count: int, prefix: str) -> NDArray[np.str_]:
    width = max(4, len(str(count)))
    return np.array([f"{prefix}{i + 1:0{width}d}" for i in range(count)])


def scattered(
    truth: Truth, camera: Camera, count: int, *, ground: HeightModel | float = 0.0, half: tuple[float, float] = OESON,
    wrong_share: float = 0.0, seed: int = 0, run: int = 0, prefix: str = "L", earth: Ellipsoid = WGS84,
) -> Seen:  # fmt: skip
    """The set-up of the OESON study: in each picture (row of truth) `count` fresh landmarks, evenly spread over the
    picture of +-half (px), each seen once. Those whose ray meets no ground are left out."""
    if count < 1 or not 0.0 <= wrong_share <= 1.0:
        raise InputError(f"{count} landmarks a picture and a share {wrong_share} of wrong names: 1 or more, and 0 to 1")
    n = len(truth)
    rng = stream(seed, run, "camera.landmarks")
    uv = rng.uniform(-1.0, 1.0, (n, count, 2)) * np.asarray(half) + [camera.u0, camera.v0]
    r, C = _camera_rays(truth, camera, earth)
    d = np.einsum("nij,nkj->nki", C, camera.directions(uv))
    lat, lon, h, t = on_ground(np.repeat(r, count, axis=0), d.reshape(-1, 3), ground, earth)
    good = np.isfinite(t)
    names = _names(n * count, prefix)
    noise = camera.sigma * stream(seed, run, "camera.noise").standard_normal((n * count, 2))
    landmarks = Table(
        "landmarks", {"id": names[good], "lat": lat[good], "lon": lon[good], "height": h[good]}, source="simulated"
    )
    seen = (uv.reshape(-1, 2) + noise)[good]
    return _named(
        np.repeat(truth.time, count)[good], np.flatnonzero(good), names, seen, landmarks, wrong_share, seed, run
    )


def along_track(
    truth: Truth, per_km2: float, width: float, *, ground: HeightModel | float = 0.0, seed: int = 0, run: int = 0,
    prefix: str = "L", earth: Ellipsoid = WGS84,
) -> Table:  # fmt: skip
    """A landmarks table: `per_km2` points a square kilometre, evenly spread, within `width` m of the ground track."""
    r_n, r_e = (float(x) for x in earth.radii(float(truth.lat[0])))
    scale = np.array([r_n, r_e * math.cos(float(truth.lat[0]))])
    track = np.column_stack([truth.lat - truth.lat[0], np.unwrap(truth.lon) - truth.lon[0]]) * scale
    low, high = track.min(axis=0) - width, track.max(axis=0) + width
    area = float(np.prod(high - low))
    number = int(area * per_km2 * 1e-6)
    if not 1 <= number <= 20_000_000:
        raise InputError(
            f"{per_km2:g} landmarks a square km around this track are {number}: choose another density or width"
        )
    from scipy.spatial import cKDTree

    points = low + (high - low) * stream(seed, run, "camera.field").random((number, 2))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track, axis=0).T))])
    fine = np.linspace(0.0, way[-1], int(way[-1] / (0.1 * width)) + 2)
    dense = np.column_stack([np.interp(fine, way, track[:, i]) for i in range(2)])
    points = points[cKDTree(dense).query(points, distance_upper_bound=width)[0] <= width]
    lat, lon = truth.lat[0] + points[:, 0] / scale[0], truth.lon[0] + points[:, 1] / scale[1]
    h = ground_height(ground, lat, lon)
    good = np.isfinite(h)
    columns = {"id": _names(int(good.sum()), prefix), "lat": lat[good], "lon": lon[good], "height": h[good]}
    return Table("landmarks", columns, source="simulated")


def sightings(
    truth: Truth, camera: Camera, landmarks: Table, *, most: int | None = None, wrong_share: float = 0.0,
    farthest: float = math.inf, seed: int = 0, run: int = 0, earth: Ellipsoid = WGS84,
) -> Seen:  # fmt: skip
    """Each picture (row of truth) of a camera over known points: those within the picture and nearer than `farthest` m,
    at most `most` of them, drawn evenly. The camera needs half_width and half_height. Hills hide nothing here."""
    if camera.half_width is None or camera.half_height is None:
        raise InputError("the camera has no picture: give half_width_px and half_height_px")
    from scipy.spatial import cKDTree

    points = earth.ecef_from_geodetic(landmarks["lat"], landmarks["lon"], landmarks["height"])
    tree = cKDTree(points)
    r, C = _camera_rays(truth, camera, earth)
    rng = stream(seed, run, "camera.choice")
    corner = math.hypot(camera.half_width, camera.half_height) / camera.focal
    above = truth.height - float(np.min(landmarks["height"]))
    times, rows, pixels = [], [], []
    for k in range(len(truth)):
        axis = -C[k, :, 2]
        tilt = math.acos(min(1.0, max(-1.0, float(axis @ C_en(truth.lat[k], truth.lon[k])[:, 2]))))
        lean = min(tilt + math.atan(corner), math.radians(87.0))
        reach = min(farthest, 1.02 * max(float(above[k]), 1.0) / math.cos(lean) + 10.0)
        near = np.asarray(tree.query_ball_point(r[k], reach), dtype=np.int64)
        near.sort()
        x = (points[near] - r[k]) @ C[k]
        with np.errstate(divide="ignore", invalid="ignore"):
            uv = np.array([camera.u0, camera.v0]) - camera.focal * x[:, :2] / x[:, 2:]
        seen = np.flatnonzero((x[:, 2] < 0.0) & camera.inside(uv))
        if most is not None and len(seen) > most:
            seen = np.sort(rng.choice(seen, most, replace=False))
        times.append(np.full(len(seen), truth.time[k]))
        rows.append(near[seen])
        pixels.append(uv[seen])
    which = np.concatenate(rows)
    uv = np.concatenate(pixels)
    noise = camera.sigma * stream(seed, run, "camera.noise").standard_normal(uv.shape)
    return _named(np.concatenate(times), which, landmarks["id"], uv + noise, landmarks, wrong_share, seed, run)


def _named(
    time: Array, which: NDArray[np.int64], names: NDArray, uv: Array, landmarks: Table, wrong_share: float, seed: int,
    run: int,
) -> Seen:  # fmt: skip
    """The sightings table; a share of the rows gets the name of another landmark of the same picture."""
    rng = stream(seed, run, "camera.identities")
    n = len(time)
    wrong = rng.random(n) < wrong_share
    pick = rng.random(n)
    given = names[which].copy()
    first = np.searchsorted(time, time, side="left")
    size = np.searchsorted(time, time, side="right") - first
    wrong &= size > 1
    for k in np.flatnonzero(wrong):
        other = first[k] + int(pick[k] * (size[k] - 1))
        given[k] = names[which[other + (other >= k)]]
    table = Table("sightings", {"time": time, "id": given, "u": uv[:, 0].copy(), "v": uv[:, 1].copy()},
                  source="simulated")  # fmt: skip
    return Seen(landmarks, table, wrong)


def lidar_over_ground(
    truth: Truth, lidar: Lidar, model: HeightModel, beams: ArrayLike, *, seed: int = 0, run: int = 0,
    earth: Ellipsoid = WGS84,
) -> tuple[Table, list[str]]:  # fmt: skip
    """A lidar table: at each row of truth one range a beam. beams (k, 2): azimuth, elevation, rad, fixed to the body;
    or (n, k, 2), another set at each row. Beams that meet nothing within reach give no row; the notes count them.

    Noise: the sensor's, and the spread of heights within the spot on slanted ground; the model's own errors (its sigma)
    are drawn once for each row, as if the ground were off there."""
    from schuler.kernels import optics as kernel

    n = len(truth)
    b = np.asarray(beams, dtype=np.float64)
    b = np.broadcast_to(b, (n, *b.shape[-2:]))
    k = b.shape[1]
    C = dcm_from_quat(truth.q_nb)
    H = np.empty(6)
    rng = stream(seed, run, "lidar.noise")
    noise = rng.standard_normal((n, k))
    times, ranges, angles, lost = [], [], [], np.zeros(4, dtype=int)
    for i in range(n):
        for j in range(k):
            rho, status, incidence, _, _ = kernel.lidar_height_rows(
                truth.lat[i], truth.lon[i], truth.height[i], C[i].ravel(), lidar.l_b, b[i, j, 0], b[i, j, 1],
                model.grid, model.heights, lidar.farthest, earth.a, earth.e2, H,
            )  # fmt: skip
            lost[status] += 1
            if status == kernel.HIT:
                s = kernel.lidar_sigma(lidar.sigma, rho, incidence, lidar.divergence, model.sigma)
                times.append(truth.time[i])
                ranges.append(max(rho + s * noise[i, j], 1e-3))
                angles.append(b[i, j])
    notes = [
        f"{count} of {n * k} beams {what}"
        for count, what in zip(lost[1:], ("leave the height model", "reach no ground within the lidar's range",
                                          "do not come down to the ground"), strict=True)
        if count
    ]  # fmt: skip
    a = np.array(angles).reshape(-1, 2)
    columns = {
        "time": np.array(times),
        "range": np.array(ranges),
        "azimuth": a[:, 0].copy(),
        "elevation": a[:, 1].copy(),
    }
    return Table("lidar", columns, source="simulated"), notes


def lidar_to_points(
    truth: Truth, lidar: Lidar, landmarks: Table, *, seed: int = 0, run: int = 0, earth: Ellipsoid = WGS84
) -> Table:
    """A lidar table with `id`: at each row of truth the range and direction to every known point within reach."""
    points = earth.ecef_from_geodetic(landmarks["lat"], landmarks["lon"], landmarks["height"])
    C_eb = C_en(truth.lat, truth.lon) @ dcm_from_quat(truth.q_nb)
    r = earth.ecef_from_geodetic(truth.lat, truth.lon, truth.height) + C_eb @ lidar.l_b
    d = np.einsum("nji,nkj->nki", C_eb, points[None] - r[:, None])
    rho = np.linalg.norm(d, axis=2)
    noise = lidar.sigma * stream(seed, run, "lidar.points").standard_normal(rho.shape)
    i, j = np.nonzero(rho <= lidar.farthest)
    x = d[i, j] / rho[i, j][:, None]
    columns: dict[str, NDArray] = {
        "time": truth.time[i], "range": np.maximum(rho + noise, 1e-3)[i, j], "azimuth": np.arctan2(x[:, 1], x[:, 0]),
        "elevation": -np.arcsin(x[:, 2]), "id": landmarks["id"][j],
    }  # fmt: skip
    return Table("lidar", columns, source="simulated")


def hills(
    lat: tuple[float, float], lon: tuple[float, float], *, cell: float = 30.0, height: float = 100.0,
    relief: float = 30.0, length: float = 1500.0, seed: int = 0, sigma: float = 0.0,
) -> HeightModel:  # fmt: skip
    """A smooth random landscape between two latitudes and two longitudes (rad): cells of `cell` m, heights of standard
    deviation `relief` m about `height`, hills about `length` m from crest to crest."""
    a = WGS84.a
    dlat, dlon = cell / a, cell / (a * math.cos(0.5 * (lat[0] + lat[1])))
    rows, columns = (int(math.ceil((x[1] - x[0]) / s)) + 1 for x, s in ((lat, dlat), (lon, dlon)))
    if rows < 2 or columns < 2 or rows * columns > 50_000_000:
        raise InputError(f"a height model of {rows} x {columns} cells: choose other bounds or another cell")
    rng = stream(seed, 0, "ground.hills")
    y, x = np.arange(rows)[:, None] * cell, np.arange(columns)[None, :] * cell
    waves = 24
    k = 2.0 * math.pi / (length * np.exp(rng.uniform(-0.7, 0.7, waves)))
    turn, phase = rng.uniform(0.0, 2.0 * math.pi, (2, waves))
    h = np.zeros((rows, columns))
    for i in range(waves):
        h += np.sin(k[i] * (np.cos(turn[i]) * y + np.sin(turn[i]) * x) + phase[i])
    return HeightModel(lat[0], lon[0], dlat, dlon, height + relief * math.sqrt(2.0 / waves) * h, sigma)
