"""Events of a flight, in time order, to stages of a tenth of a second: horizon, votes, verdicts.

===========  ==================================================================  ==========
symbol       meaning                                                             unit
===========  ==================================================================  ==========
event        (time, code, instance, values): one row of one stream               s
stage        everything that arrived within one tenth of a second
dV           strapdown velocity gained in the stage                              m/s
memory       the wind while all agree: :mod:`estimators.air_memory`
===========  ==================================================================  ==========

The kernel keeps all state in the arrays of :class:`Stream`; it decides at stage boundaries, which
are vehicle times, so that any cut of the rows into calls gives the same bits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_memory import (
    HISTORY,
    WindMemory,
    forget,
    new_memory,
    remember,
    restore,
    wind_at,
)
from estimators.air_mhe_3d import (
    ALPHA,
    CAS,
    M3,
    N3,
    OFFSET,
    Horizon,
    WindLimits,
    air_outputs,
    fill,
    new_horizon,
    put,
    shift,
    solve,
    start,
)
from estimators.air_vote import judge
from estimators.air_vote_record import STAGE_S, VoteLimits, Votes, new_votes
from estimators.air_vote_tests import N_TEST, put_tests
from estimators.atmosphere import P0_PA, altitude_from_pressure, temperature
from estimators.attitude import dcm_from_quaternion
from estimators.jit import kernel

__all__ = [
    "EV_AOA",
    "EV_ATTITUDE",
    "EV_BARO",
    "EV_GPS",
    "EV_IMU",
    "EV_NAV",
    "EV_PHASE",
    "EV_PITOT",
    "N_ESTIMATE",
    "N_TEST",
    "N_VALUES",
    "Stream",
    "StreamLimits",
    "TriplexParams",
    "new_stream",
    "run",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

EV_ATTITUDE, EV_GPS, EV_NAV, EV_IMU, EV_PITOT, EV_AOA, EV_BARO, EV_PHASE = range(8)
N_VALUES = 7
N_ESTIMATE = 15
N_HORIZON = 3
GRAVITY = 9.80665
MEAN_WIND_S = 20.0
"""The published wind is the mean over this: gusts of a few seconds are not wind."""
FRESH_STAGES = 10.0
TESTS_S = 0.2
"""Rows of tests are no nearer to each other, but for those of a change of state."""

# slots of the clock array
(
    C_NEXT, C_FLYING, C_ATT, C_IMU, C_GPS_NEW, C_GPS_T, C_NAV_T, C_NAV_NEW, C_RUNNING, C_COUNT,
    C_EMIT, C_LAST, C_DOUBT, C_TESTS,
) = range(14)  # fmt: skip


SILENT_S, GAP_S = 0.5, 2.5
"""A sensor that sends less often is silent; a reading repeated after a gap was not held [s]."""


class StreamLimits(NamedTuple):
    """Bounds on the wind's change, when the references count, and what stays wrong for long."""

    change_m_s: float
    change_down_m_s: float
    change_base_s: float
    held_walk_m_s: float
    attitude_gap_s: float
    reference_gap_s: float
    reference_apart_m_s: float
    reference_wait_s: float
    emit_s: float
    calibration_std: float
    heading_std_rad: float
    alignment_std_rad: float


class TriplexParams(NamedTuple):
    """All parameters of the triplex watch."""

    wind: WindLimits
    votes: VoteLimits
    stream: StreamLimits


class Stream(NamedTuple):
    """All that the stream remembers."""

    horizon: Horizon
    votes: Votes
    clock: Array
    R_nb: Array  # (3, 3): ned_from_frd
    rate: Array  # (3,): body rates [rad/s]
    dV: Array  # (3,)
    velocity: Array  # (2, 3): gps N E, nav D, advanced to now; nav N E D
    air: Array  # (2,)
    sums: Array  # (2, 3, 2): readings of the stage and their number
    last: Array  # (2, 3, 3): last raw reading, the time it last changed, the time of the last
    memory: WindMemory


