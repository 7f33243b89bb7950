"""The smoother of kind "aided": against a dense batch solution and a readable twin, and what it must keep."""

from dataclasses import replace

import numpy as np
import pytest
from test_aided_update import recording, settings_of

from schuler.aiding.aided import navigate
from schuler.aiding.aided_engine import Engine, StartState, node_bytes, room
from schuler.aiding.aided_rows import Events
from schuler.aiding.aided_settings import AidedSettings, layout_of
from schuler.kernels import aided_measure as m
from schuler.kernels import aided_state as k
from schuler.kernels.aided_smooth import gain, smooth

NAMES = ("gyro_bias", "accel_bias", "gnss_bias")
QUIET = AidedSettings(
    estimate=NAMES, gate=False, gnss_correlated_std=1.0, gnss_correlated_tau=5.0, node_interval=0.5,
    gyro_bias_std=(1e-4,) * 3, accel_bias_std=(1e-2,) * 3, gyro_walk=1e-5, gyro_arw=(1e-4,) * 3,
)  # fmt: skip


def run(settings=QUIET, seconds=12.0, seed=0, sigma=0.3, cov=None, start=None, nodes=200):
    """A filter with small errors at rest, fixes every 2 s that scatter; its engine, nodes kept."""
    rng = np.random.default_rng(seed)
    e = Engine(settings, layout_of(settings, settings.estimate), 0.1)
    cov = np.diag([1e-6] * 3 + [1e-2] * 3 + [1.0] * 3) if cov is None else cov
    e.begin(StartState(0.0, np.array([1.0, 0, 0, 0]), np.zeros(3), 0.87, 0.52, 100.0, cov, level_from_force=False))
    n = round(seconds / 0.1)
    rows = np.zeros((n, 7))
    rows[:, 0] = 0.1 * np.arange(1, n + 1)
    rows[:, 1:4] = [7.292115e-5 * np.cos(0.87), 0.0, -7.292115e-5 * np.sin(0.87)]
    rows[:, 6] = -e.x[k.GRAV]
    t = np.arange(2.0, seconds - 0.05, 2.0)
    z = np.full((len(t), 12), np.nan)
    scatter = rng.normal(0, sigma, (len(t), 3))
    z[:, 0] = 0.87 + scatter[:, 0] / e.x[k.RN]
    z[:, 1] = 0.52 + scatter[:, 1] / (e.x[k.RE] * e.x[k.CLAT])
    z[:, 2] = 100.0 - scatter[:, 2]
    z[:, 3:6] = sigma
    if start is not None:
        start(e)
    e.kept = room(e.layout.n, rows=n + 1, events=len(t), inner=4, nodes=nodes, stds=nodes)
    first = e.x.copy(), e.P.copy()
    e.run(rows, np.zeros(n, dtype=bool), Events(t, np.full(len(t), m.POSITION, dtype=np.int64), z), 0.0)
    return e, first, t, z


def smoothed(e):
    nn = int(e.kept.counts[4])
    nodes = tuple(a[:nn].copy() for a in e.kept.nodes)
    before = tuple(a.copy() for a in nodes)
    dpre, dpost = np.zeros((nn, e.layout.n)), np.zeros((nn, e.layout.n))
    smooth(0, nn, e.layout.ie, nodes, dpre, dpost)
    return before, nodes, e.kept.node_time[:nn]


def full(S):
    """The transition (n, n) of a node's rows."""
    n = S.shape[1]
    Phi = np.zeros((n, n))
    Phi[:9] = S[:9]
    Phi[np.arange(9, n), np.arange(9, n)] = S[9, 9:]
    return Phi


