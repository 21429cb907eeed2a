"""The catalogue as numbers: what :mod:`links.mavlink.kernels` does with each message.

A :class:`Plan` is built once, when the vehicle is known: the sources that the dialect, the options
and the autopilot leave, flattened to tables of integers and of floats that compiled code can walk.
What the tables say comes from :mod:`links.catalog` alone; here stands only how it is written down.

A plan is one array of integers: the *head* (``SYSTEM`` ... ``NUMBERS``); the tables, whose columns
are named below; the *memory*, all that changes while a stream is read, whose places (``SEQ`` ...)
and sections are named below too; and the *numbers*, which are floats. One array, because handing an
array to compiled code takes as long as decoding a message.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links import catalog
from links.catalog import MAX_INSTANCES, Fill, Source
from links.clock import Stamp
from links.conversions import Condition, Conversion, Op
from links.mavlink.dialect import Dialect, Message
from links.mavlink.options import DecoderOptions
from links.mavlink.pitot_ratios import PITOT
from links.mavlink.sourcing import Entry
from links.samples import QUANTITIES
from links.vocabulary import Rejection

__all__ = ["Plan", "build_plan"]

# ----------------------------------------------------------------------------- names of places

SYSTEM, OWN, AUTOPILOT, TIMEOUT_US, SETTLE_US = range(5)
"""Head: whose frames count, which component is ours, which the autopilot; see the options."""
PARAMETER, PARAMETER_NAME, PARAMETER_VALUE, PITOT_NAMES = range(5, 9)
"""Head: the message that tells parameters, where its name and value stand; a table, see below."""
SLOTS, MESSAGES, ENTRIES, FILLS, INPUTS = range(9, 14)
"""Head: where each table begins. ``SLOTS`` is message number -> row of ``MESSAGES``."""
RANKS, REASONS = range(14, 16)
"""Head: columns of the sections ``SPOKE`` and ``REJECTED``."""
ROOM, BEGIN, COUNT, TOUCHED, TOLD, SPOKE, USED, REJECTED, LEADS = range(16, 25)
"""Head: where each section of the memory begins, counted from its own beginning."""
MEMORY, NUMBERS = range(25, 27)
"""Head: where they begin."""
HEAD = 27

M_SIZE, M_STAMP, M_STAMP_AT, M_STAMP_TYPE, M_STAMP_UNIT, M_UNIX_AT, M_FIRST, M_LAST = range(8)
M_COLUMNS = 8
"""A message: payload bytes; its stamp; where Unix time stands, or -1; its entries."""

E_SENSOR, E_ROW, E_RANK, E_SYNTHETIC, E_FIRST, E_LAST = range(6)
E_COMPONENTS = 6  # and three more: a bit for each component that it is taken from
E_NAMED, E_NAME = 10, 11  # and one more: where the name stands that it must have, its ten bytes
E_WHEN_AT, E_WHEN_TYPE, E_WHEN_MASK, E_WHEN_EQUAL, E_WHEN_VALUE = range(13, 18)
E_INSTANCE_AT, E_INSTANCES, E_BEYOND = range(18, 21)
E_RATIO_OF, E_PRESSURE, E_CAS, E_STAMP = range(21, 25)
E_COLUMNS = 25
"""An entry: a source of one sensor, or of several instances that a field tells apart. -1: none."""

F_OP, F_INTO, F_KIND, F_FIRST, F_COUNT, F_PARAMETER, F_CHECKED = range(7)
F_COLUMNS = 7
"""A fill: operation, where it goes in the row and as what, its wire fields, whether a value that is
not finite or out of bounds rejects the row."""

I_AT, I_TYPE = range(2)
I_COLUMNS = 2
"""A wire field: where it stands in the payload and what it is."""

SCALE, OFFSET, LOW, HIGH = range(4)
"""Numbers of a fill."""
RATIO, VALUES = 0, 3
"""Numbers: ARSPD_RATIO of three pitots, room for one field's values, then four of each fill."""

MOST_VALUES = 16
"""Most values of one field."""

MOST_INSTANCES = max(MAX_INSTANCES.values())

SEQ, FIRST_T_US, ARENA_AT, NEEDED, REJECTS, REBOOTS, LED, SENSORS_TOUCHED = range(8)
FIRST_SECTION = 8
"""Memory: number of the next row; time of the first stamp; how much of the arena is used, and what
a block needs of it [bytes]; rejections of this block, reboots before it; pairs in ``LEADS``;
sensors in ``TOUCHED``, those that the last block may have rows of."""

NEVER = -(1 << 63)
PAIRED = 500
"""Stamps that tell how Unix time stands to vehicle time."""

