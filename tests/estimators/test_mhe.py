"""Algorithms 1 and 2: oracle problems, a dense solver, the twin, and active bounds."""

import numpy as np
import pytest

from estimators.baselines import numpy_twins_air as twin
from estimators.mhe import (
    BOUNDS_CROSSED,
    NON_FINITE,
    SOLVED,
    barrier_qp,
    kkt_step,
    work_size,
)
from estimators.mhe_converged import converged_qp
from estimators.mhe_four import kkt_step_four

from .air_oracle import CONSTRAINED, load

INF = np.inf


def _random_window(rng, N=6, n=5, p=3, m=2, bounded=False):
    A = np.eye(n) + 0.1 * rng.normal(size=(N - 1, n, n))
    B = rng.normal(size=(N - 1, n, p))
    C = rng.normal(size=(N, m, n))
    L = rng.normal(size=(n, n))
    xl, xu = np.full((N, n), -INF), np.full((N, n), INF)
    ul, uu = np.full((N - 1, p), -INF), np.full((N - 1, p), INF)
    if bounded:
        xl[:, 0], xu[:, 0], uu[:, 1] = -0.3, 0.2, 0.1
    return (
        L @ L.T + np.eye(n), rng.uniform(0.1, 1, p), rng.uniform(0.1, 1, m), A, B, C,
        rng.normal(size=(N - 1, n)), rng.normal(size=n), rng.normal(size=(N - 1, p)),
        rng.normal(size=(N, m)), xl, xu, ul, uu,
    )  # fmt: skip


def _work(window):
    N, n = window[10].shape
    p = window[1].size
    return np.zeros((N, n)), np.zeros((N - 1, p)), np.empty(work_size(N, n, p, window[2].size))


def _dense(window):
    """Gradient of the cost at zero and matrix of the cost after x has been eliminated by u, x_l."""
    P, Q, R, A, B, C, f, rx, ru, ry = window[:10]
    N, n, p = len(C), P.shape[0], Q.size
    M, q = np.zeros((N, n, n + (N - 1) * p)), np.zeros((N, n))
    M[0, :, :n] = np.eye(n)
    for i in range(N - 1):
        M[i + 1] = A[i] @ M[i]
        M[i + 1, :, n + i * p : n + (i + 1) * p] += B[i]
        q[i + 1] = A[i] @ q[i] + f[i]
    P_inv = np.linalg.inv(P)
    H = np.zeros((M.shape[2],) * 2)
    H[:n, :n] = P_inv
    H[n:, n:] = np.diag(np.tile(1 / Q, N - 1))
    g = np.concatenate([-P_inv @ rx, -(ru / Q).ravel()])
    for i in range(N):
        H += M[i].T @ C[i].T @ np.diag(1 / R) @ C[i] @ M[i]
        g -= M[i].T @ C[i].T @ ((ry[i] - C[i] @ q[i]) / R)
    z = np.linalg.solve(H, -g)
    return np.array([M[i] @ z + q[i] for i in range(N)]), z[n:].reshape(N - 1, p)


@pytest.mark.parametrize("case", CONSTRAINED)
def test_minimiser_of_the_barrier_problem(oracle, case):
    """kappa = 10: the check that catches a flipped gradient sign."""
    problem = load(oracle, case)
    window = problem.window()
    x, u, work = _work(window)
    assert barrier_qp(*window, 10.0, 1, 40, x, u, work) == SOLVED
    np.testing.assert_allclose(x, problem.dx_barrier10, atol=1e-9)
    np.testing.assert_allclose(u, problem.du_barrier10, atol=1e-9)


