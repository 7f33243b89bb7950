"""Alignment in motion: filters with headings all round run side by side until the fixes leave one of them.

The one that is left began up to 15 deg wrong and without its biases, which a linear filter pays for with a level that
is surer than it is right. So it runs again, linearised where its own smoother says it should have begun, until that
moves no more. The winner at the end of its window is the start: nothing is told of the track before.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_engine import Engine, StartState, max_nodes, room
from schuler.aiding.aided_places import Places, attitude_of, mean_force, turned
from schuler.aiding.aided_rows import Events
from schuler.aiding.aided_settings import AidedSettings, Layout
from schuler.ground.earth import wrap_pi
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler

if TYPE_CHECKING:
    from schuler.aiding.aided_start import Stretch

Array = NDArray[np.float64]
BANK = 12  # competing headings
WINDOWS_S = (8.0, 15.0, 30.0, 60.0, 120.0, 240.0)
SURE = 0.2  # rad
UNSURE = 0.5  # rad: no start with less
BETTER = 18.0  # 2 log-likelihood by which the best heading must beat the others
NUMBERS = 40  # read off fixes: with fewer the 15 unknowns of a start fit too many headings
AS_GOOD = 6.0  # less than this is no difference
MOVING_STD = 0.08  # rad: of a level read off in motion
BLIND_STD = 0.25  # rad: the same without knowing the acceleration
AGAIN = 4
SETTLED = 2e-3  # rad: the attitude at the beginning moves no more


def in_motion(
    rows: Array, still: NDArray[np.bool_], events: Events, s: AidedSettings, layout: Layout, place: Places,
    stretch: Stretch | None, interval: float, *, live: bool = False,
) -> tuple[StartState, Engine]:  # fmt: skip
    """The start and its engine. live: the tables end now, and what is not sure yet is worth waiting for."""
    first = _first(rows, s, place, stretch)
    starts = _starts(rows, first, place, stretch)
    bank = [_begun(start, s, layout, interval) for start in starts]
    last = first + WINDOWS_S[-1]
    keep = (rows[:, 0] > first + 1e-9) & (rows[:, 0] <= last)
    rows, still = np.ascontiguousarray(rows[keep]), still[keep]
    if len(rows) < 2:
        raise InputError(f"the fixes begin at {first:.2f} s, where the imu ends: there is nothing to align on")
    events = _known(events, first, float(rows[-1, 0]))
    for engine in bank:
        engine.kept = room(layout.n, events=len(events), inner=1)
    until, best, lead, told = first, 0, 0.0, False
    headings, sigmas, costs = np.zeros(BANK), np.zeros(BANK), np.zeros(BANK)
    for window in WINDOWS_S:
        until = min(first + window, float(rows[-1, 0]))
        upto = int(np.searchsorted(rows[:, 0], until + 1e-9))
        for i, engine in enumerate(bank):
            engine.run(rows[:upto], still[:upto], events, 1.0)
            costs[i], headings[i], sigmas[i] = _cost(engine)
        costs = np.where(np.isfinite(costs), costs, np.inf)
        best = int(np.argmin(costs))
        others = np.abs(wrap_pi(headings - headings[best])) > max(0.35, 3.0 * sigmas[best])
        lead = float(np.min(np.where(others, costs, np.inf))) - float(costs[best])
        told = _numbers(bank[best]) >= NUMBERS
        if (told and sigmas[best] < SURE and lead > BETTER) or until >= rows[-1, 0]:
            break
    sure = told and math.isfinite(costs[best]) and sigmas[best] < (SURE if live else UNSURE)
    if not sure or not lead > (BETTER if live else AS_GOOD):
        why = "two headings fit alike" if sure else f"1 sigma {math.degrees(sigmas[best]):.0f} deg"
        why = why if told else f"fixes gave {_numbers(bank[best])} numbers, it takes {NUMBERS}"
        raise InputError(
            f"the heading could not be found from the motion within {until - first:.0f} s ({why}): it takes "
            'accelerations that the fixes see; type [start] heading_deg, or [filter] constraints = ["nhc"] for a '
            "vehicle that follows its nose"
        )
    upto = int(np.searchsorted(rows[:, 0], until + 1e-9))
    refined = _again(starts[best], s, layout, interval, rows[:upto], still[:upto], events)
    return _found(refined if refined is not None else bank[best], s, first, until, lead)


def _first(rows: Array, s: AidedSettings, place: Places, stretch: Stretch | None) -> float:
    """Where the filters begin: the first fix with a velocity, after the vehicle stood."""
    first = float(rows[0, 0]) + 0.3
    if s.start.time is not None:
        first = max(first, s.start.time)
    known = np.isfinite(place.v).all(axis=1)
    good = (place.time >= first - 1e-9) & known
    if stretch is not None:
        with np.errstate(invalid="ignore"):
            moving = np.flatnonzero((place.time > stretch.to) & known & (np.linalg.norm(place.v, axis=1) > 0.7))
        from_t = max(stretch.to, float(place.time[moving[0]]) - 1.0) if len(moving) else stretch.to
        good &= place.time >= from_t - 1e-9
    at = np.flatnonzero(good)
    if not len(at):
        raise InputError(
            "the heading cannot be found: the fixes after the imu's start never tell a velocity (it takes two of them "
            "within 5 s, or their own); type [start] heading_deg"
        )
    i = int(at[0])
    # the level wants the acceleration, which takes a second velocity
    if len(at) > 1 and place.acceleration(float(place.time[i])) is None:
        j = int(at[1])
        if place.acceleration(float(place.time[j])) is not None:
            i = j
    return float(place.time[i])


def _starts(rows: Array, first: float, place: Places, stretch: Stretch | None) -> list[StartState]:
    spread = 2.0 * math.pi / BANK
    accel = place.acceleration(first)
    sd = MOVING_STD if accel is not None else BLIND_STD
    C = attitude_of(mean_force(rows, first, 1.0), accel if accel is not None else np.zeros(3), 0.0)
    bias = bias_std = None
    if stretch is not None:
        bias, bias_std = stretch.bias, stretch.bias_std
        if first - stretch.to < 60.0:
            i = place.fix(first)
            lat = float(place.gnss["lat"][i]) if i is not None else 0.0
            level = np.asarray(dcm_from_euler(stretch.rpy[0], stretch.rpy[1], 0.0))
            C = turned(rows, level, stretch.to, first, bias, lat)
            sd = stretch.level_std(first)
    cov = np.diag([sd**2, sd**2, (0.6 * spread) ** 2])
    return [
        place.state_at(first, np.asarray(dcm_from_euler(0.0, 0.0, i * spread)) @ C, cov, bias=bias, bias_std=bias_std)
        for i in range(BANK)
    ]


def _begun(start: StartState, s: AidedSettings, layout: Layout, interval: float, *, open_loop: bool = False) -> Engine:
    engine = Engine(replace(s, gate=False, open_loop=open_loop), layout, interval)
    engine.begin(start)
    return engine


def refresh(x: Array) -> None:
    """Earth's figures at a nominal state that was moved."""
    from schuler.kernels.aided_propagate import refresh_earth

    refresh_earth(x)


