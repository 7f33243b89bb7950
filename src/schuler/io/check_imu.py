"""The part of `check` that looks at an IMU: units, rates or increments, gravity, rest, noise."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.units import G0, to_si, unit_of
from schuler.io.check_clock import beside, clock, missing_numbers, study_line
from schuler.io.check_report import CheckReport
from schuler.io.formats.generic import tables_in
from schuler.io.guess import guess_accel, guess_gyro, gyro_contradiction, norm, quietest
from schuler.io.headings import Match, match, quantity_of, unit_text
from schuler.io.headless import place_columns
from schuler.io.imu import triple
from schuler.io.sheets import Sheet, counted
from schuler.io.still import noise_of, still_stretches

Array = NDArray[np.float64]


def check_imu(sheet: Sheet, path: Path) -> CheckReport:
    report = CheckReport(str(path), "imu", len(sheet))
    if sheet.has_headings:
        complaints: list[tuple[str, str]] = []
        words = {i for i, c in enumerate(sheet.columns) if c.dtype.kind == "U"}
        found, _ = match(sheet.headings, "imu", words, complaints)
        for stem, code in (("time", "time_unit"), ("gyro", "gyro_unit"), ("accel", "accel_unit")):
            said = [sentence for column, sentence in complaints if column.startswith(stem)]
            if said:
                report.add(code, said[0], "correct the unit in the heading")
    else:
        found, sentence = place_columns(sheet, "imu")
        report.notes.append(sentence)
    report.notes += sheet.notes
    others = [t for t in tables_in(sheet) if t != "imu"]
    if others:
        report.notes.append(f"the file holds more: {', '.join(others)} (schuler convert writes each as a table)")
    time = clock(sheet, found, report) if "time" in found or not _ratebeside(sheet) else None
    if rate := _ratebeside(sheet):
        if time is None and "time" not in found:
            time = np.arange(1.0, len(sheet) + 1.0) / rate
            report.rate_hz, report.duration_s = rate, len(sheet) / rate
            report.units.append(f"time: no column, {rate:g} Hz as the file says")
    numbers = {n: sheet.columns[m.index] for n, m in found.items() if sheet.columns[m.index].dtype.kind == "f"}
    missing_numbers({n: v for n, v in numbers.items() if n != "time"}, report)
    named_increments = "dv_x" in found or "dtheta_x" in found
    accel = triple(numbers, "dv" if "dv_x" in found else "accel")
    gyro = triple(numbers, "dtheta" if "dtheta_x" in found else "gyro")
    good = np.ones(len(sheet), dtype=bool)
    for part in (accel, gyro):
        if part is not None:
            good &= np.isfinite(part).all(axis=1)
    if time is not None:
        good &= np.isfinite(time)
    if good.sum() < 10:
        report.notes.append(f"only {counted(int(good.sum()), 'whole row')}: too few to say more")
        return report
    time = time[good] if time is not None else None
    dt = 1.0 / report.rate_hz if report.rate_hz else None
    accel = accel[good] if accel is not None else None
    gyro = gyro[good] if gyro is not None else None
    scales = sheet.scalars
    force = _judge_accel(report, found, accel, dt, named_increments, scales)
    rates = _judge_gyro(report, found, gyro, force, dt, scales)
    for name, part in (("accelerometer", accel), ("gyro", gyro)):
        if part is not None:
            _judge_steps(report, name, part, dt)
    if force is not None:
        _judge_axis(report, force)
    step = dt or 0.01
    if force is not None or rates is not None:
        ticks: Array = time if time is not None else np.arange(1.0, int(good.sum()) + 1.0) * step
        report.still = still_stretches(ticks, rates, force) if report.rate_hz else []
        if report.rate_hz:
            report.noise = noise_of(ticks, rates, force, report.still)
    _advise(report, path, gyro is not None and accel is not None)
    return report


def _ratebeside(sheet: Sheet) -> float | None:
    return next(
        (sheet.scalars[k] for k in ("rate_hz", "sampling_rate", "fs", "freq") if sheet.scalars.get(k, 0) > 0), None
    )


def _judge_accel(
    report: CheckReport,
    found: dict[str, Match],
    accel: Array | None,
    dt: float | None,
    named_increments: bool,
    scales: dict[str, float],
) -> Array | None:
    """Specific force in m/s^2 where the unit can be told; kind, units and faults into the report."""
    file = report.file
    if accel is None:
        report.notes.append("no accelerometer columns (accel_x, accel_y, accel_z)")
        return None
    stem = "dv" if "dv_x" in found else "accel"
    counts = False
    unit = found[f"{stem}_x"].unit
    if not unit and "accel_lsb_g" in scales:
        accel, unit = accel * scales["accel_lsb_g"], "g"
        report.units.append(f"accelerometer: counts of {scales['accel_lsb_g']:g} g, as the file says")
        counts = True
    guess = guess_accel(accel, dt)
    if not guess.sure and named_increments and "increments in m/s" in guess.reason:
        guess = type(guess)("m/s", guess.reason, "increments")
    if not unit and not guess.sure:
        report.kind = "increments" if named_increments else None
        report.add(
            "accel_unit",
            f"the accelerometer has no unit, and {guess.reason}",
            f"schuler convert {file} {beside(file)} --accel-unit g   (with the right unit; for raw counts set "
            "scale_accel_g "
            "in [input])",
        )
        return None
    if not unit:
        unit = guess.unit
        report.kind = guess.kind
        report.units.append(f"accelerometer: taken as {guess.kind} in {unit}, because {guess.reason}")
        if guess.kind == "increments" and not named_increments:
            report.add(
                "increments",
                f"these are increments, not rates: {guess.reason}",
                "name the columns dv_x[m/s] ... and dtheta_x[rad] ...",
            )
        elif unit not in ("m/s^2", "m/s"):
            report.add(
                "accel_unit",
                f"the accelerometer has no unit and is probably in {unit}: {guess.reason}",
                f"schuler convert {file} {beside(file)} --accel-unit {unit}",
            )
    else:
        report.kind = "increments" if quantity_of(unit) == "speed" else "rates"
        if not counts:
            report.units.append(f"accelerometer: {report.kind} in {unit}, as its heading says")
    factor, text = unit_text(unit)
    push = to_si(accel * factor, text)
    size = float(np.median(norm(push)))
    want = G0 if report.kind == "rates" else G0 * dt if dt else None
    if want is not None and not 0.6 < size / want < 1.6:
        meant = _contradicted(report, accel, dt, unit, size)
        if not meant:
            return None
        push = to_si(accel, meant)
    if report.kind == "increments" and not dt:
        return None
    force = push / dt if report.kind == "increments" and dt else push
    report.specific_force = float(np.median(norm(force)))
    return force


def _contradicted(report: CheckReport, accel: Array, dt: float | None, unit: str, size: float) -> str:
    """A fault for an accelerometer not as long as gravity in the unit of its heading; the unit that fits, or ""."""
    guess = guess_accel(accel, dt)
    said = f"the accelerometer is said to be in {unit}, but its median length is {size:.4g} in SI"
    report.units = [u for u in report.units if not u.startswith("accelerometer")]
    if not guess.sure:
        removed = " (gravity may have been removed)" if size < 3.0 else ""
        report.add("accel_unit", f"{said}, far from gravity{removed}", "correct the unit in the heading")
        return ""
    if guess.kind != report.kind:
        names = "dv_x[m/s], dtheta_x[rad]" if guess.kind == "increments" else "accel_x[m/s^2], gyro_x[rad/s]"
        report.add(
            "increments", f"{said}: these are {guess.kind}, because {guess.reason}", f"name the columns {names} ..."
        )
        report.kind = guess.kind
    else:
        report.add(
            "accel_unit",
            f"{said}; it is probably in {guess.unit}, because {guess.reason}",
            f"schuler convert {report.file} {beside(report.file)} --accel-unit {guess.unit}",
        )
    report.units.append(f"accelerometer: {guess.kind} in {guess.unit}, because {guess.reason}")
    return guess.unit


def _judge_gyro(
    report: CheckReport,
    found: dict[str, Match],
    gyro: Array | None,
    force: Array | None,
    dt: float | None,
    scales: dict[str, float],
) -> Array | None:
    """Rates in rad/s where the unit can be told; units and faults into the report."""
    file = report.file
    if gyro is None:
        report.notes.append("no gyro columns (gyro_x, gyro_y, gyro_z)")
        return None
    stem = "dtheta" if "dtheta_x" in found else "gyro"
    unit = found[f"{stem}_x"].unit
    if not unit and "gyro_lsb_dps" in scales:
        gyro, unit = gyro * scales["gyro_lsb_dps"], "deg/s"
        report.units.append(f"gyro: counts of {scales['gyro_lsb_dps']:g} deg/s, as the file says")
    elif unit:
        report.units.append(f"gyro: {unit}, as its heading says")
    increments = report.kind == "increments" or (unit and quantity_of(unit) == "angle")
    if increments and not dt:
        return None
    rates = gyro / dt if increments and dt else gyro
    if unit:
        factor, text = unit_text(unit)
        rates = to_si(rates * factor, text if quantity_of(unit) != "angle" else f"{text}/s")
        claimed = unit_of(text if quantity_of(unit) != "angle" else f"{text}/s").name
        wrong = gyro_contradiction(rates, force, dt, claimed) if force is not None else None
        if wrong is None:
            return rates
        report.add(
            "gyro_unit",
            f"the gyro is said to be in {unit}, but {wrong.reason}: it is probably in {wrong.unit}",
            f"schuler convert {file} {beside(file)} --gyro-unit {wrong.unit}",
        )
        return to_si(gyro, wrong.unit) if not increments else None
    guess = guess_gyro(rates, force, dt)
    if not guess.sure:
        report.add(
            "gyro_unit",
            f"the gyro has no unit, and {guess.reason}",
            f"schuler convert {file} {beside(file)} --gyro-unit deg/s   (or rad/s: the maker's manual says)",
        )
        return None
    name = guess.unit.partition("/")[0] if increments else guess.unit
    report.units.append(f"gyro: taken as {report.kind or 'rates'} in {name}, because {guess.reason}")
    if guess.unit != "rad/s":
        report.add(
            "gyro_unit",
            f"the gyro has no unit and is probably in {name}: {guess.reason}",
            f"schuler convert {file} {beside(file)} --gyro-unit {guess.unit}",
        )
    return to_si(rates, guess.unit)


_LEVELLING = {"+z": (180, 0, 0), "+y": (-90, 0, 0), "-y": (90, 0, 0), "+x": (0, 90, 0), "-x": (0, -90, 0)}


def _judge_axis(report: CheckReport, force: Array) -> None:
    """Along which axis the accelerometer feels the support against gravity, and what to do where it is not -z."""
    mean = force.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < 0.7 * float(np.median(norm(force))):
        report.notes.append("gravity is seen along many directions: the sensor was turned about during the recording")
        return
    k = int(np.argmax(np.abs(mean)))
    report.gravity_axis = f"{'-' if mean[k] < 0 else '+'}{'xyz'[k]}"
    tilt = float(np.degrees(np.arccos(min(1.0, abs(mean[k]) / length))))
    if report.gravity_axis != "-z":
        rpy = ", ".join(str(v) for v in _LEVELLING[report.gravity_axis])
        flu = " (forward-left-up, or right-forward-up)" if report.gravity_axis == "+z" else ""
        report.add(
            "axes",
            "a level sensor with axes forward-right-down reads -g on z; this one reads +g on "
            f"{report.gravity_axis}{flu}",
            f"[mounting] imu_to_body_rpy_deg = [{rpy}]   (levels it; the last number turns its nose forward)",
        )
    elif tilt > 20.0:
        report.add(
            "axes",
            f"gravity is {tilt:.0f} deg away from the nearest axis ({report.gravity_axis}): the sensor is mounted at "
            "an angle",
            "[mounting] imu_to_body_rpy_deg = [roll, pitch, yaw] of the sensor in the vehicle",
        )


def _judge_steps(report: CheckReport, name: str, values: Array, dt: float | None) -> None:
    """A fault where the steps of the numbers are as coarse as the noise, so that they hide it."""
    noise, _ = quietest(values, dt or 0.01)
    steps = []
    for k in range(3):
        low, high = np.quantile(values[:, k], [0.25, 0.75])
        levels = np.unique(values[(values[:, k] >= low) & (values[:, k] <= high), k])
        if len(levels) < 2:
            continue
        gaps = np.diff(levels)
        steps.append(float(np.median(gaps[gaps > 1e-9 * np.abs(levels).max()])))
    if not steps:
        return
    step = max(steps)
    if noise < 0.4 * step:
        report.add(
            "quantised",
            f"the {name}'s numbers go in steps of {step:.3g}, coarser than its noise ({noise:.2g}); noise figures "
            "will be off",
            "log with more digits or at full resolution, if the recorder can",
        )


def _advise(report: CheckReport, path: Path, whole: bool) -> None:
    """The one or two lines to type next."""
    if not whole:
        report.next = [
            "an IMU needs gyro and accelerometer: put both into one table, or convert the folder that holds both"
        ]
        return
    codes = {f.code for f in report.faults}
    convert = [
        f for f in report.faults if f.type_next.startswith("schuler convert") or ": schuler convert" in f.type_next
    ]
    report.next = [
        f.type_next
        for f in report.faults
        if f not in convert and f.code in ("gyro_unit", "accel_unit", "time_unit", "increments", "not_increasing")
    ]
    if convert:
        options = [re.search(r"--(gyro|accel)-unit \S+", f.type_next) for f in convert]
        report.next.append(
            " ".join(["schuler convert", str(path), beside(str(path)), *sorted(m[0] for m in options if m)])
        )
    elif not codes & {"gyro_unit", "accel_unit", "time_unit", "increments", "not_increasing"}:
        report.next = [study_line("imu", path) + "   then: schuler run STUDY.toml"]
