"""What camera and lidar saw: one picture with what each landmark in it adds, the map of landmarks, the ground below."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Solution
from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84, C_en
from schuler.ground.frames import dcm_from_euler
from schuler.ground.tables import Table
from schuler.ground.units import DEG_PER_H
from schuler.report import decimate, figures
from schuler.report.figures import BOUND, FILTER, FIX, REJECTED, SMOOTHED, TRUTH, Panel
from schuler.report.parts import Figure, Grid, Section, number, plural
from schuler.report.view import View, _get

Array = NDArray[np.float64]
_GATE = 13.8  # squared residual in sigmas: chi-square of two, 99.9 %


@dataclass(frozen=True)
class Picture:
    """One picture: names, measured and predicted pixels (n, 2), Jacobians (n, 2, 6); the track's covariance of attitude
    (phi, rad^2) at that moment, not finite where it is not known."""

    time: float
    id: NDArray
    uv: Array
    predicted: Array
    H: Array
    cov_phi: Array
    row: int  # of the track
    which: NDArray[np.int64]  # rows of the landmarks


def sightings(view: View) -> Section | None:
    """The chapter on the camera."""
    camera = camera_of(view)
    seen, points = view.result.tables.get("sightings"), view.result.tables.get("landmarks")
    if camera is None or seen is None or points is None or not len(seen) or "lat" not in points:
        return None
    at = _which(seen, points)
    picture = _picture(view, camera, seen, points, at)
    told = taken(view, seen, at)
    shown = [_map(view, points, at, picture, told)]
    grids: list[Grid] = []
    if told is not None and len(told.row):
        shown.append(_residuals(view, seen, told))
    if picture is not None:
        shown.insert(0, _picture_figure(view, camera, picture))
        gains = what_each_adds(picture, camera)
        if gains is not None:
            grids.append(_gains(picture, gains))
    count = len(np.unique(seen.time))
    lead = (
        f"{plural(len(seen), 'sighting')} of {plural(len(np.unique(at[at >= 0])), 'landmark')} in "
        f"{plural(count, 'picture')}, {number(len(seen) / max(count, 1), 2)} each; {number(camera.sigma, 2)} px."
    )
    return Section("camera", "What the camera sees", lead, figures=shown, grids=grids)


@dataclass(frozen=True)
class Taken:
    """What the filter made of sightings: row of the table, innovation (n, 2) px, whether it was let in."""

    row: NDArray[np.int64]
    innovation: Array
    used: NDArray[np.bool_]


def taken(view: View, seen: Table, at: NDArray[np.int64]) -> Taken | None:
    """The innovations beside their rows: pictures of which the filter took, or refused, every sighting."""
    told = view.result.navigation.innovations.get("sightings")
    if told is None or not len(told.time):
        return None
    row = np.flatnonzero((at >= 0) & np.isfinite(seen["u"]) & np.isfinite(seen["v"]))
    row = row[np.argsort(seen.time[row], kind="stable")]
    time = seen.time[row]
    here, counts = np.unique(time, return_counts=True)
    there, numbers = np.unique(told.time, return_counts=True)
    both, i, j = np.intersect1d(here, there, return_indices=True)
    whole = both[counts[i] == numbers[j]]
    mine = np.isin(told.time, whole)
    return Taken(row[np.isin(time, whole)], np.asarray(told.value)[mine, :2], np.asarray(told.used)[mine])


def camera_of(view: View) -> Camera | None:
    """The camera of the study's [camera]."""
    k = _get(view.result.study, "camera")
    if k is None:
        return None
    names = ("focal_px", "u0_px", "v0_px", "sigma_px", "body_to_camera_rpy_deg", "position_frd_m")
    values = {n: _get(k, n) for n in names}
    return Camera.of(**{n: v for n, v in values.items() if v is not None})


def _which(seen: Table, points: Table) -> NDArray[np.int64]:
    """Row of the landmark of each sighting, -1 where there is none."""
    names, given = points["id"].astype(str), seen["id"].astype(str)
    order = np.argsort(names)
    place = np.clip(np.searchsorted(names[order], given), 0, len(names) - 1)
    return np.where(names[order][place] == given, order[place], -1)


