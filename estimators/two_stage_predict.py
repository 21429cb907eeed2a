"""Adaptive two-stage EKF: carry state, faults and covariances over one held input.

Symbols as in :mod:`estimators.two_stage_memory`.
"""

from __future__ import annotations

import math

from estimators.jit import kernel
from estimators.kinematics import Earth, linearise, rates
from estimators.linalg import (
    add_congruence_diagonal,
    backward,
    cholesky,
    congruence,
    copy,
    forward,
    matmul,
    matmul_symmetric,
)
from estimators.two_stage_memory import FROZEN, OK, REJECTED, SINGULAR, WAITING, Array, Row, lose

__all__ = ["discretise", "predict", "runge_kutta"]

SERIES_TERMS = 12
"""At most; the paper leaves the number open."""

VELOCITY_SCALE_M_S = 100.0


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
