"""Does the airframe's table fit the aircraft at all?

========  ==================================================================  ==========  ========
symbol    meaning                                                             shape       unit
========  ==================================================================  ==========  ========
y, S      whitened residuals and signatures (:mod:`estimators.wing_noise`)    (6,)(6, 4)  1, 1/%
D         signatures of one wing's excess over the other's: lift, drag        (6, 2)      1/%
unlike    |y - D (D'D)^-1 D'y|^2 / 4                                          1
========  ==================================================================  ==========  ========

``unlike`` is the variance of what no difference between the wings explains, against what is
expected of a healthy aircraft: damage of any size leaves it alone. Its mean is well below one while
the coefficients are as good as their deviations say, and 11 and more with another aircraft's.

Differs: samar2006 takes its model for the aircraft's.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.wing_model import AXES

__all__ = ["Misfit", "unlike_rows"]

Array = NDArray[np.float64]

FREE = AXES - 2.0
"""Directions of y that D leaves."""
BACK = 0.5
"""Below this share of the limit an airframe fits again."""


@kernel
def unlike_rows(y: Array, S: Array, unlike: Array) -> None:
    """Write ``unlike`` of each row.

    Parameters
    ----------
    y, S : (n, 6), (n, 6, 4) float64
    unlike : (n,) float64, written
        NaN for a row that is not finite.
    """
    for k in range(len(y)):
        square = a = b = c = u = v = 0.0
        for i in range(AXES):
            lift, drag = S[k, i, 0] - S[k, i, 2], S[k, i, 1] - S[k, i, 3]
            square += y[k, i] * y[k, i]
            a, b, c = a + lift * lift, b + lift * drag, c + drag * drag
            u, v = u + lift * y[k, i], v + drag * y[k, i]
        det = a * c - b * b
        explained = (c * u * u - 2.0 * b * u * v + a * v * v) / det if det > 0.0 else 0.0
        sound = math.isfinite(square) and math.isfinite(explained) and math.isfinite(det)
        unlike[k] = max(square - explained, 0.0) / FREE if sound else math.nan


class Misfit:
    """Whether an airframe fits, by the mean of ``unlike`` over the beginning of a flight.

    Parameters
    ----------
    limit
        Of the mean.
    first, last
        Rows from which on, and up to which, it is asked, count.
    """

    def __init__(self, limit: float, first: int, last: int) -> None:
        self._limit, self._first, self._last = limit, first, last
        self._sum, self._rows = 0.0, 0
        self.fits: bool | None = None
        """None while too few rows have come."""

    @property
    def mean(self) -> float:
        """Mean of the rows that were asked."""
        return self._sum / self._rows if self._rows else math.nan

    def note(self, unlike: float) -> bool | None:
        """Take a row, in order; whether the airframe fits."""
        if not math.isfinite(unlike) or self._rows >= self._last:
            return self.fits
        self._sum += unlike
        self._rows += 1
        if self._rows >= self._first:
            share = BACK if self.fits is False else 1.0
            self.fits = self.mean <= share * self._limit
        return self.fits

    def settle(self) -> None:
        """Ask no more: what comes is no longer the healthy aircraft."""
        self._last = 0