def _picture(view: View, camera: Camera, seen: Table, points: Table, at: NDArray[np.int64]) -> Picture | None:
    """The picture in the second half of the track that shows most, predicted from the track."""
    from schuler.aiding.optics import rows

    solution: Solution = (view.smoother or view.filter).solution
    times, first, count = np.unique(seen.time, return_index=True, return_counts=True)
    inside = (times >= solution.time[0]) & (times <= solution.time[-1])
    late = inside & (times >= 0.5 * (solution.time[0] + solution.time[-1]))
    usable = np.flatnonzero(late if late.any() else inside)
    if not len(usable) or not np.isfinite(solution.rpy).any():
        return None
    most = usable[int(np.argmax(count[usable]))]
    k = np.arange(first[most], first[most] + count[most])
    k = k[at[k] >= 0][:400]
    if not len(k) or "height" not in points:
        return None
    i = int(np.argmin(np.abs(solution.time - times[most])))
    share = times[most]
    angles = np.unwrap(solution.rpy, axis=0)
    rpy = np.array([np.interp(share, solution.time, angles[:, j]) for j in range(3)])
    lat, lon, height = (
        float(np.interp(share, solution.time, x))
        for x in (solution.lat, np.unwrap(solution.lon), solution.height)
    )  # fmt: skip
    C = C_en(lat, lon)
    p = WGS84.ecef_from_geodetic(points["lat"][at[k]], points["lon"][at[k]], points["height"][at[k]])
    ned = (p - WGS84.ecef_from_geodetic(lat, lon, height)) @ C
    predicted, front, H = rows(ned, np.zeros(3), dcm_from_euler(*rpy), camera)
    if not front.any():
        return None
    k, predicted, H = k[front], predicted[front], H[front]
    return Picture(
        float(times[most]), seen["id"][k].astype(str), seen.stack("u", "v")[k], predicted, H,
        _cov_phi(rpy, solution.cov_rpy[i]), i, at[k],
    )  # fmt: skip


def _cov_phi(rpy: Array, cov_rpy: Array) -> Array:
    """Covariance of phi from that of roll, pitch, heading: the turns happen about the axes of the order ZYX."""
    _, p, h = rpy
    axes = np.array(
        [[math.cos(p) * math.cos(h), -math.sin(h), 0.0], [math.cos(p) * math.sin(h), math.cos(h), 0.0],
         [-math.sin(p), 0.0, 1.0]]
    )  # fmt: skip
    return np.asarray(axes @ cov_rpy @ axes.T)


def what_each_adds(picture: Picture, camera: Camera) -> Array | None:
    """(n,) how much larger the horizontal sigma of this one picture would be without each landmark (0.1: a tenth), the
    attitude known as well as the track knows it; None where that is not known."""
    if not np.isfinite(picture.cov_phi).all() or len(picture.id) < 2:
        return None
    prior = np.zeros((6, 6))
    prior[3:, 3:] = np.linalg.inv(picture.cov_phi + 1e-16 * np.eye(3))
    prior[:3, :3] = 1e-8 * np.eye(3)
    each = np.einsum("nij,nik->njk", picture.H, picture.H) / camera.sigma**2

    def horizontal(N: Array) -> float:
        P = np.linalg.inv(N)
        return math.sqrt(float(P[0, 0] + P[1, 1]))

    total = prior + each.sum(axis=0)
    whole = horizontal(total)
    return np.array([horizontal(total - one) / whole - 1.0 for one in each])


