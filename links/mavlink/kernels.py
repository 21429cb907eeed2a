"""A block of MAVLink bytes to rows of the sensors, in machine code, all in one call.

:func:`decode_block` finds the frames, counts them, sees whose they are, gives each its vehicle
time, fills rows by the plan, rejects what is not usable, lets the best source of each sensor speak
and numbers the rows in arrival order. It works frame by frame and keeps what it must remember in
the decoder's arrays, so it does not matter where a stream is cut into blocks.

Rows are written into the *arena*, bytes that the caller provides, each sensor's in one piece; the
caller lays arrays of the sensors' dtypes over the pieces. How much is needed is counted before the
first row is written. What all the numbers mean is in :mod:`links.mavlink.plan`;
how a field is filled, in :mod:`links.mavlink.fields`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.clock import OUT_OF_RANGE, REASONS, TIMED, UNIX_FROM_US, Stamp, tick
from links.clock import REBOOTS as CLOCK_REBOOTS
from links.clock import SIZE as CLOCK_SIZE
from links.jit import borrowed, inlined, kernel
from links.mavlink import pitot_ratios, plan, scan
from links.mavlink.fields import blank, copy_payload, fill_field, put, real, whole
from links.mavlink.plan import NEVER
from links.mavlink.scan import FOUND, GARBAGE, KEEP, NO_STAMP, UNKNOWN, scan_frames
from links.mavlink.traffic import count_frames
from links.memory import load_word, store_word
from links.vocabulary import Rejection

__all__ = [
    "CLOCK",
    "COLUMNS",
    "FULL",
    "NOT_MINE",
    "ODD",
    "SCAN",
    "SLACK",
    "TRAFFIC",
    "T_US",
    "WHY",
    "decode_block",
]

COLUMNS = scan.COLUMNS + 2
T_US, WHY = scan.COLUMNS, scan.COLUMNS + 1
"""Columns of a table of frames besides those of :mod:`links.mavlink.scan`: the vehicle time, and
:data:`~links.clock.TIMED` or why there is none, or :data:`NOT_MINE`."""

NOT_MINE = -2
"""The frame is another system's, or our own."""

CLOCK, TRAFFIC = scan.STATES, scan.STATES + CLOCK_SIZE
"""Where the clock's part of a stream's memory begins, and that of what is counted."""

SCAN = -1
"""Instead of a number of frames: find them."""

FULL = -1
"""Answer: the arena is too small, nothing was done but find the frames."""

ODD = 1 << 20
"""Added to the answer where there is more to tell than rows."""

SLACK = 320
"""Bytes at the arena's end for the payload at work, more than the longest and a word."""

_SENSELESS = 1 << 62  # a stamp from here on is nonsense
_OTHER_SYSTEM = REASONS.index(Rejection.OTHER_SYSTEM)
_BOOT_MS, _USEC, _FIX = int(Stamp.BOOT_MS), int(Stamp.USEC), int(Stamp.FIX)
_LOW, _HIGH = pitot_ratios.LOW, pitot_ratios.HIGH
_PITOTS = len(pitot_ratios.PITOT)

Ints = NDArray[np.int64]


