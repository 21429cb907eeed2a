"""Many links as one: what arrives on any of them, and what is sent to one.

A link's number is its place in the list that the hub was given. The hub passes nothing on from one
link to another: what is sent is only what :meth:`Hub.send` is given.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple, Self

from links.endpoints.base import Endpoint, LinkCounters, now_us

__all__ = ["Arrival", "Hub", "LinkState"]

LOOK_S = 0.005
"""Between two looks at links that cannot be waited for together [s]."""


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
    peer: object


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
        Why it is not open, one sentence; empty when it is.
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
        self._heard_us: list[int | None] = [None] * len(self._links)

    @property
    def ended(self) -> bool:
        """Whether nothing more will ever come: an input that is a file has been read."""
        return any(link.ended for link in self._links)

    def recv(self, timeout_s: float) -> list[Arrival]:
        """What has arrived on any link, waiting at most ``timeout_s`` for the first."""
        if len(self._links) == 1:
            return self._take(0, timeout_s)
        end_s = time.monotonic() + timeout_s
        while True:
            out = [a for number in range(len(self._links)) for a in self._take(number, 0.0)]
            left_s = end_s - time.monotonic()
            if out or left_s <= 0:
                return out
            time.sleep(min(left_s, LOOK_S))

    def send(self, data: bytes, link: int) -> None:
        """Send to one link; what cannot leave is counted there. Never blocks."""
        self._links[link].send(data)

    def accepted(self, link: int, peer: object) -> None:
        """A frame of this peer was believed: only such peers are answered."""

    def tend(self, now_us: int) -> None:
        """What time makes due: open again what is lost or silent, forget peers that went."""

    def states(self) -> list[LinkState]:
        """How each link is doing, in order of their numbers."""
        return [
            LinkState(
                name=link.name,
                kind=link.name.partition(":")[0],
                open=True,
                heard_us=heard_us,
                backoff_s=0.0,
                trouble="",
                peers=1,
                counters=link.counters,
            )
            for link, heard_us in zip(self._links, self._heard_us, strict=True)
        ]

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

    def _take(self, number: int, timeout_s: float) -> list[Arrival]:
        got = self._links[number].recv(timeout_s)
        if got:
            self._heard_us[number] = now_us()
        return [Arrival(number, data, host_us, None) for data, host_us in got]
