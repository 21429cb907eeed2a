"""Adaptive two-stage EKF: use a measurement, match Qf to the innovations, start again.

Symbols as in :mod:`estimators.two_stage_memory`.
"""

from __future__ import annotations

import math

from estimators.attitude import wrap
from estimators.jit import kernel
from estimators.kinematics import GS, output, output_jacobian, state_from_output
from estimators.linalg import (
    add_congruence_diagonal,
    backward,
    cholesky,
    congruence,
    copy,
    forward,
    forward_vector,
    gram,
    invert,
    matmul,
    matmul_symmetric,
    matvec,
)
from estimators.two_stage_memory import OK, PARTIAL, REJECTED, SINGULAR, Array, Row, lose

__all__ = ["update"]

ITERATED_UPDATES = 10  # lu2016 below (37): "only performed in the first ten time steps"
ITERATIONS = 20
ITERATION_TOLERANCE = 1e-8
RESTART_ACC_M_S2 = 30.0  # bounds on how far a block has moved since it was measured,
RESTART_RATE_RAD_S = 3.0  # used only to restart after the state was lost
RESTART_WITHIN_S = 1.5


@kernel
def has_block(mask: Array, b: int) -> bool:
    """Whether all three rows of a block were measured."""
    return mask[3 * b] + mask[3 * b + 1] + mask[3 * b + 2] == 3.0  # type: ignore[no-any-return]


@kernel
def innovation(model: int, y: Array, x: Array, mask: Array, out: Array) -> None:
    """``y - h(x)``, angles wrapped, zero where nothing was measured."""
    output(model, x, out)
    for i in range(6):
        out[i] = y[i] - out[i] if mask[i] == 1.0 else 0.0
    for i in range(3, 6):
        out[i] = wrap(out[i])


@kernel
def gain(s: Row, t: Row, whole: bool) -> bool:
    """H at eta, M = H P H' + R and K = (M^-1 H P)'; rows that were not measured drop out.

    They drop out as rows of zeros in H and a one on M's diagonal: their columns of K are zero.

    Source: lu2016 eq. (35), (36).
    """
    H, HP, M, K = s.H, s.HP, s.M, s.K
    if whole:
        copy(s.P, M)
        copy(s.P, HP)
    else:
        output_jacobian(t.model, s.eta, H)
        for i in range(6):
            for j in range(6):
                H[i, j] *= s.mask[i]
        matmul(H, s.P, HP)
        matmul_symmetric(HP, H, M)
    for i in range(6):
        M[i, i] += s.r[i]
    if not cholesky(M, s.L):
        return False
    forward(s.L, HP)
    backward(s.L, HP)
    for i in range(6):
        for j in range(6):
            K[i, j] = HP[j, i]
    return True


@kernel
def bias_free(s: Row, t: Row, y: Array, whole: bool) -> bool:
    """The bias-free filter's new state in eta, its residual ``y - h(xbar)`` in `first`, and K.

    Paper: iterated in the first ten steps, which changes nothing where h is linear. Exact:
    linearised once at x, where the residual is ``gamma + H (x - xbar)``.

    Source: lu2016 eq. (35)-(37).
    """
    if t.exact:
        for i in range(6):
            s.eta[i] = s.x[i]
        if not gain(s, t, whole):
            return False
        for i in range(6):
            s.first[i] = s.gamma[i]
            for j in range(6):
                slope = (1.0 if i == j else 0.0) if whole else s.H[i, j]
                s.first[i] += slope * (s.x[j] - s.xbar[j])
        matvec(s.K, s.first, s.eta)
        for i in range(6):
            s.eta[i] += s.xbar[i]
        return True

    innovation(t.model, y, s.xbar, s.mask, s.first)
    for i in range(6):
        s.eta[i] = s.xbar[i]
    if t.model == GS:
        if not gain(s, t, whole):
            return False
        matvec(s.K, s.first, s.eta)
        for i in range(6):
            s.eta[i] += s.xbar[i]
        return True
    for _ in range(ITERATIONS):
        if not gain(s, t, whole):
            return False
        innovation(t.model, y, s.eta, s.mask, s.residual)
        for i in range(6):
            for j in range(6):
                s.residual[i] -= s.H[i, j] * (s.xbar[j] - s.eta[j])
        matvec(s.K, s.residual, s.e)
        change, size = 0.0, 0.0
        for i in range(6):
            value = s.xbar[i] + s.e[i]
            change += (value - s.eta[i]) ** 2
            size += value * value
            s.eta[i] = value
        small = change <= ITERATION_TOLERANCE * ITERATION_TOLERANCE * size
        if small or s.updates >= ITERATED_UPDATES:
            break
    return True


