"""Position and attitude from sightings of known points, and what such sightings can tell at all.

NED about a local origin (m), body FRD, camera axes as in `ground.camera`; errors = estimate - truth, ordered dr (m,
NED), phi (rad), C_hat = (I - [phi x]) C. Three points leave up to four poses, four or more leave one. The thesis on
strapdown INS (2022), section 4.4, meant this and printed something else: see docs/optics.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.camera import Camera
from schuler.ground.earth import WGS84, C_en, Ellipsoid
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, euler_from_dcm, orthonormalise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
NAMES = ("north", "east", "down", "phi_north", "phi_east", "phi_down")
GATE = 13.8  # squared residual, sigmas, of a sighting: chi-square of 2, 99.9 %
SEARCH = 60.0  # the same while searching, where a pose of three noisy points is judged
ON_A_LINE = 1e-3  # breadth over length of the points
WEAK = 500.0  # condition of the scaled Jacobian from which a pose is called near-critical
HOPELESS = 1e8


@dataclass(frozen=True)
class Pose:
    """One pose: r_n (3,) m, the IMU from the origin of the points' NED; C_nb (3, 3); covariance (6, 6), m and rad.

    used (n,): the sightings taken; residuals (n, 2) px, predicted - measured, NaN behind the camera. rms: of the used
    ones, in sigmas a degree of freedom (1: as good as sigma says; NaN for three). condition: of the Jacobian in
    radians of sight against (dr/distance, phi). critical: "" or why the pose is weak. others: further poses that fit
    three points as well.
    """

    r_n: Array
    C_nb: Array
    covariance: Array
    used: Mask
    residuals: Array
    rms: float
    condition: float
    critical: str = ""
    others: tuple[Pose, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def rpy(self) -> Array:
        """(3,) roll, pitch, heading, rad."""
        return np.array(euler_from_dcm(self.C_nb))

    @property
    def std(self) -> Array:
        """(6,) sigma: m north, east, down; rad about north, east, down."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Scene:
    """Points (n, 3) m in NED and where they were seen: uv (n, 2) px, sigma (n, 2) px."""

    points: Array
    uv: Array
    sigma: Array

    @classmethod
    def of(cls, points_n: ArrayLike, uv: ArrayLike, sigma: ArrayLike) -> Scene:
        """Checks shapes and numbers."""
        p, m = np.ascontiguousarray(points_n, dtype=np.float64), np.ascontiguousarray(uv, dtype=np.float64)
        n = len(p)
        if p.shape != (n, 3) or m.shape != (n, 2):
            raise InputError(f"points must be (n, 3) and pixels (n, 2); got {p.shape} and {m.shape}")
        s = np.ascontiguousarray(np.broadcast_to(np.asarray(sigma, dtype=np.float64), (n, 2)).copy())
        if not (np.all(np.isfinite(p)) and np.all(np.isfinite(m))):
            raise InputError("a point or a pixel is not a number; leave those rows out")
        if not np.all(s > 0.0):
            raise InputError("the sigma of a sighting must be above 0 px")
        return cls(p, m, s)

    def __len__(self) -> int:
        return len(self.points)


def _parts(camera: Camera) -> tuple[Any, Any, float, float, float]:
    """The camera as the kernels take it."""
    return camera.C_cb.ravel(), camera.l_b, float(camera.focal), float(camera.u0), float(camera.v0)


def rows(points_n: ArrayLike, r_n: ArrayLike, C_nb: ArrayLike, camera: Camera) -> tuple[Array, Mask, Array]:
    """Predicted pixels (n, 2), visible (n,), Jacobian (n, 2, 6) of a pose; NaN where a point is not visible."""
    from schuler.kernels import optics as kernel

    p = np.ascontiguousarray(points_n, dtype=np.float64)
    r, C = (np.ascontiguousarray(x, dtype=np.float64).ravel() for x in (r_n, C_nb))
    uv, seen, H = np.full((len(p), 2), np.nan), np.zeros(len(p), dtype=bool), np.full((len(p), 2, 6), np.nan)
    kernel.sighting_batch(C, p, r, *_parts(camera), uv, seen, H)
    return uv, seen, H


