"""The deployed air-data monitor: time-ordered events in, estimates and changes of state out.

Each GPS velocity is an *epoch*. It waits until attitude and pitots of both sides of its moment have
come, is brought together with them and drives the bank; each pitot sample drives the fast checks.
All memory is in the arrays of :class:`AirState`, and every decision falls at an event, so that
where a stream of events is cut changes nothing.

==============  ==============================================================================
event           values
==============  ==============================================================================
EV_ATTITUDE     q_ned_from_frd (4)
EV_GPS          V_N, V_E, V_D (NaN: not measured); index: receiver
EV_NAV          V_N, V_E, V_D of the autopilot
EV_PITOT        CAS [m/s]; index: pitot
EV_BARO         static pressure [Pa]; index: barometer
EV_PHASE        1: takes off to fly, 0: flies no longer
EV_PRESENT      1: the autopilot lists a pitot as present
==============  ==============================================================================
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import (
    CHECK_CONSTANT,
    CHECK_DEAD,
    CHECK_GROSS,
    CHECK_NOISE,
    CHECK_NONE,
    CHECK_OSCILLATION,
    DEAD_SHARE,
    DEAD_SINCE,
    GROSS_SINCE,
    N_SAME,
    NOISE_SINCE,
    SAME_SINCE,
    T_LAST,
    Z_FLOOR_M_S,
    check_sample,
    noise_check,
    noise_ratio,
    noisy,
    pair_noise,
    pair_noise_rms,
)
from estimators.air_data_3d import N_PITOTS, SCALE
from estimators.air_data_3d_bank import (
    N_HYPOTHESES,
    clear,
)
from estimators.air_data_3d_epoch import N_ESTIMATE, known_pitots, sound_pitots, use_epoch
from estimators.air_data_3d_judge import (
    ABSENT,
    FAULTY,
    J_ROWS,
    LEARNING,
    LEARNT,
    NEVER_LEARNT,
    NO_REASON,
    ON_GROUND,
    REFERENCE_MISSING,
    S_EXPECT,
    S_LEARNT,
    S_SHOWN,
    S_STATUS,
    accuse_by_check,
    set_status,
    unmonitor,
)
from estimators.air_data_3d_rows import QUEUE, axes_at, push
from estimators.air_data_3d_state import (
    FLYING,
    FLYING_SINCE,
    HEAD,
    LN_N_STD,
    PRESENT,
    PRESSURE,
    QUEUED_VE,
    QUEUED_VN,
    SPEED,
    START_PRESSURE,
    STARTED,
    T_EPOCH,
    T_GPS,
    T_QUEUED,
    TAIL,
    TRUSTED,
    AirParams,
    AirState,
    FilterLevels,
    new_state,
)
from estimators.air_horizon_stage import G_COUNT
from estimators.air_peaks import DEAD_WIND, GROSS_LN, NOISE_RMS, note
from estimators.air_swings import follow_swing, ragged, swing_ratio, swings
from estimators.air_tests import HELD, LONG, N_ROW, ROW_S, T_ROW, hold, pending, put_row, short_of
from estimators.atmosphere import (
    altitude_from_pressure,
    cas_from_tas,
    eas_from_cas,
    sigma_rho_from_pressure,
    temperature,
)
from estimators.jit import kernel

__all__ = [
    "EV_ATTITUDE",
    "EV_BARO",
    "EV_GPS",
    "EV_NAV",
    "EV_PHASE",
    "EV_PITOT",
    "EV_PRESENT",
    "N_ESTIMATE",
    "N_ROW",
    "AirParams",
    "AirState",
    "FilterLevels",
    "new_state",
    "run",
]

Array = NDArray[np.float64]

EV_ATTITUDE, EV_GPS, EV_NAV, EV_PITOT, EV_BARO, EV_PHASE, EV_PRESENT = range(7)
N_VALUES = 4

EPOCH_SPACING_S = 0.15
"""GPS samples closer than this are thinned out: 5 Hz carry what the filters can use."""
EPOCH_WAIT_S = 0.12
"""An epoch waits this long for the pitot samples after it."""
EPOCH_PATIENCE_S = 1.6
"""An epoch without attitudes around it is dropped after this."""
SECOND_RECEIVER_AFTER_S = 1.0
NO_EPOCH_S = 0.6
"""After so long without an epoch the samples make rows of tests of their own."""
ABSENT_AFTER_S = 10.0
"""A pitot that has shown nothing but zero for so long in flight is not there."""

_SCALE0 = SCALE.start


@kernel
def _note(
    air: AirState, par: AirParams, t: float, i: int, error: float, std: float, others: int
) -> None:
    """Note how near a sample of pitot i came to the limits of the gross and the noise check."""
    gross = abs(error) - 3.0 * std if not np.isnan(error) else np.nan
    note(air.peaks, GROSS_LN + i, t, gross, par.checks.gross_s)
    rms = np.nan
    if others != 0:
        scatters = noisy(air.check, i, others, 0.0, par.checks.noise_ratio)
        rms = pair_noise_rms(air.check, i, others) if scatters else 0.0
    note(air.peaks, NOISE_RMS + i, t, rms, par.checks.noise_s)


@kernel
def _hold_checks(
    air: AirState, par: AirParams, t: float, i: int, error: float, std: float, dead: float,
    tas: float, others: int,
) -> None:  # fmt: skip
    """Hold what the checks of a sample of pitot i say, over their limits.

    Parameters
    ----------
    error, std : float [1]
        ln of the airspeed over the one predicted, and the prediction's deviation; NaN without one.
    dead, tas : float [m/s]
        Wind that it would take to explain the sample, NaN once the wind is known; true airspeed.
    """
    limits, state, slot = par.checks, air.check[i], HELD + i
    if state[N_SAME] >= 4.0:
        hold(air.tests, slot, (t - state[SAME_SINCE]) / limits.constant_s)
    hold(air.tests, slot, abs(error) / (limits.gross_ln + 3.0 * std))
    shown = max(Z_FLOOR_M_S, DEAD_SHARE * air.memory[SPEED]) / max(tas, 0.1)
    hold(air.tests, slot, short_of(dead / limits.dead_wind_m_s, shown))
    if air.memory[TRUSTED] > 0.5:
        rms, ratio = limits.noise_rms, limits.noise_ratio
        hold(air.tests, slot, noise_ratio(air.check, i, others, rms, ratio))
        hold(air.tests, slot, swing_ratio(air.swing, limits, i, others, t))


@kernel
def _pitot_sample(air: AirState, par: AirParams, t: float, i: int, c: float, log: Array) -> None:
    """Run the fast checks on a pitot's sample."""
    memory, judge = air.memory, air.judge
    s, check = judge.sensor[i], air.check[i]
    flying = memory[FLYING] > 0.5
    fresh = flying and memory[STARTED] > 0.5 and t - memory[T_EPOCH] < par.levels.reference_gap_s
    trusted = memory[TRUSTED] > 0.5
    p = s[S_EXPECT] if fresh and trusted else np.nan
    p_std = math.sqrt(memory[LN_N_STD] ** 2 + air.bank.P[_SCALE0 + i, _SCALE0 + i])
    eas = eas_from_cas(c, memory[PRESSURE])
    speed = memory[SPEED] if t - memory[T_EPOCH] < par.levels.reference_gap_s else 0.0
    sigma = sigma_rho_from_pressure(memory[PRESSURE])
    dt = min(t - check[T_LAST], 1.0)
    failed = check_sample(
        check, par.checks, t, c, eas, p, p_std, speed, sigma, flying, s[S_LEARNT] == LEARNT
    )
    pair_noise(air.check, par.checks, i, dt)
    rho = math.log(max(eas, 0.1) / p) if p > 1.0 else np.nan
    follow_swing(air.swing, par.checks, i, t, rho)
    known = known_pitots(air)
    others = sound_pitots(air, known) & ~(1 << i)
    if s[S_STATUS] == FAULTY or not flying:
        return
    if not (known >> i) & 1:
        if t - memory[FLYING_SINCE] > ABSENT_AFTER_S:
            set_status(judge, log, t, i, ABSENT, NO_REASON, CHECK_NONE, np.nan, np.nan, np.nan)
        return
    s[S_SHOWN] = eas
    _note(air, par, t, i, rho, p_std, others)
    dead = np.nan if s[S_LEARNT] == LEARNT else speed - 1.2 * eas / sigma
    note(air.peaks, DEAD_WIND + i, t, dead, par.checks.dead_s)
    _hold_checks(air, par, t, i, rho, p_std, dead, eas / sigma, others)
    onset, stat, limit = t, 0.0, 0.0
    if failed == CHECK_CONSTANT:
        onset, limit = check[SAME_SINCE], par.checks.constant_s
        stat = t - onset
    elif failed == CHECK_GROSS:
        onset, limit = check[GROSS_SINCE], par.checks.gross_ln
        stat = abs(math.log(max(eas, 0.1) / p))
    elif failed == CHECK_DEAD:
        onset, limit = check[DEAD_SINCE], par.checks.dead_wind_m_s
        stat = speed - 1.2 * eas / sigma
    elif trusted and noise_check(air.check, par.checks, i, others, t):
        failed = CHECK_NOISE
        onset, limit = check[NOISE_SINCE], par.checks.noise_rms
        stat = pair_noise_rms(air.check, i, others)
    elif trusted:
        rms, at_least, since = swings(air.swing, par.checks, i, others, t)
        if rms > 0.0:
            failed = CHECK_NOISE if ragged(air.swing, air.check, i, others) else CHECK_OSCILLATION
            onset, stat, limit = since, rms, at_least
    if failed != CHECK_NONE:
        accuse_by_check(judge, par.limits, air.bank, log, t, i, failed, onset, stat, limit)


