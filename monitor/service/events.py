"""The log of what happened, for programs: one event a line as JSON, or a journal entry each.

The standard library's logging, of which a thread of its own does the writing: the loop hands an
event over and never waits for a disk. Of events that wait for a slow one a bounded number is kept,
the oldest are dropped and counted. A file is looked at before each writing: one that was moved away
or deleted, as log rotation does, is begun anew.
"""

from __future__ import annotations

import json
import logging
import math
import queue
import socket
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from enum import StrEnum
from logging.handlers import QueueHandler, QueueListener, WatchedFileHandler
from pathlib import Path
from typing import Any, Final

__all__ = ["JOURNAL", "WAITING_MAX", "Event", "EventLog", "LogError", "open_event_log"]

JOURNAL: Final = "/run/systemd/journal/socket"

WAITING_MAX: Final = 4096
"""Events that wait for a slow disk."""

_CLOSE_S = 0.3
_PRIORITY = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3}


class Event(StrEnum):
    """What can happen; the key ``event`` of every entry."""

    START = "start"
    READY = "ready"
    VEHICLE = "vehicle"
    LINK_UP = "link_up"
    LINK_DOWN = "link_down"
    VERDICT = "verdict"
    REFUSED = "refused"
    NOTE = "note"
    RECORDER = "recorder"
    CHECKPOINT = "checkpoint"
    RELOAD = "reload"
    STATUS = "status"
    STOP = "stop"


class LogError(ValueError):
    """A log that cannot be opened; the message is one plain sentence."""


class EventLog:
    """Takes events; without a handler there is no log and every call does nothing.

    Parameters
    ----------
    handler
        Writes them, in a thread of its own.
    level
        The least grave that is written: debug, info, warning, error.

    Attributes
    ----------
    dropped
        Events that were dropped because the disk was too slow.
    """

    def __init__(self, handler: logging.Handler | None = None, level: str = "info") -> None:
        self.level = level
        self._handler = handler
        self._queue: queue.Queue[logging.LogRecord] = queue.Queue(WAITING_MAX)
        self._hand_over = _HandOver(self._queue)
        self._listener: QueueListener | None = None
        if handler is not None:
            self._listener = QueueListener(self._queue, handler)
            self._listener.start()

    @property
    def dropped(self) -> int:
        """Events that too many others followed before they could be written."""
        return self._hand_over.dropped

    @property
    def trouble(self) -> str:
        """Why the newest event could not be written, a sentence; empty when it was."""
        return self._handler.trouble if isinstance(self._handler, _Silent) else ""

    def log(self, event: Event, message: str, grave: str = "info", **fields: Any) -> None:
        """Log an event.

        Parameters
        ----------
        event
            What it is.
        message
            A sentence.
        grave
            debug, info, warning or error.
        fields
            Facts, of JSON's types; not-a-numbers become null.
        """
        number = _number(grave)
        if self._listener is None or number < _number(self.level):
            return
        record = logging.LogRecord("mavsentry", number, "", 0, message, None, None)
        record.event, record.fields = str(event), fields
        self._hand_over.handle(record)

    def close(self, wait_s: float = _CLOSE_S) -> None:
        """Write what waits; a disk that takes longer is not waited for."""
        listener, self._listener = self._listener, None
        if listener is None or self._handler is None:
            return
        end_s = time.monotonic() + wait_s
        while not self._queue.empty() and time.monotonic() < end_s:
            time.sleep(0.005)
        if self._queue.empty():
            listener.stop()
            with suppress(OSError):  # what the disk has not taken yet it will not take now
                self._handler.close()


