"""A bank of competing explanations: which pitot shifted, or the wind, and since when.

Beside the *master*, which believes that nothing happened, filters run that were cloned from it at
past moments and believe that at that moment something did:

=========  ======================================================================================
hypothesis meaning
=========  ======================================================================================
0          the wind changed: the variance of W grows by ``jump_wind_m_s`` squared
mask > 0   each pitot whose bit is set shifted: the variance of its k grows by ``jump_scale``
           squared, and k walks faster from then on
=========  ======================================================================================

A *generation* holds all hypotheses of one moment. One is born every ``spawn_s``; generations are
thinned out so that their ages stay spaced logarithmically up to ``age_max_s``.

L[g, h] is the log-likelihood of the measurements since the birth of g under h, less that under the
master: a log Bayes factor, since the jump's variance makes a hypothesis pay for its freedom. The
evidence against pitot i is what the best explanation with i has over the best one without it
(the master's L is 0). Of several that convict, the one that blames fewest pitots counts.

The explanation that wins becomes the master. It was cloned before the fault began, so whatever the
fault did to the wind is undone with it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import (
    N_PITOTS,
    NX,
    SCALE,
    lateral_update,
    pitot_update,
    predict,
)
from estimators.air_data_3d_lanes import (
    LANES,
    Lanes,
    lateral_lanes,
    new_lanes,
    pitot_lanes,
    predict_lanes,
)
from estimators.jit import kernel

__all__ = [
    "N_GENERATIONS",
    "N_HYPOTHESES",
    "WIND_CHANGED",
    "Bank",
    "WindBounds",
    "accept_wind",
    "adopt",
    "bank_step",
    "before_onset",
    "changed_wind",
    "clear",
    "evidence",
    "new_bank",
    "parsimony",
    "spawn",
    "survey",
    "wind_evidence",
]

Array = NDArray[np.float64]

N_GENERATIONS = 14
N_HYPOTHESES = 1 << N_PITOTS
WIND_CHANGED = 0

JUMP_OWN_SHARE = 0.2
"""Of the jump of several pitots, the part that each makes alone: one cause breaks them alike."""
EARLY_S = 3.0
"""Age up to which a generation's ``early`` follows its scales."""
_SCALE0 = SCALE.start


class WindBounds(NamedTuple):
    """Winds that an explanation may claim.

    Attributes
    ----------
    horizontal_m_s, vertical_m_s : float [m/s]
        Largest mean wind.
    change_m_s, base_s : float [m/s], [s]
        Largest change of the horizontal wind within ``base_s``; over a longer time it may grow
        with the square root of the time, as a random walk does.
    """

    horizontal_m_s: float
    vertical_m_s: float
    change_m_s: float
    base_s: float


class Bank(NamedTuple):
    """All filters of the bank; arrays are changed in place.

    Attributes
    ----------
    x, P : (10,), (10, 10) float64
        The master.
    hx, hP : (8, 10, 16), (8, 10, 10, 16) float64
        Hypotheses by mask, their generations in lanes (:mod:`estimators.air_data_3d_lanes`); of
        hP[h, i, j] only j >= i is kept.
    L : (14, 8) float64 [nat]
        Log-likelihood over the master's; -inf where no filter runs.
    born : (14,) float64 [s]
        Start of each generation, NaN where free.
    ref, ref_var : (14, 3) float64 [1]
        Scales of the master at that start, and their variances.
    ref_wind : (14, 2) float64 [m/s]
        Its horizontal wind there.
    early : (14, 8, 3) float64 [1]
        Scales some seconds after the start: tells a step from a drift.
    room
        To work in.
    """

    x: Array
    P: Array
    hx: Array
    hP: Array
    L: Array
    born: Array
    ref: Array
    ref_var: Array
    ref_wind: Array
    early: Array
    room: Lanes


def new_bank() -> Bank:
    """A bank with a zero master and no hypotheses."""
    g, h = N_GENERATIONS, N_HYPOTHESES
    return Bank(
        x=np.zeros(NX),
        P=np.zeros((NX, NX)),
        hx=np.zeros((h, NX, LANES)),
        hP=np.zeros((h, NX, NX, LANES)),
        L=np.full((g, h), -np.inf),
        born=np.full(g, np.nan),
        ref=np.zeros((g, N_PITOTS)),
        ref_var=np.zeros((g, N_PITOTS)),
        ref_wind=np.zeros((g, 2)),
        early=np.zeros((g, h, N_PITOTS)),
        room=new_lanes(),
    )


@kernel
def _make_master(bank: Bank, g: int, h: int) -> None:
    """Copy hypothesis h of a generation into the master."""
    for i in range(NX):
        bank.x[i] = bank.hx[h, i, g]
        for j in range(i, NX):
            bank.P[i, j] = bank.P[j, i] = bank.hP[h, i, j, g]


@kernel
def clear(bank: Bank) -> None:
    """Drop every generation."""
    bank.born[:] = np.nan
    bank.L[:] = -np.inf