@kernel
def _queue(air: AirState, t: float, V: Array, receiver: int) -> None:
    """Let a GPS velocity wait for the samples around it; repeated and surplus ones are dropped."""
    memory = air.memory
    if receiver == 0:
        memory[T_GPS] = t
    elif t - memory[T_GPS] < SECOND_RECEIVER_AFTER_S:
        return
    repeated = V[0] == memory[QUEUED_VN] and V[1] == memory[QUEUED_VE]
    if t - memory[T_QUEUED] < EPOCH_SPACING_S or (repeated and V[0] != 0.0):
        return
    memory[T_QUEUED], memory[QUEUED_VN], memory[QUEUED_VE] = t, V[0], V[1]
    if memory[TAIL] - memory[HEAD] >= QUEUE:
        memory[HEAD] += 1.0
    row = air.pending[int(memory[TAIL]) % QUEUE]
    row[0], row[1], row[2], row[3] = t, V[0], V[1], V[2]
    memory[TAIL] += 1.0


@kernel
def _put_tests(air: AirState, t: float, row: Array) -> None:
    """Write a row of tests at an epoch, with the CAS that each pitot should show."""
    put_row(air.tests, t, t, row)
    p = air.memory[PRESSURE]
    sigma, t_k = sigma_rho_from_pressure(p), temperature(altitude_from_pressure(p))
    for i in range(N_PITOTS):
        s = air.judge.sensor[i]
        if s[S_LEARNT] > NEVER_LEARNT:
            std = math.sqrt(air.memory[LN_N_STD] ** 2 + air.bank.P[_SCALE0 + i, _SCALE0 + i])
            row[4 + i] = cas_from_tas(s[S_EXPECT] / sigma, p, t_k)
            row[7 + i] = row[4 + i] * std


