"""How near every axis is to a verdict at a tick: each statistic over its threshold.

==========  ======================================================================  ========
test        statistic over threshold                                                also asks
==========  ======================================================================  ========
zeros       seconds that all six values have been zero / ZERO_S
standstill  improbability of an unchanged value / 1                                 1 s, ten
                                                                                    samples
noise       ln of the rms over that of the peers / ln of the ratio allowed
difference  largest ``|z|`` of the three lags of a pair / ``difference_sigma``      its size
step        ``|z|`` of a window of a lone IMU's filter / ``single_sigma``           its size
swing       mean square z of the short windows / SWING_Z2                           its size
==========  ======================================================================  ========

The ratio of an axis is the largest of these. Where a size is asked for as well, the statistic's
ratio counts in full once that is there, and no more than the size's own share before
(:func:`short_of`): beyond 1 is an alarm of this tick, and what a verdict still takes is that the
alarm lasts and whose it is.

An axis that is called faulty is not tested here: what its return is held against stands with those
who decide it, in ``monitor.watch``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.imu_difference import (
    D_COUNT,
    D_MEAN,
    D_Z,
    KNOWN_SAMPLES,
    N_SEEN,
    N_ZERO_S,
    ZERO_S,
    improbable_rest,
    noise_excess,
)
from estimators.ins_bank_interest import JUDGED_AGE_S, SILENT_S, physical_size
from estimators.ins_bank_state import C_FLYING, C_JUDGED, N_RATIOS, Bank, Tuning
from estimators.ins_bank_windows import SWING_Z2
from estimators.jit import inlined, kernel

__all__ = ["short_of", "tick_ratios"]

Array = NDArray[np.float64]


@inlined
def short_of(ratio: float, rest: float) -> float:
    """A statistic's ratio, no more than ``rest`` until what else is asked is there (at 1)."""
    return ratio if rest >= 1.0 else min(ratio, rest)


@inlined
def _hold(out: Array, imu: int, k: int, ratio: float) -> None:
    """Let a ratio count if it is the largest of its axis so far."""
    if not out[imu, k] >= ratio:
        out[imu, k] = ratio


@inlined
def _alone(b: Bank, p: Tuning, imu: int, k: int, now: float, known: Array) -> float:
    """Ratio of the tests that need no reference."""
    zeros = (b.sample[imu, 0] - b.noise[imu, N_ZERO_S, 0]) / ZERO_S
    rest = improbable_rest(b.noise, imu, k, now)
    noise = noise_excess(b.noise, imu, k, known) / p.noise_ln
    return float(max(zeros, rest, noise, 0.0))


@inlined
def _difference(s: Array, p: Tuning, k: int) -> float:
    """Ratio of the difference of two IMUs."""
    z, size = 0.0, 0.0
    for lag in range(3):
        if abs(s[D_Z + lag, k]) > z:
            z, size = abs(s[D_Z + lag, k]), abs(s[D_MEAN + lag, k])
    return float(short_of(z / p.difference_sigma, size / (2.0 * p.interest_size[k])))


@inlined
def _step(b: Bank, p: Tuning, imu: int, k: int, now: float) -> float:
    """Ratio of the steps, and of a swing, that the filters of a lone IMU see."""
    worst = 0.0
    modes = 2 if p.attitude_independent else 1
    size = physical_size(p.interest_size, b.diff2[imu], k)
    least = max(2.0 * p.interest_size[k], size)
    for c in range(2 * imu, 2 * imu + modes):
        if math.isnan(b.aligned_s[c]):
            continue
        for w in range(b.start_s.shape[1] - 1):
            info = b.L[c, w, k, k]
            if now - b.start_s[c, w] < JUDGED_AGE_S or info <= 1e-12:
                continue
            z = abs(b.Y[c, w, k]) / math.sqrt(info * b.start_nis[c, w])
            ratio = short_of(z / p.single_sigma, abs(b.Y[c, w, k]) / (info * least))
            worst = max(worst, ratio)
    if p.attitude_independent and k >= 3:
        swing, large = b.swing[2 * imu + 1], 2.0 * p.interest_size[k]
        rest = math.sqrt(2.0 * swing[1, k]) / large
        worst = max(worst, short_of(swing[0, k] / SWING_Z2, rest))
    return float(worst)


@kernel
def tick_ratios(b: Bank, p: Tuning, now: float) -> None:
    """Fill ``b.ratios`` of a tick: of six axes, NaN of what is not tested; the last column NaN."""
    out = b.ratios
    n = b.sample.shape[0]
    for i in range(n):
        for k in range(N_RATIOS):
            out[i, k] = math.nan
    if b.clock[C_FLYING] != 1.0:
        return
    live, known = 0, np.zeros(n)
    for i in range(n):
        if now - b.sample[i, 0] < SILENT_S:
            live += 1
            known[i] = 1.0 if b.noise[i, N_SEEN, 0] >= KNOWN_SAMPLES else 0.0
    for i in range(n):
        if not now - b.sample[i, 0] < SILENT_S:
            continue
        for k in range(6):
            if b.called[i, k] > 0.0:
                continue
            if known[i] > 0.0:
                _hold(out, i, k, _alone(b, p, i, k, now, known))
            if live == 1 and b.clock[C_JUDGED] == 1.0:
                _hold(out, i, k, _step(b, p, i, k, now))
            for j in range(i + 1, n):
                both = now - b.sample[j, 0] < SILENT_S and b.called[j, k] == 0.0
                if both and b.pair[i, j, D_COUNT, 0] >= 3.0:
                    ratio = _difference(b.pair[i, j], p, k)
                    _hold(out, i, k, ratio)
                    _hold(out, j, k, ratio)
