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
believed before the aircraft's energy has spoken (:mod:`estimators.engine_power`): the log odds begin
with the channels' prior fault probabilities, and that independent channels would have to fall to the
same wrong speed; they are settled beyond `margin`. Until then the channels are suspect.

Two more ways in which an engine gives no power need no engine speed: the aircraft loses energy like
a glider although the throttle is open; the throttle output stands idle while the autopilot, in an
autonomous mode, misses both height and airspeed.

Everything is decided at steps of the grid of :mod:`estimators.engine_ticks`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators import engine_power as power
from estimators.engine_power import PowerRules, evidence, forget, learn, mean_power
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

__all__ = [
    "BARE",
    "CAUSE_CUT",
    "CAUSE_DEAD",
    "CAUSE_DISAGREE",
    "CAUSE_FELL",
    "CAUSE_NONE",
    "CAUSE_NO_POWER",
    "CAUSE_STUCK",
    "CAUSE_UNDECIDED",
    "CAUSE_WRONG",
    "FAULTY",
    "G_NONE",
    "MODEL",
    "N_GROUPS",
    "N_LOG",
    "OK",
    "PEERS",
    "REASON_GROUND",
    "REASON_LEARNING",
    "REASON_MODEL",
    "REASON_NONE",
    "REASON_THROTTLE",
    "STOPPED",
    "SUSPECT",
    "UNMONITORED",
    "Groups",
    "JudgeRules",
    "Judged",
    "judge",
    "new_judged",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BARE, PEERS, MODEL = range(3)
N_GROUPS = N_SHAFTS + N_CHANNELS
"""The configured shafts, then each channel that is not configured as a shaft of its own."""
G_NONE = -1

UNSEEN, UNMONITORED, OK, SUSPECT, FAULTY, STOPPED = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
REASON_NONE, REASON_GROUND, REASON_LEARNING, REASON_THROTTLE, REASON_MODEL = (
    0.0, 1.0, 2.0, 3.0, 4.0)  # fmt: skip
(CAUSE_NONE, CAUSE_WRONG, CAUSE_STUCK, CAUSE_DEAD, CAUSE_DISAGREE, CAUSE_UNDECIDED, CAUSE_FELL,
 CAUSE_NO_POWER, CAUSE_CUT) = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)  # fmt: skip

FRESH_S = 2.0
OUTSIDE = 3.0
"""A reading is wrong only so many deviations outside its limits."""
FOLLOW_S = 0.5
"""A speed follows the throttle within this, for the tie."""
TIE_S = 60.0
USUAL_S = 20.0
TIE_LEARN_S = 20.0
TIE_THROTTLE_STD = 0.02
MOVED_S = 1.5
"""A reading must have changed so long after the throttle did."""
LOW_S = 1.0
"""Channels that are low for so long are waited on."""
BACK_S = 3.0
POWER_BACK_S = 10.0
STOP_GAIN = 0.5
"""An aircraft without power loses energy at more than this share of its glide."""
NO_SUCH_RPM = 2e5
APART_SHARE = 0.15
"""Of two channels without a model the one that jumps off the speed's course by more than this share
of the range is wrong; of a difference that grows nobody can say whose it is."""
FIRST_WRONGS = 5.0
TURNS_SHARE = 0.8
"""An engine that windmills shows less than this of what the throttle usually makes it show."""
USUAL_THROTTLE_SHARE = 0.5
"""A channel without a model is dead or stopped only while the throttle is above this share of its
mean."""

# Columns of the log.
(L_T, L_ENGINE, L_INDEX, L_STATUS, L_REASON, L_CAUSE, L_ONSET, L_STAT, L_LIMIT, L_SHOWN, L_EXPECT,
 L_SPREAD, L_SAME, L_THROTTLE, L_POWER, L_AGAIN) = range(16)  # fmt: skip
N_LOG = 16

# Scalars of a channel.
(STATUS, REASON, SHARE, T_LAST, WRONGS, ONSET, CLEAN, VALUE, SAME, T_LOW, T_HIGH, MOVED, USUAL,
 M_T, M_Y, V_T, V_Y, C_TY, TIME, B_MEAN, B_OFF, B_SQ, JUMP, WAS, LOW) = range(25)  # fmt: skip
