"""Slow oscillation of one pitot, seen against another one and the bank's prediction.

The second difference of :mod:`estimators.air_checks` grows with the sampling interval and with the
square of the frequency: at 20 Hz an oscillation of 1 Hz hardly moves it. Here the difference of two
pitots is followed about its slow mean, in vehicle time, so that the rate of the samples does not
matter. Gusts and manoeuvres move both pitots and cancel; a step or a drift does not come back.

======== ==================================================================== ====
symbol   meaning                                                              unit
======== ==================================================================== ====
rho_i    ln(c_i / p_i): airspeed shown over the one predicted                 1
r, q     rho_i - rho_j and rho_i + rho_j of a pair i < j, less their slow     1
         mean
v, u, g  running means of r^2, q^2 and r q; the variances of rho_i and rho_j
         are (v + u +- 2 g) / 4, so that g is their difference                1
turn     r passes from beyond +L to beyond -L or back while v > L^2
======== ==================================================================== ====

A pair *swings* when turns follow each other within half a period of the slowest oscillation. The
pitot is named whose variance about the prediction exceeds the other's by half of v at least: by all
of it if it alone oscillates, by nothing if they swing against each other, as on the two wings of an
aircraft that yaws.

Source: wan2018 Table II: oscillations of 0.5 Hz to 4 Hz.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import PAIR0, SIMULTANEOUS_S, CheckLimits
from estimators.air_tests import short_of
from estimators.jit import kernel

__all__ = ["N_SWING", "follow_swing", "new_swings", "ragged", "swing_ratio", "swinging", "swings"]

Array = NDArray[np.float64]

# A row holds one pitot's last sample and, apart from that, one pair: (0,1), (0,2), (1,2).
T_RHO, RHO = 0, 1
T_PAIR, MEAN_R, MEAN_Q, V, U, G, SIDE, T_TURN, TURNS, SINCE = range(2, 12)
N_SWING = 12

MEAN_TAU_S = 5.0
"""Time constant of the slow mean: an oscillation of 0.5 Hz passes whole."""
LEVEL_TAU_S = 2.0
"""Averaging time of v, u and g: the period of the slowest oscillation."""
HALF_PERIOD_S = 1.3
"""Longest time between turns: half a period at 0.5 Hz, and a margin for noise at the level L."""
TURNS_MIN = 4.0
"""Turns that make an oscillation: three half periods lie between them."""
GAP_S = 1.0
"""After so long without a pair of samples all is forgotten."""
TIME_STEP_S = 1e-3
"""Stamps of many autopilots are in milliseconds."""
WHITE = 3.0
"""Squared second difference over v beyond which the scatter is noise; white noise has 6."""


def new_swings() -> Array:
    """State before the first sample, shape (3, 12)."""
    state = np.zeros((3, N_SWING))
    state[:, [T_RHO, T_PAIR, T_TURN]] = -np.inf
    return state


@kernel
def _restart(pair: Array, r: float, q: float) -> None:
    pair[MEAN_R], pair[MEAN_Q] = r, q
    pair[V], pair[U], pair[G] = 0.0, 0.0, 0.0
    pair[SIDE], pair[TURNS] = 0.0, 0.0


@kernel
def _turn(pair: Array, level: float, t: float, r: float) -> None:
    """Count the turns that follow each other soon enough; those of small noise do not count."""
    if t - pair[T_TURN] > HALF_PERIOD_S or pair[V] < level * level:
        pair[TURNS], pair[SIDE] = 0.0, 0.0
    if pair[V] < level * level:
        return
    side = 1.0 if r > level else -1.0 if r < -level else pair[SIDE]
    if side != pair[SIDE]:
        if pair[TURNS] == 0.0:
            pair[SINCE] = t
        pair[SIDE], pair[T_TURN] = side, t
        pair[TURNS] += 1.0


@kernel
def follow_swing(state: Array, limits: CheckLimits, i: int, t: float, rho: float) -> None:
    """Use one sample of pitot i.

    Parameters
    ----------
    state : (3, 12) float64, changed in place
    rho : float [1]
        NaN where there is no prediction.
    """
    # The other's sample nearest in time, not the one before it: a gust grows in between.
    apart = min(SIMULTANEOUS_S, 0.5 * (t - state[i, T_RHO]) + TIME_STEP_S)
    state[i, RHO], state[i, T_RHO] = rho, t
    for j in range(state.shape[0]):
        r = rho - state[j, RHO]
        if j == i or t - state[j, T_RHO] > apart or np.isnan(r):
            continue
        if j < i:
            r = -r
        q = rho + state[j, RHO]
        pair = state[i + j - 1]
        dt = t - pair[T_PAIR]
        pair[T_PAIR] = t
        if dt > GAP_S:
            _restart(pair, r, q)
        pair[MEAN_R] += min(dt / MEAN_TAU_S, 1.0) * (r - pair[MEAN_R])
        pair[MEAN_Q] += min(dt / MEAN_TAU_S, 1.0) * (q - pair[MEAN_Q])
        r = min(max(r - pair[MEAN_R], -1.0), 1.0)
        q = min(max(q - pair[MEAN_Q], -1.0), 1.0)
        weight = min(dt / LEVEL_TAU_S, 1.0)
        pair[V] += weight * (r * r - pair[V])
        pair[U] += weight * (q * q - pair[U])
        pair[G] += weight * (r * q - pair[G])
        _turn(pair, limits.noise_rms, t, r)


@kernel
def swinging(state: Array, i: int, others: int, t: float) -> bool:
    """Whether pitot i now turns again and again against one of the others."""
    for j in range(state.shape[0]):
        if j != i and (others >> j) & 1:
            pair = state[i + j - 1]
            if pair[TURNS] > 1.0 and t - pair[T_TURN] <= HALF_PERIOD_S:
                return True
    return False


@kernel
def _beside(state: Array, limits: CheckLimits, i: int, j: int) -> tuple[float, float]:
    """By how much the variance of pitot i exceeds that of pitot j, and the limit of v^(1/2)."""
    pair = state[i + j - 1]
    g = pair[G] if i < j else -pair[G]
    quiet = max(0.25 * (pair[V] + pair[U] - 2.0 * abs(g)), 0.0)
    return g, max(limits.noise_rms, limits.noise_ratio * math.sqrt(quiet))


@kernel
def swings(
    state: Array, limits: CheckLimits, i: int, others: int, t: float
) -> tuple[float, float, float]:
    """Rms of the oscillation of pitot i [1], its limit [1] and its onset [s].

    The rms is zero unless pitot i oscillates against every one of the others.

    Parameters
    ----------
    state : (3, 12) float64
    others : int
        Bit set for each pitot that may serve for comparison.
    """
    v, limit, onset = np.inf, 0.0, t
    for j in range(state.shape[0]):
        if j == i or not (others >> j) & 1:
            continue
        pair = state[i + j - 1]
        g, least = _beside(state, limits, i, j)
        limit = max(least, limit)
        lasts = t - pair[T_TURN] <= HALF_PERIOD_S and t - pair[SINCE] > limits.noise_s
        if not (
            lasts and pair[TURNS] >= TURNS_MIN and pair[V] > limit * limit and g > 0.5 * pair[V]
        ):
            return 0.0, limit, t
        v, onset = min(v, pair[V]), min(onset, pair[SINCE])
    return (math.sqrt(v) if v < np.inf else 0.0), limit, onset


@kernel
def swing_ratio(state: Array, limits: CheckLimits, i: int, others: int, t: float) -> float:
    """Rms of the oscillation of pitot i over its limit; NaN without another pitot.

    It counts in full once the turns are enough and the oscillation is its own, see :func:`swings`.
    """
    v, limit, rest = np.inf, 0.0, np.inf
    for j in range(state.shape[0]):
        if j == i or not (others >> j) & 1:
            continue
        pair = state[i + j - 1]
        g, least = _beside(state, limits, i, j)
        limit = max(least, limit)
        turns = pair[TURNS] if t - pair[T_TURN] <= HALF_PERIOD_S else 0.0
        own = g / (0.5 * pair[V]) if pair[V] > 0.0 else 0.0
        rest = min(rest, turns / TURNS_MIN, own)
        v = min(v, pair[V])
    return short_of(math.sqrt(v) / limit, rest) if v < np.inf else np.nan


@kernel
def ragged(state: Array, checks: Array, i: int, others: int) -> bool:
    """Whether what swings is noise rather than an oscillation.

    Parameters
    ----------
    checks : (3, 15) float64
        State of the checks of the three pitots.
    """
    for j in range(state.shape[0]):
        if j != i and (others >> j) & 1 and checks[i, PAIR0 + j] < WHITE * state[i + j - 1, V]:
            return False
    return True
