"""Commands on files: check, convert."""

from __future__ import annotations

from pathlib import Path

from schuler.ground.errors import InputError


def check(files: list[Path], json: Path | None) -> None:
    """A report of each file; one that cannot be read at all does not keep the others from being looked at."""
    from schuler.cli.others import write_json
    from schuler.cli.screen import steps
    from schuler.io.check import check_file, render
    from schuler.io.results import json_text

    reports, faults = [], []
    with steps() as progress:
        for path in files:
            progress(f"reading {path}")
            try:
                reports += check_file(path)
            except InputError as error:
                faults.append(str(error))
    if json is not None:
        write_json(json, json_text([r.as_dict() for r in reports]))
    if str(json) != "-":
        print("\n\n".join(render(r) for r in reports))
    if faults:
        raise InputError("\n".join(faults))


def convert(source: Path, target: Path, gyro_unit: str | None, accel_unit: str | None) -> None:
    """A recording to tables, and what was assumed on the way."""
    from schuler.cli.screen import steps
    from schuler.io.convert import convert as convert_recording

    with steps() as progress:
        progress(f"reading {source}")
        report = convert_recording(source, target, gyro_unit=gyro_unit, accel_unit=accel_unit)
    print(f"{source}: read as {report.format}")
    for name, count in report.rows.items():
        print(f"  {name}: {count} rows")
    for note in report.notes:
        print(f"note: {note}")
    print(f"written: {target}")
