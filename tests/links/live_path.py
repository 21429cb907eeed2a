"""The daemon without its sockets and disks: bytes in, bytes out, in a time of our own.

Reception, decoder, pipeline, publisher, services, outbox and loop are the real ones, and so is what
follows each turn: lines of JSON, frames for the live page, and in the end a checkpoint.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from links.endpoints.hub import Arrival, LinkState
from links.mavlink import Decoder, Encoder
from links.mavlink.reception import Received, Reception, ReceptionOptions
from links.mavlink.signing import Signer, SigningClock, SigningKey, Verifier
from links.samples import Batch
from monitor import checkpoint
from monitor.commands.showing import as_json, lines
from monitor.component.assembly import assemble, identify
from monitor.component.parameters import Parameters
from monitor.daemon import Daemon, Parts
from monitor.outbox import Outbox
from monitor.pipeline import Pipeline
from monitor.publish import Publisher
from monitor.security import Gate
from monitor.settings import Settings
from monitor.tuning import Tuning
from monitor.verdict import StepResult
from monitor.web.feed import WebFeed
from monitor.web.measured import Measured
from monitor.web.snapshot import About, Snapshots

LINKS = ("udpin:0.0.0.0:14550", "udpin:0.0.0.0:14551")


class Wire:
    """In the place of the hub."""

    names = LINKS

    def __init__(self) -> None:
        self.waiting: list[Arrival] = []
        self.sent: list[tuple[bytes, int]] = []
        self.believed: set[object] = set()

    def recv(self, timeout_s: float) -> list[Arrival]:
        arrived, self.waiting = self.waiting, []
        return arrived

    def send(self, data: bytes, link: int) -> None:
        assert 0 <= link < len(LINKS)
        self.sent.append((data, link))

    def accepted(self, link: int, peer: object) -> None:
        self.believed.add((link, peer))

    def tend(self, now_us: int) -> None:
        pass

    def states(self) -> list[LinkState]:
        return []


class Clock:
    """In the place of the host's clock."""

    def __init__(self) -> None:
        self.us = 0

    def now_us(self) -> int:
        return self.us

    def sleep(self, seconds: float) -> None:
        self.us += round(seconds * 1e6)


class Heedful(Reception):
    """Keeps what it let in, to be looked at."""

    received: Received = Received()

    def take(self, arrivals: Sequence[tuple[int, bytes, int, object]]) -> Received:
        self.received = super().take(arrivals)
        return self.received


class Listening(Decoder):
    """Keeps its batches."""

    def feed(self, data: bytes, host_us: int | None = None) -> Batch:
        self.batch = super().feed(data, host_us)
        return self.batch


class Page:
    """In the place of the web process."""

    fresh = True

    def ready(self, now_us: int) -> bool:
        return True

    def send(self, kind: bytes, body: bytes) -> None:
        json.loads(body, parse_constant=_no_number)


def _no_number(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")


class Life:
    """A daemon from its start to its end.

    Parameters
    ----------
    settings
        Of the daemon.
    secret
        A signing key: then signatures are demanded.
    """

    def __init__(self, settings: Settings, secret: bytes | None = None) -> None:
        self.key = None if secret is None else SigningKey(secret)
        signing = SigningClock()
        verifier = None if self.key is None else Verifier(self.key, signing)
        signers = [] if self.key is None else [Signer(self.key, signing, k) for k in range(2)]
        self.wire, self.clock = Wire(), Clock()
        self.gate = Heedful(ReceptionOptions(), LINKS, verifier)
        self.decoder = Listening(settings.links.decoder_options())
        measured = Measured(settings.engine)
        self.pipeline = Pipeline(settings, taps=(measured,))
        self.publisher = Publisher(settings.publish, Encoder(1, 191).has)
        tuning = Tuning(settings, (self.pipeline.retune, self.publisher.retune))
        identity = identify(settings, self.decoder)
        parameters = Parameters(settings.component, identity, tuning, lambda: self.pipeline.flying)
        self.component = assemble(
            settings,
            identity,
            self.decoder,
            self.pipeline,
            self.publisher,
            others=(parameters,),
            capabilities=lambda: parameters.capabilities,
        )
        self.gate.listen(self.component.wants)
        guard = Gate(self.gate, signers)
        component = self.component
        self.outbox = Outbox(
            self.wire.send, (0, 1), lambda: component.address, guard.sign, component.sent
        )
        parts = Parts(
            self.wire,
            guard,
            self.decoder,
            self.pipeline,
            self.publisher,
            self.component,
            self.outbox,
        )
        self.daemon = Daemon(parts, settings.links, host=self.clock)
        about = About("test", settings.profile, "0", settings.web.rate_hz, settings.web.history_s)
        snapshots = Snapshots(about, self.pipeline, self.decoder.counters, measured, None)
        self._feed = WebFeed(
            snapshots, Page(), self.daemon.status, settings.web.rate_hz, self.clock.now_us
        )
        self.batches: list[Batch] = []
        self.admitted: list[bytes] = []
        self.heard = 0

    def turn(self, arrivals: Sequence[tuple[int, bytes, int, object]], now_us: int) -> bytes:
        """One turn of the loop; what it sent."""
        self.wire.waiting = [Arrival(*arrival) for arrival in arrivals]
        self.clock.us, self.wire.sent = max(now_us, self.clock.us), []
        self.gate.received, self.decoder.batch = Received(), Batch()
        result = self.daemon.turn()
        self._show(result)
        received = self.gate.received
        self.heard += len(received.heard)
        if self.key is not None:
            assert all(h.signed for h in received.heard)
            self.admitted.append(received.data)
        self.batches.append(self.decoder.batch)
        assert self.outbox.unfit[0] == 0, self.outbox.unfit
        return b"".join(data for data, _ in self.wire.sent)

    def close(self) -> None:
        """The end: what the daemon does when it stops."""
        snapshot = checkpoint.take(self.decoder, self.pipeline, self.publisher)
        if snapshot is not None:
            assert len(snapshot.pack()) < 50_000_000
        self._show(self.daemon.finish())
        self.daemon.status()

    def _show(self, result: StepResult) -> None:
        self._feed.turn(result)
        for verdict in result.verdicts:
            json.dumps(as_json(verdict), allow_nan=False)
        assert all(isinstance(line, str) for line in lines(result.verdicts))
        assert all(isinstance(note, str) for note in self.component.notes)