@kernel
def decode_block(
    extras: Any,
    stream: Ints,
    cells: Ints,
    whole_plan: Ints,
    arena: Any,
    data: Any,
    origin: int,
    found: int,
) -> int:
    """Rows of a block; how many sensors have some, plus ``ODD`` where there is more to tell.

    Parameters
    ----------
    extras
        As of :func:`links.mavlink.scan.scan_frames`.
    stream : (s,) int64
        What is kept from block to block whoever the vehicle is: the state of the search up to
        :data:`CLOCK`, that of the vehicle's clock up to :data:`TRAFFIC`, then
        :attr:`links.mavlink.traffic.Counters.array`.
    cells : (room(n) * COLUMNS,) int64
        Takes the table of frames.
    whole_plan
        :attr:`links.mavlink.plan.Plan.array`; its memory and ratios go on.
    arena : (a,) uint8
        Written from ``memory[ARENA_AT]`` on; :data:`FULL` when ``memory[NEEDED]`` do not fit.
    data : bytes
        The block, which stands at ``origin`` in the stream.
    found
        Frames that ``cells`` has already, their heads read and counted, or :data:`SCAN`.
    """
    data, extras, arena = borrowed(data), borrowed(extras), borrowed(arena)
    table, stream, head = (
        borrowed(cells.reshape(-1, COLUMNS)),
        borrowed(stream),
        borrowed(whole_plan),
    )
    framing, clock, traffic = stream[:CLOCK], stream[CLOCK:TRAFFIC], stream[TRAFFIC:]
    memory = head[head[plan.MEMORY] : head[plan.NUMBERS]]
    numbers = borrowed(head[head[plan.NUMBERS] :].view(np.float64))
    if found == SCAN:
        scan_frames(data, extras, framing, origin, table)
        found = framing[FOUND]
        count_frames(table, found, traffic)
    end = _lay_out(data, table, found, head, memory)
    if end + SLACK > len(arena):
        memory[plan.NEEDED] = end - memory[plan.ARENA_AT]
        return FULL
    memory[plan.REJECTS], memory[plan.REBOOTS] = 0, clock[CLOCK_REBOOTS]
    for i in range(found):
        _use_frame(data, table, i, clock, head, numbers, memory, arena)
    memory[plan.ARENA_AT] = end
    told = _tell(head, memory)
    odd = framing[KEEP] < len(data) or framing[UNKNOWN] > 0 or memory[plan.REJECTS] > 0
    for k in range(KEEP + 1, GARBAGE + 1):
        odd = odd or framing[k] > 0
    odd = odd or clock[CLOCK_REBOOTS] != memory[plan.REBOOTS]
    return int(told + ODD if odd else told)


@inlined
def _mine(table: Any, i: int, head: Any) -> Any:
    """Whether a frame is the vehicle's and not our own."""
    return table[i, scan.SYSTEM] == head[plan.SYSTEM] and table[i, scan.COMPONENT] != head[plan.OWN]


@inlined
def _message(table: Any, i: int, head: Any) -> Any:
    """Where the row of a frame's message begins."""
    slot = head[head[plan.SLOTS] + table[i, scan.MESSAGE]]
    return head[plan.MESSAGES] + slot * plan.M_COLUMNS


@kernel
def _lay_out(data: Any, table: Any, found: int, head: Ints, memory: Ints) -> int:
    """Give each sensor its piece of the arena, as long as it can become; where the last ends."""
    room, touched, n = head[plan.ROOM], head[plan.TOUCHED], 0
    for k in range(memory[plan.SENSORS_TOUCHED]):
        memory[room + memory[touched + k]] = 0
    for i in range(found):
        if not _mine(table, i, head):
            continue
        m = _message(table, i, head)
        for e in range(head[m + plan.M_FIRST], head[m + plan.M_LAST]):
            at = head[plan.ENTRIES] + e * plan.E_COLUMNS
            sensor = head[at + plan.E_SENSOR]
            place = head[at + plan.E_INSTANCE_AT]
            if 0 <= place < table[i, scan.LENGTH]:
                instance = np.int64(data[table[i, scan.PAYLOAD] + place])
                if instance >= head[at + plan.E_INSTANCES]:
                    continue
                sensor += instance
            if memory[room + sensor] == 0:
                memory[touched + n] = sensor
                n += 1
            memory[room + sensor] += head[at + plan.E_ROW]
    end = (memory[plan.ARENA_AT] + 7) & ~7
    for k in range(n):
        sensor = memory[touched + k]
        memory[head[plan.BEGIN] + sensor] = end
        memory[head[plan.COUNT] + sensor] = 0
        end += (memory[room + sensor] + 15) & ~7  # blank may write a little beyond
    memory[plan.SENSORS_TOUCHED] = n
    return int(end)


