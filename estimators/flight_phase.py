"""Flight phase from ground speed and height: is this aircraft flying, so that it may be judged?

======== ================================================= =====
symbol   meaning                                           unit
======== ================================================= =====
V        ground speed                                      m/s
h        height above sea level                            m
h_0      height of the ground it last stood still on       m
V_D      down velocity (sink rate)                         m/s
======== ================================================= =====

An aircraft that was seen standing must be faster than ``V_fly`` *and* ``h_takeoff`` above the place
where it stood. One that was never seen standing (the stream began in flight) need only be fast.
It stops being judged when it sinks through ``h_landing`` above that place, so before the flare, or
when it is slow and either near the ground or not known to be above it. Flight against a wind as
fast as the aircraft is still flight: low ground speed high above the ground changes nothing.
Airspeed is not used, since it is what may be wrong. The receiver's velocity and the autopilot's
height are preferred; each stands in for the other while that one is silent.
"""

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["FLYING", "NAV", "RECEIVER", "initial_state", "track_phase"]

RECEIVER, NAV = 0, 1
"""Source of an event: the satellite receiver, or the autopilot's own navigation."""

# State vector.
FLYING, FAST_SINCE, SLOW_SINCE, STILL_SINCE, H, H0, SINK, LAST_RECEIVER, LAST_NAV = range(9)

# Parameter vector.
(
    P_FLY_SPEED,
    P_CONFIRM_US,
    P_TAKEOFF_HEIGHT,
    P_LANDING_HEIGHT,
    P_STILL_SPEED,
    P_SILENT_US,
    P_JOIN_US,
) = range(7)


def initial_state() -> NDArray[np.float64]:
    """State before the first event: not flying, nothing known. Shape (9,)."""
    state = np.full(9, np.nan)
    state[FLYING] = 0.0
    return state


@kernel
def _fly(state: NDArray[np.float64], par: NDArray[np.float64], t: float) -> bool:
    """Whether the aircraft on the ground has begun to fly."""
    fast_us = t - state[FAST_SINCE]
    if np.isnan(state[H0]):
        return bool(fast_us >= par[P_JOIN_US])
    fast = fast_us >= par[P_CONFIRM_US]
    return bool(fast and state[H] - state[H0] > par[P_TAKEOFF_HEIGHT])


@kernel
def _stop(state: NDArray[np.float64], par: NDArray[np.float64], t: float) -> bool:
    """Whether the flying aircraft is about to land, or has landed."""
    above = state[H] - state[H0]
    if above < par[P_LANDING_HEIGHT] and state[SINK] > 0.3:
        return True
    slow = t - state[SLOW_SINCE] >= par[P_CONFIRM_US]
    return bool(slow and not above > 2.0 * par[P_TAKEOFF_HEIGHT])


@kernel
def _since(was_us: float, condition: bool, t: float) -> float:
    """Time since which the condition holds without a break; NaN while it does not."""
    if not condition:
        return np.nan
    return t if np.isnan(was_us) else was_us


@kernel
def track_phase(
    state: NDArray[np.float64],
    par: NDArray[np.float64],
    t_us: NDArray[np.int64],
    source: NDArray[np.int64],
    speed: NDArray[np.float64],
    height: NDArray[np.float64],
    sink: NDArray[np.float64],
    out_index: NDArray[np.int64],
) -> int:
    """Advance over events in time order; return how many changes of phase there were.

    Parameters
    ----------
    state : (9,) float64, changed in place
    par : (7,) float64: flying speed [m/s], confirmation [us], take-off height [m], landing height
        [m], standstill speed [m/s], silence after which the other source serves [us], confirmation
        when the stream began in flight [us]
    t_us, source : (n,) int64, time [us] and RECEIVER or NAV
    speed, height, sink : (n,) float64, V [m/s], h [m], V_D [m/s]; NaN where not measured
    out_index : (n,) int64, receives the index of each event at which the phase changed
    """
    n_out = 0
    for i in range(len(t_us)):
        t = float(t_us[i])
        if source[i] == RECEIVER:
            use_speed = not np.isnan(speed[i])
            use_height = not t - state[LAST_NAV] <= par[P_SILENT_US]
            if use_speed:
                state[LAST_RECEIVER] = t
        else:
            use_speed = not t - state[LAST_RECEIVER] <= par[P_SILENT_US]
            use_height = True
            state[LAST_NAV] = t
        if use_speed:
            V = speed[i]
            state[FAST_SINCE] = _since(state[FAST_SINCE], V >= par[P_FLY_SPEED], t)
            state[SLOW_SINCE] = _since(state[SLOW_SINCE], V < 0.5 * par[P_FLY_SPEED], t)
            state[STILL_SINCE] = _since(state[STILL_SINCE], V < par[P_STILL_SPEED], t)
        if use_height:
            state[H] = height[i]
            state[SINK] = sink[i]
        flying = state[FLYING] > 0.5
        still = t - state[STILL_SINCE] >= par[P_CONFIRM_US]
        if not flying and still and not abs(state[SINK]) > 1.0:
            state[H0] = state[H]
        change = _stop(state, par, t) if flying else _fly(state, par, t)
        if change:
            state[FLYING] = 0.0 if flying else 1.0
            state[FAST_SINCE] = np.nan
            state[SLOW_SINCE] = np.nan
            out_index[n_out] = i
            n_out += 1
    return n_out
