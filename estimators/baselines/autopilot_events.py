"""One list of events for all that imitates an autopilot, and the wind filter both autopilots have.

The airspeed checks of ArduPilot and PX4 look at the same few quantities, so they read the same
table: a time, a kind, and up to four values.

=========== =====================================================================
kind        values
=========== =====================================================================
AIRSPEED+i  calibrated airspeed of pitot i [m/s]
GPS         V_N, V_E [m/s], fix type
NAV         V_N, V_E, V_D of the autopilot's own navigation [m/s]
ATTITUDE    quaternion ned_from_frd, scalar first
DENSITY     true airspeed / calibrated airspeed
FLYING      1 from take-off to landing, else 0
PARAMETER   index, value
=========== =====================================================================

The wind filter estimates the horizontal wind from the ground velocity, one airspeed and the
supposition that the aircraft does not slip:

======== ============================================ ======= ======
symbol   meaning                                      shape   unit
======== ============================================ ======= ======
W        wind N, E                                    (2,)    m/s
P        its covariance, as nn, ne, ee                (3,)    m^2/s^2
V        velocity over ground N, E, D                 (3,)    m/s
q        growth of the wind's variance                        m^2/s^3
R_V      variance of the ground velocity                      m^2/s^2
h_tas    sqrt((V_N - W_N)^2 + (V_E - W_E)^2 + V_D^2)          m/s
h_beta   right / forward component of V - W                   rad
======== ============================================ ======= ======

EKF3 keeps W as two of its 24 states, PX4 as two of the three of its wind estimator. Both move the
wind slowly and believe an airspeed whose innovation passes the gate, which is why a false airspeed
below the gate ends up in the wind.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "AIRSPEED",
    "ATTITUDE",
    "DENSITY",
    "FIX",
    "FLYING",
    "FRESH_US",
    "GPS",
    "GPS_T",
    "IN_FLIGHT",
    "NAV",
    "NAV_T",
    "PARAMETER",
    "PITOTS",
    "Q_T",
    "RHO",
    "SAID",
    "SHARED",
    "TICK",
    "TICK_US",
    "Q",
    "V",
    "begin_along_heading",
    "follow",
    "fuse_airspeed",
    "fuse_sideslip",
    "grow",
    "heading",
    "new_wind",
    "next_tick",
]

Array = NDArray[np.float64]

PITOTS = 3
AIRSPEED, GPS, NAV, ATTITUDE, DENSITY, FLYING, PARAMETER = 0, 3, 4, 5, 6, 7, 8
"""Kinds of events; the pitots take 0 to 2."""

W_N, W_E, P_NN, P_NE, P_EE, READY = range(6)
"""Wind filter."""

TICK, GPS_T, FIX, NAV_T, Q_T, RHO, IN_FLIGHT, SAID = range(8)
"""What every state vector begins with: the next look, what was heard and when, rows written."""
V, Q = slice(8, 11), slice(11, 15)
"""Ground velocity: the autopilot's own while it is fresh, else the receiver's; attitude."""
SHARED = 15
"""Elements of the common part."""

TICK_US = 100_000
"""Both autopilots look at their airspeeds ten times a second [us]."""
FRESH_US = 1_000_000
"""After this a value is no longer believed to be now [us]."""

VARIANCE_MAX = 400.0
"""Bound on a wind component's variance [m^2/s^2]."""


def new_wind() -> Array:
    """A wind filter that has not begun."""
    return np.zeros(6)


@kernel
def next_tick(t_us: int) -> int:
    """The first multiple of TICK_US after a time [us]."""
    return (t_us // TICK_US + 1) * TICK_US


@kernel
def follow(s: Array, t: float, k: int, v: Array) -> None:
    """Take an event of the common kinds into the common part of a state.

    Parameters
    ----------
    s : (SHARED or more,) float64
        Changed in place.
    t, k : float, int
        Time [us] and kind; pitots and parameters change nothing here.
    v : (4,) float64
        Values of the kind.
    """
    if k == GPS:
        s[GPS_T], s[FIX] = t, v[2]
        if not t - s[NAV_T] < FRESH_US:
            s[V][0], s[V][1], s[V][2] = v[0], v[1], 0.0
    elif k == NAV:
        s[NAV_T] = t
        s[V][:] = v[:3]
    elif k == ATTITUDE:
        s[Q_T] = t
        s[Q][:] = v
    elif k == DENSITY:
        s[RHO] = v[0]
    elif k == FLYING:
        s[IN_FLIGHT] = v[0]


@kernel
def heading(q: Array) -> float:
    """Heading of the quaternion ned_from_frd [rad]."""
    north = 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])
    return float(np.arctan2(2.0 * (q[1] * q[2] + q[0] * q[3]), north))


