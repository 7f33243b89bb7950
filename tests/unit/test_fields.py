"""Dates of the magnetic model, what is said outside its span, and what is refused."""

import math
from datetime import UTC, datetime

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.ground.errors import InputError
from schuler.ground.fields import date_text, decimal_year, declination, magnetic_field, span_note

DEG = math.pi / 180


def unix(*date):
    return datetime(*date, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("date", "year"),
    [
        ((2025, 1, 1), 2025.0),
        ((2025, 7, 2, 12), 2025.5),  # the middle of 365 days
        ((2028, 7, 2), 2028.5),  # and of 366
        ((2024, 12, 31, 12), 2025 - 0.5 / 366),
        ((1969, 7, 20), 1969 + 200 / 365),
    ],
)
def test_decimal_year(date, year):
    assert decimal_year(unix(*date)) == pytest.approx(year, abs=1e-11)


def test_decimal_year_of_arrays_runs_on_over_new_year():
    t = unix(2027, 1, 1) + np.array([[-1.5, -0.5], [0.0, 0.5]])
    years = decimal_year(t)
    assert years.shape == (2, 2)
    assert_allclose(np.diff(years.ravel()) * 365 * 86400, [1.0, 0.5, 0.5], atol=1e-4)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1.7e15])
def test_decimal_year_of_no_date(bad):
    with pytest.raises(InputError):
        decimal_year([1.7e9, bad])


def test_date_text():
    assert date_text(float(decimal_year(unix(2014, 6, 21, 12)))) == "2014-06-21"
    assert date_text(2025.0) == "2025-01-01"


def test_shapes_broadcast():
    lat, lon = np.array([[0.1], [0.2]]), np.array([0.0, 1.0, 2.0])
    B_n = magnetic_field(lat, lon, 0.0, 2026.0)
    assert B_n.shape == (2, 3, 3)
    assert_allclose(B_n[1, 2], magnetic_field(0.2, 2.0, 0.0, 2026.0), rtol=1e-14)
    assert np.ndim(declination(0.2, 2.0, 0.0, 2026.0)) == 0


@pytest.mark.parametrize("year", [2025.0, 2030.0])
def test_both_ends_belong_to_the_span(year):
    assert 20e-6 < np.linalg.norm(magnetic_field(0.5, 0.5, 0.0, year)) < 70e-6
    assert span_note(0.5, 0.5, 0.0, year) is None


@pytest.mark.parametrize(
    ("year", "date"), [(2024.9999, "2024-12-31"), (2030.001, "2030-01-01"), (2014.47, "2014-06-21")]
)
def test_a_date_outside_the_span_is_refused_with_what_to_type(year, date):
    with pytest.raises(InputError, match=rf"{date} is outside .*2025\.0 to 2030\.0; type \[input\] declination_deg"):
        declination(0.5, 0.5, 0.0, [2026.0, year])


def test_nearest_takes_the_end_of_the_span_and_the_note_says_how_wrong_it_may_be():
    lat, lon = 36.8 * DEG, -121.9 * DEG
    assert declination(lat, lon, 0.0, 2015.0, nearest=True) == declination(lat, lon, 0.0, 2025.0)
    assert declination(lat, lon, 0.0, 2033.0, nearest=True) == declination(lat, lon, 0.0, 2030.0)
    note = span_note(lat, lon, 0.0, 2015.0)
    assert "2015-01-01" in note and "of 2025.0 was taken" in note and "2.0 deg off" in note
    assert "of 2030.0 was taken" in span_note(lat, lon, 0.0, 2033.0)


def test_the_note_knows_where_the_declination_runs_faster():
    lat = 86 * DEG  # near the magnetic pole, which wanders
    change = abs(declination(lat, 2.5, 0.0, 2026.0) - declination(lat, 2.5, 0.0, 2025.0)) / DEG
    assert change > 1.0
    assert f"{change:.1f} deg a year" in span_note(lat, 2.5, 0.0, 2020.0)


def test_the_declination_of_2025_is_within_the_assumed_drift_of_an_older_model():
    """Space Needle, Seattle, 2013.25: WMM2010 gave 16.4156 deg (as the package pygeomag documents)."""
    old = declination(47.6205 * DEG, -122.3493 * DEG, 0.0, 2013.25, nearest=True) / DEG
    assert 0.5 < abs(old - 16.4156) < 0.2 * (2025.0 - 2013.25)


@pytest.mark.parametrize(
    ("place", "word"),
    [((80.0, 0.0, 0.0), "latitude"), ((math.nan, 0.0, 0.0), "not a number"), ((0.0, 0.0, 6.4e6), "height")],
)
def test_impossible_places_are_refused(place, word):
    with pytest.raises(InputError, match=word):
        magnetic_field(*place, 2026.0)
