"""Bytes to frames: MAVLink 1 and 2, sans-IO, nothing lost after garbage.

A frame is believed when its checksum (CRC-16/MCRF4XX over header and payload, then the message's
CRC_EXTRA) is right. After bytes that are no frame the search goes on from the very next byte, so
damage costs only the frames that it touched. A decision is taken only when all of its bytes are
there: the frames found do not depend on how the stream was cut.

A telemetry log puts an 8-byte big-endian Unix stamp before each frame; with ``stamped=True`` the
framer expects it and reports it, and still finds frames whose stamp is missing or damaged.

A message whose number the dialect does not have cannot be checked. It is passed over, and counted,
only where frames that can be checked follow it without a gap; otherwise its bytes are searched.

The search itself is :mod:`links.mavlink.scan`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from links.mavlink import scan
from links.mavlink.dialect import Dialect
from links.mavlink.scan import NO_STAMP
from links.vocabulary import Rejection

__all__ = ["MAX_FRAME", "NO_STAMP", "Framer", "Frames"]

MAX_FRAME = 280
"""Longest frame: MAVLink 2, 255 bytes of payload, signed [bytes]."""

UNKNOWN_MAX = 256
"""Unknown message numbers that are counted one by one; a hostile sender has 16 million of them."""

OTHER = -1
"""In place of the number of any further unknown message."""

Column = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Frames:
    """Checked frames in arrival order over one block of bytes.

    Attributes
    ----------
    data : bytes
        The block that the offsets point into.
    table : (n, scan.COLUMNS) int64
        One row per frame; its columns are the properties below. Where a frame has no stamp,
        ``stamp_us`` is :data:`NO_STAMP`.
    """

    data: bytes
    table: Column

    def __len__(self) -> int:
        return len(self.table)

    @property
    def start(self) -> Column:
        """Offset of each frame in ``data``: (n,) int64 [bytes]."""
        return self.table[:, scan.START]

    @property
    def end(self) -> Column:
        """Offset of the byte after each frame: (n,) int64 [bytes]."""
        return self.table[:, scan.END]

    @property
    def payload(self) -> Column:
        """Offset of each frame's payload: (n,) int64 [bytes]."""
        return self.table[:, scan.PAYLOAD]

    @property
    def length(self) -> Column:
        """Size of each payload: (n,) int64 [bytes]."""
        return self.table[:, scan.LENGTH]

    @property
    def message(self) -> Column:
        """Number of each message: (n,) int64."""
        return self.table[:, scan.MESSAGE]

    @property
    def system(self) -> Column:
        """Who sent it, system id: (n,) int64."""
        return self.table[:, scan.SYSTEM]

    @property
    def component(self) -> Column:
        """Who sent it, component id: (n,) int64."""
        return self.table[:, scan.COMPONENT]

    @property
    def sequence(self) -> Column:
        """The sender's count of frames, modulo 256: (n,) int64."""
        return self.table[:, scan.SEQUENCE]

    @property
    def stamp_us(self) -> Column:
        """Unix time that a telemetry log gives: (n,) int64 [us]."""
        return self.table[:, scan.STAMP_US]

    @property
    def position(self) -> Column:
        """Offset of each frame in the whole stream: (n,) int64 [bytes]."""
        return self.table[:, scan.POSITION]

    @staticmethod
    def at(
        data: bytes, starts: list[int], stamped: list[bool] | None = None, origin: int = 0
    ) -> Frames:
        """The frames that start at ``starts``; ``data`` stands at ``origin``."""
        if not starts:
            return _NONE
        table = np.empty((len(starts), scan.COLUMNS), np.int64)
        table[:, 0] = 2 * np.array(starts)
        if stamped is not None:
            table[:, 0] += stamped
        scan.frame_columns(data, origin, table)
        return Frames(data, table)

    def take(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> Frames:
        """Some of the frames, over the same bytes."""
        return Frames(self.data, self.table[index])

    @staticmethod
    def join(first: Frames, second: Frames) -> Frames:
        """Frames of two consecutive blocks as one."""
        if not len(first):
            return second
        if not len(second):
            return first
        table = np.concatenate([first.table, second.table])
        table[len(first) :, [scan.START, scan.END, scan.PAYLOAD]] += len(first.data)
        return Frames(first.data + second.data, table)


_NONE = Frames(b"", np.empty((0, scan.COLUMNS), np.int64))


class Framer:
    """Cuts a byte stream into checked frames.

    Parameters
    ----------
    dialect
        Its CRC_EXTRA table decides which messages can be checked.
    stamped
        An 8-byte Unix stamp stands before each frame (telemetry logs).

    Attributes
    ----------
    bytes
        Bytes fed so far.
    bad_bytes
        Bytes that belonged to no frame (and to no stamp).
    unknown
        Message number -> frames passed over because the dialect has no such message; of numbers
        beyond the first :data:`UNKNOWN_MAX`, all under :data:`OTHER`.
    state : (scan.STATES,) int64
        What the search keeps.
    """

    def __init__(self, dialect: Dialect, *, stamped: bool = False) -> None:
        self._extras = dialect.extras
        self._rest = b""
        self._rejected: Counter[tuple[str, Rejection]] = Counter()
        self.state = scan.new_state(stamped=stamped)
        self.bytes = 0
        self.bad_bytes = 0
        self.unknown: Counter[int] = Counter()

    def feed(self, data: bytes) -> Frames:
        """Frames completed by ``data``; what is incomplete waits for more."""
        return self._scan(self.take(data))

    def finish(self) -> Frames:
        """Frames among the waiting bytes, now that no more will come; ready for a new stream."""
        frames = self._scan(self.take_last())
        self.state[scan.FINAL] = 0
        return frames

    @property
    def pending(self) -> int:
        """Bytes fed last that wait for more."""
        return len(self._rest)

    def take_rejected(self) -> Counter[tuple[str, Rejection]]:
        """What was rejected since the last call, by reason (under ``"frame"``)."""
        taken, self._rejected = self._rejected, Counter()
        return taken

    # for who calls the search itself, as the decoder's kernel does: take, search, settle

    def take(self, data: bytes) -> bytes:
        """The block to search: what waited, then ``data``."""
        self.bytes += len(data)
        if self._rest:
            data, self._rest = self._rest + data, b""
        return data if type(data) is bytes else bytes(data)

    def take_last(self) -> bytes:
        """The last block to search; set ``state[FINAL]`` back to 0 when it is settled."""
        self.state[scan.FINAL] = 1
        return self.take(b"")

    def settle(self, block: bytes, table: Column) -> None:
        """Keep what must be shown again and count what was no frame."""
        *_, unknown, _, keep, wrong, truncated, garbage = self.state.tolist()
        self._rest = block[keep:]
        if unknown:
            self._count_unknown(table[len(table) - unknown :, 0].tolist())
            self._rejected["frame", Rejection.UNKNOWN_MESSAGE] += unknown
        if wrong or truncated or garbage:
            self.bad_bytes += garbage
            counts = (
                (Rejection.BAD_CRC, wrong),
                (Rejection.TRUNCATED, truncated),
                (Rejection.GARBAGE, garbage),
            )
            self._rejected.update({("frame", why): n for why, n in counts if n})
            self.state[scan.BAD_CRC :] = 0

    def _count_unknown(self, numbers: list[int]) -> None:
        for number in numbers:
            known = number in self.unknown or len(self.unknown) < UNKNOWN_MAX
            self.unknown[number if known else OTHER] += 1

    def _scan(self, block: bytes) -> Frames:
        table = np.empty((scan.room(len(block)), scan.COLUMNS), np.int64)
        origin = self.bytes - len(block)
        scan.scan_frames(block, self._extras, self.state, origin, table)
        self.settle(block, table)
        found = int(self.state[scan.FOUND])
        return Frames(block, table[:found]) if found else _NONE