def test_one_step_solves_an_unconstrained_window():
    rng = np.random.default_rng(3)
    for shape in ((6, 5, 3, 2), (2, 1, 1, 1), (12, 4, 4, 4), (3, 9, 4, 7)):
        window = _random_window(rng, *shape)
        x, u, work = _work(window)
        assert barrier_qp(*window, 1.0, 1, 1, x, u, work) == SOLVED
        x_dense, u_dense = _dense(window)
        np.testing.assert_allclose(x, x_dense, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(u, u_dense, rtol=1e-8, atol=1e-9)


def test_row_by_row_equals_the_block_form_of_algorithm_2():
    rng = np.random.default_rng(5)
    for _ in range(5):
        window = _random_window(rng)
        x, u, work = _work(window)
        x[:], u[:] = rng.normal(size=x.shape), rng.normal(size=u.shape)
        gx, Dx = rng.normal(size=x.shape), rng.uniform(0, 50, x.shape)
        gu, Du = rng.normal(size=u.shape), rng.uniform(0, 50, u.shape)
        Dx[:, 2] = gx[:, 2] = 0.0
        dx, du = np.empty_like(x), np.empty_like(u)
        kkt_step(*window[:10], x, u, gx, Dx, gu, Du, dx, du, work)
        dx_twin, du_twin = twin.kkt_step(*window[:10], x, u, gx, Dx, gu, Du)
        np.testing.assert_allclose(dx, dx_twin, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(du, du_twin, rtol=1e-9, atol=1e-10)


def test_the_kernel_for_four_equals_the_general_one():
    rng = np.random.default_rng(6)
    for N in (2, 3, 9):
        window = _random_window(rng, N, 4, 4, 4)
        x, u, work = _work(window)
        x[:], u[:] = rng.normal(size=x.shape), rng.normal(size=u.shape)
        gx, Dx = rng.normal(size=x.shape), 10.0 ** rng.uniform(-3, 9, x.shape)
        gu, Du = rng.normal(size=u.shape), 10.0 ** rng.uniform(-3, 9, u.shape)
        Dx[:, 0] = gx[:, 0] = 0.0
        window[5][1, 2] = 0.0  # an unused measurement
        window[9][1, 2] = 0.0
        dx, du = np.empty_like(x), np.empty_like(u)
        dx_four, du_four = np.empty_like(x), np.empty_like(u)
        kkt_step(*window[:10], x, u, gx, Dx, gu, Du, dx, du, work)
        kkt_step_four(*window[:10], x, u, gx, Dx, gu, Du, dx_four, du_four, work)
        np.testing.assert_allclose(dx_four, dx, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(du_four, du, rtol=1e-9, atol=1e-10)


def test_converged_solution_meets_the_optimality_conditions():
    """Inside every bound, and no feasible direction lowers the cost."""
    rng = np.random.default_rng(11)
    window = _random_window(rng, bounded=True)
    xl, xu, ul, uu = window[10:]
    x, u, work = _work(window)
    assert converged_qp(*window, 1e-13, 60, x, u, work) == SOLVED
    P, Q, R, A, B, C, f, rx, ru, ry = window[:10]

    def cost(x, u):
        y = ry - np.einsum("imn,in->im", C, x)
        prior = rx - x[0]
        return 0.5 * (
            prior @ np.linalg.solve(P, prior) + (y**2 / R).sum() + ((ru - u) ** 2 / Q).sum()
        )

    def roll(x0, u):
        out = [x0]
        for i in range(len(u)):
            out.append(f[i] + A[i] @ out[-1] + B[i] @ u[i])
        return np.array(out)

    np.testing.assert_allclose(roll(x[0], u), x, atol=1e-9)
    assert (x[:, 0] < 0.2).all()
    assert (x[:, 0] > -0.3).all()
    assert np.isclose(x[:, 0], 0.2, atol=1e-6).any() or np.isclose(x[:, 0], -0.3, atol=1e-6).any()
    best = cost(x, u)
    tried = 0
    for _ in range(4000):
        u_try = np.minimum(u + 1e-3 * rng.normal(size=u.shape), uu)
        x_try = roll(x[0] + 1e-3 * rng.normal(size=x.shape[1]), u_try)
        if (x_try > xl).all() and (x_try < xu).all() and (u_try > ul).all():
            tried += 1
            assert cost(x_try, u_try) >= best - 1e-9
    assert tried > 20


def test_more_barrier_iterations_approach_the_converged_solution():
    window = _random_window(np.random.default_rng(11), bounded=True)
    x, u, work = _work(window)
    converged_qp(*window, 1e-13, 60, x, u, work)
    reference = x.copy()
    errors = []
    for n_kappa in (2, 4, 7):
        barrier_qp(*window, 1.0, n_kappa, 6, x, u, work)
        errors.append(np.abs(x - reference).max())
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < 1e-5


def test_a_step_that_would_land_on_a_bound_stays_strictly_inside():
    """One stage, prior exactly at the bound: with `<=` the next gradient divides by zero."""
    one = np.ones((1, 1))
    window = (
        one, np.ones(1), np.ones(1), np.zeros((0, 1, 1)), np.zeros((0, 1, 1)), np.zeros((1, 1, 1)),
        np.zeros((0, 1)), np.array([1.0]), np.zeros((0, 1)), np.zeros((1, 1)),
        -one, one, np.zeros((0, 1)), np.zeros((0, 1)),
    )  # fmt: skip
    x, u, work = _work(window)
    assert barrier_qp(*window, 1e-12, 1, 6, x, u, work) == SOLVED
    assert np.isfinite(x).all()
    assert 0.99 < x[0, 0] < 1.0


def test_a_start_outside_the_bounds_is_moved_inside_and_then_improves():
    window = list(_random_window(np.random.default_rng(2)))
    window[10][:, 0], window[11][:, 0] = 0.4, 0.6  # the linearisation point, zero, lies outside
    x, u, work = _work(window)
    assert barrier_qp(*window, 1.0, 4, 6, x, u, work) == SOLVED
    assert ((x[:, 0] > 0.4) & (x[:, 0] < 0.6)).all()
    reference = x.copy()
    assert converged_qp(*window, 1e-13, 60, x, u, work) == SOLVED
    assert np.abs(x - reference).max() < 0.2
    defect = [
        window[6][i] + window[3][i] @ x[i] + window[4][i] @ u[i] - x[i + 1] for i in range(len(u))
    ]
    np.testing.assert_allclose(defect, 0.0, atol=1e-8)


def test_bad_input_is_reported_and_changes_nothing():
    window = list(_random_window(np.random.default_rng(2)))
    x, u, work = _work(window)
    window[9][1, 0] = np.nan
    assert barrier_qp(*window, 1.0, 2, 2, x, u, work) == NON_FINITE
    assert converged_qp(*window, 1e-13, 60, x, u, work) == NON_FINITE
    assert not x.any()
    assert not u.any()
    window[10][:, 0], window[11][:, 0] = 1.0, -1.0
    assert barrier_qp(*window, 1.0, 2, 2, x, u, work) == BOUNDS_CROSSED
    assert converged_qp(*window, 1e-13, 60, x, u, work) == BOUNDS_CROSSED
