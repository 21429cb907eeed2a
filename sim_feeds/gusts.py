"""How the aircraft moves with the air: linear responses of its velocity and attitude to the wind.

A rigid prescription "ground velocity = air velocity + wind" would shake the aircraft with every
ripple of the turbulence. A real one follows slowly: gusts change angle of attack, sideslip and
airspeed first, and only the lift and side force that follow move the aircraft. The responses are
linear systems driven by the wind, averaged over the aircraft's length and solved exactly for wind
that is linear between grid points: velocity and attitude are states, so that specific force and
rates are their exact derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds.airframe import Airframe
from sim_feeds.earth import STANDARD_GRAVITY_M_S2 as G0

__all__ = ["GustResponse", "discrete_noise", "linear_response", "recurrence", "respond"]

Floats = NDArray[np.float64]

ALLEVIATION: Final = 0.5
"""Share of a gust's angle of attack that the pitch motion takes away."""
WEATHERCOCK: Final = 0.9
"""Share of a gust's sideslip that the yaw motion takes away."""
HOLD_DAMPING: Final = 0.9
FORGOTTEN: Final = 1e-25
"""Influence of an old state below which it is left out."""


@dataclass(frozen=True, slots=True)
class GustResponse:
    """Velocity that the aircraft takes from the wind, and its small attitude disturbance.

    Attributes
    ----------
    vel_ned_m_s, acc_ned_m_s2
        (n, 3) to be added to the velocity of the still-air path, and its derivative.
    angles_rad, rates_rad_s
        (n, 3) small roll, pitch, yaw angles and their derivatives.
    """

    vel_ned_m_s: Floats
    acc_ned_m_s2: Floats
    angles_rad: Floats
    rates_rad_s: Floats


def linear_response(
    A: Floats, B: Floats, u: Floats, dt_s: float, x0: Floats
) -> tuple[Floats, Floats]:
    """Solve x' = A x + B u exactly for u linear between samples.

    Parameters
    ----------
    A, B : (m, m), (m, r) float64
    u : (n, r) float64
    x0 : (m,) float64

    Returns
    -------
    x, dx : (n, m) float64
        States and their derivatives at the samples.
    """
    m, r = B.shape
    block = np.zeros((m + 2 * r, m + 2 * r))
    block[:m, :m], block[:m, m : m + r] = A * dt_s, B * dt_s
    block[m : m + r, m + r :] = np.eye(r)
    step = _expm(block)
    Ad, now, slope = step[:m, :m], step[:m, m : m + r], step[:m, m + r :]
    drive = u[:-1] @ now.T + np.diff(u, axis=0) @ slope.T
    x = recurrence(Ad, np.concatenate([x0[None], drive]))
    return x, x @ A.T + u @ B.T


def recurrence(A: Floats, d: Floats) -> Floats:
    """x[k] = A x[k-1] + d[k] for all k at once, by doubling; x[0] = d[0].

    A is (m, m) and stable, d and x are (n, m). After the pass with span s, x[k] holds the sum of
    A^j d[k-j] over the last 2 s terms.
    """
    x, power, span = d, A, 1
    while span < len(x) and np.abs(power).max() > FORGOTTEN:
        added = np.einsum("ij,kj->ki", power, x[:-span])
        x = np.concatenate([x[:span], x[span:] + added])
        power, span = power @ power, 2 * span
    return x


def discrete_noise(A: Floats, W: Floats, dt_s: float) -> tuple[Floats, Floats, Floats]:
    """A linear system driven by white noise, as exact steps.

    Parameters
    ----------
    A, W : (m, m) float64
        x' = A x + w with w of intensity W; A is stable.
    dt_s
        The step, in the unit of time of A.

    Returns
    -------
    step, kick, start : (m, m) float64
        x[k+1] = step x[k] + kick n[k] and x[0] = start n for standard normal n: x is stationary.
    """
    m = len(A)
    eye = np.eye(m)
    # Stationary covariance: A P + P A' + W = 0.
    P = np.linalg.solve(np.kron(A, eye) + np.kron(eye, A), -W.ravel()).reshape(m, m)
    block = _expm(np.block([[-A, W], [np.zeros((m, m)), A.T]]) * dt_s)
    step = block[m:, m:].T
    Q = step @ block[:m, m:]
    return step, _root(Q), _root(P)


