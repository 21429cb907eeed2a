"""Frames changed in place: fields decoded by the catalogue, changed, encoded again. Sans-IO.

The catalogue says which field of which message carries which sensor; here its conversions are
undone. A changed frame keeps its header, version and sequence number; MAVLink 2 payloads lose
their trailing zeros again, the checksum is made anew, and a signature, which could only be made
with the vehicle's key, is taken off. Whatever is not changed stays byte by byte as it was.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from fastcrc.crc16 import mcrf4xx
from numpy.typing import NDArray

from links import catalog
from links.catalog import Fill
from links.mavlink.decode import Decoder
from links.mavlink.dialect import CRC_TABLE, Dialect, Message
from links.mavlink.framing import NO_STAMP, Frames
from links.mavlink.options import DecoderOptions
from links.mavlink.pitot_ratios import PitotRatios
from links.mavlink.rows import build_rows, gather_payloads, instances
from links.mavlink.sourcing import Entry, source_table
from links.samples import Rows

__all__ = ["Carried", "Carrier", "Put", "StreamPatcher", "blank_rows", "put_rows", "reframe"]

Mask = NDArray[np.bool_]

SENSING = frozenset({"imu", "attitude", "gps", "nav", "airspeed", "baro", "aoa", "spool"})
"""Quantities that a sensor delivers; a frame that delivers nothing else can be left out."""

_V2, _HEAD_V1, _HEAD_V2, _SIGNED, _STAMP = 0xFD, 6, 10, 0x01, 8


# ----------------------------------------------------------------------------- fields


@dataclass(frozen=True, slots=True)
class Put:
    """What became of values that were put into payloads.

    Attributes
    ----------
    differs : (n,) bool
        Payloads of which a value was to become another.
    changed : (n,) bool
        Payloads of which a field did become another; rounding may have undone it.
    clipped : (n,) bool
        Payloads of which a field could not hold its value and holds its nearest.
    """

    differs: Mask
    changed: Mask
    clipped: Mask

    @staticmethod
    def nothing(n: int) -> Put:
        """Of ``n`` payloads in which nothing was put yet."""
        return Put(*(np.zeros(n, np.bool_) for _ in range(3)))


def put_rows(entry: Entry, payload: Rows, before: Rows, after: Rows) -> Put:
    """Write what differs between two versions of rows into the payloads they came from.

    Parameters
    ----------
    payload : (n,) structured
        Changed in place; fields of values that do not differ keep their bits.
    before, after : (n,) structured
        Rows of the source as they were built, and as they shall be.
    """
    put = Put.nothing(len(payload))
    for fill in entry.source.fills:
        old, new = before[fill.into], after[fill.into]
        differs: Mask = ~((old == new) | _both_nan(old, new))
        if differs.any():
            put.differs[...] |= differs if differs.ndim == 1 else differs.any(axis=1)
            _put(fill, payload, new, differs, put)
    stamp = catalog.STAMPS.get(entry.source.message)
    if stamp is not None and "stamp_us" in (after.dtype.names or ()):
        differs = np.asarray(before["stamp_us"] != after["stamp_us"])
        _write(payload, stamp[0], after["stamp_us"] / float(stamp[2]), differs, put)
    return put


def blank_rows(entry: Entry, payload: Rows) -> None:
    """Take a sensor's values out of payloads that carry others too: NaN, or 0 in integers."""
    n, put = len(payload), Put.nothing(len(payload))
    for fill in entry.source.fills:
        shape = (n, len(fill.fields)) if len(fill.fields) > 1 else (n,)
        _put(fill, payload, np.full(shape, np.nan), np.ones(shape, np.bool_), put)


def _put(fill: Fill, payload: Rows, new: NDArray[Any], differs: Mask, put: Put) -> None:
    if fill.compute is not None:
        if fill.invert is not None:
            at = np.asarray(differs if differs.ndim == 1 else differs.any(axis=1))
            for name, value in fill.invert(payload, new).items():
                _write(payload, name, value, at, put)
    elif len(fill.fields) == 1:
        _write(payload, fill.fields[0], (new - fill.offset) / fill.scale, differs, put)
    else:
        for k, name in enumerate(fill.fields):
            value = (new[:, k] - fill.offset) / fill.scale
            _write(payload, name, value, np.asarray(differs[:, k]), put)


