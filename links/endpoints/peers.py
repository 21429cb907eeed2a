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


class _Allowance:
    """Datagrams that may come: a first lot, then so many a second.

    Parameters
    ----------
    most
        The first lot, and what is saved up in silence.
    per_s
        What comes back [1/s].
    """

    __slots__ = ("_at_us", "_left", "_most", "_per_us")

    def __init__(self, most: float, per_s: float, now_us: int) -> None:
        self._most, self._per_us = most, per_s * 1e-6
        self._left, self._at_us = most, now_us

    def take(self, now_us: int) -> bool:
        """Whether one more may come."""
        left = min(self._left + (now_us - self._at_us) * self._per_us, self._most)
        self._at_us = now_us
        self._left = left - 1.0 if left >= 1.0 else left
        return left >= 1.0


class Strangers:
    """How much is read of who was never believed, while there are peers whose work must go on.

    Attributes
    ----------
    EACH, EACH_PER_S
        Datagrams of one stranger: the first ones, and those of each second after that. A vehicle
        that comes back from another address is believed at its first frame, hence long before.
    ALL, ALL_PER_S
        The same of all strangers together: a flood may come from very many addresses.
    TABLE
        Strangers that are told apart.
    """

    EACH: Final = 1_000
    EACH_PER_S: Final = 200
    ALL: Final = 2_000
    ALL_PER_S: Final = 2_000
    TABLE: Final = 1_024

    def __init__(self) -> None:
        self._each: dict[Hashable, _Allowance] = {}
        self._all = _Allowance(self.ALL, self.ALL_PER_S, 0)

    def lets(self, peer: Hashable, now_us: int) -> bool:
        """Whether this datagram of a stranger is looked at."""
        own = self._each.get(peer)
        if own is None:
            if len(self._each) >= self.TABLE:
                self._each.clear()  # what they may send all together bounds it
            own = self._each[peer] = _Allowance(self.EACH, self.EACH_PER_S, now_us)
        return own.take(now_us) and self._all.take(now_us)

    def pardon(self, peer: Hashable) -> None:
        """Make a stranger a peer."""
        self._each.pop(peer, None)
