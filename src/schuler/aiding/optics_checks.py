"""What is wrong with a camera's or a lidar's tables: identities, mounting, focal length, geometry, cover, reach.

Pure functions from tables and an approximate track (a start carried on, fixes with an attitude, an earlier run) to
sentences. A track good to some tens of metres and a few degrees is enough: a wrong mounting turns directions of sight
by more, and scale is seen in differences between points of one picture, which the errors of a track hardly touch.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84, C_en, wrap_pi
from schuler.ground.frames import dcm_from_euler, euler_from_dcm
from schuler.ground.lidar import Lidar
from schuler.ground.tables import Table
from schuler.ground.terrain import HeightModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LINE = 0.02  # breadth over length of the points of one picture below which they are called a line
ODD = 12.0  # deg: a mounting or turn off by less is put down to the track's own attitude
SOME = 1500  # sightings that the mounting is searched with
SCALES = np.geomspace(0.25, 4.0, 33)
LOOKS = {(1, 0, 0): "ahead", (-1, 0, 0): "back", (0, -1, 0): "left", (0, 1, 0): "right", (0, 0, -1): "up",
         (0, 0, 1): "down"}  # fmt: skip


class Path(Protocol):
    """An approximate track: time s; lat, lon rad; height m; rpy (n, 3) rad. A `Solution` is one."""

    time: Any
    lat: Any
    lon: Any
    height: Any
    rpy: Any


@dataclass(frozen=True)
class Fault:
    """code: one word. says: what was found, a sentence. type_next: what to type or change. rows: of the table it is
    about, 0 for all of it. serious: whether a filter would go wrong, or just learn less."""

    code: str
    says: str
    type_next: str
    rows: int = 0
    serious: bool = True


@dataclass(frozen=True)
class _Pictures:
    """Sightings with their landmarks' place in e, the camera's place and C_ec; rows that have both."""

    time: Array
    id: NDArray
    uv: Array
    point: Array
    r: Array
    C: Array
    first: NDArray[np.int64]  # index of the first row of the same picture

    def predicted(self, camera: Camera, turn: Array | None = None) -> tuple[Array, Mask]:
        """(n, 2) px and in front (n,); turn (3, 3): the camera's axes turned by it."""
        x = np.einsum("nji,nj->ni", self.C, self.point - self.r)
        if turn is not None:
            x = x @ turn.T
        front = x[:, 2] < 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            uv = np.array([camera.u0, camera.v0]) - camera.focal * x[:, :2] / x[:, 2:]
        return np.where(front[:, None], uv, np.nan), front


def named(sightings: Table, landmarks: Table, source: str = "sightings") -> list[Fault]:
    """What the two tables say without any track: names that are not in the map, names twice, heights that lack."""
    faults = []
    who, where = sightings.source or source, landmarks.source or "landmarks"
    known = landmarks["id"].astype(str)
    double = [name for name, count in Counter(known.tolist()).items() if count > 1]
    if double:
        faults.append(
            Fault("twice", f"{where}: {len(double)} names are there more than once, {_some(double)}",
                  "keep one row for each landmark")
        )  # fmt: skip
    if "height" not in landmarks or not np.isfinite(landmarks["height"]).all():
        lack = len(landmarks) if "height" not in landmarks else int((~np.isfinite(landmarks["height"])).sum())
        faults.append(
            Fault("no-height", f"{where}: {lack} landmarks have no height, and a camera needs it",
                  "add the column height[m], above the ellipsoid", lack)
        )  # fmt: skip
    given = sightings["id"].astype(str)
    unknown = ~np.isin(given, known)
    if unknown.all():
        faults.append(
            Fault("unknown", f"{who}: none of its names is in {where} (here {_some(given)}; there {_some(known)})",
                  "use the same names in both tables", int(unknown.sum()))
        )  # fmt: skip
    elif unknown.any():
        faults.append(
            Fault("unknown", f"{who}: {int(unknown.sum())} of {len(given)} rows name landmarks that {where} does not "
                  f"have, {_some(given[unknown])}; they are left out", "add them to the map, or leave it so",
                  int(unknown.sum()), serious=False)
        )  # fmt: skip
    return faults