def _write(payload: Rows, name: str, value: NDArray[Any], at: Mask, put: Put) -> None:
    """One wire field: integers are rounded to the nearest, kept in range, and 0 for NaN."""
    field = payload[name]
    if field.dtype.kind != "f":
        info = np.iinfo(field.dtype)
        value = np.rint(np.where(np.isfinite(value), value, 0.0))
        low, high = float(info.min), float(info.max)
        outside = (value < low) | (value > high)
        beyond = np.asarray(outside if outside.ndim == 1 else outside.any(axis=1))
        put.clipped[...] |= beyond & at
        value = np.clip(value, low, high)
    old = field.copy()
    field[at] = value[at].astype(field.dtype)
    other: Mask = (field != old) & ~_both_nan(field, old)
    put.changed[...] |= other if other.ndim == 1 else other.any(axis=1)


def _both_nan(a: NDArray[Any], b: NDArray[Any]) -> Mask:
    both: Mask = (a != a) & (b != b)
    return both


def reframe(frame: bytes, message: Message, payload: bytes) -> bytes:
    """The frame with another payload: checksum anew, unsigned, MAVLink 2 without trailing zeros.

    Parameters
    ----------
    frame
        One whole MAVLink 1 or 2 frame.
    message
        Its message.
    payload
        All fields in wire order; what the frame carries beyond the dialect's fields is kept.
    """
    length = frame[1]
    if frame[0] == _V2:
        payload += frame[_HEAD_V2 + len(payload) : _HEAD_V2 + length]
        payload = payload.rstrip(b"\0") or b"\0"
        head = bytes((_V2, len(payload), frame[2] & ~_SIGNED)) + frame[3:_HEAD_V2]
    else:
        payload = payload[:length] + frame[_HEAD_V1 + len(payload) : _HEAD_V1 + length]
        head = frame[:_HEAD_V1]
    body = head + payload
    crc = mcrf4xx(body[1:])
    crc = (crc >> 8) ^ CRC_TABLE[(crc ^ message.crc_extra) & 0xFF]
    return body + crc.to_bytes(2, "little")


def is_signed(frame: bytes) -> bool:
    """Whether a MAVLink 2 frame carries a signature."""
    return frame[0] == _V2 and bool(frame[2] & _SIGNED)


# ----------------------------------------------------------------------------- who carries what


@dataclass(frozen=True, slots=True)
class Carried:
    """Rows of one sensor as one message carries it, among the frames of a block.

    Attributes
    ----------
    sensor, entry
        The sensor, and the source that gives it.
    rows : (n,) structured
        Usable rows with ``t_us`` and ``seq`` (the frame's number times 1024 plus the source's).
    group
        Number of the message; key of :attr:`Carrier.payloads`.
    at : (n,) int64
        Places of the rows among the payloads of the group.
    """

    sensor: str
    entry: Entry
    rows: Rows
    group: int
    at: NDArray[np.int64]


