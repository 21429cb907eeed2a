"""What arrives of each stream: counts, rate, gaps, and whether it has stopped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows, quantity_of
from monitor.retune import Retuned, blend
from monitor.settings.streams import StreamSettings

__all__ = ["Change", "Stream", "Streams"]

ORDERED = ("horizon_s", "gps_latency_s", "pending_rows")
"""Keys by which rows are put in order: changed in flight, they would let rows pass each other."""


class Change(Enum):
    """What happens to a stream."""

    FRESH = "fresh"
    STOPPED = "stopped"
    BLANK = "blank"
    BOOTING = "booting"
    """Of all at once: the vehicle has booted in flight, what it says is not used yet."""
    BOOTED = "booted"
    """It has, and flies on."""
    GROUNDED = "grounded"
    """It has, and is on the ground."""


@dataclass(slots=True)
class Stream:
    """Running account of one sensor's rows."""

    timeout_us: int | None
    samples: int = 0
    first_us: int = 0
    last_us: int = 0
    gaps: int = 0
    stale: bool = False
    blank: bool = False

    @property
    def rate_hz(self) -> float:
        """Mean rate over the time in which rows came [1/s]."""
        span_us = self.last_us - self.first_us
        return (self.samples - 1) * 1e6 / span_us if span_us > 0 else 0.0


class Streams:
    """Accounts for every stream and tells when one stops and comes back.

    A stream is stale from ``timeout`` after its last row until its next row: vehicle time alone
    decides, so live and log agree. A gap is an interval longer than the time-out, or than one
    second for a stream that has none. Time in which nobody listened (:meth:`unheard`) is no
    silence. A stream is blank until its first row that says something: an
    autopilot sends all-zero rows for an IMU, and -1 for an engine, that is not fitted.
    """

    def __init__(self, settings: StreamSettings) -> None:
        self._settings = settings
        self._timeouts_us = _timeouts_us(settings)
        self.streams: dict[str, Stream] = {}
        self._deaf_us = (0, 0)

    def unheard(self, from_us: int, until_us: int) -> None:
        """Nobody listened between these times: that no rows came then says nothing."""
        self._deaf_us = (from_us, until_us)

    def retune(self, settings: StreamSettings) -> Retuned:
        """Take new time-outs; a stream that has stopped stays so until its next row."""
        self._settings, done = blend(self._settings, settings, ORDERED)
        self._timeouts_us = _timeouts_us(self._settings)
        for sensor, stream in self.streams.items():
            stream.timeout_us = self._timeouts_us.get(quantity_of(sensor))
        return done

    def step(self, rows: Mapping[str, Rows], until_us: int) -> list[tuple[int, str, Change]]:
        """Use released rows; return changes (t_us, sensor, change) in time order.

        The first row of a stream is a change to fresh, or to blank.
        """
        changes = [c for sensor, r in rows.items() if len(r) for c in self._use(sensor, r)]
        for sensor, stream in self.streams.items():
            if stream.timeout_us is None or stream.stale or stream.blank:
                continue
            stopped_us = self._stopped_us(stream.last_us, stream.timeout_us)
            if stopped_us < until_us:
                stream.stale = True
                changes.append((stopped_us, sensor, Change.STOPPED))
        changes.sort(key=lambda c: c[:2])
        return changes

    def _use(self, sensor: str, rows: Rows) -> Iterator[tuple[int, str, Change]]:
        t = rows["t_us"]
        stream = self.streams.get(sensor)
        if stream is None:
            timeout_us = self._timeouts_us.get(quantity_of(sensor))
            stream = Stream(timeout_us, first_us=int(t[0]), last_us=int(t[0]))
            self.streams[sensor] = stream
            stream.blank = bool(_blank(sensor, rows[:1])[0])
            yield int(t[0]), sensor, Change.BLANK if stream.blank else Change.FRESH
        judged = 0  # first row whose interval to the one before counts
        if stream.blank:
            told = np.flatnonzero(~_blank(sensor, rows))
            judged = int(told[0]) + 1 if len(told) else len(t)
            if len(told):
                stream.blank = False
                yield int(t[told[0]]), sensor, Change.FRESH
        limit_us = stream.timeout_us or 1_000_000
        steps = np.diff(t, prepend=stream.last_us)
        for i in np.flatnonzero(steps > limit_us):
            if t[i] <= self._stopped_us(int(t[i] - steps[i]), limit_us):
                continue
            stream.gaps += 1
            if stream.timeout_us is not None and i >= judged:
                before_us = int(t[i] - steps[i])
                if not (i == 0 and stream.stale):
                    stopped_us = self._stopped_us(before_us, stream.timeout_us)
                    yield stopped_us, sensor, Change.STOPPED
                yield int(t[i]), sensor, Change.FRESH
        stream.stale = False
        stream.samples += len(t)
        stream.last_us = int(t[-1])

    def _stopped_us(self, last_us: int, timeout_us: int) -> int:
        """When a stream has stopped whose last row was then, if no other comes."""
        deaf_from_us, deaf_until_us = self._deaf_us
        stopped_us = last_us + timeout_us
        if last_us < deaf_until_us and stopped_us > deaf_from_us:
            stopped_us += deaf_until_us - max(deaf_from_us, last_us)
        return stopped_us


def _timeouts_us(s: StreamSettings) -> dict[str, int]:
    """Quantity -> silence after which it is stale [us]."""
    timeouts_s = {
        "imu": s.imu_timeout_s,
        "attitude": s.attitude_timeout_s,
        "gps": s.gps_timeout_s,
        "airspeed": s.airspeed_timeout_s,
        "aoa": s.aoa_timeout_s,
        "spool": s.spool_timeout_s,
    }
    return {quantity: round(timeout_s * 1e6) for quantity, timeout_s in timeouts_s.items()}


def _blank(sensor: str, rows: Rows) -> NDArray[np.bool_]:
    """Which rows say nothing, shape (n,)."""
    match quantity_of(sensor):
        case "imu":
            still = (rows["acc_m_s2"] == 0).all(axis=1)
            return np.asarray(still & (rows["gyro_rad_s"] == 0).all(axis=1))
        case "spool":
            return np.asarray(rows["speed_rpm"] < 0)
        case _:
            return np.zeros(len(rows), np.bool_)
