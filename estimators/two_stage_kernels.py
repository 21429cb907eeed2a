"""Adaptive two-stage extended Kalman filter: the compiled steps.

============  ====================================================  =========  ==============
symbol        meaning                                               shape      lu2016
============  ====================================================  =========  ==============
x             state estimate, faults removed                        (6,)       (51)
xbar          state of the bias-free filter                         (6,)       (31), (38)
f             fault estimate, m/s^2 and rad/s                       (6,)       (43)
P, Pf         covariance of xbar, of f                              (6, 6)     (32), (39), (44)
V             blending matrix: x = xbar + V f. After a prediction   (6, 6)     (49), (50)
              U_k, after an update V_k; without an update K = 0,
              hence V_k = U_k
Phi, Gamma    transition and input matrix of one prediction         (6, 6)     (33), (34)
Gamma_T, Q_T  the same since the last measurement:                  (6, 6)
              Gamma_T <- Phi Gamma_T + Gamma,
              Q_T <- Phi Q_T Phi' + Gamma Q Gamma'
Q, R          variances of the input and of the measurement noise,  (6,)       (55), (56)
              diagonals
Qf            variances of the fault's random walk, diagonal        (6,)       (41), (57)
gamma         innovation y - h(x), angles wrapped                   (6,)       (54)
K, M          gain of the bias-free filter, H P H' + R              (6, 6)     (36)
S, C          H U, and M + S Pf S'                                  (6, 6)     (42), (48)
window        squares of the last N innovations                     (N, 6)     (53)
============  ====================================================  =========  ==============

With Q^xf = 0 (49) is ``U = Ubar (I - Qf Pf^-1)`` and (46) ``Gamma Q Gamma' + U Qf Ubar'``, which is
symmetric. The gain Kf never appears: with ``C = Lo Lo'`` and ``W = Lo^-1 S Pf``, (43) is
``f += W' Lo^-1 (residual - S f)`` and (44), symmetric to the last bit, ``Pf -= W' W``.

What differs from the paper is told in :mod:`estimators.two_stage_ekf`, whose classes own the
arrays that these kernels change in place.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.attitude import wrap
from estimators.jit import kernel
from estimators.kinematics import (
    GS,
    Earth,
    earth_terms,
    linearise,
    output,
    output_jacobian,
    rates,
    state_from_output,
)
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

__all__ = [
    "MAX_WINDOW",
    "MEMORY",
    "TRACK",
    "TUNING",
    "Status",
    "predict",
    "predict_once",
    "run_fixed_rate",
    "run_rows",
    "update",
    "update_once",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Row = Any  # one row of MEMORY, TUNING or TRACK


class Status(IntEnum):
    """What became of a prediction or an update."""

    OK = 0
    """Used."""
    PARTIAL = 1
    """Used; some components of the measurement were missing (NaN)."""
    FROZEN = 2
    """Pitch beyond the limit: faults held until it is back and velocity and angles are measured."""
    WAITING = 3
    """No state yet, or a gap in the inputs: waiting for velocity and angles."""
    SINGULAR = 4
    """A covariance lost positive definiteness: restarted from the next measurements."""
    REJECTED = 5
    """Not finite: the input was replaced by the last good one, the measurement ignored."""
    LATE = 6
    """Older than what the filter has already used: ignored."""


OK, PARTIAL, FROZEN = int(Status.OK), int(Status.PARTIAL), int(Status.FROZEN)
WAITING, SINGULAR = int(Status.WAITING), int(Status.SINGULAR)
REJECTED, LATE = int(Status.REJECTED), int(Status.LATE)


MAX_WINDOW = 50
"""Longest window of (53) that a filter has room for."""

_SIX, _MATRIX = ("<f8", (6,)), ("<f8", (6, 6))

TUNING = np.dtype(
    [
        ("model", "<i8"),
        ("exact", "?"),
        ("adapt", "?"),
        ("divide_by_dt", "?"),
        ("detuning", "<f8"),  # 0: the printed dt_T^2
        ("Qf_floor", "<f8"),
        ("dt_s", "<f8"),  # interval to which Q (one sample) and the initial Qf belong
        ("pitch_limit_rad", "<f8"),
        ("pitch_return_rad", "<f8"),
        ("max_gap_s", "<f8"),
        ("N", "<i8"),
        ("Q", *_SIX),
        ("R", *_SIX),
    ],
    align=True,
)
"""Constants of a filter; see :class:`estimators.two_stage_ekf.Settings`."""

_SCRATCH_MATRICES = (
    *("F", "G", "Phi", "Gamma", "Ubar", "GQG"),
    *("H", "HP", "M", "K", "S", "L", "A", "B", "C"),
)
_SCRATCH_VECTORS = (*("u", "q", "moved", "mask", "r", "eta", "residual", "first", "e"),)

MEMORY = np.dtype(
    [
        ("x", *_SIX),
        ("xbar", *_SIX),
        ("f", *_SIX),
        ("P", *_MATRIX),
        ("Pf", *_MATRIX),
        ("V", *_MATRIX),
        ("Qf", *_SIX),
        ("Qf_interval_s", "<f8", (2,)),  # to which the Qf of each block belongs
        ("gamma", *_SIX),
        ("nis", "<f8"),
        ("um", *_SIX),  # the last good input
        # of two: since the velocity, since the angles were measured
        ("Gamma_T", "<f8", (2, 6, 6)),
        ("Q_T", "<f8", (2, 6, 6)),
        ("since_s", "<f8", (2,)),
        ("window", "<f8", (MAX_WINDOW, 6)),
        ("filled", "<i8", (2,)),  # innovations in the window
        ("head", "<i8", (2,)),  # where the next one goes
        ("seen", "<i8", (2,)),  # measured since the state was lost
        ("updates", "<i8"),
        ("state", "<i8"),  # OK, or the Status that tells why there is no state to work with
        ("started", "?"),
        ("now_us", "<i8"),
        # scratch
        *((name, *_MATRIX) for name in _SCRATCH_MATRICES),
        *((name, *_SIX) for name in _SCRATCH_VECTORS),
        ("k", "<f8", (5, 6)),
    ],
    align=True,
)
"""Everything that a filter remembers, in one row that the kernels change in place."""

TRACK = np.dtype(
    [
        ("f", *_SIX),
        ("f_var", *_SIX),
        ("x", *_SIX),
        ("x_var", *_SIX),
        ("Qf", *_SIX),
        ("gamma", *_SIX),
        ("nis", "<f8"),
        ("status", "<i8"),
    ]
)
"""What a run leaves behind: one row per measurement, symbols as in the table above."""

ITERATED_UPDATES = 10  # lu2016 below (37): "only performed in the first ten time steps"
ITERATIONS = 20
ITERATION_TOLERANCE = 1e-8
SERIES_TERMS = 12
VELOCITY_SCALE_M_S = 100.0
RESTART_ACC_M_S2 = 30.0  # bounds on how far a block has moved since it was measured,
RESTART_RATE_RAD_S = 3.0  # used only to restart after the state was lost
RESTART_WITHIN_S = 1.5


@kernel
def discretise(
    F: Array, G: Array, dt: float, Phi: Array, Gamma: Array, psi: Array, tmp: Array
) -> None:
    """Transition and input matrices over ``dt`` with F and G held.

    ``psi = int_0^dt exp(F t) dt`` by Horner's rule, then Phi = I + F psi and Gamma = psi G: the
    blocks of ``exp([[F, G], [0, 0]] dt)``. As many terms are taken as leave a remainder below
    1e-16, at most twelve; the bound is the norm of F with velocities counted in 100 m/s, because
    gravity couples angles into velocity strongly and nothing couples back.

    Source: lu2016 eq. (33), (34).
    """
    norm = 0.0
    for i in range(6):
        velocity, angles = 0.0, 0.0
        for j in range(3):
            velocity += abs(F[i, j])
            angles += abs(F[i, 3 + j])
        row = (
            velocity + angles / VELOCITY_SCALE_M_S
            if i < 3
            else velocity * VELOCITY_SCALE_M_S + angles
        )
        norm = max(norm, row * dt)
    terms = 1
    remainder = 0.5 * norm
    while remainder > 1e-16 and terms < SERIES_TERMS:
        terms += 1
        remainder *= norm / (terms + 1)
    scale = dt / terms
    for i in range(6):
        for j in range(6):
            psi[i, j] = F[i, j] * scale
        psi[i, i] += 1.0
    for n in range(terms - 1, 1, -1):
        matmul(F, psi, tmp)
        scale = dt / n
        for i in range(6):
            for j in range(6):
                psi[i, j] = tmp[i, j] * scale
            psi[i, i] += 1.0
    for i in range(6):
        for j in range(6):
            psi[i, j] *= dt
    matmul(F, psi, Phi)
    for i in range(6):
        Phi[i, i] += 1.0
    matmul(psi, G, Gamma)


@kernel
def runge_kutta(
    model: int, at: Array, u: Array, earth: Earth, dt: float, k: Array, out: Array
) -> None:
    """One classical Runge-Kutta step from `at` with a held input; the integral of (31).

    k : (5, 6) is scratch.
    """
    k1, k2, k3, k4, x = k[0], k[1], k[2], k[3], k[4]
    rates(model, at, u, earth, k1)
    for i in range(6):
        x[i] = at[i] + 0.5 * dt * k1[i]
    rates(model, x, u, earth, k2)
    for i in range(6):
        x[i] = at[i] + 0.5 * dt * k2[i]
    rates(model, x, u, earth, k3)
    for i in range(6):
        x[i] = at[i] + dt * k3[i]
    rates(model, x, u, earth, k4)
    for i in range(6):
        out[i] = at[i] + dt / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])


@kernel
def lose(s: Row, reason: int) -> int:
    """Give the state up until both blocks are measured again; faults and Pf are held."""
    s.state = reason
    s.seen[0] = 0
    s.seen[1] = 0
    return reason


@kernel
def accumulate(s: Row) -> None:
    """Carry Gamma_T and Q_T over one prediction; both blocks share the first while in step."""
    for b in range(1 if s.since_s[0] == s.since_s[1] else 2):
        if s.since_s[b] == 0.0:
            copy(s.Gamma, s.Gamma_T[b])
            copy(s.GQG, s.Q_T[b])
        else:
            matmul(s.Phi, s.Gamma_T[b], s.A)
            congruence(s.Phi, s.Q_T[b], s.B, s.Q_T[b])
            for i in range(6):
                for j in range(6):
                    s.Gamma_T[b, i, j] = s.A[i, j] + s.Gamma[i, j]
                    s.Q_T[b, i, j] += s.GQG[i, j]


@kernel
def predict(s: Row, t: Row, um: Array, earth: Earth, dt: float) -> int:
    """Carry state, faults and covariances over ``dt`` seconds of one held input.

    Parameters
    ----------
    s, t : row of MEMORY, row of TUNING
    um : (6,) float64 [m/s^2, rad/s]
        Measured specific force and rates; when not finite the last good one stands in.
    earth : 4 floats
    dt : float [s]
        Zero does nothing.

    Source: lu2016 eq. (31)-(34), (40), (41), (45)-(49), with V_k-1 = U_k-1 where no measurement
    came in between.
    """
    status = OK
    for i in range(6):
        if not math.isfinite(um[i]):
            status = REJECTED
    if status == OK:
        for i in range(6):
            s.um[i] = um[i]
    if not dt > 0.0:
        return status
    if s.state == OK and dt > t.max_gap_s:
        lose(s, WAITING)
    if s.state != OK:
        s.since_s[0] += dt
        s.since_s[1] += dt
        return int(s.state)

    F, G, Phi, Gamma, Ubar, GQG = s.F, s.G, s.Phi, s.Gamma, s.Ubar, s.GQG
    u, q, A, B, V = s.u, s.q, s.A, s.B, s.V
    if t.exact:
        for i in range(6):
            s.eta[i], u[i] = s.x[i], s.um[i] - s.f[i]
    else:
        for i in range(6):
            s.eta[i], u[i] = s.xbar[i], s.um[i]
    runge_kutta(t.model, s.eta, u, earth, dt, s.k, s.moved)
    if not abs(s.moved[4]) < t.pitch_limit_rad:
        return lose(s, FROZEN)
    linearise(t.model, s.eta, u, earth, F, G)
    discretise(F, G, dt, Phi, Gamma, A, B)

    for i in range(6):
        q[i] = s.Qf[i] * (dt / s.Qf_interval_s[i // 3])
        s.Pf[i, i] += q[i]  # (41)
    if not cholesky(s.Pf, s.L):
        return lose(s, SINGULAR)
    matmul(Phi, V, Ubar)
    for i in range(6):
        for j in range(6):
            Ubar[i, j] += Gamma[i, j]  # (47)
            B[i, j] = Ubar[i, j] * q[j]
            A[j, i] = B[i, j]
    forward(s.L, A)
    backward(s.L, A)
    per_sample = t.dt_s / dt
    for i in range(6):
        for j in range(6):
            V[i, j] = Ubar[i, j] - A[j, i]  # (49): U_k
            GQG[i, j] = 0.0
        q[i] = t.Q[i] * per_sample
    add_congruence_diagonal(Gamma, q, GQG)
    congruence(Phi, s.P, A, s.P)  # (32) with (46)
    matmul_symmetric(V, B, A)
    for i in range(6):
        for j in range(6):
            s.P[i, j] += A[i, j] + GQG[i, j]

    for i in range(6):
        xf = 0.0
        ubar = 0.0
        for j in range(6):
            xf += V[i, j] * s.f[j]
            ubar += Ubar[i, j] * s.f[j]
        # exact: the state freed of faults was integrated; paper: (31) with (45)
        s.xbar[i] = s.moved[i] - xf if t.exact else s.moved[i] + (ubar - xf)
        s.x[i] = s.xbar[i] + xf

    if t.adapt:
        accumulate(s)
    s.since_s[0] += dt
    s.since_s[1] += dt
    return status


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


@kernel
def record(s: Row, out: Row, status: int) -> None:
    """Write the present estimates into a row of TRACK; the state's variance is (52)'s diagonal."""
    matmul(s.V, s.Pf, s.A)
    for i in range(6):
        variance = s.P[i, i]
        for j in range(6):
            variance += s.A[i, j] * s.V[i, j]
        out.f[i] = s.f[i]
        out.f_var[i] = s.Pf[i, i]
        out.x[i] = s.x[i]
        out.x_var[i] = variance
        out.Qf[i] = s.Qf[i]
        out.gamma[i] = s.gamma[i]
    out.nis = s.nis
    out.status = status


@kernel
def predict_once(
    memory: Row, tuning: Row, um: Array, latitude_rad: float, altitude_m: float, dt: float
) -> int:
    """:func:`predict` for a caller outside the kernels."""
    return predict(memory[0], tuning[0], um, earth_terms(latitude_rad, altitude_m), dt)


@kernel
def update_once(memory: Row, tuning: Row, y: Array) -> int:
    """:func:`update` for a caller outside the kernels."""
    return update(memory[0], tuning[0], y)


@kernel
def run_fixed_rate(
    memory: Row, tuning: Row, um: Array, y: Array, env: Array, dt: float, out: Row
) -> None:
    """Predict with ``um[k], env[k]``, update with ``y[k]``, record in ``out[k]``, row after row."""
    s, t = memory[0], tuning[0]
    for k in range(um.shape[0]):
        predicted = predict(s, t, um[k], earth_terms(env[k, 0], env[k, 1]), dt)
        updated = update(s, t, y[k])
        record(s, out[k], max(predicted, updated))


@kernel
def run_rows(
    memory: Row,
    tuning: Row,
    imu_t_us: Ints,
    um: Array,
    meas_t_us: Ints,
    y: Array,
    env: Array,
    until_us: int,
    out: Row,
) -> tuple[int, int]:
    """Use inputs and measurements in the order of their times, up to and including ``until_us``.

    An input holds from its time to the next input's; a measurement inside that interval splits it.
    Rows must be sorted by time within each array. One row of `out` per measurement used.

    Returns
    -------
    inputs, measurements : int
        How many rows of each were consumed, late ones included.
    """
    s, t = memory[0], tuning[0]
    earth = earth_terms(env[0], env[1])
    i, m = 0, 0
    while True:
        next_imu = imu_t_us[i] if i < imu_t_us.shape[0] else until_us + 1
        next_meas = meas_t_us[m] if m < meas_t_us.shape[0] else until_us + 1
        at = min(next_imu, next_meas)
        if at > until_us:
            return i, m
        late = s.started and at < s.now_us
        status = OK if s.started else WAITING
        if not late:
            if s.started:
                status = predict(s, t, s.um, earth, (at - s.now_us) * 1e-6)
            s.now_us = at
        if next_meas <= next_imu:
            if late:
                status = LATE
            elif s.started:
                status = max(status, update(s, t, y[m]))
            record(s, out[m], status)
            m += 1
        else:
            if not late:
                s.started = True
                predict(s, t, um[i], earth, 0.0)
            i += 1
