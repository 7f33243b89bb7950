"""The command that lays results side by side: compare."""

from __future__ import annotations

from pathlib import Path

from schuler.cli.screen import steps


def compare(folders: list[Path], out: Path | None) -> None:
    """Figures on the terminal, everything on one page."""
    from schuler.studies.compare import compare_results, target

    with steps() as progress:
        found = compare_results(folders, progress)
        target(out, found.results[0].folder)  # before the work, not after it
        lines = found.lines()
        written = found.write(out, progress)
    for line in lines:
        print(line)
    for result in found.results:
        for note in result.notes:
            print(f"note: {note}")
    print(f"page: {written}")
