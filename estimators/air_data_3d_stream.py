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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import (
    ALIVE,
    CHECK_CONSTANT,
    CHECK_DEAD,
    CHECK_GROSS,
    CHECK_NOISE,
    CHECK_NONE,
    DEAD_SINCE,
    GROSS_SINCE,
    NOISE_SINCE,
    SAME_SINCE,
    T_LAST,
    CheckLimits,
    check_sample,
    grossly_off,
    new_check,
    noise_check,
    noisy,
    pair_noise,
    pair_noise_rms,
)
from estimators.air_data_3d import GUST, N_PITOTS, SCALE, YAW, air_velocity
from estimators.air_data_3d_bank import (
    N_HYPOTHESES,
    WIND_CHANGED,
    Bank,
    bank_step,
    changed_wind,
    clear,
    new_bank,
    spawn,
)
from estimators.air_data_3d_judge import (
    ABSENT,
    FAULTY,
    J_ROWS,
    LEARNING,
    LEARNT,
    NO_REASON,
    ON_GROUND,
    REFERENCE_MISSING,
    REFERENCE_NOT_TRUSTED,
    S_EXPECT,
    S_LEARNT,
    S_RESIDUAL,
    S_SHOWN,
    S_STATUS,
    Judge,
    JudgeLimits,
    accuse_by_check,
    judge_epoch,
    new_judge,
    set_status,
    unmonitor,
)
from estimators.air_data_3d_noise import (
    APART,
    GPS_STD,
    GUST_STD,
    R_COMMON,
    R_LATERAL,
    R_OWN,
    NoiseLevels,
    adapt,
    new_noise,
    reference_noise,
)
from estimators.air_data_3d_rows import QUEUE, Rings, axes_at, mean_pitot, nav_at, new_rings, push
from estimators.atmosphere import (
    P0_PA,
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
    "AirParams",
    "AirState",
    "FilterLevels",
    "new_state",
    "run",
]

Array = NDArray[np.float64]

EV_ATTITUDE, EV_GPS, EV_NAV, EV_PITOT, EV_BARO, EV_PHASE, EV_PRESENT = range(7)
N_VALUES = 4

# Scalars that the stream remembers.
(
    FLYING,
    FLYING_SINCE,
    STARTED,
    T_EPOCH,
    T_STEP,
    T_SPAWN,
    T_QUEUED,
    QUEUED_VN,
    QUEUED_VE,
    T_GPS,
    PRESSURE,
    START_PRESSURE,
    PRESENT,
    TRUSTED,
    TRUST_FROM,
    SPEED,
    LN_N_STD,
    HEAD,
    TAIL,
) = range(19)
N_MEMORY = 19

_SCALE0 = SCALE.start

EPOCH_SPACING_S = 0.15
"""GPS samples closer than this are thinned out: 5 Hz carry what the filters can use."""
EPOCH_WAIT_S = 0.12
"""An epoch waits this long for the pitot samples after it."""
EPOCH_PATIENCE_S = 1.6
"""An epoch without attitudes around it is dropped after this."""
SECOND_RECEIVER_AFTER_S = 1.0
ABSENT_AFTER_S = 10.0
"""A pitot that has shown nothing but zero for so long in flight is not there."""
BREAK_S = 5.0
"""After so long without a step the explanations under test have lost their witness."""
QUIET_SHARE = 0.5
"""A pitot that scattered recovers when it scatters by less than this share of the limit."""
START_HEIGHT_M = 20.0
"""Height above ground at which flying begins; below it shear is as at this height."""
YAW_WALK_RAD = 1e-4
N_ESTIMATE = 15
"""Columns: t, cas, its std, tas, std, aoa, std, ssa, std, wind N E D, their stds; s, m/s, rad."""


class FilterLevels(NamedTuple):
    """Model of the filters; the settings of the same names say what each value rests on."""

    wind_walk_m_s: float
    wind_shear_m_s: float
    gust_tau_s: float
    scale_walk: float
    scale_walk_shifted: float
    wind_prior_m_s: float
    vertical_walk_m_s: float
    vertical_prior_m_s: float
    scale_prior: float
    yaw_prior_rad: float
    gate: float
    jump_scale: float
    jump_wind_m_s: float
    spawn_s: float
    age_max_s: float
    learn_s: float
    reference_gap_s: float
    reference_apart_m_s: float
    reference_noise_m_s: float
    reference_wait_s: float


class AirParams(NamedTuple):
    """All parameters of the monitor."""

    levels: FilterLevels
    noise: NoiseLevels
    checks: CheckLimits
    limits: JudgeLimits


