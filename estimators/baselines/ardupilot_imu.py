"""ArduPilot's own IMU checks, as a baseline: EKF3's lanes, and the differences before arming.

This is our own model of the logic that ArduPilot describes in its sources (docs/references,
``ardupilot2024``); no line of it is ArduPilot's. Every lane is a navigation filter on its own IMU,
all on the same GPS, barometer and heading, so that a lane whose IMU is wrong disagrees with them.

======= ==================================================== ========= ==============
symbol  meaning                                              shape     unit
======= ==================================================== ========= ==============
v, p    velocity and position of the lane, NED               (3,)      m/s, m
q       attitude ned_from_frd, scalar first                  (4,)
b_g,b_a biases of gyro and accelerometer                     (3,)      rad/s, m/s^2
x       errors of v, p, attitude (NED), b_g, b_a             (15,)
P       covariance of x                                      (15, 15)
r_v,r_p test ratios of GPS velocity and position:
        sum of nu^2 / (gate^2 sum of S), gate 5
r_h     the same of the barometric height
score   max((r_v + r_p) / 2, r_h)
e_i     score of lane i minus the primary's, summed at 50 Hz
        while it is > 0 or < -0.2, bounded to +-1
======= ==================================================== ========= ==============

*Lanes* (``NavEKF3::UpdateFilter``, ``updateCoreRelativeErrors``). Armed, a lane with e_i < 0 that
was not the primary in the last 10 s becomes it when the primary's score is above 1 or e_i <= -0.5.
Measurements beyond the gate are not fused; after 7 s the lane is set to them.

*Before arming* (``AP_InertialSensor::accels_consistent``, ``gyros_consistent``). An IMU that
differs from the first by more than 0.75 m/s^2 or 5 deg/s is not consistent until it has agreed for
10 s. Nothing compares IMUs in flight.

Differs: EKF3 has 24 states and steps at 12 ms; here P is stepped ten times a second with the same
spectral densities. The receiver's vertical velocity is not in the log, so the change of its height
between two fixes is compared with the lane's over the same time. The magnetometers are not in it
either, and the heading that the autopilot published stands in, which comes from the primary lane.
What EKF3 does when it distrusts its IMU (10 s without gates) is not imitated. A log has 10 to 50 of
the IMU's samples a second where EKF3 integrates all of them; in turbulence these lanes then
disagree with the GPS for want of samples. While both scores are beyond 0.2, which no single IMU
explains, nothing is decided; after half a second of it the lanes begin anew and settle for 10 s.
``lost_s`` counts that time.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["ARMED", "BARO", "FIX", "HEADING", "INCONSISTENT", "LANES", "SAMPLE", "SWITCHED",
           "ArduPilotImus", "run_lanes"]  # fmt: skip

Array = NDArray[np.float64]

SAMPLE, FIX, BARO, HEADING, ARMED = 0, 5, 6, 7, 8
"""Kinds of events: rates and specific forces of IMU 0 to 4 [rad/s, m/s^2]; receiver's V_N, V_E
[m/s], latitude, longitude [rad], altitude [m], fix type; pressure altitude [m]; quaternion
ned_from_frd; whether the motors are armed."""
SWITCHED, INCONSISTENT = 0.0, 1.0
"""What happened: EKF3 went to another lane; an IMU differs before arming."""
LANES = 2
"""EK3_IMU_MASK = 3."""

VEL, POS, ANGLE, GYRO_BIAS, ACC_BIAS = 0, 3, 6, 9, 12
N_X = 15

EKF_STEP_S = 0.012
ACC_PSD = 0.35**2 * EKF_STEP_S
GYRO_PSD = 0.015**2 * EKF_STEP_S
GYRO_BIAS_PSD = 1e-3**2 * EKF_STEP_S**3
ACC_BIAS_PSD = 0.02**2 * EKF_STEP_S
"""EK3_ACC_P_NSE, GYRO_P_NSE, GBIAS_P_NSE, ABIAS_P_NSE as spectral densities."""
VEL_VAR, VEL_D_VAR, POS_VAR, HEIGHT_VAR, YAW_VAR = 0.5**2, 0.7**2, 0.5**2, 3.0**2, 0.5**2
"""EK3_VELNE_M_NSE, VELD_M_NSE, POSNE_M_NSE, ALT_M_NSE, YAW_M_NSE squared."""
MANOEUVRE, MANOEUVRE_D, ACC_LAG_S = 0.05, 0.07, 0.24
"""GPS velocity noise per m/s^2 of low-passed acceleration, horizontal and down [s]; its time
constant."""
LEVEL_COSINE = 0.5
"""An accelerometer's bias is learnt only on an axis within 60 degrees of the vertical."""
GATE, RETRY_US = 5.0, 7e6
BIAS_STD = np.array([1e-3, 0.05])
COVARIANCE_S = 0.1
LOOP_HZ, BETTER_BY, BETTER_SUM, SUM_MAX, AWAY_US = 50.0, 0.2, 0.5, 1.0, 1e7
SETTLE_US, LOST_AFTER_US = 1e7, 5e5
ACC_DIFFER, GYRO_DIFFER, AGREE_US = 0.75, np.radians(5.0), 1e7
G0, EARTH_M = 9.80665, 6_371_000.0
GAP_S = 2.0

