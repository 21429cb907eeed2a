"""Decoding and the network: a telemetry log, a live stream, a datagram there and back."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path

from links.endpoints.udp import UdpEndpoint
from links.logs.tlog import read_tlog, tlog_columns
from links.mavlink import Decoder
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from monitor.commands.bench_cases import BULK_BYTES, BenchCase, missing
from monitor.recorder import whole_frames

__all__ = ["cases", "decode_tlog"]

GATHERED = 8
"""Frames of one turn of the daemon: 400 messages a second gathered for 20 ms."""

PEER_BYTES = 400_000
"""A log reader that makes an object of every message gets this much of the log only."""

FAST_PEER_BYTES = 20_000_000
"""And a compiled one at least this much."""


def cases(log: Path, folder: Path) -> list[BenchCase]:
    """Cases on the frames of a telemetry log; ``folder`` takes what a peer must read."""
    frames = _frames(log)
    return [
        decode_tlog(log, folder),
        _tlog_rows(log, len(frames)),
        _decode_live(frames[:4000]),
        _udp_roundtrip(frames[:100]),
    ]


def _frames(log: Path) -> list[bytes]:
    framer = Framer(load_dialect(), stamped=True)
    parts = (framer.feed(log.read_bytes()), framer.finish())
    return [frame for part in parts for frame, _ in whole_frames(part)]


def decode_tlog(log: Path, folder: Path, bulk: int = BULK_BYTES) -> BenchCase:
    """A log of ``bulk`` bytes to the columns of all its messages, beside two readers.

    All three check each frame's checksum and take every message of the ArduPilot dialect. Ours and
    fasttlogparser end with all fields of all messages in arrays, in memory at once;
    ``mavutil.recv_match`` makes an object of each message, whose fields it has unpacked, and drops
    it before the next.
    """
    once = log.read_bytes()
    large = _repeated(once, bulk, folder / "large.tlog")

    def ours() -> int:
        return tlog_columns(large).frames

    peers: dict[str, Callable[[], object]] = {}
    peer_calls = {}
    absent = missing("pymavlink", "fasttlogparser")
    if "pymavlink" not in absent:
        small = folder / "small.tlog"
        small.write_bytes(once[:PEER_BYTES])

        def recv_match() -> int:
            from pymavlink import mavutil

            count = 0
            reader = mavutil.mavlink_connection(str(small), dialect="ardupilotmega")
            while reader.recv_match() is not None:
                count += 1
            reader.close()
            return count

        peers["pymavlink"] = recv_match
        peer_calls["pymavlink"] = recv_match()
    if "fasttlogparser" not in absent:
        parse = importlib.import_module("fasttlogparser").parseTLog
        part = _repeated(once, min(bulk, FAST_PEER_BYTES), folder / "part.tlog")
        peers["fasttlogparser"] = lambda: parse(str(part))
        peer_calls["fasttlogparser"] = tlog_columns(part).frames
    return BenchCase(
        "decode_tlog",
        run=ours,
        calls=ours(),
        peers=peers,
        note=f"time per message of a log of {large.stat().st_size / 1e6:.0f} MB, from the file to "
        "every field of every message; the peers on a part of it",
        peer_calls=peer_calls,
        missing=absent,
    )


def _repeated(once: bytes, least: int, file: Path) -> Path:
    """A log over and over until it has ``least`` bytes."""
    with file.open("wb") as out:
        for _ in range(-(-least // len(once))):
            out.write(once)
    return file


def _tlog_rows(log: Path, messages: int) -> BenchCase:
    return BenchCase(
        "tlog_rows",
        run=lambda: sum(len(batch) for batch in read_tlog(log)),
        calls=messages,
        note="time per message of a telemetry log, from the file to checked rows in SI units",
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
