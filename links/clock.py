"""Vehicle time out of the stamps that messages carry.

Everything is ordered by ``t_us``, microseconds since the vehicle booted. Messages bring it in four
ways, and the clock tells them apart:

==================  ==============================================================================
``Stamp.BOOT_MS``   ``time_boot_ms``: 32 bits, starts again after 49.7 days; drives the clock
``Stamp.USEC``      ``time_usec`` of 64 bits: since boot it drives the clock; above 1e14 it is Unix
                    time and only translated (offset from SYSTEM_TIME, else the first pairing)
``Stamp.USEC_32``   SERVO_OUTPUT_RAW.time_usec: 32 bits, starts again after 71.6 minutes; follows
``Stamp.FIX``       a GPS receiver's ``time_usec``: the time of the fix; follows. A fix sent again
                    has the newest time: when it was sent, not when it was measured
``Stamp.NONE``      no stamp: the time of the last stamped message, or the newest time if that
                    message was late (:data:`LATE_US`): it overtook nobody
==================  ==============================================================================

A stamp up to 5 s behind the newest is a late message and is kept as it is (the pipeline orders
rows); one up to 60 s ahead is a gap. Anything else is rejected until ten stamps in a row agree on
it: then the vehicle has rebooted (``t_us`` goes on, a second after the newest, in a new epoch), or
the link was down for long (``t_us`` jumps ahead).

The clock itself is :func:`tick`, compiled, over a small array: the decoder calls it from its own
kernel. :class:`VehicleClock` is that array with names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from links.jit import kernel
from links.vocabulary import Rejection

__all__ = [
    "NO_TIME",
    "OUT_OF_RANGE",
    "REASONS",
    "REBOOTS",
    "SIZE",
    "TIMED",
    "TIME_REVERSED",
    "UNIX_FROM_US",
    "ClockResult",
    "Stamp",
    "VehicleClock",
    "tick",
]

Ints = NDArray[np.int64]
Timed = tuple[int, int, int]

UNIX_FROM_US = 100_000_000_000_000
"""A 64-bit stamp from here on is Unix time: 1e14 us is March 1973, or three years since boot."""

BACK_US = 5_000_000
"""A stamp this far behind the newest is a late message, not a reboot [us]."""

LATE_US = 100_000
"""A message this far behind the newest is late and says nothing of when the next was sent [us]."""

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
_NEVER = -(1 << 63)

TIMED = -1
"""What :func:`tick` answers beside a time; otherwise a place in :data:`REASONS`."""

REASONS = tuple(Rejection)
NO_TIME = REASONS.index(Rejection.NO_TIME)
OUT_OF_RANGE = REASONS.index(Rejection.OUT_OF_RANGE)
TIME_REVERSED = REASONS.index(Rejection.TIME_REVERSED)


class Stamp(IntEnum):
    """How a message carries time; the table is in the module's docstring."""

    NONE = 0
    BOOT_MS = 1
    USEC = 2
    USEC_32 = 3
    FIX = 4


_NONE, _BOOT_MS, _USEC_32, _FIX = 0, 1, 3, 4  # of Stamp, as the kernels read them

# the clock's array
_NEWEST, _LAST, REBOOTS, _JUMPS = 0, 1, 2, 3
_EPOCH = 4  # added to every stamp since boot
_WRAP_MS = 5  # added to time_boot_ms besides
_UNIX = 6  # added to Unix stamps
_RUN, _OUTLIER = 7, 8  # agreeing outliers in a row, the last of them
_FIXES = 9  # receivers known; then the message number and last stamp of each
_MAX_FIXES = 8
_BOOTS = _FIXES + 1 + 2 * _MAX_FIXES  # when the last epochs began
_MAX_BOOTS = 16
_AHEAD = _BOOTS + _MAX_BOOTS  # a stamp this far ahead is believed at once
SIZE = _AHEAD + 1


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

    t_us: Ints
    stamp_us: Ints
    ok: NDArray[np.bool_]
    reason: dict[int, Rejection]

    @staticmethod
    def of(times: Ints) -> ClockResult:
        """From rows of what :func:`tick` answers, (3, n)."""
        ok = times[2] == TIMED
        lost = np.flatnonzero(~ok).tolist()
        return ClockResult(times[0], times[1], ok, {i: REASONS[times[2, i]] for i in lost})


