"""Engine-speed sensors: one or several on each shaft, read together, each with its own faults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from sim_feeds.faults import Fault
from sim_feeds.sensors import Instrument, Series, broken, quantised, stream

__all__ = ["MAX_CHANNELS", "Tachometer"]

Floats = NDArray[np.float64]

MAX_CHANNELS: Final = 16


class Tachometer(Instrument):
    """Speed sensors of a six-degree-of-freedom aircraft: ``spool0`` is the first on shaft 0."""

    count: int = Field(1, ge=1, le=5, description="How many sensors each shaft has.")
    rate_hz: float = Field(10.0, gt=0.0, le=50.0, description="Readings per second.")
    noise_share: float = Field(0.002, ge=0.0, lt=0.5, description="White noise over the reading.")
    quantum_rpm: float = Field(1.0, ge=0.0, description="Resolution.")

    def channels(self, shafts: int) -> list[int]:
        """Shaft of each channel."""
        return [shaft for shaft in range(shafts) for _ in range(self.count)]

    def read(self, t_s: Floats, shaft_rpm: Floats, faults: Sequence[Fault], seed: int) -> Series:
        """Columns spool0, spool1 ... [rpm]; a dropout reads NaN.

        Parameters
        ----------
        t_s : (n,) float64
            Even grid of the flight.
        shaft_rpm : (n, k) float64
            Speeds of the shafts.
        faults
            Those of other sensors are passed over.
        seed
            Of the noise.
        """
        when = self.times(float(t_s[-1]), stream(seed, "tachometers"))
        t = when.valid_s
        columns = []
        for channel, shaft in enumerate(self.channels(shaft_rpm.shape[1])):
            own = stream(seed, f"spool{channel}")
            x = np.interp(t, t_s, shaft_rpm[:, shaft])
            x = x * (1.0 + self.noise_share * own.standard_normal(len(t)))
            x = quantised(x, self.quantum_rpm)
            columns.append(broken(faults, f"spool{channel}", t, x, own))
        values = np.column_stack(columns) if columns else np.zeros((len(t), 0))
        return Series(t, when.stamp_s, when.sent_s, values)
