"""Quadrotor flights with DOT sensors -> tables of the contract, with the study beside them.

python examples/quad-4imu/prepare.py DATA_FOLDER OUT [FLIGHT [SENSOR]]
schuler run OUT/study.toml

FLIGHT as in FLIGHT_truth.csv (the first where none is typed), SENSOR imu1 to imu4. FLIGHT "all" makes a folder
OUT/FLIGHT-SENSOR of each.
"""

import re
import sys
from pathlib import Path

import numpy as np

from schuler.ground.errors import SchulerError
from schuler.io.formats.quaddot import Flight, flights, read_flight
from schuler.io.writing import write_table

SIGMAS = {"roll": 3.0, "pitch": 3.0, "heading": 11.46, "v_north": 0.5, "v_east": 0.5, "v_down": 0.5}
PLACE = {"lat_deg": 32.76, "lon_deg": 35.02}  # where north and east are counted from: not told, and of no effect


def start_of(flight: Flight) -> str:
    """The [start] section: attitude and velocity of the drone's log."""
    lines = ["[start]", f"time_s = {flight.start['time']:.3f}"]
    lines += [f"{k} = {v}" for k, v in PLACE.items()]
    for name, sigma in SIGMAS.items():
        angle = not name.startswith("v_")
        value = float(np.degrees(flight.start[name])) if angle else flight.start[name]
        unit = "deg" if angle else "mps"
        lines += [f"{name}_{unit} = {value:.3f}", f"std_{name}_{unit} = {sigma:g}"]
    return "\n".join(lines) + "\n"


def prepare(data: Path, out: Path, name: str | None, sensor: str) -> list[str]:
    flight = read_flight(data, name, sensor)
    for table_name, table in flight.tables.items():
        write_table(out / f"{table_name}.csv", table)
    study = Path(__file__).with_name("study.toml").read_text(encoding="utf-8")
    study = re.sub(r'^name = ".*"', f'name = "quad {flight.name} {flight.sensor}"', study, flags=re.MULTILINE)
    study = re.sub(r"^\[start\]\n(?:[^\n\[]+\n)*", lambda _: start_of(flight), study, flags=re.MULTILINE)
    (out / "study.toml").write_text(study, encoding="utf-8")
    return flight.tables["imu"].notes


def main() -> int:
    if not 3 <= len(sys.argv) <= 5:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    name, sensor = (sys.argv[3:] + [None])[0], sys.argv[4] if len(sys.argv) > 4 else "imu1"
    try:
        if name == "all":
            made = []
            for flight, sensors in flights(data).items():
                for each in sensors:
                    notes = prepare(data, out / f"{flight}-{each}", flight, each)
                    made.append(out / f"{flight}-{each}")
            out = made[0] if made else out
        else:
            notes = prepare(data, out, name, sensor)
    except SchulerError as error:
        print(f"prepare: {error}", file=sys.stderr)
        return error.exit_status
    for note in notes:
        print(f"note: {note}")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
