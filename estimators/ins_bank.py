"""Inertial filters of several IMUs, run over one time-ordered stream of samples.

Every IMU has two filters (:mod:`estimators.ins_bank_model`): mode INS aligns its attitude with
satellite velocity and slip alone, mode ATT also uses the vehicle's roll, pitch and yaw. The stream
is in order of validity time. A measurement waits until each IMU's next sample has arrived, so that
the IMU's step is split exactly at the measurement's time with the sample *interpolated* there:
nothing is extrapolated, a late measurement is used where it belongs, and every rate may differ.

==========  =========================================================  ======
symbol      meaning                                                    number
==========  =========================================================  ======
C           filters: IMU i has the filters 2 i (INS) and 2 i + 1 (ATT)
W           windows of each filter: two, half a length apart, for each
            length; the last one is started on demand by :func:`mark`
tick        end of an interval of the grid on which decisions are made
==========  =========================================================  ======

:func:`run` consumes events until the end or until a tick at which something deserves a decision;
the caller then reads ``L``, ``Y`` and the differences, may :func:`accept` a fault, and continues.
All state is in the arrays of :class:`Bank`: where the stream is cut changes nothing.

Source: lu2016 eq. (31)-(58), with the "slow and late measurements" of the deployed form.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.atmosphere import gravity
from estimators.attitude import dcm_from_quaternion
from estimators.imu_difference import (
    EDGES,
    PAIR_ROWS,
    close_bins,
    fill_bins,
    odd_noise,
    watch_noise,
)
from estimators.ins_bank_model import (
    ATT,
    E_BARO,
    E_REF,
    F_ACC,
    HGT,
    INS,
    N_ACC,
    PHI,
    VEL,
    WIND,
    N,
    close_interval,
    inject,
    integrate,
    scalar_update,
)
from estimators.jit import kernel

__all__ = ["EVENT_WIDTH", "Bank", "Tuning", "accept", "make_bank", "run"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_IMUS = 5
GPS, BARO, ATTITUDE, PHASE = 5, 6, 7, 8
"""Kind of an event; 0..4 are samples of that IMU."""

EVENT_WIDTH = 8
"""Columns of an event's values.

IMU: acc xyz, gyro xyz [m/s^2, rad/s]. GPS: vel N, E, D (NaN when unknown) [m/s], latitude [rad],
height [m], longitude [rad], velocity std [m/s]. BARO: pressure height [m]. ATTITUDE: quaternion
ned_from_frd. PHASE: 1 when flying begins, 0 when it ends.
"""

PENDING = 64
"""Measurements that may wait for an IMU's next sample; an IMU further behind has stopped."""


class Tuning(NamedTuple):
    """Numbers of the filters, as arrays and scalars that a kernel reads (see ``ImuSettings``)."""

    noise_density: Array  # (6,) m/s^1.5, rad/s^0.5: lower bound of the input noise
    scale_error: Array  # (6,) 1: of the true input, as noise correlated over one second
    fault_density: Array  # (6,) m/s^2.5, rad/s^1.5: random walk of the slow biases
    turn_on_std: Array  # (6,) m/s^2, rad/s: biases at the start
    ref_std: Array  # (2, 4) rad, m/s, m: reference errors of mode INS, mode ATT
    ref_tau: Array  # (2, 4) s
    gps_std_m_s: float
    gps_down_std_m_s: float
    baro_std_m: float
    tilt_std_rad: float
    heading_std_rad: float
    slip_std_rad: float
    gust_std_m_s: float
    window_s: Array  # (W/2,) s: lengths of the windows
    tick_s: float
    max_rate_rad_s: float
    interest_sigma: float  # a statistic beyond this is handed to the caller
    interest_size: Array  # (6,) m/s^2, rad/s: and an estimate beyond this


