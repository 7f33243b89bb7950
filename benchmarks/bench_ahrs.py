"""The attitude filter on the BROAD trials, beside vqf where that is installed: accuracy and speed in one run.

python benchmarks/bench_ahrs.py [DATA]      DATA: folder of trials (.npz), by default ../shared/data/ahrs_broad

Rms over the scored samples in degrees, mean over the trials; without the magnetometer the heading of the first scored
sample is taken out. One core, medians of five, every row with its attitude (ours with its covariance too).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data" / "ahrs_broad"


def rate_of(work: Callable[[], object], rows: int, repeats: int = 5) -> float:
    """Median rows a second."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return rows / float(np.median(times))


def ours(imu: Any, mag: bool) -> tuple[Array, float]:
    """Quaternions and rows a second, default settings."""
    from schuler.aiding.ahrs import attitude, rows_of

    t, w, f, m = rows_of(imu)
    rows = (t, w, f, m) if mag else (t, w, f)
    found = attitude(*rows)
    q = np.full((len(t), 4), np.nan)
    q[np.searchsorted(t, found.time - 1e-9)] = found.q
    return q, rate_of(lambda: attitude(*rows), len(t))


def theirs(imu: Any, mag: bool) -> tuple[Array, float]:
    """The same by vqf with its defaults; its frame is ENU with z up, so axes are turned before and after."""
    from vqf import VQF

    from schuler.aiding.ahrs import rows_of
    from schuler.ground.frames import dcm_from_quat, quat_from_dcm
    from schuler.io.formats.broad import FLIP, NED_ENU

    t, *rows = rows_of(imu)
    step = float(np.median(np.diff(t)))
    flat = [np.ascontiguousarray(a @ FLIP) for a in (rows if mag else rows[:2])]
    q = VQF(step).updateBatch(*flat)["quat9D" if mag else "quat6D"]
    turned = quat_from_dcm(NED_ENU @ dcm_from_quat(q) @ FLIP)
    return turned, rate_of(lambda: VQF(step).updateBatch(*flat), len(t))


def judged(data: Path, method: Callable[[Any, bool], tuple[Array, float]], mag: bool) -> tuple[Array, float, list[str]]:
    """Tilt, heading, total rms (trials, 3) deg, median rate, names."""
    from schuler.io.formats import broad
    from schuler.judging.attitude import DEG, attitude_errors

    rows, rates, names = [], [], []
    for path in sorted(data.glob("*.npz")):
        tables = broad.convert(path)
        q, rate = method(tables["imu"], mag)
        good = np.isfinite(q).all(axis=1)
        cov = np.tile(np.eye(3), (int(good.sum()), 1, 1))
        e = attitude_errors(tables["imu"].time[good], q[good], cov, tables["reference"], relative=not mag)
        assert e is not None
        rows.append([float(np.sqrt(np.mean(v**2))) / DEG for v in (e.tilt, e.heading, e.total)])
        rates.append(rate)
        names.append(path.stem)
    return np.array(rows), float(np.median(rates)), names


def main() -> int:
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA
    if not any(data.glob("*.npz")):
        print(f"{data} holds no trial (.npz)", file=sys.stderr)
        return 1
    methods = {"schuler": ours}
    try:
        from importlib.metadata import version

        methods[f"vqf {version('vqf')}"] = theirs
    except ImportError:
        print("vqf is not installed: no comparison")
    print(f"{'':14} {'axes':>4} {'tilt':>6} {'heading':>8} {'total':>6}   {'updates/s':>10}   total of each trial")
    for mag in (True, False):
        for name, method in methods.items():
            found, rate, _ = judged(data, method, mag)
            tilt, heading, total = found.mean(axis=0)
            each = " ".join(f"{v:.2f}" for v in found[:, 2])
            print(
                f"{name:14} {9 if mag else 6:>4} {tilt:6.2f} {heading:8.2f} {total:6.2f}   {rate / 1e6:8.2f} M   {each}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