N_SCALARS = 25
# Scalars of a group.
PENDING, ODDS, RUNNING_AGAIN, HALTED, ALL_LOW, TOLD = range(6)
# Scalars of all.
A_FLYING, E_STATUS, E_CAUSE, E_SINCE, LOSING, LOST, CUT, FOLLOWED, E_REASON = range(9)


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
    """All memory: of channels (16, 25), of groups (20, 6), of all (9,), of the power line (8,)."""

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
    s = np.zeros(9)
    s[[LOSING, CUT]] = np.nan
    m = np.zeros(power.N_POWER)
    m[[power.P_S2, power.P_S2G]] = power.FIRST_VARIANCE
    return Judged(c, g, s, m)


@kernel
def _say(
    log: Array, n: int, t: float, engine: float, index: int, status: float, reason: float,
    cause: float,
) -> int:  # fmt: skip
    row = log[n]
    row[:] = np.nan
    row[L_T], row[L_ENGINE], row[L_INDEX], row[L_STATUS] = t, engine, index, status
    row[L_REASON], row[L_CAUSE], row[L_AGAIN] = reason, cause, 0.0
    return n + 1


@kernel
def _set(c: Array, log: Array, n: int, t: float, index: int, status: float, reason: float) -> int:
    """Change a channel's state, if it is another one."""
    if c[STATUS] == status and c[REASON] == reason:
        return n
    again = 1.0 if c[STATUS] == FAULTY else 0.0
    c[STATUS], c[REASON] = status, reason
    n = _say(log, n, t, 0.0, index, status, reason, CAUSE_NONE)
    log[n - 1, L_AGAIN] = again
    return n


@kernel
def _blame(
    c: Array, log: Array, n: int, t: float, index: int, status: float, cause: float, onset: float,
    stat: float, limit: float, shown: float, expect: float, throttle: float,
) -> int:  # fmt: skip
    """A channel becomes suspect or faulty."""
    if c[STATUS] == status or c[STATUS] == FAULTY:
        return n
    c[STATUS], c[REASON], c[CLEAN] = status, REASON_NONE, np.nan
    n = _say(log, n, t, 0.0, index, status, REASON_NONE, cause)
    row = log[n - 1]
    row[L_ONSET], row[L_STAT], row[L_LIMIT], row[L_SHOWN] = onset, stat, limit, shown
    row[L_EXPECT], row[L_SAME], row[L_THROTTLE] = expect, t - c[SAME], throttle
    row[L_SPREAD] = math.sqrt(max(c[B_SQ] - c[B_OFF] * c[B_OFF], 0.0))
    return n


@kernel
def _resting(c: Array, kind: int, throttle: float) -> tuple[float, float]:
    """State and reason of a channel with which nothing is wrong, in flight."""
    if math.isnan(throttle):
        return UNMONITORED, REASON_THROTTLE
    if kind == BARE:
        return UNMONITORED, REASON_MODEL
    return OK, REASON_NONE


@kernel
def _tied(c: Array, r: JudgeRules) -> bool:
    """Whether the reading was seen to follow the throttle in this flight."""
    if c[TIME] < TIE_LEARN_S or c[V_T] < TIE_THROTTLE_STD**2 or c[V_Y] <= 0.0:
        return False
    return bool(c[C_TY] > 0.0 and c[C_TY] * c[C_TY] > r.tied_share * c[V_T] * c[V_Y])


@kernel
def _turns(c: Array, throttle: float) -> bool:
    """Whether the reading is one of an engine that does what this throttle usually makes it do."""
    line = c[M_Y] + c[C_TY] / max(c[V_T], TIE_THROTTLE_STD**2) * (throttle - c[M_T])
    return bool(c[VALUE] > TURNS_SHARE * line)


@kernel
def _expected(c: Array, kind: int, mu: float) -> float:
    """What a channel should show now, as far as it is known [rpm]."""
    return mu if kind != BARE else c[USUAL]