def _picture_figure(view: View, camera: Camera, picture: Picture) -> Figure:
    e = picture.uv - picture.predicted
    shift = np.median(e, axis=0) if len(e) > 3 else np.zeros(2)
    good = np.sum(((e - shift) / camera.sigma) ** 2, axis=1) < 4.0 * _GATE
    data: list[dict[str, Any]] = []
    size = float(np.median(np.hypot(*e[good].T))) if good.any() else camera.sigma
    wide = float(np.max(np.ptp(picture.predicted, axis=0), initial=1.0))
    gain = 10.0 ** math.floor(math.log10(max(0.1 * wide / max(size, 1e-3), 1.0)))
    ends = picture.predicted + gain * e
    lines = [np.vstack([a, b]) for a, b, g in zip(picture.predicted, ends, good, strict=True) if g]
    if lines:
        gap = np.full((1, 2), np.nan)
        joined = np.vstack([part for piece in lines for part in (piece, gap)])
        data.append(
            {
                "type": "scatter", "mode": "lines", "x": view.pool.add(joined[:, 0]), "y": view.pool.add(joined[:, 1]),
                "name": f"residual, {gain:g} times", "line": {"color": BOUND, "width": 1.2}, "hoverinfo": "skip",
            }
        )  # fmt: skip
    for name, rows, color, symbol in (("seen", good, FIX, "circle"), ("does not fit", ~good, REJECTED, "x")):
        if rows.any():
            data.append(
                {
                    "type": "scatter", "mode": "markers", "x": view.pool.add(picture.uv[rows, 0]),
                    "y": view.pool.add(picture.uv[rows, 1]), "name": name,
                    "text": [figures.label(i) for i in picture.id[rows]],
                    "marker": {"color": color, "size": 8, "symbol": symbol},
                    "hovertemplate": "%{text}<br>u %{x:.1f}, v %{y:.1f} px",
                }
            )  # fmt: skip
    data.append(
        {
            "type": "scatter", "mode": "markers", "x": view.pool.add(picture.predicted[:, 0]),
            "y": view.pool.add(picture.predicted[:, 1]), "name": "predicted",
            "marker": {"color": FILTER, "size": 11, "symbol": "circle-open"}, "hoverinfo": "skip",
        }
    )  # fmt: skip
    span = np.vstack([picture.uv, picture.predicted])
    low, high = span.min(axis=0), span.max(axis=0)
    pad = 0.08 * float(np.max(high - low)) + 20.0
    box = (float(low[0] - pad), float(high[0] + pad), float(low[1] - pad), float(high[1] + pad))
    caption = (
        f"At {number(float(view.axis.of(picture.time)), 5)} on the page's time axis. u counts to the right, v upwards. "
        f"Residual = measured − predicted by the {'smoothed' if view.smoother else 'filtered'} track, drawn "
        f"{gain:g} times as long."
    )
    return figures.plan(
        "fig-picture", "One picture", data, box, caption, labels=("u, px", "v, px"), width_px=500, half=True
    )  # fmt: skip


def _residuals(view: View, seen: Table, told: Taken) -> Figure:
    """Innovations of sightings from the whole track, as lines from where each was seen."""
    some = decimate.thin(len(told.row), 600)
    good = told.used[some]
    uv, e = seen.stack("u", "v")[told.row[some]], told.innovation[some]
    size = float(np.median(np.hypot(*e[good].T))) if good.any() else 1.0
    wide = float(np.max(np.ptp(uv, axis=0), initial=1.0))
    gain = 10.0 ** math.floor(math.log10(max(0.06 * wide / max(size, 1e-3), 1.0)))
    gap = np.full((int(good.sum()), 2), np.nan)
    lines = np.stack([uv[good], uv[good] + gain * e[good], gap], axis=1).reshape(-1, 2)
    data: list[dict[str, Any]] = [
        {
            "type": "scatter", "mode": "lines", "x": view.pool.add(lines[:, 0]), "y": view.pool.add(lines[:, 1]),
            "name": f"innovation, {gain:g} times", "line": {"color": BOUND, "width": 1.0}, "hoverinfo": "skip",
        }
    ]  # fmt: skip
    for name, rows, color, symbol in (("let in", good, FIX, "circle"), ("refused", ~good, REJECTED, "x")):
        if rows.any():
            data.append(
                {
                    "type": "scatter", "mode": "markers", "x": view.pool.add(uv[rows, 0]),
                    "y": view.pool.add(uv[rows, 1]), "name": name,
                    "text": [
                        f"{figures.label(str(seen['id'][k]))} at {seen.time[k]:.1f} s" for k in told.row[some][rows]
                    ],
                    "marker": {"color": color, "size": 4 if name == "let in" else 7, "symbol": symbol},
                    "hovertemplate": "%{text}<br>u %{x:.1f}, v %{y:.1f} px",
                }
            )  # fmt: skip
    low, high = uv.min(axis=0), uv.max(axis=0)
    pad = 0.08 * float(np.max(high - low)) + 20.0
    box = (float(low[0] - pad), float(high[0] + pad), float(low[1] - pad), float(high[1] + pad))
    caption = (
        f"{len(some)} of {len(told.row)} sightings of the whole track where they were seen; innovation = measured − "
        f"predicted before it was used, drawn {gain:g} times as long. Without order they are noise; all outwards or "
        "inwards is the focal length, all turning the mounting."
    )
    return figures.plan(
        "fig-residuals", "All pictures", data, box, caption, labels=("u, px", "v, px"), width_px=500, half=True
    )


