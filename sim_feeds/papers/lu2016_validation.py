"""Which flights validate lu2016's reconstruction in closed loop and on recordings, validated."""

from __future__ import annotations

from functools import cache
from math import radians

from pydantic import Field

from sim_feeds.papers.bundled import scenario_of
from sim_feeds.papers.lu2016 import Air
from sim_feeds.section import Strict

__all__ = [
    "ClosedLoopSection",
    "OrderSection",
    "RecordedFlight",
    "RecordedSection",
    "Validation",
    "validation",
]


class OrderSection(Strict):
    """What the autopilot is told from a time on."""

    start_s: float = Field(ge=0.0)
    bank_deg: float = Field(0.0, gt=-45.0, lt=45.0)
    climb_m_s: float = 0.0


class ClosedLoopFlight(Strict):
    """The flight that is flown by the autopilot."""

    duration_s: float = Field(gt=0.0)
    rate_hz: float = Field(gt=0.0)
    speed_m_s: float = Field(gt=0.0)
    height_m: float
    heading_deg: float
    order: tuple[OrderSection, ...]

    @property
    def heading_rad(self) -> float:
        """At the start."""
        return radians(self.heading_deg)


class ClosedLoopSection(Strict):
    """Sections 3.2 and 3.3 of the paper."""

    winds: tuple[Air, ...]
    quick_winds: tuple[Air, ...]
    seeds: tuple[int, ...] = Field(min_length=1)
    quick_seeds: tuple[int, ...] = Field(min_length=1)
    tuning_seeds: tuple[int, ...] = Field(description="On which the autopilot was tuned.")
    flight: ClosedLoopFlight

    def chosen(self, quick: bool) -> list[tuple[Air, int]]:
        """Winds and seeds of the version asked for."""
        winds, seeds = (self.quick_winds, self.quick_seeds) if quick else (self.winds, self.seeds)
        return [(wind, seed) for wind in winds for seed in seeds]


class RecordedFlight(Strict):
    """One recording, and where the faults of the figures begin in it."""

    name: str
    file: str
    healthy_until_s: float | None = Field(None, gt=0.0, description="From the first record.")
    shown_s: float = Field(gt=0.0)


class RecordedSection(Strict):
    """Section 5 of the paper."""

    fault_s: float = Field(gt=0.0)
    before_s: float = Field(gt=0.0)
    after_s: float = Field(gt=0.0)
    step_s: float = Field(gt=0.0)
    gps_hz: float = Field(gt=0.0)
    flight: tuple[RecordedFlight, ...]

    def onsets_s(self, flight: RecordedFlight, duration_s: float, *, quick: bool) -> list[float]:
        """Where faults begin: that of the figures, and once every step in the healthy part.

        Parameters
        ----------
        flight
            One of the section's.
        duration_s
            Of its recording.
        quick
            That of the figures only.
        """
        last = min(duration_s, flight.healthy_until_s or duration_s) - self.after_s - self.fault_s
        count = 0 if quick else int((last - self.before_s) // self.step_s) + 1
        even = [self.before_s + k * self.step_s for k in range(max(count, 0))]
        return sorted({flight.shown_s, *even})


class Validation(Strict):
    """Everything that is flown, and the recordings that are used."""

    closed_loop: ClosedLoopSection
    recorded: RecordedSection


@cache
def validation() -> Validation:
    """The bundled file."""
    return scenario_of("lu2016_validation.toml", Validation)
