"""Inertial filters of several IMUs, run over one time-ordered stream of samples.

Every IMU has two filters (:mod:`estimators.ins_bank_model`): mode INS aligns its attitude with
satellite velocity and slip alone, mode ATT also uses the vehicle's roll, pitch and yaw. The stream
is in order of validity time. A measurement waits until each IMU's next sample has arrived, so that
the IMU's step is split exactly at the measurement's time with the sample *interpolated* there:
nothing is extrapolated, a late measurement is used where it belongs, and every rate may differ.

:func:`run` consumes events until the end or until a tick at which something deserves a decision;
the caller then reads ``L``, ``Y`` and the differences, may :func:`accept` a fault, and continues.
All state is in the arrays of :class:`Bank`: where the stream is cut changes nothing.

Source: lu2016 eq. (31)-(58), with the "slow and late measurements" of the deployed form.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.atmosphere import gravity
from estimators.imu_difference import close_bins, fill_bins, resume_noise, watch_noise
from estimators.ins_bank_interest import (
    JUDGED_AGE_S,
    P_ACC,
    P_GYRO,
    P_LONE,
    P_NOISE,
    P_PAIR,
    interesting,
    physical_size,
    swings,
)
from estimators.ins_bank_measure import NOISE_FRACTION, measure
from estimators.ins_bank_model import EARTH_RADIUS_M, F_ACC, Six, carry
from estimators.ins_bank_state import (
    ATTITUDE,
    BARO,
    C_CHANGED,
    C_COS_LAT,
    C_FIX_S,
    C_FLYING,
    C_GPS_BAD_S,
    C_GRAVITY,
    C_HOLE_S,
    C_JUDGED,
    C_NO_FIX_S,
    C_NOW,
    C_POS_E,
    C_POS_M,
    C_POS_N,
    C_POS_T,
    C_SIN_LAT,
    C_SPIN_S,
    C_STOPPED,
    C_TAN_LAT,
    C_TICK,
    EVENT_WIDTH,
    GPS,
    MAX_IMUS,
    N_RATIOS,
    PENDING,
    PHASE,
    R_ALT,
    R_HGT,
    R_LAT,
    R_LON,
    R_Q,
    R_T_ATT,
    R_T_BARO,
    R_T_GPS,
    R_VD,
    R_VE,
    R_VN,
    TICK_WIDTH,
    Bank,
    Tuning,
    make_bank,
)
from estimators.ins_bank_tests import tick_ratios
from estimators.ins_bank_turns import forget_turns, note_turn, undo_jump, usual_error
from estimators.ins_bank_windows import (
    SWING_Z2,
    accept,
    drive,
    mark,
    observe_fault,
    roll,
    roll_windows,
)
from estimators.jit import borrowed, inlined, kernel

__all__ = [
    "ATTITUDE",
    "BARO",
    "C_CHANGED",
    "C_FLYING",
    "C_GPS_BAD_S",
    "C_JUDGED",
    "C_NOW",
    "C_SPIN_S",
    "C_STOPPED",
    "EVENT_WIDTH",
    "GPS",
    "JUDGED_AGE_S",
    "MAX_IMUS",
    "PHASE",
    "P_ACC",
    "P_GYRO",
    "P_LONE",
    "P_NOISE",
    "P_PAIR",
    "R_T_ATT",
    "R_T_BARO",
    "R_T_GPS",
    "SWING_Z2",
    "TICK_WIDTH",
    "Bank",
    "Tuning",
    "accept",
    "drive",
    "make_bank",
    "mark",
    "observe_fault",
    "physical_size",
    "roll",
    "run",
    "swings",
    "usual_error",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_GAP_S = 0.5
"""A longer hole in an IMU's samples ends what its filters know of velocity and attitude."""

NOISE_TAU_S = 2.0
TURN_TAU_S = 0.5

GPS_CHECK_S = 2.0
GPS_CONTRADICTION_M = 1.5
GPS_DISTRUST_S = 5.0
GPS_GAP_S = 1.0
"""Position against integrated velocity of the receiver itself over 2 s, and a gap of 1 s (the
deployed form's figures), or of two and a half intervals of a slow receiver."""
GPS_LOST_S = 5.0
"""A receiver silent for longer while the IMUs spoke was away; what it says at once is not trusted.
After a shorter silence, or one that took the IMUs' samples too, only messages were lost."""
GPS_CONTRADICTION = 0.01
"""Share of the distance flown that the figure of the earth (a sphere here) and scale may cost."""

