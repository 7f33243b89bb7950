"""A stable-platform study judged: each channel's drift alone and all together, every algorithm, theory beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from schuler.inertial import platform_errors as theory
from schuler.inertial.platform import (
    PlatformCase,
    PlatformRun,
    PlatformTruth,
    navigate,
)
from schuler.inertial.platform_alignment import AlignmentRun, EndValues, Jump, Loop, Verdict

Array = NDArray[np.float64]
SIZE = "closed form of the size"
TILTED = "first order, tilted axes"
PI, FREE, SD, OPEN, PUBLISHED = (
    "position-independent",
    "free-azimuth",
    "strapdown",
    "strapdown-open-loop",
    "as-published",
)


@dataclass
class Curve:
    """A theory's error over time: north, east, m. kind : "closed form", "first order", `TILTED` (of the
    position-independent platform, whose axes stand off the vertical) or `SIZE` (no direction)."""

    label: str
    kind: str
    time: Array
    north: Array
    east: Array

    @property
    def error(self) -> Array:
        return np.hypot(self.north, self.east)


@dataclass
class DriftSet:
    """Every algorithm with one choice of drifts. name : "none", "channel-1" ... or "all"."""

    name: str
    title: str
    case: PlatformCase
    runs: dict[str, PlatformRun]
    curves: list[Curve] = field(default_factory=list)

    def largest(self, algorithm: str) -> float:
        """Largest great-circle error of an algorithm, m."""
        return float(self.runs[algorithm].error.max())

    def apart(self, one: str, other: str) -> float:
        """Largest distance between two algorithms' positions, m."""
        a, b = self.runs[one], self.runs[other]
        return float(np.hypot(a.north - b.north, a.east - b.east).max())

    def crossover(self, one: str, other: str) -> float | None:
        """Last time, s, at which the sizes of two errors cross; None where they do not after the first minute."""
        a, b = self.runs[one], self.runs[other]
        difference = a.error - b.error
        change = np.flatnonzero((difference[:-1] * difference[1:] < 0.0) & (a.time[1:] > 60.0))
        if not len(change):
            return None
        i = int(change[-1])
        share = difference[i] / (difference[i] - difference[i + 1])
        return float(a.time[i] + share * (a.time[i + 1] - a.time[i]))


@dataclass
class AlignmentReport:
    """Loops, transient, end values and switch. verdicts : (loop, verdict) of each requirement that was stated."""

    levelling: Loop
    azimuth: Loop
    run: AlignmentRun
    end: EndValues
    first_order: EndValues
    verdicts: list[tuple[Loop, Verdict]]
    jumps: list[Jump]
    gain_ratio: float


@dataclass
class ErrorMap:
    """(len(lat), len(heading)) great-circle error, m, of one algorithm at one time; lat, heading rad."""

    algorithm: str
    at: float
    lat: Array
    heading: Array
    error: Array


@dataclass
class PlatformDetails:
    """All of a platform study. `sets[-1]` is the study's own choice of drifts."""

    case: PlatformCase
    form: str
    algorithms: tuple[str, ...]
    at: tuple[float, ...]
    sets: list[DriftSet]
    truth: PlatformTruth
    gimbals: Array  # (n, 3) outer, middle, inner, rad, of the first platform algorithm, at truth.time
    alignment: AlignmentReport
    sensitivity_at: tuple[float, ...]
    sensitivity: Mapping[str, list[tuple[str, str, Array]]]
    maps: list[ErrorMap] = field(default_factory=list)

    @property
    def main(self) -> DriftSet:
        return self.sets[-1]

    @property
    def at_rest(self) -> bool:
        return self.case.lat_change == 0.0 and self.case.lon_change == 0.0

    def told(self, name: str) -> list[str]:
        """Lines for the terminal."""
        return terminal(self, name)


def drift_sets(
    case: PlatformCase, algorithms: Sequence[str], form: str, time: Array, walk: Array | None = None
) -> list[DriftSet]:
    """Without drift, each channel with a drift alone, and (where there is more than one) all together, last."""
    moving = [
        k
        for k in range(3)
        if case.drift[k] != 0.0 or case.drift_ramp[k] != 0.0 or (walk is not None and bool(np.any(walk[:, k])))
    ]
    chosen: list[tuple[str, str, list[int]]] = [("none", "Without drift", [])]
    chosen += [(f"channel-{k + 1}", f"Drift of channel {k + 1} alone", [k]) for k in moving]
    if len(moving) > 1:
        chosen.append(("all", "Drifts of channels " + " and ".join(str(k + 1) for k in moving), moving))
    sets = []
    for name, title, channels in chosen:
        keep = np.array([k in channels for k in range(3)], dtype=float)
        d1, d2, d3 = (float(x) for x in keep * case.drift)
        r1, r2, r3 = (float(x) for x in keep * case.drift_ramp)
        one = replace(case, drift=(d1, d2, d3), drift_ramp=(r1, r2, r3))
        part = None if walk is None else walk * keep
        runs = {a: navigate(one, a, form, time=time, walk=part) for a in algorithms}
        found = DriftSet(name, title, one, runs)
        if channels:
            found.curves = curves(one, runs, channels, time, part)
        sets.append(found)
    return sets


