"""What is asked of the running daemon by signals.

=================  ==============================================================================
SIGINT, SIGTERM    stop; a second one ends the program at once
SIGHUP             read the configuration anew; where the terminal has gone away: stop
SIGUSR1            tell how the loop is doing
=================  ==============================================================================
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import Final

__all__ = ["Signals"]

STOP: Final = (signal.SIGINT, signal.SIGTERM)
_HUP: Final = getattr(signal, "SIGHUP", None)
_USR1: Final = getattr(signal, "SIGUSR1", None)


class Signals:
    """Takes signals from its making on; until :meth:`listen` a request to stop ends the program.

    Loading and compiling keep nothing that a sudden end would harm.
    """

    def __init__(self) -> None:
        self._asked: set[int] = set()
        self._terminals = [fd for fd in (1, 2) if _is_terminal(fd)]
        for number in STOP:
            signal.signal(number, _leave)
        if _HUP is not None:
            signal.signal(_HUP, _leave if self._terminals else signal.SIG_IGN)
        if _USR1 is not None:
            signal.signal(_USR1, signal.SIG_IGN)

    def listen(self) -> None:
        """The loop turns, and looks here after each turn."""
        for number in (*STOP, _HUP, _USR1):
            if number is not None:
                signal.signal(number, self._take)

    @property
    def stop(self) -> bool:
        """Whether to stop."""
        return not self._asked.isdisjoint(STOP)

    def take_reload(self) -> bool:
        """Whether the configuration is to be read anew, once for each request."""
        return self._once(_HUP)

    def take_status(self) -> bool:
        """Whether to tell how the loop is doing, once for each request."""
        return self._once(_USR1)

    def _once(self, number: int | None) -> bool:
        asked = number in self._asked
        self._asked.discard(number or 0)
        return asked

    def _take(self, number: int, _: FrameType | None) -> None:
        if number in STOP:
            for each in STOP:  # whoever asks again does not want to wait
                signal.signal(each, signal.SIG_DFL)
        if number == _HUP and self._hung_up():
            number = signal.SIGTERM
        self._asked.add(number)

    def _hung_up(self) -> bool:
        """Whether the terminal that we were started on is gone; what is said goes nowhere then."""
        if not self._terminals or any(_is_terminal(fd) for fd in self._terminals):
            return False
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for fd in self._terminals:
            os.dup2(nowhere, fd)
        os.close(nowhere)
        return True


def _is_terminal(fd: int) -> bool:
    try:
        return os.isatty(fd)
    except OSError:
        return False


def _leave(*_: object) -> None:
    sys.exit(0)