# Common state.
PRIMARY, IS_ARMED, LAT0, LON0, ALT0, BARO0, HAVE_FIX, HAVE_BARO, Q_T, LOST_US, AGREE_T, SAID = (
    range(12)
)
Q0 = 12
_COMMON = 16
# Lane state.
V, X, Q, BG, BA = 0, 3, 6, 10, 13
LAST_T, READY, SCORE, R_V, R_P, R_H, SUM, LEFT_T, DT, FSUM = range(16, 26)
ALT_T, ALT, DOWN, PASS_T, AGREED_T, HIGH_T, ACC = 28, 29, 30, 31, 32, 33, 34
GYRO_LAST, ACC_LAST, BEGUN_T, DIFFERS = 37, 40, 43, 44
_LANE = 45


class ArduPilotImus:
    """State of EKF3's lanes and of the comparison before arming."""

    def __init__(self) -> None:
        self.common = np.zeros(_COMMON)
        self.common[Q_T] = -np.inf
        self.lanes = np.zeros((5, _LANE))
        self.lanes[:, [LEFT_T, LAST_T, ALT_T]] = -np.inf
        self.P = np.zeros((LANES, N_X, N_X))

    @property
    def lost_s(self) -> float:
        """For how long both lanes disagreed with the references, so that none was chosen [s]."""
        return float(self.common[LOST_US] * 1e-6)

    def step(self, t_us: NDArray[np.int64], kind: NDArray[np.int64], value: Array) -> Array:
        """Use events in time order.

        Parameters
        ----------
        t_us, kind : (n,) int64
            Time [us] and kind.
        value : (n, 6) float64
            Values of the kind.

        Returns
        -------
        (m, 5) float64
            Time [us], SWITCHED and the new lane, its predecessor's score, its own; or INCONSISTENT
            and the IMU, its differences [m/s^2, rad/s].
        """
        out = np.empty((1000, 5))
        n = run_lanes(self.common, self.lanes, self.P, t_us, kind, value, out)
        return out[:n].copy()


