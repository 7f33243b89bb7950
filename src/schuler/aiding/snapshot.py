"""Position fixes from pseudoranges, epoch by epoch: robust least squares made for streets.

Unknown in each epoch: the antenna's place, the receiver's clock, and an offset of the clock of every further satellite
system. What was learnt in earlier epochs (never in later ones) holds the slow ones: the offsets between systems and the
height of the street. The clock is not held: it is the one unknown that an echo on all sides could lead away for good.

Satellite positions are those at the time of transmission in axes that turn with the Earth; while the signal travels the
Earth turns on, which is up to 40 m of the way, nearly all of it east-west. It is taken into account unless
`turned=True` says that the positions are corrected already.

In a street the echo of a hidden satellite arrives late, so a residual that is too long is believed less than one that
is too short: beyond `late` (too long) or `early` sigmas a pseudorange's weight falls with the square of its residual.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import WGS84, LocalFrame

Array = NDArray[np.float64]
LIGHT = 299792458.0
EARTH_RATE = 7.292115e-5
# Share of the spare weight below which memory is doubted, how much better the present must do without it, for how long.
DOUBT, BETTER, PATIENCE = 0.2, 1.5, 10


@dataclass(frozen=True)
class SnapshotSettings:
    """Sigmas in m. A pseudorange has sigma^2 = floor^2 + echo^2 10^((45 - cn0)/10): weak signals are echoes."""

    floor: float = 5.0
    echo: float = 5.0
    usual_cn0: float = 35.0  # dBHz, where a file does not say
    least_cn0: float = 20.0
    least_elevation: float = np.radians(5.0)
    late: float = 0.5  # sigmas
    early: float = 1.5
    offset_std: float = 2.0  # of an offset between systems, from its median over earlier epochs
    height_std: float = 3.0  # of the height, likewise
    memory_s: float = 100.0
    turned: bool = False


@dataclass
class Fix:
    """time s; lat, lon rad; height m; cov (3, 3) NED m^2; used and seen pseudoranges; spread of residuals."""

    time: float
    lat: float
    lon: float
    height: float
    cov: Array
    used: int
    seen: int
    spread: float


@dataclass
class SnapshotFixes:
    """Makes fixes of epochs in order of time; remembers what it learnt."""

    settings: SnapshotSettings = field(default_factory=SnapshotSettings)
    _frame: LocalFrame | None = None
    _last: Array | None = None
    _offsets: dict[int, deque[tuple[float, float]]] = field(default_factory=dict)
    _height: deque[tuple[float, float]] = field(default_factory=deque)
    _first: int | None = None  # the system that carries the clock
    _doubted: int = 0

    def epoch(
        self,
        time: float,
        pseudorange: ArrayLike,
        satellites: ArrayLike,
        system: ArrayLike,
        cn0: ArrayLike | None = None,
        std: ArrayLike | None = None,
    ) -> Fix | None:
        """A fix, or None where too few pseudoranges are left.

        pseudorange (m,) m, satellite clock and atmosphere taken out; satellites (m, 3) ECEF m; system (m,) whole
        numbers; cn0 (m,) dBHz; std (m,) m as the receiver says it, used where there is no cn0.
        """
        s = self.settings
        rho = np.asarray(pseudorange, dtype=np.float64)
        sat = np.asarray(satellites, dtype=np.float64).reshape(-1, 3)
        kind = np.asarray(system).astype(int)
        density = np.full(len(rho), s.usual_cn0) if cn0 is None else np.asarray(cn0, dtype=np.float64)
        density = np.where(np.isfinite(density), density, s.usual_cn0)
        sigma = np.sqrt(s.floor**2 + s.echo**2 * 10.0 ** ((45.0 - density) / 10.0))
        if cn0 is None and std is not None:
            sigma = np.hypot(s.floor, np.asarray(std, dtype=np.float64))
        good = np.isfinite(rho) & np.isfinite(sat).all(axis=1) & np.isfinite(sigma) & (density >= s.least_cn0)
        seen = len(rho)
        if int(good.sum()) < 4:
            return None
        rho, sat, kind, sigma = rho[good], sat[good], kind[good], sigma[good]
        if self._frame is None:
            start = _rough(rho, sat if s.turned else _turned(sat), kind)
            if start is None:
                return None
            lat, lon, height = (float(v) for v in WGS84.geodetic_from_ecef(start))
            self._frame = LocalFrame(lat, lon, height)
        frame = self._frame
        if not s.turned:
            sat = _turned(sat, WGS84.ecef_from_geodetic(frame.lat0, frame.lon0, frame.h0))
        local = np.column_stack(frame.ned(*WGS84.geodetic_from_ecef(sat)))
        at = np.zeros(3) if self._last is None else self._last[:3]
        up = at[2] - local[:, 2]
        good = np.arcsin(np.clip(up / np.linalg.norm(local - at, axis=1), -1.0, 1.0)) >= s.least_elevation
        systems = sorted(set(kind[good].tolist()))
        if int(good.sum()) < 4 or not systems:
            return None
        rho, local, kind, sigma = rho[good], local[good], kind[good], sigma[good]
        main = self._main(kind)
        others = [k for k in systems if k != main]
        size = 4 + len(others)
        known = self._known(time, others, main)
        if len(rho) + len(known) < size:
            return None
        columns = np.zeros((len(rho), size - 3))
        columns[:, 0] = 1.0
        for j, k in enumerate(others):
            columns[:, 1 + j] = kind == k
        starts = self._starts(rho, local, columns, sigma)
        best = self._best(starts, rho, local, columns, sigma, known)
        doubt = False
        spare = len(rho) - (size - len(known))  # so many would agree with any answer, and are not counted
        if known and (best is None or float(np.sum(best[2])) - len(rho) + spare < DOUBT * spare):
            # Few pseudoranges agree with what was learnt: if that lasts it is wrong, and would never heal itself.
            free = self._best(starts, rho, local, columns, sigma, []) if len(rho) >= size else None
            doubt = free is not None and (best is None or float(np.sum(free[2])) > BETTER * float(np.sum(best[2])))
        self._doubted = self._doubted + 1 if doubt else 0
        if self._doubted >= PATIENCE:
            best = free
            self._forget()
        if best is None:
            return None
        x, _, weight, cov, ratio = best
        self._learn(time, x, others, main)
        lat_, lon_, height_ = frame.geodetic(x[0], x[1], x[2])
        return Fix(time, float(lat_), float(lon_), float(height_), cov, int((weight > 0.25).sum()), seen, ratio)

    def _best(
        self,
        starts: list[Array],
        rho: Array,
        local: Array,
        columns: Array,
        sigma: Array,
        known: list[tuple[int, float, float]],
    ) -> tuple[Array, float, Array, Array, float] | None:
        """The answer of least cost over several first guesses."""
        found = [self._solve(x0, rho, local, columns, sigma, known) for x0 in starts]
        answers = [f for f in found if f is not None]
        return min(answers, key=lambda f: f[1]) if answers else None

    def _forget(self) -> None:
        self._height.clear()
        self._offsets.clear()
        self._doubted = 0

    def _main(self, kind: NDArray[np.int64]) -> int:
        """The system that carries the clock: the first epoch's commonest, where it is seen."""
        values, counts = np.unique(kind, return_counts=True)
        if self._first is None:
            self._first = int(values[np.argmax(counts)])
        return self._first if self._first in values else int(values[np.argmax(counts)])

    def _known(self, time: float, others: list[int], main: int) -> list[tuple[int, float, float]]:
        """(unknown, value, sigma) of what earlier epochs say."""
        s = self.settings
        known = []
        for j, k in enumerate(others if main == self._first else ()):
            past = self._recent(self._offsets.get(k), time, s.memory_s)
            if len(past) >= 20:
                known.append((4 + j, float(np.median(past[:, 1])), s.offset_std))
        past = self._recent(self._height, time, s.memory_s)
        if len(past) >= 50:
            known.append((2, float(np.median(past[:, 1])), s.height_std))
        return known

    @staticmethod
    def _recent(past: deque[tuple[float, float]] | None, time: float, memory: float) -> Array:
        if not past:
            return np.zeros((0, 2))
        rows = np.array(past)
        return np.asarray(rows[rows[:, 0] >= time - memory])

    def _learn(self, time: float, x: Array, others: list[int], main: int) -> None:
        self._last = x
        memory = self.settings.memory_s
        self._height.append((time, float(x[2])))
        for j, k in enumerate(others if main == self._first else ()):  # offsets are against the first system
            self._offsets.setdefault(k, deque()).append((time, float(x[4 + j])))
        for past in (self._height, *self._offsets.values()):
            while past and past[0][0] < time - memory:
                past.popleft()

    def _starts(self, rho: Array, local: Array, columns: Array, sigma: Array) -> list[Array]:
        """First guesses of the place: the last one, plain least squares, and that of the strongest satellites."""
        last = np.zeros(3) if self._last is None else self._last[:3]
        starts = [last]
        strongest = np.argsort(sigma, kind="stable")[: max(columns.shape[1] + 5, 7)]
        for rows in (np.arange(len(rho)), strongest):
            x = _plain(last, rho[rows], local[rows], columns[rows], sigma[rows])
            if x is not None:
                starts.append(x)
        return starts

    def _solve(
        self,
        start: Array,
        rho: Array,
        local: Array,
        columns: Array,
        sigma: Array,
        known: list[tuple[int, float, float]],
    ) -> tuple[Array, float, Array, Array, float] | None:
        """Iteratively reweighted least squares: unknowns, cost, weights, covariance NED, spread of the residuals."""
        s = self.settings
        size = 3 + columns.shape[1]
        first = np.linalg.norm(local - start, axis=1)
        x = np.zeros(size)
        x[:3] = start
        clock = rho - first
        x[3] = (
            float(np.median(clock[columns[:, 1:].sum(axis=1) == 0]))
            if columns.shape[1] > 1
            else float(np.median(clock))
        )
        for j in range(1, columns.shape[1]):
            x[3 + j] = float(np.median(clock[columns[:, j] > 0.0])) - x[3]
        P = np.zeros((len(known), size))
        for r, (i, _, sd) in enumerate(known):
            P[r, i] = 1.0 / sd
        weight = np.ones(len(rho))
        A = np.zeros((0, size))
        for turn in range(40):
            away = x[:3] - local
            d = np.linalg.norm(away, axis=1)
            u = (rho - d - columns @ x[3:]) / sigma
            if turn:
                limit = np.where(u > 0.0, s.late, s.early)
                weight = np.where(np.abs(u) <= limit, 1.0, (limit / np.maximum(np.abs(u), 1e-12)) ** 2)
            w = np.sqrt(weight)
            A = np.vstack([np.hstack([away / d[:, None], columns]) * (w / sigma)[:, None], P])
            y = np.concatenate([u * w, [(v - x[i]) / sd for i, v, sd in known]])
            step = np.linalg.lstsq(A, y, rcond=None)[0]
            x = x + step
            if turn > 2 and float(np.abs(step[:3]).max()) < 1e-3:
                break
        if not np.isfinite(x).all():
            return None
        limit = np.where(u > 0.0, s.late, s.early)
        size_u = np.abs(u)
        rho_cost = np.where(size_u <= limit, 0.5 * u**2, limit**2 * (0.5 + np.log(np.maximum(size_u, limit) / limit)))
        cost = float(rho_cost.sum()) + 0.5 * float(np.sum(y[len(rho) :] ** 2))
        N = A.T @ A
        if np.linalg.cond(N) > 1e14:
            return None
        # as much larger as the residuals that still count are larger than their sigmas, and as less weight is left
        spread = float(np.sum(weight * u**2) / max(float(np.sum(weight)) - (size - len(known)), 1.0))
        cov = np.linalg.inv(N)[:3, :3] * max(spread, 1.0) * len(u) / float(np.sum(weight))
        return x, cost, weight, cov, spread