def p3p(points_n: ArrayLike, uv: ArrayLike, camera: Camera) -> list[tuple[Array, Array]]:
    """Every (r_n, C_nb) from which three points (3, 3) appear at pixels (3, 2): none to four of them."""
    from schuler.kernels import p3p as closed
    from schuler.kernels import pose as kernel

    p, m = np.ascontiguousarray(points_n, dtype=np.float64), np.asarray(uv, dtype=np.float64)
    if p.shape != (3, 3) or m.shape != (3, 2):
        raise InputError(f"three points (3, 3) and three pixels (3, 2) are needed; got {p.shape} and {m.shape}")
    centre = p.mean(axis=0)
    ways, one = np.empty((4, 12)), np.empty(kernel.POSE)
    found = []
    for k in range(closed.p3p(np.ascontiguousarray(camera.directions(m)), p - centre, ways)):
        kernel.body_pose(ways[k], camera.C_cb.ravel(), camera.l_b, one)
        r, C = one[9:12] + centre, one[:9].reshape(3, 3).copy()
        if camera.project(p, r, C)[1].all():
            found.append((r, C))
    return found


def pose(
    points_n: ArrayLike, uv: ArrayLike, camera: Camera, *, sigma: ArrayLike | None = None,
    start: tuple[ArrayLike, ArrayLike] | None = None, robust: bool = True, seed: int = 1, most: int = 1000,
) -> Pose:  # fmt: skip
    """The pose from n points (n, 3) m NED seen at uv (n, 2) px.

    sigma : px, one number, (n, 1) or (n, 2); absent: the camera's. start : (r_n, C_nb) known beforehand to within the
    picture, needed for n = 3. robust : wrong identities are found (by consensus without a start; with one by the gate)
    and left out; five points or more are needed to tell which one is wrong. Raises InputError where the points do not
    fix a pose, saying why.
    """
    from schuler.kernels import pose as kernel

    scene = Scene.of(points_n, uv, camera.sigma if sigma is None else sigma)
    n = len(scene)
    if n < 3:
        raise InputError(
            f"{n} sighting{'s' if n != 1 else ''} cannot give a pose: two numbers each against six unknowns; three "
            "leave up to four poses, four or more leave one (a filter with an INS uses every one of them)"
        )
    flat = breadth(scene.points)
    if flat < ON_A_LINE:
        raise InputError(
            f"the {n} points lie on a line (breadth over length {flat:.1e}): the turn about that line stays unknown; "
            "add a point off the line"
        )
    if n == 3 and start is None:
        return _of_three(scene, camera)
    centre = scene.points.mean(axis=0)
    X = np.ascontiguousarray(scene.points - centre)
    state, mask, N = np.zeros(kernel.POSE), np.ones(n, dtype=np.uint8), np.empty((6, 6))
    if start is not None:
        state[:9] = orthonormalise(np.asarray(start[1], dtype=np.float64)).ravel()
        state[9:12] = np.asarray(start[0], dtype=np.float64) - centre
    parts = _parts(camera)
    if start is not None and robust and n > 3:
        # a start off by more than the gate must not throw points out: first everything, with the residuals weighted
        _settle(state, X, scene, camera, mask)
    limit = GATE if robust and n > 4 else 1e30
    status, used = kernel.solve(
        X, scene.uv, scene.sigma, *parts, limit, SEARCH if limit < 1e30 else 1e30, most, seed, start is not None,
        state, mask, N,
    )  # fmt: skip
    if status == kernel.BEHIND and used < 3:
        raise InputError(
            f"no pose agrees with even three of the {n} sightings: identities, focal length or mounting are wrong"
        )
    if status == kernel.SINGULAR:
        raise InputError("the points do not fix a pose: they leave a direction of it unseen (points on a line, or one)")
    return _finished(state, N, scene, camera, mask.astype(bool), centre)


def breadth(points: Array) -> float:
    """Second over first extent of a set of points: 0 on a line, 1 for a round field."""
    s = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(s[1] / s[0]) if s[0] > 0.0 else 0.0


def _settle(state: Array, X: Array, scene: Scene, camera: Camera, mask: NDArray[np.uint8]) -> None:
    """From a rough start: weights 1/(1 + e/c), c the median of e, so that a few wrong points weigh little."""
    from schuler.kernels import pose as kernel

    N = np.empty((6, 6))
    everything = np.ones(len(X), dtype=np.uint8)
    for _ in range(4):
        uv, seen, _ = rows(X, state[9:12], state[:9].reshape(3, 3), camera)
        e = np.where(seen, np.sum(((uv - scene.uv) / scene.sigma) ** 2, axis=1), np.inf)
        c = max(float(np.median(e[seen])) if seen.any() else 1.0, 1.0)
        weighted = scene.sigma * np.sqrt(1.0 + np.where(seen, e, 1e6) / c)[:, None]
        kernel.refine(state, X, scene.uv, np.ascontiguousarray(weighted), everything, *_parts(camera), 10, N)
    kernel.score(state, X, scene.uv, scene.sigma, *_parts(camera), GATE, mask)
    if int(mask.sum()) < 3:
        mask[:] = 1


