"""Chapters of kind "planar": the track with its beacons, and what is known of each beacon."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.report.parts import Grid, Section, metres, number, seconds
from schuler.report.sections.track import _map
from schuler.report.view import View

BEACON = "#7a3e9d"


def track(view: View) -> Section | None:
    if not np.isfinite(view.filter.ned[:, :2]).any():
        return None
    more: list[dict[str, Any]] = []
    points = []
    found = view.result.navigation.extras.get("beacons") or []
    if found:
        ned = view.ned(np.array([b["lat"] for b in found]), np.array([b["lon"] for b in found]))
        points.append(ned[:, :2])
        more.append(
            {
                "type": "scatter",
                "mode": "markers+text" if len(found) <= 40 else "markers",
                "x": view.pool.add(ned[:, 1], exact=True),
                "y": view.pool.add(ned[:, 0], exact=True),
                "text": [str(b["id"]) for b in found],
                "textposition": "top center",
                "name": "beacons",
                "marker": {"color": BEACON, "size": 9, "symbol": "triangle-up"},
                "hovertemplate": "beacon %{text}<br>east %{x:.1f} m, north %{y:.1f} m<extra></extra>",
            }
        )
    return Section("track", "Track", _lead(view), figures=[_map(view, more, points)])


def _lead(view: View) -> str:
    words = f"{seconds(view.span[1] - view.span[0])}, {metres(view.length)} over ground"
    if view.dives:
        words += f", {len(view.dives)} without fixes for more than a minute (shaded on every figure)"
    plane = view.result.navigation.extras.get("metres")
    if plane is not None:
        where = "Metres north and east as in the tables"
        if plane.north or plane.east:
            where += f", counted from north {plane.north:.0f}, east {plane.east:.0f}"
    else:
        lat, lon = np.rad2deg(view.origin[0]), np.rad2deg((view.origin[1] + np.pi) % (2.0 * np.pi) - np.pi)
        where = "Local metres north and east of "
        where += f"{abs(lat):.5f}° {'N' if lat >= 0 else 'S'}, {abs(lon):.5f}° {'E' if lon >= 0 else 'W'}"
    return f"{words}. {where}."


def beacons(view: View) -> Section | None:
    found = view.result.navigation.extras.get("beacons") or []
    if not found:
        return None
    rows = [
        [
            str(b["id"]),
            str(b["ranges"]),
            str(b["left_out"]),
            metres(b["rms_m"]),
            number(b["nis"], 3),
            f"{number(b['bias_m'], 2)} ± {number(b['std_m'], 2)} m",
        ]
        for b in found
    ]
    head = ["beacon", "ranges", "left out", "rms innovation", "mean NIS", "bias learnt"]
    caption = "Ranges after the start. A NIS far above that of the others: the beacon's place, or echoes."
    return Section("beacons", "Beacons", grids=[Grid(head, rows, caption)])
