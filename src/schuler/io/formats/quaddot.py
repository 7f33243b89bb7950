"""A quadrotor's flight log with Movella (Xsens) DOT sensors aboard: NAME_truth and NAME_imuK tables in one folder.

Truth: `time, distance(meters), speed(m/s), compass_heading(degrees), pitch(degrees), roll(degrees),
height_above_takeoff(meters), North, East, Down`; a DOT: `time, Euler_X..Z [deg], Acc_X..Z [m/s^2], Gyr_X..Z [deg/s]`.
DOT axes are forward-left-up and stay so ([mounting] imu_to_body_rpy_deg = [180, 0, 0]).

Both clocks start at zero on their own. The DOT's roll and pitch against the drone's tell the offset, and the truth is
put on the DOT's clock. The drone's positions are not at the moment of its attitude (0.05 s before it in most flights):
their accelerations against those of the DOT tell by how much, and fixes and reference are put where they belong.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler
from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.io.formats.common import joined, need, numbered, sheet_in, whole_rows, wrapped

Array = NDArray[np.float64]
TRUTH = "time compass_heading(degrees) pitch(degrees) roll(degrees) height_above_takeoff(meters) North East Down"
DOT = "time Euler_X Euler_Y Euler_Z Acc_X Acc_Y Acc_Z Gyr_X Gyr_Y Gyr_Z"
FIX_EVERY = 10  # rows of the truth from one fix to the next
FIX_M = 0.05  # 1 sigma of a fix, each axis
LARGEST_OFFSET_S = 3.0
LARGEST_LAG_S = 0.3
BASE_S = 0.6  # of the second differences that tell the lag


@dataclass
class Flight:
    """One flight with one sensor. tables : imu (DOT axes), gnss and reference with north and east in metres from the
    first row; start : roll, pitch, heading rad and v_n m/s at the first IMU row; offset : DOT minus truth, s;
    position_lag : s, how much later than the attitude of the same row its position was."""

    name: str
    sensor: str
    tables: dict[str, Table]
    start: dict[str, float]
    offset: float
    position_lag: float


def recognise(path: Path) -> bool:
    """A folder with NAME_truth and NAME_imuK tables."""
    return path.is_dir() and bool(flights(path))


def flights(path: Path) -> dict[str, list[str]]:
    """Names of the flights in a folder, each with its sensors."""
    stems = sorted({p.name.partition(".")[0] for p in path.iterdir()})
    found = {}
    for stem in stems:
        if stem.endswith("_truth"):
            name = stem.removesuffix("_truth")
            sensors = [s.removeprefix(f"{name}_") for s in stems if s.startswith(f"{name}_imu")]
            if sensors:
                found[name] = sensors
    return found


def convert(path: Path, flight: str | None = None, sensor: str = "imu1") -> dict[str, Table]:
    """Tables imu, gnss and reference of one flight (the first where none is named). Raises InputError."""
    return read_flight(path, flight, sensor).tables


def read_flight(path: Path, flight: str | None = None, sensor: str = "imu1") -> Flight:
    """A flight with its clocks put together. Raises InputError."""
    have = flights(path) if path.is_dir() else {}
    if not have:
        raise InputError(f"{path}: no NAME_truth and NAME_imuK tables in it")
    flight = flight or next(iter(have))
    if flight not in have:
        raise InputError(f"{path}: no flight {flight}; it has {', '.join(have)}")
    if sensor not in have[flight]:
        raise InputError(f"{path}: flight {flight} has no {sensor}; it has {', '.join(have[flight])}")
    notes = [f"flight {flight}, {sensor}" + (f"; also there: {', '.join(have)}" if len(have) > 1 else "")]
    truth = _rows(path, f"{flight}_truth", TRUTH, notes)
    dot = _rows(path, f"{flight}_{sensor}", DOT, notes)
    offset, spread = _offset(truth, dot)
    if spread > 10.0:
        notes.append(
            f"{sensor}: its roll and pitch differ from the drone's by {spread:.0f} deg rms at best: "
            "another flight, or another mounting?"
        )
    notes.append(f"{sensor}: its clock is {offset:+.3f} s from the drone's (found from roll and pitch)")
    truth["time"] = truth["time"] + offset
    lag = _lag(truth, dot)
    notes.append(
        f"drone: its positions are {lag:+.3f} s late against its attitude (found from accelerations); they are put "
        "where they belong"
    )
    inside = (truth["time"] >= dot["time"][0]) & (truth["time"] <= dot["time"][-1])
    if inside.sum() < 2 * FIX_EVERY:
        raise InputError(f"{path}: {flight}_truth and {flight}_{sensor} share less than two seconds")
    imu = {"time": dot["time"]}
    imu |= {f"gyro_{a.lower()}": dot[f"Gyr_{a}"] * DEG for a in "XYZ"}
    imu |= {f"accel_{a.lower()}": dot[f"Acc_{a}"] for a in "XYZ"}
    notes.append("imu: DOT axes, forward-left-up (imu_to_body_rpy_deg = [180, 0, 0])")
    place = {"north": truth["North"], "east": truth["East"], "height": 0.0 - truth["Down"]}
    k = np.flatnonzero(inside)[::FIX_EVERY]
    std = {f"std_{n}": np.full(len(k), FIX_M) for n in ("north", "east", "down")}
    gnss = {"time": truth["time"][k] - lag, **{n: v[k] for n, v in place.items()}, **std}
    notes.append(f"gnss: every {FIX_EVERY}th position of the truth, sigma {FIX_M:g} m; north and east from its first")
    moved = truth["time"] + lag  # row t holds the position of t - lag, so that of t stands at t + lag
    known = inside & (moved <= truth["time"][-1]) & (moved >= truth["time"][0])
    reference = {"time": truth["time"][known]}
    reference |= {n: np.interp(moved[known], truth["time"], v) for n, v in place.items()}
    reference |= {n: truth[f"{n}(degrees)"][known] * DEG for n in ("roll", "pitch")}
    reference["heading"] = wrapped(truth["compass_heading(degrees)"][known] * DEG)
    tables = {
        "imu": Table("imu", imu, "rates", f"{flight}_{sensor}", notes),
        "gnss": Table("gnss", gnss, source=f"{flight}_truth", notes=notes),
        "reference": Table("reference", reference, source=f"{flight}_truth", notes=notes),
    }
    return Flight(flight, sensor, tables, _start(truth, lag, dot["time"][0]), offset, lag)


def _rows(path: Path, stem: str, names: str, notes: list[str]) -> dict[str, Array]:
    sheet = sheet_in(path, stem)
    if sheet is None:
        raise InputError(f"{path}: no {stem}.csv in it")
    raw = numbered(sheet)
    need(raw, names, sheet.path)
    rows = joined([whole_rows({n: raw[n] for n in names.split()}, stem, notes)], stem, notes)
    if len(rows["time"]) < 2 * FIX_EVERY:
        raise InputError(f"{sheet.path.name}: {len(rows['time'])} rows are too few for a flight")
    return rows


def _finest(cost: list[float], lags: Array) -> float:
    """The lag of least cost, a parabola through its neighbours."""
    k = int(np.argmin(cost))
    if 0 < k < len(lags) - 1:
        a, b, c = cost[k - 1 : k + 2]
        if a - 2.0 * b + c > 0.0:
            return float(lags[k] + 0.5 * (a - c) / (a - 2.0 * b + c) * (lags[1] - lags[0]))
    return float(lags[k])


def _offset(truth: dict[str, Array], dot: dict[str, Array]) -> tuple[float, float]:
    """DOT's clock minus the drone's, s, from roll and pitch; and what is left between them there, deg rms."""
    lags = np.arange(-LARGEST_OFFSET_S, LARGEST_OFFSET_S + 1e-9, 0.02)
    cost = []
    for lag in lags:
        t = truth["time"] + lag
        ok = (t >= dot["time"][0]) & (t <= dot["time"][-1])
        if ok.sum() < len(t) / 2:
            cost.append(np.inf)
            continue
        roll = np.interp(t[ok], dot["time"], dot["Euler_X"]) - truth["roll(degrees)"][ok]
        pitch = np.interp(t[ok], dot["time"], -dot["Euler_Y"]) - truth["pitch(degrees)"][ok]
        cost.append(float(np.var(roll) + np.var(pitch)))
    if not np.isfinite(cost).any():
        return 0.0, np.inf
    return _finest(cost, lags), float(np.sqrt(min(cost)))


def _lag(truth: dict[str, Array], dot: dict[str, Array]) -> float:
    """How much later than the DOT's clock says the drone's positions are, s (negative: earlier).

    Second differences of the positions over BASE_S against those of the specific force, turned by the DOT's roll and
    pitch and the drone's heading and integrated twice; a straight line takes bias and scale out of each axis.
    """
    t, own = truth["time"], dot["time"]
    heading = np.interp(own, t, np.unwrap(truth["compass_heading(degrees)"] * DEG))
    C_nb = dcm_from_euler(dot["Euler_X"] * DEG, -dot["Euler_Y"] * DEG, heading)
    f_frd = np.column_stack([dot["Acc_X"], -dot["Acc_Y"], -dot["Acc_Z"]])
    step = np.diff(own, prepend=own[0])[:, None]
    f_n = np.einsum("nij,nj->ni", C_nb, f_frd)
    path = np.cumsum(np.cumsum((f_n - f_n.mean(axis=0)) * step, axis=0) * step, axis=0)
    edge = BASE_S + LARGEST_LAG_S
    at = t[(t > max(own[0], t[0]) + edge) & (t < min(own[-1], t[-1]) - edge)]
    if len(at) < 3 * FIX_EVERY:
        return 0.0
    want = [_bend(truth[n], t, at) for n in ("North", "East", "Down")]
    lags = np.arange(-LARGEST_LAG_S, LARGEST_LAG_S + 1e-9, 0.01)
    cost = [sum(_unexplained(w, _bend(path[:, k], own, at - lag)) for k, w in enumerate(want)) for lag in lags]
    return _finest(cost, lags)


def _bend(x: Array, t: Array, at: Array) -> Array:
    """x(at + BASE_S) - 2 x(at) + x(at - BASE_S)."""
    return np.interp(at + BASE_S, t, x) - 2.0 * np.interp(at, t, x) + np.interp(at - BASE_S, t, x)


def _unexplained(y: Array, x: Array) -> float:
    """Sum of squares of y that a straight line in x leaves."""
    x, y = x - x.mean(), y - y.mean()
    gain = float(x @ y) / max(float(x @ x), 1e-12)
    return float(np.sum((y - gain * x) ** 2))


def _start(truth: dict[str, Array], lag: float, first: float) -> dict[str, float]:
    """Attitude and velocity when the IMU begins, or at the truth's first row where that is later."""
    t = truth["time"]
    at = max(first, float(t[0]))
    heading = np.unwrap(truth["compass_heading(degrees)"] * DEG)
    start = {"time": at}
    for name in ("roll", "pitch"):
        start[name] = float(np.interp(at, t, truth[f"{name}(degrees)"])) * DEG
    start["heading"] = float(np.mod(np.interp(at, t, heading), 2.0 * np.pi))
    for name, column in (("v_north", "North"), ("v_east", "East"), ("v_down", "Down")):
        start[name] = float(np.interp(at + lag, t, np.gradient(truth[column], t)))
    return start
