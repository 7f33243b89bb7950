"""Where the outages of a sweep lie."""

import pytest

from schuler.studies.sweep import PHASES, windows


def test_windows_are_whole_and_have_fixes_between():
    for phase in range(PHASES):
        found = windows(100.0, 1000.0, 15.0, 60.0, phase)
        assert found[0][0] >= 160.0 and found[-1][1] <= 1000.0
        for (_, end), (start, _) in zip(found, found[1:], strict=False):
            assert start - end == pytest.approx(30.0)


def test_phases_are_shifted_by_half_a_period():
    a, b = windows(0.0, 1000.0, 30.0, 60.0, 0), windows(0.0, 1000.0, 30.0, 60.0, 1)
    assert b[0][0] - a[0][0] == pytest.approx(30.0)


def test_none_where_none_fits_and_one_where_it_fits_exactly():
    assert windows(0.0, 74.9, 15.0, 60.0, 0) == []
    assert windows(0.0, 75.0, 15.0, 60.0, 0) == [(60.0, 75.0)]