@kernel
def run_lanes(
    c: Array,
    lanes: Array,
    P: Array,
    t_us: NDArray[np.int64],
    kind: NDArray[np.int64],
    value: Array,
    out: Array,
) -> int:
    """Advance over events; return how many rows of ``out`` were written (see ``step``)."""
    c[SAID] = 0.0
    R = np.empty((3, 3))
    for i in range(len(t_us)):
        t, k, v = float(t_us[i]), kind[i], value[i]
        if k < FIX:
            if c[IS_ARMED] < 0.5:
                _compare(c, lanes, t, k, v, out)
            if k < LANES:
                _inertial(lanes[k], P[k], R, t, v)
                if k == int(c[PRIMARY]) and c[IS_ARMED] > 0.5:
                    _choose(c, lanes, t, out)
            lanes[k, LAST_T] = t
            for j in range(6):
                lanes[k, GYRO_LAST + j] = v[j]
        elif k == FIX:
            if v[5] >= 3.0 and np.isfinite(v[0]):
                if c[HAVE_FIX] < 0.5:
                    c[LAT0], c[LON0], c[ALT0], c[HAVE_FIX] = v[2], v[3], v[4], 1.0
                for j in range(LANES):
                    if lanes[j, READY] > 0.5:
                        _gps(c, lanes[j], P[j], t, v)
                    else:
                        _begin(c, lanes[j], P[j], t, v)
        elif k == BARO:
            if c[HAVE_BARO] < 0.5 and c[HAVE_FIX] > 0.5:
                c[BARO0], c[HAVE_BARO] = v[0] - _height(c, lanes), 1.0
            if c[HAVE_BARO] > 0.5:
                for j in range(LANES):
                    if lanes[j, READY] > 0.5:
                        _baro(lanes[j], P[j], c[BARO0] - v[0])
        elif k == HEADING:
            c[Q_T] = t
            for j in range(4):
                c[Q0 + j] = v[j]
            for j in range(LANES):
                if lanes[j, READY] > 0.5:
                    _heading(c, lanes[j], P[j])
        else:
            c[IS_ARMED] = v[0]
    return int(c[SAID])


@kernel
def _height(c: Array, lanes: Array) -> float:
    """Height of the first lane above the first fix [m]."""
    return -lanes[0, X + 2] if lanes[0, READY] > 0.5 else 0.0


@kernel
def _place(c: Array, v: Array) -> tuple[float, float, float]:
    """The fix as N, E, D from the first fix [m]."""
    north, east = (v[2] - c[LAT0]) * EARTH_M, (v[3] - c[LON0]) * EARTH_M * np.cos(c[LAT0])
    return north, east, c[ALT0] - v[4]


@kernel
def _begin(c: Array, s: Array, P: Array, t: float, v: Array) -> None:
    """Begin a lane at a fix with the published attitude."""
    if t - c[Q_T] > 1e6 or t - s[LAST_T] > 1e6:
        return
    s[READY], s[V], s[V + 1], s[V + 2] = 1.0, v[0], v[1], 0.0
    s[X], s[X + 1], s[X + 2] = _place(c, v)
    for j in range(4):
        s[Q + j] = c[Q0 + j]
    s[PASS_T] = s[HIGH_T] = s[BEGUN_T] = t
    s[ALT_T], s[SUM], s[SCORE], s[R_H] = -np.inf, 0.0, 0.0, 0.0
    s[DT] = 0.0
    for j in range(N_X):
        for m in range(N_X):
            P[j, m] = 0.0
    for j in range(3):
        s[BG + j] = s[BA + j] = s[FSUM + j] = 0.0
        P[VEL + j, VEL + j], P[POS + j, POS + j] = VEL_VAR, 1.0
        P[ANGLE + j, ANGLE + j] = 0.02**2
        P[GYRO_BIAS + j, GYRO_BIAS + j] = BIAS_STD[0] ** 2
        P[ACC_BIAS + j, ACC_BIAS + j] = BIAS_STD[1] ** 2


