"""What others say beside the vehicle's sensors: named values and texts of a log, as they stand.

A monitor that ran in flight published its verdicts as NAMED_VALUE_FLOAT and STATUSTEXT. A telemetry
log holds the frames themselves. ArduPilot logs a named value as ``NVAL`` with its sender and a text
as ``MSG`` behind ``SRC=<system>/<component>:``; PX4 logs a named value as ``debug_key_value``, of
anyone, and a text behind ``[mavlink: component <component>]``.

They are :data:`links.samples.WORD` and no rows of a sensor: what a monitor said never becomes its
input.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from links import catalog_ulog, dataflash_columns
from links.clock import ClockResult
from links.logs.records import Records
from links.mavlink.decode import Decoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Frames
from links.mavlink.rows import gather_payloads
from links.samples import WORD, Rows

__all__ = ["FrameWords", "record_words"]

_NAMED, _TEXT = "NAMED_VALUE_FLOAT", "STATUSTEXT"
_PREFIX = re.compile(rb"(?:SRC=(\d{1,3})/|\[mavlink: component )(\d{1,3})(?::|\] )")
_WANTED = {
    dataflash_columns.NAMED: ("Name", "Value", "SCom", "SSys"),
    dataflash_columns.TEXT: ("Message",),
    catalog_ulog.NAMED: ("key", "value"),
    catalog_ulog.LOGGED: ("text",),
}
"""Message -> its text, or its name, value and sender."""

_NOTHING = np.empty(0, WORD)


class FrameWords:
    """Words among the frames of a decoder, dated by the vehicle's frames before them.

    Parameters
    ----------
    decoder
        Asked after each of its ``feed`` and ``finish``.
    """

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        dialect = load_dialect(decoder.options.dialect)
        self._messages = (dialect.by_name[_NAMED], dialect.by_name[_TEXT])
        self._newest_us: int | None = None
        self._waiting: list[tuple[NDArray[np.int64], Rows]] = []

    def take(self) -> Rows:
        """Words of the vehicle's other components that the last bytes told: (n,) of WORD.

        While the decoder holds frames back they wait with them.
        """
        decoder, words = self._decoder, [_NOTHING]
        if (told := self._find(decoder.frames)) is not None:
            self._waiting.append(told)
        if self._waiting:  # else nobody asks when the vehicle's frames were
            frames, t_us, usable = decoder.timed
            if self._newest_us is not None or usable.any():
                times = frames.position[usable], t_us[usable]
                words += [self._date(*part, *times) for part in self._waiting]
                self._waiting = []
        self._newest_us = decoder.clock.newest_us
        return np.concatenate(words)

    def _find(self, frames: Frames) -> tuple[NDArray[np.int64], Rows] | None:
        """Positions and undated words of those who are not the autopilot."""
        ids = [message.id for message in self._messages]
        mask = (frames.message == ids[0]) | (frames.message == ids[1])
        mask &= frames.component != self._decoder.options.autopilot_component
        index = np.flatnonzero(mask)
        if self._newest_us is None:
            room = self._decoder.options.hold_back - sum(len(words) for _, words in self._waiting)
            index = index[:room]
        if not len(index):
            return None
        words = np.zeros(len(index), WORD)
        words["system"], words["component"] = frames.system[index], frames.component[index]
        for message in self._messages:
            mine = frames.message[index] == message.id
            payload = gather_payloads(frames, index[mine], message)
            for name in ("name", "value") if message.name == _NAMED else ("text",):
                words[name][mine] = payload[name]
        return frames.position[index], words

    def _date(
        self,
        position: NDArray[np.int64],
        words: Rows,
        told: NDArray[np.int64],
        t_us: NDArray[np.int64],
    ) -> Rows:
        """The vehicle's words, each with the newest time ``t_us`` told before it [us]."""
        first_us = t_us[0] if self._newest_us is None else self._newest_us
        newest_us = np.maximum.accumulate(np.concatenate([[first_us], t_us]))
        words["t_us"] = newest_us[np.searchsorted(told, position)]
        vehicle = self._decoder.vehicle
        return words if vehicle is None else words[words["system"] == vehicle.system_id]


def record_words(timed: Iterable[tuple[Records, ClockResult]]) -> Rows:
    """Words among the records of one chunk of a DataFlash log or a ULog, in its order.

    Parameters
    ----------
    timed
        Records and their times; those of other messages are passed over.
    """
    places, parts = [], []
    for records, times in timed:
        message, columns = records.message, records.columns
        if message not in _WANTED or not set(_WANTED[message]) <= set(columns.dtype.names or ()):
            continue
        words = np.zeros(len(columns), WORD)
        said = np.ones(len(columns), np.bool_)
        if len(fields := _WANTED[message]) == 1:
            said = _read_texts(columns[fields[0]], words)
        else:
            for into, field in zip(("name", "value", "component", "system"), fields, strict=False):
                words[into] = columns[field]
        said &= times.ok
        words["t_us"] = times.t_us
        places.append(records.place[said])
        parts.append(words[said])
    if not parts:
        return _NOTHING
    return np.concatenate(parts)[np.argsort(np.concatenate(places), kind="stable")]


def _read_texts(texts: NDArray[np.bytes_], words: Rows) -> NDArray[np.bool_]:
    """Fill words from texts with a sender before them; return which have one."""
    said = np.zeros(len(texts), np.bool_)
    for k, text in enumerate(texts.tolist()):
        if sender := _PREFIX.match(text):
            said[k] = True
            words["system"][k], words["component"][k] = sender[1] or 0, sender[2]
            words["text"][k] = text[sender.end() :]
    return said
