"""A recording on a turntable: stops all round and spins at constant rate, at given settings of the inner axes.

Instrument axes x, y, z; the table's outer axis is y of the laboratory, up. A setting (gamma, beta) turns the instrument
by gamma about y and then by beta about z before the table's own angle, so that the outer axis in instrument axes is
u = (cos gamma sin beta, cos beta, sin gamma sin beta), thesis (4.11) with its missing factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import WGS84
from schuler.ground.tables import Table
from schuler.ground.units import DEG, G0
from schuler.truth.streams import stream

Array = NDArray[np.float64]

THESIS_PLAN = ((0.0, 0.0), (0.0, 45.0), (45.0, 45.0), (0.0, -45.0), (-45.0, -45.0))  # gamma, beta in deg, corrected


def spin_axis(gamma: ArrayLike, beta: ArrayLike) -> Array:
    """(..., 3) unit vector of the outer axis in instrument axes; gamma, beta in rad."""
    g, b = np.asarray(gamma, dtype=np.float64), np.asarray(beta, dtype=np.float64)
    return np.stack([np.cos(g) * np.sin(b), np.cos(b) + 0.0 * g, np.sin(g) * np.sin(b)], axis=-1)


def positions_table(
    plan_deg: Sequence[tuple[float, float]],
    *,
    rate_deg_per_s: float = 20.0,
    still_s: float = 60.0,
    spin_s: float = 300.0,
    stops: int = 8,
    both_ways: bool = True,
    move_s: float = 5.0,
    start_s: float = 0.0,
) -> Table:
    """The plan a laboratory follows: at each (gamma, beta), stops all round, then a spin each way. Table "positions".

    move_s : allowed to reach the next stop, or to run up and settle.
    """
    rows: list[tuple[str, str, float, float, float, float, float, float]] = []
    t = start_s
    for k, (gamma, beta) in enumerate(plan_deg, 1):
        for n in range(stops):
            rows.append((str(k), "still", t, t + still_s, gamma, beta, 360.0 * n / stops, 0.0))
            t += still_s + move_s
        for rate in (rate_deg_per_s, -rate_deg_per_s) if both_ways else (rate_deg_per_s,):
            rows.append((str(k), "spin", t, t + spin_s, gamma, beta, 0.0, rate))
            t += spin_s + move_s
    text = {"position": 0, "kind": 1}
    numbers = {
        "start": (2, 1.0),
        "end": (3, 1.0),
        "gamma": (4, DEG),
        "beta": (5, DEG),
        "azimuth": (6, DEG),
        "rate": (7, DEG),
    }
    columns: dict[str, NDArray] = {name: np.array([r[i] for r in rows]) for name, i in text.items()}
    columns |= {name: np.array([r[i] for r in rows], dtype=float) * f for name, (i, f) in numbers.items()}
    return Table("positions", columns)


@dataclass(frozen=True)
class Turntable:
    """What table and instrument are like. SI and radians.

    levers (k, 3) m from the point where the table's axes meet; directions (k, 3); bias (k,) m/s^2 and noise (k,) rms of
    a row, m/s^2. tilt of the outer axis and tilt_azimuth; angle_errors: rms of the inner settings, drawn per position;
    rate_error: relative. latitude None: an Earth that does not turn. gyro_noise: rms of a row, rad/s.
    """

    levers: Array
    directions: Array | None = None
    bias: ArrayLike = 0.0
    noise: ArrayLike = 0.0
    gravity: float = G0
    tilt: float = 0.0
    tilt_azimuth: float = 0.6
    angle_errors: float = 0.0
    rate_error: float = 0.0
    latitude: float | None = None
    gyro_noise: float = 0.0
    gyro_bias: ArrayLike = 0.0

    def record(self, positions: Table, rate_hz: float = 100.0, *, seed: int = 1, run: int = 0) -> Table:
        """The imu table of a whole plan; between the stretches the table stands (the motion there is not simulated).

        With other than three accelerometers use `outputs`.
        """
        time, A, w = self.outputs(positions, rate_hz, seed=seed, run=run)
        columns: dict[str, NDArray] = {"time": time}
        columns |= {f"gyro_{a}": w[:, i] for i, a in enumerate("xyz")}
        columns |= {f"accel_{a}": A[:, i] for i, a in enumerate("xyz")}
        return Table("imu", columns, "rates")

    def outputs(self, positions: Table, rate_hz: float, *, seed: int = 1, run: int = 0) -> tuple[Array, Array, Array]:
        """Times (n,), accelerometers (n, k) m/s^2, gyros (n, 3) rad/s; a row describes the middle of its interval."""
        levers = np.atleast_2d(np.asarray(self.levers, dtype=np.float64))
        e = np.eye(3) if self.directions is None else np.asarray(self.directions, dtype=np.float64)
        angles = stream(seed, run, "table angles")
        n = int(np.ceil((float(np.max(positions["end"])) + 1.0) * rate_hz))
        time = np.arange(1, n + 1) / rate_hz
        A = np.zeros((n, len(levers)))
        gyro = np.zeros((n, 3))
        errors: dict[str, Array] = {}
        for row in range(len(positions)):
            name = str(positions["position"][row])
            if name not in errors:
                errors[name] = self.angle_errors * angles.standard_normal(2)
            first, last = np.searchsorted(time, [positions["start"][row], positions["end"][row]], side="right")
            t = time[first:last] - 0.5 / rate_hz - positions["start"][row]
            rate = positions["rate"][row] * (1.0 + self.rate_error)
            gamma, beta = positions["gamma"][row] + errors[name][0], positions["beta"][row] + errors[name][1]
            A[first:last], gyro[first:last] = self._stretch(
                t, float(positions["azimuth"][row]), float(rate), float(gamma), float(beta), levers, e
            )
        noise = np.broadcast_to(np.asarray(self.noise, dtype=np.float64), (len(levers),))
        A += np.broadcast_to(np.asarray(self.bias, dtype=np.float64), (len(levers),))
        if np.any(noise > 0.0):
            A += noise * stream(seed, run, "table accelerometers").standard_normal(A.shape)
        gyro += np.broadcast_to(np.asarray(self.gyro_bias, dtype=np.float64), (3,))
        if self.gyro_noise > 0.0:
            gyro += self.gyro_noise * stream(seed, run, "table gyros").standard_normal(gyro.shape)
        return time, A, gyro

    def _stretch(
        self, t: Array, azimuth: float, rate: float, gamma: float, beta: float, levers: Array, e: Array
    ) -> tuple[Array, Array]:
        a = azimuth + rate * t
        u = spin_axis(gamma, beta)
        # Laboratory vectors seen from the table turn backwards; then through the inner settings.
        inner = _about_z(beta) @ _about_y(gamma)
        up_lab = np.array(
            [
                np.sin(self.tilt) * np.cos(self.tilt_azimuth),
                np.cos(self.tilt),
                np.sin(self.tilt) * np.sin(self.tilt_azimuth),
            ]
        )
        f = self.gravity * _seen(a, up_lab) @ inner
        w = np.broadcast_to(rate * u, (t.size, 3))
        # Gravity already holds the centrifugal part, so the Earth adds 2 w_e x (w x rho) only.
        inward = np.array([np.cross(rate * u, np.cross(rate * u, r)) for r in levers])
        A = f @ e.T + np.sum(inward * e, axis=1)
        if self.latitude is not None:
            earth_lab = WGS84.omega * np.array([np.cos(self.latitude), np.sin(self.latitude), 0.0])
            earth = _seen(a, earth_lab) @ inner
            for i, r in enumerate(levers):
                A[:, i] += 2.0 * np.cross(earth, np.cross(rate * u, r)) @ e[i]
            w = w + earth
        return A, np.array(w)


def _about_y(a: float) -> Array:
    c, s = np.cos(a), np.sin(a)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _about_z(a: float) -> Array:
    c, s = np.cos(a), np.sin(a)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _seen(a: Array, v: Array) -> Array:
    """(n, 3) components on the table, turned by a about y, of a laboratory vector."""
    c, s = np.cos(a), np.sin(a)
    return np.column_stack([c * v[0] - s * v[2], np.full(a.size, v[1]), s * v[0] + c * v[2]])
