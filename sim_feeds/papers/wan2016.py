"""The eight scenarios of wan2016 as arrays, from ``wan2016.toml`` beside this module.

The paper prints heights, airspeeds, manoeuvres, which sensors fail and how; sizes, times and most
winds it does not print stand in the file, each with its reason.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import cache
from math import radians
from typing import Final

from pydantic import Field

from sim_feeds import earth
from sim_feeds.airframe import AIRFRAMES
from sim_feeds.faults import KNOT_M_S, Fault, FaultKind
from sim_feeds.flightplan import FlightPlan
from sim_feeds.legs import Leg, WindPart
from sim_feeds.papers.bundled import scenario_of
from sim_feeds.papers.wan import LongitudinalExperiment, wan_experiment
from sim_feeds.section import Strict
from sim_feeds.wind import FOOT_M, Wind

__all__ = ["FILE", "Group", "Noise", "Scenario", "Table1", "flight_plan", "table1"]

FILE: Final = "wan2016.toml"


class Noise(Strict):
    """Standard deviations of the measured quantities."""

    v_g_m_s: float
    theta_deg: float
    q_deg_s: float
    acc_m_s2: float
    height_m: float
    v_z_m_s: float
    aoa_deg: float
    cas_m_s: float

    def si(self) -> dict[str, float]:
        """In the form that :func:`sim_feeds.papers.wan.wan_experiment` takes."""
        return {
            "v_g": self.v_g_m_s,
            "theta": radians(self.theta_deg),
            "q": radians(self.q_deg_s),
            "acc": self.acc_m_s2,
            "height": self.height_m,
            "v_z": self.v_z_m_s,
            "aoa": radians(self.aoa_deg),
            "cas": self.cas_m_s,
        }


class Group(Strict):
    """The same fault of several sensors of one kind."""

    kind: FaultKind
    sensors: tuple[int, ...] = Field(min_length=1)
    size_deg: float | None = None
    size_kt: float | None = None
    rate_kt_s: float | None = None
    fraction: float | None = None
    period_s: float = 2.0

    def faults(self, prefix: str, onset_s: float, scale: float = 1.0) -> list[Fault]:
        """One fault each of ``prefix0`` ..., its size or rate ``scale`` times the file's."""
        size = self.fraction or radians(self.size_deg or 0.0) or (self.size_kt or 0.0) * KNOT_M_S
        rate = (self.rate_kt_s or 0.0) * KNOT_M_S
        return [
            Fault(
                f"{prefix}{i}",
                self.kind,
                onset_s,
                size=scale * size,
                rate=scale * rate,
                period_s=self.period_s,
            )
            for i in self.sensors
        ]


class Scenario(Strict):
    """One row of Table 1."""

    name: str
    manoeuvre: str
    height_ft: float
    speed_kt: float = Field(description="Calibrated airspeed at the start.")
    wind: str
    leg: tuple[Leg, ...]
    vanes: Group | None = None
    pitots: Group | None = None


class Table1(Strict):
    """All scenarios with what they share."""

    onset_s: float
    duration_s: float
    noise: dict[str, Noise]
    wind: dict[str, tuple[WindPart, ...]]
    scenario: tuple[Scenario, ...]

    def named(self, name: str) -> Scenario:
        """The scenario of this name."""
        return next(s for s in self.scenario if s.name == name)

    def experiment(
        self,
        name: str,
        seed: int,
        *,
        faulty: bool = True,
        noise: str = "assumed",
        without: Collection[str] = (),
        scale: float = 1.0,
        onset_s: float | None = None,
    ) -> LongitudinalExperiment:
        """Fly a scenario; the healthy and the faulty run of a seed share flight and noise.

        Parameters
        ----------
        name
            Of the scenario.
        seed
            Of noise and turbulence.
        faulty
            False leaves the sensors whole.
        noise
            A set of the file.
        without
            Kinds of wind that do not blow: "dryden" for turbulence, "ramp" for a steady wind.
        scale
            Multiplies the size or rate of the pitots' faults.
        onset_s
            In place of the file's.
        """
        row = self.named(name)
        start = self.onset_s if onset_s is None else onset_s
        faults: list[Fault] = []
        if faulty and row.vanes:
            faults += row.vanes.faults("aoa", start)
        if faulty and row.pitots:
            faults += row.pitots.faults("airspeed", start, scale)
        parts = [p for p in self.wind[row.wind] if p.kind not in without]
        plan = flight_plan(row.speed_kt, row.height_ft)
        for leg in row.leg:
            leg.fly(plan)
        return wan_experiment(
            faults,
            seed,
            plan=plan,
            wind=Wind([p.component() for p in parts]),
            duration_s=self.duration_s,
            noise_std=self.noise[noise].si(),
        )


def flight_plan(cas_kt: float, height_ft: float) -> FlightPlan:
    """An empty plan of a transport trimmed at a calibrated airspeed and height."""
    height = height_ft * FOOT_M
    cas = cas_kt * KNOT_M_S
    tas = earth.true_airspeed_of_cas(cas, height)
    airframe = replace(AIRFRAMES["transport"], cruise_m_s=cas)
    return FlightPlan(airframe, speed_m_s=float(tas), height_m=height)


@cache
def table1() -> Table1:
    """The scenario file."""
    return scenario_of(FILE, Table1)
