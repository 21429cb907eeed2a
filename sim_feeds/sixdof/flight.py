"""What a six-degree-of-freedom flight was: arrays on an even time grid, and a check of them.

The check asks whether the flight is a possible one: specific force, gravity and the earth's
rotation, integrated here with gravity and frames that are not JSBSim's, must give its velocity,
and its gyro rates must give its attitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim_feeds import earth
from sim_feeds.rotation import matrix_from_euler, rotate, rotate_back

__all__ = ["FAULT_COLUMNS", "Consistency", "SixDofFlight", "consistency"]

Floats = NDArray[np.float64]

FAULT_COLUMNS: Final = ("right.lift", "right.drag", "left.lift", "left.drag")
"""Order of :attr:`SixDofFlight.fault_percent`, as of the paper's fault vector."""


@dataclass(frozen=True, slots=True)
class SixDofFlight:
    """Truth of one flight; ``n`` rows, NED earth axes, FRD body axes.

    Attributes
    ----------
    t_s : (n,)
        From 0; before it the autopilot has settled.
    lat_rad, lon_rad, height_m : (n,)
        Geodetic, WGS84.
    ned_m : (n, 3)
        Position against the first waypoint at the commanded height.
    euler_rad : (n, 3)
        Roll, pitch, yaw.
    vel_ned_m_s : (n, 3)
        Against the ground.
    rate_rad_s : (n, 3)
        Inertial rates: what perfect gyros read.
    specific_force_m_s2 : (n, 3)
        What perfect accelerometers at the centre of gravity read.
    elevator_rad, aileron_rad, rudder_rad : (n,)
        Where the surfaces stand. Positive elevator turns the nose down, positive aileron the right
        wing, positive rudder the nose to the left.
    throttle : (n,)
        0 to 1, behind its lag.
    prop_rad_s : (n,)
        Speed of the propeller.
    wind_ned_m_s : (n, 3)
        Velocity the air moves toward, gusts included.
    mean_wind_ned_m_s : (3,)
        Its steady part.
    air_rate_rad_s : (n, 3)
        Rotation of the air around the aircraft, body axes.
    tas_m_s, aoa_rad, ssa_rad : (n,)
        True airspeed, angles of attack and sideslip (positive: wind from the right).
    density_kg_m3 : (n,)
    fault_percent : (n, 4)
        Columns ``FAULT_COLUMNS``: loss of lift, growth of drag.
    """

    t_s: Floats
    lat_rad: Floats
    lon_rad: Floats
    height_m: Floats
    ned_m: Floats
    euler_rad: Floats
    vel_ned_m_s: Floats
    rate_rad_s: Floats
    specific_force_m_s2: Floats
    elevator_rad: Floats
    aileron_rad: Floats
    rudder_rad: Floats
    throttle: Floats
    prop_rad_s: Floats
    wind_ned_m_s: Floats
    mean_wind_ned_m_s: Floats
    air_rate_rad_s: Floats
    tas_m_s: Floats
    aoa_rad: Floats
    ssa_rad: Floats
    density_kg_m3: Floats
    fault_percent: Floats

    @property
    def dt_s(self) -> float:
        """Grid spacing."""
        return float(self.t_s[1] - self.t_s[0])

    @property
    def ned_from_frd(self) -> Floats:
        """(n, 3, 3)"""
        return matrix_from_euler(*self.euler_rad.T)


@dataclass(frozen=True, slots=True)
class Consistency:
    """How far a flight is from obeying its own sensors, root mean square per axis.

    Attributes
    ----------
    velocity_m_s2 : (3,)
        Velocity gained over a window minus that integrated, per second of window.
    attitude_rad_s : (3,)
        The same of the attitude.
    """

    velocity_m_s2: Floats
    attitude_rad_s: Floats


def consistency(flight: SixDofFlight, window_s: float = 1.0) -> Consistency:
    """Compare velocity and attitude with what specific force and rates integrate to.

    The grid must be the integration's: forces in turbulence change between rows of 50 ms.
    """
    C = flight.ned_from_frd
    spin = earth.earth_rate_ned(flight.lat_rad)
    carry = earth.transport_rate_ned(flight.lat_rad, flight.height_m, flight.vel_ned_m_s)
    acc = rotate(C, flight.specific_force_m_s2)
    acc -= np.cross(2.0 * spin + carry, flight.vel_ned_m_s)
    acc[:, 2] += earth.gravity(flight.lat_rad, flight.height_m)
    dt = flight.dt_s
    span = round(window_s / dt)
    gained = np.concatenate(
        [np.zeros((1, 3)), np.cumsum((acc[1:] + acc[:-1]) * (dt / 2.0), axis=0)]
    )
    miss = flight.vel_ned_m_s - gained
    velocity = (miss[span:] - miss[:-span]) / (span * dt)

    # Rotation of each step by the mean rate, against the turn of the attitude over that step.
    rate = flight.rate_rad_s - rotate_back(C, spin + carry)
    angle = (rate[1:] + rate[:-1]) * (dt / 2.0)
    turn = np.swapaxes(C[:-1], 1, 2) @ C[1:]
    seen = 0.5 * np.stack(
        [
            turn[:, 2, 1] - turn[:, 1, 2],
            turn[:, 0, 2] - turn[:, 2, 0],
            turn[:, 1, 0] - turn[:, 0, 1],
        ],
        axis=1,
    )
    drift = np.concatenate([np.zeros((1, 3)), np.cumsum(seen - angle, axis=0)])
    attitude = (drift[span:] - drift[:-span]) / (span * dt)
    return Consistency(np.sqrt(np.mean(velocity**2, axis=0)), np.sqrt(np.mean(attitude**2, axis=0)))
