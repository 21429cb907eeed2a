"""Least squares over levels that can only rise: an interior point that works stage by stage.

    minimise    sum_k 1/2 f_k' H_k f_k + q_k' f_k
    subject to  f_1 >= 0,  f_{k+1} >= f_k      (each component for itself)

========  =================================================================  ============  =========
symbol    meaning                                                            shape         samar2006
========  =================================================================  ============  =========
f         levels                                                             (N, p)        (10)
H, q      stage cost; H_k positive semidefinite, their sum definite          (N,p,p) (N,p) (15),(17)
s         steps f_k - f_{k-1}, with f_0 = 0: the slack of the constraints    (N, p)        (16)
z         multipliers of s >= 0                                              (N, p)
r         gradient H_k f_k + q_k                                             (N, p)
w         curvature z / s that the barrier gives the steps                   (N, p)
h         slope of the steps in Newton's subproblem                          (N, p)
v, dz     Newton's direction of s and z                                      (N, p)
A, b      cost 1/2 x'Ax + b'x of reaching x = df_k through all earlier ones  (p, p) (p)
a, i      column j of A when step j of stage k is eliminated, 1/(a_j + w_j)  (N,p,p) (N,p)
mu        mean of s z                                                        ()
========  =================================================================  ============  =========

Because s fixes f (f_k is the sum of the first k steps) the constraints hold at every iterate, with
nothing left to roundoff. Newton's subproblem

    minimise  sum_k 1/2 df_k' H_k df_k + r_k' df_k + 1/2 v_k' diag(w_k) v_k + h_k' v_k,
    df_k = df_{k-1} + v_k

is solved forward in k as a filter is, one component of one step at a time: minimising over v_j
leaves

    A <- A - a a' / (a_j + w_j),   with row and column j   a w_j / (a_j + w_j),

products of positive numbers where w ranges over twenty decades. The block Cholesky factorisation of
the same matrix subtracts w - w^2 / (a + w) instead and loses all digits of a once w is large.

The rest is Mehrotra's predictor and corrector with one step length for s and z. One iteration costs
O(N p^3), memory is O(N p^2), and nothing is allocated.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel
from estimators.monotone_qp_four import eliminate_four, substitute_four

__all__ = [
    "MAX_ITERATIONS",
    "NON_FINITE",
    "NOT_CONVERGED",
    "SINGULAR",
    "SOLVED",
    "STATUS_TEXT",
    "TOLERANCE",
    "solve_monotone",
    "start_at_least",
    "start_sizes",
    "work_size",
]

Array = NDArray[np.float64]

SOLVED = 0
"""The gap and the gradient's residual are within tolerance."""
NOT_CONVERGED = 1
"""The iterations ran out: the levels are monotone and may be used with care."""
SINGULAR = 2
"""Levels without curvature, or whose cost falls for ever: keep the previous estimate."""
NON_FINITE = 3
"""A NaN or infinity came in: nothing was solved, keep the previous estimate."""
STATUS_TEXT = {
    SOLVED: "solved",
    NOT_CONVERGED: "the iterations ran out; the levels are monotone but not optimal",
    SINGULAR: "the data do not determine the levels",
    NON_FINITE: "the data hold a NaN or an infinity",
}

TOLERANCE = 1e-10
"""Gap s'z at which the iteration ends, absolute: the cost is a logarithm of a likelihood."""
RESIDUAL = 1e-9
"""Largest residual of the gradient, as a share of the largest q (or of 1)."""
MAX_ITERATIONS = 60
TO_BOUNDARY = 0.995
"""Share of the way to the nearest bound that a step may go."""
START_STEP = 0.3
START_SLOPE = 0.1
"""Shares of the sizes in :func:`start_sizes`; tenfold others cost one to four iterations more."""
CRAMPED = 2.0
"""A corrected step this many times shorter than the predictor's is tried again with less of the
correction. Without it one window in a thousand cycles for ever."""
LESS = 0.25
"""Largest share of the correction that the second try takes."""


def work_size(N: int, p: int) -> int:
    """Length of the scratch array that :func:`solve_monotone` needs for N stages of p levels."""
    return N * p * (p + 8) + 2 * p * p + p


@kernel
def start_sizes(H: Array, q: Array) -> tuple[float, float]:
    """A step and a multiplier of the right size to start from.

    The step takes its size from the level that would fit all stages at once, component by
    component. With the cost a logarithm of a likelihood the sum of all gradients has, from noise
    alone, the standard deviation sqrt(sum H): the size of the multiplier.
    """
    N, p = q.shape
    size = 0.0
    curvature = 0.0
    for i in range(p):
        c = 0.0
        g = 0.0
        for k in range(N):
            c += H[k, i, i]
            g += q[k, i]
        if c > 0.0:
            size = max(size, abs(g) / c)
            curvature = max(curvature, c)
    step = START_STEP * size if size > 0.0 else 1.0
    slope = START_SLOPE * math.sqrt(curvature) if curvature > 0.0 else 1.0
    return step, slope


