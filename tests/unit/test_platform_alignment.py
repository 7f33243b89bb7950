"""Loop design, margins, requirements, an unstable loop, the transient, gimbals."""

import math

import numpy as np
import pytest
from scipy import signal

from schuler.ground.errors import InputError
from schuler.inertial import platform as inertial
from schuler.inertial import platform_alignment as alignment
from schuler.inertial.platform import GRAVITY, PlatformCase

DEG = math.pi / 180.0


@pytest.mark.parametrize(
    ("natural", "damping", "lag"), [(0.03, 0.8, 0.0), (0.05, 0.5, 2.0), (0.02, 1.0, 0.0), (0.1, 1.5, 3.0)]
)
def test_response_and_margins_against_scipy(natural, damping, lag):
    loop = alignment.levelling_loop(natural, damping, lag)
    assert loop.natural == pytest.approx(natural)
    assert loop.damping == pytest.approx(damping)
    numerator = [2 * damping * natural, natural**2]
    denominator = [1.0, *numerator] if lag == 0.0 else [lag, 1.0, *numerator]
    t = np.linspace(0.0, 20.0 / natural, 2000)
    _, y = signal.step((numerator, denominator), T=t)
    np.testing.assert_allclose(loop.step_response(t), y, atol=1e-5)
    response = loop.response()
    assert response.overshoot_percent == pytest.approx(100.0 * (y.max() - 1.0), abs=0.02)
    late = t > response.settling_s * 1.001
    assert (np.abs(y[late] - 1.0) <= 0.0502).all()
    assert abs(np.interp(0.99 * response.settling_s, t, y) - 1.0) > 0.0495
    # crossover and phase margin on the open loop's own frequency response
    w = np.geomspace(natural / 100.0, natural * 100.0, 200001)
    size = np.abs(loop.open_loop(w))
    i = int(np.argmin(np.abs(size - 1.0)))
    assert loop.crossover == pytest.approx(w[i], rel=1e-3)
    margin = math.pi + float(np.angle(loop.open_loop(loop.crossover)))
    assert math.radians(response.phase_margin_deg) == pytest.approx(margin % (2 * math.pi), abs=1e-9)


def test_poles_are_roots_of_the_levelling_polynomial():
    loop = alignment.levelling_loop(0.03, 0.8)
    for pole in loop.poles:
        assert abs(pole**2 + GRAVITY * loop.kp * pole + GRAVITY * loop.ki) < 1e-15


@pytest.mark.parametrize("damping", [-0.1, 0.0])
def test_an_unstable_loop_is_refused_with_its_pole(damping):
    with pytest.raises(InputError, match=r"levelling loop is unstable: its pole at .* does not decay"):
        alignment.levelling_loop(0.03, damping)


def test_too_much_lag_is_refused_with_its_limit():
    limit = 2 * 0.8 / 0.05
    alignment.azimuth_loop(0.05, 0.8, 0.9 * limit)
    with pytest.raises(InputError, match=r"azimuth loop is unstable.*must stay below 32 s"):
        alignment.azimuth_loop(0.05, 0.8, 1.1 * limit)


def test_requirements_met_or_not_and_by_how_much():
    """The thesis's task sheet: a levelling loop of 0.03 rad/s cannot settle in 0.5 s."""
    loop = alignment.levelling_loop(0.03, 0.8)
    verdicts = {
        v.what: v
        for v in alignment.judge(
            loop,
            duration=1500.0,
            settling_s=0.5,
            overshoot_percent=5.0,
            steady_percent=0.1,
            phase_margin_deg=40.0,
            gain_margin_db=10.0,
        )
    }
    assert len(verdicts) == 5
    settling = verdicts["settling into 5 %"]
    assert not settling.met
    assert settling.in_hand == pytest.approx(0.5 - settling.reached)
    assert verdicts["phase margin"].met
    assert verdicts["phase margin"].in_hand == pytest.approx(29.86, abs=0.01)
    assert verdicts["gain margin"].met
    assert math.isinf(verdicts["gain margin"].reached)
    assert verdicts["steady error after 1500 s"].met
    assert alignment.judge(loop, duration=1500.0) == []


def test_the_transient_follows_the_linear_design():
    """Levelling of the whole platform against the loop's own response to a tilt; heading north: q is nearly 0."""
    case = PlatformCase(lat=35.7 * DEG, heading=0.0)
    level, azimuth = alignment.levelling_loop(0.03, 0.8), alignment.azimuth_loop(0.05, 0.8)
    run = alignment.align(case, level, azimuth, 300.0, start=(0.0, 0.01, 0.0))
    off = run.phi_y - alignment.end_values(case).phi_y - 0.01 * level.remaining(run.time)
    assert np.abs(off).max() < 1e-4  # 1 % of the tilt: g sin(tilt) and the coupling of the axes
    assert abs(off[-1]) < 1e-5


