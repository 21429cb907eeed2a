"""The long horizon: minutes of wind and pitot scale, bounded, for faults that grow slowly.

The filter bank looks for what changed at one moment. A pitot that ices or leaks changes by some
per cent a minute: at every moment it changes by less than the wind may. Over minutes of turning
flight it does not, and over minutes bounds on the wind tell something. So the last ``N`` stages
(:mod:`estimators.air_horizon_stage`) are estimated together, once for every explanation.

========  ==========================================================  ========  ====================
symbol    meaning                                                     shape     equation
========  ==========================================================  ========  ====================
x         [W (3), g (2), k (3), b, r]: wind, horizontal gust,         (10,)     x' = A x + B u
          log-scale of each pitot, yaw offset, rate of a drift
          [m/s, m/s, 1, rad, 1/s]
A         identity; the gust keeps phi, and the k of drifting pitots  (10, 10)  k' = k + r dt
          gains r dt
B         standard deviation that a state gains in a stage            (10, 10)  u ~ N(0, I)
C, ry     rows of a stage, divided by their noise: lateral, mean of   (4, 10)   see the stage
          the pitots, Helmert's contrasts of the pitots               (4,)
x_p, P    arrival: mean and covariance of the first stage's state,              Kalman filter
          from all data older than the horizon and from none of it
L         log-likelihood of the horizon's data                        1         below
========  ==========================================================  ========  ====================

The unknown of the quadratic programme is x itself (its linearisation point only enters C and ry),
so a window without bounds is solved by one Newton step. A window whose solution keeps all bounds
is the bounded problem's solution too; only where one does not, the barrier iterations run.

Explanations differ in A and B alone: nothing happened, the wind has changed for the last so many
seconds (W walks by ``wind_walk_changed``), the pitots of a mask drift together (their k follows r,
r walks). With nu the innovations of the forward pass and S their variances::

    L = -1/2 sum(nu^2 / S + ln S) - (J(bounded) - J(free)),

the log of the marginal likelihood: the logarithms make an explanation pay for its freedom, the
last term for its conflict with the bounds.

A gust of 10 s is correlated from stage to stage. As white noise it would be counted several times;
so it is a state whose mean over a stage has the variance v sigma_g^2 of the mean of a first-order
process over ``dt``, and whose phi is chosen so that its power at low frequency is that process's::

    v = 2 tau / dt (1 - tau / dt (1 - exp(-dt / tau))),  (1 + phi) / (1 - phi) = 2 tau / (v dt).

Source: wan2018 Algorithms 1 and 2 by :mod:`estimators.mhe`.
Differs: the arrival is the Kalman filter's conditional mean and covariance (wan2018 keeps a fixed P
and the smoothed mean, which counts each sample about N times); the wind's change is bounded, not
its rate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS, scalar_update
from estimators.air_data_3d_bank import N_HYPOTHESES
from estimators.air_horizon_lanes import HorizonLanes, new_horizon_lanes
from estimators.air_horizon_stage import (
    N_STAGE,
    Z_AIR,
    Z_C,
    Z_COMMON,
    Z_DOWN2,
    Z_DT,
    Z_EY,
    Z_GUST2,
    Z_LATERAL,
    Z_LATERAL_VAR,
    Z_M,
    Z_OWN,
    Z_USE,
    Z_W0,
    Z_WALK2,
    Z_Z,
)
from estimators.jit import kernel
from estimators.mhe import work_size

__all__ = [
    "CHANGED_S",
    "NH",
    "N_EXPLANATIONS",
    "SCALE_H",
    "WIND_WALKED",
    "HorizonLevels",
    "LongHorizon",
    "gust_stage",
    "new_long_horizon",
    "push_stage",
    "stage_rows",
    "start_horizon",
    "transition",
]

Array = NDArray[np.float64]

NH, MH = 10, 4
WIND_H, GUST_H, SCALE_H = slice(0, 3), slice(3, 5), slice(5, 8)
YAW_H, RATE_H = 8, 9
_G, _K = GUST_H.start, SCALE_H.start

NOTHING = 0
WIND_WALKED = N_HYPOTHESES
"""Explanations: 0 nothing happened, 1..7 the mask of pitots that drift, 8..11 the wind changed."""
CHANGED_S = (np.inf, 160.0, 80.0, 40.0)
"""For how long the wind of explanations 8..11 has been changing, up to now [s].

