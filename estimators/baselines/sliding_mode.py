"""Reconstruct IMU faults by a sliding-mode observer, the method lu2016 compares its filter with.

The IMU drives a copy of the kinematic model. A bounded injection pulls the copy onto the measured
state; once it slides there, what has to be injected on average is what the faults do to the rates
of change, and the distribution matrix turns it back into faults.

========  ===================================================  =======  ======  ================
symbol    meaning                                              shape    unit    source
========  ===================================================  =======  ======  ================
x         state of the observer                                (6,)     m/s,    lu2016 (4), (15)
                                                                        rad
z         measured state, h^-1(y)                              (6,)     m/s,    lu2016 (14), (20)
                                                                        rad
e         error of the prediction, z - x, angles wrapped       (6,)     m/s,    edwards2000
                                                                        rad
rho       largest injection                                    (6,)     m/s^2,  edwards2000
                                                                        rad/s
delta     half of rho is injected at this error                (6,)     m/s,    edwards2000
                                                                        rad
nu        equivalent injection, rho e / (|e| + delta)          (6,)     m/s^2,  edwards2000
                                                                        rad/s
G         fault distribution matrix, carries the minus         (6, 6)           lu2016 (13), (19)
f         faults, G^-1 nu                                      (6,)     m/s^2,
                                                                        rad/s
========  ===================================================  =======  ======  ================

x' = f(x, u_m) + nu against the truth's x' = f(x, u_m) + G f: sliding (e = 0, e' = 0) means
nu = G f on average, with no model of how the faults move.

What is injected is the noise of z too, magnified by ``rho / delta``: about 80 times the noise of a
velocity, in m/s^2, at 100 Hz. A small delta only hides it behind chattering between -rho and rho.
So the estimate has to be low-passed, and is then late. The two-stage filter makes the same bargain
at each moment by the noise it expects and the innovations it sees; the observer makes it once.

lu2016 prints neither gains nor filter. Here `slope` is how much of a small error one sample's
injection takes away, ``dt rho / delta``; one would be a differentiator.

Differs: the observers cited are for linear systems in continuous time and inject through a gain
that shapes the error of unmeasured states. Here all states are measured, and the injection of a
sample uses the prediction for that sample (the discrete form without a delay of its own).

Source: lu2016 sections 3.4, 3.5; C. Edwards, S. Spurgeon, R. Patton, Automatica 36 (2000) 541-553;
docs/references ``lu2016``, ``edwards2000``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.attitude import wrap
from estimators.jit import kernel
from estimators.kinematics import AS, GS, earth_terms, linearise, state_from_output
from estimators.linalg import invert, matvec
from estimators.two_stage_predict import runge_kutta

__all__ = ["OBSERVED", "SlidingModeObserver", "SlidingModeSettings"]

Array = NDArray[np.float64]
Rows = NDArray[np.void]

_SIX = ("<f8", (6,))
OBSERVED: Final = np.dtype([("f", *_SIX), ("f_low", *_SIX), ("x", *_SIX), ("used", "?")])
"""A row per sample: faults as injected, faults after the low-pass, state, whether z was whole."""

REACH: Final = {GS: (20.0,) * 3 + (0.5,) * 3, AS: (40.0,) * 3 + (0.5,) * 3}
"""rho [m/s^2, rad/s]: four times what the faults of Table 2 add to any rate of change. Through the
air a yaw rate fault of 3 deg/s adds V f_r = 5 m/s^2 at 100 m/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlidingModeSettings:
    """Constants of an observer.

    Attributes
    ----------
    model
        ``GS`` (velocity over the ground) or ``AS`` (through the air).
    dt_s
        Sampling interval [s].
    reach
        rho [m/s^2, rad/s], above anything that faults and wind do; None: :data:`REACH`.
    slope
        Share of a small error that one injection takes away; delta = rho dt / slope. Stable below
        2, without overshoot to 1.
    lowpass_s
        Time constant of the first-order low-pass of ``f_low`` [s]. Of .02, .05, .08, .13, .2 and
        .35 s this one has the least error over the faults of Table 2 (geometric mean of the six
        root mean squares, calm air, seeds 0-5).
    """

    model: int = GS
    dt_s: float = 0.01
    reach: tuple[float, ...] | None = None
    slope: float = 2.0 / 3.0
    lowpass_s: float = 0.08


