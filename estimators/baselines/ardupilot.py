"""ArduPilot's own airspeed checks, as a baseline: what it would have said, and when.

This is our own model of the logic that ArduPilot describes in its sources (docs/references,
``ardupilot2024``); no line of it is ArduPilot's. It reads the events of
:mod:`estimators.baselines.autopilot_events`.

========== ====================================================== ========= =====
symbol     meaning                                                default   unit
========== ====================================================== ========= =====
nu, S      innovation of the airspeed in EKF3's wind, variance              m/s
g          ARSPD_WIND_GATE                                        5
w_max      ARSPD_WIND_MAX, 0 is off                               0         m/s
p          health of a pitot                                      1
gate       EK3_EAS_I_GATE / 100                                   4
R          (EK3_EAS_M_NSE rho)^2, rho = TAS / CAS                 1.4       m/s
q          12 ms (EK3_WIND_P_NSE (1 + EK3_WIND_PSCALE |V_D|))^2   .1, 1     m^2/s^3
========== ====================================================== ========= =====

*Health* (``AP_Airspeed::check_sensor_ahrs_wind_max_failures``). At a loop of 10 Hz, whenever more
than 200 ms have passed (in effect every 300 ms), with a 3D fix and a positive airspeed, a pitot is
bad when |CAS - ground speed| > w_max or, with the option of the EKF's consistency,
|nu| / sqrt(S) > g (0.7 g once it is disabled). Bad: p <- .90 p. Good: p <- .98 p + .02. It is
disabled below .10 and comes back above .95. nu is the primary pitot's, and every pitot is held to
it: a fault of the primary disables its healthy neighbour too.

*Wind* (``FuseAirspeed``, ``FuseSideslip``). Inside the gate the airspeed is fused. Outside it is
rejected, and after 5 s EKF3 calls it timed out. A disabled pitot is compared, not fused, while q is
ten times as large.

Differs: the ground velocity and the attitude are those that the autopilot published, with the
variance EKF3's own log shows for them in steady flight; EKF3 corrects them by the airspeed as well.
The rule that an EKF that distrusts its IMU lets every airspeed pass is not imitated.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.autopilot_events import (
    FIX,
    FLYING,
    FRESH_US,
    GPS,
    GPS_T,
    IN_FLIGHT,
    NAV_T,
    PARAMETER,
    PITOTS,
    Q_T,
    RHO,
    SAID,
    SHARED,
    TICK,
    TICK_US,
    Q,
    V,
    begin_along_heading,
    follow,
    fuse_airspeed,
    fuse_sideslip,
    grow,
    heading,
    next_tick,
)
from estimators.jit import kernel

__all__ = [
    "DISABLED",
    "ENABLED",
    "FELL_BACK",
    "FUSED_AGAIN",
    "PARAMETERS",
    "TIMED_OUT",
    "ArduPilotAirspeed",
    "judge",
]

Array = NDArray[np.float64]

DISABLED, ENABLED, FELL_BACK, TIMED_OUT, FUSED_AGAIN = 0.0, 1.0, 2.0, 3.0, 4.0
"""What happened: the check disabled a pitot, it or the loss of GPS brought it back, EKF3 has
rejected the primary pitot for 5 s, EKF3 fuses it again."""

(
    WIND_MAX, WIND_GATE, OPTIONS, PRIMARY, EAS_NOISE, EAS_GATE, WIND_NOISE, WIND_SCALE, EVERY_US,
    USE,
) = range(10)  # fmt: skip

PARAMETERS: Final[Mapping[str, tuple[int, float]]] = {
    "ARSPD_WIND_MAX": (WIND_MAX, 0.0),
    "ARSPD_WIND_GATE": (WIND_GATE, 5.0),
    "ARSPD_OPTIONS": (OPTIONS, 11.0),
    "ARSPD_PRIMARY": (PRIMARY, 0.0),
    "EK3_EAS_M_NSE": (EAS_NOISE, 1.4),
    "EK3_EAS_I_GATE": (EAS_GATE, 400.0),
    "EK3_WIND_P_NSE": (WIND_NOISE, 0.1),
    "EK3_WIND_PSCALE": (WIND_SCALE, 1.0),
    "ARSPD_USE": (USE, 1.0),
    "ARSPD2_USE": (USE + 1, 1.0),
    "ARSPD3_USE": (USE + 2, 1.0),
}
"""ArduPilot's parameter -> (place in the parameter vector, default)."""

