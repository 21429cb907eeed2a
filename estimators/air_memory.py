"""The wind in three dimensions while the pitots agree, and what it is now if they no longer do.

=========  ==================================================================  ==========
symbol     meaning                                                             unit
=========  ==================================================================  ==========
wind       the horizon's wind NED, one entry a stage                           m/s
W_ref      its mean over MEAN stages, DELAY stages ago, while all agreed       m/s
rate       its trend then, and the variance of the trends of the last minute   m/s^2
agreed     stage in which all agreed last                                      1
k          stages since the horizon started                                    1
=========  ==================================================================  ==========

A memory without a trend is seconds behind a wind that changes steadily, and blames the sound sensor
that shows the change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_mhe_3d import CAS, Horizon
from estimators.air_vote_record import STAGE_S
from estimators.jit import kernel
from estimators.wind_memory import TREND_TAU_S, extrapolated, roll_back, trend

__all__ = ["HISTORY", "WindMemory", "forget", "new_memory", "remember", "restore", "wind_at"]

Array = NDArray[np.float64]

HISTORY = 1200
"""Stages of wind that are kept (120 s)."""
DELAY, MEAN = 10, 20
HORIZON_LAG_S = 1.0
"""Time by which the horizon's wind is behind a ramp [s]."""
LAG_S = (DELAY + MEAN) * STAGE_S + HORIZON_LAG_S
"""Time by which W_ref is behind a ramp [s]."""


class WindMemory(NamedTuple):
    """All that is remembered of the wind, updated in place."""

    wind: Array  # (3, HISTORY)
    W_ref: Array  # (3,)
    rate: Array  # (2, 3): trend, and the variance of trends
    agreed: Array  # (1,)


def new_memory() -> WindMemory:
    """A memory of still air."""
    return WindMemory(np.zeros((3, HISTORY)), np.zeros(3), np.zeros((2, 3)), np.zeros(1))


@kernel
def forget(m: WindMemory) -> None:
    """Begin anew, in still air."""
    m.W_ref[:] = 0.0
    m.rate[:, :] = 0.0
    m.agreed[0] = 0.0


@kernel
def wind_at(m: WindMemory, a: int, k: float) -> float:
    """Component ``a`` of the wind in stage ``k``, by the wind and its trend when all agreed."""
    since_s = LAG_S + max(k - m.agreed[0], -DELAY) * STAGE_S if m.agreed[0] > 0.0 else 0.0
    wind: float = extrapolated(m.W_ref[a], m.rate[0, a], since_s)
    return wind


@kernel
def remember(m: WindMemory, k: int, change: float, change_down: float) -> None:
    """Take stage ``k``, in which all agree, into the memory; at first as the wind comes.

    A trend that promises more than the allowed ``change`` [m/s] is none: what all pitots do faster
    together is not the wind's doing, and the memory must not follow.
    """
    if k <= DELAY:
        return
    m.agreed[0] = k
    newest = k - DELAY
    gain = 1.0 / min(newest + 1.0, MEAN)
    for a in range(3):
        m.W_ref[a] += gain * (m.wind[a, newest % HISTORY] - m.W_ref[a])
        rate, m.rate[1, a] = trend(
            m.wind[a], newest, min(newest + 1, HISTORY - DELAY), STAGE_S, m.rate[1, a]
        )
        most = (change if a < 2 else change_down) / TREND_TAU_S
        m.rate[0, a] = rate if abs(rate) <= most else 0.0


@kernel
def restore(
    m: WindMemory, z: Horizon, k: int, left: bool, asked: Array, bound: float, base: int,
    change: float, gust_m_s: float,
) -> None:  # fmt: skip
    """Put the horizontal wind back to what it would be without the culprits' readings.

    What was estimated since all agreed was the culprits' wind, and no band may rest on it.

    Parameters
    ----------
    k : int
        Stage.
    left : bool
        Whether a pitot is left. Then the wind went on by its trend, and from when all agreed until
        now by ``asked`` (2,) [m/s] besides, which that pitot asks for; else it returns to before
        the onset (:func:`estimators.wind_memory.roll_back`, which takes ``bound``, ``base`` and
        ``change``) and stays there.
    gust_m_s : float
        Its standard deviation.
    """
    newest = z.x.shape[0] - 1
    agreed = int(m.agreed[0])
    if not left:
        if k > 20:
            for a in range(2):
                m.W_ref[a] = roll_back(
                    m.wind[a], (k - 1) % HISTORY, min(k, HISTORY), STAGE_S, bound, base, change
                )
        m.rate[:, :] = 0.0
    for i in range(max(agreed - DELAY, k - HISTORY + 1, 0), k):
        share = max(i - agreed, 0) / max(k - agreed, 1)
        for a in range(2):
            m.wind[a, i % HISTORY] = wind_at(m, a, i) + share * asked[a]
    for a in range(2):
        w = 3 + a
        z.x_prior[w] = wind_at(m, a, k) + asked[a]
        for i in range(newest + 1):
            z.x[i, w] = z.x_prior[w]
        for b in range(z.P.shape[0]):
            z.P[w, b] = 0.0
            z.P[b, w] = 0.0
        z.P[w, w] = gust_m_s**2
    for i in range(newest + 1):
        z.use[i, CAS] = 0.0
        if i < newest:
            z.u[i, 3] = 0.0
            z.u[i, 4] = 0.0
