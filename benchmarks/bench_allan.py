"""Overlapping Allan deviation of ten million samples, and a whole turntable calibration.

python benchmarks/bench_allan.py            prints the two targets and, where allantools is installed, the ratio
"""

from __future__ import annotations

import time

import numpy as np


def best(work, repeats: int = 3) -> float:
    """Shortest of some runs, s."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def allan(n: int = 10_000_000, taus: int = 50) -> None:
    from schuler.calibration.allan import deviation

    y = np.random.default_rng(1).standard_normal(n)
    m = np.unique(np.round(np.geomspace(1, n / 10, taus + 12)).astype(int))
    tau = (m[np.linspace(0, m.size - 1, taus).round().astype(int)] / 100.0).tolist()
    deviation(y[:10_000], 100.0, tau=[1.0])
    ours = best(lambda: deviation(y, 100.0, tau=tau))
    print(f"overlapping Allan deviation, {n:.0e} samples, {taus} averaging times: {ours:.2f} s (target 1 s)")
    try:
        import allantools
    except ImportError:
        print("allantools is not installed: no ratio")
        return
    theirs = best(lambda: allantools.oadev(y, rate=100.0, data_type="freq", taus=tau), 1)
    print(f"allantools {allantools.__version__}, the same: {theirs:.2f} s, {theirs / ours:.1f} times ours (target 3)")


def turntable() -> None:
    from schuler.calibration.turntable import calibrate
    from schuler.truth.turntable import Turntable, positions_table

    plan = [
        (0.0, 0.0),
        (0.0, 45.0),
        (45.0, 45.0),
        (0.0, -45.0),
        (-45.0, -45.0),
        (45.0, -45.0),
        (-45.0, 45.0),
        (90.0, 45.0),
    ]
    positions = positions_table(plan, spin_s=150.0)  # each way: 5 min of spin a position
    imu = Turntable(np.full((3, 3), 0.03), noise=2e-3, gyro_noise=1e-3).record(positions, 3000.0)
    print(f"turntable recording: {len(plan)} positions, {len(imu):.2e} rows at 3 kHz")
    calibrate(imu, positions)
    print(f"full calibration with its checks: {best(lambda: calibrate(imu, positions), 2):.2f} s (target 5 s)")


if __name__ == "__main__":
    allan()
    turntable()