DO_DISABLE, DO_REENABLE, USE_EKF = 1, 2, 8
"""Bits of ARSPD_OPTIONS."""

BAD, GOOD, P_DISABLE, P_ENABLE, DISABLED_GATE = 0.90, 0.98, 0.10, 0.95, 0.7
RETRY_US = 5_000_000
EKF_STEP_S = 0.012
VELOCITY_VAR = 0.13**2
"""EKF3's own variance of each velocity component in steady flight [m^2/s^2]."""
SIDESLIP_VAR, SIDESLIP_MAX_RAD = 0.03, 0.5
BEGIN_ACROSS_RAD = np.radians(45.0)

# State vector: what both autopilots keep, then ArduPilot's own.
SPEED, GROWN_T, NU, S_NU, NU_T, PASS_T, LATE = range(SHARED, SHARED + 7)
CAS, CAS_T, CHECK_T, HEALTH, OFF = range(LATE + 1, LATE + 1 + 5 * PITOTS, PITOTS)
WIND = slice(OFF + PITOTS, OFF + PITOTS + 6)
_SIZE = OFF + PITOTS + 6


class ArduPilotAirspeed:
    """State of the airspeed checks over a stream of events.

    Parameters
    ----------
    parameters
        ArduPilot parameter -> value, over the defaults of :data:`PARAMETERS`.
    every_us
        Time that must have passed between two looks at a pitot's health [us].
    """

    def __init__(
        self, parameters: Mapping[str, float] | None = None, every_us: int = 200_000
    ) -> None:
        self.par = np.zeros(USE + PITOTS)
        self.par[EVERY_US] = every_us
        for name, (place, default) in PARAMETERS.items():
            self.par[place] = (parameters or {}).get(name, default)
        self.state = np.full(_SIZE, -np.inf)
        self.state[[SPEED, FIX, IN_FLIGHT, NU, S_NU, LATE, SAID]] = 0.0
        self.state[RHO] = 1.0
        self.state[HEALTH : HEALTH + PITOTS] = 1.0
        self.state[OFF : OFF + PITOTS] = 0.0
        self.state[V] = self.state[Q] = self.state[WIND] = 0.0

    def step(self, t_us: NDArray[np.int64], kind: NDArray[np.int64], value: Array) -> Array:
        """Use events in time order.

        Parameters
        ----------
        t_us, kind : (n,) int64
            Time [us] and kind.
        value : (n, 4) float64
            Values of the kind.

        Returns
        -------
        (m, 5) float64
            Time [us], pitot, DISABLED ... FUSED_AGAIN, |nu| / sqrt(S), CAS - ground speed [m/s].
        """
        if not len(t_us):
            return np.empty((0, 5))
        ticks = int(t_us[-1] - t_us[0]) // TICK_US + 2
        out = np.empty((min(2 * ticks, 20_000) + 2 * PITOTS, 5))
        return out[: judge(self.state, self.par, t_us, kind, value, out)].copy()


@kernel
def judge(
    s: Array,
    par: Array,
    t_us: NDArray[np.int64],
    kind: NDArray[np.int64],
    value: Array,
    out: Array,
) -> int:
    """Advance over events; return how many rows of ``out`` were written (see ``step``)."""
    s[SAID] = 0.0
    for i in range(len(t_us)):
        t = float(t_us[i])
        if t - s[TICK] > 10.0 * FRESH_US:
            s[TICK] = float(next_tick(t_us[i]))
        while t >= s[TICK]:
            _tick(s, par, s[TICK], out)
            s[TICK] += TICK_US
        k, v = kind[i], value[i]
        if k < PITOTS:
            s[CAS + k], s[CAS_T + k] = v[0], t
            if k == int(par[PRIMARY]):
                _fuse(s, par, t, v[0], out)
        elif k == PARAMETER:
            par[int(v[0])] = v[1]
        else:
            follow(s, t, k, v)
            if k == GPS:
                s[SPEED] = sqrt(v[0] * v[0] + v[1] * v[1])
            elif k == FLYING:
                s[WIND] = 0.0
                s[PASS_T], s[LATE] = t, 0.0
    return int(s[SAID])