def _known(events: Events, since: float, to: float) -> Events:
    """What the bank may use: the caller's own sensors wait."""
    from schuler.kernels.aided_run import USER

    keep = (events.kind < USER) & (events.time > since) & (events.time <= to)
    return Events(events.time[keep], events.kind[keep], np.ascontiguousarray(events.z[keep]))


def _again(
    start: StartState, s: AidedSettings, layout: Layout, interval: float, rows: Array, still: NDArray[np.bool_],
    events: Events,
) -> Engine | None:  # fmt: skip
    """The winner, linearised where its own smoother says it should have begun: Gauss-Newton over the window.

    The nominal state runs free from there and the error beside it (open loop) begins at its distance from the prior,
    so that the prior counts once. None where that does not settle.
    """
    from schuler.kernels import aided_state as k
    from schuler.kernels.aided_smooth import smooth

    span = float(rows[-1, 0]) - start.time
    nodes = max_nodes(s, events, span)
    prior = _begun(start, s, layout, interval).x
    origin, step = prior.copy(), math.inf
    for attempt in range(AGAIN + 1):
        engine = _begun(replace(start, q_nb=origin[k.QUAT : k.QUAT + 4].copy()), s, layout, interval, open_loop=True)
        engine.x[: k.NOMINAL] = origin[: k.NOMINAL]
        refresh(engine.x)
        k.difference(engine.x, prior, layout.ie, engine.dx)
        last = attempt == AGAIN or step < SETTLED
        engine.kept = room(layout.n, events=len(events), inner=1, nodes=0 if last else nodes)
        engine.run(rows, still, events, 1.0)
        if last:
            break
        n = min(int(engine.kept.counts[4]), nodes)
        if n < 2:
            return None
        kept = tuple(a[:n] for a in engine.kept.nodes)
        dpre, dpost = np.zeros((n, layout.n)), np.zeros((n, layout.n))
        smooth(0, n, layout.ie, kept, dpre, dpost)
        d = dpre[0] + kept[5][0]
        step = float(np.linalg.norm(d[:3]))
        if not np.isfinite(d).all() or step > 1.0:
            return None
        k.correct(origin, layout.ie, d)
    if not np.isfinite(engine.dx).all() or float(np.linalg.norm(engine.dx[:3])) > 0.5:
        return None
    k.correct(engine.x, layout.ie, engine.dx)
    engine.dx[:] = 0.0
    refresh(engine.x)
    engine.c[k.OPEN_LOOP] = 0.0
    return engine


