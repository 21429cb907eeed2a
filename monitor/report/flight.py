"""One analysed flight as its report sees it: findings, states over time, and series to draw.

Names of :meth:`Flight.measured`, each where the log has it:

==============================  =====================================================  ===========
name                            what                                                   unit
==============================  =====================================================  ===========
``imu0.acc_x`` .. ``.gyro_z``   specific force and rates of an IMU, body axes          m/s^2, rad/s
``airspeed0``                   calibrated airspeed of a pitot                         m/s
``aoa0``                        angle of attack of a vane                              rad
``spool0``                      an engine-speed channel                                1/min
``throttle``                    servo output of the throttle, 0 to 1                   1
``gps0.speed``, ``.climb``      over the ground, upward                                m/s
``gps0.course``                 where it goes, clockwise from north                    rad
``gps0.altitude``               height of a receiver above the sea                     m
``nav.speed``, ``.climb``,      the autopilot's own; ``.height`` above where it        m/s, m
``.altitude``, ``.height``      started
``altitude``                    ``nav.altitude``, else ``gps0.altitude``               m
``baro0.pressure``              static pressure                                        Pa
``baro0.altitude``              where the standard atmosphere has that pressure        m
``baro_altitude``               ``baro0.altitude``                                     m
``roll``, ``pitch``,            of the attitude; ``heading`` clockwise from north      rad
``heading``
==============================  =====================================================  ===========

:meth:`Series.shown` turns radians into degrees.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimators.atmosphere import altitude_from_pressure
from monitor.columns import unit_of
from monitor.report.series import Piece, Series, Track, firsts, thinned, track_of, wrapped
from monitor.report.spans import Span, spans_of
from monitor.report.tables import Tables
from monitor.settings import Settings
from monitor.verdict import Verdict, ratio_column

__all__ = ["Flight"]

Floats = NDArray[np.float64]

POINTS: Final = 1200
"""Points of a series unless told otherwise: one per pixel of a wide chart."""
TRACK_POINTS: Final = 2000

GAP_S: Final = 1.0
GAP_INTERVALS: Final = 3
"""A pause breaks a line when it is longer than the stream's time-out (:data:`GAP_S` where there is
none) and than so many of the table's usual intervals."""

_DIRECTIONS: Final = frozenset({"course", "heading"})
_ALSO: Final = {"altitude": ("nav.altitude", "gps0.altitude"), "baro_altitude": ("baro0.altitude",)}
_OF_ATTITUDE: Final = frozenset({"roll", "pitch", "heading"})
_ENDS: Final = {
    "acc": "m_s2",
    "gyro": "rad_s",
    "airspeed": "m_s",
    "aoa": "rad",
    "spool": "rpm",
    "speed": "m_s",
    "climb": "m_s",
    "course": "rad",
    "heading": "rad",
    "roll": "rad",
    "pitch": "rad",
    "altitude": "m",
    "height": "m",
    "pressure": "pa",
}


