"""Plain-numpy twins of the deployed air-data kernels: the textbook form, for tests and benchmarks.

They are written from the equations in :mod:`estimators.air_data_3d`, not from its kernels: matrices
instead of loops, one joint update of all pitots instead of mean and contrasts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "air_velocity",
    "evidence",
    "huber_update",
    "lateral_model",
    "pitot_joint_update",
    "pitot_model",
    "predict",
]

Array = NDArray[np.float64]


def air_velocity(x: Array, V: Array) -> tuple[Array, float]:
    """``d = V - W - g`` and its length."""
    d = V - x[0:3] - x[3:6]
    return d, float(np.linalg.norm(d))


def predict(x: Array, P: Array, phi: float, q: Array) -> tuple[Array, Array]:
    """``x = F x``, ``P = F P F' + Q`` with the gust decaying by phi."""
    F = np.diag([1.0] * 3 + [phi] * 3 + [1.0] * 4)
    return F @ x, F @ P @ F.T + np.diag(q)


def lateral_model(x: Array, V: Array, e_y: Array) -> float:
    """``h = e_y' d - n b``, which an aircraft without sideslip keeps at zero."""
    d, n = air_velocity(x, V)
    return float(e_y @ d - n * x[9])


def pitot_model(x: Array, V: Array, ln_sigma: float) -> Array:
    """``h_i = ln(sigma_rho n) - k_i`` of the three pitots."""
    _, n = air_velocity(x, V)
    h: Array = ln_sigma + np.log(n) - x[6:9]
    return h


def huber_update(
    x: Array, P: Array, H: Array, e: float, R: float, gate: float
) -> tuple[Array, Array, float]:
    """One scalar update whose variance grows until the innovation weighs ``gate`` sigmas at most.

    The log-likelihood is Huber's: quadratic up to the gate, linear beyond, of one slope there.
    """
    S = float(H @ P @ H + R)
    nu = abs(e) / np.sqrt(S)
    cost = 0.5 * nu**2 if nu <= gate else gate * nu - 0.5 * gate**2
    S_used = S * max(nu / gate, 1.0)
    K = P @ H / S_used
    return x + K * e, P - np.outer(K, H @ P), float(-0.5 * np.log(2.0 * np.pi * S) - cost)


def pitot_joint_update(
    x: Array,
    P: Array,
    V: Array,
    y: Array,
    use: int,
    ln_sigma: float,
    R_common: float,
    R_own: float,
) -> tuple[Array, Array, float]:
    """All used pitots at once, with the covariance ``R_common 1 1' + R_own I``; no gate."""
    i = [k for k in range(3) if use >> k & 1]
    if not i:
        return x, P, 0.0
    mean = V - x[0:3]
    H = np.zeros((len(i), 10))
    H[:, 0:3] = H[:, 3:6] = -mean / (mean @ mean)
    H[range(len(i)), [6 + k for k in i]] = -1.0
    R = R_common * np.ones((len(i), len(i))) + R_own * np.eye(len(i))
    e = (y - pitot_model(x, V, ln_sigma))[i]
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    log_likelihood = -0.5 * (e @ np.linalg.solve(S, e) + np.log(np.linalg.det(2.0 * np.pi * S)))
    return x + K @ e, P - K @ H @ P, float(log_likelihood)


def evidence(L: Array, mask: int) -> float:
    """Best explanation that holds all of ``mask`` for shifted, over the best other one or 0."""
    h = np.arange(L.shape[1])
    having = (h & mask) == mask
    return float(L[:, having].max() - max(0.0, L[:, ~having].max(initial=-np.inf)))
