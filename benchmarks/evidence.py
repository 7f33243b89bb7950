"""`make evidence`: the figures of the README and of docs/evidence.md, measured again (some minutes).

    python benchmarks/evidence.py [--runs 300] [--seed 2026] [--out docs] [--only paper,auv,aided,recorded,...]

With --only the other parts keep the figures that evidence.json has of them.

Monte Carlo on the paper's filter and on ours, real recordings where ../shared/data is beside the checkout, speed. Seed
was fixed before the first run. Status 1 where a claim does not hold.
"""

from __future__ import annotations

import argparse
import json
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
from recordings import BROAD, EXAMPLES, ROOT, broad_figures, run_broad, run_example
from speed import MOST, PROMISED

DATA = ROOT.parent / "shared" / "data"
# Mean absolute heading error of the paper's policy at the end of the outage, deg: 60 runs of an independent program.
PAPER = {1: (2.54, 60), 2: (5.17, 60)}


@dataclass
class Claim:
    """One line of the table. holds: None where there is nothing to hold against."""

    part: str
    what: str
    value: float
    unit: str
    wanted: str
    holds: bool | None
    note: str = ""


def at_most(part: str, what: str, value: float, unit: str, limit: float, note: str = "") -> Claim:
    return Claim(part, what, value, unit, f"at most {limit:g}", value <= limit, note)


def within(part: str, what: str, mean: dict[str, Any], note: str = "") -> Claim:
    wanted = f"{mean['low']:.2f} .. {mean['high']:.2f}"
    return Claim(part, what, mean["mean"], "", wanted, mean["inside"], note)


# --- simulated ------------------------------------------------------------------------------------------------------


def paper(runs: int, seed: int, raw: dict[str, Any]) -> Iterator[Claim]:
    from schuler.published.evidence_auv import mean_abs_error, paper_monte_carlo

    for test, (reference, reference_runs) in PAPER.items():
        s = paper_monte_carlo(test, "paper", runs, seed)
        raw[f"paper test {test}"] = {k: v for k, v in s.items() if k != "heading_abs_deg"}
        h = s["heading_end_deg"]
        error = hypot(reference * mean_abs_error(reference_runs), h["se_mean_abs"])
        wanted = f"{reference:g} +- {2.576 * error:.2f} (99 % sampling error)"
        yield Claim(
            "paper's filter",
            f"test {test}: mean absolute heading error at the end of the outage",
            h["mean_abs"],
            "deg",
            wanted,
            abs(h["mean_abs"] - reference) <= 2.576 * error,
            f"rms {h['rms']:.2f}, 95 % {h['p95']:.2f}; the filter's own sigma {s['sigma_end_deg']:.2f}",
        )


def ours(runs: int, seed: int, raw: dict[str, Any]) -> Iterator[Claim]:
    from schuler.judging.auv_evidence import EXPERIMENTS, ensemble

    limits = {"dive": 42.0, "second dive": 24.0, "magnetometer and DVL": 7.5}
    for name, experiment in EXPERIMENTS.items():
        s = ensemble(experiment, runs, seed, lambda run, name=name: say(f"{name}: {run} of {runs}"))
        raw[name] = s
        part = f"schuler: {s['title']}"
        end, smooth, heading = s["end_m"], s["smoother_rms_m"], s["heading_deg"]
        note = (
            f"+- {end['se']:.1f} (standard error); rms {end['rms']:.1f}, 95 % {end['p95']:.1f}, worst {end['max']:.1f}"
        )
        if name in limits:
            yield at_most(part, "mean position error at the end", end["mean"], "m", limits[name], note)
        else:
            note = (
                f"standard error {smooth['se']:.2f}; rms of all runs {smooth['rms']:.2f}, worst run {smooth['max']:.1f}"
            )
            yield at_most(part, "smoothed track, rms along the dive, mean of the runs", smooth["mean"], "m", 4.5, note)
        yield within(part, "position NEES/2 at the end of the dive", s["nees_half"])
        note = f"heading error: mean absolute {heading['mean']:.2f} deg, rms {heading['rms']:.2f}"
        yield within(part, "heading error^2 / sigma^2 there", s["heading_ratio"], note)
        yield within(part, "smoother's position NEES/2 in the middle of the dive", s["smoother_nees_half"])
        for kind, nis in s["nis"].items():
            note = f"standard error {nis['se']:.3f}; were all {nis['n']} innovations independent: "
            note += f"{nis['low_all']:.3f} .. {nis['high_all']:.3f}; left out {nis['left_out']}"
            yield within(part, f"NIS of {kind}, per degree of freedom, mean of the runs", nis, note)


