"""Pose of a camera from known points, compiled: least squares, and consensus where some points may be wrong.

Frames and signs as in `kernels.optics`. A pose is (13,): C_nb row by row, position r_b of the IMU in n (m), cost.
Consensus: Fischler and Bolles (1981), with the truncated cost of Torr and Zisserman (2000).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .optics import project, sighting_rows
from .p3p import p3p
from .rotation import dcm_from_quat, quat_from_rotvec

POSE = 13
OK = 0
SINGULAR = 1  # the normal equations have no solution: the points do not fix a pose
BEHIND = 2  # fewer than three points lie in front of the camera


@njit(cache=True, error_model="numpy")
def body_pose(camera_pose, C_cb, l_b, pose):
    """Pose (13,) of the IMU from one of the camera, (12,): C_cn and the camera's place."""
    for i in range(3):
        for j in range(3):  # C_nb = C_cn^T C_cb
            pose[3 * i + j] = (
                camera_pose[i] * C_cb[j] + camera_pose[3 + i] * C_cb[3 + j] + camera_pose[6 + i] * C_cb[6 + j]
            )
    for i in range(3):
        arm = pose[3 * i] * l_b[0] + pose[3 * i + 1] * l_b[1] + pose[3 * i + 2] * l_b[2]
        pose[9 + i] = camera_pose[9 + i] - arm
    pose[12] = 0.0


@njit(cache=True, error_model="numpy")
def score(pose, X, uv, sigma, C_cb, l_b, f, u0, v0, limit, mask):
    """Truncated cost: squared residuals in sigmas, each point's at most `limit`. mask (n,) gets 1 where it is less."""
    total, inside = 0.0, 0
    for k in range(X.shape[0]):
        u, v, visible = project(
            pose, X[k, 0] - pose[9], X[k, 1] - pose[10], X[k, 2] - pose[11], C_cb, l_b, f, u0, v0
        )  # fmt: skip
        cost = limit
        mask[k] = 0
        if visible:
            du, dv = (u - uv[k, 0]) / sigma[k, 0], (v - uv[k, 1]) / sigma[k, 1]
            e = du * du + dv * dv
            if e < limit:
                cost = e
                mask[k] = 1
                inside += 1
        total += cost
    return total, inside


@njit(cache=True, error_model="numpy")
def _normal(pose, X, uv, sigma, mask, C_cb, l_b, f, u0, v0, H, N, g):
    """Normal matrix N (6, 6), gradient g (6,) and cost of the points that mask keeps; how many are visible."""
    for i in range(6):
        g[i] = 0.0
        for j in range(6):
            N[i, j] = 0.0
    cost, seen = 0.0, 0
    for k in range(X.shape[0]):
        if mask[k] == 0:
            continue
        u, v, visible = sighting_rows(
            pose, X[k, 0] - pose[9], X[k, 1] - pose[10], X[k, 2] - pose[11], C_cb, l_b, f, u0, v0, H
        )  # fmt: skip
        if not visible:
            continue
        seen += 1
        wu, wv = 1.0 / sigma[k, 0], 1.0 / sigma[k, 1]
        eu, ev = wu * (u - uv[k, 0]), wv * (v - uv[k, 1])
        cost += eu * eu + ev * ev
        wu2, wv2 = wu * wu, wv * wv
        for i in range(6):
            a, b = wu2 * H[0, i], wv2 * H[1, i]
            g[i] += a * (u - uv[k, 0]) + b * (v - uv[k, 1])
            for j in range(i + 1):
                N[i, j] += a * H[0, j] + b * H[1, j]
    for i in range(6):
        for j in range(i):
            N[j, i] = N[i, j]
    return cost, seen


@njit(cache=True, error_model="numpy")
def cholesky_solve(N, g, damping, x):
    """x (6,) = (N + damping diag N)^-1 g; False where it is not positive definite."""
    L = np.empty((6, 6))
    for i in range(6):
        for j in range(i + 1):
            s = N[i, j]
            if i == j:
                s *= 1.0 + damping
            for k in range(j):
                s -= L[i, k] * L[j, k]
            if i == j:
                if not s > 1e-13 * N[i, i]:
                    return False
                L[i, i] = math.sqrt(s)
            else:
                L[i, j] = s / L[j, j]
    for i in range(6):
        s = g[i]
        for k in range(i):
            s -= L[i, k] * x[k]
        x[i] = s / L[i, i]
    for i in range(5, -1, -1):
        s = x[i]
        for k in range(i + 1, 6):
            s -= L[k, i] * x[k]
        x[i] = s / L[i, i]
    return True


