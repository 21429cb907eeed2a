"""What the engine watch keeps in mind and what it says: memory, limits, columns of the log.

Symbols and rules stand in :mod:`estimators.engine_judge`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators import engine_power as power
from estimators.engine_power import PowerRules
from estimators.engine_ticks import N_CHANNELS, N_SHAFTS
from estimators.jit import kernel

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BARE, PEERS, MODEL = range(3)
N_GROUPS = N_SHAFTS + N_CHANNELS
"""The configured shafts, then each channel that is not configured as a shaft of its own."""

UNSEEN, UNMONITORED, OK, SUSPECT, FAULTY, STOPPED = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
REASON_NONE, REASON_GROUND, REASON_LEARNING, REASON_THROTTLE, REASON_MODEL = (
    0.0, 1.0, 2.0, 3.0, 4.0)  # fmt: skip
(CAUSE_NONE, CAUSE_WRONG, CAUSE_STUCK, CAUSE_DEAD, CAUSE_DISAGREE, CAUSE_UNDECIDED, CAUSE_FELL,
 CAUSE_NO_POWER, CAUSE_CUT) = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)  # fmt: skip

FRESH_S = 2.0

# Columns of the log.
(L_T, L_ENGINE, L_INDEX, L_STATUS, L_REASON, L_CAUSE, L_ONSET, L_STAT, L_LIMIT, L_SHOWN, L_EXPECT,
 L_SPREAD, L_SAME, L_THROTTLE, L_POWER, L_AGAIN) = range(16)  # fmt: skip
N_LOG = 16
MOST_SAID = 8 * N_CHANNELS + 2 * N_GROUPS
"""Rows that one step can say at most: a channel is seen, changed by the flight's phase and twice by
its shaft, and judged twice; an engine stops and runs; with room to spare."""

# Scalars of a channel.
(STATUS, REASON, SHARE, T_LAST, WRONGS, ONSET, CLEAN, VALUE, SAME, T_LOW, T_HIGH, MOVED, USUAL,
 M_T, M_Y, V_T, V_Y, C_TY, TIME, B_MEAN, B_OFF, B_SQ, JUMP, WAS, LOW) = range(25)  # fmt: skip
N_SCALARS = 25
# Scalars of a group.
PENDING, ODDS, RUNNING_AGAIN, HALTED, ALL_LOW, TOLD = range(6)
# Scalars of all.
A_FLYING, E_STATUS, E_CAUSE, E_SINCE, LOSING, CUT, FOLLOWED, E_REASON = range(8)


class JudgeRules(NamedTuple):
    """Limits; the settings of the same names say what each rests on."""

    tick_s: float
    wrong_share: float
    wrong_s: float
    least_wrong: float
    readmit_s: float
    stuck_s: float
    moved_share: float
    tied_share: float
    dead_share: float
    low_share: float
    decide_margin: float
    decide_information: float
    stop_probability: float
    no_power_s: float
    no_power_throttle: float
    cut_s: float
    power: PowerRules


class Groups(NamedTuple):
    """What belongs together.

    Attributes
    ----------
    of, engine : (16,) (20,) int64
        Group of each channel; number of the engine that each group's shaft belongs to.
    kind : (20,) int64
        BARE, PEERS or MODEL.
    throttle : (20,) int64
        Which shaft's throttle drives it.
    range, noise, fault : (16,) float64 [rpm], [rpm], [1]
        Of the configured channels.
    """

    of: Ints
    engine: Ints
    kind: Ints
    throttle: Ints
    range: Array
    noise: Array
    fault: Array


class Judged(NamedTuple):
    """All memory: of channels (16, 25), of groups (20, 6), of all (8,), of the power line (8,)."""

    c: Array
    g: Array
    s: Array
    power: Array


def new_judged() -> Judged:
    """Nothing seen, on the ground."""
    c = np.zeros((N_CHANNELS, N_SCALARS))
    c[:, [T_LAST, ONSET, CLEAN, SAME, MOVED, USUAL, LOW]] = np.nan
    g = np.zeros((N_GROUPS, 6))
    g[:, [PENDING, RUNNING_AGAIN]] = np.nan
    s = np.zeros(8)
    s[[LOSING, CUT]] = np.nan
    m = np.zeros(power.N_POWER)
    m[[power.P_S2, power.P_S2G]] = power.FIRST_VARIANCE
    return Judged(c, g, s, m)


@kernel
def say(
    log: Array, n: int, t: float, engine: float, index: int, status: float, reason: float,
    cause: float,
) -> int:  # fmt: skip
    row = log[n]
    row[:] = np.nan
    row[L_T], row[L_ENGINE], row[L_INDEX], row[L_STATUS] = t, engine, index, status
    row[L_REASON], row[L_CAUSE], row[L_AGAIN] = reason, cause, 0.0
    return n + 1


@kernel
def set_state(
    c: Array, log: Array, n: int, t: float, index: int, status: float, reason: float
) -> int:
    """Change a channel's state, if it is another one."""
    if c[STATUS] == status and c[REASON] == reason:
        return n
    again = 1.0 if c[STATUS] == FAULTY else 0.0
    c[STATUS], c[REASON] = status, reason
    n = say(log, n, t, 0.0, index, status, reason, CAUSE_NONE)
    log[n - 1, L_AGAIN] = again
    return n


@kernel
def blame(
    c: Array, log: Array, n: int, t: float, index: int, status: float, cause: float, onset: float,
    stat: float, limit: float, shown: float, expect: float, throttle: float,
) -> int:  # fmt: skip
    """A channel becomes suspect or faulty."""
    if c[STATUS] == status or c[STATUS] == FAULTY:
        return n
    c[STATUS], c[REASON], c[CLEAN] = status, REASON_NONE, np.nan
    n = say(log, n, t, 0.0, index, status, REASON_NONE, cause)
    row = log[n - 1]
    row[L_ONSET], row[L_STAT], row[L_LIMIT], row[L_SHOWN] = onset, stat, limit, shown
    row[L_EXPECT], row[L_SAME], row[L_THROTTLE] = expect, t - c[SAME], throttle
    row[L_SPREAD] = math.sqrt(max(c[B_SQ] - c[B_OFF] * c[B_OFF], 0.0))
    return n


@kernel
def resting(c: Array, kind: int, throttle: float) -> tuple[float, float]:
    """State and reason of a channel with which nothing is wrong, in flight."""
    if math.isnan(throttle):
        return UNMONITORED, REASON_THROTTLE
    if kind == BARE:
        return UNMONITORED, REASON_MODEL
    return OK, REASON_NONE
