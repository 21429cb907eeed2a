"""The unconstrained EKF that wan2018 compares with, through filterpy's own filter.

========  ====================================================  ========
symbol    meaning                                               wan2018
========  ====================================================  ========
x, P      state [alpha, V_g, W_x, W_z] and its covariance       (22)
F, B, H   Jacobians A, B, C of :mod:`estimators.air_data_2d`    (23)
Q         process covariance, B Q B'                            VI
========  ====================================================  ========

Predict and update are filterpy's; this file only linearises. The paper gives the EKF the MHE's Q
and R "to ensure a fair comparison"; but the MHE's arrival prior has already used its window's
data, which counts each sample about N times. A fair EKF therefore has its own wind noise (``q_w``).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import air_outside, linearise
from estimators.air_data_mhe import ROW_P, ROW_Q, ROW_R, AirDataTuning

__all__ = ["AirDataEKF"]

Array = NDArray[np.float64]


class AirDataEKF:
    """An EKF with the interface of :class:`estimators.air_data_mhe.AirDataMHE`.

    Parameters
    ----------
    tuning : AirDataTuning
        Its bounds, horizon and iteration counts are not used.
    x0, theta0 : (4,), (6,) float64
    q_w : float, optional
        Variance of the wind's rate [m^2/s^4] in place of the tuning's.

    Raises
    ------
    ImportError
        When filterpy is not installed (extra ``compare``).
    """

    def __init__(
        self, tuning: AirDataTuning, x0: Array, theta0: Array, q_w: float | None = None
    ) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        table = tuning.table()
        self.tuning = tuning
        self.filter: Any = ExtendedKalmanFilter(dim_x=4, dim_z=4)
        self.filter.x = np.asarray(x0, dtype=np.float64).copy()
        self.filter.P = np.diag(table[ROW_P])
        self.Q = np.diag(table[ROW_Q])
        self.R = table[ROW_R]
        if q_w is not None:
            self.Q[2, 2] = self.Q[3, 3] = q_w
        self.theta = np.asarray(theta0, dtype=np.float64).copy()
        self._F, self._h, self._air = np.empty(4), np.empty(4), np.empty(2)
        self._A, self._B, self._C = np.empty((3, 4, 4))

    def _linearise(self, theta: Array, warmer_k: float) -> None:
        air_outside(theta[5], warmer_k, self._air)
        linearise(
            self.tuning.model, self.filter.x, np.zeros(4), theta, self._air, self.tuning.t_s,
            self._F, self._A, self._B, self._h, self._C,
        )  # fmt: skip

    def step(self, y: Array, use: Array, theta: Array, warmer_k: float = 0.0) -> Array:
        """Take one sample and return the newest state, shape (4,). Arguments as AirDataMHE.step."""
        self._linearise(self.theta, warmer_k)
        self.filter.F = self._A.copy()
        self.filter.Q = self._B @ self.Q @ self._B.T
        moved = self._F.copy()
        self.filter.predict_x = lambda u=0: setattr(self.filter, "x", moved)
        self.filter.predict()
        self.theta = np.asarray(theta, dtype=np.float64).copy()
        self._linearise(self.theta, warmer_k)
        on = np.asarray(use) != 0.0
        C, h = self._C[on].copy(), self._h[on].copy()
        self.filter.update(
            np.asarray(y, dtype=np.float64)[on], lambda x: C, lambda x: h, R=np.diag(self.R[on])
        )
        newest: Array = self.filter.x.copy()
        return newest
