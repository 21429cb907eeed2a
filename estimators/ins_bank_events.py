"""One stream of events out of several sensors' rows, each in order already.

A merge of sorted rows takes a fraction of the time of sorting them, and at 200 Hz the samples are
nearly all that is read of a log.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.jit import kernel

__all__ = ["merge", "within"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@kernel
def within(values: Array, acc_limit: float, gyro_limit: float) -> NDArray[np.bool_]:
    """Which samples an IMU can have measured: finite, and below its limits.

    Parameters
    ----------
    values : (n, m) float64 [m/s^2, rad/s]
        Specific force, angular rate; further columns do not matter.
    acc_limit, gyro_limit : float [m/s^2, rad/s]

    Returns
    -------
    (n,) bool
    """
    good = np.empty(values.shape[0], np.bool_)
    for i in range(values.shape[0]):
        believed = True
        for k in range(3):
            believed &= abs(values[i, k]) < acc_limit
            believed &= abs(values[i, 3 + k]) < gyro_limit
        good[i] = believed
    return good


@kernel
def merge(
    t_us: Ints, seq: Ints, values: Array, edge: Ints, kinds: Ints
) -> tuple[Array, Ints, Array]:
    """Events in (time, arrival) order.

    Parameters
    ----------
    t_us, seq : (n,) int64 [us, 1]
        Times and arrival numbers, sensor after sensor, each sensor's in (time, arrival) order.
    values : (n, m) float64
    edge : (s + 1,) int64
        Where each sensor's rows begin, and n.
    kinds : (s,) int64
        Kind of each sensor's events.

    Returns
    -------
    t_s : (n,) float64 [s]
    kind : (n,) int64
    values : (n, m) float64
    """
    n, m = values.shape
    out_t, out_kind, out = np.empty(n), np.empty(n, np.int64), np.empty((n, m))
    head = edge[:-1].copy()
    for e in range(n):
        first = -1
        for s in range(kinds.shape[0]):
            i = head[s]
            if i < edge[s + 1]:
                j = head[first] if first >= 0 else i
                sooner = t_us[i] < t_us[j] or (t_us[i] == t_us[j] and seq[i] < seq[j])
                if first < 0 or sooner:
                    first = s
        i = head[first]
        head[first] += 1
        out_t[e] = t_us[i] * 1e-6
        out_kind[e] = kinds[first]
        for k in range(m):
            out[e, k] = values[i, k]
    return out_t, out_kind, out
