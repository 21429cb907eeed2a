"""A small aircraft that answers its controls: forces of the air, rotation, motion over the earth.

The flights of :mod:`sim_feeds.trajectory` follow a plan whatever anyone steers. Here forces and
moments follow from the state, so that a wrong reading in an autopilot's loop moves the aircraft.

==========  ====================================================  =========  =====================
symbol      meaning                                               unit       equation
==========  ====================================================  =========  =====================
V, a, b     airspeed, angle of attack, of sideslip                m/s, rad   of the air in FRD
P           lift slope of the load factor, sigma V^2 / k          1/rad      (1)
n           load factor of the lift, P (a - a0)                   1          (1)
S           sigma V^2 over its value at cruise                    1          (2)
A           specific force in FRD                                 m/s^2      (2)-(4)
T           thrust per mass                                       m/s^2
p, q, r     rates against inertial space, as gyros read them      rad/s      (5)-(7)
da          aileron, as the roll rate it ends in                  rad/s      (5)
de          elevator, as the angle of attack it trims             rad        (6)
dr          rudder, as the sideslip it trims                      rad        (7)
==========  ====================================================  =========  =====================

    n   = P (a - a0),                      P = sigma V^2 / k                              (1)
    A_x = T - D cos a + g0 n sin a,        D = g0 (S + n^2 / S) / (2 L/D)                 (2)
    A_y = -Y P g0 b                                                                       (3)
    A_z = -D sin a - g0 n cos a                                                           (4)
    p'  = (da - p) / t_p - dihedral w_b^2 b                                               (5)
    q'  = w_a^2 (de - a) - 2 z_a w_a q                                                    (6)
    r'  = w_b^2 (b - dr) - 2 z_b w_b r                                                    (7)

k, a0, w_a, z_a, w_b, z_b and the dihedral are the airframe's (:mod:`sim_feeds.airframe`). Controls
and thrust follow their commands with a lag. Velocity, attitude and position move over the turning
earth exactly as :mod:`sim_feeds.earth` has it; the state is carried by classical Runge-Kutta steps.

Plain floats: this is stepped some ten thousand times a flight, one step at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import asin, atan2, cos, sin, sqrt, tan
from typing import Final, NamedTuple

from sim_feeds import earth
from sim_feeds.airframe import Airframe

__all__ = ["Controls", "Motion", "Vehicle"]

G0: Final = earth.STANDARD_GRAVITY_M_S2
GLIDE: Final = 14.0
"""Best lift over drag, at cruise."""
SIDE_SHARE: Final = 0.3
"""Y: slope of the side force over that of the lift."""
ROLL_LAG_S: Final = 0.5
SURFACE_LAG_S: Final = 0.05
ENGINE_LAG_S: Final = 1.5
SEA_LEVEL_DENSITY: Final = float(earth.density(0.0))
STILL_M_S: Final = 1.0
"""The air's forces end below this airspeed."""

Wind = tuple[float, float, float]
_UN, _UE, _UD, _PHI, _THETA, _PSI, _P, _Q, _R, _T, _DA, _DE, _DR, _LAT, _H = range(15)


class Controls(NamedTuple):
    """What an autopilot asks for; units as in the table above."""

    aileron_rad_s: float
    elevator_rad: float
    rudder_rad: float
    thrust_m_s2: float


class Motion(NamedTuple):
    """What is so at one moment.

    Attributes
    ----------
    x : [U_N U_E U_D phi theta psi]
    air : [u v w], velocity against the air in FRD
    flow : [V alpha beta]
    u : [A_x A_y A_z p q r]
    place : latitude [rad] and height [m]
    """

    x: tuple[float, ...]
    air: tuple[float, float, float]
    flow: tuple[float, float, float]
    u: tuple[float, ...]
    place: tuple[float, float]


