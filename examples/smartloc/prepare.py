"""Drive of the smartLoc data set (TU Chemnitz) -> tables of the contract, with the study beside them.

python examples/smartloc/prepare.py DATA_FOLDER OUT
schuler run OUT/study.toml

Fixes come from the pseudoranges by robust snapshot least squares (schuler.aiding.snapshot), one a second.
"""

import csv
import gzip
import sys
from pathlib import Path

import numpy as np

from schuler.aiding.snapshot import SnapshotFixes
from schuler.ground.earth import WGS84

EVERY_S = 1.0  # echoes last for seconds: more fixes would tell the same again


def lines_of(data: Path, ending: str) -> list[list[str]]:
    found = sorted([*data.glob(f"*{ending}.txt.gz"), *data.glob(f"*{ending}.txt")])
    if not found:
        raise OSError(f"no file *{ending}.txt or .txt.gz")
    opener = gzip.open if found[0].suffix == ".gz" else open
    with opener(found[0], "rt", encoding="utf-8") as file:
        return [line.split() for line in file if line.strip()]


def write(path: Path, head: list[str], rows: list[list[object]]) -> None:
    with open(path, "w", encoding="utf-8", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(head)
        out.writerows(rows)


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        lines, truth = lines_of(data, "Input"), lines_of(data, "GT")
    except (OSError, UnicodeDecodeError) as error:
        print(f"prepare: {data} does not hold the recording: {error}", file=sys.stderr)
        return 1
    ranges = np.array([[float(v) for v in f[1:11]] for f in lines if f[0] == "pseudorange3"])
    odometry = np.array([[float(v) for v in f[1:14]] for f in lines if f[0] == "odom3"])
    reference = np.array([[float(v) for v in f[1:5]] for f in truth if f[0] == "point3"])
    out.mkdir(parents=True, exist_ok=True)

    dt = np.diff(odometry[:, 0], prepend=odometry[0, 0] - float(np.median(np.diff(odometry[:, 0]))))
    write(
        out / "speed.csv",
        ["time[s]", "speed[m/s]", "dheading[rad]", "std_speed[m/s]"],  # a left turn is positive in the file
        [
            [f"{o[0]:.6f}", f"{o[1]:.6f}", f"{-o[6] * d:.9f}", f"{o[7] ** 0.5:.4f}"]
            for o, d in zip(odometry, dt, strict=True)
        ],
    )
    maker = SnapshotFixes()
    fixes = []
    last = -np.inf
    starts = np.flatnonzero(np.diff(ranges[:, 0], prepend=-np.inf) > 1e-6)
    for epoch in np.split(ranges, starts[1:]):
        fix = maker.epoch(epoch[0, 0], epoch[:, 1], epoch[:, 3:6], epoch[:, 7], epoch[:, 9])
        if fix is None or fix.time < last + EVERY_S - 0.05:
            continue
        last = fix.time
        std = np.sqrt(np.diag(fix.cov))
        fixes.append(
            [f"{fix.time:.6f}", f"{np.degrees(fix.lat):.10f}", f"{np.degrees(fix.lon):.10f}", f"{fix.height:.3f}"]
            + [f"{s:.3f}" for s in std]
        )
    write(
        out / "gnss.csv",
        ["time[s]", "lat[deg]", "lon[deg]", "height[m]", "std_north[m]", "std_east[m]", "std_down[m]"],
        fixes,
    )
    places = [WGS84.geodetic_from_ecef(r[1:4]) for r in reference]
    write(
        out / "reference.csv",
        ["time[s]", "lat[deg]", "lon[deg]", "height[m]"],
        [
            [f"{r[0]:.6f}", f"{np.degrees(p[0]):.10f}", f"{np.degrees(p[1]):.10f}", f"{float(p[2]):.3f}"]
            for r, p in zip(reference, places, strict=True)
        ],
    )
    (out / "study.toml").write_text(
        Path(__file__).with_name("study.toml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    print(f"note: {len(fixes)} fixes of {len(starts)} epochs of pseudoranges; the turn rate is made clockwise")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