class AirState(NamedTuple):
    """All memory of the monitor; arrays are changed in place.

    Attributes
    ----------
    memory : (19,) float64
    pending : (16, 4) float64 [s, m/s]
        GPS epochs that wait.
    noise : (30,) float64
    check : (3, 15) float64
    """

    memory: Array
    pending: Array
    rings: Rings
    noise: Array
    check: Array
    bank: Bank
    judge: Judge


def new_state(params: AirParams) -> AirState:
    """State before the first event: on the ground, nothing known."""
    memory = np.zeros(N_MEMORY)
    memory[[T_EPOCH, T_STEP, T_SPAWN, T_QUEUED, T_GPS, QUEUED_VN, QUEUED_VE]] = -np.inf
    memory[[PRESSURE, START_PRESSURE]] = P0_PA
    memory[TRUSTED], memory[LN_N_STD] = 1.0, np.nan
    return AirState(
        memory=memory,
        pending=np.zeros((QUEUE, 4)),
        rings=new_rings(),
        noise=new_noise(params.noise),
        check=np.stack([new_check() for _ in range(N_PITOTS)]),
        bank=new_bank(),
        judge=new_judge(),
    )


@kernel
def _start(air: AirState, par: AirParams, V: Array, e_x: Array, tas: float) -> None:
    """Forget what an earlier flight taught: priors only.

    The wind starts where the air flows along the nose at the speed shown. From zero wind the first
    measurements would be linearised at a wrong airspeed and the next ones at another: their
    disagreement would pass for knowledge of the scale.

    Parameters
    ----------
    V, e_x : (3,) float64 [m/s], [1]
        Velocity over the ground and the nose's direction, NED.
    tas : float [m/s]
        True airspeed by the fastest pitot; NaN without one.
    """
    bank, f = air.bank, par.levels
    clear(bank)
    bank.x[:] = 0.0
    speed = math.sqrt(V[0] ** 2 + V[1] ** 2)
    if speed - 1.2 * tas < par.checks.dead_wind_m_s:
        for i in range(2):
            bank.x[i] = V[i] - tas * e_x[i]
    bank.P[:] = 0.0
    for i in range(2):
        bank.P[i, i] = f.wind_prior_m_s**2
    bank.P[2, 2] = f.vertical_prior_m_s**2
    for i in range(GUST.start, GUST.stop):
        bank.P[i, i] = air.noise[GUST_STD] ** 2
    for i in range(N_PITOTS):
        bank.P[_SCALE0 + i, _SCALE0 + i] = f.scale_prior**2
        if air.judge.sensor[i, S_STATUS] != FAULTY:
            air.judge.sensor[i, S_LEARNT] = 0.0
    bank.P[YAW, YAW] = f.yaw_prior_rad**2
    air.memory[STARTED] = 1.0


@kernel
def _process_noise(air: AirState, par: AirParams, dt: float, sink: float, q: Array) -> float:
    """Fill the variances gained over dt; return the gust's decay."""
    f = par.levels
    phi = math.exp(-dt / f.gust_tau_s)
    p = air.memory[PRESSURE]
    above = altitude_from_pressure(p) - altitude_from_pressure(air.memory[START_PRESSURE])
    shear2 = f.wind_shear_m_s**2 / max(START_HEIGHT_M + above, START_HEIGHT_M)
    walk = (f.wind_walk_m_s**2 + shear2 * abs(sink)) * dt
    vertical = f.vertical_walk_m_s**2 * dt
    gust = air.noise[GUST_STD] ** 2 * (1.0 - phi * phi)
    for i in range(3):
        q[i] = walk if i < 2 else vertical
        q[GUST.start + i] = gust if i < 2 else 0.25 * gust
        q[_SCALE0 + i] = f.scale_walk**2 * dt
    q[YAW] = YAW_WALK_RAD**2 * dt
    return phi


@kernel
def _known(air: AirState) -> int:
    """Bit mask of pitots that exist: have shown more than zero, or the first one if listed."""
    mask = 0
    for i in range(N_PITOTS):
        seen = air.rings.pushed[2 + i] > 0
        if seen and (air.check[i, ALIVE] > 0.5 or (i == 0 and air.memory[PRESENT] > 0.5)):
            mask |= 1 << i
    return mask


@kernel
def _sound(air: AirState, known: int) -> int:
    """Bit mask of the known pitots that are not faulty."""
    mask = 0
    for i in range(N_PITOTS):
        if (known >> i) & 1 and air.judge.sensor[i, S_STATUS] != FAULTY:
            mask |= 1 << i
    return mask