def new_stream() -> Stream:
    """A stream before its first row."""
    z = np.zeros
    s = Stream(
        new_horizon(N_HORIZON), new_votes(), np.full(14, -1e9), np.eye(3), z(3), z(3), z((2, 3)),
        z(2), z((2, 3, 2)), z((2, 3, 3)), new_memory(),
    )  # fmt: skip
    s.clock[C_NEXT] = np.nan
    s.clock[C_FLYING] = s.clock[C_RUNNING] = s.clock[C_COUNT] = 0.0
    s.clock[C_GPS_NEW] = s.clock[C_NAV_NEW] = 0.0
    s.air[:] = P0_PA, 288.15
    s.last[:] = np.nan
    return s


@kernel
def _remembered(s: Stream, R_bn: Array, out: Array, h: Array, C: Array) -> bool:
    """(alpha, CAS) that the horizon's velocity gives with the remembered wind."""
    newest = s.horizon.x.shape[0] - 1
    x = np.empty(N3)
    for a in range(3):
        x[a] = s.horizon.x[newest, a]
        x[3 + a] = wind_at(s.memory, a, s.clock[C_COUNT])
    x[OFFSET] = s.horizon.x[newest, OFFSET]
    known = air_outputs(x, R_bn, s.air, h, C)
    out[0] = h[ALPHA]
    out[1] = h[CAS]
    return known


@kernel
def _asked(s: Stream, p: TriplexParams, apart: float, cas: float, out: Array) -> None:
    """Horizontal wind (2,) that would explain a CAS by ``apart`` above the remembered one's."""
    x = s.horizon.x[s.horizon.x.shape[0] - 1]
    north, east = x[0] - x[3], x[1] - x[4]
    limit = p.votes.common_cas_m_s
    tas_per_cas = math.hypot(north, east) / max(cas, 1.0)
    change = -min(max(apart, -limit), limit) * tas_per_cas
    tas = max(math.hypot(north, east), 1.0)
    out[0] = change * north / tas
    out[1] = change * east / tas


