"""A live link: messages as they come in, and a message there and back over UDP."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from links.endpoints import Endpoint, LinkOptions
from links.endpoints.udp import UdpListener, UdpSpeaker
from links.mavlink import Decoder, DecoderOptions, Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from links.mavlink.reception import Reception, ReceptionOptions
from links.mavlink.signing import Signer, SigningClock, SigningKey, Verifier, is_signed
from monitor.commands.bench_cases import BenchCase, missing
from monitor.recorder import whole_frames

__all__ = ["BLOCKS", "cases", "decode_live", "frames_of", "udp_roundtrip"]

BLOCKS = {"decode_live": 8, "decode_live_1": 1, "decode_live_32": 32}
"""Case -> frames of a block: what a turn of the daemon gathers in 20 ms at 400 messages a second, a
datagram of its own for each message, and 1600 messages a second."""

TURN = 8
"""Frames of a turn in the cases of reception."""

WANTED = ("HEARTBEAT", "COMMAND_LONG", "PARAM_SET", "TIMESYNC")

MESSAGES = 4000
TRIPS = 300

WAIT_S = 1.0
"""A datagram on loopback that has not come by then is lost [s]."""


def cases(log: Path) -> list[BenchCase]:
    """Cases on the frames of a telemetry log."""
    frames = frames_of(log)[:MESSAGES]
    return [
        *(decode_live(name, frames, size) for name, size in BLOCKS.items()),
        reception_live(frames),
        reception_signed(frames),
        udp_roundtrip(),
    ]


def frames_of(log: Path) -> list[bytes]:
    """Its frames, without their stamps."""
    framer = Framer(load_dialect(), stamped=True)
    parts = (framer.feed(log.read_bytes()), framer.finish())
    return [frame for part in parts for frame, _ in whole_frames(part)]


def reception_live(frames: list[bytes]) -> BenchCase:
    """What a turn of eight frames costs before the decoder has it, with one link and no key."""
    blocks = _joined(frames)
    reception = Reception(ReceptionOptions(), ["link"], wants=WANTED)

    def ours() -> int:
        return sum(len(reception.take([(0, block, 0, None)]).data) for block in blocks)

    return BenchCase(
        "reception_live",
        run=ours,
        calls=len(blocks),
        note=f"time per turn of {TURN} frames: who is let in, one link, no key",
    )


def reception_signed(frames: list[bytes]) -> BenchCase:
    """Signatures checked, beside pymavlink; time per message.

    Ours gives the decoder its bytes; ``pymavlink`` makes an object of each message besides.
    """
    secret = hashlib.sha256(b"a passphrase").digest()
    key = SigningKey(secret)
    signer = Signer(key, SigningClock(), 0)
    signed = [signer.sign(frame) for frame in frames if frame[0] == 0xFD and not is_signed(frame)]
    blocks = _joined(signed)

    def ours() -> int:
        gate = Verifier(key, SigningClock())
        reception = Reception(ReceptionOptions(), ["link"], gate, WANTED)
        for block in blocks:
            reception.take([(0, block, 0, None)])
        return reception.accepted[0]

    peers: dict[str, Callable[[], object]] = {}
    absent = missing("pymavlink")
    if not absent:
        from pymavlink.dialects.v20 import ardupilotmega

        def parse_buffer() -> int:
            parser = ardupilotmega.MAVLink(None)
            parser.signing.secret_key = secret
            return sum(len(parser.parse_buffer(block)) for block in blocks)

        peers = {"pymavlink": parse_buffer}
    return BenchCase(
        "reception_signed",
        run=ours,
        calls=len(signed),
        peers=peers,
        note=f"time per signed message, {TURN} to a turn; pymavlink also decodes it",
        missing=absent,
    )


def _joined(frames: list[bytes]) -> list[bytes]:
    return [b"".join(frames[i : i + TURN]) for i in range(0, len(frames), TURN)]


def decode_live(name: str, frames: list[bytes], size: int) -> BenchCase:
    """Blocks of ``size`` frames from bytes to values, beside pymavlink; time per message.

    Ours is what the daemon calls: :meth:`links.mavlink.Decoder.feed` finds the frames in a block,
    checks them, counts them, gives them vehicle time, fills, checks and ranks the rows of the
    sensors in SI units and numbers them; a message that no sensor needs ends when it is counted.
    ``pymavlink`` is ``parse_char`` given each whole frame, ``pymavlink_buffer`` is ``parse_buffer``
    given the same blocks: both find and check the frames and make an object of each message,
    whatever it is, with the numbers of the wire and no time, unit, bound or order.

    Decoders and parsers are made before and know the vehicle; each round reads the same frames.
    """
    blocks = [b"".join(frames[i : i + size]) for i in range(0, len(frames), size)]
    decoder = Decoder()
    for block in blocks:
        decoder.feed(block)

    def ours() -> int:
        return sum(len(decoder.feed(block).rows) for block in blocks)

    peers: dict[str, Callable[[], object]] = {}
    absent = missing("pymavlink")
    if not absent:
        from pymavlink.dialects.v20 import ardupilotmega

        single, several = ardupilotmega.MAVLink(None), ardupilotmega.MAVLink(None)

        def parse_char() -> int:
            return sum(single.parse_char(frame) is not None for frame in frames)

        def parse_buffer() -> int:
            return sum(len(several.parse_buffer(block)) for block in blocks)

        peers = {"pymavlink": parse_char, "pymavlink_buffer": parse_buffer}
    return BenchCase(
        name,
        run=ours,
        calls=len(frames),
        peers=peers,
        note=f"time per message from bytes to checked rows, {size} to a block; parse_char has each "
        "frame alone",
        missing=absent,
    )


def udp_roundtrip(trips: int = TRIPS) -> BenchCase:
    """A NAMED_VALUE_FLOAT over UDP loopback, read at the far end and sent back from there.

    Per trip, on both sides alike: encode and send, receive and decode, encode what was read and
    send, receive and decode, and compare with what was sent. Ours are two endpoints, each with an
    :class:`~links.mavlink.Encoder` and a :class:`~links.mavlink.Decoder`; theirs two
    ``mavutil`` connections with ``recv_match`` and ``named_value_float_send``. Sockets are opened
    anew in each round, and the first datagram tells the listening side who speaks.
    """
    there, back = _Voice(1), _Voice(2)
    there.listen_to(back)
    back.listen_to(there)

    def ours() -> None:
        far = UdpListener("far", "127.0.0.1", 0, LinkOptions())
        near = UdpSpeaker("near", "127.0.0.1", far.port, LinkOptions())
        with far, near:
            for k in range(trips):
                near.send(there.say(k, float(k)))
                far.send(back.say(*back.hear(far)))
                _same(there.hear(near), k)

    absent = missing("pymavlink")
    return BenchCase(
        "udp_roundtrip",
        run=ours,
        calls=trips,
        peers={} if absent else {"pymavlink": lambda: _theirs(trips)},
        note="a message over UDP loopback there and back, encoded and decoded on both ends",
        missing=absent,
    )


class _Voice:
    """One end: it says named values as system ``system`` and hears those of the other."""

    def __init__(self, system: int) -> None:
        self._encoder = Encoder(system, 1)
        self._decoder = Decoder(DecoderOptions(system_id=3 - system))

    def listen_to(self, other: _Voice) -> None:
        """Know the other as the vehicle."""
        beat = other._encoder.encode("HEARTBEAT", type=1, autopilot=3)
        self._decoder.feed(beat + other._encoder.encode("SYSTEM_TIME", time_boot_ms=1))

    def say(self, t_ms: int, value: float) -> bytes:
        return self._encoder.encode(
            "NAMED_VALUE_FLOAT", time_boot_ms=t_ms, name="ECHO", value=value
        )

    def hear(self, endpoint: Endpoint) -> tuple[int, float]:
        """Time [ms] and value of the next one."""
        while received := endpoint.recv(WAIT_S):
            for data, host_us in received:
                batch = self._decoder.feed(data, host_us)
                if (rows := batch.rows.get("named")) is not None:
                    _, t_us, _, value = rows[0].item()
                    return t_us // 1000, value
        raise TimeoutError("a datagram on loopback was lost")


def _theirs(trips: int) -> None:
    from pymavlink import mavutil

    far = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=2)
    port = far.port.getsockname()[1]
    near = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1)
    try:
        for k in range(trips):
            near.mav.named_value_float_send(k, b"ECHO", float(k))
            far.mav.named_value_float_send(*_heard(far))
            told, _, value = _heard(near)
            _same((told, value), k)
    finally:
        near.close()
        far.close()


def _heard(connection: Any) -> tuple[int, bytes, float]:
    message = connection.recv_match(type="NAMED_VALUE_FLOAT", blocking=True, timeout=WAIT_S)
    if message is None:
        raise TimeoutError("a datagram on loopback was lost")
    return message.time_boot_ms, message.name.encode(), message.value


def _same(heard: tuple[int, float], k: int) -> None:
    if heard[1] != k:
        raise RuntimeError(f"sent {k} and heard {heard}")
