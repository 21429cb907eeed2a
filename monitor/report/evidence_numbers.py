"""Numbers of a finding out of series: values, means, differences, scatter, energy."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from monitor.report.series import Series

__all__ = [
    "coarser",
    "difference",
    "energy_height",
    "mean_over",
    "smoothed",
    "swings",
    "value_at",
]

Floats = NDArray[np.float64]

BRIDGED_S: Final = 1.5
"""An estimate is taken between two rows no farther apart than this [s]."""
SWING_S: Final = 1.0
G_M_S2: Final = 9.80665


def value_at(series: Series | None, t_s: float | Floats) -> Any:
    """Middle of a series at other moments, linear between its points; NaN across gaps.

    Parameters
    ----------
    series : Series or None
    t_s : float or (n,) float64 [s]

    Returns
    -------
    float or (n,) float64
    """
    at = np.atleast_1d(np.asarray(t_s, np.float64))
    out = np.full(at.shape, np.nan)
    good = np.isfinite(series.middle) if series is not None else np.zeros(0, np.bool_)
    if series is not None and good.any():
        t, y = series.t_s[good], series.middle[good]
        after = np.searchsorted(t, at)
        left, right = np.clip(after - 1, 0, len(t) - 1), np.clip(after, 0, len(t) - 1)
        near = np.minimum(np.abs(at - t[left]), np.abs(at - t[right])) <= 0.5 * BRIDGED_S
        between = (after > 0) & (after < len(t)) & (t[right] - t[left] <= BRIDGED_S)
        out = np.where(near | between, np.interp(at, t, y), np.nan)
    return out if np.ndim(t_s) else float(out[0])


def mean_over(series: Series | None, from_s: float, to_s: float) -> float:
    """Mean of a series between two moments; NaN where it has no value there."""
    if series is None:
        return math.nan
    inside = (series.t_s >= from_s) & (series.t_s <= to_s) & np.isfinite(series.middle)
    return float(series.middle[inside].mean()) if inside.any() else math.nan


def difference(measured: Series | None, expected: Series | None) -> Series | None:
    """Measured less expected at the moments of the measurement; None where there is none.

    The extremes of each tenth of a second stay: of a scattering sensor the difference scatters.
    """
    if measured is None or expected is None:
        return None
    should = value_at(expected, measured.t_s)
    low, high = measured.low - should, measured.high - should
    if not np.isfinite(low).any():
        return None
    return Series(measured.t_s, low, high, measured.unit)


def swings(measured: Series | None) -> Series | None:
    """Greatest less least value within the second before each moment; None without any.

    What scatters or swings shows here without any expectation of it.
    """
    if measured is None or not np.isfinite(measured.low).any():
        return None
    good = np.isfinite(measured.low)
    t, low, high = measured.t_s[good], measured.low[good], measured.high[good]
    first = np.searchsorted(t, t - SWING_S, side="right")
    last = np.arange(1, len(t) + 1)
    pairs = np.column_stack([first, last]).ravel()
    least = np.minimum.reduceat(np.append(low, np.inf), pairs)[::2]
    most = np.maximum.reduceat(np.append(high, -np.inf), pairs)[::2]
    return Series(t, most - least, most - least, measured.unit)


def smoothed(series: Series | None) -> Series | None:
    """Mean of a measurement's middles over the second before each moment; None without any.

    It is what is left of vibration, which hides a bias in the samples themselves; and nothing shows
    in it before it happened.
    """
    if series is None or not np.isfinite(series.low).any():
        return None
    good = np.isfinite(series.low)
    t, y = series.t_s[good], series.middle[good]
    first = np.searchsorted(t, t - SWING_S, side="right")
    last = np.arange(1, len(t) + 1)
    sums = np.concatenate(([0.0], np.cumsum(y)))
    mean = (sums[last] - sums[first]) / (last - first)
    return Series(t, mean, mean, series.unit)


def coarser(series: Series | None, points: int) -> Series | None:
    """A series of so many points at most; those joined keep their least and greatest value."""
    if series is None or len(series) <= points:
        return series
    begin = np.arange(0, len(series), -(-len(series) // points))
    low, high = np.fmin.reduceat(series.low, begin), np.fmax.reduceat(series.high, begin)
    return Series(series.t_s[begin], low, high, series.unit)


def energy_height(altitude: Series | None, speed: Series | None) -> Series | None:
    """Height that the aircraft would reach by giving up its speed; None without either.

    Parameters
    ----------
    altitude : Series [m]
    speed : Series [m/s]
    """
    if altitude is None or speed is None:
        return None
    v = value_at(speed, altitude.t_s)
    height = altitude.middle + v * v / (2.0 * G_M_S2)
    return Series(altitude.t_s, height, height, "m") if np.isfinite(height).any() else None
