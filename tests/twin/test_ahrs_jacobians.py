"""The attitude filter: transition and heading row against differences, smoother against the dense formula."""

import numpy as np
import pytest

from ahrs_motion import SETTINGS
from schuler.aiding.ahrs import configuration, euler_errors, initial
from schuler.ground.frames import dcm_from_rotvec, euler_from_dcm
from schuler.kernels import ahrs, ahrs_smooth, hard_iron
from schuler.kernels import ahrs_state as k

RNG = np.random.default_rng(5)
ROWS, DT = 10, 0.01
STATES = [i for i in range(k.N) if i != k.E_M]


def rows():
    """Rates and specific force that change within the node."""
    s = np.linspace(0.0, 1.0, ROWS)[:, None]
    w = np.array([0.3, -0.5, 0.8]) + s * np.array([0.4, 0.2, -0.6])
    f = np.array([1.0, -0.7, -9.6]) + s * np.array([-0.5, 1.2, 0.3])
    return w, f


def started(error=None):
    c = configuration(SETTINGS, DT, True)
    c[k.NODE_S], c[k.EARTH_N], c[k.EARTH_D] = 1e9, 0.0, 0.0
    x, P = initial(SETTINGS, 0.0, True)
    x[k.STATUS] = 3.0
    x[k.QUAT : k.QUAT + 4] = [0.8, 0.3, -0.4, np.sqrt(1.0 - 0.64 - 0.09 - 0.16)]
    x[k.BG : k.BG + 3], x[k.BA : k.BA + 3], x[k.U : k.U + 2] = [0.01, -0.02, 0.03], [0.1, -0.2, 0.05], [0.3, -0.1]
    if error is not None:
        k.correct(x, -error)
    return c, x, P


def moved(error=None):
    """Nominal state and sums after one node's rows, begun with an error."""
    c, x, P = started(error)
    scratch = (
        np.zeros(k.NK),
        np.zeros((k.N, k.N)),
        np.zeros(k.NOMINAL),
        np.zeros((k.N, k.N)),
        np.zeros((ahrs.WORK, k.N)),
    )
    w, f = rows()
    for i in range(ROWS):
        ahrs.step(x, P, c, (i + 1) * DT, *w[i], *f[i], np.nan, np.nan, np.nan, *scratch)
    return c, x, P


@pytest.mark.parametrize("i", STATES)
def test_transition(i):
    c, x, P = moved()
    Phi = np.zeros((k.N, k.N))
    k.predict(x, P, Phi, c, ROWS * DT)
    small = 1e-5
    d = np.zeros((2, k.N))
    for n, sign in enumerate((1.0, -1.0)):
        e = np.zeros(k.N)
        e[i] = sign * small
        _, y, _ = moved(e)
        y[k.M] = x[k.M]
        ahrs_smooth.difference(y[: k.NOMINAL], x[: k.NOMINAL], d[n])
    column = (d[0] - d[1]) / (2.0 * small)
    # what the node leaves out: how C and f change within it, second order in 0.1 s and 1 rad/s
    scale = 1.0 + np.abs(column).max()
    np.testing.assert_allclose(Phi[STATES, i], column[STATES], atol=6e-3 * scale)
    assert np.abs(column).max() > 0.9


def test_covariance_follows_the_transition():
    c, x, _ = moved()
    A = RNG.standard_normal((k.N, k.N))
    P0 = A @ A.T
    P, Phi = P0.copy(), np.zeros((k.N, k.N))
    k.predict(x, P, Phi, c, ROWS * DT)
    Q = P - Phi @ P0 @ Phi.T
    np.testing.assert_allclose(Q, np.diag(np.diag(Q)), atol=1e-9)
    assert (np.diag(Q) >= -1e-9).all() and Q[0, 0] > 0.0 and Q[k.E_U, k.E_U] > 0.0
    assert abs(Q[k.E_BG, k.E_BG] - SETTINGS.gyro_walk**2 * ROWS * DT) < 1e-12


def test_heading_row():
    """y = azimuth(C_hat m) - declination - m_hat, and y = h e: its derivative by the errors."""
    C = dcm_from_rotvec(np.array([0.4, -0.9, 0.6]))
    m_b = C.T @ np.array([0.19, 0.03, 0.45])
    mean = C @ m_b
    h = np.zeros(k.N)
    ahrs.heading_row(*mean, h)

    def y(e):
        m = dcm_from_rotvec(-e[:3]) @ C @ m_b
        return np.arctan2(m[1], m[0]) - e[k.E_M]

    for i in range(k.N):
        e = np.zeros(k.N)
        e[i] = 1e-6
        assert abs((y(e) - y(-e)) / 2e-6 - h[i]) < 1e-8


