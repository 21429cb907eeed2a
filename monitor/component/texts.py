"""STATUSTEXT of the services: paced, and the same text again folded into one with its count.

Verdicts are announced by ``monitor.announce`` at a rate of their own; these are the texts that
others can provoke, so that nobody can make us flood a ground station.
"""

from __future__ import annotations

from collections import OrderedDict

from monitor.announce import TEXT_MAX
from monitor.component.limit import Limit
from monitor.publish import Message

__all__ = ["Texts"]

PER_S, BURST = 0.2, 3
"""Texts a second for good, and at once after a quiet time."""

FOLD_US = 20_000_000
"""A text that was just said is held back for this long and then said with its count."""

KEPT = 16
"""Different texts that wait or are remembered; of more the oldest is dropped and counted."""

_Key = tuple[int, str, int | None]


class Texts:
    """Lets texts out at a bounded rate.

    Attributes
    ----------
    dropped
        Texts that were never said.
    """

    def __init__(self) -> None:
        self._limit = Limit(PER_S, BURST)
        self._waiting: OrderedDict[_Key, int] = OrderedDict()
        self._said_us: OrderedDict[_Key, int] = OrderedDict()
        self.dropped = 0

    def put(self, message: Message) -> None:
        """Take a STATUSTEXT to be said."""
        text = str(message.fields["text"])[:TEXT_MAX]
        key = int(message.fields["severity"]), text, message.link
        self._waiting[key] = self._waiting.get(key, 0) + 1
        if len(self._waiting) > KEPT:
            self.dropped += self._waiting.popitem(last=False)[1]

    def due(self, now_us: int) -> list[Message]:
        """Texts that may go out now, in the order in which they came."""
        out = []
        for key in list(self._waiting):
            said_us = self._said_us.get(key)
            if said_us is not None and now_us - said_us < FOLD_US:
                continue
            if not self._limit.allows(now_us):
                break
            out.append(self._say(key, now_us))
        return out

    def _say(self, key: _Key, now_us: int) -> Message:
        severity, text, link = key
        count = self._waiting.pop(key)
        self._said_us[key] = now_us
        self._said_us.move_to_end(key)
        if len(self._said_us) > KEPT:
            self._said_us.popitem(last=False)
        times = f" (x{count})" if count > 1 else ""
        fields = {"severity": severity, "text": text[: TEXT_MAX - len(times)] + times}
        return Message("STATUSTEXT", fields, link)
