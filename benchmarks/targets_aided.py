"""Kind "aided" on the five real recordings, held against what is wanted of it.

    python benchmarks/targets_aided.py [--only car-rtk-mems] [--json FILE] [--page docs/recordings.md]

Outages slide over a recording in two phases; an error is that of the last withheld fix, horizontal, median over the
windows, and the smoother's the largest inside a window. Where fixes are thinned, the fixes left out judge. Positions
are compared at the moment that the estimated delay gives them. "must" is a pass mark, "good" deserves praise.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from recordings import ROOT, prepare_example

from schuler.aiding.solution import Navigation, Solution
from schuler.ground.tables import Table
from schuler.ground.units import DEG

Array = NDArray[np.float64]
DATA = ROOT.parent / "shared" / "data"


@dataclass
class Row:
    """ours beside the two marks; low : what it must at least be (a NEES that is too modest is no merit)."""

    recording: str
    what: str
    ours: float
    unit: str
    must: float
    good: float | None = None
    low: float | None = None
    note: str = ""

    @property
    def verdict(self) -> str:
        if not np.isfinite(self.ours) or self.ours > self.must or (self.low is not None and self.ours < self.low):
            return "MISSED"
        return "good" if self.good is not None and self.ours <= self.good else "must"


# ------------------------------------------------------------------------------------------------------------ running


def variant(folder: Path, change: Callable[[dict[str, Any]], None] | None = None) -> Any:
    """The study of a prepared folder with changes to its sections, run."""
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    raw = tomllib.loads((folder / "study.toml").read_text(encoding="utf-8"))
    if change is not None:
        change(raw)
    study = parse_study(raw, folder)
    study._path = folder / "study.toml"
    return run_study(study)


def without(*keys: str) -> Callable[[dict[str, Any]], None]:
    """Takes sections, or keys written "section.key", out of a study."""

    def change(raw: dict[str, Any]) -> None:
        for key in keys:
            section, _, name = key.partition(".")
            if name:
                raw.get(section, {}).pop(name, None)
            else:
                raw.pop(section, None)

    return change


def read(folder: Path, name: str) -> Table:
    from schuler.io.tables import read_table

    return read_table(folder / f"{name}.csv", name)


def thinned(folder: Path, every_s: float) -> tuple[str, Table]:
    """gnss.csv with one fix each every_s, as a file beside it; and the fixes between them."""
    from schuler.io.writing import write_table

    gnss = read(folder, "gnss")
    step = max(1, round(every_s / float(np.median(np.diff(gnss.time)))))
    kept = np.arange(len(gnss)) % step == 0
    name = f"gnss-every-{every_s:g}s.csv"
    write_table(folder / name, gnss.where(kept))
    return name, gnss.where(~kept)


def delay_of(navigation: Navigation, typed: float, at: Array, smoothed: bool) -> Array:
    """Delay of the fixes at moments (m,), s: the estimate where there is one."""
    state = navigation.states.get("gnss_delay")
    if state is None:
        return np.full(len(at), typed)
    value = state.smoothed if smoothed and state.smoothed is not None else state.value
    return np.interp(at, state.time, value)


def arm_of(result: Any) -> tuple[float, float, float]:
    """From the IMU to the antenna, m: as the filter found it, else as typed."""
    arm = list(result.study.mounting.antenna_frd_m)
    for i, axis in enumerate("xyz"):
        state = result.navigation.states.get(f"antenna_lever_{axis}")
        if state is not None:
            arm[i] = float(state.value[-1])
    return arm[0], arm[1], arm[2]


def place_errors(track: Solution, rows: Table, delay: Array, arm: tuple[float, float, float]) -> Array:
    """Horizontal errors (m,) of a smoothed or dense track at rows stamped t, of t - delay; NaN outside."""
    from schuler.ground.earth import WGS84
    from schuler.judging.errors import at_point, resampled

    at = rows.time - delay
    inside = (at >= track.time[0]) & (at <= track.time[-1])
    there = resampled(at_point(track, arm), at[inside])
    height = rows["height"][inside] if "height" in rows else there.height
    d = WGS84.displacement_n(there.lat, there.lon, there.height, rows["lat"][inside], rows["lon"][inside], height)
    horizontal = np.full(len(at), np.nan)
    horizontal[inside] = np.hypot(d[:, 0], d[:, 1])
    return horizontal


def rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def of(sweep: list[dict[str, Any]], length: float) -> dict[str, Any]:
    return next((s for s in sweep if s["length_s"] == length), {})


def number(value: Any) -> float:
    return float("nan") if value is None else float(value)


# ---------------------------------------------------------------------------------------------------------- recordings


def straight_on(result: Any, length: float) -> float:
    """Median error, m, of who keeps the velocity of the last fix, over the same outages."""
    from schuler.ground.earth import WGS84
    from schuler.studies.sweep import PHASES, windows

    g, settle = result.tables["gnss"], result.study.sweep.settle_s
    t, errors = g.time, []
    for phase in range(PHASES):
        for a, b in windows(float(t[0]), float(t[-1]), length, settle, phase):
            inside = np.flatnonzero((t >= a) & (t <= b))
            if not len(inside) or inside[0] == 0:
                continue
            i, j = inside[0] - 1, inside[-1]
            d = WGS84.displacement_n(g["lat"][j], g["lon"][j], 0.0, g["lat"][i], g["lon"][i], 0.0)
            gone = t[j] - t[i]
            errors.append(np.hypot(d[0] - g["v_north"][i] * gone, d[1] - g["v_east"][i] * gone))
    return float(np.median(errors)) if errors else float("nan")


def outages(
    name: str,
    result: Any,
    marks: dict[float, tuple[float, ...]],
    nees: tuple[float, float] | None,
    what: str = "filter",
) -> Iterator[Row]:
    """Rows of the sweep of a finished study. marks : length -> (must, good) of the filter, then the smoother's."""
    for length, mark in marks.items():
        found = of(result.summary["sweep"], length)
        end, largest = found.get("filter_end_m", {}), found.get("smoother_max_m", {})
        note = f"{found.get('windows', 0)} windows, 95 % {number(end.get('p95')):.3g} m"
        note += f"; straight on {straight_on(result, length):.0f} m"
        label = f"{length:g} s without fixes"
        yield Row(name, f"{label}, {what}", number(end.get("p50")), "m", mark[0], mark[1], note=note)
        if len(mark) > 2:
            note = f"95 % {number(largest.get('p95')):.3g} m"
            yield Row(name, f"{label}, smoother, largest", number(largest.get("p50")), "m", mark[2], mark[3], note=note)
        if nees is not None:
            value = number(found.get("nees_half"))
            yield Row(name, f"{label}, {what}, NEES/2 at the end", value, "", nees[1], low=nees[0])


