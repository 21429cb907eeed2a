"""The working loop of ``mavsentry run``: a link in, the pipeline, messages out.

One thread. A turn gathers what has arrived, decodes it, feeds the pipeline and sends what is due.
Vehicle time drives every verdict; the host's monotonic clock decides only that the link is silent,
paces what is sent, and measures how long we took.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from links.samples import Batch
from monitor.latency import Latency, LatencyMeter
from monitor.publish import Message, Publisher
from monitor.settings.links import LinkSettings
from monitor.verdict import StepResult

__all__ = ["Daemon", "Host", "Link", "Recording", "Status"]

IDLE_S = 0.05
"""Longest wait for a datagram: the heartbeat and a request to stop are seen this often."""

DATAGRAMS_MAX = 4096
"""Datagrams worked on in one turn; what exceeds it waits for the next."""

RECENT = 256
"""Answers that the latency shown while the loop runs is of: half a minute or so."""


class Link(Protocol):
    """What the loop needs of ``links.endpoints.Endpoint``."""

    def recv(self, timeout_s: float) -> list[tuple[bytes, int]]:
        """Datagrams and when they arrived (host monotonic [us]); empty after ``timeout_s``."""
        ...

    def send(self, data: bytes) -> object:
        """Send one datagram; a peer that is missing or gone is counted, not raised."""
        ...


class Decoding(Protocol):
    """What the loop needs of ``links.mavlink.Decoder``."""

    def feed(self, data: bytes, host_us: int | None = None) -> Batch:
        """Rows of the next bytes of the stream."""
        ...

    def finish(self) -> Batch:
        """Rows of what waited for more bytes: the stream has ended."""
        ...


class Judging(Protocol):
    """What the loop needs of ``monitor.pipeline.Pipeline``."""

    def feed(self, batch: Batch) -> StepResult:
        """Verdicts and estimates that a batch makes due."""
        ...

    def finish(self) -> StepResult:
        """The same of what still waits."""
        ...


class Recording(Protocol):
    """What the loop needs of ``monitor.recorder.Recorder``."""

    def take(self, data: bytes, host_us: int) -> None:
        """Bytes received, and when (host monotonic [us])."""
        ...

    def take_sent(self, frame: bytes, host_us: int) -> None:
        """A frame sent, and when."""
        ...


class Host:
    """The host's clock; tests put their own in its place."""

    def now_us(self) -> int:
        """Monotonic time [us]."""
        return time.monotonic_ns() // 1000

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)


@dataclass(frozen=True, slots=True)
class Status:
    """How the loop is doing.

    Attributes
    ----------
    t_us
        Newest vehicle time heard [us], None before any.
    silent
        Nothing of the vehicle for the configured time, or never.
    silent_s
        For how long nothing was heard of it (host's clock) [s]; None before anything was.
    turns, datagrams, rows, sent
        Counts since the start.
    latency
        From the arrival of the oldest datagram of a turn to our last datagram of that turn, over
        turns that sent something beside a heartbeat. A datagram that waited while we worked counts
        from when the loop last looked.
    """

    t_us: int | None
    silent: bool
    silent_s: float | None
    turns: int
    datagrams: int
    rows: int
    sent: int
    latency: Latency


