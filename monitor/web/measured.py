"""What was measured since the last frame: least and greatest value of every channel that is shown.

The extremes are those of :class:`monitor.traces.Traces`, which the report is drawn from too: of
every tenth of a second, as soon as a later sample closes it. Here rows wait until a frame is due,
and are then thinned all at once: that costs a tenth of doing it at each turn of the daemon's loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Final

import numpy as np

from links.samples import Rows
from monitor.columns import flat, unit_of
from monitor.pages.units import on_screen
from monitor.settings.engine import EngineSettings
from monitor.traces import MEASURED, Traces
from monitor.web.protocol import Range
from monitor.web.wire import rounded

__all__ = ["Measured"]

STEPS_WAITING: Final = 512
"""Steps whose rows wait at most: ten seconds. Then they are thinned before a frame is due."""

_THROTTLE: Final = frozenset({"servo", "param"})
"""What the throttle is read from, besides what is measured."""

_LOW, _HIGH = "_low", "_high"

_CHANNELS: Final[Mapping[tuple[str, str], str]] = {
    **{
        ("imu", f"{kind}_{axis}"): f"{{}}.{kind}_{axis}"
        for kind in ("acc", "gyro")
        for axis in "xyz"
    },
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
"""(quantity, column of its table without extreme and unit) -> channel; ``{}`` is the sensor."""


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
        self._traces = Traces(settings)
        self._waiting: dict[str, list[Rows]] = {}
        self._steps = 0
        self._low: dict[str, float] = {}
        self._high: dict[str, float] = {}

    def step(self, rows: Mapping[str, Rows]) -> None:
        """Keep the rows of sensors that are shown."""
        for sensor, some in rows.items():
            quantity = sensor.rstrip("0123456789")
            if len(some) and (quantity in MEASURED or quantity in _THROTTLE):
                self._waiting.setdefault(sensor, []).append(some)
        self._steps += 1
        if self._steps >= STEPS_WAITING:
            self._thin()

    def take(self) -> dict[str, Range]:
        """Ranges since the last call, of channels with a finite value."""
        self._thin()
        out: dict[str, Range] = {
            channel: (rounded(low), rounded(self._high[channel]))
            for channel, low in self._low.items()
        }
        self._low.clear()
        self._high.clear()
        return out

    def _thin(self) -> None:
        """Rows that wait become ranges."""
        joined = {
            sensor: some[0] if len(some) == 1 else np.concatenate(some)
            for sensor, some in self._waiting.items()
        }
        self._waiting.clear()
        self._steps = 0
        self._traces.step(joined)
        for table, rows in self._traces.take().items():
            self._widen(table.removeprefix("measured_"), flat(rows))

    def _widen(self, sensor: str, columns: Mapping[str, Rows]) -> None:
        quantity = sensor.rstrip("0123456789")
        for low_name, lows in columns.items():
            name, extreme, unit = low_name.partition(_LOW)
            channel = _CHANNELS.get((quantity, name)) if extreme else None
            if channel is None:
                continue
            channel = channel.format(sensor)
            factor, shown = on_screen(unit_of(low_name))
            low = float(np.fmin.reduce(lows)) * factor
            high = float(np.fmax.reduce(columns[name + _HIGH + unit])) * factor
            if isfinite(low) and isfinite(high):
                self._low[channel] = min(low, self._low.get(channel, low))
                self._high[channel] = max(high, self._high.get(channel, high))
                self.units[channel] = shown