class Bank(NamedTuple):
    """State of all filters; every array is C-contiguous and changed in place."""

    x: Array  # (C, 17)
    R: Array  # (C, 3, 3)
    P: Array  # (C, 17, 17)
    acc: Array  # (C, 28)
    qf: Array  # (C, 6) density of the fault walk, squared; raised on an axis found faulty
    F: Array  # (C, W, 17, 6)
    L: Array  # (C, W, 6, 6)
    Y: Array  # (C, W, 6)
    start_s: Array  # (C, W) start of each window
    start_nis: Array  # (C, W) normaliser when it started
    nis: Array  # (C,) running mean of the normalised innovation squared
    aligned_s: Array  # (C,) time of alignment, NaN before
    fix: Array  # (C, 6) last residual N, E; its last change between fixes; times of a jolt, a fix
    slip_s: Array  # (C,) time of the last slip measurement
    sample: Array  # (I, 7) last sample of each IMU: time, values; time NaN before the first
    diff2: Array  # (I, 6) mean square of the first difference over 2 s
    turn: Array  # (I, 3) rates, smoothed
    alias: Array  # (I, 6) the same times the sampling interval
    ref: Array  # (16,) last reference values, see R_* below
    pend: Array  # (PENDING, 2 + EVENT_WIDTH) waiting measurements: time, kind, values
    pend_read: Ints  # (I + 1,) next to read of each IMU; last: pushed so far
    edge: Array  # (I, EDGES, 6) integrals of each IMU at the edges of the grid
    edge_at: Ints  # (I, EDGES) which edge each slot holds, -1 none
    integral: Array  # (I, 6) running integral of each IMU
    pair: Array  # (I, I, PAIR_ROWS, 6) difference tests, see imu_difference
    noise: Array  # (I, 8, 6) noise and stuck tests, see imu_difference
    clock: Array  # (11,) see C_* below


R_T_GPS, R_VN, R_VE, R_VD, R_LAT, R_ALT, R_LON, R_T_BARO, R_HGT, R_T_ATT, R_Q = range(11)
"""Columns of ``Bank.ref``: when each reference was last seen [s] and what it said."""

C_FLYING, C_TICK, C_NOW, C_GRAVITY, C_POS_N, C_POS_E, C_POS_T, C_GPS_BAD_S = range(8)
C_CHANGED, C_SPIN_S, C_STOPPED = 8, 9, 10
"""Columns of ``Bank.clock``: flying flag, last closed tick, time of the last event, local gravity;
receiver position minus integrated receiver velocity over the last interval and its start;
time until which the receiver contradicts itself; whether something changed that the caller must
know; when the aircraft last turned too fast; whether :func:`run` stopped at a tick."""


def make_bank(n_imus: int, tuning: Tuning) -> Bank:
    """Bank for IMUs 0..n_imus-1, before the first event."""
    n, w = 2 * n_imus, 2 * len(tuning.window_s) + 1
    nan = np.nan
    return Bank(
        x=np.zeros((n, N)),
        R=np.tile(np.eye(3), (n, 1, 1)),
        P=np.zeros((n, N, N)),
        acc=np.zeros((n, N_ACC)),
        qf=np.tile(tuning.fault_density**2, (n, 1)),
        F=np.zeros((n, w, N, 6)),
        L=np.zeros((n, w, 6, 6)),
        Y=np.zeros((n, w, 6)),
        start_s=np.full((n, w), nan),
        start_nis=np.ones((n, w)),
        nis=np.full(n, 1.0),
        aligned_s=np.full(n, nan),
        fix=np.tile([0.0, 0.0, nan, nan, -1e9, -1e9], (n, 1)),
        slip_s=np.full(n, -1e9),
        sample=np.full((n_imus, 7), nan),
        diff2=np.zeros((n_imus, 6)),
        turn=np.zeros((n_imus, 3)),
        alias=np.zeros((n_imus, 6)),
        ref=np.full(16, nan),
        pend=np.zeros((PENDING, 2 + EVENT_WIDTH)),
        pend_read=np.zeros(n_imus + 1, dtype=np.int64),
        edge=np.zeros((n_imus, EDGES, 6)),
        edge_at=np.full((n_imus, EDGES), -1, dtype=np.int64),
        integral=np.zeros((n_imus, 6)),
        pair=np.zeros((n_imus, n_imus, PAIR_ROWS, 6)),
        noise=np.zeros((n_imus, 8, 6)),
        clock=np.array([0.0, -1.0, nan, 9.80665, 0.0, 0.0, nan, -1e9, 0.0, -1e9, 0.0]),
    )


