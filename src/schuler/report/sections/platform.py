"""Chapters of a stable-platform study: path, errors by drift, what equals what, tilt and gimbals, alignment, maps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.inertial.platform import platform_angles
from schuler.judging.platform import FREE, OPEN, PI, PUBLISHED, SD, SIZE, DriftSet, PlatformDetails, equalities, size_of
from schuler.report import decimate, figures
from schuler.report.figures import FILTER, FIX, REJECTED, SMOOTHED, TRUTH, Panel, TimeAxis
from schuler.report.parts import Figure, Grid, Opening, Section, Tile, number
from schuler.report.view import View

Array = NDArray[np.float64]
DEG = math.pi / 180.0
COLOR = {PI: FILTER, FREE: SMOOTHED, SD: FIX, OPEN: "#7b5ea7", PUBLISHED: REJECTED}
_DASH = ("dash", "longdashdot", "dot", "dashdot")


def _details(view: View) -> PlatformDetails:
    details: PlatformDetails = view.result.details
    return details


def _axis(span: float) -> TimeAxis:
    size, unit = (1.0, "s") if span <= 1200.0 else (60.0, "min") if span <= 4 * 3600.0 else (3600.0, "h")
    return TimeAxis(0.0, size, f"time since the switch to navigation, {unit}", (0.0, span / size))


def _drifts(d: PlatformDetails) -> str:
    rates = [b / DEG * 3600.0 for b in d.case.drift]
    named = [f"{x:.3g} deg/h on channel {i + 1}" for i, x in enumerate(rates) if x != 0.0]
    return " and ".join(named) if named else "no constant drift"


# ---- head ----


def opening(view: View) -> Opening:
    d = _details(view)
    main, case = d.main, d.case
    compass = (-case.heading / DEG) % 360.0
    where = "at rest" if d.at_rest else f"at up to {case.speed():.0f} m/s"
    subtitle = (
        f"stable platform · {where}, latitude {case.lat / DEG:.4g} deg, platform heading {case.heading / DEG:.4g} deg "
        f"from north to west (compass {compass:.4g} deg) · form {d.form} · {case.duration / 3600.0:.3g} h"
    )
    ends = {a: float(r.error[-1]) for a, r in main.runs.items()}
    words = f"With {_drifts(d)} the end errors are " + ", ".join(f"{a} {size_of(e)}" for a, e in ends.items()) + "."
    tiles = [
        Tile(a, *_split(size_of(e)), note="not a physical model" if a == PUBLISHED else f"at {case.duration:g} s")
        for a, e in ends.items()
    ]
    if PI in main.runs and FREE in main.runs:
        apart, largest = main.apart(PI, FREE), main.largest(FREE)
        words += (
            f" Position-independent commands and free azimuth never lie more than {size_of(apart)} apart"
            + (f", {100.0 * apart / largest:.2g} % of the largest error" if largest > 1.0 else "")
            + ": the algorithm itself buys no accuracy."
        )
        tiles.append(Tile("The two platforms apart", *_split(size_of(apart)), note="at most"))
    return Opening(view.name, subtitle, words, "", tiles)


def _split(text: str) -> tuple[str, str]:
    value, _, unit = text.partition(" ")
    return value, unit


# ---- path ----


def path(view: View) -> Section | None:
    d = _details(view)
    shown = [f for f in (_journey(view, d), _hodograph(view, d)) if f is not None]
    lead = "Computed minus true position, with the study's own drifts."
    if len(shown) > 1:
        lead = "Where the algorithms put the vehicle with the study's own drifts, and computed minus true position."
    return Section("path", "Path", lead, figures=shown) if shown else None


def _journey(view: View, d: PlatformDetails) -> Figure | None:
    if d.at_rest:
        return None
    t = d.truth
    rows = decimate.keep([t.lat, t.lon], 600)
    data = [_xy(view, t.lon[rows] / DEG, t.lat[rows] / DEG, "truth", TRUTH, width=3.5)]
    for name, run in d.main.runs.items():
        lon = np.unwrap(run.lon)
        lon += 2.0 * np.pi * np.round((t.lon[0] - lon[0]) / (2.0 * np.pi))
        data.append(_xy(view, lon[rows] / DEG, run.lat[rows] / DEG, name, COLOR[name], width=1.3))
    layout = {
        "height": 400,
        "margin": {"l": 66, "r": 14, "t": 34, "b": 46},
        "hovermode": "closest",
        "xaxis": {"title": {"text": "longitude, deg east", "standoff": 8}, "zeroline": False},
        "yaxis": {"title": {"text": "latitude, deg", "standoff": 6}, "zeroline": False},
    }
    caption = "Latitude of minus the mass attraction. The errors are small beside the journey: see the other figures."
    return Figure("fig-journey", "Path", {"data": data, "layout": layout}, 400, caption, half=True)


def _hodograph(view: View, d: PlatformDetails) -> Figure | None:
    data = []
    reach = 1.0
    for name, run in d.main.runs.items():
        rows = decimate.keep([run.north, run.east], 600)
        data.append(_xy(view, run.east[rows], run.north[rows], name, COLOR[name], width=1.6))
        if name != OPEN or len(d.main.runs) == 1:
            reach = max(reach, float(np.abs(run.north).max()), float(np.abs(run.east).max()))
    box = (-1.1 * reach, 1.1 * reach, -1.1 * reach, 1.1 * reach)
    caption = "For the same drift platform and strapdown err to opposite sides: one obeys it, the other measures it."
    return figures.plan(
        "fig-hodograph", "Error of position", data, box, caption, width_px=470, half=not d.at_rest, height_px=(400, 400)
    )


def _xy(view: View, x: Array, y: Array, name: str, color: str, **style: Any) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": view.pool.add(x, exact=True),
        "y": view.pool.add(y, exact=True),
        "name": name,
        "line": {"color": color, **style},
        "hovertemplate": "%{x:.4~f}, %{y:.4~f}",
    }


# ---- errors ----


def errors(view: View) -> Section | None:
    d = _details(view)
    shown = [f for f in (_error_figure(view, d, found) for found in d.sets) if f is not None]
    grids = [_numbers(d, found) for found in d.sets]
    return Section(
        "errors",
        "Error of position",
        "Each channel's drift alone, then all together; every algorithm in one figure, theory dashed.",
        figures=shown,
        grids=grids,
    )


def _error_figure(view: View, d: PlatformDetails, found: DriftSet) -> Figure | None:
    axis = _axis(d.case.duration)
    flat, log = Panel("error, m", height=230), Panel("error, m", height=130, log=True)
    base = next((a for a in (FREE, PI) if a in found.runs), None)
    off = Panel("size off\n" + f"{base}, m", height=130, log=True)
    floor = 1e-9 if found.name == "none" else 1e-3
    tops = [float(r.error.max()) for a, r in found.runs.items() if a != OPEN]
    for name, run in found.runs.items():
        label = f"{name} (not physical)" if name == PUBLISHED and found.case.drift[2] else name
        flat.traces.append(figures.line(view.pool, axis, run.time, run.error, label, COLOR[name], ".4~g"))
        log.traces.append(_log_line(view, axis, run.time, run.error, label, COLOR[name], floor))
        if base is not None and name != base:
            gap = np.abs(run.error - found.runs[base].error)
            off.traces.append(_log_line(view, axis, run.time, gap, label, COLOR[name], floor))
    for i, curve in enumerate(found.curves):
        style = {"dash": _DASH[i % len(_DASH)]}
        flat.traces.append(figures.line(view.pool, axis, curve.time, curve.error, curve.label, TRUTH, ".4~g", **style))
        log.traces.append(_log_line(view, axis, curve.time, curve.error, curve.label, TRUTH, floor, **style))
        if base is not None:
            gap = np.abs(curve.error - found.runs[base].error)
            off.traces.append(_log_line(view, axis, curve.time, gap, curve.label, TRUTH, floor, **style))
    caption = "Great-circle distance from computed to true position."
    if found.name == "none":
        panels = [log]
    else:
        panels = [flat, log, off]
        if tops and OPEN in found.runs and found.largest(OPEN) > 1.5 * max(tops):
            flat.span = (0.0, 1.08 * max(tops))
            caption += " Strapdown without gravity feedback leaves the upper panel; the second one holds it."
        if off.traces:
            caption += f" Lowest: by how much each size differs from {base}, for curves that lie on one another above."
    figure = figures.stack(f"fig-error-{found.name}", found.title, panels, axis, caption)
    if figure is not None:
        _decades(figure, floor, max(found.largest(a) for a in found.runs))
    return figure


def _decades(figure: Figure, floor: float, top: float) -> None:
    """Powers of ten at most six to a panel on its logarithmic axes, also far below a millimetre."""
    low, high = round(math.log10(floor)), max(math.ceil(math.log10(max(top, floor))), round(math.log10(floor)) + 1)
    powers = range(low, high + 1, math.ceil((high - low) / 6))
    words = [f"{10.0**k:g}" if -4 < k < 6 else f"10<sup>{k}</sup>" for k in powers]
    for axis in figure.spec["layout"].values():
        if isinstance(axis, dict) and axis.get("type") == "log":
            axis |= {"tickvals": [10.0**k for k in powers], "ticktext": words}


def _log_line(
    view: View, axis: TimeAxis, time: Array, value: Array, name: str, color: str, floor: float, **style: Any
) -> dict[str, Any]:
    """A line for a logarithmic panel: every digit of small values kept, nothing below floor, m."""
    rows = decimate.keep([value])
    shown = np.where(value[rows] > floor, value[rows], np.nan)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": view.pool.add(axis.of(time[rows])),
        "y": view.pool.add(shown, exact=True),
        "name": name,
        "line": {"color": color, "width": 1.4, **style},
        "hovertemplate": "%{y:.4~g}",
    }


def _metres(value: float) -> str:
    """Millimetres where there are any, else the power of ten."""
    if abs(value) >= 0.0005 or value == 0.0:
        return f"{value:.3f}"
    return f"{value:.0e}" if abs(value) > 1e-12 else "0"


def _numbers(d: PlatformDetails, found: DriftSet) -> Grid:
    rows = []
    for name, run in found.runs.items():
        e = run.at(d.at)
        rows.append([name, *(_metres(x) for x in e[:, 0]), _metres(e[-1, 1]), _metres(e[-1, 2])])
    for curve in found.curves:
        rows.append(
            [
                curve.label,
                *(_metres(float(x)) for x in np.interp(d.at, curve.time, curve.error)),
                *(
                    [""] * 2
                    if curve.kind == SIZE
                    else [_metres(float(np.interp(d.at[-1], curve.time, x))) for x in (curve.north, curve.east)]
                ),
            ]
        )
    head = [found.title, *(f"{t:g} s" for t in d.at), "north, last", "east, last"]
    return Grid(head, rows, "Metres; estimate minus truth.")


def said(view: View) -> Section | None:
    d = _details(view)
    sentences = [s[0].upper() + s[1:] for s in equalities(d)]
    crossing = [
        f"{found.title}: free azimuth overtakes the published model at {t:.0f} s."
        for found in d.sets
        if PUBLISHED in found.runs and FREE in found.runs and found.name != "none"
        if (t := found.crossover(FREE, PUBLISHED)) is not None and found.case.drift[2] != 0.0
    ]
    return Section("equal", "What equals what, and why", sentences=[*sentences, *crossing]) if sentences else None


# ---- platform and gimbals ----


def motion(view: View) -> Section | None:
    d = _details(view)
    axis = _axis(d.case.duration)
    names = ("phi_x, mrad", "phi_y, mrad", "heading error, deg")
    panels = [Panel(n, zero=True, height=120) for n in names]
    for name, run in d.main.runs.items():
        if not run.has_platform:
            continue
        angles = run.angles
        for k in range(2):
            panels[k].traces.append(
                figures.line(view.pool, axis, run.time, 1e3 * angles[:, k], name, COLOR[name], ".4~g")
            )
        believed = platform_angles(_against(d, run.q_iS_believed))
        turned = np.unwrap(believed[:, 2] - angles[:, 2])
        turned -= 2.0 * np.pi * np.round(turned[0] / (2.0 * np.pi))
        panels[2].traces.append(figures.line(view.pool, axis, run.time, turned / DEG, name, COLOR[name], ".4~g"))
    shown = [
        figures.stack(
            "fig-tilt",
            "Tilt of the platform",
            panels,
            axis,
            "Angles of the real platform against minus the mass attraction, and the believed heading minus the real "
            "one. The position-independent platform swings about the mass attraction at Schuler's period because "
            "alignment left it on the plumb line; free azimuth begins level to the mass attraction. What turns the "
            "heading is the drift of channel 3.",
        )
    ]
    if np.isfinite(d.gimbals).any():
        gimbal = [Panel(f"{n},\ndeg", height=110) for n in ("outer (roll)", "middle (pitch)", "inner (azimuth)")]
        for k, panel in enumerate(gimbal):
            value = np.unwrap(d.gimbals[:, k]) / DEG
            panel.traces.append(figures.line(view.pool, axis, d.truth.time, value, "gimbal", FILTER, ".4~g"))
        shown.append(
            figures.stack(
                "fig-gimbals",
                "Gimbal angles",
                gimbal,
                axis,
                "C_bS = C1(outer) C2(middle) C3(inner). The inner gimbal takes up the wander of the platform, which "
                "is not turned about its vertical: the Earth's rate w_e sin(lat) at rest, and the transport rate in "
                "flight.",
            )
        )
    found = [f for f in shown if f is not None]
    return Section("platform", "Platform and gimbals", figures=found) if found else None


def _against(d: PlatformDetails, q_iS: Array) -> Array:
    from schuler.ground.frames import quat_conjugate, quat_multiply

    return quat_multiply(quat_conjugate(d.truth.q_imN), q_iS)


# ---- alignment ----


def alignment(view: View) -> Section | None:
    a = _details(view).alignment
    run = a.run
    last = int(np.searchsorted(run.time, min(run.time[-1], 400.0)))
    part = slice(0, max(last, 2))
    t = run.time[part]
    axis = TimeAxis(0.0, 1.0, "time since the loops close, s", (0.0, float(t[-1])))
    tilt = Panel("tilt off its\nend value, mrad", zero=True)
    for name, value, end, color in (
        ("phi_x", run.phi_x, a.end.phi_x, FILTER),
        ("phi_y", run.phi_y, a.end.phi_y, SMOOTHED),
    ):
        tilt.traces.append(figures.line(view.pool, axis, t, 1e3 * (value[part] - end), name, color, ".3~g"))
    azimuth = Panel("gimbal angle,\nmrad", zero=True)
    azimuth.traces.append(figures.line(view.pool, axis, t, 1e3 * run.gimbal[part], "gimbal, measured", FIX, ".3~g"))
    command = Panel("commands,\ndeg/h", zero=True)
    for k, (name, color) in enumerate((("p", FILTER), ("q", SMOOTHED), ("r", FIX))):
        value = run.commands[part, k] / DEG * 3600.0
        limit = np.where(np.abs(value) < 60.0, value, np.nan)
        command.traces.append(figures.line(view.pool, axis, t, limit, name, color, ".3~g"))
    figure = figures.stack(
        "fig-alignment",
        "Alignment",
        [tilt, azimuth, command],
        axis,
        "From tilts of 0.5 deg and 2 deg in azimuth to the end values; commands beyond 60 deg/h are cut. They end on "
        "the Earth's rate, with the opposite of a drift that is there already.",
    )
    return Section(
        "alignment",
        "Alignment and the switch to navigation",
        "Channels 1 and 2: p = −(k_P f2 + ∫ k_I f2), q = +(k_P f1 + ∫ k_I f1). Channel 3: the same law on the "
        f"azimuth gimbal. Before the switch k_I k_G k_F is {a.gain_ratio:.0f} times what navigation needs (1/z); it "
        "stands before the integrator, so that p and q do not jump.",
        figures=[f for f in (figure,) if f is not None],
        grids=[_loops(view), *_requirements(view), _ends(view), _switch(view)],
    )


def _loops(view: View) -> Grid:
    a = _details(view).alignment
    rows = []
    for loop in (a.levelling, a.azimuth):
        r = loop.response()
        poles = ", ".join(f"{p.real:.4g}{p.imag:+.4g}j" if abs(p.imag) > 1e-12 else f"{p.real:.4g}" for p in loop.poles)
        rows.append(
            [
                loop.name,
                f"{loop.kp:.6e}",
                f"{loop.ki:.6e}",
                poles.replace("-", "−"),
                f"{r.overshoot_percent:.3g} %",
                f"{r.settling_s:.4g} s",
                f"{r.phase_margin_deg:.3g} deg",
                "no limit" if math.isinf(r.gain_margin_db) else f"{r.gain_margin_db:.3g} dB",
            ]
        )
    head = ["loop", "k_P", "k_I", "poles, 1/s", "overshoot", "settles into 5 %", "phase margin", "gain margin"]
    return Grid(head, rows, "Step response of what the loop follows; k_F = k_G = k_r = k_psi = 1.")


def _requirements(view: View) -> list[Grid]:
    rows, tones = [], []
    for loop, v in _details(view).alignment.verdicts:
        reached = "no limit" if math.isinf(v.reached) else f"{0.0 if abs(v.reached) < 1e-9 else v.reached:.4g} {v.unit}"
        by = "" if math.isinf(v.in_hand) else f" by {abs(v.in_hand):.4g} {v.unit}"
        rows.append([loop.name, v.what, f"{v.required:g} {v.unit}", reached, ("met" if v.met else "missed") + by])
        tones.append("" if v.met else "warn")
    head = ["loop", "requirement", "asked", "reached", "verdict"]
    return [Grid(head, rows, "What the study asks of the loops.", left=2, tones=tones)] if rows else []


def _ends(view: View) -> Grid:
    a = _details(view).alignment
    rows = [
        ["phi_x, rad", _power(a.end.phi_x), _power(a.first_order.phi_x)],
        ["phi_y, rad", _power(a.end.phi_y), _power(a.first_order.phi_y)],
        ["psi, rad", f"{a.end.psi:.10f}", f"{a.first_order.psi:.10f}"],
    ]
    rows += [
        [f"{n}, rad/s", _power(x), _power(y)] for n, x, y in zip("pqr", a.end.rates, a.first_order.rates, strict=True)
    ]
    rows.append(["d_r, rad/s", f"{a.end.d_r:.10e}", f"{a.first_order.d_r:.10e}"])
    return Grid(
        ["end of alignment", "exact", "(20)-(24), corrected"], rows, "Angles against minus the mass attraction."
    )


def _power(value: float) -> str:
    return "0" if abs(value) < 1e-15 else f"{value:.10e}"


def _switch(view: View) -> Grid:
    rows, tones = [], []
    for j in _details(view).alignment.jumps:
        rows.append([j.name, j.unit, _power(j.before), _power(j.after), "jumps" if j.jumps else "does not jump"])
        tones.append("warn" if j.jumps and not j.may_jump else "")
    head = ["signal", "unit", "before the switch", "after it", ""]
    caption = "Table 1, corrected: what jumps when alignment gives way to navigation, and what must not."
    return Grid(head, rows, caption, left=2, tones=tones)


# ---- maps and sensitivity ----


def maps(view: View) -> Section | None:
    d = _details(view)
    if not d.maps:
        return None
    shown, rows = [], []
    largest = max(float(m.error.max()) for m in d.maps if m.algorithm != OPEN or len(d.maps) == 1) / 1000.0
    for m in d.maps:
        z = m.error / 1000.0
        data = [
            {
                "type": "heatmap",
                "x": [round(float(x), 4) for x in m.heading / DEG],
                "y": [round(float(x), 4) for x in m.lat / DEG],
                "z": [[float(f"{x:.4g}") for x in row] for row in z],
                "colorscale": "Viridis",
                "zmin": 0.0,
                "zmax": float(f"{z.max() if m.algorithm == OPEN else largest:.4g}"),
                "colorbar": {"title": {"text": "km"}, "thickness": 12},
                "name": m.algorithm,
                "hovertemplate": "heading %{x}, latitude %{y}: %{z} km<extra></extra>",
            }
        ]
        layout = {
            "height": 340,
            "margin": {"l": 66, "r": 14, "t": 34, "b": 46},
            "xaxis": {
                "title": {"text": "platform heading, deg from north to west", "standoff": 8},
                **_ticks(m.heading),
            },
            "yaxis": {"title": {"text": "start latitude, deg", "standoff": 6}, **_ticks(m.lat)},
        }
        spec = {"data": data, "layout": layout}
        title = f"{m.algorithm}, error at {m.at:g} s"
        shown.append(Figure(f"fig-map-{m.algorithm}", title, spec, 340, half=True))
        rows.append(
            [
                m.algorithm,
                size_of(float(m.error.min())),
                size_of(float(np.median(m.error))),
                size_of(float(m.error.max())),
            ]
        )
    caption = f"{d.maps[0].error.size} cases each, at rest or on this study's motion; one scale of colours"
    caption += ", strapdown-open-loop its own." if OPEN in {m.algorithm for m in d.maps} else "."
    grid = Grid(["algorithm", "smallest", "median", "largest"], rows, caption)
    return Section("map", "Over latitude and heading", figures=shown, grids=[grid])


def _ticks(angle: Array) -> dict[str, Any]:
    """Ticks at 30 or 45 deg where a map is wide enough for them."""
    span = float(np.ptp(angle)) / DEG
    return {"dtick": 45.0 if span > 200.0 else 30.0, "tick0": 0.0} if span > 90.0 else {}


def sensitivity(view: View) -> Section | None:
    d = _details(view)
    names = list(d.sensitivity)
    if not names:
        return None
    rows = []
    for i, (error, unit, _) in enumerate(d.sensitivity[names[0]]):
        cells = [number(float(x), 3) if x > 1e-5 else "0" for n in names for x in d.sensitivity[n][i][2]]
        rows.append([error, unit, *cells])
    head = ["error", "per", *(f"{n}, {t:g} s" for n in names for t in d.sensitivity_at)]
    return Section(
        "sensitivity",
        "Metres per unit of each error",
        "Derivatives about the perfect platform on this study's path, by central differences of the simulation.",
        grids=[Grid(head, rows, "Metres.", left=2)],
    )


def cite(view: View) -> Section | None:
    sentences = [
        "Position-independent commands: M. Ghesmati, J. Heirani Nobari, M. Arvan, A. Kashaninia, Gyroscope drift "
        "error analysis in the position-independent navigation algorithm of a stable platform inertial system, 2018. "
        "Equations as corrected in the theory page on platforms.",
        "Free azimuth and the table of errors: G. R. Pitman, Inertial Guidance, Wiley, 1962.",
    ]
    return Section("cite", "Sources", sentences=sentences)
