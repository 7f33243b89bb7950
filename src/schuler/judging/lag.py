"""Is the reference on the solution's clock? A time lag between two tracks, found from the tracks themselves.

Sign, as of every delay here: a reference row stamped t belongs to t - delay. A positive delay is a reference that is
late.

Coarse: the lag at which the mean squared distance of the two tracks is least, over every lag with enough overlap (by
FFT), which also finds lags of hours and clocks that share no time at all. Fine: at the lag found, the distances that
are left are regressed on the velocity, e = v delay + b_k + C l: a constant b_k in each block of the track takes drifts,
an arm l fixed in the body takes another point of the vehicle. The blocks' scatter gives the sigma, so that slow errors
of the solution are not taken for knowledge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Solution
from schuler.ground.earth import WGS84
from schuler.ground.tables import Table

Array = NDArray[np.float64]
GRID = 1 << 15  # points of the coarse search, at most, of the longer track
OVERLAP = 0.3  # of the shorter track, that a lag must leave
BLOCKS = 10
SURE = 4.0  # sigmas
SMALLEST_S = 0.01  # a lag below this changes nothing that is judged
NEARER = 0.95  # how much nearer the tracks must lie with the lag taken out
EXPLAINS = 0.25  # share of the squared distances, about their block's mean, that a lag must explain
SLOWEST_MPS = 0.02  # rms of the velocity about its blocks' means, below which nothing tells
FIXES_S = 2.0  # receivers are late by less
DISTINCT = 4.0  # how much smaller the squared distance at a coarse lag must be than elsewhere


@dataclass(frozen=True)
class Lag:
    """delay_s: of the reference (its row stamped t belongs to t - delay), with 1 sigma.

    rms_m: horizontal distance of the tracks with the delay taken out; rms_before_m: as stamped, NaN where they share no
    time. explained: share of the squared distances, about their blocks' means, that went with it.
    """

    delay_s: float
    sigma_s: float
    rms_m: float
    rms_before_m: float
    explained: float

    @property
    def significant(self) -> bool:
        """Whether it is worth a word: far outside its sigma, and it explains what it should."""
        apart = not np.isfinite(self.rms_before_m)
        better = apart or (self.explained >= EXPLAINS and self.rms_m < NEARER * self.rms_before_m)
        return abs(self.delay_s) > max(SURE * self.sigma_s, SMALLEST_S) and better


def reference_lag(solution: Solution, reference: Table) -> Lag | None:
    """Delay of a reference against a solution; None where the tracks do not tell (no motion, laps, another place)."""
    if "lat" not in reference or "lon" not in reference or len(reference) < 20 or len(solution) < 20:
        return None
    placed = np.isfinite(solution.lat) & np.isfinite(solution.lon)
    known = np.isfinite(reference["lat"]) & np.isfinite(reference["lon"])
    if placed.sum() < 20 or known.sum() < 20:
        return None
    origin = float(solution.lat[placed][0]), float(solution.lon[placed][0])
    own = _plane(solution.lat[placed], solution.lon[placed], origin)
    its = _plane(reference["lat"][known], reference["lon"][known], origin)
    t_own, t_its = solution.time[placed], reference.time[known]
    heading = solution.rpy[placed, 2]
    if not np.isfinite(heading).all():
        heading = np.full(len(t_own), np.nan)
    velocity = solution.v_n[placed, :2]
    if not np.isfinite(velocity).all():
        velocity = np.gradient(own, t_own, axis=0)
    start = coarse_delay(t_own, own, t_its, its)
    if start is None:
        return None
    return fine_delay(_Own(t_own, own, velocity, heading), t_its, its, start)


def _plane(lat: Array, lon: Array, origin: tuple[float, float]) -> Array:
    zero = np.zeros(len(lat))
    return np.asarray(WGS84.displacement_n(lat, lon, zero, *origin, 0.0)[:, :2])


def coarse_delay(t_own: Array, own: Array, t_its: Array, its: Array) -> float | None:
    """Delay of least mean squared distance, s. 0 where no other lag is clearly better; None where the tracks share no
    time as stamped and no lag fits.

    t_own (n,), own (n, d); t_its (m,), its (m, d): the same d signals of both, on the same axes.
    """
    span = max(t_own[-1] - t_own[0], t_its[-1] - t_its[0])
    step = max(span / GRID, float(np.median(np.diff(t_own))), float(np.median(np.diff(t_its))), 0.02)
    if span / step < 20:
        return None
    a, in_a = _gridded(t_own, own, step)
    b, in_b = _gridded(t_its, its, step)
    n = 1 << int(np.ceil(np.log2(len(a) + len(b))))

    def correlated(x: Array, y: Array) -> Array:  # sum over i of x[i] y[i + k], at index k modulo n
        return np.fft.irfft(np.conj(np.fft.rfft(x, n)) * np.fft.rfft(y, n), n)

    middle = a[in_a].mean(axis=0)  # near zero, so that large coordinates cost no digits
    a, b = (a - middle) * in_a[:, None], (b - middle) * in_b[:, None]
    count = np.round(correlated(in_a.astype(float), in_b.astype(float)))
    square = correlated(np.sum(a**2, axis=1), in_b.astype(float)) + correlated(in_a.astype(float), np.sum(b**2, axis=1))
    for k in range(a.shape[1]):
        square -= 2.0 * correlated(a[:, k], b[:, k])
    lags = np.arange(n)
    lags = np.where(lags >= len(b), lags - n, lags)
    delay = lags * step + (t_its[0] - t_own[0])  # the reference's grid starts at its own first row
    enough = count >= max(OVERLAP * min(in_a.sum(), in_b.sum()), 10)
    if not enough.any():
        return None
    cost = np.where(enough, np.maximum(square, 0.0) / np.maximum(count, 1.0), np.inf)
    best = int(np.argmin(cost))
    floor = 1e-6 * float(np.mean(np.sum(a[in_a] ** 2, axis=1))) + 1e-4
    moved = max(30.0 * step, 0.02 * span)  # lags this near to the best belong to its own valley
    others = cost[enough & (np.abs(delay - delay[best]) > moved)]
    as_stamped = int(np.argmin(np.abs(delay)))
    together = enough[as_stamped] and abs(delay[as_stamped]) <= step
    if together and cost[as_stamped] <= DISTINCT * max(cost[best], floor):
        return 0.0
    if together and abs(delay[best]) <= moved:
        return float(delay[best])
    if len(others) and others.min() <= DISTINCT * max(cost[best], floor):
        return 0.0 if together else None
    if not together and cost[best] > 0.04 * float(np.mean(np.sum((b[in_b] - b[in_b].mean(axis=0)) ** 2, axis=1))):
        return None  # nowhere do they lie on each other
    return float(delay[best])


def _gridded(time: Array, values: Array, step: float) -> tuple[Array, NDArray[np.bool_]]:
    """Values on a regular grid from the first row on, and where they are known; no gap of many rows is bridged."""
    at = time[0] + step * np.arange(int((time[-1] - time[0]) / step) + 1)
    out = np.column_stack([np.interp(at, time, values[:, k]) for k in range(values.shape[1])])
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    gap = time[after] - time[after - 1]
    return out, gap <= max(5.0 * float(np.median(np.diff(time))), 2.0 * step)


@dataclass(frozen=True)
class _Own:
    """The solution: time (n,) s, place (n, 2) m, velocity (n, 2) m/s, heading (n,) rad, NaN throughout if unknown."""

    time: Array
    place: Array
    velocity: Array
    heading: Array


def fine_delay(own: _Own, t_its: Array, its: Array, start: float) -> Lag | None:
    """The delay near `start`, with its sigma from the scatter of the track's blocks."""
    delay = start
    sigma = np.nan
    for _ in range(8):
        step = _step(own, t_its, its, delay)
        if step is None:
            return None
        moved, sigma = step
        delay += moved
        if abs(moved) < max(1e-5, 0.02 * sigma):
            break
    after, before = (_apart(own, t_its, its, d) for d in (delay, 0.0))
    return Lag(delay, sigma, after, before, _explained(own, t_its, its, delay))


