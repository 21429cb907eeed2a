"""Manoeuvres, one after another, turned into smooth profiles of the path through the air.

A :class:`FlightPlan` is written as a chain of manoeuvres; each appends its steps and ramps to the
profiles of airspeed, climb angle, heading and wing-borne fraction, starting where the last one
ended::

    plan = FlightPlan(AIRFRAMES["transport"], speed_m_s=120.0, height_m=1500.0)
    plan.level(10.0).turn(radians(90.0), bank_rad=radians(25.0)).load_doublet(0.4).level(5.0)
"""

from __future__ import annotations

from math import asin, radians, tan
from typing import Final, Self

from sim_feeds.airframe import Airframe
from sim_feeds.earth import STANDARD_GRAVITY_M_S2 as G0
from sim_feeds.profile import PEAK_SLOPE, Profile

__all__ = ["FlightPlan"]

CLIMB_LOAD_STEP_G: Final = 0.2
"""Load factor above or below one when a climb or descent begins or ends."""
MAX_CLIMB: Final = 0.7
"""Largest share of the airspeed that goes up or down."""
MAX_PUSH_OVER_RAD: Final = radians(70.0)
"""Largest swing of the climb angle in a push-over."""
ROTATION_SPEED: Final = 0.95
"""Share of the time of the take-off run after which the wings begin to carry."""


