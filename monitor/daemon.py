"""The working loop of ``mavsentry run``: links in, the pipeline, messages out.

One thread. A turn gathers what has arrived, lets in what may come in, decodes it, feeds the
pipeline, shows the component what concerns it, and sends what is due. Vehicle time drives every
verdict; the host's monotonic clock decides only that the link is silent, paces what is sent, and
measures how long we took. Nothing here waits for anything but the links.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from links.endpoints.hub import Arrival
from links.mavlink.heard import Heard
from links.mavlink.reception import Reception
from links.samples import Batch
from monitor.latency import Latency, LatencyMeter
from monitor.outbox import Outbox
from monitor.publish import Message, Publisher
from monitor.retune import Retuned, blend
from monitor.settings import Settings
from monitor.settings.links import LinkSettings
from monitor.verdict import StepResult

__all__ = ["Daemon", "Host", "Links", "Parts", "Recording", "Status"]

IDLE_S = 0.05
"""Longest wait for a datagram: the heartbeat and a request to stop are seen this often."""

DATAGRAMS_MAX = 4096
"""Datagrams worked on in one turn; what exceeds it waits for the next."""

RECENT = 256
"""Answers that the latency shown while the loop runs is of: half a minute or so."""


class Links(Protocol):
    """What the loop needs of ``links.endpoints.hub.Hub``."""

    def recv(self, timeout_s: float) -> list[Arrival]:
        """What arrived on any link; empty after ``timeout_s``."""
        ...

    def accepted(self, link: int, peer: object) -> None:
        """A frame of this peer was let in."""
        ...

    def tend(self, now_us: int) -> None:
        """What time makes due: lost links are opened again."""
        ...


class Guarding(Protocol):
    """What the loop needs of ``monitor.security.Gate``."""

    @property
    def reception(self) -> Reception:
        """Lets frames in."""
        ...

    def tend(self, now_us: int) -> None:
        """What time makes due."""
        ...


class Serving(Protocol):
    """What the loop needs of ``monitor.component.Component``."""

    @property
    def address(self) -> tuple[int, int] | None:
        """System and component id to send as; None while nothing may be sent yet."""
        ...

    def hear(self, heard: Heard, now_us: int) -> list[Message]:
        """Answers to an accepted message."""
        ...

    def due(self, now_us: int) -> list[Message]:
        """What time makes due."""
        ...

    def close(self, now_us: int) -> list[Message]:
        """What must be said at the end."""
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

    def take(self, data: bytes, host_us: int, link: int) -> None:
        """Bytes received on a link, and when (host monotonic [us])."""
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
        Counts since the start; ``sent`` of messages, whatever the number of links.
    latency
        From the arrival of the oldest datagram of a turn to our last datagram of that turn, over
        turns that sent something beside a heartbeat. A datagram that waited while we worked counts
        from when the loop last looked.
    beat_gap_s
        Longest time between two heartbeats so far [s].
    refused
        Frames that were not let in.
    """

    t_us: int | None
    silent: bool
    silent_s: float | None
    turns: int
    datagrams: int
    rows: int
    sent: int
    latency: Latency
    beat_gap_s: float = 0.0
    refused: int = 0


class Parts(NamedTuple):
    """What a daemon is put together of.

    Attributes
    ----------
    links, gate
        Where bytes come from, and who of them is let in.
    decoder, pipeline, publisher
        Bytes to samples to verdicts to messages.
    component
        Our duties on the network.
    outbox
        Where messages leave.
    """

    links: Links
    gate: Guarding
    decoder: Decoding
    pipeline: Judging
    publisher: Publisher
    component: Serving
    outbox: Outbox


