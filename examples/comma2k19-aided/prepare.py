"""comma2k19 recording -> tables of the contract, with the study beside them.

python examples/comma2k19-aided/prepare.py DATA_FOLDER OUT
schuler run OUT/study.toml
"""

import re
import sys
from pathlib import Path

from schuler.ground.errors import SchulerError
from schuler.io.convert import convert


def fitting(study: str, tables: set[str]) -> tuple[str, list[str]]:
    """The study without the lines of [input] whose table the recording does not have, and those tables."""
    absent = [name for name in re.findall(r'^(\w+) = "\w+\.csv"', study, re.MULTILINE) if name not in tables]
    for name in absent:
        study = re.sub(rf'^{name} = "{name}\.csv".*\n', "", study, flags=re.MULTILINE)
    return study, absent


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        report = convert(data, out, format="comma2k19")
    except SchulerError as error:
        print(f"prepare: {error}", file=sys.stderr)
        return error.exit_status
    study, left_out = fitting(Path(__file__).with_name("study.toml").read_text(encoding="utf-8"), set(report.rows))
    (out / "study.toml").write_text(study, encoding="utf-8")
    for note in report.notes:
        print(f"note: {note}")
    if left_out:
        print(f"note: the recording has no {', '.join(left_out)}: taken out of study.toml")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
