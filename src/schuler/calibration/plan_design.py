"""Which positions of a turntable tell most about the lever arms, and what the table's own errors cost.

The information of a position for an accelerometer of direction e is w^4/sigma^2 times d d^T, d = (u.e) u - e, where
sigma
is the noise of spin minus stops. Positions are chosen greedily and then exchanged one by one (Fedorov) until the summed
variance of all components stops falling.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.calibration.turntable import UNSEEN, design_row
from schuler.ground.earth import WGS84
from schuler.ground.errors import InputError
from schuler.ground.units import ARCMIN, DEG
from schuler.truth.turntable import spin_axis

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TableModel:
    """A table and a procedure. Angles rad, times s.

    gammas, betas: settings that the inner axes can take (a single-axis table: those that its brackets allow).
    rate rad/s; still: length of a stop; stops round the table; spin: length of a spin, each way where both_ways; move:
    between them. noise (k,) or one: velocity random walk of the accelerometers, m/s/sqrt(s). angle_error, rate_error
    (relative), stop_error: rms of settings, rate and azimuth of the stops; tilt of the outer axis; latitude or None.
    """

    rate: float = 20.0 * DEG
    gammas: tuple[float, ...] = tuple(np.arange(-165.0, 181.0, 15.0) * DEG)
    betas: tuple[float, ...] = tuple(np.arange(-90.0, 91.0, 15.0) * DEG)
    still: float = 60.0
    stops: int = 8
    spin: float = 300.0
    both_ways: bool = True
    move: float = 5.0
    noise: float | tuple[float, ...] = 1e-3
    directions: Array = field(default_factory=lambda: np.eye(3))
    angle_error: float = 1.0 * ARCMIN
    rate_error: float = 1e-5
    stop_error: float = 1.0 * ARCMIN
    tilt: float = 2.0 * ARCMIN
    latitude: float | None = None

    @property
    def position_time(self) -> float:
        """s of table time that a position takes."""
        ways = 2 if self.both_ways else 1
        return self.stops * (self.still + self.move) + ways * (self.spin + self.move)

    @property
    def sigma(self) -> Array:
        """(k,) m/s^2: noise of the spins' constant minus that of the stops at a position."""
        noise = np.broadcast_to(np.asarray(self.noise, dtype=np.float64), (len(self.directions),))
        ways = 2 if self.both_ways else 1
        turns = np.floor(abs(self.rate) * self.spin / (2.0 * np.pi))
        length = ways * turns * 2.0 * np.pi / abs(self.rate)
        if length <= 0.0:
            raise InputError(
                f"a spin of {self.spin:g} s at {self.rate / DEG:g} deg/s is not a whole turn; spin longer or faster"
            )
        return np.asarray(noise * np.sqrt(1.0 / length + 1.0 / (self.stops * self.still)))

    def candidates(self) -> Array:
        """(c, 2) settings gamma, beta whose outer axes differ; an axis and its opposite show the same and count
        once."""
        grid = np.array([(g, b) for g in self.gammas for b in self.betas])
        order = np.lexsort((np.abs(grid[:, 1]), np.abs(grid[:, 0])))  # the plainest setting of equal ones
        seen: list[Array] = []
        keep = []
        for i in order:
            u = spin_axis(*grid[i])
            if all(abs(float(u @ v)) < 1.0 - 1e-9 for v in seen):
                seen.append(u)
                keep.append(i)
        return np.asarray(grid[keep])


@dataclass(frozen=True)
class Design:
    """settings (k, 2) rad; std (n, 3) m of every component (infinite: not seen); time s; condition (n,)."""

    settings: Array
    std: Array
    time: float
    condition: Array

    @property
    def score(self) -> float:
        """Root of the mean variance of all components, m."""
        return float(np.sqrt(np.mean(self.std**2)))


def information(settings: ArrayLike, table: TableModel) -> Array:
    """(k, n, 3, 3): information of each setting about each accelerometer, 1/m^2."""
    s = np.atleast_2d(np.asarray(settings, dtype=np.float64))
    u = spin_axis(s[:, 0], s[:, 1])
    d = np.stack([design_row(u, e) for e in table.directions], axis=1)
    scale = table.rate**4 / table.sigma**2
    return np.asarray(np.einsum("kni,knj->knij", d, d) * scale[None, :, None, None])