def _found(engine: Engine, s: AidedSettings, first: float, until: float, lead: float) -> tuple[StartState, Engine]:
    """The engine as one that begins now, and the start that it is."""
    from schuler.kernels import aided_state as k

    _, heading, sigma = _cost(engine)
    engine = engine.clone()
    engine.settings = s
    x = engine.x
    engine.c[k.GATE], engine.c[k.OPEN_LOOP] = float(s.gate), float(s.open_loop)
    engine.c[k.T0] = x[k.T]
    x[k.NEXT] = x[k.T]
    x[k.TNODE] = x[k.T] - engine.c[k.NODE_DT]  # the first row ends a node: the smoother begins there
    x[k.BADH] = x[k.BADV] = x[k.BADS] = -1e300
    x[k.HARD : k.NEXT] = 0.0
    engine.S[:, :] = np.eye(engine.layout.n)
    note = (
        f"heading found in motion: {BANK} headings compared from {first:.1f} to {until:.1f} s, "
        f"{math.degrees(heading) % 360.0:.1f} deg (1 sigma {math.degrees(sigma):.1f} deg) at the end; navigation "
        "begins there"
    )
    if lead < BETTER:
        note += "; another heading fits nearly as well: type [start] heading_deg if it is known"
    return StartState(
        float(x[k.T]), x[k.QUAT : k.QUAT + 4].copy(), x[k.VEL : k.VEL + 3].copy(), float(x[k.LAT]), float(x[k.LON]),
        float(x[k.HGT]), engine.P[:9, :9].copy(), notes=[note],
    ), engine  # fmt: skip


def _numbers(engine: Engine) -> int:
    """How many scalar readings a filter took in."""
    done = int(engine.kept.counts[1])
    return int(np.nansum(engine.kept.innov[:done, :, 7]))


def _cost(engine: Engine) -> tuple[float, float, float]:
    """-2 log-likelihood of what a filter measured so far; its heading and sigma."""
    from schuler.kernels import aided_state as k
    from schuler.kernels.rotation import euler_from_quat

    done = int(engine.kept.counts[1])
    rows = engine.kept.innov[:done].reshape(-1, engine.kept.innov.shape[2])
    rows = rows[np.isfinite(rows[:, 6])]
    std = rows[:, 3:6]
    cost = float(rows[:, 6].sum() + 2.0 * np.log(std[np.isfinite(std) & (std > 0)]).sum())
    q = engine.x[k.QUAT : k.QUAT + 4]
    heading = euler_from_quat(q[0], q[1], q[2], q[3])[2]
    return cost, float(heading), math.sqrt(max(float(engine.P[2, 2]), 0.0))
