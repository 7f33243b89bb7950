"""Speed of the planar filter and smoother: rows of odometry a second, beside the same filter in plain numpy.

Status 1 where it is slower than promised here.

python benchmarks/bench_planar.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

TIMES = 150.0  # times plain numpy with difference Jacobians, at least
ROWS_PER_S = 200_000.0  # filter, at least


def best(work, repeats: int = 5) -> float:
    """Shortest of some runs, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> int:
    import planar_reference

    from planar_runs import PLANE, simulate
    from schuler.aiding import planar
    from schuler.aiding import planar_motion as motion
    from schuler.aiding.planar_settings import configuration
    from schuler.aiding.planar_start import find
    from schuler.kernels import planar as k
    from schuler.kernels.planar_smooth import smooth

    run = simulate(1, seconds=3600.0)
    s = run.settings
    speed, _ = motion.speed_stream(run.tables["speed"], s)
    turn, _ = motion.turn_stream(run.tables, s)
    m = motion.measurements_of(run.tables, s, PLANE)
    track = motion.pieces_of(speed, turn, 0.0, m.time)
    begin = find(track, m, s, PLANE)
    c, ends = configuration(s), track.time
    m_to = np.searchsorted(m.time, ends, side="right")
    o_to = np.searchsorted(ends, speed.time)
    count = len(ends)

    def filtered(keep: int):
        x, P = planar._initial(s, begin, len(m.beacons), False)
        n = len(x)
        shapes = ((keep, n), (keep, n, n), (keep, n), (keep, n, n), (keep, n, n))
        nodes = tuple(np.zeros(shape) for shape in shapes)
        k.run(
            x, P, c, np.zeros(k.NS), ends, track.pieces, m_to, np.ones(count, np.bool_), m.kind, m.z,
            np.zeros((len(m.time), k.INNOVATION)), o_to, o_to, o_to, o_to, np.zeros((len(o_to), k.MOVING)),
            np.zeros((len(o_to), k.MOVING, k.MOVING)), nodes, np.zeros((count, n)), np.zeros((count, n)),
            np.zeros(3, np.int64),
        )  # fmt: skip
        return nodes

    filtered(0)
    smooth(*filtered(count))
    alone = best(lambda: filtered(0))
    kept = filtered(count)
    back = best(lambda: smooth(*(a.copy() for a in kept)))
    whole = best(lambda: planar.navigate(run.tables, s, PLANE))
    few = 200
    x, P = planar._initial(s, begin, len(m.beacons), False)
    wide = c.copy()
    wide[k.SOFT] = 1e9
    first = lambda: planar_reference.run(x, P, wide, ends[:few], track.pieces[:few], m_to[:few], m.kind, m.z)  # noqa: E731
    plain = best(first, 3) / few * count
    rows = len(speed.time)
    print(f"{rows} rows of odometry, {len(m.time)} ranges, {len(x)} states, one core:")
    print(f"filter {rows / alone:.3g} rows/s; smoother {back / alone:.2f} times the filter's time")
    print(f"tables to tracks with sigmas, learnt states and innovations: {rows / whole:.3g} rows/s")
    print(f"plain numpy, the same filter: {rows / plain:.3g} rows/s; the kernel {plain / alone:.0f} times as fast")
    return int(rows / alone < ROWS_PER_S or plain / alone < TIMES)


if __name__ == "__main__":
    sys.exit(main())
