"""From engine speeds, what a model expects of them, and the aircraft's power, to verdicts.

A *group* is a shaft: the channels that measure one speed. Its kind says what is known of it.

==========  ================================================================================
kind        what is asked of its channels
==========  ================================================================================
BARE        one channel without a model: whether it is dead or stuck, once it was seen to
            follow the throttle (a lift motor or a constant-speed propeller does not)
PEERS       several channels without a model: also whether they contradict each other
MODEL       a model of throttle and airspeed: whether each reading fits
==========  ================================================================================

=========  =========================================================================  ======
symbol     meaning                                                                    unit
=========  =========================================================================  ======
w          probability that a reading is right, of the intermittent-measurement       1
           filter; it is wrong when w < 1/2 and it is outside what the model
           gave in the last moments, or when it is beyond its range
share      of wrong readings over `wrong_s`                                           1
usual      mean reading of a channel while it works                                   rpm
tie        share of a reading's variance that the throttle explains                   1
low        reads far below the model, or below `dead_share` of the usual              bool
=========  =========================================================================  ======

When all channels of a shaft are low at once, either they failed or the engine stopped. Neither is
believed before the aircraft's energy has spoken (:mod:`estimators.engine_power`): the log odds
begin with the channels' prior fault probabilities, and that independent channels would have to fall
to the same wrong speed; they are settled beyond `margin`. Until then the channels are suspect.

Two more ways in which an engine gives no power need no engine speed: the aircraft loses energy like
a glider although the throttle is open; the throttle output stands idle while the autopilot, in an
autonomous mode, misses both height and airspeed.

Everything is decided at steps of the grid of :mod:`estimators.engine_ticks`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators import engine_power as power
from estimators.engine_channels import (
    NO_SUCH_RPM,
    channel_ratio,
    expected,
    judge_channel,
    tied,
    turns,
    use_reading,
)
from estimators.engine_power import evidence, forget, learn, mean_power
from estimators.engine_state import (
    A_FLYING,
    ALL_LOW,
    BARE,
    C_TY,
    CAUSE_CUT,
    CAUSE_DEAD,
    CAUSE_FELL,
    CAUSE_NO_POWER,
    CAUSE_NONE,
    CAUSE_UNDECIDED,
    CLEAN,
    CUT,
    E_CAUSE,
    E_REASON,
    E_SINCE,
    E_STATUS,
    FAULTY,
    FOLLOWED,
    FRESH_S,
    HALTED,
    L_AGAIN,
    L_LIMIT,
    L_ONSET,
    L_POWER,
    L_STAT,
    L_THROTTLE,
    LOSING,
    LOW,
    M_T,
    M_Y,
    MODEL,
    MOVED,
    N_GROUPS,
    ODDS,
    OK,
    PENDING,
    REASON_GROUND,
    REASON_LEARNING,
    REASON_NONE,
    RUNNING_AGAIN,
    SAME,
    SHARE,
    STATUS,
    STOPPED,
    SUSPECT,
    T_LAST,
    TIME,
    TOLD,
    UNMONITORED,
    UNSEEN,
    USUAL,
    V_T,
    V_Y,
    VALUE,
    WAS,
    WRONGS,
    Groups,
    Judged,
    JudgeRules,
    blame,
    resting,
    say,
    set_state,
)
from estimators.engine_ticks import (
    N_CHANNELS,
    N_SHAFTS,
    X_AIRSPEED,
    X_FLYING,
    X_IDLE,
    X_MISSES,
    X_P,
    X_PG,
    X_T,
    X_THROTTLE,
    X_THROTTLE_T,
)
from estimators.jit import kernel

__all__ = ["N_ENGINES", "judge"]

Array = NDArray[np.float64]

FOLLOW_S = 0.5
"""A speed follows the throttle within this, for the tie."""
N_ENGINES = 4
"""Engines whose ratios are told; each is one of the configured shafts'."""
LOW_S = 1.0
"""Channels that are low for so long are waited on."""
BACK_S = 3.0
POWER_BACK_S = 10.0
STOP_GAIN = 0.5
"""An aircraft without power loses energy at more than this share of its glide."""


