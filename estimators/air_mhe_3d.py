"""Constrained moving-horizon air data in three dimensions: inertial velocity, wind, vane offset.

========  =====================================================  =======  ==========================
symbol    meaning                                                shape    equation
========  =====================================================  =======  ==========================
x         V (inertial velocity, NED), W (wind, NED), b (offset   (7,)     V' = R_NB A + g e_3 + u_V
          that the vanes share) [m/s, rad]                                W' = u_W, b' = u_b
dV        integral of R_NB A + g e_3 over a stage [m/s]          (3,)     strapdown
R_bn      frd_from_ned                                           (3, 3)
d, v_a    V - W in NED, and in the body frame                    (3,)     v_a = R_bn (V - W)
y         V_N V_E V_D, CAS, alpha, beta [m/s, rad]               (6,)     alpha = atan2(w, u) + b,
                                                                          beta = asin(v / |v_a|)
P         covariance of the arrival mean                         (7, 7)
N         stages in the horizon                                           wan2018 (21)
========  =====================================================  =======  ==========================

The dynamics are linear and only the outputs are not, so Algorithms 1 and 2 of
:mod:`estimators.mhe` apply as they stand. beta is a pseudo-measurement: an aircraft flies with its
nose into the wind, to some degrees. The vertical wind is drawn to zero, for air that rises over a
long way does not exist; this is what tells a common vane offset from an updraft.

Differs: the arrival mean and covariance are the Kalman filter's (wan2018 keeps a fixed P and the
smoothed mean, which counts each sample about N times).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.atmosphere import cas_from_tas
from estimators.jit import kernel
from estimators.mhe import NON_FINITE, barrier_qp, work_size

__all__ = [
    "ALPHA",
    "BETA",
    "CAS",
    "M3",
    "N3",
    "OFFSET",
    "VEL",
    "WIND",
    "Horizon",
    "WindLimits",
    "air_outputs",
    "fill",
    "new_horizon",
    "put",
    "shift",
    "solve",
    "start",
]

Array = NDArray[np.float64]

N3, M3 = 7, 6
VEL, WIND = slice(0, 3), slice(3, 6)
OFFSET = 6
CAS, ALPHA, BETA = 3, 4, 5


class WindLimits(NamedTuple):
    """Noise and bounds of the model; SI, rad."""

    walk_m_s: float
    walk_down_m_s: float
    down_tau_s: float
    velocity_walk_m_s: float
    offset_walk_rad: float
    bound_m_s: float
    bound_down_m_s: float
    gps_std_m_s: float
    cas_std_m_s: float
    aoa_std_rad: float
    sideslip_std_rad: float
    offset_std_rad: float
    n_kappa: int
    n_qp: int


class Horizon(NamedTuple):
    """The arrays of a horizon of N stages, updated in place."""

    x_prior: Array
    P: Array
    x: Array
    u: Array
    y: Array
    use: Array
    R_bn: Array
    air: Array  # (N, 2): static pressure [Pa], temperature [K]
    dV: Array  # (N, 3): velocity gained from the stage before
    R: Array
    Q: Array
    A: Array
    B: Array
    C: Array
    vectors: Array
    work: Array
    state: Array  # [stages filled, last status]


def new_horizon(N: int) -> Horizon:
    """An empty horizon of N stages."""
    z = np.zeros
    return Horizon(
        z(N3), z((N3, N3)), z((N, N3)), z((N - 1, N3)), z((N, M3)), z((N, M3)), z((N, 3, 3)),
        z((N, 2)), z((N, 3)), z(M3), z(N3), z((N, N3, N3)), z((N, N3, N3)), z((N, M3, N3)),
        z((12, N, N3)), z(work_size(N, N3, N3, M3)), z(2),
    )  # fmt: skip


@kernel
def fill(a: Array, v: float) -> None:
    """Set every entry of a vector. (Slice assignment costs seconds of compilation.)"""
    for k in range(a.size):
        a[k] = v


@kernel
def put(a: Array, b: Array) -> None:
    """Copy a vector."""
    for k in range(a.size):
        a[k] = b[k]


@kernel
def air_outputs(x: Array, R_bn: Array, air: Array, h: Array, C: Array) -> bool:
    """Write the six outputs and their Jacobian at x; False below 2 m/s of airspeed.

    ``h`` (6,), ``C`` (6, 7), ``R_bn`` (3, 3), ``air`` (2,): static pressure [Pa], temperature [K].
    """
    d0, d1, d2 = x[0] - x[3], x[1] - x[4], x[2] - x[5]
    u = R_bn[0, 0] * d0 + R_bn[0, 1] * d1 + R_bn[0, 2] * d2
    v = R_bn[1, 0] * d0 + R_bn[1, 1] * d1 + R_bn[1, 2] * d2
    w = R_bn[2, 0] * d0 + R_bn[2, 1] * d1 + R_bn[2, 2] * d2
    speed = math.sqrt(u * u + v * v + w * w)
    plane = u * u + w * w
    for k in range(M3):
        fill(C[k], 0.0)
    for a in range(3):
        h[a] = x[a]
        C[a, a] = 1.0
    if speed < 2.0 or plane < 1.0:
        h[3] = h[4] = h[5] = 0.0
        return False
    h[3] = cas_from_tas(speed, air[0], air[1])
    slope = (cas_from_tas(speed + 0.5, air[0], air[1]) - h[3]) * 2.0
    h[4] = math.atan2(w, u) + x[6]
    h[5] = math.asin(v / speed)
    lateral = math.sqrt(plane)
    for a in range(3):
        d_a = d0 if a == 0 else d1 if a == 1 else d2
        along = d_a / speed
        C[3, a] = slope * along
        C[4, a] = (u * R_bn[2, a] - w * R_bn[0, a]) / plane
        C[5, a] = (R_bn[1, a] - v / speed * along) / lateral
        for k in range(3, 6):
            C[k, a + 3] = -C[k, a]
    C[4, 6] = 1.0
    return True


@kernel
def start(z: Horizon, limits: WindLimits, V: Array, R_bn: Array, air: Array) -> None:
    """Begin at velocity V (3,) in still air."""
    N = z.x.shape[0]
    for i in range(N):
        fill(z.x[i], 0.0)
        fill(z.use[i], 0.0)
        fill(z.dV[i], 0.0)
        for a in range(3):
            z.x[i, a] = V[a]
        put(z.air[i], air)
        for a in range(3):
            put(z.R_bn[i, a], R_bn[a])
        if i < N - 1:
            fill(z.u[i], 0.0)
    for a in range(N3):
        fill(z.P[a], 0.0)
    put(z.x_prior, z.x[0])
    down = limits.walk_down_m_s * math.sqrt(0.5 * limits.down_tau_s)
    for a in range(3):
        z.P[a, a] = 4.0
        z.P[3 + a, 3 + a] = (0.25 * limits.bound_m_s) ** 2 if a < 2 else down * down
    z.P[6, 6] = limits.offset_std_rad**2
    z.R[0] = z.R[1] = z.R[2] = limits.gps_std_m_s**2
    z.R[3] = limits.cas_std_m_s**2
    z.R[4] = limits.aoa_std_rad**2
    z.R[5] = limits.sideslip_std_rad**2
    z.state[0] = 1.0


@kernel
def _transition(z: Horizon, i: int, down_keep: float) -> None:
    """A and B of the step from stage i: the vertical wind is drawn to zero."""
    for a in range(N3):
        fill(z.A[i, a], 0.0)
        fill(z.B[i, a], 0.0)
        z.A[i, a, a] = 1.0
        z.B[i, a, a] = 1.0
    z.A[i, 5, 5] = down_keep


@kernel
def _filter_arrival(z: Horizon, h: Array) -> None:
    """Arrival mean and covariance one stage on: use the oldest stage's data, then predict."""
    n = N3
    air_outputs(z.x[0], z.R_bn[0], z.air[0], h, z.C[0])
    for k in range(M3):
        if z.use[0, k] == 0.0:
            continue
        r = z.y[0, k] - h[k]
        s = z.R[k]
        g = z.vectors[11, 0]
        for a in range(n):
            t = 0.0
            for b in range(n):
                t += z.P[a, b] * z.C[0, k, b]
            g[a] = t
        for a in range(n):
            s += z.C[0, k, a] * g[a]
            r -= z.C[0, k, a] * (z.x_prior[a] - z.x[0, a])
        for a in range(n):
            t = g[a] / s
            z.x_prior[a] += t * r
            for b in range(n):
                z.P[a, b] -= t * g[b]
    keep = z.A[0, 5, 5]
    for a in range(3):
        z.x_prior[a] += z.dV[1, a]
    z.x_prior[5] *= keep
    for a in range(n):
        z.P[5, a] *= keep
    for a in range(n):
        z.P[a, 5] *= keep
    for a in range(n):
        z.P[a, a] += z.Q[a]
        for b in range(a):
            mean = 0.5 * (z.P[a, b] + z.P[b, a])
            z.P[a, b] = mean
            z.P[b, a] = mean


