"""A simulated turntable recording: the thesis's five positions (corrected), lever arms as it found them.

python examples/turntable-bench/make.py OUT
schuler calibrate OUT/plan.toml
"""

import shutil
import sys
from pathlib import Path

import numpy as np

from schuler.ground.units import ARCMIN, DEG
from schuler.io.tables import write_table
from schuler.truth.turntable import THESIS_PLAN, Turntable, positions_table

LEVERS_MM = ((28.08, -14.2, 9.3), (5.0, 31.0, -22.0), (-11.0, 8.0, -66.51))


def main() -> int:
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    out = Path(sys.argv[1])
    positions = positions_table(THESIS_PLAN, still_s=20.0, spin_s=90.0)
    table = Turntable(
        1e-3 * np.array(LEVERS_MM), bias=[0.02, -0.02, 0.02], noise=1e-3, tilt=2.0 * ARCMIN, latitude=50.45 * DEG,
        gyro_noise=2e-4, gyro_bias=[1e-5, -2e-5, 1e-5],
    )  # fmt: skip
    write_table(out / "imu.csv", table.record(positions, 100.0))
    write_table(out / "positions.csv", positions)
    shutil.copy(Path(__file__).with_name("plan.toml"), out)
    print(f"now type:  schuler calibrate {out / 'plan.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
