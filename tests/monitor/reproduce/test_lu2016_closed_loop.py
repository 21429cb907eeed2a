"""lu2016 in closed loop: the filter in the loop is the filter off line; claims that can fail."""

import copy
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from estimators.two_stage_ekf import TwoStageFilter
from monitor.commands.reproduce.lu2016 import closed_loop
from monitor.commands.reproduce.lu2016.closed_loop import (
    FILTERS,
    Reconstruction,
    started,
    task,
)
from monitor.commands.reproduce.lu2016.closed_loop_names import (
    AIR,
    EXACT,
    FAULTY,
    GROUND,
    steered_on,
)
from monitor.commands.reproduce.lu2016.closed_loop_shown import blocks, claims
from monitor.commands.reproduce.lu2016.published import TRIAL_RMSE
from monitor.commands.reproduce.study import Chapter, Figure, Results, Scope, Table
from sim_feeds.closed_loop import fly_closed
from sim_feeds.faults import lu2016_table2
from sim_feeds.papers.lu2016_validation import validation

QUICK = Scope(quick=True)


@pytest.fixture(scope="module")
def results(quickly: Callable[[str], tuple[Results, Chapter]]) -> Results:
    every = quickly("lu2016")[0]
    return {n: r for n, r in every.items() if n.startswith("closed_loop/")}


def test_the_scenario_file_is_well_formed() -> None:
    section = validation().closed_loop
    assert set(section.quick_winds) <= set(section.winds)
    assert set(section.quick_seeds) <= set(section.seeds)
    assert not set(section.tuning_seeds) & set(section.seeds)
    starts = [order.start_s for order in section.flight.order]
    assert starts == sorted(starts)
    assert starts[-1] < section.flight.duration_s
    names = [job.name for job in closed_loop.jobs(Scope())]
    assert len(names) == len(set(names)) == len(section.winds) * len(section.seeds)
    assert {job.name for job in closed_loop.jobs(QUICK)} <= set(names)
    other = Scope(seed=7)
    moved = [job.seed for job in closed_loop.jobs(other)]
    assert moved == [other.drawn(job.seed) for job in closed_loop.jobs(Scope())]
    assert not set(moved) & {job.seed for job in closed_loop.jobs(Scope())}


@pytest.mark.parametrize("name", [GROUND, EXACT, AIR])
def test_the_filter_in_the_loop_is_the_filter_off_line(name: str) -> None:
    short = replace(task(validation().closed_loop, "turbulence"), duration_s=12.0)
    reconstruct = Reconstruction(FILTERS[name])
    flight = fly_closed(short, reconstruct, faults=lu2016_table2(), seed=1)
    y = flight.y_air if name == AIR else flight.y_ground
    again: TwoStageFilter = started(FILTERS[name], y[0].copy())
    track = again.run(flight.u_m[:-1], y[1:], flight.env[:-1])
    np.testing.assert_allclose(np.array(reconstruct.faults)[1:], track["f"], rtol=0, atol=1e-12)


def test_errors_are_those_of_the_independent_trial(results: Results) -> None:
    for result in (r for n, r in results.items() if "/calm/" in n):
        for loop in ("open", "closed"):
            ours = result["filters"][GROUND][f"rmse_{loop}"]
            np.testing.assert_allclose(ours, TRIAL_RMSE["GS"]["calm"], rtol=0.15)


def test_the_reconstruction_protects_the_flight(results: Results) -> None:
    for result in results.values():
        faulty = np.array(result["deviation"][FAULTY])
        fixed = np.array(result["deviation"][steered_on(GROUND)])
        assert (fixed < 0.2 * faulty).all()
        assert all(lost is None for lost in result["lost_s"].values())


def test_lines_of_figures_are_short(results: Results) -> None:
    drawn = [r for r in results.values() if r["t_s"] is not None]
    assert len(drawn) == len(validation().closed_loop.quick_winds)
    for result in drawn:
        assert len(result["t_s"]) == len(result["f_closed"]) <= 2000


def test_blocks_have_a_remark_for_each_difference(results: Results) -> None:
    shown = blocks(results, QUICK)
    assert sum(isinstance(b, Figure) for b in shown) == 2
    states = next(b for b in shown if isinstance(b, Table) and b.name == "lu2016-fig3-states")
    beside = [row for row in states.rows if row[3] is not None]
    assert len(beside) == 1
    assert str(beside[0][-1]).endswith(".")


def spoiled(results: Results, key: str, change: Callable[[np.ndarray], np.ndarray]) -> Results:
    out = copy.deepcopy(dict(results))
    for result in out.values():
        for found in result["filters"].values():
            found[key] = change(np.asarray(found[key])).tolist()
    return out


@pytest.mark.parametrize(
    ("place", "key", "change"),
    [
        ("Fig. 3(a, b)", "state_max", lambda x: 0.01 * x),
        ("Fig. 3(a, b)", "state_max", lambda x: 100.0 * x),
        ("Fig. 3(c, d)", "difference_rms", lambda x: 100.0 * x),
        ("Fig. 3(e, f)", "edge_share", lambda x: 0.0 * x),
        ("zero mean", "quiet_mean_closed", lambda x: x + 1.0),
        ("as valid as", "rmse_closed", lambda x: 1.5 * x),
    ],
)
def test_other_numbers_give_another_outcome(
    results: Results, place: str, key: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    before, after = (
        next(c for c in claims(r, QUICK) if place in c.statement)
        for r in (results, spoiled(results, key, change))
    )
    assert before.outcome != after.outcome
    assert before.because != after.because


def test_a_useless_reconstruction_is_no_fault_tolerant_control(results: Results) -> None:
    useless = copy.deepcopy(dict(results))
    for result in useless.values():
        result["deviation"][steered_on(GROUND)] = result["deviation"][FAULTY]
    before, after = (
        next(c for c in claims(r, QUICK) if "fault-tolerant" in c.statement)
        for r in (results, useless)
    )
    assert before.outcome == "holds"
    assert after.outcome == "does not hold"


def test_without_results_nothing_is_said() -> None:
    assert blocks({}, QUICK) == []
    assert claims({}, QUICK) == []
