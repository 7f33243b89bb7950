"""Is the attitude filter honest? NEES of simulated hand motion inside chi-square bounds; a smoother that is better."""

from dataclasses import replace

import numpy as np
import pytest

from ahrs_motion import SETTINGS, error_of, record, wandering
from schuler.aiding.ahrs import navigate
from schuler.judging.consistency import chi2_bounds

pytestmark = pytest.mark.slow
RUNS, DURATION = 60, 60.0
AT = (0.3, 0.6, 0.99)  # share of the run


def ensemble(six):
    """NEES per degree of freedom (RUNS, len(AT)), squared errors of filter and smoother."""
    nees = {"filter": [], "smoother": []}
    squares = {"filter": [], "smoother": []}
    for r in range(RUNS):
        rec = record(DURATION, run=r, made=wandering(DURATION, r))
        if six:
            rec = rec.six()
        _, run = navigate({"imu": rec.imu}, SETTINGS)
        for name in nees:
            a = getattr(run, name)
            e = error_of(rec, a, relative=six)
            rows = [int(s * len(e)) for s in AT]
            nees[name].append([e[i] @ np.linalg.solve(a.cov_phi[i], e[i]) / 3.0 for i in rows])
            squares[name].append(np.mean(e[len(e) // 4 :] ** 2, axis=0))
    return {k: np.array(v) for k, v in nees.items()}, {k: np.array(v) for k, v in squares.items()}


@pytest.mark.parametrize("six", [False, True], ids=["nine", "six"])
def test_attitude_nees(six):
    nees, squares = ensemble(six)
    low, high = chi2_bounds(3, RUNS)
    for name, values in nees.items():
        mean = values.mean(axis=0)
        # the velocity of the motion is a sum of sines, not quite the filter's process: 15 % beyond the bounds of chance
        assert (mean > 0.85 * low).all() and (mean < 1.15 * high).all(), (name, mean, low, high)
    gain = squares["smoother"].mean(axis=0) / squares["filter"].mean(axis=0)
    assert gain[0] < 0.8 and gain[1] < 0.8 and gain[2] < (1.02 if six else 0.95)


def test_a_filter_that_knows_too_much_is_found():
    """Told of gyros and accelerometers ten times better than they are, the same runs fail by far."""
    wrong = replace(SETTINGS, gyro_arw=SETTINGS.gyro_arw / 10.0, gyro_walk=SETTINGS.gyro_walk / 10.0,
                    gyro_bias_std=SETTINGS.gyro_bias_std / 10.0)  # fmt: skip
    values = []
    for r in range(10):
        rec = record(30.0, run=r, made=wandering(30.0, r))
        _, run = navigate({"imu": rec.imu}, replace(wrong, smoother=False))
        e = error_of(rec, run.filter)
        values.append(e[-1] @ np.linalg.solve(run.filter.cov_phi[-1], e[-1]) / 3.0)
    assert np.mean(values) > 1.5 * chi2_bounds(3, 10)[1]
