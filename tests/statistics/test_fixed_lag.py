"""The fixed lag lies between filter and full smoother, and all three are as good as they claim."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from schuler.aiding.aided import AidedSettings, Start, navigate
from schuler.aiding.aided_aids import aids_of
from schuler.aiding.aided_online import AidedFilter
from schuler.aiding.aided_rows import imu_rows
from schuler.aiding.solution import Solution
from schuler.ground.earth import WGS84
from schuler.ground.tables import Table
from schuler.truth import manoeuvres
from schuler.truth.aided import AidedSuite, simulate
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0
STD = (1.0, 1.0, 2.0, 0.1, 0.1, 0.1, 0.5 * D, 0.5 * D, 2.0 * D)
RUNS, LAG, LAST = 25, 5.0, 90.0


def miss(track: Solution, i: int, truth: Table) -> tuple[np.ndarray, float]:
    """Position and velocity error (6,) of a row, and its NEES (position and velocity apart, 6 degrees of freedom)."""
    k = int(np.argmin(np.abs(truth.time - track.time[i])))
    assert abs(truth.time[k] - track.time[i]) < 1e-6
    place = (truth["lat"][k], truth["lon"][k], truth["height"][k])
    d = WGS84.displacement_n(track.lat[i], track.lon[i], track.height[i], *place)
    v = track.v_n[i] - truth.stack("v_north", "v_east", "v_down")[k]
    nees = d @ np.linalg.solve(track.cov_pos[i], d) + v @ np.linalg.solve(track.cov_vel[i], v)
    return np.concatenate([d, v]), float(nees)


@pytest.mark.slow
def test_between_filter_and_smoother() -> None:
    path = manoeuvres.flight(50.0 * D, 30.0 * D, 500.0, duration=LAST + LAG)
    imu = ImuModel(gyro_arw_deg_per_sqrt_h=0.5, accel_vrw_mps_per_sqrt_h=0.3, gyro_bias_deg_per_h=30.0,
                   accel_bias_ug=2000.0)  # fmt: skip
    suite = AidedSuite(start_std=STD, gnss_hz=0.5, gnss_velocity=False, imu_kind="rates")
    rms = {name: [] for name in ("filter", "lag", "smoother")}
    nees = {name: [] for name in rms}
    for run in range(RUNS):
        recording = simulate(path, imu, suite, 50.0, seed=8, run=run)
        a = recording.start
        start = Start(
            time=a.time, lat=a.lat, lon=a.lon, height=a.height, v_n=tuple(map(float, a.v_n)), roll=float(a.rpy[0]),
            pitch=float(a.rpy[1]), heading=float(a.rpy[2]), std_pos=STD[:3], std_vel=STD[3:6], std_roll=STD[6],
            std_pitch=STD[7], std_heading=STD[8],
        )  # fmt: skip
        s = AidedSettings(
            start=start, gyro_arw=(0.5 * D / 60.0,) * 3, accel_vrw=(0.3 / 60.0,) * 3, gyro_walk=0.0, accel_walk=0.0,
            gyro_bias_std=(30.0 * D / 3600.0,) * 3, accel_bias_std=(0.0196,) * 3, gnss_correlated_std=0.0,
            output_rate=math.inf, estimate=("gyro_bias", "accel_bias"),
        )  # fmt: skip
        rows, queue = imu_rows(recording.tables["imu"]), aids_of(recording.tables, s)
        nav = AidedFilter(s, lag_s=LAG)
        k = 0
        for row in rows:
            nav.predict(row)
            while k < len(queue) and queue[k].time <= row[0]:
                nav.update(queue[k])
                k += 1
        late = nav.smoothed()
        batch = navigate(recording.tables, s)
        assert batch.smoother is not None
        i = int(np.argmin(np.abs(batch.filter.time - late.time[0])))
        for name, track, j in (("filter", batch.filter, i), ("lag", late, 0), ("smoother", batch.smoother, i)):
            error, claimed = miss(track, j, recording.reference)
            rms[name].append(error)
            nees[name].append(claimed)
    size = {name: np.sqrt(np.mean(np.square(e), axis=0)) for name, e in rms.items()}
    assert np.linalg.norm(size["lag"][:3]) < 0.8 * np.linalg.norm(size["filter"][:3])
    assert np.linalg.norm(size["lag"][3:]) < 0.8 * np.linalg.norm(size["filter"][3:])
    # the recording ends one lag later: here both have heard the same
    assert np.linalg.norm(size["smoother"]) == pytest.approx(np.linalg.norm(size["lag"]), rel=1e-6)
    low, high = (chi2.ppf(p, 6 * RUNS) / (6 * RUNS) for p in (5e-4, 1.0 - 5e-4))
    for name, values in nees.items():
        assert low < np.mean(values) / 6.0 < high, (name, np.mean(values) / 6.0)
