"""Kernels of kind "aided" against differences: every H, the transition, process noise, the error's algebra."""

import numpy as np
import pytest
from scipy.linalg import expm

from schuler.aiding.aided_engine import Engine
from schuler.aiding.aided_settings import ESTIMATES, AidedSettings, layout_of
from schuler.ground.frames import dcm_from_quat
from schuler.kernels import aided_measure as m
from schuler.kernels import aided_propagate as p
from schuler.kernels import aided_state as k

STEP = np.concatenate([np.full(3, 1e-5), np.full(3, 1e-3), np.full(3, 1e-2)])
SETTINGS = AidedSettings(user_std=(1.0, 1.0, 1.0, 1.0))
LAYOUT = layout_of(SETTINGS, ESTIMATES)
N = LAYOUT.n
IE = LAYOUT.ie


def engine(seed: int, settings: AidedSettings = SETTINGS, layout=LAYOUT) -> Engine:
    """A filter in the middle of a lively journey, every parameter away from zero."""
    rng = np.random.default_rng(seed)
    e = Engine(settings, layout, 0.01)
    x = e.x
    q = rng.normal(size=4)
    x[k.QUAT : k.QUAT + 4] = q / np.linalg.norm(q)
    x[k.VEL : k.VEL + 3] = rng.normal(0, 20, 3)
    x[k.LAT], x[k.LON], x[k.HGT] = rng.uniform(-1.2, 1.2), rng.uniform(-np.pi, np.pi), rng.uniform(-100, 5000)
    par = x[k.PAR : k.PAR + k.SLOTS]
    par[k.BG : k.BG + 3] = rng.normal(0, 0.01, 3)
    par[k.BA : k.BA + 3] = rng.normal(0, 0.1, 3)
    par[k.SG : k.MNT] = rng.normal(0, 0.02, k.MNT - k.SG)
    par[k.MNT : k.MNT + 3] = rng.normal(0, 0.3, 3)
    par[k.ANT : k.ANT + 9] = rng.normal(0, 1.5, 9)
    par[k.TG : k.TG + 4] = rng.uniform(0.01, 0.3, 4)
    par[k.KS], par[k.KR], par[k.KD] = rng.normal(0, 0.05, 3)
    par[k.CUR : k.CUR + 2] = rng.normal(0, 1, 2)
    par[k.GB : k.GB + 5] = rng.normal(0, 3, 5)
    par[k.DM : k.DM + 3] = rng.normal(0, 0.05, 3)
    par[k.HO], par[k.RB] = rng.normal(0, 0.1, 2)
    par[k.MB : k.MB + 3] = rng.normal(0, 3e-6, 3)
    x[k.W : k.W + 3] = rng.normal(0, 0.3, 3)
    x[k.ACC : k.ACC + 3] = rng.normal(0, 2, 3)
    x[k.BADH] = x[k.BADV] = x[k.BADS] = -1e300
    e.c[k.NHC : k.NHC + 3] = rng.normal(0, 1, 3)
    p.refresh_earth(x)
    return e


def step_of(j: int) -> float:
    if j < k.NAV:
        return float(STEP[j])
    if IE[k.MB] <= j < IE[k.MB] + 3:
        return 1e-8
    if IE[k.TG] <= j <= IE[k.TS]:
        return 1e-4
    return 1e-5


def shifted(x, j: int, h: float):
    """The state with an error of h more in component j; the rate's own error follows the gyro bias."""
    y = x.copy()
    d = np.zeros(N)
    d[j] = -h
    k.correct(y, IE, d)
    b = int(IE[k.BG])
    if b <= j < b + 3:
        y[k.W + j - b] -= h
    return y


def looked(x, slot):
    look = np.empty(m.LOOK)
    m.look_back(x, np.zeros((k.RING, k.RING_W)), x[k.PAR + slot] if slot is not None else 0.0, look)
    return look


def z_of(rng, *values):
    z = np.full(12, np.nan)
    z[: len(values)] = values
    return z


def place(x, rng, far=300.0):
    return (
        x[k.LAT] + rng.normal(0, far / 6.4e6),
        x[k.LON] + rng.normal(0, far / 6.4e6),
        x[k.HGT] + rng.normal(0, far / 3),
    )


