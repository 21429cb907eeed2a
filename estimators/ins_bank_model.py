"""One inertial filter on aided kinematics, and the signature that each IMU fault leaves in it.

The filter estimates velocity, height, attitude, slow IMU biases and the errors of its references.
Beside it every *window* carries ``F``, the change that a unit step of each of the six input faults
at the window's start has made to the estimation error since, and gathers what the innovations say
of such steps. ``F`` is the ``V`` of the two-stage filter and ``(L, y)`` the information form of its
bias filter with Q^f = 0: ``f = L^-1 y`` with covariance ``L^-1``.

=========  ==========================================================  ============  ============
symbol     meaning                                                     shape         unit
=========  ==========================================================  ============  ============
x          mean, in the parts below (PHI is always 0: it lives in R)   (17,)         SI
VEL        velocity over the ground, NED                               3             m/s
HGT        height                                                      1             m
PHI        attitude error, ``R_true = exp([phi]x) R``, NED             3             rad
F_ACC      specific-force fault (measured minus true), body            3             m/s^2
F_GYRO     angular-rate fault, body                                    3             rad/s
E_REF      mode ATT: error of the attitude reference, NED;             3             rad
           mode INS: wind N, E, error of the heading reference                       m/s, rad
E_BARO     error of the static-pressure height                         1             m
R          ned_from_frd                                                (3, 3)        1
P          covariance of the error                                     (17, 17)      SI
T          time since the last measurement                             scalar        s
S          integral of the specific force, NED                         (3,)          m/s
G          integral of R                                               (3, 3)        s
B          integral of [a]x G                                          (3, 3)        m
F          error per unit step of each fault at the window's start,    (17, 66)      SI
           six columns per window, side by side
L, y       information on the step, and its right-hand side            (6, 6), (6,)  SI
q          gain times the innovation's deviation, ``P H' / sqrt(s)``   (17,)         SI
g          innovation per unit step, in deviations, ``H F / sqrt(s)``  (6,)          1/SI
=========  ==========================================================  ============  ============

Between measurements (lu2016 eq. (1)-(9) on the flat part, the turning earth added to the mean):

    v' = R (a_m - f_a) + g - (2 w_ie + w_en) x v,    h' = -v_D,    R' = R [w_m - f_w - R^T w_in]x

so that over the time T the error obeys

    dv <- dv - [S]x phi + B df_w - G df_a,   phi <- phi - G df_w,   df <- df.

Source: lu2016 eq. (31)-(52); Friedland 1969 (separate bias); Willsky and Jones 1976 (a jump in the
state, found by its signature in the innovations).

Differs: lu2016 predicts with a measurement at every IMU sample and lets the bias filter forget
through an adapted Q^f. Measurements here are slow, late and of several rates; forgetting is by
windows of several lengths that restart, which keeps the statistic of every window normal with unit
variance when there is no fault. Attitude is a rotation matrix (no freeze near the vertical).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import inlined, kernel

__all__ = [
    "ATT",
    "COLUMNS",
    "INS",
    "MAX_WINDOWS",
    "N",
    "Six",
    "apply_transition",
    "carry",
    "close_interval",
    "inject",
    "integrate",
    "scalar_update",
]

Array = NDArray[np.float64]

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]
"""Vectors and (3, 3) matrices, row by row, that live in registers: an array costs an allocation."""

N = 17
VEL, HGT, PHI = 0, 3, 4
F_ACC, F_GYRO = 7, 10
E_REF, E_BARO = 13, 16
"""First index of each part of the state; the parts of three are contiguous."""

WIND, E_HEAD = 13, 15
"""What E_REF holds in mode INS: wind N and E, then the error of the heading reference."""

MAX_WINDOWS = 11
COLUMNS = 6 * MAX_WINDOWS
"""Windows of a filter at most, and columns of F: a distance between its rows that the compiler
knows, without which it does not use vector instructions."""

INS, ATT = 0, 1
"""Modes: without and with the vehicle's own roll and pitch."""

