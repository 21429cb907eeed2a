"""What happened, for both who watch: people at a terminal and programs that read a log."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from monitor.commands.common import note
from monitor.service import Event, EventLog

__all__ = ["Telling"]


class Telling:
    """Says an event as a sentence on standard error, and logs it with its facts.

    Where the log itself goes to standard error, or to the journal that standard error ends up in
    too, the sentence is not said a second time.

    Parameters
    ----------
    log
        The log for programs.
    to
        Where it goes, as the settings say it.
    say
        Says a sentence to people.
    """

    def __init__(self, log: EventLog, to: str = "", say: Callable[[str], None] = note) -> None:
        self.log = log
        self._say = say
        self._aloud = to != "-" and not (to == "journal" and not sys.stderr.isatty())

    def __call__(
        self,
        event: Event,
        sentence: str,
        grave: str = "info",
        said: str | None = None,
        **facts: Any,
    ) -> None:
        """Tell both.

        Parameters
        ----------
        event, sentence, grave
            As of :meth:`monitor.service.EventLog.log`.
        said
            The sentence for people, where it is another one.
        facts
            For the log.
        """
        self.log.log(event, sentence, grave, **facts)
        if self._aloud:
            self._say(f"mavsentry: {sentence}" if said is None else said)
