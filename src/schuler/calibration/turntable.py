"""Lever arms of accelerometers from a turntable: stops and constant-rate spins at several settings of the inner axes.

    A_hat - A0 = w^2 [ (u.e) u - e ] . rho0                                                     thesis (4.8), (4.12)
    u = (cos gamma sin beta, cos beta, sin gamma sin beta)                                      (4.11) corrected

A_hat and A0 are the constant terms of least-squares fits of 1, cos, sin and second harmonics of the table angle, over
whole turns of a spin and over the stops, at any sampling. At each position A0 is an unknown of its own: it holds bias,
gravity and tilt. All positions and both directions go into one weighted least squares per accelerometer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.calibration import turntable_checks as checks
from schuler.calibration.stretches import Stretch, rows_inside, stretches_of, usual_step
from schuler.ground.earth import WGS84
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

Array = NDArray[np.float64]
UNSEEN = 1e-6  # a direction whose weight is less than this share of the best one is not observable


def design_row(u: ArrayLike, e: ArrayLike) -> Array:
    """(..., 3) of (u.e) u - e: what a spin about u, divided by w^2, shows of rho for the direction e."""
    u, e = np.asarray(u, dtype=np.float64), np.asarray(e, dtype=np.float64)
    return np.asarray(np.sum(u * e, axis=-1, keepdims=True) * u - e)


@dataclass(frozen=True)
class Constant:
    """The constant term of one fit: of the stops (rate 0) or one spin at a position. value, variance (k,): m/s^2.

    harmonics (k, 2) m/s^2: cos and sin of the table angle; they show how far the axis is from the vertical.
    """

    position: str
    u: Array
    rate: float
    value: Array
    variance: Array
    harmonics: Array
    turns: float
    start: float


@dataclass(frozen=True)
class Levers:
    """Estimate for one accelerometer. rho (3,) m and covariance (3, 3) m^2, NaN where not observable.

    condition: of the rows W/w^2 seen; infinite where a component is not observable. blind (3, b): directions that the
    plan cannot see. residuals: (position, rate, m/s^2) of spin minus stops minus W rho; holdout the same with that
    position left out.
    """

    rho: Array
    covariance: Array
    observable: NDArray[np.bool_]
    condition: float
    blind: Array
    residuals: list[tuple[str, float, float]]
    holdout: list[tuple[str, float, float]]
    chi2: float
    dof: int

    @property
    def std(self) -> Array:
        return np.asarray(np.sqrt(np.diag(self.covariance)))


@dataclass(frozen=True)
class TurntableResult:
    """levers per accelerometer; constants of every fit; noise (k,) m/s^2 sqrt(s), one sigma of a mean over 1 s; notes.

    tilt: position -> (tilt, azimuth) of the outer axis in rad, from the first harmonics of the stops.
    """

    levers: list[Levers]
    constants: list[Constant]
    noise: Array
    tilt: dict[str, float]
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class TurntableSettings:
    """directions (k, 3) of the accelerometers; origin (3,) m from the point that levers run from to the table's centre.

    gravity m/s^2; latitude rad, for the Earth's rate (None: left out; it cancels when the table spins both ways).
    check: compare gyros and gravity with the plan.
    """

    directions: Array = field(default_factory=lambda: np.eye(3))
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: float = 9.80665
    latitude: float | None = None
    check: bool = True


def calibrate(imu: Table, positions: Table, settings: TurntableSettings | None = None) -> TurntableResult:
    """Lever arms from an imu table and the plan's positions table. Raises InputError for what cannot be used."""
    settings = settings or TurntableSettings()
    if imu.kind == "increments" or "dv_x" in imu:
        dt = np.diff(imu.time, prepend=imu.time[0] - usual_step(imu.time))
        outputs = imu.stack("dv_x", "dv_y", "dv_z") / dt[:, None]
        gyro = imu.stack("dtheta_x", "dtheta_y", "dtheta_z") / dt[:, None]
    else:
        outputs, gyro = imu.stack("accel_x", "accel_y", "accel_z"), imu.stack("gyro_x", "gyro_y", "gyro_z")
    notes: list[str] = []
    if "temperature" in imu:
        notes += checks.temperature(imu.time, imu["temperature"])
    return calibrate_outputs(imu.time, outputs, gyro, stretches_of(positions, "turntable"), settings, notes)


