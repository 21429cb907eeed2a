"""Faults and events as they come, the newest of them: the rule of ``summary.json``, live."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from links.vocabulary import State
from monitor.verdict import Verdict

__all__ = ["LISTED", "Found"]

LISTED: Final = 100
"""How many are kept: the newest."""

Wired = TypeVar("Wired")


@dataclass(slots=True)
class _Entry:
    """What began with a verdict, and when an ``ok`` ended it [us]."""

    number: int
    verdict: Verdict
    ended_us: int | None = None


class Found(Generic[Wired]):
    """Opens an entry where a sensor enters a state; only an ``ok`` closes it.

    A sensor that goes stale or cannot be judged meanwhile stays as it was.

    Parameters
    ----------
    state
        Faulty for faults, stopped for events.
    wired
        Number, verdict and end -> the entry as the protocol has it.
    """

    def __init__(self, state: State, wired: Callable[[int, Verdict, int | None], Wired]) -> None:
        self._state, self._wired = state, wired
        self._count = 0
        self._entries: dict[int, _Entry] = {}
        self._open: dict[str, _Entry] = {}
        self._changed: dict[int, _Entry] = {}

    def add(self, verdict: Verdict) -> None:
        """Use a verdict; they come in time order."""
        if verdict.state is self._state and verdict.sensor not in self._open:
            entry = _Entry(self._count, verdict)
            self._count += 1
            self._open[verdict.sensor] = self._entries[entry.number] = entry
            if len(self._entries) > LISTED:
                del self._entries[next(iter(self._entries))]
        elif verdict.state is State.OK and verdict.sensor in self._open:
            entry = self._open.pop(verdict.sensor)
            entry.ended_us = verdict.t_us
        else:
            return
        self._changed.pop(entry.number, None)
        self._changed[entry.number] = entry
        if len(self._changed) > LISTED:
            del self._changed[next(iter(self._changed))]

    def news(self) -> list[Wired]:
        """Entries that are new or have ended since the last call."""
        news = self._wire(self._changed.values())
        self._changed.clear()
        return news

    def all(self) -> list[Wired]:
        """The newest entries, oldest first."""
        return self._wire(self._entries.values())

    def _wire(self, entries: Iterable[_Entry]) -> list[Wired]:
        return [self._wired(e.number, e.verdict, e.ended_us) for e in entries]
