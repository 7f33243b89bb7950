"""Kind "auv", method "schuler": a recording in, track with covariance, learnt states and innovations out.

The filter is `auv_online.AuvFilter`; here the same compiled steps run over whole tables, and the RTS smoother after it.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite, nan

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.auv_online import KINDS, AuvFilter, Measurement, _arrays, _order
from schuler.aiding.auv_settings import AuvSettings, Start
from schuler.aiding.solution import Innovations, Navigation, Solution, StateHistory
from schuler.ground.errors import InputError
from schuler.ground.tables import Table, Tables

__all__ = ["AuvFilter", "AuvSettings", "Measurement", "Start", "navigate"]

Array = NDArray[np.float64]
SMOOTHER_BYTES = 3e9
AXES = ("north", "east", "down")
STATES = (  # name, unit, index in the nominal state, index in the error state
    ("gyro_bias_x", "rad/s", 4, 3),
    ("gyro_bias_y", "rad/s", 5, 4),
    ("gyro_bias_z", "rad/s", 6, 5),
    ("accel_bias_x", "m/s^2", 7, 6),
    ("accel_bias_y", "m/s^2", 8, 7),
    ("accel_bias_z", "m/s^2", 9, 8),
    ("speed", "m/s", 13, 12),
    ("speed_scale", "1", 14, 13),
    ("current_north", "m/s", 15, 14),
    ("current_east", "m/s", 16, 15),
    ("heading_offset", "rad", 17, 16),
    ("gnss_bias_north", "m", 18, 17),
    ("gnss_bias_east", "m", 19, 18),
    ("path_scale", "1", 20, 19),
    ("dvl_scale", "1", 21, 20),
)
INNOVATIONS = {  # kernel's kind -> name on the page, components, unit
    "position": ("gnss_position", ("north", "east"), "m"),
    "adrift": ("surface_fix", ("north", "east"), "m"),  # on a surface leg without speed: how it drifts
    "velocity": ("gnss_velocity", ("north", "east"), "m/s"),
    "speed": ("speed", ("axial",), "m/s"),
    "dvl": ("dvl", ("forward", "right"), "m/s"),
    "depth": ("depth", ("down",), "m"),
    "levelling": ("levelling", ("north", "east"), "m/s^2"),
    "magnetometer": ("magnetometer", ("heading",), "rad"),
}


def input_rows(tables: Tables, settings: AuvSettings) -> tuple[Array, bool, list[str]]:
    """The filter's input rows, whether they are compass rows, and notes: (n, 7|10) imu or (n, 4) attitude."""
    notes: list[str] = []
    if "imu" in tables:
        imu = tables["imu"]
        t = imu.time
        if imu.kind == "increments":
            gyro, force = imu.stack("dtheta_x", "dtheta_y", "dtheta_z"), imu.stack("dv_x", "dv_y", "dv_z")
            dt = np.diff(t, prepend=t[0] - float(np.median(np.diff(t))))[:, None]
            gyro, force = gyro / dt, force / dt
        else:
            gyro, force = imu.stack("gyro_x", "gyro_y", "gyro_z"), imu.stack("accel_x", "accel_y", "accel_z")
        parts = [t[:, None], gyro, force]
        if "mag_x" in imu and "mag_y" in imu and "mag_z" in imu:
            parts.append(imu.stack("mag_x", "mag_y", "mag_z"))  # NaN: no field in that row
        return np.ascontiguousarray(np.hstack(parts)), False, notes
    if "attitude" not in tables:
        raise InputError(
            'the study gives neither imu nor attitude; kind auv needs one of them: [input] imu = "imu.csv"'
        )
    table = tables["attitude"]
    heading = table["heading"] if "heading" in table else table["heading_mag"] + settings.declination
    rows = np.column_stack([table.time, table["roll"], table["pitch"], heading])
    good = np.isfinite(rows).all(axis=1)
    if not good.all():
        notes.append(f"attitude: {int((~good).sum())} rows without numbers were left out")
    return np.ascontiguousarray(rows[good]), True, notes


