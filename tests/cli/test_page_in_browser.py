"""The page in a real browser: no error in its console, every figure drawn, nothing asked of any network."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from fake_result import fake
from schuler.io.results import write_results
from schuler.report.page import page
from schuler.studies.compare import compare_results

pytestmark = pytest.mark.slow
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
QUIET = (
    "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --no-default-browser-check "
    "--disable-background-networking --disable-component-update --disable-sync --disable-extensions "
    "--enable-logging=stderr --v=0 --virtual-time-budget=8000 --window-size=1280,2000"
).split()
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND"  # whatever a page or the browser itself may want


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> str:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser here (looked for {', '.join(BROWSERS)})")
    folder = tmp_path_factory.mktemp("browser")
    (folder / "plain.html").write_text("<p>plain words</p>")
    try:
        document, _, _ = opened(found, folder / "plain.html", folder)
    except (OSError, subprocess.TimeoutExpired) as error:
        pytest.skip(f"{found} does not start here: {error}")
    if "plain words" not in document:
        pytest.skip(f"{found} does not start here")
    return found


def opened(browser: str, file: Path, folder: Path) -> tuple[str, str, list[str]]:
    """(document after its scripts, console lines, addresses asked for) of a page opened as a file."""
    folder.mkdir(exist_ok=True)
    log = folder / "net.json"
    command = [browser, *QUIET, OFFLINE, f"--user-data-dir={folder / 'profile'}", f"--log-net-log={log}"]
    command += ["--dump-dom", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    # The browser's own wishes carry the initiator "not an origin"; a page's carry the page.
    lines = log.read_text(errors="replace").splitlines() if log.exists() else []
    wishes = (re.search(r'"initiator":"(?!not an origin).*"url":"(https?://[^"]*)"', line) for line in lines)
    asked = [w.group(1) for w in wishes if w]
    return done.stdout, "\n".join(console), asked


CASES = {
    "one dive": {},
    "a glider without reference": {
        "name": "<script>alert(1)</script>", "dives": 4, "dive_s": 6000.0, "surface_s": 600.0, "rate_hz": 0.1,
        "gnss_every_s": 200.0, "reference": False, "imu": False,
    },
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_opens_offline_without_a_complaint(browser: str, tmp_path: Path, case: dict) -> None:
    text = page(fake(**case))
    figures = len(re.findall(r'<div class="plot"', text))
    file = tmp_path / "report.html"
    file.write_text(text, encoding="utf-8")
    document, console, asked = opened(browser, file, tmp_path)
    assert console == ""
    assert f'data-drawn="{figures}"' in document
    assert document.count("main-svg") >= figures > 5
    assert document.count('class="scatterlayer') >= figures
    assert len(re.findall(r'class="js-(?:line|fill)"', document)) > 20  # lines and bands, not empty axes
    assert "NaN" not in re.sub(r"<script.*?</script>", "", document, flags=re.S)
    assert asked == []


def test_sweeps_distrust_and_comparisons_too(browser: str, tmp_path: Path) -> None:
    """Chapters that the results above do not have, and the page of schuler compare."""
    result = fake()
    i = result.navigation.innovations["gnss_position"]
    i.used[20:31] = False
    window = {"start_s": 10.0, "horizontal_end_m": 3.0, "smoother_horizontal_max_m": 0.5}
    entries = [{**window, "end_s": 25.0 + 9.0 * k, "horizontal_end_m": 1.0 + k} for k in range(9)]
    result.summary["sweep"] = [{"length_s": 15.0, "windows": 9, "entries": entries}]
    folders = []
    for seed in (1, 2, 3):
        made = fake(seed=seed)
        folders.append(write_results(tmp_path / f"r{seed}", made.navigation, made.summary, page=""))
    pages = {"one": page(result), "compare": compare_results(folders).page()}
    for name, text in pages.items():
        file = tmp_path / f"{name}.html"
        file.write_text(text, encoding="utf-8")
        figures = len(re.findall(r'<div class="plot"', text))
        document, console, asked = opened(browser, file, tmp_path / name)
        assert console == "" and asked == []
        assert f'data-drawn="{figures}"' in document
        assert len(re.findall(r'class="js-(?:line|fill)"', document)) > 10
    assert 'id="fig-sweep-time"' in pages["one"] and 'id="distrust"' in pages["one"]
    assert 'id="fig-map"' in pages["compare"] and 'id="fig-differences"' in pages["compare"]


def test_a_fault_in_a_page_would_be_seen(browser: str, tmp_path: Path) -> None:
    """The test above can fail: a thrown error, a refused request and one that is made all show."""
    policy = "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'\">"
    fault = '<img src="http://outside.invalid/x.png"><script>throw new Error("broken")</script>'
    file = tmp_path / "bad.html"
    file.write_text(policy + fault)
    _, console, asked = opened(browser, file, tmp_path / "first")
    assert "broken" in console and "Content Security Policy" in console and not asked
    file.write_text(fault)
    _, _, asked = opened(browser, file, tmp_path / "second")
    assert asked == ["http://outside.invalid/x.png"]
