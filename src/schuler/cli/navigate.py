"""Commands that navigate: demo, run."""

from __future__ import annotations

from pathlib import Path

from schuler.cli.screen import compile_if_cold, compile_now, steps

DEMO_OUT = Path("demo-result")
# kernel modules of the kinds that do not say themselves when they need them (studies.warm.need)
KERNELS = {
    "platform": ("platform", "platform_alignment"),
    "strapdown": ("motion", "noise", "mechanization", "error_model"),
}


def demo(out: Path | None, seed: int | None) -> None:
    """The study that comes with the program."""
    from importlib.resources import as_file, files

    with as_file(files("schuler.studies") / "demo.toml") as study:
        run(study, out or DEMO_OUT, seed)


def run(path: Path, out: Path | None, seed: int | None) -> None:
    """Runs a study file, prints its figures, writes the result folder."""
    from schuler.io.results import check_target
    from schuler.studies import warm
    from schuler.studies.model import load_study
    from schuler.studies.run import default_out, run_study
    from schuler.studies.told import figures, where

    study = load_study(path)
    target = check_target(out if out is not None else default_out(study))  # before the work, not after it
    warm.on_cold = compile_now
    compile_if_cold(KERNELS.get(study.study.kind, ()))
    with steps() as progress:
        result = run_study(study, seed=seed, progress=progress)
        lines = figures(result)
        written = result.write(target, progress)
    for line in lines:
        print(line)
    for note in result.notes:
        print(f"note: {note}")
    for line in where(written):
        print(line)
