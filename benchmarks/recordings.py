"""The example studies on the real recordings, and the figures that are claimed for them."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from schuler.studies.run import StudyResult

ROOT = Path(__file__).resolve().parents[1]


@dataclass
class Figure:
    """A measured figure beside what is wanted."""

    what: str
    value: float
    unit: str
    wanted: str
    holds: bool
    note: str = ""


def prepare_example(example: str, data: Path, out: Path, *more: str) -> None:
    """examples/NAME: prepare.py on the recording in `data`, into `out`."""
    arguments = sys.argv
    sys.argv = ["prepare.py", str(data), str(out), *more]
    try:
        with redirect_stdout(StringIO()):
            runpy.run_path(str(ROOT / "examples" / example / "prepare.py"), run_name="__main__")
    except SystemExit as done:
        if done.code:
            raise RuntimeError(f"examples/{example}/prepare.py ended with status {done.code}") from done
    finally:
        sys.argv = arguments


def run_example(example: str, data: Path, out: Path) -> StudyResult:
    """examples/NAME: prepare.py on the recording in `data`, then the study that lies in `out`."""
    from schuler.studies.model import load_study
    from schuler.studies.run import run_study

    prepare_example(example, data, out)
    return run_study(load_study(out / "study.toml"))


BROAD = "ahrs_broad"


def run_broad(data: Path, out: Path) -> dict[tuple[str, int], StudyResult]:
    """examples/ahrs-broad on every trial in `data`: (trial, axes) -> its study, nine axes and six."""
    from schuler.studies.model import load_study
    from schuler.studies.run import run_study

    prepare_example("ahrs-broad", data, out)
    trials = sorted(p.parent for p in out.glob("*/study.toml"))
    files = ((9, "study.toml"), (6, "study-6.toml"))
    return {(t.name, axes): run_study(load_study(t / file)) for t in trials for axes, file in files}


def broad_figures(results: dict[tuple[str, int], StudyResult]) -> list[Figure]:
    """Mean over the trials of the rms over the scored rows, one set of settings: the defaults."""
    rows = []
    limits = {9: {"tilt": 1.2, "heading": 3.2, "total": 3.5}, 6: {"tilt": 1.2, "heading": 4.4, "total": 4.5}}
    for axes, wanted in limits.items():
        for name, limit in wanted.items():
            each = [r.summary["attitude"][f"{name}_deg"]["rms"] for (_, n), r in results.items() if n == axes]
            value = float(np.mean(each))
            what = f"{axes} axes: {name}, rms, mean of {len(each)} trials"
            note = "each: " + ", ".join(f"{v:.2f}" for v in each)
            rows.append(Figure(what, value, "deg", f"at most {limit:g}", value <= limit, note))
    return rows


def seaglider(summary: dict[str, Any]) -> list[Figure]:
    """Dives 101-104, one step ahead (100 has no history)."""
    found = summary["surfacings"][1:]
    miss = np.array([s["miss_m"] for s in found])
    axis = np.array([hypot(s["sigma_major_m"], s["sigma_minor_m"]) / 2**0.5 for s in found])
    inside = sum(s["inside_95"] and s["sigma_major_m"] < 300.0 for s in found)
    each = ", ".join(
        f"{m:.0f} ({s['sigma_major_m']:.0f} x {s['sigma_minor_m']:.0f})" for m, s in zip(miss, found, strict=True)
    )
    return [
        Figure("surfacings judged", len(found), "", "4", len(found) == 4),
        Figure(
            "mean miss of the predicted surfacing, dives 101-104", float(miss.mean()), "m", "at most 220",
            bool(miss.mean() <= 220.0), f"each (sigmas): {each}; plain dead reckoning 633",
        ),
        Figure(
            "of these inside the 95 % ellipse, its major sigma under 300 m", inside, "of 4", "at least 3", inside >= 3,
            f"mean axis sigma {axis.mean():.0f} m",
        ),
    ]  # fmt: skip


def seaexplorer(summary: dict[str, Any]) -> list[Figure]:
    """Every surfacing after a dive."""
    found = summary["surfacings"]
    miss = np.array([s["miss_m"] for s in found])
    inside = 100.0 * float(np.mean([s["inside_95"] for s in found]))
    median = float(np.median(miss))
    return [
        Figure("surfacings judged", len(found), "", "more than 40", len(found) > 40),
        Figure(
            "median miss of the predicted surfacing", median, "m", "at most 380", median <= 380.0,
            f"mean {miss.mean():.0f}; plain dead reckoning 412 and 567",
        ),
        Figure("of these inside the 95 % ellipse", inside, "%", "at least 90", inside >= 90.0),
    ]  # fmt: skip


def comma2k19(summary: dict[str, Any]) -> list[Figure]:
    """Outages of 15 and 30 s with wheel speed."""
    rows = []
    for length, limit in ((15.0, 3.0), (30.0, 5.0)):
        found = next(s for s in summary["sweep"] if s["length_s"] == length)
        value = found["filter_end_m"]["p50"]
        note = f"{found['windows']} windows, 95 % {found['filter_end_m']['p95']:.2f}, NEES/2 {found['nees_half']:.2f}"
        what = f"median error at the end of {length:g} s without GNSS"
        rows.append(Figure(what, value, "m", f"at most {limit:g}", value <= limit, note))
    return rows


def plaza(summary: dict[str, Any]) -> list[Figure]:
    """Robot between four beacons, its start not told; dead reckoning alone 1.93 m."""
    rows = []
    for who, limit in (("filter", 0.9), ("smoother", 0.7)):
        error = summary["errors"][who]["horizontal_m"]
        note = f"95 % {error['p95']:.2f}, worst {error['max']:.2f}"
        rows.append(
            Figure(
                f"{who}: horizontal error, rms", error["rms"], "m", f"at most {limit:g}", error["rms"] <= limit, note
            )
        )
    scale = summary["states"]["range_scale"]
    value = 100.0 * scale["value"]
    rows.append(
        Figure(
            "common scale of the ranges, found from a prior of 0 +- 10 %", value, "%", "6.8 +- 1",
            abs(value - 6.8) <= 1.0,
            f"sigma {100.0 * scale['std']:.2f} (the truth beside the ranges says 6.8 to 7.1)",
        )
    )  # fmt: skip
    nees = summary["consistency"]["nees_position"]
    rows.append(Figure("filter: position NEES/2 over the run", nees, "", "0.5 to 3", 0.5 <= nees <= 3.0))
    return rows


def smartloc(summary: dict[str, Any]) -> list[Figure]:
    """Car in a street: speed, turn rate and fixes from pseudoranges; plain least squares 37.6 m median."""
    rows = []
    for who, limit in (("filter", 15.0), ("smoother", 8.0)):
        error = summary["errors"][who]["horizontal_m"]
        note = f"95 % {error['p95']:.1f}, at the end {error['end']:.1f}; dead reckoning alone ends 94 m off"
        rows.append(
            Figure(
                f"{who}: horizontal error, rms", error["rms"], "m", f"at most {limit:g}", error["rms"] <= limit, note
            )
        )
    nees = summary["consistency"]["nees_position"]
    note = "echoes are correlated: a coloured error of the fixes is estimated"
    rows.append(Figure("filter: position NEES/2 over the run", nees, "", "at most 5", nees <= 5.0, note))
    found = next(s for s in summary["sweep"] if s["length_s"] == 60.0)
    value = found["filter_end_m"]["p50"]
    rows.append(
        Figure(
            "median error at the end of 60 s without fixes", value, "m", "at most 30", value <= 30.0,
            f"{found['windows']} windows, 95 % {found['filter_end_m']['p95']:.0f}, NEES/2 {found['nees_half']:.2f}",
        )
    )  # fmt: skip
    return rows


# study -> folder of the recording, what is claimed
EXAMPLES: dict[str, tuple[str, Callable[[dict[str, Any]], list[Figure]]]] = {
    "seaglider": ("glider_seaglider_sg171", seaglider),
    "seaexplorer": ("glider_seaexplorer_m010", seaexplorer),
    "comma2k19-car": ("car_comma2k19_wheel", comma2k19),
    "plaza1": ("rover_uwb_beacons_plaza1", plaza),
    "smartloc": ("car_smartloc_potsdamer", smartloc),
}
