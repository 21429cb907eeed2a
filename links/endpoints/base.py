"""What all endpoints share: counters, options, the error, the protocol, and small helpers."""

from __future__ import annotations

import errno
import select
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NamedTuple, Protocol, Self

__all__ = [
    "LOOK_S",
    "MAX_PER_RECV",
    "STREAM_CHUNK",
    "TEND_S",
    "Endpoint",
    "Link",
    "LinkCounters",
    "LinkError",
    "LinkOptions",
    "Received",
    "Taken",
    "Waiter",
    "now_us",
    "plain",
    "resolve",
    "unknown",
]

MAX_PER_RECV = 4096
"""Datagrams (or chunks) that one ``recv`` or ``take`` reads at most."""

STREAM_CHUNK = 1 << 16
"""Bytes read at a time from a stream or file."""

LOOK_S = 0.005
"""Between two looks at an open link that the system cannot wait for [s]."""

TEND_S = 0.05
"""A link that is not open is tended at least this often while something waits for it [s]."""

Received = list[tuple[bytes, int]]


class Taken(NamedTuple):
    """Bytes, when they were read (host's monotonic time [us]), and who of several sent them."""

    data: bytes
    host_us: int
    peer: Hashable


class LinkError(ValueError):
    """A link that cannot be opened; the message is one plain sentence.

    Attributes
    ----------
    may_mend
        Whether it may open later without anybody changing the configuration: a device that is not
        plugged in yet, a name server that does not answer yet.
    """

    def __init__(self, sentence: str, *, may_mend: bool = False) -> None:
        super().__init__(sentence)
        self.may_mend = may_mend


@dataclass(slots=True)
class LinkCounters:
    """What went over a link: bytes and datagrams (chunks, frames) each way.

    Attributes
    ----------
    received_bytes, received, sent_bytes, sent
        Both ways; what goes to several peers counts for each.
    dropped
        What could not be sent: no peer yet, no room, peer gone.
    opened
        Connections made, the first included.
    refused
        Datagrams of strangers that were thrown away unread, since there were too many of them; in
        a flood the system's count, which then has what it threw away for want of room in it too.
    overflowed
        Datagrams that the system threw away, since we did not read in time (Linux).
    """

    received_bytes: int = 0
    received: int = 0
    sent_bytes: int = 0
    sent: int = 0
    dropped: int = 0
    opened: int = 0
    refused: int = 0
    overflowed: int = 0


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """How links are kept open.

    Attributes
    ----------
    patient
        What may mend by itself is no error at the start: it is tried again and again.
    retry_first_s, retry_longest_s
        Wait after the first failure to open, and the longest one; each is twice the last, give or
        take a quarter.
    watchdog_s
        A connection or port that was heard and is not for this time is opened anew; 0 never. One
        that never brought anything is left alone: it is an output.
    peer_timeout_s
        Silence after which a peer of a listening link is no longer answered, if another one is.
    queue_bytes
        What waits to be sent over a stream; the oldest messages are dropped for newer ones.
    """

    patient: bool = False
    retry_first_s: float = 0.5
    retry_longest_s: float = 10.0
    watchdog_s: float = 10.0
    peer_timeout_s: float = 10.0
    queue_bytes: int = 1 << 16


class Endpoint(Protocol):
    """An open link."""

    name: str
    kind: str
    counters: LinkCounters
    heard_us: int | None
    trouble: str

    @property
    def ended(self) -> bool:
        """Whether nothing more will ever come (the end of a file)."""
        ...

    @property
    def is_open(self) -> bool:
        """Whether bytes can come and go now."""
        ...

    @property
    def backoff_s(self) -> float:
        """Wait until the next attempt to open it [s]; 0 when it is open."""
        ...

    @property
    def peers(self) -> int:
        """How many are sent to."""
        ...

    @property
    def blind(self) -> bool:
        """Whether it is open, yet has no descriptor to wait for."""
        ...

    def recv(self, timeout_s: float) -> Received:
        """What has arrived, waiting at most ``timeout_s`` for the first; for who has one link.

        Pairs of bytes and the host's monotonic time [us]; empty when nothing came. Whoever speaks
        is taken as a peer to answer.
        """
        ...

    def take(self, limit: int) -> list[Taken]:
        """What has arrived, of at most ``limit`` reads; never waits."""
        ...

    def waits(self) -> tuple[int, ...]:
        """Descriptors that become readable when there is something to take."""
        ...

    def accepted(self, peer: Hashable, now_us: int) -> None:
        """What this peer sent is believed: it may be answered."""
        ...

    def tend(self, now_us: int) -> None:
        """What time makes due: open again, hand on what waits; never waits itself."""
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
    """Host's monotonic time [us]."""
    return time.monotonic_ns() // 1000