def innovations(result: Any) -> str:
    """NIS of each kind of measurement, as one line."""
    nis = result.summary.get("consistency", {}).get("nis", {})
    return ", ".join(f"{kind} {number(v['mean']):.2f}" for kind, v in nis.items() if v)


def car_rtk(folder: Path) -> Iterator[Row]:
    """A1."""
    name = "car-rtk-mems"
    full = variant(folder)
    marks = {15.0: (4.0, 2.0, 0.6, 0.25), 30.0: (7.0, 2.5, 1.8, 0.8), 60.0: (16.0, 8.0, 4.0, 2.0)}
    yield from outages(name, full, marks, (0.5, 3.0), "filter with NHC")
    say(f"{name}: NIS {innovations(full)}")
    for every, must, good in ((1.0, 0.03, 0.015), (5.0, 0.12, 0.06), (10.0, 0.4, 0.2)):
        file, left = thinned(folder, every)

        def change(raw: dict[str, Any], file: str = file) -> None:
            raw["input"]["gnss"] = file
            raw.pop("sweep", None)

        found = variant(folder, change)
        arm = arm_of(found)
        left = left.where(left.time > left.time[0] + 60.0)
        both = {}
        for which, track in (("smoother", found.navigation.smoother), ("filter", found.navigation.filter)):
            delay = delay_of(found.navigation, found.study.input.gnss_delay_s, left.time, which == "smoother")
            both[which] = place_errors(track, left, delay, arm)
        note = (
            f"95 % {np.nanpercentile(both['smoother'], 95):.3g} m; filter (10 Hz rows) {rms(both['filter']):.3g} m rms"
        )
        yield Row(
            name,
            f"a fix each {every:g} s, smoother at the others, rms",
            rms(both["smoother"]),
            "m",
            must,
            good,
            note=note,
        )


def comma(folder: Path) -> Iterator[Row]:
    """A2."""
    name = "comma2k19-aided"
    full = variant(folder)
    for which in ("filter", "smoother"):
        errors = (full.summary["errors"].get(which) or {}).get("horizontal_m") or {}
        note = f"95 % {number(errors.get('p95')):.3g} m"
        yield Row(
            name,
            f"every fix, {which} against the reference, rms",
            number(errors.get("rms")),
            "m",
            0.60,
            0.45,
            note=note,
        )
    yield from outages(name, full, {15.0: (3.0, 1.6), 30.0: (5.0, 3.3)}, (0.0, 5.0), "filter with speed")
    say(f"{name}: NIS {innovations(full)}")


