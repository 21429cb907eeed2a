"""Kernels of one inertial filter against their numpy twins and against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from estimators.baselines import numpy_twins_ins as twin
from estimators.ins_bank_model import (
    ACC_B,
    ACC_G,
    ACC_QPHI,
    ACC_QV,
    ACC_S,
    ACC_T,
    COLUMNS,
    F_ACC,
    N_ACC,
    N,
    apply_transition,
    close_interval,
    inject,
    integrate,
    scalar_update,
)

Array = NDArray[np.float64]

LAT, GRAVITY = 0.9, 9.81
DECAY = np.array([0.9, 0.8, 0.95, 0.99])


def inputs(rng: np.random.Generator, n: int) -> Array:
    """A turning, shaking flight: specific force about -g, rates of half a radian a second."""
    return np.array([1.0, 0.0, -9.8, 0.2, -0.1, 0.3]) + 0.4 * rng.standard_normal((n, 6))


def start(rng: np.random.Generator) -> tuple[Array, Array]:
    x = np.zeros(N)
    x[:3] = [60.0, -20.0, 3.0]
    x[3] = 500.0
    x[F_ACC : F_ACC + 6] = 0.05 * rng.standard_normal(6)
    return x, np.ascontiguousarray(twin.rotation(np.array([0.3, -0.2, 1.1])))


def carried(x: Array, R: Array, u: Array, dt: float) -> tuple[Array, Array, Array]:
    """State and accumulator after a few steps."""
    x, R, acc = x.copy(), R.copy(), np.zeros(N_ACC)
    for row in u:
        integrate(x, R, acc, row, np.full(6, 1e-4), LAT, GRAVITY, dt)
    return x, R, acc


def transited(M: Array, acc: Array, decay: Array) -> Array:
    """The transition of columns of errors."""
    got = M.copy()
    apply_transition(got.reshape(-1), M.shape[1], 1, M.shape[1], acc, decay)
    return got


def test_mean_equals_the_twin() -> None:
    rng = np.random.default_rng(1)
    x, R = start(rng)
    u = inputs(rng, 20)
    v, h, attitude = x[:3].copy(), float(x[3]), R.copy()
    for row in u:
        f = x[F_ACC : F_ACC + 6]
        v, h, attitude, _ = twin.strapdown_step(v, h, attitude, row, f, LAT, GRAVITY, 0.02)
    got, got_R, _ = carried(x, R, u, 0.02)
    np.testing.assert_allclose(got[:3], v, rtol=0, atol=1e-11)
    assert got[3] == pytest.approx(h, abs=1e-11)
    np.testing.assert_allclose(got_R, attitude, rtol=0, atol=1e-12)


def test_transition_equals_the_twin_matrix() -> None:
    rng = np.random.default_rng(2)
    x, R = start(rng)
    _, _, acc = carried(x, R, inputs(rng, 10), 0.02)
    Phi = twin.transition(
        acc[ACC_T],
        acc[ACC_S : ACC_S + 3],
        acc[ACC_G : ACC_G + 9].reshape(3, 3),
        acc[ACC_B : ACC_B + 9].reshape(3, 3),
        DECAY,
    )
    M = rng.standard_normal((N, 5))
    got = transited(M, acc, DECAY)
    np.testing.assert_allclose(got, Phi @ M, rtol=0, atol=1e-12)
    rows = np.ascontiguousarray(M.T)
    apply_transition(rows.reshape(-1), 1, N, 3, acc, DECAY)
    np.testing.assert_array_equal(rows[:3], got.T[:3])
    np.testing.assert_array_equal(rows[3:], M.T[3:])


@pytest.mark.parametrize("part", range(4, 13))
def test_transition_is_the_derivative_of_the_mean(part: int) -> None:
    """A small attitude error or fault moves the mean as Phi says, to second order in 0.2 s."""
    rng = np.random.default_rng(3)
    x, R = start(rng)
    u = inputs(rng, 10)
    eps = 1e-6
    x_off, R_off = x.copy(), R.copy()
    if part < 7:
        r = np.zeros(3)
        r[part - 4] = eps
        R_off = np.ascontiguousarray(twin.rotation(r) @ R)
    else:
        x_off[part] += eps
    a, Ra, acc = carried(x, R, u, 0.02)
    b, Rb, _ = carried(x_off, R_off, u, 0.02)
    column = np.zeros((N, 1))
    column[part] = 1.0
    column = transited(column, acc, np.ones(4))
    D = Rb @ Ra.T
    angle = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    np.testing.assert_allclose((b[:3] - a[:3]) / eps, column[:3, 0], atol=2e-3)
    np.testing.assert_allclose((b[3] - a[3]) / eps, column[3, 0], atol=2e-2)
    np.testing.assert_allclose(angle / eps, column[4:7, 0], atol=2e-3)


def test_covariance_equals_the_twin_and_stays_symmetric() -> None:
    rng = np.random.default_rng(4)
    x, R = start(rng)
    x, R, acc = carried(x, R, inputs(rng, 10), 0.02)
    A = rng.standard_normal((N, N))
    P = A @ A.T + np.eye(N)
    F = rng.standard_normal((N, COLUMNS))
    std, tau = np.array([0.01, 0.01, 0.05, 3.0]), np.array([30.0, 30.0, 60.0, 40.0])
    qf = np.full(6, 1e-6)
    T = acc[ACC_T]
    decay = np.exp(-T / tau)
    Phi = twin.transition(
        T,
        acc[ACC_S : ACC_S + 3],
        acc[ACC_G : ACC_G + 9].reshape(3, 3),
        acc[ACC_B : ACC_B + 9].reshape(3, 3),
        decay,
    )
    Q = np.zeros(N)
    Q[:3] = acc[ACC_QV : ACC_QV + 3]
    Q[3] = 0.25 * T * T * acc[ACC_QV + 2]
    Q[4:7] = acc[ACC_QPHI : ACC_QPHI + 3]
    Q[7:13] = qf * T
    Q[13:] = std**2 * (1.0 - decay**2)
    expected, expected_F = Phi @ P @ Phi.T + np.diag(Q), F.copy()
    expected_F[:, :18] = Phi @ F[:, :18]
    close_interval(x, P, F, 18, acc, std, tau, qf)
    np.testing.assert_allclose(P, expected, rtol=1e-12, atol=1e-11)
    np.testing.assert_array_equal(P, P.T)
    np.testing.assert_allclose(F, expected_F, rtol=0, atol=1e-11)
    assert not acc.any()


def test_update_equals_the_joseph_form() -> None:
    rng = np.random.default_rng(5)
    A = rng.standard_normal((N, N))
    x, P = rng.standard_normal(N), A @ A.T + np.eye(N)
    F, L, Y = rng.standard_normal((N, COLUMNS)), np.zeros((3, 6, 6)), np.zeros((3, 6))
    unused = F[:, 12:].copy()
    steps = [np.ascontiguousarray(F[:, 6 * w : 6 * w + 6]) for w in range(2)]
    h = np.zeros(N)
    h[[0, 4, 13]] = [1.0, -2.0, 0.5]
    want = [twin.update(x, P, steps[w], L[w], Y[w], h, 0.7, 0.2) for w in range(2)]
    nis = scalar_update(x, P, F, L, Y, 2, h, 0.7, 0.2)
    for w in range(2):
        got = (x, P, F[:, 6 * w : 6 * w + 6], L[w], Y[w])
        for a, b in zip(got, want[w], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(P, P.T)
    np.testing.assert_array_equal(F[:, 12:], unused)
    assert not L[2].any()
    assert not Y[2].any()
    assert 0.0 < nis < 0.7**2 / 0.2


def test_attitude_correction_turns_the_matrix_about_earth_axes() -> None:
    rng = np.random.default_rng(6)
    x, R = start(rng)
    before = R.copy()
    x[4:7] = [0.02, -0.01, 0.03]
    inject(x, R)
    np.testing.assert_allclose(R, twin.rotation(np.array([0.02, -0.01, 0.03])) @ before, atol=1e-14)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert not x[4:7].any()