class Waiter:
    """Waits until one of several descriptors can be read."""

    def __init__(self) -> None:
        self._known: tuple[int, ...] = ()
        self._poll = select.poll() if hasattr(select, "poll") else None  # not on Windows

    def __call__(self, descriptors: tuple[int, ...], timeout_s: float) -> bool:
        """Whether there is something to read within ``timeout_s``."""
        if not descriptors:
            time.sleep(timeout_s)
            return False
        if self._poll is None:
            return bool(select.select(descriptors, [], [], timeout_s)[0])
        if descriptors != self._known:
            for gone in set(self._known) - set(descriptors):
                self._poll.unregister(gone)
            for descriptor in descriptors:
                self._poll.register(descriptor, select.POLLIN)
            self._known = descriptors
        return bool(self._poll.poll(timeout_s * 1e3))


class Link(ABC):
    """The part that all endpoints share: name, counters, waiting, context manager."""

    def __init__(self, name: str, kind: str) -> None:
        self.name = name
        self.kind = kind
        self.counters = LinkCounters()
        self.heard_us: int | None = None
        self.trouble = ""
        self._waiter = Waiter()

    @property
    def ended(self) -> bool:
        return False

    @property
    def is_open(self) -> bool:
        return True

    @property
    def backoff_s(self) -> float:
        return 0.0

    @property
    def peers(self) -> int:
        return int(self.is_open)

    @property
    def blind(self) -> bool:
        return False

    @abstractmethod
    def take(self, limit: int) -> list[Taken]:
        """What has arrived, of at most ``limit`` reads."""

    @abstractmethod
    def close(self) -> None:
        """Give the port, socket or file back."""

    def waits(self) -> tuple[int, ...]:
        return ()

    def accepted(self, peer: Hashable, now_us: int) -> None:  # noqa: B027 - one peer, or none
        """Nothing to learn: there is only one."""

    def tend(self, now_us: int) -> None:  # noqa: B027 - some have nothing to tend
        """Nothing to do."""

    def recv(self, timeout_s: float) -> Received:
        end_s = time.monotonic() + timeout_s
        while True:
            if got := self.take(MAX_PER_RECV):
                for peer in {taken.peer for taken in got}:
                    self.accepted(peer, got[-1].host_us)
                return [taken[:2] for taken in got]
            self.tend(now_us())
            left_s = end_s - time.monotonic()
            if left_s <= 0 or self.ended:
                return []
            if not self.is_open:
                left_s = min(left_s, TEND_S)
            self._waiter(self.waits(), min(left_s, LOOK_S) if self.blind else left_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _received(self, data: bytes, host_us: int) -> None:
        self.counters.received_bytes += len(data)
        self.counters.received += 1
        self.heard_us = host_us

    def _sent(self, size: int) -> None:
        self.counters.sent_bytes += size
        self.counters.sent += 1


def resolve(name: str, host: str, port: int, kind: int, turn: int = 0) -> tuple[int, Any]:
    """Address family and address of a host; asks the name server, which may take long.

    Of several addresses the first, or the next ones in turn.
    """
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except (OSError, UnicodeError):
        raise unknown(name, host) from None
    family, _, _, _, address = found[turn % len(found)]
    return family, address


def unknown(name: str, host: str) -> LinkError:
    """A name that no name server knows, now."""
    return LinkError(f"{name}: there is no host called {host}", may_mend=True)


_REASONS = {
    errno.EADDRINUSE: "the port is already in use",
    errno.EADDRNOTAVAIL: "this computer has no such address",
    errno.EACCES: "permission denied",
    errno.ENOENT: "there is no such device or file",
    errno.EISDIR: "it is a directory",
    errno.EBUSY: "the device is in use",
    errno.EAGAIN: "another program has it open",
    errno.ECONNREFUSED: "nobody listens there",
    errno.ETIMEDOUT: "no answer",
}

_ADVICE = {
    errno.EADDRINUSE: "end the program that listens there (a second mavsentry, a ground station?) "
    "or choose another port",
    errno.EADDRNOTAVAIL: "0.0.0.0 stands for all of its addresses",
    errno.EAGAIN: "end it, or have it pass the stream on over UDP",
    errno.EBUSY: "end the program that holds it, or have that pass the stream on over UDP",
    errno.EISDIR: "name a file in it",
}
"""What to do about it, where the link itself knows nothing better."""

_MAY_MEND = {
    errno.EADDRNOTAVAIL,
    errno.ENOENT,
    errno.ENODEV,
    errno.ENXIO,
    errno.EIO,
    errno.ENETUNREACH,
    errno.ENETDOWN,
    errno.EHOSTUNREACH,
    errno.EHOSTDOWN,
    errno.ECONNREFUSED,
    errno.ECONNRESET,
    errno.ETIMEDOUT,
}


def plain(name: str, error: Exception, advice: str = "") -> LinkError:
    """The reason of a failure to open as one sentence; ``advice`` says what to do about it."""
    number = getattr(error, "errno", None) or 0
    if isinstance(error, TimeoutError):
        number = errno.ETIMEDOUT
    reason = _REASONS.get(number) or getattr(error, "strerror", None) or error
    advice = advice or _ADVICE.get(number, "")
    more = f": {advice}" if advice else ""
    return LinkError(f"cannot open {name}: {reason}{more}", may_mend=number in _MAY_MEND)
