"""Speed of the platform's tasks beside what is promised: python benchmarks/bench_platform.py. Status 1 where missed.

Four scenarios, each channel's drift alone and together, every algorithm, with pages: under 10 s on two cores, warm.
A map of 60 x 72 cases of two hours: under 60 s for each algorithm.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SCENARIOS = ("rest", "latitude", "longitude", "both-ways")


def scenarios(folder: Path) -> None:
    """`schuler run` of the four scenarios with all drifts, in this process: study, algorithms, page, folder."""
    from schuler.studies.model import load_study
    from schuler.studies.run import run_study

    for name in SCENARIOS:
        study = load_study(EXAMPLES / f"platform-{name}-channels-1-and-3" / "study.toml")
        run_study(study).write(folder / name)


def commands(folder: Path) -> None:
    """The same as four commands, each a process of its own."""
    import subprocess

    for name in SCENARIOS:
        study = EXAMPLES / f"platform-{name}-channels-1-and-3" / "study.toml"
        command = [sys.executable, "-c", "from schuler.cli import main; main()", "run", str(study)]
        subprocess.run([*command, "--out", str(folder / name)], check=True, capture_output=True)


def map_of(algorithm: str) -> None:
    """60 x 72 cases x 2 h."""
    import math

    import numpy as np

    from schuler.inertial.platform import PlatformCase, error_map

    case = PlatformCase(lat=0.0, drift=(4.8e-8, 0.0, 4.8e-7))
    error_map(case, np.linspace(-1.48, 1.48, 60), np.linspace(0.0, 2.0 * math.pi, 72), algorithm)


def main() -> int:
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenarios(folder)  # compiled and cached
        map_of("free-azimuth")
        tasks = [
            ("four scenarios, all drifts and algorithms, with pages, one process", 10.0, lambda: scenarios(folder)),
            ("four scenarios, the same as four commands", 10.0, lambda: commands(folder)),
        ]
        for algorithm in ("position-independent", "free-azimuth", "strapdown", "as-published"):
            label = f"map of 60 x 72 cases x 2 h, {algorithm}"
            tasks.append((label, 60.0, lambda algorithm=algorithm: map_of(algorithm)))  # type: ignore[misc]
        for label, limit, work in tasks:
            times = []
            for _ in range(3):
                start = time.perf_counter()
                work()
                times.append(time.perf_counter() - start)
            best = sorted(times)[1]
            missed += best > limit
            print(f"{label:70s} {best:8.3f} s   promised {limit:g} s{'   MISSED' if best > limit else ''}")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
