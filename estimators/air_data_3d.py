"""Air data in three dimensions without vanes: wind, gust and the scale of one to three pitots.

GPS says how the aircraft moves over the ground, attitude where it points, a pitot how fast the air
passes. Of an aircraft that flies without sideslip these three are redundant as soon as it has
turned: the wind is then known, and a pitot that reads wrong no longer fits.

==========  =======================================================  ========  ======  =============
symbol      meaning                                                  shape     unit    equation
==========  =======================================================  ========  ======  =============
V           velocity over the ground: GPS N, E with the vertical     (3,)      m/s
            speed of the autopilot, NED
W           mean wind, the velocity the air moves toward, NED        (3,)      m/s     W' = u_W
g           gust on top of it, first order, time constant tau        (3,)      m/s     g'=-g/tau+u_g
k           log-scale of each pitot: it reads ``exp(-k)`` of the     (3,)      1       k' = u_k
            true equivalent airspeed; k > 0 reads low
b           yaw offset: nose against the plane of symmetry's flow    1         rad     b' = u_b
d, n        air velocity of the aircraft, V - W - g, and its length  (3,), 1   m/s
e_y         unit vector to the right wing, NED                       (3,)      1       R_IB[:, 1]
y           ln of the equivalent airspeed that a pitot shows         (3,)      1
sigma_rho   sqrt(rho / rho0) from static pressure                    1         1
x, P        state [W, g, k, b] and its covariance                    (10,),
                                                                     (10,10)
==========  =======================================================  ========  ======  =============

Measurements::

    0   = e_y' d - n b               + sideslip noise
    y_i = ln(sigma_rho n) - k_i      + common noise + own noise

Several pitots enter as their mean and as differences: taken as independent they would count the
common gust twice. The noises must not depend on k, else a low-reading fault is penalised for being
low and the wrong sensor is blamed.

The derivative of ln n is taken at the mean wind, not at the gust: a gust that is larger than the
filter thinks would else turn the ridge along which wind and scale trade off, and pass for knowledge
of the scale. On synthetic flights this brought the scale's error at the time it is called learnt
from 2.4 to 1.5 of its own sigmas (light aircraft) and from 1.2 to 0.95 (small ones).

An innovation beyond ``gate`` sigmas is used with Huber's weight, so that a broken pitot cannot
drag the wind away before it is found.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = [
    "GUST",
    "NX",
    "N_PITOTS",
    "SCALE",
    "WIND",
    "YAW",
    "air_velocity",
    "lateral_update",
    "pitot_update",
    "predict",
    "scalar_update",
]

Array = NDArray[np.float64]

N_PITOTS = 3
NX = 10
WIND = slice(0, 3)
GUST = slice(3, 6)
SCALE = slice(6, 9)
YAW = 9
_GUST0, _SCALE0 = GUST.start, SCALE.start

N_MIN_M_S = 1.0
"""Floor of n: the direction of d loses its meaning below it."""


@kernel
def air_velocity(x: Array, V: Array, d: Array) -> float:
    """Write ``d = V - W - g``; return n = max(|d|, 1 m/s).

    Parameters
    ----------
    x : (10,) float64
    V, d : (3,) float64 [m/s]
    """
    for i in range(3):
        d[i] = V[i] - x[i] - x[_GUST0 + i]
    return max(math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), N_MIN_M_S)


@kernel
def predict(x: Array, P: Array, phi: float, q: Array) -> None:
    """Time update in place: the gust decays by ``phi``, everything else walks.

    Parameters
    ----------
    x : (10,) float64
    P : (10, 10) float64
    phi : float [1]
        ``exp(-dt / tau)``.
    q : (10,) float64
        Variance that each state gains over the step.
    """
    for i in range(GUST.start, GUST.stop):
        x[i] *= phi
        for j in range(NX):
            P[i, j] *= phi
            P[j, i] *= phi
    for i in range(NX):
        P[i, i] += q[i]


@kernel
def scalar_update(x: Array, P: Array, H: Array, e: float, R: float, gate: float) -> float:
    """Use one scalar measurement in place; return the log of its likelihood (Huber's beyond gate).

    Parameters
    ----------
    x : (10,) float64
    P : (10, 10) float64
    H : (10,) float64
        Derivative of the measurement by the state.
    e, R : float
        Innovation and measurement variance.
    gate : float [sigma]
        Beyond it the log-likelihood goes on linearly and the gain is divided by ``|e| / gate``.
    """
    PH = np.empty(NX)
    S = R
    for i in range(NX):
        s = 0.0
        for j in range(NX):
            s += P[i, j] * H[j]
        PH[i] = s
        S += H[i] * s
    nu = abs(e) / math.sqrt(S)
    log_likelihood = -0.5 * math.log(2.0 * math.pi * S)
    if nu > gate:
        log_likelihood -= gate * (nu - 0.5 * gate)
        S *= nu / gate
    else:
        log_likelihood -= 0.5 * nu * nu
    gain = 1.0 / S
    for i in range(NX):
        x[i] += PH[i] * gain * e
        for j in range(NX):
            P[i, j] -= PH[i] * PH[j] * gain
    return log_likelihood


@kernel
def lateral_update(x: Array, P: Array, V: Array, e_y: Array, R: float, gate: float) -> float:
    """Use ``e_y' d - n b = 0``; return its log-likelihood.

    Parameters
    ----------
    x, P : (10,), (10, 10) float64
    V : (3,) float64 [m/s]
    e_y : (3,) float64 [1]
    R : float [m^2/s^2]
    """
    d = np.empty(3)
    n = air_velocity(x, V, d)
    b = x[YAW]
    H = np.zeros(NX)
    h = -n * b
    for i in range(3):
        h += e_y[i] * d[i]
        H[i] = -e_y[i] + b * d[i] / n
        H[_GUST0 + i] = H[i]
    H[YAW] = -n
    return scalar_update(x, P, H, -h, R, gate)


@kernel
def pitot_update(
    x: Array,
    P: Array,
    V: Array,
    y: Array,
    use: int,
    ln_sigma: float,
    R_common: float,
    R_own: float,
    gate: float,
) -> float:
    """Use the pitots as their mean and as Helmert's contrasts; return the log-likelihood.

    Parameters
    ----------
    x, P : (10,), (10, 10) float64
    V : (3,) float64 [m/s]
    y : (3,) float64 [1]
        ln of the equivalent airspeed shown, [m/s] inside the logarithm.
    use : int
        Bit i set: y[i] is used.
    ln_sigma : float [1]
        ln of sigma_rho.
    R_common, R_own : float [1]
        Variances of the noise that all pitots share and of each one's own.
    """
    m = 0
    for i in range(N_PITOTS):
        m += (use >> i) & 1
    if m == 0:
        return 0.0
    d = np.empty(3)
    n = air_velocity(x, V, d)
    H = np.zeros(NX)
    m2 = 0.0
    for i in range(3):
        m2 += (V[i] - x[i]) ** 2
    m2 = max(m2, N_MIN_M_S**2)
    for i in range(3):
        H[i] = -(V[i] - x[i]) / m2
        H[_GUST0 + i] = H[i]
    e = 0.0
    h = ln_sigma + math.log(n)
    for i in range(N_PITOTS):
        if (use >> i) & 1:
            H[_SCALE0 + i] = -1.0 / m
            e += (y[i] - h + x[_SCALE0 + i]) / m
    total = scalar_update(x, P, H, e, R_common + R_own / m, gate)
    # Contrast j sets pitot j against the mean of those before it; ln(sigma_rho n) drops out.
    j = 0
    for last in range(N_PITOTS):
        if not (use >> last) & 1:
            continue
        if j > 0:
            a = 1.0 / math.sqrt(j * (j + 1.0))
            H[:] = 0.0
            e = 0.0
            for i in range(last + 1):
                if (use >> i) & 1:
                    c = a if i < last else -j * a
                    H[_SCALE0 + i] = -c
                    e += c * (y[i] + x[_SCALE0 + i])
            total += scalar_update(x, P, H, e, R_own, gate)
        j += 1
    return total
