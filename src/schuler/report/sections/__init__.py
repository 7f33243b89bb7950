"""The chapters of a page, by kind of study.

A chapter is a function of the `View` that gives a `Section`, or None where the result has nothing for it. A new kind
adds its own list here and its functions in a module beside these.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from schuler.report.parts import Opening, Section
from schuler.report.sections import (
    ahrs,
    consistency,
    errors,
    opening,
    optics,
    planar,
    platform,
    record,
    states,
    strapdown,
    sweep,
    track,
)
from schuler.report.view import View

Chapter = Callable[[View], Section | None]

_AIDED: tuple[Chapter, ...] = (
    track.track,
    track.surfacings,
    errors.position,
    errors.attitude,
    errors.velocity,
    errors.depth,
    states.gyro_biases,
    states.learnt,
    optics.sightings,
    optics.yaw,
    optics.ground,
    sweep.sweep,
    consistency.distrust,
    consistency.innovations,
    consistency.honesty,
    record.figures_table,
    record.assumed,
    record.made,
    record.cite,
)

_PLATFORM: tuple[Chapter, ...] = (
    platform.path,
    platform.errors,
    platform.said,
    platform.motion,
    platform.alignment,
    platform.maps,
    platform.sensitivity,
    record.assumed,
    record.made,
    platform.cite,
)

_STRAPDOWN: tuple[Chapter, ...] = (
    strapdown.growth,
    strapdown.table,
    track.track,
    errors.position,
    errors.attitude,
    errors.velocity,
    strapdown.floor,
    consistency.honesty,
    record.figures_table,
    record.assumed,
    record.made,
    record.cite,
)

_PLANAR: tuple[Chapter, ...] = (
    planar.track,
    errors.position,
    errors.attitude,
    errors.velocity,
    states.gyro_biases,
    states.learnt,
    planar.beacons,
    sweep.sweep,
    consistency.distrust,
    consistency.innovations,
    consistency.honesty,
    record.figures_table,
    record.assumed,
    record.made,
    record.cite,
)

_AHRS: tuple[Chapter, ...] = (
    ahrs.errors,
    ahrs.attitude,
    states.gyro_biases,
    ahrs.magnetometer,
    states.learnt,
    consistency.innovations,
    ahrs.honesty,
    record.figures_table,
    record.assumed,
    record.made,
    record.cite,
)

CHAPTERS: dict[str, tuple[Chapter, ...]] = {
    "auv": _AIDED,
    "aided": _AIDED,
    "planar": _PLANAR,
    "ahrs": _AHRS,
    "platform": _PLATFORM,
    "strapdown": _STRAPDOWN,
}
OPENINGS: dict[str, Callable[[View], Opening]] = {
    "auv": opening.aided,
    "aided": opening.aided,
    "ahrs": ahrs.opening,
    "platform": platform.opening,
    "strapdown": strapdown.opening,
}


def chapters(kind: str) -> Sequence[Chapter]:
    return CHAPTERS.get(kind, _AIDED)


def opening_of(kind: str) -> Callable[[View], Opening]:
    return OPENINGS.get(kind, opening.aided)
