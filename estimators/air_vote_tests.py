"""How near every vane and pitot of the votes is to a verdict, and what it should show: rows.

A ratio is the largest statistic over its threshold since the last row, of the tests that could
blame the sensor at that stage; once it is latched, its residual over what is agreement. See
:mod:`estimators.air_vote` for the tests and channels.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_mhe_3d import ALPHA, CAS, M3, N3, Horizon, air_outputs
from estimators.air_vote_record import SHORT, Votes
from estimators.jit import kernel

__all__ = ["N_TEST", "hold_all", "hold_vote", "put_tests"]

Array = NDArray[np.float64]

N_TEST = 19
"""Columns of a row: time; of three vanes and three pitots the ratio, what each should show, and the
standard deviation of that; s, 1, rad or m/s (CAS)."""
_RATIO, _EXPECT, _STD = 1, 7, 13


@kernel
def hold_vote(z: Votes, ch: int, i: int, ratio: float) -> None:
    """Let a ratio count if it is the largest of its sensor since the last row."""
    if not z.held[ch, i] >= ratio:
        z.held[ch, i] = ratio


@kernel
def hold_all(
    z: Votes, ch: int, T: Array, J: float, mean: float, limit: float, share: float
) -> None:
    """Hold what counts against all sensors T (3,) of a channel alike: rms J, most of it mean."""
    ratio = min(J / limit, abs(mean) / (share * limit))
    if ratio >= 1.0:
        ratio = J / limit
    for i in range(3):
        if T[i] == 1.0:
            hold_vote(z, ch, i, ratio)


@kernel
def put_tests(z: Votes, horizon: Horizon, running: bool, t_s: float, row: Array) -> None:
    """Write a row and begin anew.

    Parameters
    ----------
    running : bool
        Whether the horizon's estimates say what the sensors should show.
    t_s : float [s]
    row : (19,) float64, written
    """
    row[0] = t_s
    newest = horizon.x.shape[0] - 1
    h = np.empty(M3)
    C = np.empty((M3, N3))
    known = air_outputs(horizon.x[newest], horizon.R_bn[newest], horizon.air[newest], h, C)
    for ch in range(2):
        a = ALPHA if ch == 0 else CAS
        total = 0.0
        for k in range(N3):
            for m in range(N3):
                total += C[a, k] * horizon.P[k, m] * C[a, m]
        std = math.sqrt(max(total, 0.0))
        for i in range(3):
            at = 3 * ch + i
            row[_RATIO + at] = z.held[ch, i]
            z.held[ch, i] = np.nan
            row[_EXPECT + at] = row[_STD + at] = np.nan
            if running and known and z.age[ch, i] <= SHORT:
                scale = 1.0 / (1.0 - z.offset[ch, i]) if ch == 1 else 1.0
                row[_EXPECT + at] = h[a] * scale + (z.offset[ch, i] if ch == 0 else 0.0)
                row[_STD + at] = std * scale
