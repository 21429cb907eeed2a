"""First usable wins: which of several messages speaks for a sensor.

A row of a source is used when no better source of the same sensor has given a usable row within
the last ``timeout``; so a better source takes over with its first row, and when it falls silent the
next one steps in. A *synthetic* source (VFR_HUD.airspeed, the autopilot's own mixture) never steps
in for a sensor that has spoken: that would hide a dead sensor. It is used only where no better
source has spoken at all, and only after ``settle`` of vehicle time.

Here this is said in numpy, for the readers of logs whose messages come by kind (DataFlash, ULog);
:mod:`links.mavlink.kernels` does the same frame by frame.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from links.catalog import Source
from links.samples import Rows

__all__ = ["Candidate", "SensorRows", "SourceRanking", "SourcesUsed"]

_NEVER = np.iinfo(np.int64).min


@dataclass(frozen=True, slots=True)
class Candidate:
    """Usable rows that one source offers for one sensor, in arrival order.

    Attributes
    ----------
    rank
        Place of the source, 0 the best.
    order
        Breaks ties between rows of one frame.
    source
        Where the rows come from.
    frame : (n,) int64
        Arrival index of the frame of each row, ascending.
    rows : (n,) structured
        Rows of the sensor; their ``seq`` is not set yet.
    """

    rank: int
    order: int
    source: Source
    frame: NDArray[np.int64]
    rows: Rows

    def take(self, mask: NDArray[np.bool_]) -> Candidate:
        """Some of the rows."""
        return Candidate(self.rank, self.order, self.source, self.frame[mask], self.rows[mask])


class SourceRanking:
    """Chooses among the sources of each sensor; keeps when each last spoke.

    Parameters
    ----------
    timeout_us
        Silence after which the next source steps in [us].
    settle_us
        Vehicle time from its first stamp before a synthetic source may be used [us].
    """

    def __init__(self, timeout_us: int, settle_us: int) -> None:
        self._timeout_us = timeout_us
        self._settle_us = settle_us
        self._spoke: dict[str, dict[int, int]] = {}

    def select(self, sensor: str, candidates: list[Candidate], first_t_us: int) -> list[Candidate]:
        """The rows to use, as consecutive blocks would have given them one by one."""
        spoke = self._spoke.setdefault(sensor, {})
        if len(candidates) == 1 and not spoke.keys() - {candidates[0].rank}:
            only = candidates[0]
            if not only.source.synthetic:
                if len(only.rows):
                    newest = int(only.rows["t_us"].max())
                    spoke[only.rank] = max(newest, spoke.get(only.rank, _NEVER))
                return candidates
        chosen = []
        for c in candidates:
            t = c.rows["t_us"]
            better = np.full(len(t), _NEVER)
            for rank, last in spoke.items():
                if rank < c.rank:
                    np.maximum(better, last, out=better)
            for b in candidates:
                if b.rank < c.rank and len(b.frame):
                    before = np.searchsorted(b.frame, c.frame) - 1
                    newest_us = np.maximum.accumulate(b.rows["t_us"])
                    latest = np.where(before >= 0, newest_us[np.maximum(before, 0)], _NEVER)
                    np.maximum(better, latest, out=better)
            silent = better == _NEVER
            if c.source.synthetic:
                use = silent & (t >= first_t_us + self._settle_us)
            else:
                use = silent | (t > np.where(silent, 0, better) + self._timeout_us)
            chosen.append(c if use.all() else c.take(use))
        for c in candidates:
            if len(c.rows):
                spoke[c.rank] = max(int(c.rows["t_us"].max()), spoke.get(c.rank, _NEVER))
        return chosen


@dataclass(slots=True)
class SourcesUsed:
    """Which messages the sensors were taken from.

    Attributes
    ----------
    used
        Sensor -> rows taken of each message.
    """

    used: dict[str, Counter[str]] = field(default_factory=dict)

    def messages(self) -> dict[str, str]:
        """Sensor -> messages that it was taken from, the most used first."""
        return {
            sensor: ", ".join(name for name, _ in used.most_common())
            for sensor, used in self.used.items()
        }


class SensorRows(SourcesUsed):
    """One stream of numbered rows per sensor, out of what all sources offer.

    Parameters
    ----------
    timeout_us, settle_us
        As :class:`SourceRanking`.
    """

    def __init__(self, timeout_us: int, settle_us: int) -> None:
        super().__init__()
        self._ranking = SourceRanking(timeout_us, settle_us)
        self._seq = 0

    def pick(self, offers: Mapping[str, list[Candidate]], first_t_us: int) -> dict[str, Rows]:
        """Each sensor's rows, numbered over all sensors in arrival order.

        Parameters
        ----------
        offers
            Sensor -> its candidates of one block of frames.
        first_t_us
            Vehicle time of the first stamp [us].
        """
        picked: dict[str, list[Candidate]] = {}
        for sensor, candidates in offers.items():
            selected = self._ranking.select(sensor, candidates, first_t_us)
            if chosen := [c for c in selected if len(c.rows)]:
                picked[sensor] = chosen
        parts = [c for chosen in picked.values() for c in chosen]
        if not parts:
            return {}
        self._assign_seq(parts)
        rows = {}
        for sensor, chosen in picked.items():
            used = self.used.setdefault(sensor, Counter())
            for c in chosen:
                used[c.source.message] += len(c.rows)
            if len(chosen) == 1:
                rows[sensor] = chosen[0].rows
            else:
                merged = np.concatenate([c.rows for c in chosen])
                rows[sensor] = merged[np.argsort(merged["seq"])]
        return rows

    def _assign_seq(self, parts: list[Candidate]) -> None:
        frame = np.concatenate([c.frame for c in parts])
        order = np.concatenate([np.full(len(c.frame), c.order) for c in parts])
        place = np.empty(len(frame), np.int64)
        place[np.lexsort((order, frame))] = np.arange(len(frame))
        at = 0
        for c in parts:
            c.rows["seq"] = self._seq + place[at : at + len(c.rows)]
            at += len(c.rows)
        self._seq += len(frame)
