"""Work on many files in several processes, with the results in the order of the files.

Each process serves one item after another over a pipe. One that dies (killed, out of memory) costs
the item that it had and nothing else: another takes its place.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Final

__all__ = ["Died", "Tell", "work"]

Tell = Callable[[int], None]
"""Takes how much of an item is done, in the caller's unit."""

TELL_EVERY_S: Final = 0.1
STOP_S: Final = 2.0
"""Time that a process has to leave nothing unfinished behind."""
TERMINATED: Final = 143


@dataclass(frozen=True, slots=True)
class Died:
    """The process that worked on an item ended without an answer.

    Attributes
    ----------
    signal
        The signal that killed it, None if it left by itself.
    """

    signal: int | None


def work(
    function: Callable[[Any, Tell], Any],
    items: Sequence[Any],
    jobs: int,
    tell: Callable[[Sequence[int]], None],
) -> Iterator[Any]:
    """Results of a function on every item, in the items' order.

    Parameters
    ----------
    function
        Called with (item, tell); one that pickles, and lets nothing escape that should not end all
        the work.
    items
        What pickles.
    jobs
        Processes; 1 works in this one.
    tell
        Called now and then with how much of each item is done.

    Yields
    ------
    The function's result, or :class:`Died`.
    """
    done = [0] * len(items)
    if jobs <= 1:
        for k, item in enumerate(items):

            def own(count: int, k: int = k) -> None:
                done[k] = count
                tell(done)

            yield function(item, own)
        return
    waiting = deque(enumerate(items))
    results: dict[int, Any] = {}
    workers = [_Worker(function) for _ in range(min(jobs, len(items)))]
    try:
        for k in range(len(items)):
            while k not in results:
                for worker in workers:
                    if worker.item is None and waiting:
                        worker.begin(*waiting.popleft())
                busy = {w.connection: w for w in workers if w.item is not None}
                for connection in wait(list(busy)):
                    worker = busy[connection]  # type: ignore[index]
                    _listen(worker, done, results)
                    if worker.dead and waiting:
                        workers[workers.index(worker)] = _Worker(function)
                tell(done)
                workers = [w for w in workers if not w.dead]
            yield results.pop(k)
    finally:
        for worker in workers:
            worker.stop()


class _Worker:
    """One process and what it is at."""

    def __init__(self, function: Callable[[Any, Tell], Any]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(
            target=_serve, args=(theirs, function), daemon=True
        )
        self.process.start()
        theirs.close()
        self.item: int | None = None
        self.dead = False

    def begin(self, number: int, item: Any) -> None:
        """Hand it an item; that it is dead shows when it is listened to."""
        self.item = number
        with contextlib.suppress(OSError):
            self.connection.send(item)

    def stop(self) -> None:
        self.connection.close()
        self.process.terminate()
        self.process.join(STOP_S)
        self.process.kill()


def _listen(worker: _Worker, done: list[int], results: dict[int, Any]) -> None:
    """Take what a worker says: how far it is, its result, or nothing any more."""
    assert worker.item is not None
    try:
        finished, said = worker.connection.recv()
    except (EOFError, OSError):
        worker.dead = True
        worker.process.join(STOP_S)
        code = worker.process.exitcode
        results[worker.item] = Died(-code if code is not None and code < 0 else None)
        worker.connection.close()
        return
    if finished:
        results[worker.item] = said
        worker.item = None
    else:
        done[worker.item] = said


def _serve(connection: Connection, function: Callable[[Any, Tell], Any]) -> None:
    """Life of a worker: Ctrl-C is for the process that waits for it, which then terminates it.

    A callback of the compiler's would swallow the end, and say so; it then comes with the next word
    of how far the worker is.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    told_s, newest, ending = 0.0, 0, False

    def end(*_: object) -> None:
        nonlocal ending
        ending = True
        sys.unraisablehook = lambda _: None
        sys.exit(TERMINATED)

    signal.signal(signal.SIGTERM, end)

    def tell(count: int) -> None:
        nonlocal told_s, newest
        if ending:
            sys.exit(TERMINATED)
        newest = count
        now_s = time.monotonic()
        if now_s - told_s > TELL_EVERY_S:
            told_s = now_s
            connection.send((False, count))

    while True:
        try:
            item = connection.recv()
        except EOFError:
            return
        newest = 0
        result = function(item, tell)
        connection.send((False, newest))
        connection.send((True, result))