class Flight:
    """What the report of one flight is made from.

    Parameters
    ----------
    summary
        ``summary.json`` (docs/analysis.md).
    settings
        The configuration.
    verdicts
        Every change of state, in time order; as many as were kept.
    tables
        Estimates and traces.

    Attributes
    ----------
    first_us
        Vehicle time of the log's first record, zero of all ``_s`` [us].
    duration_s
        Of the log, or until its last row where vehicle time went further [s].
    """

    def __init__(
        self,
        summary: dict[str, Any],
        settings: Settings,
        verdicts: Sequence[Verdict],
        tables: Tables,
    ) -> None:
        self.summary = summary
        self.settings = settings
        self.verdicts = verdicts
        self.tables = tables
        self.first_us = int(summary["log"]["first_t_us"] or 0)
        last_us = max((v.t_us for v in verdicts), default=self.first_us)
        last_us = max(last_us, tables.until_us() or last_us)
        self.duration_s = max(
            float(summary["log"]["duration_s"] or 0.0), (last_us - self.first_us) / 1e6
        )
        self._interval_us = cache(self._measured_interval_us)

    @cached_property
    def spans(self) -> Mapping[str, list[Span]]:
        """Sensor -> its states over the whole log without a gap (:func:`spans_of`)."""
        left_out = int(self.summary["left_out"]["verdicts"])
        return spans_of(self.verdicts, self.first_us, self.duration_s, left_out)

    def measured(
        self,
        sensor: str,
        from_s: float | None = None,
        to_s: float | None = None,
        points: int = POINTS,
    ) -> Series | None:
        """What was measured; names stand in the module's table. None where the log has none.

        Parameters
        ----------
        sensor
            ``"imu0.acc_x"``, ``"airspeed0"``, ``"roll"`` ...
        from_s, to_s
            The time that is shown, the whole flight by default [s].
        points
            How many there may be, beside those that break the line.

        Raises
        ------
        KeyError
            Nothing is called so.
        """
        for name in _ALSO.get(sensor, (sensor,)):
            table, low, high = _place(name)
            if low in self.tables.columns(table):
                break
        else:
            return None
        if name.rpartition(".")[2] in _DIRECTIONS:
            return self._direction(table, low, from_s, to_s, points)
        series = self._series(table, (low, high), unit_of(low), from_s, to_s, points)
        if series is not None and name.startswith("baro") and name.endswith(".altitude"):
            # pressure falls with height: its greatest value is the least height
            low_m, high_m = _altitudes(series.high), _altitudes(series.low)
            return Series(series.t_s, low_m, high_m, "m")
        return series

    def estimate(
        self,
        name: str,
        column: str,
        from_s: float | None = None,
        to_s: float | None = None,
        points: int = POINTS,
    ) -> Series | None:
        """An estimate, as its Parquet file has it; ``low`` and ``high`` differ only when thinned.

        Parameters
        ----------
        name, column
            ``("air", "cas_m_s")``, ``("imu0", "acc_x_fault_m_s2")``, ``("air",
            "wind_north_std_m_s")`` ...: see :func:`monitor.columns.flat`.
        from_s, to_s, points
            As of :meth:`measured`.

        Raises
        ------
        KeyError
            There is such an estimate, and no such column in it.
        """
        known = self.tables.columns(name)
        if known and column not in known:
            raise KeyError(f"{name} has no column {column}; it has {', '.join(known)}")
        if not known:
            return None
        return self._series(name, (column, column), unit_of(column), from_s, to_s, points)

    def test(
        self,
        sensor: str,
        from_s: float | None = None,
        to_s: float | None = None,
        points: int = POINTS,
    ) -> Series | None:
        """A sensor's test statistic over its threshold: from 1 on it speaks against the sensor.

        None for what is not tested, or was not on this flight. Parameters as of :meth:`measured`.
        """
        name, column = ratio_column(sensor)
        if column not in self.tables.columns(name):
            return None
        return self._series(name, (column, column), "1", from_s, to_s, points)

    def track(self, points: int = TRACK_POINTS) -> Track | None:
        """Where the aircraft went; None where no position was heard."""
        to_us = self._us(None, self.duration_s)
        for source in ("gps0", "nav"):
            table = f"measured_{source}"
            if self.tables.columns(table):
                rows = self._rows(table, ("lat_rad", "lon_rad"), self.first_us, to_us)
                gap_us = self._gap_us(table)
                track = track_of(rows, self.first_us, to_us, points, gap_us, source)
                if track is not None:
                    return track
        return None

    def _series(
        self,
        table: str,
        columns: tuple[str, str],
        unit: str,
        from_s: float | None,
        to_s: float | None,
        points: int,
    ) -> Series | None:
        from_us, to_us = self._us(from_s, 0.0), self._us(to_s, self.duration_s)
        rows = self._rows(table, columns, from_us, to_us)
        found = thinned(rows, from_us, to_us, points, self._gap_us(table))
        if found is None:
            return None
        t_us, low, high = found
        return Series((t_us - self.first_us) / 1e6, low, high, unit)

    def _direction(
        self, table: str, column: str, from_s: float | None, to_s: float | None, points: int
    ) -> Series | None:
        """A direction has no extremes: the first of each piece of time, broken at north."""
        from_us, to_us = self._us(from_s, 0.0), self._us(to_s, self.duration_s)
        rows = self._rows(table, (column, column), from_us, to_us)
        pieces = firsts(rows, from_us, to_us, points)
        found = thinned(pieces, from_us, to_us, points + 1, self._gap_us(table))
        if found is None:
            return None
        t_s, direction = wrapped((found[0] - self.first_us) / 1e6, found[1])
        return Series(t_s, direction, direction, "rad")

    def _rows(
        self, table: str, columns: tuple[str, str], from_us: int, to_us: int
    ) -> Iterator[Piece]:
        pieces = self.tables.read(table, ("t_us", *columns), from_us, to_us)
        for t_us, low, high in pieces:
            yield t_us, low.astype(np.float64, copy=False), high.astype(np.float64, copy=False)

    def _us(self, t_s: float | None, otherwise_s: float) -> int:
        return self.first_us + round((otherwise_s if t_s is None else t_s) * 1e6)

    def _gap_us(self, table: str) -> int:
        """How long a pause may be that does not break the line [us]."""
        quantity = table.removeprefix("measured_").rstrip("0123456789")
        timeout_s = getattr(self.settings.streams, f"{quantity}_timeout_s", GAP_S)
        return max(round(timeout_s * 1e6), GAP_INTERVALS * self._interval_us(table))

    def _measured_interval_us(self, table: str) -> int:
        """Median time between the rows that a table begins with [us]."""
        ends = (np.iinfo(np.int64).min, np.iinfo(np.int64).max - 1)
        for (t_us,) in self.tables.read(table, ("t_us",), *ends):
            return int(np.median(np.diff(t_us))) if len(t_us) > 1 else 0
        return 0


def _place(name: str) -> tuple[str, str, str]:
    """Table and columns of a measured quantity: its least and its greatest values."""
    if name in _OF_ATTITUDE:
        table, what = "attitude", name
    elif name == "throttle":
        return "measured_throttle", "throttle_low", "throttle_high"
    else:
        table, _, what = name.partition(".")
    quantity = table.rstrip("0123456789")
    axis = re.fullmatch(r"(acc|gyro)_([xyz])", what)
    if quantity == "imu" and axis:
        stem, end = what, _ENDS[axis[1]]
    elif quantity in ("airspeed", "aoa", "spool") and not what:
        stem, end = {"airspeed": "cas", "aoa": "aoa", "spool": "speed"}[quantity], _ENDS[quantity]
    elif quantity == "baro" and what in ("pressure", "altitude"):
        stem, end = "static_press", "pa"
    elif quantity in ("gps", "nav", "attitude") and what in _ENDS:
        stem, end = {"altitude": "alt"}.get(what, what), _ENDS[what]
    else:
        raise KeyError(f"nothing that is measured is called {name}")
    if what in _DIRECTIONS:
        return f"measured_{table}", f"{stem}_{end}", f"{stem}_{end}"
    return f"measured_{table}", f"{stem}_low_{end}", f"{stem}_high_{end}"


def _altitudes(pressure_pa: Floats) -> Floats:
    return np.array([altitude_from_pressure(p) if p > 0.0 else np.nan for p in pressure_pa])
