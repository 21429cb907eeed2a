"""The monotone programme and its moving window: oracle, optimality conditions, twins, priors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators import monotone_qp as qp
from estimators.baselines import numpy_twins_map as twin
from estimators.monotone_map import (
    CONTINUED,
    PRINTED,
    MapTuning,
    MonotoneMap,
    normal_rows,
    solve_window,
    window_work_size,
)


def solve(H, q, tolerance=qp.TOLERANCE):
    """(status, f, cost, multipliers) of a cold start."""
    N, p = q.shape
    step, slope = qp.start_sizes(H, q)
    s, z, f = np.full((N, p), step), np.full((N, p), slope), np.empty((N, p))
    work = np.empty(qp.work_size(N, p))
    status, _, cost = qp.solve_monotone(H, q, s, z, f, tolerance, qp.MAX_ITERATIONS, work)
    return status, f, cost, z


def residuals(rng, n, p=4, m=6, faults=None):
    """Rows (y, S) of noise and growing faults with signatures of very different sizes."""
    S = (
        rng.normal(size=(n, m, p))
        * np.logspace(0, -2, p)
        * (1.0 + 0.1 * rng.normal(size=(n, 1, 1)))
    )
    f = np.zeros((n, p)) if faults is None else faults
    return np.einsum("kmp,kp->km", S, f) + rng.normal(size=(n, m)), S


def problem(seed, N, p, definite=True):
    """A random window with faults that have grown."""
    rng = np.random.default_rng(seed)
    faults = np.maximum.accumulate(rng.exponential(0.3, (N, p)).cumsum(0) - 2.0, axis=0)
    y, S = residuals(rng, N, p, faults=np.maximum(faults, 0.0))
    H, q = twin.normal_rows(y, S, np.eye(6))
    return twin.window_terms(H, q, np.ones(p), float(definite) * np.eye(p), np.zeros(p), True)


class TestOracle:
    """Windows and a recursion solved by an independent implementation."""

    @pytest.fixture
    def data(self, oracle):
        with np.load(oracle / "mh_map.npz") as file:
            return dict(file)

    def test_windows_match_cost_and_levels(self, data):
        N, W = int(data["N"]), np.linalg.inv(data["Q"])
        for case, start in enumerate(data["starts"]):
            rows = slice(start, start + N)
            H, q = twin.normal_rows(data["y"][rows], data["S"][rows], W)
            s, z, f = np.empty((3, N, 4))
            status, _, cost = solve_window(
                PRINTED, H, q, 1.0 / data["lam"], data["Rinv_window"], 0.9 * data["f"][start],
                False, s, z, f, qp.TOLERANCE, np.empty(window_work_size(N, 4)),
            )  # fmt: skip
            assert status == qp.SOLVED
            assert cost == pytest.approx(data["cost"][case], rel=1e-8)
            assert np.abs(f - data["F"][case]).max() < 1e-6

    def test_recursion_matches(self, data):
        tuning = MapTuning(data["Q"], data["lam"], data["recursion_R"], int(data["N"]), PRINTED)
        rows = len(data["recursion_out"])
        run = MonotoneMap(tuning).run(data["y"][:rows], data["S"][:rows])
        assert (run.status == qp.SOLVED).all()
        assert np.abs(run.f - data["recursion_out"]).max() < 1e-6


class TestProgramme:
    @pytest.mark.parametrize(("N", "p"), [(1, 4), (2, 1), (7, 2), (30, 3), (30, 4), (12, 6)])
    def test_agrees_with_dense_twin(self, N, p):
        H, q = problem(N + p, N, p)
        status, f, cost, _ = solve(H, q, 1e-11)
        reference, best = twin.monotone_qp(H, q)
        assert status == qp.SOLVED
        assert cost == pytest.approx(best, rel=1e-9, abs=1e-9)
        np.testing.assert_allclose(f, reference, atol=1e-5)

    @given(st.integers(0, 2**31), st.integers(1, 60), st.sampled_from([1, 2, 4, 5]))
    @settings(max_examples=60, deadline=None)
    def test_optimality_conditions_hold(self, seed, N, p):
        H, q = problem(seed, N, p)
        status, f, _, z = solve(H, q)
        assert status == qp.SOLVED
        steps = np.diff(f, axis=0, prepend=0.0)
        gradient = np.einsum("kij,kj->ki", H, f) + q
        up = np.vstack([z[1:], np.zeros((1, p))])
        assert steps.min() >= -1e-12
        assert z.min() >= 0.0
        assert abs(np.sum(steps * z)) <= 1.1 * qp.TOLERANCE + 1e-12 * np.sum(f)
        assert np.abs(gradient - z + up).max() <= 2e-9 * max(1.0, np.abs(q).max())

    def test_four_levels_have_the_solution_of_the_general_loops(self):
        """Two levels more, uncoupled, leave the first four what they were."""
        H, q = problem(3, 40, 4)
        wide = np.tile(np.eye(5), (40, 1, 1))
        wide[:, :4, :4] = H
        _, f, _, _ = solve(H, q, 1e-12)
        _, g, _, _ = solve(wide, np.hstack([q, np.ones((40, 1))]), 1e-12)
        np.testing.assert_allclose(g[:, :4], f, atol=1e-6)
        np.testing.assert_allclose(g[:, 4], 0.0, atol=1e-9)

    def test_one_level_is_isotonic_regression(self):
        """Pool-adjacent-violators solves the case of one level with unit weights exactly."""
        y = np.array([1.0, 3.0, 2.0, 2.0, 5.0, 4.0, 4.5, 9.0])
        _, f, _, _ = solve(np.ones((8, 1, 1)), -y[:, None], 1e-13)
        expected = [1.0, *[7.0 / 3.0] * 3, *[4.5] * 3, 9.0]
        np.testing.assert_allclose(f[:, 0], expected, atol=1e-9)

    @given(st.integers(0, 2**31), st.floats(-4, 2), st.floats(-4, 2))
    @settings(max_examples=60, deadline=None)
    def test_any_start_ends(self, seed, small, large):
        """A badly scaled start may cost iterations, never the answer or an endless loop."""
        H, q = problem(seed, 20, 4)
        rng = np.random.default_rng(seed)
        s, z = 10.0 ** rng.uniform(min(small, large), max(small, large), (2, 20, 4))
        f, work = np.empty((20, 4)), np.empty(qp.work_size(20, 4))
        status, iterations, cost = qp.solve_monotone(H, q, s, z, f, qp.TOLERANCE, 200, work)
        assert status in (qp.SOLVED, qp.NOT_CONVERGED)
        assert iterations <= 200
        if status == qp.SOLVED:
            assert cost == pytest.approx(solve(H, q)[2], abs=1e-7)

    def test_status_words(self):
        H, q = problem(1, 10, 4)
        bad = q.copy()
        bad[4, 2] = np.nan
        assert solve(H, bad)[0] == qp.NON_FINITE
        assert solve(np.full_like(H, np.inf), q)[0] == qp.NON_FINITE
        beside = H.copy()
        beside[4, 2, 1] = np.nan
        assert solve(beside, q)[0] == qp.NON_FINITE
        s, z, f = np.ones((3, 10, 4))
        work = np.empty(qp.work_size(10, 4))
        assert qp.solve_monotone(H, q, s, z, f, 1e-10, 2, work)[0] == qp.NOT_CONVERGED
        assert np.diff(f, axis=0).min() > 0.0
        assert set(qp.STATUS_TEXT) == {
            qp.SOLVED, qp.NOT_CONVERGED, qp.SINGULAR, qp.NON_FINITE
        }  # fmt: skip

    def test_levels_that_fall_for_ever_are_singular(self):
        """No curvature and a cost that falls with the level: there is no optimum to be near."""
        H, q = np.zeros((10, 4, 4)), -np.ones((10, 4))
        assert solve(H, q)[0] == qp.SINGULAR


class TestWindow:
    def test_normal_rows_agree_with_twin(self):
        rng = np.random.default_rng(4)
        y, S = residuals(rng, 9)
        y[3, 1], S[5, 0, 2] = np.nan, np.inf
        W = np.cov(rng.normal(size=(6, 20)))
        H, q = np.empty((9, 4, 4)), np.empty((9, 4))
        assert normal_rows(y, S, W, H, q) == 7
        H_twin, q_twin = twin.normal_rows(y, S, W)
        np.testing.assert_allclose(H, H_twin, atol=1e-12)
        np.testing.assert_allclose(q, q_twin, atol=1e-12)
        assert not H[3].any()
        assert not q[5].any()

    @pytest.mark.parametrize("prior", [PRINTED, CONTINUED])
    def test_recursion_agrees_with_twin(self, prior):
        rng = np.random.default_rng(5)
        faults = np.zeros((40, 4))
        faults[15:, 0], faults[20:, 2] = 8.0, np.arange(20) * 0.5
        y, S = residuals(rng, 40, faults=faults)
        lam, R = np.full(4, 0.5), 0.5 * np.eye(4)
        run = MonotoneMap(MapTuning(np.eye(6), lam, R, 12, prior)).run(y, S)
        reference = twin.recursion(y, S, np.eye(6), lam, np.linalg.inv(R), 12, prior == PRINTED)
        np.testing.assert_allclose(run.f, reference, atol=2e-5)

    def test_any_split_gives_the_same_bits(self):
        y, S = residuals(np.random.default_rng(6), 150, faults=np.full((150, 4), 3.0))
        tuning = MapTuning(np.eye(6), np.ones(4), np.eye(4), 20)
        whole = MonotoneMap(tuning).run(y, S)
        parts, estimator = [], MonotoneMap(tuning)
        for rows in np.split(np.arange(150), [1, 2, 17, 20, 21, 90]):
            parts.append(estimator.run(y[rows], S[rows]).f)
        np.testing.assert_array_equal(np.vstack(parts), whole.f)

    def test_rows_that_are_not_solved_repeat_the_last_one_that_was(self):
        """Numbers too large to be squared spoil every window that holds them."""
        y, S = residuals(np.random.default_rng(6), 90, faults=np.full((90, 4), 3.0))
        S[50] = 1e200
        tuning = MapTuning(np.eye(6), np.ones(4), np.eye(4), 10)
        whole = MonotoneMap(tuning).run(y, S)
        assert (whole.status[50:60] == qp.NON_FINITE).all()
        assert whole.f[49, 0] > 1.0
        np.testing.assert_array_equal(whole.f[50:60], np.tile(whole.f[49], (10, 1)))
        estimator = MonotoneMap(tuning)
        parts = [estimator.run(y[k : k + 1], S[k : k + 1]).f for k in range(90)]
        np.testing.assert_array_equal(np.vstack(parts), whole.f)

    def test_warm_start_changes_the_count_of_iterations_only(self):
        y, S = residuals(np.random.default_rng(7), 120, faults=np.full((120, 4), 3.0))
        tuning = MapTuning(np.eye(6), np.ones(4), np.eye(4), 30)
        estimator, warm, cold = MonotoneMap(tuning), 0, 0
        for k in range(120):
            row = estimator.run(y[k : k + 1], S[k : k + 1])
            n = min(k + 1, 30)
            s, z, f = np.empty((3, n, 4))
            status, iterations, _ = solve_window(
                CONTINUED, estimator.H[:n].copy(), estimator.q[:n].copy(), estimator.slope,
                estimator.R_inv, estimator.f_bar, False, s, z, f, tuning.tolerance,
                np.empty(window_work_size(n, 4)),
            )  # fmt: skip
            assert status == qp.SOLVED
            np.testing.assert_allclose(row.f[0], f[-1], atol=2e-4)
            warm += int(row.iterations[0])
            cold += iterations
        assert warm <= cold

    def test_row_without_a_number_says_nothing(self):
        y, S = residuals(np.random.default_rng(8), 60, faults=np.full((60, 4), [5.0, 0, 0, 0]))
        holes = y.copy()
        holes[30:33, 1] = np.nan
        estimator = MonotoneMap(MapTuning(np.eye(6), np.ones(4), np.eye(4), 25))
        run = estimator.run(holes, S)
        assert (run.status == qp.SOLVED).all()
        assert np.isfinite(run.f).all()
        np.testing.assert_allclose(run.f[32], run.f[29], atol=0.2)
        assert run.f[-1, 0] == pytest.approx(5.0, abs=0.3)

    def test_printed_prior_wanders_where_data_say_little(self):
        """Pure noise, a level whose signature is a hundredth: the continued prior keeps it at 0."""
        y, S = residuals(np.random.default_rng(10), 600)
        highest = {}
        for prior in (PRINTED, CONTINUED):
            tuning = MapTuning(np.eye(6), np.ones(4), np.eye(4), 30, prior)
            highest[prior] = MonotoneMap(tuning).run(y, S).f[:, 3].max()
        assert highest[CONTINUED] < 0.01
        assert highest[PRINTED] > 1.0

    def test_estimates_never_leave_what_is_possible(self):
        y, S = residuals(np.random.default_rng(9), 200)
        estimator = MonotoneMap(MapTuning(np.eye(6), np.ones(4), np.eye(4), 50))
        estimator.run(y, S)
        assert np.diff(estimator.f, axis=0).min() >= -1e-12
        assert estimator.f.min() >= 0.0
        assert estimator.f.shape == (50, 4)
