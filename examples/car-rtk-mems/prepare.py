"""Drive with a consumer IMU and RTK fixes (GNSS_IMU logger) -> tables of the contract, with the study beside them.

python examples/car-rtk-mems/prepare.py DATA_FOLDER OUT
schuler run OUT/study.toml

The IMU's own log with its time tag is taken where the folder has it (its times are better than those of a converted
table: a straight line through all arrivals), else the imu table; the gnss table, else the .pos file.
"""

import sys
from pathlib import Path

import numpy as np

from schuler.ground.errors import InputError, SchulerError
from schuler.ground.tables import Table
from schuler.io.formats import rtklib
from schuler.io.formats.common import sheet_in
from schuler.io.tables import read_table
from schuler.io.writing import write_table

LOG_S = 0.25  # the rows of this logger arrive so much later than they were measured; the filter finds the rest
TABLE_S = 0.18  # the same for a ready imu table, whose clock drifts a little
DOPPLER_SIGMA = 1.5  # RTKLIB reports velocities this much too sure


def moved(table: Table, seconds: float) -> Table:
    """The table on a clock that starts `seconds` later."""
    columns = {**table.columns, "time": table.time - seconds}
    return Table(table.name, columns, table.kind, table.source, table.notes)


def table_file(data: Path, stem: str) -> Path | None:
    return next((p for p in (data / f"{stem}.csv", data / f"{stem}.csv.gz") if p.is_file()), None)


def read(data: Path) -> tuple[Table, Table, list[str]]:
    """imu and gnss on one clock, and sentences on what was taken."""
    if not data.is_dir():
        raise InputError(f"{data} is no folder")
    solutions = sorted(data.glob("*.pos")) + sorted(data.glob("*.pos.gz"))
    logs = [p for p in sorted(data.glob("*.csv*")) if rtklib.tag_of(p) is not None]
    imu_file, gnss_file = table_file(data, "imu"), table_file(data, "gnss")
    if len(solutions) == 1 and len(logs) == 1:
        imu, gnss = rtklib.imu_log(logs[0]), rtklib.solution(solutions[0])
        start = float(np.floor(gnss.time[0]))
        sheet = None if gnss_file is None else sheet_in(data, "gnss")
        if sheet is not None and len(sheet) == len(gnss) and "t_s" in sheet.headings:
            start = float(gnss.time[0] - sheet.columns[sheet.headings.index("t_s")][0])
        notes = [
            f"time counts from GPS second {start:.3f}",
            f"imu: stamps {LOG_S:g} s earlier, what the transfer takes",
        ]
        return moved(imu, start + LOG_S), moved(gnss, start), notes
    if imu_file is None:
        raise InputError(f"{data}: neither an IMU log with its .tag and one .pos file, nor imu.csv and gnss.csv in it")
    if gnss_file is None:
        raise InputError(f"{data}: imu.csv has a clock of its own, and there is no gnss.csv on it")
    imu = moved(read_table(imu_file, "imu"), TABLE_S)
    return (
        imu,
        read_table(gnss_file, "gnss"),
        [f"imu: the table's stamps {TABLE_S:g} s earlier, what the transfer takes"],
    )


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        imu, gnss, notes = read(data)
        names = [n for n in gnss.columns if n.startswith("std_v_")]
        for name in names:
            gnss.columns[name] = gnss[name] * DOPPLER_SIGMA
        if names:
            notes.append(f"gnss: sigmas of the velocity times {DOPPLER_SIGMA:g}")
        for table in (imu, gnss):
            write_table(out / f"{table.name}.csv", table)
            notes += [n for n in table.notes if n not in notes]
    except SchulerError as error:
        print(f"prepare: {error}", file=sys.stderr)
        return error.exit_status
    study = Path(__file__).with_name("study.toml").read_text(encoding="utf-8")
    (out / "study.toml").write_text(study, encoding="utf-8")
    for note in notes:
        print(f"note: {note}")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