EARTH_RATE_RAD_S = 7.292115e-5
EARTH_RADIUS_M = 6371000.0
PER_RADIUS = 1.0 / EARTH_RADIUS_M

ACC_T, ACC_S, ACC_G, ACC_B, ACC_QV, ACC_QPHI = 0, 1, 4, 13, 22, 25
N_ACC = 28
"""Where T, S, G, B and the gathered velocity and attitude noise stand in the accumulator."""

SERIES = 0.01
COS_2, COS_4, COS_6, COS_8 = -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0
SINC_2, SINC_4, SINC_6, SINC_8 = -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0
"""Taylor series of the cosine and of sin(x) / x in x^2; below this x^2 exact to rounding."""


@inlined
def rotation(r0: float, r1: float, r2: float) -> Nine:
    """Matrix of a rotation vector [rad]; see ``attitude.dcm_from_rotation_vector``."""
    s = 0.25 * (r0 * r0 + r1 * r1 + r2 * r2)
    if s < SERIES:
        q0 = 1.0 + s * (COS_2 + s * (COS_4 + s * (COS_6 + s * COS_8)))
        k = 0.5 * (1.0 + s * (SINC_2 + s * (SINC_4 + s * (SINC_6 + s * SINC_8))))
    else:
        half = math.sqrt(s)
        q0, k = math.cos(half), 0.5 * math.sin(half) / half
    q1, q2, q3 = k * r0, k * r1, k * r2
    return (
        q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3,
        2.0 * (q1 * q2 - q0 * q3),
        2.0 * (q1 * q3 + q0 * q2),
        2.0 * (q1 * q2 + q0 * q3),
        q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3,
        2.0 * (q2 * q3 - q0 * q1),
        2.0 * (q1 * q3 - q0 * q2),
        2.0 * (q2 * q3 + q0 * q1),
        q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3,
    )


@inlined
def turned(a0: float, a1: float, a2: float, T: Nine) -> Three:
    """Row vector a times a matrix."""
    return (
        a0 * T[0] + a1 * T[3] + a2 * T[6],
        a0 * T[1] + a1 * T[4] + a2 * T[7],
        a0 * T[2] + a1 * T[5] + a2 * T[8],
    )


@inlined
def gather(acc: Array, i: int, mid: Three, var: Six, dt: float) -> None:
    """Row i of G and of the gathered noise (in place); ``mid`` is that row of the middle R."""
    m0, m1, m2 = mid
    acc[ACC_G + 3 * i] += dt * m0
    acc[ACC_G + 3 * i + 1] += dt * m1
    acc[ACC_G + 3 * i + 2] += dt * m2
    s0, s1, s2 = dt * m0 * m0, dt * m1 * m1, dt * m2 * m2
    acc[ACC_QV + i] += s0 * var[0] + s1 * var[1] + s2 * var[2]
    acc[ACC_QPHI + i] += s0 * var[3] + s1 * var[4] + s2 * var[5]


@kernel
def integrate(
    x: Array, R: Array, acc: Array, u: Array, u_var: Array, lat: float, g: float, dt: float
) -> None:
    """Carry the mean and the integrals of one filter over ``dt`` (in place).

    Parameters
    ----------
    x : (17,) float64
        Mean.
    R : (3, 3) float64
        ned_from_frd.
    acc : (28,) float64
        Integrals since the last measurement.
    u : (6,) float64 [m/s^2, rad/s]
        Measured specific force and rates, averaged over ``dt``.
    u_var : (6,) float64 [m^2/s^3, rad^2/s]
        Noise densities of ``u``, squared.
    lat, g : float [rad, m/s^2]
        Latitude and local gravity.
    dt : float [s]
    """
    mean = u[0], u[1], u[2], u[3], u[4], u[5]
    var = u_var[0], u_var[1], u_var[2], u_var[3], u_var[4], u_var[5]
    carry(x, R, acc, mean, var, math.cos(lat), math.sin(lat), math.tan(lat), g, dt)


