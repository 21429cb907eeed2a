"""The search for frames, in machine code; :mod:`links.mavlink.framing` says what it promises.

One call works through one block of bytes. What it must remember from block to block, what it was
asked and what it counted stand in one small array of integers, whose places are named here:

============  ====================================================================================
``AT``        where the search goes on, when out of step
``IN_STEP``   1 when the next frame is expected right after the last (and its stamp)
``PREFIX``    size of the stamp before each frame [bytes]; 0 for a live link
``FINAL``     1 when no more bytes will come
``FOUND``     frames that were found in this block
``UNKNOWN``   frames passed over in this block because the dialect has no such message
``GOOD_END``  everything before it in this block is accounted for
``KEEP``      from here on the block must be shown again, before what comes next
``BAD_CRC``, ``TRUNCATED``, ``GARBAGE``
              counts since the caller last set them to 0: the first two of frames, the last of bytes
============  ====================================================================================
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.jit import inlined, kernel
from links.mavlink.crc import checksum

__all__ = [
    "COLUMNS",
    "NO_STAMP",
    "frame_columns",
    "message_at",
    "new_state",
    "room",
    "scan",
    "scan_frames",
    "stamp_before",
]

AT, IN_STEP, PREFIX, FINAL, FOUND, UNKNOWN, GOOD_END, KEEP = range(8)
BAD_CRC, TRUNCATED, GARBAGE = range(8, 11)
STATES = 11

COLUMNS = 10
START, END, PAYLOAD, LENGTH, MESSAGE, SYSTEM, COMPONENT, SEQUENCE, STAMP_US, POSITION = range(10)
"""Columns of a table of frames, see :class:`links.mavlink.framing.Frames`."""

V1, V2 = 0xFE, 0xFD
HEAD_V1, HEAD_V2 = 6, 10
SIGNED = 0x01
SIGNATURE = 13
STAMP = 8
NO_STAMP = -1

_SHORTEST = HEAD_V1 + 2
_CHAIN = 8  # unknown frames in a row that are believed without a checked one after them
_KNOWN, _STRANGE, _WRONG, _NO_FRAME, _WAIT = range(5)
_LATEST = np.uint64(1 << 62)


def new_state(*, stamped: bool) -> NDArray[np.int64]:
    """State before the first block of a stream, with or without stamps before its frames."""
    state = np.zeros(STATES, np.int64)
    state[PREFIX], state[IN_STEP] = STAMP if stamped else 0, 1
    return state


def room(size: int) -> int:
    """Most frames, known and unknown, that so many bytes can hold."""
    return size // _SHORTEST + 1


@inlined
def message_at(data: Any, p: int) -> Any:
    """Number of the message of the frame at ``p``."""
    if data[p] == V1:
        return np.int64(data[p + 5])
    return np.int64(data[p + 7]) | np.int64(data[p + 8]) << 8 | np.int64(data[p + 9]) << 16


@inlined
def stamp_before(data: Any, p: int) -> Any:
    """Unix time in the 8 big-endian bytes before ``p`` [us], ``NO_STAMP`` for 0 and nonsense."""
    value = np.uint64(0)
    for i in range(p - STAMP, p):
        value = value << np.uint64(8) | np.uint64(data[i])
    return np.int64(value) if np.uint64(0) < value < _LATEST else np.int64(NO_STAMP)


@kernel
def _look(data: Any, p: int, extras: Any) -> tuple[int, int]:
    """What stands at ``p``, and where it ends."""
    n = len(data)
    if p >= n:
        return _WAIT, p
    if data[p] == V2:
        if n - p < HEAD_V2 + 2:
            return _WAIT, p
        flags = data[p + 2]
        if flags & (0xFF ^ SIGNED):  # a receiver must drop frames with flags that it does not know
            return _NO_FRAME, p
        body = p + HEAD_V2 + data[p + 1]
        end = body + 2 + (SIGNATURE if flags else 0)
    elif data[p] == V1:
        if n - p < HEAD_V1 + 2:
            return _WAIT, p
        body = p + HEAD_V1 + data[p + 1]
        end = body + 2
    else:
        return _NO_FRAME, p
    if end > n:
        return _WAIT, p
    message = message_at(data, p)
    extra = extras[message] if message < len(extras) else 0
    if extra == 0:
        return _STRANGE, end
    crc = checksum(data, p + 1, body, extra - 1)
    right = crc == np.uint64(data[body]) | np.uint64(data[body + 1]) << np.uint64(8)
    return (_KNOWN if right else _WRONG), end


@kernel
def _after_strange(data: Any, end: int, extras: Any, prefix: int, final: bool) -> int:
    """KNOWN when checked frames follow an unknown one that ends at ``end``, else why not."""
    for _ in range(_CHAIN):
        if final and end == len(data):
            return _KNOWN
        look, end = _look(data, end + prefix, extras)
        if look != _STRANGE:
            return look
    return _KNOWN


@kernel
def scan(data: Any, extras: Any, state: Any, found: Any) -> None:
    """Find the frames of a block.

    Parameters
    ----------
    data : (n,) uint8
        What had to be shown again, then what is new.
    extras : (m,) int16
        Message number -> CRC_EXTRA + 1, or 0; see :attr:`links.mavlink.dialect.Dialect.extras`.
    state : (STATES,) int64
        See above.
    found : (room(n), k) int64
        Takes in its first column, from the top, twice the offset of each frame, plus 1 where a
        stamp stands before it; from the bottom, the numbers of the unknown messages.
    """
    n, prefix, final = len(data), state[PREFIX], state[FINAL] != 0
    at, in_step = state[AT], state[IN_STEP] != 0
    good_end, count, unknown = 0, 0, 0
    while True:
        if in_step:
            p = good_end + prefix
            if final and good_end == n:
                break
        else:
            while at < n and data[at] != V1 and data[at] != V2:
                at += 1
            if at >= n:
                break
            p = at
        look, end = _look(data, p, extras)
        if look == _STRANGE:
            look = _after_strange(data, end, extras, prefix, final) if in_step else _NO_FRAME
            if look == _KNOWN:
                unknown += 1
                found[len(found) - unknown, 0] = message_at(data, p)
                good_end = end
                continue
            if look != _WAIT:
                look = _NO_FRAME
        if look == _KNOWN:
            stamped = prefix > 0 and p - good_end >= prefix
            state[GARBAGE] += p - good_end - (prefix if stamped else 0)
            found[count, 0] = 2 * p + stamped
            count += 1
            good_end = end
            in_step = True
            continue
        if look == _WAIT and not final:
            break
        if in_step:
            in_step = False
            at = good_end if prefix else p + 1
            if look == _WRONG:
                state[BAD_CRC] += 1
            elif look == _WAIT:
                state[TRUNCATED] += 1
        else:
            at = p + 1
    keep = n
    if final:
        at, in_step = n, True
    else:
        keep = good_end if in_step else max(good_end, at - prefix)
    state[GARBAGE] += keep - good_end
    state[GOOD_END], state[KEEP] = good_end, keep
    state[AT], state[IN_STEP] = max(at - keep, 0), in_step
    state[FOUND], state[UNKNOWN] = count, unknown


@kernel
def frame_columns(data: Any, origin: int, table: Any) -> None:
    """Read the heads of found frames.

    Parameters
    ----------
    data : (n,) uint8
    origin
        Place of ``data`` in the whole stream [bytes].
    table : (m, COLUMNS) int64
        Has in its first column what :func:`scan` put there; all columns are filled.
    """
    for i in range(len(table)):
        p = table[i, 0] >> 1
        stamped = (table[i, 0] & 1) != 0
        row = table[i]
        length = np.int64(data[p + 1])
        if data[p] == V2:
            row[PAYLOAD] = p + HEAD_V2
            row[END] = p + HEAD_V2 + length + 2 + (SIGNATURE if data[p + 2] & SIGNED else 0)
            row[SEQUENCE], row[SYSTEM], row[COMPONENT] = data[p + 4], data[p + 5], data[p + 6]
        else:
            row[PAYLOAD] = p + HEAD_V1
            row[END] = p + HEAD_V1 + length + 2
            row[SEQUENCE], row[SYSTEM], row[COMPONENT] = data[p + 2], data[p + 3], data[p + 4]
        row[START], row[LENGTH], row[POSITION] = p, length, p + origin
        row[MESSAGE] = message_at(data, p)
        row[STAMP_US] = stamp_before(data, p) if stamped else NO_STAMP


@kernel
def scan_frames(data: Any, extras: Any, state: Any, origin: int, table: Any) -> None:
    """:func:`scan`, and :func:`frame_columns` of what it found, in one call."""
    scan(data, extras, state, table)
    frame_columns(data, origin, table[: state[FOUND]])
