"""PX4's own checks of airspeeds and IMUs, as a baseline: what it would have said, and when.

This is our own model of the logic that PX4 describes in its sources (docs/references,
``px4_2024``); no line of it is PX4's. The airspeed checks read the events of
:mod:`estimators.baselines.autopilot_events`.

============= ================================================== ======= =====
symbol        meaning                                            default unit
============= ================================================== ======= =====
e             |TAS - |V - W||                                            m/s
e_max         ASPD_FS_INNOV                                      5       m/s
E             integral of e - e_max; 0 as soon as e <= e_max             m
E_max         ASPD_FS_INTEG                                      10      m
T_fail        for how long E > E_max is the check's failure      1       s
T_stop        ASPD_FS_T_STOP, from its failure to invalid        1       s
T_start       ASPD_FS_T_START, until valid again; < 0 is never   -1      s
d_i           IMU i minus the mean of all, low-passed over 0.1 s         m/s^2, rad/s
g_rate, g     EKF2_SEL_IMU_RAT, EKF2_SEL_IMU_ANG                 7, 15   deg/s, deg
a_acc, a      EKF2_SEL_IMU_ACC, EKF2_SEL_IMU_VEL                 1, 2    m/s^2, m/s
============= ================================================== ======= =====

*Airspeed* (``AirspeedValidator``), each pitot for itself, ten times a second, in flight only.
Invalid at once when nothing came for 1 s, or when it showed exactly the same for 2 s. Invalid after
T_fail and T_stop when E > E_max, so 4 s for 10 m/s, 12 s for 6 m/s, never for 5. W is the wind that
the pitot itself gives: an airspeed within 4 sigma is fused, so one that passes the gate is believed
and becomes wind. The first 5 s of the wind are not judged. The load-factor and throttle checks are
off by default and not imitated.

*IMU selector* (``VotedSensorsUpdate``, ``EKF2Selector``). |d_i| beyond the rate is integrated,
never below zero, and an integral beyond the limit is a fault: of three the largest is the faulty
one, of two it is not known which, of one there is no difference to see. With two IMUs d_i is half
their difference. They are compared when each has given a sample of the same moment, within half
the interval between samples: one of a sample ago would differ by all that the aircraft shook in
between.

Differs: the ground velocity and the attitude are those the autopilot published. The scale that
PX4's wind estimator keeps as a third state is left at 1: its noise of 1e-4 per sqrt(s) lets it move
by one percent in a flight.
"""

from __future__ import annotations

from math import exp, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimators.baselines.autopilot_events import (
    FIX,
    FLYING,
    FRESH_US,
    GPS_T,
    IN_FLIGHT,
    NAV_T,
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
    "ACCEL",
    "GYRO",
    "INNOVATION",
    "MISSING",
    "STUCK",
    "VALID",
    "PX4Airspeed",
    "PX4ImuSelector",
    "compare_imus",
    "validate",
]

Array = NDArray[np.float64]

INNOVATION, MISSING, STUCK, VALID = 0.0, 1.0, 2.0, 3.0
"""Why a pitot became invalid, or that it became valid again."""
GYRO, ACCEL = range(2)
"""Which difference between IMUs was found."""

INNOV_M_S, INTEG_M, FAIL_US, STOP_US, START_US = range(5)
AIRSPEED_DEFAULTS: Final = np.array([5.0, 10.0, 1e6, 1e6, -1e6])
"""ASPD_FS_INNOV [m/s], ASPD_FS_INTEG [m], T_fail, ASPD_FS_T_STOP, ASPD_FS_T_START [us]."""

MISSING_US, STUCK_US, SETTLE_US = 1_000_000, 2_000_000, 5_000_000
TAS_VAR, TAS_GATE = 1.4**2, 4.0
BETA_VAR, BETA_GATE = 0.15**2, 1.0
WIND_PSD = 0.1**2
"""ASPD_WIND_NSD^2 [m^2/s^3]."""
VELOCITY_VAR = 0.13**2
BEGIN_ACROSS_RAD = float(np.hypot(np.radians(10.0), np.radians(15.0)))
"""Heading and sideslip, as far as they are trusted when the wind begins."""

# State: the common part, and one block per pitot.
CAS, CAS_T, NEW, CHANGED_T, SHOWN, GROWN_T, BEGUN_T = range(7)
E, E_T, OVER_T, FAIL_T, PASS_T, INVALID = range(7, 13)
WIND = slice(13, 19)
_BLOCK = 19