MAX_GAP_S = 0.5
"""A longer hole in an IMU's samples ends what its filters know of velocity and attitude."""

NOISE_TAU_S = 2.0
NOISE_FRACTION = 0.7
"""Share of the rms first difference over 2 s that is taken for input noise.

White samples have 1 / sqrt(2) of it. The deployed form's trials used 0.3, which is right for real
vibration; samples that alias turbulence, as the simulator's do, need the whole.
"""

TURN_TAU_S = 0.5
NIS_TAU_S = 30.0
NIS_LEAST = 0.5
"""Normaliser of the statistics: running mean of the innovations' square, not below this."""

GPS_CHECK_S = 2.0
GPS_CONTRADICTION_M = 1.5
GPS_DISTRUST_S = 5.0
"""Position against integrated velocity of the receiver itself (deployed form's figures)."""

GPS_JOLT_M_S = 2.5
GPS_JOLT_S = 0.6
"""Between two fixes every IMU's velocity disagrees by this much more than between the two before:
or by four sigma of what the samples alias: no fault of an IMU does that twice, a noisy receiver
does."""

TURN_TAU_S = 0.5
NIS_TAU_S = 30.0
NIS_LEAST = 0.5
"""Normaliser of the statistics: running mean of the innovations' square, not below this."""

GPS_CHECK_S = 2.0
GPS_CONTRADICTION_M = 1.5
GPS_DISTRUST_S = 5.0
"""Position against integrated velocity of the receiver itself (deployed form's figures)."""

GPS_JOLT_M_S = 2.5
GPS_JOLT_M_S2 = 40.0
"""No aircraft changes its horizontal acceleration by four g from one fix to the next."""

SLIP_INTERVAL_S = 1.0
HEADING_INTERVAL_S = 1.0


@kernel
def restart_windows(b: Bank, c: int, t: float) -> None:
    """Empty all windows of a filter."""
    for w in range(b.start_s.shape[1] - 1):
        _restart(b, c, w, t)
    b.start_s[c, -1] = np.nan


@kernel
def mark(b: Bank, t: float) -> None:
    """Start the last window of every filter: two IMUs have just begun to disagree.

    Its columns are not unit steps but the course that :func:`drive` gives each fault.
    """
    w = b.start_s.shape[1] - 1
    for c in range(b.x.shape[0]):
        if not math.isnan(b.aligned_s[c]):
            _restart(b, c, w, t)
            b.F[c, w] = 0.0


@kernel
def drive(b: Bank, imu: int, change: Array) -> None:
    """Let the faults that the last window supposes of an IMU change by this much now.

    Parameters
    ----------
    b : Bank
    imu : int
    change : (6,) float64 [m/s^2, rad/s]
    """
    w = b.start_s.shape[1] - 1
    for c in range(2 * imu, 2 * imu + 2):
        for k in range(6):
            b.F[c, w, F_ACC + k, k] += change[k]


@kernel
def _restart(b: Bank, c: int, w: int, t: float) -> None:
    b.F[c, w] = 0.0
    b.L[c, w] = 0.0
    b.Y[c, w] = 0.0
    for k in range(6):
        b.F[c, w, F_ACC + k, k] = 1.0
    b.start_s[c, w] = t
    b.start_nis[c, w] = max(NIS_LEAST, b.nis[c])


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
    b.nis[c] = 2.0
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
        b.nis[c] += gain * (min(total / max(count, 1), 30.0) - b.nis[c])
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
    D = dcm_from_quaternion(q) @ R.T
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
def _measure(b: Bank, p: Tuning, imu: int, t: float, kind: int, z: Array) -> None:
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
        elif mode == ATT or t - b.slip_s[c] < 0.5 * HEADING_INTERVAL_S:
            _measure_attitude(b, p, c, z[:4].copy())