def measurements_of(tables: Tables, settings: AuvSettings) -> list[Measurement]:
    """Every usable row of gnss, speed, dvl and depth as a measurement, sorted as the filter takes them."""
    found: list[Measurement] = []

    def sigma(table: Table, column: str, default: float) -> Array:
        values = table[column].astype(float) if column in table else np.full(len(table), nan)
        return np.where(np.isfinite(values) & (values > 0.0), values, default)

    if "gnss" in tables:
        g = tables["gnss"]
        s = [
            _white(g, f"std_{a}", d, settings)
            for a, d in zip(("north", "east", "down"), settings.gnss_std, strict=True)
        ]
        height = g["height"] if "height" in g else np.full(len(g), nan)
        for i, t in enumerate(g.time):
            if isfinite(g["lat"][i]) and isfinite(g["lon"][i]):
                std = (float(s[0][i]), float(s[1][i]), float(s[2][i]))
                found.append(
                    Measurement.position(float(t), float(g["lat"][i]), float(g["lon"][i]), float(height[i]), std=std)
                )
        if "v_north" in g and "v_east" in g:
            w = [
                sigma(g, f"std_v_{a}", d)
                for a, d in zip(("north", "east", "down"), settings.gnss_velocity_std, strict=True)
            ]
            down = g["v_down"] if "v_down" in g else np.zeros(len(g))
            for i, t in enumerate(g.time):
                v = (float(g["v_north"][i]), float(g["v_east"][i]), float(np.nan_to_num(down[i])))
                if isfinite(v[0]) and isfinite(v[1]):
                    std = (float(w[0][i]), float(w[1][i]), float(w[2][i]))
                    found.append(Measurement.velocity(float(t), v, std=std))
    if "speed" in tables:
        log = tables["speed"]
        std_s = sigma(log, "std_speed", settings.speed_std).tolist()
        for t, v, sd in zip(log.time.tolist(), log["speed"].tolist(), std_s, strict=True):
            if isfinite(v):
                found.append(Measurement.speed(t, v, std=sd))
    if "dvl" in tables:
        d = tables["dvl"]
        std_d = sigma(d, "std_v_x", settings.dvl_std).tolist()
        for t, x, y, sd in zip(d.time.tolist(), d["v_x"].tolist(), d["v_y"].tolist(), std_d, strict=True):
            if isfinite(x) and isfinite(y):
                found.append(Measurement.dvl(t, (x, y, 0.0), std=sd))
    if "depth" in tables:
        gauge = tables["depth"]
        std_z = sigma(gauge, "std_depth", settings.depth_std).tolist()
        for t, z, sd in zip(gauge.time.tolist(), gauge["depth"].tolist(), std_z, strict=True):
            if isfinite(z):
                found.append(Measurement.depth(t, z, std=sd))
    found.sort(key=_order)
    return found


def _white(g: Table, column: str, default: float, settings: AuvSettings) -> Array:
    """White part of a fix's sigma: a receiver reports the whole, the slow part included; a default is white alone."""
    told = g[column].astype(float) if column in g else np.full(len(g), nan)
    good = np.isfinite(told) & (told > 0.0)
    slow = np.minimum(settings.gnss_correlated_std, 0.9 * np.where(good, told, inf))
    return np.where(good, np.sqrt(np.maximum(np.where(good, told, 1.0) ** 2 - slow**2, 0.0)), default)


def with_receiver(settings: AuvSettings, tables: Tables) -> AuvSettings:
    """The same settings with the slow error of fixes no larger than the receiver's own sigmas allow."""
    g = tables.get("gnss")
    if g is None or "std_north" not in g:
        return settings
    told = g["std_north"][np.isfinite(g["std_north"]) & (g["std_north"] > 0.0)]
    if not len(told):
        return settings
    # The first sigma alone: a row of the solution must not know what comes later.
    return replace(settings, gnss_correlated_std=min(settings.gnss_correlated_std, 0.9 * float(told[0])))


def make_filter(tables: Tables, settings: AuvSettings, rows: Array, compass: bool) -> AuvFilter:
    """An online filter that expects the sensors of these tables."""
    return AuvFilter(
        settings,
        compass=compass,
        log="speed" in tables,
        depth="depth" in tables,
        dvl="dvl" in tables,
        mag=not compass and rows.shape[1] == 10,
    )


