"""Log files to the same batches that a live link gives.

``open_log(path)`` looks at the content and the name and returns a reader: iterate it for batches,
then ask ``reader.info``.
"""

import difflib
from collections import Counter
from pathlib import Path

from links.clock import UNIX_FROM_US
from links.logs.base import LogError, LogInfo, LogReader
from links.logs.dataflash import DataflashReader, read_dataflash
from links.logs.tlog import TlogReader, TlogWriter, read_tlog
from links.logs.ulog import UlogReader, read_ulog
from links.mavlink.options import DecoderOptions

__all__ = [
    "DataflashReader",
    "LogError",
    "LogInfo",
    "LogReader",
    "TlogReader",
    "TlogWriter",
    "UlogReader",
    "open_log",
    "read_dataflash",
    "read_tlog",
    "read_ulog",
]

_ULOG_MAGIC = b"ULog\x01\x12\x35"
_DATAFLASH_MAGIC = b"\xa3\x95\x80"
_MAVLINK_MAGIC = b"\xfe\xfd"
_SUFFIXES = (".tlog", ".bin", ".ulg")
_LATEST_US = 1 << 52
"""No log was written after the year 2112 [us]."""
_PACKED = {
    b"\x1f\x8b": "gzip",
    b"PK\x03\x04": "zip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\0": "xz",
    b"7z\xbc\xaf": "7z",
    b"\x28\xb5\x2f\xfd": "zstd",
}
"""How files begin that logs are packed into."""


def open_log(path: Path | str, options: DecoderOptions | None = None) -> LogReader:
    """Reader of a log file, chosen by its content; where its beginning is damaged, by its name.

    Parameters
    ----------
    path
        A .tlog, .BIN or .ulg file.
    options
        How messages become samples; None: as ArduPilot and PX4 send them.

    Returns
    -------
    LogReader
        Iterate it for batches; its ``info`` tells the rest.

    Raises
    ------
    LogError
        When there is no such file, it is empty or a directory, or its format is not supported.
    """
    path = Path(path)
    try:
        with open(path, "rb") as file:
            head = file.read(16)
    except IsADirectoryError:
        raise LogError(f"{path} is a folder: name the logs in it ({_within(path)})") from None
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}{_near(path)}") from None
    if not head:
        raise LogError(
            f"{path} is empty: whoever recorded it wrote nothing (disk full, switched off at once?)"
        )
    for magic, name in _PACKED.items():
        if head.startswith(magic):
            raise LogError(f"{path} is packed ({name}): unpack it first")
    suffix = path.suffix.lower()
    if _stamped(head):
        return read_tlog(path, options)
    if head.startswith(_ULOG_MAGIC):
        return read_ulog(path, options)
    if head.startswith(_DATAFLASH_MAGIC) or suffix == ".bin":
        return read_dataflash(path, options)
    if suffix == ".ulg":
        return read_ulog(path, options)
    if suffix == ".log" and head.startswith(b"FMT"):
        raise LogError(
            f"{path} is a DataFlash log as text; only the binary .BIN can be read: "
            "give the one that it was made of"
        )
    if suffix not in _SUFFIXES and _is_text(head):
        raise LogError(
            f"{path} is text, no flight log; those are .tlog (telemetry), .BIN (ArduPilot) and "
            ".ulg (PX4)"
        )
    return read_tlog(path, options)


def _stamped(head: bytes) -> bool:
    """Whether a file begins as a telemetry log does: a Unix stamp, then a MAVLink frame."""
    stamp_us = int.from_bytes(head[:8], "big")
    return len(head) > 8 and UNIX_FROM_US <= stamp_us < _LATEST_US and head[8] in _MAVLINK_MAGIC


def _near(path: Path) -> str:
    """A log of nearly the same name beside it, as a question."""
    try:
        beside = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name, beside, n=1, cutoff=0.75)
    return f"; did you mean {path.with_name(near[0])}?" if near and not path.exists() else ""


def _within(folder: Path) -> str:
    """A pattern that fits logs of a folder, of the kind of which there are most."""
    try:
        kinds = Counter(e.suffix for e in folder.iterdir() if e.suffix.lower() in _SUFFIXES)
    except OSError:
        kinds = Counter()
    return f"{folder}/*{kinds.most_common(1)[0][0]}" if kinds else "there is none"


def _is_text(head: bytes) -> bool:
    return all(byte in b"\t\r\n" or 32 <= byte < 127 for byte in head)
