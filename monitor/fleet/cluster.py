"""The engine on Dask: processes of this computer, or a cluster that stands.

Only a few tasks for each worker are handed to the scheduler at a time, so that a hundred thousand
of them cost it nothing. A worker that dies takes nothing with it: what it had, and results of it
that nobody had fetched yet, are made again by another. Dask holds a worker's death against all that
waited in its queue; a task that is blamed so is therefore tried again with nothing beside it, and
given up only if its worker dies then, too.
"""

from __future__ import annotations

import logging
import math
import queue
import signal
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing import resource_tracker
from typing import Any, TypeVar

import dask
import dask.system
import distributed
from distributed.comm.addressing import parse_address, parse_host_port
from distributed.comm.registry import get_backend
from distributed.scheduler import KilledWorker
from distributed.system import MEMORY_LIMIT

from monitor.fleet.engine import Died, Ended, EngineError, Waiting

__all__ = ["Cluster", "alone", "local_cluster", "standing_cluster"]

Item = TypeVar("Item")
Result = TypeVar("Result")

LOOPBACK = "127.0.0.1"
AHEAD = 3
"""Tasks handed out for each worker at a time: enough that none waits, few to be called back."""
POLL_S = 0.5
CONNECT_S = 10.0
MEND_S = 5.0
"""How often a cluster of ours that lacks workers is told to start them anew [s]."""
WITHOUT_WORKERS_S = 120.0
"""How long a cluster may be without any worker: one that died is started again in seconds [s]."""
MEMORY_SHARE = 0.8
"""Of the computer's memory: what the workers of a local cluster may take together."""
WORKER_BYTES = 1 << 30
"""Memory that a worker with all kernels and a long log asks for."""

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

_CONFIGURATION = {
    # A worker that is not back after this is given up; it is then started by us.
    "distributed.deploy.lost-worker-timeout": "30s",
    "distributed.admin.large-graph-warning-threshold": "1 GiB",
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.nanny.pre-spawn-environ": _ONE_THREAD,
    # Results are small: a worker that is full is full of one log, and waiting would not help it.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
}


class Cluster:
    """Runs tasks on the workers of one Dask cluster.

    Parameters
    ----------
    client
        Connected.
    wanted
        Workers that there should be; 0 if they are not ours.
    mend
        Starts those that are missing.
    """

    def __init__(
        self,
        client: distributed.Client,
        wanted: int = 0,
        mend: Callable[[], object] = lambda: None,
    ) -> None:
        self._client, self._wanted, self._mend = client, wanted, mend
        self._mended_s = time.monotonic()
        self._looked_s, self._room = -math.inf, 1
        self._worked_s = time.monotonic()
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()

    @property
    def workers(self) -> int:
        """Tasks that run at once.

        Raises
        ------
        EngineError
            The scheduler is gone.
        """
        try:
            return sum(self._client.nthreads().values())
        except OSError as error:
            raise EngineError(f"the connection to the scheduler is lost: {_short(error)}") from None

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
        waiting: Waiting = lambda: None,
    ) -> Iterator[Ended[Item, Result]]:
        """As :meth:`monitor.fleet.engine.Engine.run` has it.

        A task whose workers die ends with :class:`monitor.fleet.engine.Died`.
        """
        suspects: list[Item] = []
        for ended in self._run(function, items, AHEAD, retries, waiting):
            if isinstance(ended.error, KilledWorker):
                suspects.append(ended.item)
            else:
                yield ended
        for item in suspects:
            for ended in self._run(function, [item], 1, retries, waiting):
                killed = isinstance(ended.error, KilledWorker)
                yield Ended(item, None, Died("every worker died of it")) if killed else ended

    def _run(
        self,
        function: Callable[[Item], Result],
        items: Iterable[Item],
        ahead: int,
        retries: int,
        waiting: Waiting,
    ) -> Iterator[Ended[Item, Result]]:
        left = iter(items)
        under_way: dict[Any, Item] = {}
        self._ended = queue.SimpleQueue()
        self._worked_s = time.monotonic()
        try:
            while True:
                for item in self._some(left, ahead, len(under_way)):
                    future = self._client.submit(function, item, pure=False, retries=retries)
                    under_way[future] = item
                    future.add_done_callback(self._ended.put)
                if not under_way:
                    return
                future = self._next(waiting)
                yield self._collected(future, under_way.pop(future), waiting)
        finally:
            if under_way and self._client.status == "running":
                self._client.cancel(list(under_way), force=True)

    def _some(self, items: Iterator[Item], ahead: int, under_way: int) -> Iterator[Item]:
        """The next items, as many as there is room for."""
        if time.monotonic() - self._looked_s > POLL_S:
            self._room = max(self._look(), 1)
        for _ in range(under_way, ahead * self._room):
            try:
                yield next(items)
            except StopIteration:
                return

    def _next(self, waiting: Waiting) -> Any:
        """The next future that is done."""
        while True:
            try:
                return self._ended.get(timeout=POLL_S)
            except queue.Empty:
                self._look()
                waiting()

    def _collected(self, future: Any, item: Item, waiting: Waiting) -> Ended[Item, Result]:
        """The end of a future that is done; if its worker died meanwhile, it is done again."""
        while True:
            try:
                return Ended(item, future.result(timeout=POLL_S), None)
            except (KeyboardInterrupt, SystemExit):
                raise
            except BaseException as error:
                self._look()
                if not isinstance(error, TimeoutError) or future.status == "error":
                    return Ended(item, None, error)
                waiting()

    def _look(self) -> int:
        """How many workers there are; those of ours that are missing are started.

        Raises
        ------
        EngineError
            The scheduler is gone, or all workers are, and none has come for a while.
        """
        if self._client.status != "running":
            raise EngineError("the connection to the scheduler is lost")
        workers, now_s = self.workers, time.monotonic()
        self._looked_s = now_s
        if workers < self._wanted and now_s - self._mended_s > MEND_S:
            self._mended_s = now_s
            self._mend()
        if workers:
            self._worked_s = now_s
        elif now_s - self._worked_s > WITHOUT_WORKERS_S:
            raise EngineError(f"no worker was left for {WITHOUT_WORKERS_S:.0f} s")
        return workers


