"""A simple autopilot for a small aircraft: waypoints, height and airspeed hold.

It flies on the truth, as the paper's state feedback does. Loops are proportional-integral and
closed one inside the other: course -> bank -> aileron, height -> pitch -> elevator, airspeed ->
throttle; the rudder damps the yaw beyond the rate of a coordinated turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan, atan2, cos, hypot, pi, radians, sin, tan
from typing import Final

from sim_feeds.earth import STANDARD_GRAVITY_M_S2 as G0

__all__ = ["AEROSONDE_GAINS", "Commands", "Gains", "Pilot", "Seen"]


@dataclass(frozen=True, slots=True)
class Gains:
    """Of one aircraft; commands are -1..1 (surfaces) and 0..1 (throttle).

    Attributes
    ----------
    course_rad_m
        Course error asked for per metre beside the leg, for small offsets.
    course_1_s
        Rate of turn per course error.
    bank_limit_rad, bank_rate_rad_s, pitch_limit_rad
        Of the commands.
    aileron_per_rad, aileron_per_rad_s, aileron_per_rad_integral
        On bank error, roll rate, integral of bank error.
    climb_1_s
        Climb rate asked for per metre of height error.
    pitch_per_m_s, pitch_per_m
        On the climb rate's error and its integral.
    elevator_per_rad, elevator_per_rad_s, elevator_per_rad_integral
        On pitch error, pitch rate, integral of pitch error.
    throttle_trim, throttle_per_m_s, throttle_per_m
        On airspeed error and its integral.
    rudder_per_rad_s
        On yaw rate beyond the coordinated turn's.
    """

    course_rad_m: float
    course_1_s: float
    bank_limit_rad: float
    bank_rate_rad_s: float
    pitch_limit_rad: float
    aileron_per_rad: float
    aileron_per_rad_s: float
    aileron_per_rad_integral: float
    climb_1_s: float
    pitch_per_m_s: float
    pitch_per_m: float
    elevator_per_rad: float
    elevator_per_rad_s: float
    elevator_per_rad_integral: float
    throttle_trim: float
    throttle_per_m_s: float
    throttle_per_m: float
    rudder_per_rad_s: float


AEROSONDE_GAINS: Final = Gains(
    course_rad_m=0.012,
    course_1_s=0.8,
    bank_limit_rad=radians(30.0),
    bank_rate_rad_s=radians(30.0),
    pitch_limit_rad=radians(15.0),
    aileron_per_rad=1.2,
    aileron_per_rad_s=0.0,
    aileron_per_rad_integral=0.6,
    climb_1_s=0.35,
    pitch_per_m_s=0.035,
    pitch_per_m=0.012,
    elevator_per_rad=1.0,
    elevator_per_rad_s=0.3,
    elevator_per_rad_integral=1.5,
    throttle_trim=0.55,
    throttle_per_m_s=0.08,
    throttle_per_m=0.02,
    rudder_per_rad_s=0.4,
)
CLIMB_LIMIT_M_S: Final = 3.0
SLOW: Final = 0.9
GLIDE: Final = 2.0
"""Below this share of the airspeed height is given up for it: sink per missing airspeed."""
ROLL_IN_S: Final = 0.7
"""Time that rolling into a turn costs."""
SHARPEST: Final = 2.4
"""Corner beyond which a turn begins no earlier [rad]."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What the autopilot steers by: SI and rad, position against the origin of the waypoints."""

    north_m: float
    east_m: float
    height_m: float
    vel_n_m_s: float
    vel_e_m_s: float
    climb_m_s: float
    roll: float
    pitch: float
    p: float
    q: float
    r: float
    tas_m_s: float


@dataclass(frozen=True, slots=True)
class Commands:
    """Positive: nose down, right wing down, nose left; throttle 0..1."""

    elevator: float
    aileron: float
    rudder: float
    throttle: float


