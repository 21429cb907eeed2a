"""What a sensor's own readings say in a vote: that it jumped, or that it stands still.

=========  ======================================================================  ==========
symbol     meaning                                                                 unit
=========  ======================================================================  ==========
leap       mean over 0.3 s of (reading minus what the remembered wind predicts),   rad, m/s
           less the mean over the 0.3 s before
jump       the largest leap of a sensor in the last ten seconds, fading            rad, m/s
usual      rms of the leaps of the median while all agree: what the air does       rad, m/s
run        time for which a reading has not changed                                s
longest    the longest run of a sensor that was not yet a fault                    s
=========  ======================================================================  ==========

Two that fail together are the majority, and while the wind changes the memory of it cannot tell
the two from the third. But air is continuous: who jumped when the other did not is wrong. And two
that are stuck agree for ever: a reading that repeats itself longer than it ever did has no vote.

The ideas are those of :mod:`estimators.triplex` and :mod:`estimators.triplex_signs`; here a jump is
measured against the gusts of this flight, which reach a small aircraft as jumps of all its sensors.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_vote_record import LONG, STAGE_S, Votes, lower
from estimators.jit import kernel

__all__ = [
    "JUMPED",
    "NOBODY",
    "OTHERS",
    "believe_the_rest",
    "has_no_vote",
    "learn_usual",
    "note",
    "who_jumped",
]

Array = NDArray[np.float64]

NOBODY, JUMPED, OTHERS = range(3)

FORGET_S = 10.0
"""Time in which a jump is forgotten [s]: a fault is confirmed within two seconds."""
GUST_LEAPS = 5.0
"""A jump is this many times the usual leap: the largest of a thousand gusts is four times it."""
JUMP_SHARE = 0.5
"""And at least this share of the votes' threshold."""
CLEARLY = 2.0
"""Who jumped has jumped this many times as far as those who did not."""
REPEATS = 4.0
"""How many times longer than ever before a reading must repeat to lose its vote."""
RUN_S = 0.5
"""And at least so long [s]."""


@kernel
def leap_of(ring: Array, newest: int) -> float:
    """Mean of a ring's last three entries less that of the three before."""
    leap = 0.0
    for k in range(3):
        leap += (ring[(newest - k) % LONG] - ring[(newest - 3 - k) % LONG]) / 3.0
    return leap


@kernel
def note(z: Votes, ch: int, i: int, now: int, learning: bool) -> None:
    """Keep a sensor's largest jump and its longest run; ``ring_m`` must be that of this stage.

    Runs are learnt in flight only: on the ground a pitot may read zero for an hour.
    """
    z.jump[ch, i] *= 1.0 - STAGE_S / FORGET_S
    if z.counters[2] >= 6.0:
        z.jump[ch, i] = max(z.jump[ch, i], abs(leap_of(z.ring_m[ch, i], now)))
    run = z.run[ch, i]
    ended = z.same[ch, i] < run < z.counters[1] * STAGE_S
    if ended and (learning or run < max(RUN_S, REPEATS * z.longest[ch, i])):
        z.longest[ch, i] = max(z.longest[ch, i], run)
    z.run[ch, i] = z.same[ch, i]


@kernel
def learn_usual(z: Votes, ch: int, now: int) -> None:
    """Take a stage in which all agreed into the usual leap."""
    if z.counters[2] >= 6.0:
        leap = leap_of(z.ring_fused[ch], now)
        z.leap[ch] += (leap * leap - z.leap[ch]) / min(30.0 + z.counters[2], 300.0)


@kernel
def has_no_vote(z: Votes, ch: int, i: int) -> bool:
    """Whether a reading repeats itself as it never did while it was sound."""
    silent: bool = z.same[ch, i] >= max(RUN_S, REPEATS * z.longest[ch, i])
    return silent


@kernel
def who_jumped(z: Votes, ch: int, i: int, T: Array, threshold: float) -> int:
    """Of sensor ``i`` and the other trusted ones ``T``: JUMPED (it did), OTHERS or NOBODY."""
    jump = max(JUMP_SHARE * threshold, GUST_LEAPS * math.sqrt(z.leap[ch]))
    own = z.jump[ch, i]
    others = np.inf
    for j in range(3):
        if j != i and T[j] == 1.0:
            others = min(others, z.jump[ch, j])
    if own > jump and own > CLEARLY * others:
        return JUMPED
    if others < np.inf and others > jump and others > CLEARLY * own:
        return OTHERS
    return NOBODY


@kernel
def believe_the_rest(z: Votes, ch: int) -> None:
    """Forget what was fused while the culprits were the majority: it was theirs."""
    z.ring_e[ch, :] = 0.0
    z.ring_fused[ch, :] = 0.0
    lower(z.flags[ch, 3])
    z.turned[ch] = 1.0
    z.counters[2] = 0.0
