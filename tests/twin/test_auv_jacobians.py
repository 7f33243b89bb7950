"""The AUV filter's linearisations against central differences of its own nominal functions.

error = estimate - truth, so an estimate with the error d is `correct(truth, -d)`, and `difference` reads an error back.
The Jacobian that a measurement uses is read off its effect: with P = p e_i e_i' and a large R its correction of state i
is (p / R) sum_a H[a, i] r[a].
"""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest

from schuler.aiding.auv import AuvFilter, AuvSettings
from schuler.aiding.auv_settings import Start
from schuler.kernels import auv_state as k
from schuler.kernels.auv_measure import _settle
from schuler.kernels.auv_run import (
    BOTTOM_TRACK,
    DEPTH,
    INNOVATION,
    POSITION,
    SPEED,
    VELOCITY,
    advance,
    inner_blocks,
    measure,
)
from schuler.kernels.auv_smooth import difference
from schuler.kernels.rotation import quat_from_euler

START = Start(lat=0.6, lon=0.9, height=-20.0, heading=1.0)
SETTINGS = AuvSettings(start=START, gate=False, wave_std=0.08)
MODES = ["imu", "compass"]


def state(mode="imu", drift=False, settings=SETTINGS, log=True, depth=True, dvl=True, mag=True):
    """x, c of a vehicle under way: nothing is zero, and it turns and pitches."""
    compass = mode == "compass"
    nav = AuvFilter(settings, compass=compass, log=log, depth=depth, dvl=dvl, mag=mag and not compass)
    first = [0.0, 0.1, -0.2, 1.0] if compass else [0.0, 0, 0, 0, 0, 0, -9.8, *([20.0, 1.0, 40.0] if mag else [])]
    nav.predict(np.array(first))
    assert nav.started
    x = nav.x
    x[k.QUAT : k.QUAT + 4] = quat_from_euler(0.1, -0.3, 1.0)
    x[k.ROLL], x[k.PITCH], x[k.HEAD] = 0.1, -0.3, 1.0 + 0.02
    x[k.BG : k.BG + 3] = 1e-3, -2e-3, 5e-4
    x[k.BA : k.BA + 3] = 0.02, -0.01, 0.03
    x[k.U], x[k.K], x[k.KP], x[k.KD], x[k.M] = 2.3, 0.02, -0.03, 0.01, 0.02
    x[k.CN], x[k.CE], x[k.EN], x[k.EE] = 0.2, -0.1, 1.5, -0.7
    x[k.DN], x[k.DE] = 0.15, 0.25
    x[k.W : k.W + 4] = 0.05, 0.02, -0.04, 0.03
    x[k.RATE : k.RATE + 3] = 0.02, -0.03, 0.1
    x[k.VREF], x[k.VREF + 1] = 1.2, 1.7
    x[k.DREF], x[k.DREF + 1], x[k.DMAX] = 0.0, 0.0, 1e9  # the second-order term is no linearisation
    x[k.STEADY], x[k.ROWS] = x[k.U], 5.0
    x[k.TELLS] = 1.0
    if drift:
        x[k.DRIFT], x[k.TINFO] = 1.0, -1e6
    k.refresh_earth(x)
    k.reset_levelling(x)
    return x, nav.c


def wrong_by(x, c, i, size):
    """The estimate whose error component i is `size` where x is the truth."""
    d = np.zeros(k.N)
    d[i] = -size
    y = x.copy()
    k.correct(y, c, d)
    return y


def residual(x, c, take):
    """r = predicted - measured of `take(x, P, X, c, out)`, nothing believed to be uncertain."""
    out = np.zeros(INNOVATION)
    take(x.copy(), np.zeros((k.N, k.N)), np.zeros((k.N, k.N)), c, out)
    return -out[: int(out[7])], out[3 : 3 + int(out[7])]


