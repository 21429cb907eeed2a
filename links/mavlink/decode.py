"""MAVLink bytes to batches of samples, sans-IO, the same for a live link and a log.

Per block of bytes: checked frames are found, the clock gives each its vehicle time, the catalogue
turns them into checked rows, the ranking picks the source of each sensor, and rows are numbered in
arrival order. All of that is one call of :func:`links.mavlink.kernels.decode_block`; here stands
what comes before it and after it.

Which system is the vehicle is fixed by the first HEARTBEAT of an autopilot. Frames that come before
it, and before the first stamp of its clock, are held back (8192 at most) and then used, so that
nothing of the stream's beginning is lost. If none comes within that bound, or the stream ends, the
system that sent most frames as component 1 is taken.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from links import catalog
from links.clock import TIMED, UNIX_FROM_US, Stamp, VehicleClock
from links.mavlink import scan
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer, Frames
from links.mavlink.kernels import (
    CLOCK,
    COLUMNS,
    FULL,
    NOT_MINE,
    ODD,
    SCAN,
    SLACK,
    T_US,
    TRAFFIC,
    WHY,
    decode_block,
)
from links.mavlink.options import DecoderMemory, DecoderOptions, Vehicle
from links.mavlink.plan import (
    ARENA_AT,
    FIRST_T_US,
    NEEDED,
    NEVER,
    REBOOTS,
    SEQ,
    TOLD,
    Plan,
    build_plan,
)
from links.mavlink.rows import gather_payloads
from links.mavlink.sourcing import source_table
from links.mavlink.traffic import Counters, count_frames, traffic_size
from links.ranking import SourcesUsed
from links.samples import NO_WORDS, Batch, Rows
from links.vocabulary import Rejection

__all__ = ["Decoder", "DecoderMemory"]

_ARENA = 1 << 16  # bytes that rows are written to before new ones are asked for
_BLOCK = 1 << 12  # bytes of a block that there is room for from the start

_array = np.ndarray

Rejected = Counter[tuple[str, Rejection]]
Timed = tuple[Frames, NDArray[np.int64], NDArray[np.bool_]]


class Decoder:
    """Turns a MAVLink byte stream into batches; never raises on what the bytes are.

    Parameters
    ----------
    options
        See :class:`DecoderOptions`.
    stamped
        The stream is a telemetry log: an 8-byte stamp before each frame.

    Attributes
    ----------
    counters, vehicle
        See :class:`Counters`, :class:`Vehicle`; ``vehicle`` is None until one is known.
    clock
        The vehicle's clock, to read.
    host_us
        Host time given with the last ``feed`` [us], or None.
    on_vehicle
        Called once, when the vehicle and its first stamp are known and before the first rows: the
        moment for :meth:`recall`.

    Raises
    ------
    ValueError
        When pymavlink has no such dialect, or a ranking names no known quantity.
    """

    def __init__(self, options: DecoderOptions | None = None, *, stamped: bool = False) -> None:
        self.options = options or DecoderOptions()
        self._dialect = load_dialect(self.options.dialect)
        source_table(self._dialect, self.options, None)  # says at once what is wrong with options
        self._framer = Framer(self._dialect, stamped=stamped)
        self.clock = VehicleClock()
        self._stream = np.zeros(TRAFFIC + traffic_size(self._dialect), np.int64)
        for owner, part in ((self._framer, slice(CLOCK)), (self.clock, slice(CLOCK, TRAFFIC))):
            self._stream[part] = owner.state
            owner.state = self._stream[part]
        self.counters = Counters(self._dialect, self._framer, self.clock, self._stream[TRAFFIC:])
        self.vehicle: Vehicle | None = None
        self.host_us: int | None = None
        self.on_vehicle: Callable[[], None] | None = None
        self._system = -1
        self._first_us = NEVER
        self._held: Frames | None = _NO_FRAMES
        self._fed = _NO_FRAMES
        self._plan: Plan | None = None
        self._memory = np.empty(0, np.int64)
        self._view = self._memory.data
        self._told = 0
        self._block, self._found = b"", 0
        self._arena = np.empty(_ARENA, np.uint8)
        self._make_room(_BLOCK)

    # ------------------------------------------------------------------ public

    def feed(self, data: bytes, host_us: int | None = None) -> Batch:
        """Samples of the messages that ``data`` completes."""
        self.host_us = host_us
        if self._held is None:
            return self._decode(self._framer.take(data), SCAN)
        return self._await_vehicle(self._framer.feed(data), final=False)

    def finish(self) -> Batch:
        """Samples of what still waited: the stream has ended."""
        if self._held is not None:
            return self._await_vehicle(self._framer.finish(), final=True)
        batch = self._decode(self._framer.take_last(), SCAN)
        self._framer.state[scan.FINAL] = 0
        return batch

    @property
    def frames(self) -> Frames:
        """Frames of the last ``feed``, for who needs the stamps of a log; valid until the next."""
        if self._found != SCAN:
            return self._fed
        return Frames(self._block, self._table[: self._framer.state[scan.FOUND]])

    @property
    def timed(self) -> Timed:
        """The vehicle's frames that the last ``feed`` turned into samples, when, and whether ok.

        Frames, (n,) int64 vehicle time [us], (n,) bool: whether that time can be used.
        """
        found = self._framer.state[scan.FOUND] if self._found == SCAN else self._found
        table = self._table[:found]
        table = table[table[:, WHY] != NOT_MINE]
        return Frames(self._block, table), table[:, T_US], table[:, WHY] == TIMED

    @property
    def sensors(self) -> SourcesUsed:
        """Which messages the sensors were taken from."""
        return SourcesUsed({} if self._plan is None else self._plan.used())

    @property
    def first_t_us(self) -> int | None:
        """Vehicle time of the first frame that drives the clock [us]; None before it."""
        first = NEVER if self._plan is None else int(self._memory[FIRST_T_US])
        return None if first == NEVER else first

    def memory(self) -> DecoderMemory | None:
        """What the next rows depend on beside the bytes; None before the vehicle is known."""
        if self._plan is None or self.vehicle is None:
            return None
        return DecoderMemory(
            self.vehicle,
            self.clock.state.copy(),
            self._memory[[SEQ, FIRST_T_US]],
            self._plan.remembered.copy(),
            self._plan.ratios.copy(),
        )

    def recall(self, memory: DecoderMemory) -> None:
        """Go on from the memory of another decoder with the same options, on the same vehicle.

        Raises
        ------
        ValueError
            It is no such memory; nothing has changed.
        """
        if self._plan is None or memory.vehicle != self.vehicle:
            raise ValueError("another vehicle's")
        places = (self.clock.state, np.empty(2, np.int64), self._plan.remembered, self._plan.ratios)
        for place, kept in zip(places, memory[1:], strict=True):
            if (kept.shape, kept.dtype) != (place.shape, place.dtype):
                raise ValueError("another decoder's")
        self.clock.state[:] = memory.clock
        self._memory[[SEQ, FIRST_T_US]] = memory.counts
        self._plan.remembered[:] = memory.remembered
        self._plan.ratios[:] = memory.ratios

    @property
    def rows(self) -> int:
        """Rows given so far, those before a :meth:`recall` among them."""
        return 0 if self._plan is None else int(self._memory[SEQ])

    @property
    def undecided(self) -> int:
        """Bytes fed last of which it is still open what they are or how they are used."""
        if self._held is not None and len(self._held):
            return self._framer.bytes - int(self._held.position[0])
        return self._framer.pending

    @property
    def t_us_of_unix_zero(self) -> int | None:
        """Vehicle time minus a log's stamp, median of its first frames [us]; None without stamps.

        The median, because some recorders stamp their first frames with a time that is too early.
        """
        leads = [] if self._plan is None else sorted(self._plan.leads())
        return leads[len(leads) // 2] if leads else None

    # ------------------------------------------------------------------ blocks

    def _decode(self, block: bytes, found: int) -> Batch:
        """Rows of a block, of which the table has ``found`` frames already unless it is SCAN."""
        if len(block) > self._room:
            self._make_room(len(block))
        self._block, self._found = block, found
        framer = self._framer
        origin = framer.bytes - len(block)
        told = self._work(block, origin, found)
        if told == FULL:
            self._make_arena(int(self._memory[NEEDED]))
            frames = int(framer.state[scan.FOUND]) if found == SCAN else found
            told = self._work(block, origin, frames)
        rejected: Rejected = Counter.__new__(Counter)  # its __init__ takes as long as a message
        boots: tuple[int, ...] = ()
        if told >= ODD:
            told -= ODD
            if found == SCAN:
                framer.settle(block, self._table)
                rejected = framer.take_rejected()
            assert self._plan is not None
            rejected.update(self._plan.take_rejected())
            boots = self.clock.boots_since(int(self._memory[REBOOTS]))
        rows: dict[str, Rows] = {}
        view, arena = self._view, self._arena
        for k in range(self._told, self._told + 3 * told, 3):
            name, dtype = self._sensors[view[k]]
            rows[name] = _array(view[k + 2], dtype, arena, view[k + 1])
        return Batch(rows, rejected, boots, NO_WORDS)

    def _make_room(self, size: int) -> None:
        """Have a table that takes all frames of a block of ``size`` bytes."""
        self._room = size
        self._table = np.empty((scan.room(size), COLUMNS), np.int64)
        self._gather()

    def _make_arena(self, needed: int) -> None:
        """Have a new arena; rows given out keep the old one."""
        self._arena = np.empty(max(_ARENA, needed + SLACK), np.uint8)
        if self._plan is not None:
            self._memory[ARENA_AT] = 0
        self._gather()

    def _gather(self) -> None:
        """Bind the kernel to all that it works on but the block itself."""
        self._work = partial(
            decode_block,
            self._dialect.extras,
            self._stream,
            self._table.reshape(-1),
            self._memory if self._plan is None else self._plan.array,
            self._arena,
        )

    # ------------------------------------------------------------------ who the vehicle is

    def _await_vehicle(self, frames: Frames, *, final: bool) -> Batch:
        """Hold frames back until the vehicle and its clock are known, then use all."""
        rejected = self._framer.take_rejected()
        count_frames(frames.table, len(frames), self.counters.array)
        self._fed, self._block, self._found = frames, b"", 0
        held = _NO_FRAMES if self._held is None else self._held
        ready = self._hold(Frames.join(held, frames), rejected, final)
        if ready is None or self.vehicle is None:
            return Batch({}, rejected)
        self._held = None
        self._follow(self.vehicle)
        if self.on_vehicle is not None:
            self.on_vehicle()
        if len(ready.data) > self._room:
            self._make_room(len(ready.data))
        self._table[: len(ready), : scan.COLUMNS] = ready.table
        batch = self._decode(ready.data, len(ready))
        rejected.update(batch.rejected)
        return Batch(batch.rows, rejected, batch.boots)

    def _follow(self, vehicle: Vehicle) -> None:
        """Make the plan for the vehicle."""
        sources = source_table(self._dialect, self.options, vehicle.autopilot)
        plan = build_plan(
            self._dialect, self.options, sources, vehicle.system_id, vehicle.autopilot
        )
        self._plan, self._memory, self._view = plan, plan.memory, plan.memory.data
        self._sensors, self._told = plan.sensors, int(plan.array[TOLD])
        self._memory[FIRST_T_US] = self._first_us
        self._gather()

    def _hold(self, held: Frames, rejected: Rejected, final: bool) -> Frames | None:
        """All frames when the vehicle and its clock are known; None, and they are kept, before."""
        bound = self.options.hold_back
        while True:
            head = held.take(slice(0, bound))
            known = self._find_vehicle(head)
            if known and self._prime(head):
                return held
            if len(held) < bound and not final:
                break
            if known or self._guess_vehicle(head):
                return held
            reason = Rejection.OTHER_SYSTEM if final else Rejection.OVERFLOW
            if len(head):
                rejected["frame", reason] += len(head)
            held = held.take(slice(bound, None))
            if not len(held):
                break
        self._held = held
        return None

    def _find_vehicle(self, frames: Frames) -> bool:
        """Fix the vehicle by the first HEARTBEAT of an autopilot."""
        message = self._dialect.by_name["HEARTBEAT"]
        beats = frames.take(
            (frames.message == message.id) & (frames.component == self.options.autopilot_component)
        )
        wanted = self.options.system_id
        payloads = gather_payloads(beats, np.arange(len(beats)), message)
        for system, beat in zip(beats.system, payloads, strict=True):
            if beat["autopilot"] != catalog.AUTOPILOT_INVALID and wanted in (None, int(system)):
                self._system = int(system)
                self.vehicle = Vehicle(self._system, int(beat["autopilot"]), int(beat["type"]))
                return True
        return False

    def _guess_vehicle(self, frames: Frames) -> bool:
        """Without a HEARTBEAT: the configured system, else who sent most as component 1."""
        mine = frames.system[frames.component == self.options.autopilot_component]
        wanted = self.options.system_id
        if wanted is None:
            if not len(mine):
                return False
            wanted = int(np.argmax(np.bincount(mine)))
        elif not np.any(mine == wanted):
            return False
        self._system = wanted
        self.vehicle = Vehicle(wanted, 0, 0)
        self._prime(frames)
        return True

    def _prime(self, frames: Frames) -> bool:
        """Set the clock by the first of the vehicle's stamps that drives it; False without one."""
        frames = frames.take(
            (frames.system == self._system) & (frames.component == self.options.autopilot_component)
        )
        first, first_us = len(frames), 0
        for name, (wire, kind, unit) in catalog.STAMPS.items():
            message = self._dialect.by_name.get(name)
            if message is None or kind not in (Stamp.BOOT_MS, Stamp.USEC):
                continue
            index = np.flatnonzero(frames.message == message.id)
            stamps = gather_payloads(frames, index, message)[wire]
            driving = np.flatnonzero((stamps > 0) & (stamps < UNIX_FROM_US // unit))
            if len(driving) and index[driving[0]] < first:
                first, first_us = int(index[driving[0]]), int(stamps[driving[0]]) * unit
        if first == len(frames):
            return False
        self._first_us = first_us
        self.clock.prime(first_us)
        return True


_NO_FRAMES = Frames.at(b"", [])
