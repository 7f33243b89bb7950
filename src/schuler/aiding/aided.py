"""Kind "aided": an INS with whatever else the vehicle knows; a recording in, track, learnt errors, innovations out.

The filter is `aided_engine.Engine` with the kernels of `kernels.aided_*`; after it the RTS smoother.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from schuler.aiding import aided_stretches
from schuler.aiding.aided_engine import SMOOTHER_BYTES, Engine, Kept, max_nodes, node_bytes, room, rows_out
from schuler.aiding.aided_lag import stamp_lag, velocity_lag
from schuler.aiding.aided_rows import Events, events_of, imu_rows, sensors_present, slow_sigma, speed_of
from schuler.aiding.aided_sensors import Sensor, merged, take_own
from schuler.aiding.aided_settings import AidedSettings, Layout, Start, chosen, layout_of
from schuler.aiding.aided_start import find_start
from schuler.aiding.aided_still import standing
from schuler.aiding.solution import Innovations, Navigation, Solution, StateHistory
from schuler.ground.errors import InputError
from schuler.ground.tables import Table, Tables
from schuler.ground.terrain import HeightModel

__all__ = ["AidedSettings", "Sensor", "Start", "navigate", "settled"]

Array = NDArray[np.float64]
XYZ = ("x", "y", "z")
NED = ("north", "east", "down")
STATES: tuple[tuple[str, str, str, tuple[str, ...]], ...] = (  # slot, name, unit, components
    ("BG", "gyro_bias", "rad/s", XYZ),
    ("BA", "accel_bias", "m/s^2", XYZ),
    ("SG", "gyro_scale", "1", XYZ),
    ("SA", "accel_scale", "1", XYZ),
    ("MG", "gyro_misalignment", "rad", ("xy", "xz", "yx", "yz", "zx", "zy")),
    ("MA", "accel_misalignment", "rad", ("xy", "xz", "yx", "yz", "zx", "zy")),
    ("MNT", "mounting", "rad", ("roll", "pitch", "yaw")),
    ("ANT", "antenna_lever", "m", XYZ),
    ("DVL", "dvl_lever", "m", XYZ),
    ("SPD", "speed_lever", "m", XYZ),
    ("TG", "gnss_delay", "s", ("",)),
    ("TV", "gnss_velocity_delay", "s", ("",)),
    ("TD", "dvl_delay", "s", ("",)),
    ("TS", "speed_delay", "s", ("",)),
    ("KS", "speed_scale", "1", ("",)),
    ("CUR", "current", "m/s", ("north", "east")),
    ("GB", "gnss_bias", "m", NED),
    ("HB", "height_bias", "m", ("",)),
    ("DB", "depth_bias", "m", ("",)),
    ("KD", "dvl_scale", "1", ("",)),
    ("DM", "dvl_misalignment", "rad", XYZ),
    ("HO", "heading_offset", "rad", ("",)),
    ("MB", "mag_bias", "T", XYZ),
    ("KR", "range_scale", "1", ("",)),
    ("RB", "range_bias", "m", ("",)),
    ("USER", "user", "", ("0", "1", "2", "3")),
)
LOGARITHMS = ("speed_scale", "range_scale")


def navigate(tables: Tables, settings: AidedSettings, sensors: Sequence[Sensor] = ()) -> Navigation:
    """Filters and (settings.smoother) smooths a recording.

    tables : imu, and gnss, speed, dvl, depth, height, attitude, ranges with landmarks as far as present; sensors : the
    caller's own (`aided_sensors.Sensor`). Raises InputError where no start can be found.
    """
    if "imu" not in tables:
        raise InputError('the study gives no imu; kind aided needs one: [input] imu = "imu.csv"')
    if not sensors:
        stretches = aided_stretches.parts(tables, 1.0 / settings.gap_rate)
        if len(stretches) > 1:
            return aided_stretches.joined(stretches, settings, lambda t, s: _navigate(t, s, ()))
    return _navigate(tables, settings, sensors)


def _navigate(tables: Tables, settings: AidedSettings, sensors: Sequence[Sensor]) -> Navigation:
    rows = imu_rows(tables["imu"])
    if len(rows) < 10:
        raise InputError(f"the imu table holds {len(rows)} rows; nothing can be navigated with so few")
    gnss = tables.get("gnss")
    if "height_model" in tables and settings.height_model is None:
        settings = replace(settings, height_model=HeightModel.from_table(tables["height_model"]))
    settings, notes = settled(tables, settings)
    assert settings.estimate is not None
    layout = layout_of(settings, settings.estimate)
    events = events_of(tables, settings)
    notes += events.notes
    events = merged(events, sensors)
    still = _standing(rows, gnss, tables.get("speed"), settings)
    start, engine = find_start(rows, still, events, tables, settings, layout)
    notes += start.notes
    first = int(np.searchsorted(rows[:, 0], start.time + 1e-9))
    rows, still, events = rows[first:], still[first:], events.since(start.time)
    if len(rows) < 2:
        raise InputError(
            f"the start at {start.time:.2f} s leaves fewer than two IMU rows to navigate with; where it was found so "
            "late, type [start] heading_deg"
        )
    inner_rate = 10.0 + 1.0 / settings.nhc_interval + 2.0 / settings.still_interval
    span = float(rows[-1, 0]) - start.time
    nodes = max_nodes(settings, events, span)
    smoother = settings.smoother
    if smoother and nodes * node_bytes(layout.n) > SMOOTHER_BYTES:
        wide = replace(settings, node_interval=1.0)
        fewer = max_nodes(wide, events, span)
        if fewer * node_bytes(layout.n) > SMOOTHER_BYTES:
            smoother = False
            notes.append(
                f"no smoother: {fewer} nodes of {node_bytes(layout.n)} bytes need more than "
                f"{SMOOTHER_BYTES / 1e9:.0f} GB of memory"
            )
        else:
            settings, nodes = wide, fewer
            from schuler.kernels import aided_state as k

            engine.c[k.NODE_DT] = settings.node_interval
    engine.kept = room(
        layout.n, rows=rows_out(rows, start.time, settings.out_dt), events=len(events),
        inner=int(span * inner_rate) + 64, nodes=nodes if smoother else 0, stds=nodes,
    )  # fmt: skip
    inside = False
    while engine.run(rows, still, events, settings.out_dt, inside) == 1:
        take_own(engine, events, sensors)
        inside = True
    engine.check()
    done = int(engine.kept.counts[1])
    if done < len(events):
        notes.append(f"{len(events) - done} measurements after the last imu row were left out")
    return _navigation(engine, events, sensors, smoother, notes)


def settled(tables: Tables, settings: AidedSettings) -> tuple[AidedSettings, list[str]]:
    """The settings with what the tables say themselves: what is estimated, how large the fixes' slow error can be.

    Settings that name what is estimated come back as they are. A study that withholds fixes settles on all of them
    first, so that every run of a sweep is the same filter.
    """
    if settings.estimate is not None:
        names = chosen(settings, ())
        slow = slow_sigma(tables.get("gnss"), settings) if "gnss_bias" in names else 0.0
        return replace(settings, estimate=names, gnss_correlated_std=slow), []
    gnss, notes = tables.get("gnss"), []
    settings = replace(settings, gnss_correlated_std=slow_sigma(gnss, settings))
    delayed = False
    if gnss is not None and "imu" in tables:
        lag, apart = stamp_lag(imu_rows(tables["imu"]), gnss, _nose(tables, settings)), velocity_lag(gnss)
        # a vehicle that banks turns about an axis that its accelerometers do not show: more doubt
        least, times = (0.02, 4.0) if _nose(tables, settings) else (0.1, 6.0)
        if lag is not None and abs(lag[0] - settings.gnss_delay) > max(least, times * lag[1]):
            delayed = True
            notes.append(
                f"the fixes lag the IMU by {lag[0]:.3f} s (1 sigma {lag[1]:.3f} s, from turns): both delays "
                "are estimated"
            )
        if apart is not None and abs(apart[0]) > max(0.02, 4.0 * apart[1]):
            delayed = True
            notes.append(
                f"the receiver's velocity lags its position by {apart[0]:.3f} s (1 sigma {apart[1]:.3f} s): both "
                "delays are estimated"
            )
    if delayed and settings.gnss_delay == 0.0:
        # where the estimate begins; a delay below 0 also says when such a fix is taken
        v = lag[0] if lag is not None and abs(lag[0]) > 4.0 * lag[1] else 0.0
        d = apart[0] if apart is not None and abs(apart[0]) > 4.0 * apart[1] else 0.0
        settings = replace(settings, gnss_delay=v - d, gnss_velocity_delay=v)
    names = chosen(settings, sensors_present(tables), delayed=delayed)
    if "gnss_bias" not in names:
        settings = replace(settings, gnss_correlated_std=0.0)
    return replace(settings, estimate=names), notes


def _nose(tables: Tables, s: AidedSettings) -> bool:
    """Whether the vehicle goes where its x axis points."""
    return "nhc" in s.constraints or ("speed" in tables and s.speed_is == "ground")


def _standing(rows: Array, gnss: Table | None, wheels: Table | None, s: AidedSettings) -> NDArray[np.bool_]:
    if "zupt" not in s.constraints and "zaru" not in s.constraints:
        return np.zeros(len(rows), dtype=bool)
    times, speeds = [], []
    if gnss is not None and "v_north" in gnss and "v_east" in gnss:
        times.append(gnss.time - s.gnss_delay)
        speeds.append(np.hypot(gnss["v_north"], gnss["v_east"]))
    if wheels is not None and s.speed_is == "ground":
        times.append(wheels.time)
        speeds.append(np.abs(speed_of(wheels)))
    if not times:
        return standing(rows)
    time, speed = np.concatenate(times), np.concatenate(speeds)
    order = np.argsort(time, kind="stable")
    return standing(rows, time[order], speed[order])


def _navigation(
    engine: Engine, events: Events, sensors: Sequence[Sensor], smoother: bool, notes: list[str]
) -> Navigation:
    kept = engine.kept
    _, done, no, inner, nn, _ = (int(v) for v in kept.counts)
    ox = kept.ox[:no]
    cov = tuple(c[:no] for c in kept.cov)
    nn = min(nn, len(kept.node_time))
    times = kept.node_time[:nn]
    states = kept.nodes[2][:nn].copy()
    open_loop = kept.nodes[6][:nn]
    result = Navigation(filter=_solution(ox, *cov), notes=notes)
    result.innovations = _innovations(events, kept, done, inner, sensors)
    smoothed = smoothed_std = None
    if smoother and nn > 1:
        from schuler.kernels.aided_smooth import emit_smoothed, smooth

        nodes = tuple(a[:nn] for a in kept.nodes)
        dpre, dpost = np.zeros((nn, engine.layout.n)), np.zeros((nn, engine.layout.n))
        smooth(0, nn, engine.layout.ie, nodes, dpre, dpost)
        sx, spos, svel, satt = np.zeros_like(ox), *(np.zeros_like(c) for c in cov)
        emit_smoothed(no, 0, nn, engine.layout.ie, ox, times, nodes, dpre, dpost, sx, spos, svel, satt)
        result.smoother = _solution(sx, spos, svel, satt)
        smoothed = nodes[2]
        smoothed_std = np.sqrt(np.maximum(np.einsum("nii->ni", nodes[3]), 0.0))
    result.states = _histories(engine.layout, times, states, open_loop, kept.node_std[:nn], smoothed, smoothed_std)
    _tell_refusals(result)
    return result


def _solution(ox: Array, pos: Array, vel: Array, att: Array) -> Solution:
    from schuler.ground.frames import dcm_from_quat, euler_from_dcm
    from schuler.kernels import aided_state as k

    rpy = np.column_stack(euler_from_dcm(dcm_from_quat(ox[:, k.QUAT : k.QUAT + 4])))
    time, lat, lon, height = (ox[:, i].copy() for i in (k.NOMINAL, k.LAT, k.LON, k.HGT))
    return Solution(time, lat, lon, height, ox[:, k.VEL : k.VEL + 3].copy(), rpy, pos, vel, att)


_NAMES: dict[str, tuple[str, tuple[str, ...], str]] = {  # kernel's kind -> name, components, unit
    "POSITION": ("gnss_position", ("north", "east"), "m"),
    "HEIGHT_FIX": ("gnss_height", ("down",), "m"),
    "VELOCITY": ("gnss_velocity", ("north", "east"), "m/s"),
    "DOWN_VELOCITY": ("gnss_velocity_down", ("down",), "m/s"),
    "COURSE": ("gnss_course", ("course",), "rad"),
    "SPEED": ("speed", ("axial",), "m/s"),
    "BOTTOM_TRACK": ("dvl", ("forward", "right", "down"), "m/s"),
    "DEPTH": ("depth", ("down",), "m"),
    "HEIGHT": ("height", ("up",), "m"),
    "ATTITUDE": ("attitude", ("roll", "pitch", "heading"), "rad"),
    "MAGNETOMETER": ("magnetometer", ("heading",), "rad"),
    "RANGE": ("ranges", ("range",), "m"),
    "SIGHTING": ("sightings", ("u", "v"), "px"),
    "LIDAR": ("lidar", ("range",), "m"),
    "TERRAIN": ("lidar_ground", ("range",), "m"),
    "NONHOLONOMIC": ("nhc", ("right", "down"), "m/s"),
    "STANDING_V": ("zupt", ("north", "east", "down"), "m/s"),
    "STANDING_W": ("zaru", ("x", "y", "z"), "rad/s"),
}


def _innovations(
    events: Events, kept: Kept, done: int, inner: int, sensors: Sequence[Sensor]
) -> dict[str, Innovations]:
    from schuler.kernels import aided_measure as m
    from schuler.kernels.aided_run import USER

    found: dict[str, Innovations] = {}
    kinds, times, innov = events.kind[:done], events.time[:done], kept.innov[:done]
    sets: list[tuple[str, tuple[str, ...], str, Array, Array]] = []
    for name in ("POSITION", "VELOCITY", "COURSE", "SPEED", "BOTTOM_TRACK", "DEPTH", "HEIGHT", "ATTITUDE",
                 "MAGNETOMETER", "RANGE", "SIGHTING", "LIDAR", "TERRAIN"):  # fmt: skip
        mine = kinds == getattr(m, name)
        sets.append((*_NAMES[name], times[mine], innov[mine, 0]))
        if name in ("POSITION", "VELOCITY"):
            second = _NAMES["HEIGHT_FIX" if name == "POSITION" else "DOWN_VELOCITY"]
            sets.append((*second, times[mine], innov[mine, 1]))
    inner_t, inner_k, inner_rows = (a[:inner] for a in kept.inner)
    for name in ("NONHOLONOMIC", "STANDING_V", "STANDING_W"):
        mine = inner_k == getattr(m, name)
        sets.append((*_NAMES[name], inner_t[mine], inner_rows[mine]))
    for i, sensor in enumerate(sensors):
        mine = kinds == USER + i
        sets.append((sensor.name, sensor.components, sensor.unit, times[mine], innov[mine, 0]))
    for name, components, unit, t, rows in sets:
        told = np.isfinite(rows[:, 6]) if len(rows) else np.zeros(0, dtype=bool)
        if told.any():
            t, rows = t[told], rows[told]
            d = len(components)
            found[name] = Innovations(
                name, components, unit, t.copy(), rows[:, :d].copy(), rows[:, 3 : 3 + d].copy(), rows[:, 6].copy(),
                rows[:, 8] > 0.0, rows[:, 8].copy(),
            )  # fmt: skip
    return found


def _histories(
    layout: Layout, times: Array, x: Array, dx: Array, std: Array, smoothed: Array | None, smoothed_std: Array | None
) -> dict[str, StateHistory]:
    from schuler.kernels import aided_state as k

    states: dict[str, StateHistory] = {}
    for slot_name, stem, unit, components in STATES:
        slot = getattr(k, slot_name)
        for i, component in enumerate(components):
            j = int(layout.ie[slot + i])
            if j < 0 or (std[:, j].max(initial=0.0) <= 0.0):
                continue
            name = f"{stem}_{component}" if component else stem
            value, sigma = _told(stem, x[:, k.PAR + slot + i] - dx[:, j], std[:, j])
            state = StateHistory(name, unit, times, value, sigma)
            if smoothed is not None and smoothed_std is not None:
                state.smoothed, state.smoothed_std = _told(stem, smoothed[:, k.PAR + slot + i], smoothed_std[:, j])
            states[name] = state
    return states


def _told(stem: str, value: Array, std: Array) -> tuple[Array, Array]:
    """Logarithms of 1 + scale are told as scales."""
    if stem in LOGARITHMS:
        return np.expm1(value), np.exp(value) * std
    return value.copy(), std.copy()


def _tell_refusals(result: Navigation) -> None:
    for name, inn in result.innovations.items():
        refused = int((~inn.used).sum())
        if refused:
            result.notes.append(f"{name}: {refused} of {len(inn.used)} contradicted the filter wildly and were refused")


def unlimited(rate: float | str | None) -> float:
    """[output] rate_hz as rows a second: "imu" is every row."""
    return inf if rate == "imu" else 10.0 if rate is None else float(rate)
