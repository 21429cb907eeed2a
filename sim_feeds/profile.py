"""Smooth time profiles: sums of polynomial steps and ramps with exact derivatives.

Flight paths are built of these so that attitude, rates and specific force follow from the path
analytically. The elementary step rises from 0 to 1 as 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7: its first
three derivatives vanish at both ends, so every profile is three times continuously differentiable.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

__all__ = ["PEAK_SLOPE", "Profile"]

Floats = NDArray[np.float64]

_STEP: Final = Polynomial([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
_RAMP: Final = _STEP.integ()
_RAMP_END: Final = 0.5
"""Integral of the step over its rise."""
PEAK_SLOPE: Final = 35.0 / 16.0
"""Largest slope of the unit step, at x = 1/2."""


class Profile:
    """A function of time: a constant plus steps and ramps that start at given times."""

    def __init__(self, constant: float = 0.0) -> None:
        self.constant = constant
        self._steps: list[tuple[float, float, float]] = []
        self._ramps: list[tuple[float, float, float]] = []

    def step(self, start_s: float, rise_s: float, change: float) -> None:
        """Add a rise by ``change`` between ``start_s`` and ``start_s + rise_s``."""
        self._steps.append((start_s, rise_s, change))

    def ramp(self, start_s: float, rise_s: float, slope: float) -> None:
        """Add a slope that grows from 0 to ``slope`` within ``rise_s`` and then stays."""
        self._ramps.append((start_s, rise_s, slope))

    def trapezoid(self, start_s: float, end_s: float, rise_s: float, slope: float) -> None:
        """Add a slope between two times that comes and goes within ``rise_s`` at either end.

        The value changes by ``slope * (end_s - start_s - rise_s)`` in all.
        """
        self.ramp(start_s, rise_s, slope)
        self.ramp(end_s - rise_s, rise_s, -slope)

    def __call__(self, t_s: Floats, order: int = 0) -> Floats:
        """Value (order 0) or derivative of the given order at the times."""
        t = np.asarray(t_s, dtype=float)
        out = np.full(t.shape, self.constant if order == 0 else 0.0)
        for start, rise, change in self._steps:
            out += change * _unit_step((t - start) / rise, order) / rise**order
        for start, rise, slope in self._ramps:
            out += slope * rise * _unit_ramp((t - start) / rise, order) / rise**order
        return out


def _unit_step(x: Floats, order: int) -> Floats:
    inside = _STEP.deriv(order)(np.clip(x, 0.0, 1.0)) if order else _STEP(np.clip(x, 0.0, 1.0))
    if order == 0:
        return np.asarray(inside)
    return np.where((x > 0.0) & (x < 1.0), inside, 0.0)


def _unit_ramp(x: Floats, order: int) -> Floats:
    if order:
        return _unit_step(x, order - 1)
    return np.where(x < 1.0, _RAMP(np.clip(x, 0.0, 1.0)), _RAMP_END + (x - 1.0))
