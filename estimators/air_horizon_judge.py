"""From the explanations of the long horizon to a verdict, and back to before the drift.

Whenever ``solve_every`` stages have been gathered, all explanations are solved on the same data:
nothing happened, the wind changed, or the pitots of a mask drift. The evidence against a pitot is
counted as the filter bank counts it (:func:`estimators.air_data_3d_bank.evidence`): what the best
explanation with it has over the best one without it. A verdict takes evidence beyond the margin and
a shift beyond ``min_shift`` for ``confirm_s``, hence in two solves running; on all pitots together
also a turn since half of the drift.

A changed wind that beats everything else by its margin is believed: the stages of that
change keep the faster walk, under every explanation.

The decision stands apart from the stream of epochs: the stream stops where stages wait,
:func:`take`, :func:`estimators.air_horizon_solve.solve_explanations` and :func:`conclude` follow,
and the stream goes on. (Within the stream's kernel they would all be compiled once more.)
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import CHECK_HORIZON
from estimators.air_data_3d import N_PITOTS, NX, SCALE
from estimators.air_data_3d_bank import (
    N_HYPOTHESES,
    WIND_CHANGED,
    Bank,
    clear,
    evidence,
    parsimony,
)
from estimators.air_data_3d_judge import (
    FAULTY,
    J_ROWS,
    S_EXPECT,
    S_RESIDUAL,
    S_SHOWN,
    S_STATUS,
    Judge,
    JudgeLimits,
    accuse_together,
)
from estimators.air_horizon import (
    CHANGED_S,
    H_HELD,
    H_HELD_SINCE,
    H_STAGES,
    H_WIND_SINCE,
    N_EXPLANATIONS,
    NH,
    NOTHING,
    SCALE_H,
    WIND_WALKED,
    HorizonLevels,
    LongHorizon,
    push_stage,
    start_horizon,
)
from estimators.air_horizon_stage import (
    G_ACTIVE,
    G_COUNT,
    G_FRESH,
    G_RUNS,
    G_T,
    Z_DT,
    Z_EY,
    Z_T,
    Z_USE,
    Z_WALK2,
    Gathering,
)
from estimators.air_tests import LONG, hold, short_of
from estimators.jit import kernel

__all__ = ["conclude", "take", "turned", "weigh"]

Array = NDArray[np.float64]
_K, _SCALE0 = SCALE_H.start, SCALE.start

MIN_STAGES = 8
"""Fewer stages than this say nothing about a drift."""
TURNED_RAD = math.radians(45.0)
TURNED_SHARE = 0.5
"""All pitots are blamed together only if the nose has pointed so far elsewhere since the drift had
come to this share of its size. On a straight a drifting scale and a wind that rises along the nose
look alike, and gusts, which turn the nose and push the aircraft aside at once, tell less of the
airspeed than they seem to."""
ONSET_SHARE = 0.1
"""A drift is dated from where it had come to this share of its present size."""


@kernel
def take(gathering: Gathering, z: LongHorizon, levels: HorizonLevels, judge: Judge) -> int:
    """Take the stages that wait into the horizon; return the explanations to solve, as a bit mask.

    Bit h stands for explanation h of :mod:`estimators.air_horizon`: of pitots, those under
    judgement that the newest stages have seen. 0: there is nothing to decide yet.
    """
    found = gathering.memory
    if found[G_FRESH] > 0.5:
        start_horizon(z, gathering.x, gathering.P)
        found[G_FRESH] = 0.0
    for i in range(int(found[G_COUNT])):
        push_stage(z, levels, gathering.closed[i])
    found[G_COUNT] = 0.0
    active, n = int(found[G_ACTIVE]), int(z.memory[H_STAGES])
    for i in range(N_PITOTS):
        if (active >> i) & 1 and judge.sensor[i, S_STATUS] == FAULTY:
            return 0  # accused since: the next epoch starts anew
    for h in range(N_EXPLANATIONS):
        z.L[h] = -np.inf
    if active == 0 or n < MIN_STAGES:
        return 0
    seen = 0
    for i in range(n - MIN_STAGES // 2, n):
        seen |= int(z.stages[i, Z_USE])
    wanted = 1 << NOTHING
    for h in range(WIND_WALKED, N_EXPLANATIONS):
        wanted |= 1 << h
    for h in range(1, N_HYPOTHESES):
        if (h & active & seen) == h:
            wanted |= 1 << h
    return wanted


@kernel
def _shift(z: LongHorizon, h: int, i: int) -> float:
    """How far pitot i has moved since the horizon's start under explanation h [1]."""
    n = int(z.memory[H_STAGES])
    return float(z.x[h, n - 1, _K + i] - z.x[h, 0, _K + i])