def _of_three(scene: Scene, camera: Camera) -> Pose:
    """Three points without a start: one pose if there is one only, else an error that names their number."""
    ways = p3p(scene.points, scene.uv, camera)
    if not ways:
        raise InputError("no pose shows the three points at these pixels: identities, focal length or mounting")
    made = [_at(r, C, scene, camera) for r, C in ways]
    if len(made) > 1:
        places = "; ".join(f"{p.r_n[0]:.1f}, {p.r_n[1]:.1f}, {p.r_n[2]:.1f}" for p in made)
        raise InputError(
            f"three points leave {len(made)} poses here (north, east, down m: {places}): give a fourth point, or a "
            "start to choose by; aiding.optics.p3p returns them all"
        )
    return made[0]


def _at(r: Array, C: Array, scene: Scene, camera: Camera) -> Pose:
    H = rows(scene.points, r, C, camera)[2].reshape(-1, 6)
    N = (H / scene.sigma.reshape(-1, 1)).T @ (H / scene.sigma.reshape(-1, 1))
    state = np.concatenate([C.ravel(), r, [0.0]])
    return _finished(state, N, scene, camera, np.ones(len(scene), dtype=bool), np.zeros(3))


def _finished(state: Array, N: Array, scene: Scene, camera: Camera, used: Mask, centre: Array) -> Pose:
    C, r = state[:9].reshape(3, 3).copy(), state[9:12] + centre
    uv, seen, H = rows(scene.points, r, C, camera)
    residuals = uv - scene.uv
    used = used & seen
    freedom = 2 * int(used.sum()) - 6
    e2 = np.sum((residuals[used] / scene.sigma[used]) ** 2)
    rms = math.sqrt(float(e2) / freedom) if freedom > 0 else math.nan
    size = np.sqrt(np.diag(N))
    covariance = np.full((6, 6), np.inf)
    if np.all(size > 0.0):
        scaled = N / np.outer(size, size)
        with np.errstate(all="ignore"):
            try:
                covariance = np.linalg.inv(scaled) / np.outer(size, size)
            except np.linalg.LinAlgError:
                pass
    distance = float(np.mean(np.linalg.norm(scene.points[used] - r, axis=1)))
    A = H[used].reshape(-1, 6) / camera.focal * np.array([distance] * 3 + [1.0] * 3)
    s = np.linalg.svd(A, compute_uv=False)
    condition = float(s[0] / s[-1]) if len(s) == 6 and s[-1] > 0.0 else math.inf
    critical = _why_critical(scene.points[used], r, condition)
    notes = []
    lost = int(len(used) - used.sum())
    if lost:
        notes.append(f"{lost} of {len(used)} sightings do not fit the others and are left out")
    if len(used) == 4:
        notes.append("four sightings: a wrong identity would show as a large residual, but not which one it is")
    return Pose(r, C, covariance, used, residuals, rms, condition, critical, (), tuple(notes))


def _why_critical(points: Array, r: Array, condition: float) -> str:
    """A sentence where small errors of sight become large ones of the pose."""
    if condition < WEAK:
        return ""
    where = f"the geometry is near-critical (condition {condition:.0f}): "
    if breadth(points) < 0.02:
        return where + "the points lie almost on a line"
    if len(points) == 3 and cylinder(points, r) < 0.05:
        return where + "the camera is on the cylinder through the three points, where two of the poses become one"
    if np.linalg.matrix_rank(points - points.mean(axis=0), tol=0.02 * float(np.ptp(points))) == 2:
        return where + "few points, or far away and close together; sightings spread wider help most"
    return where + "the points and the camera lie near a surface on which several poses fit; one point more helps"