class VehicleClock:
    """Clock of one vehicle (its autopilot component): stamps in arrival order to ``t_us``.

    Parameters
    ----------
    ahead_us
        A stamp this far ahead of the newest is believed at once [us]; less than
        :data:`AHEAD_US` where no check sum vouches for a stamp.

    Attributes
    ----------
    state : (m,) int64
        What :func:`tick` keeps.
    """

    def __init__(self, ahead_us: int = AHEAD_US) -> None:
        self.state: Ints = np.zeros(SIZE, np.int64)
        self.state[[_NEWEST, _LAST, _UNIX]] = _NEVER
        self.state[_AHEAD] = ahead_us

    @property
    def newest_us(self) -> int | None:
        """Newest time so far [us]; None before the first."""
        return self._known(_NEWEST)

    @property
    def last_us(self) -> int | None:
        """Time of the last stamped message [us]; None before the first."""
        return self._known(_LAST)

    @property
    def reboots(self) -> int:
        """Epochs begun after the first."""
        return int(self.state[REBOOTS])

    def boots_since(self, reboots: int) -> tuple[int, ...]:
        """When each epoch after the first ``reboots`` began [us]; of the last 16.

        Half-way between the newest time before and the first after.
        """
        first = max(reboots, self.reboots - _MAX_BOOTS)
        return tuple(int(self.state[_BOOTS + k % _MAX_BOOTS]) for k in range(first, self.reboots))

    @property
    def jumps(self) -> int:
        """Jumps ahead by more than :data:`AHEAD_US` that were believed."""
        return int(self.state[_JUMPS])

    def _known(self, at: int) -> int | None:
        value = int(self.state[at])
        return None if value == _NEVER else value

    def prime(self, first_us: int) -> None:
        """Set the time of what comes before the first stamped message."""
        if self.last_us is None:
            self.state[[_NEWEST, _LAST]] = first_us

    def ahead_us(self, raw_us: int) -> int | None:
        """How far a stamp since boot is ahead of the newest time [us]; None before any."""
        newest_us = self.newest_us
        if newest_us is None:
            return None
        return raw_us + int(self.state[_EPOCH] + self.state[_WRAP_MS]) - newest_us

    def begin_boot(self, first_us: int) -> None:
        """The vehicle is known to have booted anew; its first stamp since then [us].

        Nothing happens where that stamp is not older than the newest: the clock went on.
        """
        newest_us = self.newest_us
        if newest_us is not None and first_us + int(self.state[_EPOCH]) < newest_us:
            _reboot(self.state, first_us)

    def advance(
        self,
        kind: Ints,
        raw_us: Ints,
        source: Ints,
        unix_us: Mapping[int, int],
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
        unix = np.zeros(len(kind), np.int64)
        for i, value in unix_us.items():
            unix[i] = value
        return ClockResult.of(_advance(self.state, kind, raw_us, source, unix))


@kernel
def _advance(clock: Ints, kind: Ints, raw_us: Ints, source: Ints, unix_us: Ints) -> Ints:
    times = np.empty((3, len(kind)), np.int64)
    for i in range(len(kind)):
        t, stamp, reason = tick(clock, kind[i], raw_us[i], source[i], unix_us[i])
        times[0, i], times[1, i], times[2, i] = t, stamp, reason
    return times


@kernel
def tick(clock: Ints, kind: int, raw: int, source: int, unix: int) -> Timed:
    """Time of one frame: (``t_us``, ``stamp_us``, :data:`TIMED` or why it has no time).

    Parameters
    ----------
    clock : (m,) int64
        :attr:`VehicleClock.state`.
    kind, raw, source
        :class:`Stamp`, the stamp as sent [us], and who sent it.
    unix
        Unix time that goes with the stamp [us], else 0.
    """
    newest = clock[_NEWEST]
    if _NONE < kind < _USEC_32 and 0 < raw < UNIX_FROM_US and newest != _NEVER:
        s = raw + clock[_EPOCH]
        if kind == _BOOT_MS:
            s += clock[_WRAP_MS]
        ahead = s - newest
        if -BACK_US <= ahead <= clock[_AHEAD]:  # nearly always
            clock[_LAST] = s if ahead >= -LATE_US else newest
            if ahead > 0:
                clock[_NEWEST] = s
            clock[_RUN] = 0
            if unix > 0:
                _set_unix(clock, s - unix)
            return s, 0, TIMED
    t, stamp, reason = _unusual(clock, kind, raw, source)
    if unix > 0 and kind == _BOOT_MS and reason == TIMED:
        _set_unix(clock, t - unix)
    return t, stamp, reason


@kernel
def _set_unix(clock: Ints, offset: int) -> None:
    if clock[_UNIX] == _NEVER or abs(offset - clock[_UNIX]) > UNIX_STEP_US:
        clock[_UNIX] = offset


@kernel
def _unusual(clock: Ints, kind: int, raw: int, source: int) -> Timed:
    """What :func:`tick` answers for a frame that does not simply go on."""
    newest, last = clock[_NEWEST], clock[_LAST]
    if kind == _NONE or raw <= 0:
        return (0, 0, NO_TIME) if last == _NEVER else (last, 0, TIMED)
    if raw >= UNIX_FROM_US or kind in (_USEC_32, _FIX):
        if newest == _NEVER:
            return 0, 0, NO_TIME
        s = _follow(clock, kind, raw)
        if kind != _FIX:
            return s, 0, TIMED
        fresh = _is_fresh(clock, source, raw)
        near = -BACK_US <= s - newest <= EPOCH_GAP_US
        return (s if fresh and near else newest), s, TIMED
    if newest == _NEVER:
        clock[_NEWEST] = clock[_LAST] = raw + clock[_EPOCH]
        return clock[_LAST], 0, TIMED
    return _outlying(clock, kind, raw)


@kernel
def _is_fresh(clock: Ints, source: int, raw: int) -> bool:
    """Whether a receiver's stamp differs from its last one, which is kept."""
    known = clock[_FIXES]
    k = 0
    while k < known and clock[_FIXES + 1 + 2 * k] != source:
        k += 1
    at = _FIXES + 1 + 2 * min(k, _MAX_FIXES - 1)
    fresh = bool(k == known or clock[at + 1] != raw)
    if k == known:
        clock[_FIXES] = min(known + 1, _MAX_FIXES)
    clock[at], clock[at + 1] = source, raw
    return fresh


@kernel
def _follow(clock: Ints, kind: int, raw: int) -> int:
    """A stamp that does not drive the clock, on the vehicle's clock."""
    newest, unix = int(clock[_NEWEST]), int(clock[_UNIX])
    if raw >= UNIX_FROM_US:
        if unix == _NEVER or abs(raw + unix - newest) > BACK_US:
            if kind == _FIX and unix != _NEVER:
                return raw + unix  # a receiver that stopped keeps its old stamp
            unix = newest - raw
            clock[_UNIX] = unix
        return raw + unix
    s = raw + int(clock[_EPOCH])
    if kind == _USEC_32:
        s += int(np.rint((newest - s) / _WRAP_US)) * _WRAP_US
        return s if -BACK_US <= s - newest <= AHEAD_US else newest
    return s


@kernel
def _outlying(clock: Ints, kind: int, raw: int) -> Timed:
    """A driving stamp outside the window: the 32-bit wrap, a reboot, a long gap or nonsense."""
    newest = clock[_NEWEST]
    s = raw + clock[_EPOCH]
    if kind == _BOOT_MS:
        s += clock[_WRAP_MS]
        turns = int(np.rint((newest - s) / _WRAP_MS_US))
        if turns != 0 and -BACK_US <= s + turns * _WRAP_MS_US - newest <= AHEAD_US:
            clock[_WRAP_MS] += turns * _WRAP_MS_US
            s += turns * _WRAP_MS_US
            clock[_RUN] = 0
            clock[_LAST], clock[_NEWEST] = s, max(s, newest)
            return s, 0, TIMED
    agrees = clock[_RUN] > 0 and -BACK_US <= s - clock[_OUTLIER] <= clock[_AHEAD]
    clock[_RUN] = clock[_RUN] + 1 if agrees else 1
    clock[_OUTLIER] = s
    if clock[_RUN] < CONFIRM:
        return 0, 0, (TIME_REVERSED if s < newest else OUT_OF_RANGE)
    clock[_RUN] = 0
    if s < newest:
        return _reboot(clock, raw), 0, TIMED
    clock[_JUMPS] += 1
    clock[_LAST] = clock[_NEWEST] = s
    return s, 0, TIMED


@kernel
def _reboot(clock: Ints, raw: int) -> int:
    """Begin an epoch with its first stamp; return its time."""
    newest = clock[_NEWEST]
    clock[_BOOTS + clock[REBOOTS] % _MAX_BOOTS] = newest + EPOCH_GAP_US // 2
    clock[REBOOTS] += 1
    clock[_RUN] = clock[_WRAP_MS] = 0
    clock[_UNIX] = _NEVER
    clock[_EPOCH] = newest + EPOCH_GAP_US - raw
    clock[_LAST] = clock[_NEWEST] = newest + EPOCH_GAP_US
    return int(clock[_NEWEST])
