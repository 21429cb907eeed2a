"""From the bank's evidence and the fast checks to the state of each pitot, without toggling.

A pitot is *unmonitored* until its scale is learnt, then *ok*; *suspect* while the evidence is half
of what a verdict takes; *faulty* when evidence and size have held for a time. A faulty pitot takes
no part in the filters and is re-admitted after it has agreed with them again, as well as it did
before the fault, for a time that doubles with each re-admission.

Changes of state go into a log, one row each:

=================  ============================================================================
column             meaning
=================  ============================================================================
G_T, G_SENSOR      when [s], which pitot
G_STATUS, G_REASON codes of this module
G_CHECK            which check decided (codes of :mod:`estimators.air_checks`)
G_ONSET            estimated start of the fault [s]
G_SHOWN, G_EXPECT  equivalent airspeed shown, and what it would be without the fault (NaN before
                   the pitot was ever learnt) [m/s]
G_STAT, G_LIMIT    test statistic and its threshold
G_DRIFT            1: the error grew slowly, 0: it came at once
G_AGREE            bit mask of other pitots that agree with the filters
G_TOGETHER         bit mask of the pitots accused by the same verdict
=================  ============================================================================
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import CHECK_BANK, CHECK_NONE
from estimators.air_data_3d import N_PITOTS, SCALE
from estimators.air_data_3d_bank import (
    WIND_CHANGED,
    Bank,
    accept_wind,
    adopt,
    before_onset,
    clear,
    evidence,
    survey,
    wind_evidence,
)
from estimators.air_data_3d_evidence import (
    JudgeLimits,
    convicted,
    disagreement,
    hold_evidence,
    margin_of,
)  # fmt: skip
from estimators.air_tests import hold_return
from estimators.jit import kernel

__all__ = [
    "ABSENT",
    "FAULTY",
    "LEARNING",
    "LEARNT",
    "NO_REASON",
    "N_LOG",
    "OK",
    "ON_GROUND",
    "REFERENCE_MISSING",
    "REFERENCE_NOT_TRUSTED",
    "SENSORS_DISAGREE",
    "SUSPECT",
    "UNKNOWN",
    "UNMONITORED",
    "WIND_NOT_OBSERVABLE",
    "Judge",
    "JudgeLimits",
    "accuse_by_check",
    "accuse_together",
    "judge_epoch",
    "new_judge",
    "set_status",
    "unmonitor",
]

Array = NDArray[np.float64]
_SCALE0 = SCALE.start

# Codes are floats: they live in float arrays, and every integer constant passed to a kernel would
# compile it anew.
UNKNOWN, UNMONITORED, OK, SUSPECT, FAULTY, ABSENT = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
NO_REASON, ON_GROUND, LEARNING = 0.0, 1.0, 2.0
WIND_NOT_OBSERVABLE, REFERENCE_MISSING, REFERENCE_NOT_TRUSTED = 3.0, 4.0, 5.0
SENSORS_DISAGREE = 6.0

# Columns of the log.
(
    G_T,
    G_SENSOR,
    G_STATUS,
    G_REASON,
    G_CHECK,
    G_ONSET,
    G_SHOWN,
    G_EXPECT,
    G_STAT,
    G_LIMIT,
    G_DRIFT,
    G_AGREE,
    G_TOGETHER,
) = range(13)
N_LOG = 13

# Columns of a pitot's state: shown and expected equivalent airspeed at the last epoch, the residual
# ln(shown / expected) there and its running mean, and since when what holds.
(
    S_STATUS,
    S_REASON,
    S_LEARNT,
    S_CHECK,
    S_SHOWN,
    S_EXPECT,
    S_RESIDUAL,
    S_MEAN_RESIDUAL,
    S_AGREES_SINCE,
    S_READMISSIONS,
    S_SUSPECT_SINCE,
    S_SUSPECT_UNTIL,
) = range(12)
N_SENSOR = 12

# What the judge remembers besides: the explanation that holds and since when, rows in the log.
J_HELD_MASK, J_HELD_SINCE, J_WIND_SINCE, J_ROWS = range(4)

NEVER_LEARNT, LEARNT, LOST = 0.0, 1.0, 2.0

DRIFT_AGE_S = 12.0
"""A fault younger than this is not called a drift."""
RECOVERY_TAU_S = 1.5
"""Averaging time of the residual that decides on re-admission."""


class Judge(NamedTuple):
    """Memory of the decisions; arrays are changed in place.

    Attributes
    ----------
    sensor : (3, 12) float64
    memory : (4,) float64
    """

    sensor: Array
    memory: Array


def new_judge() -> Judge:
    """Nothing known of any pitot."""
    sensor = np.zeros((N_PITOTS, N_SENSOR))
    sensor[:, [S_SHOWN, S_EXPECT, S_RESIDUAL, S_AGREES_SINCE, S_SUSPECT_SINCE]] = np.nan
    return Judge(sensor, np.array([0.0, np.nan, np.nan, 0.0]))


@kernel
def set_status(
    judge: Judge,
    log: Array,
    t: float,
    i: int,
    status: float,
    reason: float,
    check: float,
    onset: float,
    stat: float,
    limit: float,
) -> int:
    """Log a pitot's change of state; return the log's row, -1 when nothing changed."""
    s = judge.sensor[i]
    if s[S_STATUS] == status and s[S_REASON] == reason:
        return -1
    s[S_STATUS], s[S_REASON] = status, reason
    row = int(judge.memory[J_ROWS])
    judge.memory[J_ROWS] += 1.0
    g = log[row]
    g[G_T], g[G_SENSOR], g[G_STATUS], g[G_REASON] = t, i, status, reason
    g[G_CHECK], g[G_ONSET] = check, onset
    g[G_SHOWN] = s[S_SHOWN]
    g[G_EXPECT] = s[S_EXPECT] if s[S_LEARNT] > NEVER_LEARNT else np.nan
    g[G_STAT], g[G_LIMIT] = stat, limit
    g[G_DRIFT] = 0.0
    g[G_AGREE] = 0.0
    g[G_TOGETHER] = 1 << i
    return row


@kernel
def _agreeing(judge: Judge, limits: JudgeLimits, but: int, error: float) -> int:
    """Bit mask of the judged pitots outside ``but`` that show what the filters expect.

    Parameters
    ----------
    error : float [1]
        ln of what an explanation expects over what the master does.
    """
    mask = 0
    for i in range(N_PITOTS):
        s = judge.sensor[i]
        judged = s[S_STATUS] == OK or s[S_STATUS] == SUSPECT
        if judged and not (but >> i) & 1 and abs(s[S_RESIDUAL] - error) < limits.min_shift:
            mask |= 1 << i
    return mask


@kernel
def _accuse(
    judge: Judge,
    log: Array,
    t: float,
    i: int,
    together: int,
    agree: int,
    drift: float,
    check: float,
    onset: float,
    stat: float,
    limit: float,
) -> None:
    """Pitot i is faulty: log it, and begin to wait for its recovery."""
    s = judge.sensor[i]
    row = set_status(judge, log, t, i, FAULTY, NO_REASON, check, onset, stat, limit)
    if row >= 0:
        log[row, G_AGREE], log[row, G_TOGETHER] = agree, together
        log[row, G_DRIFT] = drift
    s[S_CHECK] = check
    s[S_MEAN_RESIDUAL] = s[S_RESIDUAL] if not np.isnan(s[S_RESIDUAL]) else 1.0
    s[S_AGREES_SINCE], s[S_SUSPECT_SINCE] = np.nan, np.nan


@kernel
def accuse_by_check(
    judge: Judge,
    limits: JudgeLimits,
    bank: Bank,
    log: Array,
    t: float,
    i: int,
    check: float,
    onset: float,
    stat: float,
    limit: float,
) -> None:
    """A fast check has failed: pitot i is faulty; the filters go back to before the onset.

    The best explanation that began before the onset and lets pitot i alone shift becomes master.
    """
    g = before_onset(bank, onset, 1 << i)
    if g >= 0:
        adopt(bank, g, 1 << i)
    clear(bank)
    agree = _agreeing(judge, limits, 1 << i, 0.0)
    _accuse(judge, log, t, i, 1 << i, agree, 0.0, check, onset, stat, limit)


@kernel
def accuse_together(
    judge: Judge,
    limits: JudgeLimits,
    log: Array,
    t: float,
    i: int,
    together: int,
    error: float,
    drift: float,
    check: float,
    onset: float,
    stat: float,
    limit: float,
) -> None:
    """Pitot i, one of the mask ``together``, is faulty; the filters are the caller's to mend.

    What it should show is in its state already; ``error`` is that of the master's ln n.
    """
    agree = _agreeing(judge, limits, together, error)
    _accuse(judge, log, t, i, together, agree, drift, check, onset, stat, limit)


@kernel
def _accuse_by_bank(
    judge: Judge,
    limits: JudgeLimits,
    bank: Bank,
    log: Array,
    t: float,
    g: int,
    h: int,
    top: Array,
    active: int,
    known: int,
) -> None:
    """Explanation h of generation g has won: its pitots are faulty and it is the master now."""
    margin = margin_of(limits, h, active, known)
    error = 0.0
    for i in range(N_PITOTS):
        if (h >> i) & 1:
            k = _SCALE0 + i
            error = judge.sensor[i, S_RESIDUAL] + bank.hx[h, k, g] - bank.x[k]
    agree = _agreeing(judge, limits, h, error)
    age = t - bank.born[g]
    for i in range(N_PITOTS):
        if (h >> i) & 1:
            shift = bank.hx[h, _SCALE0 + i, g] - bank.ref[g, i]
            early = bank.early[g, h, i] - bank.ref[g, i]
            s = judge.sensor[i]
            s[S_EXPECT] = s[S_SHOWN] * math.exp(shift)
            drift = 1.0 if age > DRIFT_AGE_S and abs(early) < 0.5 * abs(shift) else 0.0
            _accuse(
                judge,
                log,
                t,
                i,
                h,
                agree,
                drift,
                CHECK_BANK,
                bank.born[g],
                evidence(top, 1 << i),
                margin,
            )
    adopt(bank, g, h)


@kernel
def _learn(s: Array, limits: JudgeLimits, std: float) -> None:
    """Whether a pitot's scale is known well enough, with hysteresis."""
    if std < limits.learnt_scale_std:
        s[S_LEARNT] = LEARNT
    elif s[S_LEARNT] == LEARNT and std > limits.lost_scale_std:
        s[S_LEARNT] = LOST


