"""Air data: the constrained horizon against its numpy twin and CasADi's solvers.

Every contender gets the same window, recorded from a synthetic level flight whose airspeed has run
away until the wind leans on its bound, and starts from the same linearisation point.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable

import numpy as np

from estimators.air_data_2d import APPROXIMATE
from estimators.air_data_mhe import AirDataMHE, AirDataTuning, mhe_advance, mhe_solve
from estimators.baselines import numpy_twins_air as twin
from monitor.commands.bench_cases import BenchCase
from monitor.commands.bench_cases.air_casadi import CasadiHorizon, Horizon, compiler

__all__ = ["cases", "leaning_window", "solver"]

STEP_CALLS = {
    "": 500,
    "numpy": 5,
    "casadi_qrqp": 50,
    "casadi_qrqp_buffer": 200,
    "casadi_ipopt": 2,
}
"""Calls of each contender in one round: some milliseconds each."""

LEVEL_THETA = np.array([110.0, 0.06, 0.0, 9.80665 * np.sin(0.06), -9.80665 * np.cos(0.06), 1500.0])


def leaning_window(N: int, converged: bool = False, seed: int = 1) -> AirDataMHE:
    """An estimator at the wind's bound: N samples in its horizon, the newest not yet solved."""
    tuning = AirDataTuning(
        model=APPROXIMATE, N=N, converged=converged, sqp_iterations=30 if converged else 1
    )
    rng = np.random.default_rng(seed)
    x0 = np.array([0.06, 110.0, 0.0, 0.0])
    estimator = AirDataMHE(tuning, x0, LEVEL_THETA)
    y0 = twin.outputs(APPROXIMATE, x0, LEVEL_THETA)
    count = max(240, 3 * N)
    for k in range(count):
        theta = LEVEL_THETA.copy()
        theta[0] += 0.1 * rng.normal()
        y = y0 + rng.normal(size=4) * tuning.R_std
        y[3] -= 75.0 * k / count
        if k < count - 1:
            estimator.step(y, np.ones(4), theta)
    mhe_advance(
        tuning.model, tuning.t_s, N, estimator.window, y, np.ones(4), theta, 0.0, estimator.work
    )
    return estimator


def horizon_of(estimator: AirDataMHE) -> Horizon:
    """The window for CasADi."""
    e = estimator
    parts = (e.x_prior, e.x, e.u, e.y, e.theta)
    return Horizon(e.tuning.t_s, e.table.copy(), *(part.copy() for part in parts))


def repeated(work: Callable[[], object], times: int) -> Callable[[], object]:
    """The work ``times`` over: no contender pays for caches that another one cleared."""

    def run() -> object:
        for _ in range(times - 1):
            work()
        return work()

    return run


def solver(estimator: AirDataMHE) -> Callable[[], object]:
    """Solve the estimator's window from the same start at every call."""
    e, t = estimator, estimator.tuning
    start = e.window.copy()
    arguments = (
        t.model, t.t_s, e.table, e.confine, 0.0 if t.converged else t.kappa, t.n_kappa, t.n_qp,
        t.sqp_iterations, t.N, e.window, e.work,
    )  # fmt: skip

    def run() -> object:
        e.window[:] = start
        return mhe_solve(*arguments)

    return run


def _twin(estimator: AirDataMHE) -> Callable[[], object]:
    h, t = horizon_of(estimator), estimator.tuning
    use = np.ones_like(h.y)
    return lambda: twin.mhe_step(
        t.model, t.t_s, h.tuning, t.kappa, t.n_kappa, t.n_qp, h.x_prior, h.x, h.u, h.y, use, h.theta
    )


def _stage_cost_ratio() -> float:
    """Cost of a stage with N = 100 over that with N = 10, medians of interleaved runs.

    The compiled loop over samples is timed, so that the price of a call from Python, which does not
    depend on N, is not taken for a cost of the stages.
    """
    runs = {}
    for N, samples in ((10, 200), (100, 20)):
        estimator = leaning_window(N)
        row = np.concatenate([estimator.y[-1], np.ones(4), estimator.theta[-1]])
        runs[N] = estimator, np.tile(row, (samples, 1))
    taken: dict[int, list[float]] = {10: [], 100: []}
    for _ in range(300):
        for N, (estimator, rows) in runs.items():
            began = time.perf_counter_ns()
            estimator.run(rows)
            taken[N].append(time.perf_counter_ns() - began)
    return float(np.median(taken[100][1:]) / np.median(taken[10][1:]))


def cases() -> list[BenchCase]:
    """The air data cases; CasADi's peers where it is installed, the compiled with a compiler."""
    step = leaning_window(3)
    whole = leaning_window(10, converged=True)
    step_peers: dict[str, Callable[[], object]] = {"numpy": _twin(step)}
    whole_peers: dict[str, Callable[[], object]] = {}
    missing: list[str] = []
    if importlib.util.find_spec("casadi") is None:
        missing += ["casadi_qrqp", "casadi_ipopt"]
    else:
        three, ten = CasadiHorizon(horizon_of(step)), CasadiHorizon(horizon_of(whole))
        if compiler() is None:
            missing.append("casadi_qrqp")
        else:
            step_peers["casadi_qrqp"] = three.caller(lambda: three.compiled(three.sqp(1)))
            step_peers["casadi_qrqp_buffer"] = three.buffered(lambda: three.compiled(three.sqp(1)))
            whole_peers["casadi_qrqp"] = ten.caller(lambda: ten.compiled(ten.sqp(30)))
        step_peers["casadi_ipopt"] = three.caller(three.ipopt)
        whole_peers["casadi_ipopt"] = ten.caller(ten.ipopt)
    return [
        BenchCase(
            name="mhe_step_n3",
            run=repeated(solver(step), STEP_CALLS[""]),
            calls=STEP_CALLS[""],
            peers={peer: repeated(work, STEP_CALLS[peer]) for peer, work in step_peers.items()},
            peer_calls=STEP_CALLS,
            note=(
                "One constrained sample, N = 3, bounds active: linearisation and 2 x 2 barrier "
                "iterations, called from Python. casadi_qrqp solves the same quadratic programme "
                "(one SQP iteration, compiled) by its ordinary call, casadi_qrqp_buffer without "
                "converting arguments; casadi_ipopt converges. The numpy twin takes its Jacobians "
                "by complex steps, about a third of its time."
            ),
            missing=tuple(missing),
        ),
        BenchCase(
            name="mhe_stage_n100_over_n10",
            unit="1",
            value=_stage_cost_ratio,
            note="Time per stage of a horizon of 100 over that of a horizon of 10.",
        ),
        BenchCase(
            name="mhe_converged_n10",
            run=repeated(solver(whole), 10),
            calls=10,
            peers={peer: repeated(work, 5) for peer, work in whole_peers.items()},
            peer_calls=dict.fromkeys(whole_peers, 5),
            note="N = 10 to convergence: Gauss-Newton steps below 1e-9, complementarity 1e-13.",
            missing=tuple(missing),
        ),
    ]
