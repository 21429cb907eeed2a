"""Telemetry logs as links: one to read frames from, one to write them to."""

from __future__ import annotations

import time
from pathlib import Path
from typing import IO

from links.endpoints.base import MAX_PER_RECV, STREAM_CHUNK, Link, Received, now_us, plain
from links.logs.tlog import TlogWriter
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer

__all__ = ["LogEndpoint", "LogWriterEndpoint"]


class LogEndpoint(Link):
    """The frames of a telemetry log, one after the other as fast as they are asked for."""

    def __init__(self, name: str, path: Path, dialect: str) -> None:
        super().__init__(name)
        try:
            self._file: IO[bytes] = open(path, "rb")  # noqa: SIM115
        except OSError as error:
            raise plain(name, error) from None
        self._framer = Framer(load_dialect(dialect), stamped=True)
        self._waiting: Received = []
        self._read_all = False
        self.counters.opened = 1

    @property
    def ended(self) -> bool:
        return self._read_all and not self._waiting

    def recv(self, timeout_s: float) -> Received:
        while not self._waiting and not self._read_all:
            data = self._file.read(STREAM_CHUNK)
            self._read_all = not data
            frames = self._framer.feed(data) if data else self._framer.finish()
            arrived_us = now_us()
            for start, end in zip(frames.start.tolist(), frames.end.tolist(), strict=True):
                self._received(frames.data[start:end])
                self._waiting.append((frames.data[start:end], arrived_us))
        out = self._waiting[:MAX_PER_RECV]
        del self._waiting[:MAX_PER_RECV]
        return out

    def send(self, data: bytes) -> None:
        self.counters.dropped += 1

    def close(self) -> None:
        self._file.close()


class LogWriterEndpoint(Link):
    """A new telemetry log; what is sent is written with the host's time."""

    def __init__(self, name: str, path: Path) -> None:
        super().__init__(name)
        try:
            self._writer = TlogWriter(path)
        except OSError as error:
            raise plain(name, error) from None
        self.counters.opened = 1

    def recv(self, timeout_s: float) -> Received:
        time.sleep(timeout_s)
        return []

    def send(self, data: bytes) -> None:
        self._writer.write(data, time.time_ns() // 1000)
        self._sent(len(data))

    def close(self) -> None:
        self._writer.close()
