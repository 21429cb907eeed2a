"""Faults injected into the frames of a log: what :class:`RowInjector` does to rows, on the wire.

Every message that carries a faulty sensor is changed, whichever the monitor would use: RAW_IMU as
well as SCALED_IMU, NAMED_VALUE_FLOAT AS2 as well as SCALED_PRESSURE2. Fields keep their
quantisation: integers round to the nearest and saturate, and both is counted.

A dropout takes the frame out, unless it carries other sensors too: then the sensor's fields become
NaN (which a receiver must not use), or 0 where the field is an integer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Frames
from links.mavlink.options import DecoderOptions
from links.mavlink.patch import Carried, Carrier, blank_rows, is_signed, put_rows, reframe
from links.samples import Rows
from sim_feeds.injection import Injection
from sim_feeds.injection_core import InjectionCore, Stream

__all__ = ["FrameInjector", "Tally"]

Mask = NDArray[np.bool_]


@dataclass(slots=True)
class Tally:
    """What was done to one sensor in one message.

    Attributes
    ----------
    readings
        Readings that a fault touched.
    changed
        Of these, how many stand changed in their frame; the rest was lost to rounding.
    clipped
        Of these, how many the field could not hold: it holds the nearest that it can.
    removed
        Frames taken out.
    blanked
        Readings taken out of frames that carry other sensors as well.
    """

    readings: int = 0
    changed: int = 0
    clipped: int = 0
    removed: int = 0
    blanked: int = 0


class FrameInjector:
    """Breaks sensors in a stream of MAVLink frames; where it is cut changes nothing.

    Parameters
    ----------
    injection
        What breaks.
    seed
        Of the noise.
    first_us
        Vehicle time of the log's first record [us].
    options
        How the stream is read; the dialect among them.
    autopilot
        MAV_AUTOPILOT of the vehicle.
    leave
        (sensor, message) that stay as they are: a VFR_HUD that does not mirror the sensor.

    Attributes
    ----------
    tallies
        (sensor, message) -> what was done.
    unsigned
        Changed frames whose signature had to be taken off.
    """

    def __init__(
        self,
        injection: Injection,
        seed: int = 0,
        first_us: int = 0,
        options: DecoderOptions | None = None,
        autopilot: int | None = None,
        leave: frozenset[tuple[str, str]] = frozenset(),
    ) -> None:
        options = options or DecoderOptions()
        self._core = InjectionCore(injection.faults, injection.attitude, seed, first_us)
        self._dialect = load_dialect(options.dialect)
        self._carrier = Carrier(self._dialect, options, autopilot, frozenset(self._core.needs))
        self._leave = leave
        self.tallies: dict[tuple[str, str], Tally] = {}
        self.unsigned = 0

    def apply(self, frame: bytes, t_us: int) -> bytes:
        """One frame as the broken sensors send it, empty for none.

        Parameters
        ----------
        frame
            A whole frame with a right checksum.
        t_us
            Its vehicle time [us].
        """
        frames = Frames.at(frame, [0])
        changes = self.change(frames, np.array([t_us]), np.ones(1, np.bool_))
        return changes.get(0, frame)

    def change(self, frames: Frames, t_us: NDArray[np.int64], usable: Mask) -> dict[int, bytes]:
        """Frames that are to be replaced: their numbers, their new bytes (none: taken out).

        Parameters
        ----------
        frames
            Consecutive frames of the vehicle.
        t_us : (n,) int64 [us]
            Vehicle time of each.
        usable : (n,) bool
            False where a frame has no usable time: it stays as it is.
        """
        carried = {
            _stream(c): c
            for c in self._carrier.read(frames, t_us, usable)
            if (c.sensor, c.entry.source.message) not in self._leave
        }
        rows = {stream: c.rows for stream, c in carried.items()}
        touched: dict[int, Mask] = {}
        silent: list[tuple[Carried, NDArray[np.int64]]] = []
        for stream, (after, keep) in self._core.apply(rows).items():
            c = carried[stream]
            self._put(c, after, keep, touched)
            if not keep.all():
                silent.append((c, c.at[~keep]))
        out: dict[int, bytes] = {}
        self._silence(silent, touched, out)
        for group, mask in touched.items():
            self._encode(frames, group, mask, out)
        return out

    def _tally(self, c: Carried) -> Tally:
        return self.tallies.setdefault((c.sensor, c.entry.source.message), Tally())

    def _touch(self, group: int, touched: dict[int, Mask]) -> Mask:
        return touched.setdefault(group, np.zeros(len(self._carrier.payloads[group][0]), np.bool_))

    def _put(self, c: Carried, after: Rows, keep: Mask, touched: dict[int, Mask]) -> None:
        """Put the changed rows of one stream into its payloads."""
        after = after.copy()
        after[~keep] = c.rows[~keep]
        payload = self._carrier.payloads[c.group][1]
        part = payload[c.at]
        put = put_rows(c.entry, part, c.rows, after)
        payload[c.at] = part
        self._touch(c.group, touched)[c.at] |= put.changed
        tally = self._tally(c)
        tally.readings += int(np.count_nonzero(put.differs | ~keep))
        tally.changed += int(np.count_nonzero(put.changed))
        tally.clipped += int(np.count_nonzero(put.clipped))

    def _silence(
        self,
        silent: list[tuple[Carried, NDArray[np.int64]]],
        touched: dict[int, Mask],
        out: dict[int, bytes],
    ) -> None:
        """Take out frames whose sensors are all silent; in others blank those that are."""
        count: dict[int, NDArray[np.int64]] = {}
        for c, at in silent:
            silents = count.setdefault(
                c.group, np.zeros(len(self._carrier.payloads[c.group][0]), np.int64)
            )
            silents[at] += 1
        for c, at in silent:
            index, payload = self._carrier.payloads[c.group]
            alone = count[c.group][at] == self._carrier.sensors_in(c.group)[at]
            tally = self._tally(c)
            tally.removed += int(np.count_nonzero(alone))
            tally.blanked += int(np.count_nonzero(~alone))
            out.update(dict.fromkeys(index[at[alone]].tolist(), b""))
            part = payload[at[~alone]]
            blank_rows(c.entry, part)
            payload[at[~alone]] = part
            touch = self._touch(c.group, touched)
            touch[at[~alone]] = True
            touch[at[alone]] = False

    def _encode(self, frames: Frames, group: int, mask: Mask, out: dict[int, bytes]) -> None:
        index, payload = self._carrier.payloads[group]
        message = self._dialect.by_id[group]
        for i, fields in zip(index[mask].tolist(), payload[mask], strict=True):
            frame = frames.data[int(frames.start[i]) : int(frames.end[i])]
            self.unsigned += is_signed(frame)
            out[i] = reframe(frame, message, fields.tobytes())


def _stream(c: Carried) -> Stream:
    """Best message first; the order tells two of one rank apart."""
    return c.sensor, c.entry.rank * 1024 + c.entry.order
