"""Telemetry logs (.tlog): MAVLink frames, each after an 8-byte big-endian Unix stamp.

Read in chunks through the same decoder as a live link, so that a log and the bytes that it recorded
give the same samples. Damaged and cut-off files are read as far as they go.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import numpy as np
from numpy.typing import NDArray

from links.mavlink.decode import Decoder
from links.mavlink.framing import NO_STAMP
from links.mavlink.options import DecoderOptions, Vehicle
from links.samples import Batch

__all__ = ["CHUNK", "LogError", "LogInfo", "TlogReader", "TlogWriter", "read_tlog"]

CHUNK = 1 << 20
"""Bytes read at a time."""

GAP_US = 5_000_000
"""Two stamps further apart than this are a gap of the recording [us]."""

_MAX_GAPS = 1000
_STAMP = struct.Struct(">Q")


class LogError(Exception):
    """A log file that cannot be used; the message is one plain sentence."""


@dataclass(slots=True)
class LogInfo:
    """What a log file is; complete when it has been read to its end.

    Attributes
    ----------
    path, format
        The file; ``"tlog"``.
    bytes, bytes_read
        Size of the file, and how much of it has been read.
    messages, bad_bytes
        Checked frames of all systems; bytes that belonged to no frame.
    first_t_us, last_t_us
        Vehicle time of the log's first record and newest vehicle time [us]. The first record may
        have no time of its own; the Unix stamps tell how long it was before those that have
        (negative when the record is older than the vehicle's boot).
    start_unix_us, end_unix_us
        First and last Unix stamp [us], None without one.
    vehicle
        Whose log it is; all zero before it is known.
    sources
        Sensor -> messages that it was taken from, the most used first.
    gaps
        (Unix time of the last stamp before the gap [us], its length [us]), the first 1000.
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

    @property
    def duration_s(self) -> float:
        """Vehicle time from the first record to the newest sample [s]."""
        return (self.last_t_us - self.first_t_us) * 1e-6


class TlogReader:
    """Iterates a telemetry log's batches; ``info`` and ``decoder`` tell the rest.

    Parameters
    ----------
    path
        The file; it is opened when iteration starts and read once.
    options
        How the messages are read.
    chunk
        Bytes read at a time; the samples do not depend on it.

    Raises
    ------
    LogError
        On iteration: the file cannot be read, or no vehicle speaks in it.
    """

    def __init__(
        self, path: Path, options: DecoderOptions | None = None, *, chunk: int = CHUNK
    ) -> None:
        self.decoder = Decoder(options, stamped=True)
        self.info = LogInfo(path, "tlog")
        self._chunk = chunk

    def __iter__(self) -> Iterator[Batch]:
        path = self.info.path
        try:
            with open(path, "rb") as file:
                self.info.bytes = path.stat().st_size
                while data := file.read(self._chunk):
                    yield self._note(self.decoder.feed(data))
        except OSError as error:
            raise LogError(f"cannot read {path}: {error.strerror or error}") from None
        yield self._note(self.decoder.finish())
        if self.info.messages == 0:
            raise LogError(f"{path} has no MAVLink message in it")
        if self.decoder.vehicle is None:
            raise LogError(f"{path} has no message of a vehicle in it")

    def _note(self, batch: Batch) -> Batch:
        info, decoder = self.info, self.decoder
        info.bytes_read, info.bad_bytes = decoder.counters.bytes, decoder.counters.bad_bytes
        info.messages, info.vehicle = decoder.counters.messages, decoder.vehicle or info.vehicle
        info.last_t_us = decoder.clock.newest_us or 0
        info.sources = {
            sensor: ", ".join(message for message, _ in used.most_common())
            for sensor, used in decoder.sources.items()
        }
        self._note_stamps(decoder.frames.stamp_us)
        info.first_t_us = decoder.first_t_us or 0
        offset = decoder.t_us_of_unix_zero
        if offset is not None and info.start_unix_us is not None:
            info.first_t_us = min(info.start_unix_us + offset, info.first_t_us)
        return batch

    def _note_stamps(self, stamps: NDArray[np.int64]) -> None:
        info = self.info
        stamps = stamps[stamps != NO_STAMP]
        if not len(stamps):
            return
        before = stamps[0] if info.end_unix_us is None else info.end_unix_us
        steps = np.diff(stamps, prepend=before)
        for i in np.flatnonzero(steps > GAP_US)[: _MAX_GAPS - len(info.gaps)].tolist():
            info.gaps.append((int(stamps[i] - steps[i]), int(steps[i])))
        if info.start_unix_us is None:
            info.start_unix_us = int(stamps[0])
        info.end_unix_us = int(stamps[-1])


def read_tlog(
    path: Path | str, options: DecoderOptions | None = None, *, chunk: int = CHUNK
) -> TlogReader:
    """Batches of a telemetry log, read in bounded chunks."""
    return TlogReader(Path(path), options, chunk=chunk)


class TlogWriter:
    """Writes frames with their stamps; usable as a context manager.

    Raises
    ------
    OSError
        When the file cannot be made or written to.
    """

    def __init__(self, path: Path | str) -> None:
        self._file: IO[bytes] = open(path, "wb", buffering=1 << 16)  # noqa: SIM115

    def write(self, frame: bytes, unix_us: int) -> None:
        """Append one frame received or sent at ``unix_us`` [us]."""
        self._file.write(_STAMP.pack(unix_us) + frame)

    def flush(self) -> None:
        """Hand what was written to the operating system."""
        self._file.flush()

    def close(self) -> None:
        """Flush and close."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
