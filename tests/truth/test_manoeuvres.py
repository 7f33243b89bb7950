"""A car and an aircraft: within what such vehicles can do, standing when they stand, nose along the path."""

import math

import numpy as np
import pytest

from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_quat
from schuler.truth import manoeuvres

D = math.pi / 180.0
PLACE = (50.0 * D, 30.0 * D, 100.0)


@pytest.mark.parametrize("variety", [0, 1, 7])
def test_a_car_drives_like_one(variety: int) -> None:
    path = manoeuvres.car(*PLACE, heading=0.5, duration=900.0, variety=variety)
    s = path.at(np.arange(0.0, 900.0, 0.1))
    speed = np.linalg.norm(s.v_n, axis=1)
    still = speed == 0.0
    assert still[:300].all() and speed[400] > 1.0  # stands at first, then goes
    assert np.count_nonzero(np.diff(still.astype(int)) == 1) >= 3  # and stops again
    assert np.ptp(speed) > 12.0 and speed.max() < 20.0
    C = dcm_from_quat(s.q_nb)
    v_b = np.einsum("nji,nj->ni", C, s.v_n)
    assert np.abs(v_b[:, 1:]).max() < 1e-12 and v_b[:, 0].min() >= 0.0  # the nose follows the path
    accel = np.gradient(s.v_n, 0.1, axis=0)
    along = np.einsum("nj,nj->n", accel, C[:, :, 0])
    across = np.hypot(accel[:, 0], accel[:, 1])
    assert np.abs(along).max() < 2.6 and 2.0 < across.max() < 3.6
    assert np.abs(s.rpy[:, 0]).max() < 3.0 * D and np.abs(s.rpy[:, 1]).max() < 4.0 * D
    turned = np.unwrap(s.rpy[:, 2])
    assert np.ptp(turned) > 1.5
    assert np.array_equal(np.diff(s.lat)[still[1:] & still[:-1]], np.zeros(np.count_nonzero(still[1:] & still[:-1])))


@pytest.mark.parametrize("stand", [0.0, 20.0])
def test_a_flight_flies_like_one(stand: float) -> None:
    path = manoeuvres.flight(*PLACE, duration=1200.0, stand=stand)
    s = path.at(np.arange(0.0, 1200.0, 0.1))
    speed = np.hypot(s.v_n[:, 0], s.v_n[:, 1])
    if stand:
        assert np.all(speed[:200] == 0.0) and s.height.max() > 350.0
    flying = speed > 45.0
    assert np.ptp(speed[flying]) > 8.0 and np.mean(flying) > 0.9
    assert 15.0 * D < np.abs(s.rpy[:, 0]).max() < 36.0 * D
    assert np.abs(s.rpy[:, 1]).max() < 5.0 * D and np.ptp(s.height) > 150.0
    assert np.abs(s.f_b[flying, 1]).max() < 0.1  # coordinated: nothing pulls sideways (but Coriolis)
    assert np.ptp(np.unwrap(s.rpy[:, 2])) > 4.0


def test_another_variety_is_another_drive() -> None:
    ends = [manoeuvres.car(*PLACE, duration=300.0, variety=k).at(300.0).lat[0] for k in (0, 0, 1)]
    assert ends[0] == ends[1] != ends[2]


def test_what_cannot_drive_or_fly_is_refused() -> None:
    with pytest.raises(InputError, match="goes nowhere"):
        manoeuvres.car(*PLACE, speed=0.0)
    with pytest.raises(InputError, match="would fall"):
        manoeuvres.flight(*PLACE, speed=2.0)
