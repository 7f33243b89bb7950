"""The report of `check` as text for a terminal."""

from __future__ import annotations

import textwrap

from schuler.ground.times import iso_from_unix
from schuler.ground.units import DEG, G0
from schuler.io.check_report import CheckReport
from schuler.io.sheets import counted
from schuler.io.still import Noise, Stretch

WIDTH = 100


def render(report: CheckReport) -> str:
    """A report for people: what the file is, then what is wrong with it, then what to type next."""
    lines = [f"{report.file}: {report.table} table, {counted(report.rows, 'row')}"]
    if report.rate_hz and report.duration_s is not None:
        jitter = f", jitter {_small_time(report.jitter_s)}" if report.jitter_s is not None else ""
        _say(lines, "rate", f"{report.rate_hz:.5g} Hz over {_duration(report.duration_s)}{jitter}")
    if report.start_s is not None and report.duration_s is not None:
        date = f" ({iso_from_unix(report.start_s, 0)} on)" if 6e8 < report.start_s < 4e9 else ""
        _say(lines, "time", f"{report.start_s:.3f} to {report.start_s + report.duration_s:.3f} s{date}")
    if report.rate_hz:
        _say(lines, "gaps", _gaps(report.gaps))
    for k, unit in enumerate(report.units):
        _say(lines, "" if k else "units", unit)
    if report.kind:
        _say(lines, "kind", _KINDS[report.kind])
    if report.specific_force:
        axis = f", the support against gravity is along {report.gravity_axis}" if report.gravity_axis else ""
        _say(
            lines, "gravity", f"median |f| {report.specific_force:.4g} m/s^2 = {report.specific_force / G0:.3f} g{axis}"
        )
    if report.table == "imu" and report.rate_hz and (report.specific_force or report.noise):
        _say(lines, "still", _still(report.still))
    if report.noise:
        _noise(lines, report.noise)
    for k, note in enumerate(report.notes):
        _say(lines, "" if k else "notes", note)
    if report.faults:
        lines.append("")
        for fault in report.faults:
            _say(lines, "!" + fault.code, fault.says)
            _say(lines, "", f"-> {fault.type_next}")
    elif not report.refused:
        _say(lines, "faults", "none found")
    if report.refused:
        _say(lines, "refused", report.refused)
    for k, text in enumerate(report.next):
        lines.append(f"  {'' if k else 'next':<16}{text}")  # to be typed: never wrapped
    return "\n".join(lines)


_KINDS = {
    "rates": "rates (each row the mean over the step before its stamp)",
    "increments": "increments (each row what came together since the row before)",
}


def _say(lines: list[str], label: str, text: str) -> None:
    """A labelled paragraph, wrapped; what is to be typed is never broken."""
    head = f"  {label:<16}"
    if text.startswith("-> "):
        lines.append(head + text)
        return
    lines += textwrap.wrap(
        text,
        WIDTH,
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_long_words=False,
        break_on_hyphens=False,
    ) or [head.rstrip()]


def _small_time(seconds: float) -> str:
    if seconds < 1e-7:
        return "none"
    return f"{seconds:.3g} s" if seconds > 1.0 else f"{seconds * 1e3:.2g} ms"


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.4g} s"
    if seconds < 7200.0:
        return f"{seconds:.6g} s ({seconds / 60.0:.3g} min)"
    return f"{seconds:.7g} s ({seconds / 3600.0:.3g} h)"


def _gaps(gaps: list[tuple[float, float]]) -> str:
    if not gaps:
        return "none"
    at, longest = max(gaps, key=lambda g: g[1])
    return f"{len(gaps)}, the longest {longest:.3g} s after {at:.3f} s"


def _still(stretches: list[Stretch]) -> str:
    if not stretches:
        return "never at rest for three seconds"
    total = sum(s.length for s in stretches)
    longest = max(stretches, key=lambda s: s.length)
    where = f"the longest {_duration(longest.length)} from {longest.start:.2f} to {longest.end:.2f} s"
    several = "1 stretch" if len(stretches) == 1 else f"{len(stretches)} stretches"
    return f"{several}, {_duration(total)} in all; {where}"


def _noise(lines: list[str], noise: Noise) -> None:
    where = "at rest" if noise.still else "while moving: an upper bound"
    if noise.gyro_arw:
        values = " ".join(f"{v * 60.0 / DEG:.3g}" for v in noise.gyro_arw)
        _say(lines, "noise", f"gyro {values} deg/sqrt(h) (x y z, from the Allan deviation at 1 s, {where})")
    if noise.accel_vrw:
        values = " ".join(f"{v * 60.0:.3g}" for v in noise.accel_vrw)
        how = "" if noise.gyro_arw else f" (x y z, from the Allan deviation at 1 s, {where})"
        _say(lines, "" if noise.gyro_arw else "noise", f"accelerometer {values} m/s/sqrt(h){how}")
    if noise.gyro_bias:
        values = " ".join(f"{v / DEG:.4g}" for v in noise.gyro_bias)
        _say(lines, "bias", f"gyro {values} deg/s at rest (Earth rate is 0.0042 deg/s)")
