"""Tables in and out: `read_table` makes a contract table of a file, `write_table` writes one.

A reader accepts other names and units, says in `notes` what it took for what and what it left out, and raises
InputError with one sentence where it would have to choose blindly.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import SCHEMAS, Table, validate
from schuler.ground.units import to_si
from schuler.io.clean import clean_time, drop_held, drop_incomplete, times_of
from schuler.io.guess import guess_angles, guess_field, guess_place
from schuler.io.headings import Match, check_unit, match, unit_text
from schuler.io.headless import place_columns
from schuler.io.imu import imu_columns
from schuler.io.limits import FEW, drop_absurd
from schuler.io.sheets import Sheet, read_sheet
from schuler.io.writing import write_table as write_table

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReadOptions:
    """What a person may say about a file.

    gyro_unit, accel_unit : units of the imu columns, whatever the headings say. trust_units : keep the units of the
    headings although the numbers speak against them. rate_hz : of an imu file without a time column; such times are
    k / rate after start_s. scale_gyro_deg_per_s, scale_accel_g : value of one count of a raw recording.
    """

    gyro_unit: str | None = None
    accel_unit: str | None = None
    trust_units: bool = False
    rate_hz: float | None = None
    scale_gyro_deg_per_s: float | None = None
    scale_accel_g: float | None = None
    start_s: float = 0.0


def read_table(
    path: str | Path,
    name: str,
    *,
    gyro_unit: str | None = None,
    accel_unit: str | None = None,
    trust_units: bool = False,
    rate_hz: float | None = None,
    scale_gyro_deg_per_s: float | None = None,
    scale_accel_g: float | None = None,
    start_s: float = 0.0,
) -> Table:
    """One table of the contract from a CSV, .csv.gz, npz or parquet file; SI and radians inside.

    name : "imu", "gnss", ... (`SCHEMAS`); the options are those of `ReadOptions`. Rows without a needed value and rows
    that repeat a time are left out and counted in `notes`. Raises InputError, one sentence, for what cannot be used.
    """
    options = ReadOptions(
        gyro_unit, accel_unit, trust_units, rate_hz, scale_gyro_deg_per_s, scale_accel_g, start_s
    )  # fmt: skip
    return table_of(read_sheet(path), name, options)


def table_of(sheet: Sheet, name: str, options: ReadOptions | None = None) -> Table:
    """The same from columns that are already read."""
    if name not in SCHEMAS:
        raise InputError(f"there is no table named {name!r}; tables are {', '.join(SCHEMAS)}")
    work = Work(sheet, name, options or ReadOptions())
    work.find()
    work.convert()
    return work.table()


@dataclass
class Work:
    """One reading in progress."""

    sheet: Sheet
    name: str
    options: ReadOptions
    found: dict[str, Match] = field(default_factory=dict)
    columns: dict[str, NDArray] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    kind: str = ""

    @property
    def who(self) -> str:
        return self.sheet.path.name

    def say(self, sentence: str) -> None:
        self.notes.append(f"{self.who}: {sentence}")

    def raw(self, column: str) -> NDArray:
        return self.sheet.columns[self.found[column].index]

    def numbers(self, column: str) -> Array:
        """A file column as numbers; InputError where it holds words."""
        values = self.raw(column)
        if values.dtype.kind == "U":
            heading = self.found[column].heading or f"number {self.found[column].index + 1}"
            bad = next(v for v in values if not _is_float(v))
            raise InputError(f"{self.who}: column {heading} holds text ({str(bad)[:30]!r}) where numbers were expected")
        return values

    def find(self) -> None:
        """Which column of the file is which of the contract."""
        schema = SCHEMAS[self.name]
        self.notes += self.sheet.notes
        if self.sheet.has_headings:
            words = {i for i, c in enumerate(self.sheet.columns) if c.dtype.kind == "U"}
            try:
                self.found, _ = match(self.sheet.headings, self.name, words)
            except InputError as error:
                raise InputError(f"{self.who}: {error}") from None
        else:
            self.found, sentence = place_columns(self.sheet, self.name)
            self.say(sentence)
        absent = schema.missing({*self.found, *self._time_otherwise()})
        if absent and self.name == "imu":
            mixed = {"gyro_x", "dv_x"} <= self.found.keys() or {"dtheta_x", "accel_x"} <= self.found.keys()
            if mixed and not {"gyro_x", "accel_x"} <= self.found.keys():
                raise InputError(
                    f"{self.who}: rates and increments are mixed; give gyro_x[rad/s] with accel_x[m/s^2], or "
                    "dtheta_x[rad] "
                    "with dv_x[m/s]"
                )
        if absent:
            headings = ", ".join(h for h in self.sheet.headings if h)
            more = f"; it has {headings[:200]}" if headings else ""
            several = "columns" if len(absent) > 1 or "," in absent[0] else "column"
            hint = ""
            if absent == ["time[s]"] and self.name == "imu":
                hint = '; for rows at a steady rate set rate_hz in [input], or name the column "time[s]"'
            raise InputError(
                f"{self.who}: {several} {', '.join(absent)} of table {self.name} "
                f"{'are' if several[-1] == 's' else 'is'} missing{more}{hint}"
            )
        for column in schema.columns:
            if column.text and column.name in self.found:
                self.columns[column.name] = _words(self.raw(column.name))

    def _time_otherwise(self) -> set[str]:
        """Time may come from a rate instead of a column."""
        return {"time"} if self.name == "imu" and "time" not in self.found and self._rate() else set()

    def _rate(self) -> float | None:
        if self.options.rate_hz is not None:
            return self.options.rate_hz
        for key in ("rate_hz", "sampling_rate", "fs", "freq", "rate"):
            if self.sheet.scalars.get(key, 0.0) > 0.0:
                return self.sheet.scalars[key]
        return None

    def convert(self) -> None:
        """Everything to SI and radians, by the heading's unit or by a guess that is noted."""
        schema = SCHEMAS[self.name]
        if "time" in self.found:
            times, sentences = times_of(self.raw("time"), self.found["time"], self.name, self.who)
            self.columns["time"] = times
            self.notes += sentences
        elif schema.has_time:
            rate = self._rate()
            assert rate is not None
            self.columns["time"] = self.options.start_s + np.arange(1, len(self.sheet) + 1) / rate
            self.say(f"no time column; rows are stamped {rate:g} times a second")
        if self.name == "imu":
            self._imu()
        self._group(("lat", "lon"), "deg")
        self._group(("roll", "pitch", "heading", "heading_mag"), "deg")
        self._group(("mag_x", "mag_y", "mag_z"), "uT")
        assumed: dict[str, list[str]] = {}
        for column in schema.columns:
            name = column.name
            if name not in self.found or name in self.columns:
                continue
            unit = self.found[name].unit
            if not unit and column.unit:
                unit = column.unit
                assumed.setdefault(unit, []).append(self.found[name].heading or name)
            self.columns[name] = scaled(self.numbers(name), unit) if unit else self.numbers(name)
        for unit, headings in assumed.items():
            self.say(f"{', '.join(headings)} without a unit: taken as {unit}")

    def _group(self, names: tuple[str, ...], usual: str) -> None:
        """Columns that share a unit; one guess for those that have none."""
        have = [n for n in names if n in self.found and n not in self.columns]
        if not have:
            return
        values = {n: self.numbers(n) for n in have}
        bare = [n for n in have if not self.found[n].unit]
        units = {self.found[n].unit for n in have} - {""}
        if not bare:
            unit = ""
        elif len(units) == 1:
            unit = units.pop()
        else:
            if names[0] == "lat":
                guess = guess_place(values["lat"], values["lon"])
            elif names[0] == "roll":
                guess = guess_angles({n: values[n] for n in bare})
            elif len(have) == 3:
                guess = guess_field(np.column_stack([values[n] for n in have]))
            else:
                return
            what = ", ".join(self.found[n].heading or n for n in bare)
            if not guess.sure and names[0] == "mag_x":
                self.say(f"{what} left out: {guess.reason}; write the unit in the heading, e.g. mag_x[uT]")
                for n in have:
                    del self.found[n]
                return
            if not guess.sure:
                raise InputError(
                    f"{self.who}: {what} without a unit, and {guess.reason}; write it in the heading, e.g. "
                    f"{have[0]}[{usual}] or {have[0]}[rad]"
                )
            unit = guess.unit
            self.say(f"{what} without a unit: taken as {unit}, because {guess.reason}")
        for n in have:
            u = self.found[n].unit or unit
            self.columns[n] = scaled(values[n], u)
            limit = np.pi / 2 if n in ("lat", "pitch") else 4 * np.pi
            with np.errstate(invalid="ignore"):
                far = np.abs(self.columns[n]) > limit * (1 + 1e-9)
            if n in ("lat", "lon") and far.sum() <= FEW * len(far):
                continue  # stray rows: left out later, and counted
            if far.any():
                advice = f"correct the values, or the unit: {n}[{usual}]"
                if unit_text(u)[1].startswith("rad"):
                    advice = f"these are probably degrees: write {n}[deg]"
                reach = np.nanmax(np.abs(values[n]))
                raise InputError(
                    f"{self.who}: {n} is said to be in {u} but reaches {reach:.6g}, more than is possible; {advice}"
                )
        if names[0] == "lat" and np.nanmax(np.abs(values["lat"])) < 1.58 and np.nanmax(np.abs(values["lon"])) < 3.15:
            if not bare and unit_text(self.found["lat"].unit)[1] == "deg":
                self.say("the track lies within 1.6 deg of 0 N, 0 E; if lat and lon are radians, write lat[rad]")

    def _imu(self) -> None:
        for unit, want, option in (
            (self.options.gyro_unit, "angular rate", "gyro unit"),
            (self.options.accel_unit, "acceleration", "accelerometer unit"),
        ):
            if unit:
                check_unit(unit, want, option)
        columns, self.kind, sentences = imu_columns(
            {n: self.numbers(n) for n in self.found if n[:-2] in ("gyro", "accel", "dtheta", "dv")},
            {n: m.unit for n, m in self.found.items()},
            self.columns["time"],
            self.who,
            self.options,
            self.sheet.scalars,
        )
        self.columns |= columns
        self.notes += sentences
        for name in [n for n in self.found if n[:-2] in ("gyro", "accel", "dtheta", "dv")]:
            del self.found[name]  # done; rates may have become increments

    def table(self) -> Table:
        """Clean rows, checked."""
        schema = SCHEMAS[self.name]
        order = [c.name for c in schema.columns if c.name in self.columns]
        columns = {n: self.columns[n] for n in order}
        columns, lines, sentences = drop_incomplete(columns, self.sheet.lines, schema, self.who)
        self.notes += sentences
        columns, lines, sentences = drop_absurd(columns, lines, schema, self.who)
        self.notes += sentences
        if self.name == "gnss":
            columns, lines, sentences = drop_held(columns, lines, self.who)
            self.notes += sentences
        if schema.has_time:
            columns, sentences = clean_time(columns, lines, self.who, schema.many_per_time, self.name)
            self.notes += sentences
        table = Table(self.name, columns, self.kind, str(self.sheet.path), self.notes)
        faults = validate(Table(self.name, columns, self.kind, self.who))
        if faults:
            raise InputError(faults[0])
        return table


def scaled(values: Array, unit: str) -> Array:
    """File numbers to SI; the unit may have a power of ten in front ("1e-7 deg")."""
    factor, text = unit_text(unit)
    return to_si(values * factor if factor != 1.0 else values, text)


def _words(values: NDArray) -> NDArray[np.str_]:
    """An id column as text; 5.0 is written 5."""
    if values.dtype.kind == "U":
        return values
    return np.array([f"{v:.0f}" if v == round(v) else repr(float(v)) for v in values], dtype=np.str_)


def _is_float(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
