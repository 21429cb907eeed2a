"""Many links as one: what arrives on any of them, and what is sent to one.

A link's number is its place in the list that the hub was given. The hub passes nothing on from one
link to another: what is sent is only what :meth:`Hub.send` is given.
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple, Self

from links.endpoints.base import LOOK_S, MAX_PER_RECV, Endpoint, LinkCounters, Waiter, now_us
from links.endpoints.files import LogEndpoint

__all__ = ["Arrival", "Hub", "LinkState"]


class Arrival(NamedTuple):
    """Bytes that arrived.

    Attributes
    ----------
    link
        Number of the link.
    data
        A datagram, or what a stream had.
    host_us
        When it was read, host's monotonic time [us].
    peer
        Who sent it, on a link where several may speak (UDP address, TCP client); else None.
    """

    link: int
    data: bytes
    host_us: int
    peer: Hashable


@dataclass(frozen=True, slots=True)
class LinkState:
    """How a link is doing.

    Attributes
    ----------
    name, kind
        Connection string, and its first word: udpin, udpout, tcp, tcpin, serial, file.
    open
        Whether bytes can come and go now. A TCP server without a client is not open.
    heard_us
        When anything last arrived, host's monotonic time [us]; None before that.
    backoff_s
        Time between the attempts to open it now [s]; 0 when it is open.
    trouble
        Why it is not open, one sentence; empty when it is, or when nobody has come yet.
    peers
        How many peers are answered.
    counters
        What went over it.
    """

    name: str
    kind: str
    open: bool
    heard_us: int | None
    backoff_s: float
    trouble: str
    peers: int
    counters: LinkCounters


class Hub:
    """Links side by side.

    Parameters
    ----------
    links
        Open endpoints, closed by :meth:`close`.
    """

    def __init__(self, links: Sequence[Endpoint]) -> None:
        self._links = tuple(links)
        self.names = tuple(link.name for link in self._links)
        self._waiter = Waiter()
        self._refused = 0

    @property
    def ended(self) -> bool:
        """Whether nothing more will ever come: all files that were to be read have been."""
        files = [link for link in self._links if isinstance(link, LogEndpoint)]
        return bool(files) and all(file.ended for file in files)

    def recv(self, timeout_s: float) -> list[Arrival]:
        """What has arrived on any link, waiting at most ``timeout_s`` for the first.

        Of each link :data:`MAX_PER_RECV` reads at most, and each link is read in every round: a
        flood on one of them does not starve another.
        """
        end_s = time.monotonic() + timeout_s
        while True:
            out = [
                Arrival(number, *taken)
                for number, link in enumerate(self._links)
                for taken in link.take(MAX_PER_RECV)
            ]
            left_s = end_s - time.monotonic()
            if out or left_s <= 0 or self.ended:
                return out
            waits = tuple(fd for link in self._links for fd in link.waits())
            blind = any(link.blind for link in self._links)
            if self._waiter(waits, min(left_s, LOOK_S) if blind else left_s) and self._junk():
                # Woken for nothing: to be woken for each of thousands would be the flood's success.
                time.sleep(min(max(end_s - time.monotonic(), 0.0), LOOK_S))

    def send(self, data: bytes, link: int) -> None:
        """Send to one link; what cannot leave is counted there. Never blocks."""
        self._links[link].send(data)

    def accepted(self, link: int, peer: Hashable) -> None:
        """A frame of this peer was believed: only such peers are answered."""
        self._links[link].accepted(peer, now_us())

    def tend(self, now_us: int) -> None:
        """What time makes due: open again what is lost or silent, forget peers that went."""
        for link in self._links:
            link.tend(now_us)

    def states(self) -> list[LinkState]:
        """How each link is doing, in order of their numbers."""
        return [
            LinkState(
                name=link.name,
                kind=link.kind,
                open=link.is_open,
                heard_us=link.heard_us,
                backoff_s=link.backoff_s,
                trouble=link.trouble,
                peers=link.peers,
                counters=link.counters,
            )
            for link in self._links
        ]

    @property
    def notes(self) -> tuple[str, ...]:
        """Why links are not open, a sentence each."""
        return tuple(
            f"{link.trouble}; tried again"
            for link in self._links
            if link.trouble and not link.is_open
        )

    def close(self) -> None:
        """Give all ports, sockets and files back."""
        for link in self._links:
            link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _junk(self) -> bool:
        """Whether strangers' datagrams were thrown away since the last call."""
        before, self._refused = self._refused, sum(k.counters.refused for k in self._links)
        return self._refused > before