JOLT_S = 0.6
"""Jolts of all IMUs this close together are one jolt of the receiver."""

ATTITUDE_INTERVAL_S = BARO_INTERVAL_S = 0.15
"""Faster samples of the slow references say nothing new: their errors are correlated."""


@inlined
def _between(last: Array, u: Array, share: float) -> Six:
    """The sample this share of the way from one to the next."""
    return (
        last[0] + share * (u[0] - last[0]),
        last[1] + share * (u[1] - last[1]),
        last[2] + share * (u[2] - last[2]),
        last[3] + share * (u[3] - last[3]),
        last[4] + share * (u[4] - last[4]),
        last[5] + share * (u[5] - last[5]),
    )


@inlined
def _density(b: Bank, p: Tuning, imu: int, k: int, u: float, dt: float) -> float:
    """Noise density of an input, squared."""
    own, scaled = p.noise_density[k], p.scale_error[k] * u
    return float(own * own + NOISE_FRACTION**2 * b.diff2[imu, k] * dt + scaled * scaled)


@inlined
def _step_filters(b: Bank, p: Tuning, imu: int, u: Six, dt: float) -> None:
    """Carry both filters of an IMU over ``dt``, with the mean input."""
    var = (
        _density(b, p, imu, 0, u[0], dt),
        _density(b, p, imu, 1, u[1], dt),
        _density(b, p, imu, 2, u[2], dt),
        _density(b, p, imu, 3, u[3], dt),
        _density(b, p, imu, 4, u[4], dt),
        _density(b, p, imu, 5, u[5], dt),
    )
    cos, sin, tan = b.clock[C_COS_LAT], b.clock[C_SIN_LAT], b.clock[C_TAN_LAT]
    for c in range(2 * imu, 2 * imu + 2):
        if not math.isnan(b.aligned_s[c]):
            carry(b.x[c], b.R[c], b.acc[c], u, var, cos, sin, tan, b.clock[C_GRAVITY], dt)


@inlined
def _alone(b: Bank, p: Tuning, imu: int, t: float) -> bool:
    """Whether the attitude can have come from this IMU only."""
    for i in range(b.sample.shape[0]):
        if i != imu and t - b.sample[i, 0] < MAX_GAP_S:
            return False
    return not p.attitude_independent


@inlined
def _mean(last: Array, u: Array, t0: float, dt: float, begin: float, end: float) -> Six:
    """Mean of the samples between two times: their value halfway, interpolated."""
    return _between(last, u, 0.5 * ((begin - t0) + (end - t0)) / dt)


@inlined
def _walk(b: Bank, p: Tuning, imu: int, t0: float, t: float, last: Array, u: Array) -> None:
    """Carry both filters from one sample to the next, stopping at every measurement between."""
    at, dt, waits = t0, t - t0, True
    while waits:
        slot = b.pend_read[imu] % PENDING
        waits = b.pend_read[imu] < b.pend_read[-1] and b.pend[slot, 0] <= t
        until = b.pend[slot, 0] if waits else t
        if until > at:
            _step_filters(b, p, imu, _mean(last, u, t0, dt, at, until), until - at)
            at = until
        if waits:
            kind = int(b.pend[slot, 1])
            if kind == ATTITUDE:
                rest = _mean(last, u, t0, dt, at, t)
                theta = b.integral[imu, 3:] - (t - at) * np.array([rest[3], rest[4], rest[5]])
                note_turn(b.turns[imu], at, b.pend[slot, 2:6].copy(), theta)
                undo_jump(b.turns[imu], b.heading[imu], _alone(b, p, imu, t))
            measure(b, p, imu, at, kind, b.pend[slot, 2:])
            b.pend_read[imu] += 1


