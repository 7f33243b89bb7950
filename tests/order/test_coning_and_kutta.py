"""Orders and constants as claims: coning, sculling, Runge-Kutta on attitude."""

import math

import numpy as np
import pytest

from schuler.ground.frames import quat_conjugate, quat_multiply, rotvec_from_quat
from schuler.inertial import attitude_study as study
from schuler.inertial.strapdown import Start, Strapdown
from schuler.truth import trajectories as shapes

DEG_PER_H = math.radians(1.0) / 3600.0
CONE = math.radians(1.0)


def drift(coning: str, rate: float, frequency: float = 5.0, duration: float = 10.0) -> float:
    """Mean drift about the cone's axis, rad/s."""
    path = shapes.coning(0.0, 0.0, cone=CONE, frequency=frequency, duration=duration)
    ideal = path.ideal(rate)
    track = Strapdown(Start.of(ideal.start), coning=coning).feed(ideal.dtheta, ideal.dv, ideal.dt)
    step = 2 if coning == "pair" else 1
    turn = rotvec_from_quat(quat_multiply(track.q_nb, quat_conjugate(ideal.truth.q_nb[step - 1 :: step])))
    return float((turn[-1, 0] - turn[1, 0]) / (track.time[-1] - track.time[1]))  # the second row makes up for the first


def test_coning_of_one_degree_at_5_hz_and_200_hz_drifts_as_known() -> None:
    assert abs(drift("none", 200.0)) / DEG_PER_H == pytest.approx(4.05, abs=0.01)
    assert abs(drift("one", 200.0)) / DEG_PER_H == pytest.approx(0.020, abs=0.001)
    # with exact increments, memory of the previous one equals pairs, at twice the output rate
    assert abs(drift("pair", 200.0)) / DEG_PER_H == pytest.approx(0.020, abs=0.001)
    assert abs(drift("three", 200.0)) / DEG_PER_H < 0.004


@pytest.mark.parametrize(("coning", "order"), [("none", 2), ("one", 4), ("pair", 4), ("two", 4)])
def test_order_of_pure_coning(coning: str, order: int) -> None:
    rates = np.array([50.0, 100.0, 200.0])
    size = [abs(drift(coning, r, duration=4.0)) for r in rates]
    assert -np.polyfit(np.log(rates), np.log(size), 1)[0] == pytest.approx(order, abs=0.25)


@pytest.mark.parametrize(("coning", "order"), [("none", 2), ("two", 4), ("pair", 4)])
def test_order_of_sculling(coning: str, order: int) -> None:
    """Roll and sway in step rectify; the spurious acceleration of an uncorrected scheme falls as dt^2, else dt^4."""
    rates, miss = np.array([20.0, 40.0, 80.0]), []
    for rate in rates:
        ideal = (
            shapes.rest(0.0, 0.0, heading=math.pi / 2, duration=5.0)
            .with_waves(("roll", 0.05, 2.0, 0.0), ("pitch", 0.05, 2.0, 0.0), ("speed", 0.1, 2.0, math.pi / 2))
            .ideal(rate)
        )
        track = Strapdown(Start.of(ideal.start), coning=coning).feed(ideal.dtheta, ideal.dv, ideal.dt)
        step = 2 if coning == "pair" else 1
        miss.append(np.linalg.norm(track.v_n[-1] - ideal.truth.v_n[step - 1 :: step][-1]))
    assert -np.polyfit(np.log(rates), np.log(miss), 1)[0] > order - 0.4


@pytest.mark.parametrize(("order", "constant"), [(1, -1 / 4), (2, 1 / 12), (3, -1 / 48), (4, -1 / 960)])
def test_runge_kutta_drift_constants(order: int, constant: float) -> None:
    from schuler.published.sins_kinematics import constant as found

    assert found(order) == pytest.approx(constant, rel=1e-3)
    assert study.DRIFT_CONSTANTS[order] == constant


def test_the_drift_law_predicts_phase_amplitude_and_rate() -> None:
    """(2.50) with its constant: other amplitudes, rates and phases within a percent at small steps."""
    for order in (1, 2, 3, 4):
        law = study.Law((0.0, 0.03, 0.02), (2.0, 2.0, 2.0), (0.0, 0.0, (order + 1) * math.pi / 2 + 0.4))
        h = math.pi / 200
        found = study.psi_drift("euler", order, 200, law=law, periods=3)
        assert found == pytest.approx(study.drift_law(order, h, 0.03, 0.02, 2.0, law.phase[2]), rel=0.03)


def test_renormalised_cosines_stay_a_rotation() -> None:
    law = study.Law((0.0, 0.1, 0.2), phase=(0.0, math.pi / 2, 0.0))
    bad = study.integrate("poisson", 1, 0.05, 600.0, law=law, every=1000)
    good = study.integrate("poisson", 1, 0.05, 600.0, law=law, every=1000, renormalise=True)
    assert np.linalg.det(bad.C[-1]) == pytest.approx(2.1169, abs=5e-5)
    np.testing.assert_allclose(good.C[-1] @ good.C[-1].T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_attitude_error_falls_with_the_order_of_the_method(order: int) -> None:
    law = study.Law((0.3, 0.2, 0.4), (0.7, 1.0, 1.3), (0.1, 0.2, 0.9))
    steps = np.array([0.08, 0.04, 0.02])
    slopes = []
    for form in ("euler", "poisson", "quaternion"):
        miss = [np.abs(study.integrate(form, order, h, 4.0, law=law).error).max() for h in steps]
        slopes.append(np.polyfit(np.log(steps), np.log(miss), 1)[0])
    # the third order does better on angles whose slope hardly depends on them: Simpson's rule
    assert min(slopes) > order - 0.35
    assert order == 3 or max(slopes) < order + 0.35
