"""Measurements of the filter bank: alignment, satellite velocity, slip, height, attitude.

=========  ===============================================================  =========  ==========
z          row of H                                                         std        source
=========  ===============================================================  =========  ==========
v_N, v_E   VEL                                                              0.12 m/s   receiver
v_D        VEL, where the receiver gives it                                 0.3 m/s    receiver
height     HGT + E_BARO                                                     0.4 m      pressure
0          y_b' (VEL - WIND) + PHI' (y_b x (v - w)): the air meets the      3 deg,     slip
           aircraft nearly head-on (mode INS; y_b is R's second column)     1 m/s
r_N, r_E   PHI + E_REF, ``r = log(R_att R')`` (mode ATT)                    0.3 deg    attitude
r_D        PHI + E_REF (mode INS: once a second, as an error of 12 deg)     0.6 deg    attitude
=========  ===============================================================  =========  ==========
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.attitude import dcm_from_quaternion
from estimators.ins_bank_model import (
    ATT,
    E_BARO,
    E_REF,
    F_ACC,
    HGT,
    INS,
    PHI,
    VEL,
    WIND,
    N,
    close_interval,
    inject,
    scalar_update,
)
from estimators.ins_bank_state import (
    ATTITUDE,
    BARO,
    C_FLYING,
    C_GPS_BAD_S,
    GPS,
    R_HGT,
    R_Q,
    R_T_GPS,
    R_VD,
    R_VE,
    R_VN,
    Bank,
    Tuning,
)
from estimators.ins_bank_windows import restart_windows, windows_in_use
from estimators.jit import inlined, kernel

__all__ = ["NOISE_FRACTION", "measure"]

Array = NDArray[np.float64]

NOISE_FRACTION = 0.7
"""Share of the rms first difference over 2 s that is taken for input noise.

White samples have 1 / sqrt(2) of it. The deployed form's trials used 0.3, which is right for real
vibration; samples that alias turbulence, as the simulator's do, need the whole.
"""

ALIGN_FIX_S = 1.2
"""A filter is aligned with a velocity no older than this: GPS at 1 Hz is the slowest in use."""
ALIGN_STD = (3.0, 3.0, 0.05, 0.1)
"""Uncertainty after alignment: velocity [m/s], height [m], tilt and heading [rad]."""

UNKNOWN_HEIGHT_M = 1e4
FIX_S = 0.2
NIS_AFTER_S = 2.0
NIS_TAU_S = 30.0
NIS_CLIP = 30.0
NIS_FIRST = 2.0
NIS_PRIOR_S = 1.2
"""Running mean of the innovations' square: its time constant (for a fix every
0.2 s), largest term, first value and for how long a time that stands; terms count from two seconds
after the alignment."""

GPS_JOLT_M_S = 2.5
"""A velocity disagrees with the IMU by this much more, from fix to fix, than from the fix before
to the last, or by four sigma of what the samples alias: no fault of an IMU does that twice, a noisy
receiver does."""

NU, NOISE = N, N + 1
"""Columns of a measurement's row after those of H: its innovation, the variance of its noise."""

SLIP_INTERVAL_S = 1.0
"""Slip and the weak heading of mode INS are used once a second: their errors last that long."""


@kernel
def _align(x: Array, R: Array, P: Array, qf: Array, ref: Array, p: Tuning, mode: int) -> None:
    """Start a filter from the vehicle's attitude and the latest velocity and height (in place).

    What it had learnt of its slow biases in this flight is kept.
    """
    faults, known = x[F_ACC : F_ACC + 6].copy(), np.empty(6)
    for i in range(6):
        known[i] = P[F_ACC + i, F_ACC + i]
    x[:] = 0.0
    P[:] = 0.0
    R[:] = dcm_from_quaternion(ref[R_Q : R_Q + 4].copy())
    x[VEL], x[VEL + 1] = ref[R_VN], ref[R_VE]
    x[VEL + 2] = 0.0 if math.isnan(ref[R_VD]) else ref[R_VD]
    for i in range(3):
        P[VEL + i, VEL + i] = ALIGN_STD[0] ** 2
        P[PHI + i, PHI + i] = ALIGN_STD[2 if i < 2 else 3] ** 2
    if math.isnan(ref[R_HGT]):
        P[HGT, HGT] = UNKNOWN_HEIGHT_M**2
    else:
        x[HGT] = ref[R_HGT]
        P[HGT, HGT] = ALIGN_STD[1] ** 2
    for i in range(6):
        fresh = p.turn_on_std[i] ** 2
        P[F_ACC + i, F_ACC + i] = fresh
        if known[i] > 0.0:
            x[F_ACC + i] = faults[i]
            P[F_ACC + i, F_ACC + i] = min(known[i] + 0.01 * fresh, 4.0 * known[i])
        qf[i] = p.fault_density[i] ** 2
    for i in range(4):
        P[E_REF + i, E_REF + i] = p.ref_std[mode, i] ** 2


