"""How often each stream really arrives, by the vehicle's own clock, in windows free of gaps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

__all__ = ["Counted", "Rates"]

WINDOW_US = 3_000_000
"""Vehicle time that a rate is measured over."""

SPOILT_US = 500_000
"""Host time without anything new that spoils a window: the link paused, not a stream."""

STILL_US, BEATS_US = 5_000_000, 2_500_000
"""So long nothing but heartbeats, no two of them further apart: then no stream is sent."""

LOOK_US = 200_000
"""Host time between two looks."""


class Counted(Protocol):
    """What is read of ``monitor.streams.Stream``."""

    @property
    def samples(self) -> int:
        """Rows used so far."""
        ...

    @property
    def blank(self) -> bool:
        """Whether no row has said anything so far: an instance that is not fitted."""
        ...

    @property
    def last_us(self) -> int:
        """Vehicle time of the newest row [us]."""
        ...


class Rates:
    """Measures streams window by window.

    Parameters
    ----------
    streams
        Stream -> its account, as the pipeline keeps it.

    Attributes
    ----------
    hz
        Stream -> rate in the last whole window [1/s]; a stream that is not in it did not come.
    """

    def __init__(self, streams: Callable[[], Mapping[str, Counted]]) -> None:
        self._streams = streams
        self.hz: dict[str, float] = {}
        self._from_us: int | None = None
        self._counts: dict[str, int] = {}
        self._newest_us = 0
        self._moved_us = self._alive_us = self._looked_us = 0
        self._heard_us: int | None = None

    def restart(self) -> None:
        """Begin a new window at the next look."""
        self._from_us = None

    def look(self, now_us: int, heard_us: int | None) -> bool:
        """Whether a window has just ended; ``hz`` is of it then.

        ``heard_us`` is when the autopilot's HEARTBEAT came last: while it comes and nothing else
        does, all rates are 0.
        """
        if heard_us is not None and heard_us != self._heard_us:
            if self._heard_us is None or heard_us - self._heard_us > BEATS_US:
                self._alive_us = heard_us
            self._heard_us = heard_us
        if now_us - self._looked_us < LOOK_US:
            return False
        self._looked_us = now_us
        streams = self._streams()
        newest_us = max((s.last_us for s in streams.values()), default=0)
        if newest_us > self._newest_us:
            self._newest_us, self._moved_us = newest_us, now_us
        elif now_us - self._moved_us > SPOILT_US:
            self._from_us = None
            return self._still(now_us)
        if self._from_us is None:
            self._from_us = newest_us
            self._counts = {name: s.samples for name, s in streams.items()}
            return False
        span_us = newest_us - self._from_us
        if span_us < WINDOW_US:
            return False
        self.hz = {
            name: (s.samples - self._counts.get(name, 0)) * 1e6 / span_us
            for name, s in streams.items()
            if s.samples > self._counts.get(name, 0) and not s.blank
        }
        self._from_us = newest_us
        self._counts = {name: s.samples for name, s in streams.items()}
        return True

    def _still(self, now_us: int) -> bool:
        """Whether heartbeats have come, and they alone, for as long as it takes to be sure."""
        if self._heard_us is None or now_us - self._heard_us > BEATS_US:
            return False
        if now_us - max(self._moved_us, self._alive_us) < STILL_US:
            return False
        self._alive_us = now_us  # the next window of stillness begins
        self.hz = {}
        return True
