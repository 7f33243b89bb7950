"""Units: one table from a name to its quantity and SI factor. Inside the package everything is SI and radians.

`to_si(7.3, "deg/s")` gives rad/s; `from_si` goes back. Noise densities have two spellings of one thing: a white rate
noise of N rad/s/sqrt(Hz) makes an angle random walk of N rad/sqrt(s), so "deg/sqrt(h)" and "deg/s/sqrt(Hz)" are both of
the quantity "angle random walk" and convert to the same SI number. Temperatures stay in Celsius, as in the tables.

Sources: BIPM SI Brochure (9th ed.), table 8 and appendix; IEEE Std 952-2020 annex C for the noise terms.
"""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError

Array = NDArray[np.float64]

DEG = math.pi / 180.0  # rad
ARCMIN = DEG / 60.0  # rad
ARCSEC = DEG / 3600.0  # rad
MRAD = 1e-3  # rad
HOUR = 3600.0  # s
DEG_PER_S = DEG  # rad/s
DEG_PER_H = DEG / HOUR  # rad/s
G0 = 9.80665  # m/s^2, standard acceleration of free fall (exact): the g of datasheets, never the local gravity
MG = 1e-3 * G0  # m/s^2
UG = 1e-6 * G0  # m/s^2
FT = 0.3048  # m
NMI = 1852.0  # m
KNOT = NMI / HOUR  # m/s
KMH = 1000.0 / HOUR  # m/s
PPM = 1e-6
PERCENT = 1e-2
DEG_PER_SQRT_H = DEG / 60.0  # rad/sqrt(s)
DEG_PER_S_PER_SQRT_HZ = DEG  # rad/sqrt(s)
DEG_PER_H_PER_SQRT_HZ = DEG_PER_H  # rad/sqrt(s)
DEG_PER_H_PER_SQRT_H = DEG_PER_H / 60.0  # rad/s/sqrt(s)
MPS_PER_SQRT_H = 1.0 / 60.0  # m/s/sqrt(s)
UG_PER_SQRT_HZ = UG  # m/s/sqrt(s)
UG_PER_SQRT_H = UG / 60.0  # m/s^2/sqrt(s)


@dataclass(frozen=True)
class Unit:
    """A unit: SI value = factor * number + offset; `si` is the spelling of the SI unit it converts to."""

    name: str
    quantity: str
    factor: float
    si: str
    offset: float = 0.0


