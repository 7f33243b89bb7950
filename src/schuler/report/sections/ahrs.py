"""Pages of kind "ahrs": the attitude error, the attitude, the magnetic field and when it was believed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.units import DEG
from schuler.report import figures
from schuler.report.figures import BOUND, FILTER, FIX, REJECTED, SMOOTHED, TRUTH, Panel
from schuler.report.parts import Figure, Grid, Opening, Section, Tile, number, seconds
from schuler.report.sections import consistency
from schuler.report.view import View

Array = NDArray[np.float64]
MODEST = 0.25  # NEES below which a sigma is twice the error or more
_BAND = "Bands: ± 3 sigma as the filter (or the smoother) states it."


def _sets(view: View) -> list[tuple[str, str, Any]]:
    """(name, colour, AttitudeErrors) of what was judged."""
    d = view.result.details
    pairs = (("filter", FILTER, d.filter), ("smoothed", SMOOTHED, d.smoother))
    return [(n, c, e) for n, c, e in pairs if e is not None]


def opening(view: View) -> Opening:
    s = view.summary
    parts = ["attitude from an IMU" + (" and a magnetometer" if s["magnetometer"] else ""), "recorded"]
    if s["heading"] == "relative":
        parts.append("heading counted from the start")
    lasted = seconds(s["duration_s"])
    e, end, c = s["attitude"], s["sigma_end_deg"], s["consistency"]
    tone = ""
    if e is None:
        verdict = (
            f"{lasted} without a reference to judge the attitude against; at the end the filter's own sigma is "
            f"{number(end['tilt'], 2)} deg of tilt and {number(end['heading'], 2)} deg of heading."
        )
        tiles = [
            Tile("Tilt, 1 sigma", number(end["tilt"], 2), "deg", "at the end"),
            Tile("Heading, 1 sigma", number(end["heading"], 2), "deg", "at the end"),
        ]
    else:
        inside = c["inside_3_sigma"]
        good = inside is None or inside > 0.95
        tone = "good" if good else "warn"
        verdict = (
            f"Over {lasted} the attitude is {number(e['total_deg']['rms'], 3)} deg (rms) from the reference, at worst "
            f"{number(e['total_deg']['max'], 3)} deg"
        )
        if inside is not None:
            verdict += f"; {number(100.0 * inside, 3)} % of the errors lie inside the filter's 3 sigma: "
            modest = (c["nees_attitude"] or 1.0) < MODEST
            verdict += "consistent" if good else "not consistent, the sigma is too small"
            verdict += ", and the sigma is larger than it need be." if good and modest else "."
        else:
            verdict += "."
        tiles = [
            Tile(
                "Total, rms", number(e["total_deg"]["rms"], 3), "deg", f"95 %: {number(e['total_deg']['p95'], 3)} deg"
            ),
            Tile("Tilt, rms", number(e["tilt_deg"]["rms"], 3), "deg"),
            Tile("Heading, rms", number(e["heading_deg"]["rms"], 3), "deg"),
        ]
        if s["attitude_smoother"] is not None:
            tiles.append(Tile("Smoothed, total rms", number(s["attitude_smoother"]["total_deg"]["rms"], 3), "deg"))
        if c["nees_attitude"] is not None:
            tiles.append(Tile("Attitude NEES", number(c["nees_attitude"], 2), "", "1 is ideal"))
    if s["magnetometer"]:
        share = 100.0 * s["magnetometer"]["distrusted_share"]
        tiles.append(Tile("Magnetometer distrusted", number(share, 2), "%", "of the time"))
    return Opening(view.name, " · ".join(parts), verdict, tone, tuple(tiles))


def errors(view: View) -> Section | None:
    """Tilt north and east and heading inside 3 sigma, the total angle, and the table."""
    sets = _sets(view)
    if not sets:
        return None
    panels = []
    for i, label in ((2, "turn about down, deg"), (0, "about north, deg"), (1, "about east, deg")):
        panel = Panel(label, zero=True)
        for order, (name, color, e) in enumerate(sets):
            std = np.sqrt(np.maximum(e.cov_phi[:, i, i], 0.0))
            panel.traces += figures.estimate(
                view.pool, view.axis, e.time, e.phi[:, i] / DEG, std / DEG, name, color, fmt=".2f", order=order
            )
        panels.append(panel)
    panel = Panel("total, deg", height=110)
    for name, color, e in sets:
        panel.traces.append(figures.line(view.pool, view.axis, e.time, e.total / DEG, name, color, ".2f"))
    panels.append(panel)
    caption = (
        "The rotation that is left between estimate and reference, in north, east, down axes: it keeps its meaning "
        "where the nose points up and roll and heading lose theirs. A positive turn about down is a heading that "
        "is too low. "
        f"{_BAND}"
    )
    figure = figures.stack("fig-errors", "Attitude error", panels, view.axis, caption)
    rows = []
    for key, word in (("tilt_deg", "tilt"), ("heading_deg", "heading"), ("total_deg", "total")):
        cells = [word]
        for summary in (view.summary["attitude"], view.summary["attitude_smoother"]):
            if summary is not None:
                cells += [number((summary[key] or {}).get(k)) for k in ("rms", "p95", "max", "end")]
        rows.append(cells)
    head = ["error, deg", *(w for _ in sets for w in ("rms", "95 %", "max", "end"))]
    groups = [("", 1), *((name, 4) for name, _, _ in sets)]
    grid = Grid(
        head, rows, "Angles of the rotation that is left, at every row that the reference covers.", groups=groups
    )
    return Section("errors", "Attitude error", figures=[figure] if figure else [], grids=[grid])


def attitude(view: View) -> Section | None:
    """Roll, pitch and heading, and their sigma in n."""
    run, reference = view.result.details.run, view.result.reference
    panels = []
    for i, name in ((2, "heading"), (0, "roll"), (1, "pitch")):
        panel = Panel(f"{name}, deg", height=130)
        if reference is not None and name in reference:
            value = reference[name] + (view.result.details.filter.offset if name == "heading" and _sets(view) else 0.0)
            panel.traces.append(
                figures.line(
                    view.pool, view.axis, reference.time, _broken(value, i), "reference", TRUTH, ".1f", width=2.0
                )
            )
        for who, color, a in (("filter", FILTER, run.filter), ("smoothed", SMOOTHED, run.smoother)):
            if a is not None:
                value = _broken(a.rpy[:, i], i)
                panel.traces.append(figures.line(view.pool, view.axis, a.time, value, who, color, ".1f"))
        panels.append(panel)
    sigma = Panel("1 sigma, deg", height=120)
    std = np.sqrt(np.maximum(np.einsum("nii->ni", run.filter.cov_phi), 0.0)) / DEG
    tilt = np.hypot(std[:, 0], std[:, 1])
    for value, word, color in ((std[:, 2], "heading, filter", FILTER), (tilt, "tilt, filter", FIX)):
        sigma.traces.append(figures.line(view.pool, view.axis, run.filter.time, value, word, color, ".2f"))
    panels.append(sigma)
    figure = figures.stack(
        "fig-attitude", "Attitude", panels, view.axis, "Roll and heading jump where the nose passes the vertical."
    )
    return Section("attitude", "Attitude", figures=[figure]) if figure else None


def _broken(angle: Array, i: int) -> Array:
    """Degrees with a gap where an angle passes its end: heading 0..360, roll and pitch -180..180."""
    deg = np.rad2deg(angle)
    deg = np.mod(deg, 360.0) if i == 2 else np.mod(deg + 180.0, 360.0) - 180.0
    with np.errstate(invalid="ignore"):
        jump = np.abs(np.diff(deg)) > 180.0
    deg[1:][jump] = np.nan
    return deg


def magnetometer(view: View) -> Section | None:
    """Size and dip of the field, what they say of its disturbance, and when it was distrusted."""
    from schuler.kernels import ahrs_state as k

    told = view.summary["magnetometer"]
    nodes = view.result.details.run.nodes
    seen = nodes[nodes[:, k.K_NORM] > 0.0]
    if told is None or not len(seen):
        return None
    t = seen[:, k.K_T]
    panels = []
    for column, label, scale in ((k.K_NORM, "size, uT", 1e6), (k.K_DIP, "dip, deg", 1.0 / DEG)):
        panel = Panel(label, height=110)
        panel.traces.append(figures.line(view.pool, view.axis, t, seen[:, column] * scale, "field", FIX, ".2f"))
        panels.append(panel)
    panel = Panel("heading by\ndisturbance, deg", height=130)
    bent = seen[:, k.K_BENT] / DEG
    believed = ~_inside(t, view.result.details.distrusted)
    panel.traces.append(
        figures.line(view.pool, view.axis, t, bent, "1 sigma of the heading by disturbance", BOUND, ".2f")
    )
    if not believed.all():
        panel.traces.append(
            figures.line(
                view.pool, view.axis, t, np.where(believed, np.nan, bent), "distrusted", REJECTED, ".2f", width=3.0
            )
        )
    panels.append(panel)
    caption = (
        "Size and dip of the field in level axes. Where they leave what was learnt, something bends the field, and the "
        "heading from it gets the sigma of the last panel. Tilt is never taken from the magnetometer."
    )
    figure = figures.stack("fig-field", "Magnetic field", panels, view.axis, caption)
    spans = told["distrusted"]
    if spans:
        lead = f"Distrusted {number(100.0 * told['distrusted_share'], 2)} % of the time, in {len(spans)} stretches."
    else:
        lead = "The field was believed throughout."
    rows = [
        [f"{s['start_s']:.1f}", f"{s['end_s']:.1f}", f"{s['end_s'] - s['start_s']:.1f}"]
        for s in sorted(spans, key=lambda s: s["start_s"] - s["end_s"])[:20]
    ]
    grids = [Grid(["from, s", "to, s", "seconds"], rows, "The longest of them.")] if rows else []
    return Section("field", "Magnetometer", lead, [figure] if figure else [], grids)


def _inside(time: Array, spans: list[tuple[float, float]]) -> NDArray[np.bool_]:
    found = np.zeros(len(time), dtype=bool)
    for a, b in spans:
        found |= (time >= a) & (time <= b)
    return found


def honesty(view: View) -> Section | None:
    """NEES of the attitude above the tables that all kinds share."""
    section = consistency.honesty(view)
    panel = Panel("attitude\nNEES", log=True, height=150, lines=((4.28, "99 %"), (0.0239, "")), span=(-3.0, 2.0))
    for name, color, e in _sets(view):
        step = max(len(e) // 20000, 1)
        value = e.nees[::step]
        if np.isfinite(value).any():
            trace = figures.line(view.pool, view.axis, e.time[::step], np.maximum(value, 1e-4), name, color, ".2f")
            panel.traces.append(trace)
    caption = (
        "Squared attitude error in units of the stated sigma, per degree of freedom: 1 is expected. Dashed: 99 % of an "
        "honest filter in one moment. Attitude errors last, so neighbouring values are not independent. NIS below: "
        "innovations last several updates too, and their sigma is that of one alone."
    )
    figure: Figure | None = figures.stack("fig-nees", "Attitude NEES", [panel], view.axis, caption)
    if figure is None:
        return section
    if section is None:
        return Section("consistency", "Is the filter honest?", figures=[figure])
    return Section(section.id, section.title, section.lead, [figure, *section.figures], section.grids)
