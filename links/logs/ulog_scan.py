"""Finds the messages of a ULog: a compiled walk from header to header that survives damage.

A ULog message is its size (16 bits), a letter for its type and that many bytes; there is no check
sum. What tells a message from damage is that the letter is known, that the size suits the type (for
data: the format of its topic), and that another message follows. Where that fails the bytes are
garbage up to the next place from which :data:`CHAIN` sound messages follow each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from links.jit import kernel

__all__ = [
    "BAD",
    "HEADER",
    "LOST",
    "PASSED",
    "POSITION",
    "STATE",
    "UNKNOWN",
    "gather",
    "scan",
    "sync_magic",
]

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

HEADER = 3
"""Bytes before a message's own."""

CHAIN = 3
"""Sound messages in a row after which a place that was searched for is believed."""

sync_magic = np.array([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12], np.uint8)
"""Contents of a synchronisation message ``S``."""

POSITION, LOST, BAD, UNKNOWN, PASSED = range(5)
STATE = 5
"""Scan state, (5,) int64: where the next message begins; 1 while its place is searched for; bytes
that belonged to no message; whole messages of no known type or topic; sound messages."""

_NOT_YET, _NO, _SOUND, _STRANGE = -1, 0, 1, 2

_B, _F, _I, _M, _P, _Q, _A, _R = 66, 70, 73, 77, 80, 81, 65, 82
_D, _L, _C, _S, _O = 68, 76, 67, 83, 79


@kernel
def _judge(
    data: Bytes, at: int, end: int, least: NDArray[np.int32], most: NDArray[np.int32]
) -> int:
    """What stands at ``at``: a sound message, a whole one of no known type or topic, or none.

    ``least`` and ``most`` are the sizes that data of each message number may have, -1 where the
    number was never announced.
    """
    if at + HEADER > end:
        return _NOT_YET
    size = int(data[at]) | int(data[at + 1]) << 8
    kind = data[at + 2]
    body = at + HEADER
    if kind == _D:
        if size < 2:
            return _NO
        if body + 2 > end:
            return _NOT_YET
        number = int(data[body]) | int(data[body + 1]) << 8
        if most[number] < 0:
            return _STRANGE if body + size <= end else _NOT_YET
        if not least[number] <= size - 2 <= most[number]:
            return _NO
    elif kind == _S:
        if size != 8:
            return _NO
        if body + 8 > end:
            return _NOT_YET
        for k in range(8):
            if data[body + k] != sync_magic[k]:
                return _NO
    elif kind in (_O, _R):
        if size != 2:
            return _NO
    elif kind in (_L, _C):
        if size < (9 if kind == _L else 11):
            return _NO
        if body + 1 > end:
            return _NOT_YET
        if not 48 <= data[body] <= 55:  # '0' ... '7'
            return _NO
    elif kind in (_P, _I, _M, _Q):
        skip = 1 if kind in (_M, _Q) else 0
        if size < skip + 3:
            return _NO
        if body + skip + 1 > end:
            return _NOT_YET
        if skip + 1 + int(data[body + skip]) > size or data[body + skip] == 0:
            return _NO
    elif kind == _A:
        if size < 4 or size > 1024:
            return _NO
    elif kind == _F:
        if size < 4:
            return _NO
    elif kind == _B:
        if size < 40 or size > 1024:
            return _NO
    else:
        if size == 0 or kind < 65 or kind > 122:
            return _NO
        return _STRANGE if body + size <= end else _NOT_YET
    return _SOUND if body + size <= end else _NOT_YET


@kernel
def _follows(
    data: Bytes, at: int, end: int, final: bool, least: NDArray[np.int32], most: NDArray[np.int32]
) -> int:
    """Whether sound messages follow each other from ``at``: _SOUND, _NO or _NOT_YET."""
    for k in range(CHAIN):
        if at == end and final and k > 0:
            return _SOUND
        answer = _judge(data, at, end, least, most)
        if answer == _NOT_YET:
            if final:
                return _SOUND if k > 0 else _NO
            return _NOT_YET
        if answer != _SOUND:
            return _NO
        size = int(data[at]) | int(data[at + 1]) << 8
        if data[at + 2] == _S:
            return _SOUND
        at += HEADER + size
    return _SOUND


@kernel
def scan(
    state: Ints,
    data: Bytes,
    final: bool,
    least: NDArray[np.int32],
    most: NDArray[np.int32],
    wanted: NDArray[np.bool_],
    found: Ints,
) -> int:
    """Walk over ``data`` from ``state[POSITION]``; return how many messages were put in ``found``.

    It stops behind a message that changes what may follow (a format, an announcement), where
    ``found`` is full, and where more bytes are needed.

    Parameters
    ----------
    state : (5,) int64, changed in place
        See :data:`STATE`.
    data : (n,) uint8
    final
        No more bytes will come: what is cut off is garbage.
    least, most : (65536,) int32
        Bytes that data of each message number has at least and at most behind its number; -1:
        the number was never announced.
    wanted : (65536,) bool
        Which message numbers to put in ``found``.
    found : (m, 4) int64, filled
        Type, place behind the header, size, and how many sound messages came before it.
    """
    at, end, n = state[POSITION], len(data), 0
    while n < len(found):
        if state[LOST]:
            answer = _follows(data, at, end, final, least, most)
            if answer == _NOT_YET:
                break
            if answer == _NO:
                if at >= end:
                    break
                at += 1
                state[BAD] += 1
                continue
            state[LOST] = 0
        if at >= end:
            break
        answer = _judge(data, at, end, least, most)
        if answer == _NOT_YET:
            if not final:
                break
            answer = _NO
        if answer == _STRANGE:
            size = int(data[at]) | int(data[at + 1]) << 8
            then = _judge(data, at + HEADER + size, end, least, most)
            if then == _NOT_YET and not final:
                break
            if then == _SOUND or (at + HEADER + size == end):
                at += HEADER + size
                state[UNKNOWN] += 1
                continue
            answer = _NO
        if answer == _NO:
            state[LOST] = 1
            at += 1
            state[BAD] += 1
            continue
        size = int(data[at]) | int(data[at + 1]) << 8
        kind = int(data[at + 2])
        body = at + HEADER
        at = body + size
        use = kind != _S
        if kind == _D:
            use = wanted[int(data[body]) | int(data[body + 1]) << 8]
        if use:
            found[n, 0], found[n, 1], found[n, 2], found[n, 3] = kind, body, size, state[PASSED]
            n += 1
        state[PASSED] += 1
        if kind in (_F, _A, _R, _B):
            break
    state[POSITION] = at
    return n


@kernel
def gather(data: Bytes, at: Ints, length: Ints, cells: NDArray[np.uint8]) -> None:
    """Copy ``length`` bytes from each place ``at`` to a row of ``cells``; the rest stays as it is.

    Parameters
    ----------
    data : (n,) uint8
    at, length : (m,) int64
    cells : (m, k) uint8, filled
    """
    for i in range(len(at)):
        for k in range(min(length[i], cells.shape[1])):
            cells[i, k] = data[at[i] + k]
