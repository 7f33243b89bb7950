"""The Earth-fixed form: its track is that of the level form, its error model that of its own equations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from schuler.ground.earth import WGS84, C_en
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler, dcm_from_rotvec
from schuler.inertial import ecef, error_dynamics
from schuler.inertial.strapdown import Start, Strapdown, Track
from schuler.truth import trajectories as shapes
from schuler.truth.trajectories import TEXTBOOK

D = math.pi / 180.0
F_B = np.array([0.3, -0.5, -9.7])
W_B = np.array([0.01, -0.02, 0.03])
C_NB = np.asarray(dcm_from_euler(0.1, 0.05, 0.7))
V_N = np.array([141.0, 141.0, -2.0])


def manoeuvres(duration, climbs=(300.0, 0.0, -200.0)):
    """A flight at 200 m/s with four coordinated turns, climbs, and a rolling, pitching, speeding vehicle."""
    path = shapes.legs(
        50 * D, 179.9 * D, 3000.0, speed=200.0, heading=0.7, turns=[1.5, -2.0, 2.5, -1.0], climbs=list(climbs),
        duration=duration,
    )  # fmt: skip
    return path.with_waves(("roll", 0.05, 0.5, 0.0), ("pitch", 0.03, 0.3, 1.0), ("speed", 1.0, 0.2, 0.3))


def short(duration=20.0):
    path = shapes.rhumb_line(50 * D, 179.9 * D, 3000.0, speed=200.0, heading=0.7, duration=duration)
    return path.with_waves(("roll", 0.3, 0.4, 0.0), ("pitch", 0.1, 0.3, 1.0), ("course", 0.2, 0.1, 0.0))


def both(path, rate, **options):
    ideal = path.ideal(rate, every=int(rate))
    start, made = Start.of(ideal.start), []
    for form in (Strapdown, ecef.StrapdownEcef):
        t = form(start, earth=path.earth, **options).feed(ideal.dtheta, ideal.dv, ideal.dt, every=int(rate))
        made.append(Track(ideal.truth.time, t.lat, t.lon, t.height, t.v_n, t.q_nb))
    return *made, ideal.truth


@pytest.mark.slow
def test_one_hour_gives_the_track_of_the_level_form():
    """1 h of manoeuvres at 400 Hz with ideal height: 1e-6 m. With a free vertical, where an error grows 270-fold in
    the hour, the two differ by what the level form is off the truth; the Earth-fixed form is at 2e-6 m of it."""
    level, earth_fixed, truth = both(manoeuvres(3600.0, ()), 400.0, vertical="held")
    between = earth_fixed.minus(level)
    assert between.horizontal.max() < 1e-6
    assert np.abs(between.position[:, 2]).max() < 1e-8
    assert np.abs(between.velocity).max() < 5e-9 and np.abs(between.phi).max() < 1e-12
    level, earth_fixed, truth = both(manoeuvres(3600.0), 400.0)
    off, own, ned = (a.minus(b) for a, b in ((earth_fixed, level), (earth_fixed, truth), (level, truth)))
    assert own.horizontal.max() < 1e-6 and np.abs(own.position[:, 2]).max() < 2e-6
    assert np.abs(off.position).max() < 1.1 * np.abs(ned.position).max()


@pytest.mark.parametrize("earth", [WGS84, TEXTBOOK], ids=["ellipsoid", "sphere"])
def test_ten_minutes_free(earth):
    path = shapes.legs(-33.0 * D, 1.0, 100.0, speed=150.0, heading=2.0, turns=[1.0], climbs=[200.0, -100.0],
                       duration=600.0, earth=earth)  # fmt: skip
    level, earth_fixed, _ = both(path, 200.0)
    assert np.abs(earth_fixed.minus(level, earth).position).max() < 2e-6


def test_its_error_falls_as_the_fourth_power_of_the_interval():
    """Against the truth at 12.5, 25 and 50 Hz in a rolling, weaving flight."""
    path, errors = short(100.0), []
    for rate in (12.5, 25.0, 50.0):
        ideal = path.ideal(rate, every=1)
        t = ecef.StrapdownEcef(Start.of(ideal.start)).feed(ideal.dtheta, ideal.dv, ideal.dt)
        t = Track(ideal.truth.time, t.lat, t.lon, t.height, t.v_n, t.q_nb)
        errors.append(np.abs(t.minus(ideal.truth).position).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (slopes > 3.5).all(), errors


def test_over_the_pole():
    path = shapes.great_circle(89.5 * D, 0.3, 1000.0, speed=250.0, heading=0.05, duration=600.0)
    level, earth_fixed, truth = both(path, 100.0, vertical="held")
    assert np.max(truth.lat) > 89.9 * D
    assert earth_fixed.minus(truth).horizontal.max() < 2e-5


@pytest.mark.parametrize("coning", ["none", "one", "two", "three"])
def test_samples_one_by_one_give_the_bits_of_the_batch(coning):
    ideal = short().ideal(50.0)
    start = Start.of(ideal.start)
    whole = ecef.StrapdownEcef(start, coning=coning).feed(ideal.dtheta, ideal.dv, ideal.dt)
    ins = ecef.StrapdownEcef(start, coning=coning)
    cuts = [0, 1, 2, 5, 300, len(ideal.time)]
    parts = [ins.feed(ideal.dtheta[a:b], ideal.dv[a:b], ideal.dt) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
    for name in ("lat", "lon", "height", "v_n", "q_nb"):
        assert np.array_equal(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name))
    level = Strapdown(start, coning=coning).feed(ideal.dtheta, ideal.dv, ideal.dt)
    assert np.abs(whole.minus(level).position).max() < 1e-6


def test_restart_keeps_what_was_learnt():
    ideal = short().ideal(50.0)
    ins = ecef.StrapdownEcef(Start.of(ideal.start))
    ins.feed(ideal.dtheta[:500], ideal.dv[:500], ideal.dt)
    ins.restart(Start.of(ideal.truth, 499))
    after = ins.feed(ideal.dtheta[500:], ideal.dv[500:], ideal.dt)
    fields = ("time", "lat", "lon", "height", "v_n", "q_nb", "w_ib_b", "f_b")
    rest = type(ideal.truth)(*(getattr(ideal.truth, f)[500:] for f in fields))
    after = Track(rest.time, after.lat, after.lon, after.height, after.v_n, after.q_nb)
    assert np.abs(after.minus(rest).position).max() < 1e-6


def test_what_it_does_not_do_is_said():
    ideal = short().ideal(50.0)
    start = Start.of(ideal.start)
    for options in ({"coning": "pair"}, {"vertical": "aided"}):
        with pytest.raises(InputError, match='frame = "ned"'):
            ecef.StrapdownEcef(start, **options)
    with pytest.raises(InputError, match="above 0 s"):
        ecef.StrapdownEcef(start).feed(ideal.dtheta, ideal.dv, 0.0)
    bad = ideal.dv.copy()
    bad[3] = np.nan
    with pytest.raises(InputError, match="stopped being a number"):
        ecef.StrapdownEcef(start).feed(ideal.dtheta, bad, ideal.dt)


# ---- the error model ----


def stencil(f, s):
    return (8 * (f(s) - f(-s)) - f(2 * s) + f(-2 * s)) / (12 * s)


@pytest.mark.parametrize("earth", [WGS84, TEXTBOOK], ids=["ellipsoid", "sphere"])
@pytest.mark.parametrize("place", [(50.27, 30.0, 0.0), (-12.0, -140.0, 9000.0), (89.0, 5.0, 300.0)])
def test_every_element_of_F_against_differences(earth, place):
    """81 + 54 elements of the e form, 1e-9 of the largest contribution in their block."""
    lat, lon, h = place[0] * D, place[1] * D, place[2]
    r, v, C = ecef.to_e(lat, lon, h, V_N, C_NB, earth)
    zero = ecef.nonlinear_rate(r, v, C, W_B, F_B, earth)

    def slope(x, u):
        C_hat = dcm_from_rotvec(-x[:3]) @ C
        C_dot, v_dot, r_dot = ecef.nonlinear_rate(r + x[6:9], v + x[3:6], C_hat, W_B + u[3:], F_B + u[:3], earth)
        M = -(C_dot @ C.T + C_hat @ zero[0].T)
        phi = np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]) / 2
        return np.concatenate([phi, v_dot - zero[1], r_dot - zero[2]])

    steps = [1e-4] * 3 + [1.0] * 3 + [300.0] * 3
    F = ecef.error_matrix(r, C @ F_B, earth)
    F_num = np.column_stack(
        [stencil(lambda s, e=e: slope(s * e, np.zeros(6)), s) for s, e in zip(steps, np.eye(9), strict=True)]
    )
    B_num = np.column_stack(
        [stencil(lambda s, e=e: slope(np.zeros(9), s * e), s)
         for s, e in zip([1e-2] * 3 + [1e-4] * 3, np.eye(6), strict=True)]
    )  # fmt: skip
    typical = np.array([1e-4] * 3 + [0.1] * 3 + [60.0] * 3)
    row = np.repeat(np.abs(F_num * typical).reshape(3, 27).max(axis=1), 3)[:, None]  # of the three rows of a kind
    assert (np.abs(F - F_num) * typical / row).max() < 1e-9
    assert np.abs(ecef.input_matrix(C) - B_num).max() < 1e-9


def test_the_gradient_makes_schuler_and_the_unstable_vertical():
    """Its eigenvalues at rest: -g/R across, 2 g/R along (0.5 %); the point mass' gradient is that to 0.5 %."""
    r = WGS84.ecef_from_geodetic(0.8, 0.3, 0.0)
    C = C_en(0.8, 0.3)
    G = C.T @ ecef.gravity_gradient(r) @ C
    w2 = 9.81 / 6.37e6
    np.testing.assert_allclose(np.diag(G), [-w2, -w2, 2 * w2], rtol=8e-3)
    simple = C.T @ ecef.point_mass_gradient(r) @ C
    np.testing.assert_allclose(simple, G, atol=0.008 * 2 * w2)
    assert np.abs(ecef.gravity_e(r) - C @ WGS84.gravity_n(0.8, 0.0)).max() < 1e-14


