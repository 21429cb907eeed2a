"""How near every pitot is to a verdict: the largest statistic over its threshold, row by row.

=========  ==============================================================================  ====
symbol     meaning                                                                         unit
=========  ==============================================================================  ====
ratio      of the tests that can blame pitot i, the largest statistic over its threshold   1
           since the last row; while it is faulty, its distance from agreement over what
           is agreement
rest       how far what the test asks for besides (a shift, turns) is there                1
=========  ==============================================================================  ====

A ratio counts in full once the rest is there and no more than ``rest`` before: beyond 1 is an
alarm of this moment, and a verdict takes that it lasts. Rows stand at the time of an epoch, by
whose evidence most verdicts fall; where no epochs come, at a sample. What the long horizon says is
said anew when it is solved, and stands until then.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "HELD",
    "LONG",
    "N_ROW",
    "ROW_S",
    "T_ROW",
    "hold",
    "hold_return",
    "new_tests",
    "pending",
    "put_row",
    "short_of",
]

Array = NDArray[np.float64]

HELD, LONG, T_ROW = 0, 3, 6
"""Per pitot the ratio since the last row, and the long horizon's; time of the last row [s]."""
N_ROW = 11
"""Columns of a row: time [s], three ratios [1], three expected CAS and their standard deviations
[m/s], time of the newest epoch [s]."""
ROW_S = 0.19
"""Rows are no nearer to each other, but for those of a change of state: 5 Hz with some jitter."""


def new_tests() -> Array:
    """Nothing tested yet, shape (7,)."""
    tests = np.full(7, np.nan)
    tests[T_ROW] = -np.inf
    return tests


@kernel
def short_of(ratio: float, rest: float) -> float:
    """A statistic's ratio, no more than ``rest`` until what else is asked is there (at 1)."""
    return ratio if rest >= 1.0 else min(ratio, rest)


@kernel
def hold(tests: Array, slot: int, ratio: float) -> None:
    """Let a ratio count if it is the largest of its slot; NaN says nothing, below 0 is 0."""
    if not math.isnan(ratio) and not tests[slot] >= ratio:
        tests[slot] = max(ratio, 0.0)


@kernel
def hold_return(
    tests: Array, i: int, mean: float, last: float, tolerance: float, well: bool
) -> None:
    """Hold a faulty pitot's residuals over its tolerance; at least 1 while it is not well.

    Parameters
    ----------
    mean, last, tolerance : float [1]
        Running mean of the residual, the last one, and what is agreement (of ``last``, thrice).
    well : bool
        It neither stands still nor scatters, and the prediction is good enough.
    """
    apart = max(abs(mean) / tolerance, abs(last) / (3.0 * tolerance))
    hold(tests, HELD + i, apart if well or np.isnan(apart) else max(apart, 1.0))


@kernel
def pending(tests: Array) -> bool:
    """Whether any pitot was tested since the last row."""
    untested = 0
    for i in range(3):
        untested += 1 if math.isnan(tests[HELD + i]) else 0
    return untested < 3


@kernel
def put_row(tests: Array, t: float, epoch: float, row: Array) -> None:
    """Write time and ratios of a row, no earlier than the last one, and begin anew.

    Parameters
    ----------
    tests : (7,) float64, changed in place
    t, epoch : float [s]
        Now, and time of the newest epoch.
    row : (11,) float64
        Receives times and ratios; what the pitots should show is NaN.
    """
    row[0] = tests[T_ROW] = max(t, tests[T_ROW])
    for i in range(3):
        ratio, slow = tests[HELD + i], tests[LONG + i]
        row[1 + i] = slow if slow > ratio or math.isnan(ratio) else ratio
        tests[HELD + i] = np.nan
    for k in range(4, N_ROW):
        row[k] = np.nan
    row[N_ROW - 1] = epoch
