"""Sensitivity of the residual: the printed formulas, solutions that really move, active bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.air_data_mhe import AirDataMHE, AirDataTuning
from estimators.baselines.numpy_twins_air import outputs, transition
from estimators.fault_sensitivity import ActiveBounds, active_bounds, linear_window

from .longitudinal_truth import KT, fly

CAS = 3


def _estimator(samples=60, fault_kt_s=0.0, until_active=False, **tuning):
    """The converged estimator somewhere in a flight, and the parameters of the next sample."""
    flight = fly(20.0, 3, speed=150.0, gust_std=0.3, shear=1.0)
    since = np.maximum(flight.t - 1.0, 0.0)
    readings = np.column_stack(
        [
            flight.inertial,
            flight.vanes.mean(axis=1),
            flight.pitots.mean(axis=1) + fault_kt_s * KT * since,
        ]
    )
    chosen = AirDataTuning(converged=True, sqp_iterations=30, **tuning)
    estimator = AirDataMHE(chosen, flight.x0, flight.theta[0])
    for k in range(len(readings) - 1):
        estimator.step(readings[k], np.ones(4), flight.theta[k])
        if k >= samples and (not until_active or active_bounds(estimator).count):
            return estimator, flight.theta[k + 1]
    raise AssertionError("no bound became active")


def _predicted(estimator, theta_next):
    t = estimator.tuning
    x = transition(t.model, estimator.x[-1], np.zeros(4), estimator.theta[-1], t.t_s)
    return outputs(t.model, np.asarray(x, dtype=float), theta_next)


@pytest.mark.parametrize("bound", [False, True])
def test_it_is_the_papers_formula(bound):
    """(31) with V^-1 for V, (33), (36), (40), by plain inverses."""
    estimator, theta = _estimator(N=4)
    w = linear_window(estimator, theta)
    V_inv = np.diag(1.0 / w.V)
    H_inv = np.linalg.inv(w.J_1.T @ V_inv @ w.J_1)
    active = None
    J = w.J_2
    if bound:
        x = np.zeros((4, 4), dtype=bool)
        x[2:, 2] = True
        active = ActiveBounds(x, np.zeros((3, 4), dtype=bool))
        J = np.vstack([J, np.eye(w.J_1.shape[1])[[8 * 2 + 2, 8 * 3 + 2]]])
    X = H_inv - H_inv @ J.T @ np.linalg.inv(J @ H_inv @ J.T) @ J @ H_inv
    np.testing.assert_allclose(w.X(active), X, atol=1e-9 * np.abs(X).max())
    K = w.G @ X @ w.J_1.T @ V_inv
    np.testing.assert_allclose(w.S(active), np.hstack([-K, np.eye(4)]), atol=1e-6)


def test_the_solution_moves_as_the_gain_says():
    """Each reading of the airspeed moved a little and the window solved again."""
    estimator, theta = _estimator(N=3)
    w = linear_window(estimator, theta)
    K = w.K()
    before = _predicted(estimator, theta)
    for i, column in enumerate(w.columns(CAS)):
        other = AirDataMHE(estimator.tuning, estimator.x[0], estimator.theta[0])
        other.window[:] = estimator.window
        other.y[i, CAS] += 0.02
        other.solve()
        moved = (_predicted(other, theta) - before) / 0.02
        np.testing.assert_allclose(moved, K[:, column], atol=2e-5)


def test_a_measurement_that_is_not_used_has_no_gain():
    estimator, theta = _estimator(N=3)
    estimator.use[:, CAS] = 0.0
    w = linear_window(estimator, theta)
    assert np.abs(w.K()[:, w.columns(CAS)]).max() == 0.0
    assert w.lasting_gain(CAS) == 1.0


@settings(max_examples=40, deadline=None)
@given(
    x=st.lists(st.booleans(), min_size=8, max_size=8),
    u=st.lists(st.booleans(), min_size=6, max_size=6),
    q_w=st.floats(0.03, 3.0),
)
def test_bounds_always_lower_the_weighted_sensitivity(x, u, q_w):
    """X_a <= X: in the metric of V the theorem is reversed for any set of wind bounds."""
    q = float(np.sqrt(q_w))
    estimator, theta = _estimator(20, N=4, Q_std=(0.017, 0.5, q, q))
    w = linear_window(estimator, theta)
    on_x, on_u = np.zeros((4, 4), dtype=bool), np.zeros((3, 4), dtype=bool)
    on_x[:, 2:] = np.reshape(x, (4, 2))
    on_u[:, 2:] = np.reshape(u, (3, 2)) & ~on_x[:-1, 2:] & ~on_x[1:, 2:]
    active = ActiveBounds(on_x, on_u)
    weight = np.sqrt(np.concatenate([w.V, np.ones(4)]))
    S_a, S = w.S(active) * weight, w.S() * weight
    assert np.linalg.eigvalsh(S_a @ S_a.T - S @ S.T)[-1] < 1e-6 * np.linalg.norm(S @ S.T)


def test_a_lasting_fault_shows_whole_at_the_bound_and_is_absorbed_without():
    estimator, theta = _estimator(30, fault_kt_s=-15.0, until_active=True, wind_bound_m_s=(20, 20))
    active = active_bounds(estimator)
    assert active.x[:, 2].any()
    w = linear_window(estimator, theta)
    S_a, S = w.S(active), w.S()
    assert np.linalg.eigvalsh(S_a @ S_a.T - S @ S.T)[0] < -0.1, "Theorem 1 as stated"
    assert w.lasting_gain(CAS, active) == pytest.approx(1.0, abs=1e-3)
    assert w.lasting_gain(CAS) < 0.95
    assert w.lasting_gain_after(CAS, 20, active) == pytest.approx(1.0, abs=1e-3)
    assert w.lasting_gain_after(CAS, 20) < 0.3


def test_the_newest_bounds_come_first():
    x, u = np.zeros((3, 4), dtype=bool), np.zeros((2, 4), dtype=bool)
    x[1:, 2] = u[0, 3] = True
    both = ActiveBounds(x, u)
    assert both.count == 3
    assert both.first(1).x[2, 2]
    assert both.first(1).count == 1
    assert not both.first(2).u.any()
    assert both.first(3).u[0, 3]
