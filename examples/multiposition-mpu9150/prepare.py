"""A recording of calib_mpu9150_rotations -> imu.csv, with the plan beside it.

python examples/multiposition-mpu9150/prepare.py DATA/calib_mpu9150_rotations/imu0.log.gz OUT
schuler calibrate OUT/plan.toml
"""

import gzip
import shutil
import sys
from pathlib import Path

import numpy as np

from schuler.ground.tables import Table
from schuler.io.tables import write_table

RATE_HZ = 100.0


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    source, out = Path(sys.argv[1]), Path(sys.argv[2])
    with gzip.open(source) as file:
        rows = np.loadtxt(file)  # ax ay az in m/s^2, gx gy gz in rad/s, no times
    columns = {"time": np.arange(1, len(rows) + 1) / RATE_HZ}
    columns |= {f"gyro_{a}": rows[:, 3 + i] for i, a in enumerate("xyz")}
    columns |= {f"accel_{a}": rows[:, i] for i, a in enumerate("xyz")}
    write_table(out / "imu.csv", Table("imu", columns, "rates"))
    shutil.copy(Path(__file__).with_name("plan.toml"), out)
    print(f"now type:  schuler calibrate {out / 'plan.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