@dataclass
class Vehicle:
    """One aircraft in flight.

    Attributes
    ----------
    airframe
        Lift curve and modes.
    state
        [U_N U_E U_D phi theta psi p q r T da de dr latitude height].
    """

    airframe: Airframe
    state: list[float]
    _sigma: float = field(default=1.0, init=False)
    _gravity: float = field(default=G0, init=False)

    def __post_init__(self) -> None:
        self._look_around()

    @staticmethod
    def trimmed(
        airframe: Airframe,
        speed_m_s: float,
        height_m: float,
        heading_rad: float,
        wind: Wind = (0.0, 0.0, 0.0),
        lat_rad: float = 0.9,
    ) -> Vehicle:
        """Straight and level through the air, everything at rest."""
        s = [0.0] * 15
        s[_LAT], s[_H] = lat_rad, height_m
        vehicle = Vehicle(airframe, s)
        pressure, share = vehicle._pressure(speed_m_s)
        alpha = airframe.zero_lift_aoa_rad + 1.0 / pressure
        for _ in range(3):  # the thrust carries a little of the weight
            drag, lift = vehicle._drag_and_lift(pressure, share, alpha)
            thrust = (drag * cos(alpha) - lift * sin(alpha)) + G0 * sin(alpha)
            alpha += (G0 * cos(alpha) - drag * sin(alpha) - lift * cos(alpha)) / (G0 * pressure)
        s[_UN] = speed_m_s * cos(heading_rad) + wind[0]
        s[_UE] = speed_m_s * sin(heading_rad) + wind[1]
        s[_UD] = wind[2]
        s[_THETA], s[_PSI] = alpha, heading_rad
        s[_DE], s[_T] = alpha, thrust
        return vehicle

    def controls(self) -> Controls:
        """Where the controls are."""
        s = self.state
        return Controls(s[_DA], s[_DE], s[_DR], s[_T])

    def load_slope(self, speed_m_s: float) -> float:
        """P of (1) at this height [1/rad]."""
        return self._pressure(speed_m_s)[0]

    def motion(self, wind: Wind, felt: Wind) -> Motion:
        """What is so now.

        Parameters
        ----------
        wind
            At the nose, where the flow is measured.
        felt
            Averaged over wing and tail, which make the forces.
        """
        s = self.state
        air, flow, _ = self._air(s, wind)
        _, _, force = self._air(s, felt)
        x = (s[_UN], s[_UE], s[_UD], s[_PHI], s[_THETA], s[_PSI])
        return Motion(x, air, flow, (*force, s[_P], s[_Q], s[_R]), (s[_LAT], s[_H]))

    def step(self, command: Controls, winds: tuple[Wind, Wind, Wind], dt_s: float) -> None:
        """Move on under held commands; the felt wind at the start, the middle and the end."""
        s = self.state
        k1 = self._rates(s, command, winds[0])
        k2 = self._rates(_ahead(s, k1, 0.5 * dt_s), command, winds[1])
        k3 = self._rates(_ahead(s, k2, 0.5 * dt_s), command, winds[1])
        k4 = self._rates(_ahead(s, k3, dt_s), command, winds[2])
        h = dt_s / 6.0
        self.state = [
            x + h * (a + 2.0 * (b + c) + d) for x, a, b, c, d in zip(s, k1, k2, k3, k4, strict=True)
        ]
        self._look_around()

    def _look_around(self) -> None:
        """Density and gravity here; they hold for a step."""
        lat, height = self.state[_LAT], self.state[_H]
        self._sigma = float(earth.density(height) / SEA_LEVEL_DENSITY)
        self._gravity = float(earth.gravity(lat, height))

    def _pressure(self, speed_m_s: float) -> tuple[float, float]:
        """P and S."""
        a = self.airframe
        square = self._sigma * speed_m_s * speed_m_s
        return square / a.lift_constant, square / (a.cruise_m_s * a.cruise_m_s)

    def _drag_and_lift(self, pressure: float, share: float, alpha: float) -> tuple[float, float]:
        n = pressure * (alpha - self.airframe.zero_lift_aoa_rad)
        return G0 * (share + n * n / share) / (2.0 * GLIDE), G0 * n

    def _air(
        self, s: list[float], wind: Wind
    ) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
        """Air velocity in FRD, [V alpha beta], specific force: (1)-(4)."""
        north, east, down = s[_UN] - wind[0], s[_UE] - wind[1], s[_UD] - wind[2]
        sp, cp, st, ct = sin(s[_PHI]), cos(s[_PHI]), sin(s[_THETA]), cos(s[_THETA])
        ss, cs = sin(s[_PSI]), cos(s[_PSI])
        ahead, right = cs * north + ss * east, cs * east - ss * north
        below = st * ahead + ct * down
        u, v, w = ct * ahead - st * down, cp * right + sp * below, cp * below - sp * right
        V = sqrt(u * u + v * v + w * w)
        if V < STILL_M_S:
            return (u, v, w), (V, 0.0, 0.0), (s[_T], 0.0, 0.0)
        alpha, beta = atan2(w, u), asin(v / V)
        pressure, share = self._pressure(V)
        drag, lift = self._drag_and_lift(pressure, share, alpha)
        sa, ca = sin(alpha), cos(alpha)
        side = -SIDE_SHARE * pressure * G0 * beta
        force = (s[_T] - drag * ca + lift * sa, side, -drag * sa - lift * ca)
        return (u, v, w), (V, alpha, beta), force

    def _rates(self, s: list[float], c: Controls, wind: Wind) -> list[float]:
        """Derivative of the state."""
        a = self.airframe
        _, (_, alpha, beta), (ax, ay, az) = self._air(s, wind)
        sp, cp, st, ct = sin(s[_PHI]), cos(s[_PHI]), sin(s[_THETA]), cos(s[_THETA])
        ss, cs = sin(s[_PSI]), cos(s[_PSI])
        un, ue, ud = s[_UN], s[_UE], s[_UD]
        lat, radius = s[_LAT], earth.EARTH_RADIUS_M + s[_H]
        # rotation of the earth and of the local level frame, in NED
        carry_n, carry_e, carry_d = ue / radius, -un / radius, -ue * tan(lat) / radius
        spin_n, spin_d = earth.EARTH_RATE_RAD_S * cos(lat), -earth.EARTH_RATE_RAD_S * sin(lat)
        bend_n, bend_e, bend_d = 2.0 * spin_n + carry_n, carry_e, 2.0 * spin_d + carry_d
        # specific force in NED, through heading axes
        below = sp * ay + cp * az
        ahead, right = ct * ax + st * below, cp * ay - sp * az
        # rates against the level frame, through heading axes
        turn_n, turn_e, turn_d = spin_n + carry_n, carry_e, spin_d + carry_d
        level_ahead, level_right = cs * turn_n + ss * turn_e, cs * turn_e - ss * turn_n
        level_below = st * level_ahead + ct * turn_d
        p = s[_P] - (ct * level_ahead - st * turn_d)
        q = s[_Q] - (cp * level_right + sp * level_below)
        r = s[_R] - (cp * level_below - sp * level_right)
        yaw_rate = (q * sp + r * cp) / ct
        wa, wb = a.short_period_rad_s, a.weathercock_rad_s
        return [
            cs * ahead - ss * right - (bend_e * ud - bend_d * ue),
            ss * ahead + cs * right - (bend_d * un - bend_n * ud),
            ct * below - st * ax + self._gravity - (bend_n * ue - bend_e * un),
            p + yaw_rate * st,
            q * cp - r * sp,
            yaw_rate,
            (s[_DA] - s[_P]) / ROLL_LAG_S - a.dihedral * wb * wb * beta,
            wa * (wa * (s[_DE] - alpha) - 2.0 * a.short_period_damping * s[_Q]),
            wb * (wb * (beta - s[_DR]) - 2.0 * a.weathercock_damping * s[_R]),
            (c.thrust_m_s2 - s[_T]) / ENGINE_LAG_S,
            (c.aileron_rad_s - s[_DA]) / SURFACE_LAG_S,
            (c.elevator_rad - s[_DE]) / SURFACE_LAG_S,
            (c.rudder_rad - s[_DR]) / SURFACE_LAG_S,
            un / radius,
            -ud,
        ]


def _ahead(s: list[float], rates: list[float], dt_s: float) -> list[float]:
    return [x + dt_s * r for x, r in zip(s, rates, strict=True)]
