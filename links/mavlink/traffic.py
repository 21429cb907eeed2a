"""What went through a decoder: frames by message and by sender, frames lost, bytes.

The counting is compiled (:func:`count_frames`), because it is done for every frame of a stream that
may be a gigabyte; :class:`Counters` gives the counts their names when somebody asks.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.clock import VehicleClock
from links.jit import kernel
from links.mavlink.dialect import Dialect
from links.mavlink.framing import OTHER, Framer
from links.mavlink.scan import COMPONENT, MESSAGE, SEQUENCE, SYSTEM

__all__ = ["Counters", "count_frames", "traffic_size"]

_MESSAGES, _LOST, _BY_MESSAGE = 0, 1, 2
_SENDERS = 1 << 16  # frames of each, then the last sequence number of each
_REORDERED = 128  # a sequence number this far ahead is rather one from behind


class Counters:
    """What went through a decoder; equal when all counts are.

    Parameters
    ----------
    dialect, framer, clock
        Of the decoder.

    array : (traffic_size(dialect),) int64
        What :func:`count_frames` keeps, all 0 at first.
    """

    __hash__ = None  # type: ignore[assignment]

    def __init__(
        self,
        dialect: Dialect,
        framer: Framer,
        clock: VehicleClock,
        array: NDArray[np.int64],
    ) -> None:
        self.array = array
        self._dialect, self._framer, self._clock = dialect, framer, clock

    @property
    def bytes(self) -> int:
        """Bytes fed."""
        return self._framer.bytes

    @property
    def bad_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._framer.bad_bytes

    @property
    def messages(self) -> int:
        """Checked frames of all systems."""
        return int(self.array[_MESSAGES])

    @property
    def lost(self) -> int:
        """Frames missing from the sequence numbers of all senders (modulo 256, so at least)."""
        return int(self.array[_LOST])

    @property
    def reboots(self) -> int:
        """Times the vehicle's clock began anew."""
        return self._clock.reboots

    @property
    def by_name(self) -> Counter[str]:
        """Message name -> checked frames; an unknown message counts under ``"#<number>"``, those
        of many such numbers under ``"#other"``.
        """
        counts = self.array[_BY_MESSAGE : -2 * _SENDERS]
        names = Counter(
            {self._dialect.by_id[n].name: int(counts[n]) for n in np.flatnonzero(counts).tolist()}
        )
        for number, n in self._framer.unknown.items():
            names["#other" if number == OTHER else f"#{number}"] = n
        return names

    @property
    def by_source(self) -> Counter[tuple[int, int]]:
        """(system, component) -> checked frames."""
        counts = self.array[-2 * _SENDERS : -_SENDERS]
        return Counter(
            {(key >> 8, key & 0xFF): int(counts[key]) for key in np.flatnonzero(counts).tolist()}
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Counters) and self._all() == other._all()

    def __repr__(self) -> str:
        return f"Counters(messages={self.messages}, bytes={self.bytes}, lost={self.lost})"

    def _all(self) -> tuple[Any, ...]:
        scalars = (self.bytes, self.bad_bytes, self.messages, self.lost, self.reboots)
        return (*scalars, self.by_name, self.by_source)


def traffic_size(dialect: Dialect) -> int:
    """Integers that counting a dialect's frames takes."""
    return _BY_MESSAGE + len(dialect.extras) + 2 * _SENDERS


@kernel
def count_frames(table: Any, count: int, traffic: NDArray[np.int64]) -> None:
    """Count frames.

    Parameters
    ----------
    table : (n, k) int64
        Frames as :func:`links.mavlink.scan.frame_columns` describes them; the first ``count``.
    traffic : (m,) int64
        :attr:`Counters.array`.
    """
    senders = len(traffic) - 2 * _SENDERS
    traffic[_MESSAGES] += count
    for i in range(count):
        traffic[_BY_MESSAGE + table[i, MESSAGE]] += 1
        sender = senders + (table[i, SYSTEM] << 8 | table[i, COMPONENT])
        if traffic[sender] > 0:
            missing = (table[i, SEQUENCE] - traffic[sender + _SENDERS] - 1) & 0xFF
            if missing < _REORDERED:
                traffic[_LOST] += missing
        traffic[sender] += 1
        traffic[sender + _SENDERS] = table[i, SEQUENCE]
