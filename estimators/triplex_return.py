"""When a sensor that was found faulty is believed again.

=======  ===========================================================================  ==========
symbol   meaning                                                                      unit
=======  ===========================================================================  ==========
J        residual rms of the three sensors, (3,)                                      rad, m/s
J_th     threshold of J                                                               rad, m/s
peak     largest rms of a sensor since it was found                                   rad, m/s
left     the jump with which it left the others                                       rad, m/s
back     its largest jump of the last seconds, since it was found                     rad, m/s
=======  ===========================================================================  ==========

wan2018 says nothing of a return: its flags follow J, and a fault that the wind estimate has taken
up is healthy again. Here a sensor returns

* while others of its channel are good: when its J is small and it reads what they read;
* when the whole channel was lost: when it agrees with a second one, meets the held wind, and has
  come back by a jump if it left by one. A wind that changes brings a constant bias of all three
  into agreement with a held wind sooner or later, but never by a jump.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["like_the_others", "met_the_held_wind"]

Array = NDArray[np.float64]

LIKE_SHARE = 0.2
"""Share of the threshold by which a returning sensor may read apart from those that are trusted."""
BACK_SHARE = 0.35
"""Share of the largest residual since it was found that a sensor must jump back by."""


@kernel
def like_the_others(
    i: int, J: Array, use: Array, r: Array, count: int, J_th: float, clear_share: float
) -> bool:
    """Whether sensor ``i`` follows the prediction, and reads as the sensors in use do.

    Parameters
    ----------
    J, use : (3,) float64
        Residual rms, and 1 for the sensors that are trusted.
    r : (3, N_eval) float64
        The residuals; the first ``count`` are filled.
    """
    apart = 0.0
    n = 0
    for j in range(3):
        if use[j] == 1.0:
            n += 1
            for e in range(count):
                apart += (r[i, e] - r[j, e]) / count
    near: bool = J[i] <= clear_share * J_th
    return near and (n == 0 or abs(apart) / n <= LIKE_SHARE * J_th)


@kernel
def met_the_held_wind(
    i: int, J: Array, value: Array, J_th: float, clear_share: float, sigma: float, peak: float,
    left: float, back: float, waiting: bool,
) -> bool:  # fmt: skip
    """Whether sensor ``i`` of a lost channel agrees with the held wind, and came by a jump.

    Parameters
    ----------
    sigma : float
        Standard deviation of what the held wind predicts.
    waiting : bool
        Whether it agreed already in the sample before: then it needs no new jump.
    """
    level = min(clear_share * J_th + 3.0 * sigma, 0.5 * peak)
    friends = 0
    for j in range(3):
        if j != i and abs(value[i] - value[j]) <= clear_share * J_th:
            friends += 1
    came: bool = waiting or left < 0.5 * J_th or back >= BACK_SHARE * peak
    return J[i] <= level and friends > 0 and came