@inlined
def _tell(head: Any, memory: Any) -> Any:
    """Write down the sensors that have rows: number, where they begin, how many."""
    at = head[plan.TOLD]
    for k in range(memory[plan.SENSORS_TOUCHED]):
        sensor = memory[head[plan.TOUCHED] + k]
        count = memory[head[plan.COUNT] + sensor]
        if count > 0:
            memory[at], memory[at + 1] = sensor, memory[head[plan.BEGIN] + sensor]
            memory[at + 2] = count
            at += 3
    return (at - head[plan.TOLD]) // 3


# ----------------------------------------------------------------------------- one frame


@inlined
def _use_frame(
    data: Any,
    table: Any,
    i: int,
    clock: Any,
    head: Any,
    numbers: Any,
    memory: Any,
    arena: Any,
) -> None:
    if not _mine(table, i, head):
        table[i, T_US], table[i, WHY] = 0, NOT_MINE
        _reject(head, memory, _frames_place(head), _OTHER_SYSTEM)
        return
    component, m = table[i, scan.COMPONENT], _message(table, i, head)
    autopilot = component == head[plan.AUTOPILOT]
    payload = arena[len(arena) - SLACK :]
    size = head[m + plan.M_SIZE]
    if size > 0:
        copy_payload(data, table[i, scan.PAYLOAD], table[i, scan.LENGTH], payload, size)
    kind, raw, unix = 0, 0, 0
    if autopilot and head[m + plan.M_STAMP] > 0:
        kind = int(head[m + plan.M_STAMP])
        raw = whole(payload, head[m + plan.M_STAMP_AT], head[m + plan.M_STAMP_TYPE])
        if kind in (_USEC, _FIX) and not 0 <= raw < _SENSELESS:
            raw = 0
        raw *= head[m + plan.M_STAMP_UNIT]
        if head[m + plan.M_UNIX_AT] >= 0:
            unix = int(np.int64(load_word(payload, head[m + plan.M_UNIX_AT])))
            if not UNIX_FROM_US <= unix < _SENSELESS:
                unix = 0
    t, stamp, why = tick(clock, kind, raw, table[i, scan.MESSAGE], unix)
    table[i, T_US], table[i, WHY] = t, why
    if why == TIMED:
        if memory[plan.FIRST_T_US] == NEVER:
            memory[plan.FIRST_T_US] = t
        drives = kind in (_BOOT_MS, _USEC) and 0 < raw < UNIX_FROM_US
        if drives and table[i, scan.STAMP_US] != NO_STAMP and memory[plan.LED] < plan.PAIRED:
            memory[head[plan.LEADS] + memory[plan.LED]] = t - table[i, scan.STAMP_US]
            memory[plan.LED] += 1
    if autopilot and size > 0 and table[i, scan.MESSAGE] == head[plan.PARAMETER]:
        _note_ratio(payload, head, numbers)
    for e in range(head[m + plan.M_FIRST], head[m + plan.M_LAST]):
        _offer(e, component, payload, t, stamp, why, head, numbers, memory, arena)


@inlined
def _note_ratio(payload: Any, head: Any, numbers: Any) -> None:
    """Take a pitot's ARSPD_RATIO from a parameter."""
    value = real(payload, head[plan.PARAMETER_VALUE], plan.F4)
    if not _LOW < value < _HIGH:
        return
    first = np.int64(load_word(payload, head[plan.PARAMETER_NAME]))
    second = np.int64(load_word(payload, head[plan.PARAMETER_NAME] + 8))
    for k in range(_PITOTS):
        name = head[plan.PITOT_NAMES] + 2 * k
        if head[name] == first and head[name + 1] == second:
            numbers[plan.RATIO + k] = value


@inlined
def _frames_place(head: Any) -> Any:
    """Where rejected frames are counted: the last of the section."""
    return (head[plan.LEADS] - head[plan.REJECTED]) // head[plan.REASONS] - 1


@inlined
def _reject(head: Any, memory: Any, what: int, reason: int) -> None:
    memory[head[plan.REJECTED] + what * head[plan.REASONS] + reason] += 1
    memory[plan.REJECTS] += 1


