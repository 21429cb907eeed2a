"""PX4's ULog (.ulg) to the same batches as a live link gives.

The reader is our own and not pyulog, which reads a whole file into memory and message by message.
Before it begins it looks at the first megabytes for how often each topic is logged: a logger's
profile may keep every sample of one topic and every hundredth of another that says the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from links import catalog_ulog as table
from links.catalog import AUTOPILOT_PX4
from links.clock import UNIX_FROM_US
from links.logs.base import CHUNK, MAX_GAPS, LogError, LogInfo, read_chunks
from links.logs.records import RecordRows, Records
from links.logs.ulog_format import MAGIC, START, Block, Note, Topic, TopicRows, UlogParser
from links.logs.words import record_words
from links.mavlink.options import DecoderOptions, Vehicle
from links.samples import Batch, Rows
from links.spool_records import ulog_spools, with_spools

__all__ = ["UlogReader", "columns_of", "read_ulog"]

HEAD = 4 << 20
"""Bytes of a log's beginning that tell how often each topic is logged."""

_SELDOM = 0.5  # of the rate of the topic that is logged most often
_FEW = 5  # messages from which a rate can be told
_MAX_AGE_US = 1_000_000  # a sample older than this at its publication has no usable time
_START_WITHIN_US = 60_000_000  # the header's time is that far from the first samples, or damaged
_INSTANCES = frozenset(s.message for s in table.SOURCES if s.instance is not None)
_WHOLE = frozenset({"fix_type", "satellites_used", "system_type", "nav_state", "arming_state"})
_TEXT = frozenset({"key"})

_NONE = np.empty(0, np.int64)
_PARAMETER = np.dtype([("name", "S16"), ("value", "<f8")])
_LOGGED = np.dtype([("severity", "<i4"), ("text", "S128")])


def columns_of(payload: Rows) -> Rows:
    """The same data with a column for each number, by pyulog's names: ``q[0]``, ``esc[0].rpm``."""
    found: dict[str, tuple[np.dtype[np.void], int]] = {}
    _flatten(payload.dtype, "", 0, found)
    return payload.view(
        np.dtype(
            {
                "names": list(found),
                "formats": [f for f, _ in found.values()],
                "offsets": [at for _, at in found.values()],
                "itemsize": payload.dtype.itemsize,
            }
        )
    )


def _flatten(
    dtype: np.dtype[np.void], prefix: str, at: int, found: dict[str, tuple[np.dtype[np.void], int]]
) -> None:
    for name, (field, offset, *_) in (dtype.fields or {}).items():
        one, shape = (field, ()) if field.subdtype is None else field.subdtype
        for k in range(shape[0] if shape else 1):
            label = f"{prefix}{name}[{k}]" if shape else prefix + name
            place = at + offset + k * one.itemsize
            if one.names is not None:
                _flatten(one, label + ".", place, found)
            elif _usable(one, label):
                found[label] = (one, place)


def _usable(dtype: np.dtype[np.void], label: str) -> bool:
    """Numbers, whole ones where they name something, and text where it is expected."""
    if label in _TEXT or dtype.kind == "S":
        return label in _TEXT and dtype.kind == "S"
    return dtype.kind in "iu" if label in _WHOLE else True


