"""Keeps the raw links as telemetry logs, in a thread of its own and within bounds on the disk.

What is recorded is what was received on every link, frame by frame with its arrival, before
anything judged it: ``mavsentry analyze`` on a recording gives the verdicts of the flight again.
Between stands what was published, as it was sent, so that it can be compared with them.

One kind of frame is left out: SETUP_SIGNING carries the key of the network.

The loop only puts bytes into a queue. A disk that is slow lets the queue fill, up to its bound;
one that is full, gone or stands still ends the recording and nothing else, until it takes files
again. :mod:`monitor.tlog_files` says what is written.
"""

from __future__ import annotations

import os
import threading
import time
from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from itertools import accumulate
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer, Frames
from monitor.settings.recorder import RecorderSettings
from monitor.tlog_files import SENT, STAMP_BYTES, Record, TlogFiles

__all__ = ["Recorder", "whole_frames"]

WRITE_S = 1.0
"""What was taken is handed to the operating system so often; then it outlives our process."""

STALLED_S = 10.0
"""A disk that has not answered for so long is said to stand still."""

CLOSE_S = 0.5
"""The end of the program waits no longer for the disk."""

SETUP_SIGNING = 256

Data = bytes  # the recorder counts its own


def whole_frames(frames: Frames) -> Iterator[tuple[bytes, int]]:
    """Bytes of each frame, from its magic to its checksum or signature, and its stamp [us]."""
    columns = (frames.start, frames.end, frames.stamp_us)
    for start, end, stamp_us in zip(*(c.tolist() for c in columns), strict=True):
        yield frames.data[start:end], stamp_us


class _Taken(NamedTuple):
    """Bytes as they passed a link; ``link`` None: a frame that we sent."""

    host_us: int
    link: int | None
    data: bytes


