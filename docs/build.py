"""Builds the pages whose numbers are computed: docs/templates/NAME.md with its figures filled in becomes docs/NAME.md.

    python docs/build.py            writes every page
    python docs/build.py --check    status 1 where a page on disk is not what would be written

A page adds itself by a template and a function of figures in `PAGES`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

DOCS = Path(__file__).resolve().parent
DEG = math.pi / 180.0
DEG_H = DEG / 3600.0
AT = (600.0, 1800.0, 3600.0, 5400.0, 7200.0)


def _cells(values: object, digits: int = 1) -> str:
    return " | ".join(f"{float(v):.{digits}f}" for v in np.ravel(np.asarray(values)))


def _small(value: float) -> str:
    """'3e-6' for what is too small to print as metres."""
    if value >= 0.05:
        return f"{value:.1f}"
    exponent = math.floor(math.log10(value))
    return f"below 1e{exponent + 1}"


def _order(value: float) -> str:
    return f"{value:.0e}".replace("e-0", "e-")


def platform_figures() -> dict[str, str]:
    """Every number of the tutorial on platforms."""
    from schuler.inertial import platform as inertial
    from schuler.inertial import platform_alignment as alignment
    from schuler.inertial import platform_errors as theory
    from schuler.inertial.platform import OMEGA, RADIUS, SCHULER, PlatformCase

    lat, b1, b3 = 35.7 * DEG, 0.01 * DEG_H, 0.1 * DEG_H
    rest = PlatformCase(lat=lat, lon=51.4 * DEG, heading=math.pi)
    time = inertial.nodes(rest, at=AT)
    t = np.array(AT)

    def ends(case: PlatformCase, algorithm: str, form: str = "exact") -> np.ndarray:
        return inertial.navigate(case, algorithm, form, time=time).at(t)[:, 0]

    level, across = replace(rest, drift=(b1, 0.0, 0.0)), replace(rest, drift=(0.0, b1, 0.0))
    azimuth = replace(rest, drift=(0.0, 0.0, b3))
    f32 = theory.level_drift(t, b1, lat)
    tilt_time = np.linspace(0.0, 7200.0, 721)
    found: dict[str, str] = {
        "schuler_min": f"{2.0 * math.pi / SCHULER / 60.0:.1f}",
        "f32": _cells(f32),
        "ch1_pi": _cells(ends(level, "position-independent")),
        "ch1_free": _cells(ends(level, "free-azimuth")),
        "ch1_sd": _cells(ends(level, "strapdown")),
        "ch1_open": _cells(ends(level, "strapdown-open-loop")),
        "cubic": f"{theory.strapdown_open_drift(7200.0, b1) / 1000.0:.1f} km",
        "f32_ch1": f"{100.0 * (f32[-1] / ends(level, 'free-azimuth')[-1] - 1.0):.1f} %",
        "f32_ch2": f"{100.0 * (f32[-1] / ends(across, 'free-azimuth')[-1] - 1.0):.1f} %",
        "turn_deg": f"{b3 * 7200.0 / DEG:.1f}",
        "speed": f"{RADIUS * OMEGA * math.cos(lat):.0f}",
        "heading": _cells(np.hypot(*theory.azimuth_heading(t, b3, lat))),
        "tilt": _cells(np.hypot(*theory.azimuth_tilt(t, b3, lat, math.pi))),
        "tilt_max": f"{np.hypot(*theory.azimuth_tilt(tilt_time, b3, lat, math.pi)).max():.0f}",
        "total": _cells(np.hypot(*theory.azimuth_total(t, b3, lat, math.pi))),
        "ch3_pi": _cells(ends(azimuth, "position-independent")),
        "ch3_free": _cells(ends(azimuth, "free-azimuth")),
        "ch3_sd": _cells(ends(azimuth, "strapdown")),
        "ch3_pub": _cells(ends(azimuth, "as-published")),
        "alpha_mrad": f"{1e3 * theory.deflection(lat, exact=True):.2f}",
        "alpha_km": f"{RADIUS * theory.deflection(lat, exact=True) / 1000.0:.1f}",
        "resonance": f"{RADIUS * theory.deflection(lat) * b3 * (7200.0 + 1.0 / SCHULER) / 2.0:.1f}",
    }
    found |= _two_platforms(rest, b3, found)
    found |= _forms(rest)
    found |= _ellipsoid()
    loop = alignment.levelling_loop(0.03, 0.8)
    response = loop.response()
    turned = replace(rest, heading=40.0 * DEG, drift=(b1, -2.0 * b1, b3), drift_carried=True)
    found |= {
        "kp": f"{loop.kp:.6e}",
        "ki": f"{loop.ki:.6e}",
        "overshoot": f"{response.overshoot_percent:.0f}",
        "settling": f"{response.settling_s:.0f}",
        "margin": f"{response.phase_margin_deg:.0f}",
        "ratio": f"{alignment.integral_gain_ratio(loop):.0f}",
        "jump": f"{alignment.jump_of_a_gain_after_the_integrator(turned, loop):.1e}",
        "steps": f"{ends(level, 'position-independent')[-1]:.1f}",
        "carried": f"{ends(replace(level, drift_carried=True), 'position-independent')[-1]:.1f}",
    }
    known = replace(level, drift_carried=True, known_rates=True)
    found["known"] = _small(float(inertial.navigate(known).error.max()))
    rows = inertial.sensitivity(rest, "position-independent")
    found["sensitivity_rows"] = "\n".join(f"| {name} | {unit} | {m[0]:.1f} | {m[1]:.1f} |" for name, unit, m in rows)
    by_name = {name: m for name, _, m in rows}
    share = by_name["gyro drift, axis 3 (azimuth)"] / by_name["gyro drift, axis 1"]
    flight = replace(rest, lat_change=-65.0 * DEG, lon_change=55.0 * DEG)
    moving = {name: m for name, _, m in inertial.sensitivity(flight, "position-independent")}
    shares = (*share, moving["gyro drift, axis 3 (azimuth)"][1] / moving["gyro drift, axis 1"][1])
    names = ("azimuth_share", "azimuth_share_2", "azimuth_share_flight")
    found |= {name: f"{100.0 * x:.0f} %" for name, x in zip(names, shares, strict=True)}
    return found


SCENARIOS = {
    "rest": (0.0, 0.0),
    "75 deg south": (-75.0, 0.0),
    "75 deg east": (0.0, 75.0),
    "65 deg south, 55 deg east": (-65.0, 55.0),
}


def _two_platforms(rest, b3: float, found: dict[str, str]) -> dict[str, str]:
    from schuler.inertial import platform as inertial
    from schuler.inertial import platform_errors as theory

    rows, at_rest = [], 0.0
    for name, (dlat, dlon) in SCENARIOS.items():
        case = replace(rest, lat_change=dlat * DEG, lon_change=dlon * DEG, drift=(0.0, 0.0, b3))
        a, b = inertial.navigate(case), inertial.navigate(case, "free-azimuth")
        apart = float(np.hypot(a.north - b.north, a.east - b.east).max())
        at_rest = at_rest or apart
        rows.append(f"| {name} | {b.error[-1]:.0f} m | {apart:.1f} m | {100.0 * apart / b.error.max():.2f} % |")
    small = replace(rest, drift=(0.0, 0.0, 0.01 * b3))
    clean = small.without_errors()
    misses = []
    for algorithm, tilted in (("free-azimuth", False), ("position-independent", True)):
        run, none = inertial.navigate(small, algorithm), inertial.navigate(clean, algorithm)
        size = np.hypot(run.north - none.north, run.east - none.east)[-1]
        misses.append(abs(float(size / theory.first_order(small, tilted=tilted).error[-1]) - 1.0))
    return {
        "apart_rows": "\n".join(rows),
        "found_apart": f"{at_rest:.1f}",
        "fo_free": f"better than {_order(10.0 ** math.ceil(math.log10(misses[0])))}",
        "fo_pi": f"better than {_order(10.0 ** math.ceil(math.log10(misses[1])))}",
    }


def _forms(rest) -> dict[str, str]:
    from schuler.inertial import platform as inertial

    found = {}
    for form in ("exact", "corrected", "literal"):
        cells = []
        for dlat, dlon in SCENARIOS.values():
            case = replace(rest, lat_change=dlat * DEG, lon_change=dlon * DEG)
            cells.append(_small(float(inertial.navigate(case, form=form).error.max())))
        found[f"none_{form}"] = " | ".join(cells)
    return found


def _ellipsoid() -> dict[str, str]:
    from schuler.inertial import platform as inertial

    rows = []
    for lat_deg in (0.0, 15.0, 30.0, 45.0, 60.0, 75.0):
        case = inertial.PlatformCase(lat=lat_deg * DEG, heading=math.pi, earth="ellipsoid", duration=14400.0)
        cells = []
        for algorithm in ("free-azimuth", "position-independent"):
            run = inertial.navigate(case, algorithm)
            cells += [float(run.error[run.time <= 7200.0].max()), float(run.error.max())]
        rows.append(f"| {lat_deg:.0f} deg | {_cells(cells)} |")
    return {"ellipsoid_rows": "\n".join(rows)}


PAGES: dict[str, Callable[[], dict[str, str]]] = {"tutorial-platform.md": platform_figures}


def built(name: str) -> str:
    """The text of a page with its figures of now. KeyError where the template asks for one that is not computed."""
    template = (DOCS / "templates" / name).read_text(encoding="utf-8")
    return template.format_map(PAGES[name]())


def main(arguments: list[str]) -> int:
    stale = 0
    for name in PAGES:
        text, page = built(name), DOCS / name
        if arguments == ["--check"]:
            if not page.exists() or page.read_text(encoding="utf-8") != text:
                print(f"{page} is not current; type: python docs/build.py", file=sys.stderr)
                stale = 1
        else:
            page.write_text(text, encoding="utf-8", newline="\n")
            print(page)
    return stale


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