def _some(names: Sequence[Any] | NDArray) -> str:
    seen = list(dict.fromkeys(str(n) for n in names))
    return ", ".join(seen[:3]) + (", ..." if len(seen) > 3 else "")


def geometry(sightings: Table, landmarks: Table) -> list[Fault]:
    """How many points a picture has and how they lie: what pictures alone can and cannot tell."""
    good = np.isin(sightings["id"].astype(str), landmarks["id"].astype(str))
    time, uv = sightings.time[good], sightings.stack("u", "v")[good]
    if not len(time):
        return []
    cuts = np.flatnonzero(np.diff(time) != 0.0) + 1
    groups = np.split(np.arange(len(time)), cuts)
    size = np.array([len(g) for g in groups])
    faults = []
    few = int((size < 3).sum())
    if few:
        faults.append(
            Fault("few", f"{few} of {len(size)} pictures have fewer than three known points: none gives a pose by "
                  "itself; the INS carries them together, and without one nothing can be found",
                  "nothing, if there is an imu table", few, serious=False)
        )  # fmt: skip
    line = 0
    for g in groups:
        if len(g) >= 3:
            s = np.linalg.svd(uv[g] - uv[g].mean(axis=0), compute_uv=False)
            line += bool(s[1] < LINE * s[0])
    many = int((size >= 3).sum())
    if many and line > 0.5 * many:
        faults.append(
            Fault("line", f"the points of {line} of {many} pictures lie on one line: the turn about that line is not "
                  "seen in them", "add landmarks beside the line", line, serious=False)
        )  # fmt: skip
    return faults


def camera(sightings: Table, landmarks: Table, model: Camera, track: Path) -> list[Fault]:
    """Everything about a camera's tables: names, geometry, times, and with the track mounting, focal length, mirrored
    axes and exchanged names. The likeliest single explanation is named first."""
    faults = named(sightings, landmarks)
    if any(f.serious for f in faults):
        return faults
    faults += geometry(sightings, landmarks)
    pictures, outside = _pictures(sightings, landmarks, model, track)
    if outside:
        faults.append(
            Fault("time", f"{outside} of {len(sightings)} sightings are stamped outside the track "
                  f"({track.time[0]:.1f} to {track.time[-1]:.1f} s): left out", "put all tables on one clock", outside,
                  serious=len(pictures.time) == 0)
        )  # fmt: skip
    if len(pictures.time) < 6:
        return faults
    wrong, fits = mounting(pictures, model)
    faults += wrong
    return faults if wrong else faults + identities(pictures, landmarks, model, fits)


def _pictures(sightings: Table, landmarks: Table, model: Camera, track: Path) -> tuple[_Pictures, int]:
    names = landmarks["id"].astype(str)
    order = np.argsort(names)
    given = sightings["id"].astype(str)
    place = np.clip(np.searchsorted(names[order], given), 0, len(names) - 1)
    row = order[place]
    known = names[row] == given
    time = sightings.time
    inside = (time >= track.time[0]) & (time <= track.time[-1])
    keep = known & inside & np.isfinite(sightings["u"]) & np.isfinite(sightings["v"])
    t, row = time[keep], row[keep]
    lat, lon, height, rpy = _at(track, t)
    C_eb = C_en(lat, lon) @ dcm_from_euler(rpy[:, 0], rpy[:, 1], rpy[:, 2])
    point = WGS84.ecef_from_geodetic(landmarks["lat"][row], landmarks["lon"][row], landmarks["height"][row])
    r = WGS84.ecef_from_geodetic(lat, lon, height) + C_eb @ model.l_b
    uv = sightings.stack("u", "v")[keep]
    first = np.searchsorted(t, t, side="left")
    made = _Pictures(t, given[keep], uv, point, r, C_eb @ model.C_cb.T, first)
    return made, int((known & ~inside).sum())


