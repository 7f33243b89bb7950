"""The filter fed measurement by measurement gives the batch's bits, whatever came early, late or after a pause."""

import zlib
from dataclasses import replace

import numpy as np
import pytest

from auv_missions import CASES, batch, demo, events, feed, full, glider, streams
from schuler.aiding.auv import AuvFilter, AuvSettings, Measurement, navigate
from schuler.aiding.auv_settings import Start
from schuler.ground.errors import InputError


def same(a, b):
    """Bit for bit, whatever is held."""
    assert a.time == b.time
    for name in ("x", "P", "X"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name


@pytest.fixture(scope="module", params=list(CASES))
def made(request):
    return CASES[request.param]()


def test_row_by_row_is_the_batch(made):
    nav, rows, measurements = streams(made)
    feed(nav, events(rows, measurements))
    expected = batch(made)
    same(nav, expected)
    assert np.isfinite(nav.x[:28]).all() and nav.x[13] != 0.0
    track = navigate(made.tables, replace(made.settings, output_rate=np.inf)).filter
    assert track.lat[-1] == nav.lat and track.lon[-1] == nav.lon and track.height[-1] == nav.height
    np.testing.assert_allclose(track.rpy[-1], nav.rpy, rtol=0, atol=1e-15)
    assert track.cov_pos[-1, 0, 0] == nav.covariance[9, 9]


def test_sigmas_are_those_of_the_present(made):
    """Between covariance steps too, where P is still that of the last step; reading changes nothing."""
    nav, rows, measurements = streams(made)
    arriving = [e for e in events(rows, measurements) if e[0] < 60.33]
    feed(nav, arriving)
    before = nav.save()
    told = nav.sigmas()
    track = navigate(
        {name: t.where(t.time < 60.33) for name, t in made.tables.items()}, replace(made.settings, output_rate=np.inf)
    ).filter
    assert track.time[-1] == nav.time
    assert told["north"] == pytest.approx(np.sqrt(track.cov_pos[-1, 0, 0]), rel=1e-12)
    assert told["heading"] == pytest.approx(np.sqrt(track.cov_rpy[-1, 2, 2]), rel=1e-12)
    assert nav.save() == before


# --- order of arrival -----------------------------------------------------------------------------------------------


def arriving(made, when, wait=40.0):
    """Events with the measurements after `wait` s moved: when(measurement, i) is its time of arrival."""
    nav, rows, measurements = streams(made)
    found = [(float(r[0]), 0, r) for r in rows]
    found += [(when(m, i) if m.time > wait else m.time, 1, m) for i, m in enumerate(measurements)]
    return nav, sorted(found, key=lambda e: e[:2])


@pytest.mark.parametrize("make", [demo, full])
def test_early_measurements_wait_for_their_row(make):
    rng = np.random.default_rng(1)
    nav, found = arriving(make(), lambda m, i: m.time - rng.uniform(0.0, 8.0))
    feed(nav, found)
    same(nav, batch(make()))


def test_late_and_disordered_measurements_are_put_in_their_place(made):
    """One in twelve is up to `settings.late` late, the rest arrive within a second, in any order."""
    rng = np.random.default_rng(2)
    late = made.settings.late

    def when(m, i):
        return m.time + (rng.uniform(0.5, 0.99) * late if i % 12 == 0 else rng.uniform(0.0, 1.0))

    nav, found = arriving(made, when)
    assert all(feed(nav, found))
    same(nav, batch(made))


def test_all_measurements_of_a_moment_in_reverse(made):
    nav, rows, measurements = streams(made)
    kept = {id(m): i for i, m in enumerate(measurements)}
    found = [(float(r[0]), 0, 0, r) for r in rows]
    found += [(m.time, 1, -kept[id(m)] if m.time > 40.0 else kept[id(m)], m) for m in measurements]
    feed(nav, [(a, b, d) for a, b, _, d in sorted(found, key=lambda e: e[:3])])
    same(nav, batch(made))


def test_a_compass_row_that_comes_after_a_newer_fix_is_put_in_its_place():
    """Such a fix has moved the filter on; an IMU's filter would have let it wait."""
    made = glider()
    nav, rows, measurements = streams(made)
    found = [(float(r[0]) + (6.0 if i % 7 == 3 else 0.0), 0, r) for i, r in enumerate(rows)]
    late = {e[0] - 6.0 for i, e in enumerate(found) if i % 7 == 3}
    # the order among rows stays
    found = [(max(t, max((u for u, _, _ in found[:i]), default=t)), o, r) for i, (t, o, r) in enumerate(found)]
    feed(nav, sorted(found + [(m.time, 1, m) for m in measurements], key=lambda e: e[:2]))
    assert any(m.time - 6.0 < t < m.time for t in late for m in measurements)
    same(nav, batch(made))


def test_what_comes_too_late_is_refused_and_changes_nothing(made):
    nav, rows, measurements = streams(made)
    old = [m for m in measurements if 40.0 < m.time][0]
    feed(nav, events(rows[rows[:, 0] < 100.0], [m for m in measurements if m.time < 100.0 and m is not old]))
    before = nav.save()
    assert nav.update(old) is False
    assert nav.save() == before


def test_memory_of_the_past_is_bounded(made):
    """Rows, measurements and marks are kept for `late` seconds and no longer."""
    nav, rows, measurements = streams(made)
    sizes = []
    for at, _, what in events(rows, measurements):
        nav.update(what) if isinstance(what, Measurement) else nav.predict(what)
        if at > 60.0:
            sizes.append((len(nav._rows), len(nav._done), len(nav._marks)))
    late = made.settings.late
    if nav.compass:
        late += 400.0  # between dives no row comes and the filter goes by fixes
    most = np.max(sizes, axis=0)
    per_second = (nav.width == 4) * 0.5 or 25.0
    assert most[0] <= (late + 3.0) * per_second + 2
    assert most[2] < 6 * (late + 3.0)


def test_a_buffer_that_the_caller_uses_again_is_no_danger():
    """A vehicle's driver fills one array over and over."""
    made = demo()
    nav, rows, measurements = streams(made)
    late = next(m for m in measurements if m.time > 60.0 and m.kind == "position")
    held = np.zeros(rows.shape[1])
    for at, _, what in events(rows, [m for m in measurements if m is not late]):
        if isinstance(what, Measurement):
            nav.update(what)
        else:
            held[:] = what
            nav.predict(held)
        if at >= late.time + 5.0 and late is not None and not isinstance(what, Measurement):
            assert nav.update(late)
            late = replace(late, time=np.inf)
    same(nav, batch(made))


# --- save and load --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [0.0, 0.5, 1.02, 30.0, 49.9, 75.02, 131.0])
def test_resumed_from_bytes_is_uninterrupted(made, at):
    """The pause comes while waiting for a start, on the surface, below, at a surfacing; some measurements come early
    and some late, so that the buffers are full."""
    early = 0.0 if "attitude" in made.tables else -3.0
    nav, found = arriving(made, lambda m, i: m.time + (early, 6.0, 0.0, 0.0)[i % 4], wait=5.0)
    split = next(i for i, e in enumerate(found) if e[0] > at)
    found = [e for e in found if e[0] < at + 30.0]
    feed(nav, found[:split])
    blob = nav.save()
    other = AuvFilter.load(blob)
    assert other.save() == blob
    feed(nav, found[split:])
    feed(other, found[split:])
    assert other.save() == nav.save()
    same(nav, other)
    if at > 1.1:
        assert nav.started
    if 30.0 <= at < 131.0 and not nav.compass:
        assert b'"pending": [[' in blob


def test_saved_bytes_are_the_same_whenever_the_history_was():
    made = demo()
    blobs = []
    for _ in range(2):
        nav, rows, measurements = streams(made)
        feed(nav, [e for e in events(rows, measurements) if e[0] < 70.0])
        blobs.append(nav.save())
    assert blobs[0] == blobs[1]


def blob():
    made = demo()
    nav, rows, measurements = streams(made)
    feed(nav, [e for e in events(rows, measurements) if e[0] < 55.0])
    return nav.save()


def test_bytes_that_are_no_filter_are_refused():
    good = blob()
    head = good[: len(good) - 8]
    bad = [b"", b"\x00" * 40, b"SCHULER", good[:13], good[:14], good[:20], head, good + b"\x00" * 8, good[100:]]
    bad += [good[:n] for n in np.linspace(1, len(good) - 1, 60).astype(int)]
    rng = np.random.default_rng(4)
    bad += [rng.bytes(5000), good[:14] + rng.bytes(5000)]
    for place in rng.integers(0, len(good), 60):
        flipped = bytearray(good)
        flipped[place] ^= 1 << rng.integers(0, 8)
        bad.append(bytes(flipped))
    for garbage in bad:
        with pytest.raises(InputError, match="not a saved AUV filter"):
            AuvFilter.load(garbage)
    assert AuvFilter.load(good).save() == good


def test_what_a_well_meaning_editor_made_of_the_bytes_is_refused():
    """The sum of bytes is right and what they say is not."""
    good = blob()
    changes = (b'"rows": ', b'"rows": 1'), (b'"compass": false', b'"compass": true'), (b'"settings"', b'"sentings"')
    for old, new in (*changes, (b'"start": {', b'"start": 1, "a": {'), (b'"done": [[', b'"done": [3, [')):
        assert old in good
        size = (int.from_bytes(good[18:26], "little") + len(new) - len(old)).to_bytes(8, "little")
        body = size + good[26:].replace(old, new, 1)
        with pytest.raises(InputError, match="not a saved AUV filter"):
            AuvFilter.load(good[:14] + zlib.crc32(body).to_bytes(4, "little") + body)


# --- bad input ------------------------------------------------------------------------------------------------------


def started():
    made = demo()
    nav, rows, measurements = streams(made)
    feed(nav, [e for e in events(rows, measurements) if e[0] < 55.0])
    return nav, rows[np.searchsorted(rows[:, 0], 55.0)]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", [0, 1, 6])
@pytest.mark.parametrize("running", [False, True])
def test_rows_without_numbers_are_refused_and_change_nothing(running, column, value):
    nav, row = started() if running else (streams(demo())[0], streams(demo())[1][0])
    before = nav.save()
    bad = row.copy()
    bad[column] = value
    with pytest.raises(InputError, match="finite"):
        nav.predict(bad)
    assert nav.save() == before
    nav.predict(row)
    assert nav.save() != before


@pytest.mark.parametrize("running", [False, True])
def test_rows_of_another_length_are_refused(running):
    nav, row = started() if running else (streams(demo())[0], streams(demo())[1][0])
    before = nav.save()
    for bad in (row[:4], np.append(row, [1.0, 2.0, 3.0]), row[:0]):
        with pytest.raises(InputError, match="7 finite numbers"):
            nav.predict(bad)
    assert nav.save() == before


@pytest.mark.parametrize("running", [False, True])
@pytest.mark.parametrize(
    "bad",
    [
        Measurement.position(55.0, np.nan, 0.9, std=(1.0, 1.0, 1.0)),
        Measurement.position(np.nan, 0.6, 0.9, std=(1.0, 1.0, 1.0)),
        Measurement.velocity(55.0, (np.inf, 0.0, 0.0), std=(1.0, 1.0, 1.0)),
        Measurement.speed(55.0, np.nan, std=0.1),
        Measurement.speed(np.inf, 2.0, std=0.1),
        Measurement.dvl(55.0, (1.0, np.nan, 0.0), std=0.1),
        Measurement.depth(55.0, np.nan, std=0.1),
        Measurement.depth(55.0, 3.0, std=np.nan),
    ],
)
def test_measurements_without_numbers_are_refused_and_change_nothing(running, bad):
    nav = started()[0] if running else streams(demo())[0]
    before = nav.save()
    with pytest.raises(InputError, match="finite"):
        nav.update(bad)
    assert nav.save() == before


def test_rows_that_go_back_in_time_change_nothing(made):
    nav, rows, measurements = streams(made)
    feed(nav, [e for e in events(rows, measurements) if e[0] < 75.0])
    before = nav.save()
    past = rows[rows[:, 0] < 75.0]
    for i in (-1, -2, -5, 0):
        nav.predict(past[i])
    assert nav.save() == before


def test_a_filter_that_was_told_its_start_needs_no_fix():
    made = demo()
    start = Start(lat=0.64, lon=0.92, height=0.0, heading=1.6)
    nav = AuvFilter(AuvSettings(start=start))
    _, rows, _ = streams(made)
    nav.predict(rows[0])
    assert nav.started and nav.time == rows[0, 0] and nav.lat == 0.64
    assert nav.rpy[2] == pytest.approx(1.6, abs=1e-12)
    assert {"full", "glider"} <= set(CASES) and full().tables.keys() != glider().tables.keys()
