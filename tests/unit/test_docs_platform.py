"""The tutorial on platforms holds the numbers that the code gives now."""

import importlib.util
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("docs_build", DOCS / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_current(build):
    page = (DOCS / "tutorial-platform.md").read_text(encoding="utf-8")
    assert page == build.built("tutorial-platform.md"), "renew it: python docs/build.py"


def test_every_number_of_a_table_comes_from_a_figure(build):
    """No result is typed into the template: its tables hold places, not numbers."""
    template = (DOCS / "templates" / "tutorial-platform.md").read_text(encoding="utf-8")
    rows = [line for line in template.splitlines() if line.startswith("|") and not line.startswith("|---")]
    results = [re.sub(r"^\|[^|]*\|", "", line) for line in rows if "{" in line]
    assert len(results) >= 10
    assert not any(re.search(r"\d\.\d", line) for line in results)
    assert set(re.findall(r"\{(\w+)\}", template)) == set(build.platform_figures())


def test_links_lead_somewhere():
    for name in ("tutorial-platform.md", "platform.md"):
        for target in re.findall(r"\]\(([\w.-]+\.md)\)", (DOCS / name).read_text(encoding="utf-8")):
            assert (DOCS / target).exists(), (name, target)