class PX4Airspeed:
    """State of the airspeed validators over a stream of events.

    Parameters
    ----------
    settings : (5,) float64
        As :data:`AIRSPEED_DEFAULTS`.
    """

    def __init__(self, settings: Array = AIRSPEED_DEFAULTS) -> None:
        self.par = settings.copy()
        self.state = np.zeros(SHARED)
        self.state[[TICK, GPS_T, NAV_T, Q_T]] = -np.inf
        self.state[RHO] = 1.0
        self.pitots = np.zeros((PITOTS, _BLOCK))
        self.pitots[:, [CAS_T, CHANGED_T, E_T, BEGUN_T, OVER_T, FAIL_T, PASS_T]] = -np.inf
        self.pitots[:, SHOWN] = np.nan

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
            Time [us], pitot, INNOVATION ... VALID, e [m/s], calibrated airspeed [m/s].
        """
        if not len(t_us):
            return np.empty((0, 5))
        out = np.empty((min(2 * (int(t_us[-1] - t_us[0]) // TICK_US + 2), 20_000), 5))
        n = validate(self.state, self.pitots, self.par, t_us, kind, value, out)
        return out[:n].copy()


@kernel
def validate(
    s: Array,
    pitots: Array,
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
            for k in range(PITOTS):
                _tick(s, pitots[k], par, s[TICK], k, out)
            s[TICK] += TICK_US
        k, v = kind[i], value[i]
        if k < PITOTS:
            p = pitots[k]
            p[CAS], p[CAS_T], p[NEW] = v[0], t, 1.0
            if v[0] != p[SHOWN]:
                p[SHOWN], p[CHANGED_T] = v[0], t
        else:
            follow(s, t, k, v)
            if k == FLYING:
                pitots[:, CHANGED_T] = t
                pitots[:, WIND] = 0.0
    return int(s[SAID])


@kernel
def _tick(s: Array, p: Array, par: Array, t: float, k: int, out: Array) -> None:
    """One turn of the airspeed selector for one pitot."""
    if p[CAS_T] < 0.0 or s[IN_FLIGHT] < 0.5:
        p[E], p[OVER_T], p[PASS_T], p[E_T] = 0.0, np.inf, t, t
        return
    tas = p[CAS] * s[RHO]
    gnss = s[FIX] >= 3.0 and t - s[GPS_T] < FRESH_US
    if gnss and p[NEW] > 0.5:
        _wind(s, p, t, tas)
    e = _innovation(s, p, par, t, tas, gnss)
    p[NEW] = 0.0
    stuck = t - p[CHANGED_T] > STUCK_US
    missing = t - p[CAS_T] > MISSING_US
    failed = t - p[OVER_T] >= par[FAIL_US]
    if failed or stuck or missing:
        p[FAIL_T] = t
    else:
        p[PASS_T] = t
    if p[INVALID] < 0.5:
        if stuck or missing or t - p[PASS_T] >= par[STOP_US]:
            p[INVALID] = 1.0
            what = MISSING if missing else (STUCK if stuck else INNOVATION)
            _say(s, t, k, what, e, p[CAS], out)
    elif par[START_US] >= 0.0 and t - p[FAIL_T] > par[START_US]:
        p[INVALID] = 0.0
        _say(s, t, k, VALID, e, p[CAS], out)


@kernel
def _wind(s: Array, p: Array, t: float, tas: float) -> None:
    """Fuse the pitot's airspeed and no sideslip into its wind."""
    f = p[WIND]
    attitude = t - s[Q_T] < FRESH_US
    if f[5] < 0.5:
        if attitude:
            across = (tas * BEGIN_ACROSS_RAD) ** 2
            begin_along_heading(f, s[V], tas, heading(s[Q]), TAS_VAR + VELOCITY_VAR, across)
            p[GROWN_T] = p[BEGUN_T] = t
        return
    grow(f, WIND_PSD, (t - p[GROWN_T]) * 1e-6)
    p[GROWN_T] = t
    fuse_airspeed(f, s[V], tas, TAS_VAR, VELOCITY_VAR, TAS_GATE, True)
    if attitude:
        fuse_sideslip(f, s[V], s[Q], BETA_VAR, VELOCITY_VAR, BETA_GATE, np.inf)


@kernel
def _innovation(s: Array, p: Array, par: Array, t: float, tas: float, gnss: bool) -> float:
    """Advance E; return e [m/s], 0 where it cannot be had."""
    f = p[WIND]
    dt = min(max((t - p[E_T]) * 1e-6, 0.01), 0.2)
    p[E_T] = t
    if f[5] < 0.5 or t - p[BEGUN_T] < SETTLE_US:
        p[E], p[OVER_T] = 0.0, np.inf
        return 0.0
    if not gnss:
        p[E] = 0.0
        return 0.0
    d_n, d_e = s[V][0] - f[0], s[V][1] - f[1]
    e = abs(tas - sqrt(d_n * d_n + d_e * d_e + s[V][2] * s[V][2]))
    p[E] = p[E] + dt * (e - par[INNOV_M_S]) if e > par[INNOV_M_S] else 0.0
    if p[E] <= par[INTEG_M]:
        p[OVER_T] = np.inf
    elif p[OVER_T] == np.inf:
        p[OVER_T] = t
    return e


