"""The web process as the daemon sees it: started, fed without ever waiting, started again."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any, Final

from monitor.web.address import VARIABLE, Listening
from monitor.web.pipe import SETUP, Outgoing

__all__ = ["WebProcess"]

FIRST_WAIT_US: Final = 500_000
LONGEST_WAIT_US: Final = 60_000_000
"""It is started again after the first of these, then twice as long each time, up to the second."""

LASTING_US: Final = 60_000_000
"""One that lived this long is started again without delay, and its end is told."""

END_S: Final = 0.5
"""Time that it has to say goodbye to its viewers."""

HUNG_US: Final = 15_000_000
"""One that takes nothing for so long hangs; it is ended and started again."""


class WebProcess:
    """Keeps a web process running behind a listening socket.

    Parameters
    ----------
    listening
        The socket; stays open here, so that a page that is opened while the process starts anew
        waits instead of being refused.
    setup
        What it is told first: token, bounds.
    say
        Tells the user that it ended.
    command
        Starts it, two file descriptors are appended; tests give their own.

    Attributes
    ----------
    fresh
        It was started and has not been told yet what stands.
    """

    def __init__(
        self,
        listening: Listening,
        setup: Mapping[str, Any],
        say: Callable[[str], None],
        command: tuple[str, ...] = (sys.executable, "-m", "monitor.web.server"),
    ) -> None:
        self._listening = listening
        self._setup = json.dumps(setup).encode()
        self._say = say
        self._command = command
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Outgoing | None = None
        self._started_us = 0
        self._took_us = 0
        self._again_us = 0
        self._wait_us = FIRST_WAIT_US
        self._told = False
        self.fresh = False

    @property
    def pid(self) -> int | None:
        """Process id; None while there is none."""
        return None if self._process is None else self._process.pid

    def ready(self, now_us: int) -> bool:
        """Whether a message would be accepted now; starts the process where it is missing.

        Parameters
        ----------
        now_us
            Host monotonic time [us].
        """
        if self._process is None:
            return now_us >= self._again_us and self._start(now_us)
        if self._process.poll() is not None:
            self._lost(now_us)
            return False
        try:
            taken = self._pipe is not None and self._pipe.ready()
        except OSError:  # it is ending; its status comes with the next call
            return False
        if taken:
            self._took_us = now_us
        elif now_us - self._took_us > HUNG_US:
            self._process.kill()
        return taken

    def send(self, kind: bytes, body: bytes) -> None:
        """Hand over a message; only when :meth:`ready`."""
        if self._pipe is not None:
            try:
                self._pipe.send(kind, body)
            except OSError:  # as above
                return

    def close(self) -> None:
        """End it, and give the port back."""
        if self._pipe is not None:
            self._pipe.close()
        if self._process is not None:
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._listening.socket.close()

    def _start(self, now_us: int) -> bool:
        ours, theirs = socket.socketpair()
        descriptors = (self._listening.socket.fileno(), theirs.fileno())
        environment = {key: value for key, value in os.environ.items() if key != VARIABLE}
        try:
            self._process = subprocess.Popen(
                [*self._command, *map(str, descriptors)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=environment,
                pass_fds=descriptors,
                start_new_session=True,  # a Ctrl-C is the daemon's to hear
            )
        except OSError as error:
            ours.close()
            self._tell(f"the live page cannot be served: {error.strerror}", now_us)
            return False
        finally:
            theirs.close()
        self._started_us = self._took_us = now_us
        self._pipe = Outgoing(ours)
        self.fresh = True
        self.send(SETUP, self._setup)
        return self._pipe.ready()

    def _lost(self, now_us: int) -> None:
        """It has ended by itself."""
        assert self._process is not None
        assert self._pipe is not None
        status = self._process.returncode
        self._process = None
        self._pipe.close()
        self._pipe = None
        if now_us - self._started_us > LASTING_US:
            self._wait_us, self._told = FIRST_WAIT_US, False
        how = f"by signal {-status}" if status < 0 else f"with status {status}"
        self._tell(f"the live page's process ended {how}; it is started again", now_us)

    def _tell(self, said: str, now_us: int) -> None:
        """Say it, once of a series, and let the next try wait."""
        if not self._told:
            self._say(said)
        self._told = True
        self._again_us = now_us + self._wait_us
        self._wait_us = min(2 * self._wait_us, LONGEST_WAIT_US)