class Daemon:
    """Turns datagrams into verdicts and verdicts into datagrams until it is told to stop.

    Parameters
    ----------
    parts
        The stages; see :class:`Parts`.
    settings
        Of the links section: silence and gathering times.
    record
        Takes every datagram received, with its arrival, and of every message sent once the vehicle
        is known the frame; None records nothing.
    """

    def __init__(
        self,
        parts: Parts,
        settings: LinkSettings,
        record: Recording | None = None,
        host: Host | None = None,
    ) -> None:
        self._links, self._gate = parts.links, parts.gate
        self._reception = parts.gate.reception
        self._decoder, self._pipeline = parts.decoder, parts.pipeline
        self._publisher, self._component = parts.publisher, parts.component
        self._outbox = parts.outbox
        self._record = record
        self._host = host or Host()
        self._settings = settings
        self._meter = LatencyMeter()
        self._recent = LatencyMeter(RECENT)
        self._looked_us = self._host.now_us()
        self._pace(settings)
        self._worked_us = self._looked_us - self._coalesce_us
        self._heard_us: int | None = None
        self._t_us: int | None = None
        self._beat_us: int | None = None
        self._beat_gap_us = 0
        self._turns = self._datagrams = self._rows = self._sent = self._refused = 0

    def turn(self) -> StepResult:
        """One turn of the loop: at most :data:`IDLE_S` of waiting, then all that is due.

        Verdicts leave first; what the component owes others does not delay them.
        """
        arrived, oldest_us = self._gather()
        result, heard = StepResult(), list[Heard]()
        if arrived:
            self._worked_us = self._host.now_us()
            result, heard = self._use(arrived)
        published = self._publish()
        if arrived and published:
            took_us = self._host.now_us() - oldest_us
            self._meter.add(took_us)
            self._recent.add(took_us)
        self._serve(heard)
        now_us = self._host.now_us()
        self._links.tend(now_us)
        self._gate.tend(now_us)
        self._turns += 1
        return result

    def finish(self) -> StepResult:
        """Judge what still waits for bytes or the watermark; say that, and goodbye."""
        results = (self._pipeline.feed(self._decoder.finish()), self._pipeline.finish())
        for result in results:
            self._publisher.note(result)
        self._publish()
        now_us = self._host.now_us()
        self._outbox.put(self._component.close(now_us))
        self._flush(now_us)
        return StepResult([v for result in results for v in result.verdicts])

    def retune(self, settings: Settings) -> Retuned:
        """Take new times of the links section; its other keys wait."""
        fixed = type(settings.links).model_fields.keys() - {"silent_after_s", "coalesce_ms"}
        self._settings, retuned = blend(self._settings, settings.links, fixed)
        self._pace(self._settings)
        return retuned.under("links")

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
            self._beat_gap_us / 1e6,
            self._refused,
        )

    def discard_waiting(self) -> int:
        """Drop what piled up while the program was getting ready; return how many datagrams."""
        dropped = 0
        while dropped < 16 * DATAGRAMS_MAX and (waiting := self._links.recv(0.0)):
            dropped += len(waiting)
        self._looked_us = self._host.now_us()
        return dropped

    def _pace(self, settings: LinkSettings) -> None:
        self._coalesce_us = round(settings.coalesce_ms * 1e3)
        self._silent_us = round(settings.silent_after_s * 1e6)

    def _gather(self) -> tuple[list[Arrival], int]:
        """What has arrived, and the earliest time at which the oldest of it can have arrived.

        Waking up for each datagram costs more than working on it, so after the first one the rest
        of the gathering time since the last turn's work is slept away.
        """
        looked_us = self._looked_us
        called_us = self._host.now_us()
        arrived = list(self._links.recv(IDLE_S))
        self._looked_us = self._host.now_us()
        if not arrived:
            return [], self._looked_us
        waited = self._looked_us - called_us > 500
        first_us = min(arrival.host_us for arrival in arrived)
        oldest_us = first_us if waited else min(looked_us, first_us)
        rest_us = self._worked_us + self._coalesce_us - self._looked_us
        if rest_us > 0:
            self._host.sleep(rest_us / 1e6)
        while len(arrived) < DATAGRAMS_MAX and (more := self._links.recv(0.0)):
            arrived += more
        self._looked_us = self._host.now_us()
        return arrived, oldest_us

    def _use(self, arrived: list[Arrival]) -> tuple[StepResult, list[Heard]]:
        self._datagrams += len(arrived)
        if self._record is not None:
            for link, data, host_us, _ in arrived:
                self._record.take(data, host_us, link)
        received = self._reception.take(arrived)
        for link, peer in received.peers:
            self._links.accepted(link, peer)
        newest_us = arrived[-1].host_us
        batch = self._decoder.feed(received.data, newest_us) if received.data else Batch()
        if received.rejected:
            self._refused += received.rejected.total()
            batch = replace(batch, rejected=batch.rejected + received.rejected)
        if len(batch):
            self._rows += len(batch)
            self._heard_us = newest_us
            t_us = max(int(rows["t_us"].max()) for rows in batch.rows.values() if len(rows))
            self._t_us = t_us if self._t_us is None else max(self._t_us, t_us)
        result = self._pipeline.feed(batch)
        self._publisher.note(result)
        return result, received.heard

    def _silent(self, now_us: int) -> bool:
        return self._heard_us is None or now_us - self._heard_us > self._silent_us

    def _publish(self) -> bool:
        """Send what the publisher has due; say whether there was anything beside a heartbeat."""
        if self._component.address is None:
            return False
        now_us = self._host.now_us()
        published = self._publisher.due(now_us, self._t_us, self._silent(now_us))
        self._outbox.put(published)
        self._flush(now_us)
        names = {message.name for message in published}
        if "HEARTBEAT" in names:
            if self._beat_us is not None:
                self._beat_gap_us = max(self._beat_gap_us, now_us - self._beat_us)
            self._beat_us = now_us
        return not names <= {"HEARTBEAT"}

    def _serve(self, heard: list[Heard]) -> None:
        """Have the component hear what concerns it; send its answers and what it has due."""
        now_us = self._host.now_us()
        for message in heard:
            self._outbox.put(self._component.hear(message, now_us))
        self._outbox.put(self._component.due(now_us))
        self._reception.own = self._component.address
        self._flush(now_us)

    def _flush(self, now_us: int) -> None:
        frames = self._outbox.flush()
        self._sent += len(frames)
        if self._record is not None and self._t_us is not None:
            for frame in frames:
                self._record.take_sent(frame, now_us)