@kernel
def begin_along_heading(
    f: Array, V: Array, tas: float, psi: float, along_var: float, across_var: float
) -> None:
    """W = V - tas (cos psi, sin psi), sure along the heading, less so across it."""
    c, s = np.cos(psi), np.sin(psi)
    f[W_N], f[W_E] = V[0] - tas * c, V[1] - tas * s
    f[P_NN] = along_var * c * c + across_var * s * s
    f[P_NE] = (along_var - across_var) * c * s
    f[P_EE] = along_var * s * s + across_var * c * c
    f[READY] = 1.0


@kernel
def grow(f: Array, q: float, dt_s: float) -> None:
    """P += q dt, its variances bounded with their correlation kept."""
    nn, ee = f[P_NN] + q * dt_s, f[P_EE] + q * dt_s
    f[P_NN], f[P_EE] = min(nn, VARIANCE_MAX), min(ee, VARIANCE_MAX)
    if nn > VARIANCE_MAX or ee > VARIANCE_MAX:
        f[P_NE] *= sqrt((f[P_NN] / nn) * (f[P_EE] / ee))


@kernel
def _update(f: Array, h_n: float, h_e: float, nu: float, S: float) -> None:
    """W += K nu, P -= K H P with K = P H' / S."""
    a = f[P_NN] * h_n + f[P_NE] * h_e
    b = f[P_NE] * h_n + f[P_EE] * h_e
    f[W_N] += a / S * nu
    f[W_E] += b / S * nu
    f[P_NN] -= a * a / S
    f[P_NE] -= a * b / S
    f[P_EE] -= b * b / S


@kernel
def _spread(f: Array, h_n: float, h_e: float, R_V: float) -> float:
    """H P H' with the ground velocity's variance."""
    own: float = h_n * h_n * f[P_NN] + 2.0 * h_n * h_e * f[P_NE] + h_e * h_e * f[P_EE]
    return float(own + R_V * (h_n * h_n + h_e * h_e))


@kernel
def fuse_airspeed(
    f: Array, V: Array, tas: float, R: float, R_V: float, gate: float, use: bool
) -> tuple[float, float, bool]:
    """Compare a true airspeed with h_tas, and fuse it if it passes the gate and may be used.

    Parameters
    ----------
    f : (6,) float64
        Wind filter, changed in place.
    V : (3,) float64 [m/s]
        Ground velocity.
    tas, R, R_V : float [m/s, m^2/s^2, m^2/s^2]
        True airspeed, its variance, the ground velocity's.
    gate : float
        Standard deviations of the innovation beyond which it is not fused.
    use : bool
        False only compares.

    Returns
    -------
    tuple
        Innovation [m/s], its variance, whether it passed the gate.
    """
    d_n, d_e = V[0] - f[W_N], V[1] - f[W_E]
    n = sqrt(d_n * d_n + d_e * d_e + V[2] * V[2])
    if n < 1.0:
        return 0.0, 0.0, True
    h_n, h_e = -d_n / n, -d_e / n
    nu = tas - n
    S = R + _spread(f, h_n, h_e, R_V)
    passed = nu * nu < gate * gate * S
    if use and passed:
        _update(f, h_n, h_e, nu, S)
    return nu, S, passed


@kernel
def fuse_sideslip(
    f: Array, V: Array, q: Array, R: float, R_V: float, gate: float, beta_max: float
) -> None:
    """Fuse a sideslip of zero, unless it lies outside ``gate`` sigmas or ``beta_max`` [rad]."""
    d_n, d_e = V[0] - f[W_N], V[1] - f[W_E]
    f_n = 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])
    f_e = 2.0 * (q[1] * q[2] + q[0] * q[3])
    f_d = 2.0 * (q[1] * q[3] - q[0] * q[2])
    r_n = 2.0 * (q[1] * q[2] - q[0] * q[3])
    r_e = 1.0 - 2.0 * (q[1] * q[1] + q[3] * q[3])
    r_d = 2.0 * (q[2] * q[3] + q[0] * q[1])
    forward = f_n * d_n + f_e * d_e + f_d * V[2]
    right = r_n * d_n + r_e * d_e + r_d * V[2]
    if forward < 5.0:
        return
    beta = right / forward
    h_n = (beta * f_n - r_n) / forward
    h_e = (beta * f_e - r_e) / forward
    S = R + _spread(f, h_n, h_e, R_V)
    if abs(beta) < beta_max and beta * beta < gate * gate * S:
        _update(f, h_n, h_e, -beta, S)