@kernel
def shift(
    z: Horizon, limits: WindLimits, dt_s: float, dV: Array, R_bn: Array, air: Array,
    hold_wind: bool, held_walk_m_s: float,
) -> None:  # fmt: skip
    """Move the horizon by one stage of ``dt_s`` and predict the newest state.

    ``dV`` (3,) is the strapdown velocity gained [m/s]. With ``hold_wind`` no pitot is left: the
    horizontal wind then walks by ``held_walk_m_s`` per sqrt(s), a mean wind's pace.
    """
    N = z.x.shape[0]
    walk = held_walk_m_s if hold_wind else limits.walk_m_s
    keep = math.exp(-dt_s / limits.down_tau_s)
    for a in range(3):
        z.Q[a] = limits.velocity_walk_m_s**2 * dt_s
    z.Q[3] = z.Q[4] = walk * walk * dt_s
    z.Q[5] = limits.walk_down_m_s**2 * dt_s
    z.Q[6] = limits.offset_walk_rad**2 * dt_s
    for i in range(N):
        _transition(z, i, keep)
    _filter_arrival(z, z.vectors[10, 0])
    for i in range(N - 1):
        put(z.x[i], z.x[i + 1])
        put(z.y[i], z.y[i + 1])
        put(z.use[i], z.use[i + 1])
        put(z.air[i], z.air[i + 1])
        put(z.dV[i], z.dV[i + 1])
        for a in range(3):
            put(z.R_bn[i, a], z.R_bn[i + 1, a])
        if i < N - 2:
            put(z.u[i], z.u[i + 1])
    fill(z.u[N - 2], 0.0)
    fill(z.use[N - 1], 0.0)
    fill(z.y[N - 1], 0.0)
    put(z.air[N - 1], air)
    put(z.dV[N - 1], dV)
    for a in range(3):
        put(z.R_bn[N - 1, a], R_bn[a])
    for a in range(3):
        z.x[N - 1, a] = z.x[N - 2, a] + dV[a]
    z.x[N - 1, 5] = keep * z.x[N - 2, 5]