def _map(
    view: View, points: Table, at: NDArray[np.int64], picture: Picture | None, told: Taken | None = None
) -> Figure:
    """All landmarks and the whole track where they fit one map; else what lies around the picture."""
    ned = view.ned(points["lat"], points["lon"])
    counts = np.bincount(at[at >= 0], minlength=len(points))
    used = np.flatnonzero(counts)
    track = (view.smoother or view.filter).ned
    both = np.vstack([ned[used, :2], track[np.isfinite(track[:, 0]), :2]])
    low, high = np.nanmin(both, axis=0), np.nanmax(both, axis=0)
    around = ""
    if picture is not None:
        centre = track[picture.row, :2]
        reach = 8.0 * float(np.max(np.hypot(*(ned[picture.which, :2] - centre).T))) + 10.0
        if np.isfinite(reach) and 1.5 * reach < float(np.max(high - low)):
            low, high = centre - reach, centre + reach
            around = " around the picture"
    near = (ned[used, :2] >= low - 1.0).all(axis=1) & (ned[used, :2] <= high + 1.0).all(axis=1)
    used = used[near]
    rows = used[decimate.thin(len(used), 3000)]
    inside = np.flatnonzero((track[:, :2] >= low - 0.2 * (high - low)).all(axis=1)
                            & (track[:, :2] <= high + 0.2 * (high - low)).all(axis=1))  # fmt: skip
    keep = inside[decimate.keep([track[inside, 0], track[inside, 1]], 2000)]
    data: list[dict[str, Any]] = [_points(view, ned[rows], "landmarks", FIX, 4, [
        f"{points['id'][i]}: {plural(int(counts[i]), 'sighting')}" for i in rows
    ])]  # fmt: skip
    data.append(
        {
            "type": "scatter", "mode": "lines", "x": view.pool.add(track[keep, 1], exact=True),
            "y": view.pool.add(track[keep, 0], exact=True), "name": "smoothed" if view.smoother else "filter",
            "line": {"color": SMOOTHED if view.smoother else FILTER, "width": 1.6}, "hoverinfo": "skip",
        }
    )  # fmt: skip
    if picture is not None:
        data.append(_points(view, ned[picture.which], "in the picture", BOUND, 7, [str(i) for i in picture.id]))
        data.append(_points(view, track[[picture.row]], "vehicle then", TRUTH, 9, ["vehicle"], symbol="triangle-up"))
    if told is not None and not told.used.all():
        out = np.unique(at[told.row[~told.used]])
        out = out[(ned[out, :2] >= low - 1.0).all(axis=1) & (ned[out, :2] <= high + 1.0).all(axis=1)]
        out = out[decimate.thin(len(out), 1000)]
        if len(out):
            names = [f"{points['id'][i]}: refused at least once" for i in out]
            data.append(_points(view, ned[out], "refused", REJECTED, 7, names, symbol="x"))
    pad = 0.04 * float(np.max(high - low)) + 5.0
    box = (float(low[1] - pad), float(high[1] + pad), float(low[0] - pad), float(high[0] + pad))
    more = "" if len(rows) == len(used) else f" {len(rows)} of {len(used)} are drawn."
    caption = f"Landmarks seen at least once, and the track{around}.{more}"
    return figures.plan("fig-landmarks", "Landmarks", data, box, caption, width_px=500, half=True)


def _points(
    view: View, ned: Array, name: str, color: str, size: float, text: list[str], symbol: str = "circle"
) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "markers", "x": view.pool.add(ned[:, 1], exact=True),
        "y": view.pool.add(ned[:, 0], exact=True), "name": name, "text": [figures.label(t) for t in text],
        "marker": {"color": color, "size": size, "symbol": symbol},
        "hovertemplate": "%{text}<br>east %{x:.0f} m, north %{y:.0f} m",
    }  # fmt: skip