def calibrate_outputs(
    time: Array,
    outputs: Array,
    gyro: Array | None,
    stretches: Sequence[Stretch],
    settings: TurntableSettings,
    notes: Sequence[str] = (),
) -> TurntableResult:
    """The same from plain arrays: outputs (n, k) m/s^2 of k accelerometers, gyro (n, 3) rad/s or None; a row stamped
    t is
    the mean over the interval that ends there."""
    said = list(notes)
    e = np.asarray(settings.directions, dtype=np.float64)
    outputs = np.asfortranarray(outputs, dtype=np.float64)  # sums run down the columns
    gyro = None if gyro is None else np.asfortranarray(gyro, dtype=np.float64)
    if outputs.ndim != 2 or e.shape != (outputs.shape[1], 3):
        raise InputError(f"{outputs.shape[1]} accelerometers and {len(e)} directions; give a direction for each")
    dt = usual_step(time)
    middle = np.ascontiguousarray(time - 0.5 * dt)
    inside = [s for s in stretches if s.start < time[-1] and s.end > time[0]]
    if len(inside) < len(stretches):
        lost = next(s for s in stretches if s not in inside)
        raise InputError(
            f"{lost.name} lies outside the recording, which runs from {time[0]:.1f} to {time[-1]:.1f} s; "
            f"correct start[s] "
            "and end[s] in the positions table"
        )
    spins = [s for s in stretches if s.kind == "spin"]
    stills = [s for s in stretches if s.kind == "still"]
    if not spins:
        raise InputError('the positions table has no row of kind "spin": lever arms show in spins only')
    if not stills:
        raise InputError(
            'the positions table has no row of kind "still": without stops bias and gravity hide the levers'
        )
    if settings.check:
        checks.saturated(middle, outputs, stretches)
        if gyro is not None and np.ptp(gyro) > 0.0:
            checks.still(middle, gyro, outputs, stills, settings.gravity)
            checks.rates(middle, gyro, spins, stills)
        else:
            said.append("the gyros show nothing: whether the table held its rate was not checked")
        checks.gravity(middle, outputs, stills, e, settings.gravity)
        said += checks.spins(spins, earth_known=settings.latitude is not None)
    fits = [_spin(middle, outputs, s) for s in spins]
    block = float(np.median([2.0 * np.pi / abs(s.rate) for s in spins]))
    stops, stop_blocks = _stops(middle, outputs, stills, block)
    noise = _noise([f.scatter for f in fits] + stop_blocks, [f.white for f in fits])
    constants = [f.constant(noise) for f in fits]
    resting, tilt, rest_notes = _rest_constants(stops, noise, settings.gravity, e)
    constants += resting
    said += rest_notes
    said += _missing_stops(constants)
    levers = [_solve(constants, i, e[i], settings) for i in range(len(e))]
    for i, found in enumerate(levers):
        if found.dof > 0 and found.chi2 > _limit(found.dof):
            said.append(
                f"accelerometer {_name(i)}: the positions disagree by {np.sqrt(found.chi2 / found.dof):.1f} "
                f"times the noise "
                "(axis errors, drift or heating); its sigmas are enlarged by that much"
            )
    return TurntableResult(levers, constants, np.sqrt(noise), tilt, said)


def _name(i: int) -> str:
    return "xyz"[i] if i < 3 else str(i + 1)


def _limit(dof: int) -> float:
    """Chi-square that noise alone exceeds once in a thousand."""
    from scipy.stats import chi2

    return float(chi2.ppf(0.999, dof))


# ---- constants ----


@dataclass(frozen=True)
class _Spin:
    """scatter: (duration of a turn, (turns, k) constants turn by turn); white (k,): rms of a row about the fit, and
    dt."""

    stretch: Stretch
    value: Array
    harmonics: Array
    scatter: tuple[Array, Array]
    white: tuple[Array, float]
    turns: int

    def constant(self, noise: Array) -> Constant:
        s = self.stretch
        length = self.turns * 2.0 * np.pi / abs(s.rate)
        return Constant(s.position, s.u, s.rate, self.value, noise / length, self.harmonics, self.turns, s.start)


