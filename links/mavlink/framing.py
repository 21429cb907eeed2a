"""Bytes to frames: MAVLink 1 and 2, sans-IO, nothing lost after garbage.

A frame is believed when its checksum (CRC-16/MCRF4XX over header and payload, then the message's
CRC_EXTRA) is right. After bytes that are no frame the search goes on from the very next byte, so
damage costs only the frames that it touched. A decision is taken only when all of its bytes are
there: the frames found do not depend on how the stream was cut.

A telemetry log puts an 8-byte big-endian Unix stamp before each frame; with ``stamped=True`` the
framer expects it and reports it, and still finds frames whose stamp is missing or damaged.

A message whose number the dialect does not have cannot be checked. It is passed over, and counted,
only where frames that can be checked follow it without a gap; otherwise its bytes are searched.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from fastcrc.crc16 import mcrf4xx
from numpy.typing import NDArray

from links.mavlink.dialect import CRC_TABLE, Dialect
from links.vocabulary import Rejection

__all__ = ["MAX_FRAME", "NO_STAMP", "Framer", "Frames"]

MAX_FRAME = 280
"""Longest frame: MAVLink 2, 255 bytes of payload, signed [bytes]."""

NO_STAMP = -1
"""Value of :attr:`Frames.stamp_us` where a frame has no stamp."""

_V1, _V2 = 0xFE, 0xFD
_HEAD_V1, _HEAD_V2 = 6, 10
_SIGNED = 0x01
_SIGNATURE = 13
_STAMP = 8
_MAGIC = re.compile(b"[\xfd\xfe]")
_UNKNOWN_CHAIN = 8  # unknown frames in a row that are believed without a checked one after them


class _Look(IntEnum):
    KNOWN = 0
    UNKNOWN = 1
    BAD_CRC = 2
    NO_FRAME = 3
    WAIT = 4


@dataclass(frozen=True, slots=True)
class Frames:
    """Checked frames in arrival order, as columns over one block of bytes.

    Attributes
    ----------
    data : bytes
        The block that the offsets point into.
    start, end, payload, length : (n,) int64 [bytes]
        Offsets of the frame, of the byte after it and of its payload; the payload's size.
    message, system, component, sequence : (n,) int64
        Header fields.
    stamp_us : (n,) int64 [us]
        Unix time that a telemetry log gives, else :data:`NO_STAMP`.
    position : (n,) int64 [bytes]
        Offset of the frame in the whole stream.
    """

    data: bytes
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    payload: NDArray[np.int64]
    length: NDArray[np.int64]
    message: NDArray[np.int64]
    system: NDArray[np.int64]
    component: NDArray[np.int64]
    sequence: NDArray[np.int64]
    stamp_us: NDArray[np.int64]
    position: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start)

    @staticmethod
    def at(
        data: bytes, starts: list[int], stamped: list[bool] | None = None, origin: int = 0
    ) -> Frames:
        """Columns of the frames that start at ``starts``; ``data`` stands at ``origin``."""
        start = np.array(starts, dtype=np.int64)
        n = len(start)
        if n == 0:
            none = np.empty(0, np.int64)
            return Frames(b"", none, none, none, none, none, none, none, none, none, none)
        raw = np.frombuffer(data, np.uint8)
        head = raw[start[:, None] + np.arange(_HEAD_V1)].astype(np.int64)
        v2 = head[:, 0] == _V2
        sequence = np.where(v2, head[:, 4], head[:, 2])
        system = np.where(v2, head[:, 5], head[:, 3])
        component, message = head[:, 4].copy(), head[:, 5].copy()
        at = start[v2]
        component[v2] = raw[at + 6]
        message[v2] = raw[at + 7] | raw[at + 8].astype(np.int64) << 8
        message[v2] |= raw[at + 9].astype(np.int64) << 16
        stamp = np.full(n, NO_STAMP, np.int64)
        if stamped is not None:
            has = np.array(stamped)
            at = start[has, None] - _STAMP + np.arange(_STAMP)
            value = np.ascontiguousarray(raw[at]).view(">u8")[:, 0]
            stamp[has] = np.where(value < 1 << 62, value, 0).astype(np.int64)
            stamp[stamp == 0] = NO_STAMP
        payload = start + np.where(v2, _HEAD_V2, _HEAD_V1)
        signed = v2 & ((head[:, 2] & _SIGNED) != 0)
        end = payload + head[:, 1] + 2 + np.where(signed, _SIGNATURE, 0)
        return Frames(
            data,
            start,
            end,
            payload,
            head[:, 1],
            message,
            system,
            component,
            sequence,
            stamp,
            start + origin,
        )

    def take(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> Frames:
        """Columns of some of the frames, over the same bytes."""
        return Frames(
            self.data,
            self.start[index],
            self.end[index],
            self.payload[index],
            self.length[index],
            self.message[index],
            self.system[index],
            self.component[index],
            self.sequence[index],
            self.stamp_us[index],
            self.position[index],
        )

    @staticmethod
    def join(first: Frames, second: Frames) -> Frames:
        """Frames of two consecutive blocks as one."""
        if not len(first):
            return second
        if not len(second):
            return first
        shift = len(first.data)
        both = np.concatenate
        return Frames(
            first.data + second.data,
            both([first.start, second.start + shift]),
            both([first.end, second.end + shift]),
            both([first.payload, second.payload + shift]),
            both([first.length, second.length]),
            both([first.message, second.message]),
            both([first.system, second.system]),
            both([first.component, second.component]),
            both([first.sequence, second.sequence]),
            both([first.stamp_us, second.stamp_us]),
            both([first.position, second.position]),
        )


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
        Message number -> frames passed over because the dialect has no such message.
    """

    def __init__(self, dialect: Dialect, *, stamped: bool = False) -> None:
        self._crc_extra = dialect.crc_extra
        self._prefix = _STAMP if stamped else 0
        self._rest = b""
        self._at = 0  # where in _rest the search goes on, when out of step
        self._in_step = True  # the next frame is expected right after the last (and its stamp)
        self._rejected: Counter[tuple[str, Rejection]] = Counter()
        self.bytes = 0
        self.bad_bytes = 0
        self.unknown: Counter[int] = Counter()

    def feed(self, data: bytes) -> Frames:
        """Frames completed by ``data``; what is incomplete waits for more."""
        self.bytes += len(data)
        return self._scan(self._rest + data, final=False)

    def finish(self) -> Frames:
        """Frames among the waiting bytes, now that no more will come; ready for a new stream."""
        return self._scan(self._rest, final=True)

    @property
    def pending(self) -> int:
        """Bytes fed last that wait for more."""
        return len(self._rest)

    def take_rejected(self) -> Counter[tuple[str, Rejection]]:
        """What was rejected since the last call, by reason (under ``"frame"``)."""
        taken, self._rejected = self._rejected, Counter()
        return taken

    def _look(self, buf: bytes, p: int) -> tuple[_Look, int]:
        """What stands at ``p``, and where it ends."""
        n = len(buf)
        if p >= n:
            return _Look.WAIT, p
        magic = buf[p]
        if magic == _V2:
            if n - p < _HEAD_V2 + 2:
                return _Look.WAIT, p
            flags = buf[p + 2]
            if flags & ~_SIGNED:  # a receiver must drop frames with flags that it does not know
                return _Look.NO_FRAME, p
            message = buf[p + 7] | buf[p + 8] << 8 | buf[p + 9] << 16
            body = p + _HEAD_V2 + buf[p + 1]
            end = body + 2 + (_SIGNATURE if flags else 0)
        elif magic == _V1:
            if n - p < _HEAD_V1 + 2:
                return _Look.WAIT, p
            message = buf[p + 5]
            body = p + _HEAD_V1 + buf[p + 1]
            end = body + 2
        else:
            return _Look.NO_FRAME, p
        if end > n:
            return _Look.WAIT, p
        extra = self._crc_extra.get(message)
        if extra is None:
            return _Look.UNKNOWN, end
        crc = mcrf4xx(buf[p + 1 : body])
        crc = (crc >> 8) ^ CRC_TABLE[(crc ^ extra) & 0xFF]
        return (_Look.KNOWN if crc == buf[body] | buf[body + 1] << 8 else _Look.BAD_CRC), end

    def _after_unknown(self, buf: bytes, end: int, final: bool) -> _Look:
        """KNOWN when checked frames follow an unknown one that ends at ``end``, else why not."""
        for _ in range(_UNKNOWN_CHAIN):
            if final and end == len(buf):
                return _Look.KNOWN
            look, end = self._look(buf, end + self._prefix)
            if look is not _Look.UNKNOWN:
                return look
        return _Look.KNOWN

    def _scan(self, buf: bytes, final: bool) -> Frames:
        prefix = self._prefix
        look_at = self._look
        good_end = 0  # everything before it in buf is accounted for
        at, in_step = self._at, self._in_step
        starts: list[int] = []
        stamped: list[bool] = []
        while True:
            if in_step:
                p = good_end + prefix
                if final and good_end == len(buf):
                    break
            else:
                magic = _MAGIC.search(buf, at)
                p = at = magic.start() if magic else len(buf)
                if magic is None:
                    break
            look, end = look_at(buf, p)
            if look is _Look.UNKNOWN:
                message = (
                    buf[p + 5] if buf[p] == _V1 else int.from_bytes(buf[p + 7 : p + 10], "little")
                )
                look = self._after_unknown(buf, end, final) if in_step else _Look.NO_FRAME
                if look is _Look.KNOWN:
                    self._reject(Rejection.UNKNOWN_MESSAGE)
                    self.unknown[message] += 1
                    good_end = end
                    continue
                if look is not _Look.WAIT:
                    look = _Look.NO_FRAME
            if look is _Look.KNOWN:
                skipped = p - good_end
                has_stamp = prefix > 0 and skipped >= prefix
                if skipped := skipped - (prefix if has_stamp else 0):
                    self._garbage(skipped)
                starts.append(p)
                stamped.append(has_stamp)
                good_end = end
                in_step = True
                continue
            if look is _Look.WAIT and not final:
                break
            if in_step:
                in_step = False
                at = good_end if prefix else p + 1
                if look is _Look.BAD_CRC:
                    self._reject(Rejection.BAD_CRC)
                elif look is _Look.WAIT:
                    self._reject(Rejection.TRUNCATED)
            else:
                at = p + 1
        origin = self.bytes - len(buf)
        frames = Frames.at(buf, starts, stamped if prefix else None, origin)
        if final:
            if len(buf) > good_end:
                self._garbage(len(buf) - good_end)
            self._rest, self._at, self._in_step = b"", 0, True
            return frames
        keep = good_end if in_step else max(good_end, at - prefix)
        if keep > good_end:
            self._garbage(keep - good_end)
        self._rest, self._at, self._in_step = buf[keep:], max(at - keep, 0), in_step
        return frames

    def _garbage(self, count: int) -> None:
        self.bad_bytes += count
        self._rejected["frame", Rejection.GARBAGE] += count

    def _reject(self, reason: Rejection) -> None:
        self._rejected["frame", reason] += 1