@kernel
def _stop(
    j: Judged, k: Groups, t: float, engine: int, cause: float, onset: float, stat: float,
    limit: float, throttle: float, climb: float, log: Array, n: int,
) -> int:  # fmt: skip
    """An engine has stopped."""
    if engine == 0:
        j.s[E_STATUS], j.s[E_CAUSE], j.s[E_SINCE] = STOPPED, cause, t
    n = say(log, n, t, 1.0, engine, STOPPED, REASON_NONE, cause)
    row = log[n - 1]
    row[L_ONSET], row[L_STAT], row[L_LIMIT] = onset, stat, limit
    row[L_THROTTLE], row[L_POWER] = throttle, climb
    return n


@kernel
def _runs(j: Judged, t: float, engine: int, log: Array, n: int) -> int:
    """An engine gives power again."""
    if engine == 0:
        j.s[E_STATUS], j.s[E_CAUSE] = OK, CAUSE_NONE
        j.s[LOSING] = j.s[CUT] = np.nan
    n = say(log, n, t, 1.0, engine, OK, REASON_NONE, CAUSE_NONE)
    log[n - 1, L_AGAIN] = 1.0
    return n


@kernel
def _odds_ratio(r: JudgeRules, g: Array) -> float:
    """Odds that an engine stopped over those that decide; no more than what was told of them."""
    odds, told = g[ODDS] / r.decide_margin, g[TOLD] / r.decide_information
    return float(odds if told >= 1.0 else min(max(odds, -told), told))


@kernel
def _group(
    j: Judged, r: JudgeRules, k: Groups, group: int, t: float, x: Array, mu: Array, log: Array,
    n: int, ratio: Array,
) -> int:  # fmt: skip
    """Whether a shaft's channels fell together, and what that was."""
    g = j.g[group]
    since, good, odds = -np.inf, 0, math.log(r.stop_probability)
    low = True
    for i in range(N_CHANNELS):
        c = j.c[i]
        if k.of[i] != group or c[STATUS] == UNSEEN or not t - c[T_LAST] <= FRESH_S:
            continue
        if c[STATUS] == FAULTY:
            continue
        if math.isnan(c[LOW]):
            low = False
        else:
            since = max(since, c[LOW])
        odds -= math.log(k.fault[i])
        if good > 0:  # another channel that fails would have to show the same by chance
            odds -= math.log(min(k.noise[i] / k.range[i], 1.0))
        good += 1
    low = low and good > 0
    g[ALL_LOW] = 1.0 if low else 0.0
    engine = k.engine[group]
    throttle = x[X_THROTTLE + k.throttle[group]]
    climb = mean_power(j.power, x[X_P], x[X_PG])[0]
    if g[HALTED] > 0.5:
        if low or good == 0:
            g[RUNNING_AGAIN] = np.nan
        elif math.isnan(g[RUNNING_AGAIN]):
            g[RUNNING_AGAIN] = t
        if t - g[RUNNING_AGAIN] >= BACK_S:
            g[HALTED], g[PENDING] = 0.0, np.nan
            n = _runs(j, t, engine, log, n)
        return n
    if not low:
        g[PENDING] = np.nan
        return n
    if math.isnan(g[PENDING]):
        if t - since < LOW_S:
            return n
        g[PENDING], g[ODDS], g[TOLD] = since, odds, 0.0
    tau = t - g[PENDING]
    says, could = evidence(j.power, r.power, x[X_THROTTLE_T], x[X_P], x[X_PG], tau)
    g[ODDS] += says
    g[TOLD] += could
    settled = abs(g[ODDS]) > r.decide_margin and g[TOLD] > r.decide_information
    near = _odds_ratio(r, g)
    if engine < N_ENGINES and not g[HALTED] > 0.5:
        ratio[N_CHANNELS + engine] = max(near, 0.0)
    for i in range(N_CHANNELS):
        c = j.c[i]
        if k.of[i] != group or math.isnan(c[LOW]) or c[STATUS] == FAULTY:
            continue
        expect = expected(c, k.kind[group], mu[i])
        ratio[i] = max(-near, 0.0)
        if not settled:
            n = blame(c, log, n, t, i, SUSPECT, CAUSE_UNDECIDED, g[PENDING], abs(g[ODDS]),
                       r.decide_margin, c[VALUE], expect, throttle)  # fmt: skip
        elif g[ODDS] < 0.0:
            n = blame(c, log, n, t, i, FAULTY, CAUSE_DEAD, g[PENDING], -g[ODDS], r.decide_margin,
                       c[VALUE], expect, throttle)  # fmt: skip
    if settled and g[ODDS] > 0.0:
        g[HALTED], g[RUNNING_AGAIN] = 1.0, np.nan
        if not (engine == 0 and j.s[E_STATUS] == STOPPED):
            n = _stop(j, k, t, engine, CAUSE_FELL, g[PENDING], g[ODDS], r.decide_margin, throttle,
                      climb, log, n)  # fmt: skip
        for i in range(N_CHANNELS):
            if k.of[i] == group and j.c[i, STATUS] == SUSPECT:
                status, reason = resting(j.c[i], k.kind[group], throttle)
                n = set_state(j.c[i], log, n, t, i, status, reason)
    return n


