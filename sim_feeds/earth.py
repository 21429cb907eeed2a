"""The rotating spherical earth and the standard atmosphere that the synthetic vehicle lives in.

Written from the papers and kept apart from the estimators' model on purpose: a mistake in one of
the two then shows as a disagreement instead of cancelling.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "EARTH_RADIUS_M",
    "EARTH_RATE_RAD_S",
    "STANDARD_GRAVITY_M_S2",
    "calibrated_airspeed",
    "density",
    "earth_rate_ned",
    "gravity",
    "impact_pressure",
    "impact_pressure_of_cas",
    "static_pressure",
    "temperature",
    "transport_rate_ned",
    "true_airspeed",
    "true_airspeed_of_cas",
]

Floats = NDArray[np.float64]

EARTH_RADIUS_M: Final = 6_367_000.0
"""R_e of lu2016, below eq. (11)."""
EARTH_RATE_RAD_S: Final = 7.2921e-5
"""Omega of lu2016, below eq. (11)."""
STANDARD_GRAVITY_M_S2: Final = 9.80665

SEA_LEVEL_PRESSURE_PA: Final = 101_325.0
SEA_LEVEL_TEMPERATURE_K: Final = 288.15
LAPSE_K_M: Final = -6.5e-3
GAS_CONSTANT: Final = 287.053
"""Of dry air [J/(kg K)]."""
HEAT_RATIO: Final = 1.4


def gravity(lat_rad: ArrayLike, height_m: ArrayLike) -> Floats:
    """Gravity (with the centrifugal part) at geodetic latitude and height [m/s^2].

    Source: lu2016 eq. (12).
    """
    s1, s2 = np.sin(lat_rad), np.sin(2.0 * np.asarray(lat_rad))
    shrink = (EARTH_RADIUS_M / (EARTH_RADIUS_M + np.asarray(height_m))) ** 2
    return np.asarray(9.780318 * shrink * (1.0 + 5.3024e-3 * s1**2 - 5.9e-6 * s2**2))


def earth_rate_ned(lat_rad: ArrayLike) -> Floats:
    """Rotation of the earth against inertial space, in NED axes, (n, 3) [rad/s]."""
    lat = np.asarray(lat_rad, dtype=float)
    zero = np.zeros_like(lat)
    return EARTH_RATE_RAD_S * np.stack([np.cos(lat), zero, -np.sin(lat)], axis=-1)


def transport_rate_ned(lat_rad: ArrayLike, height_m: ArrayLike, vel_ned_m_s: Floats) -> Floats:
    """Rotation of the NED frame against the earth while the vehicle moves, (n, 3) [rad/s]."""
    radius = EARTH_RADIUS_M + np.asarray(height_m, dtype=float)
    north, east = vel_ned_m_s[..., 0], vel_ned_m_s[..., 1]
    return np.stack(
        [east / radius, -north / radius, -east * np.tan(np.asarray(lat_rad)) / radius], axis=-1
    )


def temperature(height_m: ArrayLike, offset_k: float = 0.0) -> Floats:
    """Static temperature of the standard troposphere, shifted by ``offset_k`` [K]."""
    return np.asarray(SEA_LEVEL_TEMPERATURE_K + LAPSE_K_M * np.asarray(height_m) + offset_k)


def static_pressure(height_m: ArrayLike) -> Floats:
    """Static pressure of the standard troposphere [Pa].

    Differs: wan2018 eq. (16) prints the exponent without its unit; -g/(R L) = +5.256 with the lapse
    rate L in K per metre.
    """
    exponent = -STANDARD_GRAVITY_M_S2 / (GAS_CONSTANT * LAPSE_K_M)
    ratio = temperature(height_m) / SEA_LEVEL_TEMPERATURE_K
    return np.asarray(SEA_LEVEL_PRESSURE_PA * ratio**exponent)


def density(height_m: ArrayLike, offset_k: float = 0.0) -> Floats:
    """Air density [kg/m^3]."""
    return np.asarray(static_pressure(height_m) / (GAS_CONSTANT * temperature(height_m, offset_k)))


def impact_pressure(tas_m_s: ArrayLike, pressure_pa: ArrayLike, temperature_k: ArrayLike) -> Floats:
    """Total minus static pressure of subsonic compressible flow [Pa]."""
    mach2 = np.square(tas_m_s) / (HEAT_RATIO * GAS_CONSTANT * np.asarray(temperature_k))
    return np.asarray(np.asarray(pressure_pa) * ((1.0 + 0.2 * mach2) ** 3.5 - 1.0))


def calibrated_airspeed(impact_pa: ArrayLike) -> Floats:
    """Airspeed that has this impact pressure at sea level; no impact pressure reads zero [m/s]."""
    sound2 = HEAT_RATIO * GAS_CONSTANT * SEA_LEVEL_TEMPERATURE_K
    ratio = np.maximum(impact_pa, 0.0) / SEA_LEVEL_PRESSURE_PA
    return np.asarray(np.sqrt(5.0 * sound2 * ((1.0 + ratio) ** (2.0 / 7.0) - 1.0)))


def true_airspeed(impact_pa: ArrayLike, pressure_pa: ArrayLike, temperature_k: ArrayLike) -> Floats:
    """Inverse of :func:`impact_pressure` [m/s]."""
    ratio = np.asarray(impact_pa) / np.asarray(pressure_pa)
    mach2 = 5.0 * ((1.0 + ratio) ** (2.0 / 7.0) - 1.0)
    return np.asarray(np.sqrt(mach2 * HEAT_RATIO * GAS_CONSTANT * np.asarray(temperature_k)))


def impact_pressure_of_cas(cas_m_s: ArrayLike) -> Floats:
    """Inverse of :func:`calibrated_airspeed` for non-negative airspeeds [Pa]."""
    return impact_pressure(cas_m_s, SEA_LEVEL_PRESSURE_PA, SEA_LEVEL_TEMPERATURE_K)


def true_airspeed_of_cas(cas_m_s: ArrayLike, height_m: ArrayLike) -> Floats:
    """True airspeed at which a calibrated one is read at this height [m/s]."""
    impact = impact_pressure_of_cas(cas_m_s)
    return true_airspeed(impact, static_pressure(height_m), temperature(height_m))