@kernel
def _rotation(s: Array, R: Array) -> None:
    """The matrix of the lane's q, ned_from_frd."""
    w, x, y, z = s[Q], s[Q + 1], s[Q + 2], s[Q + 3]
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@kernel
def _turn(s: Array, a: float, b: float, c: float, sign: float) -> None:
    """Turn the lane's q by a small rotation vector: in body axes (sign 1) or in NED (-1)."""
    h = sqrt(a * a + b * b + c * c)
    f = 0.5 - h * h / 48.0
    w, x, y, z = 1.0 - h * h / 8.0, a * f, b * f, c * f
    p, i, j, k = s[Q], s[Q + 1], s[Q + 2], s[Q + 3]
    s[Q] = p * w - i * x - j * y - k * z
    s[Q + 1] = p * x + i * w + sign * (j * z - k * y)
    s[Q + 2] = p * y + j * w + sign * (k * x - i * z)
    s[Q + 3] = p * z + k * w + sign * (i * y - j * x)
    norm = sqrt(s[Q] ** 2 + s[Q + 1] ** 2 + s[Q + 2] ** 2 + s[Q + 3] ** 2)
    for m in range(4):
        s[Q + m] /= norm


@kernel
def _inertial(s: Array, P: Array, R: Array, t: float, u: Array) -> None:
    """Carry a lane forward by one IMU sample: q, v, p, and P every COVARIANCE_S; R is room."""
    dt = (t - s[LAST_T]) * 1e-6
    if s[READY] < 0.5 or not dt > 0.0:
        return
    if dt > GAP_S:
        s[READY] = 0.0
        return
    _turn(s, dt * (u[0] - s[BG]), dt * (u[1] - s[BG + 1]), dt * (u[2] - s[BG + 2]), 1.0)
    _rotation(s, R)
    for j in range(3):
        f = 0.0
        for m in range(3):
            f += R[j, m] * (u[3 + m] - s[BA + m])
        a = f + (G0 if j == 2 else 0.0)
        s[X + j] += dt * (s[V + j] + 0.5 * dt * a)
        s[V + j] += dt * a
        s[FSUM + j] += f * dt
        s[ACC + j] += min(dt / ACC_LAG_S, 1.0) * (a - s[ACC + j])
    s[DT] += dt
    if s[DT] >= COVARIANCE_S:
        _covariance(s, P, R)


@kernel
def _carry(s: Array, P: Array, R: Array, out: Array) -> None:
    """Write (F P)' into ``out``, F of the time and the specific force summed in the lane."""
    T, fn, fe, fd = s[DT], s[FSUM], s[FSUM + 1], s[FSUM + 2]
    for m in range(N_X):
        a, b, c = P[ANGLE, m], P[ANGLE + 1, m], P[ANGLE + 2, m]
        out[m, VEL] = P[VEL, m] + fd * b - fe * c
        out[m, VEL + 1] = P[VEL + 1, m] - fd * a + fn * c
        out[m, VEL + 2] = P[VEL + 2, m] + fe * a - fn * b
        for j in range(3):
            acc = gyro = 0.0
            for k in range(3):
                acc += R[j, k] * P[ACC_BIAS + k, m]
                gyro += R[j, k] * P[GYRO_BIAS + k, m]
            out[m, VEL + j] -= T * acc
            out[m, ANGLE + j] = P[ANGLE + j, m] - T * gyro
            out[m, POS + j] = P[POS + j, m] + T * P[VEL + j, m]
            out[m, GYRO_BIAS + j] = P[GYRO_BIAS + j, m]
            out[m, ACC_BIAS + j] = P[ACC_BIAS + j, m]


@kernel
def _covariance(s: Array, P: Array, R: Array) -> None:
    """P = F P F' + Q over the time since the last call."""
    T = s[DT]
    if T <= 0.0:
        return
    half = np.empty((N_X, N_X))
    _carry(s, P, R, half)
    _carry(s, half, R, P)
    for j in range(3):
        P[VEL + j, VEL + j] += ACC_PSD * T
        P[ANGLE + j, ANGLE + j] += GYRO_PSD * T
        P[GYRO_BIAS + j, GYRO_BIAS + j] += GYRO_BIAS_PSD * T
        P[ACC_BIAS + j, ACC_BIAS + j] += ACC_BIAS_PSD * T
        s[FSUM + j] = 0.0
    s[DT] = 0.0