def test_it_is_the_phi_form_in_other_axes():
    """T' + T F_e = F_n T, T the map of errors from e to n: two models, one physics. On the sphere, along a motion."""
    earth, lat, lon, h = TEXTBOOK, 50.27 * D, 0.4, 800.0
    _, v_dot, p_dot = error_dynamics.nonlinear_rate(lat, h, V_N, C_NB, W_B, F_B, earth)
    e = 2.0
    T = {
        k: ecef.phi_from_e(lat + k * e * p_dot[0], lon + k * e * p_dot[1], h + k * e * p_dot[2], V_N + k * e * v_dot,
                           earth)
        for k in (-2, -1, 0, 1, 2)
    }  # fmt: skip
    T_dot = (T[-2] - 8 * T[-1] + 8 * T[1] - T[2]) / (12 * e)
    r, _, C = ecef.to_e(lat, lon, h, V_N, C_NB, earth)
    F_e = ecef.error_matrix(r, C @ F_B, earth)
    S = np.diag([1.0] * 6 + [earth.a + h, (earth.a + h) * math.cos(lat), -1.0])
    S_dot = np.zeros((9, 9))
    S_dot[6, 6] = p_dot[2]
    S_dot[7, 7] = p_dot[2] * math.cos(lat) - (earth.a + h) * math.sin(lat) * p_dot[0]
    F_n = error_dynamics.phi_matrix(lat, h, V_N, C_NB @ F_B, earth)
    F_n = (S @ F_n + S_dot) @ np.linalg.inv(S)  # on NED metres
    # dr in NED metres of lat, lon, h is not C_ne dr_e in motion: the metres north and east turn with the place
    left, right = (T_dot + T[0] @ F_e) @ np.linalg.inv(T[0]), F_n
    typical = np.array([1e-4] * 3 + [0.1] * 3 + [60.0] * 3)
    size = np.abs(right * typical).max(axis=1)[:, None]
    assert (np.abs(left - right) * typical / size).max() < 1e-6


def test_a_study_runs_in_either_frame(tmp_path):
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    ends = {}
    for frame in ("ned", "ecef"):
        study = parse_study({
            "study": {"name": "frames", "kind": "strapdown"}, "start": {"lat_deg": 50.0, "height_m": 1000.0},
            "trajectory": {"preset": "legs", "speed_mps": 100.0, "turns_deg": [60.0], "duration_s": 240.0},
            "imu": {"gyro_bias_deg_per_h": 0.5, "accel_bias_ug": 100}, "filter": {"frame": frame},
        })  # fmt: skip
        ends[frame] = run_study(study).navigation.filter
    assert np.abs(ends["ned"].lat - ends["ecef"].lat).max() * 6.4e6 < 1e-6
    assert not np.array_equal(ends["ned"].lat, ends["ecef"].lat)
    assert np.abs(ends["ned"].rpy - ends["ecef"].rpy).max() < 1e-11