def navigate(tables: Tables, settings: AuvSettings) -> Navigation:
    """Filters and (settings.smoother) smooths a recording.

    tables : imu or attitude; gnss, speed, dvl, depth as far as present. Raises InputError where no start can be found.
    """
    from schuler.kernels.auv_run import INNOVATION, OUT, run
    from schuler.kernels.auv_state import NOMINAL, NX, N, T

    settings = with_receiver(settings, tables)
    rows, compass, notes = input_rows(tables, settings)
    if len(rows) < 2:
        raise InputError("the imu (or attitude) table holds fewer than two rows; nothing can be navigated")
    measurements = measurements_of(tables, settings)
    nav = make_filter(tables, settings, rows, compass)
    first_row, first_m = _until_started(nav, rows, measurements)
    started = nav.time
    if started - rows[0, 0] > 5.0:
        notes.append(f"navigation begins {started - rows[0, 0]:.0f} s after the first row: at the first usable fix")

    mt, mk, mz, innov = _arrays(measurements[first_m:])
    n_rows, n_m = len(rows) - first_row, len(mt)
    if settings.every_epoch or (compass and settings.output_rate is None):
        out_dt, n_out = (-1.0 if compass else 0.0), n_rows + n_m + 1
    else:
        rate = settings.output_rate or 10.0
        out_dt = 1.0 / rate
        n_out = min(n_rows, int((rows[-1, 0] - started) * rate * 1.01) + 4)
    span = max(rows[-1, 0], mt[-1] if n_m else -inf) - started
    max_nodes = n_m + int(span / (60.0 if compass else 1.0) * 1.2) + 16
    smoother = settings.smoother
    if smoother and max_nodes * (3 * N * N + 2 * NX) * 8 > SMOOTHER_BYTES:
        smoother = False
        notes.append(f"no smoother: {max_nodes} nodes would need more than {SMOOTHER_BYTES / 1e9:.0f} GB of memory")
    k = max_nodes if smoother else 0
    nodes = (
        np.zeros((k, NX)),
        np.zeros((k, N, N)),
        np.zeros((max_nodes, NX)),
        np.zeros((k, N, N)),
        np.zeros((k, N, N)),
    )
    ustd = np.zeros((max_nodes, N))
    out = (np.zeros((n_out, OUT)), np.zeros((n_out, 3, 3)), np.zeros((n_out, 3, 3)), np.zeros((n_out, 3, 3)))
    n_inner = int(span * 1.2) + 16
    inner_t, inner = np.zeros((2, n_inner)), np.zeros((2, n_inner, INNOVATION))
    counts = np.zeros(5, np.int64)
    run(
        nav.x,
        nav.P,
        nav.X,
        nav.c,
        rows,
        mt,
        mk,
        mz,
        out_dt,
        *out,
        innov,
        inner_t,
        inner,
        nodes,
        ustd,
        first_row,
        counts,
    )
    no, k0, k1, nn, done = (int(n) for n in counts)
    if not np.isfinite(nav.x[:NOMINAL]).all():
        raise InputError("the filter lost its numbers; the input holds values far outside any vehicle (schuler check)")
    if done < n_m:
        notes.append(f"{n_m - done} measurements after the last imu row were left out")

    ox, pos, vel, att = (a[:no] for a in out)
    states_raw = nodes[2][:nn].copy()
    times = states_raw[:, T].copy()
    result = Navigation(filter=_solution(ox, pos, vel, att), notes=notes)
    result.innovations = _innovations(measurements[first_m:], innov, done, inner_t, inner, (k0, k1))
    smoothed = smoothed_std = None
    if smoother and nn > 1:
        from schuler.kernels.auv_smooth import emit_smoothed, smooth

        nx, nP, ux, uP, nX = (a[:nn] for a in nodes)
        dpre, dpost = smooth(nn, nav.c, nx, nP, ux, uP, nX)
        sx, spos, svel, satt = (np.zeros_like(a) for a in (ox, pos, vel, att))
        emit_smoothed(no, nn, nav.c, ox, times, ux, uP, dpre, dpost, sx, spos, svel, satt)
        result.smoother = _solution(sx, spos, svel, satt)
        smoothed = ux
        smoothed_std = np.sqrt(np.maximum(np.einsum("nii->ni", uP), 0.0))
    result.states = _histories(times, states_raw, ustd[:nn], smoothed, smoothed_std)
    _tell_rejections(result)
    return result