def _turned(sat: Array, place: Array | None = None) -> Array:
    """Satellite positions in the Earth's axes at reception: turned by what the Earth turns while the signal travels.

    place (3,) ECEF of the receiver within some 10 km; None: below the satellites, good to a few metres of the answer.
    """
    way = np.linalg.norm(sat - (_below(sat) if place is None else place), axis=1)
    angle = EARTH_RATE * way / LIGHT
    co, si = np.cos(angle), np.sin(angle)
    return np.column_stack([sat[:, 0] * co + sat[:, 1] * si, -sat[:, 0] * si + sat[:, 1] * co, sat[:, 2]])


def _below(sat: Array) -> Array:
    """A place on the Earth under the middle of the satellites (m, 3)."""
    mean = sat.mean(axis=0)
    return np.asarray(6.371e6 * mean / np.linalg.norm(mean))


def _rough(rho: Array, sat: Array, kind: NDArray[np.int64]) -> Array | None:
    """ECEF place by plain least squares with the clock of the commonest system only."""
    if not len(rho):
        return None
    values, counts = np.unique(kind, return_counts=True)
    rows = kind == values[np.argmax(counts)]
    rho, sat = rho[rows], sat[rows]
    if len(rho) < 4:
        return None
    x = _plain(_below(sat), rho, sat, np.ones((len(rho), 1)), np.ones(len(rho)))
    if x is None or not 6.3e6 < float(np.linalg.norm(x)) < 6.5e6:
        return None
    return x


def _plain(start: Array, rho: Array, sat: Array, columns: Array, sigma: Array) -> Array | None:
    """Place (3,) by Gauss-Newton without weights for outliers."""
    size = 3 + columns.shape[1]
    if len(rho) < size or np.linalg.matrix_rank(columns) < columns.shape[1]:
        return None
    x = np.zeros(size)
    x[:3] = start
    step = np.full(size, inf)
    for _ in range(15):
        away = x[:3] - sat
        d = np.linalg.norm(away, axis=1)
        u = (rho - d - columns @ x[3:]) / sigma
        step = np.linalg.lstsq(np.hstack([away / d[:, None], columns]) / sigma[:, None], u, rcond=None)[0]
        x = x + step
        if float(np.abs(step[:3]).max()) < 1e-3:
            break
    return x[:3] if np.isfinite(x).all() and float(np.abs(step[:3]).max()) < 1e4 else None
