"""Commands on files: check, convert."""

from __future__ import annotations

from pathlib import Path


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
