"""A log of any length from a flight of some minutes: its circuits again and again, time going on.

To fly and encode an hour takes minutes; to go round once more takes shifted times and new
checksums. A flight that ends its last circuit where it began the first goes on without a jump.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from links.mavlink.dialect import CRC_TABLE, Message, load_dialect
from links.mavlink.framing import Framer, Frames

__all__ = ["Flight", "lengthen"]

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

_UNITS_US: Final = {"time_boot_ms": 1000, "time_usec": 1, "time_unix_usec": 1}
"""Fields that tell the time, and their units [us]."""

_STAMP = 8
_HEAD = 10
_TABLE = np.array(CRC_TABLE, np.uint16)


class Flight(NamedTuple):
    """A flight that may go on for ever.

    Attributes
    ----------
    log
        Telemetry log of unsigned MAVLink 2 frames.
    again_s
        Its last so many seconds come again: whole circuits.
    """

    log: Path
    again_s: float


def lengthen(flight: Flight, out: Path, seconds: float, leave_out: str = "") -> None:
    """Write a telemetry log of at least ``seconds`` of a flight.

    Parameters
    ----------
    leave_out
        Name of a message that is not written.
    """
    dialect = load_dialect()
    framer = Framer(dialect, stamped=True)
    frames = framer.feed(flight.log.read_bytes())
    if leave_out:
        frames = frames.take(frames.message != dialect.by_name[leave_out].id)
    stamp_us = frames.stamp_us
    lap_us = round(flight.again_s * 1e3) * 1000  # whole ms: else stamps of two units drift apart
    first = int(np.searchsorted(stamp_us, stamp_us[-1] - lap_us, "right"))
    again = frames.take(slice(first, None))
    laps = int(np.ceil((seconds * 1e6 - (stamp_us[-1] - stamp_us[0])) / lap_us))
    with open(out, "wb") as file:
        file.write(_joined(frames).tobytes())
        lap, groups = _joined(again), list(_groups(again, tuple(dialect.by_id.values())))
        for _ in range(laps):
            for message, at in groups:
                _shift(lap, message, at, lap_us)
            file.write(lap.tobytes())


def _joined(frames: Frames) -> Bytes:
    """Frames with their stamps, one behind the other."""
    data = frames.data
    spans = zip(frames.start.tolist(), frames.end.tolist(), strict=True)
    joined = b"".join(data[start - _STAMP : end] for start, end in spans)
    return np.frombuffer(bytearray(joined), np.uint8)


def _groups(frames: Frames, messages: tuple[Message, ...]) -> Iterator[tuple[Message, Ints]]:
    """Frames of one message and length each: where their bytes stand when joined, (n, length)."""
    size = frames.end - frames.start + _STAMP
    begin = np.cumsum(size) - size
    for message in messages:
        of_message = frames.message == message.id
        for length in np.unique(size[of_message]).tolist():
            mine = begin[of_message & (size == length)]
            yield message, mine[:, None] + np.arange(length)


def _shift(data: Bytes, message: Message, at: Ints, by_us: int) -> None:
    """Let the frames at these places be sent ``by_us`` later."""
    rows = data[at]
    stamp = rows[:, :_STAMP].copy().view(">u8")
    rows[:, :_STAMP] = (stamp + np.uint64(by_us)).astype(">u8").view(np.uint8)
    frame = rows[:, _STAMP:]
    length = frame.shape[1] - _HEAD - 2
    payload = np.zeros((len(rows), max(message.dtype.itemsize, length)), np.uint8)
    payload[:, :length] = frame[:, _HEAD:-2]
    fields = payload[:, : message.dtype.itemsize].copy().view(message.dtype)
    for name, unit_us in _UNITS_US.items():
        if name in message.wire_fields:
            fields[name][fields[name] > 0] += by_us // unit_us
    frame[:, _HEAD:-2] = fields.view(np.uint8)[:, :length]
    crc = np.full(len(rows), 0xFFFF, np.uint16)
    for column in (*frame[:, 1:-2].T, np.uint8(message.crc_extra)):
        crc = (crc >> 8) ^ _TABLE[(crc ^ column) & 0xFF]
    frame[:, -2], frame[:, -1] = crc & 0xFF, crc >> 8
    data[at] = rows
