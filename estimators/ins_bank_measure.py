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
    product,
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
from estimators.ins_bank_windows import restart_windows
from estimators.jit import kernel

__all__ = ["NOISE_FRACTION", "measure"]

Array = NDArray[np.float64]

NOISE_FRACTION = 0.7
"""Share of the rms first difference over 2 s that is taken for input noise.

White samples have 1 / sqrt(2) of it. The deployed form's trials used 0.3, which is right for real
vibration; samples that alias turbulence, as the simulator's do, need the whole.
"""

NIS_TAU_S = 30.0
NIS_CLIP = 30.0
NIS_FIRST = 2.0
"""Running mean of the innovations' square: its time constant, largest term and first value."""

GPS_JOLT_M_S = 2.5
"""A velocity disagrees with the IMU by this much more, from fix to fix, than from the fix before
to the last, or by four sigma of what the samples alias: no fault of an IMU does that twice, a noisy
receiver does."""

SLIP_INTERVAL_S = 1.0
"""Slip and the weak heading of mode INS are used once a second: their errors last that long."""


@kernel
def _align(b: Bank, p: Tuning, c: int, t: float) -> None:
    """Start a filter from the vehicle's attitude and the latest velocity and height."""
    mode = c % 2
    faults, known = b.x[c, F_ACC : F_ACC + 6].copy(), np.empty(6)
    for i in range(6):
        known[i] = b.P[c, F_ACC + i, F_ACC + i]
    b.x[c] = 0.0
    b.R[c] = dcm_from_quaternion(b.ref[R_Q : R_Q + 4].copy())
    b.x[c, VEL] = b.ref[R_VN]
    b.x[c, VEL + 1] = b.ref[R_VE]
    b.x[c, VEL + 2] = 0.0 if math.isnan(b.ref[R_VD]) else b.ref[R_VD]
    b.x[c, HGT] = 0.0 if math.isnan(b.ref[R_HGT]) else b.ref[R_HGT]
    P = b.P[c]
    P[:] = 0.0
    for i in range(3):
        P[VEL + i, VEL + i] = 9.0
    P[HGT, HGT] = 9.0
    for i in range(2):
        P[PHI + i, PHI + i] = 0.05**2
    P[PHI + 2, PHI + 2] = 0.1**2
    for i in range(6):
        P[F_ACC + i, F_ACC + i] = p.turn_on_std[i] ** 2
        if known[i] > 0.0:
            b.x[c, F_ACC + i] = faults[i]
            P[F_ACC + i, F_ACC + i] = min(known[i] + 0.01 * p.turn_on_std[i] ** 2, known[i] * 4.0)
        b.qf[c, i] = p.fault_density[i] ** 2
    for i in range(4):
        P[E_REF + i, E_REF + i] = p.ref_std[mode, i] ** 2
    b.acc[c] = 0.0
    b.fix[c, 2] = np.nan
    b.nis[c] = NIS_FIRST
    b.aligned_s[c] = t
    b.slip_s[c] = t
    restart_windows(b, c, t)


