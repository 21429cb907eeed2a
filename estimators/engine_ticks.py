"""What the engine watch needs of a flight, on a fixed grid of time: throttle, speeds, power.

Rows come when they come; an engine model has a fixed step. Every step takes the newest throttle and
airspeed, the engine speeds that came within it, and how the aircraft's energy changes:

=======  =================================================================  ========
symbol   meaning                                                            unit
=======  =================================================================  ========
h        height, from static pressure where there is any                    m
V        airspeed (median of the pitots), V_g speed over the ground          m/s
H        energy height h + V^2 / 2 g; H_g the same with V_g                  m
p        dH/dt averaged over T: the climb that engine and drag make          m/s
t        throttle from 0 to 1; t_T averaged over T like p                    1
=======  =================================================================  ========

H feels gusts and a broken pitot, H_g feels the wind in turns; neither feels an engine speed. So p
and p_g tell an engine that stopped from a channel that says so.

Rows are used in order of time, so where a stream is cut changes nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "EV_BARO",
    "EV_CAS",
    "EV_DEMAND",
    "EV_GPS",
    "EV_MODE",
    "EV_NAV",
    "EV_PARAM",
    "EV_PHASE",
    "EV_SERVO",
    "EV_SPOOL",
    "GAP_S",
    "N_CHANNELS",
    "N_SHAFTS",
    "N_TABLE",
    "PARAM_FUNCTION",
    "PARAM_MAX",
    "PARAM_MIN",
    "PARAM_REVERSED",
    "X_AIRSPEED",
    "X_FLYING",
    "X_IDLE",
    "X_MISSES",
    "X_P",
    "X_PG",
    "X_T",
    "X_THROTTLE",
    "X_THROTTLE_T",
    "TickRules",
    "Ticks",
    "gather",
    "new_ticks",
    "ticks_bound",
]  # fmt: skip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

N_CHANNELS, N_SHAFTS, N_PITOTS = 16, 4, 3
G0_M_S2 = 9.80665
GAP_S = 5.0
"""A pause of all rows longer than this is skipped over."""
FRESH_S = 2.0
THROTTLE_FRESH_S = 3.0
DEMAND_FRESH_S = 3.0
DEMAND_S = 2.0
"""Averaging time of what the autopilot misses."""
IDLE_SHARE = 0.15
"""The lowest throttle output of a flight is its idle if it is not above this."""
DEAD_PITOT = 0.3
"""An airspeed below this share of the ground speed is no airspeed."""

(EV_PHASE, EV_SERVO, EV_SPOOL, EV_CAS, EV_GPS, EV_BARO, EV_NAV, EV_DEMAND, EV_MODE,
 EV_PARAM) = range(10)  # fmt: skip
PARAM_FUNCTION, PARAM_MIN, PARAM_MAX, PARAM_REVERSED = range(4)
FUNCTION_THROTTLE = 70.0
"""SERVOn_FUNCTION of the output that drives the engine."""

# Columns of the table; X_THROTTLE is the first of one per shaft.
X_T, X_FLYING, X_AIRSPEED, X_P, X_PG, X_THROTTLE_T, X_IDLE, X_MISSES, X_THROTTLE = range(9)
N_TABLE = X_THROTTLE + N_SHAFTS

# Scalars.
(N_TICK, FLYING, V_G, T_GPS, H_BARO, T_BARO, H_NAV, T_NAV, T_SERVO, SHORT_H, SHORT_V, T_DEMAND,
 AUTONOMOUS, SOURCE, LP_H, LP_HG, LP_THROTTLE, LOWEST, FOUND) = range(19)  # fmt: skip


class TickRules(NamedTuple):
    """Step [s], averaging time T [s], and each shaft's servo output (-1: by parameter)."""

    tick_s: float
    power_s: float
    outputs: Ints