def _gains(picture: Picture, gains: Array) -> Grid:
    order = np.argsort(-gains)[:12]
    rows = [
        [str(picture.id[i]), number(picture.uv[i, 0], 4), number(picture.uv[i, 1], 4),
         *(number(float(x), 2) for x in picture.uv[i] - picture.predicted[i]), number(100.0 * float(gains[i]), 2)]
        for i in order
    ]  # fmt: skip
    return Grid(
        ["landmark", "u, px", "v, px", "residual u, px", "residual v, px", "sigma without it, + %"],
        rows,
        caption=(
            "What each landmark of this picture adds: how much larger the horizontal sigma from this picture alone, "
            "with the attitude as the track knows it, would be without it."
        ),
    )


def ground(view: View) -> Section | None:
    """Height of the track over the height model, where a lidar ranged it."""
    table, beams = view.result.tables.get("height_model"), view.result.tables.get("lidar")
    if table is None or beams is None or not len(beams):
        return None
    from schuler.ground.errors import InputError
    from schuler.ground.terrain import HeightModel

    try:
        model = HeightModel.from_table(table)
    except InputError:
        return None
    solution = (view.smoother or view.filter).solution
    below = model.at(solution.lat, solution.lon)
    panel = Panel("height, m", height=190)
    color = SMOOTHED if view.smoother else FILTER
    panel.traces.append(figures.line(view.pool, view.axis, solution.time, solution.height, "track", color, ".1f"))
    panel.traces.append(figures.line(view.pool, view.axis, solution.time, below, "ground of the model", TRUTH, ".1f"))
    caption = f"{plural(len(beams), 'range')} of the lidar; above the ellipsoid."
    figure = figures.stack("fig-ground", "Over the ground", [panel], view.axis, caption)
    return Section("ground", "Over the ground", figures=[figure]) if figure else None


def yaw(view: View) -> Section | None:
    """How well heading and the z gyro are known over time, beside the horizontal acceleration that shows them."""
    if view.result.tables.get("sightings") is None or not len(view.filter.solution):
        return None
    solution = view.filter.solution
    variance = np.asarray(solution.cov_rpy)[:, 2, 2]
    if not np.isfinite(variance).any():
        return None
    sigma = np.rad2deg(np.sqrt(np.maximum(variance, 0.0))) * 60.0
    known = Panel("heading σ, arcmin", height=130, log=True)
    known.traces.append(figures.line(view.pool, view.axis, solution.time, sigma, "filter", FILTER, ".3~g"))
    if view.smoother is not None:
        late = np.rad2deg(np.sqrt(np.maximum(view.smoother.solution.cov_rpy[:, 2, 2], 0.0))) * 60.0
        known.traces.append(
            figures.line(view.pool, view.axis, view.smoother.solution.time, late, "smoothed", SMOOTHED, ".3~g")
        )
    panels = [known]
    bias = view.result.navigation.states.get("gyro_bias_z")
    if bias is not None and len(bias.time):
        gyro = Panel("z gyro σ, deg/h", height=120, log=True)
        gyro.traces.append(
            figures.line(view.pool, view.axis, bias.time, bias.std / DEG_PER_H, "filter", FILTER, ".3~g")
        )
        panels.append(gyro)
    if len(solution) > 4:
        slope = np.gradient(solution.v_n[:, :2], solution.time, axis=0)
        moved = Panel("accel., m/s²", height=110)
        moved.traces.append(
            figures.line(view.pool, view.axis, solution.time, np.hypot(*slope.T), "filter", FILTER, ".2f")
        )
        panels.append(moved)
    good = sigma[np.isfinite(sigma)]
    lead = (
        f"Heading is known to {number(float(good[0]), 2)} arcmin at first and to {number(float(good[-1]), 2)} at the "
        "end (1 sigma). Known landmarks show it as they pass; fixes show it only where the vehicle accelerates "
        "sideways."
    )
    figure = figures.stack(
        "fig-yaw",
        "What is known of yaw",
        panels,
        view.axis,
        "Standard deviations; below them the horizontal acceleration.",
    )
    return Section("yaw", "What is known of yaw", lead, figures=[figure]) if figure else None
