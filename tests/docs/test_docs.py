"""The pages say what the program does: snippets and commands run, outputs are those printed, links and names exist."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import schuler

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md")])
PLAYED_ELSEWHERE = {f"{name}.md" for p in ("platform", "strapdown") for name in (p, f"tutorial-{p}")}
PLAYED_ELSEWHERE |= {"calibration.md", "tutorial-turntable.md"}
FENCE = re.compile(r"^ *```.*?^ *```$", re.M | re.S)


def _figures():
    spec = importlib.util.spec_from_file_location("docs_figures", DOCS / "figures.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["docs_figures"] = module
    spec.loader.exec_module(module)
    return module


figures = _figures()


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def page_id(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


# ---- what the pages run ----


def runs(page: Path) -> bool:
    body = figures.blocks(text_of(page))
    return page.name not in PLAYED_ELSEWHERE and any(
        language == "python" or any(not c.startswith(figures.NOT_PLAYED) for c in figures.commands(code))
        for language, code in body
        if language in ("python", "sh")
    )


def played_pages() -> list:
    slow = {"README.md", "tutorial-auv.md", "how-to-own-data.md", "tutorial-online.md", "tutorial-optics.md"}
    slow |= {"tutorial-online-aided.md"}
    return [
        pytest.param(p, id=page_id(p), marks=[pytest.mark.slow] if p.name in slow else []) for p in PAGES if runs(p)
    ]


@pytest.mark.parametrize("page", played_pages())
def test_everything_on_the_page_runs_and_prints_what_it_says(page, tmp_path):
    played = figures.play(page, tmp_path)
    for command, said in outputs(page):
        if command in played.passed_over:
            continue
        assert command in played.printed, f"{page.name} shows the output of {command!r} and never runs it"
        assert figures.alike(said, played.printed[command]), (
            f"{page.name}: {command} prints otherwise now; renew it: python docs/figures.py\n{played.printed[command]}"
        )


def outputs(page: Path) -> list[tuple[str, str]]:
    return [(m[2], m[3]) for m in figures._OUTPUT.finditer(text_of(page))]


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_no_output_is_left_empty(page):
    assert all(said.strip() for _, said in outputs(page)), "fill it in: python docs/figures.py"


def test_a_page_that_fails_is_found(tmp_path):
    page = tmp_path / "page.md"
    for body in ("```python\nassert 1 == 2\n```", "```sh\nschuler run nothing.toml\n```"):
        page.write_text(body, encoding="utf-8")
        folder = tmp_path / str(len(body))
        folder.mkdir()
        with pytest.raises(AssertionError):
            figures.play(page, folder)


def test_outputs_are_compared_by_words_and_numbers():
    assert figures.alike("error 68.1 m (5 of 5)", "error 68.2  m (5 of 5)")
    assert not figures.alike("error 68.1 m", "error 74.1 m")
    assert not figures.alike("error 68.1 m", "miss 68.1 m")
    assert not figures.alike("5 of 5", "3 of 5") and not figures.alike("5 of 5", "5 of 5 of 6")


# ---- links ----


def anchors(page: Path) -> set[str]:
    """Anchors of the headings, as the usual viewers make them."""
    headings = re.findall(r"^#+ +(.+)$", FENCE.sub("", text_of(page)), re.M)
    return {re.sub(r"[^\w\- ]", "", h.lower().replace("`", "")).strip().replace(" ", "-") for h in headings}


def links(page: Path) -> list[str]:
    return re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", text_of(page)))


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_link_leads_somewhere(page):
    for link in links(page):
        assert not re.match(r"[a-z]+:", link), f"{page.name}: {link} leads outside the repository"
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{page.name}: {link} does not exist"
        assert ROOT in target.parents, f"{page.name}: {link} leads outside the repository"
        if anchor:
            assert anchor in anchors(target), f"{page.name}: {link}: no such heading"


def test_every_page_can_be_reached_from_the_index():
    reached = {(DOCS / link.partition("#")[0]).resolve() for link in links(DOCS / "index.md")}
    assert {p for p in DOCS.glob("*.md") if p.name not in ("index.md", "evidence.md")} <= reached
    assert (DOCS / "index.md").resolve() in {(ROOT / link).resolve() for link in links(ROOT / "README.md")}


# ---- commands, keys and names that the pages mention ----


@pytest.fixture(scope="module")
def program() -> dict[str, set[str]]:
    """Command -> its options, as `--help` tells them."""

    def told(*arguments: str) -> str:
        code = "from schuler.cli import main; main()"
        done = subprocess.run([sys.executable, "-c", code, *arguments, "--help"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    names = re.findall(r"^  ([a-z][a-z-]*) ", told().partition("Commands:")[2], re.M)
    assert {"demo", "run", "check", "convert"} <= set(names)
    found = {name: set(re.findall(r"--[a-z][a-z-]*", told(name))) for name in names}
    found[""] = set(re.findall(r"--[a-z][a-z-]*", told()))
    return found


def mentioned(page: Path) -> list[str]:
    """`schuler ...` in sh blocks and in inline code."""
    text = text_of(page)
    typed = [c for language, body in figures.blocks(text) if language == "sh" for c in figures.commands(body)]
    typed += [c for body in re.findall(r"^```\n(.*?)^```$", text, re.M | re.S) for c in body.splitlines()]
    typed += re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
    return [c for c in typed if c.startswith("schuler ")]


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_command_mentioned_exists_with_its_options(page, program):
    for command in mentioned(page):
        words = [w.rstrip(",;") for w in command.split("#")[0].split()[1:]]
        name = "" if words[0].startswith("-") or words[0] == "COMMAND" else words[0]
        assert name in program, f"{page.name}: {command}: there is no command {name!r}"
        for option in (w for w in words if w.startswith("--")):
            assert option in program[name] | program[""], f"{page.name}: {command}: no option {option}"


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_make_target_mentioned_exists(page):
    text = text_of(page)
    targets = set(re.findall(r"^([a-z]+):", text_of(ROOT / "Makefile"), re.M))
    typed = re.findall(r"^make (?:[A-Z]+=\S+ )?([a-z]+)", text, re.M) + re.findall(r"`make ([a-z]+)`", text)
    assert set(typed) <= targets, set(typed) - targets


def test_the_commands_of_the_changelog_are_those_of_the_program(program):
    line = re.search(r"- Commands (.+?)\.\n", text_of(ROOT / "CHANGELOG.md"))
    assert set(re.findall(r"`([a-z-]+)`", line[1])) == set(program) - {""}


def test_kinds_called_working_work_and_the_others_do_not():
    from schuler.studies.run import built_kinds

    rows = re.findall(r"^\|(.*kinds? `.*)\| (works|not yet) \|$", text_of(ROOT / "README.md"), re.M)
    said = {kind: state for row, state in rows for kind in re.findall(r'`"([a-z]+)"`', row)}
    assert {k for k, state in said.items() if state == "works"} == set(built_kinds())
    assert len(said) == 6


def test_code_named_on_the_theory_page_exists():
    """Names in `code` of docs/auv.md that look like states, settings or functions are in the source."""
    source = "\n".join(text_of(p) for p in (ROOT / "src" / "schuler").rglob("*.py"))
    names = set(re.findall(r"`([A-Za-z_]*_[A-Za-z_]+)`", text_of(DOCS / "auv.md")))
    assert len(names) > 25
    known = {"q_nb", "C_nb", "f_b", "w_ib_b", "w_nb_b", "w_in"}
    assert [n for n in sorted(names - known) if not re.search(rf"\b{n}\b", source)] == []


# ---- figures, pictures, versions ----


def test_the_figures_of_the_readme_are_those_that_were_measured():
    text = text_of(ROOT / "README.md")
    assert figures._TABLE.search(text), "the markers of the table are gone"
    if not figures.EVIDENCE.is_file():
        pytest.skip("docs/evidence.json does not exist: make evidence writes it")
    evidence = json.loads(text_of(figures.EVIDENCE))
    assert figures.filled(text, None, evidence) == text, "renew it: python docs/figures.py"
    assert len(figures.figures_table(evidence).splitlines()) > 5


def test_the_table_of_figures_shows_what_was_missed():
    def claim(what, value, holds, note=""):
        return {"part": "dive", "what": what, "value": value, "unit": "m", "wanted": "w", "holds": holds, "note": note}

    claims = [
        claim("mean error", 46.25, False, "+- 2.1 (standard error); rms 50"),
        claim("NIS of speed, per degree of freedom", 0.99, True),
        claim("NIS of depth, per degree of freedom", 2.0, False),
        claim("epochs", 412345.0, None),
    ]
    table = figures.figures_table({"claims": claims, "runs": 100, "seed": 5, "machine": "here"}).splitlines()
    assert "| mean error | 46.2 +- 2.1 m | w | **no** |" in table
    assert "| mean NIS of each kind | speed 0.99, depth 2.00 | inside 99 % bounds | **no** |" in table
    assert "| epochs | 412 345 m | w |  |" in table
    assert table[-1].startswith("100 runs for each simulated row") and table[-1].endswith("seed 5; here.")


def test_pictures():
    page = (DOCS / "images" / "page.png").read_bytes()
    assert page.startswith(b"\x89PNG") and 20_000 < len(page) < 400_000
    assert ET.parse(DOCS / "images" / "frames.svg").getroot().tag.endswith("svg")


def test_versions_agree():
    assert f"version: {schuler.__version__}\n" in text_of(ROOT / "CITATION.cff")
    assert f'version = "{schuler.__version__}"' in text_of(ROOT / "pyproject.toml")
    assert f"## {schuler.__version__}" in text_of(ROOT / "CHANGELOG.md")


# ---- the package's front door ----


def test_every_public_name_is_there_and_says_what_it_is():
    assert set(schuler.__all__) == set(schuler._HOME) | {"__version__"}
    for name in schuler.__all__:
        value = getattr(schuler, name)
        assert name == "__version__" or value.__doc__, name
    assert dir(schuler) == sorted(schuler.__all__)


def test_type_checkers_see_the_same_names():
    block = re.search(r"if TYPE_CHECKING:\n((?: .*\n)+)", text_of(ROOT / "src" / "schuler" / "__init__.py"))[1]
    seen = set()
    for line in block.splitlines():
        module, names = re.match(r" +from (\S+) import (.+)", line).groups()
        for name in names.split(", "):
            there, _, here = name.partition(" as ")
            seen.add(here or there)
            assert schuler._HOME[here or there] == module
            assert schuler._THERE.get(here or there, here or there) == there
    assert seen == set(schuler._HOME)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        schuler.nonsense  # noqa: B018


# ---- nothing of one machine ----


def tracked() -> list[Path]:
    try:
        done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [ROOT / name for name in done.stdout.splitlines()]


def test_no_path_of_one_machine_and_no_package_registry_is_in_the_repository():
    machine = re.compile(r"(?<![\w.])/(?:home|root|work|mnt|Users|private)/\w|\b[A-Z]:\\\\?Users")
    registry = re.compile(
        r"(?i)\bpypi\.\w+/|python[h]osted|--(?:extra-)?index-[u]rl|/[s]imple/|https?://(?:\d+\.){3}\d+"
    )
    faults = []
    for path in tracked():
        if not path.is_file() or path.suffix in (".png", ".npz", ".gz"):
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
            if machine.search(line) or registry.search(line):
                faults.append(f"{page_id(path)}:{number}: {line.strip()[:100]}")
    assert faults == []
