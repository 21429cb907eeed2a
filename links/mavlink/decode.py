"""MAVLink bytes to batches of samples, sans-IO, the same for a live link and a log.

Per block of bytes: the framer finds checked frames, frames of one message are decoded together
as numpy structured views, the clock gives each its vehicle time, the catalogue turns them into
checked rows, the ranking picks the source of each sensor, and rows are numbered in arrival order.

Which system is the vehicle is fixed by the first HEARTBEAT of an autopilot. Frames that come before
it, and before the first stamp of its clock, are held back (8192 at most) and then used, so that
nothing of the stream's beginning is lost. If none comes within that bound, or the stream ends, the
system that sent most frames as component 1 is taken.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from links import catalog
from links.clock import UNIX_FROM_US, ClockResult, Stamp, VehicleClock
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import NO_STAMP, Framer, Frames
from links.mavlink.options import Counters, DecoderOptions, Vehicle
from links.mavlink.pitot_ratios import PitotRatios
from links.mavlink.rows import build_rows, gather_payloads, instances
from links.mavlink.sourcing import Entry, source_table
from links.ranking import Candidate, SensorRows
from links.samples import Batch, Rows
from links.vocabulary import Rejection

__all__ = ["Decoder"]

_PAIRED = 500  # stamps that tell how Unix time stands to vehicle time
_REORDERED = 128  # a sequence number this far ahead is rather one from behind
_INTEGER_PARAM_TYPES = 6  # MAV_PARAM_TYPE_UINT8 ... INT32 are 1 ... 6

_NO_TIMES = np.empty(0, np.int64)
_NOTHING = (
    Frames.at(b"", []),
    ClockResult(_NO_TIMES, _NO_TIMES, np.empty(0, np.bool_), {}),
)

Rejected = Counter[tuple[str, Rejection]]
Group = tuple[NDArray[np.int64], Rows]  # indices of the frames, their payloads


@dataclass(frozen=True, slots=True)
class _Block:
    """What the frames of one block have in common."""

    component: NDArray[np.int64] | None  # None: all from the autopilot
    times: ClockResult
    rejected: Rejected


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
    sources
        Sensor -> message name -> rows used of it.
    frames
        Frames of the last ``feed``, for who needs the stamps of a log.
    timed
        The vehicle's frames that the last ``feed`` turned into samples, and their times.
    host_us
        Host time given with the last ``feed`` [us], or None.
    first_t_us
        Vehicle time of the first frame that drives the clock [us]; None before it.

    Raises
    ------
    ValueError
        When pymavlink has no such dialect, or a ranking names no known quantity.
    """

    def __init__(self, options: DecoderOptions | None = None, *, stamped: bool = False) -> None:
        self.options = options or DecoderOptions()
        self._dialect = load_dialect(self.options.dialect)
        self._framer = Framer(self._dialect, stamped=stamped)
        self._clock = VehicleClock()
        self._held: Frames | None = Frames.at(b"", [])
        self._system = -1
        self._ratios = PitotRatios(self.options.airspeed_ratio)
        self._sequence: dict[int, int] = {}
        self._sources: dict[int, list[Entry]] = {}
        self._parameter = self._dialect.by_name["PARAM_VALUE"].id
        self._named_value = self._dialect.by_name["NAMED_VALUE_FLOAT"].id
        self._stamps = {
            m.id: (wire, kind, unit)
            for name, (wire, kind, unit) in catalog.STAMPS.items()
            if (m := self._dialect.by_name.get(name)) is not None
        }
        self._rank(None)
        self.counters = Counters()
        self.vehicle: Vehicle | None = None
        self.sensors = SensorRows(self.options.source_timeout_us, self.options.settle_us)
        self.frames = Frames.at(b"", [])
        self.timed = _NOTHING
        self.host_us: int | None = None
        self.first_t_us: int | None = None
        self._leads: list[int] = []

    # ------------------------------------------------------------------ public

    def feed(self, data: bytes, host_us: int | None = None) -> Batch:
        """Samples of the messages that ``data`` completes."""
        self.host_us = host_us
        return self._decode(self._framer.feed(data), final=False)

    def finish(self) -> Batch:
        """Samples of what still waited: the stream has ended."""
        return self._decode(self._framer.finish(), final=True)

    @property
    def undecided(self) -> int:
        """Bytes fed last of which it is still open what they are or how they are used."""
        if self._held is not None and len(self._held):
            return self._framer.bytes - int(self._held.position[0])
        return self._framer.pending

    @property
    def clock(self) -> VehicleClock:
        """The vehicle's clock, to read."""
        return self._clock

    @property
    def t_us_of_unix_zero(self) -> int | None:
        """Vehicle time minus a log's stamp, median of its first frames [us]; None without stamps.

        The median, because some recorders stamp their first frames with a time that is too early.
        """
        return sorted(self._leads)[len(self._leads) // 2] if self._leads else None

    # ------------------------------------------------------------------ set-up

    def _rank(self, autopilot: int | None) -> None:
        self._sources = source_table(self._dialect, self.options, autopilot)

    # ------------------------------------------------------------------ frames

    def _decode(self, frames: Frames, *, final: bool) -> Batch:
        rejected = self._framer.take_rejected()
        self._count(frames)
        self.frames = frames
        if self._held is not None:
            frames = self._hold(Frames.join(self._held, frames), rejected, final)
        self.timed = _NOTHING
        before = self._clock.reboots
        rows = self._rows(frames, rejected) if len(frames) else {}
        self.counters.reboots = self._clock.reboots
        return Batch(rows, rejected, self._clock.boots_since(before))

    def _count(self, frames: Frames) -> None:
        counters = self.counters
        counters.bytes, counters.bad_bytes = self._framer.bytes, self._framer.bad_bytes
        counters.messages += len(frames)
        if self._framer.unknown:
            for number, n in self._framer.unknown.items():
                counters.by_name[f"#{number}"] += n
            self._framer.unknown.clear()
        if not len(frames):
            return
        for number, n in _tally(frames.message):
            counters.by_name[self._dialect.by_id[number].name] += n
        sender = frames.system << 8 | frames.component
        for key, n in _tally(sender):
            counters.by_source[key >> 8, key & 0xFF] += n
            sequence = frames.sequence[sender == key]
            before = np.empty_like(sequence)
            before[0] = self._sequence.get(key, int(sequence[0]) - 1)
            before[1:] = sequence[:-1]
            missing = (sequence - before - 1) & 0xFF
            counters.lost += int(missing[missing < _REORDERED].sum())
            self._sequence[key] = int(sequence[-1])

    def _hold(self, held: Frames, rejected: Rejected, final: bool) -> Frames:
        """Frames to use now: none until the vehicle and its clock are known, then all."""
        bound = self.options.hold_back
        nothing = Frames.at(b"", [])
        while True:
            head = held.take(slice(0, bound))
            known = self._find_vehicle(head)
            if known and self._prime(head):
                break
            if len(held) < bound and not final:
                self._held = held
                return nothing
            if known or self._guess_vehicle(head):
                break
            reason = Rejection.OTHER_SYSTEM if final else Rejection.OVERFLOW
            if len(head):
                rejected["frame", reason] += len(head)
            held = held.take(slice(bound, None))
            if not len(held):
                self._held = nothing
                return nothing
        self._held = None
        return held

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
                self._rank(self.vehicle.autopilot)
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
        kind, raw, _ = self._read_stamps(len(frames), self._groups(frames))
        driving = _driving(kind, raw)
        if not driving.any():
            return False
        self.first_t_us = int(raw[np.argmax(driving)])
        self._clock.prime(self.first_t_us)
        return True

    # ------------------------------------------------------------------ rows

    def _groups(self, frames: Frames) -> dict[int, Group]:
        """Message number -> indices and payloads of its frames, for messages of the catalogue."""
        groups: dict[int, Group] = {}
        if not len(frames):
            return groups
        order = np.argsort(frames.message, kind="stable")
        numbers = frames.message[order]
        edges = (np.flatnonzero(numbers[1:] != numbers[:-1]) + 1).tolist()
        for lo, hi in itertools.pairwise([0, *edges, len(order)]):
            number = int(numbers[lo])
            if number in self._sources or number in self._stamps:
                index = order[lo:hi]
                message = self._dialect.by_id[number]
                groups[number] = (index, gather_payloads(frames, index, message))
        return groups

    def _read_stamps(
        self, n: int, groups: Mapping[int, Group]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], dict[int, int]]:
        """Kind and value [us] of each frame's stamp, and the Unix time that SYSTEM_TIME pairs."""
        kind, raw = np.zeros(n, np.int64), np.zeros(n, np.int64)
        unix: dict[int, int] = {}
        for number, (index, payload) in groups.items():
            if number not in self._stamps:
                continue
            wire, stamp, unit = self._stamps[number]
            value = payload[wire]
            if stamp is Stamp.USEC or stamp is Stamp.FIX:
                value = np.where(value < 1 << 62, value, 0)
            kind[index] = stamp
            raw[index] = value.astype(np.int64) * unit
            if number == self._dialect.by_name["SYSTEM_TIME"].id:
                pairs = zip(index.tolist(), payload["time_unix_usec"].tolist(), strict=True)
                unix.update((i, u) for i, u in pairs if UNIX_FROM_US <= u < 1 << 62)
        return kind, raw, unix

    def _rows(self, frames: Frames, rejected: Rejected) -> dict[str, Rows]:
        options = self.options
        mine = (frames.system == self._system) & (frames.component != options.own_component)
        if others := int(len(mine) - np.count_nonzero(mine)):
            rejected["frame", Rejection.OTHER_SYSTEM] += others
            frames = frames.take(mine)
        groups = self._groups(frames)
        kind, raw, unix = self._read_stamps(len(frames), groups)
        from_autopilot = frames.component == options.autopilot_component
        kind[~from_autopilot] = Stamp.NONE
        unix = {i: u for i, u in unix.items() if from_autopilot[i]}
        times = self._clock.advance(kind, raw, frames.message, unix)
        self.timed = (frames, times)
        if self.first_t_us is None and times.ok.any():
            self.first_t_us = int(times.t_us[np.argmax(times.ok)])
        self._note_leads(kind, raw, times, frames)
        self._ratios.begin_block()
        if (told := groups.get(self._parameter)) is not None:
            own = from_autopilot[told[0]]
            self._ratios.note(told[0][own], told[1][own])
        block = _Block(None if from_autopilot.all() else frames.component, times, rejected)
        offers: dict[str, list[Candidate]] = {}
        for number, (index, payload) in groups.items():
            if number == self._parameter:
                payload = self._param_bits(payload)
            names = set(payload["name"].tolist()) if number == self._named_value else ()
            for entry in self._sources.get(number, ()):
                if entry.named is not None and entry.named not in names:
                    continue
                for sensor, candidate in self._offers(entry, index, payload, block):
                    offers.setdefault(sensor, []).append(candidate)
        return self.sensors.pick(offers, self.first_t_us or 0)

    def _note_leads(
        self,
        kind: NDArray[np.int64],
        raw: NDArray[np.int64],
        times: ClockResult,
        frames: Frames,
    ) -> None:
        """Keep how far the clock is ahead of a log's stamps, for the first of its frames."""
        wanted = _PAIRED - len(self._leads)
        if wanted > 0 and frames.stamp_us.max(initial=NO_STAMP) > NO_STAMP:
            use = _driving(kind, raw) & times.ok & (frames.stamp_us != NO_STAMP)
            lead = times.t_us[use] - frames.stamp_us[use]
            self._leads += lead[:wanted].tolist()

    def _offers(
        self, entry: Entry, index: NDArray[np.int64], payload: Rows, block: _Block
    ) -> Iterable[tuple[str, Candidate]]:
        """Usable rows that a source gives from the payloads of its message."""
        source, times, rejected = entry.source, block.times, block.rejected
        component = None if block.component is None else block.component[index]
        take = entry.theirs(payload, component)
        if take is not None:
            index, payload = index[take], payload[take]
            if not len(index):
                return
        for sensor, mask in instances(source, payload):
            at, part = (index, payload) if mask is None else (index[mask], payload[mask])
            if sensor == source.quantity and source.instance is not None:
                rejected[sensor, Rejection.OUT_OF_RANGE] += len(at)
                continue
            ratio = self._ratios.at(int(sensor[-1]), at) if source.ratio else None
            rows, good = build_rows(source, sensor, part, rejected, ratio)
            if times.reason:
                ok = times.ok[at]
                for i in at[good & ~ok].tolist():
                    rejected[sensor, times.reason[i]] += 1
                good &= ok
            rows["t_us"] = times.t_us[at]
            if source.quantity == "gps":
                rows["stamp_us"] = times.stamp_us[at]
            if not good.all():
                rows, at = rows[good], at[good]
            if len(rows):
                yield sensor, Candidate(entry.rank, entry.order, source, at, rows)

    # ------------------------------------------------------------------ parameters

    def _param_bits(self, payload: Rows) -> Rows:
        """PX4 sends integer parameters as their bits in the float field; ArduPilot as values."""
        if self.vehicle is None or self.vehicle.autopilot != catalog.AUTOPILOT_PX4:
            return payload
        integer = (payload["param_type"] >= 1) & (payload["param_type"] <= _INTEGER_PARAM_TYPES)
        payload = payload.copy()
        bits = np.ascontiguousarray(payload["param_value"]).view("<i4")
        payload["param_value"] = np.where(integer, bits, payload["param_value"])
        return payload


def _driving(kind: NDArray[np.int64], raw_us: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which stamps drive the clock."""
    boot = (kind == Stamp.BOOT_MS) | (kind == Stamp.USEC)
    driving: NDArray[np.bool_] = boot & (raw_us > 0) & (raw_us < UNIX_FROM_US)
    return driving


def _tally(values: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Each different value and how often it comes."""
    if len(values) < 64:
        return list(Counter(values.tolist()).items())
    different, counts = np.unique(values, return_counts=True)
    return list(zip(different.tolist(), counts.tolist(), strict=True))
