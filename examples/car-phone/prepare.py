"""Drive with a telephone (accelerometer, gyro, GNSS) -> tables of the contract, with the study beside them.

python examples/car-phone/prepare.py DATA_FOLDER OUT
schuler run OUT/study.toml

How the telephone stands in its holder is found to the nearest right angle, from gravity and from what its
accelerometers feel when the car changes its speed; the rest is the filter's.
"""

import re
import sys
from pathlib import Path

from schuler.ground.errors import SchulerError
from schuler.io.convert import read_recording
from schuler.io.formats import FORMATS
from schuler.io.formats.phone import mounting_of
from schuler.io.writing import write_table


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        tables = read_recording(data, next(f for f in FORMATS if f.name == "phone"))
        notes = list(tables["imu"].notes)
        angles, fit = mounting_of(tables["imu"], tables["gnss"])
        roll, pitch, yaw = angles
        notes.append(f"mounting: roll {roll:g}, pitch {pitch:g}, yaw {yaw:g} deg (correlation {fit:.2f})")
        if fit < 0.3:
            notes.append("mounting: no direction stands out as forward; look at imu_to_body_rpy_deg in study.toml")
        for name, table in tables.items():
            write_table(out / f"{name}.csv", table)
    except SchulerError as error:
        print(f"prepare: {error}", file=sys.stderr)
        return error.exit_status
    study = Path(__file__).with_name("study.toml").read_text(encoding="utf-8")
    line = f"imu_to_body_rpy_deg = [{angles[0]:g}, {angles[1]:g}, {angles[2]:g}]"
    study = re.sub(r"^imu_to_body_rpy_deg = \[.*?\]", line, study, flags=re.MULTILINE)
    (out / "study.toml").write_text(study, encoding="utf-8")
    for note in notes:
        print(f"note: {note}")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
