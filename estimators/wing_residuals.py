"""Residuals of an aircraft's accelerations and the signatures of its wings' faults, filtered alike.

========  ==============================================================  ========  ============
symbol    meaning                                                         shape     samar2006
========  ==============================================================  ========  ============
v         body velocity and body rates                                    (6,)      v in (5)
phi       accelerations predicted without a fault                         (6,)      (6)
S_i       (phi(f_i) - phi(0)) / f_i: secant of fault i                    (6,)      (8)
y, S      F_a(s) (s v - phi) and F_a(s) S                                 (6,)(6,4) (2), (5), (6)
tau_a     time constant of F_a(s) = 1 / (tau_a s + 1)                     s         IV-B: 4
tau_w     time constant of F(s), which the known wind has passed          s         (4), IV-B: 10
========  ==============================================================  ========  ============

y and S go through one filter, as they must for y = S f + e to hold. Both begin at zero.

Between two samples s v is the mean slope of v and phi the mean of both ends, so that a perfect
model leaves nothing of first order in the sampling.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.wing_model import AXES, FAULTS, INPUTS, Airframe, predict

__all__ = ["SECANT_PERCENT", "STATE", "WingResiduals", "low_passed", "residual_rows"]

Array = NDArray[np.float64]

SECANT_PERCENT = 10.0
"""Size of the fault at which the secants are taken."""
GAP_S = 1.0
"""Longer without a sample, and the slope of v is not formed across the gap."""

P = len(FAULTS)
V_LAST, PHI_LAST, S_LAST = slice(0, 6), slice(6, 12), slice(12, 12 + 6 * P)
Y, S_NOW = slice(36, 42), slice(42, 42 + 6 * P)
T_LAST, NEXT = 66, 67
STATE = 68
"""Length of the state; NaN at T_LAST before the first row."""


@kernel
def low_passed(t: Array, u: Array, tau: float, out: Array) -> None:
    """F(s) u for samples u (n, k) at t (n,) [s], begun settled at the first; out (n, k) written.

    Source: samar2006 (4).
    """
    n, m = u.shape
    for k in range(n):
        keep = math.exp(-(t[k] - t[k - 1]) / tau) if k > 0 and tau > 0.0 else 0.0
        for i in range(m):
            past = out[k - 1, i] if k > 0 else 0.0
            out[k, i] = keep * past + (1.0 - keep) * u[k, i]


@kernel
def body_velocity(x: Array, v: Array) -> None:
    """V of one input row: velocity against the ground in body axes, and the body rates."""
    s_roll, c_roll = math.sin(x[0]), math.cos(x[0])
    s_pitch, c_pitch = math.sin(x[1]), math.cos(x[1])
    s_yaw, c_yaw = math.sin(x[2]), math.cos(x[2])
    ahead = c_yaw * x[3] + s_yaw * x[4]
    across = c_yaw * x[4] - s_yaw * x[3]
    low = s_pitch * ahead + c_pitch * x[5]
    v[0] = c_pitch * ahead - s_pitch * x[5]
    v[1] = c_roll * across + s_roll * low
    v[2] = c_roll * low - s_roll * across
    v[3], v[4], v[5] = x[6], x[7], x[8]


@kernel
def residual_rows(
    c: Array,
    t: Array,
    x: Array,
    tau_a: float,
    period: float,
    state: Array,
    at: Array,
    y: Array,
    S: Array,
) -> int:
    """Filter residuals and signatures over rows; write them once every ``period``.

    Parameters
    ----------
    c : (41,) float64
        :meth:`estimators.wing_model.Airframe.row`.
    t, x : (n,), (n, INPUTS) float64 [s, see :func:`estimators.wing_model.inputs_of`]
        A row that is not finite (but for the airspeed) is passed over.
    tau_a, period
        [s]; rows are written where t passes a multiple of the period.
    state : (STATE,) float64, updated
    at, y, S : (n,), (n, 6), (n, 6, 4) float64, the first of them written

    Returns
    -------
    int
        Rows written.

    Source: samar2006 (2), (5), (6), (8).
    """
    p = S.shape[2]
    v, phi, hurt, none, f = np.empty(6), np.empty(6), np.empty(6), np.zeros(p), np.zeros(p)
    secants = np.empty(6 * p)
    written = 0
    for k in range(len(t)):
        sound = math.isfinite(t[k])
        for i in range(INPUTS):
            sound = sound and (i == 17 or math.isfinite(x[k, i]))
        dt = t[k] - state[T_LAST]
        if not sound or dt <= 0.0:
            continue
        body_velocity(x[k], v)
        predict(c, x[k], none, phi)
        for j in range(p):
            f[j] = SECANT_PERCENT
            predict(c, x[k], f, hurt)
            f[j] = 0.0
            for i in range(6):
                secants[i * p + j] = (hurt[i] - phi[i]) / SECANT_PERCENT
        if dt <= GAP_S:
            keep = math.exp(-dt / tau_a)
            new = 1.0 - keep
            for i in range(6):
                fresh = (v[i] - state[i]) / dt - 0.5 * (phi[i] + state[6 + i])
                state[36 + i] = keep * state[36 + i] + new * fresh
            for i in range(6 * p):
                fresh = 0.5 * (secants[i] + state[12 + i])
                state[42 + i] = keep * state[42 + i] + new * fresh
            if t[k] >= state[NEXT] - 1e-6:
                at[written] = t[k]
                for i in range(6):
                    y[written, i] = state[36 + i]
                    for j in range(p):
                        S[written, i, j] = state[42 + i * p + j]
                written += 1
        for i in range(6):
            state[i] = v[i]
            state[6 + i] = phi[i]
        for i in range(6 * p):
            state[12 + i] = secants[i]
        state[T_LAST] = t[k]
        if not math.isfinite(state[NEXT]) or t[k] >= state[NEXT] - 1e-6:
            state[NEXT] = period * (math.floor(t[k] / period + 1e-6) + 1.0)
    return written


class WingResiduals:
    """A stream of samples in, residuals and signatures at an even pace out.

    Parameters
    ----------
    airframe
        What the aircraft is believed to be.
    tau_a_s, period_s
        See :func:`residual_rows`.
    """

    def __init__(self, airframe: Airframe, *, tau_a_s: float = 4.0, period_s: float = 0.5) -> None:
        self._c = airframe.row()
        self._tau, self._period = tau_a_s, period_s
        self._state = np.zeros(STATE)
        self._state[[T_LAST, NEXT]] = np.nan

    def run(self, t_s: Array, inputs: Array) -> tuple[Array, Array, Array]:
        """Take rows in order.

        Parameters
        ----------
        t_s : (n,) float64
        inputs : (n, INPUTS) float64
            From :func:`estimators.wing_model.inputs_of`.

        Returns
        -------
        t_s, y, S : (m,), (m, 6), (m, 6, 4) float64
        """
        n = len(t_s)
        at, y, S = np.empty(n), np.empty((n, AXES)), np.empty((n, AXES, P))
        m = residual_rows(
            self._c, np.ascontiguousarray(t_s), np.ascontiguousarray(inputs), self._tau,
            self._period, self._state, at, y, S,
        )  # fmt: skip
        return at[:m].copy(), y[:m].copy(), S[:m].copy()
