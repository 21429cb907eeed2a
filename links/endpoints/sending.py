"""What waits to leave over a stream: bounded, oldest dropped first, never half a message."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from links.endpoints.base import LinkCounters

__all__ = ["SendQueue"]


class SendQueue:
    """Whole messages on their way into a stream that may be slow.

    A message of which a part has left is never dropped: the rest of it would be garbage for whoever
    reads the stream.

    Parameters
    ----------
    most_bytes
        What may wait; more drops the oldest.
    counters
        Of the link: what left and what was dropped is counted there.
    """

    def __init__(self, most_bytes: int, counters: LinkCounters) -> None:
        self._counters = counters
        self._most_bytes = most_bytes
        self._waiting: deque[bytes] = deque()
        self._bytes = 0
        self._begun: memoryview | None = None

    def __len__(self) -> int:
        return len(self._waiting) + (self._begun is not None)

    def add(self, data: bytes) -> None:
        """Take a message, dropping the oldest that wait if there is no room."""
        self._waiting.append(data)
        self._bytes += len(data)
        while self._bytes > self._most_bytes and len(self._waiting) > 1:
            self._bytes -= len(self._waiting.popleft())
            self._counters.dropped += 1

    def flush(self, write: Callable[[bytes | memoryview], int | None]) -> None:
        """Hand on what there is room for.

        Parameters
        ----------
        write
            Takes bytes, returns how many of them left; 0 or None when there is no room now.
        """
        while self._begun is not None or self._waiting:
            head = self._begun if self._begun is not None else memoryview(self._waiting[0])
            try:
                left = write(head)
            except BlockingIOError:
                return
            if not left:
                return
            if self._begun is None:
                self._bytes -= len(self._waiting.popleft())
            self._begun = head[left:] if left < len(head) else None
            self._counters.sent_bytes += left
            self._counters.sent += self._begun is None

    def clear(self) -> None:
        """Drop everything: the stream is gone."""
        self._counters.dropped += len(self)
        self._waiting.clear()
        self._bytes = 0
        self._begun = None