STEP = np.full(k.N, 1e-3)
STEP[k.E_PHI : k.E_BG] = STEP[k.E_M] = STEP[k.E_K] = STEP[k.E_KP] = STEP[k.E_KD] = 1e-4
STEP[k.E_BG : k.E_BA] = 1e-5


def numeric(x, c, take):
    """dr/d(error), (m, N), by central differences."""
    columns = []
    for i in range(k.N):
        plus, minus = (residual(wrong_by(x, c, i, s * STEP[i]), c, take)[0] for s in (1.0, -1.0))
        columns.append((plus - minus) / (2.0 * STEP[i]))
    return np.array(columns).T


def used(x, c, takes):
    """H (m, N) that a measurement uses; takes: as many variants of it as it has components, with other residuals."""
    r = np.array([residual(x, c, take)[0] for take in takes])
    variance = residual(x, c, takes[0])[1] ** 2
    assert np.linalg.cond(r) < 10.0
    H = np.zeros((r.shape[1], k.N))
    for i in range(k.N):
        p = 1e-5 * variance[0]
        effects = []
        for take in takes:
            P = np.zeros((k.N, k.N))
            P[i, i] = p
            y = x.copy()
            d = np.zeros(k.N)
            take(y, P, np.zeros((k.N, k.N)), c, np.zeros(INNOVATION))
            difference(c, x, y, d)
            effects.append(d[i] * variance[0] / p)
        H[:, i] = np.linalg.solve(r, effects)
    return H


def external(kind, z):
    def take(x, P, X, c, out):
        measure(x, P, X, c, kind, np.array(z, dtype=np.float64), out)

    return take


def fixes(x):
    """Two fixes tens of metres from where x thinks it is."""
    return [
        external(POSITION, (x[k.LAT] + dn / x[k.RN], x[k.LON] + de / (x[k.RE] * x[k.CLAT]), np.nan, 1.0, 1.0, 1.0, 0))
        for dn, de in ((30.0, 2.0), (-3.0, 25.0))
    ]


VELOCITIES = [external(VELOCITY, (*v, 0.0, 1.0, 1.0, 1.0, 0.0)) for v in ((30.0, 0.0), (0.0, 30.0))]
SPEEDS = [external(SPEED, (40.0, 0, 0, 1.0, 0, 0, 0))]
DVLS = [external(BOTTOM_TRACK, (*v, 0.0, 1.0, 0, 0, 0)) for v in ((40.0, 0.0), (0.0, 40.0))]
DEPTHS = [external(DEPTH, (60.0, 0, 0, 1.0, 0, 0, 0))]


def close(a, b, rtol=2e-4, atol=3e-5):
    np.testing.assert_allclose(a, b, rtol=rtol, atol=atol)


@pytest.mark.parametrize("drift", [False, True])
@pytest.mark.parametrize("mode", MODES)
def test_every_measurement_uses_its_own_derivative(mode, drift):
    x, c = state(mode, drift)
    for takes in (fixes(x), VELOCITIES, SPEEDS, DVLS, DEPTHS):
        expected = numeric(x, c, takes[0])
        assert np.abs(expected).max() > 0.5
        close(used(x, c, takes), expected)


@pytest.mark.parametrize("mode", MODES)
def test_the_headings_column_takes_the_steady_speed(mode):
    """Only that column: a trembling estimate of the speed shall not tell heading and current apart."""
    x, c = state(mode)
    expected = numeric(x, c, VELOCITIES[0])
    x[k.STEADY] = 1.1 * x[k.U]
    found = used(x, c, VELOCITIES)
    turn = [k.E_M] if mode == "compass" else [0, 1, 2]
    expected[:, turn] *= 1.1
    close(found, expected)


@pytest.mark.parametrize("drift", [False, True])
def test_a_fix_of_an_antenna_away_from_the_imu(drift):
    x, c = state(settings=replace(SETTINGS, antenna=(1.5, -0.4, -2.0)), drift=drift)
    H = used(x, c, fixes(x))
    close(H, numeric(x, c, fixes(x)[0]))
    assert abs(H[0, 1]) > 1.0  # the lever arm turns with the vehicle