def test_against_least_squares_over_all_times_at_once():
    """Prior, steps and fixes as one dense linear problem about the nominal track: the same estimates and sigmas."""
    e, (x0, P0), t, z = run(replace(QUIET, open_loop=True))
    (nx, nP, _, uP, nS, _, _), after, times = smoothed(e)
    nn, n = len(times), e.layout.n
    fixed = e.layout.std[9:] > 0
    assert fixed.all()
    # open loop: the nominal track is free of the fixes, and the errors about it are a linear Gaussian problem
    scale = np.concatenate([np.sqrt(np.diag(P0))] * nn)
    A, b = [], []

    def add(rows, right, cov):
        W = np.linalg.inv(np.linalg.cholesky(cov))
        A.append(W @ rows * scale)
        b.append(W @ right)

    for i in range(nn):
        here = slice(i * n, (i + 1) * n)
        Phi = full(nS[i])
        previous = P0 if i == 0 else uP[i - 1]
        Q = nP[i] - Phi @ previous @ Phi.T
        rows = np.zeros((n, nn * n))
        rows[:, here] = np.eye(n)
        if i == 0:
            add(rows, np.zeros(n), nP[0])
        else:
            rows[:, (i - 1) * n : i * n] = -Phi
            sd = np.sqrt(np.diag(nP[i]))
            Q = 0.5 * (Q + Q.T)
            floor = 1e-12 * np.diag(sd**2)  # the step's noise has no third rank in position
            add(rows, np.zeros(n), Q + floor)
        for j in np.flatnonzero(np.abs(t - times[i]) < 1e-9):
            H, r = np.zeros((3, n)), np.zeros(3)
            look = np.empty(m.LOOK)
            x = np.zeros(k.NX)
            x[: k.KEPT] = nx[i]
            m.look_back(x, e.ring, 0.0, look)
            m.position(x, e.layout.ie, e.c, look, z[j], 3, H, r)
            rows = np.zeros((3, nn * n))
            rows[:, here] = H
            add(rows, r, np.diag(z[j, 3:6] ** 2))
    M = np.vstack(A)
    solution = np.linalg.lstsq(M, np.concatenate(b), rcond=None)[0] * scale
    information = np.linalg.inv(M.T @ M) * np.outer(scale, scale)
    d = np.zeros(n)
    for i in range(nn):
        nominal, track = np.zeros(k.NX), np.zeros(k.NX)
        nominal[: k.KEPT], track[: k.KEPT] = nx[i], after[2][i]
        k.difference(nominal, track, e.layout.ie, d)
        here = slice(i * n, (i + 1) * n)
        sd = np.sqrt(np.diag(information[here, here]))
        np.testing.assert_allclose(d / sd, solution[here] / sd, atol=2e-3)
        np.testing.assert_allclose(np.sqrt(np.diag(after[3][i])), sd, rtol=2e-3)


def test_against_a_readable_twin():
    """Closed loop, total states: the same recursion in three lines of numpy."""
    e, *_ = run()
    (nx, nP, ux, uP, nS, _, _), after, times = smoothed(e)
    nn, n, ie = len(times), e.layout.n, e.layout.ie
    x, P = ux[-1].copy(), uP[-1].copy()
    d = np.zeros(n)
    assert nn > 20

    def long(a):
        y = np.zeros(k.NX)
        y[: k.KEPT] = a
        return y

    for i in range(nn - 2, -1, -1):
        G = np.linalg.solve(nP[i + 1], full(nS[i + 1]) @ uP[i]).T
        k.difference(long(nx[i + 1]), long(x), ie, d)
        y = long(ux[i])
        k.correct(y, ie, G @ d)
        x, P = y[: k.KEPT].copy(), uP[i] + G @ (P - nP[i + 1]) @ G.T
        sd = np.sqrt(np.diag(P))
        np.testing.assert_allclose(after[3][i] / np.outer(sd, sd), P / np.outer(sd, sd), atol=1e-6)
        k.difference(long(after[2][i]), long(x), ie, d)
        assert np.abs(d / sd).max() < 1e-5


def test_the_last_node_is_the_filters_and_no_sigma_grows():
    e, *_ = run()
    (_, _, ux, uP, *_), after, _ = smoothed(e)
    np.testing.assert_allclose(after[2][-1], ux[-1], rtol=1e-14, atol=1e-15)
    np.testing.assert_array_equal(after[3][-1], uP[-1])
    for P, S in zip(uP, after[3], strict=True):
        sd = np.sqrt(np.diag(P))
        assert np.linalg.eigvalsh((P - S) / np.outer(sd, sd)).min() > -1e-9
        np.testing.assert_allclose(S / np.outer(sd, sd), S.T / np.outer(sd, sd), rtol=0, atol=1e-12)
        assert np.linalg.eigvalsh(S / np.outer(sd, sd)).min() > -1e-9
    assert np.sqrt(after[3][5, 6, 6]) < 0.9 * np.sqrt(uP[5, 6, 6])


def test_open_loop_comes_to_the_same_smoothed_track():
    ends = [smoothed(run(replace(QUIET, open_loop=o))[0])[1] for o in (False, True)]
    for a, b, P in zip(ends[0][2], ends[1][2], ends[0][3], strict=True):
        assert abs(a[k.LAT] - b[k.LAT]) * 6.37e6 < 2e-3 * np.sqrt(P[6, 6])
        assert np.abs(a[k.VEL : k.VEL + 3] - b[k.VEL : k.VEL + 3]).max() < 2e-3 * np.sqrt(P[3, 3])
    for P, Q in zip(ends[0][3], ends[1][3], strict=True):
        sd = np.sqrt(np.diag(P))
        np.testing.assert_allclose(P / np.outer(sd, sd), Q / np.outer(sd, sd), rtol=0, atol=2e-3)


