"""Vehicle time out of the stamps that messages carry.

Everything is ordered by ``t_us``, microseconds since the vehicle booted. Messages bring it in four
ways, and the clock tells them apart:

==================  ==============================================================================
``Stamp.BOOT_MS``   ``time_boot_ms``: 32 bits, starts again after 49.7 days; drives the clock
``Stamp.USEC``      ``time_usec`` of 64 bits: since boot it drives the clock; above 1e14 it is Unix
                    time and only translated (offset from SYSTEM_TIME, else the first pairing)
``Stamp.USEC_32``   SERVO_OUTPUT_RAW.time_usec: 32 bits, starts again after 71.6 minutes; follows
``Stamp.FIX``       a GPS receiver's ``time_usec``: the time of the fix; follows
``Stamp.NONE``      no stamp: the time of the last stamped message
==================  ==============================================================================

A stamp up to 5 s behind the newest is a late message and is kept as it is (the pipeline orders
rows); one up to 60 s ahead is a gap. Anything else is rejected until ten stamps in a row agree on
it: then the vehicle has rebooted (``t_us`` goes on, a second after the newest, in a new epoch), or
the link was down for long (``t_us`` jumps ahead).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from links.vocabulary import Rejection

__all__ = ["UNIX_FROM_US", "ClockResult", "Stamp", "VehicleClock"]

UNIX_FROM_US = 100_000_000_000_000
"""A 64-bit stamp from here on is Unix time: 1e14 us is March 1973, or three years since boot."""

BACK_US = 5_000_000
"""A stamp this far behind the newest is a late message, not a reboot [us]."""

AHEAD_US = 60_000_000
"""A stamp this far ahead of the newest is a gap of the link, believed at once [us]."""

CONFIRM = 10
"""Stamps in a row that must agree before the clock follows a larger jump."""

EPOCH_GAP_US = 1_000_000
"""After a reboot ``t_us`` goes on this much after the newest time before it [us]."""

UNIX_STEP_US = 50_000
"""SYSTEM_TIME corrects the offset between Unix and vehicle time from this difference on [us]."""

_WRAP_MS_US = (1 << 32) * 1000
_WRAP_US = 1 << 32


class Stamp(IntEnum):
    """How a message carries time; the table is in the module's docstring."""

    NONE = 0
    BOOT_MS = 1
    USEC = 2
    USEC_32 = 3
    FIX = 4


@dataclass(frozen=True, slots=True)
class ClockResult:
    """Times of some frames.

    Attributes
    ----------
    t_us : (n,) int64 [us]
        Vehicle time, where ``ok``.
    stamp_us : (n,) int64 [us]
        The stamp itself on the vehicle's clock (a fix's time), 0 where there is none.
    ok : (n,) bool
        False where ``reason`` says why the frame has no usable time.
    reason : dict of int to Rejection
    """

    t_us: NDArray[np.int64]
    stamp_us: NDArray[np.int64]
    ok: NDArray[np.bool_]
    reason: dict[int, Rejection]


