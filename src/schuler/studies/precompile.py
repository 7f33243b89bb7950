"""Compiling kernels on several cores at once, for a first start that is not long.

numba compiles one function after the other. `kernels.json` beside this file knows every function of the kernels with
the types it is called with and what it calls itself, as seen in a run of everything (`record`); so worker processes can
compile them leaves first, into numba's cache, from where the run then loads them. No function is ever compiled by two
workers at a time: numba's cache may be spoilt by that. Where the list does not fit the sources nothing is done here,
and numba compiles as it always does.

    python -m schuler.studies.precompile record      makes the list anew, after a change of the kernels (a minute)
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schuler.studies.warm import KERNELS

LIST = Path(__file__).with_name("kernels.json")
MOST_WORKERS = 4


@dataclass(frozen=True)
class Job:
    """One function for one set of argument types. after: numbers of the jobs that must be done before it."""

    module: str
    function: str
    types: tuple[str, ...]
    seconds: float
    after: frozenset[int]


def source_hash(module: str) -> str:
    """Of what a kernel module computes; comments and docstrings do not count. "" where there is no such module."""
    path = KERNELS / f"{module}.py"
    if not path.exists():
        return ""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.Module) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:16]


def jobs_of(modules: Iterable[str] | None = None) -> list[Job]:
    """What has to be compiled for some kernel modules and for all that they call; None: everything.

    Empty where the list is missing or older than the sources.
    """
    try:
        known = json.loads(LIST.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    entries = known["jobs"]
    if modules is not None:
        wanted = {(e["module"], e["function"]) for e in entries if e["module"] in set(modules)}
        grown = True
        while grown:
            more = {tuple(c) for e in entries if (e["module"], e["function"]) in wanted for c in e["calls"]}
            grown = not more <= wanted
            wanted |= more
        entries = [e for e in entries if (e["module"], e["function"]) in wanted]
    if any(source_hash(m) != known["sources"].get(m) for m in {e["module"] for e in entries}):
        return []
    names = [(e["module"], e["function"]) for e in entries]
    number: dict[tuple[str, str], list[int]] = {}
    for i, name in enumerate(names):
        number.setdefault(name, []).append(i)
    jobs = []
    for e, name in zip(entries, names, strict=True):
        called = [tuple(c) for c in e["calls"] if tuple(c) != name]
        after = frozenset(j for c in called for j in number.get((c[0], c[1]), []))
        jobs.append(Job(e["module"], e["function"], tuple(e["types"]), e["seconds"], after))
    return jobs


def precompile(modules: Iterable[str] | None = None, workers: int | None = None) -> bool:
    """Compiles kernels into numba's cache with several processes. False where nothing was done."""
    workers = min(workers or _cores(), MOST_WORKERS)
    jobs = jobs_of(modules)
    if workers < 2 or len(jobs) < 4 or os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return False
    _Crew(jobs, workers).work()
    return True


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Crew:
    """Hands jobs to worker processes: those first on which the longest chain of others waits."""

    def __init__(self, jobs: Sequence[Job], workers: int) -> None:
        self.jobs = jobs
        self.lock = threading.Condition()
        self.open = set(range(len(jobs)))
        self.running: set[tuple[str, str]] = set()
        self.done: set[int] = set()
        self.height = _heights(jobs)
        self.workers = workers

    def work(self) -> None:
        crew = [
            subprocess.Popen(
                [sys.executable, "-m", "schuler.studies.precompile", "worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            for _ in range(self.workers)
        ]
        threads = [threading.Thread(target=self._serve, args=(process,), daemon=True) for process in crew]
        try:
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        finally:
            for process in crew:
                process.kill()
                process.wait()
                for stream in (process.stdin, process.stdout):
                    if stream is not None:
                        stream.close()

    def _serve(self, process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None and process.stdout is not None
        while (index := self._next()) is not None:
            job = self.jobs[index]
            try:
                process.stdin.write(json.dumps([job.module, job.function, job.types]) + "\n")
                process.stdin.flush()
                alive = bool(process.stdout.readline())
            except (OSError, ValueError):
                alive = False
            with self.lock:
                self.running.discard(self._name(index))
                self.done.add(index)  # one that failed is compiled in the run itself
                self.lock.notify_all()
            if not alive:
                return

    def _name(self, index: int) -> tuple[str, str]:
        return self.jobs[index].module, self.jobs[index].function

    def _next(self) -> int | None:
        with self.lock:
            while self.open:
                ready = [i for i in self.open if self.jobs[i].after <= self.done and self._name(i) not in self.running]
                if ready:
                    index = max(ready, key=lambda i: (self.height[i], -i))
                    self.open.discard(index)
                    self.running.add(self._name(index))
                    return index
                if not self.running:  # what is left waits for itself: never, but nobody shall hang
                    self.open.clear()
                    self.lock.notify_all()
                    return None
                self.lock.wait()
            return None


def _heights(jobs: Sequence[Job]) -> list[float]:
    """Seconds of the longest chain that begins with each job."""
    waiting: list[list[int]] = [[] for _ in jobs]
    for i, job in enumerate(jobs):
        for j in job.after:
            waiting[j].append(i)
    height = [0.0] * len(jobs)
    for _ in range(len(jobs)):
        changed = False
        for i, job in enumerate(jobs):
            value = job.seconds + max((height[k] for k in waiting[i]), default=0.0)
            if value > height[i] + 1e-9 and value < 1e4:
                height[i], changed = value, True
        if not changed:
            break
    return height


def worker() -> None:
    """Compiles what comes on the standard input, a line each; answers with a line."""
    from importlib import import_module

    names = _type_names()
    for line in sys.stdin:
        module, function, typed = json.loads(line)
        try:
            dispatcher = getattr(import_module(f"schuler.kernels.{module}"), function)
            dispatcher.compile(tuple(_type_of(t, names) for t in typed))
            answer = "done"
        except Exception as error:
            answer = f"failed {type(error).__name__}"
        print(answer, flush=True)


def _type_of(text: str, names: dict[str, Any]) -> Any:
    """The numba type that a text of the list names: names, constants, tuples, items and calls of these."""

    def value(node: ast.AST) -> Any:
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            return names[node.id]
        if isinstance(node, ast.Tuple | ast.List):
            return tuple(value(e) for e in node.elts)
        if isinstance(node, ast.Subscript):
            return value(node.value)[value(node.slice)]
        if isinstance(node, ast.Call):
            keywords = {str(k.arg): value(k.value) for k in node.keywords}
            return value(node.func)(*(value(a) for a in node.args), **keywords)
        raise ValueError(f"{text!r} names no type")

    return value(ast.parse(text, mode="eval").body)


def _type_names() -> dict[str, Any]:
    from numba.core import types

    literal = {int: types.literal, types.bool: types.literal, str: types.literal}  # written Literal[int](3)
    return {**vars(types), "Literal": literal, "int": int, "str": str}


# ---- making the list ----


def record() -> None:
    """Runs everything with an empty cache, in a process of its own, and writes the list."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        subprocess.run([sys.executable, "-m", "schuler.studies.precompile", "listen"], check=True, env=environment)


def listen() -> None:
    """What numba compiles, and for which types, while everything runs once."""
    import time

    from numba.core import event

    from schuler.studies.warm import warm_all

    class Listener(event.Listener):
        def __init__(self) -> None:
            self.found: list[dict[str, Any]] = []
            self.stack: list[list[float]] = []

        def on_start(self, event: Any) -> None:
            self.stack.append([time.perf_counter(), 0.0])

        def on_end(self, event: Any) -> None:
            start, inside = self.stack.pop()
            total = time.perf_counter() - start
            if self.stack:
                self.stack[-1][1] += total
            dispatcher = event.data["dispatcher"]
            home = dispatcher.py_func.__module__
            if not home.startswith("schuler.kernels."):
                return
            self.found.append(
                {
                    "module": home.rpartition(".")[2],
                    "function": dispatcher.py_func.__name__,
                    "types": [repr(a) for a in event.data["args"]],
                    "seconds": round(total - inside, 1),
                    "calls": sorted(_calls(dispatcher)),
                }
            )

    listener = Listener()
    event.register("numba:compile", listener)
    warm_all(lambda step: print(step, file=sys.stderr))
    names = _type_names()
    jobs: list[dict[str, Any]] = []
    for entry in listener.found:
        key = (entry["module"], entry["function"], entry["types"])
        if any((j["module"], j["function"], j["types"]) == key for j in jobs):
            continue
        try:
            for text in entry["types"]:
                _type_of(text, names)
        except Exception:
            print(f"left out: {key}", file=sys.stderr)
            continue
        jobs.append(entry)
    sources = {module: source_hash(module) for module in sorted({j["module"] for j in jobs})}
    lines = ",\n".join("  " + json.dumps(j) for j in jobs)
    LIST.write_text(f'{{"sources": {json.dumps(sources)},\n"jobs": [\n{lines}\n]}}\n', encoding="utf-8")
    print(f"{len(jobs)} jobs, {sum(j['seconds'] for j in jobs):.0f} s on one core", file=sys.stderr)


def _calls(dispatcher: Any) -> set[tuple[str, str]]:
    """Kernel functions that a kernel function names."""
    from numba.core.dispatcher import Dispatcher

    function = dispatcher.py_func
    named = [function.__globals__.get(name) for name in _names(function.__code__)]
    return {
        (d.py_func.__module__.rpartition(".")[2], d.py_func.__name__)
        for d in named
        if isinstance(d, Dispatcher) and d.py_func.__module__.startswith("schuler.kernels.")
    }


def _names(code: Any) -> set[str]:
    inner = [_names(c) for c in code.co_consts if hasattr(c, "co_names")]
    return set(code.co_names).union(*inner)


if __name__ == "__main__":
    {"worker": worker, "record": record, "listen": listen}[sys.argv[1]]()
