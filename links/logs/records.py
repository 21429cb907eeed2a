"""Records of a log that names its own messages (DataFlash, ULog) to checked rows of the sensors.

A reader hands over what one chunk of its file holds, a :class:`Records` per message and instance;
:class:`RecordRows` gives each record its vehicle time, fills rows by the table of the format
(:mod:`links.catalog_dataflash`, :mod:`links.catalog_ulog`), joins what the format spreads over
several messages, picks each sensor's source, and numbers the rows in the file's order. Where the
file is cut into chunks changes nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from links.catalog import MAX_INSTANCES
from links.clock import UNIX_FROM_US, ClockResult, Stamp, VehicleClock
from links.conversions import Payload
from links.logs.base import MAX_GAPS
from links.mavlink.pitot_ratios import PitotRatios
from links.mavlink.rows import build_rows, instances
from links.ranking import Candidate, SensorRows
from links.record_sources import Joined, Leader, RecordSource
from links.samples import Batch, Rows
from links.vocabulary import Rejection

__all__ = ["RecordRows", "Records"]

Places = NDArray[np.int64]
Mask = NDArray[np.bool_]
Rejected = Counter[tuple[str, Rejection]]

AHEAD_US = 2_000_000
"""A stamp this far ahead of the newest is believed at once [us]: no check sum tells a damaged one,
and a second of a log without any record is a hole already."""

GAP_US = 1_000_000
"""Records further apart than this are a gap [us]."""

_PARAMETER = np.dtype([("param_id", "S16"), ("param_value", "<f8")])


@dataclass(frozen=True, slots=True)
class Records:
    """Records of one message in one chunk of a file.

    Attributes
    ----------
    message
        The message's name, as the table of the format has it.
    columns : (n,) structured
        Its fields, in the unit that the format's table expects.
    place : (n,) int64
        Number of each record among all of the file, ascending; orders records of all messages.
    stamp_us : (n,) int64 [us]
        Stamp of each record since the vehicle's boot; 0 for none. One that no vehicle reaches, from
        :data:`~links.clock.UNIX_FROM_US` on, makes its record unusable.
    instance
        Instance that all of them belong to; None where a column tells, or there is only one.
    """

    message: str
    columns: Payload
    place: Places
    stamp_us: NDArray[np.int64]
    instance: int | None = None


class Newest:
    """Values that messages carried last, looked up by place in the file."""

    def __init__(self) -> None:
        self._block: dict[Any, tuple[Places, NDArray[Any]]] = {}
        self._before: dict[Any, NDArray[Any]] = {}

    def begin_block(self) -> None:
        """What held at the end of the last block holds."""
        for key, (_, values) in self._block.items():
            self._before[key] = values[-1:]
        self._block = {}

    def note(self, key: Any, place: Places, values: NDArray[Any]) -> None:
        """Values (n, k) of a block, told at each place (n,)."""
        if len(place):
            self._block[key] = (place, values)

    def at(self, key: Any, place: Places, width: int) -> tuple[NDArray[np.float64], Mask]:
        """Values in force at each place: (m, width), NaN before the first; where there are any."""
        out = np.full((len(place), width), np.nan)
        known = np.full(len(place), key in self._before)
        if key in self._before:
            out[:] = self._before[key]
        if key in self._block:
            told, values = self._block[key]
            last = np.searchsorted(told, place, side="right") - 1
            now = last >= 0
            out[now] = values[last[now]]
            known |= now
        return out, known


class RecordRows:
    """Turns consecutive chunks of records into batches.

    Parameters
    ----------
    sources
        The format's table, in the order in which the rows of one record are numbered.
    ranking
        Quantity -> source keys, best first; a source that is not ranked is not used.
    parameters
        (message, column of the name, column of the value) that tells parameters.
    timeout_us, settle_us
        As of :class:`~links.ranking.SourceRanking` [us].
    airspeed_ratio
        ARSPD_RATIO until a parameter tells it.

    Attributes
    ----------
    clock
        The vehicle's clock, to read.
    first_t_us
        Vehicle time of the first record with one [us]; None before it.
    timed
        Records of the last chunk and their times.
    gaps
        (vehicle time of the last record before a gap [us], its length [us]), the first 1000.
    sensors
        What is chosen of all sources, and which message was used how often.
    """

    def __init__(
        self,
        sources: Iterable[RecordSource],
        ranking: Mapping[str, tuple[str, ...]],
        *,
        parameters: tuple[str, str, str] | None = None,
        timeout_us: int = 2_000_000,
        settle_us: int = 2_000_000,
        airspeed_ratio: float = 2.0,
    ) -> None:
        self._table: dict[str, list[tuple[int, int, RecordSource]]] = {}
        self._joins: dict[str, list[Joined]] = {}
        self._leaders: dict[str, set[Leader]] = {}
        for order, source in enumerate(sources):
            keys = ranking.get(source.quantity, ())
            if source.key not in keys:
                continue
            entry = (keys.index(source.key), order, source)
            self._table.setdefault(source.message, []).append(entry)
            for join in source.joined:
                self._joins.setdefault(join.message, []).append(join)
                if join.leader is not None:
                    self._leaders.setdefault(join.leader.message, set()).add(join.leader)
        self._parameters = parameters
        self._ratios = PitotRatios(airspeed_ratio)
        self._newest = Newest()
        self._begins = False
        self.clock = VehicleClock(AHEAD_US)
        self.first_t_us: int | None = None
        self.timed: list[tuple[Records, ClockResult]] = []
        self.gaps: list[tuple[int, int]] = []
        self.sensors = SensorRows(timeout_us, settle_us)

    @property
    def wanted(self) -> frozenset[str]:
        """Messages that are used for anything; a reader need not hand over others."""
        parameters = () if self._parameters is None else self._parameters[:1]
        return frozenset((*self._table, *self._joins, *self._leaders, *parameters))

    @np.errstate(all="ignore")  # what a log holds may be no number at all
    def feed(
        self,
        records: Sequence[Records],
        rejected: Rejected | None = None,
        *,
        begins: bool = False,
    ) -> Batch:
        """Rows of one chunk's records.

        Parameters
        ----------
        records
            Any order; places go on from those of the chunk before.
        rejected
            What the reader itself rejected; goes into the batch.
        begins
            Another log begins with these records: where its stamps are older than those before, the
            vehicle booted in between.
        """
        rejected = Counter() if rejected is None else rejected
        self._begin(records)
        offers: dict[str, list[Candidate]] = {}
        before = self.clock.reboots
        self._begins |= begins
        self.timed = list(zip(records, self._times(records), strict=True))
        for part, times in self.timed:
            for rank, order, source in self._table.get(part.message, ()):
                for sensor, at, rows in self._offers(source, part, times, rejected):
                    candidate = Candidate(rank, order, source, part.place[at], rows)
                    offers.setdefault(sensor, []).append(candidate)
        picked = self.sensors.pick(offers, self.first_t_us or 0)
        return Batch(picked, rejected, self.clock.boots_since(before))

    # ------------------------------------------------------------------ what is in force

    def _begin(self, records: Sequence[Records]) -> None:
        """Note what these records tell that others are read by."""
        self._ratios.begin_block()
        self._newest.begin_block()
        told: dict[Any, list[tuple[Places, NDArray[Any]]]] = {}
        for part in records:
            names = part.columns.dtype.names or ()
            for leader in self._leaders.get(part.message, ()):
                if leader.field in names:
                    number = np.asarray(part.columns[leader.field], np.float64)[:, None]
                    told.setdefault(leader, []).append((part.place, number))
            for join in self._joins.get(part.message, ()):
                if set(join.fill.fields) <= set(names):
                    for key, at, values in _joined_values(join, part):
                        told.setdefault(key, []).append((part.place[at], values))
            if self._parameters is not None and part.message == self._parameters[0]:
                table = np.zeros(len(part.place), _PARAMETER)
                table["param_id"] = part.columns[self._parameters[1]]
                table["param_value"] = part.columns[self._parameters[2]]
                self._ratios.note(part.place, table)
        for key, parts in told.items():
            place = np.concatenate([p for p, _ in parts])
            values = np.concatenate([v for _, v in parts])
            if len(parts) > 1:
                order = np.argsort(place, kind="stable")
                place, values = place[order], values[order]
            self._newest.note(key, place, values)

    def _times(self, records: Sequence[Records]) -> Iterator[ClockResult]:
        """Vehicle time of each message's records: the clock sees all of them in file order."""
        if not records:
            return
        place = np.concatenate([r.place for r in records])
        stamp = np.concatenate([r.stamp_us for r in records])
        order = np.argsort(place, kind="stable")
        told = (stamp > 0) & (stamp < UNIX_FROM_US)
        if self._begins and told.any():
            self._begins = False
            self.clock.begin_boot(int(stamp[order][np.argmax(told[order])]))
        kind = np.where(told, int(Stamp.USEC), int(Stamp.NONE))
        none = np.zeros(len(place), np.int64)
        newest_us = self.clock.newest_us
        times = self.clock.advance(kind[order], stamp[order], none, {})
        self._note_gaps(newest_us, times.t_us[times.ok])
        if self.first_t_us is None and times.ok.any():
            self.first_t_us = int(times.t_us[np.argmax(times.ok)])
        t_us, ok = np.empty(len(place), np.int64), np.empty(len(place), np.bool_)
        t_us[order], ok[order] = times.t_us, times.ok
        reason = {int(order[i]): why for i, why in times.reason.items()}
        absurd = stamp >= UNIX_FROM_US
        ok &= ~absurd
        reason.update(dict.fromkeys(np.flatnonzero(absurd).tolist(), Rejection.OUT_OF_RANGE))
        at = 0
        for part in records:
            here = slice(at, at + len(part.place))
            why = {i - at: r for i, r in reason.items() if here.start <= i < here.stop}
            yield ClockResult(t_us[here], none[here], ok[here], why)
            at = here.stop

    def _note_gaps(self, newest_us: int | None, t_us: Places) -> None:
        """Where the newest time goes on by more than a gap: one damaged stamp makes none."""
        if len(t_us):
            first_us = int(t_us[0]) if newest_us is None else newest_us
            newest = np.maximum.accumulate(np.concatenate(([first_us], t_us)))
            steps = np.diff(newest)
            for i in np.flatnonzero(steps > GAP_US)[: MAX_GAPS - len(self.gaps)].tolist():
                self.gaps.append((int(newest[i]), int(steps[i])))

    # ------------------------------------------------------------------ rows

    def _offers(
        self, source: RecordSource, part: Records, times: ClockResult, rejected: Rejected
    ) -> Iterator[tuple[str, Places, Rows]]:
        """(sensor, indices, usable rows) that a source gives from the records of its message."""
        names = part.columns.dtype.names or ()
        if not source.columns <= set(names) or not len(part.place):
            return
        if source.number is not None and source.number != (part.instance or 0):
            return
        index = np.arange(len(part.place))
        if source.only is not None:
            index = index[source.only(part.columns)]
        for sensor, at in _sensors(source, part, index):
            if sensor == source.quantity and source.instance is not None:
                rejected[sensor, Rejection.OUT_OF_RANGE] += len(at)
                continue
            place = part.place[at]
            ratio = self._ratios.at(int(sensor[-1]), place) if source.ratio else None
            rows, good = build_rows(source, sensor, part.columns[at], rejected, ratio)
            for join in source.joined:
                self._join(join, sensor, place, rows, good, rejected)
            if times.reason:
                ok = times.ok[at]
                for i in at[good & ~ok].tolist():
                    rejected[sensor, times.reason[i]] += 1
                good &= ok
            rows["t_us"] = times.t_us[at]
            if good.all():
                yield sensor, at, rows
            elif good.any():
                yield sensor, at[good], rows[good]

    def _join(
        self,
        join: Joined,
        sensor: str,
        place: Places,
        rows: Rows,
        good: Mask,
        rejected: Rejected,
    ) -> None:
        """Fill one field from another message."""
        into = rows[join.fill.into]
        width = into.shape[1] if into.ndim > 1 else 1
        values, told = self._values(join, sensor, place, width)
        value = values if into.ndim > 1 else values[:, 0]
        if join.add:
            value = into + np.where(np.isfinite(value), value, 0.0)
        inside = (value >= join.fill.low) & (value <= join.fill.high)
        if join.fill.required:
            usable = inside.all(axis=1) if inside.ndim > 1 else inside
            known = ~np.isnan(value).any(axis=1) if value.ndim > 1 else ~np.isnan(value)
            if not join.add:
                good &= told
            for reason, bad in (
                (Rejection.NON_FINITE, good & ~known),
                (Rejection.OUT_OF_RANGE, good & known & ~usable),
            ):
                if n := int(np.count_nonzero(bad)):
                    rejected[sensor, reason] += n
            good &= usable
        rows[join.fill.into] = np.where(inside, value, np.nan if into.dtype.kind == "f" else 0)

    def _values(
        self, join: Joined, sensor: str, place: Places, width: int
    ) -> tuple[NDArray[np.float64], Mask]:
        """Values of a joined field at each place, and where its message has come."""
        if join.leader is None:
            own = int(sensor[-1]) if sensor[-1].isdigit() else 0
            return self._newest.at((join, own), place, width)
        number = self._newest.at(join.leader, place, 1)[0][:, 0]
        number = np.where(np.isnan(number), 0.0, number)
        values, told = np.full((len(place), width), np.nan), np.zeros(len(place), np.bool_)
        for k in set(number.tolist()):
            here = number == k
            values[here], told[here] = self._newest.at((join, int(k)), place[here], width)
        return values, told