class FlightPlan:
    """Profiles of a flight that grows by one manoeuvre at a time.

    Parameters
    ----------
    airframe
        Gives accelerations, bank rate and speeds.
    speed_m_s
        True airspeed at the start; 0 means standing on the ground.
    height_m
        Height above the sphere at the start.
    heading_rad
        Direction of the path through the air (of the runway, on the ground).
    """

    def __init__(
        self,
        airframe: Airframe,
        speed_m_s: float = 0.0,
        height_m: float = 0.0,
        heading_rad: float = 0.0,
    ) -> None:
        self.airframe = airframe
        self.start_height_m = height_m
        self.time_s = 0.0
        self.speed = Profile(speed_m_s)
        self.climb = Profile(0.0)
        self.heading = Profile(heading_rad)
        self.airborne = Profile(1.0 if speed_m_s > 0.0 else 0.0)
        self.landings: list[tuple[float, float]] = []
        """Start and touch-down time of each descent to the ground."""
        self.takeoffs_s: list[float] = []
        self._speed = speed_m_s
        self._climb = 0.0
        self._flying = speed_m_s > 0.0

    def level(self, duration_s: float) -> Self:
        """Keep speed, climb angle and heading (also: wait on the ground)."""
        self.time_s += duration_s
        return self

    def change_speed(self, speed_m_s: float, acc_m_s2: float | None = None) -> Self:
        """Accelerate or slow down along the path to a true airspeed."""
        change = speed_m_s - self._speed
        if not change:
            return self
        acc = acc_m_s2 or self.airframe.cruise_acc_m_s2
        rise = min(2.0, abs(change) / acc)
        duration = abs(change) / acc + rise
        slope = acc if change > 0 else -acc
        self.speed.trapezoid(self.time_s, self.time_s + duration, rise, slope)
        self._speed = speed_m_s
        self.time_s += duration
        return self

    def climb_at(self, rate_m_s: float, duration_s: float) -> Self:
        """Climb at a vertical speed (negative: descend), entry and exit included; ends level."""
        if abs(rate_m_s) > MAX_CLIMB * self._speed:
            raise ValueError(
                f"{rate_m_s:g} m/s is too steep a climb at an airspeed of {self._speed:g} m/s"
            )
        angle = asin(rate_m_s / self._speed)
        rise = self._pitch_over_s(angle)
        if duration_s < 2.0 * rise:
            raise ValueError(
                f"a climb at {rate_m_s:g} m/s needs at least {2 * rise:.1f} s to begin and end, "
                f"not {duration_s:g} s"
            )
        self.climb.step(self.time_s, rise, angle)
        self.climb.step(self.time_s + duration_s - rise, rise, -angle)
        self.time_s += duration_s
        return self

    def turn(self, angle_rad: float, bank_rad: float = radians(25.0)) -> Self:
        """Coordinated level turn; positive to the right."""
        rate = G0 * tan(bank_rad) / self._speed
        rise = PEAK_SLOPE * bank_rad / self.airframe.bank_rate_rad_s
        size = abs(angle_rad)
        if size < rate * rise:
            rate = size / rise
        hold = size / rate - rise
        duration = 2.0 * rise + hold
        self.heading.trapezoid(
            self.time_s, self.time_s + duration, rise, rate if angle_rad > 0 else -rate
        )
        self.time_s += duration
        return self

    def orbit(self, duration_s: float, bank_rad: float = radians(25.0)) -> Self:
        """Turn for a time: to the right, or with a negative bank to the left."""
        size = abs(bank_rad)
        rate = G0 * tan(size) / self._speed
        rise = PEAK_SLOPE * size / self.airframe.bank_rate_rad_s
        if duration_s < 2.0 * rise:
            raise ValueError(f"a turn at this bank needs at least {2 * rise:.1f} s")
        self.heading.trapezoid(
            self.time_s, self.time_s + duration_s, rise, rate if bank_rad > 0 else -rate
        )
        self.time_s += duration_s
        return self

    def load_doublet(self, load_g: float, pulse_s: float = 2.0) -> Self:
        """Pull ``load_g`` above one g for a time, then push as much below, back to level."""
        rise = PEAK_SLOPE * abs(load_g) / self.airframe.load_step_g_s
        return self._loads([(load_g, pulse_s + rise), (-load_g, pulse_s + rise)], rise)

    def push_over(self, weightless_s: float = 4.0, pull_g: float = 0.6) -> Self:
        """Pull up, coast weightless, pull out: a parabola symmetric about its top."""
        rise = PEAK_SLOPE / self.airframe.load_step_g_s
        weightless = weightless_s + rise
        if weightless * G0 / self._speed > MAX_PUSH_OVER_RAD:
            longest = MAX_PUSH_OVER_RAD * self._speed / G0 - rise
            raise ValueError(f"at this speed a push-over can last {longest:.1f} s at most")
        pull = weightless / (2.0 * pull_g)
        return self._loads([(pull_g, pull), (-1.0, weightless), (pull_g, pull)], rise)

    def take_off(self, speed_m_s: float | None = None, climb_m_s: float | None = None) -> Self:
        """Roll, rotate and climb out; ends level, airborne, at ``speed_m_s``."""
        if self._flying:
            raise ValueError("the aircraft is already flying: no take-off before a landing")
        target = speed_m_s or 1.15 * self.airframe.approach_m_s
        acc = self.airframe.takeoff_acc_m_s2
        roll_start = self.time_s
        self.change_speed(target, acc)
        lift_off = roll_start + (self.time_s - roll_start) * ROTATION_SPEED
        rise = 2.0 * self.airframe.surge_s**0.5
        self.airborne.step(lift_off, rise, 1.0)
        self.takeoffs_s.append(lift_off + 0.5 * rise)
        self._flying = True
        self.time_s = lift_off + rise
        climb = climb_m_s or 0.1 * target
        return self.climb_at(climb, 2.0 * self._pitch_over_s(asin(climb / target)) + 5.0)

    def land(self, sink_m_s: float | None = None, descent_s: float = 30.0) -> Self:
        """Slow to approach speed, descend to the ground, flare, roll out to a stop."""
        if not self._flying:
            raise ValueError("the aircraft is on the ground: no landing before a take-off")
        speed = min(self._speed, self.airframe.approach_m_s)
        self.change_speed(speed)
        start = self.time_s
        sink = sink_m_s or 0.06 * speed
        self.climb_at(-sink, descent_s)
        self.landings.append((start, self.time_s))
        rise = 2.0 * self.airframe.surge_s**0.5
        self.airborne.step(self.time_s, rise, -1.0)
        self.time_s += rise
        self._flying = False
        return self.change_speed(0.0, 0.6 * self.airframe.takeoff_acc_m_s2)

    def _pitch_over_s(self, angle_rad: float) -> float:
        """Time for a change of climb angle that keeps the load factor within its step."""
        curve = PEAK_SLOPE * abs(angle_rad) * self._speed
        return max(1.0, curve / (CLIMB_LOAD_STEP_G * G0))

    def _loads(self, pulses: list[tuple[float, float]], rise_s: float) -> Self:
        """Load factors above one, each held for a time (rise and half of the fall included)."""
        level = 0.0
        for load, duration in [*pulses, (0.0, 0.0)]:
            self.climb.ramp(self.time_s, rise_s, (load - level) * G0 / self._speed)
            level = load
            self.time_s += duration
        self.time_s += rise_s
        return self
