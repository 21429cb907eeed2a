"""Reading PX4's ULog (.ulg): every field of every topic, beside pyulog.

pyulog reads a whole file and keeps its columns; ours come a mebibyte of the file at a time. Both
read all topics, parameters and texts.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from links.logs.base import CHUNK
from links.logs.ulog import columns_of, read_ulog
from links.logs.ulog_format import Block, UlogParser
from monitor.commands.bench_cases import BenchCase, missing

__all__ = ["cases"]


def cases(log: Path) -> list[BenchCase]:
    """Cases on a ULog."""
    messages = columns(log)
    size = f"a log of {log.stat().st_size / 1e6:.0f} MB"
    absent = missing("pyulog")
    peers: dict[str, Callable[[], object]] = {}
    if not absent:
        peers["pyulog"] = lambda: importlib.import_module("pyulog").ULog(str(log))
    return [
        BenchCase(
            "decode_ulg",
            run=lambda: columns(log),
            calls=messages,
            peers=peers,
            note=f"time per message of {size}, from the file to every field in columns",
            missing=absent,
        ),
        BenchCase(
            "ulg_rows",
            run=lambda: sum(len(batch) for batch in read_ulog(log)),
            calls=messages,
            note=f"time per message of {size}, from the file to checked rows in SI units",
        ),
    ]


def columns(log: Path) -> int:
    """Read every field of every topic as a column of its step; return the log's messages."""
    parser = UlogParser()
    with log.open("rb") as file:
        while data := file.read(CHUNK):
            _read(parser.feed(data))
    _read(parser.finish())
    return parser.messages


def _read(block: Block) -> None:
    for part in block.data:
        rows = columns_of(part.payload)
        for name in rows.dtype.names or ():
            rows[name]
