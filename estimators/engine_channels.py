"""One engine-speed channel: its readings, whether it follows the throttle, what is said of it.

Symbols and rules stand in :mod:`estimators.engine_judge`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.engine_state import (
    ALL_LOW,
    B_MEAN,
    B_OFF,
    B_SQ,
    BARE,
    C_TY,
    CAUSE_DISAGREE,
    CAUSE_STUCK,
    CAUSE_WRONG,
    CLEAN,
    FAULTY,
    FRESH_S,
    JUMP,
    LOW,
    M_T,
    M_Y,
    MODEL,
    MOVED,
    OK,
    ONSET,
    PEERS,
    REASON_NONE,
    SAME,
    SHARE,
    STATUS,
    SUSPECT,
    T_HIGH,
    T_LAST,
    T_LOW,
    TIME,
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
    set_state,
)
from estimators.engine_ticks import N_CHANNELS
from estimators.jit import kernel

__all__ = [
    "NO_SUCH_RPM",
    "channel_ratio",
    "expected",
    "judge_channel",
    "tied",
    "turns",
    "use_reading",
]

Array = NDArray[np.float64]

OUTSIDE = 3.0
"""A reading is wrong only so many deviations outside its limits."""
TIE_S = 60.0
USUAL_S = 20.0
TIE_LEARN_S = 20.0
TIE_THROTTLE_STD = 0.02
MOVED_S = 1.5
"""A reading must have changed so long after the throttle did."""
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


@kernel
def tied(c: Array, r: JudgeRules) -> bool:
    """Whether the reading was seen to follow the throttle in this flight."""
    if c[TIME] < TIE_LEARN_S or c[V_T] < TIE_THROTTLE_STD**2 or c[V_Y] <= 0.0:
        return False
    return bool(c[C_TY] > 0.0 and c[C_TY] * c[C_TY] > r.tied_share * c[V_T] * c[V_Y])


@kernel
def turns(c: Array, throttle: float) -> bool:
    """Whether the reading is one of an engine that does what this throttle usually makes it do."""
    line = c[M_Y] + c[C_TY] / max(c[V_T], TIE_THROTTLE_STD**2) * (throttle - c[M_T])
    return bool(c[VALUE] > TURNS_SHARE * line)


@kernel
def expected(c: Array, kind: int, mu: float) -> float:
    """What a channel should show now, as far as it is known [rpm]."""
    return mu if kind != BARE else c[USUAL]


@kernel
def use_reading(
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
        low = low and tied(c, r)
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
        off = y - expected(c, kind, mu)
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
def _stands_still(j: Judged, r: JudgeRules, k: Groups, i: int, t: float) -> bool:
    """Whether standing still would count: the throttle moved, and the reading used to follow."""
    c = j.c[i]
    moved = t - c[MOVED] >= MOVED_S and math.isnan(c[LOW])
    follows = k.kind[k.of[i]] == MODEL or tied(c, r)
    return bool(moved and follows and c[VALUE] > r.dead_share * c[USUAL])


@kernel
def channel_ratio(j: Judged, r: JudgeRules, k: Groups, i: int, t: float) -> float:
    """How near a channel is to a verdict: the largest statistic over its threshold.

    Of a faulty one, its share of wrong readings over the threshold, at least 1 while the present
    one does not fit. NaN of one that no model, peer or throttle speaks for.
    """
    c = j.c[i]
    share = c[SHARE] / r.wrong_share
    if c[STATUS] == FAULTY:
        return float(max(share, 1.0) if math.isnan(c[CLEAN]) else share)
    if k.kind[k.of[i]] == BARE and not tied(c, r):
        return np.nan
    enough = c[WRONGS] / max(r.least_wrong, 1.0)
    share = share if enough >= 1.0 else min(share, enough)
    still = (t - c[SAME]) / r.stuck_s if _stands_still(j, r, k, i, t) else 0.0
    return float(max(share, still))


@kernel
def judge_channel(
    j: Judged, r: JudgeRules, k: Groups, i: int, t: float, mu: float, throttle: float, now: bool,
    log: Array, n: int,
) -> int:  # fmt: skip
    """Blame or clear one channel of a shaft that turns; `now`: it has just read something."""
    c, group = j.c[i], k.of[i]
    kind = k.kind[group]
    expect = expected(c, kind, mu)
    stuck = t - c[SAME] >= r.stuck_s and _stands_still(j, r, k, i, t)
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
            n = set_state(c, log, n, t, i, OK, REASON_NONE)
        return n
    if stuck:
        return blame(c, log, n, t, i, FAULTY, CAUSE_STUCK, c[SAME], t - c[SAME], r.stuck_s,
                      c[VALUE], expect, throttle)  # fmt: skip
    if now and c[SHARE] > r.wrong_share and c[WRONGS] >= r.least_wrong:
        if j.g[group, ALL_LOW] > 0.5:
            return n
        peer, peers, _ = _peers(j, k, i, t)
        if kind == PEERS and peers == 1 and c[JUMP] < APART_SHARE * k.range[i]:
            n = blame(c, log, n, t, i, SUSPECT, CAUSE_DISAGREE, c[ONSET], c[SHARE],
                       r.wrong_share, c[VALUE], expect, throttle)  # fmt: skip
            return blame(j.c[peer], log, n, t, peer, SUSPECT, CAUSE_DISAGREE, c[ONSET], c[SHARE],
                          r.wrong_share, j.c[peer, VALUE], expect, throttle)  # fmt: skip
        return blame(c, log, n, t, i, FAULTY, CAUSE_WRONG, c[ONSET], c[SHARE], r.wrong_share,
                      c[B_MEAN], c[B_MEAN] - c[B_OFF], throttle)  # fmt: skip
    status, reason = resting(c, kind, throttle)
    calm = math.isnan(c[LOW]) and c[SHARE] < 0.5 * r.wrong_share
    if kind == PEERS and calm:
        calm = _peers(j, k, i, t)[2] < 0.5 * r.wrong_share
    if c[STATUS] != SUSPECT or calm:
        n = set_state(c, log, n, t, i, status, reason)
    return n