@kernel
def _fuse(s: Array, par: Array, t: float, cas: float, out: Array) -> None:
    """The primary pitot's innovation in EKF3's wind."""
    if s[IN_FLIGHT] < 0.5 or t - max(s[NAV_T], s[GPS_T]) > FRESH_US:
        return
    wind, k = s[WIND], int(par[PRIMARY])
    tas = cas * s[RHO]
    R = max(par[EAS_NOISE] * s[RHO], 0.5) ** 2
    if wind[5] < 0.5:
        if t - s[Q_T] < FRESH_US and tas > 0.0:
            across = (max(tas, 5.0) * BEGIN_ACROSS_RAD) ** 2
            begin_along_heading(wind, s[V], tas, heading(s[Q]), R + VELOCITY_VAR, across)
            s[GROWN_T], s[PASS_T] = t, t
        return
    use = s[OFF + k] < 0.5 and par[USE + k] > 0.5
    q = EKF_STEP_S * (par[WIND_NOISE] * (1.0 + par[WIND_SCALE] * abs(s[V][2]))) ** 2
    grow(wind, q if use else 10.0 * q, (t - s[GROWN_T]) * 1e-6)
    s[GROWN_T] = t
    gate = max(0.01 * par[EAS_GATE], 1.0)
    s[NU], s[S_NU], passed = fuse_airspeed(wind, s[V], tas, R, VELOCITY_VAR, gate, use)
    s[NU_T] = t
    if passed:
        s[PASS_T] = t
    late = t - s[PASS_T] > RETRY_US
    if late != (s[LATE] > 0.5):
        _say(s, t, k, TIMED_OUT if late else FUSED_AGAIN, out)
        s[LATE] = 1.0 if late else 0.0


@kernel
def _tick(s: Array, par: Array, t: float, out: Array) -> None:
    """One turn of the 10 Hz loop: no sideslip in EKF3's wind, then the health of every pitot."""
    if s[WIND][5] > 0.5 and t - s[Q_T] < FRESH_US:
        fuse_sideslip(s[WIND], s[V], s[Q], SIDESLIP_VAR, VELOCITY_VAR, 1e3, SIDESLIP_MAX_RAD)
    for k in range(PITOTS):
        if t - s[CAS_T + k] < FRESH_US and t - s[CHECK_T + k] > par[EVERY_US]:
            s[CHECK_T + k] = t
            _check(s, par, t, k, out)


@kernel
def _check(s: Array, par: Array, t: float, k: int, out: Array) -> None:
    """One look at the health of pitot k."""
    options = int(par[OPTIONS])
    if (par[WIND_MAX] <= 0.0 and par[WIND_GATE] <= 0.0) or s[CAS + k] <= 0.0:
        return
    off = s[OFF + k] > 0.5
    if s[FIX] < 3.0 or t - s[GPS_T] > 4.0 * FRESH_US:
        if off:
            s[OFF + k] = 0.0
            _say(s, t, k, FELL_BACK, out)
        return
    ratio = _ratio(s, t)
    gate = par[WIND_GATE] * (DISABLED_GATE if off or par[USE + k] < 0.5 else 1.0)
    inconsistent = par[WIND_GATE] > 0.0 and options & USE_EKF != 0 and ratio > gate
    implausible = par[WIND_MAX] > 0.0 and abs(s[CAS + k] - s[SPEED]) > par[WIND_MAX]
    if inconsistent or implausible:
        s[HEALTH + k] *= BAD
    else:
        s[HEALTH + k] = GOOD * s[HEALTH + k] + (1.0 - GOOD)
    if not off and par[USE + k] > 0.5:
        if options & DO_DISABLE != 0 and s[HEALTH + k] < P_DISABLE:
            s[OFF + k] = 1.0
            _say(s, t, k, DISABLED, out)
    elif off and options & DO_REENABLE != 0 and s[HEALTH + k] > P_ENABLE:
        s[OFF + k] = 0.0
        _say(s, t, k, ENABLED, out)


@kernel
def _ratio(s: Array, t: float) -> float:
    """|nu| / sqrt(S), 0 when EKF3 has looked at no airspeed for a second."""
    if t - s[NU_T] < FRESH_US and s[S_NU] > 0.0:
        return float(abs(s[NU]) / sqrt(s[S_NU]))
    return 0.0


@kernel
def _say(s: Array, t: float, k: int, what: float, out: Array) -> None:
    n = int(s[SAID])
    if n < len(out):
        out[n, 0], out[n, 1], out[n, 2] = t, k, what
        out[n, 3], out[n, 4] = _ratio(s, t), s[CAS + k] - s[SPEED]
        s[SAID] += 1.0
