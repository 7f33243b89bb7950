"""Fills in what the pages print: the README's figures from docs/evidence.json, outputs of commands by running them.

    python docs/figures.py            writes
    python docs/figures.py --check    status 1 where a page would change

A page's blocks are played in their order in an empty folder: ```toml with "# file: NAME" is written, with "# add to:
NAME" appended; ```python runs, all in one namespace; ```sh commands run. What stands between <!-- output: COMMAND -->
and <!-- end --> is what the command printed. DATA_FOLDER in a command is a folder of recordings; commands that need one
are passed over where it is absent.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGES = (
    "README.md",
    "docs/tutorial-auv.md",
    "docs/tutorial-online.md",
    "docs/how-to-own-data.md",
    "docs/how-to-compare.md",
)
EVIDENCE = ROOT / "docs" / "evidence.json"
DATA = ROOT.parent / "shared" / "data" / "glider_seaglider_sg171"
NOT_PLAYED = ("make", "pip")

_BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^ *```$", re.M | re.S)
_OUTPUT = re.compile(r"(<!-- output: (.+?) -->\n```text\n)(.*?)(```\n<!-- end -->)", re.S)
_TABLE = re.compile(r"(<!-- figures[^>]*-->\n)(.*?)(<!-- end of figures -->)", re.S)


@dataclass
class Played:
    """What happened when a page was played: command -> what it printed; commands passed over."""

    printed: dict[str, str] = field(default_factory=dict)
    passed_over: list[str] = field(default_factory=list)


def blocks(text: str) -> list[tuple[str, str]]:
    """(language, content) of every fenced block, without its indentation."""
    found = _BLOCK.findall(text)
    return [(language, re.sub(rf"^{indent}", "", body, flags=re.M)) for indent, language, body in found]


def commands(body: str) -> list[str]:
    """The commands of a sh block, comments off, continued lines joined."""
    lines = body.replace("\\\n", " ").splitlines()
    found = [re.sub(r"\s+#.*$", "", line).strip() for line in lines]
    return [re.sub(r"\s+", " ", line) for line in found if line and not line.startswith("#")]


def play(page: Path, folder: Path, data: Path | None = DATA) -> Played:
    """Runs everything that a page prints in `folder`; AssertionError where something does not work."""
    played = Played()
    (folder / "examples").symlink_to(ROOT / "examples")
    namespace: dict[str, Any] = {"__name__": "page"}
    data = data if data is not None and data.is_dir() else None
    absent: set[str] = set()  # words that stand for what could not be made
    before = Path.cwd()
    os.chdir(folder)
    try:
        for number, (language, body) in enumerate(blocks(page.read_text(encoding="utf-8")), 1):
            if language == "toml":
                file = re.match(r"# (file|add to): (\S+)\n", body)
                if file is not None:
                    path = folder / file[2]
                    path.parent.mkdir(parents=True, exist_ok=True)
                    old = path.read_text(encoding="utf-8") if file[1] == "add to" else ""
                    path.write_text(old + "\n" + body, encoding="utf-8")
            elif language == "python":
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(compile(body, f"{page.name}, block {number}", "exec"), namespace)
            elif language == "sh":
                for command in commands(body):
                    _command(command, folder, data, played, absent, page)
    finally:
        os.chdir(before)
    return played


def _command(command: str, folder: Path, data: Path | None, played: Played, absent: set[str], page: Path) -> None:
    if command.startswith(NOT_PLAYED):
        return
    words = command.split()
    if (data is None and "DATA_FOLDER" in words) or any(w.split("/")[0] in absent for w in words):
        played.passed_over.append(command)
        absent.add(words[-1])
        return
    real = command.replace("DATA_FOLDER", str(data))
    place = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"}
    done = subprocess.run(real, shell=True, cwd=folder, env=place, capture_output=True, text=True)
    assert done.returncode == 0, f"{page.name}: {command}: status {done.returncode}\n{done.stdout}{done.stderr}"
    assert "Traceback" not in done.stderr, done.stderr
    played.printed[command] = done.stdout


# ---- the table of figures -------------------------------------------------------------------------------------------


def figures_table(evidence: dict[str, Any]) -> str:
    """The README's table of what benchmarks/evidence.py measured; the NIS of a part in one row."""
    lines = ["| | measured | wanted | holds |", "|---|---|---|---|"]
    claims = evidence["claims"]
    for part in dict.fromkeys(c["part"] for c in claims):
        mine = [c for c in claims if c["part"] == part]
        if part.startswith(_BRIEF):  # one row each; all of them are in docs/evidence.md
            first, holds = mine[0], all(c["holds"] is not False for c in mine)
            value = f"{_number(first['value'])} {first['unit']}".strip()
            lines.append(f"| {part}: {first['what']} | {value} | {first['wanted']} | {_holds(holds)} |")
            continue
        lines.append(f"| **{part}** | | | |")
        folded = {name: [c for c in mine if belongs(c)] for name, belongs in _FOLDED.items()}
        for claim in mine:
            if any(claim in group for group in folded.values()):
                continue
            spread = re.match(r"\+- (\S+) \(standard error\)|standard error (\S+);", claim["note"])
            plus = f" +- {spread[1] or spread[2]}" if spread else ""
            value = f"{_number(claim['value'])}{plus} {claim['unit']}".strip()
            lines.append(f"| {claim['what']} | {value} | {claim['wanted']} | {_holds(claim['holds'])} |")
        lines += [_folded_row(name, group) for name, group in folded.items() if group]
    runs = evidence["runs"]
    made = (
        f"{runs} runs for each simulated row of the AUV and the paper, {min(runs, 200)} for the other simulated ones, "
    )
    made += f"seed {evidence['seed']}; {evidence['machine']}."
    return "\n".join([*lines, "", made]) + "\n"


