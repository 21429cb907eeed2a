"""Opening what may take long or fail: in a thread, again and again, with growing waits.

Opening a serial port, asking a name server and connecting can all hang for seconds, and closing a
serial port waits for what still has to leave. None of it may hold the working loop up.
"""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from links.endpoints.base import LinkError, LinkOptions, now_us

__all__ = ["Opener", "aside"]

T = TypeVar("T")

JITTER = 0.25
"""A wait is longer or shorter by up to this share, so that many do not knock in step."""


def aside(work: Callable[[], object], name: str) -> None:
    """Do something in a thread that does not keep the program from ending."""
    threading.Thread(target=work, name=name, daemon=True).start()


class Opener(Generic[T]):
    """Makes something in a thread until it stands, and anew when it was lost.

    At most one attempt runs at a time: one that hangs holds back the next and nothing else.

    Parameters
    ----------
    name
        Of the link, for the thread.
    make
        Opens it; raises :class:`LinkError`. Called in a thread of its own.
    discard
        Gives back what was made too late, after :meth:`close`.
    options
        First and longest wait.

    Attributes
    ----------
    trouble
        Why the last attempt failed or what stood was lost, one sentence; empty while it stands.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[], T],
        discard: Callable[[T], object],
        options: LinkOptions,
    ) -> None:
        self.trouble = ""
        self._name = name
        self._make = make
        self._discard = discard
        self._options = options
        self._lock = threading.Lock()
        self._running = self._closed = False
        self._done: T | LinkError | None = None
        self._failures = 0
        self._due_us: int | None = None
        self._wait_s = 0.0

    @property
    def backoff_s(self) -> float:
        """Wait before the attempt that runs or comes next [s]; 0 when none is due."""
        return 0.0 if self.idle else self._wait_s

    @property
    def idle(self) -> bool:
        """Whether no attempt runs or is due."""
        return self._due_us is None and not self._running

    def first(self) -> T | None:
        """Make it here and now; None if it could not be made and is tried again.

        Raises
        ------
        LinkError
            It could not be made, and who opens is not patient or it will not mend by itself.
        """
        try:
            return self._make()
        except LinkError as error:
            if not (self._options.patient and error.may_mend):
                raise
            self._failed(error, now_us())
            return None

    def begin(self, now_us: int) -> None:
        """Make it in a thread as soon as :meth:`poll` is called."""
        self._due_us = now_us

    def poll(self, now_us: int) -> T | None:
        """What was made since the last call; starts an attempt when one is due."""
        if self._running:
            with self._lock:
                done, self._done = self._done, None
                self._running = done is None
            if isinstance(done, LinkError):
                self._failed(done, now_us)
            elif done is not None:
                self.trouble = ""
                return done
        elif self._due_us is not None and now_us >= self._due_us:
            self._due_us = None
            self._running = True
            aside(self._attempt, f"open {self._name}")
        return None

    def lost(self, trouble: str, now_us: int) -> None:
        """What stood stands no more: make it anew after the wait that is due."""
        self._failed(LinkError(trouble), now_us)

    def proven(self) -> None:
        """What stands works (something was heard): the next failure is a first one."""
        self._failures = 0
        if self.idle:
            self.trouble = ""

    def close(self) -> None:
        """Make nothing any more; what an attempt still makes is given back."""
        with self._lock:
            self._closed = True
            done, self._done = self._done, None
        self._due_us = None
        if done is not None and not isinstance(done, LinkError):
            self._discard(done)

    def _failed(self, error: LinkError, now_us: int) -> None:
        self.trouble = str(error)
        longest = self._options.retry_longest_s
        wait_s = min(self._options.retry_first_s * 2.0 ** min(self._failures, 16), longest)
        self._failures += 1
        self._wait_s = wait_s * random.uniform(1.0 - JITTER, 1.0 + JITTER)
        self._due_us = now_us + round(self._wait_s * 1e6)

    def _attempt(self) -> None:
        done: T | LinkError
        try:
            done = self._make()
        except LinkError as error:
            done = error
        except Exception as error:  # of a library: told, tried again, never the end of the link
            done = LinkError(f"cannot open {self._name}: {error}")
        with self._lock:
            if not self._closed:
                self._done = done
                return
        if not isinstance(done, LinkError):
            self._discard(done)