class Recorder:
    """Records what is received and sent in ``DIR/mavsentry-<start in UTC>-<number>.tlog``.

    Parameters
    ----------
    folder
        Made if it is not there. Only then: a folder that is gone later may be the mount point of a
        stick that was pulled, and is waited for.
    settings
        Bounds of a file, of the folder and of the queue.
    dialect
        Whose frames are recognised.

    Attributes
    ----------
    lost_bytes
        Bytes that were not recorded: the queue was full, or nothing could be written.
    withheld
        Frames that were left out: SETUP_SIGNING.

    Raises
    ------
    OSError
        The folder cannot be made or written to.
    """

    def __init__(
        self, folder: Path, settings: RecorderSettings, dialect: str = "ardupilotmega"
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(0, "no permission to write there")
        self._settings = settings
        self._dialect = load_dialect(dialect)
        self._files = TlogFiles(folder, settings)
        self._framers: dict[int, Framer] = {0: Framer(self._dialect)}
        self._framers[0].feed(b"")  # loads the search, which the thread had to wait for
        self._queue: deque[_Taken] = deque()
        self._queued_bytes = 0
        self._queue_max = round(settings.queue_mb * 1e6)
        self._changed = threading.Condition()
        self._wanted = self._done = 0  # rounds of writing asked for, and done
        self._ending = False
        self._failed: str | None = None
        self._failed_s = -settings.retry_s
        self._busy_since_s: float | None = None
        self._newest_us = 0
        self._news: deque[str] = deque()
        self._told: str | None = None
        self.lost_bytes = self.withheld = 0
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file being written, or the last one that was."""
        return self._files.path

    @property
    def file_bytes(self) -> int:
        """Size of that file."""
        return self._files.file_bytes

    @property
    def bytes(self) -> int:
        """Size of all files written since the start."""
        return self._files.bytes

    @property
    def stopped(self) -> str | None:
        """Why nothing is recorded now, in one sentence; None while it is."""
        if self._failed is not None:
            return self._failed
        since_s = self._busy_since_s
        if since_s is not None and time.monotonic() - since_s > STALLED_S:
            return "recording has stopped: the disk stands still"
        return None

    def take(self, data: Data, host_us: int, link: int = 0) -> None:
        """Record the frames that these bytes of a link complete, stamped with their arrival."""
        self._put(_Taken(host_us, link, data))

    def take_sent(self, frame: Data, host_us: int) -> None:
        """Record one whole frame of our own, as it was sent."""
        self._put(_Taken(host_us, None, frame))

    def news(self) -> list[str]:
        """Sentences that nobody was told yet: what was mended, that it stopped, that it goes on."""
        stopped = self.stopped
        if stopped != self._told:
            self._told = stopped
            self._news.append(stopped or f"recording goes on in {self.path.name}{self._losses()}")
        said = []
        while self._news:
            said.append(self._news.popleft())
        return said

    def flush(self, timeout_s: float = CLOSE_S) -> bool:
        """Wait until what was taken is with the operating system; False when it takes longer."""
        with self._changed:
            self._wanted += 1
            wanted = self._wanted
            self._changed.notify_all()
            return self._changed.wait_for(lambda: self._done >= wanted, timeout_s)

    def close(self) -> None:
        """Record what still waited for more bytes, and finish the file.

        A disk that stands still is not waited for: what it has not taken by then is lost.
        """
        self._ending = True
        self.flush()
        self._thread.join(CLOSE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _put(self, taken: _Taken) -> None:
        with self._changed:
            self._queue.append(taken)
            self._queued_bytes += len(taken.data)
            while self._queued_bytes > self._queue_max:
                dropped = len(self._queue.popleft().data)
                self._queued_bytes -= dropped
                self.lost_bytes += dropped
            if 2 * self._queued_bytes > self._queue_max and self._wanted == self._done:
                self._wanted += 1
                self._changed.notify_all()

    # from here on in the thread

    def _work(self) -> None:
        ending = False
        while not ending:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted > self._done, WRITE_S)
                wanted, ending = self._wanted, self._ending
                taken, self._queue = list(self._queue), deque()
                self._queued_bytes = 0
            self._busy_since_s = time.monotonic()
            self._round(taken, ending)
            self._busy_since_s = None
            with self._changed:
                self._done = wanted
                self._changed.notify_all()

    def _round(self, taken: list[_Taken], ending: bool) -> None:
        """Write what was taken; where that fails, say so and go on without the disk."""
        records, files = self._records(taken, ending), self._files
        before = files.bytes
        try:
            if self._is_ready():
                files.append(records)
                files.tend()
            if ending:
                files.close()
        except OSError as error:
            self._failed = f"recording has stopped: {error.strerror or error}"
            self._failed_s = time.monotonic()
            files.abandon()
        lost = sum(STAMP_BYTES + len(r.frame) for r in records) - (files.bytes - before)
        with self._changed:
            self.lost_bytes += lost

    def _is_ready(self) -> bool:
        """Whether a file is open; after a failure another is begun when its time has come."""
        if self._files.is_open:
            return True
        if time.monotonic() - self._failed_s < self._settings.retry_s:
            return False
        if self._failed is None and (mended := self._files.mend_last(self._dialect)):
            self._news.append(mended)
        self._files.begin()
        self._failed = None
        return True

    def _records(self, taken: list[_Taken], ending: bool) -> list[Record]:
        """Frames that were completed, in the order in which they were.

        The bytes of a link are searched all at once, which costs far less than each datagram's.
        """
        streams: dict[int, list[int]] = {}
        found: list[tuple[int, Record]] = []
        for k, item in enumerate(taken):
            if item.link is None:
                found.append((k, Record(item.host_us, SENT, item.data)))
            else:
                streams.setdefault(item.link, []).append(k)
        for link, places in streams.items():
            framer = self._framers.get(link) or Framer(self._dialect)
            self._framers[link] = framer
            ends = list(accumulate((len(taken[k].data) for k in places), initial=framer.bytes))
            frames = self._kept(framer.feed(b"".join(taken[k].data for k in places)))
            complete = (frames.position + frames.end - frames.start).tolist()
            for end, (frame, _) in zip(complete, whole_frames(frames), strict=True):
                k = places[max(bisect_left(ends, end) - 1, 0)]
                found.append((k, Record(taken[k].host_us, min(link, SENT - 1), frame)))
        found.sort(key=itemgetter(0))
        records = [record for _, record in found]
        if records:
            self._newest_us = records[-1].host_us
        if ending:
            for link, framer in self._framers.items():
                rest = whole_frames(self._kept(framer.finish()))
                records += [Record(self._newest_us, min(link, SENT - 1), f) for f, _ in rest]
        return records

    def _kept(self, frames: Frames) -> Frames:
        """All but the frames that carry the network's key."""
        secret = frames.message == SETUP_SIGNING
        self.withheld += int(secret.sum())
        return frames.take(~secret) if secret.any() else frames

    def _losses(self) -> str:
        lost = self.lost_bytes
        return f"; about {lost / 1e3:.0f} kB were lost" if lost else ""