LINEAR, COPY, PARAMETER_BITS = 0, 100, 101
"""Operations besides those of :class:`links.conversions.Op`: scale and offset, bytes as they are,
PX4's integer parameters."""

REAL, WORD, BOOL, BYTES = range(4)
"""What a field of a row is: float64, a 32-bit integer, a flag, characters."""

U1, I1, U2, I2, U4, I4, U8, I8, F4, F8 = range(10)
_TYPES = {"u1": U1, "i1": I1, "u2": U2, "i2": I2, "u4": U4, "i4": I4}
_TYPES |= {"u8": U8, "i8": I8, "f4": F4, "f8": F8}

_NAME_BYTES = 10  # of NAMED_VALUE_FLOAT.name
_PARAMETER_BYTES = 16  # of PARAM_VALUE.param_id

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Plan:
    """See the module.

    Attributes
    ----------
    array : (n,) int64
        All of it.
    sensors
        Name and dtype of each sensor, by number.
    rejecting
        What rejections are counted under, by number: the sensors, their quantities, the frames.
    entries
        The sources in use, in the order of their table.
    """

    array: Ints
    sensors: tuple[tuple[str, np.dtype[np.void]], ...]
    rejecting: tuple[str, ...]
    entries: tuple[Entry, ...]

    @property
    def memory(self) -> Ints:
        """The part that changes, but for the ratios: (s,) int64."""
        return self.array[self.array[MEMORY] : self.array[NUMBERS]]

    @property
    def remembered(self) -> Ints:
        """Who spoke when, and how often: of the memory, what the next rows depend on; a view."""
        return self.memory[self.array[SPOKE] : self.array[REJECTED]]

    @property
    def ratios(self) -> NDArray[np.float64]:
        """ARSPD_RATIO of three pitots, in force; a view."""
        return self.array[self.array[NUMBERS] :].view(np.float64)[RATIO:VALUES]

    def used(self) -> dict[str, Counter[str]]:
        """Sensor -> rows taken of each message."""
        found: dict[str, Counter[str]] = {}
        first = int(self.array[USED])
        counts = self.memory[first : first + len(self.entries) * MOST_INSTANCES]
        for at in np.flatnonzero(counts).tolist():
            e, instance = divmod(at, MOST_INSTANCES)
            sensor = int(self.array[self.array[ENTRIES] + e * E_COLUMNS + E_SENSOR]) + instance
            by_message = found.setdefault(self.sensors[sensor][0], Counter())
            by_message[self.entries[e].source.message] += int(counts[at])
        return found

    def take_rejected(self) -> dict[tuple[str, Rejection], int]:
        """What was rejected since the last call, by sensor and reason."""
        first, reasons = int(self.array[REJECTED]), list(Rejection)
        counts = self.memory[first : first + len(self.rejecting) * len(reasons)]
        found = {
            (self.rejecting[at // len(reasons)], reasons[at % len(reasons)]): int(counts[at])
            for at in np.flatnonzero(counts).tolist()
        }
        counts[:] = 0
        return found

    def leads(self) -> list[int]:
        """How far the clock was ahead of the stamps of the first frames that drive it [us]."""
        first, memory = int(self.array[LEADS]), self.memory
        return [int(us) for us in memory[first : first + int(memory[LED])]]


def build_plan(
    dialect: Dialect,
    options: DecoderOptions,
    table: Mapping[int, list[Entry]],
    system: int,
    autopilot: int,
) -> Plan:
    """The plan for one vehicle.

    Parameters
    ----------
    table
        As :func:`links.mavlink.sourcing.source_table` gives it.
    system, autopilot
        The vehicle's system id and MAV_AUTOPILOT.
    """
    sensors = _sensors(table.values())
    bare = {e.source.quantity for entries in table.values() for e in entries}
    rejecting = (*sensors, *sorted(bare - set(sensors)), "frame")
    writer = _Writer(sensors, rejecting, px4=autopilot == catalog.AUTOPILOT_PX4)
    slots = np.zeros(len(dialect.extras), np.int64)
    stamps = {dialect.by_name[name].id: stamp for name, stamp in catalog.STAMPS.items()
              if name in dialect.by_name}  # fmt: skip
    writer.message(None, None, ())
    for slot, number in enumerate(sorted({*table, *stamps}), 1):
        slots[number] = slot
        writer.message(dialect.by_id[number], stamps.get(number), table.get(number, ()))
    parameter = dialect.by_name["PARAM_VALUE"]
    head = np.zeros(HEAD, np.int64)
    head[[SYSTEM, OWN, AUTOPILOT]] = system, options.own_component, options.autopilot_component
    head[[TIMEOUT_US, SETTLE_US]] = options.source_timeout_us, options.settle_us
    head[PARAMETER] = parameter.id
    head[PARAMETER_NAME] = _offset(parameter, "param_id")
    head[PARAMETER_VALUE] = _offset(parameter, "param_value")
    pitots = [_words(name, _PARAMETER_BYTES) for name in sorted(PITOT, key=lambda n: PITOT[n])]
    parts = [head]
    for place, rows in (
        (PITOT_NAMES, pitots),
        (SLOTS, slots),
        (MESSAGES, writer.messages),
        (ENTRIES, writer.entries),
        (FILLS, writer.fills),
        (INPUTS, writer.inputs),
    ):
        head[place] = sum(map(len, parts))
        parts.append(np.array(rows, np.int64).ravel())
    ranks = 1 + max((e.rank for e in writer.used), default=0)
    head[[RANKS, REASONS]] = ranks, len(Rejection)
    size = FIRST_SECTION
    for place, width in (
        (ROOM, len(sensors)),
        (BEGIN, len(sensors)),
        (COUNT, len(sensors)),
        (TOUCHED, len(sensors)),
        (TOLD, 3 * len(sensors)),
        (SPOKE, len(sensors) * ranks),
        (USED, len(writer.used) * MOST_INSTANCES),
        (REJECTED, len(rejecting) * len(Rejection)),
        (LEADS, PAIRED),
    ):
        head[place], size = size, size + width
    memory = np.zeros(size, np.int64)
    memory[FIRST_T_US] = NEVER
    memory[head[SPOKE] : head[USED]] = NEVER
    numbers = np.zeros(VALUES + MOST_VALUES)
    numbers[RATIO:VALUES] = options.airspeed_ratio
    head[MEMORY] = sum(map(len, parts))
    head[NUMBERS] = head[MEMORY] + len(memory)
    floats = np.concatenate([numbers, np.array(writer.numbers, np.float64).ravel()])
    return Plan(
        np.concatenate([*parts, memory, floats.view(np.int64)]),
        tuple((name, QUANTITIES[quantity]) for name, quantity in sensors.items()),
        rejecting,
        tuple(writer.used),
    )


def _sensors(table: Iterable[list[Entry]]) -> dict[str, str]:
    """Sensor -> quantity, in the order of their numbers; instances of one quantity together."""
    sources = [entry.source for entries in table for entry in entries]
    told = {s.quantity: s for s in sources if s.instance is not None}
    sensors = {
        source.sensor.format(k): quantity
        for quantity, source in told.items()
        for k in range(MAX_INSTANCES[quantity])
    }
    for source in sources:
        if source.instance is None:
            sensors.setdefault(source.sensor, source.quantity)
    return sensors


class _Writer:
    """Writes the tables' rows; a row refers to others by their numbers."""

    def __init__(
        self, sensors: Mapping[str, str], rejecting: tuple[str, ...], *, px4: bool
    ) -> None:
        self._number = {name: k for k, name in enumerate(sensors)}
        self._rejecting = {name: k for k, name in enumerate(rejecting)}
        self._px4 = px4
        self.messages: list[list[int]] = []
        self.entries: list[list[int]] = []
        self.fills: list[list[int]] = []
        self.inputs: list[list[int]] = []
        self.numbers: list[list[float]] = []
        self.used: list[Entry] = []

    def message(
        self,
        message: Message | None,
        stamp: tuple[str, Stamp, int] | None,
        entries: Iterable[Entry],
    ) -> None:
        row = [0] * M_COLUMNS
        row[M_UNIX_AT] = -1
        row[M_FIRST] = len(self.entries)
        if message is not None:
            row[M_SIZE] = message.dtype.itemsize
            if stamp is not None:
                row[M_STAMP_AT], row[M_STAMP_TYPE] = _field(message, stamp[0])
                row[M_STAMP], row[M_STAMP_UNIT] = stamp[1], stamp[2]
            if message.name == "SYSTEM_TIME":
                row[M_UNIX_AT] = _offset(message, "time_unix_usec")
            for entry in entries:
                if entry.named is None or len(entry.named) <= _NAME_BYTES:
                    self._entry(message, entry)
        row[M_LAST] = len(self.entries)
        self.messages.append(row)

    def _entry(self, message: Message, entry: Entry) -> None:
        source, row = entry.source, [-1] * E_COLUMNS
        dtype = QUANTITIES[source.quantity]
        first = source.sensor.format(0)
        row[E_SENSOR], row[E_ROW] = self._number[first], dtype.itemsize
        row[E_RANK], row[E_SYNTHETIC] = entry.rank, source.synthetic
        row[E_COMPONENTS : E_COMPONENTS + 4] = _bits(entry.components)
        row[E_NAMED] = -1 if entry.named is None else _offset(message, "name")
        row[E_NAME : E_NAME + 2] = _words(entry.named or b"", _NAME_BYTES)
        if source.only is not None:
            self._condition(message, source, row)
        if source.instance is not None:
            row[E_INSTANCE_AT], kind = _field(message, source.instance)
            if kind != U1:
                raise TypeError(f"{message.name}.{source.instance} is no byte")
            row[E_INSTANCES] = MAX_INSTANCES[source.quantity]
            row[E_BEYOND] = self._rejecting[source.quantity]
        if source.ratio:
            row[E_RATIO_OF] = int(first[-1])
            row[E_PRESSURE] = _into(dtype, "diff_press_pa")
            row[E_CAS] = _into(dtype, "cas_m_s")
        if "stamp_us" in (dtype.names or ()):
            row[E_STAMP] = _into(dtype, "stamp_us")
        row[E_FIRST] = len(self.fills)
        for fill in source.fills:
            self._fill(message, source, fill, dtype)
        row[E_LAST] = len(self.fills)
        self.entries.append(row)
        self.used.append(entry)

    def _condition(self, message: Message, source: Source, row: list[int]) -> None:
        if not isinstance(source.only, Condition):
            raise TypeError(f"{source.message}: the condition of a source must be data")
        row[E_WHEN_AT], row[E_WHEN_TYPE] = _field(message, source.only.field)
        row[E_WHEN_MASK] = source.only.mask
        equal = source.only.equals
        row[E_WHEN_EQUAL] = equal is not None
        row[E_WHEN_VALUE] = source.only.unlike if equal is None else equal

    def _fill(self, message: Message, source: Source, fill: Fill, dtype: np.dtype[np.void]) -> None:
        like = dtype[fill.into].base
        kind = {"f": REAL, "S": BYTES, "b": BOOL}.get(like.kind, WORD)
        op, fields, parameter, scale = LINEAR, fill.fields, 0, fill.scale
        inputs = [_field(message, name) for name in fields if kind in (REAL, BOOL)]
        if isinstance(fill.compute, Conversion):
            op, fields = int(fill.compute.op), fill.compute.fields
            parameter, scale = fill.compute.parameter, fill.compute.factor
            inputs = [_field(message, name) for name in fields]
            if op == Op.ELEMENT:  # of an array: a field like any other
                at, what = inputs[0]
                inputs = [(at + parameter * message.dtype[fields[0]].base.itemsize, what)]
                op = LINEAR
        elif fill.compute is not None:
            raise TypeError(f"{source.message}: what fills {fill.into} must be data")
        elif kind == BYTES:
            size = min(message.dtype[fields[0]].itemsize, like.itemsize)
            op, inputs, parameter = COPY, [(_offset(message, fields[0]), U1)], size
        elif kind == WORD:
            op, inputs = COPY, [_field(message, fields[0])]
        elif self._px4 and source.message == "PARAM_VALUE":
            op, inputs = PARAMETER_BITS, [inputs[0], _field(message, "param_type")]
        row = [0] * F_COLUMNS
        row[F_OP], row[F_INTO], row[F_KIND] = op, _into(dtype, fill.into), kind
        row[F_FIRST], row[F_COUNT], row[F_PARAMETER] = len(self.inputs), len(inputs), parameter
        row[F_CHECKED] = fill.required and op != COPY
        self.inputs += [list(pair) for pair in inputs]
        self.numbers.append([scale, fill.offset, fill.low, fill.high])
        self.fills.append(row)


def _offset(message: Message, name: str) -> int:
    return _into(message.dtype, name)


def _field(message: Message, name: str) -> tuple[int, int]:
    """Where a wire field stands and what it is."""
    return _offset(message, name), _TYPES[message.dtype[name].base.str[1:]]


def _into(dtype: np.dtype[np.void], name: str) -> int:
    fields: Mapping[str, Any] = dtype.fields or {}
    return int(fields[name][1])


def _bits(components: tuple[int, ...] | None) -> list[int]:
    """One bit for each component id, as four words."""
    bits = -1 if components is None else sum(1 << c for c in set(components))
    words = [(bits >> 64 * k) & 0xFFFF_FFFF_FFFF_FFFF for k in range(4)]
    return [w - (1 << 64) if w >> 63 else w for w in words]


def _words(text: bytes, size: int) -> list[int]:
    """Characters, zeros after them, as two words."""
    padded = text[:size].ljust(16, b"\0")
    return [int.from_bytes(padded[k : k + 8], "little", signed=True) for k in (0, 8)]