def thor(folder: Path) -> Iterator[Row]:
    """A3."""
    name = "thor-uav"
    marks = {15.0: (14.0, 8.0), 30.0: (40.0, 24.0), 60.0: (120.0, 70.0)}
    full = variant(folder)
    yield from outages(name, full, marks, (0.0, 5.0), "filter with airspeed")
    say(f"{name}: NIS {innovations(full)}")

    def bare(raw: dict[str, Any]) -> None:
        without("input.speed", "input.height", "filter.speed_is")(raw)
        air = ("current", "speed_scale", "height_bias")
        raw["filter"]["estimate"] = [name for name in raw["filter"]["estimate"] if name not in air]

    plain = variant(folder, bare)
    marks = {15.0: (18.0, 10.0), 30.0: (80.0, 37.0), 60.0: (450.0, 190.0)}
    yield from outages(name, plain, marks, (0.0, 5.0), "INS alone")


def phone(folder: Path) -> Iterator[Row]:
    """A5."""
    full = variant(folder)
    marks = {15.0: (16.0, 10.0), 30.0: (90.0, 40.0), 60.0: (420.0, 190.0)}
    yield from outages("car-phone", full, marks, (0.0, 5.0), "filter with NHC")
    say(f"car-phone: NIS {innovations(full)}")


QUAD_SETTLE_S, QUAD_BETWEEN_S = 8.0, 10.0


def dense_rows(folder: Path) -> Table:
    """Every position of a quadrotor's truth, as rows of a receiver."""
    from schuler.studies.inputs import on_earth
    from schuler.studies.model import load_study

    truth = on_earth(load_study(folder / "study.toml"), read(folder, "reference"))
    names = ("lat", "lon", "height")
    return Table("gnss", {"time": truth.time, **{n: truth[n] for n in names}})


def quad(folder: Path) -> Iterator[Row]:
    """A4. folder : one of each flight and sensor."""
    from schuler.judging.outages import outage

    name = "quad-4imu"
    smooth, filtered, tilts = [], [], []
    ends: dict[float, list[float]] = {5.0: [], 10.0: []}
    largest: dict[float, list[float]] = {5.0: [], 10.0: []}
    nees: dict[float, list[float]] = {5.0: [], 10.0: []}
    for study in sorted(folder.glob("*/study.toml")):
        rows = dense_rows(study.parent)
        full = variant(study.parent, without("sweep"))
        typed, arm = full.study.input.gnss_delay_s, arm_of(full)
        late = rows.where(rows.time > rows.time[0] + 3.0)
        for track, kept in ((full.navigation.smoother, smooth), (full.navigation.filter, filtered)):
            delay = delay_of(full.navigation, typed, late.time, kept is smooth)
            kept.append(rms(place_errors(track, late, delay, arm)))
        errors = full.navigation.smoother, read(study.parent, "reference")
        tilts.append(tilt(*errors))
        for length in ends:
            for phase in range(2):
                spans = windows(float(rows.time[0]), float(rows.time[-1]), length, phase)
                if not spans:
                    continue

                def change(raw: dict[str, Any], spans: list[tuple[float, float]] = spans) -> None:
                    raw.pop("sweep", None)
                    raw["outage"] = [{"sensor": "gnss", "start_s": a, "end_s": b} for a, b in spans]

                found = variant(study.parent, change)
                gnss, arm = found.withheld["gnss"], arm_of(found)
                for a, b in spans:
                    gone = gnss.where((gnss.time >= a) & (gnss.time <= b))
                    last = gone.time[-1:]
                    delay = float(delay_of(found.navigation, typed, last, False)[0])
                    entry = outage(
                        found.navigation, gone, "gnss", a, b, None, antenna_frd=arm,
                        gnss_m=found.study.noise.gnss_m, delay=delay,
                    )  # fmt: skip
                    inside = rows.where((rows.time >= a) & (rows.time <= b))
                    after = delay_of(found.navigation, typed, inside.time, True)
                    worst = np.nanmax(place_errors(found.navigation.smoother, inside, after, arm))
                    ends[length].append(entry["horizontal_end_m"])
                    nees[length].append(entry["nees_half_end"])
                    largest[length].append(float(worst))
    note = f"each: {', '.join(f'{v:.3f}' for v in smooth)}; filter (10 Hz rows) median {np.median(filtered):.3g}"
    yield Row(
        name,
        "fixes of 1 Hz, smoother at 10 Hz, rms, median of the flights",
        float(np.median(smooth)),
        "m",
        0.09,
        0.045,
        note=note,
    )
    note = f"roll {np.median([t[0] for t in tilts]):.2f}, pitch {np.median([t[1] for t in tilts]):.2f} deg"
    yield Row(
        name,
        "roll and pitch, std against the drone, smoother, median",
        float(np.median(tilts)),
        "deg",
        1.5,
        0.6,
        note=note,
    )
    for length, marks in ((5.0, (1.6, 0.7, 0.3, 0.15)), (10.0, (6.0, 2.5, 0.5, 0.2))):
        end, note = np.array(ends[length]), f"{len(ends[length])} windows, 95 % {np.percentile(ends[length], 95):.3g} m"
        yield Row(
            name, f"{length:g} s without fixes, filter", float(np.median(end)), "m", marks[0], marks[1], note=note
        )
        note = f"95 % {np.percentile(largest[length], 95):.3g} m"
        yield Row(
            name,
            f"{length:g} s without fixes, smoother, largest",
            float(np.median(largest[length])),
            "m",
            marks[2],
            marks[3],
            note=note,
        )
        yield Row(
            name, f"{length:g} s without fixes, NEES/2 at the end", float(np.mean(nees[length])), "", 3.0, low=0.5
        )


