"""IMU columns to SI: units by heading, by word of the user or by gravity's yardstick; rates told from increments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.units import G0, to_si, unit_of
from schuler.io.guess import guess_accel, guess_gyro, gyro_contradiction, norm
from schuler.io.headings import quantity_of, unit_text

if TYPE_CHECKING:
    from schuler.io.tables import ReadOptions

Array = NDArray[np.float64]


def _scale(values: Array, unit: str) -> Array:
    factor, text = unit_text(unit)
    return to_si(values * factor, text)


def triple(columns: dict[str, Array], stem: str) -> Array | None:
    """(n, 3) of `stem_x`, `_y`, `_z`, None where one is absent."""
    names = [f"{stem}_{axis}" for axis in "xyz"]
    return np.column_stack([columns[n] for n in names]) if all(n in columns for n in names) else None


def _unit(units: dict[str, str], stem: str, who: str) -> str:
    """The unit that the three headings share; "" where none says one."""
    said = [units.get(f"{stem}_{axis}", "") for axis in "xyz"]
    given = sorted(set(said) - {""})
    if len(given) > 1:
        raise InputError(f"{who}: {stem}_x, _y and _z have different units ({', '.join(given)}); convert them to one")
    return given[0] if given else ""


def step_of(time: Array) -> float | None:
    """Median of the positive steps, s."""
    step = np.diff(time[np.isfinite(time)])
    step = step[step > 0]
    return float(np.median(step)) if len(step) else None


def imu_columns(
    columns: dict[str, Array],
    units: dict[str, str],
    time: Array,
    who: str,
    options: ReadOptions,
    scalars: dict[str, float],
) -> tuple[dict[str, Array], str, list[str]]:
    """SI columns of an imu table, its kind ("rates" or "increments"), and sentences on what was assumed.

    columns : gyro_, accel_, dtheta_, dv_ triples as in the file. units : of each heading, "" where it does not say.
    Raises InputError where a unit cannot be told, or where the numbers speak against the unit of the heading.
    """
    notes: list[str] = []
    gyro_scale, accel_scale = _count_values(options, scalars, notes, who)
    dt = step_of(time)
    rates = triple(columns, "gyro") is not None and triple(columns, "accel") is not None
    turn_name, push_name = ("gyro", "accel") if rates else ("dtheta", "dv")
    turn, push = triple(columns, turn_name), triple(columns, push_name)
    if turn is None or push is None:  # one triple of each kind: gyro with dv, or dtheta with accel
        have = ", ".join(sorted(columns))
        raise InputError(f"{who}: rates and increments are mixed ({have}); give both as rates or both as increments")
    good = np.isfinite(turn).all(axis=1) & np.isfinite(push).all(axis=1)
    if not good.any():
        raise InputError(f"{who}: no row has numbers in all gyro and accelerometer columns")
    turn_unit, push_unit = _unit(units, turn_name, who), _unit(units, push_name, who)

    # The accelerometer first: gravity tells its unit and whether these are rates.
    if accel_scale:
        push, push_unit = push * accel_scale, "g"
    elif options.accel_unit:
        push_unit = options.accel_unit
    kind = "rates" if rates else "increments"
    if not push_unit:
        guess = guess_accel(push[good], dt)
        if not guess.sure and not rates and "increments" in guess.reason and "m/s" in guess.reason:
            guess = type(guess)("m/s", "the columns are named as increments", "increments")
        if not guess.sure:
            raise InputError(
                f"{who}: {push_name}_x, _y, _z have no unit, and {guess.reason}; write it in the heading, e.g. "
                f"accel_x[m/s^2] or dv_x[m/s], or give the accelerometer unit (--accel-unit g; for raw counts "
                "scale_accel_g in [input])"
            )
        push_unit = guess.unit
        notes.append(
            f"{who}: {push_name}_x, _y, _z without a unit: taken as {guess.kind} in {push_unit}, because {guess.reason}"
        )
        kind = guess.kind
    elif quantity_of(push_unit) == "speed":
        kind = "increments"
    push = _scale(push, push_unit)
    if not options.trust_units:
        _check_size(push[good], kind, push_name, push_unit, dt, who)

    if gyro_scale:
        turn, turn_unit = turn * gyro_scale, "deg/s"
    elif options.gyro_unit:
        turn_unit = options.gyro_unit
        if kind == "increments" and turn_unit.endswith("/s"):
            turn_unit = turn_unit[:-2]  # a person names the unit of the sensor; the file holds its increments
    as_rates = push[good] / dt if kind == "increments" and dt else push[good]
    if not turn_unit:
        turn_unit = _guess_turn(turn[good], as_rates, dt, kind, turn_name, who, notes)
    elif (quantity_of(turn_unit) == "angle") != (kind == "increments"):
        raise InputError(
            f"{who}: the gyro is in {turn_unit}, the accelerometer in {push_unit}; give both as rates (rad/s, m/s^2) "
            "or both as increments (rad, m/s)"
        )
    turn = _scale(turn, turn_unit)
    if not (options.trust_units or options.gyro_unit):
        per_second = turn[good] / dt if kind == "increments" and dt else turn[good]
        plain = unit_text(turn_unit)[1]
        said = plain if quantity_of(plain) == "angular rate" else f"{plain}/s"
        wrong = gyro_contradiction(per_second, as_rates, dt, unit_of(said).name)
        if wrong:
            raise InputError(
                f"{who}: {turn_name}_x, _y, _z are said to be in {turn_unit}, but {wrong.reason}; they are probably "
                f"{wrong.unit}: to convert, schuler convert {who} OUT.csv --gyro-unit {wrong.unit} (or, where "
                f"the heading is right after all, --gyro-unit {turn_unit})"
            )
    stems = ("gyro", "accel") if kind == "rates" else ("dtheta", "dv")
    out = {}
    for stem, values in zip(stems, (turn, push), strict=True):
        for k, axis in enumerate("xyz"):
            out[f"{stem}_{axis}"] = np.ascontiguousarray(values[:, k])
    return out, kind, notes


def _count_values(
    options: ReadOptions, scalars: dict[str, float], notes: list[str], who: str
) -> tuple[float | None, float | None]:
    """deg/s and g of one count, from the options or from numbers stored beside the columns."""
    gyro, accel = options.scale_gyro_deg_per_s, options.scale_accel_g
    if gyro is None and "gyro_lsb_dps" in scalars:
        gyro = scalars["gyro_lsb_dps"]
        notes.append(f"{who}: gyro counts of {gyro:g} deg/s, as the file says")
    if accel is None and "accel_lsb_g" in scalars:
        accel = scalars["accel_lsb_g"]
        notes.append(f"{who}: accelerometer counts of {accel:g} g, as the file says")
    return gyro, accel


def _check_size(push: Array, kind: str, name: str, unit: str, dt: float | None, who: str) -> None:
    """InputError where the specific force is nowhere near gravity."""
    size = float(np.median(norm(push)))
    want = G0 if kind == "rates" else G0 * dt if dt else None
    if want is None or 0.6 < size / want < 1.6:
        return
    what = f"{who}: {name}_x, _y, _z are said to be in {unit}, but their median length is {size:.4g} "
    what += (
        "m/s^2, far from gravity"
        if kind == "rates"
        else f"m/s over steps of {dt:.4g} s, far from gravity times the step"
    )
    raw = size / _scale(np.ones(1), unit)[0]
    other = guess_accel(np.array([[raw, 0.0, 0.0]]), dt)
    if other.sure and other.kind == "increments":
        raise InputError(f"{what}; they are probably increments: name them dv_x[{other.unit}] and dtheta_x[rad]")
    if other.sure and kind == "increments":
        raise InputError(f"{what}; they are probably rates: name them accel_x[{other.unit}] and gyro_x[rad/s]")
    if other.sure:
        raise InputError(
            f"{what}; they are probably {other.unit}: to convert, "
            f"schuler convert {who} OUT.csv --accel-unit {other.unit}"
        )
    removed = "; gravity may have been removed, and navigation needs the specific force with it" if size < 3.0 else ""
    raise InputError(f"{what}{removed}; correct the unit in the heading, or scale_accel_g for raw counts")


def _guess_turn(turn: Array, accel: Array, dt: float | None, kind: str, name: str, who: str, notes: list[str]) -> str:
    """The unit of gyro columns that have none."""
    rates = turn / dt if kind == "increments" and dt else turn
    guess = guess_gyro(rates, accel, dt)
    if not guess.sure:
        raise InputError(
            f"{who}: {name}_x, _y, _z have no unit, and {guess.reason}; write it in the heading, e.g. {name}_x[rad/s], "
            "or give the gyro unit (--gyro-unit deg/s; for raw counts scale_gyro_deg_per_s in [input])"
        )
    unit = guess.unit
    if kind == "increments":
        unit = unit.partition("/")[0]
    notes.append(f"{who}: {name}_x, _y, _z without a unit: taken as {kind} in {unit}, because {guess.reason}")
    return unit
