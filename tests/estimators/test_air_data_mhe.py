"""The paper's estimator against the oracle's problems, its twin, and its own arrival rule."""

import numpy as np
import pytest

from estimators.air_data_mhe import AirDataMHE, AirDataTuning
from estimators.baselines import numpy_twins_air as twin
from estimators.mhe import SOLVED

from .air_oracle import CASES, load


@pytest.mark.parametrize("case", CASES)
def test_one_real_time_iteration(oracle, case):
    """To 1e-8 of an independent implementation; its exact Jacobians came from differences."""
    problem = load(oracle, case)
    estimator = problem.estimator()
    status, _ = estimator.solve()
    assert status == SOLVED
    np.testing.assert_allclose(estimator.x, problem.x_rti, atol=1e-8, rtol=0)
    np.testing.assert_allclose(estimator.u, problem.u_rti, atol=1e-8, rtol=0)


@pytest.mark.parametrize("case", CASES)
def test_converged_solution(oracle, case):
    """To 1e-6 of an interior-point solver run to 1e-13."""
    problem = load(oracle, case)
    estimator = problem.estimator(converged=True, sqp_iterations=60)
    status, _ = estimator.solve()
    assert status == SOLVED
    np.testing.assert_allclose(estimator.x, problem.x_opt, atol=1e-6, rtol=0)


@pytest.mark.parametrize("case", ["c00", "c04", "c12", "c16", "c36", "c37"])
def test_equals_the_numpy_twin(oracle, case):
    p = load(oracle, case)
    estimator = p.estimator()
    estimator.solve()
    x, u = twin.mhe_step(
        int(p.model),
        float(p.ts),
        p.tuning,
        1.0,
        2,
        2,
        p.xprior,
        p.xlin,
        p.ulin,
        p.ym,
        p.mask,
        p.theta,
    )
    np.testing.assert_allclose(estimator.x, x, atol=1e-9, rtol=0)
    np.testing.assert_allclose(estimator.u, u, atol=1e-9, rtol=0)


THETA = np.array([110.0, 0.06, 0.0, 0.0, -9.80665, 1500.0])


def _level(tuning, seconds, cas_error=0.0, seed=1):
    """Level flight in still air with noise: the estimator and its history."""
    rng = np.random.default_rng(seed)
    x0 = np.array([0.06, 110.0, 0.0, 0.0])
    theta = THETA.copy()
    theta[3], theta[4] = 9.80665 * np.sin(0.06), -9.80665 * np.cos(0.06)
    y0 = twin.outputs(0, x0, theta)
    estimator = AirDataMHE(tuning, x0, theta)
    history = []
    for _ in range(int(seconds / tuning.t_s)):
        y = y0 + rng.normal(size=4) * tuning.R_std
        y[3] += cas_error
        history.append(estimator.step(y, np.ones(4), theta))
        assert estimator.status == SOLVED
    return estimator, np.array(history)


def test_the_horizon_shifts_and_keeps_its_smoothed_start_as_prior():
    estimator, _ = _level(AirDataTuning(N=4), 2.0)
    smoothed = estimator.x[1].copy()
    y_before = estimator.y.copy()
    estimator.step(y_before[-1] + 0.1, np.ones(4), THETA)
    np.testing.assert_array_equal(estimator.x_prior, smoothed)
    np.testing.assert_array_equal(estimator.y[:-1], y_before[1:])


def test_estimates_settle_on_the_truth():
    _, history = _level(AirDataTuning(), 20.0)
    late = history[200:]
    assert np.degrees(np.abs(late[:, 0] - 0.06).max()) < 0.6
    np.testing.assert_allclose(late.mean(axis=0)[2:], 0.0, atol=0.3)


def test_a_fault_beyond_the_wind_bound_cannot_be_absorbed():
    """All CAS 90 m/s low asks for 95 m/s of wind: the bounded estimate stops at 61.7 m/s."""
    bounded, _ = _level(AirDataTuning(), 40.0, cas_error=-90.0)
    free, _ = _level(AirDataTuning(constrained=False), 40.0, cas_error=-90.0)
    assert bounded.x[-1, 2] < 120 * 0.514444
    assert bounded.x[-1, 2] > 55.0
    assert free.x[-1, 2] > 85.0


def test_a_tightened_band_does_not_freeze_the_estimate():
    estimator, _ = _level(AirDataTuning(), 5.0)
    estimator.confine[:] = [[5.0, 0.0], [1.0, 10.0]]  # the present wind, about 0, is outside
    for k in range(40):
        y = twin.outputs(0, np.array([0.06, 110.0, 5.0, 0.0]), THETA)
        y[0] += 0.01 * k
        estimator.step(y, np.ones(4), THETA)
        assert estimator.status == SOLVED
    assert 4.0 < estimator.x[-1, 2] < 6.0
    assert estimator.x[-1, 1] > 110.1


def test_unused_measurements_have_no_influence():
    estimator, _ = _level(AirDataTuning(), 2.0)
    window = estimator.window.copy()
    use = np.array([1.0, 1.0, 1.0, 0.0])
    y = twin.outputs(0, np.array([0.06, 110.0, 0.0, 0.0]), THETA)
    one = estimator.step(y, use, THETA)
    estimator.window[:] = window
    y[3] = 33.0
    np.testing.assert_array_equal(one, estimator.step(y, use, THETA))


def test_a_run_over_rows_equals_its_steps():
    rng = np.random.default_rng(4)
    y = twin.outputs(0, np.array([0.06, 110.0, 0.0, 0.0]), THETA)
    samples = np.tile(np.concatenate([y, np.ones(4), THETA]), (30, 1))
    samples[:, :4] += 0.05 * rng.normal(size=(30, 4))
    whole, _ = _level(AirDataTuning(), 2.0)
    single, _ = _level(AirDataTuning(), 2.0)
    states = whole.run(samples)
    steps = [single.step(s[:4], s[4:8], s[8:]) for s in samples]
    np.testing.assert_array_equal(states, steps)
    assert whole.status == SOLVED


def test_a_non_finite_sample_leaves_the_prediction():
    estimator, _ = _level(AirDataTuning(), 2.0)
    before = estimator.x[-1].copy()
    after = estimator.step(np.array([np.nan, 0.0, 0.06, 100.0]), np.ones(4), THETA)
    assert estimator.status != SOLVED
    assert np.abs(after - before).max() < 1.0
