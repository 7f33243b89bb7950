"""Commands beside navigation: published, bench, warmup."""

from __future__ import annotations

import time
from pathlib import Path

from schuler.cli.screen import compile_if_cold, steps
from schuler.ground.errors import InputError


def write_json(path: Path, text: str) -> None:
    """JSON text to a file, whole or not at all; "-" is the standard output."""
    if str(path) == "-":
        print(text, end="")
        return
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_text(text, encoding="utf-8", newline="\n")
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}; type another --json") from None
    finally:
        partial.unlink(missing_ok=True)


def published(source: str | None, json: Path | None) -> None:
    """The ledger on the terminal, and as JSON."""
    from rich.console import Console

    from schuler.published.ledger import ledger, render, to_json

    if source in (None, "auv"):
        compile_if_cold(("paper", "mission", "noise"))
    with steps() as progress:
        rows = ledger(source, progress)
    if json is not None:
        write_json(json, to_json(rows))
        if str(json) == "-":
            return
    console = Console()
    console.print(render(rows))


def bench(json: Path | None) -> None:
    """Speed of the main tasks."""
    from schuler.studies.bench import run_tasks, table_lines, to_json

    with steps() as progress:
        rows = run_tasks(progress)
    if json is not None:
        write_json(json, to_json(rows))
        if str(json) == "-":
            return
    for line in table_lines(rows):
        print(line)


def warmup() -> None:
    """Every kernel into numba's cache."""
    from schuler.studies.precompile import jobs_of, precompile
    from schuler.studies.warm import cold, warm_all

    start = time.perf_counter()
    with steps() as progress:
        if cold(sorted({job.module for job in jobs_of()})):
            progress("compiling kernels on all cores")
            precompile()
        warm_all(progress)
    print(f"kernels are compiled ({time.perf_counter() - start:.1f} s)")
