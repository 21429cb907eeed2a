"""The engine estimator: one step of the intermittent-measurement Kalman filter."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.numpy_twins_imkf import BatchedTwin, LoopTwin
from monitor.commands.bench_cases import BenchCase
from monitor.commands.reproduce.wang2020.methods import (
    engine_model,
    filter_of,
    paper_settings,
    wang2020_experiment,
)

__all__ = ["cases"]

PEER_STEPS = 100


def cases() -> list[BenchCase]:
    """Cases that need no recording."""
    return [_imkf_step()]


def _imkf_step() -> BenchCase:
    run, settings = wang2020_experiment(0), paper_settings()
    start = filter_of(settings)

    def ours() -> NDArray[np.float64]:
        return filter_of(settings).run(run.u, run.y).x

    def twin(kind: type[LoopTwin] | type[BatchedTwin]) -> NDArray[np.float64]:
        peer = kind(engine_model(), settings, start.state, start.cov)
        x = np.empty((PEER_STEPS, len(peer.x)))
        for k in range(PEER_STEPS):
            peer.step(run.u[k], run.y[k])
            x[k] = peer.x
        return x

    peers: dict[str, Callable[[], NDArray[np.float64]]] = {
        "python_loop": partial(twin, LoopTwin),
        "numpy_batched": partial(twin, BatchedTwin),
    }

    def apart() -> float:
        x = ours()[:PEER_STEPS]
        return max(float(np.abs(peer() / x - 1.0).max()) for peer in peers.values())

    return BenchCase(
        "imkf_step",
        unit="worst rel. difference",
        run=ours,
        calls=len(run.y),
        peers=peers,
        peer_calls=dict.fromkeys(peers, PEER_STEPS),
        value=apart,
        note="one sample of the paper's form, four channels and two states, in a run over 10 s; "
        "python_loop has one hypothesis after the other, numpy_batched all fifteen at once",
    )
