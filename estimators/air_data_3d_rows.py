"""Short memories of attitude, navigation velocity and pitots, to read them at a GPS sample's time.

===========  ========================================================  ============  ===============
symbol       meaning                                                   shape         unit
===========  ========================================================  ============  ===============
ring         the last RING samples of a stream, oldest overwritten     (RING, cols)  column 0: t [s]
count        samples ever pushed into a ring                           int64         1
pending      GPS epochs that wait for the samples around them          (QUEUE, 4)    s, m/s
===========  ========================================================  ============  ===============
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimators.air_data_3d import N_PITOTS
from estimators.attitude import dcm_from_quaternion, normalised
from estimators.jit import kernel

__all__ = [
    "QUEUE",
    "RING",
    "Rings",
    "axes_at",
    "mean_pitot",
    "nav_at",
    "new_rings",
    "push",
]

Array = NDArray[np.float64]

RING = 128
QUEUE = 16

ATTITUDE_GAP_S = 1.5
"""Attitudes further apart than this are not interpolated: a turn may hide between them."""
PITOT_WINDOW_S = 0.11
PITOT_REACH_S = 0.6
"""A pitot sample further away than this says nothing about the epoch."""
NAV_REACH_S = 1.0


class Rings(NamedTuple):
    """Short memories; arrays are changed in place.

    Attributes
    ----------
    attitude : (RING, 5) float64 [s, 1]
        Time and ``ned_from_frd`` quaternion.
    nav : (RING, 4) float64 [s, m/s]
        Time and velocity of the autopilot.
    pitot : (3, RING, 2) float64 [s, m/s]
        Time and calibrated airspeed.
    pushed : (5,) int64
        Samples pushed: attitude, nav, three pitots.
    """

    attitude: Array
    nav: Array
    pitot: Array
    pushed: NDArray[np.int64]


def new_rings() -> Rings:
    """Empty memories."""
    return Rings(
        np.zeros((RING, 5)),
        np.zeros((RING, 4)),
        np.zeros((N_PITOTS, RING, 2)),
        np.zeros(2 + N_PITOTS, np.int64),
    )


@kernel
def push(ring: Array, count: NDArray[np.int64], which: int) -> Array:
    """The row of a ring to write the next sample into; counts it."""
    row: Array = ring[count[which] % RING]
    count[which] += 1
    return row


@kernel
def _before(ring: Array, count: int, t: float) -> int:
    """Arrival number of the newest sample not after t; -1 when the memory does not reach back."""
    for back in range(1, min(count, RING) + 1):
        if ring[(count - back) % RING, 0] <= t:
            return count - back
    return -1


@kernel
def axes_at(rings: Rings, t: float, E: Array) -> bool:
    """Write the body axes in NED at time t; False when no two attitudes bracket it.

    Parameters
    ----------
    E : (3, 3) float64 [1]
        Receives the nose, right wing and floor direction, each in a row: frd_from_ned.
    """
    count = rings.pushed[0]
    k = _before(rings.attitude, count, t)
    if k < 0 or k + 1 >= count:
        return False
    a, b = rings.attitude[k % RING], rings.attitude[(k + 1) % RING]
    gap = b[0] - a[0]
    if gap > ATTITUDE_GAP_S:
        return False
    s = (t - a[0]) / gap
    dot = a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]
    sign = 1.0 if dot >= 0.0 else -1.0
    q = np.empty(4)
    for i in range(4):
        q[i] = (1.0 - s) * a[1 + i] + sign * s * b[1 + i]
    R = dcm_from_quaternion(normalised(q))
    if np.isnan(R[0, 0]):
        return False
    for i in range(3):
        for j in range(3):
            E[i, j] = R[j, i]
    return True


@kernel
def nav_at(rings: Rings, t: float, v: Array) -> bool:
    """Write the autopilot's velocity at time t; False when it has none near.

    Parameters
    ----------
    v : (3,) float64 [m/s]
    """
    count = rings.pushed[1]
    k = _before(rings.nav, count, t)
    if k < 0 or t - rings.nav[k % RING, 0] > NAV_REACH_S:
        return False
    a = rings.nav[k % RING]
    b = rings.nav[(k + 1) % RING] if k + 1 < count else a
    gap = b[0] - a[0]
    s = (t - a[0]) / gap if gap > 0.0 else 0.0
    for i in range(3):
        v[i] = (1.0 - s) * a[1 + i] + s * b[1 + i]
    return True


@kernel
def mean_pitot(rings: Rings, i: int, t: float) -> float:
    """What pitot i showed around time t [m/s]: the mean nearby, else the nearest; NaN if none."""
    count = rings.pushed[2 + i]
    total, n = 0.0, 0
    nearest, reach = math.nan, PITOT_REACH_S
    for back in range(1, min(count, RING) + 1):
        sample = rings.pitot[i, (count - back) % RING]
        distance = abs(sample[0] - t)
        if distance <= PITOT_WINDOW_S:
            total += sample[1]
            n += 1
        if distance < reach:
            nearest, reach = sample[1], distance
        if sample[0] < t - PITOT_REACH_S:
            break
    return total / n if n > 0 else nearest
