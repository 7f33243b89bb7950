"""The fixed-lag smoother: the RTS steps of `kernels.aided_smooth` over the nodes that are still held."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_engine import Engine, node_bytes, room
from schuler.aiding.aided_settings import AidedSettings
from schuler.aiding.solution import Solution

if TYPE_CHECKING:
    from schuler.aiding.aided_online import AidedFilter

Array = NDArray[np.float64]
INNER_ROOM = 256  # innovations of the vehicle's constraints in one call


def lag_bytes(n: int, lag_s: float, epochs_hz: float, settings: AidedSettings) -> float:
    """Most memory that a fixed-lag smoother of n states holds: two lags' nodes, and a second's.

    epochs_hz: distinct times of measurements a second. Beside them there is a node every node_interval, and where the
    vehicle's constraints speak.
    """
    rate = epochs_hz + 1.0 / settings.node_interval
    rate += 1.0 / settings.nhc_interval if "nhc" in settings.constraints else 0.0
    rate += 1.0 / settings.still_interval if {"zupt", "zaru"} & set(settings.constraints) else 0.0
    return (2.0 * lag_s + 2.0) * (rate + 2.0) * node_bytes(n) + 64 * node_bytes(n)


def nodes_of(nav: AidedFilter, rows: Array) -> int:
    """Most nodes that rows can give beside the measurements'."""
    s = nav.settings
    span = float(rows[-1, 0]) - nav.time
    rate = 1.0 / s.node_interval + 1.0 / s.nhc_interval + 2.0 / s.still_interval
    return min(len(rows), int(span * rate) + 1) + 1


def first_node(nav: AidedFilter, n: int) -> int:
    """The last node not later than lag_s ago."""
    times = nav.engine.kept.node_time[:n]
    return max(0, int(np.searchsorted(times, nav.time - nav.lag_s + 1e-9, side="right")) - 1)


def make_room(nav: AidedFilter, more: int) -> None:
    """Space for more nodes: those that have left the lag are dropped, and the arrays grow where that is too little."""
    e, at = nav.engine, nav._NODES
    held = e.kept
    size = len(held.node_time)
    n = int(held.counts[at])
    if n + more <= size:
        return
    first = first_node(nav, n) if n else 0
    keep = n - first
    old = (*held.nodes, held.node_time, held.node_std)
    if keep + more > 0.75 * size:
        new = room(e.layout.n, inner=INNER_ROOM, nodes=int(1.5 * (keep + more)) + 16)
        new.counts[:] = held.counts
        for a, b in zip((*new.nodes, new.node_time, new.node_std), old, strict=True):
            a[:keep] = b[first:n]
        e.kept = new
    else:
        for a in old:
            a[:keep] = a[first:n].copy()
    e.kept.counts[at] = keep
    for mark in (*nav._marks, *((nav._undo,) if nav._undo is not None else ())):
        mark.nodes -= first


def window(engine: Engine, first: int, n: int) -> Solution:
    """Nodes first .. n smoothed, a row each; after the last node nothing was heard: the filter is the smoother there.

    Works on copies: the filter goes on as if nobody had asked.
    """
    from schuler.ground.frames import dcm_from_quat, euler_from_dcm
    from schuler.kernels import aided_state as k
    from schuler.kernels.aided_run import covariances
    from schuler.kernels.aided_smooth import smooth

    kept, size, count = engine.kept, engine.layout.n, n - first
    if count < 1:
        x, cov, time = engine.x[None, :].copy(), engine.P[None].copy(), engine.x[k.T : k.T + 1].copy()
        d = engine.dx.copy()
        k.correct(x[0], engine.layout.ie, d)
    else:
        nodes = tuple(a[first:n].copy() for a in kept.nodes)
        smooth(0, count, engine.layout.ie, nodes, np.zeros((count, size)), np.zeros((count, size)))
        x, cov, time = nodes[2], nodes[3], kept.node_time[first:n].copy()
    pos, vel, att = (np.zeros((len(time), 3, 3)) for _ in range(3))
    for i in range(len(time)):
        covariances(x[i], cov[i], pos[i], vel[i], att[i])
    rpy = np.column_stack(euler_from_dcm(dcm_from_quat(x[:, k.QUAT : k.QUAT + 4])))
    lat, lon, height = (x[:, i].copy() for i in (k.LAT, k.LON, k.HGT))
    return Solution(time, lat, lon, height, x[:, k.VEL : k.VEL + 3].copy(), rpy, pos, vel, att)