def _spin(middle: Array, outputs: Array, s: Stretch) -> _Spin:
    from schuler.kernels.turntable import BASIS, harmonic_sums

    dt = usual_step(middle)
    first, last = rows_inside(middle, s, dt)
    if last - first < 10:
        raise InputError(f"{s.name} holds {last - first} rows of the recording; correct start[s] and end[s]")
    held = (last - first) * dt
    # A row more or less at the end is no missing turn.
    turns = int(np.floor(abs(s.rate) * (held + 2.5 * dt) / (2.0 * np.pi)))
    if turns < 1:
        raise InputError(
            f"{s.name}: {np.rad2deg(abs(s.rate)) * held:.0f} deg in {held:.1f} s is not a whole turn; gravity does not "
            f"average out. Spin for at least {2.0 * np.pi / abs(s.rate):.1f} s, better ten turns"
        )
    begin = float(middle[first]) - 0.5 * dt
    k = outputs.shape[1]
    normal, right, square = np.empty((turns, BASIS, BASIS)), np.empty((turns, BASIS, k)), np.empty(k)
    offset = outputs[first:last].mean(axis=0)  # removed before squares are summed
    harmonic_sums(
        middle[first:last],
        outputs[first:last] - offset,
        0,
        last - first,
        begin,
        s.azimuth + s.rate * (begin - s.start),
        s.rate,
        turns,
        normal,
        right,
        square,
    )
    N, r = normal.sum(axis=0), right.sum(axis=0)
    x = np.linalg.solve(N, r)
    rows = float(N[0, 0])
    rest = np.maximum(square - np.sum(x * r, axis=0), 0.0) / max(rows - BASIS, 1.0)
    each = (right[:, 0] - np.einsum("tq,qk->tk", normal[:, 0, 1:], x[1:])) / np.maximum(normal[:, 0, 0], 1.0)[:, None]
    length = normal[:, 0, 0] * dt
    return _Spin(s, x[0] + offset, x[1:3].T, (length, each), (rest * dt, rows - BASIS), turns)


@dataclass(frozen=True)
class _Stop:
    stretch: Stretch
    value: Array
    length: float


def _stops(
    middle: Array, outputs: Array, stills: Sequence[Stretch], block: float
) -> tuple[list[_Stop], list[tuple[Array, Array]]]:
    stops, blocks = [], []
    dt = usual_step(middle)
    for s in stills:
        first, last = rows_inside(middle, s, dt)
        if last - first < 10:
            raise InputError(f"{s.name} holds {last - first} rows of the recording; correct start[s] and end[s]")
        part = outputs[first:last]
        stops.append(_Stop(s, part.mean(axis=0), (last - first) * dt))
        # Blocks like a turn, so that stops and spins feel the same drift; at least two a stop.
        count = int(np.clip(np.floor((last - first) * dt / block), 2, 1000))
        cut = np.linspace(0, last - first, count + 1).astype(int)
        means = np.array([part[a:b].mean(axis=0) for a, b in zip(cut[:-1], cut[1:], strict=True)])
        blocks.append((np.diff(cut) * dt, means))
    return stops, blocks


def _noise(scatter: Sequence[tuple[Array, Array]], white: Sequence[tuple[Array, float]]) -> Array:
    """(k,) m^2/s^3: variance of a mean over 1 s, from the scatter of turns and blocks about their own stretch's mean.

    Drift within a stretch raises it. With few blocks the rows' own noise is the lower bound.
    """
    total, dof = 0.0, 0
    for length, means in scatter:
        mean = np.average(means, axis=0, weights=length)
        total = total + np.sum((means - mean) ** 2 * length[:, None], axis=0)
        dof += len(length) - 1
    rows = np.sum([q * n for q, n in white], axis=0) / sum(n for _, n in white)
    if dof < 1:
        return np.asarray(rows)
    blocks = np.asarray(total) / dof
    return np.asarray(np.maximum(blocks, rows) if dof < 10 else blocks)


