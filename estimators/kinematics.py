"""The two kinematic models of a flying IMU: against the turning earth, and against the air.

==========  =================================================  =======  ============  ==========
symbol      meaning                                            shape    unit          lu2016
==========  =================================================  =======  ============  ==========
x (GS)      [U_N U_E U_D phi theta psi], ground velocity NED   (6,)     m/s, rad      (4)
x (AS)      [u_a v_a w_a phi theta psi], air velocity FRD      (6,)     m/s, rad      (15)
u           [A_x A_y A_z p q r], specific force and body       (6,)     m/s^2, rad/s  (5), (6)
            rates, already freed of faults: ``u_m - f``
f(x, u)     rates of change of x                               (6,)     per second    (11), (18)
F           Jacobian of f with respect to x                    (6, 6)                 (34)
G           noise *and* fault distribution matrix; carries     (6, 6)                 (13), (19)
            the minus of ``u_m - f``, so G = -df/du
h(x)        outputs: x itself (GS); [V alpha beta phi theta    (6,)     m/s, rad      (14), (20)
            psi], alpha = atan2(w_a, u_a),
            beta = asin(v_a / V) (AS)
H           Jacobian of h                                      (6, 6)                 (35)
earth       (g, R_e + h, sin delta, cos delta) at latitude     4        m/s^2, m, 1   (12)
            delta, altitude h; from :func:`earth_terms`
==========  =================================================  =======  ============  ==========

The airspeed model knows neither the earth's rotation nor wind that changes: what the wind's change
adds to the body's acceleration looks exactly like an accelerometer fault, lu2016 (29).

Differs: the printed last row of (11) adds ``(U_E/(R_e + h) + Omega cos delta) tan(theta)
cos(psi)``; the kinematics of a rotation need it subtracted, as the row for phi has it. With the
printed sign a heading drifts 0.06 deg in 90 s.

All functions are kernels that write into their last arguments and allocate nothing. `model` is
:data:`GS` or :data:`AS`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.atmosphere import EARTH_RADIUS_M, EARTH_RATE_RAD_S, gravity
from estimators.jit import kernel

__all__ = [
    "ACC",
    "ANGLES",
    "AS",
    "GS",
    "GYRO",
    "VELOCITY",
    "earth_terms",
    "linearise",
    "output",
    "output_jacobian",
    "rates",
    "state_from_output",
]

Array = NDArray[np.float64]
Earth = tuple[float, float, float, float]

GS, AS = 0, 1
"""Which kinematic model: ground speed or airspeed."""

VELOCITY, ANGLES = slice(0, 3), slice(3, 6)
"""Parts of x and y."""

ACC, GYRO = slice(0, 3), slice(3, 6)
"""Parts of u and f."""


@kernel
def earth_terms(latitude_rad: float, altitude_m: float) -> Earth:
    """Gravity, distance from the earth's centre, sine and cosine of the latitude.

    Source: lu2016 eq. (12) and the constants below (11).
    """
    return (
        gravity(latitude_rad, altitude_m),
        EARTH_RADIUS_M + altitude_m,
        math.sin(latitude_rad),
        math.cos(latitude_rad),
    )


@kernel
def rates(model: int, x: Array, u: Array, earth: Earth, dx: Array) -> None:
    """Rates of change of the state.

    Parameters
    ----------
    model : int
    x : (6,) float64 [m/s, rad]
    u : (6,) float64 [m/s^2, rad/s]
        Input freed of faults.
    earth : 4 floats
    dx : (6,) float64 [m/s^2, rad/s]
        Receives f(x, u).

    Source: lu2016 eq. (11) with the corrected sign, (18) without the noise.
    """
    g, radius, sd, cd = earth
    p, q, r = u[3], u[4], u[5]
    sp, cp = math.sin(x[3]), math.cos(x[3])
    st, ct = math.sin(x[4]), math.cos(x[4])
    pitch_rate = q * cp - r * sp
    yaw_rate = (q * sp + r * cp) / ct
    dx[3] = p + yaw_rate * st
    dx[4] = pitch_rate
    dx[5] = yaw_rate
    if model == AS:
        dx[0] = u[0] + x[1] * r - x[2] * q - g * st
        dx[1] = u[1] - x[0] * r + x[2] * p + g * ct * sp
        dx[2] = u[2] + x[0] * q - x[1] * p + g * ct * cp
        return
    ss, cs = math.sin(x[5]), math.cos(x[5])
    UN, UE, UD = x[0], x[1], x[2]
    # specific force, first into the plane of the heading, then to the north and east
    side = sp * u[1] + cp * u[2]
    ahead = ct * u[0] + st * side
    right = cp * u[1] - sp * u[2]
    td = sd / cd
    omega2 = 2.0 * EARTH_RATE_RAD_S
    dx[0] = cs * ahead - ss * right + (UN * UD - UE * UE * td) / radius - omega2 * UE * sd
    dx[1] = ss * ahead + cs * right + UE * (UN * td + UD) / radius + omega2 * (UN * sd + UD * cd)
    dx[2] = -st * u[0] + ct * side - (UN * UN + UE * UE) / radius - omega2 * UE * cd + g
    # rate of the local level frame: w_n to the north, -w_e to the east, -w_d down
    w_n = UE / radius + EARTH_RATE_RAD_S * cd
    w_e = UN / radius
    w_d = UE * td / radius + EARTH_RATE_RAD_S * sd
    turn = (w_e * ss - w_n * cs) / ct
    dx[3] += turn
    dx[4] += w_n * ss + w_e * cs
    dx[5] += turn * st + w_d


@kernel
def linearise(model: int, x: Array, u: Array, earth: Earth, F: Array, G: Array) -> None:
    """Jacobian of the rates and distribution matrix of noise and faults.

    Parameters
    ----------
    model : int
    x : (6,) float64 [m/s, rad]
    u : (6,) float64 [m/s^2, rad/s]
        Input freed of faults.
    earth : 4 floats
    F : (6, 6) float64
        Receives df/dx.
    G : (6, 6) float64
        Receives -df/du.

    Source: lu2016 eq. (34), (13), (19).
    """
    g, radius, sd, cd = earth
    sp, cp = math.sin(x[3]), math.cos(x[3])
    st, ct = math.sin(x[4]), math.cos(x[4])
    tt = st / ct
    Ax, Ay, Az, p, q, r = u[0], u[1], u[2], u[3], u[4], u[5]
    pitch_rate = q * cp - r * sp
    side_rate = q * sp + r * cp

    for i in range(6):
        for j in range(6):
            F[i, j] = 0.0
            G[i, j] = 0.0
    F[3, 3] = pitch_rate * tt
    F[3, 4] = side_rate / (ct * ct)
    F[4, 3] = -side_rate
    F[5, 3] = pitch_rate / ct
    F[5, 4] = side_rate * st / (ct * ct)
    G[3, 3], G[3, 4], G[3, 5] = -1.0, -sp * tt, -cp * tt
    G[4, 4], G[4, 5] = -cp, sp
    G[5, 4], G[5, 5] = -sp / ct, -cp / ct

    if model == AS:
        F[0, 1], F[0, 2] = r, -q
        F[1, 0], F[1, 2] = -r, p
        F[2, 0], F[2, 1] = q, -p
        F[0, 4] = -g * ct
        F[1, 3], F[1, 4] = g * ct * cp, -g * st * sp
        F[2, 3], F[2, 4] = -g * ct * sp, -g * st * cp
        G[0, 0] = G[1, 1] = G[2, 2] = -1.0
        G[0, 4], G[0, 5] = x[2], -x[1]
        G[1, 3], G[1, 5] = -x[2], x[0]
        G[2, 3], G[2, 4] = x[1], -x[0]
        return

    ss, cs = math.sin(x[5]), math.cos(x[5])
    UN, UE, UD = x[0], x[1], x[2]
    td = sd / cd
    omega2 = 2.0 * EARTH_RATE_RAD_S
    G[0, 0], G[0, 1], G[0, 2] = -ct * cs, cp * ss - sp * st * cs, -sp * ss - cp * st * cs
    G[1, 0], G[1, 1], G[1, 2] = -ct * ss, -cp * cs - sp * st * ss, sp * cs - cp * st * ss
    G[2, 0], G[2, 1], G[2, 2] = st, -sp * ct, -cp * ct
    side = sp * Ay + cp * Az
    dip = ct * side - st * Ax
    for i in range(3):
        F[i, 3] = Az * G[i, 1] - Ay * G[i, 2]
    F[0, 4], F[1, 4], F[2, 4] = dip * cs, dip * ss, -ct * Ax - st * side
    F[0, 5] = Ax * G[1, 0] + Ay * G[1, 1] + Az * G[1, 2]
    F[1, 5] = -(Ax * G[0, 0] + Ay * G[0, 1] + Az * G[0, 2])
    F[0, 0], F[0, 1], F[0, 2] = UD / radius, -2.0 * UE * td / radius - omega2 * sd, UN / radius
    F[1, 0] = UE * td / radius + omega2 * sd
    F[1, 1] = (UN * td + UD) / radius
    F[1, 2] = UE / radius + omega2 * cd
    F[2, 0], F[2, 1] = -2.0 * UN / radius, -2.0 * UE / radius - omega2 * cd

    w_n = UE / radius + EARTH_RATE_RAD_S * cd
    w_e = UN / radius
    across, along = w_e * ss - w_n * cs, w_e * cs + w_n * ss
    F[3, 0], F[3, 1] = ss / (radius * ct), -cs / (radius * ct)
    F[4, 0], F[4, 1] = cs / radius, ss / radius
    F[5, 0], F[5, 1] = tt * ss / radius, (td - tt * cs) / radius
    F[3, 4] += across * st / (ct * ct)
    F[3, 5] = along / ct
    F[4, 5] = -across
    F[5, 4] += across / (ct * ct)
    F[5, 5] = along * tt


@kernel
def output(model: int, x: Array, y: Array) -> None:
    """What the measurements of a state would be.

    Parameters
    ----------
    model : int
    x : (6,) float64 [m/s, rad]
    y : (6,) float64 [m/s, rad]
        Receives h(x).

    Source: lu2016 eq. (14), (20).
    """
    for i in range(6):
        y[i] = x[i]
    if model == AS:
        V = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        y[0], y[1], y[2] = V, math.atan2(x[2], x[0]), math.asin(x[1] / V)


@kernel
def output_jacobian(model: int, x: Array, H: Array) -> None:
    """Jacobian of the outputs; the identity for the ground-speed model.

    Parameters
    ----------
    model : int
    x : (6,) float64 [m/s, rad]
    H : (6, 6) float64
        Receives dh/dx.

    Source: lu2016 eq. (35).
    """
    for i in range(6):
        for j in range(6):
            H[i, j] = 0.0
        H[i, i] = 1.0
    if model == AS:
        ua, va, wa = x[0], x[1], x[2]
        plane2 = ua * ua + wa * wa
        plane = math.sqrt(plane2)
        V2 = plane2 + va * va
        V = math.sqrt(V2)
        H[0, 0], H[0, 1], H[0, 2] = ua / V, va / V, wa / V
        H[1, 0], H[1, 1], H[1, 2] = -wa / plane2, 0.0, ua / plane2
        H[2, 0], H[2, 1], H[2, 2] = -ua * va / (V2 * plane), plane / V2, -va * wa / (V2 * plane)


@kernel
def state_from_output(model: int, y: Array, x: Array) -> None:
    """The state that has these outputs: the inverse of :func:`output`.

    Parameters
    ----------
    model : int
    y : (6,) float64 [m/s, rad]
    x : (6,) float64 [m/s, rad]
        Receives the state.
    """
    for i in range(6):
        x[i] = y[i]
    if model == AS:
        x[0] = y[0] * math.cos(y[1]) * math.cos(y[2])
        x[1] = y[0] * math.sin(y[2])
        x[2] = y[0] * math.sin(y[1]) * math.cos(y[2])