@kernel
def _best_wind(z: LongHorizon) -> int:
    """The explanation by a changed wind that fits best."""
    best = WIND_WALKED
    for h in range(WIND_WALKED, N_EXPLANATIONS):
        if z.L[h] > z.L[best]:
            best = h
    return best


@kernel
def weigh(z: LongHorizon, levels: HorizonLevels, active: int, top: Array) -> int:
    """Smallest set of pitots whose drift is proved; 0 when none is.

    ``top`` (8,) receives each mask's log-likelihood over nothing having happened, and the changed
    wind's in the place of mask 0.
    """
    top[WIND_CHANGED] = z.L[_best_wind(z)] - z.L[NOTHING]
    for h in range(1, N_HYPOTHESES):
        top[h] = z.L[h] - z.L[NOTHING]
    for size in range(1, N_PITOTS + 1):
        for h in range(1, N_HYPOTHESES):
            bits = (h & 1) + ((h >> 1) & 1) + ((h >> 2) & 1)
            if bits != size or top[h] == -np.inf:
                continue
            margin = levels.margin_all if h == active else levels.margin_one
            if not evidence(top, h) > margin or parsimony(top, h) > 0.5 * levels.margin_one:
                continue
            shifted = True
            for i in range(N_PITOTS):
                if not (h >> i) & 1:
                    continue
                large = abs(_shift(z, h, i)) > levels.min_shift
                half_s = _reached(z, h, i, TURNED_SHARE)
                shifted &= large and (h != active or turned(z, half_s))
            if shifted:
                return h
    return 0


@kernel
def hold_drifts(
    z: LongHorizon, levels: HorizonLevels, active: int, top: Array, tests: Array
) -> None:
    """Hold the evidence of a drift of each pitot, over what a verdict takes; it stands till then.

    Parameters as of :func:`weigh`, after it; ``tests`` (7,) of :mod:`estimators.air_tests`.
    """
    for i in range(N_PITOTS):
        tests[LONG + i] = 0.0 if (active >> i) & 1 else np.nan
    for h in range(1, N_HYPOTHESES):
        if top[h] == -np.inf or parsimony(top, h) > 0.5 * levels.margin_one:
            continue
        margin = levels.margin_all if h == active else levels.margin_one
        rest = np.inf
        for i in range(N_PITOTS):
            if (h >> i) & 1:
                rest = min(rest, abs(_shift(z, h, i)) / levels.min_shift)
                if h == active and not turned(z, _reached(z, h, i, TURNED_SHARE)):
                    rest = 0.0
        for i in range(N_PITOTS):
            if (h >> i) & 1:
                hold(tests, LONG + i, short_of(evidence(top, h) / margin, rest))


@kernel
def _believe_wind(z: LongHorizon, levels: HorizonLevels) -> None:
    """The wind has changed: let it walk as fast as that for that long, in every explanation."""
    n = int(z.memory[H_STAGES])
    since = z.stages[n - 1, Z_T] - CHANGED_S[_best_wind(z) - WIND_WALKED]
    for i in range(n):
        if z.stages[i, Z_T] > since:
            z.stages[i, Z_WALK2] += levels.wind_walk_changed**2 * z.stages[i, Z_DT]


@kernel
def _reached(z: LongHorizon, h: int, i: int, share: float) -> float:
    """When the drift of pitot i reached a share of its present size under explanation h [s]."""
    n = int(z.memory[H_STAGES])
    small = share * abs(_shift(z, h, i))
    for j in range(n - 1, -1, -1):
        if abs(z.x[h, j, _K + i] - z.x[h, 0, _K + i]) < small:
            return float(z.stages[j, Z_T])
    return float(z.stages[0, Z_T])