def sensors(e, rng):
    """name -> f(x, H, r) -> rows, for every kind of measurement."""
    c, x0 = e.c, e.x
    lat, lon, up = place(x0, rng)
    fix, v = z_of(rng, lat, lon, up), z_of(rng, *rng.normal(0, 20, 3))
    beacon = z_of(rng, rng.uniform(10, 500), *place(x0, rng), 0.0)
    flat = beacon.copy()
    flat[4] = 1.0
    field = z_of(rng, *rng.normal(0, 2e-5, 3))
    one = z_of(rng, rng.normal(0, 10), 0.0, 0.0)
    rpy = z_of(rng, *rng.uniform(-1, 1, 3))
    w = rng.normal(0, 0.1, 3)
    relative = c.copy()
    relative[k.RELATIVE] = 1.0
    return {
        "position": lambda x, H, r: m.position(x, IE, e.c, looked(x, k.TG), fix, 3, H, r),
        "level": lambda x, H, r: m.position(x, IE, e.c, looked(x, k.TG), fix, 2, H, r),
        "height fix": lambda x, H, r: m.position(x, IE, e.c, looked(x, k.TG), fix, 1, H, r),
        "velocity": lambda x, H, r: m.velocity(x, IE, looked(x, k.TV), v, H, r),
        "course": lambda x, H, r: m.course(x, IE, looked(x, k.TV), one, H, r),
        "speed over ground": lambda x, H, r: m.speed(x, IE, c, looked(x, k.TS), one, H, r),
        "speed through water": lambda x, H, r: m.speed(x, IE, relative, looked(x, k.TS), one, H, r),
        "nhc": lambda x, H, r: m.nonholonomic(x, IE, c, looked(x, None), H, r),
        "dvl": lambda x, H, r: m.bottom_track(x, IE, looked(x, k.TD), v, H, r),
        "depth": lambda x, H, r: m.depth(x, IE, one, H, r),
        "height": lambda x, H, r: m.height(x, IE, one, H, r),
        "attitude": lambda x, H, r: m.attitude(x, IE, rpy, H, r),
        "magnetometer": lambda x, H, r: m.magnetometer(x, IE, c, field, H, r),
        "range": lambda x, H, r: m.distance(x, IE, beacon, H, r),
        "range in the plane": lambda x, H, r: m.distance(x, IE, flat, H, r),
        "zero velocity": lambda x, H, r: m.standing_velocity(x, H, r),
        "zero rate": lambda x, H, r: m.standing_rate(x, IE, w[0], w[1], w[2], H, r),
    }


NAMES = tuple(sensors(engine(0), np.random.default_rng(0)))


def evaluated(f, x):
    H, r = np.zeros((3, N)), np.zeros(3)
    rows = f(x, H, r)
    return H[:rows], r[:rows].copy()


ANGLES = {"course", "attitude", "magnetometer"}
TOLERANCE = {"range": 1e-5, "range in the plane": 1e-4}  # the plane is that of one place, and the Earth is round


@pytest.mark.parametrize("name", NAMES)
def test_h_is_the_derivative_of_the_prediction(name):
    tried = 0
    for seed in range(8):
        e = engine(seed)
        x = e.x
        if name == "attitude" and abs(dcm_from_quat(x[k.QUAT : k.QUAT + 4])[2, 0]) > 0.95:
            continue
        f = sensors(e, np.random.default_rng(1000 + seed))[name]
        H, _ = evaluated(f, x)
        wanted = np.zeros_like(H)
        for j in range(N):
            h = step_of(j)
            up, down = evaluated(f, shifted(x, j, h))[1], evaluated(f, shifted(x, j, -h))[1]
            d = up - down
            if name in ANGLES:
                d = (d + np.pi) % (2 * np.pi) - np.pi
            wanted[:, j] = d / (2 * h)
        size = np.maximum(np.maximum(np.abs(wanted), 0.01 * np.abs(wanted).max(axis=0, keepdims=True)), 1e-3)
        worst = np.abs(H - wanted) / size
        j = int(np.argmax(worst.max(axis=0)))
        assert worst.max() < TOLERANCE.get(name, 2e-6), (name, seed, j, LAYOUT.names, H[:, j], wanted[:, j])
        tried += 1
    assert tried >= 5


def test_every_parameter_is_seen_by_some_sensor_or_by_the_motion():
    e = engine(3)
    seen = np.zeros(N, dtype=bool)
    for f in sensors(e, np.random.default_rng(1)).values():
        seen |= np.abs(evaluated(f, e.x)[0]).max(axis=0) > 0
    phi = transition(e, 0.05)
    seen |= np.abs(phi[: k.NAV]).max(axis=0) > 0
    unseen = {i for i in range(N) if not seen[i]}
    assert unseen == set(range(int(IE[k.USER]), int(IE[k.USER]) + 4))