@kernel
def _say(s: Array, t: float, k: int, what: float, a: float, b: float, out: Array) -> None:
    n = int(s[SAID])
    if n < len(out):
        out[n, 0], out[n, 1], out[n, 2] = t, k, what
        out[n, 3], out[n, 4] = a, b
        s[SAID] += 1.0


# --------------------------------------------------------------------------- IMUs

IMUS = 5
RATE = np.array([np.radians(7.0), 1.0])
LIMIT = np.array([np.radians(15.0), 2.0])
"""Rate [rad/s, m/s^2] and limit [rad, m/s] of the difference: gyro, accelerometer."""
LOW_PASS_S = -0.005 / np.log(0.95)
"""PX4 keeps 95 % of the difference at each of 200 samples a second [s]."""
STEP_MAX_S = 0.1
PRESENT_US = 1_000_000

IMU_T, SEEN_T = 0, 1
NOW, APART, SUMS, NEW_SAMPLE = 2, 8, 14, 16
"""First of the sample (rates, then specific forces), of its low-passed difference from the mean,
and of the two sums; whether the sample is of this moment."""
_IMU_BLOCK = 17


class PX4ImuSelector:
    """Accumulated differences between IMUs over a stream of their samples."""

    def __init__(self) -> None:
        self.imus = np.zeros((IMUS, _IMU_BLOCK))
        self.imus[:, [IMU_T, SEEN_T]] = -np.inf
        self.found = np.full(2, -1.0)

    def step(self, t_us: NDArray[np.int64], imu: NDArray[np.int64], sample: Array) -> Array:
        """Use samples in time order.

        Parameters
        ----------
        t_us, imu : (n,) int64
            Time [us] and which IMU; other events, from IMUS on, are passed over.
        sample : (n, 6) float64 [rad/s, m/s^2]
            Rates and specific forces.

        Returns
        -------
        (m, 4) float64
            Time [us], GYRO or ACCEL, what is known: the faulty IMU, IMUS when only that they
            differ, -1 when they agree again; the integral [rad, m/s].
        """
        out = np.empty((min(2 * len(t_us), 20_000), 4))
        return out[: compare_imus(self.imus, self.found, t_us, imu, sample, out)].copy()


@kernel
def compare_imus(
    imus: Array,
    found: Array,
    t_us: NDArray[np.int64],
    imu: NDArray[np.int64],
    sample: Array,
    out: Array,
) -> int:
    """Advance over samples; return how many rows of ``out`` were written (see ``step``)."""
    count = 0
    means = np.empty(6)
    for i in range(len(t_us)):
        t, k = float(t_us[i]), imu[i]
        if k >= IMUS:
            continue
        recent = t - 0.5 * (t - imus[k, SEEN_T])
        for j in range(IMUS):
            if imus[j, SEEN_T] < recent:  # of the moment before
                imus[j, NEW_SAMPLE] = 0.0
        imus[k, SEEN_T] = t
        for c in range(6):
            imus[k, NOW + c] = sample[i, c]
        imus[k, NEW_SAMPLE] = 1.0
        lead, n, every = -1, 0, True
        for j in range(IMUS):
            if t - imus[j, SEEN_T] < PRESENT_US:
                n += 1
                every &= imus[j, NEW_SAMPLE] > 0.5
                if lead < 0:
                    lead = j
        if not every or n < 2:
            continue
        for j in range(IMUS):
            imus[j, NEW_SAMPLE] = 0.0
        for c in range(6):
            mean = 0.0
            for j in range(IMUS):
                if t - imus[j, SEEN_T] < PRESENT_US:
                    mean += imus[j, NOW + c] / n
            means[c] = mean
        for j in range(IMUS):
            if t - imus[j, SEEN_T] < PRESENT_US:
                dt = min(max((t - imus[j, IMU_T]) * 1e-6, 0.0), STEP_MAX_S)
                imus[j, IMU_T] = t
                keep = exp(-dt / LOW_PASS_S)
                for c in range(6):
                    d = keep * imus[j, APART + c] + (1.0 - keep) * (imus[j, NOW + c] - means[c])
                    imus[j, APART + c] = d
                for c in range(2):
                    at = APART + 3 * c
                    x, y, z = imus[j, at], imus[j, at + 1], imus[j, at + 2]
                    size = sqrt(x * x + y * y + z * z)
                    imus[j, SUMS + c] = max(imus[j, SUMS + c] + (size - RATE[c]) * dt, 0.0)
        for c in range(2):
            worst = lead
            for j in range(IMUS):
                present = t - imus[j, SEEN_T] < PRESENT_US
                if present and imus[j, SUMS + c] > imus[worst, SUMS + c]:
                    worst = j
            total = imus[worst, SUMS + c]
            now = -1.0
            if total > LIMIT[c]:
                now = float(worst) if n >= 3 else float(IMUS)
            if now != found[c] and count < len(out):
                out[count, 0], out[count, 1], out[count, 2], out[count, 3] = t, c, now, total
                count += 1
                found[c] = now
    return count
