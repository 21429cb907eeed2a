"""Noise levels that an aircraft shows in flight, measured without a filter.

==============  ===================================================================  ====
name            measurement                                                          unit
==============  ===================================================================  ====
gps_noise_m_s   white noise of the receiver's horizontal velocity: second            m/s
                differences, less those of the autopilot's velocity at the same
                times, which are flight
baro_noise_m    white noise of pressure height: second differences                   m
pitot_apart     median of ln(airspeed0 / airspeed1): how far two installations are   1
                apart
==============  ===================================================================  ====

Of white noise s the second difference of equally spaced samples has the variance 6 s^2. Each noise
is the upper quartile over blocks of 10 s: three quarters of the flight are quieter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from links.samples import Rows

__all__ = ["LevelMeter"]

Array = NDArray[np.float64]

BLOCK_US = 10_000_000
QUARTILE = 0.75
TOGETHER_US = 60_000
"""Samples of two pitots nearer than this felt the same gust."""
LEAST_CAS_M_S = 5.0
M_PER_LN_PA = 8435.0
"""Scale height of the standard atmosphere at sea level: R T / g at 288.15 K [m]."""

_FIELDS = {
    "gps0": "vel_ned_m_s",
    "nav": "vel_ned_m_s",
    "baro0": "static_press_pa",
    "airspeed0": "cas_m_s",
    "airspeed1": "cas_m_s",
}


class LevelMeter:
    """Keeps the few columns that levels are measured on, until the flight is over."""

    def __init__(self) -> None:
        self._times: dict[str, list[NDArray[np.int64]]] = {}
        self._values: dict[str, list[Array]] = {}

    def feed(self, rows: Mapping[str, Rows]) -> None:
        """Use rows in order of arrival."""
        for sensor, column in _FIELDS.items():
            new = rows.get(sensor)
            if new is not None and len(new):
                self._times.setdefault(sensor, []).append(new["t_us"].copy())
                self._values.setdefault(sensor, []).append(new[column].copy())

    def levels(self, spans: Sequence[tuple[int, int]]) -> dict[str, float]:
        """Every level that could be measured, by name.

        Parameters
        ----------
        spans
            When the aircraft flew: (from, to) in vehicle time [us].
        """
        found = {
            "gps_noise_m_s": self._gps_noise(spans),
            "baro_noise_m": self._baro_noise(spans),
            "pitot_apart": self._pitot_apart(spans),
        }
        return {name: level for name, level in found.items() if level is not None}

    def _series(self, sensor: str) -> tuple[NDArray[np.int64], Array] | None:
        """Times that rise, and their values."""
        if sensor not in self._times:
            return None
        t, v = np.concatenate(self._times[sensor]), np.concatenate(self._values[sensor])
        t, first = np.unique(t, return_index=True)
        return t, v[first]

    def _gps_noise(self, spans: Sequence[tuple[int, int]]) -> float | None:
        gps, nav = self._series("gps0"), self._series("nav")
        if gps is None or nav is None:
            return None
        t, velocity = gps
        excess = np.zeros(max(len(t) - 2, 0))
        for axis in range(2):
            flown = np.interp(t, nav[0], nav[1][:, axis])
            excess += 0.5 * (np.diff(velocity[:, axis], 2) ** 2 - np.diff(flown, 2) ** 2) / 6.0
        return _upper(t, excess, spans)

    def _baro_noise(self, spans: Sequence[tuple[int, int]]) -> float | None:
        baro = self._series("baro0")
        if baro is None:
            return None
        t, pressure = baro
        height = -M_PER_LN_PA * np.log(np.maximum(pressure, 1.0))
        return _upper(t, np.diff(height, 2) ** 2 / 6.0, spans)

    def _pitot_apart(self, spans: Sequence[tuple[int, int]]) -> float | None:
        one, other = self._series("airspeed0"), self._series("airspeed1")
        if one is None or other is None:
            return None
        near = np.clip(np.searchsorted(other[0], one[0]), 1, len(other[0]) - 1)
        near -= one[0] - other[0][near - 1] < other[0][near] - one[0]
        a, b = one[1], other[1][near]
        use = (np.abs(other[0][near] - one[0]) < TOGETHER_US) & _inside(one[0], spans)
        use &= (a > LEAST_CAS_M_S) & (b > LEAST_CAS_M_S)
        return float(abs(np.median(np.log(a[use] / b[use])))) if use.any() else None


def _inside(t: NDArray[np.int64], spans: Sequence[tuple[int, int]]) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = np.zeros(len(t), np.bool_)
    for start_us, end_us in spans:
        inside |= (t >= start_us) & (t < end_us)
    return inside


def _upper(t: NDArray[np.int64], variance: Array, spans: Sequence[tuple[int, int]]) -> float | None:
    """Root of the upper quartile of the block means of a variance, None without a block.

    Parameters
    ----------
    t : (n,) int64 [us]
    variance : (n - 2,) float64
        One for each triple of samples; those unevenly spaced are left out.
    """
    dt = np.diff(t)
    even = np.abs(np.diff(dt)) < 0.2 * dt[1:]
    use = even & np.isfinite(variance) & _inside(t[1:-1], spans)
    if not use.any():
        return None
    _, block = np.unique(t[1:-1][use] // BLOCK_US, return_inverse=True)
    mean = np.bincount(block, variance[use]) / np.bincount(block)
    return float(np.sqrt(max(np.quantile(mean, QUARTILE), 0.0)))
