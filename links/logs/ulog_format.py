"""ULog bytes to topics and notes, sans-IO: formats, announcements, data, all else by its type.

A ULog describes itself: ``F`` messages give the fields of each topic, ``A`` messages announce under
which number a topic's data will come, ``D`` messages are the data. Formats may hold each other.
What follows at an offset that the flag bits ``B`` name was appended after a crash: there the log
begins anew in its middle, whatever the bytes before it promised.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from links.logs.ulog_scan import (
    BAD,
    LOST,
    PASSED,
    POSITION,
    STATE,
    UNKNOWN,
    gather,
    scan,
)
from links.samples import Rows
from links.vocabulary import Rejection

__all__ = ["MAGIC", "START", "Block", "Note", "Topic", "TopicRows", "UlogParser"]

MAGIC = b"ULog\x01\x12\x35"
START = 16
"""Bytes before the first message: magic, version, start time."""

_TYPES = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
    "bool": "u1",
    "char": "S1",
}
_FIELD = re.compile(r"([A-Za-z_][\w/]*)(?:\[(\d{1,5})\])?\s+([A-Za-z_]\w*)")
_KEY = re.compile(r"([A-Za-z_]\w*)(?:\[(\d{1,5})\])?\s+(\S+)")
_LARGEST = 0xFFFF
_MAX_FORMATS, _MAX_TOPICS, _MAX_DEPTH = 4096, 8192, 8
_NUMBERS = 1 << 16
_DATA, _STOPS = ord("D"), "FARB"
_FOUND = 1 << 15  # messages that one call of the scan may report

Field = tuple[str, int, str]  # type, elements (0: no array), name


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic as it was announced.

    Attributes
    ----------
    name, instance
        As PX4 names it (``"vehicle_imu"``), and which of several.
    dtype
        Its fields; a format within a format is a structured field. Missing bytes read as zero.
    least
        Bytes without the padding at its end, which is not logged.
    """

    name: str
    instance: int
    dtype: np.dtype[np.void]
    least: int


@dataclass(frozen=True, slots=True)
class TopicRows:
    """Data of one topic: its place among all sound messages of the file, and its fields."""

    topic: Topic
    order: NDArray[np.int64]
    payload: Rows


@dataclass(frozen=True, slots=True)
class Note:
    """A message that is not data, without its header; ``kind`` is its letter."""

    order: int
    kind: str
    body: bytes

    @property
    def keyed(self) -> tuple[str, str, bytes] | None:
        """Type, key and value of ``I``, ``P``, ``M`` and ``Q``; None when they are damaged."""
        body = self.body[1:] if self.kind in "MQ" else self.body
        if not body:
            return None
        key, value = body[1 : 1 + body[0]], body[1 + body[0] :]
        match = _KEY.fullmatch(key.decode("utf-8", "replace"))
        if match is None:
            return None
        kind, count, name = match.groups()
        return (kind if count is None else f"{kind}[{count}]"), name, value

    @property
    def number(self) -> float | None:
        """Value of a parameter or a number among the information; None when it is none."""
        keyed = self.keyed
        code = None if keyed is None else _TYPES.get(keyed[0])
        if keyed is None or code is None or code == "S1":
            return None
        value = keyed[2]
        dtype = np.dtype(code)
        return float(np.frombuffer(value, dtype)[0]) if len(value) == dtype.itemsize else None


@dataclass(slots=True)
class Block:
    """What a piece of a log held, each list in the file's order."""

    data: list[TopicRows] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    rejected: Counter[tuple[str, Rejection]] = field(default_factory=Counter)


