"""Tasks over processes that are started afresh, with progress and a clean end on Ctrl-C."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

__all__ = ["Step", "each"]

Task = TypeVar("Task")
Result = TypeVar("Result")
Step = Callable[[], None]
"""Called by a task after each part of its work."""

POLL_S = 0.3


def each(
    work: Callable[[Task, Step], Result], tasks: Sequence[Task], jobs: int, step: Step
) -> Iterator[tuple[int, Result]]:
    """Do all tasks; (number of the task, result) as they come.

    Parameters
    ----------
    work
        A function of a module, so that another process can find it.
    tasks
        What to do, in the order in which they are begun.
    jobs
        Processes; 1 does everything here.
    step
        Called here whenever a task says that a part is done.
    """
    if jobs == 1 or len(tasks) < 2:
        for i, task in enumerate(tasks):
            yield i, work(task, step)
        return
    # Started afresh, not forked: a forked process would share numba's threads and locks.
    context = multiprocessing.get_context("spawn")
    told: Any = context.Queue()
    with context.Pool(min(jobs, len(tasks)), _begin, (told,)) as pool:
        numbered = [(work, i, task) for i, task in enumerate(tasks)]
        coming = pool.imap_unordered(_do, numbered, chunksize=1)
        for _ in tasks:
            yield _next(coming, told, step)


def _next(coming: Any, told: Any, step: Step) -> Any:
    while True:
        try:
            found = coming.next(timeout=POLL_S)
        except multiprocessing.TimeoutError:
            _drain(told, step)
        else:
            _drain(told, step)
            return found


def _drain(told: Any, step: Step) -> None:
    while True:
        try:
            told.get_nowait()
        except queue.Empty:
            return
        step()


_TOLD: Any = None


def _begin(told: Any) -> None:
    """Prepare a process: Ctrl-C is the first one's to hear."""
    global _TOLD
    _TOLD = told
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _do(numbered: tuple[Callable[[Any, Step], Any], int, Any]) -> tuple[int, Any]:
    work, i, task = numbered
    return i, work(task, _tell)


def _tell() -> None:
    """Say that a part is done; leave when nobody is there to hear it any more."""
    parent = multiprocessing.parent_process()
    if parent is not None and not parent.is_alive():
        os._exit(1)
    _TOLD.put(None)