def test_errors_of_the_angles():
    C = dcm_from_rotvec(np.array([0.5, 0.7, -1.2]))
    rpy = np.array(euler_from_dcm(C))
    E = euler_errors(rpy[None])[0]
    for i in range(3):
        phi = np.zeros(3)
        phi[i] = 1e-6
        ahead, back = (np.array(euler_from_dcm(dcm_from_rotvec(-s * phi) @ C)) for s in (1.0, -1.0))
        np.testing.assert_allclose((ahead - back) / 2e-6, E[:, i], atol=1e-8)


def test_update_is_the_usual_one():
    A = RNG.standard_normal((k.N, k.N))
    P0 = A @ A.T
    h, y, R = RNG.standard_normal(k.N), 0.7, 0.3
    S = h @ P0 @ h + R
    for heading_only in (False, True):
        K = P0 @ h / S
        if heading_only:
            K[[0, 1]] = 0.0
            K[k.E_BA : k.E_M] = 0.0
        I = np.eye(k.N) - np.outer(K, h)
        P, d, work = P0.copy(), np.zeros(k.N), np.zeros((4, k.N))
        k.update(P, d, h, y, R, heading_only, work)
        np.testing.assert_allclose(P, I @ P0 @ I.T + np.outer(K, K) * R, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(d, K * y, rtol=1e-12)


def test_hard_iron_is_the_least_squares_centre():
    """The kernel's normal equations against numpy's least squares over the same rows with the same fading."""
    C = np.array([dcm_from_rotvec(v) for v in RNG.uniform(-2.0, 2.0, (40, 3))])
    b = np.array([0.2, -0.1, 0.3])
    m = np.einsum("nji,j->ni", C, np.array([0.4, 0.0, 0.9])) + b + 0.003 * RNG.standard_normal((40, 3))
    s, A = np.zeros(hard_iron.NS), np.zeros((4, 5))
    taken, found = [], False
    for row in m:
        before = s[hard_iron.ROWS]
        if hard_iron.look(s, A, *row):
            found = True
        if s[hard_iron.ROWS] != before:
            taken.append(row)
            weight = (1.0 - 1.0 / hard_iron.MEMORY) ** np.arange(len(taken))[::-1]
            H = np.column_stack([2.0 * np.array(taken), np.ones(len(taken))]) * np.sqrt(weight)[:, None]
            y = np.sum(np.array(taken) ** 2, axis=1) * np.sqrt(weight)
            if s[hard_iron.FOUND] and len(taken) > hard_iron.FEWEST + 2:
                want = np.linalg.lstsq(H, y, rcond=None)[0][:3]
                np.testing.assert_allclose(s[hard_iron.B : hard_iron.B + 3], want, atol=1e-6)
    assert found and len(taken) > 30
    np.testing.assert_allclose(s[hard_iron.B : hard_iron.B + 3], b, atol=0.02)


def test_smoother_is_the_dense_formula():
    """Three linear nodes with known matrices."""
    n = 3
    nx, ux = np.zeros((n, k.NOMINAL)), np.zeros((n, k.NOMINAL))
    nx[:, 0] = ux[:, 0] = 1.0
    nx[:, 4:] = RNG.standard_normal((n, k.N - 3))
    ux[:, 4:] = RNG.standard_normal((n, k.N - 3))
    nP, uP, nX = (np.zeros((n, k.N, k.N)) for _ in range(3))
    for i in range(n):
        A, B = RNG.standard_normal((2, k.N, k.N))
        uP[i] = A @ A.T
        nX[i] = np.eye(k.N) + 0.1 * B
        nP[i] = (nX[i] @ uP[i - 1] @ nX[i].T if i else A @ A.T) + np.eye(k.N)
    want_P, want = uP[-1].copy(), ux[-1, 4:].copy()
    filtered_x, filtered_P = ux.copy(), uP.copy()
    ahrs_smooth.smooth(n, nx, nP, ux, uP, nX)
    d = np.concatenate([np.zeros(3), nx[-1, 4:] - want])  # errors of the predicted
    P = want_P
    for i in (1, 0):
        G = filtered_P[i] @ nX[i + 1].T @ np.linalg.inv(nP[i + 1])
        post = G @ d
        P = filtered_P[i] + G @ (P - nP[i + 1]) @ G.T
        np.testing.assert_allclose(uP[i], P, rtol=1e-6, atol=1e-8)
        state = filtered_x[i, 4:] - post[3:]
        np.testing.assert_allclose(ux[i, 4:], state, rtol=1e-6, atol=1e-8)
        ahrs_smooth.difference(nx[i], ux[i], d)
