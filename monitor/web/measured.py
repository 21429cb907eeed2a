"""What was measured since the last snapshot: least and largest value of every channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import degrees
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows, quantity_of
from links.vocabulary import GYRO_ACC_AXES
from monitor.web.protocol import Range
from monitor.web.wire import number

__all__ = ["Measured"]

KEPT_ROWS: Final = 8192
"""Rows of a sensor that wait at most; of more, the oldest are not shown."""

_Values = NDArray[np.float64]


class _Channels(NamedTuple):
    """What rows of a quantity show.

    Attributes
    ----------
    names, units
        Of each channel; ``{}`` is the sensor.
    of
        Rows -> values, shape (n, channels).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    of: Callable[[Rows], _Values]


def _one(field: str, factor: float = 1.0) -> Callable[[Rows], _Values]:
    return lambda rows: np.asarray(rows[field][:, np.newaxis] * factor)


def _imu(rows: Rows) -> _Values:
    return np.hstack((rows["acc_m_s2"], rows["gyro_rad_s"] * degrees(1.0)))


def _gps(rows: Rows) -> _Values:
    north, east = rows["vel_ned_m_s"][:, :2].T
    return np.asarray(np.hypot(north, east)[:, np.newaxis])


def _attitude(rows: Rows) -> _Values:
    w, x, y, z = rows["q_ned_from_frd"].T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    return np.asarray(np.degrees(np.stack((roll, pitch), axis=1)))


_CHANNELS: Final[Mapping[str, _Channels]] = {
    "imu": _Channels(
        tuple(f"{{}}.{axis}" for axis in GYRO_ACC_AXES), ("m/s²",) * 3 + ("°/s",) * 3, _imu
    ),
    "airspeed": _Channels(("{}",), ("m/s",), _one("cas_m_s")),
    "aoa": _Channels(("{}",), ("°",), _one("aoa_rad", degrees(1.0))),
    "spool": _Channels(("{}",), ("rpm",), _one("speed_rpm")),
    "gps": _Channels(("{}.speed",), ("m/s",), _gps),
    "nav": _Channels(("altitude",), ("m",), _one("alt_m")),
    "attitude": _Channels(("roll", "pitch"), ("°", "°"), _attitude),
}


class Measured:
    """A :class:`monitor.verdict.Tap`: rows wait until they are asked for, all at once.

    Attributes
    ----------
    units
        Channel -> unit, of every channel seen.
    """

    def __init__(self) -> None:
        self.units: dict[str, str] = {}
        self._waiting: dict[str, list[Rows]] = {}
        self._count: dict[str, int] = {}

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Keep the rows of sensors that are shown."""
        for sensor, some in rows.items():
            if len(some) and sensor != "phase" and quantity_of(sensor) in _CHANNELS:
                waiting = self._waiting.setdefault(sensor, [])
                waiting.append(some)
                count = self._count.get(sensor, 0) + len(some)
                while count > KEPT_ROWS and len(waiting) > 1:
                    count -= len(waiting.pop(0))
                self._count[sensor] = count

    def take(self) -> dict[str, Range]:
        """Ranges since the last call, of channels with a finite value."""
        out: dict[str, Range] = {}
        for sensor, waiting in self._waiting.items():
            channels = _CHANNELS[quantity_of(sensor)]
            values = channels.of(np.concatenate(waiting) if len(waiting) > 1 else waiting[0])
            with np.errstate(invalid="ignore"):
                low, high = np.fmin.reduce(values), np.fmax.reduce(values)
            for i, name in enumerate(channels.names):
                least, most = number(float(low[i])), number(float(high[i]))
                if least is not None and most is not None:
                    channel = name.format(sensor)
                    out[channel] = (least, most)
                    self.units[channel] = channels.units[i]
        self._waiting.clear()
        self._count.clear()
        return out
