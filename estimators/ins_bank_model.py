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
F          error per unit step of each fault at the window's start     (17, 6)       SI
L, y       information on the step, and its right-hand side            (6, 6), (6,)  SI
g          innovation per unit step, ``H F``                           (6,)          SI
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

from estimators.attitude import SMALL_ANGLE_RAD, dcm_from_rotation_vector
from estimators.jit import inlined, kernel

__all__ = [
    "ATT",
    "INS",
    "N",
    "apply_transition",
    "carry",
    "close_interval",
    "inject",
    "integrate",
    "product",
    "scalar_update",
]

Array = NDArray[np.float64]

N = 17
VEL, HGT, PHI = 0, 3, 4
F_ACC, F_GYRO = 7, 10
E_REF, E_BARO = 13, 16
"""First index of each part of the state; the parts of three are contiguous."""

WIND, E_HEAD = 13, 15
"""What E_REF holds in mode INS: wind N and E, then the error of the heading reference."""

INS, ATT = 0, 1
"""Modes: without and with the vehicle's own roll and pitch."""

EARTH_RATE_RAD_S = 7.292115e-5
EARTH_RADIUS_M = 6371000.0

ACC_T, ACC_S, ACC_G, ACC_B, ACC_QV, ACC_QPHI = 0, 1, 4, 13, 22, 25
N_ACC = 28
"""Where T, S, G, B and the gathered velocity and attitude noise stand in the accumulator."""


@kernel
def product(A: Array, B: Array) -> Array:
    """Product of two (3, 3) matrices."""
    C = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return C


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
    carry(x, R, acc, u, u_var, math.cos(lat), math.sin(lat), math.tan(lat), g, dt)