def cylinder(points: ArrayLike, r: ArrayLike) -> float:
    """How far a camera at r (3,) is from the dangerous cylinder of three points (3, 3), over that cylinder's radius.

    The cylinder stands on the circle through the points, at right angles to their plane; on it two of the up to four
    poses fall together and the pose from three points is infinitely weak in one direction (Thompson 1966).
    """
    a, b, c = np.asarray(points, dtype=np.float64)
    n = np.cross(b - a, c - a)
    size2 = float(n @ n)
    if size2 == 0.0:
        return math.inf
    ab, ac = b - a, c - a
    centre = a + (np.cross(n, ab) * (ac @ ac) + np.cross(ac, n) * (ab @ ab)) / (2.0 * size2)
    radius = float(np.linalg.norm(centre - a))
    axis = n / math.sqrt(size2)
    d = np.asarray(r, dtype=np.float64) - centre
    return abs(float(np.linalg.norm(d - (d @ axis) * axis)) - radius) / radius


def covariance(points_n: ArrayLike, r_n: ArrayLike, C_nb: ArrayLike, camera: Camera) -> Array:
    """(6, 6) sigma^2 (H^T H)^-1 of the pose from these points; infinite where they do not fix it."""
    H = rows(points_n, r_n, C_nb, camera)[2].reshape(-1, 6)
    H = H[np.isfinite(H).all(axis=1)] / camera.sigma
    N = H.T @ H
    if len(H) < 6 or np.linalg.cond(H / np.linalg.norm(H, axis=0)) > HOPELESS:
        return np.full((6, 6), np.inf)
    return np.asarray(np.linalg.inv(N), dtype=np.float64)


def unseen(points_n: ArrayLike, r_n: ArrayLike, C_nb: ArrayLike, camera: Camera, *, tol: float = 1e-7) -> Array:
    """(k, 6) orthonormal directions of (dr/distance, phi) that the sightings do not see; none where a pose is fixed."""
    p = np.asarray(points_n, dtype=np.float64)
    H = rows(p, r_n, C_nb, camera)[2].reshape(-1, 6)
    H = H[np.isfinite(H).all(axis=1)]
    distance = float(np.mean(np.linalg.norm(p - np.asarray(r_n, dtype=np.float64), axis=1)))
    A = np.vstack([H * np.array([distance] * 3 + [1.0] * 3) / camera.focal, np.zeros((6, 6))])
    _, s, Vt = np.linalg.svd(A)
    return np.asarray(Vt[s < tol * max(float(s[0]), 1e-300)])


@dataclass(frozen=True)
class Fix:
    """A pose on the Earth: lat, lon rad, height m of the IMU; rpy (3,) rad; pose in NED at the fix itself."""

    lat: float
    lon: float
    height: float
    rpy: Array
    pose: Pose
    notes: list[str] = field(default_factory=list)

    @property
    def std(self) -> Array:
        """(6,) m NED and rad about NED."""
        return self.pose.std


def fix(
    lat: ArrayLike, lon: ArrayLike, height: ArrayLike, uv: ArrayLike, camera: Camera, *,
    sigma: ArrayLike | None = None, start: tuple[float, float, float, float, float, float] | None = None,
    robust: bool = True, earth: Ellipsoid = WGS84,
) -> Fix:  # fmt: skip
    """The pose from landmarks at lat, lon (rad), height (m), (n,) each, seen at uv (n, 2) px.

    start: lat, lon (rad), height (m), roll, pitch, heading (rad), where known beforehand. Exact on the ellipsoid.
    """
    p = earth.ecef_from_geodetic(lat, lon, height)
    lat0, lon0 = (float(np.mean(np.asarray(x, dtype=np.float64))) for x in (lat, lon))
    origin = earth.ecef_from_geodetic(lat0, lon0, 0.0)
    C0 = C_en(lat0, lon0)
    begin = None
    if start is not None:
        r = (earth.ecef_from_geodetic(*start[:3]) - origin) @ C0
        C = C0.T @ C_en(start[0], start[1]) @ dcm_from_euler(*start[3:])
        begin = (r, C)
    found = pose((p - origin) @ C0, uv, camera, sigma=sigma, start=begin, robust=robust)
    here = earth.geodetic_from_ecef(origin + C0 @ found.r_n)
    turn = C_en(float(here[0]), float(here[1])).T @ C0  # from n of the points to n at the fix
    both = np.kron(np.eye(2), turn)
    local = replace(
        found, r_n=np.zeros(3), C_nb=turn @ found.C_nb, covariance=both @ found.covariance @ both.T
    )  # fmt: skip
    return Fix(float(here[0]), float(here[1]), float(here[2]), local.rpy, local, list(local.notes))
