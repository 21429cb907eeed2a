"""Many flights through the pipeline: one after the other, or in two processes if it is much."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from multiprocessing.pool import AsyncResult
from pathlib import Path
from typing import Any

from estimators.jit import is_cold
from monitor.learn.flights import Flight, measure_log
from monitor.settings import Settings

__all__ = ["measure_logs"]

PROCESSES = 2
WORTH_BYTES = 48_000_000
"""Less than this is done before a second process has started and loaded its kernels."""
POLL_S = 0.1

_done: Any = None
"""Bytes read by all processes together: shared memory, set in each of them when it starts."""


def measure_logs(
    paths: Sequence[Path], settings: Settings, progress: Callable[[float], None]
) -> list[Flight]:
    """Measure every log with these settings, in the order given.

    Parameters
    ----------
    progress
        Called with the fraction done.

    Raises
    ------
    links.logs.LogError
        One of the files cannot be read as a log.
    """
    sizes = [path.stat().st_size if path.is_file() else 0 for path in paths]
    total = max(sum(sizes), 1)
    if len(paths) < 2 or total < WORTH_BYTES or is_cold():
        return _one_by_one(paths, sizes, settings, progress)
    context = multiprocessing.get_context("spawn")
    done = context.Value("q", 0)
    with context.Pool(PROCESSES, _start, (done,)) as pool:
        results = [pool.apply_async(_measure, (path, settings)) for path in paths]
        return [_awaited(result, lambda: progress(done.value / total)) for result in results]


def _one_by_one(
    paths: Sequence[Path],
    sizes: Sequence[int],
    settings: Settings,
    progress: Callable[[float], None],
) -> list[Flight]:
    flights: list[Flight] = []
    total = max(sum(sizes), 1)

    def tell(read: int, _: int) -> None:
        progress((sum(sizes[: len(flights)]) + read) / total)

    for path in paths:
        flights.append(measure_log(path, settings, tell))
    return flights


def _awaited(result: AsyncResult[Flight], tell: Callable[[], None]) -> Flight:
    """The result, telling how far it is while it is waited for."""
    while not result.ready():
        result.wait(POLL_S)
        tell()
    return result.get()


def _start(done: Any) -> None:
    """A process of the pool begins: Ctrl-C is for the one that waits."""
    global _done
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _done = done


def _measure(path: Path, settings: Settings) -> Flight:
    before = 0

    def add(read: int, _: int) -> None:
        nonlocal before
        with _done.get_lock():
            _done.value += read - before
        before = read

    return measure_log(path, settings, add)