# ----------------------------------------------------------------------------- one row


@inlined
def _carries(at: int, component: int, payload: Any, head: Any) -> Any:
    """Whether a frame is of the entry at ``at``: sent by whom it is taken from, so named, valid."""
    if not (head[at + plan.E_COMPONENTS + (component >> 6)] >> (component & 63)) & 1:
        return False
    name = head[at + plan.E_NAMED]
    if name >= 0:
        if np.int64(load_word(payload, name)) != head[at + plan.E_NAME]:
            return False
        if np.int64(load_word(payload, name + 8)) & 0xFFFF != head[at + plan.E_NAME + 1]:
            return False
    field = head[at + plan.E_WHEN_AT]
    if field < 0:
        return True
    value = whole(payload, field, head[at + plan.E_WHEN_TYPE]) & head[at + plan.E_WHEN_MASK]
    return (value == head[at + plan.E_WHEN_VALUE]) == (head[at + plan.E_WHEN_EQUAL] != 0)


@inlined
def _offer(
    e: int,
    component: int,
    payload: Any,
    t: int,
    stamp: int,
    why: int,
    head: Any,
    numbers: Any,
    memory: Any,
    arena: Any,
) -> None:
    """Write the row that an entry gives of a frame, if it is usable and its source is to speak."""
    at = head[plan.ENTRIES] + e * plan.E_COLUMNS
    if not _carries(at, component, payload, head):
        return
    k = np.int64(0)
    if head[at + plan.E_INSTANCE_AT] >= 0:
        k = np.int64(payload[head[at + plan.E_INSTANCE_AT]])
        if k >= head[at + plan.E_INSTANCES]:
            _reject(head, memory, head[at + plan.E_BEYOND], OUT_OF_RANGE)
            return
    sensor, size = head[at + plan.E_SENSOR] + k, head[at + plan.E_ROW]
    count = head[plan.COUNT] + sensor
    row = memory[head[plan.BEGIN] + sensor] + memory[count] * size
    blank(arena, row, row + size)
    bad = TIMED
    for f in range(head[at + plan.E_FIRST], head[at + plan.E_LAST]):
        bad = fill_field(f, payload, head, numbers, arena, row)
        if bad != TIMED:
            break
    if bad == TIMED:
        bad = why
    if bad != TIMED:
        _reject(head, memory, sensor, bad)
        return
    if head[at + plan.E_RATIO_OF] >= 0:
        pressure = real(arena, row + head[at + plan.E_PRESSURE], plan.F8)
        ratio = numbers[plan.RATIO + head[at + plan.E_RATIO_OF] + k]
        put(arena, row + head[at + plan.E_CAS], math.sqrt(max(ratio * pressure, 0.0)))
    if head[at + plan.E_STAMP] >= 0:
        store_word(arena, row + head[at + plan.E_STAMP], np.uint64(stamp))
    if not _speaks(at, sensor, t, head, memory):
        return
    store_word(arena, row, np.uint64(memory[plan.SEQ]))
    store_word(arena, row + 8, np.uint64(t))
    memory[plan.SEQ] += 1
    memory[count] += 1
    memory[head[plan.USED] + e * plan.MOST_INSTANCES + k] += 1


@inlined
def _speaks(at: int, sensor: int, t: int, head: Any, memory: Any) -> Any:
    """Whether a row of this rank is used, see :mod:`links.ranking`; notes that its source spoke."""
    spoke = head[plan.SPOKE] + sensor * head[plan.RANKS]
    rank = head[at + plan.E_RANK]
    better = np.int64(NEVER)
    for r in range(rank):
        better = max(better, memory[spoke + r])
    memory[spoke + rank] = max(memory[spoke + rank], t)
    if better == NEVER:
        return (
            head[at + plan.E_SYNTHETIC] == 0 or t >= memory[plan.FIRST_T_US] + head[plan.SETTLE_US]
        )
    return head[at + plan.E_SYNTHETIC] == 0 and t > better + head[plan.TIMEOUT_US]