class VehicleClock:
    """Clock of one vehicle (its autopilot component): stamps in arrival order to ``t_us``.

    Attributes
    ----------
    newest_us, last_us
        Newest time so far and the time of the last stamped message [us]; None before the first.
    reboots
        Epochs begun after the first.
    jumps
        Jumps ahead by more than :data:`AHEAD_US` that were believed.
    """

    def __init__(self) -> None:
        self.newest_us: int | None = None
        self.last_us: int | None = None
        self.reboots = 0
        self.jumps = 0
        self._epoch = 0  # added to every stamp since boot
        self._wrap_ms = 0  # added to time_boot_ms besides
        self._unix: int | None = None  # added to Unix stamps
        self._run = 0  # agreeing outliers in a row
        self._outlier = 0
        self._last_fix: dict[int, int] = {}

    def prime(self, first_us: int) -> None:
        """Set the time of what comes before the first stamped message."""
        if self.last_us is None:
            self.newest_us = self.last_us = first_us

    def advance(
        self,
        kind: NDArray[np.int64],
        raw_us: NDArray[np.int64],
        source: NDArray[np.int64],
        unix_us: dict[int, int],
    ) -> ClockResult:
        """Times of consecutive frames.

        Parameters
        ----------
        kind : (n,) int64
            :class:`Stamp` of each frame.
        raw_us : (n,) int64 [us]
            The stamp as sent, in microseconds; 0 is no stamp.
        source : (n,) int64
            Message number; tells one receiver's fixes from another's.
        unix_us
            Frame index -> Unix time that goes with the frame's stamp (SYSTEM_TIME).
        """
        n = len(kind)
        t = [0] * n
        stamps = [0] * n
        reason: dict[int, Rejection] = {}
        last, newest, epoch = self.last_us, self.newest_us, self._epoch
        for i, (k, raw) in enumerate(zip(kind.tolist(), raw_us.tolist(), strict=True)):
            if 0 < k < Stamp.USEC_32 and 0 < raw < UNIX_FROM_US and newest is not None:
                s = raw + epoch + (self._wrap_ms if k == Stamp.BOOT_MS else 0)
                ahead = s - newest
                if -BACK_US <= ahead <= AHEAD_US:  # nearly always
                    t[i] = last = s
                    if ahead > 0:
                        newest = s
                    self._run = 0
                    if i in unix_us:
                        self._set_unix(s - unix_us[i])
                    continue
            self.last_us, self.newest_us = last, newest
            answer = self._other(k, raw, int(source[i]))
            if i in unix_us and k == Stamp.BOOT_MS and isinstance(answer, tuple):
                self._set_unix(answer[0] - unix_us[i])
            last, newest, epoch = self.last_us, self.newest_us, self._epoch
            if isinstance(answer, Rejection):
                reason[i] = answer
            else:
                t[i], stamps[i] = answer
        self.last_us, self.newest_us = last, newest
        ok = np.ones(n, np.bool_)
        ok[list(reason)] = False
        return ClockResult(np.array(t, np.int64), np.array(stamps, np.int64), ok, reason)

    def _set_unix(self, offset: int) -> None:
        if self._unix is None or abs(offset - self._unix) > UNIX_STEP_US:
            self._unix = offset

    def _other(self, kind: int, raw: int, source: int) -> tuple[int, int] | Rejection:
        """(t_us, stamp_us) of a frame that does not simply go on, or why it has no time."""
        if kind == Stamp.NONE or raw <= 0:
            return Rejection.NO_TIME if self.last_us is None else (self.last_us, 0)
        if raw >= UNIX_FROM_US or kind in (Stamp.USEC_32, Stamp.FIX):
            if self.newest_us is None or self.last_us is None:
                return Rejection.NO_TIME
            s = self._follow(kind, raw, self.newest_us)
            if kind == Stamp.FIX:
                fresh = self._last_fix.get(source) != raw
                self._last_fix[source] = raw
                near = -BACK_US <= s - self.newest_us <= EPOCH_GAP_US
                return (s if fresh and near else self.last_us), s
            return s, 0
        if self.newest_us is None:
            self.newest_us = self.last_us = raw + self._epoch
            return self.last_us, 0
        return self._outlying(kind, raw, self.newest_us)

    def _follow(self, kind: int, raw: int, newest: int) -> int:
        """A stamp that does not drive the clock, on the vehicle's clock."""
        if raw >= UNIX_FROM_US:
            if self._unix is None or abs(raw + self._unix - newest) > BACK_US:
                if kind == Stamp.FIX and self._unix is not None:
                    return raw + self._unix  # a receiver that stopped keeps its old stamp
                self._unix = newest - raw
            return raw + self._unix
        s = raw + self._epoch
        if kind == Stamp.USEC_32:
            s += round((newest - s) / _WRAP_US) * _WRAP_US
            return s if -BACK_US <= s - newest <= AHEAD_US else newest
        return s

    def _outlying(self, kind: int, raw: int, newest: int) -> tuple[int, int] | Rejection:
        """A driving stamp outside the window: the 32-bit wrap, a reboot, a long gap or nonsense."""
        s = raw + self._epoch
        if kind == Stamp.BOOT_MS:
            s += self._wrap_ms
            turns = round((newest - s) / _WRAP_MS_US)
            if turns and -BACK_US <= s + turns * _WRAP_MS_US - newest <= AHEAD_US:
                self._wrap_ms += turns * _WRAP_MS_US
                s += turns * _WRAP_MS_US
                self._run = 0
                self.last_us, self.newest_us = s, max(s, newest)
                return s, 0
        agrees = self._run and -BACK_US <= s - self._outlier <= AHEAD_US
        self._run = self._run + 1 if agrees else 1
        self._outlier = s
        if self._run < CONFIRM:
            return Rejection.TIME_REVERSED if s < newest else Rejection.OUT_OF_RANGE
        self._run = 0
        if s < newest:
            self.reboots += 1
            self._wrap_ms = 0
            self._unix = None
            self._epoch = newest + EPOCH_GAP_US - raw
            s = raw + self._epoch
        else:
            self.jumps += 1
        self.last_us = self.newest_us = s
        return s, 0