@kernel
def _tolerance(s: Array, limits: JudgeLimits) -> float:
    return limits.readmit_shift if s[S_LEARNT] > NEVER_LEARNT else limits.readmit_unlearnt


@kernel
def _recover(
    judge: Judge,
    limits: JudgeLimits,
    log: Array,
    t: float,
    dt: float,
    i: int,
    n_std: float,
    quiet: bool,
) -> bool:
    """Watch a faulty pitot; True when it has agreed for long enough and is judged again."""
    s = judge.sensor[i]
    e = s[S_RESIDUAL]
    if np.isnan(e):
        s[S_AGREES_SINCE] = np.nan
        return False
    tolerance = _tolerance(s, limits)
    s[S_MEAN_RESIDUAL] += min(dt / RECOVERY_TAU_S, 1.0) * (
        min(max(e, -1.0), 1.0) - s[S_MEAN_RESIDUAL]
    )
    near = abs(s[S_MEAN_RESIDUAL]) < tolerance and abs(e) < 3.0 * tolerance
    if not (near and quiet and n_std < limits.lost_scale_std):
        s[S_AGREES_SINCE] = np.nan
        return False
    if np.isnan(s[S_AGREES_SINCE]):
        s[S_AGREES_SINCE] = t
    wait = limits.readmit_s * 2.0 ** min(s[S_READMISSIONS], 5.0)
    if t - s[S_AGREES_SINCE] < wait:
        return False
    s[S_READMISSIONS] += 1.0
    s[S_AGREES_SINCE] = np.nan
    status = OK if s[S_LEARNT] == LEARNT else UNMONITORED
    reason = NO_REASON if s[S_LEARNT] == LEARNT else LEARNING
    set_status(judge, log, t, i, status, reason, s[S_CHECK], np.nan, s[S_MEAN_RESIDUAL], tolerance)
    return True


