"""The tutorial's Python runs and its claims hold; the examples load."""

import re
from pathlib import Path

import pytest

from schuler.studies.model import load_study

ROOT = Path(__file__).parents[2]


def test_the_tutorial_runs(capsys: pytest.CaptureFixture[str]) -> None:
    text = (ROOT / "docs" / "tutorial-strapdown.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(blocks) == 3
    space: dict = {}
    for block in blocks:
        exec(compile(block, "tutorial-strapdown.md", "exec"), space)
    assert "gyro_bias_deg_per_h" in capsys.readouterr().out


@pytest.mark.parametrize("path", sorted(ROOT.glob("examples/strapdown-*/study.toml")), ids=lambda p: p.parent.name)
def test_examples_load_under_their_own_name(path: Path) -> None:
    study = load_study(path)
    assert study.study.kind == "strapdown"
    assert study.study.name == path.parent.name


def test_the_page_of_an_example_has_the_growth_figure(tmp_path: Path) -> None:
    from schuler.studies.run import run_study

    result = run_study(load_study(ROOT / "examples" / "strapdown-ideal-navigator-2" / "study.toml"))
    lat, lon = result.navigation.filter.lat[-1], result.navigation.filter.lon[-1]
    assert lat * 57.29577951308232 == pytest.approx(51.14355663, abs=2e-8)
    assert lon * 57.29577951308232 == pytest.approx(31.15058801, abs=2e-8)
    text = (result.write(tmp_path / "out") / "report.html").read_text(encoding="utf-8")
    assert "Error growth" in text and "Numerical floor" in text
