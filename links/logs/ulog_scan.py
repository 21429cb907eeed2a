"""Finds the messages of a ULog: a compiled walk from header to header that survives damage.

A ULog message is its size (16 bits), a letter for its type and that many bytes; there is no check
sum. What tells a message from damage is that the letter is known, that the size is the one that its
contents ask for, and that another message follows. How long data is, the format of its topic says;
a parameter or an information says its own type; a format, a topic's name and a logged line are
text throughout; flag bits tell nothing and must be followed. Without that a damaged size in the
definitions would swallow what announces the topics, and all of their data would be lost.

Where it fails the bytes are garbage up to the next place from which :data:`CHAIN` sound messages
follow each other, with others among them that are whole at least.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from links.jit import kernel
from links.memory import copy_bytes

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
Sizes = NDArray[np.int32]

HEADER = 3
"""Bytes before a message's own."""

CHAIN = 3
"""Sound messages after which a place that was searched for is believed."""

REACH = 16
"""Messages of no known type or topic that may lie between two sound ones."""

sync_magic = np.array([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12], np.uint8)
"""Contents of a synchronisation message ``S``."""

POSITION, LOST, BAD, UNKNOWN, PASSED = range(5)
STATE = 5
"""Scan state, (5,) int64: where the next message begins; 1 while its place is searched for; bytes
that belonged to no message; whole messages of no known type or topic; sound messages."""

_NOT_YET, _NO, _SOUND, _STRANGE = -1, 0, 1, 2

_B, _F, _I, _M, _P, _Q, _A, _R = 66, 70, 73, 77, 80, 81, 65, 82
_D, _L, _C, _S, _O = 68, 76, 67, 83, 79
_SPACE, _OPENING, _COLON, _SEMICOLON = 32, 91, 58, 59
_NEWLINE, _TAB = 10, 9


@kernel
def _size_at(data: Bytes, at: int) -> int:
    return int(data[at]) | int(data[at + 1]) << 8


@kernel
def _is_digit(char: int) -> bool:
    return bool(48 <= char <= 57)


@kernel
def _is_word(data: Bytes, at: int, end: int) -> bool:
    """Letters, digits, underscores and slashes, as in names of topics."""
    for k in range(at, end):
        char = data[k]
        lower = char | 32
        if not (97 <= lower <= 122 or 47 <= char <= 57 or char == 95):
            return False
    return True


@kernel
def _is_text(data: Bytes, at: int, end: int) -> bool:
    """Text as it is logged: no control characters but line ends and tabulators."""
    for k in range(at, end):
        if data[k] < _SPACE and data[k] != _NEWLINE and data[k] != _TAB:
            return False
    return True


@kernel
def _is_format(data: Bytes, at: int, end: int) -> bool:
    """``name:type field;type[4] field;``."""
    named = False
    for k in range(at, end):
        named |= data[k] == _COLON
        if data[k] < _SPACE or data[k] > 126:
            return False
    return bool(named and data[end - 1] == _SEMICOLON)


@kernel
def _value_size(data: Bytes, at: int, end: int) -> int:
    """Bytes of a value by its key ``type name`` or ``type[n] name``; -1 where that is no key."""
    first = data[at]
    if first == 102:  # float
        size = 4
    elif first == 100:  # double
        size = 8
    elif first in (98, 99):  # bool, char
        size = 1
    elif first in (105, 117):  # int8_t ... uint64_t
        k = at
        while k < end and not _is_digit(data[k]):
            k += 1
        digit = data[k] if k < end else 0
        size = 1 if digit == 56 else 2 if digit == 49 else 4 if digit == 51 else 8
    else:
        return -1
    k = at
    while k < end and data[k] != _SPACE and data[k] != _OPENING:
        k += 1
    if k < end and data[k] == _OPENING:
        count = 0
        k += 1
        while k < end and _is_digit(data[k]) and count < 65536:
            count = 10 * count + data[k] - 48
            k += 1
        size *= count
        k += 1
    return size if k < end and data[k] == _SPACE and _is_text(data, k, end) else -1


