"""Reading a DataFlash log (.BIN): every field of every record, beside DFReader and mavparser.

What DFReader does is shown twice. Its ``recv_msg`` unpacks a record's fields, but scales numbers
and decodes texts only when a field is asked for; ``to_dict`` asks for all of them. As our columns
are scaled, reading the values is the work of the same kind: ``pymavlink`` is ``recv_msg`` and
``to_dict``, ``pymavlink_unread`` is ``recv_msg`` alone. mavparser makes a dictionary of scaled
values of each record; of its two ways the faster is taken, which drops each before the next. None
of the three keeps what it has read, and neither do we: the columns of a step, two mebibytes of the
file, give way to those of the next.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from links.logs.dataflash import read_dataflash
from links.logs.dataflash_parser import DataflashParser
from monitor.commands.bench_cases import BenchCase, missing

__all__ = ["cases"]

STEP = 1 << 21
"""Bytes whose columns are in memory at once."""

PEER_BYTES = 2_000_000
"""A reader that makes an object of every record gets this much of the log only."""

FAST_PEER_BYTES = 20_000_000
"""And a compiled one this much."""


def cases(log: Path, folder: Path) -> list[BenchCase]:
    """Cases on a DataFlash log; ``folder`` takes the parts of it that peers read."""
    records = columns(log)
    size = f"a log of {log.stat().st_size / 1e6:.0f} MB"
    peers: dict[str, Callable[[], object]] = {}
    peer_calls = {}
    absent = missing("pymavlink", "mavparser")
    if "pymavlink" not in absent:
        part = _part(log, folder / "part.bin", PEER_BYTES)
        peers["pymavlink"] = lambda: dfreader(part, read=True)
        peers["pymavlink_unread"] = lambda: dfreader(part, read=False)
        peer_calls["pymavlink"] = peer_calls["pymavlink_unread"] = dfreader(part, read=False)
    if "mavparser" not in absent:
        large = _part(log, folder / "large.bin", FAST_PEER_BYTES)
        peers["mavparser"] = lambda: mavparser(large)
        peer_calls["mavparser"] = mavparser(large)
    return [
        BenchCase(
            "decode_bin",
            run=lambda: columns(log),
            calls=records,
            peers=peers,
            note=f"time per record of {size}, from the file to every field in columns; pymavlink "
            "with every field read, pymavlink_unread without; the peers on a part of it",
            peer_calls=peer_calls,
            missing=absent,
        ),
        BenchCase(
            "bin_rows",
            run=lambda: sum(len(batch) for batch in read_dataflash(log)),
            calls=records,
            note=f"time per record of {size}, from the file to checked rows in SI units",
        ),
    ]


def columns(log: Path) -> int:
    """Read every field of every record as a column of its step; return the records."""
    parser = DataflashParser()
    with log.open("rb") as file:
        while data := file.read(STEP):
            for tables in parser.feed(data):
                for table in tables:
                    for _ in table.columns():
                        pass
    for _ in parser.finish():
        pass
    return parser.records


def dfreader(log: Path, *, read: bool) -> int:
    """Read a log with pymavlink, all fields of each record or none; return the records."""
    from pymavlink.DFReader import DFReader_binary

    reader, records = DFReader_binary(str(log)), 0
    while (message := reader.recv_msg()) is not None:
        records += 1
        if read:
            message.to_dict()
    reader.data_map.close()
    reader.filehandle.close()
    return records


def mavparser(log: Path) -> int:
    """Read a log with mavparser, record by record; return the records."""
    messages: Any = importlib.import_module("mavparser").parse(str(log), mode="iterator")
    return sum(1 for _ in messages)


def _part(log: Path, part: Path, size: int) -> Path:
    with log.open("rb") as file:
        part.write_bytes(file.read(size))
    return part