@kernel
def update(s: Row, t: Row, y: Array) -> int:
    """Use one measurement at the filter's present time.

    Leaves in the memory the innovation and its normalised square, chi-square with as many degrees
    of freedom as rows were measured.

    Parameters
    ----------
    s, t : row of MEMORY, row of TUNING
    y : (6,) float64 [m/s, rad]
        NaN where a component was not measured.

    Returns
    -------
    int
        A :class:`Status`; of the measurement nothing was used unless OK or PARTIAL.

    Source: lu2016 eq. (35)-(39), (42)-(44), (48), (50), (51), then (53)-(58).
    """
    mask, r = s.mask, s.r
    s.nis = math.nan
    found = 0
    for i in range(6):
        measured = math.isfinite(y[i])
        mask[i] = 1.0 if measured else 0.0
        r[i] = t.R[i] if measured else 1.0
        found += 1 if measured else 0
    if found == 0:
        return REJECTED
    if s.state != OK:
        return restart(s, t, y)

    whole = t.model == GS and found == 6  # H is the identity
    innovation(t.model, y, s.x, mask, s.gamma)
    if not bias_free(s, t, y, whole):
        return lose(s, SINGULAR)

    K, M, S, A, B, e = s.K, s.M, s.S, s.A, s.B, s.e
    if whole:
        copy(s.V, S)
    else:
        matmul(s.H, s.V, S)  # (48)
    matmul(S, s.Pf, B)
    matmul_symmetric(B, S, A)
    for i in range(6):
        for j in range(6):
            M[i, j] += A[i, j]
    if not cholesky(M, s.L):
        return lose(s, SINGULAR)
    matvec(S, s.f, e)
    for i in range(6):
        e[i] = s.first[i] - e[i]
    forward(s.L, B)
    forward_vector(s.L, e)
    nis = 0.0
    for i in range(6):
        nis += e[i] * e[i]
        for j in range(6):
            s.f[j] += B[i, j] * e[i]  # (43)
    s.nis = nis
    gram(B, A)
    for i in range(6):
        for j in range(6):
            s.Pf[i, j] -= A[i, j]  # (44)

    matmul(K, S, B)
    if whole:
        copy(K, A)
    else:
        matmul(K, s.H, A)
    for i in range(6):
        for j in range(6):
            s.V[i, j] -= B[i, j]  # (50)
            A[i, j] = -A[i, j]
        A[i, i] += 1.0
    congruence(A, s.P, B, s.P)  # (39)
    add_congruence_diagonal(K, r, s.P)

    matvec(s.V, s.f, s.x)
    for i in range(6):
        s.xbar[i] = s.eta[i]  # (38)
        s.x[i] += s.xbar[i]  # (51)
    s.updates += 1
    if t.adapt:
        adapt(s, t, found == 6)
    for b in range(2):
        if has_block(mask, b):
            s.since_s[b] = 0.0
    return OK if found == 6 else PARTIAL


@kernel
def adapt(s: Row, t: Row, complete: bool) -> None:
    """Match Qf to the innovations since the measured blocks were last measured.

    A complete measurement with both blocks in step is the paper's; a block measured alone adapts
    its own three faults from its own rows.

    Source: lu2016 eq. (53), (57), (58).
    """
    together = s.since_s[0] == s.since_s[1]
    if together and complete:
        match(s, t, 0, 0, 6)
        return
    if together:
        copy(s.Gamma_T[0], s.Gamma_T[1])
        copy(s.Q_T[0], s.Q_T[1])
    for b in range(2):
        if has_block(s.mask, b):
            match(s, t, b, 3 * b, 3 * b + 3)


@kernel
def match(s: Row, t: Row, b: int, lo: int, hi: int) -> None:
    """Qf of the faults ``lo:hi`` from the rows ``lo:hi``, with the accumulated matrices ``b``."""
    dt_T = s.since_s[b]
    if dt_T == 0.0:
        return
    window, spread, HG = s.window, s.q, s.A
    if t.model == GS:
        copy(s.Gamma_T[b], HG)
        for i in range(6):
            spread[i] = s.Q_T[b, i, i]
    else:
        matmul(s.H, s.Gamma_T[b], HG)
        congruence(s.H, s.Q_T[b], s.B, s.C)
        for i in range(6):
            spread[i] = s.C[i, i]
    for i in range(6):
        for j in range(6):
            if not (lo <= i < hi and lo <= j < hi):
                HG[i, j] = 1.0 if i == j else 0.0
    divisor = dt_T if t.divide_by_dt else 1.0
    for block in range(lo // 3, (hi + 2) // 3):
        head = s.head[block]
        filled = min(s.filled[block] + 1, t.N)
        for i in range(3 * block, 3 * block + 3):
            window[head, i] = s.gamma[i] * s.gamma[i]
            total = 0.0
            for k in range(filled):
                total += window[k, i]
            spread[i] = max(total / filled - spread[i] / divisor - t.R[i], 0.0)  # (53), (58)
        s.head[block] = head + 1 if head + 1 < t.N else 0
        s.filled[block] = filled
        s.Qf_interval_s[block] = dt_T
    if not invert(HG):
        return
    factor = t.detuning if t.detuning > 0.0 else dt_T * dt_T
    for i in range(lo, hi):
        q = 0.0
        for j in range(lo, hi):
            q += HG[i, j] * HG[i, j] * spread[j]  # HG is inverted now
        s.Qf[i] = max(q * factor, t.Qf_floor)  # (57)


@kernel
def restart(s: Row, t: Row, y: Array) -> int:
    """Take the state from measurements once both blocks are there and the pitch is moderate."""
    state_from_output(t.model, y, s.eta)
    for b in range(2):
        if has_block(s.mask, b):
            for i in range(3 * b, 3 * b + 3):
                s.x[i] = s.eta[i]
            s.since_s[b] = 0.0
            s.seen[b] = 1
    fresh = max(s.since_s[0], s.since_s[1]) < RESTART_WITHIN_S
    moderate = abs(s.x[4]) < t.pitch_return_rad
    if not (s.seen[0] == 1 and s.seen[1] == 1 and fresh and moderate):
        return int(s.state)
    output_jacobian(t.model, s.x, s.H)
    if not invert(s.H):
        return int(s.state)
    for i in range(6):
        for j in range(6):
            s.P[i, j] = 0.0
            s.V[i, j] = 0.0  # the measured state owes nothing to the faults
    add_congruence_diagonal(s.H, t.R, s.P)
    for i in range(6):
        s.xbar[i] = s.x[i]
        bound = RESTART_ACC_M_S2 if i < 3 else RESTART_RATE_RAD_S
        s.P[i, i] += (bound * s.since_s[i // 3]) ** 2
    s.state = OK
    for b in range(2):
        s.since_s[b] = 0.0
        s.filled[b] = 0
        s.head[b] = 0
    return OK