@kernel
def _step_filters(b: Bank, p: Tuning, imu: int, u0: Array, u1: Array, dt: float) -> None:
    u = 0.5 * (u0 + u1)
    var = np.empty(6)
    for k in range(6):
        var[k] = (
            p.noise_density[k] ** 2
            + NOISE_FRACTION**2 * b.diff2[imu, k] * dt
            + (p.scale_error[k] * u[k]) ** 2
        )
    lat = 0.0 if math.isnan(b.ref[R_LAT]) else b.ref[R_LAT]
    for mode in range(2):
        c = 2 * imu + mode
        if not math.isnan(b.aligned_s[c]):
            integrate(b.x[c], b.R[c], b.acc[c], u, var, lat, b.clock[C_GRAVITY], dt)


@kernel
def _imu_sample(b: Bank, p: Tuning, imu: int, t: float, u: Array) -> None:
    """Carry both filters of an IMU to its new sample, through the measurements that waited."""
    t0 = b.sample[imu, 0]
    pushed = b.pend_read[-1]
    if math.isnan(t0) or t - t0 > MAX_GAP_S or pushed - b.pend_read[imu] > PENDING:
        for mode in range(2):
            b.aligned_s[2 * imu + mode] = np.nan
        b.pend_read[imu] = pushed
        b.edge_at[imu] = -1
        b.clock[C_CHANGED] = 1.0
    elif t > t0:
        dt = t - t0
        gain = min(1.0, dt / NOISE_TAU_S)
        last = b.sample[imu, 1:].copy()
        turn2 = 0.0
        for k in range(3):
            b.turn[imu, k] += min(1.0, dt / TURN_TAU_S) * (u[3 + k] - b.turn[imu, k])
            turn2 += b.turn[imu, k] ** 2
        if turn2 > p.max_rate_rad_s**2:
            b.clock[C_SPIN_S] = t
        for k in range(6):
            b.diff2[imu, k] += gain * ((u[k] - last[k]) ** 2 - b.diff2[imu, k])
            b.alias[imu, k] = b.diff2[imu, k] * min(dt, p.tick_s)
        fill_bins(b.edge, b.edge_at, b.integral, imu, t0, t, last, u, p.tick_s)
        watch_noise(b.noise, imu, t, dt, last, u, b.clock[C_FLYING] == 1.0)
        at, u_at = t0, last
        while b.pend_read[imu] < pushed:
            slot = b.pend_read[imu] % PENDING
            t_m = b.pend[slot, 0]
            if t_m > t:
                break
            if t_m > at:
                u_m = last + (t_m - t0) / dt * (u - last)
                _step_filters(b, p, imu, u_at, u_m, t_m - at)
                at, u_at = t_m, u_m
            _measure(b, p, imu, at, int(b.pend[slot, 1]), b.pend[slot, 2:])
            b.pend_read[imu] += 1
        if t > at:
            _step_filters(b, p, imu, u_at, u, t - at)
    else:
        return
    b.sample[imu, 0] = t
    b.sample[imu, 1:] = u


@kernel
def _reference(b: Bank, t: float, kind: int, z: Array) -> None:
    """Note the latest reference, test the receiver against itself, queue the measurement."""
    if kind == GPS:
        lat, alt, lon = z[3], z[4], z[5]
        c = b.clock
        if not math.isnan(b.ref[R_T_GPS]) and not math.isnan(b.ref[R_LAT]):
            dt = t - b.ref[R_T_GPS]
            if dt <= 0.0:
                return
            c[C_POS_N] += (lat - b.ref[R_LAT]) * 6371000.0 - 0.5 * dt * (z[0] + b.ref[R_VN])
            c[C_POS_E] += (lon - b.ref[R_LON]) * 6371000.0 * math.cos(lat) - 0.5 * dt * (
                z[1] + b.ref[R_VE]
            )
            if dt > 1.0 or math.hypot(c[C_POS_N], c[C_POS_E]) > GPS_CONTRADICTION_M:
                c[C_GPS_BAD_S] = t + GPS_DISTRUST_S
                b.aligned_s[:] = np.nan
            if dt > 1.0 or t - c[C_POS_T] > GPS_CHECK_S:
                c[C_POS_N], c[C_POS_E], c[C_POS_T] = 0.0, 0.0, t
        else:
            c[C_POS_T] = t
        c[C_GRAVITY] = gravity(lat, alt)
        b.ref[R_T_GPS] = t
        b.ref[R_VN : R_VD + 1] = z[:3]
        b.ref[R_LAT], b.ref[R_ALT], b.ref[R_LON] = lat, alt, lon
    elif kind == BARO:
        if t - b.ref[R_T_BARO] < 0.15:
            return
        b.ref[R_T_BARO], b.ref[R_HGT] = t, z[0]
    else:
        if t - b.ref[R_T_ATT] < 0.15:
            return
        b.ref[R_T_ATT] = t
        b.ref[R_Q : R_Q + 4] = z[:4]
    slot = b.pend_read[-1] % PENDING
    b.pend[slot, 0] = t
    b.pend[slot, 1] = kind
    b.pend[slot, 2:] = z
    b.pend_read[-1] += 1


