"""numba keeps a caller's old code when a function in another file changes; `drop_stale` throws that code away."""

import os
import subprocess
import sys
import time

import pytest

from schuler.studies.cache import KERNELS, _imported, _reached, cache_folder, drop_stale

INNER = "from numba import njit\n@njit(cache=True)\ndef inner(x):\n    return x + {}\n"
OUTER = "from numba import njit\nfrom .inner import inner\n@njit(cache=True)\ndef outer(x):\n    return inner(x)\n"
LONER = "def plain(x):\n    return x\n"


def write(path, text, age=0.0):
    path.write_text(text)
    at = time.time() - age
    os.utime(path, (at, at))


@pytest.mark.slow
@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_callers_code_follows_a_change_in_another_file(tmp_path, elsewhere):
    folder = tmp_path / "pieces"
    folder.mkdir()
    write(folder / "__init__.py", "", age=100)
    write(folder / "inner.py", INNER.format(1), age=100)
    write(folder / "outer.py", OUTER, age=100)
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    if elsewhere:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")

    def run(first=""):
        code = f"{first}\nfrom pieces.outer import outer; print(outer(1))"
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True)
        assert done.returncode == 0, done.stderr
        return int(done.stdout.split()[-1])

    drop = (
        "from pathlib import Path; from schuler.studies.cache import drop_stale; drop_stale(Path('pieces').resolve())"
    )
    assert run(drop) == 2
    write(folder / "inner.py", INNER.format(10), age=-1)
    assert run() == 2  # what numba does; once this fails, numba has learnt it and drop_stale may go
    assert run(drop) == 11


def test_only_what_a_change_reaches_is_dropped(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    sources, cache = tmp_path, tmp_path / "__pycache__"
    cache.mkdir()
    for name, text in (("inner", INNER), ("outer", OUTER), ("loner", LONER)):
        write(sources / f"{name}.py", text, age=100)
        write(cache / f"{name}.f-1.py311.nbi", "", age=50)
        write(cache / f"{name}.f-1.py311.1.nbc", "", age=50)
    write(cache / "stranger.f-1.py311.nbi", "", age=500)
    assert cache_folder(sources) == cache
    assert drop_stale(sources) == []
    write(sources / "loner.py", LONER, age=10)
    assert drop_stale(sources) == ["loner.f-1.py311.1.nbc", "loner.f-1.py311.nbi"]
    write(sources / "inner.py", INNER, age=10)
    assert {name.split(".")[0] for name in drop_stale(sources)} == {"inner", "outer"}
    assert [p.name for p in cache.iterdir()] == ["stranger.f-1.py311.nbi"]


def test_the_kernels_imports_are_seen():
    imported = {p.stem: _imported(p) & {q.stem for q in KERNELS.glob("*.py")} for p in KERNELS.glob("*.py")}
    assert _reached("auv_run", imported) >= {"auv_run", "auv_measure", "auv_state", "rotation"}
    assert "auv_run" not in _reached("auv_state", imported)
