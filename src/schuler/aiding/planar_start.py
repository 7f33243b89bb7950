"""Where a planar vehicle starts and how it heads: from [start], else from the first fixes and ranges.

The odometry's own track is laid over the first measurements: place, heading, turn bias and scales by least squares with
a robust loss, from many first guesses, over a growing first stretch until one answer is left. The filter then starts at
that answer with wide sigmas, so that what was measured there counts once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import degrees, inf
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.planar_motion import Measurements, Track, line_of
from schuler.aiding.planar_settings import PlanarSettings, Plane
from schuler.ground.earth import wrap_pi
from schuler.ground.errors import InputError

Array = NDArray[np.float64]
STRETCHES_M = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0, inf)
SURE_RAD = 0.12  # the heading is found
HOPELESS_RAD = 0.6  # it is not
RIVAL = 9.0  # another answer whose cost is no more than this above the best one could be the truth
LOSSES: tuple[tuple[Literal["soft_l1", "cauchy"], float], ...] = (("soft_l1", 1.0), ("cauchy", 2.5))
OUTSIDE = 4.0  # sigmas
MOST = 120  # measurements that the fit looks at
DEFAULT_STD_M, DEFAULT_STD_RAD = 1.0, np.radians(2.0)


@dataclass
class Begin:
    """north, east m, heading rad in the plane at the first moment with sigmas; told: rows begin here.

    echoes : indices of measurements before `told` that the start shows to be wrong; a filter that begins with wide
    sigmas could not tell.
    """

    north: float
    east: float
    heading: float
    std_north: float
    std_east: float
    std_heading: float
    told: float
    notes: list[str] = field(default_factory=list)
    echoes: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def find(track: Track, m: Measurements, s: PlanarSettings, plane: Plane) -> Begin:
    """The start. InputError where neither [start] nor the measurements give one."""
    start = s.start
    placed = start.lat is not None and start.lon is not None
    north = east = 0.0
    if placed:
        n, e = plane.north_east(float(start.lat or 0.0), float(start.lon or 0.0))
        north, east = float(n), float(e)
    std_n, std_e = (DEFAULT_STD_M if v is None else v for v in start.std_pos[:2])
    std_h = DEFAULT_STD_RAD if start.std_heading is None else start.std_heading
    heading = None if start.heading is None else start.heading
    t0 = float(track.time[0])
    if placed and heading is not None:
        heading -= float(plane.convergence(start.lat, start.lon))  # type: ignore[arg-type]
        return Begin(north, east, heading, std_n, std_e, std_h, t0)
    if not np.isin(m.kind, (0, 1)).any():
        missing = [
            w for w, known in (("lat_deg and lon_deg", placed), ("heading_deg", heading is not None)) if not known
        ]
        raise InputError(
            f"no start was found: there are no fixes and no ranges; type {' and '.join(missing)} under [start] (in "
            "metres: north_m and east_m), or name a gnss table, or ranges and landmarks"
        )
    fit = _Fit(
        track, m, s, (north, east, std_n, std_e) if placed else None, (heading, std_h) if heading is not None else None
    )
    best, end, rivals = fit.grow()
    notes = []
    sigma = np.sqrt(np.maximum(np.diag(best.cov), 0.0))
    if sigma[2] > HOPELESS_RAD:
        seen = f"ranges to {len(m.place)} beacon{'s' * (len(m.place) != 1)}" if len(m.place) else "the fixes"
        raise InputError(
            f"no start was found: {seen} and {fit.length(end):.0f} m of odometry do not tell where the vehicle heads; "
            "type the place (lat_deg and lon_deg, in metres north_m and east_m) and heading_deg under [start]"
        )
    echoes = fit.contradicting(best, end)
    if len(echoes):
        many = "measurements contradict" if len(echoes) > 1 else "measurement contradicts"
        notes.append(f"start: {len(echoes)} {many} the others and {'were' if len(echoes) > 1 else 'was'} left out")
    with_ranges = bool((m.kind == 1).any())
    found = "heading" if placed else "place" if heading is not None else "place and heading"
    notes.append(
        f"start: {found} found from the first {end - t0:.0f} s ({fit.length(end):.0f} m): heading "
        f"{degrees(best.x[2] % (2 * np.pi)):.1f} +- {degrees(sigma[2]):.1f} deg; rows of the filter begin there"
    )
    if rivals:
        why = ""
        if with_ranges and not (m.kind == 0).any() and line_of(m.place):
            why = " (the beacons lie on one line, and ranges cannot tell a track from its mirror image)"
        notes.append(
            f"start: NOT CERTAIN{why}: another start fits the measurements as well, "
            f"{float(np.hypot(*(rivals[0].x[:2] - best.x[:2]))):.0f} m away with heading "
            f"{degrees(rivals[0].x[2] % (2 * np.pi)):.0f} deg; type [start] lat_deg, lon_deg (or north_m, east_m) and "
            "heading_deg"
        )
    wide = max(10.0 * float(max(sigma[0], sigma[1])), 5.0)
    return Begin(
        float(best.x[0]),
        float(best.x[1]),
        float(best.x[2]),
        std_n if placed else wide,
        std_e if placed else wide,
        std_h if heading is not None else max(5.0 * float(sigma[2]), 0.5),
        _ready(track, end),
        notes,
        echoes,
    )


def _ready(track: Track, end: float) -> float:
    """When the inputs of all pieces up to `end` are known."""
    i = min(int(np.searchsorted(track.time, end)), len(track.time) - 1)
    return float(max(end, track.need_speed[i], track.need_turn[i]))


@dataclass
class _Answer:
    x: Array  # north, east, heading, turn bias, log odometer scale, log range scale
    cost: float
    cov: Array


class _Fit:
    """The odometry's track over the first measurements."""

    def __init__(
        self,
        track: Track,
        m: Measurements,
        s: PlanarSettings,
        place: tuple[float, float, float, float] | None,
        heading: tuple[float, float] | None,
    ) -> None:
        self.time, self.dt = track.time, track.pieces[:, 0]
        speed, turn = track.pieces[:, 1].copy(), track.pieces[:, 4]
        known = np.isfinite(speed)
        last = np.maximum.accumulate(np.where(known, np.arange(len(speed)), 0))
        self.step = np.nan_to_num(speed[last]) * self.dt
        self.knows = np.isfinite(turn)
        self.turn = np.nan_to_num(turn)
        self.travelled = np.cumsum(np.abs(self.step))
        self.m, self.s, self.place, self.heading = m, s, place, heading
        self.usable = np.flatnonzero(np.isin(m.kind, (0, 1)) & (m.time >= self.time[0]) & (m.time <= self.time[-1]))

    def length(self, end: float) -> float:
        return float(self.travelled[min(int(np.searchsorted(self.time, end)), len(self.time) - 1)])

    def grow(self) -> tuple[_Answer, float, list[_Answer]]:
        """Best answer, the end of the stretch it needed, and rivals that are left."""
        tried = -1
        best: _Answer | None = None
        rivals: list[_Answer] = []
        end = float(self.time[-1])
        for stretch in STRETCHES_M:
            i = min(int(np.searchsorted(self.travelled, stretch)), len(self.time) - 1)
            end = float(self.time[i])
            rows = self.usable[self.m.time[self.usable] <= end]
            facts = int(np.sum(np.where(self.m.kind[rows] == 0, 2, 1)))
            if (facts < 8 and i < len(self.time) - 1) or i == tried:
                continue
            tried = i
            if not len(rows):
                continue
            if len(rows) > MOST:
                rows = rows[np.unique(np.linspace(0, len(rows) - 1, MOST).astype(int))]
            best, rivals = self.solve(rows, i)
            sure = np.sqrt(best.cov[2, 2]) < SURE_RAD
            if sure and not rivals:
                break
            if i == len(self.time) - 1:
                break
        if best is None:
            raise InputError(
                "no start was found: no fix or range lies inside the odometry's time; put the tables on one clock, or "
                "type the place and heading_deg under [start]"
            )
        return best, end, rivals

    def contradicting(self, best: _Answer, end: float) -> NDArray[np.int64]:
        """Measurements up to `end` that lie further from the best answer than the scatter of the others lets them."""
        rows = self.usable[self.m.time[self.usable] <= end]
        last = min(int(np.searchsorted(self.time, end)), len(self.time) - 1)
        at = np.searchsorted(self.time, self.m.time[rows], side="left")
        forward, right = self.path(best.x[3], best.x[4], last)
        co, si = np.cos(best.x[2]), np.sin(best.x[2])
        north = best.x[0] + co * forward[at] - si * right[at]
        east = best.x[1] + si * forward[at] + co * right[at]
        miss = np.abs(self._misses(north, east, best.x[5], rows))
        fixes = self.m.kind[rows] == 0
        k = int(fixes.sum())
        limit = OUTSIDE * max(1.4826 * float(np.median(miss)), 1.0)
        wrong = np.zeros(len(rows), dtype=bool)
        wrong[fixes] = np.maximum(miss[:k], miss[k : 2 * k]) > limit
        wrong[~fixes] = miss[2 * k :] > limit
        return np.asarray(rows[wrong], dtype=np.int64)

    def solve(self, rows: NDArray[np.int64], last: int) -> tuple[_Answer, list[_Answer]]:
        """Answers over the pieces up to `last`, the best first."""
        from scipy.optimize import least_squares

        at = np.searchsorted(self.time, self.m.time[rows], side="left")
        first = self._guesses(rows, at, last)
        answers: list[_Answer] = []
        for x0 in first:
            # a loss that finds the way from afar, then one that forgets echoes altogether
            for loss, width in LOSSES:
                got = least_squares(
                    self.residuals, x0, args=(rows, at, last), loss=loss, f_scale=width, method="trf", max_nfev=40,
                    x_scale=[1.0, 1.0, 0.1, 0.01, 0.02, 0.05],
                )  # fmt: skip
                x0 = got.x
            J = np.asarray(got.jac, dtype=np.float64)
            scale = np.maximum(np.linalg.norm(J, axis=0), 1e-9)
            # what the measurements do not tell at all stays as wide as this
            cov = np.linalg.inv((J / scale).T @ (J / scale) + 1e-9 * np.eye(6)) / np.outer(scale, scale)
            answers.append(_Answer(got.x, 2.0 * float(got.cost), cov))
        answers.sort(key=lambda a: a.cost)
        best = answers[0]
        # in units of the scatter that is there, so that ranges worse than thought do not make every answer a rival
        spread = max(best.cost / max(len(rows) - 3, 1), 1.0)
        rivals = [a for a in answers[1:] if a.cost - best.cost < RIVAL * spread and self._other(a, best)]
        return best, rivals

    def _other(self, a: _Answer, b: _Answer) -> bool:
        turned = abs(float(wrap_pi(a.x[2] - b.x[2])))
        sigma = float(np.sqrt(max(b.cov[0, 0], b.cov[1, 1])))
        return turned > 0.35 or float(np.hypot(*(a.x[:2] - b.x[:2]))) > max(6.0 * sigma, 3.0)

    def path(self, bias: float, scale: float, last: int) -> tuple[Array, Array]:
        """Forward and right metres of the ends of pieces 0 .. last, the first heading ahead."""
        turn = (self.turn[: last + 1] - bias * self.knows[: last + 1]) * self.dt[: last + 1]
        heading = np.cumsum(turn) - 0.5 * turn
        step = self.step[: last + 1] * np.exp(-scale)
        return np.cumsum(step * np.cos(heading)), np.cumsum(step * np.sin(heading))

    def residuals(self, x: Array, rows: NDArray[np.int64], at: NDArray[np.int64], last: int) -> Array:
        """Measured minus predicted over sigma, then what is known before."""
        forward, right = self.path(x[3], x[4], last)
        co, si = np.cos(x[2]), np.sin(x[2])
        north = x[0] + co * forward[at] - si * right[at]
        east = x[1] + si * forward[at] + co * right[at]
        parts = [self._misses(north, east, x[5], rows)]
        s = self.s
        parts.append(
            np.array([x[3], x[4], x[5]]) / np.maximum([s.gyro_bias_std, s.speed_scale_std, s.range_scale_std], 1e-9)
        )
        if self.place is not None:
            parts.append(np.array([(x[0] - self.place[0]) / self.place[2], (x[1] - self.place[1]) / self.place[3]]))
        if self.heading is not None:
            parts.append(np.array([float(wrap_pi(x[2] - self.heading[0])) / self.heading[1]]))
        return np.concatenate(parts)

    def _misses(self, north: Array, east: Array, scale: float | Array, rows: NDArray[np.int64]) -> Array:
        """(..., facts) residuals over sigma of positions (..., rows)."""
        z, kind = self.m.z[rows], self.m.kind[rows]
        fix, ran = kind == 0, kind == 1
        sn, se = np.hypot(z[fix, 2], z[fix, 4]), np.hypot(z[fix, 3], z[fix, 5])
        d = np.sqrt((north[..., ran] - z[ran, 3]) ** 2 + (east[..., ran] - z[ran, 4]) ** 2 + z[ran, 5] ** 2)
        sr = np.sqrt(z[ran, 1] + self.s.range_bias_std**2)
        return np.concatenate(
            [
                (z[fix, 0] - north[..., fix]) / sn,
                (z[fix, 1] - east[..., fix]) / se,
                (z[ran, 0] - np.exp(scale) * d) / sr,
            ],
            axis=-1,
        )

    def _guesses(self, rows: NDArray[np.int64], at: NDArray[np.int64], last: int) -> list[Array]:
        """First guesses: headings all round, places near the first fix or all around the beacons, the best dozen."""
        forward, right = self.path(0.0, 0.0, last)
        f, r = forward[at], right[at]
        headings = np.array([self.heading[0]]) if self.heading is not None else np.radians(np.arange(0.0, 360.0, 15.0))
        z, kind = self.m.z[rows], self.m.kind[rows]
        found = []
        for h in headings:
            dn, de = np.cos(h) * f - np.sin(h) * r, np.sin(h) * f + np.cos(h) * r
            fix = kind == 0
            if self.place is not None:
                places = np.array([[self.place[0], self.place[1]]])
            elif fix.any():
                places = np.array([[np.median(z[fix, 0] - dn[fix]), np.median(z[fix, 1] - de[fix])]])
            else:
                reach = float(np.max(z[:, 0]))
                lo, hi = z[:, 3:5].min(axis=0) - reach, z[:, 3:5].max(axis=0) + reach
                grid = [np.linspace(lo[k], hi[k], 25) for k in (0, 1)]
                places = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 2)
            miss = self._misses(places[:, :1] + dn, places[:, 1:] + de, 0.0, rows)
            # soft_l1, with sigmas as wide as the grid is coarse
            coarse = 1.0 if len(places) == 1 else 5.0
            cost = np.sum(np.sqrt(1.0 + (miss / coarse) ** 2) - 1.0, axis=1)
            for k in np.argsort(cost)[:6]:
                found.append((float(cost[k]), np.array([places[k, 0], places[k, 1], h, 0.0, 0.0, 0.0])))
        found.sort(key=lambda entry: entry[0])
        kept: list[Array] = []
        for _, x in found:
            far = 0.05 * float(np.max(z[:, 0])) if not (kind == 0).any() else 0.0
            if all(abs(float(wrap_pi(x[2] - k[2]))) > 0.2 or np.hypot(*(x[:2] - k[:2])) > max(far, 1e-6) for k in kept):
                kept.append(x)
            if len(kept) >= 12:
                break
        return kept