def test_states_without_variance_stay_and_spoil_nothing():
    """A known start (no variance of position, velocity, attitude) and a state whose variance is zero throughout."""
    s = replace(QUIET, estimate=(*NAMES, "user"), user_std=(1.0, 0.0, 0.0, 0.0))
    e, *_ = run(s, cov=np.zeros((9, 9)))
    _, after, _ = smoothed(e)
    i = int(e.layout.ie[k.USER])
    for x, P in zip(after[2], after[3], strict=True):
        assert np.isfinite(x).all() and np.isfinite(P).all() and np.diag(P).min() >= 0.0
        assert np.all(P[i + 1 :, :] == 0.0)
    assert after[3][0][6, 6] < 1e-3


def test_the_gain_passes_over_a_state_that_others_determine():
    """Two identical states: G is that of one of them, and nothing blows up."""
    rng = np.random.default_rng(2)
    A = rng.normal(size=(3, 3))
    P3 = A @ A.T + 0.1 * np.eye(3)
    T = np.vstack([np.eye(3), [1.0, 0.0, 0.0]])
    P, X = T @ P3 @ T.T, rng.normal(size=(4, 4))
    X = P @ X  # rows in the range of P, as covariances with it are
    G, L, Y, scale, active = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(4), np.zeros(4, np.int64)
    gain(X, P, G, L, Y, scale, active)
    np.testing.assert_allclose(G @ P, X.T, atol=1e-9)
    assert np.abs(G).max() < 1e3


def test_the_interval_between_nodes_does_not_matter():
    path, tables = recording(duration=30.0)
    fine = navigate(tables, settings_of(path, node_interval=0.2))
    coarse = navigate(tables, settings_of(path, node_interval=1.0))
    assert len(fine.states["gyro_bias_x"].time) > 3 * len(coarse.states["gyro_bias_x"].time)
    a, b = fine.smoother, coarse.smoother
    sd = np.sqrt(a.cov_pos[:, 0, 0])
    inside = slice(0, -11)  # after the last node there is nothing to smooth
    np.testing.assert_allclose(np.sqrt(b.cov_pos[inside, 0, 0]), sd[inside], rtol=0.02)
    assert np.abs((a.lat - b.lat) * 6.37e6 / sd).max() < 0.2
    turn = np.abs(np.angle(np.exp(1j * (a.rpy - b.rpy)))) / np.sqrt(np.einsum("nii->ni", a.cov_rpy))
    assert turn.max() < 0.1
    # the filter knows no nodes
    np.testing.assert_allclose(fine.filter.lat, coarse.filter.lat, rtol=0, atol=1e-13)


def test_smoother_and_filter_meet_at_the_end_and_the_smoother_is_better_on_the_way():
    miss = []
    for seed in range(4):
        path, tables = recording(duration=60.0, seed=seed)
        run_ = navigate(tables, settings_of(path))
        F, S = run_.filter, run_.smoother
        assert F.lat[-1] == pytest.approx(S.lat[-1], abs=1e-9) and len(F) == len(S)
        truth = path.at(F.time)
        miss.append([np.mean((x.v_n - truth.v_n) ** 2) + np.mean((x.rpy - truth.rpy) ** 2) for x in (F, S)])
        assert np.all(S.cov_pos[300, [0, 1, 2], [0, 1, 2]] < 0.8 * F.cov_pos[300, [0, 1, 2], [0, 1, 2]])
    F_all, S_all = np.sqrt(np.mean(miss, axis=0))
    assert S_all < 0.8 * F_all


def test_memory_of_a_node_is_what_the_formula_says():
    for n in (9, 15, 24, 40):
        one, many = room(n, nodes=100, stds=100), room(n, nodes=300, stds=300)
        size = [sum(a.nbytes for a in (*r.nodes, r.node_time, r.node_std)) for r in (one, many)]
        kept = (size[1] - size[0]) // 200
        told, corrections, sigmas = 8 * k.KEPT, 2 * 8 * n, 8 * n  # what `navigate` adds to hand the states out
        assert node_bytes(n) == kept + told + corrections + sigmas


def test_too_long_a_recording_takes_wider_nodes_or_says_that_it_does_not_smooth(monkeypatch):
    path, tables = recording(duration=20.0)
    full_ = navigate(tables, settings_of(path))
    n = 9 + 7
    monkeypatch.setattr("schuler.aiding.aided.SMOOTHER_BYTES", 150 * node_bytes(n))
    wide = navigate(tables, settings_of(path))
    assert wide.smoother is not None and not any("no smoother" in note for note in wide.notes)
    assert len(wide.states["gyro_bias_x"].time) < len(full_.states["gyro_bias_x"].time)
    monkeypatch.setattr("schuler.aiding.aided.SMOOTHER_BYTES", 10 * node_bytes(n))
    none = navigate(tables, settings_of(path))
    assert none.smoother is None and any("no smoother" in note for note in none.notes)
    np.testing.assert_allclose(none.filter.lat, full_.filter.lat, rtol=0, atol=1e-13)