@inlined
def _imu_sample(b: Bank, p: Tuning, imu: int, t: float, u: Array) -> None:
    """Carry both filters of an IMU to its new sample, through the measurements that waited."""
    t0 = b.sample[imu, 0]
    pushed = b.pend_read[-1]
    if math.isnan(t0) or t - t0 > MAX_GAP_S or pushed - b.pend_read[imu] > PENDING:
        if t - t0 > MAX_GAP_S:
            b.clock[C_HOLE_S] = t
        for mode in range(2):
            b.aligned_s[2 * imu + mode] = np.nan
        b.pend_read[imu] = pushed
        b.edge_at[imu] = -1
        forget_turns(b.turns[imu])
        resume_noise(b.noise, imu, t)
        b.clock[C_CHANGED] = 1.0
    elif t > t0:
        dt = t - t0
        gain = min(1.0, dt / NOISE_TAU_S)
        last = b.sample[imu, 1:]
        turn2, follow = 0.0, min(1.0, dt / TURN_TAU_S)
        for k in range(3):
            b.turn[imu, k] += follow * (u[3 + k] - b.turn[imu, k])
            turn2 += b.turn[imu, k] ** 2
        if turn2 > p.max_rate_rad_s**2:
            b.clock[C_SPIN_S] = t
        for k in range(6):
            b.diff2[imu, k] += gain * ((u[k] - last[k]) ** 2 - b.diff2[imu, k])
            b.alias[imu, k] = b.diff2[imu, k] * min(dt, p.tick_s)
        fill_bins(b.edge, b.edge_at, b.integral, imu, t0, t, last, u, b.usual_s, p.tick_s)
        watch_noise(b.noise, imu, t, dt, last, u, b.clock[C_FLYING] == 1.0)
        _walk(b, p, imu, t0, t, last, u)
    else:
        return
    b.sample[imu, 0] = t
    b.sample[imu, 1:] = u


@inlined
def _lost_messages(b: Bank, t: float) -> bool:
    """Whether the IMUs were silent too, since the last fix: the link was, not the receiver."""
    if b.clock[C_HOLE_S] > b.ref[R_T_GPS]:
        return True
    newest = -math.inf
    for i in range(b.sample.shape[0]):
        if b.sample[i, 0] > newest:
            newest = b.sample[i, 0]
    return bool(t - newest > MAX_GAP_S)


@inlined
def _reference(b: Bank, t: float, kind: int, z: Array) -> None:
    """Note the latest reference, test the receiver against itself, queue the measurement."""
    if kind == GPS:
        lat, alt, lon = z[3], z[4], z[5]
        c = b.clock
        if math.isnan(z[0]):
            c[C_NO_FIX_S] = t
            return
        if not math.isnan(b.ref[R_T_GPS]) and not math.isnan(b.ref[R_LAT]):
            dt = t - b.ref[R_T_GPS]
            if dt <= 0.0:
                return
            c[C_POS_N] += (lat - b.ref[R_LAT]) * EARTH_RADIUS_M - 0.5 * dt * (z[0] + b.ref[R_VN])
            c[C_POS_E] += (lon - b.ref[R_LON]) * EARTH_RADIUS_M * math.cos(lat) - 0.5 * dt * (
                z[1] + b.ref[R_VE]
            )
            c[C_POS_M] += dt * math.hypot(z[0], z[1])
            limit = GPS_CONTRADICTION_M + GPS_CONTRADICTION * c[C_POS_M]
            gap = dt > max(GPS_GAP_S, 2.5 * c[C_FIX_S])
            c[C_FIX_S] += 0.1 * (min(dt, 2.0) - c[C_FIX_S])
            away = c[C_NO_FIX_S] > b.ref[R_T_GPS]
            away = away or (dt > GPS_LOST_S and not _lost_messages(b, t))
            apart = not gap and math.hypot(c[C_POS_N], c[C_POS_E]) > limit
            if (gap and away) or apart:
                c[C_GPS_BAD_S] = t + GPS_DISTRUST_S
                b.aligned_s[:] = np.nan
            if gap or t - c[C_POS_T] > GPS_CHECK_S:
                c[C_POS_N], c[C_POS_E], c[C_POS_M], c[C_POS_T] = 0.0, 0.0, 0.0, t
        else:
            c[C_POS_T] = t
        c[C_GRAVITY] = gravity(lat, alt)
        c[C_COS_LAT], c[C_SIN_LAT], c[C_TAN_LAT] = math.cos(lat), math.sin(lat), math.tan(lat)
        b.ref[R_T_GPS] = t
        b.ref[R_VN : R_VD + 1] = z[:3]
        b.ref[R_LAT], b.ref[R_ALT], b.ref[R_LON] = lat, alt, lon
    elif kind == BARO:
        if t - b.ref[R_T_BARO] < BARO_INTERVAL_S:
            return
        b.ref[R_T_BARO], b.ref[R_HGT] = t, z[0]
    else:
        if t - b.ref[R_T_ATT] < ATTITUDE_INTERVAL_S:
            return
        b.ref[R_T_ATT] = t
        b.ref[R_Q : R_Q + 4] = z[:4]
    slot = b.pend_read[-1] % PENDING
    b.pend[slot, 0] = t
    b.pend[slot, 1] = kind
    b.pend[slot, 2:] = z
    b.pend_read[-1] += 1


