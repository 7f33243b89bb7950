"""Strapdown INS: IMU increments or rates in, track out; sample by sample or a table at once, with the same bits.

NED velocity over ground, geodetic position, q_nb scalar first; SI and radians. Inside, the level frame wanders
(kernels.mechanization), so that a pole or the 180 deg meridian is a place like any other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import WGS84, C_en, Ellipsoid
from schuler.ground.errors import InputError
from schuler.ground.frames import (
    euler_from_quat,
    quat_conjugate,
    quat_from_dcm,
    quat_from_euler,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from schuler.ground.tables import Table
from schuler.truth.trajectories import Truth, earth_vector

Array = NDArray[np.float64]
Coning = Literal["none", "one", "two", "three", "pair"]
Vertical = Literal["free", "held", "aided"]
_SCHEMES = {"none": 0, "one": 1, "two": 2, "three": 3, "pair": 4}
_VERTICAL = {"free": 0, "held": 1, "aided": 2}
_BLOCK = 4096


@dataclass(frozen=True)
class Start:
    """Where and how a run begins: time s; lat, lon rad; height m; v_n (3,) m/s NED; q_nb (4,) unit, scalar first."""

    time: float
    lat: float
    lon: float
    height: float
    v_n: Array
    q_nb: Array

    @classmethod
    def of(cls, truth: Truth, i: int = 0) -> Start:
        """Instant i of a truth."""
        return cls(
            float(truth.time[i]), float(truth.lat[i]), float(truth.lon[i]), float(truth.height[i]),
            truth.v_n[i].copy(), truth.q_nb[i].copy(),
        )  # fmt: skip

    @classmethod
    def level(
        cls, lat: float, lon: float, height: float = 0.0, *,
        roll: float = 0.0, pitch: float = 0.0, heading: float = 0.0, v_n: ArrayLike = (0.0, 0.0, 0.0), time: float =
        0.0,
    ) -> Start:  # fmt: skip
        """From angles in rad."""
        return cls(time, lat, lon, height, np.array(v_n, dtype=np.float64), quat_from_euler(roll, pitch, heading))

    def turned(self, phi: ArrayLike) -> Start:
        """The same with a misalignment phi (3,) rad, NED: C_hat = (I - [phi x]) C, as a finite rotation."""
        q = quat_multiply(quat_from_rotvec(-np.asarray(phi, dtype=np.float64)), self.q_nb)
        return Start(self.time, self.lat, self.lon, self.height, self.v_n, q)


@dataclass(frozen=True)
class Track:
    """Rows of a run: time (n,) s; lat, lon (n,) rad; height (n,) m; v_n (n, 3) m/s; q_nb (n, 4)."""

    time: Array
    lat: Array
    lon: Array
    height: Array
    v_n: Array
    q_nb: Array
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rpy(self) -> Array:
        """(n, 3) roll, pitch, heading, rad. Within about a degree of pitch 90 deg roll and heading alone lose meaning;
        q_nb keeps its accuracy there."""
        return np.column_stack(euler_from_quat(self.q_nb))

    def minus(self, truth: Truth | Track, earth: Ellipsoid = WGS84) -> TrackErrors:
        """Estimate minus truth, row by row; the rows must be at the same times."""
        if len(truth) != len(self) or np.max(np.abs(truth.time - self.time), initial=0.0) > 1e-6:
            raise InputError("the two tracks have different times; resample one to the other first")
        return errors_between(self, truth, earth)


@dataclass(frozen=True)
class TrackErrors:
    """Estimate minus truth: position (n, 3) m and velocity (n, 3) m/s in NED of the truth; phi (n, 3) rad, NED, with
    C_hat = (I - [phi x]) C: tilts about north and east, and minus the heading error."""

    time: Array
    position: Array
    velocity: Array
    phi: Array

    @property
    def horizontal(self) -> Array:
        """(n,) m."""
        return np.hypot(self.position[:, 0], self.position[:, 1])


def errors_between(track: Track, truth: Truth | Track, earth: Ellipsoid = WGS84) -> TrackErrors:
    """The errors of a track, NED component less NED component; within a degree of a pole, where NED itself turns with
    the position, both are first carried into the truth's NED through the Earth-fixed frame."""
    position = earth.displacement_n(track.lat, track.lon, track.height, truth.lat, truth.lon, truth.height)
    velocity = track.v_n - truth.v_n
    phi = -rotvec_from_quat(quat_multiply(track.q_nb, quat_conjugate(truth.q_nb)))
    polar = np.abs(truth.lat) > math.radians(89.0)
    if polar.any():
        C_hat, C = C_en(track.lat[polar], track.lon[polar]), C_en(truth.lat[polar], truth.lon[polar])
        r_n, r_e = earth.radii(truth.lat[polar])
        h = truth.height[polar]
        # Difference of the normals seen in the truth's NED: as small as the error is, whatever the longitude.
        small = np.einsum("nij,ni->nj", C, C[:, :, 2] - C_hat[:, :, 2])
        position[polar, 0], position[polar, 1] = small[:, 0] * (r_n + h), small[:, 1] * (r_e + h)
        turn = np.einsum("nij,nik->njk", C, C_hat)  # from the estimate's NED into the truth's
        velocity[polar] = np.einsum("nij,nj->ni", turn, track.v_n[polar]) - truth.v_n[polar]
        q = quat_multiply(quat_from_dcm(turn), track.q_nb[polar])
        phi[polar] = -rotvec_from_quat(quat_multiply(q, quat_conjugate(truth.q_nb[polar])))
    return TrackErrors(track.time, position, velocity, phi)


