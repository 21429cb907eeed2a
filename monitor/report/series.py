"""Rows of a table thinned to what a chart can show, exact in their peaks, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["Piece", "Series", "Track", "thinned", "track_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Piece = tuple[Ints, Floats, Floats]
"""Consecutive rows: times (n,) [us], least and greatest values (n,)."""

EARTH_EQUATOR_M: Final = 6_378_137.0
EARTH_FLATTENING: Final = 1.0 / 298.257223563

_SHOWN: Final = {"rad": ("deg", 180.0 / math.pi), "rad/s": ("deg/s", 180.0 / math.pi)}


@dataclass(frozen=True, slots=True)
class Series:
    """A quantity over time, ready to be drawn.

    Attributes
    ----------
    t_s : (n,) float64 [s]
        Seconds from the log's first record, ascending.
    low, high : (n,) float64 [unit]
        Least and greatest value at each point; equal where a point is one value. NaN breaks the
        line: at a gap of the data, and where the quantity was not known.
    unit
        ``"m/s"``; ``"1"`` for a number without a unit.
    """

    t_s: Floats
    low: Floats
    high: Floats
    unit: str

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def middle(self) -> Floats:
        """Half way between least and greatest, (n,) float64 [unit]."""
        return 0.5 * (self.low + self.high)

    def shown(self) -> Series:
        """The same in units for people: degrees instead of radians."""
        unit, factor = _SHOWN.get(self.unit, (self.unit, 1.0))
        return replace(self, low=self.low * factor, high=self.high * factor, unit=unit)


@dataclass(frozen=True, slots=True)
class Track:
    """Where the aircraft was, from where it was first seen.

    Attributes
    ----------
    t_s : (n,) float64 [s]
        Seconds from the log's first record.
    north_m, east_m : (n,) float64 [m]
        NaN at gaps.
    source
        ``"gps0"`` or ``"nav"``.
    """

    t_s: Floats
    north_m: Floats
    east_m: Floats
    source: str


def thinned(
    pieces: Iterable[Piece], from_us: int, to_us: int, points: int, gap_us: int
) -> Piece | None:
    """At most ``points`` points, and a NaN where there is a gap; None if there is no row.

    Rows that are few enough stay as they are. Otherwise the time from ``from_us`` to ``to_us`` is
    cut into as many pieces of equal length, and each keeps its least and its greatest value: the
    extremes of what is drawn are those of what was measured. A point stands in the middle of its
    rows.

    Parameters
    ----------
    pieces
        Rows in time order, those outside the time included; taken one after another.
    from_us, to_us
        The time that is shown, both ends included [us].
    points
        How many there may be, gaps not counted.
    gap_us
        A longer time without a row breaks the line [us].
    """
    kept: list[Piece] | None = []
    cells = _Cells(from_us, to_us, points)
    count = 0
    for t_us, low, high in pieces:
        inside = (t_us >= from_us) & (t_us <= to_us)
        new = (t_us[inside], low[inside], high[inside])
        count += len(new[0])
        if kept is None:
            cells.add(*new)
            continue
        kept.append(new)
        if count > points:
            for earlier in kept:
                cells.add(*earlier)
            kept = None
    if not count:
        return None
    if kept is None:
        return _with_gaps(*cells.filled(), gap_us)
    t_us, low, high = _joined(kept)
    return _with_gaps(t_us, t_us, low, high, gap_us)


def _joined(pieces: list[Piece]) -> Piece:
    t_us, a, b = zip(*pieces, strict=True)
    return np.concatenate(t_us), np.concatenate(a), np.concatenate(b)


class _Cells:
    """Extremes of equal pieces of time."""

    def __init__(self, from_us: int, to_us: int, points: int) -> None:
        self._from_us = from_us
        self._width_us = max((to_us - from_us + 1) / points, 1.0)
        self._last = points - 1
        self._first_us = np.full(points, np.iinfo(np.int64).max)
        self._last_us = np.full(points, np.iinfo(np.int64).min)
        self._low, self._high = np.full((2, points), np.nan)

    def add(self, t_us: Ints, low: Floats, high: Floats) -> None:
        if not len(t_us):
            return
        cell = ((t_us - self._from_us) / self._width_us).astype(np.int64)
        np.minimum(cell, self._last, out=cell)
        begin = np.concatenate(([0], np.flatnonzero(cell[1:] != cell[:-1]) + 1))
        at = cell[begin]
        np.minimum.at(self._first_us, at, np.minimum.reduceat(t_us, begin))
        np.maximum.at(self._last_us, at, np.maximum.reduceat(t_us, begin))
        np.fmin.at(self._low, at, np.fmin.reduceat(low, begin))
        np.fmax.at(self._high, at, np.fmax.reduceat(high, begin))

    def filled(self) -> tuple[Ints, Ints, Floats, Floats]:
        """First and last time, least and greatest value of those with rows."""
        full = self._last_us >= self._first_us
        return self._first_us[full], self._last_us[full], self._low[full], self._high[full]


def _with_gaps(first_us: Ints, last_us: Ints, low: Floats, high: Floats, gap_us: int) -> Piece:
    """Points in the middle of their times, with a NaN in the middle of each gap."""
    t_us = first_us + (last_us - first_us) // 2
    after = np.flatnonzero(first_us[1:] - last_us[:-1] > gap_us)
    middle_us = last_us[after] + (first_us[after + 1] - last_us[after]) // 2
    return (
        np.insert(t_us, after + 1, middle_us),
        np.insert(low, after + 1, np.nan),
        np.insert(high, after + 1, np.nan),
    )


def wrapped(t_s: Floats, direction: Floats) -> tuple[Floats, Floats]:
    """Directions in [0, 2 pi) without strokes from one end to the other.

    Parameters
    ----------
    t_s, direction : (n,) float64 [s], [rad]

    Returns
    -------
    t_s, direction : (m,) float64
        With a NaN wherever the direction passes north.
    """
    after = np.flatnonzero(np.abs(np.diff(direction)) > math.pi)
    middle_s = 0.5 * (t_s[after] + t_s[after + 1])
    return np.insert(t_s, after + 1, middle_s), np.insert(direction, after + 1, np.nan)


def firsts(
    pieces: Iterable[tuple[Ints, Floats, Floats]], from_us: int, to_us: int, points: int
) -> Iterator[tuple[Ints, Floats, Floats]]:
    """The first row of each piece of time, for what has no extremes: directions, places."""
    width_us = max((to_us - from_us + 1) / points, 1.0)
    before = -1
    for t_us, a, b in pieces:
        inside = (t_us >= from_us) & (t_us <= to_us) & np.isfinite(a) & np.isfinite(b)
        t_us, a, b = t_us[inside], a[inside], b[inside]
        cell = ((t_us - from_us) / width_us).astype(np.int64)
        chosen = np.diff(cell, prepend=before) > 0
        if len(cell):
            before = int(cell[-1])
        yield t_us[chosen], a[chosen], b[chosen]


def track_of(
    pieces: Iterable[tuple[Ints, Floats, Floats]],
    first_us: int,
    to_us: int,
    points: int,
    gap_us: int,
    source: str,
) -> Track | None:
    """A track on the plane that touches the ellipsoid where the aircraft was first seen.

    Parameters
    ----------
    pieces
        Times (n,) [us], latitudes and longitudes (n,) [rad], NaN where they were not known.
    first_us, to_us
        Begin and end of the flight [us].
    points
        How many there may be.
    gap_us
        A longer time without a position breaks the line [us].
    source
        Whose positions they are.
    """
    places = [p for p in firsts(pieces, first_us, to_us, points) if len(p[0])]
    if not places:
        return None
    t_us, lat, lon = _joined(places)
    e2 = EARTH_FLATTENING * (2.0 - EARTH_FLATTENING)
    w2 = 1.0 - e2 * math.sin(lat[0]) ** 2
    across_m = EARTH_EQUATOR_M / math.sqrt(w2)
    along_m = across_m * (1.0 - e2) / w2
    east = (lon - lon[0] + math.pi) % (2.0 * math.pi) - math.pi
    north_m, east_m = along_m * (lat - lat[0]), across_m * math.cos(lat[0]) * east
    # a point for every piece of time at most: a pause is one if it is longer than two of them, too
    pause_us = max(gap_us, 2 * (to_us - first_us + 1) // points)
    t_us, north_m, east_m = _with_gaps(t_us, t_us, north_m, east_m, pause_us)
    return Track((t_us - first_us) / 1e6, north_m, east_m, source)
