"""What was measured since the last frame: least and greatest value of every channel that is shown.

What a row says is what the report draws of it (:mod:`monitor.traces`). Here rows wait until a frame
is due, and their extremes are taken all at once: a few microseconds per sensor and frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows
from monitor.columns import unit_of
from monitor.pages.units import on_screen
from monitor.settings.engine import EngineSettings
from monitor.throttle import Throttle
from monitor.traces import FIELDS, VALUES
from monitor.web.protocol import Range
from monitor.web.wire import rounded

__all__ = ["Measured", "joined"]

STEPS_WAITING: Final = 512
"""Steps whose rows wait at most: ten seconds. Then they become ranges before a frame is due."""

_THROTTLE: Final = frozenset({"servo", "param"})
"""What the throttle is read from."""

_NAMES: Final[Mapping[tuple[str, str], str]] = {
    **{("imu", f"{of}_{axis}"): f"{{}}.{of}_{axis}" for of in ("acc", "gyro") for axis in "xyz"},
    ("airspeed", "cas"): "{}",
    ("aoa", "aoa"): "{}",
    ("spool", "speed"): "{}",
    ("throttle", "throttle"): "{}",
    ("gps", "speed"): "{}.speed",
    ("gps", "climb"): "{}.climb",
    ("nav", "alt"): "altitude",
    ("attitude", "roll"): "roll",
    ("attitude", "pitch"): "pitch",
}
"""(quantity, value) -> channel; ``{}`` is the sensor. Values that are not listed are not shown."""


class _Channel(NamedTuple):
    """A value of a quantity: its place among them, its channel, factor and unit on a screen."""

    place: int
    name: str
    factor: float
    unit: str


def _channels(quantity: str) -> list[_Channel]:
    names: list[tuple[str, str]] = []
    for field in FIELDS[quantity]:
        axes = [f"_{axis}" for axis in "xyz"] if field.size > 1 else [""]
        names += [(f"{field.name}{axis}", field.unit) for axis in axes]
    return [
        _Channel(place, _NAMES[quantity, name], *on_screen(unit_of(f"_{unit}")))
        for place, (name, unit) in enumerate(names)
        if (quantity, name) in _NAMES
    ]


_CHANNELS: Final = {quantity: _channels(quantity) for quantity in FIELDS}


def joined(parts: Sequence[Rows]) -> Rows:
    """The same as ``np.concatenate``, which takes thirty times as long for structured rows."""
    if len(parts) == 1:
        return parts[0]
    data = b"".join(np.ascontiguousarray(part).data for part in parts)
    return np.frombuffer(data, parts[0].dtype)


class Measured:
    """A :class:`monitor.verdict.Tap`: rows wait until they are asked for.

    Parameters
    ----------
    settings
        Of the engine: which servo output is the throttle.

    Attributes
    ----------
    units
        Channel -> unit as people read it, of every channel seen.
    """

    def __init__(self, settings: EngineSettings) -> None:
        self.units: dict[str, str] = {}
        self._throttle = Throttle(settings)
        self._waiting: dict[str, list[Rows]] = {}
        self._steps = 0
        self._low: dict[str, float] = {}
        self._high: dict[str, float] = {}

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Keep the rows of sensors that are shown."""
        for sensor, some in rows.items():
            quantity = sensor.rstrip("0123456789")
            if len(some) and (_CHANNELS.get(quantity) or quantity in _THROTTLE):
                self._waiting.setdefault(sensor, []).append(some)
        self._steps += 1
        if self._steps >= STEPS_WAITING:
            self._reduce()

    def take(self) -> dict[str, Range]:
        """Ranges since the last call, of channels with a finite value."""
        self._reduce()
        out: dict[str, Range] = {
            channel: (rounded(low), rounded(self._high[channel]))
            for channel, low in self._low.items()
        }
        self._low.clear()
        self._high.clear()
        return out

    def _reduce(self) -> None:
        """Rows that wait become ranges."""
        rows = {sensor: joined(some) for sensor, some in self._waiting.items()}
        self._waiting.clear()
        self._steps = 0
        throttle = self._throttle.step(rows)
        if throttle is not None:
            self._widen("throttle", "throttle", throttle[1])
        for sensor, some in rows.items():
            quantity = sensor.rstrip("0123456789")
            values = VALUES.get(quantity)
            if values is not None:
                self._widen(sensor, quantity, values(some))

    def _widen(self, sensor: str, quantity: str, values: NDArray[np.float64]) -> None:
        """Use values, shape (k, n)."""
        lows = np.fmin.reduce(values, axis=1).tolist()
        highs = np.fmax.reduce(values, axis=1).tolist()
        for place, name, factor, unit in _CHANNELS[quantity]:
            low, high = lows[place] * factor, highs[place] * factor
            if isfinite(low) and isfinite(high):
                channel = name.format(sensor)
                self._low[channel] = min(low, self._low.get(channel, low))
                self._high[channel] = max(high, self._high.get(channel, high))
                self.units[channel] = unit
