"""The planar kernels against plain numpy with difference Jacobians, and the smoother against least squares of all."""

import sys
from pathlib import Path

import numpy as np
import pytest

from schuler.aiding.planar_settings import PlanarSettings, configuration
from schuler.kernels import planar as k
from schuler.kernels.planar_smooth import smooth

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import planar_reference as plain  # noqa: E402

BEACONS = 3
N = k.B0 + BEACONS


def state(rng):
    x = rng.standard_normal(N) * np.array([30, 30, 2, 3, 0.3, 0.01, 0.02, 0.05, 0.05, 1, 1, 0.3, 0.3, 0.3])
    root = rng.standard_normal((N, N)) * 0.1
    return x, root @ root.T + 0.01 * np.eye(N)


def settings(**more):
    return configuration(PlanarSettings(antenna=(0.7, -0.4, 0.0), range_bias_tau=80.0, soft=1e9, hard=1e12, **more))


@pytest.mark.parametrize("us,uw", [(2.5, 0.4), (np.nan, 0.4), (2.5, np.nan), (np.nan, np.nan), (-1.0, 0.0)])
def test_motion_and_its_transition(us, uw):
    rng = np.random.default_rng(1)
    c = settings()
    for dt in (0.01, 0.2, 2.0):
        x, P = state(rng)
        piece = np.array([dt, us, 0.003, 0.01, uw, 1e-5, 1e-4])
        y, Q, Phi = x.copy(), P.copy(), np.eye(N)
        k.advance(y, Q, Phi, np.zeros((k.MOVING, N)), c, *piece)
        moved = plain.moved(x, c, dt, us, uw)
        np.testing.assert_allclose(y, moved, atol=1e-12)
        F = plain.transition(x, c, dt, us, uw)
        np.testing.assert_allclose(Phi, F, atol=2e-8)
        np.testing.assert_allclose(Q, F @ P @ F.T + plain.noise(x, moved, P, c, piece), atol=1e-7)


def test_rows_of_measurements():
    rng = np.random.default_rng(2)
    c = settings()
    for _ in range(20):
        x, _ = state(rng)
        z = np.array([3.0, 4.0, 1.0, 2.0, 1.5, 0.8, 0.0])
        H = np.zeros((2, N))
        got = k.fix_rows(x, c, z, H[0], H[1])
        np.testing.assert_allclose(got, plain.expected(x, c, k.FIX, z), atol=1e-12)
        np.testing.assert_allclose(H, plain.rows(x, c, k.FIX, z), atol=1e-8)
        got = k.velocity_rows(x, H[0], H[1])
        np.testing.assert_allclose(got, plain.expected(x, c, k.VELOCITY, z), atol=1e-12)
        np.testing.assert_allclose(H, plain.rows(x, c, k.VELOCITY, z), atol=1e-8)
        z = np.array([40.0, 0.25, 2.0, 12.0, -7.0, 1.5, 0.0])
        np.testing.assert_allclose(k.range_row(x, z, H[0]), plain.expected(x, c, k.RANGE, z)[0], atol=1e-12)
        np.testing.assert_allclose(H[0], plain.rows(x, c, k.RANGE, z)[0], atol=1e-8)


def recording(rng, n=120):
    """Pieces with known and unknown inputs, and one measurement of a kind at every third end."""
    pieces = np.column_stack(
        [
            np.full(n, 0.2),
            np.where(rng.random(n) < 0.15, np.nan, 2.0 + 0.1 * rng.standard_normal(n)),
            np.full(n, 5e-4),
            np.full(n, 2.5e-3),
            np.where(rng.random(n) < 0.15, np.nan, 0.2 * rng.standard_normal(n)),
            np.full(n, 1e-6),
            np.full(n, 5e-6),
        ]
    )
    pt = np.cumsum(pieces[:, 0])
    at = np.arange(2, n, 3)
    kind = rng.integers(0, 4, len(at))
    mz = np.zeros((len(at), k.MZ))
    for i, what in enumerate(kind):
        if what == k.FIX:
            mz[i, :6] = [*rng.normal(0, 3, 2), 1.0, 1.2, 0.8, 0.9]
        elif what == k.RANGE:
            mz[i, :6] = [60.0 + rng.normal(), 0.3, i % BEACONS, 60.0, 5.0 * (i % BEACONS), 2.0]
        elif what == k.REST:
            mz[i, :2] = [0.002 * rng.standard_normal(), 1e-6]
        else:
            mz[i, :4] = [*rng.normal(0, 1, 2), 0.3, 0.4]
    m_to = np.searchsorted(pt[at], pt, side="right")
    return pt, pieces, m_to, kind.astype(np.int64), mz


