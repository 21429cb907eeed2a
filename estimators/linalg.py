"""Products and Cholesky solves of 6 by 6 matrices, without allocation and without BLAS.

A call into BLAS costs more than multiplying two 6 by 6 matrices: here the inner products are
written out, which the compiler keeps in vector registers. All matrices are C-contiguous (6, 6)
float64; outputs come last and must not be one of the inputs unless a function says so. Symmetric
results are symmetric to the last bit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "add_congruence_diagonal",
    "backward",
    "cholesky",
    "congruence",
    "copy",
    "forward",
    "forward_vector",
    "gram",
    "invert",
    "matmul",
    "matmul_symmetric",
    "matvec",
]

Array = NDArray[np.float64]


@kernel
def copy(A: Array, B: Array) -> None:
    """B = A; several times faster than the slice assignment that it spells out."""
    for i in range(6):
        for j in range(6):
            B[i, j] = A[i, j]


@kernel
def matmul(A: Array, B: Array, C: Array) -> None:
    """C = A B."""
    for i in range(6):
        a0, a1, a2, a3, a4, a5 = A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5]
        for j in range(6):
            C[i, j] = (
                a0 * B[0, j]
                + a1 * B[1, j]
                + a2 * B[2, j]
                + a3 * B[3, j]
                + a4 * B[4, j]
                + a5 * B[5, j]
            )


@kernel
def matmul_symmetric(A: Array, B: Array, C: Array) -> None:
    """C = A B' where that product is symmetric in exact arithmetic; half of it is computed."""
    for i in range(6):
        a0, a1, a2, a3, a4, a5 = A[i, 0], A[i, 1], A[i, 2], A[i, 3], A[i, 4], A[i, 5]
        for j in range(i + 1):
            c = (
                a0 * B[j, 0]
                + a1 * B[j, 1]
                + a2 * B[j, 2]
                + a3 * B[j, 3]
                + a4 * B[j, 4]
                + a5 * B[j, 5]
            )
            C[i, j] = c
            C[j, i] = c


@kernel
def congruence(A: Array, P: Array, AP: Array, C: Array) -> None:
    """C = A P A' for symmetric P; AP receives A P. C may be P."""
    matmul(A, P, AP)
    matmul_symmetric(AP, A, C)


@kernel
def add_congruence_diagonal(A: Array, d: Array, C: Array) -> None:
    """C += A diag(d) A' for symmetric C."""
    for i in range(6):
        a0, a1, a2 = A[i, 0] * d[0], A[i, 1] * d[1], A[i, 2] * d[2]
        a3, a4, a5 = A[i, 3] * d[3], A[i, 4] * d[4], A[i, 5] * d[5]
        for j in range(i + 1):
            c = C[i, j] + (
                a0 * A[j, 0]
                + a1 * A[j, 1]
                + a2 * A[j, 2]
                + a3 * A[j, 3]
                + a4 * A[j, 4]
                + a5 * A[j, 5]
            )
            C[i, j] = c
            C[j, i] = c


@kernel
def matvec(A: Array, v: Array, out: Array) -> None:
    """Product ``A v`` into out."""
    for i in range(6):
        out[i] = (
            A[i, 0] * v[0]
            + A[i, 1] * v[1]
            + A[i, 2] * v[2]
            + A[i, 3] * v[3]
            + A[i, 4] * v[4]
            + A[i, 5] * v[5]
        )


@kernel
def gram(A: Array, C: Array) -> None:
    """C = A' A."""
    for i in range(6):
        a0, a1, a2, a3, a4, a5 = A[0, i], A[1, i], A[2, i], A[3, i], A[4, i], A[5, i]
        for j in range(i + 1):
            c = (
                a0 * A[0, j]
                + a1 * A[1, j]
                + a2 * A[2, j]
                + a3 * A[3, j]
                + a4 * A[4, j]
                + a5 * A[5, j]
            )
            C[i, j] = c
            C[j, i] = c


@kernel
def cholesky(M: Array, L: Array) -> bool:
    """Lower factor Lo of a symmetric matrix, ``M = Lo Lo'``; L holds it with 1/Lo[i, i] instead.

    Returns False when the matrix is not positive definite (or not finite); L is then garbage.
    The part of L above the diagonal is not written.
    """
    for j in range(6):
        d = M[j, j]
        for k in range(j):
            d -= L[j, k] * L[j, k]
        if not (0.0 < d < math.inf):
            return False
        inverse = 1.0 / math.sqrt(d)
        L[j, j] = inverse
        for i in range(j + 1, 6):
            s = M[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s * inverse
    return True


@kernel
def forward(L: Array, B: Array) -> None:
    """B <- Lo^-1 B, column by column, with the factor of :func:`cholesky`."""
    for i in range(6):
        for k in range(i):
            c = L[i, k]
            for j in range(6):
                B[i, j] -= c * B[k, j]
        inverse = L[i, i]
        for j in range(6):
            B[i, j] *= inverse


@kernel
def forward_vector(L: Array, b: Array) -> None:
    """B <- Lo^-1 b with the factor of :func:`cholesky`."""
    for i in range(6):
        s = b[i]
        for k in range(i):
            s -= L[i, k] * b[k]
        b[i] = s * L[i, i]


@kernel
def backward(L: Array, B: Array) -> None:
    """B <- Lo'^-1 B, column by column; after :func:`forward` the solution of M X = B."""
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            c = L[k, i]
            for j in range(6):
                B[i, j] -= c * B[k, j]
        inverse = L[i, i]
        for j in range(6):
            B[i, j] *= inverse


@kernel
def invert(A: Array) -> bool:
    """A <- A^-1 of a general matrix, in place (Gauss-Jordan, partial pivoting).

    Returns False when the matrix is singular or not finite; A is then garbage.
    """
    pivots = (0, 0, 0, 0, 0, 0)
    for c in range(6):
        p = c
        for i in range(c + 1, 6):
            if abs(A[i, c]) > abs(A[p, c]):
                p = i
        value = A[p, c]
        if not (0.0 < abs(value) < math.inf):
            return False
        if p != c:
            for j in range(6):
                A[c, j], A[p, j] = A[p, j], A[c, j]
        pivots = (pivots[1], pivots[2], pivots[3], pivots[4], pivots[5], p)
        inverse = 1.0 / value
        A[c, c] = 1.0
        for j in range(6):
            A[c, j] *= inverse
        for i in range(6):
            if i != c:
                factor = A[i, c]
                A[i, c] = 0.0
                for j in range(6):
                    A[i, j] -= factor * A[c, j]
    for c in range(5, -1, -1):
        p = pivots[c]
        if p != c:
            for i in range(6):
                A[i, c], A[i, p] = A[i, p], A[i, c]
    return True
