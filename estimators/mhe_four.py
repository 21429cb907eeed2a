"""Algorithm 2 for four states, four inputs, four measurements, its covariance in registers.

The symbols are those of :mod:`estimators.mhe`, whose ``kkt_step`` this equals. A symmetric 4 x 4
matrix is a tuple of its ten upper entries, row by row; a compiler keeps such a tuple in registers,
while it must write every entry of an array back to memory. The paper's flight computer does the
same ("symmetric matrix structures are exploited in all the matrix manipulations").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.jit import inlined, kernel

__all__ = ["kkt_step_four"]

Array = NDArray[np.float64]
Vec = tuple[float, float, float, float]
Sym = tuple[float, float, float, float, float, float, float, float, float, float]

ROW = 6  # stored of a measurement row: P c (4), 1 / innovation variance, innovation


@inlined
def _times(P: Sym, c: Vec) -> Vec:
    """P c."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = P
    c0, c1, c2, c3 = c
    return (
        p00 * c0 + p01 * c1 + p02 * c2 + p03 * c3,
        p01 * c0 + p11 * c1 + p12 * c2 + p13 * c3,
        p02 * c0 + p12 * c1 + p22 * c2 + p23 * c3,
        p03 * c0 + p13 * c1 + p23 * c2 + p33 * c3,
    )


@inlined
def _dot(a: Vec, b: Vec) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@inlined
def _plus(P: Sym, t: float, v: Vec) -> Sym:
    """P + t v v'."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = P
    v0, v1, v2, v3 = v
    t0, t1, t2, t3 = t * v0, t * v1, t * v2, t * v3
    return (
        p00 + t0 * v0,
        p01 + t0 * v1,
        p02 + t0 * v2,
        p03 + t0 * v3,
        p11 + t1 * v1,
        p12 + t1 * v2,
        p13 + t1 * v3,
        p22 + t2 * v2,
        p23 + t2 * v3,
        p33 + t3 * v3,
    )


@inlined
def _shrunk(P: Sym, j: int, keep: float) -> Sym:
    """P with its row and column j scaled by ``keep``."""
    k0 = keep if j == 0 else 1.0
    k1 = keep if j == 1 else 1.0
    k2 = keep if j == 2 else 1.0
    k3 = keep if j == 3 else 1.0
    return (
        P[0] * k0,
        P[1] * k0 * k1,
        P[2] * k0 * k2,
        P[3] * k0 * k3,
        P[4] * k1,
        P[5] * k1 * k2,
        P[6] * k1 * k3,
        P[7] * k2,
        P[8] * k2 * k3,
        P[9] * k3,
    )


@inlined
def _cleared(a: Vec, j: int) -> Vec:
    """The vector with its entry j set to zero."""
    return (
        0.0 if j == 0 else a[0],
        0.0 if j == 1 else a[1],
        0.0 if j == 2 else a[2],
        0.0 if j == 3 else a[3],
    )


@inlined
def _moved(x: Vec, t: float, a: Vec) -> Vec:
    """Sum x + t a."""
    return x[0] + t * a[0], x[1] + t * a[1], x[2] + t * a[2], x[3] + t * a[3]


@inlined
def _vec(v: Array, o: int) -> Vec:
    """Four entries of a flat array."""
    return v[o], v[o + 1], v[o + 2], v[o + 3]


@inlined
def _line(v: Array, i: int) -> Vec:
    """Row i of a matrix."""
    return v[i, 0], v[i, 1], v[i, 2], v[i, 3]


@inlined
def _row(A: Array, i: int, a: int) -> Vec:
    """Row a of matrix i."""
    return A[i, a, 0], A[i, a, 1], A[i, a, 2], A[i, a, 3]


@inlined
def _column(B: Array, i: int, c: int) -> Vec:
    """Column c of matrix i."""
    return B[i, 0, c], B[i, 1, c], B[i, 2, c], B[i, 3, c]


@inlined
def _congruent(P: Sym, A: Array, i: int) -> Sym:
    """A P A' with matrix i."""
    r0, r1, r2, r3 = _row(A, i, 0), _row(A, i, 1), _row(A, i, 2), _row(A, i, 3)
    t0, t1, t2, t3 = _times(P, r0), _times(P, r1), _times(P, r2), _times(P, r3)
    return (
        _dot(r0, t0),
        _dot(r0, t1),
        _dot(r0, t2),
        _dot(r0, t3),
        _dot(r1, t1),
        _dot(r1, t2),
        _dot(r1, t3),
        _dot(r2, t2),
        _dot(r2, t3),
        _dot(r3, t3),
    )


@inlined
def _keep_row(work: Array, o: int, a: Vec, s: float, e: float) -> None:
    """Store a row's P c, inverse variance and innovation."""
    work[o], work[o + 1], work[o + 2], work[o + 3] = a
    work[o + 4] = s
    work[o + 5] = e


