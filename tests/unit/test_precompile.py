"""Compiling on several cores: the list fits the sources, jobs wait for what they call, one function at a time."""

import json
import os
import subprocess
import sys
import threading
import time

import pytest

from schuler.studies import precompile


def test_the_list_fits_the_kernels():
    known = json.loads(precompile.LIST.read_text())
    old = [m for m, h in known["sources"].items() if precompile.source_hash(m) != h]
    assert old == [], f"the list of what is compiled is older than these kernels ({', '.join(old)}): make kernels"


def test_a_part_brings_what_it_calls():
    every = {(j.module, j.function) for j in precompile.jobs_of()}
    part = precompile.jobs_of(["mission"])
    if not every or not part:
        pytest.skip("the list is old, as the test before this one says")
    assert "mission" in {j.module for j in part}
    assert {(j.module, j.function) for j in part} < every
    for i, job in enumerate(part):
        assert i not in job.after and all(0 <= k < len(part) for k in job.after)


def test_a_list_that_is_older_than_the_kernels_is_not_used(monkeypatch):
    monkeypatch.setattr(precompile, "source_hash", lambda module: "another")
    assert precompile.jobs_of() == [] and precompile.precompile() is False


def test_comments_do_not_change_the_hash(tmp_path, monkeypatch):
    monkeypatch.setattr(precompile, "KERNELS", tmp_path)

    def hashed(text):
        (tmp_path / "k.py").write_text(text)
        return precompile.source_hash("k")

    plain = hashed("def f(x):\n    return x + 1\n")
    assert hashed('"""Module."""\n\n\ndef f(x):\n    """Says."""\n    return x + 1  # one\n') == plain
    assert hashed("def f(x):\n    return x + 2\n") != plain
    assert precompile.source_hash("nothing") == ""


JOBS = [
    precompile.Job("m", "leaf", ("float64",), 1.0, frozenset()),
    precompile.Job("m", "leaf", ("int64",), 1.0, frozenset()),
    precompile.Job("m", "other", (), 1.0, frozenset()),
    precompile.Job("m", "parent", (), 5.0, frozenset({0, 1})),
    precompile.Job("m", "top", (), 1.0, frozenset({2, 3})),
]


def test_jobs_wait_for_what_they_call_and_a_function_is_never_compiled_twice_at_a_time():
    crew = precompile._Crew(JOBS, 3)
    order, at_once = [], []

    def serve():
        while (i := crew._next()) is not None:
            with crew.lock:
                at_once.append(sorted(name for _, name in crew.running))
            time.sleep(0.01)
            with crew.lock:
                order.append(i)
                crew.running.discard(crew._name(i))
                crew.done.add(i)
                crew.lock.notify_all()

    threads = [threading.Thread(target=serve) for _ in range(3)]
    for t in threads:
        t.start()
    for t in threads:
        t.join(timeout=10)
    assert sorted(order) == list(range(len(JOBS)))
    assert order.index(3) > max(order.index(0), order.index(1)) and order[-1] == 4
    assert all(names.count("leaf") <= 1 for names in at_once)
    assert crew.height[0] == pytest.approx(7.0)  # leaf, parent, top


@pytest.mark.slow
def test_what_was_compiled_is_found_by_the_run(tmp_path):
    """Two processes fill an empty cache; afterwards a process finds its kernels there and compiles nothing."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    fill = "from schuler.studies.precompile import precompile; assert precompile(['rotation', 'earth'], workers=2)"
    subprocess.run([sys.executable, "-c", fill], check=True, env=environment)
    use = """
from numba.core import event
with event.install_recorder("numba:compile") as compiled:
    import numpy as np
    from schuler.kernels.rotation import quat_from_rotvec
    quat_from_rotvec(0.1, 0.2, 0.3)
print(len(compiled.buffer))
"""
    done = subprocess.run([sys.executable, "-c", use], check=True, env=environment, capture_output=True, text=True)
    assert done.stdout.strip() == "0"


def test_a_part_that_is_needed_and_not_compiled_is_asked_for_once(monkeypatch):
    from schuler.studies import warm

    asked = []
    monkeypatch.setattr(warm, "_told", set())
    monkeypatch.setattr(warm, "cold", lambda modules: True)
    monkeypatch.setattr(warm, "on_cold", None)
    warm.need("rotation")  # nobody listens
    monkeypatch.setattr(warm, "on_cold", lambda modules: asked.append(list(modules)))
    warm.need("rotation", "earth")
    warm.need("earth", "noise")
    monkeypatch.setattr(warm, "cold", lambda modules: False)
    warm.need("mission")
    assert asked == [["rotation", "earth"], ["noise"]]