@kernel
def _watch_suspicion(
    judge: Judge,
    limits: JudgeLimits,
    log: Array,
    t: float,
    i: int,
    grounds: bool,
    stat: float,
    reason: float,
) -> None:
    """Between ok and suspect: half a verdict's evidence for a while, and a while without it."""
    s = judge.sensor[i]
    if grounds:
        if np.isnan(s[S_SUSPECT_SINCE]):
            s[S_SUSPECT_SINCE] = t
        s[S_SUSPECT_UNTIL] = t + limits.suspect_clear_s
    else:
        s[S_SUSPECT_SINCE] = np.nan
    if s[S_STATUS] == OK and t - s[S_SUSPECT_SINCE] >= 0.5 * limits.confirm_s:
        set_status(judge, log, t, i, SUSPECT, reason, CHECK_BANK, np.nan, stat, limits.margin_one)
    elif s[S_STATUS] == SUSPECT and t > s[S_SUSPECT_UNTIL]:
        set_status(judge, log, t, i, OK, NO_REASON, CHECK_NONE, np.nan, stat, limits.margin_one)


@kernel
def unmonitor(judge: Judge, log: Array, t: float, known: int, reason: float) -> None:
    """No pitot can be judged now; a verdict of faulty stands."""
    for i in range(N_PITOTS):
        if (known >> i) & 1 and judge.sensor[i, S_STATUS] != FAULTY:
            set_status(judge, log, t, i, UNMONITORED, reason, CHECK_NONE, np.nan, np.nan, np.nan)
        judge.sensor[i, S_AGREES_SINCE] = np.nan
    judge.memory[J_HELD_MASK] = 0.0
    judge.memory[J_WIND_SINCE] = np.nan