def test_alignment_on_the_ellipsoid_ends_on_the_plumb_line():
    case = PlatformCase(lat=50 * DEG, heading=1.0, earth="ellipsoid")
    run = alignment.align(case, alignment.levelling_loop(0.03, 0.8), alignment.azimuth_loop(0.05, 0.8), 1500.0)
    np.testing.assert_allclose(run.force[-1], 0.0, atol=1e-12)


def test_gimbal_angles_of_a_level_body():
    case = PlatformCase(lat=20 * DEG, heading=0.9)
    truth = inertial.truth_of(case, [0.0, 60.0])
    q_iS = inertial.body_attitude(truth, 0.9)
    angles = inertial.gimbal_angles(q_iS, inertial.body_attitude(truth, 0.4))
    np.testing.assert_allclose(angles, [[0.0, 0.0, 0.5]] * 2, atol=1e-12)


def test_gimbal_angles_rebuild_the_attitude():
    rng = np.random.default_rng(4)
    from schuler.ground.frames import dcm_from_quat

    q = rng.standard_normal((50, 2, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    outer, middle, inner = inertial.gimbal_angles(q[:, 0], q[:, 1]).T

    def about(axis, angle):
        rotation = np.zeros((len(angle), 3, 3))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        rotation[:, axis, axis] = 1.0
        rotation[:, i, i] = rotation[:, j, j] = np.cos(angle)
        rotation[:, i, j], rotation[:, j, i] = -np.sin(angle), np.sin(angle)
        return rotation

    built = about(0, outer) @ about(1, middle) @ about(2, inner)
    C_bS = np.swapaxes(dcm_from_quat(q[:, 1]), 1, 2) @ dcm_from_quat(q[:, 0])
    np.testing.assert_allclose(built, C_bS, atol=1e-12)


def test_a_body_that_pitches_up_is_warned_of_gimbal_lock():
    case = PlatformCase(lat=20 * DEG, heading=0.0)
    truth = inertial.truth_of(case, np.linspace(0.0, 60.0, 61))
    level = inertial.body_attitude(truth, 0.0)
    steep = inertial.body_attitude(truth, 0.0, pitch=np.linspace(0.0, 80.0 * DEG, 61))
    assert inertial.gimbal_warning(truth.time, inertial.gimbal_angles(level, level)) is None
    warning = inertial.gimbal_warning(truth.time, inertial.gimbal_angles(level, steep))
    assert warning is not None
    assert "80 deg at 60 s" in warning


def test_bad_cases_are_refused_in_words():
    with pytest.raises(InputError, match="must be positive"):
        PlatformCase(lat=0.1, height=-7e6)
    with pytest.raises(InputError, match="must be positive"):
        PlatformCase(lat=0.1, z_scale=0.0)
    with pytest.raises(InputError, match="duration"):
        PlatformCase(lat=0.1, duration=0.0)
    with pytest.raises(InputError, match=r"lost its position \d+ s on"):
        inertial.navigate(PlatformCase(lat=0.1, accel_bias=(20.0, 0.0)))
    with pytest.raises(InputError, match="lost its position in a case of the map"):
        inertial.errors_of([PlatformCase(lat=0.1, accel_bias=(20.0, 0.0))], "strapdown", "exact", (60.0,))
    with pytest.raises(InputError, match="no algorithm"):
        inertial.navigate(PlatformCase(lat=0.1), "free-heading")
    with pytest.raises(InputError, match="no form"):
        inertial.navigate(PlatformCase(lat=0.1), form="precise")


def test_the_transient_ends_on_the_end_values_with_every_error():
    """Scales of accelerometers and torquers act in the loops as in the end values."""
    case = PlatformCase(
        lat=math.radians(35.7),
        heading=math.radians(40.0),
        accel_bias=(1e-3, -2e-3),
        accel_scale=(2e-3, -1e-3),
        torquer_scale=(1e-3, -2e-3, 3e-3),
        drift=(5e-8, -1e-7, 5e-7),
        drift_carried=True,
        gimbal_bias=1e-3,
    )
    loops = alignment.levelling_loop(0.03, 0.8), alignment.azimuth_loop(0.05, 0.8)
    run = alignment.align(case, *loops, 1500.0, start=(0.01, -0.01, 0.02))
    end = alignment.end_values(case)
    np.testing.assert_allclose(run.commands[-1], end.commands, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose([run.phi_x[-1], run.phi_y[-1], run.psi[-1]], [end.phi_x, end.phi_y, end.psi], atol=1e-10)
