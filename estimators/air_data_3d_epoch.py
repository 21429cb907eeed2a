"""One GPS epoch of the deployed air-data monitor: noise, bank, estimate, decision.

Before an epoch counts, its reference must: GPS that is noisier than the autopilot's velocity, or
stays apart from it, is not trusted, and then nobody is judged.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.air_checks import (
    ALIVE,
    SAME_SINCE,
    grossly_off,
    lives,
    noisy,
)
from estimators.air_data_3d import GUST, N_PITOTS, NX, SCALE, YAW, air_velocity
from estimators.air_data_3d_bank import (
    N_HYPOTHESES,
    WIND_CHANGED,
    bank_step,
    changed_wind,
    clear,
    spawn,
)
from estimators.air_data_3d_evidence import note_evidence
from estimators.air_data_3d_judge import (
    FAULTY,
    LEARNT,
    REFERENCE_NOT_TRUSTED,
    S_EXPECT,
    S_LEARNT,
    S_RESIDUAL,
    S_SHOWN,
    S_STATUS,
    judge_epoch,
    unmonitor,
)
from estimators.air_data_3d_noise import (
    APART,
    GPS_STD,
    GUST_STD,
    LONGEST_STEP_S,
    R_COMMON,
    R_LATERAL,
    R_OWN,
    SLIP_MEAN_TAU_S,
    SLIP_VAR,
    adapt,
    reference_noise,
)
from estimators.air_data_3d_rows import mean_pitot, nav_at
from estimators.air_data_3d_state import (
    FLYING,
    FLYING_SINCE,
    LN_N_STD,
    PRESENT,
    PRESSURE,
    SPEED,
    START_PRESSURE,
    STARTED,
    T_EPOCH,
    T_SPAWN,
    T_STEP,
    TRUST_FROM,
    TRUSTED,
    AirParams,
    AirState,
)
from estimators.air_horizon_stage import G_FRESH, G_RUNS, gather_epoch
from estimators.air_peaks import APART as APART_PEAK
from estimators.air_peaks import NOISE as NOISE_PEAK
from estimators.air_peaks import note
from estimators.air_swings import swinging
from estimators.air_tests import LONG
from estimators.atmosphere import (
    altitude_from_pressure,
    cas_from_tas,
    eas_from_cas,
    sigma_rho_from_pressure,
    temperature,
)
from estimators.jit import kernel

__all__ = ["N_ESTIMATE", "known_pitots", "sound_pitots", "use_epoch"]

Array = NDArray[np.float64]
_SCALE0 = SCALE.start

BREAK_S = 5.0
"""After so long without a step the explanations under test have lost their witness."""
QUIET_SHARE = 0.5
"""A pitot that scattered recovers when it scatters by less than this share of the limit."""
START_HEIGHT_M = 20.0
"""Height above ground at which flying begins; below it shear is as at this height."""
YAW_WALK_RAD = 1e-4
BEND = 5.0
"""On synthetic flights at gust / n = 0.045 and 0.08 ln n was low by 2.7 and 5 times its square."""
DOWN_SHARE = 0.7
"""Vertical gusts' variance of that of horizontal ones: 0.4 at 50 m, 1 at 300 m (MIL-F-8785C)."""
TILT_STD_RAD = 0.01
"""Slow error of roll and pitch that small autopilots have [rad]."""
N_ESTIMATE = 15
"""Columns: t, cas, its std, tas, std, aoa, std, ssa, std, wind N E D, their stds; s, m/s, rad."""


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
    if lives(speed, tas, par.checks.dead_wind_m_s):
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
def known_pitots(air: AirState) -> int:
    """Bit mask of pitots that exist: have shown more than zero, or the first one if listed."""
    mask = 0
    for i in range(N_PITOTS):
        seen = air.rings.pushed[2 + i] > 0
        if seen and (air.check[i, ALIVE] > 0.5 or (i == 0 and air.memory[PRESENT] > 0.5)):
            mask |= 1 << i
    return mask


@kernel
def sound_pitots(air: AirState, known: int) -> int:
    """Bit mask of the known pitots that are not faulty."""
    mask = 0
    for i in range(N_PITOTS):
        if (known >> i) & 1 and air.judge.sensor[i, S_STATUS] != FAULTY:
            mask |= 1 << i
    return mask


