"""The tables of the contract: columns, units, validation and its messages.

A `Table` holds numpy columns in SI and radians (the file's degrees are gone), plus `time` in seconds on one clock.
`SCHEMAS` says for each table which columns there are, in what unit a file holds them and which of them are needed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Table:
    """Named columns of equal length. Numbers are float64 in SI and radians; `id` columns are str arrays.

    name : the contract's name ("imu", "gnss", "speed", "dvl", "depth", "attitude", "reference", ...).
    kind : "rates" or "increments" for an imu table, else "".
    notes : what a reader assumed, converted or left out, as sentences.

    Needed columns hold no NaN. An optional column may: NaN there means "not known in this row".
    """

    name: str
    columns: dict[str, NDArray]
    kind: str = ""
    source: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def time(self) -> Array:
        return self.columns["time"]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def __getitem__(self, column: str) -> NDArray:
        return self.columns[column]

    def stack(self, *columns: str) -> Array:
        """(n, k) array of the named columns."""
        return np.column_stack([self.columns[c] for c in columns])

    def where(self, mask: NDArray[np.bool_]) -> Table:
        """The rows that a boolean mask keeps."""
        return Table(self.name, {k: v[mask] for k, v in self.columns.items()}, self.kind, self.source, list(self.notes))


Tables = Mapping[str, Table]

# File unit -> the unit that a Table holds. Angles become radians and microtesla tesla; the others are SI already, and
# degrees Celsius and pixels stay what they are.
INSIDE = {"deg": "rad", "deg/s": "rad/s", "uT": "T"}


@dataclass(frozen=True)
class Column:
    """One column: its name, its unit in a file ("" for text and pure numbers) and whether the table needs it."""

    name: str
    unit: str
    required: bool = False
    text: bool = False

    @property
    def si(self) -> str:
        """The unit that a Table holds."""
        return INSIDE.get(self.unit, self.unit)

    @property
    def header(self) -> str:
        """The contract's header, e.g. `lat[deg]`."""
        return f"{self.name}[{self.unit}]" if self.unit else self.name


@dataclass(frozen=True)
class Schema:
    """The columns of one table, in the order they are written.

    choices : groups of which one is needed in full, e.g. ("lat", "lon") or ("north", "east").
    many_per_time : several rows may carry the same time (one for each beacon or landmark seen).
    """

    name: str
    columns: tuple[Column, ...]
    choices: tuple[tuple[tuple[str, ...], ...], ...] = ()
    many_per_time: bool = False

    def __contains__(self, column: str) -> bool:
        return any(c.name == column for c in self.columns)

    def __getitem__(self, column: str) -> Column:
        for c in self.columns:
            if c.name == column:
                return c
        raise KeyError(f"table {self.name} has no column {column!r}; it has {', '.join(c.name for c in self.columns)}")

    @property
    def has_time(self) -> bool:
        return "time" in self

    def needed(self, present: Iterable[str]) -> tuple[str, ...]:
        """The columns that must be finite in every row, given the columns that are present."""
        have = set(present)
        names = [c.name for c in self.columns if c.required]
        for choice in self.choices:
            names += next((list(group) for group in choice if have.issuperset(group)), [])
        return tuple(names)

    def missing(self, present: Iterable[str]) -> list[str]:
        """One entry for each column, or choice of columns, that the table needs and does not have."""
        have = set(present)
        absent = [c.header for c in self.columns if c.required and c.name not in have]
        for choice in self.choices:
            if not any(have.issuperset(group) for group in choice):
                best = max(choice, key=lambda group: len(have.intersection(group)))
                if have.intersection(best):
                    absent += [self[n].header for n in best if n not in have]
                else:
                    absent.append(" or ".join(", ".join(self[n].header for n in group) for group in choice))
        return absent


def _schema(name: str, needed: str, optional: str = "", choices: str = "", many: bool = False) -> Schema:
    """A schema from lists of headers; `choices` holds "group | group" with one choice of groups a line."""
    columns: dict[str, Column] = {}

    def add(text: str, required: bool) -> list[str]:
        names = []
        for header in text.split():
            base, _, unit = header.rstrip("]").partition("[")
            columns.setdefault(base, Column(base, unit, required, text=base in TEXT_COLUMNS))
            names.append(base)
        return names

    add(needed, True)
    groups = []
    for line in filter(None, (part.strip() for part in choices.split("\n"))):
        groups.append(tuple(tuple(add(group, False)) for group in line.split("|")))
    add(optional, False)
    return Schema(name, tuple(columns.values()), tuple(groups), many)


TEXT_COLUMNS = ("id", "position", "kind", "axis")

_PLACE = "lat[deg] lon[deg] | north[m] east[m]"
_VELOCITY = "v_north[m/s] v_east[m/s] v_down[m/s]"
_STD_PLACE = "std_north[m] std_east[m] std_down[m]"
_STD_VELOCITY = "std_v_north[m/s] std_v_east[m/s] std_v_down[m/s]"
_ANGLES = "roll[deg] pitch[deg] heading[deg]"
_STD_ANGLES = "std_roll[deg] std_pitch[deg] std_heading[deg]"
_RATES = "gyro_x[rad/s] gyro_y[rad/s] gyro_z[rad/s] accel_x[m/s^2] accel_y[m/s^2] accel_z[m/s^2]"
_INCREMENTS = "dtheta_x[rad] dtheta_y[rad] dtheta_z[rad] dv_x[m/s] dv_y[m/s] dv_z[m/s]"