@pytest.mark.parametrize("mode", MODES)
def test_a_late_fix_leaves_out_only_the_errors_of_the_way_since(mode):
    """r = p - delay v: H keeps the position's part, and what it leaves out is exactly delay dv/d(error)."""
    delay = 0.2
    x, c = state(mode, settings=replace(SETTINGS, gnss_delay=delay))
    c[k.ANT : k.ANT + 3] = 0.0
    own = replace(SETTINGS, gnss_delay=0.0)
    close(used(x, c, fixes(x)), numeric(x, c, fixes(x)[0]) + delay * numeric(*state(mode, settings=own), VELOCITIES[0]))


@pytest.mark.parametrize(
    "arms,size",
    [({"antenna": (1.5, -0.4, -2.0)}, 0.3), ({"gnss_delay": 0.2}, 0.05), ({"dvl_arm": (0.8, 0.3, 0.5)}, 0.0)],
)
def test_velocities_of_points_away_from_the_imu(arms, size):
    """The arm's own velocity w x a (0.2 m/s here) and the turn within a delay count in r; in H they are left out."""
    x, c = state(settings=replace(SETTINGS, **arms))
    takes = DVLS if "dvl_arm" in arms else VELOCITIES
    close(used(x, c, takes), numeric(x, c, takes[0]), atol=size + 3e-5)
    plain = residual(*state(), takes[0])[0]
    assert np.abs(residual(x, c, takes[0])[0] - plain).max() > 0.02


def test_the_velocity_of_an_arm_is_that_of_rigid_motion():
    arm, w = np.array([1.5, -0.4, -2.0]), np.array([0.02, -0.03, 0.1])
    x, c = state(settings=replace(SETTINGS, antenna=tuple(arm), dvl_arm=tuple(arm), speed_arm=tuple(arm)))
    base, at_arm = state(), (x, c)
    C_nb = np.array(k.dcm_from_quat(*x[:4])).reshape(3, 3)
    moved = {t: residual(*at_arm, takes[0])[0] - residual(*base, takes[0])[0] for t, takes in
             (("v", VELOCITIES), ("dvl", DVLS), ("log", SPEEDS))}  # fmt: skip
    swing = np.cross(w, arm)
    close(moved["v"], (C_nb @ swing)[:2], atol=1e-12)
    close(moved["dvl"], (1.0 + x[k.KD]) * swing[:2], atol=1e-12)
    close(moved["log"], swing[:1], atol=1e-12)


def test_a_height_teaches_the_height_where_there_is_no_depth_sensor():
    x, c = state(depth=False)
    z = np.array([x[k.LAT], x[k.LON], x[k.HGT] + 4.0, 1e3, 1e3, 1.0, 0.0])
    P = np.diag(np.where(np.arange(k.N) == k.E_D, 1.0, 0.0))
    y = x.copy()
    measure(y, P, np.zeros((k.N, k.N)), c, POSITION, z, np.zeros(INNOVATION))
    assert y[k.HGT] - x[k.HGT] == pytest.approx(2.0) and P[k.E_D, k.E_D] == pytest.approx(0.5)


# --- blocks of the IMU: the error at the block's beginning grows to the one at its end, where H belongs -------------


RATE = 20


@cache
def felt(seconds, turn):
    """IMU rows of steady motion: force, rate and field as the vehicle of `state` feels them, sensor biases as in it."""
    x, _ = state()
    rows = []
    for i in range(round(seconds * RATE)):
        heading = 1.0 + turn * (i + 0.5) / RATE
        C_nb = np.array(k.dcm_from_quat(*quat_from_euler(0.1, -0.3, heading))).reshape(3, 3)
        w = C_nb.T @ (np.array([0.0, 0.0, turn]) + x[k.WIN : k.WIN + 3])
        v = x[k.U] * np.exp(x[k.KP]) * np.cos(-0.3)
        a = v * turn * np.array([-np.sin(heading), np.cos(heading), 0.0])
        f = C_nb.T @ (a - np.array([0.0, 0.0, x[k.GRAV]]))
        field = C_nb.T @ np.array([20.0, 1.0, 40.0])
        rows.append(np.array([(i + 1) / RATE, *(w + x[k.BG : k.BG + 3]), *(f + x[k.BA : k.BA + 3]), *field]))
    return rows


