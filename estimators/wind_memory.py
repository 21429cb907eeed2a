"""The wind of before: what it predicts, and how to find it when a fault has moved the estimate.

========  ===================================================  =====  =======
symbol    meaning                                              unit   wan2018
========  ===================================================  =====  =======
W         remembered wind (W_x, W_z)                           m/s    (10)
ring      the wind's estimates, one a sample, oldest replaced  m/s
bound     largest wind                                         m/s    (21b)
change    largest change of the wind over ``base`` samples     m/s
========  ===================================================  =====  =======
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import linearise
from estimators.jit import kernel

__all__ = ["against_remembered_wind", "extrapolated", "roll_back", "trend"]

TREND_S = 3.0
"""Base of the wind's trend, s: longer than the gusts of light turbulence, shorter than a shear."""
TREND_TAU_S = 5.0
"""Time constant with which a trend is expected to die out, s."""

Array = NDArray[np.float64]


@kernel
def against_remembered_wind(theta: Array, V_z: float, W: Array, air: Array) -> tuple[float, float]:
    """(alpha, V_c) that V_g, V_z and pitch give with the wind W = (W_x, W_z): (10) turned round."""
    V_g = theta[0]
    down = min(max(V_z, -V_g), V_g)
    north = math.sqrt(V_g * V_g - down * down) - W[0]
    down -= W[1]
    V_t = math.hypot(north, down)
    alpha = theta[1] + math.atan2(down, north)
    x = np.array([alpha, V_t, 0.0, 0.0])
    still = np.array([V_t, theta[1], 0.0, 0.0, 0.0, theta[5]])
    F = np.empty(4)
    h = np.empty(4)
    J = np.empty((3, 4, 4))
    linearise(0, x, F, still, air, 0.0, np.empty(4), J[0], J[1], h, J[2])
    return alpha, h[3]


@kernel
def roll_back(
    ring: Array, newest: int, filled: int, t_s: float, bound: float, base: int, change: float
) -> float:
    """Wind before the onset of a fault that all sensors of a channel share.

    A wind that leans neither on its ``bound`` nor on the edge of its band (``change`` over ``base``
    samples) has taken up nothing yet: the wind of 1.5 s ago. One that does has followed the fault:
    go back over the time it leant on the bound, then as long as the wind of one second before is
    further from where it arrived, by at least 0.3 m/s and 0.4 of the last seconds' rate, and two
    seconds more.
    """
    size = ring.size
    lag = round(1.0 / t_s)
    at = 0
    while at + lag < filled and abs(ring[(newest - at) % size]) > 0.9 * bound:
        at += 1
    leant = at
    now = ring[(newest - at) % size]
    moved = abs(now - ring[(newest - min(at + base, filled - 1)) % size])
    if leant == 0 and moved < 0.8 * change:
        at = min(lag + lag // 2, filled - 1)
    else:
        start = ring[(newest - min(at + 2 * lag, filled - 1)) % size]
        sign = 1.0 if now >= start else -1.0
        least = max(0.3, 0.2 * abs(now - start))
        while at + lag < filled:
            here = ring[(newest - at) % size]
            older = ring[(newest - at - lag) % size]
            if sign * (here - older) < least and at >= leant + 2 * lag:
                break
            at += 1
        at = min(at + 2 * lag, filled - 1)
    before: float = ring[(newest - at) % size]
    return before


@kernel
def trend(
    ring: Array, newest: int, filled: int, t_s: float, variance: float
) -> tuple[float, float]:
    """Rate of the wind over the last three seconds, and the rates' updated variance.

    In turbulence the wind's rate says nothing of what comes: the rate is shrunk by the share that
    stands out of the rates of the last half minute, ``variance``.
    """
    size = ring.size
    back = min(round(TREND_S / t_s), filled - 1)
    if back < 1:
        return 0.0, variance
    rate = (ring[newest % size] - ring[(newest - back) % size]) / (back * t_s)
    square = rate * rate
    shrunk = rate * square / (square + variance + 1e-9)
    gain = t_s / 30.0
    return shrunk, variance + gain * (square - variance)


@kernel
def extrapolated(W: float, rate: float, since_s: float) -> float:
    """The remembered wind carried on by its dying trend for ``since_s``."""
    return W + rate * TREND_TAU_S * (1.0 - math.exp(-since_s / TREND_TAU_S))