@contextmanager
def alone(name: str) -> Iterator[None]:
    """In a task: no other task of the cluster is within the same name; elsewhere nothing."""
    try:
        distributed.get_worker()
    except ValueError:
        yield
        return
    with distributed.Lock(name):
        yield


@contextmanager
def local_cluster(workers: int | None, tasks: int | None = None) -> Iterator[Cluster]:
    """Processes of this computer, listening on the loopback only.

    Parameters
    ----------
    workers
        How many; None takes one for each core that memory is there for.
    tasks
        No more workers than tasks.
    """
    memory = int(MEMORY_SHARE * MEMORY_LIMIT)
    workers = workers or min(dask.system.CPU_COUNT, memory // WORKER_BYTES)
    workers = max(min(workers, tasks or workers), 1)
    with dask.config.set(_CONFIGURATION), ExitStack() as stack:
        with _interrupts_held():
            cluster = stack.enter_context(
                distributed.LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host=LOOPBACK,
                    dashboard_address=None,
                    # Even without a dashboard it serves its health, on a port another may have.
                    scheduler_kwargs={"dashboard_address": f"{LOOPBACK}:0"},
                    memory_limit=memory // workers,
                    silence_logs=logging.CRITICAL,
                )
            )
            client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
        yield Cluster(client, workers, lambda: cluster.scale(workers))


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C waits until the end, and is for this process alone.

    The threads that are started meanwhile, and the workers that these start at any time, inherit
    that it is held: a worker is ended by us, and says nothing.
    """
    resource_tracker.ensure_running()  # else the first start of a process would let it go
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def standing_cluster(scheduler: str) -> Iterator[Cluster]:
    """The workers of a scheduler that stands.

    Raises
    ------
    EngineError
        It does not answer, or has no worker.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        _check_address(scheduler)
        client = distributed.Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise EngineError(f"no scheduler answers at {scheduler}: {_short(error)}") from None
    with client:
        if not client.nthreads():
            raise EngineError(f"the scheduler at {scheduler} has no worker")
        yield Cluster(client)


def _check_address(scheduler: str) -> None:
    """Refuse at once what would only be noticed by a client that is half made.

    Raises
    ------
    ValueError
        It is no address with a port.
    """
    scheme, location = parse_address(scheduler)
    get_backend(scheme)
    parse_host_port(location)


def _short(error: BaseException) -> str:
    """The first line of what an exception says, or its name."""
    return (str(error).splitlines() or [""])[0] or type(error).__name__