@kernel
def _slot(born: Array, t: float, age_max_s: float) -> int:
    """Slot for a new generation: a free or outlived one, else the one that leaves least behind.

    The generation dropped is the one whose two neighbours in age are closest in ratio.
    """
    oldest = -1
    for g in range(N_GENERATIONS):
        if np.isnan(born[g]):
            return g
        if oldest < 0 or born[g] < born[oldest]:
            oldest = g
    if t - born[oldest] > age_max_s:
        return oldest
    best, best_ratio = oldest, np.inf
    for g in range(N_GENERATIONS):
        if g == oldest:
            continue
        older, younger = np.inf, 0.0
        age = t - born[g]
        for o in range(N_GENERATIONS):
            a = t - born[o]
            if a > age:
                older = min(older, a)
            elif a < age:
                younger = max(younger, a)
        ratio = (older + 1.0) / (younger + 1.0)
        if ratio < best_ratio:
            best, best_ratio = g, ratio
    return best


@kernel
def spawn(
    bank: Bank, t: float, active: int, jump_scale: float, jump_wind_m_s: float, age_max_s: float
) -> None:
    """Start a generation from the master.

    Parameters
    ----------
    active : int
        Bit i set: pitot i is under judgement; only masks within it are started.
    jump_scale, jump_wind_m_s : float
        Standard deviations of the shift of k and of the horizontal wind; the vertical wind's is a
        tenth.
    """
    g = _slot(bank.born, t, age_max_s)
    bank.born[g] = t
    for i in range(2):
        bank.ref_wind[g, i] = bank.x[i]
    for i in range(N_PITOTS):
        bank.ref[g, i] = bank.x[_SCALE0 + i]
        bank.ref_var[g, i] = bank.P[_SCALE0 + i, _SCALE0 + i]
    for h in range(N_HYPOTHESES):
        if (h & active) != h:
            bank.L[g, h] = -np.inf
            continue
        bank.L[g, h] = 0.0
        P = bank.hP[h]
        for i in range(NX):
            bank.hx[h, i, g] = bank.x[i]
            for j in range(i, NX):
                P[i, j, g] = bank.P[i, j]
        if h == WIND_CHANGED:
            P[0, 0, g] += jump_wind_m_s**2
            P[1, 1, g] += jump_wind_m_s**2
            P[2, 2, g] += (0.1 * jump_wind_m_s) ** 2
        for i in range(N_PITOTS):
            bank.early[g, h, i] = bank.x[_SCALE0 + i]
            for j in range(i, N_PITOTS):
                if (h >> i) & (h >> j) & 1:
                    own = JUMP_OWN_SHARE**2 if i == j else 0.0
                    jump2 = jump_scale**2 * (1.0 - JUMP_OWN_SHARE**2 + own)
                    P[_SCALE0 + i, _SCALE0 + j, g] += jump2


@kernel
def _runs(bank: Bank, h: int) -> bool:
    """Whether any generation runs a filter of hypothesis h."""
    best = -np.inf
    for g in range(N_GENERATIONS):
        best = max(best, bank.L[g, h])
    return bool(best > -np.inf)


@kernel
def bank_step(
    bank: Bank,
    t: float,
    phi: float,
    q: Array,
    q_shifted: float,
    V: Array,
    e_y: Array,
    R_lateral: float,
    y: Array,
    use: int,
    ln_sigma: float,
    R_common: float,
    R_own: float,
    gate: float,
) -> None:
    """Advance every filter by one epoch and update L. All filters see the same noises.

    Parameters
    ----------
    q : (10,) float64
        Variance gained over the step.
    q_shifted : float
        Variance that the k of shifted pitots gain together: what breaks several pitots at once
        (ice, a leak in the common line) moves them alike. A changed wind goes on changing as fast
        along the nose: what a scale may follow of a drifting airspeed the wind may follow too.
    See :func:`estimators.air_data_3d.pitot_update` for the others.
    """
    predict(bank.x, bank.P, phi, q)
    null = lateral_update(bank.x, bank.P, V, e_y, R_lateral, gate)
    null += pitot_update(bank.x, bank.P, V, y, use, ln_sigma, R_common, R_own, gate)
    d = np.empty(2)
    for i in range(2):
        d[i] = V[i] - bank.x[i]
    room = bank.room
    lanes = room.e.size
    for h in range(N_HYPOTHESES):
        if not _runs(bank, h):
            continue
        x, P = bank.hx[h], bank.hP[h]
        predict_lanes(x, P, phi, q)
        if h == WIND_CHANGED:
            for i in range(2):
                for j in range(i, 2):
                    for g in range(lanes):
                        P[i, j, g] += q_shifted * d[i] * d[j]
        for i in range(N_PITOTS):
            for j in range(i, N_PITOTS):
                if (h >> i) & (h >> j) & 1:
                    for g in range(lanes):
                        P[_SCALE0 + i, _SCALE0 + j, g] += q_shifted
        lateral_lanes(room, x, P, V, e_y, R_lateral, gate)
        for g in range(lanes):
            room.lateral[g] = room.ln[g]
        pitot_lanes(room, x, P, V, y, use, ln_sigma, R_common, R_own, gate)
        for g in range(N_GENERATIONS):
            if bank.L[g, h] == -np.inf:
                continue
            bank.L[g, h] += room.lateral[g] + room.ln[g] - null
            if t - bank.born[g] <= EARLY_S:
                for i in range(N_PITOTS):
                    bank.early[g, h, i] = x[_SCALE0 + i, g]


