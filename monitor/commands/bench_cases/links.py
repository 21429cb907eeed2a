"""Decoding and the network: a telemetry log, a live stream, a datagram there and back."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

from links.endpoints.udp import UdpEndpoint
from links.logs import read_tlog
from links.mavlink import Decoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.commands.bench_cases import BenchCase
from monitor.recorder import whole_frames

__all__ = ["cases"]

GATHERED = 8
"""Frames of one turn of the daemon: 400 messages a second gathered for 20 ms."""

PEER_BYTES = 400_000
"""A log reader that makes an object of every message gets this much of the log only."""


def cases(log: Path, folder: Path) -> list[BenchCase]:
    """Cases on the frames of a telemetry log; ``folder`` takes what a peer must read."""
    frames = _frames(log)
    return [
        _decode_tlog(log, len(frames), folder),
        _decode_live(frames[:4000]),
        _udp_roundtrip(frames[:100]),
    ]


def _frames(log: Path) -> list[bytes]:
    framer = Framer(load_dialect(), stamped=True)
    parts = (framer.feed(log.read_bytes()), framer.finish())
    return [frame for part in parts for frame, _ in whole_frames(part)]


def _decode_tlog(log: Path, messages: int, folder: Path) -> BenchCase:
    def ours() -> int:
        return sum(len(batch) for batch in read_tlog(log))

    peers: dict[str, Callable[[], object]] = {}
    peer_calls = {}
    if importlib.util.find_spec("pymavlink"):
        part = folder / "part.tlog"
        part.write_bytes(log.read_bytes()[:PEER_BYTES])

        def pymavlink() -> int:
            from pymavlink import mavutil

            count = 0
            reader = mavutil.mavlogfile(str(part))
            while reader.recv_msg() is not None:
                count += 1
            reader.close()
            return count

        peers["pymavlink"] = pymavlink
        peer_calls["pymavlink"] = pymavlink()
    return BenchCase(
        "decode_tlog",
        run=ours,
        calls=messages,
        peers=peers,
        note="time per message of a telemetry log; ours gives checked SI rows, the peer objects",
        peer_calls=peer_calls,
        missing=_missing("fasttlogparser"),
    )


def _decode_live(frames: list[bytes]) -> BenchCase:
    blocks = [b"".join(frames[i : i + GATHERED]) for i in range(0, len(frames), GATHERED)]

    def ours() -> None:
        decoder = Decoder()
        for block in blocks:
            decoder.feed(block)

    peers: dict[str, Callable[[], object]] = {}
    if importlib.util.find_spec("pymavlink"):
        from pymavlink.dialects.v20 import ardupilotmega

        def pymavlink() -> None:
            parser = ardupilotmega.MAVLink(None)
            for block in blocks:
                parser.parse_buffer(block)

        peers["pymavlink"] = pymavlink
    return BenchCase(
        "decode_live",
        run=ours,
        calls=len(frames),
        peers=peers,
        note=f"time per message in blocks of {GATHERED}, as a turn of the daemon gathers them",
    )


def _udp_roundtrip(frames: list[bytes]) -> BenchCase:
    def ours() -> None:
        far = UdpEndpoint("far", "127.0.0.1", 0, listen=True)
        near = UdpEndpoint("near", "127.0.0.1", far.port, listen=False)
        with far, near:
            for frame in frames:
                near.send(frame)
                ((echo, _),) = far.recv(1.0)
                far.send(echo)
                near.recv(1.0)

    return BenchCase(
        "udp_roundtrip",
        run=ours,
        calls=len(frames),
        note="a frame over UDP loopback there and back through our endpoints: the floor of latency",
    )


def _missing(*peers: str) -> tuple[str, ...]:
    return tuple(peer for peer in peers if importlib.util.find_spec(peer) is None)