def judge(settings: ArrayLike, table: TableModel) -> Design:
    """What a plan gives: sigmas of all components from noise alone, condition numbers, table time."""
    s = np.atleast_2d(np.asarray(settings, dtype=np.float64))
    total = information(s, table).sum(axis=0)
    std = np.full((len(total), 3), np.inf)
    condition = np.full(len(total), np.inf)
    for i, M in enumerate(total):
        values, V = np.linalg.eigh(M)
        good = values > UNSEEN**2 * max(float(values[-1]), 1e-300)
        blind = np.sqrt(np.sum(V[:, ~good] ** 2, axis=1))
        var = np.sum(V[:, good] ** 2 / values[good], axis=1)
        std[i] = np.where(blind < 1e-3, np.sqrt(var), np.inf)
        if good.all():
            condition[i] = np.sqrt(values[-1] / values[0])
    return Design(s, std, len(s) * table.position_time, condition)


def _cost(total: Array) -> float:
    """Sum of variances with a trace of prior, so that plans that see too little can be compared too."""
    top = np.trace(total, axis1=1, axis2=2).max()
    eye = np.eye(3) * max(top, 1e-300) * 1e-9
    return float(np.trace(np.linalg.inv(total + eye), axis1=1, axis2=2).sum())


def design(k: int, table: TableModel, *, given: ArrayLike | None = None) -> Design:
    """The best k positions that the table can take; given (m, 2): settings that stay, k counts them too."""
    points = table.candidates()
    fixed = np.empty((0, 2)) if given is None else np.atleast_2d(np.asarray(given, dtype=np.float64))
    if k < max(1, len(fixed)):
        raise InputError(f"a plan of {k} positions is not possible; type --design with a number of at least 1")
    infos = information(points, table)
    base = information(fixed, table).sum(axis=0) if len(fixed) else np.zeros((len(table.directions), 3, 3))
    best: tuple[float, list[int]] | None = None
    for first in range(0, len(points), max(1, len(points) // 12)):  # several starts: exchange finds a near optimum
        chosen = [first][: k - len(fixed)]
        while len(chosen) < k - len(fixed):
            total = base + infos[chosen].sum(axis=0)
            chosen.append(int(np.argmin([_cost(total + m) for m in infos])))
        cost = _cost(base + infos[chosen].sum(axis=0)) if chosen else _cost(base)
        improved = bool(chosen)
        while improved:
            improved = False
            for place in range(len(chosen)):
                rest = base + infos[[c for p, c in enumerate(chosen) if p != place]].sum(axis=0)
                costs = _costs(rest, infos)
                j = int(np.argmin(costs))
                if costs[j] < cost * (1.0 - 1e-9):
                    chosen[place], cost, improved = j, float(costs[j]), True
        if best is None or cost < best[0] * (1.0 - 1e-9):
            best = (cost, list(chosen))
    assert best is not None
    return judge(np.vstack([fixed, points[sorted(best[1])]]), table)


def _costs(rest: Array, infos: Array) -> Array:
    total = rest[None] + infos
    top = np.trace(total, axis1=2, axis2=3).max(axis=1)
    total = total + np.eye(3) * (np.maximum(top, 1e-300) * 1e-9)[:, None, None, None]
    return np.asarray(np.trace(np.linalg.inv(total), axis1=2, axis2=3).sum(axis=1))


def one_more(settings: ArrayLike, table: TableModel) -> Design:
    """The plan with the one position added that gains most."""
    s = np.atleast_2d(np.asarray(settings, dtype=np.float64))
    return design(len(s) + 1, table, given=s)


def would_show(settings: ArrayLike, e: ArrayLike, component: int, table: TableModel) -> tuple[float, float] | None:
    """A setting (gamma, beta in rad) that makes a component of rho visible for the direction e; None: none alone
    does."""
    s = np.atleast_2d(np.asarray(settings, dtype=np.float64)).reshape(-1, 2)
    points = table.candidates()
    best: tuple[float, tuple[float, float]] | None = None
    rows = np.array([design_row(spin_axis(*x), e) for x in s]).reshape(-1, 3)
    for p in points:
        W = np.vstack([rows, design_row(spin_axis(*p), e)])
        _, values, Vt = np.linalg.svd(W, full_matrices=True)
        full = np.zeros(3)
        full[: values.size] = values
        good = full > UNSEEN * max(float(full[0]), 1e-300)
        if np.linalg.norm(Vt[~good, component]) > 1e-3:
            continue
        var = float(np.sum(Vt[good, component] ** 2 / full[good] ** 2))
        if best is None or var < best[0] - 1e-9:
            best = (var, (float(p[0]), float(p[1])))
    return None if best is None else best[1]


# ---- errors of the table ----


@dataclass(frozen=True)
class Share:
    """One line of an error budget: what, and the rms it puts on each component, (n, 3) m."""

    source: str
    std: Array


def axis_jacobians(gamma: ArrayLike, beta: ArrayLike) -> Array:
    """(..., 2, 3): derivatives of the spin axis by gamma and by beta."""
    g, b = np.asarray(gamma, dtype=np.float64), np.asarray(beta, dtype=np.float64)
    zero = np.zeros_like(g * b)
    by_gamma = np.stack([-np.sin(g) * np.sin(b), zero, np.cos(g) * np.sin(b)], axis=-1)
    by_beta = np.stack([np.cos(g) * np.cos(b), -np.sin(b) + zero, np.sin(g) * np.cos(b)], axis=-1)
    return np.stack([by_gamma, by_beta], axis=-2)


def row_jacobians(gamma: ArrayLike, beta: ArrayLike, e: ArrayLike) -> Array:
    """(..., 2, 3): derivatives of the design row (u.e) u - e by gamma and beta, the dW of thesis (4.24) over w^2."""
    e = np.asarray(e, dtype=np.float64)
    u = spin_axis(gamma, beta)[..., None, :]
    du = axis_jacobians(gamma, beta)
    return np.asarray((du @ e)[..., None] * u + (u @ e)[..., None] * du)


def angle_effect(settings: ArrayLike, e: ArrayLike, rho: ArrayLike) -> Array:
    """(3, k, 2): d rho / d (gamma_k, beta_k), metres per radian: thesis (4.23), (4.24) for any number of positions."""
    s = np.atleast_2d(np.asarray(settings, dtype=np.float64))
    e, rho = np.asarray(e, dtype=np.float64), np.asarray(rho, dtype=np.float64)
    W = design_row(spin_axis(s[:, 0], s[:, 1]), e)
    change = row_jacobians(s[:, 0], s[:, 1], e) @ rho  # true row minus nominal one, on the data
    return np.asarray(np.linalg.pinv(W)[:, :, None] * change[None])


def budget(settings: ArrayLike, table: TableModel, levers: ArrayLike, gravity: float = 9.80665) -> list[Share]:
    """What noise and each error of the table put on the components, rms in m; levers (n, 3) m, the true or found
    ones."""
    s = np.atleast_2d(np.asarray(settings, dtype=np.float64))
    rho = np.atleast_2d(np.asarray(levers, dtype=np.float64))
    n = len(table.directions)
    noise = judge(s, table).std
    angle, rate, earth, stop = (np.zeros((n, 3)) for _ in range(4))
    u = spin_axis(s[:, 0], s[:, 1])
    for i, e in enumerate(table.directions):
        W = design_row(u, e)
        effect = angle_effect(s, e, rho[i])
        angle[i] = np.sqrt(np.sum(effect**2, axis=(1, 2))) * table.angle_error
        rate[i] = np.abs(2.0 * table.rate_error * rho[i])
        if not table.both_ways and table.latitude is None:
            earth[i] = np.abs(2.0 * WGS84.omega / table.rate * rho[i])
        # An azimuth error of a stop moves it along the sine of the tilt.
        flat = np.sqrt(np.maximum(1.0 - (u @ e) ** 2, 0.0))
        off = gravity * table.tilt * table.stop_error * flat / np.sqrt(2.0 * table.stops)
        stop[i] = np.sqrt(np.sum((np.linalg.pinv(W) * off / table.rate**2) ** 2, axis=1))
    parts = [("noise of the accelerometers", noise), ("inner angles", angle), ("rate", rate)]
    parts += [("Earth's rate, one way only", earth), ("stops off their azimuth on a tilted axis", stop)]
    shares = [Share(name, std) for name, std in parts]
    shares.append(Share("all", np.sqrt(sum(x.std**2 for x in shares))))
    return shares
