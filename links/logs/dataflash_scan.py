"""Finds the records of a DataFlash log: a compiled walk from header to header.

A record is ``A3 95``, its type and a body; how long it is, an earlier FMT record says. There is no
check sum. So a record counts only when the next header, or the end of the file, follows right
behind it: a cut, a hole or a damaged length shows there. A damaged header costs its record and the
one before it. The search then goes on byte by byte.

Lengths are kept in here, not in Python, because an FMT record counts for the record after it. A
length that does not agree with the FMT's own format is not believed, and a type keeps its first
format until another log begins in the same file (its first record is the FMT of FMT itself).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from links.jit import kernel
from links.memory import copy_bytes

__all__ = [
    "BAD",
    "CUT",
    "FMT",
    "FMT_LENGTH",
    "HEADER",
    "IN_STEP",
    "LOGS",
    "POSITION",
    "STATE",
    "TYPES",
    "UNKNOWN",
    "gather",
    "scan",
]

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

HEADER = 3
FMT, FMT_LENGTH = 128, 89
"""Type and length of the records that describe the others."""
TYPES = 256

POSITION, IN_STEP, BAD, CUT, UNKNOWN, LOGS = range(6)
STATE = 6
"""Parts of the state: where the walk stands in the data it is given; whether a record ended there;
bytes that belonged to no record; records cut short; records of no known type; logs begun in this
file."""

_HEAD1, _HEAD2 = 0xA3, 0x95
_NAME, _FORMAT, _FORMAT_CHARS = 5, 9, 16  # places in an FMT record


@kernel
def scan(
    data: Bytes,
    final: bool,
    char_sizes: Ints,
    lengths: Ints,
    defined_in: Ints,
    state: Ints,
    starts: Ints,
    counts: Ints,
    took_effect: Bytes,
) -> int:
    """Walk the data until its end or until ``starts`` is full.

    It stops before another log begins, and before a type gets another length of which it has found
    records: so all that it finds of one type has one layout.

    Parameters
    ----------
    data : (m,) uint8
        What is left from before and what came new.
    final
        Nothing comes after it.
    char_sizes : (256,) int64 [bytes]
        Size of a field by its letter, 0 for none.
    lengths : (256,) int64 [bytes]
        Length of each type's records with their header, 0 unknown; changed by FMT records.
    defined_in : (256,) int64
        Number of the log in which each length was told.
    state : (STATE,) int64
    starts : (n,) int64
        Gets where each record starts.
    counts : (256,) int64
        Gets the number of records of each type.
    took_effect : (n,) uint8
        Gets 1 for an FMT record that was believed.

    Returns
    -------
    int
        Records found. The walk is at the end when ``state[POSITION]`` does not move any more.
    """
    m = len(data)
    at = state[POSITION]
    found = 0
    counts[:] = 0
    in_step = state[IN_STEP]
    while found < len(starts) and at + HEADER <= m:
        kind = data[at + 2]
        if data[at] != _HEAD1 or data[at + 1] != _HEAD2:
            at += 1
            state[BAD] += 1
            in_step = 0
            continue
        length = lengths[kind]
        if length == 0:
            state[UNKNOWN] += in_step
            at += 1
            state[BAD] += 1
            in_step = 0
            continue
        end = at + length
        if end + 2 > m and not final:
            break
        if end > m:
            follows = False
        elif end == m:
            follows = True
        elif end + 1 == m:
            follows = data[end] == _HEAD1
        else:
            follows = data[end] == _HEAD1 and data[end + 1] == _HEAD2
        if not follows:
            state[CUT] += in_step
            at += 1
            state[BAD] += 1
            in_step = 0
            continue
        in_step = 1
        if kind == FMT:
            told = data[at + HEADER]
            begins = _begins_log(data, at)
            if found > 0 and (
                begins or (told != FMT and counts[told] > 0 and defined_in[told] != state[LOGS])
            ):
                break
            state[LOGS] += begins
            took_effect[found] = _define(data, at, char_sizes, lengths, defined_in, state[LOGS])
        starts[found] = at
        counts[kind] += 1
        found += 1
        at = end
    if final and found < len(starts) and at + HEADER > m:
        state[BAD] += m - at
        at = m
    state[POSITION], state[IN_STEP] = at, in_step
    return found


@kernel
def _begins_log(data: Bytes, at: int) -> bool:
    """Whether an FMT record describes FMT itself."""
    return bool(
        data[at + HEADER] == FMT
        and data[at + HEADER + 1] == FMT_LENGTH
        and data[at + _NAME] == 70  # F
        and data[at + _NAME + 1] == 77  # M
        and data[at + _NAME + 2] == 84  # T
        and data[at + _NAME + 3] == 0
    )


@kernel
def _define(
    data: Bytes, at: int, char_sizes: Ints, lengths: Ints, defined_in: Ints, log: int
) -> int:
    """Take the length that an FMT record tells; 1 when it is believed."""
    kind, length = data[at + HEADER], data[at + HEADER + 1]
    if kind == FMT or length <= HEADER:
        return 0
    size = np.int64(HEADER)
    for k in range(_FORMAT_CHARS):
        char = data[at + _FORMAT + k]
        if char == 0:
            break
        if char_sizes[char] == 0:  # a letter of a later day: its length stands for itself
            size = np.int64(length)
            break
        size += char_sizes[char]
    if size != length or (lengths[kind] > 0 and defined_in[kind] == log):
        return 0
    lengths[kind] = length
    defined_in[kind] = log
    return 1


@kernel
def gather(
    data: Bytes,
    starts: Ints,
    number: int,
    lengths: Ints,
    body_at: Ints,
    place_at: Ints,
    bodies: Bytes,
    places: Ints,
) -> None:
    """Copy the bodies of records so that those of one type lie one behind the other.

    Parameters
    ----------
    starts : (n,) int64
        Where each record starts.
    number
        Number of the first of them among all of the file.
    body_at, place_at : (256,) int64
        Where the next body and place of each type go to; -1 for a type that is not wanted. They
        end behind the last.
    bodies : (b,) uint8
    places : (p,) int64
        Get the bodies, and the number of each record among all of the file.
    """
    for i in range(len(starts)):
        at = starts[i]
        kind = data[at + 2]
        if place_at[kind] < 0:
            continue
        size = lengths[kind] - HEADER
        to = body_at[kind]
        copy_bytes(data, at + HEADER, bodies, to, size)
        body_at[kind] = to + size
        places[place_at[kind]] = number + i
        place_at[kind] += 1
