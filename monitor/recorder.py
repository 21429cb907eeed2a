"""Keeps the raw link as telemetry logs, within a bound on the disk.

What is recorded is what was received, frame by frame with its arrival, before anything judged it:
``mavsentry analyze`` on a recording gives the verdicts of the flight again. Between stands what was
published, so that it can be compared with them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from links.logs.tlog import TlogWriter
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer, Frames
from monitor.settings.recorder import RecorderSettings

__all__ = ["Recorder", "whole_frames"]

_STAMP_BYTES = 8
_PATTERN = "mavsentry-*.tlog"


def whole_frames(frames: Frames) -> Iterator[tuple[bytes, int]]:
    """Bytes of each frame, from its magic to its checksum or signature, and its stamp [us]."""
    columns = (frames.start, frames.end, frames.stamp_us)
    for start, end, stamp_us in zip(*(c.tolist() for c in columns), strict=True):
        yield frames.data[start:end], stamp_us


class Recorder:
    """Writes what is received and sent into ``DIR/mavsentry-<start in UTC>-<number>.tlog``.

    A disk that is full or gone while it runs ends the recording and nothing else: ``stopped`` then
    says why.

    Parameters
    ----------
    folder
        Made if it is not there.
    settings
        Bounds of a file and of the folder.
    dialect
        Whose frames are recognised.

    Attributes
    ----------
    stopped
        Why nothing is recorded any more, in one sentence; None while it is.
    file_bytes, bytes
        Of the file being written, and of all since the start.

    Raises
    ------
    OSError
        The folder cannot be made or written to.
    """

    def __init__(
        self, folder: Path, settings: RecorderSettings, dialect: str = "ardupilotmega"
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file_max = settings.file_max_mb * 1e6
        self._total_max = settings.total_max_mb * 1e6
        self._framer = Framer(load_dialect(dialect))
        self._unix_from_host_us = time.time_ns() // 1000 - time.monotonic_ns() // 1000
        self._stem = time.strftime("mavsentry-%Y%m%dT%H%M%SZ", time.gmtime())
        self._newest_us = time.time_ns() // 1000
        self._number = 0
        self.stopped: str | None = None
        self.file_bytes = self.bytes = 0
        self._writer = self._open()

    @property
    def path(self) -> Path:
        """The file being written."""
        return self._folder / f"{self._stem}-{self._number:03d}.tlog"

    def take(self, data: bytes, host_us: int) -> None:
        """Record the frames that these bytes complete, stamped with their arrival."""
        if self.stopped is not None:
            return
        self._newest_us = self._unix_from_host_us + host_us
        try:
            self._write(self._framer.feed(data))
            self._go_on()
        except OSError as error:
            self._stop(error)

    def take_sent(self, frame: bytes, host_us: int) -> None:
        """Record one whole frame of our own; bytes received that make none yet wait beside it."""
        if self.stopped is not None:
            return
        self._newest_us = max(self._newest_us, self._unix_from_host_us + host_us)
        try:
            self._put(frame)
            self._go_on()
        except OSError as error:
            self._stop(error)

    def close(self) -> None:
        """Record what still waited for more bytes, and finish the file."""
        if self.stopped is not None:
            return
        try:
            self._write(self._framer.finish())
            self._writer.close()
        except OSError as error:
            self._stop(error)

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _stop(self, error: OSError) -> None:
        """That was the last that could be recorded."""
        self.stopped = f"recording has stopped: {error.strerror or error}"
        with suppress(OSError):
            self._writer.close()

    def _write(self, frames: Frames) -> None:
        for frame, _ in whole_frames(frames):
            self._put(frame)

    def _put(self, frame: bytes) -> None:
        self._writer.write(frame, self._newest_us)
        self.file_bytes += _STAMP_BYTES + len(frame)
        self.bytes += _STAMP_BYTES + len(frame)

    def _go_on(self) -> None:
        """Begin the next file where this one is full."""
        if self.file_bytes > self._file_max:
            self._writer.close()
            self._number += 1
            self._writer = self._open()

    def _open(self) -> TlogWriter:
        self.file_bytes = 0
        self._make_room()
        return TlogWriter(self.path)

    def _make_room(self) -> None:
        """Delete the oldest recordings so that with one more full file the folder is in bounds."""
        kept = sorted(self._folder.glob(_PATTERN), key=lambda p: (p.stat().st_mtime_ns, p.name))
        total = sum(p.stat().st_size for p in kept)
        for old in kept:
            if total + self._file_max <= self._total_max:
                return
            total -= old.stat().st_size
            old.unlink()