def _rows(own: _Own, t_its: Array, its: Array, delay: float) -> tuple[Array, Array, Array, Array] | None:
    """(time, error, velocity, heading) at the reference's rows, the solution taken at their stamp - delay."""
    at = t_its - delay
    after = np.clip(np.searchsorted(own.time, at), 1, len(own.time) - 1)
    gap = own.time[after] - own.time[after - 1]
    inside = (at >= own.time[0]) & (at <= own.time[-1]) & (gap <= 5.0 * float(np.median(np.diff(own.time))) + 1e-6)
    if inside.sum() < 20:
        return None
    at = at[inside]
    mine, velocity = (
        np.column_stack([np.interp(at, own.time, x[:, k]) for k in range(2)]) for x in (own.place, own.velocity)
    )
    known = np.isfinite(own.heading).all()
    turn = np.interp(at, own.time, np.unwrap(own.heading)) if known else np.full(len(at), np.nan)
    return at, mine - its[inside], velocity, turn


def _projected(time: Array, columns: list[Array], turn: Array) -> list[Array] | None:
    """Columns (n, 2) without what a constant in each block and an arm fixed in the body explain; then the blocks."""
    edges = np.linspace(time[0], time[-1], BLOCKS + 1)
    block = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, BLOCKS - 1)
    count = np.bincount(block, minlength=BLOCKS)
    if (count > 0).sum() < 3:
        return None

    def centred(x: Array) -> Array:
        means = [np.bincount(block, x[:, k], BLOCKS) / np.maximum(count, 1) for k in range(2)]
        return x - np.column_stack(means)[block]

    out = [centred(c) for c in columns]
    if np.isfinite(turn).all():
        c, s = np.cos(turn), np.sin(turn)
        arms = np.column_stack([centred(np.column_stack(a)).ravel() for a in ((c, s), (-s, c))])
        # left out where the vehicle hardly turns within a block: such an arm is a constant
        if np.mean(arms**2) > 1e-4:
            out = [(x.ravel() - arms @ np.linalg.lstsq(arms, x.ravel(), rcond=1e-9)[0]).reshape(-1, 2) for x in out]
    return [*out, block.astype(float)]