@inlined
def carry(
    x: Array,
    R: Array,
    acc: Array,
    u: Six,
    u_var: Six,
    cos_lat: float,
    sin_lat: float,
    tan_lat: float,
    g: float,
    dt: float,
) -> None:
    """:func:`integrate` with the latitude's functions known: both filters of an IMU share them.

    It runs at every sample of every filter, hence without arrays of its own.
    """
    w_n = EARTH_RATE_RAD_S * cos_lat
    w_d = -EARTH_RATE_RAD_S * sin_lat
    v_n, v_e, v_d = x[0], x[1], x[2]
    r_n, r_e, r_d = PER_RADIUS * v_e, -PER_RADIUS * v_n, -PER_RADIUS * v_e * tan_lat
    n0, n1, n2 = R[0, 0], R[0, 1], R[0, 2]
    e0, e1, e2 = R[1, 0], R[1, 1], R[1, 2]
    d0, d1, d2 = R[2, 0], R[2, 1], R[2, 2]
    i_n, i_d = w_n + r_n, w_d + r_d
    half = 0.5 * dt
    T = rotation(
        half * (u[3] - x[F_GYRO] - (n0 * i_n + e0 * r_e + d0 * i_d)),
        half * (u[4] - x[F_GYRO + 1] - (n1 * i_n + e1 * r_e + d1 * i_d)),
        half * (u[5] - x[F_GYRO + 2] - (n2 * i_n + e2 * r_e + d2 * i_d)),
    )
    n, e, d = turned(n0, n1, n2, T), turned(e0, e1, e2, T), turned(d0, d1, d2, T)
    R[0, 0], R[0, 1], R[0, 2] = turned(n[0], n[1], n[2], T)
    R[1, 0], R[1, 1], R[1, 2] = turned(e[0], e[1], e[2], T)
    R[2, 0], R[2, 1], R[2, 2] = turned(d[0], d[1], d[2], T)

    f0, f1, f2 = u[0] - x[F_ACC], u[1] - x[F_ACC + 1], u[2] - x[F_ACC + 2]
    a_n = n[0] * f0 + n[1] * f1 + n[2] * f2
    a_e = e[0] * f0 + e[1] * f1 + e[2] * f2
    a_d = d[0] * f0 + d[1] * f1 + d[2] * f2
    c_n, c_e, c_d = 2.0 * w_n + r_n, r_e, 2.0 * w_d + r_d
    now_d = v_d + dt * (a_d - (c_n * v_e - c_e * v_n) + g)
    x[0] = v_n + dt * (a_n - (c_e * v_d - c_d * v_e))
    x[1] = v_e + dt * (a_e - (c_d * v_n - c_n * v_d))
    x[2] = now_d
    x[HGT] -= half * (v_d + now_d)

    acc[ACC_T] += dt
    acc[ACC_S] += dt * a_n
    acc[ACC_S + 1] += dt * a_e
    acc[ACC_S + 2] += dt * a_d
    for j in range(3):
        # [a]x times the middle value of G, column by column.
        g_n = acc[ACC_G + j] + half * n[j]
        g_e = acc[ACC_G + 3 + j] + half * e[j]
        g_d = acc[ACC_G + 6 + j] + half * d[j]
        acc[ACC_B + j] += dt * (a_e * g_d - a_d * g_e)
        acc[ACC_B + 3 + j] += dt * (a_d * g_n - a_n * g_d)
        acc[ACC_B + 6 + j] += dt * (a_n * g_e - a_e * g_n)
    gather(acc, 0, n, u_var, dt)
    gather(acc, 1, e, u_var, dt)
    gather(acc, 2, d, u_var, dt)