class Ticks(NamedTuple):
    """All memory; arrays are changed in place.

    Attributes
    ----------
    s : (19,) float64
    cas : (3, 2) float64 [m/s], [s]
        Newest of each pitot and when it came.
    pwm : (16,) float64 [us]
    travel : (16, 3) float64 [us], [us], [1]
        Pulse at throttle 0 and 1 of each output, 1 where it is reversed.
    y : (16,) float64 [rpm]
        Engine speeds that came within this step, NaN where none did.
    """

    s: Array
    cas: Array
    pwm: Array
    travel: Array
    y: Array


def new_ticks(idle_us: float, full_us: float) -> Ticks:
    """Nothing seen, on the ground; throttle pulses until a parameter tells them [us]."""
    s = np.full(19, np.nan)
    s[N_TICK] = s[FLYING] = s[SHORT_H] = s[SHORT_V] = s[AUTONOMOUS] = s[FOUND] = 0.0
    s[SOURCE] = -1.0
    return Ticks(
        s,
        np.full((N_PITOTS, 2), np.nan),
        np.full(16, np.nan),
        np.tile([idle_us, full_us, 0.0], (16, 1)),
        np.full(N_CHANNELS, np.nan),
    )


def ticks_bound(t: Array, since_s: float, tick_s: float) -> int:
    """How many steps these events can close at most; the last event before was at `since_s`."""
    pauses = np.minimum(np.diff(t, prepend=since_s), GAP_S + 4.0 * tick_s)
    return int(pauses.sum() / tick_s) + 8


@kernel
def _throttle(m: Ticks, output: int, t: float) -> float:
    """Throttle of a servo output from 0 to 1; NaN while it is not known."""
    if not t - m.s[T_SERVO] <= THROTTLE_FRESH_S:
        return np.nan
    pulse, low, high = m.pwm[output], m.travel[output, 0], m.travel[output, 1]
    if not pulse > 0.0 or high == low:  # nor NaN, an output that is switched off
        return np.nan
    share = min(max((pulse - low) / (high - low), 0.0), 1.0)
    return float(1.0 - share if m.travel[output, 2] > 0.5 else share)


@kernel
def _airspeed(m: Ticks, t: float) -> float:
    """Median of the pitots that work; the ground speed where none does."""
    V_g = m.s[V_G] if t - m.s[T_GPS] <= FRESH_S else np.nan
    low, mid, high, n = np.inf, 0.0, -np.inf, 0
    for i in range(N_PITOTS):
        V = m.cas[i, 0]
        if t - m.cas[i, 1] <= FRESH_S and not V < DEAD_PITOT * V_g:
            low, high, mid, n = min(low, V), max(high, V), mid + V, n + 1
    if n == 0:
        return float(V_g)
    if n == 3:
        return float(mid - low - high)
    return float(mid / n)


@kernel
def _close(m: Ticks, p: TickRules, t: float, row: Array, y: Array) -> None:
    """Finish a step at time t."""
    s = m.s
    row[X_T], row[X_FLYING] = t, s[FLYING]
    for shaft in range(N_SHAFTS):
        output = p.outputs[shaft]
        if output < 0:
            output = int(s[FOUND]) - 1 if s[FOUND] > 0.0 else 2
        row[X_THROTTLE + shaft] = _throttle(m, output, t)
    throttle = row[X_THROTTLE]
    if throttle < IDLE_SHARE and not throttle >= s[LOWEST]:
        s[LOWEST] = throttle
    row[X_IDLE] = 1.0 if throttle <= s[LOWEST] + 0.02 else 0.0
    V = _airspeed(m, t)
    row[X_AIRSPEED] = V
    missed = s[SHORT_H] > 0.3 and s[SHORT_V] > 0.3 and t - s[T_DEMAND] <= DEMAND_FRESH_S
    row[X_MISSES] = 1.0 if missed and s[AUTONOMOUS] > 0.5 else 0.0
    h, source = s[H_BARO], 0.0
    if not t - s[T_BARO] <= FRESH_S:
        h, source = s[H_NAV], 1.0
        if not t - s[T_NAV] <= FRESH_S:
            source = -1.0
    row[X_P] = row[X_PG] = row[X_THROTTLE_T] = np.nan
    fresh = t - s[T_GPS] <= FRESH_S
    if source < 0.0 or not fresh or math.isnan(V) or math.isnan(throttle):
        s[SOURCE] = -1.0
    else:
        H, H_g = h + V * V / (2.0 * G0_M_S2), h + s[V_G] * s[V_G] / (2.0 * G0_M_S2)
        if source != s[SOURCE]:
            s[SOURCE], s[LP_H], s[LP_HG], s[LP_THROTTLE] = source, H, H_g, throttle
        share = p.tick_s / p.power_s
        s[LP_H] += share * (H - s[LP_H])
        s[LP_HG] += share * (H_g - s[LP_HG])
        s[LP_THROTTLE] += share * (throttle - s[LP_THROTTLE])
        row[X_P] = (H - s[LP_H]) / p.power_s
        row[X_PG] = (H_g - s[LP_HG]) / p.power_s
        row[X_THROTTLE_T] = s[LP_THROTTLE]
    for i in range(N_CHANNELS):
        y[i] = m.y[i]
        m.y[i] = np.nan


