"""The engine models of the watch as linear systems for the intermittent-measurement filter.

========  ========================================================  =======  =============
symbol    meaning                                                   shape    unit
========  ========================================================  =======  =============
N         speed of the shaft that throttle and airspeed explain     1        rpm
b         what they do not explain: wear, weather, curvature        1        rpm
t, V      throttle from 0 to 1, airspeed                            1        1, m/s
phi       inputs (1, t, t^2, V, t V) of the single-shaft curve      (5,)
G         shaft speeds from the state                               (S, n)
========  ========================================================  =======  =============

Single shaft: ``tau dN/dt = c phi - N``, ``b' = -b / T + noise`` with a stationary deviation sigma,
a channel reads N + b. The error b is bounded on purpose: a lone channel that drifts beyond it is
told from an engine that differs a little from its model.

Two spools: wang2020's linear engine, its samples composed to one step of the watch.

No model: a speed may change as fast as a throttle step changes it. Only channels of one shaft that
contradict each other are told apart by it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.imkf import LinearModel
from estimators.jit import kernel

__all__ = [
    "N_FEATURES",
    "EngineModel",
    "envelope",
    "features",
    "free_shaft",
    "single_shaft",
    "two_spool",
]

Array = NDArray[np.float64]

N_FEATURES = 5
WALK_SHARE = 0.13
"""A free speed changes by this share of its range in one second [1 / sqrt(s)]: with a throttle step
of a fast electric motor every second or two."""
OWN_NOISE = 0.02
"""Process noise of N, as a share of the model's error: it keeps the covariance regular."""


@dataclass(frozen=True, slots=True)
class EngineModel:
    """A linear system and which of its sums are shaft speeds.

    Attributes
    ----------
    linear
        In rpm.
    G : (S, n) float64
        Shaft speeds are ``G x``.
    x, P : (n,), (n, n) float64
        Before the first reading.
    """

    linear: LinearModel
    G: Array
    x: Array
    P: Array


def features(throttle: Array, airspeed_m_s: Array) -> Array:
    """Inputs of the single-shaft curve, (k, 5) float64; NaN where throttle or airspeed is."""
    t, V = np.asarray(throttle, float), np.asarray(airspeed_m_s, float)
    return np.stack([np.ones_like(t) + 0.0 * t, t, t * t, V, t * V], axis=-1)


@kernel
def envelope(past: Array, x: Array) -> tuple[Array, Array]:
    """Least and largest of each row of `x` and the rows before it.

    Parameters
    ----------
    past : (h, m) float64, changed in place
        As many rows before; NaN where there were none.
    x : (K, m) float64
    """
    h, m = past.shape
    least, most = x.copy(), x.copy()
    for k in range(x.shape[0]):
        for i in range(m):
            for back in range(h):
                value = past[back, i]
                if value < least[k, i]:
                    least[k, i] = value
                if value > most[k, i]:
                    most[k, i] = value
        past[:-1] = past[1:].copy()
        past[-1] = x[k]
    return least, most


def single_shaft(
    time_constant_s: float,
    coefficients: Sequence[float],
    error_rpm: float,
    error_time_s: float,
    noise_rpm: Array,
    range_rpm: float,
    tick_s: float,
) -> EngineModel:
    """One shaft that follows throttle and airspeed.

    Parameters
    ----------
    time_constant_s, coefficients
        tau [s] and c (5,) over :func:`features`.
    error_rpm, error_time_s
        sigma [rpm] and T [s] of b.
    noise_rpm : (m,) float64
        Standard deviation of each channel's readings [rpm].
    range_rpm
        Largest speed, for the uncertainty at the start [rpm].
    tick_s
        Step [s].
    """
    alpha, rho = math.exp(-tick_s / time_constant_s), math.exp(-tick_s / error_time_s)
    C = np.tile([1.0, 1.0], (len(noise_rpm), 1))
    B = np.zeros((2, N_FEATURES))
    B[0] = (1.0 - alpha) * np.asarray(coefficients, float)
    own = (OWN_NOISE * error_rpm) ** 2 * (1.0 - alpha * alpha)
    Q = np.diag([own, error_rpm**2 * (1.0 - rho * rho)])
    linear = LinearModel(np.diag([alpha, rho]), B, C, Q, np.square(noise_rpm), tick_s)
    P = np.diag([range_rpm**2, error_rpm**2])
    return EngineModel(linear, np.array([[1.0, 1.0]]), np.zeros(2), P)


def free_shaft(noise_rpm: Array, range_rpm: float, tick_s: float) -> EngineModel:
    """One shaft of which nothing is known; parameters as of :func:`single_shaft`."""
    Q = np.array([[(WALK_SHARE * range_rpm) ** 2 * tick_s]])
    C = np.ones((len(noise_rpm), 1))
    linear = LinearModel(np.eye(1), np.zeros((1, 1)), C, Q, np.square(noise_rpm), tick_s)
    return EngineModel(linear, np.eye(1), np.zeros(1), np.array([[range_rpm**2]]))


def two_spool(
    a: Array,
    b: Array,
    sample_s: float,
    process_std: float,
    full_scale_rpm: Sequence[float],
    shafts: NDArray[np.int64],
    noise_rpm: Array,
    tick_s: float,
) -> EngineModel:
    """Two spools of a jet, composed to the step of the watch and scaled to rpm.

    Parameters
    ----------
    a, b : (2, 2) float64
        A and B over one sample, of shares of the design limits.
    sample_s, process_std
        Sample time [s], noise of each speed in one sample.
    full_scale_rpm
        Design limits (2,).
    shafts : (m,) int64
        Which spool each channel measures.
    noise_rpm : (m,) float64
        Standard deviation of each channel's readings [rpm].
    tick_s
        Step, rounded to whole samples [s].
    """
    n = max(round(tick_s / sample_s), 1)
    A, B, Q = np.eye(2), np.zeros((2, 2)), np.zeros((2, 2))
    for _ in range(n):
        A, B, Q = a @ A, a @ B + b, a @ Q @ a.T + process_std**2 * np.eye(2)
    scale = np.asarray(full_scale_rpm, float)
    reads = scale[shafts]
    C = np.eye(2)[shafts]
    shares = LinearModel(A, B, C, Q, np.square(noise_rpm / reads), n * sample_s)
    return EngineModel(
        shares.scaled(scale, np.ones(2), reads), np.eye(2), 0.5 * scale, np.diag(scale**2)
    )
