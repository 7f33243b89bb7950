"""The aided filter's arrays and the calls of its kernels: what batch, online filter and alignment in motion share."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_rows import Events
from schuler.aiding.aided_settings import AidedSettings, Layout, configuration
from schuler.ground.errors import InputError

Array = NDArray[np.float64]
SMOOTHER_BYTES = 3e9


@dataclass
class StartState:
    """Where a filter begins: time s, q_nb (4), v_n (3), lat, lon rad, height m; cov (9, 9) of (phi, dv, dr NED m).

    gyro_bias, gyro_bias_std (3,): where the start knows them better than the datasheet. level_from_force: the level
    came from the accelerometers, whose bias it therefore holds. slow (3,) m: how much of the position's error is the
    slow one of the fix that it was read from. sea: m, where the height was read from a depth below an unknown surface.
    """

    time: float
    q_nb: Array
    v_n: Array
    lat: float
    lon: float
    height: float
    cov: Array
    gyro_bias: Array | None = None
    gyro_bias_std: Array | None = None
    level_from_force: bool = True
    notes: list[str] = field(default_factory=list)
    slow: Array | None = None
    sea: float | None = None


@dataclass
class Kept:
    """What a run writes. Lengths bound what is kept; counts: rows, measurements, rows out, constraints, nodes."""

    ox: Array
    cov: tuple[Array, Array, Array]
    innov: Array
    inner: tuple[Array, NDArray[np.int64], Array]
    nodes: tuple[Array, ...]
    node_time: Array
    node_std: Array
    counts: NDArray[np.int64]


def node_bytes(n: int) -> int:
    """Memory of one node: two nominal states and one handed out, two covariances, the transition's rows, time, and six
    times n: two open-loop errors, two corrections, sigmas of filter and smoother."""
    from schuler.kernels import aided_state as k

    return 8 * (3 * k.KEPT + 2 * n * n + (k.NAV + 1) * n + 6 * n + 1)


def room(n: int, *, rows: int = 0, events: int = 0, inner: int = 0, nodes: int = 0, stds: int = 0) -> Kept:
    """Empty arrays for a run: rows of the solution, measurements, constraints, nodes (0: no smoother) and sigmas."""
    from schuler.kernels import aided_run as r
    from schuler.kernels import aided_state as k
    from schuler.kernels.aided_update import INNOVATION

    return Kept(
        ox=np.zeros((rows, r.OUT)),
        cov=(np.zeros((rows, 3, 3)), np.zeros((rows, 3, 3)), np.zeros((rows, 3, 3))),
        innov=np.full((events, 2, INNOVATION), np.nan),
        inner=(np.zeros(inner), np.zeros(inner, np.int64), np.zeros((inner, INNOVATION))),
        nodes=(
            np.zeros((nodes, k.KEPT)), np.zeros((nodes, n, n)), np.zeros((max(nodes, stds), k.KEPT)),
            np.zeros((nodes, n, n)), np.zeros((nodes, k.NAV + 1, n)), np.zeros((nodes, n)),
            np.zeros((max(nodes, stds), n)),
        ),
        node_time=np.zeros(max(nodes, stds)),
        node_std=np.zeros((max(nodes, stds), n)),
        counts=np.zeros(6, np.int64),
    )  # fmt: skip


class Engine:
    """One filter: its state and covariance, and the scratch of its kernels."""

    def __init__(self, settings: AidedSettings, layout: Layout, interval: float) -> None:
        from schuler.kernels import aided_state as k

        n = layout.n
        self.settings, self.layout = settings, layout
        self.c = configuration(settings, interval)
        self.x = np.zeros(k.NX)
        self.P = np.zeros((n, n))
        self.S = np.eye(n)
        self.dec, self.qd = np.ones(n), np.zeros(n)
        self.dx = np.zeros(n)
        self.ring = np.zeros((k.RING, k.RING_W))
        self.work = np.zeros((2, k.NAV, n))
        model = settings.height_model
        # without a height model one that covers nothing
        self.world = (np.ones(4), np.full((2, 2), np.nan)) if model is None else (model.grid, model.heights)
        self.kept = room(n)

    def begin(self, start: StartState) -> None:
        """State and covariance of a start."""
        from schuler.kernels import aided_state as k
        from schuler.kernels.aided_propagate import refresh_earth

        s, lay, x = self.settings, self.layout, self.x
        x[:] = 0.0
        x[k.QUAT : k.QUAT + 4] = start.q_nb
        x[k.VEL : k.VEL + 3] = start.v_n
        x[k.LAT], x[k.LON], x[k.HGT] = start.lat, start.lon, start.height
        p = k.PAR
        for slot, arm in ((k.ANT, s.antenna), (k.DVL, s.dvl_arm), (k.SPD, s.speed_arm)):
            x[p + slot : p + slot + 3] = arm
        x[p + k.TG], x[p + k.TV] = s.gnss_delay, s.velocity_delay
        x[p + k.DB] = start.height if "depth_bias" in lay.names else 0.0  # at the surface; the first depths tell
        x[k.TNODE] = start.time - self.c[k.NODE_DT]  # the first row ends a node: the smoother begins there
        x[k.T] = x[k.TROW] = x[k.TNHC] = x[k.TSTILL] = x[k.TOLD] = x[k.TSEEN] = start.time
        x[k.BADH] = x[k.BADV] = x[k.BADS] = -1e300
        x[k.NEXT] = start.time
        x[k.ROWS] = 0.0
        self.c[k.T0] = start.time
        refresh_earth(x)
        P = self.P
        P[:, :] = 0.0
        P[np.arange(k.NAV, lay.n), np.arange(k.NAV, lay.n)] = lay.std[k.NAV :] ** 2
        P[: k.NAV, : k.NAV] = start.cov
        b = lay.ie[k.BG]
        if start.gyro_bias is not None:
            x[p + k.BG : p + k.BG + 3] = start.gyro_bias
            if b >= 0 and start.gyro_bias_std is not None:
                sd = np.minimum(start.gyro_bias_std, lay.std[b : b + 3])
                P[np.arange(b, b + 3), np.arange(b, b + 3)] = sd**2
        a = lay.ie[k.BA]
        if start.level_from_force and a >= 0:
            self._level_holds_bias(a)
        self._place_holds_bias(start)
        self.S[:, :] = np.eye(lay.n)
        self.dx[:] = 0.0

    def _place_holds_bias(self, start: StartState) -> None:
        """A position read off a fix errs with its slow error: dr = fix error, estimate of that 0: cov(dr, GB) = -s^2.

        A height read off a depth below a surface 0 +- sea: dr_D = -(surface's error).
        """
        from schuler.kernels import aided_state as k

        P, b, z = self.P, self.layout.ie[k.GB], self.layout.ie[k.DB]
        if start.slow is not None and b >= 0:
            for i in range(3):
                P[k.DR + i, b + i] = P[b + i, k.DR + i] = -min(start.slow[i] ** 2, P[b + i, b + i])
        if start.sea is not None and z >= 0:
            self.x[k.PAR + k.DB] = 0.0
            P[z, z] = start.sea**2
            P[k.DR + 2, z] = P[z, k.DR + 2] = -(start.sea**2)

    def _level_holds_bias(self, a: int) -> None:
        """A level read off the accelerometers errs with their bias: phi_E = (C db)_N / g, phi_N = -(C db)_E / g."""
        from schuler.ground.frames import dcm_from_quat
        from schuler.kernels import aided_state as k

        C_nb = np.asarray(dcm_from_quat(self.x[k.QUAT : k.QUAT + 4]))
        J = np.vstack([-C_nb[1], C_nb[0], np.zeros(3)]) / self.x[k.GRAV]
        bias = self.P[a : a + 3, a : a + 3]
        self.P[:3, :3] += J @ bias @ J.T
        self.P[:3, a : a + 3] = J @ bias
        self.P[a : a + 3, :3] = (J @ bias).T

    def clone(self) -> Engine:
        """A copy that goes its own way (without what was kept)."""
        other = Engine.__new__(Engine)
        other.settings, other.layout, other.world = self.settings, self.layout, self.world
        for name in ("c", "x", "P", "S", "dec", "qd", "dx", "ring", "work"):
            setattr(other, name, getattr(self, name).copy())
        other.kept = room(self.layout.n)
        return other

    def run(self, rows: Array, still: NDArray[np.bool_], events: Events, out_dt: float, inside: bool = False) -> int:
        """Over rows and events from where the counts stand; 1 where the next measurement is the caller's to make."""
        from schuler.kernels.aided_run import run

        k = self.kept
        return int(
            run(
                self.x, self.P, self.S, self.dec, self.qd, self.layout.beta, self.layout.noise, self.layout.ie, self.c,
                self.dx, self.ring, self.world, self.work, rows, still, events.time, events.kind, events.z, out_dt,
                k.ox, *k.cov, k.innov, *k.inner, k.nodes, k.node_time, k.node_std, k.counts, inside,
            )
        )  # fmt: skip

    def check(self) -> None:
        """InputError where the filter lost its numbers."""
        from schuler.kernels import aided_state as k

        if not (np.isfinite(self.x[: k.NOMINAL]).all() and np.isfinite(np.diag(self.P)).all()):
            raise InputError(
                "the filter lost its numbers; the input holds values far outside any vehicle (schuler check)"
            )


def max_nodes(settings: AidedSettings, events: Events, span: float) -> int:
    """How many nodes a run over `span` seconds can have."""
    nodes = len(np.unique(events.time)) + span / settings.node_interval
    if "nhc" in settings.constraints:
        nodes += span / settings.nhc_interval
    if "zupt" in settings.constraints or "zaru" in settings.constraints:
        nodes += span / settings.still_interval
    return int(min(nodes, 1e9) * 1.02) + 64


def rows_out(rows: Array, start: float, out_dt: float) -> int:
    """How many rows of the solution a run can give."""
    if out_dt <= 0.0:
        return len(rows) + 1
    span = float(rows[-1, 0]) - start
    return min(len(rows) + 1, int(min(span / out_dt, inf) * 1.01) + 8)
