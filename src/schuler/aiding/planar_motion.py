"""Odometry, turn rate and measurements of a planar vehicle as the arrays that the compiled filter runs over."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.planar_settings import PlanarSettings, Plane
from schuler.ground.errors import InputError
from schuler.ground.tables import Table, Tables

Array = NDArray[np.float64]
GAP_TURN = 0.1  # rad/s: how a vehicle may have turned in a gap that one row bridges, per second of gap
GAP_SPEED = 1.0  # m/s
STILL_S = 1.0  # the odometer must say 0 for so long before the turn rate is taken for a bias
STILL_RATE = 3e-4  # rad/s: floor of what a second of rest tells about the bias


@dataclass
class Stream:
    """Rows of one input: value over (begin, stamp], variance of its integral per s, variance of one value."""

    time: Array
    begin: Array
    value: Array
    integral: Array
    variance: Array


@dataclass
class Track:
    """What the kernel runs over (`kernels.planar.run`). need_*: the time from which a piece's input is known."""

    time: Array
    pieces: Array
    need_speed: Array
    need_turn: Array


@dataclass
class Measurements:
    """Sorted by time. kind (m,), z (m, MZ); beacons: their names, place (b, 2) m in the plane, height m or NaN."""

    time: Array
    kind: NDArray[np.int64]
    z: Array
    beacons: list[str] = field(default_factory=list)
    place: Array = field(default_factory=lambda: np.zeros((0, 2)))
    notes: list[str] = field(default_factory=list)


def _begins(time: Array, first: float | None) -> tuple[Array, float, NDArray[np.bool_]]:
    """Where each row begins, the usual interval, and which rows stand after a gap."""
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    begin = np.concatenate([[time[0] - usual if first is None or first >= time[0] else first], time[:-1]])
    gap = time - begin > max(3.0 * usual, usual + 0.5)
    gap[0] &= first is not None
    return begin, usual, gap


def speed_stream(table: Table, s: PlanarSettings) -> tuple[Stream, list[str]]:
    """Speed along the track from `speed` or `ddist`."""
    time = table.time
    begin, usual, gap = _begins(time, s.start.time)
    dt = np.maximum(time - begin, 1e-9)
    told = table["std_speed"] if "std_speed" in table else np.full(len(time), np.nan)
    std = np.where(np.isfinite(told) & (told > 0.0), told, s.speed_std)
    notes = []
    if "speed" in table:
        value, integral = table["speed"].copy(), std**2 * dt
        # the mean over a gap is not known: the row tells its own last interval
        begin = np.where(gap, time - usual, begin)
        integral = np.where(gap, std**2 * usual, integral)
    else:
        value, integral = table["ddist"] / dt, np.where(np.isfinite(told), std**2 * dt, 0.0)
        # an increment after a gap may hold the whole of it, or (rows lost) only its last interval
        before = np.concatenate([[0.0], np.abs(value[:-1])])
        lost = gap & (np.abs(value) < 0.5 * before)
        value = np.where(lost, table["ddist"] / usual, value)
        begin = np.where(lost, time - usual, begin)
        integral = np.where(gap & ~lost, integral + (0.2 * GAP_SPEED) ** 2 * dt, integral)
    good = np.isfinite(value)
    if gap.any():
        longest = int(np.argmax(np.where(gap, dt, 0.0)))
        notes.append(
            f"speed: {int(gap.sum())} gap{'s' * (int(gap.sum()) > 1)}, the longest {dt[longest]:.3g} s before "
            f"{time[longest]:.1f} s; the track is uncertain there"
        )
    stream = Stream(time, begin, value, integral, std**2)
    return Stream(*(getattr(stream, f)[good] for f in stream.__dataclass_fields__)), notes


def turn_stream(tables: Tables, s: PlanarSettings) -> tuple[Stream | None, str]:
    """Turn rate, clockwise, from heading increments of the odometer, else from gyro z (down); and what was used."""
    if "dheading" in tables["speed"]:
        table = tables["speed"]
        values, increments, who = table["dheading"], True, "heading increments of the speed table"
    elif "imu" in tables:
        table = tables["imu"]
        increments = table.kind == "increments"
        values, who = table["dtheta_z" if increments else "gyro_z"], "gyro z"
    else:
        return None, "nothing: the heading follows from fixes and ranges alone"
    good = np.isfinite(values)
    time, values = table.time[good], values[good]
    begin, usual, gap = _begins(time, s.start.time)
    dt = np.maximum(time - begin, 1e-9)
    value = values / dt if increments else values.copy()
    integral = np.full(len(time), s.gyro_arw**2)
    variance = s.gyro_arw**2 / dt
    if increments:
        integral = np.where(gap, integral + (GAP_TURN**2) * dt, integral)
    else:
        begin = np.where(gap, time - usual, begin)
        variance = np.where(gap, s.gyro_arw**2 / usual, variance)
    return Stream(time, begin, value, integral, variance), who


