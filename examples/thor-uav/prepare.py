"""Flight of a small aeroplane (UMN / AuraUAS data) -> tables of the contract, with the study beside them.

python examples/thor-uav/prepare.py DATA_FOLDER OUT
schuler run OUT/study.toml

The tables hold the flight and GROUND_S before it (the still IMU on the ground), so that outages are laid in the air.
reference-onboard.csv is the on-board filter's track, for a look: it saw the same sensors and is no reference.
"""

import re
import sys
from pathlib import Path

from schuler.ground.errors import SchulerError
from schuler.ground.tables import Table
from schuler.io.convert import read_recording
from schuler.io.formats import FORMATS
from schuler.io.formats.umnuav import airborne, onboard
from schuler.io.writing import write_table

GROUND_S = 30.0
DELAY_S = 1.0  # the air data begin this much before the fixes, so that no fix lies outside the IMU's rows


def fitting(study: str, tables: set[str]) -> tuple[str, list[str]]:
    """The study without the lines of [input] whose table the recording does not have, and those tables."""
    absent = [name for name in re.findall(r'^(\w+) = "\w+\.csv"', study, re.MULTILINE) if name not in tables]
    for name in absent:
        study = re.sub(rf'^{name} = "{name}\.csv".*\n', "", study, flags=re.MULTILINE)
    return study, absent


def cut(table: Table, first: float, last: float) -> Table:
    return table.where((table.time >= first) & (table.time <= last))


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        tables = read_recording(data, next(f for f in FORMATS if f.name == "umnuav"))
        notes = list(tables["imu"].notes)
        flight = airborne(tables["gnss"])
        if flight is None:
            notes.append("no flight found in the fixes; the whole recording is taken")
        else:
            first, last = flight[0] - GROUND_S, flight[1]
            notes.append(f"flight from {flight[0]:.1f} to {last:.1f} s; the tables begin {GROUND_S:g} s before it")
            for name, table in tables.items():
                tables[name] = cut(table, first - (0.0 if name == "gnss" else DELAY_S), last)
        for name, table in tables.items():
            write_table(out / f"{name}.csv", table)
        try:
            write_table(out / "reference-onboard.csv", onboard(data))
        except SchulerError as error:
            notes.append(f"no on-board track: {error}")
    except SchulerError as error:
        print(f"prepare: {error}", file=sys.stderr)
        return error.exit_status
    study, left_out = fitting(Path(__file__).with_name("study.toml").read_text(encoding="utf-8"), set(tables))
    (out / "study.toml").write_text(study, encoding="utf-8")
    for note in notes:
        print(f"note: {note}")
    if left_out:
        print(f"note: the recording has no {', '.join(left_out)}: taken out of study.toml")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
