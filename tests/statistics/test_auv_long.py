"""A day at sea through the filter, piece by piece: the covariance stays one, the memory stays flat."""

import resource
import sys
from math import radians

import numpy as np
import pytest

from auv_missions import SHORT, SUITE, Case, events, feed, streams
from schuler.aiding.auv import AuvSettings
from schuler.truth.missions import Change
from schuler.truth.recording import stream

DAY = 86400.0
DIVE, BETWEEN = 3300.0, 300.0
MISSION = SHORT.with_changes(
    surface=300.0, dive=DIVE, between=BETWEEN, dives=24, final_surface=0.0, l_shape=True,
    speed_steps=(Change(700.0, 20.0, -0.5), Change(2000.0, 20.0, 0.5)),
    turns=(Change(900.0, 60.0, radians(170.0)), Change(2200.0, 60.0, radians(-175.0))),
    current_walk=0.04 / 60.0, descent=200.0, ascent=200.0, pitch_ramp=10.0,
)  # fmt: skip


def definite(P):
    """Symmetric and positive definite on the states in use; the smallest eigenvalue at unit diagonal."""
    variance = np.diag(P)
    assert np.isfinite(P).all() and (variance >= 0.0).all()
    active = np.flatnonzero(variance > 0.0)
    scale = 1.0 / np.sqrt(variance[active])
    R = P[np.ix_(active, active)] * scale * scale[:, None]
    assert np.abs(R - R.T).max() < 1e-11  # to rounding: each measurement makes it exactly so
    np.linalg.cholesky(R)
    assert np.abs(P[variance == 0.0]).max(initial=0.0) == 0.0
    return float(np.linalg.eigvalsh(R)[0])


def resident():
    """MB of this process now."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 2**20


@pytest.mark.slow
def test_a_day_at_sea():
    """24 h at 5 Hz, 24 dives of 55 min: rows one by one through the online filter, an hour at a time."""
    if not sys.platform.startswith("linux"):
        pytest.skip("reads /proc")
    nav = None
    smallest, sizes, sigmas, memory = [], [], [], []
    for piece in stream(MISSION, SUITE.with_changes(imu_rate_hz=5.0), seed=6, reference_hz=0.1, chunk_s=3600.0):
        made = Case(dict(piece.tables), AuvSettings(current_walk=0.04 / 60.0), piece)
        fresh, rows, measurements = streams(made)
        nav = nav or fresh
        feed(nav, events(rows, measurements))
        smallest.append(definite(nav.P))
        sigmas.append(np.sqrt(np.diag(nav.P)))
        sizes.append(len(nav.save()))
        memory.append(resident())
    assert len(smallest) == 24 and nav.time == pytest.approx(DAY, abs=1.0)
    assert min(smallest) > 1e-9
    assert np.isfinite(nav.x[:28]).all()
    # after the first hours every hour is alike: nothing grows, nothing freezes
    assert max(sizes[2:]) < 1.05 * min(sizes[2:])
    assert memory[-1] < max(memory[3:6]) + 5.0
    late, early = np.array(sigmas[-4:]), np.array(sigmas[4:8])
    assert (late.max(axis=0) <= 3.0 * early.max(axis=0) + 1e-12).all()
    truth = piece.truth
    miss = np.hypot((nav.lat - truth["lat"][-1]) * 6.37e6, (nav.lon - truth["lon"][-1]) * 5.1e6)
    told = nav.sigmas()
    assert miss < 4.0 * np.hypot(told["north"], told["east"])
