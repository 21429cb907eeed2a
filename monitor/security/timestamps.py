"""Signing times kept over a restart, so that none is ever used twice and no old packet believed.

The file is written by a thread of its own, whole and atomically: the loop only hands a snapshot
over. What it says is ahead of what was used: whatever moment the program dies at, the next run
begins later than anything it sent. Ahead by little (:data:`AHEAD_S`), for others refuse who is a
minute behind, and so do we.
"""

from __future__ import annotations

import json
import os
import queue
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from links.mavlink.signing import TICKS_PER_S, SigningClock, Verifier, ticks_of_unix_us

__all__ = ["AHEAD_S", "EVERY_S", "SigningTimes", "TimestampKeeper", "TimestampStore"]

EVERY_S: Final = 5.0
"""Between two writings [s]."""

AHEAD_S: Final = 15.0
"""How far what is written is ahead of the host's clock [s]: two writings may fail."""

_FRAMES: Final = 1 << 16
"""What it is ahead of a signing time that runs before the host's clock: a tick for each frame."""

_LATEST: Final = (1 << 48) - 1
_FORMAT: Final = 1

Stream = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class SigningTimes:
    """What is kept, in ticks of 10 us since 2015.

    Attributes
    ----------
    time
        The next run begins here.
    streams
        (system, component, link id) -> newest time believed.
    """

    time: int = 0
    streams: Mapping[Stream, int] = field(default_factory=dict)


class TimestampStore:
    """The file.

    Parameters
    ----------
    path
        In a folder of ours; made if it is not there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def load(self) -> SigningTimes:
        """What an earlier run kept; nothing of a file that is not there.

        Raises
        ------
        ValueError
            The file holds something else; the message is one plain sentence.
        OSError
            It cannot be read.
        """
        try:
            text = self.path.read_bytes()
        except FileNotFoundError:
            return SigningTimes()
        try:
            return _times(json.loads(text))
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ValueError(f"{self.path} is damaged: signing times begin anew") from None

    def save(self, times: SigningTimes) -> None:
        """Put times in the place of what is there: all of it or nothing, on the disk at return.

        Raises
        ------
        OSError
            It cannot be written.
        """
        streams = [[*stream, ticks] for stream, ticks in times.streams.items()]
        text = json.dumps({"format": _FORMAT, "time": times.time, "streams": streams})
        self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        beside = self.path.with_name(self.path.name + ".new")
        handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with open(handle, "w", encoding="ascii") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self.path)
        with suppress(OSError):  # some file systems do not sync folders
            folder = os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


class TimestampKeeper:
    """Keeps the times of a running daemon.

    Parameters
    ----------
    store
        Where.
    clock, verifier
        Whose times.

    Attributes
    ----------
    trouble
        Why the times could not be kept last, one sentence; empty when they were.
    """

    def __init__(self, store: TimestampStore, clock: SigningClock, verifier: Verifier) -> None:
        self._store, self._clock, self._verifier = store, clock, verifier
        self._next_us = 0
        self._waiting: queue.Queue[SigningTimes | None] = queue.Queue(1)
        self.trouble = ""
        self._save(self._snapshot())  # before the first frame is signed
        self._thread = threading.Thread(target=self._work, name="signing times", daemon=True)
        self._thread.start()

    def tend(self, now_us: int) -> None:
        """Hand the times over when it is time; called in every turn, never waits."""
        if now_us >= self._next_us:
            with suppress(queue.Full):  # the disk is slow: the next snapshot will do
                self._waiting.put_nowait(self._snapshot())
                self._next_us = now_us + round(EVERY_S * 1e6)

    def close(self, wait_s: float = 0.5) -> None:
        """Keep the last times; a disk that takes longer than ``wait_s`` is not waited for."""
        until_s = time.monotonic() + wait_s
        with suppress(queue.Full):
            self._waiting.put(self._snapshot(), timeout=wait_s)
        with suppress(queue.Full):
            self._waiting.put(None, timeout=max(until_s - time.monotonic(), 0.0))
        self._thread.join(max(until_s - time.monotonic(), 0.0))

    def _snapshot(self) -> SigningTimes:
        host = ticks_of_unix_us(time.time_ns() // 1000) + round(AHEAD_S * TICKS_PER_S)
        reserved = min(max(host, self._clock.last + _FRAMES), _LATEST)
        return SigningTimes(reserved, self._verifier.streams)

    def _work(self) -> None:
        while (times := self._waiting.get()) is not None:
            self._save(times)

    def _save(self, times: SigningTimes) -> None:
        try:
            self._store.save(times)
        except OSError as error:
            self.trouble = f"cannot keep signing times in {self._store.path}: {error.strerror}"
        else:
            self.trouble = ""


def _times(content: Any) -> SigningTimes:
    """Checked content of the file."""
    if content["format"] != _FORMAT:
        raise ValueError
    streams: dict[Stream, int] = {}
    for system, component, link, ticks in content["streams"]:
        if not all(type(k) is int and 0 <= k <= 255 for k in (system, component, link)):
            raise ValueError
        streams[system, component, link] = _ticks(ticks)
    return SigningTimes(_ticks(content["time"]), streams)


def _ticks(value: Any) -> int:
    if type(value) is not int or not 0 <= value <= _LATEST:
        raise ValueError
    return value
