"""The air data benchmark's contenders solve the same problem."""

import numpy as np
import pytest

from estimators.baselines import numpy_twins_air as twin
from estimators.mhe import SOLVED
from monitor.commands.bench_cases.air import cases, horizon_of, leaning_window, solver
from monitor.commands.bench_cases.air_casadi import CasadiHorizon, compiler

CASADI = pytest.importorskip("casadi")


def test_the_window_leans_on_its_bound():
    estimator = leaning_window(3)
    solver(estimator)()
    assert estimator.table[4, 2] - estimator.x[-1, 2] < 1.0


def test_step_equals_the_twin():
    estimator = leaning_window(3)
    h, t = horizon_of(estimator), estimator.tuning
    x, u = twin.mhe_step(
        t.model, t.t_s, h.tuning, t.kappa, 2, 2, h.x_prior, h.x, h.u, h.y, np.ones((3, 4)), h.theta
    )
    status, _ = solver(estimator)()
    assert status == SOLVED
    np.testing.assert_allclose(estimator.x, x, atol=1e-9)
    np.testing.assert_allclose(estimator.u, u, atol=1e-9)


def test_one_casadi_iteration_is_the_exact_solution_of_our_quadratic_programme():
    """Ours stops at kappa = 0.1, by design; with kappa run down it is the same point."""
    estimator = leaning_window(3)
    peer = CasadiHorizon(horizon_of(estimator))
    x_peer, _ = peer.solve(peer.sqp(1))
    estimator.solve()
    assert np.abs(estimator.x - x_peer).max() < 0.3
    exact = leaning_window(3)
    object.__setattr__(exact.tuning, "n_kappa", 9)
    object.__setattr__(exact.tuning, "n_qp", 6)
    exact.solve()
    np.testing.assert_allclose(exact.x, x_peer, atol=1e-4)


def test_converged_solutions_agree():
    estimator = leaning_window(10, converged=True)
    peer = CasadiHorizon(horizon_of(estimator))
    status, _ = estimator.solve()
    assert status == SOLVED
    x_ipopt, u_ipopt = peer.solve(peer.ipopt())
    np.testing.assert_allclose(estimator.x, x_ipopt, atol=2e-5)
    np.testing.assert_allclose(estimator.u, u_ipopt, atol=2e-4)
    x_sqp, _ = peer.solve(peer.sqp(30))
    np.testing.assert_allclose(estimator.x, x_sqp, atol=1e-6)


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_compiled_and_buffered_calls_give_the_interpreted_result():
    peer = CasadiHorizon(horizon_of(leaning_window(3)))
    function = peer.compiled(peer.sqp(1))
    x, u = peer.solve(peer.sqp(1))
    x_compiled, _ = peer.solve(function)
    np.testing.assert_allclose(x_compiled, x, atol=1e-9)
    w = peer.buffered(lambda: function)()
    np.testing.assert_allclose(w, np.concatenate([x.ravel(), u.ravel()]), atol=1e-9)


def test_names_are_those_of_the_design():
    assert [case.name for case in cases()] == [
        "mhe_step_n3", "mhe_stage_n100_over_n10", "mhe_converged_n10",
    ]  # fmt: skip