@kernel
def _quiet(air: AirState, par: AirParams, known: int, t: float) -> int:
    """Bit mask of pitots that are neither constant nor scatter nor swing."""
    mask = 0
    for i in range(N_PITOTS):
        constant = t - air.check[i, SAME_SINCE] > par.checks.constant_s
        others = sound_pitots(air, known) & ~(1 << i)
        rms, ratio = QUIET_SHARE * par.checks.noise_rms, QUIET_SHARE * par.checks.noise_ratio
        scatters = noisy(air.check, i, others, rms, ratio)
        if not (constant or scatters or swinging(air.swing, i, others, t)):
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
        note(air.peaks, APART_PEAK, t, air.noise[APART], 0.0)
        note(air.peaks, NOISE_PEAK, t, air.noise[GPS_STD], 0.0)
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
def _estimate(air: AirState, par: AirParams, t: float, V: Array, E: Array, out: Array) -> float:
    """Write the air data of the master; return its own standard deviation of ln n.

    The published wind is the mean wind W; the airspeeds and angles are of the moment, gusts
    included. Beyond the master's P, these count:

    - The vertical wind. Without a vane only sideslip in banked flight speaks of it, and sideslip
      has other causes: on synthetic flights the master's vertical wind was further off than zero.
      The angles and the published wind take it for zero, mean and gust, and say how far it may be.
    - The gusts themselves. GUST_STD leaves out those that are slower than the mean of the slip;
      their whole variance is 1 + tau / SLIP_MEAN_TAU_S times as large.
    - Heading and gust are not independent: the nose turns into a gust and the aircraft drifts with
      it, which passes for knowledge of the speed along the nose. The error of ln n is of second
      order, BEND (gust / n)^2.
    - Slow errors of the attitude, and of the velocity.
    """
    x, P, pressure = air.bank.x, air.bank.P, air.memory[PRESSURE]
    noise = air.noise
    gust2 = noise[SLIP_VAR] * (1.0 + par.levels.gust_tau_s / SLIP_MEAN_TAU_S)
    gust2 = max(gust2, par.noise.gust_min_m_s**2)
    velocity2 = noise[GPS_STD] ** 2 + 0.5 * noise[APART] ** 2
    mean_down2 = par.levels.vertical_prior_m_s**2
    d = np.empty(3)
    n = air_velocity(x, V, d)
    bend2 = (BEND * gust2 / (n * n)) ** 2
    var_n = 0.0
    for i in range(6):
        for j in range(6):
            var_n += P[i, j] * d[i % 3] * d[j % 3] / (n * n)
    ln_n_std = math.sqrt(var_n) / n
    cas = cas_from_tas(n, pressure, temperature(altitude_from_pressure(pressure)))
    std = math.sqrt(ln_n_std**2 + bend2 + velocity2 / (n * n))
    out[0] = t
    out[1], out[2] = cas, cas * std
    out[3], out[4] = n, n * std
    d[2] = V[2]
    u, v, w = 0.0, 0.0, 0.0
    var_v, var_w = 0.0, 0.0
    for i in range(3):
        u += E[0, i] * d[i]
        v += E[1, i] * d[i]
        w += E[2, i] * d[i]
        for j in range(3):
            S = velocity2 if i == j else 0.0
            if i < 2 and j < 2:
                S += P[i, j] + P[i, 3 + j] + P[3 + i, j] + P[3 + i, 3 + j]
            elif i == j:
                S += mean_down2 + DOWN_SHARE * gust2
            var_v += S * E[1, i] * E[1, j]
            var_w += S * E[2, i] * E[2, j]
    out[5] = math.atan2(w, max(u, 0.0))
    out[6] = math.sqrt(var_w / (n * n) + TILT_STD_RAD**2)
    out[7] = math.asin(min(max(v / n, -1.0), 1.0)) - x[YAW]
    out[8] = math.sqrt(var_v / (n * n) + P[YAW, YAW] + TILT_STD_RAD**2)
    for i in range(2):
        out[9 + i], out[12 + i] = x[i], math.sqrt(P[i, i] + bend2 * n * n)
    out[11], out[14] = 0.0, math.sqrt(mean_down2)
    return ln_n_std


@kernel
def use_epoch(
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
    dt = min(max(t - memory[T_EPOCH], 0.01), LONGEST_STEP_S)
    memory[T_EPOCH] = t
    reference_noise(air.noise, dt, V, v_nav, has_nav)
    if memory[FLYING] < 0.5:
        return False
    known = known_pitots(air)
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
    x_slip = work[6]
    for i in range(NX):
        x_slip[i] = bank.hx[WIND_CHANGED, i, g] if g >= 0 else bank.x[i]
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
    memory[LN_N_STD] = _estimate(air, par, t, V, E, out)
    for i in range(N_PITOTS):
        s = judge.sensor[i]
        s[S_SHOWN] = math.exp(y[i])
        s[S_EXPECT] = sigma * out[3] * math.exp(-bank.x[_SCALE0 + i])
        s[S_RESIDUAL] = math.log(s[S_SHOWN] / s[S_EXPECT])
    quiet = _quiet(air, par, known, t)
    long_enough = t - memory[FLYING_SINCE] >= f.learn_s
    gust = air.noise[GUST_STD] / out[3]
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
        gust,
        top,
        where,
        air.tests,
    ):
        clear(bank)
        return True
    gather_epoch(
        air.stages,
        par.stage,
        bank.x,
        bank.P,
        t,
        step,
        V,
        E[1],
        y,
        use,
        learnt,
        sound_pitots(air, known),
        memory[FLYING_SINCE],
        ln_sigma,
        air.noise,
        q,
    )
    if air.stages.memory[G_RUNS] < 0.5 or air.stages.memory[G_FRESH] > 0.5:
        for i in range(N_PITOTS):
            air.tests[LONG + i] = np.nan
    if learnt != 0:
        note_evidence(air.peaks, t, par.limits, bank, top, where, learnt, known, gust)
        if t - memory[T_SPAWN] >= f.spawn_s:
            spawn(bank, t, learnt, f.jump_scale, f.jump_wind_m_s, f.age_max_s)
            memory[T_SPAWN] = t
    return True