@kernel
def _use(m: Ticks, t: float, code: int, index: int, value: Array, pwm: Array) -> None:
    """Take one event."""
    s = m.s
    if code == EV_SERVO:
        s[T_SERVO] = t
        for i in range(16):
            m.pwm[i] = pwm[index, i]
    elif code == EV_SPOOL:
        m.y[index] = value[0]
    elif code == EV_CAS:
        m.cas[index, 0], m.cas[index, 1] = value[0], t
    elif code == EV_GPS:
        s[V_G], s[T_GPS] = value[0], t
    elif code == EV_BARO:
        s[H_BARO], s[T_BARO] = value[0], t
    elif code == EV_NAV:
        s[H_NAV], s[T_NAV] = value[0], t
    elif code == EV_DEMAND:
        share = 1.0
        if t - s[T_DEMAND] <= DEMAND_FRESH_S:
            share = 1.0 - math.exp(-(t - s[T_DEMAND]) / DEMAND_S)
        s[SHORT_H] += share * (math.copysign(1.0, value[0]) - s[SHORT_H])
        s[SHORT_V] += share * (value[1] - s[SHORT_V])
        s[T_DEMAND] = t
    elif code == EV_MODE:
        s[AUTONOMOUS] = value[0]
    elif code == EV_PHASE:
        s[FLYING] = value[0]
    elif code == EV_PARAM:
        what, output = index // 16, index % 16
        if what == PARAM_FUNCTION:
            if value[0] == FUNCTION_THROTTLE:
                s[FOUND] = output + 1.0
        elif what == PARAM_REVERSED:
            m.travel[output, 2] = value[0]
        else:
            m.travel[output, what - PARAM_MIN] = value[0]


@kernel
def gather(
    m: Ticks, p: TickRules, t: Array, code: Ints, index: Ints, value: Array, pwm: Array,
    table: Array, y: Array,
) -> int:  # fmt: skip
    """Use events; return how many steps were closed.

    Parameters
    ----------
    t : (n,) float64 [s]
        In order.
    code, index : (n,) int64
        EV_*; channel, pitot, row of `pwm`, or 16 PARAM_* + servo output.
    value : (n, 2) float64
        Speed [rpm], [m/s]; height [m]; height that the autopilot misses [m] and sign of the
        airspeed; 1 while flying, or autonomous; parameter.
    pwm : (k, 16) float64 [us]
    table, y : (K, 12), (K, 16) float64
        Receive the steps: columns X_*; engine speeds [rpm].
    """
    s = m.s
    n = 0
    for k in range(t.size):
        end = (s[N_TICK] + 1.0) * p.tick_s
        stop = end + GAP_S
        while t[k] > end:
            _close(m, p, end, table[n], y[n])
            n += 1
            s[N_TICK] += 1.0
            end = (s[N_TICK] + 1.0) * p.tick_s
            if end > stop:
                s[N_TICK] = max(s[N_TICK], math.floor(t[k] / p.tick_s) - 1.0)
                end = (s[N_TICK] + 1.0) * p.tick_s
                stop = np.inf
        _use(m, t[k], code[k], index[k], value[k], pwm)
    return n
