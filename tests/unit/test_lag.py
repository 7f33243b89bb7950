"""A reference on another clock: the delay put in is found, with sign and sigma, and what to type is said."""

import numpy as np
import pytest
from test_judging import reference, track

from schuler.judging.lag import Lag, clocks, lag_words, reference_lag


def drive(seed=1, duration=600.0, dt=0.1):
    """(time, ned, heading, velocity) of a car that turns, brakes and goes."""
    t = np.arange(0.0, duration, dt)
    heading = np.cumsum(0.15 * np.sin(2 * np.pi * t / 47.0) * (np.sin(2 * np.pi * t / 130.0 + seed) > 0)) * dt
    speed = 12.0 + 6.0 * np.sin(2 * np.pi * t / 90.0 + seed)
    velocity = np.column_stack([speed * np.cos(heading), speed * np.sin(heading), 0.0 * t])
    return t, np.cumsum(velocity, axis=0) * dt, heading, velocity


def pair(delay, seed=1, drift=0.02, every=2, noise=0.02):
    """A solution with a slow error, and a reference whose row stamped t belongs to t - delay."""
    rng = np.random.default_rng(seed)
    t, ned, heading, velocity = drive(seed)
    slow = np.cumsum(rng.normal(size=ned.shape), axis=0) * drift
    solution = track(t, ned + slow, v_n=velocity, rpy=np.column_stack([0 * t, 0 * t, heading]))
    rows = slice(40, -60, every)
    true = ned[rows] + noise * rng.normal(size=ned[rows].shape)
    return solution, reference(t[rows] + delay, true + [0.5, -0.3, 0.0])


@pytest.mark.parametrize("delay", [0.1, -0.1, 1.0, -7.5, 18.0, -200.0, 3600.0, 315964782.0])
def test_the_delay_put_in_is_found_with_its_sign(delay):
    found = reference_lag(*pair(delay))
    assert abs(found.delay_s - delay) < max(4.0 * found.sigma_s, 1e-3) and found.sigma_s < 0.05
    assert found.significant
    words = lag_words(found, "truth.csv")
    typed = float(words.split("reference_delay_s = ")[1].split(" ")[0])
    assert typed == pytest.approx(delay, abs=4 * found.sigma_s)
    assert ("late" in words) == (delay > 0)
    if delay == 18.0:
        assert "GPS time and UTC" in words and typed == 18.0
    if abs(delay) > 1000.0:
        assert "share no time" in words and not np.isfinite(found.rms_before_m)


def test_the_sigma_is_true_and_no_lag_gets_no_word():
    ratios = []
    for seed in range(12):
        found = reference_lag(*pair(0.0, seed))
        assert lag_words(found, "truth.csv") is None
        ratios.append(found.delay_s / found.sigma_s)
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 2.0


def test_another_point_of_the_vehicle_is_no_lag():
    """Two metres ahead of the IMU: as a lag it would be 0.17 s at 12 m/s."""
    t, ned, heading, velocity = drive()
    arm = 2.0 * np.column_stack([np.cos(heading), np.sin(heading), 0 * t])
    solution = track(t, ned, v_n=velocity, rpy=np.column_stack([0 * t, 0 * t, heading]))
    found = reference_lag(solution, reference(t, ned + arm))
    assert abs(found.delay_s) < 0.01 and lag_words(found, "truth.csv") is None


def test_noisy_fixes_once_a_second_do():
    solution, late = pair(0.4, every=10, noise=1.0)
    found = reference_lag(solution, late)
    assert found.delay_s == pytest.approx(0.4, abs=4 * found.sigma_s) and found.sigma_s < 0.1


@pytest.mark.parametrize("delay", [0.0, 0.5, 1000.0])
def test_nothing_is_said_where_nothing_tells(delay):
    t = np.arange(0.0, 300.0, 0.1)
    straight = np.outer(t, (10.0, 1.0, 0.0))
    v = np.tile((10.0, 1.0, 0.0), (len(t), 1))
    assert lag_words(reference_lag(track(t, straight, v_n=v), reference(t + delay, straight)), "x") is None
    laps = 50.0 * np.column_stack([np.cos(0.2 * t), np.sin(0.2 * t), 0 * t])
    v = 10.0 * np.column_stack([-np.sin(0.2 * t), np.cos(0.2 * t), 0 * t])
    rpy = np.column_stack([0 * t, 0 * t, 0.2 * t + np.pi / 2])
    assert lag_words(reference_lag(track(t, laps, v_n=v, rpy=rpy), reference(t + delay, laps)), "x") is None
    rng = np.random.default_rng(2)
    rest = rng.normal(size=(2, len(t), 3))
    assert lag_words(reference_lag(track(t, rest[0]), reference(t + delay, rest[1])), "x") is None


def test_a_reference_of_another_drive_is_not_made_to_fit():
    t, ned, heading, velocity = drive(1)
    other = drive(5)[1] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + [4000.0, 9000.0, 0.0]
    solution = track(t, ned, v_n=velocity, rpy=np.column_stack([0 * t, 0 * t, heading]))
    assert lag_words(reference_lag(solution, reference(t + 5000.0, other)), "x") is None
    assert reference_lag(solution, reference(t[:10], ned[:10])) is None


def test_words_add_what_was_taken_out_already():
    found = Lag(0.52, 0.01, 0.2, 3.0, 0.99)
    assert "reference_delay_s = 18.52 under" in lag_words(found, "truth.csv", already=18.0)
    assert "gnss_delay_s" in lag_words(found, "truth.csv") and "gnss_delay_s" not in lag_words(found, "t", gnss=False)


def test_usual_clocks_are_named():
    assert clocks(-18.02, 0.02)[1] == -18.0 and clocks(3600.1)[1] == 3600.0
    assert clocks(315964782.01)[0] == "Unix time against GPS seconds" and clocks(-315964800.0)[1] == -315964800.0
    assert clocks(5.0) == ("", 5.0) and clocks(0.0) == ("", 0.0)
