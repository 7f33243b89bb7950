"""The report of `check`: what was found in one table, and the faults with what to type next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from schuler.io.still import Noise, Stretch

CODES = (
    "gyro_unit",
    "accel_unit",
    "time_unit",
    "increments",
    "axes",
    "not_increasing",
    "gap",
    "nan",
    "quantised",
)


@dataclass(frozen=True)
class Fault:
    """code : one of CODES. says : what was found. type_next : what to type, or change."""

    code: str
    says: str
    type_next: str


@dataclass
class CheckReport:
    """What was found in one file. kind and gravity_axis are None where the file holds no accelerometer.

    gaps : (time of the last row before, length), s. gravity_axis : the axis along which a resting accelerometer reads
    +g ("-z" for forward-right-down). units : what each group was taken for, as sentences.
    refused : why no table can be made of it, "" where one can. still : stretches at rest.
    """

    file: str
    table: str
    rows: int
    start_s: float | None = None
    duration_s: float | None = None
    rate_hz: float | None = None
    jitter_s: float | None = None
    gaps: list[tuple[float, float]] = field(default_factory=list)
    kind: str | None = None
    gravity_axis: str | None = None
    specific_force: float | None = None  # median length, m/s^2
    units: list[str] = field(default_factory=list)
    still: list[Stretch] = field(default_factory=list)
    noise: Noise | None = None
    faults: list[Fault] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    refused: str = ""
    next: list[str] = field(default_factory=list)

    def add(self, code: str, says: str, type_next: str) -> None:
        self.faults.append(Fault(code, says, type_next))

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "file": self.file,
            "table": self.table,
            "rows": self.rows,
            "rate_hz": self.rate_hz,
            "duration_s": self.duration_s,
            "jitter_s": self.jitter_s,
            "gaps": [{"after_s": a, "length_s": b} for a, b in self.gaps],
            "kind": self.kind,
            "gravity_axis": self.gravity_axis,
            "units": self.units,
            "still": [{"from_s": s.start, "to_s": s.end} for s in self.still],
            "noise": self.noise.as_dict() if self.noise else None,
            "faults": [{"code": f.code, "says": f.says, "type_next": f.type_next} for f in self.faults],
            "notes": self.notes,
            "refused": self.refused,
        }