@njit(cache=True, error_model="numpy")
def refine(pose, X, uv, sigma, mask, C_cb, l_b, f, u0, v0, rounds, N):
    """Least squares from a start: pose (13,) is changed in place, its last element is the cost; N (6, 6) becomes the
    normal matrix at the end, in (m, rad). Returns the status and how many rounds it took. Gauss-Newton, damped where a
    step does not lower the cost."""
    H, g, x, trial, N2, g2 = (
        np.empty((2, 6)), np.empty(6), np.zeros(6), np.empty(POSE), np.empty((6, 6)), np.empty(6),
    )  # fmt: skip
    wanted = 0
    for k in range(X.shape[0]):
        wanted += mask[k]
    cost, seen = _normal(pose, X, uv, sigma, mask, C_cb, l_b, f, u0, v0, H, N, g)
    if seen < 3:
        return BEHIND, 0
    damping = 0.0
    done = 0
    for turn in range(rounds):
        done = turn + 1
        if not cholesky_solve(N, g, damping, x):
            if damping > 1e6:
                pose[12] = cost
                return SINGULAR, done
            damping = max(10.0 * damping, 1e-9)
            continue
        # what is estimated is the error: taken off
        d0, d1, d2, d3 = quat_from_rotvec(x[3], x[4], x[5])
        e = dcm_from_quat(d0, d1, d2, d3)
        for i in range(3):
            for j in range(3):
                trial[3 * i + j] = e[3 * i] * pose[j] + e[3 * i + 1] * pose[3 + j] + e[3 * i + 2] * pose[6 + j]
            trial[9 + i] = pose[9 + i] - x[i]
        new, visible = _normal(trial, X, uv, sigma, mask, C_cb, l_b, f, u0, v0, H, N2, g2)
        if visible >= seen and new <= cost * (1.0 + 1e-12):
            gain = cost - new
            for i in range(12):
                pose[i] = trial[i]
            for i in range(6):
                g[i] = g2[i]
                for j in range(6):
                    N[i, j] = N2[i, j]
            cost, seen = new, visible
            damping *= 0.1
            if damping < 1e-9:
                damping = 0.0
            if gain <= 1e-10 * cost + 1e-20:
                break
        else:
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e9:
                break
    pose[12] = cost
    return (OK if seen >= wanted else BEHIND), done


@njit(cache=True, error_model="numpy")
def directions(uv, f, u0, v0, y):
    """Unit directions (n, 3) in camera axes of pixels (n, 2): ((u - u0)/f, (v - v0)/f, -1), normalised."""
    for k in range(uv.shape[0]):
        a, b = (uv[k, 0] - u0) / f, (uv[k, 1] - v0) / f
        s = 1.0 / math.sqrt(1.0 + a * a + b * b)
        y[k, 0], y[k, 1], y[k, 2] = a * s, b * s, -s


@njit(cache=True, error_model="numpy")
def consensus(X, uv, sigma, C_cb, l_b, f, u0, v0, limit, most, seed, best, mask):
    """The pose on which most points agree: best (13,) and mask (n,). Returns the number agreeing, and the trials made.

    Triples are drawn by a generator of its own (the same every time); the search ends when it is 99.99 % sure that a
    triple without a wrong point has been among them, after `most` trials, and not before four.
    """
    n = X.shape[0]
    y, three, ways = np.empty((n, 3)), np.empty((3, 3)), np.empty((4, 12))
    looks = np.empty((3, 3))
    pose, trial_mask = np.empty(POSE), np.empty(n, dtype=np.uint8)
    directions(uv, f, u0, v0, y)
    best_cost, best_inside = math.inf, 0
    state = np.uint64(seed) * np.uint64(2862933555777941757) + np.uint64(3037000493)
    needed, trial = most, 0
    while trial < needed:
        trial += 1
        i = j = k = 0
        while i == j or j == k or i == k:
            for which in range(3):
                state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
                pick = np.int64((state >> np.uint64(33)) % np.uint64(n))
                if which == 0:
                    i = pick
                elif which == 1:
                    j = pick
                else:
                    k = pick
        for c in range(3):
            three[0, c], three[1, c], three[2, c] = X[i, c], X[j, c], X[k, c]
            looks[0, c], looks[1, c], looks[2, c] = y[i, c], y[j, c], y[k, c]
        for way in range(p3p(looks, three, ways)):
            body_pose(ways[way], C_cb, l_b, pose)
            cost, inside = score(pose, X, uv, sigma, C_cb, l_b, f, u0, v0, limit, trial_mask)
            if cost < best_cost:
                best_cost, best_inside = cost, inside
                for m in range(POSE):
                    best[m] = pose[m]
                for m in range(n):
                    mask[m] = trial_mask[m]
        if best_inside > 0:
            share = best_inside / n
            miss = 1.0 - share * share * share
            if miss <= 0.0:
                needed = min(most, 4)
            else:
                needed = min(most, max(4, int(math.log(1e-4) / math.log(miss)) + 1))
    return best_inside, trial


@njit(cache=True, error_model="numpy")
def solve(X, uv, sigma, C_cb, l_b, f, u0, v0, limit, wide, most, seed, started, pose, mask, N):
    """Pose from points of which some may be wrong: consensus (unless `started`), least squares, points chosen anew.

    limit: squared residual in sigmas up to which a point is used at the end; wide: the same while searching, where a
    pose from three noisy points is judged. mask (n,): on return the points used. Returns status and their number.
    """
    n = X.shape[0]
    if not started:
        inside, _ = consensus(X, uv, sigma, C_cb, l_b, f, u0, v0, wide, most, seed, pose, mask)
        if inside < 3:
            return BEHIND, inside
    status, _ = refine(pose, X, uv, sigma, mask, C_cb, l_b, f, u0, v0, 20, N)
    if status == SINGULAR:
        return status, 0
    previous = 0
    for k in range(n):
        previous += mask[k]
    again = np.empty(n, dtype=np.uint8)
    for _ in range(5):
        _, inside = score(pose, X, uv, sigma, C_cb, l_b, f, u0, v0, limit, again)
        if inside < 3:
            break
        same = True
        for k in range(n):
            if again[k] != mask[k]:
                same = False
                mask[k] = again[k]
        if same:
            break
        status, _ = refine(pose, X, uv, sigma, mask, C_cb, l_b, f, u0, v0, 20, N)
        previous = inside
    return status, previous
