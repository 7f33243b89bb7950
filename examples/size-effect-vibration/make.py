"""Writes calibration.json, rate-only.json and the two studies of this folder: a vibrating vehicle with and without."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from schuler.calibration.corrections import Calibration, Parameter

HERE = Path(__file__).parent
LEVERS = np.array([[40.0, 20.0, -30.0], [-20.0, 50.0, 20.0], [30.0, -25.0, 35.0]])  # mm
STUDY = """\
# A vehicle that stands and shakes at 40 Hz for a minute; its accelerometers sit 20 to 50 mm from the origin.
[study]
name = "{name}"
kind = "strapdown"

[start]
lat_deg = 50.27
heading_deg = 30.0

[trajectory]
preset = "oscillation"
duration_s = 60.0
rate_hz = 2000
speed_mps = 0.0
swing_deg = [0.1146, 0.1146, 0.1146]   # 2 mrad
swing_hz = 40.0

[imu]
accel_x_lever_mm = [40.0, 20.0, -30.0]
accel_y_lever_mm = [-20.0, 50.0, 20.0]
accel_z_lever_mm = [30.0, -25.0, 35.0]
{calibration}
[filter]
vertical = "held"
"""


def main() -> None:
    parameters = [
        Parameter(f"accel_{i}_lever_{j}_mm", 1e-3 * LEVERS[a, b], 1e-4, True)
        for a, i in enumerate("xyz")
        for b, j in enumerate("xyz")
    ]
    known = Calibration("levers of the example", parameters, 1e-8 * np.eye(9), 1e-5, 1e-5, 1.0)
    told = known.as_dict({"version": "example", "seed": None, "study_sha256": None})
    told["covariance"] = np.asarray(told["covariance"]).tolist()
    (HERE / "calibration.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    for name, line in (("without", ""), ("with", 'calibration = "calibration.json"\n')):
        text = STUDY.format(name=f"vibrating vehicle, {name} compensation", calibration=line)
        (HERE / f"{name}.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