@kernel
def _reading(
    c: Array, r: JudgeRules, kind: int, t: float, y: float, w: float, least: float, most: float,
    mu: float, sd: float, top: float, throttle: float,
) -> None:  # fmt: skip
    """Use a channel's reading in flight: wrong or not, low or not, same or not."""
    y = max(y, 0.0)
    since = t - c[T_LAST]
    dt = min(since, FRESH_S) if since >= 0.0 else r.tick_s
    if y != c[VALUE] or math.isnan(c[SAME]):
        c[SAME], c[T_LOW], c[T_HIGH], c[MOVED] = t, np.inf, -np.inf, np.nan
    c[VALUE], c[T_LAST] = y, t
    if math.isnan(throttle):
        c[LOW] = np.nan
        return
    c[T_LOW], c[T_HIGH] = min(c[T_LOW], throttle), max(c[T_HIGH], throttle)
    if math.isnan(c[MOVED]) and c[T_HIGH] - c[T_LOW] > r.moved_share:
        c[MOVED] = t
    if math.isnan(c[USUAL]):
        c[USUAL] = y
    if kind == MODEL:
        low = y < least - max(4.0 * sd, r.low_share * top) and not w >= 0.5
    else:
        low = y < r.dead_share * c[USUAL] and throttle > USUAL_THROTTLE_SHARE * c[M_T]
        low = low and _tied(c, r)
    if math.isnan(c[LOW]):
        if low:
            c[LOW] = t
    elif not low and y >= r.dead_share * c[USUAL]:
        c[LOW] = np.nan  # what idles lower than that for a moment does not recover
    wrong = y > top or (w < 0.5 and (y < least - OUTSIDE * sd or y > most + OUTSIDE * sd))
    step = 1.0 - math.exp(-dt / r.wrong_s)
    c[SHARE] += step * ((1.0 if wrong else 0.0) - c[SHARE])
    if wrong:
        if c[WRONGS] == 0.0:
            c[ONSET], c[B_MEAN], c[B_OFF], c[B_SQ], c[JUMP] = t, 0.0, 0.0, 0.0, 0.0
        c[WRONGS] += 1.0
        off = y - _expected(c, kind, mu)
        if c[WRONGS] <= FIRST_WRONGS:
            c[JUMP] = max(c[JUMP], abs(off))
        c[B_MEAN] += (y - c[B_MEAN]) / c[WRONGS]
        c[B_OFF] += (off - c[B_OFF]) / c[WRONGS]
        c[B_SQ] += (off * off - c[B_SQ]) / c[WRONGS]
        c[CLEAN] = np.nan
    else:
        if math.isnan(c[CLEAN]):
            c[CLEAN] = t
        if c[SHARE] < 0.1 * r.wrong_share:
            c[WRONGS] = 0.0
    c[WAS] = 1.0 if wrong else 0.0
    if low or wrong or t - c[SAME] > 1.0 or c[STATUS] == FAULTY:
        return
    c[USUAL] += min(dt / USUAL_S, 1.0) * (y - c[USUAL])
    if c[TIME] == 0.0:
        c[M_T], c[M_Y] = throttle, y
    c[TIME] += dt
    share = max(dt / TIE_S, dt / c[TIME])
    e_t, e_y = throttle - c[M_T], y - c[M_Y]
    c[M_T] += share * e_t
    c[M_Y] += share * e_y
    keep = 1.0 - share
    c[V_T] = keep * (c[V_T] + share * e_t * e_t)
    c[V_Y] = keep * (c[V_Y] + share * e_y * e_y)
    c[C_TY] = keep * (c[C_TY] + share * e_t * e_y)


@kernel
def _peers(j: Judged, k: Groups, i: int, t: float) -> tuple[int, int, float]:
    """Another channel of the same shaft, how many there are, and their largest share."""
    peer, peers, share = i, 0, 0.0
    for other in range(N_CHANNELS):
        c = j.c[other]
        if other == i or k.of[other] != k.of[i] or c[STATUS] == UNSEEN or c[STATUS] == FAULTY:
            continue
        if t - c[T_LAST] <= FRESH_S:
            peer, peers, share = other, peers + 1, max(share, c[SHARE])
    return peer, peers, share


