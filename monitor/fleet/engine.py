"""Many tasks on many processes: Dask, on this computer or on a cluster that stands.

A task is one log. Only a few tasks for each worker are handed to the scheduler at a time, so that a
hundred thousand of them cost it nothing. A worker that dies takes nothing with it: its task, and
results that nobody had fetched yet, are made again by another. What a task raises belongs to that
task alone.
"""

from __future__ import annotations

import logging
import os
import queue
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

__all__ = ["Ended", "Engine", "EngineError", "open_engine"]

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 8
"""Tasks handed out for each worker at a time: enough that none waits, few to be called back."""
POLL_S = 0.5
CONNECT_S = 10.0
MEMORY_SHARE = 0.8
"""Of the computer's memory: what the workers of a local cluster may take together."""

_ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "MKL_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    ),
    "1",
)
"""One numeric thread for each worker: there is one worker for each core."""


class EngineError(Exception):
    """The workers cannot be had, in one plain sentence."""


@dataclass(frozen=True, slots=True)
class Ended(Generic[Item, Result]):
    """A task that has come to its end: with its result, or with what it raised."""

    item: Item
    result: Result | None
    error: BaseException | None


class Engine:
    """Runs tasks on the workers of one cluster.

    Parameters
    ----------
    client
        A connected ``distributed.Client``.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    @property
    def workers(self) -> int:
        """Tasks that run at once."""
        return sum(self._client.nthreads().values())

    def everywhere(self, function: Callable[..., Result], *arguments: object) -> dict[str, Result]:
        """Call ``function`` once on every worker; worker's address -> result."""
        found: dict[str, Result] = self._client.run(function, *arguments)
        return found

    def run(
        self,
        function: Callable[[Item], Result],
        items: Iterable[Item],
        *,
        retries: int = 0,
        waiting: Callable[[], None] = lambda: None,
    ) -> Iterator[Ended[Item, Result]]:
        """Call ``function`` on each item, in any order; yield each as it ends.

        Parameters
        ----------
        retries
            How often a task that raised is tried again.
        waiting
            Called now and then while nothing ends.

        Raises
        ------
        EngineError
            The cluster is gone.
        """
        left = iter(items)
        under_way: dict[Any, Item] = {}
        ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        try:
            while True:
                for item in self._some(left, len(under_way)):
                    future = self._client.submit(function, item, pure=False, retries=retries)
                    under_way[future] = item
                    future.add_done_callback(ended.put)
                if not under_way:
                    return
                try:
                    future = ended.get(timeout=POLL_S)
                except queue.Empty:
                    self._alive()
                    waiting()
                    continue
                yield self._collected(future, under_way.pop(future))
        finally:
            self._client.cancel(list(under_way))

    def _some(self, items: Iterator[Item], under_way: int) -> Iterator[Item]:
        """The next items, as many as there is room for."""
        for _ in range(under_way, AHEAD * max(self.workers, 1)):
            try:
                yield next(items)
            except StopIteration:
                return

    def _collected(self, future: Any, item: Item) -> Ended[Item, Result]:
        from distributed import CancelledError

        try:
            return Ended(item, future.result(), None)
        except CancelledError as error:
            self._alive()
            return Ended(item, None, error)
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:
            return Ended(item, None, error)

    def _alive(self) -> None:
        if self._client.status != "running":
            raise EngineError("the connection to the scheduler is lost")


@contextmanager
def open_engine(workers: int | None = None, scheduler: str | None = None) -> Iterator[Engine]:
    """A cluster to run tasks on, let go afterwards.

    Parameters
    ----------
    workers
        Processes of a local cluster; None takes one for each core.
    scheduler
        Address of a scheduler that stands, such as ``tcp://host:8786``; its workers are used.

    Raises
    ------
    EngineError
        The extra `fleet` is not installed, or the scheduler does not answer or has no worker.
    """
    try:
        import dask
        import distributed
    except ModuleNotFoundError:
        raise EngineError("this needs Dask: pip install 'mavsentry[fleet]'") from None
    configuration = {
        "distributed.logging.distributed": "critical",
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.nanny.pre-spawn-environ": _ONE_THREAD,
    }
    with dask.config.set(configuration):
        if scheduler is None:
            with _local(distributed, workers or os.cpu_count() or 1) as client:
                yield Engine(client)
            return
        try:
            client = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise EngineError(f"no scheduler answers at {scheduler}: {_short(error)}") from None
        with client:
            if not client.nthreads():
                raise EngineError(f"the scheduler at {scheduler} has no worker")
            yield Engine(client)


@contextmanager
def _local(distributed: Any, workers: int) -> Iterator[Any]:
    """A client of processes on this computer that listen on the loopback only."""
    from distributed.system import MEMORY_LIMIT

    with (
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            memory_limit=int(MEMORY_SHARE * MEMORY_LIMIT / workers),
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


def _short(error: BaseException) -> str:
    """The first line of what an exception says, or its name."""
    return (str(error).splitlines() or [""])[0] or type(error).__name__
