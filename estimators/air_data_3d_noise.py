"""Noise levels of the deployed air-data filters, followed in flight without trusting the suspect.

==========  ==================================================================  ==========
symbol      meaning                                                             unit
==========  ==================================================================  ==========
s           slip: component of V - W across the nose, less n b                  m/s
sigma_g     rms of s with its slow part taken out: the gust intensity           m/s
u_i         variance of the epoch-to-epoch change of pitot i's residual, / 2    1
w_ij        variance of the same change of the difference of two pitots, / 4    1
a           horizontal acceleration over the ground                             m/s^2
sigma_V^2   white noise of GPS velocity beyond the autopilot's, and half the    m^2/s^2
            square of their lasting difference
R_lateral   (sideslip n)^2 + (timing a)^2 + sigma_V^2                           m^2/s^2
R_common    common^2 + min u + ((timing a)^2 + sigma_V^2) / n^2                 1
R_own       own^2 + min w                                                       1
==========  ==================================================================  ==========
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS, SCALE, YAW
from estimators.jit import kernel

__all__ = [
    "ACC",
    "APART",
    "GPS_STD",
    "GUST_STD",
    "LONGEST_STEP_S",
    "N_NOISE",
    "R_COMMON",
    "R_LATERAL",
    "R_OWN",
    "NoiseLevels",
    "adapt",
    "new_noise",
    "reference_noise",
]

Array = NDArray[np.float64]

SLIP_MEAN, SLIP_VAR, GUST_STD, ACC, GPS_STD, APART, R_LATERAL, R_COMMON, R_OWN = range(9)
_U0, _PAIR, _E0, _APART, _GPS, _NAV = 9, 12, 15, 18, 20, 25
N_NOISE = 30

ACC_MAX_M_S2 = 30.0

SLIP_MEAN_TAU_S = 10.0
LEVEL_TAU_S = 10.0
GUST_RISE_S, GUST_FALL_S = 5.0, 30.0
"""Gusts come in bursts: their level is believed soon and forgotten late."""
REFERENCE_TAU_S = 2.0

LONGEST_STEP_S = 2.0
"""An epoch counts for no more than this; one that comes after as long comes after a gap."""


class NoiseLevels(NamedTuple):
    """Floors and factors of the noise model; the settings say what each rests on."""

    gust_tau_s: float
    gust_prior_m_s: float
    gust_min_m_s: float
    gust_max_m_s: float
    sideslip_rad: float
    timing_s: float
    pitot_common: float
    pitot_own: float


def new_noise(levels: NoiseLevels) -> Array:
    """Noise state before the first epoch, shape (30,)."""
    state = np.zeros(N_NOISE)
    state[GUST_STD] = levels.gust_prior_m_s
    state[SLIP_VAR] = state[GUST_STD] ** 2 / (1.0 + levels.gust_tau_s / SLIP_MEAN_TAU_S)
    for first, last in ((_E0, _E0 + 3), (_GPS, _GPS + 4), (_NAV, _NAV + 4)):
        state[first:last] = np.nan
    return state


@kernel
def _second_difference2(state: Array, first: int, v: Array, weight: float) -> float:
    """Mean square of a velocity's horizontal second difference / 6: the variance of white noise.

    The five slots of ``state`` from ``first`` hold the two last velocities and the mean square.
    """
    total = 0.0
    for i in range(2):
        a, b = state[first + i], state[first + 2 + i]
        total += (v[i] - 2.0 * b + a) ** 2 / 6.0
        state[first + i], state[first + 2 + i] = b, v[i]
    if not np.isnan(total):
        state[first + 4] += weight * (min(total, 100.0) - state[first + 4])
    return float(state[first + 4])


@kernel
def reference_noise(state: Array, dt: float, V: Array, v_nav: Array, has_nav: bool) -> None:
    """Follow GPS noise, how far GPS and the autopilot are apart, and the acceleration.

    Fast scatter that both show is flight, not noise; a lasting difference says that one of them is
    wrong, not which. After a gap the differences begin anew: what one of the two flew meanwhile,
    the other need not have seen.

    Parameters
    ----------
    state : (30,) float64, changed in place
    V, v_nav : (3,) float64 [m/s]
    """
    weight = min(dt / REFERENCE_TAU_S, 1.0)
    if dt >= LONGEST_STEP_S:
        state[_GPS : _GPS + 4] = np.nan
        state[_NAV : _NAV + 4] = np.nan
    a2 = 0.0
    for i in range(2):
        if not np.isnan(state[_GPS + 2 + i]):
            a2 += ((V[i] - state[_GPS + 2 + i]) / dt) ** 2
    state[ACC] = min(math.sqrt(a2), ACC_MAX_M_S2)
    gps2 = _second_difference2(state, _GPS, V, weight)
    if not has_nav:
        return
    nav2 = _second_difference2(state, _NAV, v_nav, weight)
    state[GPS_STD] = math.sqrt(max(gps2 - nav2, 0.0))
    apart2 = 0.0
    for i in range(2):
        difference = min(max(V[i] - v_nav[i], -30.0), 30.0)
        state[_APART + i] += weight * (difference - state[_APART + i])
        apart2 += state[_APART + i] ** 2
    state[APART] = math.sqrt(apart2)


@kernel
def adapt(
    state: Array,
    levels: NoiseLevels,
    dt: float,
    x: Array,
    x_slip: Array,
    V: Array,
    e_y: Array,
    y: Array,
    use: int,
    ln_sigma: float,
    e: Array,
) -> float:
    """Follow slip and residuals of the master at an epoch; set the noise levels; return |V - W|.

    Parameters
    ----------
    state : (30,) float64, changed in place
    x : (10,) float64
        The master's state, before the epoch's measurements are used.
    x_slip : (10,) float64
        State that the slip is measured with: that of a changed wind where this explains the
        flight better than the master, since the master's stale wind would show as gusts, and those
        would hide the change.
    V, e_y, y : (3,) float64 [m/s], [1], [1]
    use : int
        Pitots under judgement: only their noise counts.
    e : (3,) float64 [1]
        Receives ``y_i - ln(sigma_rho |V - W|) + k_i``.
    """
    d2, slip = 0.0, 0.0
    for i in range(3):
        d = V[i] - x[i]
        d2 += d * d
        slip += e_y[i] * (V[i] - x_slip[i])
    n = max(math.sqrt(d2), 1.0)
    slip -= n * x_slip[YAW]
    state[SLIP_MEAN] += min(dt / SLIP_MEAN_TAU_S, 1.0) * (slip - state[SLIP_MEAN])
    fast2 = min((slip - state[SLIP_MEAN]) ** 2, levels.gust_max_m_s**2)
    tau = GUST_RISE_S if fast2 > state[SLIP_VAR] else GUST_FALL_S
    state[SLIP_VAR] += min(dt / tau, 1.0) * (fast2 - state[SLIP_VAR])
    weight = min(dt / LEVEL_TAU_S, 1.0)
    state[GUST_STD] = min(max(math.sqrt(state[SLIP_VAR]), levels.gust_min_m_s), levels.gust_max_m_s)
    common2, own2 = np.inf, np.inf
    for i in range(N_PITOTS):
        old = state[_E0 + i]
        e[i] = y[i] - ln_sigma - math.log(n) + x[SCALE.start + i]
        change = e[i] - old
        if (use >> i) & 1 and not np.isnan(change):
            state[_U0 + i] += weight * (min(0.5 * change * change, 1.0) - state[_U0 + i])
            common2 = min(common2, state[_U0 + i])
        for j in range(i):
            pair = change - (e[j] - state[_E0 + j])
            k = _PAIR + i + j - 1
            if (use >> i) & (use >> j) & 1 and not np.isnan(pair):
                state[k] += weight * (min(0.25 * pair * pair, 1.0) - state[k])
                own2 = min(own2, state[k])
    for i in range(N_PITOTS):
        state[_E0 + i] = e[i]
    # One pitot cannot be told from a gust by its own noise: it may claim no more than the slip.
    common2 = min(common2, (state[GUST_STD] / n) ** 2)
    own2 = own2 if own2 < np.inf else 0.0
    timing2 = (levels.timing_s * state[ACC]) ** 2
    reference2 = state[GPS_STD] ** 2 + 0.5 * state[APART] ** 2
    state[R_LATERAL] = (levels.sideslip_rad * n) ** 2 + timing2 + reference2
    state[R_COMMON] = levels.pitot_common**2 + common2 + (timing2 + reference2) / (n * n)
    state[R_OWN] = levels.pitot_own**2 + own2
    return n
