"""Telemetry logs in bulk: to columns, and to rows."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from links.logs.tlog import read_tlog, tlog_columns
from monitor.commands.bench_cases import BULK_BYTES, BenchCase, missing

__all__ = ["cases", "decode_tlog"]

PEER_BYTES = 400_000
"""A log reader that makes an object of every message gets this much of the log only."""

FAST_PEER_BYTES = 20_000_000
"""And a compiled one at least this much."""


def cases(log: Path, folder: Path) -> list[BenchCase]:
    """Cases on a telemetry log; ``folder`` takes what a peer must read."""
    return [decode_tlog(log, folder), _tlog_rows(log, tlog_columns(log).frames)]


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
