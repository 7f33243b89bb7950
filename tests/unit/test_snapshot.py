"""Fixes from made-up pseudoranges: exact without errors, echoes left out, honest sigmas, the Earth's turn, memory."""

import numpy as np
import pytest

from schuler.aiding.snapshot import EARTH_RATE, LIGHT, SnapshotFixes, SnapshotSettings
from schuler.ground.earth import WGS84

PLACE = WGS84.ecef_from_geodetic(np.radians(52.5), np.radians(13.4), 90.0)


def sky(rng, n=14):
    """ECEF positions of satellites above 10 degrees."""
    up = PLACE / np.linalg.norm(PLACE)
    found = []
    while len(found) < n:
        d = rng.standard_normal(3)
        d *= 2.66e7 / np.linalg.norm(d)
        ray = d - PLACE
        if up @ ray / np.linalg.norm(ray) > np.sin(np.radians(10.0)):
            found.append(d)
    return np.array(found)


def measured(sat, place=PLACE):
    """Geometric range with the Earth turning while the signal travels: satellites in the axes at transmission."""
    d = np.linalg.norm(sat - place, axis=1)
    for _ in range(5):
        a = EARTH_RATE * d / LIGHT
        x = np.column_stack(
            [sat[:, 0] * np.cos(a) + sat[:, 1] * np.sin(a), sat[:, 1] * np.cos(a) - sat[:, 0] * np.sin(a), sat[:, 2]]
        )
        d = np.linalg.norm(x - place, axis=1)
    return d


def miss(fix):
    return WGS84.displacement_n(fix.lat, fix.lon, fix.height, np.radians(52.5), np.radians(13.4), 90.0).ravel()


def test_without_errors_it_is_exact():
    rng = np.random.default_rng(1)
    sat = sky(rng)
    system = np.repeat([1, 4], 7)
    rho = measured(sat) + 3.1e5 + np.where(system == 4, -42.0, 0.0)
    fix = SnapshotFixes().epoch(0.0, rho, sat, system, np.full(14, 45.0))
    assert np.abs(miss(fix)).max() < 1e-3 and fix.used == 14


def test_the_turn_of_the_earth_is_metres_to_the_west():
    rng = np.random.default_rng(2)
    sat = sky(rng)
    rho = measured(sat) + 1e4
    wrong = SnapshotFixes(SnapshotSettings(turned=True)).epoch(0.0, rho, sat, np.ones(14), np.full(14, 45.0))
    assert 15.0 < abs(miss(wrong)[1]) < 45.0 and abs(miss(wrong)[0]) < 5.0


def test_echoes_are_left_out():
    rng = np.random.default_rng(3)
    plain, robust = [], []
    for _ in range(60):
        sat = sky(rng)
        system = np.repeat([1, 4], 7)
        rho = measured(sat) + 1e5 + np.where(system == 4, 20.0, 0.0) + 3.0 * rng.standard_normal(14)
        late = rng.permutation(14)[:4]
        rho[late] += rng.uniform(30.0, 120.0, 4)
        cn0 = np.full(14, 45.0)
        cn0[late] = 38.0
        robust.append(np.hypot(*miss(SnapshotFixes().epoch(0.0, rho, sat, system, cn0))[:2]))
        never = SnapshotSettings(late=1e6, early=1e6)
        plain.append(np.hypot(*miss(SnapshotFixes(never).epoch(0.0, rho, sat, system, cn0))[:2]))
    assert np.median(robust) < 0.35 * np.median(plain) and np.median(robust) < 8.0


def test_sigmas_hold_for_clean_signals():
    rng = np.random.default_rng(4)
    ratio = []
    for _ in range(150):
        sat = sky(rng)
        rho = measured(sat) + 1e5 + 7.07 * rng.standard_normal(14)  # sigma of 45 dBHz
        fix = SnapshotFixes().epoch(0.0, rho, sat, np.ones(14), np.full(14, 45.0))
        e = miss(fix)[:2]
        ratio.append(e @ np.linalg.solve(fix.cov[:2, :2], e) / 2.0)
    assert 0.3 < np.mean(ratio) < 1.5


def epochs(count, seed=6, place=PLACE, noise=4.0, first=0):
    r = np.random.default_rng(seed)
    for k in range(first, first + count):
        sat = sky(r, 10)
        system = np.repeat([1, 4], 5)
        offset = np.where(system == 4, 20.0, 0.0)
        rho = measured(sat, place) + 1e5 + 40.0 * k + offset + noise * r.standard_normal(10)
        yield 0.2 * k, rho, sat, system, np.full(10, 45.0)


@pytest.mark.slow
def test_memory_holds_height_and_offsets_and_never_looks_ahead():
    maker, other = SnapshotFixes(), SnapshotFixes()
    a = [maker.epoch(*e) for e in epochs(200)]
    b = [other.epoch(t, rho + (500.0 if t > 30.0 else 0.0) * np.arange(10), *more) for t, rho, *more in epochs(200)]
    early = [i for i, f in enumerate(a) if f.time <= 30.0]
    assert [a[i].lat for i in early] == [b[i].lat for i in early]
    fresh = [SnapshotFixes().epoch(*e) for e in epochs(200)]
    up = [np.std([miss(f)[2] for f in fixes[100:]]) for fixes in (a, fresh)]
    assert up[0] < 0.5 * up[1]


@pytest.mark.slow
def test_a_wrong_memory_is_given_up():
    """A minute of fixes far above the street, then the truth: the height learnt does not hold it away for long."""
    maker = SnapshotFixes()
    high = PLACE * (1.0 + 800.0 / np.linalg.norm(PLACE))
    for e in epochs(300, place=high):
        assert abs(miss(maker.epoch(*e))[2] + 800.0) < 60.0
    later = [maker.epoch(*e) for e in epochs(100, seed=9, first=300)]
    assert np.median([np.abs(miss(f)).max() for f in later[40:]]) < 40.0


@pytest.mark.parametrize("n", [0, 3])
def test_too_few_satellites_are_no_fix(n):
    rng = np.random.default_rng(7)
    sat = sky(rng, max(n, 1))[:n]
    assert SnapshotFixes().epoch(0.0, np.full(n, 2e7), sat, np.ones(n), np.full(n, 45.0)) is None


def test_weak_and_missing_numbers_are_left_out():
    rng = np.random.default_rng(8)
    sat = sky(rng)
    rho = measured(sat) + 1e5
    cn0 = np.full(14, 45.0)
    rho[0], rho[1], cn0[1] = np.nan, rho[1] + 1e4, 12.0
    fix = SnapshotFixes().epoch(0.0, rho, sat, np.ones(14), cn0)
    assert np.abs(miss(fix)).max() < 1e-3 and fix.used == 12 and fix.seen == 14
