"""Plain-numpy twins of the long horizon: dense matrices over the whole window, for tests.

Written from the equations in :mod:`estimators.air_horizon` and :mod:`estimators.air_horizon_stage`.
A window of n stages is one Gaussian of 10 n numbers: its prior comes from arrival and dynamics, its
data from all rows at once. Nothing is solved stage by stage here.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["Epoch", "gaussian", "joint_prior", "lateral_mean", "pitot_mean", "posterior"]

Array = NDArray[np.float64]
Epoch = tuple[Array, Array, Array]
"""V, e_y (3,) and y (3,) of one epoch."""


def lateral_mean(epochs: Sequence[Epoch], W: Array, b: float, W_n: Array) -> float:
    """Mean of ``e_y' (V - W) - n b`` with n taken at the wind W_n."""
    return float(np.mean([e_y @ (V - W) - np.linalg.norm(V - W_n) * b for V, e_y, _ in epochs]))


def pitot_mean(epochs: Sequence[Epoch], W: Array, ln_sigma: float, k: Array) -> Array:
    """Mean of ``y_i - ln(sigma_rho |V - W|) + k_i`` of every pitot."""
    residuals = [y - ln_sigma - np.log(np.linalg.norm(V - W)) + k for V, _, y in epochs]
    return np.asarray(np.mean(residuals, axis=0))


def joint_prior(
    x_p: Array, P: Array, A: Sequence[Array], B: Sequence[Array]
) -> tuple[Array, Array]:
    """Mean (10 n,) and covariance of all stages' states before any row is used."""
    n, d = len(A) + 1, len(x_p)
    mean, cov = np.zeros(n * d), np.zeros((n * d, n * d))
    mean[:d], cov[:d, :d] = x_p, P
    for i in range(1, n):
        new, old = slice(i * d, (i + 1) * d), slice((i - 1) * d, i * d)
        F = A[i - 1]
        mean[new] = F @ mean[old]
        cov[new, : i * d] = F @ cov[old, : i * d]
        cov[: i * d, new] = cov[new, : i * d].T
        cov[new, new] = F @ cov[old, old] @ F.T + B[i - 1] @ B[i - 1].T
    return mean, cov


def gaussian(C: Array, ry: Array) -> tuple[Array, Array]:
    """Rows of all stages as one matrix and vector; unused (zero) rows are left out.

    Parameters
    ----------
    C : (n, m, 10) float64
    ry : (n, m) float64
    """
    n, m, d = C.shape
    H, y = np.zeros((n * m, n * d)), ry.reshape(-1)
    for i in range(n):
        H[i * m : (i + 1) * m, i * d : (i + 1) * d] = C[i]
    used = np.abs(H).sum(axis=1) > 0.0
    return H[used], y[used]


def posterior(mean: Array, cov: Array, H: Array, y: Array) -> tuple[Array, Array, float]:
    """Posterior mean and covariance, and the log of the data's likelihood without 2 pi terms."""
    V = H @ cov @ H.T + np.eye(len(y))
    nu = y - H @ mean
    gain = np.linalg.solve(V, H @ cov).T
    L = -0.5 * (nu @ np.linalg.solve(V, nu) + np.linalg.slogdet(V)[1])
    return mean + gain @ nu, cov - gain @ H @ cov, float(L)
