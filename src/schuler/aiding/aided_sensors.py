"""Sensors of the user's own: a function from the state to what the sensor would read, and its Jacobian.

def measure(state, z):                                   # a radar altimeter over flat sea
    H = np.zeros((1, state.n))
    H[0, state.at("position")][2] = -1.0                 # d(height)/d(down error)
    return [state.height], H

radar = Sensor("radar", ("up",), "m", time, heights, sigma, measure)
navigate(tables, settings, sensors=[radar])
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.aiding.aided_rows import Events
from schuler.ground.errors import InputError

if TYPE_CHECKING:
    from schuler.aiding.aided_engine import Engine

Array = NDArray[np.float64]
_PLACES = {"attitude": 0, "velocity": 3, "position": 6}


class State:
    """The filter's present state, to read only, and where its errors lie in H.

    time s; C_nb (3, 3); v_n (3,) m/s NED; lat, lon rad; height m; w_b (3,) rad/s, a_n (3,) m/s^2; n: length of the
    error state. Errors are estimate - truth: phi (rad, n frame, C_hat = (I - [phi x]) C), velocity and position NED.
    """

    def __init__(self, engine: Engine) -> None:
        from schuler.ground.frames import dcm_from_quat
        from schuler.kernels import aided_state as k

        x = engine.x
        self._engine = engine
        self.n = engine.layout.n
        self.time = float(x[k.T])
        self.C_nb = np.asarray(dcm_from_quat(x[k.QUAT : k.QUAT + 4]))
        self.v_n = x[k.VEL : k.VEL + 3].copy()
        self.lat, self.lon, self.height = float(x[k.LAT]), float(x[k.LON]), float(x[k.HGT])
        self.w_b, self.a_n = x[k.W : k.W + 3].copy(), x[k.ACC : k.ACC + 3].copy()

    def at(self, name: str) -> slice:
        """Columns of H for "attitude", "velocity", "position" or a parameter that is estimated ("gyro_bias", ...)."""
        if name in _PLACES:
            return slice(_PLACES[name], _PLACES[name] + 3)
        slot, size = _slot(name)
        column = int(self._engine.layout.ie[slot])
        if column < 0:
            raise InputError(f"{name} is not estimated; name it in estimate")
        return slice(column, column + size)

    def value(self, name: str) -> Array:
        """A parameter's present value (SI), estimated or not."""
        from schuler.kernels import aided_state as k

        slot, size = _slot(name)
        return self._engine.x[k.PAR + slot : k.PAR + slot + size].copy()

    def covariance(self) -> Array:
        """(n, n) of the errors."""
        return self._engine.P.copy()

    def offset_ned(self, lat: float, lon: float, height: float) -> Array:
        """(3,) m NED from the IMU to a place."""
        from schuler.kernels.aided_measure import offset_ned

        return np.array(offset_ned(self._engine.x, lat, lon, height))


def _slot(name: str) -> tuple[int, int]:
    from schuler.aiding.aided import STATES
    from schuler.kernels import aided_state as k

    for slot, stem, _, components in STATES:
        if stem == name:
            return int(getattr(k, slot)), len(components)
    raise InputError(f"there is no parameter {name}; there are {', '.join(s[1] for s in STATES)}")


Measure = Callable[[State, Array], tuple[ArrayLike, Array]]


@dataclass(frozen=True)
class Sensor:
    """A sensor of the caller's own. time (m,) s; z (m, d) or (m,) what it read; sigma one number, (d,) or (m, d).

    measure(state, z row) returns the predicted reading (d,) and H (d, n), its derivative with respect to the errors
    (d up to 3). angle: readings are angles in rad, and differences are wrapped. It may have up to four states of its
    own (`AidedSettings.user_std`), `state.value("user")` and `state.at("user")`.
    """

    name: str
    components: tuple[str, ...]
    unit: str
    time: Array
    z: Array
    sigma: ArrayLike
    measure: Measure
    angle: bool = False


def merged(events: Events, sensors: Sequence[Sensor]) -> Events:
    """Events with the sensors' own rows among them (kind USER + number; z[0] is the row's number)."""
    from schuler.kernels.aided_run import USER

    if not sensors:
        return events
    times, kinds, values = [events.time], [events.kind], [events.z]
    for i, sensor in enumerate(sensors):
        t = np.asarray(sensor.time, dtype=np.float64)
        if not np.isfinite(t).all() or len(t) != len(np.asarray(sensor.z)):
            raise InputError(f"sensor {sensor.name}: time and z must be finite and of one length")
        z = np.full((len(t), events.z.shape[1]), np.nan)
        z[:, 0] = np.arange(len(t))
        times.append(t)
        kinds.append(np.full(len(t), USER + i, dtype=np.int64))
        values.append(z)
    time, kind, z = np.concatenate(times), np.concatenate(kinds), np.vstack(values)
    order = np.lexsort((kind, time))
    return Events(time[order], kind[order], np.ascontiguousarray(z[order]), events.notes)


def take_own(engine: Engine, events: Events, sensors: Sequence[Sensor]) -> None:
    """Makes the measurement that the kernel stopped at."""
    from schuler.kernels.aided_run import MEAS, USER

    index = int(engine.kept.counts[MEAS])
    sensor = sensors[int(events.kind[index]) - USER]
    row = int(events.z[index, 0])
    z = np.atleast_1d(np.asarray(sensor.z, dtype=np.float64)[row])
    sigma = np.broadcast_to(np.asarray(sensor.sigma, dtype=np.float64), (len(sensor.time), len(z)))[row]
    engine.kept.innov[index, 0] = update(engine, sensor, z, sigma)
    engine.kept.counts[MEAS] += 1


def update(engine: Engine, sensor: Sensor, z: Array, sigma: Array) -> Array:
    """Takes one reading in; returns its row of innovations."""
    from schuler.kernels.aided_measure import KINDS
    from schuler.kernels.aided_update import INNOVATION, take

    predicted, H = sensor.measure(State(engine), z)
    r = np.asarray(predicted, dtype=np.float64) - z
    if sensor.angle:
        r = (r + np.pi) % (2.0 * np.pi) - np.pi
    H = np.ascontiguousarray(H, dtype=np.float64)
    d = len(z)
    if not 1 <= d <= 3 or H.shape != (d, engine.layout.n) or r.shape != (d,):
        raise InputError(
            f"sensor {sensor.name}: measure gave a prediction of shape {r.shape} and H of {H.shape} for a reading "
            f"of {d}; expected ({d},) and ({d}, {engine.layout.n}), with 1 to 3 components"
        )
    if not (np.isfinite(r).all() and np.isfinite(H).all()):
        raise InputError(f"sensor {sensor.name}: measure gave NaN or infinity")
    out = np.full(INNOVATION, np.nan)
    take(engine.x, engine.P, engine.layout.ie, engine.c, engine.dx, H, r, sigma**2, 0, d, KINDS, -1, out)
    return out