def windows(first: float, last: float, length: float, phase: int) -> list[tuple[float, float]]:
    """Outages of a short flight: every length + QUAD_BETWEEN_S, the second phase half of that later."""
    period = length + QUAD_BETWEEN_S
    start = first + QUAD_SETTLE_S + phase * period / 2.0
    found = []
    while start + length <= last - 1.0:
        found.append((start, start + length))
        start += period
    return found


def tilt(track: Solution, reference: Table) -> tuple[float, float]:
    """Standard deviation of roll and pitch against a reference, deg."""
    inside = (reference.time > track.time[0] + 3.0) & (reference.time < track.time[-1])
    t = reference.time[inside]
    out = []
    for k, axis in enumerate(("roll", "pitch")):
        out.append(float(np.std(np.interp(t, track.time, track.rpy[:, k]) - reference[axis][inside])) / DEG)
    return out[0], out[1]


# example -> folder of the recording, more arguments of prepare.py, rows
RECORDINGS: dict[str, tuple[str, tuple[str, ...], Callable[[Path], Iterator[Row]]]] = {
    "car-rtk-mems": ("car_rtk_mems", (), car_rtk),
    "comma2k19-aided": ("car_comma2k19_wheel", (), comma),
    "thor-uav": ("uav_thor75", (), thor),
    "quad-4imu": ("quad_4imu_rtk", ("all",), quad),
    "car-phone": ("car_phone_a", (), phone),
}


def rows(only: str | None = None) -> Iterator[Row]:
    """All rows of the recordings that are there."""
    for example, (folder, more, judge) in RECORDINGS.items():
        if only not in (None, example):
            continue
        if not (DATA / folder).is_dir():
            say(f"{example}: {DATA / folder} is not there; left out")
            continue
        with tempfile.TemporaryDirectory() as out:
            prepare_example(example, DATA / folder, Path(out) / "tables", *more)
            yield from judge(Path(out) / "tables")


def text(row: Row) -> str:
    good = "" if row.good is None else f"{row.good:g}"
    must = f"{row.must:g}" if row.low is None else f"{row.low:g} .. {row.must:g}"
    return (
        f"| {row.recording} | {row.what} | {row.ours:.3g} {row.unit} | {must} | {good} | {row.verdict} | {row.note} |"
    )


HEAD = "| recording | figure | ours | must | good | verdict | |\n|---|---|---|---|---|---|---|"
BEGIN, END = "<!-- aided: python benchmarks/targets_aided.py --page docs/recordings.md -->", "<!-- end of aided -->"


def between(page: Path, begin: str, end: str, text: str) -> None:
    """Puts a text into a page, between two marks of it. ValueError where they are not there."""
    before, mark, rest = page.read_text(encoding="utf-8").partition(begin)
    _, other, after = rest.partition(end)
    if not mark or not other:
        raise ValueError(f"{page}: no place for the table between {begin} and {end}")
    page.write_text(f"{before}{begin}\n{text}{end}{after}", encoding="utf-8")


def say(what: str) -> None:
    print(what, file=sys.stderr, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=RECORDINGS, help="one recording")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    parser.add_argument("--page", type=Path, help="put the table into this page, between its marks")
    given = parser.parse_args()
    print(HEAD)
    told = []
    for row in rows(given.only):
        print(text(row), flush=True)
        told.append(row)
    if given.json is not None:
        given.json.write_text(json.dumps([{**asdict(r), "verdict": r.verdict} for r in told], indent=1) + "\n")
    if given.page is not None:
        between(given.page, BEGIN, END, "\n".join([HEAD, *(text(r) for r in told)]) + "\n")
    missed = [r for r in told if r.verdict == "MISSED"]
    praised = [r for r in told if r.verdict == "good"]
    marked = [r for r in told if r.good is not None]
    say(f"{len(told) - len(missed)} of {len(told)} rows pass; {len(praised)} of {len(marked)} reach the better mark")
    return bool(missed)


if __name__ == "__main__":
    sys.exit(main())