class Daemon:
    """Turns datagrams into verdicts and verdicts into datagrams until it is told to stop.

    Parameters
    ----------
    source
        Where the vehicle's bytes come from.
    sinks
        Where messages go; may contain ``source``.
    decoder, pipeline, publisher
        The three stages.
    encode
        Message -> bytes; it knows the system id, which is the vehicle's.
    record
        Takes every datagram received, with its arrival, and every frame sent once the vehicle is
        known; None records nothing.
    settings
        Of the links section: silence and gathering times.
    """

    def __init__(
        self,
        source: Link,
        sinks: Sequence[Link],
        decoder: Decoding,
        pipeline: Judging,
        publisher: Publisher,
        encode: Callable[[Message], bytes],
        settings: LinkSettings,
        record: Recording | None = None,
        host: Host | None = None,
    ) -> None:
        self._source = source
        self._sinks = tuple(sinks)
        self._decoder = decoder
        self._pipeline = pipeline
        self._publisher = publisher
        self._encode = encode
        self._record = record
        self._host = host or Host()
        self._coalesce_us = round(settings.coalesce_ms * 1e3)
        self._silent_us = round(settings.silent_after_s * 1e6)
        self._meter = LatencyMeter()
        self._recent = LatencyMeter(RECENT)
        self._looked_us = self._host.now_us()
        self._worked_us = self._looked_us - self._coalesce_us
        self._heard_us: int | None = None
        self._t_us: int | None = None
        self._turns = self._datagrams = self._rows = self._sent = 0

    def turn(self) -> StepResult:
        """One turn of the loop: at most :data:`IDLE_S` of waiting, then all that is due."""
        arrived, oldest_us = self._gather()
        result = StepResult()
        if arrived:
            self._worked_us = self._host.now_us()
            result = self._use(arrived)
        answered = self._send_due()
        if arrived and answered:
            took_us = self._host.now_us() - oldest_us
            self._meter.add(took_us)
            self._recent.add(took_us)
        self._turns += 1
        return result

    def finish(self) -> StepResult:
        """Judge what still waits for bytes or the watermark, and send what that makes due."""
        results = (self._pipeline.feed(self._decoder.finish()), self._pipeline.finish())
        for result in results:
            self._publisher.note(result)
        self._send_due()
        return StepResult([v for result in results for v in result.verdicts])

    def status(self, recent: bool = False) -> Status:
        """Counts, silence and latency now; of the newest :data:`RECENT` answers only if asked.

        The quantiles of all answers take a millisecond, those of the newest ones hardly anything.
        """
        now_us = self._host.now_us()
        return Status(
            self._t_us,
            self._silent(now_us),
            None if self._heard_us is None else max(now_us - self._heard_us, 0) / 1e6,
            self._turns,
            self._datagrams,
            self._rows,
            self._sent,
            (self._recent if recent else self._meter).read(),
        )

    def discard_waiting(self) -> int:
        """Drop what piled up while the program was getting ready; return how many datagrams."""
        dropped = 0
        while dropped < 16 * DATAGRAMS_MAX and (waiting := self._source.recv(0.0)):
            dropped += len(waiting)
        self._looked_us = self._host.now_us()
        return dropped

    def _gather(self) -> tuple[list[tuple[bytes, int]], int]:
        """What has arrived, and the earliest time at which the oldest of it can have arrived.

        Waking up for each datagram costs more than working on it, so after the first one the rest
        of the gathering time since the last turn's work is slept away.
        """
        looked_us = self._looked_us
        called_us = self._host.now_us()
        arrived = list(self._source.recv(IDLE_S))
        self._looked_us = self._host.now_us()
        if not arrived:
            return [], self._looked_us
        waited = self._looked_us - called_us > 500
        oldest_us = arrived[0][1] if waited else min(looked_us, arrived[0][1])
        rest_us = self._worked_us + self._coalesce_us - self._looked_us
        if rest_us > 0:
            self._host.sleep(rest_us / 1e6)
        while len(arrived) < DATAGRAMS_MAX and (more := self._source.recv(0.0)):
            arrived += more
        self._looked_us = self._host.now_us()
        return arrived, oldest_us

    def _use(self, arrived: list[tuple[bytes, int]]) -> StepResult:
        self._datagrams += len(arrived)
        if self._record is not None:
            for data, host_us in arrived:
                self._record.take(data, host_us)
        batch = self._decoder.feed(b"".join(data for data, _ in arrived), arrived[-1][1])
        if len(batch):
            self._rows += len(batch)
            self._heard_us = arrived[-1][1]
            newest_us = max(int(rows["t_us"].max()) for rows in batch.rows.values() if len(rows))
            self._t_us = newest_us if self._t_us is None else max(self._t_us, newest_us)
        result = self._pipeline.feed(batch)
        self._publisher.note(result)
        return result

    def _silent(self, now_us: int) -> bool:
        return self._heard_us is None or now_us - self._heard_us > self._silent_us

    def _send_due(self) -> bool:
        """Send what is due; say whether there was anything beside a heartbeat."""
        now_us = self._host.now_us()
        messages = self._publisher.due(now_us, self._t_us, self._silent(now_us))
        for message in messages:
            data = self._encode(message)
            for sink in self._sinks:
                sink.send(data)
            if self._record is not None and self._t_us is not None:
                self._record.take_sent(data, now_us)
        self._sent += len(messages)
        return any(m.name != "HEARTBEAT" for m in messages)
