"""Time bases: GPS week and second, UTC with leap seconds, Unix, ISO text; and what a recording's clock is like.

Unix time is UTC seconds since 1970-01-01 without leap seconds (a leap second repeats the second that follows it). GPS
time is seconds since 1980-01-06 00:00 UTC, counted without a break. Both are float64 here: near the year 2026 a Unix
time resolves 0.24 microseconds; `split_ns` keeps what an integer nanosecond stamp has.

Sources: IS-GPS-200, 20.3.3.5.2.4 (UTC) and 6.2.4 (week number); IERS Bulletin C for the leap seconds.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError

Array = NDArray[np.float64]

WEEK = 604800.0  # s
GPS_EPOCH_UNIX = 315964800.0  # 1980-01-06 00:00 UTC
ROLLOVER_WEEKS = 1024  # the legacy message has ten bits for the week


def _unix(year: int, month: int, day: int) -> float:
    return datetime(year, month, day, tzinfo=UTC).timestamp()


# From these dates (00:00 UTC) GPS is ahead of UTC by 1, 2, 3 ... seconds.
_LEAP_DATES = (
    (1981, 7), (1982, 7), (1983, 7), (1985, 7), (1988, 1), (1990, 1), (1991, 1), (1992, 7), (1993, 7),
    (1994, 7), (1996, 1), (1997, 7), (1999, 1), (2006, 1), (2009, 1), (2012, 7), (2015, 7), (2017, 1),
)  # fmt: skip
LEAP_UNIX = np.array([_unix(year, month, 1) for year, month in _LEAP_DATES])
LEAP_EXPIRY = _unix(2027, 6, 28)  # the announcement of July 2026 reaches this far
# GPS time at which each inserted second ends, i.e. the first instant of the new offset.
_LEAP_GPS = LEAP_UNIX - GPS_EPOCH_UNIX + np.arange(1, len(LEAP_UNIX) + 1)


def leap_seconds(unix: ArrayLike) -> Array:
    """GPS minus UTC, s, at Unix times of any shape; 18 since 2017.

    After `LEAP_EXPIRY` the last announced value is returned: say so to the user with `leap_note`. Raises InputError
    before 1980-01-06, where there is no GPS time, and for times that are not finite.
    """
    t = np.asarray(unix, dtype=np.float64)
    if not np.all(np.isfinite(t)):
        raise InputError("a time is not a number, so it has no place among the leap seconds; leave such rows out.")
    if np.any(t < GPS_EPOCH_UNIX):
        raise InputError(
            f"Unix time {np.min(t):.10g} s lies before 1980-01-06, where GPS time begins; "
            "give Unix seconds (about 1.8e9 in 2026), not seconds since the start."
        )
    return np.searchsorted(LEAP_UNIX, t, side="right").astype(np.float64)[()]


def leap_note(unix: ArrayLike) -> str | None:
    """A sentence for the user where a time lies beyond the leap second table, else None."""
    last = float(np.max(np.asarray(unix, dtype=np.float64)))
    if last < LEAP_EXPIRY:
        return None
    return (
        f"{iso_from_unix(last)[:10]} lies beyond the leap second table (valid to {iso_from_unix(LEAP_EXPIRY)[:10]}): "
        f"GPS - UTC = {len(LEAP_UNIX)} s was assumed; a newer release may know better."
    )


def gps_from_unix(unix: ArrayLike) -> Array:
    """GPS seconds since 1980-01-06 of Unix (UTC) times, any shape."""
    t = np.asarray(unix, dtype=np.float64)
    return t - GPS_EPOCH_UNIX + leap_seconds(t)


def unix_from_gps(gps: ArrayLike) -> Array:
    """Unix (UTC) seconds of GPS seconds since 1980-01-06, any shape.

    Inside a leap second the Unix time runs through the first second of the next day, as POSIX has it.
    """
    t = np.asarray(gps, dtype=np.float64)
    if not np.all(np.isfinite(t)) or np.any(t < 0.0):
        raise InputError("a GPS time is negative or not a number; it counts seconds since 1980-01-06.")
    return (t + GPS_EPOCH_UNIX - np.searchsorted(_LEAP_GPS, t, side="right"))[()]


def full_week(week: ArrayLike, near_unix: float | None = None) -> NDArray[np.int64]:
    """GPS weeks without rollover.

    week : as recorded; near_unix : any date (Unix s) within nine years of the recording. With it each week is moved by
    whole rollovers (1024 weeks) to the one nearest that date, which mends both ten-bit weeks and receivers that count
    in a wrong era. Without it a week below 1024 cannot be told from a truncated one: InputError.
    """
    w = np.asarray(week)
    if not np.all(np.isfinite(w)) or np.any(w != np.floor(w)) or np.any(w < 0):
        raise InputError("a GPS week is not a whole number >= 0; give the week and the seconds of week as two columns.")
    full = w.astype(np.int64)
    if near_unix is None:
        if np.any(full < ROLLOVER_WEEKS):
            raise InputError(
                f"GPS week {int(full.min())} may be a ten-bit week that has rolled over (2026 is about week 2400); "
                "give the approximate date of the recording."
            )
        return full
    now = int(gps_from_unix(near_unix) // WEEK)
    full = full + ROLLOVER_WEEKS * np.round((now - full) / ROLLOVER_WEEKS).astype(np.int64)
    if np.any(full < 0):
        raise InputError("a GPS week falls before 1980 for the approximate date given; check that date.")
    return full[()]


def gps_from_week(week: ArrayLike, tow: ArrayLike, near_unix: float | None = None) -> Array:
    """GPS seconds since 1980-01-06 of week and seconds of week, arrays that broadcast; see `full_week`.

    Raises InputError for seconds outside [0, 604800]: milliseconds, most often.
    """
    s = np.asarray(tow, dtype=np.float64)
    bad = ~((s >= 0.0) & (s <= WEEK))
    if np.any(bad):
        raise InputError(
            f"GPS second of week {np.atleast_1d(s)[np.atleast_1d(bad)][0]:.10g} is outside 0 to 604800; "
            "are these milliseconds? Then the unit is ms."
        )
    return full_week(week, near_unix) * WEEK + s


def unix_from_week(week: ArrayLike, tow: ArrayLike, near_unix: float | None = None) -> Array:
    """Unix (UTC) seconds of GPS week and seconds of week; see `gps_from_week`."""
    return unix_from_gps(gps_from_week(week, tow, near_unix))


def week_from_unix(unix: ArrayLike) -> tuple[NDArray[np.int64], Array]:
    """GPS week (full) and seconds of week of Unix (UTC) times, any shape."""
    gps = gps_from_unix(unix)
    week = np.floor(gps / WEEK)
    return week.astype(np.int64), gps - week * WEEK


def unwrap_tow(tow: ArrayLike) -> Array:
    """Seconds of week (n,) made to run on over the end of a week (a fall by more than half a week)."""
    s = np.asarray(tow, dtype=np.float64)
    return s + WEEK * np.concatenate([[0.0], np.cumsum(np.diff(s) < -0.5 * WEEK)]) if len(s) else s


def split_ns(t_ns: ArrayLike) -> tuple[Array, int]:
    """Integer nanosecond stamps (n,) as float seconds after the first one, and that first stamp: nothing is lost."""
    t = np.asarray(t_ns)
    if not np.issubdtype(t.dtype, np.integer):
        raise InputError("nanosecond stamps came as decimal numbers, which cannot hold them; read them as integers.")
    if t.size == 0:
        return np.zeros(0), 0
    t = t.astype(np.int64)
    return (t - t[0]) / 1e9, int(t[0])


def unix_from_iso(text: str) -> float:
    """Unix seconds of an ISO 8601 text; UTC where it names no zone. A second of 60 (a leap second) is accepted."""
    plain = text.strip()
    leap = re.match(r"^(.*\d{2}:?59:?)60(\D.*)?$", plain)
    try:
        when = datetime.fromisoformat(f"{leap[1]}59{leap[2] or ''}" if leap else plain)
    except ValueError:
        raise InputError(f"'{text}' is not an ISO date and time; write for example 2026-11-22T03:00:00Z.") from None
    if when.tzinfo is None:
        when = when.replace(tzinfo=UTC)
    since = when - datetime(1970, 1, 1, tzinfo=UTC)
    return since.days * 86400.0 + since.seconds + since.microseconds / 1e6 + (1.0 if leap else 0.0)


def iso_from_unix(unix: float, digits: int = 3) -> str:
    """ISO 8601 text in UTC with 0 to 6 decimals of a second: "2026-11-22T03:00:00.000Z"."""
    if not np.isfinite(unix):
        raise InputError("a time is not a number, so it has no date.")
    whole = round(float(unix) * 10**digits)
    seconds, part = divmod(whole, 10**digits)
    try:
        when = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    except OverflowError:
        raise InputError(f"Unix time {unix:.10g} s is no date of the calendar; are these milliseconds?") from None
    return when.strftime("%Y-%m-%dT%H:%M:%S") + (f".{part:0{digits}d}" if digits else "") + "Z"


@dataclass(frozen=True)
class ClockReport:
    """What the time column of a recording is like. Indices count rows from 0; times are in the column's own clock, s.

    rate_hz : 1 / median_interval. jitter : rms of interval - median over the ordinary intervals, s.
    gaps : (time of the last row before, length s) of each interval longer than `describe_clock` allows.
    missing : rows that the gaps would have held at the median interval.
    duplicates, backwards, not_finite : rows whose time equals the one before, is earlier, is no number.
    """

    n: int
    start: float
    end: float
    rate_hz: float
    median_interval: float
    jitter: float
    gaps: tuple[tuple[float, float], ...]
    missing: int
    duplicates: NDArray[np.int64]
    backwards: NDArray[np.int64]
    not_finite: NDArray[np.int64]

    @property
    def duration(self) -> float:
        """Last minus first time, s."""
        return self.end - self.start

    @property
    def increasing(self) -> bool:
        """Every row later than the one before."""
        return not (len(self.duplicates) or len(self.backwards) or len(self.not_finite))

    def text(self) -> str:
        """One line for a terminal."""
        parts = [f"{self.n} rows over {self.duration:.6g} s, {self.rate_hz:.6g} Hz, jitter {self.jitter * 1e3:.3g} ms"]
        if self.gaps:
            at, length = max(self.gaps, key=lambda gap: gap[1])
            several = "gap" if len(self.gaps) == 1 else "gaps"
            parts.append(f"{len(self.gaps)} {several} (longest {length:.6g} s after {at:.10g} s)")
        for what, rows in (
            ("repeated", self.duplicates),
            ("backward", self.backwards),
            ("missing", self.not_finite),
        ):
            if len(rows):
                several = "time" if len(rows) == 1 else "times"
                parts.append(f"{len(rows)} {what} {several} (first in row {int(rows[0]) + 1})")
        return "; ".join(parts)


def describe_clock(t: ArrayLike, gap_factor: float = 1.5) -> ClockReport:
    """Rate, jitter, gaps, duplicated and backward times of a time column t (n,), s.

    A gap is an interval longer than gap_factor medians and outside six robust sigmas of the intervals, so that the
    nervous clock of a phone is not all gaps. Raises InputError where fewer than two different times are there.
    """
    time = np.asarray(t, dtype=np.float64)
    if time.ndim != 1:
        raise InputError(f"a time column has one dimension; this one has shape {time.shape}.")
    finite = np.isfinite(time)
    kept = np.flatnonzero(finite)
    good = time[kept]
    steps = np.diff(good)
    forward = steps[steps > 0.0]
    if len(forward) == 0:
        raise InputError(
            f"the time column has {len(time)} rows and no two times that increase; a recording needs at least two."
        )
    median = float(np.median(forward))
    spread = 1.4826 * float(np.median(np.abs(forward - median)))
    limit = max(gap_factor * median, median + 6.0 * spread)
    is_gap = steps > limit
    ordinary = forward[forward <= limit]
    return ClockReport(
        n=len(time),
        start=float(good[0]),
        end=float(good[-1]),
        rate_hz=1.0 / median,
        median_interval=median,
        jitter=float(np.sqrt(np.mean((ordinary - median) ** 2))),
        gaps=tuple((float(a), float(d)) for a, d in zip(good[:-1][is_gap], steps[is_gap], strict=True)),
        missing=int(np.sum(np.round(steps[is_gap] / median) - 1.0)),
        duplicates=kept[1:][steps == 0.0],
        backwards=kept[1:][steps < 0.0],
        not_finite=np.flatnonzero(~finite),
    )
