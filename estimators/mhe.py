"""Moving-horizon estimation: the constrained quadratic programme of one window, solved by stages.

========  ==========================================================  =============  ============
symbol    meaning                                                     shape          wan2018
========  ==========================================================  =============  ============
x, u      steps dx, du from the linearisation point                   (N,n) (N-1,p)  (42)
A, B, f   dx_{i+1} = f_i + A_i dx_i + B_i du_i                        (N-1, ...)     (42b)
C, ry     ry_i = C_i dx_i + noise; an unused row of C and ry is zero  (N,m,n) (N,m)  (42a)
rx, ru    prior mean minus linearisation point (x_l, u_i)             (n) (N-1,p)    (42a)
P         arrival covariance, full                                    (n, n)         (22)
Q, R      variances of u and y                                        (p) (m)        (22)
xl, xu    bounds on dx, infinite where there is none                  (N, n)         (42b)
ul, uu    bounds on du                                                (N-1, p)       (42b)
kappa     barrier parameter                                                          (43)
gx, gu    gradient of the barrier, kappa grad(phi)                    as x, u        (46a)
Dx, Du    its second derivative, kappa L'L                            as x, u        (46b)
lam       multiplier of the dynamics                                  (n)            Alg. 2
========  ==========================================================  =============  ============

Nothing here knows an aircraft: :mod:`estimators.air_data_mhe` linearises the longitudinal model of
the paper, a model with linear dynamics and any measurement function does the same with its own
arrays. The cost of a stage does not depend on N.

Differs: (46e) uses C_i dx_i (the paper prints dx_l), (46d) is multiplied by Q_bar, the line search
stays strictly inside the bounds, a start outside is first moved inside, and kappa falls after every
n_qp iterations. Lines 4-5 of Algorithm 2 take one measurement row at a time (R is diagonal), so
that a barrier row scales its variance by 1/(1 + D P_jj) instead of subtracting two nearly equal
numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.mhe_four import kkt_step_four

__all__ = [
    "BOUNDS_CROSSED",
    "NON_FINITE",
    "NOT_CONVERGED",
    "SOLVED",
    "barrier_qp",
    "kkt_step",
    "start_inside",
    "work_size",
]

Array = NDArray[np.float64]

SOLVED = 0
"""The schedule was run, or the tolerance was met."""
NOT_CONVERGED = 1
"""The iterations ran out: the point is feasible and may be used with care."""
NON_FINITE = 2
"""A NaN or infinity came in or arose: the step is zero, keep the prediction."""
BOUNDS_CROSSED = 3
"""A lower bound is not below its upper bound: nothing was solved."""

START_MARGIN = 1e-3
"""Share of the bounds' width that a start outside them is moved inside (wan2018 gives none)."""
MAX_HALVINGS = 30
"""Halvings of a step before it is given up (n_s^max of Algorithm 1)."""


def work_size(N: int, n: int, p: int, m: int) -> int:
    """Length of the scratch array that the solvers of a window of N stages need."""
    rows = m + n
    step = N * (n * n + n + rows * (n + 2)) + 3 * n * n + 6 * n + p
    return step + 8 * (N * n + N * p)