def test_correct_and_difference_undo_each_other():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = engine(seed).x
        d = rng.normal(0, 1, N)
        d[:3] *= 0.3
        d[3:6] *= 10.0
        d[6:9] *= 1000.0
        y = x.copy()
        k.correct(y, IE, d)
        back = np.zeros(N)
        k.difference(x, y, IE, back)
        np.testing.assert_allclose(back, d, rtol=0, atol=2e-9 * 1000)
        np.testing.assert_allclose(back[:3], d[:3], rtol=0, atol=1e-14)
        np.testing.assert_allclose(back[9:], d[9:], rtol=0, atol=1e-14)


def test_attitude_error_has_the_sign_of_the_conventions():
    x = engine(5).x
    d = np.zeros(N)
    d[:3] = 1e-6, -2e-6, 3e-6
    truth = x.copy()
    k.correct(truth, IE, d)
    C_hat, C = (np.asarray(dcm_from_quat(y[k.QUAT : k.QUAT + 4])) for y in (x, truth))
    cross = np.array([[0, -d[2], d[1]], [d[2], 0, -d[0]], [-d[1], d[0], 0]])
    np.testing.assert_allclose(C_hat, (np.eye(3) - cross) @ C, atol=1e-11)


# ---- transition and process noise --------------------------------------------------------------------------------


def begun(e, seed):
    """A row of a lively IMU has begun: rates 1 rad/s, slopes of both."""
    rng = np.random.default_rng(seed)
    e.x[k.T] = e.x[k.TROW] = 0.0
    e.x[k.ROWS] = 1.0
    e.x[k.DTRAW] = 0.01
    e.x[k.WRAW : k.WRAW + 3] = rng.normal(0, 1.0, 3)
    e.x[k.FRAW : k.FRAW + 3] = rng.normal(0, 10.0, 3)
    e.x[k.WSLOPE : k.WSLOPE + 3] = rng.normal(0, 2.0, 3)
    e.x[k.FSLOPE : k.FSLOPE + 3] = rng.normal(0, 20.0, 3)
    return e


def advanced(e, x, dt, P=None, keep=False, layout=LAYOUT):
    y = x.copy()
    n = layout.n
    P = np.zeros((n, n)) if P is None else P
    S = np.eye(n)
    dec, qd = np.ones(n), np.zeros(n)
    p.advance(y, P, S, dec, qd, layout.beta, layout.noise, layout.ie, e.c, np.zeros(n), dt, False,
              np.zeros((2, k.NAV, n)), keep)  # fmt: skip
    return y, P, S


def transition(e, dt):
    return advanced(begun(e, 77), e.x, dt, keep=True)[2]