# quantity -> SI spelling, and "name alias alias": factor. Names are matched exactly first, then without regard to case
# where that leaves no doubt ("G" is gauss and "g" is gravity; "DEG/S" can only be deg/s).
_TABLE: dict[str, tuple[str, dict[str, float]]] = {
    "angle": (
        "rad",
        {
            "rad radian radians": 1.0,
            "deg degree degrees": DEG,
            "arcmin minarc": ARCMIN,
            "arcsec secarc as": ARCSEC,
            "mrad milliradian": MRAD,
            "urad": 1e-6,
        },
    ),
    "angular rate": (
        "rad/s",
        {
            "rad/s rad/sec radps": 1.0,
            "mrad/s": 1e-3,
            "deg/s deg/sec dps degps": DEG,
            "mdeg/s mdps": 1e-3 * DEG,
            "deg/min": DEG / 60.0,
            "deg/h deg/hr deg/hour dph": DEG_PER_H,
            "rad/h": 1.0 / HOUR,
            "rpm rev/min": 2.0 * math.pi / 60.0,
        },
    ),
    "angular acceleration": ("rad/s^2", {"rad/s^2": 1.0, "deg/s^2": DEG, "deg/h^2 deg/h/h": DEG_PER_H / HOUR}),
    "acceleration": (
        "m/s^2",
        {
            "m/s^2 m/s2 m/s/s mps2 meter/s^2": 1.0,
            "g g0 gee": G0,
            "mg milli-g millig": MG,
            "ug micro-g microg": UG,
            "ft/s^2": FT,
            "cm/s^2 Gal gal": 1e-2,
            "mGal mgal": 1e-5,
        },
    ),
    "length": (
        "m",
        {
            "m metre meter metres meters": 1.0,
            "km": 1e3,
            "cm": 1e-2,
            "mm": 1e-3,
            "um": 1e-6,
            "ft feet foot": FT,
            "nmi NM naut.mile": NMI,
        },
    ),
    "speed": (
        "m/s",
        {
            "m/s m/sec mps": 1.0,
            "km/h kph kmh km/hr": KMH,
            "kn knot knots kt kts": KNOT,
            "cm/s": 1e-2,
            "mm/s": 1e-3,
            "ft/s fps": FT,
            "m/h": 1.0 / HOUR,
            "nmi/h": KNOT,
        },
    ),
    "time": (
        "s",
        {
            "s sec second seconds": 1.0,
            "ms msec millisecond milliseconds": 1e-3,
            "us usec microsecond microseconds": 1e-6,
            "ns nsec nanosecond nanoseconds": 1e-9,
            "min minute minutes": 60.0,
            "h hr hour hours": HOUR,
            "day days d": 86400.0,
        },
    ),
    "frequency": ("Hz", {"Hz hertz": 1.0, "kHz": 1e3}),
    "gradient of speed": ("1/s", {"1/s s^-1": 1.0}),
    "magnetic flux density": (
        "T",
        {
            "T tesla": 1.0,
            "mT": 1e-3,
            "uT microtesla": 1e-6,
            "nT nanotesla": 1e-9,
            "G gauss Gs": 1e-4,
            "mG milligauss mgauss": 1e-7,
        },
    ),
    "pressure": ("Pa", {"Pa pascal": 1.0, "hPa mbar": 1e2, "kPa": 1e3, "bar": 1e5, "dbar decibar": 1e4}),
    "temperature": ("degC", {"degC celsius C": 1.0}),
    "pixel": ("px", {"px pixel pixels": 1.0}),
    "ratio": ("1", {"1 - none ratio": 1.0, "percent % pct": PERCENT, "ppm": PPM}),
    "angle random walk": (
        "rad/sqrt(s)",
        {
            "rad/sqrt(s) rad/s/sqrt(Hz)": 1.0,
            "rad/sqrt(h)": 1.0 / 60.0,
            "deg/sqrt(h) deg/sqrt(hr) deg/rt(h)": DEG_PER_SQRT_H,
            "deg/sqrt(s)": DEG,
            "deg/s/sqrt(Hz) dps/sqrt(Hz)": DEG_PER_S_PER_SQRT_HZ,
            "mdeg/s/sqrt(Hz) mdps/sqrt(Hz)": 1e-3 * DEG,
            "deg/h/sqrt(Hz)": DEG_PER_H_PER_SQRT_HZ,
        },
    ),
    "velocity random walk": (
        "m/s/sqrt(s)",
        {
            "m/s/sqrt(s) m/s^2/sqrt(Hz)": 1.0,
            "m/s/sqrt(h) m/s/sqrt(hr)": MPS_PER_SQRT_H,
            "g/sqrt(Hz)": G0,
            "mg/sqrt(Hz)": MG,
            "ug/sqrt(Hz)": UG_PER_SQRT_HZ,
        },
    ),
    "rate random walk": (
        "rad/s/sqrt(s)",
        {
            "rad/s/sqrt(s) rad/s^2/sqrt(Hz)": 1.0,
            "deg/s/sqrt(s)": DEG,
            "deg/s/sqrt(h)": DEG / 60.0,
            "deg/h/sqrt(h) deg/h/sqrt(hr)": DEG_PER_H_PER_SQRT_H,
        },
    ),
    "acceleration random walk": (
        "m/s^2/sqrt(s)",
        {
            "m/s^2/sqrt(s) m/s^3/sqrt(Hz)": 1.0,
            "m/s^2/sqrt(h)": 1.0 / 60.0,
            "ug/sqrt(s)": UG,
            "ug/sqrt(h) ug/sqrt(hr)": UG_PER_SQRT_H,
        },
    ),
    "position random walk": ("m/sqrt(s)", {"m/sqrt(s) m/s/sqrt(Hz)": 1.0, "m/sqrt(h)": 1.0 / 60.0}),
    "magnetic noise density": ("T/sqrt(Hz)", {"T/sqrt(Hz)": 1.0, "uT/sqrt(Hz)": 1e-6, "nT/sqrt(Hz)": 1e-9}),
    "g sensitivity": ("rad/s/(m/s^2)", {"rad/s/(m/s^2)": 1.0, "deg/h/g": DEG_PER_H / G0, "deg/s/g": DEG / G0}),
}

# Not plain factors, or names whose case carries the meaning.
_WITH_OFFSET = (Unit("K", "temperature", 1.0, "degC", -273.15),)
_CASE_MATTERS = frozenset({"C", "K", "T", "NM", "G", "g", "mG", "mg", "M", "Gs", "as", "d", "Gal", "gal", "mGal"})


def _build() -> tuple[dict[str, Unit], dict[str, Unit]]:
    exact: dict[str, Unit] = {u.name: u for u in _WITH_OFFSET}
    for quantity, (si, rows) in _TABLE.items():
        for names, factor in rows.items():
            spellings = names.split()
            unit = Unit(spellings[0], quantity, factor, si)
            for spelling in spellings:
                if spelling in exact:
                    raise AssertionError(f"unit {spelling} is in the table twice")
                exact[spelling] = unit
    loose: dict[str, set[Unit]] = {}
    for spelling, unit in exact.items():
        if spelling not in _CASE_MATTERS:
            loose.setdefault(spelling.casefold(), set()).add(unit)
    return exact, {k: v.pop() for k, v in loose.items() if len(v) == 1}


