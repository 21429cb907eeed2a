"""Does the engine give the power that the throttle asks for? The aircraft's energy says.

==========  ==========================================================  =========
symbol      meaning                                                     unit
==========  ==========================================================  =========
p           climb that engine and drag make, of :mod:`engine_ticks`     m/s
t           throttle averaged like p                                    1
a, b        p = a + b t in this flight so far; a < 0 is the glide       m/s
s2, s2_g    variance of p, of p_g about that line                       m^2/s^2
tau         time since the engine speed fell                            s
LLR         log likelihood of "stopped" over "runs"                     nat
==========  ==========================================================  =========

a and b are learnt in flight by a Kalman filter from a prior of a glide ratio and level flight at 40
% throttle. p and p_g are averaged by their own variances: in gusty wind the second counts, in turns
in steady wind the first. When the engine stops, p falls within T by most of b t: at time tau

    p_stopped = p_runs - LOST b t (1 - exp(-tau / T)),   p_runs = a + b t.

LOST is less than 1: how fast this aircraft glides is only known by extrapolation, in a loop that
opens the throttle when power is missing.

Noise of p is correlated over T, hence one step counts as dt / T of an independent value.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "FIRST_VARIANCE", "LEARN_S", "N_POWER", "P_A", "P_B", "P_KNOWN_S", "P_S2", "P_S2G",
    "PowerRules", "evidence", "forget", "learn", "mean_power",
]  # fmt: skip

Array = NDArray[np.float64]

P_A, P_B, P_AA, P_AB, P_BB, P_S2, P_S2G, P_KNOWN_S = range(8)
N_POWER = 8
USUAL_THROTTLE = 0.4
SLOPE_STD = 0.7
"""Standard deviation of the prior slope, as a share of it."""
WALK_PER_S = 1e-4
"""Variance that a and b gain in a second, as a share of their prior's."""
LEARN_S = 20.0
"""Time of flight before the line is believed."""
VARIANCE_S = 30.0
FIRST_VARIANCE = 4.0
"""Of p before it is known [m^2/s^2]."""
LEAST_VARIANCE = 0.1
LOST = 0.6
"""Share of the throttle's power that a stopped engine loses at least: a is known that badly."""
OUTLIER = 3.0
"""A power so many deviations off the line teaches a and b nothing."""


class PowerRules(NamedTuple):
    """Glide ratio of the prior, averaging time T [s], step [s]."""

    glide_ratio: float
    power_s: float
    tick_s: float


@kernel
def forget(m: Array) -> None:
    """Nothing known of this flight yet; `m` is (8,) float64."""
    m[:] = 0.0
    m[P_S2] = m[P_S2G] = FIRST_VARIANCE


@kernel
def mean_power(m: Array, p: float, p_g: float) -> tuple[float, float]:
    """P and p_g by their variances, and the variance of that [m/s], [m^2/s^2]."""
    w, w_g = 1.0 / m[P_S2], 1.0 / m[P_S2G]
    return (w * p + w_g * p_g) / (w + w_g), 1.0 / (w + w_g)


@kernel
def learn(m: Array, r: PowerRules, V: float, t: float, p: float, p_g: float) -> None:
    """Use one step of a flight whose engine is not in doubt.

    Parameters
    ----------
    m : (8,) float64, changed in place
        P_*.
    V : float [m/s]
        Airspeed.
    t, p, p_g : float
        As above.
    """
    if m[P_KNOWN_S] == 0.0:
        m[P_A] = -V / r.glide_ratio
        m[P_B] = -m[P_A] / USUAL_THROTTLE
        m[P_AA], m[P_AB] = (0.5 * m[P_A]) ** 2, 0.0
        m[P_BB] = (SLOPE_STD * m[P_B]) ** 2
    m[P_AA] += WALK_PER_S * r.tick_s * (0.5 * m[P_A]) ** 2
    m[P_BB] += WALK_PER_S * r.tick_s * (SLOPE_STD * m[P_B]) ** 2
    line = m[P_A] + m[P_B] * t
    m[P_KNOWN_S] += r.tick_s
    both, var = mean_power(m, p, p_g)
    e = both - line
    share = min(r.tick_s / VARIANCE_S, 1.0)
    m[P_S2] = max(m[P_S2] + share * ((p - line) ** 2 - m[P_S2]), LEAST_VARIANCE)
    m[P_S2G] = max(m[P_S2G] + share * ((p_g - line) ** 2 - m[P_S2G]), LEAST_VARIANCE)
    if abs(e) > OUTLIER * math.sqrt(var):
        return
    h_a, h_b = m[P_AA] + t * m[P_AB], m[P_AB] + t * m[P_BB]
    S = h_a + t * h_b + var * r.power_s / r.tick_s
    m[P_A] += h_a * e / S
    m[P_B] += h_b * e / S
    m[P_AA] -= h_a * h_a / S
    m[P_AB] -= h_a * h_b / S
    m[P_BB] -= h_b * h_b / S


@kernel
def evidence(
    m: Array, r: PowerRules, t: float, p: float, p_g: float, tau: float
) -> tuple[float, float]:
    """What this step adds to LLR, and to what LLR can be expected to be [nat].

    Both 0 while the line is not known. The second is the mean of LLR if the engine stopped, and of
    -LLR if it runs: how much the throttle in these seconds could tell at all.
    """
    if m[P_KNOWN_S] < LEARN_S or math.isnan(p):
        return 0.0, 0.0
    gain = max(m[P_B] * t, 0.0)
    both, var = mean_power(m, p, p_g)
    var += m[P_AA] + 2.0 * t * m[P_AB] + t * t * m[P_BB]
    runs = both - m[P_A] - gain
    stopped = runs + LOST * gain * (1.0 - math.exp(-tau / r.power_s))
    weight = r.tick_s / r.power_s * 0.5 / var
    return weight * (runs * runs - stopped * stopped), weight * (runs - stopped) ** 2