def _at(track: Path, time: Array) -> tuple[Array, Array, Array, Array]:
    t = np.asarray(track.time)
    rpy = np.unwrap(np.asarray(track.rpy), axis=0)
    columns = [np.interp(time, t, x) for x in (track.lat, np.unwrap(np.asarray(track.lon)), track.height)]
    return columns[0], columns[1], columns[2], np.column_stack([np.interp(time, t, rpy[:, i]) for i in range(3)])


@dataclass(frozen=True)
class Fit:
    """How the camera of the pictures differs from the one typed: measured pixels are `scale` times those predicted by a
    camera whose axes are turned by R (3, 3), with v counted downwards if mirrored. miss: median angle left, rad."""

    R: Array
    scale: float
    mirrored: bool
    miss: float
    spread: float

    @property
    def angle(self) -> float:
        """Between the axes as typed and as found, deg."""
        return math.degrees(math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(self.R)) - 1.0)))))


def search(pictures: _Pictures, model: Camera) -> Fit:
    """The rotation, scale and mirroring that bring measured directions of sight onto those to the landmarks.

    For each of a row of scales the rotation follows in closed form (Wahba's problem), with weights that wrong names
    cannot pull; the scale is then made exact by differences within pictures.
    """
    rows = np.unique(np.linspace(0, len(pictures.uv) - 1, SOME).astype(int))
    x = np.einsum("nji,nj->ni", pictures.C[rows], pictures.point[rows] - pictures.r[rows])
    y = x / np.linalg.norm(x, axis=1, keepdims=True)
    uv = (pictures.uv[rows] - [model.u0, model.v0]) / model.focal
    best: tuple[float, Array, float, bool] | None = None
    for mirrored in (False, True):
        for scale in SCALES:
            d = np.column_stack([uv[:, 0], -uv[:, 1] if mirrored else uv[:, 1], np.full(len(uv), -scale)])
            d /= np.linalg.norm(d, axis=1, keepdims=True)
            R, miss = _wahba(d, y)
            # a mirror is believed only where it explains far more
            if best is None or miss < (0.6 if mirrored and not best[3] else 1.0) * best[0]:
                best = (miss, R, float(scale), mirrored)
    assert best is not None
    miss, R, scale, mirrored = best
    found = Fit(R, scale, mirrored, miss, 0.0)
    own = Fit(np.eye(3), 1.0, mirrored, miss, 0.0)
    return _scaled(pictures, model, own if found.angle < ODD else replace(found, R=R))


def _wahba(d: Array, y: Array) -> tuple[Array, float]:
    """R with d = R y for unit vectors (n, 3), by sums of absolute angles; and the median angle, rad."""
    w = np.ones(len(d))
    R = np.eye(3)
    for _ in range(8):
        U, _, Vt = np.linalg.svd((w[:, None] * d).T @ y)
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        e = np.linalg.norm(d - y @ R.T, axis=1)
        w = 1.0 / (e + 0.3 * float(np.median(e)) + 1e-6)
    return R, float(np.median(e))


def _scaled(pictures: _Pictures, model: Camera, found: Fit) -> Fit:
    """The same with the scale from differences of points within pictures, which errors of the track do not touch."""
    p, _ = pictures.predicted(model, found.R)
    if found.mirrored:
        p = p * [1.0, -1.0] + [0.0, 2.0 * model.v0]
    a, b = _differences(pictures, p, model)
    long = np.abs(a) > 0.02 * model.focal
    if long.sum() < 5:
        return found
    size = np.log(np.abs(b[long]) / np.abs(a[long]))
    centre = float(np.median(size))
    return replace(found, scale=math.exp(centre), spread=float(np.median(np.abs(size - centre))))


