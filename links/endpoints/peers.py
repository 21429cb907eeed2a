"""Who speaks on a socket that anybody can send to: peers that are answered, and strangers.

A peer is an address from which something came that was believed. Strangers are all others. What
they send is looked at, for one of them may be the vehicle that comes back from another address;
but only so much of it that they cannot keep us from the work.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import Final

__all__ = ["MOST_PEERS", "Peers", "Strangers"]

MOST_PEERS: Final = 16
"""Peers that are answered at most; a new one takes the place of who was silent longest."""


class Peers:
    """The bounded table of who is answered.

    Parameters
    ----------
    timeout_s
        Silence after which one is forgotten. The one that spoke last is kept whatever happens: a
        link may be broken in one direction only.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_us = round(timeout_s * 1e6)
        self._heard_us: dict[Hashable, int] = {}

    def __len__(self) -> int:
        return len(self._heard_us)

    def __iter__(self) -> Iterator[Hashable]:
        return iter(self._heard_us)

    def __contains__(self, peer: object) -> bool:
        return peer in self._heard_us

    def heard(self, peer: Hashable, now_us: int) -> None:
        """Something of this peer was believed."""
        if peer not in self._heard_us and len(self._heard_us) >= MOST_PEERS:
            del self._heard_us[min(self._heard_us, key=self._heard_us.__getitem__)]
        self._heard_us[peer] = now_us

    def forget_silent(self, now_us: int) -> None:
        """Forget who was silent for too long, but for the last who spoke."""
        if len(self._heard_us) > 1:
            newest_us = max(self._heard_us.values())
            oldest_us = min(newest_us, now_us - self._timeout_us)
            self._heard_us = {p: t for p, t in self._heard_us.items() if t >= oldest_us}


class Strangers:
    """How much is read of who was never believed.

    Attributes
    ----------
    EACH, ALL
        Datagrams in a period of one stranger, and of all of them together while there are peers
        whose work must go on. A vehicle that comes back from another address is believed at its
        first frame, hence within a few datagrams.
    """

    PERIOD_US: Final = 10_000_000
    EACH: Final = 2_000
    ALL: Final = 20_000
    TABLE: Final = 1_024

    def __init__(self) -> None:
        self._counts: dict[Hashable, int] = {}
        self._all = 0
        self._until_us = 0

    def lets(self, peer: Hashable, now_us: int, protect: bool) -> bool:
        """Whether this datagram of a stranger is looked at.

        Parameters
        ----------
        protect
            There are peers.
        """
        if now_us >= self._until_us:
            self._until_us = now_us + self.PERIOD_US
            self._counts.clear()
            self._all = 0
        self._all += 1
        if protect and self._all > self.ALL:
            return False
        count = self._counts.get(peer, 0)
        if count >= self.EACH:
            return False
        if count or len(self._counts) < self.TABLE:
            self._counts[peer] = count + 1
        return True

    def pardon(self, peer: Hashable) -> None:
        """Make a stranger a peer: what it sent does not count against the others."""
        self._all -= self._counts.pop(peer, 0)
