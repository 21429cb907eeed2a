"""Puts rows in order of validity time behind a watermark, the same for any split of a stream."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np

from links.samples import Rows, quantity_of
from links.vocabulary import Rejection

__all__ = ["Ordering"]

_NEVER = np.iinfo(np.int64).min // 2
_REPEATING = frozenset({"param", "text", "named"})
"""What may well say the same twice at one time."""


class Ordering:
    """Releases rows in (t_us, seq) order once the newest row is a horizon ahead of them.

    The watermark is the newest ``t_us`` seen so far, in arrival order, minus the horizon. A row is
    late, rejected and counted, when it is behind the watermark as it arrives; a row is released
    when it is behind it afterwards. Both depend on the rows before it alone, so the released
    sequence does not depend on how the stream was cut into batches.

    A message that came twice (two radios, a ground station that forwards in a circle) gives the
    same row twice, with the same time and the same values. One of them is rejected as a duplicate,
    if it comes within the horizon; later it is late.

    Parameters
    ----------
    horizon_us
        Delay of the watermark [us].
    shift_us
        Quantity -> latency [us] taken off ``t_us``, so that it says when the sample was valid.
    pending_rows
        Bound on the rows of one sensor that wait.
    """

    def __init__(
        self, horizon_us: int, shift_us: Mapping[str, int], pending_rows: int = 200_000
    ) -> None:
        self._horizon_us = horizon_us
        self._shift_us = dict(shift_us)
        self._bound = pending_rows
        self._newest_us = _NEVER
        self._pending: dict[str, Rows] = {}
        self.rejected: Counter[tuple[str, Rejection]] = Counter()

    @property
    def newest_us(self) -> int:
        """Time of the newest row so far [us]."""
        return self._newest_us

    @property
    def watermark_us(self) -> int:
        """All rows before this time have been released [us]."""
        return self._newest_us - self._horizon_us

    def feed(self, rows: Mapping[str, Rows]) -> dict[str, Rows]:
        """Take rows in arrival order; return those released, in time order per sensor."""
        incoming = {s: self._shifted(s, r) for s, r in rows.items() if len(r)}
        if incoming:
            late = self._late(incoming)
            for sensor, new in incoming.items():
                if late is not None and (n := int(late[sensor].sum())):
                    self.rejected[sensor, Rejection.LATE] += n
                    new = new[~late[sensor]]
                held = self._pending.get(sensor)
                self._pending[sensor] = new if held is None else np.concatenate((held, new))
        return self._release(self.watermark_us)

    def finish(self) -> dict[str, Rows]:
        """Release all that still waits: the stream has ended."""
        return self._release(np.iinfo(np.int64).max)

    def _shifted(self, sensor: str, rows: Rows) -> Rows:
        shift = self._shift_us.get(sensor.rstrip("0123456789"), 0)
        if shift:
            rows = rows.copy()
            rows["t_us"] -= shift
        return rows

    def _late(self, incoming: Mapping[str, Rows]) -> dict[str, np.ndarray] | None:
        """Per sensor, which rows are behind the watermark as they arrive; None when none is."""
        t = np.concatenate([r["t_us"] for r in incoming.values()])
        newest = self._newest_us
        self._newest_us = max(newest, int(t.max()))
        if t.min() >= self._newest_us - self._horizon_us:
            return None
        order = np.argsort(np.concatenate([r["seq"] for r in incoming.values()]), kind="stable")
        arrived = t[order]
        before = np.empty_like(arrived)
        before[0] = newest
        np.maximum(np.maximum.accumulate(arrived[:-1]), newest, out=before[1:])
        behind = arrived < before - self._horizon_us
        if not behind.any():
            return None
        late = np.empty(len(t), np.bool_)
        late[order] = behind
        edges = np.cumsum([len(r) for r in incoming.values()])[:-1]
        return dict(zip(incoming, np.split(late, edges), strict=True))

    def _release(self, until_us: int) -> dict[str, Rows]:
        out: dict[str, Rows] = {}
        for sensor, rows in self._pending.items():
            if not len(rows):
                continue
            released, rest = _split(rows, until_us)
            if quantity_of(sensor) not in _REPEATING:
                single = _single(released)
                if n := len(released) - len(single):
                    self.rejected[sensor, Rejection.DUPLICATE] += n
                    released = single
            if len(released):
                out[sensor] = released
            if len(rest) > self._bound:
                self.rejected[sensor, Rejection.OVERFLOW] += len(rest) - self._bound
                rest = rest[-self._bound :]
            self._pending[sensor] = rest
        return out


def _split(rows: Rows, until_us: int) -> tuple[Rows, Rows]:
    """Rows before a time, in order; the others as they came, in memory of their own."""
    t_us = np.ascontiguousarray(rows["t_us"])
    if (t_us[1:] >= t_us[:-1]).all():
        count = int(np.searchsorted(t_us, until_us))
        return rows[:count], rows[count:].copy()
    ready = t_us < until_us
    released = rows[ready]
    return released[np.lexsort((released["seq"], released["t_us"]))], rows[~ready]


def _single(rows: Rows) -> Rows:
    """Rows in order of time without those that repeat the one before."""
    t_us = rows["t_us"]
    again = np.flatnonzero(t_us[1:] == t_us[:-1])
    if not len(again):
        return rows
    first, second = rows[again], rows[again + 1]
    first["seq"] = second["seq"] = 0
    shape = len(again), rows.dtype.itemsize
    same = (first.view(np.uint8).reshape(shape) == second.view(np.uint8).reshape(shape)).all(axis=1)
    return np.delete(rows, again[same] + 1)
