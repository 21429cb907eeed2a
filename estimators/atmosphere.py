"""Standard atmosphere, the three airspeeds, gravity: scalar kernels, SI.

===========  ========================================================  ======  =====================
symbol       meaning                                                   unit    equation
===========  ========================================================  ======  =====================
H            geopotential altitude in the standard atmosphere          m       ISO 2533
T, p, rho    temperature, static pressure, density                     K, Pa,  T = T0 - L H, perfect
                                                                       kg/m^3  gas
sigma_rho    sqrt(rho / rho0), so that EAS = sigma_rho TAS             1
q_c          impact pressure, total minus static                       Pa      isentropic, M < 1
TAS          true airspeed: against the air                            m/s
CAS          calibrated airspeed: what q_c means at sea level,         m/s     isentropic
             compressible; what an airspeed sensor shows
EAS          equivalent airspeed: incompressible, sea level density    m/s
===========  ========================================================  ======  =====================

ArduPilot's and PX4's "airspeed" is ``sqrt(2 q_c / rho0)``, the incompressible reading of the same
q_c: above the CAS by M^2/8, 0.3 % at 50 m/s, 1.1 % at 100 m/s (:func:`cas_from_indicated`).
Valid from -2 km to 20 km (troposphere and the isothermal layer above 11 km).
"""

from __future__ import annotations

import math

from estimators.jit import kernel

__all__ = [
    "EARTH_RADIUS_M",
    "EARTH_RATE_RAD_S",
    "P0_PA",
    "RHO0_KG_M3",
    "altitude_from_pressure",
    "cas_from_impact_pressure",
    "cas_from_indicated",
    "cas_from_tas",
    "density",
    "eas_from_cas",
    "gravity",
    "impact_pressure_from_cas",
    "pressure",
    "sigma_rho",
    "sigma_rho_from_pressure",
    "tas_from_cas",
    "temperature",
]

# ISO 2533
T0_K = 288.15
P0_PA = 101325.0
LAPSE_K_M = 0.0065
R_AIR = 287.05287  # J/(kg K)
G0_M_S2 = 9.80665
GAMMA_AIR = 1.4
TROPOPAUSE_M = 11000.0
RHO0_KG_M3 = P0_PA / (R_AIR * T0_K)
SOUND0_M_S = math.sqrt(GAMMA_AIR * R_AIR * T0_K)

T11_K = T0_K - LAPSE_K_M * TROPOPAUSE_M
EXPONENT = G0_M_S2 / (LAPSE_K_M * R_AIR)
P11_PA = P0_PA * math.pow(T11_K / T0_K, EXPONENT)
SCALE11_M = R_AIR * T11_K / G0_M_S2

# lu2016, below eq. (11); a spherical earth
EARTH_RADIUS_M = 6_367_000.0
EARTH_RATE_RAD_S = 7.2921e-5


@kernel
def temperature(altitude_m: float) -> float:
    """Standard temperature [K] at a geopotential altitude."""
    return max(T0_K - LAPSE_K_M * altitude_m, T11_K)


@kernel
def pressure(altitude_m: float) -> float:
    """Standard static pressure [Pa] at a geopotential altitude."""
    if altitude_m <= TROPOPAUSE_M:
        return P0_PA * math.pow(1.0 - LAPSE_K_M * altitude_m / T0_K, EXPONENT)
    return P11_PA * math.exp((TROPOPAUSE_M - altitude_m) / SCALE11_M)


@kernel
def altitude_from_pressure(static_pa: float) -> float:
    """Pressure altitude [m]: where the standard atmosphere has this static pressure."""
    if static_pa >= P11_PA:
        return T0_K / LAPSE_K_M * (1.0 - math.pow(static_pa / P0_PA, 1.0 / EXPONENT))
    return TROPOPAUSE_M - SCALE11_M * math.log(static_pa / P11_PA)


@kernel
def density(static_pa: float, temperature_k: float) -> float:
    """Density of dry air [kg/m^3] from static pressure and outside air temperature."""
    return static_pa / (R_AIR * temperature_k)


@kernel
def sigma_rho(altitude_m: float) -> float:
    """``sqrt(rho / rho0)`` of the standard atmosphere at an altitude: EAS = sigma_rho TAS."""
    return math.sqrt(density(pressure(altitude_m), temperature(altitude_m)) / RHO0_KG_M3)


@kernel
def sigma_rho_from_pressure(static_pa: float) -> float:
    """``sqrt(rho / rho0)`` with the standard temperature that belongs to a static pressure.

    For vehicles without an outside air thermometer: the temperature that barometers report is that
    of their circuit board.
    """
    return sigma_rho(altitude_from_pressure(static_pa))


@kernel
def impact_pressure_from_cas(cas_m_s: float) -> float:
    """Impact pressure [Pa] that a pitot tube feels at a calibrated airspeed below Mach 1."""
    mach2 = (cas_m_s / SOUND0_M_S) ** 2
    return P0_PA * math.expm1(3.5 * math.log1p(0.2 * mach2))


@kernel
def cas_from_impact_pressure(impact_pa: float) -> float:
    """Calibrated airspeed [m/s] of an impact pressure; zero when that is not positive."""
    if not impact_pa > 0.0:
        return 0.0
    return SOUND0_M_S * math.sqrt(5.0 * math.expm1(math.log1p(impact_pa / P0_PA) / 3.5))


@kernel
def cas_from_indicated(indicated_m_s: float) -> float:
    """Calibrated airspeed [m/s] of an autopilot's ``sqrt(2 q_c / rho0)``."""
    return cas_from_impact_pressure(0.5 * RHO0_KG_M3 * indicated_m_s * indicated_m_s)


@kernel
def tas_from_cas(cas_m_s: float, static_pa: float, temperature_k: float) -> float:
    """True airspeed [m/s] from calibrated airspeed, static pressure, outside air temperature."""
    impact_ratio = impact_pressure_from_cas(cas_m_s) / static_pa
    mach2 = 5.0 * math.expm1(math.log1p(impact_ratio) / 3.5)
    return math.sqrt(mach2 * GAMMA_AIR * R_AIR * temperature_k)


@kernel
def cas_from_tas(tas_m_s: float, static_pa: float, temperature_k: float) -> float:
    """Calibrated airspeed [m/s] from true airspeed, static pressure, outside air temperature."""
    mach2 = tas_m_s * tas_m_s / (GAMMA_AIR * R_AIR * temperature_k)
    return cas_from_impact_pressure(static_pa * math.expm1(3.5 * math.log1p(0.2 * mach2)))


@kernel
def eas_from_cas(cas_m_s: float, static_pa: float) -> float:
    """Equivalent airspeed [m/s] from calibrated airspeed: the compressibility correction."""
    impact_ratio = impact_pressure_from_cas(cas_m_s) / static_pa
    mach2 = 5.0 * math.expm1(math.log1p(impact_ratio) / 3.5)
    return math.sqrt(mach2 * GAMMA_AIR * static_pa / RHO0_KG_M3)


@kernel
def gravity(latitude_rad: float, altitude_m: float) -> float:
    """Gravity [m/s^2] on the turning earth at a geodetic latitude and an altitude.

    Source: lu2016 eq. (12). It contains the centrifugal acceleration, which the kinematic models
    therefore leave out.
    """
    s2 = math.sin(latitude_rad) ** 2
    s22 = math.sin(2.0 * latitude_rad) ** 2
    scale = EARTH_RADIUS_M / (EARTH_RADIUS_M + altitude_m)
    return 9.780318 * scale * scale * (1.0 + 5.3024e-3 * s2 - 5.9e-6 * s22)
