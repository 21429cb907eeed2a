"""What lu2016 prints, and what an independent trial of its method gave.

The paper shows its results as figures; the few numbers in its text are here. The trial is another
implementation on another synthetic flight, with the noise of Table 1 and the faults of Table 2.
"""

from __future__ import annotations

from math import degrees
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "AXES",
    "COLUMNS",
    "LEVEL_RATIO",
    "PARABOLIC_GYRO_RAD_S",
    "TABLE_1_STD",
    "TABLE_2",
    "TRIAL_LATENCY_M_S2",
    "TRIAL_QUIET_M_S2",
    "TRIAL_RMSE",
    "UNITS",
    "shown",
]

AXES: Final = ("f_Ax", "f_Ay", "f_Az", "f_p", "f_q", "f_r")
UNITS: Final = ("m/s²", "m/s²", "m/s²", "deg/s", "deg/s", "deg/s")
COLUMNS: Final = tuple(f"{axis} [{unit}]" for axis, unit in zip(AXES, UNITS, strict=True))
"""Heads of the six columns of a table of faults or errors."""
SHOWN: Final = np.array([1.0] * 3 + [degrees(1.0)] * 3)


def shown(values: ArrayLike) -> NDArray[np.float64]:
    """Faults or errors [m/s^2, rad/s] in the units of the report [m/s^2, deg/s]."""
    scaled: NDArray[np.float64] = np.asarray(values, dtype=np.float64) * SHOWN
    return scaled


TABLE_1_STD: Final = ("0.01",) * 6
"""Noise of one sample of each input [m/s^2, deg/s]."""

TABLE_2: Final = (
    "3",
    "0.1 (t - 10)",
    "4 sin(0.5π t)",
    "1.5",
    "1 sin(0.5π (t - 10))",
    "3",
)
"""The faults between 10 and 30 s [m/s^2, deg/s]."""

LEVEL_RATIO: Final = 2.0
"""Section 5.1: the RMSE of f_Az with the airspeed model is "almost twice" the other's."""

PARABOLIC_GYRO_RAD_S: Final = 0.05
"""Section 5.2: "the maximum error is less than 0.05 rad/s even when the faults are injected"."""

_GYRO: Final = (0.0019, 0.0019, 0.0036)
TRIAL_RMSE: Final = {
    "GS": dict.fromkeys(("calm", "shear", "turbulence"), (0.203, 0.088, 0.297, *_GYRO)),
    "AS": {
        "calm": (0.268, 0.236, 0.657, *_GYRO),
        "shear": (1.38, 0.51, 0.89, *_GYRO),
        "turbulence": (5.5, 6.2, 6.1, *_GYRO),
    },
}
"""Root mean square errors over 40 s [m/s^2, rad/s], median of three draws."""

TRIAL_QUIET_M_S2: Final = {
    "atsekf": (0.010, 0.010, 0.013),
    "smo": (0.84, 0.79, 0.78),
    "smo-low": (0.075, 0.066, 0.073),
}
"""Standard deviations of the accelerometers' fault estimates without a fault."""

TRIAL_LATENCY_M_S2: Final = {"compensated": 0.007, "uncompensated": 0.142}
"""Quiet standard deviation of f_Az with a satellite receiver 150 ms late."""