@kernel
def _without_speed(
    j: Judged, r: JudgeRules, t: float, x: Array, turning: bool, log: Array, n: int, k: Groups,
    ratio: Array,
) -> int:  # fmt: skip
    """Whether the first engine gives no power, as far as that shows without an engine speed."""
    s, m = j.s, j.power
    throttle, both = x[X_THROTTLE], np.nan
    glide = m[power.P_A]
    if not math.isnan(x[X_P]):
        both = mean_power(m, x[X_P], x[X_PG])[0]
    losing = x[X_P] < STOP_GAIN * glide and x[X_PG] < STOP_GAIN * glide and not turning
    losing = (
        losing and x[X_THROTTLE_T] >= r.no_power_throttle and m[power.P_KNOWN_S] >= power.LEARN_S
    )
    if not losing:
        s[LOSING] = np.nan
    elif math.isnan(s[LOSING]):
        s[LOSING] = t
    if not (x[X_IDLE] > 0.5 and x[X_MISSES] > 0.5):
        s[CUT] = np.nan
    elif math.isnan(s[CUT]):
        s[CUT] = t
    if s[E_STATUS] != STOPPED:
        for lasts in ((t - s[LOSING]) / r.no_power_s, (t - s[CUT]) / r.cut_s, 0.0):
            if s[E_STATUS] != UNSEEN and not ratio[N_CHANNELS] >= lasts and not math.isnan(lasts):
                ratio[N_CHANNELS] = lasts
        if t - s[LOSING] >= r.no_power_s:
            return _stop(j, k, t, 0, CAUSE_NO_POWER, s[LOSING], t - s[LOSING], r.no_power_s,
                         throttle, both, log, n)  # fmt: skip
        if t - s[CUT] >= r.cut_s:
            return _stop(j, k, t, 0, CAUSE_CUT, s[CUT], t - s[CUT], r.cut_s, throttle, both, log,
                         n)  # fmt: skip
        return n
    if s[E_CAUSE] == CAUSE_NO_POWER:
        gives = both > 0.5 * m[power.P_B] * x[X_THROTTLE_T] + glide
    elif s[E_CAUSE] == CAUSE_CUT:
        gives = x[X_IDLE] < 0.5
    else:
        return n
    if not gives:
        s[E_SINCE] = t
    if t - s[E_SINCE] >= (POWER_BACK_S if s[E_CAUSE] == CAUSE_NO_POWER else BACK_S):
        n = _runs(j, t, 0, log, n)
    return n


