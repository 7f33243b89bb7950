"""Golden replays: a few rows of state and sigma of the example studies on real recordings, kept in csv files here.

python tests/golden/replay.py            what has moved, in sigmas
python tests/golden/replay.py --update   the same, and the files are written anew: commit them with the reason
"""

from __future__ import annotations

import csv
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
DATA = ROOT.parent / "shared" / "data"
sys.path.insert(0, str(ROOT / "benchmarks"))

from recordings import (  # noqa: E402
    BROAD,
    EXAMPLES,
    broad_figures,  # noqa: F401
    prepare_example,
    run_broad,
    run_example,
)
from targets_aided import RECORDINGS as AIDED  # noqa: E402
from targets_aided import variant, without  # noqa: E402

ROWS = 8
BROAD_REPLAYED = ("02_undisturbed_slow_rotation_B", "30_disturbed_stationary_magnet_C")
Golden = dict[
    tuple[float, str], tuple[float, float]
]  # (time, quantity) -> value, sigma; degrees where the name says so


def golden_of(navigation: Any) -> Golden:
    """Position, heading and the learnt states with their sigmas at ROWS moments spread over the run."""
    track = navigation.filter
    wanted = np.linspace(track.time[0], track.time[-1], ROWS + 1)[1:]
    found: Golden = {}
    for t in wanted:
        i = int(np.searchsorted(track.time, t, side="right")) - 1
        at = round(float(track.time[i]), 3)
        if np.isnan(track.lat[i]):  # an attitude without a place
            for k, name in enumerate(("roll_deg", "pitch_deg")):
                sigma = float(np.degrees(np.sqrt(track.cov_rpy[i, k, k])))
                found[at, name] = float(np.degrees(track.rpy[i, k])), sigma
        else:
            north, east = (float(np.sqrt(track.cov_pos[i, k, k])) for k in (0, 1))
            found[at, "lat_deg"] = float(np.degrees(track.lat[i])), np.degrees(north / 6.37e6)
            found[at, "lon_deg"] = float(np.degrees(track.lon[i])), np.degrees(east / (6.37e6 * np.cos(track.lat[i])))
        heading = float(np.degrees(track.rpy[i, 2]))
        found[at, "heading_deg"] = heading, float(np.degrees(np.sqrt(track.cov_rpy[i, 2, 2])))
        for name, state in navigation.states.items():
            j = int(np.searchsorted(state.time, t, side="right")) - 1
            found[at, name] = float(state.value[j]), float(state.std[j])
    return found


def replay(example: str, data: Path, out: Path) -> Any:
    """The study of an example on its recording, run; those of kind "aided" without their sweep of outages."""
    if example in EXAMPLES:
        return run_example(example, data, out)
    prepare_example(example, data, out)
    return variant(out, without("sweep"))


def folders() -> dict[str, str]:
    """Example -> folder of its recording."""
    return {n: f for n, (f, _) in EXAMPLES.items()} | {n: f for n, (f, _, _) in AIDED.items()}


def read(example: str) -> Golden:
    with open(HERE / f"{example}.csv", encoding="utf-8", newline="") as file:
        return {(float(r["time"]), r["quantity"]): (float(r["value"]), float(r["sigma"])) for r in csv.DictReader(file)}


def write(example: str, golden: Golden) -> None:
    with open(HERE / f"{example}.csv", "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["time", "quantity", "value", "sigma"])
        for (time, name), (value, sigma) in golden.items():
            rows.writerow([f"{time:.3f}", name, f"{value:.12g}", f"{sigma:.6g}"])


def moved(old: Golden, new: Golden) -> dict[tuple[float, str], tuple[float, float]]:
    """(time, quantity) -> (change of the value in old sigmas, new sigma over old); infinite where one is missing."""
    out = {}
    for key in old.keys() | new.keys():
        if key not in old or key not in new:
            out[key] = float("inf"), float("inf")
            continue
        (a, s), (b, r) = old[key], new[key]
        change = b - a
        if key[1] in ("heading_deg", "lon_deg", "roll_deg"):
            change = (change + 180.0) % 360.0 - 180.0
        if s > 0.0:
            out[key] = change / s, r / s
        else:
            out[key] = (0.0, 1.0) if (a, s) == (b, r) else (float("inf"), float("inf"))
    return out


def replays() -> Iterator[tuple[str, Golden]]:
    """(name, rows) of every replay whose recording is there."""
    for example, folder in folders().items():
        if not (DATA / folder).is_dir():
            print(f"{example}: no recording at {DATA / folder}")
            continue
        with tempfile.TemporaryDirectory() as out:
            yield example, golden_of(replay(example, DATA / folder, Path(out) / "tables").navigation)
    if not (DATA / BROAD).is_dir():
        print(f"ahrs-broad: no recording at {DATA / BROAD}")
        return
    with tempfile.TemporaryDirectory() as out:
        results = run_broad(DATA / BROAD, Path(out))
    for trial in BROAD_REPLAYED:
        yield f"ahrs-broad-{trial[:2]}", golden_of(results[trial, 9].navigation)


def main() -> int:
    for example, new in replays():
        old = read(example) if (HERE / f"{example}.csv").exists() else {}
        for (time, name), (change, ratio) in sorted(moved(old, new).items()):
            if abs(change) > 1e-3 or abs(ratio - 1.0) > 1e-3:
                print(f"{example} {time:.3f} {name}: {change:+.3g} sigma, sigma x {ratio:.4g}")
        if "--update" in sys.argv[1:]:
            write(example, new)
            print(f"{example}.csv written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
