"""Many tasks, each a log: in this process, on this computer's cores, or on a cluster that stands.

::

    with open_engine(workers=4) as engine:
        for ended in engine.run(judge, logs, retries=1):
            use(ended.item, ended.result, ended.error)

The function and its items must pickle. What a task raises belongs to that task alone; results come
in whatever order the tasks end in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

__all__ = ["Died", "Ended", "Engine", "EngineError", "Here", "Waiting", "open_engine"]

Item = TypeVar("Item")
Result = TypeVar("Result")
Waiting = Callable[[], None]


class EngineError(Exception):
    """The workers cannot be had, in one plain sentence."""


class Died(Exception):
    """Every worker that took the task died of it."""


@dataclass(frozen=True, slots=True)
class Ended(Generic[Item, Result]):
    """A task that has come to its end: with its result, or with what it raised."""

    item: Item
    result: Result | None
    error: BaseException | None


class Engine(Protocol):
    """Runs tasks."""

    @property
    def workers(self) -> int:
        """Tasks that run at once."""

    def everywhere(self, function: Callable[..., Result], *arguments: object) -> dict[str, Result]:
        """Call ``function`` once on every worker; worker's name -> result."""

    def run(
        self,
        function: Callable[[Item], Result],
        items: Iterable[Item],
        *,
        retries: int = 0,
        waiting: Waiting = lambda: None,
    ) -> Iterator[Ended[Item, Result]]:
        """Call ``function`` on each item, in any order; yield each as it ends.

        Parameters
        ----------
        function
            Of one item; a function of a module.
        items
            Taken from only as there is room for them: a hundred thousand cost no memory.
        retries
            How often a task that raised is tried again.
        waiting
            Called now and then while nothing ends.

        Raises
        ------
        EngineError
            The workers are gone.
        """


class Here:
    """One task after the other in this process: no start of others, no protection from a crash."""

    @property
    def workers(self) -> int:
        """Tasks that run at once."""
        return 1

    def everywhere(self, function: Callable[..., Result], *arguments: object) -> dict[str, Result]:
        """Call ``function`` here."""
        return {"this process": function(*arguments)}

    def run(
        self,
        function: Callable[[Item], Result],
        items: Iterable[Item],
        *,
        retries: int = 0,
        waiting: Waiting = lambda: None,
    ) -> Iterator[Ended[Item, Result]]:
        """As :meth:`Engine.run` has it, in the order of the items."""
        for item in items:
            waiting()
            yield _tried(function, item, retries)


def _tried(function: Callable[[Item], Result], item: Item, retries: int) -> Ended[Item, Result]:
    try:
        return Ended(item, function(item), None)
    except Exception as error:
        return _tried(function, item, retries - 1) if retries > 0 else Ended(item, None, error)


@contextmanager
def open_engine(
    workers: int | None = None, scheduler: str | None = None, *, tasks: int | None = None
) -> Iterator[Engine]:
    """Workers to run tasks on, let go afterwards.

    Parameters
    ----------
    workers
        Processes on this computer, each with one numeric thread; None takes one for each core that
        memory is there for; 0 is this process itself, and needs no Dask.
    scheduler
        Address of a Dask scheduler that stands, such as ``tcp://host:8786``; its workers are used.
    tasks
        How many there will be, if that is known: no more processes than that are started.

    Raises
    ------
    EngineError
        The extra `fleet` is not installed, or the scheduler does not answer or has no worker.
    """
    if workers == 0 and scheduler is None:
        yield Here()
        return
    try:
        from monitor.fleet.cluster import local_cluster, standing_cluster
    except ModuleNotFoundError as error:
        raise EngineError(f"this needs Dask ({error}): pip install 'mavsentry[fleet]'") from None
    local = scheduler is None
    with local_cluster(workers, tasks) if local else standing_cluster(str(scheduler)) as engine:
        yield engine