def block(x, c, seconds, turn=0.0):
    """Moves x on by `seconds` of steady motion and returns Phi."""
    X, P = np.eye(k.N), np.zeros((k.N, k.N))
    for i, row in enumerate(felt(seconds, turn)):
        advance(x, P, X, c, row[0], row, True)
        if i % 2 == 1:
            k.flush(x, P, X, c)
    k.flush(x, P, X, c)
    return X


def inner_take(which, shift):
    """The levelling (0) or magnetometer (1) block that x holds, its residual moved by `shift`."""

    def take(x, P, X, c, out):
        if which == 0:
            x[k.LS : k.LS + 2] += np.array(shift) * x[k.LT]
        else:
            x[k.MS] += shift * x[k.MT]
        inner, flags = np.zeros((2, INNOVATION)), np.zeros(2)
        inner_blocks(x, P, X, c, inner, flags)
        assert flags[which] == 1.0
        out[:] = inner[which]

    return take


def through(which, seconds, turn):
    """(H Phi used, dr/d(error at the beginning) by differences, H), rows the block's components."""
    x, c = state()
    c[k.ARW] = 0.0  # else a random walk inside the block correlates state and noise, which is no matter of H
    if which == 1:
        c[k.LEVEL_S] = 1e9
    else:
        c[k.DECLINATION] = 0.0
    plain = inner_take(which, (0.0, 0.0) if which == 0 else 0.0)
    columns = []
    for i in range(k.N):
        r = []
        for s in (1.0, -1.0):
            y = wrong_by(x, c, i, s * STEP[i])
            k.reset_levelling(y)
            y[k.MT] = y[k.MS] = 0.0
            block(y, c, seconds, turn)
            if which == 0:
                y[k.MT] = 0.0
            r.append(residual(y, c, plain)[0])
        columns.append((r[0] - r[1]) / (2.0 * STEP[i]))
    y = x.copy()
    Phi = block(y, c, seconds, turn)
    if which == 0:
        y[k.MT] = 0.0
        takes = [inner_take(0, s) for s in ((1.0, 0.0), (0.0, 1.0))]
    else:
        takes = [inner_take(1, 0.5)]
    H = used(y, c, takes)
    return H @ Phi, np.array(columns).T, H


@pytest.mark.parametrize("turn", [0.0, 0.05])
def test_levelling(turn):
    """A block of 10 s: tilt and biases, to 2 %. Left out: how an error of heading rate turns v (2.3 m/s beside g t/2 =
    49 m/s), and how errors of u and path scale change v x turn; the variance of u is in R."""
    got, expected, H = through(0, 10.0, turn)
    g, v = 9.8, 2.3
    known = [0, 1, 2, *range(k.E_BA, k.E_BA + 3)]
    close(got[:, known], expected[:, known], rtol=0.01, atol=0.01 * g)
    bias = [k.E_BG, k.E_BG + 1, k.E_BG + 2]
    assert np.abs(expected[:, bias]).max() > 40.0
    # In a turn the tilt of half a block ago lay in other axes than the mean ones.
    close(got[:, bias], expected[:, bias], rtol=0.02, atol=v + 49.0 * 10.0 * turn / 6.0)
    rest = [i for i in range(k.N) if i not in (*known, *bias)]
    assert np.abs(expected[:, rest]).max() < 3e-4 + v * turn and np.abs(H[:, rest]).max() < 1e-6


