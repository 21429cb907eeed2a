"""ArduPilot's DataFlash (.BIN) to the same batches as a live link gives.

Before it begins the reader looks at the first megabytes for which of ArduPilot's filters ran.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from links import catalog_dataflash as table
from links.clock import UNIX_FROM_US, VehicleClock
from links.dataflash_columns import COLUMNS, EKF2, PARAMETER, VEHICLE, WHOLE
from links.logs.base import CHUNK, LogError, LogInfo, read_chunks
from links.logs.dataflash_format import Table, first_format
from links.logs.dataflash_parser import DataflashParser
from links.logs.records import RecordRows, Records
from links.logs.words import record_words
from links.mavlink.options import DecoderOptions, Vehicle
from links.samples import Batch, Rows
from links.spool_records import dataflash_spools, with_spools
from links.vocabulary import Rejection

__all__ = ["DataflashReader", "read_dataflash", "warm_up"]

HEAD = 4 << 20
"""Bytes of a log's beginning that tell which filter ran."""

_WEEK_US = 7 * 86_400_000_000
_GPS_EPOCH_US = 315_964_800_000_000
_DATE = ("Status", "GMS", "GWk")
_LEAP_US = 18_000_000  # GPS time is ahead of UTC by so much since 2017
_FIX_3D = 3
_TEXT = frozenset({"Name", "Message"})
_SYSTEM = (b"SYSID_THISMAV", b"MAV_SYSID")
_NAMES = {b"ArduPlane": 3, b"ArduCopter": 2, b"ArduRover": 1, b"ArduSub": 7, b"Rover": 1}
_VEHICLE = np.dtype([("Type", "<i8")])
_REASONS = (
    (Rejection.GARBAGE, "bad_bytes"),
    (Rejection.TRUNCATED, "cut"),
    (Rejection.UNKNOWN_MESSAGE, "unknown"),
)
_NONE = np.empty(0, np.int64)


