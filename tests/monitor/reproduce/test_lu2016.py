"""lu2016: the quick version end to end, its numbers against the trial's, claims that can fail."""

import copy
from collections.abc import Callable

import numpy as np
import pytest

from monitor.commands.reproduce.lu2016 import fault_walk, open_loop, rates, simulated
from monitor.commands.reproduce.lu2016.methods import METHODS, MODELS, scores
from monitor.commands.reproduce.lu2016.paper import PAPER, STUDIES
from monitor.commands.reproduce.lu2016.published import AXES, TRIAL_RMSE
from monitor.commands.reproduce.study import Chapter, Results, Scope, Table
from sim_feeds.papers.lu2016 import lu2016_experiment

QUICK = Scope(quick=True)
OWN = {"simulated": simulated, "fault_walk": fault_walk, "open_loop": open_loop, "rates": rates}


@pytest.fixture(scope="module")
def chapter(quickly: Callable[[str], tuple[Results, Chapter]]) -> Chapter:
    return quickly("lu2016")[1]


@pytest.fixture(scope="module")
def results(quickly: Callable[[str], tuple[Results, Chapter]]) -> Results:
    return quickly("lu2016")[0]


def of(results: Results, study: str) -> Results:
    return {n: r for n, r in results.items() if n.startswith(f"{study}/")}


def table(chapter: Chapter, name: str) -> Table:
    return next(b for b in chapter.blocks if isinstance(b, Table) and b.name == name)


def test_jobs_have_names_of_their_own_and_find_their_study() -> None:
    for scope in (QUICK, Scope(), Scope(seed=7)):
        names = [job.name for job in PAPER.jobs(scope)]
        assert len(names) == len(set(names))
        assert {name.partition("/")[0] for name in names} <= set(STUDIES)
    quick, full = (len(PAPER.jobs(Scope(quick=q))) for q in (True, False))
    assert 3 * quick < full


def test_another_seed_shares_no_draw() -> None:
    first, other = (
        {job.seed for job in PAPER.jobs(Scope(seed=seed)) if job.name.count("/") > 1}
        for seed in (0, 1)
    )
    assert len(first) == len(other) > 20
    assert not first & other


def test_the_same_job_gives_the_same_bits() -> None:
    job = next(j for j in simulated.jobs(QUICK) if "turbulence" in j.name)
    one, same = (simulated.work(job) for _ in range(2))
    for model in MODELS:
        for method in METHODS:
            assert np.array_equal(one[model][method]["rmse"], same[model][method]["rmse"])


def test_figures_get_at_most_two_thousand_points(results: Results) -> None:
    for name in results:
        lines = results[name].get("lines")
        if lines is not None and name.partition("/")[0] in OWN:
            assert len(lines["t_s"]) <= 2000


@pytest.mark.parametrize("wind", simulated.WINDS)
def test_errors_are_those_of_the_independent_trial(results: Results, wind: str) -> None:
    """Within 15 %, but for the airspeed model in the shear, which is another."""
    for model in MODELS:
        if model == "AS" and wind == "shear":
            continue
        ours = simulated.median(results, wind, model, "atsekf", "rmse")
        assert np.allclose(ours, TRIAL_RMSE[model][wind], rtol=0.15), (wind, model, ours)


def test_tables_beside_others_say_why_they_differ(chapter: Chapter) -> None:
    for name in ("lu2016-trial", "lu2016-quiet", "lu2016-latency"):
        found = table(chapter, name)
        assert found.columns[-1] == "why they differ"
        for row in found.rows:
            assert str(row[-1]).endswith(".")
            assert all(np.isfinite(cell) for cell in row if isinstance(cell, float))


def test_every_estimator_stands_on_both_models_in_every_wind(chapter: Chapter) -> None:
    rows = table(chapter, "lu2016-simulated").rows
    assert len(rows) == len(simulated.WINDS) * len(MODELS) * len(METHODS)
    assert len(rows[0]) == 3 + len(AXES)