@kernel
def _all_jolted(aligned_s: Array, fix: Array, sample: Array, now: float) -> bool:
    """Whether the receiver's velocity has just contradicted every IMU at once."""
    count = 0
    for i in range(sample.shape[0]):
        if not math.isnan(aligned_s[2 * i]) and now - sample[i, 0] < MAX_GAP_S:
            if now - fix[2 * i, 4] > JOLT_S:
                return False
            count += 1
    return count > 0


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
    ticks : (m, I, 26) float64
        Receives, at every tick and per IMU, time, estimated faults (NaN when not aligned), their
        variances, the latest sample, and how near each axis is to a verdict
        (:mod:`estimators.ins_bank_tests`).
    tick_count : (1,) int64
        Rows of ``ticks`` used; grows.
    every : bool
        Return after every tick: a decision is under way.

    Returns
    -------
    int
        Number of events used so far; a tick has just been closed unless it is ``n``.
    """
    b, p = borrowed(b), borrowed(p)
    n_imus = b.sample.shape[0]
    for e in range(first, t_s.shape[0]):
        t, k = t_s[e], kind[e]
        b.clock[C_NOW] = t
        if k < MAX_IMUS:
            _imu_sample(b, p, k, t, values[e, :6])
        elif k == PHASE:
            b.clock[C_FLYING] = values[e, 0]
            b.clock[C_CHANGED] = 1.0
            if values[e, 0] == 0.0:
                b.aligned_s[:] = np.nan
                b.x[:] = 0.0
                b.P[:] = 0.0
                b.pair[:] = 0.0
        else:
            _reference(b, t, k, values[e])
        tick = math.floor(t / p.tick_s)
        if tick <= b.clock[C_TICK]:
            continue
        # A tick closes when every IMU that still speaks has passed its edge.
        edge_s = tick * p.tick_s
        for i in range(n_imus):
            if b.sample[i, 0] < edge_s and t - b.sample[i, 0] < MAX_GAP_S:
                tick = min(tick, math.floor(b.sample[i, 0] / p.tick_s))
        if tick <= b.clock[C_TICK]:
            continue
        b.clock[C_TICK] = tick
        odd = close_bins(b.edge, b.edge_at, b.pair, b.alias, int(tick), p.tick_s)
        if _all_jolted(b.aligned_s, b.fix, b.sample, t):
            b.clock[C_GPS_BAD_S] = t + GPS_DISTRUST_S
            b.aligned_s[:] = np.nan
        odd = interesting(b, p, t) or odd
        tick_ratios(b, p, t)
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
                for a in range(N_RATIOS):
                    ticks[row, i, 19 + a] = b.ratios[i, a]
            tick_count[0] += 1
        if odd or every:
            b.clock[C_STOPPED] = 1.0
            return e + 1
        for c in range(b.x.shape[0]):
            if not math.isnan(b.aligned_s[c]):
                windows = b.F[c], b.L[c], b.Y[c], b.start_s[c], b.start_nis[c]
                roll_windows(*windows, b.swing[c], b.nis[c], p.window_s, t)
    return int(t_s.shape[0])
