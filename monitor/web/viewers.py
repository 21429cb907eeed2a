"""Who watches: a bounded queue for each, so that a slow one costs nobody else anything."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Iterable

__all__ = ["Viewer", "Viewers"]


class Viewer:
    """Sends one viewer its messages, as fast as it takes them.

    Parameters
    ----------
    send
        Sends a message and returns when the network has taken it.
    behind
        Messages that wait at most; then the oldest goes.

    Attributes
    ----------
    dropped
        Messages that went unsent.
    """

    def __init__(self, send: Callable[[bytes], Awaitable[None]], behind: int) -> None:
        self._send = send
        self._waiting: deque[bytes] = deque(maxlen=behind)
        self._come = asyncio.Event()
        self.dropped = 0

    def offer(self, message: bytes) -> bool:
        """Queue a message; False if an older one had to go for it."""
        full = len(self._waiting) == self._waiting.maxlen
        self.dropped += full
        self._waiting.append(message)
        self._come.set()
        return not full

    async def run(self, first: Iterable[bytes]) -> None:
        """Send these, then what is offered, until cancelled or ``send`` raises."""
        for message in first:
            await self._send(message)
        while True:
            await self._come.wait()
            self._come.clear()
            while self._waiting:
                await self._send(self._waiting.popleft())


class Viewers:
    """All that watch now.

    Parameters
    ----------
    limit
        How many may.
    behind
        Of each :class:`Viewer`.

    Attributes
    ----------
    dropped, refused
        Messages that went unsent and viewers that there was no room for, since the start.
    """

    def __init__(self, limit: int, behind: int) -> None:
        self.limit = limit
        self._behind = behind
        self._open: set[Viewer] = set()
        self.dropped = 0
        self.refused = 0

    def __len__(self) -> int:
        return len(self._open)

    def join(self, send: Callable[[bytes], Awaitable[None]]) -> Viewer | None:
        """A new viewer; None when there is no room for it."""
        if len(self._open) >= self.limit:
            self.refused += 1
            return None
        viewer = Viewer(send, self._behind)
        self._open.add(viewer)
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """The viewer is gone."""
        self._open.discard(viewer)

    def tell(self, message: bytes) -> None:
        """Queue one message, the same bytes, for all."""
        for viewer in self._open:
            self.dropped += not viewer.offer(message)