@kernel
def _quiet(air: AirState, par: AirParams, known: int, t: float) -> int:
    """Bit mask of pitots that are neither constant nor scatter."""
    mask = 0
    for i in range(N_PITOTS):
        constant = t - air.check[i, SAME_SINCE] > par.checks.constant_s
        others = _sound(air, known) & ~(1 << i)
        if not (constant or noisy(air.check, par.checks, i, others, QUIET_SHARE)):
            mask |= 1 << i
    return mask


@kernel
def _trusted(air: AirState, par: AirParams, t: float) -> bool:
    """Whether GPS is steady and agrees with the autopilot, with hysteresis and probation."""
    memory, f = air.memory, par.levels
    apart = air.noise[APART] / f.reference_apart_m_s
    noise = air.noise[GPS_STD] / f.reference_noise_m_s
    worst = max(apart, noise)
    if memory[TRUSTED] > 0.5:
        if worst > 1.0:
            memory[TRUSTED], memory[TRUST_FROM] = 0.0, np.inf
    elif worst > 0.6:
        memory[TRUST_FROM] = np.inf
    else:
        memory[TRUST_FROM] = min(memory[TRUST_FROM], t + f.reference_wait_s)
        if t >= memory[TRUST_FROM]:
            memory[TRUSTED] = 1.0
    return bool(memory[TRUSTED] > 0.5)


@kernel
def _estimate(air: AirState, t: float, V: Array, E: Array, out: Array) -> float:
    """Write the air data of the master; return the standard deviation of ln n."""
    x, P, pressure = air.bank.x, air.bank.P, air.memory[PRESSURE]
    d = np.empty(3)
    n = air_velocity(x, V, d)
    u, v, w = 0.0, 0.0, 0.0
    for i in range(3):
        u += E[0, i] * d[i]
        v += E[1, i] * d[i]
        w += E[2, i] * d[i]
    var_n, var_v, var_w = 0.0, 0.0, 0.0
    for i in range(6):
        for j in range(6):
            a, b = i % 3, j % 3
            var_n += P[i, j] * d[a] * d[b] / (n * n)
            var_v += P[i, j] * E[1, a] * E[1, b]
            var_w += P[i, j] * E[2, a] * E[2, b]
    ln_n_std = math.sqrt(var_n) / n
    cas = cas_from_tas(n, pressure, temperature(altitude_from_pressure(pressure)))
    out[0] = t
    out[1], out[2] = cas, cas * ln_n_std
    out[3], out[4] = n, n * ln_n_std
    out[5], out[6] = math.atan2(w, max(u, 0.0)), math.sqrt(var_w) / n
    out[7], out[8] = math.asin(min(max(v / n, -1.0), 1.0)), math.sqrt(var_v) / n
    for i in range(3):
        out[9 + i], out[12 + i] = x[i], math.sqrt(P[i, i])
    return ln_n_std