def open_event_log(to: str, level: str = "info", journal: str = JOURNAL) -> EventLog:
    """The log that the settings ask for.

    Parameters
    ----------
    to
        ``[log] to``: a file, ``journal``, ``-`` or empty.
    journal
        Socket of the journal.

    Raises
    ------
    LogError
        It cannot be opened.
    """
    if not to:
        return EventLog()
    if to == "-":
        stream = _Stream()
        stream.setFormatter(_AsJson())
        return EventLog(stream, level)
    if to == "journal":
        try:
            return EventLog(_Journal(journal), level)
        except OSError:
            raise LogError("there is no journal of systemd on this computer to log to") from None
    path = Path(to).expanduser()
    try:
        file = _File(path, encoding="utf-8")
    except OSError as error:
        raise LogError(f"cannot log to {path}: {error.strerror}") from None
    file.setFormatter(_AsJson())
    return EventLog(file, level)


def entry(record: logging.LogRecord) -> dict[str, Any]:
    """An event as it is written: time, level, event and message come first, always."""
    fields: Mapping[str, Any] = getattr(record, "fields", {})
    at_us = round(record.created * 1e6)
    stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(at_us // 1_000_000))
    return {
        "time": f"{stamp}.{at_us % 1_000_000:06d}Z",
        "level": record.levelname.lower(),
        "event": getattr(record, "event", str(Event.NOTE)),
        "message": record.getMessage(),
        **{key: _plain(value) for key, value in fields.items()},
    }


class _HandOver(QueueHandler):
    """Puts an event into the queue; where that is full the oldest one makes room."""

    def __init__(self, waiting: queue.Queue[logging.LogRecord]) -> None:
        super().__init__(waiting)
        self._waiting = waiting
        self.dropped = 0

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        return record

    def enqueue(self, record: logging.LogRecord) -> None:
        while True:
            try:
                return self._waiting.put_nowait(record)
            except queue.Full:
                try:
                    self._waiting.get_nowait()
                    self.dropped += 1
                except queue.Empty:  # written just now
                    continue


class _AsJson(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return json.dumps(entry(record), ensure_ascii=False, allow_nan=False)


class _Silent(logging.Handler):
    """What cannot be written is lost; why stands in ``trouble`` until something is written."""

    trouble = ""
    _failed = ""

    def handle(self, record: logging.LogRecord) -> bool:
        self._failed = ""
        done = super().handle(record)
        self.trouble = self._failed
        return done

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        self._failed = f"events cannot be logged: {getattr(error, 'strerror', None) or error}"


class _File(_Silent, WatchedFileHandler):
    pass


class _Stream(_Silent, logging.StreamHandler):  # type: ignore[type-arg]
    pass


class _Journal(_Silent):
    """Entries of systemd's journal, with the event's facts as fields: ``journalctl MAVSENTRY_...``.

    Source: systemd.io/JOURNAL_NATIVE_PROTOCOL.
    """

    def __init__(self, path: str) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.connect(path)
        except OSError:
            self._socket.close()
            raise
        self._path = path

    def emit(self, record: logging.LogRecord) -> None:
        said = entry(record)
        fields = {
            "MESSAGE": said.pop("message"),
            "PRIORITY": _PRIORITY.get(record.levelno, 6),
            "SYSLOG_IDENTIFIER": "mavsentry",
        }
        del said["time"], said["level"]
        fields |= {f"MAVSENTRY_{key.upper()}": value for key, value in said.items()}
        data = b"".join(_field(key, value) for key, value in fields.items())
        try:
            self._socket.send(data)
        except OSError:
            self._again(data, record)

    def close(self) -> None:
        self._socket.close()
        super().close()

    def _again(self, data: bytes, record: logging.LogRecord) -> None:
        """The journal's service may have been started anew."""
        try:
            self._socket.connect(self._path)
            self._socket.send(data)
        except OSError:
            self.handleError(record)


def _field(key: str, value: object) -> bytes:
    """A field of a journal entry; one that has several lines is given with its length."""
    text = value if isinstance(value, str) else json.dumps(value)
    data = text.encode("utf-8", "replace")
    if b"\n" in data:
        return key.encode() + b"\n" + len(data).to_bytes(8, "little") + data + b"\n"
    return key.encode() + b"=" + data + b"\n"


def _number(level: str) -> int:
    return logging.getLevelNamesMapping()[level.upper()]


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
