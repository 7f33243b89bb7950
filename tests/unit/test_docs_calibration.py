"""The turntable tutorial shows what the program prints."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def printed(text):
    """Indented blocks that are output, line by line; lines with dots for what is left out are not."""
    lines = [line.strip() for line in text.splitlines() if line.startswith("    ")]
    return [x for x in lines if re.search(r"1 sigma|residual|best \d|one more|thesis's five|worst", x)]


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    spec = importlib.util.spec_from_file_location("bench_make", ROOT / "examples" / "turntable-bench" / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    out = tmp_path_factory.mktemp("bench")
    before, sys.argv = sys.argv, ["make.py", str(out)]
    try:
        assert module.main() == 0
    finally:
        sys.argv = before
    return out


@pytest.mark.slow
def test_the_tutorial_shows_what_is_printed(bench):
    from schuler.studies.calibration import calibrate, lines
    from schuler.studies.calibration_design import design_lines, design_plan
    from schuler.studies.calibration_plan import load_plan

    plan = load_plan(bench / "plan.toml")
    said = {x.strip() for x in [*lines(calibrate(plan)), *design_lines(design_plan(plan, 5))]}
    shown = printed((ROOT / "docs" / "tutorial-turntable.md").read_text(encoding="utf-8"))
    assert len(shown) >= 7
    assert [x for x in shown if x not in said] == []


def test_links_lead_somewhere():
    for name in ("calibration.md", "tutorial-turntable.md"):
        for target in re.findall(r"\]\(([\w.-]+\.md)\)", (ROOT / "docs" / name).read_text(encoding="utf-8")):
            assert (ROOT / "docs" / target).exists(), (name, target)