@kernel
def _update(s: Array, P: Array, row: int, nu: float, R: float) -> None:
    """Correct a lane by one measured component of x; nu = measured minus predicted."""
    S = P[row, row] + R
    full, K = np.empty(N_X), np.empty(N_X)
    for j in range(N_X):
        full[j] = K[j] = P[j, row] / S
    if abs(2.0 * (s[Q + 1] * s[Q + 3] - s[Q] * s[Q + 2])) < LEVEL_COSINE:
        K[ACC_BIAS] = 0.0
    if abs(2.0 * (s[Q + 2] * s[Q + 3] + s[Q] * s[Q + 1])) < LEVEL_COSINE:
        K[ACC_BIAS + 1] = 0.0
    for j in range(N_X):
        for m in range(N_X):
            P[j, m] -= S * (K[j] * full[m] + full[j] * K[m] - K[j] * K[m])
    for j in range(3):
        s[V + j] += K[VEL + j] * nu
        s[X + j] += K[POS + j] * nu
        s[BG + j] += K[GYRO_BIAS + j] * nu
        s[BA + j] += K[ACC_BIAS + j] * nu
    _turn(s, K[ANGLE] * nu, K[ANGLE + 1] * nu, K[ANGLE + 2] * nu, -1.0)


@kernel
def _gps(c: Array, s: Array, P: Array, t: float, v: Array) -> None:
    """Test and fuse a fix: velocity with the climb since the last fix, then position."""
    R = np.empty((3, 3))
    _rotation(s, R)
    _covariance(s, P, R)
    p = _place(c, v)
    acc_2 = s[ACC] ** 2 + s[ACC + 1] ** 2 + s[ACC + 2] ** 2
    check = VEL_VAR + MANOEUVRE**2 * acc_2
    check_d = VEL_D_VAR + MANOEUVRE_D**2 * acc_2
    nu_n, nu_e = v[0] - s[V], v[1] - s[V + 1]
    total = nu_n * nu_n + nu_e * nu_e
    S = P[VEL, VEL] + P[VEL + 1, VEL + 1] + 2.0 * check
    nu_d, climb = 0.0, False
    dt = (t - s[ALT_T]) * 1e-6
    if 0.0 < dt < 1.0:
        climb = True
        nu_d = (p[2] - s[ALT] - (s[X + 2] - s[DOWN])) / dt
        total += nu_d * nu_d
        S += P[VEL + 2, VEL + 2] + check
    s[R_V] = total / (GATE * GATE * S)
    d_n, d_e = p[0] - s[X], p[1] - s[X + 1]
    S = P[POS, POS] + P[POS + 1, POS + 1] + 2.0 * POS_VAR
    s[R_P] = (d_n * d_n + d_e * d_e) / (GATE * GATE * S)
    if s[R_V] < 1.0:
        for j in range(2):
            _update(s, P, VEL + j, v[j] - s[V + j], check)
        if climb:
            _update(s, P, VEL + 2, nu_d, check_d)
    if s[R_P] < 1.0:
        for j in range(2):
            _update(s, P, POS + j, p[j] - s[X + j], POS_VAR)
    if s[R_V] < 1.0 and s[R_P] < 1.0:
        s[PASS_T] = t
    elif t - s[PASS_T] > RETRY_US:
        s[V], s[V + 1] = v[0], v[1]
        if climb:
            s[V + 2] += nu_d
        s[X], s[X + 1] = p[0], p[1]
        s[PASS_T], s[R_V], s[R_P] = t, 0.0, 0.0
    s[ALT_T], s[ALT], s[DOWN] = t, p[2], s[X + 2]
    s[SCORE] = max(0.5 * (s[R_V] + s[R_P]), s[R_H])


