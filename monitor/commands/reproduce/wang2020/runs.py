"""The jobs: many runs with their scores, what changes with the settings, and one run to show."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from estimators.imkf import Settings, Status
from monitor.commands.reproduce.study import Job, Result, Scope
from monitor.commands.reproduce.wang2020.methods import (
    METHODS,
    Estimates,
    engine_model,
    filter_of,
    paper_settings,
    physical,
    settings_of,
)
from monitor.commands.reproduce.wang2020.scores import (
    errors_percent,
    expected_std_percent,
    named_after_s,
    score,
)
from sim_feeds.papers.wang2020 import (
    NOISE_LAWS,
    EngineExperiment,
    NoiseLaw,
    wang2020_experiment,
    wang2020_scenario,
)

__all__ = ["SHOWN", "VARIED", "jobs", "work"]

KEY: Final = "wang2020"
RUNS_A_JOB: Final = 20
QUICK_RUNS: Final = 16
OTHER_SEEDS: Final = 5000
"""First seed of the runs on which settings are varied: none of the reported ones."""
SHOWN: Final = ("proposed", "chi-square", "rakf", "deployed", "clairvoyant")
"""Methods whose errors of one run are drawn."""
ELSEWHERE: Final = ("proposed", "chi-square", "health", "deployed", "clairvoyant")
"""Methods that are also run in noise that is not Gaussian."""
UNDERFLOW: Final = math.log(5e-324)
"""Below it (14) as printed divides zero by zero."""


def _varied() -> dict[str, Settings]:
    s = wang2020_scenario()
    true, told = tuple(s.fault_free.tolist()), tuple(s.filter_fault_free.tolist())
    half = (0.5,) * len(told)
    forms: dict[str, Settings] = {}
    for name, fault_free in (("guessed", told), ("true", true), ("one half", half)):
        forms[f"printed, {name} lambda"] = replace(paper_settings(), fault_free=fault_free)
        forms[f"health 0.5 s, {name} lambda"] = settings_of(
            fault_free=fault_free, all_faulty=True, memory_s=0.5
        )
    for memory_s in (0.05, 0.1, 0.2, 1.0, 2.0):
        forms[f"health {memory_s:g} s, guessed lambda"] = settings_of(
            all_faulty=True, memory_s=memory_s
        )
    return forms


VARIED: Final = _varied()
"""What is varied on other runs than those reported."""


def jobs(scope: Scope) -> list[Job]:
    """Runs in three kinds of noise, units, settings, and the run that is shown."""
    count = QUICK_RUNS if scope.quick else wang2020_scenario().runs
    first = scope.drawn(0)
    made = []
    for law in NOISE_LAWS:
        methods = list(METHODS if law == "gaussian" else ELSEWHERE)
        for begin in range(0, count, RUNS_A_JOB):
            what = {"noise": law, "runs": min(RUNS_A_JOB, count - begin), "methods": methods}
            made.append(Job(KEY, f"runs/{law}/{begin:03d}", what, first + begin))
    made.append(Job(KEY, "units", {"runs": count}, first))
    made.append(Job(KEY, "settings", {"runs": count}, first + OTHER_SEEDS))
    made.append(Job(KEY, "shown", {}, first))
    return made


def work(job: Job) -> Result:
    """Do one job."""
    match job.name.partition("/")[0]:
        case "runs":
            return _runs(job)
        case "units":
            return _units(_experiments(job))
        case "settings":
            return _settings(_experiments(job))
        case _:
            return _shown(job.seed)


def _experiments(job: Job) -> Iterable[EngineExperiment]:
    law: NoiseLaw = job.what.get("noise", "gaussian")
    return (wang2020_experiment(job.seed + i, law) for i in range(job.what["runs"]))


def _stacked(rows: list[Result]) -> Result:
    """One array per key from the results of many runs."""
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def _runs(job: Job) -> Result:
    """Scores of every method; what is special to the printed form and to the health."""
    scores: dict[str, list[Result]] = {name: [] for name in job.what["methods"]}
    printed, apart, named = [], [], []
    for run in _experiments(job):
        made = {name: METHODS[name](run) for name in scores}
        for name, estimates in made.items():
            scores[name].append(score(estimates, run))
        printed.append(_printed(made["proposed"], run))
        if "classic" in made:
            apart.append(float(np.abs(made["classic"].x / made["proposed"].x - 1.0).max()))
        track = made["deployed"].track
        if track is not None:
            named.append(named_after_s(track.health, run))
    return {
        "scores": {name: _stacked(rows) for name, rows in scores.items()},
        "printed": _stacked(printed),
        "classic_apart": np.array(apart),
        "named_s": np.array(named),
    }


def _printed(estimates: Estimates, run: EngineExperiment) -> Result:
    """What the rule Delta rejects, and where (14) underflows."""
    track = estimates.track
    assert track is not None
    rejected = np.equal(track.status, Status.REJECTED)
    none = np.logical_not(run.works.any(axis=1))
    return {
        "rejected": int(rejected.sum()),
        "all_faulty": int(none.sum()),
        "rejected_all_faulty": int((rejected & none).sum()),
        "underflows": int((track.ln_evidence < UNDERFLOW).sum()),
        "samples": len(run.t_s),
    }


def _units(experiments: Iterable[EngineExperiment]) -> Result:
    """How far estimates in rpm are from the dimensionless ones, with and without ranges."""
    rows = []
    for run in experiments:
        x = METHODS["all-faulty"](run).x
        row: dict[str, Any] = {}
        for name, with_ranges in (("with", True), ("without", False)):
            other = physical(run, with_ranges=with_ranges)
            row[f"{name}_apart"] = float(np.abs(other - x).max())
            row[f"{name}_a95"] = score(Estimates(other, np.tile(np.eye(2), (len(x), 1, 1))), run)[
                "a95"
            ]
        rows.append(row)
    return _stacked(rows)


def _settings(experiments: Iterable[EngineExperiment]) -> Result:
    """Areas of the ellipse under other settings, and of the clairvoyant filter."""
    areas: dict[str, list[float]] = {name: [] for name in (*VARIED, "clairvoyant")}
    for run in experiments:
        for name, settings in VARIED.items():
            track = filter_of(settings).run(run.u, run.y)
            areas[name].append(score(Estimates(track.x, track.P), run)["a95"])
        areas["clairvoyant"].append(score(METHODS["clairvoyant"](run), run)["a95"])
    return {name: np.array(values) for name, values in areas.items()}


def _shown(seed: int) -> Result:
    """The series of one run for the paper's figures."""
    run = wang2020_experiment(seed)
    made = {name: METHODS[name](run) for name in SHOWN}
    others = {law: wang2020_experiment(seed, law) for law in NOISE_LAWS}
    health = made["deployed"].track
    assert health is not None
    return {
        "seed": seed,
        "t_s": run.t_s,
        "u": run.u,
        "x": run.x,
        "y": run.y,
        "works": run.works,
        "health": health.health,
        "estimates": {name: made[name].x for name in ("proposed", "deployed")},
        "delta": {name: expected_std_percent(made[name].P) for name in ("proposed", "deployed")},
        "errors": {name: errors_percent(e, run) for name, e in made.items()},
        "by_noise": {
            law: errors_percent(METHODS["proposed"](other), other) for law, other in others.items()
        },
        "bleed": {law: other.y[:, -1] for law, other in others.items()},
        "nbytes": filter_of(paper_settings()).nbytes,
        "observable": _observable(),
    }


def _observable() -> list[bool]:
    """Whether the state can be had from each channel alone."""
    model = engine_model()
    n = len(model.A)
    return [
        bool(
            np.linalg.matrix_rank(
                np.array([c @ np.linalg.matrix_power(model.A, k) for k in range(n)])
            )
            == n
        )
        for c in model.C
    ]