def aided(runs: int, seed: int, raw: dict[str, Any]) -> Iterator[Claim]:
    """Kind "aided" on simulated vehicles. The car slips less than its constraints allow for: no bound below."""
    from schuler.studies.aided_evidence import EXPERIMENTS, ensemble

    for name, experiment in EXPERIMENTS.items():
        s = ensemble(experiment, runs, seed, lambda run, name=name: say(f"{name}: {run} of {runs}"))
        raw[f"aided {name}"] = s
        part = f"aided: {s['title']}"
        start, end = experiment.outage
        figures = {f"{what} NEES over the track, mean of the runs": mean for what, mean in s["nees"].items()}
        for what, mean in s["end"].items():
            when = "at the outage's end" if what.startswith("filter") else "in the outage's middle"
            figures[f"{what} NEES {when}"] = mean
        for what, mean in figures.items():
            if name == "car":
                yield at_most(part, what, mean["mean"], "", mean["high"], f"lower bound were {mean['low']:.2f}")
            else:
                yield within(part, what, mean)
        half = s["end"]["filter horizontal"]["mean"]
        yield Claim(part, "NEES/2 at the outage's end", half, "", "0.5 .. 3", 0.5 <= half <= 3.0)
        for kind, nis in s["nis"].items():
            note = f"left out {nis['left_out']} of {nis['n']}"
            if kind in ("nhc", "zupt", "zaru"):
                yield at_most(part, f"NIS of {kind}, per degree of freedom", nis["mean"], "", nis["high"], note)
            else:
                yield within(part, f"NIS of {kind}, per degree of freedom, mean of the runs", nis, note)
        note = (
            f"filter {s['filter_rms_m']:.2f} m, smoother {s['smoother_rms_m']:.2f} m, {end - start:.0f} s without fixes"
        )
        ratio = s["smoother_ratio"]
        if name in ("ship", "beacons"):  # the other sensors bound the filter in the outage
            yield Claim(part, "smoother's rms over the filter's in the outage", ratio, "", "", None, note)
        else:
            yield at_most(part, "smoother's rms over the filter's in the outage", ratio, "", 0.5, note)


def oeson(runs: int, seed: int, raw: dict[str, Any]) -> Iterator[Claim]:
    """The thesis's flights with landmarks and its filter listings, against the table of an independent recomputation
    from six runs: position and velocity within 15 %, tilt and yaw within 15 % or twice the standard error that six runs
    have (yaw's error at the start is one draw a run, which six know to 29 %)."""
    from schuler.published.sins_filters import BETTER, TABLE, WITHIN
    from schuler.studies.oeson import CASES, PATHS
    from schuler.studies.oeson_runs import ensemble

    done: dict[tuple[str, str], dict[str, Any]] = {}
    for case in CASES:
        for path in PATHS:
            say(f"{case}, {path}")
            s = done[case, path] = ensemble(case, path, runs, seed)
            raw[f"oeson {case} {path}"] = s
            part = f"{s['title']}, {path}"
            published = TABLE.get(case, (None, None))[path == "turns"]
            honesty = f"error / sigma {s['ratio_low']:.2f} .. {s['ratio_high']:.2f}"
            figures = (
                ("pos_m", "position", "m"), ("vel_mps", "velocity", "m/s"), ("tilt_arcmin", "tilt", "arcmin"),
                ("yaw_arcmin", "yaw", "arcmin"),
            )  # fmt: skip
            for k, (key, what, unit) in enumerate(figures if published is not None else ()):
                value, old = s[key], published[k]
                within = WITHIN if k < 2 else max(WITHIN, 2.0 * s["six"][k])
                if case in BETTER:
                    limit = old * (1.0 + within)
                    yield Claim(part, f"rms {what}", value, unit, f"about {old:g} or less", value <= limit, honesty)
                else:
                    near = abs(value - old) <= within * old
                    holds = None if case in ("a2-zeroed", "a3-correlated-15") else near  # faults: told, not promised
                    yield Claim(part, f"rms {what}", value, unit, f"{old:g} +- {100.0 * within:.0f} %", holds, honesty)
            if case in BETTER:
                yield at_most(part, "largest error / sigma of the seven states", s["ratio_high"], "", 1.5)
    for path in PATHS:
        clean, false = done["landmarks-1px-6", path]["pos_m"], done["false-5-percent", path]["pos_m"]
        part = f"OESON flight, robustness, {path}"
        yield at_most(part, "rms with 5 % of the names wrong over that with none", false / clean, "", 1.5)
        gap = done["gap-300", path]
        yield at_most(part, "rms at the end of 300 s without landmarks", gap["end_m"], "m", 2.5)
        yield Claim(part, "error / sigma there", gap["end_ratio"], "", "0.8 .. 1.25", 0.8 <= gap["end_ratio"] <= 1.25)
        worst = done["a3-printed", path]["ratio_high"]
        yield Claim(part, "listing A.3 as printed: largest error / sigma", worst, "", "15 .. 70", 15.0 <= worst <= 70.0)


