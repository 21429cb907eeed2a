"""Standard deviations of wing faults that are constant over the moving window.

========  ==================================================================  ==========  ========
symbol    meaning                                                             shape       unit
========  ==================================================================  ==========  ========
S         whitened signatures of a row (:mod:`estimators.wing_noise`)         (6, 4)      1/%
I         information of the window, sum of S'S                               (4, 4)      1/%^2
kappa     rows per independent row: (1 + r) / (1 - r), r = exp(-dt / tau_a)   1
sigma     sqrt(kappa [I^-1]_ii); of a wing's excess over the other one's,     %
          sqrt(kappa a' I^-1 a) with a = (1, 0, -1, 0) or (0, 1, 0, -1)
========  ==================================================================  ==========  ========

Residuals have passed F_a(s), so that neighbouring rows repeat one another: taken for independent
they would promise several times too much.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.linalg import invert
from estimators.wing_model import AXES, FAULTS

__all__ = ["spread_rows"]

Array = NDArray[np.float64]

P = len(FAULTS)


@kernel
def spread_rows(S: Array, kappa: float, ring: Array, count: Array, std: Array) -> None:
    """Deviations of four faults and two differences after each row.

    Parameters
    ----------
    S : (n, 6, 4) float64
        Whitened; a row that is not finite says nothing.
    kappa
        See above.
    ring : (N, 4, 4) float64, updated
        S'S of the window's rows.
    count : (1,) float64, updated
        Rows so far.
    std : (n, 6) float64 [%], written
        Faults, then right minus left: lift, drag. Infinite while the window does not tell.
    """
    total = np.empty((AXES, AXES))
    for k in range(len(S)):
        at = int(count[0]) % len(ring)
        count[0] += 1.0
        for i in range(P):
            for j in range(P):
                dot = 0.0
                for a in range(AXES):
                    dot += S[k, a, i] * S[k, a, j]
                ring[at, i, j] = dot if math.isfinite(dot) else 0.0
        for i in range(AXES):
            for j in range(AXES):
                total[i, j] = 1.0 if i == j and i >= P else 0.0
        for row in range(len(ring)):
            for i in range(P):
                for j in range(P):
                    total[i, j] += ring[row, i, j]
        sound = invert(total)
        for i in range(P):
            std[k, i] = math.sqrt(kappa * total[i, i]) if sound and total[i, i] > 0.0 else math.inf
        for i in range(2):
            var = total[i, i] + total[i + 2, i + 2] - total[i, i + 2] - total[i + 2, i]
            std[k, P + i] = math.sqrt(kappa * var) if sound and var > 0.0 else math.inf