def pieces_of(speed: Stream, turn: Stream | None, start: float, ends: Array) -> Track:
    """The time line from start cut at every stamp and at `ends` (measurements and rows of the solution)."""
    stamps = [speed.time, speed.begin, ends] + ([] if turn is None else [turn.time, turn.begin])
    last = max(speed.time[-1], turn.time[-1] if turn is not None else -inf)
    time = np.unique(np.concatenate(stamps))
    time = np.concatenate([[start], time[(time > start) & (time <= last)]])
    dt = np.diff(time, prepend=start)
    pieces = np.zeros((len(time), 7))
    pieces[:, 0] = dt
    middle = time - 0.5 * dt
    need = []
    for column, stream in ((1, speed), (4, turn)):
        if stream is None or not len(stream.time):
            pieces[:, column] = np.nan
            need.append(np.full(len(time), -inf))
            continue
        row = np.searchsorted(stream.time, middle, side="left")
        inside = (row < len(stream.time)) & (dt > 0.0)
        row = np.minimum(row, len(stream.time) - 1)
        inside &= middle > stream.begin[row]
        pieces[:, column] = np.where(inside, stream.value[row], np.nan)
        pieces[:, column + 1] = stream.integral[row]
        pieces[:, column + 2] = stream.variance[row]
        need.append(np.maximum.accumulate(np.where(inside, stream.time[row], -inf)))
    return Track(time, pieces, need[0], need[1])