@kernel
def _stage(s: Stream, p: TriplexParams, t_s: float, log: Array, row: int) -> int:
    """Close the stage that ends at ``t_s``: predict, vote, estimate; returns the next log row."""
    z, v, q = s.horizon, s.votes, p.stream
    clock = s.clock
    newest = z.x.shape[0] - 1
    R_bn = np.empty((3, 3))
    ahead = min(max(t_s - clock[C_ATT], 0.0), 0.1)
    for a in range(3):
        # small turn since the attitude was valid: R_nb (1 + [w x] dt)
        n0, n1, n2 = s.R_nb[a, 0], s.R_nb[a, 1], s.R_nb[a, 2]
        R_bn[0, a] = n0 + (n1 * s.rate[2] - n2 * s.rate[1]) * ahead
        R_bn[1, a] = n1 + (n2 * s.rate[0] - n0 * s.rate[2]) * ahead
        R_bn[2, a] = n2 + (n0 * s.rate[1] - n1 * s.rate[0]) * ahead
    for ch in range(2):
        for i in range(3):
            n = s.sums[ch, i, 1]
            if n > 0.0:
                v.value[ch, i] = s.sums[ch, i, 0] / n
                v.age[ch, i] = 0.0
            else:
                v.age[ch, i] += 1.0
            same = s.last[ch, i, 1]
            # silence is no standing still
            v.same[ch, i] = min(t_s, s.last[ch, i, 2] + SILENT_S) - same if same > -1e8 else 0.0
            s.sums[ch, i, 0] = 0.0
            s.sums[ch, i, 1] = 0.0

    flying = clock[C_FLYING] == 1.0
    reference_t = max(clock[C_GPS_T], clock[C_NAV_T])
    fresh = t_s - clock[C_ATT] < q.attitude_gap_s and t_s - reference_t < q.reference_gap_s
    h = np.empty(M3)
    C = np.empty((M3, N3))
    predicted = np.zeros(2)
    remembered = np.zeros(2)
    walk = np.zeros(2)
    model = False
    if flying and fresh:
        if clock[C_RUNNING] == 0.0:
            start(z, p.wind, s.velocity[0], R_bn, s.air)
            forget(s.memory)
            clock[C_RUNNING] = 1.0
            clock[C_COUNT] = 0.0
            clock[C_DOUBT] = -1e9
        hold = v.lost[1] > 0.0
        shift(z, p.wind, STAGE_S, s.dV, R_bn, s.air, hold, q.held_walk_m_s)
        known = air_outputs(z.x[newest], R_bn, s.air, h, C)
        predicted[0] = h[ALPHA]
        predicted[1] = h[CAS]
        known = _remembered(s, R_bn, remembered, h, C) and known
        apart = 0.0
        if clock[C_GPS_NEW] == 1.0:
            apart = math.hypot(s.velocity[0, 0] - z.x[newest, 0], s.velocity[0, 1] - z.x[newest, 1])
        if apart > q.reference_apart_m_s:
            clock[C_DOUBT] = t_s
        model = (
            known and clock[C_COUNT] * STAGE_S > 5.0 and t_s - clock[C_DOUBT] > q.reference_wait_s
        )
    else:
        clock[C_RUNNING] = 0.0
    held_s = v.lost[1] * STAGE_S
    walk[1] = q.held_walk_m_s * math.sqrt(max(held_s, 0.0))
    speed = math.sqrt(
        (z.x[newest, 0] - z.x[newest, 3]) ** 2
        + (z.x[newest, 1] - z.x[newest, 4]) ** 2
        + (z.x[newest, 2] - z.x[newest, 5]) ** 2
    )
    if clock[C_RUNNING] == 0.0:
        speed = 0.0
        for i in range(3):
            if v.age[1, i] <= 10.0:
                speed = max(speed, v.value[1, i])
    rate = math.hypot(s.rate[0], s.rate[2])
    fused = np.zeros((2, 2))
    spread = np.zeros(2)
    lost_before = v.lost[1]
    row = judge(
        v, p.votes, t_s, flying, model, predicted, remembered, speed, rate, walk, log, row, fused,
        spread,
    )  # fmt: skip

    if clock[C_RUNNING] == 1.0:
        k = int(clock[C_COUNT])
        emptied = v.lost[1] > 0.0 and lost_before == 0.0
        if emptied or v.turned[1] == 1.0:
            # no pitot is left, or none that was believed
            asked = np.zeros(2)
            if fused[1, 1] == 1.0:
                _asked(s, p, fused[1, 0] - remembered[1], predicted[1], asked)
            restore(
                s.memory, z, k, not emptied, asked, p.wind.bound_m_s,
                int(q.change_base_s / STAGE_S), q.change_m_s, p.votes.gust_m_s,
            )  # fmt: skip
        y = z.y[newest]
        use = z.use[newest]
        if clock[C_GPS_NEW] == 1.0:
            y[0], y[1] = s.velocity[0, 0], s.velocity[0, 1]
            use[0] = use[1] = 1.0
        elif clock[C_NAV_NEW] == 1.0 and t_s - clock[C_GPS_T] > 2.0:
            y[0], y[1] = s.velocity[1, 0], s.velocity[1, 1]
            use[0] = use[1] = 1.0
        if clock[C_NAV_NEW] == 1.0:
            y[2] = s.velocity[1, 2]
            use[2] = 1.0
        y[ALPHA] = fused[0, 0]
        use[ALPHA] = fused[0, 1]
        y[CAS] = fused[1, 0]
        use[CAS] = fused[1, 1]
        use[5] = 1.0
        centre = np.zeros(3)
        band = np.full(3, np.inf)
        base = int(q.change_base_s / STAGE_S)
        if k > base + 50:
            old = (k - base) % HISTORY
            for a in range(3):
                centre[a] = s.memory.wind[a, old]
                band[a] = q.change_m_s if a < 2 else q.change_down_m_s
        solve(z, p.wind, centre, band, v.lost[1] == 0.0)
        for a in range(3):
            s.memory.wind[a, k % HISTORY] = z.x[newest, 3 + a]
        if spread[0] < 0.5 and spread[1] < 0.5 and v.lost[1] == 0.0:
            remember(s.memory, k, q.change_m_s, q.change_down_m_s)
        clock[C_COUNT] += 1.0
    fill(s.dV, 0.0)
    clock[C_GPS_NEW] = 0.0
    clock[C_NAV_NEW] = 0.0
    return row