@kernel
def start_at_least(step: float, slope: float, s: Array, z: Array) -> None:
    """Raise s to ``step`` and z to ``slope`` where they are below (or NaN)."""
    N, p = s.shape
    for k in range(N):
        for i in range(p):
            if not s[k, i] > step:
                s[k, i] = step
            if not z[k, i] > slope:
                z[k, i] = slope


@kernel
def eliminate(H: Array, w: Array, a: Array, inverse: Array, A: Array) -> None:
    """Eliminate the steps of every stage in turn; A is left as the curvature at the last stage.

    Parameters
    ----------
    H, w
        Stage curvatures and those of the steps, as in the table above.
    a, inverse : (N, p, p), (N, p) float64, written
        What :func:`substitute` needs again: eliminated columns and 1 / (a_j + w_j).
    A : (p, p) float64, written
    """
    N, p = w.shape
    for i in range(p):
        for j in range(p):
            A[i, j] = H[0, i, j]
        A[i, i] += w[0, i]
    for k in range(1, N):
        for j in range(p):
            column = a[k, j]
            for i in range(p):
                column[i] = A[j, i]
            t = 1.0 / (column[j] + w[k, j])
            inverse[k, j] = t
            for i in range(p):
                c = t * column[i]
                for m in range(p):
                    A[i, m] -= c * column[m]
            t *= w[k, j]
            for i in range(p):
                A[i, j] = t * column[i]
                A[j, i] = A[i, j]
        for i in range(p):
            for j in range(p):
                A[i, j] += H[k, i, j]


@kernel
def substitute(
    a: Array, inverse: Array, w: Array, L: Array, r: Array, h: Array, b: Array, v: Array
) -> None:
    """Newton's direction v of the steps for the gradients r and h, from what was eliminated.

    ``L`` is the factor of the last A (:func:`cholesky`); b is scratch.
    """
    N, p = w.shape
    for i in range(p):
        b[i] = r[0, i] + h[0, i]
    for k in range(1, N):
        for j in range(p):
            column = a[k, j]
            c = b[j] - h[k, j]
            t = inverse[k, j] * c
            v[k, j] = t
            rest = (b[j] * w[k, j] + column[j] * h[k, j]) * inverse[k, j]
            for i in range(p):
                b[i] -= t * column[i]
            b[j] = rest
        for i in range(p):
            b[i] += r[k, i]
    backsolve(L, b)
    for k in range(N - 1, 0, -1):
        for j in range(p - 1, -1, -1):
            t = 0.0
            for i in range(p):
                t += a[k, j, i] * b[i]
            t = v[k, j] + inverse[k, j] * t
            v[k, j] = t
            b[j] -= t
    for i in range(p):
        v[0, i] = b[i]


