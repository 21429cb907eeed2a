"""Whether a tick deserves a decision, and how loud a healthy flight gets.

=========  =======================================================================  ========
peak       largest value, while every IMU is judged and none is called faulty, of    unit
=========  =======================================================================  ========
P_PAIR     ``|z_n|`` of a difference between two IMUs (imu_difference)              sigma
P_LONE     ``|z|`` of a step in a window of a filter (imu_evidence)                 sigma
P_NOISE    ratio by which an axis' noise has risen above its peers'                 1
P_ACC      specific-force difference, or step                                       m/s^2
P_GYRO     rate difference, or step                                                 rad/s
=========  =======================================================================  ========

A fault needs a statistic beyond its threshold *and* a size beyond its own. So a statistic counts
here where its size is at least half way, and a size where its statistic alone would make a fault;
differences count what has held for three intervals, for so long must an alarm. The peaks are what
thresholds are learnt from.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.imu_difference import (
    D_BEFORE,
    D_COUNT,
    D_MEAN,
    D_Z,
    KNOWN_SAMPLES,
    N_SEEN,
    noise_excess,
    odd_noise,
)
from estimators.ins_bank_state import (
    C_CHANGED,
    C_FLYING,
    C_GPS_BAD_S,
    C_JUDGED,
    C_SPIN_S,
    R_T_GPS,
    Bank,
    Tuning,
)
from estimators.ins_bank_windows import SWING_Z2
from estimators.jit import inlined, kernel

__all__ = [
    "JUDGED_AGE_S",
    "P_ACC",
    "P_GYRO",
    "P_LONE",
    "P_NOISE",
    "P_PAIR",
    "interesting",
    "physical_size",
    "swings",
]

Array = NDArray[np.float64]

P_PAIR, P_LONE, P_NOISE, P_ACC, P_GYRO = range(5)

LEAST_AGE_S = 0.6
"""A younger window says nothing yet."""
JUDGED_AGE_S = 0.8
"""A window younger than this has seen too few fixes to name an axis."""
SILENT_S = 0.5
RECTIFIED = 0.1
"""Vibration and gusts that the samples alias can leave a mean of this share of their sample-to-
sample rms (rectification): a lone IMU is not blamed for less. Real flights shake by 1 m/s^2."""


@kernel
def physical_size(size: Array, diff2: Array, k: int) -> float:
    """The least step of an axis that a lone IMU is blamed for [SI].

    Parameters
    ----------
    size : (6,) float64
        Nothing smaller is called a fault.
    diff2 : (6,) float64
        Mean square first difference of the IMU's samples.
    k : int
    """
    first = 3 * (k // 3)
    shaken = math.sqrt(diff2[first] + diff2[first + 1] + diff2[first + 2])
    return float(max(size[k], RECTIFIED * shaken))


@inlined
def _note_pairs(b: Bank, p: Tuning) -> None:
    """Peaks of the differences between IMUs."""
    n = b.sample.shape[0]
    for i in range(n):
        for j in range(i + 1, n):
            s = b.pair[i, j]
            if s[D_COUNT, 0] < 3.0:
                continue
            for k in range(6):
                z, size = 0.0, 0.0
                for lag in range(3):
                    if abs(s[D_Z + lag, k]) > z:
                        z, size = abs(s[D_Z + lag, k]), abs(s[D_MEAN + lag, k])
                if size < p.interest_size[k]:
                    z = 0.0
                if z < p.difference_sigma:
                    size = 0.0
                held_z = min(z, s[D_BEFORE, k], s[D_BEFORE + 1, k])
                held_size = min(size, s[D_BEFORE + 2, k], s[D_BEFORE + 3, k])
                s[D_BEFORE + 1, k], s[D_BEFORE, k] = s[D_BEFORE, k], z
                s[D_BEFORE + 3, k], s[D_BEFORE + 2, k] = s[D_BEFORE + 2, k], size
                at = P_ACC if k < 3 else P_GYRO
                b.peaks[P_PAIR] = max(b.peaks[P_PAIR], held_z)
                b.peaks[at] = max(b.peaks[at], held_size)


@inlined
def _note_noise(b: Bank, now: float) -> None:
    """Peak of the rise of an axis' noise above its peers'."""
    n = b.sample.shape[0]
    known = np.zeros(n)
    for i in range(n):
        if b.noise[i, N_SEEN, 0] >= KNOWN_SAMPLES and now - b.sample[i, 0] < SILENT_S:
            known[i] = 1.0
    for i in range(n):
        if known[i] > 0.0:
            for k in range(6):
                rise = math.exp(noise_excess(b.noise, i, k, known))
                b.peaks[P_NOISE] = max(b.peaks[P_NOISE], rise)


@inlined
def _note_step(b: Bank, p: Tuning, c: int, k: int, z: float, size: float, alone: bool) -> None:
    """Peaks of a step in a window of filter ``c``; its size counts where its IMU is ``alone``."""
    if size > physical_size(p.interest_size, b.diff2[c // 2], k):
        b.peaks[P_LONE] = max(b.peaks[P_LONE], z)
        if alone and z > p.single_sigma:
            at = P_ACC if k < 3 else P_GYRO
            b.peaks[at] = max(b.peaks[at], size)


@inlined
def swings(b: Bank, p: Tuning, imu: int, k: int) -> bool:
    """Whether a rate swings to and fro against an attitude that does not come from this gyro.

    The mean square of the faults of many short windows must make a swing of the physical size.
    """
    swing = b.swing[2 * imu + 1]
    size = 2.0 * p.interest_size[k]
    large = swing[0, k] > SWING_Z2 and 2.0 * swing[1, k] > size * size
    return bool(p.attitude_independent and k >= 3 and large)


@inlined
def interesting(b: Bank, p: Tuning, now: float) -> bool:
    """Whether anything deserves a decision: a window, a reference, a value that stands still."""
    interest = bool(b.clock[C_CHANGED] == 1.0)
    quiet = now - b.clock[C_SPIN_S] > 0.5 and now > b.clock[C_GPS_BAD_S]
    if b.clock[C_FLYING] == 1.0:
        interest = interest or not quiet or now - b.ref[R_T_GPS] > 1.0
    judged = quiet and b.clock[C_JUDGED] == 1.0
    if judged:
        _note_pairs(b, p)
        _note_noise(b, now)
    live = 0
    for i in range(b.sample.shape[0]):
        live += 1 if now - b.sample[i, 0] < SILENT_S else 0
        interest = interest or odd_noise(b.noise, i, now)
    for c in range(b.x.shape[0]):
        if math.isnan(b.aligned_s[c]):
            continue
        counts = judged and (c % 2 == 0 or p.attitude_independent)
        for k in range(3, 6):
            interest = interest or swings(b, p, c // 2, k)
        for w in range(b.start_s.shape[1] - 1):
            age = now - b.start_s[c, w]
            for k in range(6):
                info = b.L[c, w, k, k]
                if age < LEAST_AGE_S or info <= 0.0:
                    continue
                z = abs(b.Y[c, w, k]) / math.sqrt(info * b.start_nis[c, w])
                size = abs(b.Y[c, w, k]) / info
                if z > p.interest_sigma and size > p.interest_size[k]:
                    interest = True
                if counts and age >= JUDGED_AGE_S:
                    _note_step(b, p, c, k, z, size, live == 1)
    return bool(interest)