@inlined
def apply_transition(M: Array, down: int, along: int, count: int, acc: Array, decay: Array) -> None:
    """``M <- Phi M`` for the transition that the accumulator describes (in place).

    Parameters
    ----------
    M : (n,) float64
        Columns of 17 errors, in one flat array.
    down, along : int
        Distance of two errors of a column, and of two columns: constants of the caller, so that
        vector instructions can be used.
    count : int
        Number of columns.
    acc : (28,) float64
        Integrals since the last measurement.
    decay : (4,) float64 [1]
        Factors of E_REF (3) and E_BARO over the time T.
    """
    T, s0, s1, s2 = acc[ACC_T], acc[ACC_S], acc[ACC_S + 1], acc[ACC_S + 2]
    G, B = ACC_G, ACC_B
    g00, g01, g02 = acc[G], acc[G + 1], acc[G + 2]
    g10, g11, g12 = acc[G + 3], acc[G + 4], acc[G + 5]
    g20, g21, g22 = acc[G + 6], acc[G + 7], acc[G + 8]
    b00, b01, b02 = acc[B], acc[B + 1], acc[B + 2]
    b10, b11, b12 = acc[B + 3], acc[B + 4], acc[B + 5]
    b20, b21, b22 = acc[B + 6], acc[B + 7], acc[B + 8]
    k0, k1, k2, k3 = decay[0], decay[1], decay[2], decay[3]
    v, phi, ref = down * VEL, down * PHI, down * E_REF
    acc_at, gyro_at = down * F_ACC, down * F_GYRO
    for column in range(count):
        at = along * column
        v_d = M[at + v + 2 * down]
        p0, p1, p2 = M[at + phi], M[at + phi + down], M[at + phi + 2 * down]
        a0, a1, a2 = M[at + acc_at], M[at + acc_at + down], M[at + acc_at + 2 * down]
        w0, w1, w2 = M[at + gyro_at], M[at + gyro_at + down], M[at + gyro_at + 2 * down]
        now_d = (
            v_d
            - (s0 * p1 - s1 * p0)
            + (b20 * w0 + b21 * w1 + b22 * w2)
            - (g20 * a0 + g21 * a1 + g22 * a2)
        )
        M[at + v] += (
            (b00 * w0 + b01 * w1 + b02 * w2)
            - (g00 * a0 + g01 * a1 + g02 * a2)
            - (s1 * p2 - s2 * p1)
        )
        M[at + v + down] += (
            (b10 * w0 + b11 * w1 + b12 * w2)
            - (g10 * a0 + g11 * a1 + g12 * a2)
            - (s2 * p0 - s0 * p2)
        )
        M[at + v + 2 * down] = now_d
        M[at + down * HGT] -= 0.5 * T * (v_d + now_d)
        M[at + phi] = p0 - (g00 * w0 + g01 * w1 + g02 * w2)
        M[at + phi + down] = p1 - (g10 * w0 + g11 * w1 + g12 * w2)
        M[at + phi + 2 * down] = p2 - (g20 * w0 + g21 * w1 + g22 * w2)
        M[at + ref] *= k0
        M[at + ref + down] *= k1
        M[at + ref + 2 * down] *= k2
        M[at + ref + 3 * down] *= k3


