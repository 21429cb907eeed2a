"""The wind as an aircraft without vanes knows it: slow, and level.

=======  ==================================================================  ======
symbol   meaning                                                             unit
=======  ==================================================================  ======
v_ned    velocity against the ground                                         m/s
V        measured true airspeed                                              m/s
alpha_0  angle of attack at which the healthy wings carry the load n m g     rad
n        load factor of a coordinated turn, 1 / cos(roll)                    1
w        v_ned - ned_from_frd (V cos alpha_0, 0, V sin alpha_0)              m/s
w_hat    F(s) w, its vertical part zero; F(s) = 1 / (tau_w s + 1)            m/s
=======  ==================================================================  ======

Sideslip is taken for zero and the air for level. Over tau_w neither gusts nor a wrong alpha_0 tell
in the horizontal wind; what is left of them is unknown wind, and the covariance of the residuals
counts it as such (:mod:`estimators.wing_noise`).

Differs: samar2006 (4) low-passes the true wind, gusts and updrafts of more than tau_w included.
alpha_0 comes from the airframe, not from the measured lift, which a damaged wing changes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["WIND_STATE", "own_wind"]

Array = NDArray[np.float64]

G0_M_S2 = 9.80665
WIND_STATE = 4
"""North and east [m/s], time of the last row [s], rows so far."""
ALPHA_MAX_RAD = 0.3
LOAD_MAX = 3.0


@kernel
def own_wind(c: Array, t: Array, x: Array, tau: float, state: Array) -> None:
    """Fill in the wind of input rows from their other columns.

    Parameters
    ----------
    c : (41,) float64
        :meth:`estimators.wing_model.Airframe.row`.
    t, x : (n,), (n, INPUTS) float64 [s, see :func:`estimators.wing_model.inputs_of`]
        In order of time; the wind's columns are written, the airspeed must be there. Rows that are
        not finite get the wind of the row before.
    tau
        tau_w [s].
    state : (WIND_STATE,) float64, updated
        Zeros before the first row.
    """
    for k in range(len(t)):
        V, rho = x[k, 17], x[k, 16]
        s_roll, c_roll = math.sin(x[k, 0]), math.cos(x[k, 0])
        s_pitch, c_pitch = math.sin(x[k, 1]), math.cos(x[k, 1])
        s_yaw, c_yaw = math.sin(x[k, 2]), math.cos(x[k, 2])
        load = min(1.0 / max(c_roll, 1.0 / LOAD_MAX), LOAD_MAX)
        pressure = 0.5 * rho * max(V, 1.0) ** 2 * c[5]
        alpha = (load * c[0] * G0_M_S2 / pressure - c[8]) / c[9]
        alpha = max(-ALPHA_MAX_RAD, min(ALPHA_MAX_RAD, alpha))
        u, w = V * math.cos(alpha), V * math.sin(alpha)
        north = x[k, 3] - (c_pitch * c_yaw * u + (c_roll * s_pitch * c_yaw + s_roll * s_yaw) * w)
        east = x[k, 4] - (c_pitch * s_yaw * u + (c_roll * s_pitch * s_yaw - s_roll * c_yaw) * w)
        if math.isfinite(north) and math.isfinite(east):
            gain = 1.0
            if state[3] > 0.0:
                # the mean of all rows until tau_w has passed
                dt = t[k] - state[2]
                gain = max(1.0 - math.exp(-max(dt, 0.0) / tau), 1.0 / (state[3] + 1.0))
            state[0] += gain * (north - state[0])
            state[1] += gain * (east - state[1])
            state[2] = t[k]
            state[3] += 1.0
        x[k, 13], x[k, 14], x[k, 15] = state[0], state[1], 0.0