def test_magnetometer():
    """A block of 1 s: heading, tilt and offset. Left out: what a gyro bias turns in half a second (0.5 s x 2)."""
    got, expected, H = through(1, 1.0, 0.05)
    bias = [k.E_BG, k.E_BG + 1, k.E_BG + 2]
    others = [i for i in range(k.N) if i not in bias]
    close(got[:, others], expected[:, others], rtol=2e-3, atol=2e-3)
    close(got[:, bias], expected[:, bias], atol=1.0)
    assert H[0, 2] == pytest.approx(-1.0, rel=1e-3) and H[0, k.E_M] == pytest.approx(1.0, rel=1e-3)
    assert np.abs(H[0, :2]).max() > 0.5  # a steep field makes tilt look like heading


# --- the transition -------------------------------------------------------------------------------------------------


def moved(x, c, mode, tau, steps=10):
    """Nominal state after tau, and Phi."""
    y, P, X = x.copy(), np.zeros((k.N, k.N)), np.eye(k.N)
    for i in range(steps):
        t = x[k.T] + tau * (i + 1) / steps
        if mode == "imu":
            row = np.array([t, 0.02, -0.03, 0.1, 1.0, 0.5, -9.6, 20.0, 1.0, 40.0])
        else:
            row = np.array([t, 0.1, -0.3, x[k.HEAD] + 0.1 * tau * (i + 1) / steps])
        advance(y, P, X, c, t, row, True)
    k.flush(y, P, X, c)
    return y, X


@pytest.mark.parametrize("drift", [False, True])
@pytest.mark.parametrize("mode", MODES)
def test_transition(mode, drift):
    """Phi of a covariance step: to first order in tau; what it leaves out is v w tau^2/2 (2.3 x 0.1 x 0.005 m/rad)."""
    x, c = state(mode, drift)
    tau = 0.1
    y, Phi = moved(x, c, mode, tau)
    assert y[k.DRIFT] == float(drift)
    columns = []
    for i in range(k.N):
        ends = [moved(wrong_by(x, c, i, s * STEP[i]), c, mode, tau)[0] for s in (1.0, -1.0)]
        d = np.zeros(k.N)
        difference(c, *ends, d)
        columns.append(d / (2.0 * STEP[i]))
    expected = np.array(columns).T
    bias = np.zeros((k.N, k.N), bool)  # not compared
    if mode == "imu":
        # A gyro bias acts on the position only through the attitude: tau^2 / 2 within a step, all of it over several.
        bias[k.E_N : k.E_D + 1, k.E_BG : k.E_BG + 3] = True
        assert np.abs(expected[bias]).max() < 2.4 * tau**2 / 2.0
    else:
        bias[: k.E_BG] = True  # the attitude is the compass's, turned by its offset alone
    close(Phi[~bias], expected[~bias], rtol=2e-4, atol=2e-4)
    if mode == "imu":  # n turns by 7e-6 rad meanwhile
        np.testing.assert_allclose(Phi[:3, :3], expected[:3, :3], rtol=0, atol=5e-8)
        assert np.abs(expected[:3, :3] - np.eye(3)).max() > 2e-6
    if not drift:
        assert np.abs(expected[k.E_N, k.E_CN]) == pytest.approx(tau, rel=1e-3)
        assert np.abs(expected - np.eye(k.N)).max() > 0.1


@pytest.mark.parametrize("mode", MODES)
def test_transition_without_log_and_slope(mode):
    """Where depth rate does not tell the speed, the height stops following the pitch, in Phi as in the state."""
    x, c = state(mode, log=False)
    x[k.TELLS] = 0.0
    y, Phi = moved(x, c, mode, 0.1)
    assert y[k.HGT] == x[k.HGT]
    assert np.array_equal(Phi[k.E_D], np.eye(k.N)[k.E_D])


# --- corrections and differences ------------------------------------------------------------------------------------


