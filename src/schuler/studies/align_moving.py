"""`schuler align` of a vehicle that moves: the aided filter's own start, and the filter from there to the end."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table, Tables
from schuler.inertial.alignment import Alignment
from schuler.studies.run import Progress

if TYPE_CHECKING:
    from schuler.aiding.aided_engine import Engine
    from schuler.studies.model import Study

Array = NDArray[np.float64]
LONGEST_S = 300.0  # where [align] to_s is absent
MOVING_MPS = 0.7


def moves(gnss: Table | None, from_s: float | None, to_s: float | None) -> bool:
    """Whether fixes say that the vehicle moves in a stretch of time."""
    if gnss is None:
        return False
    inside = (gnss.time >= (-math.inf if from_s is None else from_s)) & (
        gnss.time <= (math.inf if to_s is None else to_s)
    )
    g = gnss.where(inside)
    if "v_north" in g and "v_east" in g:
        speed = np.hypot(g["v_north"], g["v_east"])
        speed = speed[np.isfinite(speed)]
        return bool(len(speed) and np.median(speed) > MOVING_MPS)
    if len(g) < 3:
        return False
    from schuler.ground.earth import WGS84

    zero = np.zeros(len(g) - 1)
    way = WGS84.displacement_n(g["lat"][1:], g["lon"][1:], zero, g["lat"][:1], g["lon"][:1], zero)[:, :2]
    far = np.linalg.norm(way, axis=1)
    return bool(np.nanmedian(far) > max(20.0, MOVING_MPS * 0.5 * float(g.time[-1] - g.time[0])))


def align_moving(study: Study, tables: Tables, declination: float | None, progress: Progress) -> Alignment:
    """Attitude at `to_s`, by the filter over [align] from_s to to_s. InputError says why there is none."""
    from schuler.aiding.aided import _standing, settled
    from schuler.aiding.aided_engine import room
    from schuler.aiding.aided_rows import events_of, imu_rows
    from schuler.aiding.aided_settings import Start, layout_of
    from schuler.aiding.aided_start import find_start
    from schuler.studies.aided_mapping import aided_settings
    from schuler.studies.warm import need

    need("aided_run", "aided_smooth")
    window = study.align
    from_s = window.from_s if window is not None else None
    to_s = window.to_s if window is not None else None
    if "gnss" not in tables and not ("attitude" in tables and study.start.lat_deg is not None):
        raise InputError(
            "alignment in motion needs fixes to see the motion by: name a gnss table in [input], or align on a still "
            "stretch"
        )
    tables = within(tables, from_s, to_s)
    settings = aided_settings(study, declination=declination)
    given = settings.start
    place = Start() if "gnss" in tables else Start(lat=given.lat, lon=given.lon, height=given.height)
    settings = replace(settings, start=place, smoother=False)
    settings, notes = settled(tables, settings)
    assert settings.estimate is not None
    rows = imu_rows(tables["imu"])
    events = events_of(tables, settings)
    layout = layout_of(settings, settings.estimate)
    still = _standing(rows, tables.get("gnss"), tables.get("speed"), settings)
    progress("aligning in motion")
    start, engine = find_start(rows, still, events, tables, settings, layout)
    first = int(np.searchsorted(rows[:, 0], start.time + 1e-9))
    rows, still, events = rows[first:], still[first:], events.since(start.time)
    time, std = [start.time], [_rpy(engine)[2]]
    engine.kept = room(layout.n, events=len(events), inner=1)
    steps: Array = np.linspace(0, len(rows), 61)[1:]
    for upto in np.unique(steps.astype(int)).tolist():
        engine.run(rows[:upto], still[:upto], events, 1.0)
        time.append(float(engine.x[_t()]))
        std.append(_rpy(engine)[2])
    engine.check()
    rpy, cov, _ = _rpy(engine)
    from schuler.ground.frames import dcm_from_euler

    bias = _bias(engine)
    return Alignment(
        "moving", float(tables["imu"].time[0]), time[-1], rpy, np.asarray(dcm_from_euler(*rpy)), cov, bias[0], bias[1],
        math.nan, None, np.array(time), np.array(std), [*notes, *start.notes],
    )  # fmt: skip


def within(tables: Tables, from_s: float | None, to_s: float | None) -> dict[str, Table]:
    """The tables' rows in (from_s, to_s]; without an end the first five minutes."""
    imu = tables["imu"]
    begin = -math.inf if from_s is None else from_s
    first = imu.time[imu.time > begin]
    if not len(first):
        raise InputError(
            f"[align] from_s = {begin:g} s lies after the imu's last row at {imu.time[-1]:.2f} s; put it inside"
        )
    end = float(first[0]) + LONGEST_S if to_s is None else to_s
    cut = {}
    for name, table in tables.items():
        if "time" not in table:
            cut[name] = table
            continue
        rows = (table.time > begin) & (table.time <= end + 1e-9)
        if rows.any():
            cut[name] = table.where(rows)
    if len(cut["imu"]) < 10:
        raise InputError(f"between {begin:g} and {end:g} s there are {len(cut['imu'])} IMU rows: too few to align on")
    if "gnss" in tables and "gnss" not in cut:
        g = tables["gnss"].time
        raise InputError(
            f"no fix lies between {float(first[0]):.1f} and {end:.1f} s (they run from {g[0]:.1f} to {g[-1]:.1f} s): "
            "alignment in motion needs them; move [align] from_s and to_s"
        )
    return cut


def _t() -> int:
    from schuler.kernels.aided_state import T

    return int(T)


def _rpy(engine: Engine) -> tuple[Array, Array, Array]:
    """Roll, pitch, heading (rad), their covariance and their sigmas."""
    from schuler.kernels.aided_run import covariances
    from schuler.kernels.rotation import euler_from_quat

    x, P = engine.x, engine.P
    cov = np.zeros((3, 3, 3))
    covariances(x, P, cov[0], cov[1], cov[2])
    return np.array(euler_from_quat(*x[:4])), cov[2], np.sqrt(np.maximum(np.diag(cov[2]), 0.0))


def _bias(engine: Engine) -> tuple[Array, Array]:
    from schuler.kernels.aided_state import BA, BG, PAR

    x = engine.x
    return x[PAR + BG : PAR + BG + 3].copy(), x[PAR + BA : PAR + BA + 3].copy()