def _differences(pictures: _Pictures, p: Array, model: Camera) -> tuple[Array, Array]:
    """Complex predicted and measured offsets of points from another point of their picture, a third of a picture away
    in its list; where a picture has one point, from the principal point."""
    n = len(p)
    k = np.arange(n)
    end = np.searchsorted(pictures.time, pictures.time, side="right")
    size = end - pictures.first
    other = pictures.first + (k - pictures.first + 1 + size // 3) % size
    alone = size == 1
    centre = complex(model.u0, model.v0)
    a, b = (x[:, 0] + 1j * x[:, 1] for x in (p, pictures.uv))
    da, db = np.where(alone, a - centre, a - a[other]), np.where(alone, b - centre, b - b[other])
    good = np.isfinite(da) & (np.abs(db) > 0.0)
    return da[good], db[good]


def mounting(pictures: _Pictures, model: Camera) -> tuple[list[Fault], Fit]:
    """Whether the camera looks where it is said to, is turned, mirrored, or has another focal length: of all these the
    one explanation that makes directions of sight and directions to the landmarks alike."""
    found = search(pictures, model)
    front = float(pictures.predicted(model)[1].mean())
    if found.miss > 0.15:
        return [
            Fault("alien", "the sightings do not look like these landmarks from this track, however the camera is "
                  "turned or scaled: most names, the track or the clock are wrong",
                  "look at one picture: are the names those of the map?")
        ], found  # fmt: skip
    said = []
    R = found.R
    typed = f"body_to_camera_rpy_deg = {_typed(R @ model.C_cb)}"
    turn = math.degrees(math.atan2(R[1, 0], R[0, 0]))
    about_axis = R[2, 2] > math.cos(math.radians(ODD))
    if found.mirrored:
        half = about_axis and abs(turn) > 180.0 - ODD
        axis, other = ("u", "to the right") if half else ("v", "upwards")
        more = "" if half or found.angle < ODD else f"; then the camera is mounted otherwise too: {typed}"
        said.append(
            Fault("mirrored", f"the pictures are mirror images of what is expected: {axis} counts the other way in "
                  f"this file; here it counts {other}", f"replace {axis} by 2 {axis}0 - {axis}{more}")
        )  # fmt: skip
    elif found.angle > ODD and about_axis:
        how = (
            "mounted upside down" if abs(turn) > 180.0 - ODD else f"turned by about {turn:.0f} deg on its line of sight"
        )
        said.append(Fault("turned", f"the camera is {how} against what is typed", typed))
    elif found.angle > ODD:
        behind = 100.0 * (1.0 - front)
        what = f"{behind:.0f} % of the landmarks seen lie behind the camera as it is mounted" if behind > 20.0 else (
            "the pictures are not those of the camera as it is mounted"
        )  # fmt: skip
        said.append(Fault("mounting", f"{what}; they fit one that looks {_looks(R @ model.C_cb)}", typed))
    return said + _focal(pictures, model, found, bool(said)), found


def _looks(C_cb: Array) -> str:
    """Where a camera looks, in the body, in words."""
    d = -C_cb[2]
    axis, word = max(LOOKS.items(), key=lambda item: float(np.dot(item[0], d)))
    away = math.degrees(math.acos(min(1.0, float(np.dot(axis, d)))))
    low = math.degrees(math.asin(min(1.0, max(-1.0, float(d[2])))))
    return (
        word if away < ODD or word in ("up", "down") else f"{word} and {abs(low):.0f} deg {'down' if low > 0 else 'up'}"
    )


def _typed(C_cb: Array) -> list[float]:
    """body_to_camera_rpy_deg: the nearest mounting in quarter turns if that is near, else whole degrees."""
    snapped = np.round(C_cb)
    near = np.abs(np.abs(snapped).sum(axis=0) - 1.0).max() < 0.5 and np.linalg.det(snapped) > 0.5
    if near and 0.5 * (float(np.trace(snapped.T @ C_cb)) - 1.0) > math.cos(math.radians(ODD)):
        C_cb = snapped
    return [float(round(math.degrees(float(x))) % 360) for x in euler_from_dcm(C_cb)]


def _focal(pictures: _Pictures, model: Camera, best: Fit, more: bool) -> list[Fault]:
    """A sentence where the pictures are larger or smaller than expected by more than the spread allows."""
    off = abs(math.log(best.scale))
    if off < max(0.02, 3.0 * best.spread / math.sqrt(len(pictures.time))):
        return []
    distance = float(np.median(np.linalg.norm(pictures.point - pictures.r, axis=1)))
    heights = abs(1.0 - 1.0 / best.scale) * distance
    also = ""
    if heights < 60.0:
        also = f"; heights wrong by {heights:.0f} m (geoid instead of ellipsoid?) would look the same"
    word = "besides, t" if more else "t"
    likelier = "" if more else ": a wrong focal length is likelier than a wrong mounting"
    return [
        Fault("focal", f"{word}he pictures are {best.scale:.3f} times as large as expected{likelier}{also}",
              f"focal_px = {model.focal * best.scale:.0f}")
    ]  # fmt: skip


def identities(pictures: _Pictures, landmarks: Table, model: Camera, fits: Fit | None = None) -> list[Fault]:
    """Names that belong to another landmark: a pair always exchanged (a mistake of the map), or some rows here and
    there. Judged by residuals left after the median shift of each picture, against the pictures' own scatter."""
    if fits is not None and abs(math.log(fits.scale)) > 0.005:
        model = replace(model, focal=model.focal * fits.scale)
    p, front = pictures.predicted(model)
    e = pictures.uv - p
    left = e.copy()
    cuts = np.flatnonzero(np.diff(pictures.time) != 0.0) + 1
    groups = np.split(np.arange(len(e)), cuts)
    shifts = np.array([np.nanmedian(e[g], axis=0) if front[g].sum() >= 4 else [0.0, 0.0] for g in groups])
    for g, shift in zip(groups, shifts, strict=True):
        left[g] -= shift
    size = np.hypot(left[:, 0], left[:, 1])
    usual = float(np.nanmedian(size))
    limit = max(8.0 * model.sigma, 6.0 * usual)
    bad = front & (size > limit)
    if not bad.any():
        return []
    swapped: Counter[tuple[str, str]] = Counter()
    both: Counter[tuple[str, str]] = Counter()
    exchanged = np.zeros(len(e), dtype=bool)
    for g, shift in zip(groups, shifts, strict=True):
        wrong = [k for k in g if bad[k]]
        for i, j in itertools.combinations(wrong, 2):
            near = max(limit, 0.5 * usual)
            if np.hypot(*(pictures.uv[i] - p[j] - shift)) < near and np.hypot(*(pictures.uv[j] - p[i] - shift)) < near:
                swapped[_pair(pictures, i, j)] += 1
                exchanged[[i, j]] = True
    for g in groups:
        if len(swapped) and len(g) < 400:
            here = set(pictures.id[g].tolist())
            for pair in swapped:
                both[pair] += pair[0] in here and pair[1] in here
    faults = []
    for pair, count in swapped.most_common(3):
        if count >= 3 and count > 0.6 * both[pair]:
            faults.append(
                Fault("exchanged", f"landmarks {pair[0]} and {pair[1]} stand in each other's place in {count} of the "
                      f"{both[pair]} pictures that show both", "exchange their names (or places) in landmarks",
                      2 * count)
            )  # fmt: skip
    always = {name for f in faults for name in f.says.split(" stand")[0].removeprefix("landmarks ").split(" and ")}
    rest = bad & ~np.isin(pictures.id, sorted(always))
    if rest.any():
        share = float(rest.mean())
        how = (
            f", {int((exchanged & rest).sum())} of them exchanged with another of the picture"
            if exchanged.any()
            else ""
        )
        faults.append(
            Fault("names", f"{int(rest.sum())} of {len(rest)} sightings ({100.0 * share:.1f} %) lie more than "
                  f"{limit:.0f} px from their landmark: wrong names or a wrong place in the map{how}",
                  "nothing: a filter leaves out what does not fit" if share < 0.2 else "look at how names are given",
                  int(rest.sum()), serious=share >= 0.2)
        )  # fmt: skip
    return faults


def _pair(pictures: _Pictures, i: int, j: int) -> tuple[str, str]:
    a, b = sorted((str(pictures.id[i]), str(pictures.id[j])))
    return a, b


# ---- lidar ----


def lidar(
    table: Table, sensor: Lidar, track: Path, *, model: HeightModel | None = None, landmarks: Table | None = None
) -> list[Fault]:
    """Reach, directions, cover of the height model under the flight, names, and a common offset of all heights."""
    from schuler.kernels import optics as kernel

    who = table.source or "lidar"
    faults = []
    far = table["range"] > sensor.farthest
    if far.any():
        faults.append(
            Fault("reach", f"{who}: {int(far.sum())} of {len(far)} ranges are beyond the sensor's {sensor.farthest:g} "
                  f"m, the largest {float(table['range'].max()):.0f} m; they are left out",
                  "raise the sensor's reach if they are real", int(far.sum()), serious=bool(far.mean() > 0.5))
        )  # fmt: skip
    if "id" in table:
        points = np.array([bool(x) for x in table["id"].astype(str)])
        if landmarks is None and points.any():
            faults.append(Fault("unknown", f"{who} names points, and there is no landmarks table", "add landmarks"))
        elif landmarks is not None and points.any():
            named_rows = table.where(points)
            faults += named(named_rows, landmarks, "lidar")
        table, far = table.where(~points), far[~points]
    if not len(table):
        return faults
    if model is None:
        return [*faults, Fault("no-model", f"{who}: ranges without a name need a height model", "add height_model")]
    t = table.time
    inside = (t >= track.time[0]) & (t <= track.time[-1]) & ~far
    lat, lon, height, rpy = _at(track, t[inside])
    under = model.at(lat, np.asarray(wrap_pi(lon)))
    if np.isnan(under).any():
        lost = int(np.isnan(under).sum())
        k = int(np.flatnonzero(np.isnan(under))[0])
        faults.append(
            Fault("cover", f"the height model does not cover {lost} of {len(under)} places of the flight, first "
                  f"{math.degrees(lat[k]):.4f}, {math.degrees(float(wrap_pi(lon[k]))):.4f} deg at {t[inside][k]:.1f} s"
                  "; ranges there are left out", "add the tiles of the flight to height_model", lost,
                  serious=lost > 0.5 * len(under))
        )  # fmt: skip
    az, el, measured = (table[c][inside] for c in ("azimuth", "elevation", "range"))
    some = np.unique(np.linspace(0, len(az) - 1, min(len(az), 400)).astype(int)) if len(az) else np.zeros(0, dtype=int)
    H, status, off, cosine = np.empty(6), np.zeros(4, dtype=int), [], []
    C = dcm_from_euler(rpy[:, 0], rpy[:, 1], rpy[:, 2])
    for k in some:
        rho, came, _, _, _ = kernel.lidar_height_rows(
            lat[k], lon[k], height[k], C[k].ravel(), sensor.l_b, az[k], el[k], model.grid, model.heights,
            2.0 * sensor.farthest, WGS84.a, WGS84.e2, H,
        )  # fmt: skip
        status[came] += 1
        if came == kernel.HIT:
            off.append(measured[k] - rho)
            cosine.append(-H[2])
    if len(some) and status[kernel.NEVER] > 0.5 * len(some):
        which = "the other way round" if float(np.mean(el)) > 0.0 else "for a vehicle under the ground of the model"
        faults.append(
            Fault("up", f"{who}: {100 * status[kernel.NEVER] // len(some)} % of the beams do not come down to the "
                  f"ground: elevation counts upwards from the body's plane, -90 deg is straight down; it looks {which}",
                  "change the sign of elevation" if which[:9] == "the other" else "compare heights of track and model")
        )  # fmt: skip
    if len(off) >= 5:
        shift = float(np.median(np.array(off) / np.maximum(np.array(cosine), 0.2)))
        scatter = 1.4826 * float(np.median(np.abs(np.array(off) / np.maximum(np.array(cosine), 0.2) - shift)))
        if abs(shift) > max(5.0, 3.0 * scatter):
            faults.append(
                Fault("datum", f"{who}: ranges are {abs(shift):.0f} m {'longer' if shift > 0 else 'shorter'} than "
                      "height model and track give: heights above the geoid in one, above the ellipsoid in the other?",
                      "give all heights above the ellipsoid", len(off))
            )  # fmt: skip
    return faults