@kernel
def judge_epoch(
    judge: Judge,
    limits: JudgeLimits,
    bank: Bank,
    log: Array,
    t: float,
    dt: float,
    active: int,
    known: int,
    n_std: float,
    quiet: int,
    long_enough: bool,
    gust: float,
    top: Array,
    where: NDArray[np.int64],
    tests: Array,
) -> bool:
    """Decide after an epoch; return whether the set of judged pitots has changed.

    Parameters
    ----------
    active, known : int
        Bit masks: learnt pitots that took part in the epoch, pitots that exist.
    n_std : float [1]
        Standard deviation of ln n.
    quiet : int
        Bit mask of pitots that neither stand still nor scatter.
    long_enough : bool
        The aircraft has flown long enough to have learnt anything.
    gust : float [1]
        Gust intensity as a share of the airspeed.
    top : (8,) float64, where : (8,) int64 and tests : (7,) float64
        Work space for the evidence, and what :mod:`estimators.air_tests` keeps.
    """
    memory, changed, faulty = judge.memory, False, 0
    for i in range(N_PITOTS):
        faulty |= (1 << i) if judge.sensor[i, S_STATUS] == FAULTY else 0
    survey(bank, limits.wind, t, top, where)
    h = convicted(t, limits, bank, top, where, active, known, gust)
    hold_evidence(tests, t, limits, bank, top, where, active, known, gust)
    if h == 0 or h != memory[J_HELD_MASK]:
        memory[J_HELD_MASK], memory[J_HELD_SINCE] = float(h), t
    elif t - memory[J_HELD_SINCE] >= limits.confirm_s:
        _accuse_by_bank(judge, limits, bank, log, t, where[h], h, top, active, known)
        memory[J_HELD_MASK] = 0.0
        changed = True
    if not wind_evidence(top) > limits.margin_wind:
        memory[J_WIND_SINCE] = np.nan
    elif math.isnan(memory[J_WIND_SINCE]):
        memory[J_WIND_SINCE] = t
    elif not changed and t - memory[J_WIND_SINCE] >= limits.confirm_s:
        accept_wind(bank, where[WIND_CHANGED])
        memory[J_WIND_SINCE] = np.nan
    apart = disagreement(top, active)
    for i in range(N_PITOTS):
        if not (known >> i) & 1:
            continue
        s = judge.sensor[i]
        if s[S_STATUS] == FAULTY:
            still = bool((quiet >> i) & 1)
            if _recover(judge, limits, log, t, dt, i, n_std, still):
                changed = True
            if (faulty >> i) & 1:  # of one that has just been blamed, what blamed it counts
                hold_return(tests, i, s[S_MEAN_RESIDUAL], s[S_RESIDUAL], _tolerance(s, limits),
                            still and n_std < limits.lost_scale_std)  # fmt: skip
            continue
        if long_enough:
            _learn(s, limits, math.sqrt(bank.P[_SCALE0 + i, _SCALE0 + i]))
        if s[S_LEARNT] == LEARNT:
            if s[S_STATUS] != SUSPECT:
                set_status(judge, log, t, i, OK, NO_REASON, CHECK_NONE, np.nan, np.nan, np.nan)
            if not changed:
                stat, half = (
                    evidence(top, 1 << i),
                    0.5 * margin_of(limits, 1 << i, active, known),
                )
                if (active >> i) & 1 and apart > limits.margin_one:
                    _watch_suspicion(judge, limits, log, t, i, True, apart, SENSORS_DISAGREE)
                else:
                    _watch_suspicion(judge, limits, log, t, i, stat > half, stat, NO_REASON)
        else:
            reason = LEARNING if s[S_LEARNT] == NEVER_LEARNT else WIND_NOT_OBSERVABLE
            set_status(judge, log, t, i, UNMONITORED, reason, CHECK_NONE, np.nan, np.nan, np.nan)
    return changed
