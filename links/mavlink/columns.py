"""Whole messages in bulk: every field of every frame of a stream, one array per kind of message.

Where :mod:`links.mavlink.decode` picks what the monitor needs and checks it, this gives all that
was sent, as it was sent: for a look into a log, for comparisons, for exports. A message's array is
a structured one; its ``fields`` are the message's own, in wire order, named, typed and counted as
the dialect says, with the very bytes of the frames. Zeros that MAVLink 2 cut off and extensions
that MAVLink 1 never had read as zero.
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.jit import kernel
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
from links.memory import copy_bytes, store_word
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
_PIECE = 1 << 19  # bytes that are scanned and counted while they are in the processor's cache

Read = Callable[[int, int], NDArray[np.uint8]]
"""Gives bytes ``lo`` to ``hi`` of what is decoded; they hold until it is asked for others."""


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
        return self._take(data, final=False)

    def finish(self, data: Block = b"") -> Columns:
        """The same, when no more will come; ready for a new stream."""
        return self._take(data, final=True)

    def finish_file(self, file: io.FileIO) -> Columns:
        """The same with all of a file, which is read twice, never more than a piece at a time.

        Raises
        ------
        OSError
            The file cannot be read, or it became shorter meanwhile.
        """
        size, buffer = file.seek(0, io.SEEK_END), np.empty(_PIECE, np.uint8)

        def read(lo: int, hi: int) -> NDArray[np.uint8]:
            file.seek(lo)
            piece = buffer[: hi - lo]
            if file.readinto(piece.data) != len(piece):
                raise OSError("it became shorter while it was read")
            return piece

        self._rest = b""
        return self._decode(read, size, final=True)

    def _take(self, block: Block, *, final: bool) -> Columns:
        held = b"".join((self._rest, block)) if self._rest else block
        data = np.frombuffer(memoryview(held).toreadonly(), np.uint8)
        return self._decode(lambda lo, hi: data[lo:hi], len(data), final=final)

    def _decode(self, read: Read, size: int, *, final: bool) -> Columns:
        """Find and count all frames, then make room for their records and read them once more."""
        counts = np.zeros(len(self._messages), np.int64)
        found = np.empty((room(min(size, _PIECE)), 1), np.int64)
        pieces: list[tuple[int, int, NDArray[np.uint32]]] = []
        frames, bad_bytes, unknown, at = 0, 0, Counter[int](), 0
        while True:
            upto = min(at + _PIECE, size)
            self._state[FINAL] = final and upto == size
            piece = read(at, upto)
            _scan_and_count(piece, self._extras, self._state, found, self._slots, counts)
            *_, n, strange, _, keep, _, _, garbage = self._state.tolist()
            unknown.update(found[len(found) - strange :, 0].tolist())
            bad_bytes += garbage
            self._state[BAD_CRC:] = 0
            pieces.append((at, upto, found[:n, 0].astype(np.uint32)))
            frames += n
            at += keep
            if upto == size:
                break
        self._rest = piece[keep:].tobytes()
        first, self._frames = self._frames, 0 if final else self._frames + frames
        return Columns(self._records(read, pieces, first, counts), frames, bad_bytes, unknown)

    def _records(
        self,
        read: Read,
        pieces: list[tuple[int, int, NDArray[np.uint32]]],
        first: int,
        counts: NDArray[np.int64],
    ) -> dict[str, Rows]:
        """Records of the frames; all of them share one piece of memory, each message a part."""
        spans = counts * (_HEAD_SIZE + self._sizes)
        end = np.cumsum(spans)
        memory, to = np.zeros(int(end[-1]), np.uint8), end - spans
        for lo, hi, found in pieces:
            _fill(read(lo, hi), found, first, self._slots, self._sizes, to, memory)
            first += len(found)
        return {
            self._messages[i].name: memory[end[i] - spans[i] : end[i]].view(self._dtypes[i])
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
    data: Any, extras: Any, state: Any, found: Any, slots: Any, counts: Any
) -> None:
    """Find a piece's frames, see :func:`scan`; count each message's."""
    scan(data, extras, state, found)
    for i in range(state[FOUND]):
        slot = slots[message_at(data, found[i, 0] >> 1)]
        if slot >= 0:
            counts[slot] += 1


@kernel
def _fill(data: Any, found: Any, first: int, slots: Any, sizes: Any, to: Any, memory: Any) -> None:
    """Write each frame's record.

    Parameters
    ----------
    found : (n,) uint32
        Twice the offset of each frame in ``data``, plus 1 where it has a stamp.
    first
        Number of the first frame.
    slots : (m,) int16
        Message number -> place of the message in the next two, -1 for one that is not wanted.
    sizes, to : (s,) int64 [bytes]
        Size of each message's payload; where its next record goes in ``memory``, moved on.
    memory : (k,) uint8
        All zero where records will go.
    """
    for i in range(len(found)):
        p: Any = np.int64(found[i] >> 1)
        slot = slots[message_at(data, p)]
        if slot < 0:
            continue
        v2 = data[p] == V2
        unix_us = stamp_before(data, p) if found[i] & 1 else np.int64(NO_STAMP)
        head = p + (4 if v2 else 2)  # sequence, system, component
        who = np.uint64(data[head + 1]) | np.uint64(data[head + 2]) << np.uint64(8)
        who |= np.uint64(data[head]) << np.uint64(16) | np.uint64(1 + v2) << np.uint64(24)
        at = to[slot]
        store_word(memory, at, np.uint64(unix_us))
        store_word(memory, at + 8, who << np.uint64(32) | np.uint64((first + i) & 0xFFFFFFFF))
        at += _HEAD_SIZE
        size = min(np.int64(data[p + 1]), sizes[slot])
        copy_bytes(data, p + (HEAD_V2 if v2 else HEAD_V1), memory, at, size)
        to[slot] = at + sizes[slot]