@kernel
def run(
    air: AirState,
    par: AirParams,
    start: int,
    t: Array,
    code: NDArray[np.int64],
    index: NDArray[np.int64],
    value: Array,
    estimates: Array,
    log: Array,
    tests: Array,
) -> tuple[int, int, int, int]:
    """Use events in time order from number ``start`` on, up to where the long horizon is to decide.

    Returns the number of the next event and how many rows of ``estimates``, ``log`` and ``tests``
    were written.

    Parameters
    ----------
    t : (n,) float64 [s]
    code, index : (n,) int64
        EV_* and instance.
    value : (n, 4) float64
    estimates : (n + 16, 15) float64
    log : (3 n + 64, 13) float64
        See :mod:`estimators.air_data_3d_judge`.
    tests : (2 n + 32, 11) float64
        See :mod:`estimators.air_tests`.
    """
    memory, judge = air.memory, air.judge
    judge.memory[J_ROWS] = 0.0
    n_out, n_tests, said = 0, 0, 0.0
    E = np.empty((3, 3))
    work = np.empty((7, 10))
    where = np.empty(N_HYPOTHESES, np.int64)
    for k in range(start, len(t)):
        now, what, i, v = t[k], code[k], index[k], value[k]
        if what == EV_ATTITUDE:
            row = push(air.rings.attitude, air.rings.pushed, 0)
            row[0] = now
            for j in range(4):
                row[1 + j] = v[j]
        elif what == EV_NAV:
            row = push(air.rings.nav, air.rings.pushed, 1)
            row[0] = now
            for j in range(3):
                row[1 + j] = v[j]
        elif what == EV_GPS:
            _queue(air, now, v, i)
        elif what == EV_BARO:
            if i == 0:
                memory[PRESSURE] = v[0]
        elif what == EV_PRESENT:
            memory[PRESENT] = v[0]
        elif what == EV_PHASE:
            memory[FLYING], memory[FLYING_SINCE], memory[STARTED] = v[0], now, 0.0
            memory[START_PRESSURE] = memory[PRESSURE]
            clear(air.bank)
            reason = LEARNING if v[0] > 0.5 else ON_GROUND
            unmonitor(judge, log, now, known_pitots(air), reason)
        elif what == EV_PITOT:
            row = push(air.rings.pitot[i], air.rings.pushed, 2 + i)
            row[0], row[1] = now, v[0]
            _pitot_sample(air, par, now, i, v[0], log)
            alone = now - air.tests[T_ROW] > NO_EPOCH_S
            if (alone or judge.memory[J_ROWS] > said) and pending(air.tests):
                put_row(air.tests, now, memory[T_EPOCH], tests[n_tests])
                n_tests += 1
            if memory[FLYING] < 0.5:
                unmonitor(judge, log, now, known_pitots(air), ON_GROUND)
        while memory[HEAD] < memory[TAIL]:
            epoch = air.pending[int(memory[HEAD]) % QUEUE]
            if now < epoch[0] + EPOCH_WAIT_S:
                break
            if axes_at(air.rings, epoch[0], E):
                memory[HEAD] += 1.0
                said = judge.memory[J_ROWS]
                if use_epoch(air, par, epoch, log, estimates[n_out], E, work, where):
                    n_out += 1
                    due = epoch[0] - air.tests[T_ROW] >= ROW_S
                    if due or judge.memory[J_ROWS] > said:
                        _put_tests(air, epoch[0], tests[n_tests])
                        n_tests += 1
            elif now > epoch[0] + EPOCH_PATIENCE_S:
                memory[HEAD] += 1.0
            else:
                break
        if memory[FLYING] > 0.5:
            since = max(memory[T_EPOCH], memory[FLYING_SINCE])
            if now - since > par.levels.reference_gap_s:
                unmonitor(judge, log, now, known_pitots(air), REFERENCE_MISSING)
                for j in range(N_PITOTS):
                    air.tests[LONG + j] = np.nan
        said = judge.memory[J_ROWS]
        if air.stages.memory[G_COUNT] >= par.stage.solve_every:
            return k + 1, n_out, int(judge.memory[J_ROWS]), n_tests
    return len(t), n_out, int(judge.memory[J_ROWS]), n_tests
