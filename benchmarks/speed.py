"""`make bench`: speed of the main tasks (medians, warm) beside what is promised. Status 1 where one is missed."""

from __future__ import annotations

import sys

from schuler.studies.bench import IMPORT, run_tasks, table_lines

PROMISED = {  # task: least rate
    "vehicle simulated with all its sensors, 1800 s at 100 Hz": 180_000 / 1.0,
    "AUV filter and smoother, 620 s at 100 Hz": 62_000 / 1.0,  # a whole run in a second
    "AUV filter, 620 s at 100 Hz": 200_000,
    "AUV filter online, one predict from Python": 1 / 20e-6,
    "INS with 100 landmarks a second, 100 Hz, no smoother": 1800.0 / 2.0,
    "pose from 100 sightings, compiled: search and least squares": 1 / 100e-6,
    "aided filter, 15 states, fixes at 1 Hz, 200 Hz": 400_000,
    "aided filter, 24 states, fixes at 1 Hz, 200 Hz": 200_000,
    "aided filter and smoother, 15 states": 400_000 / 3.0,
    "aided filter and smoother, 24 states": 200_000 / 3.0,
    "attitude filter, 6 axes": 3_000_000,
    "attitude filter, 9 axes": 3_000_000,
}
MOST = {IMPORT: 1.6}  # times import numpy


def main() -> int:
    rows = run_tasks(lambda step: print(f"  {step} ...", file=sys.stderr))
    print("\n".join(table_lines(rows)))
    missed = []
    for r in rows:
        if r.rate < PROMISED.get(r.task, 0.0):
            missed.append(f"{r.task}: {r.rate:.4g} {r.unit}, promised {PROMISED[r.task]:.4g}")
        if r.rate > MOST.get(r.task, float("inf")):
            missed.append(f"{r.task}: {r.rate:.3g} {r.unit}, at most {MOST[r.task]}")
    print("\n".join(f"MISSED {m}" for m in missed) if missed else "all that is promised is kept")
    return bool(missed)


if __name__ == "__main__":
    sys.exit(main())
