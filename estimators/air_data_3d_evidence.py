"""What evidence of the bank takes to convict a pitot, and how near a flight came to it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS, SCALE
from estimators.air_data_3d_bank import N_HYPOTHESES, Bank, evidence, parsimony
from estimators.air_peaks import MARGIN_ALL, MARGIN_ONE, MIN_SHIFT, note
from estimators.jit import kernel

__all__ = ["JudgeLimits", "convicted", "margin_of", "note_evidence"]

Array = NDArray[np.float64]
_SCALE0 = SCALE.start


class JudgeLimits(NamedTuple):
    """Limits of the decisions; the settings of the same names say what each rests on."""

    margin_one: float
    margin_all: float
    margin_wind: float
    confirm_s: float
    min_shift: float
    wind_max_m_s: float
    learnt_scale_std: float
    lost_scale_std: float
    readmit_shift: float
    readmit_unlearnt: float
    readmit_s: float
    suspect_clear_s: float


@kernel
def margin_of(limits: JudgeLimits, mask: int, active: int) -> float:
    """Evidence that a verdict on the pitots of ``mask`` takes."""
    return limits.margin_all if mask == active else limits.margin_one


@kernel
def convicted(
    limits: JudgeLimits,
    bank: Bank,
    top: Array,
    where: NDArray[np.int64],
    active: int,
) -> int:
    """Smallest set of pitots whose evidence and shifts suffice for a verdict; 0 when none does."""
    for size in range(1, N_PITOTS + 1):
        for h in range(1, N_HYPOTHESES):
            g = where[h]
            bits = (h & 1) + ((h >> 1) & 1) + ((h >> 2) & 1)
            if bits != size or g < 0 or (h & active) != h:
                continue
            margin = margin_of(limits, h, active)
            if not evidence(top, h) > margin or parsimony(top, h) > 0.5 * limits.margin_one:
                continue
            shifted = True
            for i in range(N_PITOTS):
                shift = bank.hx[g, h, _SCALE0 + i] - bank.ref[g, i]
                if (h >> i) & 1 and not abs(shift) > limits.min_shift:
                    shifted = False
            if shifted:
                return h
    return 0


@kernel
def note_evidence(
    peaks: Array,
    t: float,
    limits: JudgeLimits,
    bank: Bank,
    top: Array,
    where: NDArray[np.int64],
    active: int,
) -> None:
    """Note how near the explanations came to a verdict; parameters as of :func:`convicted`.

    Each of the two conditions of a verdict, evidence and shift, is noted where the other holds.
    """
    one, every, shift = 0.0, 0.0, 0.0
    for h in range(1, N_HYPOTHESES):
        g = where[h]
        if g < 0 or (h & active) != h or parsimony(top, h) > 0.5 * limits.margin_one:
            continue
        e, least = evidence(top, h), np.inf
        for i in range(N_PITOTS):
            if (h >> i) & 1:
                least = min(least, abs(bank.hx[g, h, _SCALE0 + i] - bank.ref[g, i]))
        if e > margin_of(limits, h, active):
            shift = max(shift, least)
        if least <= limits.min_shift:
            continue
        if h == active:
            every = max(every, e)
        else:
            one = max(one, e)
    note(peaks, MARGIN_ONE, t, one, limits.confirm_s)
    note(peaks, MARGIN_ALL, t, every, limits.confirm_s)
    note(peaks, MIN_SHIFT, t, shift, limits.confirm_s)
