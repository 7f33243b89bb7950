"""Kind "planar": odometry, turn rate, fixes and ranges in; track with covariance, learnt states and innovations out.

The motion rows are the filter's input, fixes and ranges its measurements. A row tells the interval before its stamp, so
a measurement inside the interval is used with the row's own speed and turn once it is there; a row of the solution that
lies before it knows only what was known then (`kernels.planar.run`).
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding import planar_motion as motion
from schuler.aiding.planar_settings import LOGARITHMS, STATES, PlanarSettings, Plane, configuration, prior
from schuler.aiding.planar_start import Begin, find
from schuler.aiding.solution import Innovations, Navigation, Solution, StateHistory
from schuler.ground.errors import InputError
from schuler.ground.tables import Tables

__all__ = ["Plane", "PlanarSettings", "navigate", "plane_of"]

Array = NDArray[np.float64]
SMOOTHER_BYTES = 3e9
INNOVATIONS = (  # kernel's kind -> name, components, unit
    ("gnss_position", ("north", "east"), "m"),
    ("range", ("range",), "m"),
    ("rest", ("turn rate",), "rad/s"),
    ("gnss_velocity", ("north", "east"), "m/s"),
)


def plane_of(tables: Tables, settings: PlanarSettings) -> Plane:
    """The plane through the first fix, else [start], else the middle of the beacons."""
    if "gnss" in tables and len(tables["gnss"]):
        g = tables["gnss"]
        known = np.flatnonzero(np.isfinite(g["height"])) if "height" in g else np.zeros(0, dtype=int)
        height = float(g["height"][known[0]]) if len(known) else 0.0  # the first: no row may know a later one
        return Plane(float(g["lat"][0]), float(g["lon"][0]), height)
    if settings.start.lat is not None and settings.start.lon is not None:
        return Plane(settings.start.lat, settings.start.lon, settings.start.height or 0.0)
    if "landmarks" in tables:
        marks = tables["landmarks"]
        return Plane(float(np.mean(marks["lat"])), float(np.mean(marks["lon"])), settings.start.height or 0.0)
    raise InputError(
        "no start was found: type lat_deg, lon_deg (in metres: north_m, east_m) and heading_deg under [start], or name "
        "a gnss table, or ranges and landmarks"
    )


def navigate(tables: Tables, settings: PlanarSettings, plane: Plane | None = None) -> Navigation:
    """Filters and (settings.smoother) smooths a recording.

    tables : speed with `speed` or `ddist`, and `dheading` or an imu; gnss, ranges and landmarks as far as present, all
    with lat and lon. Raises InputError where no start can be found.
    """
    from schuler.kernels import planar as k

    if "speed" not in tables or len(tables["speed"]) < 2:
        raise InputError('kind "planar" needs a speed table of two rows at least: speed[m/s], or ddist[m]')
    plane = plane or plane_of(tables, settings)
    notes: list[str] = []
    speed, said = motion.speed_stream(tables["speed"], settings)
    notes += said
    turn, who = motion.turn_stream(tables, settings)
    notes.append(f"turn rate: from {who}")
    t0 = motion.first_time(speed, settings)
    last = max(float(speed.time[-1]), float(turn.time[-1]) if turn is not None else -inf)
    if t0 >= last:
        raise InputError(f"[start] time_s = {t0:g} s lies after the end of the speed table ({last:g} s)")
    m = motion.measurements_of(tables, settings, plane)
    notes += m.notes
    rest_t, rest_z = motion.rests(speed, turn, settings)
    mt, mk, mz = _sorted(m, rest_t, rest_z, t0, last, notes)
    rows_t = _rows(tables, speed, settings, m, t0, last)
    track = motion.pieces_of(speed, turn, t0, np.concatenate([mt, rows_t]))
    m.time, m.kind, m.z = mt, mk, mz
    begin = find(track, m, settings, plane)
    if len(begin.echoes):
        kept = np.setdiff1d(np.arange(len(mt)), begin.echoes)
        mt, mk, mz = mt[kept], mk[kept], np.ascontiguousarray(mz[kept])
        m.time, m.kind, m.z = mt, mk, mz
    notes += begin.notes
    all_t = rows_t
    rows_t = rows_t[rows_t >= begin.told]
    if not len(rows_t):
        rows_t = all_t = np.array([last])

    x, P = _initial(settings, begin, len(m.beacons), bool((mk == k.FIX).any()))
    n = len(x)
    s = np.zeros(k.NS)
    s[k.FIX_T] = s[k.RANGE_T] = t0
    ends = track.time
    o_to = np.searchsorted(ends, rows_t, side="left")
    ready = np.maximum(track.need_speed, track.need_turn)
    o_base = np.minimum(np.searchsorted(ready, rows_t, side="right") - 1, o_to)
    o_speed = np.searchsorted(track.need_speed, rows_t, side="right") - 1
    o_turn = np.searchsorted(track.need_turn, rows_t, side="right") - 1
    is_node = np.zeros(len(ends), dtype=bool)
    is_node[0] = is_node[-1] = True
    is_node[np.searchsorted(ends, all_t, side="left")] = True
    is_node[np.searchsorted(ends, mt, side="left")] = True
    nn = int(is_node.sum())
    smoother = settings.smoother
    if smoother and nn * (3 * n * n + 2 * n) * 8 > SMOOTHER_BYTES:
        smoother = False
        notes.append(f"no smoother: {nn} nodes would need more than {SMOOTHER_BYTES / 1e9:.0f} GB of memory")
    held = nn if smoother else 0
    nodes = (np.zeros((held, n)), np.zeros((held, n, n)), np.zeros((held, n)), np.zeros((held, n, n)),
             np.zeros((held, n, n)))  # fmt: skip
    states = np.zeros((nn, n))
    ustd, innov = np.zeros((nn, n)), np.zeros((len(mt), k.INNOVATION))
    ox, oP = np.zeros((len(rows_t), k.MOVING)), np.zeros((len(rows_t), k.MOVING, k.MOVING))
    m_to = np.searchsorted(mt, ends, side="right")
    counts = np.zeros(3, np.int64)
    k.run(x, P, configuration(settings), s, ends, track.pieces, m_to, is_node, mk, mz, innov, o_base, o_to, o_speed,
          o_turn, ox, oP, nodes, states, ustd, counts)  # fmt: skip
    if not np.isfinite(x).all():
        raise InputError("the filter lost its numbers; the input holds values far outside any vehicle")
    node_t = ends[is_node]
    result = Navigation(filter=_solution(plane, rows_t, ox, oP), notes=notes)
    result.innovations = _innovations(mt, mk, innov, begin.told)
    smoothed = smoothed_std = None
    if smoother and nn > 1:
        from schuler.kernels.planar_smooth import smooth

        smooth(*nodes)
        smoothed, uP = nodes[2], nodes[3]
        smoothed_std = np.sqrt(np.maximum(np.einsum("nii->ni", uP), 0.0))
        row = np.searchsorted(node_t, all_t, side="left")  # a smoothed row knows the start that was found later
        d = k.MOVING
        result.smoother = _solution(plane, all_t, smoothed[row, :d], uP[row][:, :d, :d])
    slow = [float(np.median(mz[mk == k.FIX, 4 + i])) if (mk == k.FIX).any() else 0.0 for i in (0, 1)]
    result.states = _histories(node_t, states, ustd, smoothed, smoothed_std, m.beacons, slow, begin.told)
    result.extras["beacons"] = _beacons(m, plane, innov, begin.told, result.states)
    _tell_rejections(result)
    return result


def _beacons(
    m: motion.Measurements, plane: Plane, innov: Array, told: float, states: dict[str, StateHistory]
) -> list[dict[str, Any]]:
    """One entry a beacon: id, place, how its ranges fitted after the start, and the bias that was learnt."""
    from schuler.kernels.planar import RANGE

    out = []
    for i, name in enumerate(m.beacons):
        rows = (m.kind == RANGE) & (m.z[:, 2] == i) & (m.time > told)
        used = innov[rows, 5] > 0.0
        y, nis = innov[rows, 0][used], innov[rows, 4][used]
        lat, lon = plane.geodetic(m.place[i, 0], m.place[i, 1])
        bias = states.get(f"range_bias_{name}")
        out.append(
            {
                "id": name,
                "lat": float(lat),
                "lon": float(lon),
                "ranges": int(rows.sum()),
                "left_out": int((~used).sum()),
                "rms_m": float(np.sqrt(np.mean(y**2))) if len(y) else None,
                "nis": float(np.mean(nis)) if len(nis) else None,
                "bias_m": float(bias.value[-1]) if bias is not None and len(bias.value) else None,
                "std_m": float(bias.std[-1]) if bias is not None and len(bias.std) else None,
            }
        )
    return out


def _sorted(
    m: motion.Measurements, rest_t: Array, rest_z: Array, t0: float, last: float, notes: list[str]
) -> tuple[Array, NDArray[np.int64], Array]:
    """All measurements in order of time, those outside the odometry's time left out."""
    from schuler.kernels import planar as k

    z = np.zeros((len(rest_t), k.MZ))
    if len(rest_t):
        z[:, :2] = rest_z
    time = np.concatenate([m.time, rest_t])
    kind = np.concatenate([m.kind, np.full(len(rest_t), k.REST)]).astype(np.int64)
    rows = np.vstack([m.z, z]) if len(m.z) else z
    order = np.lexsort((kind, time))
    time, kind, rows = time[order], kind[order], rows[order]
    inside = (time >= t0) & (time <= last)
    outside = int((~inside).sum())
    if outside:
        notes.append(f"{outside} fixes and ranges before or after the odometry were left out")
    return time[inside], kind[inside], np.ascontiguousarray(rows[inside])