def _root(P: NDArray[Any]) -> Floats:
    """A root of a symmetric positive semidefinite matrix: P = root root'."""
    values, vectors = np.linalg.eigh(0.5 * (P + P.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _expm(a: Floats) -> Floats:
    """Matrix exponential by scaling, a Taylor series and squaring."""
    squarings = max(0, int(np.ceil(np.log2(max(np.abs(a).sum(1).max(), 1e-16)))) + 4)
    small = a / 2.0**squarings
    term = out = np.eye(len(a))
    for k in range(1, 13):
        term = term @ small / k
        out = out + term
    for _ in range(squarings):
        out = out @ out
    return out


def respond(
    airframe: Airframe, wind_ned_m_s: Floats, heading_rad: Floats, speed_m_s: float, dt_s: float
) -> GustResponse:
    """Response to a history of wind.

    Parameters
    ----------
    airframe
        Time constants and dampings.
    wind_ned_m_s : (n, 3) float64
        Wind at the aircraft; the response starts settled in the first value.
    heading_rad : (n,) float64
        Direction of the path through the air.
    speed_m_s
        Airspeed at which the response is linearised.
    dt_s
        Grid spacing.
    """
    spread = speed_m_s / airframe.gust_length_m * np.eye(3)
    w, _ = linear_response(-spread, spread, wind_ned_m_s, dt_s, wind_ned_m_s[0])
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    surge = 1.0 / airframe.surge_s
    A, B = -surge * np.eye(2), surge * np.eye(2)
    level, level_rate = linear_response(A, B, w[:, :2], dt_s, w[0, :2])

    lag = level - w[:, :2]
    ahead = c * lag[:, 0] + s * lag[:, 1]
    sideslip = (c * lag[:, 1] - s * lag[:, 0]) / speed_m_s
    heave, heave_acc, pitch, pitch_rate = _vertical(airframe, w[:, 2], ahead, speed_m_s, dt_s)
    yaw, yaw_rate = _second_order(
        airframe.weathercock_rad_s, airframe.weathercock_damping, WEATHERCOCK * sideslip, dt_s
    )
    roll, roll_rate = _second_order(
        airframe.weathercock_rad_s, 0.8, -airframe.dihedral * sideslip, dt_s
    )
    return GustResponse(
        vel_ned_m_s=np.column_stack([level, heave]),
        acc_ned_m_s2=np.column_stack([level_rate, heave_acc]),
        angles_rad=np.column_stack([roll, pitch, yaw]),
        rates_rad_s=np.column_stack([roll_rate, pitch_rate, yaw_rate]),
    )


def _second_order(omega: float, zeta: float, target: Floats, dt_s: float) -> tuple[Floats, Floats]:
    A = np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]])
    B = np.array([[0.0], [omega**2]])
    x, _ = linear_response(A, B, target[:, None], dt_s, np.array([target[0], 0.0]))
    return x[:, 0], x[:, 1]


def _vertical(
    airframe: Airframe, down: Floats, ahead: Floats, V: float, dt_s: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Heave, short-period pitch and height hold, all positive down (pitch: up).

    States: w_f velocity taken from the gust, e height error (down), c velocity of the height hold,
    d and d' short-period pitch. With the gust's angle of attack a = (w_f - w) / V + d

        w_f' = -(V / T) a - 2 g u / V      lift follows a (T: heave constant) and airspeed excess u
        e' = w_f + c,  c' = -2 z W e' - W^2 e
        d'' = -o^2 (share * (w_f - w) / V + d) - 2 z o d'

    The height hold works through pitch: -c / V keeps its own velocity free of angle of attack, and
    -(T / V) c' is the angle of attack whose lift makes that acceleration.
    """
    T, W = airframe.heave_s, airframe.heave_hold_rad_s
    o, z = airframe.short_period_rad_s, airframe.short_period_damping
    p, q = 2.0 * HOLD_DAMPING * W, W**2
    A = np.array(
        [
            [-1.0 / T, 0.0, 0.0, -V / T, 0.0],
            [1.0, 0.0, 1.0, 0.0, 0.0],
            [-p, -q, -p, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [-(o**2) * ALLEVIATION / V, 0.0, 0.0, -(o**2), -2.0 * z * o],
        ]
    )
    B = np.zeros((5, 2))
    B[0] = 1.0 / T, -2.0 * G0 / V
    B[4, 0] = o**2 * ALLEVIATION / V
    start = np.array([down[0], 0.0, -down[0], 0.0, 0.0])
    x, dx = linear_response(A, B, np.column_stack([down, ahead]), dt_s, start)
    w_f, _, c, d, d_rate = x.T
    w_f_rate, e_rate, c_rate = dx[:, 0], dx[:, 1], dx[:, 2]
    c_acc = -p * (w_f_rate + c_rate) - q * e_rate
    pitch = d - (c + T * c_rate) / V
    pitch_rate = d_rate - (c_rate + T * c_acc) / V
    return w_f + c, w_f_rate + c_rate, pitch, pitch_rate
