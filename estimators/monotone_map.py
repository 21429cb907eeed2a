"""The most probable history of faults that can only grow, over a moving window of residuals.

========  ==================================================================  ==========  =========
symbol    meaning                                                             shape       samar2006
========  ==================================================================  ==========  =========
y         residuals, observed minus predicted accelerations                   (N, m)      (2)
S         signatures: residual per unit of each fault                         (N, m, p)   (7), (8)
f         faults, in the unit of 1/S (here %)                                 (N, p)      (7)
Q, W      covariance of e = y - S f and its inverse                           (m, m)      (9)
lam       mean step of each fault from one row to the next                    (p,)        (11)
R, R_inv  covariance of f_1 about f_bar and its inverse                       (p, p)      (17)
f_bar     estimate of the window's first point by the window before           (p,)        (17)
N         rows in the window                                                              III-C
========  ==================================================================  ==========  =========

The window's programme is

    minimise    1/2 sum_k (y_k - S_k f_k)' W (y_k - S_k f_k) + prior(f) + 1/2 |f_1 - f_bar|^2_R_inv
    subject to  f_{k+1} >= f_k,  f_1 >= 0

with prior(f) = sum_i (f_N,i - f_1,i) / lam_i as printed, or (f_N,i - f_bar,i) / lam_i
("continued"). It is handed to :mod:`estimators.monotone_qp` as H_k = S_k' W S_k,
q_k = -S_k' W y_k, computed once for each row however long the row stays in the window.

Differs: (15) sums one step past the data, here it ends at the newest row. The printed prior charges
nothing for a fault that is the same all through the window, so that noise carries f_1, and then
f_bar, up by as much as R/lam at every step where the data say little. The continued prior charges
the step from f_bar to f_1 like every other and is the default.
f_1 >= 0 is part of the programme, as faults begin at zero; f_bar is zero until the window is full.
A row with a NaN says nothing: it enters with H_k = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.monotone_qp import (
    MAX_ITERATIONS,
    NOT_CONVERGED,
    SOLVED,
    TOLERANCE,
    solve_monotone,
    start_at_least,
    start_sizes,
    work_size,
)

__all__ = ["CONTINUED", "PRINTED", "MapTuning", "MonotoneMap", "Run", "normal_rows", "solve_window"]

Array = NDArray[np.float64]

PRINTED, CONTINUED = 0, 1
"""The two forms of the prior."""

WARM = 0.1
"""A warm start keeps steps and multipliers at least this share of a cold start's off their bounds.
It saves up to a fifth of the iterations; a smaller share loses that to steps along the bounds."""


@kernel
def normal_row(y: Array, S: Array, W: Array, H: Array, q: Array) -> bool:
    """H = S' W S and q = -S' W y of one row; both zero, and False, when the row is not finite."""
    m, p = S.shape
    sound = True
    for a in range(m):
        sound = sound and math.isfinite(y[a])
        for i in range(p):
            sound = sound and math.isfinite(S[a, i])
    for i in range(p):
        q[i] = 0.0
        for j in range(p):
            H[i, j] = 0.0
    if not sound:
        return False
    for a in range(m):
        wy = 0.0
        for b in range(m):
            wy += W[a, b] * y[b]
        for i in range(p):
            q[i] -= S[a, i] * wy
    for j in range(p):
        for a in range(m):
            ws = 0.0
            for b in range(m):
                ws += W[a, b] * S[b, j]
            for i in range(j + 1):
                H[i, j] += S[a, i] * ws
    for j in range(p):
        for i in range(j):
            H[j, i] = H[i, j]
    return True


@kernel
def normal_rows(y: Array, S: Array, W: Array, H: Array, q: Array) -> int:
    """:func:`normal_row` for many rows; returns how many were finite."""
    sound = 0
    for k in range(len(y)):
        sound += normal_row(y[k], S[k], W, H[k], q[k])
    return sound


@kernel
def solve_window(
    prior: int,
    H: Array,
    q: Array,
    slope: Array,
    R_inv: Array,
    f_bar: Array,
    warm: bool,
    s: Array,
    z: Array,
    f: Array,
    tolerance: float,
    work: Array,
) -> tuple[int, int, float]:
    """Solve one window: add the prior to its rows, solve, take the prior off again.

    Parameters
    ----------
    prior
        :data:`PRINTED` or :data:`CONTINUED`.
    H, q : (N, p, p), (N, p) float64
        Rows of :func:`normal_row`; unchanged on return.
    slope : (p,) float64
        1 / lam.
    R_inv, f_bar : (p, p), (p,) float64
    warm
        Start from the s and z that come in; a window that does not solve so is tried again cold.
    s, z, f : (N, p) float64
        As of :func:`estimators.monotone_qp.solve_monotone`.
    tolerance
        See :data:`estimators.monotone_qp.TOLERANCE`.
    work : (window_work_size(N, p),) float64, overwritten

    Returns
    -------
    status, iterations, cost
        The cost leaves out the terms that do not depend on f: 1/2 y'Wy of every row,
        1/2 f_bar' R_inv f_bar and, with the continued prior, -slope' f_bar.
    """
    N, p = q.shape
    kept = work[: p * (p + 2)].reshape(p + 2, p)
    for i in range(p):
        kept[p, i], kept[p + 1, i] = q[0, i], q[N - 1, i]
        for j in range(p):
            kept[i, j] = H[0, i, j]
    for i in range(p):
        if prior == PRINTED:
            q[0, i] -= slope[i]
        q[N - 1, i] += slope[i]
        for j in range(p):
            H[0, i, j] += R_inv[i, j]
            q[0, i] -= R_inv[i, j] * f_bar[j]
    step, multiplier = start_sizes(H, q)
    iterations = 0
    status, cost = NOT_CONVERGED, 0.0
    if warm:
        start_at_least(WARM * step, WARM * multiplier, s, z)
        status, iterations, cost = solve_monotone(
            H, q, s, z, f, tolerance, MAX_ITERATIONS, work[p * (p + 2) :]
        )
    if status == NOT_CONVERGED:
        for k in range(N):
            for i in range(p):
                s[k, i] = step
                z[k, i] = multiplier
        status, again, cost = solve_monotone(
            H, q, s, z, f, tolerance, MAX_ITERATIONS, work[p * (p + 2) :]
        )
        iterations += again
    for i in range(p):
        q[N - 1, i] = kept[p + 1, i]
        q[0, i] = kept[p, i]
        for j in range(p):
            H[0, i, j] = kept[i, j]
    return status, iterations, cost


def window_work_size(N: int, p: int) -> int:
    """Length of the scratch array that :func:`solve_window` needs."""
    return work_size(N, p) + p * (p + 2)


@kernel
def run_horizon(
    prior: int,
    y: Array,
    S: Array,
    W: Array,
    slope: Array,
    R_inv: Array,
    tolerance: float,
    H: Array,
    q: Array,
    s: Array,
    z: Array,
    f: Array,
    f_bar: Array,
    last: Array,
    count: NDArray[np.int64],
    work: Array,
    newest: Array,
    status: NDArray[np.int64],
    iterations: NDArray[np.int64],
) -> None:
    """Take rows one after the other into the moving window and solve it at each.

    Parameters
    ----------
    prior, W, slope, R_inv, tolerance
        Tuning.
    y, S : (n, m), (n, m, p) float64
        New rows.
    H, q, s, z, f, f_bar, last : (N, p, p), (N, p), ..., (p,), (p,) float64
        State: the window's normal rows, its last solution, the prior mean, and f_N of the newest
        window that was solved.
    count : (2,) int64
        State: rows in the window; 1 where s and z are those of a solved window.
    work : (window_work_size(N, p),) float64, overwritten
    newest : (n, p) float64, written
        f_N after each row; where the window was not solved, the one before (0 before the first).
    status, iterations : (n,) int64, written

    Source: samar2006 III-C, (17).
    """
    N, p = q.shape
    for row in range(len(y)):
        if count[0] == N:
            for i in range(p):
                if count[1] == 1:
                    f_bar[i] = f[1, i] if N > 1 else f[0, i]
                if N > 1:
                    s[1, i] += s[0, i]
            for k in range(N - 1):
                for i in range(p):
                    q[k, i], s[k, i], z[k, i] = q[k + 1, i], s[k + 1, i], z[k + 1, i]
                    for j in range(p):
                        H[k, i, j] = H[k + 1, i, j]
        else:
            count[0] += 1
        n = count[0]
        normal_row(y[row], S[row], W, H[n - 1], q[n - 1])
        for i in range(p):
            s[n - 1, i] = z[n - 1, i] = 0.0
        status[row], iterations[row], _ = solve_window(
            prior, H[:n], q[:n], slope, R_inv, f_bar, count[1] == 1, s[:n], z[:n], f[:n],
            tolerance, work,
        )  # fmt: skip
        sound = status[row] == SOLVED
        count[1] = 1 if sound else 0
        for i in range(p):
            if sound:
                last[i] = f[n - 1, i]
            newest[row, i] = last[i]


@dataclass(frozen=True)
class MapTuning:
    """What the estimator is told.

    Attributes
    ----------
    Q : (m, m) float64
        Covariance of the residuals of a healthy aircraft.
    lam : (p,) float64
        Mean step of each fault from row to row.
    R : (p, p) float64
        Covariance of the window's first point about what the window before said.
    N
        Rows in the window.
    prior
        :data:`CONTINUED`, or :data:`PRINTED` to repeat the paper.
    tolerance
        See :data:`estimators.monotone_qp.TOLERANCE`.
    """

    Q: Array
    lam: Array
    R: Array
    N: int = 50
    prior: int = CONTINUED
    tolerance: float = TOLERANCE


@dataclass(frozen=True)
class Run:
    """What the window said at each row.

    Attributes
    ----------
    f : (n, p) float64
        The newest point of the window.
    status, iterations : (n,) int64
        Of each row's programme: constants of :mod:`estimators.monotone_qp`.
    """

    f: Array
    status: NDArray[np.int64]
    iterations: NDArray[np.int64]


class MonotoneMap:
    """Moving-horizon MAP estimator of monotone faults.

    Parameters
    ----------
    tuning : MapTuning

    Raises
    ------
    numpy.linalg.LinAlgError
        When Q or R is singular.
    """

    def __init__(self, tuning: MapTuning) -> None:
        p, N = len(tuning.lam), tuning.N
        self.tuning = tuning
        self.W = np.ascontiguousarray(np.linalg.inv(tuning.Q))
        self.R_inv = np.ascontiguousarray(np.linalg.inv(tuning.R))
        self.slope = 1.0 / np.asarray(tuning.lam, float)
        self.H = np.zeros((N, p, p))
        self.q, self.s, self.z, self._f = np.zeros((4, N, p))
        self.f_bar, self._last = np.zeros((2, p))
        self._count = np.zeros(2, np.int64)
        self._work = np.empty(window_work_size(N, p))

    @property
    def f(self) -> Array:
        """Faults over the present window (rows so far, p)."""
        return self._f[: self._count[0]].copy()

    def run(self, y: Array, S: Array) -> Run:
        """Take rows in order; the state is that of one row after the other.

        Parameters
        ----------
        y, S : (n, m), (n, m, p) float64
        """
        n, p = len(y), len(self.slope)
        out = Run(np.empty((n, p)), np.empty(n, np.int64), np.empty(n, np.int64))
        run_horizon(
            self.tuning.prior, np.ascontiguousarray(y), np.ascontiguousarray(S), self.W,
            self.slope, self.R_inv, self.tuning.tolerance, self.H, self.q, self.s, self.z, self._f,
            self.f_bar, self._last, self._count, self._work, out.f, out.status, out.iterations,
        )  # fmt: skip
        return out
