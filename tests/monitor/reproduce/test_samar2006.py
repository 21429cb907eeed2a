"""The samar2006 chapter end to end, its plan, and what its flights must show."""

import numpy as np
import pytest

pytest.importorskip("jsbsim")

from estimators.wing_model import FAULTS
from monitor.commands.reproduce.samar2006.paper import PAPER
from monitor.commands.reproduce.samar2006.scheme import (
    RIGHT,
    Scheme,
    estimate,
    residuals_of,
)
from monitor.commands.reproduce.samar2006.work import VARIANTS
from monitor.commands.reproduce.study import Claim, Figure, Scope, Table
from sim_feeds.papers.samar2006 import fly, plan, wrong_numbers
from sim_feeds.sixdof import FAULT_COLUMNS


@pytest.fixture(scope="module")
def results():
    return {job.name: PAPER.work(job) for job in PAPER.jobs(Scope(quick=True))}


class TestPlan:
    def test_no_seed_serves_two_purposes(self):
        chosen = plan()
        seeds = [s for group in (*chosen.seeds.values(), *chosen.models.values()) for s in group]
        assert len(seeds) == len(set(seeds))
        assert set(chosen.seeds) == {"covariance", "alarm", "healthy", "faulty"}

    def test_faults_are_wings_faults_within_the_flight(self):
        for case in plan().cases.values():
            for fault in case.faults:
                assert fault.which in FAULTS
                assert 8.0 < fault.start_s < plan().duration_s - 50.0

    def test_truth_and_estimates_have_one_order(self):
        assert FAULTS == FAULT_COLUMNS

    def test_wrong_model_is_off_by_the_share_everywhere(self):
        wrong = wrong_numbers({"a": 2.0, "b": 3.0, "c": 1.0}, ("a", "b"), 301)
        assert wrong["c"] == 1.0
        assert abs(wrong["a"] / 2.0 - 1.0) == pytest.approx(0.15)
        assert abs(wrong["b"] / 3.0 - 1.0) == pytest.approx(0.15)
        assert wrong_numbers({"a": 2.0}, ("a",), None) == {"a": 2.0}


class TestScheme:
    def test_right_model_leaves_only_wind(self):
        """With the wind known at once the accelerations agree to a tenth of what gusts leave."""
        known = residuals_of(fly(9001), RIGHT, Scheme(tau_wind_s=1e-3)).y.std(axis=0)
        filtered = residuals_of(fly(9001), RIGHT, Scheme()).y.std(axis=0)
        assert (known[[0, 1, 2, 4]] < 0.2 * filtered[[0, 1, 2, 4]]).all()

    def test_lift_step_is_found_and_nothing_before_it(self):
        rows = residuals_of(fly(2001, "right-lift-step"), RIGHT, Scheme())
        f = estimate(rows, RIGHT, Scheme()).f
        before, late = rows.t_s < 100.0, rows.t_s > 115.0
        assert f[before, 0].max() < 5.0
        assert np.median(f[late, 0]) == pytest.approx(10.0, abs=3.0)
        assert np.median(f[late, 0] - f[late, 2]) == pytest.approx(10.0, abs=1.0)

    def test_same_seed_same_bits(self):
        a = residuals_of(fly(1001), RIGHT, Scheme())
        fly.cache_clear()
        b = residuals_of(fly(1001), RIGHT, Scheme())
        np.testing.assert_array_equal(a.y, b.y)
        np.testing.assert_array_equal(a.S, b.S)


class TestChapter:
    def test_quick_chapter_is_whole(self, results):
        chapter = PAPER.chapter(results, Scope(quick=True))
        names = [b.name for b in chapter.blocks if isinstance(b, Table | Figure)]
        for number in range(2, 8):
            assert f"samar2006-fig{number}" in names
        assert len(names) == len(set(names))
        assert all(isinstance(c, Claim) and c.because for c in chapter.claims)
        assert "nan" not in chapter.summary

    def test_figures_draw(self, results):
        matplotlib = pytest.importorskip("matplotlib")
        matplotlib.use("agg")
        from matplotlib.figure import Figure as Canvas

        chapter = PAPER.chapter(results, Scope(quick=True))
        for block in chapter.blocks:
            if isinstance(block, Figure):
                canvas = Canvas(figsize=block.size_in)
                block.draw(canvas)
                assert canvas.axes

    def test_healthy_flights_raise_no_flag_and_steps_do(self, results):
        for model, result in results["healthy/0"].items():
            assert not result["flagged"].any(), model
            assert result["unsolved"] == 0
        for case, i, seconds in (("right-lift-step", 0, 10.0), ("left-lift-step-8", 2, 15.0)):
            for model in (m for m in results[f"faulty/{case}"] if m == RIGHT):
                assert results[f"faulty/{case}"][model]["delay_s"][0, i] < seconds

    def test_every_variant_was_run(self, results):
        assert set(results["variants"]) == set(VARIANTS)

    def test_outcomes_follow_from_the_results(self, results):
        """A claim that another result cannot change is no claim."""
        before = {c.statement: c.outcome for c in PAPER.chapter(results, Scope()).claims}
        worse = {name: dict(result) for name, result in results.items()}
        case = dict(worse["faulty/right-lift-step"])
        case[RIGHT] = {**case[RIGHT], "delay_s": np.full((1, 4), np.nan)}
        worse["faulty/right-lift-step"] = case
        after = {c.statement: c.outcome for c in PAPER.chapter(worse, Scope()).claims}
        changed = [s for s in before if before[s] != after[s]]
        assert any("recovered quickly" in s for s in changed)
