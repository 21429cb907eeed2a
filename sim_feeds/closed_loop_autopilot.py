"""A simple autopilot that steers on an IMU: rates and accelerations in the inner loops.

Its readings may be wrong, and then so is its flying. Like the baseline controller of lu2016's
simulator it holds airspeed, load factor with pitch rate, roll rate and sideslip by PI loops; an
outer loop turns a bank and a climb rate into these.

==========  ====================================================  ========================
symbol      meaning                                               reading used
==========  ====================================================  ========================
n_c         load factor that bank and climb rate ask for          phi, theta, U_D
q_c, r_c    rates of a coordinated turn at that load factor       phi, theta
de          elevator: trim at n_c, PI on n, P on q                A_z, q
da          aileron: p_c = K (phi_c - phi), PI on p               phi, p
dr          rudder: integral of the side force, damping of r      A_y, r
T           thrust: PI on airspeed, damping of the acceleration   V, A_x, theta
==========  ====================================================  ========================

The readings come as :class:`Steering`; where they come from is the business of the loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, sin
from typing import Final, NamedTuple

from sim_feeds.closed_loop_vehicle import G0, SIDE_SHARE, Controls, Vehicle

__all__ = ["Autopilot", "Order", "Steering"]

BANK_PER_S: Final = 0.8
CLIMB_PER_S: Final = 0.5
CLIMB_ACC_M_S2: Final = 2.0
"""How fast an ordered climb rate is approached."""
LOAD_LIMIT: Final = 0.5
"""Largest change of the load factor that the climb may ask for."""
LOAD_PER_S: Final = 0.8
PITCH_S: Final = 0.5
ROLL_GAIN: Final = 0.6
ROLL_PER_S: Final = 0.8
SIDE_PER_S: Final = 0.4
YAW_S: Final = 0.8
SPEED_PER_S: Final = 0.25
SPEED_PER_S2: Final = 0.02
BRAKE: Final = 0.5


@dataclass(frozen=True, slots=True)
class Order:
    """From ``start_s`` on: a bank and a climb rate."""

    start_s: float
    bank_rad: float = 0.0
    climb_m_s: float = 0.0


class Steering(NamedTuple):
    """What the autopilot takes for true.

    Attributes
    ----------
    x : [U_N U_E U_D phi theta psi]
    u : [A_x A_y A_z p q r]
    tas_m_s : airspeed
    """

    x: Sequence[float]
    u: Sequence[float]
    tas_m_s: float


@dataclass
class Autopilot:
    """Steers one vehicle along its orders.

    Attributes
    ----------
    vehicle
        Its trim at the beginning is where the loops begin.
    orders
        Ascending in time; before the first, straight and level.
    speed_m_s
        Airspeed to hold.
    """

    vehicle: Vehicle
    orders: Sequence[Order]
    speed_m_s: float
    _bank: float = field(default=0.0, init=False)
    _climb: float = field(default=0.0, init=False)
    _load: float = field(default=0.0, init=False)
    _roll: float = field(default=0.0, init=False)
    _side: float = field(default=0.0, init=False)
    _speed: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._trim = self.vehicle.controls()

    def steer(self, t_s: float, seen: Steering, dt_s: float) -> Controls:
        """Commands until the next reading."""
        order = Order(0.0)
        for given in self.orders:
            if given.start_s <= t_s:
                order = given
        rate = self.vehicle.airframe.bank_rate_rad_s
        self._bank += _within(order.bank_rad - self._bank, rate * dt_s)
        self._climb += _within(order.climb_m_s - self._climb, CLIMB_ACC_M_S2 * dt_s)

        _, _, down, phi, theta, _ = seen.x
        ax, ay, az, p, q, r = seen.u
        V = max(seen.tas_m_s, 0.3 * self.speed_m_s)
        slope = self.vehicle.load_slope(V)
        level = cos(theta) / max(cos(phi), 0.5)
        n_c = level + _within(CLIMB_PER_S * (self._climb + down) / G0, LOAD_LIMIT)
        q_c = G0 / V * (n_c - cos(theta) * cos(phi))
        r_c = G0 / V * cos(theta) * sin(phi)

        n_error = n_c + az / G0
        self._load += LOAD_PER_S * n_error * dt_s
        elevator = self.vehicle.airframe.zero_lift_aoa_rad + (n_c + self._load) / slope
        elevator += PITCH_S * (q_c - q)

        p_error = BANK_PER_S * (self._bank - phi) - p
        self._roll += ROLL_PER_S * p_error * dt_s
        aileron = p + p_error * (1.0 + ROLL_GAIN) + self._roll

        self._side += SIDE_PER_S * ay / (SIDE_SHARE * slope * G0) * dt_s
        rudder = self._side + YAW_S * (r - r_c)

        slow = self.speed_m_s - seen.tas_m_s
        self._speed += SPEED_PER_S2 * slow * dt_s
        thrust = self._trim.thrust_m_s2 + SPEED_PER_S * slow + self._speed
        thrust -= BRAKE * (ax - G0 * sin(theta))
        return Controls(aileron, elevator, rudder, thrust)


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