@kernel
def _channel(
    j: Judged, r: JudgeRules, k: Groups, i: int, t: float, mu: float, throttle: float, now: bool,
    log: Array, n: int,
) -> int:  # fmt: skip
    """Blame or clear one channel of a shaft that turns; `now`: it has just read something."""
    c, group = j.c[i], k.of[i]
    kind = k.kind[group]
    expect = _expected(c, kind, mu)
    stuck = t - c[SAME] >= r.stuck_s and t - c[MOVED] >= MOVED_S and math.isnan(c[LOW])
    stuck = stuck and (kind == MODEL or _tied(c, r)) and c[VALUE] > r.dead_share * c[USUAL]
    if c[STATUS] == FAULTY:
        fits = c[WAS] < 0.5 and math.isnan(c[LOW]) and not stuck
        if kind != MODEL and c[VALUE] < r.dead_share * c[USUAL]:
            fits = False
        if not fits:
            c[CLEAN] = np.nan
        elif math.isnan(c[CLEAN]):
            c[CLEAN] = t
        if t - c[CLEAN] >= r.readmit_s and t - c[SAME] < r.stuck_s:
            c[SHARE] = c[WRONGS] = 0.0
            n = _set(c, log, n, t, i, OK, REASON_NONE)
        return n
    if stuck:
        return _blame(c, log, n, t, i, FAULTY, CAUSE_STUCK, c[SAME], t - c[SAME], r.stuck_s,
                      c[VALUE], expect, throttle)  # fmt: skip
    if now and c[SHARE] > r.wrong_share and c[WRONGS] >= r.least_wrong:
        if j.g[group, ALL_LOW] > 0.5:
            return n
        peer, peers, _ = _peers(j, k, i, t)
        if kind == PEERS and peers == 1 and c[JUMP] < APART_SHARE * k.range[i]:
            n = _blame(c, log, n, t, i, SUSPECT, CAUSE_DISAGREE, c[ONSET], c[SHARE],
                       r.wrong_share, c[VALUE], expect, throttle)  # fmt: skip
            return _blame(j.c[peer], log, n, t, peer, SUSPECT, CAUSE_DISAGREE, c[ONSET], c[SHARE],
                          r.wrong_share, j.c[peer, VALUE], expect, throttle)  # fmt: skip
        return _blame(c, log, n, t, i, FAULTY, CAUSE_WRONG, c[ONSET], c[SHARE], r.wrong_share,
                      c[B_MEAN], c[B_MEAN] - c[B_OFF], throttle)  # fmt: skip
    status, reason = _resting(c, kind, throttle)
    calm = math.isnan(c[LOW]) and c[SHARE] < 0.5 * r.wrong_share
    if kind == PEERS and calm:
        calm = _peers(j, k, i, t)[2] < 0.5 * r.wrong_share
    if c[STATUS] != SUSPECT or calm:
        n = _set(c, log, n, t, i, status, reason)
    return n


@kernel
def _stop(
    j: Judged, k: Groups, t: float, engine: int, cause: float, onset: float, stat: float,
    limit: float, throttle: float, climb: float, log: Array, n: int,
) -> int:  # fmt: skip
    """An engine has stopped."""
    if engine == 0:
        j.s[E_STATUS], j.s[E_CAUSE], j.s[E_SINCE] = STOPPED, cause, t
    n = _say(log, n, t, 1.0, engine, STOPPED, REASON_NONE, cause)
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
    n = _say(log, n, t, 1.0, engine, OK, REASON_NONE, CAUSE_NONE)
    log[n - 1, L_AGAIN] = 1.0
    return n


