"""The daemon's side of the live page: a snapshot now and then, handed on without ever waiting."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from monitor.daemon import Status
from monitor.verdict import StepResult
from monitor.web.pipe import BEGIN, FRAME

__all__ = ["WebFeed"]


class Snapshotting(Protocol):
    """What is needed of :class:`monitor.web.snapshot.Snapshots`."""

    def note(self, result: StepResult) -> None: ...
    def skip(self) -> None: ...
    def frame(self, now_us: int, status: Status) -> bytes: ...
    def hello(self, status: Status) -> bytes: ...


class Taking(Protocol):
    """What is needed of :class:`monitor.web.process.WebProcess`."""

    fresh: bool

    def ready(self, now_us: int) -> bool: ...
    def send(self, kind: bytes, body: bytes) -> None: ...


class WebFeed:
    """Sends a frame when one is due and is taken; else it is left out and counted.

    Parameters
    ----------
    snapshots, process
        Makes the messages; takes them.
    status
        Of the daemon.
    rate_hz
        Frames per second.
    now_us
        Host monotonic time [us].
    """

    def __init__(
        self,
        snapshots: Snapshotting,
        process: Taking,
        status: Callable[[], Status],
        rate_hz: float,
        now_us: Callable[[], int],
    ) -> None:
        self._snapshots, self._process, self._status = snapshots, process, status
        self._period_us = round(1e6 / rate_hz)
        self._now_us = now_us
        self._due_us = now_us()

    def turn(self, result: StepResult) -> None:
        """After each turn of the daemon's loop, with what it gave."""
        self._snapshots.note(result)
        now_us = self._now_us()
        if now_us < self._due_us:
            return
        self._due_us = max(self._due_us + self._period_us, now_us + self._period_us // 2)
        if not self._process.ready(now_us):
            self._snapshots.skip()
            return
        if self._process.fresh:
            self._process.fresh = False
            self._process.send(BEGIN, self._snapshots.hello(self._status()))
            if not self._process.ready(now_us):
                self._snapshots.skip()
                return
        self._process.send(FRAME, self._snapshots.frame(now_us, self._status()))