def _until_started(nav: AuvFilter, rows: Array, measurements: list[Measurement]) -> tuple[int, int]:
    """Feeds the filter in time order until it has started: next row, next measurement."""
    from schuler.kernels.auv_state import TROW

    i = j = 0
    while not nav.started:
        if i >= len(rows) and j >= len(measurements):
            raise InputError(
                "no start was found: no fix with a course, compass heading or [start] position and heading; "
                "give [start] lat_deg, lon_deg, heading_deg, or a gnss table that overlaps the imu's time"
            )
        if j >= len(measurements) or (i < len(rows) and rows[i, 0] <= measurements[j].time):
            nav.predict(rows[i])
            i += 1
        else:
            nav.update(measurements[j])
            j += 1
    while i < len(rows) and rows[i, 0] <= nav.x[TROW]:
        i += 1
    return i, j


def _solution(ox: Array, pos: Array, vel: Array, att: Array) -> Solution:
    from schuler.ground.frames import dcm_from_quat, euler_from_dcm
    from schuler.kernels.auv_run import OUT_DRIFT, OUT_T, OUT_TELLS
    from schuler.kernels.auv_state import CN, DE, DN, HGT, KP, LAT, LON, U, W

    C_nb = dcm_from_quat(ox[:, 0:4])
    roll, pitch, heading = euler_from_dcm(C_nb)
    forward = C_nb[:, :, 0] * ox[:, U : U + 1]
    v_n = forward * np.exp(ox[:, KP : KP + 1])
    v_n[:, 0] += ox[:, CN] + ox[:, W]
    v_n[:, 1] += ox[:, CN + 1] + ox[:, W + 2]
    v_n[:, 2] = forward[:, 2] * ox[:, OUT_TELLS]
    drift = ox[:, OUT_DRIFT] > 0.5
    v_n[drift] = np.column_stack([ox[drift, DN], ox[drift, DE], np.zeros(int(drift.sum()))])
    rpy = np.column_stack([roll, pitch, heading])
    time, lat, lon, height = (ox[:, i].copy() for i in (OUT_T, LAT, LON, HGT))
    return Solution(time, lat, lon, height, v_n, rpy, pos, vel, att)


def _innovations(
    measurements: list[Measurement], innov: Array, done: int, inner_t: Array, inner: Array, counts: tuple[int, int]
) -> dict[str, Innovations]:
    found: dict[str, Innovations] = {}
    kinds = np.array([KINDS.index(m.kind) for m in measurements[:done]], dtype=int)
    times = np.array([m.time for m in measurements[:done]])
    adrift = innov[:done, 8] > 2.5
    sets = [(kind, times[(kinds == i) & ~adrift], innov[:done][(kinds == i) & ~adrift]) for i, kind in enumerate(KINDS)]
    sets.append(("adrift", times[adrift], innov[:done][adrift]))
    sets += [
        (kind, inner_t[i, : counts[i]], inner[i, : counts[i]]) for i, kind in enumerate(("levelling", "magnetometer"))
    ]
    for kind, t, rows in sets:
        if len(t):
            name, components, unit = INNOVATIONS[kind]
            d = len(components)
            found[name] = Innovations(
                name, components, unit, t.copy(), rows[:, :d].copy(), rows[:, 3 : 3 + d].copy(), rows[:, 6].copy(),
                rows[:, 8] > 0.5,
            )  # fmt: skip
    return found


def _histories(
    times: Array, x: Array, std: Array, smoothed: Array | None, smoothed_std: Array | None
) -> dict[str, StateHistory]:
    states: dict[str, StateHistory] = {}
    for name, unit, ix, ie in STATES:
        if std[:, ie].max(initial=0.0) <= 0.0:
            continue
        value, sigma = _told(name, x[:, ix], std[:, ie])
        state = StateHistory(name, unit, times, value, sigma)
        if smoothed is not None and smoothed_std is not None:
            state.smoothed, state.smoothed_std = _told(name, smoothed[:, ix], smoothed_std[:, ie])
        states[name] = state
    return states


def _told(name: str, value: Array, std: Array) -> tuple[Array, Array]:
    """A state as users know it: scales of speed are logarithms inside."""
    if name in ("speed_scale", "path_scale"):
        return np.expm1(value), std * np.exp(value)
    return value.copy(), std.copy()


def _tell_rejections(nav: Navigation) -> None:
    for name, i in nav.innovations.items():
        left_out = int((~i.used).sum())
        if left_out:
            nav.notes.append(
                f"{name}: {left_out} of {len(i.time)} measurements contradicted the filter and were left out"
            )


def with_start(settings: AuvSettings, **given: float) -> AuvSettings:
    """The same settings with parts of the start replaced."""
    return replace(settings, start=replace(settings.start, **given))  # type: ignore[arg-type]