def by_differences(e, dt):
    """The 9 x n transition from advancing states that differ by a little."""
    phi = np.zeros((k.NAV, N))
    d = np.zeros(N)
    middle = advanced(e, e.x, dt)[0]
    for j in range(N):
        h = {0: 1e-3, 1: 0.1, 2: 10.0}.get(j // 3, 1e-3)  # large: a place in radians is known to a nanometre only
        ends = []
        for sign in (1.0, -1.0):
            y = shifted(e.x, j, sign * h)
            p.refresh_earth(y)
            ends.append(advanced(e, y, dt)[0])
            ends[-1][k.RN : k.CLAT + 1] = middle[k.RN : k.CLAT + 1]  # one ruler for both
        k.difference(ends[0], ends[1], IE, d)
        phi[:, j] = d[: k.NAV] / (2 * h)
    return phi


UNITS = np.concatenate([np.full(3, 1e-3), np.full(3, 0.1), np.full(3, 1.0)])  # what an error of each kind weighs


def unit_columns():
    u = np.full(N, 1e-2)
    u[: k.NAV] = UNITS
    u[6:9] = 100.0
    return u


def weighed(phi):
    """phi with rows in units of a filter's usual errors, columns too."""
    return phi * unit_columns()[None, :] / UNITS[:, None]


def test_transition_against_differences():
    for seed in range(3):
        e = begun(engine(seed), seed)
        wanted, got = by_differences(e, 0.005), advanced(e, e.x, 0.005, keep=True)[2][: k.NAV]
        np.testing.assert_allclose(got, wanted, rtol=0, atol=2e-6)
        np.testing.assert_allclose(weighed(got), weighed(wanted), rtol=0, atol=5e-6)


def test_transition_is_of_second_order():
    """Its error falls with dt^3: slope by a fit over three halvings, in every block of rows."""
    steps = np.array([0.08, 0.04, 0.02, 0.01])
    e = begun(engine(11), 11)
    errors = []
    for dt in steps:
        e.x[k.TQ] = 0.0
        d = weighed(advanced(e, e.x, dt, keep=True)[2][: k.NAV]) - weighed(by_differences(e, dt))
        errors.append([np.abs(d[i : i + 3]).max() for i in (0, 3, 6)])
    slopes = [np.polyfit(np.log(steps), np.log(column), 1)[0] for column in np.array(errors).T]
    assert min(slopes) > 2.8, slopes


def van_loan(e, layout, dt):
    """Qd of the continuous model whose transition over a short time the kernel gives, by Van Loan."""
    n = layout.n
    tiny = 1e-4
    y = e.x.copy()
    y[k.WSLOPE : k.WSLOPE + 3] = y[k.FSLOPE : k.FSLOPE + 3] = 0.0
    half = advanced(e, y, tiny, keep=True, layout=layout)[2]
    A = (half - np.eye(n)) / tiny
    A[k.NAV :, k.NAV :] = -np.diag(layout.beta[k.NAV :])
    C = np.asarray(dcm_from_quat(y[k.QUAT : k.QUAT + 4]))
    Q = np.diag(layout.noise.copy())
    Q[:3, :3] = C @ np.diag(e.c[k.ARW2 : k.ARW2 + 3]) @ C.T
    Q[3:6, 3:6] = C @ np.diag(e.c[k.VRW2 : k.VRW2 + 3]) @ C.T
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -A, Q, A.T
    E = expm(block * dt)
    return E[n:, n:].T @ E[:n, n:]


@pytest.mark.parametrize("alike", [True, False])
def test_process_noise_against_van_loan_and_its_order(alike):
    noisy = dict(gyro_arw=(1e-2, 1e-2, 1e-2), accel_vrw=(0.3, 0.3, 0.3))
    if not alike:
        noisy = dict(gyro_arw=(1e-2, 2e-2, 5e-3), accel_vrw=(0.3, 0.1, 0.6))
    s = AidedSettings(**noisy, gyro_walk=1e-2, accel_walk=0.1, gnss_correlated_tau=5.0)
    layout = layout_of(s, ("gyro_bias", "accel_bias", "gnss_bias"))
    e = begun(engine(4, s, layout), 4)
    e.x[k.WRAW : k.WRAW + 3] *= 0.3
    e.x[k.WSLOPE : k.WSLOPE + 3] = e.x[k.FSLOPE : k.FSLOPE + 3] = 0.0
    steps = np.array([0.16, 0.08, 0.04, 0.02])
    errors = []
    for dt in steps:
        wanted = van_loan(e, layout, dt)
        e.x[k.TQ] = 0.0
        got = advanced(e, e.x, dt, layout=layout)[1]
        np.testing.assert_allclose(got, got.T, atol=1e-18)
        size = np.sqrt(np.outer(e.c[k.ARW2 : k.ARW2 + 3], e.c[k.ARW2 : k.ARW2 + 3]).max())
        errors.append(
            [
                np.abs((got - wanted)[:3, :3]).max() / size,
                np.abs((got - wanted)[3:6, 3:6]).max() / e.c[k.VRW2],
                np.abs((got - wanted)[6:9, 3:6]).max() / e.c[k.VRW2],
            ]
        )
        np.testing.assert_allclose(np.diag(got)[3:6], np.diag(wanted)[3:6], rtol=2.0 * dt)
    slopes = [np.polyfit(np.log(steps), np.log(column), 1)[0] for column in np.array(errors).T]
    assert slopes[0] > 1.8 and slopes[1] > 1.8 and slopes[2] > 2.4, slopes


def test_gauss_markov_parameters_are_exact_at_any_step():
    s = AidedSettings(gnss_correlated_tau=2.0, gnss_correlated_std=3.0)
    layout = layout_of(s, ("gyro_bias", "gnss_bias"))
    i = int(layout.ie[k.GB])
    for dt in (1e-3, 0.1, 1.0, 5.0):
        e = begun(engine(1, s, layout), 1)
        P = np.diag(layout.std**2)
        P[i, i] = 1.0
        value = float(e.x[k.PAR + k.GB])
        x, P, _ = advanced(e, e.x, dt, P, layout=layout)
        a = np.exp(-dt / 2.0)
        assert P[i, i] == pytest.approx(a**2 + 9.0 * (1 - a**2), rel=1e-12)
        # the stationary variance stays what it is
        assert P[i + 1, i + 1] == pytest.approx(9.0, rel=1e-12)
        assert x[k.PAR + k.GB] == pytest.approx(value * a, rel=1e-12)
        # a random walk gathers q t
        b = int(layout.ie[k.BG])
        assert P[b, b] == pytest.approx(layout.std[b] ** 2 + layout.noise[b] * dt, rel=1e-12)


# ---- delays ------------------------------------------------------------------------------------------------------


def journey(seed, seconds=1.0, dt=0.005):
    """A filter that has kept its past over a lively second."""
    rng = np.random.default_rng(seed)
    layout = layout_of(SETTINGS, ESTIMATES)
    e = engine(seed)
    e.x[k.T] = e.x[k.TROW] = 0.0
    past = []
    for i in range(1, round(seconds / dt) + 1):
        t = i * dt
        w = 0.5 * np.sin(3.0 * t + np.arange(3.0)) + 0.02 * rng.normal(size=3) * 0
        f = np.array([2 * np.sin(2 * t), 3 * np.cos(t), -9.8])
        p.begin_row(e.x, e.c, t, *w, *f)
        p.advance(e.x, e.P, e.S, e.dec, e.qd, layout.beta, layout.noise, layout.ie, e.c, e.dx, t, False, e.work, False)
        p.end_row(e.x, t, e.ring)
        past.append(e.x.copy())
    return e, past, dt


def test_a_late_row_is_met_by_the_state_of_its_own_moment():
    """Residuals of a late fix, velocity and DVL against those of the state that was then, without delay."""
    e, past, dt = journey(2)
    look = np.empty(m.LOOK)
    for late in (40, 41, 77):
        then, tau = past[-1 - late], late * dt
        H, r, r0 = np.zeros((3, N)), np.zeros(3), np.zeros(3)
        x = e.x.copy()
        x[k.PAR + k.TG] = x[k.PAR + k.TV] = x[k.PAR + k.TD] = tau
        x[k.PAR + k.GB : k.PAR + k.GB + 3] = then[k.PAR + k.GB : k.PAR + k.GB + 3]  # it decays
        rest = then.copy()
        rest[k.PAR + k.TG] = rest[k.PAR + k.TV] = rest[k.PAR + k.TD] = 0.0
        fix = z_of(None, then[k.LAT] + 1e-6, then[k.LON], then[k.HGT])
        m.look_back(x, e.ring, tau, look)
        assert look[13] == 1.0
        nothing = looked(rest, None)
        m.position(x, IE, e.c, look, fix, 3, H, r)
        m.position(rest, IE, e.c, nothing, fix, 3, H, r0)
        np.testing.assert_allclose(r, r0, atol=2e-4)
        v = z_of(None, 1.0, 2.0, 3.0)
        for f in (m.velocity, m.bottom_track):
            f(x, IE, look, v, H, r)
            f(rest, IE, nothing, v, H, r0)
            np.testing.assert_allclose(r, r0, atol=1e-9)


def test_the_delay_is_seen_through_speed_and_acceleration():
    """H of the delay against differences of the residual over the kept past."""
    e, _, _ = journey(6)
    fix = z_of(None, e.x[k.LAT], e.x[k.LON], e.x[k.HGT])

    def residual(tau):
        x = e.x.copy()
        x[k.PAR + k.TG] = tau
        look, H, r = np.empty(m.LOOK), np.zeros((3, N)), np.zeros(3)
        m.look_back(x, e.ring, tau, look)
        m.position(x, IE, e.c, look, fix, 3, H, r)
        return r.copy(), H[:, IE[k.TG]].copy()

    for tau in (0.1025, 0.3025):
        (up, _), (down, _), (_, H) = residual(tau + 0.002), residual(tau - 0.002), residual(tau)
        # the arm turns too: its own speed is no part of H and is small beside the vehicle's
        l_n = np.linalg.norm(e.x[k.PAR + k.ANT : k.PAR + k.ANT + 3])
        np.testing.assert_allclose(H, (up - down) / 0.004, atol=0.9 * l_n + 0.02)


def test_a_stamp_of_the_future_is_met_with_the_mean_acceleration():
    e, _, _ = journey(2)
    look = np.empty(m.LOOK)
    m.look_back(e.x, e.ring, -0.1, look)
    v, a = e.x[k.VEL : k.VEL + 3], e.x[k.ACC : k.ACC + 3]
    np.testing.assert_allclose(look[:3], -0.1 * v - 0.005 * a)
    np.testing.assert_allclose(look[3:6], -0.1 * a)