@kernel
def _judge(data: Bytes, at: int, end: int, least: Sizes, most: Sizes, odd: Sizes) -> int:
    """What stands at ``at``: a sound message, a whole one of no known type or topic, or none."""
    if at + HEADER > end:
        return _NOT_YET
    size, kind, body = _size_at(data, at), data[at + 2], at + HEADER
    if kind == _D:
        if size < 2:
            return _NO
        if body + 2 > end:
            return _NOT_YET
        number = _size_at(data, body)
        if most[number] < 0 or size == odd[number]:
            return _STRANGE if body + size <= end else _NOT_YET
        if not least[number] <= size - 2 <= most[number]:
            return _NO
        return _SOUND if body + size <= end else _NOT_YET
    skip = 1 if kind in (_M, _Q) else 0
    low, high = 1, 0xFFFF
    if kind in (_P, _Q, _I, _M, _F):
        low = 4
    elif kind == _S:
        low, high = 8, 8
    elif kind in (_O, _R):
        low, high = 2, 2
    elif kind == _L:
        low = 9
    elif kind == _C:
        low = 11
    elif kind == _A:
        low, high = 4, 1024
    elif kind == _B:
        low, high = 40, 1024
    elif not 65 <= kind <= 122:
        return _NO
    if not low <= size <= high:
        return _NO
    if body + size > end:
        return _NOT_YET
    stop, sound = body + size, True
    if kind in (_P, _I, _M, _Q):
        key = body + skip + 1
        value = key + data[key - 1]
        sound = key < value <= stop and value + _value_size(data, key, value) == stop
    elif kind == _F:
        sound = _is_format(data, body, stop)
    elif kind == _A:
        sound = _is_word(data, body + 3, stop)
    elif kind in (_L, _C):
        sound = 48 <= data[body] <= 55 and _is_text(data, body + (9 if kind == _L else 11), stop)
    elif kind == _S:
        for k in range(8):
            sound &= data[body + k] == sync_magic[k]
    elif kind not in (_O, _R, _B):
        return _STRANGE
    return _SOUND if sound else _NO


@kernel
def _goes_on(
    data: Bytes, at: int, end: int, final: bool, least: Sizes, most: Sizes, odd: Sizes
) -> int:
    """Whether a sound message follows, behind some that are whole: _SOUND, _NO or _NOT_YET."""
    for _ in range(REACH):
        if at == end and final:
            return _SOUND
        answer = _judge(data, at, end, least, most, odd)
        if answer != _STRANGE:
            return _NO if answer == _NOT_YET and final else answer
        at += HEADER + _size_at(data, at)
    return _NO


@kernel
def _begins(
    data: Bytes, at: int, end: int, final: bool, least: Sizes, most: Sizes, odd: Sizes
) -> int:
    """Whether a chain of sound messages begins at ``at``: _SOUND, _NO or _NOT_YET."""
    sound = 0
    for _ in range(REACH):
        if at == end and final and sound > 0:
            return _SOUND
        answer = _judge(data, at, end, least, most, odd)
        if answer == _NOT_YET:
            if final:
                return _SOUND if sound > 0 else _NO
            return _NOT_YET
        if answer == _NO or (answer == _STRANGE and sound == 0):
            return _NO
        if answer == _SOUND:
            sound += 1
            if sound == CHAIN or data[at + 2] == _S:
                return _SOUND
        at += HEADER + _size_at(data, at)
    return _NO


@kernel
def _note_odd(data: Bytes, at: int, end: int, least: Sizes, most: Sizes, odd: Sizes) -> None:
    """Keep a size that data of a known topic should not have: the second time it is believed."""
    if at + HEADER + 2 <= end and data[at + 2] == _D:
        size, number = _size_at(data, at), _size_at(data, at + HEADER)
        if size >= 2 and most[number] >= 0:
            odd[number] = size


@kernel
def scan(
    state: Ints,
    data: Bytes,
    final: bool,
    least: Sizes,
    most: Sizes,
    odd: Sizes,
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
    odd : (65536,) int32, changed in place
        Size of data of each message number that did not fit its format, -1 for none. A format that
        was damaged itself does not make every message of its topic damage.
    wanted : (65536,) bool
        Which message numbers to put in ``found``.
    found : (m, 4) int64, filled
        Type, place behind the header, size, and how many sound messages came before it.
    """
    at, end, n = state[POSITION], len(data), 0
    while n < len(found):
        if state[LOST]:
            answer = _begins(data, at, end, final, least, most, odd)
            if answer == _NOT_YET:
                break
            if answer == _NO:
                if at >= end:
                    break
                _note_odd(data, at, end, least, most, odd)
                at += 1
                state[BAD] += 1
                continue
            state[LOST] = 0
        if at >= end:
            break
        answer = _judge(data, at, end, least, most, odd)
        if answer == _NOT_YET:
            if not final:
                break
            answer = _NO
        if answer == _STRANGE or (answer == _SOUND and data[at + 2] == _B):
            behind = at + HEADER + _size_at(data, at)
            then = _goes_on(data, behind, end, final, least, most, odd)
            if then == _NOT_YET:
                break
            if then == _SOUND and answer == _STRANGE:
                at = behind
                state[UNKNOWN] += 1
                continue
            answer = then
        if answer == _NO:
            _note_odd(data, at, end, least, most, odd)
            state[LOST] = 1
            at += 1
            state[BAD] += 1
            continue
        size = _size_at(data, at)
        kind = int(data[at + 2])
        body = at + HEADER
        at = body + size
        use = kind != _S
        if kind == _D:
            use = wanted[_size_at(data, body)]
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
    width = cells.shape[1]
    for i in range(len(at)):
        copy_bytes(data, at[i], cells, i * width, min(length[i], width))