@dataclass
class Pilot:
    """Flies round a closed list of waypoints.

    Parameters
    ----------
    gains
    waypoints_m
        North and east; the last leg leads back to the first.
    height_m, tas_m_s
        To hold.
    dt_s
        Between calls.
    """

    gains: Gains
    waypoints_m: Sequence[tuple[float, float]]
    height_m: float
    tas_m_s: float
    dt_s: float
    _next: int = 0
    _bank_asked: float = 0.0
    _aileron_trim: float = 0.0
    _pitch_trim: float = 0.0
    _elevator_trim: float = 0.0
    _throttle_trim: float = 0.0

    def steer(self, seen: Seen) -> Commands:
        """Commands for the next ``dt_s``."""
        g, dt = self.gains, self.dt_s
        change = self._bank(seen) - self._bank_asked
        self._bank_asked += _clip(change, g.bank_rate_rad_s * dt)
        error = self._bank_asked - seen.roll
        self._aileron_trim = _clip(
            self._aileron_trim + g.aileron_per_rad_integral * error * dt, 1.0
        )
        aileron = g.aileron_per_rad * error + self._aileron_trim - g.aileron_per_rad_s * seen.p

        climb = _clip(g.climb_1_s * (self.height_m - seen.height_m), CLIMB_LIMIT_M_S)
        climb -= GLIDE * max(SLOW * self.tas_m_s - seen.tas_m_s, 0.0)
        slow = climb - seen.climb_m_s
        self._pitch_trim = _clip(self._pitch_trim + g.pitch_per_m * slow * dt, g.pitch_limit_rad)
        pitch = _clip(g.pitch_per_m_s * slow + self._pitch_trim, g.pitch_limit_rad)
        error = pitch - seen.pitch
        self._elevator_trim = _clip(
            self._elevator_trim + g.elevator_per_rad_integral * error * dt, 1.0
        )
        # The rate of pitch in a level turn is no error.
        turn = G0 / max(seen.tas_m_s, 5.0) * tan(_clip(seen.roll, 1.2))
        elevator = -(
            g.elevator_per_rad * error
            + self._elevator_trim
            - g.elevator_per_rad_s * (seen.q - turn * sin(seen.roll))
        )

        error = self.tas_m_s - seen.tas_m_s
        throttle = g.throttle_trim + g.throttle_per_m_s * error + self._throttle_trim
        if 0.0 < throttle < 1.0 or error * (throttle - 0.5) < 0.0:
            self._throttle_trim += g.throttle_per_m * error * dt

        rudder = g.rudder_per_rad_s * (seen.r - turn * cos(seen.roll))
        return Commands(
            _clip(elevator, 1.0),
            _clip(aileron, 1.0),
            _clip(rudder, 1.0),
            min(max(throttle, 0.0), 1.0),
        )

    def _bank(self, seen: Seen) -> float:
        """Bank that brings the course over ground onto the leg."""
        g = self.gains
        speed = hypot(seen.vel_n_m_s, seen.vel_e_m_s)
        leg, ahead, beside, corner = self._leg(seen)
        radius = speed**2 / (G0 * tan(g.bank_limit_rad))
        if ahead < radius * tan(min(corner, SHARPEST) / 2.0) + speed * ROLL_IN_S:
            self._next = (self._next + 1) % len(self.waypoints_m)
            leg, _, beside, _ = self._leg(seen)
        wanted = leg - atan(g.course_rad_m * beside)
        turn = g.course_1_s * _wrapped(wanted - atan2(seen.vel_e_m_s, seen.vel_n_m_s))
        return _clip(atan(speed * turn / G0), g.bank_limit_rad)

    def _leg(self, seen: Seen) -> tuple[float, float, float, float]:
        """Direction of the leg, way to its end, offset to its right, and the corner after it."""
        n0, e0 = self.waypoints_m[self._next - 1]
        n1, e1 = self.waypoints_m[self._next]
        n2, e2 = self.waypoints_m[(self._next + 1) % len(self.waypoints_m)]
        leg = atan2(e1 - e0, n1 - n0)
        north, east = seen.north_m - n1, seen.east_m - e1
        ahead = -cos(leg) * north - sin(leg) * east
        beside = cos(leg) * east - sin(leg) * north
        return leg, ahead, beside, abs(_wrapped(atan2(e2 - e1, n2 - n1) - leg))


def _clip(x: float, limit: float) -> float:
    return min(max(x, -limit), limit)


def _wrapped(angle: float) -> float:
    return (angle + pi) % (2.0 * pi) - pi
