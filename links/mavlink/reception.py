"""What is let in: frames of many links to one stream for the decoder, and messages for services.

Bytes of different links, and of different peers of one link, never mix: each has a framer of its
own. A frame whose checksum is right passes, in this order,

1. messages that carry keys: to nobody, whoever sent them;
2. the allow-list of system and component ids;
3. its signature, where there is a key: wrong, replayed or old ones are refused, and, unless told
   otherwise, those without any; MAVLink 1 has none;
4. our own ids: what we sent comes back on some networks; only services see it, for it may also be
   another sender that took our id;
5. which link speaks: of a sender that is heard on several, one link at a time goes to the decoder,
   the first; another steps in after its silence. With signatures it is the sender's own link id
   that speaks, so copies of one packet over two paths are one stream, and who signs takes the
   word from who does not. Services hear all links.

What is refused changes nothing but a counter. All of it depends on the arrivals and their order,
not on how they are grouped into calls.

With one input, one peer, no key and no allow-list the decoder gets every byte as it came, so that
it counts what was no frame as it does in a log. In all other cases it gets accepted frames only:
bytes left out between two halves of a forgery could make it whole.
"""

from __future__ import annotations

from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from links.mavlink.dialect import Message, load_dialect
from links.mavlink.framing import Framer, Frames
from links.mavlink.heard import Heard
from links.mavlink.signing import SECRET_MESSAGES, Verifier
from links.vocabulary import Rejection

__all__ = ["Received", "Reception", "ReceptionOptions", "allow_table"]

PEERS_MAX = 16
"""Peers of a link that may leave half a frame; one more must first send a whole accepted one."""

_V2 = 0xFD
_SIGNED = 0x01
_TAIL = 13
_RADIO = 51 << 8 | 68  # a SiK radio's own reports, which cannot be signed
_NOBODY = -1
_SIGNED_VOICE = 1 << 16  # plus the sender's link id; what speaks unsigned is a number of our links

Arrival = tuple[int, bytes, int, object]
"""Link, bytes, host time [us], who sent it there; ``links.endpoints.hub.Arrival`` is one."""


@dataclass(frozen=True, slots=True)
class ReceptionOptions:
    """Who is let in.

    Attributes
    ----------
    dialect
        Of the frames.
    allow
        ``"system:component"``, either may be ``*``; empty lets everybody in.
    accept_unsigned
        Frames without a signature are let in although there is a key.
    unsigned_links
        Numbers of links where they are in any case: a cable to the autopilot.
    inputs
        Numbers of links whose frames go to the decoder; of the others only services hear. None:
        all.
    takeover_us
        Silence of the link that speaks for a sender after which another may [us].
    """

    dialect: str = "ardupilotmega"
    allow: tuple[str, ...] = ()
    accept_unsigned: bool = False
    unsigned_links: frozenset[int] = frozenset()
    inputs: frozenset[int] | None = None
    takeover_us: int = 500_000


@dataclass(slots=True)
class Received:
    """What a turn let in.

    Attributes
    ----------
    data
        For ``Decoder.feed``.
    heard
        Accepted messages that were asked for, of all links, those with our own ids included.
    peers
        (link, peer) that sent an accepted frame.
    rejected
        (``"frame"`` or ``"radio"``, reason) -> frames, garbage in bytes.
    """

    data: bytes = b""
    heard: list[Heard] = field(default_factory=list)
    peers: set[tuple[int, object]] = field(default_factory=set)
    rejected: Counter[tuple[str, Rejection]] = field(default_factory=Counter)


def allow_table(patterns: Iterable[str]) -> bytes | None:
    """Whether each sender, ``system << 8 | component``, is let in: 65536 bytes; None for all.

    Raises
    ------
    ValueError
        For what is no ``"system:component"``.
    """
    patterns = tuple(patterns)
    if not patterns:
        return None
    table = bytearray(1 << 16)
    for pattern in patterns:
        parts = [part.strip() for part in pattern.split(":")]
        if len(parts) != 2 or not all(
            part == "*" or (part.isascii() and part.isdigit() and 0 <= int(part) <= 255)
            for part in parts
        ):
            raise ValueError(f"{pattern!r} is no SYSTEM:COMPONENT such as 1:* or 255:190")
        systems, components = (range(256) if p == "*" else (int(p),) for p in parts)
        for system in systems:
            for component in components:
                table[system << 8 | component] = 1
    return bytes(table)


