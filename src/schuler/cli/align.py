"""Command align."""

from __future__ import annotations

from pathlib import Path

from schuler.cli.screen import compile_if_cold, steps


def align(path: Path, out: Path | None, seed: int | None) -> None:
    """Initial attitude of a study, printed and written as alignment.json."""
    from schuler.studies.align import align_study, lines, write
    from schuler.studies.model import load_study

    study = load_study(path)
    compile_if_cold(("mechanization", "alignment"))
    with steps() as progress:
        _, told = align_study(study, seed=seed, progress=progress)
        written = write(told, out if out is not None else study.folder / f"{study.study.name}-alignment")
    for line in lines(told):
        print(line)
    print(f"wrote {written}")