def _is_nis(claim: dict[str, Any]) -> bool:
    return bool(claim["what"].startswith("NIS of "))


def _is_nees(claim: dict[str, Any]) -> bool:
    """Of kind aided there are many; each is in docs/evidence.md."""
    return claim["part"].startswith("aided: ") and "NEES" in claim["what"] and not _is_nis(claim)


_BRIEF = ("OESON", "listing")
_FOLDED = {"mean NEES": _is_nees, "mean NIS of each kind": _is_nis}


def _folded_row(name: str, claims: list[dict[str, Any]]) -> str:
    """One row of many claims: their values, and whether every one holds."""
    holds = all(claim["holds"] is not False for claim in claims)
    if name == "mean NEES":
        values = [c["value"] for c in claims]
        span = f"{min(values):.2f} to {max(values):.2f}"
        return f"| mean NEES, {len(values)} figures | {span} | each inside its bounds | {_holds(holds)} |"
    told = ", ".join(f"{c['what'].removeprefix('NIS of ').split(',')[0]} {c['value']:.2f}" for c in claims)
    return f"| {name} | {told} | inside 99 % bounds | {_holds(holds)} |"


def _holds(holds: bool | None) -> str:
    return "" if holds is None else "yes" if holds else "**no**"


def _number(value: float) -> str:
    if abs(value) >= 1000.0:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.3g}" if abs(value) < 10.0 else f"{value:.1f}".removesuffix(".0")


def filled(text: str, played: Played | None, evidence: Any) -> str:
    """A page with its outputs and figures put in."""
    if played is not None:
        printed = played.printed
        text = _OUTPUT.sub(lambda m: m[1] + printed.get(m[2], m[3]) + m[4], text)
    if evidence is not None:
        text = _TABLE.sub(lambda m: m[1] + figures_table(evidence) + m[3], text)
    return text


def alike(a: str, b: str, relative: float = 0.02) -> bool:
    """Whether two outputs say the same: the same words, numbers within 2 % or one and a half of their last digit."""
    number = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
    if number.sub("#", a).split() != number.sub("#", b).split():
        return False
    for x, y in zip(number.findall(a), number.findall(b), strict=True):
        digits = max((len(n.partition(".")[2]) for n in (x, y)), default=0)
        if abs(float(x) - float(y)) > relative * max(abs(float(x)), abs(float(y))) + 1.5 * 10.0**-digits:
            return False
    return True


def main() -> int:
    check = "--check" in sys.argv[1:]
    evidence = json.loads(EVIDENCE.read_text(encoding="utf-8")) if EVIDENCE.is_file() else None
    stale = []
    for name in PAGES:
        page = ROOT / name
        text = page.read_text(encoding="utf-8")
        played = None
        if _OUTPUT.search(text):
            folder = Path(tempfile.mkdtemp())
            try:
                played = play(page, folder)
            finally:
                shutil.rmtree(folder)
        new = filled(text, played, evidence)
        if new != text:
            stale.append(name)
            if not check:
                page.write_text(new, encoding="utf-8")
    print("\n".join(f"{'stale' if check else 'written'}: {name}" for name in stale) or "every page is as it should be")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