@inlined
def carry(
    x: Array,
    R: Array,
    acc: Array,
    u: Array,
    u_var: Array,
    cos_lat: float,
    sin_lat: float,
    tan_lat: float,
    g: float,
    dt: float,
) -> None:
    """:func:`integrate` with the latitude's functions known: both filters of an IMU share them.

    It runs at every sample of every filter, hence without small arrays or calls.
    """
    w_n = EARTH_RATE_RAD_S * cos_lat
    w_d = -EARTH_RATE_RAD_S * sin_lat
    r_n = x[1] / EARTH_RADIUS_M
    r_e = -x[0] / EARTH_RADIUS_M
    r_d = -x[1] * tan_lat / EARTH_RADIUS_M
    e_n, e_d = w_n + r_n, w_d + r_d
    earth = R[0, 0] * e_n + R[1, 0] * r_e + R[2, 0] * e_d
    h0 = 0.5 * dt * (u[3] - x[F_GYRO] - earth)
    earth = R[0, 1] * e_n + R[1, 1] * r_e + R[2, 1] * e_d
    h1 = 0.5 * dt * (u[4] - x[F_GYRO + 1] - earth)
    earth = R[0, 2] * e_n + R[1, 2] * r_e + R[2, 2] * e_d
    h2 = 0.5 * dt * (u[5] - x[F_GYRO + 2] - earth)
    # The rotation by half the step, as attitude.dcm_from_rotation_vector has it.
    angle2 = h0 * h0 + h1 * h1 + h2 * h2
    half = 0.5 * math.sqrt(angle2)
    if half < SMALL_ANGLE_RAD:
        sinc = 0.5 * (1.0 - angle2 / 24.0 + angle2 * angle2 / 1920.0)
    else:
        sinc = 0.5 * math.sin(half) / half
    q0, q1, q2, q3 = math.cos(half), sinc * h0, sinc * h1, sinc * h2
    t00 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3
    t11 = q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3
    t22 = q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
    t01, t10 = 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q2 + q0 * q3)
    t02, t20 = 2.0 * (q1 * q3 + q0 * q2), 2.0 * (q1 * q3 - q0 * q2)
    t12, t21 = 2.0 * (q2 * q3 - q0 * q1), 2.0 * (q2 * q3 + q0 * q1)
    mid = np.empty((3, 3))
    for i in range(3):
        m0 = R[i, 0] * t00 + R[i, 1] * t10 + R[i, 2] * t20
        m1 = R[i, 0] * t01 + R[i, 1] * t11 + R[i, 2] * t21
        m2 = R[i, 0] * t02 + R[i, 1] * t12 + R[i, 2] * t22
        mid[i, 0], mid[i, 1], mid[i, 2] = m0, m1, m2
        R[i, 0] = m0 * t00 + m1 * t10 + m2 * t20
        R[i, 1] = m0 * t01 + m1 * t11 + m2 * t21
        R[i, 2] = m0 * t02 + m1 * t12 + m2 * t22
    f0, f1, f2 = u[0] - x[F_ACC], u[1] - x[F_ACC + 1], u[2] - x[F_ACC + 2]
    a0 = mid[0, 0] * f0 + mid[0, 1] * f1 + mid[0, 2] * f2
    a1 = mid[1, 0] * f0 + mid[1, 1] * f1 + mid[1, 2] * f2
    a2 = mid[2, 0] * f0 + mid[2, 1] * f1 + mid[2, 2] * f2
    c_n, c_e, c_d = 2.0 * w_n + r_n, r_e, 2.0 * w_d + r_d
    v_d = x[2]
    dv_n = a0 - (c_e * x[2] - c_d * x[1])
    dv_e = a1 - (c_d * x[0] - c_n * x[2])
    dv_d = a2 - (c_n * x[1] - c_e * x[0]) + g
    x[0] += dt * dv_n
    x[1] += dt * dv_e
    x[2] += dt * dv_d
    x[HGT] -= 0.5 * dt * (v_d + x[2])

    acc[ACC_T] += dt
    for j in range(3):
        # [a]x times the middle value of G, column by column.
        g0 = acc[ACC_G + j] + 0.5 * dt * mid[0, j]
        g1 = acc[ACC_G + 3 + j] + 0.5 * dt * mid[1, j]
        g2 = acc[ACC_G + 6 + j] + 0.5 * dt * mid[2, j]
        acc[ACC_B + j] += dt * (a1 * g2 - a2 * g1)
        acc[ACC_B + 3 + j] += dt * (a2 * g0 - a0 * g2)
        acc[ACC_B + 6 + j] += dt * (a0 * g1 - a1 * g0)
    acc[ACC_S] += dt * a0
    acc[ACC_S + 1] += dt * a1
    acc[ACC_S + 2] += dt * a2
    for i in range(3):
        for j in range(3):
            acc[ACC_G + 3 * i + j] += dt * mid[i, j]
            acc[ACC_QV + i] += dt * mid[i, j] * mid[i, j] * u_var[j]
            acc[ACC_QPHI + i] += dt * mid[i, j] * mid[i, j] * u_var[3 + j]


@kernel
def apply_transition(M: Array, acc: Array, decay: Array) -> None:
    """``M <- Phi M`` for the transition that the accumulator describes (in place).

    Parameters
    ----------
    M : (17, m) float64
        Columns of errors.
    acc : (28,) float64
        Integrals since the last measurement.
    decay : (4,) float64 [1]
        Factors of E_REF (3) and E_BARO over the time T.
    """
    T, s0, s1, s2 = acc[ACC_T], acc[ACC_S], acc[ACC_S + 1], acc[ACC_S + 2]
    for k in range(M.shape[1]):
        p0, p1, p2 = M[PHI, k], M[PHI + 1, k], M[PHI + 2, k]
        v_d = M[2, k]
        M[0, k] -= s1 * p2 - s2 * p1
        M[1, k] -= s2 * p0 - s0 * p2
        M[2, k] -= s0 * p1 - s1 * p0
        for j in range(3):
            f_a, f_w = M[F_ACC + j, k], M[F_GYRO + j, k]
            for i in range(3):
                G = acc[ACC_G + 3 * i + j]
                M[i, k] += acc[ACC_B + 3 * i + j] * f_w - G * f_a
                M[PHI + i, k] -= G * f_w
        M[HGT, k] -= 0.5 * T * (v_d + M[2, k])
        for i in range(4):
            M[E_REF + i, k] *= decay[i]