def curves(
    case: PlatformCase, runs: dict[str, PlatformRun], channels: Sequence[int], time: Array, walk: Array | None
) -> list[Curve]:
    """First-order theory along the path, and the closed forms where the vehicle rests and nothing else is wrong."""
    first = navigate(case, "first-order", time=time, walk=walk)
    found = [Curve("first order, any r = 0 platform", "first order", time, first.north, first.east)]
    if PI in runs and runs[PI].form == "exact":
        own = navigate(case, "first-order-tilted", time=time, walk=walk)
        found.append(Curve("first order, about its own axes", TILTED, time, own.north, own.east))
    rests = case.lat_change == 0.0 and case.lon_change == 0.0
    alone = replace(case, drift=(0.0, 0.0, 0.0)).without_errors() == replace(case, drift=(0.0, 0.0, 0.0))
    if not rests or not alone or len(channels) != 1 or walk is not None:
        return found
    k = channels[0]
    b, lat, psi = case.drift[k], case.lat, case.heading
    if k < 2:
        size = theory.level_drift(time, b, lat)
        # a size; the direction shown is that of the start: the computed position turns about the axis by -b
        axis = psi if k == 0 else psi + math.pi / 2.0
        label = "(32): R b (t - sin(w t)/w)"
        found.append(Curve(label, SIZE, time, -size * math.sin(axis), -size * math.cos(axis)))
    else:
        n, w = theory.azimuth_total(time, b, lat, psi)
        found.append(Curve("heading and tilt part together", "closed form", time, n, -w))
        if PUBLISHED in runs:
            n, w = theory.azimuth_tilt(time, b, lat, psi)
            found.append(Curve("(36): tilt part only", "closed form", time, n, -w))
    return found


def size_of(value: float) -> str:
    """A length in words a navigator reads."""
    if not math.isfinite(value):
        return "-"
    if value >= 9999.5:
        return f"{value / 1000.0:.2f} km"
    if value >= 100.0:
        return f"{value:.0f} m"
    if value >= 1.0:
        return f"{value:.1f} m"
    return f"{value:.2g} m"


def equalities(details: PlatformDetails) -> list[str]:
    """What is equal to what in this study, by how much it differs, and why. Every number is of this study."""
    said: list[str] = []
    told: set[str] = set()

    def why(topic: str, reason: str) -> str:
        """The reason, the first time it is needed."""
        if topic in told:
            return ""
        told.add(topic)
        return reason

    for found in details.sets:
        if found.name == "none":
            if PI in found.runs:
                said.append(_without_drift(found, details.form))
            continue
        which = found.title[0].lower() + found.title[1:]
        runs = found.runs
        if PI in runs and FREE in runs:
            said.append(f"{which}: {_two_platforms(found, details.form, why)}")
        if PI in runs and SD in runs:
            said.append(f"{which}: {_strapdown(found, why)}")
        if PUBLISHED in runs and found.case.drift[2] != 0.0 and (PI in runs or FREE in runs):
            largest = found.largest(PI if PI in runs else FREE)
            said.append(
                f"{which}: the published error model stays below {size_of(found.largest(PUBLISHED))}, the platform "
                f"itself reaches {size_of(largest)}."
                + why(
                    "published",
                    " The model lets the drift of channel 3 tilt the platform but not turn it: its heading is the "
                    "one without drift. A real platform turns by b t, and the algorithm, which cannot see it, lays "
                    "the whole journey (at rest: the Earth's own turn) in the wrong direction.",
                )
            )
        for curve in found.curves:
            against = FREE if FREE in runs else PI
            against = PUBLISHED if "tilt part only" in curve.label else PI if curve.kind == TILTED else against
            if against in runs:
                run = runs[against]
                kind = "," if curve.kind in ("first order", TILTED) else f" ({curve.kind})"
                gap = np.hypot(run.north - curve.north, run.east - curve.east)
                off = float((np.abs(run.error - curve.error) if curve.kind == SIZE else gap).max())
                said.append(
                    f"{which}: {curve.label}{kind} is at most {size_of(off)} from {against}, "
                    f"{100.0 * off / max(found.largest(against), 1e-9):.2g} % of its largest error."
                )
    return said


Why = Callable[[str, str], str]


def _two_platforms(found: DriftSet, form: str, why: Why) -> str:
    apart, largest = found.apart(PI, FREE), found.largest(FREE)
    share = apart / largest if largest > 0.0 else 0.0
    if form == "literal" or share > 0.05:
        return (
            f"position-independent ({form}) and free azimuth lie up to {size_of(apart)} apart, in an error of up to "
            f"{size_of(largest)}."
        )
    return (
        f"position-independent and free azimuth are the same platform: at most {size_of(apart)} apart in an error of "
        f"up to {size_of(largest)} ({100.0 * share:.2g} %)."
    ) + why(
        "same",
        " With r = 0 and a level platform the command p = -v/z, q = u/z of inertial velocity is the free-azimuth "
        "command written without latitude and longitude. What remains comes from the gyro axes, which alignment "
        "leaves off the vertical by the deflection of the plumb line.",
    )