# --- recorded -------------------------------------------------------------------------------------------------------


def recorded(raw: dict[str, Any]) -> Iterator[Claim]:
    for example, (folder, figures) in EXAMPLES.items():
        if not (DATA / folder).is_dir():
            say(f"{example}: {DATA / folder} is not there; left out")
            continue
        say(example)
        with tempfile.TemporaryDirectory() as out:
            found = figures(run_example(example, DATA / folder, Path(out) / "tables").summary)
        raw[example] = {f.what: f.value for f in found}
        for f in found:
            yield Claim(example, f.what, f.value, f.unit, f.wanted, f.holds, f.note)


def attitudes(raw: dict[str, Any]) -> Iterator[Claim]:
    """The BROAD trials, with and without the magnetometer."""
    if not (DATA / BROAD).is_dir():
        say(f"ahrs-broad: {DATA / BROAD} is not there; left out")
        return
    say("ahrs-broad")
    with tempfile.TemporaryDirectory() as out:
        found = broad_figures(run_broad(DATA / BROAD, Path(out)))
    raw["ahrs-broad"] = {f.what: f.value for f in found}
    for f in found:
        yield Claim("ahrs-broad", f.what, f.value, f.unit, f.wanted, f.holds, f.note)


def marks(raw: dict[str, Any]) -> Iterator[Claim]:
    """Kind "aided" on the recordings: every row of `targets_aided`, held against its pass mark."""
    from targets_aided import rows

    found = list(rows())
    raw["aided recordings"] = [{**asdict(r), "verdict": r.verdict} for r in found]
    for r in found:
        wanted = f"at most {r.must:g}" if r.low is None else f"{r.low:g} .. {r.must:g}"
        if r.good is not None:
            wanted += f", better {r.good:g}"
        yield Claim(f"aided: {r.recording}", r.what, r.ours, r.unit, wanted, r.verdict != "MISSED", r.note)


# --- speed ----------------------------------------------------------------------------------------------------------


def speed(raw: dict[str, Any]) -> Iterator[Claim]:
    from schuler.studies.bench import run_tasks

    rows = run_tasks(say)
    raw["speed"] = [vars(r) for r in rows]
    for r in rows:
        if r.task in PROMISED:
            least = PROMISED[r.task]
            yield Claim("speed", r.task, r.rate, r.unit, f"at least {least:g}", r.rate >= least)
        if r.task in MOST:
            yield at_most("speed", r.task, r.rate, r.unit, MOST[r.task])


# --- writing --------------------------------------------------------------------------------------------------------