@kernel
def _phase(
    j: Judged, k: Groups, t: float, flying: bool, throttle: float, log: Array, n: int
) -> int:
    """The aircraft takes off, or stops flying."""
    s = j.s
    s[A_FLYING] = 1.0 if flying else 0.0
    s[LOSING] = s[CUT] = np.nan
    forget(j.power)
    for i in range(N_CHANNELS):
        c = j.c[i]
        c[SHARE] = c[WRONGS] = c[TIME] = c[WAS] = 0.0
        c[M_T] = c[M_Y] = c[V_T] = c[V_Y] = c[C_TY] = 0.0
        c[LOW] = c[CLEAN] = c[SAME] = c[MOVED] = c[USUAL] = c[T_LAST] = np.nan
        if c[STATUS] == UNSEEN:
            continue
        if flying:
            status, reason = resting(c, k.kind[k.of[i]], throttle)
            n = set_state(c, log, n, t, i, status, reason)
        else:
            n = set_state(c, log, n, t, i, UNMONITORED, REASON_GROUND)
    for engine in range(1, N_CHANNELS):
        stopped = False
        for group in range(N_GROUPS):
            if k.engine[group] == engine and j.g[group, HALTED] > 0.5:
                stopped = True
        if stopped:
            reason = REASON_LEARNING if flying else REASON_GROUND
            n = say(log, n, t, 1.0, engine, UNMONITORED, reason, CAUSE_NONE)
    for group in range(N_GROUPS):
        j.g[group, PENDING], j.g[group, HALTED] = np.nan, 0.0
    if s[E_STATUS] != UNSEEN:
        s[E_STATUS], s[E_REASON] = UNMONITORED, REASON_LEARNING if flying else REASON_GROUND
        n = say(log, n, t, 1.0, 0, UNMONITORED, s[E_REASON], CAUSE_NONE)
    return n


@kernel
def _halted_speed(j: Judged, k: Groups, shaft: int) -> float:
    """Mean reading of a stopped engine's channels [rpm]; NaN while it runs."""
    total, good = 0.0, 0
    for i in range(N_CHANNELS):
        c = j.c[i]
        if k.of[i] == shaft and c[STATUS] != UNSEEN and c[STATUS] != FAULTY:
            total, good = total + c[VALUE], good + 1
    return total / good if j.g[shaft, HALTED] > 0.5 and good > 0 else np.nan