class Strapdown:
    """A strapdown INS that runs as samples come.

    start : where it begins.  earth : WGS84 or a sphere.
    coning : corrections for motion inside the interval (coning and sculling together): "none"; "one", "two", "three"
        previous increments kept, errors of order dt^3 (dt^4 in pure coning), dt^4, and a tenth of that or less; or
        "pair", two increments at a time, dt^4 without memory.
    vertical : "free" (unstable: an error grows e-fold in 9.5 min), "held" (height and down velocity are given with each
        sample, or kept), "aided" (third-order loop on a given height, time constant `tau` s).
    """

    def __init__(
        self, start: Start, *, earth: Ellipsoid = WGS84, coning: Coning = "three", vertical: Vertical = "free",
        tau: float = 100.0,
    ) -> None:  # fmt: skip
        from schuler.kernels import mechanization as kernel

        if coning not in _SCHEMES or vertical not in _VERTICAL:
            raise InputError(
                f"coning is one of {', '.join(_SCHEMES)} and vertical one of {', '.join(_VERTICAL)}; "
                f"got {coning!r} and {vertical!r}"
            )
        q = np.asarray(start.q_nb, dtype=np.float64)
        size = float(np.linalg.norm(q))
        numbers = [start.lat, start.lon, start.height, *start.v_n, *q]
        if not np.all(np.isfinite(numbers)) or abs(size - 1.0) > 1e-6:
            raise InputError("the start holds a value that is not a number, or q_nb is not a unit quaternion")
        self.earth, self._scheme, self._mode = earth, _SCHEMES[coning], _VERTICAL[vertical]
        self.time = start.time
        self._height, self._down = np.array([start.height]), np.array([start.v_n[2]])
        # Three poles at -1/tau: (s + 1/tau)^3, with the gravity gradient 2 g/R added to the second gain.
        self._gains = np.array([3.0 / tau, 3.0 / tau**2 + 2.0 * earth.gamma_e / earth.a, 1.0 / tau**3])
        self._earth = earth_vector(earth)
        self._state = np.zeros(kernel.STATE)
        kernel.begin(self._state, self._earth, start.lat, start.lon, start.height, *start.v_n, *(q / size))

    def feed(
        self, dtheta: Array, dv: Array, dt: float | Array, *, height: Array | None = None, v_down: Array | None = None,
        every: int = 1,
    ) -> Track:  # fmt: skip
        """n samples on: increments (n, 3) rad and (n, 3) m/s over dt (s, one number or (n,)); the rows after every
        `every`-th of them. height (n,) m and v_down (n,) m/s at the ends, for "held" and "aided"."""
        from schuler.kernels import mechanization as kernel

        dtheta, dv = np.ascontiguousarray(dtheta, dtype=np.float64), np.ascontiguousarray(dv, dtype=np.float64)
        steps = np.atleast_1d(np.asarray(dt, dtype=np.float64))
        n = len(dtheta)
        if dtheta.shape != (n, 3) or dv.shape != (n, 3) or steps.size not in (1, n):
            raise InputError(f"increments must be (n, 3) and dt one number or (n,); got {dtheta.shape}, {dv.shape}")
        if not np.all(steps > 0.0):
            raise InputError("the intervals dt must be above 0 s; remove repeated rows, sort the others")
        if every < 1 or any(x is not None and len(x) not in (1, n) for x in (height, v_down)):
            raise InputError(f"every must be 1 or more, and height and v_down as long as the {n} samples")
        pairs = self._scheme == _SCHEMES["pair"]
        if pairs and n % 2:
            raise InputError(f'coning = "pair" takes an even number of samples; got {n}')
        epochs = n // 2 if pairs else n
        rows = epochs // every
        h = self._height if height is None else np.ascontiguousarray(height, dtype=np.float64)
        d = self._down if v_down is None else np.ascontiguousarray(v_down, dtype=np.float64)
        if height is not None and v_down is None and self._mode == _VERTICAL["held"]:
            raise InputError('vertical = "held" with given heights needs v_down beside them')
        out = np.empty((rows, kernel.NED))
        size = max(1, _BLOCK // every)  # rows a block: small enough to stay in the processor's cache
        raw = np.empty((min(size, rows), kernel.RAW))
        samples = (2 if pairs else 1) * every
        for first in range(0, max(rows, 1), size):
            last = min(first + size, rows)
            part = slice(first * samples, last * samples if last < rows else n)
            kernel.run(
                self._state, self._earth, dtheta[part], dv[part], steps if steps.size == 1 else steps[part],
                self._scheme, self._mode, h if h.size == 1 else h[part], d if d.size == 1 else d[part],
                self._gains, every, raw[: last - first],
            )  # fmt: skip
            kernel.to_ned(raw[: last - first], out[first:last])
        ends = self.time + (steps[0] * np.arange(1, n + 1) if steps.size == 1 else np.cumsum(steps))
        self.time = float(ends[-1]) if n else self.time
        times = ends[1::2] if pairs else ends
        return _track(times[every - 1 :: every], out)

    def restart(self, start: Start) -> None:
        """Takes another position, velocity and attitude; what was learnt of the motion inside the intervals is kept."""
        from schuler.kernels import mechanization as kernel

        memory = self._state[kernel.MEMORY :].copy()
        kernel.begin(self._state, self._earth, start.lat, start.lon, start.height, *start.v_n, *start.q_nb)
        self._state[kernel.MEMORY :] = memory
        self.time = start.time

    def step(self, dtheta: ArrayLike, dv: ArrayLike, dt: float) -> Track:
        """One sample."""
        return self.feed(np.asarray(dtheta, dtype=np.float64)[None], np.asarray(dv, dtype=np.float64)[None], dt)


def _track(time: Array, out: Array) -> Track:
    if len(out) and not np.all(np.isfinite(out[-1])):  # what is not a number once stays so
        row = int(np.argmax(~np.isfinite(out).all(axis=1)))
        raise InputError(f"the run stopped being a number at {time[row]:.3f} s: look at the IMU rows before it")
    lat, lon, height = out[:, :3].T.copy()
    return Track(time, lat, lon, height, out[:, 3:6], out[:, 6:10])


def run(
    imu: Table, start: Start, *, earth: Ellipsoid = WGS84, coning: Coning = "three", vertical: Vertical = "free",
    tau: float = 100.0, height: Array | None = None, v_down: Array | None = None, every: int = 1,
) -> Track:  # fmt: skip
    """A whole imu table (rates or increments, see `imu_input.prepare` for what is checked and repaired)."""
    from schuler.inertial.imu_input import prepare

    ready = prepare(imu, start)
    ins = Strapdown(start, earth=earth, coning=coning, vertical=vertical, tau=tau)
    dt = ready.dt if np.ptp(ready.dt) > 1e-9 * ready.dt[0] else float(np.mean(ready.dt))
    if coning == "pair" and len(ready.dtheta) % 2:
        ready = ready.head(len(ready.dtheta) - 1)
        dt = dt if isinstance(dt, float) else ready.dt
    if height is not None:
        height, v_down = height[: len(ready.dtheta)], None if v_down is None else v_down[: len(ready.dtheta)]
    track = ins.feed(ready.dtheta, ready.dv, dt, height=height, v_down=v_down, every=every)
    times = ready.time[1::2] if coning == "pair" else ready.time
    return Track(times[every - 1 :: every], track.lat, track.lon, track.height, track.v_n, track.q_nb, ready.notes)