A front passes in a minute. Freedom to change all the time costs so much likelihood that it would
explain nothing, and a drifting pitot would be blamed for the front.
"""
N_EXPLANATIONS = N_HYPOTHESES + len(CHANGED_S)

NO_GATE = 1e9
RATE_PRIOR = 1e-6
"""Drift that every arrival is given so that its covariance has an inverse [1/s]."""
YAW_WALK_RAD = 1e-4

# What the horizon remembers: stages in it, the pitots held for drifting and since when, and since
# when the wind is held for changed.
H_STAGES, H_HELD, H_HELD_SINCE, H_WIND_SINCE = range(4)


class HorizonLevels(NamedTuple):
    """Model, bounds and limits of the horizon; the settings say what each value rests on."""

    iterations: int
    kappa: float
    n_kappa: int
    n_qp: int
    gust_tau_s: float
    wind_walk_changed: float
    scale_walk: float
    rate_walk: float
    wind_max_m_s: float
    down_max_m_s: float
    change_max_m_s: float
    scale_max: float
    margin_one: float
    margin_all: float
    margin_wind: float
    confirm_s: float
    min_shift: float


class LongHorizon(NamedTuple):
    """All memory of the horizon of N stages; arrays are changed in place.

    Attributes
    ----------
    stages : (N, 28) float64
        Oldest first.
    x_p, P : (10,), (10, 10) float64
        Arrival mean and covariance.
    x : (12, N, 10) float64
        Each explanation's trajectory: its linearisation point.
    L : (12,) float64 [nat]
        Log-likelihood of each explanation, -inf where none was solved.
    end_P : (12, 10, 10) float64
        Covariance of each explanation's newest state.
    memory : (4,) float64
    A, B, C, ry, lo, hi, u, inf, zero, one, work
        Scratch of the quadratic programme.
    lanes
        Scratch of the windows without bounds.
    """

    stages: Array
    x_p: Array
    P: Array
    x: Array
    L: Array
    end_P: Array
    memory: Array
    A: Array
    B: Array
    C: Array
    ry: Array
    lo: Array
    hi: Array
    u: Array
    inf: Array
    zero: Array
    one: Array
    work: Array
    lanes: HorizonLanes


def new_long_horizon(N: int) -> LongHorizon:
    """A horizon that has not been started."""
    z = np.zeros
    eye = np.tile(np.eye(NH), (N, 1, 1))
    return LongHorizon(
        stages=z((N, N_STAGE)),
        x_p=z(NH),
        P=z((NH, NH)),
        x=z((N_EXPLANATIONS, N, NH)),
        L=np.full(N_EXPLANATIONS, -np.inf),
        end_P=z((N_EXPLANATIONS, NH, NH)),
        memory=np.array([0.0, 0.0, np.nan, np.nan]),
        A=eye.copy(),
        B=eye.copy(),
        C=z((N, MH, NH)),
        ry=z((N, MH)),
        lo=np.full((N, NH), -np.inf),
        hi=np.full((N, NH), np.inf),
        u=z((N, NH)),
        inf=np.stack((np.full((N, NH), -np.inf), np.full((N, NH), np.inf))),
        zero=z((N, NH)),
        one=np.ones(NH),
        work=z(work_size(N, NH, NH, MH)),
        lanes=new_horizon_lanes(N),
    )


@kernel
def start_horizon(z: LongHorizon, x: Array, P: Array) -> None:
    """Begin anew from a filter's state and covariance, (10,) and (10, 10) of the bank's layout."""
    z.memory[H_STAGES] = 0.0
    z.memory[H_HELD] = 0.0
    z.memory[H_HELD_SINCE] = np.nan
    z.memory[H_WIND_SINCE] = np.nan
    for h in range(N_EXPLANATIONS):
        z.L[h] = -np.inf
    for i in range(NH - 1):
        a = i if i < SCALE_H.start else i + 1  # the bank's vertical gust is left out
        z.x_p[i] = x[a]
        for j in range(NH - 1):
            z.P[i, j] = P[a, j if j < SCALE_H.start else j + 1]
        z.P[i, RATE_H] = z.P[RATE_H, i] = 0.0
    z.x_p[RATE_H], z.P[RATE_H, RATE_H] = 0.0, RATE_PRIOR**2


@kernel
def gust_stage(dt: float, tau: float) -> tuple[float, float]:
    """Decay phi and variance v (of sigma_g^2) of a first-order gust's mean over a stage."""
    share = dt / tau
    v = 2.0 / share * (1.0 - (1.0 - math.exp(-share)) / share)
    power = 2.0 / (share * v)
    return (power - 1.0) / (power + 1.0), v