@kernel
def solve(z: Horizon, limits: WindLimits, centre: Array, band: Array, bounded: bool) -> int:
    """One SQP iteration of the horizon (2 x 2 barrier iterations); returns the solver's status.

    ``centre``, ``band`` (3,) [m/s]: the wind stays within ``band`` of ``centre`` and within its
    absolute bounds, unless ``bounded`` is False.
    """
    N = z.x.shape[0]
    v = z.vectors
    f, ru, xl, xu, ul, uu, dx, du = v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]
    ry = v[8].reshape(-1)[: N * M3].reshape(N, M3)
    rx = v[9, 0]
    h = v[10, 0]
    for i in range(N):
        known = air_outputs(z.x[i], z.R_bn[i], z.air[i], h, z.C[i])
        for k in range(M3):
            if z.use[i, k] != 0.0 and (known or k < 3):
                ry[i, k] = z.y[i, k] - h[k]
            else:
                ry[i, k] = 0.0
                fill(z.C[i, k], 0.0)
        for a in range(N3):
            xl[i, a] = -np.inf
            xu[i, a] = np.inf
            ul[i, a] = -np.inf
            uu[i, a] = np.inf
            if bounded and 3 <= a < 6:
                limit = limits.bound_m_s if a < 5 else limits.bound_down_m_s
                lo = max(-limit, centre[a - 3] - band[a - 3])
                hi = min(limit, centre[a - 3] + band[a - 3])
                if hi - lo < 0.5:
                    lo, hi = -limit, limit
                xl[i, a] = lo - z.x[i, a]
                xu[i, a] = hi - z.x[i, a]
            if i < N - 1:
                moved = z.A[i, a, a] * z.x[i, a] + z.u[i, a] - z.x[i + 1, a]
                f[i, a] = moved + z.dV[i + 1, a] if a < 3 else moved
                ru[i, a] = -z.u[i, a]
    for a in range(N3):
        rx[a] = z.x_prior[a] - z.x[0, a]
    status = barrier_qp(
        z.P, z.Q, z.R, z.A, z.B, z.C, f, rx, ru, ry, xl, xu, ul[: N - 1], uu[: N - 1],
        1.0, limits.n_kappa, limits.n_qp, dx, du[: N - 1], z.work,
    )  # fmt: skip
    z.state[1] = status
    if status >= NON_FINITE:
        return int(status)
    for i in range(N):
        for a in range(N3):
            z.x[i, a] += dx[i, a]
            if i < N - 1:
                z.u[i, a] += du[i, a]
    return int(status)