@kernel
def _velocity_rows(x: Array, p: Tuning, z: Array, H: Array) -> int:
    """Rows of the receiver's velocity; returns their number."""
    m = 0
    for i in range(3):
        if not math.isnan(z[i]):
            std = max(p.gps_std_m_s if i < 2 else p.gps_down_std_m_s, z[6])
            H[m, VEL + i] = 1.0
            H[m, NU] = z[i] - x[VEL + i]
            H[m, NOISE] = std * std
            m += 1
    return m


@kernel
def _slip_row(x: Array, R: Array, p: Tuning, m: int, H: Array) -> None:
    """Row m: the aircraft meets the air nearly head-on, its lateral airspeed is small.

    This ties heading to the receiver's velocity without the vehicle's own heading.
    """
    v0, v1, v2 = x[VEL] - x[WIND], x[VEL + 1] - x[WIND + 1], x[VEL + 2]
    y0, y1, y2 = R[0, 1], R[1, 1], R[2, 1]
    H[m, VEL], H[m, VEL + 1], H[m, VEL + 2] = y0, y1, y2
    H[m, WIND], H[m, WIND + 1] = -y0, -y1
    H[m, PHI] = y1 * v2 - y2 * v1
    H[m, PHI + 1] = y2 * v0 - y0 * v2
    H[m, PHI + 2] = y0 * v1 - y1 * v0
    H[m, NU] = -(y0 * v0 + y1 * v1 + y2 * v2)
    H[m, NOISE] = p.slip_std_rad**2 * (v0 * v0 + v1 * v1 + v2 * v2) + p.gust_std_m_s**2


@kernel
def _attitude_rows(x: Array, R: Array, p: Tuning, mode: int, q: Array, psi: float, H: Array) -> int:
    """Rows of the attitude error ``log(R_att R')``; mode INS takes its heading alone.

    ``q`` is the attitude sample, turned about the vertical by ``psi``.
    """
    A, D = dcm_from_quaternion(q), np.zeros((3, 3))
    c, s = math.cos(psi), math.sin(psi)
    for j in range(3):
        A[0, j], A[1, j] = c * A[0, j] - s * A[1, j], s * A[0, j] + c * A[1, j]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                D[i, j] += A[i, k] * R[j, k]
    angle = math.acos(min(1.0, max(-1.0, 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0))))
    scale = 0.5 if angle < 1e-6 else 0.5 * angle / math.sin(angle)
    m = 0
    for i in range(0 if mode == ATT else 2, 3):
        j, k = (i + 1) % 3, (i + 2) % 3
        H[m, PHI + i] = 1.0
        H[m, E_REF + i] = 1.0
        H[m, NU] = scale * (D[k, j] - D[j, k]) - x[E_REF + i]
        std = p.tilt_std_rad if i < 2 else p.heading_std_rad
        H[m, NOISE] = std * std
        m += 1
    return m


@kernel
def _judge_fix(
    fix: Array, x: Array, alias: Array, t: float, z: Array, v_n: float, v_e: float
) -> None:
    """Note a jolt between two fixes; ``v_n, v_e`` is the velocity before the update."""
    e_n, e_e = z[0] - v_n - fix[0], z[1] - v_e - fix[1]
    shaken = 2.0 * NOISE_FRACTION**2 * (alias[0] + alias[1] + alias[2]) * min(t - fix[5], 1.0)
    if math.hypot(e_n - fix[2], e_e - fix[3]) > max(GPS_JOLT_M_S, 4.0 * math.sqrt(shaken)):
        fix[4] = t
    fix[0], fix[1] = z[0] - x[VEL], z[1] - x[VEL + 1]
    fix[2], fix[3] = e_n, e_e
    fix[5] = t