@kernel
def observe(
    model: int,
    um: Array,
    y: Array,
    env: Array,
    dt: float,
    rho: Array,
    slope: float,
    keep: float,
    memory: Array,
    out: Any,
) -> None:
    """Follow the measurements row by row.

    Parameters
    ----------
    model : int
    um, y : (n, 6) float64
        Inputs, and measurements at the ends of their intervals.
    env : (n, 2) float64 [rad, m]
    dt, slope : float
    rho : (6,) float64
    keep : float
        What the low-pass keeps of its last value over one sample.
    memory : (3, 6) float64
        x, f, f_low; changed in place.
    out : (n,) rows of OBSERVED
    """
    x, f, low = memory[0], memory[1], memory[2]
    k = np.empty((5, 6))
    F, G = np.empty((6, 6)), np.empty((6, 6))
    moved, z, nu = np.empty(6), np.empty(6), np.empty(6)
    for n in range(um.shape[0]):
        earth = earth_terms(env[n, 0], env[n, 1])
        runge_kutta(model, x, um[n], earth, dt, k, moved)
        state_from_output(model, y[n], z)
        whole = True
        for i in range(6):
            whole = whole and math.isfinite(z[i])
        for i in range(6):
            e = z[i] - moved[i]
            if i >= 3:
                e = wrap(e)
            delta = rho[i] * dt / slope
            nu[i] = rho[i] * e / (abs(e) + delta) if whole else 0.0
            x[i] = moved[i] + dt * nu[i]
        if whole:
            linearise(model, x, um[n], earth, F, G)
            whole = invert(G)
        if whole:
            matvec(G, nu, f)
        for i in range(6):
            low[i] = f[i] + keep * (low[i] - f[i])
            out[n].f[i] = f[i]
            out[n].f_low[i] = low[i]
            out[n].x[i] = x[i]
        out[n].used = whole


class SlidingModeObserver:
    """Faults of one IMU from what must be injected to follow the measurements.

    Parameters
    ----------
    settings
        Constants of the observer.
    x : (6,) float64 [m/s, rad]
        Initial state.
    """

    def __init__(self, settings: SlidingModeSettings, x: ArrayLike) -> None:
        if not 0.0 < settings.slope < 2.0:
            raise ValueError(f"slope is {settings.slope:g}, not between 0 and 2")
        self.settings = settings
        self._rho = np.array(settings.reach or REACH[settings.model], dtype=np.float64)
        self._memory = np.zeros((3, 6))
        self._memory[0] = x

    def run(self, um: ArrayLike, y: ArrayLike, env: ArrayLike) -> Rows:
        """Follow a recording at the settings' interval; further calls go on from the last row.

        Parameters
        ----------
        um : (n, 6) float64 [m/s^2, rad/s]
            Inputs; row k holds from measurement k - 1 to measurement k.
        y : (n, 6) float64 [m/s, rad]
            Measurements at the ends of these intervals. A row that is not finite injects nothing;
            the estimate stays.
        env : (n, 2) float64 [rad, m]
            Latitude and altitude at their starts.

        Returns
        -------
        (n,) rows of :data:`OBSERVED`
        """
        inputs = np.ascontiguousarray(um, dtype=np.float64).reshape(-1, 6)
        outputs = np.ascontiguousarray(y, dtype=np.float64).reshape(-1, 6)
        places = np.ascontiguousarray(env, dtype=np.float64).reshape(-1, 2)
        if not len(inputs) == len(outputs) == len(places):
            raise ValueError(f"{len(inputs)} inputs, {len(outputs)} outputs, {len(places)} places")
        s = self.settings
        out: Rows = np.zeros(len(inputs), OBSERVED)
        keep = math.exp(-s.dt_s / s.lowpass_s) if s.lowpass_s > 0.0 else 0.0
        observe(
            s.model,
            inputs,
            outputs,
            places,
            float(s.dt_s),
            self._rho,
            float(s.slope),
            keep,
            self._memory,
            out,
        )
        return out
