"""What the votes remember, what bounds them, and the log rows that verdicts are made of.

===========  =================================================================  =========
symbol       meaning                                                            shape
===========  =================================================================  =========
ring         a residual's last ten seconds, one entry a stage                   (LONG,)
flags        which of the last ten stages were beyond the threshold             (SHORT,)
log row      one change of state: columns ``L_*``                               (17,)
===========  =================================================================  =========

Channel 0 is the angle of attack [rad], channel 1 the calibrated airspeed [m/s]; see
:mod:`estimators.air_vote`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "LOG_SIZE", "LONG", "SHORT", "STAGE_S", "VoteLimits", "Votes", "convict", "features",
    "mean_rms", "new_votes", "raised", "write",
]  # fmt: skip

Array = NDArray[np.float64]

STAGE_S = 0.1
SHORT = 10
"""Stages of the mean, of the rms and of a confirmation (1 s; wan2018 has N_eval = 10)."""
CONFIRM = 8
"""Stages of the last ten that must be beyond a threshold (n_D)."""
LONG = 100
"""Stages that the onset is looked for in."""

# states and reasons
UNMONITORED, OK, SUSPECT, FAULTY = 0.0, 1.0, 2.0, 3.0
NO_REASON, GROUND, LEARNING, MISSING, DISAGREE = 0.0, 1.0, 2.0, 3.0, 4.0
# causes of a verdict
VOTE, MEMORY, PAIR, BOUND, CONSTANT, RAGGED, ALONE = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0

# columns of a log row
(
    L_T, L_CH, L_I, L_STATE, L_REASON, L_ONSET, L_MAGNITUDE, L_STATISTIC, L_THRESHOLD, L_CAUSE,
    L_SLOPE, L_MEAN, L_RAGGED, L_ROUGH, L_CONSTANT, L_FIRST, L_PEAK,
) = range(17)  # fmt: skip
LOG_SIZE = 17


class VoteLimits(NamedTuple):
    """Thresholds; index 0 vanes [rad], 1 pitots [m/s]."""

    floor_aoa_rad: float
    floor_cas_m_s: float
    floor_cas_share: float
    sigmas: float
    ragged_share: float
    offset_aoa_rad: float
    scale_cas: float
    arm_m: float
    common_aoa_rad: float
    common_cas_m_s: float
    common_cas_share: float
    step_sigmas: float
    gust_m_s: float
    block_margin: float
    majority_margin: float
    pair_margin: float
    clear_share: float
    clear_s: float
    learn_s: float
    constant_s: float
    vote_wait_s: float
    pair_wait_s: float
    memory_s: float


class Votes(NamedTuple):
    """All that the votes remember, updated in place."""

    ring_r: Array  # (2, 3, LONG)
    ring_m: Array  # (2, 3, LONG): against the remembered wind
    ring_fused: Array  # (2, LONG): the median against the remembered wind
    ring_e: Array  # (2, LONG)
    flags: Array  # (2, 4, SHORT): three sensors and the common test
    offset: Array  # (2, 3)
    learnt: Array  # (2, 3): stages that went into the offset
    var_m: Array  # (2, 3)
    var_r: Array  # (2, 3)
    var_e: Array  # (2,)
    gust: Array  # (2,): variance
    latched: Array  # (2, 3)
    cause: Array  # (2, 3)
    calm: Array  # (2, 3)
    peak: Array  # (2, 3)
    age: Array  # (2, 3): stages since the last reading; large before the first
    value: Array  # (2, 3): mean reading of the stage
    same: Array  # (2, 3): seconds that the raw reading has not changed at all
    same_low: Array  # (2, 3): least and greatest reference meanwhile
    same_high: Array  # (2, 3)
    state: Array  # (2, 3): published state
    reason: Array  # (2, 3)
    split: Array  # (2,): stages that a pair has disagreed
    lost: Array  # (2,): stages since no sensor of the channel was left
    turned: Array  # (2,): 1 in the stage in which the majority was found to be wrong
    jump: Array  # (2, 3): see estimators.air_vote_signs
    run: Array  # (2, 3)
    longest: Array  # (2, 3)
    leap: Array  # (2,): variance of the usual leap
    held: Array  # (2, 3): see estimators.air_vote_tests
    counters: Array  # [stages, stages flying, stages with a model]


def new_votes() -> Votes:
    """Votes before the first row."""
    sensors = (2, 3)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(Votes._fields, sensors)
    shapes |= dict.fromkeys(("ring_r", "ring_m"), (2, 3, LONG))
    shapes |= dict.fromkeys(("ring_fused", "ring_e"), (2, LONG))
    shapes |= dict.fromkeys(("var_e", "gust", "split", "lost", "turned", "leap"), (2,))
    shapes |= {"flags": (2, 4, SHORT), "counters": (3,)}
    votes = Votes(**{name: np.zeros(shape) for name, shape in shapes.items()})
    votes.age[:] = 1e9
    votes.state[:] = -1.0
    votes.held[:] = np.nan
    return votes


@kernel
def mean_rms(ring: Array, newest: int, count: int) -> tuple[float, float]:
    """Mean and rms of the newest ``count`` entries of a ring of LONG."""
    total = 0.0
    square = 0.0
    for k in range(count):
        v = ring[(newest - k) % LONG]
        total += v
        square += v * v
    return total / count, math.sqrt(square / count)


@kernel
def features(ring: Array, newest: int, filled: int, limit: float, out: Array) -> None:
    """Onset, slope and raggedness of a residual up to its conviction."""
    # onset: back to where half a second stayed within a third of the threshold
    at = 0
    while at + 5 < min(filled, LONG):
        quiet = True
        for k in range(5):
            if abs(ring[(newest - at - k) % LONG]) > 0.35 * limit:
                quiet = False
                break
        if quiet:
            break
        at += 1
    n = max(at, 3)
    total, square, slope, ss, steps, peak = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        total += ring[(newest - k) % LONG]
    mean = total / n
    for k in range(n):
        v = ring[(newest - k) % LONG]
        tau = 0.5 * (n - 1) - k
        slope += tau * (v - mean)
        ss += tau * tau
    slope /= max(ss, 1e-9)
    previous = 0.0
    for k in range(n):
        v = ring[(newest - k) % LONG]
        tau = 0.5 * (n - 1) - k
        rest = v - mean - slope * tau
        square += rest * rest
        peak = max(peak, abs(v))
        if k > 0:
            steps += (rest - previous) ** 2
        previous = rest
    out[L_ONSET] = at
    out[L_SLOPE] = slope / STAGE_S
    out[L_MEAN] = mean
    out[L_RAGGED] = math.sqrt(square / n)
    out[L_ROUGH] = steps / max(square, 1e-12)
    out[L_FIRST] = abs(ring[(newest - max(at - 1, 0)) % LONG])
    out[L_PEAK] = peak


@kernel
def raised(flags: Array) -> float:
    """Number of the flags that are up."""
    total = 0.0
    for k in range(SHORT):
        total += flags[k]
    return total


@kernel
def lower(flags: Array) -> None:
    """Take all flags down."""
    for k in range(SHORT):
        flags[k] = 0.0


@kernel
def write(
    log: Array, row: int, z: Votes, t_s: float, ch: int, i: int, state: float, reason: float
) -> int:
    """Publish a state if it is a new one; returns the next free row."""
    if z.state[ch, i] == state and z.reason[ch, i] == reason:
        return row
    z.state[ch, i] = state
    z.reason[ch, i] = reason
    if row >= log.shape[0]:
        return row
    out = log[row]
    for k in range(LOG_SIZE):
        out[k] = np.nan
    out[L_T] = t_s
    out[L_CH] = ch
    out[L_I] = i
    out[L_STATE] = state
    out[L_REASON] = reason
    out[L_CAUSE] = z.cause[ch, i]
    return row + 1


@kernel
def convict(
    log: Array, row: int, z: Votes, t_s: float, ch: int, i: int, ring: Array, newest: int,
    statistic: float, limit: float, cause: float,
) -> int:  # fmt: skip
    """Latch a sensor, and say so with the residual's history."""
    z.latched[ch, i] = 1.0
    z.calm[ch, i] = 0.0
    z.cause[ch, i] = cause
    _, rms = mean_rms(ring, newest, SHORT)
    z.peak[ch, i] = rms
    before = row
    row = write(log, row, z, t_s, ch, i, FAULTY, NO_REASON)
    if row > before:
        out = log[before]
        features(ring, newest, int(z.counters[0]), limit, out)
        mean, _ = mean_rms(ring, newest, 3)
        out[L_MAGNITUDE] = mean
        out[L_STATISTIC] = statistic
        out[L_THRESHOLD] = limit
        out[L_CONSTANT] = z.same[ch, i]
    return row