def _rest_constants(
    stops: Sequence[_Stop], noise: Array, gravity: float, e: Array
) -> tuple[list[Constant], dict[str, float], list[str]]:
    """A0 of every position: the constant of a harmonic fit over its stops."""
    from scipy.stats import chi2 as chi_square

    notes: list[str] = []
    groups: dict[str, list[_Stop]] = {}
    for stop in stops:
        groups.setdefault(stop.stretch.position, []).append(stop)
    fitted = []
    misfit, dof = np.zeros(noise.size), 0
    few = []
    for name, group in groups.items():
        X = _harmonics(np.array([s.stretch.azimuth for s in group]))
        if X.shape[1] == 1:
            few.append(name)
        y = np.array([s.value for s in group])
        weights = np.array([s.length for s in group])
        C = np.linalg.inv(X.T @ (X * weights[:, None]))
        x = C @ X.T @ (y * weights[:, None])
        misfit += np.sum((y - X @ x) ** 2 * weights[:, None], axis=0)
        dof += len(group) - X.shape[1]
        fitted.append((name, group, x, C))
    if few:
        notes.append(
            f"position {', '.join(few)}: fewer than three stops round the table, so a tilt of its axis stays "
            f"in A0; stop at "
            "eight azimuths"
        )
    extra = np.ones(noise.size)
    if dof > 0:
        ratio = misfit / dof / np.maximum(noise, 1e-300)
        worse = (ratio > chi_square.ppf(0.999, dof) / dof) & (misfit / dof > 1e-24)
        extra = np.where(worse, ratio, 1.0)
        if worse.any():
            notes.append(
                f"the stops scatter {np.sqrt(extra.max()):.1f} times more than their noise (settling, drift or "
                f"the table's "
                "stopping accuracy); the sigma of A0 is enlarged by that much"
            )
    constants, tilt = [], {}
    for name, group, x, C in fitted:
        s = group[0].stretch
        harmonics = x[1:3].T if len(x) >= 3 else np.full((noise.size, 2), np.nan)
        constants.append(Constant(name, s.u, 0.0, x[0], noise * extra * C[0, 0], harmonics, 0.0, s.start))
        flat = e - (e @ s.u)[:, None] * s.u  # part of each direction that a tilt shows in
        weight = np.linalg.norm(flat, axis=1)
        if len(x) >= 3 and weight.max() > 0.1:
            tilt[name] = float(np.linalg.norm(harmonics) / (gravity * np.linalg.norm(weight)))
    return constants, tilt, notes


def _harmonics(azimuth: Array) -> Array:
    """(n, p) columns 1, cos, sin (and second ones from six different azimuths on) that the azimuths can tell apart."""
    ones = np.ones_like(azimuth)
    X = np.column_stack([ones, np.cos(azimuth), np.sin(azimuth), np.cos(2 * azimuth), np.sin(2 * azimuth)])
    different = np.unique(np.round(np.mod(azimuth, 2 * np.pi), 6)).size
    for p in ((5,) if different >= 6 else ()) + (3,) * (different >= 3):
        if np.linalg.cond(X[:, :p]) < 20.0:
            return np.asarray(X[:, :p])
    return ones[:, None]


def _missing_stops(constants: Sequence[Constant]) -> list[str]:
    rates: dict[str, set[float]] = {}
    for c in constants:
        rates.setdefault(c.position, set()).add(round(abs(c.rate), 9))
    lone = [name for name, r in rates.items() if len(r) == 1]
    spun = [name for name in lone if 0.0 not in rates[name]]
    if len(spun) == len([n for n, r in rates.items() if r != {0.0}]):
        raise InputError(
            f"no position has both stops and a spin (position {spun[0]} has no stops): add rows of kind "
            f'"still" with its '
            "gamma and beta"
        )
    if spun:
        return [f"position {', '.join(spun)} has spins but no stops: it says nothing about the levers"]
    return []


# ---- least squares ----


def weight_of(rate: float, u: Array, latitude: float | None) -> float:
    """w^2 that multiplies the design row, with the Earth's part 2 w Om sin(lat) where the latitude is known."""
    earth = 0.0 if latitude is None else WGS84.omega * np.sin(latitude)
    return float(rate * rate + 2.0 * rate * earth)


