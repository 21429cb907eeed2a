"""Which experiments the reproduction of lu2016 consists of: ``lu2016_runs.toml``, validated."""

from __future__ import annotations

from functools import cache

from pydantic import Field

from sim_feeds.legs import Leg, WindPart
from sim_feeds.papers.bundled import scenario_of
from sim_feeds.papers.lu2016 import Air
from sim_feeds.section import Strict

__all__ = ["FlightSection", "Recorder", "Runs", "runs"]


class Draws(Strict):
    """Seeds of a study; those of the quick version are among them."""

    seeds: list[int] = Field(min_length=1)
    quick_seeds: list[int] = Field(min_length=1)

    def chosen(self, quick: bool) -> list[int]:
        """Seeds of the version asked for."""
        return self.quick_seeds if quick else self.seeds


class SimulatedSection(Draws):
    """Section 3 of the paper."""

    winds: list[Air]
    tuning_seeds: list[int] = Field(description="On which constants may be chosen.")


class RatesSection(Draws):
    """Satellite receivers of several rates."""

    winds: list[Air]
    gps_hz: list[int]


class FaultWalkSection(Draws):
    """Wrong choices of Q^f, as factors of the standing one."""

    winds: list[Air]
    factors: list[float]


class OpenLoopSection(Draws):
    """Section 5 of the paper."""


class Recorder(Strict):
    """Instruments of a recording; wander and biases are drawn once a flight."""

    rate_hz: float = Field(gt=0.0)
    acc_std_m_s2: float = Field(ge=0.0)
    acc_bias_std_m_s2: float = Field(ge=0.0)
    gyro_std_deg_s: float = Field(ge=0.0)
    gyro_bias_std_deg_s: float = Field(ge=0.0)
    attitude_std_deg: float = Field(ge=0.0)
    attitude_wander_std_deg: float = Field(ge=0.0)
    attitude_wander_s: float = Field(gt=0.0)
    gps_hz: float = Field(gt=0.0)
    gps_std_m_s: float = Field(ge=0.0)
    tas_std_m_s: float = Field(ge=0.0)
    tas_scale: float = Field(gt=0.0)
    vane_std_deg: float = Field(ge=0.0)
    vane_scale: float = Field(gt=0.0)
    vane_offset_deg: float


class FlightSection(Strict):
    """One flight to be recorded."""

    name: str
    duration_s: float = Field(gt=0.0)
    calm_s: float = Field(0.0, ge=0.0, description="The turbulence begins after this.")
    leg: list[Leg]
    wind: list[WindPart] = Field(default_factory=list)


class Runs(Strict):
    """Everything that is flown for lu2016 in simulation."""

    simulated: SimulatedSection
    rates: RatesSection
    fault_walk: FaultWalkSection
    open_loop: OpenLoopSection
    recorder: Recorder
    flight: list[FlightSection]


@cache
def runs() -> Runs:
    """The bundled file."""
    return scenario_of("lu2016_runs.toml", Runs)
