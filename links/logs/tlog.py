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

from links.mavlink.decode import Decoder, DecoderOptions, Vehicle
from links.mavlink.framing import NO_STAMP
from links.samples import Batch

__all__ = ["CHUNK", "LogInfo", "TlogReader", "TlogWriter", "read_tlog"]

CHUNK = 1 << 20
"""Bytes read at a time."""

GAP_US = 5_000_000
"""Two stamps further apart than this are a gap of the recording [us]."""

_MAX_GAPS = 1000
_STAMP = struct.Struct(">Q")


@dataclass(slots=True)
class LogInfo:
    """What a log file is; complete when it has been read to its end.

    Attributes
    ----------
    format
        ``"tlog"``.
    bytes, messages, bad_bytes
        Size read, checked frames of all systems, bytes that belonged to no frame.
    first_t_us
        Smallest vehicle time of a sample [us], None before the first.
    start_unix_us, end_unix_us
        First and last stamp [us], None without a plausible one.
    vehicle
        Whose log it is, None when no autopilot speaks in it.
    gaps
        (Unix time of the last stamp before the gap [us], its length [us]), the first 1000.
    """

    format: str
    bytes: int = 0
    messages: int = 0
    bad_bytes: int = 0
    first_t_us: int | None = None
    start_unix_us: int | None = None
    end_unix_us: int | None = None
    vehicle: Vehicle | None = None
    gaps: list[tuple[int, int]] = field(default_factory=list)


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
    OSError
        On iteration, when the file cannot be read.
    """

    def __init__(
        self, path: Path, options: DecoderOptions | None = None, *, chunk: int = CHUNK
    ) -> None:
        self.path = path
        self.decoder = Decoder(options, stamped=True)
        self.info = LogInfo("tlog")
        self._chunk = chunk

    def __iter__(self) -> Iterator[Batch]:
        with open(self.path, "rb") as file:
            while data := file.read(self._chunk):
                yield self._note(self.decoder.feed(data))
        yield self._note(self.decoder.finish())

    def _note(self, batch: Batch) -> Batch:
        info, counters = self.info, self.decoder.counters
        info.bytes, info.bad_bytes = counters.bytes, counters.bad_bytes
        info.messages, info.vehicle = counters.messages, self.decoder.vehicle
        for rows in batch.rows.values():
            first = int(rows["t_us"].min())
            info.first_t_us = first if info.first_t_us is None else min(first, info.first_t_us)
        stamps = self.decoder.frames.stamp_us
        stamps = stamps[stamps != NO_STAMP]
        if len(stamps):
            before = stamps[0] if info.end_unix_us is None else info.end_unix_us
            steps = np.diff(stamps, prepend=before)
            for i in np.flatnonzero(steps > GAP_US)[: _MAX_GAPS - len(info.gaps)].tolist():
                info.gaps.append((int(stamps[i] - steps[i]), int(steps[i])))
            if info.start_unix_us is None:
                info.start_unix_us = int(stamps[0])
            info.end_unix_us = int(stamps[-1])
        return batch


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
