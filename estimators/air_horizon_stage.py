"""Stages of the long horizon: what the GPS epochs of some seconds say about wind and scale.

A stage gathers the epochs of ``stage_s`` seconds around a fixed wind W0, the master's at its start.
The lateral measurement is linear in the wind; the logarithm of the airspeed is kept to second
order, so that a stage may be linearised anew at every wind near W0 without its epochs::

    0    = E[e_y' V] - E[e_y]' (W + g) - E[n] b                                + lateral noise
    E[z] = c' (W - W0) + (W - W0)' M (W - W0) / 2 + c' g - k                   + pitot noise

==========  ===============================================================  ==========  ==========
symbol      meaning                                                          shape       unit
==========  ===============================================================  ==========  ==========
z_i         y_i - ln(sigma_rho |V - W0|) of pitot i                          (3,)        1
c, M        E of the gradient -d / n^2 and of the horizontal Hessian of      (3,) (3,)   s/m,
            ln |V - W| at W0; M as its NN, NE and EE parts                               s^2/m^2
W0          wind at which the epochs were taken                              (3,)        m/s
==========  ===============================================================  ==========  ==========

Noise that is white over the epochs averages out; errors of timing and sideslip in a turn do not,
and ``own`` and ``common`` floors stand for what stays through a stage. The gust is a state of the
horizon, so its part is no noise here; only its vertical component, felt in a bank, is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS, NX
from estimators.air_data_3d_noise import ACC, GUST_STD, R_COMMON, R_LATERAL, R_OWN
from estimators.jit import kernel

__all__ = [
    "G_ACTIVE",
    "G_COUNT",
    "G_FRESH",
    "G_RUNS",
    "G_T",
    "N_STAGE",
    "Z_AIR",
    "Z_C",
    "Z_COMMON",
    "Z_DOWN2",
    "Z_DT",
    "Z_EY",
    "Z_GUST2",
    "Z_LATERAL",
    "Z_LATERAL_VAR",
    "Z_M",
    "Z_N",
    "Z_OWN",
    "Z_T",
    "Z_USE",
    "Z_W0",
    "Z_WALK2",
    "Z_Z",
    "Gathering",
    "StageLevels",
    "add_epoch",
    "begin",
    "close",
    "gather_epoch",
    "new_gathering",
]

Array = NDArray[np.float64]

# Columns of a stage; the means are sums while it is open.
Z_N, Z_T, Z_DT, Z_USE, Z_LATERAL, Z_AIR, Z_LATERAL_VAR, Z_TIMING2 = range(8)
Z_COMMON, Z_OWN, Z_GUST2, Z_WALK2, Z_DOWN2 = range(8, 13)
Z_W0, Z_EY, Z_Z, Z_C, Z_M = 13, 16, 19, 22, 25
N_STAGE = 28


# What the gathering remembers: whether it runs, the sound pitots and the take-off it runs for, the
# last epoch, stages that wait for the horizon, whether the horizon starts anew with them, and the
# pitots under judgement.
(
    G_RUNS,
    G_SOUND,
    G_FLYING_SINCE,
    G_T,
    G_COUNT,
    G_FRESH,
    G_ACTIVE,
) = range(7)

BREAK_S = 5.0
"""After so long without an epoch the horizon starts anew, as the bank does."""
MAX_WAITING = 8
"""Stages that may wait for the horizon."""


class Gathering(NamedTuple):
    """Stages on their way to the horizon; arrays are changed in place.

    Attributes
    ----------
    open : (28,) float64
        The stage that is being gathered.
    closed : (8, 28) float64
        Finished ones that wait.
    x, P : (10,), (10, 10) float64
        The filter bank's master where the horizon starts anew.
    memory : (7,) float64
    """

    open: Array
    closed: Array
    x: Array
    P: Array
    memory: Array


def new_gathering() -> Gathering:
    """Nothing gathered."""
    z = np.zeros
    memory = z(7)
    memory[[G_FLYING_SINCE, G_T]] = -np.inf
    return Gathering(z(N_STAGE), z((MAX_WAITING, N_STAGE)), z(NX), z((NX, NX)), memory)


class StageLevels(NamedTuple):
    """Length of a stage, stages between two solves, and noise that does not average out in one."""

    stage_s: float
    solve_every: int
    timing_s: float
    lateral_m_s: float
    common: float
    own: float


@kernel
def begin(stage: Array, W0: Array) -> None:
    """Empty a stage and fix its wind W0 (the first three of an array) [m/s]."""
    for k in range(N_STAGE):
        stage[k] = 0.0
    stage[Z_USE] = 7.0
    for i in range(3):
        stage[Z_W0 + i] = W0[i]


@kernel
def add_epoch(
    stage: Array,
    t: float,
    dt: float,
    V: Array,
    e_y: Array,
    y: Array,
    use: int,
    ln_sigma: float,
    noise: Array,
    timing_s: float,
    walk2: float,
    down2: float,
) -> None:
    """Add one GPS epoch.

    Parameters
    ----------
    stage : (28,) float64, changed in place
    V, e_y, y : (3,) float64 [m/s], [1], [1]
        As in :mod:`estimators.air_data_3d`.
    use : int
        Bit i set: y[i] is used. A stage keeps the pitots that all its epochs have.
    noise : (30,) float64
        Levels of :mod:`estimators.air_data_3d_noise`.
    walk2, down2 : float [m^2/s^2]
        Variance that the horizontal and the vertical wind gain over the epoch.
    """
    stage[Z_N] += 1.0
    stage[Z_T] = t
    stage[Z_DT] += dt
    stage[Z_USE] = float(int(stage[Z_USE]) & use)
    d = np.empty(3)
    n2 = 0.0
    for i in range(3):
        d[i] = V[i] - stage[Z_W0 + i]
        n2 += d[i] * d[i]
        stage[Z_LATERAL] += e_y[i] * V[i]
        stage[Z_EY + i] += e_y[i]
    n2 = max(n2, 1.0)
    n = np.sqrt(n2)
    stage[Z_AIR] += n
    for i in range(3):
        stage[Z_C + i] -= d[i] / n2
    stage[Z_M] += (1.0 - 2.0 * d[0] * d[0] / n2) / n2
    stage[Z_M + 1] -= 2.0 * d[0] * d[1] / (n2 * n2)
    stage[Z_M + 2] += (1.0 - 2.0 * d[1] * d[1] / n2) / n2
    for i in range(N_PITOTS):
        if (use >> i) & 1:
            stage[Z_Z + i] += y[i] - ln_sigma - np.log(n)
    timing2 = (timing_s * noise[ACC]) ** 2
    stage[Z_TIMING2] += timing2
    stage[Z_LATERAL_VAR] += noise[R_LATERAL] - timing2
    stage[Z_COMMON] += noise[R_COMMON] - timing2 / n2
    stage[Z_OWN] += noise[R_OWN]
    stage[Z_GUST2] += noise[GUST_STD] ** 2
    stage[Z_WALK2] += walk2
    stage[Z_DOWN2] += down2


@kernel
def close(stage: Array, levels: StageLevels, row: Array) -> None:
    """Write the finished stage, sums turned into means and variances of means, to ``row`` (28,)."""
    for k in range(N_STAGE):
        row[k] = stage[k]
    N = stage[Z_N]
    for k in range(N_STAGE):
        if k in (Z_LATERAL, Z_AIR, Z_TIMING2, Z_GUST2) or k >= Z_EY:
            row[k] /= N
    timing2 = row[Z_TIMING2]
    vertical2 = 0.25 * row[Z_GUST2] * row[Z_EY + 2] ** 2
    row[Z_LATERAL_VAR] = stage[Z_LATERAL_VAR] / N**2 + timing2 + vertical2 + levels.lateral_m_s**2
    row[Z_COMMON] = stage[Z_COMMON] / N**2 + timing2 / row[Z_AIR] ** 2 + levels.common**2
    row[Z_OWN] = stage[Z_OWN] / N**2 + levels.own**2


@kernel
def gather_epoch(
    z: Gathering,
    levels: StageLevels,
    x: Array,
    P: Array,
    t: float,
    dt: float,
    V: Array,
    e_y: Array,
    y: Array,
    use: int,
    active: int,
    sound: int,
    flying_since: float,
    ln_sigma: float,
    noise: Array,
    q: Array,
) -> bool:
    """Gather one epoch; True when stages wait that the horizon is to take and decide upon.

    It starts anew from the bank's master, whose past data then are the arrival, whenever the set
    of sound pitots has changed, the stream had a gap, or the aircraft has taken off again.

    Parameters
    ----------
    x, P : (10,), (10, 10) float64
        The bank's master.
    use, active, sound : int
        Bit masks: pitots used at this epoch, those of them that are under judgement, those that
        are not faulty.
    q : (10,) float64
        Variance that the bank's states gain over the epoch; the wind's is used here too.
    """
    memory = z.memory
    broken = t - memory[G_T] > BREAK_S
    memory[G_T] = t
    changed = sound != int(memory[G_SOUND]) or flying_since != memory[G_FLYING_SINCE]
    if broken or changed or memory[G_RUNS] < 0.5:
        memory[G_SOUND], memory[G_FLYING_SINCE] = float(sound), flying_since
        memory[G_RUNS], memory[G_COUNT] = 0.0, 0.0
        if active != 0:
            memory[G_RUNS], memory[G_FRESH] = 1.0, 1.0
            for i in range(NX):
                z.x[i] = x[i]
                for j in range(NX):
                    z.P[i, j] = P[i, j]
            begin(z.open, x)
        return False
    add_epoch(z.open, t, dt, V, e_y, y, use, ln_sigma, noise, levels.timing_s, q[0], q[2])
    if z.open[Z_DT] < levels.stage_s:
        return False
    close(z.open, levels, z.closed[int(memory[G_COUNT])])
    begin(z.open, x)
    memory[G_COUNT] += 1.0
    memory[G_ACTIVE] = float(active)
    return bool(memory[G_COUNT] >= levels.solve_every)