@kernel
def _epoch(
    air: AirState,
    par: AirParams,
    epoch: Array,
    log: Array,
    out: Array,
    E: Array,
    work: Array,
    where: NDArray[np.int64],
) -> bool:
    """Use one GPS epoch whose attitude is known; True when an estimate was written."""
    memory, bank, judge, f = air.memory, air.bank, air.judge, par.levels
    t = epoch[0]
    V, v_nav, y, e = work[0, :3], work[1, :3], work[2, :3], work[3, :3]
    top, q = work[4, :N_HYPOTHESES], work[5]
    has_nav = nav_at(air.rings, t, v_nav)
    for i in range(3):
        V[i] = epoch[1 + i]
    if np.isnan(V[2]):
        V[2] = v_nav[2] if has_nav else 0.0
    memory[SPEED] = math.sqrt(V[0] ** 2 + V[1] ** 2)
    dt = min(max(t - memory[T_EPOCH], 0.01), 2.0)
    memory[T_EPOCH] = t
    reference_noise(air.noise, dt, V, v_nav, has_nav)
    if memory[FLYING] < 0.5:
        return False
    known = _known(air)
    if not _trusted(air, par, t):
        unmonitor(judge, log, t, known, REFERENCE_NOT_TRUSTED)
        clear(bank)
        return False
    sigma = sigma_rho_from_pressure(memory[PRESSURE])
    ln_sigma = math.log(sigma)
    use, learnt = known & 0, known & 0
    fastest = np.nan
    for i in range(N_PITOTS):
        c = mean_pitot(air.rings, i, t) if (known >> i) & 1 else np.nan
        shown = not np.isnan(c)
        y[i] = math.log(max(eas_from_cas(c, memory[PRESSURE]), 0.1)) if shown else np.nan
        if shown and judge.sensor[i, S_STATUS] != FAULTY and not grossly_off(air.check[i]):
            use |= 1 << i
            eas = math.exp(y[i])
            if not eas < fastest:
                fastest = eas
            if judge.sensor[i, S_LEARNT] == LEARNT:
                learnt |= 1 << i
    if memory[STARTED] < 0.5:
        _start(air, par, V, E[0], fastest / sigma)
        memory[T_STEP] = t - dt
    step = t - memory[T_STEP]
    memory[T_STEP] = t
    if step > BREAK_S:
        clear(bank)
    g = changed_wind(bank)
    x_slip = bank.hx[g, WIND_CHANGED] if g >= 0 else bank.x
    adapt(air.noise, par.noise, dt, bank.x, x_slip, V, E[1], y, use, ln_sigma, e)
    phi = _process_noise(air, par, step, V[2], q)
    bank_step(
        bank,
        t,
        phi,
        q,
        f.scale_walk_shifted**2 * step,
        V,
        E[1],
        air.noise[R_LATERAL],
        y,
        use,
        ln_sigma,
        air.noise[R_COMMON],
        air.noise[R_OWN],
        f.gate,
    )
    memory[LN_N_STD] = _estimate(air, t, V, E, out)
    for i in range(N_PITOTS):
        s = judge.sensor[i]
        s[S_SHOWN] = math.exp(y[i])
        s[S_EXPECT] = sigma * out[3] * math.exp(-bank.x[_SCALE0 + i])
        s[S_RESIDUAL] = math.log(s[S_SHOWN] / s[S_EXPECT])
    quiet = _quiet(air, par, known, t)
    long_enough = t - memory[FLYING_SINCE] >= f.learn_s
    if judge_epoch(
        judge,
        par.limits,
        bank,
        log,
        t,
        dt,
        learnt,
        known,
        memory[LN_N_STD],
        quiet,
        long_enough,
        top,
        where,
    ):
        clear(bank)
    elif learnt != 0 and t - memory[T_SPAWN] >= f.spawn_s:
        spawn(bank, t, learnt, f.jump_scale, f.jump_wind_m_s, f.age_max_s)
        memory[T_SPAWN] = t
    return True


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
        check, par.checks, t, eas, p, p_std, speed, sigma, flying, s[S_LEARNT] == LEARNT
    )
    pair_noise(air.check, par.checks, i, dt)
    known = _known(air)
    others = _sound(air, known) & ~(1 << i)
    if s[S_STATUS] == FAULTY or not flying:
        return
    if not (known >> i) & 1:
        if t - memory[FLYING_SINCE] > ABSENT_AFTER_S:
            set_status(judge, log, t, i, ABSENT, NO_REASON, CHECK_NONE, np.nan, np.nan, np.nan)
        return
    s[S_SHOWN] = eas
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
def run(
    air: AirState,
    par: AirParams,
    t: Array,
    code: NDArray[np.int64],
    index: NDArray[np.int64],
    value: Array,
    estimates: Array,
    log: Array,
) -> tuple[int, int]:
    """Use events in time order; return how many rows of ``estimates`` and ``log`` were written.

    Parameters
    ----------
    t : (n,) float64 [s]
    code, index : (n,) int64
        EV_* and instance.
    value : (n, 4) float64
    estimates : (n + 16, 15) float64
    log : (3 n + 64, 13) float64
        See :mod:`estimators.air_data_3d_judge`.
    """
    memory, judge = air.memory, air.judge
    judge.memory[J_ROWS] = 0.0
    n_out = 0
    E = np.empty((3, 3))
    work = np.empty((6, 10))
    where = np.empty(N_HYPOTHESES, np.int64)
    for k in range(len(t)):
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
            unmonitor(judge, log, now, _known(air), reason)
        elif what == EV_PITOT:
            row = push(air.rings.pitot[i], air.rings.pushed, 2 + i)
            row[0], row[1] = now, v[0]
            _pitot_sample(air, par, now, i, v[0], log)
            if memory[FLYING] < 0.5:
                unmonitor(judge, log, now, _known(air), ON_GROUND)
        while memory[HEAD] < memory[TAIL]:
            epoch = air.pending[int(memory[HEAD]) % QUEUE]
            if now < epoch[0] + EPOCH_WAIT_S:
                break
            if axes_at(air.rings, epoch[0], E):
                memory[HEAD] += 1.0
                if _epoch(air, par, epoch, log, estimates[n_out], E, work, where):
                    n_out += 1
            elif now > epoch[0] + EPOCH_PATIENCE_S:
                memory[HEAD] += 1.0
            else:
                break
        if memory[FLYING] > 0.5:
            since = max(memory[T_EPOCH], memory[FLYING_SINCE])
            if now - since > par.levels.reference_gap_s:
                unmonitor(judge, log, now, _known(air), REFERENCE_MISSING)
    return n_out, int(judge.memory[J_ROWS])