class Reception:
    """Lets frames in; see above.

    Parameters
    ----------
    options
        See :class:`ReceptionOptions`.
    links
        Names of the links, in the order of their numbers.
    verifier
        Checks signatures; None without a key: then signed frames are taken as they are.

    Attributes
    ----------
    own
        Our system and component id; None before we have them.
    by_link
        Per link, reason -> frames refused (of garbage: bytes).
    accepted
        Per link, frames let in.

    Raises
    ------
    ValueError
        For an unknown dialect or a pattern that is none.
    """

    def __init__(
        self,
        options: ReceptionOptions,
        links: Sequence[str],
        verifier: Verifier | None = None,
        wants: Iterable[str] = (),
    ) -> None:
        self._dialect = load_dialect(options.dialect)
        self._allowed = allow_table(options.allow)
        self._verifier = verifier
        self._demanded = [
            verifier is not None and not options.accept_unsigned and k not in options.unsigned_links
            for k in range(len(links))
        ]
        self._takeover_us = options.takeover_us
        names = self._dialect.by_name
        self._secret = {names[name].id for name in SECRET_MESSAGES if name in names}
        self._readings: dict[int, _Reading] = {}
        self.listen(wants)
        self._streams: dict[tuple[int, object], _Stream] = {}
        self._newcomer = _Stream(Framer(self._dialect))
        inputs = options.inputs
        self._feeds = [inputs is None or k in inputs for k in range(len(links))]
        self._raw = sum(self._feeds) == 1 and verifier is None and self._allowed is None
        self._voice = array("q", [_NOBODY]) * (1 << 16)
        self._spoke_us = array("q", [0]) * (1 << 16)
        self.own: tuple[int, int] | None = None
        self.by_link: tuple[Counter[Rejection], ...] = tuple(Counter() for _ in links)
        self.accepted = [0] * len(links)

    def listen(self, wants: Iterable[str]) -> None:
        """Show the messages of these names from now on; what the dialect has not never comes."""
        names = self._dialect.by_name
        self._readings = {
            names[name].id: _Reading(names[name])
            for name in wants
            if name in names and name not in SECRET_MESSAGES
        }

    def take(self, arrivals: Sequence[Arrival]) -> Received:
        """Let in what has arrived, in its order."""
        out = Received()
        parts: list[bytes] = []
        first, count = 0, len(arrivals)
        while first < count:
            link, _, _, peer = arrivals[first]
            last = first + 1
            while last < count and arrivals[last][0] == link and arrivals[last][3] == peer:
                last += 1
            self._use(link, peer, arrivals[first:last], parts, out)
            first = last
        out.data = parts[0] if len(parts) == 1 else b"".join(parts)
        return out

    # ------------------------------------------------------------------ streams

    def _use(
        self,
        link: int,
        peer: object,
        arrivals: Sequence[Arrival],
        parts: list[bytes],
        out: Received,
    ) -> None:
        """Let in what one peer sent in a row."""
        stream = self._streams.get((link, peer))
        if stream is None:
            stream = self._enter(link, peer)
        if stream is not None:
            accepted = self._feed(stream, link, peer, arrivals, parts, out)
            stream.heard_us = arrivals[-1][2] if accepted else stream.heard_us
            return
        for arrival in arrivals:
            if (stream := self._streams.get((link, peer))) is not None:
                self._feed(stream, link, peer, [arrival], parts, out)
            elif self._judge_stranger(link, peer, arrival, parts, out):
                self._replace(link, peer, arrival[2])

    def _enter(self, link: int, peer: object) -> _Stream | None:
        """A framer for a peer that was not heard before, while there is room for one."""
        if sum(known == link for known, _ in self._streams) >= PEERS_MAX:
            return None
        if self._feeds[link] and any(self._feeds[known] for known, _ in self._streams):
            self._raw = False
        stream = self._streams[link, peer] = _Stream(Framer(self._dialect))
        return stream

    def _replace(self, link: int, peer: object, host_us: int) -> None:
        """Give a peer that sent an accepted frame the place of who was silent for longest."""
        known = [key for key in self._streams if key[0] == link]
        del self._streams[min(known, key=lambda key: self._streams[key].heard_us)]
        stream = self._streams[link, peer] = _Stream(Framer(self._dialect))
        stream.heard_us = host_us

    def _judge_stranger(
        self, link: int, peer: object, arrival: Arrival, parts: list[bytes], out: Received
    ) -> bool:
        """Let whole frames of a datagram in, keeping nothing of it."""
        stream = self._newcomer
        accepted = self._feed(stream, link, peer, [arrival], parts, out)
        frames = stream.framer.finish()
        if len(frames):
            accepted += self._judge(frames, stream, link, peer, parts, out)
        self._count(stream.framer, link, out)
        stream.marks.clear()
        return accepted > 0

    def _feed(
        self,
        stream: _Stream,
        link: int,
        peer: object,
        arrivals: Sequence[Arrival],
        parts: list[bytes],
        out: Received,
    ) -> int:
        """Let in what these bytes complete; how many frames were accepted."""
        framer, marks = stream.framer, stream.marks
        at = framer.bytes
        for _, data, host_us, _ in arrivals:
            if data:
                at += len(data)
                marks.append((at, host_us))
        first = arrivals[0][1]
        block = first if len(arrivals) == 1 else b"".join([data for _, data, _, _ in arrivals])
        if self._raw and self._feeds[link]:
            parts.append(block)
        frames = framer.feed(block)
        accepted = self._judge(frames, stream, link, peer, parts, out) if len(frames) else 0
        self._count(framer, link, out)
        done = framer.bytes - framer.pending
        while marks and marks[0][0] <= done:
            marks.popleft()
        return accepted

    def _count(self, framer: Framer, link: int, out: Received) -> None:
        """What was no frame, by reason; the decoder counts it where it gets every byte."""
        if rejected := framer.take_rejected():
            self.by_link[link].update({why: n for (_, why), n in rejected.items()})
            if not (self._raw and self._feeds[link]):
                out.rejected.update(rejected)

    # ------------------------------------------------------------------ frames

    def _judge(
        self,
        frames: Frames,
        stream: _Stream,
        link: int,
        peer: object,
        parts: list[bytes],
        out: Received,
    ) -> int:
        """Let in or refuse each frame; how many were accepted."""
        block = frames.data
        own = _NOBODY if self.own is None else self.own[0] << 8 | self.own[1]
        allowed, verifier, demanded = self._allowed, self._verifier, self._demanded[link]
        voices, spoke_us, takeover_us = self._voice, self._spoke_us, self._takeover_us
        arrived = iter(stream.marks)
        upto, host_us = next(arrived)
        feeds, accepted = self._feeds[link] and not self._raw, 0
        begin = end_of_run = 0
        for row in frames.table.tolist():
            start, end, payload, length, message, system, component, _, _, position = row
            while upto < position + end - start:
                upto, host_us = next(arrived)
            sender = system << 8 | component
            if message in self._secret:
                self._refuse(link, Rejection.SECRET, out)
                continue
            if allowed is not None and not allowed[sender]:
                self._refuse(link, Rejection.NOT_ALLOWED, out)
                continue
            signed, voice = False, link
            if verifier is not None:
                if block[start] == _V2 and block[start + 2] & _SIGNED:
                    why = verifier.check(block[start:end])
                    if why is not None:
                        self._refuse(link, why, out)
                        continue
                    signed, voice = True, _SIGNED_VOICE + block[end - _TAIL]
                elif demanded:
                    self._refuse(link, Rejection.UNSIGNED, out, sender)
                    continue
            if message in self._readings:
                reading = self._readings[message]
                fields = reading.fields(block[payload : payload + length])
                frame = block[start:end]
                out.heard.append(
                    Heard(reading.name, system, component, link, fields, host_us, signed, frame)
                )
            if sender == own:
                self._refuse(link, Rejection.OWN_ECHO, out)
                continue
            accepted += 1
            if not feeds:
                continue
            if (spoke := voices[sender]) != voice:
                proven = voice >= _SIGNED_VOICE > spoke
                if not (spoke == _NOBODY or proven or host_us - spoke_us[sender] > takeover_us):
                    self._refuse(link, Rejection.SPARE_LINK, out)
                    continue
                voices[sender] = voice
            spoke_us[sender] = host_us
            if start != end_of_run:
                if end_of_run:
                    parts.append(block[begin:end_of_run])
                begin = start
            end_of_run = end
        if end_of_run:
            parts.append(block[begin:end_of_run])
        if accepted:
            self.accepted[link] += accepted
            out.peers.add((link, peer))
        return accepted

    def _refuse(self, link: int, why: Rejection, out: Received, sender: int = _NOBODY) -> None:
        out.rejected["radio" if sender == _RADIO else "frame", why] += 1
        self.by_link[link][why] += 1


