"""What every reader of a log file is: its batches, what it says of the file, how it refuses one.

A reader is iterated once. It reads the file in bounded chunks, so that a file larger than memory
works, and gives the same rows for any size of a chunk, numbered in the file's order. What the bytes
are is never an exception: a file of which nothing can be used ends in :class:`LogError` with one
plain sentence, and all else that is not usable is counted by reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Protocol

from links.clock import VehicleClock
from links.mavlink.options import Vehicle
from links.ranking import SourcesUsed
from links.samples import Batch

__all__ = ["CHUNK", "MAX_GAPS", "LogError", "LogInfo", "LogReader", "read_chunks"]

CHUNK = 1 << 20
"""Bytes read at a time."""

MAX_GAPS = 1000
"""Gaps of one log that are listed."""


class LogError(Exception):
    """A log file that cannot be used; the message is one plain sentence."""


@dataclass(slots=True)
class LogInfo:
    """What a log file is; complete when it has been read to its end.

    Attributes
    ----------
    path, format
        The file; ``"tlog"``, ``"bin"`` or ``"ulg"``.
    bytes, bytes_read
        Size of the file, and how much of it has been read.
    messages, bad_bytes
        Usable messages of all senders; bytes that belonged to none.
    first_t_us, last_t_us
        Vehicle time of the log's first record and newest vehicle time [us]. The first record may
        have no time of its own; the Unix stamps of a telemetry log tell how long it was before
        those that have (negative when the record is older than the vehicle's boot).
    start_unix_us, end_unix_us
        Unix time of the first and the last record [us], None where the log does not tell it.
    vehicle
        Whose log it is; all zero before it is known.
    sources
        Sensor -> messages that it was taken from, the most used first.
    gaps
        (time of the last record before the gap [us], its length [us]), the first 1000; Unix time
        in a telemetry log, vehicle time in others.
    notes
        What of the log could not be used although it is whole, in plain sentences.
    """

    path: Path
    format: str
    bytes: int = 0
    bytes_read: int = 0
    messages: int = 0
    bad_bytes: int = 0
    first_t_us: int = 0
    last_t_us: int = 0
    start_unix_us: int | None = None
    end_unix_us: int | None = None
    vehicle: Vehicle = field(default_factory=lambda: Vehicle(0, 0, 0))
    sources: dict[str, str] = field(default_factory=dict)
    gaps: list[tuple[int, int]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def duration_s(self) -> float:
        """Vehicle time from the first record to the newest sample [s]."""
        return (self.last_t_us - self.first_t_us) * 1e-6

    def note_rows(self, clock: VehicleClock, sensors: SourcesUsed) -> None:
        """Take over what the rows read so far tell: newest time, messages of each sensor."""
        self.last_t_us = clock.newest_us or 0
        self.sources = sensors.messages()


class LogReader(Protocol):
    """Iterates a log's batches; ``info`` tells the rest."""

    @property
    def info(self) -> LogInfo:
        """What the file is, as far as it has been read."""
        ...

    def __iter__(self) -> Iterator[Batch]:
        """The batches in the file's order.

        Raises
        ------
        LogError
            The file cannot be read, or nothing in it can be used.
        """
        ...


def read_chunks(info: LogInfo, chunk: int) -> Iterator[bytes]:
    """The file's bytes, ``chunk`` at a time; sets ``info.bytes``.

    Raises
    ------
    LogError
        The file cannot be read.
    """
    try:
        with open(info.path, "rb") as file:
            info.bytes = _size(file)
            while data := file.read(chunk):
                yield data
    except OSError as error:
        raise LogError(f"cannot read {info.path}: {error.strerror or error}") from None


def _size(file: IO[bytes]) -> int:
    at = file.seek(0, 2)
    file.seek(0)
    return at
