"""What is simulated fits together: a plain filter that shares no formula with the compiled one finds its own errors as
large as it claims, over every sensor. Bounds have a false-alarm rate of 1e-4."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from reference_aided import XYZ, Scalar, navigate
from schuler.ground.units import UG
from schuler.truth import manoeuvres
from schuler.truth.aided import AidedSuite, simulate
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0
PLACE = (50.0 * D, 30.0 * D)
IMU = ImuModel(
    gyro_arw_deg_per_sqrt_h=0.2, accel_vrw_mps_per_sqrt_h=0.1, gyro_instability_deg_per_h=20.0, gyro_tau_s=300.0,
    accel_instability_ug=1000.0, accel_tau_s=300.0, gyro_scale_ppm=2000.0, accel_scale_ppm=2000.0,
)  # fmt: skip
START = (1.0, 1.0, 2.0, 0.1, 0.1, 0.1, 0.5 * D, 0.5 * D, 2.0 * D)
BIASES = (
    {f"gyro_bias_{a}": Scalar(20.0 * D / 3600.0, 300.0) for a in XYZ}
    | {f"accel_bias_{a}": Scalar(1000.0 * UG, 300.0) for a in XYZ}
    | {f"{q}_scale_{a}": Scalar(2e-3) for q in ("gyro", "accel") for a in XYZ}
)
CASES = {
    "antenna, delay, slow receiver, wind and barometer": (
        manoeuvres.flight(*PLACE, 500.0, duration=100.0),
        AidedSuite(
            start_std=START, antenna=(1.0, 0.0, -0.5), antenna_std=0.3, gnss_delay_std=0.1, gnss_std=(0.1, 0.1, 0.2),
            gnss_correlated=(0.5, 0.5, 1.0), gnss_correlated_tau=20.0, speed_hz=2.0, speed_scale_std=0.01,
            speed_std=0.3, speed_is="air", current_std=5.0, current_walk=0.05, height_hz=1.0, height_bias_std=3.0,
            height_walk=0.05,
        ),
        {f"antenna_lever_{a}": Scalar(0.3, value=x) for a, x in zip(XYZ, (1.0, 0.0, -0.5), strict=True)}
        | {"gnss_delay": Scalar(0.1), "speed_scale": Scalar(0.01), "height_bias": Scalar(3.0, None, 0.05)}
        | {f"gnss_bias_{a}": Scalar(s, 20.0) for a, s in (("north", 0.5), ("east", 0.5), ("down", 1.0))}
        | {f"current_{a}": Scalar(5.0, None, 0.05) for a in ("north", "east")},
        {"gnss_position", "gnss_velocity", "speed", "height"},
    ),
    "mounting, odometer, DVL, depth and beacons": (
        manoeuvres.car(*PLACE, -20.0, stand=5.0, duration=100.0),
        AidedSuite(
            start_std=START, speed_hz=2.0, speed_scale_std=0.01, mounting_std=0.5 * D, dvl_hz=1.0, dvl_scale_std=0.003,
            dvl_misalignment_std=0.01, depth_hz=1.0, ranges_hz=1.0,
        ),
        {f"mounting_{a}": Scalar(0.5 * D) for a in ("roll", "pitch", "yaw")}
        | {f"dvl_misalignment_{a}": Scalar(0.01) for a in XYZ}
        | {"speed_scale": Scalar(0.01), "dvl_scale": Scalar(0.003)},
        {"gnss_position", "gnss_velocity", "speed", "dvl", "depth", "ranges"},
    ),
}  # fmt: skip
RUNS = 3


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CASES))
def test_a_plain_filter_is_as_good_as_it_claims(name: str) -> None:
    path, suite, scalars, kinds = CASES[name]
    states = BIASES | scalars
    found = []
    for run in range(RUNS):
        recording = simulate(path, IMU, suite, 50.0, seed=21, run=run)
        found.append(navigate(path, recording, suite, IMU, states, outage=(60.0, 80.0)))
    size = 9 + len(states)
    low, high = (chi2.ppf(p, size * RUNS) / (size * RUNS) for p in (5e-5, 1.0 - 5e-5))
    for when in (10, 59, 79, 99):  # s: early, before and at the end of the outage, at the end
        mean = np.mean([f.nees()[when - 1] for f in found])
        assert low < mean < high, when
    assert set(found[0].nis) == kinds
    for kind in kinds:
        assert np.mean([f.nis[kind] for f in found]) == pytest.approx(1.0, abs=0.2), kind
    # and it learns: the errors of the end are far below what was drawn
    learnt = "gnss_delay" if "gnss_delay" in states else "speed_scale"
    i = 9 + list(states).index(learnt)
    assert np.sqrt(found[0].P[-1, i, i]) < 0.5 * states[learnt].std
