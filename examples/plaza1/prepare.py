"""Robot with odometry and ranges to beacons (CMU, Plaza) -> tables of the contract, with the study beside them.

python examples/plaza1/prepare.py DATA_FOLDER OUT
schuler run OUT/study.toml

The recording counts x and y in metres and headings counter-clockwise from x: north is y, east is x.
"""

import csv
import gzip
import math
import sys
from pathlib import Path


def rows_of(path: Path) -> list[dict[str, str]]:
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "rt", encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


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
        odometry = rows_of(data / "odometry.csv.gz")
        ranges, truth = rows_of(data / "ranges.csv.gz"), rows_of(data / "truth.csv.gz")
        beacons = rows_of(data / "beacons.csv")
    except (OSError, UnicodeDecodeError) as error:
        print(f"prepare: {data} does not hold the recording: {error}", file=sys.stderr)
        return 1
    out.mkdir(parents=True, exist_ok=True)
    write(
        out / "speed.csv",
        ["time[s]", "ddist[m]", "dheading[rad]"],  # heading clockwise
        [[r["t_s"], r["ddist_m"], f"{-float(r['dheading_rad']):.9g}"] for r in odometry],
    )
    write(
        out / "ranges.csv",
        ["time[s]", "id", "range[m]"],
        [[r["t_s"], f"{float(r['beacon_id']):.0f}", r["range_m"]] for r in ranges],
    )
    write(
        out / "landmarks.csv",
        ["id", "north[m]", "east[m]"],
        [[f"{float(r['beacon_index']):.0f}", r["y_m"], r["x_m"]] for r in beacons],
    )
    write(
        out / "reference.csv",
        ["time[s]", "north[m]", "east[m]", "heading[deg]"],
        [
            [r["t_s"], r["y_m"], r["x_m"], f"{(90.0 - math.degrees(float(r['heading_rad']))) % 360.0:.6f}"]
            for r in truth
        ],
    )
    (out / "study.toml").write_text(
        Path(__file__).with_name("study.toml").read_text(encoding="utf-8"), encoding="utf-8"
    )
    print("note: x is taken as east, y as north; heading increments turned to clockwise")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
