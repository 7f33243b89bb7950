"""What can be wrong with a turntable recording, said in one sentence each."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from schuler.calibration.stretches import Stretch, rows_inside
from schuler.ground.errors import InputError

Array = NDArray[np.float64]
_HELD = 0.01  # share of the rate that a second of a spin may be off
_AWAY = np.deg2rad(12.0)  # of a direction: more is a wrong axis, not a misalignment
_STILL = np.deg2rad(0.1)  # rad/s between stops
_WARM = 1.0  # degC over a recording


def temperature(time: Array, degrees: Array) -> list[str]:
    """A note where the sensor was still warming up."""
    ok = np.isfinite(degrees)
    if ok.sum() < 10:
        return []
    edge = max(int(ok.sum()) // 20, 1)
    first, last = float(np.mean(degrees[ok][:edge])), float(np.mean(degrees[ok][-edge:]))
    if abs(last - first) < _WARM:
        return []
    return [
        f"the temperature went from {first:.1f} to {last:.1f} degC during the recording, biases drift with it; let the "
        "instrument warm up until it is steady, then record again"
    ]


def saturated(time: Array, outputs: Array, stretches: Sequence[Stretch]) -> None:
    """InputError where an accelerometer sits at its largest value for five rows or more, again and again."""
    rows = {s.row: slice(*_rows(time, s)) for s in stretches}
    spread = {s.row: np.ptp(outputs[rows[s.row]], axis=0) for s in stretches}
    noisy = float(np.median(np.array(list(spread.values())))) > 1e-6
    for s in stretches:
        for i in range(outputs.shape[1]):
            y = outputs[rows[s.row], i]
            if y.size >= 50 and np.ptp(y) == 0.0 and noisy:
                raise InputError(
                    f"accelerometer {_axis(i)} gives {y[0]:.4g} m/s^2 in every row of the {s.name}: it is saturated or "
                    "stuck; use a wider range"
                )
            if y.size < 50 or np.ptp(y) == 0.0:
                continue
            for edge, word in ((y.max(), "largest"), (y.min(), "smallest")):
                at = y == edge
                if at.mean() < 0.02 or len(np.unique(y[:: max(y.size // 2000, 1)])) < 16:
                    continue
                runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(int))))[::2]
                if runs.max() >= 5:
                    raise InputError(
                        f"accelerometer {_axis(i)} stays at its {word} value, {edge:.4g} m/s^2, for "
                        f"{int(at.sum())} rows of the "
                        f"{s.name}: it is saturated there; spin slower or use a wider range"
                    )


def _rows(time: Array, s: Stretch) -> tuple[int, int]:
    return rows_inside(time, s, float(np.median(np.diff(time[:1000]))))


def _axis(i: int) -> str:
    return "xyz"[i] if i < 3 else str(i + 1)


def _mean(time: Array, values: Array, s: Stretch) -> Array:
    first, last = _rows(time, s)
    return np.asarray(values[first:last].mean(axis=0)) if last > first else np.full(values.shape[1], np.nan)


def _blocks(time: Array, values: Array, s: Stretch, length: float) -> tuple[Array, Array]:
    """(times of the middles, means) of consecutive blocks of `length` s."""
    first, last = _rows(time, s)
    t, v = time[first:last], values[first:last]
    count = max(int((s.end - s.start) / length), 1)
    cut = np.unique(np.linspace(0, len(t), count + 1).astype(int))
    means = np.array([v[a:b].mean(axis=0) for a, b in zip(cut[:-1], cut[1:], strict=True)])
    return np.array([0.5 * (t[a] + t[b - 1]) for a, b in zip(cut[:-1], cut[1:], strict=True)]), means


def still(time: Array, gyro: Array, outputs: Array, stills: Sequence[Stretch], gravity: float) -> None:
    """InputError for a stop during which the gyros or accelerometers moved."""
    means = np.array([_mean(time, gyro, s) for s in stills])
    usual = np.nanmedian(means, axis=0)
    spread = 1.4826 * np.nanmedian(np.abs(means - usual), axis=0)
    quiet = np.median([np.std(outputs[slice(*_rows(time, s))], axis=0) for s in stills], axis=0)
    for s, mean in zip(stills, means, strict=True):
        off = np.abs(mean - usual)
        blocks = _blocks(time, gyro, s, max(1.0, (s.end - s.start) / 60.0))[1]
        scatter = 1.4826 * np.median(np.abs(blocks - np.median(blocks, axis=0)), axis=0)
        jump = np.max(np.abs(blocks - np.median(blocks, axis=0)), axis=0)
        moving = np.std(outputs[slice(*_rows(time, s))], axis=0)
        if np.any(off > _STILL + 8.0 * spread) or np.any(jump > 5.0 * _STILL + 8.0 * scatter):
            raise InputError(
                f"the {s.name} was not still: its gyros turn by up to "
                f"{np.rad2deg(max(off.max(), jump.max())):.2f} deg/s; move "
                "start[s] and end[s] to where the table stands"
            )
        if np.any(moving > 6.0 * quiet + 2e-3 * gravity):
            raise InputError(
                f"the {s.name} was not still: an accelerometer scatters by {moving.max():.3g} m/s^2, usual is "
                f"{quiet[int(np.argmax(moving))]:.3g}; move start[s] and end[s], or find what shakes the table"
            )


def rates(time: Array, gyro: Array, spins: Sequence[Stretch], stills: Sequence[Stretch]) -> None:
    """InputError for axes that do not fit the plan, a wrong rate or sign, a rate that was not held."""
    rest = np.mean([_mean(time, gyro, s) for s in stills], axis=0)
    seen = {s: _mean(time, gyro, s) - rest for s in spins}
    wrong = [s for s in spins if _angle(seen[s], s.rate * s.u) > _AWAY]
    if wrong:
        s = wrong[0]
        if len(wrong) == len(spins) and all(_angle(-seen[k], k.rate * k.u) < _AWAY for k in spins):
            raise InputError(
                "every spin shows the opposite sense: the gyros are flipped or rate[deg/s] has the wrong sign "
                "(positive is "
                "counter-clockwise seen from above)"
            )
        found = _permutation([seen[k] for k in spins], [k.rate * k.u for k in spins])
        more = f"; it fits if the recording's axes are {found}: reorder the columns" if found else ""
        raise InputError(
            f"the {s.name} turns about {_vector(seen[s])} of the gyros, the plan says {_vector(s.rate * s.u)}: "
            f"axes swapped or "
            f"flipped, or a wrong gamma or beta{more}"
        )
    for s in spins:
        along = float(seen[s] @ s.u)
        if abs(along / s.rate - 1.0) > 0.05:
            raise InputError(
                f"the {s.name}: the gyros show {np.rad2deg(along):.3f} deg/s where the plan says "
                f"{np.rad2deg(s.rate):.3f}; "
                "correct rate[deg/s], or the gyros' unit"
            )
        times, parts = _blocks(time, gyro, s, max(1.0, (s.end - s.start) / 200.0))
        means = parts @ s.u
        usual = float(np.median(means))
        scatter = 1.4826 * float(np.median(np.abs(means - usual)))
        off = np.abs(means - usual) > _HELD * abs(s.rate) + 8.0 * scatter
        if off.any():
            good = np.flatnonzero(~off)
            runs = np.split(good, np.flatnonzero(np.diff(good) > 1) + 1)
            longest = max(runs, key=len)
            raise InputError(
                f"the {s.name}: the table did not hold its rate, {int(off.sum())} of {off.size} parts are more than "
                f"{100 * _HELD:g} % off (worst "
                f"{np.rad2deg(means[int(np.argmax(np.abs(means - usual)))] - rest @ s.u):.2f} deg/s at "
                f"{times[int(np.argmax(np.abs(means - usual)))]:.0f} s); it held from {times[longest[0]]:.0f} to "
                f"{times[longest[-1]]:.0f} s: set start[s] and end[s] to that"
            )


def gravity(time: Array, outputs: Array, stills: Sequence[Stretch], e: Array, g: float) -> None:
    """InputError where gravity at the stops is not where gamma and beta put it."""
    if len(e) < 3 or np.linalg.matrix_rank(e, tol=1e-3) < 3:
        return
    to_force = np.linalg.pinv(e)
    for s in stills:
        f = to_force @ _mean(time, outputs, s)
        if _angle(f, s.u) > _AWAY:
            found = _permutation([to_force @ _mean(time, outputs, k) for k in stills], [g * k.u for k in stills])
            more = f"; it fits if the recording's axes are {found}: reorder the columns" if found else ""
            raise InputError(
                f"the {s.name}: the accelerometers put up at {_vector(f)}, gamma and beta say {_vector(s.u)}: "
                f"axes swapped or "
                f"flipped, or a wrong gamma or beta{more}"
            )


def spins(rows: Sequence[Stretch], *, earth_known: bool = False) -> list[str]:
    """Notes on unequal spins: what both directions would have cancelled."""
    by: dict[str, list[Stretch]] = {}
    for s in rows:
        by.setdefault(s.position, []).append(s)
    one, unequal = [], []
    for name, group in by.items():
        left, right = (sum(s.end - s.start for s in group if sign * s.rate > 0) for sign in (1, -1))
        sizes = {round(abs(s.rate), 6) for s in group}
        if left == 0.0 or right == 0.0:
            one.append(name)
        elif abs(left - right) > 0.1 * max(left, right) or len(sizes) > 1:
            unequal.append(name)
    notes = []
    if one and not earth_known:
        w = min(abs(s.rate) for s in rows)
        notes.append(
            f"position {', '.join(one)} spins one way only: the Earth's rate stays in, up to "
            f"{200.0 * 7.292115e-5 / w:.3f} % of a "
            "lever; spin both ways, or set lat_deg"
        )
    if unequal:
        notes.append(
            f"position {', '.join(unequal)}: the two spins differ in length or rate; each is weighted by itself"
        )
    return notes


def _angle(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _vector(v: Array) -> str:
    n = float(np.linalg.norm(v))
    return "(" + ", ".join(f"{x:.2f}" for x in v / (n if n > 0.0 else 1.0)) + ")"


def _permutation(seen: Sequence[Array], wanted: Sequence[Array]) -> str:
    """The signed order of axes that explains everything seen, as "(x, -z, y)"; "" where none does."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            if all(_angle(np.array(signs) * a[list(order)], b) < _AWAY for a, b in zip(seen, wanted, strict=True)):
                return (
                    "(" + ", ".join(("-" if s < 0 else "") + "xyz"[o] for o, s in zip(order, signs, strict=True)) + ")"
                )
    return ""
