"""How near to its limits a healthy flight came: the largest value of every test quantity.

A limit that must be exceeded for a time T is compared here with the quantity's minimum over blocks
of T / 3: whatever lasted T covers one such block whole, so that a limit above the peak would not
have been exceeded for T. Only pitots that are judged and not faulty count, and of a test with two
conditions each is noted where the other holds.

===========  ============================================================  =========
row          quantity                                                      unit
===========  ============================================================  =========
MARGIN_ONE   evidence against one of several pitots whose shift is large   nat
             enough
MARGIN_ALL   the same for all of several                                   nat
MARGIN_SINGLE  the same for a single pitot                                 nat
MIN_SHIFT    shift of ln scale of a pitot with evidence enough             1
APART        lasting difference of GPS and autopilot velocity              m/s
NOISE        white noise of GPS velocity beyond the autopilot's            m/s
GROSS_LN     + i: error of ln airspeed, less 3 standard deviations of the  1
             prediction
NOISE_RMS    + i: sample-to-sample noise that the others do not show       1
DEAD_WIND    + i: ground speed less 1.2 times airspeed while the wind is   m/s
             not known
===========  ============================================================  =========
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "APART",
    "DEAD_WIND",
    "GROSS_LN",
    "MARGIN_ALL",
    "MARGIN_ONE",
    "MARGIN_SINGLE",
    "MIN_SHIFT",
    "NOISE",
    "NOISE_RMS",
    "N_PEAKS",
    "PEAK",
    "new_peaks",
    "note",
]

Array = NDArray[np.float64]

MARGIN_ONE, MARGIN_ALL, MARGIN_SINGLE, MIN_SHIFT, APART, NOISE = range(6)
# One row for each pitot from here on.
GROSS_LN, NOISE_RMS, DEAD_WIND = 6, 9, 12
N_PEAKS = 15

# Columns: begin of the block, its least value, the greatest of all blocks.
BLOCK_SINCE, BLOCK_LEAST, PEAK = range(3)


def new_peaks() -> Array:
    """Nothing seen yet, shape (15, 3)."""
    return np.full((N_PEAKS, 3), np.nan)


@kernel
def note(peaks: Array, row: int, t: float, value: float, hold_s: float) -> None:
    """Use the quantity's value at time t; a limit on it must be exceeded for ``hold_s``.

    Parameters
    ----------
    peaks : (15, 3) float64, changed in place
    value : float
        NaN where the quantity means nothing now.
    """
    p = peaks[row]
    if np.isnan(value):
        p[BLOCK_SINCE] = np.nan
        return
    if np.isnan(p[BLOCK_SINCE]):
        p[BLOCK_SINCE], p[BLOCK_LEAST] = t, value
    elif value < p[BLOCK_LEAST]:
        p[BLOCK_LEAST] = value
    if t - p[BLOCK_SINCE] >= hold_s / 3.0:
        if not p[PEAK] >= p[BLOCK_LEAST]:
            p[PEAK] = p[BLOCK_LEAST]
        p[BLOCK_SINCE] = np.nan