@kernel
def close_interval(
    x: Array, P: Array, F: Array, acc: Array, ref_std: Array, ref_tau: Array, qf: Array
) -> None:
    """Bring covariance and signatures to the mean's time, and empty the accumulator (in place).

    Parameters
    ----------
    x : (17,) float64
        Mean; only its reference errors decay here.
    P : (17, 17) float64
        Covariance at the last measurement.
    F : (W, 17, 6) float64
        Signatures of the windows.
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
    apply_transition(P, acc, decay)
    for i in range(N):
        for j in range(i):
            P[i, j], P[j, i] = P[j, i], P[i, j]
    apply_transition(P, acc, decay)
    for w in range(F.shape[0]):
        apply_transition(F[w], acc, decay)
    for i in range(3):
        P[VEL + i, VEL + i] += acc[ACC_QV + i]
        P[PHI + i, PHI + i] += acc[ACC_QPHI + i]
    P[HGT, HGT] += 0.25 * T * T * acc[ACC_QV + 2]
    for i in range(6):
        P[F_ACC + i, F_ACC + i] += qf[i] * T
    for i in range(4):
        P[E_REF + i, E_REF + i] += ref_std[i] ** 2 * (1.0 - decay[i] ** 2)
    for i in range(N):
        for j in range(i):
            P[i, j] = 0.5 * (P[i, j] + P[j, i])
            P[j, i] = P[i, j]
    for i in range(N_ACC):
        acc[i] = 0.0


@kernel
def scalar_update(
    x: Array, P: Array, F: Array, L: Array, Y: Array, h: Array, nu: float, r: float
) -> float:
    """Use one scalar measurement, and what it says of a step in every window (in place).

    Parameters
    ----------
    x : (17,) float64
        Mean; the caller rotates R by ``x[PHI]`` afterwards, see :func:`inject`.
    P : (17, 17) float64
    F : (W, 17, 6), L : (W, 6, 6), Y : (W, 6) float64
        Signatures, information and right-hand sides of the windows.
    h : (17,) float64
        Row of H.
    nu, r : float
        Innovation and variance of the measurement's noise.

    Returns
    -------
    float
        Normalised innovation squared, ``nu^2 / s``.
    """
    Ph = np.zeros(N)
    for j in range(N):
        if h[j] != 0.0:
            for i in range(N):
                Ph[i] += P[i, j] * h[j]
    s = r
    for j in range(N):
        s += h[j] * Ph[j]
    g = np.empty(6)
    for w in range(F.shape[0]):
        for k in range(6):
            g[k] = 0.0
        for j in range(N):
            if h[j] != 0.0:
                for k in range(6):
                    g[k] += h[j] * F[w, j, k]
        for k in range(6):
            Y[w, k] += g[k] * nu / s
            for m in range(6):
                L[w, k, m] += g[k] * g[m] / s
        for i in range(N):
            gain = Ph[i] / s
            for k in range(6):
                F[w, i, k] -= gain * g[k]
    for i in range(N):
        x[i] += Ph[i] / s * nu
        for j in range(i + 1):
            P[i, j] -= Ph[i] * Ph[j] / s
            P[j, i] = P[i, j]
    return nu * nu / s


@kernel
def inject(x: Array, R: Array) -> None:
    """Move the attitude correction from the mean into the rotation matrix (in place)."""
    R[:] = product(dcm_from_rotation_vector(x[PHI : PHI + 3].copy()), R)
    x[PHI : PHI + 3] = 0.0
