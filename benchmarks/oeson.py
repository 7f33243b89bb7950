"""The flights and filters of the thesis's chapter 5.3 again: src/schuler/published/sins_filters_kept.py.

    python benchmarks/oeson.py [--runs 200] [--seed 2026] [--only NAME] [--fault-runs 50]
    python benchmarks/oeson.py --page

Some minutes. Figures of cases that are left out stay as they are kept. --page: docs/optics.md from what is kept.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

KEPT_FILE = Path(__file__).resolve().parents[1] / "src" / "schuler" / "published" / "sins_filters_kept.py"
PAGE = KEPT_FILE.parents[3] / "docs" / "optics.md"
HEAD = '''"""Kept figures of `sins_filters`; written by benchmarks/oeson.py."""

from __future__ import annotations

from typing import NamedTuple


class Kept(NamedTuple):
    """rms of position m, velocity m/s, tilt and yaw arcmin; position at the end m; smallest and largest error / sigma
    of the seven states; error / sigma at the end."""

    runs: int
    figures: tuple[float, float, float, float]
    end_m: float
    ratio_low: float
    ratio_high: float
    end_ratio: float


KEPT: dict[str, Kept] = {
'''


def line(s: dict[str, Any]) -> str:
    four = ", ".join(f"{s[k]:.4g}" for k in ("pos_m", "vel_mps", "tilt_arcmin", "yaw_arcmin"))
    rest = ", ".join(f"{s[k]:.4g}" for k in ("end_m", "ratio_low", "ratio_high", "end_ratio"))
    return f"Kept({s['runs']}, ({four}), {rest})"


def write(found: dict[str, str]) -> None:
    """The module with these lines, in the order of the cases."""
    body = "".join(f'    "{name}": {text},\n' for name, text in found.items())
    KEPT_FILE.write_text(HEAD + body + "}\n", encoding="utf-8")


def main() -> int:
    from schuler.published.sins_filters_kept import KEPT
    from schuler.studies.oeson import CASES, FAULTS, PATHS
    from schuler.studies.oeson_runs import ensemble

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--fault-runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--only", default="")
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    if given.page:
        page()
        return 0
    todo = {name: (case, given.runs) for name, case in CASES.items()}
    todo |= {name: (case, given.fault_runs) for name, case in FAULTS.items() if case not in CASES.values()}
    found = {}
    for name, (case, runs) in todo.items():
        for path in PATHS:
            key = f"{name} {path}"
            old = KEPT.get(key)
            if given.only not in name and old is not None:
                found[key] = f"Kept{tuple(old)!r}"
                continue
            s = ensemble(case, path, runs, given.seed)
            found[key] = line(s)
            print(f"{key:40s} {found[key]}", flush=True)
    write(found)
    print("now: python benchmarks/oeson.py --page")
    return 0


def page() -> None:
    """The tables of docs/optics.md made anew."""
    from schuler.published.sins_filters import table_lines

    text = PAGE.read_text(encoding="utf-8")
    for name, faults in (("flights", False), ("faults", True)):
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        start = text.index(begin) + len(begin)
        text = text[:start] + "\n".join(table_lines(faults)) + "\n" + text[text.index(end) :]
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
