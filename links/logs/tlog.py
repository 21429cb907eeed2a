"""Telemetry logs (.tlog): MAVLink frames, each after an 8-byte big-endian Unix stamp.

Read in chunks through the same decoder as a live link, so that a log and the bytes that it recorded
give the same samples. Damaged and cut-off files are read as far as they go.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import numpy as np
from numpy.typing import NDArray

from links.logs.base import CHUNK, MAX_GAPS, LogError, LogInfo
from links.logs.words import FrameWords
from links.mavlink.columns import ColumnDecoder, Columns
from links.mavlink.decode import Decoder
from links.mavlink.framing import NO_STAMP
from links.mavlink.options import DecoderOptions
from links.samples import Batch

__all__ = ["TlogReader", "TlogWriter", "read_tlog", "tlog_columns"]

DAY_US = 86_400_000_000
"""No record is older than this before the first that has a time of its own [us]."""

GAP_US = 5_000_000
"""Two stamps further apart than this are a gap of the recording [us]."""

_STAMP = struct.Struct(">Q")


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
        self._words = FrameWords(self.decoder)
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
            raise LogError(f"{path} has no MAVLink message in it: it is no telemetry log (.tlog)")
        if self.decoder.vehicle is None:
            raise LogError(f"{path} has no message of a vehicle in it, only of others")

    def _note(self, batch: Batch) -> Batch:
        info, decoder = self.info, self.decoder
        info.bytes_read, info.bad_bytes = decoder.counters.bytes, decoder.counters.bad_bytes
        info.messages, info.vehicle = decoder.counters.messages, decoder.vehicle or info.vehicle
        info.note_rows(decoder.clock, decoder.sensors)
        theirs = decoder.frames.component != decoder.options.own_component
        self._note_stamps(decoder.frames.stamp_us[theirs])
        info.first_t_us = decoder.first_t_us or 0
        offset = decoder.t_us_of_unix_zero
        if offset is not None and info.start_unix_us is not None:
            stamped = info.start_unix_us + offset
            if 0 < info.first_t_us - stamped < DAY_US:  # else the stamps are no times
                info.first_t_us = stamped
        return replace(batch, words=self._words.take())

    def _note_stamps(self, stamps: NDArray[np.int64]) -> None:
        info = self.info
        stamps = stamps[stamps != NO_STAMP]
        if not len(stamps):
            return
        before = stamps[0] if info.end_unix_us is None else info.end_unix_us
        steps = np.diff(stamps, prepend=before)
        for i in np.flatnonzero(steps > GAP_US)[: MAX_GAPS - len(info.gaps)].tolist():
            info.gaps.append((int(stamps[i] - steps[i]), int(steps[i])))
        if info.start_unix_us is None:
            info.start_unix_us = int(stamps[0])
        info.end_unix_us = int(stamps[-1])


def read_tlog(
    path: Path | str, options: DecoderOptions | None = None, *, chunk: int = CHUNK
) -> TlogReader:
    """Batches of a telemetry log, read in bounded chunks."""
    return TlogReader(Path(path), options, chunk=chunk)


def tlog_columns(
    path: Path | str,
    dialect: str = "ardupilotmega",
    *,
    messages: Collection[str] | None = None,
) -> Columns:
    """Every field of a telemetry log's messages, all at once: it must fit into memory.

    Parameters
    ----------
    messages
        Names of those wanted; None for all.

    Raises
    ------
    LogError
        The file cannot be read.
    ValueError
        When pymavlink has no such dialect, or the dialect no such message.
    """
    decoder = ColumnDecoder(dialect, stamped=True, messages=messages)
    try:
        with open(path, "rb", buffering=0) as file:
            return decoder.finish_file(file)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from None


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