class UlogReader:
    """Iterates a ULog's batches; ``info`` tells the rest.

    Parameters
    ----------
    path
        The file; it is opened when iteration starts.
    options
        How MAVLink is read; of it the rankings (by this format's own keys), engine-speed channels,
        named inputs and time-outs hold here too.
    chunk
        Bytes read at a time; the samples do not depend on it.

    Raises
    ------
    LogError
        On iteration: the file cannot be read, or nothing in it can be used.
    """

    def __init__(
        self, path: Path, options: DecoderOptions | None = None, *, chunk: int = CHUNK
    ) -> None:
        self._options = options or DecoderOptions()
        self._chunk = chunk
        self._offset_pa = 0.0
        self._start_us = 0
        self._newest_us = 0
        self.info = LogInfo(path, "ulg", vehicle=Vehicle(0, 0, 0))

    def __iter__(self) -> Iterator[Batch]:
        info, options = self.info, self._options
        named = table.named_sources(options.named_inputs)
        sources = with_spools((*table.SOURCES, *named), ulog_spools(options))
        rows = RecordRows(
            sources,
            self._ranking(options.ranked(table.RANKING, sources)),
            timeout_us=options.source_timeout_us,
            settle_us=options.settle_us,
        )
        wanted = rows.wanted
        parser = UlogParser(wanted.__contains__)
        for data in read_chunks(info, self._chunk):
            yield self._use(parser.feed(data), parser, rows)
        yield self._use(parser.finish(), parser, rows)
        if parser.incompatible:
            raise LogError(f"{info.path} is a ULog of a kind that this version cannot read")
        if not parser.counts:
            raise LogError(f"{info.path} has no data of a vehicle's sensors in it")

    def _ranking(self, ranking: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
        """A ranking with topics that are logged seldom behind the others, unless it was chosen."""
        rates = self._rates()
        for quantity in ("imu", "gps", "airspeed"):
            keys = ranking[quantity]
            if keys == table.RANKING[quantity]:
                best = max((rates.get(key, 0.0) for key in keys), default=0.0)
                ranking[quantity] = tuple(
                    sorted(keys, key=lambda key: 0.0 < rates.get(key, 0.0) < _SELDOM * best)
                )
        fast = tuple(k for k in ranking["imu"] if rates.get(k, 0.0) >= table.IMU_LEAST_HZ)
        watched = f"imu0 is watched by {fast[0]}" if fast else "no IMU is watched"
        self.info.notes = [
            f"{key} was logged at {rates[key]:.2g} Hz, too seldom to watch an IMU by "
            f"({table.IMU_LEAST_HZ:g} Hz at least): {watched}"
            for key in ranking["imu"]
            if 0.0 < rates.get(key, 0.0) < table.IMU_LEAST_HZ
        ]
        ranking["imu"] = fast
        return ranking

    def _rates(self) -> dict[str, float]:
        """Topic -> rate of its first instance in the beginning of the log [1/s]."""
        keys = {key for keys in table.RANKING.values() for key in keys}
        parser = UlogParser(keys.__contains__)
        head = next(read_chunks(self.info, HEAD), b"")
        if head.startswith(MAGIC):
            self._start_us = int.from_bytes(head[len(MAGIC) + 1 : START], "little")
        rates: dict[str, float] = {}
        data = parser.feed(head).data
        firsts = [int(_stamps(part.topic, columns_of(part.payload))[0]) for part in data]
        if not firsts or abs(float(np.median(firsts)) - self._start_us) > _START_WITHIN_US:
            self._start_us = 0
        for part in data:
            stamps = np.unique(_stamps(part.topic, columns_of(part.payload)))
            if part.topic.instance == 0 and len(stamps) >= _FEW:
                rates[part.topic.name] = 1e6 / float(np.median(np.diff(stamps)))
        return rates

    # ------------------------------------------------------------------ blocks

    @np.errstate(all="ignore")  # what a log holds may be no number at all
    def _use(self, block: Block, parser: UlogParser, rows: RecordRows) -> Batch:
        records = [r for part in block.data if (r := self._records(part, block)) is not None]
        place = np.concatenate([_NONE, *(r.place for r in records)])
        order = np.argsort(place)
        stamp = np.concatenate([_NONE, *(r.stamp_us for r in records)])[order]
        records += self._notes(block.notes, place[order], stamp)
        if len(stamp):
            self._newest_us = int(stamp[-1])
        batch = rows.feed(records, Counter(block.rejected))
        batch = replace(batch, words=record_words(rows.timed))
        info = self.info
        info.bytes_read, info.bad_bytes = parser.bytes, parser.bad_bytes
        info.messages = parser.messages
        first = rows.first_t_us or 0
        info.first_t_us = self._start_us if 0 < self._start_us <= first else first
        info.note_rows(rows.clock, rows.sensors)
        return batch

    def _records(self, part: TopicRows, block: Block) -> Records | None:
        topic, columns = part.topic, columns_of(part.payload)
        if topic.instance and topic.name not in _INSTANCES:
            return None
        names = columns.dtype.names or ()
        if topic.name == "differential_pressure" and "differential_pressure_pa" in names:
            columns = self._less_offset(part, columns, block)
        if topic.name == "vehicle_status":
            self._identify(columns)
        if topic.name in table.RECEIVED and self.info.start_unix_us is None:
            self._date(columns)
        return Records(
            topic.name, columns, part.order, _stamps(topic, columns), instance=topic.instance
        )

    def _less_offset(self, part: TopicRows, columns: Rows, block: Block) -> Rows:
        """Raw differential pressure less SENS_DPRES_OFF, as PX4 itself uses it."""
        steps = [(-1, self._offset_pa)]
        for note in block.notes:
            keyed = note.keyed if note.kind == "P" else None
            if keyed is not None and keyed[1] == "SENS_DPRES_OFF" and note.number is not None:
                steps.append((note.order, note.number))
        at = np.searchsorted([order for order, _ in steps], part.order, side="right") - 1
        columns = columns.copy()
        columns["differential_pressure_pa"] -= np.array([value for _, value in steps])[at]
        return columns

    def _identify(self, columns: Rows) -> None:
        if self.info.vehicle.autopilot == 0:
            names = columns.dtype.names or ()
            system = int(columns["system_id"][0]) if "system_id" in names else 1
            kind = int(columns["system_type"][0]) if "system_type" in names else 0
            self.info.vehicle = Vehicle(system, AUTOPILOT_PX4, kind)

    def _date(self, columns: Rows) -> None:
        """Unix time of the log's first record, by the receiver's first time."""
        names = columns.dtype.names or ()
        if "time_utc_usec" in names and columns.dtype["time_utc_usec"].kind == "u":
            told = np.flatnonzero(columns["time_utc_usec"] >= UNIX_FROM_US)
            if len(told) and "timestamp" in names and self._start_us:
                row = columns[told[0]]
                lead = int(row["timestamp"]) - self._start_us
                self.info.start_unix_us = int(row["time_utc_usec"]) - lead

    def _notes(
        self, notes: list[Note], place: NDArray[np.int64], stamp: NDArray[np.int64]
    ) -> Iterator[Records]:
        """Parameters and logged messages as records; drop-outs go to the log's gaps.

        ``place`` and ``stamp`` are those of the block's data: what has no time of its own takes
        that of the data before it, at the log's beginning that of the header.
        """
        told: dict[str, list[tuple[int, int, tuple[object, ...]]]] = {}
        for note in notes:
            before = int(np.searchsorted(place, note.order))
            now_us = int(stamp[before - 1]) if before else self._newest_us or self._start_us
            if note.kind == "P":
                keyed, number = note.keyed, note.number
                if keyed is not None and number is not None:
                    if keyed[1] == "SENS_DPRES_OFF":
                        self._offset_pa = number
                    value = (keyed[1].encode("utf-8", "replace"), number)
                    told.setdefault(table.PARAMETER, []).append((note.order, now_us, value))
            elif note.kind in "LC":
                at = 1 if note.kind == "L" else 3
                told_us = int.from_bytes(note.body[at : at + 8], "little")
                said = (note.body[0] - ord("0"), note.body[at + 8 :])
                told.setdefault(table.LOGGED, []).append((note.order, told_us, said))
            elif note.kind == "O" and len(self.info.gaps) < MAX_GAPS:
                lasted_us = int.from_bytes(note.body, "little") * 1000
                self.info.gaps.append((now_us, lasted_us))
        for message, dtype in ((table.PARAMETER, _PARAMETER), (table.LOGGED, _LOGGED)):
            if lines := told.get(message):
                yield Records(
                    message,
                    np.array([value for _, _, value in lines], dtype),
                    np.array([order for order, _, _ in lines], np.int64),
                    np.array([min(s, UNIX_FROM_US) for _, s, _ in lines], np.int64),
                )


def _stamps(topic: Topic, columns: Rows) -> NDArray[np.int64]:
    """When each sample was taken, else when it was published [us]; 0 where it is not told."""
    names = columns.dtype.names or ()
    if "timestamp" not in names or columns.dtype["timestamp"] != np.dtype("<u8"):
        return np.zeros(len(columns), np.int64)
    published: NDArray[np.int64] = np.minimum(columns["timestamp"], UNIX_FROM_US).astype(np.int64)
    sampled = "timestamp_sample"
    if topic.name in table.RECEIVED or sampled not in names:
        return published
    if columns.dtype[sampled] != np.dtype("<u8"):
        return published
    taken: NDArray[np.int64] = np.minimum(columns[sampled], UNIX_FROM_US).astype(np.int64)
    fresh = (taken > 0) & (taken <= published) & (published - taken < _MAX_AGE_US)
    return np.where(fresh, taken, published)


def read_ulog(
    path: Path | str, options: DecoderOptions | None = None, *, chunk: int = CHUNK
) -> UlogReader:
    """Batches of a ULog, read in bounded chunks."""
    return UlogReader(Path(path), options, chunk=chunk)