def _rows(
    tables: Tables, speed: motion.Stream, s: PlanarSettings, m: motion.Measurements, t0: float, last: float
) -> Array:
    """Times of the rows of the solution."""
    from schuler.kernels.planar import FIX

    rate = s.output_rate
    if rate is None and "imu" in tables:
        rate = 10.0
    if rate is not None and rate != inf:
        first = np.ceil(t0 * rate - 1e-9) / rate
        return np.asarray(np.arange(first, last + 1e-9, 1.0 / rate), dtype=np.float64)
    stamps = [speed.time, m.time[m.kind == FIX]]
    if rate == inf and "imu" in tables:
        stamps.append(tables["imu"].time)
    time = np.unique(np.concatenate(stamps))
    return time[(time >= t0) & (time <= last)]


def _initial(s: PlanarSettings, begin: Begin, beacons: int, has_fixes: bool) -> tuple[Array, Array]:
    from schuler.kernels import planar as k

    v = prior(s, beacons, has_fixes)
    v[k.NORTH], v[k.EAST], v[k.PSI] = begin.std_north**2, begin.std_east**2, begin.std_heading**2
    x = np.zeros(len(v))
    x[k.NORTH], x[k.EAST], x[k.PSI] = begin.north, begin.east, begin.heading
    return x, np.diag(v)


