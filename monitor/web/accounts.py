"""What a frame says of streams, link, rejections, recorder and our own cost, and how it is counted.

Rates are over the last second or seconds of the host's clock: what a person who looks now sees.
"""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from links.vocabulary import Rejection
from monitor.daemon import Status
from monitor.streams import Stream
from monitor.web import wire
from monitor.web.protocol import Latency, Link, Process
from monitor.web.protocol import Recorder as RecorderSaid
from monitor.web.protocol import Stream as StreamSaid

__all__ = ["Accounts", "Judged", "Received", "Recording", "link"]

EVERY_US: Final = 1_000_000
"""Accounts are made this often."""

LOOKS: Final = 4
"""A stream's rate is over so many looks: slow streams have a sample or two in each."""

_MB = 1e6


class Received(Protocol):
    """What is needed of ``links.mavlink.Counters``."""

    @property
    def bytes(self) -> int: ...
    @property
    def bad_bytes(self) -> int: ...
    @property
    def lost(self) -> int: ...


class Judged(Protocol):
    """What is needed of ``monitor.pipeline.Pipeline``."""

    now_us: int

    @property
    def flying(self) -> bool: ...
    @property
    def rejected(self) -> Counter[tuple[str, Rejection]]: ...
    @property
    def streams(self) -> Mapping[str, Stream]: ...


class Recording(Protocol):
    """What is needed of ``monitor.recorder.Recorder``."""

    @property
    def path(self) -> Path: ...
    @property
    def file_bytes(self) -> int: ...
    @property
    def bytes(self) -> int: ...
    @property
    def stopped(self) -> str | None: ...


class _Look(NamedTuple):
    """Counts at a moment of the host's clock."""

    now_us: int
    datagrams: int
    rows: int
    samples: dict[str, int]


class Accounts:
    """Looks about once a second at all that is counted.

    Parameters
    ----------
    judged, recorder
        What counts; ``recorder`` is None when nothing is recorded.

    Attributes
    ----------
    datagrams_s, rows_s
        Per second, over the last look.
    dropped
        Frames left out since the start; their maker counts them.
    """

    def __init__(self, judged: Judged, recorder: Recording | None) -> None:
        self._judged, self._recorder = judged, recorder
        self._looks: deque[_Look] = deque(maxlen=LOOKS)
        self._rejected: dict[str, dict[str, int]] | None = None
        self._costs_ns = 0
        self._costs = 0
        self.datagrams_s = self.rows_s = 0.0
        self.dropped = 0

    def cost(self, nanoseconds: int) -> None:
        """Processor time that a frame took."""
        self._costs_ns += nanoseconds
        self._costs += 1

    def news(self, now_us: int, status: Status) -> dict[str, Any]:
        """What is due of the seldom changing parts of a frame, by their keys."""
        if self._looks and now_us - self._looks[-1].now_us < EVERY_US:
            return {}
        streams = self._judged.streams
        samples = {sensor: stream.samples for sensor, stream in streams.items()}
        look = _Look(now_us, status.datagrams, status.rows, samples)
        if self._looks:
            last = self._looks[-1]
            taken_s = (now_us - last.now_us) / 1e6
            self.datagrams_s = round((status.datagrams - last.datagrams) / taken_s, 1)
            self.rows_s = round((status.rows - last.rows) / taken_s, 1)
        self._looks.append(look)
        said: dict[str, Any] = {
            "streams": self._streams(streams, look),
            "latency": _latency(status),
            "recorder": _recorder(self._recorder),
            "process": self._process(),
        }
        rejected = _rejected(self._judged.rejected)
        if rejected != self._rejected:
            said["rejected"] = self._rejected = rejected
        return said

    def _streams(self, streams: Mapping[str, Stream], now: _Look) -> dict[str, StreamSaid]:
        first = self._looks[0]
        taken_s = (now.now_us - first.now_us) / 1e6
        return {
            sensor: StreamSaid(
                rate_hz=round((stream.samples - first.samples.get(sensor, 0)) / taken_s, 1)
                if taken_s > 0
                else 0.0,
                samples=stream.samples,
                gaps=stream.gaps,
                stale=stream.stale,
            )
            for sensor, stream in sorted(streams.items())
            if not stream.blank
        }

    def _process(self) -> Process:
        mean_ms = wire.number(self._costs_ns / self._costs / 1e6) if self._costs else None
        self._costs_ns = self._costs = 0
        return Process(
            cpu_s=round(time.process_time(), 3),
            memory_mb=_memory_mb(),
            snapshot_ms=mean_ms,
            dropped=self.dropped,
        )


def link(status: Status, received: Received, accounts: Accounts) -> Link:
    """The link now."""
    return Link(
        silent=status.silent,
        silent_s=None if status.silent_s is None else round(status.silent_s, 2),
        datagrams=status.datagrams,
        datagrams_s=accounts.datagrams_s,
        rows_s=accounts.rows_s,
        bytes=received.bytes,
        bad_bytes=received.bad_bytes,
        lost=received.lost,
        sent=status.sent,
    )


def _latency(status: Status) -> Latency:
    latency = status.latency
    return Latency(
        count=latency.count,
        median_ms=wire.number(latency.median_ms),
        p99_ms=wire.number(latency.p99_ms),
        worst_ms=wire.number(latency.worst_ms),
    )


def _recorder(recorder: Recording | None) -> RecorderSaid | None:
    if recorder is None:
        return None
    return RecorderSaid(
        file=recorder.path.name,
        file_bytes=recorder.file_bytes,
        bytes=recorder.bytes,
        stopped=recorder.stopped,
    )


def _rejected(counts: Mapping[tuple[str, Rejection], int]) -> dict[str, dict[str, int]]:
    out: dict[str, dict[str, int]] = {}
    for (what, reason), count in sorted(counts.items()):
        out.setdefault(what, {})[str(reason)] = count
    return out


def _memory_mb() -> float | None:
    """Memory that this process holds; None where it is not told."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, IndexError):
        return None
    return round(pages * os.sysconf("SC_PAGE_SIZE") / _MB, 1)