def markdown(claims: list[Claim], runs: int, seed: int, machine: str) -> str:
    lines = [
        "# Evidence",
        "",
        f"Written by `make evidence`: {runs} runs for each simulated row, seed {seed}, the seed fixed beforehand;",
        f"{machine}. Errors are horizontal. NEES and NIS are per degree of freedom, ideal 1, wanted inside the",
        f"99 % chi-square bounds of a mean over {runs} runs (one innovation a run); beside them the bounds as if all",
        "innovations were independent, which those of coloured errors are not.",
        "",
        "Simulated: the paper's first test (`schuler.truth.missions`), a constant current N(0, 0.25 m/s) a component",
        "and a log scale N(0, 1 %) drawn in each run. The filter (`schuler.judging.auv_evidence`) has its default",
        "settings but for the current: sigma 0.25 m/s, walk 0.04 m/s/sqrt(h).",
        "",
        f"Kind aided: {min(runs, 200)} runs of each study in `schuler.studies.aided_evidence`; whatever has a sigma",
        "is drawn anew in each run, the errors of the start too.",
    ]
    part = ""
    for c in claims:
        if c.part != part:
            part = c.part
            lines += [
                "",
                f"## {part[0].upper()}{part[1:]}",
                "",
                "| figure | measured | wanted | | |",
                "|---|---|---|---|---|",
            ]
        mark = "" if c.holds is None else "holds" if c.holds else "**missed**"
        lines.append(f"| {c.what} | {number(c.value)} {c.unit} | {c.wanted} | {mark} | {c.note} |")
    return "\n".join(lines) + "\n"


def number(value: float) -> str:
    if abs(value) >= 1000.0:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.3g}" if abs(value) < 10.0 else f"{value:.1f}"


def say(text: str) -> None:
    if sys.stderr.isatty():
        width = shutil.get_terminal_size().columns - 1
        print(f"\r{text[:width]:{width}}", end="", file=sys.stderr, flush=True)


PARTS: dict[str, Callable[[int, int, dict[str, Any]], Iterable[Claim]]] = {
    "paper": paper,
    "auv": ours,
    "aided": lambda runs, seed, raw: aided(min(runs, 200), seed, raw),
    "oeson": lambda runs, seed, raw: oeson(min(runs, 200), seed, raw),
    "recorded": lambda runs, seed, raw: recorded(raw),
    "ahrs": lambda runs, seed, raw: attitudes(raw),
    "marks": lambda runs, seed, raw: marks(raw),
    "speed": lambda runs, seed, raw: speed(raw),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--out", type=Path, default=ROOT / "docs")
    parser.add_argument("--only", default=",".join(PARTS), help="parts to measure, with commas between")
    given = parser.parse_args()
    chosen = given.only.split(",")
    if unknown := [name for name in chosen if name not in PARTS]:
        parser.error(f"--only {', '.join(unknown)}: there are {', '.join(PARTS)}")
    before: dict[str, Any] = {"claims": [], "parts": {}}
    if set(chosen) != set(PARTS) and (given.out / "evidence.json").exists():
        before |= json.loads((given.out / "evidence.json").read_text(encoding="utf-8"))
    claims: list[Claim] = []
    parts: dict[str, Any] = {}
    for name, measure in PARTS.items():
        raw: dict[str, Any] = {}
        if name in chosen:
            found = list(measure(given.runs, given.seed, raw))
        elif name in before["parts"]:
            kept = before["parts"][name]
            found = [Claim(**c) for c in before["claims"][kept["first"] : kept["first"] + kept["count"]]]
            raw = kept["raw"]
        else:
            continue
        parts[name] = {"first": len(claims), "count": len(found), "raw": raw}
        claims += found
    from schuler import __version__

    machine = f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}, schuler {__version__}"
    told = {
        "runs": given.runs,
        "seed": given.seed,
        "machine": machine,
        "claims": [asdict(c) for c in claims],
        "parts": parts,
    }
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "evidence.md").write_text(markdown(claims, given.runs, given.seed, machine), encoding="utf-8")
    (given.out / "evidence.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    say("")
    missed = [c for c in claims if c.holds is False]
    for c in missed:
        print(f"MISSED {c.part}: {c.what}: {number(c.value)} {c.unit}, wanted {c.wanted} {c.note}")
    print(f"{len(claims) - len(missed)} of {len(claims)} claims hold; written: {given.out / 'evidence.md'}")
    return bool(missed)


if __name__ == "__main__":
    sys.exit(main())
