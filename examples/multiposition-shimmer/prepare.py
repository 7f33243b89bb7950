"""The session of calib_ferraris_shimmer -> imu.csv and positions.csv, with the plan beside them.

python examples/multiposition-shimmer/prepare.py DATA/calib_ferraris_shimmer OUT
schuler calibrate OUT/plan.toml
"""

import gzip
import json
import shutil
import sys
from pathlib import Path

import numpy as np

from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.io.tables import write_table

RATE_HZ = 102.4


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    source, out = Path(sys.argv[1]), Path(sys.argv[2])
    with gzip.open(source / "example_ferraris_session.csv.gz") as file:
        rows = np.loadtxt(file, delimiter=",", skiprows=1)  # number, gyros in deg/s, accelerometers in m/s^2
    parts = json.loads((source / "example_ferraris_session_list.json").read_text(encoding="utf-8"))
    columns = {"time": np.arange(1, len(rows) + 1) / RATE_HZ}
    columns |= {f"gyro_{a}": rows[:, 1 + i] * DEG for i, a in enumerate("xyz")}
    columns |= {f"accel_{a}": rows[:, 4 + i] for i, a in enumerate("xyz")}
    write_table(out / "imu.csv", Table("imu", columns, "rates"))
    turns = [(name, part) for name, part in parts.items() if name.endswith("_rot")]
    positions = {
        "position": np.array([name for name, _ in turns]),
        "kind": np.array(["turn"] * len(turns)),
        "start": np.array([part["start"] / RATE_HZ for _, part in turns]),
        "end": np.array([part["end"] / RATE_HZ for _, part in turns]),
        "axis": np.array([name[0] for name, _ in turns]),
        "angle": np.array([-360.0 * DEG] * len(turns)),
    }
    write_table(out / "positions.csv", Table("positions", positions))
    shutil.copy(Path(__file__).with_name("plan.toml"), out)
    print(f"now type:  schuler calibrate {out / 'plan.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
