"""Doing the jobs: over processes, with progress, taking up what an earlier run left."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from monitor.commands.processes import Step, each
from monitor.commands.reproduce.papers import perform
from monitor.commands.reproduce.store import Store
from monitor.commands.reproduce.study import Job, Results

__all__ = ["Done", "run_jobs"]

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass
class Done:
    """All results, and what they cost.

    Attributes
    ----------
    results
        By paper, then by the job's name.
    seconds
        By paper: the sum of its jobs' times, each on one core.
    taken
        Jobs whose results an earlier run had left.
    codes
        Digests of the code that made the results; more than one only with ``any_code``.
    """

    results: dict[str, Results] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    taken: int = 0
    codes: set[str] = field(default_factory=set)


def run_jobs(
    jobs: Sequence[Job],
    store: Store,
    processes: int,
    tell: Callable[[float], None],
    *,
    any_code: bool = False,
) -> Done:
    """Do all jobs that the store does not have yet.

    Parameters
    ----------
    jobs
        In the order in which they are begun.
    processes
        1 does everything here.
    tell
        Takes the fraction done.
    any_code
        Take up results of other code as well.
    """
    done = Done()
    missing = []
    by_paper: dict[str, dict[str, dict[str, object]]] = {}
    for job in jobs:
        by_paper.setdefault(job.paper, {})
        done.seconds.setdefault(job.paper, 0.0)
        kept = store.take(job, any_code=any_code)
        if kept is None:
            missing.append(job)
            continue
        by_paper[job.paper][job.name] = kept.result
        done.seconds[job.paper] += kept.seconds
        done.codes.add(kept.code)
        done.taken += 1
    count = done.taken
    tell(count / len(jobs))
    for name in _THREADS:  # one thread a process: the processes share the cores
        os.environ.setdefault(name, "1")
    tasks = [(store, job) for job in missing]
    for _, (job, seconds) in each(_do, tasks, processes, lambda: None):
        kept = store.take(job)
        if kept is None:
            raise RuntimeError(f"the result of {job.paper}/{job.name} cannot be read back")
        by_paper[job.paper][job.name] = kept.result
        done.seconds[job.paper] += seconds
        done.codes.add(kept.code)
        count += 1
        tell(count / len(jobs))
    done.results.update(by_paper)
    return done


def _do(task: tuple[Store, Job], step: Step) -> tuple[Job, float]:
    """One job; its result goes to the disk at once and is not sent between processes."""
    store, job = task
    began = time.perf_counter()
    try:
        result = perform(job)
    except Exception as error:
        raise RuntimeError(f"{job.paper}/{job.name} failed: {error!r}") from error
    seconds = time.perf_counter() - began
    store.keep(job, result, seconds)
    return job, seconds
