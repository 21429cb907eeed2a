"""What all endpoints share: counters, the error, the protocol, and small helpers."""

from __future__ import annotations

import errno
import select
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self

__all__ = [
    "MAX_PER_RECV",
    "RETRY_S",
    "STREAM_CHUNK",
    "Endpoint",
    "Link",
    "LinkCounters",
    "LinkError",
    "Received",
    "now_us",
    "plain",
    "readable",
    "resolve",
]

MAX_PER_RECV = 4096
"""Datagrams (or chunks) that one ``recv`` returns at most."""

STREAM_CHUNK = 1 << 16
"""Bytes read at a time from a stream or file."""

RETRY_S = 1.0
"""Time between attempts to connect or to reopen a port [s]."""

Received = list[tuple[bytes, int]]


class LinkError(ValueError):
    """A link that cannot be opened; the message is one plain sentence."""


@dataclass(slots=True)
class LinkCounters:
    """What went over a link: bytes and datagrams (chunks, frames) each way.

    ``dropped`` counts what could not be sent (no peer yet, no room, peer gone), ``opened`` the
    connections made, the first included.
    """

    received_bytes: int = 0
    received: int = 0
    sent_bytes: int = 0
    sent: int = 0
    dropped: int = 0
    opened: int = 0


class Endpoint(Protocol):
    """An open link."""

    name: str
    counters: LinkCounters

    @property
    def ended(self) -> bool:
        """Whether nothing more will ever come (the end of a file)."""
        ...

    def recv(self, timeout_s: float) -> Received:
        """What has arrived, waiting at most ``timeout_s`` for the first.

        Pairs of bytes and the host's monotonic time [us]; empty when nothing came.
        """
        ...

    def send(self, data: bytes) -> None:
        """Send one datagram, or count why not; never blocks."""
        ...

    def close(self) -> None:
        """Give the port, socket or file back."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def now_us() -> int:
    return time.monotonic_ns() // 1000


class Link(ABC):
    """The part that all endpoints share: name, counters, context manager."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.counters = LinkCounters()

    @property
    def ended(self) -> bool:
        return False

    @abstractmethod
    def close(self) -> None:
        """Give the port, socket or file back."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _received(self, data: bytes) -> None:
        self.counters.received_bytes += len(data)
        self.counters.received += 1

    def _sent(self, size: int) -> None:
        self.counters.sent_bytes += size
        self.counters.sent += 1


def resolve(name: str, host: str, port: int, kind: int) -> tuple[int, Any]:
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except (OSError, UnicodeError):
        raise LinkError(f"{name}: there is no host called {host}") from None
    family, _, _, _, address = found[0]
    return family, address


def readable(sock: socket.socket) -> Callable[[float], bool]:
    """Function of a time [s]: whether there is something to receive within it."""
    if not hasattr(select, "poll"):  # Windows
        return lambda timeout_s: bool(select.select([sock], [], [], timeout_s)[0])
    poll = select.poll()
    poll.register(sock, select.POLLIN)
    return lambda timeout_s: bool(poll.poll(timeout_s * 1e3))


def plain(name: str, error: Exception) -> LinkError:
    """The reason of a failure to open as one sentence."""
    number = getattr(error, "errno", None)
    reason = {
        errno.EADDRINUSE: "the port is already in use",
        errno.EADDRNOTAVAIL: "this computer has no such address",
        errno.EACCES: "permission denied",
        errno.ENOENT: "there is no such device or file",
        errno.EISDIR: "it is a directory",
        errno.EBUSY: "the device is in use",
    }.get(number or 0)
    return LinkError(f"cannot open {name}: {reason or getattr(error, 'strerror', None) or error}")