@kernel
def _possible(bank: Bank, bounds: WindBounds, g: int, h: int, change_m_s: float) -> bool:
    """Whether the wind of an explanation, and its change since the start, are within bounds."""
    x, y = bank.hx[h, 0, g], bank.hx[h, 1, g]
    if x**2 + y**2 > bounds.horizontal_m_s**2 or abs(bank.hx[h, 2, g]) > bounds.vertical_m_s:
        return False
    change2 = (x - bank.ref_wind[g, 0]) ** 2 + (y - bank.ref_wind[g, 1]) ** 2
    return bool(change2 <= change_m_s**2)


@kernel
def survey(bank: Bank, bounds: WindBounds, t: float, top: Array, where: NDArray[np.int64]) -> None:
    """Best generation of every explanation; one whose wind is out of bounds does not compete.

    Parameters
    ----------
    t : float [s]
        Now.
    top : (8,) float64 [nat]
        Receives ``max(L[:, h])``, -inf where none competes.
    where : (8,) int64
        Receives its generation, -1 where none competes.
    """
    top[:] = -np.inf
    where[:] = -1
    for g in range(N_GENERATIONS):
        if np.isnan(bank.born[g]):
            continue
        change = bounds.change_m_s * math.sqrt(max((t - bank.born[g]) / bounds.base_s, 1.0))
        for h in range(N_HYPOTHESES):
            if bank.L[g, h] > top[h] and _possible(bank, bounds, g, h, change):
                top[h], where[h] = bank.L[g, h], g


@kernel
def evidence(top: Array, mask: int) -> float:
    """Evidence that every pitot of ``mask`` shifted [nat].

    What the best explanation that holds all of them for shifted has over the best one, the master
    included, that leaves any of them out.
    """
    having, lacking = -np.inf, 0.0
    for h in range(N_HYPOTHESES):
        if h & mask == mask:
            having = max(having, top[h])
        else:
            lacking = max(lacking, top[h])
    return having - lacking


@kernel
def wind_evidence(top: Array) -> float:
    """Evidence that the wind changed, over every pitot's shift [nat]."""
    best = 0.0
    for h in range(1, N_HYPOTHESES):
        best = max(best, top[h])
    return float(top[WIND_CHANGED] - best)


@kernel
def parsimony(top: Array, mask: int) -> float:
    """What blaming more pitots than those of ``mask`` would gain at most [nat]."""
    more = -np.inf
    for h in range(N_HYPOTHESES):
        if h != mask and h & mask == mask:
            more = max(more, top[h])
    return float(more - top[mask])


@kernel
def before_onset(bank: Bank, onset: float, h: int) -> int:
    """Generation of the best explanation h among those born before the onset; -1 without one."""
    best, top = -1, -np.inf
    for g in range(N_GENERATIONS):
        if bank.born[g] <= onset and bank.L[g, h] > top:
            best, top = g, bank.L[g, h]
    return best


@kernel
def changed_wind(bank: Bank) -> int:
    """Generation whose changed wind explains the flight best; -1 where none beats the master."""
    best, top = -1, 0.0
    for g in range(N_GENERATIONS):
        if bank.L[g, WIND_CHANGED] > top:
            best, top = g, bank.L[g, WIND_CHANGED]
    return best


@kernel
def accept_wind(bank: Bank, g: int) -> None:
    """Make the changed wind of a generation the master.

    It only moves the zero of L: the other explanations go on competing with their old starts.
    """
    _make_master(bank, g, WIND_CHANGED)
    lead = bank.L[g, WIND_CHANGED]
    for i in range(N_GENERATIONS):
        for j in range(N_HYPOTHESES):
            bank.L[i, j] -= lead


@kernel
def adopt(bank: Bank, g: int, h: int) -> None:
    """Make the shift of the pitots of mask h, as generation g explains it, the master.

    Their k return to what they were before the shift, for the day they recover, and every
    generation is dropped: the competition is over.
    """
    _make_master(bank, g, h)
    for i in range(N_PITOTS):
        if (h >> i) & 1:
            k = _SCALE0 + i
            for j in range(NX):
                bank.P[k, j] = 0.0
                bank.P[j, k] = 0.0
            bank.x[k] = bank.ref[g, i]
            bank.P[k, k] = bank.ref_var[g, i]
    clear(bank)