@kernel
def _stop(b: Bank) -> None:
    """The flight is over: forget all but the samples."""
    b.aligned_s[:] = np.nan
    b.x[:] = 0.0
    b.P[:] = 0.0
    b.pair[:] = 0.0


@kernel
def _all_jolted(b: Bank, now: float) -> bool:
    """Whether the receiver's velocity has just contradicted every IMU at once."""
    count = 0
    for i in range(b.sample.shape[0]):
        if not math.isnan(b.aligned_s[2 * i]) and now - b.sample[i, 0] < MAX_GAP_S:
            if now - b.fix[2 * i, 4] > GPS_JOLT_S:
                return False
            count += 1
    return count > 0


@kernel
def _interesting(b: Bank, p: Tuning, now: float) -> bool:
    """Whether anything deserves a decision: a window, a reference, a value that stands still."""
    interest = bool(b.clock[C_CHANGED] == 1.0)
    if b.clock[C_FLYING] == 1.0:
        quiet = now - b.clock[C_SPIN_S] > 0.5 and now > b.clock[C_GPS_BAD_S]
        interest = interest or not quiet or now - b.ref[R_T_GPS] > 1.0
    for i in range(b.sample.shape[0]):
        interest = interest or odd_noise(b.noise, i, now)
    for c in range(b.x.shape[0]):
        if math.isnan(b.aligned_s[c]):
            continue
        for w in range(b.start_s.shape[1] - 1):
            age = now - b.start_s[c, w]
            for k in range(6):
                info = b.L[c, w, k, k]
                if age >= 0.6 and info > 0.0:
                    z = b.Y[c, w, k] / math.sqrt(info * b.start_nis[c, w])
                    size = abs(b.Y[c, w, k]) / info
                    if abs(z) > p.interest_sigma and size > p.interest_size[k]:
                        interest = True
    return bool(interest)