def _strapdown(found: DriftSet, why: Why) -> str:
    a, b = found.runs[PI], found.runs[SD]
    opposite = float(np.hypot(a.north + b.north, a.east + b.east).max())
    words = (
        f"strapdown with gravity from its own position ends {size_of(float(b.error[-1]))} off, the platform "
        f"{size_of(float(a.error[-1]))} (sizes {size_of(abs(float(a.error[-1]) - float(b.error[-1])))} apart)"
    )
    if opposite < 0.2 * found.largest(PI):
        words += ", on the opposite side" + why("side", ", because its gyro measures true rate plus drift")
    words += "." + why(
        "kind",
        " Gravity tunes both to Schuler's period, so there is no difference of kind; of degree there is one where the "
        "gyro axes of the strapdown turn with the body and those of the platform do not.",
    )
    if OPEN in found.runs:
        words += f" Without gravity feedback it ends {size_of(float(found.runs[OPEN].error[-1]))} off" + why(
            "open", ": the cubic growth that is often charged to strapdown belongs to the missing feedback"
        )
        words += "."
    return words


def _without_drift(found: DriftSet, form: str) -> str:
    largest = found.largest(PI)
    if found.case != found.case.without_errors():
        return (
            f"without drift: the other errors of this study (accelerometers, torquers, gimbal) put the {form} "
            f"position-independent form {size_of(largest)} off at most."
        )
    if found.case.earth == "ellipsoid":
        return (
            f"without drift: the {form} position-independent form is {size_of(largest)} off at most; it goes on with "
            "a sphere of constant z while the vehicle moves on the ellipsoid."
        )
    if form == "exact":
        return (
            f"without drift: the exact position-independent form is {size_of(largest)} off at most. It needs neither "
            "latitude nor longitude for its commands, and loses nothing by it."
        )
    why = (
        "r_m = 0 leaves out that an axis 3 which stands off the vertical turns the m frame"
        if form == "literal"
        else "r_m = phi_x q - phi_y p is right to first order of the tilt, and second order remains"
    )
    return f"without drift: the {form} position-independent form is up to {size_of(largest)} off by itself: {why}."


def terminal(details: PlatformDetails, name: str) -> list[str]:
    """About ten lines: motion, errors of every algorithm at the times asked for, alignment."""
    case = details.case
    compass = (-math.degrees(case.heading)) % 360.0
    motion = "at rest" if details.at_rest else f"moving at up to {case.speed():.0f} m/s"
    lines = [
        f"{name}: stable platform {motion} at {math.degrees(case.lat):.4g} deg, platform heading "
        f"{math.degrees(case.heading):.4g} deg from north to west (compass {compass:.4g} deg), {case.duration:g} s, "
        f"form {details.form}",
    ]
    for found in details.sets:
        if found.name == "none" and len(details.sets) > 1:
            lines.append("without drift, largest: " + _listed({a: found.largest(a) for a in found.runs}))
            continue
        lines.append(f"{found.title.lower()}, error in m at " + ", ".join(f"{t:g} s" for t in details.at))
        for algorithm, run in found.runs.items():
            values = "".join(f" {e:11.3f}" for e in run.at(details.at)[:, 0])
            label = algorithm + (" (not physical)" if algorithm == PUBLISHED and found.case.drift[2] else "")
            lines.append(f"  {label:31s}{values}")
    a = details.alignment
    lines.append(
        f"alignment leaves phi_x {1e3 * a.end.phi_x:.6f}, phi_y {1e3 * a.end.phi_y:.6f} mrad; levelling settles in "
        f"{a.levelling.response().settling_s:.0f} s, azimuth in {a.azimuth.response().settling_s:.0f} s"
    )
    for loop, v in a.verdicts:
        lines.append(f"  {requirement(loop, v)}")
    for m in details.maps:
        i, j = np.unravel_index(int(np.argmax(m.error)), m.error.shape)
        lines.append(
            f"map of {m.error.size} cases, {m.algorithm} at {m.at:g} s: {size_of(float(m.error.min()))} to "
            f"{size_of(float(m.error.max()))}, largest at latitude {math.degrees(m.lat[i]):.0f} deg, heading "
            f"{math.degrees(m.heading[j]):.0f} deg"
        )
    return lines


def requirement(loop: Loop, verdict: Verdict) -> str:
    """A requirement and whether it is met, in a line."""
    by = "" if math.isinf(verdict.in_hand) else f" by {abs(verdict.in_hand):.4g} {verdict.unit}"
    word = "met" if verdict.met else "MISSED"
    value = 0.0 if abs(verdict.reached) < 1e-9 else verdict.reached
    reached = "without limit" if math.isinf(value) else f"{value:.4g} {verdict.unit}"
    return f"{loop.name}: {verdict.what} {reached}, asked {verdict.required:g} {verdict.unit}: {word}{by}"


def _listed(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {size_of(value)}" for name, value in values.items())
