"""Commands calibrate and allan."""

from __future__ import annotations

from pathlib import Path

from schuler.cli.screen import compile_if_cold, steps
from schuler.ground.errors import StudyError


def calibrate(path: Path, out: Path | None, design: int | None) -> None:
    """Lever arms, biases, scales, misalignments from recordings; or the design of a plan."""
    from schuler.io.results import check_target
    from schuler.studies import calibration
    from schuler.studies.calibration_plan import load_plan

    plan = load_plan(path)
    word = "calibration" if design is None else "design"
    target = check_target(out if out is not None else plan.folder / f"{plan.plan.name}-{word}")
    if design is not None:
        from schuler.studies.calibration_design import design_lines, design_plan

        with steps() as progress:
            designed = design_plan(plan, design, progress)
            designed.write(target, progress)
        for line in design_lines(designed):
            print(line)
        print(f"wrote {target / 'design.csv'}, {target / 'report.html'}")
        return
    compile_if_cold(("turntable",) if plan.plan.kind == "turntable" else ("transfer",))
    with steps() as progress:
        done = calibration.calibrate(plan, progress)
        done.write(target, progress)
    for line in calibration.lines(done):
        print(line)
    for note in done.notes:
        print(f"note: {note}")
    print(f"wrote {target / 'calibration.json'}, {target / 'report.html'}")


def allan(file: Path, tau: str | None, out: Path | None, kind: str, rate_hz: float | None) -> None:
    """Allan deviation of a recording."""
    from schuler.calibration.allan import KINDS
    from schuler.io.results import check_target
    from schuler.io.tables import read_table
    from schuler.studies import allan as work

    if kind not in KINDS:
        raise StudyError(f"--kind {kind}: type one of {', '.join(KINDS)}")
    times = _times(tau)
    stem = file.name.split(".")[0] or "recording"
    target = check_target(out if out is not None else file.parent / f"{stem}-allan")
    compile_if_cold(("allan",))
    with steps() as progress:
        progress(f"reading {file.name}")
        table = read_table(file, "imu", rate_hz=rate_hz)
        result = work.analyse(table, file.name, times, kind, progress)  # type: ignore[arg-type]
        result.write(target, progress)
    for line in work.lines(result):
        print(line)
    for note in result.notes:
        print(f"note: {note}")
    print(f"wrote {target / 'allan.json'}, {target / 'imu.toml'}, {target / 'report.html'}")


def _times(text: str | None) -> list[float] | None:
    if text is None:
        return None
    out = []
    for word in text.split(","):
        try:
            out.append(float(word))
        except ValueError:
            raise StudyError(
                f'--tau: "{word.strip()}" is not a number; type averaging times in s, e.g. --tau 0.1,1,10'
            ) from None
    return out
