"""Consistency figures in words: which sigmas are too small or too large, by what factor, and what to type.

A good run gives no words: the limits leave room for what recordings do (correlated receivers, careful settings).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

TOO_SMALL = 2.0  # measured size of innovations over their stated sigma, from which a sentence is said
TOO_LARGE = 0.15  # receivers and careful settings are often a few times too large
NEES_HIGH = 9.0  # of one run, whose errors are correlated: sigmas three times too small
INSIDE = 0.95  # of the errors inside 3 sigma: then a large mean NEES is of few moments
FEW = 30  # innovations, below which nothing is said
LEFT_OUT = 0.25  # share that contradicted the filter
# kind of innovation -> table, key of [noise], unit
_KEYS = {
    "gnss_position": ("gnss", "gnss_m"),
    "gnss_velocity": ("gnss", "gnss_mps"),
    "gnss_height": ("gnss", "gnss_m"),
    "gnss_velocity_down": ("gnss", "gnss_mps"),
    "surface_fix": ("gnss", "gnss_m"),
    "speed": ("speed", "speed_mps"),
    "dvl": ("dvl", "dvl_mps"),
    "depth": ("depth", "depth_m"),
    "height": ("height", "height_m"),
    "magnetometer": ("imu", "mag_deg"),
    "attitude": ("attitude", "attitude_deg"),
    "ranges": ("ranges", "range_m"),
}
_STD = {
    "gnss_m": "std_north", "gnss_mps": "std_v_north", "speed_mps": "std_speed", "dvl_mps": "std_v_x",
    "depth_m": "std_depth", "height_m": "std_height", "attitude_deg": "std_heading", "range_m": "std_range",
}  # fmt: skip


def sigma_factor(row: Mapping[str, Any]) -> float | None:
    """How many times larger innovations are than their sigma: from the median NIS where it is known, which few outliers
    do not move, else the root of the mean."""
    factor = _number(row.get("sigma_factor"))
    if factor is not None:
        return factor
    mean = _number(row.get("mean"))
    return None if mean is None or mean < 0.0 else math.sqrt(mean)


def consistency_words(
    summary_consistency: Mapping[str, Any],
    noise: Mapping[str, Any] | None = None,
    columns: Mapping[str, Collection[str]] | None = None,
) -> list[str]:
    """Sentences on a "consistency" of summary.json; none for a good run.

    noise : the values of [noise], for what to type. columns : of each table that was given; where one has std_
    columns, those count.
    """
    said = []
    nis = summary_consistency.get("nis")
    for kind, row in (nis if isinstance(nis, Mapping) else {}).items():
        if not isinstance(row, Mapping):
            continue
        said += _of_kind(str(kind), row, noise or {}, columns or {})
    inside = _number(summary_consistency.get("inside_3_sigma"))
    if said or (inside is not None and inside > INSIDE):  # the cause is told already, or few moments make the mean
        return said
    for key in ("position", "velocity", "attitude"):
        value = _number(summary_consistency.get(f"nees_{key}"))
        if value is not None and value > NEES_HIGH:
            said.append(
                f"the sigmas of the {key} are about {_factor(math.sqrt(value))} times too small: NEES {_figure(value)} "
                "against the reference, where 1 is expected; larger noise of the sensors that carry it (bias, random "
                "walk under [imu]; [noise]) makes them honest"
            )
    return said


def _of_kind(
    kind: str, row: Mapping[str, Any], noise: Mapping[str, Any], columns: Mapping[str, Collection[str]]
) -> list[str]:
    used, out = _number(row.get("n")) or 0.0, _number(row.get("left_out")) or 0.0
    factor = sigma_factor(row)
    if used + out < FEW or factor is None:
        return []
    said = []
    median, mean = _number(row.get("median")), _number(row.get("mean")) or 0.0
    nis = f"NIS {_figure(mean)}" if median is None else f"median NIS {_figure(median)}"
    if factor >= TOO_SMALL:
        said.append(
            f"the sigmas of {kind} are about {_factor(factor)} times too small: {nis}, where 1 is expected; "
            f"{_type(kind, factor, noise, columns)}"
            + (" (a wrong arm or delay looks the same)" if kind.startswith("gnss_") else "")
        )
    elif factor <= TOO_LARGE and kind.startswith("gnss_velocity"):  # others err slowly, or are bounds: that is no fault
        said.append(
            f"the sigmas of {kind} are about {_factor(1.0 / factor)} times too large: {nis}, where 1 is expected; "
            f"{_type(kind, factor, noise, columns)}"
        )
    if out > LEFT_OUT * (used + out):
        said.append(
            f"{kind}: {100.0 * out / (used + out):.0f} % of the measurements contradicted the filter and were left "
            "out: the sensor or its sigmas are wrong, or the filter went astray"
        )
    return said


def _type(kind: str, factor: float, noise: Mapping[str, Any], columns: Mapping[str, Collection[str]]) -> str:
    if kind not in _KEYS:
        return f"its sigma wants to be {_times(factor)}"
    table, key = _KEYS[kind]
    std = _STD.get(key)
    if std is not None and std in columns.get(table, ()):
        return (
            f"multiply the {'std_v_' if key == 'gnss_mps' else 'std_'} columns of the {table} table by {_short(factor)}"
        )
    value = noise.get(key)
    if isinstance(value, Sequence) and not isinstance(value, str):
        typed = "[" + ", ".join(_short(float(v) * factor) for v in value) + "]"
    elif _number(value) is not None:
        typed = _short(float(value) * factor)  # type: ignore[arg-type]
    else:
        return f"make {key} under [noise] {_times(factor)}, or its std_ columns"
    return f"type {key} = {typed} under [noise]"


def _times(factor: float) -> str:
    return f"{_short(factor)} times larger" if factor >= 1.0 else f"{_short(1.0 / factor)} times smaller"


def _factor(value: float) -> str:
    return f"{value:.0f}" if value >= 4.5 else f"{value:.1f}"


def _figure(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def _short(value: float) -> str:
    return f"{value:.2g}"


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)
