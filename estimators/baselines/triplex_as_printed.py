"""The fault-tolerant scheme of wan2018 section III-A word for word, around any estimator.

=============  =====================================================  ========  ========
symbol         meaning                                                shape     wan2018
=============  =====================================================  ========  ========
r              residual against the one-step prediction               (2, 3)    (17)
J              its rms over the last N_eval samples                   (2, 3)    (18)
J_th           thresholds of J: vanes [rad], pitots [m/s]             (2,)      VI-B
n_D            samples of N_eval above J_th that make a sensor        1         III-A
               faulty
beta           weight of a sensor in the fused measurement            (2, 3)    (19)
=============  =====================================================  ========  ========

No latch, no remembered wind, no roll-back: what :mod:`estimators.triplex` adds is not here, so that
the two can be compared. Channel 0 is the angle of attack, channel 1 the calibrated airspeed.

Differs: where the fusion set {J <= J_th} is empty before a fault is confirmed, which the paper
leaves open, the channel is not used in that sample. J has a floor of ``floor_share`` J_th, for
(19) divides by its square.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import air_outside, linearise
from estimators.air_data_mhe import KT, AirDataTuning

__all__ = ["PrintedLogic", "PrintedRecord", "StepEstimator", "run_as_printed"]

Array = NDArray[np.float64]


class StepEstimator(Protocol):
    """What the scheme needs: :class:`estimators.air_data_mhe.AirDataMHE`, or the EKF."""

    tuning: AirDataTuning

    def step(self, y: Array, use: Array, theta: Array) -> Array:
        """Take one sample, return the newest state [alpha, V_g, W_x, W_z]."""


@dataclass(frozen=True)
class PrintedLogic:
    """Thresholds and times of wan2018; ``n_D`` is not printed, 8 of 10 reproduces its delays."""

    N_eval: int = 10
    n_D: int = 8
    alpha_threshold_rad: float = math.radians(2.9)
    cas_threshold_m_s: float = 12 * KT
    floor_share: float = 0.02
    decide: bool = True
    """False looks at residuals only: nothing is found faulty, all sensors stay in use."""


@dataclass
class PrintedRecord:
    """What the scheme says of each sample.

    Attributes
    ----------
    x : (T, 4) float64
        [alpha, V_g, W_x, W_z] [rad, m/s].
    r, J : (T, 2, 3) float64 [rad, m/s]
    faulty : (T, 2, 3) bool
    alpha, cas : (T,) float64 [rad, m/s]
        Reconstructed values, from the filtered state.
    """

    x: Array
    r: Array
    J: Array
    faulty: NDArray[np.bool_]
    alpha: Array
    cas: Array


class _Model:
    """Prediction and outputs of the estimator's model."""

    def __init__(self, model: int, t_s: float) -> None:
        self.model, self.t_s = model, t_s
        self._air, self._zero = np.empty(2), np.zeros(4)
        self._F, self._h, self._jacobians = np.empty(4), np.empty(4), np.empty((3, 4, 4))

    def at(self, x: Array, theta: Array) -> tuple[Array, Array]:
        """Next state with u = 0, and outputs, of a state; views."""
        air_outside(theta[5], 0.0, self._air)
        A, B, C = self._jacobians
        linearise(self.model, x, self._zero, theta, self._air, self.t_s, self._F, A, B, self._h, C)
        return self._F, self._h


def run_as_printed(
    estimator: StepEstimator,
    x0: Array,
    logic: PrintedLogic,
    inertial: Array,
    vanes: Array,
    pitots: Array,
    theta: Array,
) -> PrintedRecord:
    """Steps 1 to 3 of the scheme over a flight.

    Parameters
    ----------
    estimator
        Started at ``x0``.
    x0 : (4,) float64
    inertial : (T, 2) float64 [m/s]
        V_g and V_z (down).
    vanes, pitots : (T, 3) float64 [rad], [m/s]
    theta : (T, 6) float64

    Source: wan2018 (17)-(19), Table I.
    """
    T, n = len(inertial), logic.N_eval
    model = _Model(estimator.tuning.model, estimator.tuning.t_s)
    J_th = np.array([logic.alpha_threshold_rad, logic.cas_threshold_m_s])
    value = np.stack([vanes, pitots], axis=1)  # (T, 2, 3)
    squares, above = np.zeros((n, 2, 3)), np.zeros((n, 2, 3), dtype=bool)
    out = PrintedRecord(
        x=np.empty((T, 4)),
        r=np.empty((T, 2, 3)),
        J=np.empty((T, 2, 3)),
        faulty=np.zeros((T, 2, 3), dtype=bool),
        alpha=np.empty(T),
        cas=np.empty(T),
    )
    x = np.asarray(x0, dtype=np.float64)
    previous = theta[0]
    y, use = np.empty(4), np.ones(4)
    for k in range(T):
        predicted = model.at(x, previous)[0].copy()
        h = model.at(predicted, theta[k])[1]
        r = value[k] - h[2:, None]
        squares[k % n] = r * r
        J = np.sqrt(squares.sum(axis=0) / min(k + 1, n))
        above[k % n] = J > J_th[:, None]
        faulty = (above.sum(axis=0) >= logic.n_D) & logic.decide
        healthy = ~faulty & (~above[k % n] | (not logic.decide))
        beta = healthy / np.maximum(J, logic.floor_share * J_th[:, None]) ** 2
        total = beta.sum(axis=1)
        y[:2] = inertial[k]
        use[2:] = total > 0.0
        y[2:] = (beta * value[k]).sum(axis=1) / np.where(total > 0.0, total, 1.0)
        x = estimator.step(y, use, theta[k])
        previous = theta[k]
        out.x[k], out.r[k], out.J[k], out.faulty[k] = x, r, J, faulty
        out.alpha[k], out.cas[k] = model.at(x, theta[k])[1][2:]
    return out
