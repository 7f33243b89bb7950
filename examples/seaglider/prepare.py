"""Seaglider recording -> tables of the contract, with the study beside them.

    python examples/seaglider/prepare.py DATA_FOLDER OUT
    schuler run OUT/study.toml
"""

import shutil
import sys
from pathlib import Path

from schuler.ground.errors import SchulerError
from schuler.io.convert import convert


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    data, out = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        report = convert(data, out)
    except SchulerError as error:
        print(f"prepare: {error}", file=sys.stderr)
        return error.exit_status
    shutil.copy(Path(__file__).with_name("study.toml"), out)
    for note in report.notes:
        print(f"note: {note}")
    print(f"now type:  schuler run {out / 'study.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
