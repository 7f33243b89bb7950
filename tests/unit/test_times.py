"""Time bases against published dates, leap seconds, the week rollover, and what a clock report says."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from schuler.ground import times
from schuler.ground.errors import InputError
from schuler.ground.times import describe_clock, gps_from_unix, iso_from_unix, unix_from_gps, unix_from_iso

DAY = 86400.0


@pytest.mark.parametrize(
    ("date", "offset"),
    [
        ("1980-01-06", 0), ("1981-06-30T23:59:59", 0), ("1981-07-01", 1), ("1985-06-30", 3), ("1985-07-01", 4),
        ("1990-01-01", 6), ("1999-08-22", 13), ("2005-12-31", 13), ("2006-01-01", 14), ("2015-07-01", 17),
        ("2016-12-31T23:59:59", 17), ("2017-01-01", 18), ("2026-11-22", 18),
    ],
)  # fmt: skip
def test_gps_minus_utc(date, offset):
    assert times.leap_seconds(unix_from_iso(date)) == offset


def test_the_whole_leap_table_against_the_published_list():
    # NTP seconds (since 1900) from which TAI - UTC has the value; GPS is TAI - 19 s.
    published = {
        2571782400: 20, 2603318400: 21, 2634854400: 22, 2698012800: 23, 2776982400: 24, 2840140800: 25,
        2871676800: 26, 2918937600: 27, 2950473600: 28, 2982009600: 29, 3029443200: 30, 3076704000: 31,
        3124137600: 32, 3345062400: 33, 3439756800: 34, 3550089600: 35, 3644697600: 36, 3692217600: 37,
    }  # fmt: skip
    assert len(times.LEAP_UNIX) == len(published)
    for ntp, tai in published.items():
        assert_array_equal(times.leap_seconds([ntp - 2208988800 - 1, ntp - 2208988800]), [tai - 20, tai - 19])


def test_epoch_and_known_weeks():
    assert gps_from_unix(unix_from_iso("1980-01-06T00:00:00Z")) == 0.0
    # The first rollovers of the ten-bit week: 13 s and 18 s before midnight UTC.
    assert times.week_from_unix(unix_from_iso("1999-08-21T23:59:47Z")) == (1024, 0.0)
    assert times.week_from_unix(unix_from_iso("2019-04-06T23:59:42Z")) == (2048, 0.0)
    assert times.unix_from_week(2048, 0.0) == unix_from_iso("2019-04-06T23:59:42Z")
    # seconds of week count from Saturday to Sunday midnight
    week, tow = times.week_from_unix(unix_from_iso("2026-11-22T12:00:00Z"))
    assert (week, tow) == (2446, 12 * 3600 + 18)


def test_gps_time_runs_on_through_a_leap_second():
    end = unix_from_iso("2017-01-01")
    gps = gps_from_unix(end) + np.arange(-3.0, 2.0)  # 23:59:58, 59, 60, 00:00:00, 00:00:01
    assert_array_equal(unix_from_gps(gps) - end, [-2, -1, 0, 0, 1])


def test_round_trip_except_inside_leap_seconds():
    rng = np.random.default_rng(0)
    unix = np.floor(rng.uniform(times.GPS_EPOCH_UNIX, times.LEAP_EXPIRY, 5000))
    unix = np.concatenate([unix, times.LEAP_UNIX - 1.0, times.LEAP_UNIX, times.LEAP_UNIX + 1.0])
    assert_array_equal(unix_from_gps(gps_from_unix(unix)), unix)
    week, tow = times.week_from_unix(unix)
    near = np.abs(unix - 1.4e9) < 510 * times.WEEK
    assert_array_equal(times.unix_from_week(week[near] % 1024, tow[near], near_unix=1.4e9), unix[near])


def test_leap_table_says_where_it_ends():
    assert times.leap_note(times.LEAP_EXPIRY - 1.0) is None
    assert "beyond the leap second table (valid to 2027-06-28)" in times.leap_note([1e9, times.LEAP_EXPIRY])
    assert times.leap_seconds(times.LEAP_EXPIRY + 1e8) == 18


@pytest.mark.parametrize("bad", [100.0, np.nan, [1e9, -5.0]])
def test_times_without_gps_are_refused(bad):
    with pytest.raises(InputError):
        times.leap_seconds(bad)


def test_negative_gps_time_is_refused():
    with pytest.raises(InputError, match="since 1980"):
        unix_from_gps([5.0, -1.0])


def test_rollover_guard():
    near = unix_from_iso("2026-01-01")
    assert times.full_week(2446 - 2048, near) == 2446  # ten bits
    assert times.full_week(2446 - 1024, near) == 2446  # a receiver that lives in the last era
    assert times.full_week(2446, near) == 2446
    assert_array_equal(times.full_week([1023, 0], unix_from_iso("1999-08-22")), [1023, 1024])
    assert times.full_week(2446) == 2446
    with pytest.raises(InputError, match="rolled over.*approximate date"):
        times.full_week(398)
    with pytest.raises(InputError, match="whole number"):
        times.full_week(2446.5)
    with pytest.raises(InputError, match="whole number"):
        times.full_week(-1)


def test_seconds_of_week_in_milliseconds_are_noticed():
    with pytest.raises(InputError, match="milliseconds"):
        times.gps_from_week(2446, [0.0, 345_600_000.0])
    with pytest.raises(InputError, match="outside 0 to 604800"):
        times.gps_from_week(2446, np.nan)


def test_seconds_of_week_over_the_end_of_a_week():
    assert_array_equal(times.unwrap_tow([604798, 604799, 0, 1]), [604798, 604799, 604800, 604801])
    assert times.unwrap_tow([]).shape == (0,)


def test_nanoseconds_keep_their_last_digit():
    t_ns = np.array([1795316400_123456789, 1795316400_123456790, 1795316401_123456789])
    t, start = times.split_ns(t_ns)
    assert start == t_ns[0]
    assert_allclose(t, [0.0, 1e-9, 1.0], rtol=1e-15)
    with pytest.raises(InputError, match="read them as integers"):
        times.split_ns(t_ns.astype(float))


@pytest.mark.parametrize(
    ("text", "unix"),
    [
        ("1970-01-01T00:00:00Z", 0.0),
        ("2001-09-09T01:46:40Z", 1e9),
        ("2001-09-09 01:46:40", 1e9),  # no zone: UTC
        ("2001-09-09T03:46:40+02:00", 1e9),
        ("2001-09-09T01:46:40.25Z", 1e9 + 0.25),
        ("2016-12-31T23:59:60Z", 1483228800.0),
        ("2016-12-31T23:59:60.5Z", 1483228800.5),
    ],
)
def test_iso_text(text, unix):
    assert unix_from_iso(text) == unix


def test_iso_writing():
    assert iso_from_unix(1e9 + 0.25) == "2001-09-09T01:46:40.250Z"
    assert iso_from_unix(1e9 - 0.0001) == "2001-09-09T01:46:40.000Z"  # rounds, and carries
    assert iso_from_unix(-0.5, 1) == "1969-12-31T23:59:59.5Z"
    assert iso_from_unix(1e9, 0) == "2001-09-09T01:46:40Z"
    for bad in (math.nan, 1e15):
        with pytest.raises(InputError):
            iso_from_unix(bad)


@pytest.mark.parametrize("text", ["yesterday", "", "22.11.2026", "2026-13-01", "2026-11-22T10:20:60x"])
def test_iso_that_is_none(text):
    with pytest.raises(InputError, match="is not an ISO date"):
        unix_from_iso(text)


# --- clocks -----------------------------------------------------------------------------------------------------------


def test_a_perfect_clock():
    report = describe_clock(np.arange(1001) / 100.0)
    assert report.rate_hz == pytest.approx(100.0)
    assert report.jitter < 1e-12
    assert (report.n, report.gaps, report.missing, report.duration) == (1001, (), 0, 10.0)
    assert report.increasing
    assert report.text().startswith("1001 rows over 10 s, 100 Hz, jitter ")
    assert ";" not in report.text()  # nothing to complain of


def test_jitter_is_the_rms_of_the_intervals():
    rng = np.random.default_rng(1)
    t = np.cumsum(0.01 + 0.0005 * rng.standard_normal(20000))
    report = describe_clock(t)
    assert report.jitter == pytest.approx(0.0005, rel=0.03)
    assert report.rate_hz == pytest.approx(100.0, rel=0.01)
    assert report.gaps == ()


def test_gaps_are_found_and_do_not_count_as_jitter():
    t = np.arange(1000) / 50.0
    t = np.delete(t, [100, *range(500, 550)])
    report = describe_clock(t)
    assert_allclose(report.gaps, [(99 / 50, 2 / 50), (499 / 50, 51 / 50)], atol=1e-12)
    assert report.missing == 51
    assert report.jitter < 1e-12
    assert "2 gaps (longest 1.02 s after 9.98 s)" in report.text()
    assert report.increasing  # a gap is no fault of the order


def test_a_nervous_clock_is_not_all_gaps():
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.002, 0.018, 5000))  # a phone: intervals up to 1.8 medians
    assert describe_clock(t).gaps == ()


def test_duplicates_backward_times_and_holes_are_named_by_row():
    t = np.array([0, 1, 2, 2, 3, np.nan, 4, 3.5, 5, 6, np.inf])
    report = describe_clock(t)
    assert_array_equal(report.duplicates, [3])
    assert_array_equal(report.backwards, [7])
    assert_array_equal(report.not_finite, [5, 10])
    assert not report.increasing
    assert (report.start, report.end, report.rate_hz) == (0.0, 6.0, 1.0)
    assert "1 repeated time (first in row 4)" in report.text()
    assert "1 backward time (first in row 8)" in report.text()
    assert "2 missing times (first in row 6)" in report.text()


def test_stamps_that_come_in_bursts_still_have_a_rate():
    t = np.repeat(np.arange(100) * 0.1, 10)  # ten rows with each stamp
    report = describe_clock(t)
    assert report.rate_hz == pytest.approx(10.0)
    assert len(report.duplicates) == 900


@pytest.mark.parametrize("t", [[], [1.0], [2.0, 2.0], [3.0, 2.0], [np.nan, np.nan, 1.0]])
def test_no_clock_at_all(t):
    with pytest.raises(InputError, match="at least two"):
        describe_clock(t)


def test_a_table_is_no_time_column():
    with pytest.raises(InputError, match="one dimension"):
        describe_clock(np.zeros((3, 2)))
