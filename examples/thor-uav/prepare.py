"""Flight of a small aeroplane (UMN / AuraUAS data) -> tables of the contract, with the study beside them.

python examples/thor-uav/prepare.py DATA_FOLDER OUT
schuler run OUT/study.toml

The tables hold the flight and GROUND_S before it, so that outages are laid in the air. The start is the take-off run,
where the course is the heading; level is that of the accelerometers just before. Airspeed and height are means of
EVERY_S: their errors last about as long, and 50 rows a second would count one error 50 times.
reference-onboard.csv is the on-board filter's track, for a look: it saw the same sensors and is no reference.
"""

import re
import sys
from pathlib import Path

import numpy as np

from schuler.ground.errors import SchulerError
from schuler.ground.tables import Table
from schuler.io.convert import read_recording
from schuler.io.formats import FORMATS
from schuler.io.formats.umnuav import airborne, onboard
from schuler.io.writing import write_table

GROUND_S = 30.0
EVERY_S = 1.0
SLOW = 8.0  # m/s: below this a pitot tube says nothing
LEVEL_S = (6.0, 3.0)  # before the start
SIGMA_DEG = {"roll": 3.0, "pitch": 3.0, "heading": 8.6}
AHEAD_S = 1.0  # the other tables begin this much before the fixes, so that no fix lies outside the IMU's rows


def fitting(study: str, tables: set[str]) -> tuple[str, list[str]]:
    """The study without the lines of [input] whose table the recording does not have, and those tables."""
    absent = [name for name in re.findall(r'^(\w+) = "\w+\.csv"', study, re.MULTILINE) if name not in tables]
    for name in absent:
        study = re.sub(rf'^{name} = "{name}\.csv".*\n', "", study, flags=re.MULTILINE)
    return study, absent


def cut(table: Table, first: float, last: float) -> Table:
    return table.where((table.time >= first) & (table.time <= last))


def means(table: Table, column: str) -> Table:
    """One row for each EVERY_S: the mean, at the mean time."""
    cell = np.floor((table.time - table.time[0]) / EVERY_S).astype(int)
    count = np.bincount(cell)
    keep = count > 0
    columns = {name: np.bincount(cell, weights=table[name])[keep] / count[keep] for name in ("time", column)}
    return Table(table.name, columns, table.kind, table.source, table.notes)


def start_of(imu: Table, gnss: Table, first: float) -> str:
    """The [start] section at the first fix that is faster than anybody walks."""
    k = int(np.searchsorted(gnss.time, first))
    before = (imu.time > first - LEVEL_S[0]) & (imu.time < first - LEVEL_S[1])
    f = np.median(imu.stack("accel_x", "accel_y", "accel_z")[before], axis=0)
    angles = {
        "roll": np.arctan2(-f[1], -f[2]),
        "pitch": np.arctan2(f[0], np.hypot(f[1], f[2])),
        "heading": np.mod(np.arctan2(gnss["v_east"][k], gnss["v_north"][k]), 2.0 * np.pi),
    }
    lines = ["[start]                      # the take-off run", f"time_s = {first:.3f}"]
    for name, angle in angles.items():
        lines += [f"{name}_deg = {np.degrees(angle):.2f}", f"std_{name}_deg = {SIGMA_DEG[name]:g}"]
    return "\n".join(lines) + "\n"


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
                tables[name] = cut(table, first - (0.0 if name == "gnss" else AHEAD_S), last)
        if "speed" in tables:
            tables["speed"] = tables["speed"].where(tables["speed"]["speed"] > SLOW)
        for name in {"speed", "height"} & tables.keys():
            tables[name] = means(tables[name], name)
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
    start = "" if flight is None else start_of(tables["imu"], tables["gnss"], flight[0])
    study = re.sub(r"^\[start\].*\n", lambda _: start, study, flags=re.MULTILINE)
    (out / "study.toml").write_text(study, encoding="utf-8")
    for note in notes:
        print(f"note: {note}")
    if left_out:
        print(f"note: the recording has no {', '.join(left_out)}: taken out of study.toml")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
