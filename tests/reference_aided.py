"""A readable error-state filter for simulated recordings, slow and plain: what the compiled one is held against.

Nodes of 0.1 s: the strapdown of `inertial` carries the track, the matrices are means over a node. Every measurement is
a function of the whole state whose Jacobian is taken by differences, so that nothing here shares a derivation with the
kernels. State: phi, dv, position error (NED, m), then named scalars; error = estimate - truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from schuler.ground.earth import WGS84
from schuler.ground.frames import (
    dcm_from_euler,
    dcm_from_quat,
    quat_from_euler,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_dcm,
)
from schuler.inertial.strapdown import Start, Strapdown

XYZ = ("x", "y", "z")


def skew(a):
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass
class Scalar:
    """A further state: prior sigma, Gauss-Markov time constant (None: constant or walk), walk per sqrt(s), value."""

    std: float
    tau: float | None = None
    walk: float = 0.0
    value: float = 0.0


@dataclass
class Nominal:
    """What a measurement function sees."""

    lat: float
    lon: float
    height: float
    v_n: np.ndarray
    q: np.ndarray
    states: dict[str, float]
    w_eb: np.ndarray  # rate of the body against the Earth, b
    a_n: np.ndarray  # acceleration, n

    def get(self, *names: str) -> np.ndarray:
        return np.array([self.states.get(n, 0.0) for n in names])

    @property
    def C(self) -> np.ndarray:
        """n <- b."""
        return dcm_from_quat(self.q)

    @property
    def C_nv(self) -> np.ndarray:
        """n <- the vehicle's own axes: the body turned by the mounting."""
        mounting = dcm_from_euler(*self.get("mounting_roll", "mounting_pitch", "mounting_yaw"))
        return self.C @ mounting.T

    def moved(self, dx: np.ndarray, names: list[str]) -> Nominal:
        """The state less an error dx."""
        R_N, R_E = (float(r) for r in WGS84.radii(self.lat))
        lat = self.lat - dx[6] / (R_N + self.height)
        lon = self.lon - dx[7] / ((R_E + self.height) * math.cos(self.lat))
        q = quat_multiply(quat_from_rotvec(dx[:3]), self.q)  # C = (I + [phi x]) C_hat
        states = {n: v - dx[9 + names.index(n)] if n in names else v for n, v in self.states.items()}
        return Nominal(lat, lon, self.height + dx[8], self.v_n - dx[3:6], q, states, self.w_eb, self.a_n)


@dataclass
class History:
    time: list = field(default_factory=list)
    nominal: list = field(default_factory=list)
    P: list = field(default_factory=list)
    nis: dict = field(default_factory=dict)


def ned_from(n: Nominal, origin) -> np.ndarray:
    R_N, R_E = (float(r) for r in WGS84.radii(origin[0]))
    h = origin[2]
    return np.array(
        [(n.lat - origin[0]) * (R_N + h), (n.lon - origin[1]) * (R_E + h) * math.cos(origin[0]), h - n.height]
    )


def antenna(default):
    """The lever of a state: estimated or as typed."""

    def lever(n: Nominal) -> np.ndarray:
        return np.array([n.states.get(f"antenna_lever_{a}", d) for a, d in zip(XYZ, default, strict=True)])

    return lever


def gnss_position(origin, lever):
    """NED metres about `origin` of the antenna, `gnss_delay` earlier, with the receiver's slow error."""

    def h(n: Nominal) -> np.ndarray:
        tau = float(n.get("gnss_delay")[0])
        C = n.C @ (np.eye(3) - tau * skew(n.w_eb))
        r = ned_from(n, origin) - tau * n.v_n + 0.5 * tau**2 * n.a_n + C @ lever(n)
        return r + n.get("gnss_bias_north", "gnss_bias_east", "gnss_bias_down")

    return h


def gnss_velocity(lever):
    def h(n: Nominal) -> np.ndarray:
        tau = float(n.get("gnss_delay")[0])
        C = n.C @ (np.eye(3) - tau * skew(n.w_eb))
        return n.v_n - tau * n.a_n + C @ np.cross(n.w_eb, lever(n))

    return h


