"""What the web process knows: the last minutes of frames as bytes, and all that stands now.

Frames stay the bytes that the daemon made; history is made by putting them together. Each is read
once, so that a viewer who comes late can be told what changed before it came.
"""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from math import ceil, inf
from typing import Any, Final

__all__ = ["FRAMES_AT_ONCE", "LISTED", "SELDOM", "Store"]

FRAMES_AT_ONCE: Final = 100
"""Frames of one ``history`` message."""

LISTED: Final = 100
"""Faults, and events, that are kept: the newest."""

STANDINGS: Final = 200
"""States of one sensor that are kept: the newest."""

SELDOM: Final = ("streams", "latency", "recorder", "process", "rejected", "channels")
"""Keys of a frame that stand until they are said anew."""

_NOW: Final = ("t_s", "flying", "link")


class Store:
    """Takes what the daemon sends; gives a new viewer its ``hello`` and ``history``.

    Parameters
    ----------
    frames
        Frames that are kept.

    Attributes
    ----------
    now
        ``hello`` without its lists: what stands, by the protocol's keys; empty before the daemon
        said anything.
    found
        Sensor -> faults found, those that are not kept any more included.
    """

    def __init__(self, frames: int) -> None:
        self.now: dict[str, Any] = {}
        self._ring: deque[tuple[float, bytes]] = deque(maxlen=frames)
        self._timeline: dict[str, deque[dict[str, Any]]] = {}
        self._faults: dict[int, dict[str, Any]] = {}
        self._events: dict[int, dict[str, Any]] = {}
        self.found: Counter[str] = Counter()

    @staticmethod
    def of(history_s: float, rate_hz: float) -> Store:
        """A store with room for this long at this rate."""
        return Store(ceil(history_s * rate_hz))

    def begin(self, data: bytes) -> None:
        """Take the daemon's ``hello``: all that stands, without a history."""
        said = json.loads(data)
        for sensor, standings in said.pop("timeline").items():
            self._add(sensor, standings)
        self._add_faults(said.pop("faults"))
        _keep(self._events, said.pop("events"))
        self.now = said

    def add(self, data: bytes) -> None:
        """Take a frame."""
        frame = json.loads(data)
        t_s = frame["t_s"]
        self._ring.append((-inf if t_s is None else t_s, data))
        self.now["number"] = frame["number"]
        for key in (*_NOW, *SELDOM):
            if key in frame:
                self.now[key] = frame[key]
        for sensor, standings in frame.get("changes", {}).items():
            self._add(sensor, standings)
        self._add_faults(frame.get("faults", ()))
        _keep(self._events, frame.get("events", ()))

    def states(self) -> Iterator[tuple[str, str]]:
        """Sensor and the state that stands."""
        for sensor, standings in self._timeline.items():
            yield sensor, standings[-1]["state"]

    def faults(self) -> list[dict[str, Any]]:
        """The newest faults, oldest first."""
        return list(self._faults.values())

    def hello(self) -> bytes:
        """The message that a viewer is greeted with."""
        oldest_s = self._ring[0][0] if self._ring else -inf
        for standings in self._timeline.values():
            while len(standings) > 1 and standings[1]["t_s"] <= oldest_s:
                standings.popleft()
        timeline = {sensor: list(standings) for sensor, standings in self._timeline.items()}
        events = list(self._events.values())
        said = self.now | {"timeline": timeline, "faults": self.faults(), "events": events}
        return json.dumps(said, separators=(",", ":"), allow_nan=False).encode()

    def history(self) -> Iterator[bytes]:
        """The frames kept now, as messages; frames that come meanwhile are not among them."""
        return _history([data for _, data in self._ring])

    def _add(self, sensor: str, standings: Iterable[dict[str, Any]]) -> None:
        kept = self._timeline.setdefault(sensor, deque(maxlen=STANDINGS))
        kept.extend(standings)

    def _add_faults(self, faults: Iterable[dict[str, Any]]) -> None:
        newest = max(self._faults, default=-1)
        self.found.update(fault["sensor"] for fault in faults if fault["number"] > newest)
        _keep(self._faults, faults)


def _history(frames: list[bytes]) -> Iterator[bytes]:
    for first in range(0, max(len(frames), 1), FRAMES_AT_ONCE):
        last = b"true" if first + FRAMES_AT_ONCE >= len(frames) else b"false"
        some = b",".join(frames[first : first + FRAMES_AT_ONCE])
        yield b'{"kind":"history","last":%b,"frames":[%b]}' % (last, some)


def _keep(listed: dict[int, dict[str, Any]], entries: Iterable[dict[str, Any]]) -> None:
    """Put entries in the place of those of the same number; the oldest beyond a bound go."""
    for entry in entries:
        listed[entry["number"]] = entry
    while len(listed) > LISTED:
        del listed[next(iter(listed))]