@kernel
def cholesky(A: Array, L: Array) -> bool:
    """Lower factor of A with the inverse of its diagonal; False when A is not definite."""
    p = A.shape[0]
    for j in range(p):
        d = A[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        if not (0.0 < d < math.inf):
            return False
        d = 1.0 / math.sqrt(d)
        L[j, j] = d
        for i in range(j + 1, p):
            t = A[i, j]
            for k in range(j):
                t -= L[i, k] * L[j, k]
            L[i, j] = t * d
    return True


@kernel
def backsolve(L: Array, b: Array) -> None:
    """B <- -A^-1 b with the factor of :func:`cholesky`."""
    p = L.shape[0]
    for i in range(p):
        t = -b[i]
        for k in range(i):
            t -= L[i, k] * b[k]
        b[i] = t * L[i, i]
    for i in range(p - 1, -1, -1):
        t = b[i]
        for k in range(i + 1, p):
            t -= L[k, i] * b[k]
        b[i] = t * L[i, i]


@kernel
def gradients(H: Array, q: Array, s: Array, z: Array, f: Array, r: Array) -> tuple[float, float]:
    """Levels f and gradients r of the steps s; the cost, and the largest residual |r - D'z|."""
    N, p = q.shape
    cost = 0.0
    residual = 0.0
    for k in range(N):
        for i in range(p):
            f[k, i] = s[k, i] + (f[k - 1, i] if k > 0 else 0.0)
        for i in range(p):
            g = 0.0
            for j in range(p):
                g += H[k, i, j] * f[k, j]
            cost += f[k, i] * (0.5 * g + q[k, i])
            g += q[k, i]
            r[k, i] = g
            below = z[k + 1, i] if k + 1 < N else 0.0
            residual = max(residual, abs(g - z[k, i] + below))
    return cost, residual


@kernel
def solve_monotone(
    H: Array,
    q: Array,
    s: Array,
    z: Array,
    f: Array,
    tolerance: float,
    max_iterations: int,
    work: Array,
) -> tuple[int, int, float]:
    """Solve the programme from the start in s and z.

    Parameters
    ----------
    H : (N, p, p) float64
        Symmetric, positive semidefinite.
    q : (N, p) float64
    s, z : (N, p) float64, overwritten
        Positive start, see :func:`start_sizes`; on return the steps and multipliers found.
    f : (N, p) float64, written
        The levels.
    tolerance
        See :data:`TOLERANCE`.
    max_iterations
        Newton steps at most.
    work : (work_size(N, p),) float64, overwritten

    Returns
    -------
    status, iterations, cost
        The status says what the caller may do: see the constants of this module.
    """
    N, p = q.shape
    n = N * p
    a = work[: n * p].reshape(N, p, p)
    rows = work[n * p : n * (p + 8)].reshape(8, N, p)
    inverse, w, r, h = rows[0], rows[1], rows[2], rows[3]
    v, dz, s_inv, second = rows[4], rows[5], rows[6], rows[7]
    o = n * (p + 8)
    A = work[o : o + p * p].reshape(p, p)
    L = work[o + p * p : o + 2 * p * p].reshape(p, p)
    b = work[o + 2 * p * p : o + 2 * p * p + p]
    s1, z1, w1, h1 = s.reshape(n), z.reshape(n), w.reshape(n), h.reshape(n)
    v1, dz1, si1, second1 = v.reshape(n), dz.reshape(n), s_inv.reshape(n), second.reshape(n)

    scale = 1.0
    for k in range(N):
        for i in range(p):
            scale = max(scale, abs(q[k, i]))
            finite = math.isfinite(q[k, i])
            for j in range(p):
                finite = finite and math.isfinite(H[k, i, j])
            if not finite:
                return NON_FINITE, 0, math.nan
    cost = math.nan
    for iteration in range(max_iterations + 1):
        cost, residual = gradients(H, q, s, z, f, r)
        gap = 0.0
        for i in range(n):
            gap += s1[i] * z1[i]
        if gap <= tolerance and residual <= RESIDUAL * scale:
            return SOLVED, iteration, cost
        if not math.isfinite(cost):
            return SINGULAR, iteration, cost
        if iteration == max_iterations:
            break
        for i in range(n):
            si1[i] = 1.0 / s1[i]
            w1[i] = z1[i] * si1[i]
            h1[i] = 0.0
        if p == 4:
            eliminate_four(H, w, a, inverse, A)
        else:
            eliminate(H, w, a, inverse, A)
        if not cholesky(A, L):
            return SINGULAR, iteration, cost

        # predictor: dz = -z - w v
        if p == 4:
            substitute_four(a, inverse, w, L, r, h, v)
        else:
            substitute(a, inverse, w, L, r, h, b, v)
        worst = 1.0
        for i in range(n):
            t = v1[i] * si1[i]
            worst = max(worst, -t, 1.0 + t)
            dz1[i] = -z1[i] - w1[i] * v1[i]
        step = 1.0 / worst
        left = 0.0
        for i in range(n):
            left += (s1[i] + step * v1[i]) * (z1[i] + step * dz1[i])
        centring = left / gap
        aim = centring * centring * centring * gap / n

        # corrector: s dz + z v = aim - s z - (v dz of the predictor), of which less where that
        # leaves almost no room: the full correction can send the iterates in a circle
        weight = 1.0
        for i in range(n):
            second1[i] = v1[i] * dz1[i]
        for attempt in range(2):
            for i in range(n):
                h1[i] = (weight * second1[i] - aim) * si1[i]
            if p == 4:
                substitute_four(a, inverse, w, L, r, h, v)
            else:
                substitute(a, inverse, w, L, r, h, b, v)
            worst = TO_BOUNDARY
            for i in range(n):
                t = -z1[i] - w1[i] * v1[i] - h1[i]
                dz1[i] = t
                worst = max(worst, -v1[i] * si1[i], -t / z1[i])
            if attempt == 1 or worst * step < CRAMPED:
                break
            weight = min(step * step, LESS)
        step = TO_BOUNDARY / worst
        for i in range(n):
            s1[i] += step * v1[i]
            z1[i] += step * dz1[i]
    return NOT_CONVERGED, max_iterations, cost