@kernel
def kkt_step(
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
    x: Array,
    u: Array,
    gx: Array,
    Dx: Array,
    gu: Array,
    Du: Array,
    dx: Array,
    du: Array,
    work: Array,
) -> None:
    """Newton step (dx, du) of the barrier problem at (x, u), by a Riccati recursion.

    Parameters
    ----------
    P, Q, R, A, B, C, f, rx, ru, ry
        The window, as in the table above.
    x, u : (N, n), (N-1, p) float64
        Present iterate.
    gx, Dx, gu, Du : as x and u, float64
        Gradient and (non-negative) second derivative of the barrier there; zero where no bound is.
    dx, du : as x and u, float64, written
        The step.
    work : (work_size(N, n, p, m),) float64, overwritten

    Source: wan2018 Algorithm 2 with (45)-(46).
    Differs: one row of (R_bar, C_bar) at a time; loop of line 21 ends at l.
    """
    N, n = x.shape
    p = Q.size
    m = R.size
    M = m + n
    o = 0
    Pf = work[o : o + N * n * n].reshape(N, n, n)  # P^f_i
    o += N * n * n
    xf = work[o : o + N * n].reshape(N, n)  # dx'_i
    o += N * n
    Pc = work[o : o + N * M * n].reshape(N, M, n)  # rows of Pi_i
    o += N * M * n
    S = work[o : o + N * M].reshape(N, M)  # 1 / innovation variance; 0 marks an unused row
    o += N * M
    e = work[o : o + N * M].reshape(N, M)  # innovations
    o += N * M
    T = work[o : o + n * n].reshape(n, n)
    o += n * n
    lam = work[o : o + n]
    o += n
    xi = work[o : o + n]
    o += n

    for i in range(N):
        Pi = Pf[i]
        xh = xf[i]
        if i == 0:
            for a in range(n):
                xh[a] = rx[a] - x[0, a]
                for b in range(n):
                    Pi[a, b] = P[a, b]
        else:
            # P_{i+1} = A P^f A' + B Q_bar B',  x_{i+1} = -r_p + A x' + B r_u
            Ai = A[i - 1]
            Bi = B[i - 1]
            Pp = Pf[i - 1]
            # (transition matrices are near the identity: zeros are passed over)
            for a in range(n):
                acc = f[i - 1, a] - x[i, a]
                for b in range(n):
                    T[a, b] = 0.0
                    Pi[a, b] = 0.0
                for c in range(n):
                    t = Ai[a, c]
                    if t != 0.0:
                        acc += t * (xf[i - 1, c] + x[i - 1, c])
                        for b in range(n):
                            T[a, b] += t * Pp[c, b]
                xh[a] = acc
            for b in range(n):
                for c in range(n):
                    t = Ai[b, c]
                    if t != 0.0:
                        for a in range(b + 1):
                            Pi[a, b] += T[a, c] * t
            for c in range(p):
                q = Q[c] / (1.0 + Q[c] * Du[i - 1, c])
                r = q * ((ru[i - 1, c] - u[i - 1, c]) / Q[c] - gu[i - 1, c])
                du[i - 1, c] = r
                r += u[i - 1, c]
                for a in range(n):
                    ba = Bi[a, c]
                    if ba != 0.0:
                        xh[a] += ba * r
                        t = ba * q
                        for b in range(a, n):
                            Pi[a, b] += t * Bi[b, c]
            for a in range(n):
                for b in range(a):
                    Pi[a, b] = Pi[b, a]
        for k in range(m):
            c_k = C[i, k]
            s = R[k]
            r = ry[i, k]
            used = False
            for a in range(n):
                Pc[i, k, a] = 0.0
            for b in range(n):
                cb = c_k[b]
                if cb != 0.0:
                    used = True
                    r -= cb * (x[i, b] + xh[b])
                    for a in range(n):
                        Pc[i, k, a] += Pi[b, a] * cb
            if not used:
                S[i, k] = 0.0
                continue
            for a in range(n):
                s += c_k[a] * Pc[i, k, a]
            s = 1.0 / s
            S[i, k] = s
            e[i, k] = r
            for a in range(n):
                t = s * Pc[i, k, a]
                xh[a] += t * r
                for b in range(n):
                    Pi[a, b] -= t * Pc[i, k, b]
        for j in range(n):
            D = Dx[i, j]
            k = m + j
            if D == 0.0:
                S[i, k] = 0.0
                continue
            # the row e_j with variance 1/D and innovation -g/D - xh_j
            keep = 1.0 / (1.0 + D * Pi[j, j])
            s = D * keep
            r = -gx[i, j] / D - xh[j]
            S[i, k] = s
            e[i, k] = r
            for a in range(n):
                Pc[i, k, a] = Pi[a, j]
            for a in range(n):
                t = s * Pc[i, k, a]
                xh[a] += t * r
                if a != j:
                    for b in range(n):
                        Pi[a, b] -= t * Pc[i, k, b]
                    Pi[a, j] = keep * Pc[i, k, a]
                    Pi[j, a] = Pi[a, j]
            Pi[j, j] = keep * Pc[i, k, j]

    # lam_{i-1} = xi_i - Omega_i (e_i + Pi_i xi_i);  x_i = x'_i - P^f_i xi_i
    for a in range(n):
        xi[a] = 0.0
    for i in range(N - 1, -1, -1):
        if i < N - 1:
            for a in range(n):
                t = 0.0
                for b in range(n):
                    t += A[i, b, a] * lam[b]
                xi[a] = t
            for c in range(p):
                t = 0.0
                for b in range(n):
                    t += B[i, b, c] * lam[b]
                du[i, c] -= Q[c] / (1.0 + Q[c] * Du[i, c]) * t
        for a in range(n):
            t = xf[i, a]
            for b in range(n):
                t -= Pf[i, a, b] * xi[b]
            dx[i, a] = t
        for a in range(n):
            lam[a] = xi[a]
        for k in range(M - 1, -1, -1):
            s = S[i, k]
            if s == 0.0:
                continue
            t = e[i, k]
            for a in range(n):
                t += Pc[i, k, a] * lam[a]
            t *= s
            if k >= m:
                lam[k - m] -= t
            else:
                for a in range(n):
                    lam[a] -= C[i, k, a] * t


