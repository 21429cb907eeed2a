"""The folder of recordings: one file being written, the others within bounds of size and age.

A recording is a telemetry log as MAVProxy writes it: frames of all links in one file, each after an
8-byte big-endian Unix stamp [us] whose two lowest bits say where it passed: the number of the link
that it was received on (2 stands for all further ones), or 3 for what we sent.

Everything here may block for as long as the disk does; it runs in the recorder's thread.
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import struct
import time
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from contextlib import suppress
from io import FileIO
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

from links.mavlink.dialect import Dialect
from links.mavlink.framing import Framer, Frames
from monitor.settings.recorder import RecorderSettings

__all__ = ["SENT", "STAMP_BYTES", "Record", "TlogFiles", "mend", "whole_bytes"]

SENT = 3
"""Channel of what we sent."""

STAMP_BYTES = 8

TAIL_BYTES = 1 << 18
"""So much of the end of an interrupted recording is searched for its last whole frame at first."""

_PATTERN = "mavsentry-*.tlog"
_STAMP = struct.Struct(">Q")
_CHANNEL_BITS = 0b11
_DAY_S, _MINUTE_S, _MB = 86_400.0, 60.0, 1e6


class Record(NamedTuple):
    """A whole frame.

    Attributes
    ----------
    host_us
        When it arrived or was sent, host's monotonic clock [us].
    channel
        Number of the link that it was received on, :data:`SENT` for ours.
    frame
        From its magic to its checksum or signature.
    """

    host_us: int
    channel: int
    frame: bytes


class TlogFiles:
    """Writes records into ``DIR/mavsentry-<start in UTC>-<number>.tlog``.

    A file is locked (``flock``) while it is written: another recorder in the same folder leaves it
    alone. The wall clock is asked once, when a file is begun; within a file the stamps follow the
    monotonic clock, so that a wall clock that is set in flight tears nothing apart.

    Parameters
    ----------
    folder
        Must be there.
    settings
        Bounds of a file and of the folder.

    Attributes
    ----------
    path
        The file being written, or the last one that was.
    file_bytes, bytes
        Of that file, and of all since the start.
    """

    def __init__(self, folder: Path, settings: RecorderSettings) -> None:
        self._folder, self._settings = folder, settings
        self._file: FileIO | None = None
        self._stem = time.strftime("mavsentry-%Y%m%dT%H%M%SZ", time.gmtime())
        self._number = -1
        self._unix_from_host_us = self._newest_us = 0
        self._began_s = self._synced_s = 0.0
        self._unsynced = False
        self.path = folder / f"{self._stem}-000.tlog"
        self.file_bytes = self.bytes = 0

    @property
    def is_open(self) -> bool:
        """Whether there is a file to append to."""
        return self._file is not None

    def begin(self) -> None:
        """Close the file, make room, and begin the next.

        Raises
        ------
        OSError
            As of all methods: the disk is full or gone; :meth:`begin` tries again.
        """
        self.close()
        self._make_room()
        self._check_free()
        self._open()
        self._unix_from_host_us = time.time_ns() // 1000 - time.monotonic_ns() // 1000
        self._began_s = self._synced_s = time.monotonic()
        self._newest_us = 0

    def append(self, records: Iterable[Record]) -> None:
        """Write records, into further files where one is full.

        What the disk did not take whole is cut off again: the file ends with a whole record.
        """
        for part in self._parts(records):
            if self._is_full():
                self.begin()
            self._write(part)

    def tend(self) -> None:
        """What time makes due: fsync, and a look whether file and disk are still well."""
        if self._file is None:
            return
        if os.fstat(self._file.fileno()).st_nlink == 0:
            raise OSError(errno.ENOENT, "the file was deleted")
        now_s = time.monotonic()
        if self._unsynced and now_s - self._synced_s >= self._settings.sync_s:
            os.fsync(self._file.fileno())
            self._unsynced, self._synced_s = False, now_s
            self._check_free()

    def close(self) -> None:
        """Force the file onto the disk and close it."""
        if self._file is None:
            return
        file, self._file = self._file, None
        with file:  # closed, and with that unlocked, whatever fsync says
            os.fsync(file.fileno())

    def abandon(self) -> None:
        """Close the file after a failure, asking no more of the disk; an empty one is removed."""
        if self._file is not None:
            file, self._file = self._file, None
            with suppress(OSError):
                file.close()
            with suppress(OSError):
                if self.file_bytes == 0:
                    self.path.unlink()

    def mend_last(self, dialect: Dialect) -> str | None:
        """Cut off what an interrupted recorder left half written; say so in a sentence."""
        for _, path in reversed(self._kept()):
            if _is_free(path):
                cut = mend(path, dialect)
                words = f"its last record was half written, {cut} bytes were cut off"
                return f"mended {path.name}: {words}" if cut else None
        return None

    def _parts(self, records: Iterable[Record]) -> Iterator[list[Record]]:
        """The records, in parts after which a file may be full."""
        part: list[Record] = []
        room = self._settings.file_max_mb * _MB - self.file_bytes
        for record in records:
            part.append(record)
            room -= STAMP_BYTES + len(record.frame)
            if room < 0:
                yield part
                part, room = [], self._settings.file_max_mb * _MB
        if part:
            yield part

    def _write(self, part: list[Record]) -> None:
        assert self._file is not None, "begin() comes first"
        stamped = [_STAMP.pack(self._stamp_us(record)) + record.frame for record in part]
        block, done = memoryview(b"".join(stamped)), 0
        self._unsynced = True
        try:
            while done < len(block):
                done += self._file.write(block[done:]) or 0
        except OSError:
            ends = [0, *accumulate(map(len, stamped))]
            done = ends[bisect_right(ends, done) - 1]
            with suppress(OSError):
                self._file.truncate(self.file_bytes + done)
            raise
        finally:
            self.file_bytes += done
            self.bytes += done

    def _stamp_us(self, record: Record) -> int:
        self._newest_us = max(self._newest_us, record.host_us)
        unix_us = self._unix_from_host_us + self._newest_us
        return unix_us & ~_CHANNEL_BITS | min(record.channel, _CHANNEL_BITS)

    def _is_full(self) -> bool:
        limit_s = self._settings.file_max_minutes * _MINUTE_S
        too_old = 0.0 < limit_s < time.monotonic() - self._began_s
        return too_old or self.file_bytes > self._settings.file_max_mb * _MB

    def _open(self) -> None:
        """Open a file that was not there, and lock it."""
        while True:
            self._number += 1
            path = self._folder / f"{self._stem}-{self._number:03d}.tlog"
            try:
                file = FileIO(path, "xb")
            except FileExistsError:
                continue
            break
        self._file, self.path, self.file_bytes, self._unsynced = file, path, 0, True
        with suppress(OSError):  # some file systems have no locks
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        folder = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)  # the name itself outlives a power cut
        finally:
            os.close(folder)

    def _check_free(self) -> None:
        free = shutil.disk_usage(self._folder).free
        if free < self._settings.free_min_mb * _MB:
            words = f"less than {self._settings.free_min_mb:g} MB are free on the disk"
            raise OSError(errno.ENOSPC, words)

    def _kept(self) -> list[tuple[os.stat_result, Path]]:
        """Recordings in the folder, the oldest first."""
        kept = []
        for path in self._folder.glob(_PATTERN):
            with suppress(FileNotFoundError):
                kept.append((path.stat(), path))
        return sorted(kept, key=lambda k: (k[0].st_mtime_ns, k[1].name))

    def _make_room(self) -> None:
        """Delete what is too old, and the oldest beyond the bound with one more full file."""
        kept = self._kept()
        age_s = self._settings.max_age_days * _DAY_S
        total_max = (self._settings.total_max_mb - self._settings.file_max_mb) * _MB
        total = sum(stat.st_size for stat, _ in kept)
        for stat, path in kept:
            expired = 0.0 < age_s < time.time() - stat.st_mtime
            if (expired or total > total_max) and _is_free(path):
                path.unlink(missing_ok=True)
                total -= stat.st_size


def _is_free(path: Path) -> bool:
    """Whether it is there, and no recorder is writing it."""
    try:
        with open(path, "rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def mend(path: Path, dialect: Dialect) -> int:
    """Cut off what stands behind the last whole record; return how many bytes that were.

    A record is whole when its frame's checksum is right. A file without any is left as it is.
    """
    size = path.stat().st_size
    whole = whole_bytes(path, dialect)
    if whole is None or whole == size:
        return 0
    with open(path, "r+b") as file:
        file.truncate(whole)
        os.fsync(file.fileno())
    return size - whole


def whole_bytes(path: Path, dialect: Dialect) -> int | None:
    """Offset of the end of the last whole record, None where there is none [bytes].

    Only the end of the file is read, and more of it where that holds no frame.
    """
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        tail = TAIL_BYTES
        while True:
            begin = file.seek(max(0, size - tail))
            framer = Framer(dialect, stamped=True)
            ends = [_last_end(part) for part in (framer.feed(file.read()), framer.finish())]
            if any(ends):
                return begin + max(ends)
            if begin == 0:
                return None
            tail *= 8


def _last_end(frames: Frames) -> int:
    """Where the last frame ends in the whole stream, 0 without frames [bytes]."""
    if not len(frames):
        return 0
    return int(frames.position[-1] + frames.end[-1] - frames.start[-1])