@kernel
def _mean_wind(s: Stream, a: int) -> tuple[float, float]:
    """Mean of the wind's component over the last MEAN_WIND_S, and the variance about it."""
    k = int(s.clock[C_COUNT])
    n = min(k - 10, int(MEAN_WIND_S / STAGE_S))
    mean, square = 0.0, 0.0
    for i in range(1, n + 1):
        W = s.memory.wind[a, (k - i) % HISTORY]
        mean += W / n
        square += W * W / n
    return mean, max(square - mean * mean, 0.0)


@kernel
def _estimate(s: Stream, p: TriplexParams, t_s: float, out: Array) -> None:
    """Reconstructed air data with deviations; columns as AIR_ESTIMATE without its time.

    The published wind is the mean wind: of the horizon's, which follows gusts, over the last
    MEAN_WIND_S, or what is held while no pitot is left. Errors that stay for minutes are noise to
    the horizon and average out in its P, but not in truth: the calibration of the sound pitots
    moves the wind along the nose, an error of the heading across it. A wind that is held knows no
    gusts.
    """
    z, q = s.horizon, p.stream
    newest = z.x.shape[0] - 1
    h = np.empty(M3)
    C = np.empty((M3, N3))
    x = z.x[newest]
    R = z.R_bn[newest]
    known = air_outputs(x, R, z.air[newest], h, C)
    fill(out, np.nan)
    out[0] = t_s
    if not known:
        return
    std = np.empty(3)
    C[ALPHA, OFFSET] = 0.0
    for k in range(3):
        total = 0.0
        for a in range(N3):
            for b in range(N3):
                total += C[3 + k, a] * z.P[a, b] * C[3 + k, b]
        std[k] = math.sqrt(max(total, 0.0))
    tas = math.sqrt((x[0] - x[3]) ** 2 + (x[1] - x[4]) ** 2 + (x[2] - x[5]) ** 2)
    held = s.votes.lost[1] > 0.0
    gust = p.votes.gust_m_s if held else 0.0
    sound = 0.0
    for i in range(3):
        if s.votes.latched[1, i] == 0.0 and s.votes.age[1, i] <= FRESH_STAGES:
            sound += 1.0
    calibration = q.calibration_std / math.sqrt(max(sound, 1.0))
    out[1] = h[CAS]
    out[2] = math.sqrt(std[0] ** 2 + (calibration * h[CAS]) ** 2 + gust**2)
    out[3] = tas
    out[4] = out[2] * tas / max(h[CAS], 1.0)
    out[5] = h[ALPHA] - x[OFFSET]
    out[6] = math.hypot(std[1], q.alignment_std_rad)
    out[7] = h[5]
    out[8] = math.hypot(std[2], gust / tas)
    for a in range(3):
        W, spread2 = x[3 + a], 0.0
        if not held:
            W, spread2 = _mean_wind(s, a)
        along, across = calibration * tas * R[0, a], q.heading_std_rad * tas * R[1, a]
        out[9 + a] = W
        out[12 + a] = math.sqrt(max(z.P[3 + a, 3 + a], 0.0) + spread2 + along**2 + across**2)