@kernel
def start_inside(v: Array, lo: Array, hi: Array) -> bool:
    """Zero step, moved strictly inside the bounds; False when the bounds cross."""
    for i in range(v.shape[0]):
        for a in range(v.shape[1]):
            width = hi[i, a] - lo[i, a]
            if not width > 0.0:
                return False
            margin = START_MARGIN * min(width, 1.0)
            v[i, a] = 0.0
            if lo[i, a] >= 0.0:
                v[i, a] = lo[i, a] + margin
            elif hi[i, a] <= 0.0:
                v[i, a] = hi[i, a] - margin
    return True


@kernel
def _fits(v: Array, d: Array, s: float, lo: Array, hi: Array) -> bool:
    """Whether v + s d lies strictly inside the bounds."""
    for i in range(v.shape[0]):
        for a in range(v.shape[1]):
            t = v[i, a] + s * d[i, a]
            if not (lo[i, a] < t < hi[i, a]):
                return False
    return True


@kernel
def _barrier(v: Array, lo: Array, hi: Array, kappa: float, g: Array, D: Array) -> None:
    """Barrier gradient and second derivative. Source: wan2018 (46a)-(46b)."""
    for i in range(v.shape[0]):
        for a in range(v.shape[1]):
            if lo[i, a] == -np.inf and hi[i, a] == np.inf:
                g[i, a] = 0.0
                D[i, a] = 0.0
            else:
                up = 1.0 / (hi[i, a] - v[i, a])
                down = 1.0 / (v[i, a] - lo[i, a])
                g[i, a] = kappa * (up - down)
                D[i, a] = kappa * (up * up + down * down)


@kernel
def barrier_qp(
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
    kappa: float,
    n_kappa: int,
    n_qp: int,
    x: Array,
    u: Array,
    work: Array,
) -> int:
    """Solve the window by a fixed number of primal barrier iterations; returns a status.

    Parameters
    ----------
    P, Q, R, A, B, C, f, rx, ru, ry, xl, xu, ul, uu
        The window, as in the module's table.
    kappa : float
        Barrier parameter of the first ``n_qp`` iterations; it falls tenfold ``n_kappa - 1`` times.
    n_kappa, n_qp : int
        Values of kappa, and iterations at each. With no bound at all one iteration is exact.
    x, u : (N, n), (N-1, p) float64, written
        Steps from the linearisation point, strictly inside the bounds.
    work : (work_size(N, n, p, m),) float64, overwritten

    Source: wan2018 Algorithm 1.
    """
    N, n = x.shape
    p = Q.size
    if not (start_inside(x, xl, xu) and start_inside(u, ul, uu)):
        return BOUNDS_CROSSED
    at = work.size - 8 * (N * n + N * p)
    on_x = work[at : at + 3 * N * n].reshape(3, N, n)
    at += 3 * N * n
    on_u = work[at : at + 3 * N * p].reshape(3, N, p)
    gx, Dx, dx = on_x[0], on_x[1], on_x[2]
    gu, Du, du = on_u[0], on_u[1], on_u[2]
    for j in range(n_kappa * n_qp):
        _barrier(x, xl, xu, kappa, gx, Dx)
        _barrier(u, ul, uu, kappa, gu, Du)
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
        s = 1.0
        halvings = 0
        while not (_fits(x, dx, s, xl, xu) and _fits(u, du, s, ul, uu)):
            s *= 0.5
            halvings += 1
            if halvings > MAX_HALVINGS:
                return NOT_CONVERGED
        for i in range(N):
            for a in range(n):
                x[i, a] += s * dx[i, a]
        for i in range(N - 1):
            for a in range(p):
                u[i, a] += s * du[i, a]
        if (j + 1) % n_qp == 0:
            kappa *= 0.1
    return SOLVED
