"""The constrained horizon solved to convergence: primal-dual steps on Algorithm 2.

========  ==========================================================  =============
symbol    meaning                                                     shape
========  ==========================================================  =============
x, u      steps from the linearisation point                          (N,n) (N-1,p)
z         multipliers of the lower and the upper bounds               as x, u
s         slack, the distance to a bound                              as x, u
kappa     target of multiplier times slack
========  ==========================================================  =============

The window's symbols are those of :mod:`estimators.mhe`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.mhe import BOUNDS_CROSSED, NON_FINITE, NOT_CONVERGED, SOLVED, kkt_step, start_inside
from estimators.mhe_four import kkt_step_four

__all__ = ["converged_qp"]

Array = NDArray[np.float64]

BOUNDARY_SHARE = 0.995
"""Share of the way to the boundary that a primal-dual step may go (usual in the literature)."""
CENTRING = 0.15
"""Target of a primal-dual iteration as a share of the present complementarity, at most."""


@kernel
def _pd_barrier(
    v: Array, lo: Array, hi: Array, zl: Array, zu: Array, kappa: float, g: Array, D: Array
) -> None:
    """Barrier gradient and primal-dual second derivative z / slack."""
    for i in range(v.shape[0]):
        for a in range(v.shape[1]):
            up = hi[i, a] - v[i, a]
            down = v[i, a] - lo[i, a]
            g[i, a] = kappa * (1.0 / up - 1.0 / down)
            D[i, a] = zu[i, a] / up + zl[i, a] / down


@kernel
def _pd_multiplier_step(
    v: Array, d: Array, lo: Array, hi: Array, zl: Array, zu: Array, kappa: float, s: float
) -> tuple[float, float]:
    """Longest (primal, dual) step to the boundary when s < 0; else move the multipliers by s."""
    primal = 1.0
    dual = 1.0
    for i in range(v.shape[0]):
        for a in range(v.shape[1]):
            up = hi[i, a] - v[i, a]
            if up < np.inf:
                dz = (kappa + zu[i, a] * d[i, a]) / up - zu[i, a]
                if s >= 0.0:
                    zu[i, a] += s * dz
                else:
                    if d[i, a] > 0.0:
                        primal = min(primal, BOUNDARY_SHARE * up / d[i, a])
                    if dz < 0.0:
                        dual = min(dual, -BOUNDARY_SHARE * zu[i, a] / dz)
            down = v[i, a] - lo[i, a]
            if down < np.inf:
                dz = (kappa - zl[i, a] * d[i, a]) / down - zl[i, a]
                if s >= 0.0:
                    zl[i, a] += s * dz
                else:
                    if d[i, a] < 0.0:
                        primal = min(primal, -BOUNDARY_SHARE * down / d[i, a])
                    if dz < 0.0:
                        dual = min(dual, -BOUNDARY_SHARE * zl[i, a] / dz)
    return primal, dual


@kernel
def _pd_gap(v: Array, lo: Array, hi: Array, zl: Array, zu: Array) -> tuple[float, int]:
    """Sum of multiplier times slack, and the number of bounds."""
    gap = 0.0
    count = 0
    for i in range(v.shape[0]):
        for a in range(v.shape[1]):
            if hi[i, a] < np.inf:
                gap += zu[i, a] * (hi[i, a] - v[i, a])
                count += 1
            if lo[i, a] > -np.inf:
                gap += zl[i, a] * (v[i, a] - lo[i, a])
                count += 1
    return gap, count


@kernel
def _pd_start(v: Array, lo: Array, hi: Array, zl: Array, zu: Array, kappa: float) -> None:
    """Multipliers on the central path of kappa; zero where there is no bound."""
    for i in range(v.shape[0]):
        for a in range(v.shape[1]):
            zu[i, a] = kappa / (hi[i, a] - v[i, a])
            zl[i, a] = kappa / (v[i, a] - lo[i, a])


@kernel
def converged_qp(
    P: Array,
    Q: Array,
    R: Array,
    A: Array,
    B: Array,
    C: Array,
    f: Array,
    rx: Array,
    ru: Array,
    ry: Array,
    xl: Array,
    xu: Array,
    ul: Array,
    uu: Array,
    tol: float,
    max_iterations: int,
    x: Array,
    u: Array,
    work: Array,
) -> int:
    """Solve the window to the complementarity ``tol`` by primal-dual steps; returns a status.

    Parameters
    ----------
    P, Q, R, A, B, C, f, rx, ru, ry, xl, xu, ul, uu
        The window, as in the module's table.
    tol : float
        Mean of multiplier times slack at which the solution is accepted (a share of the cost).
    max_iterations : int
    x, u : (N, n), (N-1, p) float64, written
        Steps from the linearisation point.
    work : (work_size(N, n, p, m),) float64, overwritten

    Differs: Algorithm 1 is a primal barrier method, whose Newton steps shrink to nothing near an
    active bound as kappa falls; with z / slack for kappa / slack^2 the same Algorithm 2 gives the
    primal-dual step, which keeps its length.
    """
    N, n = x.shape
    p = Q.size
    if not (start_inside(x, xl, xu) and start_inside(u, ul, uu)):
        return BOUNDS_CROSSED
    at = work.size - 8 * (N * n + N * p)
    block = work[at:]
    vx = block[: 5 * N * n].reshape(5, N, n)
    vu = block[5 * N * n : 5 * (N * n + N * p)].reshape(5, N, p)
    gx, Dx, dx, zxl, zxu = vx[0], vx[1], vx[2], vx[3], vx[4]
    M = N - 1
    gu, Du, du, zul, zuu = vu[0, :M], vu[1, :M], vu[2, :M], vu[3, :M], vu[4, :M]
    kappa = 1.0
    _pd_start(x, xl, xu, zxl, zxu, kappa)
    _pd_start(u, ul, uu, zul, zuu, kappa)
    for _ in range(max_iterations):
        _pd_barrier(x, xl, xu, zxl, zxu, kappa, gx, Dx)
        _pd_barrier(u, ul, uu, zul, zuu, kappa, gu, Du)
        if n == 4 and p == 4 and R.size == 4:
            kkt_step_four(P, Q, R, A, B, C, f, rx, ru, ry, x, u, gx, Dx, gu, Du, dx, du, work)
        else:
            kkt_step(P, Q, R, A, B, C, f, rx, ru, ry, x, u, gx, Dx, gu, Du, dx, du, work)
        total = 0.0
        for i in range(N):
            for a in range(n):
                total += dx[i, a]
        if not np.isfinite(total):
            x[:] = 0.0
            u[:] = 0.0
            return NON_FINITE
        p1, d1 = _pd_multiplier_step(x, dx, xl, xu, zxl, zxu, kappa, -1.0)
        p2, d2 = _pd_multiplier_step(u, du, ul, uu, zul, zuu, kappa, -1.0)
        s = min(p1, p2)
        z = min(d1, d2)
        _pd_multiplier_step(x, dx, xl, xu, zxl, zxu, kappa, z)
        _pd_multiplier_step(u, du, ul, uu, zul, zuu, kappa, z)
        for i in range(N):
            for a in range(n):
                x[i, a] += s * dx[i, a]
        for i in range(N - 1):
            for a in range(p):
                u[i, a] += s * du[i, a]
        gap_x, count_x = _pd_gap(x, xl, xu, zxl, zxu)
        gap_u, count_u = _pd_gap(u, ul, uu, zul, zuu)
        count = count_x + count_u
        if count == 0:
            return SOLVED
        mean = (gap_x + gap_u) / count
        if mean < tol and s > 0.9:
            return SOLVED
        kappa = min(CENTRING * mean, mean * np.sqrt(mean))
    return NOT_CONVERGED