class _Stream:
    """Bytes of one peer.

    Attributes
    ----------
    framer
        Its own.
    marks
        (end in the stream, host time [us]) of arrivals with bytes that are still undecided.
    heard_us
        When an accepted frame came last; -1 never.
    """

    __slots__ = ("framer", "heard_us", "marks")

    def __init__(self, framer: Framer) -> None:
        self.framer = framer
        self.marks: deque[tuple[int, int]] = deque()
        self.heard_us = -1


class _Reading:
    """Payload to fields by name."""

    __slots__ = ("_places", "_size", "_unpack", "name")

    def __init__(self, message: Message) -> None:
        self.name = message.name
        self._unpack: Callable[[bytes], tuple[Any, ...]] = message.packer.unpack
        self._size = message.packer.size
        self._places: list[tuple[str, int, int, bool]] = []
        at = 0
        for name, count in zip(message.wire_fields, message.wire_counts, strict=True):
            self._places.append((name, at, count, message.dtype[name].kind == "S"))
            at += count

    def fields(self, payload: bytes) -> dict[str, Any]:
        """Fields by name: what was cut off is zero, text ends at its first zero byte."""
        values = self._unpack(payload[: self._size].ljust(self._size, b"\0"))
        return {
            name: values[at].partition(b"\0")[0].decode("ascii", "replace")
            if text
            else values[at]
            if count == 1
            else list(values[at : at + count])
            for name, at, count, text in self._places
        }
