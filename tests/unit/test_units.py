"""Units: the factors against their definitions, every spelling, and what an unknown one is told."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.ground import units
from schuler.ground.errors import InputError
from schuler.ground.units import UNITS, from_si, quantity, split_header, to_si, unit_of

DEG = math.pi / 180


@pytest.mark.parametrize(
    ("value", "unit", "si"),
    [
        (180.0, "deg", math.pi),
        (60.0, "arcmin", DEG),
        (3600.0, "arcsec", DEG),
        (1.0, "mrad", 1e-3),
        (1.0, "deg/s", DEG),
        (0.01, "deg/h", 4.8481368e-8),  # platform reference table
        (15.041067, "deg/h", 7.292115e-5),  # the Earth's rate
        (1.0, "g", 9.80665),
        (1.0, "mg", 9.80665e-3),
        (1.0, "ug", 9.80665e-6),
        (1.0, "ft", 0.3048),
        (60.0, "nmi", 111120.0),
        (36.0, "km/h", 10.0),
        (3600.0, "kn", 1852.0),
        (1.0, "ms", 1e-3),
        (1.0, "us", 1e-6),
        (1.0, "ns", 1e-9),
        (50.0, "uT", 5e-5),
        (1.0, "G", 1e-4),
        (1e5, "nT", 1e-4),
        (20.0, "degC", 20.0),
        (273.15, "K", 0.0),
        (3.0, "percent", 0.03),
        (10.0, "ppm", 1e-5),
        (7.0, "px", 7.0),
        (7.0, "1", 7.0),
        (1.0, "dbar", 1e4),
    ],
)
def test_value_of_each_unit(value, unit, si):
    assert to_si(value, unit) == pytest.approx(si, rel=1e-7, abs=1e-12)


@pytest.mark.parametrize(
    ("a", "b", "ratio"),
    [
        # A rate noise N in deg/s/sqrt(Hz) makes an angle of N sqrt(t) deg after t s: 60 N after one hour.
        ("deg/s/sqrt(Hz)", "deg/sqrt(h)", 60.0),
        ("deg/h/sqrt(Hz)", "deg/sqrt(h)", 1.0 / 60.0),
        ("rad/s/sqrt(Hz)", "rad/sqrt(s)", 1.0),
        ("m/s^2/sqrt(Hz)", "m/s/sqrt(h)", 60.0),
        ("ug/sqrt(Hz)", "m/s/sqrt(h)", 60.0 * 9.80665e-6),
        ("deg/h/sqrt(h)", "rad/s/sqrt(s)", DEG / 3600 / 60),
        ("rad/s^2/sqrt(Hz)", "rad/s/sqrt(s)", 1.0),
        ("ug/sqrt(h)", "m/s^2/sqrt(s)", 9.80665e-6 / 60),
    ],
)
def test_noise_densities_are_one_thing_in_two_spellings(a, b, ratio):
    assert quantity(a) == quantity(b)
    assert unit_of(a).factor / unit_of(b).factor == pytest.approx(ratio, rel=1e-14)


def test_constants_are_the_factors_of_the_table():
    for name, constant in [
        ("deg", units.DEG), ("arcsec", units.ARCSEC), ("deg/h", units.DEG_PER_H), ("g", units.G0), ("ug", units.UG),
        ("kn", units.KNOT), ("km/h", units.KMH), ("deg/sqrt(h)", units.DEG_PER_SQRT_H),
        ("m/s/sqrt(h)", units.MPS_PER_SQRT_H), ("ug/sqrt(Hz)", units.UG_PER_SQRT_HZ), ("ppm", units.PPM),
        ("deg/h/sqrt(h)", units.DEG_PER_H_PER_SQRT_H), ("nmi", units.NMI),
    ]:  # fmt: skip
        assert unit_of(name).factor == pytest.approx(constant, rel=1e-15)


@pytest.mark.parametrize(
    ("spelling", "name"),
    [
        ("dps", "deg/s"), ("DEG/S", "deg/s"), ("deg/sec", "deg/s"), ("\N{DEGREE SIGN}/s", "deg/s"),
        ("deg/hr", "deg/h"), ("\N{DEGREE SIGN}/h", "deg/h"), ("m/s2", "m/s^2"), ("m/s\N{SUPERSCRIPT TWO}", "m/s^2"),
        ("m/s**2", "m/s^2"), (" m/s ", "m/s"), ("knots", "kn"), ("kt", "kn"), ("\N{MICRO SIGN}g", "ug"),
        ("\N{GREEK SMALL LETTER MU}T", "uT"), ("%", "percent"), ("\N{DEGREE SIGN}C", "degC"), ("-", "1"),
        ("deg/\N{SQUARE ROOT}h", "deg/sqrt(h)"), ("deg/sqrt(hr)", "deg/sqrt(h)"), ("deg/rt(h)", "deg/sqrt(h)"),
        ("gauss", "G"), ("RAD/S", "rad/s"), ("Deg", "deg"), ("seconds", "s"),
    ],
)  # fmt: skip
def test_spellings(spelling, name):
    assert unit_of(spelling).name == name


def test_case_decides_between_gauss_and_gravity():
    assert quantity("G") == "magnetic flux density"
    assert quantity("g") == "acceleration"
    assert quantity("mG") == "magnetic flux density"
    assert quantity("mg") == "acceleration"
    with pytest.raises(InputError):  # neither mG nor mg for certain
        unit_of("MG")


def test_unknown_unit_lists_near_spellings():
    with pytest.raises(InputError, match=r"'deg/ss' is not known; did you mean .*deg/s\b"):
        to_si(1.0, "deg/ss")
    with pytest.raises(InputError, match="write for example rad/s"):
        unit_of("furlong")


def test_wrong_quantity_is_refused_with_examples():
    with pytest.raises(InputError, match="'m' is one of length, where angular rate is wanted.*rad/s"):
        to_si(1.0, "m", expect="angular rate")
    assert to_si(1.0, "dps", expect="angular rate") == pytest.approx(DEG)


@pytest.mark.parametrize("spelling", sorted(UNITS))
def test_round_trip_of_every_spelling(spelling):
    values = np.array([[-3.5, 0.0], [1e-9, 7.25e4]])
    assert_allclose(from_si(to_si(values, spelling), spelling), values, rtol=1e-14, atol=2e-13)
    assert unit_of(unit_of(spelling).si).factor == 1.0  # the SI spelling is in the table itself
    assert unit_of(unit_of(spelling).si).quantity == unit_of(spelling).quantity


def test_shapes_and_types():
    assert isinstance(to_si(3, "deg"), float)
    assert to_si([1, 2], "km").tolist() == [1000.0, 2000.0]
    assert to_si(np.ones((2, 3), dtype=np.int16), "deg").dtype == np.float64


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("gyro_x[deg/s]", "gyro_x", "deg/s"),
        ("time[s]", "time", "s"),
        (" lat (deg) ", "lat", "deg"),
        ("noise[ug/sqrt(Hz)]", "noise", "ug/sqrt(Hz)"),
        ("noise (ug/sqrt(Hz))", "noise", "ug/sqrt(Hz)"),
        ("id", "id", ""),
        ("\ufefftime[s]", "time", "s"),
        ("scale[]", "scale", ""),
    ],
)
def test_split_header(header, name, unit):
    assert split_header(header) == (name, unit)


@pytest.mark.parametrize("header", ["gyro_x[deg/s", "gyro_x deg/s]", "lat (deg"])
def test_open_bracket_is_refused(header):
    with pytest.raises(InputError, match="write name"):
        split_header(header)
