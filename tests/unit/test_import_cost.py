"""`import schuler` stays cheap: heavy packages load inside what needs them."""

import statistics
import subprocess
import sys
import time

import pytest

HEAVY = ("numba", "llvmlite", "scipy", "pandas", "plotly", "pydantic", "typer", "rich", "jinja2", "matplotlib")


def seconds(code: str) -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True)
    return time.perf_counter() - start


def test_import_brings_nothing_heavy():
    code = f"import sys, schuler; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_import_costs_at_most_1_6_times_numpy():
    ratios = []
    for _ in range(4):  # a busy machine gets another chance; a heavy import fails every time
        pairs = [(seconds("import schuler"), seconds("import numpy")) for _ in range(5)]
        ratios.append(statistics.median(a for a, _ in pairs) / statistics.median(b for _, b in pairs))
        if ratios[-1] <= 1.6:
            return
    pytest.fail(f"import schuler takes {min(ratios):.2f} times as long as import numpy; at most 1.6 is allowed")