@inlined
def _update(b: Bank, p: Tuning, c: int, t: float, kind: int, z: Array) -> None:
    """Bring one aligned filter to time t and let it use a measurement."""
    mode = c % 2
    x, R, P, F, L, Y = b.x[c], b.R[c], b.P[c], b.F[c], b.L[c], b.Y[c]
    windows = windows_in_use(b.start_s[c])
    close_interval(x, P, F, 6 * windows, b.acc[c], p.ref_std[mode], p.ref_tau[mode], b.qf[c])
    H = np.zeros((4, N + 2))
    v_n, v_e = x[VEL], x[VEL + 1]
    m, velocities = 0, 0
    if kind == GPS:
        m = velocities = _velocity_rows(x, p, z, H)
        if mode == INS and t - b.slip_s[c] >= SLIP_INTERVAL_S:
            b.slip_s[c] = t
            _slip_row(x, R, p, m, H)
            m += 1
    elif kind == BARO:
        H[0, HGT] = H[0, E_BARO] = 1.0
        H[0, NU] = z[0] - x[HGT] - x[E_BARO]
        H[0, NOISE] = p.baro_std_m**2
        m = 1
    elif mode == ATT or t - b.slip_s[c] < 0.5 * SLIP_INTERVAL_S:
        m = _attitude_rows(x, R, p, mode, z[:4], b.heading[c // 2, 0], H)
    dx = np.zeros(N)
    nis = 0.0
    for i in range(m):
        nu = H[i, NU]
        for j in range(N):
            nu -= H[i, j] * dx[j]
        share = scalar_update(dx, P, F, L, Y, windows, H[i], nu, H[i, NOISE])
        if i < velocities:
            nis += share / velocities
    for j in range(N):
        x[j] += dx[j]
    inject(x, R)
    if kind == GPS:
        _judge_fix(b.fix[c], x, b.alias[c // 2], t, z, v_n, v_e)
        if t - b.aligned_s[c] > NIS_AFTER_S:
            # The first value weighs as much as five fixes: soon the mean is of this flight.
            seen_s = t - b.aligned_s[c] - NIS_AFTER_S + NIS_PRIOR_S
            gain = FIX_S / min(NIS_TAU_S, seen_s)
            b.nis[c] += gain * (min(nis, NIS_CLIP) - b.nis[c])


@inlined
def measure(b: Bank, p: Tuning, imu: int, t: float, kind: int, z: Array) -> None:
    """Let both filters of an IMU use a measurement at its validity time.

    Parameters
    ----------
    b : Bank
        Changed in place; a filter that is not aligned is aligned by an attitude.
    p : Tuning
    imu : int
    t : float [s]
    kind : int
        GPS, BARO or ATTITUDE.
    z : (8,) float64
        See :data:`~estimators.ins_bank_state.EVENT_WIDTH`.
    """
    for c in range(2 * imu, 2 * imu + 2):
        if not math.isnan(b.aligned_s[c]):
            _update(b, p, c, t, kind, z)
            continue
        fresh = t - b.ref[R_T_GPS] < ALIGN_FIX_S and t >= b.clock[C_GPS_BAD_S]
        if kind == ATTITUDE and fresh and b.clock[C_FLYING] == 1.0:
            _align(b.x[c], b.R[c], b.P[c], b.qf[c], b.ref, p, c % 2)
            b.acc[c] = 0.0
            b.heading[imu, 0] = 0.0
            b.swing[c] = 0.0
            b.fix[c, 2] = np.nan
            b.nis[c] = NIS_FIRST
            b.aligned_s[c] = b.slip_s[c] = t
            windows = b.F[c], b.L[c], b.Y[c], b.start_s[c], b.start_nis[c]
            restart_windows(*windows, NIS_FIRST, t)
