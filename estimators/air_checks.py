"""Fast checks of one pitot, sample by sample, beside the filter bank.

======== ==================================================================== ====
symbol   meaning                                                              unit
======== ==================================================================== ====
raw      airspeed as the pitot sent it; whether it stands still shows here     m/s
c        equivalent airspeed of it, which carries the static pressure's noise m/s
p        what the pitot should show, of the bank's master; NaN while unknown  m/s
V        speed over the ground                                                m/s
z        ln c: noise is judged on it, so that a wrong scale is not noise      1
D2       z_k - 2 z_(k-1) + z_(k-2): of white noise s its variance is 6 s^2    1
VAR      running mean of D2^2                                                 1
SLOW     running mean of VAR over a minute, which is what gusts usually do    1
PAIR     running mean of the square of the difference of two pitots' D2       1
======== ==================================================================== ====

The checks: constant (``stuck``), grossly off the prediction, dead while the aircraft flies fast
over the ground, or scattering against the others. Each must hold for its time without a
break. They judge only a pitot that exists: one that has ever shown more than zero, or the first one
where the autopilot lists it as present.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_tests import short_of
from estimators.jit import kernel

__all__ = [
    "CHECK_BANK",
    "CHECK_CONSTANT",
    "CHECK_DEAD",
    "CHECK_GROSS",
    "CHECK_HORIZON",
    "CHECK_NOISE",
    "CHECK_NONE",
    "CHECK_OSCILLATION",
    "N_CHECK",
    "CheckLimits",
    "check_sample",
    "grossly_off",
    "held",
    "new_check",
    "noise_check",
    "noise_ratio",
    "noisy",
    "pair_noise",
    "pair_noise_rms",
]

Array = NDArray[np.float64]

# Floats: integer constants would compile each kernel they are passed to anew.
CHECK_NONE, CHECK_CONSTANT, CHECK_GROSS = 0.0, 1.0, 2.0
CHECK_DEAD, CHECK_NOISE, CHECK_BANK, CHECK_OSCILLATION = 3.0, 4.0, 5.0, 6.0
CHECK_HORIZON = 7.0

# State of one pitot's checks.
T_LAST, Z1, Z2, D2, LAST, SAME_SINCE, N_SAME, GROSS_SINCE, DEAD_SINCE, VAR, NOISE_SINCE, ALIVE = (
    range(12)
)
SLOW = 12
PAIR0 = 13
DT, DT1 = 16, 17
N_CHECK = 18

Z_FLOOR_M_S = 8.0
"""Less airspeed than this has no meaningful logarithm: 1.5 Pa of a pressure sensor's noise, which
is nothing in flight, is 2 % of 8 m/s and all of what a parked pitot shows."""
USUAL_S = 60.0
"""Averaging time of what gusts usually do to a pitot."""
SILENT = 0.5
"""Share of its usual mean square scatter below which a pitot may have fallen silent."""
BEYOND_GUSTS = 8.0
"""Times the usual mean square scatter that no gust reaches: over a second it varies by three."""
GAP_S = 2.5
"""A reading repeated after a gap was not held meanwhile."""
SIMULTANEOUS_S = 0.06
"""Samples of two pitots nearer than this felt the same gust."""


DEAD_SHARE = 0.25
"""A pitot that shows this much of the ground speed, or Z_FLOOR_M_S, lives: a strong wind from
behind makes the ground speed twice a good airspeed, thrice that of an aircraft near its stall."""


class CheckLimits(NamedTuple):
    """Limits of the fast checks; the settings of the same names say what each rests on."""

    constant_s: float
    gross_ln: float
    gross_s: float
    dead_wind_m_s: float
    dead_s: float
    noise_rms: float
    noise_ratio: float
    noise_s: float
    noise_tau_s: float


def new_check() -> Array:
    """State before the first sample, shape (18,)."""
    state = np.full(N_CHECK, np.nan)
    state[[N_SAME, VAR, ALIVE, SLOW]] = 0.0
    state[PAIR0 : PAIR0 + 3] = 0.0
    return state


@kernel
def held(state: Array, slot: int, condition: bool, t: float) -> float:
    """How long the condition has held without a break [s]; -1 while it does not."""
    if not condition:
        state[slot] = np.nan
        return -1.0
    if np.isnan(state[slot]):
        state[slot] = t
    return float(t - state[slot])


@kernel
def grossly_off(state: Array) -> bool:
    """Whether the last sample was grossly off: the filters leave it to the check."""
    return not np.isnan(state[GROSS_SINCE])


@kernel
def lives(ground_speed: float, tas: float, wind_m_s: float) -> bool:
    """Whether an airspeed may be one at this speed over ground; False for NaN."""
    shown = max(Z_FLOOR_M_S, DEAD_SHARE * ground_speed)
    return tas >= shown or ground_speed - 1.2 * tas <= wind_m_s


@kernel
def check_sample(
    state: Array,
    limits: CheckLimits,
    t: float,
    raw: float,
    c: float,
    p: float,
    p_std: float,
    ground_speed: float,
    sigma: float,
    flying: bool,
    learnt: bool,
) -> float:
    """Use one sample; return the check that fails now (CHECK_CONSTANT, _GROSS, _DEAD) or none.

    Parameters
    ----------
    state : (18,) float64, changed in place
    t, raw, c : float [s], [m/s], [m/s]
    p, p_std : float [m/s], [1]
        Prediction and the standard deviation of its logarithm; NaN where there is none.
    ground_speed, sigma : float [m/s], [1]
        ``|V|`` and sqrt(rho / rho0).
    flying, learnt : bool
        Nothing fails on the ground. The check for dead pitots, which knows no wind, is made only
        before the wind is learnt; the gross one needs a prediction.
    """
    if c > 0.0:
        state[ALIVE] = 1.0
    dt = t - state[T_LAST]
    z = math.log(max(c, Z_FLOOR_M_S))
    state[D2] = z - 2.0 * state[Z1] + state[Z2] if 0.0 < dt < 0.5 else np.nan
    if not np.isnan(state[D2]):
        d2 = min(state[D2] * state[D2], 4.0)
        state[VAR] += min(dt / limits.noise_tau_s, 1.0) * (d2 - state[VAR])
        state[SLOW] += min(dt / USUAL_S, 1.0) * (state[VAR] - state[SLOW])
    state[Z2] = state[Z1] if dt < 0.5 else np.nan
    state[Z1] = z
    state[T_LAST] = t
    state[DT1], state[DT] = state[DT], dt
    same = raw == state[LAST] and not dt > GAP_S
    state[N_SAME] = state[N_SAME] + 1.0 if same else 0.0
    state[LAST] = raw
    if not same or not flying:
        state[SAME_SINCE] = t
    constant = flying and state[N_SAME] >= 4.0 and t - state[SAME_SINCE] > limits.constant_s
    dead = not lives(ground_speed, c / sigma, limits.dead_wind_m_s)
    dead_s = held(state, DEAD_SINCE, flying and not learnt and dead, t)
    beyond = abs(math.log(max(c, 0.1) / p)) > limits.gross_ln + 3.0 * p_std if p > 1.0 else False
    gross_s = held(state, GROSS_SINCE, flying and beyond, t)
    if constant:
        return CHECK_CONSTANT
    if gross_s > limits.gross_s:
        return CHECK_GROSS
    if dead_s > limits.dead_s:
        return CHECK_DEAD
    return CHECK_NONE


@kernel
def pair_noise(states: Array, limits: CheckLimits, i: int, dt: float) -> None:
    """After a sample of pitot i: follow its noise against every pitot sampled at the same time.

    What both show is gust; only the difference is noise. Both must have been sampled three times
    together: where a sample of one was lost, the gust of another interval would look like noise.

    Parameters
    ----------
    states : (3, 18) float64, changed in place
    dt : float [s]
        Time since the sample of i before.
    """
    own = states[i]
    for j in range(states.shape[0]):
        other = states[j]
        difference = own[D2] - other[D2]
        together = (
            abs(own[T_LAST] - other[T_LAST]) < SIMULTANEOUS_S
            and abs(own[DT] - other[DT]) < SIMULTANEOUS_S
            and abs(own[DT1] - other[DT1]) < SIMULTANEOUS_S
        )
        if j != i and together and not np.isnan(difference):
            weight = min(dt / limits.noise_tau_s, 1.0)
            v = own[PAIR0 + j]
            v += weight * (min(difference * difference, 4.0) - v)
            own[PAIR0 + j] = v
            other[PAIR0 + i] = v


@kernel
def _scatter(states: Array, i: int, others: int) -> tuple[float, float]:
    """Scatter of pitot i against the others and that of the quietest of them; inf without any.

    A peer that has lately fallen silent is no witness, unless gusts cannot scatter anything so
    much: a blocked pitot feels none, and beside it a good one looks noisy.
    """
    pair, quietest = np.inf, np.inf
    for j in range(states.shape[0]):
        if j == i or not (others >> j) & 1:
            continue
        usual = states[j, SLOW]
        if states[j, VAR] >= SILENT * usual or states[i, PAIR0 + j] > BEYOND_GUSTS * usual:
            pair = min(pair, states[i, PAIR0 + j])
            quietest = min(quietest, states[j, VAR])
    return pair, quietest


@kernel
def noisy(states: Array, i: int, others: int, rms: float, ratio: float) -> bool:
    """Whether pitot i scatters against every one of the others, and more than they do.

    Its difference from the others must scatter by ``rms`` and by ``ratio`` times what the quietest
    of them does, and most of that scatter must show in its own readings.

    Parameters
    ----------
    states : (3, 18) float64
    others : int
        Bit set for each pitot that may serve for comparison.
    """
    pair, quietest = _scatter(states, i, others)
    if pair == np.inf:
        return False
    limit = max(rms, ratio * math.sqrt(quietest / 6.0))
    return bool(pair > 6.0 * limit * limit and states[i, VAR] - quietest > 0.5 * pair)


@kernel
def noise_ratio(states: Array, i: int, others: int, rms: float, ratio: float) -> float:
    """Scatter over what makes pitot i :func:`noisy`; NaN without a witness."""
    pair, quietest = _scatter(states, i, others)
    if pair == np.inf:
        return np.nan
    limit = max(rms, ratio * math.sqrt(quietest / 6.0))
    own = (states[i, VAR] - quietest) / (0.5 * pair) if pair > 0.0 else 0.0
    return short_of(math.sqrt(pair / 6.0) / limit, own)


@kernel
def noise_check(states: Array, limits: CheckLimits, i: int, others: int, t: float) -> bool:
    """Whether pitot i has been :func:`noisy` for long enough."""
    scatters = noisy(states, i, others, limits.noise_rms, limits.noise_ratio)
    held_s = held(states[i], NOISE_SINCE, scatters, t)
    return held_s > limits.noise_s


@kernel
def pair_noise_rms(states: Array, i: int, others: int) -> float:
    """Relative rms noise of pitot i against the one it agrees with best [1]."""
    pair = np.inf
    for j in range(states.shape[0]):
        if j != i and (others >> j) & 1:
            pair = min(pair, states[i, PAIR0 + j])
    return math.sqrt(pair / 6.0)