def _sensors(source: RecordSource, part: Records, index: Places) -> Iterator[tuple[str, Places]]:
    """Sensors that some records speak of, each with the records' indices.

    An instance number beyond what the monitor names gives the quantity's bare name.
    """
    if not len(index):
        return
    if source.instance is None or part.instance is not None:
        number = part.instance or 0
        within = number < MAX_INSTANCES.get(source.quantity, number + 1)
        yield source.sensor.format(number) if within else source.quantity, index
    elif source.instance not in (part.columns.dtype.names or ()):
        yield source.sensor.format(0), index
    else:
        for sensor, mask in instances(source, part.columns[index]):
            yield sensor, index if mask is None else index[mask]


def _joined_values(join: Joined, part: Records) -> Iterator[tuple[Any, Any, NDArray[Any]]]:
    """Of each instance of a message: key, which records, the values (n, k) of a joined field."""
    fill = join.fill
    if fill.compute is not None:
        values = np.asarray(fill.compute(part.columns), np.float64)
        values = values if values.ndim > 1 else values[:, None]
    else:
        values = np.stack([part.columns[f].astype(np.float64) for f in fill.fields], axis=1)
        values = values * fill.scale + fill.offset
    if part.instance is not None:
        yield (join, part.instance), slice(None), values
    elif join.instance is None or join.instance not in (part.columns.dtype.names or ()):
        yield (join, 0), slice(None), values
    else:
        number = part.columns[join.instance].astype(np.int64)
        for k in set(number.tolist()):
            yield (join, k), number == k, values[number == k]