UNITS, _LOOSE = _build()  # every spelling -> its unit

_RESPELL = (
    ("\N{DEGREE SIGN}C", "degC"),
    ("\N{DEGREE SIGN}", "deg"),
    ("\N{MICRO SIGN}", "u"),
    ("\N{GREEK SMALL LETTER MU}", "u"),
    ("\N{SUPERSCRIPT TWO}", "^2"),
    ("\N{SQUARE ROOT}", "sqrt"),
    ("**", "^"),
    (" per ", "/"),
    ("\u2032", "arcmin"),
    ("\u2033", "arcsec"),
)


def _plain(name: str) -> str:
    """One spelling for the typographic variants: a degree sign, a micro sign, spaces, sqrt without brackets."""
    for old, new in _RESPELL:
        name = name.replace(old, new)
    name = re.sub(r"\s+", "", name)
    name = re.sub(r"(?i)(sqrt|rt)(hr|h|hz|s)$", r"sqrt(\2)", name)
    return name.replace("s^-2", "/s^2") if name == "ms^-2" else name


def unit_of(name: str | Unit) -> Unit:
    """The unit of a spelling ("deg/h", "deg/hr", the degree sign, "ug/sqrt(Hz)" ...).

    Raises InputError that lists near spellings where the name is not known.
    """
    if isinstance(name, Unit):
        return name
    plain = _plain(name)
    found = UNITS.get(name.strip()) or UNITS.get(plain) or _LOOSE.get(plain.casefold())
    if found is not None:
        return found
    by_case = {spelling.casefold(): UNITS[spelling].name for spelling in reversed(UNITS)}
    close = difflib.get_close_matches(plain.casefold(), list(by_case), n=6, cutoff=0.5)
    near = list(dict.fromkeys(by_case[n] for n in close))
    meant = f"did you mean {', '.join(near)}?" if near else "write for example rad/s, deg/h, m/s^2, ug, m, s or 1."
    raise InputError(f"unit '{name}' is not known; {meant}")


def quantity(unit: str | Unit) -> str:
    """What a unit measures: "angle", "angular rate", "acceleration", "length", "time" ..."""
    return unit_of(unit).quantity


@overload
def to_si(values: float, unit: str | Unit, expect: str | None = None) -> float: ...
@overload
def to_si(values: ArrayLike, unit: str | Unit, expect: str | None = None) -> Array: ...
def to_si(values: ArrayLike, unit: str | Unit, expect: str | None = None) -> float | Array:
    """Numbers in `unit` to SI (radians, Celsius).

    values : a number or an array of any shape. expect : the quantity that is wanted ("angular rate"); any other raises
    InputError. Returns float for a number, else float64 of the same shape.
    """
    u = unit_of(unit)
    if expect is not None and u.quantity != expect:
        alike = [v.name for v in dict.fromkeys(UNITS.values()) if v.quantity == expect]
        example = ", ".join(alike[:4])
        raise InputError(
            f"unit '{u.name}' is one of {u.quantity}, where {expect} is wanted; write for example {example}."
        )
    result = np.asarray(values, dtype=np.float64) * u.factor + u.offset
    return float(result) if np.ndim(result) == 0 else result


@overload
def from_si(values: float, unit: str | Unit) -> float: ...
@overload
def from_si(values: ArrayLike, unit: str | Unit) -> Array: ...
def from_si(values: ArrayLike, unit: str | Unit) -> float | Array:
    """SI numbers (radians, Celsius) to `unit`; the inverse of `to_si`, same shapes."""
    u = unit_of(unit)
    result = (np.asarray(values, dtype=np.float64) - u.offset) / u.factor
    return float(result) if np.ndim(result) == 0 else result


def split_header(header: str) -> tuple[str, str]:
    """A column heading into its name and unit: "gyro_x[deg/s]" -> ("gyro_x", "deg/s"); no unit gives "".

    Also "lat (deg)". The unit is not looked up here (a heading may hold a remark in brackets).
    Raises InputError for a bracket that does not close.
    """
    text = header.strip().strip("\ufeff").strip()
    for left, right in ("[]", "()"):
        if text.endswith(right) and left in text:
            name, _, unit = text[:-1].partition(left)
            return name.strip(), unit.strip()
        if text.count(left) != text.count(right):
            raise InputError(f"column heading '{header}' has a bracket that does not close; write name[unit].")
    return text, ""
