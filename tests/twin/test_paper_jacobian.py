"""The hand-written A of the paper's filter against derivatives of f; the compiled equations against readable ones."""

import numpy as np
import pytest

from schuler.aiding import paper
from schuler.kernels import paper as kernel

rng = np.random.default_rng(20170715)
STATES = np.column_stack(
    [
        rng.uniform(-1.4, 1.4, 40),
        rng.uniform(-1.2, 1.2, 40),
        rng.uniform(-3.1, 3.1, 40),
        rng.uniform(-0.01, 0.01, (40, 3)),
    ]
)
INPUTS = rng.uniform(-0.3, 0.3, (40, 3))


def f_complex(x, u):
    """(15) for complex x: the imaginary part of f(x + i h) / h is the derivative, with no difference taken."""
    roll, pitch, _, *bias = x
    p_x, p_y, p_z = u - np.array(bias)
    g = p_y * np.sin(roll) + p_z * np.cos(roll)
    zero = 0.0 * roll
    return np.array(
        [p_x + g * np.tan(pitch), p_y * np.cos(roll) - p_z * np.sin(roll), g / np.cos(pitch), zero, zero, zero]
    )


@pytest.mark.parametrize("i", range(0, 40, 4))
def test_jacobian_equals_the_complex_step_derivative(i):
    x, u = STATES[i], INPUTS[i]
    A = np.empty((6, 6))
    for k in range(6):
        step = x.astype(complex)
        step[k] += 1e-200j
        A[:, k] = f_complex(step, u).imag / 1e-200
    np.testing.assert_allclose(paper.jacobian(x, u), A, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(paper.state_rates(x, u), f_complex(x, u), rtol=1e-14)


def test_jacobian_equals_central_differences_to_2e_12():
    x = np.radians([5.0, -8.0, 60.0, 0.2, -0.1, -0.053])
    u = np.array([0.02, -0.01, 0.03])
    h = 1e-3
    A = np.empty((6, 6))
    for k in range(6):
        e = np.eye(6)[k] * h
        f = [paper.state_rates(x + m * e, u) for m in (-2, -1, 1, 2)]
        A[:, k] = (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * h)
    assert np.max(np.abs(paper.jacobian(x, u) - A)) < 2e-12


def test_compiled_linearisation_equals_the_readable_one():
    for x, u in zip(STATES, INPUTS, strict=True):
        A = np.zeros((3, 6))
        rates = kernel.linearise(x, u, A)
        np.testing.assert_allclose(rates, paper.state_rates(x, u)[:3], rtol=1e-13, atol=1e-16)
        np.testing.assert_allclose(A, paper.jacobian(x, u)[:3], rtol=1e-13, atol=1e-16)


@pytest.mark.parametrize("literal", [False, True])
def test_compiled_prediction_equals_phi_p_phi_transposed(literal):
    for x, u in zip(STATES[:10], INPUTS[:10], strict=True):
        root = rng.normal(size=(6, 6))
        P = root @ root.T
        q_angle, q_bias, dt = 0.03, 0.002, 0.01
        Q = np.diag([q_angle**2 * dt] * 3 + [q_bias**2 * dt] * 3)
        expected_x, expected_P = paper.predict(x, P, u, dt, Q, literal)
        got_x, got_P = x.copy(), P.copy()
        kernel.predict(got_x, got_P, u, dt, q_angle, q_bias, literal, np.zeros((3, 6)), np.zeros((6, 6)))
        np.testing.assert_allclose(got_x, expected_x, rtol=1e-14)
        np.testing.assert_allclose(got_P, expected_P, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(got_P, got_P.T)


@pytest.mark.parametrize(
    ("frozen", "considered", "rows"),
    [((), (), (0, 1, 2)), ((5,), (), (0, 1, 2)), ((), (), (0, 1)), ((), (2, 5), (0, 1))],
)
def test_rows_one_by_one_equal_the_matrix_form(frozen, considered, rows):
    """Also with B_z frozen after the gain, and with a Schmidt update."""
    for x in STATES[:10]:
        root = rng.normal(size=(6, 6)) * 0.1
        P = root @ root.T + 1e-3 * np.eye(6)
        y = rng.normal(size=3) * 0.1
        R = np.diag([0.12, 0.12, 0.003])
        H = np.eye(3, 6)[list(rows)]
        expected_x, expected_P = paper.update(
            x, P, y[list(rows)], H, R[np.ix_(rows, rows)], frozen=frozen, considered=considered
        )  # fmt: skip
        got_x, got_P = x.copy(), P.copy()
        for row in rows:
            innovation = x[row] + y[row] - got_x[row]
            switches = (bool(frozen), bool(considered), False)
            kernel.update_row(got_x, got_P, row, innovation, R[row, row], *switches, np.zeros(6), np.zeros(6))
        np.testing.assert_allclose(got_x, expected_x, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(got_P, expected_P, rtol=1e-11, atol=1e-15)