@kernel
def roll(b: Bank, p: Tuning, now: float) -> None:
    """Restart the windows that have reached their length.

    The two windows of a length restart half a length apart, on a grid of vehicle time.
    """
    for c in range(b.x.shape[0]):
        if math.isnan(b.aligned_s[c]):
            continue
        for w in range(b.start_s.shape[1] - 1):
            length = p.window_s[w // 2]
            phase = 0.5 * (w % 2)
            if math.floor(now / length + phase) > math.floor(b.start_s[c, w] / length + phase):
                _restart(b, c, w, now)


@kernel
def accept(
    b: Bank, c: int, w: int, axes: Array, prior: Array, prior_std: Array, now: float
) -> Array:
    """Take the faults that a window estimates on some axes into a filter's state.

    ``x <- x + F f``, ``P <- P + F L^-1 F'``: the bias filter of the two stages is folded back.

    Parameters
    ----------
    b : Bank
    c, w : int
        Filter and window.
    axes : (6,) float64
        1 on the axes to take, 0 elsewhere.
    prior, prior_std : (6,) float64 [m/s^2, rad/s]
        What other sensors say of the faults, and its standard deviation (infinite: nothing).
    now : float [s]
        All windows restart here.

    Returns
    -------
    (6,) float64
        The faults taken [m/s^2, rad/s].
    """
    A = np.eye(6)
    y = np.zeros(6)
    for i in range(6):
        for j in range(6):
            if axes[i] > 0.0 and axes[j] > 0.0:
                A[i, j] = b.L[c, w, i, j]
        if axes[i] > 0.0:
            y[i] = b.Y[c, w, i] + prior[i] / prior_std[i] ** 2
            A[i, i] += 1.0 / prior_std[i] ** 2
    C = np.linalg.inv(A)
    f = C @ y
    for i in range(6):
        if axes[i] == 0.0:
            C[i, i] = 0.0
    F = np.ascontiguousarray(b.F[c, w])
    b.x[c] += F @ f
    b.P[c] += F @ C @ F.T
    inject(b.x[c], b.R[c])
    restart_windows(b, c, now)
    return f


@kernel
def observe_fault(b: Bank, c: int, axis: int, fault: float, std: float) -> None:
    """Let a filter know what another IMU says of one of its faults."""
    h = np.zeros(N)
    h[F_ACC + axis] = 1.0
    nu = fault - b.x[c, F_ACC + axis]
    scalar_update(b.x[c], b.P[c], b.F[c], b.L[c], b.Y[c], h, nu, std * std)
    inject(b.x[c], b.R[c])


@kernel
def run(
    b: Bank,
    p: Tuning,
    t_s: Array,
    kind: Ints,
    values: Array,
    first: int,
    ticks: Array,
    tick_count: Ints,
    every: bool,
) -> int:
    """Use events from ``first`` on; return after a tick of interest, or at the end.

    Parameters
    ----------
    b : Bank
        State, changed in place.
    p : Tuning
    t_s : (n,) float64 [s]
        Validity times, never decreasing.
    kind : (n,) int64
        IMU number, or GPS, BARO, ATTITUDE, PHASE.
    values : (n, 8) float64
        See :data:`EVENT_WIDTH`.
    first : int
        First event to use.
    ticks : (m, I, 19) float64
        Receives, at every tick and per IMU, time, estimated faults (NaN when not aligned), their
        variances, and the latest sample.
    tick_count : (1,) int64
        Rows of ``ticks`` used; grows.
    every : bool
        Return after every tick: a decision is under way.

    Returns
    -------
    int
        Number of events used so far; a tick has just been closed unless it is ``n``.
    """
    n_imus = b.sample.shape[0]
    for e in range(first, t_s.shape[0]):
        t, k = t_s[e], kind[e]
        b.clock[C_NOW] = t
        if k < MAX_IMUS:
            _imu_sample(b, p, k, t, values[e, :6].copy())
        elif k == PHASE:
            b.clock[C_FLYING] = values[e, 0]
            b.clock[C_CHANGED] = 1.0
            if values[e, 0] == 0.0:
                _stop(b)
        else:
            _reference(b, t, k, values[e])
        tick = math.floor(t / p.tick_s)
        # A tick closes when every IMU that still speaks has passed its edge.
        edge_s = tick * p.tick_s
        for i in range(n_imus):
            if b.sample[i, 0] < edge_s and t - b.sample[i, 0] < MAX_GAP_S:
                tick = min(tick, math.floor(b.sample[i, 0] / p.tick_s))
        if tick <= b.clock[C_TICK]:
            continue
        b.clock[C_TICK] = tick
        odd = close_bins(b.edge, b.edge_at, b.pair, b.alias, int(tick), p.tick_s)
        if _all_jolted(b, t):
            b.clock[C_GPS_BAD_S] = t + GPS_DISTRUST_S
            b.aligned_s[:] = np.nan
        odd = _interesting(b, p, t) or odd
        row = tick_count[0]
        if row < ticks.shape[0]:
            for i in range(n_imus):
                ticks[row, i, 0] = t
                c = 2 * i
                blind = math.isnan(b.aligned_s[c])
                for a in range(6):
                    ticks[row, i, 1 + a] = math.nan if blind else b.x[c, F_ACC + a]
                    ticks[row, i, 7 + a] = b.P[c, F_ACC + a, F_ACC + a]
                    ticks[row, i, 13 + a] = b.sample[i, 1 + a]
            tick_count[0] += 1
        if odd or every:
            b.clock[C_STOPPED] = 1.0
            return e + 1
        roll(b, p, t)
    return int(t_s.shape[0])
