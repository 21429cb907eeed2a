"""The elimination of :mod:`estimators.monotone_qp` for four levels, its matrix kept in registers.

Two lifts and two drags are four levels. With the size known the ten numbers of the symmetric A are
local variables: three times as fast as the loops, which the tests hold it against. Symbols are
those of that module.

:func:`_drop` eliminates the step of the *first* component and moves that component to the end; four
times in a row the order is the old one again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.jit import inlined, kernel

__all__ = ["eliminate_four", "substitute_four"]

Array = NDArray[np.float64]
Ten = tuple[float, float, float, float, float, float, float, float, float, float]


@inlined
def _drop(
    a0: float, a1: float, a2: float, a3: float,
    b1: float, b2: float, b3: float, c2: float, c3: float, d3: float,
    w: float, column: Array,
) -> tuple[Ten, float]:  # fmt: skip
    """Eliminate the first component's step; return A with that component last, and 1/(a_0 + w).

    The rows of A's upper triangle are a, b, c, d; ``column`` receives its first column.
    """
    t = 1.0 / (a0 + w)
    column[0], column[1], column[2], column[3] = a0, a1, a2, a3
    t1, t2, t3, kept = t * a1, t * a2, t * a3, t * w
    return (
        b1 - t1 * a1, b2 - t1 * a2, b3 - t1 * a3, kept * a1,
        c2 - t2 * a2, c3 - t2 * a3, kept * a2,
        d3 - t3 * a3, kept * a3,
        kept * a0,
    ), t  # fmt: skip


@kernel
def eliminate_four(H: Array, w: Array, a: Array, inverse: Array, A: Array) -> None:
    """As :func:`estimators.monotone_qp.eliminate`, but column j of ``a`` begins with component j.

    Parameters
    ----------
    H, w : (N, 4, 4), (N, 4) float64
    a, inverse : (N, 4, 4), (N, 4) float64, written
        ``a[k, j, i]`` is the element of component (i + j) modulo 4.
    A : (4, 4) float64, written
    """
    N = w.shape[0]
    h = H[0]
    T = (
        h[0, 0] + w[0, 0], h[0, 1], h[0, 2], h[0, 3],
        h[1, 1] + w[0, 1], h[1, 2], h[1, 3],
        h[2, 2] + w[0, 2], h[2, 3],
        h[3, 3] + w[0, 3],
    )  # fmt: skip
    for k in range(1, N):
        h, wk, ak, ik = H[k], w[k], a[k], inverse[k]
        for j in range(4):
            T, ik[j] = _drop(
                T[0], T[1], T[2], T[3], T[4], T[5], T[6], T[7], T[8], T[9], wk[j], ak[j]
            )
        T = (
            T[0] + h[0, 0], T[1] + h[0, 1], T[2] + h[0, 2], T[3] + h[0, 3],
            T[4] + h[1, 1], T[5] + h[1, 2], T[6] + h[1, 3],
            T[7] + h[2, 2], T[8] + h[2, 3],
            T[9] + h[3, 3],
        )  # fmt: skip
    at = 0
    for i in range(4):
        for j in range(i, 4):
            A[i, j] = A[j, i] = T[at]
            at += 1


@kernel
def substitute_four(
    a: Array, inverse: Array, w: Array, L: Array, r: Array, h: Array, v: Array
) -> None:
    """As :func:`estimators.monotone_qp.substitute`, on what :func:`eliminate_four` left."""
    N = w.shape[0]
    b0, b1, b2, b3 = r[0, 0] + h[0, 0], r[0, 1] + h[0, 1], r[0, 2] + h[0, 2], r[0, 3] + h[0, 3]
    for k in range(1, N):
        for j in range(4):
            column, i, slope = a[k, j], inverse[k, j], h[k, j]
            t = i * (b0 - slope)
            v[k, j] = t
            rest = i * (b0 * w[k, j] + column[0] * slope)
            b0, b1, b2, b3 = b1 - t * column[1], b2 - t * column[2], b3 - t * column[3], rest
        b0, b1, b2, b3 = b0 + r[k, 0], b1 + r[k, 1], b2 + r[k, 2], b3 + r[k, 3]
    # x = -A^-1 b with the factor's inverted diagonal
    b0 = -b0 * L[0, 0]
    b1 = (-b1 - L[1, 0] * b0) * L[1, 1]
    b2 = (-b2 - L[2, 0] * b0 - L[2, 1] * b1) * L[2, 2]
    b3 = (-b3 - L[3, 0] * b0 - L[3, 1] * b1 - L[3, 2] * b2) * L[3, 3]
    b3 = b3 * L[3, 3]
    b2 = (b2 - L[3, 2] * b3) * L[2, 2]
    b1 = (b1 - L[2, 1] * b2 - L[3, 1] * b3) * L[1, 1]
    b0 = (b0 - L[1, 0] * b1 - L[2, 0] * b2 - L[3, 0] * b3) * L[0, 0]
    for k in range(N - 1, 0, -1):
        for j in range(3, -1, -1):
            column = a[k, j]
            b0, b1, b2, b3 = b3, b0, b1, b2
            t = column[0] * b0 + column[1] * b1 + column[2] * b2 + column[3] * b3
            t = v[k, j] + inverse[k, j] * t
            v[k, j] = t
            b0 -= t
    v[0, 0], v[0, 1], v[0, 2], v[0, 3] = b0, b1, b2, b3
