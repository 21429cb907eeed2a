"""Longitudinal air data models of wan2018: motion, outputs, Jacobians; approximate and exact.

=============  =====================================================  ========  ==================
symbol         meaning                                                unit      wan2018
=============  =====================================================  ========  ==================
x              [alpha, V_g, W_x, W_z]: angle of attack, inertial      rad, m/s  (22)
               speed in the vertical plane, wind (north, down)
u              [u_alpha, u_v, u_wx, u_wz], noise in their rates       rad/s,    (1)
                                                                      m/s^2
theta          [V_g, theta, q, A_x, A_z, z]: measured parameters,     m/s, rad, (2)
               A specific force (FRD), z altitude                     m/s^2, m
air            [1 / (5 gamma R T), p / p_0] of the air outside        s^2/m^2   (16)
y              [V_g, V_z, alpha, V_c], V_z down, V_c calibrated       m/s, rad  (20d)
s, c           sin and cos of alpha - theta
a, b           W_x c + W_z s,  W_x s - W_z c: wind along the flight   m/s       (10)
               and across it
V_t            true airspeed, -a + sqrt(V_g^2 - b^2)                  m/s       (10)
alpha_g        inertial flow angle, alpha - asin(b / V_g)             rad
f_alpha, f_v   specific force and gravity across and along            m/s^2     (8)-(9)
k              dV_c / dV_t                                                      (16)
=============  =====================================================  ========  ==================

The wind blows toward north and down when positive. ``APPROXIMATE`` is (13)-(16); ``EXACT`` keeps
(8)-(10) whole. In both V_g enters as the measured parameter (Remark 1), so dF_1/dV_g and
dh/dV_g vanish but for V_g's own rows.

Differs: (15) printed -V_g s + W_z for a climb rate; from (6) and (10) the *descent* rate is
V_t s + W_z, which is used. (13)-(14) are exact for alpha_g, so the exact model moves V_g with
f_v(alpha_g) and keeps the wind's own rate in alpha.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.atmosphere import P0_PA, pressure, temperature
from estimators.jit import kernel

__all__ = [
    "ALPHA",
    "APPROXIMATE",
    "EXACT",
    "NU",
    "NX",
    "NY",
    "VC",
    "VG",
    "VZ",
    "WX",
    "WZ",
    "Y_ALPHA",
    "Y_VG",
    "air_outside",
    "linearise",
]

Array = NDArray[np.float64]

APPROXIMATE = 0
EXACT = 1

NX = NU = NY = 4
ALPHA, VG, WX, WZ = 0, 1, 2, 3
Y_VG, VZ, Y_ALPHA, VC = 0, 1, 2, 3

G0_M_S2 = 9.80665  # standard gravity, as in wan2018 (5)
FIVE_GAMMA_R = 5.0 * 1.4 * 287.05287  # wan2018 below (16), m^2/(s^2 K)
FIVE_A0_SQ = FIVE_GAMMA_R * 288.15  # 5 a_0^2, m^2/s^2


@kernel
def air_outside(altitude_m: float, warmer_k: float, air: Array) -> None:
    """Write what (16) needs of the air at a pressure altitude.

    Parameters
    ----------
    altitude_m : float
        Pressure altitude [m].
    warmer_k : float
        Measured minus standard temperature [K]; 0 when there is no thermometer, which costs 3.4 m/s
        of airspeed per 10 K, and the wind estimate takes it.
    air : (2,) float64, written
        [1 / (5 gamma R T) [s^2/m^2], p / p_0].
    """
    air[0] = 1.0 / (FIVE_GAMMA_R * (temperature(altitude_m) + warmer_k))
    air[1] = pressure(altitude_m) / P0_PA


@kernel
def linearise(
    model: int,
    x: Array,
    u: Array,
    theta: Array,
    air: Array,
    t_s: float,
    F: Array,
    A: Array,
    B: Array,
    h: Array,
    C: Array,
) -> None:
    """Write the next state, the outputs and their Jacobians at (x, u).

    Parameters
    ----------
    model : int
        APPROXIMATE or EXACT.
    x, u : (4,) float64 [rad, m/s], [rad/s, m/s^2]
    theta : (6,) float64, air : (2,) float64
        Measured parameters and :func:`air_outside`.
    t_s : float
        Sampling interval [s].
    F, h : (4,) float64, written
        Next state (20a)-(20c) and outputs (20d).
    A, B, C : (4, 4) float64, written
        dF/dx, dF/du, dh/dx; A and B must come with unit and t_s-diagonal structure or zeros:
        every entry that can be non-zero is written.

    Source: wan2018 (8)-(11), (13)-(16), (20), (23).
    """
    V_g = theta[0]
    alpha = x[0]
    W_x = x[2]
    W_z = x[3]
    s = math.sin(alpha - theta[1])
    c = math.cos(alpha - theta[1])
    s_a = math.sin(alpha)
    c_a = math.cos(alpha)
    f_alpha = -theta[3] * s_a + theta[4] * c_a + G0_M_S2 * c
    f_v = theta[3] * c_a + theta[4] * s_a + G0_M_S2 * s
    a = W_x * c + W_z * s
    b = W_x * s - W_z * c

    for j in range(4):
        for i in range(4):
            A[i, j] = 0.0
            B[i, j] = 0.0
            C[i, j] = 0.0
        A[j, j] = 1.0
        B[j, j] = t_s
        F[j] = x[j] + t_s * u[j]
    C[0, 1] = 1.0
    C[2, 0] = 1.0
    h[0] = x[1]
    h[2] = alpha

    if model == 0:
        V_t = V_g - a
        dV_alpha = b
        dV_wx = -c
        dV_wz = -s
        F[0] += t_s * (f_alpha / V_g + theta[2])
        F[1] += t_s * f_v
        A[0, 0] -= t_s * f_v / V_g
        A[1, 0] = t_s * f_alpha
        h[1] = V_g * s + W_z
        C[1, 0] = V_g * c
        C[1, 3] = 1.0
    else:
        r = math.sqrt(V_g * V_g - b * b)
        V_t = r - a
        dV_alpha = b * V_t / r
        dV_wx = -c - b * s / r
        dV_wz = -s + b * c / r
        sin_d = b / V_g
        cos_d = r / V_g
        # the same two projections at alpha_g = alpha - d
        f_alpha_g = f_alpha * cos_d + f_v * sin_d
        f_v_g = f_v * cos_d - f_alpha * sin_d
        rate = (f_alpha + u[2] * s - u[3] * c) / V_t
        F[0] += t_s * (rate + theta[2])
        F[1] += t_s * f_v_g
        A[0, 0] += t_s * ((-f_v + u[2] * c + u[3] * s) - rate * dV_alpha) / V_t
        A[0, 2] = -t_s * rate * dV_wx / V_t
        A[0, 3] = -t_s * rate * dV_wz / V_t
        A[1, 0] = t_s * f_alpha_g * V_t / r
        A[1, 2] = -t_s * f_alpha_g * s / r
        A[1, 3] = t_s * f_alpha_g * c / r
        B[0, 2] = t_s * s / V_t
        B[0, 3] = -t_s * c / V_t
        h[1] = V_t * s + W_z
        C[1, 0] = dV_alpha * s + V_t * c
        C[1, 2] = dV_wx * s
        C[1, 3] = dV_wz * s + 1.0

    # (16) with its powers 7/2 and 2/7 taken as square roots and one logarithm
    t = 1.0 + V_t * V_t * air[0]
    t25 = t * t * math.sqrt(t)
    w = 1.0 + air[1] * (t25 * t - 1.0)
    w27 = math.exp(math.log(w) * (2.0 / 7.0))
    V_c = math.sqrt(FIVE_A0_SQ * (w27 - 1.0))
    k = FIVE_A0_SQ * w27 * air[1] * t25 * V_t * air[0] / (w * V_c)
    h[3] = V_c
    C[3, 0] = k * dV_alpha
    C[3, 2] = k * dV_wx
    C[3, 3] = k * dV_wz