def _step(own: _Own, t_its: Array, its: Array, delay: float) -> tuple[float, float] | None:
    """How much further the delay is, and its sigma; None where nothing tells."""
    rows = _rows(own, t_its, its, delay)
    if rows is None:
        return None
    time, error, velocity, turn = rows
    # error = solution - reference; a reference that is late lies behind: error = + v times the delay that is left
    projected = _projected(time, [error, velocity], turn)
    if projected is None:
        return None
    e, v, block = projected
    which = block.astype(int)
    information = np.bincount(which, np.sum(v**2, axis=1), BLOCKS)
    told = np.bincount(which, np.sum(v * e, axis=1), BLOCKS)
    total = float(information.sum())
    if total <= 1e-4 * float(np.sum(velocity**2)) + 1e-12 or np.sqrt(total / len(time)) < SLOWEST_MPS:
        return None  # straight at one speed, or at rest: nothing tells a lag from an offset
    # near a wrong lag the tracks are far from parallel; half a minute at a time is enough to get there
    moved = float(np.clip(told.sum() / total, -30.0, 30.0))
    scatter = float(np.sum((told - information * moved) ** 2)) / total**2
    blocks = int((information > 1e-3 * total).sum())
    return moved, float(np.sqrt(scatter * blocks / (blocks - 1))) if blocks > 1 else np.inf


def _explained(own: _Own, t_its: Array, its: Array, delay: float) -> float:
    """Share of the squared distances (about block means) that are there as stamped and gone with the delay; 1 where the
    tracks share no time as stamped."""
    sizes = []
    for d in (0.0, delay):
        rows = _rows(own, t_its, its, d)
        projected = None if rows is None else _projected(rows[0], [rows[1]], rows[3])
        if projected is None:
            return 1.0
        sizes.append(float(np.mean(projected[0] ** 2)))
    return 1.0 - sizes[1] / sizes[0] if sizes[0] > 0.0 else 0.0


def _apart(own: _Own, t_its: Array, its: Array, delay: float) -> float:
    rows = _rows(own, t_its, its, delay)
    return np.nan if rows is None else float(np.sqrt(np.mean(np.sum(rows[1] ** 2, axis=1))))


# ---- words ----

GPS_EPOCH = 315964800.0  # 1980-01-06 in Unix seconds
LEAPS = range(11, 20)  # GPS - UTC since 1996; 18 since 2017


def clocks(delay: float, sigma: float = 0.0) -> tuple[str, float]:
    """What an offset between two clocks is known as, and its exact value; ("", delay) where it is none of the usual."""
    near = max(0.3, 4.0 * sigma)
    known = [(f"the {leap} s between GPS time and UTC", float(leap)) for leap in LEAPS]
    known += [("Unix time against GPS seconds", GPS_EPOCH - leap) for leap in (0, *LEAPS)]
    known += [(f"{h:g} h, as of a time zone", 3600.0 * h) for h in np.arange(0.5, 14.1, 0.25)]
    name, value = min(known, key=lambda k: abs(abs(delay) - k[1]))
    return (name, float(np.copysign(value, delay))) if abs(abs(delay) - value) < near else ("", delay)


def lag_words(lag: Lag | None, file: str, gnss: bool = True, already: float = 0.0) -> str | None:
    """One sentence on a lag that is significant, with what to type; None otherwise. Nothing is corrected by itself.

    gnss : the track follows fixes, so that their clock may be the one that is wrong. already : the delay that the
    reference's times were corrected by before the lag was looked for.
    """
    if lag is None or not lag.significant:
        return None
    digits = int(np.clip(np.ceil(-np.log10(max(lag.sigma_s, 1e-4))), 1, 4))
    name, value = clocks(lag.delay_s, lag.sigma_s)
    typed = f"{value + already:.{0 if name and not already else digits}f}"
    way = "late" if lag.delay_s > 0 else "early"
    said = f"{file} is {abs(lag.delay_s):.{digits}f} +- {lag.sigma_s:.{digits}f} s {way} against the track"
    said += f" ({name})" if name else ""
    after, before = (f"{x:.0f}" if x >= 100.0 else f"{x:.3g}" for x in (lag.rms_m, lag.rms_before_m))
    if np.isfinite(lag.rms_before_m):
        said += f": with that taken out they lie {after} m (rms) from each other instead of {before} m"
    else:
        said += f": as stamped they share no time, with that taken out they lie {after} m (rms) from each other"
    said += f"; type reference_delay_s = {typed} under [input]"
    if gnss and abs(lag.delay_s) < FIXES_S:
        change = "a smaller" if lag.delay_s > 0 else "a larger"
        said += f", or {change} gnss_delay_s by as much if the fixes are what is wrong"
    return said
