"""wang2020: the quick version end to end, scores by closed form, claims that can go either way."""

import dataclasses
import json
import math

import numpy as np
import pytest

from estimators.imkf import Settings
from monitor.commands.reproduce.study import Scope
from monitor.commands.reproduce.wang2020 import claims, runs, scores
from monitor.commands.reproduce.wang2020.found import Found, Spread
from monitor.commands.reproduce.wang2020.methods import METHODS, Estimates, paper_settings
from monitor.commands.reproduce.wang2020.printed import TABLE3, TABLE4
from monitor.commands.reproduce.wang2020.tables import laplace_within
from sim_feeds.papers.wang2020 import wang2020_experiment, wang2020_scenario

pytest.importorskip("scipy")


@pytest.fixture
def results(quickly):
    return quickly("wang2020")[0]


@pytest.fixture
def chapter(quickly):
    return quickly("wang2020")[1]


def test_jobs_are_plain_values_and_cover_200_seeds():
    full = runs.jobs(Scope())
    assert len({job.name for job in full}) == len(full)
    for job in full:
        assert json.loads(json.dumps(job.what)) == job.what
    for law in ("gaussian", "laplace", "cauchy"):
        own = [job for job in full if job.name.startswith(f"runs/{law}/")]
        seeds = [job.seed + i for job in own for i in range(job.what["runs"])]
        assert sorted(seeds) == list(range(200))
    (varied,) = (job for job in full if job.name == "settings")
    assert varied.seed > 200
    other = runs.jobs(Scope(seed=1))
    assert not {job.seed for job in other} & {job.seed for job in full}


def test_a_job_gives_the_same_result_again():
    (job,) = (job for job in runs.jobs(Scope(quick=True)) if job.name == "shown")
    one, two = runs.work(job), runs.work(job)
    for key in ("x", "y", "health"):
        np.testing.assert_array_equal(one[key], two[key])


def test_chapter_has_every_table_and_figure_of_the_paper(chapter):
    names = {block.name for block in chapter.blocks if hasattr(block, "name")}
    for figure in range(3, 10):
        assert f"wang2020-fig{figure}" in names
    assert {"wang2020-table3", "wang2020-table4"} <= names
    for block in chapter.blocks:
        if getattr(block, "name", "") in ("wang2020-table3", "wang2020-table4", "wang2020-within"):
            assert block.columns[-1] == "why they differ"
            assert all(len(str(row[-1])) > 20 for row in block.rows)


def test_what_the_note_found_is_found_again(results):
    """Medians of 200 runs that an independent implementation has; these are of 16 runs."""
    found = Found(results)
    noted = {"proposed": 39.3, "chi-square": 47.8, "rakf-channel": 46.6, "clairvoyant": 12.9}
    for method, area in noted.items():
        assert found.spread(method, "a95").median == pytest.approx(area, rel=0.3), method
    assert found.ratio("deployed", "clairvoyant").median < 1.4
    assert found.classic_apart < 1e-9
    assert np.max(found.units["with_apart"]) < 1e-8
    assert np.median(found.units["without_apart"]) > 0.1
    share = found.printed("rejected") / found.printed("samples")
    assert share == pytest.approx(0.056, abs=0.015)


def test_the_clairvoyant_filter_is_honest_and_the_limit(results):
    found = Found(results)
    assert np.median(found.each("clairvoyant", "nees")) == pytest.approx(2.0, rel=0.1)
    for method in METHODS:
        assert found.ratio(method, "clairvoyant").median >= 1.0


def test_claims_can_turn(results):
    """The same statement, told from other results, has another outcome."""
    found = Found(results)
    outcomes = {c.statement: c.outcome for c in claims.claims(found)}
    assert "not reproducible" in outcomes.values()
    turned = dict(results)
    gaussian = dict(turned["runs/gaussian/000"])
    better = {m: dict(s) for m, s in gaussian["scores"].items()}
    better["proposed"]["a95"] = better["clairvoyant"]["a95"] / 5.0
    better["proposed"]["nees"] = np.full_like(better["proposed"]["nees"], 2.0)
    better["deployed"]["a95"] = 2.0 * better["clairvoyant"]["a95"]
    gaussian.update(scores=better, classic_apart=np.array([0.1]))
    turned["runs/gaussian/000"] = gaussian
    turned["shown"] = {**turned["shown"], "observable": [True, False, True, True]}
    turned["units"] = {**turned["units"], "without_apart": np.zeros(2)}
    now = {c.statement: c.outcome for c in claims.claims(Found(turned))}
    changed = {statement for statement in now if now[statement] != outcomes[statement]}
    for part in ("observable", "expected standard", "RAKF", "classic", "Eq. (14)", "aim"):
        assert any(part in statement for statement in changed), part


def test_ellipse_of_known_errors():
    rng = np.random.default_rng(0)
    L = np.array([[3.0, 0.0], [1.0, 0.5]])
    errors = rng.standard_normal((200_000, 2)) @ L.T + [1.0, 2.0]
    expected = math.pi * 5.9915 * 3.0 * 0.5
    assert scores.ellipse_area(errors) == pytest.approx(expected, rel=0.01)
    centred = (errors - errors.mean(axis=0)) @ np.linalg.inv(L).T
    inside = (centred**2).sum(axis=1) < scores.chi_square_2(0.95)
    assert inside.mean() == pytest.approx(0.95, abs=0.002)


def test_score_counts_what_is_believed():
    run = wang2020_experiment(1)
    right = Estimates(run.x, np.tile(np.eye(2), (len(run.x), 1, 1)), run.works.astype(float))
    perfect = scores.score(right, run)
    assert perfect["mean"] == perfect["a95"] == perfect["nees"] == 0.0
    assert not perfect["missed"].any()
    assert not perfect["false"].any()
    wrong = dataclasses.replace(right, works=1.0 - right.works)
    assert (scores.score(wrong, run)["missed"] == 1.0).all()
    off = scores.score(dataclasses.replace(right, x=run.x + np.array([0.03, 0.04])), run)
    assert off["mean"] == pytest.approx(5.0)
    assert off["a95"] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(off["within"], [[3.0, 3.0], [4.0, 4.0]])


def test_named_after():
    run = wang2020_experiment(1)
    health = np.ones((1000, 4))
    health[530:, 0] = 0.4
    named = scores.named_after_s(health, run)
    assert named[0] == pytest.approx(0.31)
    assert math.isnan(named[1])


def test_spread():
    spread = Spread(np.arange(11.0))
    assert (spread.low, spread.median, spread.high) == (1.0, 5.0, 9.0)
    assert spread.below(5.0) == pytest.approx(6 / 11)
    assert spread.words() == "5 (1 to 9)"


def test_printed_numbers_agree_with_one_another():
    assert TABLE3["proposed"] == TABLE4["gaussian"]
    assert laplace_within() > 0.99
    assert paper_settings() == Settings.paper(
        tuple(wang2020_scenario().filter_fault_free), wang2020_scenario().variation_limit
    )