def axial(n: Nominal) -> np.ndarray:
    through = n.v_n - np.array([*n.get("current_north", "current_east"), 0.0])
    return (1.0 + n.get("speed_scale")) * (n.C_nv.T @ through)[:1]


def sideways(n: Nominal) -> np.ndarray:
    return (n.C_nv.T @ n.v_n)[1:]


def dvl(n: Nominal) -> np.ndarray:
    turn = dcm_from_euler(*n.get(*(f"dvl_misalignment_{a}" for a in XYZ)))
    return (1.0 + n.get("dvl_scale")[0]) * turn.T @ n.C.T @ n.v_n


def depth(n: Nominal) -> np.ndarray:
    return np.array([-n.height])


def height(n: Nominal) -> np.ndarray:
    return np.array([n.height]) + n.get("height_bias")


def ranges(points):
    def h(n: Nominal) -> np.ndarray:
        here = WGS84.ecef_from_geodetic(n.lat, n.lon, n.height)
        return np.linalg.norm(points - here, axis=1)

    return h


class Filter:
    """arw, vrw: rad/sqrt(s), m/s/sqrt(s); scalars: name -> Scalar; std (9,): position, velocity, rpy of the start."""

    def __init__(self, start, arw: float, vrw: float, scalars: dict[str, Scalar], rate_hz: float) -> None:
        self.names, self.scalars = list(scalars), scalars
        q = quat_from_euler(*start.rpy)
        self.n = Nominal(
            start.lat, start.lon, start.height, start.v_n.copy(), q, {k: s.value for k, s in scalars.items()},
            np.zeros(3), np.zeros(3),
        )  # fmt: skip
        size = 9 + len(scalars)
        self.P = np.zeros((size, size))
        # roll, pitch, heading errors as phi: d C = C' per angle, by differences
        J = np.zeros((3, 3))
        C = dcm_from_euler(*start.rpy)
        for i in range(3):
            e = np.zeros(3)
            e[i] = 1e-6
            D = (dcm_from_euler(*(start.rpy + e)) - dcm_from_euler(*(start.rpy - e))) @ C.T / 2e-6
            J[:, i] = -np.array([D[2, 1], D[0, 2], D[1, 0]])
        self.P[:3, :3] = J @ np.diag(start.std[6:] ** 2) @ J.T
        self.P[3:6, 3:6], self.P[6:9, 6:9] = np.diag(start.std[3:6] ** 2), np.diag(start.std[:3] ** 2)
        self.P[9:, 9:] = np.diag([s.std**2 for s in scalars.values()])
        self.arw, self.vrw, self.dt = arw, vrw, 1.0 / rate_hz
        self.ins = Strapdown(Start(start.time, start.lat, start.lon, start.height, start.v_n, q))
        self.history = History()

    def predict(self, dtheta, dv) -> None:
        """One node: increments (k, 3) as measured."""
        n, T = self.n, len(dtheta) * self.dt

        def vector(stem):
            return n.get(*(f"{stem}_{a}" for a in XYZ))

        w = (dtheta - vector("gyro_bias") * self.dt) / (1.0 + vector("gyro_scale"))
        f = (dv - vector("accel_bias") * self.dt) / (1.0 + vector("accel_scale"))
        track = self.ins.feed(w, f, self.dt, every=len(dtheta))
        v1, q1 = track.v_n[0], track.q_nb[0]
        C = 0.5 * (dcm_from_quat(n.q) + dcm_from_quat(q1))
        w_b, f_b = w.sum(axis=0) / T, f.sum(axis=0) / T
        R_N, R_E = (float(r) for r in WGS84.radii(n.lat))
        v = 0.5 * (n.v_n + v1)
        w_ie = WGS84.earth_rate_n(n.lat)
        w_en = np.array([v[1] / R_E, -v[0] / R_N, -v[1] * math.tan(n.lat) / R_E])
        size = len(self.P)
        F = np.zeros((size, size))
        F[:3, :3] = -skew(w_ie + w_en)
        F[0, 4], F[1, 3], F[2, 4] = 1.0 / R_E, -1.0 / R_N, -math.tan(n.lat) / R_E
        F[3:6, :3] = skew(C @ f_b)
        F[3:6, 3:6] = -skew(2.0 * w_ie + w_en)
        F[5, 8] = -2.0 * 9.8 / R_N
        F[6:9, 3:6] = np.eye(3)
        for i, a in enumerate(XYZ):
            for name, block, sign, by in (
                (f"gyro_bias_{a}", slice(0, 3), 1.0, 1.0), (f"gyro_scale_{a}", slice(0, 3), 1.0, w_b[i]),
                (f"accel_bias_{a}", slice(3, 6), -1.0, 1.0), (f"accel_scale_{a}", slice(3, 6), -1.0, f_b[i]),
            ):  # fmt: skip
                if name in self.names:
                    F[block, 9 + self.names.index(name)] = sign * by * C[:, i]
        Q = np.zeros((size, size))
        Q[:3, :3], Q[3:6, 3:6] = self.arw**2 * np.eye(3), self.vrw**2 * np.eye(3)
        for k, s in enumerate(self.scalars.values(), 9):
            if s.tau is not None:
                F[k, k] = -1.0 / s.tau
                Q[k, k] = 2.0 * s.std**2 / s.tau
            Q[k, k] += s.walk**2
        A = F * T
        Phi = np.eye(size) + A + A @ A / 2.0 + A @ A @ A / 6.0
        half = np.eye(size) + A / 2.0 + A @ A / 8.0
        self.P = Phi @ self.P @ Phi.T + T * half @ Q @ half.T
        states = {k: v * math.exp(-T / s.tau) if (s := self.scalars[k]).tau else v for k, v in n.states.items()}
        w_eb = w_b - C.T @ w_ie
        self.n = Nominal(
            track.lat[0], track.lon[0], track.height[0], v1.copy(), q1.copy(), states, w_eb, (v1 - n.v_n) / T
        )

    def update(self, kind: str, z, h, R) -> float:
        """NIS of a measurement z of h(state) with covariance R."""
        size = len(self.P)
        step = np.sqrt(np.maximum(np.diag(self.P), 1e-16)) * 1e-2
        H = np.zeros((len(z), size))
        for i in range(size):
            e = np.zeros(size)
            e[i] = step[i]
            H[:, i] = (h(self.n.moved(-e, self.names)) - h(self.n.moved(e, self.names))) / (2.0 * step[i])
        y = np.asarray(z) - h(self.n)
        S = H @ self.P @ H.T + R
        K = np.linalg.solve(S, H @ self.P).T
        nis = float(y @ np.linalg.solve(S, y))
        I_KH = np.eye(size) - K @ H
        self.P = I_KH @ self.P @ I_KH.T + K @ R @ K.T
        # error of the estimate: x = -K y is what is left out of the state when x is taken off
        self.n = self.n.moved(-(K @ y), self.names)
        n = self.n
        self.ins.restart(Start(self.ins.time, n.lat, n.lon, n.height, n.v_n, n.q))
        self.history.nis.setdefault(kind, []).append(nis / len(y))
        return nis

    def keep(self, time: float) -> None:
        self.history.time.append(time)
        self.history.nominal.append(self.n)
        self.history.P.append(self.P.copy())