def _solution(plane: Plane, time: Array, ox: Array, oP: Array) -> Solution:
    from schuler.kernels.planar import EAST, NORTH, PSI, V

    n = len(time)
    lat, lon = plane.geodetic(ox[:, NORTH], ox[:, EAST])
    turned = plane.convergence(lat, lon)
    heading = ox[:, PSI] + turned
    v, co, si = ox[:, V], np.cos(heading), np.sin(heading)
    nothing = np.full(n, np.nan)
    v_n = np.column_stack([v * co, v * si, nothing])
    rpy = np.column_stack([nothing, nothing, heading])
    pos, vel, att = (np.full((n, 3, 3), np.nan) for _ in range(3))
    pos[:, :2, :2] = oP[:, :2, :2]
    J = np.zeros((n, 2, 2))  # of north and east velocity after speed and heading
    J[:, 0, 0], J[:, 0, 1], J[:, 1, 0], J[:, 1, 1] = co, -v * si, si, v * co
    two = oP[:, [V, V, PSI, PSI], [V, PSI, V, PSI]].reshape(n, 2, 2)
    vel[:, :2, :2] = J @ two @ J.transpose(0, 2, 1)
    att[:, 2, 2] = oP[:, PSI, PSI]
    return Solution(time.copy(), lat, lon, nothing.copy(), v_n, rpy, pos, vel, att)


def _innovations(mt: Array, mk: NDArray[np.int64], innov: Array, told: float) -> dict[str, Innovations]:
    """Of the measurements after the start: those before it have helped to find it."""
    found: dict[str, Innovations] = {}
    for kind, (name, components, unit) in enumerate(INNOVATIONS):
        rows = (mk == kind) & (mt > told)
        if rows.any():
            d = len(components)
            i = innov[rows]
            found[name] = Innovations(
                name, components, unit, mt[rows].copy(), i[:, :d].copy(), i[:, 2 : 2 + d].copy(), i[:, 4].copy(),
                i[:, 5] > 0.0, i[:, 5].copy(),
            )  # fmt: skip
    return found


def _histories(
    time: Array,
    x: Array,
    std: Array,
    smoothed: Array | None,
    smoothed_std: Array | None,
    beacons: list[str],
    slow: list[float],
    told: float,
) -> dict[str, StateHistory]:
    from schuler.kernels.planar import B0, EE, EN

    names = [*STATES, *((f"range_bias_{b}", "m", B0 + i) for i, b in enumerate(beacons))]
    keep = time >= told
    states: dict[str, StateHistory] = {}
    for name, unit, i in names:
        if std[:, i].max(initial=0.0) > 0.0:
            states[name] = _history(name, unit, time, x, std, smoothed, smoothed_std, i, keep)
    for name, i, sigma in (("gnss_bias_north", EN, slow[0]), ("gnss_bias_east", EE, slow[1])):
        if std[:, i].max(initial=0.0) > 0.0:
            h = _history(name, "m", time, x, std, smoothed, smoothed_std, i, keep)
            for f in ("value", "std", "smoothed", "smoothed_std"):
                if getattr(h, f) is not None:
                    setattr(h, f, getattr(h, f) * sigma)  # in units of a typical fix's own slow sigma until here
            states[name] = h
    return states


def _history(
    name: str,
    unit: str,
    time: Array,
    x: Array,
    std: Array,
    smoothed: Array | None,
    smoothed_std: Array | None,
    i: int,
    keep: NDArray[np.bool_],
) -> StateHistory:
    def told(value: Array, sigma: Array) -> tuple[Array, Array]:
        if name in LOGARITHMS:
            return np.expm1(value), sigma * np.exp(value)
        return value.copy(), sigma.copy()

    value, sigma = told(x[keep, i], std[keep, i])
    state = StateHistory(name, unit, time[keep].copy(), value, sigma)
    if smoothed is not None and smoothed_std is not None:
        state.smoothed, state.smoothed_std = told(smoothed[keep, i], smoothed_std[keep, i])
    return state


def _tell_rejections(nav: Navigation) -> None:
    for name, i in nav.innovations.items():
        left_out = int((~i.used).sum())
        if left_out:
            nav.notes.append(
                f"{name}: {left_out} of {len(i.time)} measurements contradicted the filter and were left out"
            )
