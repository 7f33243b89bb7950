"""Which column of a file is which column of the contract, and in what unit its heading says it is."""

from __future__ import annotations

import re
from collections.abc import Container
from dataclasses import dataclass

from schuler.ground.aliases import UNIT_IN_NAME, plain, spellings
from schuler.ground.errors import InputError
from schuler.ground.tables import SCHEMAS, Column
from schuler.ground.units import quantity, split_header

# Endings of a heading that are a unit: gx_radps, lat_deg, depth_m. Counted only where the rest is a known name and the
# unit suits it.
_ENDINGS = {
    "rad/s": "radps rad_s rad_per_s rads rad_sec",
    "deg/s": "degps deg_s deg_per_s dps degs deg_sec degrees_per_second",
    "deg/h": "degph deg_h deg_per_h deg_hr dph",
    "m/s^2": "mps2 m_s2 mpss m_per_s2 ms2 mps_2 m_s_2",
    "g": "g gee",
    "mg": "mg",
    "m/s": "mps m_s m_per_s ms",
    "km/h": "kmh km_h kph",
    "kn": "kn kt kts knots",
    "cm/s": "cmps cm_s",
    "m": "m meters metres meter metre",
    "mm": "mm",
    "cm": "cm",
    "km": "km",
    "ft": "ft feet",
    "deg": "deg degrees degree dd",
    "1e-7 deg": "1e7 e7 deg_e7 dege7",
    "rad": "rad radians",
    "mrad": "mrad",
    "s": "s sec secs seconds",
    "ms": "ms msec millis milliseconds",
    "us": "us usec micros microseconds",
    "ns": "ns nsec nanos nanoseconds",
    "uT": "ut microtesla",
    "nT": "nt",
    "gauss": "gauss ga",
    "degC": "degc c celsius",
    "px": "px pixels",
}
ENDINGS: dict[str, list[str]] = {}
for _unit, _names in _ENDINGS.items():
    for _name in _names.split():
        ENDINGS.setdefault(_name, []).append(_unit)


@dataclass(frozen=True)
class Match:
    """column : the contract's name. index : of the file's column. unit : as the heading says, "" where it does not."""

    column: str
    index: int
    unit: str
    heading: str


def quantity_of(unit: str) -> str:
    """What a file's unit measures; powers of ten in front are allowed ("1e-7 deg")."""
    return quantity(unit_text(unit)[1])


def unit_text(unit: str) -> tuple[float, str]:
    """(factor, unit) of a unit as files write it: "1e-7 deg", "rad s^-1", "m s^-2"."""
    text = re.sub(r"\s*\*?\s*s\s*\^?\s*-\s*2$", "/s^2", unit.strip())
    text = re.sub(r"(?<=[A-Za-z])\s*\*?\s+s\s*\^?\s*-\s*1$|(?<=rad|deg)\s*s\^?-1$", "/s", text)
    scaled = re.match(r"^(1e-?\d+|10\^-?\d+)\s*\*?\s*(\D.*)$", text)
    if not scaled:
        return 1.0, text
    return float(scaled[1].replace("10^", "1e")), scaled[2]


def _suits(column: Column, unit: str) -> bool:
    """Whether a unit can stand for this column: its own quantity, or the increment of a rate."""
    want = quantity(column.unit)
    have = quantity_of(unit)
    return have == want or (have, want) in _INCREMENT_OF


_INCREMENT_OF = {("angle", "angular rate"), ("speed", "acceleration")}


def parse_heading(
    heading: str, table: str, complaints: list[tuple[str, str]] | None = None
) -> tuple[str, int, str] | None:
    """(contract column, preference, unit or "") of one heading, None where the table has no such column.

    Raises InputError for a unit that is not known or measures something else; with a list of complaints, (column,
    sentence) goes there and the unit counts as not said.
    """
    schema, known = SCHEMAS[table], spellings(table)
    try:
        name, unit = split_header(heading)
    except InputError:
        name, unit = heading, ""
    if re.fullmatch(r"\d+", unit):  # gyro_rad[0]: an index
        name, unit = f"{name}_{unit}", ""
    key = plain(name)
    if key in known:
        column, preference = known[key]
        if not unit:
            return column, preference, UNIT_IN_NAME.get(key, "")
        if schema[column].text:
            return column, preference, ""
        if unit == "G" and quantity(schema[column].unit) == "acceleration":
            unit = "g"
        fault = _unit_fault(heading, schema[column], unit)
        if fault and complaints is None:
            raise InputError(fault)
        if fault and complaints is not None:
            complaints.append((column, fault))
        return column, preference, "" if fault else unit
    words = key.split("_")
    for count in (3, 2, 1):
        base, ending = "_".join(words[:-count]), "_".join(words[-count:])
        if base in known and ending in ENDINGS:
            column, preference = known[base]
            for candidate in ENDINGS[ending]:
                if not schema[column].text and _suits(schema[column], candidate):
                    return column, preference, candidate
    return None


def _unit_fault(heading: str, column: Column, unit: str) -> str:
    """What is wrong with the unit of a heading, "" where nothing is."""
    try:
        if _suits(column, unit):
            return ""
    except InputError as error:
        return f"column {heading}: {error}"
    wants = quantity(column.unit)
    return (
        f"column {heading}: {unit} is a unit of {quantity_of(unit)}, but {column.name} is {_article(wants)}; "
        f"write {column.header}, or another unit of {wants}"
    )


def _article(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def match(
    headings: list[str], table: str, words: Container[int] = (), complaints: list[tuple[str, str]] | None = None
) -> tuple[dict[str, Match], list[str]]:
    """The best file column for each contract column of a table, and the headings that are of no use to it.

    words : indices of columns that hold text; numbers are preferred to them. complaints : see `parse_heading`.
    """
    best: dict[str, tuple[int, Match]] = {}
    unused = []
    for index, heading in enumerate(headings):
        found = parse_heading(heading, table, complaints) if heading else None
        if found is None:
            unused.append(heading)
            continue
        column, preference, unit = found
        preference = 2 * preference + (not unit)  # of two, the one that says its unit
        preference += 1000 if index in words and not SCHEMAS[table][column].text else 0
        if table == "imu" and unit:
            have = quantity_of(unit)
            for rate, increment, what in (("gyro", "dtheta", "angle"), ("accel", "dv", "speed")):
                if column.startswith(f"{rate}_") and have == what:  # gyro_x[rad] holds increments
                    column = f"{increment}_{column[-1]}"
        if column in best and best[column][0] <= preference:
            unused.append(heading)
            continue
        if column in best:
            unused.append(best[column][1].heading)
        best[column] = (preference, Match(column, index, unit, heading))
    return {c: m for c, (_, m) in best.items()}, [h for h in unused if h]


def check_unit(unit: str, want: str, option: str) -> str:
    """A unit that a person typed; InputError where it does not measure `want`."""
    if quantity_of(unit) != want:
        raise InputError(
            f"{option} {unit} is a unit of {quantity_of(unit)}, where {want} was expected, for example {_EXAMPLE[want]}"
        )
    return unit


_EXAMPLE = {"angular rate": "deg/s", "acceleration": "g"}
