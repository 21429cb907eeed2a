"""A flight as a file: aircraft, manoeuvres, wind, instruments, faults; validated, bit-reproducible.

``load("demo")`` finds a bundled scenario, ``load("my/flight.toml")`` a file. A scenario with a seed
determines every bit of the flight, of the sensor readings and of the frames.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from math import radians
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, model_validator

from sim_feeds.airframe import AIRFRAMES
from sim_feeds.autopilot import Autopilot, Navigation
from sim_feeds.fault_table import FaultEntry
from sim_feeds.faults import Fault
from sim_feeds.flightplan import FlightPlan
from sim_feeds.legs import Leg, WindPart
from sim_feeds.section import ScenarioError, Strict, parse_table
from sim_feeds.sensors import Airspeed, Aoa, Baro, Gps, Imu, Series
from sim_feeds.trajectory import Truth, fly
from sim_feeds.wind import Wind

__all__ = ["FaultEntry", "Flight", "Scenario", "ScenarioError", "bundled", "load"]

BUNDLE: Final = "scenarios"


class Start(Strict):
    """Where and how the flight begins."""

    speed_m_s: float = Field(0.0, ge=0.0, description="True airspeed; 0 is on the ground.")
    agl_m: float = Field(0.0, ge=0.0, description="Height above the field.")
    heading_deg: float = 0.0
    lat_deg: float = Field(52.0, gt=-80.0, lt=80.0)
    lon_deg: float = Field(4.4, ge=-180.0, le=180.0)
    field_m: float = Field(50.0, ge=-400.0, le=4000.0, description="Height of the field.")
    temperature_offset_k: float = 0.0
    boot_s: float = Field(20.0, ge=0.0, description="Vehicle time of the flight's first moment.")


class Messages(Strict):
    """Which messages the autopilot sends, and how often."""

    imu: Literal["raw", "highres"] = Field(
        "raw",
        description="RAW_IMU with SCALED_IMU2/3 in whole milli-g and mrad/s, or HIGHRES_IMU(id).",
    )
    airspeed: Literal["pressure", "airspeed"] = Field(
        "pressure", description="SCALED_PRESSURE only, or AIRSPEED(id) beside it."
    )
    attitude_hz: float = Field(25.0, gt=0.0, le=200.0, description="ATTITUDE.")
    quaternion_hz: float = Field(10.0, ge=0.0, le=200.0, description="ATTITUDE_QUATERNION.")
    position_hz: float = Field(10.0, gt=0.0, le=50.0, description="GLOBAL_POSITION_INT.")
    hud_hz: float = Field(4.0, ge=0.0, le=50.0, description="VFR_HUD.")
    servo_hz: float = Field(5.0, ge=0.0, le=50.0, description="SERVO_OUTPUT_RAW.")
    rpm_hz: float = Field(4.0, ge=0.0, le=50.0, description="RPM.")
    status_hz: float = Field(2.0, gt=0.0, le=10.0, description="SYS_STATUS, EXTENDED_SYS_STATE.")
    system_id: int = Field(1, ge=1, le=250)
    arm_s: float = Field(2.0, ge=0.0, description="When the motors are armed.")


class Scenario(Strict):
    """A flight that can be flown: see the module."""

    title: str
    aircraft: Literal["transport", "light-aircraft", "small-uav"]
    seed: int = Field(0, ge=0, description="Used unless the caller gives another.")
    truth_hz: float = Field(200.0, ge=50.0, le=1000.0, description="Grid of the truth.")
    start: Start = Start()
    leg: tuple[Leg, ...]
    wind: tuple[WindPart, ...] = ()
    imu: Imu = Imu()
    airspeed: Airspeed = Airspeed()
    aoa: Aoa = Aoa()
    baro: Baro = Baro()
    gps: Gps = Gps()
    autopilot: Autopilot = Autopilot()
    messages: Messages = Messages()
    fault: tuple[FaultEntry, ...] = ()

    @model_validator(mode="after")
    def _instruments_exist(self) -> Scenario:
        if not self.leg:
            raise ValueError("a flight needs at least one leg")
        if self.messages.imu == "raw" and self.imu.count > 3:
            raise ValueError("a fourth IMU needs messages.imu = 'highres'")
        for f in self.fault:
            base = f.sensor.split(".")[0]
            if f.quantity in ("attitude", "spool") or base == "attitude":
                raise ValueError(f"{f.sensor} is computed here, not sensed: it has no fault")
            count = getattr(self, base[:-1]).count
            if int(base[-1]) >= count:
                raise ValueError(
                    f"fault on {f.sensor}, but the aircraft has {count} {base[:-1]} sensor(s)"
                )
        follows = self.autopilot.attitude_follows_imu
        if follows is not None and follows >= self.imu.count:
            raise ValueError(f"attitude_follows_imu = {follows}, but imu.count = {self.imu.count}")
        end_s = self.plan().time_s
        for f in self.fault:
            if f.start_s >= end_s:
                raise ValueError(
                    f"fault on {f.sensor} begins at {f.start_s:g} s, but the flight of this "
                    f"{self.aircraft} ends at {end_s:.0f} s"
                )
        return self

    def plan(self) -> FlightPlan:
        """The manoeuvres as profiles."""
        s = self.start
        plan = FlightPlan(
            AIRFRAMES[self.aircraft], s.speed_m_s, s.field_m + s.agl_m, radians(s.heading_deg)
        )
        for leg in self.leg:
            leg.fly(plan)
        return plan

    @property
    def duration_s(self) -> float:
        """Length of the flight."""
        return self.plan().time_s

    def faults(self) -> list[Fault]:
        """The faults, in SI."""
        return [f.fault() for f in self.fault]

    def fly(self, seed: int | None = None) -> Flight:
        """Truth and all readings; the same seed gives the same bits."""
        seed = self.seed if seed is None else seed
        s = self.start
        truth = fly(
            self.plan(),
            Wind([w.component() for w in self.wind]),
            seed=seed,
            rate_hz=self.truth_hz,
            lat_rad=radians(s.lat_deg),
            lon_rad=radians(s.lon_deg),
            field_m=s.field_m,
            temperature_offset_k=s.temperature_offset_k,
        )
        faults = self.faults()
        readings: dict[str, Series] = {}
        for kind in ("imu", "airspeed", "aoa", "baro", "gps"):
            instrument = getattr(self, kind)
            for i in range(instrument.count):
                readings[f"{kind}{i}"] = instrument.sample(truth, i, faults, seed)
        follows = self.autopilot.attitude_follows_imu
        source = None if follows is None else readings[f"imu{follows}"]
        rate = max(self.messages.attitude_hz, self.messages.quaternion_hz)
        navigation = self.autopilot.estimate(truth, source, seed, rate)
        return Flight(self, seed, truth, faults, readings, navigation)


@dataclass(frozen=True, slots=True)
class Flight:
    """A scenario flown with one seed: truth, readings per sensor, the autopilot's solution."""

    scenario: Scenario
    seed: int
    truth: Truth
    faults: list[Fault]
    readings: dict[str, Series]
    navigation: Navigation


