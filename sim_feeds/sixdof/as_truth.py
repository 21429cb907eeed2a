"""A six-degree-of-freedom flight as the truth that instruments and messages are sampled from.

Whatever flies, :class:`sim_feeds.trajectory.Truth` is what :mod:`sim_feeds.sensors` reads: with it
every instrument, fault and pressure tube of the kinematic vehicle works on these flights, too.
"""

from __future__ import annotations

import numpy as np

from sim_feeds import earth
from sim_feeds.rotation import quaternion_from_matrix, rotate, rotate_back
from sim_feeds.sixdof.flight import SixDofFlight
from sim_feeds.sixdof.vehicle import VehicleFlight
from sim_feeds.trajectory import Truth

__all__ = ["as_truth"]


def as_truth(flight: SixDofFlight | VehicleFlight, *, field_m: float = 0.0) -> Truth:
    """Truth on the grid of the flight.

    Parameters
    ----------
    flight
        With a row at each step of the integration: instruments interpolate between rows.
    field_m
        Height of the ground.
    """
    C = flight.ned_from_frd
    lat, height, vel = flight.lat_rad, flight.height_m, flight.vel_ned_m_s
    turning = 2.0 * earth.earth_rate_ned(lat) + earth.transport_rate_ned(lat, height, vel)
    acc = rotate(C, flight.specific_force_m_s2) - np.cross(turning, vel)
    acc[:, 2] += earth.gravity(lat, height)
    air_ned = vel - flight.wind_ned_m_s
    static, temperature = earth.static_pressure(height), earth.temperature(height)
    impact = earth.impact_pressure(flight.tas_m_s, static, temperature)
    climb = -air_ned[:, 2] / flight.tas_m_s
    return Truth(
        t_s=flight.t_s,
        lat_rad=lat,
        lon_rad=flight.lon_rad,
        height_m=height,
        agl_m=height - field_m,
        vel_ned_m_s=vel,
        acc_ned_m_s2=acc,
        ned_from_frd=C,
        q_ned_from_frd=quaternion_from_matrix(C),
        euler_rad=flight.euler_rad,
        specific_force_m_s2=flight.specific_force_m_s2,
        rate_rad_s=flight.rate_rad_s,
        wind_ned_m_s=flight.wind_ned_m_s,
        air_frd_m_s=rotate_back(C, air_ned),
        tas_m_s=flight.tas_m_s,
        cas_m_s=earth.calibrated_airspeed(impact),
        aoa_rad=flight.aoa_rad,
        ssa_rad=flight.ssa_rad,
        static_pa=static,
        impact_pa=impact,
        temperature_k=temperature,
        thrust_acc_m_s2=np.gradient(flight.tas_m_s, flight.dt_s)
        + earth.STANDARD_GRAVITY_M_S2 * climb,
        airborne=np.ones_like(flight.t_s),
    )