def _solve(constants: Sequence[Constant], i: int, e: Array, settings: TurntableSettings) -> Levers:
    names = list(dict.fromkeys(c.position for c in constants))
    m = len(constants)
    A = np.zeros((m, 3 + len(names)))
    y = np.empty(m)
    sigma = np.empty(m)
    for r, c in enumerate(constants):
        A[r, :3] = weight_of(c.rate, c.u, settings.latitude) * design_row(c.u, e)
        A[r, 3 + names.index(c.position)] = 1.0
        y[r] = c.value[i]
        sigma[r] = np.sqrt(c.variance[i])
    floor = 1e-13 * max(float(np.max(np.abs(y))), 1.0)  # noise-free: rounding decides
    sigma = np.maximum(sigma, floor)
    rho, cov, observable, blind, chi2, dof = _eliminate(A, y, sigma, names, constants)
    seen = np.array([design_row(c.u, e) for c in constants if c.rate != 0.0])
    positions = {c.position: design_row(c.u, e) for c in constants if c.rate != 0.0}
    singular = np.linalg.svd(np.array(list(positions.values())), compute_uv=False)
    full = len(singular) == 3 and singular[-1] > UNSEEN * singular[0]
    condition = float(singular[0] / singular[-1]) if full and len(seen) else np.inf
    if dof > 0 and chi2 > _limit(dof):
        cov = cov * (chi2 / dof)
    estimate = np.where(observable, rho, np.nan)
    covariance = np.where(np.outer(observable, observable), cov, np.nan)
    residuals = _spin_residuals(constants, i, A, rho)
    holdout = []
    for name in positions:
        keep = np.array([c.position != name for c in constants])
        if not any(c.rate != 0.0 for c, k in zip(constants, keep, strict=True) if k):
            continue
        others = [c for c, k in zip(constants, keep, strict=True) if k]
        columns = [0, 1, 2] + [3 + j for j, n in enumerate(names) if n != name]
        left, _, _, blind_left, _, _ = _eliminate(
            A[keep][:, columns], y[keep], sigma[keep], [n for n in names if n != name], others
        )
        row = positions[name]
        if blind_left.size and np.linalg.norm(row @ blind_left) > 1e-3 * np.linalg.norm(row):
            continue  # the others cannot predict it
        holdout += [r for r in _spin_residuals(constants, i, A, left) if r[0] == name]
    rho_out = estimate + np.asarray(settings.origin)
    return Levers(rho_out, covariance, observable, condition, blind, residuals, holdout, chi2, dof)


def _eliminate(
    A: Array, y: Array, sigma: Array, names: Sequence[str], constants: Sequence[Constant]
) -> tuple[Array, Array, NDArray[np.bool_], Array, float, int]:
    """Weighted least squares for rho with one free constant a position.

    Returns rho (its smallest solution), covariance, which components are observable, the directions that are not,
    chi-square of the residuals and its degrees of freedom.
    """
    B, z = A / sigma[:, None], y / sigma
    # The constants drop out by projecting each position's rows off its own column.
    for j in range(len(names)):
        col = B[:, 3 + j]
        size = float(col @ col)
        B = B - np.outer(col, (col @ B) / size) if size > 0.0 else B
        z = z - col * (col @ z) / size if size > 0.0 else z
    W = B[:, :3]
    U, s, Vt = np.linalg.svd(W, full_matrices=True)
    values = np.zeros(3)
    values[: len(s)] = s[:3]
    top = float(values[0]) if values[0] > 0.0 else 1.0
    good = values > UNSEEN * top
    inverse = np.where(good, 1.0 / np.where(good, values, 1.0), 0.0)
    V = Vt.T
    rank = int(good.sum())
    rho = V @ (inverse * np.concatenate([U.T @ z, np.zeros(3)])[:3])
    cov = (V * inverse**2) @ V.T
    blind = V[:, ~good]
    observable = np.sqrt(np.sum(blind**2, axis=1)) < 1e-3 if blind.size else np.ones(3, dtype=bool)
    residual = z - W @ rho
    # Rows of positions that have a single kind of row carry no information after the projection.
    dof = len(y) - len(names) - rank
    return rho, cov, np.asarray(observable), blind, float(residual @ residual), dof


def _spin_residuals(constants: Sequence[Constant], i: int, A: Array, rho: Array) -> list[tuple[str, float, float]]:
    out = []
    for r, c in enumerate(constants):
        if c.rate == 0.0:
            continue
        zero = [(k.value[i], k.variance[i]) for k in constants if k.position == c.position and k.rate == 0.0]
        if zero:
            out.append((c.position, c.rate, float(c.value[i] - zero[0][0] - A[r, :3] @ rho)))
    return out