SCHEMAS: dict[str, Schema] = {
    s.name: s
    for s in (
        _schema("imu", "time[s]", "mag_x[uT] mag_y[uT] mag_z[uT] temperature[degC]", f"{_RATES} | {_INCREMENTS}"),
        _schema(
            "gnss", "time[s]", f"height[m] {_STD_PLACE} {_VELOCITY} {_STD_VELOCITY} course[deg] speed[m/s]", _PLACE
        ),
        _schema("speed", "time[s]", "dheading[rad] std_speed[m/s]", "speed[m/s] | ddist[m]"),
        _schema("dvl", "time[s] v_x[m/s] v_y[m/s] v_z[m/s]", "std_v_x[m/s] std_v_y[m/s] std_v_z[m/s]"),
        _schema("depth", "time[s] depth[m]", "std_depth[m]"),
        _schema("attitude", "time[s] roll[deg] pitch[deg]", _STD_ANGLES, "heading[deg] | heading_mag[deg]"),
        _schema("height", "time[s] height[m]", "std_height[m]"),
        _schema("ranges", "time[s] id range[m]", "std_range[m]", many=True),
        _schema("lidar", "time[s] range[m] azimuth[deg] elevation[deg]", "id std_range[m]", many=True),
        _schema("height_model", "lat[deg] lon[deg] height[m]"),
        _schema("landmarks", "id", f"height[m] {_STD_PLACE}", _PLACE),
        _schema("sightings", "time[s] id u[px] v[px]", "std_u[px] std_v[px]", many=True),
        _schema("reference", "time[s]", f"height[m] {_VELOCITY} {_ANGLES} {_STD_PLACE}", f"{_PLACE} | {_ANGLES}"),
        _schema(
            "solution",
            "time[s]",
            f"height[m] {_VELOCITY} {_ANGLES} {_STD_PLACE} {_STD_VELOCITY} {_STD_ANGLES}",
            _PLACE,
        ),
        _schema(
            "positions",
            "",
            "position kind start[s] end[s] gamma[deg] beta[deg] azimuth[deg] rate[deg/s] axis angle[deg]",
        ),
    )
}


def validate(table: Table) -> list[str]:
    """The faults of a table, one sentence each; an empty list when it can be used.

    Checked: needed columns, equal lengths, NaN in needed columns, time strictly increasing (not decreasing where
    several rows may share a time), latitude within +-90 deg, pitch within +-90 deg, sigmas and ranges above zero.
    """
    schema = SCHEMAS.get(table.name)
    if schema is None:
        return [f"there is no table named {table.name!r}; tables are {', '.join(SCHEMAS)}"]
    who = table.source or table.name
    faults = [f"{who}: column {header} is missing" for header in schema.missing(table.columns)]
    lengths = {len(v) for v in table.columns.values()}
    if len(lengths) > 1:
        return [*faults, f"{who}: columns have different lengths ({', '.join(str(n) for n in sorted(lengths))})"]
    if not len(table):
        return [*faults, f"{who}: no rows"]
    for name in schema.needed(table.columns):
        values = table.columns.get(name)
        if values is None or values.dtype.kind not in "fiu":
            continue
        bad = ~np.isfinite(values.astype(float))
        if bad.any():
            faults.append(f"{who}: {name} is not a number in {int(bad.sum())} rows, first in row {_first(bad)}")
    if "time" in table and schema.has_time:
        faults += _time_faults(who, table.time, schema.many_per_time)
    for name, limit in (("lat", np.pi / 2), ("pitch", np.pi / 2), ("lon", 2 * np.pi)):
        if name in table and name in schema:
            with np.errstate(invalid="ignore"):
                out = np.abs(table[name]) > limit * (1 + 1e-12)
            if out.any():
                worst, most = np.rad2deg(np.nanmax(np.abs(table[name]))), np.rad2deg(limit)
                faults.append(f"{who}: {name} reaches {worst:.6g} deg, outside +-{most:g}, first in row {_first(out)}")
    for name, values in table.columns.items():
        if (name.startswith("std_") or name == "range") and name in schema:
            with np.errstate(invalid="ignore"):
                out = values <= 0
            if out.any():
                faults.append(f"{who}: {name} is zero or negative in {int(out.sum())} rows, first in row {_first(out)}")
    return faults


def _first(mask: NDArray[np.bool_]) -> int:
    """Row number, counted from 1, of the first True."""
    return int(np.argmax(mask)) + 1


def _time_faults(who: str, time: Array, many: bool) -> list[str]:
    step = np.diff(time)
    faults = []
    if (step < 0).any():
        row = int(np.argmax(step < 0)) + 1
        faults.append(f"{who}: time goes back from {time[row - 1]:.6f} to {time[row]:.6f} s at row {row + 1}")
    if not many and (step == 0).any():
        row = int(np.argmax(step == 0)) + 1
        faults.append(
            f"{who}: {int((step == 0).sum())} rows repeat the time of the row before, first at row {row + 1} "
            f"({time[row]:.6f} s)"
        )
    return faults
