"""What is seen while something runs: steps on a terminal, nothing in a pipe or a log."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from schuler.cli import say


@contextmanager
def steps() -> Iterator[Callable[[str], None]]:
    """A function that shows the name of the step in progress, with the time it has taken, on a terminal only."""
    if not sys.stderr.isatty():
        yield lambda step: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("starting", total=None)
        yield lambda step: shown.update(task, description=step)


def compile_if_cold(modules: Sequence[str]) -> None:
    """Compiles kernel modules that are not in numba's cache yet, on all cores, and says so once."""
    from schuler.studies.warm import cold

    if cold(modules):
        compile_now(modules)


def compile_now(modules: Sequence[str]) -> None:
    """The same where it is known that they are not there."""
    from schuler.studies.precompile import precompile

    say("compiling kernels once (some seconds; later runs start at once) ...")
    precompile(modules)
