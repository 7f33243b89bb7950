"""What the terminal says at the end of a run: about ten lines of figures, units and sigmas beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler.judging.consistency import chi2_bounds
from schuler.judging.result import Result

DIVES_TOLD = 12
_SHOWN = {  # state: what it is called, unit shown, factor from SI
    "gyro_bias_z": ("gyro bias z", "deg/h", 180.0 / np.pi * 3600.0),
    "current_north": ("current north", "m/s", 1.0),
    "current_east": ("current east", "m/s", 1.0),
    "speed_scale": ("speed log scale", "%", 100.0),
    "path_scale": ("scale of speed from depth", "%", 100.0),
    "heading_offset": ("heading offset", "deg", 180.0 / np.pi),
    "mounting_pitch": ("mounting pitch", "deg", 180.0 / np.pi),
    "mounting_yaw": ("mounting yaw", "deg", 180.0 / np.pi),
    "gnss_delay": ("delay of fixes", "s", 1.0),
    "gnss_velocity_delay": ("delay of GNSS velocity", "s", 1.0),
    "dvl_scale": ("DVL scale", "%", 100.0),
    "height_bias": ("barometer offset", "m", 1.0),
    "range_scale": ("range scale", "%", 100.0),
}


def figures(result: Result) -> list[str]:
    """Lines of text, without colour, for any kind that has a track. A kind with words of its own brings them."""
    s = result.summary
    if hasattr(result.details, "told"):
        return list(result.details.told(s["study"]["name"]))
    lines = [_head(result)]
    dives, surfacings = s.get("dives") or [], s.get("surfacings") or []
    judged = any(d.get("horizontal_end_m") is not None for d in dives)
    if judged:
        lines += _dives(dives)
    for outage in s.get("outages") or []:
        lines.append(_outage(outage))
    lines += [_swept(entry) for entry in s.get("sweep") or []]
    if surfacings:
        lines += _surfacings(surfacings)
    lines += _strapdown(s)
    lines += _whole(s)
    lines += _nis(s)
    lines += _learnt(s)
    return lines


def _head(result: Result) -> str:
    s = result.summary
    parts = [f"{name} {_rate(t.time)}" for name, t in result.tables.items() if "time" in t]
    km = s.get("distance_m", 0.0) / 1000.0
    seed = f", seed {result.made_by['seed']}" if result.made_by.get("seed") is not None else ""
    return (
        f"{s['study']['name']}: {_span(s.get('duration_s', 0.0))}, {km:.2f} km over ground; "
        f"{', '.join(parts)}; method {s.get('method', '')}{seed}"
    )


def _rate(time: Any) -> str:
    if len(time) < 2:
        return f"{len(time)} row"
    step = float(np.median(np.diff(time)))
    return f"{1.0 / step:.3g} Hz" if 0.0 < step <= 2.0 else f"{len(time)} rows"


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 7200 else f"{seconds / 3600.0:.1f} h"


def metres(value: float | None) -> str:
    """Three figures are enough for a metre."""
    if value is None:
        return "-"
    return f"{value:.2f} m" if value < 10 else f"{value:.1f} m" if value < 100 else f"{value:.0f} m"


def _nees(value: float | None) -> str:
    if value is None:
        return ""
    low, high = chi2_bounds(2, 1)
    return f"; NEES/2 {value:.2f} (99 %: {low:.3f} to {high:.1f})"


def _dives(dives: list[dict[str, Any]]) -> list[str]:
    lines = []
    for d in dives[:DIVES_TOLD]:
        percent = f" ({d['percent_of_distance']:.1f} % of {d['distance_m']:.0f} m)" if d["percent_of_distance"] else ""
        lines.append(
            f"without fixes {d['start_s']:.0f} to {d['end_s']:.0f} s: error at the end {metres(d['horizontal_end_m'])}"
            f"{percent}, sigma {metres(d['sigma_end_m'])}{_nees(d['nees_half_end'])}"
        )
        if d["heading_end_deg"] is not None and d["heading_sigma_deg"] is not None:
            lines.append(
                f"  heading then: error {d['heading_end_deg']:.1f} deg, sigma {d['heading_sigma_deg']:.1f} deg"
            )
        if d["smoother_rms_m"] is not None:
            lines.append(
                f"  smoothed afterwards: {metres(d['smoother_rms_m'])} rms along it, "
                f"{metres(d['smoother_max_m'])} at most"
            )
    if len(dives) > DIVES_TOLD:
        lines.append(f"  ... and {len(dives) - DIVES_TOLD} more in summary.json")
    return lines


def _outage(o: dict[str, Any]) -> str:
    smooth = o.get("smoother_horizontal_max_m")
    share = o.get("percent_of_distance")
    part = f" ({share:.1f} % of {o['distance_m']:.0f} m)" if share is not None else ""
    line = (
        f"{o['sensor']} withheld {o['start_s']:g} to {o['end_s']:g} s: error at the end "
        f"{metres(o['horizontal_end_m'])}{part}, at most {metres(o['horizontal_max_m'])}, "
        f"sigma {metres(o.get('sigma_end_m'))}{_nees(o['nees_half_end'])}"
    )
    return line + (f"; smoothed at most {metres(smooth)}" if smooth is not None else "")


def _swept(e: dict[str, Any]) -> str:
    end, smooth = e["filter_end_m"], e["smoother_max_m"]
    line = (
        f"{e['windows']} outage{'s' * (e['windows'] != 1)} of {e['length_s']:g} s: "
        f"error at the end {metres(end['p50'])} (median), "
        f"{metres(end['p95'])} for 95 %"
    )
    share = (e.get("filter_end_percent") or {}).get("p50")
    if share is not None:
        line += f" ({share:.1f} % of the distance)"
    if smooth["p50"] is not None:
        line += f"; smoothed at most {metres(smooth['p50'])} (median)"
    return line + (f"; NEES/2 {e['nees_half']:.2f}" if e["nees_half"] is not None else "")


def _surfacings(found: list[dict[str, Any]]) -> list[str]:
    inside = sum(s["inside_95"] for s in found)
    if len(found) == 1:
        s = found[0]
        verdict = "inside" if s["inside_95"] else "OUTSIDE"
        return [
            f"first fix after {s['gap_s']:.0f} s: predicted {metres(s['miss_m'])} from it, 1 sigma "
            f"{s['sigma_major_m']:.0f} x {s['sigma_minor_m']:.0f} m: {verdict} the 95 % ellipse"
        ]
    median = metres(float(np.median([s["miss_m"] for s in found])))
    lines = [
        f"{len(found)} surfacings, position predicted before the first fix against it "
        f"(median miss {median}, {inside} of {len(found)} inside 95 %):",
        "   at s      gap s    miss   north    east m   1 sigma m   inside 95 %",
    ]
    for s in found[:DIVES_TOLD]:
        lines.append(
            f"   {s['time_s']:<9.0f} {s['gap_s']:5.0f} {s['miss_m']:7.0f} {s['north_m']:7.0f} {s['east_m']:7.0f}"
            f"   {s['sigma_major_m']:5.0f} x {s['sigma_minor_m']:<5.0f} {'yes' if s['inside_95'] else 'NO'}"
        )
    if len(found) > DIVES_TOLD:
        lines.append(f"   ... and {len(found) - DIVES_TOLD} more in summary.json")
    return lines


def _whole(s: dict[str, Any]) -> list[str]:
    parts = []
    for who, name in (("filter", "filter"), ("smoother", "smoothed")):
        e = (s.get("errors") or {}).get(who)
        if e and e.get("horizontal_m"):
            h = e["horizontal_m"]
            heading = f", heading {e['heading_deg']['rms']:.1f} deg rms" if e.get("heading_deg") else ""
            parts.append(f"{name} {metres(h['rms'])} rms ({metres(h['p95'])} for 95 %){heading}")
    lines = [f"whole track: {'; '.join(parts)}"] if parts else []
    share = (s.get("consistency") or {}).get("inside_3_sigma")
    if share is not None:
        lines.append(f"inside their own 3 sigma: {100.0 * share:.1f} % of all errors")
    return lines


def _strapdown(s: dict[str, Any]) -> list[str]:
    """Free inertial error growth beside what explains it."""
    t = s.get("strapdown") or {}
    if t.get("end_north_m") is None:
        return []
    lines = [
        f"error at the end {t['end_north_m']:.4g} m north, {t['end_east_m']:.4g} m east, at most "
        f"{t['max_horizontal_m']:.4g} m; vertical channel {t['vertical']}"
    ]
    if t.get("linear_difference_share") is not None:
        lines.append(
            f"the linear model ends at {t['linear_end_north_m']:.4g} m north, {t['linear_end_east_m']:.4g} m east: "
            f"within {100.0 * t['linear_difference_share']:.2g} % of the largest error"
        )
    lines.append(f"the same run without sensor errors: {t['floor_horizontal_m']:.1e} m (numerical floor)")
    return lines


def _nis(s: dict[str, Any]) -> list[str]:
    table = (s.get("consistency") or {}).get("nis") or {}
    parts = [
        f"{kind} {row['mean']:.2f} ({row['low']:.2f} to {row['high']:.2f})"
        for kind, row in table.items()
        if row["mean"] is not None
    ]
    return [f"innovations squared over their variance, ideal 1 (99 %): {', '.join(parts)}"] if parts else []


def _learnt(s: dict[str, Any]) -> list[str]:
    parts = []
    for name, (label, unit, factor) in _SHOWN.items():
        state = (s.get("states") or {}).get(name)
        if state is None or state["std"] is None or state["std"] <= 0.0:
            continue
        if state["truth"] is None and state["value"] == 0.0:
            continue
        digits = 2 if unit != "deg/h" else 0
        true = f", true {state['truth'] * factor:.{digits}f}" if state["truth"] is not None else ""
        parts.append(f"{label} {state['value'] * factor:.{digits}f} +- {state['std'] * factor:.{digits}f} {unit}{true}")
    return [f"learnt: {'; '.join(parts)}"] if parts else []


def where(out: Path) -> list[str]:
    """Where the results lie."""
    return [f"page: {out / 'report.html'}   figures: {out / 'summary.json'}   track: {out / 'solution.csv'}"]