def test_slower_receivers_are_worse_and_latency_is_a_fault(results: Results) -> None:
    own = of(results, "rates")
    fast, middle, slow = (
        own[f"rates/calm/{hz}/100"]["used"]["rmse"][:3].mean() for hz in (100, 5, 1)
    )
    assert fast < middle < slow
    late = own["rates/late/100"]
    assert late["compensated"] < 0.02
    assert late["uncompensated"] > 10.0 * late["compensated"]


def test_at_equal_noise_the_filter_beats_the_observer(results: Results) -> None:
    quiet, rmse, tau, low = fault_walk.at_equal_noise(of(results, "fault_walk"))
    assert quiet < 0.02
    assert rmse < 0.5 * low
    assert 0.1 < tau < 0.64


def test_scores_of_estimates_whose_errors_are_known() -> None:
    flight = lu2016_experiment("calm", 0)
    f, t = flight.f[1:], flight.t_s[1:]
    off = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.1])
    late = np.where((t > 20.0)[:, None], f, 0.0)
    found = scores({"exact": f, "off": f + off, "late": late}, flight)
    assert all(np.all(found["exact"][s] == 0.0) for s in ("rmse", "bias", "largest", "before"))
    for score in ("rmse", "bias", "largest", "before"):
        assert np.allclose(found["off"][score], off)
    assert np.allclose(found["off"]["quiet"], 0.0)
    assert found["late"]["largest"][0] == pytest.approx(3.0)
    assert found["late"]["bias"][0] == pytest.approx(-1.0, abs=0.01)  # 15-20 of 15-30 s
    assert found["late"]["rmse"][0] == pytest.approx(3.0 * np.sqrt(0.25), rel=0.01)


def test_samples_of_a_receiver_are_held_back_and_joined_by_lines() -> None:
    t = np.arange(11.0)
    y = np.column_stack([t**2, t, -t, t, t, t])
    sparse = rates.held_back(y, 5)
    assert np.flatnonzero(np.isfinite(sparse[:, 0])).tolist() == [0, 5, 10]
    assert np.array_equal(sparse[:, 3:], y[:, 3:])
    joined = rates.interpolated(t, sparse)
    assert np.allclose(joined[:, 1:], y[:, 1:])
    assert np.allclose(joined[:6, 0], 5.0 * t[:6])


def spoiled(results: Results, factor: float, *parts: str) -> Results:
    """Results with every score of these models, methods or runs multiplied."""
    out = copy.deepcopy(dict(results))

    def multiply(found: dict) -> None:
        for score, value in found.items():
            if isinstance(value, dict):
                multiply(value)
            elif score in ("before", "rmse", "quiet", "bias", "followed", "largest"):
                found[score] = value * factor

    for result in out.values():
        for part, found in result.items():
            if part.partition("/")[0] in parts and isinstance(found, dict):
                multiply(found)
    return out


@pytest.mark.parametrize(
    ("study", "factor", "parts", "place"),
    [
        ("simulated", 60.0, ("GS",), "3.4, 3.5: with the airspeed model"),
        ("simulated", 60.0, ("GS",), "unbiased"),
        ("simulated", 60.0, ("GS",), "gyro faults are estimated alike"),
        ("fault_walk", 10.0, ("form",), "better than a low-passed"),
        ("open_loop", 3.0, ("GS",), "almost twice"),
        ("open_loop", 30.0, ("GS",), "parabolic flight: both"),
        ("open_loop", 30.0, ("GS",), "wrong even before"),
        ("open_loop", 60.0, ("GS",), "largest gyro error"),
        ("open_loop", 60.0, ("GS",), "prominently smaller"),
    ],
)
def test_other_numbers_give_another_outcome(
    results: Results, study: str, factor: float, parts: tuple[str, ...], place: str
) -> None:
    own = of(results, study)
    before, after = (
        next(c for c in OWN[study].claims(r, QUICK) if place in c.statement)
        for r in (own, spoiled(own, factor, *parts))
    )
    assert before.outcome != after.outcome
    assert before.because != after.because


def test_the_summary_counts_the_claims(chapter: Chapter) -> None:
    held = sum(c.outcome == "holds" for c in chapter.claims)
    assert f"Of {len(chapter.claims)} statements {held} hold" in chapter.summary