@kernel
def close_interval(
    x: Array, P: Array, F: Array, n: int, acc: Array, ref_std: Array, ref_tau: Array, qf: Array
) -> None:
    """Bring covariance and signatures to the mean's time, and empty the accumulator (in place).

    Parameters
    ----------
    x : (17,) float64
        Mean; only its reference errors decay here.
    P : (17, 17) float64
        Covariance at the last measurement.
    F : (17, 66) float64
        Signatures of the windows.
    n : int
        How many of its columns are in use.
    acc : (28,) float64
        Integrals since the last measurement.
    ref_std, ref_tau : (4,) float64 [rad or m/s or m; s]
        Standard deviation and correlation time of each reference error (first-order Gauss-Markov).
    qf : (6,) float64 [m^2/s^5, rad^2/s^3]
        Density of the random walk of each fault.
    """
    T = acc[ACC_T]
    if T <= 0.0:
        return
    decay = np.empty(4)
    for i in range(4):
        decay[i] = math.exp(-T / ref_tau[i])
        x[E_REF + i] *= decay[i]
    apply_transition(F.reshape(N * COLUMNS), COLUMNS, 1, n, acc, decay)
    # Phi P, then of Phi P Phi' what Phi changes: the faults stay, so the rest is the transpose.
    apply_transition(P.reshape(N * N), N, 1, N, acc, decay)
    apply_transition(P.reshape(N * N), 1, N, F_ACC, acc, decay)
    for i in range(F_ACC, N):
        for j in range(4):
            P[i, E_REF + j] *= decay[j]
    for i in range(3):
        P[VEL + i, VEL + i] += acc[ACC_QV + i]
        P[PHI + i, PHI + i] += acc[ACC_QPHI + i]
    P[HGT, HGT] += 0.25 * T * T * acc[ACC_QV + 2]
    for i in range(6):
        P[F_ACC + i, F_ACC + i] += qf[i] * T
    for i in range(4):
        P[E_REF + i, E_REF + i] += ref_std[i] ** 2 * (1.0 - decay[i] ** 2)
    for i in range(1, N):
        for j in range(i):
            P[i, j] = P[j, i]
    for i in range(N_ACC):
        acc[i] = 0.0


@kernel
def scalar_update(
    x: Array,
    P: Array,
    F: Array,
    L: Array,
    Y: Array,
    windows: int,
    h: Array,
    nu: float,
    r: float,
) -> float:
    """Use one scalar measurement, and what it says of a step in every window (in place).

    Parameters
    ----------
    x : (17,) float64
        Mean; the caller rotates R by ``x[PHI]`` afterwards, see :func:`inject`.
    P : (17, 17) float64
    F : (17, 66), L : (W, 6, 6), Y : (W, 6) float64
        Signatures, information and right-hand sides of the windows.
    windows : int
        How many of the windows are in use.
    h : (17,) float64
        Row of H.
    nu, r : float
        Innovation and variance of the measurement's noise.

    Returns
    -------
    float
        Normalised innovation squared, ``nu^2 / s``.
    """
    columns = 6 * windows
    q, g = np.zeros(N), np.zeros(COLUMNS)
    s = r
    for j in range(N):
        if h[j] != 0.0:
            for k in range(N):
                q[k] += h[j] * P[j, k]
            for k in range(columns):
                g[k] += h[j] * F[j, k]
    for j in range(N):
        s += h[j] * q[j]
    scale = 1.0 / math.sqrt(s)
    for k in range(N):
        q[k] *= scale
    for k in range(columns):
        g[k] *= scale
    nu *= scale
    for i in range(N):
        gain = q[i]
        x[i] += gain * nu
        for k in range(N):
            P[i, k] -= gain * q[k]
        for k in range(columns):
            F[i, k] -= gain * g[k]
    for w in range(windows):
        for k in range(6):
            per_step = g[6 * w + k]
            Y[w, k] += per_step * nu
            for m in range(6):
                L[w, k, m] += per_step * g[6 * w + m]
    return nu * nu


@kernel
def inject(x: Array, R: Array) -> None:
    """Move the attitude correction from the mean into the rotation matrix (in place)."""
    T = rotation(x[PHI], x[PHI + 1], x[PHI + 2])
    for j in range(3):
        n, e, d = R[0, j], R[1, j], R[2, j]
        R[0, j] = T[0] * n + T[1] * e + T[2] * d
        R[1, j] = T[3] * n + T[4] * e + T[5] * d
        R[2, j] = T[6] * n + T[7] * e + T[8] * d
    x[PHI : PHI + 3] = 0.0