def bundled() -> list[str]:
    """Names of the scenarios that come along."""
    folder = resources.files("sim_feeds") / BUNDLE
    return sorted(
        p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")
    )


def load(
    name_or_path: str | Path, override: Callable[[dict[str, Any]], None] | None = None
) -> Scenario:
    """Read and validate a scenario.

    Parameters
    ----------
    name_or_path
        Name of a bundled scenario, or a TOML file.
    override
        Changes the parsed table in place before validation.

    Raises
    ------
    ScenarioError
        When there is none of that name, the file is no TOML, or a value does not fit.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml" or path.is_file():
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise ScenarioError(f"cannot read {path}: {error.strerror}") from error
    else:
        text = _bundled_text(str(name_or_path))
    return parse(text, str(name_or_path), override)


def _bundled_text(name: str) -> str:
    names = bundled()
    if name not in names:
        near = difflib.get_close_matches(name, names, 1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; there are {', '.join(names)}"
        raise ScenarioError(f"no bundled scenario is called {name!r}{hint}")
    return (resources.files("sim_feeds") / BUNDLE / f"{name}.toml").read_text(encoding="utf-8")


def parse(
    text: str, where: str = "scenario", override: Callable[[dict[str, Any]], None] | None = None
) -> Scenario:
    """Validate the text of a scenario; errors begin with ``where``."""
    return parse_table(text, Scenario, where, override)
