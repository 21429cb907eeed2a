"""Whole messages in bulk: every field of every frame of a stream, one array per kind of message.

Where :mod:`links.mavlink.decode` picks what the monitor needs and checks it, this gives all that
was sent, as it was sent: for a look into a log, for comparisons, for exports. A message's array is
a structured one; its ``fields`` are the message's own, in wire order, named, typed and counted as
the dialect says, with the very bytes of the frames. Zeros that MAVLink 2 cut off and extensions
that MAVLink 1 never had read as zero.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.jit import kernel
from links.mavlink.crc import load_word, store_word
from links.mavlink.dialect import Dialect, Message, load_dialect
from links.mavlink.scan import (
    BAD_CRC,
    FINAL,
    FOUND,
    HEAD_V1,
    HEAD_V2,
    NO_STAMP,
    V2,
    message_at,
    new_state,
    room,
    scan,
    stamp_before,
)
from links.samples import Rows

__all__ = ["ColumnDecoder", "Columns", "record_dtype"]

Block = Any
"""Bytes, or what has their buffer: a bytearray, a memory map, an array of uint8."""

_HEAD = [
    ("unix_us", "<i8"),
    ("frame", "<u4"),
    ("system", "u1"),
    ("component", "u1"),
    ("sequence", "u1"),
    ("version", "u1"),
]
_HEAD_SIZE = 16
_WORD = 8
_BLOCK = 1 << 19  # bytes that are scanned and counted while they are in the processor's cache


def record_dtype(message: Message) -> np.dtype[np.void]:
    """Record of one message: who sent it when, then ``fields``, its payload's dtype.

    ``unix_us`` is the stamp of a telemetry log [us], ``NO_STAMP`` without one; ``frame`` the number
    of the frame in the stream, from 0, over all messages; ``version`` 1 or 2 that of the protocol.
    """
    return np.dtype([*_HEAD, ("fields", message.dtype)])


@dataclass(frozen=True, slots=True)
class Columns:
    """What a block of bytes holds.

    Attributes
    ----------
    messages
        Message name -> (n,) records, see :func:`record_dtype`, in the order of the stream.
    frames
        Checked frames, those of messages that were not asked for included.
    bad_bytes
        Bytes that belonged to no frame (and to no stamp).
    unknown
        Message number -> frames passed over because the dialect has no such message.
    """

    messages: Mapping[str, Rows]
    frames: int
    bad_bytes: int
    unknown: Counter[int]


class ColumnDecoder:
    """Decodes a stream in blocks of any size; a block's arrays hold what it completes.

    Parameters
    ----------
    dialect
        Name of a dialect that pymavlink ships.
    stamped
        The stream is a telemetry log: an 8-byte stamp before each frame.
    messages
        Names of those wanted; None for all.

    Raises
    ------
    ValueError
        When pymavlink has no such dialect, or the dialect no such message.
    """

    def __init__(
        self,
        dialect: str = "ardupilotmega",
        *,
        stamped: bool = False,
        messages: Collection[str] | None = None,
    ) -> None:
        tables = load_dialect(dialect)
        self._messages = _wanted(tables, messages)
        self._extras = tables.extras
        self._slots = np.full(len(tables.extras), -1, np.int16)
        self._dtypes = [record_dtype(m) for m in self._messages]
        for slot, message in enumerate(self._messages):
            self._slots[message.id] = slot
        self._sizes = np.array([m.dtype.itemsize for m in self._messages], np.int64)
        self._state = new_state(stamped=stamped)
        self._rest = b""
        self._frames = 0

    def feed(self, data: Block) -> Columns:
        """Messages that ``data`` completes; what is incomplete waits for more."""
        return self._decode(b"".join((self._rest, data)) if self._rest else data, final=False)

    def finish(self, data: Block = b"") -> Columns:
        """The same, when no more will come; ready for a new stream."""
        columns = self._decode(b"".join((self._rest, data)) if self._rest else data, final=True)
        self._frames = 0
        return columns

    def _decode(self, block: Block, *, final: bool) -> Columns:
        data = np.frombuffer(memoryview(block).toreadonly(), np.uint8)
        counts = np.zeros(len(self._messages), np.int64)
        parts, bad_bytes, unknown, at = [], 0, Counter[int](), 0
        while True:
            upto = min(at + _BLOCK, len(data))
            self._state[FINAL] = final and upto == len(data)
            found = np.empty((room(upto - at), 1), np.int64)
            _scan_and_count(
                data[at:upto], at, self._extras, self._state, found, self._slots, counts
            )
            *_, n, strange, _, keep, _, _, garbage = self._state.tolist()
            unknown.update(found[len(found) - strange :, 0].tolist())
            bad_bytes += garbage
            self._state[BAD_CRC:] = 0
            parts.append(found[:n].copy())
            at += keep
            if upto == len(data):
                break
        self._rest = data[at:].tobytes()
        frames = np.concatenate(parts)
        messages = self._fill(data, frames, counts)
        self._frames += len(frames)
        return Columns(messages, len(frames), bad_bytes, unknown)

    def _fill(
        self, data: NDArray[np.uint8], found: NDArray[np.int64], counts: NDArray[np.int64]
    ) -> dict[str, Rows]:
        """Records of the frames; all of them share one piece of memory, each message a part."""
        spans = counts * (_HEAD_SIZE + self._sizes)
        rooms = -(-spans // _WORD) * _WORD + _WORD * (counts > 0)  # the last store may go beyond
        begin = np.cumsum(rooms) - rooms
        memory = np.zeros(int(rooms.sum()), np.uint8)
        _fill(data, found, self._frames, self._slots, self._sizes, begin.copy(), memory)
        return {
            self._messages[i].name: memory[begin[i] : begin[i] + spans[i]].view(self._dtypes[i])
            for i in np.flatnonzero(counts).tolist()
        }


def _wanted(dialect: Dialect, names: Collection[str] | None) -> list[Message]:
    if names is None:
        return list(dialect.by_id.values())
    if strange := sorted(set(names) - set(dialect.by_name)):
        raise ValueError(f"{dialect.name} has no message {', '.join(strange)}")
    return [dialect.by_name[name] for name in names]


@kernel
def _scan_and_count(
    data: Any, origin: int, extras: Any, state: Any, found: Any, slots: Any, counts: Any
) -> None:
    """Find a block's frames; make their places those in the whole; count each message's."""
    scan(data, extras, state, found)
    for i in range(state[FOUND]):
        slot = slots[message_at(data, found[i, 0] >> 1)]
        if slot >= 0:
            counts[slot] += 1
        found[i, 0] += 2 * origin


@kernel
def _fill(data: Any, found: Any, first: int, slots: Any, sizes: Any, to: Any, memory: Any) -> None:
    """Write each frame's record.

    Parameters
    ----------
    found : (n, 1) int64
        Twice the offset of each frame in ``data``, plus 1 where it has a stamp.
    first
        Number of the first frame.
    slots : (m,) int16
        Message number -> place of the message in the next two, -1 for one that is not wanted.
    sizes, to : (s,) int64 [bytes]
        Size of each message's payload; where its next record goes in ``memory``.
    memory : (k,) uint8
        All zero; 8 bytes more than the records need stand behind those of each message.
    """
    for i in range(len(found)):
        p = found[i, 0] >> 1
        slot = slots[message_at(data, p)]
        if slot < 0:
            continue
        v2 = data[p] == V2
        unix_us = stamp_before(data, p) if found[i, 0] & 1 else np.int64(NO_STAMP)
        head = p + (4 if v2 else 2)  # sequence, system, component
        who = np.uint64(data[head + 1]) | np.uint64(data[head + 2]) << np.uint64(8)
        who |= np.uint64(data[head]) << np.uint64(16) | np.uint64(1 + v2) << np.uint64(24)
        at = to[slot]
        store_word(memory, at, np.uint64(unix_us))
        store_word(memory, at + 8, who << np.uint64(32) | np.uint64((first + i) & 0xFFFFFFFF))
        at += _HEAD_SIZE
        _copy(data, p + (HEAD_V2 if v2 else HEAD_V1), memory, at, data[p + 1], sizes[slot])
        to[slot] = at + sizes[slot]


@kernel
def _copy(data: Any, p: int, memory: Any, at: int, length: int, size: int) -> None:
    """Copy a payload by words; what a word takes too much is made zero."""
    n = min(np.int64(length), np.int64(size))
    inside = len(data) - _WORD
    done = 0
    while done + _WORD <= n:
        store_word(memory, at + done, load_word(data, p + done))
        done += _WORD
    left = n - done
    if left > 0:
        word = np.uint64(0)
        if p + done <= inside:
            word = load_word(data, p + done)
            word &= ~(~np.uint64(0) << np.uint64(8 * left))
        else:
            for k in range(left - 1, -1, -1):
                word = word << np.uint64(8) | np.uint64(data[p + done + k])
        store_word(memory, at + done, word)
