"""Telemetry logs as links: one to read frames from, one to write them to."""

from __future__ import annotations

import queue
import threading
import time
from pathlib import Path
from typing import IO

from links.endpoints.base import MAX_PER_RECV, STREAM_CHUNK, Link, Taken, now_us, plain
from links.logs.tlog import TlogWriter
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer

__all__ = ["LogEndpoint", "LogWriterEndpoint"]

MOST_WAITING = 4096
"""Frames that wait for a slow disk; the oldest are dropped for newer ones."""

CLOSE_S = 2.0
"""A disk that has not taken what waits after this time keeps nobody from ending [s]."""


class LogEndpoint(Link):
    """The frames of a telemetry log, one after the other as fast as they are asked for."""

    def __init__(self, name: str, path: Path, dialect: str) -> None:
        super().__init__(name, "file")
        try:
            self._file: IO[bytes] = open(path, "rb")  # noqa: SIM115
        except OSError as error:
            raise plain(name, error) from None
        self._framer = Framer(load_dialect(dialect), stamped=True)
        self._waiting: list[Taken] = []
        self._read_all = False
        self.counters.opened = 1

    @property
    def ended(self) -> bool:
        return self._read_all and not self._waiting

    @property
    def is_open(self) -> bool:
        return not self.ended

    def take(self, limit: int) -> list[Taken]:
        while not self._waiting and not self._read_all:
            data = self._file.read(STREAM_CHUNK)
            self._read_all = not data
            frames = self._framer.feed(data) if data else self._framer.finish()
            arrived_us = now_us()
            for start, end in zip(frames.start.tolist(), frames.end.tolist(), strict=True):
                frame = frames.data[start:end]
                self._received(frame, arrived_us)
                self._waiting.append(Taken(frame, arrived_us, None))
        limit = min(limit, MAX_PER_RECV)
        out = self._waiting[:limit]
        del self._waiting[:limit]
        return out

    def send(self, data: bytes) -> None:
        self.counters.dropped += 1

    def close(self) -> None:
        self._file.close()


class LogWriterEndpoint(Link):
    """A new telemetry log; what is sent is written with the host's time, by a thread."""

    def __init__(self, name: str, path: Path) -> None:
        super().__init__(name, "file")
        try:
            self._writer = TlogWriter(path)
        except OSError as error:
            raise plain(name, error) from None
        self._queue: queue.Queue[tuple[bytes, int] | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._write, name=f"write {name}", daemon=True)
        self._thread.start()
        self.counters.opened = 1

    @property
    def is_open(self) -> bool:
        return not self.trouble

    def take(self, limit: int) -> list[Taken]:
        return []

    def send(self, data: bytes) -> None:
        if not self.is_open:
            self.counters.dropped += 1
            return
        self._put((data, time.time_ns() // 1000))
        self._sent(len(data))

    def close(self) -> None:
        if self._thread.is_alive():
            self._put(None)
            self._thread.join(CLOSE_S)

    def _put(self, item: tuple[bytes, int] | None) -> None:
        while True:
            try:
                self._queue.put_nowait(item)
            except queue.Full:
                try:
                    self._queue.get_nowait()
                except queue.Empty:
                    continue
                self.counters.dropped += 1
            else:
                return

    def _write(self) -> None:
        try:
            while (item := self._queue.get()) is not None:
                self._writer.write(*item)
        except OSError as error:
            self.trouble = str(plain(self.name, error))
        finally:
            try:
                self._writer.close()
            except OSError as error:
                self.trouble = self.trouble or str(plain(self.name, error))