@dataclass
class Found:
    """Errors (n, d) and covariances (n, d, d) at whole seconds: phi, dv, position, scalars; mean NIS of each kind."""

    time: np.ndarray
    errors: np.ndarray
    P: np.ndarray
    names: list[str]
    nis: dict[str, float]

    def nees(self, first: int = 0, last: int | None = None) -> np.ndarray:
        """Per degree of freedom of the states first:last."""
        e, P = self.errors[:, first:last], self.P[:, first:last, first:last]
        return np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0]) / e.shape[1]


def navigate(path, recording, suite, imu, scalars, *, outage=(0.0, 0.0), slip=0.0) -> Found:
    """The filter over an imu table of increments and whatever else was recorded. slip: sigma of the constraint that
    the vehicle moves along its nose, m/s, each node; 0: no such constraint."""
    tables = recording.tables
    table = tables["imu"]
    dtheta, dv = table.stack("dtheta_x", "dtheta_y", "dtheta_z"), table.stack("dv_x", "dv_y", "dv_z")
    rate = round(1.0 / float(np.median(np.diff(table.time))))
    k = rate // 10
    f = Filter(recording.start, imu.arw[0], imu.vrw[0], scalars, rate)
    lever = antenna(suite.antenna)
    rows = []  # time, kind, row
    for kind in ("gnss", "speed", "dvl", "depth", "height"):
        rows += [(t, kind, i) for i, t in enumerate(tables[kind].time)] if kind in tables else []
    if "ranges" in tables:
        marks = tables["landmarks"]
        points = WGS84.ecef_from_geodetic(marks["lat"], marks["lon"], marks["height"])
        rows += [(t, "ranges", i * len(points)) for i, t in enumerate(np.unique(tables["ranges"].time))]
    rows.sort(key=lambda r: r[0])
    simple = {
        "speed": (("speed",), axial, [suite.speed_std]),
        "dvl": (("v_x", "v_y", "v_z"), dvl, [suite.dvl_std] * 3),
        "depth": (("depth",), depth, [suite.depth_std]),
        "height": (("height",), height, [suite.height_std]),
    }
    at = 0
    for node in range(1, len(dtheta) // k + 1):
        f.predict(dtheta[(node - 1) * k : node * k], dv[(node - 1) * k : node * k])
        while at < len(rows) and rows[at][0] <= node / 10.0 + 1e-6:
            time, kind, i = rows[at]
            at += 1
            if kind == "gnss" and not outage[0] <= time <= outage[1]:
                g, origin = tables["gnss"], (f.n.lat, f.n.lon, f.n.height)
                fix = Nominal(g["lat"][i], g["lon"][i], g["height"][i], f.n.v_n, f.n.q, {}, f.n.w_eb, f.n.a_n)
                R = np.diag(np.square(suite.gnss_std))
                f.update("gnss_position", ned_from(fix, origin), gnss_position(origin, lever), R)
                if suite.gnss_velocity:
                    z = g.stack("v_north", "v_east", "v_down")[i]
                    f.update("gnss_velocity", z, gnss_velocity(lever), np.diag(np.square(suite.gnss_velocity_std)))
            elif kind == "ranges":
                z = tables["ranges"]["range"][i : i + len(points)]
                f.update("ranges", z, ranges(points), np.eye(len(points)) * suite.range_std**2)
            elif kind in simple:
                columns, h, std = simple[kind]
                f.update(kind, tables[kind].stack(*columns)[i], h, np.diag(np.square(std)))
        if slip:
            f.update("nhc", np.zeros(2), sideways, np.eye(2) * slip**2)
        if node % 10 == 0:
            f.keep(node / 10.0)
    return _judged(path, recording, f)


def _judged(path, recording, f: Filter) -> Found:
    time = np.array(f.history.time)
    s, true = path.at(time), recording.truth_states
    turn = [true[f"mounting_{a}"][1][0] if f"mounting_{a}" in true else 0.0 for a in ("roll", "pitch", "yaw")]
    errors = []
    for j, n in enumerate(f.history.nominal):
        C = dcm_from_quat(s.q_nb[j]) @ dcm_from_euler(*turn)
        phi = -rotvec_from_dcm(dcm_from_quat(n.q) @ C.T)
        more = [n.states[a] - np.interp(time[j], *true[a]) for a in f.names]
        place = ned_from(n, (s.lat[j], s.lon[j], s.height[j]))
        errors.append(np.concatenate([phi, n.v_n - s.v_n[j], place, more]))
    nis = {kind: float(np.mean(v)) for kind, v in f.history.nis.items()}
    return Found(time, np.array(errors), np.array(f.history.P), f.names, nis)
