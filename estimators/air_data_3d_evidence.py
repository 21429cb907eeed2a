"""What evidence of the bank takes to convict a pitot, and how near a flight came to it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS, SCALE
from estimators.air_data_3d_bank import N_HYPOTHESES, WIND_CHANGED, Bank, WindBounds, evidence
from estimators.air_peaks import MARGIN_ALL, MARGIN_ONE, MARGIN_SINGLE, MIN_SHIFT, note
from estimators.air_tests import HELD, hold, short_of
from estimators.jit import kernel

__all__ = [
    "JudgeLimits",
    "convicted",
    "disagreement",
    "hold_evidence",
    "margin_of",
    "note_evidence",
]

Array = NDArray[np.float64]
_SCALE0 = SCALE.start


class JudgeLimits(NamedTuple):
    """Limits of the decisions; the settings of the same names say what each rests on."""

    margin_one: float
    margin_all: float
    margin_single: float
    margin_wind: float
    confirm_s: float
    min_shift: float
    wind: WindBounds
    learnt_scale_std: float
    lost_scale_std: float
    readmit_shift: float
    readmit_unlearnt: float
    readmit_s: float
    suspect_clear_s: float


SLOW_S = 90.0
"""Older explanations blame no more all pitots together. A fault so slow looks like a slow wind but
for the turns, and on a long straight gusts, which turn the nose and push the aircraft aside at
once, tell less of the airspeed than they seem to: :mod:`estimators.air_horizon_judge` asks for a
turn."""


@kernel
def margin_of(limits: JudgeLimits, mask: int, active: int, fitted: int) -> float:
    """Evidence that a verdict on the pitots of ``mask`` takes.

    The last one that is left of several needs as much as all of them do together: that it breaks
    too is as rare.
    """
    if mask != active:
        return limits.margin_one
    alone = mask == fitted and mask & (mask - 1) == 0
    return limits.margin_single if alone else limits.margin_all


@kernel
def least_of(limits: JudgeLimits, mask: int, active: int, gust: float) -> float:
    """Shift that a verdict on the pitots of ``mask`` takes.

    With no other pitot as witness, gusts are part of what the shift is measured against.
    """
    return limits.min_shift + (gust if mask == active else 0.0)


@kernel
def _least_shift(bank: Bank, g: int, h: int, mask: int) -> float:
    """Least shift of the pitots of ``mask`` since the start of an explanation.

    Zero when they shift in opposite directions: what breaks several pitots at once moves them
    alike, and what else breaks them breaks them one after the other.
    """
    least, most = np.inf, -np.inf
    for i in range(N_PITOTS):
        if (mask >> i) & 1:
            shift = bank.hx[h, _SCALE0 + i, g] - bank.ref[g, i]
            least, most = min(least, shift), max(most, shift)
    return float(max(least, -most, 0.0))


@kernel
def gain_of_blaming_more(
    limits: JudgeLimits, bank: Bank, top: Array, where: NDArray[np.int64], mask: int
) -> float:
    """What blaming more pitots than those of ``mask`` would gain at most [nat].

    An explanation that hardly moves the others blames nobody more.
    """
    more = -np.inf
    for h in range(N_HYPOTHESES):
        if h != mask and h & mask == mask and where[h] >= 0:
            moved = 0.0
            for i in range(N_PITOTS):
                if ((h & ~mask) >> i) & 1:
                    moved = max(moved, _least_shift(bank, where[h], h, 1 << i))
            if moved > limits.min_shift:
                more = max(more, top[h])
    return float(more - top[mask])


@kernel
def _believable(
    t: float,
    limits: JudgeLimits,
    bank: Bank,
    top: Array,
    where: NDArray[np.int64],
    h: int,
    active: int,
) -> bool:
    """Whether explanation h is one of pitots under judgement, of no more than it takes.

    Parameters as of :func:`convicted`.
    """
    g = where[h]
    if g < 0 or (h & active) != h or (h == active and t - bank.born[g] > SLOW_S):
        return False
    return bool(gain_of_blaming_more(limits, bank, top, where, h) <= 0.5 * limits.margin_one)


@kernel
def convicted(
    t: float,
    limits: JudgeLimits,
    bank: Bank,
    top: Array,
    where: NDArray[np.int64],
    active: int,
    fitted: int,
    gust: float,
) -> int:
    """Smallest set of pitots whose evidence and shifts suffice for a verdict; 0 when none does.

    Parameters
    ----------
    t : float [s]
        Now.
    top, where : (8,) float64 [nat], (8,) int64
        Evidence of each explanation and its generation.
    active, fitted : int
        Bit masks of the pitots under judgement, and of all that exist.
    gust : float [1]
        Gust intensity as a share of the airspeed.
    """
    for size in range(1, N_PITOTS + 1):
        for h in range(1, N_HYPOTHESES):
            bits = (h & 1) + ((h >> 1) & 1) + ((h >> 2) & 1)
            if bits != size or not _believable(t, limits, bank, top, where, h, active):
                continue
            large = _least_shift(bank, where[h], h, h) > least_of(limits, h, active, gust)
            if large and evidence(top, h) > margin_of(limits, h, active, fitted):
                return h
    return 0


@kernel
def hold_evidence(
    tests: Array,
    t: float,
    limits: JudgeLimits,
    bank: Bank,
    top: Array,
    where: NDArray[np.int64],
    active: int,
    fitted: int,
    gust: float,
) -> None:
    """Hold the evidence against each pitot under judgement, over what a verdict takes.

    Parameters as of :func:`convicted`. Of an explanation by several pitots it counts for each.
    """
    for i in range(N_PITOTS):
        if (active >> i) & 1:
            hold(tests, HELD + i, 0.0)
    for h in range(1, N_HYPOTHESES):
        if not _believable(t, limits, bank, top, where, h, active):
            continue
        shift = _least_shift(bank, where[h], h, h) / least_of(limits, h, active, gust)
        ratio = short_of(evidence(top, h) / margin_of(limits, h, active, fitted), shift)
        for i in range(N_PITOTS):
            if (h >> i) & 1:
                hold(tests, HELD + i, ratio)


@kernel
def disagreement(top: Array, active: int) -> float:
    """Evidence that one of several pitots shifted alone, whichever it was [nat]."""
    if active & (active - 1) == 0:
        return -np.inf
    one = -np.inf
    for i in range(N_PITOTS):
        one = max(one, top[1 << i])
    return float(one - max(0.0, top[WIND_CHANGED]))


@kernel
def note_evidence(
    peaks: Array,
    t: float,
    limits: JudgeLimits,
    bank: Bank,
    top: Array,
    where: NDArray[np.int64],
    active: int,
    fitted: int,
    gust: float,
) -> None:
    """Note how near the explanations came to a verdict; parameters as of :func:`convicted`.

    Each of the two conditions of a verdict, evidence and shift, is noted where the other holds.
    """
    one, every, single, shift = 0.0, 0.0, 0.0, 0.0
    for h in range(1, N_HYPOTHESES):
        if not _believable(t, limits, bank, top, where, h, active):
            continue
        e, least = evidence(top, h), _least_shift(bank, where[h], h, h)
        if e > margin_of(limits, h, active, fitted):
            shift = max(shift, least - (least_of(limits, h, active, gust) - limits.min_shift))
        if not least > least_of(limits, h, active, gust):
            continue
        if h != active:
            one = max(one, e)
        elif h == fitted and h & (h - 1) == 0:
            single = max(single, e)
        else:
            every = max(every, e)
    note(peaks, MARGIN_ONE, t, one, limits.confirm_s)
    note(peaks, MARGIN_ALL, t, every, limits.confirm_s)
    note(peaks, MARGIN_SINGLE, t, single, limits.confirm_s)
    note(peaks, MIN_SHIFT, t, shift, limits.confirm_s)