@kernel
def judge(
    j: Judged, r: JudgeRules, k: Groups, table: Array, y: Array, w: Array, least: Array,
    most: Array, mu: Array, sd: Array, halted: Array, ratios: Array, log: Array,
) -> int:  # fmt: skip
    """Use closed steps; return how many rows of `log` were written.

    Parameters
    ----------
    table, y : (K, 12), (K, 16) float64
        Of :func:`estimators.engine_ticks.gather`.
    w, least, most, mu, sd : (K, 16) float64 [1], [rpm] ...
        Of the channels that a model or peers speak for, NaN for the others: probability that the
        reading is right; least and most that it may be, given that reading and throttle are not
        quite of one moment; mean, and standard deviation beside those limits.
    halted : (K, 4) float64 [rpm]
        Receives what the channels of a configured shaft show while its engine has stopped, else
        NaN.
    ratios : (K, 20) float64
        Receives how near each channel and engine is to a verdict: the largest statistic over its
        threshold, NaN where nothing was tested.
    log : (MOST_SAID K, 16) float64
        Columns L_*.
    """
    n = 0 * table.shape[0]
    for step in range(table.shape[0]):
        x = table[step]
        t, flying, throttle = x[X_T], x[X_FLYING] > 0.5, x[X_THROTTLE]
        if flying != (j.s[A_FLYING] > 0.5):
            n = _phase(j, k, t, flying, throttle, log, n)
        if j.s[E_STATUS] == UNSEEN and not math.isnan(throttle):
            j.s[E_STATUS], j.s[E_REASON] = UNMONITORED, REASON_LEARNING if flying else REASON_GROUND
            n = say(log, n, t, 1.0, 0, UNMONITORED, j.s[E_REASON], CAUSE_NONE)
        if not math.isnan(throttle):
            j.s[FOLLOWED] += min(r.tick_s / FOLLOW_S, 1.0) * (throttle - j.s[FOLLOWED])
        turning, doubtful = False, False
        for i in range(N_CHANNELS):
            c = j.c[i]
            if math.isnan(y[step, i]):
                continue
            group = k.of[i]
            if c[STATUS] == UNSEEN:
                if y[step, i] < 0.0:
                    continue
                status, reason = UNMONITORED, REASON_GROUND
                if flying:
                    status, reason = resting(c, k.kind[group], throttle)
                n = set_state(c, log, n, t, i, status, reason)
            if flying:
                own = x[X_THROTTLE + k.throttle[group]]
                followed = j.s[FOLLOWED] if k.throttle[group] == 0 else own
                top = k.range[i] if k.kind[group] != BARE else NO_SUCH_RPM
                use_reading(c, r, k.kind[group], t, y[step, i], w[step, i], least[step, i],
                         most[step, i], mu[step, i], sd[step, i], top,
                         np.nan if math.isnan(own) else followed)  # fmt: skip
        for shaft in range(N_SHAFTS):
            halted[step, shaft] = _halted_speed(j, k, shaft)
        ratio = ratios[step]
        ratio[:] = np.nan
        if not flying:
            continue
        for group in range(N_GROUPS):
            used = False
            for i in range(N_CHANNELS):
                if k.of[i] == group and j.c[i, STATUS] != UNSEEN:
                    used = True
            if not used:
                continue
            n = _group(j, r, k, group, t, x, mu[step], log, n, ratio)
            own = x[X_THROTTLE + k.throttle[group]]
            for i in range(N_CHANNELS):
                c = j.c[i]
                if k.of[i] != group or c[STATUS] == UNSEEN or math.isnan(c[T_LAST]):
                    continue
                waits = j.g[group, HALTED] > 0.5
                if not waits:
                    fresh = t - c[T_LAST] <= FRESH_S and not math.isnan(own)
                    if fresh and not ratio[i] >= 1.0:
                        near = channel_ratio(j, r, k, i, t)
                        ratio[i] = near if not ratio[i] >= near else ratio[i]
                    now = not math.isnan(y[step, i])
                    n = judge_channel(j, r, k, i, t, mu[step, i], own, now, log, n)
                good = c[STATUS] != FAULTY and t - c[T_LAST] <= FRESH_S
                told = k.kind[group] == MODEL or tied(c, r)
                if good and told and math.isnan(c[LOW]) and turns(c, j.s[FOLLOWED]):
                    turning = True
                if not math.isnan(c[LOW]) and c[STATUS] != FAULTY:
                    doubtful = True
        known = j.power[power.P_KNOWN_S] >= power.LEARN_S
        sound = j.s[E_STATUS] != STOPPED and not (doubtful and known) and math.isnan(j.s[CUT])
        if sound and not math.isnan(x[X_P]) and (turning or math.isnan(j.s[LOSING])):
            learn(j.power, r.power, x[X_AIRSPEED], x[X_THROTTLE_T], x[X_P], x[X_PG])
        n = _without_speed(j, r, t, x, turning, log, n, k, ratio)
        if j.s[E_STATUS] == UNMONITORED and known:
            j.s[E_STATUS] = OK
            n = say(log, n, t, 1.0, 0, OK, REASON_NONE, CAUSE_NONE)
    return int(n)
