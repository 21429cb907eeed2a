"""Accelerations from the accelerometers in place of the slope of the velocity.

=======  ==================================================================  ======
symbol   meaning                                                             unit
=======  ==================================================================  ======
a        specific force, mean over the time since the row before             m/s^2
g_b      gravity in body axes, from roll and pitch                           m/s^2
omega    body rates                                                          rad/s
v        velocity against the ground in body axes                            m/s
T, n     time averaged over; independent values of d in it                   s, 1
F_a      low-pass of the residuals (:mod:`estimators.wing_residuals`)
d        F_a(s) (a + g_b - omega x v - s v)                                  m/s^2
=======  ==================================================================  ======

Added to the residuals of the three translations, d replaces s v in them by a + g_b - omega x v. The
gravity and the rotation there are those that the prediction has too, so they cancel: what is left
is specific force measured against specific force predicted, and an error of the attitude no longer
weighs on it. 0.3 degrees of roll are 0.05 m/s^2 to the side, as much as 3 % of drag on one wing.

Accelerometers have a bias instead, which lasts while errors of the attitude come and go. Its
estimate is the mean of d since the start (over :data:`MEAN_S` at most), shrunk as its prior says,
and is taken off::

    bias = mean(d) n / (n + BIAS_ODDS),  n = T / (2 TILT_S)

d itself should be small. Where it is not, accelerometers and velocity contradict one another and
one of them is wrong.

Differs: samar2006 (2) has the slope of the velocity alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.wing_residuals import GAP_S, body_velocity

__all__ = ["FORCE_STATE", "force_rows"]

Array = NDArray[np.float64]

G0 = 9.80665
MEAN_S = 300.0
TILT_S = 30.0
"""How long an error of roll or pitch lasts, roughly."""
BIAS_ODDS = 2.0
"""Variance of d by errors of the attitude over that of the accelerometers' bias."""
D, V_LAST, REST_LAST, T_LAST = slice(0, 3), slice(3, 6), slice(6, 9), 9
MEAN, T_MEAN = slice(10, 13), 13
FORCE_STATE = 14
"""Length of the state; NaN at T_LAST before the first row."""


@kernel
def force_rows(t: Array, x: Array, acc: Array, tau_a: float, state: Array, out: Array) -> None:
    """Write d at every row.

    Parameters
    ----------
    t, x : (n,), (n, INPUTS) float64 [s, see :func:`estimators.wing_model.inputs_of`]
        The rows that the residuals were formed from; those that are not finite are passed over.
    acc : (n, 3) float64 [m/s^2]
        a; NaN where no accelerometer is heard, which leaves the slope of the velocity.
    tau_a
        [s].
    state : (FORCE_STATE,) float64, updated
    out : (n, 3) float64 [m/s^2], written
        d less the bias.
    """
    v = np.empty(6)
    for k in range(len(t)):
        sound = math.isfinite(x[k, 17])
        for i in range(12):
            sound = sound and math.isfinite(x[k, i])
        dt = t[k] - state[9]
        if sound and not dt <= 0.0:
            body_velocity(x[k], v)
            p, q, r = x[k, 6], x[k, 7], x[k, 8]
            s_pitch, c_pitch = math.sin(x[k, 1]), math.cos(x[k, 1])
            rest0 = -s_pitch * G0 - (q * v[2] - r * v[1])
            rest1 = math.sin(x[k, 0]) * c_pitch * G0 - (r * v[0] - p * v[2])
            rest2 = math.cos(x[k, 0]) * c_pitch * G0 - (p * v[1] - q * v[0])
            if dt <= GAP_S:
                keep = math.exp(-dt / tau_a)
                for i in range(3):
                    rest = rest0 if i == 0 else rest1 if i == 1 else rest2
                    fresh = acc[k, i] + 0.5 * (rest + state[6 + i]) - (v[i] - state[3 + i]) / dt
                    heard = math.isfinite(fresh)
                    state[i] = keep * state[i] + (1.0 - keep) * (fresh if heard else 0.0)
                    if heard:
                        share = dt / min(state[13] + dt, MEAN_S)
                        state[10 + i] += share * (fresh - state[10 + i])
                if math.isfinite(acc[k, 0]):
                    state[13] += dt
            for i in range(3):
                state[3 + i] = v[i]
            state[6], state[7], state[8] = rest0, rest1, rest2
            state[9] = t[k]
        n = min(state[13], MEAN_S) / (2.0 * TILT_S)
        for i in range(3):
            out[k, i] = state[i] - state[10 + i] * n / (n + BIAS_ODDS)