@kernel
def stage_rows(row: Array, x: Array, C: Array, ry: Array) -> None:
    """Write the rows of a stage at the linearisation point x, divided by their noise.

    Parameters
    ----------
    row : (28,) float64
        The stage.
    x : (10,) float64
    C : (4, 10) float64, written
    ry : (4,) float64, written
        ``ry = C x + noise`` of variance one.
    """
    for k in range(MH):
        ry[k] = 0.0
        for a in range(NH):
            C[k, a] = 0.0
    w = 1.0 / math.sqrt(row[Z_LATERAL_VAR])
    for a in range(3):
        C[0, a] = w * row[Z_EY + a]
    for a in range(2):
        C[0, _G + a] = w * row[Z_EY + a]
    C[0, YAW_H] = w * row[Z_AIR]
    ry[0] = w * row[Z_LATERAL]
    use = int(row[Z_USE])
    m = 0
    for i in range(N_PITOTS):
        m += (use >> i) & 1
    if m == 0:
        return
    d0, d1 = x[0] - row[Z_W0], x[1] - row[Z_W0 + 1]
    m0 = row[Z_M] * d0 + row[Z_M + 1] * d1
    m1 = row[Z_M + 1] * d0 + row[Z_M + 2] * d1
    w = 1.0 / math.sqrt(row[Z_COMMON] + row[Z_OWN] / m)
    C[1, 0] = w * (row[Z_C] + m0)
    C[1, 1] = w * (row[Z_C + 1] + m1)
    C[1, 2] = w * row[Z_C + 2]
    C[1, _G] = w * row[Z_C]
    C[1, _G + 1] = w * row[Z_C + 1]
    # z = c'd + d'Md/2 + ...: with the gradient at x, the row holds for the absolute wind.
    ry[1] = 0.5 * w * (m0 * d0 + m1 * d1)
    for a in range(3):
        ry[1] += C[1, a] * row[Z_W0 + a]
    for i in range(N_PITOTS):
        if (use >> i) & 1:
            C[1, _K + i] = -w / m
            ry[1] += w * row[Z_Z + i] / m
    w = 1.0 / math.sqrt(row[Z_OWN])
    j = 0
    for last in range(N_PITOTS):
        if not (use >> last) & 1:
            continue
        if j > 0:
            share = w / math.sqrt(j * (j + 1.0))
            for i in range(last + 1):
                if (use >> i) & 1:
                    c = share if i < last else -j * share
                    C[1 + j, _K + i] = -c
                    ry[1 + j] += c * row[Z_Z + i]
        j += 1


@kernel
def transition(A: Array, B: Array, row: Array, levels: HorizonLevels, h: int, windy: bool) -> None:
    """A and B of the step into the stage ``row`` under explanation h; windy: the wind changes."""
    dt = row[Z_DT]
    phi, v = gust_stage(dt, levels.gust_tau_s)
    walk2 = row[Z_WALK2]
    if windy:
        walk2 += levels.wind_walk_changed**2 * dt
    B[0, 0] = B[1, 1] = math.sqrt(walk2)
    B[2, 2] = math.sqrt(row[Z_DOWN2])
    for a in range(2):
        A[_G + a, _G + a] = phi
        B[_G + a, _G + a] = math.sqrt(row[Z_GUST2] * v * (1.0 - phi * phi))
    drifts = h < WIND_WALKED and h > 0
    for i in range(N_PITOTS):
        B[_K + i, _K + i] = levels.scale_walk * math.sqrt(dt)
        A[_K + i, RATE_H] = dt if drifts and (h >> i) & 1 else 0.0
    B[YAW_H, YAW_H] = YAW_WALK_RAD * math.sqrt(dt)
    B[RATE_H, RATE_H] = levels.rate_walk * math.sqrt(dt) if drifts else 0.0


@kernel
def _leave(z: LongHorizon, levels: HorizonLevels, h: int) -> None:
    """Take the oldest stage into the arrival under explanation h: a Kalman filter's step."""
    stage_rows(z.stages[0], z.x[h, 0], z.C[0], z.ry[0])
    for k in range(MH):
        e, used = z.ry[0, k], False
        for a in range(NH):
            e -= z.C[0, k, a] * z.x_p[a]
            used = used or z.C[0, k, a] != 0.0
        if used:
            scalar_update(z.x_p, z.P, z.C[0, k], e, 1.0, NO_GATE)
    A, B = z.A[0], z.B[0]
    transition(A, B, z.stages[1], levels, h, h >= WIND_WALKED)
    for i in range(NH):
        phi = A[i, i]
        z.x_p[i] *= phi
        for j in range(NH):
            z.P[i, j] *= phi
        for j in range(NH):
            z.P[j, i] *= phi
    for i in range(NH):
        z.P[i, i] += B[i, i] ** 2


@kernel
def push_stage(z: LongHorizon, levels: HorizonLevels, row: Array) -> None:
    """Append a finished stage; of a full horizon the oldest goes into the arrival."""
    N = z.stages.shape[0]
    n = int(z.memory[H_STAGES])
    if n == N:
        _leave(z, levels, NOTHING + n - N)
        for i in range(N - 1):
            for a in range(N_STAGE):
                z.stages[i, a] = z.stages[i + 1, a]
            for h in range(N_EXPLANATIONS):
                for a in range(NH):
                    z.x[h, i, a] = z.x[h, i + 1, a]
        n -= 1
    for a in range(N_STAGE):
        z.stages[n, a] = row[a]
    for h in range(N_EXPLANATIONS):
        for a in range(NH):
            z.x[h, n, a] = z.x[h, n - 1, a] if n > 0 else z.x_p[a]
    z.memory[H_STAGES] = n + 1.0