class DataflashReader:
    """Iterates a DataFlash log's batches; ``info`` tells the rest.

    Parameters
    ----------
    path
        The file; it is opened when iteration starts.
    options
        How MAVLink is read; of it the rankings (by this format's own keys), engine-speed channels,
        named inputs, components of those and time-outs hold here too.
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
        self._alias: dict[str, str] = {}
        self._counted: Counter[tuple[str, Rejection]] = Counter()
        self._logs = 0
        self._system = 0
        self.info = LogInfo(path, "bin", vehicle=Vehicle(0, 0, 0))

    def __iter__(self) -> Iterator[Batch]:
        info, options = self.info, self._options
        named = table.named_sources(
            options.named_inputs, options.own_component, options.components.get("NAMED_VALUE_FLOAT")
        )
        sources = with_spools((*table.SOURCES, *named), dataflash_spools(options))
        rows = RecordRows(
            sources,
            options.ranked(table.RANKING, sources),
            parameters=(PARAMETER, "Name", "Value"),
            timeout_us=options.source_timeout_us,
            settle_us=options.settle_us,
            airspeed_ratio=options.airspeed_ratio,
        )
        self._choose_filter()
        parser = DataflashParser(rows.wanted.union(self._alias, ("VER",)))
        for data in read_chunks(info, self._chunk):
            info.bytes_read += len(data)
            for tables in parser.feed(data):
                yield self._use(tables, parser, rows)
        for tables in parser.finish():
            yield self._use(tables, parser, rows)
        yield self._use([], parser, rows)
        if not any(name in parser.by_name for name in rows.wanted):
            raise LogError(f"{info.path} has no data of a vehicle's sensors in it")

    def _choose_filter(self) -> None:
        """Read EKF2's messages as EKF3's where it ran alone."""
        parser = DataflashParser(frozenset())
        head = next(read_chunks(self.info, HEAD), b"")
        for _ in (*parser.feed(head), *parser.finish()):
            pass
        if "NKF1" in parser.by_name and "XKF1" not in parser.by_name:
            self._alias = dict(EKF2)

    # ------------------------------------------------------------------ steps

    @np.errstate(all="ignore")  # what a log holds may be no number at all
    def _use(self, tables: list[Table], parser: DataflashParser, rows: RecordRows) -> Batch:
        records = []
        for part in tables:
            name = self._alias.get(part.format.name, part.format.name)
            if name not in COLUMNS:
                continue
            columns = _columns(part, COLUMNS[name])
            known = len(columns.dtype.names or ())
            if known < (2 if name == PARAMETER else 1):
                continue
            stamps = _stamps(part)
            records.append(Records(name, columns, part.place, stamps))
            if name == PARAMETER and not self._system:
                self._note_system(columns)
            elif name in ("VER", "MSG") and (told := _vehicles(records[-1])) is not None:
                records.append(told)
                self._identify(int(told.columns["Type"][0]))
        begins, self._logs = parser.logs > self._logs, parser.logs
        batch = rows.feed(records, self._rejected(parser), begins=begins)
        batch = replace(batch, words=record_words(rows.timed))
        for part in tables:
            if part.format.name == "GPS" and self.info.start_unix_us is None:
                self._date(part, _stamps(part), rows.first_t_us or 0)
        info = self.info
        info.gaps = rows.gaps
        info.messages, info.bad_bytes = parser.records, parser.bad_bytes
        info.first_t_us = rows.first_t_us or 0
        info.note_rows(rows.clock, rows.sensors)
        return batch

    def _rejected(self, parser: DataflashParser) -> Counter[tuple[str, Rejection]]:
        """What the parser rejected since it was asked last."""
        now = Counter({("frame", why): getattr(parser, name) for why, name in _REASONS})
        new, self._counted = now - self._counted, now
        return new

    def _note_system(self, columns: Rows) -> None:
        for name in _SYSTEM:
            told = columns["Value"][columns["Name"] == name]
            if len(told) and 0 < told[0] < 256:
                self._system = int(told[0])
                vehicle = self.info.vehicle
                self.info.vehicle = Vehicle(self._system, vehicle.autopilot, vehicle.type)

    def _identify(self, kind: int) -> None:
        if self.info.vehicle.autopilot == 0:
            self.info.vehicle = Vehicle(self._system, table.AUTOPILOT_ARDUPILOT, kind)

    def _date(self, part: Table, stamps: NDArray[np.int64], first_us: int) -> None:
        """Unix time of the log's first record, by a receiver's first time."""
        kinds = [part.format.kind(n) if n in part.format.columns else "" for n in _DATE]
        if any(kind not in ("i", "u") for kind in kinds):
            return
        status, ms, week = (part.column(name).astype(np.int64) for name in _DATE)
        told = np.flatnonzero((status >= _FIX_3D) & (week > 0) & (stamps > 0))
        if len(told):
            i = told[0]
            unix_us = _GPS_EPOCH_US + int(week[i]) * _WEEK_US + int(ms[i]) * 1000 - _LEAP_US
            start_us = unix_us - (int(stamps[i]) - first_us)
            if start_us >= UNIX_FROM_US:
                self.info.start_unix_us = start_us


def _columns(part: Table, wanted: dict[str, str]) -> Rows:
    """The columns that the table reads, in its units; those of an unusable type are left out."""
    found = {}
    for name, unit in wanted.items():
        if name not in part.format.columns:
            continue
        raw = part.column(name)
        if raw.ndim != 1 or (raw.dtype.kind == "S") != (name in _TEXT):
            continue
        if name in WHOLE:
            if raw.dtype.kind in "iu":
                found[name] = raw.astype(np.int64)
        elif name in _TEXT:
            found[name] = raw
        else:
            found[name] = np.asarray(part.values(name, unit), np.float64)
    columns = np.empty(len(part), [(name, value.dtype) for name, value in found.items()])
    for name, value in found.items():
        columns[name] = value
    return columns


def _stamps(part: Table) -> NDArray[np.int64]:
    """Time since boot of each record [us], 0 where it is not told; as ``Records`` has it."""
    for name, us in (("TimeUS", 1), ("TimeMS", 1000)):
        kind = part.format.kind(name)
        if kind in ("i", "u"):
            wide = part.column(name).astype(f"{kind}8")
            stamps: NDArray[np.int64] = np.clip(wide, 0, UNIX_FROM_US // us).astype(np.int64)
            return stamps * us
    return np.zeros(len(part), np.int64)


def _vehicles(part: Records) -> Records | None:
    """What VER or MSG tell of the vehicle's type."""
    names = part.columns.dtype.names or ()
    if "BU" in names:
        told = [int(build) for build in part.columns["BU"]]
    elif "Message" in names:
        words = (text.split(b" ")[0] for text in part.columns["Message"].tolist())
        told = [_NAMES.get(word, 0) for word in words]
    else:
        return None
    types = np.array([table.VEHICLE_TYPES.get(build, 0) for build in told], np.int64)
    use = types > 0
    if not use.any():
        return None
    columns = np.empty(int(use.sum()), _VEHICLE)
    columns["Type"] = types[use]
    return Records(VEHICLE, columns, part.place[use], np.zeros(len(columns), np.int64))


def warm_up() -> None:
    """Load the compiled kernels, by a log that has nothing but the FMT of FMT."""
    layout = first_format()
    body = (128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    record = b"\xa3\x95\x80" + np.array([body], layout.dtype).tobytes()
    for _ in DataflashParser().feed(2 * record):
        VehicleClock().advance(_NONE, _NONE, _NONE, {})


def read_dataflash(
    path: Path | str, options: DecoderOptions | None = None, *, chunk: int = CHUNK
) -> DataflashReader:
    """Batches of a DataFlash log, read in bounded chunks."""
    return DataflashReader(Path(path), options, chunk=chunk)
