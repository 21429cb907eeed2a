"""The manoeuvres and winds of a scenario file, as validated sections.

A leg names its manoeuvre with ``do``, a wind component its shape with ``kind``.
"""

from __future__ import annotations

from math import radians
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sim_feeds import wind as winds
from sim_feeds.flightplan import FlightPlan
from sim_feeds.section import Strict
from sim_feeds.von_karman import VonKarman

__all__ = ["Leg", "WindPart"]


class Wait(Strict):
    """Stay as it is: parked, or straight and level."""

    do: Literal["wait", "level"]
    duration_s: float = Field(gt=0.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.level(self.duration_s)


class TakeOff(Strict):
    """Roll, rotate, climb out, level off."""

    do: Literal["take-off"]
    speed_m_s: float | None = Field(None, gt=0.0, description="True airspeed of the climb-out.")
    climb_m_s: float | None = Field(None, gt=0.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.take_off(self.speed_m_s, self.climb_m_s)


class Speed(Strict):
    """Change the true airspeed."""

    do: Literal["speed"]
    speed_m_s: float = Field(gt=0.0)
    acc_m_s2: float | None = Field(None, gt=0.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.change_speed(self.speed_m_s, self.acc_m_s2)


class Climb(Strict):
    """Climb, or descend at a negative rate, and level off."""

    do: Literal["climb"]
    rate_m_s: float
    duration_s: float = Field(gt=0.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.climb_at(self.rate_m_s, self.duration_s)


class Turn(Strict):
    """Coordinated turn by an angle, to the right when positive."""

    do: Literal["turn"]
    angle_deg: float
    bank_deg: float = Field(25.0, gt=0.0, lt=70.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.turn(radians(self.angle_deg), radians(self.bank_deg))


class Orbit(Strict):
    """Turn for a time; a negative bank turns left."""

    do: Literal["orbit"]
    duration_s: float = Field(gt=0.0)
    bank_deg: float = Field(25.0, gt=-70.0, lt=70.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.orbit(self.duration_s, radians(self.bank_deg))


class Doublet(Strict):
    """Pull and push by a load factor."""

    do: Literal["load-doublet"]
    load_g: float = Field(gt=-1.5, lt=1.5)
    pulse_s: float = Field(2.0, gt=0.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.load_doublet(self.load_g, self.pulse_s)


class PushOver(Strict):
    """A parabola: weightless between two pulls."""

    do: Literal["push-over"]
    weightless_s: float = Field(4.0, gt=0.0)
    pull_g: float = Field(0.6, gt=0.0, lt=1.5)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.push_over(self.weightless_s, self.pull_g)


class Land(Strict):
    """Slow down, descend, touch down, roll out."""

    do: Literal["land"]
    sink_m_s: float | None = Field(None, gt=0.0)
    descent_s: float = Field(30.0, gt=0.0)

    def fly(self, plan: FlightPlan) -> None:
        """Append to the plan."""
        plan.land(self.sink_m_s, self.descent_s)


Leg = Annotated[
    Wait | TakeOff | Speed | Climb | Turn | Orbit | Doublet | PushOver | Land,
    Field(discriminator="do"),
]


class ConstantWind(Strict):
    """The same everywhere and always."""

    kind: Literal["constant"]
    speed_m_s: float = Field(ge=0.0)
    toward_deg: float = Field(description="Direction the air moves toward.")
    down_m_s: float = 0.0

    def component(self) -> winds.Component:
        """The wind model."""
        return winds.Constant(winds.toward(self.speed_m_s, self.toward_deg, self.down_m_s))


class RampWind(Strict):
    """A smooth change between two times."""

    kind: Literal["ramp"]
    start_s: float = Field(ge=0.0)
    end_s: float = Field(gt=0.0)
    north_m_s: float = 0.0
    east_m_s: float = 0.0
    down_m_s: float = 0.0

    def component(self) -> winds.Component:
        """The wind model."""
        change = np.array([self.north_m_s, self.east_m_s, self.down_m_s])
        return winds.Ramp(self.start_s, self.end_s, change)


class GustWind(Strict):
    """A 1-cosine gust."""

    kind: Literal["gust"]
    start_s: float = Field(ge=0.0)
    rise_s: float = Field(1.0, gt=0.0)
    hold_s: float = Field(0.0, ge=0.0)
    north_m_s: float = 0.0
    east_m_s: float = 0.0
    down_m_s: float = 0.0

    def component(self) -> winds.Component:
        """The wind model."""
        peak = np.array([self.north_m_s, self.east_m_s, self.down_m_s])
        return winds.Gust(self.start_s, self.rise_s, self.hold_s, peak)


class ShearWind(Strict):
    """Grows with height up to a reference height."""

    kind: Literal["shear"]
    speed_m_s: float = Field(ge=0.0, description="At the reference height and above.")
    toward_deg: float = Field(description="Direction the air moves toward.")
    reference_m: float = Field(300.0, gt=0.0)
    exponent: float = Field(0.15, ge=0.0, le=1.0)

    def component(self) -> winds.Component:
        """The wind model."""
        aloft = winds.toward(self.speed_m_s, self.toward_deg)
        return winds.HeightShear(aloft, self.reference_m, self.exponent)


class Turbulence(Strict):
    """Dryden turbulence of MIL-F-8785C, or with fixed intensity and scale."""

    kind: Literal["dryden"]
    wind_6m_m_s: float = Field(7.7, ge=0.0, description="Mean wind at 20 ft; 7.7 is light.")
    high_std_m_s: float = Field(1.5, ge=0.0, description="Intensity above 2000 ft.")
    fixed_std_m_s: float | None = Field(None, ge=0.0)
    fixed_scale_m: float | None = Field(None, gt=0.0)

    def component(self) -> winds.Component:
        """The wind model."""
        return winds.Dryden(
            self.wind_6m_m_s, self.high_std_m_s, self.fixed_std_m_s, self.fixed_scale_m
        )


class VonKarmanTurbulence(Strict):
    """Von Karman turbulence: Dryden's intensities, but true at the short waves a small wing feels.

    MIL-F-8785C prefers it; see :mod:`sim_feeds.von_karman`.
    """

    kind: Literal["von-karman"]
    wind_6m_m_s: float = Field(7.7, ge=0.0, description="Mean wind at 20 ft; 7.7 is light.")
    high_std_m_s: float = Field(1.5, ge=0.0, description="Intensity above 2000 ft.")

    def component(self) -> winds.Component:
        """The wind model."""
        return VonKarman(self.wind_6m_m_s, self.high_std_m_s)


WindPart = Annotated[
    ConstantWind | RampWind | GustWind | ShearWind | Turbulence | VonKarmanTurbulence,
    Field(discriminator="kind"),
]