def random_error(rng, scale=1.0):
    d = rng.standard_normal(k.N) * scale
    d[k.E_PHI : k.E_BG] *= 0.3
    d[k.E_BG : k.E_BA] *= 1e-3
    d[k.E_M] *= 0.3
    d[[k.E_N, k.E_E, k.E_D]] *= 100.0
    d[[k.E_K, k.E_KP, k.E_KD]] *= 0.05
    return d


@pytest.mark.parametrize("mode", MODES)
def test_correct_and_difference_undo_each_other(mode):
    rng = np.random.default_rng(3)
    for _ in range(20):
        x, c = state(mode)
        d = random_error(rng)
        if mode == "compass":
            d[k.E_PHI : k.E_BG] = 0.0, 0.0, d[k.E_M]  # the attitude is the compass's, turned by its offset
        y, back = x.copy(), np.zeros(k.N)
        k.correct(y, c, d)
        difference(c, x, y, back)
        np.testing.assert_allclose(back, d, rtol=1e-9, atol=1e-8)
        difference(c, x, x, back)
        np.testing.assert_allclose(back, 0.0, atol=1e-15)


def test_difference_across_the_date_line():
    x, c = state()
    x[k.LON] = -np.pi + 1e-7
    d = np.zeros(k.N)
    d[k.E_E] = 50.0
    y = x.copy()
    k.correct(y, c, d)
    assert y[k.LON] > 3.0
    difference(c, x, y, d)
    assert d[k.E_E] == pytest.approx(50.0, abs=1e-8)


def settled(x, c, d):
    """T (N, N) with which a correction by d carries the covariance, column by column, and the corrected state."""
    T = np.zeros((k.N, k.N))
    for i in range(k.N):
        after, P = x.copy(), np.zeros((k.N, k.N))
        P[i, i] = 1.0
        _settle(after, P, c, d)
        np.testing.assert_array_equal(P, P.T)
        T[:, i] = P[:, i]
    return T, after


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("turn_deg", [0.5, 5.0, 20.0])
@pytest.mark.parametrize("since_fix", [0.5, 100.0])
def test_carried_covariance_is_that_of_the_corrected_state(since_fix, mode, turn_deg):
    """Correcting by d moves the point of linearisation: the error that remains is J (error - d), J by differences.

    The current's rows follow it; the attitude's own bend, at most half the turn, is left out.
    """
    x, c = state(mode)
    x[k.T] = x[k.TC] = x[k.TFIX] + since_fix
    d = np.zeros(k.N)
    h = 2 if mode == "imu" else k.E_M
    d[h] = radians(turn_deg)
    d[k.E_CN], d[k.E_CE], d[k.E_U] = 0.05, -0.08, 0.1
    T, after = settled(x, c, d)
    columns = []
    for i in range(k.N):
        found = []
        for s in (1.0, -1.0):
            e = d.copy()
            e[i] += s * STEP[i]
            truth, left = x.copy(), np.zeros(k.N)
            k.correct(truth, c, e)
            difference(c, after, truth, left)
            found.append(left)
        columns.append((found[0] - found[1]) / (2.0 * STEP[i]))
    J = np.array(columns).T
    keep = [i for i in range(k.N) if i >= k.E_BG and not (mode == "compass" and i < k.E_N)]
    close(T[np.ix_(keep, keep)], J[np.ix_(keep, keep)], atol=2e-3)
    close(T[k.E_CN : k.E_CE + 1, h], J[k.E_CN : k.E_CE + 1, h], atol=2e-3 + 0.5 * radians(turn_deg) ** 2 * 2.1)
    assert np.abs(T[k.E_CN : k.E_CE + 1, h]).max() > 0.8 * radians(turn_deg) * 2.0 * 0.5


def test_without_a_current_nothing_is_carried():
    x, c = state(settings=replace(SETTINGS, current_std=0.0))
    d = np.zeros(k.N)
    d[2] = 0.2
    T, after = settled(x, c, d)
    assert np.array_equal(T, np.eye(k.N))
    assert (after[k.CN], after[k.CE]) == (x[k.CN], x[k.CE])