def rests(speed: Stream, turn: Stream | None, s: PlanarSettings) -> tuple[Array, Array]:
    """(time (r,), (r, 2) mean turn rate and its variance) of each second in which the odometer said exactly 0."""
    if turn is None or s.gyro_bias_std <= 0.0:
        return np.zeros(0), np.zeros((0, 2))
    found_t, found = [], []
    still = np.concatenate([[False], speed.value == 0.0, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    for a, b in zip(edges[::2], edges[1::2] - 1, strict=True):
        t0, t1 = float(speed.begin[a]) + 0.5 * STILL_S, float(speed.time[b])
        for k in range(int((t1 - t0) / STILL_S)):
            lo, hi = t0 + k * STILL_S, t0 + (k + 1) * STILL_S
            rows = (turn.time > lo) & (turn.time <= hi)
            # the block is told once both streams have passed it
            end = max(hi, float(speed.time[min(int(np.searchsorted(speed.time, hi)), len(speed.time) - 1)]))
            if rows.any() and end <= t1:
                span = float(np.sum((turn.time - turn.begin)[rows]))
                found_t.append(end)
                found.append([float(np.mean(turn.value[rows])), s.gyro_arw**2 / max(span, 0.1) + STILL_RATE**2])
    return np.array(found_t), np.array(found).reshape(-1, 2)


def measurements_of(tables: Tables, s: PlanarSettings, plane: Plane) -> Measurements:
    """Every usable fix and range; ranges to points that are not in landmarks are left out and told."""
    from schuler.kernels.planar import FIX, MZ, RANGE, VELOCITY

    time: list[Array] = []
    kind: list[Array] = []
    rows: list[Array] = []
    out = Measurements(np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros((0, MZ)))

    def add(t: Array, which: int, z: Array) -> None:
        good = np.isfinite(z).all(axis=1) & np.isfinite(t)
        time.append(t[good])
        kind.append(np.full(int(good.sum()), which))
        rows.append(z[good])

    if "gnss" in tables:
        g = tables["gnss"]
        north, east = plane.north_east(g["lat"], g["lon"])
        z = np.zeros((len(g), MZ))
        z[:, 0], z[:, 1] = north, east
        for k, column in enumerate(("std_north", "std_east")):
            told = g[column] if column in g else np.full(len(g), np.nan)
            good = np.isfinite(told) & (told > 0.0)
            sure = np.where(good, told, 1.0)
            # a receiver reports the whole error, the slow part included; a default is the white part alone
            slow = np.where(good, np.minimum(s.gnss_correlated_std, 0.9 * sure), s.gnss_correlated_std)
            z[:, 2 + k] = np.where(good, np.sqrt(np.maximum(sure**2 - slow**2, 0.0)), s.gnss_std[k])
            z[:, 4 + k] = slow
        add(g.time - s.gnss_delay, FIX, z)
        if "v_north" in g and "v_east" in g:
            z = np.zeros((len(g), MZ))
            z[:, 0], z[:, 1] = g["v_north"], g["v_east"]
            for k, column in enumerate(("std_v_north", "std_v_east")):
                told = g[column] if column in g else np.full(len(g), np.nan)
                z[:, 2 + k] = np.where(np.isfinite(told) & (told > 0.0), told, s.gnss_velocity_std[k])
            add(g.time - s.gnss_delay, VELOCITY, z)
    if "ranges" in tables:
        t, z = _ranges(tables, s, plane, out)
        add(t, RANGE, z)
    if time:
        all_t, all_k, all_z = np.concatenate(time), np.concatenate(kind), np.vstack(rows)
        order = np.lexsort((all_k, all_t))
        out.time, out.kind, out.z = all_t[order], all_k[order].astype(np.int64), all_z[order]
    return out


def _ranges(tables: Tables, s: PlanarSettings, plane: Plane, out: Measurements) -> tuple[Array, Array]:
    """Times and rows of the ranges; the beacons go into `out`."""
    from schuler.kernels.planar import MZ

    r = tables["ranges"]
    if "landmarks" not in tables:
        raise InputError(
            'ranges are given and the places of the beacons are not; type [input] landmarks = "landmarks.csv", a table '
            "id, lat[deg], lon[deg] (or north[m], east[m])"
        )
    marks = tables["landmarks"]
    names = [str(i) for i in marks["id"]]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise InputError(f"landmarks: id {', '.join(twice)} stands there more than once; give each beacon one row")
    ids = np.array([str(i) for i in r["id"]])
    used = [n for n in names if (ids == n).any()]
    unknown = sorted(set(ids.tolist()) - set(names))
    if unknown:
        count = int(np.isin(ids, unknown).sum())
        text = (
            f"ranges: {count} of {len(ids)} rows go to beacon {', '.join(unknown[:5])}{' ...' * (len(unknown) > 5)}, "
            f"and landmarks lists {', '.join(names[:8])}{' ...' * (len(names) > 8)}"
        )
        if not used:
            raise InputError(f"{text}; write the same ids in both tables")
        out.notes.append(f"{text}; they were left out")
    north, east = plane.north_east(marks["lat"], marks["lon"])
    height = marks["height"] if "height" in marks else np.full(len(marks), np.nan)
    index = {n: names.index(n) for n in used}
    out.beacons = used
    out.place = np.array([[north[index[n]], east[index[n]]] for n in used]).reshape(-1, 2)
    known = np.isin(ids, used)
    which = np.array([used.index(i) for i in ids[known]], dtype=int)
    mark = np.array([index[n] for n in used], dtype=int)[which]
    z = np.zeros((int(known.sum()), MZ))
    z[:, 0] = r["range"][known]
    told = r["std_range"][known] if "std_range" in r else np.full(len(z), np.nan)
    z[:, 1] = np.where(np.isfinite(told) & (told > 0.0), told, s.range_std) ** 2
    for column in ("std_north", "std_east"):
        if column in marks:
            z[:, 1] += 0.5 * np.nan_to_num(marks[column][mark]) ** 2
    z[:, 2], z[:, 3], z[:, 4] = which, north[mark], east[mark]
    if s.start.height is not None:
        z[:, 5] = np.nan_to_num(s.start.height - height[mark])
    return r.time[known], z


def line_of(place: Array) -> bool:
    """Whether beacons (b, 2) lie on one line (or are one or two): then a track and its mirror image fit alike."""
    if len(place) < 3:
        return True
    centred = place - place.mean(axis=0)
    spread = np.linalg.svd(centred, compute_uv=False)
    return bool(spread[1] < 0.02 * spread[0])


def first_time(speed: Stream, s: PlanarSettings) -> float:
    """Where navigation begins at the earliest: [start] time_s, or where the first row begins."""
    begin = float(speed.begin[0])
    given = s.start.time
    return begin if given is None or not isfinite(given) else max(given, begin)