def filtered(rng_seed=3):
    rng = np.random.default_rng(rng_seed)
    pt, pieces, m_to, kind, mz = recording(rng)
    c = settings()
    x = np.zeros(N)
    x[k.V] = 2.0
    P = np.diag([4.0, 4.0, 0.04, 1.0, 0.04, 1e-4, 1e-4, 1e-4, 1e-3, 1.0, 1.0, 0.09, 0.09, 0.09])
    y, Q, s = x.copy(), P.copy(), np.zeros(k.NS)
    count = len(pt)
    nodes = tuple(np.zeros(shape) for shape in ((count, N), (count, N, N), (count, N), (count, N, N), (count, N, N)))
    innov = np.zeros((len(kind), k.INNOVATION))
    none = np.zeros(0, np.int64)
    k.run(
        y, Q, c, s, pt, pieces, m_to, np.ones(count, np.bool_), kind, mz, innov, none, none, none, none,
        np.zeros((0, k.MOVING)), np.zeros((0, k.MOVING, k.MOVING)), nodes, np.zeros((count, N)), np.zeros((count, N)),
        np.zeros(3, np.int64),
    )  # fmt: skip
    return c, x, P, (pt, pieces, m_to, kind, mz), y, Q, innov, nodes


def test_a_run_is_that_of_plain_numpy():
    c, x, P, (pt, pieces, m_to, kind, mz), y, Q, innov, _ = filtered()
    x1, P1, nis = plain.run(x, P, c, pt, pieces, m_to, kind, mz)
    np.testing.assert_allclose(innov[:, 4], nis, rtol=1e-6)
    sigma = np.sqrt(np.diag(P1))
    np.testing.assert_allclose(y / sigma, x1 / sigma, atol=1e-6)
    np.testing.assert_allclose(Q / np.outer(sigma, sigma), P1 / np.outer(sigma, sigma), atol=1e-6)


def test_smoother_is_the_information_of_both_sides():
    """Where everything is linear the smoothed covariance is that of one least squares over the whole run."""
    rng = np.random.default_rng(5)
    n, count = 4, 7
    truth = [rng.standard_normal((n, n)) * 0.3 + np.eye(n) for _ in range(count)]
    Q, R = 0.1 * np.eye(n), 0.5
    nx, nP, ux, uP, nF = (np.zeros(s) for s in ((count, n), (count, n, n), (count, n), (count, n, n), (count, n, n)))
    x, P = np.zeros(n), np.eye(n)
    blocks, values = [np.hstack([np.eye(n), np.zeros((n, n * (count - 1)))])], [np.zeros(n)]
    for i in range(count):
        F = truth[i]
        if i:
            x, P = F @ x, F @ P @ F.T + Q
            row = np.zeros((n, n * count))
            row[:, n * i : n * i + n], row[:, n * (i - 1) : n * i] = np.eye(n), -F
            blocks.append(row / np.sqrt(0.1))
            values.append(np.zeros(n))
        nx[i], nP[i], nF[i] = x, P, F
        h, z = rng.standard_normal(n), rng.standard_normal()
        S = h @ P @ h + R
        K = P @ h / S
        x, P = x + K * (z - h @ x), P - np.outer(K, K) * S
        ux[i], uP[i] = x, P
        row = np.zeros((1, n * count))
        row[0, n * i : n * i + n] = h / np.sqrt(R)
        blocks.append(row)
        values.append(np.array([z / np.sqrt(R)]))
    A, b = np.vstack(blocks), np.concatenate(values)
    whole = np.linalg.inv(A.T @ A)
    best = (whole @ A.T @ b).reshape(count, n)
    smooth(nx, nP, ux, uP, nF)
    np.testing.assert_allclose(ux, best, atol=1e-9)
    for i in range(count):
        np.testing.assert_allclose(uP[i], whole[n * i : n * i + n, n * i : n * i + n], atol=1e-9)


def test_smoother_of_a_run_ends_at_the_filter_and_is_surer():
    *_, nodes = filtered()
    last = nodes[2][-1].copy()
    before = np.einsum("nii->ni", nodes[3]).copy()
    smooth(*nodes)
    np.testing.assert_array_equal(nodes[2][-1], last)
    assert (np.einsum("nii->ni", nodes[3]) <= before * (1 + 1e-9)).all()