@kernel
def run(
    s: Stream, p: TriplexParams, t_s: Array, code: Ints, index: Ints, value: Array,
    estimates: Array, log: Array, tests: Array,
) -> tuple[int, int, int]:  # fmt: skip
    """Run over events in time order; returns how many rows of the last three were written.

    Parameters
    ----------
    t_s, code, index, value : (n,), (n,), (n,), (n, 7)
        Time [s] since a fixed epoch, ``EV_*``, instance, values: quaternion (4) and rates (3);
        velocity NED (3); specific force (3); CAS; angle; pressure; flying.
    estimates : (n, 15) float64, written
        Time and the fields of an air estimate.
    log : (n, 17) float64, written
        Rows of :mod:`estimators.air_vote_record`.
    tests : (n, 19) float64, written
        Rows of :mod:`estimators.air_vote_tests`.
    """
    clock = s.clock
    n_estimates = 0
    n_tests = 0
    row = 0 * t_s.size  # a literal 0 would have every kernel below compiled twice
    for k in range(t_s.size):
        t = t_s[k]
        if np.isnan(clock[C_NEXT]):
            clock[C_NEXT] = t + STAGE_S
        if t >= clock[C_NEXT] + 2.0:
            # a hole in the stream: forget the horizon, keep what was learnt
            clock[C_RUNNING] = 0.0
            skipped = math.floor((t - clock[C_NEXT]) / STAGE_S)
            clock[C_NEXT] += STAGE_S * skipped
            for ch in range(2):
                for i in range(3):
                    s.votes.age[ch, i] += skipped
        while t >= clock[C_NEXT]:
            at = clock[C_NEXT]
            said = row
            row = _stage(s, p, at, log, row)
            clock[C_NEXT] = at + STAGE_S
            due = clock[C_FLYING] == 1.0 and at - clock[C_TESTS] > TESTS_S - 0.5 * STAGE_S
            if (due or row > said) and n_tests < tests.shape[0]:
                running = clock[C_RUNNING] == 1.0 and clock[C_COUNT] > 50.0
                put_tests(s.votes, s.horizon, running, at, tests[n_tests])
                n_tests += 1
                clock[C_TESTS] = at
            if (
                clock[C_RUNNING] == 1.0
                and clock[C_COUNT] > 50.0
                and at - clock[C_EMIT] > p.stream.emit_s - 0.5 * STAGE_S
                and n_estimates < estimates.shape[0]
            ):
                _estimate(s, p, at, estimates[n_estimates])
                n_estimates += 1
                clock[C_EMIT] = at
        c = code[k]
        if c == EV_IMU:
            dt = min(max(t - clock[C_IMU], 0.0), STAGE_S)
            clock[C_IMU] = t
            if t - clock[C_ATT] < p.stream.attitude_gap_s:
                for a in range(3):
                    gained = 0.0
                    for b in range(3):
                        gained += s.R_nb[a, b] * min(max(value[k, b], -80.0), 80.0)
                    if a == 2:
                        gained += GRAVITY
                    s.dV[a] += gained * dt
                    s.velocity[0, a] += gained * dt
                    s.velocity[1, a] += gained * dt
        elif c == EV_ATTITUDE:
            R_nb = dcm_from_quaternion(value[k, 0:4])
            for a in range(3):
                put(s.R_nb[a], R_nb[a])
                s.rate[a] = value[k, 4 + a] if np.isfinite(value[k, 4 + a]) else 0.0
            clock[C_ATT] = t
        elif c == EV_GPS:
            if index[k] == 0 or t - clock[C_GPS_T] > 2.0:
                s.velocity[0, 0] = value[k, 0]
                s.velocity[0, 1] = value[k, 1]
                clock[C_GPS_T] = t
                clock[C_GPS_NEW] = 1.0
        elif c == EV_NAV:
            for a in range(3):
                s.velocity[1, a] = value[k, a]
            s.velocity[0, 2] = value[k, 2]
            if t - clock[C_GPS_T] > 2.0:
                s.velocity[0, 0] = value[k, 0]
                s.velocity[0, 1] = value[k, 1]
            clock[C_NAV_T] = t
            clock[C_NAV_NEW] = 1.0
        elif c in (EV_PITOT, EV_AOA):
            ch = 1 if c == EV_PITOT else 0
            i = index[k]
            reading = value[k, 0]
            s.sums[ch, i, 0] += reading
            s.sums[ch, i, 1] += 1.0
            if reading != s.last[ch, i, 0] or t - s.last[ch, i, 2] > GAP_S:
                s.last[ch, i, 0] = reading
                s.last[ch, i, 1] = t
            s.last[ch, i, 2] = t
        elif c == EV_BARO:
            s.air[0] = value[k, 0]
            s.air[1] = temperature(altitude_from_pressure(value[k, 0]))
        elif c == EV_PHASE:
            clock[C_FLYING] = value[k, 0]
            if value[k, 0] == 0.0:
                clock[C_RUNNING] = 0.0
    return n_estimates, row, n_tests
