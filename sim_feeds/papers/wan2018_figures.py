"""The flights of wan2018 Figs. 2 to 5 and of the test of its Theorem 1, as arrays.

The conditions stand in ``wan2018_figures.toml`` beside this module, with what of them is printed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import radians
from typing import Final

import numpy as np

from sim_feeds.faults import KNOT_M_S, Fault, FaultKind
from sim_feeds.legs import WindPart
from sim_feeds.papers.bundled import scenario_of
from sim_feeds.papers.wan import WAN_SAMPLE_S, LongitudinalExperiment, wan_experiment
from sim_feeds.papers.wan2016 import flight_plan
from sim_feeds.section import Strict
from sim_feeds.wind import Constant, Wind

__all__ = ["FILE", "Conditions", "SensitivityDraws", "SensitivityFlight", "conditions"]

FILE: Final = "wan2018_figures.toml"
Range = tuple[float, float]


class SensitivityDraws(Strict):
    """Ranges that the flights of Theorem 1 are drawn from."""

    flights: int
    vane_flights: int
    speed_kt: Range
    height_ft: Range
    wind_kt: Range
    rate_kt_s: Range
    vane_rate_deg_s: Range
    vertical_bound_kt: float
    q_w: Range
    horizons: tuple[int, ...]
    later_samples: int


@dataclass(frozen=True, slots=True)
class SensitivityFlight:
    """One flight on which all three sensors of a channel run away until a bound is active.

    Attributes
    ----------
    flight
        60 s of it, the fault from 10 s on.
    vanes
        Whether the vanes run away (against W_z) or the pitots (against W_x).
    q_w
        Variance of the wind's rate [m^2/s^4].
    horizon
        Samples N.
    """

    flight: LongitudinalExperiment
    vanes: bool
    q_w: float
    horizon: int


class Conditions(Strict):
    """The scenario file."""

    speed_kt: float
    height_ft: float
    onset_s: float
    window_samples: int
    healthy_s: float
    runaway_kt_s: float
    rates_kt_s: tuple[float, ...]
    wind: dict[str, tuple[WindPart, ...]]
    sensitivity: SensitivityDraws

    def healthy(self, wind: str, seed: int) -> LongitudinalExperiment:
        """The flight of Fig. 3."""
        return self._fly([], wind, seed, self.healthy_s)

    def runaway(self, wind: str, rate_kt_s: float, seed: int) -> LongitudinalExperiment:
        """Three airspeeds that run away from ``onset_s`` to the end of the window: Figs. 4, 5."""
        faults = [
            Fault(f"airspeed{i}", FaultKind.RUNAWAY, self.onset_s, rate=rate_kt_s * KNOT_M_S)
            for i in range(3)
        ]
        duration = self.onset_s + (self.window_samples + 1) * WAN_SAMPLE_S
        return self._fly(faults, wind, seed, duration)

    def _fly(
        self, faults: list[Fault], wind: str, seed: int, duration_s: float
    ) -> LongitudinalExperiment:
        return wan_experiment(
            faults,
            seed,
            plan=flight_plan(self.speed_kt, self.height_ft),
            wind=Wind([part.component() for part in self.wind[wind]]),
            duration_s=duration_s,
        )

    def sensitivity_flight(self, number: int, seed: int) -> SensitivityFlight:
        """Flight ``number`` of ``flights + vane_flights``; the last ones are the vanes'."""
        draws = self.sensitivity
        rng = np.random.default_rng([seed, number])

        def log_uniform(low: float, high: float) -> float:
            return float(np.exp(rng.uniform(np.log(low), np.log(high))))

        vanes = number >= draws.flights
        plan = flight_plan(rng.uniform(*draws.speed_kt), rng.uniform(*draws.height_ft))
        north = rng.uniform(*draws.wind_kt) * KNOT_M_S
        if vanes:
            prefix, rate = "aoa", radians(log_uniform(*draws.vane_rate_deg_s))
        else:
            prefix, rate = "airspeed", -log_uniform(*draws.rate_kt_s) * KNOT_M_S
        faults = [Fault(f"{prefix}{i}", FaultKind.RUNAWAY, 10.0, rate=rate) for i in range(3)]
        flight = wan_experiment(
            faults, seed + number, plan=plan, wind=Wind([Constant(np.array([north, 0.0, 0.0]))])
        )
        q_w = log_uniform(*draws.q_w)
        return SensitivityFlight(flight, vanes, q_w, draws.horizons[number % len(draws.horizons)])


@cache
def conditions() -> Conditions:
    """The scenario file."""
    return scenario_of(FILE, Conditions)