@kernel
def _baro(s: Array, P: Array, down: float) -> None:
    """Test and fuse a barometric height, given as D [m]."""
    nu = down - s[X + 2]
    s[R_H] = nu * nu / (GATE * GATE * (P[POS + 2, POS + 2] + HEIGHT_VAR))
    was = s[X + 2]
    if s[R_H] < 1.0:
        _update(s, P, POS + 2, nu, HEIGHT_VAR)
        s[HIGH_T] = s[LAST_T]
    elif s[LAST_T] - s[HIGH_T] > RETRY_US:
        s[X + 2], s[HIGH_T], s[R_H] = down, s[LAST_T], 0.0
    s[DOWN] += s[X + 2] - was
    s[SCORE] = max(0.5 * (s[R_V] + s[R_P]), s[R_H])


@kernel
def _yaw(s: Array, at: int) -> float:
    """Heading of the quaternion that stands at a place of a state vector [rad]."""
    w, x, y, z = s[at], s[at + 1], s[at + 2], s[at + 3]
    return float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))


@kernel
def _heading(c: Array, s: Array, P: Array) -> None:
    """Fuse the published heading."""
    nu = _yaw(c, Q0) - _yaw(s, Q)
    nu = (nu + np.pi) % (2.0 * np.pi) - np.pi
    _update(s, P, ANGLE + 2, nu, YAW_VAR)


@kernel
def _choose(c: Array, lanes: Array, t: float, out: Array) -> None:
    """One turn of the choice between lanes, at an IMU sample of the primary."""
    k = int(c[PRIMARY])
    j = 1 - k
    s, other = lanes[k], lanes[j]
    dt_us = min(t - s[LAST_T], 1e5)
    if t - other[LAST_T] > 1e6:
        return
    settled = t - max(s[BEGUN_T], other[BEGUN_T]) > SETTLE_US
    if s[READY] < 0.5 or other[READY] < 0.5 or not settled:
        c[LOST_US] += dt_us
        c[AGREE_T] = t
        return
    if min(s[SCORE], other[SCORE]) > BETTER_BY:
        if t - c[AGREE_T] > LOST_AFTER_US:
            s[READY] = other[READY] = 0.0
        return
    c[AGREE_T] = t
    error = other[SCORE] - s[SCORE]
    if error > 0.0 or error < -BETTER_BY:
        other[SUM] += error * LOOP_HZ * dt_us * 1e-6
        other[SUM] = min(max(other[SUM], -SUM_MAX), SUM_MAX)
    if other[SUM] >= 0.0 or t - other[LEFT_T] <= AWAY_US:
        return
    if s[SCORE] > 1.0 or other[SUM] <= -BETTER_SUM:
        _say(c, t, SWITCHED, j, s[SCORE], other[SCORE], out)
        s[LEFT_T] = t
        s[SUM] = other[SUM] = 0.0
        c[PRIMARY] = j


@kernel
def _say(c: Array, t: float, what: float, k: int, a: float, b: float, out: Array) -> None:
    n = int(c[SAID])
    if n < len(out):
        out[n, 0], out[n, 1], out[n, 2], out[n, 3], out[n, 4] = t, what, k, a, b
        c[SAID] += 1.0


@kernel
def _compare(c: Array, lanes: Array, t: float, k: int, u: Array, out: Array) -> None:
    """Compare an IMU with the first one, before arming."""
    if k == 0 or t - lanes[0, LAST_T] > 1e6:
        return
    rate = force = 0.0
    for m in range(3):
        rate += (u[m] - lanes[0, GYRO_LAST + m]) ** 2
        force += (u[3 + m] - lanes[0, ACC_LAST + m]) ** 2
    rate, force = sqrt(rate), sqrt(force)
    if force > ACC_DIFFER or rate > GYRO_DIFFER:
        lanes[k, AGREED_T] = t
        if lanes[k, DIFFERS] < 0.5:
            _say(c, t, INCONSISTENT, k, force, rate, out)
        lanes[k, DIFFERS] = 1.0
    elif t - lanes[k, AGREED_T] > AGREE_US:
        lanes[k, DIFFERS] = 0.0
