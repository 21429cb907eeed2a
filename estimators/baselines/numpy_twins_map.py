"""Numpy twins of :mod:`estimators.monotone_map`: dense matrices, textbook order, no structure used.

For tests and as readable statements of the equations; symbols are those of the compiled modules.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["monotone_qp", "normal_rows", "recursion", "window_terms"]

Array = NDArray[np.float64]


def normal_rows(y: Array, S: Array, W: Array) -> tuple[Array, Array]:
    """H_k = S_k' W S_k and q_k = -S_k' W y_k; zero for a row that is not finite."""
    finite = np.isfinite(np.hstack([y, S.reshape(len(y), -1)]))
    sound: NDArray[np.bool_] = np.asarray(finite.all(axis=1))
    y, S = np.where(sound[:, None], y, 0.0), np.where(sound[:, None, None], S, 0.0)
    H = np.einsum("kai,ab,kbj->kij", S, W, S)
    return H, -np.einsum("kai,ab,kb->ki", S, W, y)


def window_terms(
    H: Array, q: Array, lam: Array, R_inv: Array, f_bar: Array, printed: bool
) -> tuple[Array, Array]:
    """The rows' terms with the prior of the first and the last point. Source: samar2006 (17)."""
    H, q = H.copy(), q.copy()
    q[-1] += 1.0 / lam
    if printed:
        q[0] -= 1.0 / lam
    H[0] += R_inv
    q[0] -= R_inv @ f_bar
    return H, q


def monotone_qp(H: Array, q: Array, gap: float = 1e-11) -> tuple[Array, float]:
    """Levels f and cost of min sum 1/2 f_k'H_k f_k + q_k'f_k with D f >= 0.

    A primal-dual interior point with half-way centring on the full matrix
    [[H, -D'], [D, diag(s/z)]]; slow, and hard to get wrong.

    Raises
    ------
    RuntimeError
        When two hundred iterations do not close the gap.
    """
    N, p = q.shape
    n = N * p
    big = np.zeros((n, n))
    for k in range(N):
        big[k * p : (k + 1) * p, k * p : (k + 1) * p] = H[k]
    D = np.eye(n) - np.eye(n, k=-p)
    lin = q.ravel()
    s, z = np.ones(n), np.full(n, np.sqrt(1.0 + np.diag(big).max()))
    for _ in range(200):
        f = np.cumsum(s.reshape(N, p), axis=0).ravel()
        dual = big @ f + lin - D.T @ z
        if s @ z < gap and np.abs(dual).max() < 1e-9 * (1.0 + np.abs(lin).max()):
            return f.reshape(N, p), float(0.5 * f @ big @ f + lin @ f)
        centred = 0.1 * (s @ z) / n
        K = np.block([[big, -D.T], [D, np.diag(s / z)]])
        d = np.linalg.solve(K, np.concatenate([-dual, centred / z - s]))
        v, dz = D @ d[:n], d[n:]
        step = min(1.0, 0.9 / max(np.max(-v / s), np.max(-dz / z), 1e-300))
        s, z = s + step * v, z + step * dz
    raise RuntimeError("the gap does not close")


def recursion(
    y: Array, S: Array, W: Array, lam: Array, R_inv: Array, N: int, printed: bool
) -> Array:
    """Newest point of the moving window after each row. Source: samar2006 III-C."""
    H, q = normal_rows(y, S, W)
    f_bar = np.zeros(S.shape[2])
    out = np.empty((len(y), S.shape[2]))
    for t in range(len(y)):
        rows = slice(max(0, t - N + 1), t + 1)
        f, _ = monotone_qp(*window_terms(H[rows], q[rows], lam, R_inv, f_bar, printed))
        if len(f) == N:
            f_bar = f[min(1, N - 1)]
        out[t] = f[-1]
    return out