class Carrier:
    """Reads every source of some sensors from consecutive blocks of frames, ranked or not.

    Parameters
    ----------
    dialect, options, autopilot
        As of the decoder.
    sensors
        Sensors wanted; None for all that are sensed.

    Attributes
    ----------
    payloads
        Message number -> indices of its frames in the last block, their payloads.
    """

    def __init__(
        self,
        dialect: Dialect,
        options: DecoderOptions,
        autopilot: int | None,
        sensors: frozenset[str] | None = None,
    ) -> None:
        self.dialect, self._options, self._wanted = dialect, options, sensors
        self._table = {
            number: wanted
            for number, entries in source_table(dialect, options, autopilot).items()
            if (wanted := [e for e in entries if e.source.quantity in SENSING])
        }
        self._ratios = PitotRatios(options.airspeed_ratio)
        self._parameter = dialect.by_name["PARAM_VALUE"].id
        self._count = 0
        self.payloads: dict[int, tuple[NDArray[np.int64], Rows]] = {}

    def read(self, frames: Frames, t_us: NDArray[np.int64], usable: Mask) -> Iterator[Carried]:
        """What the frames carry of the sensors.

        Parameters
        ----------
        frames
            Frames of the vehicle.
        t_us : (n,) int64 [us]
            Vehicle time of each.
        usable : (n,) bool
            False where a frame has no usable time; its readings are not used.
        """
        first, self._count = self._count, self._count + len(frames)
        self.payloads = {}
        autopilot = frames.component == self._options.autopilot_component
        self._note_ratios(frames, autopilot)
        component = None if autopilot.all() else frames.component
        for number in sorted(set(frames.message.tolist()) & self._table.keys()):
            index = np.flatnonzero(frames.message == number)
            payload = gather_payloads(frames, index, self.dialect.by_id[number]).copy()
            self.payloads[number] = index, payload
            for entry in self._table[number]:
                mine = entry.theirs(payload, None if component is None else component[index])
                places = np.flatnonzero(usable[index] if mine is None else mine & usable[index])
                for sensor, part in instances(entry.source, payload[places]):
                    if self._wanted is not None and sensor not in self._wanted:
                        continue
                    at = places if part is None else places[part]
                    rows, good = self._rows(entry, sensor, index, payload, at)
                    if not len(rows):
                        continue
                    frame = index[at[good]]
                    rows["t_us"] = t_us[frame]
                    rows["seq"] = (first + frame) * 1024 + entry.order
                    yield Carried(sensor, entry, rows, number, at[good])

    def sensors_in(self, number: int) -> NDArray[np.int64]:
        """How many sensors each frame of a message carries, in the last block: (n,)."""
        index, payload = self.payloads[number]
        count = np.zeros(len(index), np.int64)
        for entry in self._table[number]:
            mine = entry.theirs(payload, None)
            count += 1 if mine is None else mine
        return count

    def _rows(
        self,
        entry: Entry,
        sensor: str,
        index: NDArray[np.int64],
        payload: Rows,
        at: NDArray[np.int64],
    ) -> tuple[Rows, Mask]:
        if sensor == entry.source.quantity and entry.source.instance is not None:
            return payload[:0], np.empty(0, np.bool_)
        ratio = self._ratios.at(int(sensor[-1]), index[at]) if entry.source.ratio else None
        rows, good = build_rows(entry.source, sensor, payload[at], Counter(), ratio)
        if "stamp_us" in (rows.dtype.names or ()):
            wire, _, unit = catalog.STAMPS[entry.source.message]
            rows["stamp_us"] = payload[wire][at].astype(np.int64) * unit
        return rows[good], good

    def _note_ratios(self, frames: Frames, autopilot: Mask) -> None:
        self._ratios.begin_block()
        index = np.flatnonzero((frames.message == self._parameter) & autopilot)
        if len(index):
            message = self.dialect.by_id[self._parameter]
            self._ratios.note(index, gather_payloads(frames, index, message))


# ----------------------------------------------------------------------------- streams

Change = Callable[[Frames, NDArray[np.int64], Mask], Mapping[int, bytes]]
"""(the vehicle's frames, their times, which are usable) -> number of a frame, its new bytes."""


class StreamPatcher:
    """Copies a MAVLink stream and replaces some of the vehicle's frames.

    Parameters
    ----------
    change
        Which frames become what; empty bytes take a frame out, with its stamp.
    options
        How the stream is read.
    stamped
        The stream is a telemetry log: an 8-byte stamp before each frame.

    Attributes
    ----------
    decoder
        Reads the stream; its times are those that its samples have.
    """

    def __init__(
        self, change: Change, options: DecoderOptions | None = None, *, stamped: bool = True
    ) -> None:
        self.decoder = Decoder(options, stamped=stamped)
        self._change = change
        self._prefix = _STAMP if stamped else 0
        self._waiting = b""
        self._written = 0  # of the stream that came in

    def feed(self, data: bytes) -> bytes:
        """The part of the copy that is settled now."""
        self._waiting += data
        self.decoder.feed(data)
        return self._pour(self.decoder.undecided + self._prefix)

    def finish(self) -> bytes:
        """The rest of the copy: the stream has ended."""
        self.decoder.finish()
        return self._pour(0)

    def _pour(self, keep: int) -> bytes:
        frames, t_us, usable = self.decoder.timed
        changes = self._change(frames, t_us, usable) if len(frames) else {}
        origin, pieces, at = self._written, [], 0
        for i in sorted(changes):
            start = int(frames.position[i]) - origin
            end = start + int(frames.end[i] - frames.start[i])
            stamp = self._prefix if frames.stamp_us[i] != NO_STAMP and not changes[i] else 0
            pieces += [self._waiting[at : start - stamp], changes[i]]
            at = end
        stop = max(at, len(self._waiting) - keep)
        pieces.append(self._waiting[at:stop])
        self._written += stop
        self._waiting = self._waiting[stop:]
        return b"".join(pieces)