@kernel
def kkt_step_four(
    P: Array, Q: Array, R: Array, A: Array, B: Array, C: Array, f: Array, rx: Array, ru: Array,
    ry: Array, x: Array, u: Array, gx: Array, Dx: Array, gu: Array, Du: Array, dx: Array,
    du: Array, work: Array,
) -> None:  # fmt: skip
    """Newton step of the barrier problem; arguments and result of :func:`estimators.mhe.kkt_step`.

    Source: wan2018 Algorithm 2 with (45)-(46).
    """
    N = x.shape[0]
    R0 = 16 * N  # work: P^f_i (10) and dx'_i (4) of each stage, then its eight rows

    P_hat = (
        P[0, 0], P[0, 1], P[0, 2], P[0, 3], P[1, 1],
        P[1, 2], P[1, 3], P[2, 2], P[2, 3], P[3, 3],
    )  # fmt: skip
    x_hat = _moved(_vec(rx, 0), -1.0, _line(x, 0))
    for i in range(N):
        x_i = _line(x, i)
        if i > 0:
            # P_{i+1} = A P^f A' + B Q_bar B',  x_{i+1} = -r_p + A x' + B r_u
            h = i - 1
            P_hat = _congruent(P_hat, A, h)
            v = _moved(x_hat, 1.0, _line(x, h))
            x_hat = (
                f[h, 0] - x_i[0] + _dot(_row(A, h, 0), v),
                f[h, 1] - x_i[1] + _dot(_row(A, h, 1), v),
                f[h, 2] - x_i[2] + _dot(_row(A, h, 2), v),
                f[h, 3] - x_i[3] + _dot(_row(A, h, 3), v),
            )
            for c in range(4):
                share = 1.0 / (1.0 + Q[c] * Du[h, c])
                r = share * (ru[h, c] - u[h, c] - Q[c] * gu[h, c])
                du[h, c] = r
                b = _column(B, h, c)
                P_hat = _plus(P_hat, Q[c] * share, b)
                x_hat = _moved(x_hat, r + u[h, c], b)
        o = R0 + 48 * i
        for k in range(4):
            c_k = _row(C, i, k)
            a = _times(P_hat, c_k)
            s = 1.0 / (R[k] + _dot(c_k, a))
            e = ry[i, k] - _dot(c_k, x_i) - _dot(c_k, x_hat)
            _keep_row(work, o + ROW * k, a, s, e)
            P_hat = _plus(P_hat, -s, a)
            x_hat = _moved(x_hat, s * e, a)
        o += 4 * ROW
        for j in range(4):
            D = Dx[i, j]
            if D == 0.0:
                work[o + ROW * j + 4] = 0.0
                continue
            # the row e_j with variance 1/D: column j shrinks, the rest loses a rank
            unit = (
                1.0 if j == 0 else 0.0,
                1.0 if j == 1 else 0.0,
                1.0 if j == 2 else 0.0,
                1.0 if j == 3 else 0.0,
            )
            a = _times(P_hat, unit)
            keep = 1.0 / (1.0 + D * _dot(unit, a))
            s = D * keep
            e = -gx[i, j] / D - _dot(unit, x_hat)
            _keep_row(work, o + ROW * j, a, s, e)
            x_hat = _moved(x_hat, s * e, a)
            P_hat = _shrunk(_plus(P_hat, -s, _cleared(a, j)), j, keep)
        o = 16 * i
        for k in range(10):
            work[o + k] = P_hat[k]
        for k in range(4):
            work[o + 10 + k] = x_hat[k]

    # lam_{i-1} = xi_i - Omega_i (e_i + Pi_i xi_i);  x_i = x'_i - P^f_i xi_i
    lam = (0.0, 0.0, 0.0, 0.0)
    for i in range(N - 1, -1, -1):
        if i < N - 1:
            for c in range(4):
                q = Q[c] / (1.0 + Q[c] * Du[i, c])
                du[i, c] -= q * _dot(_column(B, i, c), lam)
            lam = (
                _dot(_column(A, i, 0), lam),
                _dot(_column(A, i, 1), lam),
                _dot(_column(A, i, 2), lam),
                _dot(_column(A, i, 3), lam),
            )
        o = 16 * i
        P_f = (
            work[o], work[o + 1], work[o + 2], work[o + 3], work[o + 4],
            work[o + 5], work[o + 6], work[o + 7], work[o + 8], work[o + 9],
        )  # fmt: skip
        step = _moved(_vec(work, o + 10), -1.0, _times(P_f, lam))
        dx[i, 0], dx[i, 1], dx[i, 2], dx[i, 3] = step
        for j in range(3, -1, -1):
            o = R0 + 48 * i + ROW * (4 + j)
            s = work[o + 4]
            if s != 0.0:
                t = s * (work[o + 5] + _dot(_vec(work, o), lam))
                lam = (
                    lam[0] - t if j == 0 else lam[0],
                    lam[1] - t if j == 1 else lam[1],
                    lam[2] - t if j == 2 else lam[2],
                    lam[3] - t if j == 3 else lam[3],
                )
        for k in range(3, -1, -1):
            o = R0 + 48 * i + ROW * k
            t = work[o + 4] * (work[o + 5] + _dot(_vec(work, o), lam))
            lam = _moved(lam, -t, _row(C, i, k))