class UlogParser:
    """Turns a ULog's bytes into blocks; never raises on what they are.

    Parameters
    ----------
    wanted
        Says by a topic's name whether its data is given; None gives all.

    Attributes
    ----------
    bytes
        Bytes fed.
    incompatible
        The log says that who does not know its kind must not read it.
    topics
        Every announcement so far that could be understood.
    counts
        Topic name -> data messages given.
    """

    def __init__(self, wanted: Callable[[str], bool] | None = None) -> None:
        self._wanted = wanted
        self._formats: dict[str, list[Field]] = {}
        self._state = np.zeros(STATE, np.int64)
        self._least = np.full(_NUMBERS, -1, np.int32)
        self._most = np.full(_NUMBERS, -1, np.int32)
        self._odd = np.full(_NUMBERS, -1, np.int32)
        self._use = np.zeros(_NUMBERS, np.bool_)
        self._topic = np.full(_NUMBERS, -1, np.int64)
        self._found = np.empty((_FOUND, 4), np.int64)
        self._rest = b""
        self._begun = False
        self._appended: list[int] = []  # offsets still ahead, ascending
        self._counted = self._state.copy()
        self.bytes = 0
        self.incompatible = False
        self.topics: list[Topic] = []
        self.counts: Counter[str] = Counter()

    @property
    def messages(self) -> int:
        """Sound messages so far, of every type and topic."""
        return int(self._state[PASSED])

    @property
    def bad_bytes(self) -> int:
        """Bytes so far that belonged to no message."""
        return int(self._state[BAD])

    def feed(self, data: bytes) -> Block:
        """The messages that ``data`` completes."""
        return self._take(data, final=False)

    def finish(self) -> Block:
        """The messages of what still waited: the log has ended."""
        return self._take(b"", final=True)

    # ------------------------------------------------------------------ bytes

    def _take(self, data: bytes, *, final: bool) -> Block:
        self.bytes += len(data)
        held = self._rest + data if self._rest else data
        block = Block()
        if not self._begun:
            if len(held) < START and not final:
                self._rest = held
                return block
            self._begun = True
            self._state[LOST] = not held.startswith(MAGIC)
            self._state[POSITION] = 0 if self._state[LOST] else START
        else:
            self._state[POSITION] = 0
        if held:
            raw = np.frombuffer(held, np.uint8)
            parts = self._walk(raw, held, final, block)
            self._gather(raw, parts, block)
        self._rest = held[self._state[POSITION] :]
        self._count(block)
        return block

    def _walk(
        self, raw: NDArray[np.uint8], held: bytes, final: bool, block: Block
    ) -> list[NDArray[np.int64]]:
        """Scan all that can be; notes go to ``block``, places of data are returned.

        A part is (m, 4): index of the topic, place of the data, its size, order in the file.
        """
        state, parts = self._state, []
        base = self.bytes - len(held)
        while True:
            while self._appended and self._appended[0] <= base + state[POSITION]:
                self._appended.pop(0)
            cut = self._appended[0] - base if self._appended else len(held) + 1
            whole = cut > len(held)
            piece = raw if whole else raw[:cut]
            n = scan(
                state,
                piece,
                final or not whole,
                self._least,
                self._most,
                self._odd,
                self._use,
                self._found,
            )
            found = self._found[:n]
            is_data = found[:, 0] == _DATA
            if is_data.any():
                part = found[is_data]
                at = part[:, 1]
                number = raw[at].astype(np.int64) | raw[at + 1].astype(np.int64) << 8
                part = np.column_stack((self._topic[number], at + 2, part[:, 2] - 2, part[:, 3]))
                parts.append(part)
            for kind, at, size, order in found[~is_data].tolist():
                self._note(Note(order, chr(kind), held[at : at + size]), block)
            if n == len(self._found) or (n and chr(found[-1, 0]) in _STOPS):
                continue
            if whole:
                return parts
            state[POSITION], state[LOST] = cut, 0

    def _gather(self, raw: NDArray[np.uint8], parts: list[NDArray[np.int64]], block: Block) -> None:
        """Data of each topic as rows of its fields."""
        if not parts:
            return
        every = np.concatenate(parts)
        every = every[np.argsort(every[:, 0], kind="stable")]
        edges = np.flatnonzero(np.diff(every[:, 0])) + 1
        for part in np.split(every, edges):
            topic = self.topics[part[0, 0]]
            cells = np.zeros((len(part), topic.dtype.itemsize), np.uint8)
            gather(raw, np.ascontiguousarray(part[:, 1]), np.ascontiguousarray(part[:, 2]), cells)
            rows = cells.view(topic.dtype)[:, 0]
            self.counts[topic.name] += len(rows)
            block.data.append(TopicRows(topic, np.ascontiguousarray(part[:, 3]), rows))

    def _count(self, block: Block) -> None:
        """What was not usable since the last block."""
        new = self._state - self._counted
        self._counted = self._state.copy()
        for place, reason in ((BAD, Rejection.GARBAGE), (UNKNOWN, Rejection.UNKNOWN_MESSAGE)):
            if new[place]:
                block.rejected["frame", reason] += int(new[place])

    # ------------------------------------------------------------------ notes

    def _note(self, note: Note, block: Block) -> None:
        match note.kind:
            case "F":
                self._define(note.body)
            case "A":
                self._announce(note.body)
            case "B":
                self._flags(note)
            case "R":
                pass  # what was announced may still come
            case _:
                block.notes.append(note)

    def _define(self, body: bytes) -> None:
        """Keep a format; one that cannot be read is as good as none."""
        name, _, text = body.decode("utf-8", "replace").partition(":")
        fields: list[Field] = []
        for part in filter(None, text.split(";")):
            match = _FIELD.fullmatch(part)
            if match is None:
                return
            fields.append((match[1], int(match[2] or 0), match[3]))
        if len(self._formats) < _MAX_FORMATS or name in self._formats:
            self._formats[name] = fields

    def _announce(self, body: bytes) -> None:
        """Data under this number is of this topic from here on."""
        instance, number = body[0], body[1] | body[2] << 8
        name = body[3:].decode("utf-8", "replace")
        dtype = self._dtype(name)
        self._use[number], self._odd[number] = False, -1
        if dtype is None or not dtype.itemsize or len(self.topics) >= _MAX_TOPICS:
            self._least[number], self._most[number] = 0, _LARGEST
            return
        least = dtype.itemsize - self._padding(name)
        self._least[number], self._most[number] = least, dtype.itemsize
        topic = Topic(name, instance, dtype, least)
        known = self._topic[number]
        if known < 0 or self.topics[known] != topic:
            self._topic[number] = len(self.topics)
            self.topics.append(topic)
        self._use[number] = self._wanted is None or self._wanted(name)

    def _dtype(self, name: str, depth: int = 0) -> np.dtype[np.void] | None:
        """Fields of a format; None when it, or one within it, is not known or makes no sense."""
        fields = self._formats.get(name)
        if fields is None or depth > _MAX_DEPTH:
            return None
        parts: list[tuple[str, object]] = []
        size = 0
        for kind, count, label in fields:
            one: str | np.dtype[np.void] | None
            if kind == "char":
                one, count = f"S{count or 1}", 0
            else:
                one = _TYPES.get(kind) or self._dtype(kind, depth + 1)
            if one is None:
                return None
            part = np.dtype((one, (count,))) if count else np.dtype(one)
            size += part.itemsize
            if size > _LARGEST:
                return None
            parts.append((label, part))
        try:
            return np.dtype(parts)
        except ValueError:  # the same name twice
            return None

    def _padding(self, name: str) -> int:
        """Bytes of padding at the end of a format, and of the format at its end."""
        total = 0
        for kind, count, label in reversed(self._formats[name]):
            if not label.startswith("_padding"):
                return total + (0 if kind in _TYPES else self._padding(kind))
            total += np.dtype(_TYPES.get(kind, "u1")).itemsize * max(count, 1)
        return total

    def _flags(self, note: Note) -> None:
        """Where data was appended, and whether the log is of a kind that cannot be read."""
        if note.order:
            return
        flags = note.body[8:16]
        self.incompatible = bool(flags[0] & ~1 or any(flags[1:]))
        if flags[0] & 1:
            offsets = np.frombuffer(note.body[16:40], "<u8").tolist()
            self._appended = sorted(x for x in offsets if START < x < 1 << 62)
