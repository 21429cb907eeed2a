"""What happened, for both who watch: people at a terminal and programs that read a log."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from monitor.commands.common import note
from monitor.retune import Retuned, blend
from monitor.service import Event, EventLog
from monitor.settings import Settings
from monitor.settings.log import LogSettings

__all__ = ["Telling"]


class Telling:
    """Says an event as a sentence on standard error, and logs it with its facts.

    Where the log itself goes to standard error, or to the journal that standard error ends up in
    too, the sentence is not said a second time.

    Parameters
    ----------
    log
        The log for programs.
    settings
        Where it goes, and from what level on.
    say
        Says a sentence to people.
    """

    def __init__(
        self, log: EventLog, settings: LogSettings, say: Callable[[str], None] = note
    ) -> None:
        self.log = log
        self._settings = settings
        self._say = say
        to = settings.to
        self._aloud = to != "-" and not (to == "journal" and not sys.stderr.isatty())

    def retune(self, settings: Settings) -> Retuned:
        """Take another level; another place waits for a restart."""
        self._settings, retuned = blend(self._settings, settings.log, {"to"})
        self.log.level = self._settings.level
        return retuned.under("log")

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