@kernel
def turned(z: LongHorizon, since: float) -> bool:
    """Whether the heading has differed by :data:`TURNED_RAD` from the present one since then."""
    n = int(z.memory[H_STAGES])
    now = z.stages[n - 1]
    for j in range(n - 1, -1, -1):
        s = z.stages[j]
        if s[Z_T] < since:
            return False
        across = s[Z_EY] * now[Z_EY] + s[Z_EY + 1] * now[Z_EY + 1]
        lengths = math.hypot(s[Z_EY], s[Z_EY + 1]) * math.hypot(now[Z_EY], now[Z_EY + 1])
        if across < math.cos(TURNED_RAD) * lengths:
            return True
    return False


@kernel
def _roll_back(z: LongHorizon, bank: Bank, h: int) -> None:
    """Make explanation h the bank's master: its wind now, the drifting scales as they were.

    The bank's vertical gust is kept, uncorrelated with the rest.
    """
    n = int(z.memory[H_STAGES])
    x, P = bank.x, bank.P
    for j in range(NX):
        P[5, j] = P[j, 5] = P[5, 5] if j == 5 else 0.0
    for i in range(NH - 1):
        a = i if i < _K else i + 1
        x[a] = z.x[h, n - 1, i]
        for j in range(NH - 1):
            P[a, j if j < _K else j + 1] = z.end_P[h, i, j]
    for i in range(N_PITOTS):
        if (h >> i) & 1:
            k = _SCALE0 + i
            for j in range(NX):
                P[k, j] = P[j, k] = 0.0
            x[k] = z.x[h, 0, _K + i]
            P[k, k] = z.P[_K + i, _K + i]
    clear(bank)


@kernel
def _convict(
    z: LongHorizon,
    levels: HorizonLevels,
    bank: Bank,
    judge: Judge,
    limits: JudgeLimits,
    log: Array,
    t: float,
    h: int,
    active: int,
    top: Array,
) -> None:
    """The pitots of mask h are faulty, and the bank's master goes back to what the horizon says."""
    margin = levels.margin_all if h == active else levels.margin_one
    for i in range(N_PITOTS):
        if (h >> i) & 1:
            s = judge.sensor[i]
            s[S_EXPECT] = s[S_SHOWN] * math.exp(_shift(z, h, i))
            onset = _reached(z, h, i, ONSET_SHARE)
            stat = evidence(top, 1 << i)
            now = z.x[h, int(z.memory[H_STAGES]) - 1, _K + i]
            error = s[S_RESIDUAL] + now - bank.x[_SCALE0 + i]
            accuse_together(
                judge, limits, log, t, i, h, error, 1.0, CHECK_HORIZON, onset, stat, margin
            )
    _roll_back(z, bank, h)


@kernel
def conclude(
    gathering: Gathering,
    z: LongHorizon,
    levels: HorizonLevels,
    bank: Bank,
    judge: Judge,
    limits: JudgeLimits,
    log: Array,
    tests: Array,
) -> int:
    """Decide after all explanations have been solved; return rows written to ``log``.

    Parameters
    ----------
    log : (n, 13) float64
        See :mod:`estimators.air_data_3d_judge`.
    tests : (7,) float64
        See :mod:`estimators.air_tests`.
    """
    judge.memory[J_ROWS] = 0.0
    memory, t = z.memory, gathering.memory[G_T]
    active = int(gathering.memory[G_ACTIVE])
    top = np.empty(N_HYPOTHESES)
    h = weigh(z, levels, active, top)
    hold_drifts(z, levels, active, top, tests)
    if h == 0 or h != int(memory[H_HELD]):
        memory[H_HELD], memory[H_HELD_SINCE] = float(h), t
    elif t - memory[H_HELD_SINCE] >= levels.confirm_s:
        _convict(z, levels, bank, judge, limits, log, t, h, active, top)
        gathering.memory[G_RUNS] = 0.0
        return int(judge.memory[J_ROWS])
    best = 0.0
    for m in range(1, N_HYPOTHESES):
        best = max(best, top[m])
    if not top[WIND_CHANGED] - best > levels.margin_wind:
        memory[H_WIND_SINCE] = np.nan
    elif np.isnan(memory[H_WIND_SINCE]):
        memory[H_WIND_SINCE] = t
    elif t - memory[H_WIND_SINCE] >= levels.confirm_s:
        _believe_wind(z, levels)
        memory[H_WIND_SINCE] = np.nan
    return 0
