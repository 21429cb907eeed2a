"""The extended Kalman filter in the place of the moving horizon, for the same fault logic.

========  =====================================================  =======  =======
symbol    meaning                                                shape    wan2018
========  =====================================================  =======  =======
x, P      newest state [alpha, V_g, W_x, W_z], its covariance    (4,),    (22)
                                                                 (4, 4)
A, B, C   Jacobians of motion and outputs                        (4, 4)   (23)
Q, R      variances of motion and outputs                        (4,)     (22)
========  =====================================================  =======  =======

wan2018 section VI-A puts an EKF into step 3 of its scheme and leaves the rest: fusion, residuals,
configuration. It shares the horizon's array (:func:`estimators.air_data_mhe.window_views`), whose
newest state is the filter's; the prediction is the horizon's own. It knows no bounds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_2d import linearise
from estimators.jit import kernel

__all__ = ["ekf_predict_covariance", "ekf_update", "forget"]

Array = NDArray[np.float64]


@kernel
def ekf_predict_covariance(A: Array, B: Array, Q: Array, P: Array) -> None:
    """P becomes A P A' + B Q B'; A, B and P are (4, 4), Q the (4,) diagonal."""
    AP = np.zeros((4, 4))
    for i in range(4):
        for j in range(4):
            for k in range(4):
                AP[i, j] += A[i, k] * P[k, j]
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for k in range(4):
                total += AP[i, k] * A[j, k] + B[i, k] * Q[k] * B[j, k]
            P[i, j] = total
            P[j, i] = total


@kernel
def ekf_update(
    model: int, t_s: float, R: Array, theta: Array, air: Array, y: Array, use: Array, x: Array,
    P: Array,
) -> None:  # fmt: skip
    """Correct (x, P) by the measurements in use, all linearised at the prediction x.

    R is diagonal, so one measurement after the other gives the joint update.

    Parameters
    ----------
    model, t_s, theta, air
        As in :func:`estimators.air_data_2d.linearise`.
    R, y, use : (4,) float64
        Variances, measurements [V_g, V_z, alpha, V_c] and which count (1 or 0).
    x, P : (4,), (4, 4) float64, updated
    """
    F = np.empty(4)
    h = np.empty(4)
    jac = np.empty((3, 4, 4))
    linearise(model, x, np.zeros(4), theta, air, t_s, F, jac[0], jac[1], h, jac[2])
    C = jac[2]
    step = np.zeros(4)
    PC = np.empty(4)
    for m in range(4):
        if use[m] == 0.0:
            continue
        S = R[m]
        innovation = y[m] - h[m]
        for i in range(4):
            PC[i] = 0.0
            for j in range(4):
                PC[i] += P[i, j] * C[m, j]
        for i in range(4):
            S += C[m, i] * PC[i]
            innovation -= C[m, i] * step[i]
        for i in range(4):
            step[i] += PC[i] * innovation / S
            for j in range(4):
                P[i, j] -= PC[i] * PC[j] / S
    for i in range(4):
        x[i] += step[i]


@kernel
def forget(P: Array, a: int, variance: float) -> None:
    """Uncouple component ``a`` of a covariance and give it a new variance."""
    for i in range(P.shape[0]):
        P[i, a] = 0.0
        P[a, i] = 0.0
    P[a, a] = variance