@kernel
def _group(
    j: Judged, r: JudgeRules, k: Groups, group: int, t: float, x: Array, mu: Array, log: Array,
    n: int,
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
    for i in range(N_CHANNELS):
        c = j.c[i]
        if k.of[i] != group or math.isnan(c[LOW]) or c[STATUS] == FAULTY:
            continue
        expect = _expected(c, k.kind[group], mu[i])
        if not settled:
            n = _blame(c, log, n, t, i, SUSPECT, CAUSE_UNDECIDED, g[PENDING], abs(g[ODDS]),
                       r.decide_margin, c[VALUE], expect, throttle)  # fmt: skip
        elif g[ODDS] < 0.0:
            n = _blame(c, log, n, t, i, FAULTY, CAUSE_DEAD, g[PENDING], -g[ODDS], r.decide_margin,
                       c[VALUE], expect, throttle)  # fmt: skip
    if settled and g[ODDS] > 0.0:
        g[HALTED], g[RUNNING_AGAIN] = 1.0, np.nan
        if not (engine == 0 and j.s[E_STATUS] == STOPPED):
            n = _stop(j, k, t, engine, CAUSE_FELL, g[PENDING], g[ODDS], r.decide_margin, throttle,
                      climb, log, n)  # fmt: skip
        for i in range(N_CHANNELS):
            if k.of[i] == group and j.c[i, STATUS] == SUSPECT:
                status, reason = _resting(j.c[i], k.kind[group], throttle)
                n = _set(j.c[i], log, n, t, i, status, reason)
    return n


@kernel
def _without_speed(
    j: Judged, r: JudgeRules, t: float, x: Array, turning: bool, log: Array, n: int, k: Groups
) -> int:
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
            status, reason = _resting(c, k.kind[k.of[i]], throttle)
            n = _set(c, log, n, t, i, status, reason)
        else:
            n = _set(c, log, n, t, i, UNMONITORED, REASON_GROUND)
    for group in range(N_GROUPS):
        j.g[group, PENDING], j.g[group, HALTED] = np.nan, 0.0
    if s[E_STATUS] != UNSEEN:
        s[E_STATUS], s[E_REASON] = UNMONITORED, REASON_LEARNING if flying else REASON_GROUND
        n = _say(log, n, t, 1.0, 0, UNMONITORED, s[E_REASON], CAUSE_NONE)
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
    most: Array, mu: Array, sd: Array, halted: Array, log: Array,
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
        Receives what the channels of a configured shaft show while its engine has stopped; else NaN.
    log : (6 K + 64, 16) float64
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
            n = _say(log, n, t, 1.0, 0, UNMONITORED, j.s[E_REASON], CAUSE_NONE)
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
                    status, reason = _resting(c, k.kind[group], throttle)
                n = _set(c, log, n, t, i, status, reason)
            if flying:
                own = x[X_THROTTLE + k.throttle[group]]
                followed = j.s[FOLLOWED] if k.throttle[group] == 0 else own
                top = k.range[i] if k.kind[group] != BARE else NO_SUCH_RPM
                _reading(c, r, k.kind[group], t, y[step, i], w[step, i], least[step, i],
                         most[step, i], mu[step, i], sd[step, i], top,
                         np.nan if math.isnan(own) else followed)  # fmt: skip
        for shaft in range(N_SHAFTS):
            halted[step, shaft] = _halted_speed(j, k, shaft)
        if not flying:
            continue
        for group in range(N_GROUPS):
            used = False
            for i in range(N_CHANNELS):
                if k.of[i] == group and j.c[i, STATUS] != UNSEEN:
                    used = True
            if not used:
                continue
            n = _group(j, r, k, group, t, x, mu[step], log, n)
            own = x[X_THROTTLE + k.throttle[group]]
            for i in range(N_CHANNELS):
                c = j.c[i]
                if k.of[i] != group or c[STATUS] == UNSEEN or math.isnan(c[T_LAST]):
                    continue
                waits = j.g[group, HALTED] > 0.5
                if not waits:
                    now = not math.isnan(y[step, i])
                    n = _channel(j, r, k, i, t, mu[step, i], own, now, log, n)
                good = c[STATUS] != FAULTY and t - c[T_LAST] <= FRESH_S
                told = k.kind[group] == MODEL or _tied(c, r)
                if good and told and math.isnan(c[LOW]) and _turns(c, j.s[FOLLOWED]):
                    turning = True
                if not math.isnan(c[LOW]) and c[STATUS] != FAULTY:
                    doubtful = True
        known = j.power[power.P_KNOWN_S] >= power.LEARN_S
        sound = j.s[E_STATUS] != STOPPED and not (doubtful and known) and math.isnan(j.s[CUT])
        if sound and not math.isnan(x[X_P]) and (turning or math.isnan(j.s[LOSING])):
            learn(j.power, r.power, x[X_AIRSPEED], x[X_THROTTLE_T], x[X_P], x[X_PG])
        n = _without_speed(j, r, t, x, turning, log, n, k)
        if j.s[E_STATUS] == UNMONITORED and known:
            j.s[E_STATUS] = OK
            n = _say(log, n, t, 1.0, 0, OK, REASON_NONE, CAUSE_NONE)
    return n
