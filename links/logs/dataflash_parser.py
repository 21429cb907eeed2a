"""DataFlash bytes to tables: the records of each type, in columns, sans-IO.

The walk from header to header and the copying are compiled (:mod:`links.logs.dataflash_scan`); the
few records that describe others are read here. What one of them tells counts from its place in the
file on, however the bytes came in.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.logs.dataflash_format import CHAR_SIZES, Format, Table, Units, first_format
from links.logs.dataflash_scan import (
    BAD,
    CUT,
    FMT,
    FMT_LENGTH,
    HEADER,
    IN_STEP,
    LOGS,
    POSITION,
    STATE,
    TYPES,
    UNKNOWN,
    gather,
    scan,
)

__all__ = ["DataflashParser"]

_COLUMNS = {
    "UNIT": {"Id": "iu", "Label": "S"},
    "MULT": {"Id": "iu", "Mult": "iuf"},
    "FMTU": {"FmtType": "iu", "UnitIds": "S", "MultIds": "S"},
}
"""What is read of the records that give meaning to others: columns, the kinds they may have."""

_DESCRIBING = frozenset({"FMT", *_COLUMNS})
_RECORDS = 1 << 16
"""Records of one step of the walk."""

MAX_RECORD = 256
"""No record is longer [bytes]."""

Ints = NDArray[np.int64]


class DataflashParser:
    """Turns the bytes of a DataFlash log into tables; never raises on what the bytes are.

    Parameters
    ----------
    wanted
        Names of the messages that are given; None for all.

    Attributes
    ----------
    records
        Records so far, of all types.
    by_name
        Message name -> records.
    """

    def __init__(self, wanted: frozenset[str] | None = None) -> None:
        self._wanted = wanted
        self._rest = b""
        self._buffer = np.empty(0, np.uint8)
        self._state = np.zeros(STATE, np.int64)
        self._state[IN_STEP] = 1
        self._lengths = np.zeros(TYPES, np.int64)
        self._lengths[FMT] = FMT_LENGTH
        self._defined_in = np.zeros(TYPES, np.int64)
        self._formats: dict[int, Format] = {FMT: first_format()}
        self._units = Units()
        self._starts = np.empty(_RECORDS, np.int64)
        self._took_effect = np.empty(_RECORDS, np.uint8)
        self.records = 0
        self.by_name: Counter[str] = Counter()

    @property
    def bad_bytes(self) -> int:
        """Bytes that belonged to no record."""
        return int(self._state[BAD])

    @property
    def cut(self) -> int:
        """Records that were cut short or run into."""
        return int(self._state[CUT])

    @property
    def unknown(self) -> int:
        """Records of a type that no FMT record had told."""
        return int(self._state[UNKNOWN])

    @property
    def logs(self) -> int:
        """Logs that began in the file: one for each time that the autopilot opened it."""
        return int(self._state[LOGS])

    def feed(self, data: bytes) -> Iterator[list[Table]]:
        """Tables of the records that ``data`` completes, in steps of whole records.

        A log that begins within the file begins a step.
        """
        return self._walk(data, final=False)

    def finish(self) -> Iterator[list[Table]]:
        """Tables of what still waited: the file has ended."""
        return self._walk(b"", final=True)

    # ------------------------------------------------------------------ records

    def _walk(self, data: bytes, *, final: bool) -> Iterator[list[Table]]:
        raw = self._held(data)
        state, counts = self._state, np.empty(TYPES, np.int64)
        state[POSITION] = 0
        while True:
            before = int(state[POSITION])
            found = scan(
                raw,
                final,
                CHAR_SIZES,
                self._lengths,
                self._defined_in,
                state,
                self._starts,
                counts,
                self._took_effect,
            )
            if found:
                yield self._tables(raw, found, counts)
            elif state[POSITION] == before:
                break
        self._rest = raw[int(state[POSITION]) :].tobytes()

    def _held(self, data: bytes) -> NDArray[np.uint8]:
        """What waited and what came new, in memory that the next piece takes over."""
        new, waiting = np.frombuffer(data, np.uint8), len(self._rest)
        if not waiting:
            return new
        size = waiting + len(new)
        if size > len(self._buffer):
            self._buffer = np.empty(size + MAX_RECORD, np.uint8)
        self._buffer[:waiting] = np.frombuffer(self._rest, np.uint8)
        self._buffer[waiting:size] = new
        held = self._buffer[:size]
        held.flags.writeable = False
        return held

    def _tables(self, raw: NDArray[np.uint8], found: int, counts: Ints) -> list[Table]:
        """Tables of the records that one step of the walk found."""
        number, self.records = self.records, self.records + found
        types = np.flatnonzero(counts).tolist()
        describing = any(self._name(t) in _DESCRIBING for t in types)
        given = types if describing else [t for t in types if self._is_wanted(t)]
        bodies = self._bodies(raw, found, number, counts, given)
        cuts: dict[int, list[tuple[int, Format]]] = {}
        layouts = {t: self._formats.get(t) for t in types}
        if describing:
            told = self._formats_told(*bodies[FMT], number) if FMT in bodies else []
            layouts.update((f.type, f) for _, f in told if isinstance(f, Format))
            layouts.update((f, None) for _, f in told if isinstance(f, int))
            cuts = self._describe(told, bodies, layouts)
        tables: list[Table] = []
        for t in types:
            layout = layouts[t]
            self.by_name["?" if layout is None else layout.name] += int(counts[t])
            if layout is not None and t in bodies and self._is_wanted(t):
                body, place = bodies[t]
                rows = np.frombuffer(body, layout.dtype)  # a view would be checked field by field
                tables += _cut(Table(layout, rows, place), cuts.get(t, []))
        return tables

    def _bodies(
        self, raw: NDArray[np.uint8], found: int, number: int, counts: Ints, given: list[int]
    ) -> dict[int, tuple[NDArray[np.uint8], Ints]]:
        """Type -> bodies of its records one behind the other, their places in the file."""
        if not given:
            return {}
        sizes = (self._lengths[given] - HEADER) * counts[given]
        body_ends, place_ends = np.cumsum(sizes), np.cumsum(counts[given])
        body_at, place_at = np.full(TYPES, -1), np.full(TYPES, -1)
        body_at[given], place_at[given] = body_ends - sizes, place_ends - counts[given]
        bodies = np.empty(int(sizes.sum()), np.uint8)
        places = np.empty(int(counts[given].sum()), np.int64)
        starts = self._starts[:found]
        gather(raw, starts, number, self._lengths, body_at, place_at, bodies, places)
        body_edges, place_edges = [0, *body_ends.tolist()], [0, *place_ends.tolist()]
        return {
            t: (
                bodies[body_edges[k] : body_edges[k + 1]],
                places[place_edges[k] : place_edges[k + 1]],
            )
            for k, t in enumerate(given)
        }

    def _name(self, type_: int) -> str:
        layout = self._formats.get(type_)
        return "" if layout is None else layout.name

    def _is_wanted(self, type_: int) -> bool:
        return self._wanted is None or self._name(type_) in self._wanted

    # ------------------------------------------------------------------ what describes them

    def _formats_told(
        self, body: NDArray[np.uint8], place: Ints, number: int
    ) -> list[tuple[int, Format | int]]:
        """(place, format) of the FMT records that the walk believed; its type alone if unusable."""
        believed = self._took_effect[place - number] > 0
        records = body.view(self._formats[FMT].dtype)[believed]
        out: list[tuple[int, Format | int]] = []
        for at, (type_, length, name, letters, labels) in zip(
            place[believed].tolist(), records.tolist(), strict=True
        ):
            out.append((at, Format.of(type_, length, name, letters, labels) or type_))
        return out

    def _describe(
        self,
        told: list[tuple[int, Format | int]],
        bodies: dict[int, tuple[NDArray[np.uint8], Ints]],
        layouts: dict[int, Format | None],
    ) -> dict[int, list[tuple[int, Format]]]:
        """Take what the describing records of one step tell, in the file's order.

        Returns
        -------
        dict
            Type -> (place, format from there on) of those that were told units.
        """
        events: list[tuple[int, str, Any]] = [(at, "FMT", layout) for at, layout in told]
        for t, (body, place) in bodies.items():
            layout = layouts[t]
            if layout is not None and (columns := _COLUMNS.get(layout.name)) is not None:
                if any(layout.kind(name) not in [*kinds] for name, kinds in columns.items()):
                    continue
                records = body.view(layout.dtype)[list(columns)].tolist()
                events += zip(place.tolist(), [layout.name] * len(records), records, strict=True)
        events.sort(key=lambda event: event[0])
        cuts: dict[int, list[tuple[int, Format]]] = {}
        for at, name, record in events:
            match name:
                case "UNIT":
                    self._units.note_unit(*record)
                case "MULT":
                    self._units.note_multiplier(*record)
                case "FMTU":
                    type_, units, multipliers = record
                    if (before := self._formats.get(type_)) is not None:
                        after = before.with_units(self._units.of(units, multipliers))
                        self._formats[type_] = after
                        if after != before:
                            cuts.setdefault(type_, []).append((at, after))
                case _ if isinstance(record, Format):
                    self._formats[record.type] = record
                case _:
                    self._formats.pop(record, None)
        return cuts


def _cut(table: Table, cuts: list[tuple[int, Format]]) -> list[Table]:
    """The table in parts: from each place on another format of the same layout holds."""
    if not cuts:
        return [table]
    edges = np.searchsorted(table.place, [at for at, _ in cuts]).tolist()
    layouts = [table.format, *(layout for _, layout in cuts)]
    parts = zip(itertools.pairwise([0, *edges, len(table)]), layouts, strict=True)
    return [table.part(lo, hi, layout) for (lo, hi), layout in parts if hi > lo]
