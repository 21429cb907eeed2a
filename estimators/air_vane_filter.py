"""The filter of one vane: offset, considered scale, gust; see :mod:`estimators.air_vane`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["CONSIDERED", "GATE", "GUST", "OFFSET", "vane_update"]

Array = NDArray[np.float64]

OFFSET, CONSIDERED, GUST = range(3)
GATE = 4.0
"""Innovation beyond which a reading loses weight [sigma] (Huber)."""


@kernel
def vane_update(
    x: Array, P: Array, a: float, r: float, R: float, phi: float, q_b: float, q_g: float
) -> float:
    """Advance one filter to an estimate and use its residual; return the log-likelihood.

    Parameters
    ----------
    x, P : (3,), (3, 3) float64, changed in place
    a, r : float [rad]
    R : float [rad^2]
        Variance of the reading's own noise.
    phi : float [1]
        ``exp(-dt / tau)`` of the gust.
    q_b, q_g : float [rad^2]
        Variances that b and g gain over dt.
    """
    x[GUST] *= phi
    for i in range(3):
        P[GUST, i] *= phi
    for i in range(3):
        P[i, GUST] *= phi
    P[OFFSET, OFFSET] += q_b
    P[GUST, GUST] += q_g
    PH = np.empty(3)
    for i in range(3):
        PH[i] = P[i, 0] + a * P[i, 1] + P[i, 2]
    S = R + PH[0] + a * PH[1] + PH[2]
    e = r - x[0] - a * x[1] - x[2]
    nu = abs(e) / math.sqrt(S)
    log_likelihood = -0.5 * math.log(2.0 * math.pi * S)
    if nu > GATE:
        log_likelihood -= GATE * (nu - 0.5 * GATE)
        S *= nu / GATE
    else:
        log_likelihood -= 0.5 * nu * nu
    for i in range(3):
        if i != CONSIDERED:
            x[i] += PH[i] * e / S
        for j in range(3):
            if i != CONSIDERED or j != CONSIDERED:
                P[i, j] -= PH[i] * PH[j] / S
    return float(log_likelihood)