@kernel
def _measure_gps(b: Bank, p: Tuning, c: int, t: float, z: Array) -> None:
    x, P, R = b.x[c], b.P[c], b.R[c]
    h = np.zeros(N)
    x_before = x[:2].copy()
    total, count = 0.0, 0
    for i in range(3):
        if math.isnan(z[i]):
            continue
        std = p.gps_std_m_s if i < 2 else p.gps_down_std_m_s
        if z[6] > std:
            std = z[6]
        h[:] = 0.0
        h[VEL + i] = 1.0
        total += scalar_update(x, P, b.F[c], b.L[c], b.Y[c], h, z[i] - x[VEL + i], std * std)
        count += 1
    e_n = z[0] - x_before[0] - b.fix[c, 0]
    e_e = z[1] - x_before[1] - b.fix[c, 1]
    shaken = 0.0
    for i in range(3):
        shaken += b.alias[c // 2, i]
    shaken = 4.0 * math.sqrt(2.0 * NOISE_FRACTION**2 * shaken * min(t - b.fix[c, 5], 1.0))
    b.fix[c, 5] = t
    if math.hypot(e_n - b.fix[c, 2], e_e - b.fix[c, 3]) > max(GPS_JOLT_M_S, shaken):
        b.fix[c, 4] = t
    b.fix[c, 0], b.fix[c, 1] = z[0] - x[VEL], z[1] - x[VEL + 1]
    b.fix[c, 2], b.fix[c, 3] = e_n, e_e
    gain = min(1.0, 0.2 / NIS_TAU_S)
    if t - b.aligned_s[c] > 2.0:
        b.nis[c] += gain * (min(total / max(count, 1), NIS_CLIP) - b.nis[c])
    inject(x, R)
    if c % 2 == INS and t - b.slip_s[c] >= SLIP_INTERVAL_S:
        b.slip_s[c] = t
        _measure_slip(b, p, c)
        inject(x, R)


@kernel
def _measure_slip(b: Bank, p: Tuning, c: int) -> None:
    """The aircraft meets the air nearly head-on: its lateral airspeed is small.

    This ties heading to the receiver's velocity without the vehicle's own heading.
    """
    x, R = b.x[c], b.R[c]
    v0, v1, v2 = x[VEL] - x[WIND], x[VEL + 1] - x[WIND + 1], x[VEL + 2]
    y0, y1, y2 = R[0, 1], R[1, 1], R[2, 1]
    h = np.zeros(N)
    h[VEL], h[VEL + 1], h[VEL + 2] = y0, y1, y2
    h[WIND], h[WIND + 1] = -y0, -y1
    h[PHI], h[PHI + 1], h[PHI + 2] = y1 * v2 - y2 * v1, y2 * v0 - y0 * v2, y0 * v1 - y1 * v0
    lateral = y0 * v0 + y1 * v1 + y2 * v2
    speed2 = v0 * v0 + v1 * v1 + v2 * v2
    r = p.slip_std_rad**2 * speed2 + p.gust_std_m_s**2
    scalar_update(x, b.P[c], b.F[c], b.L[c], b.Y[c], h, -lateral, r)


@kernel
def _measure_attitude(b: Bank, p: Tuning, c: int, q: Array) -> None:
    x, R = b.x[c], b.R[c]
    D = product(dcm_from_quaternion(q), R.T)
    cos = min(1.0, max(-1.0, 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0)))
    angle = math.acos(cos)
    scale = 0.5 if angle < 1e-6 else 0.5 * angle / math.sin(angle)
    r = np.empty(3)
    r[0] = scale * (D[2, 1] - D[1, 2])
    r[1] = scale * (D[0, 2] - D[2, 0])
    r[2] = scale * (D[1, 0] - D[0, 1])
    h = np.zeros(N)
    first = 0 if c % 2 == ATT else 2
    for i in range(first, 3):
        h[:] = 0.0
        h[PHI + i] = 1.0
        h[E_REF + i] = 1.0
        std = p.tilt_std_rad if i < 2 else p.heading_std_rad
        nu = r[i] - x[PHI + i] - x[E_REF + i]
        scalar_update(x, b.P[c], b.F[c], b.L[c], b.Y[c], h, nu, std * std)
    inject(x, R)


@kernel
def measure(b: Bank, p: Tuning, imu: int, t: float, kind: int, z: Array) -> None:
    """Let both filters of an IMU use a measurement at its validity time."""
    for mode in range(2):
        c = 2 * imu + mode
        if math.isnan(b.aligned_s[c]):
            fresh = t - b.ref[R_T_GPS] < 1.0 and b.clock[C_FLYING] == 1.0
            fresh = fresh and t >= b.clock[C_GPS_BAD_S]
            if kind == ATTITUDE and fresh:
                _align(b, p, c, t)
            continue
        close_interval(b.x[c], b.P[c], b.F[c], b.acc[c], p.ref_std[mode], p.ref_tau[mode], b.qf[c])
        if kind == GPS:
            _measure_gps(b, p, c, t, z)
        elif kind == BARO:
            h = np.zeros(N)
            h[HGT] = 1.0
            h[E_BARO] = 1.0
            nu = z[0] - b.x[c, HGT] - b.x[c, E_BARO]
            scalar_update(b.x[c], b.P[c], b.F[c], b.L[c], b.Y[c], h, nu, p.baro_std_m**2)
            inject(b.x[c], b.R[c])
        elif mode == ATT or t - b.slip_s[c] < 0.5 * SLIP_INTERVAL_S:
            _measure_attitude(b, p, c, z[:4].copy())
